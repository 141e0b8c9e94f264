"""Multiple shooting: the model on a recording, window by window, and how it answers to everything it depends on.

Each window runs the closed loop, rock, structure and drive, from a state of its own over one or two impacts, which is
as far as a chaotic motion can be followed. The states are unknowns of the fit; the shaker's part of them (the spring's
force and v1), which does not notice single impacts, must join from window to window. What a misfit and its derivatives
say about the constants and effects is kept as one quadratic for each recording, with the states eliminated, so that
refits, left-out recordings and thousands of bootstrap samples cost next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded

from drillenv.checks import InputError
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.plain import run_windows
from drillenv.dynamics.effects import REGISTRY, Channels, Chosen
from drillenv.dynamics.exact import STATE_SIZE
from drillenv.dynamics.exact import make_scratch as exact_scratch
from drillenv.dynamics.flow import FREE, make_model, set_drive
from drillenv.dynamics.general import DONE, FACE, FIRST, OWN, V1, V2, U, W, Y, integrate, make_scratch, model_for
from drillenv.dynamics.general_runs import MEASURED_COLUMNS
from drillenv.dynamics.sensors import in_order
from drillenv.rig import Rig
from drillenv.rocks import Rock

RTOL, ROUGH_RTOL = 1e-8, 1e-7
"""Tolerance of the general engine on all samples, and where a few are enough: they move by less than a thousandth of
the noise."""
MOST_LEAD = 2.0
"""Recorded samples before the first one within which a fresh rig's start is looked for."""
FINE, ROUGH = 16, 4
"""Points a recorded sample at which a sensor that rings or lags is followed: on all samples, and for a first look."""
SLOPE_FINE = 4
"""Points a kept sample for the differences that slopes are made of. They are 3 % off on all samples and up to 13 % on
thinned ones, which costs a fit another round at most: what it comes to is where the exact residuals are left."""
AIR = "air-spring"
"""The effect by which a cylinder loses force."""
STATES, FACE_STATES, AIR_STATES = [0, 1, 2, 3], [4, 5], [6]
"""What a window's state may hold, in this order: the spring's force (taken for y since it hardly changes with the
stiffness), v1, v2 and w; the place and speed of a rock's face that moves on its mount; the force that a cylinder with
an air spring has lost."""
STATE_STEPS = np.array([0.05, 1e-5, 1e-5, 2e-8, 2e-8, 1e-5, 0.05])
"""By how much each (N, m/s, m/s, m, m, m/s, N) is moved to see how a window answers."""
JOIN = np.array([0.015, 2e-5, np.inf, np.inf, 1e-8, 1e-5, 0.015])
"""Standard deviations with which those join from window to window that single impacts hardly change: what a structure
might do beside the model without being noticed in one window."""
GUESS = np.array([500.0, 1e-1, 1e-1, 5e-4, 5e-4, 5e-1, 200.0])
"""Standard deviations of the first guess of a window's state, to keep directions that the data leave open in place."""

SETTLED = 0.1
"""Half a sum of squares for each window that a round must gain for another one to follow."""
IDLE = 0.03
"""The same that a window must have to gain to be moved at all."""
KEPT = 0.7
"""Share of the gain they promised from which slopes are used once more."""
SLOPES_COST = 0.8
"""Share of a round that goes into its slopes."""


class Physics(NamedTuple):
    """What drives the simulation of all recordings."""

    rig: Rig
    rock: Rock
    motion: tuple[Chosen, ...] = ()
    """Effects that act on the motion."""
    sensors: tuple[Chosen, ...] = ()
    """Effects that misreport channels."""
    begun: tuple[tuple[str, float], ...] = ()
    """(effect, its first extra state) as a recording of a running rig begins: impacts made on the face; force that the
    cylinder has lost, where the states do not say."""


class Prediction(NamedTuple):
    """What a model says of one recording."""

    force: np.ndarray
    acceleration: np.ndarray
    """(n,) in N, m/s^2; samples outside the windows are left out of everything."""
    ends: np.ndarray
    """(windows, 4 to 7) the state in which each window ends."""


