"""Clones, copies, pickles, processes: a point of an episode goes on from anywhere as it would have gone on here."""

import copy
import hashlib
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import drillenv  # noqa: F401
from drillenv.env.registration import IDS

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this platform")
MODES = [("absolute", "readings"), ("increment", "readings"), ("absolute", "window"), ("increment", "window")]
each_mode = pytest.mark.parametrize(("actions", "observations"), MODES)
each_id = pytest.mark.parametrize("identity", IDS)


def drawn_actions(steps, n=None, seed=5):
    shape = (steps, 3) if n is None else (steps, n, 3)
    return np.random.default_rng(seed).uniform(-1, 1, shape).astype(np.float32)


def steps_of(env, actions):
    """Every bit of what the steps give."""
    return [pickle.dumps(flat(env.step(action))) for action in actions]


def flat(step):
    observation, reward, terminated, truncated, info = step
    infos = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in info.items()}
    return observation.tobytes(), np.asarray(reward).tolist(), bool(np.any(terminated)), bool(np.any(truncated)), infos


def native(identity, n, **arguments):
    return gym.make_vec(identity, n, vectorization_mode="vector_entry_point", **arguments)


@each_id
@each_mode
def test_step_restore_step(identity, actions, observations):
    env = gym.make(identity, actions=actions, observations=observations).unwrapped
    env.reset(seed=2)
    steps_of(env, drawn_actions(5))
    state = env.get_state()
    first = steps_of(env, drawn_actions(6, seed=6))
    env.set_state(state)
    assert steps_of(env, drawn_actions(6, seed=6)) == first
    assert first != steps_of(env, drawn_actions(6, seed=6))
    # also after another episode, and in another environment that was never reset
    env.reset(seed=77)
    env.set_state(state)
    assert steps_of(env, drawn_actions(6, seed=6)) == first
    other = gym.make(identity, actions=actions, observations=observations).unwrapped
    other.set_state(state)
    assert steps_of(other, drawn_actions(6, seed=6)) == first


@each_id
@each_mode
def test_step_restore_step_of_a_vector(identity, actions, observations):
    envs = native(identity, 3, actions=actions, observations=observations)
    envs.reset(seed=2)
    steps_of(envs, drawn_actions(4, 3))
    states = [envs.get_state(i) for i in range(3)]
    first = steps_of(envs, drawn_actions(4, 3, seed=6))
    for i, state in enumerate(states):
        envs.set_state(state, [i])
    assert steps_of(envs, drawn_actions(4, 3, seed=6)) == first


@each_id
@each_mode
def test_many_futures_from_one_present(identity, actions, observations):
    """A scalar's state in every rig of a vector, and a rig's state in a scalar."""
    env = gym.make(identity, actions=actions, observations=observations).unwrapped
    env.reset(seed=3)
    steps_of(env, drawn_actions(4))
    state = env.get_state()
    envs = native(identity, 3, actions=actions, observations=observations)
    envs.set_state(state)
    tried = drawn_actions(3, 3, seed=8)
    futures = [envs.step(each) for each in tried]
    for i in range(3):
        env.set_state(state)
        for step, (seen, rewards, _terminations, _truncations, infos) in zip(tried, futures, strict=True):
            observation, reward, _terminated, _truncated, info = env.step(step[i])
            assert observation.tobytes() == seen[i].tobytes()
            assert reward == rewards[i]
            assert info == {key: infos[key][i] for key in info}
        back = envs.get_state(i)
        assert pickle.dumps(back.rig.arrays) == pickle.dumps(env.get_state().rig.arrays)
        assert back.noise == env.get_state().noise
        env.set_state(back)
        assert np.isfinite(env.step(tried[0, 0])[1])


def test_a_state_stands_still():
    """What is done to the environment, or with the state, changes neither the state nor its copies."""
    env = gym.make("drillenv/DrillLayers-v0", observations="window").unwrapped
    env.reset(seed=2)
    state = env.get_state()
    before = pickle.dumps(state)
    steps_of(env, drawn_actions(3))
    env.set_state(state)
    steps_of(env, drawn_actions(3))
    env.reset(seed=9)
    assert pickle.dumps(state) == before


@each_id
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x)), copy.copy], ids=["deepcopy", "pickle", "copy"]
)
def test_copies_of_a_state(identity, copied):
    env = gym.make(identity).unwrapped
    env.reset(seed=2)
    env.step(np.zeros(3))
    state = env.get_state()
    first = steps_of(env, drawn_actions(4))
    env.set_state(copied(state))
    assert steps_of(env, drawn_actions(4)) == first


