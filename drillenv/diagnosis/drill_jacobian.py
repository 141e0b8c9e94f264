"""The log-likelihood of a recording of the drilling rig with its derivatives, for the solver.

Motions are differentiated by columns of the integrator's variational equations; what the parameters of terms make of
these is a matrix, the mixing. Sensors, which are linear, act on columns as they act on signals.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.diagnosis.coupling import damping_at, slope_from_rest, spring_slope
from drillenv.diagnosis.drill_unknowns import COUNT_LABEL, PRESSURE_LABEL, STATE_WIDTHS, absent
from drillenv.diagnosis.engine import Column, Raw, SensitivityColumn, Varied, equation_change
from drillenv.diagnosis.laws import Curve
from drillenv.diagnosis.solver import Floats, Quadratic
from drillenv.diagnosis.tables import interpolate
from drillenv.diagnosis.terms import DRIVE_PHASE, REACH, SCALARS, Model, OperatingPoint, Term
from drillenv.dynamics.constitutive.places import COMPACTION, DAMPER, SPRING, SPRING_FROM_REST
from drillenv.dynamics.hybrid.sensitivity import COUNTED, DRILLED_BEFORE, LAW, PHASE
from drillenv.dynamics.hybrid.vector_field import F_B, V1, V2, C, K, Y

if TYPE_CHECKING:
    from drillenv.diagnosis.drill import ShootingProblem


class Linearised(NamedTuple):
    """A recording about a point: what the solver needs of it, and what derivatives by more have products with."""

    part: Quadratic
    signals: Floats
    """(2, fine samples) of the simulation."""
    wide: Floats
    """(rows, 2, judged) by what the weighed reading changes with own unknowns other than states and with parameters,
    those that it does change with, and behind them the residual."""
    there: NDArray[np.int64]
    """(rows,) which of all own unknowns other than states, and of all parameters behind them, those are."""
    by_windows: Floats
    """(windows, states, 2, longest span) by what it changes with each window's states."""
    present: NDArray[np.int64]
    """(states,) which those are."""
    defects: Floats
    """(gaps,) residuals of the continuity constraints."""
    defects_by_own: Floats
    """(gaps, own unknowns)"""
    defects_by_shared: Floats
    """(gaps, parameters)"""


def quadratic(block: ShootingProblem, shared: Floats, own: Floats, fixed: bool = False) -> Quadratic:
    """Negative log-likelihood with its derivatives; ``fixed`` leaves out those by the shared parameters."""
    return linearised(block, shared, own, fixed).part


def linearised(block: ShootingProblem, shared: Floats, own: Floats, fixed: bool = False) -> Linearised:
    """The same with what it is made of."""
    values, kept = shared * block.scales, block.state_count(own)
    model = block.structure.model(values, block.point)
    first = len(block.structure.terms) if fixed else 0
    columns, mixing = with_columns_of_labels(*elementary(block, values, model, first), model)
    # the pressure is the label's, which is off by a share of it
    mixing[[each.kind == F_B for each in columns]] *= block.labelled(own, model).s[F_B] / model.s[F_B]
    varied = variations(block, own, model, columns)
    raw = block.integrate(model, own, varied)
    residual, defects = block.residual(values, raw.signals, own), block.defects(raw, kept)
    seen = columns_read(block, values, raw)
    # most parameters of recordings are of others, and change nothing here
    changing, by_shared = columns_by_parameters(block, values, raw.signals, seen, mixing, first)
    local_mixing, count = mixing_of_labels(columns, model), block.locals
    wide = np.concatenate([columns_by_locals(block, seen, local_mixing), by_shared, residual[None]])
    width = count + mixing.shape[1] + 1
    there = np.concatenate([np.arange(count), count + changing, [width - 1]])
    by_windows = window_columns(block, values, raw)
    flat = wide.reshape(len(wide), -1)
    m = block.windows * kept
    own_own, own_wide, products = np.zeros((m, m)), np.zeros((m, width)), np.zeros((width, width))
    present = indices_of_states(block, varied.present, kept)
    own_own[present[:, None], present] = products_of_windows(block, by_windows)
    own_wide[present[:, None], there] = products_with_windows(block, by_windows, wide)
    products[there[:, None], there] = flat @ flat.T
    e_own, e_shared = defect_columns(block, raw, own.size, varied, mixing, local_mixing)
    g = defects.ravel()
    off, precision = block.beliefs(own)
    hessian = e_own.T @ e_own
    hessian[:m, :m] += own_own
    hessian[:m, m:] += own_wide[:, :count]
    hessian[m:, :m] += own_wide[:, :count].T
    hessian[m:, m:] += products[:count, :count]
    air = block.air_prior(own)
    unsettled = float(air @ own)
    hessian += np.diag(precision) + np.outer(air, air)
    scale = np.append(np.diag(own_own), np.diag(products)[:count]) + precision
    cross = e_own.T @ e_shared
    cross[:m] += own_wide[:, count:-1]
    cross[m:] += products[:count, count:-1]
    by_own = e_own.T @ g - np.append(own_wide[:, -1], products[:count, -1])
    by_own += precision * off + air * unsettled
    part = Quadratic(
        0.5 * float(products[-1, -1] + g @ g + precision @ off**2 + unsettled**2),
        by_own,
        e_shared.T @ g - products[count:-1, -1],
        hessian,
        cross,
        products[count:-1, count:-1] + e_shared.T @ e_shared,
        scale,
    )
    return Linearised(part, raw.signals, wide, there, by_windows, varied.present, g, e_own, e_shared)


