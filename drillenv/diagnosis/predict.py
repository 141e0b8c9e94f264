"""The drilling rig between two samples and over windows, with its sensitivities.

One model holds the paper's rig and every place where physics may be missing. A place is a curve, tabulated over its
argument; all curves at zero give the paper's model. So a textbook equation and a free law are the same to the solver:
a table, and the derivative of that table by each of its parameters.

States: shortening y of the coupling (m), speeds v1 and v2 (m/s), contact coordinate w (m), deflection u (m) and speed
(m/s) of the rock's mount, force q (N) that the cylinder has lost. Off the rock w is the distance to it, negative. On
the rock w = R / k_l, R the force of the rock law, so that both ways of the paper's law are w' = kappa (v2 - u'), with
kappa = 1 loading and k_u / k_l unloading; its memory is in w and in nothing else.

Sensitivities are those of the variational equations along the motion. At a switch of the contact they jump by the
saltation matrix (M. di Bernardo et al., Piecewise-smooth Dynamical Systems, Springer, 2008, Section 2.5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.constitutive.places import (
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    LOADING,
    MOUNT_DAMPER,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    WAVEFORM,
)

# States
Y, V1, V2, W, U, UD, Q = range(7)
STATES = 7
STATE_NAMES = ("y", "v1", "v2", "w", "u", "u'", "q")

PLACES = MOUNT_DAMPER + 1
GRID = 641
"""Points of a table."""
MARGIN = 160.0
"""Points by which its ends go on straight beyond it."""

# Scalars of the model
(
    M1,
    M2,
    K,
    C,
    F_A,
    F_B,
    K_L,
    RATIO,
    MOUNT_GAIN,
    MOUNT_SQUARE,
    MOUNT_DAMPING,
    AIR_STIFFNESS,
    AIR_RATE,
    PHASE,
) = range(14)
SCALARS = 14
"""m1, m2 (kg), k (N/m), c (N s/m), drive and static force (N), k_l (N/m), k_u / k_l; of the mount 1 / m_r (1/kg),
natural frequency squared and twice damping ratio times natural frequency; stiffness (N/m) and rate (1/s) of the air;
phase of the drive (rad)."""

LARGEST_LOG = 5.0
"""Curves of loading and unloading are logarithms of the factor on the stiffness, and no larger than this."""

# Kinds of columns beside scalars (>= 0, the index of the scalar)
CURVE, ON_SHAKER, ON_INDENTER, MODULATION = -1, -2, -3, -4

FLIGHT, ON_LOADING, ON_UNLOADING = 0, 1, 2
SAID = 16
"""Numbers that :func:`_rates` says of a state beside its rates."""
MOST_PARTS = 400
"""Of one step; a motion that needs more is given up."""
STIFF, FINEST_PART = 0.5, 32.0
"""A step times the fastest rate of the law that acts, or three times its angular frequency, at most; and the most parts
that the time from one sample to the next is cut into for it."""


DIVERGED, STUCK = -1.0, -2.0
"""What :func:`run` returns for a motion that cannot be followed: it left all bounds, or did not come to the end of a
step in ``MOST_PARTS`` parts."""

GRAZING = 2e-3
"""m/s of a contact's speed below which the jump of the sensitivities is held back: a contact that is grazed comes a
micrometre earlier or not at all, and what is infinite to first order says nothing of that."""


class Axes(NamedTuple):
    """How each place's argument is turned into a position in its table: asinh(x / scale), from low to high."""

    scale: np.ndarray
    """(PLACES,) in the argument's unit."""
    low: np.ndarray
    """(PLACES,) of asinh(x / scale)."""
    step: np.ndarray
    """(PLACES,)"""

    def points(self, place: int) -> np.ndarray:
        """(GRID,) arguments at which a place's table stands."""
        return self.scale[place] * np.sinh(self.low[place] + self.step[place] * np.arange(GRID))


class Columns(NamedTuple):
    """By what the motion is differentiated. Arrays have shape (columns,)."""

    kind: np.ndarray
    """A scalar's index, or one of the kinds."""
    place: np.ndarray
    """Of a curve."""
    turn: np.ndarray
    """rad/s, of a wave; its phase is 0 at the first sample."""
    code: np.ndarray
    """Of a wave: 0 sine, 1 cosine, 2 and 3 the same times the time in s."""
    table: np.ndarray
    """(columns, GRID) derivative of the place's curve."""


