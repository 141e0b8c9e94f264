"""Guards and reset maps: where a step ends, and what happens there.

A guard is a function of the state that is negative in the present regime and rises through zero where it ends: of the
contact, of a mass that slides or sticks, of a law at a corner. A trial step is taken without regard to guards. One
whose cubic (the quintic, for the landing) through values and slopes at both ends stays clear of zero by its Bernstein
coefficients is passed over; the others are searched on the polynomial inside the step, also for maxima that only just
reach zero. The first crossing ends the step. In an exact run the step is then taken again with that length and
corrected by Newton's method, so that the state at an event has the full order; otherwise it is read off the polynomial.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import INNER, MERGED, NO, YES, apart, constants
from drillenv.dynamics.constitutive.places import COMPACTION, RATE_FORCE, UNLOADING, WAVEFORM
from drillenv.dynamics.flow import FREE
from drillenv.dynamics.flow import LOADING as ON_LOADING
from drillenv.dynamics.flow import UNLOADING as ON_UNLOADING
from drillenv.dynamics.hybrid.runge_kutta import (
    BEGIN,
    BEGIN_SLOPE,
    END,
    FIRST_SLOPE,
    FLAGS,
    PUSH,
    SPARE,
    SPARE_SLOPE,
    STAGES,
    TOLERANCE,
    follow,
    inside,
    inside_one,
    step,
)
from drillenv.dynamics.hybrid.vector_field import (
    BRISTLES1,
    CARRY,
    CORNER_COUNT,
    COUNT,
    COUNT_CONTACT,
    CUT,
    DRILLED,
    DRILLED_CONTACT,
    EFFECTS,
    F_A,
    F_B,
    FACTOR,
    FIRST_CORNER,
    GRIP1,
    LAWS,
    LONGEST,
    M1,
    MOVING,
    OMEGA,
    ORIGIN,
    PLACE,
    PULLS,
    PUSHED,
    REGIME,
    ROTATION,
    ROTATION_CONTACT,
    ROTATION_PHASE,
    ROTATION_SHARE,
    SIZES_AT,
    SLIDE1,
    SLIDE2,
    TALLY,
    THETA,
    UD,
    V1,
    V2,
    WHERE,
    WHOLE,
    U,
    W,
    argument,
    argument_rate,
    argument_size,
    below_of,
    compaction_argument,
    corner_at,
    corners_below,
    law_at,
    law_depth,
    law_force,
    rates,
    set_below,
    value_at,
)

# Guards: of the contact, of the speed of a mass that slides, of the force that a stick has to hold (upward and
# downward; the second mass's stand one on), of the rock's force where it would begin to pull, and of law n at its next
# corner upward (CORNER + 2 n) and downward
LANDING, TURNING, RETURNING, RELEASE, STOPPING, BREAKING_UP, BREAKING_DOWN, CUTTING, CORNER = constants(
    0, 1, 2, 3, 4, 6, 8, 10, 11
)
NOTHING = -1

AT_REST = 1e-12
"""Share of its usual size within which an argument that stands at a corner does not leave it."""
NO_FORCE = 1e-9
"""Share of the rig's forces below which that of the rock is none."""
(NEITHER,) = constants(-1)
"""Of the masses."""
PARTS = 8
"""Into how many parts a step is cut when it is searched."""
DOUBT = 1e-3
"""How near to zero, over its own size, a guard's polynomial may come without a search."""
SLACK = 1e-10
"""A sticking mass breaks away this share of the rig's forces above the limit, so that it then moves the right way by
more than rounding. A force that goes through the limit gets there some 1e-12 s later."""
ON_IT, ON_CORNER = 1e-13, 1e-9
"""A guard this small over its size on the step is zero at the step's beginning; states are put on all guards but those
of corners."""
DELTA = 1e-6
"""Share of the longest step for differences that give the rate of a force."""
NEAR = 1e-13
"""Share of a step within which the root of a guard is found on the polynomial inside the step: well below SLACK."""
PEAK_NEAR = 1e-6
"""Share of a step within which a maximum is found; its value then is good to the square of that."""
HALVINGS = 40
"""Of a time, at most, in search of where a guard that begins at zero without speed is below it."""
GOLDEN = 0.6180339887498949


