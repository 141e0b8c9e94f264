"""Stable-Baselines3 on the native vector environment: what its own DummyVecEnv makes of scalar ones, only faster."""

import copy
import math
import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest

import drillenv  # noqa: F401
from drillenv.checks import InputError
from drillenv.env.registration import IDS, STEPS

pytest.importorskip("stable_baselines3", exc_type=ImportError)
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecCheckNan, VecMonitor, VecNormalize

from drillenv.training.sb3 import INFO_KEYS, DrillVecEnv

LAYERS = "drillenv/DrillLayers-v0"
each_id = pytest.mark.parametrize("identity", IDS)


@each_id
@pytest.mark.parametrize("actions", ["absolute", "increment"])
@pytest.mark.parametrize("observations", ["readings", "window"])
def test_checker_of_stable_baselines(identity, actions, observations):
    """Without a warning; a window of four channels is flattened first, as the checker itself advises."""
    env = gym.make(identity, actions=actions, observations=observations).unwrapped
    if observations == "window":
        env = gym.wrappers.FlattenObservation(env)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)


def test_what_the_checker_says_of_a_window():
    """One warning only: that it is neither a vector nor a picture."""
    with pytest.warns(UserWarning, match="unconventional shape") as said:
        check_env(gym.make(LAYERS, observations="window").unwrapped)
    assert len(said) == 1


