"""Fits of a hypothesis to recordings, and the noise that they leave."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.drill import Recorded
from drillenv.diagnosis.laws import axes_of
from drillenv.diagnosis.noise import NoiseModel, estimate, line_columns, lone_lines, nuisance
from drillenv.diagnosis.solver import Fit, Floats, Limits, Priors, minimise
from drillenv.diagnosis.terms import Hypothesis
from drillenv.diagnosis.thresholds import CLOSE
from drillenv.dynamics.hybrid import vector_field as V

FREE, JOINED = 1e3, 1.0
"""Of the continuity constraints' standard deviations: windows nearly free, and windows that go on from each other to
within the integrator's error."""
GRADUAL = (100.0, 10.0, JOINED)
"""From one to the other in smaller steps."""
FULL = Limits()
LOWEST_LINE = 130.0
"""Hz from which lines are of the noise. Below, floors shake and mains hum, with two orders: families of their own."""
SETTLING = 6
"""Steps of own unknowns alone before a fit that begins elsewhere."""


@dataclass
class Fitted:
    """A hypothesis fitted to recordings."""

    hypothesis: Hypothesis
    blocks: list[Recorded]
    fit: Fit
    priors: Priors

    @property
    def values(self) -> Floats:
        """Of the parameters, in their units."""
        return self.fit.shared * np.array([each.width for each in self.hypothesis.unknowns])

    @property
    def cost(self) -> float:
        """Negative log-likelihood with the priors."""
        return self.fit.cost

    @property
    def noise(self) -> list[Noise]:
        """Of each recording."""
        return [each.noise for each in self.blocks]

    @property
    def weight(self) -> float:
        """Of the continuity constraints."""
        return self.blocks[0].weight

    @property
    def samples(self) -> int:
        """How many numbers are fitted."""
        return sum(each.samples for each in self.blocks)

    @property
    def freedom(self) -> int:
        """Samples less own unknowns."""
        return self.samples - sum(own.size for own in self.fit.own) - self.fit.shared.size

    @property
    def per_freedom(self) -> float:
        """Reduced chi-square."""
        return 2.0 * self.cost / self.freedom

    def values_of(self, name: str) -> Floats:
        """Parameters of a term."""
        split = self.hypothesis.split(self.values)
        return next(own for term, own in zip(self.hypothesis.terms, split, strict=True) if term.name == name)


def priors_of(hypothesis: Hypothesis) -> Priors:
    """Priors and bounds of a hypothesis' parameters, in the solver's units."""
    unknowns = hypothesis.unknowns
    widths = np.array([each.width for each in unknowns])
    return Priors(
        np.array([each.value for each in unknowns]) / widths,
        widths / np.array([each.std for each in unknowns]),
        np.array([each.low for each in unknowns]) / widths,
        np.array([each.high for each in unknowns]) / widths,
    )


Noise = tuple[NoiseModel, NoiseModel]


def noise_of(data: Conditioned) -> Noise:
    """White noise as conditioning has found it."""
    return NoiseModel(data.noise_force, 0.0, (), data.rate), NoiseModel(data.noise_acceleration, 0.0, (), data.rate)


def noise_left(fitted: Fitted, pool: Executor | None) -> list[Noise]:
    """Noise of each recording as a fit's residuals show it."""

    def estimated(block: Recorded, own: Floats) -> Noise:
        left, quanta = left_by(fitted, block, own), block.data.quanta
        return level(left[0], quanta[0], block), level(left[1], quanta[1], block)

    def level(row: Floats, quantum: float, block: Recorded) -> NoiseModel:
        rate, tone = block.data.rate, float(block.scene.frequency)
        found = lines_of_noise(estimate(row, rate, tone, quantum))
        lone = lone_lines(row, rate, tone, found)
        alone = lines_of_noise(replace(found, lines=tuple(sorted((*found.lines, *lone)))))
        if alone.lines == found.lines:
            return found
        # with them gone the level is another
        columns = line_columns(alone, row.size).T
        again = lines_of_noise(estimate(row - columns @ np.linalg.lstsq(columns, row)[0], rate, tone, quantum))
        return replace(again, lines=tuple(sorted({*alone.lines, *again.lines})))

    each: Callable = map if pool is None else pool.map
    return list(each(estimated, fitted.blocks, fitted.fit.own))


def left_by(fitted: Fitted, block: Recorded, own: Floats) -> Floats:
    """(2, n) residuals of a recording; lines that are known already are left in."""
    values = fitted.values
    raw = block.integrate(fitted.hypothesis.model(values, block.scene), own)
    return (block.measured - block.read(values, raw.said))[:, block.steady]


def lines_of_noise(level: NoiseModel) -> NoiseModel:
    """The same without lines at frequencies at which something else may be seen."""
    return replace(level, lines=tuple(each for each in level.lines if each >= LOWEST_LINE))


def with_lines_left(fitted: Fitted, pool: Executor | None) -> list[Noise]:
    """The noise that a fit was weighed by, with lines as its residuals show them off the harmonics of the excitation.

    What a model misses of a motion that repeats itself lies on harmonics: these lines are seen however far it is off.
    """

    def known(block: Recorded, own: Floats) -> Noise:
        rate, tone = block.data.rate, float(block.scene.frequency)
        first, second = (
            replace(level, lines=lines_of_noise(estimate(row, rate, tone)).lines)
            for row, level in zip(left_by(fitted, block, own), block.noise, strict=True)
        )
        return first, second

    each: Callable = map if pool is None else pool.map
    return list(each(known, fitted.blocks, fitted.fit.own))


