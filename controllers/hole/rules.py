"""The best that could be written down as rules for a whole hole, and one setting for everything.

1. SCAN: at the start of a hole, drive for one step at each of a few frequencies with a moderate amplitude, and keep
   the one with the most progress: the others may lie in the resonance of the frame.
2. FORCE: keep the blows at a share of the rating with the amplitude, but never more than the coil bears for ever at
   this frequency, by what its maker states.
3. PRESSURE goes along with the amplitude, less at lower frequencies. At chatter or when blows alternate, take some
   off, and come back slowly.
4. CHANGE the bit when its wear, reckoned from blows and forces as on rock of middling abrasivity, or the loss of
   progress per blow since it was fitted says so; not shortly before the bottom.

The numbers were searched on the frozen set "train" by ``python -m drillenv.training.hole_search``: the back-off of rule
3 and the loss of progress of rule 4 turned out not to pay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from drillenv.env.hole import shaker
from drillenv.env.hole.batch import STEP
from drillenv.env.hole.bit import EDGE_POWER, FATIGUE, FATIGUE_EXPONENT, LIFE
from drillenv.env.hole.readings import AT
from drillenv.env.task import RANGES
from drillenv.rig import DRIVE_BASE, DRIVE_SLOPE

RATING = 2.0
"""kN."""
LESS, MORE = 0.75, 1.3
"""What the amplitude is multiplied by at the most in one step."""


@dataclass(frozen=True)
class Numbers:
    """The numbers of the rules.

    Args:
        highest, lowest: Ends of the frequencies that are scanned, in Hz.
        scanned: How many.
        favour: Power of the frequency that progress is divided by in the choice: 0 for progress alone.
        force: Share of the rating that blows are kept at.
        ratio: Pressure over amplitude at 120 Hz in bar/V.
        slope: Power of the frequency with which it falls below.
        back_off, come_back: What is left of the ratio after a step without single blows, and what comes back in one.
        held: Final rise of the coil in K that the amplitude may lead to.
        worn: Reckoned wear at which the bit is changed.
        loss: Progress per blow, as a share of the most since the bit was fitted, below which it is changed.
        last: Depth left in m from which on the bit is not changed any more.
    """

    highest: float = 116.6
    lowest: float = 99.2
    scanned: int = 3
    favour: float = 1.2
    force: float = 1.3
    ratio: float = 1.61
    slope: float = 1.84
    back_off: float = 1.0
    come_back: float = 0.099
    held: float = 93.6
    worn: float = 0.692
    loss: float = 0.2
    last: float = 0.55


class HoleRules:
    """The rules above, for one rig or for many alike.

    Args:
        numbers: Their numbers; those found by the search where left out.
    """

    sees_truth = False

    def __init__(self, numbers: Numbers | None = None):
        self._numbers = numbers or Numbers()
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the hole."""
        self._n = 0

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting, (4,) or (n, 4) as the observation is (20,) or (n, 20)."""
        seen = np.atleast_2d(observation).astype(float)
        actions = self._decide(seen, seen.shape[0])
        return actions[0] if observation.ndim == 1 else actions

    def _decide(self, seen: np.ndarray, n: int) -> np.ndarray:
        numbers = self._numbers
        scan = np.linspace(numbers.highest, numbers.lowest, numbers.scanned)
        if self._n == 0:
            self._frequency, self._ratio = np.full(n, scan[0]), np.full(n, numbers.ratio)
            self._gain, self._wear = np.zeros((n, scan.size)), np.zeros(n)
            self._best, self._blows = np.zeros(n), np.zeros(n)
        change = self._worn_out(seen)
        if self._n < scan.size:
            if self._n:
                self._gain[:, self._n - 1] = seen[:, AT["penetration_rate"]]
            self._frequency[:] = scan[self._n]
            amplitude = np.full(n, 0.4)
        else:
            if self._n == scan.size:
                self._gain[:, -1] = seen[:, AT["penetration_rate"]]
                self._frequency = scan[np.argmax(self._gain / scan**numbers.favour, axis=1)]
            amplitude = self._amplitude(seen)
        self._n += 1
        pressure = self._pressure(seen, amplitude)
        low, high = RANGES[:, 0], RANGES[:, 1]
        settings = np.stack([self._frequency, amplitude, pressure], axis=1)
        actions = (settings - RANGES.mean(axis=1)) / (0.5 * (high - low))
        fourth = np.where(change, 1.0, -1.0)
        return np.clip(np.column_stack([actions, fourth]), -1.0, 1.0).astype(np.float32)

    def _amplitude(self, seen: np.ndarray) -> np.ndarray:
        """V: what keeps blows at their force, within what the coil bears."""
        peak = np.maximum(seen[:, AT["largest_peak_force"]], 0.2)
        wanted = seen[:, AT["amplitude"]] * np.clip(self._numbers.force * RATING / peak, LESS, MORE)
        held = np.sqrt(self._numbers.held / _rise_at_1_volt(self._frequency))
        return np.clip(np.minimum(wanted, held), *RANGES[1])

    def _pressure(self, seen: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
        """bar: along with the amplitude, less where blows did not come singly."""
        numbers = self._numbers
        eased = np.where(single_blows(seen), self._ratio + numbers.come_back, self._ratio * numbers.back_off)
        self._ratio = np.clip(eased, 0.5, numbers.ratio)
        return np.clip(self._ratio * (self._frequency / 120.0) ** numbers.slope * amplitude, *RANGES[2])

    def _worn_out(self, seen: np.ndarray) -> np.ndarray:
        """Whether to change the bit."""
        numbers = self._numbers
        fresh = seen[:, AT["bit_blows"]] * 1e6 < self._blows
        self._wear[fresh], self._best[fresh] = 0.0, 0.0
        blows = np.where(fresh, 0.0, seen[:, AT["bit_blows"]] * 1e6 - self._blows)
        self._blows = seen[:, AT["bit_blows"]] * 1e6
        self._wear += reckoned_wear(blows, seen[:, AT["mean_peak_force"]]).sum(axis=1)
        rate = seen[:, AT["frequency"]] * np.maximum(seen[:, AT["largest_peak_force"]], 0.05)
        per_blow = seen[:, AT["penetration_rate"]] / rate
        self._best = np.maximum(self._best, per_blow)
        change = (self._wear > numbers.worn) | (per_blow < numbers.loss * self._best)
        change &= (seen[:, AT["depth_left"]] > numbers.last) & (self._blows > 0.0)
        self._wear[change], self._best[change], self._blows[change] = 0.0, 0.0, 0.0
        return change


class HoleFixed:
    """One setting for every rock, and a new bit after a fixed depth.

    Args:
        frequency, amplitude, pressure: In Hz, V and bar; those found by the search where left out.
        bit_depth: Depth in m that a bit drills.
    """

    sees_truth = False

    def __init__(
        self, frequency: float = 79.5, amplitude: float = 0.559, pressure: float = 0.6, bit_depth: float = 2.45
    ):
        setting = np.array([frequency, amplitude, pressure])
        low, high = RANGES[:, 0], RANGES[:, 1]
        self._action = np.append(np.clip((setting - RANGES.mean(axis=1)) / (0.5 * (high - low)), -1.0, 1.0), -1.0)
        self._bit_depth = bit_depth

    def reset(self, seed: int | None = None) -> None:
        """Nothing to do."""

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The same setting always, (4,) or (n, 4) as the observation is (20,) or (n, 20)."""
        action = np.broadcast_to(self._action, (*observation.shape[:-1], 4)).astype(np.float32)
        change = observation[..., AT["bit_depth"]] > self._bit_depth
        action[..., 3] = np.where(change, 1.0, -1.0)
        return action


