"""Families that have been added, and what becomes of their laws: an equation's words, a finer law, a rival's.

A step has the law of a family as it was found: free, or as an equation of the library that does as well. What else is
found later may change which.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from drillenv.diagnosis.fitting import CONVERGED, LOOSE, SHORT, Fitted, penalty, tighten_continuity
from drillenv.diagnosis.laws import Curve, Family, Gain, on_axes
from drillenv.diagnosis.naming import Named, does_as_well, name_law, named_by_law, with_more, without
from drillenv.diagnosis.resolution import DETAILS, refined, with_corners, with_detail
from drillenv.diagnosis.terms import Term
from drillenv.diagnosis.thresholds import CLOSE, EQUAL, FALSE_ALARMS, LAW_LEFT, LEFT, MOST_OF_LAW, SHARP

Say = Callable[[str], object]


@dataclass
class Step:
    """A family that was added."""

    family: Family
    gain: float
    dof: int
    samples: int
    """Of the fit by which it was found."""
    after: Fitted
    named: Named
    terms: tuple[Term, ...]
    """Those of its law in the fit."""
    rivals: list[tuple[Family, float]]
    """Families that were fitted at the same step, and by how much log-likelihood each was worse."""
    pending: bool = False
    """Whether the equations have not been tried yet."""
    tried_beside: frozenset[str] | None = None
    """Terms of the other steps when the equations were tried."""
    detail: int = 1
    """The resolution of its law that was tried last while the model was not close."""
    provisional: bool = False
    """Whether its equation was chosen while the model was far off."""
    coarse: bool = False
    """Whether its law was left as it is for as long as it errs by little and something else is missing."""
    corrects: bool = False
    """Whether it is no mechanism of its own, but what another measured law of the same force is off."""

    def gain_in(self, fitted: Fitted) -> float:
        """About the gain in as many samples as another fit has."""
        return self.gain * fitted.samples / self.samples


def copied(steps: Sequence[Step]) -> list[Step]:
    """Steps that stay as they are while the search goes on and changes its own."""
    return [replace(each, named=replace(each.named)) for each in steps]


def mechanisms_of(steps: Sequence[Step]) -> list[Step]:
    """Those that are mechanisms of their own, and not what corrects another measured law."""
    return [each for each in steps if not each.corrects]


def add_step(steps: list[Step], step: Step) -> None:
    """Add a step, or where it corrects an equation that is there, its terms to that one's."""
    corrected = next((each for each in steps if each.family.group == step.family.group), None)
    if corrected is None:
        steps.append(step)
        step.tried_beside = terms_beside(steps, step)
    else:
        corrected.terms, corrected.named.equation = (*corrected.terms, *step.terms), None
        # beside what corrected the equation, one may follow the law after all
        corrected.tried_beside = None


def terms_beside(steps: Sequence[Step], step: Step) -> frozenset[str]:
    """Names of the terms of all other steps."""
    return frozenset(term.name for each in steps if each is not step for term in each.terms)


def gain_of_others(steps: Sequence[Step], step: Step, fitted: Fitted) -> float:
    """About what all other steps have gained, in as many samples as a fit has."""
    return sum(each.gain_in(fitted) for each in steps if each is not step)


def measured_beside(family: Family, fitted: Fitted, steps: Sequence[Step]) -> list[Step]:
    """Steps whose law follows no equation and contains a family's, or is of the same force over another argument.

    A force that depends on two arguments at once, as friction in a contact on speed and depth, is no sum of laws of
    each: what is left of it, a law over the other argument takes up.
    """
    rig = fitted.structure.rig
    return [
        each
        for each in mechanisms_of(steps)
        if each.named.equation is None and each.family.group != family.group
        if rig.same_force(each.family, family) or rig.contains(each.family, family)
    ]


def criterion(other: Fitted, fitted: Fitted) -> float:
    """Negative log-likelihood with the penalty on parameters, of fits of the same samples as a given one."""
    return other.cost + penalty(other.fit.shared.size, fitted)


def weighed_alike(other: Fitted, fitted: Fitted) -> Fitted:
    """A fit under the noise of another of the same samples, so that their costs may be compared."""
    if all(one is level for one, level in zip(other.noise, fitted.noise, strict=True)):
        return other
    return other.refit(limits=LOOSE, noise=fitted.noise)


