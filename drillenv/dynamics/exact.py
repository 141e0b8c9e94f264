"""The exact engine: closed-form flow from switch to switch, for the linear rock law.

A regime ends where a known function of time first rises through zero: the gap ``w`` in free flight, ``-v2`` while
loading, ``v2`` or ``-w`` while unloading. All are sums of a polynomial, a harmonic and damped pairs, evaluated with
two derivatives from :mod:`drillenv.dynamics.flow`. The search walks over the regime in long steps. On each, the
quintic through values, slopes and curvatures at both ends is off by at most ``bound s^3 (h - s)^3 / 720``, with a
bound on the sixth derivative from the amplitudes of the modes. Written in Bernstein's basis of degree six that error
falls on the middle coefficient alone, so that seven numbers not above zero prove that nothing happens on the step, up
to its ends. A step that cannot be proved is halved. So a contact that begins and ends inside one step is not missed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINE, INLINED, INNER, KERNEL, apart
from drillenv.dynamics.flow import (
    AMPLITUDE,
    FAST,
    FORCED,
    FREE,
    FREE_Y,
    LOADING,
    M1,
    M2,
    OMEGA,
    RELATIVE,
    SHARE,
    SLOW,
    STATIC,
    STEP,
    STIFFNESS,
    SWING,
    UNLOADING,
    C,
    K,
    contact_coefficients,
    contact_matrix,
    contact_state,
    free_coefficients,
    free_matrix,
    free_state,
    pair_at,
    quickest,
    sine_cosine,
)
from drillenv.dynamics.fused import fma

TURN = 2 * math.pi

# Where things stand in a state vector.
Y, V1, V2, W, ORIGIN, CARRY, THETA, SINE, COSINE, TURNS, REGIME = range(11)
STATE_SIZE = 11
"""y, v1, v2, w (see flow.py), the origin with the rounding it owes, the phase in [0, 2 pi) with its sine and cosine,
whole turns, the regime."""

# Where things stand in a tally.
IMPACTS, CONTACTS, SWITCHES, PEAK_FORCE, PEAK_SPEED = range(5)
TALLY_SIZE = 5
"""Counts of force peaks, contacts and switches; the largest force in N and speed at contact in m/s."""

LOG_SIZE = 8
"""Columns of a log row: whole turns, regime, y, v1, v2, w, origin and phase at the start of a segment."""

FREE_STEP = 2.2
"""First step of the search in flight, over the quickest of its rates."""

# How a regime ends: not yet, at w = 0, or at v2 = 0.
GOES_ON, AT_SURFACE, AT_REST = 0, 1, 2


class Scratch(NamedTuple):
    """Working memory of the kernels, so that their loops allocate nothing."""

    work: np.ndarray
    channel: np.ndarray
    matrix: np.ndarray


@njit(**KERNEL)
def make_scratch() -> Scratch:
    """Fresh working memory."""
    return Scratch(np.zeros(16), np.zeros(17), np.zeros((4, 4)))


@njit(**INLINED)
def borrow_scratch(scratch: Scratch) -> Scratch:
    """The same memory, not counted."""
    return Scratch(borrowed(scratch.work), borrowed(scratch.channel), borrowed(scratch.matrix))


@njit(**KERNEL)
def fresh_state(model: np.ndarray, theta: float, state: np.ndarray) -> None:
    """The rig at rest: the cylinder leans on the spring, the indenter just touches rock never hit before."""
    state[:] = 0.0
    state[Y] = model[0, STATIC] / model[0, K]
    set_phase(theta, state)


@njit(**INLINE)
def set_phase(theta: float, state: np.ndarray) -> None:
    """Put the excitation at the phase ``theta`` in rad, in [0, 2 pi)."""
    state[THETA] = theta
    state[SINE], state[COSINE] = sine_cosine(theta)


@njit(**INLINE)
def acceleration(model: np.ndarray, state: np.ndarray, kappa: float) -> float:
    """Acceleration of the indenter in m/s^2."""
    push = model[0, AMPLITUDE] * state[SINE] + model[0, K] * state[Y] + model[0, C] * (state[V1] - state[V2])
    return (push - kappa * state[W]) / model[0, M2]


@njit(**INLINED)
def shift_origin(state: np.ndarray, shift: float) -> None:
    """Move the origin; the rounding is carried along (Kahan), so that hours of drift cost no digits."""
    owed = shift + state[CARRY]
    moved = state[ORIGIN] + owed
    state[CARRY] = owed - (moved - state[ORIGIN])
    state[ORIGIN] = moved


@njit(**INLINED)
def settle(model: np.ndarray, state: np.ndarray) -> int:
    """Set the regime that the state calls for, going over from k_l to k_u or back where it changes. Returns it.

    The sign of v2 decides; where v2 is zero that of the acceleration, and where that is zero too, of its derivative.
    """
    w = state[W]
    if w < 0.0:
        state[REGIME] = FREE
        return FREE
    regime = int(state[REGIME])
    kappa = model[LOADING if regime == LOADING else UNLOADING, STIFFNESS]
    heading = state[V2]
    if heading == 0.0:
        heading = acceleration(model, state, kappa)
    if heading == 0.0:
        speed = state[V1] - state[V2]
        shaker = (model[0, STATIC] - model[0, K] * state[Y] - model[0, C] * speed) / model[0, M1]
        heading = model[0, AMPLITUDE] * model[0, OMEGA] * state[COSINE] + model[0, K] * speed + model[0, C] * shaker
    if w == 0.0:
        wanted = LOADING if heading > 0.0 else FREE
    else:
        wanted = LOADING if heading > 0.0 else UNLOADING
        if regime != wanted:
            # the same force at the same place, measured from Xf instead of Xp or the other way round
            scaled = w * kappa / model[wanted, STIFFNESS]
            shift_origin(state, w - scaled)
            state[W] = scaled
    state[REGIME] = wanted
    return wanted


@njit(**INLINED)
def open_pair(decay: float, split: float, u: float, v: float, channel: np.ndarray, at: int) -> None:
    """Write u, v of exp(-decay t)(u C + v S) and of its first two time derivatives."""
    for i in range(at, at + 6, 2):
        channel[i], channel[i + 1] = u, v
        u, v = v - decay * u, split * u - decay * v


@njit(**INLINED)
def open_channel(model: np.ndarray, regime: int, state: np.ndarray, scratch: Scratch) -> None:
    """Take the coming regime apart into modes; write what the switch functions need into ``scratch.channel``.

    In contact: [0:2] sine and cosine part of v2, [5:11] u, v of the fast pair in v2 and its first two derivatives,
    [11:17] of the slow pair. In flight: [0:3] the parabola of w, [3:5] its sine and cosine part, [5:11] u, v of the
    pair in w and its first two derivatives.
    """
    work, channel = scratch.work, scratch.channel
    sine, cosine = state[SINE], state[COSINE]
    if regime == FREE:
        free_coefficients(model, state, sine, cosine, work)
        share = model[0, SHARE]
        channel[0] = work[0] - share * model[0, FREE_Y]
        channel[1] = work[1]
        channel[2] = work[2]
        channel[3] = -model[0, SWING] / model[0, OMEGA] - share * model[0, FREE_Y + 1]
        channel[4] = -share * model[0, FREE_Y + 2]
        open_pair(model[0, RELATIVE], model[0, RELATIVE + 1], -share * work[3], -share * work[4], channel, 5)
        return
    contact_coefficients(model, regime, state, sine, cosine, work)
    channel[0], channel[1] = model[regime, FORCED + 6], model[regime, FORCED + 10]
    open_pair(model[regime, FAST], model[regime, FAST + 1], work[2], work[6], channel, 5)
    open_pair(model[regime, SLOW], model[regime, SLOW + 1], work[10], work[14], channel, 11)


@njit(**INLINED)
def probe_free(model: np.ndarray, channel: np.ndarray, theta: float, t: float) -> tuple[float, float, float]:
    """w, v2 and the acceleration, a time ``t`` into a flight that began at phase ``theta``."""
    omega = model[0, OMEGA]
    c, s = pair_at(model[0, RELATIVE], model[0, RELATIVE + 1], model[0, RELATIVE + 2], t)
    sine, cosine = sine_cosine(theta + omega * t)
    wave = channel[3] * sine + channel[4] * cosine
    wave_speed = omega * (channel[3] * cosine - channel[4] * sine)
    w = fma(t, fma(0.5 * t, channel[2], channel[1]), channel[0]) + fma(c, channel[5], fma(s, channel[6], wave))
    v = fma(t, channel[2], channel[1]) + fma(c, channel[7], fma(s, channel[8], wave_speed))
    a = fma(-omega * omega, wave, channel[2]) + fma(c, channel[9], s * channel[10])
    return w, v, a


@njit(**INLINED)
def probe_contact(
    model: np.ndarray, regime: int, channel: np.ndarray, work: np.ndarray, theta: float, t: float
) -> tuple[float, float, float, float]:
    """w, v2, the acceleration and its derivative, a time ``t`` into a contact regime that began at phase ``theta``."""
    omega = model[0, OMEGA]
    fc, fs = pair_at(model[regime, FAST], model[regime, FAST + 1], model[regime, FAST + 2], t)
    sc, ss = pair_at(model[regime, SLOW], model[regime, SLOW + 1], model[regime, SLOW + 2], t)
    sine, cosine = sine_cosine(theta + omega * t)
    w = model[regime, FORCED + 3] + sine * model[regime, FORCED + 7] + cosine * model[regime, FORCED + 11]
    w += fma(fc, work[3], fs * work[7]) + fma(sc, work[11], ss * work[15])
    wave = channel[0] * sine + channel[1] * cosine
    v = wave + fma(fc, channel[5], fs * channel[6]) + fma(sc, channel[11], ss * channel[12])
    a = omega * (channel[0] * cosine - channel[1] * sine)
    a += fma(fc, channel[7], fs * channel[8]) + fma(sc, channel[13], ss * channel[14])
    j = fma(fc, channel[9], fs * channel[10]) + fma(sc, channel[15], fma(ss, channel[16], -omega * omega * wave))
    return w, v, a, j


@njit(**INLINED)
def probe(
    model: np.ndarray, regime: int, release: bool, scratch: Scratch, theta: float, t: float
) -> tuple[float, float, float, float]:
    """The switch function, its first two derivatives, and w. ``release``: unloading asked for w instead of v2."""
    if regime == FREE:
        w, v, a = probe_free(model, scratch.channel, theta, t)
        return w, v, a, w
    w, v, a, j = probe_contact(model, regime, scratch.channel, scratch.work, theta, t)
    if release:
        return -w, -v, -a, w
    if regime == LOADING:
        return -v, -a, -j, w
    return v, a, j, w


@njit(**INLINED)
def sixth_derivative_bounds(model: np.ndarray, regime: int, channel: np.ndarray) -> tuple[float, float, float]:
    """Bounds on the sixth derivative of the switch function (w in flight, v2 in contact) over the whole regime.

    Returns (lasting, fading, rate): the bound at a time t into the regime is ``lasting + fading * exp(-rate * t)``.
    """
    quick = model[0, OMEGA] ** 6
    if regime == FREE:
        fading, rate = _pair_bound(model, 0, RELATIVE, channel[5], channel[6])
        return quick * (abs(channel[3]) + abs(channel[4])), fading, rate
    fading, rate = _pair_bound(model, regime, FAST, channel[5], channel[6])
    slow, _rate = _pair_bound(model, regime, SLOW, channel[11], channel[12])
    return quick * (abs(channel[0]) + abs(channel[1])) + slow, fading, rate


@njit(**INLINED)
def _pair_bound(model: np.ndarray, regime: int, at: int, u: float, v: float):
    """Bound on the sixth derivative of exp(-decay t)(u C + v S) at t = 0, and the rate at which the bound falls."""
    decay, split, root = model[regime, at], model[regime, at + 1], model[regime, at + 2]
    rate = quickest(decay, split, root)
    # near critical damping S is t exp(-decay t), never above 1 / (e decay)
    reach = 6.0 / rate + min(1.0 / root if root > 0.0 else np.inf, 1.0 / decay if decay > 0.0 else np.inf)
    return rate**6 * (abs(u) + abs(v) * reach), decay - root if split > 0.0 else decay


@njit(**INLINED)
def stays_below(f0: float, d0: float, c0: float, f1: float, d1: float, c1: float, h: float, bound: float) -> bool:
    """Whether a function with values f, slopes d and curvatures c at 0 and h surely stays below zero in between.

    ``bound`` is on its sixth derivative. See the head of this file.
    """
    first, last = f0 + h * d0 / 5.0, f1 - h * d1 / 5.0
    second = f0 + h * (0.4 * d0 + 0.05 * h * c0)
    fourth = f1 + h * (0.05 * h * c1 - 0.4 * d1)
    middle = 0.5 * (second + fourth) + bound * h**6 / 14400.0
    if f0 > 0.0 or f1 > 0.0 or middle >= 0.0:
        return False
    return (
        f0 + 5.0 * first <= 0.0
        and first + 2.0 * second <= 0.0
        and last + 2.0 * fourth <= 0.0
        and f1 + 5.0 * last <= 0.0
    )


@njit(**INLINED)
def quintic_root(f0: float, d0: float, c0: float, f1: float, d1: float, c1: float, h: float) -> float:
    """Where the quintic through the values at 0 and h rises through zero, for f0 <= 0 <= f1; a first guess."""
    rise = f1 - f0
    a1, a2 = h * d0, 0.5 * h * h * c0
    b1, b2 = h * d1, 0.5 * h * h * c1
    a3 = 10.0 * rise - 6.0 * a1 - 4.0 * b1 - 3.0 * a2 + b2
    a4 = -15.0 * rise + 8.0 * a1 + 7.0 * b1 + 3.0 * a2 - 2.0 * b2
    a5 = 6.0 * rise - 3.0 * (a1 + b1) - a2 + b2
    a0 = f0
    if f0 == 0.0:
        # the root at the start is not the one looked for
        a0, a1, a2, a3, a4, a5 = a1, a2, a3, a4, a5, 0.0
    top = a0 + a1 + a2 + a3 + a4 + a5
    s = -a0 / (top - a0) if a0 < 0.0 < top else 0.5
    # two of Halley's steps are enough for a guess
    for _ in range(2):
        value = a0 + s * (a1 + s * (a2 + s * (a3 + s * (a4 + s * a5))))
        slope = a1 + s * (2.0 * a2 + s * (3.0 * a3 + s * (4.0 * a4 + s * 5.0 * a5)))
        bend = a2 + s * (3.0 * a3 + s * (6.0 * a4 + s * 10.0 * a5))
        s -= value * slope / (slope * slope - value * bend)
        if not 0.0 < s <= 1.0:
            return 0.5 * h
    return h * s


@njit(**INLINED)
def first_root(
    model: np.ndarray,
    regime: int,
    release: bool,
    scratch: Scratch,
    theta: float,
    low: float,
    high: float,
    guess: float,
    rate: float,
) -> tuple[float, float, float, float]:
    """Where the switch function rises through zero in (low, high], by safeguarded Newton-Halley.

    ``rate`` in 1/s is how fast the function changes, to judge when a step is the last. Returns the time to
    about 1e-10 of itself, the slope and curvature of the function there, and w.
    """
    t = guess
    f = d = c = w = 0.0
    for _ in range(200):
        f, d, c, w = probe(model, regime, release, scratch, theta, t)
        if f < 0.0:
            low = t
        else:
            high = t
        following = 0.5 * (low + high)
        if d > 0.0:
            step = -f / d
            bend = 1.0 - 0.5 * f * c / (d * d)
            if bend > 0.5:
                step /= bend
            if low <= t + step <= high:
                following = t + step
                # Halley's step leaves an error of its own cube; what is this small `complete` takes away
                bend = (rate + abs(c / d)) * step
                if abs(step) * bend * bend <= 1e-10 * t:
                    return following, d + c * step, c, w
        if following == t or high - low <= 4e-16 * high:
            return following, d, c, w
        t = following
    return t, d, c, w


@njit(**INLINED)
def highest_point(model: np.ndarray, regime: int, scratch: Scratch, theta: float, low: float, high: float) -> float:
    """A maximum of the switch function in [low, high], where it rises at one end and falls at the other."""
    t = 0.5 * (low + high)
    for _ in range(60):
        _f, d, c, _w = probe(model, regime, False, scratch, theta, t)
        if d > 0.0:
            low = t
        else:
            high = t
        following = t - d / c if c < 0.0 else 0.5 * (low + high)
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-12 * t or high - low <= 4e-16 * high:
            break
        t = following
    return t


@njit(**INLINED)
def curvature_at_start(model: np.ndarray, regime: int, channel: np.ndarray, state: np.ndarray) -> float:
    """Second derivative of the switch function where the regime begins."""
    square = model[0, OMEGA] ** 2
    if regime == FREE:
        return channel[2] - square * (channel[3] * state[SINE] + channel[4] * state[COSINE]) + channel[9]
    jerk = channel[9] + channel[15] - square * (channel[0] * state[SINE] + channel[1] * state[COSINE])
    return -jerk if regime == LOADING else jerk


@njit(**INLINED)
def find_switch(model: np.ndarray, regime: int, state: np.ndarray, scratch: Scratch, limit: float) -> tuple[float, int]:
    """Time to the end of this regime, and how it ends: GOES_ON (at ``limit``), AT_SURFACE or AT_REST."""
    theta = state[THETA]
    if regime == FREE:
        rate = quickest(model[0, RELATIVE], model[0, RELATIVE + 1], model[0, RELATIVE + 2])
        usual = FREE_STEP / max(model[0, OMEGA], rate)
        f0, d0 = state[W], state[V2]
    elif regime == LOADING:
        usual = model[LOADING, STEP]
        f0, d0 = -state[V2], -acceleration(model, state, model[LOADING, STIFFNESS])
    else:
        usual = model[UNLOADING, STEP]
        f0, d0 = state[V2], acceleration(model, state, model[UNLOADING, STIFFNESS])
    c0 = curvature_at_start(model, regime, scratch.channel, state)
    lasting, fading, rate = sixth_derivative_bounds(model, regime, scratch.channel)
    bound = lasting + fading
    t0, w0 = 0.0, state[W]
    step = usual
    while True:
        t1 = min(t0 + step, limit)
        h = t1 - t0
        # where steps this short prove nothing, the function touches zero, or as good as
        grazing = h < 1e-3 * usual
        f1, d1, c1, w1 = probe(model, regime, False, scratch, theta, t1)
        if grazing and d0 > 0.0 and d1 < 0.0 and f1 < 0.0:
            t1 = highest_point(model, regime, scratch, theta, t0, t1)
            h = t1 - t0
            f1, d1, c1, w1 = probe(model, regime, False, scratch, theta, t1)
        if regime == UNLOADING and w1 <= 0.0:
            # w falls through zero in between; it is the end unless v2 rises through zero before
            guess = t0 + quintic_root(-w0, -f0, -d0, -w1, -f1, -d1, h)
            tau = first_root(model, regime, True, scratch, theta, t0, t1, guess, 1.0 / usual)[0]
            sure = grazing or (f1 <= 0.0 and stays_below(f0, d0, c0, f1, d1, c1, h, bound))
            if not sure:
                # v2 may have turned after the release: prove it up to there
                _w, v, a, j = probe_contact(model, regime, scratch.channel, scratch.work, theta, tau)
                sure = stays_below(f0, d0, c0, v, a, j, tau - t0, bound)
            if sure:
                return tau, AT_SURFACE
        elif f1 >= 0.0:
            guess = t0 + quintic_root(f0, d0, c0, f1, d1, c1, h)
            tau, d, c, w = first_root(model, regime, False, scratch, theta, t0, t1, guess, 1.0 / usual)
            if grazing or stays_below(f0, d0, c0, 0.0, d, c, tau - t0, bound):
                if regime == UNLOADING and w <= 0.0:
                    # w dipped below zero and came back within the step
                    guess = t0 + 0.5 * (tau - t0)
                    return first_root(model, regime, True, scratch, theta, t0, tau, guess, 1.0 / usual)[0], AT_SURFACE
                return tau, AT_SURFACE if regime == FREE else AT_REST
        elif grazing or stays_below(f0, d0, c0, f1, d1, c1, h, bound):
            if t1 >= limit:
                return limit, GOES_ON
            t0, f0, d0, c0, w0 = t1, f1, d1, c1, w1
            bound = lasting + fading * math.exp(-rate * t0)
            # as far as the quintic can be trusted (its error grows with the sixth power), and at most half a period
            reach = 4000.0 * abs(f0) / (bound * usual**6)
            if reach > 729.0:
                step = 4.0 * usual if reach > 4096.0 else 3.0 * usual
            elif reach > 11.4:
                step = 2.0 * usual if reach > 64.0 else 1.5 * usual
            else:
                step = usual
            step = min(step, 3.0 / model[0, OMEGA])
            continue
        step = 0.5 * h


@njit(**INLINED)
def begin(model: np.ndarray, state: np.ndarray, scratch: Scratch) -> int:
    """Enter the regime that the state calls for. Returns it."""
    regime = settle(model, state)
    open_channel(model, regime, state, scratch)
    return regime


@njit(**INLINED)
def put_on_switch(model: np.ndarray, state: np.ndarray, regime: int, ending: int, sine: float) -> float:
    """Move a state that is within about 1e-10 of a regime's length from its switch onto it. Returns the time it takes.

    To first order: the square of so short a time is below rounding.
    """
    kappa = 0.0 if regime == FREE else model[regime, STIFFNESS]
    speed = state[V1] - state[V2]
    structure = model[0, K] * state[Y] + model[0, C] * speed
    indenter = (model[0, AMPLITUDE] * sine + structure - kappa * state[W]) / model[0, M2]
    shift = -state[W] / state[V2] if ending == AT_SURFACE else -state[V2] / indenter
    # a grazing switch has no slope to go by, and Newton has met it to the last digit already
    if abs(shift) > 1e-9 or shift != shift:
        shift = 0.0
    state[Y] += shift * speed
    state[V1] += shift * (model[0, STATIC] - structure) / model[0, M1]
    if ending == AT_SURFACE:
        state[V2] += shift * indenter
        state[W] = 0.0
    else:
        state[V2] = 0.0
    return shift


@njit(**INLINED)
def complete(model: np.ndarray, state: np.ndarray, regime: int, limit: float, scratch: Scratch) -> float:
    """Go through the regime just begun, to its switch but at most ``limit`` s on. Returns the time taken."""
    tau, ending = find_switch(model, regime, state, scratch, limit)
    theta = state[THETA] + model[0, OMEGA] * tau
    sine, cosine = sine_cosine(theta)
    if regime == FREE:
        free_state(model, scratch.work, sine, cosine, tau, state)
    else:
        contact_state(model, regime, scratch.work, sine, cosine, tau, state)
    if ending == GOES_ON:
        # rounding must not leave a contact that has not begun
        if regime == FREE:
            state[W] = min(state[W], 0.0)
    else:
        shift = put_on_switch(model, state, regime, ending, sine)
        tau += shift
        theta += model[0, OMEGA] * shift
        sine, cosine = sine + model[0, OMEGA] * shift * cosine, cosine - model[0, OMEGA] * shift * sine
    while theta >= TURN:
        theta -= TURN
        state[TURNS] += 1.0
    state[THETA], state[SINE], state[COSINE] = theta, sine, cosine
    return tau


@njit(**INLINED)
def count(model: np.ndarray, state: np.ndarray, before: int, regime: int, tally: np.ndarray) -> None:
    """Enter the switch from ``before`` to ``regime``, on which the state stands, into the tally."""
    if regime == before:
        return
    tally[SWITCHES] += 1.0
    if regime == UNLOADING:
        tally[IMPACTS] += 1.0
        tally[PEAK_FORCE] = max(tally[PEAK_FORCE], model[UNLOADING, STIFFNESS] * state[W])
    elif before == FREE:
        tally[CONTACTS] += 1.0
        tally[PEAK_SPEED] = max(tally[PEAK_SPEED], state[V2])


@njit(**INLINED)
def reduced(left: float, owed: float, taken: float) -> tuple[float, float]:
    """The time left after ``taken``, and the rounding it owes (Kahan): thousands of switches must not move the end."""
    if taken == left:
        return 0.0, 0.0
    step = -taken - owed
    remaining = left + step
    return remaining, (remaining - left) - step


@njit(**KERNEL)
def advance(model: np.ndarray, state: np.ndarray, duration: float, tally: np.ndarray, scratch: Scratch) -> None:
    """Move the state ``duration`` seconds on; what happens is added to the tally."""
    apart()
    model, state, scratch = borrowed(model), borrowed(state), borrow_scratch(scratch)
    left, owed = duration, 0.0
    while left > 0.0:
        before = int(state[REGIME])
        regime = begin(model, state, scratch)
        count(model, state, before, regime, tally)
        left, owed = reduced(left, owed, complete(model, state, regime, left, scratch))


@njit(**KERNEL)
def advance_period(model: np.ndarray, state: np.ndarray, tally: np.ndarray, scratch: Scratch) -> None:
    """Move the state one excitation period on, back to exactly the phase where it stands."""
    apart()
    theta, turns = state[THETA], state[TURNS]
    advance(model, state, TURN / model[0, OMEGA], tally, scratch)
    set_phase(theta, state)
    state[TURNS] = turns + 1.0


@njit(**INNER)
def advance_tangent(
    model: np.ndarray, state: np.ndarray, tangent: np.ndarray, tally: np.ndarray, scratch: Scratch
) -> None:
    """As ``advance_period``; also multiplies ``tangent`` (4, n) by the derivative of the map of (y, v1, v2, w).

    The vector field is continuous over every switch in these coordinates, apart from the change of scale of w where
    k_l takes over from k_u or the other way round, so that the switch (saltation) matrices are 1 or diag(1, 1, 1, r).
    """
    apart()
    theta, turns = state[THETA], state[TURNS]
    model, state, scratch = borrowed(model), borrowed(state), borrow_scratch(scratch)
    left = TURN / model[0, OMEGA]
    matrix = scratch.matrix
    columns = tangent.shape[1]
    while left > 0.0:
        before = int(state[REGIME])
        regime = begin(model, state, scratch)
        count(model, state, before, regime, tally)
        if before != FREE and regime != FREE and regime != before:
            ratio = model[before, STIFFNESS] / model[regime, STIFFNESS]
            for j in range(columns):
                tangent[3, j] *= ratio
        tau = complete(model, state, regime, left, scratch)
        left -= tau
        if regime == FREE:
            free_matrix(model, tau, matrix)
        else:
            contact_matrix(model, regime, tau, matrix)
        for j in range(columns):
            a, b, c, d = tangent[0, j], tangent[1, j], tangent[2, j], tangent[3, j]
            for i in range(4):
                tangent[i, j] = matrix[i, 0] * a + matrix[i, 1] * b + matrix[i, 2] * c + matrix[i, 3] * d
    set_phase(theta, state)
    state[TURNS] = turns + 1.0


@njit(**KERNEL)
def advance_logged(
    model: np.ndarray, state: np.ndarray, duration: float, log: np.ndarray, scratch: Scratch
) -> tuple[int, float]:
    """Move the state up to ``duration`` seconds on, writing a row of ``log`` (n, LOG_SIZE) at each segment's start.

    Returns the rows written and the time left, which is above zero where the log was full.
    """
    model, state, scratch = borrowed(model), borrowed(state), borrow_scratch(scratch)
    left, owed = duration, 0.0
    row = 0
    while left > 0.0 and row < log.shape[0]:
        regime = begin(model, state, scratch)
        log[row, 0] = state[TURNS]
        log[row, 1] = regime
        for i in range(4):
            log[row, 2 + i] = state[i]
        log[row, 6] = state[ORIGIN]
        log[row, 7] = state[THETA]
        row += 1
        left, owed = reduced(left, owed, complete(model, state, regime, left, scratch))
    return row, left


@njit(**KERNEL)
def run_periods(model: np.ndarray, state: np.ndarray, periods: int, tally: np.ndarray) -> None:
    """Move the state whole periods on, with no stop at their ends: the bare engine, as `make bench` times it."""
    advance(model, state, periods * TURN / model[0, OMEGA], tally, make_scratch())
