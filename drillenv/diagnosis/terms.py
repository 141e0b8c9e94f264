"""What a model is made of: terms with parameters, which add to the motion or to what sensors make of it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.diagnosis.equations import Around, acts_at, curve_at
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.dynamics.constitutive.places import COMPACTION, UNLOADING
from drillenv.dynamics.forms import Form
from drillenv.dynamics.hybrid.vector_field import F_B, KL, KU, LONGEST, K

if TYPE_CHECKING:
    from drillenv.diagnosis.adapter import Adapter
    from drillenv.diagnosis.engine import Column
    from drillenv.diagnosis.scope import Scope

RUNNING = 1.3
"""s for which a rig that "had been running" is taken to have run before a recording."""
REACH = 16
"""Samples that a filter of the logger looks ahead and back."""


def drilled_by(blow: float, kl: float, ku: float) -> float:
    """m by which the origin moves in an impact of so many N at most, by the paper's law of the rock.

    None where a fit that is far off has it unload more softly than it loads: it does not give back what was drilled.
    """
    return blow * max(1.0 / kl - 1.0 / ku, 0.0) if kl > 0.0 and ku > 0.0 else 0.0


class OperatingPoint(NamedTuple):
    """What a term is told of a recording."""

    name: str
    frequency: float
    """Hz."""
    amplitude: float
    """V, as measured."""
    pressure: float
    """bar, as stated."""
    rate: float
    fresh: bool
    blow: float = 0.0
    """N, mean peak of the force."""
    touching: NDArray[np.bool_] | None = None
    """(..., n) at which samples of a channel the rock pushes; all of them where None: no motion is known."""


SCALARS = LONGEST + 1
"""Those of the engine that effects set, and the phase of the drive."""
DRIVE_PHASE = SCALARS - 1
"""rad, by which the drive is ahead of the excitation."""


class Law(NamedTuple):
    """An equation of the library in a model."""

    effect: str
    form: Form
    parameters: tuple[float, ...]
    """All of the effect's, by their order."""
    axes: Axes


@dataclass
class Model:
    """What a motion follows, of one recording."""

    s: Floats = field(default_factory=lambda: np.zeros(SCALARS))
    """(SCALARS,) in the engine's order."""
    free: Floats = field(default_factory=lambda: np.zeros((PLACES, GRID)))
    """(PLACES, GRID) free laws on their axes."""
    laws: list[Law] = field(default_factory=list)
    turn: Floats = field(default_factory=lambda: np.zeros(3))
    sine: Floats = field(default_factory=lambda: np.zeros(3))
    cosine: Floats = field(default_factory=lambda: np.zeros(3))
    impacts: float = 0.0
    per_impact: float = 0.0
    """m, about what an impact drills."""
    _curves: dict[int, Floats] = field(init=False, repr=False, compare=False, default_factory=dict)

    def curve(self, place: int) -> Floats:
        """(GRID,) all laws at a place, on its axis; of the contact logarithms of factors over w."""
        if place not in self._curves:
            self._curves[place] = self._curve(place)
        return self._curves[place]

    def _curve(self, place: int) -> Floats:
        total = self.free[place].copy()
        around = Around(float(self.s[K]), float(self.s[KL]), float(self.s[KU]), self.per_impact)
        for law in self.laws:
            if place in acts_at(law.effect, law.form)[0]:
                curve = curve_at(law.effect, law.parameters, place, law.axes.points(place), around)
                if place == COMPACTION:  # factors on the stiffness, less 1
                    total = (1.0 + total) * (1.0 + curve) - 1.0
                else:
                    total += np.log(np.clip(curve, 1e-3, 1e3)) if place <= UNLOADING else curve
        return total

    def pushed(self, factor: float) -> Model:
        """The same with the cylinder's force times a factor, on which no curve depends."""
        s = self.s.copy()
        s[F_B] *= factor
        other = replace(self, s=s)
        other._curves = self._curves
        return other

    def bends(self, place: int) -> bool:
        """Whether any law acts at a place."""
        return bool(self.free[place].any()) or any(place in acts_at(e.effect, e.form)[0] for e in self.laws)


class Unknown(NamedTuple):
    """A shared parameter."""

    name: str
    value: float
    """Where it begins, and the centre of its prior."""
    scale: float
    """Its unit in the solver: about what it may change by."""
    std: float = math.inf
    """Of its prior."""
    low: float = -math.inf
    high: float = math.inf
    unit: str = "1"


def mean_amplitude(waves: Floats, spread: Floats) -> tuple[float, float]:
    """Root mean square amplitude of sines and cosines (n, 2) with these standard deviations, and its own."""
    size = float(np.sqrt(np.mean(np.sum(waves**2, axis=1))))
    return size, float(np.sqrt(np.mean(spread**2) / len(waves)))


