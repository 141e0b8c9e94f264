"""Says in a terminal that kernels are being compiled, the first time that one is."""

from __future__ import annotations

import functools
import sys
from typing import Any

from numba.core import event

MESSAGE = "compiling for this machine, once, for up to half a minute ..."


class _FirstCompilation(event.Listener):
    """Prints a line at the first kernel that is not in Numba's cache."""

    said = False

    def on_start(self, event: Any) -> None:
        """Say it."""
        if not self.said:
            self.said = True
            sys.stderr.write(f"drillenv: {MESSAGE}\n")
            sys.stderr.flush()

    def on_end(self, event: Any) -> None:
        """Nothing more."""


@functools.cache
def announce() -> None:
    """From now on, say it where stderr is a terminal; once in a process."""
    if sys.stderr is not None and sys.stderr.isatty():
        event.register("numba:compile", _FirstCompilation())
