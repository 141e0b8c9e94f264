"""Faults of one-body recordings that only physics shows: swapped channels, turned signs, mistaken units.

Position, velocity and acceleration are integrals of each other; force over acceleration is a mass, above zero and in
all recordings the same; without a force, acceleration falls with position. Each of these balances ties two channels. A
channel is at fault where it explains all the balances that fail and none that hold.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.campaign import Campaign, Recording
from drillenv.recordings.document import Nominal
from drillenv.recordings.findings import (
    EXCLUDE_RECORDING,
    QualityFinding,
    here_and_there,
    how_often,
    severity_of,
    throughout,
)
from drillenv.recordings.signal_faults import runs_of_equals
from drillenv.recordings.units import CHANNEL_UNITS, how_much, slip_of

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOVING = ("position", "velocity", "acceleration")
LEAST_SAMPLES = 50
SAME_SHAPE = 0.9
"""Correlation from which one channel is taken for the integral of another."""
SAME_SIZE = 0.3
"""log: a swap is believed where the swapped channels fit each other this well in size, too."""
EXPLAINED, FAILS = 0.8, 0.5
"""Share of the force's variance that a force balance explains where the channels are right, and where they are not."""
COUNTS = 0.3
"""Partial correlation from which a coefficient says something."""
MOST_FITTED = 5000
"""Samples enter a fit, evenly spread: what it is to tell apart differs by factors."""
LEAST_HELD = 8
"""Equal samples in a row that are held against the force balance."""
SMOOTHINGS = (5, 11, 21, 41, 81)
"""Samples over which a channel is smoothed to be differentiated; the one that explains the force best is taken."""


class _Tie(NamedTuple):
    """One balance: how many times too large ``above`` reads against ``below``, with its sign."""

    above: str
    below: str
    ratio: float
    """1 where both are right."""
    why: str


class _Fit(NamedTuple):
    """One channel explained by others, by least squares."""

    first: float
    """The coefficient of the first column."""
    counts: float
    """The partial correlation of the first column."""
    explained: float
    """The share of the variance explained."""
    left: Floats
    """(samples,) what is not explained."""


def check_body(campaign: Campaign, bad: Mapping[str, Mapping[str, Mask]]) -> list[QualityFinding]:
    """Findings on the recordings of a one-body campaign.

    Args:
        campaign: The campaign; a mass or stiffness that nobody states is compared between its recordings.
        bad: For each recording and channel the samples already found faulty.
    """
    found: list[QualityFinding] = []
    ties: dict[str, list[_Tie]] = {}
    sizes: dict[str, tuple[_Tie, float]] = {}
    for recording in campaign.recordings:
        if "position" not in recording.channels:
            text = "there is no channel position: without it the law of the body cannot be told"
            found.append(throughout(recording, "position", "missing-channel", text, EXCLUDE_RECORDING))
        series = _usable(recording, bad[recording.name])
        swapped = _swapped(recording, series, campaign.nominal)
        found += swapped
        if swapped:
            continue
        ties[recording.name] = _motion_ties(series, recording.sample_rate)
        size = _law_size(series, recording.sample_rate, campaign.nominal)
        if size is not None:
            sizes[recording.name] = size
    for recording in campaign.recordings:
        if recording.name in ties:
            others = [value for name, (_, value) in sizes.items() if name != recording.name]
            all_ties = ties[recording.name] + _law_ties(sizes.get(recording.name), others)
            judged = _judged(recording, all_ties)
            found += judged or _held(recording, bad[recording.name], campaign.nominal)
    return found


def _usable(recording: Recording, bad: Mapping[str, Mask]) -> dict[str, Floats]:
    """Copies of the channels that move, straight lines over what is bad, for looking at only."""
    found = {}
    for name in ("force", *MOVING):
        if name not in recording.channels or recording.size < LEAST_SAMPLES:
            continue
        good = np.flatnonzero(~bad[name])
        samples = recording.channels[name].samples
        if good.size > 0.5 * samples.size and np.ptp(samples[good]) > 0.0:
            found[name] = np.interp(np.arange(samples.size), good, samples[good])
    return found


# --------------------------------------------------------------------------------------------------------------------
# balances


