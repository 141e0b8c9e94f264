"""Which of the library's equations could stand for a law of the drilling rig, and where their fits begin."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from drillenv.diagnosis.adapter import Rival
from drillenv.diagnosis.equations import acts_at
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import (
    DRIVE_LAG,
    LOGARITHMS,
    NUMBERS,
    STRAIGHT,
    Curve,
    Equation,
    Family,
    Gain,
    StrengthOnly,
    damping_at,
    equations,
)
from drillenv.diagnosis.sensing import ACCELEROMETER, RESPONSES, Sensor, response, textbook_sensors
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import GRID, Axes
from drillenv.diagnosis.terms import Model, Term
from drillenv.dynamics.constitutive.places import (
    DRIVE,
    LOADING,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    UNLOADING,
)
from drillenv.dynamics.effects import REGISTRY, mechanism_of_law
from drillenv.dynamics.hybrid import vector_field as V

STARTS = 2
"""Starts of an equation that are followed to their end."""
NEARLY = 1e-4
"""Relative change of the cost, or of parameters, from which a start is near enough: a fit goes on from it."""
FARTHEST_SHIFT = 2.0
"""Share of its range by which a spring's law may be counted from elsewhere."""

ALSO = {ACCELEROMETER: RESPONSES, "high-pass": ("offset",)}
"""What else a law of sensors may turn out to be, by its group: where a corner does not show, charges are offsets."""
NUMBERS_OF_GROUP = {
    "air": ("air_stiffness", "air_per_length", "air_rate"),
    "mount": ("mount_gain", "mount_square", "mount_damping", "bed_share", "bed_square", "bed_damping"),
    "contact speed": ("contact_damping", "contact_damping_power"),
    "compaction": ("compaction_length",),
    "slew rate": ("slew_rate", "slew_share", "drive_delay"),
}
"""Numbers of the model that equations of a group may set."""
USUAL_SHARE = 0.5
"""Of the largest depth, at which damping by a power of it is taken for curves over the speed."""


def law_of(fitted: Fitted, terms: Sequence[Term], point) -> Model:
    """The model of a recording with constants and some terms alone."""
    return fitted.structure.model(fitted.values, point, {each.name for each in terms})


def numbers_of(model: Model) -> Floats:
    """What a model says that is no curve; air has one stiffness, whatever it comes from."""
    s = model.s.copy()
    s[V.AIR_STIFFNESS] += s[V.F_B] * s[V.AIR_PER_LENGTH]
    s[V.AIR_PER_LENGTH] = 0.0
    return s


def as_law(place: int, axes: Axes, stated: float, other: float) -> Floats:
    """(GRID,) what another value of the constant whose law is straight at a place is as a part of the law there."""
    x, ratio = axes.points(place), other / stated
    if place in LOGARITHMS:
        return np.full(GRID, math.log(ratio))
    return x * (ratio - 1.0) if place == DRIVE else (other - stated) * x


def same_forces(axes: Axes, model: Model, other: Model) -> Axes:
    """Axes on which laws of ``other`` stand for the same forces of rock and drive as those of ``model`` on ``axes``.

    The contact's coordinate is the force over the loading stiffness, which may differ, and so may the drive's gain.
    """
    scale = axes.scale.copy()
    scale[DRIVE] *= other.s[V.F_A] / model.s[V.F_A]
    scale[[LOADING, UNLOADING]] *= model.s[V.KL] / other.s[V.KL]
    return axes._replace(scale=scale)


def shifted(axes: Axes, share: float) -> Axes:
    """Axes on which a spring's law stands a share of its range further on: where it has no force, no recording says."""
    low = axes.low.copy()
    low[SPRING] += share * axes.step[SPRING] * (GRID - 1)
    return axes._replace(low=low)


def precision_of(fitted: Fitted, family: Family) -> Floats:
    """(m, m) lower Cholesky factor of the precision of constants and a family's parameters, all others at their best.

    In the solver's units.
    """
    structure = fitted.structure
    inside = fitted.indices_of([structure.terms[0], *structure.current(family.terms)])
    covariance = fitted.fit.covariance[np.ix_(inside, inside)]
    precision = np.linalg.pinv(covariance, hermitian=True) + 1e-9 * np.eye(len(covariance))
    return np.asarray(np.linalg.cholesky(precision), dtype=float)


