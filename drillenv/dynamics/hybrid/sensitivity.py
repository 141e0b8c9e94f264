"""How a motion changes with the state that it starts from: variational equations, and saltation at events.

Along a step the variational equations S' = J S are taken by the same Runge-Kutta pair as the motion, with the Jacobian
at its stages, so that what comes out is the derivative of the step itself. Where an event ends a step they jump:

    S+ = R S + (f+ - R f-) (grad g . S) / (grad g . f-)

with g the guard, R the derivative of the reset map, f- and f+ the rates before and behind it (M. di Bernardo et al.,
Piecewise-smooth Dynamical Systems, Springer, 2008, Section 2.5). That the stiffness of a turning rock goes with the
moment of landing is not varied.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.constitutive.places import (
    DAMPER,
    GUIDE,
    INDENTER,
    MOUNT_DAMPER,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
)
from drillenv.dynamics.flow import FREE
from drillenv.dynamics.flow import LOADING as ON_LOADING
from drillenv.dynamics.hybrid.advance import WENT_ON, advance, prepare
from drillenv.dynamics.hybrid.compiled import INNER, NO, YES, apart
from drillenv.dynamics.hybrid.model import Model
from drillenv.dynamics.hybrid.runge_kutta import (
    BEGIN,
    BEGIN_D,
    BEGIN_SLOPE,
    END,
    FIRST_SLOPE,
    INNER_STATE,
    NODES,
    PUSH,
    SPARE,
    SPARE_SLOPE,
    STAGES,
    add_up,
    copy,
)
from drillenv.dynamics.hybrid.vector_field import (
    AIR_RATE,
    AIR_STIFFNESS,
    CUT,
    GRIP1,
    LAWS,
    M1,
    M2,
    MOUNT_DAMPING,
    MOUNT_GAIN,
    MOUNT_SQUARE,
    OMEGA,
    PLACE,
    REGIME,
    SIZES_AT,
    SLIDE1,
    TALLY,
    TERMS,
    THETA,
    UD,
    V1,
    V2,
    C,
    K,
    Q,
    U,
    W,
    Y,
    argument,
    law_at,
    law_force,
    look,
    rates,
    shape_argument,
    shape_scale,
    stiffness,
)

DIFFERENCE = 1e-6
"""Share of a state's size for differences, where a term from outside acts."""
STANDING = 1e-12
"""A guard that is approached at less than this share of its usual rate is not crossed."""
VARIED = 19
"""Rows of a column: its slopes at the stages, and its states, numbered as in ``scratch``."""


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
def jacobian(m: np.ndarray, d: np.ndarray, shift: float, z: np.ndarray, j: np.ndarray, scratch: np.ndarray):
    """Write the derivative of the rates by the dynamic states into j (n, n)."""
    apart()
    n, regime = int(m[TALLY]), int(d[REGIME])
    if m[TERMS] > 0.0:
        jacobian_by_differences(m, d, shift, z, j, scratch)
        return
    for a in range(n):
        for b in range(n):
            j[a, b] = 0.0
    theta, law, law_w = d[THETA] + m[OMEGA] * shift, law_force(m, d, regime, z[W]), 0.0
    if regime != FREE:
        law_w = law_slope(m, d, regime, z[W])
    factor, factor_v, extra_v, stiff, damped = 1.0, 0.0, 0.0, m[K], m[C]
    held1, held2, mount_u, mount_v = 0.0, 0.0, 0.0, 0.0
    for i in range(int(m[LAWS])):
        place = law_at(m, i, PLACE)
        if place <= UNLOADING or (regime == FREE and place <= RATE_FORCE):
            continue
        value, slope = look(m, d, i, argument(m, d, i, z, theta))
        if place == RATE_FACTOR:
            factor += value
            factor_v += slope
        elif place == RATE_FORCE:
            extra_v += slope
        elif place in (SPRING, SPRING_FROM_REST):
            stiff += slope
        elif place == DAMPER:
            damped += slope
        elif place == GUIDE:
            held1 += slope
        elif place == INDENTER:
            held2 += slope
        elif place == MOUNT_SPRING:
            mount_u += slope
        elif place == MOUNT_DAMPER:
            mount_v += slope
    rock_w, rock_v = law_w * factor, law * factor_v + extra_v
    if regime == FREE or d[CUT] != 0.0:
        rock_w, rock_v = 0.0, 0.0
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
    j[UD, U], j[UD, UD] = -m[MOUNT_SQUARE] - mount_u, -m[MOUNT_DAMPING] - mount_v - m[MOUNT_GAIN] * rock_v
    j[UD, W], j[UD, V2] = m[MOUNT_GAIN] * rock_w, m[MOUNT_GAIN] * rock_v
    j[Q, V1], j[Q, Q] = m[AIR_STIFFNESS], -m[AIR_RATE]


