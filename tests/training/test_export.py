"""An exported policy acts as the one that was trained."""

import json

import numpy as np
import pytest

from drillenv import cli
from drillenv.controllers.learned import Learned
from drillenv.controllers.policies import actions_of, outputs_for, read_policy, write_policy
from drillenv.env.observation import HIGH, LOW, READINGS
from drillenv.training import train
from drillenv.training.export import policy_of, weights_of
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe
from drillenv.training.scaling import CENTRE, NOISES, WIDTH, Scaled, scaled

SMALL = {"env": "drillenv/Drill-v0", "envs": 2, "rollout": 8, "batch": 8, "epochs": 1, "evaluate_every": 0}
KINDS = {
    "plain": {"stack": 1, "layers": (16,), "activation": "tanh"},
    "relu": {"stack": 3, "layers": (32, 16, 8), "activation": "relu"},
    "shipped kind": {"stack": 4, "layers": (64, 64), "activation": "tanh"},
    "recurrent": {"algo": "recurrent-ppo", "stack": 1, "layers": (16,), "lstm": 24},
    "recurrent and stacked": {"algo": "recurrent-ppo", "stack": 2, "layers": (16, 16), "lstm": 8},
}


@pytest.fixture(params=KINDS)
def learner(request):
    made = Learner(Recipe(**SMALL, **KINDS[request.param], seed=4), threads=1)
    made.model.learn(3 * made.recipe.update)  # so that no weight is what it was drawn or set to
    yield made
    made.close()


def test_acts_as_the_original_to_1e_5(learner, tmp_path):
    """Over random observations in a row, with actions inside their bounds and at them."""
    recipe, model = learner.recipe, learner.model
    parameters = {name: value.numpy() for name, value in model.policy.state_dict().items()}
    write_policy(tmp_path, policy_of(weights_of(parameters, recipe), recipe, 0, None))
    driver = Learned(tmp_path)
    rng = np.random.default_rng(0)
    clipped = 0
    for episode in range(4):
        driver.reset(seed=episode)
        stacked = np.zeros((recipe.stack, CENTRE.size), dtype=np.float32)
        state, start = None, np.ones(1, dtype=bool)
        for _ in range(100):
            # about the readings that a policy meets, and anything its sensors could give
            near = CENTRE + 2.0 * WIDTH * rng.normal(size=CENTRE.size)
            seen = np.clip(near if episode < 2 else rng.uniform(LOW, HIGH), LOW, HIGH).astype(np.float32)
            stacked = np.vstack([stacked[1:], scaled(seen)])
            expected, state = model.policy.predict(
                stacked.reshape(1, -1), state=state, episode_start=start, deterministic=True
            )
            start[:] = False
            np.testing.assert_allclose(driver.act(seen, {}), actions_of(expected[0]), rtol=0, atol=1e-5)
            clipped += int((np.abs(expected) == 1.0).any())
    assert clipped < 400


def test_the_stack_is_that_of_training(learner):
    """The controller fed with what the rigs give acts as the model does on what its wrappers make of it, episode by
    episode, also where a new one begins."""
    recipe, model = learner.recipe, learner.model
    parameters = {name: value.numpy() for name, value in model.policy.state_dict().items()}
    driver = Learned(policy_of(weights_of(parameters, recipe), recipe, 0, None))
    learner.stacked.seed(5)
    seen = learner.stacked.reset()
    state, start = None, np.ones(recipe.envs, dtype=bool)
    driver.reset()
    for _ in range(90):  # an episode has 80 steps
        actions, state = model.policy.predict(seen, state=state, episode_start=start, deterministic=True)
        if start[0]:
            driver.reset()
        action = driver.act(learner.rigs.rigs._observations[0], {})
        np.testing.assert_allclose(action, actions_of(actions[0]), rtol=0, atol=1e-5)
        seen, _, start, _ = learner.stacked.step(actions)


