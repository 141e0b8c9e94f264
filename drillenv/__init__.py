"""drillenv: a percussive-drilling rig to simulate, control and diagnose.

    import drillenv

    setting = drillenv.Setting(frequency=120, amplitude=0.45, pressure=1.0)  # Hz, V, bar
    run = drillenv.simulate(setting, rock=4, seconds=2.0)
    motion = drillenv.motion(setting, rock=4)  # motion.label is "P-1-I-1"

    import gymnasium as gym

    env = gym.make("drillenv/DrillLayers-v0")

The environments are registered on import. The names below are imported where they are first used, so that ``import
drillenv`` costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from drillenv.env.registration import register_environments

if TYPE_CHECKING:
    from drillenv import atlas as atlas
    from drillenv import controllers as controllers
    from drillenv.atlas import boundary as boundary
    from drillenv.atlas import load_atlas as load_atlas
    from drillenv.atlas import sweep as sweep
    from drillenv.checks import InputError as InputError
    from drillenv.diagnosis.report import Report as Report
    from drillenv.diagnosis.report import diagnose as diagnose
    from drillenv.dynamics.motion import Motion as Motion
    from drillenv.dynamics.motion import motion as motion
    from drillenv.dynamics.motion import motions as motions
    from drillenv.dynamics.simulate import Run as Run
    from drillenv.dynamics.simulate import simulate as simulate
    from drillenv.indentation import fit_indentation as fit_indentation
    from drillenv.rig import Rig as Rig
    from drillenv.rig import Setting as Setting
    from drillenv.rig import groups as groups
    from drillenv.rock_file import read_rock as read_rock
    from drillenv.rocks import ROCKS as ROCKS
    from drillenv.rocks import Rock as Rock
    from drillenv.rocks import rock as rock

    __version__: str

__all__ = [
    "ROCKS",
    "InputError",
    "Motion",
    "Report",
    "Rig",
    "Rock",
    "Run",
    "Setting",
    "__version__",
    "atlas",
    "boundary",
    "controllers",
    "diagnose",
    "fit_indentation",
    "groups",
    "load_atlas",
    "motion",
    "motions",
    "read_rock",
    "rock",
    "simulate",
    "sweep",
]

_HOME = {
    "ROCKS": "rocks",
    "InputError": "checks",
    "Motion": "dynamics.motion",
    "Report": "diagnosis.report",
    "Rig": "rig",
    "Rock": "rocks",
    "Run": "dynamics.simulate",
    "Setting": "rig",
    "boundary": "atlas",
    "diagnose": "diagnosis.report",
    "fit_indentation": "indentation",
    "groups": "rig",
    "load_atlas": "atlas",
    "motion": "dynamics.motion",
    "motions": "dynamics.motion",
    "read_rock": "rock_file",
    "rock": "rocks",
    "simulate": "dynamics.simulate",
    "sweep": "atlas",
}

_ROOMS = ("atlas", "controllers")

register_environments()


def __getattr__(name: str) -> object:
    """Import a public name where it is first used (PEP 562)."""
    if name == "__version__":
        value = _version()
    elif name in _ROOMS:
        # atlas is the room itself, in which drillenv.atlas.atlas draws the map: one name cannot be both
        value = import_module(f"drillenv.{name}")
    elif name in _HOME:
        value = getattr(import_module(f"drillenv.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _version() -> str:
    """The version installed; of a folder that is not installed, none is known."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("drillenv")
    except PackageNotFoundError:
        return "unknown"
