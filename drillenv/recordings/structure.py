"""The structure of the drilling rig as a filter: what the indenter's acceleration must be, given what pushes it.

Free of the contact, the two masses on their spring and damper (Section 3 of the paper) are linear. With u the force on
the indenter other than the coupling, over its mass, the acceleration of the indenter is

    a = u (s^2 + (c s + k) / m1) / (s^2 + (c s + k) (1 / m1 + 1 / m2)).

Given the measured force R and the drive this holds however chaotic the motion is: nothing has to be simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.document import Nominal

Floats = NDArray[np.float64]


def polynomials(nominal: Mapping[str, Nominal]) -> tuple[Floats, Floats]:
    """Numerator and denominator in s of the acceleration over u."""
    m1, m2, k, c = (_value(nominal, name) for name in ("shaker_mass", "indenter_mass", "stiffness", "damping"))
    both = 1.0 / m1 + 1.0 / m2
    return np.array([1.0, c / m1, k / m1]), np.array([1.0, c * both, k * both])


def acceleration_from(push: Floats, sample_rate: float, nominal: Mapping[str, Nominal]) -> Floats:
    """(samples,) m/s^2 that a force ``push`` in N on the indenter gives it, from rest."""
    from scipy.signal import bilinear, lfilter

    above, below = bilinear(*polynomials(nominal), fs=sample_rate)
    return np.asarray(lfilter(above, below, push / _value(nominal, "indenter_mass")))


def response_at(frequency: float, nominal: Mapping[str, Nominal]) -> complex:
    """Acceleration over a harmonic force on the indenter at ``frequency`` in Hz, in 1/kg."""
    above, below = polynomials(nominal)
    s = 2j * math.pi * frequency
    return complex(np.polyval(above, s) / np.polyval(below, s)) / _value(nominal, "indenter_mass")


def settling_time(nominal: Mapping[str, Nominal]) -> float:
    """s after which little is left of the unknown start: the slowest time constant, which moves the indenter least."""
    _, below = polynomials(nominal)
    return 1.0 / float(np.min(np.abs(np.roots(below).real)))


def contact_frequency(nominal: Mapping[str, Nominal]) -> float:
    """Hz of the indenter on the rock as it unloads: an impact lasts about half a period of it."""
    stiffness, mass = _value(nominal, "unloading_stiffness"), _value(nominal, "indenter_mass")
    return math.sqrt(stiffness / mass) / (2 * math.pi)


def _value(nominal: Mapping[str, Nominal], name: str) -> float:
    value = nominal[name].value
    assert value is not None  # a document of a drilling rig without one is refused
    return value
