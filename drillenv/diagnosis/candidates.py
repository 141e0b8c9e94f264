"""The mechanisms that a diagnosis tries, and at which strengths their mark on the data is first looked for.

Strengths enter a fit as unknowns. What bends the model strongly (a resonance's frequency, a relaxation time, a phase)
is tried at a few values in the first look, one variant each, and freed once the mechanism is fitted for good.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import Parameter
from drillenv.dynamics.effects import REGISTRY


class Variant(NamedTuple):
    """One way for a mechanism to be there."""

    mechanism: str
    probes: tuple[tuple[tuple[str, float], ...], ...]
    """Each probe gives values to parameters of the effect; what it changes, over ``sizes``, is one column."""
    held: tuple[tuple[str, float], ...]
    """Parameters at values of this variant, in every probe."""

    @property
    def own(self) -> bool:
        """Whether each recording has strengths of its own."""
        return self.mechanism in OWN


# For each mechanism: (held, probes) of its variants. A probe is a small strength, in the parameters' units.
_VARIANTS: dict[str, tuple[tuple[dict[str, float], tuple[dict[str, float], ...]], ...]] = {
    "contact-rate": (({}, ({"chi": 0.1},)),),
    "contact-power-law": (({}, ({"n": 1.05},)),),
    "contact-toe": (
        ({"r": 0.1, "e": 1.0}, ({"h": 4e-6},)),
        ({"r": 0.1, "e": 0.0}, ({"h": 4e-6},)),
        ({"r": 0.1, "e": 1.0}, ({"h": 2e-5},)),
    ),
    "rock-compaction": tuple(({"soft_n": n}, ({"soft": 0.1},)) for n in (4.0, 15.0, 50.0)),
    "rock-mount-compliance": tuple(({"m_r": m, "zeta_r": 0.05}, ({"s_r": 4e-9},)) for m in (10.0, 40.0, 100.0)),
    "stiffness-hardening": (({}, ({"k3": 1e8},)),),
    "damping-quadratic": (({}, ({"c2": 20.0},)),),
    "indenter-friction": tuple(({"vs2": speed}, ({"fc2": 1.0},)) for speed in (1e-3, 1e-2, 1e-1)),
    "guide-friction": tuple(({"vs1": speed}, ({"fc1": 5.0},)) for speed in (5e-4, 2e-3, 8e-3)),
    "drive-harmonics": (
        (
            {},
            (
                {"h2": 0.01, "phi2": 0.0},
                {"h2": 0.01, "phi2": 1.5707963267948966},
                {"h3": 0.01, "phi3": 0.0},
                {"h3": 0.01, "phi3": 1.5707963267948966},
            ),
        ),
    ),
    "drive-droop": (({}, ({"s": 0.001},)),),
    "air-spring": tuple(({"tau": tau}, ({"k_a": 500.0},)) for tau in (0.3, 0.8)),
    "accelerometer-resonance": tuple(
        ({"zeta_a": 0.03}, ({"f_a": f},)) for f in (2500.0, 3000.0, 3600.0, 4300.0, 5200.0, 6300.0, 8000.0, 11e3)
    ),
    "accelerometer-lowpass": (({}, ({"f_b": 20000.0},)), ({}, ({"f_b": 4000.0},))),
    "load-cell-inertia": (({}, ({"m_c": 0.01},)),),
    "channel-delay": tuple(({}, ({f"delay_{channel}": late},)) for channel in "efa" for late in (1e-5, 1e-4, 2.5e-4)),
    "mains-hum": tuple(
        (
            {"f_m": f},
            (
                {"b_f": 1.0, "psi_f": 0.0},
                {"b_f": 1.0, "psi_f": 1.5707963267948966},
                {"b_a": 1.0, "psi_a": 0.0},
                {"b_a": 1.0, "psi_a": 1.5707963267948966},
            ),
        )
        for f in (50.0, 60.0)
    ),
    "sensor-offset": (({}, ({"o_f": 1.0}, {"o_a": 1.0})),),
    "force-limit": (({}, ({"F_max": 400.0},)), ({}, ({"F_max": 300.0},))),
    "backlash": tuple(({"y0": y0}, ({"g": 2e-4},)) for y0 in (-2e-4, -1e-4, -5e-5, 0.0, 1e-4)),
}


def variants() -> tuple[Variant, ...]:
    """Every variant of every mechanism that can act on the drilling rig."""
    made = []
    for mechanism, entries in _VARIANTS.items():
        for held, probes in entries:
            made.append(Variant(mechanism, tuple(tuple(probe.items()) for probe in probes), tuple(held.items())))
    return tuple(made)


SCANNED = {
    "rock-mount-compliance": tuple(
        {"s_r": s, "m_r": m, "zeta_r": 0.1} for m in (12.0, 25.0, 50.0, 85.0) for s in (6e-9, 1.2e-8, 2.2e-8, 4e-8)
    ),
    "force-limit": tuple({"F_max": force} for force in (150.0, 190.0, 240.0, 300.0)),
}
"""Where a mechanism is looked for whose mark at one strength says nothing of that at another: what resonates, and a
limit that a fit without it never comes near, with the drive as much weaker."""
SCANNED_JOINED = {
    "air-spring": ({"k_a": 5e4, "tau": 0.3},),
    "guide-friction": ({"fc1": 100.0, "vs1": 2e-3},),
    "backlash": ({"g": 3e-4, "y0": -1e-4}, {"g": 8e-4, "y0": -2e-5}),
}
"""The same where no window on its own shows it. A spring has no stiffness left in its play, and all of it outside; a
shaker that dry friction holds now and then has to be held from the beginning, or nothing tells the fit when."""
HIDDEN = ("air-spring", "guide-friction", "backlash")
"""Those of them that no first look shows, or shows backwards where they are strong; the quickest to fit comes first."""


def _leaking(damping: float) -> dict[str, float]:
    """An air spring that damps as much, both its parameters as usual as can be."""
    tau = float(np.clip(damping / 7e4, 0.1, 0.5))
    return {"k_a": damping / tau, "tau": tau}


ALIKE: dict[str, tuple[str, Callable[[dict[str, float]], dict[str, float]]]] = {
    "guide-friction": ("air-spring", lambda of: _leaking(of["fc1"] / of["vs1"])),
    "air-spring": ("guide-friction", lambda of: {"fc1": of["k_a"] * of["tau"] * 2e-3, "vs1": 2e-3}),
}
"""Mechanisms that pass for each other, and the strengths with which one stands for the other: friction that sets in
slowly and a supply that keeps up quickly are dampers both, of fc1 / vs1 and of k_a tau."""
OWN = {"mains-hum": ("sine_f", "cosine_f", "sine_a", "cosine_a")}
"""Mechanisms whose strengths differ from recording to recording: a recording begins at any phase of the mains."""


FREED = {
    "contact-toe": ("h", "r", "e"),
    "rock-compaction": ("soft", "soft_n"),
    "rock-mount-compliance": ("s_r", "m_r", "zeta_r"),
    "air-spring": ("k_a", "tau"),
    "accelerometer-resonance": ("f_a", "zeta_a"),
    "backlash": ("g", "y0"),
    "mains-hum": ("f_m",),
    "guide-friction": ("fc1", "vs1"),
    "indenter-friction": ("fc2", "vs2"),
}
"""Parameters fitted for good where they are more than those of the probes."""
DELAY = (5e-5, 4e-4)
SIZES = {"delay_e": DELAY, "delay_f": DELAY, "delay_a": DELAY, "vs1": (5e-4, 5e-3), "vs2": (1e-3, 5e-2)}
"""Usual sizes where they are not the registry's: any channel may lag, and a dry guide is seldom perfectly dry."""
WIDTHS = {"f_m": 0.02}
"""Units in which parameters are counted, where a fifth of the usual size is too much for half a second."""
LOOSELY = {"vs1": 0.04, "vs2": 0.04, "e": 0.04, "g": 0.04}
"""Weights of a prior about the first guess for what the data may say nothing of."""
LEAST = {"vs1": 1e-4, "vs2": 1e-4, "tau": 0.02, "g": 1e-5}
"""Lower bounds above the registry's: a sharper corner than this is one for the fit, too, and a supply faster than this
is a damper."""


