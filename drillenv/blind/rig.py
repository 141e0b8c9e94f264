"""The concealed rig: the two masses of the paper with whatever physics the catalogue adds, integrated in time.

The formulation is not that of the package's own engines. States are the indenter's place and speed and the coupling's
shortening and its rate, in one frame for the whole run; the classical Runge-Kutta method of fourth order takes steps of
about 5 us, and a step in which the contact or dry friction switches is cut at the switch by bisection. The contact
keeps two places, where loading and where unloading would begin, and moves one of them at each turn so that the force is
continuous (Section 3 of the paper).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drillenv.blind import laws
from drillenv.blind.laws import (
    ADHESION,
    AIR,
    BACKLASH,
    CHIPS,
    COMPACTION,
    DAMPER,
    DROOP,
    FLOOR,
    GRIP,
    GUIDE,
    HARMONICS,
    INDENTER,
    LIMIT,
    MOUNT,
    RATE,
    RATTLE,
    ROTATION,
    SPRING,
    WOBBLE,
)

Floats = NDArray[np.float64]

DENSE_RATE = 200e3
"""Hz: at least so many steps of integration a second."""

# Table 2.1, Eq. 3.5 and Eq. 3.6 of the paper, typed in again.
DRIVE_PER_HERTZ, DRIVE_AT_ZERO, PUSH_PER_BAR = 2.40, 876.19, 196.35

LONGEST = 9e-3
"""m: no coupling of the catalogue rests shorter than this, and all get stiffer or softer one way up to there."""

FREE, LOADING, UNLOADING = range(3)

# Places in the state vector: indenter, coupling, rock's face, second mass of its mount, air, bristles, slewed drive.
X2, V2, S, SV, U, W, U2, W2, AIR_X, AIR_Y, BENT1, BENT2, DRIVE = range(13)
STATES = 13
# Columns of what a run gives at each step.
COLUMNS = (
    "time",
    "theta",
    "x2",
    "v2",
    "shortening",
    "closing",
    "face",
    "depth",
    "into",
    "regime",
    "rock",
    "acceleration",
    "drive",
    "impacts",
    "contact_added",
    "coupling_added",
    "indenter_added",
    "shaker_added",
)
"""The last four: force in N of the physics that the paper's model does not have, where it acts."""


class Constants(NamedTuple):
    """The rig's constants in SI: Table 2.1, and the rock's two stiffnesses."""

    shaker_mass: float = 265.0
    indenter_mass: float = 3.0
    stiffness: float = 68.85e3
    damping: float = 2.45e3
    drive_gain: float = 1.0
    pressure_gain: float = 1.0
    loading_stiffness: float = 21.40e6
    unloading_stiffness: float = 25.05e6


class Controls(NamedTuple):
    """What the operator sets: Hz, V, bar."""

    frequency: float
    amplitude: float
    pressure: float


class Physics(NamedTuple):
    """What is concealed: for each place of :mod:`drillenv.blind.laws` an equation and its parameters."""

    codes: NDArray[np.int64]
    """(PLACES,)"""
    parameters: Floats
    """(PLACES, PARAMETERS)"""
    chances: Floats
    """Uniform random numbers, one a contact, for chips that break out."""
    rattles: Floats
    """s, when a loose bolt rattles."""

    @classmethod
    def none(cls) -> Physics:
        """Nothing but the paper's model."""
        return cls(
            np.zeros(laws.PLACES, dtype=np.int64),
            np.zeros((laws.PLACES, laws.PARAMETERS)),
            np.ones(1),
            np.full(1, np.inf),
        )


class Motion(NamedTuple):
    """A run, sampled at each step of integration. See ``COLUMNS``; arrays have shape (steps,), SI throughout."""

    time: Floats
    theta: Floats
    x2: Floats
    v2: Floats
    shortening: Floats
    closing: Floats
    face: Floats
    depth: Floats
    into: Floats
    regime: Floats
    rock: Floats
    acceleration: Floats
    drive: Floats
    impacts: Floats
    contact_added: Floats
    coupling_added: Floats
    indenter_added: Floats
    shaker_added: Floats


class _Given(NamedTuple):
    """What the compiled integrator is handed, beside the physics."""

    m1: float
    m2: float
    k: float
    c: float
    kl: float
    ku: float
    drive: float
    static: float
    omega: float
    phase: float
    gain: float
    lag: float


