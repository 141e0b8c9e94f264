"""Runs over many windows, each from a state of its own, sampled and differentiated: what multiple shooting takes.

Signals and their derivatives are smooth within a step. Where many samples lie in one, they are read at Chebyshev's
points of it and interpolated.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.compiling import compile_for
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import ALLOCATING, INNER, KERNEL, NO, YES, apart, copy
from drillenv.dynamics.flow import FREE
from drillenv.dynamics.flow import LOADING as ON_LOADING
from drillenv.dynamics.flow import UNLOADING as ON_UNLOADING
from drillenv.dynamics.hybrid.advance import STEPS_TOO_SHORT, SWITCHES_TOO_DENSE, WENT_ON, advance, prepare
from drillenv.dynamics.hybrid.events import set_factor
from drillenv.dynamics.hybrid.model import Model, fresh_motion, model_for
from drillenv.dynamics.hybrid.runge_kutta import (
    BEGIN,
    BEGIN_D,
    BEGIN_SLOPE,
    FLAGS,
    LENGTH,
    PUSH,
    READY,
    SPARE,
    SPARE_SLOPE,
    follow,
    make_scratch,
)
from drillenv.dynamics.hybrid.sensitivity import (
    BY_ROCK,
    BY_V2,
    POINTS,
    POINTS_AT,
    ROCK_V,
    ROCK_W,
    Columns,
    Variation,
    begin_drilled,
    begin_factor,
    borrow_columns,
    borrow_variation,
    by_late,
    by_state,
    carry_over,
    inside_step,
    linearise_late,
    make_variation,
    saltate,
    vary_drive,
    vary_step,
)
from drillenv.dynamics.hybrid.slew_rate import asked_late, drive_on, follow_or_ramp
from drillenv.dynamics.hybrid.vector_field import (
    BY_SLOPE,
    COUNT,
    COUNT_CONTACT,
    CUT,
    DRILLED,
    DRILLED_CONTACT,
    DRIVEN,
    MOVING,
    OMEGA,
    OWN,
    PEAK,
    REGIME,
    ROTATION,
    ROTATION_CONTACT,
    ROTATION_RATE,
    SLEWING,
    SLEWING_LEFT,
    THETA,
    THETA_CARRY,
    TIME,
    TURN,
    TURNS,
    UD,
    V2,
    VIBRATION,
    VIBRATION_RATE,
    W,
    law_force,
    rates,
    stiffness,
)
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

FASTEST = 100.0
"""m/s of the indenter beyond which a motion is given up."""
MOST_STEPS = 4000
"""Of a window."""
SIGNAL_POINTS = 7
"""At which signals are read inside a step that holds more samples."""


def _fit(points: np.ndarray) -> np.ndarray:
    """The matrix from values at points from 0 to 1 to coefficients of powers about the middle."""
    return np.linalg.inv(np.vander(points - 0.5, increasing=True))


SIGNALS_AT = 0.5 - 0.5 * np.cos(np.pi * np.arange(SIGNAL_POINTS) / (SIGNAL_POINTS - 1))
SIGNALS_FIT, SLOPES_FIT = _fit(SIGNALS_AT), _fit(POINTS_AT)


UNCHAINED = np.zeros(OWN, dtype=bool)
"""Of windows that each begin anew."""


class Windows(NamedTuple):
    """Where a run begins anew, and how."""

    starts: np.ndarray
    """(windows + 1,) samples at which windows begin, and where the last one ends."""
    begin: np.ndarray
    """(windows, OWN) states at the beginning of each."""
    varied: np.ndarray
    """(windows, columns, OWN) their derivatives by the columns."""
    rate: float
    """Samples a second."""
    phase: float
    """rad of the excitation at sample 0."""
    impacts: float
    """Before sample 0, on this face of the rock; 0 of a rig that begins at rest."""
    drilled: float
    """m before sample 0, likewise."""
    chained: np.ndarray
    """(OWN,) which states go on from the window before, with their derivatives; ``begin`` then says at the end what
    they began with."""
    stride: int
    """Samples from one state in ``path`` to the next; all starts are multiples."""
    grazing: float
    """m/s of a contact's speed below which the jump of the derivatives is held back."""


