"""From recordings to a verdict: fit the paper's model, look for what it lacks, add it, and say how good that is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from drillenv.checks import InputError
from drillenv.diagnosis.candidates import FREED, FREED_LATE, SCANNED, SCANNED_JOINED, own_parameters, parameter, usual
from drillenv.diagnosis.condition import Conditioned, condition, lag, white_noise
from drillenv.diagnosis.fit import CONSTANTS, JOINED, NEARBY, Fit, Hypothesis, Parameter, Stage, Workers, fit, joined
from drillenv.diagnosis.screen import Score, screen
from drillenv.diagnosis.shape import Line, lines_left
from drillenv.diagnosis.shooting import Physics, Prediction, predict, residual, settle_states, window_costs
from drillenv.dynamics.effects import REGISTRY
from drillenv.recordings import Campaign, Recording
from drillenv.rig import Rig

ALONE = Stage(1e4, 10, 2)
"""How a model that is held is laid onto recordings, before its windows are joined."""
THIN = 4
"""Every fourth sample is enough to find a mechanism; all of them say how strong it is."""
CLOSE = 1.5
"""Sum of squares over samples below which a fit is close enough for the joints between windows to be used."""
MOST = 3
"""Mechanisms at once."""
RIVALS = 3
"""Mechanisms fitted for good at each step."""
WORTH = 0.2
"""Share of the best gain of the first look from which a mechanism is a rival."""
CLEAR = 0.6
"""A rival whose first look gains less than this share of one that left nothing but noise is not fitted for good."""
BEHIND = 0.1
"""Share of what such a one explains by which another, its windows still on their own, is too far behind to be
joined."""
LOOSE, SCANNING = (Stage(1e4, 4, 4),), (Stage(1e4, 6, 6),)
"""How a mechanism is fitted first, each window on its own: as a first look says, and from a scan."""
SCAN_ON, SCAN_ROUNDS, SCAN_BEST = 2, 3, 1
"""A scan compares strengths on so many recordings, with so many rounds for the states, and fits the best ones."""
FAR = 30.0
"""Sum of squares over samples above which it is not a mount that is missing: the scan would take long for nothing."""
MUCH = 0.01
"""Share of what the plain model leaves that a lag of several samples leaves at most, to be taken at once."""
SLACK = 8.0
"""Gain beyond that of the luckiest candidate that a mechanism has to bring, in half sums of squares of every fourth
sample: noise is never quite white, nor is another's friction quite this one's."""
SECOND = 25.0
"""The same for a mechanism beside others: what is left of those that is not quite their equation."""
NOTICED = 0.1
"""Share of what is left that a mechanism has to explain, where it does not explain all: less is mopping up, and each
further step costs more than all before."""
EQUAL = 10.0
"""Half a sum of squares by which two mechanisms must differ to be told apart."""
SEVERAL = 3.0
"""Standard deviations away from nominal at which a constant is wrong."""
BENT = 6.0
"""The same beside a named mechanism, from which the two do not go together."""
FLOOR = 1.04
"""Sum of squares over samples above which something is left."""
MOST_LEFT, SMALL_PART = 1.32, 0.1
"""A named mechanism whose equation is not quite that of the rig leaves something too: no more than this, and no more
than this share of what it was named to explain."""
QUIETER = 0.97
"""Share of the noise below which it is told anew from what is left."""

LINEAR = {
    "chi", "h", "soft", "s_r", "k3", "c2", "fc1", "fc2", "k_a", "m_c", "delay_e", "delay_f", "delay_a",
    "o_f", "o_a", "g",
}  # fmt: skip
"""Symbols whose strength grows from nothing in proportion to the probe."""
GRIPS = {"vs1"}
"""Symbols of the speed at which friction sets in that may turn out to be 0, of dry friction that grips. Not that of the
indenter: it grips in every period, and each jump of its acceleration across a sample spoils the derivatives."""
SQUARED = {"s"}
"""Symbols that act by their square."""


@dataclass(slots=True, eq=False)
class Step:
    """One mechanism added, or the attempt to."""

    mechanism: str
    gain: float
    """Half sum of squares."""
    threshold: float
    loosely: Fit
    """Without joints between the windows."""
    fitted: Fit
    rivals: dict[str, Fit] = field(default_factory=dict)
    """Fits of the mechanisms that these recordings cannot tell from it."""


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


def extended(now: Fit, score: Score, recordings: Sequence[Conditioned]) -> tuple[Hypothesis, np.ndarray]:
    """The fit's hypothesis with one mechanism more, and values to start from."""
    variant = score.variant
    mechanism, count = variant.mechanism, len(variant.probes)
    start = dict(variant.held)
    sizes = score.strengths.tolist()
    for i, probe in enumerate(() if variant.own else variant.probes):
        for symbol, value in probe:
            if symbol in LINEAR:
                start[symbol] = start.get(symbol, 0.0) + value * sizes[i]
            elif symbol in SQUARED:
                start[symbol] = value * math.sqrt(max(sizes[i], 0.0))
            elif symbol == "n":
                start[symbol] = 1.0 + (value - 1.0) * sizes[i]
            elif symbol not in start:
                start[symbol] = value
    if mechanism == "drive-harmonics":
        start = _polar(score.strengths)
    entries = {each.symbol: each for each in REGISTRY[mechanism].parameters}
    probed = () if variant.own else tuple(dict.fromkeys(name for probe in variant.probes for name, _ in probe))
    symbols = FREED.get(mechanism, probed)
    free = []
    for symbol in symbols:
        value = start[symbol]
        if symbol in LINEAR and entries[symbol].low >= 0.0:
            value = max(value, 0.5 * usual(mechanism, symbol)[0])
        free.append(parameter(mechanism, symbol, value))
    values = [each.value for each in free]
    held = tuple((name, value) for name, value in variant.held if name not in symbols)
    for i, data in enumerate(recordings):
        each = own_parameters(mechanism, data, score.strengths[count * i : count * (i + 1)] if variant.own else None)
        free += each
        values += [own.value for own in each]
    base = now.hypothesis
    count = len(base.constants)
    moved = now.values.copy()
    centre = np.array([each.value for each in base.constants])
    widths = np.array([each.width for each in base.constants])
    step = score.constants[:count] * widths
    moved[:count] = np.clip(now.values[:count] + step, centre - 4 * widths, centre + 4 * widths)
    hypothesis = Hypothesis(base.constants, (*base.effects, (mechanism, held, tuple(free))))
    return hypothesis, np.concatenate([moved, values])


