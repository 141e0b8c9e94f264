"""From a campaign to its verdict: fit, select, name, and hold against recordings that were left out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from drillenv.checks import InputError
from drillenv.diagnosis.bookkeeping import FEWEST_FOR_A_LINE, MAD_TO_STD, Label, relabelled, with_labels_corrected
from drillenv.diagnosis.condition import Conditioned, conditioned, is_near_mains, without_unusable
from drillenv.diagnosis.constants import NAMES, constants, logger, misread_excitations
from drillenv.diagnosis.drill import ShootingProblem
from drillenv.diagnosis.drill_noise import noise_left, noise_of, quietest, with_lines_left
from drillenv.diagnosis.drill_prediction import (
    StateEstimate,
    chi_square,
    estimate_recordings,
    estimates_of,
    excess_chi_square,
    own_lines,
    without_lines,
)
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.drill_unknowns import PRESSURE_LABEL, first_states
from drillenv.diagnosis.evidence import Explained, Verdict, classify, explained
from drillenv.diagnosis.fitting import RELAXED, Fitted, fit_to, tighten_continuity
from drillenv.diagnosis.laws import constant_beside
from drillenv.diagnosis.progress import (
    EXTENDING,
    FITTING,
    PROVING,
    SEARCHING,
    SEARCHING_AGAIN,
    Known,
    OutOfTime,
    Progress,
    Timed,
)
from drillenv.diagnosis.scope import Scope
from drillenv.diagnosis.score_tests import ScoreTests
from drillenv.diagnosis.selection import Keep, forward, with_families_reconsidered
from drillenv.diagnosis.sinusoids import Sinusoid
from drillenv.diagnosis.solver import Limits
from drillenv.diagnosis.steps import Step, mechanisms_of
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.diagnosis.terms import ModelStructure
from drillenv.diagnosis.thresholds import CLOSE, LEFT, SEVERAL, STANDS_OUT
from drillenv.recordings import Campaign
from drillenv.rig import Rig

STRETCH = 16
"""Windows of each recording by which families are told from each other, before all of it is fitted: about as many
periods, in which a rig that runs repeats itself several times."""
CORES = 2
"""Recordings that are fitted side by side where nobody says how many."""
FEW_RECORDINGS = 4
"""Recordings, at most, of which none is kept out of the fit: what one alone shows would else not be fitted."""


class Proof(NamedTuple):
    """Recordings as models predict them that were not fitted to them."""

    before: list[StateEstimate]
    """By the paper's model; without any where nothing could be left out of the fit."""
    after: list[StateEstimate]
    of: str
    """Which, in words."""

    @property
    def names(self) -> list[str]:
        """Of the recordings."""
        return [each.block.point.name for each in self.after]

    @property
    def chi_squares(self) -> tuple[float, float] | None:
        """Reduced chi-square before and after, None without recordings."""
        return (chi_square(self.before), chi_square(self.after)) if self.after else None

    @property
    def is_refuted(self) -> bool:
        """Whether what was found is far off, and farther than the paper's model: so may a search end that had no time.

        Of a recording that it does not follow nothing is said.
        """
        before, after = self.chi_squares or (0.0, 0.0)
        return max(before, CLOSE) < after < math.inf


@dataclass
class Outcome:
    """All that a report is made of."""

    verdict: Verdict
    fit_data: list[Conditioned]
    plain: Fitted
    final: Fitted
    steps: list[Step]
    """What was added."""
    tested: ScoreTests
    proof: Proof
    explained: Explained
    labels: list[Label]
    """Labels that were corrected."""
    stopped: str = ""
    """What was being done as the diagnosis was interrupted; empty where it was not."""
    unusable: Sequence[str] = ()
    """Sentences on recordings that were left out once labels had been corrected."""
    refuted: Sequence[str] = ()
    """Mechanisms that were found, and are left out for what they do on recordings that took no part in the fit."""
    known: Known | None = None
    """What the search ended with."""

    @property
    def mechanisms(self) -> list[Step]:
        """What was added less what corrects another measured law."""
        return mechanisms_of(self.steps)

    @property
    def held_out(self) -> tuple[list[StateEstimate], list[StateEstimate]]:
        """Recordings that no fit has seen, before and after."""
        seen = {each.name for each in self.fit_data}
        sides = self.proof.before, self.proof.after
        before, after = ([each for each in side if each.block.point.name not in seen] for side in sides)
        return before, after

    @property
    def every(self) -> list[StateEstimate]:
        """All recordings by the model that was found."""
        return [*estimates_of(self.final), *self.held_out[1]]


