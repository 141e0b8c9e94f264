"""A step of many rigs that each drill a hole.

Blows last milliseconds, wear and heat take minutes, so the two are treated apart, as averaging does (Sanders, Verhulst
& Murdock, Averaging Methods in Nonlinear Dynamical Systems, 2007): the motion is run exactly for one control interval
of 0.25 s, with the bit as worn and the frame as it is, and what it did stands for :data:`STEP` seconds of drilling.
The motion goes on from step to step. A new stiffness is met as it is under a change of layer: the force does not jump.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.dynamics.exact import REGIME, THETA, TURN, TURNS, W, make_scratch, shift_origin
from drillenv.dynamics.flow import FREE, STIFFNESS, set_plant
from drillenv.env import plant
from drillenv.env.batch import Batch, set_from_action
from drillenv.env.core import motion_name
from drillenv.env.episodes import START
from drillenv.env.hole import shaker
from drillenv.env.hole.bit import stiffening, wear_of
from drillenv.env.hole.costs import BIT as BIT_PRICE
from drillenv.env.hole.costs import CHANGE_TIME, COMPRESSOR, ENERGY, FISHING_TIME, METRE, RIG_RATE
from drillenv.env.hole.episodes import LAYER_ABRASIVITY, LAYER_END, LAYER_KL, LAYER_KU, MOST_BITS, Hole
from drillenv.env.hole.readings import (
    ABRASIVITY,
    BEGUN,
    BIT,
    BIT_FROM,
    BLOWS,
    BROKEN,
    CHANGED,
    DEPTH,
    GAIN,
    HOLE_SIZE,
    LAYER,
    OWED,
    RESONANCE,
    RISE,
    SHOWN,
    SIZE,
    SPENT,
    STEP_DEPTH,
    STEP_SPENT,
    STEP_TIME,
    TARGET,
    TIME,
    TRIPPED,
    WEAR,
    observe_hole,
)
from drillenv.env.observation import observe
from drillenv.env.plant import MOST_LAYERS, PEAKS, S_KEPT, SUMS_SIZE, Plants, drill
from drillenv.env.truth import (
    MOST_CYCLES,
    T_DEPTH,
    T_DRIVE,
    T_LABEL,
    T_LAYER,
    T_PERIOD,
    T_RATE,
    T_SINGLE,
    TRUTH,
    summarise,
)

if TYPE_CHECKING:
    from drillenv.env.hole.task import HoleTask

STEP = 15.0
"""Seconds of drilling that a step stands for."""
ARRIVED = 1e-3
"""Lag of the pressure in s: within a step it has long arrived."""
NAMED = tuple((name, j) for j, name in enumerate(TRUTH) if j not in (T_LAYER, T_DEPTH))
"""What an info takes from the row of truth: layer and depth there are those of the motion's own 0.25 s."""


class Holes(NamedTuple):
    """The holes of a batch, as arrays."""

    states: np.ndarray
    """(n, HOLE_SIZE), see :mod:`drillenv.env.hole.readings`."""
    layers: np.ndarray
    """(n, MOST_LAYERS, 4), see :mod:`drillenv.env.hole.episodes`."""
    strengths: np.ndarray
    """(n, MOST_BITS)."""


class Limits(NamedTuple):
    """What of the physics is switched on, the same for all rigs of a batch."""

    wears: float
    """1.0, or 0.0 without wear."""
    blunts: float
    """1.0, or 0.0 where a worn bit stays sharp."""
    heats: float
    """1.0, or 0.0 for a coil that stays cold."""
    amplifier: float
    """F_max in N."""
    frame: float
    """Share of the force that the frame takes at its resonance."""
    lost_bit_ends: bool


@njit(**INLINE)
def meet_rock(plants: Plants, i: int, hole: np.ndarray, layers: np.ndarray, limits: Limits) -> None:
    """Write the stiffnesses of the present layer under the present bit into the model; the force goes on."""
    model, state, rig = plants.models[i], plants.states[i], plants.rigs[i]
    layer = int(hole[LAYER])
    stiffer = stiffening(limits.blunts * hole[WEAR])
    loading, unloading = layers[layer, LAYER_KL] * stiffer, layers[layer, LAYER_KU] * stiffer
    plants.layers[i, :, plant.LAYER_KL], plants.layers[i, :, plant.LAYER_KU] = loading, unloading
    regime = int(state[REGIME])
    before = model[regime, STIFFNESS]
    set_plant(rig[plant.RIG_M1], rig[plant.RIG_M2], rig[plant.RIG_K], rig[plant.RIG_C], loading, unloading, model)
    if regime != FREE:
        scaled = state[W] * before / model[regime, STIFFNESS]
        shift_origin(state, state[W] - scaled)
        state[W] = scaled


@njit(**INLINE)
def fit_bit(hole: np.ndarray, price: float, duration: float) -> None:
    """A sharp bit in the place of the present one, which takes ``duration`` in s; the coil cools meanwhile."""
    hole[BIT] += 1.0
    hole[WEAR], hole[BLOWS], hole[BIT_FROM] = 0.0, 0.0, hole[DEPTH]
    hole[STEP_SPENT] += price
    stand(hole, duration)


