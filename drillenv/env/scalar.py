"""The environment for Gymnasium: one rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from drillenv.checks import InputError, shown
from drillenv.env import observation as table
from drillenv.env.batch import Snapshot, trace_of
from drillenv.env.core import checked_actions, window_observation
from drillenv.env.plant import INTERVAL
from drillenv.env.task import Task
from drillenv.env.truth import T_AMPLITUDE, T_FREQUENCY, T_VALVE

TRACE_SAMPLES = 5000
"""Samples of an interval that a picture shows: 20 kHz."""
_ONE = np.ones(1, dtype=bool)


@dataclass(frozen=True, slots=True)
class EnvState:
    """A point of an episode to go on from, from :meth:`DrillEnv.get_state`. Copies and pickles."""

    rig: Snapshot
    noise: dict[str, Any]
    """State of the generator that the noise comes from."""
    window: np.ndarray
    before: Snapshot | None


class DrillEnv(gym.Env[np.ndarray, np.ndarray]):
    """A percussive-drilling rig to be steered over rocks that it does not know.

    A shaker drives an indenter into rock while a cylinder pushes from behind. The motion drills best as P-1-I-1, one
    strong blow a period of the excitation; more pressure breaks it into weak multiple blows and chatter, and where
    that happens depends on the rock. Every step is a control interval of 0.25 s of an exact simulation; nothing is
    reset between steps.

    ## Action space

    `Box(-1, 1, (3,), float32)`. With `actions="absolute"` it is mapped onto the ranges of Table 2.1 of the paper, with
    `actions="increment"` it moves the present setting, which stays inside them:

    | Num | Control   | Unit | -1   | 1    | step of an increment of 1 |
    |-----|-----------|------|------|------|---------------------------|
    | 0   | frequency | Hz   | 50   | 120  | 10                        |
    | 1   | amplitude | V    | 0.30 | 0.60 | 0.05                      |
    | 2   | pressure  | bar  | 0.6  | 1.8  | 0.2                       |

    Frequency and amplitude act at once. The pressure in the cylinder follows the valve as a first-order lag with a
    time constant of 0.3 to 1 s, drawn for each episode: a cylinder has to fill.

    ## Observation space

    With `observations="readings"`, `Box(15,)` float32: what the rig's sensors give over the last interval, with
    normal noise of the standard deviation in the table (times `noise`), clipped to its ends. To scale it to [-1, 1],
    wrap it in `gymnasium.wrappers.RescaleObservation`.

    | Num | Observation | Unit | Min | Max | Noise |
    |-----|-------------|------|-----|-----|-------|
    | 0 | mean_peak_force: mean peak of the impacts above 50 N | kN | 0 | 5 | 0.01 |
    | 1 | largest_peak_force: largest peak | kN | 0 | 5 | 0.02 |
    | 2 | peak_force_spread: standard deviation of the peaks | kN | 0 | 2.5 | 0.01 |
    | 3 | impacts_per_cycle: impacts above 50 N a period of the excitation | 1 | 0 | 10 | 0.01 |
    | 4 | period_two: change of the strongest peak from period to period, a share of it | 1 | 0 | 2 | 0.005 |
    | 5 | contact_share: share of the time in contact | 1 | 0 | 1 | 0.005 |
    | 6 | half_harmonic: acceleration of the indenter at half the frequency | g | 0 | 50 | 0.1 |
    | 7 | first_harmonic: at the frequency | g | 0 | 50 | 0.1 |
    | 8 | second_harmonic: at twice the frequency | g | 0 | 50 | 0.1 |
    | 9 | third_harmonic: at three times the frequency | g | 0 | 50 | 0.1 |
    | 10 | penetration_rate: penetration made over the interval's length | mm/s | -1 | 9 | 0.05 |
    | 11 | frequency: present frequency | Hz | 50 | 120 | 0 |
    | 12 | amplitude: present amplitude | V | 0.3 | 0.6 | 0 |
    | 13 | valve_pressure: pressure asked for | bar | 0.6 | 1.8 | 0 |
    | 14 | pressure: pressure in the cylinder by the gauge | bar | 0.5 | 1.9 | 0.005 |

    With `observations="window"`, `Box((4, 1000))` float32: the samples themselves, at 4 kHz: excitation (V), force
    (kN), acceleration (g) and pressure (bar).

    ## Reward

    In mm/s, for each interval:

        rate * (0.25 + 0.75 * strong_share) - 5 * excess - 0.002 * power

    - `rate`, the penetration rate in mm/s, is what drilling is for: 1 to 3 mm/s.
    - `strong_share`, the share of the periods with one blow that repeats the one before within 10 % (P-1-I-1), each
      counted by its peak force over the rating of 2 kN, at most 1. Progress made by multiple blows and chatter, which
      wear indenter and rig, is worth a quarter, and so, nearly, is that of the weak P-1-I-1 of high pressure (0.7 kN).
    - `excess`, the contact force above the rating of 2 kN, summed over the impacts of a period, in kN: the tool wears.
      100 N above the rating in every period cost 0.5 mm/s. Without this term one setting fits all rocks.
    - `power`, the mean power of the drive, 30 to 80 W, that is 0.06 to 0.16 mm/s.

    `reward=` takes a record of other weights, see :class:`drillenv.env.reward.Reward`.

    ## Starting state

    The rig at rest, the indenter touching a fresh face, run for one interval at 85 Hz, 0.45 V and 0.6 bar. The rock is
    hidden. It is drawn from the six cases of Table 2.2 with their measured spread: one for the whole episode in
    `drillenv/Drill-v0`, layers of 5 to 20 mm in `drillenv/DrillLayers-v0`. A fresh face is soft and stiffens over 10
    to 100 impacts, as in the ten indentations of Table 2.2. `drillenv/DrillHidden-v0` also draws the rig's constants
    with the error that a lab has on them, and one effect that the paper leaves out; `errors=1.0` draws such constants,
    and no effect, in the others.

    ## Episode end

    An episode is truncated after 80 steps (20 s) in `Drill-v0`, after 240 steps (60 s) in the others. It never
    terminates.

    ## Info

    The truth about the interval, which a controller must not see: every name of :data:`drillenv.env.truth.TRUTH` (rock,
    stiffness of the layer at the end, depth in mm, force, powers in W and so on, in the units given there), `motion`
    (P-n-I-m, or "none" where the impacts did not repeat), the terms of the reward in mm/s (`penetration_reward`,
    `force_reward`, `energy_reward`) and `cost`, the excess in N, for constrained learning.

    ## Arguments

    All of them can be written as JSON, so that a registered environment can be stored.

    Args:
        kind: "rock", "layers" or "hidden"; set by the id.
        rock: A case of Table 2.2 (1 to 6), its name, or {"loading_stiffness": ..., "unloading_stiffness": ...} in N/m:
            the one rock of every episode.
        scenario: "train", "validation", "test", "beyond" (rocks outside Table 2.2), or a file of one's own: frozen
            episodes, of which `reset(options={"episode": i})` takes one and `reset()` a random one.
        model: A file of corrected constants and effects, see :mod:`drillenv.corrected`.
        reward: A record of weights, for instance {"force": 10.0, "rating": 1800.0}.
        actions: "absolute" or "increment".
        observations: "readings" or "window".
        noise: Factor on the noise of the sensors; 0 for none.
        errors: How many stated standard errors (:data:`drillenv.rig.TOLERANCES`) the constants of the rig are off by:
            drawn anew for each episode, normal, cut off at three standard deviations. 0 for none, at most 10; left
            out, 1 in `DrillHidden-v0` and 0 in the others. Not with a scenario, whose rigs are frozen.
        render_mode: "human", "rgb_array" or None.

    Raises:
        InputError: an argument is none of these, or two of them contradict each other.

    ## Version history

    - v0: first version.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 4}

    def __init__(
        self,
        kind: str = "layers",
        rock: int | str | Mapping[str, float] | None = None,
        scenario: str | None = None,
        model: str | None = None,
        reward: Mapping[str, float] | None = None,
        actions: str = "absolute",
        observations: str = "readings",
        noise: float = 1.0,
        errors: float | None = None,
        render_mode: str | None = None,
    ):
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError(f"render_mode is {shown(render_mode)}: give one of human, rgb_array, or None")
        task = Task(kind, rock, scenario, model, reward, actions, observations, noise, errors)
        self._set_up(task, render_mode)

    def _set_up(self, task: Task, render_mode: str | None) -> None:
        """Build the one rig of a task."""
        self.render_mode = render_mode
        self.task = task
        self.action_space = task.action_space
        self.observation_space = task.observation_space
        self._batch = task.batch(1, threads=1)
        self._noise = np.zeros((1, self._batch.readings.shape[1]))
        self._before: Snapshot | None = None
        self._started = False
        self._renderer: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Put the rig at rest on a fresh face and run it for one interval at the start setting.

        Args:
            seed: Of everything random in this and the following episodes.
            options: ``{"episode": i}`` takes episode i of the scenario.

        Returns:
            The observation of that interval, and its info.

        Raises:
            InputError: unknown options.
        """
        chosen = self.task.chosen(options)  # before the seed is taken, so that a bad option changes nothing
        super().reset(seed=seed)
        episode = self.task.episode(self.np_random, chosen)
        self._batch.load(0, episode)
        self._started = True
        observation, info = self._advance(self.task.rest, absolute=True)
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Drill for one interval.

        Args:
            action: (3,) frequency, amplitude and pressure, each from -1 to 1.

        Returns:
            Observation, reward in mm/s, False, False (the registration's time limit truncates) and the info.

        Raises:
            InputError: an action of another shape, not finite or outside [-1, 1]; the rig is left as it was.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._started:
            raise gym.error.ResetNeeded("step was called before reset: call reset first")
        checked = checked_actions(action, self.task.rest.shape)
        observation, info = self._advance(checked, absolute=False)
        if self.render_mode == "human":
            self.render()
        return observation, float(self._batch.rewards[0]), bool(self._batch.terminated[0]), False, info

    def _advance(self, action: np.ndarray, absolute: bool) -> tuple[np.ndarray, dict[str, Any]]:
        """One interval, its observation and info."""
        batch, task = self._batch, self.task
        if self.render_mode is not None:
            self._before = batch.snapshot(0)
        if not task.window:
            self.np_random.standard_normal(out=self._noise[0])
        batch.step(_ONE, action[None], task.increment and not absolute, self._noise)
        if task.window:
            noise = self.np_random.standard_normal((len(table.CHANNELS), table.WINDOW_SAMPLES))
            observation = window_observation(batch.windows[0], noise, task.noise)
        else:
            observation = batch.readings[0].copy()
        return observation, batch.info(0)

    def get_state(self) -> EnvState:
        """The present point of the episode, exactly: rig, rock, phase, pressure, and the generator of the noise.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._started:
            raise gym.error.ResetNeeded("get_state was called before reset: call reset first")
        noise = dict(self.np_random.bit_generator.state)
        return EnvState(self._batch.snapshot(0), noise, self._batch.windows[0].copy(), self._before)

    def set_state(self, state: EnvState) -> None:
        """Go on from a point of an episode of this environment or of one built alike.

        A time limit around the environment keeps its own count.

        Raises:
            InputError: not a state from get_state.
        """
        if not isinstance(state, EnvState):
            raise InputError(f"state is {shown(state)}: give what get_state returned")
        if state.window.shape != self._batch.windows[0].shape:
            raise InputError("state is of an environment with other observations: give one built alike")
        self._batch.restore(0, state.rig)
        self._batch.windows[0] = state.window
        self.np_random.bit_generator.state = state.noise
        self._before = state.before
        self._started = True

    def trace(self, samples: int = TRACE_SAMPLES) -> np.ndarray:
        """(samples, 8) the last interval in detail, columns as in :data:`drillenv.env.plant.TRACE`.

        Raises:
            InputError: the environment was built without a render_mode, or has not been reset.
        """
        if self._before is None:
            raise InputError("no interval is kept: build the environment with a render_mode, and reset it")
        truth = self._batch.truths[0]
        setting = truth[[T_FREQUENCY, T_AMPLITUDE, T_VALVE]]
        return trace_of(self._before, setting, samples)

    def render(self) -> np.ndarray | None:
        """A picture of the last interval: (height, width, 3) uint8 for rgb_array, shown on the screen for human."""
        if self.render_mode is None:
            gym.logger.warn("render was called without a render_mode: pass render_mode='rgb_array' or 'human' to make")
            return None
        if self._before is None:
            raise gym.error.ResetNeeded("render was called before reset: call reset first")
        if self._renderer is None:
            from drillenv.env.rendering import Renderer

            self._renderer = Renderer(self.render_mode)
        batch, rating = self._batch, self.task.reward.rating
        truth, layers, rig = batch.truths[0], batch.plants.layers[0], batch.plants.rigs[0]
        return self._renderer.draw(self.trace(), truth, layers, rig, rating, INTERVAL, float(batch.rewards[0]))

    def close(self) -> None:
        """Close the window, if there is one. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        self._batch.close()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}
