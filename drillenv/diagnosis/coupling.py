"""Forces of the coupling's spring and damper by a model's curves, and back.

The coordinate of the coupling's spring in the fit is its force, for what recordings say of a window does not change
with the spring that is taken to have made it. A weak spring of the same stiffness in all models, relaxed at rest, is
added, so that a coordinate tells shortenings from each other where the coupling has play.
"""

from __future__ import annotations

import numpy as np

from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes, interpolate, slope
from drillenv.diagnosis.terms import Model
from drillenv.dynamics.constitutive.places import DAMPER, SPRING, SPRING_FROM_REST
from drillenv.dynamics.hybrid.vector_field import F_B, C, K

ADDED = 2e4
"""N/m, of the spring that is added: a third of the coupling's or less."""


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
    return np.maximum(found + slope_from_rest(y, model, axes), 0.5 * ADDED)


def slope_from_rest(y: Floats, model: Model, axes: Axes) -> Floats:
    """Derivative of the curve over the shortening beyond that at rest, with the added stiffness."""
    return ADDED + slope(model.curve(SPRING_FROM_REST), axes, SPRING_FROM_REST, from_rest(y, model))


def damper_force(v: Floats, model: Model, axes: Axes) -> Floats:
    """Force in N of the coupling's damper at a closing speed."""
    return model.s[C] * v + interpolate(model.curve(DAMPER), axes, DAMPER, v)


def damping_at(v: Floats, model: Model, axes: Axes) -> Floats:
    """Its derivative, not less than a tenth of c."""
    return np.maximum(model.s[C] + slope(model.curve(DAMPER), axes, DAMPER, v), 0.1 * model.s[C])


def _inverted(force: Floats, at: Floats, law, derivative) -> Floats:
    """Argument of a rising law at forces in N, by Newton's method from ``at``, and by bisection where it fails.

    The slope of a law with play changes by several times at the ends of it, between which Newton's method may go to
    and fro.
    """
    low, high = np.full(at.shape, -np.inf), np.full(at.shape, np.inf)
    for _ in range(40):
        off = law(at) - force
        if np.max(np.abs(off), initial=0.0) < 1e-8:
            break
        low, high = np.where(off < 0.0, at, low), np.where(off > 0.0, at, high)
        step = at - off / derivative(at)
        outside = np.isfinite(low) & np.isfinite(high) & ((step <= low) | (step >= high))
        at = np.where(outside, 0.5 * (np.where(outside, low, 0.0) + np.where(outside, high, 0.0)), step)
    return at


def shortening(coordinate: Floats, model: Model, axes: Axes) -> Floats:
    """y in m at coordinates of the spring in N."""
    y = (coordinate + ADDED * model.s[F_B] / model.s[K]) / (model.s[K] + ADDED)
    if not (model.bends(SPRING) or model.bends(SPRING_FROM_REST)):
        return y
    law, derivative = (lambda x: spring_coordinate(x, model, axes)), (lambda x: spring_slope(x, model, axes))
    return _inverted(coordinate, y, law, derivative)


def closing_speed(force: Floats, model: Model, axes: Axes) -> Floats:
    """v1 - v2 in m/s at forces of the damper in N."""
    v = force / model.s[C]
    if not model.bends(DAMPER):
        return v
    return _inverted(force, v, lambda x: damper_force(x, model, axes), lambda x: damping_at(x, model, axes))