def _motion_ties(series: Mapping[str, Floats], rate: float) -> list[_Tie]:
    """Position against velocity and velocity against acceleration, or position against acceleration."""
    found = []
    for above, below, ratio, alike in _compared(series, rate):
        if alike > SAME_SHAPE:
            what = "the integral of " if "velocity" in (above, below) else "twice the integral of "
            found.append(_Tie(above, below, ratio, f"{above} against {what}{below}"))
    return found


def _compared(series: Mapping[str, Floats], rate: float) -> list[tuple[str, str, float, float]]:
    """(channel, the one that it should be an integral of, ratio, correlation), for each such pair of channels."""
    found = []
    for above, below in itertools.pairwise(MOVING):
        if above in series and below in series:
            found.append((above, below, *_against_integral(series[above], series[below], rate)))
    if "velocity" not in series and {"position", "acceleration"} <= series.keys():
        found.append(("position", "acceleration", *_against_second(series["position"], series["acceleration"], rate)))
    return found


def _against_integral(above: Floats, below: Floats, rate: float) -> tuple[float, float]:
    """(ratio, correlation) of a channel to the integral of another, less trends, which an offset would make."""
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (below[1:] + below[:-1])))) / rate
    time = np.linspace(-1.0, 1.0, above.size)
    both = np.column_stack((above, integral))
    both = both - np.column_stack([np.polynomial.Polynomial.fit(time, one, 1)(time) for one in both.T])
    left, right = both[:, 0], both[:, 1]
    scale = math.sqrt(float(left @ left) * float(right @ right))
    if scale == 0.0:
        return math.nan, 0.0
    # the slope between noisy series that belong together: neither regression, but the ratio of their sizes
    product = float(left @ right)
    return math.copysign(math.sqrt(float(left @ left) / float(right @ right)), product), abs(product) / scale


def _against_second(position: Floats, acceleration: Floats, rate: float) -> tuple[float, float]:
    """(ratio, correlation) of a position to twice the integral of an acceleration, told from its second derivative."""
    from scipy.signal import savgol_filter

    best = (math.nan, 0.0)
    for window in SMOOTHINGS:
        if window >= position.size:
            break
        second = np.asarray(savgol_filter(position, window, 3, deriv=2, delta=1.0 / rate))
        smooth = np.asarray(savgol_filter(acceleration, window, 3))
        second, smooth = second - second.mean(), smooth - smooth.mean()
        scale = math.sqrt(float(second @ second) * float(smooth @ smooth))
        product = float(second @ smooth)
        if scale > 0.0 and abs(product) / scale > best[1]:
            size = math.sqrt(float(second @ second) / float(smooth @ smooth))
            best = (math.copysign(size, product), abs(product) / scale)
    return best


def _law_size(series: Mapping[str, Floats], rate: float, nominal: Mapping[str, Nominal]) -> tuple[_Tie, float] | None:
    """The mass, or without a force the stiffness, that these samples make; as a tie over what is stated of it, or 1."""
    fit = _law(series, rate, nominal)
    if fit is None or fit.counts < COUNTS:
        return None
    if "force" in series:
        if fit.explained < FAILS:
            return None
        stated = nominal["mass"].value
        tie = _Tie("force", _source(series), fit.first / (stated or 1.0), "the mass that they make" if stated else "")
        return tie, fit.first
    if "stiffness" not in nominal:
        return None
    stiffness = -fit.first * (nominal["mass"].value or 1.0)
    stated = nominal["stiffness"].value if nominal["mass"].value else None
    tie = _Tie(
        "acceleration", "position", stiffness / (stated or 1.0), "the stiffness that they make" if stated else ""
    )
    return tie, stiffness


def _source(series: Mapping[str, Floats]) -> str:
    """The channel from which the acceleration is had: itself, or what needs least differentiating."""
    return next(name for name in reversed(MOVING) if name in series)


def _law(series: Mapping[str, Floats], rate: float, nominal: Mapping[str, Nominal]) -> _Fit | None:
    """The force explained by acceleration first and the law; without a force, the acceleration by position first."""
    if "force" in series and any(name in series for name in MOVING):
        return _mass(series, _source(series), rate, "stiffness" in nominal)
    if {"position", "acceleration"} <= series.keys():
        columns = [series[name] for name in ("position", "velocity") if name in series]
        return _fitted(series["acceleration"], [*columns, np.ones(columns[0].size)])
    return None