@njit(**INNER)
def breakaway(m: np.ndarray, mass: int) -> float:
    """The force in N above which a mass that dry friction holds breaks away."""
    limit = m[GRIP1 + mass]
    return limit + SLACK * (limit + m[F_A] + m[F_B])


@njit(**INNER)
def guard(m: np.ndarray, d: np.ndarray, code: int, shift: float, row: int, scratch: np.ndarray) -> float:
    """A guard at the state in a row, ``shift`` s after the discrete state."""
    apart()
    z = scratch[row]
    if code == LANDING:
        return z[W]
    if code == RELEASE:
        return -z[W]
    if code == TURNING:
        return z[UD] - z[V2]
    if code == RETURNING:
        return z[V2] - z[UD]
    if code < BREAKING_UP:
        mass = code - STOPPING
        return -d[SLIDE1 + mass] * z[V1 + mass]
    if code < CORNER:
        mass = (code - BREAKING_UP) % 2
        rates(m, d, shift, z, scratch[SPARE_SLOPE], scratch[PUSH])
        if code == CUTTING:
            return scratch[PUSH, WHOLE] * (1.0 if d[CUT] != 0.0 else -1.0)
        sign = 1.0 if code < BREAKING_DOWN else -1.0
        return sign * scratch[PUSH, PUSHED + mass] - breakaway(m, mass)
    law = (code - CORNER) // 2
    x, at = argument(m, d, law, z, d[THETA] + m[OMEGA] * shift), law_at(m, law, FIRST_CORNER) + below_of(d, law)
    beyond = x - corner_at(m, at, WHERE) if (code - CORNER) % 2 == 0 else corner_at(m, at - 1, WHERE) - x
    return beyond


