"""Which mechanism to add to a fit: first looks, the rivals that they put forward, and scans where they say nothing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from drillenv.checks import InputError
from drillenv.diagnosis.candidates import ALIKE, HIDDEN, SCANNED, SCANNED_JOINED, usual
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import (
    APART,
    CONSTANTS,
    JOINED,
    NEARBY,
    Fit,
    Hypothesis,
    Stage,
    Workers,
    fit,
    joined,
    scaled_change,
)
from drillenv.diagnosis.screen import Score, screen
from drillenv.diagnosis.shooting import (
    JOIN,
    Physics,
    Prediction,
    predict,
    quadratic,
    settle_states,
    sized,
    state_size,
    state_slopes,
    window_costs,
    with_constants,
)
from drillenv.diagnosis.starts import LINEAR, carried, extended, from_nothing, opened, placed_at
from drillenv.dynamics.effects import REGISTRY

THIN = 4
"""Every fourth sample is enough to find a mechanism; all of them say how strong it is."""
CLOSE = 1.5
"""Sum of squares over samples below which a fit is close enough for the joints between windows to be used."""
RIVALS = 3
"""Mechanisms fitted for good at each step."""
WORTH = 0.2
"""Share of the best gain of the first look from which a mechanism is a rival."""
CLEAR = 0.6
"""A rival whose first look gains less than this share of one that left nothing but noise is not fitted for good."""
PROMISING = 0.5
"""Share of what a fit leaves beyond the noise, of which a first look must explain so much that no scan comes before."""
BEHIND = 0.1
"""Share of what such a one explains by which another, its windows still on their own, is too far behind to be
joined."""
JOINED_BY_FORCE = (JOINED[0], JOINED[1]._replace(rounds=6))
"""How windows are joined only for a look, or to see how near a rival comes."""
LOOSE, SCANNING = (Stage(1e4, 4, 4),), (Stage(1e4, 6, 6),)
"""How a mechanism is fitted first, each window on its own: as a first look says, and from a scan."""
SCAN_ON, SCAN_ROUNDS = 2, 3
"""A scan compares strengths on so many recordings, with so many rounds for the states, and fits the best one."""
GAIN_STEP = 1e-3
"""Share of the drive's gain for the difference that says what another gain would bring."""
FORCED, BENT = 5.0, 2.0
"""Sum of squares over samples up to which windows that are not close enough are joined all the same, for a look from
there, and by what factor they may cost more then."""
FAR = 30.0
"""Sum of squares over samples above which it is not a mount that is missing: the scan would take long for nothing."""
MUCH = 0.01
"""Share of what the plain model leaves beyond the noise that a mechanism leaves at most, to be taken at once: no other
does as well."""
SLACK = 8.0
"""Gain beyond that of the luckiest candidate that a mechanism has to bring, in half sums of squares of every fourth
sample: noise is never quite white, nor is another's friction quite this one's."""
SECOND = 25.0
"""The same for a mechanism beside others: what is left of those that is not quite their equation."""
FAINT = 5.0
"""Standard deviations from nothing below which it is asked whether a mechanism is needed at all."""
NOTHING = 0.5
"""The same below which it is none: what it gained is of what came with it, as where a hardening spring lets a fresh rig
begin elsewhere."""
CERTAIN = 30.0
"""Times the gain that a mechanism has to bring from which, unless it is faint, it is not asked whether the fit without
it stopped short."""
NOTICED = 0.1
"""Share of what is left that a mechanism has to explain, where it does not explain all: less is mopping up, and each
further step costs more than all before."""
EQUAL = 10.0
"""Half a sum of squares by which two mechanisms must differ to be told apart."""
NEAR = 50.0
"""The same for two of which one may have stopped short of its best."""
UNUSUAL = 2.0
"""Times the largest usual strength from which a mechanism yields to one that does as well with less."""
SEVERAL = 3.0
"""Standard deviations away from nominal at which a constant is wrong."""
FLOOR = 1.04
"""Sum of squares over samples above which something is left."""


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


def threshold(columns: int, chance: float, beside: bool) -> float:
    """Gain that a mechanism of so many free strengths has to bring, alone or beside others.

    ``chance`` is that of :func:`drillenv.diagnosis.screen.luck`.
    """
    return 0.5 * float(chi2.isf(chance, columns)) + (SECOND if beside else SLACK)


