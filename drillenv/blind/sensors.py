"""From the true motion to what a lab's files hold: transducers and cables that misreport, and a data logger.

Signals come on the dense grid of the integration (200 kHz or a little more), so that filters, delays by a fraction of a
sample and the logger's own anti-alias filter are followed between the samples that are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]


class Signals(NamedTuple):
    """Channels on an even grid; arrays have shape (samples,)."""

    excitation: Floats
    """V."""
    force: Floats
    """N."""
    acceleration: Floats
    """m/s^2."""


class Scene(NamedTuple):
    """What a transducer is told of a recording."""

    rate: float
    """Hz, of the dense grid."""
    time: Floats
    """(samples,) s, 0 at the first sample that is kept."""
    touching: NDArray[np.bool_]
    """(samples,) whether the indenter is on the rock."""
    from_rest: bool
    """Whether every channel was 0 before the first sample."""
    rng: np.random.Generator
    """For what differs from recording to recording."""
    realised: dict[str, float]
    """Where transducers put the parameters that they draw anew for each recording, as they are in this one."""


Transfer = tuple[list[float], list[float]]
"""Numerator and denominator of a transfer function in s, highest power first."""


def filtered(x: Floats, transfer: Transfer, scene: Scene) -> Floats:
    """The output of a linear filter that had settled on the signal's mean (from rest: on 0) before the first sample."""
    # in time steps instead of seconds, so that coefficients of high powers are of one size
    over = np.asarray(transfer[1])
    scales = scene.rate ** (np.arange(over.size)[::-1] - (over.size - 1.0))
    above = np.asarray(transfer[0]) * scales[over.size - len(transfer[0]) :]
    discrete: Any = signal.cont2discrete((above, over * scales), 1.0, method="foh")
    b, a = np.atleast_1d(np.squeeze(discrete[0])), np.atleast_1d(discrete[1])
    if scene.from_rest:
        return np.asarray(signal.lfilter(b, a, x))
    head = max(1, min(x.size, int(0.1 * scene.rate)))
    return np.asarray(signal.lfilter(b, a, x, zi=signal.lfilter_zi(b, a) * float(np.mean(x[:head])))[0])


def delayed(x: Floats, seconds: float, rate: float, taps: int = 65) -> Floats:
    """The signal so many seconds later, by a windowed sinc of ``taps`` points."""
    whole = math.floor(seconds * rate)
    part = seconds * rate - whole
    n = np.arange(taps) - taps // 2
    kernel = np.sinc(n - part) * np.kaiser(taps, 8.0)
    kernel /= kernel.sum()
    half = taps // 2
    held = np.concatenate([np.full(whole + half, x[0]), x, np.full(half, x[-1])])
    return np.convolve(held, kernel)[2 * half : 2 * half + x.size]


# --- Transfer functions, which are also the laws that the marking compares


def resonance(f: float, zeta: float) -> Transfer:
    """A second-order resonance at ``f`` Hz."""
    w = 2.0 * math.pi * f
    return [w * w], [1.0, 2.0 * zeta * w, w * w]


def part_resonance(f: float, zeta: float, share: float) -> Transfer:
    """As much as ``share`` of the signal goes through a resonance, the rest around it."""
    w = 2.0 * math.pi * f
    over = [1.0, 2.0 * zeta * w, w * w]
    return [(1.0 - share) * over[0], (1.0 - share) * over[1], w * w], over


def two_resonances(f: float, zeta: float, g: float) -> Transfer:
    """Two resonances in a row, at ``f`` and ``g`` Hz."""
    (b1, a1), (b2, a2) = resonance(f, zeta), resonance(g, zeta)
    return [b1[0] * b2[0]], list(np.polymul(a1, a2))


def first_order(f: float) -> Transfer:
    """A first-order low-pass."""
    w = 2.0 * math.pi * f
    return [w], [1.0, w]


def butterworth(f: float) -> Transfer:
    """A second-order Butterworth low-pass."""
    return resonance(f, math.sqrt(0.5))


def two_stages(f: float) -> Transfer:
    """Two first-order low-passes in a row."""
    return resonance(f, 1.0)


def bessel(f: float) -> Transfer:
    """A Bessel low-pass of fourth order, 3 dB down at ``f``."""
    made: Any = signal.bessel(4, 2.0 * math.pi * f, analog=True, norm="mag")
    b, a = made
    return list(np.atleast_1d(b)), list(a)


