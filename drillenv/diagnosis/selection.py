"""Which families of missing physics the recordings call for: score tests, forward selection, backward elimination."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.drill import Hypothesis, Recorded, Term
from drillenv.diagnosis.fitting import CLOSE, WEIGHTS, Fitted, chained, fit_to, kept_of, noise_left, resized
from drillenv.diagnosis.laws import Family, families, moved_to
from drillenv.diagnosis.naming import LAW_ERROR, THOROUGH, Named, name_law
from drillenv.diagnosis.predict import STATES
from drillenv.diagnosis.sensing import sensor_families
from drillenv.diagnosis.solver import Floats, Limits, eliminated

FALSE_ALARMS = 0.002
"""Probability that a campaign where nothing is missing gives any family a gain that counts."""
CANDIDATES = 4
"""Families that are fitted side by side at each step."""
LONG = Limits(25, 0.5, 0.003)
NEAR = 0.15
"""Share of the best score test's gain from which a family is a candidate."""


class Score(NamedTuple):
    """What a family would gain, by the score test."""

    family: Family
    gain: float
    """In log-likelihood."""
    freedom: int
    p: float


def information(fitted: Fitted, terms: Sequence[Term], pool: Executor) -> tuple[Floats, Floats]:
    """Gradient and Hessian by the parameters of more terms, at their start, all that is fitted already eliminated."""
    hypothesis = Hypothesis(fitted.hypothesis.terms + tuple(terms), fitted.hypothesis.axes)
    known = fitted.fit.shared.size
    unknowns = hypothesis.unknowns
    shared = np.concatenate([fitted.fit.shared, [each.value / each.width for each in unknowns[known:]]])
    size = STATES if any(term.remembers for term in hypothesis.terms) else 4

    def quadratic(block: Recorded, own: Floats):
        kept = kept_of(own, block.windows)
        own = resized(own, block.windows, max(size, kept), kept, len(block.lines))
        return replace(block, hypothesis=hypothesis, least_size=size).quadratic(shared, own)

    reduced = [eliminated(each, 0.0) for each in pool.map(quadratic, fitted.blocks, fitted.fit.own)]
    gradient = np.sum([each[0] for each in reduced], axis=0)
    hessian = np.sum([each[1] for each in reduced], axis=0)
    weights = fitted.priors.weights(fitted.fit.shared)
    gradient[:known] += weights * (fitted.fit.shared - fitted.priors.centre)
    hessian[:known, :known] += np.diag(weights)
    solved = np.linalg.solve(hessian[:known, :known], np.column_stack([gradient[:known], hessian[:known, known:]]))
    return (
        gradient[known:] - hessian[known:, :known] @ solved[:, 0],
        hessian[known:, known:] - hessian[known:, :known] @ solved[:, 1:],
    )


def score_tests(fitted: Fitted, tried: Sequence[Family], pool: Executor, seed: int = 0) -> tuple[list[Score], float]:
    """Every family's score test, the largest gain first, and the p-value that the smallest must not exceed.

    That one is drawn by a parametric bootstrap of the smallest p-value of all families together (P. H. Westfall and
    S. S. Young, Resampling-Based Multiple Testing, Wiley, 1993, Section 2.3).
    """
    together = [each for each in tried if not each.remembers]
    batches = ([together] if together else []) + [[each] for each in tried if each.remembers]
    scores, smallest = [], np.ones(20000)
    rng = np.random.default_rng(seed)
    for batch in batches:
        terms = [term for each in batch for term in each.terms]
        gradient, hessian = information(fitted, terms, pool)
        scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
        gradient, hessian = gradient / scale, hessian / scale[:, None] / scale
        power, modes = np.linalg.eigh(hessian)
        drawn = (rng.standard_normal((smallest.size, power.size)) * np.sqrt(np.maximum(power, 0.0))) @ modes.T
        first = 0
        for each in batch:
            at = slice(first, first + each.size)
            first += each.size
            own, axes = np.linalg.eigh(hessian[at, at])
            kept = own > 1e-7
            turned = axes[:, kept] / np.sqrt(own[kept])
            freedom = int(kept.sum())
            gain = 0.5 * float(((gradient[at] @ turned) ** 2).sum())
            scores.append(Score(each, gain, freedom, float(chi2.sf(2.0 * gain, freedom))))
            chance = chi2.sf(((drawn[:, at] @ turned) ** 2).sum(axis=1), freedom)
            smallest = np.minimum(smallest, chance)
    return sorted(scores, key=lambda each: -each.gain), float(np.quantile(smallest, FALSE_ALARMS))


def refined(data, fitted: Fitted, family: Family, pool: Executor) -> Fitted:
    """The same family with a law of twice the resolution, its motions' ranges seen anew."""
    axes = fitted.hypothesis.axes
    frequencies = [block.scene.frequency for block in fitted.blocks]
    finer = next((each for each in families(axes, frequencies, 2) if each.name == family.name), family)
    if finer.size == family.size:
        return fitted
    terms, start = [], []
    for term, own in zip(fitted.hypothesis.terms, fitted.hypothesis.split(fitted.values), strict=True):
        other = next((each for each in finer.terms if each.name == term.name), term)
        moved = moved_to(term, other, own)
        terms.append(other)
        start.append(moved / np.array([each.width for each in other.unknowns]))
    hypothesis = Hypothesis(tuple(terms), axes)
    return fit_to(
        data, hypothesis, np.concatenate(start), fitted.fit.own, pool, (fitted.weight,), THOROUGH, fitted.noise
    )