def diagnose_drill(
    campaign: Campaign,
    note: Callable[[str], object] | None = None,
    jobs: int = CORES,
    scope: Scope | None = None,
    interruptible: bool = False,
    within: float = math.inf,
) -> Outcome:
    """Explain a campaign of the drilling rig.

    Args:
        campaign: Of the rig percussive-drill.
        note: Told what is being done.
        jobs: Recordings that are fitted side by side.
        scope: What is searched; everything where None.
        interruptible: Whether an interruption, once the paper's model has been fitted, ends the search with what has
            been found so far, in place of everything.
        within: Processor seconds after which the search ends in the same way.

    Raises:
        InputError: it holds too little that can be used, or lacks a constant.
        KeyboardInterrupt: it was interrupted and not to be ended so, or had found nothing yet.
    """
    say = note or (lambda _text: None)
    last = time.process_time() + within
    campaign, labels = with_labels_corrected(campaign)
    for label in labels:
        say(label.sentence)
    # one that was running has a first contact of which less is known
    campaign, unusable = without_unusable(campaign, nominal_rig(campaign)) if labels else (campaign, [])

    def left() -> float:
        return max(last - time.process_time(), 0.0)

    while True:
        try:
            outcome = search(campaign, say, jobs, scope, interruptible, left(), labels=labels)
            break
        except CorrectionContradicted as contradicted:
            other = with_label_put_back(campaign, labels, contradicted.label)
            say(f"{other.why}: once more {other.how}")
            campaign, labels = other.campaign, other.labels
    if outcome.stopped:
        return replace(outcome, labels=labels, unusable=unusable)
    other = second_look(campaign, labels, outcome)
    if other is not None:
        say(f"{other.why}: once more {other.how}")
        try:
            again = search(other.campaign, say, jobs, scope, interruptible, left(), other.known)
        except KeyboardInterrupt:
            if not interruptible:
                raise
            return replace(outcome, labels=labels, unusable=unusable, stopped=f"looking once more {other.how}")
        if again.verdict != "unexplained" and not again.stopped:
            outcome, labels = again, other.labels
    return replace(outcome, labels=[*labels, *mislabelled_pressures_by_fit(outcome.every)], unusable=unusable)


class SecondLook(NamedTuple):
    """A campaign whose labels a finished search has called in question, and the labels that it then has."""

    campaign: Campaign
    labels: list[Label]
    why: str
    """What calls its labels in question, a clause."""
    how: str
    """With or without what it is searched, in words."""
    known: Known | None = None
    """What a search of it would end with, where no recording that is fitted has another label."""


def second_look(campaign: Campaign, labels: Sequence[Label], outcome: Outcome) -> SecondLook | None:
    """A campaign with other labels that may be explained better, if there is one.

    With a pressure as it was stated, where it was corrected and the model that was found puts it back. Or else without
    a recording that alone is not explained.
    """
    back = contradicted_correction(labels, outcome.every) if labels else None
    if back is not None:
        fitted = back.recording in {each.name for each in outcome.fit_data}
        return with_label_put_back(campaign, labels, back)._replace(known=None if fitted else outcome.known)
    alone = outlying_recording(outcome) if outcome.verdict == "unexplained" else None
    if alone is None:
        return None
    rest = tuple(each for each in campaign.recordings if each.name != alone)
    # a corrected label of it has not helped
    others = [each for each in labels if each.recording != alone]
    why = f"{alone} disagrees more than all the others together"
    set_aside = Label(alone, "use", "fit", "set aside", None)
    return SecondLook(replace(campaign, recordings=rest), [*others, set_aside], why, f"without {alone}")