def state_size(mechanisms: Iterable[str]) -> int:
    """Columns of the states of windows, where a rig has these effects."""
    names = set(mechanisms)
    faces = any(REGISTRY[name].moves_face for name in names)
    return len(STATES) + len(FACE_STATES) * faces + len(AIR_STATES) * (AIR in names)


def held_in(size: int) -> np.ndarray:
    """What each of so many columns of states is, as a place in STATE_STEPS, JOIN and GUESS."""
    beside = size - len(STATES)
    # a face takes two columns, and an air spring one
    return np.array(STATES + FACE_STATES * (beside >= 2) + AIR_STATES * (beside % 2))


def sized(data: Conditioned, states: np.ndarray, size: int) -> np.ndarray:
    """(windows, size) the same states.

    A face of which nothing is known is at rest, and a cylinder has lost what the recording says on average.
    """
    whole = np.zeros((len(states), STATE_STEPS.size))
    whole[:, AIR_STATES] = data.lost
    whole[:, held_in(states.shape[1])] = states
    return whole[:, held_in(size)]


def joints(states: np.ndarray) -> np.ndarray:
    """Which columns of states (windows, size) join from window to window."""
    return np.flatnonzero(np.isfinite(JOIN[held_in(states.shape[1])]))


def first_joint(data: Conditioned) -> int:
    """The first window whose end is held against the beginning of the next one.

    That of a running rig is not judged: any end that suits the next window would be as good.
    """
    return 0 if data.fresh else 1


def judged_part(data: Conditioned, window: int) -> slice:
    """The samples of a window that are held against the model: none, of the first one of a running rig."""
    first = max(int(data.starts[window]), data.judged.start)
    return slice(first, max(first, min(int(data.starts[window + 1]), data.judged.stop)))


def first_guess(data: Conditioned, states: np.ndarray) -> np.ndarray:
    """(windows, size) what the measurements alone say of the states."""
    return sized(data, data.states, states.shape[1])


def split_effects(effects: Sequence[Chosen]) -> tuple[tuple[Chosen, ...], tuple[Chosen, ...]]:
    """Effects on the motion and effects on the sensors."""
    motion = tuple(each for each in effects if each.effect.measure is None)
    return motion, tuple(each for each in effects if each.effect.measure is not None)


class Motion(NamedTuple):
    """The true channels of one recording before any sensor, on ``fine`` points a sample."""

    fine: int
    force: np.ndarray
    acceleration: np.ndarray
    ends: np.ndarray
    """(windows, 4 to 7) the state in which each window ends."""
    extras: np.ndarray
    """(windows, own) extra states of the effects at the beginning of each window."""


def predict(
    data: Conditioned, states: np.ndarray, physics: Physics, rtol: float | None = None, fine: int | None = None
) -> Prediction:
    """The model over all windows of a recording, each from its own state (windows, 4 to 7).

    What effects remember beyond that goes on from window to window; at the beginning a rig that was running has long
    met its rock. ``rtol`` is RTOL or, on thinned samples, ROUGH_RTOL where it is left out, ``fine`` the sensors'
    :func:`fineness`.

    Raises:
        InputError: the motion could not be followed.
    """
    return sensed(data, move(data, states, physics, fine or fineness(data, physics.sensors), rtol), physics)


def fineness(data: Conditioned, sensors: Sequence[Chosen]) -> int:
    """Points a sample on which these sensors have to be followed: one that rings or lags, between the samples."""
    if not any(_between_samples(each) for each in sensors):
        return 1
    return FINE if data.thin == 1 else data.thin * ROUGH


def slope_fineness(data: Conditioned, sensors: Sequence[Chosen]) -> int:
    """Points a sample for differences between predictions."""
    return min(SLOPE_FINE, fineness(data, sensors))


def _between_samples(chosen: Chosen) -> bool:
    # a lag of the excitation alone is one of the phase
    return chosen.effect.needs_fine and (chosen.effect.name != "channel-delay" or any(chosen.values[1:]))


