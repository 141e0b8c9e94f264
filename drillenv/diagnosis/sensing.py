"""What sensors make of force and acceleration, as terms: free laws that are linear, and textbook equations.

Signals are (..., 2, n), force in N and acceleration in m/s^2 along the axis before the last; every term is linear in
them as long as the rock is touched at the same samples. What remembers starts settled on a signal's first sample, 0 in
a window's own response; only the high-pass starts from rest, and says in ``add`` what it remembers of the time before.
Terms of a model belong in the order of ``stage``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from scipy.signal import cont2discrete, oaconvolve

from drillenv.diagnosis.laws import Family
from drillenv.diagnosis.resonance import BROAD, Resonator
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import OperatingPoint, Term, Unknown, mean_amplitude
from drillenv.diagnosis.thresholds import NOT_LEVEL, SKEW
from drillenv.dynamics.effects import REGISTRY, mechanism_of_law
from drillenv.rig import PUSH

TWO_PI = 2.0 * math.pi
CHANNELS = (("force", "N"), ("acceleration", "m/s^2"))
WIDTHS = (3.0, 1.0)
"""Of constants on them, in the solver's units."""
FORCE, ACCELERATION = 0, 1
NONE = 1e6  # Hz: here a resonance or a low-pass does nothing, as in the library
RESONATORS = 12
"""Of a free response, from 1.5 to 7.5 kHz: so near to each other that two of them draw what rings in between."""
LAGS, CORNERS = (-5e-5, 5e-5, 1.2e-4, 2.5e-4, 4.5e-4, 8e-4), (300.0, 800.0, 2000.0)
"""Of a free response: s by which it shifts, and Hz at which its low-passes begin."""
NARROW = 0.03  # damping ratio with which fits of an equation begin
OVERDAMPED = 0.6
"""Damping ratio beyond which a resonance raises no frequency and is a low-pass."""
CELL_CORNERS, SLOW_CORNERS = (500.0, 2000.0), (0.3, 1.0, 3.0)  # Hz, of low-passes in a load cell and in a high-pass
CREEP_CORNERS = (10.0, 30.0, 90.0)  # Hz, of those through which a part of the force comes late
OVERTONES = (1, 2, 3, 4, 5)
"""Orders of the mains that a hum may have: of a rectifier, and of a transformer that saturates."""
GAINS = 2 * len(SLOW_CORNERS)
"""Of a high-pass, by channel and corner."""
ACCELEROMETER, CELL, FORCE_LAG = "accelerometer response", "load cell response", "force lag"
HIGH_PASS, OFFSET = "high-pass", "offset"
RISING, FALLING, LEVEL = RESPONSES = "rising response", "falling response", "level response"
"""What the free response of an accelerometer may be."""


@dataclass(frozen=True)
class Sensor(Term):
    """A term of what is read."""

    stage: int = 0
    """Sensors act in rising order of it, as the library's: the load cell takes the acceleration as it truly is."""
    starts: tuple[dict[str, float], ...] = ()
    """Values from which to fit it, where zero does not do."""
    effect: str = ""
    """The mechanism of the library whose equation it is; none of a free law."""

    @property
    def neutral(self) -> Floats:
        """(n,) of all parameters; none where several starts say that it begins elsewhere."""
        return np.zeros(0) if len(self.starts) > 1 else super().neutral

    def summed_up(self, values: Floats, covariance: Floats) -> dict[str, tuple[float, float, str]]:
        """What a free law comes to by the library's symbols: value, standard deviation and unit; {} where nothing."""
        return {}

    def begun_at(self, free: Sensor, values: Floats, points: Sequence[OperatingPoint]) -> Floats | None:
        """Where it comes nearest to a free law with these values in recordings; None where its own starts say so."""
        return None

    def pulses(self, values: Floats, rate: float, seconds: float = 0.1) -> tuple[int, Floats]:
        """What is read of a 1 on one channel at a sample: that sample, and (2 true, 2 read, n)."""
        middle = round(0.02 * rate)
        true = np.zeros((2, 2, middle + round(seconds * rate)))
        true[[0, 1], [0, 1], middle] = 1.0
        return middle, self.observe(values, true, OperatingPoint("", 80.0, 0.45, 1.0, rate, False))


