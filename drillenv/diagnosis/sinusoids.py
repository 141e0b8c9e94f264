"""What goes on at a frequency of its own: forces from floor or machines, and a rock that turns under the blows.

Recordings do not begin at the same moment, so that sine and cosine are each recording's own; the frequency is shared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from drillenv.diagnosis.engine import Column
from drillenv.diagnosis.laws import Family
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes
from drillenv.diagnosis.terms import Model, OperatingPoint, Term, Unknown, mean_amplitude
from drillenv.dynamics.hybrid.sensitivity import ON_INDENTER, ON_SHAKER, ON_STIFFNESS

TWO_PI = 2.0 * math.pi


class Channel(NamedTuple):
    """One of the integrator's waves."""

    index: int
    name: str
    scale: float
    """About what its amplitude may change by."""
    unit: str
    kind: int
    """Of the columns by which the motion is differentiated."""


SHAKER = Channel(0, "F1", 10.0, "N", ON_SHAKER)
INDENTER = Channel(1, "F2", 1.0, "N", ON_INDENTER)
STIFFNESS = Channel(2, "eps", 0.02, "1", ON_STIFFNESS)


@dataclass(frozen=True)
class Sinusoid(Term):
    """Waves of one frequency in Hz, the first parameter; then sine and cosine by recording and channel."""

    symbol: str = "f"
    """Of the frequency in the library's equation."""
    per_hertz: float = 1.0
    """What the library's equation has for one hertz."""
    channels: tuple[Channel, ...] = ()
    recordings: tuple[str, ...] = ()

    @property
    def moves(self) -> bool:
        """It acts by waves alone."""
        return False

    @property
    def partly_own(self) -> bool:
        """Of no amplitude, where it is tested, the frequency that recordings have in common shows nothing."""
        return False

    def amplitudes(self, values: Floats, point: OperatingPoint) -> Floats:
        """(channels, 2) sine and cosine; 0 in a recording that it says nothing of."""
        if point.name not in self.recordings:
            return np.zeros((len(self.channels), 2))
        return values[1:].reshape(len(self.recordings), -1, 2)[self.recordings.index(point.name)]

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Set the waves, where there are any."""
        for channel, (sine, cosine) in zip(self.channels, self.amplitudes(values, point), strict=True):
            if sine or cosine:
                i = channel.index
                model.turn[i], model.sine[i], model.cosine[i] = TWO_PI * values[0], sine, cosine

    def wave_columns(self, values: Floats, point: OperatingPoint) -> list[tuple[Column, dict[int, float]]]:
        """Sine and cosine, and the same times time, by which it changes with its parameters."""
        if point.name not in self.recordings:
            return []
        turn, found = TWO_PI * values[0], []
        first = 1 + 2 * len(self.channels) * self.recordings.index(point.name)
        for i, (channel, (sine, cosine)) in enumerate(zip(self.channels, self.amplitudes(values, point), strict=True)):
            for code in (0, 1):
                found.append((Column(channel.kind, code, turn), {first + 2 * i + code: 1.0}))
            for code, size in ((2, -cosine), (3, sine)):
                if size:
                    found.append((Column(channel.kind, code, turn), {0: TWO_PI * size}))
        return found

    def of_recording(self, name: str, values: Floats) -> tuple[Sinusoid, Floats]:
        """The same for one recording, which may be another, and its parameters."""
        own, begun = 2 * len(self.channels), np.zeros(1 + 2 * len(self.channels))
        begun[0] = values[0]
        if name in self.recordings:
            first = 1 + own * self.recordings.index(name)
            begun[1:] = values[first : first + own]
        return replace(self, unknowns=self.unknowns[: 1 + own], recordings=(name,)), begun

    def stated(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """Frequency, and amplitudes as the root mean square over recordings, as the library's equation has them."""
        sizes, spreads = (each[1:].reshape(len(self.recordings), -1, 2) for each in (values, spread))
        unit = "Hz" if self.per_hertz == 1.0 else "rad/s"
        found = {
            self.symbol: {
                "value": self.per_hertz * float(values[0]),
                "std": self.per_hertz * float(spread[0]),
                "unit": unit,
            }
        }
        for i, channel in enumerate(self.channels):
            size, std = mean_amplitude(sizes[:, i], spreads[:, i])
            found[channel.name] = {"value": size, "std": std, "unit": channel.unit}
        return found


class Kind(NamedTuple):
    """What goes on at a frequency of its own."""

    name: str
    """Of its law."""
    symbol: str
    per_hertz: float
    channels: tuple[Channel, ...]
    lowest: float
    """Hz."""
    highest: float


KINDS = (
    # above, the shaker's body hardly moves for such a force
    Kind("vibration", "f", 1.0, (SHAKER, INDENTER), 5.0, 100.0),
    Kind("rotation", "Omega", TWO_PI, (STIFFNESS,), 0.8, 10.0),
)


FEWEST_CYCLES = 2.0
"""In a recording at least: what turns less is a drift, which much else makes as well."""


def frequencies(kind: Kind, seconds: float) -> Floats:
    """Hz at which recordings so long are looked through: at most a quarter of a turn lies between two at their ends.

    Empty where recordings are too short for any.
    """
    lowest = max(kind.lowest, FEWEST_CYCLES / seconds)
    if lowest > kind.highest:
        return np.zeros(0)
    return np.linspace(lowest, kind.highest, math.ceil((kind.highest - lowest) * 2.0 * seconds) + 1)


def sinusoid(
    kind: Kind, frequency: float, recordings: Sequence[str], apart: float, channels: Sequence[Channel] = ()
) -> Sinusoid:
    """At no amplitude; on some of the kind's channels, or on all; the frequency within ``apart`` Hz."""
    used = tuple(channels) or kind.channels
    unknowns = [Unknown(kind.symbol, frequency, 0.1, math.inf, frequency - apart, frequency + apart, "Hz")]
    for name in recordings:
        for channel in used:
            for wave in ("sine", "cosine"):
                own = f"{channel.name} {wave} {name}"
                unknowns.append(Unknown(own, 0.0, channel.scale, 30.0 * channel.scale, unit=channel.unit))
    name = f"{kind.name} {frequency:.1f} Hz"
    return Sinusoid(name, tuple(unknowns), kind.symbol, kind.per_hertz, used, tuple(recordings))


def family(kind: Kind, frequency: float, recordings: Sequence[str], tried: Floats) -> Family:
    """A kind at the best of the frequencies ``tried``; its law is the library's equation."""
    apart = float(tried[1] - tried[0]) if tried.size > 1 else 0.5 * frequency
    term = sinusoid(kind, frequency, recordings, apart)
    return Family(term.name, kind.name, (term,), textbook=True, look_elsewhere=tried.size)
