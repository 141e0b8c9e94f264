"""A channel that does not read zero at zero."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter


def _measure(true, read, p):
    return read._replace(
        excitation=read.excitation + p[0], force=read.force + p[1], acceleration=read.acceleration + p[2]
    )


EFFECT = Effect(
    name="sensor-offset",
    sentence="A channel reads a constant too much or too little.",
    equation="read = true + o, each channel with its own",
    source="constitutive",
    parameters=(
        Parameter("o_e", "offset of the excitation", "V", -10.0, 10.0, 0.0, (0.0, 0.02)),
        Parameter("o_f", "offset of the force", "N", -1e5, 1e5, 0.0, (5.0, 50.0)),
        Parameter("o_a", "offset of the acceleration", "m/s^2", -1e5, 1e5, 0.0, (2.0, 20.0)),
    ),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    stage=5,
    free_laws=("offset",),
)
