"""The law that was found, as a curve over its argument with a 95 % band, whatever equation it follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from drillenv.diagnosis import predict
from drillenv.diagnosis.laws import Family
from drillenv.diagnosis.predict import GRID, PLACES, SCALARS, Axes
from drillenv.diagnosis.selection import Fitted
from drillenv.diagnosis.sensing import Sensor, response
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import Model, Term

POINTS = 61
BAND = 1.96


class Shown(NamedTuple):
    """What a curve is over, and what it says."""

    argument: str
    argument_unit: str
    unit: str
    x: Floats
    y: Callable[[Model], Floats]
    """From the model with the law, of a recording, to values at x."""


def _at(model: Model, axes: Axes, place: int, x: Floats) -> Floats:
    at = (np.arcsinh(x / axes.scale[place]) - axes.low[place]) / axes.step[place]
    return np.interp(at, np.arange(GRID), model.tables[place])


def _ends(axes: Axes, place: int) -> tuple[float, float]:
    points = axes.points(place)
    return float(points[0]), float(points[-1])


def _contact_law(axes: Axes) -> Shown:
    """Force over depth while loading, beyond that of the straight law: w' = kappa d' integrated."""
    top = _ends(axes, predict.LOADING)[1]
    x = np.linspace(0.0, top, POINTS)

    def y(model: Model) -> Floats:
        w = np.linspace(0.0, 1.5 * top, 1500)
        kappa = np.exp(_at(model, axes, predict.LOADING, w))
        depth = np.concatenate([[0.0], np.cumsum(0.5 * (1.0 / kappa[1:] + 1.0 / kappa[:-1]) * np.diff(w))])
        return model.s[predict.K_L] * (np.interp(x, depth, w) - x)

    return Shown("depth, loading", "m", "N", x, y)


def _contact_rate(axes: Axes, depth: float) -> Shown:
    x = np.linspace(0.0, _ends(axes, predict.RATE_FACTOR)[1], POINTS)

    def y(model: Model) -> Floats:
        force = model.s[predict.K_L] * depth * _at(model, axes, predict.RATE_FACTOR, x)
        return force + _at(model, axes, predict.RATE_FORCE, x)

    return Shown("speed into the rock, at the median depth", "m/s", "N", x, y)


def _plain(axes: Axes, place: int, argument: str, argument_unit: str, unit: str) -> Shown:
    low, high = _ends(axes, place)
    x = np.linspace(low, high, POINTS)
    return Shown(argument, argument_unit, unit, x, lambda model: _at(model, axes, place, x))


def shown(family: Family, fitted: Fitted, depth: float) -> Shown:
    """How a family's law is shown; ``depth`` is the median loading depth in m."""
    axes = fitted.hypothesis.axes
    plain = {
        "spring": (predict.SPRING, "shortening of the coupling", "m", "N"),
        "backlash": (predict.SPRING_FROM_REST, "shortening beyond that at rest", "m", "N"),
        "damper": (predict.DAMPER, "closing speed of the coupling", "m/s", "N"),
        "guide-friction": (predict.GUIDE, "speed of the shaker body", "m/s", "N"),
        "indenter-friction": (predict.INDENTER, "speed of the indenter", "m/s", "N"),
        "drive-harmonics": (predict.WAVEFORM, "phase of the excitation", "rad", "1"),
        "force-limit": (predict.DRIVE, "force asked of the drive", "N", "N"),
    }
    if family.group in plain:
        return _plain(axes, *plain[family.group])
    if family.group == "contact-law":
        return _contact_law(axes)
    if family.group == "contact-rate":
        return _contact_rate(axes, depth)
    if family.group == "rock-compaction":
        x = np.linspace(0.0, 120.0, POINTS)
        return Shown("impacts on a fresh face", "1", "1", x, lambda m: _at(m, axes, predict.COMPACTION, x))
    if family.group == "air-spring":
        x = np.linspace(0.0, 1e-3, POINTS)
        return Shown("sudden advance of the shaker body", "m", "N", x, lambda m: m.s[predict.AIR_STIFFNESS] * x)
    if family.group == "rock-mount-compliance":
        x = np.linspace(0.0, 5e3, POINTS)

        def give(m: Model) -> Floats:
            return m.s[predict.MOUNT_GAIN] / max(m.s[predict.MOUNT_SQUARE], 1e-9) * x

        return Shown("steady force on the rock", "N", "m", x, give)
    frequencies = [each.scene.frequency for each in fitted.blocks]
    x = np.linspace(min(frequencies), max(frequencies), POINTS)
    return Shown("frequency", "Hz", "1", x, lambda m: m.s[predict.F_A] + 0.0 * x)


