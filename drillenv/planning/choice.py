"""Which of many recordings to make: those that resolve most mechanisms, and tell most of them from each other.

The log-likelihood that a mechanism gains in a diagnosis grows as the square of its strength. What is left of it once
all that is fitted beside it has taken up its part is the Schur complement of its Fisher information (D_s-optimality:
A. C. Atkinson, A. N. Donev and R. D. Tobias, Optimum Experimental Designs, with SAS, Oxford University Press, 2007,
Section 10.3); against a rival, that complement is the non-centrality of T-optimality (A. C. Atkinson and V. V. Fedorov,
The design of experiments for discriminating between two rival models, Biometrika 62 (1975) 57-70). A mechanism is
resolved where the gain is what a diagnosis asks for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from drillenv.diagnosis.drill_diagnosis import held_out
from drillenv.diagnosis.laws import Curve
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.thresholds import FALSE_ALARMS, RESOLVED
from drillenv.planning.information import Candidate, Survey

COEFFICIENTS = 8
"""Of a free law, about as many as a diagnosis tries a mechanism by."""
FAINTEST = 0.05
"""Share of a typical strength below which it hardly matters that a still smaller one is resolved."""
INSEPARABLE = 10.0
"""Times a typical strength: what is not resolved there is not resolved."""
EXCHANGES = 4
"""Rounds of exchanges at most."""
FRESH_SHARE = 4
"""At most one recording in so many starts from rest: those are never held out, and their first blows are unlike the
others."""


class Resolution(NamedTuple):
    """Smallest strengths that a diagnosis of some recordings finds, as shares of typical ones."""

    alone: Floats
    """(signatures,) where nothing else is missing."""
    against: Floats
    """(signatures, mechanisms) from where it is not taken for that mechanism, whatever its law; infinite for itself."""

    @property
    def hardest(self) -> Floats:
        """(signatures,) from where it is taken for no other mechanism."""
        return np.max(np.where(np.isinf(self.against), 0.0, self.against), axis=1, initial=0.0)


class Judge:
    """Judges sets of recordings by what a diagnosis of them would resolve."""

    def __init__(self, survey: Survey) -> None:
        """Of the candidates of a survey."""
        self.informations: np.ndarray = np.array([each.information for each in survey.candidates])
        self.powers: np.ndarray = np.array([each.power for each in survey.candidates])
        self.prior: Floats = survey.prior
        self.mechanisms: tuple[str, ...] = tuple(dict.fromkeys(each.effect for each in survey.signatures))
        self.of: np.ndarray = np.array([self.mechanisms.index(each.effect) for each in survey.signatures])
        self.rivals: list[Rival] = [rival_of(survey, each) for each in self.mechanisms]
        # one test a family, and about as many families as mechanisms
        self.chance: float = 0.5 * float(chi2.isf(FALSE_ALARMS / len(self.mechanisms), COEFFICIENTS))

    def needed(self, chosen: Sequence[int]) -> float:
        """Log-likelihood that a mechanism has to gain: more than chance, and than sensors resolve."""
        return max(self.chance, 0.5 * RESOLVED**2 * float(self.powers[list(chosen)].sum()))

    def resolution(self, chosen: Sequence[int]) -> Resolution:
        """What a diagnosis of these recordings would resolve."""
        known = self.prior.size
        total = self.informations[list(chosen)].sum(axis=0)
        nuisance = total[:known, :known] + np.diag(self.prior)
        nuisance = nuisance + np.diag(1e-12 * np.diag(nuisance))
        left = total[known:, known:] - total[known:, :known] @ np.linalg.solve(nuisance, total[:known, known:])
        many = self.of.size
        own, needed = np.maximum(np.diag(left)[:many], 1e-300), self.needed(chosen)
        against = np.full((many, len(self.mechanisms)), np.inf)
        for j, rival in enumerate(self.rivals):
            against[:, j] = smallest(own - taken_up(left, many, rival.by_any_law), needed)
            if rival.alike.size:
                by_equation = smallest(own - taken_up(left, many, rival.by_equation), needed)
                against[rival.alike, j] = by_equation[rival.alike]
            against[rival.by_equation, j] = np.inf
        return Resolution(smallest(own, needed), against)

    def value(self, chosen: Sequence[int]) -> float:
        """The criterion, the larger the better.

        The mean over mechanisms, and over their typical strengths, of the negative logarithm of the smallest strength
        that is resolved alone, and of that from which it is taken for no other; strengths below :data:`FAINTEST` count
        less and less.
        """
        found = self.resolution(chosen)
        worth = -0.5 * (np.log(FAINTEST + found.alone) + np.log(FAINTEST + found.hardest))
        return float(np.mean(np.bincount(self.of, worth) / np.bincount(self.of)))


class Rival(NamedTuple):
    """What a mechanism may be taken for: rows, counted from the first signature on."""

    by_equation: NDArray[np.int64]
    """The mechanism's own signatures."""
    by_any_law: NDArray[np.int64]
    """Those, and the free laws by which a diagnosis tries it."""
    alike: NDArray[np.int64]
    """Signatures of other mechanisms that are tried by the same free laws: equations alone tell them apart."""


