"""What all controllers have in common."""

import numpy as np
import pytest

from drillenv import controllers
from drillenv.checks import InputError
from drillenv.env.observation import HIGH, LOW
from drillenv.env.scalar import DrillEnv

ORACLES = {"oracle", "steady-oracle"}
BLIND = sorted(set(controllers.NAMES) - ORACLES)
PLANNERS = {"mpc", "oracle"}


def test_only_the_oracles_see_the_truth():
    for name in controllers.NAMES:
        assert controllers.make(name).sees_truth == (name in ORACLES), name


@pytest.mark.parametrize("name", BLIND)
def test_nobody_else_looks_at_it(name, forbidden):
    controller = controllers.make(name)
    controller.reset(0)
    env = DrillEnv(scenario="validation")
    observation, _ = env.reset(seed=0, options={"episode": 0})
    for _ in range(6):
        action = controller.act(observation, forbidden)
        assert action.dtype == np.float32 and env.action_space.contains(action)
        observation, *_ = env.step(action)


@pytest.mark.parametrize("name", ["rules", "scheduled", "seeking", "mpc", "learned"])
def test_any_reading_of_the_sensors_gives_an_action(name):
    controller = controllers.make(name)
    controller.reset(0)
    rng = np.random.default_rng(5)
    readings = [LOW, HIGH, *rng.uniform(LOW, HIGH, (20, 15)).astype(np.float32)]
    for reading in readings:
        action = controller.act(reading, {})
        assert action.shape == (3,) and np.isfinite(action).all() and np.abs(action).max() <= 1.0


@pytest.mark.parametrize("name", sorted(controllers.NAMES))
def test_an_episode_is_forgotten_and_the_same_seed_acts_the_same(name, drill):
    controller = controllers.make(name)
    steps = 8 if name in PLANNERS else 40
    first = drill(controller, steps, seed=3, episode=1, scenario="validation")
    drill(controller, 5, seed=4, episode=2, scenario="validation")
    again = drill(controller, steps, seed=3, episode=1, scenario="validation")
    np.testing.assert_array_equal(first.actions, again.actions)
    np.testing.assert_array_equal(first.rewards, again.rewards)


@pytest.mark.parametrize("name", ["random", "mpc"])
def test_another_seed_acts_otherwise(name):
    observation, _ = DrillEnv(scenario="validation", noise=0.0).reset(seed=0, options={"episode": 1})
    actions = []
    for seed in (1, 2):
        controller = controllers.make(name)
        controller.reset(seed)
        actions.append(controller.act(observation, {}))
    assert not np.array_equal(*actions)


def test_an_unknown_name_is_refused_in_one_line():
    with pytest.raises(InputError, match="controller is 'ruels': give one of random, fixed, rules") as raised:
        controllers.make("ruels")
    assert "\n" not in str(raised.value)
