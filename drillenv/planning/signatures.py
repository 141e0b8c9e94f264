"""What each effect of the library changes in a recording, as terms of a model that lacks it.

An effect at parameters of a typical strength is one column: what the channels change by, from none of it to all of it,
as straight lines. Its laws are curves at the places where they act, its numbers those of a mount, of the air or of a
vibration, and what a sensor misreads is the difference of two readings. All come from what the effect states of itself,
so that one that is added to the library is planned for as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drillenv.diagnosis.engine import Column
from drillenv.diagnosis.equations import Around, acts_at, curve_at, has_states, scalars_of
from drillenv.diagnosis.laws import DRIVE_LAG, NUMBERS, Curve, Equation
from drillenv.diagnosis.sinusoids import INDENTER, SHAKER, STIFFNESS
from drillenv.diagnosis.sinusoids import Channel as Wave
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes
from drillenv.diagnosis.terms import Model, OperatingPoint, Term, Unknown
from drillenv.dynamics.constitutive.places import UNLOADING
from drillenv.dynamics.effects import REGISTRY, Channels, Chosen, Effect, Parameter
from drillenv.dynamics.forms import Form
from drillenv.dynamics.hybrid import vector_field as V

DRAWS = 3
"""Sets of typical parameters of an effect: the middles of their ranges, and others drawn at random."""
FACTORS = ("mount_gain", "air_stiffness")
"""Numbers that a strength multiplies; others of the same effect are as they are, such as a natural frequency."""
USUAL_FREQUENCY = 85.0
"""Hz, at which a drive that lags is weighed."""
SEEN = 0.02
"""Share of an effect's size that goes with a parameter that says how strong it is."""
FAR = 10.0
"""A neutral value so many times as large as a typical one is infinity, from which an effect grows as the inverse."""

LEAST, MOST = 1e-4, 1e3
"""Of the way from neutral to typical parameters, between which a strength is looked for."""


class Signature(NamedTuple):
    """An effect at one set of parameters of a typical strength."""

    effect: str
    parameters: tuple[float, ...]
    """All of the effect's, by their order."""
    terms: tuple[Term, ...]
    """With one parameter each, the same for all: the strength, 1 at these parameters."""


@dataclass(frozen=True)
class Amount(Term):
    """Numbers of the model that an effect sets, in a proportion; see ``places.SCALARS``."""

    numbers: tuple[tuple[str, float], ...] = ()
    has_states: bool = False

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Add the numbers that are neither waves nor grips, which other parts of a model take."""
        for name, number in self.numbers:
            if name == DRIVE_LAG:
                model.s[V.F_A] *= 1.0 - values[0] * lost_by_lag(number, point.frequency)
            elif name in NUMBERS:
                model.s[NUMBERS[name]] += number * (values[0] if name in FACTORS else 1.0)

    def wave_columns(self, values: Floats, point: OperatingPoint) -> list[tuple[Column, dict[int, float]]]:
        """Sine and cosine of what goes on at a frequency of its own."""
        found = []
        for wave, size, turn, phase in waves_of(dict(self.numbers)):
            for code, share in ((0, math.cos(phase)), (1, math.sin(phase))):
                found.append((Column(wave.kind, code, turn), {0: size * share}))
        return found


def lost_by_lag(lag: float, frequency: float) -> float:
    """Share of its force that a drive of first order loses at a frequency in Hz; ``lag`` in s."""
    return 1.0 - 1.0 / math.hypot(1.0, lag * frequency)


def waves_of(numbers: Mapping[str, float]) -> list[tuple[Wave, float, float, float]]:
    """Channel, amplitude, rad/s and phase at the start of the sines that an effect's numbers make."""
    turn, phase = numbers.get("vibration_rate", 0.0), numbers.get("vibration_phase", 0.0)
    turn2 = turn + numbers.get("vibration_detuning", 0.0)
    phase2 = phase + numbers.get("vibration_lead", 0.0)
    # a cosine of the angle is a sine a quarter of a turn ahead
    turn3, phase3 = numbers.get("rotation_rate", 0.0), numbers.get("rotation_phase", 0.0) + 0.5 * math.pi
    every = (
        (SHAKER, numbers.get("shaker_vibration", 0.0), turn, phase),
        (INDENTER, numbers.get("indenter_vibration", 0.0), turn2, phase2),
        (STIFFNESS, numbers.get("rotation_share", 0.0), turn3, phase3),
    )
    return [each for each in every if each[1] != 0.0]


