"""The algorithms of Stable-Baselines3 on rigs as they are, and the arguments of the environment."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, TD3

from drillenv import cli, controllers
from drillenv.controllers.policies import DIRECT, SHIPPED, read_policy
from drillenv.training import train
from drillenv.training.evaluate import row_of
from drillenv.training.export import exported, read_config
from drillenv.training.learner import Learner
from drillenv.training.recipe import ALGORITHMS, CRITIC, OTHERWISE, USUAL, Recipe, renamed
from drillenv.training.rollout import rollout

PLAIN = {
    "ppo": {"envs": 4, "rollout": 8, "batch": 16, "epochs": 2},
    "sac": {"envs": 2, "batch": 16, "algo_kwargs": {"learning_starts": 20, "buffer_size": 1000}},
    "td3": {"envs": 2, "batch": 16, "algo_kwargs": {"learning_starts": 20, "buffer_size": 1000}},
}
CLASSES = {"ppo": PPO, "sac": SAC, "td3": TD3}


def recipe_of(algo, **change):
    return Recipe(algo=algo, **{"env": "drillenv/Drill-v0", "layers": (16,), "episodes": 2} | PLAIN[algo] | change)


@pytest.mark.slow
@pytest.mark.parametrize("algo", PLAIN)
def test_a_run_gives_a_policy_for_controllers_and_a_model(algo, tmp_path):
    result = train.train(recipe_of(algo, evaluate_every=32, seed=5), 64, tmp_path / "run", quiet=True, threads=1)
    assert [steps for steps, _ in result["scores"]] == [32, 64]
    policy = read_policy(tmp_path / "run" / "last")
    assert policy.outputs == DIRECT and policy.provenance["algorithm"] == algo
    model = CLASSES[algo].load(tmp_path / "run" / "last.zip", device="cpu")
    drivers = [controllers.make("learned", policy=tmp_path / "run" / name) for name in ("last", "last.zip")]
    space = model.observation_space
    space.seed(1)
    for _ in range(50):
        seen = space.sample()
        for driver in drivers:
            np.testing.assert_allclose(driver.act(seen, {}), model.predict(seen, deterministic=True)[0], atol=2e-5)
    # scores are those of the exported policies as controllers
    for which, score in (("best", result["best_score"]), ("last", result["score"])):
        made = rollout(lambda which=which: controllers.make("learned", policy=tmp_path / "run" / which), "Drill",
                       "validation", 2)  # fmt: skip
        assert made.scores.mean() == pytest.approx(score, rel=1e-3)
        assert exported(tmp_path / "run", which).provenance["algorithm"] == algo


@pytest.mark.parametrize("algo", PLAIN)
def test_it_is_the_library_s_own_on_the_environment_as_it_is(algo):
    """The same class with the same numbers on DummyVecEnv's scalar environments gives the same parameters."""
    learner = Learner(recipe_of(algo, seed=2, envs=1, rollout=32), threads=1)
    learner.model.learn(64)
    numbers = {"batch_size": 16, "learning_rate": OTHERWISE[algo]["learning_rate"], "gamma": 0.99}
    policy = {"net_arch": [16], "activation_fn": learner.model.policy_kwargs["activation_fn"]}
    if algo == "ppo":
        numbers |= {"n_steps": 32, "n_epochs": 2}
    else:
        numbers |= PLAIN[algo]["algo_kwargs"] | ({"action_noise": learner.model.action_noise} if algo == "td3" else {})
    env = gym.make("drillenv/Drill-v0")
    other = CLASSES[algo]("MlpPolicy", env, seed=2, policy_kwargs=policy, device="cpu", **numbers)
    other.learn(64)
    for name, value in other.policy.state_dict().items():
        np.testing.assert_array_equal(learner.parameters()[name], value.numpy(), err_msg=name)
    learner.close()


@pytest.mark.slow
@pytest.mark.parametrize("kwargs", [{}, {"observations": "window", "actions": "increment"}])
def test_plain_ppo_goes_on_exactly(tmp_path, kwargs):
    recipe = recipe_of("ppo", evaluate_every=64, seed=7, env_kwargs=kwargs)
    train.train(recipe, 192, tmp_path / "whole", threads=1, quiet=True)
    train.train(recipe, 96, tmp_path / "halves", threads=1, quiet=True)
    train.train(recipe, 192, tmp_path / "halves", resume=True, threads=1, quiet=True)
    for file in ("policy.safetensors", "optimizer.safetensors"):
        ends = [tmp_path / run / "checkpoints" / f"{192:012d}" / file for run in ("whole", "halves")]
        assert ends[0].read_bytes() == ends[1].read_bytes()
    assert (tmp_path / "halves" / "best").exists() != bool(kwargs)
    if kwargs:
        assert cli.main(["export", "--run", str(tmp_path / "halves"), "--out", str(tmp_path / "policy")]) == 2


def test_arguments_of_the_environment(tmp_path):
    """Each reaches the rigs; the evaluation keeps to them."""
    kwargs = {"rock": 2, "reward": {"force": 2.0}, "noise": 0.0, "max_episode_steps": 12}
    given = ["--env", "drillenv/Drill-v0", "--env-kwargs", json.dumps(kwargs), "--quiet", "--threads", "1"]
    small = ["--envs", "2", "--rollout", "16", "--batch", "16", "--episodes", "2", "--evaluate-every", "32"]
    for algo in ("ppo", "ppo-vine"):
        out = str(tmp_path / algo)
        assert cli.main(["train", "--out", out, "--algo", algo, "--timesteps", "32", *given, *small]) == 0
        recipe, _ = read_config(tmp_path / algo)
        assert recipe.env_kwargs == kwargs
        rigs = Learner(recipe, threads=1).rigs.rigs
        assert rigs.max_episode_steps == 12 and rigs.task.noise == 0.0 and rigs.task.reward.force == 2.0
        assert rigs.task.rock is not None and rigs.task.rock[1] == 2
        provenance = read_policy(tmp_path / algo / "last").provenance
        assert json.loads(provenance["env_kwargs"]) == kwargs and provenance["scenario"] == "as in training"
        made = rollout(
            lambda out=out: controllers.make("learned", policy=f"{out}/last"), "Drill", None, 2, 12,
            arguments={name: value for name, value in kwargs.items() if name != "max_episode_steps"}, first_seed=10**6,
        )  # fmt: skip
        assert provenance["score"] == pytest.approx(made.scores.mean(), rel=1e-3)


