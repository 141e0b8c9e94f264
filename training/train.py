"""Train a policy on the native vector environment, so that it can be stopped at any moment and go on.

What lies in the folder of a run:

    config.json       the recipe, the number of steps, and the versions of what it ran with
    checkpoints/      the last two, see drillenv.training.checkpoint; --resume goes on from the last
    best/, last/      the best policy by the evaluations, and the last one, as exported files
    best.zip, last.zip  the same as models of Stable-Baselines3, where an algorithm runs on rigs as they are
    tensorboard/      tensorboard --logdir DIR/tensorboard
    result.json       scores, costs and times, once all steps are done

A run that was killed and resumed gives the policy of a run that was not, bit for bit, and a run of N steps that is
resumed with --timesteps 2N that of a run of 2N steps. SAC and TD3 have no checkpoints.
"""

from __future__ import annotations

import dataclasses
import json
import platform
import sys
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from threadpoolctl import threadpool_limits
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from drillenv.checks import InputError, count, number
from drillenv.files import made_folder, whole
from drillenv.training import checkpoint
from drillenv.training.evaluation import Evaluation, better, evaluation_of_model, evaluation_of_policy, scenario_of
from drillenv.training.export import CONFIG, FORMAT, RESULT, controller_weights, policy_of, read_config, write
from drillenv.training.learner import Learner
from drillenv.training.recipe import CHECKPOINT_SECONDS, OFF_POLICY, Recipe

NOTHING_YET: Mapping[str, Any] = MappingProxyType(
    {"evaluated": 0, "scores": [], "costs": [], "best_score": None, "best_cost": None, "best_steps": None}
)
"""What there is to say of the evaluations at the start."""
LOGGED_EVERY = 8192
"""Steps between two points of the curves in TensorBoard."""
LOGGED_EPISODES = 16
"""The same of SAC and TD3, which count episodes."""
PACKAGES = ("drillenv", "numpy", "numba", "torch", "stable-baselines3", "sb3-contrib")


class Keeper(BaseCallback):
    """Between two updates: anneals, prices, evaluates, keeps what is best, writes checkpoints, moves the progress bar.

    Args:
        learner: What is trained.
        out: Folder of the run.
        notes: What a checkpoint says of the evaluations so far.
        best: The best weights so far.
        bar: The progress bar.
        seconds: Time between two checkpoints.
    """

    def __init__(
        self,
        learner: Learner,
        out: Path,
        notes: dict[str, Any],
        best: Mapping[str, np.ndarray],
        bar: Any,
        seconds: float,
    ):
        super().__init__()
        self.learner, self.out, self.bar, self.seconds = learner, out, bar, seconds
        self.notes, self.best = notes, best
        self._written = time.monotonic()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self.learner.anneal()
        steps = self.learner.model.num_timesteps
        every = self.learner.recipe.evaluate_every
        if every and steps // every > self.notes["evaluated"] // every:
            self.evaluate(steps)
        if time.monotonic() - self._written >= self.seconds:
            self.write()
        self.show(steps)

    def _on_rollout_end(self) -> None:
        priced = self.learner.priced
        if priced is not None:
            priced.ascend()
            self.logger.record("lagrangian/cost", priced.cost)
            self.logger.record("lagrangian/multiplier", priced.multiplier)

    def show(self, steps: int) -> None:
        """Move the progress bar; the last update may go beyond the steps asked for."""
        self.bar.update(min(steps, self.bar.total) - self.bar.n)

    def write(self) -> None:
        """Write a checkpoint of the run as it stands, where the algorithm can go on from one."""
        if self.learner.resumes:
            checkpoint.write(self.out / "checkpoints", checkpoint.take(self.learner, self.notes, self.best))
        self._written = time.monotonic()

    def evaluate(self, steps: int) -> Evaluation:
        """Score the policy as it would be used, and keep it where it is the best so far."""
        learner, recipe = self.learner, self.learner.recipe
        weights = controller_weights(learner.parameters(), recipe)
        if recipe.prepared:
            found = evaluation_of_policy(policy_of(weights, recipe, 0, None), recipe, learner.threads)
        else:
            found = evaluation_of_model(learner.model, recipe, learner.threads)
        notes, logger = self.notes, learner.model.logger
        self.notes = notes | {"evaluated": steps, "scores": [*notes["scores"], [steps, found.score]]}
        logger.record("evaluation/score", found.score)
        if found.cost is not None:
            self.notes["costs"] = [*notes["costs"], [steps, found.cost]]
            logger.record("evaluation/cost", found.cost)
        best = None if notes["best_score"] is None else Evaluation(notes["best_score"], notes["best_cost"])
        if best is None or better(found, best, recipe):
            self.notes |= {"best_score": found.score, "best_cost": found.cost, "best_steps": steps}
            self.best = weights
            keep(self.out / "best", learner, weights, steps, found.score)
        logger.dump(steps)
        self.bar.set_postfix(score=f"{found.score:.3f}", best=f"{self.notes['best_score']:.3f}")
        return found


def keep(
    place: Path,
    learner: Learner,
    weights: Mapping[str, np.ndarray],
    steps: int,
    score: float | None,
    model: bool = True,
) -> None:
    """Write a policy into the folder ``place`` and, where rigs are as they are, the model beside it."""
    recipe = learner.recipe
    if weights:
        scenario = scenario_of(recipe) or "as in training"
        write(place, policy_of(weights, recipe, steps, score, scenario))
    if model and not recipe.prepared:
        with whole(place.with_suffix(".zip")) as part:
            learner.model.save(part)


