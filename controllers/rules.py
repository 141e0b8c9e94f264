"""The paper's advice as a state machine, to be read by somebody who drills.

1. Drill at the highest frequency: P-1-I-1 reaches farthest there.
2. SEARCH: while every blow is single and like the last one, raise the pressure little by little; more pressure, more
   progress.
3. BACK OFF: at a second impact, at chatter or when blows alternate, let pressure off at once, well below where it
   happened, since the motion comes back to single blows later than it left them. Then hold for a while.
4. At all times keep the blows just below the rating with the amplitude; pressure goes along with it, because pressure
   over amplitude decides on the motion.
5. NEW ROCK: when the blows change though the setting did not, the rock has. Start again from a careful pressure.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from drillenv.env.observation import READINGS
from drillenv.env.task import RANGES, action_for

(MEAN_PEAK, LARGEST_PEAK, _SPREAD, IMPACTS, PERIOD_TWO) = range(5)
AMPLITUDE, PRESSURE = 12, 14
assert (READINGS[AMPLITUDE].name, READINGS[PRESSURE].name) == ("amplitude", "pressure")

FREQUENCY = 120.0
"""Hz."""
CAREFUL = 1.6
"""bar/V at which all rocks of Table 2.2 give single blows at 120 Hz."""
STEP = 0.05
"""bar/V by which pressure is raised from interval to interval while all is well."""
RETREAT = 0.85
"""What is left of the pressure after a second impact."""
PATIENCE = 24
"""Intervals to hold after one: 6 s, most of a layer."""
TARGET = 0.97
"""Share of the rating that the blows are kept at: the rest is for noise and for the next rock."""
JUMP = 0.12
"""Change of the blows, beyond what amplitude explains, that means a new rock."""


class Rules:
    """The state machine above.

    Args:
        rating: Contact force in N to stay below.
    """

    sees_truth = False

    def __init__(self, rating: float = 2000.0):
        self._rating = rating / 1e3
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget what was learned of the rock."""
        self._ratio = CAREFUL
        self._hold = 0
        self._last: tuple[float, float] | None = None

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting."""
        seen = observation.tolist()
        peak, amplitude, pressure = seen[LARGEST_PEAK], seen[AMPLITUDE], seen[PRESSURE]
        single = 0.9 <= seen[IMPACTS] <= 1.1 and seen[PERIOD_TWO] < 0.1
        self._search_or_back_off(single, pressure / amplitude)
        if single and self._is_new_rock(peak, amplitude):
            self._ratio, self._hold = min(self._ratio, CAREFUL), 0
        self._last = (peak, amplitude) if single else None
        # a blow grows a little faster than the amplitude alone while the pressure follows late
        wanted = amplitude * np.clip(TARGET * self._rating / max(peak, 0.2), 0.75, 1.15)
        amplitude = float(np.clip(wanted, *RANGES[1]))
        return action_for(FREQUENCY, amplitude, self._ratio * amplitude)

    def _search_or_back_off(self, single: bool, present: float) -> None:
        """Move pressure over amplitude; ``present`` is what it is in the cylinder now, in bar/V."""
        if not single:
            self._ratio = max(1.0, RETREAT * min(self._ratio, present))
            self._hold = PATIENCE
        elif self._hold > 0:
            self._hold -= 1
        else:
            self._ratio += STEP

    def _is_new_rock(self, peak: float, amplitude: float) -> bool:
        """Whether the blows changed more than the amplitude did."""
        if self._last is None:
            return False
        before, then = self._last
        expected = before * amplitude / then
        return abs(peak - expected) > JUMP * expected
