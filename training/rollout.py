"""Controllers through the episodes of a scenario, all at once on the native vector environment."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import count
from drillenv.controllers import Controller, OnPlant
from drillenv.env.registration import KINDS, STEPS
from drillenv.env.scenarios import read_scenario
from drillenv.env.truth import TRUTH, TRUTH_SIZE
from drillenv.env.vector import DrillVectorEnv


class Rollout(NamedTuple):
    """What a controller did."""

    rewards: np.ndarray
    """(episodes, steps) in mm/s."""
    truths: np.ndarray
    """(episodes, steps, columns of TRUTH)."""
    actions: np.ndarray
    """(episodes, steps, 3)."""

    @property
    def scores(self) -> np.ndarray:
        """(episodes,) mean reward in mm/s."""
        return self.rewards.mean(axis=1)


def rollout(
    controller: Callable[[], Controller],
    environment: str = "DrillLayers",
    scenario: str = "test",
    episodes: int | None = None,
    steps: int | None = None,
    threads: int | None = None,
) -> Rollout:
    """Run a controller through the first episodes of a scenario.

    Episode i has the seed i for the noise and for the controller, whichever controller it is: common random numbers.

    Args:
        controller: Makes one controller for each episode.
        environment: Drill, DrillLayers or DrillHidden.
        scenario: A frozen set or a file of one.
        episodes: How many; all of them where left out.
        steps: How many of each; those of the registration where left out.
        threads: Of the environment; all cores where left out.
    """
    task: dict[str, Any] = {"kind": KINDS[environment], "scenario": scenario}
    available = len(read_scenario(scenario).episodes[KINDS[environment]])
    n = available if episodes is None else count("episodes", episodes, 1, available)
    length = STEPS[environment] if steps is None else count("steps", steps, 1, 1_000_000)
    envs = DrillVectorEnv(n, threads=threads, **task)
    observations, infos = envs.reset(seed=0, options={"episode": list(range(n))})
    drivers = [controller() for _ in range(n)]
    for i, driver in enumerate(drivers):
        if isinstance(driver, OnPlant):
            driver.attach(partial(envs.get_state, i))
        driver.reset(seed=i)
    rewards = np.empty((n, length))
    truths = np.empty((n, length, TRUTH_SIZE))
    actions = np.empty((n, length, 3), dtype=np.float32)
    for step in range(length):
        for i, driver in enumerate(drivers):
            info = {name: infos[name][i] for name in TRUTH} if driver.sees_truth else {}
            actions[i, step] = driver.act(observations[i], info)
        observations, rewards[:, step], _, _, infos = envs.step(actions[:, step])
        truths[:, step] = np.column_stack([infos[name] for name in TRUTH])
    envs.close()
    return Rollout(rewards, truths, actions)