def _mass(series: Mapping[str, Floats], source: str, rate: float, spring: bool) -> _Fit:
    """The force explained by mass * acceleration, speed, its sign, position where there is a spring, and an offset."""
    from scipy.signal import savgol_filter

    order = len(MOVING) - 1 - MOVING.index(source)
    best = _Fit(math.nan, 0.0, 0.0, np.zeros(series[source].size))
    for window in SMOOTHINGS if order else SMOOTHINGS[:1]:
        if window >= series[source].size:
            break

        def smooth(values: Floats, derivative: int, window: int = window) -> Floats:
            return np.asarray(savgol_filter(values, window, 3, deriv=derivative, delta=1.0 / rate))

        columns = [smooth(series[source], order)]
        speed = _speed(series, source, smooth)
        if speed is not None:
            columns += [speed, np.sign(speed)]
        if spring and "position" in series:
            columns.append(smooth(series["position"], 0))
        columns.append(np.ones(columns[0].size))
        best = max(best, _fitted(smooth(series["force"], 0), columns), key=lambda fit: fit.explained)
    return best


def _speed(series: Mapping[str, Floats], source: str, smooth) -> Floats | None:
    """The velocity measured, or else that of the position."""
    if "velocity" in series:
        return smooth(series["velocity"], 0)
    return smooth(series["position"], 1) if "position" in series else None


