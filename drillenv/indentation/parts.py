"""The parts of an indentation test: indentations, what is out of contact, holds at the peak, loading and unloading."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError
from drillenv.indentation.reading import Curve

Floats = NDArray[np.float64]

HYSTERESIS = 0.2
"""Share of the range of the force by which it must turn back before an indentation counts."""
NOISE_TURNS = 8.0
"""The same in standard deviations of the noise, where that is more."""
RISEN = (0.04, 0.12, 0.36)
"""Shares of the peak force from which the contact's beginning is judged."""
LOWEST, HIGHEST = 0.03, 0.97
"""Shares of the peak force between which a branch is fitted: the toe and the rounded peak are left out."""
PLATEAU = 0.985
"""Share of the peak force, and of the deepest displacement, above which the load may be held."""
HOLD = 2.0
"""So many times as long as loading and unloading would stay there, a stay at the peak is a hold."""
FEWEST_IN_BRANCH = 12
FEWEST_FREE = 10
MOST_STEPS = 20_000
"""Samples, or means of neighbouring ones, between which turns are looked for."""


class Indentation(NamedTuple):
    """One load and unload, as places in the curve."""

    begin: int
    peak: int
    end: int


class Window(NamedTuple):
    """The parts of an indentation that are fitted, as places in the curve."""

    loading: slice
    unloading: slice
    hold: slice | None
    """Between the branches, where the load was held."""


def smoothed(values: Floats, width: int) -> Floats:
    """(samples,) the mean over ``width`` samples around each, fewer at the ends."""
    if width < 2:
        return values
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(values.size)
    low, high = np.maximum(at - width // 2, 0), np.minimum(at + (width + 1) // 2, values.size)
    return (total[high] - total[low]) / (high - low)


def white_noise(values: Floats) -> float:
    """Standard deviation of what changes from sample to sample, by second differences and without outliers."""
    second = np.diff(values, 2)
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6.0))


def find_indentations(curve: Curve) -> list[Indentation]:
    """The indentations in order: by their number where the file has it, else by the turns of the force.

    Raises:
        InputError: one of them has no loading or no unloading branch.
    """
    if curve.number is None:
        return _by_turns(curve.force, 0, 1)
    edges = [0, *(np.flatnonzero(np.diff(curve.number)) + 1).tolist(), curve.force.size]
    found = []
    for k, (begin, end) in enumerate(pairwise(edges), 1):
        if end - begin < 2 * FEWEST_IN_BRANCH:
            raise InputError(
                f"indentation {k} has {end - begin} samples: give at least {FEWEST_IN_BRANCH} for each of its branches"
            )
        within = _by_turns(curve.force[begin:end], begin, k)
        highest = max(within, key=lambda each: curve.force[each.peak])
        found.append(Indentation(begin, highest.peak, end))
    return found


