"""From readings of a hole to what can be known of it, and from outputs of a policy to actions."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from drillenv.controllers.hole.belief import SIZE, Belief
from drillenv.controllers.hole.learned import actions_of
from drillenv.env.hole.costs import WELL_DRILLED

BEGIN = (0.4, 0.0, -0.3, 0.0)
"""Outputs of the untrained policy: 99 Hz, 0.45 V, careful pressure, and a new bit at the wear that is usual."""
NOISE = (-1.2, -1.2, -1.2, -3.0)
"""Logarithms of the standard deviations of the outputs at the start; they are learned. That of the last is small: noise
on the wear at which a bit is changed, drawn anew at each step, changes bits far too early, whereupon training learns to
change them later, and the policy without noise breaks them."""
SLOWEST = 0.05
"""Share of the learning rate that is left after the annealing."""
METRE = WELL_DRILLED
"""EUR that a metre is worth in training: about what it costs. The best way to a given depth is the same at any price,
but a discount makes waiting the dearer the more is still to be earned: at 600 EUR and gamma 0.995 a step costs ten
times what the rig does, and no bit is ever changed."""
WORTH = 0.05
"""Factor on the rewards, for the critic."""


class Believing(VecEnvWrapper):
    """Turns readings into what is known of each hole, and outputs of a policy into actions.

    Args:
        venv: Holes to drill.
    """

    def __init__(self, venv: VecEnv):
        super().__init__(venv, gym.spaces.Box(-np.inf, np.inf, (SIZE,), dtype=np.float32))
        self.belief = Belief(venv.num_envs)
        self.known = np.zeros((venv.num_envs, SIZE), dtype=np.float32)

    def reset(self) -> np.ndarray:
        """Start a hole with every rig."""
        self.belief = Belief(self.num_envs)
        readings = self.venv.reset()
        assert isinstance(readings, np.ndarray)
        self.known = self.belief.of(readings)
        return self.known

    def step_async(self, actions: np.ndarray) -> None:
        """Take the outputs of the policy, (n, 4)."""
        self.venv.step_async(actions_of(actions, self.known))

    def step_wait(self) -> VecEnvStepReturn:
        """Drill for one step."""
        readings, rewards, dones, infos = self.venv.step_wait()
        assert isinstance(readings, np.ndarray)
        over = np.flatnonzero(dones)
        last = readings.copy()
        for i in over.tolist():
            last[i] = infos[i]["terminal_observation"]
        known = self.belief.of(last)
        for i in over.tolist():
            infos[i]["terminal_observation"] = known[i].copy()
        if over.size:
            self.belief.forget(over)
            known[over] = self.belief.of(readings[over], over)
        self.known = known
        return known, rewards * np.float32(WORTH), dones, infos
