"""Train a policy by PPO on the native vector environment, so that it can be stopped at any moment and go on.

    python -m drillenv.training.train --out DIR [--resume] [--timesteps N] [--seed S] [--algo ppo|recurrent-ppo] [...]

What lies in DIR:

    config.json     the recipe, the number of steps, and the versions of what it ran with
    checkpoints/    the last two, see drillenv.training.checkpoint; --resume goes on from the last
    best/, last/    the best policy by the evaluations on the scenario validation, and the last one, as exported files
    tensorboard/    tensorboard --logdir DIR/tensorboard
    result.json     scores and times, once all steps are done

A run that was killed and resumed gives the policy of a run that was not, bit for bit, and a run of N steps that is
resumed with --timesteps 2N that of a run of 2N steps.
"""

from __future__ import annotations

import dataclasses
import json
import platform
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from drillenv.checks import InputError, count, number
from drillenv.cli import Parser
from drillenv.controllers.learned import Learned
from drillenv.controllers.policies import write_policy
from drillenv.files import whole
from drillenv.training import checkpoint
from drillenv.training.export import CONFIG, FORMAT, policy_of, read_config, weights_of
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe, read_recipe
from drillenv.training.rollout import rollout

TIMESTEPS = 500_000
SCENARIO = "validation"
CHECKPOINT_SECONDS = 15.0
LOGGED_EVERY = 8192
"""Steps between two points of the curves in TensorBoard."""
PACKAGES = ("drillenv", "numpy", "numba", "torch", "stable-baselines3", "sb3-contrib")