def indices_of_states(block: ShootingProblem, states: NDArray[np.int64], kept: int) -> NDArray[np.int64]:
    """Where some states of all windows are among own unknowns with so many states a window."""
    return (kept * np.arange(block.windows)[:, None] + states).ravel()


def columns_read(block: ShootingProblem, values: Floats, raw: Raw) -> Floats:
    """(columns, 2, judged) by what the weighed reading changes with columns of the integrator."""
    seen = block.structure.observe(values, raw.by_column, block.point_of(raw.signals))
    return block.mask_and_whiten(block.sampled(values, seen)[:, :, block.judged])


def with_columns_of_labels(columns: list[Column], mixing: Floats, model: Model) -> tuple[list[Column], Floats]:
    """Columns and mixing with those columns beside that derivatives by what is doubtful about labels are made of."""
    more = [] if any(each.kind == F_B for each in columns) else [Column(F_B)]
    if model.impacts > 0.0 and model.bends(COMPACTION):
        more += [Column(int(COUNTED)), Column(int(DRILLED_BEFORE))]
    return columns + more, np.concatenate([mixing, np.zeros((len(more), mixing.shape[1]))])


def mixing_of_labels(columns: Sequence[Column], model: Model) -> Floats:
    """(columns, 2) how the derivatives by the pressure's share and the impacts before are made of columns."""
    kinds = [each.kind for each in columns]
    made = np.zeros((len(kinds), 2))
    made[kinds.index(F_B), 0] = model.s[F_B] * PRESSURE_LABEL
    if COUNTED in kinds:
        made[kinds.index(COUNTED), 1] = model.impacts * COUNT_LABEL
        made[kinds.index(DRILLED_BEFORE), 1] = model.impacts * model.per_impact * COUNT_LABEL
    return made


def columns_by_locals(block: ShootingProblem, seen: Floats, mixing: Floats) -> Floats:
    """(locals, 2, judged) by what the weighed reading changes with own unknowns other than states.

    ``seen`` (columns, 2, judged) is the same by columns of the integrator.
    """
    moved = np.tensordot(mixing.T, seen, 1)
    rows = np.zeros((len(block.lines), 2, block.data.force.size))
    for i, (channel, row) in enumerate(block.lines):
        rows[i, channel] = block.noise[channel].std * row
    return np.concatenate([moved, block.mask_and_whiten(rows[:, :, block.judged])])


