"""The rig in heyoka: Taylor's method, with terminal events that are roots of the Taylor polynomial itself.

There is one integrator for each regime, compiled once. Positions are counted from the origin of the current contact,
and time from the last period's end where the run stopped, so that no digits are lost. Each regime looks only for the
crossings by which it can end, in their one direction: a run that begins on a switching surface leaves it the other way
and triggers nothing. But heyoka 7.13 overlooks a crossing in a step at whose very start the event's polynomial is
exactly zero (a flight begun at w = 0 then ends unseen), so each regime begins a nudge of 1e-30 past its surface.
"""

from __future__ import annotations

import heyoka as hy
import numpy as np

from benchmarks.peers import FREE, LOADING, UNLOADING, Motion, Problem, first_regime

NUDGE = 1e-30
"""m or m/s; far below one rounding of anything here."""


class HeyokaRig:
    """heyoka integrators of the three regimes, compiled here so that ``run`` only runs.

    Args:
        tolerance: Of each Taylor step; 0 asks for the machine's precision.
        extended: Work in the 80-bit floating-point numbers of x86 processors rather than in double precision.
    """

    def __init__(self, tolerance: float = 0.0, extended: bool = False):
        self._real = real = np.longdouble if extended else float
        self._integrators = [_integrator(regime, real(tolerance), real) for regime in (FREE, LOADING, UNLOADING)]

    @property
    def order(self) -> int:
        """Order of the Taylor polynomials."""
        return self._integrators[0].order

    def run(self, problem: Problem, periods: int, every: int = 1) -> Motion:
        """Simulate from the fresh start.

        Args:
            problem: What to simulate.
            periods: For how many excitation periods.
            every: Stop at the end of every so many of them only; the motion then has a row for each of these.

        Raises:
            RuntimeError: heyoka gave up.
        """
        real = self._real
        m1, m2, k, c, kl, ku, f, force, static, phase = (real(value) for value in problem)
        omega = 8 * np.arctan(real(1)) * f
        for stiffness, integrator in zip((real(0), kl, ku), self._integrators, strict=True):
            integrator.pars[:] = [
                k / m1, c / m1, static / m1, k / m2, c / m2, force / m2, stiffness / m2, omega, phase
            ]  # fmt: skip
        span = every / f
        softer, harder = kl / ku, ku / kl
        # writing to these views writes the integrators' states
        handles = [(integrator, integrator.state) for integrator in self._integrators]
        limit = hy.taylor_outcome.time_limit
        left = hy.taylor_outcome(-1)
        turned = hy.taylor_outcome(-2)

        rows = [(static / k, real(0), real(0), real(0), real(0))]
        impacts, contacts = [], []
        regime = first_regime(problem)
        origin, begin, clock = real(0), real(0), real(0)
        forward, back = real(NUDGE), -real(NUDGE)
        u1, v1, u2, v2 = static / k, real(0), real(0), real(0)
        if regime == LOADING:
            v2 = forward
        else:
            u2 = back
        for n in range(every, periods + 1, every):
            while True:
                integrator, state = handles[regime]
                integrator.time = clock
                state[:] = u1, v1, u2, v2
                integrator.reset_cooldowns()
                outcome = integrator.propagate_until(span)[0]
                u1, v1, u2, v2 = state.tolist() if real is float else state.copy()
                if outcome == limit:
                    break
                clock = integrator.time
                if outcome == left and regime == FREE:
                    regime = LOADING
                    contacts.append(begin + clock)
                elif outcome == left and regime == UNLOADING:
                    u2, regime = back, FREE
                elif outcome in (left, turned):
                    if regime == LOADING:
                        impacts.append(begin + clock)
                        regime, ratio, v2 = UNLOADING, softer, back
                    else:
                        regime, ratio, v2 = LOADING, harder, forward
                    shift = u2 - ratio * u2
                    origin, u1, u2 = origin + shift, u1 - shift, ratio * u2
                else:
                    raise RuntimeError(f"heyoka stopped with {outcome} in period {n}")
            place = origin + u2 - softer * u2 if regime == LOADING else origin
            rows.append((origin + u1, origin + u2, v1, v2, place))
            begin, clock = n / f, real(0)
        x1, x2, v1, v2, penetration = np.array(rows).T.astype(float)
        return Motion(x1, x2, v1, v2, penetration, np.array(impacts, dtype=float), np.array(contacts, dtype=float))


def _integrator(regime: int, tolerance, real):
    """The integrator of one regime; its state is X1 - O, X1', X2 - O, X2' with the contact's origin O."""
    u1, v1, u2, v2 = hy.make_vars("u1", "v1", "u2", "v2")
    p = hy.par
    stretch, speed = u1 - u2, v1 - v2
    drive = p[5] * hy.sin(p[7] * hy.time + p[8])
    rock = p[6] * u2 if regime != FREE else 0.0
    system = [
        (u1, v1),
        (v1, p[2] - p[0] * stretch - p[1] * speed),
        (u2, v2),
        (v2, drive + p[3] * stretch + p[4] * speed - rock),
    ]
    up, down = hy.event_direction.positive, hy.event_direction.negative
    crossings = {FREE: [(u2, up)], LOADING: [(v2, down)], UNLOADING: [(u2, down), (v2, up)]}[regime]
    return hy.taylor_adaptive(
        system,
        np.zeros(4, dtype=real),
        pars=np.ones(9, dtype=real),
        tol=tolerance,
        t_events=[hy.t_event(g, direction=direction, fp_type=real) for g, direction in crossings],
        fp_type=real,
    )
