"""Forces of the coupling's spring and damper by a model's curves, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drillenv.diagnosis.predict import DAMPER, F_B, GRID, MARGIN, SPRING, SPRING_FROM_REST, Axes, C, K
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import Model


def _at(axes: Axes, place: int, x: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Positions in a place's table, and the lower of the two points that each is between or beyond."""
    at = (np.arcsinh(x / axes.scale[place]) - axes.low[place]) / axes.step[place]
    at = np.clip(at, -MARGIN, GRID - 1.0 + MARGIN)
    return at, np.clip(at.astype(int), 0, GRID - 2)


def look(table: Floats, axes: Axes, place: int, x: Floats) -> Floats:
    """A place's table (GRID,) at arguments."""
    at, i = _at(axes, place, x)
    return table[i] + (at - i) * (table[i + 1] - table[i])


def slope(table: Floats, axes: Axes, place: int, x: Floats) -> Floats:
    """Its derivative by the argument."""
    at, i = _at(axes, place, x)
    inside = (at > -MARGIN) & (at < GRID - 1.0 + MARGIN)
    run = axes.step[place] * np.sqrt(x**2 + axes.scale[place] ** 2)
    return np.where(inside, (table[i + 1] - table[i]) / run, 0.0)


def spring_force(y: Floats, model: Model, axes: Axes) -> Floats:
    """Force in N of the coupling's spring at a shortening."""
    rest = model.s[F_B] / model.s[K]
    force = model.s[K] * y + look(model.tables[SPRING], axes, SPRING, y)
    return force + look(model.tables[SPRING_FROM_REST], axes, SPRING_FROM_REST, y - rest)


def stiffness_at(y: Floats, model: Model, axes: Axes) -> Floats:
    """Its derivative, not less than a tenth of k."""
    rest = model.s[F_B] / model.s[K]
    found = model.s[K] + slope(model.tables[SPRING], axes, SPRING, y)
    found = found + slope(model.tables[SPRING_FROM_REST], axes, SPRING_FROM_REST, y - rest)
    return np.maximum(found, 0.1 * model.s[K])


def damper_force(v: Floats, model: Model, axes: Axes) -> Floats:
    """Force in N of the coupling's damper at a closing speed."""
    return model.s[C] * v + look(model.tables[DAMPER], axes, DAMPER, v)


def damping_at(v: Floats, model: Model, axes: Axes) -> Floats:
    """Its derivative, not less than a tenth of c."""
    return np.maximum(model.s[C] + slope(model.tables[DAMPER], axes, DAMPER, v), 0.1 * model.s[C])


def _inverted(force: Floats, at: Floats, law, derivative) -> Floats:
    """Argument of a rising law at forces, by Newton's method from ``at``."""
    for _ in range(12):
        at = at - (law(at) - force) / derivative(at)
    return at


def shortening(force: Floats, model: Model, axes: Axes) -> Floats:
    """y in m at forces of the spring in N."""
    y = force / model.s[K]
    if not (np.any(model.tables[SPRING]) or np.any(model.tables[SPRING_FROM_REST])):
        return y
    return _inverted(force, y, lambda x: spring_force(x, model, axes), lambda x: stiffness_at(x, model, axes))


def closing_speed(force: Floats, model: Model, axes: Axes) -> Floats:
    """v1 - v2 in m/s at forces of the damper in N."""
    v = force / model.s[C]
    if not np.any(model.tables[DAMPER]):
        return v
    return _inverted(force, v, lambda x: damper_force(x, model, axes), lambda x: damping_at(x, model, axes))