def defect_columns(block: ShootingProblem, raw: Raw, own: int, varied: Varied, mixing: Floats,
                local_mixing: Floats) -> tuple[Floats, Floats]:  # fmt: skip
    """(gaps, own) and (gaps, parameters): derivatives of the continuity constraints."""
    kept = varied.by_own.shape[1]
    over = block.continuity(kept)
    pairs = block.windows - 1
    by_own = np.zeros((pairs, kept, own))
    for i in range(pairs):
        by_own[i, :, (i + 1) * kept : (i + 2) * kept] = varied.by_own[i + 1]
        by_own[i][:, i * kept + varied.present] = -raw.ends_by_state[i, :, :kept].T
    change = varied.by_column[1:] - raw.ends_by_column[:-1, :, :kept]
    first = block.windows * kept
    turned = change.transpose(0, 2, 1)
    by_own[:, :, first : first + 2] = turned @ local_mixing
    by_shared = turned @ mixing
    return ((by_own / over[:, None]).reshape(-1, own), (by_shared / over[:, None]).reshape(pairs * kept, -1))


def products_of_windows(block: ShootingProblem, by_windows: Floats) -> Floats:
    """(states, states) inner products of the columns of windows' states.

    A window's own columns reach beyond its end as far as the sensors and the noise model remember, at most over the
    next window.
    """
    w, kept = by_windows.shape[:2]
    low, high = spans(block)
    products = np.zeros((w * kept, w * kept))
    flat = by_windows.reshape(w, kept, -1)
    within = flat @ flat.transpose(0, 2, 1)
    for i in range(w):
        rows, begin = slice(i * kept, (i + 1) * kept), max(low[i], block.judged.start)
        products[rows, rows] = within[i]
        overlap = high[i - 1] - begin if i > 0 and high[i] > begin else 0
        if overlap > 0:
            seen = by_windows[i, :, :, begin - low[i] :][:, :, :overlap].reshape(kept, -1)
            before = by_windows[i - 1, :, :, begin - low[i - 1] : high[i - 1] - low[i - 1]].reshape(kept, -1)
            beside = slice((i - 1) * kept, i * kept)
            products[rows, beside] = seen @ before.T
            products[beside, rows] = products[rows, beside].T
    return products


def products_with_windows(block: ShootingProblem, by_windows: Floats, wide: Floats) -> Floats:
    """(states, rows) inner products of the columns of windows' states with rows (rows, 2, judged)."""
    w, kept, first = *by_windows.shape[:2], block.judged.start
    low, high = spans(block)
    products = np.zeros((w * kept, len(wide)))
    for i in range(w):
        # the first window's columns are zero before the first sample that is judged
        begin = max(low[i], first)
        if high[i] > begin:
            seen = by_windows[i, :, :, begin - low[i] : high[i] - low[i]].reshape(kept, -1)
            there = wide[:, :, begin - first : high[i] - first].reshape(len(wide), seen.shape[1])
            products[i * kept : (i + 1) * kept] = seen @ there.T
    return products


def spans(block: ShootingProblem) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(windows,) samples from which and up to which a window's states show, at most over the next window."""
    starts = block.data.starts
    low, high = starts[:-1] - REACH, np.minimum(starts[1:] + tail(block), block.judged.stop)
    high[:-1] = np.minimum(high[:-1], starts[2:] - REACH)
    return low, high


def window_columns(block: ShootingProblem, values: Floats, raw: Raw) -> Floats:
    """(windows, states, 2, longest span) by what the weighed reading changes with each window's states."""
    over, (low, high) = block.over, spans(block)
    longest = int((high - low).max())
    parts = np.zeros((block.windows, len(raw.by_state), 2, longest * over))
    there = block.touching(raw.signals)
    touching = np.zeros((block.windows, 1, longest * over), dtype=bool)
    for i, (begin, end) in enumerate(zip(block.starts[:-1], block.starts[1:], strict=True)):
        seen = min(int(end - begin), int(high[i] - low[i] - REACH) * over)
        if seen > 0:
            own = raw.by_state[:, :, begin : begin + seen]
            parts[i, :, :, REACH * over : REACH * over + seen] = own
            touching[i, :, REACH * over : REACH * over + seen] = there[begin : begin + seen]
    parts = block.sampled(values, block.structure.observe(values, parts, block.point._replace(touching=touching)))
    before = block.judged.start - int(low[0])
    parts[0, :, :, :before] = 0.0
    parts[0, :, 1, before : before + block.warm_up] = 0.0
    parts = block.weighed(parts)
    for part, length in zip(parts, high - low, strict=True):
        part[:, :, max(int(length), 0) :] = 0.0
    return parts