def response(term: Sensor, values: Floats, frequency: Floats, true: int = ACCELERATION, read: int = ACCELERATION,
             rate: float = 102400.0, seconds: float = 0.1) -> np.ndarray:  # fmt: skip
    """(m,) complex: what channel ``read`` has of ``true``, at frequencies (m,) in Hz; ``seconds`` are remembered."""
    middle, pulses = term.pulses(values, rate, seconds)
    after = np.arange(pulses.shape[-1]) - middle
    return np.exp(-2j * math.pi * np.multiply.outer(np.asarray(frequency), after) / rate) @ pulses[true, read]


def kind_of_response(term: Sensor, values: Floats, rate: float) -> str:
    """The kind of a frequency response: one that rises resonates, one that falls is a low-pass, a level one a delay.

    By means of its gain over sixths of its range: a free response ripples.
    """
    frequency = np.linspace(100.0, min(4000.0, 0.35 * rate), 78)
    gain = np.convolve(np.abs(response(term, values, frequency)), np.full(13, 1.0 / 13.0), "valid")
    if float(gain.max()) > 1.0 + NOT_LEVEL:
        return RISING
    return FALLING if float(gain.min()) < 1.0 - NOT_LEVEL else LEVEL


@lru_cache(4096)
def _coefficients(rate: float, frequency: float, ratio: float | None, band: bool) -> tuple[Floats, Floats]:
    """(3,) of a filter's input and output, 0 beyond its order, where the input is straight between samples."""
    turn = TWO_PI * frequency
    under = (1.0, turn) if ratio is None else (1.0, 2.0 * ratio * turn, turn**2)
    made: Any = cont2discrete(((turn, 0.0) if band else under[-1:], under), 1.0 / rate, method="foh")
    over, under = np.zeros((2, 3))
    over[: made[0].size], under[: made[1].size] = made[0].ravel(), made[1]
    return over, under


def _filtered(
    x: Floats, rate: float, frequency: float, ratio: float | None = None, band: bool = False, rested: bool = False
) -> Floats:
    """(..., n) through a low-pass, or a resonator: what that lets pass below, or the band about its frequency.

    Settled on the first sample, or with ``rested`` on 0 before it.
    """
    over, under = _coefficients(rate, float(frequency), None if ratio is None else float(ratio), band)
    passed = np.empty(x.shape)
    rows = np.ascontiguousarray(x).reshape(-1, x.shape[-1])
    _filter_rows(rows, over, under, band, rested, passed.reshape(rows.shape))
    return passed


@njit(cache=True, nogil=True)
def _filter_rows(rows, over, under, band, rested, passed):
    """Rows (m, n) through a recursive filter of first or second order, whose last coefficient is 0 where of first.

    A signal that bends lies beyond the straight line between its samples, by a twelfth of its second difference.
    """
    for i in range(rows.shape[0]):
        row, out = rows[i], passed[i]
        start = 0.0 if rested else row[0]
        level = 0.0 if band else start
        u1 = u2 = y1 = y2 = 0.0
        before = start
        for k in range(row.size):
            x = row[k]
            between = (k > 0 or rested) and k < row.size - 1
            u = x - start - ((before - 2.0 * x + row[k + 1]) / 12.0 if between else 0.0)
            y = over[0] * u + over[1] * u1 + over[2] * u2 - under[1] * y1 - under[2] * y2
            u2, u1, y2, y1, before = u1, u, y1, y, x
            out[k] = y + level


def _late(samples: float, half: int) -> tuple[Floats, int]:
    """(2 half,) weights and their first place of a delay by any number of samples: a windowed sinc."""
    first = math.floor(samples) - half + 1
    part = np.arange(first, first + 2 * half) - samples
    kernel = np.sinc(part) * np.i0(6.0 * np.sqrt(np.maximum(1.0 - (part / half) ** 2, 0.0)))
    return kernel / kernel.sum(), first


