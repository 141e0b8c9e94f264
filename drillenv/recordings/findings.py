"""What is wrong with a recording, said so that a person can act on it and a program can leave it out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from drillenv.recordings.units import CHANNEL_UNITS, how_much

KINDS = (
    "reading",
    "missing-channel",
    "missing-excitation",
    "short",
    "not-a-number",
    "spike",
    "dropout",
    "clipping",
    "time-gap",
    "sample-rate",
    "excitation",
    "pressure",
    "swapped",
    "sign",
    "unit",
    "unrelated",
)
"""Every kind of finding."""

NOTE, EXCLUDE_STRETCH, EXCLUDE_CHANNEL, EXCLUDE_RECORDING = (
    "note",
    "exclude stretch",
    "exclude channel",
    "exclude recording",
)
"""Severities: worth knowing; leave out the stretches named; leave out the channel; leave out the recording."""

MOST_STRETCHES, MOST_LEFT_OUT = 20, 0.5
"""Stretches, and the share of a recording, that can be left out before the whole of it is no longer trusted."""


@dataclass(frozen=True, slots=True)
class QualityFinding:
    """One fault of one recording. Nothing is mended: the samples stay as they were read."""

    recording: str
    """The name of the recording."""
    channel: str | None
    """The channel at fault, None where it is the recording as a whole."""
    kind: str
    """One of ``KINDS``."""
    start: float
    """s from the first sample, where the fault begins."""
    stop: float
    """s, where it ends."""
    sentence: str
    """What is wrong, why that is known, and what to do, in one sentence."""
    severity: str
    """"note", "exclude stretch", "exclude channel" or "exclude recording"."""
    spans: tuple[tuple[float, float], ...] = ()
    """Each stretch (from, to) in s where the fault comes and goes; otherwise empty, and ``start`` to ``stop`` it is."""

    def __str__(self) -> str:
        """One line: recording, channel, time, sentence, severity."""
        what = f"{self.recording}, {self.channel}" if self.channel else self.recording
        return f"{what}, {self.start:.4g} to {self.stop:.4g} s: {self.sentence} ({self.kind}, {self.severity})"


class Subject(Protocol):
    """What a finding is about: a recording."""

    @property
    def name(self) -> str:
        """Of the recording."""
        ...

    @property
    def sample_rate(self) -> float:
        """Hz."""
        ...

    @property
    def size(self) -> int:
        """Samples of each channel."""
        ...


def throughout(recording: Subject, channel: str | None, kind: str, sentence: str, severity: str) -> QualityFinding:
    """A fault from the first sample to the last."""
    seconds = recording.size / recording.sample_rate
    return QualityFinding(recording.name, channel, kind, 0.0, seconds, sentence, severity)


def here_and_there(
    recording: Subject, channel: str | None, kind: str, where: Sequence[tuple[int, int]], sentence: str, severity: str
) -> QualityFinding:
    """A fault in stretches of samples (start, stop), stop one past the last."""
    rate = recording.sample_rate
    spans = tuple((start / rate, stop / rate) for start, stop in where)
    return QualityFinding(recording.name, channel, kind, spans[0][0], spans[-1][1], sentence, severity, spans)


def share_of(recording: Subject, where: Sequence[tuple[int, int]]) -> float:
    """The share of the samples that stretches cover."""
    return sum(stop - start for start, stop in where) / recording.size


def severity_of(recording: Subject, where: Sequence[tuple[int, int]], needed: bool) -> str:
    """Few short stretches can be left out; a fault that is everywhere takes the channel, or with it the recording."""
    if len(where) <= MOST_STRETCHES and share_of(recording, where) <= MOST_LEFT_OUT:
        return EXCLUDE_STRETCH
    return EXCLUDE_RECORDING if needed else EXCLUDE_CHANNEL


def how_often(where: Sequence[tuple[int, int]]) -> str:
    """Once, or in how many stretches."""
    return "once" if len(where) == 1 else f"in {len(where)} stretches"


def off_by_a_unit(
    recording: Subject,
    channel: str,
    unit: str,
    slip: float,
    why: str,
    where: Sequence[tuple[int, int]],
    severity: str,
) -> QualityFinding:
    """A channel, stated in ``unit``, that reads exp(``slip``) times too large; everywhere if ``where`` is empty."""
    units = CHANNEL_UNITS[channel]
    meant = [other for other, factor in units.items() if abs(math.log(units[unit] / factor) - slip) < 0.01]
    advice = f"give its unit as {meant[0]} instead of {unit}" if meant else f"correct it, or its unit {unit}"
    text = f"it reads {how_much(slip)} ({why}): {advice}"
    if where:
        return here_and_there(recording, channel, "unit", where, f"{text} in these stretches", severity)
    return throughout(recording, channel, "unit", text, severity)
