"""One body: least squares with beliefs, the noise that is left, and what chance alone would seem to explain.

The balance is linear in its strengths, so a fit is one solution of linear equations, and a bootstrap of hundreds of
made-up campaigns one product of matrices. What is left of the best that can be said about the recordings is taken for
noise, coloured as it is (an autoregression for each campaign, a size for each recording); campaigns are made up of the
fitted balance and such noise, and a mechanism has to explain more of the recordings than any does of those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from drillenv.diagnosis.one_body.channels import Body
from drillenv.diagnosis.one_body.terms import Term, Variant, target

DRAWS = 400
"""Made-up campaigns."""
ALARMS = 0.001
"""Chance that any mechanism seems to explain as much where none is missing."""
ORDER = 16
"""Of the autoregression at most."""
BLOCKS = 6
"""Stretches that recordings are cut into for leaving out, where there are too few of them."""
LEAST_RECORDINGS = 3
HIDDEN = 1e-4
"""Share of a term's column that the constants do not already make, below which it cannot be told from them."""
BATCH = 96
"""Columns held against the made-up campaigns at once."""
EULER = 0.5772156649


@dataclass(slots=True, eq=False)
class Rows:
    """The rows of the recordings to be fitted, one under the other: N of them."""

    bodies: list[Body]
    mass: float
    """kg, that the left side is made with where no force is measured."""
    y: np.ndarray = field(init=False)
    """(N,) N, the left side."""
    owner: np.ndarray = field(init=False)
    """(N,) which recording."""
    groups: np.ndarray = field(init=False)
    """(N,) what is left out together: recordings, or stretches of them where there are few."""
    blocks: np.ndarray = field(init=False)
    """(N,) stretches of all recordings."""
    _made: dict[Term, np.ndarray] = field(init=False, default_factory=dict)

    def __post_init__(self):
        self.y = np.concatenate([target(body, self.mass)[body.keep] for body in self.bodies])
        sizes = [int(body.keep.sum()) for body in self.bodies]
        self.owner = np.repeat(np.arange(len(sizes)), sizes)
        self.blocks = np.concatenate([np.arange(size) * BLOCKS // size for size in sizes])
        many = len(sizes) >= LEAST_RECORDINGS
        self.groups = self.owner if many else self.owner * BLOCKS + self.blocks

    def columns(self, terms: Sequence[Term]) -> np.ndarray:
        """(N, terms), each made once."""
        for term in terms:
            if term not in self._made:
                self._made[term] = self.fresh([term])[:, 0]
        return np.column_stack([self._made[term] for term in terms]) if terms else np.zeros((self.y.size, 0))

    def fresh(self, terms: Sequence[Term]) -> np.ndarray:
        """(N, terms), of terms that are not asked for again."""
        return np.column_stack(
            [np.concatenate([term.column(body)[body.keep] for body in self.bodies]) for term in terms]
        )


@dataclass(slots=True, eq=False)
class Noise:
    """What is left of the best that can be said."""

    size: float
    """N, root mean square."""
    counted: float
    """N, the size at which rows would have to be independent to say as much as these do."""
    draws: np.ndarray
    """(N, DRAWS) noise made up alike."""


@dataclass(slots=True, eq=False)
class Fitted:
    """Strengths of terms."""

    terms: tuple[Term, ...]
    values: np.ndarray
    """(p,)."""
    covariance: np.ndarray
    """(p, p)."""
    left: np.ndarray
    """(N,) N."""
    left_out: np.ndarray
    """(N,) N, of each row what a fit leaves that did not see its recording or stretch."""

    @property
    def mean_square(self) -> float:
        """N^2, of rows left out."""
        return float(np.mean(self.left_out**2))

    def constants(self) -> dict[str, float]:
        """Strengths by name."""
        return {term.name: float(value) for term, value in zip(self.terms, self.values, strict=True)}

    def spreads(self) -> dict[str, float]:
        """Standard deviations by name."""
        spread = np.sqrt(np.diag(self.covariance))
        return {term.name: float(value) for term, value in zip(self.terms, spread, strict=True)}


def sizes_of(table: np.ndarray) -> np.ndarray:
    """(p,) lengths of columns to divide them by; 1 for one that is nought."""
    sizes = np.sqrt(np.sum(table**2, axis=0))
    return np.where(sizes > 0.0, sizes, 1.0)


def _beliefs(terms: Sequence[Term]) -> tuple[np.ndarray, np.ndarray]:
    """(k, p) rows and (k,) sides that hold strengths to what is believed of them."""
    stated = [i for i, term in enumerate(terms) if term.std is not None]
    rows = np.zeros((len(stated), len(terms)))
    sides = np.zeros(len(stated))
    for k, i in enumerate(stated):
        std, value = terms[i].std, terms[i].value
        assert std is not None and value is not None
        rows[k, i], sides[k] = 1.0 / std, value / std
    return rows, sides


def _solved(x: np.ndarray, y: np.ndarray, terms: Sequence[Term], counted: float) -> np.ndarray:
    rows, sides = _beliefs(terms)
    table, side = np.vstack([x / counted, rows]), np.concatenate([y / counted, sides])
    scale = sizes_of(table)
    return np.linalg.lstsq(table / scale, side, rcond=1e-10)[0] / scale


def fit(rows: Rows, terms: Sequence[Term], noise: Noise, local: bool = False) -> Fitted:
    """Fit the strengths of terms, once to all rows and once without each recording or stretch.

    Args:
        rows: To be fitted.
        terms: Of the balance; with one that holds for one recording only, stretches are left out and not recordings.
        noise: That is left.
        local: Leave out stretches in any case.
    """
    terms = tuple(terms)
    local = local or any(term.local for term in terms)
    x = rows.columns(terms)
    values = _solved(x, rows.y, terms, noise.counted)
    left_out, others = np.empty_like(rows.y), []
    groups = rows.blocks if local else rows.groups
    for group in np.unique(groups):
        there = groups == group
        without = _solved(x[~there], rows.y[~there], terms, noise.counted)
        left_out[there] = rows.y[there] - x[there] @ without
        others.append(without)
    beliefs, _ = _beliefs(terms)
    table = np.vstack([x / noise.counted, beliefs])
    scale = sizes_of(table)
    inverse = np.linalg.pinv(table / scale, rcond=1e-10) / scale[:, None]
    moved = inverse[:, : rows.y.size] @ (noise.draws / noise.counted)
    covariance = moved @ moved.T / noise.draws.shape[1]
    covariance = covariance + inverse[:, rows.y.size :] @ inverse[:, rows.y.size :].T
    # strengths that jump when a recording is left out are known less well than their noise says
    spread = np.array(others) - np.mean(others, axis=0)
    jackknife = (len(others) - 1) / len(others) * np.sum(spread**2, axis=0)
    wider = np.sqrt(np.maximum(1.0, jackknife / np.maximum(np.diag(covariance), 1e-300)))
    return Fitted(terms, values, covariance * np.outer(wider, wider), rows.y - x @ values, left_out)


def noise_of(rows: Rows, terms: Sequence[Term], rng: np.random.Generator) -> Noise:
    """What is left when all these terms are fitted, and noise like it."""
    x = rows.columns(terms)
    scale = sizes_of(x)
    left = rows.y - (x / scale) @ np.linalg.lstsq(x / scale, rows.y, rcond=1e-8)[0]
    spent = min(0.5, x.shape[1] / rows.y.size)
    left /= math.sqrt(1.0 - spent)
    sizes = [max(float(np.sqrt(np.mean(left[rows.owner == i] ** 2))), 1e-12) for i in range(len(rows.bodies))]
    series = []
    for i, body in enumerate(rows.bodies):
        one = np.zeros(body.keep.size)
        one[body.keep] = left[rows.owner == i] / sizes[i]
        series.append(one)
    weights, sigma = _autoregression(series)
    draws = np.empty((rows.y.size, DRAWS))
    for i, body in enumerate(rows.bodies):
        warm = 20 * ORDER
        white = rng.normal(0.0, sigma, (body.keep.size + warm, DRAWS))
        made = np.asarray(lfilter([1.0], np.concatenate([[1.0], -weights]), white, axis=0))[warm:]
        made *= sizes[i] / np.sqrt(np.mean(made**2))
        draws[rows.owner == i] = made[body.keep]
    size = float(np.sqrt(np.mean(left**2)))
    basis = np.linalg.qr(x / scale)[0]
    inflation = float(np.mean((basis.T @ draws) ** 2)) / size**2
    return Noise(size, size * math.sqrt(max(1.0, inflation)), draws)


def _autoregression(series: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Weights of the samples before, and the standard deviation of what is new in each; samples of 0 are gaps."""
    total = sum(int(np.count_nonzero(one)) for one in series)
    lags = np.array([sum(float(one[: one.size - k] @ one[k:]) for one in series) for k in range(ORDER + 1)]) / total
    best = (math.inf, np.zeros(0), 1.0)
    for order in range(ORDER + 1):
        weights = solve_toeplitz(lags[:order], lags[1 : order + 1]) if order else np.zeros(0)
        variance = max(float(lags[0] - weights @ lags[1 : order + 1]), 1e-12)
        criterion = total * math.log(variance) + order * math.log(total)
        if criterion < best[0]:
            best = criterion, weights, math.sqrt(variance)
    return best[1], best[2]


@dataclass(slots=True, eq=False)
class Score:
    """What a variant would explain beside the terms that are there."""

    variant: Variant
    gain: float
    """Over what it explains of the made-up campaigns in the mean."""
    strengths: np.ndarray


def scored(
    rows: Rows, terms: Sequence[Term], variants: Sequence[Variant], noise: Noise, rng: np.random.Generator
) -> tuple[list[Score], float, list[str]]:
    """Hold every variant beside the terms.

    Returns:
        The variants, most gain first; the gain that chance reaches once in 1 / ALARMS campaigns; and the mechanisms
        that cannot be told from the constants at all.
    """
    beliefs, sides = _beliefs(terms)
    table = np.vstack([rows.columns(terms) / noise.counted, beliefs])
    base = _orthogonal(table, 1e-12)
    side = np.concatenate([rows.y / noise.counted, sides])
    left = side - base @ (base.T @ side)
    made = np.vstack([noise.draws / noise.counted, rng.normal(size=(sides.size, noise.draws.shape[1]))])
    scores, hidden, maxima = [], [], np.zeros(noise.draws.shape[1])
    for some in _batches(variants):
        bases: list[tuple[Variant, np.ndarray, np.ndarray]] = []
        for variant in some:
            found = _beside(rows.columns(variant.terms) / noise.counted, base)
            if found is None:
                hidden.append(variant.mechanism)
            else:
                bases.append((variant, *found))
        if not bases:
            continue
        # one product of matrices for all of them: the made-up campaigns are read once
        projected = np.hstack([basis for _variant, basis, _rest in bases]).T @ made
        first = 0
        for variant, basis, rest in bases:
            chance = np.sum(projected[first : first + basis.shape[1]] ** 2, axis=0)
            first += basis.shape[1]
            usual = float(chance.mean())
            maxima = np.maximum(maxima, chance / usual)
            strengths = np.linalg.lstsq(basis.T @ rest, basis.T @ left, rcond=1e-10)[0]
            scores.append(Score(variant, float(np.sum((basis.T @ left) ** 2)) / usual, strengths))
    scale = float(np.std(maxima)) * math.sqrt(6.0) / math.pi
    needed = float(np.mean(maxima)) - EULER * scale - scale * math.log(-math.log1p(-ALARMS))
    told = {score.variant.mechanism for score in scores}
    return (
        sorted(scores, key=lambda each: -each.gain),
        needed,
        [name for name in dict.fromkeys(hidden) if name not in told],
    )


def best_beside(rows: Rows, terms: Sequence[Term], variants: Sequence[Variant]) -> Variant | None:
    """The variant that explains most beside the terms, whatever chance would explain."""
    base = _orthogonal(rows.columns(terms), 1e-10)
    left = rows.y - base @ (base.T @ rows.y)
    best, most = None, 0.0
    for variant in variants:
        found = _beside(rows.columns(variant.terms), base)
        if found is None:
            continue
        gain = float(np.sum((found[0].T @ left) ** 2))
        if gain > most:
            best, most = variant, gain
    return best


def _batches(variants: Sequence[Variant]) -> list[list[Variant]]:
    """Variants in lots of a bearable size."""
    lots: list[list[Variant]] = [[]]
    columns = 0
    for variant in variants:
        if columns + len(variant.terms) > BATCH and lots[-1]:
            lots.append([])
            columns = 0
        lots[-1].append(variant)
        columns += len(variant.terms)
    return lots


def _beside(own: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Of columns what a basis has not: an orthonormal basis of it, and itself; None where that is next to nothing.

    The basis may have further rows below, of beliefs, in which the columns are nought.
    """
    own = np.vstack([own, np.zeros((base.shape[0] - own.shape[0], own.shape[1]))])
    sizes = sizes_of(own)
    rest = own - base @ (base.T @ own)
    rest -= base @ (base.T @ rest)
    if not (np.sqrt(np.sum(rest**2, axis=0)) > HIDDEN * sizes).all():
        return None
    return _orthogonal(rest, 1e-6), rest


def _orthogonal(table: np.ndarray, least: float) -> np.ndarray:
    """An orthonormal basis of the columns."""
    scale = sizes_of(table)
    left, sizes, _ = np.linalg.svd(table / scale, full_matrices=False)
    return left[:, sizes > least * sizes[0]] if sizes.size else left


def floor(rows: Rows, constants: dict[str, float]) -> float:
    """N, root mean square that the white noise of the channels alone leaves of the balance."""
    total = 0.0
    for i, body in enumerate(rows.bodies):
        parts = [
            constants.get("damping", 0.0) * body.noise["velocity"],
            constants.get("stiffness", 0.0) * body.noise["position"],
        ]
        if body.force is None:
            parts.append(rows.mass * body.noise["acceleration"])
        else:
            parts += [body.noise["force"], constants.get("mass", 0.0) * body.noise["acceleration"]]
        total += sum(part**2 for part in parts) * int((rows.owner == i).sum())
    return math.sqrt(total / rows.y.size)


def shape_spread(
    variant: Variant, strengths: np.ndarray, rows: Rows, terms: Sequence[Term], counted: float
) -> dict[str, float]:
    """Standard deviations of the numbers of a variant's shape by symbol, from how its terms change with them."""
    if variant.reshaped is None or not variant.symbols:
        return {}
    slopes = []
    for i, number in enumerate(variant.shape):
        step = 1e-3 * (abs(number) or 1.0)
        sides = []
        for way in (-step, step):
            shape = [each + way * (j == i) for j, each in enumerate(variant.shape)]
            sides.append(rows.fresh(variant.reshaped(shape).terms) @ strengths)
        slopes.append((sides[1] - sides[0]) / (2 * step))
    columns = np.column_stack(slopes)
    base = _orthogonal(rows.columns(terms), 1e-12)
    columns = columns - base @ (base.T @ columns)
    covariance = np.linalg.pinv(columns.T @ columns / counted**2)
    return {name: math.sqrt(float(covariance[i, i])) for i, name in enumerate(variant.symbols)}
