"""Which families of missing physics the recordings call for: score tests, forward selection, backward elimination."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from drillenv.diagnosis.adapter import RecordingProblem
from drillenv.diagnosis.fitting import CONVERGED, JOINED, SHORT, Fitted, fit_to, joined, with_windows_freed
from drillenv.diagnosis.laws import Curve, Equivalent, Family, Gain, moved_to, on_axes
from drillenv.diagnosis.naming import Named, name_law, named_by_law, with_more, without
from drillenv.diagnosis.solver import Floats, Limits, eliminated
from drillenv.diagnosis.terms import ModelStructure, Term
from drillenv.diagnosis.thresholds import (
    CLOSE,
    FAINT,
    FALSE_ALARMS,
    LAW_LEFT,
    LEFT,
    NEAR,
    POSSIBLE,
    UNCONFIRMED,
)

CANDIDATES = 3
"""Families that are fitted side by side at each step."""
MOST = 4
"""Families, at most."""
DETAILS = (2, 4, 8)
"""Resolutions of a free law that are tried."""
PROMISED = 0.5
"""Share of the best score test's gain that its short fit has to reach, or else its windows are freed."""


class Score(NamedTuple):
    """What a family would gain, by the score test."""

    family: Family
    gain: float
    """In log-likelihood."""
    freedom: int
    p: float
    cross_validated: float
    """The gain on recordings that are left out: see :meth:`Information.cross_validated_gain`."""

    @property
    def size(self) -> int:
        """Parameters that it adds; of one with states of its own only the strength shows where that is 0."""
        return self.family.size if self.family.has_states else self.freedom

    @property
    def confirmed(self) -> bool:
        """Whether recordings that are left out gain too, or at least lose next to nothing.

        Parameters that each recording has of its own, and those that one recording alone tells, gain nothing elsewhere.
        """
        return self.cross_validated > -UNCONFIRMED * self.gain


class Information(NamedTuple):
    """The log-likelihood near a fit, by all that is fitted (k) and parameters of more terms, by recordings."""

    gradients: Floats
    """(recordings, parameters)."""
    hessians: Floats
    """(recordings, parameters, parameters)."""
    prior_gradient: Floats
    prior_precision: Floats
    known: int
    """k."""

    def reduced(self) -> tuple[Floats, Floats]:
        """Gradient and Hessian by the parameters of more terms, all that is fitted already at its best."""
        k = self.known
        gradient = self.gradients.sum(axis=0) + self.prior_gradient
        hessian = regular(self.hessians.sum(axis=0) + np.diag(self.prior_precision))
        solved = np.linalg.solve(hessian[:k, :k], np.column_stack([gradient[:k], hessian[:k, k:]]))
        return gradient[k:] - hessian[k:, :k] @ solved[:, 0], hessian[k:, k:] - hessian[k:, :k] @ solved[:, 1:]

    def cross_validated_gain(self, inside: NDArray[np.int64]) -> float:
        """Log-likelihood that some of the parameters gain on each recording where the others say their values.

        What is there gains on recordings that were left out; what only takes up misfit of another kind does not.
        The others' gradient is followed by the Hessian of all recordings: of a direction that the one left out alone
        says much of, the others say nothing that could be held against it.
        """
        total = 0.0
        with_them = np.concatenate([np.arange(self.known), inside])
        hessian = regular(self.hessians.sum(axis=0) + np.diag(self.prior_precision))
        for left_out in range(len(self.gradients)):
            rest = np.arange(len(self.gradients)) != left_out
            gradient = self.gradients[rest].sum(axis=0) + self.prior_gradient
            for at, sign in ((with_them, 1.0), (np.arange(self.known), -1.0)):
                step = -np.linalg.solve(hessian[np.ix_(at, at)], gradient[at])
                own = self.gradients[left_out][at], self.hessians[left_out][np.ix_(at, at)]
                total -= sign * float(own[0] @ step + 0.5 * step @ own[1] @ step)
        return total


def regular(hessian: Floats) -> Floats:
    """A Hessian that can be solved where recordings say nothing of a parameter."""
    own = np.diag(hessian)
    return hessian + np.diag(1e-10 * own + 1e-12 * own.max())


class ScoreTests(NamedTuple):
    """Score tests of every family."""

    scores: list[Score]
    """The largest gain first."""
    level: float
    """The p-value that the smallest must not exceed."""