def move(
    data: Conditioned,
    states: np.ndarray,
    physics: Physics,
    fine: int,
    rtol: float | None = None,
    extras: np.ndarray | None = None,
    only: np.ndarray | None = None,
) -> Motion:
    """The motion that :func:`predict` hands to the sensors.

    ``extras`` gives each window its own extra states to begin with, instead of those that the one before ended with.
    ``only`` (windows,) says which windows are asked for, where they have nothing to do with each other; what is said of
    the others means nothing.

    Raises:
        InputError: the motion could not be followed.
    """
    states = states.copy()
    k, k3 = physics.rig.stiffness, _hardening(physics)
    if data.fresh:
        states[0, 1:] = 0.0
        # whether a spring that hardens rests where its force or where its linear part carries the cylinder's is open
        if not k3:
            states[0, 0] = physics.rig.static_force(data.setting)
    states[:, 0] = shortening(states[:, 0], k, k3)
    states[:, 3] = np.minimum(states[:, 3], 0.0)
    begun = np.zeros((len(states), 0))
    if physics.motion:
        rtol = rtol or (RTOL if data.thin == 1 else ROUGH_RTOL)
        force, acceleration, ends, begun = _with_effects(data, states, physics, fine, rtol, extras, only)
    else:
        force, acceleration, ends = _plain(data, states, physics, fine)
    ends[:, 0] = k * ends[:, 0] + k3 * ends[:, 0] ** 3
    return Motion(fine, force, acceleration, ends, begun)


def _hardening(physics: Physics) -> float:
    return sum(chosen.values[0] for chosen in physics.motion if chosen.effect.name == "stiffness-hardening")


def shortening(force: np.ndarray, k: float, k3: float) -> np.ndarray:
    """Shortening in m of a spring k y + k3 y^3 that carries ``force`` in N: the one real root."""
    if not k3:
        return force / k
    reach = math.sqrt(k / (3.0 * k3))
    return 2.0 * reach * np.sinh(np.arcsinh(1.5 * force / (k * reach)) / 3.0)


def drive_phase(data: Conditioned, physics: Physics) -> float:
    """Phase of the drive at the first sample in rad: that of the excitation channel, less what this one lags."""
    late = [chosen.values[0] for chosen in physics.sensors if chosen.effect.name == "channel-delay"]
    return data.phase + data.omega * sum(late)


def _lead(data: Conditioned, physics: Physics) -> float:
    """Seconds before the first sample at which a fresh rig was started.

    The excitation begins with a zero, which lies up to two samples before the first one that was kept.
    """
    lead = drive_phase(data, physics) / data.omega
    return lead if data.fresh and 0.0 < lead * data.rate * data.thin < MOST_LEAD else 0.0


def _with_effects(data: Conditioned, states: np.ndarray, physics: Physics, fine: int, rtol: float, extras, only):
    """Force, acceleration, ends and extra states at the beginnings by the general engine."""
    setting, rate = data.setting, data.rate * fine
    model, order = model_for(physics.rig, setting, physics.rock, physics.motion)
    # nobody asks here how high the force of an impact was
    model = model._replace(omega=data.omega, rated=False)
    z = np.zeros(model.tally + 4 + len(physics.motion))
    if not data.fresh:
        z[OWN : model.tally] = extra_start(physics.motion, dict(physics.begun), setting.frequency)
    # what has no place in the states goes on from window to window
    faces = [U, *(row[FIRST] for row in model.effects if row[FACE])]
    airs = [row[FIRST] for row, i in zip(model.effects, order, strict=True) if physics.motion[i].effect.name == AIR]
    places = {**dict(zip(FACE_STATES, faces, strict=False)), **dict(zip(AIR_STATES, airs, strict=False))}
    columns = np.array(
        [(Y, V1, V2, W)[i] if i in STATES else places[i] for i in held_in(states.shape[1])], dtype=np.int64
    )
    scratch = make_scratch(z.size, len(physics.motion))
    force, acceleration = np.zeros(data.force.size * fine), np.zeros(data.force.size * fine)
    ends = np.zeros(states.shape)
    begun = np.zeros((len(states), model.tally - OWN))
    starts, phase, lead = data.starts * fine, drive_phase(data, physics), _lead(data, physics)
    nothing = np.zeros((0, MEASURED_COLUMNS))
    for k, (first, after) in enumerate(zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)):
        if only is not None and not only[k]:
            continue
        if extras is not None:
            z[OWN : model.tally] = extras[k]
        z[columns] = states[k]
        begun[k] = z[OWN : model.tally]
        samples = np.zeros((after - first, MEASURED_COLUMNS))
        theta, regime = math.fmod(phase + data.omega * first / rate, 2 * math.pi), FREE
        if k == 0 and lead > 0.0:
            early = theta - data.omega * lead
            _status, _reached, regime, *_rest = integrate(model, early, z, regime, lead, rate, nothing, rtol, scratch)
        status, *_rest = integrate(model, theta, z, regime, (after - first) / rate, rate, samples, rtol, scratch)
        if status != DONE:
            raise _lost(data, first / rate)
        acceleration[first:after], force[first:after] = samples.T
        ends[k] = z[columns]
    finite = np.isfinite(ends).all(axis=1)
    if not finite.all():
        raise _lost(data, starts[np.argmin(finite)] / rate)
    return force, acceleration, ends, begun


