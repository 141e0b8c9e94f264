"""How a motion changes with its start and with the model: variational equations, and saltation at events.

Along a step the variational equations S' = J S + f are solved by collocation at the Gauss-Lobatto points of it, of
order eight like the motion's own steps (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer,
1996, Section IV.5): five Jacobians a step, and one linear system for all columns, which gives S at these points as
well. f is what a column changes the rates by at a given state: nothing for a state at the beginning; for a
scalar of the model, a law, a force of a frequency of its own what they enter. Where an event ends a step S jumps:

    S+ = R S + g + (f+ - R f-) (grad h . S) / (grad h . f-)

with h the guard, R and g the derivatives of the reset map by the state and by the column, f- and f+ the rates before
and behind it (M. di Bernardo et al., Piecewise-smooth Dynamical Systems, Springer, 2008, Section 2.5). The factor on
the rock's stiffness, which holds for a whole contact, goes with the moment of landing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINED, INNER, NO, YES, apart, constants, copy
from drillenv.dynamics.constitutive.places import (
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    MOUNT_DAMPER,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    REFERENCE_DEPTH,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    WAVEFORM,
)
from drillenv.dynamics.constitutive.tables import DEGREE
from drillenv.dynamics.flow import FREE
from drillenv.dynamics.flow import LOADING as ON_LOADING
from drillenv.dynamics.flow import UNLOADING as ON_UNLOADING
from drillenv.dynamics.hybrid.advance import WENT_ON, advance, prepare
from drillenv.dynamics.hybrid.model import Model
from drillenv.dynamics.hybrid.runge_kutta import (
    BEGIN,
    BEGIN_D,
    BEGIN_SLOPE,
    END,
    FLAGS,
    INNER_STATE,
    LENGTH,
    PUSH,
    READY,
    SPARE,
    SPARE_SLOPE,
    STAGES,
    follow,
    inside_one,
)
from drillenv.dynamics.hybrid.slew_rate import BESIDE
from drillenv.dynamics.hybrid.vector_field import (
    AIR_PER_LENGTH,
    AIR_RATE,
    AIR_STIFFNESS,
    BED,
    BED_DAMPING,
    BED_SHARE,
    BED_SPEED,
    BED_SQUARE,
    BENT1,
    BENT2,
    BRISTLE_DAMPING1,
    BRISTLES1,
    BY_SLOPE,
    COMPACTION_LENGTH,
    CONTACT_DAMPING,
    CONTACT_DAMPING_POWER,
    CUT,
    DRIVE_DELAY,
    DRIVE_LAG,
    F_A,
    F_B,
    FIRST,
    GRIP1,
    GRIP2,
    KL,
    KU,
    LAST_PIECE,
    LAWS,
    LEAST_AIR,
    LEAST_SLIDING,
    LEFT,
    M1,
    M2,
    MOUNT_DAMPING,
    MOUNT_GAIN,
    MOUNT_SQUARE,
    MOVING,
    OMEGA,
    OVER_KIND,
    OWN,
    PIECE_COLUMNS,
    PIECES_AT,
    PLACE,
    REGIME,
    ROTATION_CONTACT,
    ROTATION_PHASE,
    ROTATION_RATE,
    ROTATION_SHARE,
    SCALE,
    SIZE,
    SIZES_AT,
    SLEW_RATE,
    SLEW_SHARE,
    SLEWING,
    SLIDE1,
    SLIDING1,
    TALLY,
    TERMS,
    THETA,
    TIME,
    TURN,
    UD,
    V1,
    V2,
    C,
    K,
    Q,
    U,
    W,
    Y,
    air_left,
    air_stiffness,
    argument,
    compaction_argument,
    damping_share,
    damping_slope,
    drive_lost,
    is_of_bristles,
    law_at,
    look,
    look_anew,
    rates,
    shape_argument,
    shape_scale,
    stiffness,
)

DIFFERENCE = 1e-6
"""Share of a state's size for differences, where a term from outside acts."""
LEAST_PIVOT = 0.25
"""The diagonal of a step's equations is near to 1, but for what decays or turns fast beside the step."""
STANDING = 1e-12
"""A guard that is approached at less than this share of its usual rate is not crossed."""

JUMP = 1e-3
"""Share of the drive's largest slope from which the slope of what is asked jumps at a phase."""

# Kinds of columns beside the scalars of the model (>= 0, their places in Model.s)
STATE, PHASE, LAW, ON_SHAKER, ON_INDENTER, ON_STIFFNESS, COUNTED, DRILLED_BEFORE = constants(
    -1, -2, -3, -4, -5, -6, -7, -8
)
"""By the state at the beginning, and nothing after it; the phase of the excitation in rad; a law; a force in N on one
of the masses, and a share of the rock's stiffness where a contact begins, that go with a sinusoid; impacts made
before on this face, and m drilled on it."""
SINE, COSINE, TIMES_TIME = 0, 1, 2
"""Codes of sinusoids; with TIMES_TIME added, the same times the time in s."""


class Columns(NamedTuple):
    """By what a motion is differentiated. Arrays have shape (columns,)."""

    kind: np.ndarray
    """A scalar's place, or one of the kinds."""
    which: np.ndarray
    """Of a law its number in the model; of a sinusoid its code."""
    first: np.ndarray
    """Of a law, the row of ``pieces`` that goes with its first piece."""
    turn: np.ndarray
    """rad/s, of a sinusoid, whose phase is 0 at time 0."""
    pieces: np.ndarray
    """(rows, DEGREE + 1) by what laws change, on the pieces that they have in the model."""


def by_state(count: int) -> Columns:
    """So many columns by the state at the beginning, and no other."""
    none = np.zeros(count, dtype=np.int64)
    return Columns(np.full(count, STATE), none, none, np.zeros(count), np.zeros((0, DEGREE + 1)))


# What a linearisation leaves behind: in ``lin``
(
    ROCK_W,
    ROCK_V,
    LAW_FORCE,
    LAW_W,
    BY_FACTOR,
    BY_KL,
    BY_KU,
    GAIN,
    BY_F_A,
    BY_PHASE,
    BY_LAG,
    FROM_REST,
    ROCK,
    BY_SLIDING1,
    BY_SLIDING2,
) = range(15)
LINEAR = 15
"""Derivatives of the rock's force by w and by the speed into it; the force of the rock law and its derivatives by w, by
the logarithm of the factor on its stiffness, by k_l and by k_u; what it is multiplied with; derivatives of the drive by
F_a, by its phase and by its lag; slope of the curves over the shortening beyond that at rest; the rock's force; the
rates of both masses' bristles by the force at which they slide."""
# and in ``at`` (laws, 3)
AT_PIECE, AT_T, CHAIN = range(3)
"""Which piece of a law its argument is in, and where in it; of a contact's shape, by what the force of the rock law
changes with it."""
# Rows of what columns change the rates by: of v1, v2, u', q, b1, b2, the bed's speed, and the rock's force
BY_V1, BY_V2, BY_UD, BY_Q, BY_BENT1, BY_BENT2, BY_BED, BY_ROCK = range(8)
FORCINGS = 8