def _convolved(x: Floats, kernel: Floats, first: int) -> Floats:
    """(..., n) weighted with a kernel whose first place is ``first``; beyond its ends a signal holds its value.

    A kernel (taps,) weighs all signals, or kernels (m, taps) one signal (n,) each.
    """
    n, start, ahead = x.shape[-1], x[..., :1], max(0, -first)
    held = np.pad(x - start, [(0, 0)] * (x.ndim - 1) + [(max(0, first), ahead)], mode="edge")
    dimensions = max(x.ndim, kernel.ndim)
    held, taps = (each.reshape((1,) * (dimensions - each.ndim) + each.shape) for each in (held, kernel))
    late = np.asarray(oaconvolve(held, taps, axes=-1))
    return late[..., ahead : ahead + n] + taps.sum(axis=-1, keepdims=True) * start


@lru_cache(256)
def _kernels(rings: tuple[Resonator, ...], rate: float) -> tuple[Floats, int]:
    """(coefficients, taps) what the parts of a free response add to a signal, and their first place."""
    ahead = math.ceil(-min(LAGS) * rate) + 3
    longest = max([0.007, *[10.0 / (each.ratio * TWO_PI * each.frequency) for each in rings]])
    pulse = np.zeros(ahead + math.ceil(min(longest, 0.05) * rate))
    pulse[ahead] = 1.0
    found = [_convolved(pulse, *_late(lag * rate, 3)) - pulse for lag in LAGS]
    found += [_filtered(pulse, rate, corner) - pulse for corner in CORNERS]
    for each in rings:
        parts = (_filtered(pulse, rate, *each) - pulse, _filtered(pulse, rate, *each, True))
        found += [part * (each.frequency < 0.45 * rate) for part in parts]
    return np.array(found), -ahead


def broad_parts(rate: float) -> Callable[[Floats], np.ndarray]:
    """The responses (m, n) of the parts of a free response at frequencies (n,) in Hz, with broad resonators alone."""
    kernels, first = _kernels(_resonators(RESONATORS, rate), rate)

    def responses(frequency: Floats) -> np.ndarray:
        places = np.arange(first, first + kernels.shape[1])
        return kernels @ np.exp(-2j * math.pi * np.outer(places, frequency) / rate)

    return responses


def _accelerometer(values: Floats, force: Floats, acceleration: Floats, rate: float) -> tuple[Floats, Floats]:
    return force, acceleration if values[0] >= NONE else _filtered(acceleration, rate, *values)


def _delay(values: Floats, force: Floats, acceleration: Floats, rate: float) -> tuple[Floats, Floats]:
    pairs = zip((force, acceleration), (*values, 0.0), strict=False)
    force, acceleration = (_convolved(x, *_late(by * rate, 8)) if by else x for x, by in pairs)
    return force, acceleration


def _inertia(values: Floats, force: Floats, acceleration: Floats, rate: float) -> tuple[Floats, Floats]:
    if not np.any(values):
        return force, acceleration
    masses = zip(values[1:], CELL_CORNERS, strict=False)
    behind = sum(mass * _filtered(acceleration, rate, corner) for mass, corner in masses if mass)
    return force + values[0] * acceleration + behind, acceleration


def _crosstalk(values: Floats, force: Floats, acceleration: Floats, rate: float) -> tuple[Floats, Floats]:
    return force, acceleration + values[0] * force if values[0] else acceleration


def _creep(values: Floats, force: Floats, acceleration: Floats, rate: float) -> tuple[Floats, Floats]:
    if not np.any(values):
        return force, acceleration
    shares = zip(values, CREEP_CORNERS, strict=True)
    late = sum(share * (_filtered(force, rate, corner) - force) for share, corner in shares if share)
    return force + late, acceleration


@dataclass(frozen=True)
class Response(Sensor):
    """A law of a few numbers: what is read of force and acceleration, (..., n) each, at a rate in Hz."""

    law: Callable[[Floats, Floats, Floats, float], tuple[Floats, Floats]] = _inertia

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """By the law; the signals themselves where it changes nothing."""
        channels = signals[..., FORCE, :], signals[..., ACCELERATION, :]
        read = self.law(values, *channels, point.rate)
        return signals if read[0] is channels[0] and read[1] is channels[1] else np.stack(read, axis=-2)


