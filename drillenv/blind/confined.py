"""The process in which one diagnosis runs: it sees the campaign, and nothing of the trial.

    python -m drillenv.blind.confined CAMPAIGN OUT TRIAL SECONDS

runs ``drillenv diagnose CAMPAIGN --out OUT --within S``, S the greater part of SECONDS, under an audit hook (PEP 578)
that ends the process with the exit code ``PEEKED`` where it opens, lists or links anything under TRIAL, imports a
module of this room, starts a process or opens a connection. SECONDS bounds its processor time. What native code opens
without Python's knowledge the hook does not see; the reports can be made again from the seed by anyone who doubts them.
"""

from __future__ import annotations

import os
import platform
import resource
import sys

PEEKED = 97
SEARCH = 0.8
"""Share of the time for the search; what it has found by then is held against recordings held out."""

_PATHS = frozenset(
    (
        "open",
        "os.listdir",
        "os.scandir",
        "os.chdir",
        "os.link",
        "os.symlink",
        "os.rename",
        "os.truncate",
        "shutil.copyfile",
    )
)
_PROCESSES = ("subprocess.", "os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "socket.connect")


def forbid(trial: str) -> None:
    """From now on end this process where it looks into ``trial``, starts another or connects to anything."""
    root = os.path.realpath(trial)
    platform.processor()  # asks another process, once; libraries want to know later

    def watch(event: str, arguments: tuple) -> None:
        if event in _PATHS:
            for each in arguments[:2]:
                if isinstance(each, str | bytes | os.PathLike) and _inside(os.fsdecode(each), root):
                    _caught(f"{event} {os.fsdecode(each)}")
        elif event == "import":
            if str(arguments[0]).startswith("drillenv.blind"):
                _caught(f"import {arguments[0]}")
        elif event.startswith(_PROCESSES):
            _caught(event)

    sys.addaudithook(watch)


def _inside(path: str, root: str) -> bool:
    real = os.path.realpath(path)
    return real == root or real.startswith(root + os.sep)


def _caught(what: str) -> None:
    os.write(2, f"peeked: {what}\n".encode())
    os._exit(PEEKED)


def main(arguments: list[str]) -> int:
    """Run the command on one campaign."""
    campaign, out, trial, seconds = arguments
    limit = max(1, round(float(seconds)))
    # the soft limit's signal ends the process; its exit code then says so
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    forbid(trial)
    from drillenv.cli import main as command
    from drillenv.compiling import forgo_help

    forgo_help()
    return command(["diagnose", campaign, "--out", out, "--within", f"{SEARCH * limit:g}"])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