def _fitted(target: Floats, columns: Sequence[Floats]) -> _Fit:
    every = max(1, target.size // MOST_FITTED)
    table = np.column_stack(columns)
    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    some, aim = table[::every] / scale, target[::every]
    own = some[:, 0] - some[:, 1:] @ np.linalg.lstsq(some[:, 1:], some[:, 0], rcond=None)[0]
    rest = aim - some[:, 1:] @ np.linalg.lstsq(some[:, 1:], aim, rcond=None)[0]
    spread = math.sqrt(float(own @ own) * float(rest @ rest))
    if spread == 0.0:
        return _Fit(math.nan, 0.0, 0.0, np.zeros(target.size))
    fit = np.linalg.lstsq(some, aim, rcond=None)[0] / scale
    left = target - table @ fit
    return _Fit(float(fit[0]), abs(float(own @ rest)) / spread, 1.0 - float(np.var(left)) / float(np.var(target)), left)


def _law_ties(own: tuple[_Tie, float] | None, others: Sequence[float]) -> list[_Tie]:
    """The mass or stiffness against what is stated of it, or else against the other recordings; its sign always."""
    if own is None:
        return []
    tie, value = own
    if tie.why:
        return [tie]
    alike = [abs(other) for other in others]
    what = "mass" if tie.above == "force" else "stiffness"
    if not alike:
        return [tie._replace(ratio=math.copysign(1.0, value), why=f"the sign of the {what} that they make")]
    return [
        tie._replace(ratio=value / float(np.median(alike)), why=f"the {what} that they make, against other recordings")
    ]


# --------------------------------------------------------------------------------------------------------------------
# verdicts


def _judged(recording: Recording, ties: Sequence[_Tie]) -> list[QualityFinding]:
    """Name the channel whose sign, or unit, explains every balance that fails and none that holds."""
    found = []
    turned = {i for i, tie in enumerate(ties) if tie.ratio < 0.0}
    if turned:
        guilty = [name for name in _names(ties) if {i for i, tie in enumerate(ties) if name in tie[:2]} == turned]
        found.append(
            _finding(recording, "sign", guilty or _names(ties[i] for i in turned), ties, turned, "is turned round")
        )
    slips = [slip_of(abs(tie.ratio)) for tie in ties]
    off = {i for i, slip in enumerate(slips) if slip != 0.0}
    if not off:
        return found
    guilty, size = [], ""
    for name in _names(ties):
        too_large = {(1.0 if tie.above == name else -1.0) * slips[i] for i, tie in enumerate(ties) if name in tie[:2]}
        if {i for i, tie in enumerate(ties) if name in tie[:2]} == off and len(too_large) == 1:
            guilty.append(name)
            size = size or how_much(too_large.pop())
    if len(guilty) == 1:
        text = f"reads {size}"
    else:
        text = f"is off by a factor of {math.exp(max(abs(slips[i]) for i in off)):.4g}"
    found.append(_finding(recording, "unit", guilty or _names(ties[i] for i in off), ties, off, text))
    return found


def _names(ties: Iterable[_Tie]) -> list[str]:
    return list(dict.fromkeys(name for tie in ties for name in (tie.above, tie.below)))


def _finding(
    recording: Recording, kind: str, channels: Sequence[str], ties: Sequence[_Tie], which: Iterable[int], what: str
) -> QualityFinding:
    why = "; ".join(ties[i].why for i in sorted(which))
    subject = "it" if len(channels) == 1 else f"one of {', '.join(channels)}"
    unit = ""
    if kind == "unit" and len(channels) == 1:
        stated = recording.channels[channels[0]].unit
        unit = f", or its unit {stated}" if len(CHANNEL_UNITS[channels[0]]) > 1 else ""
    text = f"{subject} {what} (shown by {why}): correct it{unit}"
    return throughout(recording, ", ".join(channels), kind, text, EXCLUDE_RECORDING)


def _held(recording: Recording, bad: Mapping[str, Mask], nominal: Mapping[str, Nominal]) -> list[QualityFinding]:
    """A value that stays while the law of the body shows that it cannot have."""
    series = _usable(recording, bad)
    fit = _law(series, recording.sample_rate, nominal)
    if fit is None or fit.explained < FAILS:
        return []
    target = "force" if "force" in series else "acceleration"
    quiet = np.sort(np.abs(fit.left))[: max(1, fit.left.size // 2)]
    least = max(0.3 * float(np.std(series[target])), 4.0 * math.sqrt(float(np.mean(quiet**2))))
    found = []
    for name in ("force", "acceleration"):
        if name not in series:
            continue
        where = [
            (run.start, run.stop)
            for run in runs_of_equals(recording.channels[name].samples, LEAST_HELD)
            if not bad[name][run.start : run.stop].any()
            and math.sqrt(float(np.mean(fit.left[run.start : run.stop] ** 2))) > least
        ]
        if where:
            text = (
                f"it stays at one value {how_often(where)} while the force balance shows that it moved: leave these "
                "stretches out"
            )
            severity = severity_of(recording, where, False)
            found.append(here_and_there(recording, name, "dropout", where, text, severity))
    return found


def _swapped(
    recording: Recording, series: Mapping[str, Floats], nominal: Mapping[str, Nominal]
) -> list[QualityFinding]:
    """Channels that hold each other's samples: wrong as they are, and right in exactly one other order."""
    names, rate = list(series), recording.sample_rate
    if not _compared(series, rate):
        held = _swapped_with_force(series, rate, nominal)
    else:
        orders = itertools.permutations(names)
        found = {order: _sound({n: series[s] for n, s in zip(names, order, strict=True)}, rate) for order in orders}
        own = found.pop(tuple(names))
        # As they are, one is not even the shape of the other's integral; or it is, as in an oscillation, but not its
        # size, and some other order is right in everything.
        most = max(found.values(), default=(0, 0))
        best = [order for order, sound in found.items() if sound == most]
        tested = len(_compared(series, rate))
        believed = most[0] > own[0] and (own[1] == 0 or most[0] == tested)
        held = dict(zip(names, best[0], strict=True)) if len(best) == 1 and believed else {}
    held = {name: source for name, source in held.items() if name != source}
    if not held:
        return []
    looks = "; ".join(f"{source} holds what looks like the {name}" for name, source in held.items())
    text = f"{looks}: give each channel its own column"
    return [throughout(recording, ", ".join(held), "swapped", text, EXCLUDE_RECORDING)]


def _sound(series: Mapping[str, Floats], rate: float) -> tuple[int, int]:
    """(pairs of channels right in shape and size, 1 if the first pair has the right shape)."""
    pairs = _compared(series, rate)
    right = [alike > SAME_SHAPE and abs(math.log(abs(ratio))) < SAME_SIZE for _, _, ratio, alike in pairs]
    return sum(right), int(pairs[0][3] > SAME_SHAPE)


def _swapped_with_force(series: Mapping[str, Floats], rate: float, nominal: Mapping[str, Nominal]) -> dict[str, str]:
    """Force and position exchanged, where nothing else was measured: known by the force balance."""
    if set(series) != {"force", "position"}:
        return {}
    spring = "stiffness" in nominal
    if _mass(series, "position", rate, spring).explained > FAILS:
        return {}
    exchanged = {"force": series["position"], "position": series["force"]}
    if _mass(exchanged, "position", rate, spring).explained < EXPLAINED:
        return {}
    return {"force": "position", "position": "force"}
