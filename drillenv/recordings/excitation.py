"""The excitation of the drilling rig: is it a tone, at which frequency and amplitude, and does its phase run on?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.findings import (
    EXCLUDE_CHANNEL,
    EXCLUDE_RECORDING,
    NOTE,
    QualityFinding,
    here_and_there,
    how_often,
    off_by_a_unit,
    severity_of,
    share_of,
    throughout,
)
from drillenv.recordings.signal_faults import runs_of_equals, stretches, time_jumps
from drillenv.recordings.units import NEAR, slip_of
from drillenv.rig import Setting

if TYPE_CHECKING:
    from drillenv.recordings.campaign import Recording

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Mask = NDArray[np.bool_]

TONE = 0.7
"""The least share of the variance that a tone followed from period to period must hold."""
FREQUENCY_TOLERANCE, LEAST_TOLERANCE = 0.002, 0.1  # of the frequency; Hz, to which settings are written down
AMPLITUDE_TOLERANCE = 0.1
OFF_THE_TONE = 0.25
"""Of the amplitude: an excitation further from its tone is not what drove the rig."""
JUMP = 0.08
"""rad. A clean tone's phase, averaged over a period, is known a hundred times better."""
MOST_JUMPS = 50
"""Looked for in one recording; one with so many is of no use."""


# --------------------------------------------------------------------------------------------------------------------
# tones


class Tone(NamedTuple):
    """A sinusoid fitted to samples."""

    frequency: float
    """Hz, by the stated sample rate."""
    amplitude: float
    phase: float
    """rad of sin, at the first sample."""
    offset: float
    purity: float
    """The share of the variance that it explains."""


def tone_at(samples: Floats, sample_rate: float, frequency: float) -> Tone:
    """The sinusoid of this frequency that fits best."""
    angle = 2 * math.pi * frequency / sample_rate * np.arange(samples.size)
    columns = np.column_stack((np.sin(angle), np.cos(angle), np.ones(samples.size)))
    (sine, cosine, offset), *_ = np.linalg.lstsq(columns, samples, rcond=None)
    spread = float(np.var(samples))
    left = float(np.var(samples - columns @ (sine, cosine, offset)))
    purity = 1.0 - left / spread if spread > 0.0 else 0.0
    return Tone(frequency, math.hypot(sine, cosine), math.atan2(cosine, sine), float(offset), purity)


def strongest_tone(samples: Floats, sample_rate: float) -> Tone:
    """The strongest sinusoid of any frequency, found in the spectrum and then refined."""
    window = np.hanning(samples.size)
    spectrum = np.abs(np.fft.rfft((samples - samples.mean()) * window))
    spectrum[0] = 0.0
    at = int(np.argmax(spectrum))
    resolution = sample_rate / samples.size
    best = tone_at(samples, sample_rate, max(at, 1) * resolution)
    width = resolution
    while width > 1e-5 * best.frequency:
        tries = [best.frequency - width / 2, best.frequency + width / 2]
        better = [tone_at(samples, sample_rate, f) for f in tries if 0.0 < f < sample_rate / 2]
        best = max([best, *better], key=lambda tone: tone.purity)
        width /= 2
    return best


def followed_tone(samples: Floats, sample_rate: float, frequency: float) -> Complexes:
    """Amplitude * exp(i phase) of the tone near ``frequency``, averaged over one period.

    Entry i belongs to the samples i to i + one period; the phase is that of a sine, a steady tone taken off.
    """
    width = max(2, round(sample_rate / frequency))
    turned = (samples - samples.mean()) * np.exp(-2j * math.pi * frequency / sample_rate * np.arange(samples.size))
    total = np.concatenate(([0.0], np.cumsum(turned)))
    return 2j * (total[width:] - total[:-width]) / width


def usual_amplitude(followed: Complexes) -> float:
    """The amplitude of a tone that may be away for up to half of the time."""
    return float(np.quantile(np.abs(followed), 0.75))


def steady_turn(followed: Complexes, width: int) -> float:
    """rad a sample, by which the phase of a followed tone runs on: its frequency is that much off."""
    return float(np.median(np.angle(followed[width:] * np.conj(followed[:-width])))) / width