def _by_turns(force: Floats, offset: int, first: int) -> list[Indentation]:
    """Indentations between the turns of a force, with hysteresis."""
    step = max(1, force.size // MOST_STEPS)
    thin = force[: force.size // step * step].reshape(-1, step).mean(axis=1)
    calm = smoothed(thin, max(1, thin.size // 400))
    turn = max(HYSTERESIS * float(np.ptp(calm)), NOISE_TURNS * white_noise(thin))
    turns = _turns(thin, turn)
    peaks = [at for at, is_peak in turns if is_peak]
    troughs = [at for at, is_peak in turns if not is_peak]
    if not peaks:
        raise InputError("the force rises and falls nowhere above its noise: give a test with loading and unloading")
    found = []
    for k, peak in enumerate(peaks):
        begin = max((at for at in troughs if at < peak), default=None)
        end = min((at for at in troughs if at > peak), default=None)
        if begin is None:
            raise InputError(
                f"indentation {first + k} has no loading branch, the curve begins under load: "
                "give it from before the contact"
            )
        if end is None:
            raise InputError(
                f"indentation {first + k} has no unloading branch: give the curve until the indenter has left the rock"
            )
        low = 0 if k == 0 else begin * step
        high = force.size if k == len(peaks) - 1 else end * step
        found.append(Indentation(offset + low, offset + peak * step, offset + high))
    return found


def _turns(values: Floats, hysteresis: float) -> list[tuple[int, bool]]:
    """Places of the extremes from which values turn back by more than ``hysteresis``, and whether each is a peak.

    The last extreme counts too if the values came to it by more than that.
    """
    series = values.tolist()
    high = low = 0
    rising: bool | None = None
    found: list[tuple[int, bool]] = []
    for i, value in enumerate(series):
        high = i if value > series[high] else high
        low = i if value < series[low] else low
        if rising is not False and value < series[high] - hysteresis:
            found.append((high, True))
            rising, low = False, i
        elif rising is not True and value > series[low] + hysteresis:
            found.append((low, False))
            rising, high = True, i
    if rising is not None:
        found.append((high, True) if rising else (low, False))
    return found


def zero_guess(force: Floats) -> float:
    """The force out of contact, roughly: where values below a quarter of the range lie closest (half-sample mode)."""
    values = np.sort(force)
    values = values[values < values[0] + 0.25 * (values[-1] - values[0])]
    while values.size > 3:
        half = (values.size + 1) // 2
        at = int(np.argmin(values[half - 1 :] - values[: values.size - half + 1]))
        values = values[at : at + half]
    return float(values.mean())


def out_of_contact(force: Floats, indentations: list[Indentation]) -> list[slice]:
    """The stretches before, between and after indentations in which the indenter does not touch the rock.

    The beginning of the contact is judged from where the force passes 4, 12 and 36 % of its peak, as that of
    a power law. The first and the last stretch are always there, be they empty.
    """
    zero = zero_guess(force)
    edges = []
    for begin, peak, end in indentations:
        calm = smoothed(force[begin:end], max(1, (end - begin) // 300)) - zero
        top = peak - begin
        height = calm[top]
        clear = _before_contact([_last_below(calm[: top + 1], share * height) for share in RISEN])
        clear_after = _before_contact([_last_below(calm[top:][::-1], share * height) for share in RISEN])
        edges.append((begin + max(clear + 1, 0), end - max(clear_after + 1, 0)))
    stretches = [slice(indentations[0].begin, edges[0][0])]
    for (_, leaves), (touches, _) in pairwise(edges):
        if touches - leaves >= FEWEST_FREE:
            stretches.append(slice(leaves, touches))
    return [*stretches, slice(edges[-1][1], indentations[-1].end)]


def _before_contact(places: list[int]) -> int:
    """The last place before the contact, -1 where there is none, from where the force passes thrice as much each time.

    A power law takes q = 3^(1/n) times as long for each further factor of three; a quarter is added for safety.
    """
    low, middle, high = places
    if low < 0:
        return -1
    q = (high - middle) / max(middle - low, 1)
    return max(int(low - 1.25 * (middle - low) / max(q - 1.0, 0.4)) - 1, -1)


def _last_below(values: Floats, level: float) -> int:
    """The last place below a level, -1 where there is none."""
    places = np.flatnonzero(values < level)
    return int(places[-1]) if places.size else -1


def find_window(number: int, displacement: Floats, force: Floats, indentation: Indentation) -> Window:
    """Loading, hold and unloading of an indentation whose force is free of its zero.

    Args:
        number: Of the indentation, for messages.
        displacement, force: (samples,) of the whole curve in m and N.
        indentation: Where it lies.

    Raises:
        InputError: a branch has too few samples.
    """
    begin, peak, end = indentation
    width = max(1, (end - begin) // 150)
    load, depth = smoothed(force[begin:end], width), smoothed(displacement[begin:end], width)
    near = max(peak - begin - width, 0)
    peak = near + int(np.argmax(load[near : peak - begin + width + 1]))
    height = load[peak]
    floor = [
        LOWEST * height if part.min() < LOWEST * height else part.min() + (LOWEST + 0.02) * height
        for part in (load[: peak + 1], load[peak:])
    ]
    # counted, not sought: the first sample beyond a limit is one whose noise took it there
    rise = force[begin : begin + peak + 1]
    first = int(np.count_nonzero(rise < floor[0]))
    rise_end = int(np.count_nonzero(rise < HIGHEST * height))
    held = _plateau(load, depth, peak, first)
    fall = force[begin + held[1] : end]
    fall_begin = held[1] + int(np.count_nonzero(fall > HIGHEST * load[held[1]]))
    fall_end = held[1] + int(np.count_nonzero(fall > floor[1]))
    for name, low, high in (("loading", first, rise_end), ("unloading", fall_begin, fall_end)):
        if high - low < FEWEST_IN_BRANCH:
            raise InputError(
                f"the {name} branch of indentation {number} has {max(high - low, 0)} samples between "
                f"{LOWEST:.0%} and {HIGHEST:.0%} of its peak: give at least {FEWEST_IN_BRANCH}, "
                "sample faster or load slower"
            )
    usual = usual_stay(slice(first, rise_end), slice(fall_begin, fall_end))
    is_hold = held[1] - held[0] > HOLD * usual + width + 5
    hold = slice(begin + held[0], begin + held[1]) if is_hold else None
    return Window(slice(begin + first, begin + rise_end), slice(begin + fall_begin, begin + fall_end), hold)


def usual_stay(loading: slice, unloading: slice) -> float:
    """Samples for which a load that is not held stays as near to its peak as a hold is looked for."""
    return (1.0 - PLATEAU) * (loading.stop - loading.start + unloading.stop - unloading.start) / (HIGHEST - LOWEST)


def _plateau(load: Floats, depth: Floats, peak: int, first: int) -> tuple[int, int]:
    """First and last place around the peak at which the force or the displacement is about as large as it gets."""
    deepest = depth[first:].max()
    fallen = peak + int(np.argmax(load[peak:] < 0.5 * load[peak]))
    # the shorter way: on the way of a soft loading a stiff unloading would be half over
    way = min(deepest - depth[first], 2.0 * (deepest - depth[fallen]))
    near = (load >= PLATEAU * load[peak]) | (depth >= deepest - (1.0 - PLATEAU) * way)
    near[:first] = False
    places = np.flatnonzero(near)
    return int(places[0]), int(places[-1])
