"""PPO on a budget of force above the rating: the multiplier, the run, what it says, and its row in the league."""

import json

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

from drillenv import cli, controllers
from drillenv.checks import InputError
from drillenv.controllers.policies import read_policy
from drillenv.env.registration import BUDGETS
from drillenv.env.truth import T_EXCESS
from drillenv.training import checkpoint, train
from drillenv.training.evaluate import entries, read_record
from drillenv.training.evaluation import Evaluation, better
from drillenv.training.export import exported, read_config
from drillenv.training.lagrangian import Priced
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe
from drillenv.training.rollout import rollout

SMALL = {
    "algo": "ppo-lagrangian",
    "env": "drillenv/Drill-v0",
    "envs": 4,
    "rollout": 8,
    "batch": 16,
    "epochs": 2,
    "layers": (16,),
    "episodes": 2,
}
STEPS = 12 * 32
"""Twelve updates; an episode of 80 steps ends in the tenth."""


class Costly(gym.Env):
    """Earns 1 mm/s a step, at costs in N that are given step by step."""

    observation_space = action_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, costs):
        self.costs = iter(costs)

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 1.0, False, False, {"cost": next(self.costs)}


def test_the_multiplier_rises_above_the_limit_and_falls_to_0_below_it():
    """By hand: the limit is 10 N, the rate 0.5 mm/s a kN for each N, and no gain."""
    rollouts = [
        [(30.0, 10.0), (20.0, 20.0)],  # 20 N in the mean: 0 + 0.5 * 10
        [(12.0, 12.0)],  # 5 + 0.5 * 2
        [(10.0, 10.0), (0.0, 20.0)],  # at the limit it stays
        [(2.0, 2.0), (6.0, 6.0)],  # 6 - 0.5 * 6
        [(0.0, 0.0)],  # 3 - 0.5 * 10 is below 0
        [(0.0, 0.0)],
        [(14.0, 14.0)],  # nothing was saved up while it was 0
    ]
    of_each = zip(*(costs for steps in rollouts for costs in steps), strict=True)
    priced = Priced(DummyVecEnv([lambda costs=costs: Costly(costs) for costs in of_each]), 10.0, rate=0.5, gain=0.0)
    priced.reset()
    assert priced.multiplier == 0.0 and priced.cost is None
    found, means = [], []
    for steps in rollouts:
        before = priced.multiplier
        for costs in steps:
            _, rewards, _, _ = priced.step(np.zeros((2, 1)))
            assert rewards.dtype == np.float32
            # the multiplier is in mm/s for 1 kN
            np.testing.assert_allclose(rewards, 1.0 - before * np.array(costs) / 1000.0, rtol=1e-6)
        priced.ascend()
        found.append(priced.multiplier)
        means.append(priced.cost)
    assert found == [5.0, 6.0, 6.0, 3.0, 0.0, 0.0, 2.0]
    assert means == [20.0, 12.0, 10.0, 4.0, 0.0, 0.0, 14.0]
    assert priced.as_record() == {"cost_limit": 10.0, "rollout_cost": 14.0, "multiplier": 2.0}


def test_the_gain_goes_by_the_last_rollout_alone():
    """By hand: the limit is 10 N, the rate 0.5 and the gain 2 mm/s a kN for each N."""
    costs = [20.0, 12.0, 10.0, 4.0, 13.0]
    priced = Priced(DummyVecEnv([lambda: Costly(costs)]), 10.0, rate=0.5, gain=2.0)
    priced.reset()
    found = []
    for _ in costs:
        priced.step(np.zeros((1, 1)))
        priced.ascend()
        found.append((priced.ascended, priced.multiplier))
    # 5 + 20, 6 + 4, 6 + 0, 3 - 12 is below 0, 4.5 + 6
    assert found == [(5.0, 25.0), (6.0, 10.0), (6.0, 6.0), (3.0, 0.0), (4.5, 10.5)]


