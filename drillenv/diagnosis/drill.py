"""The drilling rig as blocks of the solver: one for each recording, by multiple shooting.

Own unknowns of a recording are the states at the beginning of each of its windows, the share by which its true pressure
is off the label, and the amplitudes of disturbing lines on its channels. Shared parameters are the rig's constants and
those of the terms (laws, filters) that have been added to the paper's model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from drillenv.diagnosis.condition import Conditioned, thin, thinning
from drillenv.diagnosis.coupling import (
    closing_speed,
    damper_force,
    damping_at,
    shortening,
    slope_from_rest,
    spring_coordinate,
    spring_slope,
)
from drillenv.diagnosis.engine import Column, assembled, columns_of, equation_change
from drillenv.diagnosis.fitting import FREE, JOINED
from drillenv.diagnosis.laws import Curve
from drillenv.diagnosis.noise import NoiseModel, nuisance, whiten
from drillenv.diagnosis.solver import Floats, Quadratic, factor
from drillenv.diagnosis.tables import interpolate
from drillenv.diagnosis.terms import DRIVE_PHASE, REACH, SCALARS, Model, ModelStructure, OperatingPoint, Term
from drillenv.diagnosis.thresholds import CLOSE
from drillenv.dynamics.constitutive.places import COMPACTION, DAMPER, GUIDE, INDENTER, SPRING, SPRING_FROM_REST
from drillenv.dynamics.constitutive.tables import NotSmoothError
from drillenv.dynamics.hybrid.advance import WENT_ON
from drillenv.dynamics.hybrid.model import fresh_motion
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.sensitivity import COUNTED, LAW, PHASE, make_variation
from drillenv.dynamics.hybrid.shooting import Shot, Windows, shoot
from drillenv.dynamics.hybrid.vector_field import (
    AIR_RATE,
    BENT1,
    BENT2,
    BRISTLES1,
    BRISTLES2,
    F_B,
    MOUNT_SQUARE,
    OWN,
    UD,
    V1,
    V2,
    C,
    K,
    Q,
    U,
    Y,
)

CONTINUITY = np.array([2e-7, 2e-5, np.inf, np.inf, 1e-8, 1e-5, 0.015, 0.015, 0.015])
"""Standard deviations with which a window goes on where the one before ends, by state. Speed and distance of the
indenter are free: a window's own samples say both to within the noise, and impacts magnify what is wrong of them."""
MASSES = 4
"""States of the two masses, which come first."""
PRESSURE_LABEL = 0.006
"""Standard deviation of a pressure about its label, as a share: gauges are read to 1 %."""
STATE_WIDTHS = np.array([1.0, 1.0, 1e-3, 1e-6, 1e-6, 1e-3, 1.0, 1.0, 1.0])
"""Units of a window's own unknowns: force of the coupling's spring and of its damper in N, then the states from v2 on.
Forces, for what the data say of a window does not change with the spring that is taken to have made them."""
FIRST_STATE = np.array([500.0, 500.0, 1.0, 3e-4])
"""Standard deviations of the first window's states about their first guess, in N, N, m/s and m: as large as they are,
for the samples say little of them where sensors remember the time before."""
IMPROBABLE = 5.0
"""Standard deviations of its label from which a pressure may stand for a force that a model has the wrong way round."""
LABELLED = 1e6
"""Precision of labels that are taken for exact."""
PROGRESS = 0.8
"""Share of its cost to which a recording has to come with windows begun anew for them to be begun anew once more."""
FOUND_QUANTILE = 0.25
"""Quantile of the windows' costs a sample that stands for windows whose states have been found."""
BENT = 50.0
"""N, standard deviation of the force of bristles where a recording begins: friction that a lab would not miss."""
AIR_AT_START = 2.0
"""N, prior standard deviation of the air's force where a recording begins: about its ripple in a period."""
COUNT_LABEL = 0.4
"""Standard deviation of the impacts before a running recording, as a share."""
WORSE, CORRECTIONS = 10.0, 6
"""Own unknowns whose step makes a recording worse, up to so many times, take so many steps of their own."""
DENSE = 50e3
"""Hz at which motions are followed at least, before the logger's filter."""
PATH_STEP = 84e-6
"""s from one state of a path to the next at most."""
TOLERANCE = 1e-7
"""Relative error of a step of the integrator."""
GRAZING = 2e-3
"""m/s of a contact's speed below which the jump of the derivatives is held back."""


class Varied(NamedTuple):
    """By what a motion is differentiated: own states at the windows' beginnings, and columns."""

    columns: Sequence[Column]
    by_own: Floats
    """(windows, kept, kept) derivatives of the states that windows begin with, by own unknowns."""
    by_column: Floats
    """(windows, columns, kept) the same by columns."""


class Raw(NamedTuple):
    """What the engine says of a recording."""

    said: Floats
    """(2, fine samples) force in N and acceleration in m/s^2."""
    path: Floats
    """(OWN, steps) states along the motion; none where they are not asked for."""
    by_state: Floats
    """(kept, 2, fine samples) by own unknowns of the same window."""
    by_column: Floats
    """(columns, 2, fine samples)"""
    ends: Floats
    """(windows, OWN) states at the ends of windows, or at their beginnings where these were chained."""
    ends_by_state: Floats
    """(windows, kept, OWN)"""
    ends_by_column: Floats
    """(windows, columns, OWN)"""
    good: bool
    """Whether the motion could be followed to the end."""


def raw_of(shot: Shot, ends: Floats, states: int, good: bool) -> Raw:
    """What the engine has written, of which the first columns are those by states."""
    by, ends_by = shot.by_column, shot.ends_by_column
    return Raw(shot.said, shot.path, by[:states], by[states:], ends, ends_by[:, :states], ends_by[:, states:], good)