def _collocation(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Lobatto points (count,) from 0 to 1, and (count, count) integrals from 0 to them of Lagrange's polynomials.

    The points are the ends and the extrema of Legendre's polynomial of degree ``count - 1``.
    """
    inner = np.polynomial.legendre.Legendre.basis(count - 1).deriv().roots().real
    points = 0.5 + 0.5 * np.concatenate([[-1.0], np.sort(inner), [1.0]])
    power = np.arange(count)
    return points, points[:, None] ** (power + 1) / (power + 1) @ np.linalg.inv(np.vander(points, increasing=True))


POINTS = 5
LAST = POINTS - 1
POINTS_AT, INTEGRALS = _collocation(POINTS)


class Variation(NamedTuple):
    """Working memory for columns beside a motion."""

    v: np.ndarray
    """(POINTS, states, columns) derivatives of the states at the points of a step, those where the motion is first."""
    j: np.ndarray
    """(POINTS, states, states) Jacobians."""
    lin: np.ndarray
    """(POINTS, LINEAR)"""
    at: np.ndarray
    """(laws, 3)"""
    force: np.ndarray
    """(POINTS, FORCINGS, columns)"""
    factor: np.ndarray
    """(columns,) logarithmic derivative of the factor on the rock's stiffness, of the present contact."""
    change: np.ndarray
    """(columns,) what the reset map changes w by beside the state."""
    drilled: np.ndarray
    """(columns,) derivative of what was drilled on this face."""
    driven: np.ndarray
    """(columns,) derivative of the force that a drive of limited slew rate ramps from."""
    late: np.ndarray
    """(LINEAR,) of the force that it follows."""
    late_at: np.ndarray
    """(laws, 3)"""
    by: np.ndarray
    """(SIZE, FORCINGS) by what scalars change the forces; the last but one is zero, the last room for a law."""
    system: np.ndarray
    """(LAST * states, LAST * states + columns) equations of a step, and their right-hand sides."""


def make_variation(model: Model, columns: int) -> Variation:
    """Fresh working memory for so many columns."""
    n = model.tally
    return Variation(
        np.zeros((POINTS, n, columns)),
        np.zeros((POINTS, n, n)),
        np.zeros((POINTS, LINEAR)),
        np.zeros((max(len(model.laws), 1), 3)),
        np.zeros((POINTS, FORCINGS, columns)),
        np.zeros(columns),
        np.zeros(columns),
        np.zeros(columns),
        np.zeros(columns),
        np.zeros(LINEAR),
        np.zeros((max(len(model.laws), 1), 3)),
        np.zeros((SIZE, FORCINGS)),
        np.zeros((LAST * n, LAST * n + columns)),
    )


@njit(**INNER)
def law_slope(m: np.ndarray, d: np.ndarray, regime: int, w: float) -> float:
    """Derivative of the rock law by the depth in N/m."""
    rate = 1.0
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == regime - ON_LOADING:
            scale = shape_scale(m, d, i, regime)
            rate *= look(m, d, i, shape_argument(m, d, i, w)[0])[1] if scale > 0.0 else 1.0
    return stiffness(m, d, regime) * rate


@njit(**INNER)
def look_closely(m: np.ndarray, d: np.ndarray, law: int, x: float, at: np.ndarray) -> tuple[float, float]:
    """Value and slope of a law, and where in its table that is, into row ``law`` of ``at``."""
    apart()
    value, slope = look(m, d, law, x)
    note_piece(m, law, x, at)
    return value, slope


@njit(**INLINED)
def note_piece(m: np.ndarray, law: int, x: float, at: np.ndarray) -> None:
    """Write which piece of a law x was just found in, and where in it that is, into row ``law`` of ``at``."""
    piece = law_at(m, law, LAST_PIECE)
    begin = PIECES_AT + piece * PIECE_COLUMNS
    at[law, AT_PIECE] = piece - law_at(m, law, FIRST)
    at[law, AT_T] = (x - m[begin + LEFT]) * m[begin + SCALE] - 1.0


@njit(**INNER)
def piece_value(pieces: np.ndarray, row: int, t: float) -> float:
    """A polynomial of a table; beyond its ends straight on."""
    inside = min(max(t, -1.0), 1.0)
    value, slope = 0.0, 0.0
    for power in range(DEGREE, -1, -1):
        slope = value + inside * slope
        value = pieces[row, power] + inside * value
    return value + slope * (t - inside)


@njit(**INNER)
def linearise_law(m: np.ndarray, d: np.ndarray, regime: int, w: float, at: np.ndarray, lin: np.ndarray) -> None:
    """The force of the rock law at the depth w and its derivatives: LAW_FORCE to BY_KU."""
    apart()
    for i in range(LAW_FORCE, BY_KU + 1):
        lin[i] = 0.0
    if regime == FREE:
        return
    depth, rate, by_stiffness, by_ratio = w, 1.0, 0.0, 0.0
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) > UNLOADING:
            break
        if law_at(m, i, PLACE) != regime - ON_LOADING:
            continue
        scale = shape_scale(m, d, i, regime)
        value, slope = look_closely(m, d, i, depth * scale, at)
        for before in range(i):
            at[before, CHAIN] *= slope
        at[i, CHAIN] = stiffness(m, d, regime) / scale
        # by the logarithm of its scale, which holds the whole stiffness, or k_u / k_l
        off, over = slope * depth - value / scale, law_at(m, i, OVER_KIND)
        by_stiffness, by_ratio = by_stiffness * slope, by_ratio * slope
        if over == 2:
            by_stiffness += off
        elif over == 1 and regime == ON_UNLOADING:
            by_ratio += off
        depth, rate = value / scale, rate * slope
    k = stiffness(m, d, regime)
    lin[LAW_FORCE], lin[LAW_W], lin[BY_FACTOR] = k * depth, k * rate, k * (depth + by_stiffness)
    if regime == ON_LOADING:
        lin[BY_KL] = lin[BY_FACTOR] / m[KL]
    else:
        lin[BY_KL] = -k * by_ratio / m[KL]
        lin[BY_KU] = (lin[BY_FACTOR] + k * by_ratio) / m[KU]