@dataclass(frozen=True)
class MassInContact(Sensor):
    """A mass in kg in front of the load cell that moves with the indenter only while they touch."""

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """The force with the mass's inertia in contact."""
        if not values[0]:
            return signals
        read = signals.copy()
        inertia = values[0] * signals[..., ACCELERATION, :]
        read[..., FORCE, :] += inertia if point.touching is None else inertia * point.touching
        return read


@dataclass(frozen=True)
class FreeResponse(Sensor):
    """What a channel makes of its signal: lags, low-passes and resonators, each as much as it likes.

    Those of the force stand beside masses in front of the load cell, whose parameters come first.
    """

    channel: int = ACCELERATION
    rings: tuple[Resonator, ...] = ()

    @property
    def masses(self) -> int:
        """How many parameters are masses."""
        return len(CELL_MASSES) if self.channel == FORCE else 0

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """Add the parts, convolved with the signal; the signals themselves where there are none."""
        masses, parts = np.split(values, [self.masses])
        if not np.any(values):
            return signals
        read, force, acceleration = signals.copy(), signals[..., FORCE, :], signals[..., ACCELERATION, :]
        if np.any(masses):
            read[..., FORCE, :] = _inertia(masses, force, acceleration, point.rate)[FORCE]
        if np.any(parts):
            kernels, first = _kernels(self.rings, point.rate)
            read[..., self.channel, :] += _convolved(signals[..., self.channel, :], parts @ kernels, first)
        return read

    def derivatives(self, signals: Floats, point: OperatingPoint) -> Floats:
        """(parameters, 2, n) by what is read of signals (2, n) changes with each, whatever they are."""
        kernels, first = _kernels(self.rings, point.rate)
        made = np.zeros((len(self.unknowns), *signals.shape))
        for i, mass in enumerate(np.eye(self.masses)):
            carried, _acceleration = _inertia(mass, signals[FORCE], signals[ACCELERATION], point.rate)
            made[i, FORCE] = carried - signals[FORCE]
        made[self.masses :, self.channel] = _convolved(signals[self.channel], kernels, first)
        return made


