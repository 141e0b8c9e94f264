"""Ten thousand random episodes, of all kinds and in all modes: nothing raised, nothing infinite, nothing leaked."""

import gc
import itertools
import os
import tracemalloc

import gymnasium as gym
import numpy as np
import pytest

import drillenv  # noqa: F401
from drillenv.env.registration import IDS

MODES = [*itertools.product(("absolute", "increment"), ("readings", "window"), ("NextStep", "SameStep", "Disabled"))]
STYLES = ("any", "corners", "hold", "jump")


def actions_of(style, rng, n, step, held):
    """Random actions: anywhere, at the corners, held, or from end to end and back."""
    if style == "any":
        return rng.uniform(-1, 1, (n, 3)).astype(np.float32)
    if style == "corners":
        return rng.choice(np.float32([-1, 1]), (n, 3))
    return held if style == "hold" or step % 2 else -held


def check(envs, seen, rewards, infos):
    assert seen.dtype == np.float32
    assert seen in envs.observation_space
    assert np.isfinite(rewards).all()
    for key, values in infos.items():
        if key == "final_info":
            check(envs, seen, rewards, values)
        elif key == "final_obs":
            assert all(last is None or last in envs.single_observation_space for last in values)
        elif values.dtype != object:
            assert np.isfinite(values).all(), key


def run(identity, mode, n, steps, limit, rng, **arguments):
    """Random steps of n rigs. Returns how many episodes they began."""
    actions, observations, autoreset = mode
    envs = gym.make_vec(
        identity,
        n,
        actions=actions,
        observations=observations,
        autoreset_mode=autoreset,
        max_episode_steps=limit,
        threads=1,
        **arguments,
    )
    seen, infos = envs.reset(seed=int(rng.integers(2**31)))
    check(envs, seen, np.zeros(n), infos)
    episodes, style, held = n, STYLES[int(rng.integers(len(STYLES)))], rng.uniform(-1, 1, (n, 3)).astype(np.float32)
    for step in range(steps):
        seen, rewards, terminations, truncations, infos = envs.step(actions_of(style, rng, n, step, held))
        assert not terminations.any()
        check(envs, seen, rewards, infos)
        mask = truncations if autoreset == "Disabled" else np.zeros(n, dtype=bool)
        if autoreset != "Disabled":
            episodes += np.count_nonzero(truncations)
        if rng.random() < 0.1:
            mask = mask | (rng.random(n) < 0.3)
        if mask.any():
            episodes += np.count_nonzero(mask)
            seen, infos = envs.reset(options={"reset_mask": mask})
            check(envs, seen, rewards, infos)
    envs.close()
    return episodes


def sweep(rng, episodes, full=False):
    """At least so many episodes, over every id and mode, mostly of one to five steps."""
    done = dict.fromkeys(IDS, 0)
    share = {IDS[0]: 0.45, IDS[1]: 0.5, IDS[2]: 0.05}
    for mode in itertools.cycle(MODES):
        for identity in IDS:
            if done[identity] >= share[identity] * episodes:
                continue
            hidden, window = identity == IDS[2], mode[1] == "window"
            n = 4 if hidden else 8 if window else 32
            arguments = {}
            if rng.random() < 0.3:
                arguments = {"scenario": str(rng.choice(["train", "beyond", "test", "validation"]))}
            elif rng.random() < 0.2 and not hidden:
                kl = 10 ** rng.uniform(5, 9)
                stiffness = {"loading_stiffness": kl, "unloading_stiffness": min(1e9, kl * rng.uniform(1.0, 2.0))}
                arguments = {"rock": stiffness}
            limit = int(rng.integers(1, 6))
            done[identity] += run(identity, mode, n, 3 * limit + 2, limit, rng, **arguments)
        if all(done[identity] >= share[identity] * episodes for identity in IDS):
            break
    if full:
        for identity, limit in zip(IDS, (80, 240, 240), strict=True):
            n = 2 if identity == IDS[2] else 20
            done[identity] += run(identity, MODES[0], n, limit + 2, limit, rng)
    return sum(done.values())


def resident():
    """Bytes of the process in memory, where the platform tells (Linux)."""
    try:
        with open("/proc/self/statm", encoding="ascii") as line:
            return int(line.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None


def test_five_hundred_random_episodes():
    assert sweep(np.random.default_rng(7), 500) >= 500


@pytest.mark.thorough
@pytest.mark.slow
def test_ten_thousand_random_episodes():
    """Once warmed up, 10,000 episodes leave no memory behind: Python's own to 0.5 MB, the process' to 30 MB."""
    rng = np.random.default_rng(20)
    sweep(rng, 500)
    gc.collect()
    before = resident()
    assert sweep(rng, 10_000, full=True) >= 10_000
    gc.collect()
    after = resident()
    if before is not None and after is not None:
        assert after - before < 30e6
    # and to the byte, over fewer episodes, since it is slow to watch
    tracemalloc.start()
    try:
        sweep(rng, 300)
        gc.collect()
        held = tracemalloc.get_traced_memory()[0]
        sweep(rng, 600)
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - held < 0.5e6
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("identity", IDS)
def test_stepping_one_environment_leaks_nothing(identity):
    """Many steps, resets, states and copies of one scalar environment: of six rounds alike, one adds nothing.

    Memory is counted from before the environment is made: what is replaced later would count as growth otherwise. The
    rigs repeat, since those drawn are kept (a bounded cache). A leak adds something at every step of every round.
    """
    rng, episodes = np.random.default_rng(0), 60

    def use(env):
        for seed in range(episodes):
            env.reset(seed=seed)
            for _ in range(5):
                env.step(rng.uniform(-1, 1, 3))
                env.set_state(env.get_state())
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        env = gym.make(identity).unwrapped
        held = [use(env) for _ in range(8)][1:]
    finally:
        tracemalloc.stop()
    assert np.diff(held).min() < 16 * 5 * episodes