def phase_jumps(samples: Floats, sample_rate: float, frequency: float) -> list[tuple[int, float]]:
    """(sample, s) where the phase jumps and stays there: time is missing, or repeated (below 0).

    The time is known only up to whole periods.
    """
    followed = followed_tone(samples, sample_rate, frequency)
    width = max(2, round(sample_rate / frequency))
    if followed.size < 6 * width:
        return []
    turn = steady_turn(followed, width)
    followed = followed * np.exp(-1j * turn * np.arange(followed.size))
    amplitude = np.abs(followed)
    sound = amplitude > 0.8 * usual_amplitude(followed)
    way = followed / np.maximum(amplitude, 1e-300)
    # What a jump at i changes: the window that ends at i against the one that begins there.
    change = np.zeros(followed.size)
    change[width:] = np.abs(way[width:] - way[:-width])
    limit = max(JUMP, 6.0 * float(np.median(change)))
    found: list[tuple[int, float]] = []
    free = change > limit
    while free.any() and len(found) < MOST_JUMPS:
        at = int(np.argmax(np.where(free, change, 0.0)))
        free[max(0, at - 2 * width) : at + 2 * width] = False
        before = _sound_part(sound, [(at - 5 * width, at - 3 * width), (at - 2 * width, at - width)], width)
        after = _sound_part(sound, [(at + 2 * width, at + 4 * width), (at, at + width)], width)
        if before is None or after is None:
            continue
        first, second = _middle(followed[before]), _middle(followed[after])
        stays = float(np.angle(second * np.conj(first)))
        if abs(stays) > limit:
            near = slice(max(0, at - width), min(samples.size, at + width))
            turning = np.exp(1j * (2 * math.pi * frequency / sample_rate + turn) * np.arange(near.start, near.stop))
            at = near.start + _break(samples[near] - samples.mean(), (first * turning).imag, (second * turning).imag)
            found.append((at, stays / (2 * math.pi * frequency)))
    return sorted(found)


def _middle(followed: Complexes) -> complex:
    """The mean of a tone, its phase the median, which what spoils a smaller part of it does not turn."""
    mean = complex(followed.mean())
    return mean * complex(np.exp(1j * np.median(np.angle(followed * np.conj(mean)))))


def _break(samples: Floats, first: Floats, second: Floats) -> int:
    """The sample at which what was ``first`` becomes ``second``."""
    up_to = np.concatenate(([0.0], np.cumsum((samples - first) ** 2 - (samples - second) ** 2)))
    return int(np.argmin(up_to))


def _sound_part(sound: Mask, parts: Sequence[tuple[int, int]], width: int) -> slice | None:
    """The first part in which the tone is sound: rather some way off a jump, beyond what a short dropout spoils."""
    for (start, stop), least in zip(parts, (0.5, 0.95), strict=True):
        part = slice(max(0, start), min(sound.size, stop))
        if part.stop - part.start >= width // 2 and sound[part].mean() > least:
            return part
    return None


def tone_share(samples: Floats, sample_rate: float, frequency: float) -> float:
    """The share of the variance that lies in a tone near ``frequency``, its phase free to change slowly.

    Above 1 where the tone is away for a while.
    """
    spread = float(np.var(samples))
    if spread == 0.0 or frequency >= sample_rate / 2:
        return 0.0
    return usual_amplitude(followed_tone(samples, sample_rate, frequency)) ** 2 / 2.0 / spread


# --------------------------------------------------------------------------------------------------------------------
# findings


def excitation_findings(
    recording: Recording, setting: Setting, filled: Mapping[str, Floats], bad: Mapping[str, Mask]
) -> tuple[list[QualityFinding], float, Mask]:
    """Findings on the excitation channel, its frequency in Hz (the setting's where it cannot be told), where it is off.

    Off means no tone: the samples found faulty before, and those found here.
    """
    rate, stated = recording.sample_rate, setting.frequency
    off = bad.get("excitation", np.ones(recording.size, dtype=bool))
    samples = filled.get("excitation")
    if samples is None or stated >= rate / 2:
        return [], stated, off
    if tone_share(samples, rate, stated) < TONE:
        tone = strongest_tone(samples, rate) if np.ptp(samples) > 0.0 else None
        if tone is None or tone.purity < TONE:
            text = (
                f"it holds no tone at {stated:g} Hz, so that the phase of the drive is unknown: connect and record it"
            )
            return [throughout(recording, "excitation", "missing-excitation", text, EXCLUDE_RECORDING)], stated, off
        return [_other_frequency(recording, setting, tone.frequency)], tone.frequency, off
    followed = followed_tone(samples, rate, stated)
    frequency = stated + steady_turn(followed, max(2, round(rate / stated))) * rate / (2 * math.pi)
    found = []
    if abs(frequency - stated) > max(FREQUENCY_TOLERANCE * stated, LEAST_TOLERANCE):
        found.append(_other_frequency(recording, setting, frequency))
    if np.count_nonzero(off) < 0.01 * recording.size:  # a clipped tone is small by that alone
        found += _amplitude(recording, setting, usual_amplitude(followed))
    jumps = phase_jumps(samples, rate, frequency)
    if not _clock_jumps(recording):
        found += _phase_gaps(recording, jumps)
    away = _off_the_tone(samples, rate, frequency, [at for at, _ in jumps]) & ~off
    if away.any():
        found.append(_dropouts(recording, away, frequency))
    return found, frequency, off | away


