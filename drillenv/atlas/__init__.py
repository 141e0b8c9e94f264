"""Maps over settings: sweeps, the boundaries on them, and the atlas of P-1-I-1."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

# Not left for later like the atlas: the functions must take the places of the modules of the same name.
from drillenv.atlas.boundary import Boundary, boundaries, boundary
from drillenv.atlas.sweep import Sweep, sweep

if TYPE_CHECKING:
    from drillenv.atlas.p11 import atlas, load_atlas

__all__ = ["Boundary", "Sweep", "atlas", "boundaries", "boundary", "load_atlas", "sweep"]


def __getattr__(name: str) -> Any:
    if name in ("atlas", "load_atlas"):
        return getattr(import_module("drillenv.atlas.p11"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
