"""The power law of one branch, F = k (d - d_0)^n, fitted with errors in both channels, and the line nearest to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import least_squares

from drillenv.checks import InputError
from drillenv.indentation.noise import Noise, Residual, covariance

Floats = NDArray[np.float64]

MOST_BLOCKS = 100
"""Means of neighbouring samples in which a branch is fitted; more say no more of a curve this smooth."""
MAIN_PART = 0.2
"""Share of the peak force above which the line lies that stands for a branch."""
EXPONENTS = (0.3, 4.0)
"""Between which a branch is believed to follow a power law."""
INTERVAL = 1.959964
"""Standard deviations on either side of a 95 % interval."""


class Estimate(NamedTuple):
    """A value with its standard deviation and its 95 % interval."""

    value: float
    std: float
    low: float
    high: float


def positive(value: float, relative: float) -> Estimate:
    """An estimate whose logarithm is normal, with a relative standard deviation."""
    reach = np.exp(INTERVAL * relative)
    return Estimate(value, value * relative, float(value / reach), float(value * reach))


def symmetric(value: float, std: float) -> Estimate:
    """An estimate that is normal."""
    return Estimate(value, std, value - INTERVAL * std, value + INTERVAL * std)


class Samples(NamedTuple):
    """A stretch of a curve in means of neighbouring samples, with what is known of its drifts."""

    samples: int
    """In each mean."""
    force: Floats
    """(blocks,) N, free of its zero."""
    displacement: Floats
    """(blocks,) m, free of its drift."""
    zero_error: Floats
    """(blocks, k) N: the covariance of what is left of the zero is this times its transpose."""
    drift_error: Floats
    """(blocks,) m, standard deviation of what is left of the drift."""


def block_means(values: Floats, part: slice, most: int = MOST_BLOCKS) -> tuple[Floats, int]:
    """(blocks,) means of neighbouring samples of a stretch, and how many are in each."""
    stretch = values[part]
    samples = -(-stretch.size // most)
    blocks = stretch.size // samples
    return stretch[: blocks * samples].reshape(blocks, samples).mean(axis=1), samples


@dataclass(frozen=True, slots=True)
class Law:
    """F = k (d - d_0)^n, held by what it is near the peak: far less correlated than k, d_0 and n."""

    force: float
    """At ``reference``, N."""
    origin: float
    """d_0 in m: the first contact of a loading, the residual depth of an unloading."""
    exponent: float
    reference: float
    """A depth near the peak in m."""

    @property
    def coefficient(self) -> float:
        """k in N/m^n."""
        return self.force / (self.reference - self.origin) ** self.exponent

    def at(self, depth: Floats) -> Floats:
        """Force in N at depths in m."""
        share = np.maximum(depth - self.origin, 0.0) / (self.reference - self.origin)
        return self.force * share**self.exponent

    def slope(self, depth: Floats) -> Floats:
        """Stiffness in N/m at depths in m, 0 out of contact."""
        way = self.reference - self.origin
        share = np.maximum(depth - self.origin, 0.0) / way
        inside = share > 0
        power = np.where(inside, share, 1.0) ** (self.exponent - 1.0)
        return np.where(inside, self.force * self.exponent / way * power, 0.0)

    def depth(self, force: float) -> float:
        """Depth in m at a force in N."""
        return self.origin + (self.reference - self.origin) * (force / self.force) ** (1.0 / self.exponent)

    def stiffness(self, peak: float) -> float:
        """Slope in N/m of the line nearest to the law between 20 and 100 % of a peak force in N.

        The line of least squares over depth, every depth weighing the same. It is k where the exponent is 1.
        """
        n = self.exponent
        low = MAIN_PART ** (1.0 / n)
        width = 1.0 - low
        mean, spread = (1.0 + low) / 2.0, width**2 / 12.0
        mean_force = (1.0 - low ** (n + 1.0)) / ((n + 1.0) * width)
        product = (1.0 - low ** (n + 2.0)) / ((n + 2.0) * width)
        return (product - mean * mean_force) / spread * peak / (self.depth(peak) - self.origin)

    def moved(self, steps: Floats) -> Law:
        """The law with log force, origin (in ways from origin to reference) and log exponent moved."""
        way = self.reference - self.origin
        return Law(
            self.force * float(np.exp(steps[0])),
            self.origin + way * float(steps[1]),
            self.exponent * float(np.exp(steps[2])),
            self.reference,
        )

    def derivatives(self, depth: Floats) -> Floats:
        """(depths, 3) by the steps of :meth:`moved`."""
        way = self.reference - self.origin
        share = np.maximum(depth - self.origin, 0.0) / way
        inside = share > 0
        logs = np.log(np.where(inside, share, 1.0))
        force, n = self.at(depth), self.exponent
        by_origin = np.where(inside, n * force * (1.0 - 1.0 / np.where(inside, share, 1.0)), 0.0)
        return np.column_stack([force, by_origin, n * force * logs])


@dataclass(frozen=True, slots=True)
class Fit:
    """A law with the covariance of the steps of :meth:`Law.moved`."""

    law: Law
    covariance: Floats
    """(3, 3)"""
    shared: Floats
    """(3, errors) by how much an error of zero or, last, drift of one standard deviation moves them: the same error for
    each indentation of a curve. The covariance holds them too."""

    def std(self, quantity: Callable[[Law], float]) -> float:
        """Standard deviation of a quantity of the law, a function of it."""
        gradient = self.gradient(quantity)
        return float(np.sqrt(gradient @ self.covariance @ gradient))

    def std_without_drift(self, quantity: Callable[[Law], float]) -> float:
        """The same with what the drift may have done left out."""
        gradient = self.gradient(quantity)
        by_drift = float(gradient @ self.shared[:, -1])
        return float(np.sqrt(max(gradient @ self.covariance @ gradient - by_drift**2, 0.0)))

    def gradient(self, quantity: Callable[[Law], float]) -> Floats:
        """(3,) of a function of the law by the steps."""
        size = 1e-5
        steps = size * np.eye(3)
        return np.array([(quantity(self.law.moved(s)) - quantity(self.law.moved(-s))) / (2 * size) for s in steps])


def first_law(samples: Samples, compliance: float) -> Law:
    """The straight line through a branch, as a law to begin with."""
    depth = samples.displacement - compliance * samples.force
    reference = float(depth[np.argmax(samples.force)])
    # displacement over force: noise of the displacement, the larger part as a rule, then bends nothing
    by_force, origin = np.polyfit(samples.force, depth, 1)
    if by_force <= 0.0:
        raise InputError("no stiffness is left: the force does not grow with the depth")
    origin = min(float(origin), float(depth.min()))
    return Law(float((reference - origin) / by_force), origin, 1.0, reference)


def fit_law(samples: Samples, compliance: float, noise: Noise, start: Law) -> Fit:
    """The law with the smallest distance from a branch, by the covariance of its noise.

    Raises:
        InputError: no power law comes out.
    """

    def moved(places: Floats) -> Law:
        return start.moved(np.clip(places - 1.0, -1.5, 1.5))

    def whitened(places: Floats) -> Floats:
        law = moved(places)
        residual = residual_of(law, samples, compliance)
        try:
            residual = without_noise(law, residual, samples, compliance, noise)
            root = cholesky(full_covariance(residual, samples, noise), lower=True, check_finite=False)
        except (LinAlgError, ValueError):
            return np.full(residual.values.size, 1e6)
        return solve_triangular(root, residual.values, lower=True, check_finite=False)

    with np.errstate(all="ignore"):
        # about 1, since differences are taken relative to where it is
        found = least_squares(whitened, np.ones(3), method="lm", diff_step=1e-6, max_nfev=200)
    law = moved(found.x)
    if not EXPONENTS[0] < law.exponent < EXPONENTS[1]:
        raise InputError(
            f"no power law fits it (its exponent would be {law.exponent:.2g}, "
            f"outside {EXPONENTS[0]:g} to {EXPONENTS[1]:g})"
        )
    residual = without_noise(law, residual_of(law, samples, compliance), samples, compliance, noise)
    factor = cho_factor(full_covariance(residual, samples, noise), lower=True, check_finite=False)
    solved = cho_solve(factor, residual.by_parameters, check_finite=False)
    errors = np.linalg.inv(residual.by_parameters.T @ solved)
    return Fit(law, errors, errors @ solved.T @ _shared_errors(residual, samples))


def residual_of(law: Law, samples: Samples, compliance: float, depth: Floats | None = None) -> Residual:
    """What a law leaves of a branch, with the slope at these depths in m, by default those that were measured."""
    measured = samples.displacement - compliance * samples.force
    depth = measured if depth is None else depth
    slope = law.slope(depth)
    return Residual(
        samples.samples,
        samples.force - law.at(depth) - slope * (measured - depth),
        1.0 + compliance * slope,
        -slope,
        law.derivatives(depth),
    )


def without_noise(law: Law, residual: Residual, samples: Samples, compliance: float, noise: Noise) -> Residual:
    """The residual of a law about the most likely depths, free of noise.

    Its slope at measured depths would share their noise, which bends the law where the noise has a memory.
    """
    factor = cho_factor(full_covariance(residual, samples, noise), lower=True, check_finite=False)
    weighed = cho_solve(factor, residual.values, check_finite=False)
    n = weighed.size
    of_displacement = noise.displacement.covariance(samples.samples, n) @ (residual.by_displacement * weighed)
    of_force = noise.force.covariance(samples.samples, n) @ (residual.by_force * weighed)
    depth = samples.displacement - of_displacement - compliance * (samples.force - of_force)
    return residual_of(law, samples, compliance, depth)


def full_covariance(residual: Residual, samples: Samples, noise: Noise) -> Floats:
    """(blocks, blocks) N^2 of the noise and of what is left of zero and drift."""
    v = covariance(residual.samples, residual.by_force, residual.by_displacement, noise)
    shared = _shared_errors(residual, samples)
    v += shared @ shared.T
    v[np.diag_indices_from(v)] *= 1.0 + 1e-9
    return v


def _shared_errors(residual: Residual, samples: Samples) -> Floats:
    """(blocks, errors) N: what zero and drift may be off, each by one standard deviation."""
    zero = residual.by_force[:, None] * samples.zero_error
    return np.column_stack([zero, residual.by_displacement * samples.drift_error])
