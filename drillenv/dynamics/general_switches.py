"""Finding the switch inside a step of the general engine.

A step is tried without regard to switches, then searched for the first one. What leads to a switch is watched as a
function that rises through zero there: the place w in free flight, the speed -w' while loading and w' while unloading;
:mod:`drillenv.dynamics.general_friction` adds those of sliding and sticking. A polynomial through what is known at both
ends of the step says where zero is reached or nearly reached inside. Whether it is, and when, is decided on the
solution itself: the step is taken again from its start, shorter, until it ends on the switch. So the state at a switch
has the full order, and a contact that begins and ends inside one step is not missed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drillenv.dynamics.effects import ON_INDENTER
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.general_calls import INLINED, INNER, MERGED, apart, call_switched
from drillenv.dynamics.general_equations import (
    AT,
    FACE,
    FIRST,
    SWITCHED_AT,
    V1,
    V2,
    Model,
    W,
    face_speed,
    law_depth,
    law_force,
    slope,
    sticks,
)
from drillenv.dynamics.general_steps import (
    END,
    END_SLOPE,
    INNER_STATE,
    PUSH,
    START_SLOPE,
    TRIAL,
    TRIAL_SLOPE,
    copy,
    step,
)

# What can be watched. Behind each stands its rate; that of TURNING is not known.
PLACE, INTO, TURNING = 0, 1, 2
"""w, w' and w''."""
SPEED, FORCE = 3, 7
"""Of a mass: add twice its number. The force is that on it without friction."""

DELTA = 1e-6
"""Share of a step for the difference that gives the rate of a force."""


@njit(**INNER)
def watched(model: Model, z: np.ndarray, dz: np.ndarray, push: np.ndarray, level: int) -> float:
    """What is watched, in SI; not the rate of a force."""
    if level == PLACE:
        return z[W]
    if level == INTO:
        return dz[W]
    if level == TURNING:
        second = dz[V2]
        table = model.effects
        for i in range(table.shape[0]):
            if table[i, FACE] == 1:
                second -= dz[table[i, FIRST]]
        return second
    if level < FORCE:
        mass = (level - SPEED) // 2
        return z[V1 + mass] if level == SPEED + 2 * mass else dz[V1 + mass]
    return float(push[3 + model.effects.shape[0] + (level - FORCE) // 2])


@njit(**INNER)
def rock_ahead(model, time, theta, regime, z, dz, delta, scratch) -> float:
    """Force of the rock in N a short time ahead on the tangent; the forces in ``push`` are those there too."""
    apart()
    inner, work = scratch[INNER_STATE], scratch[11]
    for i in range(z.size):
        inner[i] = z[i] + delta * dz[i]
    return slope(model, time + delta, theta + model.omega * delta, regime, inner, work, scratch[PUSH])


@njit(**INNER)
def at_end(model, time, theta, regime, level, scratch) -> float:
    """What is watched, at the end of the step last taken, which is at ``time``; the rate of a force by a difference."""
    end, end_slope, push = scratch[END], scratch[END_SLOPE], scratch[PUSH]
    if level != FORCE + 1 and level != FORCE + 3:
        return watched(model, end, end_slope, push, level)
    delta = DELTA * model.longest
    one, two = watched(model, end, end_slope, push, FORCE), watched(model, end, end_slope, push, FORCE + 2)
    rock_ahead(model, time, theta, regime, end, end_slope, delta, scratch)
    rate = (watched(model, end, end_slope, push, level - 1) - (one if level == FORCE + 1 else two)) / delta
    needed = 3 + model.effects.shape[0]
    push[needed], push[needed + 1] = one, two
    return rate


@njit(**INNER)
def root(model, time, theta, regime, z, scratch, level, sign, offset, deflate, low, high, guess, h) -> float:
    """Duration of the step whose end has ``sign * watched - offset`` rising through zero.

    Newton's method on the solution itself, kept inside [low, high] by bisection; at ``high`` the function is above zero
    and at ``low`` below. ``deflate`` divides by the duration, which takes out the zero at the step's start. The state
    at the root is left in row ``END``.
    """
    apart()
    s = guess if low < guess < high else 0.5 * (low + high)
    last_s, last_value = -1.0, 0.0
    for _ in range(100):
        step(model, time, theta, regime, z, s, scratch)
        value = sign * at_end(model, time + s, theta + model.omega * s, regime, level, scratch) - offset
        if value == 0.0:
            return s
        if level < TURNING or (level >= SPEED and (level - SPEED) % 2 == 0):
            rate = sign * at_end(model, time + s, theta + model.omega * s, regime, level + 1, scratch)
        elif last_s >= 0.0:
            rate = (value - last_value) / (s - last_s)
        else:
            rate = 0.0
        last_s, last_value = s, value
        if deflate:
            value, rate = value / s, (rate - value / s) / s
        if value < 0.0:
            low = s
        else:
            high = s
        new = s - value / rate
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) <= 1e-15 * h:
            return s
        s = new
    return s


@njit(**INNER)
def quintic(start: float, speed: float, bend: float, end: float, end_speed: float, end_bend: float):
    """Coefficients of the quintic on [0, 1] with these values, slopes and second derivatives at its ends."""
    c2 = 0.5 * bend
    d0 = end - start - speed - c2
    d1 = end_speed - speed - bend
    d2 = 0.5 * (end_bend - bend)
    return start, speed, c2, 10 * d0 - 4 * d1 + d2, -15 * d0 + 7 * d1 - 2 * d2, 6 * d0 - 3 * d1 + d2


@njit(**INLINED)
def quintic_at(c, s: float, level: int) -> float:
    """The quintic or its first or second derivative."""
    if level == 0:
        return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5]))))
    if level == 1:
        return c[1] + s * (2 * c[2] + s * (3 * c[3] + s * (4 * c[4] + s * 5 * c[5])))
    return 2 * c[2] + s * (6 * c[3] + s * (12 * c[4] + s * 20 * c[5]))


