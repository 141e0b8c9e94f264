"""The native vector environment: many rigs stepped by one call of the batch kernel, on all cores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from drillenv.checks import InputError, count, shown
from drillenv.dynamics.survey import allowed_cores
from drillenv.env import observation as table
from drillenv.env.core import checked_actions, window_observation
from drillenv.env.scalar import EnvState
from drillenv.env.task import Task


class DrillVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """n drilling rigs at once; each is the environment :class:`drillenv.env.scalar.DrillEnv`, to the last bit.

    Args:
        num_envs: Number of rigs.
        max_episode_steps: Steps after which an episode is truncated; None for never.
        autoreset_mode: "NextStep" (a rig that is done is reset by the following step, whose action it ignores),
            "SameStep" (it is reset at once; the last observation and info are ``infos["final_obs"]`` and
            ``infos["final_info"]``) or "Disabled" (reset it with ``options={"reset_mask": ...}``).
        threads: Number of threads, by default as many as cores are allowed.
        render_mode: Must be None: render one rig of DrillEnv instead.
        task: The arguments of DrillEnv: kind, rock, scenario, model, reward, actions, observations, noise,
            errors.

    Raises:
        InputError: an argument is not what it should be.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.NEXT_STEP,
        "render_modes": [],
    }

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        **task: Any,
    ):
        self.num_envs: int = count("num_envs", num_envs, 1, 1_000_000)
        if max_episode_steps is not None:
            max_episode_steps = count("max_episode_steps", max_episode_steps, 1, 2**31)
        if render_mode is not None:
            raise InputError(f"render_mode is {shown(render_mode)}: a batch is not drawn; render one rig of DrillEnv")
        try:
            self.autoreset_mode: AutoresetMode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(mode.value for mode in AutoresetMode)
            raise InputError(f"autoreset_mode is {shown(autoreset_mode)}: give one of {modes}") from None
        self.metadata = type(self).metadata | {"autoreset_mode": self.autoreset_mode}
        self.max_episode_steps = max_episode_steps
        self.task: Task = self._task(task)
        self.single_action_space = self.task.action_space
        self.single_observation_space = self.task.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        workers = allowed_cores() if threads is None else count("threads", threads, 1, 1024)
        self._batch = self.task.batch(self.num_envs, workers)
        self._generators: list[np.random.Generator] = []
        self._noise = np.zeros((self.num_envs, self._batch.readings.shape[1]))
        self._observations = np.zeros((self.num_envs, *self.single_observation_space.shape), dtype=np.float32)
        self._elapsed = np.zeros(self.num_envs, dtype=np.int64)
        self._started = np.zeros(self.num_envs, dtype=bool)
        self._done = np.zeros(self.num_envs, dtype=bool)

    def _task(self, arguments: dict[str, Any]) -> Task:
        return Task(**{"kind": "layers", **arguments})

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the rigs, -1 where one was drawn from the system's entropy."""
        return tuple(self._seeds) if self._generators else ()

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the rigs."""
        return tuple(self._generators)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: One for all (rig i gets seed + i), one for each, or None.
            options: ``reset_mask`` (n,) bool: which rigs to reset, all where left out; ``episode``: of the scenario,
                one for all rigs or a sequence of n, None in it leaves one to chance.

        Returns:
            Observations (n, ...) and the infos of the rigs that were reset.

        Raises:
            InputError: seeds, mask or episodes of another number than rigs, or unknown options.
        """
        options = dict(options or {})
        mask = self._mask(options.pop("reset_mask", None))
        # checked before the seeds are taken, so that a bad option changes nothing
        chosen = [self.task.chosen(each) for each in self._options_of_each(options)]
        self._seed(self._seeds_of_each(seed), mask)
        self._restart(mask, chosen)
        return self._observations.copy(), self._infos(mask)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Drill for one interval with every rig.

        Args:
            actions: (n, 3), or (n, 4) of DrillBit, each number from -1 to 1.

        Returns:
            Observations (n, ...), rewards (n,) in mm/s, terminations (n,), truncations (n,) and infos.

        Raises:
            InputError: actions of another shape, not finite or outside [-1, 1]; all rigs are left as they were.
            gymnasium.error.ResetNeeded: before the first reset, or, where autoreset is disabled, a rig is done.
        """
        if not self._started.all():
            raise gym.error.ResetNeeded("step was called before reset: call reset first")
        checked = checked_actions(actions, (self.num_envs, *self.task.rest.shape))
        mode = self.autoreset_mode
        if mode is AutoresetMode.DISABLED and self._done.any():
            raise gym.error.ResetNeeded(
                f"{int(self._done.sum())} rigs are done: reset them with options={{'reset_mask': ...}}, a mask of them"
            )
        restart = self._done.copy() if mode is AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, dtype=bool)
        running = ~restart
        self._advance(running, checked, absolute=False)
        self._elapsed[running] += 1
        if restart.any():
            self._restart(restart, [None] * self.num_envs)
        rewards = np.where(running, self._batch.rewards, 0.0)
        terminations = running & self._batch.terminated
        truncations = np.zeros(self.num_envs, dtype=bool)
        if self.max_episode_steps is not None:
            truncations = running & (self._elapsed >= self.max_episode_steps)
        done = terminations | truncations
        self._done = done.copy()
        final = {}
        if mode is AutoresetMode.SAME_STEP and done.any():
            final = self._final(done)
            self._restart(done, [None] * self.num_envs)
            self._done[:] = False
        everything = np.ones(self.num_envs, dtype=bool)
        return self._observations.copy(), rewards, terminations, truncations, self._infos(everything) | final

    def get_state(self, i: int = 0) -> EnvState:
        """The present point of rig i, exactly; :meth:`DrillEnv.set_state` takes it too.

        Raises:
            InputError: no such rig.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        i = count("rig", i, 0, self.num_envs - 1)
        if not self._started[i]:
            raise gym.error.ResetNeeded("get_state was called before reset: call reset first")
        noise = dict(self._generators[i].bit_generator.state)
        return EnvState(self._batch.snapshot(i), noise, self._batch.windows[i].copy(), None)

    def set_state(self, state: EnvState, which: Sequence[int] | np.ndarray | None = None) -> None:
        """Put rigs at a point of an episode, all of them where ``which`` is left out: many futures from one present.

        The noise of each goes on alike; the count of steps starts anew.

        Raises:
            InputError: not a state, of an environment built otherwise, or no such rig.
        """
        if not isinstance(state, EnvState):
            raise InputError(f"state is {shown(state)}: give what get_state returned")
        if state.window.shape != self._batch.windows[0].shape:
            raise InputError("state is of an environment with other observations: give one built alike")
        rigs = range(self.num_envs) if which is None else [count("rig", i, 0, self.num_envs - 1) for i in which]
        if not self._generators:
            self._seed([None] * self.num_envs, np.ones(self.num_envs, dtype=bool))
        for i in rigs:
            self._batch.restore(i, state.rig)
            self._batch.windows[i] = state.window
            self._generators[i].bit_generator.state = state.noise
            self._elapsed[i], self._started[i], self._done[i] = 0, True, False

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads go."""
        self._batch.close()

    def _mask(self, mask: object) -> np.ndarray:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise InputError(f"reset_mask is {shown(mask)}: give a boolean array of shape ({self.num_envs},)")
        if not mask.any():
            raise InputError("reset_mask marks no rig: mark at least one")
        if not (self._started | mask).all():
            raise InputError("reset_mask leaves out rigs that were never reset: reset all of them first")
        return mask.copy()

    def _seeds_of_each(self, seed: object) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if not isinstance(seed, Sequence | np.ndarray) or len(seed) != self.num_envs:
            raise InputError(f"seed is {shown(seed)}: give a whole number, or one for each of {self.num_envs} rigs")
        return [int(each) if isinstance(each, np.integer) else each for each in seed]

    def _options_of_each(self, options: Mapping[str, Any]) -> list[dict[str, Any] | None]:
        episodes = options.get("episode")
        if isinstance(episodes, np.ndarray):
            episodes = episodes.tolist()
        if isinstance(episodes, Sequence) and not isinstance(episodes, str):
            if len(episodes) != self.num_envs:
                raise InputError(f"{len(episodes)} episodes for {self.num_envs} rigs: give one, or one for each")
            rest = {key: value for key, value in options.items() if key != "episode"}
            return [rest if each is None else rest | {"episode": each} for each in episodes]
        return [dict(options) or None] * self.num_envs

    def _seed(self, seeds: list[int | None], mask: np.ndarray) -> None:
        """A generator for each rig that has none yet, or gets a seed."""
        if not self._generators:
            made = [seeding.np_random(seed) for seed in seeds]
            self._generators, self._seeds = [each for each, _ in made], [seed for _, seed in made]
            return
        # all made before any is taken, so that a bad seed leaves all rigs as they were
        anew = {i: seeding.np_random(seeds[i]) for i in np.flatnonzero(mask).tolist() if seeds[i] is not None}
        for i, (generator, seed) in anew.items():
            self._generators[i], self._seeds[i] = generator, seed

    def _restart(self, which: np.ndarray, chosen: Sequence[int | None]) -> None:
        """Draw episodes for the rigs marked, or take those chosen, and run their first interval."""
        for i in np.flatnonzero(which).tolist():
            self._batch.load(i, self.task.episode(self._generators[i], chosen[i]))
        self._advance(which, np.tile(self.task.rest, (self.num_envs, 1)), absolute=True)
        self._elapsed[which], self._started[which], self._done[which] = 0, True, False

    def _advance(self, which: np.ndarray, actions: np.ndarray, absolute: bool) -> None:
        """One interval of the rigs marked; their observations."""
        marked = np.flatnonzero(which).tolist()
        if not marked:
            return
        task = self.task
        if not task.window:
            noise, generators = self._noise, self._generators
            for i in marked:
                generators[i].standard_normal(out=noise[i])
        self._batch.step(which, actions, task.increment and not absolute, self._noise)
        if task.window:
            shape = (len(table.CHANNELS), table.WINDOW_SAMPLES)
            for i in marked:
                drawn = self._generators[i].standard_normal(shape)
                self._observations[i] = window_observation(self._batch.windows[i], drawn, task.noise)
        else:
            self._observations[which] = self._batch.readings[which]

    def _infos(self, which: np.ndarray) -> dict[str, Any]:
        return self._batch.infos(which)

    def _final(self, which: np.ndarray) -> dict[str, Any]:
        """The last observation and info of the rigs marked."""
        observations = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(which):
            observations[i] = self._observations[i].copy()
        return {
            "final_obs": observations,
            "_final_obs": which.copy(),
            "final_info": self._infos(which),
            "_final_info": which.copy(),
        }
