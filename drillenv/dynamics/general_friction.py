"""Dry friction in the general engine: when a mass begins to slide, turns round, and sticks.

While a mass slides, its speed is watched for zero. There it turns round where the other forces are stronger than the
friction against the new way, and sticks otherwise. While it sticks, the force that friction has to hold is watched for
the limit; where that is reached, the mass slides the way it is pushed.
"""

from __future__ import annotations

from numba import njit

from drillenv.dynamics.effects import ON_SHAKER
from drillenv.dynamics.general_calls import INNER, MERGED, apart
from drillenv.dynamics.general_equations import AT, FIRST, V1, Model, slope
from drillenv.dynamics.general_steps import END, PUSH, START_SLOPE, TRIAL, TRIAL_SLOPE, copy, step
from drillenv.dynamics.general_switches import DELTA, FORCE, SPEED, rock_ahead, search

SLACK = 1e-10
"""A sticking mass breaks away this share of the rig's forces above the limit, so that it then moves the right way by
more than rounding. A force that goes through the limit gets there some 1e-12 s later."""


@njit(**INNER)
def gripping(model: Model, mass: int) -> int:
    """Row of the effect whose friction grips a mass, or -1."""
    return model.grip1 if mass == ON_SHAKER else model.grip2


@njit(**INNER)
def edge(model: Model, row: int) -> float:
    """The force in N above which a mass gripped by this effect breaks away."""
    limit = float(model.parameters[model.effects[row, AT]])
    return limit + SLACK * (limit + model.drive + model.static)


@njit(**INNER)
def cubic(start: float, speed: float, end: float, end_speed: float):
    """Coefficients, as of a quintic, of the cubic on [0, 1] with these values and slopes at its ends."""
    rise = end - start
    return start, speed, 3.0 * rise - 2.0 * speed - end_speed, speed + end_speed - 2.0 * rise, 0.0, 0.0


@njit(**MERGED)
def force_on(model, time, theta, regime, z, dz, mass, scratch):
    """The force on a mass without friction in N, and its rate in N/s."""
    at, delta = 3 + model.effects.shape[0] + mass, DELTA * model.longest
    slope(model, time, theta, regime, z, dz, scratch[PUSH])
    force = scratch[PUSH][at]
    rock_ahead(model, time, theta, regime, z, dz, delta, scratch)
    return force, (scratch[PUSH][at] - force) / delta


@njit(**MERGED)
def first_of_mass(model, time, theta, regime, z, h, mass, scratch) -> float:
    """Duration after which a mass that slides stops, or one that sticks breaks away; -1 if it does neither.

    Row ``TRIAL`` is the state after ``h``. The state at the event is left in row ``END``.
    """
    row, start, trial = gripping(model, mass), scratch[START_SLOPE], scratch[TRIAL]
    slide = z[model.effects[row, FIRST]]
    if slide != 0.0:
        # the speed the way it slides falls through zero
        level, sign, offset, ways = SPEED + 2 * mass, -slide, 0.0, 1
        one, one_rate = z[V1 + mass], start[V1 + mass]
        two, two_rate = trial[V1 + mass], scratch[TRIAL_SLOPE][V1 + mass]
    else:
        level, sign, offset, ways = FORCE + 2 * mass, 1.0, edge(model, row), 2
        one, one_rate = force_on(model, time, theta, regime, z, scratch[10], mass, scratch)
        after, turned = time + h, theta + model.omega * h
        two, two_rate = force_on(model, after, turned, regime, trial, scratch[10], mass, scratch)
    size = max(abs(one), abs(two), h * abs(one_rate), h * abs(two_rate))
    found = -1.0
    for _ in range(ways):
        c = cubic(sign * one - offset, sign * h * one_rate, sign * two - offset, sign * h * two_rate)
        last, deflate = sign * two - offset, sign * one - offset == 0.0
        reached = search(model, time, theta, regime, z, h, scratch, c, 0, size, last, level, sign, offset, deflate)
        if reached >= 0.0 and (found < 0.0 or reached < found):
            found = reached
        sign = -sign
    return found


@njit(**MERGED)
def find_stop(model, time, theta, regime, z, h, scratch):
    """The first stop or breakaway of a mass within ``h``: (duration, mass), or (h, -1) where there is none.

    Row ``END`` is the state after ``h``, and is left as the state after the duration.
    """
    copy(scratch[END], scratch[TRIAL])
    slope(model, time + h, theta + model.omega * h, regime, scratch[TRIAL], scratch[TRIAL_SLOPE], scratch[PUSH])
    first, which = h, -1
    for mass in range(2):
        if gripping(model, mass) >= 0:
            reached = first_of_mass(model, time, theta, regime, z, h, mass, scratch)
            if 0.0 <= reached <= first:
                first, which = reached, mass
    if which < 0:
        copy(scratch[TRIAL], scratch[END])
    else:
        step(model, time, theta, regime, z, first, scratch)
    return first, which


@njit(**INNER)
def settle(model, time, theta, regime, z, stopped, scratch):
    """Decide which way masses at rest slide, or that they stick; ``stopped`` has just stopped or broken away."""
    apart()
    for mass in range(2):
        row = gripping(model, mass)
        if row >= 0 and (mass == stopped or z[model.effects[row, FIRST]] * z[V1 + mass] <= 0.0):
            z[V1 + mass] = 0.0
    slope(model, time, theta, regime, z, scratch[START_SLOPE], scratch[PUSH])
    for mass in range(2):
        row = gripping(model, mass)
        if row >= 0 and z[V1 + mass] == 0.0:
            slide, force = model.effects[row, FIRST], scratch[PUSH, 3 + model.effects.shape[0] + mass]
            breaks = abs(force) > edge(model, row) or (mass == stopped and z[slide] == 0.0)
            z[slide] = sign_of(force) if breaks else 0.0


@njit(**INNER)
def sign_of(x: float) -> float:
    """1, -1 or 0."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@njit(**MERGED)
def start_sliding(model, time, theta, regime, z, scratch):
    """Let each mass slide the way it moves at the start of a run; those at rest stick or are pushed loose."""
    for mass in range(2):
        row = gripping(model, mass)
        if row >= 0:
            z[model.effects[row, FIRST]] = sign_of(z[V1 + mass])
    settle(model, time, theta, regime, z, -1, scratch)
