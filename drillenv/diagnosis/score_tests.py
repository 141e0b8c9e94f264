"""Score tests: what families of missing physics would gain, by the log-likelihood's derivatives about a fit without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from drillenv.diagnosis.adapter import RecordingProblem
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import Family
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import Term
from drillenv.diagnosis.thresholds import FALSE_ALARMS, UNCONFIRMED


class Score(NamedTuple):
    """What a family would gain, by the score test."""

    family: Family
    gain: float
    """In log-likelihood."""
    dof: int
    p: float
    cross_validated: float
    """The gain on recordings that are left out: see :meth:`Information.cross_validated_gain`."""
    strength: float = 0.0
    """By which the first parameter moves in a step of Newton's, in its unit, where the family has states."""

    @property
    def size(self) -> int:
        """Parameters that it adds; of one with states of its own only the strength shows where that is 0."""
        return self.family.size if self.family.has_states else self.dof

    @property
    def confirmed(self) -> bool:
        """Whether recordings that are left out gain too.

        Parameters that each recording has of its own, and those that one recording alone tells, gain nothing elsewhere:
        of these it is enough that others lose next to nothing. But what is beside a recording's own has to gain, or all
        of the gain may be that of its own.
        """
        return self.cross_validated > (UNCONFIRMED if self.family.partly_own else -UNCONFIRMED) * self.gain


@dataclass(frozen=True)
class Information:
    """The log-likelihood near a fit, by all that is fitted (k) and parameters of more terms, by recordings."""

    gradients: Floats
    """(recordings, parameters)."""
    hessians: Floats
    """(recordings, parameters, parameters)."""
    prior_gradient: Floats
    prior_precision: Floats
    known: int
    """k."""

    @cached_property
    def hessian(self) -> Floats:
        """(parameters, parameters) of all recordings and the prior."""
        return regular(self.hessians.sum(axis=0) + np.diag(self.prior_precision))

    def reduced(self) -> tuple[Floats, Floats]:
        """Gradient and Hessian by the parameters of more terms, all that is fitted already at its best."""
        k = self.known
        gradient = self.gradients.sum(axis=0) + self.prior_gradient
        hessian = self.hessian
        solved = np.linalg.solve(hessian[:k, :k], np.column_stack([gradient[:k], hessian[:k, k:]]))
        return gradient[k:] - hessian[k:, :k] @ solved[:, 0], hessian[k:, k:] - hessian[k:, :k] @ solved[:, 1:]

    def cross_validated_gain(self, inside: NDArray[np.int64]) -> float:
        """Log-likelihood that some of the parameters gain on each recording where the others say their values.

        What is there gains on recordings that were left out; what only takes up misfit of another kind does not.
        The others' gradient is followed by the Hessian of all recordings: of a direction that the one left out alone
        says much of, the others say nothing that could be held against it.
        """
        others = self.gradients.sum(axis=0) + self.prior_gradient - self.gradients

        def gain(at: NDArray[np.int64]) -> float:
            steps = -np.linalg.solve(self.hessian[at[:, None], at], others[:, at].T).T
            own = self.hessians[:, at[:, None], at]
            return -float(np.sum(self.gradients[:, at] * steps) + 0.5 * np.einsum("ri,rij,rj->", steps, own, steps))

        fitted = np.arange(self.known)
        return gain(np.concatenate([fitted, inside])) - gain(fitted)


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


class Batch(NamedTuple):
    """Terms that are tested with one Hessian."""

    terms: Sequence[Term]
    constants: Sequence[int] = ()
    """Which of the paper's constants are tested behind them: the same once more, of which then nothing is believed."""


def information(fitted: Fitted, batches: Sequence[Batch]) -> list[Information]:
    """By the parameters of each batch's terms, at their start, all recordings' own unknowns eliminated."""
    structure, known = fitted.structure, fitted.fit.shared.size
    structures = [replace(structure, terms=structure.terms + tuple(batch.terms)) for batch in batches]

    def reduced(block: RecordingProblem, own: Floats) -> list[tuple[Floats, Floats]]:
        return block.reduced_under(fitted.fit.shared, own, structures)

    found = []
    weights = fitted.priors.weights
    off = weights * (fitted.fit.shared - fitted.priors.centre)
    for batch, widened, of_each in zip(batches, structures, zip(*fitted.each(reduced), strict=True), strict=True):
        more = fitted.priors.dispersion * np.array([(each.scale / each.std) ** 2 for each in widened.unknowns[known:]])
        more = np.append(more, np.zeros(len(batch.constants)))
        at = np.append(np.arange(len(widened.unknowns)), np.asarray(batch.constants, dtype=int))
        found.append(
            Information(
                np.array([gradient[at] for gradient, _ in of_each]),
                np.array([hessian[at[:, None], at] for _, hessian in of_each]),
                np.append(off, np.zeros(more.size)),
                np.append(weights, more),
                known,
            )
        )
    return found


PEAKS = 2
"""Frequencies at most, or time constants, at which a family with states is tested."""


