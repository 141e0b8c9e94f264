"""Measured curves: a force, or a factor, over its argument, where no textbook equation follows what was measured.

Between its knots a curve is the monotone cubic of F. N. Fritsch and R. E. Carlson, Monotone piecewise cubic
interpolation, SIAM Journal on Numerical Analysis 17 (1980) 238-246, doi:10.1137/0717021, with the slopes of F. N.
Fritsch and J. Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM Journal on
Scientific and Statistical Computing 5 (1984) 300-304 (PCHIP). Beyond them it is held at its last value, or goes on
straight with its last slope.

The hybrid engine reads a curve as a table (:mod:`drillenv.dynamics.constitutive.tables`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from drillenv.checks import InputError, choice, number, shown
from drillenv.dynamics.constitutive.tables import Table, cubic_table, tabulate, toward_zero

Floats = NDArray[np.float64]
Beyond = Literal["held", "straight"]
BEYOND: tuple[Beyond, ...] = ("held", "straight")
FEWEST, MOST = 2, 64
"""Knots of a curve."""
LARGEST = 1e12
"""Of an argument or value, in its SI unit."""
CUTS = 32
"""Parts of the way between two knots, for quadrature."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
KEYS = ("x", "y", "beyond", "argument_unit", "unit")
"""What a curve is given by; the last three may be left out."""


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


def table_along(curve: Curve, low: float, high: float) -> Table:
    """The table of a curve from ``low`` to ``high``."""
    return cubic_table(curve.x, curve.y, pchip_slopes(curve.x, curve.y), low, high, curve.beyond == "straight")


def table_around(curve: Curve, period: float) -> Table:
    """The table of a curve that repeats after ``period``, from 0 to there.

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
    x = x - period * math.floor(x[0] / period)
    around = np.concatenate([x - 2.0 * period, x - period, x, x + period])
    values = np.tile(y, 4)
    cubics = CubicHermiteSpline(around, values, pchip_slopes(around, values))
    knots = np.unique(np.concatenate([[0.0], around[(around > 0.0) & (around < period)], [period]]))
    return cubic_table(knots, cubics(knots), cubics(knots, 1), 0.0, period, True)


def table_of_tangents(curve: Curve, high: float) -> Table:
    """The table, up to ``high``, of the force in N over stiffness times depth in N, from the stiffness over the force.

    With ``f`` the curve, the factor on the stiffness k over the force R, ``dR/dx = k f(R)``. Where the indenter stands
    at the depth x, ``k x`` is then the integral of 1/f from 0 to R; here that is inverted.
    """
    inner = CubicHermiteSpline(curve.x, curve.y, pchip_slopes(curve.x, curve.y))
    first, last = curve.x[0], curve.x[-1]
    # cut so fine that Gauss' quadrature of 1/f is exact to rounding
    pieces = [np.linspace(low, up, CUTS, endpoint=False) for low, up in pairwise(curve.x)]
    force = np.unique(np.concatenate([[0.0], *pieces, [last]]))

    def factor_at(at: Floats) -> Floats:
        return inner(np.clip(at, first, last))

    def over(low: Floats, up: Floats) -> Floats:
        middle, half = 0.5 * (low + up), 0.5 * (up - low)
        return half * ((1.0 / factor_at(middle[:, None] + half[:, None] * _NODES)) @ _WEIGHTS)

    reach = np.concatenate([[0.0], np.cumsum(over(force[:-1], force[1:]))])

    def force_at(x: Floats) -> Floats:
        at = np.clip(np.searchsorted(reach, x, side="right") - 1, 0, force.size - 1)
        begin, there = force[at], force[at] + (x - reach[at]) * factor_at(force[at])
        for _ in range(6):
            there = there - (over(begin, there) - (x - reach[at])) * factor_at(there)
        return np.where(x > reach[-1], last + (x - reach[-1]) * factor_at(np.array(last)), there)

    corners = [float(np.interp(each, force, reach)) for each in curve.x]
    return tabulate(force_at, 0.0, high, [*corners, *toward_zero(high)])
