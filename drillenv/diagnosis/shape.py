"""What is left, in words: periodic or not, when in a recording, at which impacts, at which settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import spearmanr

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import Fit
from drillenv.diagnosis.shooting import residual

CHANNELS = (("force", "N"), ("acceleration", "m/s^2"))
LINE = 30.0
"""Power over its mean above which a single frequency in what is left is no noise (chance below 1e-8 a campaign)."""
SAME = 15.0
"""The same for a frequency that stood out elsewhere."""
MOST = 0.6
"""Share of the recordings that have to have a frequency for it to be one of the rig."""
HIGHEST = 2000.0
"""Hz up to which common frequencies are looked for."""
TREND, SURE = 0.35, 1e-4
"""Rank correlation, and its probability under chance, from which what is left grows or fades."""
FEW, BULK = 0.25, 0.8
"""What is left is on single impacts where so few of the windows have so much of it."""
BINS, NARROW = 8, 0.6
"""Parts of an excitation period, and the share in two neighbours from which what is left sits at a phase."""
SETTING = 0.9
"""Rank correlation over recordings from which what is left goes with a setting."""


PHASES = 32
"""Parts of an excitation period over which what is left is averaged."""
REPEATED = 6.0
"""Standard deviations of chance beyond which what is left repeats itself (below 1e-8 a campaign; nulls reach 1)."""


class Line(NamedTuple):
    """A frequency that stands out of what is left of one channel."""

    recording: str
    channel: str
    frequency: float
    """Hz."""
    power: float
    """Over that of white noise as strong as the sensor's."""


class Common(NamedTuple):
    """A frequency that the recordings share, whatever their excitation."""

    channel: str
    frequency: float
    """Hz."""
    amplitude: float
    """Median over the recordings, in the channel's unit."""
    recordings: int
    """That have it."""
    of: int
    """Whose excitation does not hide it."""


def lines_left(recordings: Sequence[Conditioned], fitted: Fit) -> list[Line]:
    """The frequency that stands out most of each recording and channel, if one does.

    Multiples of the excitation's are those of any misfit of the motion, and are passed over.
    """
    found = []
    for data, made in zip(recordings, fitted.predictions, strict=True):
        for (channel, _unit), signal in zip(CHANNELS, residual(data, made)[:, data.judged], strict=True):
            bins, power = _spectrum(signal, data.rate)
            power[_hidden(bins, data.setting.frequency)] = 0.0
            top = int(np.argmax(power))
            if power[top] > LINE:
                found.append(Line(data.name, channel, float(bins[top]), float(power[top])))
    return found


class Repeated(NamedTuple):
    """How far beyond chance what is left repeats itself from period to period, in standard deviations."""

    steady: float
    """All through a recording."""
    changing: float
    """Growing, fading or turning round in the course of it."""

    @property
    def sure(self) -> bool:
        """Whether one of them is no chance."""
        return max(self) > REPEATED


def repeated(recordings: Sequence[Conditioned], fitted: Fit) -> Repeated:
    """Whether what is left is the same at the same phase of the excitation.

    Its averages over PHASES parts of the period, and its slopes there along the recording, are compared with what
    white noise as strong gives: the sum of their squares has a chi-square distribution.
    """
    count, steady, changing = 0, 0.0, 0.0
    for data, made in zip(recordings, fitted.predictions, strict=True):
        at = np.arange(data.force.size)[data.judged]
        turn = np.mod((data.phase + data.omega * at / data.rate) / (2 * math.pi), 1.0)
        part, time = (turn * PHASES).astype(int) % PHASES, at - at.mean()
        here, moment = np.bincount(part, minlength=PHASES), np.bincount(part, time**2, PHASES)
        for signal in residual(data, made)[:, data.judged]:
            scaled = signal / max(float(signal.std()), 1e-12)
            count += PHASES
            steady += float((np.bincount(part, scaled, PHASES) ** 2 / np.maximum(here, 1)).sum())
            changing += float((np.bincount(part, scaled * time, PHASES) ** 2 / np.maximum(moment, 1.0)).sum())
    width = math.sqrt(2.0 * max(count, 1))
    return Repeated((steady - count) / width, (changing - count) / width)


