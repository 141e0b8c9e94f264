"""Sparse regression of the force balances by PySINDy: which candidate functions explain what the paper's model leaves.

What is left of force and acceleration, and the impulse that the shaker body lacks, are regressed together on the
candidate functions, each weighed by its noise. What constants of the paper's model are off stands in the regression
too, and is never thresholded. Rows are replaced by the triangular factor of their QR decomposition, recording by
recording, which leaves every sum of squares as it is.
"""

from __future__ import annotations

import warnings
from collections import Counter
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

    optimiser: str = "FROLS"
    """Of :data:`PATHS`."""
    one_shape: bool = False
    """Whether of each function only the shape that explains most alone is offered."""
    errors: float = 1.0
    """Standard errors of the best cross-validation within which the sparsest model is taken."""
    share: float = 0.25
    """The same as a share of all that the best model explains there."""
    draws: int = 20
    """Of a bootstrap over parts of recordings."""
    inclusion: float = 0.8
    """Share of the draws in which a mechanism has to be selected to be named."""


THRESHOLDS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.035, 0.025, 0.018, 0.012)
"""Of the norm of a term's contribution over that of what is to be explained, the sparsest model first."""
MOST_TERMS = 8
"""Of a forward regression."""
Optimiser = Callable[[Floats, Floats], list[Floats]]
"""From candidates (m, k) of unit norm and a target (m,) of unit norm to coefficients (k,), the sparsest first."""


def stlsq(candidates: Floats, target: Floats, ridge: float = 0.3) -> list[Floats]:
    """Sequentially thresholded least squares at each threshold."""
    return [fitted(pysindy.STLSQ(threshold=each, alpha=ridge, max_iter=30), candidates, target) for each in THRESHOLDS]


def sr3(candidates: Floats, target: Floats) -> list[Floats]:
    """Sparse relaxed regularised regression with as many terms as pay for themselves, at each threshold."""
    return [
        fitted(pysindy.SR3(reg_weight_lam=each**2 / 2.0, relax_coeff_nu=1.0, max_iter=1000), candidates, target)
        for each in THRESHOLDS
    ]


def frols(candidates: Floats, target: Floats) -> list[Floats]:
    """Forward regression with orthogonal least squares: so many terms, each the one that explains most of the rest."""
    model, size = pysindy.FROLS(max_iter=MOST_TERMS, alpha=1e-9), candidates.shape[1]
    # of columns that say exactly the same it divides by zero: a little of its own sets each apart
    fitted(model, np.vstack([candidates, 1e-6 * np.eye(size)]), np.append(target, np.zeros(size)))
    found = []
    # the history's k-th entry has k terms
    for each in model.history_[: MOST_TERMS + 1]:
        there = np.flatnonzero(np.asarray(each).ravel())
        coefficients = np.zeros(size)
        coefficients[there] = np.linalg.lstsq(candidates[:, there], target, rcond=None)[0]
        found.append(coefficients)
    return found


def fitted(optimiser: Any, candidates: Floats, target: Floats) -> Floats:
    """(k,) coefficients of an optimiser of PySINDy."""
    with warnings.catch_warnings():
        # that nothing is left, or that it has not quite converged, is an answer
        warnings.simplefilter("ignore")
        return np.asarray(optimiser.fit(candidates, target).coef_).ravel()


PATHS: dict[str, Optimiser] = {"STLSQ": stlsq, "SR3": sr3, "FROLS": frols}


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
    place: int
    """On the path from the sparsest model, that cross-validation chose."""


def compressed(rows: Floats) -> Floats:
    """The triangular factor of rows, with the same sums of squares."""
    return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows


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


def path(rows: Floats, fixed: int, optimiser: str) -> list[Floats]:
    """(columns,) coefficients of all columns, the sparsest first."""
    candidates, target, norms = without_constants(rows, fixed)
    size, there = float(np.linalg.norm(target)), np.isfinite(norms)
    found = []
    for each in PATHS[optimiser](candidates[:, there], target / size):
        coefficients = np.zeros(rows.shape[1] - 1)
        coefficients[fixed:][there] = each * size / norms[there]
        rest = rows[:, -1] - rows[:, fixed:-1] @ coefficients[fixed:]
        coefficients[:fixed] = np.linalg.lstsq(rows[:, :fixed], rest, rcond=None)[0]
        found.append(coefficients)
    return found


def cross_validated(parts: Sequence[Part], fixed: int, settings: Settings) -> int:
    """The place on the path, by what is left of recordings that are left out one after the other."""
    recordings = sorted({each.recording for each in parts})
    left = []
    for out in recordings:
        train = compressed(np.vstack([each.rows for each in parts if each.recording != out]))
        test = np.vstack([each.rows for each in parts if each.recording == out])
        models = path(train, fixed, settings.optimiser)
        squares = np.array([np.sum((test[:, -1] - test[:, :-1] @ each) ** 2) for each in models])
        # a recording that is hard for all models counts no more than the others
        left.append(squares / squares[0])
    size = min(len(each) for each in left)
    table = np.array([each[:size] for each in left])
    mean = table.mean(axis=0)
    best = int(np.argmin(mean))
    # of the difference, since recordings are hard or easy for all models alike
    beyond = table - table[:, [best]]
    error = beyond.std(axis=0, ddof=1) / np.sqrt(len(recordings))
    allowed = np.maximum(settings.errors * error, settings.share * (mean[0] - mean[best]))
    return int(np.flatnonzero(beyond.mean(axis=0) <= allowed).min())


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
    at = cross_validated(parts, fixed, settings)

    def model(chosen: Sequence[Part]) -> Floats:
        """Coefficients at that place of the path, or at its end where it is shorter."""
        found = path(compressed(np.vstack([each.rows for each in chosen])), fixed, settings.optimiser)
        return found[min(at, len(found) - 1)]

    coefficients = np.zeros(len(columns))
    coefficients[taken] = model(parts)
    counts: Counter[str] = Counter()
    for _ in range(settings.draws if np.any(coefficients[fixed:]) else 0):
        again = model([parts[i] for i in rng.integers(len(parts), size=len(parts))])
        counts.update({name for name, size in zip(names, again, strict=True) if name and size != 0.0})
    inclusion = {name: count / settings.draws for name, count in counts.items()}
    selected = {column.mechanism for column, size in zip(columns, coefficients, strict=True) if size != 0.0} - {""}
    named = sorted(name for name in selected if inclusion.get(name, 0.0) >= settings.inclusion)
    return Found(coefficients, named, inclusion, at)


def correction(found: Found, columns: Sequence[Column]) -> Floats:
    """(2, n) what the regression adds to the readings of a recording."""
    return np.tensordot(found.coefficients, np.stack([each.readings for each in columns]), 1)
