"""The time that a data file gives its samples: which column holds it, in which unit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.units import TIME_UNITS, named_unit, without_unit

CLOCK = "time_s"
"""A column of this name, where no channel claims it, is the file's own time in s, whatever it holds."""
UNSTATED_UNITS = (1.0, 1e-3, 1e-6)
"""s: a time without a unit is in s, ms or us, whichever is nearest to the stated sample rate."""
FARTHEST = 3.0
"""Times the stated sample rate, up to which a time without a unit is taken for one of these."""

_NAMES = re.compile(
    r"(t|time|times|x_?value|zeit|temps|tempo|tiempo|tijd|tid|seconds|timestamps?|zeitstempel"
    r"|(relative|rel|elapsed|elapsed_?real|sample|abs|absolute|mess)_?(time|zeit)|(time|zeit)_?(relative|rel|elapsed|axis)"
    r"|elapsed)"
)
_BLOCKS = 32
_EVEN = 0.02
"""Of the usual pace, by which that of a block may differ; beyond it time is taken to jump there."""
_MOST_UNEVEN = 0.25
"""Of the blocks."""


class Clock(NamedTuple):
    """The file's own time."""

    samples: NDArray[np.float64]
    """(samples,) as the file holds it."""
    column: str
    """Where it stands."""
    units: tuple[float, ...] = (1.0,)
    """s of its unit; several where the file does not say which."""


def is_time_name(name: str) -> bool:
    """Whether a column of this name, its unit left aside, usually holds the time."""
    for part in (name, name.split("/")[-1]):
        bare = without_unit(part).strip().lower().replace(" ", "_").replace("-", "_")
        if _NAMES.fullmatch(bare):
            return True
    return name == CLOCK


def time_names(names: Iterable[str], claimed: Iterable[str]) -> list[str]:
    """Those of ``names`` that usually hold the time and that no channel claims, ``time_s`` first."""
    taken = set(claimed)
    found = [name for name in dict.fromkeys(names) if name not in taken and is_time_name(name)]
    return sorted(found, key=lambda name: name != CLOCK)


def clock_from(
    candidates: Mapping[str, NDArray[np.float64]], size: int, units: Mapping[str, str] | None = None
) -> Clock | None:
    """The first of these columns that holds the time: evenly increasing, one value a sample.

    Args:
        candidates: By name, in the order in which they are to be tried.
        size: Samples of the channels.
        units: What the file says beside the names, where it does.
    """
    for name, samples in candidates.items():
        if name == CLOCK:
            return Clock(samples, name)
        if samples.size == size and increases_evenly(samples):
            unit = named_unit((units or {}).get(name, "")) or named_unit(name)
            stated = TIME_UNITS.get(unit or "")
            return Clock(samples, name, UNSTATED_UNITS if stated is None else (stated,))
    return None


def increases_evenly(samples: NDArray[np.float64]) -> bool:
    """Whether samples go up at one pace, as a time does, but for jumps and the digits that it was written with."""
    if samples.size < 3 or np.count_nonzero(~np.isfinite(samples)) > samples.size // 100:
        return False
    known = samples[np.isfinite(samples)]
    if known.size < 3 or np.count_nonzero(np.diff(known) < 0.0) > max(1, known.size // 100):
        return False
    edges = np.unique(np.linspace(0, known.size - 1, min(_BLOCKS, known.size - 1) + 1).astype(int))
    paces = np.diff(known[edges]) / np.diff(edges)
    usual = float(np.median(paces))
    if not usual > 0.0:
        return False
    steps = np.diff(known)
    digit = float(np.min(steps[steps > 0.0]))  # what the last digit is worth, or the step itself
    slack = _EVEN * usual + digit / np.diff(edges)
    return float(np.mean(np.abs(paces - usual) > slack)) <= _MOST_UNEVEN


def seconds_of(clock: Clock, sample_rate: float) -> NDArray[np.float64] | None:
    """(samples,) s; None where no unit brings the time near the stated sample rate and none is given."""
    if len(clock.units) == 1:
        return clock.samples * clock.units[0]
    lag = max(1, clock.samples.size // 10)
    pace = float(np.nanmedian(clock.samples[lag:] - clock.samples[:-lag])) / lag
    off = [abs(math.log(pace * unit * sample_rate)) if pace > 0.0 else math.inf for unit in clock.units]
    best = int(np.argmin(off))
    return clock.samples * clock.units[best] if off[best] < math.log(FARTHEST) else None