def information(fitted: Fitted, terms: Sequence[Term], pool: Executor, constants: Sequence[int] = ()) -> Information:
    """By the parameters of more terms, at their start, all recordings' own unknowns eliminated.

    Behind these come constants of the paper's model once more, of which then nothing is believed.
    """
    structure = replace(fitted.structure, terms=fitted.structure.terms + tuple(terms))
    known = fitted.fit.shared.size
    unknowns = structure.unknowns
    shared = np.concatenate([fitted.fit.shared, [each.value / each.width for each in unknowns[known:]]])

    def quadratic(block: RecordingProblem, own: Floats):
        widened, begun = block.under(structure, own)
        return eliminated(widened.quadratic(shared, begun), 0.0)[:2]

    reduced = list(pool.map(quadratic, fitted.blocks, fitted.fit.own))
    weights = fitted.priors.weights
    more = np.array([(each.width / each.std) ** 2 for each in unknowns[known:]] + [0.0] * len(constants))
    each_once = np.append(np.arange(len(unknowns)), np.asarray(constants, dtype=int))
    return Information(
        np.array([each[0][each_once] for each in reduced]),
        np.array([each[1][np.ix_(each_once, each_once)] for each in reduced]),  # pyright: ignore[reportCallIssue]
        np.append(weights * (fitted.fit.shared - fitted.priors.centre), np.zeros(more.size)),
        np.append(weights, more),
        known,
    )


RARE = 0.05
"""Above this, p-values of the bootstrap are taken for 1."""


def score_tests(fitted: Fitted, tried: Sequence[Family], pool: Executor, seed: int = 0) -> ScoreTests:
    """Every family's score test.

    The p-value that the smallest must not exceed is drawn by a parametric bootstrap of the smallest p-value of all
    families together (P. H. Westfall and S. S. Young, Resampling-Based Multiple Testing, Wiley, 1993, Section 2.3).
    """
    names = [each.name for each in fitted.structure.terms[0].unknowns]
    together = sorted((each for each in tried if not each.has_states), key=lambda each: bool(each.constant))
    batches = ([together] if together else []) + [[each] for each in tried if each.has_states]
    scores, smallest = [], np.ones(20000)
    rng = np.random.default_rng(seed)
    for batch in batches:
        terms = [term for each in batch for term in each.terms]
        known = information(fitted, terms, pool, [names.index(each.constant) for each in batch if each.constant])
        gradient, hessian = known.reduced()
        scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
        gradient, hessian = gradient / scale, hessian / scale[:, None] / scale
        power, modes = np.linalg.eigh(hessian)
        drawn = (rng.standard_normal((smallest.size, power.size)) * np.sqrt(np.maximum(power, 0.0))) @ modes.T
        first = 0
        for each in batch:
            at = slice(first, first + each.size)
            inside = known.known + np.arange(at.start, at.stop)
            first += each.size
            own, axes = np.linalg.eigh(hessian[at, at])
            kept = own > 1e-7
            turned = axes[:, kept] / np.sqrt(own[kept])
            freedom = int(kept.sum())
            gain = 0.5 * float(((gradient[at] @ turned) ** 2).sum())
            cross_validated = known.cross_validated_gain(inside)
            p = min(each.look_elsewhere * float(chi2.sf(2.0 * gain, freedom)), 1.0)
            scores.append(Score(each, gain, freedom, p, cross_validated))
            sizes = ((drawn[:, at] @ turned) ** 2).sum(axis=1)
            # the quantile that is asked for is far below
            rare = sizes > chi2.isf(RARE, freedom)
            smallest[rare] = np.minimum(smallest[rare], chi2.sf(sizes[rare], freedom))
    return ScoreTests(sorted(scores, key=lambda each: -each.gain), float(np.quantile(smallest, FALSE_ALARMS)))


def best_frequency(fitted: Fitted, tried: Floats, term: Callable[[float], Term], pool: Executor) -> int:
    """Of frequencies (n,) that at which a term of its own has the largest score test's gain; ``term`` makes it."""
    terms = [term(float(each)) for each in tried]
    gradient, hessian = information(fitted, terms, pool).reduced()
    gains = []
    for i in range(tried.size):
        at = slice(i * len(terms[0].unknowns), (i + 1) * len(terms[0].unknowns))
        gains.append(0.5 * float(gradient[at] @ np.linalg.pinv(hessian[at, at], 1e-7, hermitian=True) @ gradient[at]))
    return int(np.argmax(gains))


def refined(data: Sequence[Any], fitted: Fitted, family: Family, pool: Executor) -> Fitted:
    """The same family over what motions visit now, of a higher resolution as long as that is seen."""
    if not any(isinstance(each, Curve | Gain) for each in family.terms):
        return fitted
    rig, axes, coarser = fitted.structure.rig, fitted.structure.axes, family.size - 1
    for detail in (1, *DETAILS):
        size = next(each.size for each in rig.laws(fitted, axes, detail) if each.name == family.name)
        if size <= coarser:
            # the law is as fine already
            continue
        coarser = size
        finer = with_detail(data, fitted, family, detail, pool)
        more = finer.fit.shared.size - fitted.fit.shared.size
        if finer.cost < fitted.cost - penalty(more, fitted):
            fitted = finer
        elif more > 0:
            break
    return smoothed(data, fitted, family, pool)