class Shot(NamedTuple):
    """What :func:`shoot` writes; the samples run from the first start to the last."""

    path: np.ndarray
    """(OWN, n // stride) states, or (OWN, 0) for none; on the rock w is the force of the rock law over k_l, whichever
    law that is and on the way out as well."""
    signals: np.ndarray
    """(2, n) force of the rock in N and acceleration of the indenter in m/s^2."""
    by_column: np.ndarray
    """(columns, 2, n) their derivatives; by the state that of the same window."""
    ends: np.ndarray
    """(windows, OWN) states at their ends."""
    ends_by_column: np.ndarray
    """(windows, columns, OWN)"""


@njit(**INNER)
def begin_window(
    m: np.ndarray,
    d: np.ndarray,
    z: np.ndarray,
    windows: Windows,
    window: int,
    made: float,
    columns: Columns,
    work: Variation,
    scratch: np.ndarray,
) -> None:
    """Put the state at the beginning of a window; ``made`` impacts have been before. Returns nothing."""
    apart()
    for i in range(OWN):
        if windows.chained[i] and window > 0:
            windows.begin[window, i] = z[i]
        z[i] = windows.begin[window, i]
    time = windows.starts[window] / windows.rate
    theta = windows.phase + m[OMEGA] * time
    d[TIME], d[TURNS], d[THETA_CARRY], d[PEAK], d[CUT] = time, 0.0, 0.0, 0.0, 0.0
    d[THETA] = theta - TURN * math.floor(theta / TURN)
    d[ROTATION], d[VIBRATION] = m[ROTATION_RATE] * time, m[VIBRATION_RATE] * time
    d[REGIME] = FREE if z[W] < 0.0 else (ON_LOADING if z[V2] - z[UD] >= 0.0 else ON_UNLOADING)
    d[COUNT], d[COUNT_CONTACT], d[ROTATION_CONTACT] = made, made, d[ROTATION]
    if window == 0:
        d[DRILLED] = windows.drilled
    d[DRILLED_CONTACT] = d[DRILLED]
    begin_drilled(window == 0, columns, work)
    set_factor(m, d)
    if window == 0 and m[BY_SLOPE] >= 0.0:
        begin_drive(m, d, windows.impacts > 0.0, columns, work, scratch)
    prepare(m, d, z, YES, scratch)
    for a in range(OWN):
        if windows.chained[a] and window > 0:
            continue
        for c in range(columns.kind.size):
            work.v[0, a, c] = windows.varied[window, c, a]
    begin_factor(m, d, columns, work)


TURNS_BEFORE = 12
"""Turns of the excitation in which a drive of limited slew rate settles before recordings of a rig that was running."""


@njit(**INNER)
def begin_drive(
    m: np.ndarray, d: np.ndarray, running: bool, columns: Columns, work: Variation, scratch: np.ndarray
) -> None:
    """Give a drive of limited slew rate the force that it has settled to by now; none where the rig was not running."""
    apart()
    time, theta, left = d[TIME], d[THETA], TURNS_BEFORE * TURN / m[OMEGA]
    d[SLEWING], d[DRIVEN] = 0.0, 0.0
    for c in range(columns.kind.size):
        work.driven[c] = 0.0
    if not running:
        return
    d[DRIVEN] = asked_late(m, theta)[0]
    linearise_late(m, theta, work)
    for c in range(columns.kind.size):
        work.driven[c] = by_late(m, columns, c, work)
    follow_or_ramp(m, d)
    while left > 0.0:
        copy(d, scratch[BEGIN_D])
        s = min(left, d[SLEWING_LEFT])
        d[TIME] += s
        d[THETA] += m[OMEGA] * s
        drive_on(m, d, s)
        if s < left:
            follow_or_ramp(m, d)
        vary_drive(m, scratch[BEGIN_D], d, columns, work)
        left -= s
    d[TIME], d[THETA] = time, theta


