"""Periodic orbits of the stroboscopic map, their multipliers, and what a start settles on.

The map takes (y, v1, v2, w) at the section phase 0 to the same one excitation period later. In contact w is counted in
the regime in which the orbit crosses the section, so that the map is continuous where the orbit crosses it in a turn.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import ALLOCATING, INLINE, INNER, KERNEL, apart, copy
from drillenv.dynamics.exact import (
    CONTACTS,
    IMPACTS,
    ORIGIN,
    PEAK_FORCE,
    PEAK_SPEED,
    REGIME,
    STATE_SIZE,
    TALLY_SIZE,
    THETA,
    TURN,
    Y,
    advance,
    advance_period,
    advance_tangent,
    make_scratch,
    set_phase,
)
from drillenv.dynamics.flow import AMPLITUDE, FREE, M2, OMEGA, STIFFNESS

LONGEST_PERIOD = 32
"""The longest period looked for, in excitation periods."""

KICK = 1e-3
"""How far, in length scales, a run is pushed off an unstable orbit that it sits on."""

# What find_motion writes: period (0 where none is found), impacts and contacts a motion, penetration in m a motion, the
# largest force in N, the largest speed at contact in m/s, the largest Lyapunov exponent in 1/s (chaotic only), stable
# or not, the regime at the section, and where the orbit crosses it.
PERIOD, M_IMPACTS, M_CONTACTS, ADVANCE, M_FORCE, M_SPEED, EXPONENT, STABLE, SECTION_REGIME, SECTION = range(10)
MOTION_SIZE = 13


@njit(**INLINE)
def length_scale(model: np.ndarray) -> float:
    """Amplitude of the indenter alone under the drive, in m: what distances on the section are measured by."""
    return model[0, AMPLITUDE] / (model[0, M2] * model[0, OMEGA] ** 2)


@njit(**KERNEL)
def section_distance(model: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two points of the section, lengths by length_scale and speeds by omega times it."""
    length = length_scale(model)
    speed = length * model[0, OMEGA]
    apart = max(abs(a[0] - b[0]), abs(a[3] - b[3])) / length
    return max(apart, max(abs(a[1] - b[1]), abs(a[2] - b[2])) / speed)


@njit(**KERNEL)
def on_section(model: np.ndarray, state: np.ndarray, regime: int, point: np.ndarray) -> None:
    """Write (y, v1, v2, w) of a state, with w as the given regime counts it."""
    copy(state[:4], point)
    present = int(state[REGIME])
    if point[3] > 0.0 and present != regime and present != FREE and regime != FREE:
        point[3] *= model[present, STIFFNESS] / model[regime, STIFFNESS]


@njit(**KERNEL)
def put_on_section(point: np.ndarray, regime: int, state: np.ndarray) -> None:
    """Set a state from a point of the section, at the origin."""
    state[:] = 0.0
    copy(point, state)
    state[REGIME] = regime
    set_phase(0.0, state)