def move(
    constants: Constants,
    controls: Controls,
    physics: Physics,
    seconds: float,
    step: float,
    phase: float = 0.0,
    lead: float = 0.0,
) -> Motion:
    """Run the rig from rest against fresh rock, and keep what happens after ``lead`` seconds.

    Args:
        constants, controls, physics: The rig.
        seconds: Duration of what is kept, in s; its first sample is at time 0.
        step: Of the integration and of the samples, in s, 5 us or less.
        phase: Of the excitation at time 0, in rad.
        lead: s for which the rig runs before time 0; rounded to whole steps.

    Raises:
        ArithmeticError: the motion left all bounds.
    """
    omega = 2.0 * math.pi * controls.frequency
    gain, lag = laws.droop_gain(physics.codes[DROOP], physics.parameters[DROOP], controls.frequency)
    before = round(lead / step)
    given = _Given(
        constants.shaker_mass,
        constants.indenter_mass,
        constants.stiffness,
        constants.damping,
        constants.loading_stiffness,
        constants.unloading_stiffness,
        constants.drive_gain * (DRIVE_PER_HERTZ * controls.frequency + DRIVE_AT_ZERO) * controls.amplitude,
        constants.pressure_gain * PUSH_PER_BAR * controls.pressure,
        omega,
        phase - omega * before * step,
        gain,
        lag,
    )
    state = np.zeros(STATES)
    state[S] = resting_shortening(constants, given.static, physics)
    kept = math.floor(seconds / step * (1.0 + 1e-12)) + 1
    table = np.empty((kept, len(COLUMNS)))
    good = _integrate(given, physics, state, step, before, table)
    if not good:
        raise ArithmeticError(f"the concealed rig left all bounds at {controls}")
    table[:, 0] = np.arange(kept) * step
    return Motion(*np.ascontiguousarray(table.T))


def resting_shortening(constants: Constants, static: float, physics: Physics) -> float:
    """Shortening in m at which the coupling carries the static force, by bisection below ``LONGEST``."""
    low, high = 0.0, LONGEST
    for _ in range(100):
        middle = 0.5 * (low + high)
        if _spring(physics.codes, physics.parameters, constants.stiffness, middle) < static:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(**laws.KERNEL)
def _spring(codes, p, k, s):
    """Force in N of the whole spring at the shortening ``s``."""
    force = k * s + laws.spring_force(codes[SPRING], p[SPRING], s)
    force += laws.backlash_force(codes[BACKLASH], p[BACKLASH], s, k)
    if codes[LIMIT] == 5:
        force += laws.spring_saturation(codes[LIMIT], p[LIMIT], s)
    return force


@njit(**laws.KERNEL)
def _drive(given, physics, t, slewed):
    """Phase of the excitation, the drive's force in N, and what is asked of a drive whose slope is limited."""
    codes, p = physics.codes, physics.parameters
    theta = given.omega * t + given.phase
    if codes[WOBBLE] != 0:
        wobble = p[WOBBLE]
        theta += wobble[0] * math.sin(2.0 * math.pi * wobble[1] * t + wobble[2])
    asked = given.gain * math.sin(theta + given.lag)
    asked += laws.harmonic_share(codes[HARMONICS], p[HARMONICS], theta)
    asked *= given.drive
    if codes[LIMIT] == 4:
        return theta, slewed, asked
    return theta, laws.limited(codes[LIMIT], p[LIMIT], asked), asked


@njit(**laws.KERNEL)
def _outside_forces(given, physics, t):
    """Forces in N of floor, machines and loose parts on shaker body and indenter."""
    codes, p = physics.codes, physics.parameters
    on_shaker, on_indenter = 0.0, 0.0
    if codes[FLOOR] != 0:
        wave = p[FLOOR, 0] * math.sin(2.0 * math.pi * p[FLOOR, 1] * t + p[FLOOR, 2])
        if codes[FLOOR] == 1:  # the floor moves: an acceleration of the frame
            on_shaker, on_indenter = given.m1 * wave, given.m2 * wave
        elif codes[FLOOR] == 2:  # a machine shakes the frame of the cylinder
            on_shaker = wave
        else:
            on_indenter = wave
    if codes[RATTLE] != 0:
        for begin in physics.rattles:
            since = t - begin
            if 0.0 <= since < 12.0 * p[RATTLE, 1]:
                ring = math.exp(-since / p[RATTLE, 1]) * math.sin(2.0 * math.pi * p[RATTLE, 2] * since)
                on_indenter += p[RATTLE, 0] * ring
    return on_shaker, on_indenter


