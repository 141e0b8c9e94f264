"""The closed-form flow of each regime of the linear rock law (Section 3 of the paper, n_l = n_u = 1).

State of the rig, in SI: ``z = (y, v1, v2, w)`` with the spring's shortening ``y = X1 - X2``, the two speeds, and
``w``, the indenter's place behind its moving origin ``O``: ``X2 = O + w``. The origin is Xf out of contact and while
unloading, and Xp while loading, so that the rock force is ``stiffness * w`` in each regime and nothing in ``z`` drifts,
however far the rig has drilled. Between switches

    y'  = v1 - v2
    v1' = (F_b - k y - c y') / m1
    v2' = (F_a sin(theta) + k y + c y' - kappa w) / m2,    theta' = omega
    w'  = v2

with kappa = 0, k_l or k_u. Each regime is solved exactly: a forced part, and two pairs of modes. A pair with decay
rate ``sigma`` and ``split = sigma^2 - (natural frequency)^2`` moves as ``exp(-sigma t) (u C + v S)``, where C and S are
cos and sin over a frequency, or cosh and sinh over a rate, by the sign of ``split``; written like this nothing breaks
down at critical damping.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.checks import InputError
from drillenv.dynamics.compiled import ALLOCATING, INLINED, INNER, KERNEL
from drillenv.dynamics.fused import fma
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

FREE, LOADING, UNLOADING = 0, 1, 2
"""The regimes: no contact, loading, unloading."""


# A model is one float64 array: a rig on a rock at a setting, made ready for the kernels. It holds numbers only, so that
# it copies, pickles and stacks into batches as it is, and costs the kernels no reference counting. The first row is for
# the rig and the flight, the rows LOADING and UNLOADING for the contact. Where things stand in the first row:
M1, M2, K, C, OMEGA, AMPLITUDE, STATIC = range(7)
"""Masses in kg, stiffness in N/m, damping in N s/m, excitation in rad/s, F_a and F_b in N."""
SHARE, SWING = 7, 8
"""m1 / (m1 + m2), and the amplitude F_a / ((m1 + m2) omega) of the speed of the centre of mass in flight."""
RELATIVE = 9
"""Decay, split and root of the pair of modes of y in flight."""
FREE_Y = 12
"""Constant, sine and cosine part of y in flight."""
# ... and in the row of a contact regime:
STIFFNESS, STEP, FAST, SLOW = 0, 1, 2, 5
"""kappa; the first step of the search for a switch in s; decay, split, root of the fast pair (mostly the indenter on
the rock) and of the slow pair (the shaker behind it)."""
FORCED = 8
"""Constant, sine and cosine part of z, four numbers each."""
FAST_COSINE, FAST_SINE, SLOW_SINE = 20, 36, 52
"""(4, 4) matrices, column by column, that take a free state to u of the fast pair (the slow pair has the rest), v of
the fast pair and v of the slow pair."""
MODEL_SHAPE = (3, 68)


@njit(**INNER)
def set_pair(linear: float, constant: float, out: np.ndarray) -> None:
    """Write decay, split and root of the roots of s^2 + linear s + constant."""
    split = 0.25 * linear * linear - constant
    out[0], out[1], out[2] = 0.5 * linear, split, math.sqrt(abs(split))


@njit(**ALLOCATING)
def set_contact(m1: float, m2: float, k: float, c: float, kappa: float, block: np.ndarray) -> bool:
    """Write the modes of a contact of stiffness ``kappa``. False where the two pairs of modes run together."""
    # characteristic polynomial s^4 + b3 s^3 + b2 s^2 + b1 s + b0
    b3 = c / m1 + c / m2
    b2 = (k + kappa) / m2 + k / m1
    b1 = c * kappa / (m1 * m2)
    b0 = k * kappa / (m1 * m2)
    # Bairstow's iteration for the slow factor s^2 + a s + e, from the shaker alone on a rigid rock
    a, e = c / m1, k / m1
    q1 = q0 = 0.0
    ok = False
    for _ in range(200):
        q1 = b3 - a
        q0 = b2 - e - a * q1
        r1 = b1 - e * q1 - a * q0
        r0 = b0 - e * q0
        r1_a = e - q0 + a * (q1 - a)
        r1_e = a - q1
        r0_a = e * (q1 - a)
        r0_e = e - q0
        determinant = r1_a * r0_e - r1_e * r0_a
        da = (r1_e * r0 - r0_e * r1) / determinant
        de = (r0_a * r1 - r1_a * r0) / determinant
        a += da
        e += de
        # the last digits may keep flickering
        ok = abs(da) <= 1e-13 * abs(a) and abs(de) <= 1e-13 * abs(e)
        if ok and abs(da) <= 1e-15 * abs(a) and abs(de) <= 1e-15 * abs(e):
            break
    q1 = b3 - a
    q0 = b2 - e - a * q1
    # projector on the fast pair: (alpha A + beta) (A^2 + a A + e), which is 1 on the fast and 0 on the slow modes
    d, g = a - q1, e - q0
    resultant = d * d * q0 - d * g * q1 + g * g
    ok = ok and resultant > 1e-6 * (q0 * q0 + g * g)
    alpha, beta = -d / resultant, (g - d * q1) / resultant
    flow = np.zeros((4, 4))
    flow[0, 1], flow[0, 2] = 1.0, -1.0
    flow[1, 0], flow[1, 1], flow[1, 2] = -k / m1, -c / m1, c / m1
    flow[2, 0], flow[2, 1], flow[2, 2], flow[2, 3] = k / m2, c / m2, -c / m2, -kappa / m2
    flow[3, 2] = 1.0
    one = np.eye(4)
    projector = _times(alpha * flow + beta * one, _times(flow, flow) + a * flow + e * one)
    # one step of purification takes the rounding out of the projector
    square = _times(projector, projector)
    projector = 3.0 * square - 2.0 * _times(square, projector)
    set_pair(q1, q0, block[FAST:])
    set_pair(a, e, block[SLOW:])
    fast_sine = _times(flow + 0.5 * q1 * one, projector)
    slow_sine = _times(flow + 0.5 * a * one, one - projector)
    for i in range(4):
        for j in range(4):
            block[FAST_COSINE + 4 * j + i] = projector[i, j]
            block[FAST_SINE + 4 * j + i] = fast_sine[i, j]
            block[SLOW_SINE + 4 * j + i] = slow_sine[i, j]
    block[STIFFNESS] = kappa
    block[STEP] = 2.6 / quickest(block[FAST], block[FAST + 1], block[FAST + 2])
    return ok


@njit(**INLINED)
def quickest(decay: float, split: float, root: float) -> float:
    """The largest absolute value of the two roots of a pair, in 1/s."""
    return decay + root if split > 0.0 else math.sqrt(decay * decay - split)


@njit(**ALLOCATING)
def _times(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Matrix product of two small matrices, without BLAS."""
    n = left.shape[0]
    result = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for m in range(n):
                result[i, j] += left[i, m] * right[m, j]
    return result


