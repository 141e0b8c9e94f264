"""Laws of a model as values over their arguments, and as the pieces that the engine takes.

Each place has an axis: points at equal distances of asinh(x / scale), from the lowest to the highest argument that
motions visit. What a free law is made of, what is fitted to it and what is shown of it stands on these points. Of the
contact, a law is the logarithm of a factor on the stiffness, over w = R / k_l with R the force of the rock law: so one
and the same law can be had while loading and while unloading.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.diagnosis.solver import Floats
from drillenv.dynamics.constitutive.places import PLACES as ALL_PLACES
from drillenv.dynamics.constitutive.places import UNLOADING
from drillenv.dynamics.constitutive.tables import DEGREE, NotSmoothError, Table

PLACES = len(ALL_PLACES)
GRID = 641
"""Points of an axis."""
MARGIN = 160.0
"""Points by which its ends go on straight beyond it."""
LARGEST_LOG = 5.0
"""Laws of the contact are no larger than this."""
CELLS = 10
"""From one point to the next that a piece of the engine's has; their number is even, and so 0 is the end of one."""
_PICKED = np.arange(0, GRID - 1, CELLS)[:, None] + np.array([0, 1, 2, 4, 6, 8, 9, 10])
"""(pieces, DEGREE + 1) points through which a piece goes."""


class Axes(NamedTuple):
    """How each place's argument is turned into a position on its axis: asinh(x / scale), from low to high."""

    scale: np.ndarray
    """(PLACES,) in the argument's unit."""
    low: np.ndarray
    """(PLACES,) of asinh(x / scale)."""
    step: np.ndarray
    """(PLACES,)"""

    @classmethod
    def over(cls, scale: Floats, low: Floats, high: Floats) -> Axes:
        """From arguments to others (PLACES,), whose axes have these scales."""
        first = np.arcsinh(low / scale)
        return cls(scale, first, (np.arcsinh(high / scale) - first) / (GRID - 1))

    def points(self, place: int) -> np.ndarray:
        """(GRID,) arguments at which a place's values stand."""
        return self.scale[place] * np.sinh(self.low[place] + self.step[place] * np.arange(GRID))

    def between(self, place: int, low: float, high: float, count: int) -> np.ndarray:
        """(count,) arguments from one to another, spread as the axis is: friction sets in within next to no speed."""
        scale = self.scale[place]
        return scale * np.sinh(np.linspace(np.arcsinh(low / scale), np.arcsinh(high / scale), count))

    def stretch(self, place: int) -> np.ndarray:
        """(GRID,) by how much the argument rises from there to the next point, to first order."""
        return self.scale[place] * self.step[place] * np.cosh(self.low[place] + self.step[place] * np.arange(GRID))


def position(axes: Axes, place: int, x: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Positions on a place's axis, and the lower of the two points that each is between or beyond."""
    at = (np.arcsinh(x / axes.scale[place]) - axes.low[place]) / axes.step[place]
    at = np.clip(at, -MARGIN, GRID - 1.0 + MARGIN)
    return at, np.clip(at.astype(int), 0, GRID - 2)


def interpolate(values: Floats, axes: Axes, place: int, x: Floats) -> Floats:
    """A law (GRID,) at arguments."""
    at, i = position(axes, place, x)
    return values[i] + (at - i) * (values[i + 1] - values[i])


def slope(values: Floats, axes: Axes, place: int, x: Floats) -> Floats:
    """Its derivative by the argument."""
    at, i = position(axes, place, x)
    inside = (at > -MARGIN) & (at < GRID - 1.0 + MARGIN)
    run = axes.step[place] * np.sqrt(x**2 + axes.scale[place] ** 2)
    return np.where(inside, (values[i + 1] - values[i]) / run, 0.0)


def _between(values: Floats) -> Floats:
    """(..., GRID) derivative of values by the position, of the fourth order, at the ends of the second."""
    made = np.empty_like(values)
    made[..., 2:-2] = (8.0 * (values[..., 3:-1] - values[..., 1:-3]) - (values[..., 4:] - values[..., :-4])) / 12.0
    made[..., [1, -2]] = 0.5 * (values[..., [2, -1]] - values[..., [0, -3]])
    made[..., 0] = -1.5 * values[..., 0] + 2.0 * values[..., 1] - 0.5 * values[..., 2]
    made[..., -1] = 1.5 * values[..., -1] - 2.0 * values[..., -2] + 0.5 * values[..., -3]
    return made


@functools.lru_cache(maxsize=256)
def _inverse(knots: bytes) -> Floats:
    """(pieces, DEGREE + 1, DEGREE + 1) from values at the picked ones of knots (GRID,) to their piece's polynomial."""
    at = np.frombuffer(knots)[_PICKED]
    t = 2.0 * (at - at[:, :1]) / (at[:, -1:] - at[:, :1]) - 1.0
    return np.asarray(np.linalg.inv(np.polynomial.polynomial.polyvander(t, DEGREE)), dtype=float)


def _fitted(laws: Floats, knots: Floats) -> Floats:
    """(m, pieces, DEGREE + 1) polynomials through laws (m, GRID) at knots (GRID,)."""
    return (_inverse(knots.tobytes()) @ laws[:, _PICKED][..., None])[..., 0]


class Contact(NamedTuple):
    """A law of the contact on the way from w to depths."""

    depth: Floats
    """(GRID,) at the points of w: the integral of dw over the factor."""
    factor: Floats
    """(GRID,)"""
    stretch: Floats
    """(GRID,) of w."""


def _contact(values: Floats, axes: Axes, place: int) -> Contact:
    """Of a law (GRID,).

    Raises:
        NotSmoothError: its factor changes so fast that from one point to the next depths do not rise.
    """
    factor, stretch = np.exp(np.clip(values, -LARGEST_LOG, LARGEST_LOG)), axes.stretch(place)
    depth = _integral(stretch / factor)
    if not np.all(np.diff(depth) > 0.0):
        raise NotSmoothError("a law of the contact changes too fast for depths to rise with the force")
    return Contact(depth, factor, stretch)


def _integral(rate: Floats) -> Floats:
    """(..., GRID) integral over the position from the first point on, of the fourth order."""
    made = np.zeros_like(rate)
    parts = 0.5 * (rate[..., 1:] + rate[..., :-1]) - np.diff(_between(rate), axis=-1) / 12.0
    np.cumsum(parts, axis=-1, out=made[..., 1:])
    return made


def table_of(values: Floats, axes: Axes, place: int) -> Table:
    """A law (GRID,) as pieces; of the contact as a shape over the depth (over k_u / k_l times it on the way out).

    Raises:
        NotSmoothError: it is no law of a contact: see :func:`_contact`.
    """
    knots, law = axes.points(place), values
    if place <= UNLOADING:
        knots, law = _contact(values, axes, place).depth, knots
    (pieces,) = _fitted(law[None], knots)
    return Table(knots[::CELLS].copy(), pieces, np.zeros(len(pieces) - 1, dtype=bool))


def changes_of(values: Floats, changes: Floats, axes: Axes, place: int) -> Floats:
    """(m, pieces, DEGREE + 1) by what a law's pieces change with its values, by each of ``changes`` (m, GRID)."""
    if place > UNLOADING:
        return _fitted(changes, axes.points(place))
    made = _contact(values, axes, place)
    moved = made.factor * _integral(changes * made.stretch / made.factor)
    return _fitted(moved, made.depth)
