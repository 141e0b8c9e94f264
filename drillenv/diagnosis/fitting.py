"""Fits of a model structure to recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from drillenv.diagnosis.solver import Fit, Floats, Limits, Priors, eliminated, minimise, side_by_side
from drillenv.diagnosis.terms import ModelStructure, Term
from drillenv.diagnosis.thresholds import CLOSE, RESOLVED

RELAXED, TIGHT = 1e4, 1.0
"""Of the continuity constraints' standard deviations: windows nearly free, and windows that go on from each other to
within the integrator's error."""
TIGHTENING = (1000.0, 100.0, 10.0, TIGHT)
"""From one to the other in smaller steps."""
CONVERGED = Limits(40, 0.5, 0.003)
"""Until a step gains next to nothing of what is left: far off, fits creep along curved valleys, and say little
of a model where they are ended for their number of steps."""
SHORT = Limits(20, 0.5, 0.02)
"""By which families, and equations in the place of a law, are compared before those that come near are followed to
their ends."""
LOOSE = Limits(20, 0.5, 0.1)
"""The same where another has left nothing: what explains as much goes there in long steps."""
ROUNDS = 3
"""Times, at most, that what stands out is begun anew: beside what was found others may stand out."""
OUTLYING = 4.0
"""Of the other recordings' cost a sample, that of one whose states are suspect."""
RETRY_CHANGE = 0.1
"""Relative change of a block's cost from which a reinitialisation that has failed is tried again."""
SETTLING = 6
"""Steps of own unknowns alone before a fit that begins elsewhere."""


@dataclass
class Fitted:
    """A model structure fitted to recordings."""

    structure: ModelStructure
    blocks: list[Any]
    """Recordings as the rig's adapter makes them: :class:`~drillenv.diagnosis.adapter.RecordingProblem`."""
    fit: Fit
    pool: Executor | None = None
    """Where recordings are evaluated side by side."""
    failed: Sequence[Attempt | None] = ()
    """Of each recording the last reinitialisation, where it failed."""

    def each(self, evaluate: Callable[..., Any], *more: Iterable[Any]) -> list[Any]:
        """What a function says of each recording and its own unknowns, and of what more there is of each."""
        return list(side_by_side(self.pool)(evaluate, self.blocks, self.fit.own, *more))

    def refit(
        self,
        structure: ModelStructure | None = None,
        start: Floats | None = None,
        limits: Limits = CONVERGED,
        *,
        own: Sequence[Floats] | None = None,
        slack: float | None = None,
        noise: Sequence[Any] | None = None,
        states_first: bool = False,
    ) -> Fitted:
        """A fit to the same recordings, by :func:`fit_to`; what is not given is as it is in this one."""
        structure, start = structure or self.structure, self.fit.shared if start is None else start
        failed, own = (self.failed, self.fit.own) if own is None else ((), own)
        return fit_to(self.blocks, own, structure, start, self.pool, limits, slack, noise, states_first, failed)

    @property
    def values(self) -> Floats:
        """Of the parameters, in their units."""
        return self.fit.shared * self.structure.scales

    @property
    def priors(self) -> Priors:
        """Of the parameters, in the solver's units, as heavy as the model's over-dispersion makes them."""
        return self.fit.priors

    @property
    def cost(self) -> float:
        """Negative log-likelihood with the priors."""
        return self.fit.cost

    @property
    def noise(self) -> list[Any]:
        """Of each recording."""
        return [each.noise for each in self.blocks]

    @property
    def slack(self) -> float:
        """Of the continuity constraints."""
        return self.blocks[0].slack

    @property
    def samples(self) -> int:
        """How many numbers are fitted."""
        return sum(each.samples for each in self.blocks)

    @cached_property
    def resolved(self) -> float:
        """Log-likelihood that what changes the readings by the least that sensors resolve gains."""
        return 0.5 * RESOLVED**2 * sum(each.power for each in self.blocks)

    @property
    def residual_dof(self) -> int:
        """Samples less parameters and own unknowns, but for those that continuity ties to others."""
        own = sum(block.free_unknowns(own) for block, own in zip(self.blocks, self.fit.own, strict=True))
        return self.samples - own - self.fit.shared.size

    @property
    def reduced_chi_square(self) -> float:
        """Reduced chi-square."""
        return 2.0 * self.cost / self.residual_dof

    @cached_property
    def covariance(self) -> Floats:
        """(k, k) of the parameters in the solver's units, with which they are stated.

        With over-dispersion, and standard deviations no smaller than recordings differ by: those of the sandwich,
        clustered by recordings (H. White, Econometrica 50 (1982) 1-25).
        """
        found = self.fit.covariance
        if not self.fit.parts:
            # of a motion that could not be followed nothing is known
            return found
        moved = np.array([eliminated(part, 0.0)[0] for part in self.fit.parts]) @ found
        count = len(moved)
        clustered = np.sum(moved**2, axis=0) * count / max(count - 1, 1)
        over = np.maximum(clustered / np.maximum(np.diag(found), 1e-300), max(1.0, self.reduced_chi_square))
        return found * np.sqrt(np.outer(over, over))

    def values_of(self, name: str) -> Floats:
        """Parameters of a term."""
        return self.values[self.structure.part(name)]

    def indices_of(self, terms: Sequence[Term]) -> list[int]:
        """Places of the terms' parameters among all."""
        parts = [self.structure.part(term.name) for term in terms]
        return [i for part in parts for i in range(part.start, part.stop)]

    def precision_of(self, term: Term) -> Floats:
        """(m, m) of the parameters of a term, in their units."""
        inside = self.indices_of([term])
        scales = self.structure.scales[inside]
        inverse = np.linalg.pinv(self.covariance[np.ix_(inside, inside)], hermitian=True)
        return np.asarray(inverse / np.outer(scales, scales), dtype=float)

    def correlations(self, count: int) -> dict[str, Any]:
        """Correlation matrix of the first ``count`` parameters, with their names."""
        covariance = self.fit.covariance[:count, :count]
        scale = np.sqrt(np.diag(covariance))
        names = [each.name for each in self.structure.unknowns[:count]]
        return {"of": names, "matrix": np.round(covariance / np.outer(scale, scale), 3).tolist()}