class CorrectionContradicted(Exception):  # noqa: N818 - a search ends by it, and nothing has gone wrong
    """What a search has found puts a corrected label back, so that it goes on from a wrong one."""

    def __init__(self, label: Label) -> None:
        super().__init__(label.sentence)
        self.label = label


def with_label_put_back(campaign: Campaign, labels: Sequence[Label], back: Label) -> SecondLook:
    """A campaign with a corrected pressure as it was stated: what is missing may have taken it off the others' line."""
    as_stated = replace(back, seems=back.stated)
    every = (relabelled(each, as_stated) if each.name == back.recording else each for each in campaign.recordings)
    others = [each for each in labels if each is not back]
    why = f"what was found puts the pressure of {back.recording} back"
    return SecondLook(replace(campaign, recordings=tuple(every)), others, why, "with it as stated")


def contradicted_correction(labels: Sequence[Label], every: Sequence[StateEstimate]) -> Label | None:
    """A corrected pressure that a fit puts nearer to what was stated than to what it was corrected to."""
    corrected = [each for each in labels if each.field == "pressure"]
    found = {each.recording: float(each.seems) for each in mislabelled_pressures_by_fit(every)} if corrected else {}
    for each in corrected:
        fitted = found.get(each.recording, float(each.seems))
        if abs(fitted - float(each.stated)) < abs(fitted - float(each.seems)):
            return each
    return None


def keep_unless_contradicted(
    labels: Sequence[Label], keep: Keep, fitted: Fitted, steps: list[Step], tested: ScoreTests
) -> None:
    """Keep what has been found.

    Raises:
        CorrectionContradicted: it leaves nothing and contradicts a corrected label, which further families would serve.
    """
    keep(fitted, steps, tested)
    if labels and fitted.reduced_chi_square < 1.0 + LEFT:
        back = contradicted_correction(labels, estimates_of(fitted))
        if back is not None:
            raise CorrectionContradicted(back)


def search(
    campaign: Campaign,
    say: Callable[[str], object],
    jobs: int = CORES,
    scope: Scope | None = None,
    interruptible: bool = False,
    within: float = math.inf,
    known: Known | None = None,
    labels: Sequence[Label] = (),
) -> Outcome:
    """The verdict on recordings as they are labelled; arguments as of :func:`diagnose_drill`.

    Where it is ``known`` already what the search ends with, that is held against recordings alone.

    Raises:
        CorrectionContradicted: what is found puts one of these ``labels``, that were corrected, back.
    """
    rig = nominal_rig(campaign)
    data = conditioned(campaign.recordings, rig)
    held = held_out(data)
    fit_data = [each for i, each in enumerate(data) if i not in held]
    held_data = [each for i, each in enumerate(data) if i in held]
    near = [each.name for each in data if is_near_mains(each)]
    # recordings are fitted side by side: a second layer of threads in the linear algebra would only get in the way
    with threadpool_limits(1), ThreadPoolExecutor(jobs) as pool:
        progress = Progress(say, within)
        try:
            known = known or selected(campaign, fit_data, Timed(pool, progress), progress, scope, near, labels)
        except KeyboardInterrupt as interrupted:
            if progress.known is None or not (interruptible or isinstance(interrupted, OutOfTime)):
                raise
            known = progress.known
            progress.stopped = progress.doing
        progress.stage(PROVING)
        plain, final, steps, tested = known
        plain, final = replace(plain, pool=pool), replace(final, pool=pool)
        fitted_data = [block.data for block in final.blocks]
        if not is_fitted_to(final, fit_data):
            # a search that was ended on stretches is held against no longer ones
            held_data = [each.first(max(block.windows for block in final.blocks)) for each in held_data]
        plain = reestimate_states(plain, final, pool) if steps else final
        proof = proved(fitted_data, held_data, plain, final, pool)
    outcome = concluded(fit_data, Known(plain, final, steps, tested), proof, say)
    return replace(outcome, stopped=progress.stopped, known=known)