def all_pass(f: float) -> Transfer:
    """A first-order all-pass: no gain but a lag."""
    w = 2.0 * math.pi * f
    return [-1.0, w], [1.0, w]


def all_pass_two(f: float) -> Transfer:
    """A second-order all-pass."""
    w = 2.0 * math.pi * f
    return [1.0, -math.sqrt(3.0) * w, w * w], [1.0, math.sqrt(3.0) * w, w * w]


def high_pass(f: float) -> Transfer:
    """First-order AC coupling."""
    return [1.0, 0.0], [1.0, 2.0 * math.pi * f]


def high_pass_two(f: float) -> Transfer:
    """Second-order AC coupling, of two stages."""
    w = 2.0 * math.pi * f
    return [1.0, 0.0, 0.0], [1.0, 2.0 * w, w * w]


def leaky_charge(f: float, share: float) -> Transfer:
    """A charge amplifier whose leak leaves a share of the slow signal."""
    w = 2.0 * math.pi * f
    return [1.0, share * w], [1.0, w]


# --- Transducers: (signals, scene, parameters) -> signals

Transducer = Callable[[Signals, Scene, Mapping[str, float]], Signals]


def through(transfer: Callable[..., Transfer], channel: str, *names: str) -> Transducer:
    """A transducer that sends a channel through a transfer function of these parameters."""

    def read(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
        made = filtered(getattr(true, channel), transfer(*(p[name] for name in names)), scene)
        return true._replace(**{channel: made})

    return read


def mass_on_cell(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """A mass in front of the load cell adds its inertia."""
    return true._replace(force=true.force + p["m_c"] * true.acceleration)


def mass_on_soft_cell(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """The same on a cell that rings."""
    return true._replace(
        force=filtered(true.force + p["m_c"] * true.acceleration, resonance(p["f_c"], p["zeta_c"]), scene)
    )


def mass_behind_pad(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """The same, behind a pad that keeps high frequencies from the mass."""
    late = filtered(true.acceleration, first_order(p["f_p"]), scene)
    return true._replace(force=true.force + p["m_c"] * late)


def mass_in_contact(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """The mass moves with the indenter only while they touch."""
    return true._replace(force=true.force + p["m_c"] * true.acceleration * scene.touching)


def late_channel(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """Channels come late, each by its own time; the acceleration unless said otherwise."""
    late = (p.get("delay_e", 0.0), p.get("delay_f", 0.0), p["delay_a"])
    return Signals(*(delayed(each, by, scene.rate) if by else each for each, by in zip(true, late, strict=True)))


def late_at_random(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """The acceleration comes late, by another time in each recording."""
    late = p["delay_a"] * scene.rng.uniform(0.6, 1.4)
    scene.realised["delay_a"] = late
    return true._replace(acceleration=delayed(true.acceleration, late, scene.rate))


def hum(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """Pick-up from the mains, in the recording at a phase of its own; with harmonics, or swelling, where p says so."""
    turned = 2.0 * math.pi * p["f_m"] * scene.time
    swell = 1.0 + p.get("swell", 0.0) * np.sin(
        2.0 * math.pi * p.get("f_swell", 1.0) * scene.time + scene.rng.uniform(0.0, 2.0 * math.pi)
    )
    if "swell" in p:
        mean = float(np.mean(swell[scene.time >= 0.0]))
        scene.realised.update({name: p[name] * mean for name in ("b_e", "b_f", "b_a")})
    read = {}
    for name, size in zip(Signals._fields, (p["b_e"], p["b_f"], p["b_a"]), strict=True):
        wave = np.sin(turned + scene.rng.uniform(-math.pi, math.pi))
        for order, share in ((2, p.get("second", 0.0)), (3, p.get("third", 0.0))):
            wave = wave + share * np.sin(order * turned + scene.rng.uniform(-math.pi, math.pi))
        read[name] = getattr(true, name) + size * swell * wave
    return Signals(**read)


def offset(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """Channels that do not read zero at zero; ``spread`` and ``ramp`` make them differ and drift."""
    factor = 1.0 + p.get("spread", 0.0) * scene.rng.normal()
    drift = 1.0 + p.get("ramp", 0.0) * (scene.time - scene.time[-1] / 2.0) * math.copysign(1.0, scene.rng.normal())
    sizes = {name: p[name] * factor for name in ("o_e", "o_f", "o_a")}
    if "spread" in p:
        scene.realised.update(sizes)
    return Signals(*(each + size * drift for each, size in zip(true, sizes.values(), strict=True)))


def gain_drift(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """The load cell's gain drifts in the course of a recording."""
    return true._replace(force=true.force * (1.0 + p["rate"] * scene.time))


def crosstalk(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """The accelerometer's cable picks up the force."""
    return true._replace(acceleration=true.acceleration + p["share"] * true.force)


def creep(true: Signals, scene: Scene, p: Mapping[str, float]) -> Signals:
    """A share of the load cell's reading comes late."""
    late = filtered(true.force, first_order(1.0 / (2.0 * math.pi * p["tau"])), scene)
    return true._replace(force=(1.0 - p["share"]) * true.force + p["share"] * late)


# --- The logger


class Logger(NamedTuple):
    """How a campaign is recorded."""

    rate: float
    """Samples a second, as stated."""
    clock_error: float
    """By how much, as a share, the true rate is higher."""
    anti_alias: str
    """none, butterworth, or linear-phase."""
    corner: float
    """Of the anti-alias filter, as a share of ``rate``."""
    bits: int
    """Of the converter."""
    noise: tuple[float, float, float]
    """Standard deviation on excitation (V), force (N) and acceleration (m/s^2)."""
    colour: str
    """white, pink (white, and 1/f below a corner), or lines (white, and three weak lines)."""


def log_signals(
    dense: Signals, step: float, first: int, every: int, logger: Logger, rng: np.random.Generator
) -> Signals:
    """What the logger writes: every ``every``-th point from ``first`` on, filtered, noisy, in its converter's steps.

    ``step`` is that of the dense grid in s.
    """
    read = []
    for each, std in zip(dense, logger.noise, strict=True):
        kept = _anti_aliased(each, 1.0 / step, logger)[first::every]
        noisy = kept + _noise(kept.size, std, logger, rng)
        read.append(_converted(noisy, logger.bits))
    return Signals(*read)


def _anti_aliased(x: Floats, rate: float, logger: Logger) -> Floats:
    corner = logger.corner * logger.rate
    if logger.anti_alias == "none":
        return x
    if logger.anti_alias == "butterworth":
        sos = signal.butter(6, corner, fs=rate, output="sos")
        state = signal.sosfilt_zi(sos) * x[0]
        return np.asarray(signal.sosfilt(sos, x, zi=state)[0])
    taps = 2 * int(8.0 * rate / logger.rate) + 1
    window: Any = ("kaiser", 8.0)
    kernel = signal.firwin(taps, corner, fs=rate, window=window)
    held = np.concatenate([np.full(taps // 2, x[0]), x, np.full(taps // 2, x[-1])])
    return signal.fftconvolve(held, kernel, mode="valid")


def _noise(size: int, std: float, logger: Logger, rng: np.random.Generator) -> Floats:
    """Noise of the standard deviation ``std``; what is not white of it has a tenth to a quarter of its power."""
    white = rng.normal(0.0, std, size)
    if logger.colour == "white":
        return white
    share = rng.uniform(0.1, 0.25)
    if logger.colour == "lines":
        time = np.arange(size) / logger.rate
        lines = sum(
            math.sqrt(2.0 * share / 3.0) * std * np.sin(2.0 * math.pi * f * time + psi)
            for f, psi in zip(rng.uniform(150.0, 3000.0, 3), rng.uniform(0.0, 2.0 * math.pi, 3), strict=True)
        )
        return math.sqrt(1.0 - share) * white + lines
    frequency = np.fft.rfftfreq(size, 1.0 / logger.rate)
    spectrum = np.fft.rfft(rng.normal(0.0, 1.0, size))
    spectrum[1:] /= np.sqrt(frequency[1:])
    spectrum[0] = 0.0
    pink = np.fft.irfft(spectrum, size)
    pink *= std / float(np.std(pink))
    return math.sqrt(1.0 - share) * white + math.sqrt(share) * pink


def _converted(x: Floats, bits: int) -> Floats:
    """In the steps of a converter whose range is the next of 1, 2, 5 times a power of ten above the signal."""
    largest = 1.2 * float(np.max(np.abs(x)))
    power = 10.0 ** math.floor(math.log10(largest))
    span = next(each * power for each in (1.0, 2.0, 5.0, 10.0) if each * power >= largest)
    digit = span / 2 ** (bits - 1)
    return np.round(x / digit) * digit
