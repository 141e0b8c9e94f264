"""Constitutive equations of the concealed rig, one function for each place where it can depart from the paper's model.

Each function takes ``code``, the equation to follow (0: none), and ``p``, its parameters (8 numbers in SI, the unused
ones 0). The catalogue (:mod:`drillenv.blind.mechanisms`) says what the parameters are called.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Places, as an index into the arrays of codes and parameters.
(
    POWER,
    TOE,
    RATE,
    COMPACTION,
    MOUNT,
    SPRING,
    BACKLASH,
    DAMPER,
    GUIDE,
    INDENTER,
    HARMONICS,
    DROOP,
    LIMIT,
    AIR,
    FLOOR,
    ROTATION,
    CHIPS,
    WOBBLE,
    ADHESION,
    RATTLE,
    VISCOUS,
    DRY,
) = range(22)
PLACES = 22
PARAMETERS = 8

KERNEL: dict[str, Any] = {"cache": True, "_nrt": False}
"""Options of Numba for functions that make no array: counting references to those handed over takes half of a run."""

REFERENCE_DEPTH = 1e-4
"""m: where a power law has the force of the straight one."""
GRIP = 1
"""Code of friction that holds a mass fast (set-valued Coulomb friction), in GUIDE and INDENTER."""


@njit(**KERNEL)
def power_depth(code: int, p: np.ndarray, depth: float, loading: bool) -> float:
    """Depth in m that the rock's stiffness acts on, for rock whose force is no straight line of the depth."""
    if code == 0 or depth <= 0.0:
        return depth
    x = depth / REFERENCE_DEPTH
    if code == 1:  # the same exponent both ways
        return REFERENCE_DEPTH * x ** p[0]
    if code == 2:  # a power on the way in, straight on the way out; passive for an exponent below 1
        return REFERENCE_DEPTH * x ** p[0] if loading else depth
    if code == 3:  # a straight line and a parabola
        return depth * (1.0 + p[0] * x)
    # stiffer by the factor p[0] beyond the depth p[1]
    return depth + (p[0] - 1.0) * max(depth - p[1], 0.0)


@njit(**KERNEL)
def toe_depth(code: int, p: np.ndarray, depth: float, loading: bool, softer: float) -> float:
    """Depth in m that is left for solid rock behind a soft layer. ``softer`` is k_l / k_u."""
    if code == 0 or depth <= 0.0:
        return depth
    scale = 1.0 if loading else softer
    if code == 1:  # exponential, of which the share p[2] springs back
        h = p[0] * (1.0 if loading else p[2] * softer)
        return depth if h == 0.0 else depth - (1.0 - p[1]) * h * (1.0 - math.exp(-depth / h))
    if code == 2:  # a parabola that runs into the straight line, crushed for good
        if not loading:
            return depth
        return depth * depth / (2.0 * p[0]) if depth < p[0] else depth - 0.5 * p[0]
    if code == 3:  # two straight lines, springing back
        h = p[0] * scale
        return p[1] * depth if depth < h else depth - (1.0 - p[1]) * h
    # a parabola that runs into the straight line, springing back
    h = p[0] * scale
    return depth * depth / (2.0 * h) if depth < h else depth - 0.5 * h


@njit(**KERNEL)
def elastic_depth(codes: np.ndarray, p: np.ndarray, depth: float, loading: bool, softer: float) -> float:
    """Depth that the stiffness acts on: the soft layer first, then the power law."""
    solid = toe_depth(codes[TOE], p[TOE], depth, loading, softer)
    return power_depth(codes[POWER], p[POWER], solid, loading)


@njit(**KERNEL)
def depth_of(codes: np.ndarray, p: np.ndarray, wanted: float, loading: bool, softer: float) -> float:
    """The depth at which :func:`elastic_depth` is ``wanted``, by bisection."""
    if codes[TOE] == 0 and codes[POWER] == 0:
        return wanted
    if wanted <= 0.0:
        return wanted
    low, high = 0.0, max(wanted, 1e-9)
    while elastic_depth(codes, p, high, loading, softer) < wanted:
        high *= 2.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if elastic_depth(codes, p, middle, loading, softer) < wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(**KERNEL)
