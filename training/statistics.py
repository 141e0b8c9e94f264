"""What a set of scores says, and how surely: interquartile means, bootstrap intervals, chances of being better.

The formulas are those of R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville and M. G. Bellemare, "Deep Reinforcement
Learning at the Edge of the Statistical Precision", NeurIPS 2021, with episodes in the place of their tasks. Their
library resamples training runs only; here episodes are resampled as well, within strata, so that an interval also says
what other rocks would have given.

Scores of a controller are an array (runs, episodes): a run is a training seed, and there is one of what learns nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import trim_mean

RESAMPLES = 5_000
CHUNK = 250
"""Resamples computed at once."""
LEVEL = 95.0
"""Per cent of the intervals."""


class Interval(NamedTuple):
    """A value and its bootstrap interval."""

    value: float
    low: float
    high: float


class Draws(NamedTuple):
    """Resampled episodes and runs, the same for all controllers: differences are those of pairs."""

    episodes: np.ndarray
    """(resamples, episodes) whole numbers."""
    places: np.ndarray
    """(resamples, most runs) from 0 to 1, to be scaled by the number of runs of a controller."""

    def of(self, scores: np.ndarray, part: slice) -> np.ndarray:
        """(resamples of ``part``, runs, episodes) of the scores (runs, episodes)."""
        runs = scores.shape[0]
        chosen = (self.places[part, :runs] * runs).astype(int)
        return scores[chosen[:, :, None], self.episodes[part][:, None, :]]


def draws(strata: np.ndarray, runs: int, resamples: int = RESAMPLES, seed: int = 0) -> Draws:
    """Draw episodes with replacement within each stratum, and runs with replacement.

    Args:
        strata: (episodes,) the stratum of each.
        runs: Most runs of any controller.
        resamples: How often.
        seed: Of the draws.
    """
    rng = np.random.default_rng(seed)
    episodes = np.empty((resamples, strata.size), dtype=int)
    for stratum in np.unique(strata):
        members = np.flatnonzero(strata == stratum)
        episodes[:, members] = members[rng.integers(0, members.size, (resamples, members.size))]
    return Draws(episodes, rng.random((resamples, runs)))


def iqm(scores: np.ndarray) -> float:
    """The mean of the middle half of all scores (runs, episodes) taken together."""
    return float(trim_mean(scores.ravel(), 0.25))


def resampled(scores: np.ndarray, drawn: Draws, mean: bool = False) -> np.ndarray:
    """(resamples,) the interquartile mean, or the ``mean``, of each resample of the scores (runs, episodes)."""
    n = drawn.episodes.shape[0]
    found = np.empty(n)
    for first in range(0, n, CHUNK):
        part = slice(first, min(first + CHUNK, n))
        rows = drawn.of(scores, part).reshape(part.stop - part.start, -1)
        found[part] = rows.mean(axis=1) if mean else trim_mean(rows, 0.25, axis=1)
    return found


def interval(value: float, resamples: np.ndarray) -> Interval:
    """A value with the percentile interval of its resamples."""
    low, high = np.percentile(resamples, [50.0 - 0.5 * LEVEL, 50.0 + 0.5 * LEVEL])
    return Interval(value, float(low), float(high))


def wins(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(runs of one, runs of other, episodes) 1 where ``one`` scores more in an episode, 0.5 where as much, else 0."""
    a, b = one[:, None, :], other[None, :, :]
    return (a > b) + 0.5 * (a == b)


def chance(one: np.ndarray, other: np.ndarray) -> float:
    """The probability that ``one`` scores more than ``other`` in an episode; a tie counts half."""
    return float(wins(one, other).mean())