@njit(**KERNEL)
def set_plant(m1: float, m2: float, k: float, c: float, kl: float, ku: float, model: np.ndarray) -> bool:
    """Write a rig on a rock into a model. Where it returns False the hybrid engine has to do the work."""
    mass = m1 * m2 / (m1 + m2)
    model[0, M1], model[0, M2], model[0, K], model[0, C] = m1, m2, k, c
    model[0, SHARE] = m1 / (m1 + m2)
    set_pair(c / mass, k / mass, model[0, RELATIVE:])
    first = set_contact(m1, m2, k, c, kl, model[LOADING])
    second = set_contact(m1, m2, k, c, ku, model[UNLOADING])
    return first and second


@njit(**KERNEL)
def set_drive(omega: float, amplitude: float, static: float, model: np.ndarray) -> None:
    """Write a setting into a model that holds a plant: excitation in rad/s, F_a and F_b in N."""
    m1, m2, k, c = model[0, M1], model[0, M2], model[0, K], model[0, C]
    mass = m1 * m2 / (m1 + m2)
    model[0, OMEGA], model[0, AMPLITUDE], model[0, STATIC] = omega, amplitude, static
    model[0, SWING] = amplitude / ((m1 + m2) * omega)
    swing = -(amplitude / m2) / complex(k / mass - omega * omega, omega * c / mass)
    model[0, FREE_Y], model[0, FREE_Y + 1], model[0, FREE_Y + 2] = static * mass / (m1 * k), swing.real, swing.imag
    coupling = complex(k, c * omega)
    for regime in (LOADING, UNLOADING):
        row = model[regime]
        kappa = row[STIFFNESS]
        shaker = coupling - m1 * omega * omega
        indenter = coupling + kappa - m2 * omega * omega
        w = amplitude * shaker / (shaker * indenter - coupling * coupling)
        x = w * coupling / shaker
        level, sine, cosine = FORCED, FORCED + 4, FORCED + 8
        row[level], row[level + 1], row[level + 2], row[level + 3] = static / k, 0.0, 0.0, static / kappa
        # the motion is the imaginary part of amplitude * exp(i theta)
        row[sine], row[cosine] = (x - w).real, (x - w).imag
        row[sine + 1], row[cosine + 1] = -omega * x.imag, omega * x.real
        row[sine + 2], row[cosine + 2] = -omega * w.imag, omega * w.real
        row[sine + 3], row[cosine + 3] = w.real, w.imag


