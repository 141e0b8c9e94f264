"""What was missing, as a function of its argument: the curve that a finding has to agree with.

Each mechanism has one argument and one quantity, the others held at a reference value; docs/trial/rules.md lists them.
A law stands beside a constant of the rig, as that of a spring beside its stiffness, and a part of one can be a part of
the other. By the first rules what the constant can take up is projected out of both laws. By the revised ones what is
compared is the whole force, law and constant, up to what no channel tells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.optimize import minimize_scalar

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
FURTHEST, MOVES = 0.3, 241
"""Share of the visited range by which a curve over a displacement may be moved, and how many such moves are tried."""


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
    whole: Whole | None = None
    """The law and the constant together; None where it stands beside none."""


class Whole(NamedTuple):
    """A law together with the constant of the rig that it stands beside."""

    constant: str
    of: Callable[[Floats, Floats, float], Floats]
    """What both come to, from the argument, the law and the constant."""
    open: tuple[Callable[[Floats], Floats], ...] = ()
    """What is left open by labels, which are off by up to a hundredth, as functions of the argument."""
    moves: bool = False
    """Whether the argument is a displacement, whose zero no channel tells."""
    relative: bool = False
    """Whether the constant counts in times the true one, as the law does."""
    asked: bool = False
    """Whether the argument is itself in proportion to the constant."""


def _constant(x: Floats) -> Floats:
    return np.ones_like(x)


def _straight(x: Floats) -> Floats:
    return x


def _sum(x: Floats, law: Floats, constant: float) -> Floats:
    return constant * x + law


def _product(x: Floats, law: Floats, constant: float) -> Floats:
    return constant * (1.0 + law)


def _waveform(x: Floats, law: Floats, constant: float) -> Floats:
    return constant * (np.sin(x) + law)


def _limited(x: Floats, law: Floats, constant: float) -> Floats:
    return x + law


_ROCK = Whole("loading_stiffness", _sum, moves=True)
# the pressure gives the force at rest
_SPRING = Whole("stiffness", _sum, (_constant,), moves=True)


SHAPES: Mapping[str, Shape] = {
    "contact-rate": Shape("speed into the rock, at the median depth", "m/s", "N", "into"),
    "contact-power-law": Shape("depth, loading", "m", "N", "depth", (_straight,), _ROCK),
    "contact-toe": Shape("depth, loading", "m", "N", "depth", (_straight,), _ROCK),
    "rock-compaction": Shape(
        "impacts on a fresh face",
        "1",
        "1",
        "impacts",
        (_constant,),
        Whole("loading_stiffness", _product, relative=True),
    ),
    "rock-mount-compliance": Shape("steady force on the rock", "N", "m", "rock"),
    "stiffness-hardening": Shape("shortening of the coupling", "m", "N", "shortening", (_constant, _straight), _SPRING),
    "damping-quadratic": Shape(
        "closing speed of the coupling", "m/s", "N", "closing", (_straight,), Whole("damping", _sum)
    ),
    "guide-friction": Shape("speed of the shaker body", "m/s", "N", "v1", (_constant,)),
    "indenter-friction": Shape("speed of the indenter", "m/s", "N", "v2"),
    "drive-harmonics": Shape(
        "phase of the excitation",
        "rad",
        "1",
        "theta",
        (np.sin,),
        Whole("drive_gain", _waveform, (np.sin,), relative=True),
    ),
    "drive-droop": Shape(
        "frequency", "Hz", "1", "frequency", (_constant,), Whole("drive_gain", _product, (_constant,), relative=True)
    ),
    "force-limit": Shape(
        "force asked of the drive",
        "N",
        "N",
        "drive",
        (_straight,),
        Whole("drive_gain", _limited, (_straight,), relative=True, asked=True),
    ),
    "air-spring": Shape("sudden advance of the shaker body", "m", "N", "stroke"),
    "backlash": Shape("shortening beyond that at rest", "m", "N", "beyond", (_constant, _straight), _SPRING),
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
    gained = [_advance(m) for m in motions]
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


def _advance(motion: Motion) -> float:
    """Metres that an impact drills: the slope of a line through displacement over impacts, whose ends oscillate."""
    impacts = motion.impacts - motion.impacts.mean()
    spread = float(impacts @ impacts)
    return float(impacts @ motion.x2) / spread if spread > 0.0 else 0.0


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
    size = _rms(_less(true, x, free))
    return _rms(_less(found - true, x, free)) / size if size > 0.0 else math.inf


def law_beside(
    mechanism: str,
    x: Floats,
    finding: Mapping[str, Any],
    constants: tuple[float, float],
    true: Floats,
    where: Reference,
    noise: tuple[float, float, float],
) -> Floats | None:
    """The law that a finding states, beside the constant as it is in truth: (points,), NaN where nothing is said.

    Moved along the axis, and with what labels leave open, as comes nearest to the ``true`` law. ``constants`` are the
    rig's, in truth and as the report has it. None where the report says too little, or the law stands beside none.
    """
    shape = SHAPES[mechanism]
    whole = shape.whole
    if whole is None:
        return None
    in_truth, stated = (1.0, constants[1] / constants[0]) if whole.relative else constants
    without = whole.of(x, np.zeros_like(x), in_truth)
    scale = stated / in_truth if whole.asked else 1.0
    reach = FURTHEST * float(np.ptp(x)) if whole.moves else 0.0

    def moved(by: float) -> Floats | None:
        at = scale * (x + by)
        law = reported(finding, at, where, noise)
        if law is None:
            return None
        found = whole.of(at, law, stated) - without
        if shape.visited == "depth":
            # above the rock there is no contact
            found = np.where(at < 0.0, np.nan, found)
        return nearest(found, true, x, whole.open)

    def off(by: float) -> float:
        found = moved(by)
        known = np.zeros(x.size, dtype=bool) if found is None else np.isfinite(found)
        return math.inf if found is None or known.mean() < LEAST_COVER else _rms((found - true)[known])

    if not whole.moves:
        return moved(0.0)
    tried = np.linspace(-reach, reach, MOVES)
    best, step = float(min(tried, key=off)), 2.0 * reach / (MOVES - 1)
    finer: Any = minimize_scalar(off, bounds=(best - step, best + step), method="bounded")
    return moved(float(finer.x) if finer.fun < off(best) else best)


def law_error_beside(mechanism: str, x: Floats, true: Floats, found: Floats) -> float:
    """The error of a law beside the true constant, in the same measure as that of a law by itself."""
    known = np.isfinite(found)
    if known.mean() < LEAST_COVER:
        return math.inf
    size = _rms(_less(true, x, SHAPES[mechanism].free))
    return _rms((found - true)[known]) / size if size > 0.0 else math.inf


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _less(values: Floats, x: Floats, free: Sequence[Callable[[Floats], Floats]]) -> Floats:
    """Values less what functions of the argument can take up of them."""
    return values - nearest(np.zeros_like(values), values, x, free)


def nearest(found: Floats, true: Floats, x: Floats, free: Sequence[Callable[[Floats], Floats]]) -> Floats:
    """A curve with such multiples of functions of the argument as bring it nearest to the true one."""
    known = np.isfinite(found)
    if not free or not known.any():
        return found
    basis = np.column_stack([each(x) for each in free])
    basis = basis / np.linalg.norm(basis[known], axis=0)
    return found + basis @ np.linalg.lstsq(basis[known], (true - found)[known], rcond=None)[0]


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
