"""One control interval of the rig on a rock that changes as it is drilled, for many rigs at a time.

The plant is that of :mod:`drillenv.dynamics.exact` with what a real rig adds around it:

- The pressure in the cylinder follows the valve as ``dp/dt = (p_valve - p) / lag``. The exact engine wants a constant
  static force, so the pressure is held over :data:`SUBSTEP` seconds at a time, at its mean over them.
- The rock comes in layers. A new one is met by the first contact after the indenter has left the face beyond it.
- A fresh face stiffens: blow after blow the stiffnesses go through the ten indentations of Table 2.2 (one impact, four
  of compression, then stable), each lasting ``blows`` impacts.

Stiffnesses change where the indenter leaves the rock, so the force never jumps. An indenter that is pressed so hard
that it does not leave the rock for a whole interval meets the new stiffness at the interval's end: the force goes on
from where it is, and the place it is counted from moves. Voltage and frequency act at once; the phase of the
excitation, the motion, the face and the pressure go on over the border of two intervals.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.dynamics.exact import (
    ORIGIN,
    REGIME,
    STATE_SIZE,
    THETA,
    TURN,
    TURNS,
    V1,
    V2,
    Scratch,
    W,
    Y,
    begin,
    borrow_scratch,
    complete,
    fresh_state,
    probe_contact,
    probe_free,
    shift_origin,
)
from drillenv.dynamics.flow import (
    AMPLITUDE,
    FREE,
    LOADING,
    M2,
    MODEL_SHAPE,
    OMEGA,
    STIFFNESS,
    UNLOADING,
    C,
    K,
    contact_state,
    free_state,
    set_drive,
    set_plant,
    sine_cosine,
)
from drillenv.rig import DRIVE_BASE, DRIVE_SLOPE, PUSH
from drillenv.rocks import ROCKS

INTERVAL = 0.25
"""Length of a control interval in s: 12 to 30 excitation periods, as long as the fastest cylinder takes to fill."""
SUBSTEP = INTERVAL / 20
"""How long the pressure is held at its mean in s; the lags drawn are 0.3 s and more."""
SETTLED = 1e-6
"""A pressure this close to the valve's in bar has arrived."""
SAMPLES = 32
"""Samples of the motion a period, for the harmonics of the acceleration and the work of the drive."""
WAVES = np.cos(math.pi * np.arange(2 * SAMPLES) / SAMPLES)
"""A cosine over two periods: half the excitation frequency, at whose samples all multiples can be read."""
PEAKS = 1024
"""Impacts of an interval that are kept in order; the few more that chatter could give are only counted."""

# What a rig is made of: a row of Plants.rig.
RIG_M1, RIG_M2, RIG_K, RIG_C, RIG_DRIVE, RIG_PRESSURE = range(6)
RIG_SIZE = 6
# A layer: stable stiffnesses in N/m, depth of its lower end in m, and which face of FACES it shows when fresh.
LAYER_KL, LAYER_KU, LAYER_END, LAYER_FACE = range(4)
LAYER_SIZE = 4
MOST_LAYERS = 64
# What a rig remembers from interval to interval, apart from its model and state.
(
    PRESSURE,
    LAG,
    BLOWS,
    LAYER,
    FACE_IMPACTS,
    LAST_TURNS,
    LAST_PEAK,
    FREQUENCY,
    VOLTAGE,
    VALVE,
    DEPTH,
) = range(11)
MEMORY_SIZE = 11
"""Pressure in bar and its lag in s; impacts an indentation of Table 2.2 lasts; the layer and the impacts on its face;
turns of the excitation at the last impact that the load cell saw, and its peak in N; the setting; Xf in m."""

# What happened in an interval: running sums, from either engine, that `summarise` reads.
(
    S_PENETRATION,
    S_IMPACTS,
    S_CONTACTS,
    S_CONTACT_TIME,
    S_DRIVE,
    S_ROCK,
    S_CYCLES,
    S_KEPT,
) = range(8)
S_WAVES = 8
HARMONICS = 4
"""At half, once, twice and three times the excitation frequency."""
SUMS_SIZE = S_WAVES + 2 * HARMONICS
"""Penetration in m; impacts and contacts; time in contact in s; work of the drive and energy kept by the rock in J;
excitation periods; peaks kept; then cosine and sine part of each harmonic of the acceleration in m/s^2."""

# A trace: rows of `window`.
TRACE = ("excitation", "force", "acceleration", "pressure", "x1", "x2", "v2", "face")
"""In V, N, m/s^2, bar, m, m, m/s, m: places are counted from the first rock's face, ``face`` is Xf."""


