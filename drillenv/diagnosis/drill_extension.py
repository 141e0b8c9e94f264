"""A recording's log-likelihood under structures that have more terms than it was linearised with.

Score tests ask for many such, about one point: what there is already is differentiated once, and each structure adds
the columns of its own terms alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_solve

from drillenv.diagnosis.drill_jacobian import (
    Linearised,
    columns_by_parameters,
    columns_read,
    elementary,
    indices_of_states,
    linearised,
    products_with_windows,
    variations,
)
from drillenv.diagnosis.drill_unknowns import STATE_WIDTHS, absent
from drillenv.diagnosis.engine import Column
from drillenv.diagnosis.solver import Floats, eliminated, factor
from drillenv.diagnosis.terms import ModelStructure
from drillenv.dynamics.hybrid.sensitivity import STATE
from drillenv.dynamics.hybrid.vector_field import OWN, Q

if TYPE_CHECKING:
    from drillenv.diagnosis.drill import ShootingProblem


class Extension(NamedTuple):
    """Derivatives of a recording's negative log-likelihood by n more unknowns, in the solver's units."""

    gradient: Floats
    """(n,)"""
    hessian: Floats
    """(n, n)"""
    by_own: Floats
    """(own unknowns, n) of the Hessian."""
    by_shared: Floats
    """(parameters, n) of the Hessian."""


def reduced_under(
    block: ShootingProblem, shared: Floats, own: Floats, structures: Iterable[ModelStructure]
) -> list[tuple[Floats, Floats]]:
    """Gradient and Hessian by the parameters under each of some structures, own unknowns at their best.

    The structures have more terms behind the recording's own, at their start.
    """
    at = linearised(block, shared, own)
    by_shared, within, constant, slope = eliminated(at.part, 0.0)
    solver, k, found = factor(at.part, 0.0), shared.size, []
    for structure in structures:
        more, states = extension(block, at, shared, own, structure)
        gradient = np.append(by_shared, more.gradient - more.by_own.T @ constant)
        hessian = np.zeros((gradient.size, gradient.size))
        hessian[:k, :k], hessian[:k, k:] = within, more.by_shared - slope.T @ more.by_own
        hessian[k:, :k] = hessian[:k, k:].T
        hessian[k:, k:] = more.hessian - more.by_own.T @ cho_solve(solver, more.by_own, check_finite=False)
        found.append(at_best(gradient, hessian, np.arange(k, k + states)))
    return found


def at_best(gradient: Floats, hessian: Floats, inner: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """A gradient (n,) and a Hessian (n, n) less some unknowns, which are at their best."""
    outer = np.setdiff1d(np.arange(gradient.size), inner)
    own, beside = hessian[inner[:, None], inner], hessian[inner[:, None], outer]
    solved = np.linalg.solve(own + np.diag(1e-12 * np.diag(own) + 1e-300), beside).T
    return gradient[outer] - solved @ gradient[inner], hessian[outer[:, None], outer] - solved @ beside


def extension(
    block: ShootingProblem, at: Linearised, shared: Floats, own: Floats, structure: ModelStructure
) -> tuple[Extension, int]:
    """Derivatives by the states that come with a structure's last terms, and behind them by these terms' parameters.

    The states go on from window to window from what they are where the recording begins. Also how many they are.
    """
    widened, begun = block.under(structure, own)
    old, kept, first = block.state_count(own), widened.state_count(begun), len(block.structure.terms)
    values = np.append(shared, structure.start[shared.size :]) * structure.scales
    model = structure.model(values, block.point)
    columns, mixing = elementary(widened, values, model, first)
    states = np.setdiff1d(np.arange(kept), [*absent(model), *at.present])
    gaps = np.zeros((at.defects.size, states.size + mixing.shape[1]))
    if not columns and not states.size:
        changing, rows = columns_by_parameters(widened, values, at.signals, at.wide[:0], mixing, first)
        return products_with(block, at, rows, changing, gaps), 0
    columns = [Column(int(STATE))] * states.size + columns
    varied = variations(widened, begun, model, columns)._replace(present=states[:0])
    varied.by_column[0, np.arange(states.size), states] = STATE_WIDTHS[states]
    raw = widened.integrate(model, begun, varied, chained=np.isin(np.arange(OWN), states))
    seen = columns_read(widened, values, raw)
    changing, rows = columns_by_parameters(widened, values, at.signals, seen[states.size :], mixing, first)
    rows, there = np.concatenate([seen[: states.size], rows]), np.append(np.arange(states.size), states.size + changing)
    whole = np.asarray(block_diag(np.eye(states.size), mixing))
    by_begin = np.concatenate([varied.by_column[:1], raw.ends_by_column[:-1, :, :kept]])
    change = varied.by_column[1:, :, :old] - by_begin[1:, :, :old]
    change[:, :, states[states < old]] = 0.0
    gaps += (change.transpose(0, 2, 1) @ whole / block.continuity(old)[:, None]).reshape(gaps.shape)
    found = products_with(block, at, rows, there, gaps)
    found.hessian[: states.size, : states.size] += np.diag(widened.beliefs(begun)[1][states])
    if Q in states:
        row = widened.air_prior(begun)[indices_of_states(widened, np.array([Q]), kept)] / STATE_WIDTHS[Q]
        air = row @ by_begin[:, :, Q] @ whole
        found.hessian[:] += np.outer(air, air)
        found.gradient[:] += air * float(row @ raw.begin[:, Q])
    return found, states.size


def products_with(
    block: ShootingProblem, at: Linearised, rows: Floats, there: NDArray[np.int64], gaps: Floats
) -> Extension:
    """Derivatives by n more unknowns, from what the weighed reading and the continuity constraints change with them.

    Args:
        block: The recording.
        at: The same about a point.
        rows: (m, 2, judged) of the reading, of those unknowns that it does change with.
        there: (m,) which those are.
        gaps: (gaps, n) of the constraints.
    """
    count, m = block.locals, at.part.by_own.size - block.locals
    flat = at.wide.reshape(len(at.wide), -1)
    more = rows.reshape(len(rows), flat.shape[1])
    products = flat @ more.T
    gradient, hessian = gaps.T @ at.defects, gaps.T @ gaps
    by_own, by_shared = at.defects_by_own.T @ gaps, at.defects_by_shared.T @ gaps
    gradient[there] -= products[-1]
    hessian[there[:, None], there] += more @ more.T
    present = indices_of_states(block, at.present, m // block.windows)
    by_own[present[:, None], there] += products_with_windows(block, at.by_windows, rows)
    by_own[m + at.there[:count, None], there] += products[:count]
    by_shared[at.there[count:-1, None] - count, there] += products[count:-1]
    return Extension(gradient, hessian, by_own, by_shared)