def accept(fitted: Fitted, family: Family, found: Fitted, dof: int, say: Say, steps: Sequence[Step] = ()) -> Step:
    """A family that was chosen, with its windows joined, and the equation that its law follows.

    Where none does, and something else is missing as well, they are tried again once the model is close. What corrects
    the equation of an earlier step follows none itself. What explains no more than errors of a measured law of the same
    force would leave, or follows no equation beside one that explains more, corrects that law; and so does what is a
    part of a measured law that explains more.
    """
    loose = found.slack
    found = tighten_continuity(found)
    if found.slack < loose:
        say(f"  joined: chi-square {found.reduced_chi_square:.4f}")
    named = Named(family.mechanism, None)
    gain = max(fitted.cost - found.cost, 1.0)
    of_equation = any(each.family.group == family.group and each.named.equation is not None for each in steps)
    pending = not (of_equation or family.constant)
    step = Step(family, gain, dof, fitted.samples, found, named, family.terms, [], pending=pending)
    beside = measured_beside(family, fitted, steps)
    explained = max((each.gain_in(fitted) for each in beside), default=0.0)
    contained = any(fitted.structure.rig.contains(each.family, family) for each in beside)
    if gain > explained or (gain > LAW_LEFT**2 * explained and not contained):
        step = identify_equation(found, step, say)
        worse = step.named.tried[0].worse if step.named.tried else math.inf
        follows = step.named.equation is not None or worse < MOST_OF_LAW * gain
        # in a far model that no equation follows says nothing yet
        if gain > explained or follows or step.pending:
            return step
    say(f"  {family.name} corrects another law of the same {'readings' if contained else 'force'}")
    return replace(step, corrects=True, pending=False)


def errs_little(fitted: Fitted, gain: float) -> bool:
    """Whether a fit leaves something, and less than a law of this gain that is off by ``LAW_LEFT`` would."""
    left = fitted.cost - 0.5 * fitted.residual_dof
    return fitted.reduced_chi_square > 1.0 + LEFT and left < LAW_LEFT**2 * gain


def identify_equation(fitted: Fitted, step: Step, say: Say, at_last: bool = False) -> Step:
    """A step with the equation that its law follows in a fit, or with as fine a law as the recordings call for.

    What a law that errs by little leaves, and corners in it do not take, is looked for among other families before it
    is drawn finer, ``at_last``: with those there it may follow an equation.
    """
    family, gain, found = step.family, step.gain, fitted
    if step.pending:
        named, other = name_law(found, family, gain, say)
    else:
        named, other = step.named, found
    if named.equation is None and found.reduced_chi_square > CLOSE:
        return drawn_sharper(replace(step, named=named, after=found), say)
    terms: tuple[Term, ...] = family.terms if named.equation is None else (named.equation,)
    curved = any(isinstance(each, Curve | Gain) for each in family.terms)
    coarse = curved and named.equation is None and not at_last and errs_little(found, gain)
    if coarse:
        sharper = drawn_sharper(replace(step, named=named, after=found), say)
        coarse = sharper.after is found
        step, family, found = sharper, sharper.family, sharper.after
    if coarse:
        named = named_by_law(named, found, family, gain)
    elif family.terms and (named.equation is None or (other.cost > found.cost and found.reduced_chi_square < CLOSE)):
        # in a far model a finer law takes up what else is missing there, and says nothing against an equation
        finer = refined(found, family)
        fewer = finer.fit.shared.size - other.fit.shared.size
        if named.equation is None or not does_as_well(other.cost - finer.cost, gain, fewer, finer):
            terms = finer.structure.current(family.terms)
            measured, other = replace(named, equation=None), finer
            named = named_by_law(measured, finer, replace(family, terms=terms), gain)
    if not coarse and named.tried and named.equation is None and other.reduced_chi_square > 1.0 + LEFT:
        both, joint = corrected_equation(named, other, family)
        # priors that make a law smooth are a part of its cost, and none of what a correction gains
        if both.cost < min(other.cost, found.cost) - 0.5 * chi2.isf(FALSE_ALARMS, family.size):
            say(f"  with a free correction: chi-square {both.reduced_chi_square:.4f}")
            named.equation, other, terms = None, both, joint
    close = other.reduced_chi_square < CLOSE
    noise = other.structure.rig.noise_left(other) if close else other.noise
    structure = on_axes(other.structure, other.structure.rig.axes_at(other))
    # what else is missing moves a far model's minimum, so that to follow it to its end is in vain
    limits = CONVERGED if close else SHORT
    before, other = other, other.refit(structure, limits=limits, noise=noise)
    if other.reduced_chi_square > before.reduced_chi_square + LEFT:
        # impacts magnify what laws change by as they are drawn over other ranges
        as_they_were = before.refit(limits=limits, noise=noise)
        other = min(other, as_they_were, key=lambda each: each.reduced_chi_square)
    if named.equation is not None:
        other = as_close_as_it_comes(other)
    form = named.equation.name if named.equation else "fitted" if family.constant else "measured"
    say(f"  {named.mechanism}, {form}: chi-square {other.reduced_chi_square:.4f}")
    provisional = named.equation is not None and not close
    return replace(step, after=other, named=named, terms=terms, pending=False, provisional=provisional, coarse=coarse)


