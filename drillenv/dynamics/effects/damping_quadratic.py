"""Coupling damping that grows with speed."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _law(closing, p, stiffness):
    return p[0] * np.abs(closing) * closing


EFFECT = Effect(
    name="damping-quadratic",
    sentence="The damping between shaker and indenter grows with their relative speed.",
    equation="coupling force + c2 |X1' - X2'| (X1' - X2')",
    source="constitutive",
    parameters=(Parameter("c2", "quadratic damping of the coupling", "N s^2/m^2", 0.0, 1e5, 0.0, (300.0, 1500.0)),),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="loses",
    laws={"damper": _law},
    forms=(Form("quadratic", ("c2",), ((500.0,),)),),
)
