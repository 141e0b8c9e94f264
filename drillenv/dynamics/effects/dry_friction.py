"""Coulomb friction on a one-body rig."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _on_body(position, velocity, applied, stiffness, p):
    return -p[0] * np.sign(velocity)


EFFECT = Effect(
    name="dry-friction",
    sentence="Dry friction of the same strength at any speed brakes the body.",
    equation="mass * acceleration = force - law - fc sign(velocity); at rest whatever holds it there, up to fc",
    source="C. A. Coulomb, Theorie des machines simples (1785)",
    parameters=(Parameter("fc", "friction force", "N", 0.0, 1e6, 0.0, (1.0, 100.0)),),
    balances=("body",),
    regimes=EVERYWHERE,
    energy="loses",
    on_body=_on_body,
    body_told_apart="record at two speeds that differ by a factor of three or more",
    body_constant="coulomb",
    body_forms=(Form("coulomb", ("fc",), ((0.1,),)),),
    free_laws=("friction",),
)