@njit(**INNER)
def linearise(
    m: np.ndarray, d: np.ndarray, shift: float, z: np.ndarray, j: np.ndarray, at: np.ndarray, lin: np.ndarray
) -> None:
    """The derivative of the rates by the dynamic states, into j (n, n), and what else forcings need.

    Of a rig without terms from outside, ``shift`` s after its discrete state.
    """
    apart()
    n, regime = int(m[TALLY]), int(d[REGIME])
    for a in range(n):
        for b in range(n):
            j[a, b] = 0.0
    theta = d[THETA] + m[OMEGA] * shift
    linearise_law(m, d, regime, z[W], at, lin)
    factor, factor_v, extra, extra_v, stiff, damped = 1.0, 0.0, 0.0, 0.0, m[K], m[C]
    held1, held2, mount_u, mount_v = 0.0, 0.0, 0.0, 0.0
    lin[FROM_REST] = 0.0
    linearise_drive(m, d, z, theta, NO, at, lin)
    for i in range(int(m[LAWS])):
        place = law_at(m, i, PLACE)
        if place <= UNLOADING or place == COMPACTION or (regime == FREE and place <= RATE_FORCE):
            continue
        if place in (WAVEFORM, DRIVE):
            continue
        value, slope = look_closely(m, d, i, argument(m, d, i, z, theta), at)
        if place == RATE_FACTOR:
            factor += value
            factor_v += slope
        elif place == RATE_FORCE:
            extra += value
            extra_v += slope
        elif place == SPRING:
            stiff += slope
        elif place == SPRING_FROM_REST:
            stiff += slope
            lin[FROM_REST] += slope
        elif place == DAMPER:
            damped += slope
        elif is_of_bristles(m, place):
            continue
        elif place == GUIDE:
            held1 += slope
        elif place == INDENTER:
            held2 += slope
        elif place == MOUNT_SPRING:
            mount_u += slope
        elif place == MOUNT_DAMPER:
            mount_v += slope
    extra_w = 0.0
    if regime != FREE and m[CONTACT_DAMPING] != 0.0:
        resists, into = m[CONTACT_DAMPING] * damping_share(m, z[W]), z[V2] - z[UD]
        extra += resists * into
        extra_v += resists
        # at the face a power below 1 has no finite slope: see mend_onset
        extra_w = damping_slope(m, z[W]) * into
    rock_w, rock_v, lin[GAIN] = lin[LAW_W] * factor + extra_w, lin[LAW_FORCE] * factor_v + extra_v, factor
    lin[ROCK] = lin[LAW_FORCE] * factor + extra
    if regime == FREE or d[CUT] != 0.0:
        rock_w, rock_v, lin[GAIN], lin[ROCK] = 0.0, 0.0, 0.0, 0.0
    lin[ROCK_W], lin[ROCK_V] = rock_w, rock_v
    j[Y, V1], j[Y, V2] = 1.0, -1.0
    j[V1, Y], j[V1, V1], j[V1, V2], j[V1, Q] = -stiff, -(damped + held1), damped, -1.0
    j[V2, Y], j[V2, V1], j[V2, V2] = stiff, damped, -(damped + held2 + rock_v)
    j[V2, W], j[V2, UD] = -rock_w, rock_v
    for b in range(n):
        j[V1, b] /= m[M1]
        j[V2, b] /= m[M2]
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0 and d[SLIDE1 + mass] == 0.0:
            for b in range(n):
                j[V1 + mass, b] = 0.0
    j[W, V2], j[W, UD], j[U, UD] = 1.0, -1.0, 1.0
    mount_u += m[MOUNT_SQUARE]
    mount_v += m[MOUNT_DAMPING]
    j[UD, U], j[UD, UD] = -mount_u, -mount_v - m[MOUNT_GAIN] * rock_v
    j[UD, BED], j[UD, BED_SPEED], j[BED, BED_SPEED] = mount_u, mount_v, 1.0
    if m[BED_SQUARE] > 0.0:
        share = m[BED_SHARE]
        j[BED_SPEED, U], j[BED_SPEED, UD] = share * mount_u, share * mount_v
        j[BED_SPEED, BED] = -share * mount_u - m[BED_SQUARE]
        j[BED_SPEED, BED_SPEED] = -share * mount_v - m[BED_DAMPING]
    j[UD, W], j[UD, V2] = m[MOUNT_GAIN] * rock_w, m[MOUNT_GAIN] * rock_v
    left = air_left(m, z[Q])
    j[Q, V1] = air_stiffness(m) * left * left
    j[Q, Q] = by_air_left(m, z) * by_air_lost(m, z[Q]) - m[AIR_RATE] * left
    for mass in range(2):
        lin[BY_SLIDING1 + mass] = 0.0
        if m[BRISTLES1 + mass] > 0.0:
            linearise_bristles(m, d, mass, z, j, at, lin)


@njit(**INLINED)
def linearise_drive(
    m: np.ndarray, d: np.ndarray, z: np.ndarray, theta: float, late: bool, at: np.ndarray, lin: np.ndarray
) -> None:
    """The derivatives of the force asked of the drive at a phase: BY_F_A, BY_PHASE and BY_LAG.

    Of a phase that is ``late``, in whichever parts of its laws between corners that is.
    """
    sine, cosine = math.sin(theta), math.cos(theta)
    ratio = m[DRIVE_LAG] * m[OMEGA] / TURN
    passed = 1.0 / math.sqrt(1.0 + ratio * ratio)
    shape, shape_theta = sine * passed, cosine * passed
    for i in range(int(m[LAWS])):
        place = law_at(m, i, PLACE)
        if place != WAVEFORM and place != DRIVE:
            continue
        x = m[F_A] * sine
        if place == WAVEFORM:
            x = theta - TURN * math.floor(theta / TURN) if late else argument(m, d, i, z, theta)
        value, slope = look_anew(m, i, x) if late else look(m, d, i, x)
        note_piece(m, i, x, at)
        shape += value if place == WAVEFORM else slope * sine
        shape_theta += slope if place == WAVEFORM else slope * cosine
    lin[BY_F_A], lin[BY_PHASE] = shape, m[F_A] * shape_theta
    lin[BY_LAG] = -m[F_A] * sine * passed**3 * ratio * m[OMEGA] / TURN


