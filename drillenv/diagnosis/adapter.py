"""What a rig says of itself: how a recording is predicted, where laws may act, and what the library has there.

Fits, the selection of families and their naming know a rig by this alone. There are
:mod:`drillenv.diagnosis.drill_rig` and :mod:`drillenv.diagnosis.body_rig`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from drillenv.diagnosis.laws import Equivalent
from drillenv.diagnosis.solver import Floats, Quadratic, eliminated

if TYPE_CHECKING:
    from drillenv.diagnosis.fitting import Fitted
    from drillenv.diagnosis.laws import Family
    from drillenv.diagnosis.tables import Axes
    from drillenv.diagnosis.terms import ModelStructure, Term


class RecordingProblem:
    """A recording as a block of the solver: its negative log-likelihood under a model structure.

    As it stands, it has no unknowns of its own, and whitened residuals and their derivatives say all. One with states
    replaces what concerns them.
    """

    name: str
    structure: ModelStructure
    slack: float
    """By which continuity constraints are widened, where there are any."""
    noise: Any
    """The noise model by which residuals are weighed."""
    samples: int
    """How many numbers are judged."""
    power: float = 0.0
    """Sum of the squares of what sensors read about its mean, in variances of the noise; 0 where none is judged."""

    def residual(self, values: Floats) -> Floats:
        """(n,) measured less predicted in standard deviations of the noise, from parameters in their units."""
        raise NotImplementedError

    def jacobian(self, values: Floats) -> Floats:
        """(parameters, n) of what is predicted, likewise."""
        raise NotImplementedError

    def free_unknowns(self, own: Floats) -> int:
        """How many of its own unknowns the samples alone have to tell."""
        return own.size

    def cost(self, shared: Floats, own: Floats) -> float:
        """Negative log-likelihood; infinite where there is none."""
        return 0.5 * float(np.sum(self.residual(shared * self.structure.scales) ** 2))

    def quadratic(self, shared: Floats, own: Floats) -> Quadratic:
        """The same with its derivatives."""
        scales, none = self.structure.scales, np.zeros(0)
        residual, by = self.residual(shared * scales), self.jacobian(shared * scales) * scales[:, None]
        cross = np.zeros((0, shared.size))
        return Quadratic(
            0.5 * float(residual @ residual), none, -by @ residual, np.zeros((0, 0)), cross, by @ by.T, none
        )

    def reduced_under(
        self, shared: Floats, own: Floats, structures: Iterable[ModelStructure]
    ) -> list[tuple[Floats, Floats]]:
        """Gradient (n,) and Hessian (n, n) by the parameters under each of some structures, own unknowns at their best.

        The structures have more terms behind the recording's own, at their start.
        """
        found = []
        for structure in structures:
            start = structure.start[shared.size :]
            widened, begun = self.under(structure, own)
            found.append(eliminated(widened.quadratic(np.append(shared, start), begun), 0.0)[:2])
        return found

    def try_step(self, shared: Floats, own: Floats, move: Floats, before: float) -> tuple[float, Floats]:
        """Cost and own unknowns after their step, which the block may shorten; ``before`` is the cost before it."""
        return self.cost(shared, own), own

    def inner_steps(self, shared: Floats, tried: tuple[float, Floats], before: float) -> tuple[float, Floats]:
        """Cost and own unknowns after such a step, with steps of their own where it made the recording worse."""
        return tried

    def under(
        self, structure: ModelStructure, own: Floats, slack: float | None = None, noise: Any = None
    ) -> tuple[Self, Floats]:
        """The same under another model structure, slack and noise, and its own unknowns in their layout.

        Slack and noise are as they are where None.
        """
        slack, noise = self.slack if slack is None else slack, self.noise if noise is None else noise
        return replace(self, structure=structure, slack=slack, noise=noise), own  # type: ignore[type-var]

    def estimate_states(self, shared: Floats, own: Floats, steps: int = 15) -> Floats:
        """Own unknowns after steps of their own."""
        return own

    def reinitialise_outliers(self, shared: Floats, own: Floats, outlying: bool) -> Floats:
        """Own unknowns, those that stand out begun anew; ``outlying`` where the recording does among the fit's."""
        return own

    def rollout(self, shared: Floats, own: Floats) -> Floats:
        """Own unknowns with which windows go on from each other."""
        return own


class Rival(NamedTuple):
    """An equation that could stand for a family's law."""

    equation: Term
    starts: list[tuple[Floats, Floats]]
    """Constants and parameters with which it begins, in the solver's units, the best first."""
    worse: float
    """By how much it is worse than the law from the best of them, in log-likelihood, by the quadratic about the law."""


class Adapter:
    """A rig. What it does not say of itself: its noise is known, its model linear, and there is no library for it."""

    def axes_at(self, fitted: Fitted) -> Axes:
        """Axes over the ranges that the recordings visit."""
        raise NotImplementedError

    def laws(self, fitted: Fitted, axes: Axes, detail: int) -> list[Family]:
        """Families with free laws on these axes, of ``detail`` times as many intervals."""
        raise NotImplementedError

    def noise_left(self, fitted: Fitted) -> list[Any]:
        """The noise of each recording as a fit's residuals show it."""
        return fitted.noise

    def reparametrise_to_nominal(
        self, structure: ModelStructure, values: Floats, places: Collection[int]
    ) -> Equivalent:
        """The same with constants as stated that a law at one of the places can take up, where they hold up a fit."""
        return Equivalent(structure.axes, values, {})

    def candidates(self, fitted: Fitted) -> list[Family]:
        """Every family that a fit may be given, but for constants that are not as stated."""
        return self.laws(fitted, fitted.structure.axes, 1)

    def at_own_frequency(self, fitted: Fitted, there: Collection[str]) -> list[Family]:
        """Families with a frequency of their own, at their best one, of mechanisms that are not ``there`` yet."""
        return []

    def same_force(self, family: Family, other: Family) -> bool:
        """Whether two families' laws are of one force over different arguments, so that one may correct the other."""
        return False

    def contains(self, family: Family, other: Family) -> bool:
        """Whether a family's free law is more general than another's of the same readings, and that a part of it."""
        return False

    def rivals(self, fitted: Fitted, family: Family) -> list[Rival]:
        """The library's equations that could stand for a family's law, the nearest first."""
        return []

    def taken_up(self, equation: Term) -> list[str]:
        """Constants that can take up what is straight in an equation's law."""
        return []

    def mechanisms_of(self, family: Family) -> Collection[str]:
        """The library's mechanisms that a family may turn out to be."""
        return {family.mechanism}

    def mechanisms_by_law(self, fitted: Fitted, family: Family, nearest: str) -> tuple[str, ...]:
        """The mechanism of a law that no equation follows, the likeliest first; ``nearest`` explains most of it."""
        return (nearest or family.mechanism,)
