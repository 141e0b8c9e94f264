"""P-1-I-1 at single settings, and along the line between two settings.

P-1-I-1 is the orbit of one excitation period with one impact (a force peak) in one contact. Its point on the section
is counted here as if the section were crossed while loading, wherever it is crossed: so the orbit stays one curve where
a changing setting carries it through the section in contact.

A setting is a drive: (omega in rad/s, F_a in N, F_b in N). Between two settings that differ in one control alone all
three are linear in that control (Eq. 3.5 and 3.6).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import KERNEL
from drillenv.dynamics.exact import (
    STATE_SIZE,
    TURN,
    V1,
    V2,
    W,
    Y,
    fresh_state,
    set_phase,
)
from drillenv.dynamics.flow import FREE, LOADING, OMEGA, STATIC, STIFFNESS, K, set_drive
from drillenv.dynamics.orbits import (
    M_CONTACTS,
    M_IMPACTS,
    MOTION_SIZE,
    PERIOD,
    SECTION,
    SECTION_REGIME,
    STABLE,
    contracts,
    describe,
    find_motion,
    find_orbit,
    length_scale,
    section_distance,
)

WAIT, PATIENCE = 200, 4000
"""Periods a start runs before its motion is looked for, and after which it is given up (see find_motion)."""

DRAWS = 5
"""Numbers in [0, 1) that make a random start."""

# What an orbit looked for at a setting turns out to be.
IS_P11, NO_ORBIT, UNSTABLE, ANOTHER_LABEL, JUMPED = range(5)

JUMP = 1e-3
"""An orbit this far (in length scales, see section_distance) from the one followed, a step of 1e-6 on, is another one:
beyond a fold Newton's method may still find one that lies near."""


@njit(**KERNEL)
def random_start(model: np.ndarray, draw: np.ndarray, state: np.ndarray) -> None:
    """The rig off the rock, anywhere in a box around its motions, from ``draw`` (DRAWS,) in [0, 1).

    Any phase; the spring's shortening up to twice its static one; the indenter's speed within 2 and the shaker's within
    0.2 of F_a / (m2 omega); the gap up to 4 F_a / (m2 omega^2).
    """
    length = length_scale(model)
    speed = length * model[0, OMEGA]
    state[:] = 0.0
    set_phase(TURN * draw[0], state)
    state[Y] = 2.0 * draw[1] * model[0, STATIC] / model[0, K]
    state[V1] = 0.2 * speed * (2.0 * draw[2] - 1.0)
    state[V2] = 2.0 * speed * (2.0 * draw[3] - 1.0)
    state[W] = -4.0 * length * draw[4]


@njit(**KERNEL)
def as_loading(model: np.ndarray, point: np.ndarray, regime: int) -> None:
    """Count w of a point of the section, so far counted in ``regime``, in the regime of loading."""
    if point[3] > 0.0 and regime != FREE and regime != LOADING:
        point[3] *= model[regime, STIFFNESS] / model[LOADING, STIFFNESS]


@njit(**KERNEL)
def is_p11(motion: np.ndarray) -> bool:
    """Whether a motion as find_motion or describe writes it is P-1-I-1."""
    return motion[PERIOD] == 1.0 and motion[M_IMPACTS] == 1.0 and motion[M_CONTACTS] == 1.0


@njit(**KERNEL)
def p11_at(model: np.ndarray, point: np.ndarray, tangent: np.ndarray, motion: np.ndarray) -> int:
    """Polish ``point`` into an orbit of one period and say what it is; it is left as it was where there is NO_ORBIT."""
    if not find_orbit(model, point, LOADING, 1, tangent):
        return NO_ORBIT
    describe(model, point, LOADING, 1, motion)
    if not is_p11(motion):
        return ANOTHER_LABEL
    return IS_P11 if contracts(tangent) else UNSTABLE


@njit(**KERNEL)
def settle_from(
    model: np.ndarray, state: np.ndarray, motion: np.ndarray, tangent: np.ndarray, point: np.ndarray
) -> bool:
    """Whether a start settles on P-1-I-1: if so its point, counted as loading, and its monodromy matrix are written."""
    find_motion(model, state, WAIT, PATIENCE, motion, tangent)
    if motion[STABLE] != 1.0 or not is_p11(motion):
        return False
    trial = motion[SECTION : SECTION + 4].copy()
    as_loading(model, trial, int(motion[SECTION_REGIME]))
    if p11_at(model, trial, tangent, motion) != IS_P11:
        return False
    point[:] = trial
    return True


