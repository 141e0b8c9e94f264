"""The states of a recording of the drilling rig: found from a first guess, estimated, and begun anew.

Each is a function of the recording's problem, of shared parameters and of own unknowns, both as the solver has them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve

from drillenv.diagnosis.drill_unknowns import MASSES, STATE_WIDTHS, first_states, resized
from drillenv.diagnosis.fitting import RELAXED, TIGHT
from drillenv.diagnosis.solver import Floats, factor
from drillenv.diagnosis.thresholds import CLOSE
from drillenv.dynamics.constitutive.places import GUIDE, INDENTER
from drillenv.dynamics.hybrid.vector_field import V2, W

if TYPE_CHECKING:
    from drillenv.diagnosis.drill import ShootingProblem

IMPROBABLE = 5.0
"""Standard deviations of its label from which a pressure may stand for a force that a model has the wrong way round."""
LABELLED = 1e6
"""Precision of labels that are taken for exact."""
PROGRESS = 0.8
"""Share of its cost to which a recording has to come with windows begun anew for them to be begun anew once more."""
FOUND_QUANTILE = 0.25
"""Quantile of the windows' costs a sample that stands for windows whose states have been found."""
WORSE, CORRECTIONS = 10.0, 6
"""Own unknowns whose step makes a recording worse, up to so many times, take so many steps of their own at most."""


def inner_steps(
    block: ShootingProblem, shared: Floats, tried: tuple[float, Floats], before: float
) -> tuple[float, Floats]:
    """Cost and own unknowns after steps of their own, where the last one of all parameters made the recording worse.

    Where continuity is tight, states follow the shared parameters along a curve. They are followed to their end: own
    unknowns that are left where the recording is no worse than before stay in another valley.
    """
    cost, own = tried
    return fit_states(block, shared, own, cost, CORRECTIONS) if before < cost < WORSE * before else tried


def line_search(
    block: ShootingProblem, shared: Floats, own: Floats, move: Floats, before: float
) -> tuple[float, Floats]:
    """Cost and own unknowns after a step of theirs, or what of it costs least."""
    at = own + move
    best, costs = block.costs(shared, at)
    if best <= before:
        return best, at
    if block.slack <= TIGHT:
        # the step is along the continuity constraints' tangent: from there back to where they hold
        going_on = block.rollout(shared, at)
        cost = block.cost(shared, going_on)
        return (cost, going_on) if cost < best else (best, at)
    kept = block.state_count(own)
    for share in (0.3, 0.0):
        part = own + share * move
        cost, other = block.costs(shared, part)
        # windows that are nearly free choose each for themselves
        better = np.append(np.repeat(other < costs, kept), np.zeros(block.locals, dtype=bool))
        chosen = np.where(better, part, at)
        mixed, mixed_costs = block.costs(shared, chosen)
        if mixed < min(best, cost):
            best, at, costs = mixed, chosen, mixed_costs
        elif cost < best:
            best, at, costs = cost, part, other
    return best, at


def reinitialise_outliers(block: ShootingProblem, shared: Floats, own: Floats, outlying: bool) -> Floats:
    """Windows whose cost stands out, begun as first guessed, as the one before ends, and as the next ones begin.

    A recording is begun anew as a whole where it is ``outlying``, since the model follows the others by far more
    closely, and where in a close model with friction its pressure is not to be believed: that holds a mass one way
    or the other, and its force and the pressure's can stand for each other. In a model that is far off pressures
    stand for all that it lacks.
    """
    cost, costs = block.costs(shared, own)
    close = block.slack <= TIGHT and 2.0 * cost < CLOSE * block.samples
    model = block.structure.model(shared * block.scales, block.point)
    with_friction = model.bends(GUIDE) or model.bends(INDENTER)
    rolled_out = better_by_rollout(block, shared, own, cost) if close and with_friction else own
    if rolled_out is not own:
        own = rolled_out
        cost, costs = block.costs(shared, own)
    mistaken = close and with_friction and abs(own[block.windows * block.state_count(own)]) > IMPROBABLE
    if mistaken or outlying:
        if block.slack <= TIGHT and not block.data.fresh:
            own = better_from_steady_motion(block, shared, own, cost)
            cost, costs = block.costs(shared, own)
        most = math.inf if mistaken else PROGRESS * found_cost(block, costs)
        own = reinitialised(block, shared, own, most)
        cost, costs = block.costs(shared, own)
    typical = float(np.median(costs / np.diff(block.data.starts)))
    return own if typical > 1.5 and not outlying else with_windows_reinitialised(block, shared, own, cost, costs)[1]


