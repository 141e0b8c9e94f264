"""Training and searching on DrillBit: costs are those of a scalar environment, and what is written plays."""

import json

import gymnasium as gym
import numpy as np
import pytest
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO, SAC

from drillenv import cli
from drillenv.controllers.hole.belief import CENTRE, WIDTH, Belief
from drillenv.controllers.hole.learned import HoleLearned, HolePolicy, actions_of, read_policy, write_policy
from drillenv.controllers.hole.rules import HoleFixed, HoleRules
from drillenv.env.hole.readings import READINGS
from drillenv.env.registration import HOLES
from drillenv.training import believing, hole_headroom, hole_search, train
from drillenv.training.evaluation import evaluation_of_model
from drillenv.training.export import exported, read_config, weights_of
from drillenv.training.hole_headroom import row_of
from drillenv.training.hole_league import entries
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe
from drillenv.training.sb3 import DrillVecEnv

SMALL = {"env": "drillenv/DrillBit-v0", "algo": "ppo", "envs": 2, "rollout": 8, "batch": 16, "epochs": 2, "episodes": 2}
HOLE = {"max_episode_steps": 12}
"""So short that episodes end between updates."""


@pytest.mark.parametrize("make", [HoleFixed, HoleRules])
def test_costs_are_those_of_single_holes(make):
    costs = hole_search.costs_per_metre(make(), "validation", 3)
    env = gym.make("drillenv/DrillBit-v0", scenario="validation")
    for episode in range(3):
        observation, info = env.reset(seed=episode, options={"episode": episode})
        controller, ended = make(), False
        while not ended:
            observation, _, terminated, truncated, info = env.step(controller.act(observation, info))
            ended = terminated or truncated
        assert costs[episode] == info["cost_per_metre"]


@pytest.mark.slow
def test_a_search_finds_no_worse_and_keeps_it(tmp_path, capsys):
    file = tmp_path / "best.json"
    assert hole_search.main(["fixed", "--candidates", "3", "--episodes", "2", "--json", str(file)]) == 0
    best = json.loads(file.read_text())
    assert best == json.loads(capsys.readouterr().out)
    first = {"frequency": 100.0, "amplitude": 0.4, "pressure": 0.7, "bit_depth": 1.5}
    assert best["cost"] <= hole_search.costs_per_metre(HoleFixed(**first), "train", 2).mean()
    again = hole_search.costs_per_metre(HoleFixed(**best["numbers"]), "train", 2).mean()
    assert again == pytest.approx(best["cost"])


def test_training_gives_policies_and_what_they_cost(tmp_path, capsys):
    options = [
        "--quiet",
        "--threads",
        "1",
        "--timesteps",
        "48",
        "--evaluate-every",
        "16",
        "--env-kwargs",
        json.dumps(HOLE),
    ]
    given = [word for name, value in SMALL.items() for word in (f"--{name}", str(value))]
    out = tmp_path / "run"
    assert cli.main(["train", "--out", str(out), *given, *options]) == 0
    result = json.loads((out / "result.json").read_text())
    assert [steps for steps, _ in result["scores"]] == [16, 32, 48]
    assert result["best_score"] == min(cost for _, cost in result["scores"])
    assert f"{result['best_score']:.4f} EUR/m after" in capsys.readouterr().out
    for which, cost in (("best", result["best_score"]), ("last", result["score"])):
        again = hole_search.costs_per_metre(HoleLearned(out / which), "validation", 2, steps=12).mean()
        assert again == pytest.approx(cost)
        said = read_policy(out / which).provenance
        assert said["score"] == pytest.approx(cost) and said["score_unit"] == "EUR/m"
        assert said["scenario"] == "validation" and said["algorithm"] == "ppo" and said["gamma"] == 0.99
        policy = exported(out, which)
        assert isinstance(policy, HolePolicy) and policy.layers == 2
    assert cli.main(["export", "--run", str(out), "--out", str(tmp_path / "policy")]) == 0
    assert read_policy(tmp_path / "policy").provenance["steps"] == result["best_steps"]
    assert not list(out.glob("*.zip"))


