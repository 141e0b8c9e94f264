"""Controllers that live elsewhere: in a project of one's own, with or without an entry point, and their rows."""

import json
import os
import subprocess
import sys

import pytest

from drillenv.training.evaluate import read_record
from drillenv.training.league_table import page_part

MINE = """
import numpy as np
class Mine:
    def reset(self, seed=None): self.rng = np.random.default_rng(seed)
    def act(self, observation, info):
        assert info == {}
        return [0.8, float(self.rng.uniform(-0.1, 0.1)), -0.4]
class Seeing(Mine):
    sees_truth = True
    def act(self, observation, info): return np.full(3, min(1.0, 0.001 * info["force_excess"]))
class NoAct:
    def reset(self, seed=None): pass
class Picky(Mine):
    def __init__(self, gain): pass
class Wild(Mine):
    def act(self, observation, info): return np.full(3, 2.0)
NUMBER = 3
"""
FILES = {
    "site/my_lab/__init__.py": "",
    "site/my_lab/rules.py": MINE,
    "site/my_lab/broken.py": "import nowhere_to_be_found\n",
    "controllers/__init__.py": "from my_lab.rules import Mine\n",
    "training.py": "raise RuntimeError('this is the project\\'s own')\n",
    "site/my_lab-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: my-lab\nVersion: 1.0\n",
    "site/my_lab-1.0.dist-info/entry_points.txt": (
        "[drillenv.controllers]\nmy-rules = my_lab.rules:Mine\nmy-broken = my_lab.broken:Mine\n"
    ),
}
SHORT = ["--scenario", "validation", "--episodes", "2", "--steps", "6", "--threads", "1"]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("project")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def drillenv(project):
    """Runs the command drillenv in the project, as its script does: the present folder is not on the path by itself."""

    def run(*arguments):
        command = [sys.executable, "-P", "-m", "drillenv.cli", *arguments]
        variables = os.environ | {"PYTHONPATH": str(project / "site")}
        return subprocess.run(command, cwd=project, env=variables, capture_output=True, text=True, timeout=300)

    return run


@pytest.mark.slow
def test_a_class_and_an_entry_point_have_rows_of_their_own(drillenv, project):
    wanted = ["rules", "my-rules", "my_lab.rules:Mine", "own=controllers:Mine", "own=my_lab.rules:Seeing"]
    files = ["--json", "record.json", "--table", "table.md"]
    done = drillenv("league", "--controllers", *wanted, *SHORT, *files)
    assert done.returncode == 0, done.stderr
    record = read_record(project / "record.json")
    assert list(record["runs"]) == ["rules", "oracle", "my-rules", "my_lab.rules:Mine", "own"]
    mine = record["runs"]["my-rules"][0]
    assert mine["source"] == "my-rules" and mine["sees_truth"] is False
    # the same class by three ways, with the same seeds
    for row in ("my_lab.rules:Mine", "own"):
        assert record["runs"][row][0]["episodes"] == mine["episodes"]
    assert len(record["runs"]["own"]) == 2 and record["runs"]["own"][1]["sees_truth"] is True
    for row in record["runs"]:
        assert f"| {row}" in done.stdout
    assert (project / "table.md").read_text(encoding="utf-8") == page_part(record) + "\n"
    # they stay when another row is made
    done = drillenv("league", "--controllers", "fixed", *SHORT, *files[:2])
    assert done.returncode == 0, done.stderr
    again = read_record(project / "record.json")
    assert again["runs"].pop("fixed") and again["runs"] == record["runs"]
    assert set(again["summary"]["rows"]) == {"fixed", *record["runs"]}


@pytest.mark.slow
def test_all_means_those_that_are_installed_too(drillenv):
    done = drillenv("league", "--controllers", "all", *SHORT)
    assert done.returncode == 2
    assert done.stderr.startswith("drillenv: controller my-broken of my-lab, my_lab.broken:Mine, cannot be imported")
    assert "nowhere_to_be_found" in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_film_of_it(drillenv, project):
    done = drillenv("film", "--controllers", "my-rules", "--out", "film.gif", "--frames", "2", "--width", "80")
    assert done.returncode == 0, done.stderr
    assert (project / "film.gif").read_bytes()[:3] == b"GIF"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("my_lab.rules:NoAct", "controller my_lab.rules:NoAct has no act: give a class with reset(seed) and act("),
        ("my_lab.rules:Picky", "controller my_lab.rules:Picky cannot be made (TypeError: "),
        ("my_lab.rules:Wild", "act of Wild gave array([2., 2., 2.]): let it give 3 numbers, each from -1 to 1"),
        ("my_lab.rules:NUMBER", "controller my_lab.rules:NUMBER is 3: let it be a class"),
        ("my_lab.rules:Nobody", "cannot be imported (AttributeError: "),
        ("my_lab.broken:Mine", "cannot be imported (ModuleNotFoundError: No module named 'nowhere_to_be_found')"),
        ("training:Mine", "cannot be imported (RuntimeError: this is the project's own)"),
        ("my_rules", "controller is 'my_rules': give one of random, fixed, rules"),
        ("rules=my_lab.rules:Mine", "rules is a row of the league already; give it another name"),
        ("=my_lab.rules:Mine", "give a controller, or ROW=CONTROLLER"),
        ("a|b=my_lab.rules:Mine", "with a name that a table can hold"),
    ],
)
def test_what_cannot_enter_gets_one_line(drillenv, project, name, said):
    done = drillenv("league", "--controllers", name, *SHORT, "--json", "bad.json")
    assert done.returncode == 2 and done.stdout == ""
    line = done.stderr.splitlines()[-1]
    assert line.startswith("drillenv: ") and said in line and len(line) < 500
    assert name == "my_lab.rules:Wild" or done.stderr.count("\n") == 1
    if (project / "bad.json").exists():  # what was done before is kept
        assert list(read_record(project / "bad.json")["runs"]) == ["oracle"]


def test_make_takes_it_with_settings(project):
    code = (
        "import json\nfrom drillenv import controllers\n"
        "made = controllers.make('my_lab.rules:Picky', gain=2)\n"
        "print(json.dumps([type(made).__name__, controllers.sees_truth(made), sorted(controllers.installed())]))\n"
    )
    variables = os.environ | {"PYTHONPATH": os.pathsep.join([str(project), str(project / "site")])}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == ["Picky", False, ["my-broken", "my-rules"]]


def test_two_of_one_name_are_refused(project, tmp_path):
    (tmp_path / "their_lab-1.0.dist-info").mkdir()
    for file, text in (
        ("METADATA", "Metadata-Version: 2.1\nName: their-lab\nVersion: 1.0\n"),
        ("entry_points.txt", "[drillenv.controllers]\nrules = my_lab.rules:Mine\n"),
    ):
        (tmp_path / "their_lab-1.0.dist-info" / file).write_text(text, encoding="utf-8")
    code = "from drillenv import controllers\ncontrollers.make('rules')\ncontrollers.installed()\n"
    variables = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True)
    assert "their-lab brings a controller rules, which drillenv has: rename or uninstall it" in done.stderr
