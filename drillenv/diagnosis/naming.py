"""Which of the library's equations, if any, does as well as a law that was fitted freely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from drillenv.diagnosis.fitting import LOOSE, SHORT, TIGHT, Fitted, penalty, with_continuity_relaxed
from drillenv.diagnosis.laws import Equation, Family, on_axes, wider
from drillenv.diagnosis.solver import Floats, Limits
from drillenv.diagnosis.terms import ModelStructure, Term
from drillenv.diagnosis.thresholds import (
    ALIKE,
    CLOSE,
    EQUAL,
    LAW_ERROR,
    LAW_LEFT,
    LEFT,
    MOST_OF_LAW,
    NOISE_KNOWN,
    TENSE,
)


class Tried(NamedTuple):
    """An equation of the library in the place of a law."""

    equation: Term
    values: Floats
    """Of its parameters, that it came to."""
    worse: float
    """Than the law, in log-likelihood."""


@dataclass
class Named:
    """A family with the equations that were tried in the place of its law."""

    mechanism: str
    equation: Term | None
    """The library's equation that does as well as the free law."""
    tried: tuple[Tried, ...] = ()
    """From each start, the best first."""
    alike: tuple[str, ...] = ()
    """Other mechanisms that a law which no equation follows may be as well."""


def does_as_well(worse: float, gain: float, dof: int, fitted: Fitted) -> bool:
    """Whether an equation so much worse than a free law, with so many fewer parameters, may be the true one.

    What it leaves of the law's gain must not stand out of the noise of so many samples, or, in a model that is far off
    with any law, ``fitted``, of what else is missing there: the more parameters, the more of that a law takes up.
    """
    left = min(LAW_ERROR**2 * gain, 0.5 * NOISE_KNOWN * fitted.samples)
    if fitted.reduced_chi_square > CLOSE:
        left = max(left, LAW_LEFT * (fitted.cost - 0.5 * fitted.residual_dof))
    return worse <= 0.5 * float(chi2.isf(ALIKE, max(dof, 1))) + left


def without(fitted: Fitted, terms: Sequence[Term], constant: str = "") -> tuple[ModelStructure, Floats]:
    """The structure less some of its terms, or with a constant as stated, and where a fit stands by its parameters.

    In the solver's units.
    """
    names = {each.name for each in terms}
    whole = fitted.structure
    kept = [each.name not in names for each in whole.terms]
    left = [each for each, stays in zip(whole.terms, kept, strict=True) if stays]
    if constant:
        left[0] = left[0].held(constant)
    parts = [part for part, stays in zip(whole.split(fitted.fit.shared), kept, strict=True) if stays]
    return replace(whole, terms=tuple(left)), np.concatenate(parts)


def with_more(structure: ModelStructure, begun: Floats, family: Family) -> tuple[ModelStructure, Floats]:
    """A model structure with one more family, and where its parameters begin, in the solver's units."""
    terms = [*structure.terms, *family.terms]
    if family.constant:
        terms[0] = terms[0].freed(family.constant)
    start = np.concatenate([begun, [each.value / each.scale for each in family.unknowns]])
    return replace(structure, terms=tuple(terms)), start


def with_constant_freed(fitted: Fitted, equation: Term) -> Fitted:
    """The fit of an equation with the constant of its place freed, where that is pulled far from what is stated.

    A lab that has fitted its constants without the mechanism states what both are together.
    """
    constants = fitted.structure.terms[0]
    for name in fitted.structure.rig.taken_up(equation):
        i = next((i for i, each in enumerate(constants.unknowns) if each.name == name), None)
        if i is None or abs(fitted.values[i] - constants.unknowns[i].value) < TENSE * constants.unknowns[i].std:
            continue
        terms = (constants.freed(name), *fitted.structure.terms[1:])
        return fitted.refit(replace(fitted.structure, terms=terms))
    return fitted


def fit_equation(fitted: Fitted, structure: ModelStructure, start: Floats, gain: float, limits: Limits) -> Fitted:
    """The fit of a structure that has an equation in the place of a law; to its end where it explains most of that.

    Within ``limits`` first. Where the model is far off with any law, a short fit tells equations apart, and the one
    that is chosen goes on.
    """
    found = fitted.refit(structure, start, limits, states_first=True)
    if found.cost - fitted.cost > gain and fitted.slack == TIGHT:
        # no law at all does better, so this is no minimum
        again = with_continuity_relaxed(fitted, structure, start, states_first=True)
        if again.slack == TIGHT and again.cost < found.cost:
            found = again
    if found.cost - fitted.cost > MOST_OF_LAW * gain or fitted.reduced_chi_square > CLOSE:
        return found
    return found.refit()


