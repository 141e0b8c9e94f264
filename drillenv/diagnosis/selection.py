"""Which families of missing physics the recordings call for: forward selection and backward elimination."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from drillenv.diagnosis.fitting import (
    LOOSE,
    SHORT,
    TIGHT,
    Fitted,
    penalty,
    tighten_continuity,
    with_continuity_relaxed,
)
from drillenv.diagnosis.laws import Curve, Family
from drillenv.diagnosis.naming import criterion_by_law, with_more, without
from drillenv.diagnosis.score_tests import Score, ScoreTests, score_tests
from drillenv.diagnosis.solver import Floats, Limits
from drillenv.diagnosis.steps import (
    Say,
    Step,
    accept,
    add_step,
    copied,
    exchanged,
    gain_of_others,
    identify_equation,
    measured_beside,
    mechanisms_of,
    reconsidered,
    with_equations_reconsidered,
    with_laws_changed,
)
from drillenv.diagnosis.terms import ModelStructure
from drillenv.diagnosis.thresholds import (
    CLOSE,
    FAINT,
    FALSE_ALARMS,
    LAW_LEFT,
    LEFT,
    MOST_FAMILIES,
    NEAR,
    POSSIBLE,
    SEVERAL,
)

CANDIDATES = 5
"""Families that are fitted side by side at each step."""
BEYOND_DOUBT = 20.0
"""Times what it has to gain from which a family is not left out for a try."""
PROMISED = 0.5
"""Share of the best score test's gain that its short fit has to reach, or else its windows are freed; and of what the
best other family gains, that one which is fitted from above has to reach for that."""


def start_with(fitted: Fitted, family: Family, strength: float) -> tuple[ModelStructure, Floats]:
    """A fit's structure with one more family, and where that begins, with more of its first parameter by ``strength``.

    In the solver's units; the strength in the parameter's.
    """
    structure, start = with_more(fitted.structure, fitted.fit.shared, family)
    if strength != 0.0:
        start[-family.size] += strength / family.unknowns[0].scale
    return structure, start


def with_family(
    fitted: Fitted, family: Family, limits: Limits, strength: float = 0.0, from_nominal: bool = False
) -> Fitted:
    """The fit with one more family, from its start, or from there with more of its first parameter, its strength.

    From the constants of the fit, or with all of them ``from_nominal``.
    """
    structure, start = start_with(fitted, family, strength)
    if from_nominal:
        count = len(structure.terms[0].unknowns)
        start[:count] = structure.start[:count]
    return fitted.refit(structure, start, limits, states_first=strength != 0.0 or from_nominal)


def short_fit(fitted: Fitted, family: Family, limits: Limits = SHORT) -> Fitted:
    """A short fit with one more family.

    In a joined model constants that are far from what is stated may have taken up what a family explains, and states
    with them: from there its fit may come to a poor minimum, and where it leaves much it is begun from what is stated
    as well.
    """
    found = with_family(fitted, family, limits)
    if family.constant or fitted.slack > TIGHT or not is_strained(fitted) or explains_all(found, fitted):
        return found
    return min(found, with_family(fitted, family, limits, from_nominal=True), key=lambda each: each.cost)


def is_strained(fitted: Fitted) -> bool:
    """Whether a constant is several of its tolerances from what is stated."""
    unknowns = fitted.structure.terms[0].unknowns
    pairs = zip(fitted.values, unknowns, strict=False)
    return any(abs(value - each.value) > SEVERAL * each.std for value, each in pairs)


def from_strengths(fitted: Fitted, score: Score, limits: Limits) -> Fitted:
    """The fit with one more family that has states, from none of it and from as much as its score test says.

    With none of it, its frequency or time constant changes nothing.
    """
    strengths = dict.fromkeys((0.0, max(score.strength, score.family.unknowns[0].low)))
    return min((with_family(fitted, score.family, limits, each) for each in strengths), key=lambda each: each.cost)


def from_above(fitted: Fitted, family: Family, limits: Limits, best: Fitted | None) -> Fitted:
    """A short fit with one more family, from the strength at which it is begun; of joined windows the better of two.

    By way of free windows states come to suit that strength, and end elsewhere than those that stay joined. Where the
    ``best`` fit of another family explains all, and this one by far less, that is not tried.
    """
    found = with_family(fitted, family, limits, family.starting_strength)
    lags = best is not None and fitted.cost - found.cost < PROMISED * (fitted.cost - best.cost)
    if fitted.slack > TIGHT or (best is not None and lags and explains_all(best, fitted)):
        return found
    structure, start = start_with(fitted, family, family.starting_strength)
    freed = with_continuity_relaxed(fitted, structure, start, states_first=True)
    return freed if freed.slack == TIGHT and freed.cost < found.cost else found


def candidates(fitted: Fitted) -> list[Family]:
    """Every family that a fit may be given, and constants that need not be as stated."""
    stated = [each.name for each in fitted.structure.terms[0].unknowns if math.isfinite(each.std)]
    wrong = [Family(f"another {name}", f"another {name}", (), constant=name) for name in stated]
    return fitted.structure.rig.candidates(fitted) + wrong


Keep = Callable[[Fitted, list[Step], ScoreTests], object]
"""Told a fit, the steps that it has taken, and the tests of what else there may be."""


def forward(
    fitted: Fitted,
    say: Say = lambda _: None,
    before: Sequence[Step] = (),
    earlier: ScoreTests | None = None,
    keep: Keep = lambda *_: None,
    only: Collection[str] | None = None,
) -> tuple[Fitted, list[Step], ScoreTests]:
    """Add families as long as one is called for, leave out those that the others make needless, and go on without them.

    ``before`` are steps that the fit has taken already. Of families that were tested ``earlier`` on a part of the same
    samples, only those are tested again that may yet be there, at the same level. ``keep`` is told what has been found
    each time that something has. Families of ``only`` these groups, where any are given.
    """
    steps = copied(before)
    possible = None if earlier is None else {each.family.name for each in earlier.scores if each.p < POSSIBLE}
    dismissed = set() if earlier is None else {each.family.group for each in earlier.scores}
    left_out: set[str] = set()
    while True:
        # a model that has come close is to hold from window to window
        fitted = tighten_continuity(fitted)
        for i, step in enumerate(steps):
            if (step.pending or step.provisional) and fitted.reduced_chi_square < CLOSE:
                beside = gain_of_others(steps, step, fitted)
                steps[i] = (
                    identify_equation(fitted, step, say) if step.pending else reconsidered(fitted, step, beside, say)
                )
                fitted = steps[i].after
        tried = [each for each in still_possible(fitted, steps, possible, only) if each.name not in left_out]
        scores, level = score_tests(fitted, tried)
        level = level if earlier is None else min(level, earlier.level)
        # a search may be interrupted further on
        keep(fitted, copied(steps), ScoreTests(scores, level))
        needed = [least_gain(each, fitted, steps, scores, dismissed) for each in scores]
        say(f"score tests: {largest(scores, needed)}; p below {level:.2g}")
        chosen = shortlist(scores, level, needed, fitted)
        if chosen:
            better = with_equations_reconsidered(fitted, steps, chosen[0].gain, say)
            if better is not fitted:
                fitted = better
                continue
        step = None
        if chosen and sum(not each.family.constant for each in mechanisms_of(steps)) < MOST_FAMILIES:
            step = best_step(fitted, chosen, level, say, steps)
        if step is not None:
            add_step(steps, step)
            fitted = step.after
            keep(fitted, copied(steps), ScoreTests(scores, level))
            continue
        other = with_laws_changed(fitted, steps, say, earlier is None)
        if other is not None:
            fitted = other
            continue
        least = misfit_allowance(fitted, steps, scores, dismissed)
        fitted, kept = backward(fitted, steps, least, level, say, found_here=earlier is None)
        if len(kept) == len(steps):
            return fitted, steps, ScoreTests(scores, level)
        # what is left out may have taken up a part of another family, beside all that was tested so far
        left_out |= {each.family.name for each in steps} - {each.family.name for each in kept}
        steps, possible = kept, None


def with_families_reconsidered(fitted: Fitted, steps: list[Step], say: Say) -> Fitted:
    """The fit with another family in the place of a measured law which leaves something, where one does better.

    On stretches of recordings the laws of two forces may do alike, where all samples tell them apart: which others
    there may be is tested again without the law. The steps are changed.
    """
    while fitted.reduced_chi_square > 1.0 + LEFT:
        for step in steps:
            if step.named.equation is None and not step.family.constant and not step.corrects:
                step.rivals = rivals_tested_again(fitted, steps, step, say)
        other = exchanged(fitted, steps, say)
        if other is None:
            break
        fitted = other
    return fitted


def rivals_tested_again(fitted: Fitted, steps: Sequence[Step], step: Step, say: Say) -> list[tuple[Family, float]]:
    """A step's rivals, and the families behind them that would be candidates in the fit without it."""
    others = [each for each in steps if each is not step]
    rest = fitted.refit(*without(fitted, step.terms), states_first=True)
    scores, level = score_tests(rest, still_possible(rest, others))
    needed = [least_gain(each, rest, others, scores) for each in scores]
    say(f"score tests without {step.named.mechanism}: {largest(scores, needed)}; p below {level:.2g}")
    known = {step.family.name, *(family.name for family, _ in step.rivals)}
    found = [each.family for each in shortlist(scores, level, needed, rest) if each.family.name not in known]
    return [*step.rivals, *((each, 0.0) for each in found if each.group != step.family.group)]


