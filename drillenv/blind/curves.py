"""What was missing, as a function of its argument: the curve that a finding has to agree with.

Each mechanism has one argument and one quantity, the others held at a reference value; docs/trial/rules.md lists them.
What the rig's own constants can take up, such as the straight part of a spring's force, is no part of the comparison:
it is projected out of both curves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from drillenv.blind import laws
from drillenv.blind.body_mechanisms import BODY_MECHANISMS
from drillenv.blind.laws import PARAMETERS
from drillenv.blind.mechanisms import MECHANISMS, Concealed, Equation, of_library
from drillenv.blind.rig import Motion

Floats = NDArray[np.float64]
POINTS = 61
LARGEST_ERROR = 0.10
"""Root mean square of the difference over that of what was missing, at most, for a law that counts as right."""
LEAST_COVER = 0.8
"""Share of the visited range that a reported curve has to cover."""


class Reference(NamedTuple):
    """Where arguments that a curve does not show are held, and the ranges that the recordings visit (1 % to 99 %)."""

    loading_stiffness: float
    """N/m, the true one."""
    stiffness: float
    """N/m, of the coupling."""
    depth: float
    """m, the median while loading."""
    static: float
    """N, the mean static force."""
    advance: float
    """m an impact."""
    ranges: Mapping[str, tuple[float, float]]


class Shape(NamedTuple):
    """How a mechanism's curve is to be read."""

    argument: str
    argument_unit: str
    unit: str
    visited: str
    """Which of the reference's ranges it runs over."""
    free: tuple[Callable[[Floats], Floats], ...] = ()
    """What the rig's constants can take up, as functions of the argument."""


def _constant(x: Floats) -> Floats:
    return np.ones_like(x)


def _straight(x: Floats) -> Floats:
    return x


SHAPES: Mapping[str, Shape] = {
    "contact-rate": Shape("speed into the rock, at the median depth", "m/s", "N", "into"),
    "contact-power-law": Shape("depth, loading", "m", "N", "depth", (_straight,)),
    "contact-toe": Shape("depth, loading", "m", "N", "depth", (_straight,)),
    "rock-compaction": Shape("impacts on a fresh face", "1", "1", "impacts", (_constant,)),
    "rock-mount-compliance": Shape("steady force on the rock", "N", "m", "rock"),
    "stiffness-hardening": Shape("shortening of the coupling", "m", "N", "shortening", (_constant, _straight)),
    "damping-quadratic": Shape("closing speed of the coupling", "m/s", "N", "closing", (_straight,)),
    "guide-friction": Shape("speed of the shaker body", "m/s", "N", "v1", (_constant,)),
    "indenter-friction": Shape("speed of the indenter", "m/s", "N", "v2"),
    "drive-harmonics": Shape("phase of the excitation", "rad", "1", "theta", (np.sin,)),
    "drive-droop": Shape("frequency", "Hz", "1", "frequency", (_constant,)),
    "force-limit": Shape("force asked of the drive", "N", "N", "drive", (_straight,)),
    "air-spring": Shape("sudden advance of the shaker body", "m", "N", "stroke"),
    "backlash": Shape("shortening beyond that at rest", "m", "N", "beyond", (_constant, _straight)),
    "accelerometer-resonance": Shape("frequency", "Hz", "1", "signal"),
    "accelerometer-lowpass": Shape("frequency", "Hz", "1", "signal"),
    "load-cell-inertia": Shape("acceleration", "m/s^2", "N", "acceleration"),
    "channel-delay": Shape("frequency", "Hz", "s", "signal"),
    "mains-hum": Shape("order of the line, in the force", "1", "N", "orders"),
    "viscous-damping": Shape("speed", "m/s", "N", "closing"),
    "dry-friction": Shape("speed", "m/s", "N", "closing"),
    "sensor-offset": Shape("channel: force 0, acceleration 1", "1", "noise", "channels"),
}


