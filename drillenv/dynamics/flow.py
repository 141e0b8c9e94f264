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
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.checks import InputError
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

FREE, LOADING, UNLOADING = 0, 1, 2
"""The regimes: no contact, loading, unloading."""


class Pair(NamedTuple):
    """One pair of modes: roots ``-decay +- sqrt(split)``."""

    decay: float
    split: float
    root: float
    """sqrt(abs(split))."""


class Contact(NamedTuple):
    """Modes of one contact regime. ``fast`` is mostly the indenter on the rock, ``slow`` the shaker behind it."""

    stiffness: float
    fast: Pair
    slow: Pair
    fast_cosine: np.ndarray
    """(4, 4), takes a free state to ``u`` of the fast pair; the slow pair has the rest."""
    fast_sine: np.ndarray
    """(4, 4), takes a free state to ``v`` of the fast pair."""
    slow_sine: np.ndarray
    """(4, 4), takes a free state to ``v`` of the slow pair."""
    step: float
    """Longest step in s over which a switch is looked for at once."""


class Plant(NamedTuple):
    """A rig on a rock, made ready for the kernels."""

    m1: float
    m2: float
    k: float
    c: float
    relative: Pair
    """Of y out of contact."""
    loading: Contact
    unloading: Contact


class Drive(NamedTuple):
    """A setting on a plant: the forces, and the forced part of each contact regime."""

    omega: float
    """Excitation frequency in rad/s."""
    amplitude: float
    """F_a in N."""
    static: float
    """F_b in N."""
    free_y: tuple[float, float, float]
    """Constant, sine and cosine part of y out of contact, in m."""
    forced: np.ndarray
    """(2, 3, 4): loading and unloading; constant, sine and cosine part; of z."""


@njit(cache=True, error_model="numpy")
def make_pair(linear: float, constant: float) -> Pair:
    """The pair of roots of s^2 + linear s + constant."""
    split = 0.25 * linear * linear - constant
    return Pair(0.5 * linear, split, math.sqrt(abs(split)))


@njit(cache=True, error_model="numpy")
def make_contact(m1: float, m2: float, k: float, c: float, kappa: float):
    """Modes of a contact of stiffness ``kappa``. Returns (Contact, ok); not ok where the two pairs run together."""
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
        if abs(da) <= 1e-15 * abs(a) and abs(de) <= 1e-15 * abs(e):
            ok = True
            break
        # the last digits may keep flickering
        if abs(da) <= 1e-13 * abs(a) and abs(de) <= 1e-13 * abs(e):
            ok = True
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
    quadratic = _times(flow, flow) + a * flow + e * one
    projector = _times(alpha * flow + beta * one, quadratic)
    # one step of purification takes the rounding out of the projector
    square = _times(projector, projector)
    projector = 3.0 * square - 2.0 * _times(square, projector)
    fast, slow = make_pair(q1, q0), make_pair(a, e)
    quickest = fast.decay + fast.root if fast.split > 0 else math.sqrt(q0)
    contact = Contact(
        kappa,
        fast,
        slow,
        projector,
        _times(flow + fast.decay * one, projector),
        _times(flow + slow.decay * one, one - projector),
        1.8 / quickest,
    )
    return contact, ok