def largest(scores: Sequence[Score], needed: Sequence[float]) -> str:
    """The largest gains by the score test, on recordings left out, and the gains needed, for a person."""
    return ", ".join(
        f"{each.family.name} {each.gain:.1f} ({each.cross_validated:.1f}) of {least:.1f}"
        for each, least in zip(scores[:5], needed, strict=False)
    )


def still_possible(
    fitted: Fitted,
    steps: Sequence[Step],
    possible: Collection[str] | None = None,
    only: Collection[str] | None = None,
) -> list[Family]:
    """Families that are not there yet, of these names and of ``only`` these groups where any are given.

    Constants are always tested: what whole recordings say of the shaker's mass grows with the cube of their length.
    """
    there = {step.family.group for step in steps}
    measured = {step.family.group for step in steps if step.named.equation is None}
    # of a mechanism that follows an equation, a free law may still correct it
    found = [
        each
        for each in candidates(fitted)
        if each.group not in measured and not (each.has_states and each.group in there)
        if possible is None or each.name in possible or each.constant
        if only is None or each.group in only
    ]
    if only is None and fitted.reduced_chi_square > 1.0 + LEFT:
        found += fitted.structure.rig.at_own_frequency(fitted, there)
    scope, rig = fitted.structure.scope, fitted.structure.rig
    return found if scope is None else [each for each in found if scope.has(each, rig.mechanisms_of(each))]


