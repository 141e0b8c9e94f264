"""Coupling damping that grows with speed."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _law(closing, p, stiffness):
    return p[0] * np.abs(closing) * closing


def _on_body(position, velocity, applied, stiffness, p):
    return -p[0] * np.abs(velocity) * velocity


EFFECT = Effect(
    name="damping-quadratic",
    sentence="The damping between shaker and indenter grows with their relative speed.",
    equation="coupling force + c2 |X1' - X2'| (X1' - X2'); on a body law + c2 |velocity| velocity",
    source="constitutive",
    parameters=(Parameter("c2", "quadratic damping of the coupling", "N s^2/m^2", 0.0, 1e5, 0.0, (300.0, 1500.0)),),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="loses",
    laws={"damper": _law},
    on_body=_on_body,
    body_told_apart="record at two speeds that differ by a factor of three or more",
    body_sentence="The damping of the body grows with its speed.",
    forms=(Form("quadratic", ("c2",), ((500.0,),)),),
    body_forms=(Form("quadratic", ("c2",), ((0.1,),)),),
    free_laws=("damper",),
)