def smoothed(data: Sequence[Any], fitted: Fitted, family: Family, pool: Executor) -> Fitted:
    """The same with laws that are as smooth as makes their coefficients most likely.

    The roughness penalty of P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89-121, as a prior, whose
    scale has the largest marginal likelihood (S. N. Wood, Journal of the Royal Statistical Society B 73 (2011) 3-36)
    by the quadratic of the log-likelihood about the fit.
    """
    names, first, terms = {each.name for each in family.terms}, 0, []
    covariance = fitted.fit.covariance * max(1.0, fitted.per_freedom)
    for term in fitted.structure.terms:
        inside = slice(first, first + len(term.unknowns))
        first = inside.stop
        if isinstance(term, Curve) and term.name in names:
            stds = most_likely_prior(fitted.fit.shared[inside], covariance[inside, inside], term.roughness)
            unknowns = zip(term.unknowns, stds, strict=True)
            term = replace(term, unknowns=tuple(each._replace(std=each.width * std) for each, std in unknowns))
        terms.append(term)
    structure = replace(fitted.structure, terms=tuple(terms))
    start, own = fitted.fit.shared, fitted.fit.own
    return fit_to(data, structure, start, own, pool, fitted.weight, CONVERGED, fitted.noise)


def most_likely_prior(found: Floats, covariance: Floats, roughness: Floats) -> Floats:
    """Standard deviations (m,) of a law's coefficients, in inverse proportion to the root of their roughness.

    ``found`` (m,) are the coefficients as fitted, with their ``covariance`` (m, m).
    """
    shape = 1.0 / np.sqrt(np.maximum(roughness / roughness.max(), 1e-8))

    def surprise(scale: float) -> float:
        whole = covariance + np.diag((scale * shape) ** 2)
        factor = np.linalg.cholesky(whole)
        return float(np.log(np.diag(factor)).sum() + 0.5 * np.sum(np.linalg.solve(factor, found) ** 2))

    size = float(np.sqrt(np.mean(found**2))) + 1e-12
    return shape * min(size * np.geomspace(1e-4, 1e2, 61), key=surprise)


def with_detail(data: Sequence[Any], fitted: Fitted, family: Family, detail: int, pool: Executor) -> Fitted:
    """The same family over what motions visit now, of so many times the resolution.

    From constants as stated, what is straight in them being the law's, or where that does not lead back to as good a
    fit, from constants as they are.
    """
    rig = fitted.structure.rig
    known = on_axes(fitted.structure, rig.axes_at(fitted, pool))
    places = [each.place for each in family.terms if isinstance(each, Curve)]
    found = _on_finer(
        data, fitted, known, rig.reparametrise_to_nominal(known, fitted.values, places), family, detail, pool
    )
    if found.cost > fitted.cost:
        as_they_are = Equivalent(known.axes, fitted.values, {})
        found = min(
            found, _on_finer(data, fitted, known, as_they_are, family, detail, pool), key=lambda each: each.cost
        )
    return found


def _on_finer(
    data: Sequence[Any],
    fitted: Fitted,
    known: ModelStructure,
    same: Equivalent,
    family: Family,
    detail: int,
    pool: Executor,
) -> Fitted:
    """The fit of a family's law at a resolution, from parameters that are the ``same`` motion as a fit's."""
    finer = next(each for each in known.rig.laws(fitted, same.axes, detail) if each.name == family.name)
    terms, start = [], []
    for term, own in zip(known.terms, known.split(same.values), strict=True):
        other = next((each for each in finer.terms if each.name == term.name), term)
        more = same.more.get(term.place, 0.0) if isinstance(term, Curve) and other is not term else 0.0
        terms.append(other)
        start.append(moved_to(term, other, own, more) / np.array([each.width for each in other.unknowns]))
    structure, begun = replace(known, terms=tuple(terms), axes=same.axes), np.concatenate(start)
    return fit_to(data, structure, begun, fitted.fit.own, pool, fitted.weight, CONVERGED, fitted.noise, True)


@dataclass
class Step:
    """A family that was added."""

    family: Family
    gain: float
    freedom: int
    before: Fitted
    after: Fitted
    named: Named
    terms: tuple[Term, ...]
    """Those of its law in the fit."""
    rivals: list[tuple[Family, Fitted]]
    """Families that were fitted at the same step."""
    found: float = 0.0
    """Cost of the family's own fit at that step."""
    pending: bool = False
    """Whether the equations have not been tried yet."""
    beside: int = 0
    """Families that were there, itself included, when the equations were tried."""
    detail: int = 1
    """The resolution of its law that was tried last while the model was not close."""

    def gain_in(self, fitted: Fitted) -> float:
        """About the gain in as many samples as another fit has."""
        return self.gain * fitted.samples / self.before.samples


