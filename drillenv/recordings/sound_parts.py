"""What of a drilling campaign can be used: without the channels, recordings and stretches that faults take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drillenv.recordings.campaign import Campaign, Recording
from drillenv.recordings.drill_faults import LEAST_PERIODS, NEEDED
from drillenv.recordings.findings import EXCLUDE_CHANNEL, EXCLUDE_RECORDING, EXCLUDE_STRETCH, QualityFinding
from drillenv.recordings.signal_faults import stretches


def sound_parts(campaign: Campaign, faults: Sequence[QualityFinding]) -> tuple[Campaign, list[str]]:
    """A campaign of the drilling rig without what its faults exclude, and a sentence for all that is left out.

    A recording is cut at stretches to exclude. Its parts become recordings of their own, the first by its name, the
    others by when they begin; those of less than ``LEAST_PERIODS`` excitation periods are left out. A part that does
    not begin where the recording does is one of a running rig, but for what follows the excitation's setting in.
    """
    kept: list[Recording] = []
    said: list[str] = []
    for recording in campaign.recordings:
        own = [each for each in faults if each.recording == recording.name]
        lost = next((each for each in own if _takes_all(each)), None)
        if lost is not None:
            said.append(f"{recording.name} is left out ({lost.channel or 'recording'}: {lost.kind}).")
            continue
        recording, sentences = _without_channels(recording, own)
        parts, cut = _without_stretches(recording, [each for each in own if each.severity == EXCLUDE_STRETCH])
        kept += parts
        said += [*sentences, *cut]
    return replace(campaign, recordings=tuple(kept)), said


def cut(recording: Recording, start: int, stop: int) -> Recording:
    """Samples from ``start`` up to ``stop``, all else as it was."""
    channels = {
        name: replace(channel, samples=channel.samples[start:stop]) for name, channel in recording.channels.items()
    }
    clock = None if recording.clock is None else recording.clock[start:stop]
    return replace(recording, channels=channels, clock=clock)


def _takes_all(fault: QualityFinding) -> bool:
    """Whether it leaves nothing of a recording."""
    return fault.severity == EXCLUDE_RECORDING or (fault.severity == EXCLUDE_CHANNEL and fault.channel in NEEDED)


def _without_channels(recording: Recording, faults: Sequence[QualityFinding]) -> tuple[Recording, list[str]]:
    """A recording without channels that are not needed and at fault, be it here and there."""
    at_fault = {each.channel for each in faults if each.severity in (EXCLUDE_CHANNEL, EXCLUDE_STRETCH)}
    dropped = sorted(name for name in recording.channels if name in at_fault and name not in NEEDED)
    if not dropped:
        return recording, []
    kept = {name: channel for name, channel in recording.channels.items() if name not in dropped}
    said = [f"{recording.name}: its {name} is left out, which is not needed." for name in dropped if name != "time"]
    return replace(recording, channels=kept), said


def _without_stretches(recording: Recording, faults: Sequence[QualityFinding]) -> tuple[list[Recording], list[str]]:
    """Parts of a recording between stretches to exclude."""
    # a fault of the time is one of all channels
    cuts = [each for each in faults if each.channel in (None, "time", *NEEDED)]
    if not cuts:
        return [recording], []
    rate = recording.sample_rate
    bad = np.zeros(recording.size, dtype=bool)
    for each in cuts:
        for start, stop in each.spans or ((each.start, each.stop),):
            bad[round(start * rate) : math.ceil(stop * rate - 1e-6)] = True
    least = 0.0 if recording.setting is None else LEAST_PERIODS / recording.setting.frequency * rate
    spans = [(start, stop) for start, stop in stretches(~bad) if stop - start >= least]
    kinds = ", ".join(sorted({each.kind for each in cuts}))
    if not spans:
        return [], [f"{recording.name} is left out: no stretch between its faults is long enough ({kinds})."]
    parts = [cut(recording, start, stop) for start, stop in spans]
    # before the excitation sets in, a rig stands as it does when a recording from rest begins
    waits = any(each.channel == "excitation" and each.start == 0.0 for each in cuts)
    if not (spans[0][0] == 0 or waits):
        parts[0] = replace(parts[0], starts="running")
    for i in range(1, len(parts)):
        name = f"{recording.name} from {spans[i][0] / rate:.4g} s"
        parts[i] = replace(parts[i], name=name, starts="running")
    used = " and ".join(f"{start / rate:.4g} to {stop / rate:.4g} s" for start, stop in spans)
    return parts, [f"{recording.name}: used are {used} ({kinds})."]
