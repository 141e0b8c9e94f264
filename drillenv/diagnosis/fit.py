"""Fitting constants and effects to all recordings at once: Gauss and Newton over the quadratics of shooting.py."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import InputError
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.shooting import (
    JOIN,
    KEPT,
    STATE_STEPS,
    Motion,
    Physics,
    Prediction,
    Quadratic,
    Slopes,
    channel_change,
    drive_phase,
    first_guess,
    first_joint,
    held_in,
    joints,
    move,
    predict,
    quadratic,
    sensed,
    settle_states,
    sized,
    slope_fineness,
    split_effects,
    state_size,
    state_slopes,
    window_costs,
    with_constants,
)
from drillenv.dynamics.effects import ON_SHAKER, REGISTRY, Chosen, make
from drillenv.dynamics.survey import allowed_cores
from drillenv.rig import Rig
from drillenv.rocks import Rock

UNITS = {
    "shaker_mass": "kg",
    "indenter_mass": "kg",
    "stiffness": "N/m",
    "damping": "N*s/m",
    "drive_gain": "1",
    "pressure_gain": "1",
    "loading_stiffness": "N/m",
    "unloading_stiffness": "N/m",
}
"""SI units of the constants."""
CONSTANTS = tuple(UNITS)
BEGUN = "N0"
"""Symbol for the first extra state of an effect as a recording of a running rig begins."""
STEP = 0.02
"""Standard deviations by which a constant is moved for its derivative."""
PLAY = "backlash g"
"""Is moved back as far as the states move the spring on: beyond its play a rig feels nothing of how wide it is, and the
difference of two unlike steps would be taken for a feeling."""
SCALES = frozenset({"k_a", "tau"})
"""Symbols of strengths that act together and are never nothing: of air that is soon supplied again no more than
k_a tau is known."""
LONGEST = 1.0
"""Longest step of their logarithms."""
CONVERGED, CRAWLING = 0.3, 0.04
"""A round that lowers half the sum of squares by less than this, or than this share of what it is above the noise's,
ends a stage."""
ROUGHLY, EXACTLY = 3.0, 0.03
"""The same for the first: where each window is fitted on its own, which is only to find from where to join them, and
for what a report says. A strength may be short of its best by the root of twice as much, in standard deviations."""

ASTRAY, LEFT_OUT = 4.0, 1.5
"""Half a sum of squares over the samples of a window, 1 of noise alone, from which it may have been led astray: as a
fit begins, and as one ends that has few such windows."""
AT_LEAST = 1.05
"""Times its least value below which a parameter is there."""
RESCUE = 6
"""Rounds for a window that is begun anew."""


class Stage(NamedTuple):
    """A part of a fit."""

    loose: float
    """Factor on the width of the joints between windows."""
    settle: int
    """Rounds in which each window's state is fitted on its own after every step of the parameters; 0 for none."""
    rounds: int
    """Steps of the parameters at most."""
    exact: bool = False
    """Whether what it comes to is what a report says."""

    @property
    def converged(self) -> float:
        """Half a sum of squares that is not worth a round."""
        return EXACTLY if self.exact else ROUGHLY if self.settle else CONVERGED


JOINED = (Stage(10.0, 0, 4), Stage(1.0, 0, 16))
"""From windows fitted each on its own."""
APART = (Stage(1e4, 8, 6),)
"""Each window on its own, from first guesses."""
FROM_AFAR = (*APART, *JOINED)
"""From first guesses: the joints come last, when the constants are nearly right."""
NEARBY = (Stage(1.0, 0, 8),)
"""From a fit of nearly the same hypothesis."""
FINAL = (Stage(1.0, 0, 8, exact=True),)
"""The same on all samples."""


