"""Dry friction on the indenter."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _law(speed, p, stiffness):
    # at a transition speed of 0 it grips
    return p[0] * np.tanh(speed / p[1]) if p[1] > 0.0 else np.zeros_like(speed)


def _scalars(p):
    return {"indenter_grip": p[0] if p[1] == 0.0 else 0.0}


EFFECT = Effect(
    name="indenter-friction",
    sentence="Dry friction holds the indenter back, and fast while the other forces are weak.",
    equation=(
        "force -fc2 tanh(X2' / vs2) on the indenter; for vs2 = 0 -fc2 sign(X2'), and at rest whatever holds it "
        "there, up to fc2"
    ),
    source=(
        "C. A. Coulomb, Theorie des machines simples (1785); J. P. Den Hartog, Forced vibrations with combined viscous "
        "and Coulomb damping, Philosophical Magazine, series 7, 9 (1930) 801-817; S. Andersson, A. Soderberg, "
        "S. Bjorklund, Friction models for sliding dry, boundary and mixed lubricated contacts, Tribology "
        "International 40 (2007) 580-587"
    ),
    parameters=(
        Parameter("fc2", "friction force on the indenter", "N", 0.0, 1e5, 0.0, (15.0, 80.0)),
        Parameter("vs2", "speed at which a lubricated guide begins to slide freely", "m/s", 0.0, 1.0, 0.0, (0.0, 0.0)),
    ),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="loses",
    extras=(Extra("slide2", "way the indenter slides: 1, -1, or 0 while it sticks", "1", 1.0, kept="slide2"),),
    laws={"indenter": _law},
    scalars=_scalars,
    forms=(
        Form("coulomb", ("fc2",), ((20.0,), (60.0,))),
        Form("rounded", ("fc2", "vs2"), ((30.0, 5e-3),)),
    ),
    free_laws=("indenter",),
)
