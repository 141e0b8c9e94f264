"""What a model says of recordings of the drilling rig that it was not fitted to: only their own unknowns are estimated.

Those are the states of windows, the pressure, and amplitudes that each recording has of its own: of lines of the noise,
and of waves of the model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.drill import ShootingProblem
from drillenv.diagnosis.drill_noise import Noise, noise_left, quietest, with_lines_left
from drillenv.diagnosis.drill_states import better_from_steady_motion
from drillenv.diagnosis.drill_unknowns import MASSES, first_states, resized, states_under
from drillenv.diagnosis.fitting import OUTLYING, RELAXED, TIGHT, TIGHTENING, Fitted, priors_of
from drillenv.diagnosis.noise import NoiseModel
from drillenv.diagnosis.sensing import Added
from drillenv.diagnosis.solver import Floats, Limits, minimise
from drillenv.diagnosis.terms import Model, Term
from drillenv.diagnosis.thresholds import CLOSE

PART = 4
"""Windows of a part of a recording that is drawn for an interval."""
QUARTER = 0.25
"""Turns of the wave that stands for a drift."""


class StateEstimate(NamedTuple):
    """A recording with a model's prediction of it."""

    block: ShootingProblem
    own: Floats
    shared: Floats

    @property
    def model(self) -> Model:
        """With the parameters."""
        return self.block.structure.model(self.shared * self.block.scales, self.block.point)

    def values_of(self, term: Term) -> Floats:
        """Parameters of a term of the structure, in their own units."""
        return (self.shared * self.block.scales)[self.block.structure.part(term.name)]


def estimates_of(fitted: Fitted) -> list[StateEstimate]:
    """The recordings of a fit with its prediction."""
    return [StateEstimate(*each, fitted.fit.shared) for each in zip(fitted.blocks, fitted.fit.own, strict=True)]


def estimate_recordings(
    data: Sequence[Conditioned],
    fitted: Fitted,
    pool: Executor,
    noise: Sequence[Noise] | None = None,
    known: bool = False,
) -> list[StateEstimate]:
    """Recordings with only their own unknowns fitted; their noise, where it is not given, is what the model leaves.

    Of recordings that are ``known`` the fit has the beginning.
    """
    levels = quietest(fitted.noise, data, lines=known) if noise is None else noise
    beginnings = estimates_of(fitted) if known else [None] * len(data)

    def settle(each: Conditioned, level: Noise, beginning: StateEstimate | None) -> StateEstimate:
        there = estimate_states_of(
            each, *with_own_lines(fitted, level), beginning, lines_known=known or noise is not None
        )
        there = with_own_waves(there)
        return there if noise is not None else with_noise_left(there, fitted)

    return list(pool.map(settle, data, levels, beginnings))