@njit(**KERNEL)
def settle_points(
    plant: np.ndarray,
    drives: np.ndarray,
    draws: np.ndarray,
    labels: np.ndarray,
    hits: np.ndarray,
    points: np.ndarray,
    tangents: np.ndarray,
    motions: np.ndarray,
) -> None:
    """Try a fresh and random starts at each of n settings.

    Args:
        plant: MODEL_SHAPE, the rig on the rock.
        drives: (n, 3).
        draws: (n, starts, DRAWS).
        labels: (n, 2) out: period and impacts of the motion from the fresh start, 0 where it is not periodic.
        hits: (n,) out: how many of the 1 + starts settle on P-1-I-1.
        points: (n, 4) out: the orbit that the first of them settles on.
        tangents: (n, 4, 4) out: its monodromy matrix.
        motions: (n, MOTION_SIZE) out: its description.
    """
    model, state = plant.copy(), np.zeros(STATE_SIZE)
    motion, tangent, point = np.zeros(MOTION_SIZE), np.zeros((4, 4)), np.zeros(4)
    for i in range(drives.shape[0]):
        set_drive(drives[i, 0], drives[i, 1], drives[i, 2], model)
        hits[i] = 0
        for start in range(draws.shape[1] + 1):
            motion[:] = 0.0
            if start == 0:
                fresh_state(model, 0.0, state)
            else:
                random_start(model, draws[i, start - 1], state)
            settled = settle_from(model, state, motion, tangent, point)
            if start == 0:
                labels[i, 0], labels[i, 1] = 0, 0
                if motion[PERIOD] > 0.0:
                    labels[i, 0], labels[i, 1] = int(motion[PERIOD]), int(motion[M_IMPACTS])
            if settled:
                if hits[i] == 0:
                    points[i], tangents[i], motions[i] = point, tangent, motion
                hits[i] += 1


@njit(**KERNEL)
def set_between(model: np.ndarray, here: np.ndarray, there: np.ndarray, share: float) -> None:
    """Put the model at the setting a ``share`` of the way from one drive to another."""
    set_drive(
        here[0] + share * (there[0] - here[0]),
        here[1] + share * (there[1] - here[1]),
        here[2] + share * (there[2] - here[2]),
        model,
    )


@njit(**KERNEL)
def follow(
    model: np.ndarray,
    here: np.ndarray,
    there: np.ndarray,
    precision: float,
    point: np.ndarray,
    tangent: np.ndarray,
    motion: np.ndarray,
) -> tuple[float, float, int, float, float]:
    """Follow P-1-I-1 from the setting ``here``, where ``point`` is on it, towards ``there``.

    Steps are doubled where the orbit is found and halved where it is not, down to ``precision``; each starts Newton's
    method on the straight line through the last two orbits.

    Returns:
        The share of the way on which the orbit is P-1-I-1, the length of the first step beyond it that fails, what that
        step comes upon (IS_P11 where the whole way is covered), and how many impacts and contacts that has (0 where it
        is not the orbit followed). ``point``, ``tangent`` and ``motion`` are then those of the last orbit.
    """
    trial, behind = np.zeros(4), np.zeros(4)
    trial_tangent, trial_motion = np.zeros((4, 4)), np.zeros(MOTION_SIZE)
    share, last_share, step = 0.0, -1.0, 1.0
    while True:
        step = min(step, 1.0 - share)
        ahead = share + step
        set_between(model, here, there, ahead)
        trial[:] = point
        if last_share >= 0.0:
            trial += (point - behind) * ((ahead - share) / (share - last_share))
        status = p11_at(model, trial, trial_tangent, trial_motion)
        if status == IS_P11:
            behind[:] = point
            last_share = share
            point[:], tangent[:], motion[:] = trial, trial_tangent, trial_motion
            share = ahead
            if share >= 1.0:
                return share, 0.0, IS_P11, 1.0, 1.0
            step *= 2.0
        elif step <= precision:
            if status != NO_ORBIT and section_distance(model, trial, point) > JUMP:
                status = JUMPED
            if status in (NO_ORBIT, JUMPED):
                return share, step, status, 0.0, 0.0
            return share, step, status, trial_motion[M_IMPACTS], trial_motion[M_CONTACTS]
        else:
            step *= 0.5


@njit(**KERNEL)
def follow_edges(
    plants: np.ndarray,
    rocks: np.ndarray,
    here: np.ndarray,
    there: np.ndarray,
    precision: np.ndarray,
    points: np.ndarray,
    tangents: np.ndarray,
    motions: np.ndarray,
    ends: np.ndarray,
) -> None:
    """Follow P-1-I-1 along n edges between neighbouring settings.

    Args:
        plants: (rocks, *MODEL_SHAPE), the rig on each rock.
        rocks: (n,) which of them.
        here, there: (n, 3) the drives at both ends.
        precision: (n,) shortest step, as a share of the edge.
        points: (n, 4) in: the orbit at ``here``; out: the last one on the way.
        tangents: (n, 4, 4) out: its monodromy matrix.
        motions: (n, MOTION_SIZE) out: its description.
        ends: (n, 5) out: what follow returns.
    """
    model = plants[0].copy()
    for i in range(rocks.size):
        model[:] = plants[rocks[i]]
        tangents[i] = np.nan
        share, step, status, impacts, contacts = follow(
            model, here[i], there[i], precision[i], points[i], tangents[i], motions[i]
        )
        ends[i, 0], ends[i, 1], ends[i, 2], ends[i, 3], ends[i, 4] = share, step, status, impacts, contacts