@pytest.mark.parametrize(
    ("algo", "more"),
    [
        ("ppo", {"prepared": False, "stack": 2}),
        ("recurrent-ppo", {"lstm": 8}),
        ("sac", {"rollout": None, "epochs": None, "algo_kwargs": {"learning_starts": 16, "buffer_size": 1000}}),
    ],
)
def test_the_library_s_algorithms_learn_on_holes_as_they_are(algo, more, tmp_path):
    """Readings, actions and rewards are those of the environment, and the model enters the league."""
    numbers = SMALL | {"algo": algo, "layers": (16,), "env_kwargs": HOLE} | more
    recipe = Recipe(**numbers, evaluate_every=16, seed=3)
    learner = Learner(recipe, threads=1)
    assert learner.rigs.rigs.task.costs.metre == 600.0  # type: ignore[attr-defined]
    assert learner.stacked.observation_space.shape == (20 * recipe.stack,)
    learner.close()
    result = train.train(recipe, 32, tmp_path / "run", threads=1, quiet=True)
    assert [steps for steps, _ in result["scores"]] == [16, 32] and result["cost"] is None
    assert not (tmp_path / "run" / "last" / "policy.json").exists()
    file = str(tmp_path / "run" / "last.zip")
    (run,) = entries([f"mine={file}"])["mine"]
    assert (run.seed, run.source) == (3, file)
    played = row_of([run.make()], "validation", 1, steps=12)
    plain = Recipe(**numbers | {"episodes": 1})
    model = {"ppo": PPO, "recurrent-ppo": RecurrentPPO, "sac": SAC}[algo].load(file, device="cpu")
    assert evaluation_of_model(model, plain, 1).score == pytest.approx(played["cost_per_metre"][0], rel=0.02)


@pytest.mark.parametrize("more", [{}, {"algo": "ppo-vine", "ahead": 2}, {"algo": "recurrent-ppo", "lstm": 8}])
def test_a_run_on_holes_goes_on_exactly(more, tmp_path):
    recipe = Recipe(**SMALL | more, evaluate_every=64, seed=7, env_kwargs=HOLE)
    train.train(recipe, 96, tmp_path / "whole", threads=1, quiet=True)
    train.train(recipe, 48, tmp_path / "halves", threads=1, quiet=True)
    train.train(recipe, 96, tmp_path / "halves", resume=True, threads=2, quiet=True)
    for file in ("policy.safetensors", "optimizer.safetensors"):
        ends = [tmp_path / run / "checkpoints" / f"{96:012d}" / file for run in ("whole", "halves")]
        assert ends[0].read_bytes() == ends[1].read_bytes()


def test_training_has_a_price_of_its_own_and_the_numbers_of_a_hole():
    recipe = Recipe(env="drillenv/DrillBit-v0", algo="ppo")
    assert (recipe.prepared, recipe.envs, recipe.rollout, recipe.batch, recipe.epochs) == (True, 64, 128, 2048, 5)
    assert (recipe.gamma, recipe.gae_lambda, recipe.learning_rate, recipe.ahead) == (0.99, 0.95, 1e-3, 0)
    assert recipe.timesteps == recipe.anneal == 4_000_000
    vine = Recipe(env="drillenv/DrillBit-v0")
    assert (vine.algo, vine.prepared, vine.ahead, vine.gamma, vine.rollout) == ("ppo-vine", True, 24, 0.99, 32)
    assert vine.timesteps == vine.anneal == 150_000
    # on the environment as it is, those of every run
    assert Recipe(env="drillenv/DrillBit-v0", algo="ppo", prepared=False).timesteps == 500_000
    plain = Recipe(env="drillenv/DrillBit-v0", algo="recurrent-ppo")
    assert (plain.prepared, plain.timesteps, plain.lstm, plain.rollout, plain.stack) == (False, 500_000, 256, 128, 1)
    learner = Learner(Recipe(**SMALL), threads=1)
    task = learner.rigs.rigs.task
    assert task.costs.metre == believing.METRE and task.costs.bit == 80.0  # type: ignore[attr-defined]
    outputs = learner.model.policy.action_net.bias.detach().numpy()
    assert outputs == pytest.approx(believing.BEGIN) and learner.model.policy.log_std.requires_grad
    own = Learner(Recipe(**SMALL, env_kwargs={"costs": {"metre": 300.0, "bit": 9.0}}), threads=1)
    assert own.rigs.rigs.task.costs.metre == 300.0  # type: ignore[attr-defined]
    for each in (learner, own):
        each.close()


