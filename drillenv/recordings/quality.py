"""Is a campaign fit to be used? Every fault named with its recording, channel and time; nothing is mended."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.body_faults import check_body
from drillenv.recordings.campaign import Campaign, Recording
from drillenv.recordings.document import DRILL
from drillenv.recordings.drill_faults import check_drill
from drillenv.recordings.findings import (
    EXCLUDE_CHANNEL,
    EXCLUDE_RECORDING,
    NOTE,
    QualityFinding,
    here_and_there,
    how_often,
    severity_of,
    share_of,
    throughout,
)
from drillenv.recordings.signal_faults import (
    NOTHING,
    Run,
    at_ceiling,
    habits,
    jumps_out,
    loses_its_noise,
    rate_of,
    runs_of_equals,
    spikes,
    sticks,
    stretches,
    time_jumps,
)

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

RATE_TOLERANCE = 0.005
"""Between the stated sample rate and the file's own time."""
RETURNS = 0.5
"""Of the other samples near a value, the share that equal it exactly, from which the channel has good cause to stay."""

_MAY_STAY = {
    "position": "the body rests there",
    "velocity": "the body keeps this speed",
    "force": "the actuator saturates there",
}
"""Why a channel of one body may rightly stand at its largest value."""


def check_quality(campaign: Campaign) -> tuple[QualityFinding, ...]:
    """Look for faults in every recording: sensors, wiring, units, and the sample rate.

    Found are: samples that are no numbers, values that stick, ceilings, missing time, a sample rate that contradicts
    the file's own time or the excitation or is too low for the impacts, a missing excitation or one that differs from
    its setting, swapped channels, turned signs, and units off by a factor such as 9.81 or 1000. For the last three the
    channels are held against each other by the balances that the campaign's rig obeys, with the nominal constants; no
    motion is simulated, so chaotic motions are judged as well as periodic ones.

    Returns:
        The findings in the order of the recordings, and in each in order of time; empty for a sound campaign.

    Raises:
        InputError: ``campaign`` is none.
    """
    if not isinstance(campaign, Campaign):
        raise InputError(f"campaign is {shown(campaign)}: give what read_campaign returns")
    with np.errstate(all="ignore"):
        return _checked(campaign)


def _checked(campaign: Campaign) -> tuple[QualityFinding, ...]:
    checked = [(recording, *_by_channel(recording, campaign.rig)) for recording in campaign.recordings]
    findings: list[QualityFinding] = []
    across = [] if campaign.rig == DRILL else check_body(campaign, {each.name: bad for each, _, bad in checked})
    for recording, alone, bad in checked:
        found = [*recording.findings, *_clock(recording), *alone]
        if campaign.rig == DRILL:
            found += check_drill(recording, campaign.nominal, bad)
        found += [finding for finding in across if finding.recording == recording.name]
        findings += sorted(found, key=lambda finding: finding.start)
    return tuple(findings)


def _by_channel(recording: Recording, rig: str) -> tuple[list[QualityFinding], dict[str, Mask]]:
    """What each channel shows by itself, and the samples found faulty."""
    found: list[QualityFinding] = []
    bad: dict[str, Mask] = {}
    for name, channel in recording.channels.items():
        samples = channel.samples
        no_number = ~np.isfinite(samples)
        bad[name] = no_number
        if no_number.any():
            found.append(_no_numbers(recording, name, no_number, rig))
        if name in ("time", "pressure") or np.count_nonzero(~no_number) < 2:
            continue
        places = np.flatnonzero(~no_number)
        known = samples[places]  # what lies between two missing numbers is looked at as if it were one series
        odd = spikes(known)
        if odd.any():
            spiked = _among(places, odd, samples.size)
            found.append(_spikes(recording, name, spiked, rig))
            no_number = no_number | spiked
            bad[name], places, known = no_number, places[~odd], known[~odd]
        if known.size < 2:
            continue
        if np.ptp(known) < max(NOTHING, 1e-12 * float(np.abs(known).max())):
            # A force may be constant, also none at all; an excitation is judged by its tone.
            if name != "excitation" and (name != "force" or rig == DRILL):
                text = f"it is {known[0]:.4g} (SI) throughout and never moves: see that its sensor was connected"
                severity = EXCLUDE_RECORDING if _needed(name, rig) else EXCLUDE_CHANNEL
                found.append(throughout(recording, name, "dropout", text, severity))
                bad[name] = np.ones(samples.size, dtype=bool)
            continue
        clipped = np.zeros(samples.size, dtype=bool)
        for end, at_end in _ends(name, known, rig):
            clipped[places[at_end]] = True
            found.append(_clipping(recording, name, end, _among(places, at_end, samples.size), rig))
        stuck = _among(places, _stuck(name, known, clipped[places], rig), samples.size)
        if stuck.any():
            found.append(_dropouts(recording, name, stuck, rig))
        bad[name] = no_number | clipped | stuck
    return found, bad


def _among(places: NDArray[np.intp], mask: Mask, size: int) -> Mask:
    """A mask over the samples at ``places`` as one over all."""
    found = np.zeros(size, dtype=bool)
    found[places[mask]] = True
    return found


def _needed(name: str, rig: str) -> bool:
    """Whether a recording is of no use without this channel. The excitation can be told from its setting and tone."""
    return name in ("force", "acceleration") if rig == DRILL else name == "position"


