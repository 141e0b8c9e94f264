"""A drive force that falls off with frequency."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _scalars(p):
    return {"drive_lag": p[0]}


EFFECT = Effect(
    name="drive-droop",
    sentence="The shaker's force falls off as the frequency rises.",
    equation="drive amplitude F_a / sqrt(1 + (f / f_c)^2), with the parameter s = 1 / f_c",
    source="constitutive",
    parameters=(Parameter("s", "reciprocal of the corner frequency f_c", "s", 0.0, 0.1, 0.0, (1 / 400, 1 / 120)),),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="moves",
    scalars=_scalars,
    forms=(Form("first order", ("s",), ((2e-3,), (6e-3,))),),
    free_laws=("drive gain",),
)
