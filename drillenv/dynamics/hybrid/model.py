"""From a rig, a rock, a setting and effects to the model that the kernels move, and states to begin with."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.checks import InputError, number
from drillenv.dynamics.constitutive import places
from drillenv.dynamics.constitutive.places import CODE, OVER, PLACES, SCALARS, Shape, shape_of
from drillenv.dynamics.constitutive.tables import NotSmoothError, Table, tabulate, toward_zero
from drillenv.dynamics.effects import Chosen, Effect
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.dynamics.hybrid.outside_terms import address_of
from drillenv.dynamics.hybrid.vector_field import BY_EFFECTS, OWN, Model
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

OWNERS = (
    (V.MOUNT_SQUARE,),
    (V.AIR_STIFFNESS, V.AIR_PER_LENGTH, V.AIR_RATE),
    (V.DRIVE_LAG,),
    (V.SHAKER_VIBRATION, V.INDENTER_VIBRATION),
    (V.SLEW_RATE,),
    (V.GRIP1,),
    (V.GRIP2,),
    (V.BRISTLES1,),
    (V.BRISTLES2,),
    (V.CONTACT_DAMPING,),
)
"""Scalars of the model of which an effect is the owner where it sets one, in the order from BY_MOUNT on."""
LONGEST_SHARE = 0.1
"""Longest step over the excitation's period."""
MEMORY = {
    "q": (0, V.Q),
    "u'": (0, V.UD),
    "bent1": (0, V.BENT1),
    "bent2": (0, V.BENT2),
    "b": (0, V.BED),
    "b'": (0, V.BED_SPEED),
    "slide1": (1, V.SLIDE1),
    "slide2": (1, V.SLIDE2),
    "N": (1, V.COUNT),
    "N_contact": (1, V.COUNT_CONTACT),
    "drilled": (1, V.DRILLED),
    "drilled_contact": (1, V.DRILLED_CONTACT),
    "rotation": (1, V.ROTATION),
    "rotation_contact": (1, V.ROTATION_CONTACT),
    "vibration": (1, V.VIBRATION),
    "driven": (1, V.DRIVEN),
}
"""Where the engine keeps an extra state of an effect, by its ``kept``: 0 in the state, 1 in the discrete state."""


class Motion(NamedTuple):
    """A state of a rig. Copied, it goes on bit for bit."""

    d: np.ndarray
    """(CORNERS + LAW_MEMORY laws,) the discrete state."""
    z: np.ndarray
    """(tally + energies,) the state, see :mod:`drillenv.dynamics.hybrid.vector_field`."""

    def copy(self) -> Motion:
        """The same state, on its own."""
        return Motion(self.d.copy(), self.z.copy())


@functools.lru_cache(maxsize=256)
def tables_of(chosen: Chosen, stiffness: float) -> tuple[tuple[int, int, Table], ...]:
    """(place, what it is over, table) of each law of an effect that changes anything; ``stiffness`` of the coupling.

    Raises:
        InputError: a law that cannot be tabulated.
    """
    if chosen.is_neutral:
        return ()
    axes = chosen.effect.axes
    if axes is not None:
        assert chosen.curve is not None
        table = axes.table(chosen.curve)
        if axes.place == places.RATE_FACTOR and table.knots.size and float(np.min(table(table.knots))) < -1.0:
            # a rock that does not pull
            table = tabulate(lambda x: np.maximum(table(x), -1.0), table.knots[0], table.knots[-1], table.knots[1:-1])
        return ((axes.place, OVER.index(axes.over), table),)
    found = []
    for name, given in chosen.effect.laws.items():
        place = PLACES[CODE[name]]
        law, x = shape_of(given).law, np.linspace(place.low, place.high, 101)
        if np.array_equal(law(x, chosen.values, stiffness), x if isinstance(given, Shape) else np.zeros_like(x)):
            continue
        try:
            found.append(law_table(chosen.effect, name, chosen.values, stiffness))
        except NotSmoothError as error:
            raise InputError(f"the law of {chosen.effect.name} at {name} cannot be followed: {error}") from None
    return tuple(found)