def _polar(strengths: np.ndarray) -> dict[str, float]:
    """Amplitude and phase of two harmonics from their sine and cosine parts, in hundredths."""
    sine2, cosine2, sine3, cosine3 = (0.01 * strengths).tolist()
    return {
        "h2": math.hypot(sine2, cosine2),
        "phi2": math.atan2(cosine2, sine2),
        "h3": math.hypot(sine3, cosine3),
        "phi3": math.atan2(cosine3, sine3),
    }


def per_sample(fitted: Fit) -> float:
    """Sum of squares over samples; 1 where nothing but the noise is left."""
    return 2.0 * fitted.cost / sum(each.samples for each in fitted.quadratics)


def threshold(columns: int, chance: float, beside: bool) -> float:
    """Gain that a mechanism of so many free strengths has to bring, alone or beside others.

    ``chance`` is that of :func:`drillenv.diagnosis.screen.luck`.
    """
    return 0.5 * float(chi2.isf(chance, columns)) + (SECOND if beside else SLACK)


def replay(recordings: Sequence[Conditioned], hypothesis: Hypothesis, workers: Workers) -> Fit:
    """What a model makes of recordings with its constants and effects held.

    Only the states of the windows are fitted, and what each recording has for its own; the recordings say nothing to
    the constants.
    """
    effects = []
    for name, held, _free in hypothesis.effects:
        own = tuple(each for data in recordings for each in own_parameters(name, data))
        effects.append((name, held, own))
    alone = Hypothesis((), tuple(effects), hypothesis.base)
    apart = fit(recordings, alone, workers, stages=(ALONE,))
    return joined(recordings, alone, workers, apart.values, apart.states, apart)


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
        held = [i for i, each in enumerate(campaign.recordings) if each.use == "held-out"] or _held_out(data)
        fit_data = [each for i, each in enumerate(data) if i not in held]
        held_data = [each for i, each in enumerate(data) if i in held]
        thin = [each.thinned(THIN) for each in fit_data]
        say("fitting the paper's model")
        loosely = fit(thin, plain_hypothesis, workers, stages=(Stage(1e4, 8, 6),))
        plain = now = _tightened(thin, loosely, workers)
        steps: list[Step] = []
        rejected: list[tuple[str, float, str]] = []
        if per_sample(now) > FAR:
            chosen = [each for i, each in enumerate(campaign.recordings) if i not in held]
            step = _late(chosen, thin, rig, now, workers)
            if step is not None:
                steps.append(step)
                loosely, now = step.loosely, step.fitted
                say(f"{step.mechanism}: gain {step.gain:.0f}")
        # what acts on the shaker shows only where windows join
        hidden = per_sample(now) > FLOOR >= per_sample(loosely)
        for _look in range(2 * MOST):
            if len(steps) == MOST:
                break
            say(f"looking for what is missing ({per_sample(now):.3f} of the noise is left)")
            step, rejected, better = _next(thin, now, loosely, hidden, workers, say)
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
        if len(steps) > 1 and per_sample(now) > FLOOR:
            # more of them that do not bring the end nearer only mop up behind the first
            rejected += [(each.mechanism, each.gain, "leaves more than noise beside the others") for each in steps[1:]]
            del steps[1:]
            now = steps[0].fitted
        say("all samples")
        final = _full(fit_data, now, workers)
        quiet = quieted(fit_data, final)
        if quiet is not fit_data:
            fit_data, final = quiet, _full(quiet, final, workers)
        # a fit that is far off is laid onto all samples window by window, which would hide what shows at their joints
        left = max(per_sample(final), per_sample(now)) if per_sample(now) > CLOSE else per_sample(final)
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
                held_data, laid = quiet, replay(quiet, held_model, workers)
            after = per_sample(laid)
            before_held, more = _believed(held_data, nominal, laid.predictions, workers)
            pairs += more
        return Outcome(
            _verdict(final, steps, left, per_sample(plain), lines),
            plain,
            final,
            steps,
            rejected,
            fit_data,
            held_data,
            left,
            (before, before_held),
            after,
            pairs,
            lines,
        )
    finally:
        workers.close()


