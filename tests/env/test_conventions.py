"""Gymnasium's conventions: its own checker without a warning, registration, specs, closing."""

import importlib
import json
import math
import sys
import types
import warnings
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec, registry
from gymnasium.utils.env_checker import check_env
from matplotlib import pyplot
from matplotlib.backend_bases import FigureManagerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg

import drillenv
from drillenv.env.episodes import BLOWS_RANGE, THICKNESS_RANGE
from drillenv.env.observation import READINGS
from drillenv.env.registration import IDS, STEPS, register_environments
from drillenv.env.scalar import DrillEnv
from drillenv.env.vector import DrillVectorEnv

MODES = [("absolute", "readings"), ("increment", "readings"), ("absolute", "window"), ("increment", "window")]
each_mode = pytest.mark.parametrize(("actions", "observations"), MODES)
each_id = pytest.mark.parametrize("identity", IDS)
ARGUMENTS: list[dict[str, Any]] = [
    {},
    {"rock": 5},
    {"rock": "sandstone2-indenter30"},
    {"rock": {"loading_stiffness": 20e6, "unloading_stiffness": 24e6}},
    {"scenario": "test"},
    {"reward": {"force": 10.0, "rating": 1800.0}},
    {"actions": "increment", "observations": "window", "noise": 0.0},
]


@each_id
@each_mode
def test_gymnasiums_checker(identity, actions, observations):
    """All of it but rendering, which the next test adds."""
    env = gym.make(identity, actions=actions, observations=observations)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


class Screen(FigureCanvasAgg):
    """A window that nobody sees, for machines without a screen."""

    required_interactive_framework = "headless"
    shown: ClassVar[list[np.ndarray]] = []

    def flush_events(self):
        Screen.shown.append(np.asarray(self.buffer_rgba()).copy())


@pytest.fixture
def screen(monkeypatch):
    """Where windows open, until the test ends."""
    backend = types.ModuleType("screen_of_the_tests")
    backend.FigureCanvas, backend.FigureManager = Screen, FigureManagerBase
    monkeypatch.setattr(FigureManagerBase, "show", lambda _self: None)
    monkeypatch.setitem(sys.modules, backend.__name__, backend)
    before = pyplot.get_backend()
    pyplot.switch_backend(f"module://{backend.__name__}")
    Screen.shown.clear()
    yield Screen.shown
    pyplot.close("all")
    pyplot.switch_backend(before)


