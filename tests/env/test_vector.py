"""The native vector environment beside n scalar ones in Gymnasium's SyncVectorEnv: the same to the last bit."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import batch_space

import drillenv  # noqa: F401
from drillenv.env.registration import IDS, STEPS

MODES = ("NextStep", "SameStep", "Disabled")


def native(identity, n, **arguments):
    return gym.make_vec(identity, n, vectorization_mode="vector_entry_point", **arguments)


def one_by_one(identity, n, mode, **arguments):
    return SyncVectorEnv([lambda: gym.make(identity, **arguments) for _ in range(n)], autoreset_mode=mode)


def identical(first, second):
    """Equal arrays: shape, dtype and every bit."""
    assert first.dtype == second.dtype
    assert first.shape == second.shape
    if first.dtype == object:
        for one, other in zip(first, second, strict=True):
            if isinstance(one, np.ndarray):
                identical(one, other)
            else:
                assert one == other
    else:
        assert first.tobytes() == second.tobytes()


def identical_infos(first, second):
    """Equal infos in Gymnasium's form: the same keys, masks, and bits where the masks are set."""
    assert set(first) == set(second)
    for key in first:
        if key.startswith("_"):
            identical(first[key], second[key])
        elif isinstance(first[key], dict):
            identical_infos(first[key], second[key])
        else:
            mask = first[f"_{key}"]
            assert first[key].dtype == second[key].dtype
            identical(first[key][mask], second[key][mask])


def identical_steps(first, second):
    for one, other in zip(first[:-1], second[:-1], strict=True):
        identical(one, other)
    identical_infos(first[-1], second[-1])


def run_both(identity, n, mode, steps, seed=11, **arguments):
    """Random actions through both, with resets of random rigs in between. Returns how many episodes ended."""
    threads = arguments.pop("threads", 1)
    ours = native(identity, n, autoreset_mode=mode, threads=threads, **arguments)
    theirs = one_by_one(identity, n, mode, **arguments)
    rng = np.random.default_rng(seed)
    identical_steps(ours.reset(seed=seed), theirs.reset(seed=seed))
    ended = 0
    for _step in range(steps):
        actions = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        got = ours.step(actions)
        identical_steps(got, theirs.step(actions))
        done = got[2] | got[3]
        ended += done.sum()
        # a few rigs are reset before their time, so that they are not all done at the same step
        mask = rng.random(n) < 0.01
        if mode == "Disabled":
            mask |= done
        elif mode == "NextStep":
            mask &= ~done
        if mask.any():
            seeds = [int(rng.integers(1000)) if rng.random() < 0.5 else None for _ in range(n)]
            identical_steps(
                ours.reset(seed=seeds, options={"reset_mask": mask}),
                theirs.reset(seed=seeds, options={"reset_mask": mask.copy()}),
            )
    ours.close()
    theirs.close()
    return ended


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("identity", [IDS[0], IDS[1]])
def test_vector_is_scalar_over_a_thousand_steps(identity, mode):
    assert run_both(identity, 3, mode, 1000, max_episode_steps=29) > 80


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "arguments",
    [{}, {"depth": 0.1}, {"depth": 1.0, "lost_bit_ends": True, "actions": "increment"}, {"depth": 0.1, "errors": 2.0}],
)
def test_vector_is_scalar_where_a_hole_is_drilled(arguments, mode):
    assert run_both("drillenv/DrillBit-v0", 3, mode, 300, max_episode_steps=29, **arguments) > 20


@pytest.mark.parametrize("mode", MODES)
def test_vector_is_scalar_with_hidden_physics(mode):
    assert run_both("drillenv/DrillHidden-v0", 3, mode, 40, max_episode_steps=7) > 10


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_vector_is_scalar_over_a_thousand_steps_with_hidden_physics(mode):
    """Of two rigs together, since theirs are slow."""
    assert run_both("drillenv/DrillHidden-v0", 2, mode, 500, max_episode_steps=13) > 50


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("observations", ["readings", "window"])
@pytest.mark.parametrize("actions", ["absolute", "increment"])
def test_vector_is_scalar_in_every_mode(actions, observations, mode):
    arguments = {"actions": actions, "observations": observations, "max_episode_steps": 5}
    assert run_both("drillenv/DrillLayers-v0", 3, mode, 40, **arguments) > 10