@dataclass(frozen=True)
class Misreading(Term):
    """What sensors read otherwise because of an effect, in a proportion."""

    effect: str = ""
    parameters: tuple[float, ...] = ()
    stage: int = 0

    def observe(self, values: Floats, signals: Floats, point: OperatingPoint) -> Floats:
        """Signals (2, n) with the strength's share of the difference."""
        if values[0] == 0.0:
            return signals
        there = np.flatnonzero(np.any(signals != 0.0, axis=0))
        inside = slice(int(there[0]), int(there[-1]) + 1)
        changed = signals.copy()
        changed[:, inside] += values[0] * misread(self.effect, self.parameters, signals[:, inside], point)
        return changed


def misread(effect: str, parameters: tuple[float, ...], signals: Floats, point: OperatingPoint) -> Floats:
    """(2, n) by what an effect of the sensors changes force in N and acceleration in m/s^2."""
    measure = REGISTRY[effect].measure
    assert measure is not None
    turned = 2.0 * math.pi * point.frequency * np.arange(signals.shape[1]) / point.rate
    true = Channels(
        point.rate,
        0.0,
        point.amplitude * np.sin(turned),
        signals[0],
        signals[1],
        point.fresh,
    )
    read = measure(true, true, parameters)
    return np.stack([read.force, read.acceleration]) - signals


def planned_for(effect: Effect) -> bool:
    """Whether an effect is one of the drilling rig that states laws, numbers or a reading."""
    return bool(effect.laws) or effect.scalars is not None or effect.measure is not None


def signatures(effect: Effect, axes: Axes, around: Around, rng: np.random.Generator) -> list[Signature]:
    """An effect at typical strengths, the middle of its ranges first.

    Args:
        effect: One that is ``planned_for``.
        axes: Over what motions visit, on which laws are curves.
        around: The rig that laws act in.
        rng: For the other parameters, each even in its typical range.
    """
    middle = typical_middle(effect)
    drawn = [tuple(float(rng.uniform(*each.typical)) for each in effect.parameters) for _ in range(DRAWS - 1)]
    if has_states(effect.name, middle):
        # one set of states is in a model at a time
        drawn = []
    made = [Signature(effect.name, p, _terms(effect, p, axes, around, i)) for i, p in enumerate((middle, *drawn))]
    return [each for each in made if each.terms]


def _terms(effect: Effect, p: tuple[float, ...], axes: Axes, around: Around, i: int) -> tuple[Term, ...]:
    """The terms of one set of parameters."""
    name = f"{effect.name} {i}"

    def strength(part: str) -> tuple[Unknown, ...]:
        return (Unknown(f"{name} {part}", 0.0, 1.0),)

    if effect.measure is not None:
        return (Misreading(name, strength("reading"), effect.name, p, effect.stage),)
    terms: list[Term] = []
    for place, curve in curves(effect, p, axes, around).items():
        terms.append(Curve(f"{name} at {place}", strength(str(place)), place, curve[None]))
    numbers = tuple(scalars_of(effect.name, p).items())
    if any(each in NUMBERS or each == DRIVE_LAG for each, _ in numbers) or waves_of(dict(numbers)):
        terms.append(Amount(f"{name} numbers", strength("numbers"), numbers, has_states(effect.name, p)))
    return tuple(terms)


def curves(effect: Effect, p: tuple[float, ...], axes: Axes, around: Around) -> dict[int, Floats]:
    """(GRID,) by place, what the effect adds there, of the contact the logarithm of a factor."""
    found = {}
    for place in sorted(acts_at(effect.name, stated_form(effect, typical_middle(effect)))[0]):
        curve = curve_at(effect.name, p, place, axes.points(place), around)
        found[place] = np.log(np.clip(curve, 1e-3, 1e3)) if place <= UNLOADING else curve
    return found


def typical_middle(effect: Effect) -> tuple[float, ...]:
    """The middle of what is typical of each parameter."""
    return tuple(0.5 * (each.typical[0] + each.typical[1]) for each in effect.parameters)


def stated_form(effect: Effect, p: tuple[float, ...]) -> Form:
    """All parameters of an effect as one form, from these."""
    return Form("stated", tuple(each.symbol for each in effect.parameters), (p,))