@pytest.mark.parametrize("observations", ["readings", "window"])
@pytest.mark.parametrize(("identity", "n", "steps"), [(IDS[0], 3, 60), (LAYERS, 4, 60), (IDS[2], 2, 15)])
def test_as_a_dummy_vec_env(identity, n, steps, observations):
    """Bit for bit: observations, rewards, ends, infos, terminal observations, seeds."""
    arguments = {"max_episode_steps": 7, "observations": observations}
    ours = DrillVecEnv(identity, n, info_keys=INFO_KEYS, **arguments)
    theirs = DummyVecEnv([lambda: gym.make(identity, **arguments) for _ in range(n)])
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.render_mode == theirs.render_mode
    assert ours.seed(9) == theirs.seed(9)
    assert ours.reset().tobytes() == theirs.reset().tobytes()
    assert ours.reset_infos == theirs.reset_infos
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(steps):
        actions = rng.uniform(-1, 1, (n, 3)).astype(np.float32)
        got, expected = ours.step(actions), theirs.step(actions)
        for one, other in zip(got[:3], expected[:3], strict=True):
            assert one.dtype == other.dtype
            assert one.tobytes() == other.tobytes()
        for one, other in zip(got[3], expected[3], strict=True):
            assert set(one) == set(other)
            last, last_of_theirs = one.pop("terminal_observation", None), other.pop("terminal_observation", None)
            assert one == other
            if last is not None:
                ends += 1
                assert one["TimeLimit.truncated"] is True
                assert last.tobytes() == last_of_theirs.tobytes()
                assert last in ours.observation_space
        assert ours.reset_infos == theirs.reset_infos
    assert ends == n * (steps // 7)
    # without a new seed both go on from where their generators stand
    assert ours.reset().tobytes() == theirs.reset().tobytes()
    ours.close()
    ours.close()


def test_terminal_observation_is_that_of_the_episode_that_ended():
    """By another way: a scalar environment without a time limit sees the same observation and goes on."""
    envs = DrillVecEnv(LAYERS, 2, max_episode_steps=5)
    envs.seed(3)
    envs.reset()
    env = gym.make(LAYERS).unwrapped
    env.reset(seed=4)
    action = np.full((2, 3), 0.3, dtype=np.float32)
    for step in range(5):
        observations, rewards, dones, infos = envs.step(action)
        seen, reward, *_ = env.step(action[1])
        assert dones.tolist() == [step == 4] * 2
        assert rewards[1] == np.float32(reward)
    assert infos[1]["terminal_observation"].tobytes() == seen.tobytes()
    assert observations[1].tobytes() != seen.tobytes()
    assert observations[1].tobytes() == env.reset()[0].tobytes()
    # what was handed out is the caller's
    kept = infos[1]["terminal_observation"].copy()
    envs.step(action)
    observations[:] = 0
    assert (infos[1]["terminal_observation"] == kept).all()


def test_infos_hold_what_was_asked_for():
    assert DrillVecEnv(LAYERS).reset().shape == (1, 15)
    for keys in ((), ("cost",), ["motion", "penetration_rate"], INFO_KEYS):
        envs = DrillVecEnv(LAYERS, 3, info_keys=keys, max_episode_steps=2)
        envs.reset()
        assert [set(info) for info in envs.reset_infos] == [set(keys)] * 3
        infos = envs.step(np.zeros((3, 3)))[3]
        assert [set(info) for info in infos] == [{*keys, "TimeLimit.truncated"}] * 3
        assert len({id(info) for info in infos}) == 3
        infos = envs.step(np.zeros((3, 3)))[3]
        assert [set(info) for info in infos] == [{*keys, "TimeLimit.truncated", "terminal_observation"}] * 3
        for key in keys:
            assert type(infos[0][key]) is (str if key == "motion" else float)
    # all there is, and all of it is there
    _seen, info = gym.make(LAYERS).reset(seed=0)
    assert set(info) == set(INFO_KEYS)


def test_monitor_adds_up_episodes(tmp_path):
    steps = 6
    envs = VecMonitor(
        DrillVecEnv(LAYERS, 3, info_keys=("cost",), max_episode_steps=steps), str(tmp_path / "log"), ("cost",)
    )
    envs.seed(1)
    envs.reset()
    rng = np.random.default_rng(1)
    total, episodes = np.zeros(3, dtype=np.float32), []
    for _ in range(3 * steps):
        _seen, rewards, dones, infos = envs.step(rng.uniform(-1, 1, (3, 3)))
        total += rewards
        for i in np.flatnonzero(dones):
            assert infos[i]["episode"]["r"] == pytest.approx(total[i], rel=1e-5)
            assert infos[i]["episode"]["l"] == steps
            assert infos[i]["episode"]["cost"] == infos[i]["cost"]
            episodes.append(total[i])
            total[i] = 0
    envs.close()
    assert len(episodes) == 9
    lines = (tmp_path / "log.monitor.csv").read_text().splitlines()
    assert LAYERS in lines[0]
    np.testing.assert_allclose([float(line.split(",")[0]) for line in lines[2:]], episodes, rtol=1e-4)


def test_no_episode_ends_early():
    envs = DrillVecEnv(IDS[0], 1)
    envs.reset()
    dones = [bool(envs.step(np.zeros((1, 3)))[2][0]) for _ in range(STEPS["Drill"])]
    assert dones == [False] * (STEPS["Drill"] - 1) + [True]


# --- Attributes and methods


def test_attributes_are_honest():
    envs = DrillVecEnv(LAYERS, 3, reward={"force": 1.0})
    envs.seed(5)
    envs.reset()
    assert envs.get_attr("render_mode") == [None] * 3
    assert [task.reward.force for task in envs.get_attr("task", [0, 2])] == [1.0] * 2
    assert envs.get_attr("np_random_seed") == [5, 6, 7]
    assert envs.get_attr("np_random_seed", 2) == [7]
    assert envs.get_attr("observation_space", 0)[0].shape == (15,)
    assert envs.get_attr("spec")[0].id == envs.spec.id == LAYERS
    assert envs.has_attr("np_random")
    assert not envs.has_attr("unheard_of")
    assert not envs.has_attr("action_masks")
    with pytest.raises(AttributeError, match="unheard_of"):
        envs.get_attr("unheard_of")
    with pytest.raises(AttributeError, match="noise"):
        envs.set_attr("noise", 0.0)
    assert envs.env_is_wrapped(Monitor) == [False] * 3
    assert envs.env_is_wrapped(gym.wrappers.TimeLimit, [1]) == [False]
    assert list(envs.get_images()) == [None] * 3
    for indices in (3, [-1], "1"):
        with pytest.raises(InputError):
            envs.get_attr("task", indices)


def test_states_through_methods():
    envs = DrillVecEnv(LAYERS, 3)
    envs.seed(5)
    envs.reset()
    envs.step(np.zeros((3, 3)))
    states = envs.env_method("get_state")
    first = envs.step(np.full((3, 3), 0.5))[0]
    for i, state in enumerate(states):
        assert envs.env_method("set_state", state, indices=i) == [None]
    assert envs.step(np.full((3, 3), 0.5))[0].tobytes() == first.tobytes()
    # one rig's future in all of them
    envs.env_method("set_state", states[1])
    assert envs.step(np.full((3, 3), 0.5))[0].tobytes() == np.repeat(first[1:2], 3, axis=0).tobytes()
    with pytest.raises(InputError, match="state"):
        envs.env_method("set_state", None)
    for method in ("render", "close", "_restart", "compute_reward"):
        with pytest.raises(AttributeError, match=method):
            envs.env_method(method)


def test_options_and_seeds_of_the_next_reset():
    envs = DrillVecEnv(LAYERS, 3, scenario="test")
    alone = gym.make(LAYERS, scenario="test")
    envs.seed(7)
    envs.set_options([{"episode": 4}, {}, {"episode": 9}])
    seen = envs.reset()
    for i, options in enumerate(({"episode": 4}, {}, {"episode": 9})):
        assert seen[i].tobytes() == alone.reset(seed=7 + i, options=options)[0].tobytes()
    envs.seed(7)
    envs.set_options({"episode": 4})
    assert envs.reset()[0].tobytes() == seen[0].tobytes()
    # used once
    assert envs.reset()[0].tobytes() != seen[0].tobytes()
    for options in ({"epsiode": 1}, [{"episode": 1}] * 2, [1, 2, 3], [{"episode": 1}, {"episode": 99}, {}]):
        envs.set_options(options)
        before = pickle.dumps(envs.env_method("get_state"))
        with pytest.raises(InputError) as raised:
            envs.reset()
        assert "\n" not in str(raised.value)
        assert pickle.dumps(envs.env_method("get_state")) == before


def test_copies():
    envs = DrillVecEnv(LAYERS, 40, threads=2)
    envs.seed(0)
    envs.reset()
    actions = np.zeros((40, 3))
    twins = [pickle.loads(pickle.dumps(envs)), copy.deepcopy(envs)]
    first = envs.step(actions)[0]
    for twin in twins:
        assert twin.step(actions)[0].tobytes() == first.tobytes()


@pytest.mark.parametrize(
    "arguments",
    [
        {"id": "CartPole-v1"},
        {"id": "drillenv/Drill-v9"},
        {"id": None},
        {"num_envs": 0},
        {"num_envs": 1.5},
        {"info_keys": "cost"},
        {"info_keys": ["costs"]},
        {"info_keys": 3},
        {"info_keys": [None]},
        {"threads": 0},
        {"rock": "granite"},
        {"max_episode_steps": 0},
    ],
    ids=str,
)
def test_bad_arguments(arguments):
    with pytest.raises(InputError) as raised:
        DrillVecEnv(**({"id": LAYERS, "num_envs": 2} | arguments))
    assert "\n" not in str(raised.value)


def test_bad_actions_leave_the_rigs_alone():
    envs = DrillVecEnv(LAYERS, 2)
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((2, 3)))
    envs.reset()
    before = pickle.dumps(envs.env_method("get_state"))
    for bad in (np.full((2, 3), math.nan), np.full((2, 3), 2.0), np.zeros((3, 3)), np.zeros(3), None):
        with pytest.raises(InputError):
            envs.step(bad)
    assert pickle.dumps(envs.env_method("get_state")) == before