@dataclass
class Step:
    """A family that was added."""

    family: Family
    gain: float
    freedom: int
    before: Fitted
    after: Fitted
    named: Named
    rivals: list[tuple[Family, Fitted]]


def with_family(fitted: Fitted, family: Family, data, pool: Executor, limits: Limits) -> Fitted:
    """The fit with one more family, from its start."""
    hypothesis = Hypothesis(fitted.hypothesis.terms + family.terms, fitted.hypothesis.axes)
    start = np.concatenate([fitted.fit.shared, [each.value / each.width for each in family.unknowns]])
    return fit_to(data, hypothesis, start, fitted.fit.own, pool, (fitted.weight,), limits, fitted.noise)


def candidates(fitted: Fitted, detail: int = 1) -> list[Family]:
    """Every family that a fit may be given, of the motion and of the sensors."""
    blocks = fitted.blocks
    moving = families(fitted.hypothesis.axes, [block.scene.frequency for block in blocks], detail)
    reading = sensor_families([block.scene.name for block in blocks], min(block.data.rate for block in blocks))
    return moving + reading


def forward(
    data: Sequence[Conditioned], fitted: Fitted, pool: Executor, say: Callable[[str], object] = lambda _: None,
    most: int = 4,
) -> tuple[Fitted, list[Step], list[Score]]:  # fmt: skip
    """Add families as long as one is called for."""
    steps: list[Step] = []
    explained = 0.0
    while True:
        tried = [each for each in candidates(fitted) if each.group not in {step.family.group for step in steps}]
        scores, level = score_tests(fitted, tried, pool)
        least = LAW_ERROR**2 * explained
        called = [each for each in scores if each.p < level and each.gain > max(least, 0.0)]
        best = ", ".join(f"{each.family.name} {each.gain:.1f}" for each in scores[:4])
        say(f"score tests: {best}; p below {level:.2g}, gain above {least:.1f}")
        if not called or len(steps) >= most:
            return fitted, steps, scores
        chosen: list[Score] = []
        for each in called:
            same = [other for other in chosen if other.family.group == each.family.group]
            if each.gain >= NEAR * called[0].gain and len(same) < 2 and len(chosen) < CANDIDATES:
                chosen.append(each)
        fits = []
        for each in chosen:
            fits.append((each, with_family(fitted, each.family, data, pool, Limits(6, 0.5, 0.02))))
            say(f"  {each.family.name}: gain {fitted.cost - fits[-1][1].cost:.1f} in {fits[-1][1].fit.steps}")
        fits.sort(key=lambda pair: pair[1].cost)
        best, found = fits[0]
        for rank in range(min(2, len(fits))):
            each, other = fits[rank]
            if rank > 0 and other.cost > found.cost + 0.5 * (fitted.cost - found.cost):
                break
            hypothesis = other.hypothesis
            again = fit_to(data, hypothesis, other.fit.shared, other.fit.own, pool, (other.weight,), LONG, fitted.noise)
            say(f"  {each.family.name}: gain {fitted.cost - again.cost:.1f}, chi-square {again.per_freedom:.4f}")
            fits[rank] = (each, again)
        fits.sort(key=lambda pair: pair[1].cost)
        best, found = fits[0]
        if fitted.cost - found.cost < 0.5 * chi2.isf(level, best.freedom):
            return fitted, steps, scores
        step = settled(data, fitted, best.family, found, best.freedom, pool, say)
        step.rivals = [(each.family, other) for each, other in fits[1:]]
        steps.append(step)
        explained = max(explained, step.gain)
        fitted = step.after


def settled(data, fitted: Fitted, family: Family, found: Fitted, freedom: int, pool: Executor, say) -> Step:
    """A family that was chosen, with its windows joined, its noise seen anew, and the equation that its law follows."""
    further = tuple(each for each in WEIGHTS if each < found.weight)
    if found.per_freedom < CLOSE and further:
        begun = chained(found.blocks, found.fit.shared, found.fit.own, pool)
        found = fit_to(data, found.hypothesis, found.fit.shared, begun, pool, further, THOROUGH, fitted.noise)
        say(f"  joined: chi2 {found.per_freedom:.4f} weight {found.weight:g} in {found.fit.steps}")
    gain = max(fitted.cost - found.cost, 1.0)
    named, other = name_law(data, found, family, gain, pool, say)
    if named.equation is None or other.cost > found.cost:
        finer = refined(data, found, family, pool)
        say(f"  refined: chi2 {finer.per_freedom:.4f} in {finer.fit.steps}")
        fewer = finer.fit.shared.size - other.fit.shared.size
        if named.equation is not None and not named.does_as_well(other.cost - finer.cost, gain, fewer):
            named.equation = None
        if named.equation is None:
            other = finer
    if other.per_freedom < CLOSE:
        other = fit_to(data, other.hypothesis, other.fit.shared, other.fit.own, pool, (other.weight,),
                       Limits(10, 0.5, 0.003), noise_left(other, pool))  # fmt: skip
    say(f"  {named.mechanism} {named.equation.name if named.equation else 'measured'}: chi2 {other.per_freedom:.4f}")
    return Step(family, gain, freedom, fitted, other, named, [])
