"""The drilling rig as blocks of the solver: one for each recording, by multiple shooting.

Own unknowns of a recording are the states at the beginning of each of its windows, the share by which its true pressure
is off the label, and the amplitudes of disturbing lines on its channels. Shared parameters are the rig's constants and
those of the terms (laws, filters) that have been added to the paper's model.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drillenv.diagnosis import drill_extension, drill_jacobian, drill_states
from drillenv.diagnosis.adapter import RecordingProblem
from drillenv.diagnosis.condition import Conditioned, thin, thinning
from drillenv.diagnosis.coupling import closing_speed, damper_force, is_invertible, shortening, spring_coordinate
from drillenv.diagnosis.drill_unknowns import (
    AIR_AT_START,
    BENT,
    CONTINUITY,
    COUNT_LABEL,
    FIRST_STATE,
    MASSES,
    PRESSURE_LABEL,
    STATE_WIDTHS,
    absent,
    resized,
    states_under,
)
from drillenv.diagnosis.engine import Raw, Varied, assembled, columns_of, raw_of
from drillenv.diagnosis.fitting import TIGHT
from drillenv.diagnosis.noise import NoiseModel, line_columns, nuisance, whiten
from drillenv.diagnosis.solver import Floats, Quadratic
from drillenv.diagnosis.terms import REACH, Model, ModelStructure, OperatingPoint
from drillenv.dynamics.constitutive.tables import NotSmoothError
from drillenv.dynamics.hybrid.advance import WENT_ON
from drillenv.dynamics.hybrid.model import fresh_motion
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.sensitivity import make_variation
from drillenv.dynamics.hybrid.shooting import UNCHAINED, Shot, Windows, shoot
from drillenv.dynamics.hybrid.vector_field import BED, BENT1, DRILLED, OWN, V1, V2, Q, W, Y

DENSE = 50e3
"""Hz at which motions are followed at least, before the logger's filter."""
PATH_STEP = 84e-6
"""s from one state of a path to the next at most."""
TOLERANCE = 1e-7
"""Relative error of a step of the integrator."""
CHAINED = np.isin(np.arange(OWN), (V2, W), invert=True)
"""States that go on from window to window in a rollout: impacts magnify what is wrong of the indenter's."""
GRAZING = 2e-3
"""m/s of a contact's speed below which the jump of the derivatives is held back."""