class Wave(NamedTuple):
    """Sinusoids of frequencies of their own: forces on the masses in N, and shares of the rock's stiffness."""

    turn: np.ndarray
    """(3,) rad/s: shaker, indenter, stiffness."""
    sine: np.ndarray
    """(3,)"""
    cosine: np.ndarray
    """(3,)"""


@njit(cache=True, error_model="numpy", forceinline=True)
def _at(axes, place, x):
    """Position in a place's table, of which a margin beyond either end goes on straight."""
    at = (math.asinh(x / axes.scale[place]) - axes.low[place]) / axes.step[place]
    return min(max(at, -MARGIN), GRID - 1.0 + MARGIN)


@njit(cache=True, error_model="numpy", forceinline=True)
def _cell(at):
    """The lower of the two points of a table between which, or beyond which, a position is."""
    return min(max(int(at), 0), GRID - 2)


@njit(cache=True, error_model="numpy", forceinline=True)
def _look(tables, axes, place, x):
    """Value and slope of a place's curve."""
    at = _at(axes, place, x)
    i = _cell(at)
    rise = tables[place, i + 1] - tables[place, i]
    value = tables[place, i] + (at - i) * rise
    if at == -MARGIN or at == GRID - 1.0 + MARGIN:
        return value, 0.0
    return value, rise / (axes.step[place] * math.sqrt(x * x + axes.scale[place] ** 2))


@njit(cache=True, error_model="numpy", forceinline=True)
def _rates(z, theta, time, regime, impacts, s, tables, axes, active, wave, f, d):
    """Time derivatives f of the states z; into d what they are linear in. Returns the rock's force.

    d: 0 dR/dw, 1 dR/dv2, 2 dF_c/dy, 3 dF_c/dv1, 4 friction slope of the shaker, 5 of the indenter, 6 kappa,
    7 dkappa/dw, 8 stiffness factor, 9 rate factor, 10 slope of the drive's curve, 11 waveform, 12 its slope, 13 slope
    of the curve over the shortening beyond that at rest, 14 and 15 of those over the mount's deflection and speed.
    """
    into, closing = z[V2] - z[UD], z[V1] - z[V2]
    rock, rock_w, rock_v, kappa, kappa_w, factor, rate = 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0
    if regime != FLIGHT:
        if active[COMPACTION]:
            factor += _look(tables, axes, COMPACTION, impacts)[0]
        if wave.turn[2] > 0.0:
            turned = wave.turn[2] * time
            factor += wave.sine[2] * math.sin(turned) + wave.cosine[2] * math.cos(turned)
        straight = s[K_L] * factor
        extra, rate_v, extra_v = 0.0, 0.0, 0.0
        if active[RATE_FACTOR]:
            more, rate_v = _look(tables, axes, RATE_FACTOR, into)
            rate += more
        if active[RATE_FORCE]:
            extra, extra_v = _look(tables, axes, RATE_FORCE, into)
        rock = straight * z[W] * rate + extra
        rock_w, rock_v = straight * rate, straight * z[W] * rate_v + extra_v
        if rock < 0.0 and z[W] > 0.0:
            # the rock does not pull; at w = 0 itself a switch is about to be made, and the law goes on straight
            rock, rock_w, rock_v = 0.0, 0.0, 0.0
        place = LOADING if regime == ON_LOADING else UNLOADING
        if active[place]:
            more, slope = _look(tables, axes, place, max(z[W], 0.0))
            kappa = math.exp(min(max(more, -LARGEST_LOG), LARGEST_LOG))
            kappa_w = kappa * slope
        if regime == ON_UNLOADING:
            kappa *= s[RATIO]
            kappa_w *= s[RATIO]
    coupling, stiff, damped, from_rest = s[K] * z[Y] + s[C] * closing, s[K], s[C], 0.0
    if active[SPRING]:
        more, slope = _look(tables, axes, SPRING, z[Y])
        coupling += more
        stiff += slope
    if active[SPRING_FROM_REST]:
        more, from_rest = _look(tables, axes, SPRING_FROM_REST, z[Y] - s[F_B] / s[K])
        coupling += more
        stiff += from_rest
    if active[DAMPER]:
        more, slope = _look(tables, axes, DAMPER, closing)
        coupling += more
        damped += slope
    held1, held1_v, held2, held2_v = 0.0, 0.0, 0.0, 0.0
    if active[GUIDE]:
        held1, held1_v = _look(tables, axes, GUIDE, z[V1])
    if active[INDENTER]:
        held2, held2_v = _look(tables, axes, INDENTER, z[V2])
    turned = theta + s[PHASE]
    shape, shape_v = math.sin(turned), math.cos(turned)
    if active[WAVEFORM]:
        around = theta - 2.0 * math.pi * math.floor(theta / (2.0 * math.pi))
        more, slope = _look(tables, axes, WAVEFORM, around)
        shape += more
        shape_v += slope
    drive, bent = s[F_A] * shape, 1.0
    if active[DRIVE]:
        more, slope = _look(tables, axes, DRIVE, drive)
        drive += more
        bent += slope
    push1, push2 = s[F_B] - z[Q] - coupling - held1, drive + coupling - rock - held2
    if wave.turn[0] > 0.0:
        turned = wave.turn[0] * time
        push1 += wave.sine[0] * math.sin(turned) + wave.cosine[0] * math.cos(turned)
    if wave.turn[1] > 0.0:
        turned = wave.turn[1] * time
        push2 += wave.sine[1] * math.sin(turned) + wave.cosine[1] * math.cos(turned)
    f[Y], f[V1], f[V2], f[W] = closing, push1 / s[M1], push2 / s[M2], kappa * into
    mounted, mounted_u, mounted_v = 0.0, 0.0, 0.0
    if active[MOUNT_SPRING]:
        mounted, mounted_u = _look(tables, axes, MOUNT_SPRING, z[U])
    if active[MOUNT_DAMPER]:
        more, mounted_v = _look(tables, axes, MOUNT_DAMPER, z[UD])
        mounted += more
    f[U] = z[UD]
    f[UD] = s[MOUNT_GAIN] * rock - s[MOUNT_SQUARE] * z[U] - s[MOUNT_DAMPING] * z[UD] - mounted
    f[Q] = s[AIR_STIFFNESS] * z[V1] - s[AIR_RATE] * z[Q]
    d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7] = rock_w, rock_v, stiff, damped, held1_v, held2_v, kappa, kappa_w
    d[8], d[9], d[10], d[11], d[12], d[13] = factor, rate, bent, shape, shape_v, from_rest
    d[14], d[15] = mounted_u, mounted_v
    return rock