def with_family(fitted: Fitted, family: Family, data: Sequence[Any], pool: Executor, limits: Limits) -> Fitted:
    """The fit with one more family, from its start."""
    structure, start = with_more(fitted.structure, fitted.fit.shared, family)
    return fit_to(data, structure, start, fitted.fit.own, pool, fitted.weight, limits, fitted.noise)


def with_strength(fitted: Fitted, family: Family, data: Sequence[Any], pool: Executor, limits: Limits) -> Fitted:
    """The fit with one more family that has states, from none of it and from a standard deviation of its strength.

    With none of it, its frequency or time constant changes nothing (R. B. Davies, Biometrika 74 (1987) 33-43), and
    where a model is far off, what more of it would gain is no guide.
    """
    found = with_family(fitted, family, data, pool, limits)
    strength = family.unknowns[0]
    if not math.isfinite(strength.std):
        return found
    structure, start = with_more(fitted.structure, fitted.fit.shared, family)
    start[-family.size] += strength.std / strength.width
    strong = fit_to(data, structure, start, fitted.fit.own, pool, fitted.weight, limits, fitted.noise, True)
    return min(found, strong, key=lambda each: each.cost)


def candidates(fitted: Fitted) -> list[Family]:
    """Every family that a fit may be given, and constants that need not be as stated."""
    stated = [each.name for each in fitted.structure.terms[0].unknowns if math.isfinite(each.std)]
    wrong = [Family(f"another {name}", f"another {name}", (), constant=name) for name in stated]
    return fitted.structure.rig.candidates(fitted) + wrong


Say = Callable[[str], object]
Keep = Callable[[Fitted, list["Step"], ScoreTests], object]
"""Told a fit, the steps that it has taken, and the tests of what else there may be."""


def forward(
    data: Sequence[Any],
    fitted: Fitted,
    pool: Executor,
    say: Say = lambda _: None,
    before: Sequence[Step] = (),
    earlier: ScoreTests | None = None,
    keep: Keep = lambda *_: None,
    only: Collection[str] | None = None,
) -> tuple[Fitted, list[Step], ScoreTests]:
    """Add families as long as one is called for, then leave out those that the others make needless.

    ``before`` are steps that the fit has taken already. Of families that were tested ``earlier`` on a part of the same
    samples, only those are tested again that may yet be there, at the same level. ``keep`` is told what has been found
    each time that something has. Families of ``only`` these groups, where any are given.
    """
    steps = list(before)
    possible = None if earlier is None else {each.family.name for each in earlier.scores if each.p < POSSIBLE}
    dismissed = set() if earlier is None else {each.family.group for each in earlier.scores}
    left_out: set[str] = set()
    while True:
        # a model that has come close is to hold from window to window
        fitted = joined(data, fitted, pool, CONVERGED, fitted.noise)
        for i, step in enumerate(steps):
            if step.pending and fitted.per_freedom < CLOSE:
                steps[i] = identify_equation(data, fitted, step, pool, say)
                fitted = steps[i].after
        named = {step.family.group for step in steps if step.named.equation is not None}
        tried = [each for each in still_possible(fitted, steps, possible, pool, only) if each.name not in left_out]
        scores, level = score_tests(fitted, tried, pool)
        level = level if earlier is None else min(level, earlier.level)
        # a step may be changed further on, and a search may be interrupted there
        keep(fitted, [replace(each) for each in steps], ScoreTests(scores, level))
        needed = [least_gain(each, fitted, steps, scores, dismissed) for each in scores]
        say(f"score tests: {largest(scores, needed)}; p below {level:.2g}")
        chosen = shortlist(scores, level, needed, fitted)
        step = None
        if chosen and sum(not each.family.constant for each in steps) < MOST:
            step = best_step(data, fitted, chosen, level, pool, say, named)
        if step is not None:
            taken(steps, step)
            fitted = step.after
            continue
        other = with_laws_changed(data, fitted, steps, pool, say, earlier is None)
        if other is not None:
            fitted = other
            continue
        least = misfit_allowance(fitted, steps, scores, dismissed)
        fitted, kept = backward(data, fitted, steps, least, level, pool, say, found_here=earlier is None)
        if len(kept) == len(steps):
            return fitted, steps, ScoreTests(scores, level)
        # what is left out may have taken up a part of another family, beside all that was tested so far
        left_out |= {each.family.name for each in steps} - {each.family.name for each in kept}
        steps, possible = kept, None


def taken(steps: list[Step], step: Step) -> None:
    """Add a step, or where it corrects an equation that is there, its terms to that one's."""
    corrected = next((each for each in steps if each.family.group == step.family.group), None)
    if corrected is None:
        steps.append(step)
        step.beside = len(steps)
    else:
        corrected.terms, corrected.named.equation = (*corrected.terms, *step.terms), None


