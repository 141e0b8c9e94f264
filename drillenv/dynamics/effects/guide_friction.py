"""Dry friction on the guides of the shaker body."""

import math

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, ON_SHAKER, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form

ROUNDED = 1e-4
"""m/s over which a fit of the law takes friction that grips to set in."""


def _term(now, own, p, push, rates):
    # at a transition speed of 0 it grips, which is the engine's
    if p[1] > 0.0:
        push[ON_SHAKER] -= p[0] * math.tanh(now.v1 / p[1])


def _law(x, p, around):
    # a grip is rounded over what is nothing against the speeds of the rig
    return p[0] * np.tanh(x / max(p[1], ROUNDED))


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
    extras=(Extra("slide1", "way the shaker body slides: 1, -1, or 0 while it sticks", "1", 1.0),),
    term=_term,
    grips=ON_SHAKER,
    forms=(
        Form("coulomb", ("fc1",), ((20.0,), (60.0,)), {"guide": _law}),
        Form("rounded", ("fc1", "vs1"), ((30.0, 3e-4),), {"guide": _law}),
    ),
)