def tightened(recordings: Sequence[Conditioned], loosely: Fit, workers: Workers) -> Fit:
    """The same hypothesis with the windows joined, where the fit is close enough for that."""
    if loosely.per_sample > CLOSE:
        return loosely
    return joined(recordings, loosely.hypothesis, workers, loosely.values, loosely.states, loosely)


def forced(recordings: Sequence[Conditioned], loosely: Fit, workers: Workers) -> Fit:
    """A fit that is not close enough, with its windows joined all the same; or itself, if that comes to nothing.

    What acts on the shaker shows where windows join, even beside something that shows everywhere.
    """
    if loosely.per_sample > FORCED:
        return loosely
    try:
        found = fit(recordings, loosely.hypothesis, workers, stages=JOINED_BY_FORCE, known=loosely)
    except (InputError, np.linalg.LinAlgError):
        return loosely
    return found if found.per_sample < BENT * loosely.per_sample else loosely


def late_step(thin: list[Conditioned], late: float, plain: Fit, workers: Workers) -> Step | None:
    """A lag of several samples in s, where it explains nearly everything: next to it nothing else can be seen."""
    place = {"delay_a" if late > 0.0 else "delay_f": abs(late)}
    hypothesis, values = placed_at(plain.hypothesis, "channel-delay", place, thin)
    values[: len(plain.values)] = [each.value for each in plain.hypothesis.constants]
    states = [each.states for each in thin]
    try:
        tried = _try(thin, "channel-delay", hypothesis, values, states, APART, workers)
    except (InputError, np.linalg.LinAlgError):
        return None
    gain, needed = plain.cost - tried.fitted.cost, (1.0 - MUCH) * plain.cost
    return Step("channel-delay", gain, needed, tried.loosely, tried.fitted) if gain > needed else None


class Place(NamedTuple):
    """Where a search stands."""

    thin: list[Conditioned]
    now: Fit
    loosely: Fit
    """The same hypothesis with each window on its own."""
    tight: Fit
    """With windows that join, by force where they are not close enough: see :func:`forced`."""
    workers: Workers
    say: Callable[[str], object]

    @property
    def beside(self) -> bool:
        """Whether mechanisms are named already."""
        return bool(self.now.hypothesis.effects)

    @property
    def close(self) -> bool:
        """Whether nothing is left."""
        return self.now.per_sample <= FLOOR

    @property
    def hidden(self) -> bool:
        """Whether what is left shows only where windows join, as does what acts on the shaker."""
        return self.loosely.per_sample <= FLOOR and self.now.per_sample > (CLOSE if self.beside else FLOOR)

    def without_and_with(self, tried: Tried) -> tuple[Fit, Fit]:
        """Fits without and with a mechanism that may be held against each other, their windows joined alike.

        Where neither can be joined and nothing is left inside the windows with it, these say what it is worth.
        """
        if tried.fitted.per_sample <= CLOSE:
            return self.now, tried.fitted
        if self.now.loose > 1.0:
            return self.now, tried.loosely
        if self.now.per_sample > CLOSE and tried.loosely.per_sample <= FLOOR < self.loosely.per_sample:
            return self.loosely, tried.loosely
        return self.now, tried.fitted