@njit(**ALLOCATING)
def read_signals(
    m: np.ndarray,
    s: float,
    first: int,
    last: int,
    begun: float,
    rate: float,
    at,
    signals: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """Write the signals of samples first to last, which lie in the step just taken, of which s is the motion's.

    ``begun`` is the time of the step's beginning in samples; ``at`` (at least as many,) is room for their places.
    """
    apart()
    d, length, count = scratch[BEGIN_D], scratch[FLAGS, LENGTH], last - first
    few = count <= SIGNAL_POINTS
    values = np.empty((2, SIGNAL_POINTS))
    for k in range(count if few else SIGNAL_POINTS):
        shift = (first + k - begun) / rate if few else SIGNALS_AT[k] * s
        shift = min(max(shift, 0.0), s)
        inside_step(m, shift / length, scratch)
        rock = rates(m, d, shift, scratch[SPARE], scratch[SPARE_SLOPE], scratch[PUSH])
        values[0, k], values[1, k] = rock, scratch[SPARE_SLOPE, V2]
    if few:
        for i in range(2):
            for k in range(count):
                signals[i, first + k] = values[i, k]
        return
    for k in range(count):
        at[k] = (first + k - begun) / (rate * s) - 0.5
    c = np.empty(SIGNAL_POINTS)
    for i in range(2):
        for power in range(SIGNAL_POINTS):
            c[power] = 0.0
            for k in range(SIGNAL_POINTS):
                c[power] += SIGNALS_FIT[power, k] * values[i, k]
        c0, c1, c2, c3, c4, c5, c6 = c[0], c[1], c[2], c[3], c[4], c[5], c[6]
        row, places = signals[i, first:last], at[:count]
        for k in range(row.size):
            t = places[k]
            row[k] = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6)))))


@njit(**ALLOCATING)
def read_slopes(
    m: np.ndarray,
    s: float,
    first: int,
    last: int,
    begun: float,
    rate: float,
    at,
    columns: Columns,
    work: Variation,
    by_column: np.ndarray,
) -> None:
    """The same of the derivatives by the columns, from the points that they were found at."""
    apart()
    n, v = int(m[MOVING]), work.v
    for k in range(last - first):
        at[k] = (first + k - begun) / (rate * s) - 0.5
    values = np.empty((2, POINTS))
    for c in range(columns.kind.size):
        for k in range(POINTS):
            lin = work.lin[k]
            into = v[k, V2, c] - v[k, UD, c]
            values[0, k] = work.force[k, BY_ROCK, c] + lin[ROCK_W] * v[k, W, c] + lin[ROCK_V] * into
            total = work.force[k, BY_V2, c]
            for b in range(n):
                total += work.j[k, V2, b] * v[k, b, c]
            values[1, k] = total
        for i in range(2):
            c0, c1, c2, c3, c4 = 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(POINTS):
                value = values[i, k]
                c0 += SLOPES_FIT[0, k] * value
                c1 += SLOPES_FIT[1, k] * value
                c2 += SLOPES_FIT[2, k] * value
                c3 += SLOPES_FIT[3, k] * value
                c4 += SLOPES_FIT[4, k] * value
            # loops over slices, whose indices cannot be negative, are made into vector instructions
            row, places = by_column[c, i, first:last], at[: last - first]
            for k in range(row.size):
                t = places[k]
                row[k] = c0 + t * (c1 + t * (c2 + t * (c3 + t * c4)))


