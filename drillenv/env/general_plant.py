"""One control interval of a rig with effects beyond the paper's model: the rules of ``plant``, on the general engine.

The rig is that of :mod:`drillenv.env.plant`: the pressure follows the valve and is held over each substep at its mean,
layers and indentations of a fresh face take effect while the indenter is off the rock. What differs is that the rig moves
by :func:`drillenv.dynamics.general.integrate`, in legs. A leg ends where the pressure changes, where the sampling for the
harmonics sets in, and where the rock changes. Whether it does is seen only afterwards: the leg is then run again, into the
flight in which the change falls.

Two things may stiffen a fresh face, Table 2.2 and the effect ``rock-compaction``. Both act, one times the other, and a new
layer is a fresh face to both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from drillenv.checks import InputError
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.effects import make
from drillenv.dynamics.exact import (
    ORIGIN,
    REGIME,
    THETA,
    TURN,
    TURNS,
    V1,
    V2,
    W,
    Y,
    set_phase,
    shift_origin,
)
from drillenv.dynamics.flow import AMPLITUDE, FREE, KERNEL, LOADING, OMEGA, STATIC, STIFFNESS, UNLOADING
from drillenv.dynamics.general import integrate, make_scratch, model_for
from drillenv.dynamics.general_equations import (
    BY_EFFECTS,
    FIRST,
    IN_ROCK,
    OWN,
    Model,
    bend,
    law_depth,
    law_force,
)
from drillenv.dynamics.general_runs import DONE, SAMPLE_COLUMNS, STEPS_TOO_SHORT
from drillenv.env.plant import (
    BLOWS,
    FACE_IMPACTS,
    FACES,
    FREQUENCY,
    HARMONICS,
    INTERVAL,
    LAG,
    LAYER,
    LAYER_END,
    LAYER_FACE,
    LAYER_KL,
    LAYER_KU,
    PRESSURE,
    S_CONTACT_TIME,
    S_CONTACTS,
    S_CYCLES,
    S_DRIVE,
    S_PENETRATION,
    S_ROCK,
    S_WAVES,
    SAMPLES,
    SETTLED,
    SUBSTEP,
    VALVE,
    VOLTAGE,
    WAVES,
    Plants,
    held_pressure,
    leave_rock,
    note_impact,
    set_layer,
    set_setting,
)
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

RTOL = 1e-9
"""Relative error tolerated a step. Peaks are then good to 1e-8 and better where the motion is not chaotic."""
SLACK = 1e-9
"""A sample this share of the spacing away from the border of a leg stands on it."""
SHORTEST_FLIGHT = 1e-9
"""s: a flight shorter than this is no time to change the rock in; the next one will do."""
FACE_EFFECTS = ("rock-compaction",)
"""The effects whose extra states are a memory of the face, and begin anew with it."""
_X1, _X2, _V2, _ACCELERATION, _FORCE, _FACE = 0, 1, 3, 4, 5, 6
"""Columns of a sample of the general engine."""
_TIME, _PEAK = 0, 1
"""Columns of an impact of the general engine."""
_BEFORE, _AFTER = 1, 2
"""Columns of a switch of the general engine, behind its time."""


def _waves() -> np.ndarray:
    """(2 SAMPLES, 2 HARMONICS) cosine and sine of each harmonic at the samples of two periods."""
    place = np.arange(2 * SAMPLES)
    table = np.empty((2 * SAMPLES, 2 * HARMONICS))
    for harmonic in range(HARMONICS):
        step = max(1, 2 * harmonic) * place
        table[:, 2 * harmonic] = WAVES[step % (2 * SAMPLES)]
        table[:, 2 * harmonic + 1] = WAVES[(step - SAMPLES // 2) % (2 * SAMPLES)]
    return table


_WAVES = _waves()
_NODES, _WEIGHTS = (part.copy() for part in np.polynomial.legendre.leggauss(32))


@njit(**KERNEL)
def sprung_depth(model: Model, regime: int, z: np.ndarray) -> float:
    """How far in m the indenter stands in front of Xf: the way the rock would spring back from here."""
    if regime == FREE:
        return 0.0
    return z[W] if regime == UNLOADING else law_depth(model, UNLOADING, law_force(model, LOADING, z[W], z), z)


@njit(**KERNEL)
def sprung_energy(model: Model, regime: int, z: np.ndarray) -> float:
    """Energy in J that the rock law would give back from here, by Gauss' quadrature over the square root of depth."""
    depth = sprung_depth(model, regime, z)
    energy = 0.0
    for i in range(_NODES.size):
        s = 0.5 * (1.0 + _NODES[i])
        energy += _WEIGHTS[i] * s * bend(model, UNLOADING, depth * s * s, z)
    return model.ku * depth * energy