def starts_of(fitted: Fitted, family: Family, equation: Equation) -> Rival:
    """Where an equation comes nearest to the free law, from each of its own starts.

    Nearest by the quadratic of the log-likelihood about the free fit, so that a law counts where recordings say
    something of it. Constants move with it: a free law leaves to them what they can take up, an equation need not.
    """
    scenes = [each.point for each in fitted.blocks]
    found = [law_of(fitted, family.terms, point) for point in scenes]
    axes, constants = fitted.structure.axes, fitted.structure.terms[0]
    own = fitted.structure.split(fitted.values)[0]
    curves = {term.place: np.linalg.pinv(term.basis.T) for term in family.terms if isinstance(term, Curve)}
    # the same in every recording, as is what an equation says there
    standing = {place: found[0].curve(place) for place in curves}
    scales = {term.place: term.scales for term in family.terms
              if isinstance(term, Curve)}  # fmt: skip
    # but for a gain that falls with the frequency, the recordings say the same
    seen = scenes if DRIVE_LAG in acts_at(equation.effect, equation.form)[1] else scenes[:1]
    weight = math.sqrt(len(scenes) / len(seen))
    factor = precision_of(fitted, family) if curves else None
    names = [each.name for each in constants.unknowns]
    scale = np.array([each.scale for each in (*constants.unknowns, *equation.unknowns)])
    count = own.size
    straight = {place: names.index(STRAIGHT[place]) for place in curves if place in STRAIGHT}
    believed = np.array([each.std for each in constants.unknowns])
    stated = np.array([each.value for each in constants.unknowns])

    def misfit(scaled: Floats) -> Floats:
        values, shift, rows = scaled[:-1] * scale, scaled[-1], []
        off: dict[int, Floats] = {}
        for model, point in zip(found, seen, strict=False):
            tried = Model(per_impact=model.per_impact)
            constants.contribute(values[:count], tried, point, axes)
            equation.contribute(values[count:], tried, point, shifted(same_forces(axes, model, tried), shift))
            if not off:
                off = {
                    place: tried.curve(place) + damping_as_law(place, tried, axes) - standing[place] for place in curves
                }
            given, said = numbers_of(model), numbers_of(tried)
            for i in (*NUMBERS.values(), V.SLIDING1, V.SLIDING2, V.F_A):
                if given[i] > 0.0 and (said[i] > 0.0 or i in NUMBERS.values()):
                    rows.append(weight * math.log(max(said[i], 1e-12) / given[i]))
        if factor is None:
            return np.concatenate([rows, 1e-2 * (scaled[:count] - own / scale[:count]), [0.0]])
        change, priors = values[:count] - own, [1e-3 * shift]
        for place, i in straight.items():
            # with the law free, the constant stays where it is
            off[place] = off[place] + as_law(place, axes, own[i], values[i])
            change[i] = 0.0
            priors.append((values[i] - stated[i]) / believed[i])
        parts = [curves[place] @ off[place] / scales[place] for place in curves]
        return np.concatenate([factor.T @ np.concatenate([change / scale[:count], *parts]), priors])

    bounds = [(each.low, each.high) for each in (*constants.unknowns, *equation.unknowns)]
    low, high = (np.array(each) / scale for each in zip(*bounds, strict=True))
    low, high = np.append(low, -FARTHEST_SHIFT), np.append(high, FARTHEST_SHIFT)
    pairs = product((own, stated), equation.form.starts)
    begun = [np.append(np.concatenate(each) / scale, 0.0) for each in pairs]
    least, chosen = minima(misfit, begun, low, high)
    return Rival(equation, [(each[:count], each[count:-1]) for each in chosen], least if curves else 0.0)


def damping_as_law(place: int, model: Model, axes: Axes) -> Floats | float:
    """(GRID,) or 0: what the rock's damping by a power of the depth is as a part of the law at a place.

    By its tangent in the depth: a force over the speed, and a growth of the rock's force with it.
    """
    s = model.s
    if s[V.CONTACT_DAMPING] == 0.0 or place not in (RATE_FACTOR, RATE_FORCE):
        return 0.0
    power, depth = s[V.CONTACT_DAMPING_POWER], USUAL_SHARE * float(axes.points(LOADING)[-1])
    at_depth = damping_at(model, depth) * axes.points(place)
    return at_depth * (1.0 - power) if place == RATE_FORCE else at_depth * power / (s[V.KL] * depth)


