"""PPO whose advantages are measured: what an action earns on a copy of the rig beyond what its opposite would.

An estimate by a critic also holds the rocks of the coming second, which nobody can know, and its own error, so that
an action has to differ by much to be told from others. Here two copies of each rig drill for a few intervals from the
same present, over the same rock and with the same noise of the sensors. The first begins with the action, the second
with its mirror image about the mean of the policy's distribution; then both go on with the mean. What is left in their
difference is the action (the "vine" of Schulman et al., Trust Region Policy Optimization, ICML 2015, section 5.2).
The mirror image and not the mean, for near the best action most others earn less than the mean, on either side alike:
that says nothing of where to go, and cancels. Only training needs copies of a rig; the policy sees the readings alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from drillenv.controllers.policies import actions_of
from drillenv.env.batch import Batch
from drillenv.env.observation import SIZE
from drillenv.training.scaling import scaled

if TYPE_CHECKING:
    from drillenv.training.sb3 import DrillVecEnv


class Branches(VecEnvWrapper):
    """Measures the actions before each step.

    Args:
        stacked: Scaled observations, the last ones side by side.
        rigs: The rigs below.
        ahead: Intervals that the copies drill.
        seed: Of the noise that the copies see.

    Attributes:
        model: Whose policy goes on with the copies.
        measured: (n,) of each step since :meth:`begin`, in mm/s summed over the intervals.
    """

    def __init__(self, stacked: VecFrameStack, rigs: DrillVecEnv, ahead: int, seed: int):
        super().__init__(stacked)
        self.stacked = stacked
        self._rigs = rigs.rigs._batch
        self._copies = Batch(self._rigs.task, 2 * rigs.num_envs, 0, self._rigs.threads)
        self._ahead, self._first = ahead, seed
        self.measured: list[np.ndarray] = []

    def begin(self, model: PPO) -> None:
        """Start an update of a model."""
        self.model = model
        self.measured.clear()

    def step_async(self, actions: np.ndarray) -> None:
        """Measure the outputs (n, 3) of the policy, then take them."""
        self.measured.append(self._measure(actions))
        self.venv.step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Drill for one interval."""
        return self.venv.step_wait()

    def reset(self) -> Any:
        """Start an episode with every rig."""
        return self.venv.reset()

    def _measure(self, outputs: np.ndarray) -> np.ndarray:
        """(n,) half of what the copies that begin with these outputs earn beyond those that begin with the opposite."""
        n, copies = self.num_envs, self._copies
        for i in range(n):
            present = self._rigs.snapshot(i)
            copies.restore(i, present)
            copies.restore(n + i, present)
        seen = np.tile(self.stacked.stacked_obs.stacked_obs, (2, 1))
        chosen = np.vstack([outputs, 2.0 * self._mean(seen[:n]) - outputs])
        # by the steps done, so that a run that was resumed draws what it would have drawn
        rng = np.random.default_rng((self._first, self.model.num_timesteps))
        earned, everywhere = np.zeros(2 * n), np.ones(2 * n, dtype=bool)
        for k in range(self._ahead):
            noise = np.tile(rng.standard_normal((n, SIZE)), (2, 1))
            copies.step(everywhere, actions_of(chosen), False, noise)
            earned += copies.rewards
            if k < self._ahead - 1:
                seen = np.hstack([seen[:, SIZE:], scaled(copies.readings)])
                chosen = self._mean(seen)
        return 0.5 * (earned[:n] - earned[n:])

    def _mean(self, seen: np.ndarray) -> np.ndarray:
        """(m, 3) the mean outputs for stacked observations (m, ...)."""
        with torch.no_grad():
            return self.model.policy.get_distribution(torch.from_numpy(seen)).mode().numpy()


class BranchedPPO(PPO):
    """PPO on :class:`Branches`, by what they measure. Its critic is not used, and not trained (``vf_coef`` 0)."""

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """As PPO does, with other advantages."""
        assert isinstance(env, Branches)
        env.begin(self)
        going = super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        rollout_buffer.advantages[:] = np.array(env.measured)
        return going