@njit(cache=True, error_model="numpy", forceinline=True)
def _jacobian(z, s, d, j):
    """(7, 7) derivative of the rates by the states, from what :func:`_rates` left in d."""
    j[:] = 0.0
    j[Y, V1], j[Y, V2] = 1.0, -1.0
    j[V1, Y], j[V1, V1], j[V1, V2], j[V1, Q] = -d[2] / s[M1], -(d[3] + d[4]) / s[M1], d[3] / s[M1], -1.0 / s[M1]
    j[V2, Y], j[V2, V1], j[V2, V2] = d[2] / s[M2], d[3] / s[M2], -(d[3] + d[5] + d[1]) / s[M2]
    j[V2, W], j[V2, UD] = -d[0] / s[M2], d[1] / s[M2]
    j[W, V2], j[W, UD], j[W, W] = d[6], -d[6], (z[V2] - z[UD]) * d[7]
    j[U, UD] = 1.0
    j[UD, U], j[UD, UD] = -s[MOUNT_SQUARE] - d[14], -s[MOUNT_DAMPING] - s[MOUNT_GAIN] * d[1] - d[15]
    j[UD, W], j[UD, V2] = s[MOUNT_GAIN] * d[0], s[MOUNT_GAIN] * d[1]
    j[Q, V1], j[Q, Q] = s[AIR_STIFFNESS], -s[AIR_RATE]


