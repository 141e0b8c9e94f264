"""What an effect says beside free laws: curves at places, and numbers of the model.

An effect states its laws once, for the engine. To compare them with free laws, and to show them, the contact's become
factors on the stiffness over ``w = R / k_l``, R the force of the rock law, and dry friction that grips is rounded over
a speed that is nothing beside those of the rig.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from drillenv.diagnosis.solver import Floats
from drillenv.dynamics.constitutive.places import (
    CODE,
    COMPACTION,
    GUIDE,
    INDENTER,
    PLACES,
    STATE_SCALARS,
    UNLOADING,
    Shape,
    shape_of,
)
from drillenv.dynamics.effects import REGISTRY
from drillenv.dynamics.forms import Form

GRIPS = {
    "shaker_grip": (GUIDE, 2e-5),
    "indenter_grip": (INDENTER, 5e-4),
    "shaker_sliding": (GUIDE, 2e-5),
    "indenter_sliding": (INDENTER, 5e-4),
}
"""Where dry friction acts as a curve, and over how many m/s it is taken to set in."""
BRISTLES = {"shaker_bristles": GUIDE, "indenter_bristles": INDENTER}
"""Where dry friction gives before it slides: a law there is over the speed either way."""
OF_FRICTION = frozenset({*GRIPS, *BRISTLES, "shaker_bristle_damping", "indenter_bristle_damping"})
"""Numbers of the model that belong to a curve."""
FINE = 400
"""Depths at which a contact's law is inverted."""


class Around(NamedTuple):
    """The rig that a law acts in, SI."""

    k: float
    kl: float
    ku: float
    per_impact: float = 0.0
    """m, about what an impact drills."""


def parameters_of(effect: str, form: Form, values: tuple[float, ...]) -> tuple[float, ...]:
    """All of an effect's, by their order; those that the form has not are neutral."""
    given = dict(zip(form.symbols, values, strict=True))
    return tuple(given.get(each.symbol, each.neutral) for each in REGISTRY[effect].parameters)


def scalars_of(effect: str, p: tuple[float, ...]) -> dict[str, float]:
    """The numbers of the model that an effect sets, by the names of ``places.SCALARS``, 0 left out."""
    scalars = REGISTRY[effect].scalars
    return {name: value for name, value in scalars(p).items() if value != 0.0} if scalars is not None else {}


def curve_at(effect: str, p: tuple[float, ...], place: int, x: Floats, around: Around) -> Floats:
    """(n,) what an effect adds at a place over arguments x (n,); at the contact a factor on the stiffness."""
    law, numbers = REGISTRY[effect].laws.get(PLACES[place].name), scalars_of(effect, p)
    curve = np.ones_like(x) if place <= UNLOADING else np.zeros_like(x)
    if isinstance(law, Shape):
        curve = _factor(law, p, around, place == UNLOADING, x)
    elif law is not None:
        length = numbers.get("compaction_length", 0.0) if place == COMPACTION else 0.0
        curve = law(x * around.per_impact / length if length > 0.0 else x, p, around.k)
    for name, value in numbers.items():
        if name in GRIPS and GRIPS[name][0] == place:
            way = np.tanh(x / GRIPS[name][1])
            given = any(BRISTLES.get(other) == place for other in numbers)
            curve = (curve * way if given else curve) + value * way
    return curve


def _factor(shape: Shape, p: tuple[float, ...], around: Around, unloading: bool, w: Floats) -> Floats:
    """Factor on the stiffness over w = R / k_l: the slope of the shape where the force is R."""
    stiff = around.ku if unloading else around.kl
    scale = {"depth": 1.0, "loading depth": stiff / around.kl, "force": stiff}[shape.over]
    goal = np.maximum(w, 0.0) * scale * around.kl / stiff
    reach = np.concatenate([[0.0], np.geomspace(1e-9, 1e3, FINE) * max(float(goal.max()), 1e-12)])

    def slope() -> Floats:
        return (shape.law(at * 1.0001, p, around.k) - shape.law(at * 0.9999, p, around.k)) / (at * 2e-4)

    # a fit may try parameters that no law has; its next step is then a shorter one
    with np.errstate(over="ignore", invalid="ignore"):
        at = np.maximum(np.interp(goal, shape.law(reach, p, around.k), reach), 1e-7 * reach[-1] * 1e-3)
        for _ in range(3):
            at = np.maximum(at - (shape.law(at, p, around.k) - goal) / np.maximum(slope(), 1e-9), 0.5 * at)
        return slope()


@functools.cache
def grips_of(effect: str, form: Form) -> frozenset[str]:
    """The dry friction that an equation sets, of ``GRIPS``."""
    return frozenset(scalars_of(effect, parameters_of(effect, form, form.starts[0]))) & frozenset(GRIPS)


@functools.cache
def acts_at(effect: str, form: Form) -> tuple[frozenset[int], frozenset[str]]:
    """The places at which an equation has a curve, and the numbers of the model that it sets."""
    p = parameters_of(effect, form, form.starts[0])
    places = set()
    for name, law in REGISTRY[effect].laws.items():
        place = PLACES[CODE[name]]
        x = np.linspace(place.low, place.high, 1001)
        shape = isinstance(law, Shape)
        values = shape_of(law).law(x, p, 7e4)
        if not np.array_equal(values, x if shape else np.zeros_like(x)):
            places.add(CODE[name])
    scalars = scalars_of(effect, p)
    places |= {GRIPS[name][0] for name in scalars if name in GRIPS}
    return frozenset(places), frozenset(name for name in scalars if name not in OF_FRICTION)


def has_states(effect: str, p: tuple[float, ...]) -> bool:
    """Whether an effect with these parameters gives the model states of its own."""
    return not STATE_SCALARS.isdisjoint(scalars_of(effect, p))
