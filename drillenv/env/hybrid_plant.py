"""One control interval of a rig with effects beyond the paper's model: the rules of ``plant``, on the hybrid engine.

As in :mod:`drillenv.env.plant` the pressure follows the valve and is held over each substep at its mean, and layers and
the indentations of a fresh face take effect where the indenter leaves the rock. What differs is that the rig goes on by
:func:`drillenv.dynamics.hybrid.advance.advance`, a step at a time, and that samples are read off each step.

Two things may stiffen a fresh face, Table 2.2 and the effect ``rock-compaction``. Both act, one times the other, and a
new layer is a fresh face to both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from drillenv.checks import InputError, shown
from drillenv.compiling import compile_for
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import KERNEL, NO, YES, constants
from drillenv.dynamics.effects import make
from drillenv.dynamics.exact import CARRY as STATE_CARRY
from drillenv.dynamics.exact import ORIGIN, REGIME, THETA, TURNS, set_phase
from drillenv.dynamics.flow import AMPLITUDE, FREE, LOADING, STATIC, STIFFNESS, UNLOADING, sine_cosine
from drillenv.dynamics.flow import OMEGA as ROW_OMEGA
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.dynamics.hybrid.advance import WENT_ON, advance, prepare, read_speed, read_state
from drillenv.dynamics.hybrid.events import set_factor, shift_origin
from drillenv.dynamics.hybrid.model import LONGEST_SHARE, Motion, fresh_motion, model_for
from drillenv.dynamics.hybrid.run import depth_of_face, lost_by
from drillenv.dynamics.hybrid.runge_kutta import BEGIN_D, SPARE, SPARE_SLOPE, make_scratch
from drillenv.dynamics.hybrid.vector_field import IN_ROCK, TALLY, law_depth, law_force
from drillenv.env.episodes import START
from drillenv.env.plant import (
    FACE_IMPACTS,
    FREQUENCY,
    HARMONICS,
    INTERVAL,
    LAG,
    LAYER,
    LAYER_KL,
    LAYER_KU,
    PEAKS,
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
    SUMS_SIZE,
    TRACE,
    VALVE,
    VOLTAGE,
    Plants,
    add_sample,
    held_pressure,
    leave_rock,
    make_plants,
    never_left,
    note_impact,
    set_layer,
    set_setting,
)
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

RTOL = 2e-7
"""Relative error tolerated a step. Twenty periods are then good to 1e-5 and better where the motion is not chaotic."""
OUTWARD, NONE = constants(UNLOADING, 0)
_NODES, _WEIGHTS = (part.copy() for part in np.polynomial.legendre.leggauss(32))


@njit(**KERNEL)
def sprung_energy(m: np.ndarray, d: np.ndarray, w: float) -> float:
    """Energy in J that the rock law would give back from here, by Gauss' quadrature over the square root of depth."""
    regime = int(d[V.REGIME])
    if regime == FREE:
        return 0.0
    force = law_force(m, d, regime, w)
    deep, energy = law_depth(m, d, OUTWARD, force), 0.0
    back = d.copy()
    for i in range(_NODES.size):
        s = 0.5 * (1.0 + _NODES[i])
        energy += _WEIGHTS[i] * s * V.law_anew(m, back, OUTWARD, deep * s * s)
    return deep * energy


@njit(**KERNEL)
def take_setting(m: np.ndarray, row: np.ndarray) -> None:
    """Write what a row of ``plants.models`` says of setting and rock into the model."""
    m[V.F_A], m[V.F_B], m[V.OMEGA] = row[0, AMPLITUDE], row[0, STATIC], row[0, ROW_OMEGA]
    m[V.KL], m[V.KU] = row[LOADING, STIFFNESS], row[UNLOADING, STIFFNESS]
    m[V.LONGEST] = LONGEST_SHARE * V.TURN / m[V.OMEGA]


@njit(**KERNEL)
def put_row(d: np.ndarray, z: np.ndarray, state: np.ndarray) -> None:
    """Write the motion into the rig's row of ``plants.states``."""
    for i in range(4):
        state[i] = z[i]
    state[ORIGIN], state[STATE_CARRY] = d[V.ORIGIN], d[V.CARRY]
    state[TURNS], state[REGIME] = d[V.TURNS], d[V.REGIME]
    set_phase(d[V.THETA], state)


@njit(**KERNEL)
def meet_rock(plants: Plants, i: int, m, d, z, held: float) -> None:
    """Let the rig meet the rock that its memory says, where it has left it or under load: the force goes on."""
    row, state, rig = plants.models[i], plants.states[i], plants.rigs[i]
    layers, memory = plants.layers[i], plants.memories[i]
    regime, layer = int(d[V.REGIME]), memory[LAYER]
    put_row(d, z, state)
    if not leave_rock(row, state, rig, layers, memory):
        return
    force = law_force(m, d, regime, z[V.W])
    set_layer(row, rig, layers, memory)
    set_setting(row, rig, memory[FREQUENCY], memory[VOLTAGE], held)
    take_setting(m, row)
    if memory[LAYER] != layer:
        d[V.COUNT], d[V.COUNT_CONTACT], d[V.DRILLED], d[V.DRILLED_CONTACT] = 0.0, 0.0, 0.0, 0.0
    if regime != FREE:
        set_factor(m, d)
        place = law_depth(m, d, regime, force)
        shift_origin(d, z[V.W] - place)
        z[V.W] = place