def _late(
    recordings: Sequence[Recording], thin: list[Conditioned], rig: Rig, plain: Fit, workers: Workers
) -> Step | None:
    """A lag of several samples, which throws every first guess off, so that no look around it would find it."""
    times = [data.phase + data.omega * np.arange(data.force.size * data.thin) / data.rate / data.thin for data in thin]
    lags = []
    for recording, data, angle in zip(recordings, thin, times, strict=True):
        force, acceleration = (recording.channels[name].samples for name in ("force", "acceleration"))
        size = min(angle.size, force.size)
        rate = data.rate * data.thin
        lags.append(lag(rig, data.setting, force[:size], acceleration[:size], angle[:size], rate))
    late, sample = float(np.median(lags)), 1.0 / (thin[0].rate * thin[0].thin)
    if abs(late) < 2.0 * sample or np.max(np.abs(np.array(lags) - late)) > sample:
        return None
    guessed = [condition(each, rig, late).thinned(THIN) for each in recordings]
    place = {"delay_a" if late > 0.0 else "delay_f": abs(late)}
    hypothesis, values = placed_at(plain.hypothesis, "channel-delay", place, thin)
    values[: len(plain.values)] = [each.value for each in plain.hypothesis.constants]
    try:
        tried = _try(
            thin, "channel-delay", hypothesis, values, [each.states for each in guessed], (Stage(1e4, 8, 6),), workers
        )
    except (InputError, np.linalg.LinAlgError):
        return None
    gain, needed = plain.cost - tried.fitted.cost, (1.0 - MUCH) * plain.cost
    return Step("channel-delay", gain, needed, tried.loosely, tried.fitted) if gain > needed else None


