"""A sharp resonance of a channel, where the response that a fit's residuals show has a pole.

Free responses are sums of broad parts, whose sizes are linear. A pole with little damping is drawn by none of them: it
has to be where it is. From the spectra of the predicted reading and of its residual follows the response of the
one to the other (J. S. Bendat and A. G. Piersol, Random Data, 4th ed., Wiley, 2010, Section 6.1), and
the pole is where with its two parts least of that is left (variable projection: G. Golub and V. Pereyra, Inverse
Problems 19 (2003) R1-R26).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import csd, welch

from drillenv.diagnosis.solver import Floats

SEGMENT = 0.08
"""s of the spectra's segments: they resolve poles of a hundredth of damping from 1 kHz on."""
LOWEST, HIGHEST = 300.0, 0.42
"""Hz, and share of the slowest sample rate, between which responses are taken."""
RATIOS = (0.01, 0.02, 0.04)
"""Damping ratios from which one is looked for."""
NARROWEST = 0.005
"""What is damped less is no channel's response, but a line."""
BROAD = 0.06
"""That of the broad resonators of a free response, which draw what is damped as much."""


class Resonator(NamedTuple):
    """A mode of the second order."""

    frequency: float
    """Hz."""
    ratio: float
    """Of damping."""


class Spectra(NamedTuple):
    """Of all recordings together."""

    frequency: Floats
    """(n,) Hz."""
    power: Floats
    """(n,) of the predicted readings."""
    cross: NDArray[np.complex128]
    """(n,) complex: of those with their residuals."""


def spectra(predicted: list[Floats], residuals: list[Floats], rates: list[float]) -> Spectra:
    """Of the predicted reading (n,) of a channel and its residual (n,), of each recording, by its sample rate."""
    frequency = np.arange(LOWEST, HIGHEST * min(rates), 1.0 / SEGMENT)
    power, cross = np.zeros(frequency.size), np.zeros(frequency.size, dtype=complex)
    for x, y, rate in zip(predicted, residuals, rates, strict=True):
        given = {"fs": rate, "nperseg": min(round(SEGMENT * rate), x.size)}
        at, own = welch(x, **given)
        power += np.interp(frequency, at, own)
        cross += np.interp(frequency, at, csd(x, y, **given)[1])
    return Spectra(frequency, power, cross)


def parts_of(resonator: Resonator, frequency: Floats) -> NDArray[np.complex128]:
    """(2, n) complex: what it lets pass below its frequency less what comes in, and its band, at frequencies in Hz."""
    s = 1j * frequency / resonator.frequency
    under = s**2 + 2.0 * resonator.ratio * s + 1.0
    return np.array([1.0 / under - 1.0, s / under])


def sharp_resonance(seen: Spectra, broad: Callable[[Floats], NDArray[np.complex128]]) -> Resonator | None:
    """The mode that draws most of a response; None where the broad parts of one do as well.

    Args:
        seen: The spectra of a channel.
        broad: Of frequencies (n,) in Hz the responses (m, n) of parts that are there anyway.
    """
    root = np.sqrt(seen.power)
    goal = _stacked(seen.cross / np.maximum(root, 1e-300))
    basis, _ = np.linalg.qr(_stacked(broad(seen.frequency) * root).T)
    goal = goal - basis @ (basis.T @ goal)
    without = float(goal @ goal)
    if not without > 0.0:
        return None

    def left(frequency: float, ratio: float) -> float:
        own = _stacked(parts_of(Resonator(frequency, ratio), seen.frequency) * root).T
        own, _ = np.linalg.qr(own - basis @ (basis.T @ own))
        return without - float(np.sum((own.T @ goal) ** 2))

    step = 1.0 + 2.0 * RATIOS[1]
    count = max(1, round(math.log(seen.frequency[-1] / 1e3) / math.log(step)))
    tried = [(each, ratio) for each in np.geomspace(1e3, seen.frequency[-1], count) for ratio in RATIOS]
    first = min(tried, key=lambda each: left(*each))
    best = minimize(lambda x: left(math.exp(x[0]), math.exp(x[1])), np.log(first), method="Nelder-Mead",
                    options={"xatol": 1e-4, "fatol": 1e-6 * without, "initial_simplex": _around(first)})  # fmt: skip
    found = Resonator(*(float(each) for each in np.exp(best.x)))
    # by Schwarz's criterion, with two parts, a frequency and a ratio; of a periodic motion harmonics alone say much
    points = 2.0 * float(seen.power.sum()) ** 2 / float(np.sum(seen.power**2))
    gain = points * math.log(without / max(float(best.fun), 1e-300 * without))
    return found if NARROWEST < found.ratio < BROAD and gain > 4.0 * math.log(points) else None


def _around(pole: tuple[float, float]) -> Floats:
    """(3, 2) logarithms about a frequency and a ratio."""
    start = np.log(pole)
    return start + np.array([[0.0, 0.0], [0.5 * RATIOS[1], 0.0], [0.0, 0.5]])


def _stacked(values: NDArray[np.complex128]) -> Floats:
    """(..., 2 n) real and imaginary parts."""
    return np.concatenate([values.real, values.imag], axis=-1)
