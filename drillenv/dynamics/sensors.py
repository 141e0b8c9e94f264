"""What a laboratory would record of the rig: its channels through sensors that may misreport, with noise, digitised.

The motion knows nothing of this. :func:`record` runs the rig and hands its channels to the sensors; :func:`read` and
:func:`digitised` do the same for channels that are already there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from drillenv.checks import InputError, count, number, shown
from drillenv.dynamics.effects import Channels, Chosen
from drillenv.dynamics.hybrid.model import Start
from drillenv.dynamics.hybrid.run import HybridRun, run_hybrid
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

WARM = 0.1
"""s of the lead, at most, for which the sensors are followed too; what they remember is gone long before."""


class PerChannel(NamedTuple):
    """One number a channel: a standard deviation of noise, or the largest value that fits."""

    excitation: float
    """V."""
    force: float
    """N."""
    acceleration: float
    """m/s^2."""


class Recording(NamedTuple):
    """What :func:`record` returns. Arrays of samples have shape (samples,)."""

    channels: Channels
    """As recorded, the first sample at time 0."""
    truth: Channels
    """The same without sensors, noise and digits."""
    end: Start
    """State of the rig at the end, to go on from with ``end_phase``."""
    end_phase: float
    """rad."""


def record(
    rig: Rig,
    setting: Setting,
    rock: Rock,
    seconds: float,
    sample_rate: float = 25600.0,
    *,
    effects: Iterable[Chosen] = (),
    sensors: Iterable[Chosen] = (),
    phase: float = 0.0,
    start: Start | None = None,
    lead: float = 0.0,
    noise: PerChannel | None = None,
    bits: int | None = None,
    spans: PerChannel | None = None,
    rng: np.random.Generator | None = None,
    oversample: int = 16,
) -> Recording:
    """Record the rig.

    Between samples a sensor that rings, lags or is slow is followed on ``oversample`` times as many points. At 16 times
    25.6 kHz the error left is below a thousandth of a blow's acceleration. Only where dry friction makes the
    acceleration jump, a delayed sample less than a point away from the jump is off by up to two thirds of it.

    Args:
        rig, setting, rock, effects, start: As for :func:`drillenv.dynamics.hybrid.run.run_hybrid`.
        seconds: Duration in s.
        sample_rate: Samples a second, the first at time 0.
        sensors: Effects that misreport channels, from :func:`drillenv.dynamics.effects.make`.
        phase: Phase of the excitation at time 0 in rad.
        lead: s for which the rig runs before time 0; at least 1 for a recording of a rig that had been running.
        noise: Standard deviation of white noise on each channel. Left out, there is none.
        bits: Of the converter, 4 to 32; it clips at ``spans`` either way. Left out, the numbers are not rounded.
        spans: Largest value that each channel of the converter can hold.
        rng: Where the noise comes from.
        oversample: 1 to 1000.

    Raises:
        InputError: a value out of range, noise without a generator, bits without spans, or what run_hybrid and
            :func:`read` refuse.
    """
    sensors = in_order(sensors)
    seconds = number("seconds", seconds, 0.0, 1e6, "s")
    sample_rate = number("sample_rate", sample_rate, 1.0, 1e8, "Hz")
    lead = number("lead", lead, 0.0, 1e6, "s")
    phase = number("phase", phase, -1e6, 1e6, "rad")
    fine = count("oversample", oversample, 1, 1000)
    fine = fine if any(chosen.effect.needs_fine and not chosen.is_neutral for chosen in sensors) else 1
    _check_converter(noise, bits, spans, rng)

    warm = math.floor(min(lead, WARM) * sample_rate)
    begin = -warm / sample_rate
    from_rest = start is None and lead == 0.0
    started = phase - 2 * math.pi * math.fmod(setting.frequency * lead, 1.0)
    effects = tuple(effects)
    if lead > 0.0:
        leading = run_hybrid(rig, setting, rock, lead + begin, 0.0, started, start, effects)
        start, started = leading.end, leading.end_phase
    run = run_hybrid(rig, setting, rock, seconds - begin, fine * sample_rate, started, start, effects)
    dense = channels_of(run, setting, started, begin, from_rest)
    recorded = _every(read(dense, sensors), fine, warm)
    return Recording(digitised(recorded, noise, bits, spans, rng), _every(dense, fine, warm), run.end, run.end_phase)


def channels_of(
    run: HybridRun, setting: Setting, phase: float = 0.0, begin: float = 0.0, from_rest: bool = False
) -> Channels:
    """The true channels of a run with samples, which began at this phase of the excitation in rad.

    Raises:
        InputError: the run has fewer than two samples.
    """
    if run.time.size < 2:
        raise InputError(f"the run has {run.time.size} samples: run it with a sample_rate above 0")
    turns = np.mod(setting.frequency * run.time, 1.0)
    excitation = setting.amplitude * np.sin(phase + 2 * math.pi * turns)
    return Channels(1.0 / float(run.time[1]), begin, excitation, run.force, run.acceleration, from_rest)


def in_order(sensors: Iterable[Chosen]) -> tuple[Chosen, ...]:
    """Effects on sensors in the order in which they act: the mass in front, the transducer, the line, its zero.

    Raises:
        InputError: not effects of sensors, or one given twice.
    """
    chosen = tuple(sensors)
    for each in chosen:
        if not isinstance(each, Chosen):
            raise InputError(
                f"sensors holds {shown(each)}: give effects from drillenv.dynamics.effects.make(name, ...)"
            )
        if each.effect.measure is None:
            raise InputError(f"effect {each.effect.name} is none of a sensor: give it as one of the effects")
        if sum(each.effect.name == other.effect.name for other in chosen) > 1:
            raise InputError(f"effect {each.effect.name} is given twice: give it once")
    return tuple(sorted(chosen, key=lambda each: each.effect.stage))


def read(true: Channels, sensors: Iterable[Chosen]) -> Channels:
    """What sensors make of true channels. Sample them densely where a sensor rings, lags or is slow.

    Raises:
        InputError: not effects of sensors, or one given twice.
    """
    reading = true
    for chosen in in_order(sensors):
        assert chosen.effect.measure is not None
        reading = chosen.effect.measure(true, reading, chosen.values)
    return reading


def digitised(
    channels: Channels,
    noise: PerChannel | None = None,
    bits: int | None = None,
    spans: PerChannel | None = None,
    rng: np.random.Generator | None = None,
) -> Channels:
    """Channels with white noise, as a converter of so many bits gives them. Arguments as for :func:`record`.

    Raises:
        InputError: a value out of range, noise without a generator, or bits without spans.
    """
    _check_converter(noise, bits, spans, rng)
    parts = [channels.excitation, channels.force, channels.acceleration]
    if noise is not None and rng is not None:
        parts = [part + rng.normal(0.0, std, part.size) for part, std in zip(parts, noise, strict=True)]
    if bits is not None and spans is not None:
        parts = [_rounded(part, span, bits) for part, span in zip(parts, spans, strict=True)]
    return channels._replace(excitation=parts[0], force=parts[1], acceleration=parts[2])


def _rounded(signal: np.ndarray, span: float, bits: int) -> np.ndarray:
    """A signal in the steps of a converter that holds -span up to one step below span."""
    half = 2 ** (bits - 1)
    digit = span / half
    return np.clip(np.round(signal / digit), -half, half - 1) * digit


def _every(dense: Channels, fine: int, skip: int) -> Channels:
    """Every ``fine``-th sample, without the first ``skip`` of those, so that the first is at time 0."""
    if fine == 1 and skip == 0:
        return dense
    kept = slice(fine * skip, None, fine)
    excitation, force, acceleration = (
        part[kept].copy() for part in (dense.excitation, dense.force, dense.acceleration)
    )
    return Channels(dense.rate / fine, 0.0, excitation, force, acceleration, dense.from_rest)


def _check_converter(noise, bits, spans, rng) -> None:
    """Refuse noise and digits that cannot be made."""
    if noise is not None:
        for name, std in zip(PerChannel._fields, PerChannel(*noise), strict=True):
            number(f"noise on the {name}", std, 0.0, 1e6)
        if not isinstance(rng, np.random.Generator):
            raise InputError(
                f"rng is {shown(rng)}: noise needs a numpy Generator, such as numpy.random.default_rng(seed)"
            )
    if bits is not None:
        count("bits", bits, 4, 32)
        if spans is None:
            raise InputError("bits without spans: give the largest value that each channel of the converter can hold")
        for name, span in zip(PerChannel._fields, PerChannel(*spans), strict=True):
            number(f"span of the {name}", span, 1e-9, 1e9)
