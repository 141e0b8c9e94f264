"""Rock, or a bit, that turns under the blows and is not as stiff all around."""

import math

from drillenv.dynamics.effects import IN_CONTACT, Effect, Extra, Parameter


def _term(now, own, p, push, rates):
    rates[0] = 0.0 if p[0] == 0.0 else p[1]


def _shape(depth, regime, stiffness, ratio, own, p):
    return depth * (1.0 + p[0] * math.cos(own[1] + p[2]))


def _switched(before, after, own, p):
    if before == 0:
        # the stiffness may change only here, where there is no force that would jump
        own[1] = own[0]


EFFECT = Effect(
    name="rock-rotation",
    sentence="The rock or the bit turns, and the rock's stiffness goes with the angle.",
    equation=(
        "k_l and k_u times 1 + eps cos(a + psi), a' = Omega from 0 at the start, a as it stands where a contact begins"
    ),
    source="constitutive",
    parameters=(
        Parameter("eps", "share by which the stiffness varies over a turn", "1", 0.0, 0.9, 0.0, (0.06, 0.25)),
        Parameter("Omega", "speed of the rotation", "rad/s", 0.0, 1e3, 10.0, (8.0, 12.5)),
        Parameter("psi", "angle at the start", "rad", -2 * math.pi, 2 * math.pi, 0.0, (-math.pi, math.pi)),
    ),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="none",
    extras=(
        Extra("a", "angle turned since the start", "rad", 1.0, turns=True),
        Extra("a_contact", "a where the latest contact began", "rad", 1.0, turns=True),
    ),
    term=_term,
    shape=_shape,
    switched=_switched,
)