def _lost(data: Conditioned, time: float) -> InputError:
    return InputError(f"{data.name}: the motion could not be followed from {time:.4f} s")


def _plain(data: Conditioned, states: np.ndarray, physics: Physics, fine: int):
    """Force, acceleration and ends of the paper's model, by the exact engine."""
    model = make_model(physics.rig, physics.rock, data.setting)
    set_drive(data.omega, physics.rig.drive_force(data.setting), physics.rig.static_force(data.setting), model)
    force, acceleration = np.zeros(data.force.size * fine), np.zeros(data.force.size * fine)
    ends = np.empty((len(states), 4))
    room, scratch = np.zeros((2, STATE_SIZE)), exact_scratch()
    phase, lead, rate = drive_phase(data, physics), _lead(data, physics), data.rate * fine
    run_windows(model, states, data.starts * fine, phase, lead, rate, room, scratch, force, acceleration, ends)
    return force, acceleration, ends


def sensed(data: Conditioned, motion: Motion, physics: Physics) -> Prediction:
    """What the sensors make of a motion, at the samples of the recording.

    Not of the excitation, which the model is driven with.
    """
    fine, force, acceleration = motion.fine, motion.force, motion.acceleration
    if physics.sensors:
        rate = data.rate * fine
        # nothing is known before the first window; a fresh rig began a moment before its first sample
        first, early = int(data.starts[0]) * fine, round(_lead(data, physics) * rate)
        push, shake = (np.concatenate([np.full(early, x[first]), x[first:]]) for x in (force, acceleration))
        true = Channels(rate, -early / rate, np.zeros_like(push), push, shake, data.fresh)
        read = true
        for chosen in in_order(physics.sensors):
            assert chosen.effect.measure is not None
            read = chosen.effect.measure(true, read, chosen.values)
        force, acceleration = (np.concatenate([np.zeros(first), x[early:]]) for x in (read.force, read.acceleration))
    keep = slice(None, None, fine)
    return Prediction(force[keep], acceleration[keep], motion.ends)


def extra_start(effects: Sequence[Chosen], begun: Mapping[str, float], impacts: float) -> list[float]:
    """Extra states as a recording of a running rig begins, in the order in which the engine holds them.

    The first of an effect is what ``begun`` says of it. Counts that nobody gave are ``impacts``, those of a second; all
    others are 0.
    """
    made = []
    for each in sorted(effects, key=lambda each: each.effect.comes_last):
        for i, extra in enumerate(each.effect.extras):
            usual = impacts if extra.symbol.startswith("N") else 0.0
            made.append(begun.get(each.effect.name, usual) if i == 0 else usual)
    return made


@dataclass(frozen=True, slots=True, eq=False)
class Quadratic:
    """Half the sum of squares of one recording over the parameters, about where it was taken: c - g.x + x.H.x / 2."""

    value: float
    gradient: np.ndarray
    """(p,)."""
    curvature: np.ndarray
    """(p, p)."""
    samples: int
    moves: np.ndarray
    """(windows * size,) the step of the states at x = 0."""
    answers: np.ndarray
    """(windows * size, p) how the best states move with the parameters."""


def residual(data: Conditioned, made: Prediction) -> np.ndarray:
    """(2, n) measured less predicted force and acceleration, over their noise; 0 where nothing is judged."""
    inside = np.zeros(data.force.size, dtype=bool)
    inside[data.judged] = True
    return np.stack(
        [
            np.where(inside, data.force - made.force, 0.0) / data.noise_force,
            np.where(inside, data.acceleration - made.acceleration, 0.0) / data.noise_acceleration,
        ]
    )


