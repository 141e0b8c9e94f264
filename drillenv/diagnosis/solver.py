"""Bounded Levenberg-Marquardt for problems in blocks: parameters that all share, and unknowns of each block.

The negative log-likelihood is a sum over blocks (recordings) of functions of the shared parameters p and of the block's
own unknowns x (the states at the beginning of its windows, what is doubtful about its labels). In each step the own
unknowns are eliminated by the Schur complement, as in H. G. Bock, Numerical treatment of inverse problems in chemical
reaction kinetics, Springer Series in Chemical Physics 18 (1981) 102-125. Damping is that of H. B. Nielsen, Damping
parameter in Marquardt's method, IMM-REP-1999-05, DTU (1999).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import lsq_linear

if TYPE_CHECKING:
    from drillenv.diagnosis.adapter import RecordingProblem

Floats = NDArray[np.float64]
GAIN_RATIO = 0.25
"""Gain of a step over what the quadratic promised, from which it was not too long for the derivatives. With less, its
gain says nothing of how much is left."""
UNDAMPED = 0.1
"""Damping below which a step is next to that of Gauss and Newton: that a shorter one gains little says nothing."""
DAMPED = 1e-3
"""Least damping after a step that was too long: from less it would take several such steps, all alike, to rise."""


class Quadratic(NamedTuple):
    """A block's negative log-likelihood near a point, by own unknowns x (m,) and shared parameters p (k,)."""

    cost: float
    by_own: Floats
    """(m,) gradient."""
    by_shared: Floats
    """(k,)"""
    own: Floats
    """(m, m) Gauss-Newton Hessian."""
    cross: Floats
    """(m, k)"""
    shared: Floats
    """(k, k)"""
    damping_scale: Floats
    """(m,) curvature by which the own unknowns are damped: that of the data alone. Damping by the continuity
    constraints, which are stiff, would hold back all windows where they have to move together."""


@dataclass(frozen=True)
class Priors:
    """Normal priors of the shared parameters, and the box that they are in. Arrays have shape (k,)."""

    centre: Floats
    precision: Floats
    """1 / standard deviation; 0 where nothing is believed."""
    low: Floats
    high: Floats
    dispersion: float = 1.0
    """By which the prior is made as much weightier as the data are over-dispersed: a model that leaves so many times
    the noise must not bend what is known in the place of what is missing."""

    def cost(self, shared: Floats) -> float:
        """Negative logarithm of the density, 0 at the centre."""
        off = (shared - self.centre) * self.precision
        return 0.5 * self.dispersion * float(off @ off)

    @property
    def weights(self) -> Floats:
        """(k,) of the squared distances from the centre."""
        return self.dispersion * self.precision**2

    def weighed(self, cost: float, samples: int) -> Priors:
        """The same as a model with this cost, of so many residuals, leaves the data over-dispersed; as is where 0."""
        return replace(self, dispersion=max(1.0, 2.0 * cost / samples)) if samples else self


@dataclass
class Fit:
    """Where a fit came to."""

    shared: Floats
    own: list[Floats]
    cost: float
    """Negative log-likelihood with the priors."""
    begun: float
    """The same where the fit began."""
    costs: list[float]
    """Of each block, without."""
    parts: list[Quadratic]
    """Of each block, at the end or at most a step before it that gained next to nothing."""
    hessian: Floats
    """(k, k) of the shared parameters, own unknowns eliminated, priors included."""
    converged: bool
    priors: Priors
    """As they were weighed at the end."""

    @property
    def covariance(self) -> Floats:
        """(k, k) of the shared parameters.

        Of one that the data say nothing of, what its bounds say: the variance of a uniform distribution.
        """
        width = self.priors.high - self.priors.low
        bounded = np.isfinite(width) & (width > 0.0)
        within = np.divide(12.0, width**2, out=np.zeros_like(width), where=bounded)
        return np.asarray(np.linalg.pinv(self.hessian + np.diag(within), hermitian=True), dtype=float)


