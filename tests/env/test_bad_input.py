"""What cannot be used gets one line that says so, and leaves the environment as if nothing had happened."""

import json
import math
import pickle

import gymnasium as gym
import numpy as np
import pytest

import drillenv  # noqa: F401
from drillenv.checks import InputError
from drillenv.env.batch import step_rigs
from drillenv.env.registration import IDS

GOOD = np.array([0.2, -0.3, 0.4], dtype=np.float32)
BAD_ACTIONS = {
    "not a number": [math.nan, 0, 0],
    "infinite": [0, math.inf, 0],
    "infinite downwards": [0, 0, -math.inf],
    "too large": [0, 0, 1.01],
    "too small": [-1.5, 0, 0],
    "too large for float32": [1e300, 0, 0],
    "too few": [0, 0],
    "too many": [0, 0, 0, 0],
    "two axes": [[0, 0, 0]],
    "one number": 0.5,
    "empty": [],
    "ragged": [[0, 0], [0]],
    "None": None,
    "Nones": [None, None, None],
    "text": "up",
    "texts": ["0.1", "0.2", "0.3"],
    "bytes": [b"0", b"0", b"0"],
    "complex": np.array([1j, 0, 0]),
    "dates": np.array(["2024-01-01"] * 3, dtype="datetime64[D]"),
    "a record": {"frequency": 0},
    "objects": [object(), object(), object()],
    "a structure": np.zeros(3, dtype=[("x", float)]),
    "the smallest whole number": np.array([np.iinfo(np.int64).min, 0, 0]),
}
GOOD_ACTIONS = {
    "list": [0.2, -0.3, 0.4],
    "tuple": (0.2, -0.3, 0.4),
    "double": np.array([0.2, -0.3, 0.4]),
    "half": np.array([0.5, -0.25, 1.0], dtype=np.float16),
    "whole numbers": np.array([1, 0, -1]),
    "rounding above one": np.array([1.0 + 1e-7, 0, 0]),
    "not contiguous": np.zeros((3, 2), dtype=np.float32)[:, 0],
    "read-only": np.broadcast_to(np.float32(0.5), 3),
}


def one_line(raised):
    message = str(raised.value)
    assert message
    assert "\n" not in message
    assert len(message) < 500
    assert ": " in message  # what was given: what to do
    return message


def everything(env):
    """All that the future of an environment depends on."""
    return pickle.dumps((env.unwrapped.get_state(), env.unwrapped.np_random.bit_generator.state))


def everything_of(envs):
    states = [envs.get_state(i) for i in range(envs.num_envs)]
    return pickle.dumps((states, envs._elapsed, envs._done, [each.bit_generator.state for each in envs.np_random]))


def native(n=3, identity="drillenv/DrillLayers-v0", **arguments):
    return gym.make_vec(identity, n, vectorization_mode="vector_entry_point", **arguments)


# --- Actions


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("observations", ["readings", "window"])
@pytest.mark.parametrize("bad", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_bad_action(bad, observations):
    env = gym.make("drillenv/DrillLayers-v0", observations=observations).unwrapped
    env.reset(seed=1)
    env.step(GOOD)
    before = everything(env)
    with pytest.raises(InputError) as raised:
        env.step(bad)
    one_line(raised)
    assert everything(env) == before


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_bad_action_of_one_rig(bad):
    envs = native()
    envs.reset(seed=1)
    envs.step(np.tile(GOOD, (3, 1)))
    before = everything_of(envs)
    for actions in ([GOOD.tolist(), bad, GOOD.tolist()], bad):
        with pytest.raises(InputError) as raised:
            envs.step(actions)
        one_line(raised)
        assert everything_of(envs) == before


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("good", GOOD_ACTIONS.values(), ids=GOOD_ACTIONS)
def test_other_ways_to_write_an_action(good):
    env = gym.make("drillenv/DrillLayers-v0").unwrapped
    env.reset(seed=1)
    state = env.get_state()
    first = env.step(good)
    env.set_state(state)
    second = env.step(np.clip(np.array(good, dtype=np.float32), -1, 1))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1:] == second[1:]


