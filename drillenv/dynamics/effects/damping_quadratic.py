"""Coupling damping that grows with speed."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _law(closing, p, stiffness):
    return p[0] * np.sign(closing) * np.abs(closing) ** p[1]


def _on_body(position, velocity, applied, stiffness, p):
    return -_law(velocity, p, stiffness)


EFFECT = Effect(
    name="damping-quadratic",
    sentence="The damping between shaker and indenter grows with their relative speed.",
    equation=(
        "coupling force + c2 |v / (1 m/s)|^(nc - 2) |v| v, v = X1' - X2'; on a body law + the same of its velocity"
    ),
    source="constitutive",
    parameters=(
        Parameter("c2", "quadratic damping of the coupling, at 1 m/s", "N s^2/m^2", 0.0, 1e5, 0.0, (300.0, 1500.0)),
        Parameter("nc", "power of the speed", "1", 1.1, 6.0, 2.0, (2.0, 2.0)),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="loses",
    laws={"damper": _law},
    on_body=_on_body,
    body_told_apart="record at two speeds that differ by a factor of three or more",
    body_sentence="The damping of the body grows with its speed.",
    forms=(
        Form("quadratic", ("c2",), ((500.0,),)),
        Form("power", ("c2", "nc"), ((200.0, 1.5), (2000.0, 3.0))),
    ),
    body_forms=(
        Form("quadratic", ("c2",), ((0.1,),)),
        Form("power", ("c2", "nc"), ((0.1, 1.5), (0.1, 3.0))),
    ),
    free_laws=("damper",),
)
