"""A channel that lags the others."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.sensors_signals import delayed


def _measure(true, read, p):
    parts = (read.excitation, read.force, read.acceleration)
    excitation, force, acceleration = (
        delayed(part, read.before(part), read.rate, by) for part, by in zip(parts, p, strict=True)
    )
    return read._replace(excitation=excitation, force=force, acceleration=acceleration)


EFFECT = Effect(
    name="channel-delay",
    sentence="One channel comes later than the others.",
    equation="read(t) = true(t - delay), each channel with its own",
    source="constitutive",
    parameters=(
        Parameter("delay_e", "lag of the excitation", "s", 0.0, 0.01, 0.0, (0.0, 0.0)),
        Parameter("delay_f", "lag of the force", "s", 0.0, 0.01, 0.0, (0.0, 0.0)),
        Parameter("delay_a", "lag of the acceleration", "s", 0.0, 0.01, 0.0, (5e-5, 4e-4)),
    ),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    body_told_apart="record faster motions, where a lag and a damper part ways",
    stage=3,
    needs_fine=True,
    free_laws=("lag", "level response"),
)