def _faces() -> np.ndarray:
    """(7, 10, 2): each indentation's k_l and k_u over the stable ones, for cases 1 to 6; row 0 does not stiffen."""
    faces = np.ones((1 + len(ROCKS), 10, 2))
    for case, pair in ROCKS.items():
        assert pair.indentations is not None
        for column, measured in enumerate((pair.indentations.loading, pair.indentations.unloading)):
            faces[case, :, column] = np.array(measured) / np.mean(measured[5:])
        faces[case, 5:] = 1.0  # the stable ones scatter by the error of the measurement
    return faces


FACES = _faces()


class Plants(NamedTuple):
    """The rigs of a batch, as arrays; see the names above for what stands where."""

    models: np.ndarray
    """(n, *MODEL_SHAPE), see :mod:`drillenv.dynamics.flow`."""
    states: np.ndarray
    """(n, STATE_SIZE), see :mod:`drillenv.dynamics.exact`."""
    rigs: np.ndarray
    """(n, RIG_SIZE)."""
    layers: np.ndarray
    """(n, MOST_LAYERS, LAYER_SIZE)."""
    memories: np.ndarray
    """(n, MEMORY_SIZE)."""


def make_plants(n: int) -> Plants:
    """Room for n rigs; each is to be filled by :func:`place`."""
    return Plants(
        np.zeros((n, *MODEL_SHAPE)),
        np.zeros((n, STATE_SIZE)),
        np.zeros((n, RIG_SIZE)),
        np.zeros((n, MOST_LAYERS, LAYER_SIZE)),
        np.zeros((n, MEMORY_SIZE)),
    )


@njit(**INLINE)
def set_layer(model: np.ndarray, rig: np.ndarray, layers: np.ndarray, memory: np.ndarray) -> None:
    """Write the rock that the next contact meets into the model; the setting has to be written after it."""
    layer = int(memory[LAYER])
    face = int(layers[layer, LAYER_FACE])
    indentation = min(int(memory[FACE_IMPACTS] / memory[BLOWS]), FACES.shape[1] - 1)
    kl = layers[layer, LAYER_KL] * FACES[face, indentation, 0]
    ku = max(layers[layer, LAYER_KU] * FACES[face, indentation, 1], kl)
    set_plant(rig[RIG_M1], rig[RIG_M2], rig[RIG_K], rig[RIG_C], kl, ku, model)


@njit(**INLINE)
def set_setting(model: np.ndarray, rig: np.ndarray, frequency: float, amplitude: float, pressure: float) -> None:
    """Write a setting (Hz, V, bar) into the model, by Eq. 3.5 and 3.6."""
    drive = rig[RIG_DRIVE] * (DRIVE_SLOPE * frequency + DRIVE_BASE) * amplitude
    set_drive(TURN * frequency, drive, rig[RIG_PRESSURE] * PUSH * pressure, model)


@njit(**KERNEL)
def place(plants: Plants, i: int, phase: float) -> None:
    """Put rig i at rest on fresh rock, from its rows of rigs, layers and memories; ``phase`` in rad."""
    memory = plants.memories[i]
    set_layer(plants.models[i], plants.rigs[i], plants.layers[i], memory)
    set_setting(plants.models[i], plants.rigs[i], memory[FREQUENCY], memory[VOLTAGE], memory[PRESSURE])
    fresh_state(plants.models[i], phase, plants.states[i])


@njit(**INLINE)
def depth_of_face(model: np.ndarray, state: np.ndarray) -> float:
    """Xf in m: where the indenter would leave the rock if it turned back now."""
    if state[REGIME] != LOADING:
        return state[ORIGIN]
    return state[ORIGIN] + state[W] * (1.0 - model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS])


@njit(**INLINE)
def note_impact(force: float, turns: float, sums: np.ndarray, peaks: np.ndarray) -> None:
    """Count an impact of a peak ``force`` in N, ``turns`` excitation periods into the interval, and keep it."""
    sums[S_IMPACTS] += 1.0
    kept = int(sums[S_KEPT])
    if kept < PEAKS:
        peaks[kept, 0], peaks[kept, 1] = turns, force
        sums[S_KEPT] += 1.0