def test_holes_without_a_frozen_set_are_drawn_for_the_evaluation(tmp_path):
    recipe = Recipe(**SMALL | {"env": "drillenv/DrillBitShort-v0"}, evaluate_every=16, env_kwargs=HOLE)
    result = train.train(recipe, 16, tmp_path / "run", threads=1, quiet=True)
    said = read_policy(tmp_path / "run" / "last").provenance
    assert said["scenario"] == "as in training"
    drawn = hole_search.costs_per_metre(
        HoleLearned(tmp_path / "run" / "last"), None, 2, arguments=HOLES["DrillBitShort"], steps=12, first_seed=10**6
    )
    assert drawn.mean() == pytest.approx(result["score"])
    assert read_config(tmp_path / "run")[0] == recipe


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (
            ["--algo", "ppo-lagrangian"],
            "which ppo-lagrangian does not learn: give ppo-vine, ppo, recurrent-ppo, sac, td3",
        ),
        (["--no-prepared"], "algo is ppo-vine and the rigs are not prepared"),
        (["--algo", "ppo", "--ahead", "4"], "only ppo-vine measures on copies"),
        (["--algo", "sac", "--prepared"], "algo is sac and the rigs are prepared"),
        (["--algo", "recurrent-ppo", "--prepared"], "algo is recurrent-ppo and the rigs are prepared"),
        (["--algo", "sac", "--rollout", "8"], "--rollout has no use with sac"),
        (["--algo", "ppo", "--stack", "3"], "stack and activation are those of policies for holes"),
        (["--algo", "ppo", "--activation", "relu"], "stack and activation are those of policies for holes"),
        (["--algo", "ppo", "--noise", "0.1", "0.1", "0.1"], "--noise has no use with drillenv/DrillBit-v0"),
        (["--algo", "ppo", "--env-kwargs", '{"rock": 4}'], "env_kwargs do not fit drillenv/DrillBit-v0"),
        (["--algo", "ppo", "--env-kwargs", '{"costs": 3}'], "costs is 3"),
    ],
)
def test_what_cannot_be_trained_on_holes(given, says, tmp_path, capsys):
    assert cli.main(["train", "--out", str(tmp_path / "run"), "--env", "drillenv/DrillBit-v0", *given]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_an_untrained_policy_on_numpy_is_the_one_of_the_library(tmp_path):
    learner = Learner(Recipe(**SMALL, layers=(16, 8)), threads=1)
    write_policy(tmp_path / "p", HolePolicy(weights_of(learner.parameters(), learner.recipe)))
    learned = HoleLearned(tmp_path / "p")
    seen = learner.stacked.reset()
    rng = np.random.default_rng(0)
    for _ in range(5):
        raw = learner.rigs.rigs._observations.copy()
        with torch.no_grad():
            outputs = learner.model.predict(seen, deterministic=True)[0]
        assert learned.act(raw, {}) == pytest.approx(actions_of(outputs, seen), abs=1e-5)
        seen = learner.stacked.step(rng.uniform(-1, 1, (2, 4)))[0]
    learner.close()


def test_a_hole_that_is_over_is_forgotten_and_its_end_kept():
    rigs = believing.Believing(DrillVecEnv("drillenv/DrillBit-v0", 2, threads=1, max_episode_steps=3))
    rigs.reset()
    action = np.array([believing.BEGIN, believing.BEGIN])
    for _ in range(2):
        known, _, dones, infos = rigs.step(action)
        assert not dones.any()
    known, _, dones, infos = rigs.step(action)
    assert dones.all()
    raw = rigs.venv.rigs._observations  # type: ignore[union-attr]
    assert known == pytest.approx(Belief(2).of(raw))
    last = np.stack([each["terminal_observation"] for each in infos])
    ended = np.stack([CENTRE + WIDTH * each[: CENTRE.size] for each in last])
    depth = [reading.name for reading in READINGS].index("hole_depth")
    assert (ended[:, depth] > 0.01).all() and (raw[:, depth] == 0.0).all()


def test_the_table_of_a_record():
    rows = {
        name: {m: [c, 2 * c] for m in hole_headroom.MEASURES} | {"plan": [1.0, 2.0]}
        for name, c in (("oracle", 1.0), ("rules", 2.0))
    }
    record = {"rows": rows}
    found = hole_headroom.summary(record)
    assert found["oracle"]["share"] == pytest.approx([1.0, 1.0, 1.0])
    assert found["rules"]["share"] == pytest.approx([0.5, 0.5, 0.5])
    assert found["rules"]["cost"] == pytest.approx([3.0, 2.0, 4.0])  # two holes, of 2 and of 4 EUR/m
    text = hole_headroom.table(record)
    assert text.index("| oracle |") < text.index("| rules |")


def test_policies_are_rows_by_their_names(tmp_path, capsys):
    found = hole_headroom.by_row(["made/ppo-0", "made/ppo-1", "plain-ppo-12.zip"])
    assert {row: [each.name for each in paths] for row, paths in found.items()} == {
        "ppo": ["ppo-0", "ppo-1"],
        "plain-ppo": ["plain-ppo-12.zip"],
    }
    assert [name for name in hole_headroom.entries(["made/ppo-0", "ppo-1"]) if "seed" in name] == ["ppo, 2 seeds"]
    assert hole_headroom.main(["--json", str(tmp_path / "r.json"), "--policies", "mine.zip"]) == 2
    assert "policy 'mine.zip' says neither row nor seed: call it ROW-SEED, as ppo-0" in capsys.readouterr().err


def test_a_record_of_something_else_is_refused(tmp_path, capsys):
    file = tmp_path / "r.json"
    file.write_text(json.dumps({"format": "other"}))
    assert hole_headroom.main(["--json", str(file)]) == 2
    assert "give another name" in capsys.readouterr().err
