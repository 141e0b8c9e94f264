"""Dry friction on the indenter."""

import math

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form

ROUNDED = 2e-3
"""m/s over which a fit of the law takes friction that grips to set in."""


def _term(now, own, p, push, rates):
    # at a transition speed of 0 it grips, which is the engine's
    if p[1] > 0.0:
        push[ON_INDENTER] -= p[0] * math.tanh(now.v2 / p[1])


def _corner(now, a1, a2, p):
    # all of the turn lies within three transition speeds, and steps of two of them go through it
    speed, change = abs(now.v2), abs(a2)
    if p[0] == 0.0 or p[1] == 0.0 or change == 0.0 or (speed > 3.0 * p[1] and now.v2 * a2 > 0.0):
        return math.inf
    return max(speed - 3.0 * p[1], 2.0 * p[1]) / change


def _law(x, p, around):
    # a grip is rounded over what is nothing against the speeds of the rig
    return p[0] * np.tanh(x / max(p[1], ROUNDED))


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
    extras=(Extra("slide2", "way the indenter slides: 1, -1, or 0 while it sticks", "1", 1.0),),
    term=_term,
    corner=_corner,
    grips=ON_INDENTER,
    forms=(
        Form("coulomb", ("fc2",), ((20.0,), (60.0,)), {"indenter": _law}),
        Form("rounded", ("fc2", "vs2"), ((30.0, 5e-3),), {"indenter": _law}),
    ),
)