@njit(**INNER)
def read_path(
    m: np.ndarray,
    s: float,
    first: int,
    last: int,
    begun: float,
    windows: Windows,
    path: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """The same of the states that lie at the path's samples."""
    apart()
    d, stride, length = scratch[BEGIN_D], windows.stride, scratch[FLAGS, LENGTH]
    regime = int(d[REGIME])
    for k in range(-(-first // stride), path.shape[1]):
        if k * stride >= last:
            break
        inside_step(m, min(max((k * stride - begun) / windows.rate, 0.0), s) / length, scratch)
        for i in range(OWN):
            path[i, k] = scratch[SPARE, i]
        if regime != FREE:
            path[W, k] = law_force(m, d, regime, scratch[SPARE, W]) / stiffness(m, d, ON_LOADING)


@njit(**KERNEL)
def shoot(
    model: Model,
    d: np.ndarray,
    rtol: float,
    windows: Windows,
    columns: Columns,
    shot: Shot,
    work: Variation,
    scratch: np.ndarray,
) -> tuple[int, float]:
    """Run every window, with the derivatives asked for.

    Args:
        model: The model, without terms from outside.
        d: A discrete state of it.
        rtol: Relative error of a step.
        windows: Where to begin.
        columns: By what the motion is differentiated.
        shot: Filled.
        work, scratch: From ``make_variation`` and ``make_scratch``.

    Returns:
        Status, and impacts made at the end.
    """
    m, d, scratch = borrowed(model.flat), borrowed(d), borrowed(scratch)
    columns, work = borrow_columns(columns), borrow_variation(work)
    count, rate = columns.kind.size, windows.rate
    z, before, slope = np.zeros(scratch.shape[1]), np.zeros(scratch.shape[1]), np.zeros(scratch.shape[1])
    longest = 0
    for window in range(windows.starts.size - 1):
        longest = max(longest, int(windows.starts[window + 1] - windows.starts[window]))
    at = np.zeros(longest + 1)
    made = windows.impacts
    for window in range(windows.starts.size - 1):
        begin_window(m, d, z, windows, window, made, columns, work, scratch)
        sample, last = int(windows.starts[window]), int(windows.starts[window + 1])
        begun, steps = float(sample), 0
        while begun < last:
            copy(scratch[BEGIN_SLOPE], slope)
            status, taken = advance(m, d, z, (last - begun) / rate, rtol, NO, scratch)
            steps += 1
            if status != WENT_ON or steps > MOST_STEPS:
                return (SWITCHES_TOO_DENSE if status == WENT_ON else status), made
            if taken == 0.0:
                if count == 0:
                    continue
                saltate(m, scratch[BEGIN_D], scratch[BEGIN], slope, d, z, windows.grazing, columns, work, scratch)
                continue
            ended = begun + taken * rate
            if last - ended < 1e-9:
                ended = float(last)
            length = scratch[FLAGS, LENGTH]
            if count > 0:
                vary_step(m, taken, columns, work, scratch)
            following = min(math.ceil(ended), last)
            if following > sample:
                if scratch[FLAGS, READY] == 0.0:
                    follow(m, scratch[BEGIN_D], length, scratch)
                    scratch[FLAGS, READY] = 1.0
                read_signals(m, taken, sample, following, begun, rate, at, shot.signals, scratch)
                if count > 0:
                    read_slopes(m, taken, sample, following, begun, rate, at, columns, work, shot.by_column)
                if shot.path.shape[1] > 0:
                    read_path(m, taken, sample, following, begun, windows, shot.path, scratch)
                sample = following
            if count > 0:
                # what the event's reset map began from
                inside_step(m, taken / length, scratch)
                copy(scratch[SPARE], before)
                rates(m, scratch[BEGIN_D], taken, before, slope, scratch[PUSH])
                carry_over(work)
                saltate(m, scratch[BEGIN_D], before, slope, d, z, windows.grazing, columns, work, scratch)
            begun = ended
            if not abs(z[V2]) < FASTEST:
                return STEPS_TOO_SHORT, made
        made = d[COUNT]
        for i in range(OWN):
            shot.ends[window, i] = z[i]
            for c in range(count):
                shot.ends_by_column[window, c, i] = work.v[0, i, c]
    return WENT_ON, made


COMPILE_DERIVATIVES = f"from {__name__} import compile_derivatives; compile_derivatives()"
"""For :func:`drillenv.compiling.helped`, where :func:`shoot` is needed."""


def compile_derivatives() -> None:
    """Compile the half of :func:`shoot` that takes derivatives along."""
    model, columns = model_for(Rig(), Setting(100.0, 0.4, 1.0), Rock(1e8, 2e8), ()), by_state(1)
    d, z = fresh_motion(model)
    scratch, work = make_scratch(model), make_variation(model, 1)
    compile_for(vary_step, model.flat, 0.0, columns, work, scratch)
    compile_for(saltate, model.flat, d, z, z, d, z, 0.0, columns, work, scratch)
