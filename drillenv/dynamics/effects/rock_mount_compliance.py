"""A rock on a mount that gives."""

import math

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _scalars(p):
    if p[0] == 0.0:
        return {}
    square = 1.0 / (p[0] * p[1])
    return {"mount_gain": 1.0 / p[1], "mount_square": square, "mount_damping": 2.0 * p[2] * math.sqrt(square)}


EFFECT = Effect(
    name="rock-mount-compliance",
    sentence="The rock sits on a mount that gives under the blows, and swings back.",
    equation="m_r u'' = R - u / s_r - 2 zeta_r sqrt(m_r / s_r) u', the rock law acting on X2 - u",
    source="constitutive",
    parameters=(
        Parameter("s_r", "compliance of the mount, 1 / stiffness", "m/N", 0.0, 1e-5, 0.0, (5e-9, 5e-8)),
        Parameter("m_r", "mass of the rock and what it is clamped in", "kg", 0.1, 1e4, 50.0, (10.0, 100.0)),
        Parameter("zeta_r", "damping ratio of the mount", "1", 0.0, 2.0, 0.05, (0.02, 0.2)),
    ),
    balances=("contact",),
    regimes=EVERYWHERE,
    energy="moves",
    extras=(Extra("u'", "speed of the rock's face", "m/s", 0.1, kept="u'"),),
    scalars=_scalars,
    forms=(
        Form(
            "one mass",
            ("s_r", "m_r", "zeta_r"),
            tuple((s, m, 0.08) for m in (15.0, 40.0, 85.0) for s in (8e-9, 2e-8, 4.5e-8)),
        ),
    ),
    free_laws=("mount",),
)
