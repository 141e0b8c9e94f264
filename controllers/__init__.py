"""Controllers of the rig, one a file, behind one interface, chosen by name.

    controller = controllers.make("rules")
    controller.reset(seed=0)
    action = controller.act(observation, info)

Observation and action are those of the environments with ``actions="absolute"`` and ``observations="readings"``.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from types import MappingProxyType
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from drillenv.checks import choice


class Controller(Protocol):
    """What every controller does."""

    sees_truth: bool
    """Whether ``act`` gets the truth in ``info``; all but the oracles get an empty one."""

    def reset(self, seed: int | None = None) -> None:
        """Get ready for a new episode; ``seed`` of everything random in it."""

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The action (3,) float32 after an observation (15,); only an oracle looks into ``info``."""
        ...


@runtime_checkable
class OnPlant(Protocol):
    """What an oracle does that plans on the true plant."""

    def attach(self, state: Callable[[], Any]) -> None:
        """Take the plant of the coming episodes; ``state`` gives its present one, see ``DrillEnv.get_state``."""


NAMES = MappingProxyType(
    {
        "random": "drillenv.controllers.fixed:Random",
        "fixed": "drillenv.controllers.fixed:Fixed",
        "rules": "drillenv.controllers.rules:Rules",
        "scheduled": "drillenv.controllers.scheduled:Scheduled",
        "seeking": "drillenv.controllers.seeking:Seeking",
        "mpc": "drillenv.controllers.mpc:Mpc",
        "steady-oracle": "drillenv.controllers.steady:SteadyOracle",
        "oracle": "drillenv.controllers.mpc:Oracle",
        "learned": "drillenv.controllers.learned:Learned",
    }
)
"""Where each controller lives."""


def make(name: str, **settings: Any) -> Controller:
    """A controller by its name.

    Raises:
        InputError: no such controller, or settings that it does not take.
    """
    module, kind = NAMES[choice("controller", name, tuple(NAMES))].split(":")
    return cast(Controller, getattr(import_module(module), kind)(**settings))
