"""A run of the exact engine, kept as its segments: the stretches in one regime, each known in closed form.

A log has a row where each segment starts (LOG_SIZE numbers, see exact.py), and one more where the run ends. From it the
state at any time and every integral over the run follow at machine precision.
"""

# Numba hands an intrinsic its first argument itself, which type checkers do not know.
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.dynamics.exact import LOG_SIZE, ORIGIN, REGIME, THETA, TURN, TURNS, advance_logged, make_scratch
from drillenv.dynamics.flow import (
    AMPLITUDE,
    FAST,
    FREE,
    LOADING,
    M1,
    M2,
    OMEGA,
    RELATIVE,
    SLOW,
    STATIC,
    STIFFNESS,
    UNLOADING,
    C,
    K,
    contact_coefficients,
    contact_state,
    free_coefficients,
    free_state,
    quickest,
    sine_cosine,
)

# Columns of a log.
L_TURNS, L_REGIME, L_Y, L_V1, L_V2, L_W, L_ORIGIN, L_THETA = range(LOG_SIZE)

# Rows of samples: sine of the excitation, force of the rock in N, acceleration of the indenter in m/s^2, places of
# shaker and indenter in m, their speeds in m/s, and the penetration (Xf) in m.
S_SINE, S_FORCE, S_ACCELERATION, S_X1, S_X2, S_V1, S_V2, S_PENETRATION = range(8)
SAMPLE_ROWS = 8

# Gauss and Legendre's rule with eight nodes: pieces over which the quickest mode turns by at most PIECE rad leave less
# than rounding of its square.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = tuple(0.5 * (1.0 + _NODES)), tuple(0.5 * _WEIGHTS)
PIECE = 1.5


def record(model: np.ndarray, state: np.ndarray, duration: float) -> np.ndarray:
    """Move the state ``duration`` seconds on. Returns the log (segments + 1, LOG_SIZE)."""
    scratch = make_scratch()
    tables = []
    left = duration
    while left > 0.0:
        table = np.empty((64 + int(8 * left * model[0, OMEGA] / TURN), LOG_SIZE))
        rows, left = advance_logged(model, state, left, table, scratch)
        tables.append(table[:rows])
    end = [state[TURNS], state[REGIME], *state[:4], state[ORIGIN], state[THETA]]
    return np.concatenate([*tables, np.array([end])])


def segment_times(model: np.ndarray, log: np.ndarray) -> np.ndarray:
    """(segments + 1,) when each segment starts and the last one ends, in s from the log's beginning."""
    turned = (log[:, L_TURNS] - log[0, L_TURNS]) * TURN + (log[:, L_THETA] - log[0, L_THETA])
    return turned / model[0, OMEGA]


def landings(log: np.ndarray) -> np.ndarray:
    """Rows of the log, after its first, at which a contact begins."""
    regime = log[:-1, L_REGIME]
    return np.flatnonzero((regime[1:] == LOADING) & (regime[:-1] == FREE)) + 1


def force_peaks(log: np.ndarray) -> np.ndarray:
    """Rows of the log, after its first, at which loading turns to unloading: the impacts."""
    regime = log[:-1, L_REGIME]
    return np.flatnonzero((regime[1:] == UNLOADING) & (regime[:-1] == LOADING)) + 1


def rock_force(model: np.ndarray, log: np.ndarray) -> np.ndarray:
    """(segments + 1,) force of the rock in N at each row."""
    stiffness = np.array([0.0, model[LOADING, STIFFNESS], model[UNLOADING, STIFFNESS]])
    return stiffness[log[:, L_REGIME].astype(int)] * log[:, L_W]


def penetration(model: np.ndarray, row: np.ndarray) -> float:
    """Xf in m at one row of the log."""
    if row[L_REGIME] != LOADING:
        return float(row[L_ORIGIN])
    return float(row[L_ORIGIN] + row[L_W] * (1.0 - model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS]))


def stored_energy_change(model: np.ndarray, log: np.ndarray) -> float:
    """Change of kinetic energy and of what the spring k and the rock would give back, in J, from first row to last."""
    before, after = log[0], log[-1]
    force = rock_force(model, log[[0, -1]])
    change = 0.0
    # differences of squares as products, so that a short run from a stiff spring keeps its digits
    for stiffness, first, last in (
        (model[0, M1], before[L_V1], after[L_V1]),
        (model[0, M2], before[L_V2], after[L_V2]),
        (model[0, K], before[L_Y], after[L_Y]),
        (1.0 / model[UNLOADING, STIFFNESS], force[0], force[1]),
    ):
        change += 0.5 * stiffness * (last - first) * (last + first)
    return float(change)


def lost_in_rock(model: np.ndarray, log: np.ndarray) -> float:
    """Energy in J that the rock keeps: what loading along k_l takes beyond what unloading along k_u returns."""
    force = rock_force(model, log)
    rise = (force[1:] - force[:-1]) * (force[1:] + force[:-1])
    gap = 1.0 / model[LOADING, STIFFNESS] - 1.0 / model[UNLOADING, STIFFNESS]
    return float(0.5 * gap * rise[log[:-1, L_REGIME] == LOADING].sum())


