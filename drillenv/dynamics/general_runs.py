"""A run of the general engine: steps, switches and samples in their order."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.effects import ON_INDENTER, ON_SHAKER
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.general_calls import INNER, apart
from drillenv.dynamics.general_equations import (
    OWN,
    V1,
    V2,
    Model,
    U,
    W,
    Y,
    face_speed,
    law_depth,
    law_force,
    next_corner,
    slope,
    sticks,
)
from drillenv.dynamics.general_friction import find_stop, settle, start_sliding
from drillenv.dynamics.general_steps import (
    END,
    END_SLOPE,
    PUSH,
    START_SLOPE,
    TRIAL,
    TRIAL_SLOPE,
    borrow_model,
    copy,
    follow,
    inside,
    step,
    step_error,
)
from drillenv.dynamics.general_switches import change_regime, find_switch, inner_peak, stand_on_face, standing_switch

# How a run ends.
DONE, STEPS_TOO_SHORT, SWITCHES_TOO_DENSE = range(3)

SHORT = 0.25
"""Share of the longest step that is taken while a mass sticks: the force that holds it is followed by cubics only."""

READ_FROM = 1e-9
"""Tolerance from which samples are read off a polynomial through the step; below, each is a step of its own."""


@njit(**INNER)
def longer(table: np.ndarray) -> np.ndarray:
    """The same rows in twice the room."""
    result = np.zeros((2 * table.shape[0], table.shape[1]))
    for i in range(table.shape[0]):
        copy(table[i], result[i])
    return result


@njit(**INNER)
def add_exactly(total: float, carry: float, part: float):
    """Add to a sum kept as total and carry (Neumaier)."""
    new = total + part
    carry += (total - new) + part if abs(total) >= abs(part) else (part - new) + total
    return new, carry


SAMPLE_COLUMNS = 8
"""x1, x2, v1, v2, acceleration, force, penetration, regime; the extra states follow."""
MEASURED_COLUMNS = 2
"""Of samples that are only to hold acceleration and force."""
IMPACT_COLUMNS = 5
"""Time, peak force, speed at contact, depth, time of contact."""
SWITCH_COLUMNS = 3
"""Time, regime before, regime after."""


@njit(**INNER)
def write_sample(model, regime, origin, carry, z, dz, rock, row):
    """One row of the samples."""
    apart()
    if row.size == MEASURED_COLUMNS:
        row[0], row[1] = dz[V2], max(rock, 0.0)
        return
    x2 = origin + (carry + (z[W] + z[U]))
    front = z[W] - law_depth(model, UNLOADING, law_force(model, LOADING, z[W], z), z) if regime == LOADING else 0.0
    row[0], row[1], row[2], row[3] = x2 + z[Y], x2, z[V1], z[V2]
    row[4], row[5], row[6], row[7] = dz[V2], max(rock, 0.0), origin + (carry + front), regime
    for i in range(OWN, model.tally):
        row[SAMPLE_COLUMNS + i - OWN] = z[i]


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(
    model: Model,
    phase: float,
    z: np.ndarray,
    regime: int,
    seconds: float,
    rate: float,
    samples: np.ndarray,
    rtol: float,
    scratch: np.ndarray,
) -> tuple:
    """Run for ``seconds`` from ``z``, which is left at the end.

    Fills ``samples`` (rows at 1 / rate from time 0 on), of SAMPLE_COLUMNS and the extra states or of MEASURED_COLUMNS.
    Returns (status, time reached, regime, origin, carry, phase reached, impacts, switches, counts of steps tried and
    rejected).
    """
    model, z, samples, scratch = borrow_model(model), borrowed(z), borrowed(samples), borrowed(scratch)
    impacts, switches = np.zeros((64, IMPACT_COLUMNS)), np.zeros((256, SWITCH_COLUMNS))
    impact_count, switch_count, sampled, tried, rejected, standing = 0, 0, 0, 0, 0, 0
    origin, carry = 0.0, 0.0
    speed, since, peak = 0.0, 0.0, 0.0
    # time is counted in whole periods and a rest, so that the phase keeps its digits
    period = 2.0 * math.pi / model.omega
    periods, rest = 0.0, 0.0
    trust = np.full(3, min(model.longest, 0.05 * math.sqrt(model.m2 / model.kl)))
    status = DONE

    if model.gripped:
        start_sliding(model, 0.0, phase, regime, z, scratch)
    rock = slope(model, 0.0, phase, regime, z, scratch[START_SLOPE], scratch[PUSH])
    while True:
        time, theta = periods * period + rest, phase + model.omega * rest
        left = (seconds - periods * period) - rest
        if sampled == 0 and samples.shape[0] > 0:
            write_sample(model, regime, origin, carry, z, scratch[START_SLOPE], rock, samples[0])
            sampled = 1
        after = standing_switch(model, regime, z, scratch[START_SLOPE], scratch[PUSH])
        s, stopped = 0.0, -1
        if after == regime:
            if left <= 1e-15 * seconds:
                break
            # try a step
            h = min(trust[regime], left)
            if model.gripped and (sticks(model, ON_SHAKER, z) or sticks(model, ON_INDENTER, z)):
                h = min(h, SHORT * model.longest)
            if model.cornered:
                h = min(h, next_corner(model, time, theta, regime, z, scratch[START_SLOPE], rock))
            copy(scratch[START_SLOPE], scratch[0])
            step(model, time, theta, regime, z, h, scratch)
            tried += 1
            error = step_error(model, z, h, rtol, scratch)
            factor = 0.2 if not error < 1e10 else min(6.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.125))
            if error > 1.0 or not error < math.inf:
                rejected += 1
                trust[regime] = h * min(factor, 0.9)
                if trust[regime] < 1e-12 * period:
                    status = STEPS_TOO_SHORT
                    break
                continue
            if h == trust[regime] or factor < 1.0:
                trust[regime] = min(h * factor, model.longest)
            copy(scratch[END], scratch[TRIAL])
            copy(scratch[END_SLOPE], scratch[TRIAL_SLOPE])
            read = rtol >= READ_FROM and sampled < samples.shape[0] and (sampled / rate - periods * period) - rest <= h
            if read:
                follow(model, time, theta, regime, z, h, scratch)
            s, after = find_switch(model, time, theta, regime, z, h, scratch)
            if model.gripped:
                s, stopped = find_stop(model, time, theta, regime, z, s, scratch)
                if stopped >= 0:
                    after = regime
            # samples on the way
            while sampled < samples.shape[0]:
                ahead = (sampled / rate - periods * period) - rest
                if ahead > s:
                    break
                copy(scratch[END], scratch[TRIAL])
                if read:
                    inside(model, z, ahead / h, scratch)
                    at = theta + model.omega * ahead
                    rock = slope(model, time + ahead, at, regime, scratch[END], scratch[END_SLOPE], scratch[PUSH])
                else:
                    rock = step(model, time, theta, regime, z, ahead, scratch)
                write_sample(model, regime, origin, carry, scratch[END], scratch[END_SLOPE], rock, samples[sampled])
                copy(scratch[TRIAL], scratch[END])
                sampled += 1
            copy(scratch[END], scratch[TRIAL])
            if model.rated and regime == LOADING:
                peak = max(peak, inner_peak(model, time, theta, regime, z, s, scratch))
            copy(scratch[TRIAL], z)
            rest += s
            while rest >= period:
                rest -= period
                periods += 1.0
            time, theta = periods * period + rest, phase + model.omega * rest
            if model.gripped and (stopped >= 0 or after != regime):
                if after != regime and after != FREE and regime != FREE:
                    stand_on_face(model, z)
                    if z[V2] == 0.0 and model.grip2 >= 0 and not sticks(model, ON_INDENTER, z):
                        # whether a stop is a turn, friction has to say first
                        after, stopped = regime, ON_INDENTER
                settle(model, time, theta, regime, z, stopped, scratch)

        if after != regime or stopped >= 0:
            standing = standing + 1 if s <= 1e-15 * period else 0
            if standing > 8:
                status = SWITCHES_TOO_DENSE
                break
        if after != regime:
            before, regime = regime, after
            if before == FREE:
                speed, since = z[V2] - face_speed(model, z), time
            if after == UNLOADING:
                stand_on_face(model, z)
                peak = max(peak, slope(model, time, theta, before, z, scratch[START_SLOPE], scratch[PUSH]))
                if impact_count == impacts.shape[0]:
                    impacts = longer(impacts)
                impact = impacts[impact_count]
                impact[0], impact[1], impact[2], impact[3], impact[4] = time, peak, speed, z[W], since
                impact_count += 1
            peak = 0.0
            origin, carry = add_exactly(origin, carry, change_regime(model, before, after, z))
            if switch_count == switches.shape[0]:
                switches = longer(switches)
            switches[switch_count, 0], switches[switch_count, 1], switches[switch_count, 2] = time, before, after
            switch_count += 1
        rock = slope(model, time, theta, regime, z, scratch[START_SLOPE], scratch[PUSH])

    while status == DONE and sampled < samples.shape[0]:
        # the last sample, where rounding puts it just behind the end
        write_sample(model, regime, origin, carry, z, scratch[START_SLOPE], rock, samples[sampled])
        sampled += 1
    return (
        status,
        periods * period + rest,
        regime,
        origin,
        carry,
        phase + model.omega * rest,
        impacts[:impact_count],
        switches[:switch_count],
        tried,
        rejected,
    )