def estimate_states_of(
    each: Conditioned,
    fitted: Fitted,
    level: Noise,
    beginning: StateEstimate | None = None,
    lines_known: bool = True,
) -> StateEstimate:
    """A recording's block with its own unknowns at their best; they begin as known, or as first guessed.

    Of the ``beginning`` of the recording those of a fit are known. Lines of the noise that are not known are those that
    windows leave while they are free: joined with such lines in them, states may come to another motion.
    """
    size = states_under(fitted.structure)
    windows = len(each.starts) - 1
    own = resized(first_states(each), windows, size, MASSES, 0)
    behind = slice(windows * size, windows * size + 2)
    if beginning is not None:
        states = beginning.block.states_of(beginning.own)
        own[behind] = beginning.own[states.size : states.size + 2]
        # a mount is pressed in, and air has given way, further on as well
        own[: windows * size].reshape(windows, size)[:, MASSES:] = states[:, MASSES:].mean(axis=0)
        own[: states.size] = states.ravel()
    shared = fitted.fit.shared

    def settle(slack: float, own: Floats) -> tuple[ShootingProblem, Floats]:
        block = ShootingProblem(each, fitted.structure, slack, level)
        if own.size != windows * size + block.locals:
            own = np.append(own[: behind.stop], np.zeros(len(block.lines)))
        if slack == RELAXED and beginning is None:
            own = block.find_states(shared, own)
        else:
            going_on = block.rollout(shared, own)
            as_guessed = slack > TIGHT and block.cost(shared, own) < block.cost(shared, going_on)
            own = block.estimate_states(shared, own if as_guessed else going_on)
        outlying = block.per_sample(shared, own) > OUTLYING * 2.0 * fitted.fit.cost / fitted.samples
        again = block.reinitialise_outliers(shared, own, outlying)
        return block, own if again is own else block.estimate_states(shared, again)

    block, own = settle(RELAXED, own)
    if not lines_known:
        there = StateEstimate(block, own, shared)
        level = with_more_lines(block, with_lines_left(fitted_alone(there, fitted))[0])
        block, own, _ = weighed(there, level, fitted)
    if fitted.slack == RELAXED:
        return StateEstimate(block, own, shared)
    free, close = own, block.per_sample(shared, own) < CLOSE
    # windows that are free say little of the pressure, and of what goes on from each to the next
    begun = free.copy()
    begun[behind] = 0.0
    if beginning is not None:
        begun[behind], begun[:2] = beginning.own[states.size : states.size + 2], states[0, :2]
    block, own = settle(fitted.slack, begun)
    if close and block.per_sample(shared, own) > CLOSE and not each.fresh:
        own = better_from_steady_motion(block, shared, own, block.cost(shared, own))
    if close and block.per_sample(shared, own) > CLOSE:
        # windows that were not near enough to each other to be joined at once
        own = free
        for slack in [*(each for each in TIGHTENING if each > fitted.slack), fitted.slack]:
            block, own = settle(slack, own)
    return StateEstimate(block, own, shared)


def with_noise_left(there: StateEstimate, fitted: Fitted) -> StateEstimate:
    """The same with the noise that a model leaves, where it comes close to the recording."""
    found = there
    if there.block.per_sample(there.shared, there.own) > CLOSE:
        found = weighed(there, with_lines_left(fitted_alone(there, fitted))[0], fitted)
    if found.block.per_sample(found.shared, found.own) > CLOSE:
        return there
    return weighed(found, noise_left(fitted_alone(found, fitted))[0], fitted)


def fitted_alone(there: StateEstimate, fitted: Fitted) -> Fitted:
    """A fit that has one recording."""
    fit = replace(fitted.fit, shared=there.shared, own=[there.own])
    return Fitted(there.block.structure, [there.block], fit)


def weighed(there: StateEstimate, noise: Noise, fitted: Fitted) -> StateEstimate:
    """The same with another noise, and lines of the model whose amplitudes are each recording's."""
    block, own, shared = there
    if fitted.structure.terms != block.structure.terms:
        noise = with_own_lines(fitted, noise)[1]
    again = replace(block, noise=noise)
    begun = np.append(own[: own.size - len(block.lines)], np.zeros(len(again.lines)))
    return StateEstimate(again, again.estimate_states(shared, begun), shared)


def with_own_waves(there: StateEstimate) -> StateEstimate:
    """The same with amplitudes that are each recording's own fitted to this one, where its model has such."""
    block, own, shared = there
    terms, values, free = [], [], []
    for term, each in zip(block.structure.terms, block.structure.split(shared * block.scales), strict=True):
        alone, begun = term.of_recording(block.point.name, each)
        terms.append(alone)
        values.append(begun / alone.scales)
        free.append((np.arange(begun.size) >= alone.common) & (alone is not term))
    open_ = np.concatenate(free)
    if not open_.any():
        return there
    start = np.concatenate(values)
    structure = replace(block.structure, terms=tuple(terms))
    bounds = priors_of(structure)
    pinned = replace(
        bounds,
        centre=start,
        precision=np.where(open_, bounds.precision, 0.0),
        low=np.where(open_, bounds.low, start),
        high=np.where(open_, bounds.high, start),
    )
    alone = replace(block, structure=structure)
    fit = minimise([alone], start, [own], pinned, Limits(15, 0.5, 1e-3), samples=block.samples)
    return StateEstimate(alone, fit.own[0], fit.shared)


