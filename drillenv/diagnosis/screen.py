"""Which mechanism would explain most: every candidate's mark on the data, with all constants and states refitted.

Around a fit everything is linear: a candidate adds columns to the quadratics, and what it gains is what is left of its
columns after constants and window states have done what they can. The gain is counted in half sums of squares; for a
mechanism that is not there it is half a chi-square number with as many degrees of freedom as columns. What the luckiest
of all candidates gains by chance is drawn by a parametric bootstrap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from drillenv.checks import InputError
from drillenv.diagnosis.candidates import Variant, variants
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import Fit, Workers, scaled_change, sum_quadratics
from drillenv.diagnosis.shooting import (
    AIR,
    JOIN,
    Motion,
    Physics,
    drive_phase,
    fineness,
    move,
    predict,
    quadratic,
    sensed,
    split_effects,
)
from drillenv.dynamics.effects import make

FALSE_ALARMS = 0.01
"""Share of campaigns where nothing is missing in which chance may give a candidate a gain that counts."""


class Score(NamedTuple):
    """What one variant of a mechanism would gain."""

    gain: float
    variant: Variant
    strengths: np.ndarray
    """One for each probe, in probes; where each recording has its own, those of the first recording come first."""
    constants: np.ndarray
    """(p,) step of the fit's parameters that goes with it, in widths."""


class Look(NamedTuple):
    """What a first look found."""

    scores: list[Score]
    """The largest gain first."""
    chance: float
    """Probability of a gain, under noise alone, that a candidate must stay below: see :func:`luck`."""


def screen(recordings: Sequence[Conditioned], fitted: Fit, workers: Workers, loose: float, seed: int = 0) -> Look:
    """Every variant that is not part of the fit already.

    ``loose`` widens the joints between windows: a fit that is far off has none to speak of. ``seed`` is for what chance
    gives.
    """
    tried = [each for each in variants() if each.mechanism not in fitted.hypothesis.mechanisms]

    def marks(data: Conditioned, states: np.ndarray, base) -> dict[Variant, tuple[np.ndarray, np.ndarray]]:
        found = {}
        moved: dict[int, Motion] = {}  # sensors leave the motion as it is
        physics = fitted.physics(data.name)
        for variant in tried:
            channels, ends = [], []
            try:
                for probe in variant.probes:
                    motion, sensors = split_effects((make(variant.mechanism, **dict(variant.held), **dict(probe)),))
                    with_it = physics._replace(motion=(*physics.motion, *motion), sensors=(*physics.sensors, *sensors))
                    if motion and variant.mechanism == AIR and not data.fresh:
                        lost = _long_lost(data, states, with_it)
                        with_it = with_it._replace(begun=(*with_it.begun, (variant.mechanism, lost)))
                    if motion or drive_phase(data, with_it) != drive_phase(data, physics):
                        said = predict(data, states, with_it)
                    else:
                        fine = fineness(data, with_it.sensors)
                        if fine not in moved:
                            moved[fine] = move(data, states, physics, fine)
                        said = sensed(data, moved[fine], with_it)
                    change = scaled_change(data, said, base, 1.0)
                    channels.append(change[0])
                    ends.append(change[1])
            except InputError:
                continue
            found[variant] = np.array(channels), np.array(ends)
        return found

    all_marks = workers.each(marks, recordings, fitted.states, fitted.predictions)
    tried = [each for each in tried if all(each in found for found in all_marks)]
    prior, away = _prior(fitted)
    slots, size = {}, prior.size
    for variant in tried:
        # what each recording has a strength of its own for, stands behind that of the recordings before it
        strengths = len(variant.probes) * (len(recordings) if variant.own else 1)
        slots[variant] = np.arange(size, size + strengths)
        size += strengths
    parts, places = [], []
    for i, data in enumerate(recordings):
        columns, found = fitted.columns[i], [all_marks[i][variant] for variant in tried]
        parts.append(
            quadratic(
                data,
                fitted.states[i],
                fitted.predictions[i],
                fitted.slopes[i],
                np.concatenate([columns[0], *(mark[0] for mark in found)]),
                np.concatenate([columns[1], *(mark[1] for mark in found)]),
                JOIN * loose,
            )
        )
        own = [slots[each][len(each.probes) * i :][: len(each.probes)] if each.own else slots[each] for each in tried]
        places.append(np.concatenate([fitted.places[i], *own]))
    gradient, curvature = sum_quadratics(parts, places, size)
    gradient[: prior.size] -= prior * away
    known, probes = np.arange(prior.size), np.arange(prior.size, size)
    curvature[known, known] += prior + 1e-9
    # probes that the data do not feel must not divide by nothing
    curvature[probes, probes] *= 1 + 1e-9
    curvature[probes, probes] += 1e-9
    scores = [_score(variant, gradient, curvature, prior.size, slots[variant]) for variant in tried]
    chance = luck(curvature, prior.size, list(slots.values()), np.random.default_rng(seed))
    return Look(sorted(scores, key=lambda each: -each.gain), chance)


