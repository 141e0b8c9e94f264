"""What truly happened in a control interval, from the sums and the impacts that an engine kept."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.env.plant import (
    DEPTH,
    FREQUENCY,
    HARMONICS,
    INTERVAL,
    LAST_PEAK,
    LAST_TURNS,
    LAYER,
    LAYER_KL,
    LAYER_KU,
    PRESSURE,
    S_CONTACT_TIME,
    S_CONTACTS,
    S_CYCLES,
    S_DRIVE,
    S_KEPT,
    S_PENETRATION,
    S_ROCK,
    S_WAVES,
    VALVE,
    VOLTAGE,
)

SEEN = 50.0
"""The smallest impact in N that the load cell tells from its noise. Weaker taps are impacts to the label only."""
REPEATS = 0.1
"""A blow repeats the last one where their peaks differ by less than this share."""
LONGEST_PERIOD = 8
"""The largest n of a P-n-I-m that is looked for in an interval."""
SAME = 0.02
"""Cycles are the same to the label where their impacts differ by less than this share of the largest peak."""
CYCLES_COMPARED = 24
"""Cycles at the end of an interval over which a motion has to repeat; all of them where the interval has fewer."""

TRUTH = (
    "penetration_rate",
    "impacts_per_cycle",
    "contacts_per_cycle",
    "contact_share",
    "mean_peak_force",
    "largest_peak_force",
    "peak_force_spread",
    "period_two",
    "half_harmonic",
    "first_harmonic",
    "second_harmonic",
    "third_harmonic",
    "single_share",
    "strong_share",
    "force_excess",
    "drive_power",
    "rock_power",
    "motion_period",
    "motion_impacts",
    "frequency",
    "amplitude",
    "valve_pressure",
    "pressure",
    "loading_stiffness",
    "unloading_stiffness",
    "layer",
    "depth",
)
"""The columns of a row of truth. In mm/s; 1; 1; 1; N, N, N; 1; four in m/s^2; 1, 1; N; W, W; P-n-I-m as n and m (0
where the motion did not repeat); Hz, V, bar, bar; N/m, N/m; 1; mm."""
(
    T_RATE,
    T_IMPACTS,
    T_CONTACTS,
    T_SHARE,
    T_MEAN,
    T_LARGEST,
    T_SPREAD,
    T_TWO,
    T_HALF,
    _T_FIRST,
    _T_SECOND,
    _T_THIRD,
    T_SINGLE,
    T_STRONG,
    T_EXCESS,
    T_DRIVE,
    T_ROCK,
    T_PERIOD,
    T_LABEL,
    T_FREQUENCY,
    T_AMPLITUDE,
    T_VALVE,
    T_PRESSURE,
    T_KL,
    T_KU,
    T_LAYER,
    T_DEPTH,
) = range(len(TRUTH))
TRUTH_SIZE = len(TRUTH)
MOST_CYCLES = 64
"""Room for the excitation periods of an interval: 62.5 at 250 Hz, the most that a Setting takes."""


@njit(**INLINE)
def by_cycle(peaks: np.ndarray, kept: int, cycles: np.ndarray) -> int:
    """Sort impacts into excitation periods: rows of ``cycles`` get count, largest and summed peak. Returns the rows.

    A period begins half a turn before the phase of the strongest impact, far from where impacts jitter.
    """
    strongest = 0
    for j in range(1, kept):
        if peaks[j, 1] > peaks[strongest, 1]:
            strongest = j
    offset = 0.5 - (peaks[strongest, 0] - math.floor(peaks[strongest, 0])) if kept else 0.0
    cycles[:] = 0.0
    whole = 0
    for j in range(kept):
        cycle = math.floor(peaks[j, 0] + offset)
        if 0 <= cycle < cycles.shape[0]:
            cycles[cycle, 0] += 1.0
            cycles[cycle, 1] = max(cycles[cycle, 1], peaks[j, 1])
            cycles[cycle, 2] += peaks[j, 1]
            whole = max(whole, cycle)
    return whole


@njit(**INLINE)
def motion_label(cycles: np.ndarray, whole: int, largest: float) -> tuple[int, float]:
    """The smallest n <= LONGEST_PERIOD with which the impacts repeat, and the impacts in n periods; 0, 0 for none.

    The first and the last period are left out: the interval may have cut them.
    """
    first = max(1, whole - CYCLES_COMPARED)
    tolerance = SAME * largest
    for n in range(1, LONGEST_PERIOD + 1):
        if whole - first < 2 * n:
            break
        same = True
        for j in range(first + n, whole):
            before = j - n
            if cycles[j, 0] != cycles[before, 0] or not (
                abs(cycles[j, 1] - cycles[before, 1]) <= tolerance
                and abs(cycles[j, 2] - cycles[before, 2]) <= tolerance
            ):
                same = False
                break
        if same:
            impacts = 0.0
            for j in range(whole - n, whole):
                impacts += cycles[j, 0]
            return (n, impacts) if impacts > 0.0 else (0, 0.0)
    return 0, 0.0


@njit(**KERNEL)
def summarise(
    sums: np.ndarray,
    peaks: np.ndarray,
    turns: float,
    rating: float,
    cycles: np.ndarray,
    layers: np.ndarray,
    memory: np.ndarray,
    truth: np.ndarray,
) -> None:
    """Fill a row of ``truth`` (TRUTH_SIZE,).

    Args:
        sums, peaks: Of the interval, see :func:`drillenv.env.plant.drill`.
        turns: Turns of the excitation at the start of the interval, in which ``memory`` counts.
        rating: Contact force in N above which the tool wears.
        cycles: (MOST_CYCLES, 3) working memory.
        layers, memory: Rows of the rig's Plants.
        truth: (TRUTH_SIZE,) to fill.
    """
    sums, peaks, cycles = borrowed(sums), borrowed(peaks), borrowed(cycles)
    layers, memory, truth = borrowed(layers), borrowed(memory), borrowed(truth)
    kept = int(sums[S_KEPT])
    duration = sums[S_CYCLES]
    seen, total, squares, largest, excess, single, strong = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    last_turns, last_peak = memory[LAST_TURNS], memory[LAST_PEAK]
    for j in range(kept):
        force, when = peaks[j, 1], turns + peaks[j, 0]
        if force < SEEN:
            continue
        seen += 1.0
        total += force
        largest = max(largest, force)
        excess += max(0.0, force - rating)
        alone = 0.75 < when - last_turns < 1.25
        if alone and abs(force - last_peak) <= REPEATS * max(force, last_peak):
            single += 1.0
            strong += min(1.0, force / rating)
        last_turns, last_peak = when, force
    memory[LAST_TURNS], memory[LAST_PEAK] = last_turns, last_peak
    mean = total / seen if seen > 0.0 else 0.0
    for j in range(kept):
        if peaks[j, 1] >= SEEN:
            squares += (peaks[j, 1] - mean) ** 2
    whole = by_cycle(peaks, kept, cycles)
    change, level = 0.0, 0.0
    for j in range(1, whole):
        level += cycles[j, 1]
        if j > 1:
            change += abs(cycles[j, 1] - cycles[j - 1, 1])
    period, impacts = motion_label(cycles, whole, largest)

    truth[T_RATE] = 1e3 * sums[S_PENETRATION] / INTERVAL
    truth[T_IMPACTS] = seen / duration
    truth[T_CONTACTS] = sums[S_CONTACTS] / duration
    truth[T_SHARE] = sums[S_CONTACT_TIME] / INTERVAL
    truth[T_MEAN] = mean
    truth[T_LARGEST] = largest
    truth[T_SPREAD] = math.sqrt(squares / seen) if seen > 0.0 else 0.0
    truth[T_TWO] = change / level if level > 0.0 else 0.0
    for harmonic in range(HARMONICS):
        at = S_WAVES + 2 * harmonic
        truth[T_HALF + harmonic] = math.sqrt(sums[at] ** 2 + sums[at + 1] ** 2)
    truth[T_SINGLE] = min(1.0, single / duration)
    truth[T_STRONG] = min(1.0, strong / duration)
    truth[T_EXCESS] = excess / duration
    truth[T_DRIVE] = sums[S_DRIVE] / INTERVAL
    truth[T_ROCK] = sums[S_ROCK] / INTERVAL
    truth[T_PERIOD], truth[T_LABEL] = period, impacts
    truth[T_FREQUENCY], truth[T_AMPLITUDE] = memory[FREQUENCY], memory[VOLTAGE]
    truth[T_VALVE], truth[T_PRESSURE] = memory[VALVE], memory[PRESSURE]
    layer = int(memory[LAYER])
    truth[T_KL], truth[T_KU] = layers[layer, LAYER_KL], layers[layer, LAYER_KU]
    truth[T_LAYER] = layer
    memory[DEPTH] += sums[S_PENETRATION]
    truth[T_DEPTH] = 1e3 * memory[DEPTH]
