"""Dry friction on the indenter."""

from drillenv.dynamics.constitutive import friction
from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _scalars(p):
    return friction.scalars("indenter", p)


EFFECT = Effect(
    name="indenter-friction",
    sentence="Dry friction holds the indenter back, and fast while the other forces are weak.",
    equation=friction.equation("indenter", "fc2", "vs2", "ds2", "sd2", "rs2", "vr2", "X2"),
    source=friction.SOURCE,
    parameters=(
        Parameter("fc2", "friction force on the indenter", "N", 0.0, 1e5, 0.0, (15.0, 80.0)),
        Parameter("vs2", "speed at which a lubricated guide begins to slide freely", "m/s", 0.0, 1.0, 0.0, (0.0, 0.0)),
        Parameter("ds2", "displacement by which it gives before it slides", "m", 0.0, 5e-5, 0.0, (0.0, 0.0)),
        Parameter("sd2", "damping of what gives", "N s/m", 0.0, 1e6, 0.0, (0.0, 0.0)),
        Parameter("rs2", "share by which it is larger at low speeds, of vs2 or ds2", "1", 0.0, 10.0, 0.0, (0.0, 0.0)),
        Parameter("vr2", "speed at which that has faded", "m/s", 1e-6, 10.0, 0.05, (0.05, 0.05)),
    ),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="loses",
    extras=(
        Extra("slide2", "way the indenter slides: 1, -1, or 0 while it sticks", "1", 1.0, kept="slide2"),
        Extra("b2", "force of the bristles that give", "N", 10.0, kept="bent2"),
    ),
    laws={"indenter": friction.law},
    scalars=_scalars,
    forms=(
        Form("coulomb", ("fc2",), ((20.0,), (60.0,))),
        Form("rounded", ("fc2", "vs2"), ((30.0, 5e-3),)),
        Form("stribeck", ("fc2", "vs2", "rs2", "vr2"), ((20.0, 2e-3, 0.4, 0.05), (60.0, 2e-3, 0.4, 0.05))),
        Form("dahl", ("fc2", "ds2"), ((20.0, 1e-5), (60.0, 1e-5))),
        Form(
            "lugre",
            ("fc2", "ds2", "sd2", "rs2", "vr2"),
            ((20.0, 1e-5, 150.0, 0.4, 0.05), (60.0, 1e-5, 150.0, 0.4, 0.05)),
        ),
    ),
    free_laws=("indenter",),
)