def usual(mechanism: str, symbol: str) -> tuple[float, float]:
    """Between which values a parameter usually lies."""
    return SIZES.get(symbol) or REGISTRY[mechanism].parameter(symbol).typical


def parameter(mechanism: str, symbol: str, value: float) -> Parameter:
    """A parameter of an effect as an unknown of a fit, with the registry's bounds."""
    entry = REGISTRY[mechanism].parameter(symbol)
    largest = max(abs(each) for each in usual(mechanism, symbol))
    low, high = max(entry.low, LEAST.get(symbol, -math.inf)), entry.high
    value = float(np.clip(value, max(low, -3.0 * largest), min(high, 3.0 * largest)))
    width = WIDTHS.get(symbol, 0.2 * largest)
    return Parameter(f"{mechanism} {symbol}", value, width, LOOSELY.get(symbol, 0.0), low, high)


def own_parameters(mechanism: str, data: Conditioned, strengths: np.ndarray | None = None) -> list[Parameter]:
    """What a mechanism leaves open for each recording: amplitudes of a hum, impacts made before a recording."""
    found = []
    if mechanism in OWN:
        for j, symbol in enumerate(OWN[mechanism]):
            value = 0.0 if strengths is None else float(strengths[j])
            width = data.noise_force if symbol.endswith("_f") else data.noise_acceleration
            found.append(Parameter(f"{mechanism} {symbol} {data.name}", value, width, 0.0, recording=data.name))
    if mechanism == "rock-compaction" and not data.fresh:
        # it had been running for a second at least, and nobody counted
        each_second = data.omega / (2 * math.pi)
        low, start = 0.4 * each_second, 1.5 * each_second
        found.append(
            Parameter(f"{mechanism} N0 {data.name}", start, 2 * each_second, 0.25, low, 1e4, recording=data.name)
        )
    return found
