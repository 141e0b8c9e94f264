"""What a rig says of itself: how a recording is predicted, where laws may act, and what the library has there.

Fits, the selection of families and their naming know a rig by this alone. There are
:mod:`drillenv.diagnosis.drill_rig` and :mod:`drillenv.diagnosis.body_rig`.
"""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np

from drillenv.diagnosis.solver import Block, Floats, Quadratic

if TYPE_CHECKING:
    from drillenv.diagnosis.fitting import Fitted
    from drillenv.diagnosis.laws import Equivalent, Family
    from drillenv.diagnosis.tables import Axes
    from drillenv.diagnosis.terms import ModelStructure, Term


class RecordingProblem(Block, Protocol):
    """A recording as a block of the solver: its negative log-likelihood under a model structure."""

    structure: ModelStructure
    weight: float
    """By which continuity constraints are widened, where there are any."""
    noise: Any
    """The noise model by which residuals are weighed."""

    @property
    def name(self) -> str:
        """Of the recording."""
        ...

    @property
    def samples(self) -> int:
        """How many numbers are judged."""
        ...

    @property
    def power(self) -> float:
        """Sum of the squares of what sensors read about its mean, in variances of the noise; 0 where none is judged."""
        ...

    def under(self, structure: ModelStructure, own: Floats) -> tuple[RecordingProblem, Floats]:
        """The same under a model structure with more terms, and its own unknowns in that layout."""
        ...

    def estimate_states(self, shared: Floats, own: Floats, steps: int = 15) -> Floats:
        """Own unknowns after steps of their own."""
        ...

    def reinitialise_outliers(self, shared: Floats, own: Floats, outlying: bool) -> Floats:
        """Own unknowns, those that stand out begun anew; ``outlying`` where the recording does among the fit's."""
        ...

    def rollout(self, shared: Floats, own: Floats) -> Floats:
        """Own unknowns with which windows go on from each other."""
        ...


class Regression:
    """A recording without unknowns of its own: whitened residuals and their derivatives say all."""

    structure: ModelStructure

    def residual(self, values: Floats) -> Floats:
        """(n,) measured less predicted in standard deviations of the noise, from parameters in their units."""
        raise NotImplementedError

    def jacobian(self, values: Floats) -> Floats:
        """(parameters, n) of what is predicted, likewise."""
        raise NotImplementedError

    @property
    def widths(self) -> Floats:
        """(parameters,) units of the solver."""
        return np.array([each.width for each in self.structure.unknowns])

    def cost(self, shared: Floats, own: Floats) -> float:
        """Negative log-likelihood."""
        return 0.5 * float(np.sum(self.residual(shared * self.widths) ** 2))

    def quadratic(self, shared: Floats, own: Floats) -> Quadratic:
        """The same with its derivatives."""
        values, none = shared * self.widths, np.zeros(0)
        residual, by = self.residual(values), self.jacobian(values) * self.widths[:, None]
        cross = np.zeros((0, shared.size))
        return Quadratic(
            0.5 * float(residual @ residual), none, -by @ residual, np.zeros((0, 0)), cross, by @ by.T, none
        )

    def try_step(self, shared: Floats, own: Floats, move: Floats, before: float) -> tuple[float, Floats]:
        """The cost after a step."""
        return self.cost(shared, own), own

    def under(self, structure: ModelStructure, own: Floats) -> tuple[Self, Floats]:
        """The same under another structure."""
        return replace(self, structure=structure), own  # type: ignore[type-var]

    def estimate_states(self, shared: Floats, own: Floats, steps: int = 15) -> Floats:
        """There is nothing to settle."""
        return own

    def reinitialise_outliers(self, shared: Floats, own: Floats, outlying: bool) -> Floats:
        """There is nothing to begin anew."""
        return own

    def rollout(self, shared: Floats, own: Floats) -> Floats:
        """There is nothing to chain."""
        return own


class Rival(NamedTuple):
    """An equation that could stand for a family's law."""

    equation: Term
    starts: list[tuple[Floats, Floats]]
    """Constants and parameters with which it begins, in the solver's units, the best first."""
    worse: float
    """By how much it is worse than the law from the best of them, in log-likelihood, by the quadratic about the law."""


class Adapter(Protocol):
    """A rig."""

    def block(self, data: Any, structure: ModelStructure, weight: float, noise: Any) -> RecordingProblem:
        """A recording under a model structure."""
        ...

    def first_noise(self, data: Any) -> Any:
        """A recording's noise as conditioning has found it."""
        ...

    def own_for(self, own: Floats, data: Any, structure: ModelStructure, noise: Any) -> Floats:
        """Own unknowns of a recording, fitted under another structure or noise, in the layout of these."""
        ...

    def noise_left(self, fitted: Fitted, pool: Executor | None) -> list[Any]:
        """The noise of each recording as a fit's residuals show it."""
        ...

    def axes_at(self, fitted: Fitted, pool: Executor) -> Axes:
        """Axes over the ranges that the recordings visit."""
        ...

    def reparametrise_to_nominal(
        self, structure: ModelStructure, values: Floats, places: Collection[int]
    ) -> Equivalent:
        """The same with constants as stated that a law at one of the places can take up."""
        ...

    def laws(self, fitted: Fitted, axes: Axes, detail: int) -> list[Family]:
        """Families with free laws on these axes, of ``detail`` times as many intervals."""
        ...

    def candidates(self, fitted: Fitted) -> list[Family]:
        """Every family that a fit may be given, but for constants that are not as stated."""
        ...

    def at_own_frequency(self, fitted: Fitted, there: Collection[str], pool: Executor) -> list[Family]:
        """Families with a frequency of their own, at their best one, of mechanisms that are not ``there`` yet."""
        ...

    def rivals(self, fitted: Fitted, family: Family) -> list[Rival]:
        """The library's equations that could stand for a family's law, the nearest first."""
        ...

    def taken_up(self, equation: Term) -> list[str]:
        """Constants that can take up what is straight in an equation's law."""
        ...

    def mechanisms_of(self, family: Family) -> Collection[str]:
        """The library's mechanisms that a family may turn out to be."""
        ...

    def mechanisms_by_law(self, fitted: Fitted, family: Family, nearest: str) -> tuple[str, ...]:
        """The mechanism of a law that no equation follows, the likeliest first; ``nearest`` explains most of it."""
        ...
