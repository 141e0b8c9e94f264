"""The log-likelihood of a recording of the drilling rig with its derivatives, for the solver.

Motions are differentiated by columns of the integrator's variational equations; what the parameters of terms make of
these is a matrix, the mixing. Sensors, which are linear, act on columns as they act on signals.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drillenv.diagnosis.coupling import damping_at, slope_from_rest, spring_slope
from drillenv.diagnosis.drill_unknowns import COUNT_LABEL, PRESSURE_LABEL, STATE_WIDTHS, absent
from drillenv.diagnosis.engine import Column, Raw, SensitivityColumn, Varied, equation_change
from drillenv.diagnosis.laws import Curve
from drillenv.diagnosis.solver import Floats, Quadratic
from drillenv.diagnosis.tables import interpolate
from drillenv.diagnosis.terms import DRIVE_PHASE, REACH, SCALARS, Model, Term
from drillenv.dynamics.constitutive.places import COMPACTION, DAMPER, SPRING, SPRING_FROM_REST
from drillenv.dynamics.hybrid.sensitivity import COUNTED, LAW, PHASE
from drillenv.dynamics.hybrid.vector_field import F_B, V1, V2, C, K, Y

if TYPE_CHECKING:
    from drillenv.diagnosis.drill import ShootingProblem


def quadratic(block: ShootingProblem, shared: Floats, own: Floats, fixed: bool = False) -> Quadratic:
    """Negative log-likelihood with its derivatives; ``fixed`` leaves out those by the shared parameters."""
    values, kept = shared * block.scales, block.state_count(own)
    model, columns, mixing = elementary(block, values, fixed)
    varied = variations(block, own, model, columns)
    raw = block.integrate(model, own, varied)
    residual, defects = block.residual(values, raw.signals, own), block.defects(raw, kept)
    seen = block.structure.observe(values, raw.by_column, block.point)
    seen = block.mask_and_whiten(block.sampled(values, seen)[:, :, block.judged])
    # most parameters of recordings are of others, and change nothing here
    changing, by_shared = columns_by_parameters(block, values, raw, seen, mixing)
    local_mixing, count = mixing_of_labels(columns, model), block.locals
    wide = np.concatenate([columns_by_locals(block, seen, local_mixing), by_shared, residual[None]])
    width = count + mixing.shape[1] + 1
    there = np.concatenate([np.arange(count), count + changing, [width - 1]])
    by_state, by_state_there = window_products(block, values, raw, wide)
    flat = wide.reshape(len(wide), -1)
    m = block.windows * kept
    own_own, own_wide, products = np.zeros((m, m)), np.zeros((m, width)), np.zeros((width, width))
    present = (kept * np.arange(block.windows)[:, None] + varied.present).ravel()
    own_own[present[:, None], present] = by_state
    own_wide[present[:, None], there], products[there[:, None], there] = by_state_there, flat @ flat.T
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
    return Quadratic(
        0.5 * float(products[-1, -1] + g @ g + precision @ off**2 + unsettled**2),
        by_own,
        e_shared.T @ g - products[count:-1, -1],
        hessian,
        cross,
        products[count:-1, count:-1] + e_shared.T @ e_shared,
        scale,
    )


def mixing_of_labels(columns: Sequence[Column], model: Model) -> Floats:
    """(columns, 2) how the derivatives by the pressure's share and the impacts before are made of columns."""
    kinds = [each.kind for each in columns]
    made = np.zeros((len(kinds), 2))
    made[kinds.index(F_B), 0] = model.s[F_B] * PRESSURE_LABEL
    if COUNTED in kinds:
        made[kinds.index(COUNTED), 1] = model.impacts * COUNT_LABEL
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
    by_shared = turned @ mixing * block.scales[: mixing.shape[1]]
    return ((by_own / over[:, None]).reshape(-1, own), (by_shared / over[:, None]).reshape(pairs * kept, -1))