def _no_numbers(recording: Recording, name: str, mask: Mask, rig: str) -> QualityFinding:
    where = stretches(mask)
    count, infinite = int(np.count_nonzero(mask)), int(np.count_nonzero(np.isinf(recording.channels[name].samples)))
    which = f", {infinite} of them infinite" if infinite else ""
    text = f"{count} samples are no numbers{which} ({how_often(where)}): leave them out"
    severity = severity_of(recording, where, _needed(name, rig))
    return here_and_there(recording, name, "not-a-number", where, text, severity)


def _spikes(recording: Recording, name: str, mask: Mask, rig: str) -> QualityFinding:
    where = stretches(mask)
    largest = float(np.max(np.abs(recording.channels[name].samples[mask])))
    text = f"it spikes {how_often(where)}, to {largest:.3g} (SI), out of all proportion to the rest: leave these out"
    return here_and_there(recording, name, "spike", where, text, severity_of(recording, where, _needed(name, rig)))


def _ends(name: str, known: Floats, rig: str) -> list[tuple[str, Mask]]:
    """Where the samples are clipped at their largest and at their smallest value."""
    ends = [("largest", 1.0), ("smallest", -1.0)]
    if rig == DRILL and name == "force":
        # Out of contact a rock force is rightly zero: that end, wherever it points to, is no floor.
        ends = ends[:1] if known.max() - np.median(known) > np.median(known) - known.min() else ends[1:]
    found = [(end, at_ceiling(sign * known)) for end, sign in ends]
    return [(end, mask) for end, mask in found if mask.any()]


def _clipping(recording: Recording, name: str, end: str, mask: Mask, rig: str) -> QualityFinding:
    where = stretches(mask)
    value = recording.channels[name].samples[where[0][0]]
    text = (
        f"{np.count_nonzero(mask)} samples stand at its {end} value, {value:.5g} (SI), {how_often(where)}: widen the "
        "range of its amplifier and record again"
    )
    severity = severity_of(recording, where, _needed(name, rig))
    if rig != DRILL and name in _MAY_STAY:
        text, severity = f"{text}, unless {_MAY_STAY[name]}", NOTE
    return here_and_there(recording, name, "clipping", where, text, severity)


def _stuck(name: str, known: Floats, clipped: Mask, rig: str) -> Mask:
    """Samples that a sensor which works would not have repeated."""
    mask = np.zeros(known.size, dtype=bool)
    if name == "excitation":
        return mask  # judged against its tone
    runs = runs_of_equals(known)
    usual = habits(known)
    for run in runs:
        if clipped[run.start]:
            continue
        if rig == DRILL and name in ("force", "acceleration"):
            stays = sticks(known, run, usual) and not (name == "force" and _returns(known, run))
        else:
            stays = loses_its_noise(known, run, usual) and not _returns(known, run)
            stays = stays or (name in ("position", "velocity") and jumps_out(known, run))
        mask[run.start : run.stop] |= stays
    return mask


def _returns(samples: Floats, run: Run) -> bool:
    """Whether the channel is mostly exactly at this value whenever else it is near, as a noiseless force in flight."""
    near = np.abs(samples - run.value) <= 0.005 * np.ptp(samples)
    length = run.stop - run.start
    return float(np.count_nonzero(samples == run.value) - length) > RETURNS * float(np.count_nonzero(near) - length)


def _dropouts(recording: Recording, name: str, mask: Mask, rig: str) -> QualityFinding:
    where = stretches(mask)
    values = sorted({float(recording.channels[name].samples[start]) for start, _ in where})
    at = f"at {values[0]:.4g}" if len(values) == 1 else f"at {len(values)} values"
    text = (
        f"it sticks {at} (SI) {how_often(where)}, {100 * share_of(recording, where):.2g} % of the time: leave these "
        "stretches out"
    )
    return here_and_there(recording, name, "dropout", where, text, severity_of(recording, where, _needed(name, rig)))


def _clock(recording: Recording) -> list[QualityFinding]:
    """The stated sample rate against the time that the file itself gives."""
    clock = recording.clock
    if clock is None:
        return []
    if not np.isfinite(clock).all():
        where = stretches(~np.isfinite(clock))
        text = f"the file's own time is no number {how_often(where)}: correct it, or leave the column out"
        return [here_and_there(recording, "time", "time-gap", where, text, NOTE)]
    found = []
    rate = rate_of(clock)
    if math.isnan(rate) or abs(rate / recording.sample_rate - 1.0) > RATE_TOLERANCE:
        says = "does not go forward" if math.isnan(rate) else f"says {rate:.5g} samples a second"
        text = f"the file's own time {says}, campaign.json {recording.sample_rate:g}: correct one of them"
        found.append(throughout(recording, "time", "sample-rate", text, EXCLUDE_RECORDING))
        return found
    jumps = time_jumps(clock, recording.sample_rate)
    if jumps:
        where = [(at - 1, at) for at, _ in jumps]
        listed = ", ".join(f"{1e3 * lost:+.3g} ms at {at / recording.sample_rate:.4g} s" for at, lost in jumps[:4])
        text = f"the file's own time jumps {how_often(where)} ({listed}): cut the recording there"
        found.append(here_and_there(recording, "time", "time-gap", where, text, severity_of(recording, where, True)))
    return found
