"""Whether whitened residuals are noise alone, or hold periodic misfit of the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from drillenv.diagnosis.comb import Orders, off_comb

Floats = NDArray[np.float64]

BANDS = (0.0, 4.25, 16.25, math.inf)
"""Edges, in multiples of the fundamental, of the bands in which harmonics are held against the other bins."""


class Goodness(NamedTuple):
    """How well whitened residuals agree with white noise of variance 1."""

    chi_square: float
    """Sum of squares by degrees of freedom."""
    freedom: int
    p_value: float
    """Of the chi-square, upper tail. Where the level was estimated from the same residuals it says little."""
    harmonic_p_value: float
    """Of F tests of the power at harmonics against the other bins, which needs no level."""
    excess: float
    """Power at the harmonics beyond the noise there, by the power of the noise at all frequencies."""
    excess_error: float
    """Standard error of ``excess``."""


def goodness(
    whitened: Sequence[ArrayLike],
    fitted_parameters: int,
    rates: ArrayLike,
    fundamentals: ArrayLike,
    orders: Orders = (1, 2),
) -> Goodness:
    """Compare whitened residuals, each (n,), with white noise, above all at the harmonics where periodic misfit lies.

    In each of three bands the power at the harmonics of fundamental / order is held against that of the other bins by
    an F test; Fisher's method joins the bands. The fitted parameters are taken off the degrees of freedom of the
    harmonics in proportion, as if the model acted at harmonics only.

    Args:
        whitened: Residuals of every recording and channel.
        fitted_parameters: Their number, of the model and its nuisance columns, in all residuals together.
        rates: Samples per second, one for all or one for each residual.
        fundamentals: Excitation frequencies in Hz, one for all or one for each residual.
        orders: 2 adds the subharmonics of a half, and so on.
    """
    series = [np.asarray(each, dtype=float) for each in whitened]
    tones = np.broadcast_to(np.asarray(fundamentals, dtype=float) / np.asarray(rates, dtype=float), len(series))
    total = float(sum(each @ each for each in series))
    freedom = sum(each.size for each in series) - fitted_parameters
    bands = [_by_band(each, tone, orders) for each, tone in zip(series, tones, strict=True)]
    at, d_at, off, d_off = np.sum(bands, axis=0)
    used = (d_at > 0.0) & (d_off > 0.0)
    at, d_at, off, d_off = at[used], d_at[used], off[used], d_off[used]
    noise = off / d_off
    whole = float(noise @ (d_at + d_off))
    d_at = d_at * max(1.0 - fitted_parameters / d_at.sum(), 0.0)
    log_p = stats.f.logsf(at / np.maximum(d_at, 1e-9) / noise, d_at, d_off)
    beyond = at - d_at * noise
    spread = noise**2 * (2.0 * d_at + 2.0 * d_at**2 / d_off) + 4.0 * noise * np.maximum(beyond, 0.0)
    return Goodness(
        total / freedom,
        freedom,
        float(stats.chi2.sf(total, freedom)),
        float(stats.chi2.sf(-2.0 * log_p.sum(), 2 * log_p.size)),
        float(beyond.sum()) / whole,
        math.sqrt(float(spread.sum())) / whole,
    )


def _by_band(white: Floats, tone: float, orders: Orders) -> Floats:
    """By band (columns): power at the harmonics, its degrees of freedom, power elsewhere, its degrees of freedom."""
    n = white.size
    comb = off_comb(white, tone, orders)
    bins = np.arange(1, (n - 1) // 2 + 1)
    power = 2.0 * np.abs(np.fft.rfft(comb.rest)[bins]) ** 2 / n
    edges = np.array(BANDS) * tone
    at, lines = (np.histogram(comb.tones, edges, weights=w)[0] for w in (comb.power, None))
    off, count = (np.histogram(bins / n, edges, weights=w)[0] for w in (power, None))
    return np.array([at, 2.0 * lines, off, 2.0 * (count - lines)])
