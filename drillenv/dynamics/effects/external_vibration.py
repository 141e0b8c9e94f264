"""Floor or machines that shake the rig at a frequency of their own."""

import math

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter


def _scalars(p):
    if p[0] == 0.0 and p[1] == 0.0:
        return {}
    return {
        "shaker_vibration": p[0],
        "indenter_vibration": p[1],
        "vibration_rate": 2.0 * math.pi * p[2],
        "vibration_phase": p[3],
    }


EFFECT = Effect(
    name="external-vibration",
    sentence="The floor or another machine shakes the rig at a frequency of its own.",
    equation="F1 sin(a + psi) on the shaker body and F2 sin(a + psi) on the indenter, a' = 2 pi f from 0 at the start",
    source="constitutive",
    parameters=(
        Parameter("F1", "amplitude of the force on the shaker body", "N", -1e5, 1e5, 0.0, (60.0, 250.0)),
        Parameter("F2", "amplitude of the force on the indenter", "N", -1e5, 1e5, 0.0, (0.5, 4.0)),
        Parameter("f", "frequency of the vibration", "Hz", 0.1, 1e3, 50.0, (18.0, 47.0)),
        Parameter("psi", "phase at the start", "rad", -2 * math.pi, 2 * math.pi, 0.0, (-math.pi, math.pi)),
    ),
    balances=("shaker", "indenter"),
    regimes=EVERYWHERE,
    energy="moves",
    extras=(Extra("a", "phase of the vibration since the start", "rad", 1.0, turns=True, kept="vibration"),),
    scalars=_scalars,
    free_laws=("vibration",),
)
