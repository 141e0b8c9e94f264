"""Pick-up from the mains."""

import math

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter


def _measure(true, read, p):
    turned = 2.0 * math.pi * p[0] * read.time
    return read._replace(
        excitation=read.excitation + p[1] * np.sin(turned + p[2]),
        force=read.force + p[3] * np.sin(turned + p[4]),
        acceleration=read.acceleration + p[5] * np.sin(turned + p[6]),
    )


PHASES = (-2 * math.pi, 2 * math.pi, 0.0, (-math.pi, math.pi))

EFFECT = Effect(
    name="mains-hum",
    sentence="The cables pick up the mains: a steady hum of 50 or 60 Hz that no force explains.",
    equation="read(t) = true(t) + b sin(2 pi f_m t + psi), each channel with its own b and psi",
    source="constitutive",
    parameters=(
        Parameter("f_m", "frequency of the mains", "Hz", 45.0, 65.0, 50.0, (49.95, 50.05)),
        Parameter("b_e", "hum on the excitation", "V", 0.0, 10.0, 0.0, (0.0, 0.01)),
        Parameter("psi_e", "its phase", "rad", *PHASES),
        Parameter("b_f", "hum on the force", "N", 0.0, 1e5, 0.0, (3.0, 30.0)),
        Parameter("psi_f", "its phase", "rad", *PHASES),
        Parameter("b_a", "hum on the acceleration", "m/s^2", 0.0, 1e5, 0.0, (1.0, 10.0)),
        Parameter("psi_a", "its phase", "rad", *PHASES),
    ),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    stage=4,
    free_laws=("hum",),
)
