"""Model predictive control by sampling: many futures of the plant itself, computed from one present; the best is begun.

A plan is three numbers: the amplitude now, and the amplitude and the pressure over amplitude to end at. The valve is
moved so that the pressure gets to its goal as soon as the cylinder lets it, and the amplitude goes to its goal in step
with the pressure. Each decision draws a few such plans about the last one and about what is best in the steady state,
runs all of them through the kernel of the environment, draws once more about the best ones (the cross-entropy method),
and starts the best. What it is best by is the environment's own reward.

:class:`Oracle` plans on the true plant and is what other controllers are measured by, :class:`Mpc` on a nominal plant
put where the readings say that the real one is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import InputError, count
from drillenv.controllers.belief import Belief
from drillenv.controllers.chart import FREQUENCY, RATIOS, read_chart
from drillenv.controllers.steady import best_setting
from drillenv.env import plant
from drillenv.env.batch import Batch, Snapshot
from drillenv.env.observation import SIZE
from drillenv.env.plant import INTERVAL, Plants
from drillenv.env.reward import Reward
from drillenv.env.scalar import EnvState
from drillenv.env.task import RANGES, Task

WIDE = np.array([0.03, 0.03, 0.08])
"""First spread of plans about the best known, in the logarithms of amplitude, ratio and amplitude now."""
NARROW = np.array([0.006, 0.01, 0.02])
"""Least spread of the second round."""
ELITE = 5
LAST = 2.0
"""Weight of the last interval of a plan: what comes after it is like it."""
MARGINS = (0.98, 0.94, 0.88, 0.75)
"""Shares of the boundary of P-1-I-1 at which the plans that do not depend on the last decision end."""


class Present(NamedTuple):
    """Where plans start."""

    rig: Snapshot
    """The plant."""
    rock: tuple[float, float]
    """Loading and unloading stiffness in N/m."""
    pressure: float
    """bar."""
    lag: float
    """s."""


class Planner:
    """Plans from a present.

    Args:
        reward: What to plan for.
        candidates: Plans tried in a round.
        rounds: Rounds of a decision.
        horizon: Intervals of a plan.
    """

    def __init__(self, reward: Reward, candidates: int, rounds: int, horizon: int):
        self._reward = reward
        self._n = count("candidates", candidates, 8, 10_000)
        self._rounds = count("rounds", rounds, 1, 100)
        self._horizon = count("horizon", horizon, 2, 100)
        self._batch = Batch(Task(kind="layers", reward=reward.as_record()), self._n, 0, threads=1)
        self._everywhere, self._silence = np.ones(self._n, dtype=bool), np.zeros((self._n, SIZE))
        self.forget()

    def forget(self) -> None:
        """Forget the last plan."""
        self._last: np.ndarray | None = None

    def decide(self, present: Present, rng: np.random.Generator, more: np.ndarray | None = None) -> np.ndarray:
        """(3,) float32 the first action of the best plan found; ``more`` (m, 3) are plans to be tried too."""
        plans = self._first_plans(present, rng, more)
        best, most = plans[0], -math.inf
        action, following = np.zeros(3, dtype=np.float32), best
        for turn in range(self._rounds):
            actions, amplitudes = self._actions(plans, present)
            earned = self._run(present.rig, actions)
            order = np.argsort(-earned)
            top = order[0]
            if earned[top] > most:
                best, most = plans[top], earned[top]
                action = actions[top, 0].copy()
                following = np.array([best[0], best[1], math.log(amplitudes[top, 1])])
            if turn < self._rounds - 1:
                elite = plans[order[:ELITE]]
                spread = np.maximum(elite.std(axis=0), NARROW)
                centres = np.where(np.arange(self._n)[:, None] % 2 == 0, best, 0.5 * (best + elite.mean(axis=0)))
                plans = centres + spread * rng.standard_normal((self._n, 3))
        self._last = following
        return action

    def _first_plans(self, present: Present, rng: np.random.Generator, more: np.ndarray | None = None) -> np.ndarray:
        """(n, 3) logarithms: the last plan gone on with, the steady bests, and others about the first of these."""
        known = steady_plans(present, self._reward.rating)
        if more is not None:
            known = np.vstack([known, more])
        # the last plan first: what is in hand goes on unless something is better
        plans = known if self._last is None else np.vstack([self._last, known])
        others = plans[0] + WIDE * rng.standard_normal((max(0, self._n - len(plans)), 3))
        return np.vstack([plans, others])[: self._n]

    def _actions(self, plans: np.ndarray, present: Present) -> tuple[np.ndarray, np.ndarray]:
        """The actions (n, horizon, 3) float32 of plans, and their amplitudes (n, horizon) in V."""
        low, high = RANGES[:, 0], RANGES[:, 1]
        goal_amplitude, ratio, now = np.exp(plans).T
        goal_amplitude, now = np.clip(goal_amplitude, low[1], high[1]), np.clip(now, low[1], high[1])
        goal = np.clip(goal_amplitude * ratio, low[2], high[2])
        fall = math.exp(-INTERVAL / present.lag)
        start = present.pressure
        way = np.where(np.abs(start - goal) > 0.02, start - goal, np.inf)
        pressure = np.full(len(plans), start)
        settings = np.empty((len(plans), self._horizon, 3))
        for k in range(self._horizon):
            valve = np.clip((goal - pressure * fall) / (1.0 - fall), low[2], high[2])
            left = np.clip((pressure - goal) / way, 0.0, 1.0) if k else 1.0
            settings[:, k, 0] = FREQUENCY
            settings[:, k, 1] = goal_amplitude + (now - goal_amplitude) * left
            settings[:, k, 2] = valve
            pressure = valve + (pressure - valve) * fall
        actions = (settings - RANGES.mean(axis=1)) / (0.5 * (high - low))
        return np.clip(actions, -1.0, 1.0).astype(np.float32), settings[:, :, 1]

    def _run(self, rig: Snapshot, actions: np.ndarray) -> np.ndarray:
        """What each plan earns (n,)."""
        batch = self._batch
        for j in range(self._n):
            batch.restore(j, rig)
        earned = np.zeros(self._n)
        for k in range(self._horizon):
            batch.step(self._everywhere, np.ascontiguousarray(actions[:, k]), False, self._silence)
            earned += batch.rewards * (LAST if k == self._horizon - 1 else 1.0)
        return earned


def steady_plans(present: Present, rating: float) -> np.ndarray:
    """(m, 3) plans that end where settled single blows have the rating, for what the chart says of the rock."""
    chart = read_chart()
    rock = np.array([present.rock[0]]), np.array([present.rock[1] / present.rock[0]])
    peaks = chart.features_of(*rock)[1, :, 0]
    end = float(chart.boundary_of(*rock)[0])
    low, high = RANGES[1]
    plans = []
    for share in MARGINS:
        ratio = share * end
        amplitude = float(np.clip(rating / np.interp(ratio, RATIOS, peaks), low, high))
        along = float(np.clip(present.pressure / ratio, low, high))
        plans += [(amplitude, ratio, along), (amplitude, ratio, amplitude)]
    plans += [(plans[0][0], plans[0][1], edge) for edge in (low, high)]
    return np.log(np.array(plans))


class Oracle:
    """Knows the rock under the indenter and the exact state of the plant, and plans on both: the yardstick.

    Among its plans is the setting that earns most on this rock in the steady state, whatever the motion there: on rock
    beyond Table 2.2 that is not always P-1-I-1. It does not know what rock comes next, nor when. Where an episode has
    an effect that the paper leaves out (``DrillHidden``), it plans on the true constants without that effect, and is
    no upper bound there.

    It has to be given the plant: :meth:`attach` it before the episode.

    Args:
        reward: What to plan for.
        candidates, rounds, horizon: See :class:`Planner`.
    """

    sees_truth = True

    def __init__(self, reward: Reward | None = None, candidates: int = 18, rounds: int = 2, horizon: int = 6):
        self._reward = reward or Reward()
        self._planner = Planner(self._reward, candidates, rounds, horizon)
        self._state: Callable[[], EnvState] | None = None
        self.reset()

    def attach(self, state: Callable[[], EnvState]) -> None:
        """Take the plant of the coming episodes.

        Args:
            state: Gives its present state: ``env.unwrapped.get_state``, or ``partial(envs.get_state, i)`` of rig i.
        """
        self._state = state

    def reset(self, seed: int | None = None) -> None:
        """Start the draws of a seed."""
        self._rng = np.random.default_rng(seed)
        self._planner.forget()
        self._rock: tuple[float, float] | None = None

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting.

        Raises:
            InputError: not attached to a plant.
        """
        if self._state is None:
            raise InputError("the oracle has no plant to plan on: attach(env.unwrapped.get_state) before the episode")
        present = true_present(self._state().rig)
        if present.rock != self._rock:
            self._planner.forget()
            self._rock = present.rock
        return self._planner.decide(present, self._rng, self._best_plans(present))

    def _best_plans(self, present: Present) -> np.ndarray:
        """(2, 3) plans that end at the best setting of the steady state."""
        _, amplitude, pressure = best_setting(*present.rock, self._reward)
        along = float(np.clip(present.pressure * amplitude / pressure, *RANGES[1]))
        return np.log([(amplitude, pressure / amplitude, along), (amplitude, pressure / amplitude, amplitude)])