def least_gain(
    score: Score, fitted: Fitted, steps: Sequence[Step], scores: Sequence[Score], dismissed: Collection[str] = ()
) -> float:
    """Log-likelihood that a family has to gain beside chance: where a law that was found is not exact, that is not all.

    What corrects an equation has to gain more than the equation may leave in a model that comes close; what may correct
    a measured law of the same force need not, since it is no mechanism then. ``dismissed`` as of
    :func:`misfit_allowance`.
    """
    least = penalty(score.dof, fitted) if steps else 0.0
    beside = measured_beside(score.family, fitted, steps)
    others = [step for step in steps if step.family.group != score.family.group and step not in beside]
    own = [step.gain_in(fitted) for step in steps if step not in others and step.named.equation is not None]
    left = LAW_LEFT**2 * max(own, default=0.0) if fitted.reduced_chi_square < CLOSE else 0.0
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
    left = 0.5 * max(fitted.reduced_chi_square - 1.0, 0.0) * fitted.samples

    def error(step: Step) -> float:
        if step.family.constant or step.corrects:
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
    the model is far off, or where no score test promises most of what is left. So it is fitted at each frequency or
    time constant.
    """
    pairs = zip(scores, needed, strict=True)
    called = [each for each, least in pairs if each.p < level and each.gain > least and each.confirmed]
    if not called:
        return []
    left = fitted.cost - 0.5 * fitted.residual_dof if fitted.reduced_chi_square > 1.0 + LEFT else 0.0
    far = fitted.reduced_chi_square > CLOSE or called[0].gain < PROMISED * left
    chosen: list[Score] = []
    for each in called:
        same = [other for other in chosen if other.family.group == each.family.group]
        if each.gain >= NEAR * called[0].gain and len(same) < 2 and len(chosen) < CANDIDATES:
            chosen.append(each)
    # a constant is the simplest, and a part of what free laws gain may be its own
    more = [each for each in called if each.family.constant and each not in chosen]
    chosen += [each for each in more if each.gain >= NEAR * called[0].gain][:CANDIDATES]
    for each in scores:
        resonant = each.family.has_states and each.p < level and (far or each.gain > FAINT * called[0].gain)
        if resonant and all(each.family.name != other.family.name for other in chosen):
            chosen.append(each)
    return chosen


def best_step(fitted: Fitted, chosen: list[Score], level: float, say: Say, steps: Sequence[Step] = ()) -> Step | None:
    """The family that explains most once fitted, beside ``steps`` so far; None where that is no more than chance."""
    resonant = [each for each in chosen if each.family.has_states]
    promised = chosen[0].gain
    fits = refine_candidates(fitted, [each for each in chosen if not each.family.has_states], say, promised)
    if fits and explains_all(fits[0][1], fitted):
        # in a model that is nearly right, one that promises as much is its equal
        resonant = [each for each in resonant if each.gain >= NEAR * promised]
    if resonant:
        found = refine_candidates(fitted, resonant, say, promised, fits[0][1] if fits else None)
        fits = sorted([*fits, *of_some_strength(found, fits, fitted, say)], key=lambda pair: penalised(*pair, fitted))
    fits = [(each, other) for each, other in fits if is_material(each.family, other)]
    if not fits:
        return None
    fits = by_nearest_equations(simplest_first(fits, fitted), fitted)
    best, found = fits[0]
    if fitted.cost - found.cost < max(0.5 * chi2.isf(level, best.size), resolved_gain(best.family, fitted)):
        return None
    step = accept(fitted, best.family, found, best.size, say, steps)
    step.rivals = [(each.family, other.cost - found.cost) for each, other in fits[1:]]
    return step


def simplest_first(fits: Fits, fitted: Fitted) -> Fits:
    """The same, but in a model that is far off with the best family as well the simplest of those near to it first.

    Of what else is missing there, a family takes up the more the more parameters it has: as does a free law beside an
    equation, see :func:`~drillenv.diagnosis.naming.does_as_well`.
    """
    best = fits[0][1]
    if best.reduced_chi_square < CLOSE:
        return fits
    most = penalised(*fits[0], fitted) + LAW_LEFT * (best.cost - 0.5 * best.residual_dof)
    near = [pair for pair in fits if penalised(*pair, fitted) <= most]
    simplest = min(near, key=lambda pair: pair[0].size)
    return [simplest, *(pair for pair in fits if pair is not simplest)]


def by_nearest_equations(fits: Fits, fitted: Fitted) -> Fits:
    """The same, but of families that explain alike the one first whose law is nearer to one of its equations.

    Free laws of two forces may follow the same motion, where an equation, which has fewer parameters, tells them apart.
    """
    best = penalised(*fits[0], fitted)

    def is_alike(score: Score, other: Fitted) -> bool:
        curved = any(isinstance(term, Curve) for term in score.family.terms)
        return curved and penalised(score, other, fitted) < best + penalty(score.size - 1, fitted)

    alike = [pair for pair in fits if is_alike(*pair)]
    if len(alike) < 2 or fits[0] is not alike[0]:
        return fits
    criteria = {
        score.family.name: min(penalised(score, other, fitted), criterion_by_law(other, score.family))
        for score, other in alike
    }
    alike.sort(key=lambda pair: criteria[pair[0].family.name])
    return [*alike, *(pair for pair in fits if all(pair is not each for each in alike))]


def is_material(family: Family, fitted: Fitted) -> bool:
    """Whether a family's parameters in a fit are beyond what sensors are off anyway, where it says by how much."""
    return family.least == 0.0 or float(np.abs(fitted.values_of(family.terms[0].name)).max()) >= family.least