@njit(**KERNEL)
def read_samples(
    m, d, scratch, memory, first, spacing, index, samples, now, taken, following, sums, window, column
) -> tuple[int, int]:
    """Read the samples and rows of the window that lie in the step just taken. Returns how many there are by now."""
    while index < samples and first + index * spacing < following:
        shift = min(max(first + index * spacing - now, 0.0), taken)
        speed, acceleration = read_speed(m, shift, scratch)
        theta = scratch[BEGIN_D, V.THETA] + m[V.OMEGA] * shift
        add_sample(acceleration, m[V.F_A] * sine_cosine(theta)[0] * speed, index, sums)
        index += 1
    columns = window.shape[0]
    while column < columns and (column + 1) * INTERVAL <= following * columns * (1.0 + 1e-12):
        shift = min(max((column + 1) * INTERVAL / columns - now, 0.0), taken)
        force = read_state(m, shift, NO, scratch)
        before, z, row = scratch[BEGIN_D], scratch[SPARE], window[column]
        origin = before[V.ORIGIN] + before[V.CARRY]
        row[0] = memory[VOLTAGE] * sine_cosine(before[V.THETA] + m[V.OMEGA] * shift)[0]
        row[1], row[2], row[3] = max(force, 0.0), scratch[SPARE_SLOPE, V.V2], memory[PRESSURE]
        row[5] = origin + z[V.W] + z[V.U]
        row[4] = row[5] + z[V.Y]
        row[6], row[7] = z[V.V2], depth_of_face(m, before, z[V.W])
        column += 1
    return index, column


@njit(**KERNEL)
def drill(plants: Plants, i: int, m, d, z, setting, sums, peaks, window, rtol: float, scratch) -> int:
    """As :func:`drillenv.env.plant.drill`, for the motion (d, z) of a model. Returns how it ended, as ``advance`` does.

    ``rtol`` is the relative error tolerated a step.
    """
    m, d, z, scratch, window = borrowed(m), borrowed(d), borrowed(z), borrowed(scratch), borrowed(window)
    row, rig, memory = plants.models[i], plants.rigs[i], plants.memories[i]
    sums[:] = 0.0
    frequency, amplitude, valve = setting[0], setting[1], setting[2]
    memory[FREQUENCY], memory[VOLTAGE], memory[VALVE] = frequency, amplitude, valve
    z[int(m[TALLY]) :] = 0.0
    face, sprung = depth_of_face(m, d, z[V.W]), sprung_energy(m, d, z[V.W])
    # as in plant.drill: an even number of whole periods, up to the end of the interval
    cycles = 2 * int(0.5 * INTERVAL * frequency)
    first, spacing, samples = INTERVAL - cycles / frequency, 1.0 / (frequency * SAMPLES), cycles * SAMPLES
    index, column = NONE, NONE
    now, step, steps = 0.0, 0, round(INTERVAL / SUBSTEP)
    while step < steps:
        pressure = memory[PRESSURE]
        if abs(pressure - valve) <= SETTLED:
            step, held, memory[PRESSURE] = steps, valve, valve
        else:
            step += 1
            held, memory[PRESSURE] = held_pressure(pressure, valve, memory[LAG], SUBSTEP)
        end = INTERVAL if step == steps else step * SUBSTEP
        set_setting(row, rig, frequency, amplitude, held)
        take_setting(m, row)
        prepare(m, d, z, NO, scratch)
        while now < end:
            before = int(d[V.REGIME])
            status, taken = advance(m, d, z, end - now, rtol, NO, scratch)
            if status != WENT_ON:
                return status
            following = end if taken >= end - now else now + taken
            if before != FREE:
                sums[S_CONTACT_TIME] += taken
            if taken > 0.0:
                index, column = read_samples(
                    m, d, scratch, memory, first, spacing, index, samples, now, taken, following, sums, window, column
                )
            now = following
            after = int(d[V.REGIME])
            if after == before:
                continue
            if after == UNLOADING:
                note_impact(d[V.PEAK], now * frequency, sums, peaks)
                memory[FACE_IMPACTS] += 1.0
            elif before == FREE:
                sums[S_CONTACTS] += 1.0
            elif after == FREE:
                meet_rock(plants, i, m, d, z, held)
                prepare(m, d, z, NO, scratch)
    put_row(d, z, plants.states[i])
    sums[S_PENETRATION] = depth_of_face(m, d, z[V.W]) - face
    sums[S_CYCLES] = INTERVAL * frequency
    sums[S_ROCK] = z[int(m[TALLY]) + IN_ROCK] - (sprung_energy(m, d, z[V.W]) - sprung)
    sums[S_DRIVE] *= INTERVAL / max(index, 1)
    for k in range(2 * HARMONICS):
        sums[S_WAVES + k] *= 2.0 / max(index, 1)
    if never_left(plants.states[i], sums):
        meet_rock(plants, i, m, d, z, memory[PRESSURE])
        put_row(d, z, plants.states[i])
    return WENT_ON


