"""Dry friction on the guides of the shaker body."""

from drillenv.dynamics.constitutive import friction
from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _scalars(p):
    return friction.scalars("shaker", p)


EFFECT = Effect(
    name="guide-friction",
    sentence="Dry friction in the guides holds the shaker body back, and fast while the other forces are weak.",
    equation=friction.equation("shaker body", "fc1", "vs1", "ds1", "sd1", "rs1", "vr1", "X1"),
    source=friction.SOURCE,
    parameters=(
        Parameter("fc1", "friction force on the shaker body", "N", 0.0, 1e5, 0.0, (15.0, 80.0)),
        Parameter("vs1", "speed at which a lubricated guide begins to slide freely", "m/s", 0.0, 1.0, 0.0, (0.0, 0.0)),
        Parameter("ds1", "displacement by which it gives before it slides", "m", 0.0, 5e-5, 0.0, (0.0, 0.0)),
        Parameter("sd1", "damping of what gives", "N s/m", 0.0, 1e6, 0.0, (0.0, 0.0)),
        Parameter("rs1", "share by which it is larger at low speeds, of vs1 or ds1", "1", 0.0, 10.0, 0.0, (0.0, 0.0)),
        Parameter("vr1", "speed at which that has faded", "m/s", 1e-6, 10.0, 1e-3, (1e-3, 1e-3)),
    ),
    balances=("shaker",),
    regimes=EVERYWHERE,
    energy="loses",
    extras=(
        Extra("slide1", "way the shaker body slides: 1, -1, or 0 while it sticks", "1", 1.0, kept="slide1"),
        Extra("b1", "force of the bristles that give", "N", 10.0, kept="bent1"),
    ),
    laws={"guide": friction.law},
    scalars=_scalars,
    forms=(
        Form("coulomb", ("fc1",), ((20.0,), (60.0,))),
        Form("rounded", ("fc1", "vs1"), ((30.0, 3e-4),)),
        Form("stribeck", ("fc1", "vs1", "rs1", "vr1"), ((20.0, 1e-4, 0.4, 1e-3), (60.0, 1e-4, 0.4, 1e-3))),
        Form("dahl", ("fc1", "ds1"), ((20.0, 5e-7), (60.0, 5e-7))),
        Form(
            "lugre", ("fc1", "ds1", "sd1", "rs1", "vr1"), ((20.0, 5e-7, 8e3, 0.4, 1e-3), (60.0, 5e-7, 8e3, 0.4, 1e-3))
        ),
    ),
    free_laws=("guide",),
)
