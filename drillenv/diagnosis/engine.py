"""A model of the diagnosis as the hybrid engine takes it, and by what its motion is differentiated."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.diagnosis.equations import acts_at
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes, changes_of, table_of
from drillenv.diagnosis.terms import DRIVE_PHASE, SCALARS, Law, Model
from drillenv.dynamics.constitutive.places import (
    DAMPER,
    PLACES,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    shape_of,
)
from drillenv.dynamics.constitutive.tables import DEGREE, FIT, NODES, Table
from drillenv.dynamics.effects import REGISTRY
from drillenv.dynamics.forms import Form
from drillenv.dynamics.hybrid import model as hybrid
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.dynamics.hybrid.model import Placed, assemble, law_table
from drillenv.dynamics.hybrid.sensitivity import LAW, STATE, Columns
from drillenv.dynamics.hybrid.shooting import Shot

INWARD = 1e-6
"""Share of its half by which a piece's ends are drawn inward, where a law's change may jump."""
NEARER = 1e-4
"""Share of a step by which a law's change is taken: corners move with parameters, and by less than ``INWARD``."""
COUPLING = (SPRING, SPRING_FROM_REST, DAMPER)
"""Places of the laws by which coordinates of the coupling are counted: see :mod:`drillenv.diagnosis.coupling`."""


class Column(NamedTuple):
    """By what a motion is differentiated: see :mod:`drillenv.dynamics.hybrid.sensitivity`."""

    kind: int
    which: int = 0
    turn: float = 0.0
    place: int = -1
    change: Floats | None = None
    """(GRID,) of a free law's values, at a place."""
    law: int = -1
    pieces: Floats | None = None
    """By what the pieces of an equation's law change, of this number among the model's."""
    drawn: Floats | None = None
    """(GRID,) the same of one of the coupling, at a place: coordinates of spring and damper are forces."""


SensitivityColumn = tuple[Column, dict[int, float]]
"""A column of the integrator, and its share in the derivatives by parameters."""


class Varied(NamedTuple):
    """By what a motion is differentiated: own states at the windows' beginnings, and columns."""

    columns: Sequence[Column]
    by_own: Floats
    """(windows, kept, kept) derivatives of the states that windows begin with, by own unknowns."""
    by_column: Floats
    """(windows, columns, kept) the same by columns."""
    present: NDArray[np.int64]
    """The own states that the model has, of each window."""


class Raw(NamedTuple):
    """What the engine says of a recording."""

    signals: Floats
    """(2, fine samples) force in N and acceleration in m/s^2."""
    path: Floats
    """(OWN, steps) states along the motion; none where they are not asked for."""
    by_state: Floats
    """(states, 2, fine samples) by own unknowns of the same window: by states that the model has."""
    by_column: Floats
    """(columns, 2, fine samples)"""
    begin: Floats
    """(windows, OWN) states at the beginnings of windows."""
    ends: Floats
    """(windows, OWN) states at their ends."""
    ends_by_state: Floats
    """(windows, states, OWN)"""
    ends_by_column: Floats
    """(windows, columns, OWN)"""
    completed: bool
    """Whether the motion could be followed to the end."""
    per_impact: float = 0.0
    """m drilled, over the impacts that were made."""


def raw_of(shot: Shot, begin: Floats, states: int, completed: bool) -> Raw:
    """What the engine has written, of which the first columns are those by states, of windows that so began."""
    by, ends_by = shot.by_column, shot.ends_by_column
    ends = shot.ends, ends_by[:, :states], ends_by[:, states:]
    return Raw(shot.signals, shot.path, by[:states], by[states:], begin, *ends, completed)


@functools.lru_cache(maxsize=512)
def equation_tables(
    effect: str, form: Form, p: tuple[float, ...], stiffness: float
) -> tuple[tuple[int, int, Table], ...]:
    """(place, what it is over, table) of the laws of an equation.

    Raises:
        NotSmoothError: one of them is no curve with these parameters.
    """
    acting = sorted(acts_at(effect, form)[0])
    names = [PLACES[place].name for place in acting]
    return tuple(law_table(REGISTRY[effect], name, p, stiffness) for name in names if name in REGISTRY[effect].laws)


class EquationChange(NamedTuple):
    """What one of the tables of an equation changes by."""

    place: int
    pieces: Floats
    """(pieces, DEGREE + 1)"""
    drawn: Floats | None
    """(GRID,) the same as a curve on the place's axis, of a law of the coupling."""