def make_model(rig: Rig, rock: Rock, setting: Setting) -> np.ndarray:
    """The model array (MODEL_SHAPE) of a rig on a rock at a setting.

    Raises:
        InputError: the rig's two modes in contact run together, which the closed form cannot take apart.
    """
    model = np.zeros(MODEL_SHAPE)
    ok = set_plant(
        rig.shaker_mass,
        rig.indenter_mass,
        rig.stiffness,
        rig.damping,
        rock.loading_stiffness,
        rock.unloading_stiffness,
        model,
    )
    if not ok:
        raise InputError(
            "the two modes of this rig in contact are too close for the exact engine (a percussive rig has a light "
            "indenter on a stiff rock and a heavy shaker on a soft spring): use simulate(..., engine='hybrid')"
        )
    set_drive(2 * math.pi * setting.frequency, rig.drive_force(setting), rig.static_force(setting), model)
    return model


@njit(**INLINED)
def sine_cosine(x: float) -> tuple[float, float]:
    """sin x and cos x to the last bit or two for abs(x) < 1e5, at half the cost of two calls of the C library.

    Cody and Waite's reduction to [-pi/4, pi/4] and the kernels of Sun's fdlibm.
    """
    n = math.floor(fma(x, 0.6366197723675814, 0.5))
    r = fma(n, -6.07710050650619224932e-11, fma(n, -1.57079632673412561417, x))
    z = r * r
    sine = fma(z, fma(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08), 2.75573137070700676789e-06)
    sine = fma(z, fma(z, sine, -1.98412698298579493134e-04), 8.33333333332248946124e-03)
    sine = fma(r * z, fma(z, sine, -1.66666666666666324348e-01), r)
    cosine = fma(z, fma(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09), -2.75573143513906633035e-07)
    cosine = fma(z, fma(z, cosine, 2.48015872894767294178e-05), -1.38888888888741095749e-03)
    cosine = fma(z * z, fma(z, cosine, 4.16666666666666019037e-02), fma(z, -0.5, 1.0))
    quadrant = int(n) & 3
    if quadrant & 1:
        sine, cosine = cosine, sine
    if quadrant & 2:
        sine = -sine
    if (quadrant + 1) & 2:
        cosine = -cosine
    return sine, cosine


@njit(**INLINED)
def fall(x: float) -> float:
    """exp(-x), by its series where that is quicker: the slow pair hardly moves during a contact."""
    if abs(x) < 0.02:
        third = fma(x, fma(x, fma(x, fma(x, -1 / 5040, 1 / 720), -1 / 120), 1 / 24), -1 / 6)
        return fma(x, fma(x, fma(x, third, 1 / 2), -1.0), 1.0)
    return math.exp(-x)


