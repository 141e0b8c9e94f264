"""Dry friction on a one-body rig."""

from drillenv.dynamics.constitutive import friction
from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _on_body(position, velocity, applied, stiffness, p):
    return -friction.along_path(position, velocity, p)


EFFECT = Effect(
    name="dry-friction",
    sentence="Dry friction brakes the body, as strongly at low speed as at high speed or more so.",
    equation=f"mass * acceleration = force - law; {friction.equation('body', 'fc', 'vs', 'ds', 'sd', 'rs', 'vr', 'x')}",
    source=friction.SOURCE,
    parameters=(
        Parameter("fc", "friction force", "N", 0.0, 1e6, 0.0, (1.0, 100.0)),
        Parameter("vs", "speed at which a lubricated body begins to slide freely", "m/s", 0.0, 1.0, 0.0, (0.0, 0.0)),
        Parameter("ds", "displacement by which it gives before it slides", "m", 0.0, 1e-2, 0.0, (0.0, 0.0)),
        Parameter("sd", "damping of what gives", "N s/m", 0.0, 1e6, 0.0, (0.0, 0.0)),
        Parameter("rs", "share by which it is larger at low speeds, of vs or ds", "1", 0.0, 10.0, 0.0, (0.0, 0.0)),
        Parameter("vr", "speed at which that has faded", "m/s", 1e-6, 10.0, 1e-3, (1e-3, 1e-3)),
    ),
    balances=("body",),
    regimes=EVERYWHERE,
    energy="loses",
    on_body=_on_body,
    body_told_apart="record at two speeds that differ by a factor of three or more",
    body_constant="coulomb",
    body_forms=(
        Form("coulomb", ("fc",), ((0.1,),)),
        Form("stribeck", ("fc", "rs", "vr"), ((0.1, 0.4, 0.05), (0.1, 0.4, 0.2))),
        Form("dahl", ("fc", "ds"), ((0.1, 1e-3), (0.1, 1e-2))),
        Form("lugre", ("fc", "ds", "sd", "rs", "vr"), ((0.1, 1e-3, 0.1, 0.4, 0.1), (0.1, 1e-2, 0.1, 0.4, 0.1))),
    ),
    free_laws=("friction",),
)
