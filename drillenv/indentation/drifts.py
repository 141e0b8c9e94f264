"""What drifts: the zero of the force, seen out of contact, and the displacement, where the machine stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from drillenv.indentation.branches import block_means
from drillenv.indentation.noise import Channel, Residual
from drillenv.indentation.parts import FEWEST_FREE

Floats = NDArray[np.float64]

STANDING = 0.05
"""Share of the speed of loading below which the machine counts as standing still."""
WELL_SEEN = 0.02
"""Share of that speed that the error of a drift may have."""
FEWEST_STANDING = 15
"""Blocks."""


@dataclass(frozen=True, slots=True)
class Zero:
    """The force out of contact, a line over time."""

    value: float
    """N at ``middle``."""
    rate: float
    """N/s; 0 where it was not seen."""
    covariance: Floats
    """(2, 2) of value and rate."""
    middle: float
    """s"""
    seen: bool
    """Whether the rate was seen, from at least two parts out of contact."""

    def at(self, time: Floats) -> Floats:
        """(samples,) N."""
        return self.value + self.rate * (time - self.middle)

    def error(self, time: Floats) -> Floats:
        """(samples, 2) N: its covariance is this times its transpose."""
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return np.column_stack([np.ones_like(time), time - self.middle]) @ root


@dataclass(frozen=True, slots=True)
class Drift:
    """The drift of the displacement, linear from the beginning on."""

    rate: float = 0.0
    """m/s"""
    std: float = 0.0
    """m/s"""
    seen: bool = False
    """Whether there were parts out of contact in which the machine stood still."""


def find_zero(time: Floats, force: Floats, free: Sequence[slice], noise: Channel) -> Zero:
    """The line through the parts out of contact, weighed by the noise of the force."""
    parts = [part for part in free if part.stop - part.start >= FEWEST_FREE]
    middle = float(np.mean([time[part].mean() for part in parts]))
    normal, right = np.zeros((2, 2)), np.zeros(2)
    for part in parts:
        value, samples = block_means(force, part)
        when, _ = block_means(time, part)
        design = np.column_stack([np.ones_like(when), when - middle])
        factor = cho_factor(noise.covariance(samples, value.size), lower=True)
        solved = cho_solve(factor, design)
        normal += design.T @ solved
        right += solved.T @ value
    if len(parts) > 1:
        found = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        value, rate = found @ right
        return Zero(float(value), float(rate), found, middle, True)
    return Zero(float(right[0] / normal[0, 0]), 0.0, np.diag([1.0 / normal[0, 0], 0.0]), middle, False)


def free_residuals(time: Floats, force: Floats, free: Sequence[slice], zero: Zero) -> list[Residual]:
    """What the zero leaves of the parts out of contact, where only the force has a say."""
    found = []
    for part in free:
        if part.stop - part.start >= FEWEST_FREE:
            values, samples = block_means(force - zero.at(time), part)
            n = values.size
            found.append(Residual(samples, values, np.ones(n), np.zeros(n), np.ones((n, 1))))
    return found


def find_standing(time: Floats, displacement: Floats, first: slice, last: slice, speed: float) -> list[slice]:
    """Where the machine stands still out of contact: before the approach, and after the retreat.

    Args:
        time, displacement: (samples,) of the whole curve in s and m.
        first, last: Parts out of contact before the first indentation and after the last.
        speed: Of loading in m/s.
    """
    found = []
    for part, way in ((first, 1), (last, -1)):
        if part.stop - part.start < FEWEST_STANDING:
            continue
        (when, samples), (depth, _) = block_means(time, part), block_means(displacement, part)
        blocks = _standing(np.abs(when[::way] - when[::way][0]), depth[::way], speed)
        still = int(0.9 * blocks) * samples
        if blocks:
            begin, end = part.start, part.start + when.size * samples
            found.append(slice(begin, begin + still) if way == 1 else slice(end - still, end))
    return found


def _standing(time: Floats, displacement: Floats, speed: float) -> int:
    """How many of the first blocks stand still, after which it may move; 0 where there are none.

    The best line with one bend: before the bend its slope must be small beside the speed.
    """
    n = time.size
    if n < FEWEST_STANDING or speed <= 0.0:
        return 0
    best = (np.inf, 0, 0.0)
    for begin in np.unique(np.linspace(FEWEST_STANDING, n, 40).astype(int)):
        design = np.column_stack([np.ones(n), time, np.maximum(time - time[begin - 1], 0.0)])
        if begin >= n - 2:
            design = design[:, :2]
        coefficients, *_ = np.linalg.lstsq(design, displacement, rcond=None)
        left = displacement - design @ coefficients
        best = min(best, (float(left @ left), int(begin), float(coefficients[1])))
    return best[1] if abs(best[2]) < STANDING * speed else 0


def find_drift(
    time: Floats, displacement: Floats, standing: Sequence[slice], noise: Channel, speed: float
) -> tuple[Drift, list[Residual]]:
    """The drift of the displacement where the machine stands still, and what it leaves there.

    Args:
        time, displacement: (samples,) of the whole curve in s and m.
        standing: Where it stands still.
        noise: Of the displacement.
        speed: Of loading in m/s: a drift that is known no better than 2 % of it is none.
    """
    information = projected = 0.0
    step = _smallest_step(displacement)
    shown, lasted = [], 0.0
    for part in standing:
        (when, samples), (depth, _) = block_means(time, part), block_means(displacement, part)
        design = np.column_stack([np.ones_like(when), when - when.mean()])
        factor = cho_factor(noise.covariance(samples, when.size), lower=True)
        solved = cho_solve(factor, design)
        normal, right = design.T @ solved, solved.T @ depth
        information += normal[1, 1] - normal[0, 1] ** 2 / normal[0, 0]
        projected += right[1] - normal[0, 1] * right[0] / normal[0, 0]
        coefficients = np.linalg.solve(normal, right)
        shown.append(Residual(samples, depth - design @ coefficients, np.zeros(when.size), np.ones(when.size), design))
        lasted = float(np.hypot(lasted, np.ptp(when)))
    if not information:
        return Drift(), []
    # noise below the resolution hides what happens within it: an error of both ends, uniform
    std = float(np.hypot(1.0 / np.sqrt(information), 0.4 * step / lasted))
    if std > WELL_SEEN * speed:
        return Drift(), shown
    return Drift(projected / information, std, True), shown


def _smallest_step(values: Floats) -> float:
    """The resolution of a channel."""
    steps = np.diff(np.unique(values))
    return float(steps[steps > 1e-6 * np.ptp(values)].min(initial=np.ptp(values)))