@dataclass(frozen=True)
class HighPass(Sensor):
    """Channels less first-order low-passes, and the charge that the coupling of each recording still has.

    A running rig had settled on its static force and no acceleration, but for that charge: gains of the low-passes by
    channel and corner, then charges by recording and channel.
    """

    names: tuple[str, ...] = ()
    """Recordings with charges of their own."""
    common = GAINS

    def low_passes(self, values: Floats) -> list[tuple[int, float, float]]:
        """Channel, gain and corner in Hz of each."""
        gains = values[:GAINS].reshape(2, -1)
        return [(int(channel), float(gains[channel, i]), SLOW_CORNERS[i]) for channel, i in np.argwhere(gains)]

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """Subtract the low-passes, from rest."""
        if not np.any(values[: self.common]):
            return signals
        read = signals.copy()
        for channel, gain, corner in self.low_passes(values):
            read[..., channel, :] -= gain * _filtered(signals[..., channel, :], point.rate, corner, rested=True)
        return read

    def add(self, values: Floats, point: OperatingPoint, n: int, first: int = 0) -> Floats | None:
        """What is left of the mean before the first sample, and of the charge there."""
        seconds, added = np.arange(n - first) / point.rate, np.zeros((2, n))
        for channel, gain, corner in self.low_passes(values):
            if channel == FORCE and not point.fresh:
                added[FORCE, first:] -= PUSH * point.pressure * gain * np.exp(-TWO_PI * corner * seconds)
        if point.name in self.names:
            i = self.common + 2 * self.names.index(point.name)
            fading = np.exp(-TWO_PI * np.outer(self.corners(values), seconds))
            added[:, first:] += values[i : i + 2, None] * fading
        return added

    def corners(self, values: Floats) -> Floats:
        """(2,) Hz at 3 dB by channel: far above, each low-pass falls with its corner over the frequency."""
        return np.maximum(self.weights() @ values, 0.0)

    def weights(self) -> Floats:
        """(2, parameters) of the corners in Hz."""
        made = np.zeros((2, len(self.unknowns)))
        for channel in (FORCE, ACCELERATION):
            first = channel * len(SLOW_CORNERS)
            made[channel, first : first + len(SLOW_CORNERS)] = SLOW_CORNERS
        return made

    def summed_up(self, values: Floats, covariance: Floats) -> dict[str, tuple[float, float, str]]:
        """Corner frequencies of coupled channels, where they stand out of their errors."""
        weights = self.weights()
        stds = np.sqrt(np.einsum("ci,ij,cj->c", weights, covariance, weights))
        found = zip(("corner_f", "corner_a"), self.corners(values), stds, strict=True)
        return {name: (float(value), float(std), "Hz") for name, value, std in found if value > 2.0 * std}

    def charges_beside(self, taken: float, values: Floats, points: Sequence[OperatingPoint]) -> Floats:
        """(recordings, 2) charges with which a law that takes away a share of the static force begins as this one does.

        Of a rig that was running, this one takes away the sum of its gains.
        """
        charges = values[self.common :].reshape(-1, 2).copy()
        more = taken - sum(gain for channel, gain, _ in self.low_passes(values) if channel == FORCE)
        for point in points:
            if not point.fresh and point.name in self.names:
                charges[self.names.index(point.name), FORCE] += PUSH * point.pressure * more
        return charges

    def of_recording(self, name: str, values: Floats) -> tuple[HighPass, Floats]:
        """The same with the charge of one recording, which may be another."""
        begun = np.append(values[: self.common], [0.0, 0.0])
        if name in self.names:
            i = self.common + 2 * self.names.index(name)
            begun[self.common :] = values[i : i + 2]
        return replace(self, unknowns=self.unknowns[: self.common + 2], names=(name,)), begun


