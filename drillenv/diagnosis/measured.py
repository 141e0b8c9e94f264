"""The law that was found, as a curve over its argument with a 95 % band, whatever equation it follows.

Beside the curve stand its partial residuals, which are the curve with what the recordings leave of it, and the nearest
of the library's equations where it follows none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares

from drillenv.diagnosis.coupling import from_rest
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import LEAST, Curve, Equation, Family, constant_beside, damping_at
from drillenv.diagnosis.naming import Tried
from drillenv.diagnosis.noise import line_columns
from drillenv.diagnosis.sensing import FORCE, FORCE_LAG, Added, Sensor, response
from drillenv.diagnosis.sinusoids import Sinusoid
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes, interpolate
from drillenv.diagnosis.terms import DRIVE_PHASE, Model, ModelStructure, OperatingPoint, Term, mean_amplitude
from drillenv.dynamics.constitutive.places import (
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    LOADING,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    SPRING_FROM_REST,
    WAVEFORM,
    Shape,
)
from drillenv.dynamics.effects import REGISTRY
from drillenv.dynamics.hybrid import vector_field as V

POINTS = 61
FARTHEST = 100.0
"""Times w, how deep the indenter is looked for at most."""
BAND = 1.96
LOW_END = 5
"""Part of the range of a law beyond rest, inverted, at whose low end it is taken to be none."""
LEAST_LEAD, POWERS = 1e-3, (1.5, 9.0)
"""Share of a spring's range by which that begins beyond where it has no force, at least, and what powers laws have."""
BINS, FEWEST_SAMPLES = 40, 8
"""Of partial residuals, and samples in one at least."""
ORDERS_SHOWN, OFF_ORDER = (1, 2, 3, 4, 5), 0.5
"""Orders of a hum, and Hz from one within which a line of the noise is it."""
NEAR_DEPTH = 1.3
"""Times the median depth, either way, within which samples speak of a law at that depth."""


def quantity(value: float, std: float, unit: str) -> dict[str, Any]:
    """A number with its 95 % interval as a report gives it."""
    std = float(std)
    return {"value": value, "std": std, "unit": unit, "interval": [value - BAND * std, value + BAND * std]}


class Motion(NamedTuple):
    """A recording's motion as a fit has it, and what it leaves. Arrays of samples."""

    path: Floats
    """(OWN, n)."""
    theta: Floats
    """Phase of the excitation in rad."""
    model: Model
    contact: Floats
    """Force in N that is left in the rock's."""
    push: Floats
    """Force in N that is left in those on the indenter other than the rock's."""


Seen = Callable[[Motion], tuple[Floats, Floats]]
"""Argument of a law at samples, and what they leave of its value."""


class Shown(NamedTuple):
    """What a curve is over, and what it says."""

    argument: str
    argument_unit: str
    unit: str
    x: Floats
    y: Callable[[Model], Floats] | None
    """From the model with the law, of a recording, to values at x; None of the drive's gain over the frequency."""
    seen: Seen | None = None
    """None where neither channel shows the law at once."""
    straight: bool = False
    """Whether constants of the rig take up what is straight in the law."""


class Visited(NamedTuple):
    """What all recordings of a campaign visit, those that were held out included."""

    axes: Axes
    """Over the range of each place's argument."""
    frequencies: tuple[float, float]
    """Hz, the lowest and the highest excitation."""
    depth: float
    """m, the median of the contact's coordinate while loading."""
    per_impact: float
    """m that an impact drills, the mean over recordings."""


def _at(model: Model, axes: Axes, place: int, x: Floats) -> Floats:
    return interpolate(model.curve(place), axes, place, x)


def _ends(axes: Axes, place: int) -> tuple[float, float]:
    points = axes.points(place)
    return float(points[0]), float(points[-1])


