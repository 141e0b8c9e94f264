"""Drilling for the tests of controllers."""

import json

import numpy as np
import pytest

from drillenv.controllers import OnPlant
from drillenv.env.scalar import DrillEnv


class Drilled:
    """What came of drilling: arrays over the steps, by the names of the truth, and the rewards."""

    def __init__(self, rewards, infos, actions):
        self.rewards, self.actions = np.array(rewards), np.array(actions)
        self.infos = infos

    def __getitem__(self, name):
        return np.array([info[name] for info in self.infos])


@pytest.fixture
def drill():
    """A function that lets a controller drill with one rig; the arguments beside its own are those of DrillEnv."""

    def run(controller, steps, seed=0, episode=None, **task):
        env = DrillEnv(**task)
        options = None if episode is None else {"episode": episode}
        observation, info = env.reset(seed=seed, options=options)
        if isinstance(controller, OnPlant):
            controller.attach(env.get_state)
        controller.reset(seed)
        rewards, infos, actions = [], [], []
        for _ in range(steps):
            action = controller.act(observation, info if controller.sees_truth else {})
            observation, reward, _, _, info = env.step(action)
            rewards.append(reward)
            infos.append(info)
            actions.append(action)
        env.close()
        return Drilled(rewards, infos, actions)

    return run


@pytest.fixture
def scenario(tmp_path):
    """A function that writes a scenario of one episode of layers (k_l, k_u in MN/m, thickness in mm, case)."""

    def write(layers, lag=0.6, blows=5):
        rig = {
            "shaker_mass": 265.0,
            "indenter_mass": 3.0,
            "stiffness": 68850.0,
            "damping": 2450.0,
            "drive_gain": 1.0,
            "pressure_gain": 1.0,
        }
        episode = {"layers": layers, "lag": lag, "blows": blows, "phase": 0.0, "rig": rig, "effects": {}}
        record = {"format": "drillenv-scenario/1", "name": "own", "version": 1, "episodes": {"layers": [episode]}}
        file = tmp_path / "scenario.json"
        file.write_text(json.dumps(record), encoding="utf-8")
        return str(file)

    return write


class Forbidden(dict):
    """A truth that nobody may look into."""

    def _refuse(self, *_):
        raise AssertionError("a controller looked at the truth")

    __getitem__ = __iter__ = __contains__ = __len__ = get = keys = values = items = _refuse


@pytest.fixture
def forbidden():
    return Forbidden()