@njit(**KERNEL)
def find_cut(row, spare, rig, layers, memory, impacts, switches, reach: float) -> float:
    """Where a leg has to be cut for a change of the rock, in s from its start; -1 where it may stand.

    The rock changes in a flight that both begins and ends in the leg (in a last flight that goes on, the leg need not be
    cut). Its time is the middle of that flight, or of one before it.

    Args:
        row: The model of the exact engine, which holds the stiffnesses in force.
        spare: Room for such a model.
        rig, layers, memory: Rows of the rig's Plants.
        impacts, switches: Of the leg, from the general engine.
        reach: The depth in m that Xf has not passed in the leg.
    """
    layer = int(memory[LAYER])
    passes = layer < layers.shape[0] - 1 and reach >= layers[layer, LAYER_END]
    young = layers[layer, LAYER_FACE] > 0.0 and memory[FACE_IMPACTS] <= FACES.shape[1] * memory[BLOWS]
    if not (passes or young):
        return -1.0
    later = memory.copy()
    flights, impact = 0, 0
    for k in range(switches.shape[0] - 1):
        if switches[k, _AFTER] != FREE or switches[k + 1, _TIME] - switches[k, _TIME] < SHORTEST_FLIGHT:
            continue
        flights += 1
        if young:
            while impact < impacts.shape[0] and impacts[impact, _TIME] <= switches[k, _TIME]:
                impact += 1
            later[FACE_IMPACTS] = memory[FACE_IMPACTS] + impact
            set_layer(spare, rig, layers, later)
            if spare[LOADING, STIFFNESS] != row[LOADING, STIFFNESS] or (
                spare[UNLOADING, STIFFNESS] != row[UNLOADING, STIFFNESS]
            ):
                return 0.5 * (switches[k, _TIME] + switches[k + 1, _TIME])
    if passes and flights > 0:
        # how deep the face lay in each flight is not known: halve the leg until it is
        wanted = flights // 2
        for k in range(switches.shape[0] - 1):
            if switches[k, _AFTER] == FREE and switches[k + 1, _TIME] - switches[k, _TIME] >= SHORTEST_FLIGHT:
                if wanted == 0:
                    return 0.5 * (switches[k, _TIME] + switches[k + 1, _TIME])
                wanted -= 1
    return -1.0


