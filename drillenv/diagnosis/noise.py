"""The measurement noise of one channel of one recording: its spectrum from a residual, whitening, spectral lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, signal, stats

from drillenv.diagnosis.comb import Orders, distances, without_harmonics

Floats = NDArray[np.float64]

CAP = 5.0
"""Periodogram ordinates count at most this many times their expectation in a fit of the spectrum."""
SECTIONS = 6
"""Of the whitening filter, each with one pole and one zero."""
MOST_STEPS = 600
"""Of the least squares that find these: corners near to the Nyquist frequency may need more than SciPy takes."""
SLOWER = math.log(1e3)
"""Logarithm of the range of frequencies below 1 / T over which 1/f noise is taken to go on."""
MOST_LINES = 8
FALSE_ALARM = 1e-3
"""Family-wise probability that white noise shows a line."""
_SUBHARMONICS: tuple[Orders, ...] = ((1, 2, 3, 4), (1, 2), (1,))
LONE, LONE_REACH, LONE_LEAST = 4.0, 6.0, 20.0
"""Power of a line on a harmonic over that of all within so many harmonics of it, and over the noise, at least."""


BAND_LEAST = 20
"""Values at 0, and just beyond a dead band: without one as many would lie below, by chance none once in 2^20."""


@dataclass(frozen=True)
class NoiseModel:
    """White noise, with 1/f noise below a corner, and sinusoidal lines.

    Attributes:
        std: Standard deviation of the white part per sample, in units of the channel; it includes that of rounding.
        corner: Frequency at which the 1/f part has the power of the white one, in Hz; 0 where there is none.
        lines: Frequencies of the sinusoidal lines in Hz.
        rate: Samples per second.
    """

    std: float
    corner: float
    lines: tuple[float, ...]
    rate: float

    def spectrum(self, frequencies: ArrayLike) -> Floats:
        """One-sided power spectral density at frequencies > 0 in Hz, in units squared per Hz, without the lines."""
        return 2.0 * self.std**2 / self.rate * (1.0 + self.corner / np.asarray(frequencies, dtype=float))


def estimate(residual: ArrayLike, rate: float, fundamental: float, converter_lsb: float = 0.0) -> NoiseModel:
    """Estimate the noise from a residual (n,) that may hold periodic misfit.

    Harmonics of the fundamental (Hz) and of its 2nd to 4th subharmonics are removed by least squares, and the bins
    next to them left out. To the other ordinates of the periodogram the spectrum is fitted by Whittle's likelihood
    with a bounded influence. A corner is kept if a likelihood-ratio test at 1 % asks for it. Lines are looked for in
    the residual whitened so, then removed, and the fit is repeated. A converter's step sets the least ``std``, step /
    sqrt(12), for rounding adds about white noise of that size.

    Misfit that is not periodic, such as one strong transient, has a continuous spectrum and is not told from noise:
    with a tenth of the noise's power it shifts ``std`` by up to about 3 %; with more, the model is that of their sum.

    Raises:
        ValueError: The residual is constant or shorter than 64 samples.
    """
    samples = np.asarray(residual, dtype=float)
    if samples.size < 64 or not np.ptp(samples) > 0.0:
        raise ValueError(f"a residual of {samples.size} samples, all equal if more than 63: give 64 that vary")
    model = NoiseModel(1.0, 0.0, (), rate)
    for _ in range(3):
        std, corner = _level(samples, model.lines, rate, fundamental)
        model = replace(model, std=max(std, converter_lsb / math.sqrt(12.0)), corner=corner)
        lines = find_lines(samples, rate, fundamental, model)
        settled = len(lines) == len(model.lines)
        model = replace(model, lines=lines)
        if settled:
            break
    return model


def _level(samples: Floats, lines: tuple[float, ...], rate: float, fundamental: float) -> tuple[float, float]:
    """Standard deviation of the white part and corner frequency (Hz), away from harmonics and lines."""
    n, tone = samples.size, fundamental / rate
    bins = np.arange(2, (n - 1) // 2)
    for orders in _SUBHARMONICS:
        nearest, leverage = distances(bins, n, tone, orders)
        if np.mean(nearest > 1.0) > 0.25:  # else the recording is too short to tell these subharmonics apart
            break
    at_lines = np.array(lines)[:, None] * n / rate - bins
    nearest = np.minimum(nearest, np.abs(at_lines).min(axis=0, initial=np.inf))
    leverage = leverage + np.sum(np.sinc(at_lines) ** 2, axis=0)
    rest = without_harmonics(samples, tone, orders)
    if lines:  # seen best without the harmonics, whose fit in turn is better without the lines
        rest = without_harmonics(samples - fitted_lines(rest, lines, rate), tone, orders)
    keep = nearest > 1.0
    power = np.abs(np.fft.rfft(rest)[bins[keep]]) ** 2 / n / (1.0 - np.minimum(leverage[keep], 0.5))
    return _whittle(power, bins[keep] * rate / n)


def _whittle(power: Floats, frequencies: Floats) -> tuple[float, float]:
    """Fit variance * (1 + corner / f) to exponential ordinates: standard deviation and corner.

    The ordinate by its expectation, u, enters the score as min(u, CAP), whose mean 1 - exp(-CAP) is taken off.
    """
    centre = -math.expm1(-CAP)

    def loss(log_variance: float, corner: float) -> tuple[float, Floats]:
        shape = 1.0 + corner / frequencies
        u = power * math.exp(-log_variance) / shape
        value = np.where(u < CAP, u, CAP + CAP * np.log(np.maximum(u, CAP) / CAP)) + centre * np.log(shape)
        score = centre - np.minimum(u, CAP)
        return float(value.sum()) + centre * log_variance * u.size, np.array([score.sum(), score @ (1.0 - 1.0 / shape)])

    start = math.log(np.median(power) / math.log(2.0))
    white: Any = optimize.minimize_scalar(
        lambda x: loss(x, 0.0)[0], bounds=(start - 2.0, start + 2.0), method="bounded"
    )
    limits = [(start - 4.0, start + 4.0), (math.log(0.1 * frequencies[0]), math.log(frequencies[-1]))]
    starts = [(white.x - 0.1, math.log(ratio * frequencies[-1])) for ratio in (1e-3, 0.05)]
    found: list[Any] = [
        optimize.minimize(lambda x: loss(x[0], math.exp(x[1])), x, jac=True, bounds=limits, method="TNC")
        for x in starts
    ]
    pink = min(found, key=lambda each: each.fun)
    # Of a score of bounded influence: its slope and its variance, equal for a likelihood proper.
    slope = 1.0 - (1.0 + CAP) * math.exp(-CAP)
    ratio = 2.0 * (white.fun - pink.fun) * slope / (2.0 * slope - centre**2)
    if ratio > stats.chi2.isf(0.02, 1):  # 1 %, since the corner is at its bound half the time
        return math.exp(0.5 * pink.x[0]), math.exp(pink.x[1])
    return math.exp(0.5 * white.x), 0.0


def whiten(model: NoiseModel, columns: ArrayLike) -> Floats:
    """Filter along the last axis so that noise of the model, without its lines, becomes white with variance 1.

    White noise is divided by its standard deviation. Else columns (..., n) pass a causal minimum-phase filter of
    first-order sections, within 5 % of the spectrum in power from 2 / T to the Nyquist frequency. It starts from
    rest, as if all were zero before the first sample: residuals and columns filtered alike stay consistent, and the
    first samples of the noise weigh a little too much.
    """
    columns = np.asarray(columns, dtype=float)
    if model.corner == 0.0 or columns.shape[-1] < 2:
        return columns / model.std
    sections = _sections(model.corner / model.rate, columns.shape[-1])
    return np.asarray(signal.sosfilt(sections, columns / model.std, axis=-1))


@lru_cache(maxsize=256)
def _sections(corner: float, n: int) -> Floats:
    """Second-order sections that whiten 1 + corner / f, with f and corner in cycles per sample.

    With v = 1 - cos(2 pi f), the spectrum is approximated by 1 + sum of b / (v + a) over poles a spaced in log
    frequency, b >= 0. Its zeros are minus the eigenvalues of diag(a) + sqrt(b) sqrt(b)'.
    """
    poles = np.exp(-2.0 * np.pi * np.geomspace(0.5 / n, 0.25, SECTIONS))
    f = np.geomspace(1.0 / n, 0.5, 400)
    v, a = 2.0 * np.sin(np.pi * f) ** 2, (1.0 - poles) ** 2 / (2.0 * poles)
    wanted = 1.0 + corner / f
    columns = 1.0 / (v[:, None] + a) / wanted[:, None]
    b, _ = optimize.nnls(columns, corner / f / wanted, maxiter=MOST_STEPS)
    poles, a, b = poles[b > 0.0], a[b > 0.0], b[b > 0.0]
    roots = np.linalg.eigvalsh(np.diag(a) + np.sqrt(np.outer(b, b)))
    zeros = 1.0 + roots - np.sqrt(roots**2 + 2.0 * roots)
    return signal.zpk2sos(poles, zeros, math.sqrt(np.prod(zeros / poles)))


def line_columns(lines: Sequence[float], rate: float, n: int) -> Floats:
    """(2 * lines, n) sines and cosines of lines in Hz, to be fitted as nuisance columns."""
    phase = 2.0 * np.pi * np.outer(lines, np.arange(n)) / rate
    return np.concatenate([np.sin(phase), np.cos(phase)]).reshape(-1, n)


def nuisance(model: NoiseModel, n: int) -> tuple[Floats, Floats]:
    """Shapes (m, n) beside the noise that is whitened, in units of ``std``, and the (m,) precisions of their sizes.

    Lines, of which nothing is known; and where there is 1/f noise a constant, which is that noise below 1 / T.
    """
    rows = line_columns(model.lines, model.rate, n)
    precision = np.zeros(len(rows))
    if model.corner > 0.0:
        rows = np.vstack([rows, np.ones(n)])
        precision = np.append(precision, model.rate / (2.0 * model.corner * SLOWER))
    return rows, precision


def fitted_lines(samples: Floats, lines: Sequence[float], rate: float) -> Floats:
    """(n,) lines in Hz with the amplitudes that samples have them in."""
    columns = line_columns(lines, rate, samples.size).T
    return columns @ np.linalg.lstsq(columns, samples)[0]


def find_lines(residual: ArrayLike, rate: float, fundamental: float, model: NoiseModel) -> tuple[float, ...]:
    """Frequencies (Hz, rising) of at most 8 sinusoidal lines in a residual (n,), beyond the model's spectrum.

    They are the largest peaks of the whitened periodogram, each removed before the next, with a family-wise
    probability of false alarm of 1e-3. Within 1.5 / T of a harmonic of half the fundamental a line cannot be told
    from periodic misfit and none is looked for; nor near those of a 3rd or 4th of it where three lines are found.
    """
    white = whiten(model, np.asarray(residual, dtype=float))
    tone, orders = fundamental / rate, (1, 2)
    lines = _peaks(white, rate, tone, orders)
    for order in (3, 4):
        nearest, _ = distances(np.array(lines) * white.size / rate, white.size, tone, (order,))
        if np.count_nonzero(nearest < 0.5) >= 3:
            orders = (*orders, order)
            lines = _peaks(white, rate, tone, orders)
    return lines


def _peaks(white: Floats, rate: float, tone: float, orders: Orders) -> tuple[float, ...]:
    """Frequencies of the lines in white noise of variance 1, away from the harmonics."""
    n = white.size
    rest = without_harmonics(white, tone, orders)
    bins = np.arange(6, n) / 2.0  # half a bin apart, so that a line between two bins is not missed
    allowed = distances(bins, n, tone, orders)[0] > 1.5
    lines: list[float] = []
    noise = rest
    while len(lines) < MOST_LINES and allowed.any():
        power = np.where(allowed, np.abs(np.fft.rfft(noise, 2 * n)[6:n]) ** 2 / n, 0.0)
        best = int(np.argmax(power))
        if power[best] < math.log(np.count_nonzero(allowed) / FALSE_ALARM):
            break
        lines.append(_refined(noise, bins[best] / n) * rate)
        allowed &= np.abs(bins - bins[best]) > 1.5
        noise = rest - fitted_lines(rest, lines, rate)
    for at in range(len(lines) if len(lines) > 1 else 0):
        others = lines[:at] + lines[at + 1 :]
        lines[at] = _refined(rest - fitted_lines(rest, others, rate), lines[at] / rate) * rate
    return tuple(sorted(lines))


def _refined(samples: Floats, frequency: float) -> float:
    """The frequency of the largest power within half a bin, in cycles per sample."""
    t = np.arange(samples.size)
    starts = np.arange(0, samples.size, max(samples.size // 256, 1))  # slow once turned back by the frequency: add up
    slow = np.add.reduceat(samples * np.exp(-2j * np.pi * frequency * t), starts)
    width = 0.5 / samples.size
    found: Any = optimize.minimize_scalar(
        lambda shift: -abs(slow @ np.exp(-2j * np.pi * shift * starts)), bounds=(-width, width), method="bounded"
    )
    return frequency + float(found.x)


def peak_offset(before: float, peak: float, after: float) -> float:
    """Where a parabola through three values at -1, 0 and 1 is largest; 0 where the middle one is not the largest."""
    bend = before - 2.0 * peak + after
    return 0.5 * (before - after) / bend if peak >= max(before, after) and bend < 0.0 else 0.0


def converter_lsb(samples: ArrayLike) -> float:
    """The converter's step: the spacing of which all differences of values are multiples; 0 where there is none."""
    known = np.unique(np.asarray(samples, dtype=float))
    known = known[np.isfinite(known)]
    gaps = np.diff(known)
    gaps = np.sort(gaps[gaps > 1e-9 * np.abs(known).max(initial=0.0)])  # below lie errors of rounding
    if gaps.size == 0:
        return 0.0
    for parts in (1, 2, 3):  # the smallest gap may be a few steps
        step = gaps[0] / parts
        for reach in (16, 256, 4096, 65536):  # the step, known better from wider gaps
            near = gaps[gaps < (reach + 0.5) * step]
            step = near.sum() / np.rint(near / step).sum()
        if np.all(np.abs(near / step - np.rint(near / step)) < 0.05):
            return float(step)
    return 0.0


