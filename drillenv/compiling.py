"""What happens the first time that a kernel is compiled: a line in a terminal, and a second process that helps.

Numba compiles one kernel at a time in a process, whatever the number of its threads.
"""

from __future__ import annotations

import contextlib
import functools
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

from numba import typeof
from numba.core import event

MESSAGE = "compiling for this machine, once, for up to half a minute ..."


class _FirstCompilation(event.Listener):
    """Does something once, at the first kernel that is not in Numba's cache."""

    def __init__(self, do: Callable[[], object]):
        self.do: Callable[[], object] | None = do

    def on_start(self, event: Any) -> None:
        """Do it."""
        do, self.do = self.do, None
        if do is not None:
            do()

    def on_end(self, event: Any) -> None:
        """Nothing more."""


@functools.cache
def announce() -> None:
    """From now on, say it where stderr is a terminal; once in a process."""
    if sys.stderr is not None and sys.stderr.isatty():
        event.register("numba:compile", _FirstCompilation(_say))


def _say() -> None:
    sys.stderr.write(f"drillenv: {MESSAGE}\n")
    sys.stderr.flush()


def compile_for(kernel: Any, *arguments: Any) -> None:
    """Compile a kernel for the types of these arguments, without running it."""
    kernel.compile(tuple(typeof(each) for each in arguments))


_alone: list[bool] = []


def forgo_help() -> None:
    """From now on this process starts no other."""
    _alone.append(True)


@contextlib.contextmanager
def helped(code: str) -> Iterator[Callable[[], object]]:
    """While this process compiles, another compiles what ``code`` needs, into the same cache.

    Args:
        code: Of Python, which another process runs as soon as this one compiles anything, and not at all if it does
            not. Whether it succeeds makes no difference but to time.

    Yields:
        To be called before this process needs the same kernels: it waits until the other is done.
    """
    started: list[subprocess.Popen[bytes]] = []

    def start() -> None:
        if _alone:
            return
        nowhere = subprocess.DEVNULL
        with contextlib.suppress(OSError):
            command = [sys.executable, "-c", code]
            started.append(subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere))

    listener = _FirstCompilation(start)
    event.register("numba:compile", listener)
    try:
        yield lambda: [each.wait() for each in started]
    finally:
        event.unregister("numba:compile", listener)
        for each in started:
            each.kill()
            each.wait()
