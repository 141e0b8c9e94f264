"""A budget of force above the rating, kept to by a multiplier: rewards less what that force costs at it.

It is the Lagrange multiplier of a constrained Markov decision process (E. Altman, Constrained Markov Decision
Processes, 1999), in the place that a penalty of fixed weight has otherwise. Dual ascent finds it: after each rollout it
moves by what the mean cost of a step is above the limit, and never below 0. Alone that overshoots, for a policy takes
dozens of updates to follow; so a part of the multiplier goes by the last rollout alone (A. Stooke, J. Achiam and
P. Abbeel, Responsive Safety in Reinforcement Learning by PID Lagrangian Methods, ICML 2020; here without the D).

PPO learns from the rewards so priced, with one critic, as in C. Tessler, D. J. Mankowitz and S. Mannor, Reward
Constrained Policy Optimization, ICLR 2019. A. Ray, J. Achiam and D. Amodei, Benchmarking Safe Exploration in Deep
Reinforcement Learning, 2019, have a second critic, of the cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

KN = 1e-3
"""kN of 1 N: the multiplier is in mm/s for 1 kN, as the weight ``force`` of a reward is."""


class Priced(VecEnvWrapper):
    """Takes the price of the force above the rating off the rewards.

    Args:
        venv: Rigs that say ``cost``, the force above the rating in N, in the info of each step.
        limit: Mean cost of a step that is allowed, in N.
        rate: By how much the multiplier moves after a rollout for each N above or below the limit, in mm/s a kN.
        gain: By how much more it is during the next rollout only, for each N likewise.

    Attributes:
        ascended: What the multiplier has moved to, without the part by the last rollout alone, in mm/s a kN.
        cost: Mean cost of a step of the last rollout, noise on the actions included, in N; None before its end.
    """

    def __init__(self, venv: VecEnv, limit: float, rate: float, gain: float):
        super().__init__(venv)
        self.limit, self.rate, self.gain = limit, rate, gain
        self.ascended = 0.0
        self.cost: float | None = None
        self._costs: list[float] = []

    @property
    def multiplier(self) -> float:
        """What 1 kN above the rating costs, in mm/s."""
        if self.cost is None:
            return self.ascended
        return max(0.0, self.ascended + self.gain * (self.cost - self.limit))

    def reset(self) -> VecEnvObs:
        """Start an episode with every rig."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Drill for one interval."""
        observations, rewards, dones, infos = self.venv.step_wait()
        costs = np.array([info["cost"] for info in infos])
        self._costs.append(float(costs.mean()))
        return observations, rewards - np.float32(KN * self.multiplier) * costs.astype(np.float32), dones, infos

    def ascend(self) -> None:
        """Move the multiplier by the steps since the last time; to be called between a rollout and the next."""
        self.cost = float(np.mean(self._costs))
        self._costs.clear()
        self.ascended = max(0.0, self.ascended + self.rate * (self.cost - self.limit))

    def state(self) -> dict[str, float | None]:
        """What :meth:`go_on` goes on from, as JSON takes it; to be called between a rollout and the next."""
        return {"ascended": self.ascended, "cost": self.cost}

    def go_on(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.ascended, self.cost = state["ascended"], state["cost"]
        self._costs.clear()

    def as_record(self) -> dict[str, float | None]:
        """What the result of a run says of the budget."""
        return {"cost_limit": self.limit, "rollout_cost": self.cost, "multiplier": self.multiplier}