def dead_band(samples: ArrayLike) -> float:
    """Below what size a channel reads 0; 0 where there is no such band.

    There is one where values from it up to twice it are many, and none but 0 lie below.
    """
    sizes = np.sort(np.abs(np.asarray(samples, dtype=float)))
    sizes = sizes[np.isfinite(sizes)]
    others = sizes[sizes > 0.0]
    if others.size == 0 or sizes.size - others.size < BAND_LEAST:
        return 0.0
    width = float(others[0])
    return width if np.count_nonzero(others < 2.0 * width) >= BAND_LEAST else 0.0


def lone_lines(residual: ArrayLike, rate: float, fundamental: float, model: NoiseModel) -> tuple[float, ...]:
    """Frequencies (Hz) of lines that lie on harmonics, beyond the lines of the model.

    What a model of the motion misses shows at many harmonics, which rise and fall slowly; a line stands alone. One
    counts whose power is several times that of all within some harmonics of it.
    """
    white = whiten(model, np.asarray(residual, dtype=float))
    known = list(model.lines)
    found: list[float] = []
    n = white.size
    reach = int(LONE_REACH * fundamental / rate * 2 * n)
    while len(found) < MOST_LINES:
        lines = known + found
        rest = white - fitted_lines(white, lines, rate) if lines else white
        power = np.abs(np.fft.rfft(rest, 2 * n)) ** 2 / n
        power[:12] = 0.0
        best = int(np.argmax(power))
        around = power[max(best - reach, 0) : best + reach + 1].copy()
        middle = min(best, reach)
        around[max(middle - 8, 0) : middle + 9] = 0.0
        if power[best] < LONE_LEAST or power[best] < LONE * around.max(initial=0.0):
            break
        found.append(_refined(rest, best / (2 * n)) * rate)
    return tuple(found)