@njit(cache=True)
def _times(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Matrix product of two small matrices, without BLAS."""
    n = left.shape[0]
    result = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            total = 0.0
            for m in range(n):
                total += left[i, m] * right[m, j]
            result[i, j] = total
    return result


@njit(cache=True, error_model="numpy")
def make_plant(m1: float, m2: float, k: float, c: float, kl: float, ku: float):
    """A rig on a rock. Returns (Plant, ok); where not ok the general engine has to do the work."""
    mass = m1 * m2 / (m1 + m2)
    loading, first = make_contact(m1, m2, k, c, kl)
    unloading, second = make_contact(m1, m2, k, c, ku)
    return Plant(m1, m2, k, c, make_pair(c / mass, k / mass), loading, unloading), first and second


@njit(cache=True, error_model="numpy")
def make_drive(plant: Plant, omega: float, amplitude: float, static: float) -> Drive:
    """A setting on a plant: excitation in rad/s, F_a and F_b in N."""
    m1, m2, k, c = plant.m1, plant.m2, plant.k, plant.c
    mass = m1 * m2 / (m1 + m2)
    swing = -(amplitude / m2) / complex(k / mass - omega * omega, omega * c / mass)
    free_y = (static * mass / (m1 * k), swing.real, swing.imag)
    forced = np.zeros((2, 3, 4))
    coupling = complex(k, c * omega)
    for row in range(2):
        kappa = plant.loading.stiffness if row == 0 else plant.unloading.stiffness
        shaker = coupling - m1 * omega * omega
        indenter = coupling + kappa - m2 * omega * omega
        w = amplitude * shaker / (shaker * indenter - coupling * coupling)
        x = w * coupling / shaker
        forced[row, 0, 0], forced[row, 0, 3] = static / k, static / kappa
        # the part exp(i theta), whose imaginary part is the motion, in terms of sine and cosine
        for column, swing in ((0, x - w), (3, w)):
            forced[row, 1, column], forced[row, 2, column] = swing.real, swing.imag
        for column, swing in ((1, x), (2, w)):
            forced[row, 1, column], forced[row, 2, column] = -omega * swing.imag, omega * swing.real
    return Drive(omega, amplitude, static, free_y, forced)


def plant_for(rig: Rig, rock: Rock) -> Plant:
    """The plant of a rig on a rock.

    Raises:
        InputError: the rig's two modes in contact run together, which the closed form cannot take apart.
    """
    plant, ok = make_plant(
        rig.shaker_mass,
        rig.indenter_mass,
        rig.stiffness,
        rig.damping,
        rock.loading_stiffness,
        rock.unloading_stiffness,
    )
    if not ok:
        raise InputError(
            "the two modes of this rig in contact are too close for the exact engine (a percussive rig has a light "
            "indenter on a stiff rock and a heavy shaker on a soft spring): use simulate(..., engine='general')"
        )
    return plant


def drive_for(plant: Plant, rig: Rig, setting: Setting) -> Drive:
    """The drive of a setting on a plant."""
    return make_drive(plant, 2 * math.pi * setting.frequency, rig.drive_force(setting), rig.static_force(setting))


@njit(cache=True, error_model="numpy")
def pair_at(pair: Pair, t: float):
    """exp(-decay t) C(t) and exp(-decay t) S(t) of a pair, with C'' = split C, C(0) = 1, S(0) = 0, S'(0) = 1."""
    x = pair.split * t * t
    if abs(x) < 0.05:
        cosine = 1.0 + x / 2 * (1.0 + x / 12 * (1.0 + x / 30 * (1.0 + x / 56 * (1.0 + x / 90))))
        sine = t * (1.0 + x / 6 * (1.0 + x / 20 * (1.0 + x / 42 * (1.0 + x / 72 * (1.0 + x / 110)))))
        envelope = math.exp(-pair.decay * t)
        return envelope * cosine, envelope * sine
    if x < 0.0:
        angle = pair.root * t
        envelope = math.exp(-pair.decay * t)
        return envelope * math.cos(angle), envelope * math.sin(angle) / pair.root
    # exponents first: cosh alone would overflow on a long flight
    up = 0.5 * math.exp((pair.root - pair.decay) * t)
    down = 0.5 * math.exp(-(pair.root + pair.decay) * t)
    return up + down, (up - down) / pair.root


@njit(cache=True)
def contact_coefficients(contact: Contact, forced: np.ndarray, z: np.ndarray, sine: float, cosine: float, work):
    """Write u, v of the fast and of the slow pair for the contact that starts in ``z`` into ``work`` (4, 4)."""
    h0 = z[0] - forced[0, 0] - sine * forced[1, 0] - cosine * forced[2, 0]
    h1 = z[1] - forced[0, 1] - sine * forced[1, 1] - cosine * forced[2, 1]
    h2 = z[2] - forced[0, 2] - sine * forced[1, 2] - cosine * forced[2, 2]
    h3 = z[3] - forced[0, 3] - sine * forced[1, 3] - cosine * forced[2, 3]
    p, q, r = contact.fast_cosine, contact.fast_sine, contact.slow_sine
    for i in range(4):
        work[0, i] = p[i, 0] * h0 + p[i, 1] * h1 + p[i, 2] * h2 + p[i, 3] * h3
        work[1, i] = q[i, 0] * h0 + q[i, 1] * h1 + q[i, 2] * h2 + q[i, 3] * h3
        work[3, i] = r[i, 0] * h0 + r[i, 1] * h1 + r[i, 2] * h2 + r[i, 3] * h3
    work[2, 0] = h0 - work[0, 0]
    work[2, 1] = h1 - work[0, 1]
    work[2, 2] = h2 - work[0, 2]
    work[2, 3] = h3 - work[0, 3]


@njit(cache=True)
def contact_state(contact: Contact, forced: np.ndarray, work: np.ndarray, theta: float, t: float, out: np.ndarray):
    """The state a time ``t`` after the contact of ``work`` began; ``theta`` is the phase reached."""
    fast_c, fast_s = pair_at(contact.fast, t)
    slow_c, slow_s = pair_at(contact.slow, t)
    sine, cosine = math.sin(theta), math.cos(theta)
    for i in range(4):
        out[i] = (
            forced[0, i]
            + sine * forced[1, i]
            + cosine * forced[2, i]
            + fast_c * work[0, i]
            + fast_s * work[1, i]
            + slow_c * work[2, i]
            + slow_s * work[3, i]
        )


@njit(cache=True)
def free_coefficients(plant: Plant, drive: Drive, z: np.ndarray, sine: float, cosine: float, work: np.ndarray):
    """Write the flight that starts in ``z`` into ``work``: [0, :3] the centre of mass, [1, :2] u and v of y."""
    total = plant.m1 + plant.m2
    share = plant.m1 / total
    swing = drive.amplitude / (total * drive.omega)
    work[0, 0] = z[3] + share * z[0] + swing / drive.omega * sine
    work[0, 1] = (plant.m1 * z[1] + plant.m2 * z[2]) / total + swing * cosine
    work[0, 2] = drive.static / total
    level, level_sine, level_cosine = drive.free_y
    u = z[0] - level - sine * level_sine - cosine * level_cosine
    speed = z[1] - z[2] - drive.omega * (cosine * level_sine - sine * level_cosine)
    work[1, 0] = u
    work[1, 1] = speed + plant.relative.decay * u


@njit(cache=True)
def free_state(plant: Plant, drive: Drive, work: np.ndarray, theta: float, t: float, out: np.ndarray):
    """The state a time ``t`` after the flight of ``work`` began; ``theta`` is the phase reached."""
    total = plant.m1 + plant.m2
    share = plant.m1 / total
    swing = drive.amplitude / (total * drive.omega)
    c, s = pair_at(plant.relative, t)
    sine, cosine = math.sin(theta), math.cos(theta)
    level, level_sine, level_cosine = drive.free_y
    u, v = work[1, 0], work[1, 1]
    decay, split = plant.relative.decay, plant.relative.split
    y = level + sine * level_sine + cosine * level_cosine + c * u + s * v
    speed = drive.omega * (cosine * level_sine - sine * level_cosine) + c * (v - decay * u) + s * (split * u - decay * v)
    centre = work[0, 0] + t * (work[0, 1] + 0.5 * t * work[0, 2]) - swing / drive.omega * sine
    centre_speed = work[0, 1] + t * work[0, 2] - swing * cosine
    out[0] = y
    out[1] = centre_speed + (1.0 - share) * speed
    out[2] = centre_speed - share * speed
    out[3] = centre - share * y


@njit(cache=True)
def contact_matrix(contact: Contact, t: float, out: np.ndarray):
    """(4, 4) derivative of the state after a time ``t`` in contact by the state before."""
    fast_c, fast_s = pair_at(contact.fast, t)
    slow_c, slow_s = pair_at(contact.slow, t)
    for i in range(4):
        for j in range(4):
            out[i, j] = (
                (fast_c - slow_c) * contact.fast_cosine[i, j]
                + fast_s * contact.fast_sine[i, j]
                + slow_s * contact.slow_sine[i, j]
            )
        out[i, i] += slow_c


@njit(cache=True)
def free_matrix(plant: Plant, t: float, out: np.ndarray):
    """(4, 4) derivative of the state after a time ``t`` in free flight by the state before."""
    c, s = pair_at(plant.relative, t)
    decay, split = plant.relative.decay, plant.relative.split
    first = plant.m1 / (plant.m1 + plant.m2)
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
