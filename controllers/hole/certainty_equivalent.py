"""Sets what makes a metre cheapest, with wear at its price, on the hole that it believes in.

Certainty equivalence (Simon, Econometrica 24, 1956, 74): what cannot be read is estimated
(:mod:`drillenv.controllers.hole.belief`), and acted on as if it were so. Of every setting the table of settled motions
(:mod:`drillenv.controllers.hole.settled`) says progress, wear and heat, in the mean over where the frame may resonate,
and the setting with the least

    (rig + energy + price of wear * wear a second) / progress

is taken. Wear has the price of a bit and its change over the wear that a bit is used for. A bit is changed by the rule
of age replacement (Barlow & Proschan, Mathematical Theory of Reliability, 1965, chapter 4): when the chance of breaking
it by a little more wear, times what breaking costs beyond a change, comes to the price of that wear.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from drillenv.checks import InputError, number
from drillenv.controllers.hole.belief import NAMES, PROBABILITIES, STIFFNESS, WEAR, Belief
from drillenv.controllers.hole.frame import RESONANCES
from drillenv.controllers.hole.oracle import hole_of
from drillenv.controllers.hole.planning import Physics, drilled, physics_of, settings_grid
from drillenv.controllers.hole.settled import FEATURES
from drillenv.dynamics.compiled import KERNEL
from drillenv.env.hole import shaker
from drillenv.env.hole.batch import STEP
from drillenv.env.hole.bit import STRENGTH, STRENGTH_SHAPE, stiffening
from drillenv.env.hole.episodes import LAYER_ABRASIVITY, LAYER_END, LAYER_KL, LAYER_KU, MOST_BITS, Hole
from drillenv.env.hole.readings import AT, DEPTH
from drillenv.env.hole.readings import WEAR as HOLE_WEAR
from drillenv.env.hole.task import HoleTask
from drillenv.env.scalar import EnvState
from drillenv.env.task import action_for

SCAN = (116.0, 107.0, 98.0)
"""Frequencies in Hz of the first steps, that show where the frame resonates."""
SCAN_SETTING = (0.4, 0.55)
"""V and bar of them."""
UNLIKELY = 0.02
"""Resonances with less probability are left out."""
HYSTERESIS = 0.04
"""By this share another setting must be better than the present one: a motion takes time to settle."""
MARGIN = 4.0
"""K below the limit of the coil that are kept."""
SLOWEST = 5e-5
"""m/s below which a setting is left out."""
POINTS, SHARES = np.polynomial.hermite_e.hermegauss(5)
SHARES = SHARES / SHARES.sum()
"""Points and weights for means over a normal distribution."""
PROGRESS, WORN = 0, 1
"""Columns of rates."""


@njit(**KERNEL)
def rates_of(ph: Physics, wear: float, settings: np.ndarray) -> np.ndarray:
    """(n, 4) progress in m/s, wear a second, the coil's final rise in K and EUR a second of settings (n, 3)."""
    room, found = np.empty(FEATURES), np.empty((settings.shape[0], 4))
    for i in range(settings.shape[0]):
        rate, worn, rise, cost, _peak = drilled(ph, 0, wear, settings[i], room)
        found[i] = rate, worn, rise, cost
    return found


def hazard(wear: np.ndarray) -> np.ndarray:
    """The probability a unit of wear that a bit breaks which has come so far."""
    return STRENGTH_SHAPE / STRENGTH * (np.maximum(wear, 0.0) / STRENGTH) ** (STRENGTH_SHAPE - 1.0)


def cumulative_hazard(wear: float) -> float:
    """The integral of the hazard."""
    return (max(wear, 0.0) / STRENGTH) ** STRENGTH_SHAPE


class Known(NamedTuple):
    """What is known of a rig and its hole."""

    wear: float
    spread: float
    """Standard deviation of the wear."""
    abrasivity: float
    loading: float
    """Stiffness in N/m under a sharp bit."""
    hardening: float
    """Unloading over loading stiffness."""
    resonances: np.ndarray
    """(m,) in Hz, where the frame may resonate."""
    probabilities: np.ndarray
    """(m,) with which probability."""


def believed(row: np.ndarray) -> Known:
    """What a belief (SIZE,) says."""
    n = len(NAMES)
    wear, log_abrasivity, log_stiffness, log_hardening = row[WEAR : WEAR + n].tolist()
    spread, spread_abrasivity = row[WEAR + n : WEAR + n + 2].tolist()
    wear = max(wear, 0.0)
    probabilities = row[PROBABILITIES:]
    likely = probabilities > UNLIKELY
    return Known(
        wear,
        spread,
        math.exp(log_abrasivity + 0.5 * spread_abrasivity**2),  # the mean, since wear is proportional to it
        STIFFNESS * math.exp(log_stiffness) / stiffening(wear),
        math.exp(log_hardening),
        RESONANCES[likely],
        probabilities[likely] / probabilities[likely].sum(),
    )


