"""Forces of the coupling's spring and damper by a model's curves, and back.

The coordinate of the coupling's spring in the fit is its force, for what recordings say of a window does not change
with the spring that is taken to have made it. A weak spring of the same stiffness in all models, relaxed at rest, is
added, so that a coordinate tells shortenings from each other where the coupling has play.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import GRID, MARGIN, Axes, interpolate, slope
from drillenv.diagnosis.terms import Model
from drillenv.dynamics.constitutive.places import DAMPER, SPRING, SPRING_FROM_REST
from drillenv.dynamics.hybrid.vector_field import F_B, C, K

ADDED = 2e4
"""N/m, of the spring that is added: a third of the coupling's or less."""
LEAST_SLOPE, LEAST_DAMPING = 0.5, 0.1
"""Least slopes that are taken of the spring's law, over ADDED, and of the damper's, over c."""
PRECISION, ITERATIONS = 1e-8, 60
"""N to which laws are inverted, and steps by which they are at most."""


def from_rest(y: Floats, model: Model) -> Floats:
    """Shortening in m beyond that at rest."""
    return y - model.s[F_B] / model.s[K]


def spring_coordinate(y: Floats, model: Model, axes: Axes) -> Floats:
    """Force in N of the coupling's spring at a shortening, with that of the added spring."""
    beyond = from_rest(y, model)
    force = model.s[K] * y + ADDED * beyond + interpolate(model.curve(SPRING), axes, SPRING, y)
    return force + interpolate(model.curve(SPRING_FROM_REST), axes, SPRING_FROM_REST, beyond)


def spring_slope(y: Floats, model: Model, axes: Axes) -> Floats:
    """Its derivative, not less than half of the added stiffness."""
    found = model.s[K] + slope(model.curve(SPRING), axes, SPRING, y)
    return np.maximum(found + slope_from_rest(y, model, axes), LEAST_SLOPE * ADDED)


def slope_from_rest(y: Floats, model: Model, axes: Axes) -> Floats:
    """Derivative of the curve over the shortening beyond that at rest, with the added stiffness."""
    return ADDED + slope(model.curve(SPRING_FROM_REST), axes, SPRING_FROM_REST, from_rest(y, model))


def damper_force(v: Floats, model: Model, axes: Axes) -> Floats:
    """Force in N of the coupling's damper at a closing speed."""
    return model.s[C] * v + interpolate(model.curve(DAMPER), axes, DAMPER, v)


def damping_at(v: Floats, model: Model, axes: Axes) -> Floats:
    """Its derivative, not less than a tenth of c."""
    return np.maximum(model.s[C] + slope(model.curve(DAMPER), axes, DAMPER, v), LEAST_DAMPING * model.s[C])


def is_invertible(model: Model, axes: Axes) -> bool:
    """Whether forces of spring and damper rise with their arguments where free laws of theirs are drawn.

    Else several shortenings have one force, and windows may begin at any of them. Equations are not asked: their axes
    are longer than what motions visit.
    """
    if not model.free[[SPRING, SPRING_FROM_REST, DAMPER]].any():
        return True
    y, v = axes.points(SPRING), axes.points(DAMPER)
    of_spring = (model.s[K] + ADDED) * y + model.free[SPRING]
    of_spring += interpolate(model.free[SPRING_FROM_REST], axes, SPRING_FROM_REST, from_rest(y, model))
    of_damper = model.s[C] * v + model.free[DAMPER]
    return bool(np.all(np.diff(of_spring) > 0.0) and np.all(np.diff(of_damper) > 0.0))


@njit(cache=True, nogil=True)
def _law_at(curve, axis, x):
    """Value and derivative of a law (GRID,) at x on its axis (scale, low, step): as ``interpolate`` and ``slope``."""
    scale, low, step = axis
    at = (math.asinh(x / scale) - low) / step
    inside = -MARGIN < at < GRID - 1.0 + MARGIN
    at = min(max(at, -MARGIN), GRID - 1.0 + MARGIN)
    i = min(max(int(at), 0), GRID - 2)
    rise = curve[i + 1] - curve[i]
    return curve[i] + (at - i) * rise, rise / (step * math.hypot(x, scale)) if inside else 0.0


@njit(cache=True, nogil=True)
def _inverted(force, factor, added, rest, curve, axis, curve_from_rest, axis_from_rest, least, at):
    """Arguments ``at`` (n,) of a rising law at forces (n,) in N, by Newton's method and by bisection where it fails.

    The law is factor x + added (x - rest) with a curve over x and another over x - rest; its slope is taken as
    ``least`` or more. The slope of a law with play changes by several times at the ends of it, between which Newton's
    method may go to and fro.
    """
    for k in range(at.size):
        x, low, high = at[k], -np.inf, np.inf
        for _ in range(ITERATIONS):
            one, by_one = _law_at(curve, axis, x)
            other, by_other = _law_at(curve_from_rest, axis_from_rest, x - rest)
            off = factor * x + added * (x - rest) + one + other - force[k]
            if not abs(off) > PRECISION:
                break
            if off < 0.0:
                low = x
            else:
                high = x
            x -= off / max(factor + added + by_one + by_other, least)
            if low > -np.inf and high < np.inf and not low < x < high:
                x = 0.5 * (low + high)
        at[k] = x


def _axis(axes: Axes, place: int) -> tuple[float, float, float]:
    return float(axes.scale[place]), float(axes.low[place]), float(axes.step[place])


def shortening(coordinate: Floats, model: Model, axes: Axes) -> Floats:
    """y in m at coordinates of the spring in N."""
    y = (coordinate + ADDED * model.s[F_B] / model.s[K]) / (model.s[K] + ADDED)
    if not (model.bends(SPRING) or model.bends(SPRING_FROM_REST)):
        return y
    k, rest = float(model.s[K]), float(model.s[F_B] / model.s[K])
    over = model.curve(SPRING), _axis(axes, SPRING)
    over_rest = model.curve(SPRING_FROM_REST), _axis(axes, SPRING_FROM_REST)
    _inverted(np.ascontiguousarray(coordinate), k, ADDED, rest, *over, *over_rest, LEAST_SLOPE * ADDED, y)
    return y


def closing_speed(force: Floats, model: Model, axes: Axes) -> Floats:
    """v1 - v2 in m/s at forces of the damper in N."""
    v = force / model.s[C]
    if not model.bends(DAMPER):
        return v
    c, over = float(model.s[C]), (model.curve(DAMPER), _axis(axes, DAMPER))
    _inverted(np.ascontiguousarray(force), c, 0.0, 0.0, *over, np.zeros(GRID), (1.0, 0.0, 1.0), LEAST_DAMPING * c, v)
    return v
