"""The rig in a compiled fixed-step Runge-Kutta method: fast, simple, and blind to what happens inside a step.

The classical fourth-order method with 1000 steps a period. The sine is evaluated in the right-hand side, and a switch
is taken at the end of the step in which it happened.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from benchmarks.peers import FREE, LOADING, UNLOADING, Motion, Problem, first_regime

STEPS = 1000


def simulate(problem: Problem, periods: int, steps: int = STEPS) -> Motion:
    """Simulate from the fresh start, with ``steps`` steps a period."""
    table, impacts, contacts = _run(
        Problem(*(float(value) for value in problem)), first_regime(problem), periods, steps
    )
    x1, x2, v1, v2, penetration = table.T
    return Motion(x1, x2, v1, v2, penetration, impacts, contacts)


@njit(cache=True)
def _rates(problem, omega, kappa, origin, t, x1, v1, x2, v2):
    """Accelerations of both masses."""
    structure = problem.k * (x1 - x2) + problem.c * (v1 - v2)
    rock = kappa * (x2 - origin)
    pull = problem.force * math.sin(omega * t + problem.phase)
    return (problem.static - structure) / problem.m1, (pull + structure - rock) / problem.m2


@njit(cache=True)
def _run(problem, regime, periods, steps):
    omega = 2 * math.pi * problem.f
    h = 1.0 / (problem.f * steps)
    softer = problem.kl / problem.ku
    table = np.zeros((periods + 1, 5))
    impacts, contacts = np.empty(20 * periods + 20), np.empty(20 * periods + 20)
    hits = touches = 0
    xp = xf = 0.0
    x1, v1, x2, v2 = problem.static / problem.k, 0.0, 0.0, 0.0
    table[0, 0] = x1
    kappa, origin = (problem.kl, xp) if regime == LOADING else (0.0, 0.0)
    for n in range(1, periods + 1):
        for i in range(steps):
            t = ((n - 1) * steps + i) * h
            a1, b1 = _rates(problem, omega, kappa, origin, t, x1, v1, x2, v2)
            p1, q1 = v1 + 0.5 * h * a1, v2 + 0.5 * h * b1
            a2, b2 = _rates(problem, omega, kappa, origin, t + 0.5 * h, x1 + 0.5 * h * v1, p1, x2 + 0.5 * h * v2, q1)
            p2, q2 = v1 + 0.5 * h * a2, v2 + 0.5 * h * b2
            a3, b3 = _rates(problem, omega, kappa, origin, t + 0.5 * h, x1 + 0.5 * h * p1, p2, x2 + 0.5 * h * q1, q2)
            p3, q3 = v1 + h * a3, v2 + h * b3
            a4, b4 = _rates(problem, omega, kappa, origin, t + h, x1 + h * p2, p3, x2 + h * q2, q3)
            x1 += h / 6.0 * (v1 + 2.0 * p1 + 2.0 * p2 + p3)
            x2 += h / 6.0 * (v2 + 2.0 * q1 + 2.0 * q2 + q3)
            v1 += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            v2 += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
            if regime == FREE:
                if x2 > xp:
                    regime, kappa, origin = LOADING, problem.kl, xp
                    if touches < len(contacts):
                        contacts[touches] = t + h
                    touches += 1
            elif regime == LOADING:
                if v2 < 0.0:
                    xf = x2 - softer * (x2 - xp)
                    regime, kappa, origin = UNLOADING, problem.ku, xf
                    if hits < len(impacts):
                        impacts[hits] = t + h
                    hits += 1
            elif x2 <= xf:
                xp = xf
                regime, kappa, origin = FREE, 0.0, xf
            elif v2 > 0.0:
                xp = x2 - (x2 - xf) / softer
                regime, kappa, origin = LOADING, problem.kl, xp
        table[n, 0], table[n, 1], table[n, 2], table[n, 3] = x1, x2, v1, v2
        table[n, 4] = x2 - softer * (x2 - xp) if regime == LOADING else xf
    return table, impacts[: min(hits, len(impacts))].copy(), contacts[: min(touches, len(contacts))].copy()