def _contact_law(axes: Axes, top: float, found: Model) -> Shown:
    """Force over depth while loading, beyond that of the straight law.

    Up to the depth at which w is at its ``top`` in the model that was ``found``.
    """
    x = np.linspace(0.0, float(depth_at(found, axes, np.array([top]))[0]), POINTS)

    def seen(motion: Motion) -> tuple[Floats, Floats]:
        loading = (motion.path[V.W] > 0.0) & (motion.path[V.V2] > 0.0)
        return depth_at(motion.model, axes, motion.path[V.W][loading]), motion.contact[loading]

    def y(model: Model) -> Floats:
        return model.s[V.KL] * (elastic_depth(model, axes, x) - x)

    return Shown("depth, loading", "m", "N", x, y, seen, straight=True)


def elastic_depth(model: Model, axes: Axes, depth: Floats) -> Floats:
    """(n,) w = R / k_l at depths (n,) in m while loading, which rise from 0.

    A free law says the slope of w over w, which is integrated; an equation says w itself, also where it has no slope at
    the face.
    """
    if model.free[LOADING].any():
        reach = max(float(axes.points(LOADING)[-1]), float(np.max(depth)))
        w = np.linspace(0.0, 1.5 * reach, 1500)
        slope = np.exp(interpolate(model.free[LOADING], axes, LOADING, w))
        depth = np.interp(depth, cumulative_trapezoid(1.0 / slope, w, initial=0.0), w)
    for law in model.laws:
        shape = REGISTRY[law.effect].laws.get("loading")
        if isinstance(shape, Shape):
            scale = model.s[V.KL] if shape.over == "force" else 1.0
            depth = shape.law(depth * scale, law.parameters, float(model.s[V.K])) / scale
    return depth


def depth_at(model: Model, axes: Axes, w: Floats) -> Floats:
    """(n,) depths in m while loading at which R / k_l is w (n,)."""
    reach = deepest = max(float(np.max(w, initial=0.0)), LEAST)
    while elastic_depth(model, axes, np.array([0.0, deepest]))[1] < reach and deepest < FARTHEST * reach:
        deepest *= 2.0
    depth = deepest * np.linspace(0.0, 1.0, 2000) ** 2
    return np.interp(w, elastic_depth(model, axes, depth), depth)


def _contact_rate(axes: Axes, fastest: float, depth: float) -> Shown:
    x = np.linspace(0.0, fastest, POINTS)

    def y(model: Model) -> Floats:
        force = model.s[V.KL] * depth * _at(model, axes, RATE_FACTOR, x)
        return force + _at(model, axes, RATE_FORCE, x) + damping_at(model, depth) * x

    def seen(motion: Motion) -> tuple[Floats, Floats]:
        w, into = motion.path[V.W], motion.path[V.V2] - motion.path[V.UD]
        near = (into > 0.0) & (w > depth / NEAR_DEPTH) & (w < depth * NEAR_DEPTH)
        return into[near], motion.contact[near]

    return Shown("speed into the rock, at the median depth", "m/s", "N", x, y, seen)


def unloaded(model: Model, axes: Axes, ends: tuple[float, float]) -> float:
    """Shortening (m) at which the coupling's spring has no force.

    Recordings tell a spring's force by how its shortening changes, and not from where that is counted. A spring that
    is never unloaded is taken to leave its stiffness by a power of the shortening, as the force over its range has it.
    """
    x = np.linspace(*ends, POINTS)
    stiffness = float(model.s[V.K])
    force = stiffness * x + _at(model, axes, SPRING, x)
    turns = np.flatnonzero(force[1:] * force[:-1] <= 0.0)
    if turns.size:
        slope, level = np.polyfit(x[turns[0] : turns[0] + 2], force[turns[0] : turns[0] + 2], 1)
        return float(-level / slope) if slope > 0.0 else 0.0
    reach = float(np.ptp(x))

    def left(p: Floats) -> Floats:
        beyond = x - x[0] + p[0] * reach
        power, law = (beyond / beyond[-1]) ** p[1], force - stiffness * beyond
        return law - power * (power @ law) / (power @ power)

    first = max(float(force[0]) / (stiffness * reach), LEAST_LEAD)
    found = least_squares(left, (first, 3.0), bounds=((LEAST_LEAD, POWERS[0]), (np.inf, POWERS[1])))
    return float(x[0] - found.x[0] * reach)