Fits = Sequence[tuple[Score, Fitted]]
"""Families with a fit of each, the best first."""


def of_some_strength(found: Fits, fits: Fits, fitted: Fitted, say: Say) -> Fits:
    """Those ``found`` whose families, which have states of their own, have a strength as well.

    The states, which begin anywhere near rest, gain something even where it has none. In a model that is far off, and
    where the strength is hardly told from another parameter, the Wald test's quadratic says little: the one that would
    come before all other ``fits`` is put to the likelihood ratio.
    """
    shown = [(each, other) for each, other in found if strength_shows(each.family, other)]
    first = min((penalised(*pair, fitted) for pair in (*fits, *shown)), default=math.inf)
    for each, other in found:
        if penalised(each, other, fitted) < first and not strength_shows(each.family, other):
            gain = gain_of_strength(each.family, other)
            say(f"  {each.family.name}: its strength gains {gain:.1f} over its states alone")
            return [(each, other), *shown] if gain > 0.5 * float(chi2.isf(FALSE_ALARMS, 1)) else shown
    return shown


def gain_of_strength(family: Family, fitted: Fitted) -> float:
    """What the strength of a family with states of its own, its first parameter, gains in a fit over its states alone.

    In log-likelihood, half of the likelihood ratio.
    """
    term, structure = family.terms[0], fitted.structure
    none = float(term.neutral[0])
    first = fitted.structure.current([term])[0].unknowns[0]._replace(value=none, low=none, high=none)
    pinned = [
        replace(each, unknowns=(first, *each.unknowns[1:])) if each.name == term.name else each
        for each in structure.terms
    ]
    start = fitted.fit.shared.copy()
    start[fitted.indices_of([term])[0]] = none / term.scales[0]
    return fitted.refit(replace(structure, terms=tuple(pinned)), start, SHORT, states_first=True).cost - fitted.cost