def _spectrum(signal: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz, and power there over that of white noise of standard deviation 1, through a Hann window.

    Without a window a misfit of the motion would leak from the multiples of the excitation to frequencies beside them.
    """
    window = np.hanning(signal.size)
    return np.fft.rfftfreq(signal.size, 1.0 / rate), np.abs(np.fft.rfft(signal * window)) ** 2 / np.sum(window**2)


def _hidden(bins: np.ndarray, excitation: float) -> np.ndarray:
    """Which frequencies are multiples of that of the excitation, as wide as a Hann window makes them."""
    return np.abs(bins - excitation * np.round(bins / excitation)) < 2.5 * bins[1]


def common_line(recordings: Sequence[Conditioned], fitted: Fit) -> Common | None:
    """The strongest frequency that most recordings share, if there is one."""
    best: tuple[float, Common] | None = None
    for row, (channel, _unit) in enumerate(CHANNELS):
        spectra = []
        for data, made in zip(recordings, fitted.predictions, strict=True):
            signal = residual(data, made)[row, data.judged]
            bins, power = _spectrum(signal, data.rate)
            hidden = _hidden(bins, 0.5 * data.setting.frequency) | (bins < 2.0 * bins[1]) | (bins > HIGHEST)
            power[hidden] = np.nan
            noise = data.noise_force if channel == "force" else data.noise_acceleration
            # of a line under a Hann window
            amplitude = noise * math.sqrt(6.0 / signal.size)
            spectra.append((bins, power, amplitude))
        for bins, power, _amplitude in spectra:
            if not np.isfinite(power).any() or np.nanmax(power) < LINE:
                continue
            common = _shared(channel, float(bins[np.nanargmax(power)]), spectra)
            if common is not None and (best is None or common[0] > best[0]):
                best = common
    return None if best is None else best[1]


def _shared(channel: str, frequency: float, spectra: Sequence[tuple]) -> tuple[float, Common] | None:
    """How strongly the recordings share a frequency of one of them: the median of its power, and what to say of it."""
    powers, places, sizes = [], [], []
    for bins, power, amplitude in spectra:
        near = np.flatnonzero(np.abs(bins - frequency) < 1.2 * bins[1])
        if not near.size or np.isnan(power[near]).any():
            continue
        top = near[np.argmax(power[near])]
        powers.append(power[top])
        # the centre of the three bins of a Hann window's peak
        around = slice(max(top - 1, 0), top + 2)
        places.append(float(np.nansum(power[around] * bins[around]) / np.nansum(power[around])))
        sizes.append(amplitude * math.sqrt(power[top]))
    strong = np.array(powers) > SAME
    if len(powers) < 3 or strong.mean() < MOST:
        return None
    place = float(np.average(places, weights=powers))
    found = Common(channel, place, float(np.median(sizes)), int(strong.sum()), len(powers))
    return float(np.median(powers)), found


def described(recordings: Sequence[Conditioned], fitted: Fit) -> list[str]:
    """What is left, in sentences."""
    said = []
    line = common_line(recordings, fitted)
    if line is not None:
        unit = dict(CHANNELS)[line.channel]
        said.append(
            f"It is periodic at {line.frequency:.1f} Hz, unrelated to the excitation, in {line.recordings} of "
            f"{line.of} recordings; in the {line.channel} with an amplitude of about {line.amplitude:.2g} {unit}."
        )
    again = repeated(recordings, fitted)
    if again.sure:
        how = "changing steadily in the course of a recording" if again.changing > again.steady else "alike throughout"
        said.append(
            f"It repeats itself from period to period, {how}: {max(again):.0f} standard deviations past chance."
        )
    windows = _windows(recordings, fitted)
    excess = np.concatenate([each[1] for each in windows])
    total = float(np.maximum(excess, 0.0).sum())
    if total <= 0.0:
        return said
    said += _in_time(recordings, windows)
    ranked = np.sort(excess)[::-1]
    few = int(np.searchsorted(np.cumsum(ranked), BULK * float(excess.sum()))) + 1
    if float(excess.sum()) > 0.0 and few < FEW * excess.size:
        said.append(f"{few} of {excess.size} impacts have {BULK:.0%} of it.")
    said += _at_phase(recordings, fitted)
    said += _by_setting(recordings, windows)
    return said


def _windows(recordings: Sequence[Conditioned], fitted: Fit) -> list[tuple[np.ndarray, np.ndarray]]:
    """(windows,) times in s and surplus of the sum of squares over the noise's, of each recording."""
    found = []
    for data, made in zip(recordings, fitted.predictions, strict=True):
        squares = (residual(data, made) ** 2).sum(axis=0)
        starts = data.starts[(data.starts >= data.judged.start) & (data.starts <= data.judged.stop)]
        sums = np.add.reduceat(squares, starts[:-1])
        found.append((starts[:-1] / data.rate, sums - 2.0 * np.diff(starts)))
    return found


def _in_time(recordings: Sequence[Conditioned], windows: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """Whether it grows or fades in a recording, and whether it is one of fresh rock."""
    times = np.concatenate([time - time.mean() for time, _sums in windows])
    # as a share of each recording's own, so that a setting at which there is more of it is no trend
    ranks = np.concatenate([np.argsort(np.argsort(sums)) / max(sums.size - 1, 1) - 0.5 for _time, sums in windows])
    found: Any = spearmanr(times, ranks)
    trend, chance = float(found.statistic), float(found.pvalue)
    said = []
    if abs(trend) > TREND and chance < SURE:
        said.append(f"It {'grows' if trend > 0.0 else 'fades'} in the course of a recording.")
    fresh = np.array([data.fresh for data in recordings])
    if fresh.any() and not fresh.all():
        each = np.array([sums.mean() for _time, sums in windows])
        if np.median(each[fresh]) > 10.0 * max(float(np.median(each[~fresh])), 1.0):
            said.append("It is one of fresh rock.")
    return said


def _at_phase(recordings: Sequence[Conditioned], fitted: Fit) -> list[str]:
    """Whether it sits in one part of the excitation period."""
    surplus = np.zeros(BINS)
    for data, made in zip(recordings, fitted.predictions, strict=True):
        squares = (residual(data, made) ** 2).sum(axis=0) - 2.0
        at = np.arange(data.force.size)[data.judged]
        turn = np.mod((data.phase + data.omega * at / data.rate) / (2 * math.pi), 1.0)
        surplus += np.bincount((turn * BINS).astype(int) % BINS, squares[data.judged], BINS)
    total = surplus.sum()
    if total <= 0.0:
        return []
    pairs = surplus + np.roll(surplus, -1)
    top = int(np.argmax(pairs))
    if pairs[top] < NARROW * total:
        return []
    low, high = top * 360 / BINS, (top + 2) * 360 / BINS
    return [f"{pairs[top] / total:.0%} of it is where the excitation's phase is {low:.0f} to {high:.0f} degrees."]


def _by_setting(recordings: Sequence[Conditioned], windows: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """Whether there is more of it at a high or low frequency, amplitude or pressure."""
    if len(recordings) < 5:
        return []
    each = np.array([sums.mean() for _time, sums in windows])
    said = []
    for name in ("frequency", "amplitude", "pressure"):
        values = np.array([getattr(data.setting, name) for data in recordings])
        if np.ptp(values) == 0.0:
            continue
        found: Any = spearmanr(values, each)
        along = float(found.statistic)
        if abs(along) > SETTING:
            said.append(f"There is more of it at {'high' if along > 0.0 else 'low'} {name}.")
    return said
