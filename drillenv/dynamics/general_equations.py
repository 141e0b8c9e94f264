"""The equations of the general engine, and the state they move.

State of the rig, in SI: ``y = X1 - X2``, the speeds ``v1`` and ``v2``, ``w``, the indenter's place behind its moving
origin ``O``, and ``u``, the displacement of the rock's face where a mount lets it move: ``X2 = O + w + u``. As in
:mod:`drillenv.dynamics.flow` the origin is Xf out of contact and while unloading, and Xp while loading, so nothing in
the state drifts. Behind these five stand the extra states of the chosen effects and then the energies moved: by the
drive, the static force, the damper, the rock law and each effect. All are integrated alike.

    y'  = v1 - v2
    v1' = (F_b - k y - c y' + forces of effects) / m1
    v2' = (F_a sin(theta) + k y + c y' - R + forces of effects) / m2,    theta' = 2 pi f
    w'  = v2 - u'

Dry friction is a regime of its own, for each mass that it grips: sliding forward (1), backward (-1), or sticking (0).
This number is the first extra state of the effect. Sliding, the friction has its full strength; sticking, the mass has
no acceleration at all, and friction is whatever the other forces need to be held.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.effects import ON_INDENTER, ON_ROCK, ON_SHAKER, Moment
from drillenv.dynamics.flow import FREE, LOADING
from drillenv.dynamics.general_calls import INLINED, INNER, apart, call_corner, call_shape, call_term

# Where things stand in a state.
Y, V1, V2, W, U, OWN = range(6)
"""y, v1, v2, w, u, and the first extra state of an effect."""
BY_DRIVE, BY_STATIC, IN_DAMPER, IN_ROCK, BY_EFFECTS = range(5)
"""Energies, counted from ``Model.tally``."""

# Columns of the table of effects: addresses of its four functions (0 for none), 1 where its term needs the whole force
# of the rock, the indices of its first extra state and first parameter, 1 where the former is the speed of the face.
TERM_AT, SHAPE_AT, SWITCHED_AT, CORNER_AT, LAST, FIRST, AT, FACE = range(8)
COLUMNS = FACE + 1


class Model(NamedTuple):
    """A rig on a rock at a setting with effects, made ready for the kernels."""

    m1: float
    m2: float
    k: float
    c: float
    kl: float
    ku: float
    omega: float
    drive: float
    """F_a in N."""
    static: float
    """F_b in N."""
    effects: np.ndarray
    """(effects, COLUMNS), see the columns above; those that need the whole force of the rock stand at the end."""
    parameters: np.ndarray
    sizes: np.ndarray
    """(dynamic states,) absolute tolerance over relative tolerance."""
    tally: int
    """Index of the first energy in the state."""
    bent: bool
    """Whether an effect bends the rock law."""
    cornered: bool
    """Whether an effect says where its force has a corner."""
    rated: bool
    """Whether the force of the rock may peak before the turn."""
    gripped: bool
    """Whether dry friction grips a mass."""
    grip1: int
    """Row of the effect whose friction grips the shaker, or -1."""
    grip2: int
    """Row of the effect whose friction grips the indenter, or -1."""
    longest: float
    """Longest step in s."""


@njit(**INNER)
def bend(model: Model, regime: int, depth: float, z: np.ndarray) -> float:
    """The depth in m as effects bend it: the force of the rock law over its stiffness."""
    if model.bent:
        table, ratio = model.effects, model.kl / model.ku
        k = model.kl if regime == LOADING else model.ku
        for i in range(table.shape[0]):
            if table[i, SHAPE_AT] != 0:
                first, at = table[i, FIRST], table[i, AT]
                depth = call_shape(table[i, SHAPE_AT], depth, regime, k, ratio, z, first, model.parameters, at)
    return depth


@njit(**INNER)
def law_force(model: Model, regime: int, w: float, z: np.ndarray) -> float:
    """Force of the rock law in N at depth ``w``; negative behind the face, where a trial step may end."""
    if regime == FREE:
        return 0.0
    return (model.kl if regime == LOADING else model.ku) * bend(model, regime, w, z)


@njit(**INNER)
def law_depth(model: Model, regime: int, force: float, z: np.ndarray) -> float:
    """Depth in m at which the rock law of a regime has this force."""
    apart()
    goal = force / (model.kl if regime == LOADING else model.ku)
    if not model.bent or goal <= 0.0:
        return goal
    low, under, high = 0.0, -goal, goal
    over = bend(model, regime, high, z) - goal
    while over < 0.0:
        low, under, high = high, over, 2.0 * high
        over = bend(model, regime, high, z) - goal
    # regula falsi with the Illinois rule, and a bisection now and then in case it creeps
    for turn in range(200):
        guess = 0.5 * (low + high)
        if turn % 4 < 3 and over > under:
            guess = (low * over - high * under) / (over - under)
        if not low < guess < high:
            break
        value = bend(model, regime, guess, z) - goal
        if value == 0.0:
            return guess
        if value > 0.0:
            high, over, under = guess, value, 0.5 * under
        else:
            low, under, over = guess, value, 0.5 * over
    return low if abs(bend(model, regime, low, z) - goal) < abs(bend(model, regime, high, z) - goal) else high


@njit(**INNER)
def face_speed(model: Model, z: np.ndarray) -> float:
    """Speed of the rock's face in m/s."""
    speed = 0.0
    table = model.effects
    for i in range(table.shape[0]):
        if table[i, FACE] == 1:
            speed += z[int(table[i, FIRST])]
    return speed


