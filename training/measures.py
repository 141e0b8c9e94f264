"""What is measured of each episode that a controller drilled."""

from __future__ import annotations

import math

import numpy as np

from drillenv.env.plant import INTERVAL
from drillenv.env.truth import T_DRIVE, T_EXCESS, T_LAYER, T_MEAN, T_RATE, T_SINGLE
from drillenv.training.rollout import Rollout

STRONG = 0.5
"""P-1-I-1 counts where the mean blow has this share of the rating. High pressure has a weak kind of it."""
ALONE = 0.9
"""Share of an interval's periods with a single repeated blow from which on the motion is P-1-I-1."""
HOLDS = 2
"""Intervals in a row that are P-1-I-1 where it is recovered."""
VIOLATION = 0.01
"""Force above the rating, a period, as a share of it, from which an interval counts as a violation: what the load cell
tells from its noise."""
WORST = 0.05
"""Share of the intervals that are the worst."""

MEASURES = {
    "score": "mean reward, mm/s",
    "penetration_rate": "mm/s",
    "single_share": "share of the time in strong P-1-I-1",
    "violations": "share of the intervals with a force over 1 % above the rating",
    "cost": "mean force above the rating, a period, N: what a budget is of",
    "worst_excess": "mean force above the rating, a period, over the worst 5 % of the intervals, N",
    "energy": "work of the drive for a millimetre, J/mm",
    "recovery": "time from a change of rock to strong P-1-I-1, s",
    "recovered": "share of the changes of rock after which it comes back before the next one",
}
"""The measures of an episode."""


def measures(made: Rollout, rating: float) -> dict[str, np.ndarray]:
    """(episodes,) of each of MEASURES, NaN where an episode has none of it; ``rating`` in N."""
    truths = made.truths
    excess, rate = truths[..., T_EXCESS], truths[..., T_RATE]
    single = np.where(truths[..., T_MEAN] >= STRONG * rating, truths[..., T_SINGLE], 0.0)
    worst = max(1, round(WORST * excess.shape[1]))
    drilled = rate.mean(axis=1)
    times = [recoveries(own, layers) for own, layers in zip(single, truths[..., T_LAYER], strict=True)]
    return {
        "score": made.scores,
        "penetration_rate": drilled,
        "single_share": single.mean(axis=1),
        "violations": (excess > VIOLATION * rating).mean(axis=1),
        "cost": excess.mean(axis=1),
        "worst_excess": np.sort(excess, axis=1)[:, -worst:].mean(axis=1),
        "energy": np.where(drilled > 0.0, truths[..., T_DRIVE].mean(axis=1) / np.maximum(drilled, 1e-12), math.nan),
        "recovery": np.array([taken.mean() if taken.size else math.nan for taken, _ in times]),
        "recovered": np.array([back.mean() if back.size else math.nan for _, back in times]),
    }


def recoveries(single: np.ndarray, layers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times in s from each change of rock to P-1-I-1 again, and whether it came back before the next change.

    Where it did not, the time until that change stands for it, which is too short.

    Args:
        single: (steps,) share of periods with single blows.
        layers: (steps,) the layer at the end of each interval.
    """
    changes = np.flatnonzero(np.diff(layers) > 0) + 1
    ends = np.append(changes[1:], single.size)[: changes.size]
    taken, back = np.empty(changes.size), np.zeros(changes.size, dtype=bool)
    for j, (begin, end) in enumerate(zip(changes, ends, strict=True)):
        alone = single[begin:end] >= ALONE
        held = np.convolve(alone, np.ones(HOLDS), "valid") >= HOLDS if alone.size >= HOLDS else np.zeros(0)
        found = np.flatnonzero(held)
        back[j] = found.size > 0
        taken[j] = INTERVAL * (found[0] if found.size else end - begin)
    return taken, back
