"""The rig and its three controls (Table 2.1, Eq. 3.5 and 3.6 of the paper)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from drillenv.checks import number
from drillenv.rocks import Rock

# The box in which the paper explores the controls (Table 2.1).
FREQUENCY_RANGE = (50.0, 120.0)  # Hz
AMPLITUDE_RANGE = (0.30, 0.60)  # V
PRESSURE_RANGE = (0.6, 1.8)  # bar

# Eq. 3.5, F_a = (DRIVE_SLOPE f + DRIVE_BASE) A, in N/(Hz V) and N/V, and Eq. 3.6, F_b = PUSH p, in N/bar.
DRIVE_SLOPE, DRIVE_BASE, PUSH = 2.40, 876.19, 196.35

TOLERANCES = {
    "shaker_mass": 1.0,
    "indenter_mass": 0.01,
    "stiffness": 2000.0,
    "damping": 75.0,
    "drive_gain": 0.015,
    "pressure_gain": 0.02,
}
"""Standard deviations in SI with which a lab knows the constants of a :class:`Rig`."""

# What a Setting accepts: wider than the box, since Fig. 2.5 runs at 150 Hz and boundaries lie outside it, but
# narrow enough that no value of the box written in another unit (rad/s, rpm, kHz, mV, kPa, MPa, psi) fits.
FREQUENCY_LIMITS = (10.0, 250.0)
AMPLITUDE_LIMITS = (0.05, 2.0)
PRESSURE_LIMITS = (0.2, 5.0)


@dataclass(frozen=True, slots=True)
class Setting:
    """The three controls of the rig.

    Args:
        frequency: Excitation frequency in Hz, 10 to 250 (the paper uses 50 to 120, and 150 once).
        amplitude: Excitation voltage amplitude in V, 0.05 to 2 (0.3 to 0.6 in the paper).
        pressure: Pneumatic pressure in bar, 0.2 to 5 (0.6 to 1.8 in the paper).

    Raises:
        InputError: a value is no finite number or lies outside its limits.
    """

    frequency: float
    amplitude: float
    pressure: float

    def __post_init__(self) -> None:
        slips = {
            "frequency": [(1 / (2 * math.pi), "rad/s"), (1 / 60, "rpm"), (1e3, "kHz")],
            "amplitude": [(1e-3, "mV")],
            "pressure": [(1e-2, "kPa"), (10.0, "MPa"), (1e-5, "Pa"), (0.0689476, "psi"), (1e-3, "mbar")],
        }
        limits = {
            "frequency": (*FREQUENCY_LIMITS, "Hz"),
            "amplitude": (*AMPLITUDE_LIMITS, "V"),
            "pressure": (*PRESSURE_LIMITS, "bar"),
        }
        for name, bounds in limits.items():
            object.__setattr__(self, name, number(name, getattr(self, name), *bounds, slips=slips[name]))

    @property
    def period(self) -> float:
        """Excitation period in s."""
        return 1.0 / self.frequency


@dataclass(frozen=True, slots=True)
class Rig:
    """The percussive-drilling rig of the paper: two masses, a spring and a damper (Table 2.1).

    Args:
        shaker_mass: m1 in kg.
        indenter_mass: m2 in kg.
        stiffness: k of the structure in N/m.
        damping: c of the structure in N s/m.
        drive_gain: Factor on Eq. 3.5, 1 in the paper.
        pressure_gain: Factor on Eq. 3.6, 1 in the paper.

    Raises:
        InputError: a value is no finite number or lies outside its limits.
    """

    shaker_mass: float = 265.0
    indenter_mass: float = 3.0
    stiffness: float = 68.85e3
    damping: float = 2.45e3
    drive_gain: float = 1.0
    pressure_gain: float = 1.0

    def __post_init__(self) -> None:
        limits: dict[str, tuple[float, float, str, list[tuple[float, str]]]] = {
            "shaker_mass": (1.0, 1e5, "kg", [(1e-3, "g")]),
            "indenter_mass": (0.05, 1e3, "kg", [(1e-3, "g")]),
            "stiffness": (1e3, 1e8, "N/m", [(1e3, "kN/m or N/mm")]),
            "damping": (10.0, 1e6, "N s/m", [(1e3, "kN s/m")]),
            "drive_gain": (0.05, 20.0, "", []),
            "pressure_gain": (0.05, 20.0, "", []),
        }
        for name, (low, high, unit, slips) in limits.items():
            object.__setattr__(self, name, number(name, getattr(self, name), low, high, unit, slips))

    def drive_force(self, setting: Setting) -> float:
        """Amplitude of the harmonic force on the indenter in N (Eq. 3.5)."""
        return self.drive_gain * (DRIVE_SLOPE * setting.frequency + DRIVE_BASE) * setting.amplitude

    def static_force(self, setting: Setting) -> float:
        """Static force on the shaker body in N (Eq. 3.6)."""
        return self.pressure_gain * PUSH * setting.pressure


class Groups(NamedTuple):
    """The dimensionless groups of Eq. 3.4 (for a linear rock law, n_l = n_u = 1)."""

    alpha: float
    beta: float
    xi: float
    kappa: float
    a: float
    b: float
    omega: float
    time_scale: float
    """1 / Omega_0 in s: multiply a dimensionless time by it."""
    length_scale: float
    """mu in m: multiply a dimensionless length by it."""


def groups(rig: Rig, setting: Setting, rock: Rock, reference_length: float = 1e-3) -> Groups:
    """The groups of Eq. 3.4; ``reference_length`` is mu in m.

    Raises:
        InputError: ``reference_length`` is not a positive length up to 1 m.
    """
    mu = number("reference_length", reference_length, 1e-9, 1.0, "m")
    natural = math.sqrt(rock.loading_stiffness / rig.indenter_mass)
    force_scale = rig.indenter_mass * mu * natural**2
    return Groups(
        alpha=rig.indenter_mass / rig.shaker_mass,
        beta=rig.stiffness / rock.loading_stiffness,
        xi=rig.damping / (2 * rig.indenter_mass * natural),
        kappa=rock.unloading_stiffness / rock.loading_stiffness,
        a=rig.drive_force(setting) / force_scale,
        b=rig.static_force(setting) / force_scale,
        omega=2 * math.pi * setting.frequency / natural,
        time_scale=1 / natural,
        length_scale=mu,
    )
