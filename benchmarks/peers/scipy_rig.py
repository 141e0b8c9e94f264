"""The rig in SciPy, twice: as accurately as its Runge-Kutta methods go, and as an ordinary user would write it.

``simulate`` steps a SciPy solver through one regime at a time, counts positions from the origin of the current contact
and time from the last period's end, and looks between step ends too: the switch function is sampled along each step's
dense output, and between samples a turning point is looked for where the slopes ask for one, so a contact shorter than
a step is not missed. An event found on the dense output is polished: the solver goes again from the last step's end to
the event in one step of its own, and a Newton correction takes out what is left.

``simulate_plainly`` is ``solve_ivp`` with terminal events and nothing else. It looks at step ends only.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import integrate
from scipy.optimize import brentq

from benchmarks.peers import FREE, LOADING, UNLOADING, Motion, Problem, first_regime

SAMPLES = np.linspace(0.0, 1.0, 5)
"""Where in a step the switch functions are looked at."""

ROOT_RTOL = np.float64(1e-15)

# What can end a regime: the place in the state (X1, X1', X2, X2') that goes through zero, and which way.
CROSSINGS = {FREE: [(2, 1.0)], LOADING: [(3, -1.0)], UNLOADING: [(2, -1.0), (3, 1.0)]}


def simulate(
    problem: Problem,
    periods: int,
    method: str = "DOP853",
    rtol: float = 1e-13,
    atol: float = 1e-18,
    max_step: float = 1e-4,
) -> Motion:
    """Simulate from the fresh start; ``method`` names a solver class of ``scipy.integrate``, ``max_step`` is in s.

    Raises:
        RuntimeError: the solver gave up.
    """
    f, kl, ku = problem.f, problem.kl, problem.ku
    derivatives = [_derivative(problem, kappa) for kappa in (0.0, kl, ku)]
    solver = getattr(integrate, method)
    period, softer = 1.0 / f, kl / ku
    origin = 0.0
    state = np.array([problem.static / problem.k, 0.0, 0.0, 0.0])
    regime = first_regime(problem)
    rows = [(state[0], 0.0, 0.0, 0.0, 0.0)]
    impacts, contacts = [], []
    for n in range(1, periods + 1):
        begin, clock = (n - 1) / f, 0.0
        while True:
            options = {"rtol": rtol, "atol": atol}
            clock, state, crossed = _through(
                solver, derivatives[regime], CROSSINGS[regime], clock, state, period, max_step, options
            )
            if crossed is None:
                break
            place, _way = crossed
            state[place] = 0.0
            if place == 2:
                regime = LOADING if regime == FREE else FREE
                if regime == LOADING:
                    contacts.append(begin + clock)
                continue
            ratio = softer if regime == LOADING else 1.0 / softer
            if regime == LOADING:
                impacts.append(begin + clock)
            # the same force at the same place, measured from Xf instead of Xp or the other way round
            shift = state[2] - ratio * state[2]
            origin += shift
            state[0] -= shift
            state[2] *= ratio
            regime = UNLOADING if regime == LOADING else LOADING
        u1, v1, u2, v2 = state
        penetration = origin + u2 - softer * u2 if regime == LOADING else origin
        rows.append((origin + u1, origin + u2, v1, v2, penetration))
    columns = np.array(rows).T
    x1, x2, v1, v2, penetration = columns
    return Motion(x1, x2, v1, v2, penetration, np.array(impacts), np.array(contacts))


def _derivative(problem: Problem, kappa: float):
    """Right-hand side on a rock of stiffness ``kappa``, for positions counted from the contact's origin."""
    m1, m2, k, c, _kl, _ku, f, force, static, phase = problem
    omega = 2 * math.pi * f

    def derivative(t, state):
        u1, v1, u2, v2 = state.tolist()
        structure = k * (u1 - u2) + c * (v1 - v2)
        pull = force * math.sin(omega * t + phase) + structure - kappa * u2
        return np.array([v1, (static - structure) / m1, v2, pull / m2])

    return derivative


def _through(solver, derivative, crossings, start, state, end, max_step, options):
    """Go from ``start`` to the first crossing but at most to ``end``. Returns time, state and crossing, or None."""
    if end - start <= 0.0:
        return end, state, None
    stepper = solver(derivative, start, state, end, max_step=max_step, **options)
    while stepper.status == "running":
        before = stepper.y.copy()
        message = stepper.step()
        if stepper.status == "failed":
            raise RuntimeError(f"the solver stopped at {stepper.t}: {message}")
        crossed = _first_crossing(stepper, derivative, crossings)
        if crossed is None:
            continue
        guess, place, way = crossed
        t, state = _polished(solver, derivative, stepper.t_old, before, guess, place, options)
        return t, state, (place, way)
    return end, stepper.y.copy(), None