class Keeper(BaseCallback):
    """Between two updates: anneals, evaluates, keeps what is best, writes checkpoints, moves the progress bar.

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

    def show(self, steps: int) -> None:
        """Move the progress bar; the last update may go beyond the steps asked for."""
        self.bar.update(min(steps, self.bar.total) - self.bar.n)

    def write(self) -> None:
        """Write a checkpoint of the run as it stands."""
        checkpoint.write(self.out / "checkpoints", checkpoint.take(self.learner, self.notes, self.best))
        self._written = time.monotonic()

    def evaluate(self, steps: int) -> float:
        """Score the policy as it would be used, and keep it where it is the best so far."""
        recipe = self.learner.recipe
        parameters = {name: value.numpy() for name, value in self.learner.model.policy.state_dict().items()}
        weights = weights_of(parameters, recipe)
        score = score_of(weights, recipe, self.learner.threads)
        self.notes = {**self.notes, "evaluated": steps, "scores": [*self.notes["scores"], [steps, score]]}
        if self.notes["best_score"] is None or score > self.notes["best_score"]:
            self.notes |= {"best_score": score, "best_steps": steps}
            self.best = weights
            write_policy(self.out / "best", policy_of(weights, recipe, steps, score))
        logger = self.learner.model.logger
        logger.record("evaluation/score", score)
        logger.dump(steps)
        self.bar.set_postfix(validation=f"{score:.3f}", best=f"{self.notes['best_score']:.3f}")
        return score


def score_of(weights: Mapping[str, np.ndarray], recipe: Recipe, threads: int | None) -> float:
    """Mean reward in mm/s of a policy over the episodes of the scenario validation, without noise on its actions."""
    policy = policy_of(weights, recipe, 0, None)
    environment = recipe.env.removeprefix("drillenv/").removesuffix("-v0")
    made = rollout(lambda: Learned(policy), environment, SCENARIO, recipe.episodes, threads=threads)
    return float(made.scores.mean())


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
    _begin(folder, recipe, timesteps, resume)
    began = time.monotonic()
    kept, wrong = checkpoint.latest(folder / "checkpoints")
    for line in wrong:
        print(f"warning: {line}", file=sys.stderr)
    learner = Learner(recipe, threads)
    notes: dict[str, Any] = {"evaluated": 0, "scores": [], "best_score": None, "best_steps": None}
    best: Mapping[str, np.ndarray] = {}
    if kept is not None:
        checkpoint.put(learner, kept)
        notes, best = kept.record["notes"], kept.best
        if best:
            write_policy(folder / "best", policy_of(best, recipe, notes["best_steps"], notes["best_score"]))
    first = learner.model.num_timesteps
    learner.model.set_logger(_logger(folder, first))
    with tqdm(total=timesteps, initial=min(first, timesteps), unit="step", disable=quiet) as bar:
        keeper = Keeper(learner, folder, notes, best, bar, checkpoint_seconds)
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
            log_interval=max(1, LOGGED_EVERY // learner.recipe.update),
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
    score = keeper.evaluate(steps) if recipe.evaluate_every else None
    parameters = {name: value.numpy() for name, value in learner.model.policy.state_dict().items()}
    write_policy(folder / "last", policy_of(weights_of(parameters, recipe), recipe, steps, score))
    result = {
        "steps": steps,
        "score": score,
        "best_score": keeper.notes["best_score"],
        "best_steps": keeper.notes["best_steps"],
        "scores": keeper.notes["scores"],
        "resumed_at": first,
        "seconds": seconds,
        "steps_a_second": (steps - first) / seconds,
    }
    _write_json(folder / "result.json", result)
    return result


def _begin(folder: Path, recipe: Recipe, timesteps: int, resume: bool) -> None:
    """Write down what the run is, or find that it is the run which is there."""
    if (folder / CONFIG).exists():
        if not resume:
            raise InputError(f"{folder} holds a run: give --resume to go on with it, or another folder")
        there, steps = read_config(folder)
        for each in dataclasses.fields(Recipe):
            before, now = getattr(there, each.name), getattr(recipe, each.name)
            if before != now:
                raise InputError(
                    f"{folder} holds a run with {each.name} {before}, not {now}: leave it out, or give another folder"
                )
        if timesteps < steps:
            raise InputError(f"{folder} holds a run of {steps} steps, more than {timesteps}: give as many or more")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write to {folder} ({error.strerror}): give another folder") from None
    versions = {name: version(name) for name in PACKAGES} | {"python": platform.python_version()}
    record = {"format": FORMAT, "timesteps": timesteps, "recipe": recipe.as_record(), "versions": versions}
    _write_json(folder / CONFIG, record)


def _write_json(file: Path, record: Mapping[str, Any]) -> None:
    with whole(file) as part:
        part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def parser() -> Parser:
    """The options: those of the recipe, and those that do not decide on the result."""
    made = Parser(prog="python -m drillenv.training.train", description=(__doc__ or "").split("\n")[0])
    made.add_argument("--out", required=True, help="folder of the run")
    made.add_argument(
        "--resume", action="store_true", help="go on with the run in --out; other options may be left out"
    )
    made.add_argument("--timesteps", type=int, help=f"steps in all, all rigs together (default {TIMESTEPS})")
    made.add_argument("--threads", type=int, help="threads of the rigs (default all cores)")
    made.add_argument("--checkpoint-seconds", type=float, default=CHECKPOINT_SECONDS, help="time between checkpoints")
    made.add_argument("--quiet", action="store_true", help="no progress bar")
    usual = Recipe()
    for each in dataclasses.fields(Recipe):
        default = getattr(usual, each.name)
        several = isinstance(default, tuple)
        named = " ".join(str(part) for part in default) if several else default
        made.add_argument(
            f"--{each.name.replace('_', '-')}",
            type=type(default[0] if several else default),
            nargs="+" if several else None,
            help=f"{each.metadata['help']} (default {named})",
        )
    return made


def asked(arguments: Sequence[str] | None) -> dict[str, Any]:
    """The arguments of :func:`train` that a command line asks for.

    Raises:
        InputError: an option that is not known, or a value that is not what it should be.
    """
    given = parser().parse_args(arguments)
    chosen = {
        each.name: value for each in dataclasses.fields(Recipe) if (value := getattr(given, each.name)) is not None
    }
    timesteps = given.timesteps
    if given.resume and (Path(given.out) / CONFIG).exists():
        there, steps = read_config(Path(given.out))
        chosen = there.as_record() | chosen
        timesteps = steps if timesteps is None else timesteps
    return {
        "recipe": read_recipe(chosen),
        "timesteps": TIMESTEPS if timesteps is None else timesteps,
        "out": given.out,
        "resume": given.resume,
        "threads": given.threads,
        "checkpoint_seconds": given.checkpoint_seconds,
        "quiet": given.quiet,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input, 130 when interrupted."""
    try:
        wanted = asked(arguments)
        result = train(**wanted)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: the same command with --resume goes on from the last checkpoint", file=sys.stderr)
        return 130
    print(f"{result['steps']} steps, {result['steps_a_second']:.0f} a second")
    if result["best_score"] is not None:
        out = shlex.quote(str(wanted["out"]))
        print(f"best on {SCENARIO}: {result['best_score']:.4f} mm/s after {result['best_steps']} steps, in {out}/best")
    return 0


if __name__ == "__main__":
    sys.exit(main())