@njit(**INNER)
def quintic_root(c, level: int, low: float, high: float) -> float:
    """A zero of the quintic or a derivative between two places where its signs differ, good enough to start from."""
    below = quintic_at(c, low, level) < 0.0
    for _ in range(24):
        middle = 0.5 * (low + high)
        if (quintic_at(c, middle, level) < 0.0) == below:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


PARTS = 12
"""Into how many parts a step is cut when it is searched for a switch."""
DOUBT = 1e-3
"""How near a maximum of the polynomial must come to the switch, over its own size, for the solution to be asked."""


@njit(**INNER)
def search(model, time, theta, regime, z, h, scratch, c, order, size, last, level, sign, offset, deflate) -> float:
    """Duration after which ``sign * watched - offset`` first rises through zero in a step of ``h``; -1 if it does not.

    The derivative of this order of the polynomial ``c`` stands for the function, which has the value ``last`` at the
    step's end. The state at the zero is left in row ``END``.
    """
    apart()
    right, right_slope = quintic_at(c, 0.0, order), quintic_at(c, 0.0, order + 1)
    for part in range(1, PARTS + 1):
        a, b = (part - 1) / PARTS, part / PARTS
        left, left_slope = right, right_slope
        right, right_slope = quintic_at(c, b, order), quintic_at(c, b, order + 1)
        if part == PARTS:
            right = last
        reached = -1.0
        if left_slope > 0.0 and right_slope < 0.0:
            top = quintic_root(c, order + 1, a, b)
            if quintic_at(c, top, order) > -DOUBT * size:
                # the maximum of the watched function: its slope falls through zero, so the sign is turned round
                reached = root(
                    model, time, theta, regime, z, scratch, level + 1, -sign, 0.0, False, a * h, b * h, top * h, h
                )
                at = theta + model.omega * reached
                if sign * at_end(model, time + reached, at, regime, level, scratch) - offset <= 0.0:
                    reached = -1.0
        if reached < 0.0 and right > 0.0:
            reached = b * h
            if part < PARTS:
                step(model, time, theta, regime, z, reached, scratch)
                at = theta + model.omega * reached
                if sign * at_end(model, time + reached, at, regime, level, scratch) - offset <= 0.0:
                    reached = -1.0
        if reached >= 0.0:
            top = min(b, reached / h)
            guess = top
            if quintic_at(c, top, order) > 0.0 and left < 0.0:
                guess = quintic_root(c, order, a, top)
            return root(
                model, time, theta, regime, z, scratch, level, sign, offset, deflate, 0.0, reached, guess * h, h
            )
    return -1.0


@njit(**MERGED)
def first_rise(model, time, theta, regime, z, h, scratch) -> float:
    """Duration after which the contact's watched function first rises through zero within the trial step, or -1.

    The state there is left in row ``END``.
    """
    level = PLACE if regime == FREE else INTO
    sign = -1.0 if regime == LOADING else 1.0
    start_slope, trial, trial_slope, push = scratch[START_SLOPE], scratch[TRIAL], scratch[TRIAL_SLOPE], scratch[PUSH]
    c = quintic(
        sign * z[W],
        sign * h * watched(model, z, start_slope, push, INTO),
        sign * h * h * watched(model, z, start_slope, push, TURNING),
        sign * trial[W],
        sign * h * watched(model, trial, trial_slope, push, INTO),
        sign * h * h * watched(model, trial, trial_slope, push, TURNING),
    )
    deflate = watched(model, z, start_slope, push, level) == 0.0
    size = max(abs(quintic_at(c, 0.0, level)), abs(quintic_at(c, 0.5, level)), abs(quintic_at(c, 1.0, level)))
    last = sign * watched(model, trial, trial_slope, push, level)
    return search(model, time, theta, regime, z, h, scratch, c, level, size, last, level, sign, 0.0, deflate)