@njit(**INNER)
def jacobian_by_differences(m, d, shift, z, j, scratch):
    """The same by central differences, for what a term from outside does."""
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
def vary_step(m: np.ndarray, h: float, j: np.ndarray, columns: np.ndarray, scratch: np.ndarray):
    """Take the columns (columns, VARIED, n) over the step just taken: from their row ``BEGIN`` to the same.

    The slopes of the step are still in ``scratch``, and the discrete state of its beginning.
    """
    apart()
    n, d = int(m[TALLY]), scratch[BEGIN_D]
    for stage in range(STAGES):
        if stage == 0:
            copy(scratch[BEGIN], scratch[INNER_STATE])
        else:
            add_up(stage, h, FIRST_SLOPE, n, INNER_STATE, scratch)
        jacobian(m, d, h * NODES[stage], scratch[INNER_STATE], j, scratch)
        for c in range(columns.shape[0]):
            own = columns[c]
            state = BEGIN if stage == 0 else INNER_STATE
            if stage > 0:
                add_up(stage, h, FIRST_SLOPE, n, INNER_STATE, own)
            for a in range(n):
                total = 0.0
                for b in range(n):
                    total += j[a, b] * own[state, b]
                own[stage, a] = total
    for c in range(columns.shape[0]):
        add_up(STAGES, h, FIRST_SLOPE, n, END, columns[c])
        copy(columns[c, END], columns[c, BEGIN])


@njit(**INNER)
def saltate(m, before, z, slope, d, after, columns, scratch):
    """Let the columns jump at an event: from the state (before, z), of rates ``slope``, to (d, after)."""
    apart()
    n, one, two = int(m[TALLY]), int(before[REGIME]), int(d[REGIME])
    stretch, guard, normal = 1.0, False, False
    if one != two:
        guard, normal = True, one == FREE or two == FREE
        if not normal:
            stretch = law_slope(m, before, one, z[W]) / law_slope(m, d, two, after[W])
    mass = -1
    for i in range(2):
        if m[GRIP1 + i] > 0.0 and before[SLIDE1 + i] != d[SLIDE1 + i] and not guard:
            mass = i
    if not guard and mass < 0:
        return
    crossed = _across(slope, normal, guard, mass)
    if abs(crossed) > STANDING * max(1.0, abs(slope[V2])):
        for c in range(columns.shape[0]):
            own = columns[c, BEGIN]
            share = _across(own, normal, guard, mass) / crossed
            for i in range(n):
                r = stretch if i == W else 1.0
                own[i] = r * own[i] + (scratch[BEGIN_SLOPE, i] - r * slope[i]) * share


@njit(**INNER)
def _across(x, normal: bool, guard: bool, mass: int) -> float:
    """What of a vector lies across the guard: of the contact, of its turn, or of a mass that stops."""
    if not guard:
        return x[V1 + mass]
    return x[W] if normal else x[V2] - x[UD]


@njit(cache=True, nogil=True, error_model="numpy")
def run_varied(model: Model, d, z, seconds: float, rtol: float, columns, scratch):
    """Run for ``seconds`` from the state (d, z), which is left at the end, with columns beside it.

    Args:
        model, d, z: The model and the state, of a motion that has begun.
        seconds, rtol: How long, and the relative error of a step.
        columns: (columns, VARIED, tally) derivatives of the state in their rows ``BEGIN``, and there at the end.
        scratch: From ``make_scratch``.

    Returns:
        Status and the time reached.
    """
    m = borrowed(model.flat)
    d, z, scratch, columns = borrowed(d), borrowed(z), borrowed(scratch), borrowed(columns)
    j, slope, now = np.zeros((int(m[TALLY]), int(m[TALLY]))), np.zeros(z.size), 0.0
    prepare(m, d, z, NO, scratch)
    while now < seconds:
        copy(scratch[BEGIN_SLOPE], slope)
        status, taken = advance(m, d, z, seconds - now, rtol, YES, scratch)
        if status != WENT_ON:
            return status, now
        if taken > 0.0:
            vary_step(m, taken, j, columns, scratch)
            # the end of the step, before the reset map
            copy(scratch[STAGES], slope)
            saltate(m, scratch[BEGIN_D], scratch[END], slope, d, z, columns, scratch)
        else:
            saltate(m, scratch[BEGIN_D], scratch[BEGIN], slope, d, z, columns, scratch)
        now = seconds if taken >= seconds - now else now + taken
    return WENT_ON, now
