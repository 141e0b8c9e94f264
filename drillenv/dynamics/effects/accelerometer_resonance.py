"""An accelerometer whose mount rings."""

import math

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.sensors_signals import filtered

NONE = 1e6
"""Hz: at this frequency, the bound, there is no resonance at all."""


def _measure(true, read, p):
    if p[0] >= NONE:
        return read
    natural = 2.0 * math.pi * p[0]
    square = natural * natural
    signal = read.acceleration
    over = (1.0, 2.0 * p[1] * natural, square)
    return read._replace(acceleration=filtered(signal, read.before(signal), read.rate, (square,), over))


EFFECT = Effect(
    name="accelerometer-resonance",
    sentence="The accelerometer rings on its mount, and each blow is followed by an oscillation of its own.",
    equation="a_read'' + 2 zeta_a w a_read' + w^2 a_read = w^2 a, w = 2 pi f_a",
    source="ISO 5348, Mechanical vibration and shock: Mechanical mounting of accelerometers (2021)",
    parameters=(
        Parameter("f_a", "frequency of the mount's resonance", "Hz", 100.0, NONE, NONE, (2500.0, 7000.0)),
        Parameter("zeta_a", "damping ratio of the mount", "1", 1e-3, 2.0, 0.02, (0.01, 0.08)),
    ),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    stage=1,
    needs_fine=True,
    free_laws=("rising response",),
)