@dataclass(frozen=True)
class Stated(Equation):
    """An effect that a model has already, with parameters that are known."""

    stated: tuple[float, ...] = ()

    def parameters(self, values: Floats) -> tuple[float, ...]:
        """As stated."""
        return self.stated


def stated_term(chosen: Chosen) -> Stated:
    """An effect of a model that follows an equation."""
    effect, p = chosen.effect, chosen.values
    states = has_states(effect.name, p)
    return Stated(f"stated {effect.name}", (), effect.name, stated_form(effect, p), states, p)


# --- From a share of the typical strength to parameters


def parameters_at(signature: Signature, share: float, size: Callable[[tuple[float, ...]], float]) -> dict[str, float]:
    """The parameters that say how strong an effect is, by symbol, at a share of a signature's strength.

    Args:
        signature: The typical strength.
        share: Of it, above 0.
        size: How much the effect changes at parameters, in any unit.

    Returns:
        Empty where the least of it is more than this share, as of a filter that takes off the mean at any corner.
    """
    effect = REGISTRY[signature.effect]
    strong = strengths(signature, size)
    whole = size(signature.parameters)

    def at(part: float) -> tuple[float, ...]:
        pairs = zip(effect.parameters, signature.parameters, strict=True)
        return tuple(_between(each, value, part) if i in strong else value for i, (each, value) in enumerate(pairs))

    # by factors of two to either side, then by halves: at next to nothing a sensor's filter is none any more
    high = share
    while size(at(high)) < share * whole and high < MOST:
        high *= 2.0
    low = 0.5 * high
    while size(at(low)) > share * whole and low > LEAST:
        low *= 0.5
    if low <= LEAST:
        return {}
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if size(at(middle)) < share * whole else (low, middle)
    found = at(high)
    return {effect.parameters[i].symbol: found[i] for i in strong}


def strengths(signature: Signature, size: Callable[[tuple[float, ...]], float]) -> list[int]:
    """Which parameters say how strong an effect is: those without which there is none, or else less of it."""
    effect, whole = REGISTRY[signature.effect], size(signature.parameters)
    without = []
    for i, each in enumerate(effect.parameters):
        p = list(signature.parameters)
        p[i] = each.neutral
        without.append(size(tuple(p)) / whole)
    alone = [i for i, left in enumerate(without) if left < SEEN]
    return alone[:1] or [i for i, left in enumerate(without) if left < 1.0 - SEEN]


def _between(parameter: Parameter, typical: float, part: float) -> float:
    """From the neutral value at 0 to the typical one at 1."""
    neutral = parameter.neutral
    if abs(neutral) > FAR * abs(typical) > 0.0:
        value = 1.0 / (1.0 / neutral + part * (1.0 / typical - 1.0 / neutral))
    else:
        value = neutral + part * (typical - neutral)
    return min(max(value, parameter.low), parameter.high)


def weight_of(place: int, curve: Floats, axes: Axes) -> float:
    """Mean square of a curve (GRID,); of the contact, of the depth in m that it adds at the same force."""
    if place <= UNLOADING:
        curve = np.cumsum(axes.stretch(place) * np.expm1(-curve))
    return float(np.mean(curve**2))


def size_of(effect: Effect, axes: Axes, around: Around, signals: Floats, point: OperatingPoint) -> Callable[..., float]:
    """How much an effect changes at parameters: its curves, its numbers, or a reading of signals (2, n)."""

    def size(p: tuple[float, ...]) -> float:
        if effect.measure is not None:
            changed = misread(effect.name, p, signals, point)
            return float(np.sqrt(np.sum(changed**2 / signals.var(axis=1, keepdims=True))))
        squares = [weight_of(place, each, axes) for place, each in curves(effect, p, axes, around).items()]
        numbers = scalars_of(effect.name, p)
        squares += [wave[1] ** 2 for wave in waves_of(numbers)]
        squares += [lost_by_lag(numbers[DRIVE_LAG], USUAL_FREQUENCY) ** 2] if DRIVE_LAG in numbers else []
        # a mount gives by its gain over its square, whatever the mass that it has
        squares += [(numbers["mount_gain"] / numbers["mount_square"]) ** 2] if "mount_gain" in numbers else []
        squares += [numbers["air_stiffness"] ** 2] if "air_stiffness" in numbers else []
        return math.sqrt(sum(squares))

    return size