def _coupling(model: Model, axes: Axes, group: str, ends: tuple[float, float]) -> Shown:
    """A free law of the coupling's spring or of its play, counted from where the spring has no force or is as stated.

    See :func:`unloaded`; play is at one end of its range, and none at the other.
    """
    place, argument, argument_unit, unit, seen = PLAIN[group]
    if place == SPRING:
        zero = unloaded(model, axes, ends)
    else:
        low = np.linspace(*ends, POINTS)[: POINTS // LOW_END]
        zero = -float(_at(model, axes, place, low).mean() / model.s[V.K])
    x = np.linspace(*ends, POINTS) - zero

    def y(model: Model) -> Floats:
        return _at(model, axes, place, x + zero) + model.s[V.K] * zero

    def seen_there(motion: Motion) -> tuple[Floats, Floats]:
        assert seen is not None
        at, left = seen(motion)
        return at - zero, left

    return Shown(argument, argument_unit, unit, x, y, seen_there, straight=True)


def _play_of(motion: Motion) -> tuple[Floats, Floats]:
    return from_rest(motion.path[V.Y], motion.model), motion.push


def _phase_of(motion: Motion) -> tuple[Floats, Floats]:
    return np.mod(motion.theta, 2.0 * np.pi), motion.push / motion.model.s[V.F_A]


def _drive_of(motion: Motion) -> tuple[Floats, Floats]:
    s = motion.model.s
    return s[V.F_A] * np.sin(motion.theta + s[DRIVE_PHASE]), motion.push


PLAIN: dict[str, tuple[int, str, str, str, Seen | None]] = {
    "spring": (SPRING, "shortening of the coupling", "m", "N", lambda m: (m.path[V.Y], m.push)),
    "play": (SPRING_FROM_REST, "shortening beyond that at rest", "m", "N", _play_of),
    "damper": (DAMPER, "closing speed of the coupling", "m/s", "N", lambda m: (m.path[V.V1] - m.path[V.V2], m.push)),
    "guide": (GUIDE, "speed of the shaker body", "m/s", "N", None),
    "indenter": (INDENTER, "speed of the indenter", "m/s", "N", lambda m: (m.path[V.V2], -m.push)),
    "waveform": (WAVEFORM, "phase of the excitation", "rad", "1", _phase_of),
    "drive": (DRIVE, "force asked of the drive", "N", "N", _drive_of),
}
"""By group of laws that are one curve: its place, argument, its unit, that of the law, and what samples say of it."""


def model_of(fitted: Fitted) -> Model:
    """That of the first recording."""
    return fitted.structure.model(fitted.values, fitted.blocks[0].point)


def shown(family: Family, terms: Sequence[Term], fitted: Fitted, visited: Visited) -> Shown:
    """How a family's law, of these ``terms`` now, is shown."""
    axes = fitted.structure.axes
    if family.group in PLAIN:
        place, argument, argument_unit, unit, seen = PLAIN[family.group]
        ends = _ends(visited.axes, place)
        if family.group in ("spring", "play") and isinstance(terms[0], Curve):
            return _coupling(model_of(fitted), axes, family.group, ends)
        x = axes.between(place, *ends, POINTS)
        straight = place in (SPRING, SPRING_FROM_REST, DAMPER, DRIVE)
        return Shown(argument, argument_unit, unit, x, lambda model: _at(model, axes, place, x), seen, straight)
    if family.group == "contact law":
        return _contact_law(axes, _ends(visited.axes, LOADING)[1], model_of(fitted))
    if family.group == "contact speed":
        return _contact_rate(axes, _ends(visited.axes, RATE_FACTOR)[1], visited.depth)
    if family.group == "compaction":
        x = np.linspace(0.0, 120.0, POINTS)

        def softer(m: Model) -> Floats:
            return _at(replace(m, per_impact=visited.per_impact), axes, COMPACTION, x)

        return Shown("impacts on a fresh face", "1", "1", x, softer)
    if family.group == "air":
        x = np.linspace(0.0, 1e-3, POINTS)
        static = float(np.mean([each.structure.model(fitted.values, each.point).s[V.F_B] for each in fitted.blocks]))

        def lost(m: Model) -> Floats:
            share = m.s[V.AIR_PER_LENGTH] * x
            return m.s[V.AIR_STIFFNESS] * x + static * share / (1.0 + share)

        return Shown("sudden advance of the shaker body", "m", "N", x, lost)
    if family.group == "mount":
        x = np.linspace(0.0, 5e3, POINTS)

        def give(m: Model) -> Floats:
            u = np.linspace(0.0, 4.0 * x[-1] * m.s[V.MOUNT_GAIN] / max(m.s[V.MOUNT_SQUARE], 1e-9), 2000)
            held = m.s[V.MOUNT_SQUARE] * u + _at(m, axes, MOUNT_SPRING, u)
            held -= _at(m, axes, MOUNT_SPRING, u[:1])
            bed = m.s[V.BED_SHARE] * m.s[V.MOUNT_GAIN] / m.s[V.BED_SQUARE] if m.s[V.BED_SQUARE] > 0.0 else 0.0
            return np.interp(m.s[V.MOUNT_GAIN] * x, np.maximum.accumulate(held), u) + bed * x

        return Shown("steady force on the rock", "N", "m", x, give)
    if isinstance(family.terms[0], Sinusoid):
        channel = family.terms[0].channels[0]
        x = np.linspace(0.0, 2.0 * np.pi, POINTS)

        def wave(m: Model) -> Floats:
            return np.hypot(m.sine[channel.index], m.cosine[channel.index]) * np.sin(x)

        return Shown("phase of its own", "rad", channel.unit, x, wave)
    x = np.linspace(*visited.frequencies, POINTS)
    return Shown("frequency", "Hz", "1", x, None)


def with_spread(
    fitted: Fitted, inside: Sequence[int], curve: Callable[[Floats], Floats], step: float = 1e-3
) -> tuple[Floats, Floats]:
    """A curve (n,) and its standard deviation; it follows the parameters ``inside``, in the solver's units."""
    at = fitted.fit.shared[inside]
    y = curve(at)
    slopes = np.array([(curve(at + move) - y) / step for move in step * np.eye(at.size)])
    covariance = fitted.covariance[np.ix_(inside, inside)]
    return y, np.sqrt(np.maximum(np.einsum("ix,ij,jx->x", slopes, covariance, slopes), 0.0))


def law_record(argument: str, argument_unit: str, unit: str, x: Floats, y: Floats, spread: Floats) -> dict[str, Any]:
    """A curve (n,) with its 95 % band, as ``law`` of a report."""
    return {
        "argument": argument,
        "argument_unit": argument_unit,
        "unit": unit,
        "x": x.tolist(),
        "y": y.tolist(),
        "low": (y - BAND * spread).tolist(),
        "high": (y + BAND * spread).tolist(),
    }


def motions_left(fitted: Fitted) -> list[Motion]:
    """Every recording's motion, and what it leaves."""
    found = []
    for block, own in zip(fitted.blocks, fitted.fit.own, strict=True):
        values, data, inside = fitted.values, block.data, block.evaluation
        model = block.structure.model(values, block.point)
        raw = block.integrate(model, own, path=True)
        force, acceleration = (block.measured - block.read(values, raw.signals) - block.disturbance(own))[:, inside]
        theta = data.phase + data.omega / data.rate * np.arange(data.force.size, dtype=np.float64)[inside]
        push = model.s[V.M2] * acceleration + force
        found.append(Motion(raw.path[:, :: block.over // block.stride][:, inside], theta, model, force, push))
    return found


def partial_residuals(fitted: Fitted, display: Shown, y: Floats) -> dict[str, list[float]] | None:
    """Means of a law's partial residuals over parts of its argument, with their standard errors."""
    if display.seen is None:
        return None
    x, left = (np.concatenate(each) for each in zip(*map(display.seen, motions_left(fitted)), strict=True))
    edges = np.linspace(display.x[0], display.x[-1], BINS + 1)
    inside = (x >= edges[0]) & (x < edges[-1])
    at, left = np.digitize(x[inside], edges) - 1, left[inside]
    count = np.bincount(at, minlength=BINS)
    some = count >= FEWEST_SAMPLES
    mean = np.bincount(at, left, BINS)[some] / count[some]
    spread = np.sqrt(np.maximum(np.bincount(at, left**2, BINS)[some] / count[some] - mean**2, 0.0) / count[some])
    middle = 0.5 * (edges[1:] + edges[:-1])[some]
    return {"x": middle.tolist(), "y": (np.interp(middle, display.x, y) + mean).tolist(), "std": spread.tolist()}


def nearest_curve(fitted: Fitted, display: Shown, y: Floats, nearest: Tried) -> Floats:
    """An equation's curve, less what is straight in its difference from the law where constants take that up."""
    structure = replace(fitted.structure, terms=(fitted.structure.terms[0], nearest.equation))
    constants = fitted.structure.split(fitted.values)[0]
    curve = curve_of(display, structure, np.append(constants, nearest.values), fitted.blocks[0].point)
    if display.straight:
        columns = np.column_stack([np.ones_like(display.x), display.x])[:, int(display.x[0] == 0.0) :]
        curve = curve + columns @ np.linalg.lstsq(columns, y - curve)[0]
    return curve


def measured_law(
    fitted: Fitted, family: Family, terms: Sequence[Term], visited: Visited, nearest: Tried | None = None
) -> dict[str, Any]:
    """The curve of a finding, as ``law`` of a report: a 95 % band, partial residuals, the ``nearest`` equation."""
    display = shown(family, terms, fitted, visited)
    inside, names = fitted.indices_of(terms), {each.name for each in terms}

    def curve(own: Floats) -> Floats:
        shared = fitted.fit.shared.copy()
        shared[inside] = own
        return curve_of(display, fitted.structure, shared * fitted.structure.scales, fitted.blocks[0].point, names)

    y, spread = with_spread(fitted, inside, curve)
    law = law_record(display.argument, display.argument_unit, display.unit, display.x, y, spread)
    constant = next(filter(None, map(constant_beside, terms)), "")
    if constant:
        known = zip(fitted.structure.unknowns, fitted.values, strict=True)
        each, value = next((each, value) for each, value in known if each.name == constant)
        law["beside"] = {"constant": constant, "value": float(value), "unit": each.unit}
    seen = partial_residuals(fitted, display, y)
    if seen is not None:
        law["partial_residuals"] = seen
    if nearest is not None and isinstance(nearest.equation, Equation):
        near = nearest_curve(fitted, display, y, nearest)
        law["nearest"] = {"form": nearest.equation.name, "y": near.tolist()}
    return law


def curve_of(
    display: Shown,
    structure: ModelStructure,
    values: Floats,
    point: OperatingPoint,
    only: Collection[str] | None = None,
) -> Floats:
    """What a structure's terms, or ``only`` those of these names, say at the points of a display."""
    if display.y is not None:
        return display.y(structure.model(values, point, only))
    points = [point._replace(frequency=float(each)) for each in display.x]
    given, stated = ([structure.model(values, each, names).s[V.F_A] for each in points] for names in (only, ()))
    return np.array(given) / np.array(stated) - 1.0


def hum_spectrum(fitted: Fitted, terms: Sequence[Added]) -> dict[str, Any]:
    """Amplitude in the force of each order of a hum, as ``law`` of a report: the root mean square over recordings."""
    y, std = hum_amplitudes(fitted, terms, FORCE).T
    return law_record("order of the line, in the force", "1", "N", np.array(ORDERS_SHOWN, dtype=float), y, std)


def hum_amplitudes(fitted: Fitted, terms: Sequence[Added], channel: int) -> Floats:
    """(orders, 2) root mean square over recordings of the amplitude of a hum on a channel, and its standard deviation.

    Of all terms of the hum together, as they are over a recording on the average. Orders that the noise has among its
    lines are the hum's as well.
    """
    first, values = terms[0], {each.name: fitted.values_of(each.name) for each in terms}
    frequency, shown = first.frequency_of(values[first.name]), max(max(term.orders) for term in terms)
    waves, spread = np.zeros((2, len(fitted.blocks), len(ORDERS_SHOWN), 2))
    for i, (block, own) in enumerate(zip(fitted.blocks, fitted.fit.own, strict=True)):
        n, point = block.data.force.size, block.point._replace(rate=block.data.rate)
        said = [term.add(values[term.name], point, n) for term in terms]
        total = sum((each[channel] for each in said if each is not None), np.zeros(n))
        columns = line_columns([k * frequency for k in ORDERS_SHOWN], point.rate, n)
        waves[i] = np.linalg.lstsq(columns.T, total)[0].reshape(2, -1).T
        lines = block.lines_of(channel, own)
        waves[i] += [near(lines, k * frequency) if k > shown else np.zeros(2) for k in ORDERS_SHOWN]
        spread[i] = block.noise[channel].std * math.sqrt(2.0 / n)
    if len(terms) == 1:
        stds = np.sqrt(np.diag(fitted.covariance)[fitted.indices_of(terms)])
        own_spread = first.waves(stds * first.scales)[:, channel]
        for i, order in enumerate(first.orders):
            spread[:, ORDERS_SHOWN.index(order)] = own_spread[:, 2 * i : 2 * i + 2]
    return np.array([mean_amplitude(waves[:, i], spread[:, i]) for i in range(len(ORDERS_SHOWN))])


def near(lines: Sequence[tuple[float, Floats]], frequency: float) -> Floats:
    """(2,) sine and cosine of the line nearest to a frequency in Hz, of frequencies and amplitudes; 0 without one."""
    there = [(abs(at - frequency), waves) for at, waves in lines if abs(at - frequency) < OFF_ORDER]
    return min(there, key=lambda each: each[0])[1] if there else np.zeros(2)


def frequencies_shown(fitted: Fitted) -> Floats:
    """(POINTS,) Hz, over which the response of a sensor is shown."""
    rate = min(each.data.rate for each in fitted.blocks)
    return np.linspace(50.0, min(0.35 * rate, 4000.0), POINTS)


def response_record(unit: str, frequency: Floats, y: Floats, spread: Floats) -> dict[str, Any]:
    """A lag in s, or a gain less 1, over the frequency in Hz, as ``law`` of a report."""
    return law_record("frequency", "Hz", "s" if unit == "s" else "1", frequency, y, spread)


def measured_response(fitted: Fitted, terms: Sequence[Sensor], mechanism: str) -> dict[str, Any]:
    """What a sensor makes of a channel, as ``law`` of a report.

    By the unit of its mechanism's parameters: a lag over frequency (s), a force over acceleration (kg), else a gain
    less 1 over frequency.
    """
    unit = REGISTRY[mechanism].parameters[0].unit
    frequency = frequencies_shown(fitted)
    channels = (0, 0) if terms[0].name == FORCE_LAG else (1, 1)
    if unit == "kg":
        channels = (1, 0)

    inside = fitted.indices_of(terms)
    scales = np.array([each.scale for term in terms for each in term.unknowns])

    def curve(own: Floats) -> Floats:
        found, first, values = np.ones(POINTS, dtype=complex), 0, own * scales
        for term in terms:
            found = found * response(term, values[first : first + len(term.unknowns)], frequency, *channels)
            first += len(term.unknowns)
        if unit == "s":
            return -np.unwrap(np.angle(found)) / (2.0 * np.pi * frequency)
        return np.real(found) if unit == "kg" else np.abs(found) - 1.0

    y, spread = with_spread(fitted, inside, curve)
    if unit != "kg":
        return response_record(unit, frequency, y, spread)
    # a mass, by the force that it adds to an acceleration; the lowest frequencies carry most of it
    every = np.concatenate([each.measured[1] for each in fitted.blocks])
    low, high = np.percentile(every, [1.0, 99.0])
    x = np.linspace(float(low), float(high), POINTS)
    return law_record("acceleration", "m/s^2", "N", x, x * y[:6].mean(), np.abs(x) * spread[:6].mean())