class Limits(NamedTuple):
    """When a fit ends."""

    steps: int = 30
    tolerance: float = 0.05
    """Gain of a step, in log-likelihood, below which it has converged."""
    relative: float = 0.0
    """The same, as a share of what is left beyond the noise."""

    def gain(self, cost: float, samples: int) -> float:
        """Gain below which a step from this cost, of so many residuals, is none."""
        return max(self.tolerance, self.relative * (cost - 0.5 * samples))


def factor(part: Quadratic, damping: float) -> tuple[Floats, bool]:
    """Cholesky factor of a block's Hessian with damping on its diagonal."""
    # each by its own size: one that is steep, as where a contact is grazed, must not hold back the others
    floor = 1e-12 * np.diag(part.own) + 1e-300
    return cho_factor(part.own + np.diag(damping * part.damping_scale + floor), lower=True, check_finite=False)


def eliminated(part: Quadratic, damping: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Gradient (k,) and Hessian (k, k) by the shared parameters with the own ones at their best, and what gives those.

    The own unknowns move by ``-constant - slope @ step`` for a step of the shared ones.
    """
    if part.by_own.size == 0:
        return part.by_shared, part.shared, np.zeros(0), np.zeros((0, part.by_shared.size))
    # most parameters of recordings are of others
    there = np.flatnonzero(part.cross.any(axis=0))
    solved = cho_solve(factor(part, damping), np.column_stack([part.by_own, part.cross[:, there]]), check_finite=False)
    constant, slope = solved[:, 0], np.zeros_like(part.cross)
    slope[:, there] = solved[:, 1:]
    return part.by_shared - part.cross.T @ constant, part.shared - part.cross.T @ slope, constant, slope


def side_by_side(pool: Executor | None) -> Callable:
    """The ``map`` by which blocks are evaluated: of the pool, or one after the other where there is none."""
    return map if pool is None else pool.map


def minimise(
    blocks: Sequence[RecordingProblem],
    shared: Floats,
    own: Sequence[Floats],
    priors: Priors,
    limits: Limits | None = None,
    pool: Executor | None = None,
    samples: int = 0,
) -> Fit:
    """Minimise the sum of the blocks' costs and the prior's.

    Args:
        blocks: At least one.
        shared: (k,) where to begin.
        own: For each block where its own unknowns begin.
        priors: Of the shared parameters.
        limits: When to end.
        pool: Where blocks are evaluated side by side.
        samples: Residuals in all blocks, by which over-dispersion is told and the priors are weighed; 0 for not at all.
    """
    limits = limits or Limits()
    each = side_by_side(pool)
    shared, own = np.clip(shared, priors.low, priors.high), list(own)
    costs = list(each(lambda block, x: block.cost(shared, x), blocks, own))
    if not math.isfinite(sum(costs)):  # there is no motion to begin with
        return Fit(shared, own, math.inf, math.inf, costs, [], np.zeros((shared.size, shared.size)), False, priors)
    start, begun = shared, sum(costs)
    damping, converged, steps = _Damping(), False, 0
    parts: list[Quadratic] = []
    while steps < limits.steps:
        if not parts:
            parts = _quadratics(blocks, shared, own, each)
            priors = priors.weighed(sum(costs), samples)
        try:
            step, moves, promised = _step(parts, shared, priors, damping.size)
        except LinAlgError:
            damping.size *= 10.0
            steps += 1
            continue
        little = limits.gain(sum(costs), samples)
        if converged := promised < little and damping.size < UNDAMPED:
            break
        point = np.clip(shared + step, priors.low, priors.high)
        prior_increase = priors.cost(point) - priors.cost(shared)
        tried = _advanced(blocks, point, own, moves, costs, GAIN_RATIO * promised + prior_increase, each)
        gain = sum(costs) - sum(cost for cost, _ in tried) - prior_increase
        steps += 1
        held = damping.adapt(gain / max(promised, 1e-12))
        if gain > 0.0:
            shared, own, costs = point, [x for _, x in tried], [cost for cost, _ in tried]
            if converged := held and gain < little and damping.size < UNDAMPED:
                # so near to where the derivatives were taken that those say how sure the parameters are
                break
            parts = []
        elif damping.size > 1e8:
            break
    parts = parts or _quadratics(blocks, shared, own, each)
    hessian = sum((eliminated(part, 0.0)[1] for part in parts), np.diag(priors.weights))
    cost, begun = sum(costs) + priors.cost(shared), begun + priors.cost(start)
    return Fit(shared, own, cost, begun, costs, parts, hessian, converged, priors)


@dataclass
class _Damping:
    """Of a step, by Nielsen's rule."""

    size: float = 1e-3
    growth: float = 2.0

    def adapt(self, gain_ratio: float) -> bool:
        """After a step with this gain ratio; whether the derivatives held for it."""
        if gain_ratio > 0.0:
            self.size, self.growth = max(self.size * max(0.1, 1.0 - (2.0 * gain_ratio - 1.0) ** 3), 1e-9), 2.0
        else:
            self.size, self.growth = self.size * self.growth, 2.0 * self.growth
        if gain_ratio > GAIN_RATIO:
            return True
        self.size = max(self.size, DAMPED)
        return False


def _quadratics(blocks: Sequence[RecordingProblem], shared: Floats, own, each: Callable) -> list[Quadratic]:
    return list(each(lambda block, x: block.quadratic(shared, x), blocks, own))


def _advanced(
    blocks, point: Floats, own, moves, costs: Sequence[float], least: float, each: Callable
) -> list[tuple[float, Floats]]:
    """Cost and own unknowns of each block after a step.

    Where all together gain less than ``least``, own unknowns have not followed the shared ones, and are corrected; else
    the next step sees to those that have not.
    """
    tried = list(each(lambda block, *given: block.try_step(point, *given), blocks, own, moves, costs))
    if sum(costs) - sum(cost for cost, _ in tried) < least:
        tried = list(each(lambda block, *given: block.inner_steps(point, *given), blocks, tried, costs))
    return tried


def _step(parts: Sequence[Quadratic], shared: Floats, priors: Priors, damping: float):
    """Damped Gauss-Newton step of the shared parameters, those of each block, and the gain that they promise."""
    reduced = [eliminated(part, damping) for part in parts]
    weights = priors.weights
    gradient = sum((each[0] for each in reduced), weights * (shared - priors.centre))
    hessian = sum((each[1] for each in reduced), np.diag(weights))
    step = within_box(gradient, hessian + np.diag((damping + 1e-10) * np.diag(hessian)), priors, shared)
    moves = [-(constant + slope @ step) for _, _, constant, slope in reduced]
    promised = -float(gradient @ step + 0.5 * step @ hessian @ step)
    promised += sum(0.5 * float(each[2] @ part.by_own) for each, part in zip(reduced, parts, strict=True))
    return step, moves, promised


def within_box(gradient: Floats, hessian: Floats, priors: Priors, shared: Floats) -> Floats:
    """The step (k,) that minimises ``gradient @ step + step @ hessian @ step / 2`` within the box of the priors.

    Newton's where that stays inside. A step that is cut off where it leaves the box may lead uphill: what one parameter
    cannot take, those that are correlated with it have to.

    Args:
        gradient: (k,)
        hessian: (k, k), positive semidefinite; of a parameter whose diagonal is 0 nothing is known, and it stays.
        priors: Low and high ends, (k,) each.
        shared: (k,) where the step begins, within the box.
    """
    step = np.zeros_like(shared)
    known = np.flatnonzero((np.diag(hessian) > 0.0) & (priors.low < priors.high))
    low, high, gradient = (priors.low - shared)[known], (priors.high - shared)[known], gradient[known]
    inside = hessian[np.ix_(known, known)]
    newton = -np.linalg.solve(inside, gradient)
    if not np.all((low <= newton) & (newton <= high)):
        # each by its own size, or the smallest would be lost in the rounding of the largest
        size = np.sqrt(np.diag(inside))
        upper = cholesky(inside / size / size[:, None])
        target = solve_triangular(upper, -gradient / size, trans=1)
        newton = lsq_linear(upper, target, (low * size, high * size), method="bvls").x / size
    step[known] = newton
    return step
