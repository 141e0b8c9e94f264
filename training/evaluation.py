"""What a policy is worth while it is trained, without noise on its actions: its mean reward, or what a metre costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import InputError
from drillenv.controllers.hole.learned import HoleLearned, HolePolicy
from drillenv.controllers.learned import Learned
from drillenv.controllers.policies import Policy
from drillenv.env.registration import HOLES
from drillenv.env.truth import T_EXCESS
from drillenv.training.hole_search import costs_per_metre
from drillenv.training.learner import rigs_of
from drillenv.training.recipe import Recipe
from drillenv.training.rollout import rollout

SCENARIO = "validation"
FIXING = ("rock", "scenario", "model")
"""Arguments that go with no other scenario."""
FIRST_SEED = 1_000_000
"""Of the episodes of an evaluation that no scenario fixes: training begins with others."""


class Evaluation(NamedTuple):
    """What a policy is worth over the episodes of an evaluation."""

    score: float
    """Mean reward in mm/s, or EUR/m of holes."""
    cost: float | None
    """Mean force above the rating in N, of the same steps; None of holes."""


def scenario_of(recipe: Recipe) -> str | None:
    """The scenario of the evaluations; None where the arguments of the environment leave no choice, or it has none."""
    if any(name in recipe.env_kwargs for name in FIXING):
        return None
    try:
        rigs_of(recipe, 1, 1, scenario=SCENARIO).close()
    except InputError:
        return None
    return SCENARIO


def better(found: Evaluation, other: Evaluation, recipe: Recipe) -> bool:
    """Whether an evaluation is better than another: by its score, which is the less the better where a metre costs it.

    Where a budget is kept to, what is less above it comes first, and the score decides among those that are as far
    above it, such as all that keep to it.
    """
    if recipe.hole:
        return found.score < other.score
    above, other_above = (_above(each, recipe) for each in (found, other))
    return above < other_above or (above == other_above and found.score > other.score)


def _above(found: Evaluation, recipe: Recipe) -> float:
    """N above the budget; 0 where there is none."""
    return max(0.0, found.cost - recipe.cost_limit) if recipe.constrained and found.cost is not None else 0.0


def evaluation_of_policy(policy: Policy | HolePolicy, recipe: Recipe, threads: int | None) -> Evaluation:
    """What an exported policy is worth on prepared rigs."""
    if isinstance(policy, HolePolicy):
        return evaluation_on_holes(HoleLearned(policy), recipe, threads)
    arguments: dict[str, Any] = dict(recipe.env_kwargs)
    steps = arguments.pop("max_episode_steps", None)
    scenario = scenario_of(recipe)
    first = 0 if scenario else FIRST_SEED
    environment, episodes = environment_of(recipe), recipe.episodes
    made = rollout(lambda: Learned(policy), environment, scenario, episodes, steps, threads, arguments, first)
    return Evaluation(float(made.scores.mean()), float(made.truths[..., T_EXCESS].mean()))


def environment_of(recipe: Recipe) -> str:
    """The name of the environment, such as DrillLayers."""
    return recipe.env.removeprefix("drillenv/").removesuffix("-v0")


def evaluation_on_holes(controller: HoleLearned | Played, recipe: Recipe, threads: int | None) -> Evaluation:
    """What a metre of hole costs with a controller that drills many at once."""
    arguments: dict[str, Any] = {**HOLES[environment_of(recipe)], **recipe.env_kwargs}
    steps = arguments.pop("max_episode_steps", None)
    scenario = scenario_of(recipe)
    first = 0 if scenario else FIRST_SEED
    costs = costs_per_metre(controller, scenario, recipe.episodes, threads, arguments, steps, first)
    return Evaluation(float(costs.mean()), None)


class Played:
    """A model of Stable-Baselines3 as a controller of many rigs, with its last ``stack`` observations side by side."""

    def __init__(self, model: Any, stack: int):
        self._model, self._stack = model, stack
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the episodes so far."""
        self._seen: np.ndarray | None = None
        self._memory: Any = None

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """(n, actions) without chance, for observations (n, ...)."""
        begins = np.full(len(observation), self._seen is None)
        if self._seen is None:
            self._seen = np.zeros((self._stack, *observation.shape), dtype=np.float32)
        self._seen = np.concatenate([self._seen[1:], observation[None]])
        seen = np.concatenate(list(self._seen), axis=-1)
        actions, self._memory = self._model.predict(seen, self._memory, begins, deterministic=True)
        return actions


def evaluation_of_model(model: Any, recipe: Recipe, threads: int | None) -> Evaluation:
    """What a model of Stable-Baselines3 is worth on rigs as they are."""
    if recipe.hole:
        return evaluation_on_holes(Played(model, recipe.stack), recipe, threads)
    scenario = scenario_of(recipe)
    fixed: Mapping[str, Any] = {} if scenario is None else {"scenario": scenario}
    rigs = rigs_of(recipe, recipe.episodes, threads, info_keys=["cost"], **fixed)
    controller = Played(model, recipe.stack)
    rigs.seed(0 if scenario else FIRST_SEED)
    if scenario:
        rigs.set_options([{"episode": i} for i in range(recipe.episodes)])
    observations = rigs.reset()
    earned, cost, steps, done = 0.0, 0.0, 0, False
    while not done:
        observations, rewards, dones, infos = rigs.step(controller.act(np.asarray(observations), {}))
        earned, steps, done = earned + float(np.mean(rewards)), steps + 1, bool(dones[0])
        cost += float(np.mean([info["cost"] for info in infos]))
    rigs.close()
    return Evaluation(earned / steps, cost / steps)