def as_close_as_it_comes(fitted: Fitted) -> Fitted:
    """A fit of a model that is far off, gone on with as long as short fits take away a part of what it leaves.

    An equation of few parameters, begun far from its minimum, is itself what is missing.
    """
    left = math.inf
    while fitted.reduced_chi_square > CLOSE and fitted.cost - 0.5 * fitted.residual_dof < (1.0 - LAW_LEFT) * left:
        left = fitted.cost - 0.5 * fitted.residual_dof
        fitted = tighten_continuity(fitted.refit(limits=SHORT))
    return fitted


def drawn_sharper(step: Step, say: Say) -> Step:
    """The same with corners in its law, or a finer law, where that takes most of what it leaves.

    A law with a sharp corner leaves so much, coarsely drawn, that others would be found in its place.
    """
    found, family, detail = step.after, step.family, step.detail

    def takes_most(sharper: Fitted) -> bool:
        return sharper.reduced_chi_square - 1.0 < SHARP * (found.reduced_chi_square - 1.0)

    sharper, curved = with_corners(found, family), any(isinstance(each, Curve | Gain) for each in family.terms)
    if curved and not takes_most(sharper):
        detail = DETAILS[0]
        sharper = with_detail(found, family, detail)
    if not takes_most(sharper):
        return step
    say(f"  drawn sharper: chi-square {sharper.reduced_chi_square:.4f}")
    terms = sharper.structure.current(family.terms)
    return replace(step, family=replace(family, terms=terms), terms=terms, after=sharper, detail=detail)


def corrected_equation(named: Named, other: Fitted, family: Family) -> tuple[Fitted, tuple[Term, ...]]:
    """The nearest equation with a free law of the same family on top, which sharp corners leave less to do for."""
    equation, values, _ = named.tried[0]
    rest, begun = without(other, family.terms)
    rest = replace(rest, terms=(*rest.terms, equation))
    both = other.refit(*with_more(rest, np.append(begun, values / equation.scales), family))
    return both, (equation, *family.terms)


def reconsidered(fitted: Fitted, step: Step, beside: float, say: Say) -> Step:
    """A step whose equation was chosen in a far model, with the best of all that were tried, now that it is close.

    What else was missing then, one equation may have taken up better than another, by no more than what was found
    ``beside`` it has gained.
    """
    chosen = step.named.equation
    if chosen is None:
        return replace(step, after=fitted, provisional=False)
    rest, begun = without(fitted, step.terms)
    best, equation = fitted, chosen
    for each, values, worse in step.named.tried:
        # the chosen one, from its best start, is the first of them
        if each.name == chosen.name or worse - step.named.tried[0].worse > beside:
            continue
        structure = replace(rest, terms=(*rest.terms, each))
        other = fitted.refit(structure, np.concatenate([begun, values / each.scales]), SHORT, states_first=True)
        say(f"  {each.name} again: worse by {other.cost - fitted.cost:.1f}")
        if criterion(other, fitted) < criterion(best, fitted):
            best, equation = other, each
    if equation is not chosen:
        best = best.refit()
        say(f"  {equation.effect}, {equation.name}: chi-square {best.reduced_chi_square:.4f}")
        step = replace(step, named=replace(step.named, equation=equation, mechanism=equation.effect), terms=(equation,))
    return replace(step, after=best, provisional=False)


