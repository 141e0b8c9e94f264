"""What to record next, where two mechanisms explain the same recordings."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from drillenv.checks import InputError
from drillenv.diagnosis.shooting import Physics
from drillenv.dynamics.sensors import PerChannel, record
from drillenv.rig import AMPLITUDE_RANGE, FREQUENCY_RANGE, PRESSURE_RANGE, Setting

POINTS = 4, 3, 3
"""Frequencies, amplitudes and pressures that are tried, over the ranges of Table 2.1."""
SECONDS = 0.1
"""From rest: some ten blows, before a motion that may be chaotic has lost its start."""
RATE = 6400.0


class Separation(NamedTuple):
    """Where two models part most."""

    setting: Setting
    apart: float
    """Root mean square of the difference over the noise, in the channel that shows it best."""
    channel: str


def separation(one: Physics, other: Physics, noise: PerChannel) -> Separation | None:
    """The setting at which a rig started on fresh rock tells two models apart best, or None if none could be run.

    Args:
        one, other: Two models that were fitted to the same recordings.
        noise: Standard deviations of the channels' noise.
    """
    axes = [
        np.linspace(*ends, points)
        for ends, points in zip((FREQUENCY_RANGE, AMPLITUDE_RANGE, PRESSURE_RANGE), POINTS, strict=True)
    ]
    best: Separation | None = None
    for frequency, amplitude, pressure in product(*(axis.tolist() for axis in axes)):
        setting = Setting(frequency, amplitude, pressure)
        try:
            first, second = (_fresh(each, setting) for each in (one, other))
        except InputError:
            continue
        for channel in ("force", "acceleration"):
            change = getattr(first, channel) - getattr(second, channel)
            apart = float(np.sqrt(np.mean(change**2))) / getattr(noise, channel)
            if best is None or apart > best.apart:
                best = Separation(setting, apart, channel)
    return best


def _fresh(physics: Physics, setting: Setting):
    return record(
        physics.rig, setting, physics.rock, SECONDS, RATE, effects=physics.motion, sensors=physics.sensors
    ).channels
