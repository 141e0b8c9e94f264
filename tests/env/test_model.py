"""An environment on a corrected model: its constants and effects, and what it leaves aside."""

import json

import gymnasium as gym
import numpy as np
import pytest

import drillenv  # noqa: F401
from drillenv.checks import InputError

RATE = {"name": "contact-rate", "parameters": {"chi": 0.5}}
OFFSET = {"name": "sensor-offset", "parameters": {"o_f": 40.0}}
BODY = {"name": "viscous-damping", "parameters": {"d": 5.0}}
ACTION = np.array([0.2, -0.3, 0.1], dtype=np.float32)


@pytest.fixture
def written(tmp_path):
    """Writes a model with these effects; returns its path."""

    def write(name, *effects):
        file = tmp_path / f"{name}.json"
        constants = {"damping": 2790.0, "loading_stiffness": 21.9e6, "unloading_stiffness": 25.1e6}
        file.write_text(json.dumps({"format": "drillenv-model/1", "constants": constants, "effects": list(effects)}))
        return str(file)

    return write


def steps(file):
    env = gym.make("drillenv/Drill-v0", model=file)
    first, _info = env.reset(seed=3)
    return [first, *(env.step(ACTION)[0] for _ in range(3))], env.unwrapped


def test_constants_and_effects_of_a_model(written):
    readings, env = steps(written("model", RATE))
    assert env.task.effects == {"contact-rate": {"chi": 0.5, "c_d": 0.0, "p_d": 0.0}}
    assert env.task.corrected.rig.damping == 2790.0
    assert env.task.rock[0].loading_stiffness == 21.9e6
    plain, _env = steps(written("plain"))
    assert not np.array_equal(readings[-1], plain[-1])


def test_effects_on_sensors_are_left_aside(written):
    with_sensor, env = steps(written("with", OFFSET, RATE))
    assert list(env.task.effects) == ["contact-rate"]
    without, _env = steps(written("without", RATE))
    np.testing.assert_array_equal(np.stack(with_sensor), np.stack(without))
    # a model of nothing but a sensor drills as the plain one
    sensor_only, env = steps(written("sensor", OFFSET))
    assert env.task.effects == {}
    plain, _env = steps(written("plain"))
    np.testing.assert_array_equal(np.stack(sensor_only), np.stack(plain))


def test_an_effect_of_a_one_body_rig_is_refused(written):
    file = written("body", RATE, BODY)
    with pytest.raises(InputError, match="viscous-damping, which is one of a one-body rig"):
        gym.make("drillenv/Drill-v0", model=file)
    with pytest.raises(InputError, match="one-body rig"):
        gym.make_vec("drillenv/Drill-v0", 2, vectorization_mode="vector_entry_point", model=file)