@each_id
@each_mode
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))], ids=["copy", "pickle"])
def test_copies_of_an_environment(identity, actions, observations, copied):
    """Before reset, in an episode, and in the wrappers that gym.make adds; the two then go separate ways."""
    arguments = {"actions": actions, "observations": observations, "noise": 2.0, "reward": {"force": 1.0}}
    for env in (gym.make(identity, **arguments), native(identity, 2, **arguments)):
        n = getattr(env, "num_envs", None)
        unused = copied(env)
        unused.reset(seed=1)
        env.reset(seed=1)
        steps_of(env, drawn_actions(3, n))
        twin = copied(env)
        first = steps_of(env, drawn_actions(4, n, seed=6))
        assert steps_of(twin, drawn_actions(4, n, seed=6)) == first
        steps_of(unused, drawn_actions(3, n))
        assert steps_of(unused, drawn_actions(4, n, seed=6)) == first
        assert env.reset()[0].tobytes() == twin.reset()[0].tobytes()


def test_the_time_limit_is_copied_too():
    env = gym.make("drillenv/Drill-v0", max_episode_steps=5)
    env.reset(seed=0)
    for _ in range(4):
        assert not env.step(np.zeros(3))[3]
    twin = pickle.loads(pickle.dumps(env))
    assert twin.step(np.zeros(3))[3]
    assert env.step(np.zeros(3))[3]


def test_threads_are_not_copied():
    envs = native("drillenv/DrillLayers-v0", 40, threads=2)
    envs.reset(seed=0)
    first = steps_of(pickle.loads(pickle.dumps(envs)), drawn_actions(2, 40))
    assert steps_of(copy.deepcopy(envs), drawn_actions(2, 40)) == first
    assert steps_of(envs, drawn_actions(2, 40)) == first


# --- Processes

ROLLOUT = """
import hashlib
import gymnasium as gym
import numpy as np
import drillenv

for identity, n, steps in (
    ("drillenv/Drill-v0", 1, 200), ("drillenv/DrillLayers-v0", 5, 300), ("drillenv/DrillHidden-v0", 1, 30)
):
    digest = hashlib.sha256()
    actions = np.random.default_rng(4).uniform(-1, 1, (steps, n, 3)).astype(np.float32)
    env = gym.make(identity) if n == 1 else gym.make_vec(identity, n)
    digest.update(env.reset(seed=12)[0].tobytes())
    for action in actions:
        observation, reward, _, truncated, info = env.step(action[0] if n == 1 else action)
        digest.update(observation.tobytes())
        digest.update(repr([(key, np.asarray(value).tolist()) for key, value in sorted(info.items())]).encode())
        digest.update(np.asarray(reward).tobytes())
        if n == 1 and truncated:
            digest.update(env.reset()[0].tobytes())
    print(digest.hexdigest())
"""


@pytest.mark.slow
def test_two_processes_with_one_seed_agree(tmp_path):
    """Also with another hash seed, which orders sets anew, and with one thread."""
    runs = []
    for change in ({"PYTHONHASHSEED": "1"}, {"PYTHONHASHSEED": "2", "OMP_NUM_THREADS": "1"}):
        done = subprocess.run(
            [sys.executable, "-c", ROLLOUT],
            cwd=tmp_path,
            env=os.environ | change,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == ""
        runs.append(done.stdout.split())
    assert [len(digest) for digest in runs[0]] == [64] * 3
    assert len(set(runs[0])) == 3
    assert runs[0] == runs[1]


@needs_fork
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")  # of Python 3.12 and later, about any thread at all
@pytest.mark.parametrize("n", [1, 40])
def test_a_forked_process_goes_on(n):
    """Threads do not survive a fork; an environment that used some must start its own in the child."""
    env = gym.make("drillenv/DrillLayers-v0") if n == 1 else native("drillenv/DrillLayers-v0", n, threads=2)
    size = None if n == 1 else n
    env.reset(seed=0)
    steps_of(env, drawn_actions(2, size))
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # a hung child ends itself
        try:
            os.write(writing, digest_of(env, size))
            env.close()
            env.close()
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        seen = pipe.read()
    assert os.waitpid(child, 0)[1] == 0
    assert seen == digest_of(env, size)
    env.close()


def digest_of(env, size):
    return hashlib.sha256(repr(steps_of(env, drawn_actions(3, size, seed=7))).encode()).digest()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("context", sorted({"fork", "spawn"} & set(multiprocessing.get_all_start_methods())))
def test_gymnasiums_processes(context):
    """AsyncVectorEnv, forked or spawned, after the parent has used an environment itself."""
    own = native("drillenv/DrillLayers-v0", 2, max_episode_steps=4)
    first = [own.reset(seed=0)[0].tobytes(), *(own.step(each)[0].tobytes() for each in drawn_actions(6, 2))]
    envs = gym.make_vec(
        "drillenv:drillenv/DrillLayers-v0",
        2,
        vectorization_mode="async",
        vector_kwargs={"context": context},
        max_episode_steps=4,
    )
    try:
        second = [envs.reset(seed=0)[0].tobytes(), *(envs.step(each)[0].tobytes() for each in drawn_actions(6, 2))]
    finally:
        envs.close()
    assert first == second
