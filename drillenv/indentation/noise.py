"""The noise of a curve: of the force and of the displacement, each white and autocorrelated, and how likely it is.

Each channel has white noise and beside it noise of the first order, e_i = rho e_(i-1) + innovation. A difference
r = F - f(x) between a measured force and a law of the measured displacement then has the covariance

    V = (1 + C f') S_F (1 + C f') + f' S_x f'

with the covariances S of both channels and the compliance C of the machine (errors in variables, to first order in the
noise). Out of contact it is S_F alone, which is what tells the two channels apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.optimize import minimize

Floats = NDArray[np.float64]

LONGEST_MEMORY = 0.995
"""Largest correlation from sample to sample."""


class Channel(NamedTuple):
    """The noise of one channel."""

    white: float
    """Standard deviation of the white part."""
    slow: float
    """Standard deviation of the autocorrelated part."""
    memory: float
    """Correlation of the autocorrelated part from sample to sample."""

    def covariance(self, samples: int, blocks: int) -> Floats:
        """(blocks, blocks) covariance of the means of so many samples each, which follow one another."""
        column = self.slow**2 * remembered(self.memory, samples, blocks)
        column[0] += self.white**2 / samples
        return toeplitz(column)

    def derivatives(self, samples: int, blocks: int) -> list[Floats]:
        """Three of (blocks, blocks): the covariance by the logarithms of white and slow and the logit of the memory."""
        rho, step = self.memory, 1e-5 * (1.0 - self.memory)
        by_memory = (remembered(rho + step, samples, blocks) - remembered(rho - step, samples, blocks)) / (2.0 * step)
        columns = (
            np.concatenate([[2.0 * self.white**2 / samples], np.zeros(blocks - 1)]),
            2.0 * self.slow**2 * remembered(rho, samples, blocks),
            self.slow**2 * by_memory * rho * (1.0 - rho),
        )
        return [toeplitz(column) for column in columns]


def remembered(memory: float, samples: int, blocks: int) -> Floats:
    """(blocks,) covariance over the lag of means of so many samples of a first-order process of variance 1."""
    m, rho = samples, memory
    lags = np.arange(1, m)
    beside = rho * ((1.0 - rho**m) / (m * (1.0 - rho))) ** 2
    column = beside * rho ** (m * np.maximum(np.arange(blocks) - 1.0, 0.0))
    column[0] = (1.0 + 2.0 * np.sum((1.0 - lags / m) * rho**lags)) / m
    return column


class Noise(NamedTuple):
    """The noise of both channels."""

    force: Channel
    """N."""
    displacement: Channel
    """m."""


class Residual(NamedTuple):
    """What a law leaves of one stretch, in means of neighbouring samples, and how the noise enters it."""

    samples: int
    """In each mean."""
    values: Floats
    """(blocks,) N."""
    by_force: Floats
    """(blocks,) by how much it changes with the measured force."""
    by_displacement: Floats
    """(blocks,) by how much with the measured displacement, N/m."""
    by_parameters: Floats
    """(blocks, parameters) by how much with what was fitted to this stretch."""


def covariance(samples: int, by_force: Floats, by_displacement: Floats, noise: Noise) -> Floats:
    """(blocks, blocks) covariance in N^2 of a difference of forces that depends on both channels."""
    n = by_force.size
    result = np.outer(by_force, by_force) * noise.force.covariance(samples, n)
    if by_displacement.any():
        result += np.outer(by_displacement, by_displacement) * noise.displacement.covariance(samples, n)
    return result


def estimate_noise(residuals: Sequence[Residual], start: Noise) -> Noise:
    """The noise that makes residuals most likely, beside what the fit takes up (restricted maximum likelihood)."""
    scales = np.array([np.hypot(channel.white, channel.slow) for channel in start])
    shapes: dict[tuple[int, int], list[Residual]] = {}
    for residual in residuals:
        shapes.setdefault((residual.samples, residual.values.size), []).append(residual)

    def cost(logs: Floats) -> tuple[float, Floats]:
        noise = _noise(logs, scales)
        total, gradient = 0.0, np.zeros(6)
        for (samples, blocks), alike in shapes.items():
            own = [channel.covariance(samples, blocks) for channel in noise]
            weights = np.zeros((2, blocks, blocks))
            for residual in alike:
                size, by_covariance = _restricted(residual, own)
                total += size
                for k, enters in enumerate((residual.by_force, residual.by_displacement)):
                    weights[k] += by_covariance * np.outer(enters, enters)
            changes = [change for channel in noise for change in channel.derivatives(samples, blocks)]
            gradient += [0.5 * float(np.vdot(weights[k // 3], change)) for k, change in enumerate(changes)]
        return total, gradient

    bounds = [(-9.0, 5.0), (-9.0, 5.0), (-3.0, _logit(LONGEST_MEMORY))] * 2
    found = minimize(cost, _logs(start, scales), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 80})
    return _noise(found.x, scales)


def _restricted(residual: Residual, channels: Sequence[Floats]) -> tuple[float, Floats]:
    """-log restricted likelihood, up to a constant, and twice its derivative by the covariance of the residual."""
    v = np.zeros_like(channels[0])
    for enters, own in zip((residual.by_force, residual.by_displacement), channels, strict=True):
        if enters.any():
            v += np.outer(enters, enters) * own
    v[np.diag_indices_from(v)] *= 1.0 + 1e-9
    root = np.linalg.cholesky(v)
    inverse = np.linalg.inv(v)
    x = residual.by_parameters
    solved = inverse @ x
    information = x.T @ solved
    projection = inverse - solved @ np.linalg.solve(information, solved.T)
    left = projection @ residual.values
    size = np.log(np.diag(root)).sum() + 0.5 * np.linalg.slogdet(information)[1] + 0.5 * float(residual.values @ left)
    return float(size), projection - np.outer(left, left)


def _logit(share: float) -> float:
    return float(np.log(share / (1.0 - share)))


def _logs(noise: Noise, scales: Floats) -> Floats:
    """Where to begin: away from the bounds, where the likelihood is flat."""
    parts = []
    for channel, scale in zip(noise, scales, strict=True):
        parts += [np.log(max(each, 0.1 * scale) / scale) for each in (channel.white, channel.slow)]
        parts.append(_logit(min(max(channel.memory, 0.2), 0.95)))
    return np.array(parts)


def _noise(logs: Floats, scales: Floats) -> Noise:
    channels = []
    for (white, slow, memory), scale in zip(logs.reshape(2, 3), scales, strict=True):
        rho = 1.0 / (1.0 + np.exp(-memory))
        channels.append(Channel(float(scale * np.exp(white)), float(scale * np.exp(slow)), float(rho)))
    return Noise(*channels)