def strength_shows(family: Family, fitted: Fitted) -> bool:
    """Whether the strength of a family with states of its own, its first parameter, is told from none (a Wald test)."""
    term = family.terms[0]
    i = fitted.indices_of([term])[0]
    off = fitted.fit.shared[i] - term.neutral[0] / term.scales[0]
    return float(off**2) > float(chi2.isf(FALSE_ALARMS, 1)) * float(fitted.covariance[i, i])


def wald_gain(fitted: Fitted, step: Step) -> float:
    """What a step's law gains in a fit, by the quadratic of the log-likelihood (a Wald test).

    By the parameters that tell its strength; 0 of a constant, and of what has none.
    """
    inside, off = [], np.zeros(0)
    for term in fitted.structure.current(step.terms):
        at = fitted.indices_of([term])[: term.neutral.size]
        inside += at
        off = np.append(off, fitted.fit.shared[at] - term.neutral / term.scales[: len(at)])
    spread = np.linalg.pinv(fitted.covariance[np.ix_(inside, inside)], hermitian=True)
    return 0.5 * float(off @ spread @ off)


def penalised(score: Score, other: Fitted, fitted: Fitted) -> float:
    """Negative log-likelihood of a family's fit with the penalty on its parameters."""
    return other.cost + penalty(score.size, fitted)


def explains_all(other: Fitted, fitted: Fitted) -> bool:
    """Whether a fit leaves next to nothing of what another left beyond the noise."""
    return other.reduced_chi_square - 1.0 < LAW_LEFT * (fitted.reduced_chi_square - 1.0)


