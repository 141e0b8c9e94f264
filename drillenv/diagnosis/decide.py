"""From recordings to a verdict: fit the paper's model, look for what it lacks, add it, and say how good that is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drillenv.checks import InputError
from drillenv.diagnosis.candidates import own_parameters
from drillenv.diagnosis.condition import Conditioned, common_lag, condition, white_noise
from drillenv.diagnosis.fit import (
    APART,
    CONSTANTS,
    CONVERGED,
    FINAL,
    NEARBY,
    PLAY,
    Fit,
    Hypothesis,
    Parameter,
    Stage,
    Workers,
    fit,
    joined,
)
from drillenv.diagnosis.search import (
    CLOSE,
    FAINT,
    FAR,
    FLOOR,
    SECOND,
    SEVERAL,
    THIN,
    Step,
    late_step,
    next_step,
    tightened,
)
from drillenv.diagnosis.shape import Line, lines_left, repeated
from drillenv.diagnosis.shooting import Prediction, predict, residual, window_costs
from drillenv.diagnosis.starts import from_nothing, holding, leaving_out, opened, slight
from drillenv.recordings import Campaign
from drillenv.rig import Rig

ALONE = Stage(1e4, 10, 2)
"""How a model that is held is laid onto recordings, before its windows are joined."""
ELSEWHERE = 20.0
"""Times the worst of the others that the first window of a fresh rig costs, from which it did not begin at rest."""
MOST = 3
"""Mechanisms at once."""
BENT = 6.0
"""The same beside a named mechanism, from which the two do not go together."""
MOST_LEFT, SMALL_PART = 1.32, 0.1
"""A named mechanism whose equation is not quite that of the rig leaves something too: no more than this, and no more
than this share of what it was named to explain."""
QUIETER = 0.97
"""Share of the noise below which it is told anew from what is left."""
PLAY_BEGINS = "backlash y0"
WIDER = 3.0
"""Standard deviations by which a play is made wider to see whether that matters; if not, any width may do."""
GRIPS = {"vs1"}
"""Symbols of the speed at which friction sets in that may turn out to be 0, of dry friction that grips. Not that of the
indenter: it grips in every period, and each jump of its acceleration across a sample spoils the derivatives."""


@dataclass(slots=True, eq=False)
class Outcome:
    """What a diagnosis came to, before it is put into words."""

    verdict: str
    plain: Fit
    """The paper's model, constants fitted."""
    final: Fit
    steps: list[Step]
    rejected: list[tuple[str, float, str]]
    """(mechanism, gain, why)."""
    fit_data: list[Conditioned]
    held_data: list[Conditioned]
    left: float
    """Sum of squares over samples that is left, on the recordings fitted."""
    before: tuple[float, float | None]
    """Sum of squares over samples of what the lab believed: on the recordings fitted and on those held out."""
    after: float | None
    """That of the fitted model on those held out."""
    pairs: list[tuple[Prediction, Prediction]]
    """What was believed and what was found, of the recordings fitted and then of those held out."""
    lines: list[Line] = field(default_factory=list)
    """Frequencies left over."""
    wider_as_well: bool = False
    """Whether the play found is only the narrowest that fits."""


def nominal_hypothesis(campaign: Campaign) -> Hypothesis:
    """The constants of a campaign with what the lab believes of them.

    Raises:
        InputError: a constant is missing, or has no value or standard deviation.
    """
    parameters = []
    for name in CONSTANTS:
        entry = campaign.nominal.get(name)
        if entry is None or entry.value is None or entry.std is None:
            raise InputError(f"campaign {campaign.title}: nominal {name} lacks a value or a std: give both")
        low, high = 0.2 * entry.value, 5.0 * entry.value
        parameters.append(Parameter(name, entry.value, max(entry.std, 1e-9 * entry.value), 1.0, low, high))
    return Hypothesis(tuple(parameters))


