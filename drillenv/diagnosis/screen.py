"""Which mechanism would explain most: every candidate's mark on the data, with all constants and states refitted.

Around a fit everything is linear: a candidate adds columns to the quadratics, and what it gains is what is left of its
columns after constants and window states have done what they can. The gain is counted in half sums of squares; for a
mechanism that is not there it is half a chi-square number with as many degrees of freedom as columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drillenv.checks import InputError
from drillenv.diagnosis.candidates import Variant, variants
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import Fit, Workers, scaled_change, sum_quadratics
from drillenv.diagnosis.shooting import (
    JOIN,
    Motion,
    Quadratic,
    drive_phase,
    fineness,
    move,
    predict,
    quadratic,
    sensed,
    split_effects,
)
from drillenv.dynamics.effects import make


class Score(NamedTuple):
    """What one variant of a mechanism would gain."""

    gain: float
    variant: Variant
    strengths: np.ndarray
    """One for each probe, in probes; where each recording has its own, those of the first recording come first."""
    constants: np.ndarray
    """(p,) step of the fit's parameters that goes with it, in widths."""


def screen(recordings: Sequence[Conditioned], fitted: Fit, workers: Workers, loose: float) -> list[Score]:
    """Every variant that is not part of the fit already, the largest gain first.

    ``loose`` widens the joints between windows: a fit that is far off has none to speak of.
    """
    taken = {name for name, _held, _free in fitted.hypothesis.effects}
    tried = [each for each in variants() if each.mechanism not in taken]

    def marks(data: Conditioned, states: np.ndarray, base) -> dict[Variant, tuple[np.ndarray, np.ndarray]]:
        found = {}
        moved: dict[int, Motion] = {}  # sensors leave the motion as it is
        physics = fitted.hypothesis.physics(fitted.values, data.name)
        for variant in tried:
            channels, ends = [], []
            try:
                for probe in variant.probes:
                    motion, sensors = split_effects((make(variant.mechanism, **dict(variant.held), **dict(probe)),))
                    with_it = physics._replace(motion=(*physics.motion, *motion), sensors=(*physics.sensors, *sensors))
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
    prior, away = _prior(fitted)
    scores = []
    for variant in tried:
        if not all(variant in each for each in all_marks):
            continue
        parts, places, count = [], [], len(variant.probes)
        for i, data in enumerate(recordings):
            columns, mark = fitted.columns[i], all_marks[i][variant]
            parts.append(
                quadratic(
                    data,
                    fitted.states[i],
                    data.states,
                    fitted.predictions[i],
                    fitted.slopes[i],
                    np.concatenate([columns[0], mark[0]]),
                    np.concatenate([columns[1], mark[1]]),
                    JOIN * loose,
                )
            )
            # what each recording has a strength of its own for, stands behind that of the recordings before it
            first = prior.size + (count * i if variant.own else 0)
            places.append(np.concatenate([fitted.places[i], np.arange(first, first + count)]))
        strengths = count * (len(recordings) if variant.own else 1)
        scores.append(_score(variant, parts, places, strengths, prior, away))
    return sorted(scores, key=lambda each: -each.gain)


def _prior(fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the priors, and how far the fit is from their centres, in widths."""
    parameters = fitted.hypothesis.parameters
    away = (fitted.values - np.array([each.value for each in parameters])) / np.array([e.width for e in parameters])
    return np.array([each.prior for each in parameters]), away


def _score(
    variant: Variant,
    parts: Sequence[Quadratic],
    places: Sequence[np.ndarray],
    strengths: int,
    prior: np.ndarray,
    away: np.ndarray,
) -> Score:
    """Gain of the last ``strengths`` columns over the first ones alone."""
    p = prior.size
    gradient, curvature = sum_quadratics(parts, places, p + strengths)
    gradient[:p] -= prior * away
    known, tried = np.arange(p), np.arange(p, p + strengths)
    curvature[known, known] += prior + 1e-9
    # probes that the data do not feel must not divide by nothing
    curvature[tried, tried] *= 1 + 1e-9
    curvature[tried, tried] += 1e-9
    step = np.linalg.solve(curvature, gradient)
    with_it = 0.5 * float(gradient @ step)
    without = 0.5 * float(gradient[:p] @ np.linalg.solve(curvature[:p, :p], gradient[:p])) if p else 0.0
    return Score(with_it - without, variant, step[p:], step[:p])
