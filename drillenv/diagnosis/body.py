"""A single body as blocks of the solver: mass * acceleration = force - law(position, velocity), rig ``one-body``.

Nothing is simulated. The loop is cut at the sensors: the measured motion goes into the law, and what the law makes of
it is held against the measured force or, where none is measured, against the measured acceleration. So neither a
controller nor an unstable motion matters, and the force that is predicted is linear in all but a few parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from drillenv.diagnosis.adapter import RecordingProblem
from drillenv.diagnosis.body_channels import Body
from drillenv.diagnosis.laws import Curve, Equation
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes, interpolate
from drillenv.diagnosis.terms import ModelStructure, Term
from drillenv.dynamics.constitutive.places import DRIVE, GUIDE, SPRING
from drillenv.dynamics.effects import REGISTRY

ORDER = 16
"""Of the autoregression at most."""
NUDGE = 1e-4
"""Of a parameter's unit, by which derivatives are taken."""
FLOOR = 0.01
"""Share of the noise's power that is taken to be white, whatever its spectrum."""
CACHED = 70
"""Terms whose columns are kept, of each recording."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Rows of a recording that are judged together: all of it, or a part where there are few recordings."""

    body: Body
    name: str
    keep: NDArray[np.bool_]
    """(n,) of the recording's rows."""
    mass: float
    """kg, that the left side is made with where no force is measured."""

    @property
    def measured(self) -> Floats:
        """(n,) N, the left side of the balance."""
        return self.body.force if self.body.force is not None else -self.mass * self.body.acceleration


def argument_of(body: Body, place: int) -> Floats:
    """(samples,) what a law at a place is over."""
    if place == SPRING:
        return body.smooth_position
    if place == DRIVE:
        assert body.smooth_force is not None
        return body.smooth_force
    return sliding(body) if place == GUIDE else body.smooth_velocity


def sliding(body: Body) -> Floats:
    """(samples,) m/s, 0 where the way that the body moves is not known."""
    return np.where(np.abs(body.smooth_velocity) < body.slow, 0.0, body.smooth_velocity)


Said = Callable[[Floats, Floats], dict[str, dict[str, Any]]]
"""From values of a term's parameters and their standard deviations to the library's parameters by symbol."""