def next_step(
    thin: list[Conditioned], now: Fit, loosely: Fit, workers: Workers, say: Callable[[str], object]
) -> tuple[Step | None, list[tuple[str, float, str]], Fit]:
    """The mechanism to add, those passed over with the reason, and the fit without it, which may be better by now."""
    tight = forced(thin, loosely, workers) if now is loosely and now.per_sample > FLOOR else now
    place = Place(thin, now, loosely, tight, workers, say)
    ranked, chance = _looks(place)
    rivals, passed = [], []
    for each in ranked:
        if each.gain <= threshold(len(each.scores[each.look].strengths), chance, place.beside):
            passed.append((each.mechanism, each.gain, "gains too little"))
        elif each.shares[each.look] >= WORTH and len(rivals) < RIVALS:
            rivals.append(each)
        else:
            passed.append((each.mechanism, each.gain, "explains less at first look"))
    if not rivals and not (now.per_sample <= CLOSE and _weak(now, "stiffness")):
        return None, passed, now
    tried: list[Tried] = []
    if _weak(now, "drive_gain"):
        tried += _scan("force-limit", place)
        if any(each.fitted.per_sample - 1.0 < MUCH * (now.per_sample - 1.0) for each in tried):
            rivals = []
    scanned = place.hidden and place.beside and not _promising(place, rivals, "joined")
    if scanned:
        tried += _scan_joined(HIDDEN, place, enough=FLOOR)
        if any(each.fitted.per_sample <= FLOOR for each in tried):
            there = [each.mechanism for each in tried]
            clear = [each for each in rivals if each.shares[each.look] >= CLEAR and each.mechanism not in there]
            rivals = [each for each in clear if not _wrong_way(each.scores[each.look])]
    swings = bool(rivals) and loosely.per_sample > FLOOR and not _promising(place, rivals, "loose")
    if swings:
        tried += _scan("rock-mount-compliance", place)
        if any(each.fitted.per_sample <= CLOSE for each in tried):
            rivals = []
    tried += _try_rivals(place, rivals, passed)
    tried.sort(key=_order)
    # where nothing is left inside the windows, what is left is not a fit that stopped short
    settled = bool(tried) and tried[0].fitted.per_sample > CLOSE
    settled = settled and (place.hidden or tried[0].loosely.per_sample <= FLOOR)
    pushed = None
    if tried and _noticed(*place.without_and_with(tried[0])) and not settled:
        pushed = tried[0] = _onward(thin, tried[0], workers)
        tried = _with_its_like(tried, place)
    without, best = place.without_and_with(tried[0]) if tried else (now, now)
    scans = not (place.beside or scanned) and best.per_sample > FLOOR
    if scans and place.hidden and now.per_sample < FAR:
        tried += _scan_joined(HIDDEN, place)
    elif best.per_sample <= CLOSE and _weak(best, "stiffness") and now.per_sample < FAR:
        tried += _scan_joined(("backlash",), place)
    if rivals and not (settled or swings) and loosely.per_sample > FLOOR:
        # beside others everything explains a little
        scans = without.cost - best.cost < PROMISING * _excess(without) if place.beside else scans
        tried += _scan("rock-mount-compliance", place) if scans else []
    tried.sort(key=_order)
    if not tried:
        return None, passed, now
    if tried[0] is not pushed and not settled:
        tried[0] = _onward(thin, tried[0], workers)
    tried = _to_their_ends(thin, _with_its_like(tried, place), workers)
    equals = [each for each in tried if each.fitted.cost - tried[0].fitted.cost < EQUAL]
    first = next((each for each in equals if _usual(each)), tried[0])
    needed = threshold(len(first.fitted.hypothesis.parameters) - len(now.hypothesis.parameters), chance, place.beside)
    without, better = place.without_and_with(first)
    strengths = from_nothing(first.fitted, first.mechanism)
    if max(strengths, default=0.0) < FAINT or without.cost - better.cost < CERTAIN * needed:
        place = place._replace(now=_without(thin, now, first, workers))
        without, better = place.without_and_with(first)
    gain = without.cost - better.cost
    others = {each.mechanism: each.fitted for each in reversed(tried) if each.mechanism != first.mechanism}
    passed += [(name, place.now.cost - other.cost, "explains less") for name, other in others.items()]
    if gain <= needed:
        return None, [*passed, (first.mechanism, gain, "gains too little once fitted")], place.now
    if strengths and max(strengths) < NOTHING:
        return None, [*passed, (first.mechanism, gain, "is none once fitted")], place.now
    if not _noticed(without, better):
        return None, [*passed, (first.mechanism, gain, "explains next to nothing of it")], place.now
    same = {name: other for name, other in others.items() if other.cost - first.fitted.cost < EQUAL}
    return Step(first.mechanism, gain, needed, first.loosely, first.fitted, same), passed, place.now


def _with_its_like(tried: list[Tried], place: Place) -> list[Tried]:
    """The same, the best first, with what passes for the best from where that one ended, if it has not come near it."""
    best = tried[0].fitted
    if tried[0].mechanism not in ALIKE or best.per_sample > CLOSE:
        return tried
    alike, strengths = ALIKE[tried[0].mechanism]
    had = [each for each in tried if each.mechanism == alike]
    if tried[0].alike or any(each.alike or each.fitted.cost - best.cost < NEAR for each in had):
        return tried
    place.say(f"trying {alike} in place of {tried[0].mechanism}")
    named = zip(best.hypothesis.parameters, best.values, strict=True)
    own = {each.symbol: float(value) for each, value in named if each.mechanism == tried[0].mechanism}
    hypothesis, values = placed_at(place.now.hypothesis, alike, strengths(own), place.thin)
    before = len(place.now.hypothesis.parameters)
    values[:before] = best.values[:before]
    try:
        # one that comes near will be followed to its end
        stages = JOINED if REGISTRY[alike].grips is not None else JOINED_BY_FORCE
        other = _try(place.thin, alike, hypothesis, values, best.states, stages, place.workers)
    except (InputError, np.linalg.LinAlgError):
        return tried
    return sorted([*tried, other._replace(alike=True)], key=_order)