def better_by_rollout(block: ShootingProblem, shared: Floats, own: Floats, cost: float) -> Floats:
    """Own unknowns of a known cost, or those with states that go on from the first ones, where these come lower.

    Friction that holds a mass in one window and not in the next parts valleys that no step goes between.
    """
    begun = estimate_states(block, shared, block.rollout(shared, own))
    return begun if block.cost(shared, begun) < cost - negligible_gain(cost, block.samples) else own


def better_from_steady_motion(block: ShootingProblem, shared: Floats, own: Floats, cost: float) -> Floats:
    """Own unknowns of a known cost, or those that come of a motion which begins as it goes on, where these come lower.

    A rig that runs repeats itself. Where a recording begins, its slow states (the coupling's, those of bristles and of
    a bed) have to be guessed; where it ends, the model has come to them.
    """
    kept = block.state_count(own)
    states = block.states_of(own).copy()
    slow = np.setdiff1d(np.arange(kept), (V2, W))
    states[0, slow] = np.median(states[-max(1, block.windows // 4) :, slow], axis=0)
    begun = block.rollout(shared, np.append(states.ravel(), own[states.size :]))
    begun = estimate_states(block, shared, estimate_by_labels(block, shared, begun))
    return begun if block.cost(shared, begun) < cost - negligible_gain(cost, block.samples) else own


def with_windows_reinitialised(
    block: ShootingProblem, shared: Floats, own: Floats, cost: float, costs: Floats
) -> tuple[float, Floats]:
    """Cost and own unknowns with windows that stand out begun from elsewhere, where that comes to a lower cost.

    From a known cost, and that of each window.
    """
    # where the motion is another one in most of them the better ones tell
    stray = costs / np.diff(block.data.starts) > max(2.0 * found_cost(block, costs), 1.5)
    if not stray.any():
        return cost, own
    kept = block.state_count(own)
    model = block.structure.model(shared * block.scales, block.point)
    raw = block.integrate(model, own)
    states = block.states_of(own)
    behind = own[states.size :]
    ends = block.owned(raw.ends, block.labelled(own, model), kept)
    guess = states.copy()
    guess[:, 2:4] = block.data.states[:, 2:4] / STATE_WIDTHS[2:4]
    first = guess.copy()
    first[1:, :2] = np.where(stray[:-1, None], guess[1:, :2], ends[:-1, :2])
    going_on = states.copy()
    going_on[1:] = ends[:-1]
    # as in the windows after it: a rig that runs repeats itself after one or two
    next_, after_next = np.roll(states, -1, axis=0), np.roll(states, -2, axis=0)
    best, at = costs, own
    for trial in (first, going_on, next_, after_next):
        begun = estimate_states(block, shared, np.append(np.where(stray[:, None], trial, states).ravel(), behind))
        _, other = block.costs(shared, begun)
        better = np.append(np.repeat(stray & (other < best), kept), np.zeros(block.locals, dtype=bool))
        at, best = np.where(better, begun, at), np.minimum(best, other)
    after = block.cost(shared, at)
    return (after, at) if after < cost else (cost, own)


def found_cost(block: ShootingProblem, costs: Floats) -> float:
    """Cost a sample of windows whose states have been found, from that of each window."""
    return float(np.quantile(costs / np.diff(block.data.starts), FOUND_QUANTILE))


def reinitialised(block: ShootingProblem, shared: Floats, own: Floats, most: float = math.inf) -> Floats:
    """Own unknowns from first guesses and the pressure as stated, where that comes to a lower cost.

    As they are where from first guesses windows whose states have been found cost ``most`` a sample or more.
    """
    free = replace(block, slack=RELAXED)
    kept = block.state_count(own)
    guess = resized(first_states(block.data), block.windows, kept, MASSES, len(block.lines))
    begun = estimate_by_labels(free, shared, with_other_states_going_on(free, shared, guess))
    if found_cost(free, free.costs(shared, begun)[1]) >= most:
        return own
    begun = reinitialise_until_found(free, shared, begun)
    begun = estimate_states(block, shared, block.rollout(shared, begun) if block.slack <= TIGHT else begun)
    return begun if block.cost(shared, begun) < block.cost(shared, own) else own


def find_states(block: ShootingProblem, shared: Floats, guess: Floats) -> Floats:
    """Own unknowns from a first guess: the states by the labels, until no window stands out, then all of them.

    Windows in which the motion is still another one would have any pressure.
    """
    begun = with_other_states_going_on(block, shared, guess)
    return reinitialise_until_found(block, shared, estimate_by_labels(block, shared, begun))


def with_other_states_going_on(block: ShootingProblem, shared: Floats, guess: Floats) -> Floats:
    """A first guess with all states but the masses', of which it says nothing, as the model has them go on.

    A mount is pressed in within some periods, wherever it begins.
    """
    if block.state_count(guess) == MASSES:
        return guess
    going_on, states = block.states_of(block.rollout(shared, guess)), block.states_of(guess).copy()
    states[:, MASSES:] = going_on[:, MASSES:]
    begun = np.append(states.ravel(), guess[states.size :])
    # where the first guess is far off the motion may run away
    return begun if math.isfinite(block.cost(shared, begun)) else guess


def estimate_by_labels(block: ShootingProblem, shared: Floats, guess: Floats) -> Floats:
    """Own unknowns from a first guess, with what is doubtful about the labels as good as held."""
    return estimate_states(replace(block, label_precision=LABELLED), shared, guess)


def reinitialise_until_found(block: ShootingProblem, shared: Floats, own: Floats) -> Floats:
    """Own unknowns from such, windows reinitialised until none stands out."""
    labelled, before = replace(block, label_precision=LABELLED), math.inf
    cost, costs = labelled.costs(shared, own)
    while cost < PROGRESS * before:
        before, (cost, own) = cost, with_windows_reinitialised(labelled, shared, own, cost, costs)
        costs = labelled.costs(shared, own)[1]
    return estimate_states(block, shared, own)


def estimate_states(block: ShootingProblem, shared: Floats, own: Floats, steps: int = 15) -> Floats:
    """Own unknowns after Levenberg-Marquardt steps of their own."""
    cost = block.cost(shared, own)
    return fit_states(block, shared, own, cost, steps)[1] if math.isfinite(cost) else own


def fit_states(block: ShootingProblem, shared: Floats, own: Floats, cost: float, steps: int) -> tuple[float, Floats]:
    """The same from a known cost, with the cost after them."""
    damping, part = 1e-3, None
    samples = block.samples
    for _ in range(steps):
        part = block.quadratic(shared, own, fixed=True) if part is None else part
        move = -cho_solve(factor(part, damping), part.by_own, check_finite=False)
        if -0.5 * float(part.by_own @ move) < negligible_gain(cost, samples):
            break
        after, at = line_search(block, shared, own, move, cost)
        if after < cost:
            cost, own, damping, part = after, at, 0.1 * damping, None
        else:
            damping *= 30.0
    return cost, own


def negligible_gain(cost: float, samples: int) -> float:
    """Log-likelihood below which a gain is none, beside what a recording of so many samples has left."""
    return max(0.5, 1e-3 * (cost - 0.5 * samples))