@njit(**INLINE)
def leave_rock(model: np.ndarray, state: np.ndarray, rig: np.ndarray, layers: np.ndarray, memory: np.ndarray) -> bool:
    """The indenter has just left the rock: whether the next contact meets another stiffness, which is then set."""
    layer = int(memory[LAYER])
    last = layer == layers.shape[0] - 1
    if not last and state[ORIGIN] >= layers[layer, LAYER_END]:
        while not last and state[ORIGIN] >= layers[layer, LAYER_END]:
            layer += 1
            last = layer == layers.shape[0] - 1
        memory[LAYER], memory[FACE_IMPACTS] = layer, 0.0
        return True
    # stable after the fifth indentation; a little longer costs nothing and keeps the rule in one place
    return memory[FACE_IMPACTS] <= FACES.shape[1] * memory[BLOWS] and layers[layer, LAYER_FACE] > 0.0


@njit(**INLINE)
def never_left(state: np.ndarray, sums: np.ndarray) -> bool:
    """Whether the indenter has been on the rock for a whole interval, at its end."""
    return state[REGIME] != FREE and sums[S_CONTACT_TIME] >= INTERVAL * (1.0 - 1e-9)


@njit(**INLINE)
def change_under_load(
    model: np.ndarray, state: np.ndarray, rig: np.ndarray, layers: np.ndarray, memory: np.ndarray, held: float
) -> None:
    """What ``leave_rock`` does for an indenter that does not leave it; ``held`` is the pressure in bar."""
    regime = int(state[REGIME])
    before = model[regime, STIFFNESS]
    if leave_rock(model, state, rig, layers, memory):
        set_layer(model, rig, layers, memory)
        set_setting(model, rig, memory[FREQUENCY], memory[VOLTAGE], held)
        scaled = state[W] * before / model[regime, STIFFNESS]
        shift_origin(state, state[W] - scaled)
        state[W] = scaled


@njit(**INLINE)
def sample(
    model: np.ndarray,
    state: np.ndarray,
    regime: int,
    scratch: Scratch,
    theta: float,
    t: float,
    index: int,
    sums: np.ndarray,
) -> None:
    """Add one sample of the motion, ``t`` into the regime that began at phase ``theta``, to the sums."""
    if regime == FREE:
        _w, v, a = probe_free(model, scratch.channel, theta, t)
    else:
        _w, v, a, _j = probe_contact(model, regime, scratch.channel, scratch.work, theta, t)
    sine, _cosine = sine_cosine(theta + model[0, OMEGA] * t)
    add_sample(a, model[0, AMPLITUDE] * sine * v, index, sums)


