"""Sparse regression of the force balances by PySINDy: which candidate functions explain what the paper's model leaves.

What is left of force and acceleration, and the impulse that the shaker body lacks, are regressed together on the
candidate functions, each weighed by its noise. What constants of the paper's model are off stands in the regression
too, and is never thresholded. Rows are replaced by the triangular factor of their QR decomposition, recording by
recording, which leaves every sum of squares as it is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pysindy

from benchmarks.alternatives.candidates import Column
from benchmarks.alternatives.following import Followed
from drillenv.diagnosis.solver import Floats

PARTS = 4
"""Of a recording, that are drawn for a bootstrap."""


@dataclass(frozen=True)
class Settings:
    """How a regression is made; chosen on the campaigns of seed 4242, see docs/trial/README.md."""

    optimiser: str = "STLSQ"
    """Of :data:`OPTIMISERS`."""
    strengths: tuple[float, ...] = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3, 0.5)
    """Thresholds among which cross-validation chooses: norm of a term's contribution over that of what is explained."""
    one_shape: bool = True
    """Whether of each function only the shape that explains most alone is offered."""
    one_error: bool = True
    """Whether the sparsest within a standard error of the best cross-validation is taken, or the best."""
    draws: int = 20
    """Of a bootstrap over parts of recordings."""
    inclusion: float = 0.8
    """Share of the draws in which a mechanism has to be selected to be named."""


OPTIMISERS: dict[str, Callable[[float], Any]] = {
    "STLSQ": lambda strength: pysindy.STLSQ(threshold=strength, alpha=1e-6, max_iter=30),
    "SR3": lambda strength: pysindy.SR3(reg_weight_lam=strength**2 / 2.0, relax_coeff_nu=1.0, max_iter=1000),
}


class Part(NamedTuple):
    """Weighed rows of a part of a recording."""

    recording: int
    rows: Floats
    """(m, columns + 1), the target last."""


class Found(NamedTuple):
    """What a regression has come to."""

    coefficients: Floats
    """(columns,), in the columns' units."""
    named: list[str]
    inclusion: dict[str, float]
    """Share of the bootstrap's draws in which a mechanism was selected."""
    strength: float
    """That cross-validation chose."""


def compressed(rows: Floats) -> Floats:
    """The triangular factor of rows, with the same sums of squares."""
    return np.linalg.qr(rows, mode="r") if len(rows) > rows.shape[1] else rows


def parts_of(index: int, recording: Followed, columns: Sequence[Column]) -> list[Part]:
    """Rows of a recording, weighed by its noise: readings, and the shaker's impulse at the windows' beginnings."""
    over = recording.noise[:, None]
    readings = np.stack([each.readings / over for each in columns] + [recording.left / over])
    shaker = impulses(recording, columns)
    at = np.linspace(0, readings.shape[2], PARTS + 1).astype(int)
    among = np.linspace(0, len(shaker), PARTS + 1).astype(int)
    found = []
    for i in range(PARTS):
        samples = readings[:, :, at[i] : at[i + 1]].reshape(len(readings), -1).T
        found.append(Part(index, compressed(np.vstack([samples, shaker[among[i] : among[i + 1]]]))))
    return found


def impulses(recording: Followed, columns: Sequence[Column]) -> Floats:
    """(windows, columns + 1) impulses on the shaker body up to each window, over their standard deviation.

    That is read off their scatter from window to window.
    """
    at, lost = recording.lost_speed
    mass, rate = recording.motion.masses[0], recording.motion.rate
    rows = np.column_stack([np.cumsum(each.shaker)[at] / rate for each in columns] + [mass * lost])
    rows = rows - rows.mean(axis=0)
    scatter = 1.4826 * float(np.median(np.abs(np.diff(rows[:, -1])))) / np.sqrt(2.0)
    return rows / max(scatter, 1e-12)


def offered(parts: Sequence[Part], columns: Sequence[Column]) -> np.ndarray:
    """(columns,) which are offered: constants, and of each function the shape that explains most by itself."""
    rows = compressed(np.vstack([each.rows for each in parts]))
    fixed = [not each.mechanism for each in columns]
    candidates, target, _norms = without_constants(rows, int(np.sum(fixed)))
    gains = (candidates.T @ target) ** 2
    best: dict[str, int] = {}
    for j, column in enumerate(columns):
        if column.mechanism:
            at = j - int(np.sum(fixed))
            if column.function not in best or gains[at] > gains[best[column.function] - int(np.sum(fixed))]:
                best[column.function] = j
    return np.array([fixed[j] or j in best.values() for j in range(len(columns))])