def rival_of(survey: Survey, mechanism: str) -> Rival:
    """A mechanism as a rival of the others."""
    names = np.array([each.effect for each in survey.signatures])
    own, family = np.flatnonzero(names == mechanism), family_of(survey, mechanism)
    if family is None:
        return Rival(own, own, own[:0])
    rows = survey.laws[family][1]
    free = np.arange(rows.start, rows.stop) - survey.prior.size
    same = [name for name in dict.fromkeys(names) if name != mechanism and family_of(survey, name) == family]
    return Rival(own, np.append(own, free), np.flatnonzero(np.isin(names, same)))


def family_of(survey: Survey, mechanism: str) -> int | None:
    """The family of free laws that acts where a mechanism does; None where it has no laws or no family has them."""
    signature = next(each for each in survey.signatures if each.effect == mechanism)
    places = {each.place for each in signature.terms if isinstance(each, Curve)}
    acting = [i for i, (there, _) in enumerate(survey.laws) if places and places <= there]
    return acting[0] if acting else None


def taken_up(left: Floats, many: int, rival: NDArray[np.int64]) -> Floats:
    """(many,) information of the first rows that is taken up by those of a rival."""
    within = left[rival][:, rival]
    # by its own size: coefficients of a law that no motion shows
    within = within + np.diag(1e-9 * np.diag(within) + 1e-300)
    across = left[:many, rival]
    return np.einsum("ij,ji->i", across, np.linalg.solve(within, across.T))


def smallest(information: Floats, needed: float) -> Floats:
    """Strengths at which a quadratic gain is what is needed, at most :data:`INSEPARABLE`."""
    return np.minimum(np.sqrt(2.0 * needed / np.maximum(information, 1e-300)), INSEPARABLE)


def chosen_from(survey: Survey, judge: Judge, count: int, note: Callable[[str], object]) -> list[int]:
    """The best recordings found, so many, in the order in which to make them.

    One after the other the best is added, then each is exchanged for a better one as long as there is any (V. V.
    Fedorov, Theory of Optimal Experiments, Academic Press, 1972, Section 2.5).
    """
    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(max(allowed(survey, chosen, count), key=lambda i: judge.value([*chosen, i])))
    best = judge.value(chosen)
    note(f"one after the other: criterion {best:.4f}")
    for _ in range(EXCHANGES):
        before = best
        for at in range(count):
            rest = [each for i, each in enumerate(chosen) if i != at]
            other = max(allowed(survey, rest, count), key=lambda i: judge.value([*rest, i]))
            if judge.value([*rest, other]) > best + 1e-9:
                chosen = [*rest[:at], other, *rest[at:]]
                best = judge.value(chosen)
        if best <= before + 1e-6:
            break
    note(f"exchanged: criterion {best:.4f}")
    return in_order(survey, judge, chosen)


def allowed(survey: Survey, chosen: Sequence[int], count: int) -> list[int]:
    """Candidates that may be added: of settings that are not there yet, some from rest and most of a running rig."""
    settings = {survey.candidates[i].setting for i in chosen}
    fresh = sum(survey.candidates[i].fresh for i in chosen)
    any_fresh = any(each.fresh for each in survey.candidates)
    last = len(chosen) == count - 1

    def fits(each: Candidate) -> bool:
        if each.setting in settings:
            return False
        if each.fresh:
            return fresh < max(1, count // FRESH_SHARE)
        return not (last and fresh == 0 and any_fresh)

    found = [i for i, each in enumerate(survey.candidates) if fits(each)]
    # a grid may have fewer settings than are asked for
    return found or [i for i in range(len(survey.candidates)) if i not in chosen]


def in_order(survey: Survey, judge: Judge, chosen: Sequence[int]) -> list[int]:
    """The same, the most useful first, but for those that a diagnosis holds out of its fit, of which it needs least."""
    ranked, rest = [], list(chosen)
    while rest:
        ranked.append(max(rest, key=lambda i: judge.value([*ranked, i])))
        rest.remove(ranked[-1])
    places = sorted(places_held_out(survey, ranked))
    running = [i for i in ranked if not survey.candidates[i].fresh]
    held = combinations(running, len(places))
    for spare in sorted(held, key=lambda held: -judge.value([i for i in ranked if i not in held])):
        order = [i for i in ranked if i not in spare]
        for place, i in zip(places, spare, strict=True):
            order.insert(place, i)
        # those at the ends of the range of frequencies are not held out, and one from rest that moves changes others
        if {order[place] for place in places_held_out(survey, order)} == set(spare):
            return order
    return ranked


def places_held_out(survey: Survey, order: Sequence[int]) -> set[int]:
    """Which of the recordings a diagnosis holds out of its fit."""
    return held_out([survey.candidates[i] for i in order])