def test_other_arrays_do_not_compile_the_kernel_anew():
    env, envs = gym.make("drillenv/DrillLayers-v0").unwrapped, native()
    env.reset(seed=1)
    envs.reset(seed=1)
    compiled = len(step_rigs.signatures)
    for good in GOOD_ACTIONS.values():
        env.step(good)
        envs.step(np.repeat(np.asarray(good)[:, None], 3, axis=1).T)
    assert len(step_rigs.signatures) == compiled


def test_what_one_got_before_a_bad_action_is_what_one_gets_after():
    """The same as above without looking inside: the next step is bitwise that of an environment left alone."""
    plain, bothered = (gym.make("drillenv/DrillLayers-v0") for _ in range(2))
    plain.reset(seed=4)
    bothered.reset(seed=4)
    for step in range(20):
        action = np.full(3, 0.1 * step - 1)
        for bad in BAD_ACTIONS.values():
            with pytest.raises(InputError):
                bothered.unwrapped.step(bad)
        first, second = plain.step(action), bothered.step(action)
        assert first[0].tobytes() == second[0].tobytes()
        assert first[1:] == second[1:]


# --- Out of turn


@pytest.mark.parametrize("identity", IDS)
def test_before_the_first_reset(identity):
    for env in (gym.make(identity), gym.make(identity).unwrapped):
        with pytest.raises(gym.error.ResetNeeded):
            env.step(GOOD)
    env = gym.make(identity).unwrapped
    with pytest.raises(gym.error.ResetNeeded) as raised:
        env.get_state()
    one_line(raised)
    with pytest.raises(gym.error.ResetNeeded) as raised:
        gym.make(identity, render_mode="rgb_array").unwrapped.render()
    one_line(raised)
    envs = native(identity=identity)
    for call in (lambda: envs.step(np.zeros((3, 3))), lambda: envs.get_state(1)):
        with pytest.raises(gym.error.ResetNeeded) as raised:
            call()
        one_line(raised)


def test_rigs_left_out_of_the_first_reset():
    envs = native()
    with pytest.raises(InputError, match="never reset"):
        envs.reset(options={"reset_mask": np.array([True, False, True])})


def test_a_rig_that_is_done_with_autoreset_disabled():
    envs = native(autoreset_mode="Disabled", max_episode_steps=1)
    envs.reset(seed=0)
    envs.step(np.zeros((3, 3)))
    before = everything_of(envs)
    with pytest.raises(gym.error.ResetNeeded) as raised:
        envs.step(np.zeros((3, 3)))
    assert "reset_mask" in one_line(raised)
    assert everything_of(envs) == before


# --- Seeds and options


@pytest.mark.parametrize("seed", [-1, 1.5, "one", [1], np.float64(3)])
def test_bad_seed(seed):
    env = gym.make("drillenv/DrillLayers-v0").unwrapped
    env.reset(seed=1)
    before = everything(env)
    with pytest.raises(gym.error.Error):
        env.reset(seed=seed)
    assert everything(env) == before


@pytest.mark.parametrize(
    "seed", [-1, 1.5, "one", [1], [1, 2], [1, 2, 3, 4], [1, -2, 3], [1, 2.5, 3], [1, "2", 3], np.float64(3), {1, 2, 3}]
)
def test_bad_seeds_of_a_vector(seed):
    envs = native()
    with pytest.raises((InputError, gym.error.Error)):
        envs.reset(seed=seed)
    envs.reset(seed=1)
    before = everything_of(envs), envs.np_random_seed
    with pytest.raises((InputError, gym.error.Error)) as raised:
        envs.reset(seed=seed)
    assert "\n" not in str(raised.value)
    assert (everything_of(envs), envs.np_random_seed) == before


BAD_OPTIONS = [{"epsiode": 1}, {"episode": -1}, {"episode": 60}, {"episode": 1.5}, {"episode": "1"}, {1: 2}]


@pytest.mark.parametrize("options", [*BAD_OPTIONS, {"episode": math.nan}, {"episode": True}, {"episode": [1]}])
def test_bad_options(options):
    env = gym.make("drillenv/DrillLayers-v0", scenario="test").unwrapped
    env.reset(seed=1)
    before = everything(env)
    with pytest.raises(InputError) as raised:
        env.reset(seed=5, options=options)
    one_line(raised)
    assert everything(env) == before


