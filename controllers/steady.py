"""What a rock gives at each setting once the motion has settled, and an oracle that acts on it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from drillenv.dynamics.survey import survey
from drillenv.env.reward import Reward
from drillenv.env.task import RANGES, action_for
from drillenv.rig import Rig
from drillenv.rocks import Rock

RATIOS = np.arange(0.9, 6.01, 0.06)
"""Pressure over amplitude in bar/V. With the linear rock law forces and lengths grow with the drive, so that at a
frequency only this ratio decides on the motion."""
FREQUENCIES = (110.0, 115.0, 120.0)
"""Hz. Below these the same force makes less progress, on every rock of Table 2.2."""
AMPLITUDES: np.ndarray = np.linspace(RANGES[1, 0], RANGES[1, 1], 61)
PRESSURES: np.ndarray = np.linspace(RANGES[2, 0], RANGES[2, 1], 61)
MARGIN = 1
"""Steps of RATIOS to stay away from the next other motion: the face of a layer is not quite its stable rock."""


class Response(NamedTuple):
    """The steady state of one rock at one frequency, by RATIOS, for a drive of 1 V."""

    rate: np.ndarray
    """mm/s."""
    force: np.ndarray
    """Peak force in N."""
    single: np.ndarray
    """Whether the motion is the P-1-I-1 that reaches up from low pressure."""


@lru_cache(maxsize=8192)
def response(loading: float, unloading: float, frequency: float) -> Response:
    """The response of a rock with these stiffnesses in N/m at a frequency in Hz, on the rig of Table 2.1."""
    unit = 0.5
    settings = np.column_stack([np.full(RATIOS.size, frequency), np.full(RATIOS.size, unit), RATIOS * unit])
    settings[:, 2] = np.clip(settings[:, 2], 0.2, 5.0)
    motions = survey(settings, Rock(loading, unloading), Rig(), patience=400, threads=1)
    single = (motions["period"] == 1) & (np.round(motions["impacts"]) == 1)
    ends = np.flatnonzero(~single)
    single[max(0, (ends[0] if ends.size else single.size) - MARGIN) :] = False
    return Response(1e3 * motions["penetration_rate"] / unit, motions["peak_force"] / unit, single)


def worth(loading: float, unloading: float, frequency: float, amplitude, pressure, reward: Reward) -> np.ndarray:
    """The steady reward in mm/s at amplitudes in V and pressures in bar of any common shape."""
    known = response(loading, unloading, frequency)
    ratio = np.asarray(pressure) / np.asarray(amplitude)
    rate = amplitude * np.interp(ratio, RATIOS, known.rate)
    force = amplitude * np.interp(ratio, RATIOS, known.force)
    alone = np.interp(ratio, RATIOS, known.single.astype(float)) > 0.99
    strong = np.where(alone, np.minimum(1.0, force / reward.rating), 0.0)
    share = reward.other_motions + (1.0 - reward.other_motions) * strong
    return reward.penetration * rate * share - reward.force * 1e-3 * np.maximum(0.0, force - reward.rating)


@lru_cache(maxsize=8192)
def best_setting(loading: float, unloading: float, reward: Reward) -> tuple[float, float, float]:
    """Frequency in Hz, amplitude in V and pressure in bar with the highest reward in the steady state."""
    amplitude, pressure = np.meshgrid(AMPLITUDES, PRESSURES, indexing="ij")
    best, most = (120.0, 0.45, 0.7), -np.inf
    for frequency in FREQUENCIES:
        earned = worth(loading, unloading, frequency, amplitude, pressure, reward)
        i = np.unravel_index(np.argmax(earned), earned.shape)
        if earned[i] > most:
            best, most = (frequency, float(amplitude[i]), float(pressure[i])), float(earned[i])
    return best


class SteadyOracle:
    """Knows the rock under the indenter and sets what earns most there.

    The valve goes to the best pressure at once; while the cylinder fills or empties, the amplitude is the best one for
    the pressure of the moment.

    Args:
        reward: Weights to earn by.
        follow: Whether to look at the pressure of the moment; else the amplitude is that of the steady state at once.
    """

    sees_truth = True

    def __init__(self, reward: Reward | None = None, follow: bool = True):
        self._reward = reward or Reward()
        self._follow = follow

    def reset(self, seed: int | None = None) -> None:
        """Nothing to do."""

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The best setting for the rock and the pressure in ``info``."""
        rock = info["loading_stiffness"], info["unloading_stiffness"]
        frequency, amplitude, pressure = best_setting(*rock, self._reward)
        if self._follow and abs(info["pressure"] - pressure) > 0.02:
            # the pressure in the middle of the coming interval, for a lag between the shortest and the longest
            ahead = pressure + (info["pressure"] - pressure) * 0.82
            amplitude = float(AMPLITUDES[np.argmax(worth(*rock, frequency, AMPLITUDES, ahead, self._reward))])
        return action_for(frequency, amplitude, pressure)
