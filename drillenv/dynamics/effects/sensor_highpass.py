"""A channel without its slow part."""

import math

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.sensors_signals import filtered


def _measure(true, read, p):
    return read._replace(force=_coupled(read.force, read, p[0]), acceleration=_coupled(read.acceleration, read, p[1]))


def _coupled(signal, read, frequency):
    """The signal through a first-order high-pass that had settled on its mean, or on 0 where the rig stood still."""
    if frequency == 0.0 or not signal.size:
        return signal
    corner = 2.0 * math.pi * frequency
    before = 0.0 if read.from_rest else float(signal.mean())
    return filtered(signal, before, read.rate, (1.0, 0.0), (1.0, corner))


# Other sensors take a channel to have stood at its first value before. This one remembers for seconds, and of a rig
# that had been running for long nothing but the mean is left in it.
EFFECT = Effect(
    name="sensor-highpass",
    sentence="A channel is AC-coupled, as IEPE and piezoelectric sensors are, and loses what is slow or steady.",
    equation="read' + 2 pi f read = true', each channel with its own f",
    source="constitutive",
    parameters=(
        Parameter("corner_f", "frequency of the force channel at 3 dB", "Hz", 0.0, 100.0, 0.0, (0.3, 1.5)),
        Parameter("corner_a", "frequency of the acceleration channel at 3 dB", "Hz", 0.0, 100.0, 0.0, (0.3, 1.5)),
    ),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    stage=3,
    free_laws=("high-pass",),
)