def law_table(effect: Effect, name: str, values: tuple[float, ...], stiffness: float) -> tuple[int, int, Table]:
    """Place, what it is over, and table of the law of an effect at the place of this name.

    Raises:
        NotSmoothError: it cannot be tabulated.
    """
    given, place = effect.laws[name], PLACES[CODE[name]]
    shape = shape_of(given)

    def law(x: np.ndarray) -> np.ndarray:
        found = shape.law(x, values, stiffness)
        # a factor on the rock's force makes it no pull
        return np.maximum(found, -1.0) if CODE[name] == places.RATE_FACTOR else found

    knots = toward_zero(place.high) if isinstance(given, Shape) else []
    if CODE[name] == places.MOUNT_SPRING:
        # it gives by a hundredth of its range or less, where a cubic of the whole range has lost its digits
        near = toward_zero(place.high)[:4]
        knots = [*near, *(-each for each in near)]
    return CODE[name], OVER.index(shape.over), tabulate(law, place.low, place.high, knots)


def check_effects(effects: tuple[Chosen, ...]) -> None:
    """Raise InputError for an effect that does not act on the motion, or is given twice."""
    seen: set[str] = set()
    for chosen in effects:
        if not isinstance(chosen, Chosen):
            raise InputError(f"effects holds {chosen!r}: give effects from drillenv.dynamics.effects.make(name, ...)")
        name = chosen.effect.name
        if name in seen:
            raise InputError(f"effect {name} is given twice: give it once")
        if not chosen.effect.moves_rig:
            raise InputError(f"effect {name} does not act on the motion of the drilling rig: leave it out here")
        seen.add(name)


def model_for(rig: Rig, setting: Setting, rock: Rock, effects: tuple[Chosen, ...]) -> Model:
    """The model.

    Args:
        rig, setting, rock: As for :func:`drillenv.dynamics.hybrid.run.run_hybrid`.
        effects: In the order in which their energies are counted.

    Raises:
        InputError: an effect that does not act on the motion or is given twice, two that set one number of the model,
            or a law that cannot be followed.
    """
    check_effects(effects)
    s = np.zeros(V.SIZE)
    s[: V.OMEGA + 1] = (
        rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping, rig.drive_force(setting),
        rig.static_force(setting), rock.loading_stiffness, rock.unloading_stiffness, 2 * math.pi * setting.frequency,
    )  # fmt: skip
    s[V.LONGEST] = LONGEST_SHARE / setting.frequency
    _set_scalars(s, effects)
    terms, parameters, sizes = [], [0.0], []
    for index, chosen in enumerate(effects):
        effect = chosen.effect
        if effect.term is not None:
            terms.append((address_of(effect.term), OWN + len(sizes), len(parameters), index))
            parameters += chosen.values
            sizes += [extra.size for extra in effect.extras if not extra.kept]
    laws = [Placed(*law, index) for index, chosen in enumerate(effects) for law in tables_of(chosen, rig.stiffness)]
    if s[V.COMPACTION_LENGTH] > 0.0 and [law.place for law in laws].count(places.COMPACTION) > 1:
        raise InputError("a rock that compacts over the depth has another law over impacts beside: give one of them")
    if len(laws) > V.MOST_LAWS:
        raise InputError(f"the effects have {len(laws)} laws: give effects with {V.MOST_LAWS} at most")
    on_rock = any("contact" in c.effect.balances and c.effect.term is not None and not c.is_neutral for c in effects)
    at = [law.place for law in laws]
    on_rock = on_rock or s[V.CONTACT_DAMPING] != 0.0 or places.RATE_FORCE in at
    s[V.PULLS] = on_rock or at.count(places.RATE_FACTOR) > 1
    s[V.RATED] = on_rock or places.RATE_FACTOR in at
    s[V.EFFECTS] = len(effects)
    return assemble(s, laws, Terms(np.array(terms, dtype=float), np.array(parameters), sizes))


class Placed(NamedTuple):
    """A law at a place."""

    place: int
    over: int
    """Of a contact's shape what it is over: see ``places.OVER``."""
    table: Table
    effect: int
    """Whose energy is counted."""


class Terms(NamedTuple):
    """Compiled terms from outside."""

    rows: np.ndarray
    """(terms, TERM_COLUMNS)"""
    parameters: np.ndarray
    sizes: list[float]
    """Of their states."""


NO_TERMS = Terms(np.zeros((0, V.TERM_COLUMNS)), np.zeros(1), [])