def largest(scores: Sequence[Score], needed: Sequence[float]) -> str:
    """The largest gains by the score test, on recordings left out, and the gains needed, for a person."""
    return ", ".join(
        f"{each.family.name} {each.gain:.1f} ({each.cross_validated:.1f}) of {least:.1f}"
        for each, least in zip(scores[:5], needed, strict=False)
    )


def with_laws_changed(
    data: Sequence[Any], fitted: Fitted, steps: list[Step], pool: Executor, say: Say, found_here: bool
) -> Fitted | None:
    """The fit with a law that was found drawn finer, in an equation's words, or exchanged for a rival's; or None.

    Rivals were fitted to the same samples only where the steps were ``found_here``.
    """
    finer = with_finer_law(data, fitted, steps, pool, say)
    if finer is not None:
        return finer
    other = with_equations(data, fitted, steps, pool, say)
    return exchanged(data, fitted, steps, pool, say) if other is None and found_here else other


def with_equations(data: Sequence[Any], fitted: Fitted, steps: list[Step], pool: Executor, say: Say) -> Fitted | None:
    """The fit with an equation in the place of a measured law, now that what was missing beside it is there; or None.

    Equations are not as supple as free laws: beside another mechanism that is missing even the true one does worse.
    """
    for i, step in enumerate(steps):
        names = {each.name for each in step.family.terms}
        measured = step.named.equation is None and names == {each.name for each in step.terms}
        if not measured or step.family.constant or step.beside == len(steps):
            continue
        step.beside = len(steps)
        as_it_is = tuple(each for each in fitted.structure.terms if each.name in names)
        named, other = name_law(data, fitted, replace(step.family, terms=as_it_is), step.gain, pool, say)
        if named.equation is not None:
            say(f"  {named.mechanism}, {named.equation.name}: chi-square {other.per_freedom:.4f}")
            steps[i] = replace(step, after=other, named=named, terms=(named.equation,))
            return other
    return None


def still_possible(
    fitted: Fitted,
    steps: Sequence[Step],
    possible: Collection[str] | None,
    pool: Executor,
    only: Collection[str] | None = None,
) -> list[Family]:
    """Families that are not there yet, of these names and of ``only`` these groups where any are given."""
    there = {step.family.group for step in steps}
    measured = {step.family.group for step in steps if step.named.equation is None}
    # of a mechanism that follows an equation, a free law may still correct it
    found = [
        each
        for each in candidates(fitted)
        if each.group not in measured and not (each.has_states and each.group in there)
        if possible is None or each.name in possible
        if only is None or each.group in only
    ]
    if only is None and fitted.per_freedom > 1.0 + LEFT:
        found += fitted.structure.rig.at_own_frequency(fitted, there, pool)
    scope, rig = fitted.structure.scope, fitted.structure.rig
    return found if scope is None else [each for each in found if scope.has(each, rig.mechanisms_of(each))]


def with_finer_law(
    data: Sequence[Any], fitted: Fitted, steps: Sequence[Step], pool: Executor, say: Say
) -> Fitted | None:
    """The fit with a finer law where none is called for but the model is not close: corners leave much, coarsely drawn.

    The law that explains most comes first; None where none gets finer and explains a part of what is left by that.
    """
    if fitted.per_freedom < CLOSE:
        return None
    left = LAW_LEFT * (fitted.cost - 0.5 * fitted.freedom)
    for step in sorted(steps, key=lambda each: -each.gain):
        curved = any(isinstance(each, Curve | Gain) for each in step.terms)
        if curved and step.named.equation is None and step.detail < DETAILS[-1] and step.terms == step.family.terms:
            step.detail *= 2
            finer = with_detail(data, fitted, step.family, step.detail, pool)
            more = penalty(finer.fit.shared.size - fitted.fit.shared.size, fitted)
            if finer.cost < fitted.cost - max(more, left):
                say(f"  a finer law of {step.named.mechanism}: chi-square {finer.per_freedom:.4f}")
                names = {each.name for each in step.terms}
                step.terms = tuple(each for each in finer.structure.terms if each.name in names)
                step.family = replace(step.family, terms=step.terms)
                return finer
    return None


