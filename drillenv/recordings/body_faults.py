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

from drillenv.recordings.body_law import MOVING, compared, law, mass, source_of
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

LEAST_SAMPLES = 50
SAME_SHAPE = 0.9
"""Correlation from which one channel is taken for the integral of another."""
SAME_SIZE = 0.3
"""log: a swap is believed where the swapped channels fit each other this well in size, too."""
EXPLAINED, FAILS = 0.8, 0.5
"""Share of the force's variance that a force balance explains where the channels are right, and where they are not."""
COUNTS = 0.3
"""Partial correlation from which a coefficient says something."""
ON_THE_WAY = 0.2
"""Of the usual speed, at which a body does not stick."""
BEYOND = 0.5
"""Of the range of the samples that a fit was made to."""
SURELY_MOVED = 5.0
"""Steps of the position."""
LEAST_HELD = 8
"""Equal samples in a row that are held against the force balance."""


class _Tie(NamedTuple):
    """One balance: how many times too large ``above`` reads against ``below``, with its sign."""

    above: str
    below: str
    ratio: float
    """1 where both are right."""
    why: str


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
        swapped = _swapped(recording, series)
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
            found += judged or _held(recording, bad[recording.name])
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
    for above, below, ratio, alike in compared(series, rate):
        if alike > SAME_SHAPE:
            what = "the integral of " if "velocity" in (above, below) else "twice the integral of "
            found.append(_Tie(above, below, ratio, f"{above} against {what}{below}"))
    return found


def _law_size(series: Mapping[str, Floats], rate: float, nominal: Mapping[str, Nominal]) -> tuple[_Tie, float] | None:
    """The mass, or without a force the stiffness, that these samples make; as a tie over what is stated of it, or 1."""
    fit = law(series, rate)
    if fit is None or fit.counts < COUNTS:
        return None
    if "force" in series:
        if fit.explained < FAILS:
            return None
        stated = nominal["mass"].value
        tie = _Tie("force", source_of(series), fit.first / (stated or 1.0), "the mass that they make" if stated else "")
        return tie, fit.first
    if "stiffness" not in nominal:
        return None
    stiffness = -fit.first * (nominal["mass"].value or 1.0)
    stated = nominal["stiffness"].value if nominal["mass"].value else None
    why = "the stiffness that they make" if stated else ""
    return _Tie("acceleration", "position", stiffness / (stated or 1.0), why), stiffness


def _law_ties(own: tuple[_Tie, float] | None, others: Sequence[float]) -> list[_Tie]:
    """The mass or stiffness against what is stated of it, or else against the recordings at large; its sign always."""
    if own is None:
        return []
    tie, value = own
    if tie.why:
        return [tie]
    what = "mass" if tie.above == "force" else "stiffness"
    if not others:
        return [tie._replace(ratio=math.copysign(1.0, value), why=f"the sign of the {what} that they make")]
    # One of two cannot be told from the other; of three the middle one counts.
    alike = [abs(other) for other in others] if len(others) == 1 else [abs(other) for other in (*others, value)]
    usual = float(np.median(alike))
    return [tie._replace(ratio=value / usual, why=f"the {what} that they make, against other recordings")]


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


def _held(recording: Recording, bad: Mapping[str, Mask]) -> list[QualityFinding]:
    """Values that stay while another channel shows that they cannot have."""
    series = _usable(recording, bad)
    if not series:
        return []
    runs = {
        name: [
            slice(run.start, run.stop)
            for run in runs_of_equals(recording.channels[name].samples, LEAST_HELD)
            if not bad[name][run.start : run.stop].any()
        ]
        for name in series
    }
    speed = series["velocity"] if "velocity" in series else np.gradient(next(reversed(series.values())))
    usual = _rms(speed)
    on_the_way = {
        name: [part for part in parts if _rms(speed[part]) > ON_THE_WAY * usual] for name, parts in runs.items()
    }
    found = _off_the_law(series, recording.sample_rate, on_the_way)
    if "velocity" in series and "position" in series:
        found["position"] = _passed_over(series, recording.sample_rate, on_the_way["position"])
    findings = []
    for name, parts in found.items():
        if parts:
            where = [(part.start, part.stop) for part in parts]
            text = (
                f"it stays at one value {how_often(where)} while the other channels show that it moved: leave these "
                "stretches out"
            )
            severity = severity_of(recording, where, name == "position")
            findings.append(here_and_there(recording, name, "dropout", where, text, severity))
    return findings