def work_of_static_force(model: np.ndarray, log: np.ndarray) -> float:
    """F_b times the advance of the shaker, in J."""
    place = log[[0, -1]]
    x1 = place[:, L_ORIGIN] + (place[:, L_W] + place[:, L_Y])
    return float(model[0, STATIC] * (x1[1] - x1[0]))


def work_and_damping(model: np.ndarray, log: np.ndarray) -> tuple[float, float]:
    """Work of the drive F_a sin(theta) on the indenter, and energy lost in the damper, in J, by quadrature."""
    drive, damper = np.zeros(len(log) - 1), np.zeros(len(log) - 1)
    quadrature(model, log, drive, damper)
    # numpy adds in pairs: one running sum would round the same way in every period of a motion
    return float(drive.sum()), float(damper.sum())


@njit(**INLINE)
def open_segment(model: np.ndarray, row: np.ndarray, work: np.ndarray) -> None:
    """Write the coefficients of the segment that starts in ``row`` into ``work`` (16,)."""
    sine, cosine = sine_cosine(row[L_THETA])
    if int(row[L_REGIME]) == FREE:
        free_coefficients(model, row[L_Y : L_W + 1], sine, cosine, work)
    else:
        contact_coefficients(model, int(row[L_REGIME]), row[L_Y : L_W + 1], sine, cosine, work)


@njit(**INLINE)
def segment_state(model: np.ndarray, row: np.ndarray, work: np.ndarray, t: float, z: np.ndarray) -> float:
    """Write (y, v1, v2, w) a time ``t`` into the segment. Returns the sine of the excitation there."""
    sine, cosine = sine_cosine(row[L_THETA] + model[0, OMEGA] * t)
    if int(row[L_REGIME]) == FREE:
        free_state(model, work, sine, cosine, t, z)
    else:
        contact_state(model, int(row[L_REGIME]), work, sine, cosine, t, z)
    return sine


@njit(**KERNEL)
def sample(model: np.ndarray, log: np.ndarray, starts: np.ndarray, times: np.ndarray, out: np.ndarray) -> None:
    """Fill ``out`` (SAMPLE_ROWS, n) at ``times`` (n,), which ascend; ``starts`` are the segment times."""
    model, log, starts = borrowed(model), borrowed(log), borrowed(starts)
    times, out = borrowed(times), borrowed(out)
    work, z = np.zeros(16), np.zeros(4)
    gain = 1.0 - model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS]
    last = log.shape[0] - 2
    segment = -1
    for n in range(times.size):
        fresh = segment < 0
        segment = max(segment, 0)
        while segment < last and starts[segment + 1] <= times[n]:
            segment += 1
            fresh = True
        row = log[segment]
        if fresh:
            open_segment(model, row, work)
        sine = segment_state(model, row, work, times[n] - starts[segment], z)
        regime = int(row[L_REGIME])
        depth = 0.0 if regime == FREE else max(z[3], 0.0)
        force = 0.0 if regime == FREE else model[regime, STIFFNESS] * depth
        push = model[0, AMPLITUDE] * sine + model[0, K] * z[0] + model[0, C] * (z[1] - z[2])
        out[S_SINE, n] = sine
        out[S_FORCE, n] = force
        out[S_ACCELERATION, n] = (push - force) / model[0, M2]
        out[S_X1, n] = row[L_ORIGIN] + (z[3] + z[0])
        out[S_X2, n] = row[L_ORIGIN] + z[3]
        out[S_V1, n] = z[1]
        out[S_V2, n] = z[2]
        out[S_PENETRATION, n] = row[L_ORIGIN] + (gain * depth if regime == LOADING else 0.0)


@njit(**KERNEL)
def quadrature(model: np.ndarray, log: np.ndarray, drive: np.ndarray, damper: np.ndarray) -> None:
    """Add each segment's work of the drive and loss in the damper, in J, to ``drive`` and ``damper`` (segments,)."""
    work, z = np.zeros(16), np.zeros(4)
    for segment in range(log.shape[0] - 1):
        row = log[segment]
        regime = int(row[L_REGIME])
        span = (log[segment + 1, L_TURNS] - row[L_TURNS]) * TURN + (log[segment + 1, L_THETA] - row[L_THETA])
        span /= model[0, OMEGA]
        rate = model[0, OMEGA]
        if regime == FREE:
            rate = max(rate, quickest(model[0, RELATIVE], model[0, RELATIVE + 1], model[0, RELATIVE + 2]))
        else:
            for at in (FAST, SLOW):
                rate = max(rate, quickest(model[regime, at], model[regime, at + 1], model[regime, at + 2]))
        pieces = 1 + math.floor(span * rate / PIECE)
        h = span / pieces
        open_segment(model, row, work)
        for piece in range(pieces):
            for i in range(8):
                sine = segment_state(model, row, work, h * (piece + NODES[i]), z)
                drive[segment] += h * WEIGHTS[i] * model[0, AMPLITUDE] * sine * z[2]
                damper[segment] += h * WEIGHTS[i] * model[0, C] * (z[1] - z[2]) ** 2