@njit(**MERGED)
def find_switch(model, time, theta, regime, z, h, scratch):
    """The first switch within the trial step: (duration, next regime), or (h, regime) where there is none.

    The state there is left in row ``END``.
    """
    s = first_rise(model, time, theta, regime, z, h, scratch)
    if regime == FREE:
        if s >= 0.0:
            return s, LOADING
    elif regime == LOADING:
        if s >= 0.0:
            return s, UNLOADING
    else:
        place = scratch[END][W] if s >= 0.0 else scratch[TRIAL][W]
        if place <= 0.0:
            # released on the way there; unloading moves outward only, so there is one crossing
            high = s if s >= 0.0 else h
            guess = high - place / z[W] * high if z[W] == 0.0 else high * z[W] / (z[W] - place)
            s = root(model, time, theta, regime, z, scratch, PLACE, -1.0, 0.0, z[W] == 0.0, 0.0, high, guess, h)
            return s, FREE
        if s >= 0.0:
            return s, LOADING
    copy(scratch[TRIAL], scratch[END])
    return h, regime


@njit(**INNER)
def force_rate(model, time, theta, regime, z, dz, rock, h, scratch) -> float:
    """Rate of the rock's force along the motion in N/s, by a short difference."""
    delta = DELTA * h
    return (rock_ahead(model, time, theta, regime, z, dz, delta, scratch) - rock) / delta


@njit(**INNER)
def inner_peak(model, time, theta, regime, z, h, scratch) -> float:
    """Largest force of the rock inside a step of duration ``h`` in N; 0 where it rises or falls throughout.

    row ``END`` is used up.
    """
    apart()
    rock = slope(model, time, theta, regime, z, scratch[0], scratch[PUSH])
    if force_rate(model, time, theta, regime, z, scratch[0], rock, h, scratch) <= 0.0:
        return 0.0
    low, high, best = 0.0, h, 0.0
    for turn in range(30):
        s = h if turn == 0 else 0.5 * (low + high)
        rock = step(model, time, theta, regime, z, s, scratch)
        best = rock if turn == 0 else max(best, rock)
        rate = force_rate(
            model, time + s, theta + model.omega * s, regime, scratch[END], scratch[END_SLOPE], rock, h, scratch
        )
        if turn == 0 and rate >= 0.0:
            return 0.0
        if rate > 0.0:
            low = s
        else:
            high = s
    return best


@njit(**INNER)
def stand_on_face(model: Model, z: np.ndarray):
    """Take what is left of the speed into the rock's face out of a state at a turn."""
    if not (model.gripped and sticks(model, ON_INDENTER, z)):
        z[V2] = face_speed(model, z)
        return
    for i in range(model.effects.shape[0]):
        if model.effects[i, FACE] == 1:
            z[model.effects[i, FIRST]] = z[V2]


@njit(**INNER)
def standing_switch(model: Model, regime: int, z: np.ndarray, dz: np.ndarray, push: np.ndarray) -> int:
    """The regime that the state calls for: another one where it stands on a switch and is leaving its own."""
    into, turning = watched(model, z, dz, push, INTO), watched(model, z, dz, push, TURNING)
    if regime == FREE and z[W] >= 0.0 and (into > 0.0 or (into == 0.0 and turning > 0.0)):
        return LOADING
    if regime == LOADING and into <= 0.0 and turning < 0.0:
        return UNLOADING
    if regime == UNLOADING and into >= 0.0 and turning > 0.0:
        return LOADING
    return regime


@njit(**INNER)
def change_regime(model: Model, before: int, after: int, z: np.ndarray) -> float:
    """Put the state, which stands on the switch, into its next regime. Returns by how much the origin moves, in m."""
    apart()
    shift = 0.0
    if before == FREE or after == FREE:
        z[W] = 0.0
    else:
        # at rest on the face; the force goes on, so the depth is counted anew
        stand_on_face(model, z)
        depth = law_depth(model, after, law_force(model, before, z[W], z), z)
        shift = z[W] - depth
        z[W] = depth
    for i in range(model.effects.shape[0]):
        first, at = model.effects[i, FIRST], model.effects[i, AT]
        if model.effects[i, SWITCHED_AT] != 0:
            call_switched(model.effects[i, SWITCHED_AT], before, after, z, first, model.parameters, at)
    return shift