def assemble(s: np.ndarray, laws: Sequence[Placed], terms: Terms = NO_TERMS) -> Model:
    """The model of these scalars (SIZE,), which are completed by how many of each there are, and laws.

    The scalars from M1 to the last that effects set, LONGEST, the owners from BY_MOUNT on, EFFECTS, PULLS and RATED
    have to be there.
    """
    # the shapes of the contact stand first, in the order given
    laws = sorted(laws, key=lambda each: each.place > places.UNLOADING)
    table, pieces, corners = _flat_laws(laws)
    force = s[V.F_A] + s[V.F_B]
    depth = force / s[V.KL]
    speed = depth * math.sqrt(s[V.KL] / s[V.M2])
    # the shaker body moves as much less as it is heavier
    slow = speed * s[V.M2] / s[V.M1]
    lost = 0.01 * force
    sizes = [force / s[V.K], slow, speed, depth, depth, speed, lost, lost, lost, depth, speed, *terms.sizes]
    s[V.LAWS], s[V.TERMS], s[V.TALLY] = len(laws), len(terms.rows), len(sizes)
    # a mount, the air, bristles and a bed stand behind the rig's own states: without them those do not move
    moving = V.BENT1 if s[V.MOUNT_SQUARE] or s[V.AIR_RATE] else V.U
    moving = V.BED if s[V.BRISTLES1] or s[V.BRISTLES2] else moving
    moving = V.OWN if s[V.BED_SQUARE] else moving
    s[V.MOVING] = len(sizes) if terms.sizes else moving
    at = [law.place for law in laws]
    s[V.BUSY] = (
        len(terms.rows) > 0 or np.max(s[V.BY_MOUNT : V.BY_GRIP1]) >= 0.0 or max(at, default=0) > places.COMPACTION
    )
    rated = places.RATE_FACTOR in at or places.RATE_FORCE in at or s[V.CONTACT_DAMPING] != 0.0
    s[V.BUSY_ON_ROCK] = s[V.BUSY] or rated
    room = np.zeros((V.MOST_LAWS, V.LAW_COLUMNS))
    room[: len(laws)] = table
    front = [s, room.ravel(), pieces.ravel()]
    parts = {V.CORNERS_AT: corners, V.TERMS_AT: terms.rows, V.PARAMETERS_AT: terms.parameters,
             V.SIZES_AT: np.array(sizes)}  # fmt: skip
    at = sum(part.size for part in front)
    for scalar, part in parts.items():
        s[scalar] = at
        at += part.size
    flat = np.concatenate([*front, *(part.ravel() for part in parts.values())])
    return Model(flat, flat[: V.SIZE], table, len(sizes), int(s[V.EFFECTS]))


def _set_scalars(s: np.ndarray, effects: tuple[Chosen, ...]) -> None:
    """Write what effects set of the model."""
    set_by: dict[str, str] = {}
    s[V.BY_MOUNT : V.BY_MOUNT + len(OWNERS)] = -1.0
    for index, chosen in enumerate(effects):
        if chosen.effect.scalars is None:
            continue
        values = {name: value for name, value in chosen.effect.scalars(chosen.values).items() if value != 0.0}
        for name, value in values.items():
            if name in set_by:
                raise InputError(
                    f"{set_by[name]} and {chosen.effect.name} both set the {name.replace('_', ' ')} "
                    f"({SCALARS[name]}): give one of them"
                )
            set_by[name] = chosen.effect.name
            s[V.SCALAR_AT[name]] = value
        for i, scalars in enumerate(OWNERS):
            if any(V.SCALAR_AT[name] in scalars for name in values):
                s[V.BY_MOUNT + i] = index


