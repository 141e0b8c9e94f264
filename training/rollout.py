"""Controllers through the episodes of a scenario, all at once on the native vector environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import InputError, count, shown
from drillenv.controllers import Controller, OnPlant, sees_truth
from drillenv.env.registration import KINDS, STEPS
from drillenv.env.scenarios import read_scenario
from drillenv.env.truth import TRUTH, TRUTH_SIZE
from drillenv.env.vector import DrillVectorEnv

MOST_EPISODES = 100_000
"""Of a rollout that no scenario limits."""


class Rollout(NamedTuple):
    """What a controller did."""

    rewards: np.ndarray
    """(episodes, steps) in mm/s."""
    truths: np.ndarray
    """(episodes, steps, columns of TRUTH)."""
    actions: np.ndarray
    """(episodes, steps, 3)."""
    observations: np.ndarray
    """(episodes, steps + 1, 15) float32; the first are those of the reset."""

    @property
    def scores(self) -> np.ndarray:
        """(episodes,) mean reward in mm/s."""
        return self.rewards.mean(axis=1)


def rollout(
    controller: Callable[[], Controller],
    environment: str = "DrillLayers",
    scenario: str | None = "test",
    episodes: int | None = None,
    steps: int | None = None,
    threads: int | None = None,
    arguments: Mapping[str, Any] = MappingProxyType({}),
    first_seed: int = 0,
) -> Rollout:
    """Run a controller through the first episodes of a scenario.

    Episode i has the seed ``first_seed`` + i for the noise and for the controller, whichever controller it is: common
    random numbers.

    Args:
        controller: Makes one controller for each episode.
        environment: Drill, DrillLayers or DrillHidden.
        scenario: A frozen set or a file of one; None lets the seeds draw the episodes.
        episodes: How many; all of them where left out.
        steps: How many of each; those of the registration where left out.
        threads: Of the environment; all cores where left out.
        arguments: Others of the environment.
        first_seed: Of the first episode.

    Raises:
        InputError: no such scenario, a number out of range, or an action that is none.
    """
    task: dict[str, Any] = {"kind": KINDS[environment], **arguments}
    options, available = {}, MOST_EPISODES
    if scenario is not None:
        task["scenario"] = scenario
        available = len(read_scenario(scenario).episodes[KINDS[environment]])
    n = available if scenario and episodes is None else count("episodes", episodes, 1, available)
    if scenario is not None:
        options["episode"] = list(range(n))
    length = STEPS[environment] if steps is None else count("steps", steps, 1, 1_000_000)
    envs = DrillVectorEnv(n, threads=threads, **task)
    observations, infos = envs.reset(seed=first_seed, options=options)
    drivers = [controller() for _ in range(n)]
    for i, driver in enumerate(drivers):
        if isinstance(driver, OnPlant):
            driver.attach(partial(envs.get_state, i))
        driver.reset(seed=first_seed + i)
    rewards = np.empty((n, length))
    truths = np.empty((n, length, TRUTH_SIZE))
    actions = np.empty((n, length, 3), dtype=np.float32)
    seen = np.empty((n, length + 1, *observations.shape[1:]), dtype=np.float32)
    seen[:, 0] = observations
    for step in range(length):
        for i, driver in enumerate(drivers):
            info = {name: infos[name][i] for name in TRUTH} if sees_truth(driver) else {}
            actions[i, step] = action_of(driver, observations[i], info)
        observations, rewards[:, step], _, _, infos = envs.step(actions[:, step])
        truths[:, step] = np.column_stack([infos[name] for name in TRUTH])
        seen[:, step + 1] = observations
    envs.close()
    return Rollout(rewards, truths, actions, seen)


def action_of(driver: Controller, observation: np.ndarray, info: dict[str, Any], size: int = 3) -> np.ndarray:
    """(size,) float32 what a controller does after an observation.

    Raises:
        InputError: what it gives is no action.
    """
    given = driver.act(observation, info)
    try:
        action = np.asarray(given, dtype=np.float32)
    except (TypeError, ValueError):
        action = np.empty(0)
    if action.shape != (size,) or not np.isfinite(action).all() or np.abs(action).max() > 1.0:
        raise InputError(
            f"act of {type(driver).__name__} gave {shown(given)}: let it give {size} numbers, each from -1 to 1"
        )
    return action