def with_equations_reconsidered(fitted: Fitted, steps: list[Step], gain: float, say: Say) -> Fitted:
    """The fit with steps' equations chosen again, where they were chosen on fewer samples than there are now.

    More samples tell equations apart that stretches did not. What a wrong one leaves, another family would take up,
    with at most this ``gain`` in log-likelihood. The steps are changed, each once.
    """
    for i, step in enumerate(steps):
        if step.named.equation is None or step.samples >= fitted.samples:
            continue
        again = reconsidered(fitted, step, gain * step.samples / fitted.samples, say)
        steps[i] = replace(again, gain=step.gain_in(fitted), samples=fitted.samples)
        fitted = again.after
    return fitted


def with_laws_changed(fitted: Fitted, steps: list[Step], say: Say, found_here: bool) -> Fitted | None:
    """The fit with a law that was found drawn finer, in an equation's words, or exchanged for a rival's; or None.

    A law that was left coarse is drawn finer where none of these is called for.

    Rivals were fitted to the same samples only where the steps were ``found_here``.
    """
    finer = with_finer_law(fitted, steps, say)
    if finer is not None:
        return finer
    other = with_equations(fitted, steps, say)
    if other is None and found_here:
        other = exchanged(fitted, steps, say)
    return with_coarse_law_refined(fitted, steps, say) if other is None else other


def with_coarse_law_refined(fitted: Fitted, steps: list[Step], say: Say) -> Fitted | None:
    """The fit with a law as fine as the recordings call for that was left coarse; None where none gets better."""
    for i, step in enumerate(steps):
        if not step.coarse:
            continue
        step.coarse = False
        if step.named.equation is not None or step.corrects:
            continue
        family = replace(step.family, terms=fitted.structure.current(step.family.terms))
        finer = identify_equation(fitted, replace(step, family=family, terms=family.terms), say, at_last=True)
        if criterion(weighed_alike(finer.after, fitted), fitted) < criterion(fitted, fitted):
            steps[i] = finer
            return finer.after
    return None


def with_finer_law(fitted: Fitted, steps: Sequence[Step], say: Say) -> Fitted | None:
    """The fit with a finer law where none is called for but the model is not close: corners leave much, coarsely drawn.

    The law that explains most comes first; None where none gets finer and explains a part of what is left by that.
    """
    if fitted.reduced_chi_square < CLOSE:
        return None
    left = LAW_LEFT * (fitted.cost - 0.5 * fitted.residual_dof)
    for step in sorted(steps, key=lambda each: -each.gain):
        curved = any(isinstance(each, Curve | Gain) for each in step.terms)
        if curved and step.named.equation is None and step.detail < DETAILS[-1] and step.terms == step.family.terms:
            step.detail *= 2
            finer = with_detail(fitted, step.family, step.detail)
            more = penalty(finer.fit.shared.size - fitted.fit.shared.size, fitted)
            if finer.cost < fitted.cost - max(more, left):
                say(f"  a finer law of {step.named.mechanism}: chi-square {finer.reduced_chi_square:.4f}")
                step.terms = finer.structure.current(step.terms)
                step.family = replace(step.family, terms=step.terms)
                return finer
    return None