def concluded(fit_data: list[Conditioned], found: Known, proof: Proof, say: Callable[[str], object]) -> Outcome:
    """The verdict on what was found and how it is proved; what the proof refutes is left out."""
    plain, final, steps, tested = found
    refuted = [step.named.mechanism for step in mechanisms_of(steps)] if proof.is_refuted else []
    if refuted:
        say("what was found does worse than nothing where it was not fitted, and is left out")
        final, steps, proof = plain, [], proof._replace(after=proof.before)
    missing = [step for step in steps if not step.family.constant]
    share = share_explained(plain, final, proof)
    verdict = verdict_of(final, missing, proof.chi_squares, share)
    return Outcome(verdict, fit_data, plain, final, missing, tested, proof, share, [], refuted=refuted)


def selected(
    campaign: Campaign,
    data: Sequence[Conditioned],
    pool: Executor,
    progress: Progress,
    scope: Scope | None = None,
    near: Sequence[str] = (),
    labels: Sequence[Label] = (),
) -> Known:
    """Families found on stretches of the recordings, then on all of them.

    ``near`` as of :func:`plain_fit`, ``labels`` as of :func:`search`, and so what is raised.
    """
    say = progress.say
    progress.stage(FITTING)
    begun = plain_fit(campaign, [each.first(STRETCH) for each in data], pool, near)
    begun = replace(begun, structure=replace(begun.structure, scope=scope))
    say(f"reduced chi-square {begun.reduced_chi_square:.3f}")
    progress.keep(begun, begun, [], ScoreTests([], 1.0))
    progress.stage(SEARCHING)
    found, steps, tested = forward(
        begun, say, keep=partial(keep_unless_contradicted, labels, partial(progress.keep, begun))
    )
    progress.keep(begun, found, steps, tested)
    progress.stage(EXTENDING)
    final = extended(data, found, pool)
    plain = begun if steps else final
    keep = partial(keep_unless_contradicted, labels, partial(progress.keep, plain))
    keep(final, steps, tested)
    say(f"reduced chi-square {final.reduced_chi_square:.3f}")
    by_equations = {step.family.group for step in steps if step.named.equation is not None}
    if final.reduced_chi_square > CLOSE and by_equations:
        # an equation that follows a law over stretches need not do so where these go on
        final, steps, _ = forward(final, say, steps, tested, keep, only=by_equations)
    # a model that does not hold where its stretches go on is not mended by more families
    if final.reduced_chi_square < CLOSE:
        progress.stage(SEARCHING_AGAIN)
        final = with_families_reconsidered(final, steps, say)
        final, steps, tested = forward(final, say, steps, tested, keep)
    return Known(plain, final_refit(final), steps, tested)


def proved(
    fit_data: Sequence[Conditioned], held_data: Sequence[Conditioned], plain: Fitted, final: Fitted, pool: Executor
) -> Proof:
    """Recordings held out, or where there are none each recording by a fit to the others."""
    if held_data:
        of, data, after = "recordings held out", held_data, estimate_recordings(held_data, final, pool)
    elif len(fit_data) > 1:
        of, data = "each recording, by a fit to the others", fit_data
        after = [
            each
            for i in range(len(data))
            for each in estimate_recordings([data[i]], fitted_without(final, i, pool), pool)
        ]
    else:
        return Proof([], [], "the one recording that was fitted, since no other says whether it holds")
    if plain is final:
        return Proof(after, after, of)
    # lines that the model found has itself are no noise of the one without it
    noise = [without_lines(each.block, own_lines(final)) for each in after]
    return Proof(estimate_recordings(data, plain, pool, noise), after, of)


def fitted_without(fitted: Fitted, i: int, pool: Executor) -> Fitted:
    """The model fitted to all recordings of a fit but one, or to as much of them as that has."""
    others = [j for j in range(len(fitted.blocks)) if j != i]
    blocks, own = [fitted.blocks[j] for j in others], [fitted.fit.own[j] for j in others]
    return fit_to(blocks, own, fitted.structure, fitted.fit.shared, pool)