@njit(**INLINE)
def stand(hole: np.ndarray, duration: float) -> None:
    """Let the rig stand for ``duration`` in s."""
    hole[STEP_TIME] += duration
    hole[RISE] = shaker.rise_after(hole[RISE], 0.0, duration)


@njit(**INLINE)
def trip_or_break(hole: np.ndarray, strengths: np.ndarray, costs: np.ndarray) -> None:
    """What follows a coil that is too hot, and a bit that breaks."""
    if hole[RISE] > shaker.LIMIT:
        hole[TRIPPED] += 1.0
        stand(hole, shaker.TRIP_TIME)
    if hole[WEAR] >= strengths[int(hole[BIT]) % MOST_BITS]:
        hole[BROKEN] += 1.0
        fit_bit(hole, costs[BIT_PRICE], costs[FISHING_TIME])


@njit(**INLINE)
def go_on(hole, layers, strengths, truth, worn: float, blows: float, setting, limits: Limits, costs) -> float:
    """Let what an interval did stand for a step of the hole. Returns what the step earned less what it cost, in EUR.

    ``truth`` is of the interval, ``worn`` and ``blows`` are a second.
    """
    rate, left = 1e-3 * truth[T_RATE], hole[TARGET] - hole[DEPTH]
    duration = STEP
    if rate * STEP >= left:
        duration = left / rate
        hole[STEP_DEPTH] = left
        hole[DEPTH] = hole[TARGET]
    else:
        hole[STEP_DEPTH] = rate * STEP
        hole[DEPTH] += hole[STEP_DEPTH]
    hole[STEP_TIME] += duration
    hole[WEAR] += limits.wears * worn * duration
    hole[BLOWS] += blows * duration
    final = limits.heats * shaker.final_rise(setting[0], setting[1])
    hole[RISE] = shaker.rise_after(hole[RISE], final, duration)
    power = costs[COMPRESSOR] + shaker.COIL_POWER * final / shaker.LIMIT + truth[T_DRIVE]
    hole[STEP_SPENT] += costs[ENERGY] * power * duration + hole[OWED]
    hole[OWED] = 0.0
    trip_or_break(hole, strengths, costs)
    hole[STEP_SPENT] += costs[RIG_RATE] * hole[STEP_TIME]
    hole[SPENT] += hole[STEP_SPENT]
    hole[TIME] += hole[STEP_TIME]
    while hole[DEPTH] >= layers[int(hole[LAYER]), LAYER_END]:
        hole[LAYER] += 1.0
    hole[ABRASIVITY] = layers[int(hole[LAYER]), LAYER_ABRASIVITY]
    return costs[METRE] * hole[STEP_DEPTH] - hole[STEP_SPENT]


@njit(**KERNEL)
def step_holes(
    plants: Plants,
    holes: Holes,
    first: int,
    last: int,
    which,
    actions,
    increment: bool,
    limits: Limits,
    costs,
    rating: float,
    noise,
    strength: float,
    truths,
    seen,
    rewards,
    ended,
    windows,
) -> None:
    """One step of the rigs ``first`` to ``last`` of those marked in ``which``.

    The first step of an episode only sets the rig going: it gives readings, drills nothing and costs nothing.
    """
    sums, peaks, cycles = np.empty(SUMS_SIZE), np.empty((PEAKS, 2)), np.empty((MOST_CYCLES, 3))
    setting, scratch = np.empty(3), make_scratch()
    for i in range(first, last):
        if not which[i]:
            continue
        hole, layers, strengths = holes.states[i], holes.layers[i], holes.strengths[i]
        hole[STEP_DEPTH] = hole[STEP_SPENT] = hole[STEP_TIME] = 0.0
        begun = hole[BEGUN] > 0.0
        if begun and actions[i, 3] > 0.0:
            hole[CHANGED] += 1.0
            fit_bit(hole, costs[BIT_PRICE], costs[CHANGE_TIME])
        set_from_action(actions[i], increment, plants.memories[i], setting)
        setting[1] = min(setting[1], shaker.largest_amplitude(setting[0], limits.amplifier))
        share = shaker.share_transmitted(setting[0], hole[RESONANCE], limits.frame)
        plants.rigs[i, plant.RIG_DRIVE] = hole[GAIN] * share
        meet_rock(plants, i, hole, layers, limits)
        turns = plants.states[i, TURNS] + plants.states[i, THETA] / TURN
        drill(plants, i, setting, sums, peaks, windows[i], scratch)
        summarise(sums, peaks, turns, rating, cycles, plants.layers[i], plants.memories[i], truths[i])
        rewards[i] = 0.0
        if begun:
            kept, single = int(sums[S_KEPT]), truths[i, T_SINGLE]
            worn, blows = wear_of(peaks, kept, single, hole[ABRASIVITY], rating)
            before = hole[BROKEN]
            rewards[i] = go_on(hole, layers, strengths, truths[i], worn, blows, setting, limits, costs)
            lost = limits.lost_bit_ends and hole[BROKEN] > before
            ended[i] = lost or hole[DEPTH] >= hole[TARGET]
        hole[BEGUN] = 1.0
        observe(truths[i], noise[i], strength, seen[i])
        observe_hole(hole, noise[i], strength, seen[i])