class Slopes(NamedTuple):
    """How each window answers to the state it begins with."""

    channels: np.ndarray
    """(size, 2, n) change of the scaled channels inside the window."""
    ends: np.ndarray
    """(size, windows, size) change of its end."""
    after: np.ndarray | None
    """(size, 2, n) change of the scaled channels inside the window that follows; None where no sensor remembers."""


def state_slopes(
    data: Conditioned, states: np.ndarray, physics: Physics, base: Prediction, only: np.ndarray | None = None
) -> Slopes:
    """The answers of a recording to the states of its windows, about which the model says ``base``.

    ``only`` is as in :func:`move`; those of other windows mean nothing.
    """
    fine = slope_fineness(data, physics.sensors)
    size, steps = states.shape[1], STATE_STEPS[held_in(states.shape[1])]
    channels, ends = np.empty((size, 2, data.force.size)), np.empty((size, *states.shape))
    after = np.zeros_like(channels) if fine > 1 else None
    remembers = _remembers(physics, states)
    still = move(data, states, physics, fine) if fine > 1 or remembers else None
    if still is not None:
        base = sensed(data, still, physics)
    # what an effect remembers would carry the steps of all windows into those after them
    extras = still.extras if still is not None and remembers else None
    inside = np.zeros(data.force.size, dtype=np.int64)
    for k, first in enumerate(data.starts[:-1].tolist()):
        inside[first:] = k % 2
    turns = np.arange(len(states)) % 2
    for j in range(size):
        moved = states.copy()
        # away from the rock, so that a window never begins inside it
        step = -steps[j] if j == 3 else steps[j]
        moved[:, j] += step
        motion = move(data, moved, physics, fine, extras=extras, only=only)
        ends[j] = (motion.ends - base.ends) / step
        if still is None or after is None:
            channels[j] = channel_change(data, sensed(data, motion, physics), base, step)
            continue
        # a sensor that remembers carries a window over into the next: every other one is moved at a time
        for turn in range(2):
            mixed = _mixed(data, (turns == turn) if only is None else (turns == turn) & only, motion, still)
            change = channel_change(data, sensed(data, mixed, physics), base, step)
            own = inside == turn
            channels[j][:, own], after[j][:, ~own] = change[:, own], change[:, ~own]
    if after is not None:
        # nothing comes before the first window
        after[:, :, : int(data.starts[1])] = 0.0
    return Slopes(channels, ends, after)


def _remembers(physics: Physics, states: np.ndarray) -> bool:
    """Whether anything goes on from window to window that the states do not hold.

    Which way a mass slides is no such thing: its speed says it.
    """
    inside, effects = set(held_in(states.shape[1])), [each.effect for each in physics.motion]
    unknown = [each for each in effects if each.extras and each.grips is None]
    if inside.issuperset(FACE_STATES):
        unknown = [each for each in unknown if not each.moves_face]
    return any(each.name != AIR or not inside.issuperset(AIR_STATES) for each in unknown)


def channel_change(data: Conditioned, moved: Prediction, base: Prediction, step: float) -> np.ndarray:
    """(2, n) change of the scaled channels per ``step``."""
    return np.stack(
        [
            (moved.force - base.force) / (step * data.noise_force),
            (moved.acceleration - base.acceleration) / (step * data.noise_acceleration),
        ]
    )


