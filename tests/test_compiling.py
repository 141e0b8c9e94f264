"""That a person at a terminal is told what the first half minute is for."""

import os
import pty
import subprocess
import sys

import pytest
from numba import njit

from drillenv.compiling import MESSAGE, helped

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
