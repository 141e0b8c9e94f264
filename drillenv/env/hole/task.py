"""The task of drilling a hole: what an environment was asked to be, checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from gymnasium.spaces import Box

from drillenv.checks import InputError, choice, number, shown
from drillenv.env.episodes import draw_rig, read_errors, rig_array
from drillenv.env.hole import shaker
from drillenv.env.hole.costs import Costs, read_costs
from drillenv.env.hole.episodes import DEEPEST, DEPTH, LAYER_ABRASIVITY, LAYER_END, Hole, draw_hole
from drillenv.env.hole.readings import HIGH, LOW
from drillenv.env.reward import Reward
from drillenv.env.scenarios import Scenario, read_scenario
from drillenv.env.task import ACTIONS, Task
from drillenv.rig import Rig

if TYPE_CHECKING:
    from drillenv.env.hole.batch import HoleBatch

TERMS = ("wear", "blunting", "breakage", "heat", "amplifier", "resonance", "abrasivity", "layers")
"""What can be left out: wear of the bit and all that follows from it; that a worn bit is blunt; that it breaks; heat of
the coil; the amplifier's limit; the frame's resonance; that layers differ in abrasivity; that there are layers."""


class HoleTask(Task):
    """What the scalar and the vector environment of ``DrillBit`` share. All arguments can be written as JSON.

    Args:
        depth: Of the holes that are drawn, in m.
        scenario: A frozen set of holes ("train", "validation", "test") or a file of one. None draws new ones.
        costs: A record of prices and durations (see :class:`drillenv.env.hole.costs.Costs`).
        without: Names of TERMS to leave out.
        lost_bit_ends: Whether an episode ends when a bit breaks, as in the short variant; else the bit is fished.
        actions: "absolute" or "increment".
        noise: Factor on the noise of the sensors.
        errors: Stated standard errors by which the constants of the rig are off, drawn anew for each hole.

    Raises:
        InputError: an argument is none of these, or scenario is given with depth or errors.
    """

    rest: np.ndarray = np.array([0.0, 0.0, -1.0, -1.0], dtype=np.float32)

    def __init__(
        self,
        depth: float | None = None,
        scenario: str | Path | None = None,
        costs: Mapping[str, float] | None = None,
        without: Sequence[str] = (),
        lost_bit_ends: bool = False,
        actions: str = "absolute",
        noise: float = 1.0,
        errors: float | None = None,
    ):
        self.kind = "hole"
        self.scenario: Scenario | None = None
        if scenario is not None:
            if depth is not None:
                raise InputError("scenario fixes the depth of its holes: leave depth out with it")
            self.scenario = read_scenario(scenario, self.kind)
        self.depth: float = DEPTH if depth is None else number("depth", depth, 0.05, DEEPEST, "m")
        self.costs: Costs = read_costs(costs)
        if isinstance(without, str) or not isinstance(without, Sequence):
            raise InputError(f"without is {shown(without)}: give a list of {', '.join(TERMS)}")
        self.without: frozenset[str] = frozenset(choice("without", name, TERMS) for name in without)
        if not isinstance(lost_bit_ends, bool):
            raise InputError(f"lost_bit_ends is {shown(lost_bit_ends)}: give True or False")
        self.lost_bit_ends = lost_bit_ends
        self.increment: bool = choice("actions", actions, ACTIONS) == "increment"
        self.window = False
        self.noise: float = number("noise", noise, 0.0, 100.0)
        self.reward = Reward()
        self.rig: np.ndarray = rig_array(Rig())
        self.errors: float = read_errors(errors, 0.0, self.rig, self.scenario is not None)

    @property
    def action_space(self) -> Box:
        """A box [-1, 1]^4."""
        return Box(-1.0, 1.0, (4,), np.float32)

    @property
    def observation_space(self) -> Box:
        """The box of the readings."""
        return Box(LOW, HIGH, LOW.shape, np.float32)

    def batch(self, n: int, threads: int) -> HoleBatch:
        """n rigs of this task."""
        from drillenv.env.hole.batch import HoleBatch

        return HoleBatch(self, n, threads)

    def episode(self, rng: np.random.Generator, chosen: int | None) -> Hole:  # type: ignore[override]
        """The next hole: of the scenario (that of the number ``chosen``, else a random one) or drawn."""
        if self.scenario is not None:
            holes = self.scenario.episodes[self.kind]
            return self.ablated(holes[int(rng.integers(len(holes))) if chosen is None else chosen])
        hole = draw_hole(self.depth, rng)
        return self.ablated(replace(hole, rig=draw_rig(self.rig, rng, self.errors)) if self.errors else hole)

    def ablated(self, hole: Hole) -> Hole:
        """The hole without the terms that lie in it and are left out."""
        layers, strengths = hole.layers.copy(), hole.strengths
        if "layers" in self.without:
            layers = layers[:1]
            layers[0, LAYER_END] = np.inf
        if "abrasivity" in self.without:
            layers[:, LAYER_ABRASIVITY] = 1.0
        if "breakage" in self.without:
            strengths = np.full_like(strengths, np.inf)
        return replace(hole, layers=layers, strengths=strengths)

    def frame_depth(self) -> float:
        """The share of the force that the frame takes at its resonance."""
        return 0.0 if "resonance" in self.without else shaker.RESONANCE_DEPTH

    def amplifier_force(self) -> float:
        """F_max in N."""
        return np.inf if "amplifier" in self.without else shaker.AMPLIFIER_FORCE
