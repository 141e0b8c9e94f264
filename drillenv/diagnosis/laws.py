"""Families of missing physics with free laws: curves over their argument, as penalised splines."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from drillenv.diagnosis.equations import GRIPS, acts_at, grips_of, has_states, parameters_of, scalars_of
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import GRID, PLACES, Axes, interpolate
from drillenv.diagnosis.terms import DRIVE_PHASE, Law, Model, ModelStructure, OperatingPoint, Term, Unknown
from drillenv.diagnosis.thresholds import STRAIGHT_END, YIELDING
from drillenv.dynamics.constitutive.places import (
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    LOADING,
    MOUNT_DAMPER,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    REFERENCE_DEPTH,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    WAVEFORM,
)
from drillenv.dynamics.constitutive.places import PLACES as EVERY_PLACE
from drillenv.dynamics.effects import REGISTRY, Parameter, mechanism_of_law
from drillenv.dynamics.forms import Form
from drillenv.dynamics.hybrid import vector_field as V

TWO_PI = 2.0 * math.pi
PLACE_NAMES = tuple(place.name for place in EVERY_PLACE)
"""In the order of the integrator's places."""
SPRINGS = (SPRING, SPRING_FROM_REST)
EVEN = 1e3
"""Scale of an axis over its range, whose points are evenly apart."""
LEAST = 1e-9
"""Range in m or m/s of an axis over what does not move: of a mount that is not there."""
LOGARITHMS = (LOADING, UNLOADING)
"""Places whose tables hold the logarithm of a factor."""
PARTS_WITH_NUMBERS = ("mount", "bed", "air", "contact_damping", "compaction", "slew", "drive_delay")
NUMBERS = {name: at for name, at in V.SCALAR_AT.items() if name.startswith(PARTS_WITH_NUMBERS) or "bristle" in name}
"""Places of the numbers that equations set and no curve shows, by their names."""
NOTHING = 1e-5
"""Share of how far from neutral a parameter begins, within which it is neutral: a play of nanometres is no curve."""
LEAST_FRICTION = 1e-3
"""N at which a family of friction begins: of bristles that slide at no force nothing could be differentiated."""
LEAST_GRIP = 1e-6
"""N. With no friction at all the engine does not know which way a mass slides, and so not what more would do."""
DRIVE_LAG = "drive_lag"
LONGEST_DELAY = 5e-4
"""s of a drive whose slope is limited."""
DRAWN = 1e-3
"""Of a corner, root mean square, that smooth functions leave where they draw it."""
LACKING = 0.1
"""Root mean square of what a law says of a straight line to 1, from which it has none."""
IDENTICAL = 1e-6
"""By which functions of root mean square 1 may differ and be the same."""
SLOW = 30.0
"""Share of the highest speed below which free laws over a speed are as fine as above it, inverted."""
MOST_IMPACTS = 1000.0
"""On a face of the rock: as many as a rig makes in the seconds before a recording and in it."""
NO_FORM = Form("", (), ())
MOUNT_LAW = "mount law"
"""The family that corrects a mount, where there is one."""
HARDENING, SATURATING = "hardening spring", "saturating spring"
"""What a spring's law may be."""
CURVED, SOFT_LAYER = "contact law", "soft layer"
"""What a contact's law may be."""