def _to_their_ends(thin: list[Conditioned], tried: list[Tried], workers: Workers) -> list[Tried]:
    """The same, the best first, where those that come near to the best one are fitted for as long as they gain."""
    near = [each for each in tried if each.fitted.cost - tried[0].fitted.cost < NEAR]
    if len({each.mechanism for each in near}) == 1 or tried[0].fitted.per_sample > CLOSE:
        return tried
    ended = list(tried)
    for i, each in enumerate(tried[: len(near)]):
        for _again in range(3):
            try:
                further = fit(thin, each.fitted.hypothesis, workers, stages=NEARBY, known=ended[i].fitted)
            except (InputError, np.linalg.LinAlgError):
                break
            gained = ended[i].fitted.cost - further.cost
            ended[i] = ended[i]._replace(fitted=further)
            if gained < 1.0:
                break
    return sorted(ended, key=_order)


def _try_rivals(place: Place, rivals: Sequence[Rival], passed: list[tuple[str, float, str]]) -> list[Tried]:
    """Rivals fitted for good; those that are not go to ``passed``, with the reason."""
    thin, now, loosely, tight, workers, say = place
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
        if place.hidden:
            stages, start = JOINED, now if REGISTRY[mechanism].grips is None else loosely
        elif REGISTRY[mechanism].grips is None and rival.look == "joined" and now.per_sample <= CLOSE:
            stages, start = NEARBY, now
        # where only the joints are wrong they have bent the constants, and the windows on their own have not
        look = "loose" if place.hidden and "loose" in rival.scores else rival.look
        hypothesis, values = extended(tight if look == "joined" else loosely, rival.scores[look], thin)
        try:
            tried.append(_try(thin, mechanism, hypothesis, values, start.states, stages, workers, worth))
        except (InputError, np.linalg.LinAlgError) as error:
            passed.append((mechanism, rival.gain, f"cannot be followed: {error}"))
            continue
        if winner is None and tried[-1].fitted.per_sample <= FLOOR:
            winner, best = rival, tried[-1].fitted.cost
            worth = best + max(EQUAL, BEHIND * (now.cost - best))
        elif winner is None and tried[-1].loosely.per_sample <= FLOOR < loosely.per_sample:
            # nothing is left inside the windows: what else there is acts on the shaker, and comes next
            winner = rival
    return tried


def _promising(place: Place, rivals: Sequence[Rival], look: str) -> bool:
    """Whether a first look, where the windows join or with each on its own, explains most of what is left."""
    scores = [each.scores[look] for each in rivals if look in each.scores]
    gains = [each.gain for each in scores if not _wrong_way(each)]
    return max(gains, default=0.0) > PROMISING * _excess(place.now)


def _weak(fitted: Fit, constant: str) -> bool:
    """Whether a fit needs a constant weaker than anybody believes.

    Play passes for a soft spring, a limit of the drive's force for a weak drive.
    """
    return fitted.deviations[CONSTANTS.index(constant)] < -SEVERAL


def _excess(fitted: Fit) -> float:
    """Half the sum of squares that a fit leaves beyond the noise."""
    return fitted.cost - fitted.cost / fitted.per_sample


def _noticed(without: Fit, better: Fit) -> bool:
    """Whether a fit leaves nothing but noise, or explains a share worth having of what is left without."""
    return better.per_sample <= FLOOR or without.cost - better.cost > NOTICED * _excess(without)


def _usual(tried: Tried) -> bool:
    """Whether no strength of a mechanism is far above what is usual."""
    found = zip(tried.fitted.hypothesis.parameters, tried.fitted.values, strict=True)
    return all(
        abs(value) <= UNUSUAL * max(abs(limit) for limit in usual(tried.mechanism, each.symbol))
        for each, value in found
        if each.mechanism == tried.mechanism and each.symbol in LINEAR
    )


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


