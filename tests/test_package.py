"""What is installed: all of it, under the one name drillenv."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import drillenv
from drillenv import cli
from drillenv.cli_options import commands_below

ROOT = Path(__file__).parents[1]
ROOMS = ("drillenv", "controllers", "training")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
VERSION = PROJECT["project"]["version"]
OLDEST, NEWEST = 11, 14
"""Of Python 3."""


def test_every_folder_of_code_is_installed():
    stated = PROJECT["tool"]["setuptools"]["packages"]
    found = {
        ".".join(file.parent.relative_to(ROOT).parts) for room in ROOMS for file in (ROOT / room).rglob("__init__.py")
    }
    assert set(stated) == {name if name.startswith("drillenv") else f"drillenv.{name}" for name in found}


def test_type_checkers_find_the_rooms_beside_drillenv():
    for room in ROOMS[1:]:
        assert (ROOT / "drillenv" / room).resolve() == ROOT / room


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """The source distribution of this checkout, and the wheel that is made of it."""
    folder = tmp_path_factory.mktemp("build")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ROOMS:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder / "dist"), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return sorted((folder / "dist").iterdir())


@pytest.fixture(scope="module")
def wheel(archives):
    (only,) = (each for each in archives if each.suffix == ".whl")
    return only


@pytest.mark.slow
def test_the_archives_are_fit_for_an_index(archives):
    assert [each.name for each in archives] == [f"drillenv-{VERSION}-py3-none-any.whl", f"drillenv-{VERSION}.tar.gz"]
    command = [sys.executable, "-m", "twine", "check", "--strict", *map(str, archives)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_one_version_everywhere():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, flags=re.MULTILINE) == [VERSION]
    (released,) = re.findall(r"^date-released: (.*)$", citation, flags=re.MULTILINE)
    assert f"\n## [{VERSION}] - {released}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


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
import drillenv.training.rollout
assert drillenv.training.rollout.__file__.startswith(sys.argv[1])
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


COMPLETE = 0.975
"""Share of the public names, those of every module taken together, whose type is fully stated."""


@pytest.mark.slow
def test_public_types_are_stated(tmp_path):
    # pyright looks for libraries by the python on PATH, and those of the tests are in this one's environment
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    pyright = shutil.which("pyright", path=path)
    if pyright is None:
        pytest.skip("no pyright")
    # from another folder, or it takes the checkout for a project and not for an installed package
    done = subprocess.run(
        [pyright, "--verifytypes", "drillenv", "--ignoreexternal", "--outputjson", "--pythonpath", sys.executable],
        cwd=tmp_path, env=os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    found = json.loads(done.stdout)["typeCompleteness"]
    assert found["completenessScore"] >= COMPLETE
    known = {each["name"]: each["isTypeKnown"] for each in found["symbols"]}
    # whatever is imported from drillenv itself, and what hangs on it
    assert [name for name in drillenv.__all__ if not known.get(f"drillenv.{name}", True)] == []
    homes = ("rig", "rocks", "rock_file", "checks", "dynamics.simulate", "dynamics.motion", "diagnosis.report")
    within = tuple(f"drillenv.{home}." for home in homes)
    assert [name for name, stated in known.items() if name.startswith(within) and not stated] == []


# --- Installed into an empty environment


def pythons():
    """The oldest Python that will do and the newest one found, on PATH or among those of pyenv."""
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    places = [os.environ.get("PATH", os.defpath), *(str(each / "bin") for each in versions.glob("3.*"))]
    found = {}
    for minor in range(OLDEST, NEWEST + 1):
        for place in places:
            command = shutil.which(f"python3.{minor}", path=place)
            # the shims of pyenv are there for versions that are not switched on, too
            if command and subprocess.run([command, "-c", "import ensurepip"], capture_output=True).returncode == 0:
                found.setdefault(minor, command)
    return [found[minor] for minor in sorted({min(found), max(found)})] if found else []


@pytest.fixture(scope="module", params=pythons(), ids=lambda command: Path(command).name)
def installed(request, wheel, tmp_path_factory):
    """Runs a command of an environment into which nothing but the wheel was installed, away from the checkout."""
    folder = tmp_path_factory.mktemp("empty")
    variables = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "NUMBA"))}
    (folder / "work").mkdir()

    def go(command, *arguments):
        return subprocess.run(
            [folder / "venv" / "bin" / command, *arguments],
            cwd=folder / "work", env=variables, capture_output=True, text=True,
        )  # fmt: skip

    subprocess.run([request.param, "-m", "venv", folder / "venv"], check=True, env=variables)
    done = go("python", "-m", "pip", "install", "-q", "--no-input", "--disable-pip-version-check", wheel)
    assert done.returncode == 0, done.stderr
    return go


SETTING = ("--frequency", "120", "--amplitude", "0.45", "--pressure", "1.0")
CHEAP = (
    (("motion", "--rock", "4", *SETTING), r"P-1-I-1"),
    (("simulate", "--rock", "4", *SETTING, "--seconds", "0.2", "--out", "run.csv"), r"wrote run\.csv"),
    (("simulate", "--campaign", "made", "--recordings", "3", "--seconds", "0.2"), r"wrote made"),
    (("campaign", "check", "made"), r"3 recordings"),
    (("campaign", "plot", "made", "--out", "recordings.html"), r"wrote recordings\.html"),
    (("paper", "--out", "paper"), r"of 25 agree"),
)


@pytest.mark.thorough
def test_the_wheel_works_in_an_empty_environment(installed):
    checked = installed("python", "-m", "pip", "check")
    assert checked.returncode == 0, checked.stdout
    assert installed("drillenv", "--version").stdout.split() == ["drillenv", VERSION]
    for command in (each.prog.split()[1:] for each in commands_below(cli._parser())):
        done = installed("drillenv", *command, "--help")
        if done.returncode:
            # its options are known to an extra, which is then named in one line
            assert re.fullmatch(r"drillenv: \w+ is not installed: pip install drillenv\[\w+\]\n", done.stderr), command
        else:
            assert f"example:\n  {' '.join(['drillenv', *command])}" in done.stdout
    for arguments, said in CHEAP:
        done = installed("drillenv", *arguments)
        assert done.returncode == 0, done.stderr
        assert re.search(said, done.stdout), (arguments, done.stdout)