def rate_force(code: int, p: np.ndarray, elastic: float, depth: float, into: float) -> float:
    """Force in N that the rock adds at a speed ``into`` it in m/s, beside its ``elastic`` force in N."""
    if code == 0 or depth <= 0.0:
        return 0.0
    if code == 1:  # Hunt-Crossley
        return elastic * p[0] * into
    if code == 2:  # Kelvin-Voigt
        return p[0] * into
    if code == 3:  # grows with the root of the speed
        return elastic * p[0] * math.copysign(math.sqrt(abs(into)), into)
    if code == 4:  # Tsuji
        return p[0] * (depth / REFERENCE_DEPTH) ** 0.25 * into
    # logarithm of the rate, as in Johnson and Cook's law
    return elastic * p[0] * math.copysign(math.log1p(abs(into) / p[1]), into)


@njit(**KERNEL)
def compaction_factor(code: int, p: np.ndarray, impacts: float, advance: float) -> float:
    """Factor on the rock's stiffness after so many impacts, and so many metres, on a fresh face."""
    if code == 0:
        return 1.0
    if code == 1:  # exponential in the impacts
        return 1.0 - p[0] * math.exp(-impacts / p[1])
    if code == 2:  # hyperbolic in the impacts
        return 1.0 - p[0] / (1.0 + impacts / p[1])
    if code == 3:  # exponential in the depth drilled
        return 1.0 - p[0] * math.exp(-advance / p[1])
    # a straight ramp that ends
    return 1.0 - p[0] * max(1.0 - impacts / p[1], 0.0)


@njit(**KERNEL)
def spring_force(code: int, p: np.ndarray, s: float) -> float:
    """Force in N that the coupling's spring adds at a shortening ``s`` in m."""
    if code == 0:
        return 0.0
    if code == 1 or code == 3:  # cubic: hardening, or softening with a negative p[0]
        return p[0] * s * s * s
    if code == 2:  # fifth power
        return p[0] * s**5
    # stiffer by p[0] N/m beyond the shortening p[1]
    return p[0] * max(s - p[1], 0.0)


@njit(**KERNEL)
def spring_saturation(code: int, p: np.ndarray, s: float) -> float:
    """Force in N that a saturating spring lacks: beyond p[1] m from p[0] m its force bends over within p[1]."""
    off = s - p[0]
    return p[2] * (p[1] * math.tanh(off / p[1]) - off)


@njit(**KERNEL)
def backlash_force(code: int, p: np.ndarray, s: float, k: float) -> float:
    """Force in N that play adds; it begins at p[1] m of shortening and is p[0] m wide."""
    if code == 0:
        return 0.0
    beyond = s - p[1]
    if code == 1:  # no force grows over the play
        return -k * min(max(beyond, 0.0), p[0])
    if code == 2:  # with rounded ends, over p[2] m
        w = p[2]
        first = w * math.log1p(math.exp(min(beyond / w, 500.0))) if beyond < 300.0 * w else beyond
        off = beyond - p[0]
        last = w * math.log1p(math.exp(min(off / w, 500.0))) if off < 300.0 * w else off
        return -k * (first - last)
    # a worn bush: over the play the share p[2] of the stiffness is left
    return -k * (1.0 - p[2]) * min(max(beyond, 0.0), p[0])


@njit(**KERNEL)
def damper_force(code: int, p: np.ndarray, v: float) -> float:
    """Force in N that the coupling's damper adds at a closing speed ``v`` in m/s."""
    if code == 0:
        return 0.0
    if code == 1:
        return p[0] * abs(v) * v
    if code == 2:
        return p[0] * math.copysign(abs(v) ** 1.5, v)
    if code == 3:  # another damping on closing than on opening
        return p[0] * max(v, 0.0)
    # dry friction in the coupling, rounded over p[1] m/s
    return p[0] * math.tanh(v / p[1])


@njit(**KERNEL)
def sliding_force(code: int, p: np.ndarray, v: float) -> float:
    """Steady friction in N at a sliding speed ``v`` in m/s, against the motion where positive."""
    if code == 0:
        return 0.0
    if code == GRIP:
        return p[0] * (1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0)
    if code == 2:  # rounded Coulomb
        return p[0] * math.tanh(v / p[1])
    if code == 3:  # Stribeck, rounded
        return (p[0] + (p[1] - p[0]) * math.exp(-((v / p[2]) ** 2))) * math.tanh(v / p[3])
    if code == 4:  # Dahl
        return p[0] * (1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0)
    # LuGre
    sign = 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0
    return (p[0] + (p[1] - p[0]) * math.exp(-((v / p[2]) ** 2))) * sign