def true_present(rig: Snapshot) -> Present:
    """The present of a plant, with nothing but the present rock below."""
    parts = Plants(*(part.copy() for part in rig.arrays))
    layer = int(parts.memories[plant.LAYER])
    parts.layers[layer:] = parts.layers[layer]
    parts.layers[layer:, plant.LAYER_END] = math.inf
    rock = float(parts.layers[layer, plant.LAYER_KL]), float(parts.layers[layer, plant.LAYER_KU])
    pressure, lag = float(parts.memories[plant.PRESSURE]), float(parts.memories[plant.LAG])
    return Present(replace(rig, arrays=tuple(parts), hybrid=None), rock, pressure, lag)


class Mpc:
    """Plans on what is believed: the most central of a crowd of nominal plants, see :mod:`drillenv.controllers.belief`.

    It sees the readings only. Its plants are those of Table 2.1 without effects, on rocks like those of Table 2.2 or,
    less likely, any other.

    Args:
        reward: What to plan for.
        candidates, rounds, horizon: See :class:`Planner`.
    """

    sees_truth = False

    def __init__(self, reward: Reward | None = None, candidates: int = 16, rounds: int = 2, horizon: int = 6):
        self._planner = Planner(reward or Reward(), candidates, rounds, horizon)
        self._belief = Belief()
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the rock, and start the draws of a seed."""
        self._rng = np.random.default_rng(seed)
        self._planner.forget()
        self._belief.reset(self._rng)

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next setting."""
        belief = self._belief
        belief.update(observation)
        present = Present(*belief.central(), belief.cylinder.pressure, belief.cylinder.lag)
        return self._planner.decide(present, self._rng)
