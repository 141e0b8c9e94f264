"""Laws as tables: piecewise polynomials, with their corners as knots.

A law in plain NumPy becomes polynomials of degree seven through Chebyshev's points, on intervals that are halved until
each is good to rounding. Cubic pieces would need thousands of knots for the same. A corner, where the slope or the
curvature jumps, is found by the halving itself, which does not end there, and becomes a knot. The integrator ends a
step on it: within a step every law is smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

DEGREE = 7
MOST_CORNERS, MOST_PIECES = 64, 4000
GOOD, FLOOR = 2e-14, 4e-15
"""Error of a piece over the law's largest value on it, and over that on the whole range, at most."""
NARROW = 2.0**-36
"""Width over the whole range at which halving has run into a corner."""
NODES = -np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
_BETWEEN = 0.5 * (NODES[1:] + NODES[:-1])
FIT = np.linalg.inv(np.vander(NODES, increasing=True))
"""Chebyshev's points from -1 to 1 that a piece goes through, and the matrix from values there to its coefficients."""
_CHECK = np.vander(_BETWEEN, DEGREE + 1, increasing=True)


class NotSmoothError(ValueError):
    """A law that cannot be tabulated."""


class Table(NamedTuple):
    """A law as a table."""

    knots: Floats
    """(pieces + 1,) rising."""
    pieces: Floats
    """(pieces, DEGREE + 1) coefficients of the powers of t, which goes from -1 to 1 over a piece."""
    corners: NDArray[np.bool_]
    """(pieces - 1,) at which inner knots the slope or the curvature jumps."""

    def __call__(self, x: Floats) -> Floats:
        """Values at x (n,), beyond the knots straight on."""
        x = np.asarray(x, dtype=float)
        at = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.pieces) - 1)
        half = 0.5 * np.diff(self.knots)[at]
        inside = np.clip(x, self.knots[0], self.knots[-1])
        t = (inside - self.knots[at]) / half - 1.0
        value, slope = np.zeros_like(t), np.zeros_like(t)
        for power in range(DEGREE, -1, -1):
            slope = value + t * slope
            value = self.pieces[at, power] + t * value
        return value + slope / half * (x - inside)


def tabulate(law: Callable[[Floats], Floats], low: float, high: float, knots: Iterable[float] = ()) -> Table:
    """The table of a continuous law from ``low`` to ``high``.

    Args:
        law: From arguments (n,) to values (n,).
        low, high: The range.
        knots: Where it is known to have corners, or to need pieces of their own.

    Raises:
        NotSmoothError: values that are not finite, or a law that is nowhere smooth.
    """
    edges = sorted({low, high, min(max(0.0, low), high), *(each for each in knots if low < each < high)})
    most = len(edges) + MOST_CORNERS
    for _ in range(MOST_CORNERS):
        knots, pieces, corners = _refined(law, np.array(edges))
        if not corners.size:
            return table_of(knots, pieces)
        edges = sorted({*edges, *corners.tolist()})
        if len(edges) > most:
            break
    raise NotSmoothError(f"it has more than {MOST_CORNERS} corners from {low:g} to {high:g}")


def toward_zero(high: float) -> list[float]:
    """Knots that come close to 0: a contact is followed from next to no depth on, with the digits of its own size."""
    return [high * 0.25**k for k in range(1, 21)]


def _refined(law: Callable[[Floats], Floats], edges: Floats) -> tuple[Floats, Floats, Floats]:
    """Knots and pieces between edges; and corners inside, if any, where halving has not ended."""
    span, largest = edges[-1] - edges[0], 0.0
    left, right = edges[:-1], edges[1:]
    starts, kept, corners = [], [], []
    while left.size:
        middle, half = 0.5 * (left + right), 0.5 * (right - left)
        x = middle[:, None] + half[:, None] * np.concatenate([NODES, _BETWEEN])
        x[:, 0], x[:, DEGREE] = left, right
        values = np.asarray(law(x.ravel()), dtype=float).reshape(x.shape)
        if not np.all(np.isfinite(values)):
            raise NotSmoothError("it has values that are not finite")
        sizes = np.abs(values).max(axis=1)
        largest = max(largest, float(sizes.max()))
        fitted = values[:, : DEGREE + 1] @ FIT.T
        error = np.abs(fitted @ _CHECK.T - values[:, DEGREE + 1 :]).max(axis=1)
        good = error <= GOOD * sizes + FLOOR * largest
        stuck = ~good & (right - left <= NARROW * span)
        # an edge may be a singular point, as 0 is of a power law
        at_edge = stuck & (np.isin(left, edges) | np.isin(right, edges))
        corners += [_corner(law, each, NARROW * span) for each in middle[stuck & ~at_edge]]
        good |= at_edge
        starts.append(left[good])
        kept.append(fitted[good])
        left, middle, right = (each[~good & ~stuck] for each in (left, middle, right))
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        if sum(map(len, starts)) + left.size > MOST_PIECES:
            raise NotSmoothError(f"it has more than {MOST_CORNERS} corners, or none where it is smooth")
    begin, pieces = np.concatenate(starts), np.concatenate(kept)
    order = np.argsort(begin)
    return np.append(begin[order], edges[-1]), pieces[order], np.unique(corners)