@pytest.mark.parametrize(
    "arguments", [{"rock": 5}, {"scenario": "test"}, {"noise": 0.0, "reward": {"force": 1.0}}, {"errors": 3.0}]
)
def test_vector_is_scalar_with_other_arguments(arguments):
    assert run_both("drillenv/DrillLayers-v0", 2, "SameStep", 40, max_episode_steps=5, **arguments) > 10


def test_vector_is_scalar_on_several_threads():
    """More rigs than a thread takes at a time."""
    assert run_both("drillenv/DrillLayers-v0", 50, "SameStep", 30, max_episode_steps=9, threads=3) > 100


def test_registered_time_limit_is_that_of_the_scalar():
    for name, steps in STEPS.items():
        identity = f"drillenv/{name}-v0"
        assert native(identity, 2).max_episode_steps == gym.spec(identity).max_episode_steps == steps
    envs, env = native("drillenv/Drill-v0", 1), gym.make("drillenv/Drill-v0")
    envs.reset(seed=0)
    env.reset(seed=0)
    for _ in range(STEPS["Drill"] - 1):
        assert not envs.step(np.zeros((1, 3)))[3][0]
        assert not env.step(np.zeros(3))[3]
    assert envs.step(np.zeros((1, 3)))[3][0]
    assert env.step(np.zeros(3))[3]


def test_each_rig_takes_its_own_episode_of_a_scenario():
    arguments = {"scenario": "test", "max_episode_steps": 20}
    ours = native("drillenv/DrillLayers-v0", 4, **arguments)
    scalars = [gym.make("drillenv/DrillLayers-v0", **arguments) for _ in range(4)]
    episodes = [7, 0, 59, 7]
    got, infos = ours.reset(seed=3, options={"episode": episodes})
    for i, env in enumerate(scalars):
        seen, info = env.reset(seed=3 + i, options={"episode": episodes[i]})
        identical(got[i], seen)
        assert {key: infos[key][i] for key in info} == info
    # the same for all, as an array, and with a mask that leaves rigs alone
    before = [ours.get_state(i) for i in range(4)]
    mask = np.array([False, True, False, True])
    options = {"episode": np.array([1, 2, 3, 4]), "reset_mask": mask}
    got, infos = ours.reset(options=options)
    assert infos["_depth"].tolist() == mask.tolist()
    for i in (1, 3):
        seen, _info = scalars[i].reset(options={"episode": i + 1})
        identical(got[i], seen)
    for i in (0, 2):
        after = ours.get_state(i)
        for one, other in zip(before[i].rig.arrays, after.rig.arrays, strict=True):
            identical(one, other)
        assert before[i].noise == after.noise
    assert list(options) == ["episode", "reset_mask"], "reset must not change the caller's options"


def test_some_rigs_may_leave_the_episode_to_chance():
    arguments = {"scenario": "test"}
    ours = native("drillenv/DrillLayers-v0", 3, **arguments)
    got, _infos = ours.reset(seed=3, options={"episode": [7, None, 8]})
    for i, options in enumerate(({"episode": 7}, None, {"episode": 8})):
        identical(got[i], gym.make("drillenv/DrillLayers-v0", **arguments).reset(seed=3 + i, options=options)[0])


