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
    Physics,
    Prediction,
    Quadratic,
    Slopes,
    predict,
    quadratic,
    settle_states,
    slope_fineness,
    split_effects,
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
BEGUN = ("N0", "s0")
"""Symbols for the first extra state of an effect as a recording of a running rig begins."""
STEP = 0.02
"""Standard deviations by which a constant is moved for its derivative."""
CONVERGED, CRAWLING = 0.3, 0.01
"""A round that lowers half the sum of squares by less than this, or than this share of what it is above the noise's,
ends a stage."""


class Stage(NamedTuple):
    """A part of a fit."""

    loose: float
    """Factor on the width of the joints between windows."""
    settle: int
    """Rounds in which each window's state is fitted on its own after every step of the parameters; 0 for none."""
    rounds: int
    """Steps of the parameters at most."""


JOINED = (Stage(10.0, 0, 4), Stage(1.0, 0, 16))
"""From windows fitted each on its own."""
FROM_AFAR = (Stage(1e4, 8, 6), *JOINED)
"""From first guesses: the joints come last, when the constants are nearly right."""
NEARBY = (Stage(1.0, 0, 8),)
"""From a fit of nearly the same hypothesis."""


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
    def symbol(self) -> str:
        """Of an effect's parameter, as in "chi"."""
        return self.name.split(" ")[1]


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
            begun += [(name, symbols.pop(symbol)) for symbol in BEGUN if symbol in symbols]
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
    """(windows, 4) of each recording."""
    predictions: list[Prediction]
    quadratics: list[Quadratic]
    """About the values, in widths."""
    slopes: list[Slopes]
    columns: list[tuple[np.ndarray, np.ndarray]]
    """(q, 2, n) and (q, windows, 4) of each recording: answers to the q parameters that act on it."""
    places: list[np.ndarray]
    """(q,) of each recording: which parameters these are."""
    cost: float
    """Half the sum of squares with the priors."""
    rounds: int

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
    def covariance(self) -> np.ndarray:
        """(p, p) of the parameters, in their own units."""
        # what the recordings say nothing of is a thousand widths wide
        priors = [each.prior + 1e-6 for each in self.hypothesis.parameters]
        total = sum_quadratics(self.quadratics, self.places, len(priors))[1] + np.diag(priors)
        widths = np.array([each.width for each in self.hypothesis.parameters])
        return np.linalg.inv(total) * widths[:, None] * widths[None, :]

    @property
    def spread(self) -> np.ndarray:
        """(p,) standard deviations of the parameters: from the noise, or, if larger, as the recordings disagree.

        The second is the jackknife's, leaving out one recording at a time (B. Efron, The jackknife, the bootstrap and
        other resampling plans, SIAM, 1982). It knows of what the noise does not: that a model is never quite right.
        """
        noise = np.sqrt(np.diag(self.covariance))
        parameters, count = self.hypothesis.parameters, len(self.quadratics)
        shared = np.array([not each.recording for each in parameters])
        if count < 3 or not shared.any():
            return noise
        widths = np.array([each.width for each in parameters])
        prior = np.array([each.prior for each in parameters])
        pulled = prior * (self.values - np.array([each.value for each in parameters])) / widths
        found = []
        for out in range(count):
            parts = [each for i, each in enumerate(self.quadratics) if i != out]
            places = [each for i, each in enumerate(self.places) if i != out]
            gradient, curvature = sum_quadratics(parts, places, len(parameters))
            found.append(np.linalg.solve(curvature + np.diag(prior + 1e-9), gradient - pulled))
        apart = np.std(found, axis=0) * math.sqrt(count - 1) * widths
        return np.where(shared, np.maximum(noise, apart), noise)


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
    """(2, n) change of the scaled channels and (windows, 4) of the ends, per ``step``."""
    return (
        np.stack(
            [
                (moved.force - base.force) / (data.noise_force * step),
                (moved.acceleration - base.acceleration) / (data.noise_acceleration * step),
            ]
        ),
        (moved.ends - base.ends) / step,
    )


def columns_for(data: Conditioned, states: np.ndarray, hypothesis: Hypothesis, values: np.ndarray, base: Prediction):
    """Answers of one recording to every parameter that acts on it, per width, about where the model says ``base``."""
    acting = hypothesis.acting_on(data.name)
    here = hypothesis.physics(values, data.name)
    fine = slope_fineness(data, here.sensors)
    if fine > 1:
        base = predict(data, states, here, fine=fine)
    channels = np.empty((acting.size, 2, data.force.size))
    ends = np.empty((acting.size, len(states), 4))
    for row, j in enumerate(acting.tolist()):
        each = hypothesis.parameters[j]
        step = STEP if values[j] + STEP * each.width <= each.high else -STEP
        moved = values.copy()
        moved[j] += step * each.width
        physics = hypothesis.physics(moved, data.name)
        channels[row], ends[row] = scaled_change(data, predict(data, states, physics, fine=fine), base, step)
    return channels, ends