def with_equations(fitted: Fitted, steps: list[Step], say: Say) -> Fitted | None:
    """The fit with an equation in the place of a measured law, now that what was missing beside it is there; or None.

    Equations are not as supple as free laws: beside another mechanism that is missing even the true one does worse, by
    no more than that mechanism has gained.
    """
    for i, step in enumerate(steps):
        measured = step.named.equation is None and not step.corrects
        beside = terms_beside(steps, step)
        if not measured or step.family.constant or step.tried_beside == beside:
            continue
        lacked = min((each.worse for each in step.named.tried), default=0.0)
        step.tried_beside = beside
        if lacked * fitted.samples / step.samples > gain_of_others(steps, step, fitted):
            continue
        if {each.name for each in step.family.terms} == {each.name for each in step.terms}:
            family = replace(step.family, terms=fitted.structure.current(step.family.terms))
            named, other = name_law(fitted, family, step.gain, say)
        else:
            named, other = without_correction(fitted, step)
        if named.equation is not None:
            say(f"  {named.mechanism}, {named.equation.name}: chi-square {other.reduced_chi_square:.4f}")
            steps[i] = replace(step, after=other, named=named, terms=(named.equation,))
            return other
    return None


def without_correction(fitted: Fitted, step: Step) -> tuple[Named, Fitted]:
    """An equation without the free laws that correct it, where it does as well; or both as they were.

    A minimum that it was caught in, they have led it out of.
    """
    equation, *laws = fitted.structure.current(step.terms)
    other = fitted.refit(*without(fitted, laws), states_first=True)
    freedom = sum(len(each.unknowns) for each in laws)
    if not does_as_well(other.cost - fitted.cost, step.gain, freedom, fitted):
        return step.named, fitted
    return replace(step.named, equation=equation, mechanism=equation.effect), other


def exchanged(fitted: Fitted, steps: list[Step], say: Say) -> Fitted | None:
    """The fit with one step's close rival in its place, where all others there it does better; the step is changed.

    A rival that is there already, as a correction of the law that was chosen or as another law of the same force beside
    a measured one, is tried alone, without either of them.

    What two families explain alike on their own, or by windows that are free, may tell them apart in the end. A law
    that follows an equation to the noise leaves nothing that a rival could do better, but for one that has explained
    more by more parameters, of which its equations have fewer. Where the step's law follows none, a rival's may: its
    equations are tried unless it is worse by more than their fewer parameters are worth. A measured law of the same
    force is tried however much worse it was, and is drawn finer where it comes close beside all others: what was
    missing then moved the law, and not what it is a law of.
    """
    for step in steps:
        if step.family.constant or step.corrects:
            continue
        measured = step.named.equation is None
        follows = not measured and fitted.reduced_chi_square < 1.0 + LEFT
        most = -EQUAL if follows else LAW_LEFT * step.gain
        alike = {each.name for each, _ in step.rivals if fitted.structure.rig.same_force(step.family, each)}
        close = [each for each, worse in step.rivals if worse < most or (measured and each.name in alike)]
        step.rivals = [each for each in step.rivals if each[0] not in close]
        for family in close:
            there = [each for each in steps if each.family.group == family.group]
            allowed = measured and family.name in alike
            if any(each is step or not (each.corrects or allowed) for each in there):
                continue
            rest, begun = without(fitted, [*step.terms, *(term for each in there for term in each.terms)])
            structure, start = with_more(rest, begun, family)
            other = fitted.refit(structure, start)
            if other.cost - fitted.cost > LAW_LEFT * step.gain:
                # no finer law of it comes close where it does not beside all others either
                continue
            finer = refined(other, family)
            say(f"  {family.name} for {step.named.mechanism}: log-likelihood {fitted.cost - finer.cost:+.1f}")
            saved = penalty(family.size - 1, fitted) if measured else 0.0
            worse = criterion(finer, fitted) - criterion(fitted, fitted)
            if measured:
                worse = min(worse, finer.cost - fitted.cost)
            if worse < EQUAL:
                step.named.alike = (*step.named.alike, family.mechanism)
            if worse > saved:
                continue
            fit = replace(fitted.fit, shared=begun, cost=other.cost + step.gain)
            base = replace(fitted, structure=rest, fit=fit)
            found = accept(base, family, other, family.size, say)
            # an equation that it follows has fewer parameters than its free law
            if criterion(weighed_alike(found.after, fitted), fitted) < criterion(fitted, fitted):
                step.family, step.dof, step.named, step.terms = family, family.size, found.named, found.terms
                step.pending, step.provisional, step.detail = found.pending, found.provisional, 1
                steps[:] = [each for each in steps if all(each is not other for other in there)]
                return found.after
    return None