def reference(motions: Sequence[Motion], frequencies: Sequence[float], statics: Sequence[float], drive: float,
              rate: float, loading_stiffness: float, stiffness: float) -> Reference:  # fmt: skip
    """The reference of a campaign, from the true motions of its recordings."""
    contact = np.concatenate([m.regime > 0 for m in motions])
    loading = np.concatenate([m.regime == 1 for m in motions])

    def joined(values: Callable[[Motion], Floats]) -> Floats:
        return np.concatenate([values(m) for m in motions])

    def span(x: Floats) -> tuple[float, float]:
        low, high = np.percentile(x, [1.0, 99.0]) if x.size else (0.0, 1.0)
        return float(low), float(high)

    depth = joined(lambda m: m.depth)
    stroke = [np.ptp(signal.detrend(m.x2 + m.shortening)) for m in motions]
    gained = [(m.x2[-1] - m.x2[0]) / max(m.impacts[-1] - m.impacts[0], 1.0) for m in motions]
    beyond = np.concatenate([m.shortening - f / stiffness for m, f in zip(motions, statics, strict=True)])
    ranges = {
        "into": span(joined(lambda m: m.into)[loading]),
        "depth": (0.0, span(depth[loading])[1]),
        "impacts": (0.0, float(max(m.impacts[-1] for m in motions if m.impacts[0] < 1.0))),
        "rock": (0.0, span(joined(lambda m: m.rock)[contact])[1]),
        "shortening": span(joined(lambda m: m.shortening)),
        "closing": span(joined(lambda m: m.closing)),
        "v1": span(joined(lambda m: m.v2 + m.closing)),
        "v2": span(joined(lambda m: m.v2)),
        "theta": (0.0, 2.0 * math.pi),
        "frequency": (min(frequencies), max(frequencies)),
        "drive": (-drive, drive),
        "stroke": (0.0, float(np.median(stroke))),
        "beyond": span(beyond),
        "signal": (50.0, min(0.35 * rate, 4000.0)),
        "acceleration": span(joined(lambda m: m.acceleration)),
        "orders": (1.0, 3.0),
        "channels": (0.0, 1.0),
    }
    middle = float(np.median(depth[loading])) if loading.any() else 1e-5
    return Reference(loading_stiffness, stiffness, middle, float(np.mean(statics)), float(np.mean(gained)), ranges)


def arguments(mechanism: str, where: Reference) -> Floats:
    """(points,) the argument of a mechanism's curve over the range that the recordings visit."""
    visited = SHAPES[mechanism].visited
    low, high = where.ranges[visited]
    count = {"orders": 3, "channels": 2}.get(visited, POINTS)
    return np.linspace(low, high, count)


def curve(mechanism: str, equation: Equation, parameters: Mapping[str, float], x: Floats, where: Reference,
          noise: tuple[float, float, float]) -> Floats | None:  # fmt: skip
    """What is missing at the arguments ``x``; None for an equation that is no function of this one argument."""
    if equation.transfer is not None:
        return _response(mechanism, equation, parameters, x)
    if equation.place is None:
        return _reading(mechanism, parameters, x, noise)
    p = np.zeros(PARAMETERS)
    values = dict(parameters)
    if "s" in values and equation.place == laws.DROOP:
        values["s"] = 1.0 / max(values["s"], 1e-12)
    p[: len(values)] = list(values.values())
    if equation.place == laws.LIMIT and equation.code >= 4:
        return None
    if equation.place == laws.MOUNT:
        return _steady_mount(equation.code, p, x)
    return np.array([_law(equation.place, equation.code, p, float(each), where) for each in x])


def _law(place: int, code: int, p: Floats, x: float, where: Reference) -> float:
    """One point of a law of the motion."""
    k = where.loading_stiffness
    if place == laws.RATE:
        return laws.rate_force(code, p, k * where.depth, where.depth, x)
    if place == laws.POWER:
        return k * (laws.power_depth(code, p, x, True) - x)
    if place == laws.TOE:
        return k * (laws.toe_depth(code, p, x, True, 1.0) - x)
    if place == laws.COMPACTION:
        return laws.compaction_factor(code, p, x, x * where.advance) - 1.0
    if place == laws.SPRING:
        return laws.spring_force(code, p, x)
    if place == laws.BACKLASH:
        return laws.backlash_force(code, p, x, where.stiffness)
    if place == laws.DAMPER:
        return laws.damper_force(code, p, x)
    if place == laws.VISCOUS:
        return laws.viscous_force(code, p, x)
    if place in (laws.GUIDE, laws.INDENTER, laws.DRY):
        return laws.sliding_force(code, p, x)
    if place == laws.HARMONICS:
        return laws.harmonic_share(code, p, x)
    if place == laws.DROOP:
        return laws.droop_gain(code, p, x)[0] - 1.0
    if place == laws.LIMIT:
        return laws.limited(code, p, x) - x
    # air: the force lost to an advance too fast for the supply
    return (
        laws.air_force(code, p, p[0] * x, 0.0, where.static, 0.0)[0]
        if code in (1, 4)
        else laws.air_force(code, p, x, 0.0, where.static, 0.0)[0]
    )


