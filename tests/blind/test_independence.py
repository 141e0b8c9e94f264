"""The trial shares nothing with what it tries."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import drillenv
from drillenv.blind.confined import PEEKED

ROOM = Path(drillenv.__file__).parent / "blind"
FORBIDDEN = (
    "drillenv.dynamics",
    "drillenv.diagnosis",
    "drillenv.atlas",
    "drillenv.env",
    "drillenv.corrected",
    "benchmarks",
)
ALLOWED = (
    "drillenv.blind",
    "drillenv.checks",
    "drillenv.compiling",
    "drillenv.files",
    "drillenv.recordings",
    "drillenv.rig",
    "drillenv.cli",
)


def imported(path):
    """Every module of the package that a file imports, at any depth of its code."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            assert node.module is not None
            yield node.module
            yield from (f"{node.module}.{each.name}" for each in node.names)


@pytest.mark.parametrize("path", sorted(ROOM.glob("*.py")), ids=lambda path: path.stem)
def test_imports_nothing_of_the_engines_and_the_diagnosis(path):
    names = [name for name in imported(path) if name.startswith(("drillenv", "benchmarks"))]
    assert not [name for name in names if name.startswith(FORBIDDEN)]
    for name in names:
        assert name.startswith(ALLOWED) or name == "drillenv"
        # the command is run where the diagnosis is confined, and nowhere else
        assert not name.startswith("drillenv.cli") or path.stem == "confined"


@pytest.mark.slow
def test_making_a_campaign_loads_neither_engines_nor_diagnosis(tmp_path):
    code = (
        "import sys, numpy as np\n"
        "from drillenv.blind import campaigns, marking, curves, seal, detection\n"
        "campaigns.plain_campaign(np.random.default_rng(0), recordings=3, seconds=0.05)\n"
        "print([name for name in sys.modules if name.startswith(('drillenv.dynamics', 'drillenv.diagnosis'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def confined(code, trial, tmp_path):
    """The exit code and the words of a process that runs ``code`` as a diagnosis is run."""
    script = f"from drillenv.blind import confined\nconfined.forbid({str(trial)!r})\n{code}"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    "code",
    [
        "open({file!r}).read()",
        "import pathlib; pathlib.Path({file!r}).read_bytes()",
        "import os; os.listdir({folder!r})",
        "import os; os.chdir({folder!r})",
        "import os; os.open({file!r}.encode(), os.O_RDONLY)",
        "import os; os.symlink({file!r}, 'link')",
        "open({link!r}).read()",
        "import subprocess; subprocess.run(['cat', {file!r}])",
        "import os; os.system('cat ' + {file!r})",
        "import os; os.fork()",
        "from drillenv.blind import campaigns",
        "import socket; socket.create_connection(('127.0.0.1', 9), timeout=1)",
    ],
)
def test_a_process_that_peeks_is_ended(code, tmp_path):
    trial = tmp_path / "trial"
    trial.mkdir()
    (trial / "answers.json").write_text("[]")
    link = tmp_path / "innocent"
    os.symlink(trial / "answers.json", link)
    code = code.format(file=str(trial / "answers.json"), folder=str(trial), link=str(link))
    status, said = confined(f"{code}\nprint('unharmed')", trial, tmp_path)
    assert status == PEEKED
    assert "peeked:" in said


@pytest.mark.slow
def test_a_process_that_does_not_peek_goes_on(tmp_path):
    (tmp_path / "own").write_text("mine")
    code = "import h5py, scipy.signal, numba\nassert open('own').read() == 'mine'\nopen('out', 'w').write('done')"
    status, said = confined(code, tmp_path / "trial", tmp_path)
    assert (status, said) == (0, "")
    assert (tmp_path / "out").read_text() == "done"