def exchanged(data: Sequence[Any], fitted: Fitted, steps: Sequence[Step], pool: Executor, say: Say) -> Fitted | None:
    """The fit with one step's close rival in its place, where all others there it does better; the step is changed.

    What two families explain alike on their own, or by windows that are free, may tell them apart in the end. A law
    that follows an equation to the noise leaves nothing that a rival could do better.
    """
    for step in steps:
        if step.family.constant or (step.named.equation is not None and fitted.per_freedom < 1.0 + LEFT):
            continue
        close = [family for family, other in step.rivals if other.cost - step.found < LAW_LEFT * step.gain]
        step.rivals = [each for each in step.rivals if each[0] not in close]
        rest, begun = without(fitted, step.terms)
        for family in close:
            if any(each.family.group == family.group for each in steps):
                continue
            structure, start = with_more(rest, begun, family)
            other = fit_to(data, structure, start, fitted.fit.own, pool, fitted.weight, CONVERGED, fitted.noise)
            finer = refined(data, other, family, pool)
            say(f"  {family.name} for {step.named.mechanism}: log-likelihood {fitted.cost - finer.cost:+.1f}")
            if finer.cost > fitted.cost and criterion(finer, fitted) > criterion(fitted, fitted):
                continue
            fit = replace(fitted.fit, shared=begun, cost=other.cost + step.gain)
            base = replace(fitted, structure=rest, fit=fit)
            found = accept(data, base, family, other, family.size, pool, say, False)
            # an equation that it follows has fewer parameters than its free law
            if criterion(found.after, fitted) < criterion(fitted, fitted):
                step.family, step.freedom, step.named, step.terms = family, family.size, found.named, found.terms
                step.pending = found.pending
                return found.after
    return None


def criterion(other: Fitted, fitted: Fitted) -> float:
    """Negative log-likelihood with the penalty on parameters, of fits of the same samples as a given one."""
    return other.cost + penalty(other.fit.shared.size, fitted)


def penalty(freedom: int, fitted: Fitted) -> float:
    """Log-likelihood that parameters have to gain (G. Schwarz, Annals of Statistics 6 (1978) 461-464)."""
    return 0.5 * freedom * float(np.log(fitted.samples))


def least_gain(
    score: Score,
    fitted: Fitted,
    steps: Sequence[Step],
    scores: Sequence[Score],
    dismissed: Collection[str] = (),
) -> float:
    """Log-likelihood that a family has to gain beside chance: where a law that was found is not exact, that is not all.

    What corrects an equation has to gain more than the equation may leave in a model that comes close. ``dismissed`` as
    of :func:`misfit_allowance`.
    """
    least = penalty(score.freedom, fitted) if steps else 0.0
    others = [step for step in steps if step.family.group != score.family.group]
    own = [step.gain_in(fitted) for step in steps if step not in others and step.named.equation is not None]
    left = LAW_LEFT**2 * max(own, default=0.0) if fitted.per_freedom < CLOSE else 0.0
    return max(least, misfit_allowance(fitted, others, scores, dismissed), left, resolved_gain(score.family, fitted))


def resolved_gain(family: Family, fitted: Fitted) -> float:
    """Log-likelihood below which sensors do not resolve a mechanism; a constant is the lab's to state."""
    return 0.0 if family.constant else fitted.resolved


def misfit_allowance(
    fitted: Fitted, steps: Sequence[Step], scores: Sequence[Score], dismissed: Collection[str] = ()
) -> float:
    """Log-likelihood that errors of laws found so far may leave, a share of their gain.

    What an equation leaves is what a free correction of the same mechanism gains: another that gains less takes up a
    part of it. Where the corrections of its group were ``dismissed``, tested on a part of the samples and no more than
    chance, it leaves nothing. A free law says nothing of what it leaves, which is at most half of what is left: what
    explains more than that is no error of another law.
    """
    left = 0.5 * max(fitted.per_freedom - 1.0, 0.0) * fitted.samples

    def error(step: Step) -> float:
        if step.family.constant:
            return 0.0
        most = LAW_LEFT**2 * step.gain_in(fitted)
        if step.named.equation is None:
            return min(most, 0.5 * left)
        own = [each.gain for each in scores if each.family.group == step.family.group]
        return min(most, max(own, default=0.0 if step.family.group in dismissed else 0.5 * left))

    return max(map(error, steps), default=0.0)


def shortlist(scores: Sequence[Score], level: float, needed: Sequence[float], fitted: Fitted) -> list[Score]:
    """The families to fit: those whose gain is no chance and near to the best, two of one mechanism at most.

    What has states of its own resonates: its gain at zero strength says little of that at another, and nothing where
    the model is far off. So it is fitted at each frequency or time constant.
    """
    far = fitted.per_freedom > CLOSE
    pairs = zip(scores, needed, strict=True)
    called = [each for each, least in pairs if each.p < level and each.gain > least and each.confirmed]
    chosen: list[Score] = []
    for each in called:
        same = [other for other in chosen if other.family.group == each.family.group]
        if each.gain >= NEAR * called[0].gain and len(same) < 2 and len(chosen) < CANDIDATES:
            chosen.append(each)
    # a constant is the simplest, and a part of what free laws gain may be its own
    more = [each for each in called if each.family.constant and each not in chosen]
    chosen += [each for each in more if each.gain >= NEAR * called[0].gain][:CANDIDATES]
    for each in scores if called else []:
        resonant = each.family.has_states and each.p < level and (far or each.gain > FAINT * called[0].gain)
        if resonant and all(each.family.name != other.family.name for other in chosen):
            chosen.append(each)
    return chosen


