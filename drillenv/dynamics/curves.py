"""Measured curves: a force, or a factor, over its argument, where no textbook equation follows what was measured.

Between its knots a curve is the monotone cubic of F. N. Fritsch and R. E. Carlson, Monotone piecewise cubic
interpolation, SIAM Journal on Numerical Analysis 17 (1980) 238-246, doi:10.1137/0717021, with the slopes of F. N.
Fritsch and J. Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM Journal on
Scientific and Statistical Computing 5 (1984) 300-304 (PCHIP). Beyond them it is held at its last value, or goes on
straight with its last slope.

The general engine reads a curve from its row of parameters, whose length is that of the curve: ``FLAT, COUNT,
STRAIGHT``, then the arguments, the values and the slopes of the knots. So nothing is compiled anew for another curve.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from drillenv.checks import InputError, choice, number, shown
from drillenv.dynamics.corners import time_to

Floats = NDArray[np.float64]
Beyond = Literal["held", "straight"]
BEYOND: tuple[Beyond, ...] = ("held", "straight")
FEWEST, MOST = 2, 64
"""Knots of a curve."""
LARGEST = 1e12
"""Of an argument or value, in its SI unit."""
KEYS = ("x", "y", "beyond", "argument_unit", "unit")
"""What a curve is given by; the last three may be left out."""

FLAT, COUNT, STRAIGHT, KNOTS = range(4)
"""Where things stand in a row of parameters: 1 for a curve that adds nothing, the number of knots, 1 where the curve
goes on straight, and the first knot."""
ON_IT = 1e-5
"""A place this share of the way to the next knot beside one is on it. The curvature that jumps there is then crossed
with an error of some 1e-10 of the curve's bend."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A measured curve, as it was given."""

    x: tuple[float, ...]
    """Arguments, rising."""
    y: tuple[float, ...]
    beyond: Beyond = "held"
    """``held`` at its last value beyond the knots, or ``straight`` on with its last slope."""


# --- What the user gave


def curve_from(name: str, given: Mapping[str, object], argument_unit: str, unit: str, low: float, high: float) -> Curve:
    """A curve of an effect called ``name``, from what it is given by (see ``KEYS``).

    Args:
        name: For messages.
        given: ``x`` and ``y``, and perhaps ``beyond`` and the units, which then have to be these:
        argument_unit, unit: of the effect.
        low, high: What its values may be.

    Raises:
        InputError: not such a curve.
    """
    for key in given:
        if key not in KEYS:
            raise InputError(f"effect {name} has no parameter {shown(key)}: a measured curve has {', '.join(KEYS)}")
    for key, wanted in (("argument_unit", argument_unit), ("unit", unit)):
        if given.get(key, wanted) != wanted:
            raise InputError(f"{name} {key} is {shown(given[key])}: give the curve in {wanted!r}")
    x = _numbers(f"{name} x", given.get("x"), -LARGEST, LARGEST, argument_unit)
    y = _numbers(f"{name} y", given.get("y"), low, high, unit)
    if len(x) != len(y):
        raise InputError(f"{name} has {len(x)} numbers in x and {len(y)} in y: give as many values as arguments")
    for before, after in pairwise(x):
        if after <= before:
            raise InputError(f"{name} x goes from {before:g} to {after:g}: give arguments that rise from knot to knot")
    return Curve(x, y, choice(f"{name} beyond", given.get("beyond", "held"), BEYOND))


def _numbers(name: str, given: object, low: float, high: float, unit: str) -> tuple[float, ...]:
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if not isinstance(given, (list, tuple)):
        raise InputError(f"{name} is {shown(given)}: give a list of {FEWEST} to {MOST} numbers")
    if not FEWEST <= len(given) <= MOST:
        raise InputError(f"{name} has {len(given)} numbers: give a list of {FEWEST} to {MOST} numbers")
    return tuple(number(f"{name}[{i}]", value, low, high, unit) for i, value in enumerate(given))


# --- What the engine reads