def tail(block: ShootingProblem) -> int:
    """Samples over which sensors and noise model remember."""
    return 10**9 if block.coloured or block.structure.sensors_have_memory else REACH


def elementary(block: ShootingProblem, values: Floats, model: Model, first: int) -> tuple[list[Column], Floats]:
    """By what the motion is differentiated, and (columns, parameters) what that makes of each, in the solver's units.

    By the parameters of terms from the first one on.
    """
    found = differentiated(block, values, model, first)
    terms, parts = block.structure.terms, block.structure.parts
    for term, part in zip(terms[first:], parts[first:], strict=True):
        for column, by in term.wave_columns(values[part], block.point):
            found.append((column, {part.start + place: size for place, size in by.items()}))
    mixing = np.zeros((len(found), values.size))
    for row, (_column, by) in zip(mixing, found, strict=True):
        row[list(by)] = list(by.values())
    known = parts[first].start if first < len(parts) else values.size
    return [column for column, _ in found], (mixing * block.scales)[:, known:]


def differentiated(block: ShootingProblem, values: Floats, model: Model, first: int) -> list[SensitivityColumn]:
    """Columns of scalars and laws, and how the derivatives by parameters of terms from the first are made of them."""
    by_scalar, laws = np.zeros((SCALARS, values.size)), []
    for term, part in list(zip(block.structure.terms, block.structure.parts, strict=True))[first:]:
        if isinstance(term, Curve):
            for j, change in enumerate(term.basis, part.start):
                laws.append((Column(int(LAW), place=term.place, change=change), {j: 1.0}))
            continue
        for j in range(part.start, part.stop) if term.moves else ():
            step = step_of(term, j - part.start)
            ahead = values.copy()
            ahead[j] += step
            other = block.structure.model(ahead, block.point)
            by_scalar[:, j] = (other.s - model.s) / step
            laws += law_columns(model, other, j, step)
    found = []
    for i in np.flatnonzero(by_scalar.any(axis=1)).tolist():
        by = {int(j): float(by_scalar[i, j]) for j in np.flatnonzero(by_scalar[i])}
        found.append((Column(int(PHASE) if i == DRIVE_PHASE else i), by))
    return found + laws


def columns_by_parameters(
    block: ShootingProblem, values: Floats, said: Floats, seen: Floats, mixing: Floats, first: int
) -> tuple[NDArray[np.int64], Floats]:
    """Parameters of terms from the first that the weighed reading changes with, and by what, (m, 2, judged).

    In the solver's units; ``said`` (2, fine samples) is the simulation, ``seen`` (columns, 2, judged) what the weighed
    reading changes with columns of it, of which those by parameters are made.
    """
    by_motion = np.flatnonzero(mixing.any(axis=0))
    at, rows = reading_jacobian(block, values, said, first)
    changing = np.union1d(by_motion, np.array(at, dtype=np.int64))
    moved = np.zeros((changing.size, *seen.shape[1:]))
    moved[np.searchsorted(changing, by_motion)] = np.tensordot(mixing.T[by_motion], seen, 1)
    if rows:
        weighed = block.mask_and_whiten(np.array(rows)[:, :, block.judged])
        for i, row in zip(np.searchsorted(changing, at), weighed, strict=True):
            moved[i] += row
    return changing, moved


