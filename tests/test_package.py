"""What is installed: all of it, under the one name drillenv."""

import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("drillenv", "controllers", "training")
BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_{0}(sys.argv[1]))"


def test_every_folder_of_code_is_installed():
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    found = {
        ".".join(file.parent.relative_to(ROOT).parts) for room in ROOMS for file in (ROOT / room).rglob("__init__.py")
    }
    assert set(stated) == {name if name.startswith("drillenv") else f"drillenv.{name}" for name in found}


def test_type_checkers_find_the_rooms_beside_drillenv():
    for room in ROOMS[1:]:
        assert (ROOT / "drillenv" / room).resolve() == ROOT / room


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel that is made of the source distribution of this checkout."""
    folder = tmp_path_factory.mktemp("build")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ROOMS:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))

    def build(kind, where):
        done = subprocess.run(
            [sys.executable, "-c", BUILD.format(kind), str(folder)], cwd=where, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return folder / done.stdout.split()[-1]

    with tarfile.open(build("sdist", source)) as archive:
        archive.extractall(folder / "again", filter="data")
    (unpacked,) = (folder / "again").iterdir()
    return build("wheel", unpacked)


@pytest.mark.slow
def test_the_wheel_claims_one_name_and_holds_every_file(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert {name.partition("/")[0] for name in names} == {"drillenv"}
    kept = {".py", ".json", ".npz", ".safetensors", ".html", ".css", ".js", ".typed"}
    for room in ROOMS:
        for file in (ROOT / room).rglob("*"):
            if file.suffix in kept or file.name == "py.typed":
                name = file.relative_to(ROOT).as_posix()
                assert (name if room == "drillenv" else f"drillenv/{name}") in names


SMOKE = """
import sys
import controllers, training  # those of the project
assert controllers.OWN == training.OWN == 1
import numpy as np
import drillenv
assert drillenv.__file__.startswith(sys.argv[1]), drillenv.__file__
for name in drillenv.controllers.NAMES:
    controller = drillenv.controllers.make(name)
    assert sys.modules[type(controller).__module__].__file__.startswith(sys.argv[1])
controller = drillenv.controllers.make("learned")
controller.reset(seed=0)
assert controller.act(np.ones(15, dtype=np.float32), {}).shape == (3,)
from drillenv.training.rollout import rollout
print(rollout(lambda: drillenv.controllers.make("rules"), "DrillLayers", "validation", 1, 8).scores[0])
"""


@pytest.mark.slow
def test_a_project_with_folders_of_those_names_uses_what_is_installed(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    project = tmp_path / "project"
    for name in ROOMS[1:]:
        (project / name).mkdir(parents=True)
        (project / name / "__init__.py").write_text("OWN = 1\n", encoding="utf-8")
    (project / "main.py").write_text(SMOKE, encoding="utf-8")
    variables = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    done = subprocess.run(
        [sys.executable, "main.py", str(tmp_path / "installed")],
        cwd=project, env=variables, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0.5
