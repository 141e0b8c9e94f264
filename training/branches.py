"""PPO whose advantages are measured: what an action earns on a copy of the rig beyond what its opposite would.

An estimate by a critic also holds the rocks of the coming second, which nobody can know, and its own error, so that
an action has to differ by much to be told from others. Here two copies of each rig drill for a few intervals from the
same present, over the same rock and with the same noise of the sensors. The first begins with the action, the second
with its mirror image about the mean of the policy's distribution; then both go on with the mean. What is left in their
difference is the action (the "vine" of Schulman et al., Trust Region Policy Optimization, ICML 2015, section 5.2).
The mirror image and not the mean, for near the best action most others earn less than the mean, on either side alike:
that says nothing of where to go, and cancels. Only training needs copies of a rig; the policy sees the readings alone.

A hole has a horizon: what wears a bit now costs later. There a critic says what both copies are worth at the end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from drillenv.controllers.hole import learned as hole
from drillenv.controllers.hole.belief import Belief
from drillenv.controllers.policies import actions_of
from drillenv.env.batch import Batch
from drillenv.env.hole.batch import HoleBatch
from drillenv.env.hole.readings import SIZE as HOLE_READINGS
from drillenv.env.hole.task import HoleTask
from drillenv.env.observation import SIZE
from drillenv.training.believing import WORTH, Believing
from drillenv.training.scaling import scaled

if TYPE_CHECKING:
    from drillenv.training.sb3 import DrillVecEnv


class Copies(Protocol):
    """Two copies of each of n rigs: first all that begin with the actions, then all that begin with the opposite.

    Attributes:
        noise_size: Numbers of noise that a step of a rig takes.
        discount: Of a step.
        bootstraps: Whether a critic says what the copies are worth at the end.
        rewards: (2 n,) of the last step.
        running: (2 n,) bool, whether the episode of each has not ended.
    """

    noise_size: int
    discount: float
    bootstraps: bool
    rewards: np.ndarray
    running: np.ndarray

    def begin(self) -> np.ndarray:
        """Put the copies where the rigs are; what a policy sees of them, (2 n, ...)."""
        ...

    def step(self, outputs: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Drill for one interval at what outputs (2 n, ...) ask for; what a policy sees then."""
        ...