@pytest.mark.slow
@each_id
@pytest.mark.parametrize("render_mode", [None, "rgb_array"])
def test_gymnasiums_checker_with_rendering(identity, render_mode, screen):
    """The whole check, which makes every render mode and renders it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(identity, render_mode=render_mode).unwrapped)
    assert len(screen) >= 1
    assert screen[-1].std() > 10


@each_id
@each_mode
def test_passive_checker_over_an_episode(identity, actions, observations):
    """The wrapper that gym.make adds looks at every step."""
    steps = 15 if "Hidden" in identity else 80
    env = gym.make(identity, actions=actions, observations=observations)
    env.action_space.seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        seen, info = env.reset(seed=0)
        for _ in range(steps):
            assert seen in env.observation_space
            assert_plain(info)
            seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
            assert type(reward) is float
            assert math.isfinite(reward)
            assert terminated is False
            assert type(truncated) is bool
        assert seen in env.observation_space


def assert_plain(info):
    """Numbers that are finite, and the label: all of it goes into JSON."""
    for key, value in info.items():
        assert type(key) is str
        assert type(value) is (str if key == "motion" else float)
        assert key == "motion" or math.isfinite(value)
    json.dumps(info, allow_nan=False)


@each_id
@pytest.mark.parametrize("actions", ["absolute", "increment"])
@pytest.mark.parametrize("noise", [0.0, 1.0, 100.0])
def test_observations_stay_inside_the_space(identity, actions, noise):
    """At the corners of the action space, and with more noise than any sensor has."""
    rng = np.random.default_rng(1)
    for observations in ("readings", "window"):
        envs = gym.make_vec(identity, 4, actions=actions, observations=observations, noise=noise)
        seen, infos = envs.reset(seed=0)
        for _ in range(4 if "Hidden" in identity else 20):
            assert seen in envs.observation_space
            assert np.isfinite(np.array([values for values in infos.values() if values.dtype == np.float64])).all()
            seen, rewards, *_flags, infos = envs.step(rng.choice([-1.0, 1.0], (4, 3)))
            assert np.isfinite(rewards).all()


@each_id
def test_spaces(identity):
    env = gym.make(identity)
    assert env.action_space == gym.spaces.Box(-1, 1, (3,), np.float32)
    for space in (env.observation_space, gym.make(identity, observations="window").observation_space):
        assert space.dtype == np.float32
        assert np.isfinite(space.low).all()
        assert np.isfinite(space.high).all()
        assert (space.low < space.high).all()


@each_id
def test_time_limit(identity):
    spec = gym.spec(identity)
    assert spec.max_episode_steps == STEPS[spec.name]
    assert spec.vector_entry_point
    assert not spec.nondeterministic
    env = gym.make(identity, max_episode_steps=3)
    env.reset(seed=0)
    assert [env.step(np.zeros(3))[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]


def test_registered_once():
    before = {identity: registry[identity] for identity in IDS}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register_environments()
        importlib.reload(drillenv)
    assert all(registry[identity] is spec for identity, spec in before.items())
    assert len(IDS) == 3


def test_a_registration_of_ones_own_stays():
    own = EnvSpec("drillenv/Drill-v0", entry_point="somewhere:Else")
    kept = registry["drillenv/Drill-v0"]
    try:
        registry["drillenv/Drill-v0"] = own
        register_environments()
        assert registry["drillenv/Drill-v0"] is own
    finally:
        registry["drillenv/Drill-v0"] = kept


def test_made_by_module_and_name():
    """Gymnasium imports the module in front of the colon."""
    assert isinstance(gym.make("drillenv:drillenv/Drill-v0").unwrapped, DrillEnv)


@each_id
@pytest.mark.parametrize("arguments", ARGUMENTS, ids=str)
def test_specs_go_through_json(identity, arguments):
    """What one environment was made from makes another one, after a way through JSON."""
    first = gym.make(identity, **arguments)
    again = gym.make(EnvSpec.from_json(first.spec.to_json()))
    assert again.spec.kwargs == json.loads(json.dumps(first.spec.kwargs)) == first.spec.kwargs
    one, other = first.reset(seed=3), again.reset(seed=3)
    assert one[0].tobytes() == other[0].tobytes()
    assert one[1] == other[1]
    if arguments:
        return
    envs = gym.make_vec(identity, 2, autoreset_mode="SameStep", **arguments)
    assert isinstance(envs, DrillVectorEnv)
    twins = gym.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    assert twins.num_envs == 2
    assert twins.metadata == envs.metadata
    assert envs.reset(seed=3)[0].tobytes() == twins.reset(seed=3)[0].tobytes()


def test_closing_twice():
    for env in (gym.make("drillenv/Drill-v0"), gym.make_vec("drillenv/Drill-v0", 20)):
        env.close()
        env.close()
        fresh = type(env.unwrapped)
        unused = fresh.__new__(fresh)
        del unused  # never built: nothing to close, nothing said
    env = gym.make("drillenv/Drill-v0")
    env.reset(seed=0)
    env.step(np.zeros(3))
    env.close()
    env.close()


def test_rendering_without_a_mode_warns_and_gives_nothing():
    env = gym.make("drillenv/Drill-v0").unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def test_class_docstring_is_the_documentation_page():
    """Its sections, and numbers that are those of the tables."""
    text = DrillEnv.__doc__ or ""
    for part in (
        "Action space",
        "Observation space",
        "Reward",
        "Starting state",
        "Episode end",
        "Arguments",
        "Version",
    ):
        assert f"## {part}" in text
    for j, reading in enumerate(READINGS):
        row = f"| {reading.unit} | {reading.low:g} | {reading.high:g} | {reading.noise:g} |"
        assert f"| {j} | {reading.name}: {reading.meaning} {row}" in text
    thin, thick = THICKNESS_RANGE
    assert f"layers of {1e3 * thin:g} to {1e3 * thick:g} mm" in text
    few, many = BLOWS_RANGE
    assert f"stiffens over {10 * few:g}\n    to {10 * many:g} impacts" in text
    for control, step in zip(("frequency", "amplitude", "pressure"), (10, 0.05, 0.2), strict=True):
        (row,) = [line for line in text.splitlines() if f"| {control} " in line and "Num" not in line]
        assert float(row.split("|")[-2]) == step


def test_increments_add_up():
    env = gym.make("drillenv/Drill-v0", actions="increment", noise=0.0)
    _seen, info = env.reset(seed=0)
    assert [info[key] for key in ("frequency", "amplitude", "valve_pressure")] == pytest.approx([85.0, 0.45, 0.6])
    info = env.step(np.array([1.0, -1.0, 0.5]))[4]
    assert info["frequency"] == 95.0
    assert info["amplitude"] == pytest.approx(0.40, abs=1e-12)
    assert info["valve_pressure"] == pytest.approx(0.70, abs=1e-12)
    for _ in range(10):
        info = env.step(np.array([1.0, -1.0, 1.0]))[4]
    assert [info[key] for key in ("frequency", "amplitude", "valve_pressure")] == [120.0, 0.3, 1.8]


@pytest.mark.parametrize(
    ("action", "setting"),
    [([-1, -1, -1], (50.0, 0.3, 0.6)), ([1, 1, 1], (120.0, 0.6, 1.8)), ([0, 0, 0], (85.0, 0.45, 1.2))],
)
def test_absolute_actions_span_table_2_1(action, setting):
    env = gym.make("drillenv/Drill-v0")
    env.reset(seed=0)
    info = env.step(np.array(action, dtype=np.float32))[4]
    assert [info[key] for key in ("frequency", "amplitude", "valve_pressure")] == pytest.approx(setting, abs=1e-12)
