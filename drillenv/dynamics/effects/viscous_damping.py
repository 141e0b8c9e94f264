"""A force proportional to speed, on a one-body rig."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _on_body(position, velocity, applied, stiffness, p):
    return -p[0] * velocity


EFFECT = Effect(
    name="viscous-damping",
    sentence="A force proportional to speed brakes the body.",
    equation="mass * acceleration = force - law - d velocity",
    source="constitutive",
    parameters=(Parameter("d", "viscous damping", "N s/m", 0.0, 1e6, 0.0, (1.0, 500.0)),),
    balances=("body",),
    regimes=EVERYWHERE,
    energy="loses",
    on_body=_on_body,
    body_told_apart="record at two speeds that differ by a factor of three or more",
    body_constant="damping",
    body_forms=(Form("linear", ("d",), ((0.1,),)),),
    free_laws=("unstated damping",),
)