def outlying_recording(outcome: Outcome) -> str | None:
    """The recording of which more is left beyond the noise than of all the others together, if there is one."""
    every = outcome.every
    if len(every) <= FEWEST_FOR_A_LINE:
        return None
    left = np.array([max(float(excess_chi_square([each]).sum()), 0.0) for each in every])
    worst = int(np.argmax(left))
    # of a recording that no motion follows it is infinite
    return every[worst].block.name if left[worst] > np.delete(left, worst).sum() else None


def mislabelled_pressures_by_fit(every: Sequence[StateEstimate]) -> list[Label]:
    """Pressures that a fit puts off their labels by much more than those of the other recordings."""
    if len(every) <= FEWEST_FOR_A_LINE:
        return []
    off = np.array([own[block.windows * block.state_count(own)] for block, own, _shared in every])
    found = []
    for i, (block, _own, _shared) in enumerate(every):
        others = np.delete(off, i)
        # the gain follows one that is wrong, and takes the others with it
        usual = float(np.median(others))
        spread = max(1.0, MAD_TO_STD * float(np.median(np.abs(others - usual))))
        if abs(off[i] - usual) > STANDS_OUT * spread:
            stated = block.point.pressure
            seems = stated * (1.0 + PRESSURE_LABEL * (float(off[i]) - usual))
            found.append(Label(block.name, "pressure", stated, seems, PRESSURE_LABEL * stated))
    return found


def nominal_rig(campaign: Campaign) -> Rig:
    """The rig as the lab states it.

    Raises:
        InputError: it leaves out a constant or how well it is known.
    """
    for name in NAMES:
        entry = campaign.nominal.get(name)
        if entry is None or entry.value is None or entry.std is None:
            raise InputError(f"nominal lacks {name}: give its value and standard deviation, which the model needs")
    return Rig(*(float(campaign.nominal[name].value or 0.0) for name in NAMES[:6]))


def held_out(data: Sequence[Any]) -> set[int]:
    """Recordings that are left out of the fit: of a running rig, a quarter, spread over the campaign.

    Of each ``fresh`` and ``setting`` are asked. Not those at its lowest and highest frequency, where others can be had:
    no law over the frequency holds beyond what it was fitted to. None where there are few recordings: each is then held
    against a fit to the others.
    """
    running = [i for i, each in enumerate(data) if not each.fresh]
    count = len(data) // 4 if len(data) > FEW_RECORDINGS else 0
    if count == 0 or len(running) < count + 2:
        return set()
    frequencies = [each.setting.frequency for each in data]
    inside = [i for i in running if min(frequencies) < frequencies[i] < max(frequencies)]
    choice = inside if len(inside) >= count else running
    return {choice[round((j + 0.5) * len(choice) / count - 0.5)] for j in range(count)}


def plain_fit(campaign: Campaign, data: Sequence[Conditioned], pool: Executor, near: Sequence[str] = ()) -> Fitted:
    """The paper's model with its constants, and the noise as it shows by that.

    Of recordings ``near`` to the mains, by name, the excitation may be misread.
    """
    flat = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))
    terms = [constants(campaign.nominal), logger()]
    if near:
        terms.append(misread_excitations((each.name for each in data if each.name in near), near))
    structure = ModelStructure(tuple(terms), flat, DRILL)
    blocks = [ShootingProblem(each, structure, RELAXED, noise_of(each)) for each in data]
    limits = Limits(10, 1.0, 0.05)
    found = fit_to(blocks, [first_states(each) for each in data], structure, None, pool, limits)
    noise = with_lines_left(found)
    if any(level.lines for each in noise for level in each):
        found = found.refit(limits=limits, noise=noise)
    found = tighten_continuity(found, limits, noise)
    noise = noise_left(found)
    if found.reduced_chi_square > CLOSE:
        noise = quietest(noise, data, lines=True)
    return found.refit(replace(structure, axes=DRILL.axes_at(found)), noise=noise)


def final_refit(fitted: Fitted) -> Fitted:
    """The same to the end."""
    noise = noise_left(fitted) if fitted.reduced_chi_square < CLOSE else fitted.noise
    return fitted.refit(limits=Limits(15, 0.1), noise=noise)