@pytest.mark.parametrize("prepared", [False, True])
def test_the_price_is_what_the_weight_of_the_force_would_be(prepared):
    """At a multiplier of 5 mm/s a kN the rewards are those of the environment, whose weight that is."""
    seen = []
    for algo in ("ppo-lagrangian", "ppo"):
        learner = Learner(Recipe(**{**SMALL, "algo": algo}, prepared=prepared, gamma=0.5), threads=1)
        if learner.priced is not None:
            learner.priced.ascended = 5.0
        learner.rigs.seed(3)
        learner.stacked.reset()
        harsh = np.full((4, 3), 0.9, dtype=np.float32)
        seen.append([learner.stacked.step(harsh)[1] for _ in range(20)])
        if learner.priced is not None:
            learner.priced.ascend()
            assert learner.priced.cost is not None and learner.priced.cost > 100.0
        learner.close()
    np.testing.assert_allclose(*seen, rtol=1e-5, atol=1e-5)


def test_a_run_says_return_cost_and_multiplier_and_is_exported(tmp_path, capsys):
    given = ["--env", "drillenv/Drill-v0", "--envs", "4", "--rollout", "8", "--batch", "16", "--episodes", "2"]
    wanted = ["--algo", "ppo-lagrangian", "--cost-limit", "3", "--multiplier-rate", "0.1", "--evaluate-every", "64"]
    out = tmp_path / "run"
    run = ["--out", str(out), "--timesteps", "128", "--quiet", "--threads", "1"]
    assert cli.main(["train", *given, *wanted, *run]) == 0
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert [steps for steps, _ in result["scores"]] == [steps for steps, _ in result["costs"]] == [64, 128]
    assert result["cost_limit"] == 3.0 and result["rollout_cost"] > 3.0 and result["multiplier"] > 0.0
    assert f"limit 3 N, multiplier {result['multiplier']:.3f} mm/s a kN" in capsys.readouterr().out
    recipe, _ = read_config(out)
    assert recipe.cost_limit == 3.0 and recipe.env_kwargs == {"reward": {"force": 0.0}}
    # score and cost are those of the exported policy, by the reward without force
    assert cli.main(["export", "--run", str(out), "--which", "last", "--out", str(tmp_path / "policy")]) == 0
    policy = read_policy(tmp_path / "policy")
    assert policy.provenance["algorithm"] == "ppo-lagrangian" and policy.provenance["cost_limit"] == 3.0
    made = rollout(lambda: controllers.make("learned", policy=tmp_path / "policy"), "Drill", "validation", 2,
                   arguments={"reward": {"force": 0.0}})  # fmt: skip
    assert made.scores.mean() == pytest.approx(result["score"], rel=1e-3)
    assert made.truths[..., T_EXCESS].mean() == pytest.approx(result["cost"], rel=1e-2, abs=0.1)
    assert isinstance(PPO.load(out / "last.zip", device="cpu"), PPO)


@pytest.mark.slow
@pytest.mark.parametrize("prepared", [False, True])
def test_it_goes_on_exactly(tmp_path, prepared):
    recipe = Recipe(**SMALL, prepared=prepared, evaluate_every=128, seed=7, multiplier_rate=0.3)
    whole = train.train(recipe, 2 * STEPS, tmp_path / "whole", threads=1, quiet=True)
    train.train(recipe, STEPS, tmp_path / "halves", threads=1, quiet=True)
    taken, _ = checkpoint.latest(tmp_path / "halves" / "checkpoints")
    assert taken is not None and taken.record["budget"]["ascended"] > 0.0
    resumed = train.train(recipe, 2 * STEPS, tmp_path / "halves", resume=True, threads=2, quiet=True)
    for file in ("policy.safetensors", "optimizer.safetensors", "arrays.npz", "best.safetensors"):
        ends = [tmp_path / run / "checkpoints" / f"{2 * STEPS:012d}" / file for run in ("whole", "halves")]
        assert ends[0].read_bytes() == ends[1].read_bytes(), file
    for name in ("score", "cost", "scores", "costs", "best_score", "best_cost", "rollout_cost", "multiplier"):
        assert resumed[name] == whole[name], name
    assert exported(tmp_path / "halves").provenance["steps"] == resumed["best_steps"]


def test_without_a_multiplier_in_it_a_checkpoint_is_of_another_recipe(tmp_path):
    learner = Learner(Recipe(**{**SMALL, "algo": "ppo"}), threads=1)
    learner.model.learn(32)
    other = Learner(Recipe(**SMALL), threads=1)
    with pytest.raises(InputError, match="the checkpoint does not fit this recipe"):
        checkpoint.put(other, checkpoint.take(learner, {}))