def _corner(law: Callable[[Floats], Floats], near: float, width: float) -> float:
    """Where the straight lines through a law on either side of a corner meet."""
    x = near + width * np.array([-4.0, -2.0, 2.0, 4.0])
    y = np.asarray(law(x), dtype=float)
    before, after = (y[1] - y[0]) / (x[1] - x[0]), (y[3] - y[2]) / (x[3] - x[2])
    if before == after:
        return near
    meet = x[1] + (y[2] - y[1] - after * (x[2] - x[1])) / (before - after)
    return float(meet if abs(meet - near) < 4.0 * width else near)


def table_of(knots: Floats, pieces: Floats) -> Table:
    """The table of these pieces, whose corners are looked for at the knots."""
    half = 0.5 * np.diff(knots)
    power = np.arange(DEGREE + 1)
    slopes = [(pieces * power * sign ** (power - 1.0)).sum(axis=1) / half for sign in (-1.0, 1.0)]
    bends = [(pieces * power * (power - 1) * sign**power).sum(axis=1) / half**2 for sign in (-1.0, 1.0)]
    narrow, sizes = np.minimum(half[:-1], half[1:]), np.abs(pieces).sum(axis=1)
    least = np.maximum(1e-9 * np.minimum(sizes[:-1], sizes[1:]), 1e-13 * sizes.max())
    sharp = _jumps(slopes[1][:-1], slopes[0][1:], 1e-6, least / narrow)
    bent = _jumps(bends[1][:-1], bends[0][1:], 1e-3, least / narrow**2)
    return Table(knots, pieces, sharp | bent)


def _jumps(before: Floats, after: Floats, share: float, least: Floats) -> NDArray[np.bool_]:
    jump = np.abs(after - before)
    return (jump > share * (np.abs(after) + np.abs(before))) & (jump > least)


def cubic_table(
    knots: ArrayLike, values: ArrayLike, slopes: ArrayLike, low: float, high: float, straight: bool
) -> Table:
    """The table of the cubics through values and slopes at knots (n,), from ``low`` to ``high``.

    Beyond the knots it is held, or goes straight on with the slopes at the ends.
    """
    x, y, m = (np.asarray(each, dtype=float) for each in (knots, values, slopes))
    ends = np.array([0, -1])
    inner = x[ends]
    beyond = np.array([low, high])
    wanted = np.array([low < x[0], high > x[-1]])
    past = y[ends] + (m[ends] * (beyond - x[ends]) if straight else 0.0)
    at = np.array([0, x.size])[wanted]
    x, y, m = (np.insert(each, at, more[wanted]) for each, more in ((x, beyond), (y, past), (m, m[ends])))
    pieces = np.zeros((x.size - 1, DEGREE + 1))
    half, rise = 0.5 * np.diff(x), np.diff(y)
    begin, end = m[:-1].copy(), m[1:].copy()
    if not straight:
        # a held end has two slopes: beyond it the curve is flat, whatever it was before
        outside = (x[1:] <= inner[0]) | (x[:-1] >= inner[1])
        begin[outside] = end[outside] = 0.0
    begin, end = begin * half, end * half
    pieces[:, 0] = 0.5 * (y[:-1] + y[1:]) + 0.25 * (begin - end)
    pieces[:, 1] = 0.75 * rise - 0.25 * (begin + end)
    pieces[:, 2] = 0.25 * (end - begin)
    pieces[:, 3] = 0.25 * (begin + end) - 0.25 * rise
    return table_of(x, pieces)