def best_step(
    data: Sequence[Any],
    fitted: Fitted,
    chosen: Sequence[Score],
    level: float,
    pool: Executor,
    say: Say,
    named: Collection[str] = (),
) -> Step | None:
    """The family that explains most once fitted; None where that is no more than chance.

    One of the groups ``named`` corrects an equation and follows none itself.
    """
    resonant = [each for each in chosen if each.family.has_states]
    fits = refine_candidates(data, fitted, [each for each in chosen if not each.family.has_states], pool, say)
    if fits and explains_all(fits[0][1], fitted):
        # in a model that is nearly right, one that promises as much is its equal
        resonant = [each for each in resonant if each.gain >= NEAR * chosen[0].gain]
    if resonant:
        found = refine_candidates(data, fitted, resonant, pool, say, fits[0][1].cost if fits else None)
        fits += [(each, other) for each, other in found if strength_shows(each.family, other)]
        fits.sort(key=lambda pair: penalised(*pair, fitted))
    if not fits:
        return None
    best, found = fits[0]
    if fitted.cost - found.cost < max(0.5 * chi2.isf(level, best.size), resolved_gain(best.family, fitted)):
        return None
    step = accept(data, fitted, best.family, found, best.size, pool, say, best.family.group in named)
    step.rivals, step.found = [(each.family, other) for each, other in fits[1:]], found.cost
    return step


def strength_shows(family: Family, fitted: Fitted) -> bool:
    """Whether the strength of a family with states of its own, its first parameter, is told from none in a fit.

    Its states, which begin anywhere near rest, gain something even where it has no strength (a Wald test).
    """
    term = family.terms[0]
    i, strength = fitted.indices_of([term])[0], term.unknowns[0]
    off = fitted.fit.shared[i] - strength.value / strength.width
    return float(off**2) > float(chi2.isf(FALSE_ALARMS, 1)) * float(fitted.covariance[i, i])


def penalised(score: Score, other: Fitted, fitted: Fitted) -> float:
    """Negative log-likelihood of a family's fit with the penalty on its parameters."""
    return other.cost + penalty(score.size, fitted)


def explains_all(other: Fitted, fitted: Fitted) -> bool:
    """Whether a fit leaves next to nothing of what another left beyond the noise."""
    return other.per_freedom - 1.0 < LAW_LEFT * (fitted.per_freedom - 1.0)


def refine_candidates(
    data: Sequence[Any],
    fitted: Fitted,
    chosen: Sequence[Score],
    pool: Executor,
    say: Say,
    best: float | None = None,
) -> list[tuple[Score, Fitted]]:
    """Short fits of families, of which those near to the ``best`` cost so far are followed to their ends."""
    fits: list[tuple[Score, Fitted]] = []
    half = 0.5 * (fitted.cost + 0.5 * fitted.freedom)
    most_is_left = fitted.per_freedom > CLOSE and (best is None or best > half)
    for each in chosen:
        begun = with_strength if each.family.has_states and most_is_left else with_family
        fits.append((each, begun(fitted, each.family, data, pool, SHORT)))
        say(f"  {each.family.name}: gain {fitted.cost - fits[-1][1].cost:.1f}")
    if not fits:
        return fits
    first, found = fits[0]
    short = fitted.cost - found.cost < PROMISED * first.gain
    if fitted.weight == JOINED and not first.family.has_states and short:
        structure, start = with_more(fitted.structure, fitted.fit.shared, first.family)
        again = with_windows_freed(data, structure, start, fitted.fit.own, pool, fitted.noise)
        if again.weight == JOINED and again.cost < found.cost:
            say(f"  {first.family.name}, windows free at first: gain {fitted.cost - again.cost:.1f}")
            fits[0] = first, again
    fits.sort(key=lambda pair: penalised(*pair, fitted))
    for rank, (each, other) in enumerate(fits[:CANDIDATES]):
        # beside one that explains all, only what explains nearly as much is a rival
        near = LAW_LEFT if rank > 0 and explains_all(fits[0][1], fitted) else 0.5
        if best is not None and other.cost > best + near * (fitted.cost - best):
            break
        start = other.fit.shared
        again = fit_to(data, other.structure, start, other.fit.own, pool, other.weight, CONVERGED, fitted.noise)
        say(f"  {each.family.name}: gain {fitted.cost - again.cost:.1f}, chi-square {again.per_freedom:.4f}")
        fits[rank] = (each, again)
        best = again.cost if best is None else min(best, again.cost)
    fits.sort(key=lambda pair: penalised(*pair, fitted))
    return fits