@njit(**INLINED)
def by_air_lost(m: np.ndarray, lost: float) -> float:
    """Derivative of the share of the cylinder's force that is left by the force lost, in 1/N."""
    gives = m[AIR_PER_LENGTH] > 0.0 and m[F_B] > 0.0 and air_left(m, lost) > LEAST_AIR
    return -1.0 / m[F_B] if gives else 0.0


@njit(**INLINED)
def by_air_left(m: np.ndarray, z: np.ndarray) -> float:
    """Derivative by the share of the cylinder's force that is left, of how fast the cylinder loses force, in N/s."""
    return 2.0 * air_stiffness(m) * air_left(m, z[Q]) * z[V1] - m[AIR_RATE] * z[Q]


@njit(**INNER)
def linearise_bristles(
    m: np.ndarray, d: np.ndarray, mass: int, z: np.ndarray, j: np.ndarray, at: np.ndarray, lin: np.ndarray
) -> None:
    """The derivatives of what bristles do to a mass, into the rows of ``j`` of the two."""
    apart()
    v, force, way, sliding, slope = z[V1 + mass], z[BENT1 + mass], d[SLIDE1 + mass], m[SLIDING1 + mass], 0.0
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == GUIDE + mass:
            value, rate = look_closely(m, d, i, way * v, at)
            sliding += value
            slope += rate
    sliding = max(sliding, LEAST_SLIDING)
    stiff, damping = m[BRISTLES1 + mass], m[BRISTLE_DAMPING1 + mass]
    # the speed at which they give, by the sliding force, their own force, and the mass's speed
    by_sliding, by_force = way * v * force / (sliding * sliding), -way * v / sliding
    by_speed = 1.0 - way * force / sliding + by_sliding * slope * way
    j[BENT1 + mass, BENT1 + mass], j[BENT1 + mass, V1 + mass] = stiff * by_force, stiff * by_speed
    j[V1 + mass, BENT1 + mass] = -(1.0 + damping * by_force) / m[M1 + mass]
    j[V1 + mass, V1 + mass] -= damping * by_speed / m[M1 + mass]
    lin[BY_SLIDING1 + mass] = by_sliding


@njit(**INNER)
def linearise_by_differences(
    m: np.ndarray, d: np.ndarray, shift: float, z: np.ndarray, j: np.ndarray, scratch: np.ndarray
) -> None:
    """The Jacobian by central differences, for what a term from outside does."""
    apart()
    n, sizes = int(m[TALLY]), int(m[SIZES_AT])
    for b in range(n):
        step = DIFFERENCE * max(m[sizes + b], abs(z[b]))
        for way in range(2):
            copy(z, scratch[SPARE])
            scratch[SPARE, b] += step if way == 0 else -step
            rates(m, d, shift, scratch[SPARE], scratch[SPARE_SLOPE], scratch[PUSH])
            for a in range(n):
                slope = scratch[SPARE_SLOPE, a] / (2.0 * step)
                j[a, b] = slope if way == 0 else j[a, b] - slope


@njit(**INNER)
def sinusoid(code: int, turn: float, time: float) -> float:
    """A sinusoid at a time in s."""
    value = math.cos(turn * time) if code % TIMES_TIME == COSINE else math.sin(turn * time)
    return value * time if code >= TIMES_TIME else value


@njit(**INNER)
def by_scalars(m: np.ndarray, d: np.ndarray, z: np.ndarray, dz: np.ndarray, lin: np.ndarray, by: np.ndarray) -> None:
    """By what scalars change the forces: of each that a column may be by, a row of ``by`` (SIZE, FORCINGS).

    Forces on both masses in N, the mount's acceleration, the rates of the air and of bristles, and the rock's force,
    beside which the first three do not count it.
    """
    closing = z[V1] - z[V2]
    by[M1, BY_V1], by[M2, BY_V2] = -dz[V1], -dz[V2]
    # with k and F_b the shortening at rest changes, and with it the curves beyond it
    by[K, BY_V2] = z[Y] + lin[FROM_REST] * m[F_B] / (m[K] * m[K])
    by[K, BY_V1] = -by[K, BY_V2]
    by[F_B, BY_V2] = -lin[FROM_REST] / m[K]
    by[F_B, BY_V1] = 1.0 - by[F_B, BY_V2]
    by[C, BY_V1], by[C, BY_V2] = -closing, closing
    by[F_A, BY_V2], by[DRIVE_LAG, BY_V2] = lin[BY_F_A], lin[BY_LAG]
    by[KL, BY_ROCK], by[KU, BY_ROCK] = lin[BY_KL] * lin[GAIN], lin[BY_KU] * lin[GAIN]
    by[GRIP1, BY_V1], by[GRIP2, BY_V2] = -d[SLIDE1], -d[SLIDE1 + 1]
    deflection, rate = z[U] - z[BED], z[UD] - z[BED_SPEED]
    by[MOUNT_GAIN, BY_UD], by[MOUNT_SQUARE, BY_UD], by[MOUNT_DAMPING, BY_UD] = lin[ROCK], -deflection, -rate
    by[MOUNT_SQUARE, BY_BED], by[MOUNT_DAMPING, BY_BED] = m[BED_SHARE] * deflection, m[BED_SHARE] * rate
    by[BED_SHARE, BY_BED] = m[MOUNT_GAIN] * lin[ROCK] - dz[UD]
    by[BED_SQUARE, BY_BED], by[BED_DAMPING, BY_BED] = -z[BED], -z[BED_SPEED]
    left = air_left(m, z[Q])
    by[AIR_STIFFNESS, BY_Q], by[AIR_RATE, BY_Q] = left * left * z[V1], -left * z[Q]
    by[AIR_PER_LENGTH, BY_Q] = max(m[F_B], 0.0) * left * left * z[V1]
    by[F_B, BY_Q] = m[AIR_PER_LENGTH] * left * left * z[V1]
    if m[F_B] > 0.0:
        by[F_B, BY_Q] -= by_air_left(m, z) * by_air_lost(m, z[Q]) * z[Q] / m[F_B]
    share = damping_share(m, z[W]) * (z[V2] - z[UD]) if lin[GAIN] != 0.0 else 0.0
    by[CONTACT_DAMPING, BY_ROCK], by[CONTACT_DAMPING_POWER, BY_ROCK] = share, 0.0
    if share != 0.0 and z[W] > 0.0:
        by[CONTACT_DAMPING_POWER, BY_ROCK] = m[CONTACT_DAMPING] * share * math.log(z[W] / REFERENCE_DEPTH)
    for mass in range(2):
        stiff = m[BRISTLES1 + mass]
        giving = dz[BENT1 + mass] / stiff if stiff > 0.0 else z[V1 + mass]
        by[BRISTLES1 + mass, BY_BENT1 + mass], by[BRISTLE_DAMPING1 + mass, BY_V1 + mass] = giving, -giving
        by[SLIDING1 + mass, BY_BENT1 + mass] = stiff * lin[BY_SLIDING1 + mass]
        by[SLIDING1 + mass, BY_V1 + mass] = -m[BRISTLE_DAMPING1 + mass] * lin[BY_SLIDING1 + mass]