@njit(**INLINED)
def pair_at(decay: float, split: float, root: float, t: float) -> tuple[float, float]:
    """exp(-decay t) C(t) and exp(-decay t) S(t) of a pair, with C'' = split C, C(0) = 1, S(0) = 0, S'(0) = 1."""
    x = split * t * t
    if abs(x) < 0.05:
        cosine = fma(x, fma(x, fma(x, fma(x, fma(x, 1 / 3628800, 1 / 40320), 1 / 720), 1 / 24), 1 / 2), 1.0)
        sine = t * fma(x, fma(x, fma(x, fma(x, fma(x, 1 / 39916800, 1 / 362880), 1 / 5040), 1 / 120), 1 / 6), 1.0)
        envelope = fall(decay * t)
        return envelope * cosine, envelope * sine
    if x < 0.0:
        sine, cosine = sine_cosine(root * t)
        envelope = math.exp(-decay * t)
        return envelope * cosine, envelope * sine / root
    # exponents first: cosh alone would overflow on a long flight
    up = 0.5 * math.exp((root - decay) * t)
    down = 0.5 * math.exp(-(root + decay) * t)
    return up + down, (up - down) / root


@njit(**INLINED)
def contact_coefficients(
    model: np.ndarray, regime: int, z: np.ndarray, sine: float, cosine: float, work: np.ndarray
) -> None:
    """Write u, v of the fast pair and u, v of the slow pair, for a contact that starts in ``z``, into ``work``."""
    h0 = z[0] - model[regime, FORCED] - sine * model[regime, FORCED + 4] - cosine * model[regime, FORCED + 8]
    h1 = z[1] - model[regime, FORCED + 1] - sine * model[regime, FORCED + 5] - cosine * model[regime, FORCED + 9]
    h2 = z[2] - model[regime, FORCED + 2] - sine * model[regime, FORCED + 6] - cosine * model[regime, FORCED + 10]
    h3 = z[3] - model[regime, FORCED + 3] - sine * model[regime, FORCED + 7] - cosine * model[regime, FORCED + 11]
    for i in range(4):
        p, q, r = FAST_COSINE + i, FAST_SINE + i, SLOW_SINE + i
        work[i] = (
            model[regime, p] * h0 + model[regime, p + 4] * h1 + model[regime, p + 8] * h2 + model[regime, p + 12] * h3
        )
        work[4 + i] = (
            model[regime, q] * h0 + model[regime, q + 4] * h1 + model[regime, q + 8] * h2 + model[regime, q + 12] * h3
        )
        work[12 + i] = (
            model[regime, r] * h0 + model[regime, r + 4] * h1 + model[regime, r + 8] * h2 + model[regime, r + 12] * h3
        )
    work[8] = h0 - work[0]
    work[9] = h1 - work[1]
    work[10] = h2 - work[2]
    work[11] = h3 - work[3]


@njit(**INLINED)
def contact_state(
    model: np.ndarray, regime: int, work: np.ndarray, sine: float, cosine: float, t: float, out: np.ndarray
) -> None:
    """The state a time ``t`` after the contact of ``work`` began; ``sine`` and ``cosine`` of the phase reached."""
    fc, fs = pair_at(model[regime, FAST], model[regime, FAST + 1], model[regime, FAST + 2], t)
    sc, ss = pair_at(model[regime, SLOW], model[regime, SLOW + 1], model[regime, SLOW + 2], t)
    for i in range(4):
        forced = (
            model[regime, FORCED + i] + sine * model[regime, FORCED + 4 + i] + cosine * model[regime, FORCED + 8 + i]
        )
        out[i] = fma(fc, work[i], fma(fs, work[4 + i], fma(sc, work[8 + i], fma(ss, work[12 + i], forced))))


