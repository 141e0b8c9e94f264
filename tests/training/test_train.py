"""The training run: what it writes, that it goes on where it stopped, and what it says to bad input."""

import json
import os
import random
import shutil
import subprocess
import sys
import time
from multiprocessing import get_context

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from drillenv import cli, controllers
from drillenv.checks import InputError
from drillenv.training import checkpoint, train
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe, read_recipe
from drillenv.training.rollout import rollout

SMALL = {
    "env": "drillenv/Drill-v0",
    "envs": 4,
    "stack": 2,
    "rollout": 8,
    "batch": 16,
    "epochs": 1,
    "ahead": 2,
    "layers": (8,),
}
STEPS = 10 * 32
"""Ten updates; an episode of 80 steps ends in the tenth."""


def main(arguments):
    return cli.main(["train", *arguments])


def files(folder):
    """Every byte of the policy and of all that goes on from it, by file; times are in the record of the episodes."""
    found = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            data = file.read_bytes()
            if file.name == "state.json":
                record = json.loads(data)
                record["episodes"] = [{key: each[key] for key in ("r", "l")} for each in record["episodes"]]
                data = json.dumps(record).encode()
            found[str(file.relative_to(folder))] = data
    return found


def result_of(out, steps):
    """What a run comes to: the last and the best policy, and the checkpoint at the end."""
    return files(out / "last"), files(out / "best"), files(out / "checkpoints" / f"{steps:012d}")


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"algo": "ppo", "prepared": True, "stack": 1, "ahead": 0, "gamma": 0.8, "activation": "relu"},
        pytest.param({"algo": "recurrent-ppo", "ahead": 0, "lstm": 8, "stack": 1}, marks=pytest.mark.slow),
        pytest.param(
            {"algo": "recurrent-ppo", "ahead": 0, "lstm": 4, "env": "drillenv/DrillLayers-v0"}, marks=pytest.mark.slow
        ),
    ],
    ids=["ppo", "critic-unstacked", "recurrent", "recurrent-stacked"],
)
def test_2n_is_n_stop_resume_n(tmp_path, change):
    recipe = Recipe(**(SMALL | change), evaluate_every=128, episodes=2, noise_anneal=150, anneal=250, seed=7)
    whole = train.train(recipe, 2 * STEPS, tmp_path / "whole", threads=1, quiet=True)
    train.train(recipe, STEPS, tmp_path / "halves", threads=1, quiet=True)
    np.random.seed(99)  # noqa: NPY002  what another process would have in its generators
    random.seed(99)
    resumed = train.train(recipe, 2 * STEPS, tmp_path / "halves", resume=True, threads=2, quiet=True)
    assert whole["resumed_at"] == 0 and resumed["resumed_at"] == STEPS
    assert result_of(tmp_path / "halves", 2 * STEPS) == result_of(tmp_path / "whole", 2 * STEPS)
    assert resumed["scores"] == whole["scores"]


def test_the_seed_decides(tmp_path):
    runs = []
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train.train(Recipe(**SMALL, evaluate_every=0, seed=seed), 64, tmp_path / name, threads=1, quiet=True)
        runs.append(files(tmp_path / name / "last")["policy.safetensors"])
    assert runs[0] == runs[1] != runs[2]