def quadratic(
    data: Conditioned,
    states: np.ndarray,
    base: Prediction,
    slopes: Slopes,
    columns: np.ndarray,
    ends: np.ndarray,
    join: np.ndarray = JOIN,
) -> Quadratic:
    """Eliminate the states of the windows.

    Args:
        data, states, base: The recording, its states (windows, size) and what the model says.
        slopes: From :func:`state_slopes`.
        columns: (p, 2, n) how the scaled channels answer to the parameters.
        ends: (p, windows, size) how the windows' ends answer to them.
        join: (7,) standard deviations of the joints.
    """
    left = residual(data, base)
    channels, answers, after = slopes
    (windows, own_size), p = states.shape, len(columns)
    size, width, goes_on = own_size * windows, GUESS[held_in(own_size)], joints(states)
    join, reach, guess = join[held_in(own_size)][goes_on], 2 * own_size - 1, first_guess(data, states)
    a = np.zeros((size, size))
    b = np.zeros((size, p))
    g = np.zeros(size)
    for k in range(windows):
        piece = judged_part(data, k)
        own = channels[:, :, piece].reshape(own_size, -1)
        at = slice(own_size * k, own_size * (k + 1))
        a[at, at] += own @ own.T
        g[at] += own @ left[:, piece].reshape(-1)
        if p:
            b[at] += own @ columns[:, :, piece].reshape(p, -1).T
        if after is not None and k:
            late, before = after[:, :, piece].reshape(own_size, -1), slice(own_size * (k - 1), own_size * k)
            a[before, before] += late @ late.T
            a[before, at] += late @ own.T
            a[at, before] += own @ late.T
            g[before] += late @ left[:, piece].reshape(-1)
            if p:
                b[before] += late @ columns[:, :, piece].reshape(p, -1).T
        a[at, at] += np.diag(width**-2.0)
        g[at] += (guess[k] - states[k]) * width**-2.0
    inside = left[:, data.judged].reshape(-1)
    flat = columns[:, :, data.judged].reshape(p, inside.size)
    gradient, curvature = flat @ inside, flat @ flat.T
    value = 0.5 * float(inside @ inside)
    for k in range(first_joint(data), windows - 1):
        # end of window k less beginning of window k + 1, over the width of the joint
        gap = (base.ends[k, goes_on] - states[k + 1, goes_on]) / join
        here = answers[:, k, goes_on].T / join[:, None]
        there = -np.eye(own_size)[goes_on] / join[:, None]
        row = np.concatenate([here, there], axis=1)
        at = slice(own_size * k, own_size * (k + 2))
        a[at, at] += row.T @ row
        g[at] -= row.T @ gap
        value += 0.5 * float(gap @ gap)
        if p:
            change = ends[:, k, goes_on].T / join[:, None]
            b[at] += row.T @ change
            gradient -= change.T @ gap
            curvature += change.T @ change
    value += 0.5 * float((((guess - states) / width) ** 2).sum())
    scale = 1.0 / np.sqrt(np.diag(a))
    # a window meets the one before it and the one behind it, so the matrix is a band
    band = np.zeros((2 * reach + 1, size))
    scaled = a * scale[:, None] * scale[None, :]
    for off in range(-min(reach, size - 1), min(reach, size - 1) + 1):
        band[reach - off, max(off, 0) : size + min(off, 0)] = np.diag(scaled, off)
    solved = solve_banded((reach, reach), band, np.column_stack([g, b]) * scale[:, None], check_finite=False)
    solved *= scale[:, None]
    moves, answer = solved[:, 0], solved[:, 1:]
    return Quadratic(
        value - 0.5 * float(g @ moves),
        gradient - b.T @ moves,
        curvature - b.T @ answer,
        2 * (data.judged.stop - data.judged.start),
        moves,
        answer,
    )


def window_costs(data: Conditioned, states: np.ndarray, made: Prediction) -> np.ndarray:
    """(windows,) half the sum of squares of each window, with the first guess as a weak prior, without joints."""
    squares = (residual(data, made) ** 2).sum(axis=0)
    sums = np.add.reduceat(squares, data.starts[:-1])
    # the last window ends before the recording does; what follows is 0
    return 0.5 * (sums + (((first_guess(data, states) - states) / GUESS[held_in(states.shape[1])]) ** 2).sum(axis=1))


