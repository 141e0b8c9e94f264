"""Excerpts of long recordings of the drilling rig: as many periods as a diagnosis needs, where they differ most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drillenv.recordings.campaign import Campaign, Recording
from drillenv.recordings.sound_parts import cut

ENOUGH, LEAST = 768, 96
"""Excitation periods of a campaign that tell its mechanisms apart, and of one recording: the noise of the sensors is
averaged over them, and more of a motion that repeats itself says nothing new."""


def excerpts(campaign: Campaign) -> tuple[Campaign, list[str]]:
    """A campaign without most of its longer recordings, and a sentence for each that is shortened.

    Of a recording from rest the beginning is kept. Of a running rig it is the stretch in which the impulses of single
    periods vary most: motions that repeat themselves say the same over and over.
    """
    most = max(LEAST, ENOUGH // max(len(campaign.recordings), 1))
    kept: list[Recording] = []
    said: list[str] = []
    for recording in campaign.recordings:
        start, stop = most_varied(recording, most)
        if stop - start == recording.size:
            kept.append(recording)
            continue
        kept.append(cut(recording, start, stop))
        begin, end = start / recording.sample_rate, stop / recording.sample_rate
        said.append(f"{recording.name}: used are {begin:.4g} to {end:.4g} s of {recording.seconds:.4g} s.")
    return replace(campaign, recordings=tuple(kept)), said


def most_varied(recording: Recording, periods: int) -> tuple[int, int]:
    """First sample and one past the last of the stretch to use, of so many excitation periods at most."""
    if recording.setting is None or "force" not in recording.channels:
        return 0, recording.size
    samples_a_period = recording.sample_rate / recording.setting.frequency
    whole = int(recording.size / samples_a_period)
    length = round(periods * samples_a_period)
    if whole <= periods:
        return 0, recording.size
    if recording.starts == "fresh":
        return 0, length
    edges = np.round(np.arange(whole + 1) * samples_a_period).astype(int)
    total = np.concatenate([[0.0], np.cumsum(recording.channels["force"].samples)])
    impulses = np.diff(total[edges])
    first, second = (np.concatenate([[0.0], np.cumsum(impulses**power)]) for power in (1, 2))
    mean = (first[periods:] - first[:-periods]) / periods
    variance = (second[periods:] - second[:-periods]) / periods - mean**2
    start = int(edges[int(np.argmax(variance))])
    return start, min(start + length, recording.size)