def without_constants(rows: Floats, fixed: int) -> tuple[Floats, Floats, Floats]:
    """Candidates of unit norm and target with the constants' columns projected out, and (candidates,) norms."""
    basis = np.linalg.qr(rows[:, :fixed])[0]
    rest = rows[:, fixed:] - basis @ (basis.T @ rows[:, fixed:])
    candidates, target = rest[:, :-1], rest[:, -1]
    norms = np.linalg.norm(candidates, axis=0)
    # what constants can say as well is no candidate
    seen = norms > 1e-6 * np.maximum(np.linalg.norm(rows[:, fixed:-1], axis=0), 1e-300)
    norms = np.where(seen, norms, np.inf)
    return candidates / norms, target, norms


def regressed(rows: Floats, fixed: int, settings: Settings, strength: float) -> Floats:
    """(columns,) coefficients."""
    candidates, target, norms = without_constants(rows, fixed)
    size = float(np.linalg.norm(target))
    with warnings.catch_warnings():
        # that nothing is left, or that it has not quite converged, is an answer
        warnings.simplefilter("ignore")
        fitted = OPTIMISERS[settings.optimiser](strength).fit(candidates, target / size)
    found = np.asarray(fitted.coef_).ravel() * size / norms
    constants = np.linalg.lstsq(rows[:, :fixed], rows[:, -1] - rows[:, fixed:-1] @ found, rcond=None)[0]
    return np.concatenate([constants, found])


def cross_validated(parts: Sequence[Part], fixed: int, settings: Settings) -> float:
    """The threshold, by what is left of recordings that are left out one after the other."""
    recordings = sorted({each.recording for each in parts})
    left = np.zeros((len(settings.strengths), len(recordings)))
    for j, out in enumerate(recordings):
        train = compressed(np.vstack([each.rows for each in parts if each.recording != out]))
        test = np.vstack([each.rows for each in parts if each.recording == out])
        for i, strength in enumerate(settings.strengths):
            coefficients = regressed(train, fixed, settings, strength)
            left[i, j] = np.mean((test[:, -1] - test[:, :-1] @ coefficients) ** 2)
    mean = left.mean(axis=1)
    best = int(np.argmin(mean))
    if not settings.one_error:
        return settings.strengths[best]
    # of the difference, since recordings are hard or easy for all of them
    beyond = left - left[best]
    error = beyond.std(axis=1, ddof=1) / np.sqrt(len(recordings))
    within = np.flatnonzero(beyond.mean(axis=1) <= error)
    return settings.strengths[int(within.max())]


def sparse_regression(
    recordings: Sequence[Followed], columns: Sequence[Sequence[Column]], settings: Settings, rng: np.random.Generator
) -> Found:
    """Regress what is left of the fitted recordings on candidate functions, (recordings, columns)."""
    parts = [part for i, each in enumerate(recordings) for part in parts_of(i, each, columns[i])]
    return select(parts, columns[0], settings, rng)


def select(parts: Sequence[Part], columns: Sequence[Column], settings: Settings, rng: np.random.Generator) -> Found:
    """The threshold by cross-validation, the model at that, and the mechanisms by their inclusion in a bootstrap."""
    taken = offered(parts, columns) if settings.one_shape else np.ones(len(columns), dtype=bool)
    parts = [Part(each.recording, each.rows[:, np.append(taken, True)]) for each in parts]
    names = [column.mechanism for column, there in zip(columns, taken, strict=True) if there]
    fixed = names.count("")
    strength = cross_validated(parts, fixed, settings)
    rows = compressed(np.vstack([each.rows for each in parts]))
    coefficients = np.zeros(len(columns))
    coefficients[taken] = regressed(rows, fixed, settings, strength)
    counts = dict.fromkeys(dict.fromkeys(name for name in names if name), 0)
    for _ in range(settings.draws):
        drawn = rng.integers(len(parts), size=len(parts))
        again = regressed(compressed(np.vstack([parts[i].rows for i in drawn])), fixed, settings, strength)
        for name in {name for name, size in zip(names, again, strict=True) if name and size != 0.0}:
            counts[name] += 1
    inclusion = {name: count / settings.draws for name, count in counts.items() if count}
    selected = {column.mechanism for column, size in zip(columns, coefficients, strict=True) if size != 0.0} - {""}
    named = [name for name in inclusion if name in selected and inclusion[name] >= settings.inclusion]
    return Found(coefficients, named, inclusion, strength)


def correction(found: Found, columns: Sequence[Column]) -> Floats:
    """(2, n) what the regression adds to the readings of a recording."""
    return np.tensordot(found.coefficients, np.stack([each.readings for each in columns]), 1)