def at_peaks(tried: Sequence[Family], known: Sequence[Information]) -> list[tuple[Family, Information]]:
    """Families with states, of those of one mechanism at another frequency or time constant the ones that gain most.

    Of no strength, such a family does not depend on its frequency: what is tested is the largest of its gains over all
    frequencies (R. B. Davies, Biometrika 74 (1987) 33-43). Where one is the largest around, a fit may begin.
    """
    found = []
    for group in dict.fromkeys(each.group for each in tried):
        alike = [(each, own) for each, own in zip(tried, known, strict=True) if each.group == group]
        if len(alike) > PEAKS:
            gains = np.array([gains_of(own, each.terms)[0] for each, own in alike])
            around = np.pad(gains, 1, constant_values=-np.inf)
            tops = np.flatnonzero((gains >= around[:-2]) & (gains >= around[2:]))
            best = tops[np.argsort(-gains[tops])[:PEAKS]]
            alike = [(replace(alike[i][0], look_elsewhere=len(alike)), alike[i][1]) for i in best]
        found += alike
    return found


AT_ONCE = 25
"""Terms that are tested by one Hessian: with parameters of each recording, its size grows with both."""
RARE = 0.05
"""Above this, p-values of the bootstrap are taken for 1."""


def score_tests(fitted: Fitted, tried: Sequence[Family]) -> ScoreTests:
    """Every family's score test.

    The p-value that the smallest must not exceed is drawn by a parametric bootstrap of the smallest p-value of all
    families together (P. H. Westfall and S. S. Young, Resampling-Based Multiple Testing, Wiley, 1993, Section 2.3).
    """
    names = [each.name for each in fitted.structure.terms[0].unknowns]
    together = sorted((each for each in tried if not each.has_states), key=lambda each: bool(each.constant))
    alone = [each for each in tried if each.has_states]
    constants = [names.index(each.constant) for each in together if each.constant]
    batches = [Batch([term for each in together for term in each.terms], constants)]
    all_known, *each_known = information(fitted, batches + [Batch(each.terms) for each in alone])
    tested = [([each], known) for each, known in at_peaks(alone, each_known)]
    scores, smallest = [], np.ones(20000)
    rng = np.random.default_rng(0)
    for batch, known in ([(together, all_known)] if together else []) + tested:
        gradient, hessian = known.reduced()
        scale = batch[0].unknowns[0].scale if batch[0].has_states else 0.0
        strength = -scale * float(gradient[0] / max(hessian[0, 0], 1e-300))
        norm = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
        gradient, hessian = gradient / norm, hessian / norm[:, None] / norm
        power, modes = np.linalg.eigh(hessian)
        # what is drawn at random is precise enough in half the digits
        spread = (modes * np.sqrt(np.maximum(power, 0.0))).T.astype(np.float32)
        drawn = rng.standard_normal((smallest.size, power.size), dtype=np.float32) @ spread
        first = 0
        for each in batch:
            at = slice(first, first + each.size)
            inside = known.known + np.arange(at.start, at.stop)
            first += each.size
            own, axes = np.linalg.eigh(hessian[at, at])
            kept = own > 1e-7
            turned = axes[:, kept] / np.sqrt(own[kept])
            dof = int(kept.sum())
            gain = 0.5 * float(((gradient[at] @ turned) ** 2).sum())
            cross_validated = known.cross_validated_gain(inside)
            # recordings may say nothing of a family
            p = min(each.look_elsewhere * float(chi2.sf(2.0 * gain, dof)), 1.0) if dof else 1.0
            scores.append(Score(each, gain, dof, p, cross_validated, strength))
            sizes = ((drawn[:, at] @ turned.astype(np.float32)) ** 2).sum(axis=1, dtype=float)
            # the quantile that is asked for is far below
            rare = sizes > chi2.isf(RARE, dof)
            smallest[rare] = np.minimum(smallest[rare], chi2.sf(sizes[rare], dof))
    return ScoreTests(sorted(scores, key=lambda each: -each.gain), float(np.quantile(smallest, FALSE_ALARMS)))


def most_promising(fitted: Fitted, terms: Sequence[Term]) -> tuple[int, float]:
    """Which of some terms has the largest score test's gain, each on its own, and that gain."""
    batches = [Batch(terms[begun : begun + AT_ONCE]) for begun in range(0, len(terms), AT_ONCE)]
    known = information(fitted, batches)
    gains = [gain for batch, own in zip(batches, known, strict=True) for gain in gains_of(own, batch.terms)]
    best = int(np.argmax(gains))
    return best, gains[best]


def gains_of(known: Information, terms: Sequence[Term]) -> list[float]:
    """The score test's gain of each of the terms, on its own."""
    gradient, hessian = known.reduced()
    gains, first = [], 0
    for term in terms:
        at = slice(first, first + len(term.unknowns))
        first = at.stop
        inverse = np.linalg.pinv(hessian[at, at], 1e-7, hermitian=True)
        gains.append(0.5 * float(gradient[at] @ inverse @ gradient[at]))
    return gains