def test_seeds_as_gymnasium_spreads_them():
    ours, theirs = native(IDS[1], 3), one_by_one(IDS[1], 3, "NextStep")
    for seed in (5, [3, None, 9], [4, 4, 4]):
        first, _ = ours.reset(seed=seed)
        second, _ = theirs.reset(seed=seed)
        if None not in np.atleast_1d(seed):
            identical(first, second)
        else:
            identical(first[[0, 2]], second[[0, 2]])
    assert ours.np_random_seed == theirs.np_random_seed == (4, 4, 4)
    for one, other in zip(ours.np_random, theirs.np_random, strict=True):
        assert one.bit_generator.state == other.bit_generator.state
    identical(*(envs.reset(seed=[4, 4, 4])[0][i] for i, envs in enumerate((ours, ours))))


def test_rigs_of_one_seed_go_on_differently_without_a_seed():
    ours = native(IDS[1], 4)
    first, _ = ours.reset(seed=1)
    second, _ = ours.reset()
    third, _ = ours.reset(seed=1)
    identical(first, third)
    assert not np.array_equal(first, second)
    assert len({row.tobytes() for row in np.concatenate([first, second])}) == 8


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("observations", ["readings", "window"])
@pytest.mark.parametrize("identity", IDS)
def test_vector_conventions(identity, observations, mode):
    """What Gymnasium asks of a vector environment: it has no checker of its own for these."""
    envs = native(identity, 3, observations=observations, autoreset_mode=mode, max_episode_steps=2)
    assert envs.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert envs.num_envs == 3
    assert envs.unwrapped is envs
    assert envs.observation_space == batch_space(envs.single_observation_space, 3)
    assert envs.action_space == batch_space(envs.single_action_space, 3)
    one = gym.make(identity, observations=observations)
    assert envs.single_observation_space == one.observation_space
    assert envs.single_action_space == one.action_space
    envs.action_space.seed(0)
    seen, infos = envs.reset(seed=0)
    returned = [seen]
    for _ in range(2):
        check_infos(infos, np.ones(3, dtype=bool))
        assert seen in envs.observation_space
        seen, rewards, terminations, truncations, infos = envs.step(envs.action_space.sample())
        returned.append(seen)
        assert rewards.shape == terminations.shape == truncations.shape == (3,)
        assert rewards.dtype == np.float64
        assert terminations.dtype == truncations.dtype == np.bool_
        assert not terminations.any()
    assert truncations.all()
    if mode == "SameStep":
        assert infos["_final_obs"].all()
        check_infos(infos["final_info"], np.ones(3, dtype=bool))
        for last in infos.pop("final_obs"):
            assert last in envs.single_observation_space
        for key in ("_final_obs", "final_info", "_final_info"):
            del infos[key]
    check_infos(infos, np.ones(3, dtype=bool))
    for i, first in enumerate(returned):
        for second in returned[i + 1 :]:
            assert not np.shares_memory(first, second)
    with pytest.raises(gym.error.ResetNeeded) if mode == "Disabled" else pytest.MonkeyPatch.context():
        envs.step(envs.action_space.sample())
    envs.close()
    envs.close()
    assert envs.closed


def check_infos(infos, mask):
    """An array and a mask for each key, with finite numbers."""
    for key, values in infos.items():
        assert values.shape == (3,)
        if key.startswith("_"):
            assert values.tolist() == mask.tolist()
        elif values.dtype == object:
            assert key == "motion"
        else:
            assert np.isfinite(values).all()


def test_next_step_ignores_the_action_of_a_rig_that_is_done():
    first, second = (native(IDS[1], 2, max_episode_steps=3) for _ in range(2))
    for envs in (first, second):
        envs.reset(seed=0)
        for _ in range(3):
            got = envs.step(np.zeros((2, 3)))
        assert got[3].all()
    one, other = first.step(np.ones((2, 3))), second.step(-np.ones((2, 3)))
    identical_steps(one, other)
    assert not one[1].any()
    assert not one[3].any()


def test_a_closed_environment_can_still_be_copied_and_closed():
    envs = native(IDS[1], 40, threads=2)
    envs.reset(seed=0)
    envs.step(np.zeros((40, 3)))
    envs.close()
    envs.close()


def test_repr_names_the_environment():
    assert "drillenv/DrillLayers-v0" in repr(native(IDS[1], 2))
