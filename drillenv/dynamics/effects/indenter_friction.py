"""Dry friction on the indenter."""

from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, Effect, Extra, Parameter

EFFECT = Effect(
    name="indenter-friction",
    sentence="Dry friction holds the indenter back, and fast while the other forces are weak.",
    equation="force -fc2 sign(X2') on the indenter; at rest whatever holds it there, up to fc2",
    source=(
        "C. A. Coulomb, Theorie des machines simples (1785); J. P. Den Hartog, Forced vibrations with combined viscous "
        "and Coulomb damping, Philosophical Magazine, series 7, 9 (1930) 801-817"
    ),
    parameters=(Parameter("fc2", "friction force on the indenter", "N", 0.0, 1e5, 0.0, (15.0, 80.0)),),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="loses",
    extras=(Extra("slide2", "way the indenter slides: 1, -1, or 0 while it sticks", "1", 1.0),),
    grips=ON_INDENTER,
)