@njit(**INNER)
def by_law(
    m: np.ndarray, d: np.ndarray, columns: Columns, c: int, at: np.ndarray, lin: np.ndarray, own: np.ndarray
) -> None:
    """The same for a law, a row of its own (FORCINGS,), which is zero."""
    law = columns.which[c]
    place = law_at(m, law, PLACE)
    if place == COMPACTION or (place <= RATE_FORCE and lin[GAIN] == 0.0):
        return
    if place <= UNLOADING and place != int(d[REGIME]) - ON_LOADING:
        return
    value = piece_value(columns.pieces, columns.first[c] + int(at[law, AT_PIECE]), at[law, AT_T])
    if place <= UNLOADING:
        own[BY_ROCK] = value * at[law, CHAIN] * lin[GAIN]
    elif place <= RATE_FORCE:
        own[BY_ROCK] = value * (lin[LAW_FORCE] if place == RATE_FACTOR else 1.0)
    elif place <= DAMPER:
        own[BY_V1], own[BY_V2] = -value, value
    elif is_of_bristles(m, place):
        mass = place - GUIDE
        more = value * lin[BY_SLIDING1 + mass]
        own[BY_BENT1 + mass], own[BY_V1 + mass] = m[BRISTLES1 + mass] * more, -m[BRISTLE_DAMPING1 + mass] * more
    elif place == GUIDE:
        own[BY_V1] = -value
    elif place <= DRIVE:
        own[BY_V2] = value * (-1.0 if place == INDENTER else (m[F_A] if place == WAVEFORM else 1.0))
    else:
        own[BY_UD], own[BY_BED] = -value, m[BED_SHARE] * value


@njit(**INNER)
def find_forcings(
    m: np.ndarray, d: np.ndarray, shift: float, z: np.ndarray, dz: np.ndarray, columns: Columns, work: Variation, k: int
) -> None:
    """By what columns change the rates at the state z, of slope dz, at a point of a step; behind :func:`linearise`."""
    apart()
    lin, force, by, time = work.lin[k], work.force[k], work.by, d[TIME] + shift
    by_scalars(m, d, z, dz, lin, by)
    free = by.shape[0] - 1
    for c in range(columns.kind.size):
        kind, row = columns.kind[c], free
        if kind >= 0:
            row = kind
        elif kind != STATE:
            for i in range(FORCINGS):
                by[free, i] = 0.0
            if kind == LAW:
                by_law(m, d, columns, c, work.at, lin, by[free])
            elif kind == PHASE:
                by[free, BY_V2] = lin[BY_PHASE]
            elif kind == ON_SHAKER:
                by[free, BY_V1] = sinusoid(columns.which[c], columns.turn[c], time)
            elif kind == ON_INDENTER:
                by[free, BY_V2] = sinusoid(columns.which[c], columns.turn[c], time)
        else:
            row = free - 1
        rock = by[row, BY_ROCK] + lin[BY_FACTOR] * work.factor[c] * lin[GAIN]
        force[BY_V1, c], force[BY_V2, c] = by[row, BY_V1] / m[M1], (by[row, BY_V2] - rock) / m[M2]
        force[BY_UD, c], force[BY_Q, c] = by[row, BY_UD] + m[MOUNT_GAIN] * rock, by[row, BY_Q]
        force[BY_BENT1, c], force[BY_BENT2, c] = by[row, BY_BENT1], by[row, BY_BENT2]
        force[BY_BED, c] = by[row, BY_BED]
        force[BY_ROCK, c] = rock
    if m[BY_SLOPE] >= 0.0:
        slope_forcings(m, d, shift, columns, work, k)
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0 and d[SLIDE1 + mass] == 0.0:
            for c in range(columns.kind.size):
                force[BY_V1 + mass, c] = 0.0


@njit(**INNER)
def by_asked(m: np.ndarray, columns: Columns, c: int, at: np.ndarray, lin: np.ndarray) -> float:
    """By what the force asked of the drive changes with a column; behind :func:`linearise_drive`."""
    kind = columns.kind[c]
    if kind == F_A:
        return lin[BY_F_A]
    if kind == DRIVE_LAG:
        return lin[BY_LAG]
    if kind == PHASE:
        return lin[BY_PHASE]
    law = columns.which[c]
    if kind == LAW and (law_at(m, law, PLACE) == WAVEFORM or law_at(m, law, PLACE) == DRIVE):
        value = piece_value(columns.pieces, columns.first[c] + int(at[law, AT_PIECE]), at[law, AT_T])
        return value * (m[F_A] if law_at(m, law, PLACE) == WAVEFORM else 1.0)
    return 0.0


@njit(**INNER)
def linearise_late(m: np.ndarray, theta: float, work: Variation) -> None:
    """The derivatives of what a drive of limited slew rate follows at a phase of the excitation: it is late."""
    linearise_drive(m, work.lin[0], work.lin[0], theta - m[OMEGA] * m[DRIVE_DELAY], YES, work.late_at, work.late)


@njit(**INNER)
def by_late(m: np.ndarray, columns: Columns, c: int, work: Variation) -> float:
    """By what that changes with a column; behind :func:`linearise_late`."""
    more = -m[OMEGA] * work.late[BY_PHASE] if columns.kind[c] == DRIVE_DELAY else 0.0
    return by_asked(m, columns, c, work.late_at, work.late) + more