@pytest.mark.parametrize(
    "options",
    [
        *BAD_OPTIONS,
        {"episode": [1, 2]},
        {"episode": [1, 2, 60]},
        {"episode": [None, None, 60]},
        {"episode": [1, 2.5, 3]},
        {"episode": [1, "2", 3]},
        {"episode": np.array([1, 2, 70])},
        {"episode": np.ones((3, 2))},
        {"episode": np.array(1.5)},
        {"episode": "123"},
        {"reset_mask": [True, True, True]},
        {"reset_mask": np.ones(3)},
        {"reset_mask": np.ones(2, dtype=bool)},
        {"reset_mask": np.zeros(3, dtype=bool)},
    ],
)
def test_bad_options_of_a_vector(options):
    envs = native(scenario="test")
    envs.reset(seed=1)
    before = everything_of(envs), envs.np_random_seed
    with pytest.raises(InputError) as raised:
        envs.reset(seed=5, options=options)
    one_line(raised)
    assert (everything_of(envs), envs.np_random_seed) == before


def test_an_episode_without_a_scenario():
    for env in (gym.make("drillenv/DrillLayers-v0"), native()):
        with pytest.raises(InputError, match="scenario"):
            env.reset(seed=0, options={"episode": 0})


# --- States


def test_bad_states():
    env, envs = gym.make("drillenv/DrillLayers-v0").unwrapped, native()
    env.reset(seed=0)
    envs.reset(seed=0)
    window = gym.make("drillenv/DrillLayers-v0", observations="window").unwrapped
    window.reset(seed=0)
    before = everything(env), everything_of(envs)
    for bad in (None, 1, {}, (1, 2), env, window.get_state()):
        for call in (env.set_state, envs.set_state):
            with pytest.raises(InputError) as raised:
                call(bad)
            one_line(raised)
    for bad in ([3], [-1], ["a"], [0, 1.5]):
        with pytest.raises(InputError) as raised:
            envs.set_state(env.get_state(), bad)
        one_line(raised)
    for bad in (3, -1, "a", 1.5):
        with pytest.raises(InputError) as raised:
            envs.get_state(bad)
        one_line(raised)
    assert (everything(env), everything_of(envs)) == before


# --- Arguments

BAD_ARGUMENTS = [
    {"rock": 0},
    {"rock": 7},
    {"rock": 4.0},
    {"rock": True},
    {"rock": "granite"},
    {"rock": [4]},
    {"rock": {}},
    {"rock": {"loading_stiffness": 20e6}},
    {"rock": {"loading_stiffness": 20e6, "unloading_stiffness": 24e6, "name": "a"}},
    {"rock": {"loading_stiffness": 20e6, "unloading_stiffness": 10e6}},
    {"rock": {"loading_stiffness": math.nan, "unloading_stiffness": 10e6}},
    {"rock": {"loading_stiffness": 20, "unloading_stiffness": 24}},
    {"rock": {"loading_stiffness": "20e6", "unloading_stiffness": "24e6"}},
    {"rock": {1: 20e6, 2: 24e6}},
    {"scenario": "tset"},
    {"scenario": ""},
    {"scenario": "."},
    {"scenario": 3},
    {"scenario": ["test"]},
    {"scenario": "nowhere/at/all.json"},
    {"scenario": "test", "rock": 4},
    {"model": "nowhere.json"},
    {"model": "."},
    {"model": 5},
    {"model": {"format": "drillenv-model/1"}},
    {"model": "a\0b"},
    {"scenario": "a\0b"},
    {"reward": 5},
    {"reward": "force"},
    {"reward": [("force", 1)]},
    {"reward": {"forse": 1}},
    {"reward": {"force": -1}},
    {"reward": {"force": math.inf}},
    {"reward": {"force": "5"}},
    {"reward": {"rating": 2}},
    {"reward": {"other_motions": 2}},
    {"reward": {"self": 2}},
    {"reward": {1: 2}},
    {"actions": "relative"},
    {"actions": 1},
    {"actions": None},
    {"observations": "pixels"},
    {"observations": ["readings"]},
    {"noise": -1},
    {"noise": math.nan},
    {"noise": "none"},
    {"noise": None},
    {"noise": True},
    {"kind": "sand"},
    {"kind": None},
]


@pytest.mark.parametrize("arguments", BAD_ARGUMENTS, ids=str)
def test_bad_arguments(arguments):
    for make in (gym.make, native_of):
        with pytest.raises(InputError) as raised:
            make("drillenv/DrillLayers-v0", **arguments)
        one_line(raised)