class Parameter(NamedTuple):
    """An unknown of the fit besides the windows' states."""

    name: str
    """A constant, or effect and symbol as in "contact-rate chi"."""
    value: float
    """Where it starts: nominal for a constant."""
    width: float
    """Unit in which it is counted: the prior's standard deviation for a constant, a typical strength for an effect."""
    prior: float
    """Weight of the prior: 1 over the square of its standard deviation in widths, 0 for none."""
    low: float = -np.inf
    high: float = np.inf
    recording: str = ""
    """The only recording that it has to do with; empty where it holds for all."""

    @property
    def mechanism(self) -> str:
        """Of an effect's parameter, as in "contact-rate"."""
        return self.name.split(" ")[0]

    @property
    def symbol(self) -> str:
        """Of an effect's parameter, as in "chi"."""
        return self.name.split(" ")[1]

    def at_least(self, value: float) -> bool:
        """Whether a value is its least one, which is there for the fit's sake and above nothing."""
        return self.low > 0.0 and value < AT_LEAST * self.low


class Hypothesis(NamedTuple):
    """Constants and effects to fit: the plain model where there are no effects."""

    constants: tuple[Parameter, ...]
    effects: tuple[tuple[str, tuple[tuple[str, float], ...], tuple[Parameter, ...]], ...] = ()
    """(effect, parameters held at a value, parameters to fit)."""
    base: Physics = Physics(Rig(), Rock(1e7, 1e7))
    """What the constants and effects are put into."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All unknowns in order."""
        return self.constants + tuple(each for _name, _held, free in self.effects for each in free)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Names of its effects."""
        return tuple(name for name, _held, _free in self.effects)

    def acting_on(self, recording: str) -> np.ndarray:
        """Indices of the parameters that have to do with a recording."""
        named = [i for i, each in enumerate(self.parameters) if each.recording in ("", recording)]
        return np.array(named, dtype=np.int64)

    def physics(self, values: np.ndarray, recording: str = "") -> Physics:
        """The model at values (p,) of the parameters, as it was in a recording."""
        names = [each.name for each in self.constants]
        made = with_constants(self.base, names, list(values[: len(names)]))
        at = len(names)
        chosen: list[Chosen] = []
        begun = list(made.begun)
        for name, held, free in self.effects:
            symbols = dict(held)
            for each in free:
                if each.recording in ("", recording):
                    symbols[each.symbol] = float(values[at])
                at += 1
            begun += [(name, symbols.pop(BEGUN))] if BEGUN in symbols else []
            chosen.append(make(name, **polar(symbols)))
        motion, sensors = split_effects(chosen)
        return made._replace(motion=(*made.motion, *motion), sensors=(*made.sensors, *sensors), begun=tuple(begun))

    def held_at(self, values: np.ndarray) -> Hypothesis:
        """The same at fixed values, but for what is each recording's own; that starts anew."""
        effects, at = [], len(self.constants)
        for name, held, free in self.effects:
            fixed = dict(held)
            for each in free:
                if not each.recording:
                    fixed[each.symbol] = float(values[at])
                at += 1
            effects.append((name, tuple(fixed.items()), ()))
        names = [each.name for each in self.constants]
        base = with_constants(self.base, names, list(values[: len(names)]))
        return Hypothesis((), tuple(effects), base)


def polar(symbols: dict[str, float]) -> dict[str, float]:
    """Symbols of an effect, with ``sine_x`` and ``cosine_x`` made into amplitude b_x and phase psi_x."""
    result = {name: value for name, value in symbols.items() if not name.startswith(("sine_", "cosine_"))}
    for name in symbols:
        if name.startswith("sine_"):
            channel = name.removeprefix("sine_")
            sine, cosine = symbols[name], symbols[f"cosine_{channel}"]
            result[f"b_{channel}"] = math.hypot(sine, cosine)
            result[f"psi_{channel}"] = math.atan2(cosine, sine)
    return result


