"""An accelerometer with too little bandwidth."""

import math

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.sensors_signals import filtered

NONE = 1e6
"""Hz: at this frequency, the bound, nothing is lost at all."""


def _measure(true, read, p):
    if p[0] >= NONE:
        return read
    corner = 2.0 * math.pi * p[0]
    signal = read.acceleration
    return read._replace(acceleration=filtered(signal, read.before(signal), read.rate, (corner,), (1.0, corner)))


EFFECT = Effect(
    name="accelerometer-lowpass",
    sentence="The accelerometer is too slow, so its blows look lower, longer and later than they are.",
    equation="a_read' / (2 pi f_b) + a_read = a",
    source="constitutive",
    parameters=(Parameter("f_b", "bandwidth, the frequency at 3 dB", "Hz", 10.0, NONE, NONE, (400.0, 4000.0)),),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    stage=2,
    needs_fine=True,
    free_laws=("falling response",),
)