@njit(**INLINE)
def add_sample(a: float, power: float, index: int, sums: np.ndarray) -> None:
    """Add an acceleration in m/s^2 and the power of the drive in W, sample ``index``, to the sums."""
    sums[S_DRIVE] += power
    turn = 2 * SAMPLES
    place = index % turn
    for harmonic in range(HARMONICS):
        step = place if harmonic == 0 else (2 * harmonic * place) % turn
        sums[S_WAVES + 2 * harmonic] += a * WAVES[step]
        # the sine is the cosine a quarter of its turn earlier
        sums[S_WAVES + 2 * harmonic + 1] += a * WAVES[(step + turn - turn // 4) % turn]


@njit(**INLINE)
def trace(
    model: np.ndarray,
    state: np.ndarray,
    memory: np.ndarray,
    regime: int,
    scratch: Scratch,
    theta: float,
    t: float,
    origin: float,
    column: np.ndarray,
    place: np.ndarray,
) -> None:
    """Write one row of a window, ``t`` into the regime begun at phase ``theta``; ``place`` is room for a state."""
    sine, cosine = sine_cosine(theta + model[0, OMEGA] * t)
    if regime == FREE:
        free_state(model, scratch.work, sine, cosine, t, place)
        kappa = 0.0
    else:
        contact_state(model, regime, scratch.work, sine, cosine, t, place)
        kappa = model[regime, STIFFNESS]
    force = kappa * place[W]
    push = model[0, AMPLITUDE] * sine + model[0, K] * place[Y] + model[0, C] * (place[V1] - place[V2])
    column[0] = memory[VOLTAGE] * sine
    column[1] = force
    column[2] = (push - force) / model[0, M2]
    column[3] = memory[PRESSURE]
    column[5] = origin + place[W]
    column[4] = column[5] + place[Y]
    column[6] = place[V2]
    column[7] = origin
    if regime == LOADING:
        column[7] += place[W] * (1.0 - model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS])


@njit(**INLINE)
def held_pressure(start: float, valve: float, lag: float, duration: float) -> tuple[float, float]:
    """The mean of the pressure over ``duration`` seconds from ``start``, and the pressure at their end."""
    fall = math.exp(-duration / lag)
    return valve + (start - valve) * (1.0 - fall) * lag / duration, valve + (start - valve) * fall


@njit(**KERNEL)
def drill(
    plants: Plants,
    i: int,
    setting: np.ndarray,
    sums: np.ndarray,
    peaks: np.ndarray,
    window: np.ndarray,
    scratch: Scratch,
) -> None:
    """Run rig i for one interval at a setting (3,) in Hz, V and bar.

    Fills ``sums`` (SUMS_SIZE,) and ``peaks`` (PEAKS, 2: turns since the start of the interval, peak force in N), and
    the rows of ``window`` (samples, len(TRACE)), evenly spread over the interval.
    """
    model, state = borrowed(plants.models)[i], borrowed(plants.states)[i]
    rig, layers, memory = borrowed(plants.rigs)[i], borrowed(plants.layers)[i], borrowed(plants.memories)[i]
    setting, sums, peaks, window = borrowed(setting), borrowed(sums), borrowed(peaks), borrowed(window)
    scratch = borrow_scratch(scratch)
    room = np.empty(STATE_SIZE)
    sums[:] = 0.0
    frequency, amplitude, valve = setting[0], setting[1], setting[2]
    memory[FREQUENCY], memory[VOLTAGE], memory[VALVE] = frequency, amplitude, valve
    depth_before = depth_of_face(model, state)
    turns_before = state[TURNS] + state[THETA] / TURN

    # an even number of whole periods, up to the end of the interval, so that no harmonic leaks into another
    cycles = 2 * int(0.5 * INTERVAL * frequency)
    spacing = 1.0 / (frequency * SAMPLES)
    first = INTERVAL - cycles / frequency
    index, samples = 0, cycles * SAMPLES
    column, columns = 0, window.shape[0]
    now = 0.0
    step, steps = 0, round(INTERVAL / SUBSTEP)
    while step < steps:
        pressure = memory[PRESSURE]
        if abs(pressure - valve) <= SETTLED:
            step, held, memory[PRESSURE] = steps, valve, valve
        else:
            step += 1
            held, memory[PRESSURE] = held_pressure(pressure, valve, memory[LAG], SUBSTEP)
        end = INTERVAL if step == steps else step * SUBSTEP
        set_setting(model, rig, frequency, amplitude, held)
        while now < end:
            before = int(state[REGIME])
            regime = begin(model, state, scratch)
            if regime != before:
                if regime == UNLOADING:
                    turns = state[TURNS] + state[THETA] / TURN - turns_before
                    note_impact(model[UNLOADING, STIFFNESS] * state[W], turns, sums, peaks)
                    memory[FACE_IMPACTS] += 1.0
                elif before == FREE:
                    sums[S_CONTACTS] += 1.0
                elif regime == FREE and leave_rock(model, state, rig, layers, memory):
                    set_layer(model, rig, layers, memory)
                    set_setting(model, rig, frequency, amplitude, held)
            theta, origin = state[THETA], state[ORIGIN]
            force = state[W] * model[regime, STIFFNESS] if regime != FREE else 0.0
            taken = complete(model, state, regime, end - now, scratch)
            following = end if taken >= end - now else now + taken
            if regime != FREE:
                sums[S_CONTACT_TIME] += taken
            if regime == LOADING:
                kl, ku = model[LOADING, STIFFNESS], model[UNLOADING, STIFFNESS]
                after = kl * state[W]
                sums[S_ROCK] += 0.5 * (1.0 / kl - 1.0 / ku) * (after - force) * (after + force)
            while index < samples and first + index * spacing < following:
                t = min(max(first + index * spacing - now, 0.0), taken)
                sample(model, state, regime, scratch, theta, t, index, sums)
                index += 1
            while column < columns and (column + 1) * INTERVAL <= following * columns * (1.0 + 1e-12):
                t = min(max((column + 1) * INTERVAL / columns - now, 0.0), taken)
                trace(model, state, memory, regime, scratch, theta, t, origin, window[column], room)
                column += 1
            now = following
    sums[S_PENETRATION] = depth_of_face(model, state) - depth_before
    if never_left(state, sums):
        change_under_load(model, state, rig, layers, memory, memory[PRESSURE])
    sums[S_CYCLES] = INTERVAL * frequency
    sums[S_DRIVE] *= INTERVAL / max(index, 1)
    for k in range(2 * HARMONICS):
        sums[S_WAVES + k] *= 2.0 / max(index, 1)