def _believed(
    recordings: Sequence[Conditioned], nominal: Hypothesis, found: Sequence[Prediction], workers: Workers
) -> tuple[float, list[tuple[Prediction, Prediction]]]:
    """Sum of squares over samples of what the lab believed, and its predictions beside those of what was found."""
    laid = replay([each.thinned(THIN) for each in recordings], nominal, workers)
    physics = nominal.physics(np.zeros(0))
    believed = workers.each(lambda data, states: predict(data, states, physics), recordings, laid.states)
    return per_sample(laid), list(zip(believed, found, strict=True))


def _held_out(data: Sequence[Conditioned]) -> list[int]:
    """Recordings to prove the result on: two of eight, of a rig that was running."""
    running = [i for i, each in enumerate(data) if not each.fresh]
    if len(data) < 5 or len(running) < 4:
        return []
    return [running[len(running) // 2], running[-2]] if len(data) >= 7 else [running[len(running) // 2]]


def _tightened(recordings: Sequence[Conditioned], loosely: Fit, workers: Workers) -> Fit:
    """The same hypothesis with the windows joined, where the fit is close enough for that."""
    if per_sample(loosely) > CLOSE:
        return loosely
    return joined(recordings, loosely.hypothesis, workers, loosely.values, loosely.states, loosely)


def _next(
    thin: list[Conditioned], now: Fit, loosely: Fit, hidden: bool, workers: Workers, say: Callable[[str], object]
) -> tuple[Step | None, list[tuple[str, float, str]], Fit]:
    """The mechanism to add, those passed over with the reason, and the fit without it, which may be better by now."""
    close, beside = per_sample(now) <= FLOOR, bool(now.hypothesis.effects)
    ranked, chance = _looks(thin, now, loosely, workers, close)
    rivals, passed = [], []
    for each in ranked:
        if each.gain <= threshold(len(each.scores[each.look].strengths), chance, beside):
            passed.append((each.mechanism, each.gain, "gains too little"))
        elif each.shares[each.look] >= WORTH and len(rivals) < RIVALS:
            rivals.append(each)
    if not rivals and (beside or not _softened(now)):
        return None, passed, now
    tried: list[Tried] = []
    winner: Rival | None = None
    worth = math.inf
    for rival in rivals:
        mechanism = rival.mechanism
        if winner is not None and rival.shares.get(winner.look, 0.0) < CLEAR:
            passed.append((mechanism, rival.gain, "explains less at first look"))
            continue
        say(f"trying {mechanism} (gain {rival.gain:.0f} at first look)")
        stages, start = LOOSE, loosely
        if hidden and not close:
            stages, start = JOINED, now if REGISTRY[mechanism].grips is None else loosely
        elif REGISTRY[mechanism].grips is None and rival.look == "joined" and per_sample(now) <= CLOSE:
            stages, start = NEARBY, now
        # where only the joints are wrong they have bent the constants, and the windows on their own have not
        look = "loose" if hidden and "loose" in rival.scores else rival.look
        hypothesis, values = extended(now if look == "joined" else loosely, rival.scores[look], thin)
        try:
            tried.append(_try(thin, mechanism, hypothesis, values, start.states, stages, workers, worth))
        except (InputError, np.linalg.LinAlgError) as error:
            passed.append((mechanism, rival.gain, f"cannot be followed: {error}"))
            continue
        if winner is None and per_sample(tried[-1].fitted) <= FLOOR:
            winner, best = rival, tried[-1].fitted.cost
            worth = best + max(EQUAL, BEHIND * (now.cost - best))
    tried.sort(key=lambda each: (per_sample(each.fitted) > CLOSE, each.fitted.cost))
    if tried and _noticed(now, tried[0].fitted) and not (hidden and per_sample(tried[0].fitted) > CLOSE):
        tried[0] = _onward(thin, tried[0], workers)
    if not beside and per_sample(now) < FAR:
        best = tried[0].fitted if tried else now
        if (hidden and per_sample(best) > FLOOR) or _softened(best):
            tried += _scan_joined(thin, now, workers, say)
        if rivals and not hidden and per_sample(best) > FLOOR:
            tried += _scan(thin, now, loosely, workers, say)
        tried.sort(key=lambda each: (per_sample(each.fitted) > CLOSE, each.fitted.cost))
    if not tried:
        return None, passed, now
    first = tried[0]
    now = _without(thin, now, first, workers)
    gain = now.cost - first.fitted.cost
    needed = threshold(len(first.fitted.hypothesis.parameters) - len(now.hypothesis.parameters), chance, beside)
    others = {each.mechanism: each.fitted for each in reversed(tried[1:]) if each.mechanism != first.mechanism}
    passed += [(name, now.cost - other.cost, "explains less") for name, other in others.items()]
    if gain <= needed:
        return None, [*passed, (first.mechanism, gain, "gains too little once fitted")], now
    if not _noticed(now, first.fitted):
        return None, [*passed, (first.mechanism, gain, "explains next to nothing of it")], now
    same = {name: other for name, other in others.items() if other.cost - first.fitted.cost < EQUAL}
    return Step(first.mechanism, gain, needed, first.loosely, first.fitted, same), passed, now


def _softened(fitted: Fit) -> bool:
    """Whether a fit that is close needs a spring softer than anybody believes: play passes for that."""
    return per_sample(fitted) <= CLOSE and _deviations(fitted)[CONSTANTS.index("stiffness")] < -SEVERAL


def _noticed(now: Fit, better: Fit) -> bool:
    """Whether a fit leaves nothing but noise, or explains a share worth having of what another leaves."""
    return per_sample(better) <= FLOOR or now.cost - better.cost > NOTICED * (now.cost - now.cost / per_sample(now))


class Rival(NamedTuple):
    """A mechanism that a first look puts forward."""

    mechanism: str
    scores: dict[str, Score]
    """Of its best variant in each look: joined, loose."""
    shares: dict[str, float]
    """Its gain as a share of the best one's, in each look."""

    @property
    def look(self) -> str:
        """That of its largest share."""
        return max(self.shares, key=lambda name: self.shares[name])

    @property
    def gain(self) -> float:
        """In that look, in half sums of squares."""
        return self.scores[self.look].gain


def _looks(thin: list[Conditioned], now: Fit, loosely: Fit, workers: Workers, close: bool) -> tuple[list[Rival], float]:
    """The mechanisms, those of the largest shares first, and the chance that all gains are held against.

    A fit that the joints have bent says little of what is missing inside the windows; the windows on their own say
    more of that, and nothing of what shows where they join. So such a fit is looked at both ways.
    """
    looks = {}
    if close or now is not loosely:
        looks["joined"] = screen(thin, now, workers, 1.0)
    if not close:
        looks["loose"] = screen(thin, loosely, workers, 30.0)
    found: dict[str, Rival] = {}
    for name, look in looks.items():
        # no channel runs ahead: that is what the others' variants are for
        ahead = [each.variant.mechanism == "channel-delay" and each.strengths[0] <= 0.0 for each in look.scores]
        scores = [each for each, early in zip(look.scores, ahead, strict=True) if not early]
        for score in scores:
            rival = found.setdefault(score.variant.mechanism, Rival(score.variant.mechanism, {}, {}))
            rival.scores.setdefault(name, score)
            rival.shares.setdefault(name, score.gain / max(scores[0].gain, 1e-9))
    ranked = sorted(found.values(), key=lambda each: -each.shares[each.look])
    return ranked, min(look.chance for look in looks.values())


def _without(thin: list[Conditioned], now: Fit, best: Tried, workers: Workers) -> Fit:
    """The fit without a mechanism, started from where the one with it ended, if that is better.

    A fit may have ended short of the best, and whatever is added then lets it go on: that is no gain of the mechanism.
    """
    if per_sample(best.fitted) > CLOSE or per_sample(now) > CLOSE:
        return now
    found, values, states = now, best.fitted.values[: len(now.values)], best.fitted.states
    try:
        for _again in range(3):
            closer = fit(thin, now.hypothesis, workers, values, states, NEARBY)
            if closer.cost > found.cost - 1.0:
                break
            found, values, states = closer, closer.values, closer.states
        if now.hypothesis.effects:
            other = joined(thin, now.hypothesis, workers, values, states)
            found = min(found, other, key=lambda each: each.cost)
    except (InputError, np.linalg.LinAlgError):
        pass
    return found


class Tried(NamedTuple):
    """A mechanism fitted beside what is already there."""

    mechanism: str
    loosely: Fit
    """Without joints between the windows."""
    fitted: Fit


def _try(
    thin: list[Conditioned],
    mechanism: str,
    hypothesis: Hypothesis,
    values: np.ndarray,
    states: Sequence[np.ndarray],
    stages: Sequence[Stage],
    workers: Workers,
    worth: float = math.inf,
) -> Tried:
    """Fit a mechanism.

    Windows that cost more than ``worth`` on their own are not joined, which costs more still.

    Raises:
        InputError: the motion cannot be followed.
        LinAlgError: the data say nothing of it.
    """
    late = {f"{mechanism} {symbol}" for symbol in FREED_LATE.get(mechanism, ())}
    if late:
        names = [each.name for each in hypothesis.parameters]
        first, kept = _holding(hypothesis, {name: values[names.index(name)] for name in late})
        begun = fit(thin, first, workers, values[kept], states, stages)
        values = values.copy()
        values[kept] = begun.values
        states, stages = begun.states, stages if stages[-1].settle else NEARBY
    if stages is JOINED:
        free = joined(thin, hypothesis, workers, values, states)
        return Tried(mechanism, free, free)
    free = fit(thin, hypothesis, workers, values, states, stages)
    done = not stages[-1].settle or free.cost > worth
    return Tried(mechanism, free, free if done else _tightened(thin, free, workers))


def _onward(thin: list[Conditioned], best: Tried, workers: Workers) -> Tried:
    """A mechanism whose fit leaves something or has bent the constants, from other places, or itself if none is better.

    It may have been short of rounds, or have been led astray by where the plain model ended.
    """
    off = np.abs(_deviations(best.fitted))
    if per_sample(best.fitted) <= FLOOR and off.max() <= SEVERAL:
        return best
    hypothesis, values = best.fitted.hypothesis, best.fitted.values.copy()
    values[: off.size] = [each.value for each in hypothesis.constants]
    ends = [best]
    try:
        if per_sample(best.fitted) > CLOSE:
            ends.append(_try(thin, best.mechanism, hypothesis, values, best.loosely.states, LOOSE, workers))
        else:
            onward = fit(thin, hypothesis, workers, stages=NEARBY, known=best.fitted)
            anew = joined(thin, hypothesis, workers, values, best.loosely.states)
            ends += [best._replace(fitted=onward), best._replace(fitted=anew)]
    except (InputError, np.linalg.LinAlgError):
        pass
    return min(ends, key=lambda each: (per_sample(each.fitted) > CLOSE, each.fitted.cost))


def _scan(thin: list[Conditioned], now: Fit, loosely: Fit, workers: Workers, say) -> list[Tried]:
    """Mechanisms that a first look cannot judge, each fitted from the best of several strengths."""
    found, few = [], slice(0, SCAN_ON)
    for mechanism, places in SCANNED.items():
        if mechanism in {name for name, _held, _free in now.hypothesis.effects}:
            continue
        say(f"scanning {mechanism}")
        costs = []
        for place in places:
            hypothesis, values = placed_at(now.hypothesis, mechanism, place, thin)
            try:
                physics = [hypothesis.physics(values, data.name) for data in thin[few]]
                costs.append(sum(workers.each(_settled_cost, thin[few], loosely.states[few], physics)))
            except (InputError, np.linalg.LinAlgError):
                costs.append(math.inf)
        best = [places[k] for k in np.argsort(costs)[:SCAN_BEST]]
        found += _from_places(thin, now, mechanism, best, loosely.states, SCANNING, workers)
    return found


def _scan_joined(thin: list[Conditioned], now: Fit, workers: Workers, say) -> list[Tried]:
    """Mechanisms that a first look cannot judge and that no window on its own shows."""
    found = []
    for mechanism, places in SCANNED_JOINED.items():
        say(f"scanning {mechanism}")
        for place in places:
            states = [
                _opened(own, now.hypothesis.physics(now.values, data.name), data, place)
                for data, own in zip(thin, now.states, strict=True)
            ]
            found += _from_places(thin, now, mechanism, (place,), states, JOINED, workers)
            if found and per_sample(found[-1].fitted) <= FLOOR:
                break
    return found


def _opened(states: np.ndarray, physics: Physics, data: Conditioned, place: Mapping[str, float]) -> np.ndarray:
    """States in which a spring that has play carries the force that it carried without."""
    k, opened = physics.rig.stiffness, states.copy()
    beyond = (states[:, 0] - physics.rig.static_force(data.setting)) / k > place["y0"]
    opened[beyond, 0] += k * place["g"]
    return opened


def _from_places(thin, now: Fit, mechanism: str, places, states, stages, workers: Workers) -> list[Tried]:
    """Fits of a mechanism from several strengths, up to the first that leaves nothing but noise."""
    found = []
    for place in places:
        try:
            hypothesis, values = placed_at(now.hypothesis, mechanism, place, thin)
            found.append(_try(thin, mechanism, hypothesis, values, states, stages, workers))
        except (InputError, np.linalg.LinAlgError):
            continue
        if per_sample(found[-1].fitted) <= FLOOR:
            break
    return found


def _settled_cost(data: Conditioned, states: np.ndarray, physics: Physics) -> float:
    """Half the sum of squares with the state of each window at its best."""
    states, made = settle_states(data, states, data.states, physics, SCAN_ROUNDS)
    return float(window_costs(data, states, data.states, made).sum())


def placed_at(
    hypothesis: Hypothesis, mechanism: str, place: Mapping[str, float], recordings: Sequence[Conditioned]
) -> tuple[Hypothesis, np.ndarray]:
    """A hypothesis with one mechanism more at given strengths, and values to start from."""
    own = tuple(each for data in recordings for each in own_parameters(mechanism, data))
    free = tuple(parameter(mechanism, symbol, value) for symbol, value in place.items()) + own
    extended = hypothesis._replace(effects=(*hypothesis.effects, (mechanism, (), free)))
    return extended, np.array([each.value for each in extended.parameters])


def _full(recordings: Sequence[Conditioned], now: Fit, workers: Workers) -> Fit:
    """The fit on all samples."""
    if per_sample(now) > CLOSE:
        return fit(recordings, now.hypothesis, workers, now.values, now.states, (Stage(1e4, 3, 1),))
    found = fit(recordings, now.hypothesis, workers, now.values, now.states, NEARBY)
    dry = {
        each.name: 0.0
        for each, value in zip(found.hypothesis.parameters, found.values, strict=True)
        # for finding friction the speed at which it sets in has a least value; where it ends there, it is dry
        if " " in each.name and each.symbol in GRIPS and value < 1.05 * each.low
    }
    if not dry:
        return found
    try:
        hypothesis, kept = _holding(found.hypothesis, dry)
        return min(
            found, fit(recordings, hypothesis, workers, found.values[kept], found.states, NEARBY), key=lambda f: f.cost
        )
    except (InputError, np.linalg.LinAlgError):
        return found


def _holding(hypothesis: Hypothesis, fixed: Mapping[str, float]) -> tuple[Hypothesis, np.ndarray]:
    """A hypothesis with some parameters of its effects held, by name, and which of the unknowns remain."""
    effects = []
    for name, held, free in hypothesis.effects:
        gone = tuple((each.symbol, fixed[each.name]) for each in free if each.name in fixed)
        effects.append((name, held + gone, tuple(each for each in free if each.name not in fixed)))
    kept = np.array([each.name not in fixed for each in hypothesis.parameters])
    return hypothesis._replace(effects=tuple(effects)), kept


def _deviations(fitted: Fit) -> np.ndarray:
    """How far the constants are from nominal, in standard deviations of what the lab believes."""
    constants = fitted.hypothesis.constants
    believed, widths = np.array([(each.value, each.width) for each in constants]).T
    return (fitted.values[: len(constants)] - believed) / widths


def _verdict(final: Fit, steps: Sequence[Step], left: float, plain: float, lines: Sequence[object]) -> str:
    """In one word, from what the final fit and the plain one leave."""
    bearable = FLOOR
    if steps:
        bearable = max(FLOOR, min(MOST_LEFT, 1.0 + SMALL_PART * (plain - 1.0)))
    off = np.abs(_deviations(final)).max()
    # a mechanism that needs constants nobody believes in stands for another one
    if left > bearable or lines or (steps and off > BENT):
        return "unexplained"
    if steps:
        return "missing-physics"
    return "parameters" if off > SEVERAL else "agrees"