def _looks(place: Place) -> tuple[list[Rival], float]:
    """The mechanisms, those of the largest shares first, and the chance that all gains are held against.

    A fit that the joints have bent says little of what is missing inside the windows; the windows on their own say
    more of that, and nothing of what shows where they join. So such a fit is looked at both ways.
    """
    looks = {}
    if place.close or place.tight is not place.loosely:
        looks["joined"] = screen(place.thin, place.tight, place.workers, 1.0)
    if not place.close:
        looks["loose"] = screen(place.thin, place.loosely, place.workers, 30.0)
    found: dict[str, Rival] = {}
    for name, look in looks.items():
        # a strength that would have to be negative may turn round once fitted, but not a channel that runs ahead
        scores = [each for each in look.scores if not (_wrong_way(each) and each.variant.mechanism == "channel-delay")]
        for score in scores:
            rival = found.setdefault(score.variant.mechanism, Rival(score.variant.mechanism, {}, {}))
            rival.scores.setdefault(name, score)
            rival.shares.setdefault(name, score.gain / max(scores[0].gain, 1e-9))
    ranked = sorted(found.values(), key=lambda each: (_wrong_way(each.scores[each.look]), -each.shares[each.look]))
    return ranked, min(look.chance for look in looks.values())


def _without(thin: list[Conditioned], now: Fit, best: Tried, workers: Workers) -> Fit:
    """The fit without a mechanism, started from where the one with it ended, if that is better.

    A fit may have ended short of the best, and whatever is added then lets it go on: that is no gain of the mechanism.
    """
    if best.fitted.per_sample > CLOSE or now.per_sample > CLOSE:
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


def _wrong_way(score: Score) -> bool:
    """Whether it would have to act backwards: a channel that runs ahead, friction that drives, a limit that adds."""
    moved = [symbol for probe in score.variant.probes for symbol, _size in probe]
    if len(moved) > 1:
        return False
    entry = REGISTRY[score.variant.mechanism].parameter(moved[0])
    return entry.neutral in (entry.low, entry.high) and float(score.strengths[0]) <= 0.0


class Tried(NamedTuple):
    """A mechanism fitted beside what is already there."""

    mechanism: str
    loosely: Fit
    """Without joints between the windows."""
    fitted: Fit
    alike: bool = False
    """Whether it began where another ended that passes for it."""


def _order(tried: Tried) -> tuple[bool, float]:
    """To sort by, the best first. Windows that could not be joined cost less than they would."""
    return tried.fitted.per_sample > CLOSE, tried.fitted.cost


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
    if stages is JOINED:
        free = joined(thin, hypothesis, workers, values, states)
        return Tried(mechanism, free, free)
    free = fit(thin, hypothesis, workers, values, states, stages)
    done = not stages[-1].settle or free.cost > worth
    return Tried(mechanism, free, free if done else tightened(thin, free, workers))


def _onward(thin: list[Conditioned], best: Tried, workers: Workers) -> Tried:
    """A mechanism whose fit leaves something or has bent the constants, from other places, or itself if none is better.

    It may have been short of rounds, or have been led astray by where the plain model ended.
    """
    off = np.abs(best.fitted.deviations)
    if best.fitted.per_sample <= FLOOR and off.max() <= SEVERAL:
        return best
    hypothesis, values = best.fitted.hypothesis, best.fitted.values.copy()
    values[: off.size] = [each.value for each in hypothesis.constants]
    ends = [best]
    try:
        if best.fitted.per_sample > CLOSE:
            ends.append(_try(thin, best.mechanism, hypothesis, values, best.loosely.states, LOOSE, workers))
        else:
            onward = fit(thin, hypothesis, workers, stages=NEARBY, known=best.fitted)
            anew = joined(thin, hypothesis, workers, values, best.loosely.states)
            ends += [best._replace(fitted=onward), best._replace(fitted=anew)]
    except (InputError, np.linalg.LinAlgError):
        pass
    return min(ends, key=_order)