def from_reduced_model(
    fitted: Fitted, reduced: ModelStructure, start: Floats, family: Family, equations: Sequence[Term], say
) -> list[tuple[Term, Fitted]]:
    """Fits of equations that begin from the reduced model, which has no law in their place, and not from the free law.

    The fit of a free law of many parameters may be a poor minimum, which says nothing of where an equation's is.

    Args:
        fitted: With the free law.
        reduced: The same without.
        start: Of its fit, in the solver's units.
        family: Of the law.
        equations: Those that could stand for it.
        say: Told how they do.
    """
    found = []
    base = fitted.refit(reduced, start)
    for equation in equations:
        if equation.has_states and not family.has_states:
            continue
        structure = replace(base.structure, terms=(*base.structure.terms, equation))
        begun = [np.append(base.fit.shared, np.array(each) / equation.scales) for each in own_starts(equation)]
        other = min((base.refit(structure, each, SHORT) for each in begun), key=lambda each: each.cost)
        say(f"  {equation.name} from the reduced model: worse by {other.cost - fitted.cost:.1f}")
        found.append((equation, other if other.cost > fitted.cost + 0.5 * (base.cost - fitted.cost) else other.refit()))
    return found


def criterion_by_law(fitted: Fitted, family: Family) -> float:
    """Negative log-likelihood, with the penalty on its parameters, of the equation nearest to a law of curves.

    By the quadratic about the law's fit; infinite where the library has none for it.
    """
    rivals = fitted.structure.rig.rivals(fitted, family)
    worse = (each.worse + penalty(len(each.equation.unknowns), fitted) for each in rivals)
    return fitted.cost + min(worse, default=math.inf)


def is_special_case(simpler: Term, equation: Term) -> bool:
    """Whether an equation becomes a simpler one of the same mechanism where some of its parameters say nothing."""
    names, more = ({each.name for each in term.unknowns} for term in (simpler, equation))
    return simpler.effect == equation.effect and names < more


def from_special_cases(tried: Sequence[tuple[Term, Fitted]], size: int, most: float, say) -> list[tuple[Term, Fitted]]:
    """Fits of equations from that of a simpler one, of those ``tried``, where their own may be no minima.

    That is so where the simpler one has ended better, and where an equation has more parameters than the law, of a
    ``size``, so that the law says nothing of where it begins: from a simpler one that costs ``most`` at most, where
    that leaves something. Dry friction has a minimum for each stop of a mass that is missed, and a mount for each
    mode that a second mass may be taken for; what they have come to in the simpler equation is nearer to the
    deepest one.
    """
    found = []
    for equation in {each.name: each for each, _ in tried}.values():
        own = min(fit.cost for each, fit in tried if each.name == equation.name)
        special = [pair for pair in tried if is_special_case(pair[0], equation)]
        simpler, base = min(special, key=lambda pair: pair[1].cost, default=(equation, None))
        if base is None:
            continue
        told_by_law = len(equation.unknowns) <= size or base.reduced_chi_square < 1.0 + LEFT
        if base.cost >= own and (told_by_law or base.cost > most):
            continue
        given = {each.name: value for each, value in zip(simpler.unknowns, base.values_of(simpler.name), strict=True)}
        rest, kept = without(base, [simpler])
        structure = replace(rest, terms=(*rest.terms, equation))
        names = [each.name for each in equation.unknowns]
        begun = {tuple(map(given.get, names, start)) for start in own_starts(equation)}
        starts = [np.append(kept, np.array(each) / equation.scales) for each in sorted(begun)]
        fits = [base.refit(structure, each, SHORT, states_first=True) for each in starts]
        other = min(fits, key=lambda each: each.cost)
        if other.cost < base.cost and other.reduced_chi_square < CLOSE:
            other = other.refit()
        say(f"  {equation.name} from {simpler.name}: gain over that {base.cost - other.cost:.1f}")
        found.append((equation, other))
    return found


def from_general_case(tried: Sequence[tuple[Term, Fitted]], say) -> list[tuple[Term, Fitted]]:
    """Fits of equations from that of a more general one, of those ``tried``, which has ended better.

    The more general one may be the simpler one but for a parameter at its bound, by way of which it has found a deeper
    minimum: play with ends that are hardly rounded.
    """
    found = []
    for simpler in {each.name: each for each, _ in tried}.values():
        own = min(fit.cost for each, fit in tried if each.name == simpler.name)
        general = [pair for pair in tried if is_special_case(simpler, pair[0])]
        equation, best = min(general, key=lambda pair: pair[1].cost, default=(simpler, None))
        if best is None or best.cost > own - EQUAL:
            continue
        values = dict(zip((each.name for each in equation.unknowns), best.values_of(equation.name), strict=True))
        rest, kept = without(best, [equation])
        start = np.append(kept, [values[each.name] / each.scale for each in simpler.unknowns])
        other = best.refit(replace(rest, terms=(*rest.terms, simpler)), start, SHORT, states_first=True)
        if other.cost < own and other.reduced_chi_square < CLOSE:
            other = other.refit()
        say(f"  {simpler.name} from {equation.name}: worse than that by {other.cost - best.cost:.1f}")
        found.append((simpler, other))
    return found