def replay(
    recordings: Sequence[Conditioned], hypothesis: Hypothesis, workers: Workers, known: Fit | None = None
) -> Fit:
    """What a model makes of recordings with its constants and effects held.

    Only the states of the windows are fitted, and what each recording has for its own; the recordings say nothing to
    the constants. ``known`` is the same of these recordings with another noise.
    """
    effects = []
    for name, held, _free in hypothesis.effects:
        own = tuple(each for data in recordings for each in own_parameters(name, data))
        effects.append((name, held, own))
    alone = Hypothesis((), tuple(effects), hypothesis.base)
    if known is not None:
        return joined(recordings, alone, workers, known.values, known.states)
    # every fourth sample shows as well where windows begin
    thin = [each if each.thin > 1 else each.thinned(THIN) for each in recordings]
    apart = fit(thin, alone, workers, stages=(ALONE,))
    return joined(recordings, alone, workers, apart.values, apart.states)


def begun_elsewhere(recordings: Sequence[Conditioned], fitted: Fit) -> list[int]:
    """Which recordings are of a fresh rig whose first window a fit follows far worse than all others.

    A fresh rig is taken to begin at rest where the plain model rests. One that did not would bend every constant for
    the sake of one window; read as a rig that was running, it says as much about the model.
    """
    found = []
    for i, (data, states, made) in enumerate(zip(recordings, fitted.states, fitted.predictions, strict=True)):
        costs = window_costs(data, states, made) / np.diff(data.starts)
        if data.fresh and costs[0] > ELSEWHERE * max(1.0, costs[1:].max()):
            found.append(i)
    return found


def quieted(recordings: list[Conditioned], fitted: Fit) -> list[Conditioned]:
    """The recordings with their noise told from what a fit leaves, or themselves where that is nothing new.

    What rings in a recording passes for noise until it is explained.
    """
    made = []
    for data, said in zip(recordings, fitted.predictions, strict=True):
        force, acceleration = residual(data, said)[:, data.judged]
        made.append(
            replace(
                data,
                noise_force=data.noise_force * min(white_noise(force), 1.0),
                noise_acceleration=data.noise_acceleration * min(white_noise(acceleration), 1.0),
            )
        )
    news = [
        min(new.noise_force / old.noise_force, new.noise_acceleration / old.noise_acceleration)
        for new, old in zip(made, recordings, strict=True)
    ]
    return made if min(news) < QUIETER else recordings


def diagnose_drill(campaign: Campaign, note: Callable[[str], object] | None = None) -> Outcome:
    """The verdict on a campaign of the drilling rig.

    Raises:
        InputError: a recording cannot be used, or fewer than three can.
    """
    say = note or (lambda _text: None)
    plain_hypothesis = nominal_hypothesis(campaign)
    rig = Rig(**{each.name: each.value for each in plain_hypothesis.constants[:6]})
    workers = Workers()
    try:
        say("reading the recordings")
        data = workers.each(lambda recording: condition(recording, rig), campaign.recordings)
        late = common_lag(data, rig)
        if late != 0.0:
            data = workers.each(lambda recording: condition(recording, rig, late), campaign.recordings)
        held = [i for i, each in enumerate(campaign.recordings) if each.use == "held-out"] or _held_out(data)
        kept = [i for i in range(len(data)) if i not in held]
        held_data = [each for i, each in enumerate(data) if i in held]
        say("fitting the paper's model")
        thin = [data[i].thinned(THIN) for i in kept]
        loosely = fit(thin, plain_hypothesis, workers, stages=APART)
        elsewhere = [kept[place] for place in begun_elsewhere(thin, loosely)]
        if elsewhere:
            for i in elsewhere:
                data[i] = condition(replace(campaign.recordings[i], starts="running"), rig, late)
            thin = [data[i].thinned(THIN) for i in kept]
            loosely = fit(thin, plain_hypothesis, workers, stages=APART)
        fit_data = [data[i] for i in kept]
        plain = now = tightened(thin, loosely, workers)
        steps: list[Step] = []
        rejected: list[tuple[str, float, str]] = []
        if late != 0.0 and now.per_sample > FAR:
            step = late_step(thin, late, now, workers)
            if step is not None:
                steps.append(step)
                loosely, now = step.loosely, step.fitted
                say(f"{step.mechanism}: gain {step.gain:.0f}")
        for _look in range(2 * MOST):
            if len(steps) == MOST:
                break
            say(f"looking for what is missing ({now.per_sample:.3f} of the noise is left)")
            step, passed, better = next_step(thin, now, loosely, workers, say)
            rejected += passed
            news, now = better is not now, better
            if not steps:
                plain = now
            if step is None and not news:
                break
            if step is None:
                continue
            steps.append(step)
            loosely, now = step.loosely, step.fitted
            say(f"{step.mechanism}: gain {step.gain:.0f}")
        if len(steps) > 1 and now.per_sample > _bearable(steps[0].fitted.per_sample):
            # more of them that do not bring the end nearer only mop up behind the first
            rejected += [(each.mechanism, each.gain, "leaves more than noise beside the others") for each in steps[1:]]
            del steps[1:]
            now = steps[0].fitted
        now = _without_the_faint(thin, now, steps, rejected, workers)
        now, wider_as_well = _widened(thin, now, workers)
        say("all samples")
        final = _full(fit_data, now, workers)
        quiet = quieted(fit_data, final)
        if quiet is not fit_data:
            fit_data, final = quiet, _full(quiet, final, workers)
        if wider_as_well:
            final = _silent_about(final, PLAY)
        # a fit that is far off is laid onto all samples window by window, which would hide what shows at their joints
        left = max(final.per_sample, now.per_sample) if now.per_sample > CLOSE else final.per_sample
        lines = lines_left(fit_data, final)
        say("the recordings held out")
        nominal = plain_hypothesis.held_at(np.array([each.value for each in plain_hypothesis.constants]))
        before, pairs = _believed(fit_data, nominal, final.predictions, workers)
        before_held = after = None
        if held_data:
            held_model = final.hypothesis.held_at(final.values)
            laid = replay(held_data, held_model, workers)
            quiet = quieted(held_data, laid)
            if quiet is not held_data:
                held_data, laid = quiet, replay(quiet, held_model, workers, laid)
            after = laid.per_sample
            before_held, more = _believed(held_data, nominal, laid.predictions, workers)
            pairs += more
        return Outcome(
            _verdict(
                final, steps, left, plain.per_sample, bool(lines) or (not steps and repeated(fit_data, final).sure)
            ),
            plain,
            final,
            steps,
            _once(rejected, [each.mechanism for each in steps]),
            fit_data,
            held_data,
            left,
            (before, before_held),
            after,
            pairs,
            lines,
            wider_as_well,
        )
    finally:
        workers.close()


