"""Stable-Baselines3's vector environment on the native one: every rig in one call of the batch kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from drillenv.checks import InputError, choice, count, shown
from drillenv.env.core import TERMS
from drillenv.env.registration import HOLE_IDS, IDS
from drillenv.env.truth import TRUTH
from drillenv.env.vector import DrillVectorEnv

INFO_KEYS = (*TRUTH, "motion", *TERMS, "cost")
"""All that the info of a step holds."""
SHARED = ("render_mode", "spec", "task", "max_episode_steps")
"""Attributes that are the same for every rig."""
OF_EACH = ("np_random", "np_random_seed")
"""Attributes that every rig has for itself."""
SPACES = ("observation_space", "action_space")


class DrillVecEnv(VecEnv):
    """n rigs for the algorithms of Stable-Baselines3, with the numbers of its DummyVecEnv around n scalar environments.

    A rig that is done starts its next episode within the same step: the observation is then that episode's first, and
    ``infos[i]["terminal_observation"]`` the last of the one that ended. ``infos[i]["TimeLimit.truncated"]`` says
    whether the time limit cut it off, the only end that episodes without a bottom have, so that algorithms bootstrap
    there.
    Wrap it in VecMonitor for the statistics of episodes.

    Args:
        id: One of the environments, such as "drillenv/DrillLayers-v0".
        num_envs: Number of rigs.
        info_keys: What of a step's info to pass on, of :data:`INFO_KEYS`.
        threads: Number of threads, by default as many as cores are allowed.
        arguments: Those of the environment, and max_episode_steps, by default that of the registration.

    Raises:
        InputError: an argument is not what it should be.
    """

    def __init__(
        self,
        id: str,
        num_envs: int = 1,
        info_keys: Sequence[str] = (),
        threads: int | None = None,
        **arguments: Any,
    ):
        if isinstance(info_keys, str) or not isinstance(info_keys, Sequence):
            raise InputError(f"info_keys is {shown(info_keys)}: give a list of names, such as ['cost', 'motion']")
        self.info_keys: tuple[str, ...] = tuple(choice("info key", key, INFO_KEYS) for key in info_keys)
        made = gym.make_vec(
            choice("id", id, (*IDS, *HOLE_IDS)),
            count("num_envs", num_envs, 1, 1_000_000),
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP.value,
            threads=threads,
            **arguments,
        )
        assert isinstance(made, DrillVectorEnv)
        self.rigs = made
        self._actions = np.zeros(made.action_space.shape or (), dtype=np.float32)
        super().__init__(made.num_envs, made.single_observation_space, made.single_action_space)

    @property
    def spec(self) -> Any:
        """What the native environment was made from; VecMonitor writes its id into its file."""
        return self.rigs.spec

    def reset(self) -> np.ndarray:
        """Start an episode with every rig, with the seeds and options that were set. Returns observations (n, ...).

        Raises:
            InputError: the options are not what the environment takes.
        """
        observations, infos = self.rigs.reset(seed=self._seeds, options=self._options_of_all())
        self.reset_infos: list[dict[str, Any]] = self._rows(infos)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (n, 3) or (n, 4), each number from -1 to 1, for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Drill for one interval.

        Returns:
            Observations (n, ...), rewards (n,) float32 in mm/s or EUR, which rigs are done (n,), and the infos.

        Raises:
            InputError: actions of another shape, not finite or outside [-1, 1]; all rigs are left as they were.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        observations, rewards, terminations, truncations, infos = self.rigs.step(self._actions)
        dones = terminations | truncations
        rows = self._rows(infos)
        if dones.any():
            last = self._rows(infos["final_info"])
            for i in np.flatnonzero(dones).tolist():
                self.reset_infos[i], rows[i] = rows[i], last[i]
                rows[i]["terminal_observation"] = infos["final_obs"][i]
        for row, cut_off in zip(rows, (truncations & ~terminations).tolist(), strict=True):
            row["TimeLimit.truncated"] = cut_off
        return observations, rewards.astype(np.float32), dones, rows

    def close(self) -> None:
        """Let the threads go. May be called twice."""
        self.rigs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each rig: of SHARED, OF_EACH or SPACES.

        Raises:
            AttributeError: no such attribute.
        """
        chosen = self._chosen(indices)
        if attr_name in OF_EACH:
            values = getattr(self.rigs, attr_name)
            return [values[i] for i in chosen]
        if attr_name in SPACES:
            return [getattr(self.rigs, f"single_{attr_name}")] * len(chosen)
        if attr_name in SHARED:
            return [getattr(self.rigs, attr_name)] * len(chosen)
        raise AttributeError(f"a rig has no attribute {attr_name!r}: it has {', '.join((*SHARED, *OF_EACH, *SPACES))}")

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Always refused: the rigs share one batch and one task.

        Raises:
            AttributeError: always.
        """
        raise AttributeError(f"{attr_name} cannot be set on rigs that share a batch: make another DrillVecEnv with it")

    def env_method(self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any):
        """Call ``get_state()`` or ``set_state(state)`` of each rig. Returns what they return.

        Raises:
            AttributeError: another method.
            InputError: no state, or that of an environment built otherwise.
        """
        chosen = self._chosen(indices)
        if method_name == "get_state":
            return [self.rigs.get_state(i, *method_args, **method_kwargs) for i in chosen]
        if method_name == "set_state":
            return [self.rigs.set_state(*method_args, which=[i], **method_kwargs) for i in chosen]
        raise AttributeError(f"a rig has no method {method_name!r} to call: it has get_state and set_state")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Whether each rig is wrapped so: never, since there are no environments of their own to wrap."""
        return [False] * len(self._chosen(indices))

    def get_images(self) -> list[np.ndarray | None]:
        """None for each rig: a batch is not drawn."""
        return [None] * self.num_envs

    def _chosen(self, indices: VecEnvIndices) -> list[int]:
        """The rigs meant."""
        if indices is None:
            return list(range(self.num_envs))
        given = [indices] if isinstance(indices, int | np.integer) else indices
        return [count("rig", i, 0, self.num_envs - 1) for i in given]

    def _options_of_all(self) -> dict[str, Any]:
        """The options of each rig as the native environment takes them."""
        if len(self._options) != self.num_envs or not all(isinstance(each, dict) for each in self._options):
            raise InputError(
                f"options is {shown(self._options)}: give a record, or one for each of {self.num_envs} rigs"
            )
        for key in {key for each in self._options for key in each}:
            choice("option", key, ("episode",))
        episodes = [each.get("episode") for each in self._options]
        return {"episode": episodes} if any(self._options) else {}

    def _rows(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """The infos asked for, a dictionary for each rig."""
        if not self.info_keys:
            return [{} for _ in range(self.num_envs)]
        columns = [infos[key].tolist() for key in self.info_keys]
        return [dict(zip(self.info_keys, row, strict=True)) for row in zip(*columns, strict=True)]
