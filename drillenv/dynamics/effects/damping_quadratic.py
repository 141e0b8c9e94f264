"""Coupling damping that grows with speed."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, ON_SHAKER, Effect, Parameter
from drillenv.dynamics.forms import Form


def _term(now, own, p, push, rates):
    force = p[0] * abs(now.closing) * now.closing
    push[ON_SHAKER] -= force
    push[ON_INDENTER] += force


def _law(x, p, around):
    return p[0] * np.abs(x) * x


EFFECT = Effect(
    name="damping-quadratic",
    sentence="The damping between shaker and indenter grows with their relative speed.",
    equation="coupling force + c2 |X1' - X2'| (X1' - X2')",
    source="constitutive",
    parameters=(Parameter("c2", "quadratic damping of the coupling", "N s^2/m^2", 0.0, 1e5, 0.0, (300.0, 1500.0)),),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="loses",
    term=_term,
    forms=(Form("quadratic", ("c2",), ((500.0,),), {"damper": _law}),),
)