@njit(**INNER)
def solve(matrix: np.ndarray, right: np.ndarray) -> bool:
    """Solve a small linear system in place by elimination with pivoting; False where it is singular."""
    apart()
    n = right.size
    for i in range(n):
        pivot = i
        for r in range(i + 1, n):
            if abs(matrix[r, i]) > abs(matrix[pivot, i]):
                pivot = r
        if matrix[pivot, i] == 0.0:
            return False
        if pivot != i:
            for j in range(n):
                matrix[i, j], matrix[pivot, j] = matrix[pivot, j], matrix[i, j]
            right[i], right[pivot] = right[pivot], right[i]
        for r in range(i + 1, n):
            factor = matrix[r, i] / matrix[i, i]
            for j in range(i, n):
                matrix[r, j] -= factor * matrix[i, j]
            right[r] -= factor * right[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    return True


@njit(**KERNEL)
def map_point(
    model: np.ndarray, point: np.ndarray, regime: int, period: int, image: np.ndarray, tangent: np.ndarray
) -> None:
    """Take a point of the section ``period`` excitation periods on; ``tangent`` (4, 4) gets the derivative."""
    apart()
    state, tally = np.zeros(STATE_SIZE), np.zeros(TALLY_SIZE)
    scratch = make_scratch()
    put_on_section(point, regime, state)
    for i in range(4):
        for j in range(4):
            tangent[i, j] = 1.0 if i == j else 0.0
    for _ in range(period):
        advance_tangent(model, state, tangent, tally, scratch)
    before = int(state[REGIME])
    on_section(model, state, regime, image)
    if image[3] > 0.0 and before != regime and before != FREE and regime != FREE:
        for j in range(4):
            tangent[3, j] *= model[before, STIFFNESS] / model[regime, STIFFNESS]


@njit(**KERNEL)
def find_orbit(model: np.ndarray, point: np.ndarray, regime: int, period: int, tangent: np.ndarray) -> bool:
    """Newton's method on the ``period``-fold map from ``point``, which becomes the orbit; ``tangent``: its derivative.

    Converged means that the point comes back to within 1e-11 of the length scale, and that the steps have died out.
    """
    apart()
    image, step = np.zeros(4), np.zeros(4)
    trial, matrix = point.copy(), np.zeros((4, 4))
    previous = np.inf
    for _ in range(25):
        map_point(model, trial, regime, period, image, tangent)
        miss = section_distance(model, image, trial)
        if not miss < 1e3:
            return False
        if miss < 1e-11 and miss >= 0.5 * previous:
            copy(trial, point)
            return True
        previous = miss
        for i in range(4):
            for j in range(4):
                matrix[i, j] = (1.0 if i == j else 0.0) - tangent[i, j]
            step[i] = image[i] - trial[i]
        if not solve(matrix, step):
            return False
        # a step far beyond the motion's own size says that there is no orbit near
        length = length_scale(model)
        size = max(max(abs(step[0]), abs(step[3])), max(abs(step[1]), abs(step[2])) / model[0, OMEGA]) / length
        factor = min(1.0, 1.0 / size) if size > 0.0 else 1.0
        for i in range(4):
            trial[i] += factor * step[i]
    if previous < 1e-11:
        copy(trial, point)
        return True
    return False


@njit(**ALLOCATING)
def contracts(matrix: np.ndarray) -> bool:
    """Whether all eigenvalues lie inside the unit circle: the powers die out."""
    apart()
    power, square = matrix.copy(), np.zeros((4, 4))
    for _ in range(26):
        largest = 0.0
        for i in range(4):
            for j in range(4):
                total = 0.0
                for m in range(4):
                    total += power[i, m] * power[m, j]
                square[i, j] = total
                largest = max(largest, abs(total))
        for i in range(4):
            copy(square[i], power[i])
        if largest < 1e-6:
            return True
        if not largest < 1e30:
            return False
    return False


@njit(**KERNEL)
def describe(model: np.ndarray, point: np.ndarray, regime: int, period: int, out: np.ndarray) -> None:
    """Go once around an orbit and write what happens on it."""
    apart()
    state, tally = np.zeros(STATE_SIZE), np.zeros(TALLY_SIZE)
    scratch = make_scratch()
    put_on_section(point, regime, state)
    # a first round, so that a switch on the section itself is counted once
    for _ in range(period):
        advance_period(model, state, tally, scratch)
    tally[:] = 0.0
    start = state[ORIGIN]
    for _ in range(period):
        advance_period(model, state, tally, scratch)
    out[PERIOD] = period
    out[M_IMPACTS], out[M_CONTACTS] = tally[IMPACTS], tally[CONTACTS]
    out[ADVANCE] = state[ORIGIN] - start
    out[M_FORCE], out[M_SPEED] = tally[PEAK_FORCE], tally[PEAK_SPEED]
    out[SECTION_REGIME] = regime
    copy(point, out[SECTION:])


@njit(**ALLOCATING)
def shortest_period(model: np.ndarray, point: np.ndarray, regime: int, period: int) -> int:
    """The smallest divisor of ``period`` after which the orbit already comes back."""
    apart()
    image, tangent = np.zeros(4), np.zeros((4, 4))
    for divisor in range(1, period):
        if period % divisor == 0:
            map_point(model, point, regime, divisor, image, tangent)
            if section_distance(model, image, point) < 1e-8:
                return divisor
    return period


@njit(**ALLOCATING)
def exponent(model: np.ndarray, state: np.ndarray, periods: int, out: np.ndarray) -> float:
    """Largest Lyapunov exponent in 1/s over ``periods`` from ``state``; ``out`` gets means and extremes on the way."""
    apart()
    tangent, tally = np.ones((4, 1)), np.zeros(TALLY_SIZE)
    scratch = make_scratch()
    speed = model[0, OMEGA]
    start = state[ORIGIN]
    total = 0.0
    for _ in range(periods):
        advance_tangent(model, state, tangent, tally, scratch)
        size = math.sqrt(tangent[0, 0] ** 2 + tangent[3, 0] ** 2 + (tangent[1, 0] ** 2 + tangent[2, 0] ** 2) / speed**2)
        total += math.log(size)
        for i in range(4):
            tangent[i, 0] /= size
    out[:] = 0.0
    out[M_IMPACTS], out[M_CONTACTS] = tally[IMPACTS] / periods, tally[CONTACTS] / periods
    out[ADVANCE] = (state[ORIGIN] - start) / periods
    out[M_FORCE], out[M_SPEED] = tally[PEAK_FORCE], tally[PEAK_SPEED]
    out[EXPONENT] = total / (periods * TURN / model[0, OMEGA])
    out[SECTION_REGIME] = state[REGIME]
    copy(state[:4], out[SECTION:])
    return out[EXPONENT]


@njit(**KERNEL)
def find_motion(
    model: np.ndarray, state: np.ndarray, wait: int, patience: int, out: np.ndarray, tangent: np.ndarray
) -> None:
    """What ``state`` settles on: runs it, polishes the orbit it comes near, and writes ``out`` (MOTION_SIZE,).

    After ``wait`` periods the last LONGEST_PERIOD crossings are compared; the shortest near return is polished by
    Newton's method, and taken if the orbit is stable and the run keeps closing in on it. Otherwise it runs on, up to
    ``patience`` periods in all; what is then not periodic gets its largest Lyapunov exponent.
    ``tangent`` gets the monodromy matrix.
    """
    tally, scratch = np.zeros(TALLY_SIZE), make_scratch()
    track = np.zeros((LONGEST_PERIOD + 1, 4))
    image = np.zeros(4)
    # to the section
    if state[THETA] != 0.0:
        advance(model, state, (TURN - state[THETA]) / model[0, OMEGA], tally, scratch)
        set_phase(0.0, state)
    done = 0
    target = wait
    while done < patience:
        for _ in range(target):
            advance_period(model, state, tally, scratch)
        regime = int(state[REGIME])
        on_section(model, state, regime, track[0])
        for n in range(1, LONGEST_PERIOD + 1):
            advance_period(model, state, tally, scratch)
            on_section(model, state, regime, track[n])
        done += target + LONGEST_PERIOD
        tried = 0
        nearest = np.inf
        for n in range(1, LONGEST_PERIOD + 1):
            near = section_distance(model, track[n], track[0])
            # a return worth trying: near, and clearly nearer than any shorter one
            if near < 0.1 and near < 0.2 * nearest:
                nearest = near
                point = track[0].copy()
                tried += 1
                if not find_orbit(model, point, regime, n, tangent):
                    continue
                off = section_distance(model, point, track[0])
                if contracts(tangent):
                    later = LONGEST_PERIOD - LONGEST_PERIOD % n
                    if off < 1e-9 or (off < 0.2 and section_distance(model, point, track[later]) < off):
                        period = shortest_period(model, point, regime, n)
                        if period < n:
                            map_point(model, point, regime, period, image, tangent)
                        describe(model, point, regime, period, out)
                        out[EXPONENT] = 0.0
                        out[STABLE] = 1.0
                        return
                elif off < KICK:
                    # the run lingers on an orbit that has lost its stability, as on a sweep past a period doubling
                    state[Y] += KICK * length_scale(model)
                if tried == 4:
                    break
        target = done
    exponent(model, state, 1000, out)
    tangent[:] = np.nan
