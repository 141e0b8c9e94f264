"""Faults that one channel shows by itself: no numbers, a value that sticks, a ceiling, missing time.

Every function takes samples and returns a mask or stretches of sample numbers; none changes what it is given.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

ABSURD = 1e12
"""SI. No channel of a rig reaches it, in whatever unit it was mistaken for."""
NOTHING = 1e-30
"""SI. What moves less does not move."""
SPIKE, ALONE = 100.0, 10.0
"""Times the size that one sample of a hundred exceeds, and times that of its neighbours."""

LEAST_RUN = 5
"""Equal samples in a row that are looked at. A sensor's noise makes two or three equal by chance."""
AROUND = 64
"""Samples on either side of a run that tell what the sensor does there when it works."""
BY_CHANCE = 1e-9
"""A run this improbable sticks."""
MOST_RUNS = 2000
"""Looked at in one channel, the longest first."""

LIKE_NOISE = 0.9
"""Second differences over first ones: sqrt(3) for white noise, far less for a smooth series."""
NOISY = 0.3
"""The share of its windows that are noise, from which a channel has noise to lose."""
LEAST_EDGE = 0.05
"""Of the usual step: a smaller step into a run is coming to rest."""
FAR = 8.0
"""Times its usual steps, from which a smooth channel jumps."""

LEAST_AT_RAIL, SURELY_AT_RAIL = 5, 10
"""Samples exactly at the largest value before it is called a ceiling: of neighbours, and of single ones."""
RAIL_TO_NEXT = 5.0
"""How many times as often the largest value must occur as the next ones. A smooth peak that is quantised spends
1 / (sqrt(2) - 1) = 2.4 times as long in its top step as in the next, whatever its height, and 3.3 times as long as in
each of the next four on average."""
NEXT_LEVELS = 4


class Run(NamedTuple):
    """Equal samples in a row."""

    start: int
    stop: int
    """One past the last."""
    value: float