def test_the_best_policy_keeps_to_the_budget():
    recipe = Recipe(**SMALL, cost_limit=10.0)
    within, without = Evaluation(1.0, 9.0), Evaluation(2.0, 11.0)
    assert better(within, without, recipe) and not better(without, within, recipe)
    assert better(Evaluation(1.1, 10.0), within, recipe)  # what is not used of the budget is worth nothing
    assert better(Evaluation(0.1, 10.5), without, recipe)  # nearer to it
    plain = Recipe(**{**SMALL, "algo": "ppo"})
    assert better(without, within, plain) and not better(within, without, plain)


def test_the_budget_is_that_of_the_environment():
    for name, budget in BUDGETS.items():
        assert Recipe(env=f"drillenv/{name}-v0", algo="ppo-lagrangian").cost_limit == budget
    weights = {"reward": {"energy": 0.0}}
    assert Recipe(**SMALL, env_kwargs=weights).env_kwargs == {"reward": {"energy": 0.0, "force": 0.0}}
    assert Recipe(**SMALL, env_kwargs={"reward": None}).env_kwargs == {"reward": {"force": 0.0}}


BAD = {
    "negative": (["--cost-limit", "-5"], "cost_limit is -5 N, outside 0 to 100000 N: give a value from 0"),
    "no number": (["--cost-limit", "nan"], "cost_limit is nan: give a finite number from 0 to 100000 N"),
    "a word": (["--cost-limit", "few"], "argument --cost-limit: 'few' is not a number"),
    "rate": (["--multiplier-rate", "0"], "multiplier_rate is 0 mm/s a kN, outside 1e-06 to 1000 mm/s a kN"),
    "gain": (["--multiplier-gain", "-1"], "multiplier_gain is -1 mm/s a kN, outside 0 to 1000 mm/s a kN"),
    "other algorithm": (["--algo", "ppo", "--cost-limit", "0"], "--cost-limit has no use with ppo: leave it out"),
    "prepared ppo": (["--algo", "ppo", "--prepared", "--cost-limit", "5"], "--cost-limit has no use with ppo"),
    "weight": (["--env-kwargs", '{"reward": {"force": 5.0}}'], "reward force is 5.0, but ppo-lagrangian finds"),
    "reward": (["--env-kwargs", '{"reward": 3}'], "reward is 3: give a record of weights"),
    "hole": (
        ["--env", "drillenv/DrillBit-v0"],
        "is a hole, which ppo-lagrangian does not learn: give ppo-vine, ppo, recurrent-ppo, sac, td3",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_line(case, tmp_path, capsys):
    arguments, said = BAD[case]
    given = ["train", "--algo", "ppo-lagrangian", "--out", str(tmp_path / "out"), "--quiet", *arguments]
    assert cli.main(given) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("drillenv: ") and err.count("\n") == 1
    assert said in err
    assert not (tmp_path / "out").exists()


def test_its_row_in_the_league_says_the_mean_cost(tmp_path, capsys):
    folders = []
    for seed in (0, 1):
        out = tmp_path / f"run-{seed}"
        train.train(Recipe(**SMALL, evaluate_every=0, seed=seed), 32, out, threads=1, quiet=True)
        folders.append(str(out / "last"))
    wanted = entries(["ppo-lagrangian"], folders)
    assert list(wanted) == ["ppo-lagrangian"] and [run.seed for run in wanted["ppo-lagrangian"]] == [0, 1]
    file = str(tmp_path / "league.json")
    few = ["--scenario", "validation", "--environment", "Drill", "--episodes", "1", "--steps", "4", "--threads", "1"]
    asked = ["--controllers", "fixed", "ppo-lagrangian", "--policies", *folders, "--json", file]
    assert cli.main(["league", *asked, *few]) == 0
    record = read_record(file)
    assert "| cost, N |" in capsys.readouterr().out
    for run, (folder, kept) in enumerate(zip(folders, record["runs"]["ppo-lagrangian"], strict=True)):
        made = rollout(lambda folder=folder: controllers.make("learned", policy=folder), "Drill", "validation", 1, 4)
        cost = made.truths[..., T_EXCESS].mean()
        assert kept["seed"] == run and kept["episodes"]["cost"] == [pytest.approx(cost, abs=0.05)]
    costs = [run["episodes"]["cost"][0] for run in record["runs"]["ppo-lagrangian"]]
    assert record["summary"]["rows"]["ppo-lagrangian"]["cost"][0] == pytest.approx(np.mean(costs))