@dataclass(frozen=True)
class Coupling(HighPass):
    """The library's high-pass: one low-pass of a channel, with a corner in Hz of its own, then charges."""

    common = 2

    def low_passes(self, values: Floats) -> list[tuple[int, float, float]]:
        """Channel, gain and corner in Hz of each."""
        return [(channel, 1.0, float(values[channel])) for channel in (FORCE, ACCELERATION) if values[channel] > 0.0]

    def corners(self, values: Floats) -> Floats:
        """(2,) Hz at 3 dB by channel."""
        return values[:2]

    def begun_at(self, free: Sensor, values: Floats, points: Sequence[OperatingPoint]) -> Floats | None:
        """With the corners of the free law, and charges with which each recording begins as by that."""
        if not isinstance(free, HighPass):
            return None
        corners = free.corners(values)
        return np.append(corners, free.charges_beside(float(corners[FORCE] > 0.0), values, points))

    def stated(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """The corners by the library's symbols; charges are each recording's."""
        return dict(list(super().stated(values, spread).items())[:2])


@dataclass(frozen=True)
class OwnDelays(Sensor):
    """An acceleration that comes late by another time in each recording, in s, as from loggers started by hand."""

    names: tuple[str, ...] = ()
    """Recordings with delays of their own; any other has their mean."""
    common = 0

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """Delay the acceleration."""
        own = values[self.names.index(point.name)] if point.name in self.names else float(np.mean(values))
        delayed = _delay(np.array([0.0, own]), signals[..., FORCE, :], signals[..., ACCELERATION, :], point.rate)
        return np.stack(delayed, axis=-2)

    def of_recording(self, name: str, values: Floats) -> tuple[OwnDelays, Floats]:
        """The same with the delay of one recording, which may be another and then begins with their mean."""
        own = values[self.names.index(name)] if name in self.names else float(np.mean(values))
        return replace(self, unknowns=self.unknowns[:1], names=(name,)), np.array([own])


@dataclass(frozen=True)
class Added(Sensor):
    """A sine and a cosine of each order of a frequency in Hz, or a constant; steady, or by powers of the time.

    By recording, channel, power and order.
    """

    frequency: float = 0.0
    orders: tuple[int, ...] = ()
    degree: int = 0
    """The highest power of the time, which is from -1/2 at the beginning of a recording to 1/2 at its end."""
    names: tuple[str, ...] = ()
    """Recordings with values of their own; without any, all have the same."""

    def add(self, values: Floats, point: OperatingPoint, n: int, first: int = 0) -> Floats | None:
        """The recording's own; where there is one value more than the amplitudes, the first is the frequency."""
        if self.names and point.name not in self.names:
            return None
        sizes = self.waves(values)[self.names.index(point.name) if self.names else 0]
        waves = _waves(self.frequency_of(values) / point.rate, self.orders, n) if self.orders else np.ones((1, n))
        if self.degree:
            powers = np.linspace(-0.5, 0.5, n) ** np.arange(self.degree + 1)[:, None, None]
            waves = (powers * waves).reshape(-1, n)
        return sizes @ waves

    def begun_at(self, free: Sensor, values: Floats, points: Sequence[OperatingPoint]) -> Floats | None:
        """As charges of a coupling that lets the static force pass, where each recording has a constant of its own."""
        if not isinstance(free, HighPass) or self.orders or self.names != free.names:
            return None
        return free.charges_beside(0.0, values, points).ravel()

    @property
    def count(self) -> int:
        """Waves of a channel."""
        return (2 * len(self.orders) or 1) * (self.degree + 1)

    def waves(self, values: Floats) -> Floats:
        """(recordings, 2, count) sizes by recording, channel, and power with sine and cosine of each order."""
        places = max(1, len(self.names))
        return values[-2 * places * self.count :].reshape(places, 2, self.count)

    def frequency_of(self, values: Floats) -> float:
        """In Hz: the first parameter where there is one more than sizes."""
        sizes = 2 * max(1, len(self.names)) * self.count
        return float(values[0]) if len(values) > sizes else self.frequency

    def stated(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """Of a hum its frequency and the root mean square over recordings of the amplitude of its first order."""
        if not self.names or not self.orders:
            return super().stated(values, spread)
        sizes, spreads = self.waves(values), self.waves(spread)
        frequency, std = self.frequency_of(values), float(spread[0]) if sizes.size < len(values) else 0.0
        found = {"f_m": {"value": frequency, "std": std, "unit": "Hz"}}
        for i, (channel, (_name, unit)) in enumerate(zip("fa", CHANNELS, strict=True)):
            size, std = mean_amplitude(sizes[:, i, :2], spreads[:, i, :2])
            found[f"b_{channel}"] = {"value": size, "std": std, "unit": unit}
        return found


@lru_cache(256)
def _waves(frequency: float, orders: tuple[int, ...], n: int) -> Floats:
    """(2 orders, n) sine and cosine of each order of a frequency in cycles per sample."""
    turned = TWO_PI * frequency * np.arange(n)
    return np.array([wave(order * turned) for order in orders for wave in (np.sin, np.cos)])


def _free(names: Sequence[str], scale: float, unit: str = "1") -> tuple[Unknown, ...]:
    return tuple(Unknown(name, 0.0, scale, 30.0 * scale, unit=unit) for name in names)


CELL_MASSES = _free(["m_c"] + [f"m_c {corner:g} Hz" for corner in CELL_CORNERS], 0.02, "kg")
"""Of a load cell: rigid, and behind low-passes."""


def _own(effect: str, scales: dict[str, float], at: dict[str, float]) -> tuple[Unknown, ...]:
    """Parameters of the library; what may come late may come early."""
    its = [REGISTRY[effect].parameter(symbol) for symbol in scales]
    lows = {each.symbol: -each.high if each.unit == "s" else each.low for each in its}
    # a resonance that is damped so much that no frequency is raised is a low-pass
    highs = {each.symbol: OVERDAMPED if each.symbol == "zeta_a" else each.high for each in its}
    every = ((p.symbol, at[p.symbol], scales[p.symbol], math.inf, lows[p.symbol], highs[p.symbol], p.unit) for p in its)
    return tuple(Unknown(*each) for each in every)


def _resonators(count: int, rate: float, ratio: float = BROAD) -> tuple[Resonator, ...]:
    # the lower flank of a mode above the Nyquist frequency is seen; its parts are computed at the fine rate
    return tuple(Resonator(float(each), ratio) for each in np.geomspace(1500.0, 7500.0, count) if each <= 0.6 * rate)


def _with_sharp(broad: tuple[Resonator, ...], sharp: Resonator | None) -> tuple[Resonator, ...]:
    """Resonators, and two on either side of a sharp one: their parts draw it where it is a little off as well."""
    if sharp is None:
        return broad
    return (*broad, *(sharp._replace(frequency=sharp.frequency * (1.0 + off * sharp.ratio)) for off in (-0.5, 0.5)))


def _parts(rings: Sequence[Resonator]) -> tuple[Unknown, ...]:
    """Of a free response that leaves 0 Hz alone, with these resonators."""
    smooth = [f"lag {1e6 * lag:g} us" for lag in LAGS] + [f"low-pass {corner:g} Hz" for corner in CORNERS]
    ringing = [f"ring {each.frequency:.0f} Hz {part}" for each in rings for part in ("below", "band")]
    return _free(smooth, 0.2) + _free(ringing, 0.1)


def added(
    names: Sequence[str], frequency: float = 0.0, orders: Sequence[int] = (), *first: Unknown, degree: int = 0
) -> Added:
    """A constant on each channel of these recordings, or lines of multiples of a frequency in Hz, as ``Added``."""
    # terms of a model are told apart by name, and a free law may correct the library's equation
    what, stage = (f"hum {'near ' if first else ''}{frequency:g} Hz", 4) if orders else (OFFSET, 5)
    changes = " that swells" if orders else " that drifts"
    what += changes if degree else " with overtones" if len(orders) == len(OVERTONES) else ""
    effect = mechanism_of_law("hum") if first else ""
    powers = ["", " drift", " curvature"][: degree + 1]
    steady = [f" {order} {wave}" for order in orders for wave in ("sin", "cos")] or [""]
    waves = [power + wave for power in powers for wave in steady]
    for name in names:
        for (channel, unit), scale in zip(CHANNELS, WIDTHS, strict=True):
            first += _free([f"{what}{wave} {channel} {name}" for wave in waves], scale, unit)
    return Added(what, first, stage, (), effect, frequency, tuple(orders), degree, tuple(names))


def _charges(names: Sequence[str]) -> list[Unknown]:
    """Of the coupling of each channel, in each recording."""
    found: list[Unknown] = []
    for name in names:
        for (channel, unit), scale in zip(CHANNELS, WIDTHS, strict=True):
            found += _free([f"charge {channel} {name}"], scale, unit)
    return found


def textbook_sensors(names: Sequence[str], rate: float) -> list[Sensor]:
    """The library's equations, named as its effects; amplitudes of hums and own offsets are free in every recording."""
    rings = tuple({"f_a": each.frequency, "zeta_a": each.ratio} for each in _resonators(24, rate, NARROW))
    lags = tuple({"delay_f": 0.0, "delay_a": each} for each in (0.0, 1.5e-4, 3.5e-4, -1.5e-4))
    table = (
        ("load cell", _inertia, {"m_c": 0.02}, ({"m_c": 0.0},)),
        (RISING, _accelerometer, {"f_a": 50.0, "zeta_a": 0.01}, rings),
        (FALLING, _accelerometer, {"f_b": 200.0}, ({"f_b": 1500.0}, {"f_b": 500.0})),
        ("lag", _delay, {"delay_f": 2e-5, "delay_a": 2e-5}, lags),
    )
    found: list[Sensor] = []
    for free, law, scales, at in table:
        name = mechanism_of_law(free)
        found.append(Response(name, _own(name, scales, at[0]), REGISTRY[name].stage, at, name, law))
    coupled = mechanism_of_law(HIGH_PASS)
    corners = _own(coupled, {"corner_f": 0.05, "corner_a": 0.05}, {"corner_f": 0.5, "corner_a": 0.5})
    found.append(Coupling(coupled, (*corners, *_charges(names)), 3, effect=coupled, names=tuple(names)))
    cell = mechanism_of_law("load cell")
    found.append(MassInContact(f"{cell} in contact", _own(cell, {"m_t": 0.02}, {"m_t": 0.0}), 0, effect=cell))
    hum, offset = mechanism_of_law("hum"), mechanism_of_law(OFFSET)
    found += [added(names, line, (1,), *_own(hum, {"f_m": 0.01}, {"f_m": line})) for line in (50.0, 60.0)]
    zero = _own(offset, {"o_f": 4.0, "o_a": 2.0}, {"o_f": 0.0, "o_a": 0.0})
    return [*found, Added(offset, zero, 5, effect=offset), replace(added(names), name="own offsets", effect=offset)]


def contains(family: Family, other: Family) -> bool:
    """Whether a family's free law has another's as a part or as a limit.

    Any response of one channel has its delay against the other; and coupled channels whose charges do not fade have
    offsets.
    """
    names, others = ({term.name for term in each.terms} for each in (family, other))
    if HIGH_PASS in names:
        return other.group == OFFSET
    return not names.isdisjoint((ACCELEROMETER, CELL)) and FORCE_LAG in others


def sensor_families(
    names: Sequence[str],
    rate: float,
    lines: Collection[float] = (),
    sharp: tuple[Resonator | None, Resonator | None] = (None, None),
) -> list[Family]:
    """Free laws at zero, of these recordings; of hums of ``lines`` in Hz that are there, the amplitude may swell.

    Responses of force and acceleration have resonators where channels have ``sharp`` resonances.
    """
    gains = [f"high-pass {corner:g} Hz {channel}" for channel, _ in CHANNELS for corner in SLOW_CORNERS]
    delays = _free([f"delay_a {name}" for name in names], 2e-5, "s")
    of_force, of_acceleration = (_with_sharp(_resonators(RESONATORS, rate), each) for each in sharp)
    cell = FreeResponse(CELL, CELL_MASSES + _parts(of_force), 0, channel=FORCE, rings=of_force)
    found: list[tuple[str, str, Sensor]] = [
        (ACCELEROMETER, "", FreeResponse(ACCELEROMETER, _parts(of_acceleration), 1, rings=of_acceleration)),
        ("lag", "", Response(FORCE_LAG, _free(["delay_f"], 2e-5, "s"), 3, law=_delay)),
        ("lag", " of each recording", OwnDelays("own delays", delays, 3, names=tuple(names))),
        ("load cell", "", Response("load cell", CELL_MASSES, 0, law=_inertia)),
        ("load cell", " with a response of its own", cell),
        ("load cell", " in contact only", MassInContact("load cell in contact", _free(["m_t"], 0.02, "kg"))),
        (OFFSET, "", added(names)),
        (OFFSET, " that drifts", added(names, degree=1)),
        *(("hum", f" {line:g} Hz", added(names, line, (1, 2))) for line in (50.0, 60.0)),
        *(("hum", f" {line:g} Hz with overtones", added(names, line, OVERTONES)) for line in (50.0, 60.0)),
        *(("hum", f" {line:g} Hz that swells", added(names, line, (1,), degree=2)) for line in lines),
        (HIGH_PASS, "", HighPass(HIGH_PASS, (*_free(gains, 0.2), *_charges(names)), 3, names=tuple(names))),
        ("creep", "", Response("creep", _free([f"{corner:g} Hz" for corner in CREEP_CORNERS], 0.05), 0, law=_creep)),
        ("crosstalk", "", Response("crosstalk", _free(["force on acceleration"], 1e-3, "1/kg"), 2, law=_crosstalk)),
    ]
    known = {ACCELEROMETER: mechanism_of_law(RISING)}
    said = {
        "creep": "A share of the force is read some milliseconds late: the load cell creeps.",
        "crosstalk": "The acceleration's channel carries a share of the force: the channels are coupled.",
    }
    least = {"lag": SKEW}
    return [
        Family(law + more, law, (term,), known.get(law, ""), said.get(law, ""), least=least.get(law, 0.0))
        for law, more, term in found
    ]
