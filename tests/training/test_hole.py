"""Training and searching on DrillBit: costs are those of a scalar environment, and what is written plays."""

import json

import gymnasium as gym
import numpy as np
import pytest
import torch

from drillenv.controllers.hole.belief import CENTRE, Belief
from drillenv.controllers.hole.learned import HoleLearned, actions_of
from drillenv.controllers.hole.rules import HoleFixed, HoleRules
from drillenv.training import hole_headroom, hole_ppo, hole_search
from drillenv.training.sb3 import DrillVecEnv


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


def test_a_search_finds_no_worse_and_keeps_it(tmp_path, capsys):
    file = tmp_path / "best.json"
    assert hole_search.main(["fixed", "--candidates", "3", "--episodes", "2", "--json", str(file)]) == 0
    best = json.loads(file.read_text())
    assert best == json.loads(capsys.readouterr().out)
    first = {"frequency": 100.0, "amplitude": 0.4, "pressure": 0.7, "bit_depth": 1.5}
    assert best["cost"] <= hole_search.costs_per_metre(HoleFixed(**first), "train", 2).mean()
    again = hole_search.costs_per_metre(HoleFixed(**best["numbers"]), "train", 2).mean()
    assert again == pytest.approx(best["cost"])


@pytest.mark.slow
def test_ppo_writes_what_it_plays(tmp_path, capsys):
    points = hole_ppo.train(tmp_path / "p", 2 * 64 * 128, seed=1, gamma=0.99, threads=1)
    assert len(points) == 1 and points[0][0] == 2 * 64 * 128
    assert json.loads((tmp_path / "p" / "curve.json").read_text()) == points
    again = hole_search.costs_per_metre(HoleLearned(tmp_path / "p"), "validation", 30).mean()
    assert again == pytest.approx(points[0][1])


def test_an_untrained_policy_on_numpy_is_the_one_of_the_library(tmp_path):
    from stable_baselines3 import PPO

    rigs = hole_ppo.Believing(DrillVecEnv("drillenv/DrillBit-v0", 2, threads=1))
    model = PPO("MlpPolicy", rigs, policy_kwargs={"net_arch": [16, 8]}, seed=0, device="cpu")
    hole_ppo.write_policy(tmp_path / "p", hole_ppo.weights_of(model), {})
    learned = HoleLearned(tmp_path / "p")
    seen = rigs.reset()
    rng = np.random.default_rng(0)
    for _ in range(5):
        raw = rigs.venv.rigs._observations.copy()  # type: ignore[union-attr]
        with torch.no_grad():
            outputs = model.predict(seen, deterministic=True)[0]
        assert learned.act(raw, {}) == pytest.approx(actions_of(outputs, seen), abs=1e-5)
        seen = rigs.step(rng.uniform(-1, 1, (2, 4)))[0]


def test_a_hole_that_is_over_is_forgotten_and_its_end_kept():
    rigs = hole_ppo.Believing(DrillVecEnv("drillenv/DrillBit-v0", 2, threads=1, max_episode_steps=3))
    rigs.reset()
    action = np.array([hole_ppo.BEGIN, hole_ppo.BEGIN])
    for _ in range(2):
        known, _, dones, infos = rigs.step(action)
        assert not dones.any()
    known, _, dones, infos = rigs.step(action)
    assert dones.all()
    raw = rigs.venv.rigs._observations  # type: ignore[union-attr]
    assert known == pytest.approx(Belief(2).of(raw))
    last = np.stack([each["terminal_observation"] for each in infos])
    wear = CENTRE.size
    assert (last[:, wear] > 0.0).all() and (known[:, wear] == 0.0).all()


def test_the_table_of_a_record():
    rows = {
        name: {m: [c, 2 * c] for m in hole_headroom.MEASURES} | {"plan": [1.0, 2.0]}
        for name, c in (("oracle", 1.0), ("rules", 2.0))
    }
    record = {"rows": rows}
    found = hole_headroom.shares(record)
    assert found["oracle"] == pytest.approx([1.0, 1.0, 1.0])
    assert found["rules"] == pytest.approx([0.5, 0.5, 0.5])
    text = hole_headroom.table(record)
    assert text.index("| oracle |") < text.index("| rules |")


def test_a_record_of_something_else_is_refused(tmp_path, capsys):
    file = tmp_path / "r.json"
    file.write_text(json.dumps({"format": "other"}))
    assert hole_headroom.main(["--json", str(file)]) == 2
    assert "give another name" in capsys.readouterr().err