def native_of(identity, **arguments):
    return native(identity=identity, **arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        {"autoreset_mode": "never"},
        {"autoreset_mode": None},
        {"threads": 0},
        {"threads": 1.5},
        {"threads": "two"},
        {"max_episode_steps": 0},
        {"max_episode_steps": 1.5},
        {"max_episode_steps": "ten"},
        {"render_mode": "rgb_array"},
    ],
    ids=str,
)
def test_bad_arguments_of_a_vector(arguments):
    with pytest.raises(InputError) as raised:
        native(**arguments)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("n", [0, -1, 2.5, "3", math.nan])
def test_bad_number_of_rigs(n):
    with pytest.raises(InputError, match="num_envs"):
        native(n)


@pytest.mark.filterwarnings("ignore:.*render_mode:UserWarning")  # Gymnasium's own, before our error
def test_bad_render_mode():
    with pytest.raises(InputError, match="render_mode"):
        gym.make("drillenv/DrillLayers-v0", render_mode="ascii")


def test_unknown_argument_is_pythons_own_error():
    for make in (gym.make, native_of):
        with pytest.raises(TypeError, match="rokc"):
            make("drillenv/DrillLayers-v0", rokc=4)


# --- Files from elsewhere

PARAMETERS = {"chi": 0.5}


def model(**changes):
    return {"format": "drillenv-model/1"} | changes


BAD_MODELS = {
    "empty": "",
    "not JSON": "{format: drillenv-model/1}",
    "a pickle": pickle.dumps({"format": "drillenv-model/1"}),
    "deep": "[" * 100_000,
    "a picture": b"\x89PNG\r\n\x1a\n\xff\xfe",
    "a number": "3",
    "null": "null",
    "a list": [model()],
    "no format": {},
    "another format": model(format="drillenv-model/99"),
    "a scenario": {"format": "drillenv-scenario/1", "name": "x", "version": 1, "episodes": {}},
    "another key": model(constant={}),
    "constants no record": model(constants=[1, 2]),
    "unknown constant": model(constants={"gravity": 9.81}),
    "constant self": model(constants={"self": 1.0}),
    "constant no number": model(constants={"damping": "2450"}),
    "constant null": model(constants={"damping": None}),
    "constant not finite": '{"format": "drillenv-model/1", "constants": {"damping": NaN}}',
    "constant too large for a float": '{"format": "drillenv-model/1", "constants": {"damping": 1' + "0" * 400 + "}}",
    "constant negative": model(constants={"damping": -1.0}),
    "constant in another unit": model(constants={"shaker_mass": 265000.0}),
    "one stiffness": model(constants={"loading_stiffness": 20e6}),
    "stiffnesses that give energy": model(constants={"loading_stiffness": 20e6, "unloading_stiffness": 10e6}),
    "effects no list": model(effects={"name": "contact-rate"}),
    "effect no record": model(effects=["contact-rate"]),
    "unknown effect": model(effects=[{"name": "gravity", "parameters": {}}]),
    "effect without parameters": model(effects=[{"name": "contact-rate"}]),
    "effect with more": model(effects=[{"name": "contact-rate", "parameters": PARAMETERS, "code": "x"}]),
    "effect name no text": model(effects=[{"name": 5, "parameters": PARAMETERS}]),
    "effect name a record": model(effects=[{"name": {}, "parameters": PARAMETERS}]),
    "parameters a list": model(effects=[{"name": "contact-rate", "parameters": [0.5]}]),
    "parameters null": model(effects=[{"name": "contact-rate", "parameters": None}]),
    "parameter unknown": model(effects=[{"name": "contact-rate", "parameters": {"psi": 0.5}}]),
    "parameter name": model(effects=[{"name": "contact-rate", "parameters": {"name": "contact-rate"}}]),
    "parameter self": model(effects=[{"name": "contact-rate", "parameters": {"self": 0.5}}]),
    "parameter out of bounds": model(effects=[{"name": "contact-rate", "parameters": {"chi": 1e9}}]),
    "parameter no number": model(effects=[{"name": "contact-rate", "parameters": {"chi": "0.5"}}]),
    "effect twice": model(effects=[{"name": "contact-rate", "parameters": PARAMETERS}] * 2),
}


def written(folder, content):
    file = folder / "model.json"
    if isinstance(content, bytes):
        file.write_bytes(content)
    else:
        file.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(file)


