"""Simulators of the percussive-drilling rig that share no code with the package, to check it and to race it.

All of them solve the model of Section 3 of the paper in its dimensional form,

    m1 X1'' = F_b - k (X1 - X2) - c (X1' - X2')
    m2 X2'' = F_a sin(2 pi f t + phase) + k (X1 - X2) + c (X1' - X2') - R

from rest with the indenter just touching the rock (X2 = Xp = Xf = 0) and the spring carrying the static force
(X1 = F_b / k). Everything is in SI units.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

FREE, LOADING, UNLOADING = 0, 1, 2


class Problem(NamedTuple):
    """One setting of one rig on one rock."""

    m1: float
    """Mass of the shaker body in kg."""
    m2: float
    """Mass of the indenter in kg."""
    k: float
    """Stiffness of the structure in N/m."""
    c: float
    """Damping of the structure in N s/m."""
    kl: float
    """Loading stiffness of the rock in N/m."""
    ku: float
    """Unloading stiffness of the rock in N/m."""
    f: float
    """Excitation frequency in Hz."""
    force: float
    """F_a, amplitude of the harmonic force on the indenter, in N."""
    static: float
    """F_b, static force on the shaker body, in N."""
    phase: float = 0.0
    """Phase of the excitation at the start in rad."""


class Motion(NamedTuple):
    """What a peer returns. The first five have one entry per period's end, the start included."""

    x1: np.ndarray
    """X1 in m."""
    x2: np.ndarray
    """X2 in m."""
    v1: np.ndarray
    """X1' in m/s."""
    v2: np.ndarray
    """X2' in m/s."""
    penetration: np.ndarray
    """Xf in m (in contact: X2 - R / ku)."""
    impact_times: np.ndarray
    """Times in s of the turns from loading to unloading."""
    contact_times: np.ndarray
    """Times in s at which a flight ended; a start in contact is not among them."""


def paper_problem(kl: float, ku: float, f: float, volts: float, bar: float, phase: float = 0.0) -> Problem:
    """The rig of Table 2.1 with the forces of Eq. 3.5 and 3.6, on a rock given by its two stiffnesses in N/m."""
    return Problem(265.0, 3.0, 68.85e3, 2.45e3, kl, ku, f, (2.40 * f + 876.19) * volts, 196.35 * bar, phase)


def first_regime(problem: Problem) -> int:
    """The regime at the start: rest, touching the rock, with nothing but the forces to say where it goes."""
    push = problem.static + problem.force * math.sin(problem.phase)
    if push == 0.0:
        push = problem.force * math.cos(problem.phase)
    return LOADING if push > 0.0 else FREE