def test_wrong_constants_are_trained_and_evaluated_on(tmp_path):
    """A frozen set has rigs of its own, so that the evaluation draws its episodes too."""
    given = ["--env", "drillenv/Drill-v0", "--env-kwargs", '{"errors": 2.0, "max_episode_steps": 12}', "--quiet"]
    small = ["--envs", "2", "--rollout", "16", "--batch", "16", "--episodes", "2", "--evaluate-every", "32"]
    out = tmp_path / "run"
    assert cli.main(["train", "--out", str(out), "--timesteps", "32", "--threads", "1", *given, *small]) == 0
    provenance = read_policy(out / "last").provenance
    assert provenance["scenario"] == "as in training"
    made = rollout(
        lambda: controllers.make("learned", policy=out / "last"), "Drill", None, 2, 12,
        arguments={"errors": 2.0}, first_seed=10**6,
    )  # fmt: skip
    assert provenance["score"] == pytest.approx(made.scores.mean(), rel=1e-3)


BAD = {
    "no JSON": (["--env-kwargs", "rock=4"], "is no record of JSON"),
    "a list": (["--env-kwargs", "[4]"], "is no record of JSON"),
    "unknown argument": (["--env-kwargs", '{"rocks": 4}'], "env_kwargs do not fit drillenv/DrillLayers-v0"),
    "bad argument": (["--env-kwargs", '{"rock": "granite"}'], "granite"),
    "decided": (["--env-kwargs", '{"num_envs": 4}'], "env_kwargs has num_envs, which training decides"),
    "prepared actions": (["--env-kwargs", '{"actions": "increment"}'], "which prepared rigs decide"),
    "prepared kwargs": (
        ["--algo-kwargs", '{"tau": 0.1}'],
        "algo_kwargs go with ppo, sac and td3 on rigs as they are",
    ),
    "unknown kwargs": (["--algo", "sac", "--algo-kwargs", '{"taus": 0.1}'], "algo_kwargs do not fit sac"),
    "kwargs twice": (["--algo", "sac", "--algo-kwargs", '{"gamma": 0.1}'], "which other options set"),
    "policy": (["--algo", "sac", "--algo-kwargs", '{"policy": "x"}'], "which other options set"),
    "no use": (["--algo", "sac", "--clip", "0.1"], "--clip has no use with sac"),
    "critic": (["--ahead", "0"], "give ppo --prepared for that"),
    "prepared sac": (["--algo", "sac", "--prepared"], "leave prepared out"),
    "plain vine": (["--no-prepared"], "leave prepared out"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_line(case, tmp_path, capsys):
    arguments, said = BAD[case]
    assert cli.main(["train", "--out", str(tmp_path / "out"), "--quiet", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("drillenv: ") and err.count("\n") == 1
    assert said in err
    assert not (tmp_path / "out").exists()


def test_sac_does_not_go_on(tmp_path, capsys):
    train.train(recipe_of("sac", evaluate_every=0), 8, tmp_path / "run", threads=1, quiet=True)
    assert not (tmp_path / "run" / "checkpoints").exists()
    assert cli.main(["train", "--out", str(tmp_path / "run"), "--resume", "--quiet"]) == 2
    assert "a run of sac, which has no checkpoints: begin in another folder" in capsys.readouterr().err


def test_runs_and_policies_of_before_keep_their_meaning(tmp_path):
    """When "ppo" was the name of both, how far copies look ahead told them apart."""
    for before, now in (
        ({"algo": "ppo", "ahead": 4}, ("ppo-vine", True)),
        ({}, ("ppo-vine", True)),
        ({"algo": "ppo", "ahead": 0}, ("ppo", True)),
        ({"algo": "recurrent-ppo", "ahead": 0}, ("recurrent-ppo", True)),
    ):
        recipe = Recipe(**renamed(before))
        assert (recipe.algo, recipe.prepared) == now
    assert set(OTHERWISE) == set(ALGORITHMS)
    record = {"format": "drillenv-training/1", "timesteps": 5, "recipe": {"algo": "ppo", "ahead": 3, "lstm": 8}}
    (tmp_path / "config.json").write_text(json.dumps(record), encoding="utf-8")
    recipe, steps = read_config(tmp_path)
    assert (recipe.algo, recipe.ahead, recipe.lstm, recipe.prepared, steps) == ("ppo-vine", 3, 8, True, 5)
    former = read_policy(Path(__file__).parents[2] / "docs" / "league" / "policies" / "ppo-vine-0")
    assert former.provenance["algorithm"] == "ppo" and row_of(former) == "ppo-vine"
    assert row_of(read_policy(SHIPPED)) == "ppo-vine-randomised"


def test_ppo_on_prepared_rigs_has_numbers_that_go_with_them():
    recipe = Recipe(algo="ppo", prepared=True)
    assert recipe.gamma == USUAL["gamma"] and recipe.noise == CRITIC["noise"] and recipe.ahead == 0
    assert Recipe(algo="ppo").gamma == 0.99