@dataclass(frozen=True)
class Term:
    """A part of the model with parameters: the paper's constants, a law, a filter."""

    name: str
    unknowns: tuple[Unknown, ...]
    stage = 0
    """Sensors act in rising order of it."""
    has_states = False
    """Whether it has states of its own: of the mount, the air or bristles."""
    has_bed = False
    """Whether they are of a bed under the mount."""
    effect = ""
    """The mechanism of the library whose equation it is; none of a free law."""
    common = 1
    """How many of the parameters that :meth:`of_recording` returns all recordings have in common, the first ones."""

    @property
    def scales(self) -> Floats:
        """Units of the parameters in the solver."""
        return np.array([each.scale for each in self.unknowns])

    @property
    def neutral(self) -> Floats:
        """Values of its first parameters, which tell its strength, at which it says nothing; free laws begin there."""
        return np.array([each.value for each in self.unknowns])

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Add to the model of a recording."""

    def wave_columns(self, values: Floats, point: OperatingPoint) -> list[tuple[Column, dict[int, float]]]:
        """By what waves of the model change, and by which factor with each parameter of the term, by its place."""
        return []

    def of_recording(self, name: str, values: Floats) -> tuple[Term, Floats]:
        """The same for one recording, and its parameters; 0 where they are its own and it had no part in the fit."""
        return self, values

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """What sensors make of signals (..., 2, n), linearly."""
        return signals

    def derivatives(self, signals: Floats, point: OperatingPoint) -> Floats | None:
        """(parameters, 2, n) by what is read of signals (2, n) changes with each parameter, linear in all of them.

        None where it is not, or differences are as fast.
        """
        return None

    def add(self, values: Floats, point: OperatingPoint, n: int, first: int = 0) -> Floats | None:
        """(2, n) what sensors read too much whatever the motion, ``first`` being the first sample that is simulated."""
        return None

    def kernel(self, values: Floats, over: int) -> Floats | None:
        """Of a logger's filter, on a grid so many times as fine as the samples."""
        return None

    def stated(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """Parameters by symbol, as a report gives them, from values and standard deviations of all."""
        found = {}
        for unknown, value, std in zip(self.unknowns, values, spread, strict=True):
            # a fit may have gone round
            number = math.remainder(value, 2.0 * math.pi) if unknown.unit == "rad" else float(value)
            found[unknown.name] = {"value": number, "std": float(std), "unit": unknown.unit}
        return found

    def freed(self, name: str) -> Term:
        """The same with one parameter of which nothing is believed."""
        return replace(self, unknowns=tuple(e._replace(std=math.inf) if e.name == name else e for e in self.unknowns))

    def held(self, name: str) -> Term:
        """The same with one that is believed as stated."""
        return replace(self, unknowns=tuple(e._replace(std=e.scale) if e.name == name else e for e in self.unknowns))

    @property
    def partly_own(self) -> bool:
        """Whether some of its parameters are each recording's own, and others those of all recordings."""
        return type(self).of_recording is not Term.of_recording and self.common > 0

    @property
    def observes(self) -> bool:
        """Whether it acts on what is read."""
        if type(self).kernel is not Term.kernel:
            return True
        return type(self).observe is not Term.observe or type(self).add is not Term.add

    @property
    def moves(self) -> bool:
        """Whether it acts on the motion by numbers or curves."""
        return type(self).contribute is not Term.contribute


@dataclass(frozen=True)
class ModelStructure:
    """A model of a rig, with named terms."""

    terms: tuple[Term, ...]
    axes: Axes
    rig: Adapter
    scope: Scope | None = None
    """What families are searched; all where None."""

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The parameters of all terms, in their order."""
        return tuple(each for term in self.terms for each in term.unknowns)

    @cached_property
    def scales(self) -> Floats:
        """Their units in the solver."""
        return np.array([each.scale for each in self.unknowns])

    @cached_property
    def start(self) -> Floats:
        """Where the parameters begin, in the solver's units: the centres of their priors."""
        return np.array([each.value for each in self.unknowns]) / self.scales

    @cached_property
    def parts(self) -> list[slice]:
        """Where the parameters of each term are among all."""
        ends = list(accumulate((len(term.unknowns) for term in self.terms), initial=0))
        return [slice(first, after) for first, after in pairwise(ends)]

    def part(self, name: str) -> slice:
        """The same of the term of a name."""
        return next(part for term, part in zip(self.terms, self.parts, strict=True) if term.name == name)

    def current(self, terms: Iterable[Term]) -> tuple[Term, ...]:
        """Terms of the same names as these, as they are in this structure."""
        names = {each.name for each in terms}
        return tuple(each for each in self.terms if each.name in names)

    def split(self, values: Floats) -> list[Floats]:
        """Parameters of each term."""
        return [values[part] for part in self.parts]

    def model(self, values: Floats, point: OperatingPoint, only: Collection[str] | None = None) -> Model:
        """Of a recording, at parameters in their own units; beside constants, of terms of ``only`` these names."""
        # a rig that had been running is taken to have run for a little more than the second that it must
        impacts = 0.0 if point.fresh else RUNNING * point.frequency
        model = Model(impacts=impacts)
        for i, (term, own) in enumerate(zip(self.terms, self.split(values), strict=True)):
            if i == 0 or only is None or term.name in only:
                term.contribute(own, model, point, self.axes)
        model.per_impact = drilled_by(point.blow, model.s[KL], model.s[KU])
        return model

    @property
    def sensors_have_memory(self) -> bool:
        """Whether sensors remember for longer than the logger's filter."""
        return bool(self.signal_chain)

    def kernel(self, values: Floats, over: int) -> Floats | None:
        """Of the logger's filter."""
        for term, own in zip(self.terms, self.split(values), strict=True):
            made = term.kernel(own, over)
            if made is not None:
                return made
        return None

    def added(self, values: Floats, n: int, point: OperatingPoint, first: int = 0) -> Floats | float:
        """(2, n) what is read too much whatever the motion."""
        total: Floats | float = 0.0
        for term, own in zip(self.terms, self.split(values), strict=True):
            more = term.add(own, point, n, first)
            if more is not None:
                total = total + more
        return total

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """What is read of signals (..., 2, n)."""
        split = self.split(values)
        for i in self.signal_chain:
            signals = self.terms[i].observe(split[i], signals, point)
        return signals

    @property
    def signal_chain(self) -> list[int]:
        """Indices of the terms that signals pass through, in their order."""
        passed = [i for i, term in enumerate(self.terms) if type(term).observe is not Term.observe]
        return sorted(passed, key=lambda i: self.terms[i].stage)