@njit(**KERNEL)
def viscous_force(code: int, p: np.ndarray, v: float) -> float:
    """Force in N against the speed ``v`` in m/s of a single body, from a lubricant or a fluid."""
    if code == 0:
        return 0.0
    if code == 1:
        return p[0] * v
    if code == 2:  # a power below 1: a lubricant that thins, smooth below p[2] m/s
        return p[0] * v * (v * v + p[2] * p[2]) ** (0.5 * (p[1] - 1.0))
    # Eyring: grows with the logarithm of the speed once it is past p[1] m/s
    return p[0] * p[1] * math.asinh(v / p[1])


@njit(**KERNEL)
def bristle_force(code: int, p: np.ndarray, v: float, z: float) -> tuple[float, float]:
    """Friction in N of bristles bent by ``z`` m, and how fast they bend in m/s (Dahl, LuGre)."""
    level = p[0] if code == 4 else p[0] + (p[1] - p[0]) * math.exp(-((v / p[2]) ** 2))
    rate = v - p[3] * abs(v) * z / level
    return p[3] * z + p[4] * rate, rate


@njit(**KERNEL)
def harmonic_share(code: int, p: np.ndarray, theta: float) -> float:
    """What the drive adds at the phase ``theta``, as a share of its amplitude."""
    if code == 0:
        return 0.0
    if code == 1:  # second and third
        return p[0] * math.sin(2.0 * theta + p[1]) + p[2] * math.sin(3.0 * theta + p[3])
    if code == 2:  # third and fifth, as an overdriven coil has them
        return p[0] * math.sin(3.0 * theta + p[1]) + p[2] * math.sin(5.0 * theta + p[3])
    wave = math.sin(theta)
    if code == 3:  # pushes harder than it pulls
        return p[0] * (wave * wave - 0.5)
    # dead zone of the amplifier about zero: crossover distortion
    return math.copysign(max(abs(wave) - p[0], 0.0), wave) / (1.0 - p[0]) - wave


@njit(**KERNEL)
def droop_gain(code: int, p: np.ndarray, frequency: float) -> tuple[float, float]:
    """Gain of the drive at ``frequency`` in Hz, and its phase in rad."""
    if code == 0:
        return 1.0, 0.0
    r = frequency / p[0]
    if code == 1:  # the gain of a first-order lag, without its phase
        return 1.0 / math.sqrt(1.0 + r * r), 0.0
    if code == 2:  # coil inductance: first-order lag with its phase
        return 1.0 / math.sqrt(1.0 + r * r), -math.atan(r)
    if code == 3:  # second order, as of a power amplifier
        return 1.0 / math.sqrt(1.0 + r**4), 0.0
    if code == 4:  # falls in a straight line
        return max(1.0 - r, 0.05), 0.0
    # a coil that resonates at p[0] Hz with the damping ratio p[1]
    real, imaginary = 1.0 - r * r, 2.0 * p[1] * r
    return 1.0 / math.sqrt(real * real + imaginary * imaginary), -math.atan2(imaginary, real)


@njit(**KERNEL)
def limited(code: int, p: np.ndarray, force: float) -> float:
    """The drive's force in N where ``force`` is asked for. A limit of its slope is a state of the rig's."""
    if code == 1:  # clipped
        return min(max(force, -p[0]), p[0])
    if code == 2:  # bent over softly
        return p[0] * math.tanh(force / p[0])
    if code == 3:  # pushes less than it pulls
        return min(force, p[0])
    return force


@njit(**KERNEL)
def air_force(code: int, p: np.ndarray, x: float, y: float, static: float, v1: float) -> tuple[float, float, float]:
    """Force in N that the cylinder lacks, and the rates of its states ``x`` and ``y``.

    ``static`` is its force at rest in N, ``v1`` the piston's speed in m/s.
    """
    if code == 1:  # straight spring, straight leak: x is the force lost
        return x, p[0] * v1 - x / p[1], 0.0
    if code == 2:  # isothermal, p[0] m of enclosed air, refilled in p[1] s: x is the stroke not refilled
        return static * (1.0 - 1.0 / (1.0 + x / p[0])), v1 - x / p[1], 0.0
    if code == 3:  # polytropic, refilled through a valve by the root of the missing force, p[1] m/s at all of it
        lack = static * (1.0 - (1.0 / (1.0 + x / p[0])) ** 1.3)
        share = lack / max(static, 1.0)
        return lack, v1 - p[1] * math.copysign(math.sqrt(abs(share) + 1e-12), share), 0.0
    # two chambers: half of the air is refilled fast, half slowly
    return x + y, 0.5 * p[0] * v1 - x / p[1], 0.5 * p[0] * v1 - y / p[2]
