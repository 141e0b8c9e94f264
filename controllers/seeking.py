"""Extremum seeking: find the pressure that drills best by moving it a little all the time, without a model of the rock.

The scheme is the classical one of a perturbation, a washout, a demodulation and an integrator (surveyed in Y. Tan,
W. H. Moase, C. Manzie, D. Nesic and I. M. Y. Mareels, "Extremum Seeking From 1922 To 2010", 29th Chinese Control
Conference, Beijing, 2010). A digital extremum seeker has tuned the drive of an ultrasonic/sonic drill/corer to its
changing resonance before (NASA Tech Briefs, www.techbriefs.com, electronics-and-computers, article 2706); here the
frequency stays and the pressure is sought.

- PERTURB: pressure over amplitude is moved by PERTURBATION up and down, with a period long enough for the cylinder.
- MEASURE the progress: the penetration rate, a quarter of it where blows are not single.
- DEMODULATE: the change of the progress times that of the ratio that was really there (by the gauge, so that the lag of
  the cylinder does not turn its sign), low-passed, is the slope. Slow changes of both are washed out.
- INTEGRATE the slope.
- BARRIER: the rating is no part of the search. The amplitude keeps the blows just below it, at any pressure. A second
  impact or chatter moves the ratio down at once, and starts the slope anew.

While the amplitude can hold the blows at the rating, progress hardly depends on the pressure and there is little to
seek; on soft rock, where full amplitude does not reach the rating, the search raises the pressure until it does.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from drillenv.controllers.chart import FREQUENCY
from drillenv.controllers.estimate import AMPLITUDE, GAUGE, LARGEST_PEAK, MEAN_PEAK, RATE, inside, is_single
from drillenv.env.task import RANGES, action_for

START = 2.1
"""bar/V to begin with."""
BOUNDS = (1.2, 3.2)
"""bar/V to search in."""
PERTURBATION, PERIOD = 0.03, 6
"""Relative size of the perturbation, and its period in intervals: 1.5 s."""
GAIN = 0.4
"""Of the integrator: what of the perturbation a slope of 1 adds in an interval."""
STEEPEST = 2.0
"""Slopes beyond are taken for this."""
WASHOUT, SMOOTHING = 0.3, 0.3
"""Share of a change that the washed-out means, and the slope, take over in an interval."""
JUMP = 0.25
"""Relative change of the progress in an interval that no perturbation makes: the rock is another, and the slope is
begun anew."""
RETREAT = 0.05
"""By how much of itself the ratio goes down where blows are not single."""
OTHERWISE = 0.25
"""What progress without single blows is worth."""
TARGET = 0.985
"""Share of the rating that the barrier keeps blows at."""
LESS, MORE = 0.75, 1.3
"""What the amplitude is multiplied by at the most in one interval."""
PAST = 1.2
"""How far the valve is turned past the mark, in multiples of what the gauge is short of it."""


class Seeking:
    """The search above.

    Args:
        rating: Contact force in N to stay below.
    """

    sees_truth = False

    def __init__(self, rating: float = 2000.0):
        self._rating = rating / 1e3
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Begin the search."""
        self._centre = math.log(START)
        self._interval = 0
        self._begin_slope(self._centre, 0.0)

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting."""
        observation = inside(observation)
        amplitude, gauge = float(observation[AMPLITUDE]), float(observation[GAUGE])
        single = is_single(observation)
        present = math.log(gauge / amplitude)
        self._seek(present, self._progress(observation, single), single)
        if not single:
            self._centre = min(self._centre, present) - RETREAT
        self._centre = float(np.clip(self._centre, *np.log(BOUNDS)))
        self._interval += 1
        perturbed = self._centre + PERTURBATION * math.sin(2.0 * math.pi * self._interval / PERIOD)
        barrier = np.clip(TARGET * self._rating / max(float(observation[LARGEST_PEAK]), 0.2), LESS, MORE)
        amplitude = float(np.clip(amplitude * barrier, *RANGES[1]))
        mark = float(np.clip(math.exp(perturbed) * amplitude, *RANGES[2]))
        return action_for(FREQUENCY, amplitude, mark + PAST * (mark - gauge))

    def _progress(self, observation: np.ndarray, single: bool) -> float:
        """What is sought, in mm/s."""
        strong = min(1.0, float(observation[MEAN_PEAK]) / self._rating) if single else 0.0
        return max(float(observation[RATE]), 0.0) * (OTHERWISE + (1.0 - OTHERWISE) * strong)

    def _seek(self, ratio: float, progress: float, single: bool) -> None:
        """Demodulate and integrate; ``ratio`` is the logarithm of pressure over amplitude."""
        change = (progress - self._mean_progress) / max(self._mean_progress, 0.3)
        moved = ratio - self._mean_ratio
        if not single or abs(change) > JUMP:
            self._begin_slope(ratio, progress)
            return
        self._mean_progress += WASHOUT * (progress - self._mean_progress)
        self._mean_ratio += WASHOUT * moved
        self._slope += SMOOTHING * (change * moved / PERTURBATION**2 - self._slope)
        self._centre += GAIN * PERTURBATION * float(np.clip(self._slope, -STEEPEST, STEEPEST))

    def _begin_slope(self, ratio: float, progress: float) -> None:
        self._mean_ratio, self._mean_progress, self._slope = ratio, progress, 0.0
