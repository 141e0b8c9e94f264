"""Which mechanism would explain most: every candidate's mark on the data, with all constants and states refitted.

Around a fit everything is linear: a candidate adds columns to the quadratics, and what it gains is what is left of its
columns after constants and window states have done what they can. The gain is counted in half sums of squares; for a
mechanism that is not there it is half a chi-square number with as many degrees of freedom as columns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drillenv.checks import InputError
from drillenv.diagnosis.candidates import Variant, variants
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import Fit, Workers, scaled_change, sum_quadratics
from drillenv.diagnosis.shooting import JOIN, Quadratic, predict, quadratic, residual, split_effects
from drillenv.dynamics.effects import make

HUMS = (50.0, 60.0)
"""Hz of the mains."""


class Score(NamedTuple):
    """What one variant of a mechanism would gain."""

    gain: float
    variant: Variant
    strengths: np.ndarray
    """One for each probe, in probes."""
    constants: np.ndarray
    """(p,) step of the fit's parameters that goes with it, in widths."""


def screen(recordings: Sequence[Conditioned], fitted: Fit, workers: Workers, loose: float) -> list[Score]:
    """Every variant that is not part of the fit already, the largest gain first.

    ``loose`` widens the joints between windows: a fit that is far off has none to speak of.
    """
    taken = {name for name, _held, _free in fitted.hypothesis.effects}
    tried = [each for each in variants() if each.mechanism not in taken]
    physics = fitted.hypothesis.physics(fitted.values)

    def marks(data: Conditioned, states: np.ndarray, base) -> dict[Variant, tuple[np.ndarray, np.ndarray]]:
        found = {}
        for variant in tried:
            channels, ends = [], []
            try:
                for probe in variant.probes:
                    motion, sensors = split_effects((make(variant.mechanism, **dict(variant.held), **dict(probe)),))
                    with_it = physics._replace(motion=(*physics.motion, *motion), sensors=(*physics.sensors, *sensors))
                    change = scaled_change(data, predict(data, states, with_it), base, 1.0)
                    channels.append(change[0])
                    ends.append(change[1])
            except InputError:
                continue
            found[variant] = np.array(channels), np.array(ends)
        return found

    all_marks = workers.each(marks, recordings, fitted.states, fitted.predictions)
    prior, away = _prior(fitted)
    scores = []
    for variant in tried:
        if not all(variant in each for each in all_marks):
            continue
        parts = [
            quadratic(
                data,
                states,
                data.states,
                base,
                slope,
                np.concatenate([column[0], mark[variant][0]]),
                np.concatenate([column[1], mark[variant][1]]),
                JOIN * loose,
            )
            for data, states, base, slope, column, mark in zip(
                recordings, fitted.states, fitted.predictions, fitted.slopes, fitted.columns, all_marks, strict=True
            )
        ]
        scores.append(_score(variant, parts, prior, away))
    return sorted(scores, key=lambda each: -each.gain)


def _prior(fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the priors, and how far the fit is from their centres, in widths."""
    parameters = fitted.hypothesis.parameters
    away = (fitted.values - np.array([each.value for each in parameters])) / np.array([e.width for e in parameters])
    return np.array([each.prior for each in parameters]), away


def _score(variant: Variant, parts: Sequence[Quadratic], prior: np.ndarray, away: np.ndarray) -> Score:
    """Gain of the last columns over the first ones alone."""
    gradient, curvature = sum_quadratics(parts)
    p, k = prior.size, len(variant.probes)
    gradient[:p] -= prior * away
    curvature[np.arange(p), np.arange(p)] += prior + 1e-9
    # probes that the data do not feel must not divide by nothing
    curvature[np.arange(p, p + k), np.arange(p, p + k)] *= 1 + 1e-9
    curvature[np.arange(p, p + k), np.arange(p, p + k)] += 1e-9
    step = np.linalg.solve(curvature, gradient)
    with_it = 0.5 * float(gradient @ step)
    without = 0.5 * float(gradient[:p] @ np.linalg.solve(curvature[:p, :p], gradient[:p])) if p else 0.0
    return Score(with_it - without, variant, step[p:], step[:p])


def hum(data: Conditioned, made, frequency: float) -> tuple[float, np.ndarray]:
    """What a sine of one frequency, of any phase, gains on each channel of a recording: sum, and (2, 2) amplitudes.

    A recording begins at any phase of the mains, so that every recording has amplitudes of its own.
    """
    left = residual(data, made)
    inside = slice(int(data.starts[0]), int(data.starts[-1]))
    turn = 2 * math.pi * frequency * np.arange(data.force.size)[inside] / data.rate
    basis = np.stack([np.sin(turn), np.cos(turn)])
    weights = np.linalg.solve(basis @ basis.T, basis @ left[:, inside].T).T
    gain = 0.5 * float(np.einsum("ci,ij,cj->", weights, basis @ basis.T, weights))
    return gain, weights * np.array([[data.noise_force], [data.noise_acceleration]])