class RockCopies:
    """Copies of prepared rigs on rock, see :class:`Copies`.

    Args:
        stacked: Scaled observations, the last ones side by side.
        rigs: The rigs below.
    """

    noise_size, discount, bootstraps = SIZE, 1.0, False

    def __init__(self, stacked: VecFrameStack, rigs: DrillVecEnv):
        self._stacked, self._rigs = stacked, rigs.rigs._batch
        self._copies = Batch(self._rigs.task, 2 * rigs.num_envs, 0, self._rigs.threads)
        self.rewards = self._copies.rewards
        self.running = np.ones(2 * rigs.num_envs, dtype=bool)

    def begin(self) -> np.ndarray:
        """See :class:`Copies`."""
        copy_twice(self._rigs, self._copies)
        self._seen = np.tile(self._stacked.stacked_obs.stacked_obs, (2, 1))
        return self._seen

    def step(self, outputs: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """See :class:`Copies`."""
        self._copies.step(self.running, actions_of(outputs), False, noise)
        self._seen = np.hstack([self._seen[:, SIZE:], scaled(self._copies.readings)])
        return self._seen


class HoleCopies:
    """Copies of rigs that drill holes by what can be known of them, see :class:`Copies`.

    Args:
        believing: What remembers of each hole what can be known of it.
        rigs: The rigs below.
        discount: Of a step.
    """

    noise_size, bootstraps = HOLE_READINGS, True

    def __init__(self, believing: Believing, rigs: DrillVecEnv, discount: float):
        self._believing, self._rigs, self.discount = believing, rigs.rigs._batch, discount
        assert isinstance(self._rigs.task, HoleTask)
        self._copies = HoleBatch(self._rigs.task, 2 * rigs.num_envs, self._rigs.threads)
        self._belief = Belief(2 * rigs.num_envs)
        self.rewards = np.zeros(2 * rigs.num_envs)
        self.running = np.ones(2 * rigs.num_envs, dtype=bool)

    def begin(self) -> np.ndarray:
        """See :class:`Copies`."""
        copy_twice(self._rigs, self._copies)
        present = self._believing.belief.arrays
        for name, remembered in self._belief.arrays.items():
            remembered[:] = np.concatenate([present[name], present[name]])
        self.running = ~self._copies.terminated
        self._known = np.tile(self._believing.known, (2, 1))
        return self._known

    def step(self, outputs: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """See :class:`Copies`."""
        self._copies.step(self.running, hole.actions_of(outputs, self._known), False, noise)
        self.rewards = WORTH * np.where(self.running, self._copies.rewards, 0.0)
        self.running = self.running & ~self._copies.terminated
        self._known = self._belief.of(self._copies.readings)
        return self._known


def copy_twice(rigs: Batch, copies: Batch) -> None:
    """Put two copies of each of n rigs where it is: number i and number n + i."""
    for i in range(rigs.n):
        present = rigs.snapshot(i)
        copies.restore(i, present)
        copies.restore(rigs.n + i, present)


class Branches(VecEnvWrapper):
    """Measures the actions before each step.

    Args:
        seen: What the policy sees of the rigs.
        copies: Of the rigs.
        ahead: Intervals that the copies drill.
        seed: Of the noise that the copies see.

    Attributes:
        model: Whose policy goes on with the copies.
        measured: (n,) of each step since :meth:`begin`, summed over the intervals: in mm/s on rock, in WORTH EUR of a
            hole.
    """

    def __init__(self, seen: VecEnv, copies: Copies, ahead: int, seed: int):
        super().__init__(seen)
        self._copies, self._ahead, self._first = copies, ahead, seed
        self.measured: list[np.ndarray] = []

    def begin(self, model: PPO) -> None:
        """Start an update of a model."""
        self.model = model
        self.measured.clear()

    def step_async(self, actions: np.ndarray) -> None:
        """Measure the outputs (n, ...) of the policy, then take them."""
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
        seen = copies.begin()
        chosen = np.vstack([outputs, 2.0 * self._mean(seen[:n]) - outputs])
        # by the steps done, so that a run that was resumed draws what it would have drawn
        rng = np.random.default_rng((self._first, self.model.num_timesteps))
        earned, discount = np.zeros(2 * n), 1.0
        for k in range(self._ahead):
            seen = copies.step(chosen, np.tile(rng.standard_normal((n, copies.noise_size)), (2, 1)))
            earned += discount * copies.rewards
            discount *= copies.discount
            if k < self._ahead - 1:
                chosen = self._mean(seen)
        if copies.bootstraps:
            earned += discount * np.where(copies.running, self._value(seen), 0.0)
        return 0.5 * (earned[:n] - earned[n:])

    def _mean(self, seen: np.ndarray) -> np.ndarray:
        """(m, ...) the mean outputs for what is seen (m, ...)."""
        with torch.no_grad():
            return self.model.policy.get_distribution(torch.from_numpy(seen)).mode().numpy()

    def _value(self, seen: np.ndarray) -> np.ndarray:
        """(m,) what the critic says of what is seen (m, ...)."""
        with torch.no_grad():
            return self.model.policy.predict_values(torch.from_numpy(seen)).numpy().ravel().astype(float)


class BranchedPPO(PPO):
    """PPO on :class:`Branches`, by what they measure.

    Its critic says what copies of holes are worth at the end; on rock it is not used, and not trained (``vf_coef`` 0).
    """

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """As PPO does, with other advantages."""
        assert isinstance(env, Branches)
        env.begin(self)
        going = super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        rollout_buffer.advantages[:] = np.array(env.measured)
        return going
