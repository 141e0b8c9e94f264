"""Classical control: a linear-quadratic regulator with integral action, its gains scheduled on the rock's stiffness.

What it does in each interval:

1. ESTIMATE the pressure, the lag of the cylinder and the rock's stiffness from the readings
   (:mod:`drillenv.controllers.estimate`).
2. TRIM: for the estimated rock, the amplitude and the pressure at which the blows have their target and pressure over
   amplitude stays at SHARE of where P-1-I-1 ends.
3. GO THERE when the rock is new: the valve is set so that the pressure arrives as soon as the cylinder lets it, and the
   amplitude gives the blows their target at the pressure of the moment.
4. REGULATE once there: increments of valve and amplitude, linear in the deviations of force and of pressure over
   amplitude from their targets. The gains come from identified models (:mod:`drillenv.controllers.identify`) by a
   discrete Riccati equation (:mod:`drillenv.controllers.design`), for eight stiffnesses and five lags, and are
   interpolated. As the increments are added to what was really set, nothing winds up at the ends of the ranges.
5. BACK OFF when blows are not single though the rock is known: a lower SHARE, which recovers slowly.

At run time it needs numbers only: ``controllers/plant_models/scheduled.json``.
"""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import InputError
from drillenv.controllers.chart import FREQUENCY
from drillenv.controllers.estimate import (
    AMPLITUDE,
    GAUGE,
    MEAN_PEAK,
    VALVE,
    Cylinder,
    RockEstimate,
    inside,
    is_single,
)
from drillenv.env.task import RANGES, action_for

FILE = Path(__file__).parent / "plant_models" / "scheduled.json"
SHARE = 0.88
"""Pressure over amplitude to hold, as a share of where P-1-I-1 ends: near the end the drive takes least power."""
TARGET = 0.993
"""Share of the rating to hold the blows at: above it a newton costs more than it earns below."""
NEW_ROCK = 0.08
"""Relative change of the estimated stiffness that means another rock."""
NEAR = 0.03
"""Relative distance from the trim pressure within which the regulator takes over."""
LESS, LEAST, BACK = 0.96, 0.75, 0.002
"""What is left of SHARE after an interval without single blows, at the least, and what comes back of it in one with."""
LOW, HIGH = RANGES[:, 0], RANGES[:, 1]


class Gains(NamedTuple):
    """The designed gains."""

    loading: np.ndarray
    """(m,) loading stiffnesses in N/m."""
    lag: np.ndarray
    """(n,) s."""
    gain: np.ndarray
    """(n, m, 2, 3): from change of pressure in bar, error of force in kN and of pressure in bar, to bar and V."""

    def at(self, loading: float, lag: float) -> np.ndarray:
        """(2, 3) interpolated; beyond the table, those at its edge."""
        x = np.interp(math.log(loading), np.log(self.loading), np.arange(self.loading.size))
        y = np.interp(lag, self.lag, np.arange(self.lag.size))
        i, j = min(int(x), self.loading.size - 2), min(int(y), self.lag.size - 2)
        u, v = x - i, y - j
        corners = self.gain[j : j + 2, i : i + 2]
        return (1 - v) * ((1 - u) * corners[0, 0] + u * corners[0, 1]) + v * (
            (1 - u) * corners[1, 0] + u * corners[1, 1]
        )


@cache
def read_gains() -> Gains:
    """The gains as they were designed.

    Raises:
        InputError: the file is missing or not what the design writes.
    """
    try:
        record = json.loads(FILE.read_text(encoding="utf-8"))
        gains = Gains(*(np.array(record[key], dtype=float) for key in Gains._fields))
        if gains.gain.shape != (gains.lag.size, gains.loading.size, 2, 3) or not np.isfinite(gains.gain).all():
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"gains {FILE} cannot be read: make them with python -m drillenv.controllers.design") from None
    return gains


class Scheduled:
    """The controller above.

    Args:
        rating: Contact force in N to stay below.
    """

    sees_truth = False

    def __init__(self, rating: float = 2000.0):
        self._target = 1e-3 * TARGET * rating
        self._gains = read_gains()
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the rock and the cylinder."""
        self._cylinder, self._rock = Cylinder(), RockEstimate()
        self._share = SHARE
        self._known: float | None = None
        self._regulating = False

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting."""
        observation = inside(observation)
        cylinder, rock = self._cylinder, self._rock
        before = cylinder.pressure
        cylinder.update(float(observation[VALVE]), float(observation[GAUGE]))
        rock.update(observation, cylinder.mean, cylinder.pressure - before)
        single = is_single(observation)
        if self._known is None or abs(math.log(rock.loading / self._known)) > NEW_ROCK:
            self._known, self._share, self._regulating = rock.loading, SHARE, False
        elif not single:
            self._share, self._regulating = max(LEAST, LESS * self._share), False
        else:
            self._share = min(SHARE, self._share + BACK)
        ratio = self._share * rock.boundary()
        amplitude = float(np.clip(self._target / rock.peak_at(ratio), LOW[1], HIGH[1]))
        goal = float(np.clip(ratio * amplitude, LOW[2], HIGH[2]))
        if single and abs(cylinder.pressure - goal) < NEAR * goal:
            self._regulating = True
        if self._regulating:
            return self._regulate(observation, ratio, cylinder.pressure - before)
        return self._go(amplitude, goal)

    @property
    def stiffness(self) -> float:
        """The estimated loading stiffness in N/m."""
        return self._rock.loading

    def _go(self, amplitude: float, goal: float) -> np.ndarray:
        """To the trim, as fast as the cylinder goes."""
        valve = self._cylinder.valve_for(goal, LOW[2], HIGH[2])
        meanwhile = 0.5 * (self._cylinder.pressure + self._cylinder.ahead(valve))
        return action_for(FREQUENCY, max(amplitude, self._amplitude_at(meanwhile)), valve)

    def _amplitude_at(self, pressure: float) -> float:
        """The amplitude in V that gives settled blows their target at a pressure in bar."""
        tried = np.linspace(LOW[1], HIGH[1], 16)
        peaks = [amplitude * self._rock.peak_at(pressure / amplitude) for amplitude in tried]
        return float(np.interp(self._target, peaks, tried))

    def _regulate(self, observation: np.ndarray, ratio: float, moved: float) -> np.ndarray:
        """One step of the regulator."""
        amplitude, valve = float(observation[AMPLITUDE]), float(observation[VALVE])
        deviation = np.array(
            [moved, float(observation[MEAN_PEAK]) - self._target, self._cylinder.pressure - ratio * amplitude]
        )
        steps = -self._gains.at(self._rock.loading, self._cylinder.lag) @ deviation
        return action_for(FREQUENCY, amplitude + steps[1], valve + steps[0])