def _long_lost(data: Conditioned, states: np.ndarray, physics: Physics) -> float:
    """Force in N that the cylinder of a rig that has long been running has lost, by the last of its effects.

    What it loses from nothing until the last window comes so near to it as the supply's time allows.
    """
    chosen = physics.motion[-1]
    others = sum(len(each.effect.extras) for each in physics.motion[:-1] if not each.effect.comes_last)
    reached = move(data, states, physics, 1).extras[-1, others]
    time = (data.starts[-2] - data.starts[0]) / data.rate
    return float(reached / -math.expm1(-time / chosen.values[1]))


def luck(
    curvature: np.ndarray, known: int, slots: Sequence[np.ndarray], rng: np.random.Generator, draws: int = 4000
) -> float:
    """The probability that a gain of one candidate must not exceed, for no candidate of so many to gain by chance.

    A parametric bootstrap of the fitted model. Data drawn from it, with its noise, change the gradient by a normal
    vector whose covariance is the curvature, so that it is drawn itself, and with it the gains of all candidates as
    they go together. The smallest of their probabilities is kept from each draw (P. H. Westfall and S. S. Young,
    Resampling-Based Multiple Testing, Wiley, 1993, Section 2.3); FALSE_ALARMS of the draws are below what is returned.

    Args:
        curvature: (p, p) of half the sum of squares over ``known`` parameters and then the probes of all candidates.
        known: Parameters that are refitted beside every candidate.
        slots: The places of each candidate's probes.
        rng: To draw from.
        draws: How many.
    """
    fixed, free = curvature[:known, :known], curvature[known:, known:]
    left = free - curvature[known:, :known] @ np.linalg.solve(fixed, curvature[:known, known:])
    scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
    power, modes = np.linalg.eigh(left / scale[:, None] / scale[None, :])
    drawn = (rng.standard_normal((draws, power.size)) * np.sqrt(np.maximum(power, 0.0))) @ modes.T
    smallest = np.ones(draws)
    for slot in slots:
        at = slot - known
        own = left[np.ix_(at, at)] / scale[at][:, None] / scale[at][None, :]
        squares = (drawn[:, at] @ np.linalg.pinv(own, 1e-9, hermitian=True) * drawn[:, at]).sum(axis=1)
        smallest = np.minimum(smallest, chi2.sf(squares, at.size))
    return float(np.quantile(smallest, FALSE_ALARMS))


def _prior(fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the priors, and how far the fit is from their centres, in widths."""
    parameters = fitted.hypothesis.parameters
    away = (fitted.values - np.array([each.value for each in parameters])) / np.array([e.width for e in parameters])
    return np.array([each.prior for each in parameters]), away


def _score(variant: Variant, gradient: np.ndarray, curvature: np.ndarray, p: int, slot: np.ndarray) -> Score:
    """Gain of the probes at ``slot`` over the first ``p`` parameters alone."""
    at = np.concatenate([np.arange(p), slot])
    step = np.linalg.solve(curvature[np.ix_(at, at)], gradient[at])
    with_it = 0.5 * float(gradient[at] @ step)
    without = 0.5 * float(gradient[:p] @ np.linalg.solve(curvature[:p, :p], gradient[:p])) if p else 0.0
    return Score(with_it - without, variant, step[p:], step[:p])
