"""How many steps a second training makes, and where its time goes: ``python -m benchmarks.training``.

PPO of Stable-Baselines3 by the usual recipe on the drilling rig, with copies of the rigs that measure the actions and
with a critic instead, and with the same numbers (rigs, steps of an update, minibatches, passes, network) on Gymnasium's
Pendulum-v1, as make_vec_env sets it up. They take turns, update by update of the same run, and figures are medians over
the rounds. Times are processor times on one thread, so that other work on the machine counts little. The plant is what
moves the rig, its copies or the pendulum: the compiled kernel with its readings and reward, and the step of the bare
environment.
"""

from __future__ import annotations

import os

os.environ["NUMBA_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import json
import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from drillenv.files import check_writable, whole
from drillenv.training.branches import Branches
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe

UPDATES = 8
"""Updates of a round."""
PARTS = ("plant", "rest of the environment", "policy", "update")
RECIPE = Recipe(evaluate_every=0)


class Clock:
    """Processor time spent in some functions, by name."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)

    def on(self, owner: Any, method: str, name: str) -> None:
        """Count the time in a method of an object from now on."""
        function: Callable[..., Any] = getattr(owner, method)

        def timed(*arguments: Any, **options: Any) -> Any:
            start = time.process_time()
            result = function(*arguments, **options)
            self.spent[name] += time.process_time() - start
            return result

        setattr(owner, method, timed)


def drilling(recipe: Recipe) -> tuple[PPO, Clock]:
    """PPO on the rig, and its clock."""
    learner, clock = Learner(recipe, threads=1), Clock()
    assert isinstance(learner.model, PPO)
    clock.on(learner.rigs.rigs._batch, "step", "plant")
    clock.on(learner.stacked, "step_wait", "environment")
    branches = learner.model.env
    if isinstance(branches, Branches):
        clock.on(branches._copies, "step", "plant")
        clock.on(branches, "_measure", "environment")
    clock.on(learner.model, "train", "update")
    return learner.model, clock


def pendulum() -> tuple[PPO, Clock]:
    """PPO on Pendulum-v1, and its clock."""
    envs, clock = make_vec_env("Pendulum-v1", RECIPE.envs, seed=RECIPE.seed), Clock()
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=RECIPE.rollout,
        batch_size=RECIPE.batch,
        n_epochs=RECIPE.epochs,
        policy_kwargs={"net_arch": list(RECIPE.layers)},
        seed=RECIPE.seed,
        device="cpu",
    )
    for env in envs.envs:  # type: ignore[attr-defined]
        clock.on(env.unwrapped, "step", "plant")
    clock.on(envs, "step_wait", "environment")
    clock.on(model, "train", "update")
    return model, clock


def figures(model: PPO, clock: Clock) -> dict[str, float]:
    """One round: processor seconds in all and by part."""
    clock.spent.clear()
    start, wall = time.process_time(), time.perf_counter()
    model.learn(UPDATES * RECIPE.update, reset_num_timesteps=False)
    total, spent = time.process_time() - start, clock.spent
    parts = {
        "plant": spent["plant"],
        "rest of the environment": spent["environment"] - spent["plant"],
        "policy": total - spent["environment"] - spent["update"],
        "update": spent["update"],
    }
    return {"processor": total, "clock": time.perf_counter() - wall, **parts}


def summary(rounds: list[dict[str, float]]) -> dict[str, Any]:
    """Steps a second and shares of the time, medians over the rounds."""
    steps = UPDATES * RECIPE.update
    return {
        "steps_a_processor_second": round(statistics.median(steps / each["processor"] for each in rounds)),
        "steps_a_second_on_the_clock": round(statistics.median(steps / each["clock"] for each in rounds)),
        "share": {
            part: round(statistics.median(each[part] / each["processor"] for each in rounds), 3) for part in PARTS
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.training", description="Time training.")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of each (default 7)")
    parser.add_argument("--json", help="write the figures to this file")
    given = parser.parse_args()
    if given.json:
        check_writable(given.json)
    contestants = {
        "drillenv/DrillLayers-v0": drilling(RECIPE),
        "the same with a critic": drilling(replace(RECIPE, algo="ppo", ahead=0)),
        "Pendulum-v1": pendulum(),
    }
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in contestants}
    for turn in range(max(1, given.rounds) + 1):
        for name, (model, clock) in contestants.items():
            made = figures(model, clock)
            if turn:  # the first loads and warms up
                rounds[name].append(made)
    found = {name: summary(each) for name, each in rounds.items()}
    print(f"{'PPO on':26s} steps/s of processor, on the clock; share of the time: {', '.join(PARTS)}")
    for name, each in found.items():
        shares = "  ".join(f"{100 * share:4.1f} %" for share in each["share"].values())
        rates = f"{each['steps_a_processor_second']:6d}  {each['steps_a_second_on_the_clock']:6d}"
        print(f"{name:26s} {rates}  {shares}")
    if given.json:
        with whole(given.json) as part:
            part.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