@dataclass(slots=True, eq=False)
class Fit:
    """A fitted hypothesis."""

    hypothesis: Hypothesis
    values: np.ndarray
    """(p,) of the parameters."""
    states: list[np.ndarray]
    """(windows, 4 to 7) of each recording."""
    predictions: list[Prediction]
    quadratics: list[Quadratic]
    """About the values, in widths."""
    slopes: list[Slopes]
    columns: list[tuple[np.ndarray, np.ndarray]]
    """(q, 2, n) and (q, windows, 4 to 7) of each recording: answers to the q parameters that act on it."""
    places: list[np.ndarray]
    """(q,) of each recording: which parameters these are."""
    cost: float
    """Half the sum of squares with the priors."""
    rounds: int
    loose: float
    """Factor on the width of the joints between windows with which it ended; 1 where they join."""

    def physics(self, recording: str = "") -> Physics:
        """The fitted model, as it was in a recording."""
        return self.hypothesis.physics(self.values, recording)

    @property
    def per_sample(self) -> float:
        """Sum of squares over samples; 1 where nothing but the noise is left."""
        return 2.0 * self.cost / sum(each.samples for each in self.quadratics)

    @property
    def deviations(self) -> np.ndarray:
        """How far each constant is from nominal, in standard deviations of what the lab believes."""
        constants = self.hypothesis.constants
        believed, widths = np.array([(each.value, each.width) for each in constants]).T
        return (self.values[: len(constants)] - believed) / widths

    @property
    def spread(self) -> np.ndarray:
        """(p,) standard deviations of the parameters: from the noise, or, if larger, as the recordings disagree.

        The second is the jackknife's, leaving out one recording at a time (B. Efron, The jackknife, the bootstrap and
        other resampling plans, SIAM, 1982). It knows of what the noise does not: that a model is never quite right.
        A parameter at a least value that is there for the fit's sake may be anything below, and the others with it.
        """
        return self.spread_beside(np.zeros(self.values.size, dtype=bool))

    def spread_beside(self, held: np.ndarray) -> np.ndarray:
        """The same, with the parameters ``held`` (p,) known to be what they are; of these 0."""
        parameters, count, free = self.hypothesis.parameters, len(self.quadratics), ~held
        widths = np.array([each.width for each in parameters])
        prior = np.array([each.prior for each in parameters])
        total = sum_quadratics(self.quadratics, self.places, prior.size)[1]
        # what the recordings say nothing of is a thousand widths wide
        covariance = np.linalg.inv((total + np.diag(prior + 1e-6))[np.ix_(free, free)])
        covariance *= widths[free, None] * widths[None, free]
        found = np.zeros(prior.size)
        found[free] = np.sqrt(np.diag(covariance) + self._below(covariance, free) ** 2)
        shared = free & np.array([not each.recording for each in parameters])
        if count < 3 or not shared.any():
            return found
        pulled = prior * (self.values - np.array([each.value for each in parameters])) / widths
        moved = []
        for out in range(count):
            parts = [each for i, each in enumerate(self.quadratics) if i != out]
            places = [each for i, each in enumerate(self.places) if i != out]
            gradient, curvature = sum_quadratics(parts, places, prior.size)
            moved.append(
                np.linalg.solve((curvature + np.diag(prior + 1e-9))[np.ix_(free, free)], (gradient - pulled)[free])
            )
        apart = np.zeros(prior.size)
        apart[free] = np.std(moved, axis=0) * math.sqrt(count - 1) * widths[free]
        return np.where(shared, np.maximum(found, apart), found)

    def _below(self, covariance: np.ndarray, free: np.ndarray) -> np.ndarray:
        """How far the ``free`` parameters would be off if those at their least value were at 0, root mean square."""
        squares = np.zeros(len(covariance))
        for row, i in enumerate(np.flatnonzero(free).tolist()):
            each = self.hypothesis.parameters[i]
            if not each.recording and each.at_least(self.values[i]):
                # as likely anywhere between
                squares += (covariance[:, row] / covariance[row, row] * each.low) ** 2 / 3.0
        return np.sqrt(squares)