def killed_at_random(out, arguments, steps, kills, rng):
    """Start the training, kill it at a random moment, and again, then let it get through. Where the kills found it.

    On a busy machine it dies before it has come anywhere, and is killed more often.
    """
    context = get_context("forkserver")
    context.set_forkserver_preload(["drillenv.training.train"])
    found, checkpoints = [], out / "checkpoints"
    deadline = time.monotonic() + 300
    while not (out / "result.json").exists():
        assert time.monotonic() < deadline
        process = context.Process(target=cli.main, args=(["train", *arguments, "--out", str(out), "--resume"],))
        process.start()
        if len(found) < kills or len(set(found) - {0}) < 2:
            before = sorted(checkpoints.glob("0*")) if checkpoints.exists() else []
            # every third kill hits the start, with its reading of the checkpoint, the others the training after it
            if len(found) % 3:
                while process.is_alive() and (not checkpoints.exists() or sorted(checkpoints.glob("0*")) == before):
                    time.sleep(0.002)
                time.sleep(rng.uniform(0.0, 0.15))
            else:
                time.sleep(rng.uniform(0.0, 0.5))
            alive = process.is_alive()
            process.kill()
            process.join()
            kept, _ = checkpoint.latest(checkpoints)
            if alive:
                assert process.exitcode == -9
                found.append(0 if kept is None else kept.steps)
        else:
            process.join(120)
            assert process.exitcode == 0
    return found


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on this platform")
def test_killed_at_random_moments_it_gives_the_same_policy(tmp_path):
    recipe = Recipe(**SMALL, evaluate_every=512, episodes=1, noise_anneal=1500, anneal=2000, seed=3)
    steps = 64 * 32
    options = ["--quiet", "--threads", "1", "--timesteps", str(steps), "--checkpoint-seconds", "0.02"]
    for name in (*SMALL, "evaluate_every", "episodes", "noise_anneal", "anneal", "seed"):
        value = getattr(recipe, name)
        options += [f"--{name.replace('_', '-')}", *map(str, value if isinstance(value, tuple) else (value,))]
    train.train(recipe, steps, tmp_path / "whole", threads=1, quiet=True)
    found = killed_at_random(tmp_path / "killed", options, steps, kills=4, rng=random.Random(os.urandom(8)))
    assert len({each for each in found if 0 < each < steps}) >= 2, found
    assert result_of(tmp_path / "killed", steps) == result_of(tmp_path / "whole", steps), found
    assert not list((tmp_path / "killed" / "checkpoints").glob(".*"))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that was evaluated: its folder, recipe and result."""
    out = tmp_path_factory.mktemp("run") / "run"
    recipe = Recipe(**SMALL, evaluate_every=96, episodes=3, seed=1)
    return out, recipe, train.train(recipe, STEPS, out, threads=1, quiet=True)


def test_scores_are_those_of_the_exported_policies(run):
    out, _, result = run
    assert [steps for steps, _ in result["scores"]] == [96, 192, 288, STEPS]
    assert result["best_score"] == max(score for _, score in result["scores"])
    for which, score in (("best", result["best_score"]), ("last", result["score"])):
        driver = controllers.make("learned", policy=out / which)
        assert driver.policy.provenance["score"] == score
        made = rollout(lambda which=which: controllers.make("learned", policy=out / which), "Drill", "validation", 3)
        assert made.scores.mean() == score
    assert json.loads((out / "result.json").read_text()) == result


def test_tensorboard(run):
    out = run[0]
    events = EventAccumulator(str(out / "tensorboard"))
    events.Reload()
    assert {"evaluation/score", "train/value_loss", "train/learning_rate"} <= set(events.Tags()["scalars"])


def test_tensorboard_shows_no_step_twice_after_a_kill(tmp_path):
    recipe = Recipe(**SMALL, evaluate_every=0)
    out = tmp_path / "run"
    train.train(recipe, STEPS, out, threads=1, checkpoint_seconds=0.0, quiet=True)
    kept = sorted((out / "checkpoints").iterdir())
    shutil.rmtree(kept[-1])  # as if killed before it was written
    train.train(recipe, 2 * STEPS, out, resume=True, threads=1, quiet=True)
    events = EventAccumulator(str(out / "tensorboard"))
    events.Reload()
    seen = [event.step for event in events.Scalars("train/value_loss")]
    assert seen == sorted(set(seen))


def test_the_configuration_is_beside_the_result(run):
    out, recipe, _ = run
    record = json.loads((out / "config.json").read_text())
    assert read_recipe(record["recipe"]) == recipe and record["timesteps"] == STEPS
    assert {"drillenv", "torch", "numpy", "stable-baselines3", "python"} <= set(record["versions"])


def test_resume_needs_no_other_option(run, tmp_path, capsys):
    out = shutil.copytree(run[0], tmp_path / "run")
    (out / "result.json").unlink()
    assert main(["--out", str(out), "--resume", "--quiet", "--threads", "1"]) == 0
    assert f"{STEPS} steps" in capsys.readouterr().out
    assert json.loads((out / "result.json").read_text())["scores"] == run[2]["scores"]


def test_resume_of_a_run_that_was_not_begun(tmp_path):
    for start in ("nothing", "empty", "configured"):
        out = tmp_path / start
        if start != "nothing":
            out.mkdir()
        recipe = Recipe(**SMALL, evaluate_every=0)
        if start == "configured":
            train._begin(out, recipe, 64)
        assert train.train(recipe, 64, out, resume=True, threads=1, quiet=True)["resumed_at"] == 0


BAD = {
    "no folder": [],
    "unknown option": ["--out", "OUT", "--fast"],
    "a run is there": ["--out", "RUN"],
    "another seed": ["--out", "RUN", "--resume", "--seed", "5"],
    "another network": ["--out", "RUN", "--resume", "--layers", "8", "8"],
    "fewer steps": ["--out", "RUN", "--resume", "--timesteps", "32"],
    "a file": ["--out", "RUN/config.json"],
    "below a file": ["--out", "RUN/config.json/x"],
    "env": ["--out", "OUT", "--env", "CartPole-v1"],
    "algo": ["--out", "OUT", "--algo", "dqn"],
    "timesteps": ["--out", "OUT", "--timesteps", "0"],
    "timesteps in words": ["--out", "OUT", "--timesteps", "many"],
    "seed": ["--out", "OUT", "--seed", "-1"],
    "envs": ["--out", "OUT", "--envs", "0"],
    "many envs": ["--out", "OUT", "--envs", "1000000000"],
    "stack": ["--out", "OUT", "--stack", "0"],
    "batch": ["--out", "OUT", "--envs", "2", "--rollout", "8", "--batch", "17"],
    "ahead": ["--out", "OUT", "--ahead", "-1"],
    "recurrent copies": ["--out", "OUT", "--algo", "recurrent-ppo", "--ahead", "4"],
    "gamma": ["--out", "OUT", "--gamma", "1.5"],
    "learning rate": ["--out", "OUT", "--learning-rate", "nan"],
    "noise": ["--out", "OUT", "--noise", "0.1", "0", "0.1"],
    "one noise": ["--out", "OUT", "--noise-end", "0.1"],
    "layers": ["--out", "OUT", "--layers"],
    "activation": ["--out", "OUT", "--activation", "eval"],
    "threads": ["--out", "OUT", "--threads", "0"],
    "seconds": ["--out", "OUT", "--checkpoint-seconds", "-1"],
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gives_one_line_and_leaves_all_as_it_was(run, tmp_path, capsys, case):
    before = {file: file.stat().st_mtime_ns for file in run[0].rglob("*")}
    swaps = {"OUT": str(tmp_path / "out"), "RUN": str(run[0])}
    arguments = [
        part if part.startswith("--") else part.replace("OUT", swaps["OUT"]).replace("RUN", swaps["RUN"])
        for part in BAD[case]
    ]
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("drillenv: ") and said.err.count("\n") == 1 and len(said.err) < 400
    assert {file: file.stat().st_mtime_ns for file in run[0].rglob("*")} == before
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"format": "drillenv-training/3"}', '{"format": "drillenv-training/1"}']
)
def test_a_damaged_configuration(tmp_path, text, capsys):
    (tmp_path / "config.json").write_text(text)
    assert main(["--out", str(tmp_path), "--resume"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("drillenv: ") and said.count("\n") == 1 and "config.json" in said


def test_a_recipe_refuses_what_it_does_not_know():
    for record in (None, [], {"sedd": 1}, {"layers": "8"}, {"layers": []}, {"seed": "0"}, {"lstm": 0}):
        with pytest.raises(InputError):
            read_recipe(record)
    recipe = Recipe(seed=3, layers=(5, 4))
    assert read_recipe(json.loads(json.dumps(recipe.as_record()))) == recipe


def test_learning_rate_and_noise_go_by_the_steps_done():
    quiet = (0.1, 0.1, 0.25)
    recipe = Recipe(**SMALL, learning_rate=1e-3, noise=(0.4, 0.1, 1), noise_end=quiet, noise_anneal=500, anneal=1000)
    learner = Learner(recipe, threads=1)
    for steps, rate, noise in (
        (0, 1e-3, (0.4, 0.1, 1.0)),
        (250, 7.5e-4, (0.2, 0.1, 0.5)),
        (500, 5e-4, quiet),
        (1000, 2e-5, quiet),
        (10**9, 2e-5, quiet),
    ):
        learner.model.num_timesteps = steps
        learner.anneal()
        np.testing.assert_allclose(np.exp(learner.model.policy.log_std.detach().numpy()), noise, rtol=1e-6)
        for progress in (1.0, 0.3):  # what the algorithm thinks of its progress does not matter
            np.testing.assert_allclose(learner.model.lr_schedule(progress), rate, rtol=1e-9)


@pytest.mark.slow
def test_the_command_line(tmp_path):
    """As a process of its own, with its progress bar."""
    options = ["--env", "drillenv/Drill-v0", "--envs", "2", "--rollout", "8", "--batch", "8", "--evaluate-every", "0"]
    command = [sys.executable, "-m", "drillenv.cli", "train", "--out", "run", "--timesteps", "32", *options]
    made = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "32 steps" in made.stdout and "32/32" in made.stderr and "Warning" not in made.stderr


@pytest.mark.slow
def test_training_makes_it_better(tmp_path):
    """20 000 steps of the usual recipe, on layers: from a careful setting to well above it."""
    recipe = Recipe(evaluate_every=1024, episodes=8, seed=2)
    result = train.train(recipe, 20_480, tmp_path / "run", quiet=True)
    first = result["scores"][0][1]
    assert result["score"] > first + 0.5