def test_what_a_policy_asks_for_by_hand():
    """Low and high ends, the middle, and pressures that the cylinder cannot have."""
    asked = [[-1, -1, -1], [1, 1, 1], [0, 0, 0], [0.5, 2, -2], [9, 0.2, 0.4]]
    settings = [[50, 0.3, 0.39], [120, 0.6, 1.98], [85, 0.45, 1.035], [102.5, 0.6, 0.78], [120, 0.48, 1.296]]
    expected = [(np.clip(p, 0.6, 1.8) - 1.2) / 0.6 for *_, p in settings]
    actions = actions_of(np.array(asked, dtype=np.float32))
    assert actions.dtype == np.float32
    np.testing.assert_allclose(actions[:, 0], [(f - 85) / 35 for f, *_ in settings], atol=1e-6)
    np.testing.assert_allclose(actions[:, 1], [(a - 0.45) / 0.15 for _, a, _ in settings], atol=1e-6)
    np.testing.assert_allclose(actions[:, 2], expected, atol=1e-6)
    np.testing.assert_allclose(actions_of(outputs_for(110.0, 0.5, 1.1)), [25 / 35, 1 / 3, -1 / 6], atol=1e-6)


def test_rewards_and_last_observations_are_scaled():
    learner = Learner(Recipe(**SMALL, stack=2, gamma=0.9), threads=1)
    venv = learner.stacked.venv
    assert isinstance(venv, Scaled)
    venv.seed(0)
    venv.reset()
    for _ in range(80):
        _, rewards, dones, infos = venv.step(np.zeros((2, 3), dtype=np.float32))
        np.testing.assert_allclose(
            rewards, 0.1 * learner.rigs.rigs._batch.rewards, rtol=1e-5
        ) if not dones.any() else None
    assert dones.all()
    for info in infos:
        assert info["TimeLimit.truncated"]
        # the setting in the middle of all ranges, as the action asked for: 85 Hz, 0.45 V, 2.3 bar/V
        last = info["terminal_observation"] * WIDTH + CENTRE
        np.testing.assert_allclose(last[11:14], [85.0, 0.45, 1.035], rtol=1e-5)
    learner.close()


@pytest.mark.slow
def test_the_scaling_is_what_its_table_says():
    """Mean and spread of the readings under the rules and at random settings, over the scenario train."""
    from drillenv import controllers
    from drillenv.env.vector import DrillVectorEnv

    rows = []
    for name in ("random", "rules"):
        n = 40
        envs = DrillVectorEnv(n, kind="layers", scenario="train")
        seen, _ = envs.reset(seed=0, options={"episode": list(range(n))})
        drivers = [controllers.make(name) for _ in range(n)]
        for i, driver in enumerate(drivers):
            driver.reset(seed=i)
        for _ in range(120):
            seen, *_ = envs.step(np.stack([driver.act(seen[i], {}) for i, driver in enumerate(drivers)]))
            rows.append(seen)
    readings = np.concatenate(rows).astype(float)
    spread = np.maximum(readings.std(axis=0), [NOISES * reading.noise for reading in READINGS])
    assert (np.abs(readings.mean(axis=0) - CENTRE) < 0.15 * spread).all()
    np.testing.assert_allclose(WIDTH, spread, rtol=0.15)


def test_export_of_a_run(tmp_path, capsys):
    recipe = Recipe(**(SMALL | {"evaluate_every": 32, "episodes": 1}), layers=(8,), seed=1)
    result = train.train(recipe, 96, tmp_path / "run", quiet=True, threads=1)
    for which in ("best", "last"):
        arguments = ["--run", str(tmp_path / "run"), "--out", str(tmp_path / which), "--which", which]
        assert cli.main(["export", *arguments]) == 0
        for name in ("policy.safetensors", "policy.json"):
            if which == "last" and name == "policy.json":
                continue  # the run has scored its last policy, which the checkpoint does not know yet
            kept = (tmp_path / "run" / which / name).read_bytes()
            if which == "best" and result["best_steps"] == 96:
                continue  # likewise
            assert (tmp_path / which / name).read_bytes() == kept
    assert read_policy(tmp_path / "last").provenance["steps"] == 96
    provenance = json.loads((tmp_path / "run" / "best" / "policy.json").read_text())["provenance"]
    assert provenance["seed"] == 1 and provenance["score"] == result["best_score"]
    capsys.readouterr()
    for arguments in (
        ["--run", str(tmp_path / "nothing"), "--out", str(tmp_path / "x")],
        ["--run", str(tmp_path / "run"), "--out", str(tmp_path / "x"), "--which", "first"],
        ["--run", str(tmp_path / "run")],
        ["--run", str(tmp_path / "run"), "--out", "/dev/null/x"],
    ):
        assert cli.main(["export", *arguments]) == 2
        said = capsys.readouterr()
        assert said.out == "" and said.err.startswith("drillenv: ") and said.err.count("\n") == 1
    assert not (tmp_path / "x").exists()