def _steady_mount(code: int, p: Floats, force: Floats) -> Floats:
    """How far a mount gives under a steady force, in m."""
    if code == 2:
        return (p[0] + p[4]) * force
    if code != 3:
        return p[0] * force
    u = p[0] * force
    for _ in range(60):  # Newton's method on u / s_r (1 + (u / u_c)^2) = force
        u = u - (u / p[0] * (1.0 + (u / p[3]) ** 2) - force) / ((1.0 + 3.0 * (u / p[3]) ** 2) / p[0])
    return u


def _response(mechanism: str, equation: Equation, parameters: Mapping[str, float], f: Floats) -> Floats:
    """Gain less 1 over the frequency, or, of a delay, the time by which a frequency is late."""
    assert equation.transfer is not None
    make, names = equation.transfer
    above, over = make(*(parameters[name] for name in names))
    s = 2j * math.pi * f
    h = np.polyval(above, s) / np.polyval(over, s)
    if mechanism == "channel-delay":
        return -np.unwrap(np.angle(h)) / (2.0 * math.pi * f)
    return np.abs(h) - 1.0


def _reading(mechanism: str, p: Mapping[str, float], x: Floats, noise: tuple[float, float, float]) -> Floats:
    """What a channel reads too much."""
    if mechanism == "channel-delay":
        return np.full_like(x, p["delay_a"])
    if mechanism == "load-cell-inertia":
        return p["m_c"] * x
    if mechanism == "mains-hum":
        return p["b_f"] * np.array([1.0, p.get("second", 0.0), p.get("third", 0.0)])
    return np.array([p["o_f"] / noise[1], p["o_a"] / noise[2]])


def reported(
    finding: Mapping[str, Any], x: Floats, where: Reference, noise: tuple[float, float, float]
) -> Floats | None:
    """The curve that a finding states at ``x``: its ``law``, or the library's equation with its parameters.

    None where it states neither, or too little of the range. Outside the range of a ``law`` the points are NaN.
    """
    law = finding.get("law")
    if law:
        at, y = np.asarray(law["x"], dtype=float), np.asarray(law["y"], dtype=float)
        inside = (x >= at.min() - 1e-12) & (x <= at.max() + 1e-12)
        if inside.mean() < LEAST_COVER:
            return None
        return np.where(inside, np.interp(x, at, y), np.nan)
    name = finding["mechanism"]
    catalogue = MECHANISMS if name in MECHANISMS else BODY_MECHANISMS
    if name not in catalogue:
        return None
    stated = {symbol: float(entry["value"]) for symbol, entry in finding.get("parameters", {}).items()}
    same = of_library(
        name, catalogue, **{symbol: value for symbol, value in stated.items() if not symbol.startswith("psi_")}
    )
    return curve(name, same.equation, same.parameters, x, where, noise)


def law_error(mechanism: str, x: Floats, true: Floats, found: Floats) -> float:
    """Root mean square of the difference over that of the true curve, what the constants can take up projected out."""
    known = np.isfinite(found)
    x, true, found = x[known], true[known], found[known]
    free = SHAPES[mechanism].free
    if free:
        basis = np.column_stack([each(x) for each in free])
        basis = basis / np.linalg.norm(basis, axis=0)
        left = np.eye(x.size) - basis @ np.linalg.pinv(basis)
        true, found = left @ true, left @ found
    size = float(np.sqrt(np.mean(true**2)))
    return float(np.sqrt(np.mean((found - true) ** 2))) / size if size > 0.0 else math.inf


def law_of(each: Concealed, where: Reference, noise: tuple[float, float, float]) -> dict[str, Any] | None:
    """The curve of a concealed mechanism, as the answers state it; None where it has none of one argument."""
    if each.mechanism not in SHAPES:
        return None
    shape = SHAPES[each.mechanism]
    x = arguments(each.mechanism, where)
    y = curve(each.mechanism, each.equation, each.parameters, x, where, noise)
    if y is None:
        return None
    return {
        "argument": shape.argument,
        "argument_unit": shape.argument_unit,
        "unit": shape.unit,
        "x": x.tolist(),
        "y": y.tolist(),
    }
