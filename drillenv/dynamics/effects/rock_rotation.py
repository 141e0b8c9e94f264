"""Rock, or a bit, that turns under the blows and is not as stiff all around."""

import math

from drillenv.dynamics.effects import IN_CONTACT, Effect, Extra, Parameter


def _scalars(p):
    if p[0] == 0.0:
        return {}
    return {"rotation_share": p[0], "rotation_rate": p[1], "rotation_phase": p[2]}


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
        Extra("a", "angle turned since the start", "rad", 1.0, turns=True, kept="rotation"),
        Extra("a_contact", "a where the latest contact began", "rad", 1.0, turns=True, kept="rotation_contact"),
    ),
    scalars=_scalars,
    free_laws=("rotation",),
)