def indices_of(fitted: Fitted, terms: Sequence[Term]) -> list[int]:
    """Places of the terms' parameters among all."""
    found, first = {}, 0
    for term in fitted.hypothesis.terms:
        found[term.name] = list(range(first, first + len(term.unknowns)))
        first += len(term.unknowns)
    return [i for term in terms for i in found[term.name]]


def band(fitted: Fitted, inside: Sequence[int], jacobian: Floats) -> Floats:
    """Standard deviation of a curve with the derivatives (x, parameters) by parameters in the solver's units."""
    covariance = fitted.fit.covariance[np.ix_(inside, inside)] * max(1.0, fitted.per_freedom)
    return np.sqrt(np.maximum(np.einsum("xi,ij,xj->x", jacobian, covariance, jacobian), 0.0))


def measured_law(fitted: Fitted, family: Family, terms: Sequence[Term], depth: float) -> dict[str, Any]:
    """The curve of a finding, as ``law`` of a report: x, y and a 95 % band."""
    display = shown(family, fitted, depth)
    names = {each.name for each in terms}
    unknowns = fitted.hypothesis.unknowns
    widths = np.array([each.width for each in unknowns])
    axes, scene = fitted.hypothesis.axes, fitted.blocks[0].scene
    own_indices = indices_of(fitted, terms)

    def curve(shared: Floats) -> Floats:
        split = fitted.hypothesis.split(shared * widths)

        def at(frequency: float) -> Model:
            model = Model(np.zeros(SCALARS), np.zeros((PLACES, GRID)))
            fitted.hypothesis.terms[0].contribute(split[0], model, scene, axes)
            there = scene._replace(frequency=frequency)
            if display.argument == "frequency":
                model.s[predict.F_A] = 1.0
            for term, own in zip(fitted.hypothesis.terms, split, strict=True):
                if term.name in names:
                    term.contribute(own, model, there, axes)
            return model

        if display.argument == "frequency":
            return np.array([float(at(f).s[predict.F_A]) - 1.0 for f in display.x])
        return display.y(at(scene.frequency))

    at = fitted.fit.shared
    y = curve(at)
    slopes = []
    for i in own_indices:
        step = 1e-3
        ahead = at.copy()
        ahead[i] += step
        slopes.append((curve(ahead) - y) / step)
    spread = band(fitted, own_indices, np.array(slopes).T)
    return {
        "argument": display.argument,
        "argument_unit": display.argument_unit,
        "unit": display.unit,
        "x": display.x.tolist(),
        "y": y.tolist(),
        "low": (y - BAND * spread).tolist(),
        "high": (y + BAND * spread).tolist(),
    }


def measured_response(fitted: Fitted, terms: Sequence[Sensor], mechanism: str) -> dict[str, Any]:
    """What a sensor makes of a channel, as ``law`` of a report: gain less 1 or lag over frequency, or a force."""
    rate = min(each.data.rate for each in fitted.blocks)
    frequency = np.linspace(50.0, min(0.35 * rate, 4000.0), POINTS)
    channels = (0, 0) if terms[0].name == "force lag" else (1, 1)
    if mechanism == "load-cell-inertia":
        channels = (1, 0)

    def curve(values: Floats) -> Floats:
        found, first = np.ones(POINTS, dtype=complex), 0
        for term in terms:
            found = found * response(term, values[first : first + len(term.unknowns)], frequency, *channels)
            first += len(term.unknowns)
        if mechanism == "channel-delay":
            return -np.unwrap(np.angle(found)) / (2.0 * np.pi * frequency)
        return np.real(found) if mechanism == "load-cell-inertia" else np.abs(found) - 1.0

    inside = indices_of(fitted, terms)
    values = fitted.values[inside]
    unknowns = [each for term in terms for each in term.unknowns]
    y, slopes = curve(values), []
    for i, unknown in enumerate(unknowns):
        ahead = values.copy()
        ahead[i] += 1e-3 * unknown.width
        slopes.append((curve(ahead) - y) / 1e-3)
    spread = band(fitted, inside, np.array(slopes).T)
    law = {"argument": "frequency", "argument_unit": "Hz", "unit": "s" if mechanism == "channel-delay" else "1"}
    x = frequency
    if mechanism == "load-cell-inertia":
        # a mass, by the force that it adds to an acceleration; the lowest frequencies carry most of it
        every = np.concatenate([each.measured[1] for each in fitted.blocks])
        low, high = np.percentile(every, [1.0, 99.0])
        x = np.linspace(float(low), float(high), POINTS)
        y, spread = x * y[:6].mean(), np.abs(x) * spread[:6].mean()
        law = {"argument": "acceleration", "argument_unit": "m/s^2", "unit": "N"}
    return {
        **law,
        "x": x.tolist(),
        "y": y.tolist(),
        "low": (y - BAND * spread).tolist(),
        "high": (y + BAND * spread).tolist(),
    }
