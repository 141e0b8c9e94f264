"""What the rig's sensors tell of a control interval: the table, the noise, and how it is read from the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import KERNEL
from drillenv.env.truth import (
    T_AMPLITUDE,
    T_FREQUENCY,
    T_HALF,
    T_IMPACTS,
    T_LARGEST,
    T_MEAN,
    T_PRESSURE,
    T_RATE,
    T_SHARE,
    T_SPREAD,
    T_TWO,
    T_VALVE,
    TRUTH,
)


class Reading(NamedTuple):
    """One entry of the observation."""

    name: str
    unit: str
    low: float
    high: float
    noise: float
    """Standard deviation of the noise on it, in its unit."""
    meaning: str
    truth: int
    """The column of a row of truth it is read from."""
    scale: float
    """Its unit in the unit of that column."""


READINGS = (
    Reading("mean_peak_force", "kN", 0, 5, 0.01, "mean peak of the impacts above 50 N", T_MEAN, 1e3),
    Reading("largest_peak_force", "kN", 0, 5, 0.02, "largest peak", T_LARGEST, 1e3),
    Reading("peak_force_spread", "kN", 0, 2.5, 0.01, "standard deviation of the peaks", T_SPREAD, 1e3),
    Reading("impacts_per_cycle", "1", 0, 10, 0.01, "impacts above 50 N a period of the excitation", T_IMPACTS, 1),
    Reading(
        "period_two", "1", 0, 2, 0.005, "change of the strongest peak from period to period, a share of it", T_TWO, 1
    ),
    Reading("contact_share", "1", 0, 1, 0.005, "share of the time in contact", T_SHARE, 1),
    Reading("half_harmonic", "g", 0, 50, 0.1, "acceleration of the indenter at half the frequency", T_HALF, 9.80665),
    Reading("first_harmonic", "g", 0, 50, 0.1, "at the frequency", T_HALF + 1, 9.80665),
    Reading("second_harmonic", "g", 0, 50, 0.1, "at twice the frequency", T_HALF + 2, 9.80665),
    Reading("third_harmonic", "g", 0, 50, 0.1, "at three times the frequency", T_HALF + 3, 9.80665),
    Reading("penetration_rate", "mm/s", -1, 9, 0.05, "penetration made over the interval's length", T_RATE, 1),
    Reading("frequency", "Hz", 50, 120, 0, "present frequency", T_FREQUENCY, 1),
    Reading("amplitude", "V", 0.3, 0.6, 0, "present amplitude", T_AMPLITUDE, 1),
    Reading("valve_pressure", "bar", 0.6, 1.8, 0, "pressure asked for", T_VALVE, 1),
    Reading("pressure", "bar", 0.5, 1.9, 0.005, "pressure in the cylinder by the gauge", T_PRESSURE, 1),
)
"""The observation, in order."""
SIZE = len(READINGS)
LOW = np.array([reading.low for reading in READINGS], dtype=np.float32)
HIGH = np.array([reading.high for reading in READINGS], dtype=np.float32)
_COLUMNS = np.array([reading.truth for reading in READINGS])
_FACTORS = np.array([1.0 / reading.scale for reading in READINGS])
_NOISE = np.array([reading.noise for reading in READINGS])

CHANNELS = ("excitation", "force", "acceleration", "pressure")
CHANNEL_UNITS = ("V", "kN", "g", "bar")
CHANNEL_HIGH = np.array([0.65, 6.0, 250.0, 1.9], dtype=np.float32)
CHANNEL_LOW = np.array([-0.65, -0.5, -250.0, 0.5], dtype=np.float32)
"""The window mode: what is sampled, in which unit, and the range of the recorder, at which it clips."""
CHANNEL_SCALES = np.array([1.0, 1e-3, 1 / 9.80665, 1.0])
CHANNEL_NOISE = np.array([0.001, 0.01, 0.2, 0.005])
"""Standard deviation of a sample's noise, in the channels' units."""
WINDOW_SAMPLES = 1000
"""Samples of a channel in an interval: 4 kHz."""

assert len(TRUTH) > _COLUMNS.max()


@njit(**KERNEL)
def observe(truth: np.ndarray, noise: np.ndarray, strength: float, observation: np.ndarray) -> None:
    """Fill an ``observation`` (SIZE,) float32 from a row of truth.

    ``noise`` (SIZE,) are standard normal numbers and ``strength`` scales the table's standard deviations.
    """
    truth, noise, observation = borrowed(truth), borrowed(noise), borrowed(observation)
    for j in range(SIZE):
        value = truth[_COLUMNS[j]] * _FACTORS[j] + strength * _NOISE[j] * noise[j]
        observation[j] = min(max(np.float32(value), LOW[j]), HIGH[j])
