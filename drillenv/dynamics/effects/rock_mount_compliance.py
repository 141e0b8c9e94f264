"""A rock on a mount that gives, and a bed under the mount that gives as well."""

import math

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _stiffening(deflection, p, stiffness):
    compliance, mass, *_, rate = p
    # of a mount that is rigid there is no deflection
    return rate**2 * deflection**3 / (compliance * mass) if compliance > 0.0 else np.zeros_like(deflection)


def _scalars(p):
    compliance, mass, ratio, bed_mass, bed_compliance, bed_ratio, _ = p
    if compliance == 0.0:
        return {}
    square = 1.0 / (compliance * mass)
    found = {"mount_gain": 1.0 / mass, "mount_square": square, "mount_damping": 2.0 * ratio * math.sqrt(square)}
    if bed_compliance > 0.0:
        square = 1.0 / (bed_compliance * bed_mass)
        found |= {
            "bed_share": mass / bed_mass,
            "bed_square": square,
            "bed_damping": 2.0 * bed_ratio * math.sqrt(square),
        }
    return found


EFFECT = Effect(
    name="rock-mount-compliance",
    sentence="The rock sits on a mount that gives under the blows, and swings back.",
    equation=(
        "m_r u'' = R - h, h = d / s_r (1 + (e_r d)^2) + 2 zeta_r sqrt(m_r / s_r) d', d = u - b, the rock law acting on "
        "X2 - u; m_b b'' = h - b / s_b - 2 zeta_b sqrt(m_b / s_b) b', b = 0 where s_b = 0"
    ),
    source=(
        "constitutive; the stiffening G. Duffing, Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz und ihre "
        "technische Bedeutung, Vieweg, Braunschweig, 1918"
    ),
    parameters=(
        Parameter("s_r", "compliance of the mount, 1 / stiffness", "m/N", 0.0, 1e-5, 0.0, (5e-9, 5e-8)),
        Parameter("m_r", "mass of the rock and what it is clamped in", "kg", 0.1, 1e4, 50.0, (10.0, 100.0)),
        Parameter("zeta_r", "damping ratio of the mount", "1", 0.0, 2.0, 0.05, (0.02, 0.2)),
        Parameter("m_b", "mass of the bed under the mount", "kg", 0.1, 1e5, 100.0, (100.0, 100.0)),
        Parameter("s_b", "compliance of what that stands on", "m/N", 0.0, 1e-5, 0.0, (0.0, 0.0)),
        Parameter("zeta_b", "damping ratio of that", "1", 0.0, 2.0, 0.05, (0.05, 0.05)),
        Parameter(
            "e_r", "one over the deflection that doubles the mount's stiffness", "1/m", 0.0, 1e6, 0.0, (0.0, 0.0)
        ),
    ),
    balances=("contact",),
    regimes=EVERYWHERE,
    energy="moves",
    extras=(
        Extra("u'", "speed of the rock's face", "m/s", 0.1, kept="u'"),
        Extra("b", "displacement of the bed", "m", 1e-5, kept="b"),
        Extra("b'", "speed of the bed", "m/s", 0.1, kept="b'"),
    ),
    scalars=_scalars,
    laws={"mount-spring": _stiffening},
    forms=(
        Form(
            "one mass",
            ("s_r", "m_r", "zeta_r"),
            tuple((s, m, 0.08) for m in (15.0, 40.0, 85.0) for s in (8e-9, 2e-8, 4.5e-8)),
        ),
        Form(
            "stiffening",
            ("s_r", "m_r", "zeta_r", "e_r"),
            tuple((s, m, 0.08, e) for m in (20.0, 60.0) for s in (2e-8, 6e-8) for e in (1e4, 3e4)),
        ),
        Form(
            "two masses",
            ("s_r", "m_r", "zeta_r", "m_b", "s_b", "zeta_b"),
            tuple((s, m, 0.08, b, 1.5e-8, 0.08) for m in (15.0, 30.0) for s in (1e-8, 3e-8) for b in (100.0, 300.0)),
        ),
    ),
    free_laws=("mount",),
)
