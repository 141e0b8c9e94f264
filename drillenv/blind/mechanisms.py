"""The catalogue: every mechanism that the rig may conceal, and the equations that each may follow.

A mechanism has several equations, of which at most one (``of_library``) is the one that the package's own library has.
Strengths are drawn at ``share`` 1 so that they show in a recording of half a second; at a smaller share what grows with
the strength is so much smaller. What the ranges are is a judgement of what labs meet, made without the library's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from drillenv.blind import sensors
from drillenv.blind.laws import (
    ADHESION,
    AIR,
    BACKLASH,
    CHIPS,
    COMPACTION,
    DAMPER,
    DROOP,
    FLOOR,
    GUIDE,
    HARMONICS,
    INDENTER,
    LIMIT,
    MOUNT,
    POWER,
    RATE,
    RATTLE,
    ROTATION,
    SPRING,
    TOE,
    WOBBLE,
)
from drillenv.blind.rig import PUSH_PER_BAR, Constants, Controls

Parameters = Mapping[str, float]


class Site(NamedTuple):
    """What a strength may be drawn in proportion to."""

    drive: float
    """N, the largest amplitude of the drive force in the campaign."""
    frequency: float
    """Hz, the highest."""


Draw = Callable[[np.random.Generator, float, Site], dict[str, float]]


class Equation(NamedTuple):
    """One equation that a mechanism may follow."""

    name: str
    draw: Draw
    """Parameters, by symbol, from a generator, a share of the full strength and the site."""
    place: int | None = None
    """In :mod:`drillenv.blind.laws`; None for a transducer."""
    code: int = 0
    transducer: sensors.Transducer | None = None
    transfer: tuple[Callable[..., sensors.Transfer], tuple[str, ...]] | None = None
    """Of a linear transducer: its transfer function, and the symbols that it takes."""
    of_library: bool = False


class Mechanism(NamedTuple):
    """A mechanism, which may follow any of its equations."""

    name: str
    equations: tuple[Equation, ...]
    also: tuple[str, ...] = ()
    """Other names that would be right too."""


class Concealed(NamedTuple):
    """A mechanism in a campaign."""

    mechanism: str
    equation: Equation
    parameters: Parameters


def _u(low: float, high: float, grows: bool = False) -> Callable[[np.random.Generator, float], float]:
    """A number evenly from a range; times the share where it grows with the strength."""
    return lambda rng, share: float(rng.uniform(low, high)) * (share if grows else 1.0)


def _drawn(**ranges: Callable[[np.random.Generator, float], float]) -> Draw:
    return lambda rng, share, site: {name: draw(rng, share) for name, draw in ranges.items()}


def _motion(place: int, code: int, name: str, draw: Draw, of_library: bool = False) -> Equation:
    return Equation(name, draw, place, code, of_library=of_library)


def _filter(
    channel: str, transfer: Callable[..., sensors.Transfer], name: str, draw: Draw, of_library: bool, *symbols: str
):
    return Equation(
        name,
        draw,
        transducer=sensors.through(transfer, channel, *symbols),
        transfer=(transfer, symbols),
        of_library=of_library,
    )


def _reads(transducer: sensors.Transducer, name: str, draw: Draw, of_library: bool = False) -> Equation:
    return Equation(name, draw, transducer=transducer, of_library=of_library)


# --- Draws that are no plain ranges


def _low_frequency(low: float, high: float, power: float, symbol: str = "f", **others) -> Draw:
    """A corner frequency that says how strong an effect is by being low: it goes by the strength to ``-1 / power``."""

    def draw(rng, share, site):
        found = {symbol: float(rng.uniform(low, high)) / share ** (1.0 / power)}
        return found | {name: each(rng, share) for name, each in others.items()}

    return draw


def _droop(rng, share, site):
    return {"s": share * float(rng.uniform(1 / 400, 1 / 120))}


def _bristles(force: float, bend: tuple[float, float], stribeck: tuple[float, float] | None, mass: float) -> Draw:
    """Dahl's or LuGre's friction: bristles as stiff as to slide after a displacement from ``bend``."""

    def draw(rng, share, site):
        level = share * float(rng.uniform(0.3, 1.6)) * force
        stiff = level / float(rng.uniform(*bend))
        found = {"f_c": level, "f_s": level, "v_s": 1.0, "sigma": stiff, "sigma_1": 0.0}
        if stribeck is not None:
            found["f_s"] = level * float(rng.uniform(1.2, 1.7))
            found["v_s"] = float(rng.uniform(*stribeck))
            found["sigma_1"] = 0.05 * math.sqrt(stiff * mass)
        return found

    return draw


def _stribeck(force: float, speeds: tuple[float, float], rounded: float) -> Draw:
    def draw(rng, share, site):
        level = share * float(rng.uniform(0.3, 1.6)) * force
        return {
            "f_c": level,
            "f_s": level * float(rng.uniform(1.2, 1.7)),
            "v_s": float(rng.uniform(*speeds)),
            "v_0": rounded,
        }

    return draw


def _clip(low: float, high: float) -> Draw:
    return lambda rng, share, site: {"F_max": site.drive * (1.0 - share * float(rng.uniform(low, high)))}


def _soft_clip(rng, share, site):
    return {"F_s": site.drive * float(rng.uniform(0.9, 1.6)) / math.sqrt(share)}


def _slew(rng, share, site):
    steepest = 2.0 * math.pi * site.frequency * site.drive
    return {"slope": steepest * (1.0 - share * float(rng.uniform(0.2, 0.5)))}


def _saturating_spring(rng, share, site):
    return {
        "s_0": 0.0,
        "w": float(rng.uniform(5.5e-3, 9e-3)) / math.sqrt(share),
        "k": Constants().stiffness,
    }


def _softening(rng, share, site):
    return {"k_3": -share * float(rng.uniform(1e8, 2.5e8))}


def _exponent(low: float, high: float, sign: float) -> Draw:
    return lambda rng, share, site: {"n": 1.0 + sign * share * float(rng.uniform(low, high))}


def _stiffer(rng, share, site):
    return {"ratio": 1.0 + share * float(rng.uniform(0.2, 0.6)), "d_b": float(rng.uniform(3e-5, 6e-5))}


def _bolt(rng, share, site):
    return {
        "F": share * float(rng.uniform(80, 250)),
        "tau": float(rng.uniform(2e-3, 6e-3)),
        "f": float(rng.uniform(300, 900)),
        "every": float(rng.uniform(0.08, 0.25)),
    }


def _rotation(rng, share, site):
    turns = float(rng.uniform(80.0, 120.0)) / 60.0
    return {
        "eps": share * float(rng.uniform(0.06, 0.2)),
        "Omega": 2.0 * math.pi * turns,
        "psi": float(rng.uniform(-math.pi, math.pi)),
        "eps_2": share * float(rng.uniform(0.0, 0.08)),
        "psi_2": float(rng.uniform(-math.pi, math.pi)),
    }


def _wave(low: float, high: float) -> Draw:
    def draw(rng, share, site):
        return {
            "F": share * float(rng.uniform(low, high)),
            "f": float(rng.uniform(18.0, 47.0)),
            "psi": float(rng.uniform(-math.pi, math.pi)),
        }

    return draw


PHASE = _u(-math.pi, math.pi)

HUM: dict[str, Callable[[np.random.Generator, float], float]] = {
    "f_m": lambda rng, share: float(rng.choice([50.0, 60.0]) + rng.uniform(-0.05, 0.05)),
    "b_e": _u(0.0, 0.008, True),
    "b_f": _u(5.0, 30.0, True),
    "b_a": _u(2.0, 10.0, True),
}
ZERO: dict[str, Callable[[np.random.Generator, float], float]] = {
    "o_e": _u(0.0, 0.015, True),
    "o_f": lambda rng, share: share * float(rng.uniform(8.0, 50.0)) * float(rng.choice([-1.0, 1.0])),
    "o_a": lambda rng, share: share * float(rng.uniform(3.0, 20.0)) * float(rng.choice([-1.0, 1.0])),
}

_LISTED = (
    Mechanism(
        "contact-rate",
        (
            _motion(RATE, 1, "Hunt-Crossley", _drawn(chi=_u(0.2, 1.5, True)), True),
            _motion(RATE, 2, "Kelvin-Voigt", _drawn(c_r=_u(150, 800, True))),
            _motion(RATE, 3, "root of the speed", _drawn(a=_u(0.1, 0.5, True))),
            _motion(RATE, 4, "Tsuji", _drawn(c_t=_u(150, 800, True))),
            _motion(RATE, 5, "logarithm of the rate", _drawn(C=_u(0.05, 0.25, True), v_0=_u(0.03, 0.08))),
        ),
    ),
    Mechanism(
        "contact-power-law",
        (
            _motion(POWER, 1, "power, both ways", _exponent(0.1, 0.6, 1.0), True),
            _motion(POWER, 2, "power on the way in only", _exponent(0.06, 0.2, -1.0)),
            _motion(POWER, 3, "straight line and parabola", _drawn(a=_u(0.15, 0.6, True))),
            _motion(POWER, 4, "stiffer beyond a depth", _stiffer),
        ),
    ),
    Mechanism(
        "contact-toe",
        (
            _motion(TOE, 1, "exponential", _drawn(h=_u(6e-6, 4e-5, True), r=_u(0.02, 0.3), e=_u(0.0, 1.0)), True),
            _motion(TOE, 2, "parabola, crushed for good", _drawn(t=_u(1e-5, 5e-5, True))),
            _motion(TOE, 3, "two lines", _drawn(t=_u(6e-6, 4e-5, True), r=_u(0.05, 0.4))),
            _motion(TOE, 4, "parabola, springing back", _drawn(t=_u(1e-5, 5e-5, True))),
        ),
    ),
    Mechanism(
        "rock-compaction",
        (
            _motion(COMPACTION, 1, "exponential in impacts", _drawn(soft=_u(0.15, 0.6, True), soft_n=_u(5, 80)), True),
            _motion(COMPACTION, 2, "hyperbolic in impacts", _drawn(soft=_u(0.15, 0.6, True), n=_u(5, 60))),
            _motion(COMPACTION, 3, "exponential in depth", _drawn(soft=_u(0.15, 0.6, True), x_0=_u(1e-4, 1e-3))),
            _motion(COMPACTION, 4, "ramp", _drawn(soft=_u(0.15, 0.6, True), n=_u(15, 80))),
        ),
    ),
    Mechanism(
        "rock-mount-compliance",
        (
            _motion(
                MOUNT, 1, "one mass", _drawn(s_r=_u(8e-9, 5e-8, True), m_r=_u(10, 100), zeta_r=_u(0.02, 0.2)), True
            ),
            _motion(
                MOUNT,
                2,
                "two masses",
                _drawn(
                    s_r=_u(8e-9, 4e-8, True),
                    m_r=_u(10, 40),
                    zeta_r=_u(0.02, 0.2),
                    m_b=_u(50, 200),
                    s_b=_u(5e-9, 3e-8, True),
                ),
            ),
            _motion(
                MOUNT,
                3,
                "stiffening",
                _drawn(s_r=_u(2e-8, 8e-8, True), m_r=_u(10, 100), zeta_r=_u(0.02, 0.2), u_c=_u(3e-5, 8e-5, True)),
            ),
            _motion(
                MOUNT,
                4,
                "dry clamp",
                _drawn(s_r=_u(1e-8, 5e-8, True), m_r=_u(10, 100), zeta_r=_u(0.0, 0.0), F_d=_u(50, 250)),
            ),
        ),
    ),
    Mechanism(
        "stiffness-hardening",
        (
            _motion(SPRING, 1, "cubic", _drawn(k3=_u(2e9, 1e10, True)), True),
            _motion(SPRING, 2, "fifth power", _drawn(k_5=_u(2e14, 1e15, True))),
            _motion(SPRING, 3, "softening", _softening),
            _motion(SPRING, 4, "two lines", _drawn(k_b=_u(2e4, 1e5, True), s_b=_u(2.2e-3, 3.2e-3))),
        ),
    ),
    Mechanism(
        "damping-quadratic",
        (
            _motion(DAMPER, 1, "quadratic", _drawn(c2=_u(300, 1500, True)), True),
            _motion(DAMPER, 2, "power 1.5", _drawn(c_p=_u(250, 1100, True))),
            _motion(DAMPER, 3, "closing and opening", _drawn(c_in=_u(250, 1200, True))),
            _motion(DAMPER, 4, "rounded dry friction", _drawn(F_d=_u(20, 90, True), v_0=_u(0.01, 0.05))),
        ),
    ),
    Mechanism(
        "guide-friction",
        (
            _motion(GUIDE, 1, "Coulomb", _drawn(fc1=_u(15, 80, True)), True),
            _motion(GUIDE, 3, "Stribeck", _stribeck(50.0, (5e-4, 2e-3), 1e-4)),
            _motion(GUIDE, 4, "Dahl", _bristles(50.0, (2e-7, 1e-6), None, 265.0)),
            _motion(GUIDE, 5, "LuGre", _bristles(50.0, (2e-7, 1e-6), (5e-4, 2e-3), 265.0)),
        ),
    ),
    Mechanism(
        "indenter-friction",
        (
            _motion(INDENTER, 1, "Coulomb", _drawn(fc2=_u(15, 80, True)), True),
            _motion(INDENTER, 3, "Stribeck", _stribeck(50.0, (0.02, 0.1), 2e-3)),
            _motion(INDENTER, 4, "Dahl", _bristles(50.0, (3e-6, 2e-5), None, 3.0)),
            _motion(INDENTER, 5, "LuGre", _bristles(50.0, (3e-6, 2e-5), (0.02, 0.1), 3.0)),
        ),
    ),
    Mechanism(
        "drive-harmonics",
        (
            _motion(
                HARMONICS,
                1,
                "second and third",
                _drawn(h2=_u(0.03, 0.2, True), phi2=PHASE, h3=_u(0.02, 0.15, True), phi3=PHASE),
                True,
            ),
            _motion(
                HARMONICS,
                2,
                "third and fifth",
                _drawn(h_3=_u(0.03, 0.2, True), psi_3=PHASE, h_5=_u(0.02, 0.1, True), psi_5=PHASE),
            ),
            _motion(HARMONICS, 3, "stronger push than pull", _drawn(b=_u(0.06, 0.3, True))),
            _motion(HARMONICS, 4, "crossover", _drawn(d=_u(0.03, 0.15, True))),
        ),
    ),
    Mechanism(
        "drive-droop",
        (
            _motion(DROOP, 1, "first order, no phase", _droop, True),
            _motion(DROOP, 2, "coil inductance", _low_frequency(150, 450, 1.0)),
            _motion(DROOP, 3, "second order", _low_frequency(110, 220, 2.0)),
            _motion(DROOP, 4, "straight", _low_frequency(300, 900, 1.0)),
            _motion(DROOP, 5, "resonant coil", _low_frequency(220, 400, 2.0, zeta=_u(0.1, 0.5))),
        ),
    ),
    Mechanism(
        "force-limit",
        (
            _motion(LIMIT, 1, "clipped", _clip(0.2, 0.5), True),
            _motion(LIMIT, 2, "bent over", _soft_clip),
            _motion(LIMIT, 3, "clipped on the push", _clip(0.2, 0.5)),
            _motion(LIMIT, 4, "slope limited", _slew),
            _motion(LIMIT, 5, "saturating spring", _saturating_spring),
        ),
    ),
    Mechanism(
        "air-spring",
        (
            _motion(AIR, 1, "straight spring and leak", _drawn(k_a=_u(2e4, 1.5e5, True), tau=_u(0.1, 0.5)), True),
            _motion(
                AIR,
                2,
                "isothermal",
                lambda rng, share, site: {"l": rng.uniform(1.5e-3, 8e-3) / share, "tau": rng.uniform(0.1, 0.5)},
            ),
            _motion(
                AIR,
                3,
                "polytropic with a valve",
                lambda rng, share, site: {"l": rng.uniform(1.5e-3, 8e-3) / share, "v_f": rng.uniform(2e-3, 6e-3)},
            ),
            _motion(AIR, 4, "two chambers", _drawn(k_a=_u(4e4, 1.5e5, True), tau_1=_u(0.03, 0.1), tau_2=_u(0.3, 1.0))),
        ),
    ),
    Mechanism(
        "backlash",
        (
            _motion(BACKLASH, 1, "no force over the play", _drawn(g=_u(2e-4, 1e-3, True), y0=_u(-1e-4, 0.0)), True),
            _motion(BACKLASH, 2, "rounded ends", _drawn(g=_u(2e-4, 1e-3, True), y0=_u(-1e-4, 0.0), w=_u(2e-5, 6e-5))),
            _motion(BACKLASH, 3, "worn bush", _drawn(g=_u(3e-4, 1e-3, True), y0=_u(-1e-4, 0.0), r=_u(0.2, 0.6))),
        ),
    ),
    Mechanism(
        "accelerometer-resonance",
        (
            _filter(
                "acceleration",
                sensors.resonance,
                "one mode",
                _low_frequency(2500, 7000, 2.0, "f_a", zeta_a=_u(0.01, 0.08)),
                True,
                "f_a",
                "zeta_a",
            ),
            _filter(
                "acceleration",
                sensors.two_resonances,
                "two modes",
                _low_frequency(2500, 6000, 2.0, zeta=_u(0.02, 0.08), g=_u(7000, 11000)),
                False,
                "f",
                "zeta",
                "g",
            ),
            _filter(
                "acceleration",
                sensors.part_resonance,
                "part of the signal",
                _low_frequency(2500, 6000, 2.0, zeta=_u(0.01, 0.08), part=_u(0.3, 0.8)),
                False,
                "f",
                "zeta",
                "part",
            ),
        ),
    ),
    Mechanism(
        "accelerometer-lowpass",
        (
            _filter(
                "acceleration", sensors.first_order, "first order", _low_frequency(500, 4000, 1.0, "f_b"), True, "f_b"
            ),
            _filter("acceleration", sensors.butterworth, "Butterworth", _low_frequency(800, 3500, 1.0), False, "f"),
            _filter("acceleration", sensors.bessel, "Bessel", _low_frequency(1000, 4000, 1.0), False, "f"),
            _filter("acceleration", sensors.two_stages, "two stages", _low_frequency(1000, 5000, 1.0), False, "f"),
        ),
    ),
    Mechanism(
        "load-cell-inertia",
        (
            _reads(sensors.mass_on_cell, "rigid", _drawn(m_c=_u(0.03, 0.3, True)), True),
            _reads(
                sensors.mass_on_soft_cell,
                "ringing cell",
                _drawn(m_c=_u(0.03, 0.3, True), f_c=_u(5000, 9000), zeta_c=_u(0.02, 0.1)),
            ),
            _reads(sensors.mass_behind_pad, "behind a pad", _drawn(m_c=_u(0.05, 0.3, True), f_p=_u(800, 4000))),
            _reads(sensors.mass_in_contact, "in contact only", _drawn(m_c=_u(0.05, 0.3, True))),
        ),
    ),
    Mechanism(
        "channel-delay",
        (
            _reads(sensors.late_channel, "constant", _drawn(delay_a=_u(5e-5, 4e-4, True)), True),
            _filter(
                "acceleration", sensors.all_pass, "first-order all-pass", _low_frequency(900, 5000, 1.0), False, "f"
            ),
            _filter(
                "acceleration",
                sensors.all_pass_two,
                "second-order all-pass",
                _low_frequency(1500, 7000, 1.0),
                False,
                "f",
            ),
            _reads(sensors.late_at_random, "another in each recording", _drawn(delay_a=_u(5e-5, 4e-4, True))),
        ),
    ),
    Mechanism(
        "mains-hum",
        (
            _reads(sensors.hum, "one line", _drawn(**HUM), True),
            _reads(sensors.hum, "with harmonics", _drawn(**HUM, second=_u(0.2, 0.6), third=_u(0.2, 0.6))),
            _reads(sensors.hum, "swelling", _drawn(**HUM, swell=_u(0.4, 0.9), f_swell=_u(0.5, 3.0))),
        ),
    ),
    Mechanism(
        "sensor-offset",
        (
            _reads(sensors.offset, "constant", _drawn(**ZERO), True),
            _reads(sensors.offset, "another in each recording", _drawn(**ZERO, spread=_u(0.5, 1.0))),
            _reads(sensors.offset, "wandering", _drawn(**ZERO, ramp=_u(1.0, 3.0))),
        ),
    ),
)

MECHANISMS = MappingProxyType({each.name: each for each in _LISTED})
"""What the library has, by name."""

_OUTSIDE = (
    Mechanism("external-vibration", (_motion(FLOOR, 1, "floor", _wave(0.25, 1.2)),)),
    Mechanism("external-vibration", (_motion(FLOOR, 2, "machine on the frame", _wave(60, 250)),)),
    Mechanism("rock-rotation", (_motion(ROTATION, 1, "100 rpm", _rotation),)),
    Mechanism(
        "sensor-highpass",
        (
            _filter("acceleration", sensors.high_pass, "accelerometer", _drawn(f=_u(0.3, 1.5, True)), False, "f"),
            _filter("force", sensors.high_pass, "load cell", _drawn(f=_u(0.3, 1.5, True)), False, "f"),
            _filter("force", sensors.high_pass_two, "two stages", _drawn(f=_u(0.3, 1.0, True)), False, "f"),
            _filter(
                "force",
                sensors.leaky_charge,
                "leaky charge",
                _drawn(f=_u(0.3, 1.5, True), part=_u(0.2, 0.6)),
                False,
                "f",
                "part",
            ),
        ),
    ),
    Mechanism(
        "chips",
        (_motion(CHIPS, 1, "at random", _drawn(chance=_u(0.1, 0.4), F=_u(300, 900), d=_u(1e-5, 4e-5, True))),),
    ),
    Mechanism(
        "converter-wobble",
        (_motion(WOBBLE, 1, "sinusoidal", _drawn(a=_u(0.03, 0.15, True), f=_u(2.0, 7.0), psi=PHASE)),),
    ),
    Mechanism("adhesion", (_motion(ADHESION, 1, "until it tears", _drawn(F_a=_u(40, 200, True))),)),
    Mechanism("loose-bolt", (_motion(RATTLE, 1, "rings", _bolt),)),
    Mechanism(
        "stick-slip",
        (_motion(GUIDE, 5, "with memory", _bristles(80.0, (2e-6, 8e-6), (2e-4, 6e-4), 265.0)),),
        also=("guide-friction",),
    ),
    Mechanism("gain-drift", (_reads(sensors.gain_drift, "load cell", _drawn(rate=_u(0.04, 0.15, True))),)),
    Mechanism("crosstalk", (_reads(sensors.crosstalk, "force on acceleration", _drawn(share=_u(0.005, 0.02, True))),)),
    Mechanism("creep", (_reads(sensors.creep, "load cell", _drawn(share=_u(0.03, 0.1, True), tau=_u(2e-3, 8e-3))),)),
)

OUTSIDE = MappingProxyType({f"{each.name}, {each.equations[0].name}": each for each in _OUTSIDE})
"""What no row of the library has, by name and first equation. Three of them have a name in the recording format."""
NAMED_BY_FORMAT = ("external-vibration", "rock-rotation", "sensor-highpass")
MENDED_GAPS = "mended gaps"
"""Beside these: samples that a logger lost and filled with straight lines."""


def concealed(name: str, equation: Equation, rng: np.random.Generator, share: float, site: Site) -> Concealed:
    """A mechanism at a strength drawn for a site."""
    return Concealed(name, equation, MappingProxyType(equation.draw(rng, share, site)))


ANYWHERE = Site(400.0, 100.0)
LEFT_OUT = MappingProxyType(
    {
        "e": 1.0,
        "r": 0.1,
        "m_r": 50.0,
        "zeta_r": 0.05,
        "zeta_a": 0.02,
        "tau": 1.0,
        "soft_n": 1.0,
        "f_m": 50.0,
        "v_0": 1e-9,
    }
)
"""What a parameter of the library's equations is where it is not stated; others are 0."""