def equation_change(law: Law, other: Law, stiffness: float, beside: float) -> list[EquationChange]:
    """By what each of the tables changes from an equation and a stiffness to others, which are next to these."""
    pairs = zip((*law.parameters, stiffness), (*other.parameters, beside), strict=True)
    *ahead, stiffer = (one + NEARER * (two - one) for one, two in pairs)
    found = []
    for place, _over, table in equation_tables(law.effect, law.form, law.parameters, stiffness):
        given = REGISTRY[law.effect].laws[PLACES[place].name]
        shape = shape_of(given).law
        middle, half = 0.5 * (table.knots[1:] + table.knots[:-1]), 0.5 * np.diff(table.knots)
        inside = (middle[:, None] + half[:, None] * np.clip(NODES, -1.0 + INWARD, 1.0 - INWARD)).ravel()
        of_coupling = place in COUPLING
        x = np.concatenate([inside, law.axes.points(place)]) if of_coupling else inside
        change = (shape(x, tuple(ahead), stiffer) - shape(x, law.parameters, stiffness)) / NEARER
        pieces = change[: inside.size].reshape(len(half), -1) @ FIT.T
        found.append(EquationChange(place, pieces, change[inside.size :] if of_coupling else None))
    return found


class Assembled(NamedTuple):
    """A model for the engine, and where the diagnosis' laws are in it."""

    model: hybrid.Model
    free: dict[int, int]
    """The law of the engine by the place of a free law."""
    stated: list[int]
    """The laws of the engine that the equations' are, in the order in which :func:`equation_tables` has them."""
    phase: float
    """rad, of the drive at the excitation's phase 0."""


def assembled(model: Model, axes: Axes, omega: float, wanted: Sequence[int] = ()) -> Assembled:
    """The model under an excitation of ``omega`` rad/s.

    Free laws at places that are ``wanted`` are in it even where they are nothing.
    """
    s = np.zeros(V.SIZE)
    s[: SCALARS - 1] = model.s[:-1]
    s[V.OMEGA], s[V.LONGEST] = omega, hybrid.LONGEST_SHARE * 2.0 * math.pi / omega
    _set_waves(s, model)
    laws = [
        Placed(place, int(place == UNLOADING), table_of(free, axes, place), 0)
        for place, free in enumerate(model.free)
        if place in wanted or free.any()
    ]
    count, k = len(laws), float(s[V.K])
    for law in model.laws:
        laws += [Placed(*each, 0) for each in equation_tables(law.effect, law.form, law.parameters, k)]
    places = [law.place for law in laws]
    s[V.PULLS] = RATE_FORCE in places or RATE_FACTOR in places or s[V.CONTACT_DAMPING] != 0.0
    s[V.BY_MOUNT : V.BY_MOUNT + len(hybrid.OWNERS)] = [
        0.0 if any(s[at] for at in scalars) else -1.0 for scalars in hybrid.OWNERS
    ]
    s[V.EFFECTS] = 1.0
    made = assemble(s, laws)
    # the engine has the shapes of the contact first
    at = np.argsort(np.argsort([place > UNLOADING for place in places], kind="stable"))
    free = {place: int(i) for place, i in zip(places[:count], at, strict=False)}
    return Assembled(made, free, [int(i) for i in at[count:]], float(model.s[DRIVE_PHASE]))


def _set_waves(s: Floats, model: Model) -> None:
    """What goes on at frequencies of its own: on shaker, indenter and the rock's stiffness."""
    size, phase = np.hypot(model.sine, model.cosine), np.arctan2(model.cosine, model.sine)
    s[V.SHAKER_VIBRATION], s[V.INDENTER_VIBRATION], s[V.ROTATION_SHARE] = size
    s[V.VIBRATION_RATE], s[V.VIBRATION_DETUNING] = model.turn[0], model.turn[1] - model.turn[0]
    s[V.VIBRATION_PHASE], s[V.VIBRATION_LEAD] = phase[0], phase[1] - phase[0]
    s[V.ROTATION_RATE], s[V.ROTATION_PHASE] = model.turn[2], phase[2] - 0.5 * math.pi


def columns_of(given: Sequence[Column], model: Model, axes: Axes, made: Assembled, states: int) -> Columns:
    """By so many own ``states`` at the beginning, then by what is given."""
    count = states + len(given)
    kind, which, first = np.zeros((3, count), dtype=np.int64)
    turn, pieces, rows = np.zeros(count), [np.zeros((0, DEGREE + 1))], 0
    kind[:states], of_free = STATE, free_changes(given, model, axes)
    for c, column in enumerate(given, states):
        kind[c], which[c], turn[c], first[c] = column.kind, column.which, column.turn, rows
        if column.kind != LAW:
            continue
        if column.change is not None:
            which[c], table = made.free[column.place], of_free[c - states]
        else:
            assert column.pieces is not None
            which[c], table = made.stated[column.law], column.pieces
        pieces.append(table)
        rows += len(table)
    return Columns(kind, which, first, turn, np.concatenate(pieces))


def free_changes(given: Sequence[Column], model: Model, axes: Axes) -> dict[int, Floats]:
    """(pieces, DEGREE + 1) by what a free law changes with a column, by the numbers of those that are of one."""
    found = {}
    for place in {each.place for each in given if each.change is not None}:
        at = [c for c, each in enumerate(given) if each.change is not None and each.place == place]
        changes = np.array([given[c].change for c in at])
        found |= dict(zip(at, changes_of(model.free[place], changes, axes, place), strict=True))
    return found
