"""A task: what an environment was asked to be, checked, and how its episodes are drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box

from drillenv.checks import InputError, choice, count, number, shown
from drillenv.corrected import Corrected, read_model
from drillenv.env import observation as table
from drillenv.env.episodes import (
    BLOWS_RANGE,
    LAG_RANGE,
    Episode,
    draw_effect,
    draw_layers,
    draw_rig,
    draw_rocks,
    one_rock,
    read_errors,
    rig_array,
)
from drillenv.env.reward import Reward, read_reward
from drillenv.env.scenarios import Scenario, read_scenario
from drillenv.rig import AMPLITUDE_RANGE, FREQUENCY_RANGE, PRESSURE_RANGE
from drillenv.rocks import ROCKS, Rock
from drillenv.rocks import rock as rock_meant

if TYPE_CHECKING:
    from drillenv.env.batch import Batch

KINDS = ("rock", "layers", "hidden")
ACTIONS = ("absolute", "increment")
OBSERVATIONS = ("readings", "window")
RANGES = np.array([FREQUENCY_RANGE, AMPLITUDE_RANGE, PRESSURE_RANGE])
"""(3, 2) the ranges of Table 2.1 in Hz, V and bar, onto which actions are mapped."""
INCREMENTS = np.array([10.0, 0.05, 0.2])
"""Hz, V and bar by which an action of 1 moves the setting in the mode "increment"."""


class Task:
    """What both environments, scalar and vector, share. All arguments can be written as JSON.

    Args:
        kind: "rock", "layers" or "hidden".
        rock: A case of Table 2.2 (1 to 6), its name, or a record with loading_stiffness and unloading_stiffness in
            N/m: the one rock of every episode. None draws them.
        scenario: A frozen set of episodes ("train", "validation", "test", "beyond") or a file of one. None draws
            new ones.
        model: A file of corrected constants and effects (see :mod:`drillenv.corrected`). Effects on sensors are left
            aside: the readings of an environment come from sensors of its own (``noise``), and the motion and the
            reward know nothing of sensors.
        reward: A record of weights (see :class:`drillenv.env.reward.Reward`).
        actions: "absolute" or "increment".
        observations: "readings" or "window".
        noise: Factor on the noise of the sensors.
        errors: Stated standard errors by which the constants of the rig are off, drawn anew for each episode (see
            :func:`drillenv.env.episodes.draw_rig`). None: as many as are usual, one of the kind "hidden", else none.

    Raises:
        InputError: an argument is none of these, two of them contradict each other, or the model has an effect that
            only a one-body rig knows.
    """

    def __init__(
        self,
        kind: str,
        rock: int | str | Mapping[str, float] | None = None,
        scenario: str | None = None,
        model: str | None = None,
        reward: Mapping[str, float] | None = None,
        actions: str = "absolute",
        observations: str = "readings",
        noise: float = 1.0,
        errors: float | None = None,
    ):
        self.kind = choice("kind", kind, KINDS)
        self.rock: tuple[Rock, int] | None = None if rock is None else _rock(rock)
        self.corrected: Corrected = Corrected() if model is None else read_model(_path("model", model))
        if self.corrected.rock is not None:
            if self.rock is not None:
                raise InputError("rock and the model both say which rock: leave rock out, or its stiffnesses in model")
            self.rock = (self.corrected.rock, 0)
        self.scenario: Scenario | None = None
        if scenario is not None:
            if self.rock is not None or model is not None:
                raise InputError("scenario fixes rocks and rig: leave rock and model out with it")
            self.scenario = read_scenario(scenario, self.kind)
        moving = self.corrected.on_motion
        self.reward: Reward = read_reward(reward)
        self.increment: bool = choice("actions", actions, ACTIONS) == "increment"
        self.window: bool = choice("observations", observations, OBSERVATIONS) == "window"
        self.noise: float = number("noise", noise, 0.0, 100.0)
        self.rig: np.ndarray = rig_array(self.corrected.rig)
        usual = 1.0 if self.kind == "hidden" else 0.0
        self.errors: float = read_errors(errors, usual, self.rig, self.scenario is not None)
        self.effects: dict[str, dict[str, Any]] = {chosen.effect.name: chosen.given for chosen in moving}

    rest: np.ndarray = np.array([0.0, 0.0, -1.0], dtype=np.float32)
    """The action that asks for :data:`drillenv.env.episodes.START`, in absolute terms."""

    def batch(self, n: int, threads: int) -> Batch:
        """n rigs of this task."""
        from drillenv.env.batch import Batch

        return Batch(self, n, table.WINDOW_SAMPLES if self.window else 0, threads)

    @property
    def action_space(self) -> Box:
        """A box [-1, 1]^3."""
        return Box(-1.0, 1.0, (3,), np.float32)

    @property
    def observation_space(self) -> Box:
        """The box of the readings, or of the window."""
        if self.window:
            shape = (len(table.CHANNELS), table.WINDOW_SAMPLES)
            low, high = (np.broadcast_to(edge[:, None], shape) for edge in (table.CHANNEL_LOW, table.CHANNEL_HIGH))
            return Box(low.copy(), high.copy(), shape, np.float32)
        return Box(table.LOW, table.HIGH, (table.SIZE,), np.float32)

    def chosen(self, options: Mapping[str, Any] | None) -> int | None:
        """The episode of the scenario that ``options["episode"]`` names, None where it names none.

        Raises:
            InputError: unknown options, or no such episode.
        """
        chosen = None
        for key, value in (options or {}).items():
            if key != "episode":
                raise InputError(f"options has the key {shown(key)}: the one option is episode, a number of a scenario")
            if self.scenario is None:
                raise InputError("options names an episode, but the environment has no scenario: give scenario= too")
            chosen = count("episode", value, 0, len(self.scenario.episodes[self.kind]) - 1)
        return chosen

    def episode(self, rng: np.random.Generator, chosen: int | None) -> Episode:
        """The next episode: of the scenario (that of the number ``chosen``, else a random one) or drawn."""
        if self.scenario is not None:
            episodes = self.scenario.episodes[self.kind]
            return episodes[int(rng.integers(len(episodes))) if chosen is None else chosen]
        return self.draw(rng)

    def draw(self, rng: np.random.Generator) -> Episode:
        """A new episode of this task."""
        if self.rock is not None:
            layers = one_rock(*self.rock)
        elif self.kind == "rock":
            case = int(rng.integers(1, len(ROCKS) + 1))
            kl, ku = draw_rocks(np.array([case]), rng)[0].tolist()
            layers = np.array([[kl, ku, math.inf, float(case)]])
        else:
            layers = draw_layers(rng)
        hidden = self.kind == "hidden"
        return Episode(
            layers=layers,
            lag=float(rng.uniform(*LAG_RANGE)),
            blows=int(rng.integers(BLOWS_RANGE[0], BLOWS_RANGE[1] + 1)),
            phase=float(rng.uniform(0.0, 2 * math.pi)),
            rig=draw_rig(self.rig, rng, self.errors) if self.errors else self.rig,
            effects=draw_effect(rng) if hidden and not self.effects else self.effects,
        )


def _rock(given: int | str | Mapping[str, float]) -> tuple[Rock, int]:
    """A rock and the case of Table 2.2 after which its face stiffens, 0 for a rock of one's own."""
    if isinstance(given, Mapping):
        if set(given) != {"loading_stiffness", "unloading_stiffness"}:
            raise InputError(f"rock is {shown(given)}: give a record with loading_stiffness and unloading_stiffness")
        return Rock(given["loading_stiffness"], given["unloading_stiffness"]), 0
    meant = rock_meant(given)
    return meant, next((case for case, pair in ROCKS.items() if pair is meant), 0)


def _path(name: str, given: object) -> Path:
    if not isinstance(given, str | Path) or "\0" in str(given):
        raise InputError(f"{name} is {shown(given)}: give the path of a file")
    return Path(given)


def action_for(frequency: float, amplitude: float, pressure: float) -> np.ndarray:
    """(3,) float32 the action that asks for a setting in Hz, V and bar in the mode "absolute", inside the ranges."""
    middle, half = RANGES.mean(axis=1), 0.5 * (RANGES[:, 1] - RANGES[:, 0])
    action = (np.array([frequency, amplitude, pressure], dtype=float) - middle) / half
    return np.clip(action, -1.0, 1.0).astype(np.float32)
