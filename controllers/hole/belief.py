"""What can be known of a hole by remembering what was seen: how worn the bit may be, and where the frame resonates.

A reading says little of either by itself. So each is held against what was seen before: progress per blow and the time
of contact against those of the same bit when it was new, since a blunt bit drills less and meets a stiffer rock; force
per volt against that at other frequencies, since the frame takes force near its resonance.
"""

from __future__ import annotations

import numpy as np

from drillenv.controllers.hole.rules import reckoned_wear
from drillenv.env.hole.readings import READINGS

SCALES = {
    "mean_peak_force": (1.0, 2.0),
    "largest_peak_force": (1.0, 2.0),
    "peak_force_spread": (0.1, 0.5),
    "impacts_per_cycle": (1.0, 3.0),
    "period_two": (0.05, 0.3),
    "contact_share": (0.2, 0.3),
    "half_harmonic": (2.0, 10.0),
    "first_harmonic": (5.0, 10.0),
    "second_harmonic": (3.0, 10.0),
    "third_harmonic": (2.0, 10.0),
    "penetration_rate": (1.0, 3.0),
    "frequency": (90.0, 30.0),
    "amplitude": (0.42, 0.15),
    "valve_pressure": (0.9, 0.6),
    "pressure": (0.9, 0.6),
    "coil_rise": (60.0, 50.0),
    "hole_depth": (2.0, 2.0),
    "depth_left": (2.0, 2.0),
    "bit_depth": (0.7, 1.0),
    "bit_blows": (0.15, 0.2),
}
"""Centre and width of each reading in its unit: about the middle and the spread of what is met."""
CENTRE = np.array([SCALES[reading.name][0] for reading in READINGS], dtype=np.float32)
WIDTH = np.array([SCALES[reading.name][1] for reading in READINGS], dtype=np.float32)
_AT = {reading.name: j for j, reading in enumerate(READINGS)}

WEAR = CENTRE.size
"""Where the reckoned wear of the bit stands in a belief."""
NEW = 6
"""Steps over which a bit is new."""
QUICK, SLOW = 4.0, 24.0
"""Time constants in steps of the two moving averages."""
BANDS = np.linspace(72.5, 117.5, 10)
"""Middles of the bands of frequencies in Hz, 5 Hz wide but for the first and the last, for which the force is kept."""
SIGNS = 2
"""Progress per blow and time of contact: what shows how blunt a bit is."""
SIZE = WEAR + 1 + 4 * SIGNS + 2 * BANDS.size + 3
"""Numbers of a belief."""
USUAL = np.array([-4.5, -6.2])
"""Logarithms of progress per blow in mm/s per Hz and kN, and of the time of contact in s, that are usual."""


class Belief:
    """Remembers for n rigs, each by itself.

    Args:
        n: Number of rigs.
    """

    def __init__(self, n: int):
        self._mean = np.zeros((n, SIGNS))  # of the new bit
        self._quick, self._slow = np.zeros((n, SIGNS)), np.zeros((n, SIGNS))
        self._steps, self._age = np.zeros(n), np.zeros(n)
        self._wear, self._blows, self._last = np.zeros(n), np.zeros(n), np.zeros((n, 2))
        self._force, self._known = np.zeros((n, BANDS.size)), np.zeros((n, BANDS.size))

    def forget(self, rigs: np.ndarray) -> None:
        """Begin anew with these of the rigs."""
        for each in vars(self).values():
            each[rigs] = 0.0

    def of(self, readings: np.ndarray, rigs: np.ndarray | None = None) -> np.ndarray:
        """What is known with these readings (m, 20) of these of the rigs, of all where None: (m, SIZE) float32."""
        at = np.arange(len(self._wear)) if rigs is None else rigs
        seen = readings.astype(float)
        signs = self._signs(seen)
        self._follow_bit(seen, signs, at)
        for average, steps in ((self._quick, QUICK), (self._slow, SLOW)):
            weight = np.maximum(1.0 / (self._steps[at] + 1.0), 1.0 / steps)[:, None]
            average[at] += weight * (signs - average[at])
        self._steps[at] += 1.0
        self._follow_frame(seen, at)
        usual, new = signs - USUAL, self._mean[at]
        return np.column_stack(
            [
                (seen - CENTRE) / WIDTH,
                self._wear[at],
                0.5 * usual,
                2.0 * (signs - new),
                2.0 * (self._quick[at] - new),
                self._slow[at] - new,
                self._force[at],
                self._known[at],
                self._last[at],
                np.minimum(self._age[at] / NEW, 1.0),
            ]
        ).astype(np.float32)

    @staticmethod
    def _signs(seen: np.ndarray) -> np.ndarray:
        """(m, SIGNS) logarithms, see :data:`USUAL`."""
        frequency = np.maximum(seen[:, _AT["frequency"]], 1.0)
        per_blow = seen[:, _AT["penetration_rate"]] / (frequency * np.maximum(seen[:, _AT["largest_peak_force"]], 0.05))
        contact = np.maximum(seen[:, _AT["contact_share"]], 0.02) / frequency
        return np.log(np.column_stack([np.maximum(per_blow, 1e-4), contact]))

    def _follow_bit(self, seen: np.ndarray, signs: np.ndarray, at: np.ndarray) -> None:
        """Reckon the wear; at a new bit, keep what the last one came to, and learn what the new one shows."""
        blows = 1e6 * seen[:, _AT["bit_blows"]]
        fresh = blows < self._blows[at]
        now = at[fresh]
        self._last[now] = np.column_stack([self._wear[now], np.ones(now.size)])
        self._wear[now], self._age[now], self._mean[now] = 0.0, 0.0, 0.0
        made = np.where(fresh, 0.0, blows - self._blows[at])
        self._wear[at] += reckoned_wear(made, seen[:, _AT["mean_peak_force"]])
        self._blows[at] = blows
        weight = np.where(self._age[at] < NEW, 1.0 / (self._age[at] + 1.0), 0.0)[:, None]
        self._mean[at] += weight * (signs - self._mean[at])
        self._age[at] += 1.0

    def _follow_frame(self, seen: np.ndarray, at: np.ndarray) -> None:
        """Keep the force per volt that was last seen in each band of frequencies."""
        band = np.abs(seen[:, _AT["frequency"]][:, None] - BANDS).argmin(axis=1)
        drilled = seen[:, _AT["largest_peak_force"]] > 0.1
        per_volt = seen[:, _AT["largest_peak_force"]] / np.maximum(seen[:, _AT["amplitude"]], 0.1)
        self._force[at[drilled], band[drilled]] = np.log(np.maximum(per_volt, 0.2) / 4.0)[drilled]
        self._known[at[drilled], band[drilled]] = 1.0
