"""Dry friction on the guides of the shaker body."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _law(speed, p, stiffness):
    # at a transition speed of 0 it grips
    return p[0] * np.tanh(speed / p[1]) if p[1] > 0.0 else np.zeros_like(speed)


def _scalars(p):
    return {"shaker_grip": p[0] if p[1] == 0.0 else 0.0}


EFFECT = Effect(
    name="guide-friction",
    sentence="Dry friction in the guides holds the shaker body back, and fast while the other forces are weak.",
    equation=(
        "force -fc1 tanh(X1' / vs1) on the shaker body; for vs1 = 0 -fc1 sign(X1'), and at rest whatever holds it "
        "there, up to fc1"
    ),
    source=(
        "C. A. Coulomb, Theorie des machines simples (1785); J. P. Den Hartog, Forced vibrations with combined viscous "
        "and Coulomb damping, Philosophical Magazine, series 7, 9 (1930) 801-817; S. Andersson, A. Soderberg, "
        "S. Bjorklund, Friction models for sliding dry, boundary and mixed lubricated contacts, Tribology "
        "International 40 (2007) 580-587"
    ),
    parameters=(
        Parameter("fc1", "friction force on the shaker body", "N", 0.0, 1e5, 0.0, (15.0, 80.0)),
        Parameter("vs1", "speed at which a lubricated guide begins to slide freely", "m/s", 0.0, 1.0, 0.0, (0.0, 0.0)),
    ),
    balances=("shaker",),
    regimes=EVERYWHERE,
    energy="loses",
    extras=(Extra("slide1", "way the shaker body slides: 1, -1, or 0 while it sticks", "1", 1.0, kept="slide1"),),
    laws={"guide": _law},
    scalars=_scalars,
    forms=(
        Form("coulomb", ("fc1",), ((20.0,), (60.0,))),
        Form("rounded", ("fc1", "vs1"), ((30.0, 3e-4),)),
    ),
    free_laws=("guide",),
)