def single_blows(seen: np.ndarray) -> np.ndarray:
    """(m,) whether blows come singly, and each as the one before, by readings (m, 20)."""
    return (np.abs(seen[:, AT["impacts_per_cycle"]] - 1.0) < 0.1) & (seen[:, AT["period_two"]] < 0.1)


def reckoned_wear(blows: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(m, 2) wear of a bit by so many single blows of a force in kN in a step: abrasion and fatigue.

    As on rock of middling abrasivity, that is 1; see :mod:`drillenv.env.hole.bit`.
    """
    u = force / RATING
    heat = blows / STEP * u * u / EDGE_POWER
    abrasion = 0.5 * (1.0 + u) * (1.0 + heat * heat)
    return (blows / LIFE)[:, None] * np.column_stack([abrasion, FATIGUE * u**FATIGUE_EXPONENT])


def _rise_at_1_volt(frequency: np.ndarray) -> np.ndarray:
    """The coil's final rise in K at 1 V, by what its maker states."""
    share = (DRIVE_SLOPE * frequency + DRIVE_BASE) / shaker.HELD_FORCE
    top = 1.0 + (shaker.TOP / shaker.EDDY_FREQUENCY) ** 2
    return shaker.LIMIT * share**2 * (1.0 + (frequency / shaker.EDDY_FREQUENCY) ** 2) / top
