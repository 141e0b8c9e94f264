"""What a single body may conceal: the catalogue of :mod:`drillenv.blind.body`."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import NamedTuple

from drillenv.blind.laws import BACKLASH, DAMPER, DRY, LIMIT, SPRING, VISCOUS
from drillenv.blind.mechanisms import Concealed, Draw, Equation, Mechanism

TRAVEL = 0.01
"""m, of a body to either side."""

POSITION, SPEED, FORCE = "position", "speed", "force"
OVER = {SPRING: POSITION, BACKLASH: POSITION, DAMPER: SPEED, VISCOUS: SPEED, DRY: SPEED, LIMIT: FORCE}
"""By place, what a law is over."""
SATURATING_SPRING = 5
"""Among the limits, the law that is over the position."""


def _grows(name: str, low: float, high: float, **others: tuple[float, float]) -> Draw:
    """A strength in proportion to the share, and numbers of its shape; scaled to the body in ``scaled``."""

    def draw(rng, share, site):
        found = {name: share * float(rng.uniform(low, high))}
        return found | {each: float(rng.uniform(*limits)) for each, limits in others.items()}

    return draw


# Strengths are shares of the typical force F at the typical speed V or the travel X; scaled makes them SI.
_LISTED = (
    Mechanism(
        "viscous-damping",
        (
            Equation("linear", _grows("d", 0.05, 0.15), VISCOUS, 1, of_library=True),
            Equation("thinning lubricant", _grows("d", 0.05, 0.15, n=(0.55, 0.8), v_0=(0.02, 0.05)), VISCOUS, 2),
            Equation("Eyring", _grows("d", 0.08, 0.25, v_e=(0.15, 0.4)), VISCOUS, 3),
        ),
    ),
    Mechanism(
        "dry-friction",
        (
            Equation("Coulomb", _grows("fc", 0.03, 0.1), DRY, 2, of_library=True),
            Equation("Stribeck", _grows("f_c", 0.03, 0.08, ratio=(1.3, 1.8), v_s=(0.05, 0.2)), DRY, 3),
            Equation("LuGre", _grows("f_c", 0.03, 0.08, ratio=(1.3, 1.8), v_s=(0.05, 0.2), bend=(1e-3, 4e-3)), DRY, 5),
        ),
    ),
    Mechanism(
        "stiffness-hardening",
        (
            Equation("cubic", _grows("k3", 0.05, 0.2), SPRING, 1, of_library=True),
            Equation("fifth power", _grows("k_5", 0.08, 0.3), SPRING, 2),
            Equation("softening", _grows("k_3", -0.05, -0.02), SPRING, 3),
            Equation("two lines", _grows("k_b", 0.3, 0.8, s_b=(0.1, 0.5)), SPRING, 4),
        ),
    ),
    Mechanism(
        "force-limit",
        (
            Equation("clipped", _grows("F_max", 0.2, 0.45), LIMIT, 1, of_library=True),
            Equation("bent over", _grows("F_s", 0.5, 0.9), LIMIT, 2),
            Equation("saturating spring", _grows("w", 0.5, 1.2), LIMIT, SATURATING_SPRING),
        ),
    ),
    Mechanism(
        "damping-quadratic",
        (
            Equation("quadratic", _grows("c2", 0.05, 0.15), DAMPER, 1, of_library=True),
            Equation("power 1.5", _grows("c_p", 0.06, 0.2), DAMPER, 2),
            Equation("one way", _grows("c_in", 0.05, 0.15), DAMPER, 3),
        ),
    ),
    Mechanism(
        "backlash",
        (
            Equation("dead band", _grows("g", 0.06, 0.2, y0=(-0.2, 0.0)), BACKLASH, 1, of_library=True),
            Equation("rounded ends", _grows("g", 0.06, 0.2, y0=(-0.2, 0.0), w=(0.005, 0.02)), BACKLASH, 2),
            Equation("worn bush", _grows("g", 0.1, 0.3, y0=(-0.2, 0.0), r=(0.2, 0.6)), BACKLASH, 3),
        ),
    ),
)
BODY_MECHANISMS = MappingProxyType({each.name: each for each in _LISTED})
"""What a single body may conceal, by name."""
ON_AXIS = ("viscous-damping", "dry-friction")
"""Those that are concealed on an axis; the others want a spring."""


def acts_over(name: str, index: int) -> str:
    """What an equation of a mechanism is over: the position, the speed, or the force that is asked for."""
    equation = BODY_MECHANISMS[name].equations[index]
    assert equation.place is not None
    return POSITION if (equation.place, equation.code) == (LIMIT, SATURATING_SPRING) else OVER[equation.place]


class Scale(NamedTuple):
    """What is typical of a body, in SI."""

    force: float
    speed: float
    stiffness: float
    drive: float
    """N, the largest force asked of the actuator."""


def scaled(each: Concealed, share: float, scale: Scale, mass: float) -> Concealed:
    """The parameters in SI, in the order of the equation's law."""
    p, f, v, x = dict(each.parameters), scale.force, scale.speed, TRAVEL
    code, place = each.equation.code, each.equation.place
    if place == VISCOUS:
        made = {"d": p["d"] * f / v}
        if code == 2:
            made = {"d": p["d"] * f / v ** p["n"], "n": p["n"], "v_0": p["v_0"] * v}
        elif code == 3:
            made["v_e"] = p["v_e"] * v
    elif place == DRY and code == 2:
        made = {"fc": p["fc"] * f, "v_0": 3e-4 * v}
    elif place == DRY:
        made = {"f_c": p["f_c"] * f, "f_s": p["ratio"] * p["f_c"] * f, "v_s": p["v_s"] * v, "v_0": 1e-3 * v}
        if code == 5:
            stiff = p["f_c"] * f / (p["bend"] * x)
            made |= {"v_0": stiff, "sigma_1": 0.1 * math.sqrt(stiff * mass)}
    elif place == SPRING:
        power = {1: 3, 2: 5, 3: 3}.get(code)
        name = next(iter(p))
        made = (
            {"k_b": p["k_b"] * scale.stiffness, "s_b": p["s_b"] * x}
            if power is None
            else {name: p[name] * f / x**power}
        )
    elif place == LIMIT and code == SATURATING_SPRING:
        made = {"s_0": 0.0, "w": p["w"] * x / share**1.5, "k": scale.stiffness}
    elif place == LIMIT:
        name = next(iter(p))
        made = {name: (1.0 - p[name]) * scale.drive if code == 1 else scale.drive * p[name] / share**1.5}
    elif place == DAMPER:
        name = next(iter(p))
        made = {name: p[name] * f / v ** {1: 2.0, 2: 1.5, 3: 1.0}[code]}
    else:
        made = {symbol: value if symbol == "r" else value * x for symbol, value in p.items()}
    return each._replace(parameters=MappingProxyType(made))