def own_starts(equation: Term) -> Sequence[Sequence[float]]:
    """Values of an equation's parameters from which its fits begin."""
    return equation.form.starts if isinstance(equation, Equation) else [[each.value for each in equation.unknowns]]


def name_law(fitted: Fitted, family: Family, gain: float, say=lambda _: None) -> tuple[Named, Fitted]:
    """Try the library's equations in a free law's place; the fit with the one that does as well, or as it was."""
    if family.textbook:
        own = family.terms[0]
        return Named(family.mechanism, own, (Tried(own, fitted.values_of(own.name), 0.0),)), fitted
    tried: list[tuple[bool, Term, Fitted]] = []
    rest, kept = without(fitted, family.terms)
    rest = on_axes(rest, wider(rest.axes))

    def as_well_as(equation: Term, other: Fitted) -> bool:
        return does_as_well(other.cost - fitted.cost, gain, family.size - len(equation.unknowns), fitted)

    done, rivals = False, fitted.structure.rig.rivals(fitted, family)
    for equation, starts, worse in rivals:
        # what is worse by more than the law gains is worse than none; once one does as well, others are tried that may
        # do better, but none with states of its own: those are a family too, which was tried where it promised as much
        least, stateful = MOST_OF_LAW * gain if done else gain, equation.has_states and not family.has_states
        if worse > least or (done and stateful):
            continue
        for constants, values in starts:
            structure = replace(rest, terms=(*rest.terms, equation))
            start = np.concatenate([constants, kept[constants.size :], values])
            # beside one that does as well, what creeps is no rival
            other = fit_equation(fitted, structure, start, gain, LOOSE if done else SHORT)
            as_well = as_well_as(equation, other)
            if not as_well and other.cost - fitted.cost < MOST_OF_LAW * gain:
                other = with_constant_freed(other, equation)
                as_well = as_well_as(equation, other)
            say(f"  {equation.name} {other.values_of(equation.name)}: worse by {other.cost - fitted.cost:.1f}")
            tried.append((as_well, equation, other))
            done = done or as_well
            if done:
                # of any other equation it is enough to see that it does not do better from its nearest start
                break
    # a law that leaves nothing has the equation that it follows begin next to its minimum
    if not done and 1.0 + LEFT < fitted.reduced_chi_square < CLOSE:
        for equation, other in from_reduced_model(fitted, rest, kept, family, [each.equation for each in rivals], say):
            tried.append((as_well_as(equation, other), equation, other))
    most = fitted.cost + MOST_OF_LAW * gain
    again = from_special_cases([(equation, other) for _, equation, other in tried], family.size, most, say)
    tried += [(as_well_as(equation, other), equation, other) for equation, other in again]
    if any(as_well for as_well, _, _ in tried):
        again = from_general_case([(equation, other) for _, equation, other in tried], say)
        tried += [(as_well_as(equation, other), equation, other) for equation, other in again]
    if not tried:
        return Named(family.mechanism, None), fitted
    # of those that do as well the one with fewer parameters, by the criterion of Schwarz
    tried.sort(key=lambda each: (not each[0], each[2].cost + penalty(len(each[1].unknowns), fitted)))
    ranked = tuple(Tried(each, other.values_of(each.name), other.cost - fitted.cost) for _, each, other in tried)
    as_well, best, found = tried[0]
    if as_well:
        return Named(best.effect, best, ranked), found
    return named_by_law(Named(family.mechanism, None, ranked), fitted, family, gain), fitted


def named_by_law(named: Named, fitted: Fitted, family: Family, gain: float) -> Named:
    """The same with the mechanism that a measured law, which a fit has as ``family``, is likeliest to be."""
    if not named.tried:
        return named
    # the nearest equation gives the mechanism its name as long as it explains most of what the law does
    nearest = named.tried[0]
    by_nearest = nearest.equation.effect if nearest.worse < MOST_OF_LAW * gain else ""
    mechanism, *alike = fitted.structure.rig.mechanisms_by_law(fitted, family, by_nearest)
    return replace(named, mechanism=mechanism, alike=tuple(alike))