def first_states(data: Conditioned) -> Floats:
    """Own unknowns of a recording as conditioning guesses them."""
    return np.append((data.states / STATE_WIDTHS[:4]).ravel(), [0.0, 0.0])


def decimated(signals: Floats, kernel: Floats | None, fine: int, thinned: int) -> Floats:
    """Signals (..., n) through the logger's centred kernel, at one in ``fine``, and thinned as the recording was."""
    if kernel is None:
        return thin(signals[..., ::fine], thinned)
    taps = thinning(thinned)
    spread = np.zeros(fine * (taps.size - 1) + 1)
    spread[::fine] = taps
    whole = np.convolve(kernel, spread)
    over = fine * thinned
    # as many whole samples on either side of the middle
    reach = math.ceil((whole.size // 2) / over)
    whole = np.pad(whole, reach * over - whole.size // 2)
    rows = np.ascontiguousarray(signals).reshape(-1, signals.shape[-1])
    made = np.empty((len(rows), rows.shape[1] // over))
    _filter_decimate(rows, whole[::-1].copy(), over, made)
    return made.reshape(*signals.shape[:-1], made.shape[1])


@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz", "contract"})
def _filter_decimate(rows, taps, over, made):
    """Rows (m, n) by centred taps, reversed, at one sample in ``over``, into made (m, n // over); 0 beyond the ends.

    As scipy.signal.upfirdn, whose inner loop is over one sample at a time, several times as fast.
    """
    half, n = taps.size // 2, rows.shape[1]
    for i in range(rows.shape[0]):
        for j in range(made.shape[1]):
            begin = j * over - half
            low, high = max(0, -begin), min(taps.size, n - begin)
            # loops over slices, whose indices cannot be negative, are made into vector instructions
            own, there, total = taps[low:high], rows[i, begin + low : begin + high], 0.0
            for k in range(own.size):
                total += own[k] * there[k]
            made[i, j] = total


@dataclass
class ShootingProblem:
    """A recording as a block of the solver."""

    data: Conditioned
    structure: ModelStructure
    weight: float
    """By which the continuity constraints' standard deviations are widened."""
    noise: tuple[NoiseModel, NoiseModel]
    """Of force and acceleration."""
    label_precision: float = 1.0
    """Of the pressure's and the impacts' labels, in inverse squares of their standard deviations."""

    def __post_init__(self) -> None:
        data = self.data
        self.fine: int = max(1, math.ceil(0.98 * DENSE / (data.rate * data.thinned)))
        """Times as fine as the logger's own samples."""
        self.over: int = self.fine * data.thinned
        self.point: OperatingPoint = point_of(data)._replace(rate=data.rate * self.over)
        longest = max(1, math.floor(PATH_STEP * self.point.rate))
        self.stride: int = max(each for each in range(1, longest + 1) if self.over % each == 0)
        self.starts: np.ndarray = data.starts * self.over
        self.windows: int = len(data.starts) - 1
        self.inside: slice = slice(int(self.starts[0]), int(self.starts[-1]))
        # nothing is simulated of what the logger's filter would look ahead to, or back
        self.judged: slice = slice(int(data.starts[0]) + REACH, int(data.starts[-1]) - REACH)
        # accelerometers that ring still speak of what was before; the same samples are judged with and without
        # them, or costs could not be compared
        self.warm_up: int = max(int(data.starts[1] - data.starts[0]) // 2 - REACH, 0)
        """Samples of the acceleration that are judged later than those of the force."""
        self.widths: np.ndarray = np.array([each.width for each in self.structure.unknowns])
        self.measured: np.ndarray = np.stack([data.force, data.acceleration])
        self.coloured: bool = any(each.corner > 0.0 for each in self.noise)
        n = data.force.size
        shapes = [nuisance(each, n) for each in self.noise]
        self.lines: list[tuple[int, Any]] = [(i, row) for i, (rows, _) in enumerate(shapes) for row in rows]
        """Channel and shape (n,) of disturbing lines and constants, whose sizes are own unknowns."""
        self.line_precision: np.ndarray = np.concatenate([precision for _, precision in shapes])

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.point.name

    @property
    def samples(self) -> int:
        """How many numbers are judged."""
        return self.measured[:, self.judged].size - self.warm_up

    @property
    def power(self) -> float:
        """Sum of the squares of what is judged about its mean, in variances of the noise."""
        measured = self.measured[:, self.judged]
        return float(np.sum(self.mask_and_whiten(measured - measured.mean(axis=1, keepdims=True)) ** 2))

    @property
    def evaluation(self) -> slice:
        """Samples of which both channels are judged."""
        return slice(self.judged.start + self.warm_up, self.judged.stop)

    def mask_and_whiten(self, signals: Floats) -> Floats:
        """Signals (..., 2, judged) as the noise model weighs them, the acceleration from where it is judged on."""
        signals[..., 1, : self.warm_up] = 0.0
        return self.weighed(signals)

    def weighed(self, signals: Floats) -> Floats:
        """Signals (..., 2, n) as the noise model weighs them: white noise of it has the variance 1."""
        if not self.coloured:
            return signals / np.array([each.std for each in self.noise])[:, None]
        return np.stack([whiten(each, signals[..., i, :]) for i, each in enumerate(self.noise)], axis=-2)

    def disturbance(self, own: Floats) -> Floats | float:
        """(2, n) the lines on the channels."""
        if not self.lines:
            return 0.0
        total = np.zeros_like(self.measured)
        for (channel, row), size in zip(self.lines, own[own.size - len(self.lines) :], strict=True):
            total[channel] += size * self.noise[channel].std * row
        return total

    def lines_of(self, channel: int, own: Floats) -> list[tuple[float, Floats]]:
        """Frequency in Hz, and (2,) sine and cosine in the channel's unit, of each line of a channel's noise."""
        sizes = own[own.size - len(self.lines) :] if self.lines else own[:0]
        mine = np.array([size for (each, _), size in zip(self.lines, sizes, strict=True) if each == channel])
        model = self.noise[channel]
        count = len(model.lines)
        return [(f, model.std * mine[[i, count + i]]) for i, f in enumerate(model.lines)]

    @property
    def locals(self) -> int:
        """Own unknowns behind the states: share of the pressure, impacts before it began, and the lines."""
        return 2 + len(self.lines)

    def integrate(self, model: Model, own: Floats, varied: Varied | None = None, path: bool = False,
                  rollout: bool = False) -> Raw:  # fmt: skip
        """Simulate all windows, with derivatives by own states and columns where ``varied`` says by which.

        ``own`` as the solver has it.
        """
        data, n, kept = self.data, self.data.force.size * self.over, self.state_count(own)
        given, states = (varied.columns, kept) if varied is not None else ((), 0)
        count = states + len(given)
        labelled, axes = self.labelled(own, model), self.structure.axes
        impacts = max(model.impacts * (1.0 + COUNT_LABEL * own[self.windows * kept + 1]), 0.0)
        shot = Shot(
            np.zeros((OWN, n // self.stride if path else 0)),
            np.zeros((2, n)),
            np.zeros((count, 2, n)),
            np.zeros((self.windows, OWN)),
            np.zeros((self.windows, count, OWN)),
        )
        try:
            made = assembled(labelled, axes, data.omega, [each.place for each in given if each.place >= 0])
        except NotSmoothError:
            # parameters with which a law is no curve any more
            return raw_of(shot, shot.ends, states, False)
        columns = columns_of(given, labelled, axes, made, states)
        begin_by = np.zeros((self.windows, count, OWN))
        if varied is not None:
            begin_by[:, :states, :kept] = varied.by_own.transpose(0, 2, 1)
            begin_by[:, states:, :kept] = varied.by_column
        windows = Windows(self.starts, self.begun(own, model), begin_by, self.point.rate, data.phase + made.phase,
                          impacts, rollout, self.stride, GRAZING)  # fmt: skip
        status, _impacts = shoot(made.model, fresh_motion(made.model).d, TOLERANCE, windows, columns, shot,
                                 make_variation(made.model, count), make_scratch(made.model))  # fmt: skip
        return raw_of(shot, windows.begin if rollout else shot.ends, states, status == WENT_ON)

    def path(self, model: Model, own: Floats) -> Floats:
        """(OWN, n) states along the motion, from the first window to the last, at the integrator's steps."""
        path = self.integrate(model, own, path=True).path
        return path[:, self.inside.start // self.stride : self.inside.stop // self.stride]

    def labelled(self, own: Floats, model: Model) -> Model:
        """A model with the pressure as the recording has it."""
        return model.pushed(1.0 + PRESSURE_LABEL * own[self.windows * self.state_count(own)])

    def begun(self, own: Floats, model: Model) -> Floats:
        """(windows, OWN) states at the beginning of the windows."""
        model = self.labelled(own, model)
        kept = self.state_count(own)
        begin = np.zeros((self.windows, OWN))
        begin[:, :kept] = self.states_of(own) * STATE_WIDTHS[:kept]
        begin[:, absent(model)] = 0.0
        begin[:, Y] = shortening(begin[:, Y], model, self.structure.axes)
        begin[:, V1] = begin[:, V2] + closing_speed(begin[:, V1], model, self.structure.axes)
        return begin

    def varied(self, own: Floats, model: Model, given: Sequence[Column]) -> Varied:
        """By what the motion is differentiated, and what that makes of the states that windows begin with."""
        kept, axes = self.state_count(own), self.structure.axes
        begin = self.begun(own, model)
        model = self.labelled(own, model)
        y, closing = begin[:, Y], begin[:, V1] - begin[:, V2]
        rest = model.s[F_B] / model.s[K]
        stiff, damped = spring_slope(y, model, axes), damping_at(closing, model, axes)
        beyond_rest = slope_from_rest(y, model, axes)
        by_own = np.zeros((self.windows, kept, kept))
        for i in range(V2, kept):
            by_own[:, i, i] = 0.0 if i in absent(model) else STATE_WIDTHS[i]
        by_own[:, Y, Y] = STATE_WIDTHS[Y] / stiff
        by_own[:, V1, V1] = STATE_WIDTHS[V1] / damped
        by_own[:, V1, V2] = STATE_WIDTHS[V2]
        by_column = np.zeros((self.windows, len(given), kept))
        for j, column in enumerate(given):
            place, change = column.place, column.change
            if column.kind == K:
                by_column[:, j, Y] = -(y + beyond_rest * rest / model.s[K]) / stiff
            elif column.kind == F_B:
                by_column[:, j, Y] = beyond_rest / model.s[K] / stiff
            elif column.kind == C:
                by_column[:, j, V1] = -closing / damped
            elif change is not None and place in (SPRING, SPRING_FROM_REST):
                beyond = y if place == SPRING else y - rest
                by_column[:, j, Y] = -interpolate(change, axes, place, beyond) / stiff
            elif change is not None and place == DAMPER:
                by_column[:, j, V1] = -interpolate(change, axes, place, closing) / damped
        return Varied(given, by_own, by_column)

    def under(self, structure: ModelStructure, own: Floats) -> tuple[ShootingProblem, Floats]:
        """The same under a model structure with more terms, and its own unknowns with the states that these have."""
        kept, size = self.state_count(own), OWN if any(term.has_states for term in structure.terms) else 4
        widened = resized(own, self.windows, max(size, kept), kept, len(self.lines))
        return replace(self, structure=structure), widened

    def state_count(self, own: Floats) -> int:
        """States a window."""
        return (own.size - self.locals) // self.windows

    def states_of(self, own: Floats) -> Floats:
        """(windows, kept) own unknowns that are states of windows."""
        kept = self.state_count(own)
        return own[: self.windows * kept].reshape(self.windows, kept)

    def cost(self, shared: Floats, own: Floats) -> float:
        """Negative log-likelihood of the recording."""
        return self.costs(shared, own)[0]

    def per_sample(self, shared: Floats, own: Floats) -> float:
        """Twice the same, by the samples: about 1 where the model is right."""
        return 2.0 * self.cost(shared, own) / self.samples

    def costs(self, shared: Floats, own: Floats) -> tuple[float, Floats]:
        """The same, and (windows,) that of each window's samples and of its end."""
        values = shared * self.widths
        model = self.structure.model(values, self.point)
        raw = self.integrate(model, own)
        if not raw.good:
            return math.inf, np.full(self.windows, math.inf)
        full = np.zeros(raw.said.shape[1])
        off, precision = self.beliefs(own)
        # states from which a motion runs away cost more than numbers can say
        with np.errstate(over="ignore", invalid="ignore"):
            full[self.judged] = (self.residual(values, raw.said, own) ** 2).sum(axis=0)
            defects = (self.defects(raw, own, model) ** 2).sum(axis=1)
            unsettled = float(self.air_prior(own) @ own) ** 2
            total = 0.5 * float(full[self.judged].sum() + defects.sum() + precision @ off**2 + unsettled)
        if not math.isfinite(total):
            return math.inf, np.full(self.windows, math.inf)
        by_window = np.add.reduceat(full, self.data.starts[:-1].astype(int))
        by_window[:-1] += defects
        return total, 0.5 * by_window

    def beliefs(self, own: Floats) -> tuple[Floats, Floats]:
        """What own unknowns are off the centres of their priors, and the priors' precisions."""
        off, precision = own.copy(), np.zeros(own.size)
        off[:4] -= self.data.states[0] / STATE_WIDTHS[:4]
        precision[:4] = (STATE_WIDTHS[:4] / FIRST_STATE) ** 2
        if self.state_count(own) == OWN:
            precision[BENT1:OWN] = (STATE_WIDTHS[BENT1:OWN] / BENT) ** 2
        behind = self.windows * self.state_count(own)
        precision[behind : behind + 2] = self.label_precision
        precision[behind + 2 :] = self.line_precision
        return off, precision

    def air_prior(self, own: Floats) -> Floats:
        """(own,) row whose product with the own unknowns is the residual of a prior on the air's force at the start.

        The air had settled: in a rig that had been running its force begins as it is on the average, and at rest there
        is none. Else air of no stiffness would stand for anything that fades away.
        """
        row, kept = np.zeros(own.size), self.state_count(own)
        if kept == OWN:
            air = row[: self.windows * kept].reshape(self.windows, kept)[:, Q]
            air[0] = 1.0
            if not self.data.fresh:
                air -= 1.0 / self.windows
        return row * STATE_WIDTHS[Q] / AIR_AT_START

    def try_step(self, shared: Floats, own: Floats, move: Floats, before: float) -> tuple[float, Floats]:
        """Cost and own unknowns after their step; where it makes the recording worse, after steps of their own.

        Where windows are joined, their states follow the shared parameters along a curve.
        """
        cost, at = self.line_search(shared, own, move, before)
        return self.fit_states(shared, at, cost, CORRECTIONS) if before < cost < WORSE * before else (cost, at)

    def line_search(self, shared: Floats, own: Floats, move: Floats, before: float) -> tuple[float, Floats]:
        """Cost and own unknowns after a step of theirs, or what of it costs least."""
        at = own + move
        best, costs = self.costs(shared, at)
        if best <= before:
            return best, at
        if self.weight <= JOINED:
            # the step is along the continuity constraints' tangent: from there back to where they hold
            going_on = self.rollout(shared, at)
            cost = self.cost(shared, going_on)
            return (cost, going_on) if cost < best else (best, at)
        kept = self.state_count(own)
        for share in (0.3, 0.0):
            part = own + share * move
            cost, other = self.costs(shared, part)
            # windows that are nearly free choose each for themselves
            better = np.append(np.repeat(other < costs, kept), np.zeros(self.locals, dtype=bool))
            chosen = np.where(better, part, at)
            mixed, mixed_costs = self.costs(shared, chosen)
            if mixed < min(best, cost):
                best, at, costs = mixed, chosen, mixed_costs
            elif cost < best:
                best, at, costs = cost, part, other
        return best, at

    def reinitialise_outliers(self, shared: Floats, own: Floats, outlying: bool) -> Floats:
        """Windows whose cost stands out, begun as first guessed, as the one before ends, and as the next ones begin.

        A recording is begun anew as a whole where it is ``outlying``, since the model follows the others by far more
        closely, and where in a close model with friction its pressure is not to be believed: that holds a mass one way
        or the other, and its force and the pressure's can stand for each other. In a model that is far off pressures
        stand for all that it lacks.
        """
        cost, costs = self.costs(shared, own)
        close = self.weight <= JOINED and 2.0 * cost < CLOSE * self.samples
        model = self.structure.model(shared * self.widths, self.point)
        with_friction = model.bends(GUIDE) or model.bends(INDENTER)
        mistaken = close and with_friction and abs(own[self.windows * self.state_count(own)]) > IMPROBABLE
        if mistaken or outlying:
            most = math.inf if mistaken else PROGRESS * self.found_cost(costs)
            own = self.reinitialised(shared, own, most)
            cost, costs = self.costs(shared, own)
        typical = float(np.median(costs / np.diff(self.data.starts)))
        return own if typical > 1.5 and not outlying else self.with_windows_reinitialised(shared, own, cost, costs)[1]

    def with_windows_reinitialised(
        self, shared: Floats, own: Floats, cost: float, costs: Floats
    ) -> tuple[float, Floats]:
        """Cost and own unknowns with windows that stand out begun from elsewhere, where that comes to a lower cost.

        From a known cost, and that of each window.
        """
        # where the motion is another one in most of them the better ones tell
        stray = costs / np.diff(self.data.starts) > max(2.0 * self.found_cost(costs), 1.5)
        if not stray.any():
            return cost, own
        kept = self.state_count(own)
        model = self.structure.model(shared * self.widths, self.point)
        raw = self.integrate(model, own)
        states = self.states_of(own)
        behind = own[states.size :]
        ends = self.owned(raw.ends, self.labelled(own, model), kept)
        guess = states.copy()
        guess[:, 2:4] = self.data.states[:, 2:4] / STATE_WIDTHS[2:4]
        first = guess.copy()
        first[1:, :2] = np.where(stray[:-1, None], guess[1:, :2], ends[:-1, :2])
        going_on = states.copy()
        going_on[1:] = ends[:-1]
        # as in the windows after it: a rig that runs repeats itself after one or two
        next_, after_next = np.roll(states, -1, axis=0), np.roll(states, -2, axis=0)
        best, at = costs, own
        for trial in (first, going_on, next_, after_next):
            begun = self.estimate_states(shared, np.append(np.where(stray[:, None], trial, states).ravel(), behind))
            _, other = self.costs(shared, begun)
            better = np.append(np.repeat(stray & (other < best), kept), np.zeros(self.locals, dtype=bool))
            at, best = np.where(better, begun, at), np.minimum(best, other)
        after = self.cost(shared, at)
        return (after, at) if after < cost else (cost, own)

    def found_cost(self, costs: Floats) -> float:
        """Cost a sample of windows whose states have been found, from that of each window."""
        return float(np.quantile(costs / np.diff(self.data.starts), FOUND_QUANTILE))

    def reinitialised(self, shared: Floats, own: Floats, most: float = math.inf) -> Floats:
        """Own unknowns from first guesses and the pressure as stated, where that comes to a lower cost.

        As they are where from first guesses windows whose states have been found cost ``most`` a sample or more.
        """
        free = replace(self, weight=FREE)
        kept = self.state_count(own)
        begun = free.estimate_by_labels(
            shared, resized(first_states(self.data), self.windows, kept, 4, len(self.lines))
        )
        if free.found_cost(free.costs(shared, begun)[1]) >= most:
            return own
        begun = free.reinitialise_until_found(shared, begun)
        begun = self.estimate_states(shared, self.rollout(shared, begun) if self.weight <= JOINED else begun)
        return begun if self.cost(shared, begun) < self.cost(shared, own) else own

    def find_states(self, shared: Floats, guess: Floats) -> Floats:
        """Own unknowns from a first guess: the states by the labels, until no window stands out, then all of them.

        Windows in which the motion is still another one would have any pressure.
        """
        return self.reinitialise_until_found(shared, self.estimate_by_labels(shared, guess))

    def estimate_by_labels(self, shared: Floats, guess: Floats) -> Floats:
        """Own unknowns from a first guess, with what is doubtful about the labels as good as held."""
        return replace(self, label_precision=LABELLED).estimate_states(shared, guess)

    def reinitialise_until_found(self, shared: Floats, own: Floats) -> Floats:
        """Own unknowns from such, windows reinitialised until none stands out."""
        labelled, before = replace(self, label_precision=LABELLED), math.inf
        cost, costs = labelled.costs(shared, own)
        while cost < PROGRESS * before:
            before, (cost, own) = cost, labelled.with_windows_reinitialised(shared, own, cost, costs)
            costs = labelled.costs(shared, own)[1]
        return self.estimate_states(shared, own)

    def owned(self, states: Floats, model: Model, kept: int) -> Floats:
        """(windows, kept) own unknowns of states (windows, OWN); the model has the recording's pressure."""
        found = states.copy()
        found[:, Y] = spring_coordinate(states[:, Y], model, self.structure.axes)
        found[:, V1] = damper_force(states[:, V1] - states[:, V2], model, self.structure.axes)
        return found[:, :kept] / STATE_WIDTHS[:kept]

    def rollout(self, shared: Floats, own: Floats) -> Floats:
        """Own unknowns with which all states go on from window to window, but for the indenter's."""
        values, kept = shared * self.widths, self.state_count(own)
        model = self.structure.model(values, self.point)
        begin = self.integrate(model, own, rollout=True).ends
        return np.append(self.owned(begin, self.labelled(own, model), kept).ravel(), own[self.windows * kept :])

    def estimate_states(self, shared: Floats, own: Floats, steps: int = 15) -> Floats:
        """Own unknowns after Levenberg-Marquardt steps of their own."""
        cost = self.cost(shared, own)
        return self.fit_states(shared, own, cost, steps)[1] if math.isfinite(cost) else own

    def fit_states(self, shared: Floats, own: Floats, cost: float, steps: int) -> tuple[float, Floats]:
        """The same from a known cost, with the cost after them."""
        damping, part = 1e-3, None
        samples = self.samples
        for _ in range(steps):
            part = self.quadratic(shared, own, fixed=True) if part is None else part
            move = -cho_solve(factor(part, damping), part.by_own, check_finite=False)
            little = max(0.5, 1e-3 * (cost - 0.5 * samples))
            if -0.5 * float(part.by_own @ move) < little:
                break
            after, at = self.line_search(shared, own, move, cost)
            if after < cost:
                cost, own, damping, part = after, at, 0.1 * damping, None
            else:
                damping *= 30.0
        return cost, own

    def residual(self, values: Floats, said: Floats, own: Floats) -> Floats:
        """(2, judged) measured less read, as the noise model weighs it."""
        read = self.read(values, said) + self.disturbance(own)
        return self.mask_and_whiten((self.measured - read)[:, self.judged])

    def read(self, values: Floats, said: Floats) -> Floats:
        """(2, n) what the logger makes of the simulated signals, the lines aside."""
        read = self.sampled(values, self.structure.observe(values, said, self.point))
        # what is added is slow, so that the logger's filter lets it pass
        point = self.point._replace(rate=self.data.rate)
        return read + self.structure.added(values, read.shape[1], point, int(self.data.starts[0]))

    def sampled(self, values: Floats, signals: Floats) -> Floats:
        """Signals (..., fine) filtered by the logger, at its samples."""
        return decimated(signals, self.structure.kernel(values, self.fine), self.fine, self.data.thinned)

    def defects(self, raw: Raw, own: Floats, model: Model) -> Floats:
        """(windows - 1, kept) residuals of the continuity constraints."""
        kept = self.state_count(own)
        begin = self.begun(own, model)[:, :kept]
        return (begin[1:] - raw.ends[:-1, :kept]) / self.continuity(kept)

    def continuity(self, kept: int) -> Floats:
        """(kept,) standard deviations with which windows go on from each other.

        States that come beside those of the masses forget how they began: where windows are nearly free, to leave
        theirs free as well would let them explain anything.
        """
        return CONTINUITY[:kept] * np.where(np.arange(kept) < MASSES, self.weight, 1.0)

    def quadratic(self, shared: Floats, own: Floats, fixed: bool = False) -> Quadratic:
        """Negative log-likelihood with its derivatives; ``fixed`` leaves out those by the shared parameters."""
        values, kept = shared * self.widths, self.state_count(own)
        model, columns, mixing = self.elementary(values, fixed)
        varied = self.varied(own, model, columns)
        raw = self.integrate(model, own, varied)
        residual, defects = self.residual(values, raw.said, own), self.defects(raw, own, model)
        seen = self.structure.observe(values, raw.by_column, self.point)
        seen = self.mask_and_whiten(self.sampled(values, seen)[:, :, self.judged])
        shared_columns = np.zeros((0, *residual.shape)) if fixed else self.shared_columns(values, raw, seen, mixing)
        local_mixing = self.local_mixing(columns, model)
        wide = np.concatenate([self.local_columns(seen, local_mixing), shared_columns, residual[None]])
        # most parameters of recordings are of others, and change nothing here
        there = wide.any(axis=(1, 2))
        own_own, own_there = self.window_products(values, raw, kept, wide[there])
        flat = wide[there].reshape(int(there.sum()), -1)
        own_wide, products = np.zeros((len(own_own), len(wide))), np.zeros((len(wide), len(wide)))
        own_wide[:, there], products[np.ix_(there, there)] = own_there, flat @ flat.T
        e_own, e_shared = self.defect_columns(raw, own.size, varied, mixing, local_mixing)
        g, m, count = defects.ravel(), self.windows * kept, self.locals
        off, precision = self.beliefs(own)
        hessian = e_own.T @ e_own
        hessian[:m, :m] += own_own
        hessian[:m, m:] += own_wide[:, :count]
        hessian[m:, :m] += own_wide[:, :count].T
        hessian[m:, m:] += products[:count, :count]
        air = self.air_prior(own)
        unsettled = float(air @ own)
        hessian += np.diag(precision) + np.outer(air, air)
        scale = np.append(np.diag(own_own), np.diag(products)[:count]) + precision
        cross = e_own.T @ e_shared
        cross[:m] += own_wide[:, count:-1]
        cross[m:] += products[:count, count:-1]
        by_own = e_own.T @ g - np.append(own_wide[:, -1], products[:count, -1])
        by_own += precision * off + air * unsettled
        return Quadratic(
            0.5 * float(products[-1, -1] + g @ g + precision @ off**2 + unsettled**2),
            by_own,
            e_shared.T @ g - products[count:-1, -1],
            hessian,
            cross,
            products[count:-1, count:-1] + e_shared.T @ e_shared,
            scale,
        )

    def local_mixing(self, columns: Sequence[Column], model: Model) -> Floats:
        """(columns, 2) how the derivatives by the pressure's share and the impacts before are made of columns."""
        kinds = [each.kind for each in columns]
        made = np.zeros((len(kinds), 2))
        made[kinds.index(F_B), 0] = model.s[F_B] * PRESSURE_LABEL
        if COUNTED in kinds:
            made[kinds.index(COUNTED), 1] = model.impacts * COUNT_LABEL
        return made

    def local_columns(self, seen: Floats, mixing: Floats) -> Floats:
        """(locals, 2, judged) by what the weighed reading changes with own unknowns other than states.

        ``seen`` (columns, 2, judged) is the same by columns of the integrator.
        """
        moved = np.tensordot(mixing.T, seen, 1)
        rows = np.zeros((len(self.lines), 2, self.data.force.size))
        for i, (channel, row) in enumerate(self.lines):
            rows[i, channel] = self.noise[channel].std * row
        return np.concatenate([moved, self.mask_and_whiten(rows[:, :, self.judged])])

    def defect_columns(self, raw: Raw, own: int, varied: Varied, mixing: Floats,
                    local_mixing: Floats) -> tuple[Floats, Floats]:  # fmt: skip
        """(gaps, own) and (gaps, parameters): derivatives of the continuity constraints."""
        kept = varied.by_own.shape[1]
        over = self.continuity(kept)
        pairs = self.windows - 1
        by_own = np.zeros((pairs, kept, own))
        for i in range(pairs):
            by_own[i, :, (i + 1) * kept : (i + 2) * kept] = varied.by_own[i + 1]
            by_own[i, :, i * kept : (i + 1) * kept] = -raw.ends_by_state[i, :, :kept].T
        change = varied.by_column[1:] - raw.ends_by_column[:-1, :, :kept]
        first = self.windows * kept
        by_own[:, :, first : first + 2] = np.einsum("wes,ek->wsk", change, local_mixing)
        by_shared = np.einsum("wes,ep->wsp", change, mixing) * self.widths[: mixing.shape[1]]
        return (
            (by_own / over[:, None]).reshape(-1, own),
            (by_shared / over[:, None]).reshape(pairs * kept, -1),
        )

    def window_products(self, values: Floats, raw: Raw, kept: int, wide: Floats) -> tuple[Floats, Floats]:
        """(states, states) and (states, wide) inner products of the columns of windows' states.

        ``wide`` (m, 2, judged) are columns over the whole recording. A window's own columns reach beyond its end as far
        as the sensors and the noise model remember, at most over the next window.
        """
        w, first = self.windows, self.judged.start
        own_own = np.zeros((w * kept, w * kept))
        own_wide = np.zeros((w * kept, len(wide)))
        low, high = self.spans()
        parts = self.window_columns(values, raw, kept, low, high)
        flat = parts.reshape(w, kept, -1)
        within = flat @ flat.transpose(0, 2, 1)
        for i in range(w):
            rows = slice(i * kept, (i + 1) * kept)
            own_own[rows, rows] = within[i]
            # the first window's columns are zero before the first sample that is judged
            begin, cut = max(low[i], first), max(first - low[i], 0)
            if high[i] <= begin:
                continue
            seen = parts[i, :, :, cut : high[i] - low[i]]
            there = wide[:, :, begin - first : high[i] - first].reshape(len(wide), -1)
            own_wide[rows] = seen.reshape(kept, -1) @ there.T
            overlap = high[i - 1] - begin if i > 0 else 0
            if overlap > 0:
                before = parts[i - 1, :, :, begin - low[i - 1] : high[i - 1] - low[i - 1]].reshape(kept, -1)
                mixed_ = seen[:, :, :overlap].reshape(kept, -1) @ before.T
                own_own[rows, (i - 1) * kept : i * kept] = mixed_
                own_own[(i - 1) * kept : i * kept, rows] = mixed_.T
        return own_own, own_wide

    def spans(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(windows,) samples from which and up to which a window's states show, at most over the next window."""
        starts = self.data.starts
        low, high = starts[:-1] - REACH, np.minimum(starts[1:] + self.tail, self.judged.stop)
        high[:-1] = np.minimum(high[:-1], starts[2:] - REACH)
        return low, high

    def window_columns(self, values: Floats, raw: Raw, kept: int, low: NDArray, high: NDArray) -> Floats:
        """(windows, kept, 2, longest span) by what the weighed reading changes with each window's states."""
        over = self.over
        longest = int((high - low).max())
        parts = np.zeros((self.windows, kept, 2, longest * over))
        for i, (begin, end) in enumerate(zip(self.starts[:-1], self.starts[1:], strict=True)):
            seen = min(int(end - begin), int(high[i] - low[i] - REACH) * over)
            if seen > 0:
                own = raw.by_state[:, :, begin : begin + seen]
                parts[i, :, :, REACH * over : REACH * over + seen] = own
        parts = self.sampled(values, self.structure.observe(values, parts, self.point))
        before = self.judged.start - int(low[0])
        parts[0, :, :, :before] = 0.0
        parts[0, :, 1, before : before + self.warm_up] = 0.0
        parts = self.weighed(parts)
        for part, length in zip(parts, high - low, strict=True):
            part[:, :, max(int(length), 0) :] = 0.0
        return parts

    @property
    def tail(self) -> int:
        """Samples over which sensors and noise model remember."""
        return 10**9 if self.coloured or self.structure.has_states else REACH

    def elementary(self, values: Floats, fixed: bool) -> tuple[Model, list[Column], Floats]:
        """The model, by what the motion is differentiated, and (columns, parameters) what that makes of each."""
        model = self.structure.model(values, self.point)
        found = [Entry(Column(F_B), {})] if fixed else self.differentiated(values, model)
        if not fixed:
            first = 0
            for term, own in zip(self.structure.terms, self.structure.split(values), strict=True):
                for wave in term.wave_columns(own, self.point):
                    by = {first + place: size for place, size in wave.by.items()}
                    found.append(Entry(Column(wave.kind, wave.code, wave.turn), by))
                first += own.size
        if model.impacts > 0.0 and model.bends(COMPACTION):
            found.append(Entry(Column(int(COUNTED)), {}))
        mixing = np.zeros((len(found), 0 if fixed else len(self.structure.unknowns)))
        for row, entry in zip(mixing, found, strict=True):
            for i, size in entry.by.items():
                row[i] = size
        return model, [each.column for each in found], mixing

    def differentiated(self, values: Floats, model: Model) -> list[Entry]:
        """Columns of scalars and laws, and how the parameters' derivatives are made of them."""
        unknowns, split = self.structure.unknowns, self.structure.split(values)
        by_scalar, laws = np.zeros((SCALARS, len(unknowns))), []
        first = 0
        for term, own in zip(self.structure.terms, split, strict=True):
            if isinstance(term, Curve):
                for j, change in enumerate(term.basis):
                    laws.append(Entry(Column(int(LAW), place=term.place, change=change), {first + j: 1.0}))
            for j, ahead in enumerate(steps_ahead(term, own) if term.moves and not isinstance(term, Curve) else ()):
                step = step_of(term, j)
                others = [ahead if each is own else each for each in split]
                other = self.structure.model(np.concatenate(others), self.point)
                by_scalar[:, first + j] = (other.s - model.s) / step
                laws += law_columns(model, other, first + j, step)
            first += own.size
        scalars = [i for i in range(SCALARS) if np.any(by_scalar[i]) or i == F_B]
        found = []
        for i in scalars:
            by = {int(j): float(by_scalar[i, j]) for j in np.flatnonzero(by_scalar[i])}
            found.append(Entry(Column(int(PHASE) if i == DRIVE_PHASE else i), by))
        return found + laws

    def shared_columns(self, values: Floats, raw: Raw, seen: Floats, mixing: Floats) -> Floats:
        """(parameters, 2, judged) by what the weighed reading changes with each parameter in units of its width."""
        moved = np.zeros((mixing.shape[1], *seen.shape[1:]))
        by_motion = mixing.any(axis=0)
        moved[by_motion] = np.tensordot(mixing.T[by_motion], seen, 1)
        at, rows = self.reading_jacobian(values, raw.said)
        if rows:
            np.add.at(moved, at, self.mask_and_whiten(np.array(rows)[:, :, self.judged]))
        return moved * self.widths[:, None, None]

    def reading_jacobian(self, values: Floats, said: Floats) -> tuple[list[int], list[Floats]]:
        """Parameters of sensors and logger, and by what (2, n) the reading changes with each."""
        terms, split = self.structure.terms, self.structure.split(values)
        firsts = np.cumsum([0, *(own.size for own in split)])
        slow, n, begun = self.point._replace(rate=self.data.rate), self.data.force.size, int(self.data.starts[0])
        at, rows = [], []

        def note(i: int, j: int, change: Floats) -> None:
            # what is of another recording changes nothing here
            if change.any():
                at.append(int(firsts[i]) + j)
                rows.append(change / step_of(terms[i], j))

        chain, signals = self.structure.signal_chain, said
        for place, i in enumerate(chain):
            passed = terms[i].observe(split[i], signals, self.point)
            for j, ahead in enumerate(steps_ahead(terms[i], split[i])):
                more = terms[i].observe(ahead, signals, self.point) - passed
                for k in chain[place + 1 :]:
                    more = terms[k].observe(split[k], more, self.point)
                note(i, j, self.sampled(values, more))
            signals = passed
        for i, (term, own) in enumerate(zip(terms, split, strict=True)):
            added = term.add(own, slow, n, begun)
            if added is not None:
                for j, ahead in enumerate(steps_ahead(term, own)):
                    more = term.add(ahead, slow, n, begun)
                    if more is not None:
                        note(i, j, more - added)
            if type(term).kernel is not Term.kernel:
                kernels = [term.kernel(each, self.fine) for each in (own, *steps_ahead(term, own))]
                first, *others = (decimated(signals, each, self.fine, self.data.thinned) for each in kernels)
                for j, other in enumerate(others):
                    note(i, j, other - first)
        return at, rows


def step_of(term: Term, parameter: int) -> float:
    """By which a parameter is moved for a difference."""
    return 1e-4 * term.unknowns[parameter].width


def steps_ahead(term: Term, own: Floats) -> list[Floats]:
    """Its parameters, each of them in turn moved by its step."""
    return [own + step_of(term, j) * (np.arange(own.size) == j) for j in range(own.size)]


def resized(own: Floats, windows: int, size: int, kept: int, lines: int) -> Floats:
    """The same with so many states a window, where it had ``kept``, and so many amplitudes of lines."""
    states = np.zeros((windows, size))
    take = min(kept, size)
    states[:, :take] = own[: windows * kept].reshape(windows, kept)[:, :take]
    behind = np.zeros(2 + lines)
    behind[:2] = own[windows * kept : windows * kept + 2]
    if own.size == windows * kept + 2 + lines:
        behind = own[windows * kept :]
    return np.concatenate([states.ravel(), behind])


def states_per_window(own: Floats, windows: int) -> int:
    """States a window of own unknowns whose lines are fewer than three windows."""
    return OWN if (own.size - 2) // windows >= OWN else 4


def absent(model: Model) -> list[int]:
    """States that the model has not: of a mount, of the air, of bristles."""
    with_them = {U: MOUNT_SQUARE, UD: MOUNT_SQUARE, Q: AIR_RATE, BENT1: BRISTLES1, BENT2: BRISTLES2}
    return [state for state, scalar in with_them.items() if not model.s[scalar] > 0.0]


class Entry(NamedTuple):
    """A column of the integrator."""

    column: Column
    by: dict[int, float]
    """Its share in the derivatives by parameters."""


def law_columns(model: Model, other: Model, parameter: int, step: float) -> list[Entry]:
    """By what the equations of a model differ from those of another, whose parameter is larger by ``step``."""
    found, at = [], 0
    stiff, other_stiff = float(model.s[K]), float(other.s[K])
    for law, beside in zip(model.laws, other.laws, strict=True):
        changes = equation_change(law, beside, stiff, other_stiff)
        for pieces in changes:
            if np.any(pieces):
                found.append(Entry(Column(int(LAW), law=at, pieces=pieces / step), {parameter: 1.0}))
            at += 1
    return found


def point_of(data: Conditioned) -> OperatingPoint:
    """What a term is told of a recording."""
    setting = data.setting
    return OperatingPoint(
        data.name, data.omega / (2.0 * math.pi), data.amplitude, setting.pressure, data.rate, data.fresh
    )