@njit(cache=True, error_model="numpy", forceinline=True)
def _forcings(z, f, rock, theta, regime, impacts, s, axes, wanted, d, scalar, scalar_rock, curve, curve_rock, at):
    """By what scalars and curves change the rates, at fixed states, and the rock's force.

    scalar (SCALARS, 7), scalar_rock (SCALARS,); curve (PLACES, 7) and curve_rock (PLACES,) for a curve larger by 1 at
    its present argument, at (PLACES,) the position of that argument in the table.
    """
    m1, m2, into, closing = s[M1], s[M2], z[V2] - z[UD], z[V1] - z[V2]
    touching = regime != FLIGHT and rock > 0.0
    scalar[:] = 0.0
    scalar_rock[:] = 0.0
    scalar[M1, V1] = -f[V1] / m1
    scalar[M2, V2] = -f[V2] / m2
    # with k and F_b the shortening at rest changes, and with it the curve beyond it
    by_k, by_push = z[Y] + d[13] * s[F_B] / s[K] ** 2, -d[13] / s[K]
    scalar[K, V1], scalar[K, V2] = -by_k / m1, by_k / m2
    scalar[C, V1], scalar[C, V2] = -closing / m1, closing / m2
    scalar[F_A, V2] = d[11] * d[10] / m2
    scalar[PHASE, V2] = s[F_A] * d[12] * d[10] / m2
    scalar[F_B, V1], scalar[F_B, V2] = (1.0 - by_push) / m1, by_push / m2
    if touching:
        scalar_rock[K_L] = d[8] * d[9] * z[W]
    if regime == ON_UNLOADING:
        scalar[RATIO, W] = d[6] / s[RATIO] * into
    scalar[MOUNT_GAIN, UD], scalar[MOUNT_SQUARE, UD], scalar[MOUNT_DAMPING, UD] = rock, -z[U], -z[UD]
    scalar[AIR_STIFFNESS, Q], scalar[AIR_RATE, Q] = z[V1], -z[Q]
    scalar[K_L, V2] = -scalar_rock[K_L] / m2
    scalar[K_L, UD] = s[MOUNT_GAIN] * scalar_rock[K_L]
    curve[:] = 0.0
    curve_rock[:] = 0.0
    if regime == ON_LOADING:
        curve[LOADING, W] = into * d[6]
    if regime == ON_UNLOADING:
        curve[UNLOADING, W] = into * d[6]
    if touching:
        curve_rock[RATE_FACTOR] = s[K_L] * d[8] * z[W]
        curve_rock[RATE_FORCE] = 1.0
        curve_rock[COMPACTION] = s[K_L] * d[9] * z[W]
        for place in (RATE_FACTOR, RATE_FORCE, COMPACTION):
            curve[place, V2] = -curve_rock[place] / m2
            curve[place, UD] = s[MOUNT_GAIN] * curve_rock[place]
    for place in (SPRING, SPRING_FROM_REST, DAMPER):
        curve[place, V1], curve[place, V2] = -1.0 / m1, 1.0 / m2
    curve[GUIDE, V1] = -1.0 / m1
    curve[INDENTER, V2] = -1.0 / m2
    curve[WAVEFORM, V2] = s[F_A] * d[10] / m2
    curve[DRIVE, V2] = 1.0 / m2
    curve[MOUNT_SPRING, UD] = -1.0
    curve[MOUNT_DAMPER, UD] = -1.0
    for place in range(PLACES):
        if not wanted[place]:
            continue
        if place in (LOADING, UNLOADING):
            x = max(z[W], 0.0)
        elif place in (RATE_FACTOR, RATE_FORCE):
            x = into
        elif place == COMPACTION:
            x = impacts
        elif place == SPRING:
            x = z[Y]
        elif place == SPRING_FROM_REST:
            x = z[Y] - s[F_B] / s[K]
        elif place == DAMPER:
            x = closing
        elif place == GUIDE:
            x = z[V1]
        elif place == INDENTER:
            x = z[V2]
        elif place == WAVEFORM:
            x = theta - 2.0 * math.pi * math.floor(theta / (2.0 * math.pi))
        elif place == MOUNT_SPRING:
            x = z[U]
        elif place == MOUNT_DAMPER:
            x = z[UD]
        else:
            x = s[F_A] * d[11]
        at[place] = _at(axes, place, x)


