"""What a policy is worth while it is trained, without noise on its actions: its mean reward, or what a metre costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecFrameStack

from drillenv.checks import InputError
from drillenv.controllers.hole.learned import HoleLearned, HolePolicy
from drillenv.controllers.learned import Learned
from drillenv.controllers.policies import Policy
from drillenv.env.registration import HOLES
from drillenv.training.hole_search import costs_per_metre
from drillenv.training.learner import rigs_of
from drillenv.training.recipe import Recipe
from drillenv.training.rollout import rollout

SCENARIO = "validation"
FIXING = ("rock", "scenario", "model")
"""Arguments that go with no other scenario."""
FIRST_SEED = 1_000_000
"""Of the episodes of an evaluation that no scenario fixes: training begins with others."""


def scenario_of(recipe: Recipe) -> str | None:
    """The scenario of the evaluations; None where the arguments of the environment leave no choice, or it has none."""
    if any(name in recipe.env_kwargs for name in FIXING):
        return None
    try:
        rigs_of(recipe, 1, 1, scenario=SCENARIO).close()
    except InputError:
        return None
    return SCENARIO


def better(score: float, other: float, recipe: Recipe) -> bool:
    """Whether a score is better than another: less, where it is a cost."""
    return score < other if recipe.hole else score > other


def score_of_policy(policy: Policy | HolePolicy, recipe: Recipe, threads: int | None) -> float:
    """Mean reward in mm/s of an exported policy on prepared rigs, or EUR/m of holes."""
    environment = recipe.env.removeprefix("drillenv/").removesuffix("-v0")
    arguments: dict[str, Any] = dict(recipe.env_kwargs)
    steps = arguments.pop("max_episode_steps", None)
    scenario = scenario_of(recipe)
    first = 0 if scenario else FIRST_SEED
    if isinstance(policy, HolePolicy):
        arguments = {**HOLES[environment], **arguments}
        costs = costs_per_metre(HoleLearned(policy), scenario, recipe.episodes, threads, arguments, steps, first)
        return float(costs.mean())
    made = rollout(lambda: Learned(policy), environment, scenario, recipe.episodes, steps, threads, arguments, first)
    return float(made.scores.mean())


def score_of_model(model: Any, recipe: Recipe, threads: int | None) -> float:
    """Mean reward of a model of Stable-Baselines3 on rigs as they are, over the episodes of an evaluation."""
    scenario = scenario_of(recipe)
    fixed: Mapping[str, Any] = {} if scenario is None else {"scenario": scenario}
    rigs = rigs_of(recipe, recipe.episodes, threads, **fixed)
    stacked = VecFrameStack(rigs, recipe.stack)
    rigs.seed(0 if scenario else FIRST_SEED)
    if scenario:
        rigs.set_options([{"episode": i} for i in range(recipe.episodes)])
    observations = stacked.reset()
    earned, steps, done = 0.0, 0, False
    while not done:
        actions, _ = model.predict(observations, deterministic=True)
        observations, rewards, dones, _ = stacked.step(actions)
        earned, steps, done = earned + float(np.mean(rewards)), steps + 1, bool(dones[0])
    rigs.close()
    return earned / steps