def settle_states(
    data: Conditioned,
    states: np.ndarray,
    physics: Physics,
    rounds: int,
    slopes: Slopes | None = None,
) -> tuple[np.ndarray, Prediction]:
    """Fit the state of each window on its own, by Levenberg and Marquardt, the model held.

    ``slopes`` are those of a place nearby, if they are known: they are used as long as they bring what they promise,
    and so are all others, since they cost four times as much as a step or more. Windows that have little to gain are
    left where they are, unless effects carry something over from window to window.
    """
    now, damping, width = states.copy(), np.full(len(states), 1e-2), GUESS[held_in(states.shape[1])]
    fine, remembers = fineness(data, physics.sensors), _remembers(physics, states)
    motion = move(data, now, physics, fine)
    made = sensed(data, motion, physics)
    costs, guess = window_costs(data, now, made), first_guess(data, now)
    channels = np.empty((width.size, 2, data.force.size)) if slopes is None else slopes.channels.copy()
    left_over, little, anew = float(rounds), SETTLED * len(now), slopes is None
    everywhere = np.ones(len(now), dtype=bool)
    # which windows have slopes of another place, and what each may still gain, as its own slopes have said
    stale, open_gain = everywhere.copy(), np.full(len(now), np.inf)
    while left_over > 0.0:
        left_over -= 1.0 if anew else 1.0 - SLOPES_COST
        at_work = everywhere if remembers else open_gain > IDLE
        wanted = at_work & stale
        if anew and wanted.any():
            found = state_slopes(data, now, physics, made, None if remembers else wanted).channels
            own = _inside(data, wanted)
            channels[:, :, own] = found[:, :, own]
            stale &= ~wanted
        left, trial, hoped = residual(data, made), now.copy(), np.zeros(len(now))
        for k in np.flatnonzero(at_work).tolist():
            piece = judged_part(data, k)
            own = channels[:, :, piece].reshape(width.size, -1)
            a = own @ own.T + np.diag(width**-2.0)
            g = own @ left[:, piece].reshape(-1) + (guess[k] - now[k]) * width**-2.0
            step = np.linalg.solve(a + damping[k] * np.diag(np.diag(a)), g)
            trial[k] += step
            hoped[k] = g @ step - 0.5 * step @ a @ step
        trial[:, 3] = np.minimum(trial[:, 3], 0.0)
        going = at_work if remembers else hoped > IDLE
        tried = _mixed(data, going, move(data, trial, physics, fine, only=None if remembers else going), motion)
        trial_costs = window_costs(data, trial, sensed(data, tried, physics))
        better = going & (trial_costs < costs)
        gains = np.where(better, costs - trial_costs, 0.0)
        gained, promised = float(gains.sum()), float(hoped[going].sum())
        now[better] = trial[better]
        damping = np.where(better, damping / 5.0, np.where(going, damping * 8.0, damping))
        # a step that brought much has changed the slopes, even where it brought what they promised
        open_gain = np.where(at_work & ~stale, np.abs(hoped - gains) + 0.1 * gains, open_gain)
        if fine > 1:
            # a sensor that remembers reads something else in the window behind one that has moved
            open_gain[1:][better[:-1]] = np.inf
        stale |= everywhere if remembers else better
        motion = move(data, now, physics, fine) if remembers else _mixed(data, better, tried, motion)
        made = sensed(data, motion, physics)
        costs = window_costs(data, now, made)
        if gained < little and (anew or promised < little):
            break
        anew = gained < KEPT * promised
    return now, made


def _inside(data: Conditioned, windows: np.ndarray, fine: int = 1) -> np.ndarray:
    """(n * fine,) whether a point lies in one of these windows."""
    mask = np.zeros(data.force.size * fine, dtype=bool)
    mask[data.starts[0] * fine : data.starts[-1] * fine] = np.repeat(windows, np.diff(data.starts) * fine)
    return mask


def _mixed(data: Conditioned, where: np.ndarray, one: Motion, other: Motion) -> Motion:
    """One motion in some windows, another in the others; no window begins with extra states of the one before."""
    mask = _inside(data, where, one.fine)
    return Motion(
        one.fine,
        np.where(mask, one.force, other.force),
        np.where(mask, one.acceleration, other.acceleration),
        np.where(where[:, None], one.ends, other.ends),
        one.extras,
    )


def with_constants(physics: Physics, names: Sequence[str], values: Sequence[float]) -> Physics:
    """The physics with some constants of the rig and the rock replaced."""
    given = dict(zip(names, (float(value) for value in values), strict=True))
    loading = given.pop("loading_stiffness", physics.rock.loading_stiffness)
    unloading = given.pop("unloading_stiffness", physics.rock.unloading_stiffness)
    # a fit may come from the other side, where the rock would give energy away
    rock = Rock(loading, max(loading, unloading))
    return physics._replace(rig=replace(physics.rig, **given), rock=rock)
