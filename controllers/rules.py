"""The paper's advice as a few rules, to be read by somebody who drills.

1. Drill at the highest frequency: single strong blows (P-1-I-1) reach farthest there.
2. BLOWS: keep them just below the rating with the amplitude. Too strong: less amplitude. Too weak: more.
3. Pressure goes along with the amplitude, because pressure over amplitude decides on the motion. Keep to what every
   rock bears (CAREFUL).
4. RAISE: where blows are too weak though the amplitude is at its top, the rock is soft. Add pressure little by little.
   Let it go again when much less than the full amplitude will do: then the rock has changed.
5. BACK OFF: at a second impact, at chatter or when blows alternate, take a little pressure off, again and again until
   the blows are single. Come back slowly.
6. The cylinder fills slowly. Turn the valve past the mark by more than the gauge is short of it, and back as it comes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from drillenv.env.observation import HIGH, LOW, READINGS
from drillenv.env.task import RANGES, action_for

(_MEAN_PEAK, LARGEST_PEAK, _SPREAD, IMPACTS, PERIOD_TWO) = range(5)
AMPLITUDE, GAUGE = 12, 14
assert (READINGS[AMPLITUDE].name, READINGS[GAUGE].name) == ("amplitude", "pressure")

FREQUENCY = 120.0
"""Hz."""
CAREFUL = 2.2
"""bar/V at which all rocks of Table 2.2 give single blows at 120 Hz."""
HIGHEST = 2.9
"""bar/V; soft rocks lose their single blows at 3.05."""
TARGET = 0.995
"""Share of the rating that the blows are kept at: the rest is for noise."""
LESS, MORE = 0.75, 1.3
"""What the amplitude is multiplied by at the most in one interval."""
MUCH_LESS = 0.9
"""Share of the full amplitude below which pressure over amplitude need not be above CAREFUL."""
RAISE = 0.1
"""bar/V added in an interval while blows are too weak at full amplitude."""
BACK_OFF, COME_BACK = 0.97, 0.02
"""What is left of pressure over amplitude after an interval with other than single blows, and bar/V that come back in
one with."""
PAST = 1.5
"""How far the valve is turned past the mark, in multiples of what the gauge is short of it."""


class Rules:
    """The rules above.

    Args:
        rating: Contact force in N to stay below.
    """

    sees_truth = False

    def __init__(self, rating: float = 2000.0):
        self._target = TARGET * rating / 1e3
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget what was learned of the rock."""
        self._ratio = CAREFUL

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting."""
        seen = np.clip(observation, LOW, HIGH).tolist()
        peak, amplitude, gauge = max(seen[LARGEST_PEAK], 0.2), seen[AMPLITUDE], seen[GAUGE]
        lowest, full = RANGES[1]
        at_top = amplitude > 0.98 * full
        if not (0.9 <= seen[IMPACTS] <= 1.1 and seen[PERIOD_TWO] < 0.1):
            self._ratio = max(1.0, BACK_OFF * min(self._ratio, gauge / amplitude))
        elif at_top and peak < 0.99 * self._target:
            if gauge > 0.95 * self._ratio * amplitude:  # what was asked for has come, and was not enough
                self._ratio = min(HIGHEST, self._ratio + RAISE)
        elif amplitude < MUCH_LESS * full:
            self._ratio = min(CAREFUL, self._ratio + COME_BACK)
        amplitude = float(np.clip(amplitude * np.clip(self._target / peak, LESS, MORE), lowest, full))
        mark = float(np.clip(self._ratio * amplitude, *RANGES[2]))
        return action_for(FREQUENCY, amplitude, mark + PAST * (mark - gauge))
