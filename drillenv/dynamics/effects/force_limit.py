"""A force that saturates."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form

NONE = 1e6
"""N: at this force, the bound, nothing is limited."""


def _on_body(position, velocity, applied, stiffness, p):
    spring = stiffness * position
    return np.clip(applied, -p[0], p[0]) - applied - (np.clip(spring, -p[1], p[1]) - spring)


def _drive_law(asked, p, stiffness):
    return np.clip(asked, -p[0], p[0]) - asked


def _spring_law(shortening, p, stiffness):
    force = stiffness * shortening
    return np.clip(force, -p[1], p[1]) - force


EFFECT = Effect(
    name="force-limit",
    sentence="The drive, or the spring, cannot push or pull harder than a certain force.",
    equation=(
        "drive force min(max(F_a sin(theta), -F_max), F_max), spring force min(max(k (X1 - X2), -F_s), F_s); on a body "
        "the applied force and k position likewise"
    ),
    source="constitutive",
    parameters=(
        Parameter("F_max", "largest force of the drive", "N", 1.0, NONE, NONE, (150.0, 400.0)),
        Parameter("F_s", "largest force of the spring", "N", 1.0, NONE, NONE, (NONE, NONE)),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="moves",
    laws={"drive-curve": _drive_law, "spring": _spring_law},
    on_body=_on_body,
    body_told_apart="record forces of several sizes",
    body_sentence="The force on the body saturates: beyond a certain size less arrives than is applied.",
    forms=(
        Form("clipped", ("F_max",), ((200.0,), (280.0,), (380.0,))),
        Form("clipped spring", ("F_s",), ((150.0,), (230.0,))),
    ),
    body_forms=(
        Form("clipped", ("F_max",), ((0.5,), (0.7,), (0.9,))),
        Form("clipped spring", ("F_s",), ((0.3,), (0.5,), (0.8,))),
    ),
    free_laws=("drive", "saturating spring"),
)