def of_library(name: str, catalogue: Mapping[str, Mechanism] = MECHANISMS, **stated: float) -> Concealed:
    """A mechanism that follows the library's equation, with these parameters by the library's symbols.

    Raises:
        KeyError: no such mechanism or symbol.
    """
    equation = next(each for each in catalogue[name].equations if each.of_library)
    rounded = {"guide-friction": ("fc1", "vs1"), "indenter-friction": ("fc2", "vs2")}.get(name)
    if rounded is not None and stated.get(rounded[1], 0.0) > 0.0:
        equation = equation._replace(code=2)
        return Concealed(name, equation, MappingProxyType({each: float(stated[each]) for each in rounded}))
    symbols = list(equation.draw(np.random.default_rng(0), 1.0, ANYWHERE))
    more = {"channel-delay": ["delay_e", "delay_f"]}.get(name, [])
    for each in stated:
        if each not in (*symbols, *more, *(rounded or ())):
            raise KeyError(f"{name} has no parameter {each}: it has {', '.join((*symbols, *more))}")
    found = {each: float(stated.get(each, LEFT_OUT.get(each, 0.0))) for each in symbols}
    return Concealed(
        name, equation, MappingProxyType(found | {each: float(stated[each]) for each in more if each in stated})
    )


def kernel_parameters(each: Concealed, constants: Constants, controls: Controls) -> list[float]:
    """The parameters as :mod:`drillenv.blind.laws` takes them, in one recording."""
    p = dict(each.parameters)
    if each.equation.place == DROOP and "s" in p:
        p["s"] = 1.0 / max(p["s"], 1e-12)
    if each.equation.place == BACKLASH:  # play is counted from where the straight spring carries the static force
        p["y0"] += constants.pressure_gain * PUSH_PER_BAR * controls.pressure / constants.stiffness
    return list(p.values())