def _other_frequency(recording: Recording, setting: Setting, frequency: float) -> QualityFinding:
    rate = recording.sample_rate * setting.frequency / frequency
    text = (
        f"at {recording.sample_rate:g} samples a second the excitation has {frequency:.5g} Hz where the setting says "
        f"{setting.frequency:g} Hz: correct the frequency of the setting, or the sample rate (to about {rate:.5g} Hz)"
    )
    return throughout(recording, "excitation", "sample-rate", text, EXCLUDE_RECORDING)


def _amplitude(recording: Recording, setting: Setting, measured: float) -> list[QualityFinding]:
    ratio = measured / setting.amplitude
    if abs(ratio - 1.0) <= AMPLITUDE_TOLERANCE:
        return []
    slip = slip_of(ratio, NEAR) if ratio > 0.0 else 0.0
    if slip:
        unit, why = recording.channels["excitation"].unit, "its amplitude against the setting"
        return [off_by_a_unit(recording, "excitation", unit, slip, why, [], EXCLUDE_CHANNEL)]
    text = f"its amplitude is {measured:.4g} V, the setting says {setting.amplitude:g} V: correct one of them"
    return [throughout(recording, "excitation", "excitation", text, NOTE)]


def _clock_jumps(recording: Recording) -> bool:
    """Whether the file's own time shows the gaps itself."""
    clock = recording.clock
    return clock is not None and bool(np.isfinite(clock).all()) and bool(time_jumps(clock, recording.sample_rate))


def _phase_gaps(recording: Recording, jumps: Sequence[tuple[int, float]]) -> list[QualityFinding]:
    if not jumps:
        return []
    where = [(max(0, at - 1), min(recording.size, at + 1)) for at, _ in jumps]
    listed = ", ".join(f"{1e3 * seconds:+.3g} ms at {at / recording.sample_rate:.4g} s" for at, seconds in jumps[:4])
    text = (
        f"the phase of the excitation jumps {how_often(where)} ({listed}, give or take whole periods), as where "
        "samples were lost or the generator began anew: cut the recording there"
    )
    return [here_and_there(recording, None, "time-gap", where, text, severity_of(recording, where, True))]


def _off_the_tone(samples: Floats, rate: float, frequency: float, jumps: Sequence[int]) -> Mask:
    """Where the excitation is not the tone it is elsewhere."""
    width = max(2, round(rate / frequency))
    off = np.zeros(samples.size, dtype=bool)
    edges = [0, *jumps, samples.size]
    for start, stop in itertools.pairwise(edges):
        if stop - start < 2 * width:
            continue
        part = samples[start:stop]
        followed = followed_tone(part, rate, frequency)
        size = usual_amplitude(followed)
        sound = np.abs(followed) > 0.8 * size
        if not sound.any():
            off[start:stop] = True
            continue
        # From what is sound of it, then a fit to the samples that agree with that.
        total = np.concatenate(([0.0], np.cumsum(part)))
        offset = float(np.median((total[width:] - total[:-width])[sound])) / width
        angle = 2 * math.pi * frequency / rate * np.arange(part.size)
        left = np.abs(part - offset - size * np.sin(angle + np.angle(followed[sound].mean())))
        agrees = left < 2 * OFF_THE_TONE * size
        if np.count_nonzero(agrees) > 2 * width:
            columns = np.column_stack((np.sin(angle), np.cos(angle), np.ones(part.size)))
            fit, *_ = np.linalg.lstsq(columns[agrees], part[agrees], rcond=None)
            left = np.abs(part - columns @ fit)
            size = math.hypot(fit[0], fit[1])
        noise = 9.0 * float(np.median(left))
        off[start:stop] = _reached(left > max(OFF_THE_TONE * size, noise), left > noise, width // 4)
    for at in jumps:  # known to within some samples only
        off[max(0, at - width // 8) : at + width // 8] = False
    for run in runs_of_equals(samples):  # a value that is held may lie on the tone for a while
        if off[run.start : run.stop].any():
            off[run.start : run.stop] = True
    return off


def _reached(surely: Mask, perhaps: Mask, most: int) -> Mask:
    """What is sure, with what is joined to it by samples that may be of it, up to ``most`` at either end."""
    found = surely.copy()
    for start, stop in stretches(surely):
        before, after = perhaps[max(0, start - most) : start], perhaps[stop : stop + most]
        first = start - int(np.argmin(np.append(before[::-1], False)))
        last = stop + int(np.argmin(np.append(after, False)))
        found[first:last] = True
    return found


def _dropouts(recording: Recording, off: Mask, frequency: float) -> QualityFinding:
    where = stretches(off, join=max(2, round(recording.sample_rate / frequency)) // 2)
    text = (
        f"it leaves its tone {how_often(where)}, {100 * share_of(recording, where):.2g} % of the time: leave these "
        "stretches out, for what drove the rig then is not known"
    )
    return here_and_there(recording, "excitation", "dropout", where, text, severity_of(recording, where, False))