def pchip_slopes(x: ArrayLike, y: ArrayLike) -> Floats:
    """(knots,) slopes of the monotone cubic through knots (knots,), two at least."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    width, rise = np.diff(x), np.diff(y) / np.diff(x)
    if x.size == 2:
        return np.full(2, rise[0])
    slopes = np.zeros(x.size)
    same = rise[:-1] * rise[1:] > 0.0
    one, two = 2.0 * width[1:] + width[:-1], width[1:] + 2.0 * width[:-1]
    inner = slopes[1:-1]
    inner[same] = (one + two)[same] / (one[same] / rise[:-1][same] + two[same] / rise[1:][same])
    slopes[0] = _end_slope(width[0], width[1], rise[0], rise[1])
    slopes[-1] = _end_slope(width[-1], width[-2], rise[-1], rise[-2])
    return slopes


def _end_slope(width: float, next_width: float, rise: float, next_rise: float) -> float:
    """Slope at an end by three points, as far as the curve stays monotone."""
    slope = ((2.0 * width + next_width) * rise - width * next_rise) / (width + next_width)
    if slope * rise <= 0.0:
        return 0.0
    return 3.0 * rise if rise * next_rise <= 0.0 and abs(slope) > 3.0 * abs(rise) else slope


def row_of(curve: Curve) -> tuple[float, ...]:
    """The row of parameters of a curve that adds its value."""
    return _row(not any(curve.y), curve.beyond == "straight", curve.x, curve.y, pchip_slopes(curve.x, curve.y))


def row_of_period(curve: Curve, period: float) -> tuple[float, ...]:
    """The row of a curve that repeats after ``period``, from its first knot to the same one a period on.

    Raises:
        ValueError: the knots span more than a period, or a whole one with two values where it closes.
    """
    x, y = np.array(curve.x), np.array(curve.y)
    if math.isclose(x[-1] - x[0], period, rel_tol=1e-9):
        if y[-1] != y[0]:
            raise ValueError("its first and last value differ, a period apart")
        x, y = x[:-1], y[:-1]
    elif x[-1] - x[0] > period:
        raise ValueError(f"its arguments span {x[-1] - x[0]:g}, more than a period of {period:g}")
    if x.size == 1:
        x, y = np.array([x[0], x[0] + 0.5 * period]), np.array([y[0], y[0]])
    around = np.concatenate([x - period, x, x + period])
    slopes = pchip_slopes(around, np.tile(y, 3))[x.size : 2 * x.size]
    ring = [np.append(each, each[0]) for each in (y, slopes)]
    return _row(not np.any(y), False, np.append(x, x[0] + period), *ring)


def row_of_rock(curve: Curve) -> tuple[float, ...]:
    """The row of the force in N over stiffness times depth in N, from the tangent stiffness over the force.

    With ``f`` the curve, the factor on the stiffness k over the force R, ``dR/dx = k f(R)``. Where the indenter stands
    at the depth x, ``k x`` is then the integral of 1/f from 0 to R. At each knot force and tangent are those of ``f``;
    between them cubics join them, so many that there are at least as many as a curve may have knots, and the more the
    more the tangent changes.
    """
    slopes = pchip_slopes(curve.x, curve.y)
    row = np.array(_row(False, False, curve.x, curve.y, slopes))
    force = [0.0] if curve.x[0] > 0.0 else []
    fewest = math.ceil(MOST / (len(curve.x) - 1))
    for i, (low, high) in enumerate(pairwise(curve.x)):
        pieces = max(fewest, math.ceil(abs(math.log(curve.y[i + 1] / curve.y[i])) / math.log(1.2)))
        force += np.linspace(low, high, pieces, endpoint=False).tolist()
    force.append(curve.x[-1])
    factor = [value_of(row, each) for each in force]
    nodes, weights = np.polynomial.legendre.leggauss(8)
    reach = [0.0]
    for low, high in pairwise(force):
        inside = [1.0 / value_of(row, 0.5 * (low + high) + 0.5 * (high - low) * node) for node in nodes]
        reach.append(reach[-1] + 0.5 * (high - low) * float(np.dot(weights, inside)))
    return _row(all(each == 1.0 for each in curve.y), True, reach, force, factor)


def _row(flat: bool, straight: bool, x: ArrayLike, y: ArrayLike, slopes: ArrayLike) -> tuple[float, ...]:
    knots = np.concatenate([np.asarray(part, dtype=float) for part in (x, y, slopes)])
    return (float(flat), float(knots.size // 3), float(straight), *knots.tolist())


@register_jitable
def knot_below(p, x):
    """Number of the last knot at or below ``x``, of all but the last; 0 below them all."""
    low, high = 0, int(p[COUNT]) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if p[KNOTS + middle] <= x:
            low = middle
        else:
            high = middle
    return low


@register_jitable
def value_of(p, x):
    """The value at ``x`` of the curve in the row of parameters ``p``."""
    count = int(p[COUNT])
    last = KNOTS + count - 1
    if x <= p[KNOTS]:
        return p[last + 1] + p[STRAIGHT] * p[last + 1 + count] * (x - p[KNOTS])
    if x >= p[last]:
        return p[last + count] + p[STRAIGHT] * p[last + 2 * count] * (x - p[last])
    at = KNOTS + knot_below(p, x)
    width = p[at + 1] - p[at]
    s = (x - p[at]) / width
    y, rise = p[at + count], p[at + 1 + count] - p[at + count]
    begin, end = width * p[at + 2 * count], width * p[at + 1 + 2 * count]
    return y + s * (begin + s * (3.0 * rise - 2.0 * begin - end + s * (begin + end - 2.0 * rise)))


@register_jitable
def time_to_knot(p, x, speed, change):
    """Time until an argument at ``x``, of this rate and its rate, next reaches a knot; infinity where it does not."""
    if p[FLAT] != 0.0:
        return math.inf
    count, first = int(p[COUNT]), math.inf
    below = knot_below(p, x)
    # the knots around, and those one further on where the nearer one has just been reached
    for i in range(max(below - 1, 0), min(below + 3, count)):
        knot = p[KNOTS + i]
        width = p[KNOTS + i + 1] - knot if i < count - 1 else knot - p[KNOTS + i - 1]
        if abs(x - knot) > ON_IT * width:
            first = min(first, time_to(x - knot, speed, change))
    return first