@njit(**laws.KERNEL)
def _rock(given, physics, state, regime, origins, factor):
    """Depth, speed into the face, the rock's force, and the force that the paper's straight law would have."""
    codes, p = physics.codes, physics.parameters
    into = state[V2] - state[W]
    if regime == FREE:
        return state[X2] - state[U] - origins[0], into, 0.0, 0.0
    loading = regime == LOADING
    depth = state[X2] - state[U] - origins[0 if loading else 1]
    k = given.kl if loading else given.ku
    elastic = factor * k * laws.elastic_depth(codes, p, depth, loading, given.kl / given.ku)
    force = elastic + laws.rate_force(codes[RATE], p[RATE], elastic, depth, into)
    if codes[ADHESION] == 0:
        force = max(force, 0.0)
    return depth, into, force, max(k * depth, 0.0)


@njit(**laws.KERNEL)
def _friction(code, p, v, slide, bent):
    """Friction in N against the motion, and how fast its bristles bend."""
    if code == 0:
        return 0.0, 0.0
    if code == GRIP:
        return p[0] * slide, 0.0
    if code <= 3:
        return laws.sliding_force(code, p, v), 0.0
    return laws.bristle_force(code, p, v, bent)


@njit(**laws.KERNEL)
def _mount(physics, state, rock, rates):
    """Motion of the rock's face on its mount."""
    code, p = physics.codes[MOUNT], physics.parameters[MOUNT]
    u, w = state[U], state[W]
    spring = u / p[0]
    damping = 2.0 * p[2] * math.sqrt(p[1] / p[0]) * w
    rates[U] = w
    if code == 1:
        rates[W] = (rock - spring - damping) / p[1]
    elif code == 2:  # the mount stands on a mass p[3] of its own, with the compliance p[4]
        spring = (u - state[U2]) / p[0]
        damping = 2.0 * p[2] * math.sqrt(p[1] / p[0]) * (w - state[W2])
        rates[W] = (rock - spring - damping) / p[1]
        rates[U2] = state[W2]
        below = state[U2] / p[4] + 2.0 * p[2] * math.sqrt(p[3] / p[4]) * state[W2]
        rates[W2] = (spring + damping - below) / p[3]
    elif code == 3:  # stiffer as it is pressed, by as much again at p[3] m
        rates[W] = (rock - spring * (1.0 + (u / p[3]) ** 2) - damping) / p[1]
    else:  # dry friction p[3] N in the clamp, rounded over 1 mm/s
        rates[W] = (rock - spring - p[3] * math.tanh(w / 1e-3)) / p[1]


@njit(**laws.KERNEL)
def _rates(given, physics, t, state, regime, origins, factor, slides, rates, row):
    """Time derivatives of the state, and into ``row`` what a sample shows; returns the forces on masses that stick."""
    codes, p = physics.codes, physics.parameters
    v2, s, sv = state[V2], state[S], state[SV]
    v1 = v2 + sv
    theta, drive, asked = _drive(given, physics, t, state[DRIVE])
    depth, into, rock, straight = _rock(given, physics, state, regime, origins, factor)
    plain = given.k * s + given.c * sv
    coupling = _spring(codes, p, given.k, s) + given.c * sv + laws.damper_force(codes[DAMPER], p[DAMPER], sv)
    on_shaker, on_indenter = _outside_forces(given, physics, t)
    for i in range(STATES):
        rates[i] = 0.0
    lack = 0.0
    if codes[AIR] != 0:
        lack, rates[AIR_X], rates[AIR_Y] = laws.air_force(
            codes[AIR], p[AIR], state[AIR_X], state[AIR_Y], given.static, v1
        )
    held1, rates[BENT1] = _friction(codes[GUIDE], p[GUIDE], v1, slides[0], state[BENT1])
    held2, rates[BENT2] = _friction(codes[INDENTER], p[INDENTER], v2, slides[1], state[BENT2])
    push1 = given.static - lack + on_shaker - coupling
    push2 = drive + on_indenter + coupling - rock
    stuck1 = codes[GUIDE] == GRIP and slides[0] == 0.0
    stuck2 = codes[INDENTER] == GRIP and slides[1] == 0.0
    if stuck1:
        held1 = push1
    if stuck2:
        held2 = push2
    a1, a2 = (push1 - held1) / given.m1, (push2 - held2) / given.m2
    rates[X2], rates[V2], rates[S], rates[SV] = v2, a2, sv, a1 - a2
    if codes[MOUNT] != 0:
        _mount(physics, state, rock, rates)
    if codes[LIMIT] == 4:
        steepest = p[LIMIT, 0]
        rates[DRIVE] = min(max((asked - state[DRIVE]) / 2e-5, -steepest), steepest)
    row[1], row[2], row[3], row[4], row[5], row[6] = theta, state[X2], v2, s, sv, state[U]
    row[7], row[8], row[9], row[10], row[11], row[12] = depth, into, regime, rock, a2, drive
    # a law of the paper would be read over the indenter's place, not over its place on a face that gives
    straight_on_fixed_face = straight + (given.kl * state[U] if straight > 0.0 else 0.0)
    row[14] = rock - straight_on_fixed_face
    row[15] = coupling - plain
    row[16] = drive - given.drive * math.sin(theta) + on_indenter - held2
    row[17] = on_shaker - lack - held1
    return push1, push2