class HoleBatch(Batch):
    """n rigs that each drill a hole.

    Attributes:
        readings: (n, SIZE) float32, what the instruments say of the last step.
        rewards: (n,) in EUR.
        holes: The state of each hole.
    """

    def __init__(self, task: HoleTask, n: int, threads: int):
        super().__init__(task, n, 0, threads)
        self.readings: np.ndarray = np.zeros((n, SIZE), dtype=np.float32)
        layers = np.zeros((n, MOST_LAYERS, 4))
        self.holes: Holes = Holes(np.zeros((n, HOLE_SIZE)), layers, np.zeros((n, MOST_BITS)))
        self._rating = task.reward.rating
        self._costs = task.costs.as_array()
        without = task.without
        self._limits = Limits(
            wears=0.0 if "wear" in without else 1.0,
            blunts=0.0 if "blunting" in without else 1.0,
            heats=0.0 if "heat" in without else 1.0,
            amplifier=task.amplifier_force(),
            frame=task.frame_depth(),
            lost_bit_ends=task.lost_bit_ends,
        )

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """The arrays that change while the rigs drill."""
        return (*self.plants, *self.holes, self.terminated)

    def load(self, i: int, episode: Hole) -> None:  # type: ignore[override]
        """Put rig i over a hole that is not begun, at rest on its first layer."""
        self.terminated[i] = False
        plants, holes = self.plants, self.holes
        plants.rigs[i] = episode.rig
        top = episode.layers[0]
        plants.layers[i] = top[LAYER_KL], top[LAYER_KU], np.inf, 0.0
        memory = plants.memories[i]
        memory[:] = 0.0
        memory[plant.PRESSURE] = memory[plant.VALVE] = START.pressure
        memory[plant.FREQUENCY], memory[plant.VOLTAGE] = START.frequency, START.amplitude
        memory[plant.LAG], memory[plant.BLOWS] = ARRIVED, 1.0
        memory[plant.LAST_TURNS] = -1e6  # long ago, so that no impact takes the first one for its repetition
        plant.place(plants, i, episode.phase)
        holes.layers[i, : len(episode.layers)] = episode.layers
        holes.layers[i, len(episode.layers) :] = episode.layers[-1]
        holes.strengths[i] = episode.strengths
        hole = holes.states[i]
        hole[:] = 0.0
        hole[TARGET], hole[RESONANCE], hole[ABRASIVITY] = episode.depth, episode.resonance, top[LAYER_ABRASIVITY]
        hole[OWED], hole[GAIN] = self._costs[BIT_PRICE], episode.rig[plant.RIG_DRIVE]

    def _step_rigs(self, first: int, last: int, which, actions, increment: bool, noise) -> None:
        step_holes(
            self.plants,
            self.holes,
            first,
            last,
            which,
            actions,
            increment,
            self._limits,
            self._costs,
            self._rating,
            noise,
            self.task.noise,
            self.truths,
            self.readings,
            self.rewards,
            self.terminated,
            self.windows,
        )

    def info(self, i: int) -> dict[str, Any]:
        """The truth about the last step of rig i."""
        truth, state = self.truths[i].tolist(), self.holes.states[i].tolist()
        info: dict[str, Any] = {name: truth[j] for name, j in NAMED}
        info["motion"] = motion_name(truth[T_PERIOD], truth[T_LABEL])
        info["cost"] = info["force_excess"]
        info |= {name: state[j] for name, j in SHOWN.items()}
        left = float(self._costs[METRE]) * (state[TARGET] - state[DEPTH])
        return info | {"cost_per_metre": (state[SPENT] + left) / state[TARGET]}

    def infos(self, which: np.ndarray) -> dict[str, Any]:
        """As ``info`` for the rigs marked in ``which`` (n,), in Gymnasium's form."""
        truths = np.where(which[:, None], self.truths, 0.0)
        states = np.where(which[:, None], self.holes.states, 0.0)
        infos: dict[str, Any] = {name: truths[:, j].copy() for name, j in NAMED}
        infos["motion"] = np.array([motion_name(*label) for label in truths[:, (T_PERIOD, T_LABEL)].tolist()], object)
        infos["motion"][~which] = None
        infos["cost"] = infos["force_excess"].copy()
        infos |= {name: states[:, j].copy() for name, j in SHOWN.items()}
        left = self._costs[METRE] * (states[:, TARGET] - states[:, DEPTH])
        target = np.where(which, states[:, TARGET], 1.0)
        infos["cost_per_metre"] = np.where(which, (states[:, SPENT] + left) / target, 0.0)
        return infos | {f"_{key}": which.copy() for key in infos}