@njit(**INNER)
def slope_forcings(m: np.ndarray, d: np.ndarray, shift: float, columns: Columns, work: Variation, k: int) -> None:
    """Add to the forcings by what a drive of limited slew rate changes, beside what is asked of it."""
    apart()
    theta, lin, force = d[THETA] + m[OMEGA] * shift, work.lin[k], work.force[k]
    ramps, lost = d[SLEWING] != 0.0, drive_lost(m, d, shift, theta)
    if not ramps:
        # steps end at corners of what is followed: on this side of them
        linearise_late(m, theta + (BESIDE if k == 0 else -BESIDE if k == LAST else 0.0), work)
    for c in range(columns.kind.size):
        more = work.driven[c] if ramps else by_late(m, columns, c, work)
        if ramps and columns.kind[c] == SLEW_RATE:
            more += d[SLEWING] * shift
        more = m[SLEW_SHARE] * (more - by_asked(m, columns, c, work.at, lin))
        if columns.kind[c] == SLEW_SHARE:
            more += lost
        force[BY_V2, c] += more / m[M2]


@njit(**INNER)
def vary_drive(m: np.ndarray, before: np.ndarray, d: np.ndarray, columns: Columns, work: Variation) -> None:
    """Take along by what columns change the force that a drive ramps from, over a step from ``before`` to ``d``.

    With time the ramp's force changes by its slope. Where one ramp ends in another, when it does matters as well.
    """
    apart()
    one, two = before[SLEWING], d[SLEWING]
    for c in range(columns.kind.size):
        if columns.kind[c] == SLEW_RATE:
            work.driven[c] += one * (d[TIME] - before[TIME])
    if one == two or two == 0.0:
        return
    if one == 0.0:
        begin_ramp(m, d, columns, work)
        return
    linearise_late(m, d[THETA], work)
    steep = work.late[BY_PHASE] * m[OMEGA]
    for c in range(columns.kind.size):
        asked = by_late(m, columns, c, work)
        later = -(work.driven[c] - asked) / (one * m[SLEW_RATE] - steep)
        work.driven[c] = asked + (steep - two * m[SLEW_RATE]) * later


@njit(**INNER)
def begin_ramp(m: np.ndarray, d: np.ndarray, columns: Columns, work: Variation) -> None:
    """By what columns change the force from which a ramp begins.

    Where what is asked becomes too steep by and by, it is as steep as the ramp, so that when it begins does not matter;
    at a corner of what is asked, where its slope jumps, that does.
    """
    apart()
    linearise_late(m, d[THETA] - BESIDE, work)
    steep = work.late[BY_PHASE] * m[OMEGA]
    for c in range(columns.kind.size):
        work.driven[c] = by_late(m, columns, c, work)
    linearise_late(m, d[THETA] + BESIDE, work)
    jump = work.late[BY_PHASE] * m[OMEGA] - steep
    if abs(jump) < JUMP * m[SLEW_RATE]:
        return
    for c in range(columns.kind.size):
        later = -(by_late(m, columns, c, work) - work.driven[c]) / jump
        work.driven[c] += (steep - d[SLEWING] * m[SLEW_RATE]) * later


@njit(**INNER)
def vary_step(m: np.ndarray, s: float, columns: Columns, work: Variation, scratch: np.ndarray) -> None:
    """Take the columns over the step just taken, of which s is the motion's: ``v`` at the points of it.

    The slopes of the step are still in ``scratch``, and the discrete state of its beginning.
    """
    apart()
    d, length, n = scratch[BEGIN_D], scratch[FLAGS, LENGTH], int(m[MOVING])
    if scratch[FLAGS, READY] == 0.0:
        follow(m, d, length, scratch)
        scratch[FLAGS, READY] = 1.0
    for k in range(POINTS):
        shift = POINTS_AT[k] * s
        inside_step(m, shift / length, scratch)
        rates(m, d, shift, scratch[SPARE], scratch[SPARE_SLOPE], scratch[PUSH])
        if m[TERMS] > 0.0:
            copy(scratch[SPARE], scratch[INNER_STATE])
            linearise_by_differences(m, d, shift, scratch[INNER_STATE], work.j[k], scratch)
        else:
            linearise(m, d, shift, scratch[SPARE], work.j[k], work.at, work.lin[k])
            find_forcings(m, d, shift, scratch[SPARE], scratch[SPARE_SLOPE], columns, work, k)
    by_power = m[CONTACT_DAMPING] * m[CONTACT_DAMPING_POWER] != 0.0 and m[TERMS] == 0.0
    if by_power and int(d[REGIME]) != FREE and scratch[BEGIN, W] <= 0.0:
        mend_onset(m, s, scratch, work)
    set_up(s, n, work)
    solve(LAST * n, work)
    v, system, count = work.v, work.system, columns.kind.size
    for k in range(1, POINTS):
        for a in range(n):
            row = LAST * block_of(a, n) - 1 + k
            for c in range(count):
                v[k, a, c] = system[row, LAST * n + c]
        for a in range(n, v.shape[1]):
            for c in range(count):
                v[k, a, c] = v[0, a, c]


@njit(**INNER)
def mend_onset(m: np.ndarray, s: float, scratch: np.ndarray, work: Variation) -> None:
    """Give the Jacobian at the face the slope of the rock's damping with which the step of length s has its integral.

    By a power of the depth w below 1 it has an infinite one there, whose integral is finite: with w growing evenly
    from 0 to ``end``, that of p c w^(p-1) V is s times c V end^p / end.
    """
    end = s / scratch[FLAGS, LENGTH]
    inside_step(m, end, scratch)
    deep, into = scratch[SPARE, W], scratch[SPARE, V2] - scratch[SPARE, UD]
    if deep <= 0.0:
        return
    mean = m[CONTACT_DAMPING] * damping_share(m, deep) * into / deep
    for k in range(1, POINTS):
        inside_step(m, end * POINTS_AT[k], scratch)
        w, into = scratch[SPARE, W], scratch[SPARE, V2] - scratch[SPARE, UD]
        mean -= INTEGRALS[LAST, k] * damping_slope(m, w) * into
    more = mean / INTEGRALS[LAST, 0]
    work.lin[0, ROCK_W] += more
    work.j[0, V2, W] -= more / m[M2]
    work.j[0, UD, W] += m[MOUNT_GAIN] * more


@njit(**INNER)
def inside_step(m: np.ndarray, share: float, scratch: np.ndarray) -> None:
    """The state at a share of the step just taken, to row ``SPARE``."""
    moving = int(m[MOVING])
    for i in range(moving):
        scratch[SPARE, i] = inside_one(i, share, scratch)
    for i in range(moving, int(m[TALLY])):
        scratch[SPARE, i] = scratch[BEGIN, i]