@pytest.mark.parametrize("content", BAD_MODELS.values(), ids=BAD_MODELS)
def test_model_from_elsewhere(content, tmp_path):
    file = written(tmp_path, content)
    for make in (gym.make, native_of):
        with pytest.raises(InputError) as raised:
            make("drillenv/DrillLayers-v0", model=file)
        assert "model.json" in one_line(raised)


def test_huge_files(tmp_path):
    for argument in ("model", "scenario"):
        file = tmp_path / f"{argument}.json"
        with open(file, "wb") as sparse:
            sparse.truncate(2**40)
        with pytest.raises(InputError, match="bytes"):
            gym.make("drillenv/DrillLayers-v0", **{argument: str(file)})


def test_rock_given_twice(tmp_path):
    file = written(tmp_path, model(constants={"loading_stiffness": 20e6, "unloading_stiffness": 24e6}))
    with pytest.raises(InputError, match="which rock"):
        gym.make("drillenv/DrillLayers-v0", model=file, rock=4)
    with pytest.raises(InputError, match="scenario"):
        gym.make("drillenv/DrillLayers-v0", model=file, scenario="test")


BAD_EPISODES = {
    "no layers": {"layers": []},
    "layers no list": {"layers": {}},
    "too many layers": {"layers": [[20.0, 24.0, 5.0, 0]] * 64 + [[20.0, 24.0, None, 0]]},
    "a layer too short": {"layers": [[20.0, 24.0, None]]},
    "a last layer with an end": {"layers": [[20.0, 24.0, 5.0, 0]]},
    "a first layer without one": {"layers": [[20.0, 24.0, None, 0], [20.0, 24.0, None, 0]]},
    "k_u below k_l": {"layers": [[20.0, 19.0, None, 0]]},
    "stiffness in N/m": {"layers": [[20e6, 24e6, None, 0]]},
    "case 7": {"layers": [[20.0, 24.0, None, 7]]},
    "thickness negative": {"layers": [[20.0, 24.0, -5.0, 0], [20.0, 24.0, None, 0]]},
    "lag zero": {"lag": 0.0},
    "lag text": {"lag": "1"},
    "blows zero": {"blows": 0},
    "blows a fraction": {"blows": 1.5},
    "phase not finite": {"phase": math.nan},
    "phase in degrees": {"phase": 90.0},
    "rig no record": {"rig": []},
    "rig with less": {"rig": {"shaker_mass": 265.0}},
    "effects no record": {"effects": ["contact-rate"]},
    "unknown effect": {"effects": {"gravity": {"g": 9.81}}},
    "effect no record": {"effects": {"contact-rate": 0.5}},
    "effect parameter name": {"effects": {"contact-rate": {"name": 0.5}}},
    "effect parameter self": {"effects": {"contact-rate": {"self": 0.5}}},
    "one key more": {"seed": 5},
}


@pytest.mark.parametrize("episode", BAD_EPISODES.values(), ids=BAD_EPISODES)
def test_scenario_from_elsewhere(episode, scenario):
    file = scenario("layers", {}, episode)
    for make in (gym.make, native_of):
        with pytest.raises(InputError) as raised:
            make("drillenv/DrillLayers-v0", scenario=file)
        assert "layers 1" in one_line(raised) or "rig" in str(raised.value)


SCENARIO = {"format": "drillenv-scenario/1", "name": "x", "version": 1, "episodes": {"layers": []}}


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[",
        "[" * 100_000,
        b"\xff\xfe\x00",
        "3",
        {},
        model(),
        SCENARIO | {"format": "drillenv-scenario/2"},
        SCENARIO | {"more": 1},
        SCENARIO | {"name": 5},
        SCENARIO | {"version": "1"},
        SCENARIO | {"version": True},
        SCENARIO | {"episodes": []},
        SCENARIO | {"episodes": {"sand": []}},
        SCENARIO | {"episodes": {"layers": {}}},
        SCENARIO | {"episodes": {"layers": [5]}},
        SCENARIO,
    ],
    ids=lambda content: str(content)[:60],
)
def test_no_scenario_at_all(content, tmp_path):
    file = written(tmp_path, content)
    with pytest.raises(InputError) as raised:
        gym.make("drillenv/DrillLayers-v0", scenario=file)
    one_line(raised)
