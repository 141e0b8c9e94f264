"""Observations scaled by fixed numbers, rewards by the horizon, and what a policy asks for turned into actions.

Fixed numbers, because what moves with the run would have to be stored, resumed and exported with it, and because
running statistics blow up a reading that is mostly noise, such as the half harmonic, to the size of one that matters.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from drillenv.controllers.policies import actions_of
from drillenv.env.observation import READINGS

NOISES = 10.0
"""Standard deviations of its sensor's noise that the width of a reading has at least."""
TABLE = {
    "mean_peak_force": (1.55, 0.49),
    "largest_peak_force": (1.9, 0.37),
    "peak_force_spread": (0.3, 0.33),
    "impacts_per_cycle": (1.6, 0.84),
    "period_two": (0.0, 0.05),
    "contact_share": (0.27, 0.13),
    "half_harmonic": (0.0, 1.0),
    "first_harmonic": (9.0, 5.5),
    "second_harmonic": (8.7, 3.5),
    "third_harmonic": (8.0, 3.2),
    "penetration_rate": (1.65, 1.0),
    "frequency": (103.0, 22.0),
    "amplitude": (0.47, 0.09),
    "valve_pressure": (1.15, 0.32),
    "pressure": (1.15, 0.21),
}
"""Centre and width of each reading in its unit: mean and standard deviation over episodes of the scenario "train", half
of them under the rules and half at random settings, rounded; the width is at least NOISES times the sensor's noise."""
CENTRE = np.array([TABLE[reading.name][0] for reading in READINGS], dtype=np.float32)
WIDTH = np.array([TABLE[reading.name][1] for reading in READINGS], dtype=np.float32)


def scaled(observations: np.ndarray) -> np.ndarray:
    """Observations (..., 15) as float32 numbers of the order of 1."""
    return (observations - CENTRE) / WIDTH


class Scaled(VecEnvWrapper):
    """Scales what rigs on rock give by the table, and gives them actions for what the policy asks for.

    Args:
        venv: Environments that give readings.
        worth: Factor on the rewards; 1 - gamma makes all values of the order of a reward.
    """

    def __init__(self, venv: VecEnv, worth: float):
        given = venv.observation_space
        assert isinstance(given, gym.spaces.Box) and given.shape == CENTRE.shape
        super().__init__(venv, gym.spaces.Box(scaled(given.low), scaled(given.high), dtype=np.float32))
        self.worth = np.float32(worth)

    def reset(self) -> np.ndarray:
        """Start an episode with every rig."""
        observations = self.venv.reset()
        assert isinstance(observations, np.ndarray)
        return scaled(observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the outputs of the policy, (n, 3)."""
        self.venv.step_async(actions_of(actions))

    def step_wait(self) -> VecEnvStepReturn:
        """Drill for one interval."""
        observations, rewards, dones, infos = self.venv.step_wait()
        assert isinstance(observations, np.ndarray)
        for i in np.flatnonzero(dones).tolist():
            infos[i]["terminal_observation"] = scaled(infos[i]["terminal_observation"])
        return scaled(observations), rewards * self.worth, dones, infos