def penalty(dof: int, fitted: Fitted) -> float:
    """Log-likelihood that parameters have to gain (G. Schwarz, Annals of Statistics 6 (1978) 461-464)."""
    return 0.5 * dof * float(np.log(fitted.samples))


def priors_of(structure: ModelStructure) -> Priors:
    """Priors and bounds of a structure's parameters, in the solver's units."""
    unknowns = structure.unknowns
    scales = structure.scales
    return Priors(
        structure.start,
        scales / np.array([each.std for each in unknowns]),
        np.array([each.low for each in unknowns]) / scales,
        np.array([each.high for each in unknowns]) / scales,
    )


def fit_to(
    blocks: Sequence[Any],
    own: Sequence[Floats],
    structure: ModelStructure,
    start: Floats | None,
    pool: Executor | None,
    limits: Limits = CONVERGED,
    slack: float | None = None,
    noise: Sequence[Any] | None = None,
    states_first: bool = False,
    failed: Sequence[Attempt | None] = (),
) -> Fitted:
    """Fit a model structure.

    Args:
        blocks: Recordings, under whatever structure they have been so far, at least one.
        own: The own unknowns of each, with which it begins.
        structure: To be fitted.
        start: Shared parameters in the solver's units; None for the priors' centres.
        pool: Where recordings are evaluated side by side.
        limits: When to end.
        slack: Of the continuity constraints; as it is where None.
        noise: Of each recording; as it is where None.
        states_first: Whether own unknowns are fitted alone before: where the start is of another kind than the model
            they were fitted with.
        failed: Of each recording the last reinitialisation, where it failed; none where empty.
    """
    priors = priors_of(structure)
    shared = priors.centre.copy() if start is None else start
    levels = [None] * len(blocks) if noise is None else noise
    pairs = [block.under(structure, one, slack, level) for block, one, level in zip(blocks, own, levels, strict=True)]
    blocks, own = [block for block, _ in pairs], [one for _, one in pairs]
    samples = sum(each.samples for each in blocks)
    if states_first:
        own = list(side_by_side(pool)(lambda block, x: block.estimate_states(shared, x, SETTLING), blocks, own))
    fit = minimise(blocks, shared, own, priors, limits, pool, samples)
    if fit.begun - fit.cost < limits.gain(fit.begun, samples):
        # what stands out did so before
        return Fitted(structure, blocks, fit, pool, failed)
    failed = failed or [None] * len(blocks)
    for _ in range(ROUNDS):
        own, failed = reinitialise_outliers(blocks, fit, failed, pool)
        if None not in failed:
            break
        fit = minimise(blocks, fit.shared, own, priors, limits, pool, samples)
    return Fitted(structure, blocks, fit, pool, failed)