def stretches(mask: Mask, join: int = 1) -> list[tuple[int, int]]:
    """(start, stop) of each run of True, stop one past it; runs less than ``join`` samples apart are one."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    found: list[tuple[int, int]] = []
    for start, stop in edges.reshape(-1, 2).tolist():
        if found and start - found[-1][1] < join:
            found[-1] = (found[-1][0], stop)
        else:
            found.append((start, stop))
    return found


def spikes(samples: Floats) -> Mask:
    """Values that are no measurement: beyond any rig, or alone and out of all proportion to the rest.

    The blow of a hammer is out of proportion too, but its samples are not alone.
    """
    size = np.abs(samples)
    beside = np.maximum(np.concatenate(([0.0], size[:-1])), np.concatenate((size[1:], [0.0])))
    alone = size > ALONE * beside
    return (size > ABSURD) | (alone & (size > SPIKE * max(NOTHING, float(np.quantile(size, 0.99)))))


def runs_of_equals(samples: Floats, least: int = LEAST_RUN) -> list[Run]:
    """Runs of at least ``least`` equal samples, in order of time."""
    edges = np.flatnonzero(np.concatenate(([True], np.diff(samples) != 0.0, [True])))
    lengths = np.diff(edges)
    long = np.flatnonzero(lengths >= least)
    if long.size > MOST_RUNS:
        long = np.sort(long[np.argsort(-lengths[long], kind="stable")[:MOST_RUNS]])
    return [Run(int(edges[i]), int(edges[i + 1]), float(samples[edges[i]])) for i in long]


class Habits(NamedTuple):
    """What a channel usually does."""

    equal: int
    """Pairs of neighbours that are equal."""
    step: float
    """Root mean square of the differences between neighbours."""
    noisy: float
    """The share of its windows that are noise."""


def habits(samples: Floats) -> Habits:
    """What a channel usually does."""
    steps = np.diff(samples)
    windows = samples[: samples.size // AROUND * AROUND].reshape(-1, AROUND)
    noisy = float(np.mean(_are_noise(windows))) if windows.size else 0.0
    return Habits(int(np.count_nonzero(steps == 0.0)), math.sqrt(float(np.mean(steps**2))), noisy)


def sticks(samples: Floats, run: Run, usual: Habits) -> bool:
    """Whether a run of a sensor that always moves is too long to be chance.

    Either the channel as a whole hardly ever repeats a value, or it does, as a coarse converter makes it, but less so
    just before and after the run, where it is noise.
    """
    if _is_improbable(samples, run, usual):
        return True
    sides = [samples[max(0, run.start - AROUND) : run.start], samples[run.stop : run.stop + AROUND]]
    sides = [side for side in sides if side.size >= 8]
    if not sides or not all(_are_noise(side[None]).all() for side in sides):
        return False
    beside = sum(int(np.count_nonzero(np.diff(side) == 0.0)) for side in sides)
    return _is_long(run, beside, sum(side.size - 1 for side in sides), samples.size)


def loses_its_noise(samples: Floats, run: Run, usual: Habits) -> bool:
    """Whether a run of a channel that may rightly stay, of a body at rest or a commanded force, lacks its noise.

    The channel must be noise for a good part of the time, hardly ever repeat a value otherwise, and come to or leave
    the run in a step of the noise's size: what comes to rest comes in smaller and smaller steps.
    """
    if usual.noisy < NOISY or not _is_improbable(samples, run, usual):
        return False
    return _edge(samples, run) >= LEAST_EDGE * usual.step


def jumps_out(samples: Floats, run: Run) -> bool:
    """Whether a smooth channel that is held at a value jumps, on either side, by far more than it moves near by."""
    before = samples[max(0, run.start - 4 * AROUND) : run.start]
    after = samples[run.stop : run.stop + 4 * AROUND]
    near = np.abs(np.concatenate((np.diff(before), np.diff(after))))
    if near.size < 8:
        return False
    usual = float(np.quantile(near, 0.98))
    return usual > 0.0 and _edge(samples, run) > FAR * usual


def _edge(samples: Floats, run: Run) -> float:
    """The larger of the steps into a run and out of it."""
    edges = [*samples[max(0, run.start - 1) : run.start], *samples[run.stop : run.stop + 1]]
    return max((abs(float(edge) - run.value) for edge in edges), default=0.0)


def _is_improbable(samples: Floats, run: Run, usual: Habits) -> bool:
    """Whether a run is too long, going by how often neighbours are equal in all the rest of the channel."""
    own = run.stop - run.start - 1
    return _is_long(run, usual.equal - own, samples.size - 1 - own, samples.size)


def _is_long(run: Run, equal: int, pairs: int, places: int) -> bool:
    """Whether such a run, begun at any of many places, is improbable where so many of the pairs are equal."""
    chance = min(1.0, (equal + 1) / (pairs + 2))
    return math.log(places) + (run.stop - run.start - 1) * math.log(chance) < math.log(BY_CHANCE)


def _are_noise(windows: Floats) -> Mask:
    """(windows,) whether neighbours differ at random: then second differences are sqrt(3) times first ones."""
    first = np.abs(np.diff(windows, axis=1)).mean(axis=1)
    second = np.abs(np.diff(windows, 2, axis=1)).mean(axis=1)
    return (second > LIKE_NOISE * first) & (first > 0.0)


def at_ceiling(samples: Floats) -> Mask:
    """Where the samples stand at a largest value that they reach too often and leave too abruptly to be a peak.

    ``at_ceiling(-samples)`` finds the floor.
    """
    none = np.zeros(samples.size, dtype=bool)
    top = samples.max()
    there = samples == top
    count = int(np.count_nonzero(there))
    if count < LEAST_AT_RAIL or top == samples.min():
        return none
    if count < SURELY_AT_RAIL and max(stop - start for start, stop in stretches(there)) < 2:
        return none
    # the step of the converter, or what separates neighbours where there is none
    below = np.unique(samples[~there])[-1000:]
    step = max(float(top - below[-1]), float(np.median(np.diff(below)))) if below.size > 1 else float(top - below[-1])
    next_ones = int(np.count_nonzero((samples < top) & (samples >= top - (NEXT_LEVELS + 0.5) * step)))
    return there if count > RAIL_TO_NEXT * max(next_ones / NEXT_LEVELS, 0.25) else none


def time_jumps(clock: Floats, sample_rate: float) -> list[tuple[int, float]]:
    """(sample, s) where the file's own time goes on by more than a sample too much, or backwards.

    ``sample`` is the first after the jump, and the seconds are what is missing there (below 0: what is repeated). A
    time written with few digits moves in steps; those are no jumps.
    """
    steps = np.diff(clock)
    middle = float(np.median(steps))
    usual = middle if middle > 0.0 else 1.0 / sample_rate
    digits = float(np.min(steps[steps > 0.0], initial=np.inf))
    coarse = 1.01 * digits if 1.5 * usual < digits < np.inf else 1.5 * float(np.quantile(np.abs(steps - usual), 0.9))
    odd = np.flatnonzero(np.abs(steps - usual) > max(0.75 * usual, coarse))
    return [(int(i) + 1, float(steps[i] - usual)) for i in odd]


def rate_of(clock: Floats) -> float:
    """Samples a second by the file's own time, jumps left aside; NaN where it does not go forward."""
    lag = max(1, clock.size // 10)
    step = float(np.median(clock[lag:] - clock[:-lag])) / lag
    return 1.0 / step if step > 0.0 else math.nan
