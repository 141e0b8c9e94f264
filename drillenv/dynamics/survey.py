"""The motions at many settings, rocks and starts at once: what maps and counts of coexisting motions are made from.

The work is cut into small chunks of (setting, start) pairs, each one call of a compiled kernel that holds no lock, and
handed to threads as they fall free. A setting costs no Python of its own.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import NamedTuple, cast

import numpy as np
from numba import njit

from drillenv.checks import InputError, count, shown
from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.dynamics.exact import STATE_SIZE, TURN, fresh_state
from drillenv.dynamics.flow import (
    AMPLITUDE,
    FREE,
    MODEL_SHAPE,
    OMEGA,
    STATIC,
    STIFFNESS,
    UNLOADING,
    K,
    make_model,
    set_drive,
)
from drillenv.dynamics.orbits import (
    ADVANCE,
    EXPONENT,
    M_CONTACTS,
    M_FORCE,
    M_IMPACTS,
    M_SPEED,
    MOTION_SIZE,
    PERIOD,
    SECTION,
    SECTION_REGIME,
    STABLE,
    find_motion,
    length_scale,
    put_on_section,
)
from drillenv.rig import AMPLITUDE_LIMITS, FREQUENCY_LIMITS, PRESSURE_LIMITS, Rig, Setting
from drillenv.rocks import Rock
from drillenv.rocks import rock as rock_meant

WAIT, PATIENCE = 64, 4000
"""Excitation periods that a start runs before the first look at it, and altogether before it counts as not periodic."""
LINGERING, MORE_PATIENCE = 0.02, 8
"""An exponent below so much an excitation period is weak for chaos: the rig may linger near an orbit that has just
become unstable, or close in on one slowly. It is then given so many times the patience."""
CHUNK = 16
"""Pairs of a setting and a start that a thread takes at a time."""
START_SIZE = 5
"""Numbers in [0, 1) that say where in the section box a start lies: y, v1, v2, w, and in contact or free."""

SURVEY = np.dtype(
    [
        ("period", "i4"),
        ("impacts", "f8"),
        ("contacts", "f8"),
        ("penetration_rate", "f8"),
        ("peak_force", "f8"),
        ("impact_speed", "f8"),
        ("exponent", "f8"),
        ("stable", "?"),
        ("regime", "i1"),
        ("point", "f8", (4,)),
        ("multipliers", "c16", (4,)),
    ]
)
"""One motion of a survey; its fields mean what they do in :class:`drillenv.dynamics.motion.Motion`."""


class Controls(NamedTuple):
    """Many settings as columns, which Eq. 3.5 and 3.6 take as they take a Setting."""

    frequency: np.ndarray
    amplitude: np.ndarray
    pressure: np.ndarray


@njit(**INLINE)
def place_start(model: np.ndarray, unit: np.ndarray, state: np.ndarray) -> None:
    """Set a state from numbers in [0, 1), spread over a box about twice as wide as the motions known.

    The spring is shortened by up to two length scales more or less than F_b asks for. The indenter is free, up to
    three length scales behind the rock, or presses on it with up to six drive forces; either way it moves at up to one
    and a half times the speed that the drive alone would give it, and the shaker at up to a fifth of it.
    """
    length = length_scale(model)
    speed = length * model[0, OMEGA]
    point = np.empty(4)
    point[0] = model[0, STATIC] / model[0, K] + 2.0 * length * (2.0 * unit[0] - 1.0)
    point[1] = 0.2 * speed * (2.0 * unit[1] - 1.0)
    point[2] = 1.5 * speed * (2.0 * unit[2] - 1.0)
    if unit[4] < 0.5:
        point[3] = -3.0 * length * (1.0 - unit[3])
        put_on_section(point, FREE, state)
    else:
        point[3] = 6.0 * model[0, AMPLITUDE] / model[UNLOADING, STIFFNESS] * (1.0 - unit[3])
        put_on_section(point, UNLOADING, state)


@njit(**KERNEL)
def settle_on(
    model: np.ndarray, state: np.ndarray, wait: int, patience: int, out: np.ndarray, tangent: np.ndarray
) -> None:
    """As ``find_motion``, with more patience where what was found is neither periodic nor clearly chaotic."""
    find_motion(model, state, wait, patience, out, tangent)
    if out[PERIOD] == 0.0 and out[EXPONENT] * TURN < LINGERING * model[0, OMEGA]:
        find_motion(model, state, wait, MORE_PATIENCE * patience, out, tangent)


@njit(**KERNEL)
def find_motions(
    plants: np.ndarray,
    which: np.ndarray,
    drives: np.ndarray,
    starts: np.ndarray,
    wait: int,
    patience: int,
    first: int,
    out: np.ndarray,
    tangents: np.ndarray,
) -> None:
    """The motions of pairs ``first`` to ``first + len(out)``, setting by setting and start by start.

    ``plants`` (r, *MODEL_SHAPE) hold the rocks, ``which`` (n,) says which one a setting drills, ``drives`` (n, 3) are
    omega, F_a and F_b; ``starts`` (m, START_SIZE), of which a row below zero stands for the fresh start.
    """
    model, state = np.empty(MODEL_SHAPE), np.empty(STATE_SIZE)
    m = starts.shape[0]
    for i in range(out.shape[0]):
        place, start = divmod(first + i, m)
        model[:] = plants[which[place]]
        set_drive(drives[place, 0], drives[place, 1], drives[place, 2], model)
        if starts[start, 0] < 0.0:
            fresh_state(model, 0.0, state)
        else:
            place_start(model, starts[start], state)
        settle_on(model, state, wait, patience, out[i], tangents[i])


def random_starts(number: int, seed: int) -> np.ndarray:
    """(number, START_SIZE) starts: the fresh one first, then random ones over the section box, half in contact."""
    starts = np.random.default_rng(seed).random((number, START_SIZE))
    starts[0] = -1.0
    return starts


def survey(
    settings: np.ndarray | Sequence[Sequence[float]],
    rocks: int | str | Rock | Sequence[int | str | Rock] = 4,
    rig: Rig | None = None,
    starts: str | int = "fresh",
    *,
    seed: int = 0,
    wait: int = WAIT,
    patience: int = PATIENCE,
    threads: int | None = None,
    progress: Callable[[int], object] | None = None,
) -> np.ndarray:
    """The motions that the rig settles on at many settings, on all cores.

    Args:
        settings: (n, 3) frequencies in Hz, amplitudes in V and pressures in bar.
        rocks: One rock for all settings, or n of them.
        rig: The rig, by default that of Table 2.1.
        starts: "fresh", the rig at rest against untouched rock, or a number m from 1 to 10000: the fresh start and
            m - 1 random ones, at the same places of the box at each setting.
        seed: Of the random starts.
        wait, patience: Excitation periods to run before the first look for an orbit, and to give up after; eight
            times as many where the exponent is then too weak to tell.
        threads: Number of threads, by default as many as cores are allowed.
        progress: Called now and then with the number of motions found since the last call.

    Returns:
        Structured array (n,), or (n, m) for m starts, of dtype SURVEY.

    Raises:
        InputError: settings of another shape or outside the limits of Setting, an unknown rock, another number of rocks
            than of settings, a rig and rock that the exact engine cannot take, or bad counts.
    """
    controls = _controls(settings)
    rig = _rig(rig)
    plants, which = _plants(rocks, rig, controls.frequency.size)
    drives = _drives(rig, controls)
    many = not (isinstance(starts, str) and starts == "fresh")
    if isinstance(starts, str) and many:
        raise InputError(f"starts is {shown(starts)}: give 'fresh' or a number of starts from 1 to 10000")
    places = random_starts(count("starts", starts, 1, 10_000) if many else 1, count("seed", seed, 0, 2**63))
    wait = count("wait", wait, 1, 1_000_000)
    patience = count("patience", patience, 1, 100_000_000)
    workers = allowed_cores() if threads is None else count("threads", threads, 1, 1024)

    pairs = controls.frequency.size * len(places)
    out, tangents = np.empty((pairs, MOTION_SIZE)), np.empty((pairs, 4, 4))

    def chunk(first: int) -> int:
        last = min(first + CHUNK, pairs)
        find_motions(plants, which, drives, places, wait, patience, first, out[first:last], tangents[first:last])
        return last - first

    with ThreadPoolExecutor(workers) as pool:
        tasks = [pool.submit(chunk, first) for first in range(0, pairs, CHUNK)]
        for task in as_completed(tasks):
            done = task.result()
            if progress is not None:
                progress(done)
    result = as_survey(out, tangents, np.repeat(drives[:, 0], len(places)))
    return result.reshape(-1, len(places)) if many else result


def as_survey(out: np.ndarray, tangents: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """What ``find_motion`` wrote, (n, MOTION_SIZE) and (n, 4, 4) at excitations (n,) in rad/s, as a SURVEY array."""
    result = np.zeros(len(out), SURVEY)
    found = out[:, PERIOD] > 0
    duration = np.where(found, out[:, PERIOD], 1.0) * TURN / omega
    result["period"], result["stable"] = out[:, PERIOD], out[:, STABLE] == 1.0
    result["impacts"], result["contacts"] = out[:, M_IMPACTS], out[:, M_CONTACTS]
    result["penetration_rate"] = out[:, ADVANCE] / duration
    result["peak_force"], result["impact_speed"] = out[:, M_FORCE], out[:, M_SPEED]
    result["regime"], result["point"] = out[:, SECTION_REGIME], out[:, SECTION : SECTION + 4]
    result["multipliers"] = np.nan
    result["multipliers"][found] = multipliers_of(tangents[found])
    result["exponent"] = out[:, EXPONENT]
    with np.errstate(divide="ignore"):
        largest = np.log(np.abs(result["multipliers"][found, 0]))
    result["exponent"][found] = largest / duration[found]
    return result


def multipliers_of(tangents: np.ndarray) -> np.ndarray:
    """Eigenvalues of (..., 4, 4) monodromy matrices, the largest modulus first; of a pair, the one with +i first."""
    values = np.linalg.eigvals(tangents).astype(complex)
    order = np.lexsort((-np.imag(values), -np.round(np.abs(values), 12)), axis=-1)
    return np.take_along_axis(values, order, axis=-1)


def label(period: int, impacts: float, exponent: float) -> str:
    """P-n-I-m for an orbit of ``period`` n; without one "chaotic" for an exponent above zero, else "aperiodic"."""
    if period > 0:
        return f"P-{period}-I-{round(impacts)}"
    return "chaotic" if exponent > 0 else "aperiodic"


def labels(motions: np.ndarray) -> np.ndarray:
    """The labels of a survey, an array of text of the same shape."""
    flat = motions.reshape(-1)
    kinds = np.stack([flat["period"], np.round(flat["impacts"]), flat["exponent"] > 0], axis=1)
    kinds[flat["period"] > 0, 2] = 0
    kinds[flat["period"] == 0, 1] = 0
    distinct, inverse = np.unique(kinds, axis=0, return_inverse=True)
    names = np.array([label(int(n), m, chaotic) for n, m, chaotic in distinct])
    return names[inverse.reshape(-1)].reshape(motions.shape)


def _controls(settings: object) -> Controls:
    """Checked columns of settings."""
    try:
        table = np.array(settings, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"settings is {shown(settings)}: give an array (n, 3) of Hz, V and bar") from None
    if table.ndim != 2 or table.shape[1] != 3 or not len(table):
        raise InputError(f"settings has the shape {table.shape}: give an array (n, 3) of Hz, V and bar, n at least 1")
    limits = np.array([FREQUENCY_LIMITS, AMPLITUDE_LIMITS, PRESSURE_LIMITS])
    outside = np.flatnonzero(~((table >= limits[:, 0]) & (table <= limits[:, 1])).all(axis=1))
    if outside.size:
        try:
            Setting(*table[outside[0]].tolist())
        except InputError as error:
            raise InputError(f"settings, row {outside[0]}: {error}") from None
    return Controls(*np.ascontiguousarray(table.T))


def _rig(rig: Rig | None) -> Rig:
    if rig is None:
        return Rig()
    if not isinstance(rig, Rig):
        raise InputError(f"rig is {shown(rig)}: give a Rig, or None for that of Table 2.1")
    return rig


def _plants(rocks: int | str | Rock | Sequence[int | str | Rock], rig: Rig, n: int) -> tuple[np.ndarray, np.ndarray]:
    """One model for each distinct rock, and the one that each of the n settings drills."""
    one = isinstance(rocks, int | str | Rock | np.integer | float)
    meant = [rock_meant(cast("int | str | Rock", rocks))] if one else [rock_meant(r) for r in cast("Sequence", rocks)]
    if not one and len(meant) != n:
        raise InputError(f"{len(meant)} rocks for {n} settings: give one rock for all, or one for each")
    distinct = list({id(pair): pair for pair in meant}.values())
    index = {id(pair): i for i, pair in enumerate(distinct)}
    anywhere = Setting(100.0, 0.45, 1.0)
    plants = np.stack([make_model(rig, pair, anywhere) for pair in distinct])
    which = np.array([index[id(pair)] for pair in meant], dtype=np.int64)
    return plants, np.repeat(which, n) if one else which


def _drives(rig: Rig, controls: Controls) -> np.ndarray:
    """(n, 3) omega in rad/s, F_a and F_b in N."""
    columns = cast(Setting, controls)
    return np.stack(
        [2 * math.pi * controls.frequency, rig.drive_force(columns), rig.static_force(columns)], axis=1, dtype=float
    )


def allowed_cores() -> int:
    """The cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # absent on macOS
    return len(affinity(0)) if affinity else os.cpu_count() or 1
