"""A drive of limited slew rate, the slope of its force: it follows what is asked of it, or it ramps.

It ramps from where what is asked becomes too steep, until it meets that again. What is asked depends on time alone, so
these times are found ahead of the motion, and steps end at them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import INLINED, INNER, apart
from drillenv.dynamics.constitutive.places import DRIVE, WAVEFORM
from drillenv.dynamics.hybrid.vector_field import (
    CORNER_COUNT,
    DRIVE_DELAY,
    DRIVEN,
    F_A,
    FIRST_CORNER,
    LAWS,
    OMEGA,
    PLACE,
    SLEW_RATE,
    SLEWING,
    SLEWING_LEFT,
    THETA,
    TURN,
    WHERE,
    corner_at,
    drive_asked,
    law_at,
)

PARTS = 64
"""Into how many parts a turn of the excitation is cut when it is searched."""
MOST_TURNS = 8
"""Turns of the excitation over which a ramp is followed before it is looked at again; one where it follows."""
HALVINGS = 50
"""Of a part, in which the time of a change is found."""
BESIDE = 1e-7
"""rad beside a phase at which it is looked how steep what is asked is there."""
SAME = 1e-9
"""Share of the force asked within which the drive has it."""


@njit(**INLINED)
def asked_late(m: np.ndarray, theta: float) -> tuple[float, float]:
    """What the drive follows at a phase of the excitation in N, and its slope in N/s: it is late."""
    asked, rate = drive_asked(m, theta - m[OMEGA] * m[DRIVE_DELAY])
    return asked, rate * m[OMEGA]


@njit(**INNER)
def beyond(m: np.ndarray, d: np.ndarray, s: float) -> float:
    """By how much a drive that follows is asked to be too steep in s s, in N/s; by how much a ramp is past, in N."""
    asked, steep = asked_late(m, d[THETA] + m[OMEGA] * s)
    if d[SLEWING] == 0.0:
        return abs(steep) - m[SLEW_RATE]
    return d[SLEWING] * (d[DRIVEN] - asked) + m[SLEW_RATE] * s


@njit(**INNER)
def until_corner(m: np.ndarray, d: np.ndarray) -> float:
    """Seconds until what the drive follows comes to a corner; infinite where it has none."""
    theta, found = d[THETA] - m[OMEGA] * m[DRIVE_DELAY], math.inf
    for i in range(int(m[LAWS])):
        place, first = law_at(m, i, PLACE), law_at(m, i, FIRST_CORNER)
        for k in range(law_at(m, i, CORNER_COUNT) if place in (WAVEFORM, DRIVE) else 0):
            at = corner_at(m, first + k, WHERE)
            if place == WAVEFORM:
                found = min(found, until_phase(m, theta, at))
            elif abs(at) < m[F_A]:
                at = math.asin(at / m[F_A])
                found = min(found, until_phase(m, theta, at), until_phase(m, theta, math.pi - at))
    return found


@njit(**INLINED)
def until_phase(m: np.ndarray, theta: float, at: float) -> float:
    """Seconds from one phase to another, a whole turn from itself."""
    ahead = (at - theta) / TURN
    ahead -= math.floor(ahead)
    return (ahead if ahead * TURN > BESIDE else ahead + 1.0) * TURN / m[OMEGA]


@njit(**INNER)
def until_change(m: np.ndarray, d: np.ndarray) -> float:
    """Seconds for which the drive goes on as it does: smoothly following, or ramping the same way."""
    part, turns = TURN / m[OMEGA] / PARTS, 1 if d[SLEWING] == 0.0 else MOST_TURNS
    corner = until_corner(m, d) if d[SLEWING] == 0.0 else math.inf
    for k in range(1, turns * PARTS + 2):
        low, high = (k - 1) * part, k * part
        if low > corner:
            break
        if beyond(m, d, high) > 0.0:
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if beyond(m, d, middle) > 0.0:
                    high = middle
                else:
                    low = middle
            return min(high, corner)
    return min(turns * TURN / m[OMEGA], corner)


@njit(**INNER)
def follow_or_ramp(m: np.ndarray, d: np.ndarray) -> None:
    """Let the drive go on from the force that it has: follow what is asked where it has that, or ramp towards it."""
    apart()
    asked = asked_late(m, d[THETA])[0]
    gap = d[DRIVEN] - asked
    if abs(gap) <= SAME * (m[F_A] + abs(asked)):
        # how steep it is about to be asked to be
        steep = asked_late(m, d[THETA] + BESIDE)[1]
        d[DRIVEN], d[SLEWING] = asked, 0.0
        if abs(steep) > m[SLEW_RATE]:
            d[SLEWING] = math.copysign(1.0, steep)
    else:
        d[SLEWING] = -math.copysign(1.0, gap)
    d[SLEWING_LEFT] = until_change(m, d)


@njit(**INNER)
def drive_on(m: np.ndarray, d: np.ndarray, s: float) -> None:
    """Take the drive's force s s on, to the phase that the discrete state has by now."""
    if d[SLEWING] == 0.0:
        d[DRIVEN] = asked_late(m, d[THETA])[0]
    else:
        d[DRIVEN] += d[SLEWING] * m[SLEW_RATE] * s
    d[SLEWING_LEFT] -= s