@njit(**INNER)
def guard_rate(
    m: np.ndarray, d: np.ndarray, code: int, shift: float, row: int, slope: int, scratch: np.ndarray
) -> float:
    """Its time derivative, with the state's slope in another row; of a force by a short difference."""
    apart()
    z, dz = scratch[row], scratch[slope]
    if code in (LANDING, RELEASE):
        into = z[V2] - z[UD]
        return into if code == LANDING else -into
    if code in (TURNING, RETURNING):
        bend = dz[V2] - dz[UD]
        return bend if code == RETURNING else -bend
    if code < BREAKING_UP:
        mass = code - STOPPING
        return -d[SLIDE1 + mass] * dz[V1 + mass]
    if code < CORNER:
        delta = DELTA * m[LONGEST]
        before = guard(m, d, code, shift, row, scratch)
        for i in range(z.size):
            scratch[SPARE, i] = z[i] + delta * dz[i]
        return (guard(m, d, code, shift + delta, SPARE, scratch) - before) / delta
    rate = argument_rate(m, d, (code - CORNER) // 2, z, dz, d[THETA] + m[OMEGA] * shift)
    return rate if (code - CORNER) % 2 == 0 else -rate


@njit(**INNER)
def stays_clear(g0: float, r0: float, g1: float, r1: float, h: float, on_it: bool, size: float) -> bool:
    """Whether the cubic with these values and slopes at the ends stays below zero by its Bernstein coefficients."""
    edge = -DOUBT * size
    first, last = g0 + h * r0 / 3.0, g1 - h * r1 / 3.0
    return (on_it or g0 < edge) and first < (edge if not on_it else 0.0) and last < edge and g1 < edge


@njit(**INNER)
def stays_off(m: np.ndarray, h: float, on_it: bool, size: float, scratch: np.ndarray) -> bool:
    """The same of the quintic of the indenter's distance from the rock in flight."""
    z0, z1, s0, s1 = scratch[BEGIN], scratch[END], scratch[0], scratch[STAGES]
    v0, v1 = h * (z0[V2] - z0[UD]), h * (z1[V2] - z1[UD])
    a0, a1 = h * h * (s0[V2] - s0[UD]), h * h * (s1[V2] - s1[UD])
    edge = -DOUBT * size
    first, last = z0[W] + 0.2 * v0, z1[W] - 0.2 * v1
    second, fourth = z0[W] + 0.4 * v0 + 0.05 * a0, z1[W] - 0.4 * v1 + 0.05 * a1
    if not ((on_it or z0[W] < edge) and first < (edge if not on_it else 0.0) and z1[W] < edge and last < edge):
        return False
    return second < edge and fourth < edge


@njit(**INNER)
def read_guard(m: np.ndarray, d: np.ndarray, code: int, h: float, s: float, scratch: np.ndarray) -> float:
    """A guard on the polynomial inside the trial step, s after its beginning."""
    apart()
    if code in (LANDING, RELEASE):
        place = inside_one(W, s / h, scratch)
        return place if code == LANDING else -place
    if code in (TURNING, RETURNING):
        into = inside_one(V2, s / h, scratch) - (inside_one(UD, s / h, scratch) if m[MOVING] > U else 0.0)
        return into if code == RETURNING else -into
    if code < BREAKING_UP:
        mass = code - STOPPING
        speed = inside_one(V1 + mass, s / h, scratch)
        return float(-d[SLIDE1 + mass] * speed)
    inside(int(m[TALLY]), s / h, scratch, SPARE)
    return guard(m, d, code, s, SPARE, scratch)


@njit(**INNER)
def highest(
    m: np.ndarray, d: np.ndarray, code: int, h: float, low: float, high: float, least: float, scratch: np.ndarray
) -> float:
    """Where a guard rises above ``least`` between two times; by the golden section. -1 where it stays below."""
    apart()
    one, two = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_one, at_two = (read_guard(m, d, code, h, one, scratch), read_guard(m, d, code, h, two, scratch))
    for _ in range(40):
        if at_one > least:
            return one
        if at_two > least:
            return two
        if at_one > at_two:
            high, two, at_two = two, one, at_one
            one = high - GOLDEN * (high - low)
            at_one = read_guard(m, d, code, h, one, scratch)
        else:
            low, one, at_one = one, two, at_two
            two = low + GOLDEN * (high - low)
            at_two = read_guard(m, d, code, h, two, scratch)
    return -1.0


@njit(**INNER)
def root(m: np.ndarray, d: np.ndarray, code: int, h: float, low: float, high: float, below: float, above: float,
         deflate: bool, scratch: np.ndarray) -> float:  # fmt: skip
    """Where a guard rises through zero between two times, on the polynomial; by the Illinois rule.

    ``below`` and ``above`` are its values at both, or, to ``deflate`` the zero at the step's beginning, those over the
    time since.
    """
    apart()
    near, last, side = NEAR * h, low, 0.0
    for turn in range(100):
        s = (low * above - high * below) / (above - below)
        if not low < s < high or turn % 8 == 7:
            s = 0.5 * (low + high)
        value = read_guard(m, d, code, h, s, scratch)
        if deflate:
            value /= s
        if value == 0.0 or abs(s - last) <= near or high - low <= near:
            return s
        last = s
        if value > 0.0:
            # the end that stays twice in a row loses half of its weight
            high, above, below = s, value, below * (0.5 if side > 0.0 else 1.0)
        else:
            low, below, above = s, value, above * (0.5 if side < 0.0 else 1.0)
        side = value
    return high


@njit(**INNER)
def tolerated(m: np.ndarray, d: np.ndarray, code: int, scratch: np.ndarray) -> float:
    """Error that the step has in a guard: inside a step, what is not above it may be the polynomial's alone."""
    sizes, rtol = int(m[SIZES_AT]), scratch[FLAGS, TOLERANCE]
    if code in (LANDING, RELEASE):
        return rtol * m[sizes + W]
    if code in (TURNING, RETURNING):
        return rtol * m[sizes + V2]
    if code == CUTTING:
        return NO_FORCE * (m[F_A] + m[F_B])
    if code >= CORNER:
        return AT_REST * argument_size(m, d, (code - CORNER) // 2)
    return rtol * m[sizes + V1 + code - STOPPING] if code < BREAKING_UP else 0.0


@njit(**INNER)
def first_crossing(
    m: np.ndarray, d: np.ndarray, code: int, h: float, ready: bool, scratch: np.ndarray
) -> tuple[float, bool]:
    """When a guard first rises through zero in the trial step of length h, -1 if it does not.

    And whether the polynomial inside the step has been prepared.
    """
    apart()
    g0, r0 = guard(m, d, code, 0.0, BEGIN, scratch), guard_rate(m, d, code, 0.0, BEGIN, FIRST_SLOPE, scratch)
    g1, r1 = guard(m, d, code, h, END, scratch), guard_rate(m, d, code, h, END, STAGES, scratch)
    size = max(max(abs(g0), abs(g1)), h * max(abs(r0), abs(r1)))
    near = ON_IT * size
    if code == CUTTING:
        near = NO_FORCE * (m[F_A] + m[F_B])
    elif code >= CORNER:
        near = max(ON_CORNER * size, tolerated(m, d, code, scratch))
    on_it = g0 > -near
    if on_it and (g0 > near or h * r0 > near):
        return 0.0, ready
    if size == 0.0:
        return -1.0, ready
    if code == LANDING:
        if stays_off(m, h, on_it, size, scratch):
            return -1.0, ready
    elif stays_clear(g0, r0, g1, r1, h, on_it, size):
        return -1.0, ready
    if not ready:
        follow(m, d, h, scratch)
    first, last = g0 + h * r0 / 3.0, g1 - h * r1 / 3.0
    if g0 < 0.0 < g1 and not on_it and g0 <= first <= last <= g1:
        # a cubic that only rises crosses once
        return root(m, d, code, h, 0.0, h, g0, g1, NO, scratch), YES
    least = tolerated(m, d, code, scratch)
    before, earlier, at, value = g0, g0, 0.0, g0
    for part in range(1, PARTS + 1):
        s = h * part / PARTS
        value = g1 if part == PARTS else read_guard(m, d, code, h, s, scratch)
        rising = before > earlier or (part == 1 and r0 > 0.0) or (part == 2 and on_it)
        if value <= least and ((rising and value < before) or (part == PARTS and value > before and r1 < 0.0)):
            # a maximum between samples may reach zero
            top = highest(m, d, code, h, max(at - h / PARTS, 0.0), s, least, scratch)
            if top >= 0.0:
                s, value = top, read_guard(m, d, code, h, top, scratch)
                at = 0.0 if at - h / PARTS <= 0.0 else at - h / PARTS
                before = g0 if at == 0.0 else read_guard(m, d, code, h, at, scratch)
        if value > (0.0 if part == PARTS and code < CUTTING else least):
            if at > 0.0 or not on_it:
                return root(m, d, code, h, at, s, min(before, 0.0), value, NO, scratch), YES
            if r0 < 0.0:
                return root(m, d, code, h, 0.0, s, r0, value / s, YES, scratch), YES
            # it leaves zero with no speed: look for where it is below
            low, after = s, value
            for _ in range(HALVINGS):
                low *= 0.5
                before = read_guard(m, d, code, h, low, scratch)
                if before < 0.0:
                    return root(m, d, code, h, low, 2.0 * low, before, after, NO, scratch), YES
                after = before
            return 0.0, YES
        earlier, before, at = before, value, s
    return -1.0, YES


@njit(**INNER)
def acts(place: int, regime: int) -> bool:
    """Whether a law at a place has guards in a regime of the contact."""
    if place <= UNLOADING:
        return regime == place + ON_LOADING
    if place in (WAVEFORM, COMPACTION):
        return False
    return regime != FREE or place > RATE_FORCE


@njit(**INNER)
def find_event(m: np.ndarray, d: np.ndarray, h: float, ready: bool, scratch: np.ndarray) -> tuple[float, int, bool]:
    """The first event in the trial step of length h: (when, guard), or (h, NOTHING).

    And whether the polynomial inside the step has been prepared. The trial step's state is in row ``END``, its slope in
    that of the last stage.
    """
    apart()
    regime, first, which = int(d[REGIME]), h, NOTHING
    code = LANDING if regime == FREE else (TURNING if regime == ON_LOADING else RETURNING)
    s, ready = first_crossing(m, d, code, h, ready, scratch)
    if s >= 0.0:
        first, which = s, code
    if regime == ON_UNLOADING:
        s, ready = first_crossing(m, d, RELEASE, h, ready, scratch)
        if 0.0 <= s < first or (s >= 0.0 and which == NOTHING):
            first, which = s, RELEASE
    if regime != FREE and m[PULLS] > 0.0:
        s, ready = first_crossing(m, d, CUTTING, h, ready, scratch)
        if 0.0 <= s < first or (s >= 0.0 and which == NOTHING):
            first, which = s, CUTTING
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0:
            ways = 1 if d[SLIDE1 + mass] != 0.0 else 2
            for way in range(ways):
                code = (STOPPING if ways == 1 else BREAKING_UP + 2 * way) + mass
                s, ready = first_crossing(m, d, code, h, ready, scratch)
                if 0.0 <= s < first or (s >= 0.0 and which == NOTHING):
                    first, which = s, code
        elif m[BRISTLES1 + mass] > 0.0:
            s, ready = first_crossing(m, d, STOPPING + mass, h, ready, scratch)
            if 0.0 <= s < first or (s >= 0.0 and which == NOTHING):
                first, which = s, STOPPING + mass
    for law in range(int(m[LAWS])):
        count = law_at(m, law, CORNER_COUNT)
        if count > 0 and acts(law_at(m, law, PLACE), regime):
            below = below_of(d, law)
            for way in range(2):
                if (below < count) if way == 0 else (below > 0):
                    code = CORNER + 2 * law + way
                    s, ready = first_crossing(m, d, code, h, ready, scratch)
                    if 0.0 <= s < first or (s >= 0.0 and which == NOTHING):
                        first, which = s, code
    return first, which, ready


@njit(**INNER)
def go_to(m: np.ndarray, d: np.ndarray, code: int, h: float, s: float, ready: bool, exact: bool,
          scratch: np.ndarray):  # fmt: skip
    """Put the state of an event, s into the trial step of length h, into row ``END``.

    Returns when it is, and whether the polynomial of the trial step is ready and still there.
    """
    apart()
    if not exact:
        if not ready:
            follow(m, d, h, scratch)
        inside(int(m[TALLY]) + 4 + int(m[EFFECTS]), s / h, scratch, END)
        return s, YES
    for _ in range(6):
        step(m, d, s, scratch)
        value = guard(m, d, code, s, END, scratch)
        rate = guard_rate(m, d, code, s, END, STAGES, scratch)
        # beside a maximum of the guard its polynomial has to do
        change = value / rate if rate > 0.0 else 0.0
        if not abs(change) < 0.5 * s or abs(change) <= 1e-15 * h:
            break
        s -= change
    return s, NO


# --- Reset maps


@njit(**INNER)
def standing_switch(d: np.ndarray, z: np.ndarray, dz: np.ndarray) -> int:
    """The regime that the state calls for: another one where it stands on a guard and is leaving its own."""
    regime, into, bend = int(d[REGIME]), z[V2] - z[UD], dz[V2] - dz[UD]
    if regime == FREE and z[W] >= 0.0 and (into > 0.0 or (into == 0.0 and bend > 0.0)):
        return ON_LOADING
    if regime == ON_LOADING and into <= 0.0 and bend < 0.0:
        return ON_UNLOADING
    if regime == ON_UNLOADING and into >= 0.0 and bend > 0.0:
        return ON_LOADING
    return regime


@njit(**INNER)
def shift_origin(d: np.ndarray, shift: float) -> None:
    """Move the origin; the rounding is carried along (Kahan), so that hours of drift cost no digits."""
    owed = shift + d[CARRY]
    moved = d[ORIGIN] + owed
    d[CARRY] = owed - (moved - d[ORIGIN])
    d[ORIGIN] = moved
    d[DRILLED] += shift


@njit(**INNER)
def stand_on_face(m: np.ndarray, d: np.ndarray, z: np.ndarray) -> None:
    """Take what is left of the speed into the rock's face out of a state at a turn."""
    if m[GRIP1 + 1] > 0.0 and d[SLIDE2] == 0.0:
        z[UD] = z[V2]
    else:
        z[V2] = z[UD]


@njit(**INNER)
def set_factor(m: np.ndarray, d: np.ndarray) -> None:
    """The factor on the rock's stiffness that the present contact has by its count or depth, and its angle."""
    d[FACTOR] = 1.0 + m[ROTATION_SHARE] * math.cos(d[ROTATION_CONTACT] + m[ROTATION_PHASE])
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == COMPACTION:
            x = compaction_argument(m, d)
            set_below(m, d, i, corners_below(m, i, x, 1.0))
            d[FACTOR] *= 1.0 + value_at(m, d, i, x)


@njit(**INNER)
def set_corners(m: np.ndarray, d: np.ndarray, z: np.ndarray, dz: np.ndarray, contact: bool) -> None:
    """Count for each law the corners below its argument, or only for those of the contact."""
    apart()
    for i in range(int(m[LAWS])):
        place = law_at(m, i, PLACE)
        if law_at(m, i, CORNER_COUNT) > 0 and place != COMPACTION and (not contact or place <= RATE_FORCE):
            if place == WAVEFORM:
                set_below(m, d, i, 0)
            theta = d[THETA]
            x = argument(m, d, i, z, theta)
            set_below(m, d, i, corners_below(m, i, x, argument_rate(m, d, i, z, dz, theta)))


@njit(**INNER)
def change_contact(m: np.ndarray, d: np.ndarray, after: int, z: np.ndarray) -> None:
    """Put the state, which stands on the guard, into the next regime of the contact."""
    apart()
    before = int(d[REGIME])
    if before == FREE:
        # the stiffness may change only here, where there is no force that would jump
        d[COUNT_CONTACT], d[DRILLED_CONTACT], d[ROTATION_CONTACT] = d[COUNT], d[DRILLED], d[ROTATION]
        set_factor(m, d)
    if before == FREE or after == FREE:
        z[W] = 0.0
    else:
        # at rest on the face; the force goes on, so the depth is counted anew
        stand_on_face(m, d, z)
        depth = law_depth(m, d, after, law_force(m, d, before, z[W]))
        shift_origin(d, z[W] - depth)
        z[W] = depth
    if before == ON_LOADING and after == ON_UNLOADING:
        d[COUNT] += 1.0
    d[REGIME] = after


@njit(**INNER)
def sign_of(x: float) -> float:
    """1, -1 or 0."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@njit(**INNER)
def settle_grips(m: np.ndarray, d: np.ndarray, z: np.ndarray, stopped: int, scratch: np.ndarray) -> None:
    """Decide which way masses at rest slide, or that they stick; ``stopped`` has just stopped or broken away."""
    apart()
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0 and (mass == stopped or d[SLIDE1 + mass] * z[V1 + mass] <= 0.0):
            z[V1 + mass] = 0.0
    rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0 and z[V1 + mass] == 0.0:
            force = scratch[PUSH, PUSHED + mass]
            breaks = abs(force) > breakaway(m, mass) or (mass == stopped and d[SLIDE1 + mass] == 0.0)
            d[SLIDE1 + mass] = sign_of(force) if breaks else 0.0


@njit(**INNER)
def turn_bristles(m: np.ndarray, d: np.ndarray, z: np.ndarray, mass: int, scratch: np.ndarray) -> None:
    """Let bristles be bent the way in which a mass now begins to move, whose speed is zero.

    Where its acceleration is no more than rounding they are bent the other way: if that is wrong, they turn once more.
    """
    apart()
    z[V1 + mass] = 0.0
    rates(m, d, 0.0, z, scratch[BEGIN_SLOPE], scratch[PUSH])
    acceleration = scratch[BEGIN_SLOPE, V1 + mass]
    rounding = AT_REST * (m[F_A] + m[F_B]) / m[M1 + mass]
    d[SLIDE1 + mass] = sign_of(acceleration) if abs(acceleration) > rounding else -d[SLIDE1 + mass]


@njit(**MERGED)
def start_sliding(m: np.ndarray, d: np.ndarray, z: np.ndarray, scratch: np.ndarray) -> None:
    """Let each mass slide the way it moves at the start of a run; those at rest stick or are pushed loose."""
    for mass in range(2):
        if m[GRIP1 + mass] > 0.0:
            d[SLIDE1 + mass] = sign_of(z[V1 + mass])
        elif m[BRISTLES1 + mass] > 0.0:
            d[SLIDE1 + mass] = 1.0 if z[V1 + mass] >= 0.0 else -1.0
            if z[V1 + mass] == 0.0:
                turn_bristles(m, d, z, mass, scratch)
    settle_grips(m, d, z, NEITHER, scratch)


@njit(**INNER)
def highest_force(
    m: np.ndarray, d: np.ndarray, h: float, s: float, ready: bool, scratch: np.ndarray
) -> tuple[float, bool]:
    """Largest force of the rock in N inside the first s of the trial step of length h; 0 where it is at an end.

    And whether the polynomial inside the step has been prepared. By the Illinois rule on how fast the force rises.
    """
    apart()
    rise = guard_rate(m, d, CUTTING, 0.0, BEGIN, FIRST_SLOPE, scratch) * (1.0 if d[CUT] != 0.0 else -1.0)
    if rise <= 0.0:
        return 0.0, ready
    if not ready:
        follow(m, d, h, scratch)
    low, high, fall, best, side = 0.0, s, 0.0, 0.0, 0.0
    for turn in range(12):
        at = s if turn == 0 else (low * fall - high * rise) / (fall - rise)
        inside(int(m[TALLY]), at / h, scratch, SPARE)
        force = rates(m, d, at, scratch[SPARE], scratch[SPARE_SLOPE], scratch[PUSH])
        for i in range(int(m[TALLY])):
            scratch[SPARE, i] += DELTA * h * scratch[SPARE_SLOPE, i]
        after = rates(m, d, at + DELTA * h, scratch[SPARE], scratch[SPARE_SLOPE], scratch[PUSH])
        rate = (after - force) / (DELTA * h)
        best = max(best, force)
        if turn == 0 and rate >= 0.0:
            return 0.0, YES
        if turn > 0 and abs(at - (low if rate > 0.0 else high)) < PEAK_NEAR * h:
            break
        if rate > 0.0:
            low, rise, fall = at, rate, fall * (0.5 if side > 0.0 else 1.0)
        else:
            high, fall, rise = at, rate, rise * (0.5 if side < 0.0 and turn > 1 else 1.0)
        side = rate
    return best, YES