@njit(**laws.KERNEL)
def _step(given, physics, t, h, state, regime, origins, factor, slides, work, row, ahead):
    """One step of the classical Runge-Kutta method, from ``state`` into ``ahead``."""
    _rates(given, physics, t, state, regime, origins, factor, slides, work[0], row)
    for i in range(STATES):
        ahead[i] = state[i] + 0.5 * h * work[0, i]
    _rates(given, physics, t + 0.5 * h, ahead, regime, origins, factor, slides, work[1], row)
    for i in range(STATES):
        ahead[i] = state[i] + 0.5 * h * work[1, i]
    _rates(given, physics, t + 0.5 * h, ahead, regime, origins, factor, slides, work[2], row)
    for i in range(STATES):
        ahead[i] = state[i] + h * work[2, i]
    _rates(given, physics, t + h, ahead, regime, origins, factor, slides, work[3], row)
    for i in range(STATES):
        ahead[i] = state[i] + h / 6.0 * (work[0, i] + 2.0 * work[1, i] + 2.0 * work[2, i] + work[3, i])


@njit(**laws.KERNEL)
def _crossed(given, physics, state, regime, origins, factor, slides):
    """Whether the state has gone past a switch of the contact or of gripping friction."""
    codes, p = physics.codes, physics.parameters
    into = state[V2] - state[W]
    place = state[X2] - state[U]
    if regime == FREE:
        if place > origins[0]:
            return True
    elif regime == LOADING:
        if into < 0.0:
            return True
    else:
        if into > 0.0:
            return True
        least = -p[ADHESION, 0] / (given.ku * factor) if codes[ADHESION] != 0 else 0.0
        if place - origins[1] < least:
            return True
    if codes[GUIDE] == GRIP and (state[V2] + state[SV]) * slides[0] < 0.0:
        return True
    return bool(codes[INDENTER] == GRIP and state[V2] * slides[1] < 0.0)


@njit(**laws.KERNEL)
def _turned(given, physics, state, regime, origins):
    """Move the place where the other way begins so that the force is the same on it."""
    softer = given.kl / given.ku
    loading = regime == LOADING
    place = state[X2] - state[U]
    bent = laws.elastic_depth(physics.codes, physics.parameters, place - origins[0 if loading else 1], loading, softer)
    wanted = bent * softer if loading else bent / softer
    other = laws.depth_of(physics.codes, physics.parameters, wanted, not loading, softer)
    origins[1 if loading else 0] = place - other