def sum_quadratics(
    parts: Sequence[Quadratic], places: Sequence[np.ndarray], size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (size,) and curvature (size, size) of all recordings together, each over its own places."""
    gradient, curvature = np.zeros(size), np.zeros((size, size))
    for part, place in zip(parts, places, strict=True):
        gradient[place] += part.gradient
        curvature[np.ix_(place, place)] += part.curvature
    return gradient, curvature


class Workers:
    """Threads over recordings: the kernels hold no lock."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(allowed_cores())

    def each(self, work: Callable[..., Any], *lists: Sequence[Any]) -> list[Any]:
        """``work`` of every recording."""
        return list(self._pool.map(work, *lists))

    def close(self) -> None:
        """Let the threads go."""
        self._pool.shutdown()


def scaled_change(data: Conditioned, moved: Prediction, base: Prediction, step: float):
    """(2, n) change of the scaled channels and (windows, size) of the ends, per ``step``."""
    return channel_change(data, moved, base, step), (moved.ends - base.ends) / step


def columns_for(data: Conditioned, states: np.ndarray, hypothesis: Hypothesis, values: np.ndarray, base: Prediction):
    """Answers of one recording to every parameter that acts on it, per width, about where the model says ``base``."""
    acting = hypothesis.acting_on(data.name)
    here = hypothesis.physics(values, data.name)
    fine = slope_fineness(data, here.sensors)
    still: Motion | None = None
    if fine > 1:
        still = move(data, states, here, fine)
        base = sensed(data, still, here)
    channels = np.empty((acting.size, 2, data.force.size))
    ends = np.empty((acting.size, *states.shape))
    for row, j in enumerate(acting.tolist()):
        each = hypothesis.parameters[j]
        step = STEP if values[j] + STEP * each.width <= each.high else -STEP
        if each.name == PLAY:
            step = -STATE_STEPS[0] / (here.rig.stiffness * each.width)
        moved = values.copy()
        moved[j] += step * each.width
        physics = hypothesis.physics(moved, data.name)
        if physics._replace(sensors=here.sensors) == here and drive_phase(data, physics) == drive_phase(data, here):
            # what only a sensor feels leaves the motion as it is
            still = move(data, states, here, fine) if still is None else still
            said = sensed(data, still, physics)
        else:
            said = predict(data, states, physics, fine=fine)
        channels[row], ends[row] = scaled_change(data, said, base, step)
    return channels, ends


def plain_cost(data: Conditioned, states: np.ndarray, made: Prediction, join: np.ndarray) -> float:
    """Half the sum of squares of one recording at these states."""
    goes_on, k = joints(states), first_joint(data)
    gaps = (made.ends[k:-1, goes_on] - states[k + 1 :, goes_on]) / join[held_in(states.shape[1])][goes_on]
    return float(window_costs(data, states, made).sum()) + 0.5 * float((gaps**2).sum())


def fit(
    recordings: Sequence[Conditioned],
    hypothesis: Hypothesis,
    workers: Workers,
    values: np.ndarray | None = None,
    states: Sequence[np.ndarray] | None = None,
    stages: Sequence[Stage] = FROM_AFAR,
    known: Fit | None = None,
) -> Fit:
    """Fit a hypothesis.

    Args:
        recordings: The recordings.
        hypothesis: Constants and effects.
        workers: Threads.
        values, states: To start from; nominal and the first guesses where left out.
        stages: How to come to the end.
        known: A fit of this hypothesis to these recordings to start from, instead of ``values`` and ``states``: what it
            knows of the place where it ended is not computed again.

    Raises:
        InputError: the motion of a recording cannot be followed from its first guess.
    """
    search = _Search(recordings, hypothesis, workers, values, states, known)
    for stage in stages:
        search.run(stage)
    return search.end(stages[-1])


class _Search:
    """A fit on its way."""

    def __init__(
        self,
        recordings: Sequence[Conditioned],
        hypothesis: Hypothesis,
        workers: Workers,
        values: np.ndarray | None,
        states: Sequence[np.ndarray] | None,
        known: Fit | None,
    ) -> None:
        self.recordings, self.hypothesis, self.workers = recordings, hypothesis, workers
        parameters = hypothesis.parameters
        self.widths = np.array([each.width for each in parameters])
        self.centre = np.array([each.value for each in parameters])
        self.prior = np.array([each.prior for each in parameters])
        self.low = np.array([each.low for each in parameters])
        self.high = np.array([each.high for each in parameters])
        self.scales = np.array([" " in each.name and each.symbol in SCALES for each in parameters], dtype=bool)
        self.places = [hypothesis.acting_on(data.name) for data in recordings]
        size = state_size(hypothesis.mechanisms)
        self.noise = float(sum(data.judged.stop - data.judged.start for data in recordings))
        """Half the sum of squares that noise alone leaves."""
        self.at = self.centre.copy() if values is None else np.array(values, dtype=float)
        begin = [data.states for data in recordings] if states is None else states
        self.now = [sized(data, own, size) for data, own in zip(recordings, begin, strict=True)]
        self.led = states is not None
        """Whether it begins where another hypothesis has ended."""
        self.made: list[Prediction] = []
        self.parts: list[Quadratic] = []
        self.slopes: list[Slopes] = []
        self.columns: list = []
        self.taken, self.seen, self.stale = 0, known is not None, False
        if known is not None:
            self.at, self.now = known.values.copy(), [each.copy() for each in known.states]
            self.made, self.slopes, self.columns = known.predictions, known.slopes, known.columns

    def run(self, stage: Stage) -> None:
        """Take the steps of a stage."""
        self.seen, self.stale = self.seen and not self.stale, False
        if stage.settle or not self.made:
            self._move_to(self.at, *self._stand(self.at, self.now, stage))
            if stage.settle and self.led:
                self._rescue(stage, ASTRAY)
        self._rescue(stage, LEFT_OUT, few=True)
        rounds = self._descend(stage, stage.rounds)
        while rounds < stage.rounds:
            before, place = self._cost(self.at, self.now, self.made, stage), self._place()
            if not self._rescue(stage, LEFT_OUT, few=True):
                return
            # a rescue costs about a round: so this ends
            taken = 1 + self._descend(stage, stage.rounds - rounds)
            rounds += taken
            cost = self._cost(self.at, self.now, self.made, stage)
            if before - cost < taken * self._little(stage, cost):
                # windows that would rather be elsewhere, and cannot be joined from there
                if cost > before:
                    self._return_to(place)
                return

    def end(self, stage: Stage) -> Fit:
        """What the fit came to."""
        self.seen = self.seen and not self.stale
        self._look(stage)
        cost = self._cost(self.at, self.now, self.made, stage)
        return Fit(
            self.hypothesis, self.at, self.now, self.made, self.parts, self.slopes, self.columns, self.places, cost,
            self.taken, stage.loose,
        )  # fmt: skip

    def _descend(self, stage: Stage, rounds: int) -> int:
        """Step after step as long as they gain something; how many it were, those on slopes of the step before aside.

        Slopes cost ten times as much as a step. They are used again where they promised about what they brought.
        """
        taken = 0
        while taken < rounds:
            before = self._cost(self.at, self.now, self.made, stage)
            # gaps at the joints say nothing of the model before the states have moved
            inside = sum(each.sum() for each in self._windows())
            found = self._better(stage, max(1.0, inside / self.noise))
            again = self.stale
            if found is None:
                if not again:
                    return taken
                self.seen = self.stale = False
                continue
            place, kept = found
            self._move_to(*place)
            self.taken += 1
            taken += not again
            cost = self._cost(self.at, self.now, self.made, stage)
            little = before - cost < self._little(stage, cost)
            if little and not again:
                return taken
            self.seen = self.stale = kept >= KEPT and not little
        return rounds

    def _little(self, stage: Stage, cost: float) -> float:
        """Gain that is not worth a round."""
        return max(stage.converged, CRAWLING * (cost - self.noise))

    def _better(
        self, stage: Stage, heat: float
    ) -> tuple[tuple[np.ndarray, list[np.ndarray], list[Prediction]], float] | None:
        """A step of Gauss and Newton, shortened until it gains something: values, states and predictions, or None.

        With them comes the share of the gain that the slopes promised, 0 for a step that was shortened. Slopes of a
        step before are good for a whole one or none.

        ``heat`` is a factor on the weights of what is believed: a model that leaves so many times the noise is not to
        bend the constants out of all belief in its place.
        """
        self._look(stage)
        before = self._cost(self.at, self.now, self.made, stage, heat)
        gradient, curvature = sum_quadratics(self.parts, self.places, self.at.size)
        away = (self.at - self.centre) / self.widths
        pull = gradient - heat * self.prior * away
        step = np.linalg.solve(curvature + np.diag(heat * self.prior + 1e-9), pull)
        lowest = sum(each.value for each in self.parts) + 0.5 * heat * float(self.prior @ away**2) - 0.5 * pull @ step
        if before - lowest < stage.converged:
            return None
        share = 1.0
        while share > 0.02:
            point, moved = self._stepped(share * step)
            placed = [
                own + (share * part.moves - part.answers @ moved[place]).reshape(own.shape)
                for own, part, place in zip(self.now, self.parts, self.places, strict=True)
            ]
            try:
                placed, said = self._stand(point, _behind(placed), stage, near=True)
                gained = before - self._cost(point, placed, said, stage, heat)
                if not stage.settle and share > 0.2 and gained < KEPT * share * (before - lowest):
                    other = self._corrected(point, placed, said, stage)
                    more = before - self._cost(point, *other, stage, heat)
                    if more > gained:
                        (placed, said), gained = other, more
                if gained > 0.0:
                    return (point, placed, said), float(gained / (before - lowest)) if share == 1.0 else 0.0
            except InputError:
                pass
            if self.stale:
                break
            share *= 0.4
        return None

    def _stepped(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The parameters after a step (p,) in widths, and how far along their slopes that is.

        Those that act as a product are multiplied: a step along the valley of what their product is does not leave it.
        """
        curved = np.flatnonzero(self.scales & (self.at > 0.0))
        at, width = self.at[curved], self.widths[curved]
        point = self.at + step * self.widths
        point[curved] = at * np.exp(np.clip(step[curved] * width / at, -LONGEST, LONGEST))
        point = np.clip(point, self.low, self.high)
        moved = (point - self.at) / self.widths
        moved[curved] = np.log(point[curved] / at) * at / width
        return point, moved

    def _corrected(
        self, point: np.ndarray, placed: Sequence[np.ndarray], said: Sequence[Prediction], stage: Stage
    ) -> tuple[list[np.ndarray], list[Prediction]]:
        """States and predictions at the same values of the parameters, a step of the states alone further.

        Where parameters and states go into the model as products, the joints between windows, which are narrow, are
        missed by far more than the data are by a step that is not all too long (R. Fletcher, Second order corrections
        for non-differentiable optimization, Lecture Notes in Mathematics 912 (1982) 85-114).
        """
        each, joins = self.workers.each, [JOIN * stage.loose] * len(placed)
        nothing = [np.zeros((0, 2, data.force.size)) for data in self.recordings]
        ends = [np.zeros((0, *own.shape)) for own in placed]
        parts = each(quadratic, self.recordings, placed, said, self.slopes, nothing, ends, joins)
        moved = [own + part.moves.reshape(own.shape) for own, part in zip(placed, parts, strict=True)]
        try:
            return self._stand(point, _behind(moved), stage)
        except InputError:
            return list(placed), list(said)

    def _rescue(self, stage: Stage, limit: float, few: bool = False) -> bool:
        """Windows that cost more than ``limit`` a sample, from their first guess too; whether that was better for any.

        A window that was led astray, past a light touch of the rock or by another hypothesis, does not find back. Where
        only ``few`` are to be looked for, nothing is done if half of all cost as much: then it is not the windows.
        """
        costs = self._windows()
        off = [cost > limit * np.diff(data.starts) for cost, data in zip(costs, self.recordings, strict=True)]
        share = np.concatenate(off).mean()
        if share == 0.0 or (few and share > 0.5):
            return False
        guess = map(first_guess, self.recordings, self.now)
        begun = [np.where(one[:, None], first, own) for one, first, own in zip(off, guess, self.now, strict=True)]
        for own, one, said in zip(begun, off, self.made, strict=True):
            # the windows before them know the shaker better than any guess, if they are not astray themselves
            known, goes_on = one[1:] & ~one[:-1] if stage.settle else one[1:], joints(own)
            own[1:, goes_on] = np.where(known[:, None], said.ends[:-1, goes_on], own[1:, goes_on])
        try:
            other, said = self._stand(self.at, begun, stage._replace(settle=stage.settle or RESCUE))
            again = self.workers.each(window_costs, self.recordings, other, said)
            better = [one & (late < early - CONVERGED) for one, early, late in zip(off, costs, again, strict=True)]
            if not any(one.any() for one in better):
                return False
            mixed = [np.where(one[:, None], b, a) for one, a, b in zip(better, self.now, other, strict=True)]
            self._move_to(self.at, *self._stand(self.at, mixed, stage._replace(settle=0)))
        except InputError:
            return False
        return True

    def _windows(self) -> list[np.ndarray]:
        """(windows,) half the sum of squares of each window of each recording."""
        return list(map(window_costs, self.recordings, self.now, self.made))

    def _move_to(self, point: np.ndarray, placed: list[np.ndarray], said: list[Prediction]) -> None:
        self.at, self.now, self.made, self.seen, self.stale = point, placed, said, False, False

    def _place(self) -> tuple:
        return self.at, self.now, self.made, self.slopes, self.columns, self.seen, self.stale

    def _return_to(self, place: tuple) -> None:
        self.at, self.now, self.made, self.slopes, self.columns, self.seen, self.stale = place

    def _stand(
        self, point: np.ndarray, placed: Sequence[np.ndarray], stage: Stage, near: bool = False
    ) -> tuple[list[np.ndarray], list[Prediction]]:
        """States and predictions at values of the parameters, ``near`` to where the slopes were taken or not."""
        physics = [self.hypothesis.physics(point, data.name) for data in self.recordings]
        if not stage.settle:
            return list(placed), self.workers.each(predict, self.recordings, placed, physics)
        rounds = [stage.settle] * len(physics)
        slopes = self.slopes if near and self.slopes else [None] * len(physics)
        done = self.workers.each(settle_states, self.recordings, placed, physics, rounds, slopes)
        return [each[0] for each in done], [each[1] for each in done]

    def _cost(
        self,
        point: np.ndarray,
        placed: Sequence[np.ndarray],
        said: Sequence[Prediction],
        stage: Stage,
        heat: float = 1.0,
    ) -> float:
        """Half the sum of squares with the priors."""
        join = JOIN * stage.loose
        pieces = [plain_cost(*each, join) for each in zip(self.recordings, placed, said, strict=True)]
        return sum(pieces) + 0.5 * heat * float(self.prior @ ((point - self.centre) / self.widths) ** 2)

    def _look(self, stage: Stage) -> None:
        """Slopes and quadratics where the fit stands."""
        each, physics = self.workers.each, [self.hypothesis.physics(self.at, data.name) for data in self.recordings]
        if not self.seen:
            count = len(physics)
            self.slopes = each(state_slopes, self.recordings, self.now, physics, self.made)
            self.columns = each(
                columns_for, self.recordings, self.now, [self.hypothesis] * count, [self.at] * count, self.made
            )
            self.seen, self.stale = True, False
        marks, ends = [column[0] for column in self.columns], [column[1] for column in self.columns]
        joins = [JOIN * stage.loose] * len(marks)
        self.parts = each(quadratic, self.recordings, self.now, self.made, self.slopes, marks, ends, joins)


def _behind(states: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The same states, no window beginning inside the rock."""
    return [np.column_stack([own[:, :3], np.minimum(own[:, 3], 0.0), own[:, 4:]]) for own in states]


def joined(
    recordings: Sequence[Conditioned],
    hypothesis: Hypothesis,
    workers: Workers,
    values: np.ndarray,
    states: Sequence[np.ndarray],
    known: Fit | None = None,
) -> Fit:
    """The fit with windows that join, from windows fitted each on its own.

    Where dry friction holds the shaker, one that begins with a wrong speed glides as long as its mass takes, and since
    friction does not notice how fast, no step leads back. But a rig that was running has long been steady. So the
    windows begin again with the shaker's part of what the later half of them came to, and the better end is taken.
    ``known`` is as in :func:`fit`.
    """
    found = fit(recordings, hypothesis, workers, values, states, JOINED, known)
    if not any(REGISTRY[name].grips == ON_SHAKER for name in hypothesis.mechanisms):
        return found
    steady = [own.copy() for own in found.states]
    for data, own in zip(recordings, steady, strict=True):
        if not data.fresh:
            own[:, :2] = np.median(own[len(own) // 2 :, :2], axis=0)
    other = fit(recordings, hypothesis, workers, found.values, steady, JOINED)
    return min(found, other, key=lambda each: each.cost)
