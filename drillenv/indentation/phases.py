"""Impact, compression and stable: from which indentation on the stiffness no longer grows, and what it then is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from drillenv.indentation.branches import INTERVAL, Estimate

Floats = NDArray[np.float64]

LEVEL = 0.05
"""Level of the test for growth."""
FEWEST_TO_TEST = 4
"""Indentations among which a change can be found."""
DRAWS = 20_000


class Phases(NamedTuple):
    """How many indentations come before the stable ones, and how sure that is."""

    early: int
    p_values: tuple[float, ...]
    """Of each test for growth, the last of which found none."""
    tested: bool
    """Whether there were indentations enough."""


def find_phases(stiffness: Sequence[float], std: Sequence[float], seed: int = 0) -> Phases:
    """From which indentation on the loading stiffness is constant but for scatter.

    The statistic is the largest over all changes of the Student t by which the later indentations are stiffer than the
    earlier, with the scatter within both groups, at least that of the measurement. Its distribution without growth is
    simulated. As long as it lies in the highest 5 %, those before the most likely change are set aside, and the rest is
    tested again.

    Args:
        stiffness, std: (indentations,) k_l in their order and their standard deviations.
        seed: Of the simulation.
    """
    values, errors = np.asarray(stiffness, float), np.asarray(std, float)
    rng = np.random.default_rng(seed)
    early, p_values = 0, []
    while values.size - early >= FEWEST_TO_TEST:
        n = values.size - early
        found, change = _growth(values[None, early:], float(np.mean(errors[early:] ** 2)))
        by_chance, _ = _growth(rng.standard_normal((DRAWS, n)), 0.0)
        p_values.append(float((1 + np.count_nonzero(by_chance >= found[0])) / (1 + DRAWS)))
        if p_values[-1] >= LEVEL:
            break
        early += int(change[0])
    return Phases(early, tuple(p_values), values.size >= FEWEST_TO_TEST)


def _growth(values: Floats, least: float) -> tuple[Floats, NDArray[np.int64]]:
    """(rows,) the largest t of a growth, and how many come before it; ``least`` is the smallest variance."""
    n = values.shape[1]
    statistics = []
    for before in range(1, n - 1):
        one, two = values[:, :before], values[:, before:]
        within = (one.var(axis=1) * before + two.var(axis=1) * (n - before)) / (n - 2)
        within = np.maximum(within, max(least, 1e-300))
        statistics.append((two.mean(axis=1) - one.mean(axis=1)) / np.sqrt(within * (1 / before + 1 / (n - before))))
    table = np.stack(statistics)
    return table.max(axis=0), table.argmax(axis=0) + 1


class Common(NamedTuple):
    """What several indentations share."""

    mean: Estimate
    scatter: float
    """Standard deviation from one indentation to another, beyond the errors of measurement."""
    own_std: float
    """Of the mean, without the errors that all indentations share."""


def combine(values: Sequence[float], std: Sequence[float], shared: Floats) -> Common:
    """The weighted mean of several indentations and the scatter between them.

    The scatter makes the weighted sum of squares what it should be (Paule and Mandel 1982); the interval of the mean is
    that of Hartung and Knapp (2001), never narrower than without scatter.

    Args:
        values, std: (indentations,) and the standard deviations of what is each one's own error.
        shared: (indentations, errors) by how much each error that all have in common moves each value.
    """
    y, variances = np.asarray(values, float), np.asarray(std, float) ** 2
    n = y.size
    scatter = _scatter(y, variances) if n > 1 else 0.0
    weights = 1.0 / (variances + scatter)
    mean = float(weights @ y / weights.sum())
    excess = max(1.0, float(weights @ (y - mean) ** 2) / (n - 1)) if n > 1 else 1.0
    own = float(np.sqrt(excess / weights.sum()))
    common = float(np.linalg.norm(weights @ shared / weights.sum()))
    reach = float(np.hypot((student.ppf(0.975, n - 1) if n > 1 else INTERVAL) * own, INTERVAL * common))
    return Common(
        Estimate(mean, float(np.hypot(own, common)), mean - reach, mean + reach), float(np.sqrt(scatter)), own
    )


def _scatter(y: Floats, variances: Floats) -> float:
    """Variance between indentations at which the weighted sum of squares is their number less one, or 0."""

    def excess(between: float) -> float:
        weights = 1.0 / (variances + between)
        return float(weights @ (y - weights @ y / weights.sum()) ** 2) - (y.size - 1)

    if excess(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, float(y.var() * y.size)
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)