def decimated(signals: Floats, kernel: Floats | None, fine: int, thinned: int) -> Floats:
    """Signals (..., n) through the logger's centred kernel, at one in ``fine``, and thinned as the recording was."""
    if kernel is None:
        return thin(signals[..., ::fine], thinned)
    over = fine * thinned
    rows = np.ascontiguousarray(signals).reshape(-1, signals.shape[-1])
    made = np.empty((len(rows), rows.shape[1] // over))
    _filter_decimate(rows, _reversed_taps(kernel.tobytes(), fine, thinned), over, made)
    return made.reshape(*signals.shape[:-1], made.shape[1])


@lru_cache(maxsize=64)
def _reversed_taps(kernel: bytes, fine: int, thinned: int) -> Floats:
    """The logger's kernel and that of thinning in one, reversed, with whole samples on either side of its middle."""
    taps = thinning(thinned)
    spread = np.zeros(fine * (taps.size - 1) + 1)
    spread[::fine] = taps
    whole = np.convolve(np.frombuffer(kernel), spread)
    over = fine * thinned
    reach = math.ceil((whole.size // 2) / over)
    return np.pad(whole, reach * over - whole.size // 2)[::-1].copy()


@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz", "contract"})
def _filter_decimate(rows, taps, over, made):
    """Rows (m, n) by centred taps, reversed, at one sample in ``over``, into made (m, n // over); 0 beyond the ends.

    As scipy.signal.upfirdn, whose inner loop is over one sample at a time, several times as fast.
    """
    half, n = taps.size // 2, rows.shape[1]
    for i in range(rows.shape[0]):
        if not rows[i].any():
            # most columns of the Jacobian are zero on one of the channels
            made[i] = 0.0
            continue
        for j in range(made.shape[1]):
            begin = j * over - half
            low, high = max(0, -begin), min(taps.size, n - begin)
            # loops over slices, whose indices cannot be negative, are made into vector instructions
            own, there, total = taps[low:high], rows[i, begin + low : begin + high], 0.0
            for k in range(own.size):
                total += own[k] * there[k]
            made[i, j] = total


@dataclass
class ShootingProblem(RecordingProblem):
    """A recording as a block of the solver."""

    data: Conditioned
    structure: ModelStructure
    slack: float
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
        self.scales: np.ndarray = self.structure.scales
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
        made = np.zeros(signals.shape)
        for i, each in enumerate(self.noise):
            # most columns of the Jacobian are zero on one of the channels
            there = signals[..., i, :].any(axis=-1)
            made[..., i, :][there] = whiten(each, signals[..., i, :][there])
        return made

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

    def constant_added(self, own: Floats) -> Floats:
        """(2,) mean over the recording of what lines add that make less than a turn in it: constants and drifts."""
        n, rate = self.measured.shape[-1], self.data.rate

        def mean(channel: int) -> float:
            slow = [(f, sizes) for f, sizes in self.lines_of(channel, own) if f * n < rate]
            return sum(float(sizes @ line_columns([f], rate, n).mean(axis=1)) for f, sizes in slow)

        return np.array([mean(0), mean(1)])

    @property
    def locals(self) -> int:
        """Own unknowns behind the states: share of the pressure, impacts before it began, and the lines."""
        return 2 + len(self.lines)

    def integrate(self, model: Model, own: Floats, varied: Varied | None = None, path: bool = False,
                  chained: NDArray[np.bool_] = UNCHAINED) -> Raw:  # fmt: skip
        """Simulate all windows, with derivatives by own states and columns where ``varied`` says by which.

        ``own`` as the solver has it; of the states (OWN,) some may be ``chained``, and go on from window to window.
        """
        data, n, kept = self.data, self.data.force.size * self.over, self.state_count(own)
        given, states = (varied.columns, varied.present.size) if varied is not None else ((), 0)
        count = states + len(given)
        labelled, axes = self.labelled(own, model), self.structure.axes
        impacts = max(model.impacts * (1.0 + COUNT_LABEL * own[self.windows * kept + 1]), 0.0)
        drilled = impacts * model.per_impact
        shot = Shot(
            np.zeros((OWN, n // self.stride if path else 0)),
            np.zeros((2, n)),
            np.zeros((count, 2, n)),
            np.zeros((self.windows, OWN)),
            np.zeros((self.windows, count, OWN)),
        )
        try:
            made = assembled(labelled, axes, data.omega, [each.place for each in given if each.change is not None])
        except NotSmoothError:
            # parameters with which a law is no curve any more
            return raw_of(shot, shot.ends, states, False)
        if not is_invertible(labelled, axes):
            return raw_of(shot, shot.ends, states, False)
        begin = self.begun(own, model)
        columns = columns_of(given, labelled, axes, made, states)
        begin_by = np.zeros((self.windows, count, OWN))
        if varied is not None:
            begin_by[:, :states, :kept] = varied.by_own[:, :, varied.present].transpose(0, 2, 1)
            begin_by[:, states:, :kept] = varied.by_column
        windows = Windows(self.starts, begin, begin_by, self.point.rate, data.phase + made.phase,
                          impacts, drilled, chained, self.stride, GRAZING)  # fmt: skip
        d = fresh_motion(made.model).d
        status, done = shoot(made.model, d, TOLERANCE, windows, columns, shot, make_variation(made.model, count),
                             make_scratch(made.model))  # fmt: skip
        per_impact = (float(d[DRILLED]) - drilled) / max(done - impacts, 1.0)
        return raw_of(shot, begin, states, status == WENT_ON)._replace(per_impact=per_impact)

    def path(self, model: Model, own: Floats) -> Floats:
        """(OWN, n) states along the motion, from the first window to the last, at the integrator's steps."""
        return self.inside_path(self.integrate(model, own, path=True).path)

    def inside_path(self, path: Floats) -> Floats:
        """The part of a path from the first window to the last."""
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

    def under(
        self, structure: ModelStructure, own: Floats, slack: float | None = None, noise: Any = None
    ) -> tuple[ShootingProblem, Floats]:
        """The same under another model structure, slack and noise, and its own unknowns in their layout."""
        # lines and drifts of the noise, as long as the recording, are as they were where the noise is
        other = copy(self) if noise is None else replace(self, noise=noise)
        other.structure, other.scales = structure, structure.scales
        other.slack = self.slack if slack is None else slack
        return other, resized(own, self.windows, states_under(structure), self.state_count(own), len(other.lines))

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
        values = shared * self.scales
        model = self.structure.model(values, self.point)
        raw = self.integrate(model, own)
        if not raw.completed:
            return math.inf, np.full(self.windows, math.inf)
        full = np.zeros(raw.signals.shape[1])
        off, precision = self.beliefs(own)
        # states from which a motion runs away cost more than numbers can say
        with np.errstate(over="ignore", invalid="ignore"):
            full[self.judged] = (self.residual(values, raw.signals, own) ** 2).sum(axis=0)
            defects = (self.defects(raw, self.state_count(own)) ** 2).sum(axis=1)
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
        if self.state_count(own) > MASSES:
            precision[BENT1:BED] = (STATE_WIDTHS[BENT1:BED] / BENT) ** 2
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
        if kept > MASSES:
            air = row[: self.windows * kept].reshape(self.windows, kept)[:, Q]
            air[0] = 1.0
            if not self.data.fresh:
                air -= 1.0 / self.windows
        return row * STATE_WIDTHS[Q] / AIR_AT_START

    def try_step(self, shared: Floats, own: Floats, move: Floats, before: float) -> tuple[float, Floats]:
        """Cost and own unknowns after their step, or as much of it as does not make the recording worse."""
        return drill_states.line_search(self, shared, own, move, before)

    def inner_steps(self, shared: Floats, tried: tuple[float, Floats], before: float) -> tuple[float, Floats]:
        """Cost and own unknowns after such a step, with steps of their own where it made the recording worse."""
        return drill_states.inner_steps(self, shared, tried, before)

    def find_states(self, shared: Floats, guess: Floats) -> Floats:
        """Own unknowns from a first guess: see :func:`drillenv.diagnosis.drill_states.find_states`."""
        return drill_states.find_states(self, shared, guess)

    def estimate_states(self, shared: Floats, own: Floats, steps: int = 15) -> Floats:
        """Own unknowns after Levenberg-Marquardt steps of their own."""
        return drill_states.estimate_states(self, shared, own, steps)

    def reinitialise_outliers(self, shared: Floats, own: Floats, outlying: bool) -> Floats:
        """Own unknowns, windows that stand out begun anew; a recording that is ``outlying`` as a whole."""
        return drill_states.reinitialise_outliers(self, shared, own, outlying)

    def quadratic(self, shared: Floats, own: Floats, fixed: bool = False) -> Quadratic:
        """Negative log-likelihood with its derivatives; ``fixed`` leaves out those by the shared parameters."""
        return drill_jacobian.quadratic(self, shared, own, fixed)

    def reduced_under(
        self, shared: Floats, own: Floats, structures: Iterable[ModelStructure]
    ) -> list[tuple[Floats, Floats]]:
        """See :func:`drillenv.diagnosis.drill_extension.reduced_under`."""
        return drill_extension.reduced_under(self, shared, own, structures)

    def owned(self, states: Floats, model: Model, kept: int) -> Floats:
        """(windows, kept) own unknowns of states (windows, OWN); the model has the recording's pressure."""
        found = states.copy()
        found[:, Y] = spring_coordinate(states[:, Y], model, self.structure.axes)
        found[:, V1] = damper_force(states[:, V1] - states[:, V2], model, self.structure.axes)
        return found[:, :kept] / STATE_WIDTHS[:kept]

    def rollout(self, shared: Floats, own: Floats) -> Floats:
        """Own unknowns with which all states go on from window to window, but for the indenter's."""
        values, kept = shared * self.scales, self.state_count(own)
        model = self.structure.model(values, self.point)
        begin = self.integrate(model, own, chained=CHAINED).begin
        return np.append(self.owned(begin, self.labelled(own, model), kept).ravel(), own[self.windows * kept :])

    def residual(self, values: Floats, signals: Floats, own: Floats) -> Floats:
        """(2, judged) measured less read, as the noise model weighs it."""
        read = self.read(values, signals) + self.disturbance(own)
        return self.mask_and_whiten((self.measured - read)[:, self.judged])

    def touching(self, signals: Floats) -> NDArray[np.bool_]:
        """(fine samples,) at which the rock pushes in simulated signals (2, fine samples)."""
        return signals[0] > 0.0

    def point_of(self, signals: Floats) -> OperatingPoint:
        """The operating point with what simulated signals say of the contact."""
        return self.point._replace(touching=self.touching(signals))

    def read(self, values: Floats, signals: Floats) -> Floats:
        """(2, n) what the logger makes of the simulated signals, the lines aside."""
        read = self.sampled(values, self.structure.observe(values, signals, self.point_of(signals)))
        # what is added is slow, so that the logger's filter lets it pass
        point = self.point._replace(rate=self.data.rate)
        return read + self.structure.added(values, read.shape[1], point, int(self.data.starts[0]))

    def sampled(self, values: Floats, signals: Floats) -> Floats:
        """Signals (..., fine) filtered by the logger, at its samples."""
        return self.decimated(signals, self.structure.kernel(values, self.fine))

    def decimated(self, signals: Floats, kernel: Floats | None) -> Floats:
        """Signals (..., fine) through a logger's kernel, None for none, at its samples."""
        return decimated(signals, kernel, self.fine, self.data.thinned)

    def defects(self, raw: Raw, kept: int) -> Floats:
        """(windows - 1, kept) residuals of the continuity constraints."""
        return (raw.begin[1:, :kept] - raw.ends[:-1, :kept]) / self.continuity(kept)

    def free_unknowns(self, own: Floats) -> int:
        """How many own unknowns the samples alone have to tell: those that continuity ties to no others."""
        tied = self.state_count(own) - (0 if self.slack <= TIGHT else MASSES)
        return own.size - (self.windows - 1) * tied

    def continuity(self, kept: int) -> Floats:
        """(kept,) standard deviations with which windows go on from each other.

        States that come beside those of the masses forget how they began: where windows are nearly free, to leave
        theirs free as well would let them explain anything.
        """
        return CONTINUITY[:kept] * np.where(np.arange(kept) < MASSES, self.slack, 1.0)


def point_of(data: Conditioned) -> OperatingPoint:
    """What a term is told of a recording."""
    setting = data.setting
    return OperatingPoint(
        data.name, data.omega / (2.0 * math.pi), data.amplitude, setting.pressure, data.rate, data.fresh, data.blow
    )