def minima(
    misfit: Callable[[Floats], Floats], begun: Sequence[Floats], low: Floats, high: Floats
) -> tuple[float, list[Floats]]:
    """The least cost of a misfit within bounds (n,), from several starts (n,), and at most ``STARTS`` minima."""
    made = []
    for start in begun:
        within = low - 1e-12, high + 1e-12
        result = least_squares(misfit, np.clip(start, low, high), bounds=within, ftol=NEARLY, xtol=NEARLY, max_nfev=100)
        made.append((float(result.cost), result.x))
    made.sort(key=lambda each: each[0])
    chosen = [made[0][1]]
    for _, values in made[1:]:
        # the last one is where a law is counted from
        if len(chosen) < STARTS and all(np.max(np.abs(values - each)[:-1]) > 0.2 for each in chosen):
            chosen.append(values)
    return made[0][0], chosen


def places_of(family: Family) -> tuple[list[int], list[str]]:
    """Places of a family's curves, and the numbers of the model that it changes."""
    places = [term.place for term in family.terms if isinstance(term, Curve)]
    places += [
        place for term in family.terms if isinstance(term, StrengthOnly) for place in acts_at(term.effect, term.form)[0]
    ]
    if family.group == "mount" and MOUNT_SPRING not in places:
        places.append(MOUNT_SPRING)
    numbers = [DRIVE_LAG] if any(isinstance(term, Gain) for term in family.terms) else []
    return places, [*NUMBERS_OF_GROUP.get(family.group, numbers)]


def rivals(fitted: Fitted, family: Family) -> list[Rival]:
    """The library's equations that could stand for a family's law, the nearest first."""
    if isinstance(family.terms[0], Sensor):
        names = [block.point.name for block in fitted.blocks]
        rate = min(block.data.rate for block in fitted.blocks)
        free = family.terms[0]
        every = [each for each in textbook_sensors(names, rate) if each.effect in mechanisms_of(family)]
        every = [each for each in every if replace(each, name=free.name, effect=free.effect) != free]
        if family.group == "hum":
            every = [each for each in every if f"{each.frequency:g} Hz" in family.name]  # type: ignore[attr-defined]
        constants = fitted.fit.shared[: len(fitted.structure.terms[0].unknowns)]
        starts = [(each, sensor_starts(fitted, family, each, rate)) for each in every]
        return [Rival(each, [(constants, values / each.scales) for values in begun], 0.0) for each, begun in starts]
    found = [starts_of(fitted, family, each) for each in equations(*places_of(family))]
    # those of its own kind first, with states or without: of a law without curves nothing else says which is nearest
    return sorted(found, key=lambda each: (each.equation.has_states != family.has_states, each.worse))


def mechanisms_of(family: Family) -> set[str]:
    """The library's mechanisms that a family may turn out to be."""
    found = {family.mechanism, *map(mechanism_of_law, ALSO.get(family.group, ()))}
    return (found | {each.effect for each in equations(*places_of(family))}) & set(REGISTRY)


def sensor_starts(fitted: Fitted, family: Family, sensor: Sensor, rate: float) -> list[Floats]:
    """Where a sensor's equation begins: of its starts, those whose response is nearest to the free one."""
    free = fitted.values_of(family.terms[0].name)
    points = [block.point for block in fitted.blocks]
    nearest = sensor.begun_at(family.terms[0], free, points)  # type: ignore[arg-type]
    if nearest is not None:
        return [nearest]
    if not sensor.starts or len(sensor.starts) == 1:
        return [np.array([each.value for each in sensor.unknowns])]
    symbols = [each.name for each in sensor.unknowns]
    frequency = np.geomspace(60.0, min(4000.0, 0.35 * rate), 60)
    wanted = response(family.terms[0], free, frequency)  # type: ignore[arg-type]
    scored = []
    for start in sensor.starts:
        values = np.array([start[symbol] for symbol in symbols])
        off = response(sensor, values, frequency) - wanted
        scored.append((float(np.sum(np.abs(off) ** 2)), values))
    scored.sort(key=lambda each: each[0])
    return [values for _, values in scored[:STARTS]]


def taken_up(equation: Term) -> list[str]:
    """Constants that can take up what is straight in an equation's law."""
    places = sorted(acts_at(equation.effect, equation.form)[0]) if isinstance(equation, Equation) else []
    return [STRAIGHT[place] for place in places if place in STRAIGHT]
