"""Training on Ray: the rigs as it sees them, and, where Ray is installed, a small run on a local one."""

import sys

import numpy as np
import pytest

from drillenv import controllers
from drillenv.controllers.policies import actions_of
from drillenv.training import cluster
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe

SMALL = Recipe(
    algo="ppo",
    prepared=True,
    env="drillenv/Drill-v0",
    envs=3,
    stack=2,
    rollout=8,
    batch=8,
    epochs=1,
    layers=(8, 5),
    evaluate_every=0,
    seed=4,
)


def test_the_rigs_are_those_of_the_other_learner():
    """What the wrappers of Stable-Baselines3 give, over the end of an episode, where the next starts a step later."""
    learner = Learner(SMALL, threads=1)
    learner.stacked.seed(7)
    rigs = cluster.rigs_for(SMALL)({"num_envs": 3})
    seen, _ = rigs.reset(seed=7)
    expected = learner.stacked.reset()
    np.testing.assert_array_equal(seen, expected)
    assert rigs.observation_space.shape == seen.shape and rigs.single_observation_space.shape == (30,)
    actions = np.random.default_rng(0).uniform(-1, 1, (100, 3, 3)).astype(np.float32)
    for k, action in enumerate(actions):
        if k == 80:
            seen, rewards, *_ = rigs.step(action)
            assert not rewards.any()
            np.testing.assert_array_equal(seen, expected)
        seen, rewards, terminations, truncations, _ = rigs.step(action)
        expected, worth, dones, infos = learner.stacked.step(action)
        np.testing.assert_allclose(rewards, worth, rtol=1e-6)
        np.testing.assert_array_equal(terminations | truncations, dones)
        assert dones.all() if k == 79 else not dones.any()
        last = np.stack([info["terminal_observation"] for info in infos]) if k == 79 else expected
        np.testing.assert_array_equal(seen, last)
    learner.close()
    rigs.close()


@pytest.mark.parametrize(
    "arguments",
    [[], ["--runners", "-1"], ["--timesteps", "0"], ["--env", "CartPole-v1"], ["--out", "/dev/null/x"], ["--fast"]],
    ids=["no ray", "runners", "timesteps", "env", "folder", "option"],
)
def test_bad_input_gives_one_line(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.setitem(sys.modules, "ray", None)  # as where it is not installed
    assert cluster.main(["--out", str(tmp_path / "policy"), *arguments]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("error: ") and said.err.count("\n") == 1
    assert ("pip install drillenv[cluster]" in said.err) == (not arguments)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_run_on_a_local_ray(tmp_path):
    """The exported policy acts as the module of RLlib does, to 1e-5, and begins as the recipe says."""
    ray = pytest.importorskip("ray", reason="the extra cluster is not installed")
    import torch

    made = []

    original = cluster.learned

    def learned(algorithm, recipe, steps):
        policy = original(algorithm, recipe, steps)
        module = algorithm.get_module()
        rng = np.random.default_rng(0)
        seen = rng.normal(size=(50, 30)).astype(np.float32)
        with torch.no_grad():
            out = module.forward_inference({"obs": torch.from_numpy(seen)})
        made.append((seen, out["action_dist_inputs"][:, :3].numpy()))
        return policy

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "learned", learned)
        result = cluster.train(SMALL, 300, str(tmp_path / "policy"), runners=1)
    assert not ray.is_initialized() and 300 <= result["steps"] < 324 and np.isfinite(result["score"])
    driver = controllers.make("learned", policy=tmp_path / "policy")
    for seen, expected in zip(*made[0], strict=True):
        driver.reset()
        for each in seen.reshape(2, 15) * driver.policy.width + driver.policy.centre:
            action = driver.act(each, {})
        np.testing.assert_allclose(action, actions_of(expected), atol=1e-5)