def tighten_continuity(found: Fitted, limits: Limits = CONVERGED, noise: Sequence[Any] | None = None) -> Fitted:
    """A fit whose windows are nearly free, with windows that go on from each other as closely as the model can.

    At once, or else in small steps, of which the last is kept at which the model still comes close.
    """
    if found.slack <= TIGHT or found.reduced_chi_square > CLOSE:
        return found
    begun = found.each(lambda block, own: block.rollout(found.fit.shared, own))
    at_once = found.refit(limits=limits, own=begun, slack=TIGHT, noise=noise)
    if at_once.reduced_chi_square < CLOSE:
        return at_once
    for slack in [each for each in TIGHTENING if each < found.slack]:
        further = found.refit(limits=limits, slack=slack, noise=noise)
        if further.reduced_chi_square > CLOSE:
            break
        found = further
    return found


def with_continuity_relaxed(
    fitted: Fitted, structure: ModelStructure, start: Floats, states_first: bool = False
) -> Fitted:
    """A short fit of a structure with continuity relaxed for a while, then tightened; arguments as of :func:`fit_to`.

    A fit of tight continuity may creep along a curved valley where one of free windows goes straight.
    """
    return tighten_continuity(fitted.refit(structure, start, SHORT, slack=RELAXED, states_first=states_first), SHORT)


class Attempt(NamedTuple):
    """A reinitialisation of a block's states."""

    outlying: bool
    """Whether the whole block stood out among the others."""
    cost: float
    """Of the block before it."""

    def repeats(self, other: Attempt | None) -> bool:
        """Whether it would only repeat another one."""
        if other is None or self.outlying != other.outlying:
            return False
        return abs(self.cost - other.cost) < RETRY_CHANGE * other.cost


def reinitialise_outliers(
    blocks: Sequence[Any], fit: Fit, failed: Sequence[Attempt | None], pool: Executor | None
) -> tuple[list[Floats], list[Attempt | None]]:
    """Own unknowns of each block, windows and recordings that stand out reinitialised; and the attempts that failed.

    Of a block whose own unknowns have changed there is None.
    """
    sizes = [block.samples for block in blocks]
    usual = float(np.median(np.divide(fit.costs, sizes)))
    tried = [Attempt(cost > OUTLYING * usual * size, cost) for cost, size in zip(fit.costs, sizes, strict=True)]

    def begun(block: Any, own: Floats, attempt: Attempt, before: Attempt | None) -> Floats:
        return own if attempt.repeats(before) else block.reinitialise_outliers(fit.shared, own, attempt.outlying)

    found = list(side_by_side(pool)(begun, blocks, fit.own, tried, failed))
    same = [one is other for one, other in zip(found, fit.own, strict=True)]
    return found, [attempt if one else None for attempt, one in zip(tried, same, strict=True)]