def reading_jacobian(
    block: ShootingProblem, values: Floats, said: Floats, first: int
) -> tuple[list[int], list[Floats]]:
    """Parameters of sensors and logger, and by what (2, n) the reading changes with each; as above."""
    terms, parts = block.structure.terms, block.structure.parts
    at: list[int] = []
    rows: list[Floats] = []
    if first == len(terms):
        return at, rows
    slow, n, begun = block.point._replace(rate=block.data.rate), block.data.force.size, int(block.data.starts[0])

    def note(i: int, j: int, row: Floats) -> None:
        # what is of another recording changes nothing here
        if row.any():
            at.append(parts[i].start - parts[first].start + j)
            rows.append(row)

    chain, signals, point = block.structure.signal_chain, said, block.point_of(said)
    for place, i in enumerate(chain):
        passed = terms[i].observe(values[parts[i]], signals, point)
        if i >= first:
            moved = observed_columns(terms[i], values[parts[i]], signals, passed, point)
            for k in chain[place + 1 :]:
                moved = terms[k].observe(values[parts[k]], moved, point)
            for j, row in enumerate(block.sampled(values, moved)):
                note(i, j, row)
        signals = passed
    for i, term in enumerate(terms[first:], first):
        own = values[parts[i]]
        added = term.add(own, slow, n, begun)
        if added is not None:
            for j, ahead in enumerate(steps_ahead(term, own)):
                more = term.add(ahead, slow, n, begun)
                if more is not None:
                    note(i, j, (more - added) / STEP)
        if type(term).kernel is not Term.kernel:
            kernels = [term.kernel(each, block.fine) for each in (own, *steps_ahead(term, own))]
            before, *others = (block.decimated(signals, each) for each in kernels)
            for j, other in enumerate(others):
                note(i, j, (other - before) / STEP)
    return at, rows


def observed_columns(term: Term, own: Floats, signals: Floats, passed: Floats, point: OperatingPoint) -> Floats:
    """(parameters, 2, n) by what a sensor makes of signals (2, n) changes with each parameter, in the solver's units.

    ``passed`` (2, n) is what it makes of them.
    """
    exact = term.derivatives(signals, point)
    if exact is not None:
        return exact * term.scales[:, None, None]
    return np.array([(term.observe(ahead, signals, point) - passed) / STEP for ahead in steps_ahead(term, own)])


def variations(block: ShootingProblem, own: Floats, model: Model, given: Sequence[Column]) -> Varied:
    """By what the motion is differentiated, and what that makes of the states that windows begin with."""
    kept, axes = block.state_count(own), block.structure.axes
    begin = block.begun(own, model)
    model = block.labelled(own, model)
    y, closing = begin[:, Y], begin[:, V1] - begin[:, V2]
    rest = model.s[F_B] / model.s[K]
    stiff, damped = spring_slope(y, model, axes), damping_at(closing, model, axes)
    beyond_rest = slope_from_rest(y, model, axes)
    by_own, present = np.zeros((block.windows, kept, kept)), np.setdiff1d(np.arange(kept), absent(model))
    for i in present[V2:]:
        by_own[:, i, i] = STATE_WIDTHS[i]
    by_own[:, Y, Y] = STATE_WIDTHS[Y] / stiff
    by_own[:, V1, V1] = STATE_WIDTHS[V1] / damped
    by_own[:, V1, V2] = STATE_WIDTHS[V2]
    by_column = np.zeros((block.windows, len(given), kept))
    for j, column in enumerate(given):
        place, change = column.place, column.drawn if column.change is None else column.change
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
    return Varied(given, by_own, by_column, present)


STEP = 1e-4
"""In the solver's units, by which a parameter is moved for a difference."""


def step_of(term: Term, parameter: int) -> float:
    """The same in the parameter's unit."""
    return STEP * term.unknowns[parameter].scale


def steps_ahead(term: Term, own: Floats) -> list[Floats]:
    """Its parameters, each of them in turn moved by its step."""
    return [own + step_of(term, j) * (np.arange(own.size) == j) for j in range(own.size)]


def law_columns(model: Model, other: Model, parameter: int, step: float) -> list[SensitivityColumn]:
    """By what the equations of a model differ from those of another, whose parameter is larger by ``step``."""
    found, at = [], 0
    stiff, other_stiff = float(model.s[K]), float(other.s[K])
    for law, beside in zip(model.laws, other.laws, strict=True):
        for place, pieces, drawn in equation_change(law, beside, stiff, other_stiff):
            if np.any(pieces):
                drawn = None if drawn is None else drawn / step
                column = Column(int(LAW), place=place, law=at, pieces=pieces / step, drawn=drawn)
                found.append((column, {parameter: 1.0}))
            at += 1
    return found