def quietest(noise: Sequence[Noise], data: Sequence[Conditioned], lines: bool = False) -> list[Noise]:
    """One noise for all recordings: that of the recording in which a channel has the least power.

    Sensors are the same in all of them, and where a model is far off its residuals are their noise and more. ``lines``
    keeps each recording's, in the order of the noise.
    """

    def power(level: NoiseModel) -> float:
        # from a hertz to the Nyquist frequency, over the rate
        return level.std**2 / level.rate * (1.0 + 2.0 * level.corner / level.rate * math.log(level.rate / 2.0))

    least = [min((each[i] for each in noise), key=power) for i in range(2)]

    def at(rate: float, own: Noise | None) -> Noise:
        first, second = (
            replace(level, std=level.std * math.sqrt(rate / level.rate), lines=own[i].lines if own else (), rate=rate)
            for i, level in enumerate(least)
        )
        return first, second

    return [at(each.rate, noise[i] if lines else None) for i, each in enumerate(data)]


def resized(own: Floats, windows: int, size: int, kept: int, lines: int) -> Floats:
    """The same with so many states a window, where it had ``kept``, and so many amplitudes of lines."""
    states = np.zeros((windows, size))
    take = min(kept, size)
    states[:, :take] = own[: windows * kept].reshape(windows, kept)[:, :take]
    behind = np.zeros(2 + lines)
    behind[:2] = own[windows * kept : windows * kept + 2]
    if own.size == windows * kept + 2 + lines:
        behind = own[windows * kept :]
    return np.concatenate([states.ravel(), behind])


def kept_of(own: Floats, windows: int) -> int:
    """States a window of own unknowns whose lines are fewer than three windows."""
    return V.OWN if (own.size - 2) // windows >= V.OWN else 4


def fitted_to(own: Floats, windows: int, size: int, level: Noise) -> Floats:
    """Own unknowns with so many states a window, and amplitudes of the lines of a noise model."""
    lines = sum(len(nuisance(each, 2)[1]) for each in level)
    return resized(own, windows, size, kept_of(own, windows), lines)


def chained(blocks: Sequence[Recorded], shared: Floats, own: Sequence[Floats], pool: Executor | None) -> list[Floats]:
    """Own unknowns with which windows go on from each other: see :meth:`Recorded.chained`."""
    each: Callable = map if pool is None else pool.map
    return list(each(lambda block, x: block.chained(shared, x), blocks, own))


def fit_to(
    data: Sequence[Conditioned],
    hypothesis: Hypothesis,
    start: Floats | None,
    own: Sequence[Floats],
    pool: Executor | None,
    weight: float,
    limits: Limits = FULL,
    noise: Sequence[Noise] | None = None,
    settled: bool = False,
) -> Fitted:
    """Fit a hypothesis; ``start`` in the solver's units, None for the priors' centres; ``weight`` as of a block.

    Own unknowns are ``settled`` first where the start is of another kind than the model they were fitted with.
    """
    priors = priors_of(hypothesis)
    shared = priors.centre.copy() if start is None else start
    size = V.OWN if any(term.remembers for term in hypothesis.terms) else 4
    levels = [noise_of(each) if noise is None else noise[i] for i, each in enumerate(data)]
    own = [
        fitted_to(each, len(one.starts) - 1, size, level) for each, one, level in zip(own, data, levels, strict=True)
    ]
    blocks = [Recorded(each, hypothesis, weight, level) for each, level in zip(data, levels, strict=True)]
    samples = sum(each.samples for each in blocks)
    if settled:
        each: Callable = map if pool is None else pool.map
        own = list(each(lambda block, x: block.settled(shared, x, SETTLING), blocks, own))
    fit = minimise(blocks, shared, own, priors, limits, pool, samples)
    own = restarted(blocks, fit, pool)
    if any(one is not other for one, other in zip(own, fit.own, strict=True)):
        fit = minimise(blocks, fit.shared, own, priors, limits, pool, samples)
    return Fitted(hypothesis, blocks, fit, priors)


def joined(
    data: Sequence[Conditioned], found: Fitted, pool: Executor, limits: Limits, noise: Sequence[Noise]
) -> Fitted:
    """A fit whose windows are nearly free, with windows that go on from each other as closely as the model can.

    At once, or else in small steps, of which the last is kept at which the model still comes close.
    """
    if found.weight <= JOINED or found.per_freedom > CLOSE:
        return found
    begun = chained(found.blocks, found.fit.shared, found.fit.own, pool)
    at_once = fit_to(data, found.hypothesis, found.fit.shared, begun, pool, JOINED, limits, noise)
    if at_once.per_freedom < CLOSE:
        return at_once
    for weight in [each for each in GRADUAL if each < found.weight]:
        further = fit_to(data, found.hypothesis, found.fit.shared, found.fit.own, pool, weight, limits, noise)
        if further.per_freedom > CLOSE:
            break
        found = further
    return found


def restarted(blocks: Sequence[Recorded], fit: Fit, pool: Executor | None) -> list[Floats]:
    """Own unknowns of each block, windows that stand out begun anew."""
    each: Callable = map if pool is None else pool.map
    return list(each(lambda block, own: block.restarted(fit.shared, own), blocks, fit.own))


def motions(fitted: Fitted, pool: Executor) -> tuple[list[Floats], list]:
    """Path (7, n) and model of each recording, where the fit stands."""
    values = fitted.values
    models = [fitted.hypothesis.model(values, each.scene) for each in fitted.blocks]

    return list(pool.map(Recorded.path, fitted.blocks, models, fitted.fit.own)), models


def axes_at(fitted: Fitted, pool: Executor):
    """Axes over the ranges that a fit's motions visit."""
    paths, models = motions(fitted, pool)
    drive = max(float(each.s[V.F_A]) for each in models)
    rest = [float(each.s[V.F_B] / each.s[V.K]) for each in models]
    return axes_of(paths, drive, rest)