# --- Algorithms


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_algorithms_learn_on_it(algorithm):
    """Alike on the adapter and on scalar environments: the same seeds give the same policy."""
    policies = []
    for make in (
        lambda: DrillVecEnv(IDS[0], 4, max_episode_steps=10),
        lambda: DummyVecEnv([lambda: gym.make(IDS[0], max_episode_steps=10) for _ in range(4)]),
    ):
        envs = VecNormalize(VecCheckNan(VecMonitor(make()), raise_exception=True))
        own = {"n_steps": 32, "batch_size": 64} if algorithm is PPO else {"learning_starts": 64, "batch_size": 64}
        model = algorithm("MlpPolicy", envs, seed=1, policy_kwargs={"net_arch": [16]}, device="cpu", **own)
        model.learn(256)
        policies.append([value.numpy().copy() for value in model.policy.state_dict().values()])
        assert len(model.ep_info_buffer) >= 20
        returns, lengths = evaluate_policy(model, envs, 4, return_episode_rewards=True)
        assert lengths == [10] * 4
        assert np.isfinite(returns).all()
        envs.close()
    for one, other in zip(*policies, strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.slow
def test_only_training_knows_torch():
    """The environments do without it: nothing of drillenv imports what only training needs."""
    code = (
        "import sys, gymnasium as gym, drillenv\n"
        f"gym.make({LAYERS!r}).reset(seed=0); gym.make_vec({LAYERS!r}, 2).reset(seed=0)\n"
        "print([name for name in ('torch', 'stable_baselines3', 'sb3_contrib', 'tensorboard') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