def _off_the_law(series: Mapping[str, Floats], rate: float, runs: Mapping[str, list[slice]]) -> dict[str, list[slice]]:
    """Runs of force and acceleration in which the law of the body, fitted to the rest, fails.

    Only of a body on its way: one that sticks leaves the law too, and may do so under a force that rightly stays.
    """
    names = [name for name in ("force", "acceleration") if runs.get(name)]
    use = np.ones(next(iter(series.values())).size, dtype=bool)
    for part in itertools.chain.from_iterable(runs[name] for name in names):
        use[part] = False
    if not names or np.count_nonzero(use) < 0.5 * use.size:
        return {}
    fit = law(series, rate, use)
    if fit is None or fit.explained < FAILS:
        return {}
    quiet = np.sort(np.abs(fit.left[use]))[: max(1, np.count_nonzero(use) // 2)]
    least = max(0.3 * float(np.std(series["force" if "force" in series else "acceleration"])), 4.0 * _rms(quiet))
    return {
        name: [part for part in runs[name] if _rms(fit.left[part]) > least and _is_known(series, use, part)]
        for name in names
    }


def _is_known(series: Mapping[str, Floats], use: Mask, part: slice) -> bool:
    """Whether a run goes not far beyond where the samples used go: there, a fit says nothing."""
    for name in ("position", "velocity"):
        if name in series:
            low, high = float(series[name][use].min()), float(series[name][use].max())
            beyond = max(low - float(series[name][part].min()), float(series[name][part].max()) - high)
            if beyond > BEYOND * (high - low):
                return False
    return True


def _passed_over(series: Mapping[str, Floats], rate: float, runs: Sequence[slice]) -> list[slice]:
    """Runs of the position over which the velocity carries the body further than the position's own steps are."""
    steps = np.abs(np.diff(series["position"]))
    coarse = float(np.min(steps[steps > 0.0], initial=np.inf))
    return [part for part in runs if abs(float(series["velocity"][part].sum())) / rate > SURELY_MOVED * coarse]


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _swapped(recording: Recording, series: Mapping[str, Floats]) -> list[QualityFinding]:
    """Channels that hold each other's samples: wrong as they are, and right in exactly one other order."""
    rate = recording.sample_rate
    held = _reordered(series, rate) if compared(series, rate) else _swapped_with_force(series, rate)
    if not held:
        return []
    looks = "; ".join(f"{source} holds what looks like the {name}" for name, source in held.items())
    text = f"{looks}: give each channel its own column"
    return [throughout(recording, ", ".join(held), "swapped", text, EXCLUDE_RECORDING)]


def _reordered(series: Mapping[str, Floats], rate: float) -> dict[str, str]:
    """Of each channel that holds another's samples, that other; empty where they are right or it cannot be told."""
    names = list(series)
    own, own_shape = _sound(series, rate)
    tested = len(compared(series, rate))
    if own == tested:
        return {}
    found = {}
    for order in itertools.permutations(names):
        if list(order) != names:
            found[order] = _sound({name: series[held] for name, held in zip(names, order, strict=True)}, rate)
    most = max(found.values())
    best = [order for order, sound in found.items() if sound == most]
    # As they are, one is not even the shape of the other's integral; or it is, as in an oscillation, but not its size,
    # and some other order is right in everything.
    if len(best) == 1 and most[0] > own and (own_shape == 0 or most[0] == tested):
        return {name: held for name, held in zip(names, best[0], strict=True) if name != held}
    return {}


def _sound(series: Mapping[str, Floats], rate: float) -> tuple[int, int]:
    """(pairs of channels right in shape and size, 1 if the first pair has the right shape)."""
    pairs = compared(series, rate)
    right = [alike > SAME_SHAPE and abs(math.log(abs(ratio))) < SAME_SIZE for _, _, ratio, alike in pairs]
    return sum(right), int(pairs[0][3] > SAME_SHAPE)


def _swapped_with_force(series: Mapping[str, Floats], rate: float) -> dict[str, str]:
    """Force and position exchanged, where nothing else was measured: known by the force balance."""
    if set(series) != {"force", "position"}:
        return {}
    if mass(series, "position", rate).explained > FAILS:
        return {}
    exchanged = {"force": series["position"], "position": series["force"]}
    if mass(exchanged, "position", rate).explained < EXPLAINED:
        return {}
    return {"force": "position", "position": "force"}
