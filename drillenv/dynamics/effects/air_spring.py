"""Cylinder pressure that falls as the piston advances."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _scalars(p):
    return {"air_stiffness": p[0], "air_rate": 1.0 / p[1], "air_per_length": p[2]}


EFFECT = Effect(
    name="air-spring",
    sentence="The cylinder's force falls as the piston advances, and the supply restores it slowly.",
    equation=(
        "static force F_b - s, s' = k_a X1' - s / tau; of gas by Boyle's law s = F_b x / (1 / g_a + x), "
        "x' = X1' - x / tau, as soft as it is long, and stiffer under more pressure"
    ),
    source="constitutive",
    parameters=(
        Parameter("k_a", "stiffness of the enclosed air", "N/m", 0.0, 1e6, 0.0, (2e4, 1.5e5)),
        Parameter("tau", "time the supply takes to restore the pressure", "s", 1e-3, 100.0, 1.0, (0.1, 0.5)),
        Parameter("g_a", "one over the length of enclosed gas", "1/m", 0.0, 2e3, 0.0, (0.0, 0.0)),
    ),
    balances=("shaker",),
    regimes=EVERYWHERE,
    energy="moves",
    extras=(Extra("s", "force the cylinder has lost", "N", 10.0, kept="q"),),
    scalars=_scalars,
    forms=(
        Form("straight", ("k_a", "tau"), ((5e4, 0.1), (5e4, 0.4))),
        Form("gas", ("g_a", "tau"), ((200.0, 0.1), (200.0, 0.4))),
    ),
    free_laws=("air",),
)