def window_products(block: ShootingProblem, values: Floats, raw: Raw, wide: Floats) -> tuple[Floats, Floats]:
    """(states, states) and (states, wide) inner products of the columns of windows' states, those of the model alone.

    ``wide`` (m, 2, judged) are columns over the whole recording. A window's own columns reach beyond its end as far
    as the sensors and the noise model remember, at most over the next window.
    """
    w, kept, first = block.windows, len(raw.by_state), block.judged.start
    own_own = np.zeros((w * kept, w * kept))
    own_wide = np.zeros((w * kept, len(wide)))
    low, high = spans(block)
    parts = window_columns(block, values, raw, low, high)
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


def spans(block: ShootingProblem) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(windows,) samples from which and up to which a window's states show, at most over the next window."""
    starts = block.data.starts
    low, high = starts[:-1] - REACH, np.minimum(starts[1:] + tail(block), block.judged.stop)
    high[:-1] = np.minimum(high[:-1], starts[2:] - REACH)
    return low, high


def window_columns(block: ShootingProblem, values: Floats, raw: Raw, low: NDArray, high: NDArray) -> Floats:
    """(windows, states, 2, longest span) by what the weighed reading changes with each window's states."""
    over = block.over
    longest = int((high - low).max())
    parts = np.zeros((block.windows, len(raw.by_state), 2, longest * over))
    for i, (begin, end) in enumerate(zip(block.starts[:-1], block.starts[1:], strict=True)):
        seen = min(int(end - begin), int(high[i] - low[i] - REACH) * over)
        if seen > 0:
            own = raw.by_state[:, :, begin : begin + seen]
            parts[i, :, :, REACH * over : REACH * over + seen] = own
    parts = block.sampled(values, block.structure.observe(values, parts, block.point))
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


def elementary(block: ShootingProblem, values: Floats, fixed: bool) -> tuple[Model, list[Column], Floats]:
    """The model, by what the motion is differentiated, and (columns, parameters) what that makes of each."""
    model = block.structure.model(values, block.point)
    found: list[SensitivityColumn] = [(Column(F_B), {})] if fixed else differentiated(block, values, model)
    if not fixed:
        first = 0
        for term, own in zip(block.structure.terms, block.structure.split(values), strict=True):
            for column, by in term.wave_columns(own, block.point):
                found.append((column, {first + place: size for place, size in by.items()}))
            first += own.size
    if model.impacts > 0.0 and model.bends(COMPACTION):
        found.append((Column(int(COUNTED)), {}))
    mixing = np.zeros((len(found), 0 if fixed else len(block.structure.unknowns)))
    for row, (_column, by) in zip(mixing, found, strict=True):
        row[list(by)] = list(by.values())
    return model, [column for column, _ in found], mixing


def differentiated(block: ShootingProblem, values: Floats, model: Model) -> list[SensitivityColumn]:
    """Columns of scalars and laws, and how the parameters' derivatives are made of them."""
    unknowns, split = block.structure.unknowns, block.structure.split(values)
    by_scalar, laws = np.zeros((SCALARS, len(unknowns))), []
    first = 0
    for term, own in zip(block.structure.terms, split, strict=True):
        if isinstance(term, Curve):
            for j, change in enumerate(term.basis):
                laws.append((Column(int(LAW), place=term.place, change=change), {first + j: 1.0}))
        for j, ahead in enumerate(steps_ahead(term, own) if term.moves and not isinstance(term, Curve) else ()):
            step = step_of(term, j)
            others = [ahead if each is own else each for each in split]
            other = block.structure.model(np.concatenate(others), block.point)
            by_scalar[:, first + j] = (other.s - model.s) / step
            laws += law_columns(model, other, first + j, step)
        first += own.size
    scalars = [i for i in range(SCALARS) if np.any(by_scalar[i]) or i == F_B]
    found = []
    for i in scalars:
        by = {int(j): float(by_scalar[i, j]) for j in np.flatnonzero(by_scalar[i])}
        found.append((Column(int(PHASE) if i == DRIVE_PHASE else i), by))
    return found + laws