@dataclass(frozen=True)
class Curve(Term):
    """A free law at one place: coefficients of basis functions that are tabulated on the place's axis."""

    place: int = 0
    basis: Floats = field(default_factory=lambda: np.zeros((0, GRID)))
    """(coefficients, GRID), of root mean square 1, the smoothest first."""
    corners: int = 0
    """Functions, the last ones, that have a corner each."""

    @property
    def roughness(self) -> Floats:
        """(coefficients less corners,) mean square of each smooth function's second difference."""
        return np.mean(np.diff(self.basis[: len(self.basis) - self.corners], 2, axis=1) ** 2, axis=1)

    def corner(self, x: Floats, at: float) -> Floats:
        """(GRID,) a function with a corner at one argument: a hinge, odd or even where the law is.

        Where the law is the logarithm of a stiffness it is a jump, as the slope of a force that bends has one; of a
        periodic law a parabola from one corner to the next, without its fundamental, which is the drive's. It is 0
        where the law always is, and holds a straight line only where the law does. All 0 where the smooth functions
        draw it.

        Args:
            x: (GRID,) the axis of the law.
            at: In the unit of the axis.
        """
        mirrored, straight, level = self.basis[:, ::-1], x / np.max(np.abs(x)), np.ones(GRID)
        if np.allclose(self.basis, -mirrored, atol=IDENTICAL):
            found = np.sign(x) * np.maximum(np.abs(x) - abs(at), 0.0)
        elif np.allclose(self.basis, mirrored, atol=IDENTICAL):
            found = np.maximum(np.abs(x) - abs(at), 0.0)
        elif np.allclose(self.basis[:, 0], self.basis[:, -1], atol=IDENTICAL):
            return self._periodic_corner(x, at)
        else:
            found = np.where(x > at, 1.0, 0.0) if self.place in LOGARITHMS else np.maximum(x - at, 0.0)
        found = found / max(float(np.std(found)), 1e-12)
        smooth = np.vstack([self.basis, level]).T
        if _residual_rms(smooth, straight) > LACKING:
            found = found - np.polynomial.Polynomial.fit(x, found, 1)(x)
        nowhere = [i for i in (0, (GRID - 1) // 2, GRID - 1) if np.all(np.abs(self.basis[:, i]) < IDENTICAL)]
        found = found - found[nowhere].mean() if nowhere else found
        return found if _residual_rms(np.column_stack([smooth, straight]), found) > DRAWN else np.zeros(GRID)

    def _periodic_corner(self, x: Floats, at: float) -> Floats:
        """(GRID,) a periodic function whose slope jumps at one argument; 0 where the smooth functions draw it."""
        turned = TWO_PI * (x - x[0]) / (x[-1] - x[0])
        phase = np.mod((x - at) / (x[-1] - x[0]), 1.0)
        known = np.column_stack([np.ones(GRID), np.sin(turned), np.cos(turned)])
        found = phase**2 - phase
        found = found - known @ np.linalg.lstsq(known, found)[0]
        found = found / float(np.std(found))
        return found if _residual_rms(np.column_stack([self.basis.T, known]), found) > DRAWN else np.zeros(GRID)

    def with_corner(self, corner: Floats) -> Curve:
        """The same with a function (GRID,) that has a corner."""
        name, scale = f"{self.name} corner {self.corners}", self.unknowns[0].scale
        more = coefficients(name, 1, scale)[0]._replace(name=name)
        basis = np.vstack([self.basis, corner])
        return replace(self, unknowns=(*self.unknowns, more), basis=basis, corners=self.corners + 1)

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Add the curve."""
        model.free[self.place] += values @ self.basis


@dataclass(frozen=True)
class Gain(Term):
    """A free law over the frequency of the excitation: of the drive's gain, or of its phase.

    The polynomial through values at knots.
    """

    scalar: int = 0
    knots: Floats = field(default_factory=lambda: np.zeros(0))
    """(coefficients,) Hz."""

    def at(self, frequency: float, values: Floats) -> float:
        """The law at a frequency in Hz."""
        low, high = self.knots[0], self.knots[-1]
        x = 2.0 * (np.append(self.knots, frequency) - low) / max(high - low, 1e-9) - 1.0
        powers = np.polynomial.chebyshev.chebvander(x, self.knots.size - 1)
        return float(powers[-1] @ np.linalg.lstsq(powers[:-1], values, rcond=None)[0])

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Change the drive's gain or phase at the recording's frequency."""
        change = self.at(point.frequency, values)
        if self.scalar == V.F_A:
            model.s[V.F_A] *= 1.0 + change
        else:
            model.s[self.scalar] += change


@dataclass(frozen=True)
class Air(Term):
    """Pressure that falls as the piston advances and recovers: stiffness, and logarithm of the time in s."""

    has_states = True

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Add the air's stiffness."""
        model.s[V.AIR_STIFFNESS] += values[0]
        model.s[V.AIR_RATE] = math.exp(-values[1])


@dataclass(frozen=True)
class SlewRateLimit(Term):
    """A drive of limited slew rate: share of the drive, logarithm of its slew rate in N/s, and its delay in s."""

    has_states = True

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Limit the slew rate."""
        model.s[V.SLEW_SHARE] += values[0]
        model.s[V.SLEW_RATE] = math.exp(values[1])
        model.s[V.DRIVE_DELAY] = values[2]


@dataclass(frozen=True)
class Mount(Term):
    """A rock that gives, by one mode: gain in 1/kg, logarithm of the frequency in Hz, and damping ratio."""

    has_states = True

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Add the mode."""
        gain, logarithm, ratio = values
        turn = TWO_PI * math.exp(logarithm)
        model.s[V.MOUNT_GAIN] += gain
        model.s[V.MOUNT_SQUARE] = turn**2
        model.s[V.MOUNT_DAMPING] = 2.0 * ratio * turn


@dataclass(frozen=True)
class Equation(Term):
    """A mechanism of the library by its own equation."""

    effect: str = ""
    form: Form = NO_FORM
    has_states: bool = False

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Add what the equation says at each of its places, and of numbers of the model."""
        s, p = model.s, self.parameters(values)
        model.laws.append(Law(self.effect, self.form, p, axes))
        numbers = scalars_of(self.effect, p)
        for name, value in numbers.items():
            if name == DRIVE_LAG:
                s[V.F_A] /= math.hypot(1.0, value * point.frequency)
            elif name in NUMBERS:
                s[NUMBERS[name]] += value
        for name in GRIPS:
            if name in numbers or name in grips_of(self.effect, self.form):
                s[V.SCALAR_AT[name]] += max(numbers.get(name, 0.0), LEAST_GRIP)

    @property
    def has_bed(self) -> bool:  # type: ignore[override]
        """Whether the form has a bed under the mount."""
        return "bed_square" in acts_at(self.effect, self.form)[1]

    @property
    def neutral(self) -> Floats:
        """(1,) of its first parameter, which is its strength."""
        return np.array([REGISTRY[self.effect].parameter(self.form.symbols[0]).neutral])

    def parameters(self, values: Floats) -> tuple[float, ...]:
        """All of the effect's, by their order; neutral where the form has them not, or they are next to nothing."""
        p = parameters_of(self.effect, self.form, tuple(float(each) for each in values))
        starts = np.array([parameters_of(self.effect, self.form, start) for start in self.form.starts])
        neutral = np.array([each.neutral for each in REGISTRY[self.effect].parameters])
        nothing = NOTHING * np.abs(starts - neutral).max(axis=0)
        rows = zip(p, neutral.tolist(), nothing.tolist(), strict=True)
        return tuple(none if abs(value - none) < least else value for value, none, least in rows)


@dataclass(frozen=True)
class StrengthOnly(Equation):
    """An equation whose first parameter is free, its strength; all others are as at its first start."""

    def parameters(self, values: Floats) -> tuple[float, ...]:
        """All of the effect's, by their order."""
        return super().parameters(np.append(values, self.form.starts[0][1:]))


def damping_at(model: Model, depth: float) -> float:
    """Damping of the rock in N s/m at a depth in m, by a power of it."""
    return float(model.s[V.CONTACT_DAMPING]) * (depth / REFERENCE_DEPTH) ** float(model.s[V.CONTACT_DAMPING_POWER])


def equations(places: Sequence[int], numbers: Sequence[str]) -> list[Equation]:
    """The library's equations that act at one of these places, or on one of these numbers, and nowhere else."""
    found = []
    for name, effect in REGISTRY.items():
        for form in effect.forms:
            own, made = acts_at(name, form)
            if (own or made) and own <= set(places) and made <= set(numbers):
                unknowns = tuple(_unknown(effect.parameter(symbol), form, i) for i, symbol in enumerate(form.symbols))
                states = has_states(name, parameters_of(name, form, form.starts[0]))
                found.append(Equation(f"{name}: {form.name}", unknowns, name, form, states))
    return found


def _unknown(parameter: Parameter, form: Form, i: int) -> Unknown:
    """A parameter of an equation; its unit is a fifth of the largest start.

    It is no farther from neutral than twice what is typical, where the equation would stand for another mechanism: a
    soft layer that is thicker than the blows are deep is no layer.
    """
    starts = [start[i] for start in form.starts]
    largest, farthest = max(map(abs, starts)), 2.0 * max(abs(each - parameter.neutral) for each in parameter.typical)
    low, high = lower_bound(parameter, starts, i), parameter.high
    if farthest > 0.0:
        low, high = max(low, parameter.neutral - farthest), min(high, parameter.neutral + farthest)
    return Unknown(parameter.symbol, form.starts[0][i], 0.2 * largest, math.inf, low, high, parameter.unit)


def lower_bound(parameter: Parameter, starts: Sequence[float], i: int) -> float:
    """The lower bound of the parameter of a form that comes after i others.

    What only some forms of the effect have is no nearer to neutral than a tenth of its starts, where the equation would
    be a simpler form, and singular: dry friction that is rounded over no speed.
    """
    always = any(each != parameter.neutral for each in parameter.typical)
    return parameter.low if always or i == 0 else max(parameter.low, 0.1 * min(map(abs, starts)))


def bsplines(count: int, at: Floats | None = None) -> Floats:
    """(count, GRID) cubic B-splines over an axis, even in ``at`` (GRID,), which rises; in the axis where None."""
    at = np.arange(GRID, dtype=float) if at is None else at
    knots = np.concatenate([[at[0]] * 3, np.linspace(at[0], at[-1], count - 2), [at[-1]] * 3])
    return BSpline.design_matrix(np.clip(at, at[0], at[-1]), knots, 3).toarray().T


def odd(right: Floats) -> Floats:
    """(count, GRID) of functions over the right half of an axis (count, half), those odd about its middle: 0 there."""
    right = right - right[:, :1]
    return np.concatenate([-right[:, :0:-1], right], axis=1)


def odd_with_step(right: Floats) -> Floats:
    """(count, GRID) the same of functions that need not be 0 in the middle, where they then have a step; orthogonal."""
    made = np.concatenate([-right[:, :0:-1], np.zeros((len(right), 1)), right[:, 1:]], axis=1)
    return np.asarray(np.linalg.svd(made, full_matrices=False)[2] * math.sqrt(GRID), dtype=float)


def axes_of(paths: Sequence[Floats], drive: float, rest: Sequence[float]) -> Axes:
    """Axes over the ranges that motions (OWN, n) visit; ``rest`` is F_b / k of each."""

    def span(values: Floats) -> tuple[float, float]:
        low, high = np.percentile(values, [0.2, 99.8])
        return float(low), float(high)

    y = np.concatenate([p[V.Y] for p in paths])
    beyond = np.concatenate([p[V.Y] - r for p, r in zip(paths, rest, strict=True)])
    v1, v2 = (np.concatenate([p[i] for p in paths]) for i in (V.V1, V.V2))
    w = np.concatenate([p[V.W] for p in paths])
    # motions that could not be followed need not touch the rock
    touches = w > 0.0 if np.any(w > 0.0) else np.ones(w.size, dtype=bool)
    deep = max(float(np.percentile(w[touches], 99.8)), LEAST)
    fast = max(float(np.percentile(np.abs(v2[touches]), 99.8)), LEAST)
    ranges: dict[int, tuple[float, float, float]] = {
        LOADING: (0.0, deep, deep / 200.0),
        UNLOADING: (0.0, deep, deep / 200.0),
        RATE_FACTOR: (-fast, fast, fast / 8.0),
        RATE_FORCE: (-fast, fast, fast / 8.0),
        COMPACTION: (0.0, MOST_IMPACTS, 5.0),
        WAVEFORM: (0.0, TWO_PI, EVEN),
        DRIVE: (-drive, drive, EVEN * drive),
    }
    u, giving = (np.concatenate([p[i] for p in paths]) for i in (V.U, V.UD))
    for place, values in ((SPRING, y), (SPRING_FROM_REST, beyond), (MOUNT_SPRING, u)):
        low, high = span(values)
        high = max(high, low + LEAST)
        ranges[place] = (low, high, EVEN * max(abs(low), abs(high)))
    # dry friction changes its sign within less than a sample
    speeds = ((DAMPER, v1 - v2), (GUIDE, v1), (INDENTER, v2), (MOUNT_DAMPER, giving))
    for place, values in speeds:
        largest = max(float(np.percentile(np.abs(values), 99.8)), LEAST)
        ranges[place] = (-largest, largest, largest / 300.0)
    low, high, scale = np.array([ranges[place] for place in range(PLACES)]).T
    return Axes.over(scale, low, high)


def axes_visited(paths: Sequence[Floats], models: Sequence[Model]) -> Axes:
    """The same of motions by their models."""
    drive = max(float(each.s[V.F_A]) for each in models)
    return axes_of(paths, drive, [float(each.s[V.F_B] / each.s[V.K]) for each in models])


def coefficients(name: str, count: int, scale: float) -> tuple[Unknown, ...]:
    """Parameters of a free law at 0, in units of ``scale``, thirty of which are the prior's standard deviation."""
    return tuple(Unknown(f"{name} {i}", 0.0, scale, 30.0 * scale) for i in range(count))


def _waves(orders: Sequence[int]) -> Floats:
    around = np.linspace(0.0, TWO_PI, GRID)
    return np.array([part(order * around) for order in orders for part in (np.sin, np.cos)])


@dataclass(frozen=True)
class Family:
    """A mechanism whose law is free: which balance it enters and which variables it depends on."""

    name: str
    group: str
    """The name of its law. Families of the same law at another time constant or frequency have one group."""
    terms: tuple[Term, ...]
    known_as: str = ""
    """The mechanism where no equation of the library tells which; where empty, the one that claims the group's law."""
    sentence: str = ""
    """What is said of it where no mechanism of the library claims its law."""
    textbook: bool = False
    """Whether its law is the library's equation."""
    look_elsewhere: int = 1
    """Frequencies of which its own is the best."""
    constant: str = ""
    """A constant of the paper's model that need not be as stated: no mechanism is missing, and there is no term."""
    least: float = 0.0
    """Below which its largest parameter is within what sensors are off anyway, in its unit."""
    starting_strength: float = 0.0
    """Where not 0, value of its first parameter from which it is fitted: dry friction that is too weak slides where the
    true one sticks, and the likelihood has a minimum for each stop that is missed; from above it falls smoothly."""

    @property
    def mechanism(self) -> str:
        """The name of the mechanism in the library; that of the law where none claims it."""
        return self.known_as or mechanism_of_law(self.group)

    @property
    def outside(self) -> str:
        """A sentence for what no mechanism of the library is: it says what a campaign is ``unexplained`` by."""
        return self.sentence if self.mechanism == self.group else ""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The parameters of all its terms."""
        return tuple(each for term in self.terms for each in term.unknowns)

    @property
    def size(self) -> int:
        """How many parameters it has."""
        return len(self.unknowns) + bool(self.constant)

    @property
    def has_states(self) -> bool:
        """Whether it has states of its own."""
        return any(term.has_states for term in self.terms)

    @property
    def partly_own(self) -> bool:
        """Whether some of its parameters are each recording's own, and others those of all recordings."""
        return any(term.partly_own for term in self.terms)


@dataclass(frozen=True)
class FreeLaws:
    """How fine free laws are."""

    axes: Axes
    detail: int = 1

    def curve(self, name: str, scale: float, place: int, basis: Floats) -> Term:
        """A law of basis functions (m, GRID)."""
        if place in (DAMPER, DRIVE):
            # a force that is there at all times is the pressure's
            basis = _through_zero(basis)
        if place in (*SPRINGS, MOUNT_SPRING):
            # where a spring is at rest, no recording says
            basis = basis - basis.mean(axis=1, keepdims=True)
        free = smoothest_first(normalised(basis))
        return Curve(name, coefficients(name, len(free), scale), place, free)

    def splines(self, count: int, at: Floats | None = None) -> Floats:
        """B-splines, so many at the lowest resolution, even in ``at`` (GRID,)."""
        return bsplines((count - 3) * self.detail + 3, at)

    def finer_at_zero(self, count: int, place: int) -> Floats:
        """Finer at low speeds, and near nothing, where a soft layer or a tip that is round begins."""
        x = self.axes.points(place)
        return self.splines(count, np.arcsinh(SLOW * x / x[-1]))

    def odd_over_speed(self, place: int) -> Floats:
        """Friction: odd, and finer at low speeds."""
        x = self.axes.points(place)[(GRID - 1) // 2 :]
        return odd(bsplines(3 * self.detail + 3, np.arcsinh(SLOW * x / x[-1])))[1:]


def families(axes: Axes, frequencies: Sequence[float], detail: int = 1) -> list[Family]:
    """Every family with a free law, at zero; ``detail`` times as many spline intervals.

    A law holds what is straight in it: which share of that is a constant's, the constants' priors say.
    """
    free = FreeLaws(axes, detail)
    rates, friction = _through_zero(free.splines(7)), free.odd_over_speed
    # a face that has been hit for long changes no more
    compaction = free.splines(6)[:-1]
    rows: dict[str, list[tuple[str, float, int, Floats]]] = {
        CURVED: [
            ("loading", 0.05, LOADING, free.finer_at_zero(8, LOADING)),
            ("unloading", 0.05, UNLOADING, free.finer_at_zero(8, UNLOADING)),
        ],
        "contact speed": [("rate-factor", 0.05, RATE_FACTOR, rates), ("rate-force", 20.0, RATE_FORCE, rates)],
        "compaction": [("compaction", 0.1, COMPACTION, compaction)],
        "spring": [("spring", 10.0, SPRING, free.splines(8))],
        "play": [("spring-from-rest", 10.0, SPRING_FROM_REST, free.splines(12))],
        "damper": [("damper", 10.0, DAMPER, free.finer_at_zero(9, DAMPER))],
        "guide": [("guide", 10.0, GUIDE, friction(GUIDE))],
        "indenter": [("indenter", 10.0, INDENTER, friction(INDENTER))],
        "waveform": [("waveform", 0.05, WAVEFORM, _waves(range(2, 4 * detail + 6)))],
        "drive": [("drive", 10.0, DRIVE, free.splines(9))],
        # of a mount that is one mass on spring and damper: it stiffens, or its clamps are dry
        MOUNT_LAW: [
            ("mount-spring", 5.0, MOUNT_SPRING, free.splines(8)),
            ("mount-damper", 5.0, MOUNT_DAMPER, friction(MOUNT_DAMPER)),
        ],
    }
    *acting, mounting = [Family(name, name, tuple(free.curve(*each) for each in laws)) for name, laws in rows.items()]
    known_as = {"spring": mechanism_of_law(HARDENING)}
    acting = [replace(each, known_as=known_as.get(each.name, "")) for each in acting]
    steepest = axes.scale[DRIVE] / EVEN * TWO_PI * max(frequencies)
    remembering = [*_remembering(), *_slew_rate_limits(steepest), *_presliding()]
    return [*acting, _droop(frequencies), *remembering, replace(mounting, group="mount")]


def _droop(frequencies: Sequence[float]) -> Family:
    # a parabola, or what fewer frequencies can tell
    distinct = np.unique(np.round(frequencies, 1)).size
    knots = np.linspace(min(frequencies), max(frequencies), max(1, min(3, distinct - 1)))
    gains = (
        Gain("gain", coefficients("gain", knots.size, 0.05), V.F_A, knots),
        Gain("phase", coefficients("phase", knots.size, 0.05), DRIVE_PHASE, knots),
    )
    return Family("drive gain", "drive gain", gains)


MOUNT_FREQUENCIES = np.geomspace(40.0, 1000.0, 18)
"""Hz, from which on a mount is looked for: as far from one to the next as half the width of its response at first."""
MOST_DAMPED = 0.35
"""Damping ratio of a mount up to which it swings back, twice what is typical: a mode that is damped more follows forces
over depth and speed as well, and is another mechanism."""


def _remembering() -> list[Family]:
    """Families with states of their own, from several time constants and frequencies on."""
    found = []
    # no mount pushes back harder than a rigid one, and no air pulls
    (stiffness,), (gain,) = coefficients("air", 1, 1e4), coefficients("mount", 1, 0.01)
    stiffness, gain = stiffness._replace(low=0.0), gain._replace(low=0.0)
    for tau in (0.06, 0.4):
        time = Unknown("logarithm of its time", math.log(tau), 0.2, low=math.log(0.01), high=math.log(10.0))
        found.append(Family(f"air {tau:g} s", "air", (Air("air", (stiffness, time)),)))
    for f in MOUNT_FREQUENCIES:
        turn = Unknown("logarithm of its frequency", math.log(f), 0.1, low=math.log(20.0), high=math.log(2000.0))
        ratio = Unknown("damping ratio", 0.1, 0.02, low=0.005, high=MOST_DAMPED)
        mode = Mount("mount", (gain, turn, ratio))
        found.append(Family(f"mount {f:.0f} Hz", "mount", (mode,)))
    return found


SLEW_RATES = (0.45, 0.65, 0.9)
"""Shares of the steepest slope that is asked of the drive, from which on a limit of it is looked for."""


def _slew_rate_limits(steepest: float) -> list[Family]:
    """Families of a drive whose force changes no faster than by a slope, in N/s, where so much is asked of it."""
    found = []
    for share in SLEW_RATES:
        size = Unknown("share", 0.0, 0.1, low=0.0, high=1.5)
        low, high = math.log(0.1 * steepest), math.log(steepest)
        rate = Unknown("logarithm of the slew rate", math.log(share * steepest), 0.05, low=low, high=high)
        delay = Unknown("delay", 0.0, 2e-5, low=0.0, high=LONGEST_DELAY, unit="s")
        found.append(Family(f"slew rate {share:g}", "slew rate", (SlewRateLimit("slew rate", (size, rate, delay)),)))
    return found


def _presliding() -> list[Family]:
    """Families of presliding friction, which has a memory: what gives most of the time is no law over the speed."""
    found = []
    for place, group in ((GUIDE, "guide"), (INDENTER, "indenter")):
        giving = [each for each in equations([place], []) if each.has_states]
        simplest = min(giving, key=lambda each: len(each.unknowns))
        strength = simplest.unknowns[0]._replace(value=LEAST_FRICTION)
        term = StrengthOnly(f"{simplest.name}, strength only", (strength,), simplest.effect, simplest.form, True)
        strength_above = max(start[0] for start in simplest.form.starts)
        found.append(Family(f"presliding {group}", group, (term,), starting_strength=strength_above))
    return found


WIDER = 0.5
"""Share of its range by which an axis is made longer at either end for equations, under which motions are others."""


def wider(axes: Axes) -> Axes:
    """Axes over more than motions visit, but for phases and counts."""
    low, high = np.array([axes.points(place)[[0, -1]] for place in range(PLACES)]).T
    for place in range(PLACES):
        if place in (WAVEFORM, COMPACTION):
            continue
        more = WIDER * (high[place] - low[place])
        low[place] -= more if low[place] < 0.0 or place in SPRINGS else 0.0
        high[place] += more
    return Axes.over(axes.scale, low, high)


def on_axes(structure: ModelStructure, axes: Axes) -> ModelStructure:
    """The same laws on other axes, straight beyond where they were known."""
    terms = []
    for term in structure.terms:
        if isinstance(term, Curve):
            x = axes.points(term.place)
            basis = np.array([interpolate(row, structure.axes, term.place, x) for row in term.basis])
            term = replace(term, basis=basis)
        terms.append(term)
    return replace(structure, terms=tuple(terms), axes=axes)


STRAIGHT = {
    LOADING: "loading_stiffness",
    UNLOADING: "unloading_stiffness",
    SPRING: "stiffness",
    SPRING_FROM_REST: "stiffness",
    DAMPER: "damping",
    DRIVE: "drive_gain",
}
"""Constants whose law is a straight one at the same place."""


FORCES = (
    frozenset((LOADING, UNLOADING, RATE_FACTOR, RATE_FORCE, COMPACTION)),
    frozenset((SPRING, SPRING_FROM_REST, DAMPER)),
    frozenset((WAVEFORM, DRIVE)),
)
"""Places whose laws are parts of one force: of the rock, of the coupling, of the drive."""


def same_force(family: Family, other: Family) -> bool:
    """Whether laws of both are parts of one force; one that depends on two arguments at once is no sum of such."""
    of = [{place for term in each.terms if (place := _place_of(term)) is not None} for each in (family, other)]
    return any(of[0] & force and of[1] & force for force in FORCES)


def _place_of(term: Term) -> int | None:
    if isinstance(term, Gain | SlewRateLimit):
        return DRIVE
    return term.place if isinstance(term, Curve) else None


def constant_beside(term: Term) -> str:
    """The constant that a free law can take up, and it the law; "" where there is none. Only both are measured."""
    if isinstance(term, Gain) and term.scalar == V.F_A:
        return STRAIGHT[DRIVE]
    return STRAIGHT.get(term.place, "") if isinstance(term, Curve) else ""


class Equivalent(NamedTuple):
    """Parameters of the same motion, what is straight in a law being the law's and not a constant's."""

    axes: Axes
    values: Floats
    """Of all parameters, constants as stated."""
    more: dict[int, Floats]
    """(GRID,) that tables get, by place."""


def reparametrise_to_nominal(structure: ModelStructure, values: Floats, places: Collection[int]) -> Equivalent:
    """The same with constants as stated that a law at one of the ``places`` can take up.

    The curved valley of constants that are far off, and of a law that makes up for them, is a long way for a fit.
    """
    constants, axes, values = structure.terms[0], structure.axes, values.copy()
    names = [each.name for each in constants.unknowns]
    scale, low, more = axes.scale.copy(), axes.low.copy(), {}
    for place in places:
        name = STRAIGHT.get(place, "")
        # play begins where the spring is at rest, which moves with its stiffness
        if not name or place == SPRING_FROM_REST or math.isinf(constants.unknowns[names.index(name)].std):
            continue
        i = names.index(name)
        stated, x = constants.unknowns[i].value, axes.points(place)
        ratio = float(values[i]) / stated
        if place in LOGARITHMS:
            more[place] = np.full(GRID, math.log(ratio))
        else:
            more[place] = (values[i] - stated) * x if place != DRIVE else x - x / ratio
        if place == LOADING:
            # the contact's coordinate is the force over the stiffness
            scale[list(LOGARITHMS)] *= ratio
        if place == DRIVE:
            scale[place] /= ratio
        if place == SPRING:
            # of a law without a level the same force is at another deflection; the axis is next to even
            low[place] += float(more[place].mean()) / stated / scale[place]
            more[place] = more[place] - more[place].mean()
        values[i] = stated
    return Equivalent(axes._replace(scale=scale, low=low), values, more)


def moved_to(term: Term, other: Term, values: Floats, more: Floats | float = 0.0) -> Floats:
    """Coefficients with which ``other`` has, as nearly as can be, the law of ``term`` with ``values`` and ``more``."""
    if isinstance(term, Gain) and isinstance(other, Gain):
        return np.array([term.at(each, values) for each in other.knots])
    if not isinstance(term, Curve) or not isinstance(other, Curve):
        return values
    columns = other.basis.T
    if term.place in (DAMPER, DRIVE, *SPRINGS):
        # of which the level is no part
        columns = np.column_stack([columns, np.ones(GRID)])
    found = np.linalg.lstsq(columns, values @ term.basis + more, rcond=None)[0]
    return np.asarray(found[: len(other.basis)], dtype=float)


def kinds_of_spring(curve: Curve, values: Floats, precision: Floats, x: Floats, stiffness: float) -> tuple[str, ...]:
    """What a spring's law is, the likeliest kind first.

    By the cubic that comes nearest to it where recordings say something of it. Where that takes most of the spring's
    tangent stiffness away, the force saturates; where it takes less, it may do so further on.

    Args:
        curve: The law of the spring.
        values: (m,) its coefficients.
        precision: (m, m) of these.
        x: (GRID,) m, the axis of the law.
        stiffness: N/m, what the law is added to.
    """
    largest = float(np.max(np.abs(x)))
    at = x / largest
    # a level is no part of the law
    columns = np.column_stack([curve.basis.T, np.ones(GRID)])
    shapes = np.linalg.lstsq(columns, np.column_stack([at, at**3]), rcond=None)[0][: values.size]
    straight, cubic = np.linalg.lstsq(shapes.T @ precision @ shapes, shapes.T @ precision @ values, rcond=None)[0]
    if cubic >= 0.0:
        return (HARDENING,)
    tangent = stiffness + (straight + 3.0 * cubic * np.array([np.min(np.abs(at)), 1.0]) ** 2) / largest
    return (SATURATING,) if tangent[1] < YIELDING * tangent[0] else (HARDENING, SATURATING)


def kind_of_contact(stiffness: Floats) -> str:
    """What a contact's law is, by the logarithm of its stiffness over that stated, (n,) over the force.

    A soft layer is softer at first, and ends in the rock's own stiffness. By means over sixths of the force: at its
    ends alone, a law is hardly seen.
    """
    first, *_, before, last = (float(each.mean()) for each in np.array_split(stiffness, 6))
    straight = abs(last - before) < STRAIGHT_END
    return SOFT_LAYER if straight and first < last and abs(last) < abs(first) else CURVED


def normalised(basis: Floats) -> Floats:
    """Functions (m, GRID) that span the same, orthogonal, of root mean square 1."""
    _, sizes, rows = np.linalg.svd(basis, full_matrices=False)
    return np.asarray(rows[sizes > 1e-6 * sizes[0]] * math.sqrt(GRID), dtype=float)


def smoothest_first(basis: Floats) -> Floats:
    """Functions (m, GRID) that span the same, orthogonal, and so are their second differences."""
    rows = np.linalg.svd(basis, full_matrices=False)[2][: len(basis)]
    bent = np.diff(rows, 2, axis=1)
    return np.asarray(np.linalg.eigh(bent @ bent.T)[1].T @ rows * math.sqrt(GRID), dtype=float)


def _residual_rms(columns: Floats, other: Floats) -> float:
    """Root mean square of what columns (GRID, m) do not say of another one (GRID,)."""
    return float(np.sqrt(np.mean((other - columns @ np.linalg.lstsq(columns, other, rcond=None)[0]) ** 2)))


def _through_zero(basis: Floats) -> Floats:
    """Functions that are 0 in the middle of the axis, orthogonal; one fewer where a constant is among them."""
    return normalised(basis - basis[:, [(GRID - 1) // 2]])
