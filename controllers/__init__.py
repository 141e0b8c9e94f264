"""Controllers of the rig, one a file, behind one interface, chosen by name.

    controller = controllers.make("rules")
    controller.reset(seed=0)
    action = controller.act(observation, info)

Observation and action are those of the environments with ``actions="absolute"`` and ``observations="readings"``.
A controller need not live here: ``make("my_package.my_module:MyClass")`` imports any other, and a distribution may give
its own a name by an entry point, which ``make`` and the league then know:

    [project.entry-points."drillenv.controllers"]
    my-controller = "my_package.my_module:MyClass"
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module, metadata
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from drillenv.checks import InputError, shown

GROUP = "drillenv.controllers"
"""Entry points of this group are controllers of other distributions."""


class Controller(Protocol):
    """What every controller does."""

    sees_truth: bool
    """Whether ``act`` gets the truth in ``info``; all but the oracles get an empty one. Left out, it is False."""

    def reset(self, seed: int | None = None) -> None:
        """Get ready for a new episode; ``seed`` of everything random in it."""

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The action (3,) float32 after an observation (15,); only an oracle looks into ``info``.

        In holes they are (4,) and (20,).
        """
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
"""Where each controller of this package lives."""


def make(name: str, **settings: Any) -> Controller:
    """A controller.

    Args:
        name: Of NAMES, of :func:`installed`, or "package.module:Class".
        settings: What its class takes.

    Raises:
        InputError: no such controller, one that cannot be imported or made, or that has no ``reset`` or no ``act``.
    """
    if isinstance(name, str) and name in NAMES:
        module, kind = NAMES[name].split(":")
        return cast(Controller, getattr(import_module(module), kind)(**settings))
    found = _from_outside(name)
    try:
        made = found(**settings)
    except InputError:
        raise
    except Exception as error:  # whatever another's code raises
        raise InputError(f"controller {name} cannot be made ({_reason(error)}): mend its class") from error
    for method in ("reset", "act"):
        if not callable(getattr(made, method, None)):
            raise InputError(
                f"controller {name} has no {method}: give a class with reset(seed) and act(observation, info)"
            )
    return cast(Controller, made)


def sees_truth(controller: Controller) -> bool:
    """Whether a controller is to be handed the truth; one that does not say is not."""
    return bool(getattr(controller, "sees_truth", False))


def installed() -> Mapping[str, metadata.EntryPoint]:
    """The controllers that other distributions bring, by name; none of them is imported yet.

    Raises:
        InputError: two of one name, or the name of one of this package.
    """
    found: dict[str, metadata.EntryPoint] = {}
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda each: (_owner(each), each.name)):
        taken = "drillenv" if point.name in NAMES else _owner(found[point.name]) if point.name in found else None
        if taken is not None:
            raise InputError(
                f"{_owner(point)} brings a controller {point.name}, which {taken} has: rename or uninstall it"
            )
        found[point.name] = point
    return MappingProxyType(found)


def _owner(point: metadata.EntryPoint) -> str:
    """The distribution that an entry point belongs to."""
    return point.dist.name if point.dist else "an unnamed distribution"


def _from_outside(name: object) -> Callable[..., Any]:
    """What makes a controller that is not of this package."""
    points = installed()
    if isinstance(name, str) and name in points:
        where = f"controller {name} of {_owner(points[name])}, {points[name].value},"
        load = points[name].load
    elif isinstance(name, str) and all(name.partition(":")):
        where, load = f"controller {name}", partial(_named, name)
    else:
        known = ", ".join((*NAMES, *points))
        raise InputError(f"controller is {shown(name)}: give one of {known}, or package.module:Class")
    try:
        found = load()
    except Exception as error:  # whatever another's code raises as it is imported
        raise InputError(f"{where} cannot be imported ({_reason(error)}): mend it, or give another") from error
    if not callable(found):
        raise InputError(f"{where} is {shown(found)}: let it be a class with reset(seed) and act(observation, info)")
    return found


def _named(text: str) -> Any:
    """What "package.module:name" names."""
    module, _, name = text.partition(":")
    return attrgetter(name)(import_module(module))


def _reason(error: Exception) -> str:
    """What was raised, on one line of limited length."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:200]}" if text else type(error).__name__
