"""Multiples of the excitation frequency in the drive force."""

import math

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _law(theta, p, stiffness):
    return p[0] * np.sin(2.0 * theta + p[1]) + p[2] * np.sin(3.0 * theta + p[3])


EFFECT = Effect(
    name="drive-harmonics",
    sentence="The shaker adds the second and third multiple of the excitation frequency to its force.",
    equation="drive force + F_a (h2 sin(2 theta + phi2) + h3 sin(3 theta + phi3))",
    source="constitutive",
    parameters=(
        Parameter("h2", "second harmonic over F_a", "1", 0.0, 1.0, 0.0, (0.03, 0.2)),
        Parameter("phi2", "phase of the second harmonic", "rad", -2 * math.pi, 2 * math.pi, 0.0, (-math.pi, math.pi)),
        Parameter("h3", "third harmonic over F_a", "1", 0.0, 1.0, 0.0, (0.02, 0.15)),
        Parameter("phi3", "phase of the third harmonic", "rad", -2 * math.pi, 2 * math.pi, 0.0, (-math.pi, math.pi)),
    ),
    balances=("indenter",),
    regimes=EVERYWHERE,
    energy="moves",
    laws={"drive-waveform": _law},
    forms=(
        Form(
            "second and third",
            ("h2", "phi2", "h3", "phi3"),
            tuple((0.08, a, 0.06, b) for a in (-2.0, 0.0, 2.0) for b in (-2.0, 0.0, 2.0)),
        ),
    ),
    free_laws=("waveform",),
)