def extended(data: Sequence[Conditioned], fitted: Fitted, pool: Executor) -> Fitted:
    """A model that was fitted to stretches of recordings, fitted to all of them.

    A frequency of the model is known the better the longer the recordings are, and says where they go on for as long
    again: such a model is fitted to stretches twice as long, and so on.
    """
    if any(isinstance(term, Sinusoid) for term in fitted.structure.terms):
        windows = 2 * max(each.windows for each in fitted.blocks)
        while windows < max(len(each.starts) - 1 for each in data):
            fitted = extend_horizon([each.first(windows) for each in data], fitted, pool)
            windows *= 2
    return extend_horizon(data, fitted, pool)


def extend_horizon(data: Sequence[Conditioned], fitted: Fitted, pool: Executor) -> Fitted:
    """A model that was fitted to shorter stretches of recordings, fitted to longer ones."""
    if is_fitted_to(fitted, data):
        return fitted
    there = estimate_recordings(data, fitted, pool, known=True)
    # lines that the model has itself are no noise
    noise = [without_lines(each.block, own_lines(fitted)) for each in there]
    blocks, own = [each.block for each in there], [each.own for each in there]
    return fit_to(blocks, own, fitted.structure, fitted.fit.shared, pool, slack=fitted.slack, noise=noise)


def is_fitted_to(fitted: Fitted, data: Sequence[Conditioned]) -> bool:
    """Whether a model was fitted to recordings of this length, and not to stretches of them."""
    return all(each.force.size == block.data.force.size for each, block in zip(data, fitted.blocks, strict=True))


def reestimate_states(fitted: Fitted, best: Fitted, pool: Executor) -> Fitted:
    """A model on all that the best one was fitted to, its shared parameters as they are where it saw stretches only."""
    data = [each.data for each in best.blocks]
    if is_fitted_to(fitted, data):
        return fitted
    there = estimate_recordings(data, fitted, pool, best.noise, known=True)
    # what is each recording's own is there as the fit has it
    pairs = [each.block.under(fitted.structure, each.own) for each in there]
    blocks, own = [block for block, _ in pairs], [each for _, each in pairs]
    costs = [block.cost(fitted.fit.shared, each) for block, each in zip(blocks, own, strict=True)]
    cost = sum(costs) + fitted.priors.cost(fitted.fit.shared)
    return replace(fitted, blocks=blocks, fit=replace(fitted.fit, own=own, cost=cost, costs=costs))


def share_explained(plain: Fitted, final: Fitted, proof: Proof) -> Explained:
    """Share of the paper's model's mismatch that is gone, of recordings that were not fitted where there are any."""
    before, after = (proof.before, proof.after) if proof.after else (estimates_of(plain), estimates_of(final))
    samples = sum(each.block.samples for each in before)
    return explained(excess_chi_square(before), excess_chi_square(after), proof.of, samples)


def verdict_of(final: Fitted, steps: Sequence[Step], held: tuple[float, float] | None, share: Explained) -> Verdict:
    """The verdict."""
    # errors of the parameters show in full on recordings that they were not fitted to
    worst = max(final.reduced_chi_square - 1.0, 0.0 if held is None else 0.5 * (held[1] - 1.0))
    # windows that are not joined have states that no motion has
    if worst > CLOSE - 1.0:
        return "unexplained"
    missing = mechanisms_of(steps)
    outside = any(step.family.outside for step in missing)
    return classify(bool(missing), outside, bool(wrong_constants(final)), worst > LEFT, share)


def wrong_constants(final: Fitted) -> list[int]:
    """Constants that are several of their tolerances off; none that a measured law has a part of."""
    shared = {constant_beside(term) for term in final.structure.terms}
    found = []
    for i, (unknown, value) in enumerate(zip(final.structure.unknowns, final.values, strict=True)):
        off = abs(value - unknown.value) > SEVERAL * unknown.scale
        if i < len(NAMES) and off and unknown.name not in shared:
            found.append(i)
    return found
