"""Two that know all of a hole: one plans to its bottom, one looks a step ahead."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from drillenv.checks import InputError, count
from drillenv.controllers.hole.planning import (
    BITS,
    Physics,
    cost_to_go,
    physics_of,
    rate_settings,
    settings_grid,
    solve,
)
from drillenv.env.hole import shaker
from drillenv.env.hole.batch import STEP, HoleBatch, Holes
from drillenv.env.hole.costs import BIT as BIT_PRICE
from drillenv.env.hole.costs import CHANGE_TIME
from drillenv.env.hole.episodes import Hole
from drillenv.env.hole.readings import BIT, DEPTH, RESONANCE, RISE, STEP_SPENT, TARGET, WEAR
from drillenv.env.hole.task import HoleTask
from drillenv.env.scalar import EnvState
from drillenv.env.task import action_for

CHANGE, KEEP = 1.0, -1.0
"""The fourth number of an action."""


def hole_of(state: EnvState) -> tuple[Hole, np.ndarray]:
    """The hole of an environment's state, and the row of its slow states."""
    states, layers, strengths = Holes(*state.rig.arrays[-4:-1])
    last = int(np.argmax(np.isinf(layers[:, 2])))
    hole = Hole(float(states[TARGET]), layers[: last + 1], float(states[RESONANCE]), strengths, 0.0)
    return hole, states


class HoleOracle:
    """Plans the whole hole on its true layers, frame and bits, and sets what is best for the true state.

    The plan is of the settled motion. At each step the settings that it likes best are tried on a copy of the true
    plant for one step, and what they lead to is valued by the plan. It has to be given the plant: :meth:`attach` it
    before the episode.

    Args:
        task: What is drilled for: costs and what is left out.
        settings: (n, 3) in Hz, V and bar, those to choose from; an even grid where left out.
        changes: Whether it may change bits; else it drills with each until it breaks.
        tried: How many settings are tried on the plant, with the present bit and with a new one each.
    """

    sees_truth = True
    _plans = True
    _wear_price = 0.0

    def __init__(
        self,
        task: HoleTask | None = None,
        settings: np.ndarray | None = None,
        changes: bool = True,
        tried: int = 16,
    ):
        self._task = task or HoleTask()
        self._changes = changes
        self._settings = settings_grid() if settings is None else settings
        self._actions = np.array([np.append(action_for(*each), KEEP) for each in self._settings], dtype=np.float32)
        self._tried = min(count("tried", tried, 1, 1000), len(self._settings))
        self._batch = HoleBatch(self._task, (1 + changes) * self._tried, threads=1)
        self._silence = np.zeros((self._batch.n, self._batch.readings.shape[1]))
        self._state: Callable[[], EnvState] | None = None
        self.reset()

    def attach(self, state: Callable[[], EnvState]) -> None:
        """Take the plant of the coming episodes; ``state`` gives its present one, see ``DrillEnv.get_state``."""
        self._state = state

    def reset(self, seed: int | None = None) -> None:
        """Forget the plan."""
        self._physics: Physics | None = None
        self._value = np.empty((0, 0, 0, 0))
        self._first = 0

    def bound(self) -> float:
        """The least cost per metre in EUR/m by the plan, from the state at which it was made: the relaxation's bound.

        Raises:
            InputError: nothing was planned yet.
        """
        if self._physics is None or not self._plans:
            raise InputError("nothing was planned yet: act on an episode first")
        return float(self._value[0, 0, 0, 0] + self._physics.costs[BIT_PRICE]) / self._physics.depth

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting, and whether to change the bit.

        Raises:
            InputError: not attached to a plant.
        """
        if self._state is None:
            raise InputError("the oracle has no plant to plan on: attach(env.unwrapped.get_state) before the episode")
        present = self._state()
        hole, now = hole_of(present)
        bit = int(now[BIT])
        if self._physics is None or bit - self._first >= BITS - 2:
            self._physics, self._first = physics_of(self._task, hole), bit
            if self._plans:
                self._value = solve(self._physics, self._settings, bit, self._changes)
        actions = self._shortlist(self._physics, now, bit)
        return actions[int(np.argmin(self._try(self._physics, present, actions)))]

    def _shortlist(self, ph: Physics, now: np.ndarray, bit: int) -> np.ndarray:
        """(tried, 4) the actions that the plan likes best, and as many that change the bit, where that is allowed."""
        k, depth = bit - self._first, float(now[DEPTH])
        rest = ((k, bit, now[WEAR], now[RISE]), (k + 1, bit + 1, 0.0, self._cooled(ph, now[RISE])))
        actions = []
        for (row, number, wear, rise), change in zip(rest, (KEEP, CHANGE)[: 1 + self._changes], strict=False):
            state = depth, float(wear), float(rise), STEP, self._wear_price
            costs = rate_settings(ph, self._value, self._settings, row, number, *state)
            best = np.argsort(costs)[: self._tried]
            chosen = self._actions[best].copy()
            chosen[:, 3] = change
            actions.append(chosen)
        return np.concatenate(actions)

    @staticmethod
    def _cooled(ph: Physics, rise: float) -> float:
        return shaker.rise_after(float(rise), 0.0, float(ph.costs[CHANGE_TIME]))

    def _try(self, ph: Physics, present: EnvState, actions: np.ndarray) -> np.ndarray:
        """What each action costs: one step of a copy of the plant, and then as the plan says."""
        batch = self._batch
        for i in range(batch.n):
            batch.restore(i, present.rig)
        batch.step(np.ones(batch.n, dtype=bool), actions, False, self._silence)
        states = batch.holes.states
        if not self._plans:
            before = np.where(actions[:, 3] > 0.0, 0.0, present.rig.arrays[-4][WEAR])
            return self._wear_price * np.maximum(states[:, WEAR] - before, 0.0) - batch.rewards
        costs = states[:, STEP_SPENT].copy()
        for i in np.flatnonzero(states[:, DEPTH] < states[:, TARGET]).tolist():
            row = states[i]
            k = int(row[BIT]) - self._first
            costs[i] += cost_to_go(ph, self._value, k, float(row[DEPTH]), float(row[WEAR]), float(row[RISE]))
        return costs


class Greedy(HoleOracle):
    """Knows as much as :class:`HoleOracle`, and takes what earns most in the coming step alone.

    Wear counts by the share of a bit and its change that it uses up, or it would grind bits away.

    Args:
        task: What is drilled for.
        wear_share: Factor on that price of wear.
        metre: What a metre is worth to it, in EUR; what it is paid with where left out. The higher, the more it
            hurries.
    """

    _plans = False

    def __init__(self, task: HoleTask | None = None, wear_share: float = 1.0, metre: float | None = None):
        own = copy(task or HoleTask())
        if metre is not None:
            own.costs = replace(own.costs, metre=metre)
        super().__init__(own)
        self._wear_price = wear_share * self._task.costs.of_change
