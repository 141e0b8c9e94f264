"""From what each controller did in each episode to the rows of the league, and to the statement about learning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from drillenv.training.measures import MEASURES
from drillenv.training.statistics import Draws, Interval, chance, draws, interval, iqm, resampled

FORMAT = "drillenv-league/1"
YARDSTICK = "oracle"
"""What scores are shares of: the planner that knows the rock, which is better than the steady-state oracle."""
RANDOMISED, HIDDEN = "-randomised", "-hidden"
"""Ends of the rows of policies that were trained on rigs whose constants are drawn anew for each episode, and on such
with an effect that the paper leaves out (domain randomisation: Tobin et al., IROS 2017)."""
REPEATED = (
    "ppo-vine" + HIDDEN,
    "ppo-vine" + RANDOMISED,
    "ppo-vine",
    "ppo",
    "ppo-lagrangian",
    "recurrent-ppo",
    "sac",
    "td3",
)
"""The rows of several training seeds, by their algorithms."""
NEITHER = ("random", "fixed", "rules", "scheduled", "seeking", "mpc")
"""The rows that neither learn nor see the rock."""
ENOUGH = 0.95
"""Share of the yardstick that learning is to reach."""
SEEDS = 5
"""Training seeds that the statement needs."""


def summary(runs: Mapping[str, list[dict[str, Any]]], strata: np.ndarray, compared: str = "share") -> dict[str, Any]:
    """Everything that is derived from the runs.

    Args:
        runs: Of each row, as in the record.
        strata: (episodes,) to resample within.
        compared: What rows are compared by: "share", the interquartile mean of the shares of the yardstick, or "score",
            the mean score in mm/s, where the yardstick does not know the plant and shares of it say little.

    Returns:
        ``rows``: for each row its seeds, the interquartile mean of the shares of the yardstick with its interval, that
        of each seed, and the mean of each measure with its interval; ``beats``: the probability that the first scores
        more than the second; ``compared``; ``statement``: see :func:`statement`.
    """
    drawn = draws(strata, max(len(each) for each in runs.values()))
    shares = shares_of(runs)
    share_draws = {name: resampled(each, drawn) for name, each in shares.items()}
    rows = {}
    for name, each in runs.items():
        rows[name] = {
            "runs": len(each),
            "share": _listed(interval(iqm(shares[name]), share_draws[name])),
            "share_of_runs": [iqm(run[None]) for run in shares[name]],
        }
        rows[name] |= {measure: _mean(values_of(each, measure), drawn) for measure in MEASURES}
    beats = {name: {other: chance(shares[name], shares[other]) for other in runs if other != name} for name in runs}
    values, values_draws = {name: row[compared][0] for name, row in rows.items()}, share_draws
    if compared == "score":
        values_draws = {name: resampled(values_of(each, "score"), drawn, mean=True) for name, each in runs.items()}
    return {
        "yardstick": YARDSTICK,
        "least_yardstick": float(values_of(runs[YARDSTICK], "score").min()),
        "rows": rows,
        "beats": beats,
        "compared": compared,
        "statement": statement(values, values_draws, {name: (row["runs"], row["share"]) for name, row in rows.items()}),
    }


def values_of(runs: list[dict[str, Any]], measure: str) -> np.ndarray:
    """(runs, episodes) a measure, NaN where an episode has none, or a record of before does not have the measure."""
    return np.array(
        [
            [math.nan if x is None else x for x in run["episodes"].get(measure, [None] * len(run["episodes"]["score"]))]
            for run in runs
        ]
    )


def shares_of(runs: Mapping[str, list[dict[str, Any]]]) -> dict[str, np.ndarray]:
    """(runs, episodes) of each row: the score in an episode over the yardstick's in it."""
    yardstick = values_of(runs[YARDSTICK], "score")[0]
    return {name: values_of(each, "score") / yardstick for name, each in runs.items()}


def _mean(values: np.ndarray, drawn: Draws) -> list[float | None]:
    """Mean of a measure over runs and episodes, and its interval; nothing where an episode has none of it."""
    if not np.isfinite(values).all():
        known = values[np.isfinite(values)]
        return [float(known.mean()) if known.size else None, None, None]
    return [*_listed(interval(float(values.mean()), resampled(values, drawn, mean=True)))]


def statement(
    values: Mapping[str, float], values_draws: Mapping[str, np.ndarray], rows: Mapping[str, tuple[int, list[float]]]
) -> dict[str, dict[str, Any]]:
    """For each row of several seeds: does it beat NEITHER, and is it good enough?

    ``differences`` to the others, the best of them first, have intervals from pairs of resamples. That the best of them
    is the best on these very episodes flatters it.

    Args:
        values: Of each row, what it is compared by.
        values_draws: The same in each resample.
        rows: How many runs each row has, and its share of the yardstick with the interval.
    """
    others = sorted((name for name in NEITHER if name in rows), key=lambda name: -values[name])
    found = {}
    for name in rows if others else ():
        seeds, share = rows[name]
        # rows that are not of this package count where their seeds are enough for a statement
        if name not in REPEATED and (name in NEITHER or seeds < SEEDS):
            continue
        enough_seeds = seeds >= SEEDS
        differences = {
            other: interval(values[name] - values[other], values_draws[name] - values_draws[other]) for other in others
        }
        found[name] = {
            "seeds": seeds,
            "share": share,
            "reaches_enough": enough_seeds and share[1] >= ENOUGH,
            "differences": {other: _listed(each) for other, each in differences.items()},
            "beats": [other for other, each in differences.items() if enough_seeds and each.low > 0.0],
            "loses_to": [other for other, each in differences.items() if enough_seeds and each.high < 0.0],
        }
    return found


def _listed(found: Interval) -> list[float]:
    return [found.value, found.low, found.high]