def _scan(mechanism: str, place: Place) -> list[Tried]:
    """A mechanism that a first look cannot judge, fitted from the best of several strengths.

    None if it is there already, or if none of them, the states settled, leaves noticeably less than the fit without it.
    """
    thin, now, loosely, _tight, workers, say = place
    if mechanism in now.hypothesis.mechanisms:
        return []
    say(f"scanning {mechanism}")
    data, places = thin[:SCAN_ON], SCANNED[mechanism]
    # what resonates near the excitation hides behind a gain that is a little off; a limit is a weaker drive itself
    settled_cost = _settled_cost if mechanism == "force-limit" else _settled_cost_at_best_gain

    def cost(hypothesis: Hypothesis, values: np.ndarray, states: Sequence[np.ndarray]) -> float:
        try:
            physics = [hypothesis.physics(values, each.name) for each in data]
            return sum(workers.each(settled_cost, data, states[:SCAN_ON], physics))
        except (InputError, np.linalg.LinAlgError):
            return math.inf

    without = cost(now.hypothesis, loosely.values, loosely.states)
    # a fit that is far off has led the states off too, and what was measured has not
    states = [each.states for each in thin] if loosely.per_sample > FAR else loosely.states
    costs = [cost(*placed_at(now.hypothesis, mechanism, there, thin), states) for there in places]
    noise = sum(each.judged.stop - each.judged.start for each in data)
    if not math.isfinite(without) or without - min(costs) < NOTICED * (without - noise):
        return []
    hypothesis, values = placed_at(now.hypothesis, mechanism, places[int(np.argmin(costs))], thin)
    try:
        return [_try(thin, mechanism, hypothesis, values, states, SCANNING, workers)]
    except (InputError, np.linalg.LinAlgError):
        return []


def _scan_joined(mechanisms: Sequence[str], place: Place, enough: float = 0.0) -> list[Tried]:
    """Mechanisms that a first look cannot judge and that no window on its own shows, until one leaves ``enough``.

    Play opens the spring at the force that it carried without. Under dry friction each window goes on where the one
    before ended, for the windows on their own do not say when the shaker stands still.
    """
    thin, now, loosely, _tight, workers, say = place
    found = []
    for mechanism in mechanisms:
        if mechanism in now.hypothesis.mechanisms or any(each.fitted.per_sample <= enough for each in found):
            continue
        say(f"scanning {mechanism}")
        for there in SCANNED_JOINED[mechanism]:
            try:
                hypothesis, values = placed_at(now.hypothesis, mechanism, there, thin)
                if mechanism == "backlash":
                    # the spring of the plain fit stands for stiffness and play, and gives way as far as both do
                    pairs = zip(thin, now.states, strict=True)
                    states = [opened(own, now.physics(data.name), data, there) for data, own in pairs]
                else:
                    values[: len(loosely.values)] = loosely.values
                    states = loosely.states
                    if REGISTRY[mechanism].grips is not None:
                        physics = [hypothesis.physics(values, data.name) for data in thin]
                        states = workers.each(carried, states, physics, thin)
                found.append(_try(thin, mechanism, hypothesis, values, states, JOINED, workers))
            except (InputError, np.linalg.LinAlgError):
                continue
    return found


def _settled_cost(data: Conditioned, states: np.ndarray, physics: Physics) -> float:
    """Half the sum of squares with the state of each window at its best."""
    settled, made = _settled(data, states, physics)
    return float(window_costs(data, settled, made).sum())


def _settled_cost_at_best_gain(data: Conditioned, states: np.ndarray, physics: Physics) -> float:
    """Half the sum of squares with each window's state and the recording's gain of the drive at their best.

    The gain to first order, whatever is believed of it.
    """
    settled, made = _settled(data, states, physics)
    stronger = with_constants(physics, ["drive_gain"], [(1.0 + GAIN_STEP) * physics.rig.drive_gain])
    channels, ends = scaled_change(data, predict(data, settled, stronger), made, 1.0)
    slopes = state_slopes(data, settled, physics, made)
    near = quadratic(data, settled, made, slopes, channels[None], ends[None], JOIN * LOOSE[0].loose)
    gained = 0.5 * float(near.gradient[0]) ** 2 / max(float(near.curvature[0, 0]), 1e-9)
    return float(window_costs(data, settled, made).sum()) - gained


def _settled(data: Conditioned, states: np.ndarray, physics: Physics) -> tuple[np.ndarray, Prediction]:
    size = state_size(each.effect.name for each in physics.motion)
    return settle_states(data, sized(data, states, size), physics, SCAN_ROUNDS)