@njit(**INLINED)
def free_coefficients(model: np.ndarray, z: np.ndarray, sine: float, cosine: float, work: np.ndarray) -> None:
    """Write the flight that starts in ``z`` into ``work``: [:3] the centre of mass, [3:5] u and v of y."""
    share, swing, omega = model[0, SHARE], model[0, SWING], model[0, OMEGA]
    work[0] = z[3] + share * z[0] + swing / omega * sine
    work[1] = share * z[1] + (1.0 - share) * z[2] + swing * cosine
    work[2] = model[0, STATIC] / (model[0, M1] + model[0, M2])
    u = z[0] - model[0, FREE_Y] - sine * model[0, FREE_Y + 1] - cosine * model[0, FREE_Y + 2]
    speed = z[1] - z[2] - omega * (cosine * model[0, FREE_Y + 1] - sine * model[0, FREE_Y + 2])
    work[3] = u
    work[4] = speed + model[0, RELATIVE] * u


@njit(**INLINED)
def free_state(model: np.ndarray, work: np.ndarray, sine: float, cosine: float, t: float, out: np.ndarray) -> None:
    """The state a time ``t`` after the flight of ``work`` began; ``sine`` and ``cosine`` of the phase reached."""
    share, swing, omega = model[0, SHARE], model[0, SWING], model[0, OMEGA]
    decay, split = model[0, RELATIVE], model[0, RELATIVE + 1]
    c, s = pair_at(decay, split, model[0, RELATIVE + 2], t)
    u, v = work[3], work[4]
    y = model[0, FREE_Y] + sine * model[0, FREE_Y + 1] + cosine * model[0, FREE_Y + 2] + c * u + s * v
    speed = omega * (cosine * model[0, FREE_Y + 1] - sine * model[0, FREE_Y + 2])
    speed += c * (v - decay * u) + s * (split * u - decay * v)
    centre = work[0] + t * (work[1] + 0.5 * t * work[2]) - swing / omega * sine
    centre_speed = work[1] + t * work[2] - swing * cosine
    out[0] = y
    out[1] = centre_speed + (1.0 - share) * speed
    out[2] = centre_speed - share * speed
    out[3] = centre - share * y


@njit(**INLINED)
def contact_matrix(model: np.ndarray, regime: int, t: float, out: np.ndarray) -> None:
    """(4, 4) derivative of the state after a time ``t`` in contact by the state before."""
    fc, fs = pair_at(model[regime, FAST], model[regime, FAST + 1], model[regime, FAST + 2], t)
    sc, ss = pair_at(model[regime, SLOW], model[regime, SLOW + 1], model[regime, SLOW + 2], t)
    for i in range(4):
        for j in range(4):
            n = 4 * j + i
            out[i, j] = (
                (fc - sc) * model[regime, n + FAST_COSINE]
                + fs * model[regime, n + FAST_SINE]
                + ss * model[regime, n + SLOW_SINE]
            )
        out[i, i] += sc


@njit(**INLINED)
def free_matrix(model: np.ndarray, t: float, out: np.ndarray) -> None:
    """(4, 4) derivative of the state after a time ``t`` in free flight by the state before."""
    decay, split = model[0, RELATIVE], model[0, RELATIVE + 1]
    c, s = pair_at(decay, split, model[0, RELATIVE + 2], t)
    first = model[0, SHARE]
    second = 1.0 - first
    y_y, y_speed = c + decay * s, s
    speed_y, speed_speed = (split - decay * decay) * s, c - decay * s
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = y_y, y_speed, -y_speed, 0.0
    out[1, 0] = second * speed_y
    out[1, 1] = first + second * speed_speed
    out[1, 2] = second - second * speed_speed
    out[1, 3] = 0.0
    out[2, 0] = -first * speed_y
    out[2, 1] = first - first * speed_speed
    out[2, 2] = second + first * speed_speed
    out[2, 3] = 0.0
    out[3, 0] = first * (1.0 - y_y)
    out[3, 1] = first * (t - y_speed)
    out[3, 2] = second * t + first * y_speed
    out[3, 3] = 1.0