def train(
    recipe: Recipe,
    timesteps: int,
    out: str | Path,
    resume: bool = False,
    threads: int | None = None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
    quiet: bool = False,
) -> dict[str, Any]:
    """Train until ``timesteps`` steps are done, rounded up to whole updates.

    Args:
        recipe: What to train with.
        timesteps: Steps in all, those before a resume included.
        out: Folder of the run.
        resume: Go on with the run in ``out``; a run that was not begun is begun.
        threads: Of the rigs; all cores where left out. The result does not depend on it.
        checkpoint_seconds: Time between two checkpoints.
        quiet: Whether to show no progress bar.

    Returns:
        What ``result.json`` says.

    Raises:
        InputError: ``out`` holds a run and ``resume`` is False, or one by another recipe or of more steps, or cannot
            be written to.
    """
    folder = Path(out)
    timesteps = count("timesteps", timesteps, 1, 10**12)
    number("checkpoint_seconds", checkpoint_seconds, 0.0, 1e6, "s")
    if threads is not None:
        count("threads", threads, 1, 1024)
    _check_folder(folder, recipe, timesteps, resume)
    began = time.monotonic()
    learner = Learner(recipe, threads)  # before anything is written, for it knows best what cannot be trained
    _begin(folder, recipe, timesteps)
    kept, wrong = checkpoint.latest(folder / "checkpoints")
    for line in wrong:
        print(f"warning: {line}", file=sys.stderr)
    notes: dict[str, Any] = dict(NOTHING_YET)
    best: Mapping[str, np.ndarray] = {}
    if kept is not None:
        checkpoint.put(learner, kept)
        notes, best = notes | kept.record["notes"], kept.best  # checkpoints of before say nothing of costs
        keep(folder / "best", learner, best, notes["best_steps"], notes["best_score"], model=False)
    first = learner.model.num_timesteps
    learner.model.set_logger(_logger(folder, first))
    with tqdm(total=timesteps, initial=min(first, timesteps), unit="step", disable=quiet) as bar:
        keeper = Keeper(learner, folder, notes, best, bar, checkpoint_seconds)
        with threadpool_limits(1):  # products of small matrices are not worth sharing out
            _learn(learner, keeper, timesteps)
        result = _finish(keeper, folder, first, time.monotonic() - began)
    learner.model.logger.close()
    learner.close()
    return result


def _logger(folder: Path, steps: int) -> Logger:
    """The curves in TensorBoard, to go on after these steps."""
    made = TensorBoardOutputFormat(str(folder / "tensorboard"))
    made.writer.close()
    # what a killed run wrote after its last checkpoint is done, and written, again
    made.writer = SummaryWriter(str(folder / "tensorboard"), purge_step=steps + 1)
    return Logger(str(folder), [made])


def _learn(learner: Learner, keeper: Keeper, timesteps: int) -> None:
    """Let the algorithm take the steps that are left."""
    model = learner.model
    if model.num_timesteps < timesteps:
        model.learn(
            timesteps - model.num_timesteps,
            callback=keeper,
            log_interval=LOGGED_EPISODES if not learner.resumes else max(1, LOGGED_EVERY // learner.recipe.update),
            reset_num_timesteps=model.num_timesteps == 0,
        )
        model.logger.dump(model.num_timesteps)


def _finish(keeper: Keeper, folder: Path, first: int, seconds: float) -> dict[str, Any]:
    """Write the last checkpoint and policy and the result."""
    keeper.write()
    learner, recipe = keeper.learner, keeper.learner.recipe
    steps = learner.model.num_timesteps
    keeper.show(steps)
    # the run may be lengthened, so this evaluation is not part of the checkpoint
    score, cost = keeper.evaluate(steps) if recipe.evaluate_every else (None, None)
    weights = controller_weights(learner.parameters(), recipe)
    keep(folder / "last", learner, weights, steps, score)
    result = {
        "steps": steps,
        "score": score,
        "cost": cost,
        **{name: value for name, value in keeper.notes.items() if name != "evaluated"},
        **(learner.priced.as_record() if learner.priced is not None else {}),
        "resumed_at": first,
        "seconds": seconds,
        "steps_a_second": (steps - first) / seconds,
    }
    _write_json(folder / RESULT, result)
    return result


def _check_folder(folder: Path, recipe: Recipe, timesteps: int, resume: bool) -> None:
    """See that the folder holds no run, or this very one, which is to go on."""
    if not (folder / CONFIG).exists():
        return
    if not resume:
        raise InputError(f"{folder} holds a run: give --resume to go on with it, or another folder")
    there, steps = read_config(folder)
    for each in dataclasses.fields(Recipe):
        before, now = getattr(there, each.name), getattr(recipe, each.name)
        if before != now:
            raise InputError(
                f"{folder} holds a run with {each.name} {before}, not {now}: leave it out, or give another folder"
            )
    if recipe.algo in OFF_POLICY:
        raise InputError(f"{folder} holds a run of {recipe.algo}, which has no checkpoints: begin in another folder")
    if timesteps < steps:
        raise InputError(f"{folder} holds a run of {steps} steps, more than {timesteps}: give as many or more")


def _begin(folder: Path, recipe: Recipe, timesteps: int) -> None:
    """Write down what the run is."""
    made_folder(folder)
    versions = {name: version(name) for name in PACKAGES} | {"python": platform.python_version()}
    record = {"format": FORMAT, "timesteps": timesteps, "recipe": recipe.as_record(), "versions": versions}
    _write_json(folder / CONFIG, record)


def _write_json(file: Path, record: Mapping[str, Any]) -> None:
    with whole(file) as part:
        part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
