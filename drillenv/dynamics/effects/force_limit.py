"""A force that saturates."""

import math

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, Effect, Parameter


def _term(now, own, p, push, rates):
    force = now.drive * math.sin(now.theta)
    push[ON_INDENTER] += min(max(force, -p[0]), p[0]) - force


def _corner(now, a1, a2, p):
    if p[0] >= now.drive:
        return math.inf
    # four a turn; one just reached is behind
    rise, ahead = math.asin(p[0] / now.drive), now.theta + 1e-9
    into = ahead - math.pi * math.floor(ahead / math.pi)
    to = rise if into < rise else math.pi - rise if into < math.pi - rise else math.pi + rise
    return (to - into + 1e-9) / now.omega


def _on_body(position, velocity, applied, stiffness, p):
    return np.clip(applied, -p[0], p[0]) - applied


EFFECT = Effect(
    name="force-limit",
    sentence="The drive cannot push or pull harder than a certain force.",
    equation="drive force min(max(F_a sin(theta), -F_max), F_max); on a body the applied force likewise",
    source="constitutive",
    parameters=(Parameter("F_max", "largest force of the drive", "N", 1.0, 1e6, 1e6, (150.0, 400.0)),),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="moves",
    term=_term,
    corner=_corner,
    on_body=_on_body,
)
