"""Where the frame of a rig resonates, by Bayes' rule.

The frame takes up to 60 % of the force around its resonance (:mod:`drillenv.env.hole.shaker`). For each frequency at
which it may resonate, the table of settled motions foretells the peak of the blows at the setting that was driven, on
the rock as it is estimated. How far the logarithm of the peak is from that, says how likely each is:

    log p <- FORGETTING log p + log((1 - OUTLIERS) N(log(peak / foretold); 0, DEVIATION) + OUTLIERS / 2)

OUTLIERS is the share of steps whose motion had not settled or is another one. Only steps of single blows are judged.
The forgetting factor is below 1 since the errors of the table are the same from step to step and not independent.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.controllers.hole.rules import single_blows
from drillenv.controllers.hole.settled import FEATURES, PEAK, look_up, read_settled
from drillenv.dynamics.compiled import KERNEL
from drillenv.env.hole import shaker
from drillenv.env.hole.readings import AT

RESONANCES = np.arange(shaker.RESONANCE_RANGE[0] + 1.25, shaker.RESONANCE_RANGE[1], 2.5)
"""In Hz, evenly over where frames resonate."""
DEVIATION = 0.08
OUTLIERS = 0.1
FORGETTING = 0.97
_SETTING = [AT[name] for name in ("frequency", "amplitude", "pressure", "largest_peak_force")]


@njit(**KERNEL)
def _update(values: np.ndarray, seen: np.ndarray, rock: np.ndarray, log_posterior: np.ndarray) -> None:
    """Update ``log_posterior`` (m, RESONANCES) by what was seen (m, 4), Hz, V, bar and peak in kN, on rock (m, 2)."""
    room = np.empty(FEATURES)
    for i in range(seen.shape[0]):
        frequency, pressure = seen[i, 0], seen[i, 2]
        amplitude = min(seen[i, 1], shaker.largest_amplitude(frequency, shaker.AMPLIFIER_FORCE))
        for j in range(RESONANCES.size):
            driven = amplitude * shaker.share_transmitted(frequency, RESONANCES[j], shaker.RESONANCE_DEPTH)
            look_up(values, rock[i, 0], rock[i, 1], frequency, pressure / driven, room)
            away = math.log(1e3 * seen[i, 3] / max(driven * room[PEAK], 1.0)) / DEVIATION
            normal = math.exp(-0.5 * away * away) / (DEVIATION * math.sqrt(2.0 * math.pi))
            likelihood = (1.0 - OUTLIERS) * normal + 0.5 * OUTLIERS
            log_posterior[i, j] = FORGETTING * log_posterior[i, j] + math.log(likelihood)


class FrameFilter:
    """Remembers for n rigs, each by itself.

    Args:
        n: Number of rigs.

    Attributes:
        log_posterior: (n, RESONANCES) logarithm of the posterior probability of each resonance, against the likeliest.
    """

    def __init__(self, n: int):
        self.log_posterior = np.zeros((n, RESONANCES.size))
        self._values = read_settled().values

    def forget(self, rigs: np.ndarray) -> None:
        """Begin anew with these of the rigs: every resonance is as likely."""
        self.log_posterior[rigs] = 0.0

    def of(self, seen: np.ndarray, loading: np.ndarray, hardening: np.ndarray, rigs: np.ndarray) -> np.ndarray:
        """(m, RESONANCES) probabilities.

        Args:
            seen: (m, 20) readings of these of the rigs.
            loading: (m,) stiffness of the rock under the bit in N/m, as it is estimated.
            hardening: (m,) the unloading stiffness over it.
            rigs: (m,) which.
        """
        single = single_blows(seen) & (seen[:, AT["largest_peak_force"]] > 0.1)
        judged, rock = self.log_posterior[rigs[single]], np.column_stack([loading, hardening])[single].astype(float)
        _update(self._values, seen[single][:, _SETTING], rock, judged)
        self.log_posterior[rigs[single]] = judged - judged.max(axis=1, keepdims=True)
        posterior = np.exp(self.log_posterior[rigs])
        return posterior / posterior.sum(axis=1, keepdims=True)
