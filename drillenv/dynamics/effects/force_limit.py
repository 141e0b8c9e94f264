"""A force that saturates."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form

NONE = 1e6
"""N: at this force, the bound, nothing is limited."""
STEEPEST = 1e9
"""N/s: at this slew rate, the bound, nothing is limited."""


def _lost(force, largest, neared):
    """What a force in N changes by, of one that has ``largest`` at most and nears ``neared`` gradually."""
    gradual = force if neared >= NONE else force / np.hypot(1.0, force / neared)
    return np.clip(gradual, -largest, largest) - force


def _on_body(position, velocity, applied, stiffness, p):
    return _drive_law(applied, p, stiffness) - _spring_law(position, p, stiffness)


def _drive_law(asked, p, stiffness):
    return _lost(asked, p[0], p[5])


def _spring_law(shortening, p, stiffness):
    return _lost(stiffness * shortening, p[1], p[4])


def _scalars(p):
    limited = p[2] < STEEPEST
    return {"slew_rate": p[2], "slew_share": 1.0, "drive_delay": p[3]} if limited else {}


EFFECT = Effect(
    name="force-limit",
    sentence="The drive, or the spring, cannot push or pull harder than a certain force.",
    equation=(
        "drive force min(max(d, -F_max), F_max), d = f / sqrt(1 + (f / F_h)^2), f = F_a sin(theta), which it follows "
        "tau_f late and no faster than by S_max, from 0 on where the rig begins at rest; spring force likewise of "
        "f = k (X1 - X2) by F_s and F_g; on a body the applied force and k position likewise, without S_max"
    ),
    source="constitutive",
    parameters=(
        Parameter("F_max", "largest force of the drive", "N", 1.0, NONE, NONE, (150.0, 400.0)),
        Parameter("F_s", "largest force of the spring", "N", 1.0, NONE, NONE, (NONE, NONE)),
        Parameter("S_max", "slew rate of the drive", "N/s", 1.0, STEEPEST, STEEPEST, (STEEPEST, STEEPEST)),
        Parameter("tau_f", "delay of a drive whose slew rate is limited", "s", 0.0, 1e-3, 0.0, (0.0, 0.0)),
        Parameter("F_g", "force that a spring nears gradually", "N", 1.0, NONE, NONE, (NONE, NONE)),
        Parameter("F_h", "force that the drive nears gradually", "N", 1.0, NONE, NONE, (NONE, NONE)),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="moves",
    extras=(Extra("f", "force of the drive", "N", 100.0, kept="driven"),),
    scalars=_scalars,
    laws={"drive-curve": _drive_law, "spring": _spring_law},
    on_body=_on_body,
    body_told_apart="record forces of several sizes",
    body_sentence="The force on the body saturates: beyond a certain size less arrives than is applied.",
    forms=(
        Form("clipped", ("F_max",), ((200.0,), (280.0,), (380.0,))),
        Form("clipped spring", ("F_s",), ((150.0,), (230.0,))),
        Form("gradual spring", ("F_g",), ((300.0,), (600.0,))),
        Form("limited slew rate", ("S_max", "tau_f"), ((1.5e5, 2e-5), (2.5e5, 2e-5), (3.5e5, 2e-5))),
    ),
    body_forms=(
        Form("clipped", ("F_max",), ((0.5,), (0.7,), (0.9,))),
        Form("gradual", ("F_h",), ((0.5,), (1.0,), (2.0,))),
        Form("clipped spring", ("F_s",), ((0.3,), (0.5,), (0.8,))),
        Form("gradual spring", ("F_g",), ((0.5,), (1.0,), (2.0,))),
    ),
    free_laws=("drive", "slew rate", "saturating spring"),
)