@njit(**INLINED)
def block_of(state: int, n: int) -> int:
    """Where the equations of a state stand: places first, since they hold nothing but speeds."""
    if n == 4:
        return (0, 2, 3, 1)[state]
    return (0, 3, 4, 1, 2, 5, 6, 7, 8, 9, 10)[state] if state < OWN else state


@njit(**INLINED)
def forcing_of(state: int) -> int:
    """The row of what columns change the rate of a state by; -1 of a place, whose rate is a speed."""
    if V1 <= state <= V2:
        return BY_V1 + state - V1
    if state == BED_SPEED:
        return BY_BED
    return BY_UD + state - UD if UD <= state <= BENT2 else -1


@njit(**INNER)
def set_up(s: float, n: int, work: Variation) -> None:
    """The equations S_k = S_0 + s sum_l a_kl (J_l S_l + f_l) of a step of length s, for k and l from 1 on."""
    apart()
    v, j, force, system, count = work.v, work.j, work.force, work.system, work.factor.size
    for a in range(n):
        first = LAST * block_of(a, n) - 1
        for k in range(1, POINTS):
            row = system[first + k]
            for b in range(n):
                begin = LAST * block_of(b, n) - 1
                for other in range(1, POINTS):
                    row[begin + other] = -s * INTEGRALS[k, other] * j[other, a, b]
            row[first + k] += 1.0
            right = row[LAST * n : LAST * n + count]
            copy(v[0, a], right)
            for b in range(n):
                share = s * INTEGRALS[k, 0] * j[0, a, b]
                if share != 0.0:
                    add(right, share, v[0, b])
            which = forcing_of(a)
            if which >= 0:
                for other in range(POINTS):
                    add(right, s * INTEGRALS[k, other], force[other, which])


@njit(**INLINED)
def add(row: np.ndarray, share: float, other: np.ndarray) -> None:
    """Add a share of another row, as long: in vector instructions, since no index can be negative."""
    for c in range(row.size):
        row[c] += share * other[c]


@njit(**INNER)
def solve(size: int, work: Variation) -> None:
    """Solve the equations by Gaussian elimination with partial pivoting; most of their elements are zero."""
    apart()
    system = work.system
    wide = size + work.factor.size
    for i in range(size):
        if abs(system[i, i]) < LEAST_PIVOT:
            pivot = i
            for k in range(i + 1, size):
                if abs(system[k, i]) > abs(system[pivot, i]):
                    pivot = k
            for c in range(i, wide):
                system[i, c], system[pivot, c] = system[pivot, c], system[i, c]
        for k in range(i + 1, size):
            if system[k, i] != 0.0:
                add(system[k, i + 1 : wide], -system[k, i] / system[i, i], system[i, i + 1 : wide])
    for i in range(size - 1, -1, -1):
        right = system[i, size:wide]
        for k in range(i + 1, size):
            if system[i, k] != 0.0:
                add(right, -system[i, k], system[k, size:wide])
        share = 1.0 / system[i, i]
        for c in range(right.size):
            right[c] *= share


@njit(**INNER)
def carry_over(work: Variation) -> None:
    """Take the columns to the end of the step that :func:`vary_step` has taken."""
    v = work.v
    for a in range(v.shape[1]):
        for c in range(v.shape[2]):
            v[0, a, c] = v[LAST, a, c]


@njit(**INNER)
def vary_factor(
    m: np.ndarray, d: np.ndarray, columns: Columns, count: int, scale: float, crossed: float, work: Variation
) -> None:
    """Logarithmic derivatives of the stiffness' factor by the columns, where a contact begins.

    ``crossed`` is the speed into the rock, over its size as ``scale`` (0: the moment does not depend on the columns).
    """
    apart()
    v, factor, time = work.v, work.factor, d[TIME]
    turned = d[ROTATION_CONTACT] + m[ROTATION_PHASE]
    around = 1.0 + m[ROTATION_SHARE] * math.cos(turned)
    for c in range(count):
        later = -v[0, W, c] * scale / crossed if scale != 0.0 else 0.0
        swing = -m[ROTATION_SHARE] * math.sin(turned) * m[ROTATION_RATE] * later
        if columns.kind[c] == ON_STIFFNESS:
            swing += sinusoid(columns.which[c], columns.turn[c], time)
        elif columns.kind[c] == ROTATION_SHARE:
            swing += math.cos(turned)
        elif columns.kind[c] == ROTATION_PHASE:
            swing -= m[ROTATION_SHARE] * math.sin(turned)
        elif columns.kind[c] == ROTATION_RATE:
            swing -= m[ROTATION_SHARE] * math.sin(turned) * time
        factor[c] = swing / around
    for law in range(int(m[LAWS])):
        if law_at(m, law, PLACE) == COMPACTION:
            x, length = compaction_argument(m, d), m[COMPACTION_LENGTH]
            value, slope = look_closely(m, d, law, x, work.at)
            for c in range(count):
                change = slope * work.drilled[c] / length if length > 0.0 else 0.0
                if columns.kind[c] == COUNTED:
                    change = slope if length == 0.0 else 0.0
                elif columns.kind[c] == COMPACTION_LENGTH and length > 0.0:
                    change -= slope * x / length
                elif columns.kind[c] == LAW and columns.which[c] == law:
                    row = columns.first[c] + int(work.at[law, AT_PIECE])
                    change += piece_value(columns.pieces, row, work.at[law, AT_T])
                factor[c] += change / (1.0 + value)


@njit(**INNER)
def begin_drilled(first: bool, columns: Columns, work: Variation) -> None:
    """By what columns change what was drilled on this face where a window begins.

    What was drilled in windows before is not followed by their states: by those, it is known.
    """
    for c in range(columns.kind.size):
        if first or columns.kind[c] == STATE:
            work.drilled[c] = 1.0 if columns.kind[c] == DRILLED_BEFORE else 0.0


@njit(**INNER)
def begin_factor(m: np.ndarray, d: np.ndarray, columns: Columns, work: Variation) -> None:
    """The same where a window begins, at a moment that no column moves."""
    for c in range(columns.kind.size):
        work.factor[c] = 0.0
    if int(d[REGIME]) != FREE:
        vary_factor(m, d, columns, columns.kind.size, 0.0, 1.0, work)


