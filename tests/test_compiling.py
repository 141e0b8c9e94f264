"""That a person at a terminal is told what the first half minute is for."""

import os
import pty
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from numba import njit

from drillenv.compiling import MESSAGE, helped
from drillenv.dynamics.hybrid import sensitivity, shooting
from drillenv.dynamics.hybrid.model import fresh_motion, model_for
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.vector_field import OWN
from drillenv.env import hybrid_plant
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

MODEL = model_for(Rig(), Setting(100.0, 0.4, 1.0), Rock(1e8, 2e8), ())

CODE = """
from numba import njit
from drillenv.compiling import announce
{announce}
@njit
def one(x):
    return x + 1
@njit
def two(x):
    return one(x)
two(1.0)
"""


def said(code, terminal):
    """What a process prints on stderr, which is a terminal or a pipe."""
    if not terminal:
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stderr
    mine, its = pty.openpty()
    subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=its, check=True)
    os.close(its)
    found = b""
    try:
        while part := os.read(mine, 4096):
            found += part
    except OSError:  # nothing is left
        pass
    os.close(mine)
    return found.decode()


@pytest.mark.slow
def test_a_terminal_is_told_once_and_a_pipe_is_not():
    code = CODE.format(announce="announce()\nannounce()")
    assert said(code, True).splitlines() == [f"drillenv: {MESSAGE}"]
    assert said(code, False) == ""
    assert said(CODE.format(announce=""), True) == ""


@pytest.mark.parametrize("compiles", [True, False])
def test_another_process_helps_where_something_is_compiled(tmp_path, compiles):
    @njit
    def one(x):
        return x + 1

    if not compiles:
        one(1.0)
    made = tmp_path / "made"
    with helped(f"open({str(made)!r}, 'w').close()") as wait:
        assert one(1.0) == 2.0
        wait()
    assert made.exists() == compiles


def test_help_that_fails_is_done_without():
    @njit
    def one(x):
        return x + 1

    with helped("raise SystemExit(1)") as wait:
        assert one(1.0) == 2.0
        wait()


@pytest.mark.slow
def test_a_process_that_forgoes_help_gets_none(tmp_path):
    made = tmp_path / "made"
    code = f"""
from numba import njit
from drillenv.compiling import forgo_help, helped
forgo_help()
@njit
def one(x):
    return x + 1
with helped("open({str(made)!r}, 'w').close()") as wait:
    one(1.0)
    wait()
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert not made.exists()


def test_what_a_helper_compiles_is_what_is_called():
    # other types than those of the calls would be compiled for nothing
    rig = gymnasium.make("drillenv/DrillHidden-v0")
    rig.reset(seed=1)
    rig.step(rig.action_space.sample())
    hybrid_plant.compile_drill()
    assert len(hybrid_plant.drill.signatures) == 1
    made = sensitivity.make_variation(MODEL, 1), make_scratch(MODEL)
    d = fresh_motion(MODEL).d
    windows = shooting.Windows(
        np.array([0, 10]), np.zeros((1, OWN)), np.zeros((1, 1, OWN)), 5e4, 0.0, 0.0, 0.0, shooting.UNCHAINED, 1, 2e-3
    )
    shot = shooting.Shot(*map(np.zeros, ((OWN, 0), (2, 10), (1, 2, 10), (1, OWN), (1, 1, OWN))))
    shooting.shoot(MODEL, d, 1e-7, windows, sensitivity.by_state(1), shot, *made)
    shooting.compile_derivatives()
    assert len(sensitivity.vary_step.signatures) == len(sensitivity.saltate.signatures) == 1
