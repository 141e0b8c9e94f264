"""The paper's model over the windows of a recording, by the exact engine: forty times as fast as the general one."""

from __future__ import annotations

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.exact import (
    REGIME,
    THETA,
    TURN,
    V1,
    V2,
    Scratch,
    W,
    Y,
    begin,
    borrow_scratch,
    complete,
    set_phase,
)
from drillenv.dynamics.flow import (
    AMPLITUDE,
    FREE,
    INLINE,
    KERNEL,
    LOADING,
    M2,
    OMEGA,
    STIFFNESS,
    UNLOADING,
    C,
    K,
    contact_state,
    free_state,
    sine_cosine,
)


@njit(**INLINE)
def _sample(model, regime: int, scratch: Scratch, theta: float, t: float, place: np.ndarray):
    """Force and acceleration, ``t`` into the regime that began at phase ``theta``."""
    sine, cosine = sine_cosine(theta + model[0, OMEGA] * t)
    if regime == FREE:
        free_state(model, scratch.work, sine, cosine, t, place)
        force = 0.0
    else:
        contact_state(model, regime, scratch.work, sine, cosine, t, place)
        force = model[regime, STIFFNESS] * place[W]
    push = model[0, AMPLITUDE] * sine + model[0, K] * place[Y] + model[0, C] * (place[V1] - place[V2])
    return force, (push - force) / model[0, M2]


@njit(**KERNEL)
def run_windows(
    model, states, starts, phase: float, lead: float, rate: float, room, scratch: Scratch, force, acceleration, ends
):
    """Run every window from its state.

    Args:
        model: From :func:`drillenv.dynamics.flow.make_model`.
        states: (windows, 4) y, v1, v2, w, off the rock.
        starts: (windows + 1,) samples.
        phase: Of the excitation at sample 0, in rad.
        lead: Seconds before its first sample at which the first window has its state.
        rate: Samples a second.
        room: (2, STATE_SIZE) working memory.
        scratch: From make_scratch.
        force, acceleration: (n,) to fill.
        ends: (windows, 4) to fill.
    """
    model, states, room = borrowed(model), borrowed(states), borrowed(room)
    force, acceleration, scratch = borrowed(force), borrowed(acceleration), borrow_scratch(scratch)
    state, place = room[0], room[1]
    for k in range(states.shape[0]):
        first, after = starts[k], starts[k + 1]
        state[:] = 0.0
        for i in range(4):
            state[i] = states[k, i]
        ahead = lead if k == 0 else 0.0
        turned = phase + model[0, OMEGA] * (first / rate - ahead)
        set_phase(turned - TURN * np.floor(turned / TURN), state)
        now, end, index = -ahead, (after - first) / rate, first
        while now < end:
            regime = begin(model, state, scratch)
            theta = state[THETA]
            taken = complete(model, state, regime, end - now, scratch)
            following = end if taken >= end - now else now + taken
            while index < after and (index - first) / rate < following:
                t = min(max((index - first) / rate - now, 0.0), taken)
                force[index], acceleration[index] = _sample(model, regime, scratch, theta, t, place)
                index += 1
            now = following
        for i in range(4):
            ends[k, i] = state[i]
        if state[REGIME] == LOADING:
            # w is counted from Xf everywhere else
            ends[k, 3] *= model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS]