def accept(
    data: Sequence[Any],
    fitted: Fitted,
    family: Family,
    found: Fitted,
    freedom: int,
    pool: Executor,
    say: Say,
    correction: bool,
) -> Step:
    """A family that was chosen, with its windows joined, and the equation that its law follows.

    Where none does, and something else is missing as well, they are tried again once the model is close.
    """
    loose = found.weight
    found = joined(data, found, pool, CONVERGED, fitted.noise)
    if found.weight < loose:
        say(f"  joined: chi-square {found.per_freedom:.4f}")
    named = Named(family, family.mechanism, None, [])
    gain = max(fitted.cost - found.cost, 1.0)
    pending = not (correction or family.constant)
    step = Step(family, gain, freedom, fitted, found, named, family.terms, [], pending=pending)
    return identify_equation(data, found, step, pool, say)


def identify_equation(data: Sequence[Any], fitted: Fitted, step: Step, pool: Executor, say: Say) -> Step:
    """A step with the equation that its law follows in a fit, or with as fine a law as the recordings call for."""
    family, gain, found = step.family, step.gain, fitted
    if step.pending:
        named, other = name_law(data, found, family, gain, pool, say)
    else:
        named, other = step.named, found
    if named.equation is None and found.per_freedom > CLOSE:
        return replace(step, named=named, after=found)
    terms: tuple[Term, ...] = family.terms if named.equation is None else (named.equation,)
    if family.terms and (named.equation is None or other.cost > found.cost):
        finer = refined(data, found, family, pool)
        fewer = finer.fit.shared.size - other.fit.shared.size
        if named.equation is None or not named.does_as_well(other.cost - finer.cost, gain, fewer, found.samples):
            terms = tuple(each for each in finer.structure.terms if each.name in {one.name for one in family.terms})
            measured, other = replace(named, equation=None), finer
            named = named_by_law(measured, finer, replace(family, terms=terms), gain)
    if named.nearest and named.equation is None and other.per_freedom > 1.0 + LEFT:
        both, joint = corrected_equation(data, named, other, family, pool)
        # priors that make a law smooth are a part of its cost, and none of what a correction gains
        if both.cost < min(other.cost, found.cost) - 0.5 * chi2.isf(FALSE_ALARMS, family.size):
            say(f"  with a free correction: chi-square {both.per_freedom:.4f}")
            named.equation, other, terms = None, both, joint
    close = other.per_freedom < CLOSE
    noise = other.structure.rig.noise_left(other, pool) if close else other.noise
    structure = on_axes(other.structure, other.structure.rig.axes_at(other, pool))
    other = fit_to(data, structure, other.fit.shared, other.fit.own, pool, other.weight, CONVERGED, noise)
    form = named.equation.name if named.equation else "fitted" if family.constant else "measured"
    say(f"  {named.mechanism}, {form}: chi-square {other.per_freedom:.4f}")
    return replace(step, after=other, named=named, terms=terms, pending=False)


def corrected_equation(
    data: Sequence[Any], named: Named, other: Fitted, family: Family, pool: Executor
) -> tuple[Fitted, tuple[Term, ...]]:
    """The nearest equation with a free law of the same family on top, which sharp corners leave less to do for."""
    assert named.nearest_fit is not None
    equation, start = named.nearest_fit
    rest, begun = without(other, family.terms)
    scaled = start / np.array([each.width for each in equation.unknowns])
    zeros = np.array([each.value / each.width for each in family.unknowns])
    structure = replace(rest, terms=(*rest.terms, equation, *family.terms))
    begun = np.concatenate([begun, scaled, zeros])
    both = fit_to(data, structure, begun, other.fit.own, pool, other.weight, CONVERGED, other.noise)
    return both, (equation, *family.terms)


def backward(
    data: Sequence[Any],
    fitted: Fitted,
    steps: list[Step],
    least: float,
    level: float,
    pool: Executor,
    say: Say,
    found_here: bool,
) -> tuple[Fitted, list[Step]]:
    """Leave out families that, with all others there, gain no more than chance at a ``level``, or than ``least``.

    The last one is left out as well where it was not ``found_here`` but on a part of these samples.
    """
    kept = list(steps)
    for step in sorted(steps, key=lambda each: each.gain):
        if found_here and len(kept) < 2:
            break
        rest, begun = without(fitted, step.terms, step.family.constant)
        other = fit_to(data, rest, begun, fitted.fit.own, pool, fitted.weight, CONVERGED, fitted.noise)
        by_chance = 0.5 * chi2.isf(level, step.freedom)
        needed = max(by_chance, least, penalty(step.freedom, fitted), resolved_gain(step.family, fitted))
        if other.cost - fitted.cost < needed:
            say(f"  without {step.named.mechanism}: log-likelihood lower by {other.cost - fitted.cost:.1f}")
            kept.remove(step)
            fitted = other
    return fitted, kept