def columns_by_parameters(
    block: ShootingProblem, values: Floats, raw: Raw, seen: Floats, mixing: Floats
) -> tuple[NDArray[np.int64], Floats]:
    """Parameters that the weighed reading changes with, and by what, (m, 2, judged), in units of their scales."""
    by_motion = np.flatnonzero(mixing.any(axis=0))
    at, rows = reading_jacobian(block, values, raw.signals) if mixing.size else ([], [])
    changing = np.union1d(by_motion, np.array(at, dtype=np.int64))
    moved = np.zeros((changing.size, *seen.shape[1:]))
    moved[np.searchsorted(changing, by_motion)] = np.tensordot(mixing.T[by_motion], seen, 1)
    if rows:
        weighed = block.mask_and_whiten(np.array(rows)[:, :, block.judged])
        for i, row in zip(np.searchsorted(changing, at), weighed, strict=True):
            moved[i] += row
    return changing, moved * block.scales[changing, None, None]


def reading_jacobian(block: ShootingProblem, values: Floats, said: Floats) -> tuple[list[int], list[Floats]]:
    """Parameters of sensors and logger, and by what (2, n) the reading changes with each."""
    terms, split = block.structure.terms, block.structure.split(values)
    firsts = np.cumsum([0, *(own.size for own in split)])
    slow, n, begun = block.point._replace(rate=block.data.rate), block.data.force.size, int(block.data.starts[0])
    at, rows = [], []

    def note(i: int, j: int, change: Floats) -> None:
        # what is of another recording changes nothing here
        if change.any():
            at.append(int(firsts[i]) + j)
            rows.append(change / step_of(terms[i], j))

    chain, signals = block.structure.signal_chain, said
    for place, i in enumerate(chain):
        passed = terms[i].observe(split[i], signals, block.point)
        for j, ahead in enumerate(steps_ahead(terms[i], split[i])):
            more = terms[i].observe(ahead, signals, block.point) - passed
            for k in chain[place + 1 :]:
                more = terms[k].observe(split[k], more, block.point)
            note(i, j, block.sampled(values, more))
        signals = passed
    for i, (term, own) in enumerate(zip(terms, split, strict=True)):
        added = term.add(own, slow, n, begun)
        if added is not None:
            for j, ahead in enumerate(steps_ahead(term, own)):
                more = term.add(ahead, slow, n, begun)
                if more is not None:
                    note(i, j, more - added)
        if type(term).kernel is not Term.kernel:
            kernels = [term.kernel(each, block.fine) for each in (own, *steps_ahead(term, own))]
            first, *others = (block.decimated(signals, each) for each in kernels)
            for j, other in enumerate(others):
                note(i, j, other - first)
    return at, rows


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
    return Varied(given, by_own, by_column, present)


def step_of(term: Term, parameter: int) -> float:
    """By which a parameter is moved for a difference."""
    return 1e-4 * term.unknowns[parameter].scale


def steps_ahead(term: Term, own: Floats) -> list[Floats]:
    """Its parameters, each of them in turn moved by its step."""
    return [own + step_of(term, j) * (np.arange(own.size) == j) for j in range(own.size)]


def law_columns(model: Model, other: Model, parameter: int, step: float) -> list[SensitivityColumn]:
    """By what the equations of a model differ from those of another, whose parameter is larger by ``step``."""
    found, at = [], 0
    stiff, other_stiff = float(model.s[K]), float(other.s[K])
    for law, beside in zip(model.laws, other.laws, strict=True):
        changes = equation_change(law, beside, stiff, other_stiff)
        for pieces in changes:
            if np.any(pieces):
                found.append((Column(int(LAW), law=at, pieces=pieces / step), {parameter: 1.0}))
            at += 1
    return found
