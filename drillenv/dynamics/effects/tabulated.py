"""Laws that were measured, where no textbook equation follows them: one effect for each place in which one may act."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from drillenv.dynamics.constitutive.curves import Curve, table_along, table_around, table_of_tangents
from drillenv.dynamics.constitutive.places import CODE, PLACES
from drillenv.dynamics.constitutive.tables import Table
from drillenv.dynamics.effects import EVERYWHERE, IN_CONTACT, Axes, Effect, Extra

TURN = 2.0 * math.pi


HARDEST = 1e6
"""N, up to which force a contact is tabulated; beyond it goes on straight."""


# --- What a curve may be


def _tangents(curve: Curve) -> Table:
    if curve.x[0] < 0.0:
        raise ValueError("its forces begin below 0, and the rock never pulls")
    _must_be_held(curve)
    return table_of_tangents(curve, HARDEST)


def _impacts(curve: Curve) -> Table:
    if curve.x[0] < 0.0:
        raise ValueError("its impacts begin below 0")
    _must_be_held(curve)
    return _Along("compaction")(curve)


def _must_be_held(curve: Curve) -> None:
    if curve.beyond != "held":
        raise ValueError("going on straight it would leave a rock without stiffness, so it has to be held")


def _phases(curve: Curve) -> Table:
    if curve.beyond != "held":
        raise ValueError("a curve that repeats has nothing beyond it, so leave beyond out")
    return table_around(curve, TURN)


@dataclass(frozen=True)
class _Along:
    """A curve over the range of a place."""

    place: str

    def __call__(self, curve: Curve) -> Table:
        there = PLACES[CODE[self.place]]
        return table_along(curve, min(there.low, curve.x[0]), max(there.high, curve.x[-1]))


def _last_impacts(values: tuple[float, ...]) -> float:
    # arguments, then as many values
    return values[len(values) // 2 - 1]


SOURCE = (
    "constitutive, as measured; between its knots F. N. Fritsch and R. E. Carlson, Monotone piecewise cubic "
    "interpolation, SIAM Journal on Numerical Analysis 17 (1980) 238-246, doi:10.1137/0717021"
)


_TANGENT = ("force of the rock", "N", "factor on the rock's stiffness at that force", "1")
"""What a contact's curve is over and what it gives; at other places these are the place's own words."""


def _effect(
    place: str, sentence: str, equation: str, balance, energy, table: Callable[[Curve], Table] | None = None, **more
) -> Effect:
    """The effect of a place."""
    there, contact = PLACES[CODE[place]], place in ("loading", "unloading")
    quantity = _TANGENT if contact else (there.argument, there.argument_unit, there.quantity, there.unit)
    bounds = {"loading": (1.0, 1e-3, 1e3), "unloading": (1.0, 1e-3, 1e3), "compaction": (0.0, -0.99, 1e3)}
    return Effect(
        name=f"tabulated-{place}",
        sentence=sentence,
        equation=equation,
        source=SOURCE,
        parameters=(),
        balances=(balance,),
        regimes=IN_CONTACT if balance == "contact" else EVERYWHERE,
        energy=energy,
        axes=Axes(
            *quantity,
            CODE[place],
            table or _Along(place),
            "force" if contact else "depth",
            *bounds.get(place, ()),
        ),
        **more,
    )


EFFECTS = (
    _effect(
        "loading",
        "The rock's stiffness goes with the force on the way in, as measured.",
        "dR/d(X2 - Xp) = k_l f(R), loading",
        "contact",
        "none",
        _tangents,
    ),
    _effect(
        "unloading",
        "The rock's stiffness goes with the force on the way out, as measured.",
        "dR/d(X2 - Xf) = k_u f(R), unloading",
        "contact",
        "none",
        _tangents,
    ),
    _effect(
        "rate-factor",
        "The rock's force goes with the speed of the impact, in proportion to the force, as measured.",
        "R = R_law (1 + f(V)), V the speed into the rock, R never below 0",
        "contact",
        "moves",
    ),
    _effect(
        "rate-force",
        "The rock's force goes with the speed of the impact, as measured.",
        "R = R_law + f(V), V the speed into the rock, R never below 0",
        "contact",
        "moves",
    ),
    _effect(
        "compaction",
        "The rock's stiffness changes over the first impacts on a fresh face, as measured.",
        "k_l and k_u times 1 + f(N), N the impacts on this face before the contact began",
        "contact",
        "none",
        _impacts,
        counted=_last_impacts,
        extras=(
            Extra("N", "impacts since the face was fresh", "1", 1.0, kept="N"),
            Extra("N_contact", "N where the latest contact began", "1", 1.0, kept="N_contact"),
        ),
    ),
    _effect(
        "spring",
        "The spring between shaker and indenter has a force beyond the straight one, as measured.",
        "coupling force + f(X1 - X2)",
        "indenter",
        "stores",
    ),
    _effect(
        "spring-from-rest",
        "The spring between shaker and indenter has a force beyond the straight one, counted from rest, as measured.",
        "coupling force + f(X1 - X2 - F_b / k)",
        "indenter",
        "stores",
    ),
    _effect(
        "damper",
        "The damper between shaker and indenter has a force beyond the straight one, as measured.",
        "coupling force + f(X1' - X2')",
        "indenter",
        "moves",
    ),
    _effect(
        "guide",
        "The guides hold the shaker body back by a force that goes with its speed, as measured.",
        "force -f(X1') on the shaker body",
        "shaker",
        "moves",
    ),
    _effect(
        "indenter",
        "The indenter is held back by a force that goes with its speed, as measured.",
        "force -f(X2') on the indenter",
        "indenter",
        "moves",
    ),
    _effect(
        "drive-waveform",
        "The drive's force over a turn of the excitation is no sine, as measured.",
        "drive force + F_a f(theta), of period 2 pi",
        "indenter",
        "moves",
        _phases,
    ),
    _effect(
        "drive-curve",
        "The drive gives another force than is asked of it, as measured.",
        "drive force + f(F_a sin(theta))",
        "indenter",
        "moves",
    ),
)