@njit(cache=True, error_model="numpy", forceinline=True)
def _fill(columns, z, f, rock, d, theta, time, regime, impacts, s, axes, wanted, store, force, force_rock):
    """How each column changes the rates at the state z, into force (columns, 7), and the rock's force (columns,)."""
    scalar, scalar_rock, curve, curve_rock, at = store
    _forcings(z, f, rock, theta, regime, impacts, s, axes, wanted, d, scalar, scalar_rock, curve, curve_rock, at)
    for j in range(columns.kind.size):
        kind = columns.kind[j]
        if kind >= 0:
            for i in range(STATES):
                force[j, i] = scalar[kind, i]
            force_rock[j] = scalar_rock[kind]
        elif kind == CURVE:
            place = columns.place[j]
            i = _cell(at[place])
            value = columns.table[j, i] + (at[place] - i) * (columns.table[j, i + 1] - columns.table[j, i])
            for i in range(STATES):
                force[j, i] = value * curve[place, i]
            force_rock[j] = value * curve_rock[place]
        else:
            turned = columns.turn[j] * time
            value = math.cos(turned) if columns.code[j] % 2 else math.sin(turned)
            if columns.code[j] >= 2:
                value *= time
            force[j] = 0.0
            force_rock[j] = 0.0
            if kind == ON_SHAKER:
                force[j, V1] = value / s[M1]
            elif kind == ON_INDENTER:
                force[j, V2] = value / s[M2]
            elif rock > 0.0:
                force_rock[j] = s[K_L] * d[9] * z[W] * value
                force[j, V2], force[j, UD] = -force_rock[j] / s[M2], s[MOUNT_GAIN] * force_rock[j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _crossed(z, regime):
    """Whether the state has gone past the end of its regime."""
    if regime == FLIGHT:
        return z[W] > 0.0
    into = z[V2] - z[UD]
    if regime == ON_LOADING:
        return into < 0.0 or z[W] < 0.0
    return into > 0.0 or z[W] < 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _multiply(a, b, size, out):
    for i in range(size):
        for k in range(size):
            total = 0.0
            for j in range(size):
                total += a[i, j] * b[j, k]
            out[i, k] = total


@njit(cache=True, error_model="numpy", forceinline=True)
def _step(z, f, theta, time, omega, h, regime, impacts, s, tables, axes, active, wave, work, ahead, middle, halfway):
    """A step of the classical Runge-Kutta method from z (rates f) into ahead.

    ``middle`` is the state halfway, and ``halfway`` what :func:`_rates` says of it.
    """
    d = work[5]
    for i in range(STATES):
        work[4, i] = z[i] + 0.5 * h * f[i]
    _rates(work[4], theta + 0.5 * h * omega, time + 0.5 * h, regime, impacts, s, tables, axes, active, wave, work[1], d)
    for i in range(STATES):
        middle[i] = z[i] + 0.5 * h * work[1, i]
    _rates(middle, theta + 0.5 * h * omega, time + 0.5 * h, regime, impacts, s, tables, axes, active, wave, work[2],
           halfway)  # fmt: skip
    for i in range(STATES):
        work[4, i] = z[i] + h * work[2, i]
    _rates(work[4], theta + h * omega, time + h, regime, impacts, s, tables, axes, active, wave, work[3], d)
    for i in range(STATES):
        ahead[i] = z[i] + h / 6.0 * (f[i] + 2.0 * work[1, i] + 2.0 * work[2, i] + work[3, i])


@njit(cache=True, error_model="numpy", forceinline=True)
def _transition(h, size, phi, work):
    """Transition matrix of the variational equations of the first ``size`` states over a step, into phi.

    ``work`` (6, 7, 7) begins with the Jacobians at the beginning, halfway and at the end.
    """
    j0, jm, j1, k1, k2, k3 = work[0], work[1], work[2], work[3], work[4], work[5]
    _multiply(jm, j0, size, k1)
    for i in range(size):
        for k in range(size):
            k1[i, k] = jm[i, k] + 0.5 * h * k1[i, k]
    _multiply(jm, k1, size, k2)
    for i in range(size):
        for k in range(size):
            k2[i, k] = jm[i, k] + 0.5 * h * k2[i, k]
    _multiply(j1, k2, size, k3)
    for i in range(size):
        for k in range(size):
            k3[i, k] = j1[i, k] + h * k3[i, k]
            phi[i, k] = h / 6.0 * (j0[i, k] + 2.0 * k1[i, k] + 2.0 * k2[i, k] + k3[i, k])
        phi[i, i] += 1.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _event(z, f, theta, time, omega, h, regime, impacts, s, tables, axes, active, wave, work, ahead, middle, halfway):
    """Length of the step that ends at the switch; ahead holds the state after h, and then that at the switch.

    By the Illinois variant of regula falsi, and by bisection where both the depth and the speed have changed sign. A
    step that begins on the guard, as each flight does at its departure, has a root there, which is divided out
    (deflation).
    """
    by_depth = regime == FLIGHT or ahead[W] < 0.0
    low, high = 0.0, h
    before, after = (z[W], ahead[W]) if by_depth else (z[V2] - z[UD], ahead[V2] - ahead[UD])
    least = 1e-14 if by_depth else 1e-11
    deflate = abs(before) < least
    if deflate:
        before, after = (f[W] if by_depth else f[V2] - f[UD]), after / h
        least = 1e-9 * abs(before)
    turned = (ahead[V2] - ahead[UD]) * (1.0 if regime == ON_LOADING else -1.0) < 0.0
    falsi = before * after < 0.0 and not (by_depth and regime != FLIGHT and turned)
    part, value = h, after
    for _ in range(60):
        previous = value
        part = (low * after - high * before) / (after - before) if falsi else 0.5 * (low + high)
        _step(z, f, theta, time, omega, part, regime, impacts, s, tables, axes, active, wave, work, ahead, middle,
              halfway)  # fmt: skip
        value = ahead[W] if by_depth else ahead[V2] - ahead[UD]
        if deflate:
            value /= part
        if high - low < 1e-13 or (falsi and abs(value) < least):
            break
        if _crossed(ahead, regime):
            high = part
            after, before = value, before * (0.5 if value * previous > 0.0 else 1.0)
        else:
            low = part
            before, after = value, after * (0.5 if value * previous > 0.0 else 1.0)
    if not falsi:
        part = high
        _step(z, f, theta, time, omega, part, regime, impacts, s, tables, axes, active, wave, work, ahead, middle,
              halfway)  # fmt: skip
    elif by_depth:
        ahead[W] = 0.0
    return part


@njit(cache=True, error_model="numpy", forceinline=True)
def _advance(sens, states, force, force_next, h, size, phi, row):
    """Carry the sensitivities sens (states + columns, 7) over a step, forcings by the trapezoidal rule."""
    for j in range(sens.shape[0]):
        own = sens[j]
        if j < states:
            for i in range(size):
                row[i] = own[i]
        else:
            for i in range(size):
                row[i] = own[i] + 0.5 * h * force[j - states, i]
        for i in range(size):
            total = 0.0
            for k in range(size):
                total += phi[i, k] * row[k]
            own[i] = total
        if j >= states:
            for i in range(size):
                own[i] += 0.5 * h * force_next[j - states, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def _saltate(z, theta, time, before, after, impacts, s, tables, axes, active, wave, sens, d):
    """Jump of the sensitivities where the regime changes at the state z."""
    f0, f1 = np.empty(STATES), np.empty(STATES)
    _rates(z, theta, time, before, impacts, s, tables, axes, active, wave, f0, d)
    _rates(z, theta, time, after, impacts, s, tables, axes, active, wave, f1, d)
    normal = before == FLIGHT or after == FLIGHT
    speed = f0[W] if normal else f0[V2] - f0[UD]
    least = GRAZING if normal else 0.0
    if abs(speed) < 1e-12:
        return
    for j in range(sens.shape[0]):
        off = sens[j, W] if normal else sens[j, V2] - sens[j, UD]
        share = off * speed / (speed * speed + least * least)
        for i in range(STATES):
            sens[j, i] += (f1[i] - f0[i]) * share


@njit(cache=True, error_model="numpy", forceinline=True)
def _read(sens, states, d, s, force, force_rock, out):
    """Derivatives of the rock's force and of the indenter's acceleration, into out (2, states + columns)."""
    row_v, row_u = -(d[3] + d[5] + d[1]) / s[M2], d[1] / s[M2]
    for j in range(sens.shape[0]):
        by_rock = d[0] * sens[j, W] + d[1] * (sens[j, V2] - sens[j, UD])
        by_speed = (d[2] * sens[j, Y] + d[3] * sens[j, V1] - d[0] * sens[j, W]) / s[M2]
        by_speed += row_v * sens[j, V2] + row_u * sens[j, UD]
        if j >= states:
            by_rock += force_rock[j - states]
            by_speed += force[j - states, V2]
        out[0, j], out[1, j] = by_rock, by_speed


@njit(cache=True, error_model="numpy", forceinline=True)
def _changes(z, f, rock, time, omega, s, d, wave, out):
    """The rock's force, the indenter's acceleration, and how fast both change, into out (4,)."""
    out[0], out[1] = rock, f[V2]
    out[2] = d[0] * f[W] + d[1] * (f[V2] - f[UD])
    if wave.turn[2] > 0.0 and rock > 0.0:
        turned = wave.turn[2] * time
        swing = wave.turn[2] * (wave.sine[2] * math.cos(turned) - wave.cosine[2] * math.sin(turned))
        out[2] += s[K_L] * d[9] * z[W] * swing
    pushed = s[F_A] * d[12] * d[10] * omega
    if wave.turn[1] > 0.0:
        turned = wave.turn[1] * time
        pushed += wave.turn[1] * (wave.sine[1] * math.cos(turned) - wave.cosine[1] * math.sin(turned))
    out[3] = (pushed + d[2] * f[Y] + d[3] * (f[V1] - f[V2]) - out[2] - d[5] * f[V2]) / s[M2]


@njit(cache=True, error_model="numpy", forceinline=True)
def _fastest(z, s, d):
    """The fastest rate (1/s) of the laws that act: decay, or three times the angular frequency of rock or mount."""
    decay = max(abs(d[7] * (z[V2] - z[UD])), abs(d[4]) / s[M1], abs(d[5]) / s[M2], abs(d[15]))
    rock = abs(d[0] * d[6])
    turning = max(rock / s[M2], s[MOUNT_SQUARE] + abs(d[14]) + s[MOUNT_GAIN] * rock)
    return max(decay, 3.0 * math.sqrt(turning))


@njit(cache=True, error_model="numpy", forceinline=True)
def _record(sample, last, step, elapsed, taken, n, now, then, slopes, slopes_then, states, said, by_state, by_column):
    """Write the samples that lie in a step, signals by cubic Hermite interpolation and derivatives linearly.

    The step is from ``elapsed`` after sample n, and ``taken`` long. Returns the first sample that lies behind it.
    """
    while sample < last and (sample - n) * step < elapsed + taken - 1e-12:
        share = max((sample - n) * step - elapsed, 0.0) / taken
        rest = 1.0 - share
        for i in range(2):
            straight = then[i] - now[i]
            bend = rest * (now[2 + i] * taken - straight) - share * (then[2 + i] * taken - straight)
            said[i, sample] = now[i] + share * straight + share * rest * bend
            for j in range(states):
                by_state[i, j, sample] = rest * slopes[i, j] + share * slopes_then[i, j]
            for j in range(by_column.shape[1]):
                by_column[i, j, sample] = rest * slopes[i, states + j] + share * slopes_then[i, states + j]
        sample += 1
    return sample


@njit(cache=True, nogil=True, error_model="numpy")
def run(starts, begin, chained, rate, stride, omega, phase, impacts, s, tables, axes, active, wanted, wave, columns,
        states, size, path, said, by_state, by_column, ends, ends_by_state, ends_by_column):  # fmt: skip
    """Simulate every window, with the sensitivities asked for.

    Args:
        starts: (windows + 1,) samples.
        begin: (windows, 7) states at the beginning of each.
        chained: Whether all but speed and distance of the indenter go on from the window before; ``begin`` then says
            at the end what they began with.
        rate, stride: Samples a second, and how many of them a step of the integrator takes at most.
        omega, phase: rad/s of the excitation, rad at sample 0.
        impacts: Before sample 0, on this face of the rock.
        s, tables, axes, active, wanted, wave: The model; ``active`` (PLACES,) whose tables are not zero, ``wanted``
            those by which it is differentiated.
        columns, states: By what, and by how many of the states in their order.
        size: How many of the states take part: 4, or all where there is a mount or air.
        path: (7, n // stride) for the states at every sample that stride divides, which all starts are; or (7, 0).
        said: (2, n) force and acceleration, written from the first start to the last.
        by_state, by_column: (2, states, n) and (2, columns, n), their derivatives by the states at the beginning of the
            same window, and by columns.
        ends, ends_by_state, ends_by_column: (windows, 7), (windows, states, 7), (windows, columns, 7).

    Returns:
        Impacts at the end, or ``DIVERGED`` or ``STUCK``.
    """
    count = columns.kind.size
    sensitive = states + count > 0
    z, ahead, middle, f, f1 = np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    work, jac, phi = np.empty((6, SAID)), np.empty((6, 7, 7)), np.empty((7, 7))
    d, d1, halfway, row = np.empty(SAID), np.empty(SAID), np.empty(SAID), np.empty(7)
    sens = np.zeros((states + count, 7))
    scalar, scalar_rock = np.zeros((SCALARS, 7)), np.zeros(SCALARS)
    curve, curve_rock, at = np.zeros((PLACES, 7)), np.zeros(PLACES), np.zeros(PLACES)
    store = (scalar, scalar_rock, curve, curve_rock, at)
    force, force_rock = np.zeros((count, 7)), np.zeros(count)
    force_next, force_rock_next = np.zeros((count, 7)), np.zeros(count)
    now, then = np.zeros(4), np.zeros(4)
    slopes, slopes_then = np.zeros((2, states + count)), np.zeros((2, states + count))
    h = 1.0 / rate
    # the rock's stiffness goes by the impacts before a contact, and does not change within it
    made = impacts
    for window in range(starts.size - 1):
        for i in range(STATES):
            if chained and window > 0 and i != V2 and i != W:
                begin[window, i] = z[i]
            z[i] = begin[window, i]
        regime = FLIGHT if z[W] < 0.0 else ON_LOADING if z[V2] - z[UD] >= 0.0 else ON_UNLOADING
        sens[:] = 0.0
        for i in range(states):
            sens[i, i] = 1.0
        t0 = starts[window] / rate
        theta = phase + omega * t0
        rock = _rates(z, theta, t0, regime, impacts, s, tables, axes, active, wave, f, d)
        if count > 0:
            _fill(columns, z, f, rock, d, theta, t0, regime, impacts, s, axes, wanted, store, force, force_rock)
        _changes(z, f, rock, t0, omega, s, d, wave, now)
        if sensitive:
            _read(sens, states, d, s, force, force_rock, slopes)
        for n in range(starts[window], starts[window + 1], stride):
            last = min(n + stride, starts[window + 1])
            for i in range(STATES if path.shape[1] > 0 else 0):
                path[i, n // stride] = z[i]
            sample, left = n, (last - n) * h
            for _ in range(MOST_PARTS):
                elapsed = (last - n) * h - left
                t0 = n / rate + elapsed
                angle = phase + omega * t0
                taken = left / math.ceil(min(left * _fastest(z, s, d) / STIFF, FINEST_PART * left / h) + 1e-9)
                _step(z, f, angle, t0, omega, taken, regime, impacts, s, tables, axes, active, wave, work, ahead,
                      middle, halfway)  # fmt: skip
                switched = _crossed(ahead, regime)
                if switched:
                    taken = _event(z, f, angle, t0, omega, taken, regime, impacts, s, tables, axes, active, wave,
                                   work, ahead, middle, halfway)  # fmt: skip
                rock = _rates(ahead, angle + omega * taken, t0 + taken, regime, impacts, s, tables, axes, active,
                              wave, f1, d1)  # fmt: skip
                _changes(ahead, f1, rock, t0 + taken, omega, s, d1, wave, then)
                if sensitive:
                    _jacobian(z, s, d, jac[0])
                    _jacobian(middle, s, halfway, jac[1])
                    _jacobian(ahead, s, d1, jac[2])
                    _transition(taken, size, phi, jac)
                    if count > 0:
                        _fill(columns, ahead, f1, rock, d1, angle + omega * taken, t0 + taken, regime, impacts, s,
                              axes, wanted, store, force_next, force_rock_next)  # fmt: skip
                    _advance(sens, states, force, force_next, taken, size, phi, row)
                    force, force_next = force_next, force
                    force_rock, force_rock_next = force_rock_next, force_rock
                    _read(sens, states, d1, s, force, force_rock, slopes_then)
                if taken > 0.0:
                    sample = _record(sample, last, h, elapsed, taken, n, now, then, slopes, slopes_then, states, said,
                                     by_state, by_column)  # fmt: skip
                z, ahead = ahead, z
                f, f1 = f1, f
                d, d1 = d1, d
                now, then = then, now
                slopes, slopes_then = slopes_then, slopes
                t0 += taken
                left -= taken
                if switched:
                    before = regime
                    if before == FLIGHT:
                        regime = ON_LOADING
                        impacts = made
                    elif z[W] <= 0.0:
                        regime = FLIGHT
                    elif before == ON_LOADING:
                        regime = ON_UNLOADING
                        made += 1.0
                    else:
                        regime = ON_LOADING
                    angle = phase + omega * t0
                    if sensitive:
                        _saltate(z, angle, t0, before, regime, impacts, s, tables, axes, active, wave, sens, d)
                    if regime == FLIGHT or before == FLIGHT:
                        z[W] = 0.0
                    rock = _rates(z, angle, t0, regime, impacts, s, tables, axes, active, wave, f, d)
                    if count > 0:
                        _fill(columns, z, f, rock, d, angle, t0, regime, impacts, s, axes, wanted, store, force,
                              force_rock)  # fmt: skip
                    _changes(z, f, rock, t0, omega, s, d, wave, now)
                    if sensitive:
                        _read(sens, states, d, s, force, force_rock, slopes)
                if left <= 1e-13:
                    break
            if left > 1e-13:
                return STUCK
            if not abs(z[V2]) < 100.0:
                return DIVERGED
            while sample < last:
                # a sample that rounding puts just behind the end of the step
                for i in range(2):
                    said[i, sample] = now[i]
                sample += 1
        for i in range(STATES):
            ends[window, i] = z[i]
            for j in range(states):
                ends_by_state[window, j, i] = sens[j, i]
            for j in range(count):
                ends_by_column[window, j, i] = sens[states + j, i]
    return made
