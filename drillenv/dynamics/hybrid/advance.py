"""Going on with a motion: to the next event or the end asked for, and no further than one step of the integrator.

Whoever calls owns the loop: it reads samples off the step just taken (:func:`read_state`), counts what has happened,
may change the rock or the setting, and calls again. A motion is the model, the discrete state d and the state z, and
nothing else: copied, it goes on bit for bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import INNER, NO, YES, apart, copy
from drillenv.dynamics.constitutive.places import WAVEFORM
from drillenv.dynamics.flow import FREE
from drillenv.dynamics.flow import LOADING as ON_LOADING
from drillenv.dynamics.flow import UNLOADING as ON_UNLOADING
from drillenv.dynamics.hybrid.events import (
    CORNER,
    CUTTING,
    LANDING,
    NO_FORCE,
    NOTHING,
    RELEASE,
    STOPPING,
    TURNING,
    change_contact,
    find_event,
    go_to,
    highest_force,
    set_corners,
    settle_grips,
    stand_on_face,
    standing_switch,
    start_sliding,
    turn_bristles,
)
from drillenv.dynamics.hybrid.runge_kutta import (
    BEGIN,
    BEGIN_D,
    BEGIN_SLOPE,
    END,
    FLAGS,
    LENGTH,
    PUSH,
    READY,
    SPARE,
    SPARE_SLOPE,
    STAGES,
    STANDING,
    TOLERANCE,
    follow,
    inside,
    inside_with_rate,
    step,
    step_error,
)
from drillenv.dynamics.hybrid.slew_rate import drive_on, follow_or_ramp
from drillenv.dynamics.hybrid.vector_field import (
    BRISTLES1,
    BY_SLOPE,
    CORNER_COUNT,
    CUT,
    F_A,
    F_B,
    FIRST_CORNER,
    GRIP1,
    IMPACT_DEPTH,
    LAWS,
    LONGEST,
    OMEGA,
    PEAK,
    PLACE,
    PULLS,
    RATED,
    REGIME,
    ROTATION,
    ROTATION_RATE,
    SLEWING_LEFT,
    SLIDE1,
    SLIDE2,
    TALLY,
    THETA,
    THETA_CARRY,
    TIME,
    TRUST,
    TURN,
    TURNS,
    V2,
    VIBRATION,
    VIBRATION_RATE,
    WHERE,
    WHOLE,
    W,
    below_of,
    corner_at,
    law_at,
    rates,
    set_below,
)

WENT_ON, STEPS_TOO_SHORT, SWITCHES_TOO_DENSE = range(3)
"""How a call ends: well, or the motion cannot be followed."""
MOST_STANDING = 12
"""Events at one time; more is a motion that cannot leave a guard."""
SHORT = 0.25
"""Share of the longest step that is taken while a mass sticks: the force that holds it is followed by cubics only."""
AT_ONCE = 1e-15
"""An event this share of the longest step away is now."""


@njit(**INNER)
def pass_time(m: np.ndarray, d: np.ndarray, s: float) -> None:
    """Let phases and time go on by s."""
    d[TIME] += s
    owed = m[OMEGA] * s + d[THETA_CARRY]
    theta = d[THETA] + owed
    d[THETA_CARRY] = owed - (theta - d[THETA])
    d[THETA] = theta
    while d[THETA] >= TURN:
        d[THETA] -= TURN
        d[TURNS] += 1.0
    d[ROTATION] += m[ROTATION_RATE] * s
    d[VIBRATION] += m[VIBRATION_RATE] * s
    if m[BY_SLOPE] >= 0.0:
        drive_on(m, d, s)


@njit(**INNER)
def to_drive_change(m: np.ndarray, d: np.ndarray) -> float:
    """Seconds until the drive's waveform comes to its next corner, or its force begins or ends to ramp."""
    ahead = to_phase_corner(m, d)
    return min(ahead, max(d[SLEWING_LEFT], 0.0)) if m[BY_SLOPE] >= 0.0 else ahead


@njit(**INNER)
def to_phase_corner(m: np.ndarray, d: np.ndarray) -> float:
    """Seconds until the waveform of the drive comes to its next corner, the end of a turn included."""
    ahead = math.inf
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == WAVEFORM and law_at(m, i, CORNER_COUNT) > 0:
            below, at = below_of(d, i), TURN
            if below < law_at(m, i, CORNER_COUNT):
                at = corner_at(m, law_at(m, i, FIRST_CORNER) + below, WHERE)
            ahead = min(ahead, max((at - d[THETA]) / m[OMEGA], 0.0))
    return ahead