@njit(**laws.KERNEL)
def _switch(given, physics, t, state, contact, origins, slides, work, row):
    """Carry out what :func:`_crossed` found. ``contact``: regime, stiffness factor, impacts, contacts, chipped."""
    codes, p = physics.codes, physics.parameters
    into, place, regime = state[V2] - state[W], state[X2] - state[U], int(contact[0])
    if regime == FREE and place > origins[0]:
        contact[0], contact[4] = LOADING, 0.0
        contact[3] += 1.0
        factor = laws.compaction_factor(codes[COMPACTION], p[COMPACTION], contact[2], origins[0])
        if codes[ROTATION] != 0:
            angle = p[ROTATION, 1] * t + p[ROTATION, 2]
            factor *= 1.0 + p[ROTATION, 0] * math.cos(angle) + p[ROTATION, 3] * math.cos(2.0 * angle + p[ROTATION, 4])
        contact[1] = factor
    elif regime == LOADING and into < 0.0:
        _turned(given, physics, state, regime, origins)
        contact[0] = UNLOADING
        contact[2] += 1.0
    elif regime == UNLOADING:
        least = -p[ADHESION, 0] / (given.ku * contact[1]) if codes[ADHESION] != 0 else 0.0
        if place - origins[1] < least:
            contact[0] = FREE
            origins[0] = origins[1]
        elif into > 0.0:
            _turned(given, physics, state, regime, origins)
            contact[0] = LOADING
    v1 = state[V2] + state[SV]
    if codes[GUIDE] == GRIP and v1 * slides[0] < 0.0:
        state[SV] = -state[V2]
        slides[0] = 0.0
    if codes[INDENTER] == GRIP and state[V2] * slides[1] < 0.0:
        state[SV] += state[V2]
        state[V2] = 0.0
        slides[1] = 0.0
    _let_go(given, physics, t, state, contact, origins, slides, work, row)


@njit(**laws.KERNEL)
def _let_go(given, physics, t, state, contact, origins, slides, work, row):
    """Masses held by dry friction slide once they are pushed harder than it holds."""
    codes, p = physics.codes, physics.parameters
    if codes[GUIDE] != GRIP and codes[INDENTER] != GRIP:
        return
    pushes = _rates(given, physics, t, state, int(contact[0]), origins, contact[1], slides, work[0], row)
    for i, place in enumerate((GUIDE, INDENTER)):
        if codes[place] == GRIP and slides[i] == 0.0 and abs(pushes[i]) > p[place, 0]:
            slides[i] = 1.0 if pushes[i] > 0.0 else -1.0


@njit(**laws.KERNEL)
def _chip(physics, state, contact, origins, row):
    """Once a contact, beyond a force of p[1] N, a chip of p[2] m may break out of the rock."""
    p = physics.parameters[CHIPS]
    if contact[0] != LOADING or contact[4] != 0.0 or row[10] < p[1]:
        return
    contact[4] = 1.0
    if physics.chances[int(contact[3]) % physics.chances.size] < p[0]:
        depth = state[X2] - state[U] - origins[0]
        origins[0] += min(p[2], 0.8 * depth)


@njit(cache=True)
def _integrate(given, physics, state, h, before, table):
    """Fill the table, one row a step, after ``before`` steps that are not kept. Returns False where it diverged."""
    work, row, ahead = np.zeros((4, STATES)), np.zeros(table.shape[1]), np.zeros(STATES)
    origins, slides = np.zeros(2), np.zeros(2)
    contact = np.array([float(FREE), 1.0, 0.0, 0.0, 0.0])
    contact[1] = laws.compaction_factor(physics.codes[COMPACTION], physics.parameters[COMPACTION], 0.0, 0.0)
    _let_go(given, physics, -before * h, state, contact, origins, slides, work, row)
    for n in range(before + table.shape[0]):
        t = (n - before) * h
        if n >= before:
            _rates(given, physics, t, state, int(contact[0]), origins, contact[1], slides, work[0], row)
            row[13] = contact[2]
            table[n - before] = row
        done = 0.0
        for _ in range(50):
            regime, factor = int(contact[0]), contact[1]
            left = h - done
            _step(given, physics, t + done, left, state, regime, origins, factor, slides, work, row, ahead)
            if not _crossed(given, physics, ahead, regime, origins, factor, slides):
                break
            low, high = 0.0, left
            for _halving in range(50):
                middle = 0.5 * (low + high)
                _step(given, physics, t + done, middle, state, regime, origins, factor, slides, work, row, ahead)
                if _crossed(given, physics, ahead, regime, origins, factor, slides):
                    high = middle
                else:
                    low = middle
            _step(given, physics, t + done, high, state, regime, origins, factor, slides, work, row, ahead)
            for i in range(STATES):
                state[i] = ahead[i]
            done += high
            _switch(given, physics, t + done, state, contact, origins, slides, work, row)
            if done >= h:
                break
        if done < h:
            for i in range(STATES):
                state[i] = ahead[i]
        if physics.codes[CHIPS] != 0:
            _chip(physics, state, contact, origins, row)
        _let_go(given, physics, t + h, state, contact, origins, slides, work, row)
        if not abs(state[X2]) < 10.0:
            return False
    return True