def with_own_lines(fitted: Fitted, level: Noise) -> tuple[Fitted, Noise]:
    """The same model with lines whose amplitudes are each recording's as lines of a recording that was left out."""
    kept, start = [], []
    for term, own in zip(fitted.structure.terms, fitted.structure.split(fitted.values), strict=True):
        if not (isinstance(term, Added) and term.names):
            kept.append(term)
            start.append(own / term.scales)
    if len(kept) == len(fitted.structure.terms):
        return fitted, level
    more = own_lines(fitted)
    structure = replace(fitted.structure, terms=tuple(kept))
    first, second = (replace(each, lines=tuple(sorted({*each.lines, *more}))) for each in level)
    fit = replace(fitted.fit, shared=np.concatenate(start))
    return replace(fitted, structure=structure, fit=fit), (first, second)


def own_lines(fitted: Fitted) -> list[float]:
    """Frequencies (Hz) of lines of the model whose amplitudes are each recording's; 0 is an offset.

    A drift is next to straight in a wave that turns by less than a quarter, beside a constant; a line that swells has
    lines beside it.
    """
    found: set[float] = set()
    turn = QUARTER / max(each.data.force.size / each.data.rate for each in fitted.blocks)
    for term, own in zip(fitted.structure.terms, fitted.structure.split(fitted.values), strict=True):
        if isinstance(term, Added) and term.names:
            frequency = term.frequency_of(own)
            aside = (-turn, 0.0, turn) if term.degree else (0.0,)
            found |= {abs(float(order * frequency + each)) for order in term.orders or (0,) for each in aside}
    # nearer to each other they are not told apart
    lines = sorted(found)
    return [line for line, before in zip(lines, [-math.inf, *lines], strict=False) if line - before > 0.5 * turn]


def with_more_lines(block: ShootingProblem, more: Noise) -> Noise:
    """A recording's noise with those lines of another that are told from its own."""
    apart = block.data.rate / block.data.force.size
    first, second = (
        replace(own, lines=tuple(sorted((*own.lines, *(x for x in new.lines if is_apart(x, own.lines, apart))))))
        for own, new in zip(block.noise, more, strict=True)
    )
    return first, second


def is_apart(line: float, others: Sequence[float], apart: float) -> bool:
    """Whether a line (Hz) is farther than so much from all others."""
    return all(abs(line - each) > apart for each in others)


def without_lines(block: ShootingProblem, lines: Sequence[float]) -> Noise:
    """A recording's noise without what is not told from some lines."""
    apart = block.data.rate / block.data.force.size

    def less(level: NoiseModel) -> NoiseModel:
        return replace(level, lines=tuple(x for x in level.lines if is_apart(x, lines, apart)))

    first, second = block.noise
    return less(first), less(second)


def chi_square(blocks: Sequence[StateEstimate]) -> float:
    """Reduced chi-square of recordings' samples, their own unknowns counted; infinite where one is not followed."""
    total, dof = 0.0, 0
    for each in blocks:
        block, own, shared = each
        raw = block.integrate(each.model, own)
        if not raw.completed:
            return math.inf
        residual = block.residual(shared * block.scales, raw.signals, own)
        total += float((residual**2).sum())
        dof += block.samples - block.free_unknowns(own)
    return total / max(dof, 1)


def excess_chi_square(blocks: Sequence[StateEstimate]) -> Floats:
    """(parts,) by how much squares of residuals exceed the noise, over parts of a few windows of recordings."""
    found = []
    for block, own, shared in blocks:
        by_window = 2.0 * block.costs(shared, own)[1]
        expected = (block.samples - block.free_unknowns(own)) / block.windows
        found.append(np.add.reduceat(by_window - expected, np.arange(0, block.windows, PART)))
    return np.concatenate(found)