def _believed(
    recordings: Sequence[Conditioned], nominal: Hypothesis, found: Sequence[Prediction], workers: Workers
) -> tuple[float, list[tuple[Prediction, Prediction]]]:
    """Sum of squares over samples of what the lab believed, and its predictions beside those of what was found."""
    laid = replay([each.thinned(THIN) for each in recordings], nominal, workers)
    physics = nominal.physics(np.zeros(0))
    believed = workers.each(lambda data, states: predict(data, states, physics), recordings, laid.states)
    return laid.per_sample, list(zip(believed, found, strict=True))


def _held_out(data: Sequence[Conditioned]) -> list[int]:
    """Recordings to prove the result on: two of eight, of a rig that was running."""
    running = [i for i, each in enumerate(data) if not each.fresh]
    if len(data) < 5 or len(running) < 4:
        return []
    return [running[len(running) // 2], running[-2]] if len(data) >= 7 else [running[len(running) // 2]]


def _full(recordings: Sequence[Conditioned], now: Fit, workers: Workers) -> Fit:
    """The fit on all samples."""
    if now.per_sample > CLOSE:
        return fit(recordings, now.hypothesis, workers, now.values, now.states, (Stage(1e4, 3, 1),))
    if not _dry(now):
        return fit(recordings, now.hypothesis, workers, now.values, now.states, FINAL)
    found = fit(recordings, now.hypothesis, workers, now.values, now.states, NEARBY)
    try:
        hypothesis, kept = holding(found.hypothesis, _dry(found) or _dry(now))
        dry = fit(recordings, hypothesis, workers, found.values[kept], found.states, FINAL)
    except (InputError, np.linalg.LinAlgError):
        return found
    return dry if dry.cost < found.cost else fit(recordings, found.hypothesis, workers, stages=FINAL, known=found)


def _widened(thin: Sequence[Conditioned], now: Fit, workers: Workers) -> tuple[Fit, bool]:
    """The fit with play as wide as does best, and whether a wider one would do as well.

    A rig that touches one end of its play only says how wide it is at least. The curvature, which looks to the side
    where something is felt, does not know that; and a fit does not find past the last width at which nothing is felt.
    """
    names = [each.name for each in now.hypothesis.parameters]
    if PLAY not in names or now.per_sample > CLOSE:
        return now, False
    g, y0 = names.index(PLAY), names.index(PLAY_BEGINS)
    believed, moved = now.hypothesis.parameters[g], False
    for _again in range(3):
        more = WIDER * float(now.spread[g])
        hypothesis, kept = holding(now.hypothesis, {PLAY: float(now.values[g]) + more})
        far_end = {"y0": float(now.values[y0] + now.values[g]), "g": more}
        pairs = zip(thin, now.states, strict=True)
        states = [opened(own, now.physics(data.name), data, far_end) for data, own in pairs]
        values = now.values.copy()
        values[g] += more
        try:
            wider = fit(thin, hypothesis, workers, values[kept], states, NEARBY)
            # where it is held nothing is believed of it
            without_belief = now.cost - 0.5 * believed.prior * ((now.values[g] - believed.value) / believed.width) ** 2
            if wider.cost > without_belief - CONVERGED:
                # the curvature promises half the square: less than half of that is as good as nothing
                return now, wider.cost - without_belief < 0.5 * (0.5 * WIDER**2)
            values[kept] = wider.values
            now, moved = fit(thin, now.hypothesis, workers, values, wider.states, NEARBY), True
        except (InputError, np.linalg.LinAlgError):
            break
    return now, moved


def _silent_about(fitted: Fit, name: str) -> Fit:
    """The fit, its recordings saying nothing of one parameter, and of the others as if it were known."""
    at = [each.name for each in fitted.hypothesis.parameters].index(name)
    parts = []
    for part, place in zip(fitted.quadratics, fitted.places, strict=True):
        known = (place != at).astype(float)
        curvature = part.curvature * known[:, None] * known
        parts.append(replace(part, gradient=part.gradient * known, curvature=curvature))
    return replace(fitted, quadratics=parts)


def _dry(fitted: Fit) -> dict[str, float]:
    """Speeds at which friction sets in that a fit has at their least value, at 0: there it is dry."""
    found = {}
    for each, value in zip(fitted.hypothesis.parameters, fitted.values, strict=True):
        if " " in each.name and each.symbol in GRIPS and each.at_least(value):
            found[each.name] = 0.0
    return found


def _once(rejected: Sequence[tuple[str, float, str]], named: Sequence[str]) -> list[tuple[str, float, str]]:
    """Each mechanism that is not named once, as where it gained most, the largest gain first."""
    best: dict[str, tuple[str, float, str]] = {}
    for each in sorted(rejected, key=lambda each: -each[1]):
        if each[0] not in named:
            best.setdefault(each[0], each)
    return list(best.values())


def _without_the_faint(
    thin: list[Conditioned], now: Fit, steps: list[Step], rejected: list[tuple[str, float, str]], workers: Workers
) -> Fit:
    """The fit without mechanisms that it does not need once others stand beside them; they are taken out of the steps.

    One found first may have stood in for one found later, and one found last only have led the others on.
    """
    for step in list(steps):
        if len(steps) == 1:
            break
        faint = max(from_nothing(now, step.mechanism), default=0.0) < FAINT
        if not (faint or slight(now, step.mechanism)):
            continue
        hypothesis, kept = leaving_out(now.hypothesis, step.mechanism)
        try:
            alone = fit(thin, hypothesis, workers, now.values[kept], now.states, NEARBY)
        except (InputError, np.linalg.LinAlgError):
            continue
        if alone.cost - now.cost < SECOND:
            rejected.append((step.mechanism, alone.cost - now.cost, "is not needed beside the others"))
            steps.remove(step)
            now = alone
    return now


def _bearable(before: float) -> float:
    """Sum of squares over samples that mechanisms may leave of what there was before them."""
    return max(FLOOR, min(MOST_LEFT, 1.0 + SMALL_PART * (before - 1.0)))


def _verdict(final: Fit, steps: Sequence[Step], left: float, plain: float, shaped: bool) -> str:
    """In one word, from what the final fit and the plain one leave, and whether that has a shape that noise has not."""
    bearable = _bearable(plain) if steps else FLOOR
    off = np.abs(final.deviations).max()
    # a mechanism that needs constants nobody believes in stands for another one
    if left > bearable or shaped or (steps and off > BENT):
        return "unexplained"
    if steps:
        return "missing-physics"
    return "parameters" if off > SEVERAL else "agrees"