@njit(**INLINED)
def moment(model: Model, time: float, theta: float, regime: int, z: np.ndarray, closing: float, into: float, rock):
    """The rig as the functions of effects see it."""
    return Moment(
        time, theta, model.omega, z[Y], closing, z[V1], z[V2], z[W], into, z[U], rock, regime, model.drive,
        model.static, model.m1, model.m2, model.k, model.c, model.kl, model.ku,
    )  # fmt: skip


@njit(**INNER)
def next_corner(
    model: Model, time: float, theta: float, regime: int, z: np.ndarray, dz: np.ndarray, rock: float
) -> float:
    """Seconds that a step may take at most, for effects whose forces have corners; ``dz`` is the slope of ``z``."""
    apart()
    ahead, table = math.inf, model.effects
    into = z[V2] - face_speed(model, z)
    for i in range(table.shape[0]):
        if table[i, CORNER_AT] != 0:
            now = moment(model, time, theta, regime, z, z[V1] - z[V2], into, rock)
            seconds = call_corner(table[i, CORNER_AT], now, dz[V1], dz[V2], model.parameters, table[i, AT])
            # none at all, rather than a step of no length
            if seconds > 0.0:
                ahead = min(ahead, seconds)
    return ahead


@njit(**INNER)
def slope(model: Model, time: float, theta: float, regime: int, z: np.ndarray, dz: np.ndarray, push: np.ndarray):
    """As :func:`inlined_slope`, for what does not call it all the time."""
    apart()
    return inlined_slope(model, time, theta, regime, z, dz, push)


@njit(**INLINED)
def inlined_slope(
    model: Model, time: float, theta: float, regime: int, z: np.ndarray, dz: np.ndarray, push: np.ndarray
):
    """Write the time derivative of the state to ``dz``; return the force of the rock in N.

    Where friction grips, the forces on both masses without it, which it must hold where they stick, are left behind
    what the effects add to the rock in ``push``.
    """
    v1, v2, w = z[V1], z[V2], z[W]
    face = face_speed(model, z)
    closing, into = v1 - v2, v2 - face
    drive = model.drive * math.sin(theta)
    spring, damper = model.k * z[Y], model.c * closing
    law = law_force(model, regime, w, z)
    on_shaker, on_indenter, on_rock = 0.0, 0.0, 0.0
    rock, tally = law, model.tally
    settled = False
    table = model.effects
    for i in range(table.shape[0]):
        if table[i, LAST] == 1 and not settled:
            rock = whole_force(law, on_rock)
            settled = True
        push[0], push[1], push[2] = 0.0, 0.0, 0.0
        if table[i, TERM_AT] != 0:
            now = moment(model, time, theta, regime, z, closing, into, rock)
            first, at = table[i, FIRST], table[i, AT]
            call_term(table[i, TERM_AT], now, z, dz, first, model.parameters, at, push)
        if regime == FREE:
            push[ON_ROCK] = 0.0
        on_shaker += push[ON_SHAKER]
        on_indenter += push[ON_INDENTER]
        on_rock += push[ON_ROCK]
        dz[tally + BY_EFFECTS + i] = push[ON_SHAKER] * v1 + push[ON_INDENTER] * v2
        push[3 + i] = push[ON_ROCK]
    rock = whole_force(law, on_rock)
    # where the contact would pull, the effects on the rock move only what brings its force down to zero
    share = (rock - law) / on_rock if on_rock != 0.0 else 0.0
    for i in range(table.shape[0]):
        dz[tally + BY_EFFECTS + i] -= share * push[3 + i] * into
        if table[i, FACE] == 1:
            dz[tally + BY_EFFECTS + i] -= rock * z[table[i, FIRST]]
    dz[Y] = closing
    dz[V1] = (model.static - spring - damper + on_shaker) / model.m1
    dz[V2] = (drive + spring + damper - rock + on_indenter) / model.m2
    dz[W] = into
    dz[U] = face
    dz[tally + BY_DRIVE] = drive * v2
    dz[tally + BY_STATIC] = model.static * v1
    dz[tally + IN_DAMPER] = damper * closing
    dz[tally + IN_ROCK] = law * into
    if model.gripped:
        rub(model, z, dz, push)
    return rock


@njit(**INNER)
def whole_force(law: float, added: float) -> float:
    """The contact never pulls. Behind the face (law below 0) a trial step goes on smoothly instead."""
    whole = law + added
    if law > 0.0:
        return max(whole, 0.0)
    # what pulls at the face itself, as a damper does on the way out, would jump here, in a step that ends on the face
    return law if added < 0.0 else whole


@njit(**INNER)
def rub(model: Model, z: np.ndarray, dz: np.ndarray, push: np.ndarray):
    """Add dry friction to a slope without it. The forces that it meets go behind the others in ``push``, in N."""
    apart()
    for mass in range(2):
        row, at = (model.grip1, V1) if mass == ON_SHAKER else (model.grip2, V2)
        inertia = model.m1 if mass == ON_SHAKER else model.m2
        push[3 + model.effects.shape[0] + mass] = inertia * dz[at]
        if row >= 0:
            slide = z[model.effects[row, FIRST]]
            friction = -slide * model.parameters[model.effects[row, AT]]
            dz[at] = 0.0 if slide == 0.0 else dz[at] + friction / inertia
            dz[model.tally + BY_EFFECTS + row] = friction * z[at]


@njit(**INNER)
def sticks(model: Model, mass: int, z: np.ndarray) -> bool:
    """Whether dry friction holds a mass at rest."""
    row = model.grip1 if mass == ON_SHAKER else model.grip2
    return row >= 0 and z[model.effects[row, FIRST]] == 0.0