@njit(**INNER)
def pass_phase_corner(m: np.ndarray, d: np.ndarray) -> None:
    """Go into the next part of each waveform that has come to a corner."""
    apart()
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == WAVEFORM and law_at(m, i, CORNER_COUNT) > 0:
            first, below = law_at(m, i, FIRST_CORNER), below_of(d, i)
            if below < law_at(m, i, CORNER_COUNT):
                at = corner_at(m, first + below, WHERE)
                if at <= d[THETA] + 1e-12:
                    # rounding may have left it just before
                    set_below(m, d, i, below + 1)
                    d[THETA] = max(d[THETA], at)
            elif d[THETA] < corner_at(m, first, WHERE) or d[THETA] > TURN - 1e-12:
                set_below(m, d, i, 0)
                if d[THETA] > 1.0:
                    # rounding has left it just before the end of the turn
                    d[THETA] = 0.0
                    d[TURNS] += 1.0


@njit(**INNER)
def set_cut(m: np.ndarray, d: np.ndarray, z: np.ndarray, scratch: np.ndarray) -> None:
    """Say whether the rock would pull at the state z."""
    d[CUT] = 0.0
    if int(d[REGIME]) != FREE and m[PULLS] > 0.0:
        rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
        d[CUT] = 1.0 if scratch[PUSH, WHOLE] < -NO_FORCE * (m[F_A] + m[F_B]) else 0.0


@njit(**INNER)
def prepare(m: np.ndarray, d: np.ndarray, z: np.ndarray, begins: bool, scratch: np.ndarray) -> float:
    """Before the first :func:`advance`, and after the model has changed. Returns the force of the rock in N.

    ``begins`` where the motion does, so that how masses slide follows from their speeds.
    """
    apart()
    scratch[FLAGS, STANDING] = 0.0
    rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
    set_corners(m, d, z, scratch[BEGIN_SLOPE], NO)
    if m[BY_SLOPE] >= 0.0:
        follow_or_ramp(m, d)
    set_cut(m, d, z, scratch)
    if begins:
        start_sliding(m, d, z, scratch)
    return rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])


@njit(**INNER)
def enter(m: np.ndarray, d: np.ndarray, z: np.ndarray, after: int, scratch: np.ndarray) -> None:
    """Change the regime of the contact; the slope at the state has to be found anew."""
    apart()
    if int(d[REGIME]) == ON_LOADING and after == ON_UNLOADING:
        stand_on_face(m, d, z)
        rock = rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
        d[PEAK], d[IMPACT_DEPTH] = max(d[PEAK], rock), z[W]
    else:
        d[PEAK] = 0.0
    change_contact(m, d, after, z)
    if m[LAWS] > 0.0 or m[PULLS] > 0.0:
        rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
        set_corners(m, d, z, scratch[BEGIN_SLOPE], YES)
        set_cut(m, d, z, scratch)


@njit(**INNER)
def let_through(m: np.ndarray, d: np.ndarray, z: np.ndarray, code: int, scratch: np.ndarray) -> None:
    """Apply the reset map of an event at the state z; ``BEGIN_SLOPE`` is then the slope behind it."""
    apart()
    before, after, mass = int(d[REGIME]), -1, -1
    if code >= CORNER:
        law = (code - CORNER) // 2
        set_below(m, d, law, below_of(d, law) + (1 if (code - CORNER) % 2 == 0 else -1))
    elif code == CUTTING:
        d[CUT] = 1.0 - d[CUT]
    elif code >= STOPPING:
        mass = (code - STOPPING) % 2
        if m[BRISTLES1 + mass] > 0.0:
            turn_bristles(m, d, z, mass, scratch)
    elif code in (LANDING, RELEASE):
        after, z[W] = (ON_LOADING if code == LANDING else FREE), 0.0
    else:
        after = ON_UNLOADING if code == TURNING else ON_LOADING
        stand_on_face(m, d, z)
        if z[V2] == 0.0 and m[GRIP1 + 1] > 0.0 and d[SLIDE2] != 0.0:
            # whether a stop is a turn, friction has to say first
            after, mass = -1, 1
    if (mass >= 0 or after >= 0) and (m[GRIP1] > 0.0 or m[GRIP1 + 1] > 0.0):
        settle_grips(m, d, z, mass, scratch)
    if after >= 0 and after != before:
        enter(m, d, z, after, scratch)
    rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])


@njit(**INNER)
def try_step(m: np.ndarray, d: np.ndarray, left: float, rtol: float, scratch: np.ndarray) -> float:
    """Take one step of at most ``left`` s that is good to ``rtol``. Returns its length, 0 where none is good."""
    apart()
    regime, most = int(d[REGIME]), min(left, max(to_drive_change(m, d), 1e-14))
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0 and d[SLIDE1 + mass] == 0.0:
            most = min(most, SHORT * m[LONGEST])
    copy(scratch[BEGIN_SLOPE], scratch[0])
    while True:
        h = min(d[TRUST + regime], most)
        step(m, d, h, scratch)
        error = step_error(m, h, rtol, scratch)
        factor = 0.9 / math.sqrt(math.sqrt(math.sqrt(max(error, 1e-10)))) if error < 1e10 else 0.2
        factor = min(6.0, max(0.2, factor))
        if error <= 1.0:
            if h == d[TRUST + regime] or factor < 1.0:
                d[TRUST + regime] = min(h * factor, m[LONGEST])
            return h
        d[TRUST + regime] = h * min(factor, 0.9)
        if not d[TRUST + regime] > 1e-11 * m[LONGEST]:
            return 0.0


