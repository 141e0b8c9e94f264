"""Dry friction on the guides of the shaker body."""

from drillenv.dynamics.effects import EVERYWHERE, ON_SHAKER, Effect, Extra, Parameter

EFFECT = Effect(
    name="guide-friction",
    sentence="Dry friction in the guides holds the shaker body back, and fast while the other forces are weak.",
    equation="force -fc1 sign(X1') on the shaker body; at rest whatever holds it there, up to fc1",
    source=(
        "C. A. Coulomb, Theorie des machines simples (1785); J. P. Den Hartog, Forced vibrations with combined viscous "
        "and Coulomb damping, Philosophical Magazine, series 7, 9 (1930) 801-817"
    ),
    parameters=(Parameter("fc1", "friction force on the shaker body", "N", 0.0, 1e5, 0.0, (15.0, 80.0)),),
    balances=("shaker",),
    regimes=EVERYWHERE,
    energy="loses",
    extras=(Extra("slide1", "way the shaker body slides: 1, -1, or 0 while it sticks", "1", 1.0),),
    grips=ON_SHAKER,
)