def refine_candidates(
    fitted: Fitted, chosen: Sequence[Score], say: Say, promised: float, best: Fitted | None = None
) -> list[tuple[Score, Fitted]]:
    """Short fits of families, of which those near to the ``best`` fit so far are followed to their ends.

    The best score test's gain is ``promised``.
    """
    fits: list[tuple[Score, Fitted]] = []
    half = 0.5 * (fitted.cost + 0.5 * fitted.residual_dof)
    most_is_left = fitted.reduced_chi_square > CLOSE and (best is None or best.cost > half)
    for each in chosen:
        # beside one that leaves nothing, what creeps is no rival
        ended = [other for _, other in fits] if best is None else [best]
        limits = LOOSE if any(other.reduced_chi_square < 1.0 + LEFT for other in ended) else SHORT
        if each.family.starting_strength and each.gain >= NEAR * promised:
            found = from_above(fitted, each.family, limits, best)
        elif each.family.has_states and most_is_left:
            found = from_strengths(fitted, each, limits)
        else:
            found = short_fit(fitted, each.family, limits)
        fits.append((each, found))
        say(f"  {each.family.name}: gain {fitted.cost - fits[-1][1].cost:.1f}")
    if not fits:
        return fits
    first, found = fits[0]
    short = fitted.cost - found.cost < PROMISED * first.gain
    if fitted.slack == TIGHT and not first.family.has_states and short:
        structure, start = with_more(fitted.structure, fitted.fit.shared, first.family)
        again = with_continuity_relaxed(fitted, structure, start)
        if again.slack == TIGHT and again.cost < found.cost:
            say(f"  {first.family.name}, windows free at first: gain {fitted.cost - again.cost:.1f}")
            fits[0] = first, again
    fits.sort(key=lambda pair: penalised(*pair, fitted))
    for rank, (each, other) in enumerate(fits[:CANDIDATES]):
        # beside one that explains all, only what explains nearly as much is a rival
        near = LAW_LEFT if best is not None and explains_all(best, fitted) else 0.5
        if best is not None and other.cost > best.cost + near * (fitted.cost - best.cost):
            break
        again = other.refit()
        say(f"  {each.family.name}: gain {fitted.cost - again.cost:.1f}, chi-square {again.reduced_chi_square:.4f}")
        fits[rank] = (each, again)
        best = again if best is None else min(best, again, key=lambda each: each.cost)
    fits.sort(key=lambda pair: penalised(*pair, fitted))
    return fits


def backward(
    fitted: Fitted, steps: list[Step], least: float, level: float, say: Say, found_here: bool
) -> tuple[Fitted, list[Step]]:
    """Leave out families that, with all others there, gain no more than chance at a ``level``, or than ``least``.

    The last one is left out as well where it was not ``found_here`` but on a part of these samples.
    """
    kept = list(steps)
    for step in sorted(steps, key=lambda each: each.gain):
        if found_here and len(kept) < 2:
            break
        by_chance = 0.5 * chi2.isf(level, step.dof)
        allowed = 0.0 if step.corrects else least
        needed = max(by_chance, allowed, penalty(step.dof, fitted), resolved_gain(step.family, fitted))
        if min(wald_gain(fitted, step), step.gain_in(fitted)) > BEYOND_DOUBT * needed:
            continue
        rest, begun = without(fitted, step.terms, step.family.constant)
        other = fitted.refit(rest, begun)
        if other.cost - fitted.cost < needed:
            say(f"  without {step.named.mechanism}: log-likelihood lower by {other.cost - fitted.cost:.1f}")
            kept.remove(step)
            fitted = other
            for each in kept:
                each.gain, each.samples = gain_without(fitted, each, step), fitted.samples
    return fitted, kept


def gain_without(fitted: Fitted, step: Step, left_out: Step) -> float:
    """What a step gains in a fit from which another one was left out, of whose gain it may have taken up all."""
    own = step.gain_in(fitted)
    return min(max(own, wald_gain(fitted, step)), own + left_out.gain_in(fitted))