def plain_cost(data: Conditioned, states: np.ndarray, guess: np.ndarray, made: Prediction, join: np.ndarray) -> float:
    """Half the sum of squares of one recording at these states."""
    gaps = (made.ends[:-1, :2] - states[1:, :2]) / join
    return float(window_costs(data, states, guess, made).sum()) + 0.5 * float((gaps**2).sum())


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
    parameters = hypothesis.parameters
    widths = np.array([each.width for each in parameters])
    centre = np.array([each.value for each in parameters])
    prior = np.array([each.prior for each in parameters])
    low, high = np.array([each.low for each in parameters]), np.array([each.high for each in parameters])
    at = centre.copy() if values is None else np.array(values, dtype=float)
    guess = [data.states for data in recordings]
    now = [each.copy() for each in (guess if states is None else states)]
    taken, seen = 0, known is not None
    made: list[Prediction] = []
    parts: list[Quadratic] = []
    slopes: list[Slopes] = []
    columns: list = []
    if known is not None:
        at, now = known.values.copy(), [each.copy() for each in known.states]
        made, slopes, columns = known.predictions, known.slopes, known.columns
    places = [hypothesis.acting_on(data.name) for data in recordings]
    cost, noise = np.inf, float(sum(data.judged.stop - data.judged.start for data in recordings))

    def look(stage: Stage) -> None:
        """Slopes and quadratics where the fit stands."""
        nonlocal slopes, columns, parts, seen
        if not seen:
            slopes = workers.each(
                lambda data, own, base: state_slopes(data, own, hypothesis.physics(at, data.name), base),
                recordings,
                now,
                made,
            )
            columns = workers.each(
                lambda data, own, base: columns_for(data, own, hypothesis, at, base), recordings, now, made
            )
            seen = True
        join = JOIN * stage.loose
        parts = workers.each(
            lambda data, own, first, base, slope, column: quadratic(
                data, own, first, base, slope, column[0], column[1], join
            ),
            recordings,
            now,
            guess,
            made,
            slopes,
            columns,
        )

    def cost_at(point: np.ndarray, placed: Sequence[np.ndarray], said: Sequence[Prediction], stage: Stage) -> float:
        pieces = [plain_cost(*each, JOIN * stage.loose) for each in zip(recordings, placed, guess, said, strict=True)]
        return sum(pieces) + 0.5 * float(prior @ ((point - centre) / widths) ** 2)

    def stand(point: np.ndarray, placed: Sequence[np.ndarray], stage: Stage):
        """States and predictions at values of the parameters."""
        if stage.settle:
            done = workers.each(
                lambda data, own, first: settle_states(
                    data, own, first, hypothesis.physics(point, data.name), stage.settle
                ),
                recordings,
                placed,
                guess,
            )
            return [each[0] for each in done], [each[1] for each in done]
        said = workers.each(
            lambda data, own: predict(data, own, hypothesis.physics(point, data.name)), recordings, placed
        )
        return list(placed), said

    for stage in stages:
        if stage.settle or not made:
            now, made = stand(at, now, stage)
            seen = False
        cost = cost_at(at, now, made, stage)
        for _ in range(stage.rounds):
            look(stage)
            gradient, curvature = sum_quadratics(parts, places, len(parameters))
            away = (at - centre) / widths
            step = np.linalg.solve(curvature + np.diag(prior + 1e-9), gradient - prior * away)
            share, found = 1.0, None
            while share > 0.02 and found is None:
                point = np.clip(at + share * step * widths, low, high)
                moved = (point - at) / widths
                placed = [
                    own + (share * part.moves - part.answers @ moved[place]).reshape(-1, 4)
                    for own, part, place in zip(now, parts, places, strict=True)
                ]
                for each in placed:
                    each[:, 3] = np.minimum(each[:, 3], 0.0)
                try:
                    placed, said = stand(point, placed, stage)
                    trial = cost_at(point, placed, said, stage)
                    if trial < cost:
                        found = point, placed, said, trial
                except InputError:
                    pass
                share *= 0.4
            if found is None:
                break
            gained = cost - found[3]
            at, now, made, cost = found
            taken, seen = taken + 1, False
            if gained < max(CONVERGED, CRAWLING * (cost - noise)):
                break
    look(stages[-1])
    return Fit(hypothesis, at, now, made, parts, slopes, columns, places, cost, taken)


def joined(
    recordings: Sequence[Conditioned],
    hypothesis: Hypothesis,
    workers: Workers,
    values: np.ndarray,
    states: Sequence[np.ndarray],
    known: Fit | None = None,
) -> Fit:
    """The fit with windows that join, from windows fitted each on its own.

    Where dry friction holds the shaker, one window that has its speed wrong pulls those after it along, and since
    friction does not notice by how much, no step leads back. So all windows of a rig that was running also begin with
    the median of its speeds, and the better of both ends is taken. ``known`` is as in :func:`fit`.
    """
    found = fit(recordings, hypothesis, workers, values, states, JOINED, known)
    if not any(REGISTRY[name].grips == ON_SHAKER for name, _held, _free in hypothesis.effects):
        return found
    level = [own.copy() for own in states]
    for data, own in zip(recordings, level, strict=True):
        if not data.fresh:
            own[:, 1] = np.median(own[:, 1])
    other = fit(recordings, hypothesis, workers, values, level, JOINED)
    return min(found, other, key=lambda each: each.cost)
