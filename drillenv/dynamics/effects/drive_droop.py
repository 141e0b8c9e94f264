"""A drive force that falls off with frequency."""

import math

from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, Effect, Parameter
from drillenv.dynamics.forms import Form


def _term(now, own, p, push, rates):
    ratio = p[0] * now.omega / (2.0 * math.pi)
    push[ON_INDENTER] += now.drive * math.sin(now.theta) * (1.0 / math.sqrt(1.0 + ratio * ratio) - 1.0)


def _numbers(p, around):
    return {"drive": 1.0 / math.sqrt(1.0 + (p[0] * around.frequency) ** 2) - 1.0}


EFFECT = Effect(
    name="drive-droop",
    sentence="The shaker's force falls off as the frequency rises.",
    equation="drive amplitude F_a / sqrt(1 + (f / f_c)^2), with the parameter s = 1 / f_c",
    source="constitutive",
    parameters=(Parameter("s", "reciprocal of the corner frequency f_c", "s", 0.0, 0.1, 0.0, (1 / 400, 1 / 120)),),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="moves",
    term=_term,
    forms=(Form("first order", ("s",), ((2e-3,), (6e-3,)), numbers=_numbers),),
)