@njit(**KERNEL)
def enter_leg(plants: Plants, i: int, regime: int, z, leg, held: float, impacts, switches, sums, peaks):
    """Enter a leg that stands into the sums, the peaks and the row of its rig, and change the rock if it is left.

    Args:
        plants, i: The rig.
        regime, z: Regime and state vector of the general engine at the leg's end.
        leg: (5,) start of the leg in s since the start of the interval, its length in s, what the origin moved by in m
            as a sum of two numbers, and the phase at the end in rad.
        held: Pressure held in bar.
        impacts, switches: Of the leg, from the general engine.
        sums, peaks: As in ``plant.drill``.
    """
    model, state = borrowed(plants.models)[i], borrowed(plants.states)[i]
    rig, layers, memory = borrowed(plants.rigs)[i], borrowed(plants.layers)[i], borrowed(plants.memories)[i]
    start, seconds, theta = leg[0], leg[1], leg[4]
    for k in range(impacts.shape[0]):
        note_impact(impacts[k, _PEAK], (start + impacts[k, _TIME]) * memory[FREQUENCY], sums, peaks)
        memory[FACE_IMPACTS] += 1.0
    since, touching = 0.0, state[REGIME] != FREE
    for k in range(switches.shape[0]):
        if switches[k, _BEFORE] == FREE:
            sums[S_CONTACTS] += 1.0
            since, touching = switches[k, _TIME], True
        elif switches[k, _AFTER] == FREE:
            sums[S_CONTACT_TIME] += switches[k, _TIME] - since
            touching = False
    if touching:
        sums[S_CONTACT_TIME] += seconds - since
    # the engine has taken off whole turns, as many as it takes to come out at this phase
    state[TURNS] += round((state[THETA] + TURN * memory[FREQUENCY] * seconds - theta) / TURN)
    while theta >= TURN:
        theta -= TURN
        state[TURNS] += 1.0
    set_phase(theta, state)
    shift_origin(state, leg[2])
    shift_origin(state, leg[3])
    state[Y], state[V1], state[V2], state[W], state[REGIME] = z[0], z[1], z[2], z[3], regime
    if regime == FREE and leave_rock(model, state, rig, layers, memory):
        set_layer(model, rig, layers, memory)
        set_setting(model, rig, memory[FREQUENCY], memory[VOLTAGE], held)


@dataclass(frozen=True, slots=True)
class GeneralSnapshot:
    """What a rig on the general engine keeps beside its row of Plants. Copies and pickles."""

    effects: Mapping[str, Mapping[str, float]]
    z: np.ndarray
    peak: float


class GeneralPlant:
    """A rig with effects beyond the paper's model.

    Args:
        plants, i: The rig's row, just put at rest by :func:`drillenv.env.plant.place`.
        effects: Names of effects, with the values of their parameters by symbol.

    Raises:
        InputError: an effect that the registry does not have, or that does not act on the motion.
    """

    def __init__(self, plants: Plants, i: int, effects: Mapping[str, Mapping[str, float]]):
        self._prepare(plants, i, effects)
        model = self._model_at(Setting(85.0, 0.45, 1.0))
        self.z = np.zeros(model.tally + BY_EFFECTS + len(self._chosen))
        self.z[:4] = plants.states[i, :4]
        self.peak = 0.0
        """Largest force in N of a loading that has not come to its turn, where it may lie before the turn."""

    def _prepare(self, plants: Plants, i: int, effects: Mapping[str, Mapping[str, float]]) -> None:
        self.plants, self.i = plants, i
        self.effects = {name: dict(values) for name, values in effects.items()}
        self._chosen = tuple(make(name, **values) for name, values in self.effects.items())
        self._rig = Rig(*plants.rigs[i].tolist())
        self._scratch: Any = None
        self._spare = np.zeros_like(plants.models[i])

    @classmethod
    def restored(cls, plants: Plants, i: int, snapshot: GeneralSnapshot) -> GeneralPlant:
        """The rig as it was when the snapshot was taken; its row of plants has been put back already."""
        self = cls.__new__(cls)
        self._prepare(plants, i, snapshot.effects)
        self.z, self.peak = snapshot.z.copy(), snapshot.peak
        return self

    def snapshot(self) -> GeneralSnapshot:
        """What to go on from exactly, together with the rig's row of plants."""
        return GeneralSnapshot(self.effects, self.z.copy(), self.peak)

    def __getstate__(self) -> dict[str, Any]:
        # a model holds addresses of compiled functions, which no other process has
        return {"plants": self.plants, "i": self.i, "kept": self.snapshot()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(GeneralPlant.restored(state["plants"], state["i"], state["kept"]).__dict__)

    def drill(self, setting: np.ndarray, sums: np.ndarray, peaks: np.ndarray, window: np.ndarray) -> None:
        """Run the rig for one interval at a setting (3,) in Hz, V and bar.

        Fills ``sums``, ``peaks`` and ``window`` and moves the rig's row of plants on, as :func:`drillenv.env.plant.drill`
        does.

        Raises:
            InputError: effects under which the motion cannot be followed.
        """
        Interval(self, setting, sums, peaks, window).run()