def _flat_laws(laws: Sequence[Placed]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tables as the kernels read them: (laws, LAW_COLUMNS), (pieces, PIECE_COLUMNS), (corners, 2)."""
    rows: list[tuple[int, ...]] = []
    pieces: list[np.ndarray] = [np.zeros((0, V.PIECE_COLUMNS))]
    corners: list[np.ndarray] = [np.zeros((0, 2))]
    first, first_corner = 0, 0
    for place, over, table, index in laws:
        at = 1 + np.flatnonzero(table.corners)
        rows.append((place, first, len(table.pieces), first_corner, at.size, index, over, first))
        pieces.append(np.column_stack([table.knots[:-1], 2.0 / np.diff(table.knots), table.pieces]))
        corners.append(np.column_stack([table.knots[at], at]))
        first, first_corner = first + len(table.pieces), first_corner + at.size
    flat = np.array(rows, dtype=np.int64).reshape(-1, V.LAW_COLUMNS)
    return flat, np.concatenate(pieces), np.concatenate(corners)


def fresh_motion(model: Model, phase: float = 0.0) -> Motion:
    """The rig at rest, the cylinder leaning on the spring, the indenter touching rock never hit before."""
    d, z = np.zeros(V.CORNERS + V.LAW_MEMORY * len(model.laws)), np.zeros(model.tally + BY_EFFECTS + model.effects)
    z[V.Y] = model.s[V.F_B] / model.s[V.K]
    d[V.REGIME], d[V.THETA], d[V.FACTOR] = FREE, phase, 1.0
    d[V.TRUST : V.TRUST + 3] = min(model.s[V.LONGEST], 0.05 * math.sqrt(model.s[V.M2] / model.s[V.KL]))
    for law in range(len(model.laws)):
        write_below(model.flat, d, law)
    return Motion(d, z)


@njit(cache=True)
def write_below(m: np.ndarray, d: np.ndarray, law: int) -> None:
    """Put a law into its first part between corners."""
    V.set_below(m, d, law, 0)


class Start(NamedTuple):
    """A state to start from, or one that a run ended in. SI."""

    y: float
    """X1 - X2 in m."""
    v1: float
    v2: float
    w: float
    """Behind Xf (out of contact, below 0; unloading, above 0) or Xp (loading, above 0), in m."""
    regime: int
    """0 no contact, 1 loading, 2 unloading."""
    extra: tuple[float, ...] = ()
    """The extra states of the chosen effects, in the order chosen; left out, they are 0. How a mass slides or sticks
    follows from its speed and the forces, whatever is said here."""
    face: float = 0.0
    """Displacement of the rock's face in m."""


def extra_places(effects: tuple[Chosen, ...]) -> list[tuple[int, int]]:
    """Where the extra states of the effects stand, in the order chosen: (0 for z, 1 for d; index)."""
    found, own = [], OWN
    for chosen in effects:
        for extra in chosen.effect.extras:
            if extra.kept:
                found.append(MEMORY[extra.kept])
            else:
                found.append((0, own))
                own += 1
    return found


def motion_at(model: Model, effects: tuple[Chosen, ...], start: Start | None, phase: float = 0.0) -> Motion:
    """The state of a start; left out, the rig starts fresh.

    Raises:
        InputError: a start that does not fit its regime or these effects.
    """
    motion = fresh_motion(model, phase)
    if start is None:
        return motion
    d, z = motion
    for index, name in enumerate(("y", "v1", "v2", "w")):
        z[index] = number(f"start {name}", getattr(start, name), -1e3, 1e3, "m" if name in ("y", "w") else "m/s")
    z[V.U] = number("start face", start.face, -1e3, 1e3, "m")
    d[V.REGIME] = regime = int(number("start regime", start.regime, 0, 2))
    kept = extra_places(effects)
    if start.extra and len(start.extra) != len(kept):
        raise InputError(
            f"start has {len(start.extra)} extra states: these effects have {len(kept)}, give as many or none"
        )
    for (which, at), value in zip(kept, start.extra, strict=False):
        (z, d)[which][at] = number("start extra", value, -1e12, 1e12)
    into = z[V.V2] - z[V.UD]
    if (regime == FREE and z[V.W] > 0) or (regime != FREE and z[V.W] < 0):
        raise InputError(
            f"start w is {z[V.W]:g} m in regime {regime}: give w <= 0 out of contact (0), w >= 0 in contact"
        )
    if (regime == LOADING and into < 0) or (regime == UNLOADING and into > 0):
        raise InputError(
            f"start moves at {into:g} m/s into the rock in regime {regime}: loading (1) moves in, unloading out"
        )
    return motion


def start_at(motion: Motion, effects: tuple[Chosen, ...]) -> Start:
    """What to start from to go on from a state."""
    d, z = motion
    extra = tuple(float((z, d)[which][at]) for which, at in extra_places(effects))
    return Start(float(z[V.Y]), float(z[V.V1]), float(z[V.V2]), float(z[V.W]), int(d[V.REGIME]), extra, float(z[V.U]))