@njit(**INNER)
def law_changes(m: np.ndarray, d: np.ndarray, w: float, sign: float, columns: Columns, work: Variation) -> None:
    """Add to ``change`` by what columns change the force of the rock law at the depth w, times ``sign``."""
    apart()
    lin, at = work.lin[0], work.at
    linearise_law(m, d, int(d[REGIME]), w, at, lin)
    for c in range(columns.kind.size):
        kind, more = columns.kind[c], lin[BY_FACTOR] * work.factor[c]
        if kind == KL:
            more += lin[BY_KL]
        elif kind == KU:
            more += lin[BY_KU]
        elif kind == LAW:
            law = columns.which[c]
            if law_at(m, law, PLACE) == int(d[REGIME]) - ON_LOADING:
                row = columns.first[c] + int(at[law, AT_PIECE])
                more += at[law, CHAIN] * piece_value(columns.pieces, row, at[law, AT_T])
        work.change[c] += sign * more


@njit(**INNER)
def saltate(
    m: np.ndarray,
    before: np.ndarray,
    z: np.ndarray,
    slope: np.ndarray,
    d: np.ndarray,
    after: np.ndarray,
    grazing: float,
    columns: Columns,
    work: Variation,
    scratch: np.ndarray,
) -> None:
    """Let the columns jump at an event: from the state (before, z), of rates ``slope``, to (d, after).

    A contact that is approached at no more than ``grazing`` m/s jumps less: one that is grazed comes a little earlier
    or not at all, and what is infinite to first order says nothing of that.
    """
    apart()
    n, count, one, two = int(m[MOVING]), columns.kind.size, int(before[REGIME]), int(d[REGIME])
    v, stretch, guard, normal = work.v, 1.0, False, False
    if m[BY_SLOPE] >= 0.0:
        vary_drive(m, before, d, columns, work)
    for c in range(count):
        work.change[c] = 0.0
    if one != two:
        guard, normal = True, one == FREE or two == FREE
        if not normal and m[TERMS] == 0.0:
            law_changes(m, before, z[W], 1.0, columns, work)
            steep = work.lin[0, LAW_W]
            law_changes(m, d, after[W], -1.0, columns, work)
            # a law that begins without any stiffness has none at the face
            stretch = steep / work.lin[0, LAW_W] if work.lin[0, LAW_W] > 0.0 else 1.0
            for c in range(count):
                work.change[c] = work.change[c] / work.lin[0, LAW_W] if work.lin[0, LAW_W] > 0.0 else 0.0
        elif not normal:
            stretch = law_slope(m, before, one, z[W]) / law_slope(m, d, two, after[W])
    mass = -1
    for i in range(2):
        if m[GRIP1 + i] > 0.0 and before[SLIDE1 + i] != d[SLIDE1 + i] and not guard:
            mass = i
    if not guard and mass < 0:
        return
    high, low = (W, -1) if normal else (V2, UD)
    if not guard:
        high, low = V1 + mass, -1
    crossed = slope[high] - (slope[low] if low >= 0 else 0.0)
    scale = 0.0
    if abs(crossed) > STANDING * max(1.0, abs(slope[V2])):
        scale = crossed * crossed / (crossed * crossed + grazing * grazing) if normal else 1.0
    if one == FREE:
        vary_factor(m, d, columns, count, scale, crossed, work)
    for c in range(count):
        share = (v[0, high, c] - (v[0, low, c] if low >= 0 else 0.0)) * scale
        share = share / crossed if scale != 0.0 else 0.0
        for i in range(n):
            r = stretch if i == W else 1.0
            jump = (scratch[BEGIN_SLOPE, i] - r * slope[i]) * share
            if i == W and guard and not normal:
                # at a turn the origin moves by what the depth is counted less
                work.drilled[c] += v[0, W, c] - (r * v[0, W, c] + jump + work.change[c])
            v[0, i, c] = r * v[0, i, c] + jump
        v[0, W, c] += work.change[c]
    if two == FREE:
        for c in range(count):
            work.factor[c] = 0.0


@njit(**INLINED)
def borrow_columns(columns: Columns) -> Columns:
    """The same, of arrays that nobody counts references to."""
    return Columns(
        borrowed(columns.kind),
        borrowed(columns.which),
        borrowed(columns.first),
        borrowed(columns.turn),
        borrowed(columns.pieces),
    )


@njit(**INLINED)
def borrow_variation(work: Variation) -> Variation:
    """The same, of arrays that nobody counts references to."""
    return Variation(
        borrowed(work.v),
        borrowed(work.j),
        borrowed(work.lin),
        borrowed(work.at),
        borrowed(work.force),
        borrowed(work.factor),
        borrowed(work.change),
        borrowed(work.drilled),
        borrowed(work.driven),
        borrowed(work.late),
        borrowed(work.late_at),
        borrowed(work.by),
        borrowed(work.system),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def run_varied(
    model: Model,
    d: np.ndarray,
    z: np.ndarray,
    seconds: float,
    rtol: float,
    columns: Columns,
    work: Variation,
    scratch: np.ndarray,
) -> tuple[int, float]:
    """Run for ``seconds`` from the state (d, z), which is left at the end, with columns beside it.

    Args:
        model, d, z: The model and the state, of a motion that has begun.
        seconds, rtol: How long, and the relative error of a step.
        columns: By what the motion is differentiated; by states alone where a term from outside acts.
        work: From :func:`make_variation`. The first of its ``v`` are the derivatives of the state, now and at the end.
        scratch: From ``make_scratch``.

    Returns:
        Status and the time reached.
    """
    m, d, z, scratch = borrowed(model.flat), borrowed(d), borrowed(z), borrowed(scratch)
    columns, work = borrow_columns(columns), borrow_variation(work)
    slope, now = np.zeros(z.size), 0.0
    prepare(m, d, z, NO, scratch)
    # a contact that has begun keeps its factor
    for c in range(columns.kind.size):
        work.factor[c] = 0.0
    begin_drilled(YES, columns, work)
    while now < seconds:
        copy(scratch[BEGIN_SLOPE], slope)
        status, taken = advance(m, d, z, seconds - now, rtol, YES, scratch)
        if status != WENT_ON:
            return status, now
        if taken > 0.0:
            vary_step(m, taken, columns, work, scratch)
            carry_over(work)
            # the end of the step, before the reset map
            copy(scratch[STAGES], slope)
            saltate(m, scratch[BEGIN_D], scratch[END], slope, d, z, 0.0, columns, work, scratch)
        else:
            saltate(m, scratch[BEGIN_D], scratch[BEGIN], slope, d, z, 0.0, columns, work, scratch)
        now = seconds if taken >= seconds - now else now + taken
    return WENT_ON, now
