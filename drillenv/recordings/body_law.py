"""One body: how its channels hang together, by integration and by its force balance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOVING = ("position", "velocity", "acceleration")
MOST_FITTED = 5000
"""Samples enter a fit, evenly spread: what it is to tell apart differs by factors."""
SMOOTHINGS = (5, 11, 21, 41, 81)
"""Samples over which a channel is smoothed to be differentiated; the one that explains the force best is taken."""


class Fit(NamedTuple):
    """One channel explained by others, by least squares."""

    first: float
    """The coefficient of the first column."""
    counts: float
    """The partial correlation of the first column."""
    explained: float
    """The share of the variance explained."""
    left: Floats
    """(samples,) what is not explained."""


def compared(series: Mapping[str, Floats], rate: float) -> list[tuple[str, str, float, float]]:
    """(channel, the one that it should be an integral of, ratio, correlation), for each such pair of channels."""
    found = []
    for above, below in itertools.pairwise(MOVING):
        if above in series and below in series:
            found.append((above, below, *_against_integral(series[above], series[below], rate)))
    if "velocity" not in series and {"position", "acceleration"} <= series.keys():
        found.append(("position", "acceleration", *_against_second(series["position"], series["acceleration"], rate)))
    return found


def _against_integral(above: Floats, below: Floats, rate: float) -> tuple[float, float]:
    """(ratio, correlation) of a channel to the integral of another, less trends, which an offset would make."""
    from scipy.signal import detrend

    integral = np.concatenate(([0.0], np.cumsum(0.5 * (below[1:] + below[:-1])))) / rate
    left, right = np.asarray(detrend(above)), np.asarray(detrend(integral))
    scale = math.sqrt(float(left @ left) * float(right @ right))
    if scale == 0.0:
        return math.nan, 0.0
    # the slope between noisy series that belong together: neither regression, but the ratio of their sizes
    product = float(left @ right)
    return math.copysign(math.sqrt(float(left @ left) / float(right @ right)), product), abs(product) / scale


def _against_second(position: Floats, acceleration: Floats, rate: float) -> tuple[float, float]:
    """(ratio, correlation) of a position to twice the integral of an acceleration, told from its second derivative."""
    from scipy.signal import savgol_filter

    best = (math.nan, 0.0)
    for window in SMOOTHINGS:
        if window >= position.size:
            break
        second = np.asarray(savgol_filter(position, window, 3, deriv=2, delta=1.0 / rate))
        smooth = np.asarray(savgol_filter(acceleration, window, 3))
        second, smooth = second - second.mean(), smooth - smooth.mean()
        scale = math.sqrt(float(second @ second) * float(smooth @ smooth))
        product = float(second @ smooth)
        if scale > 0.0 and abs(product) / scale > best[1]:
            size = math.sqrt(float(second @ second) / float(smooth @ smooth))
            best = (math.copysign(size, product), abs(product) / scale)
    return best


def source_of(series: Mapping[str, Floats]) -> str:
    """The channel from which the acceleration is had: itself, or what needs least differentiating."""
    return next(name for name in reversed(MOVING) if name in series)


def law(series: Mapping[str, Floats], rate: float, use: Mask | None = None) -> Fit | None:
    """The force explained by acceleration first and the law; without a force, the acceleration by position first.

    The fit is made to the samples to ``use``.
    """
    if "force" in series and any(name in series for name in MOVING):
        return mass(series, source_of(series), rate, use)
    if {"position", "acceleration"} <= series.keys():
        columns = [series[name] for name in ("position", "velocity") if name in series]
        return fitted(series["acceleration"], [*columns, np.ones(columns[0].size)], use)
    return None


def mass(series: Mapping[str, Floats], source: str, rate: float, use: Mask | None = None) -> Fit:
    """The force explained by mass * acceleration, speed, its sign, position and an offset.

    All of these whatever the nominal law has: what it leaves out must not turn up as mass.
    """
    from scipy.signal import savgol_filter

    order = len(MOVING) - 1 - MOVING.index(source)
    best = Fit(math.nan, 0.0, 0.0, np.zeros(series[source].size))
    for window in SMOOTHINGS if order else SMOOTHINGS[:1]:
        if window >= series[source].size:
            break

        def smooth(values: Floats, derivative: int, window: int = window) -> Floats:
            return np.asarray(savgol_filter(values, window, 3, deriv=derivative, delta=1.0 / rate))

        columns = [smooth(series[source], order)]
        speed = _speed(series, smooth)
        if speed is not None:
            columns += [speed, np.sign(speed)]
        if "position" in series:
            columns.append(smooth(series["position"], 0))
        columns.append(np.ones(columns[0].size))
        best = max(best, fitted(smooth(series["force"], 0), columns, use), key=lambda fit: fit.explained)
    return best


def _speed(series: Mapping[str, Floats], smooth) -> Floats | None:
    """The velocity measured, or else that of the position."""
    if "velocity" in series:
        return smooth(series["velocity"], 0)
    return smooth(series["position"], 1) if "position" in series else None


def fitted(target: Floats, columns: Sequence[Floats], use: Mask | None = None) -> Fit:
    """``target`` explained by the columns, fitted to the samples to ``use``."""
    table = np.column_stack(columns)
    rows = np.arange(target.size) if use is None else np.flatnonzero(use)
    rows = rows[:: max(1, rows.size // MOST_FITTED)]
    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    some, aim = table[rows] / scale, target[rows]
    own = some[:, 0] - some[:, 1:] @ np.linalg.lstsq(some[:, 1:], some[:, 0], rcond=None)[0]
    rest = aim - some[:, 1:] @ np.linalg.lstsq(some[:, 1:], aim, rcond=None)[0]
    spread = math.sqrt(float(own @ own) * float(rest @ rest))
    if spread == 0.0:
        return Fit(math.nan, 0.0, 0.0, np.zeros(target.size))
    fit = np.linalg.lstsq(some, aim, rcond=None)[0] / scale
    left = target - table @ fit
    explained = 1.0 - float(np.var(left[rows])) / float(np.var(aim))
    return Fit(float(fit[0]), abs(float(own @ rest)) / spread, explained, left)