@dataclass(frozen=True)
class BodyTerm(Term):
    """A term that says in words of its own what its parameters are in the library's equation."""

    says: Said | None = field(default=None, compare=False, kw_only=True)

    def stated(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """Parameters as the library's equation has them."""
        return super().stated(values, spread) if self.says is None else self.says(values, spread)


@dataclass(frozen=True)
class Forces(BodyTerm):
    """Forces that are linear in the parameters."""

    columns: Callable[[Body], Floats] = field(default=lambda body: np.zeros((0, body.velocity.size)), compare=False)
    """From a recording to (parameters, n) N for each unit of a parameter."""


@dataclass(frozen=True)
class ScaledLaw(Forces):
    """The forces of the law as it is stated, times its one parameter."""


@dataclass(frozen=True)
class Nonlinear(BodyTerm):
    """A force that is not linear in its parameters."""

    force: Callable[[Floats, Body], Floats] = field(default=lambda _, body: 0.0 * body.velocity, compare=False)
    """(n,) N from the parameters and a recording."""


class Autoregression(NamedTuple):
    """The noise of rows: each is a weighted sum of those before and something new."""

    weights: Floats
    """(order,)"""
    std: float
    """N, of what is new, at a power that all frequencies had."""
    share: float = 1.0
    """Of the frequencies that rows may have, those below the end of the channels' filter: so many rows in one are
    independent."""

    def whiten(self, rows: Floats) -> Floats:
        """Rows (..., n) as white noise of variance 1 below the filter's end; the first ones lack those before."""
        if not rows.size:
            # which the filter does not take
            return rows
        return np.asarray(lfilter(np.append(1.0, -self.weights) / self.std, [1.0], rows, axis=-1))

    def size(self) -> float:
        """N, root mean square of rows of this noise."""
        frequencies = np.linspace(0.0, math.pi * self.share, 513)
        turned = np.exp(-1j * np.outer(frequencies, np.arange(1, self.weights.size + 1)))
        return self.std * math.sqrt(self.share * float(np.mean(1.0 / np.abs(1.0 - turned @ self.weights) ** 2)))

    def judged(self, keep: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Of rows (n,) those that stand behind as many as the noise remembers."""
        run = np.convolve(~keep, np.ones(self.weights.size + 1))[: keep.size]
        run[: self.weights.size] += 1
        return run < 0.5


def autoregression(left: Sequence[Floats], keep: Sequence[NDArray[np.bool_]], share: float) -> Autoregression:
    """By least squares over all rows (n,) with what was left, its order by the criterion of Schwarz.

    Above the end of the channels' filter, at a ``share`` of the highest frequency of rows, there is next to nothing,
    and nothing is learned from that: the normal equations have white noise of a hundredth of the power besides.
    """
    rows = []
    for series, there in zip(left, keep, strict=True):
        whole = np.convolve(~there, np.ones(ORDER + 1))[: there.size] < 0.5
        whole[:ORDER] = False
        at = np.flatnonzero(whole)
        rows.append(series[at[:, None] - np.arange(ORDER + 1)])
    table = np.concatenate(rows)
    every = np.concatenate([series[there] for series, there in zip(left, keep, strict=True)])
    power, count = float(np.mean(every**2)), len(table)
    best = math.inf, np.zeros(0)
    products = table.T @ table / max(count, 1) + FLOOR * power * np.eye(ORDER + 1)
    for order in range(min(ORDER, count // 20) + 1):
        weights = np.linalg.solve(products[1 : order + 1, 1 : order + 1], products[1 : order + 1, 0])
        new = float(products[0, 0] - weights @ products[1 : order + 1, 0])
        criterion = 0.5 * count * math.log(new) + 0.5 * order * math.log(max(count, 1))
        if criterion < best[0]:
            best = criterion, np.asarray(weights, dtype=float)
    white = Autoregression(best[1], 1.0)
    powers, inside, squares, judged = 0.0, 0.0, 0.0, 0
    for series, there in zip(left, keep, strict=True):
        seen = white.judged(there)
        said = np.where(seen, white.whiten(series), 0.0)
        spectrum = np.abs(np.fft.rfft(said)) ** 2
        powers, inside = powers + spectrum.sum(), inside + spectrum[: max(round(share * spectrum.size), 1)].sum()
        squares, judged = squares + float(said @ said), judged + int(seen.sum())
    new = squares / judged
    within = new * inside / powers / share
    return white._replace(std=math.sqrt(within), share=new / within)


def columns_of(term: Term, body: Body, axes: Axes) -> Floats:
    """(parameters, n) N of a term that is linear in its parameters; those of the latest terms are kept."""
    kept = body.columns
    if id(term) in kept:
        kept.move_to_end(id(term))
        return kept[id(term)][1]
    if isinstance(term, Forces):
        made = term.columns(body)
    else:
        assert isinstance(term, Curve)
        x = argument_of(body, term.place)
        # of the drive, less force is needed where more arrives
        turn = -1.0 if term.place == DRIVE else 1.0
        made = np.array([turn * body.rows(interpolate(row, axes, term.place, x)) for row in term.basis])
    # with the term, or another could come to have its place in memory
    kept[id(term)] = term, made
    if len(kept) > CACHED:
        kept.popitem(last=False)
    return made


def equation_force(effect: str, p: tuple[float, ...], body: Body, stiffness: float) -> Floats:
    """(n,) N, by what an effect of the library makes the force larger that a motion needs."""
    act = REGISTRY[effect].on_body
    assert act is not None
    applied = body.smooth_force if body.smooth_force is not None else np.zeros_like(body.smooth_position)
    return -body.rows(act(body.smooth_position, sliding(body), applied, stiffness, p))


def equation_over(effect: str, p: tuple[float, ...], place: int, x: Floats, stiffness: float) -> Floats:
    """(n,) N, the force on a body by an effect of the library over the argument x (n,) of a place, all else being 0.

    Each of a motion that has gone on like that.
    """
    act = REGISTRY[effect].on_body
    assert act is not None
    one, none = x[:, None], np.zeros((x.size, 1))
    state = {SPRING: (one, none, none), DRIVE: (none, none, one)}.get(place, (none, one, none))
    return act(*state, stiffness, p)[:, 0]


@dataclass
class ForceBalance(RecordingProblem):
    """A stretch of a recording as a block of the solver. It has no unknowns of its own."""

    data: Stretch
    structure: ModelStructure
    slack: float
    noise: Autoregression

    def __post_init__(self) -> None:
        self.judged: np.ndarray = self.noise.judged(self.data.keep)

    @property
    def name(self) -> str:
        """Of the stretch."""
        return self.data.name

    @property
    def samples(self) -> int:
        """How many independent rows are judged."""
        return round(self.noise.share * int(self.judged.sum()))

    def stiffness(self, values: Floats) -> float:
        """N/m of the law's spring; 0 where it has none."""
        names = [each.name for each in self.structure.terms[0].unknowns]
        return float(values[names.index("stiffness")]) if "stiffness" in names else 0.0

    def of_term(self, term: Term, own: Floats, stiffness: float) -> Floats:
        """(n,) N of one term."""
        body = self.data.body
        if isinstance(term, Equation):
            return equation_force(term.effect, term.parameters(own), body, stiffness)
        if isinstance(term, Nonlinear):
            return term.force(own, body)
        return own @ columns_of(term, body, self.structure.axes)

    def predicted(self, values: Floats) -> Floats:
        """(n,) N, the right side of the balance."""
        stiffness = self.stiffness(values)
        pairs = zip(self.structure.terms, self.structure.split(values), strict=True)
        return sum((self.of_term(term, own, stiffness) for term, own in pairs), np.zeros(self.data.keep.size))

    def left(self, values: Floats) -> Floats:
        """(n,) N, measured less predicted."""
        return self.data.measured - self.predicted(values)

    def residual(self, values: Floats) -> Floats:
        """(judged,) the same as the noise model weighs it."""
        return self.noise.whiten(self.left(values))[self.judged]

    def derivatives(self, values: Floats) -> Floats:
        """(parameters, n) N, of what is predicted."""
        stiffness, first = self.stiffness(values), 0
        made = np.zeros((values.size, self.data.keep.size))
        names = [each.name for each in self.structure.terms[0].unknowns]
        for term, own in zip(self.structure.terms, self.structure.split(values), strict=True):
            if not isinstance(term, Equation | Nonlinear):
                made[first : first + own.size] = columns_of(term, self.data.body, self.structure.axes)
            else:
                for j, unknown in enumerate(term.unknowns):
                    step = NUDGE * unknown.scale
                    ahead, behind = own.copy(), own.copy()
                    ahead[j] += step
                    behind[j] -= step
                    change = self.of_term(term, ahead, stiffness) - self.of_term(term, behind, stiffness)
                    made[first + j] = change / (2.0 * step)
                if stiffness > 0.0 and isinstance(term, Equation):
                    step = NUDGE * stiffness
                    change = self.of_term(term, own, stiffness + step) - self.of_term(term, own, stiffness - step)
                    made[names.index("stiffness")] += change / (2.0 * step)
            first += own.size
        return made

    def jacobian(self, values: Floats) -> Floats:
        """(parameters, judged) of what is predicted, as the noise model weighs it."""
        return self.noise.whiten(self.derivatives(values))[:, self.judged]