@dataclass(frozen=True, slots=True)
class HybridSnapshot:
    """What a rig on the hybrid engine keeps beside its row of Plants. Copies and pickles."""

    effects: Mapping[str, Mapping[str, Any]]
    motion: Motion


class HybridPlant:
    """A rig with effects beyond the paper's model.

    Args:
        plants, i: The rig's row, just put at rest by :func:`drillenv.env.plant.place`.
        effects: Names of effects, with the values of their parameters by symbol.

    Raises:
        InputError: an effect that the registry does not have, or that does not act on the motion.
    """

    def __init__(self, plants: Plants, i: int, effects: Mapping[str, Mapping[str, Any]]):
        self._prepare(plants, i, effects)
        state, motion = plants.states[i], fresh_motion(self.model)
        motion.z[:4] = state[:4]
        for place, kept in ((V.REGIME, REGIME), (V.THETA, THETA), (V.TURNS, TURNS), (V.ORIGIN, ORIGIN),
                            (V.CARRY, STATE_CARRY)):  # fmt: skip
            motion.d[place] = state[kept]
        self.motion = motion
        prepare_fresh(self.model.flat, motion.d, motion.z, self.scratch)

    def _prepare(self, plants: Plants, i: int, effects: Mapping[str, Mapping[str, Any]]) -> None:
        self.plants, self.i = plants, i
        self.effects = {name: dict(values) for name, values in effects.items()}
        chosen = tuple(make(name, **values) for name, values in self.effects.items())
        layer = plants.layers[i, int(plants.memories[i, LAYER])]
        rock = Rock(layer[LAYER_KL], layer[LAYER_KU])
        self.model = model_for(Rig(*plants.rigs[i].tolist()), START, rock, chosen)
        take_setting(self.model.flat, plants.models[i])
        self.scratch: np.ndarray = make_scratch(self.model)

    @classmethod
    def restored(cls, plants: Plants, i: int, snapshot: HybridSnapshot) -> HybridPlant:
        """The rig as it was when the snapshot was taken; its row of plants has been put back already."""
        self = cls.__new__(cls)
        self._prepare(plants, i, snapshot.effects)
        self.motion = snapshot.motion.copy()
        return self

    def snapshot(self) -> HybridSnapshot:
        """What to go on from exactly, together with the rig's row of plants."""
        return HybridSnapshot(self.effects, self.motion.copy())

    def __getstate__(self) -> dict[str, Any]:
        return {"plants": self.plants, "i": self.i, "kept": self.snapshot()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(HybridPlant.restored(state["plants"], state["i"], state["kept"]).__dict__)

    def drill(self, setting: np.ndarray, sums: np.ndarray, peaks: np.ndarray, window: np.ndarray) -> None:
        """Run the rig for one interval at a setting (3,) in Hz, V and bar.

        Fills ``sums``, ``peaks`` and ``window`` and moves the rig's row of plants on, as
        :func:`drillenv.env.plant.drill` does.

        Raises:
            InputError: effects under which the motion cannot be followed. The rig then has to be put at rest anew.
        """
        d, z = self.motion
        status = drill(self.plants, self.i, self.model.flat, d, z, setting, sums, peaks, window, RTOL, self.scratch)
        if status != WENT_ON:
            raise InputError(
                f"the motion {lost_by(status)} with the effects {shown(self.effects)} at {Setting(*setting.tolist())}: "
                "make them weaker"
            )


@njit(**KERNEL)
def prepare_fresh(m, d, z, scratch) -> None:
    """Let a motion begin."""
    set_factor(m, d)
    prepare(m, d, z, YES, scratch)


COMPILE_DRILL = f"from {__name__} import compile_drill; compile_drill()"
"""For :func:`drillenv.compiling.helped`, where a rig is put at rest that is to be drilled with."""


def compile_drill() -> None:
    """Compile what a control interval needs, what a rig that is put at rest needs too last."""
    plants, model = make_plants(1), model_for(Rig(), START, Rock(1e8, 2e8), ())
    d, z = fresh_motion(model)
    sums, peaks, window = np.empty(SUMS_SIZE), np.empty((PEAKS, 2)), np.empty((0, len(TRACE)))
    scratch = make_scratch(model)
    compile_for(advance, model.flat, d, z, 0.0, RTOL, NO, scratch)
    compile_for(drill, plants, 0, model.flat, d, z, np.empty(3), sums, peaks, window, RTOL, scratch)