@njit(**INNER)
def advance(m: np.ndarray, d: np.ndarray, z: np.ndarray, left: float, rtol: float, exact: bool,
            scratch: np.ndarray):  # fmt: skip
    """Go on by one step, to the next event in it or to ``left`` s from now.

    The state's slope stands in row ``BEGIN_SLOPE`` of ``scratch``, before (see :func:`prepare`) and after. What the
    regime of the contact is before and after says whether it has changed, at the time returned.

    Returns:
        How it ended, and the time taken in s, which is 0 where the regime has changed at once.
    """
    apart()
    copy(d, scratch[BEGIN_D])
    copy(z, scratch[BEGIN])
    scratch[FLAGS, READY], scratch[FLAGS, LENGTH] = 0.0, 0.0
    scratch[FLAGS, TOLERANCE] = rtol
    scratch[FLAGS, STANDING] += 1.0
    if scratch[FLAGS, STANDING] > MOST_STANDING:
        return SWITCHES_TOO_DENSE, 0.0
    after = standing_switch(d, z, scratch[BEGIN_SLOPE])
    if after != int(d[REGIME]):
        enter(m, d, z, after, scratch)
        rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
        return WENT_ON, 0.0
    if left <= 0.0:
        return WENT_ON, 0.0
    h = try_step(m, d, left, rtol, scratch)
    if h == 0.0:
        return STEPS_TOO_SHORT, 0.0
    s, code, ready = find_event(m, d, h, NO, scratch)
    scratch[FLAGS, LENGTH] = h
    if code != NOTHING and s <= AT_ONCE * m[LONGEST]:
        let_through(m, d, z, code, scratch)
        return WENT_ON, 0.0
    if m[RATED] > 0.0 and int(d[REGIME]) == ON_LOADING:
        most, ready = highest_force(m, d, h, s, ready, scratch)
        d[PEAK] = max(d[PEAK], most)
    if code != NOTHING:
        s, ready = go_to(m, d, code, h, s, ready, exact, scratch)
        if exact:
            scratch[FLAGS, LENGTH] = s
    scratch[FLAGS, READY], scratch[FLAGS, STANDING] = (1.0 if ready else 0.0), 0.0
    at_phase_corner = s >= to_phase_corner(m, d)
    at_slope_change = m[BY_SLOPE] >= 0.0 and s >= d[SLEWING_LEFT]
    copy(scratch[END], z)
    pass_time(m, d, s)
    if at_phase_corner:
        pass_phase_corner(m, d)
    if at_slope_change:
        follow_or_ramp(m, d)
    if code != NOTHING:
        let_through(m, d, z, code, scratch)
    elif at_phase_corner or at_slope_change:
        rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
    else:
        copy(scratch[STAGES], scratch[BEGIN_SLOPE])
    return WENT_ON, s


@njit(**INNER)
def ensure_dense_output(m: np.ndarray, scratch: np.ndarray) -> None:
    """Prepare what is read off the step just taken, where it has not been."""
    if scratch[FLAGS, READY] == 0.0:
        follow(m, scratch[BEGIN_D], scratch[FLAGS, LENGTH], scratch)
        scratch[FLAGS, READY] = 1.0


@njit(**INNER)
def read_state(m: np.ndarray, s: float, exact: bool, scratch: np.ndarray) -> float:
    """The state a time s into the step just taken, to row ``SPARE``, its slope to ``SPARE_SLOPE``.

    Row ``BEGIN_D`` is the discrete state there, as it was when the step began. Returns the force of the rock in N.
    """
    apart()
    d, length = scratch[BEGIN_D], scratch[FLAGS, LENGTH]
    if exact:
        rock = step(m, d, s, scratch)
        copy(scratch[END], scratch[SPARE])
        copy(scratch[STAGES], scratch[SPARE_SLOPE])
        return rock
    ensure_dense_output(m, scratch)
    inside(int(m[TALLY]), s / length, scratch, SPARE)
    return rates(m, d, s, scratch[SPARE], scratch[SPARE_SLOPE], scratch[PUSH])


@njit(**INNER)
def read_speed(m: np.ndarray, s: float, scratch: np.ndarray) -> tuple[float, float]:
    """The indenter's speed a time s into the step just taken and its acceleration, by the step's polynomial alone.

    The acceleration is then of an order less, at half the cost of :func:`read_state`.
    """
    ensure_dense_output(m, scratch)
    return inside_with_rate(V2, s / scratch[FLAGS, LENGTH], scratch[FLAGS, LENGTH], scratch)