class HolePlanner:
    """Plans each step on the hole that it believes in, from readings alone.

    Args:
        task: What is drilled for.
        used: Wear that a bit is used for, which its price is shared out over.
    """

    sees_truth = False

    def __init__(self, task: HoleTask | None = None, used: float = 0.85):
        self._task = task or HoleTask()
        self._change, self._break = self._task.costs.of_change, self._task.costs.of_breakage
        self._price = self._change / number("used", used, 0.01, 10.0)
        self._settings = settings_grid()
        self._actions = np.array([action_for(*each) for each in self._settings], dtype=np.float32)
        self._scan = np.array([action_for(each, *SCAN_SETTING) for each in SCAN], dtype=np.float32)
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the hole so far."""
        self._belief: Belief | None = None
        self._present = np.empty(0, dtype=np.int64)
        self._step = 0

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting, (4,) or (n, 4) as the observation is (20,) or (n, 20)."""
        readings = np.atleast_2d(observation)
        if self._step == 0:
            self._present = np.full(len(readings), -1)
        actions = np.full((len(readings), 4), -1.0, dtype=np.float32)
        scan = self._to_scan()
        for i, known in enumerate(self._know(readings)):
            found = self._rates(known)
            at = self._cheapest(found, float(readings[i, AT["coil_rise"]]), int(self._present[i]))
            self._present[i] = at
            actions[i, :3] = self._actions[at] if scan is None else scan
            ahead = readings[i, AT["depth_left"]] * found[at, WORN] / max(found[at, PROGRESS], SLOWEST)
            if self._worn_out(known, float(ahead)):
                actions[i, 3] = 1.0
        self._step += 1
        return actions[0] if observation.ndim == 1 else actions

    def _to_scan(self) -> np.ndarray | None:
        """The setting of this step where frequencies are still scanned."""
        return self._scan[self._step] if self._step < len(SCAN) else None

    def _know(self, readings: np.ndarray) -> list[Known]:
        """What is known of each rig with these readings (n, 20)."""
        if self._belief is None:
            self._belief = Belief(len(readings))
        return [believed(row) for row in self._belief.of(readings).astype(float)]

    def _rates(self, known: Known) -> np.ndarray:
        """As :func:`rates_of`, in the mean over where the frame may resonate."""
        layer = np.array([[known.loading, known.loading * known.hardening, np.inf, known.abrasivity]])
        ph = physics_of(self._task, Hole(self._task.depth, layer, 0.0, np.full(MOST_BITS, np.inf), 0.0))
        each = (rates_of(ph._replace(resonance=at), known.wear, self._settings) for at in known.resonances.tolist())
        return sum((share * found for share, found in zip(known.probabilities, each, strict=True)), np.zeros(4))

    def _cheapest(self, found: np.ndarray, rise: float, present: int) -> int:
        """The setting that makes a metre cheapest, or the present one where that is nearly as good."""
        progress, worn, final, cost = found.T
        hot = final + (rise - final) * math.exp(-STEP / shaker.TIME_CONSTANT) > shaker.LIMIT - MARGIN
        metre = (cost + self._price * worn) / np.maximum(progress, SLOWEST)
        metre[(progress <= SLOWEST) | hot] = np.inf
        best = int(np.argmin(metre))
        return present if present >= 0 and metre[present] < (1.0 + HYSTERESIS) * metre[best] else best

    def _worn_out(self, known: Known, ahead: float) -> bool:
        """Whether to change the bit, where so much more wear leads to the bottom of the hole."""
        risk = float(SHARES @ hazard(known.wear + known.spread * POINTS)) * (self._break - self._change)
        broken = -math.expm1(cumulative_hazard(known.wear) - cumulative_hazard(known.wear + ahead))
        return risk > self._price and broken * self._break > self._change


class KnowingPlanner(HolePlanner):
    """The same where wear, rock and frame are known, and only the strengths of the bits and what is below are not.

    It has to be given the plant: :meth:`attach` it before the episode.
    """

    sees_truth = True
    _state: Callable[[], EnvState] | None = None

    def attach(self, state: Callable[[], EnvState]) -> None:
        """Take the plant of the coming episodes; ``state`` gives its present one, see ``DrillEnv.get_state``."""
        self._state = state

    def _to_scan(self) -> None:
        """There is nothing to find out."""

    def _know(self, readings: np.ndarray) -> list[Known]:
        if self._state is None:
            raise InputError("the planner has no plant to know: attach(env.unwrapped.get_state) before the episode")
        hole, now = hole_of(self._state())
        layer = hole.layers[int(np.searchsorted(hole.layers[:, LAYER_END], now[DEPTH], side="right"))]
        loading, hardening = layer[LAYER_KL], layer[LAYER_KU] / layer[LAYER_KL]
        frame = np.array([hole.resonance]), np.ones(1)
        return [Known(float(now[HOLE_WEAR]), 0.0, layer[LAYER_ABRASIVITY], loading, hardening, *frame)]
