"""A force that saturates."""

import math

import numpy as np

from drillenv.dynamics.corners import time_to
from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, ON_SHAKER, Effect, Parameter
from drillenv.dynamics.forms import Form

NONE = 1e6
"""N: at this force, the bound, nothing is limited."""


def _term(now, own, p, push, rates):
    force = now.drive * math.sin(now.theta)
    push[ON_INDENTER] += min(max(force, -p[0]), p[0]) - force
    spring = now.k * now.y
    lost = spring - min(max(spring, -p[1]), p[1])
    push[ON_SHAKER] += lost
    push[ON_INDENTER] -= lost


def _corner(now, a1, a2, p):
    first = math.inf
    for end in (-p[1] / now.k, p[1] / now.k):
        # a nanometre beside it is on it
        if p[1] < NONE and abs(now.y - end) >= 1e-9:
            first = min(first, time_to(now.y - end, now.closing, a1 - a2))
    if p[0] >= now.drive:
        return first
    # four a turn; one just reached is behind
    rise, ahead = math.asin(p[0] / now.drive), now.theta + 1e-9
    into = ahead - math.pi * math.floor(ahead / math.pi)
    to = rise if into < rise else math.pi - rise if into < math.pi - rise else math.pi + rise
    return min(first, (to - into + 1e-9) / now.omega)


def _on_body(position, velocity, applied, stiffness, p):
    spring = stiffness * position
    return np.clip(applied, -p[0], p[0]) - applied - (np.clip(spring, -p[1], p[1]) - spring)


def _drive_law(x, p, around):
    return np.clip(x, -p[0], p[0]) - x


def _spring_law(x, p, around):
    spring = around.k * x
    return np.clip(spring, -p[1], p[1]) - spring


EFFECT = Effect(
    name="force-limit",
    sentence="The drive, or the spring, cannot push or pull harder than a certain force.",
    equation=(
        "drive force min(max(F_a sin(theta), -F_max), F_max), spring force min(max(k (X1 - X2), -F_s), F_s); on a body "
        "the applied force and k position likewise"
    ),
    source="constitutive",
    parameters=(
        Parameter("F_max", "largest force of the drive", "N", 1.0, NONE, NONE, (150.0, 400.0)),
        Parameter("F_s", "largest force of the spring", "N", 1.0, NONE, NONE, (NONE, NONE)),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="moves",
    term=_term,
    corner=_corner,
    on_body=_on_body,
    forms=(
        Form("clipped", ("F_max",), ((200.0,), (280.0,), (380.0,)), {"drive-curve": _drive_law}),
        Form("clipped spring", ("F_s",), ((150.0,), (230.0,)), {"spring": _spring_law}),
    ),
)