def _first_crossing(stepper, derivative, crossings):
    """The first crossing on the dense output of the last step: time, place, way; None where there is none."""
    t_old, t_new = stepper.t_old, stepper.t
    dense = stepper.dense_output()
    times = t_old + (t_new - t_old) * SAMPLES
    times[-1] = t_new
    values = dense(times)
    best = None
    for place, way in crossings:
        g = way * values[place]
        slope = way * values[3] if place == 2 else None
        for i in range(len(times) - 1):
            a, b = times[i], times[i + 1]
            if slope is None and g[i] < 0.0 and g[i + 1] < 0.0 and max(g[i], g[i + 1]) < -0.5 * abs(g[i + 1] - g[i]):
                # far from zero on the scale on which it changes
                continue
            low, high = a, b
            if g[i] < 0.0 and g[i + 1] >= 0.0:
                pass
            else:
                first, last = (
                    way * float(derivative(t, dense(t))[place]) if slope is None else slope[j]
                    for t, j in ((a, i), (b, i + 1))
                )
                # up and down again, or (from a start on the surface) down and up again
                rises = g[i] < 0.0 and first > 0.0 > last
                falls = g[i] >= 0.0 and first < 0.0 and g[i + 1] > 0.0
                if not (rises or falls) or first * last >= 0.0:
                    continue
                turn = brentq(lambda t, place=place: derivative(t, dense(t))[place], a, b, xtol=1e-18, rtol=ROOT_RTOL)
                top = way * dense(turn)[place]
                if rises and top >= 0.0:
                    low, high = a, turn
                elif falls and top < 0.0:
                    low, high = turn, b
                else:
                    continue
            t = brentq(lambda t, place=place: dense(t)[place], low, high, xtol=1e-18, rtol=ROOT_RTOL)
            if best is None or t < best[0]:
                best = t, place, way
            break
    return best


def _polished(solver, derivative, start, state, guess, place, options):
    """The event near ``guess``, from the state at the start of its step: time, state."""
    span = guess - start
    if span > 0.0:
        again = solver(derivative, start, state, guess, first_step=span, max_step=span, **options)
        while again.status == "running":
            again.step()
        state = again.y.copy()
    rate = derivative(guess, state)
    shift = -state[place] / rate[place] if rate[place] != 0.0 else 0.0
    if abs(shift) > 1e-3 * max(span, 1e-12):
        # a grazing event: the root on the dense output is as good
        shift = 0.0
    return guess + shift, state + shift * rate


def simulate_plainly(
    problem: Problem, periods: int, method: str = "RK45", rtol: float = 1e-8, atol: float = 1e-12
) -> Motion:
    """Simulate from the fresh start with ``solve_ivp`` and terminal events; positions and time run on from the start.

    Raises:
        RuntimeError: the solver gave up.
    """
    m1, m2, k, c, kl, ku, f, force, static, phase = problem
    omega = 2 * np.pi * f

    def free(t, state, origin):
        x1, v1, x2, v2 = state
        structure = k * (x1 - x2) + c * (v1 - v2)
        return [v1, (static - structure) / m1, v2, (force * np.sin(omega * t + phase) + structure) / m2]

    def loading(t, state, origin):
        x1, v1, x2, v2 = state
        structure = k * (x1 - x2) + c * (v1 - v2)
        rock = kl * (x2 - origin)
        return [v1, (static - structure) / m1, v2, (force * np.sin(omega * t + phase) + structure - rock) / m2]

    def unloading(t, state, origin):
        x1, v1, x2, v2 = state
        structure = k * (x1 - x2) + c * (v1 - v2)
        rock = ku * (x2 - origin)
        return [v1, (static - structure) / m1, v2, (force * np.sin(omega * t + phase) + structure - rock) / m2]

    def touch(t, state, origin):
        return state[2] - origin

    def leave(t, state, origin):
        return state[2] - origin

    def turn_back(t, state, origin):
        return state[3]

    def turn_on(t, state, origin):
        return state[3]

    for event, direction in ((touch, 1), (leave, -1), (turn_back, -1), (turn_on, 1)):
        event.terminal, event.direction = True, direction

    regimes = {FREE: (free, [touch]), LOADING: (loading, [turn_back]), UNLOADING: (unloading, [leave, turn_on])}
    ends = np.arange(periods + 1) / f
    table = np.zeros((periods + 1, 5))
    table[0, 0] = static / k
    filled = 1
    impacts, contacts = [], []
    xp = xf = 0.0
    t, state, regime = 0.0, table[0, :4].copy(), first_regime(problem)
    while filled <= periods:
        right, events = regimes[regime]
        origin = xp if regime == LOADING else xf
        ahead = ends[filled:]
        solution = integrate.solve_ivp(
            right, (t, ends[-1]), state, method, t_eval=ahead, events=events, args=(origin,), rtol=rtol, atol=atol
        )
        if solution.status < 0:
            raise RuntimeError(f"solve_ivp stopped at {t}: {solution.message}")
        for x1, v1, x2, v2 in solution.y.T if len(solution.t) else ():
            penetration = x2 - kl / ku * (x2 - xp) if regime == LOADING else xf
            table[filled] = x1, x2, v1, v2, penetration
            filled += 1
        if solution.status == 0:
            break
        index = next(i for i, times in enumerate(solution.t_events) if len(times))
        t, state = solution.t_events[index][0], solution.y_events[index][0]
        if regime == FREE:
            regime = LOADING
            contacts.append(t)
        elif regime == LOADING:
            xf = state[2] - kl / ku * (state[2] - xp)
            regime = UNLOADING
            impacts.append(t)
        elif index == 0:
            xp = xf
            regime = FREE
        else:
            xp = state[2] - ku / kl * (state[2] - xf)
            regime = LOADING
    x1, x2, v1, v2, penetration = table.T
    return Motion(x1, x2, v1, v2, penetration, np.array(impacts), np.array(contacts))
