"""The general engine: any contact law and any effects, by an explicit Runge-Kutta pair of order 8, event-accurate.

This module is what a user calls. The equations stand in :mod:`drillenv.dynamics.general_equations`; how they are
stepped through in ``general_steps``; how switches of contact are found in ``general_switches``, how masses stick and
slide in ``general_friction``; and ``general_runs`` puts these in order. A step is tried without regard to switches and
taken again, shorter, to end on the first one. Samples are steps of their own from the same start or, at loose
tolerances, read off a polynomial; the motion does not depend on the sample rate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from drillenv.checks import InputError, number
from drillenv.dynamics.effects import ON_INDENTER, ON_SHAKER, Chosen
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.general_calls import CORNER, SHAPE, SWITCHED, TERM, address_of
from drillenv.dynamics.general_equations import (
    AT,
    BY_DRIVE,
    BY_EFFECTS,
    BY_STATIC,
    COLUMNS,
    CORNER_AT,
    FACE,
    FIRST,
    IN_DAMPER,
    IN_ROCK,
    LAST,
    OWN,
    SHAPE_AT,
    SWITCHED_AT,
    TERM_AT,
    V1,
    V2,
    Model,
    U,
    W,
    Y,
)
from drillenv.dynamics.general_runs import DONE, SAMPLE_COLUMNS, STEPS_TOO_SHORT, integrate
from drillenv.dynamics.general_steps import make_scratch
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock


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


class Impacts(NamedTuple):
    """One entry an impact: a turn from loading to unloading."""

    time: np.ndarray
    """s, of the turn."""
    force: np.ndarray
    """N, the largest force of the rock on the way to this turn."""
    speed: np.ndarray
    """m/s into the rock, where the contact began; 0 for a contact begun before the run."""
    depth: np.ndarray
    """m, X2 - Xp at the turn."""
    contact_time: np.ndarray
    """s, when the contact began."""


class Switches(NamedTuple):
    """One entry a switch of regime."""

    time: np.ndarray
    """s."""
    before: np.ndarray
    """0 no contact, 1 loading, 2 unloading."""
    after: np.ndarray


class Energy(NamedTuple):
    """Energies of a whole run in J. ``stored`` are those of the masses and the spring k."""

    drive: float
    """Work of the drive force F_a sin(theta)."""
    static: float
    """Work of the static force F_b."""
    damper: float
    """Lost in the damper c."""
    rock: float
    """Lost in the rock by the rock law (as bent by effects)."""
    effects: np.ndarray
    """(effects,) given to the rig by each effect, in the order chosen; negative where it takes."""
    stored_before: float
    stored_after: float

    @property
    def error(self) -> float:
        """What the balance fails to close by, in J."""
        given = self.drive + self.static - self.damper - self.rock + float(np.sum(self.effects))
        return self.stored_after - self.stored_before - given


class GeneralRun(NamedTuple):
    """What :func:`run_general` returns. SI; arrays of samples have shape (samples,)."""

    time: np.ndarray
    """s, 0 at the start."""
    x1: np.ndarray
    """m. X2 = 0 where Xf was at the start (Xp for a start while loading), the rock's face not displaced."""
    x2: np.ndarray
    v1: np.ndarray
    v2: np.ndarray
    acceleration: np.ndarray
    """m/s^2, of the indenter."""
    force: np.ndarray
    """N, of the rock, positive in compression."""
    penetration: np.ndarray
    """m, Xf."""
    regime: np.ndarray
    """0 no contact, 1 loading, 2 unloading."""
    extra: np.ndarray
    """(samples, extra states) of the chosen effects, in the order chosen."""
    impacts: Impacts
    switches: Switches
    energy: Energy
    end: Start
    """The state at the end, to start another run from, with ``end_phase``."""
    end_phase: float
    """rad."""
    end_origin: float
    """m. The place that ``end.w`` is counted from."""
    steps: int
    """Steps tried."""
    rejected: int
    """Steps tried in vain."""


def run_general(
    rig: Rig,
    setting: Setting,
    rock: Rock,
    seconds: float,
    sample_rate: float,
    phase: float = 0.0,
    start: Start | None = None,
    effects: Iterable[Chosen] = (),
    rtol: float = 1e-12,
) -> GeneralRun:
    """Run the rig with any effects.

    Args:
        rig: The rig.
        setting: Frequency, amplitude and pressure.
        rock: The rock.
        seconds: Duration in s.
        sample_rate: Samples a second, the first at time 0; 0 for none.
        phase: Phase of the excitation at time 0 in rad.
        start: State at time 0. Left out, the rig starts fresh: at rest, the cylinder leaning on the spring, the
            indenter touching rock never hit before.
        effects: From :func:`drillenv.dynamics.effects.make`, each effect at most once.
        rtol: Relative error tolerated a step.

    Raises:
        InputError: a value out of range, a start that does not fit its regime, an effect that does not act on the
            motion or is given twice, or effects under which the motion cannot be followed.
    """
    seconds = number("seconds", seconds, 0.0, 1e6, "s")
    sample_rate = number("sample_rate", sample_rate, 0.0, 1e8, "Hz")
    phase = number("phase", phase, -1e6, 1e6, "rad") % (2 * math.pi)
    rtol = number("rtol", rtol, 1e-14, 1e-3)
    effects = tuple(effects)
    model, order = model_for(rig, setting, rock, effects)
    z, regime = first_state(model, start, effects, order)
    stored_before = _stored(model, z)
    count = math.floor(seconds * sample_rate * (1 + 1e-12)) + 1 if sample_rate > 0 else 0
    samples = np.zeros((count, SAMPLE_COLUMNS + model.tally - OWN))
    status, reached, regime, origin, carry, end_phase, impacts, switches, tried, rejected = integrate(
        model, phase, z, regime, seconds, sample_rate, samples, rtol, make_scratch(z.size, len(effects))
    )
    if status != DONE:
        why = "grew without bound" if status == STEPS_TOO_SHORT else "switched without end"
        raise InputError(f"the motion {why} at {reached:g} s: make the effects weaker, or rtol larger")
    energies = z[model.tally :]
    given = np.empty(len(effects))
    given[order] = energies[BY_EFFECTS:]
    columns = np.ascontiguousarray(samples.T)
    return GeneralRun(
        time=np.arange(count) / sample_rate if count else np.zeros(0),
        x1=columns[0],
        x2=columns[1],
        v1=columns[2],
        v2=columns[3],
        acceleration=columns[4],
        force=columns[5],
        penetration=columns[6],
        regime=columns[7].astype(np.int8),
        extra=samples[:, SAMPLE_COLUMNS:][:, _in_order_chosen(effects, order)],
        impacts=Impacts(*np.ascontiguousarray(impacts.T)),
        switches=Switches(switches[:, 0].copy(), switches[:, 1].astype(np.int8), switches[:, 2].astype(np.int8)),
        energy=Energy(
            drive=float(energies[BY_DRIVE]),
            static=float(energies[BY_STATIC]),
            damper=float(energies[IN_DAMPER]),
            rock=float(energies[IN_ROCK]),
            effects=given,
            stored_before=stored_before,
            stored_after=_stored(model, z),
        ),
        end=start_at(model, z, regime, effects, order),
        end_phase=end_phase % (2 * math.pi),
        end_origin=origin + carry,
        steps=tried,
        rejected=rejected,
    )


def model_for(rig: Rig, setting: Setting, rock: Rock, effects: tuple[Chosen, ...]) -> tuple[Model, np.ndarray]:
    """The model, and the order in which it calls the effects.

    Raises:
        InputError: an effect that does not act on the motion, or is given twice.
    """
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
    order = np.array(sorted(range(len(effects)), key=lambda i: effects[i].effect.comes_last), dtype=np.int64)
    ordered = [effects[i] for i in order]
    extras = [len(chosen.effect.extras) for chosen in ordered]
    first = OWN + np.cumsum([0, *extras])
    at = np.cumsum([0, *(len(chosen.values) for chosen in ordered)])
    force = rig.drive_force(setting) + rig.static_force(setting)
    depth = force / rock.loading_stiffness
    natural = math.sqrt(rock.loading_stiffness / rig.indenter_mass)
    speed = depth * natural
    sizes = [force / rig.stiffness, speed, speed, depth, depth]
    sizes += [extra.size for chosen in ordered for extra in chosen.effect.extras]

    table = np.zeros((len(ordered), COLUMNS), dtype=np.int64)
    for row, chosen, own, p in zip(table, ordered, first[:-1], at[:-1], strict=True):
        effect = chosen.effect
        row[TERM_AT] = address_of(effect.term, TERM)
        row[SHAPE_AT] = address_of(effect.shape, SHAPE)
        row[SWITCHED_AT] = address_of(effect.switched, SWITCHED)
        row[CORNER_AT] = address_of(effect.corner, CORNER)
        row[LAST], row[FIRST], row[AT], row[FACE] = effect.comes_last, own, p, effect.moves_face
    grip1, grip2 = (_gripping(ordered, mass) for mass in (ON_SHAKER, ON_INDENTER))
    model = Model(
        rig.shaker_mass,
        rig.indenter_mass,
        rig.stiffness,
        rig.damping,
        rock.loading_stiffness,
        rock.unloading_stiffness,
        2 * math.pi * setting.frequency,
        rig.drive_force(setting),
        rig.static_force(setting),
        table,
        np.array([value for chosen in ordered for value in chosen.values] + [0.0]),
        np.array(sizes),
        int(first[-1]),
        any(chosen.effect.shape is not None for chosen in ordered),
        any(chosen.effect.corner is not None for chosen in ordered),
        any(c.effect.term is not None and "contact" in c.effect.balances and not c.is_neutral for c in ordered),
        max(grip1, grip2) >= 0,
        grip1,
        grip2,
        0.1 / setting.frequency,
    )
    return model, order


def _gripping(ordered: list[Chosen], mass: int) -> int:
    """Which effect grips a mass, or -1."""
    rows = [i for i, each in enumerate(ordered) if each.effect.grips == mass and each.values[0] > 0.0]
    # friction that sets in over a transition speed is a term like others
    rows = [i for i in rows if not any(ordered[i].values[1:2])]
    if len(rows) > 1:
        names = " and ".join(ordered[i].effect.name for i in rows)
        raise InputError(f"{names} grip the same mass: give one of them, with the sum of their limits")
    return rows[0] if rows else -1


def first_state(
    model: Model, start: Start | None, effects: tuple[Chosen, ...], order: np.ndarray
) -> tuple[np.ndarray, int]:
    """The state vector that :func:`integrate` takes, and the regime. ``model`` and ``order`` are of :func:`model_for`.

    Raises:
        InputError: a start that does not fit its regime or these effects.
    """
    z = np.zeros(model.tally + BY_EFFECTS + len(effects))
    if start is None:
        z[Y] = model.static / model.k
        return z, FREE
    for index, name in enumerate(("y", "v1", "v2", "w")):
        z[index] = number(f"start {name}", getattr(start, name), -1e3, 1e3, "m" if name in ("y", "w") else "m/s")
    z[U] = number("start face", start.face, -1e3, 1e3, "m")
    regime = int(number("start regime", start.regime, 0, 2))
    room = model.tally - OWN
    if start.extra:
        if len(start.extra) != room:
            raise InputError(
                f"start has {len(start.extra)} extra states: these effects have {room}, give as many or none"
            )
        values = [number("start extra", value, -1e12, 1e12) for value in start.extra]
        z[OWN : model.tally][_in_order_chosen(effects, order)] = values
    into = z[V2] - sum(z[row[FIRST]] for row in model.effects if row[FACE])
    if (regime == FREE and z[W] > 0) or (regime != FREE and z[W] < 0):
        raise InputError(f"start w is {z[W]:g} m in regime {regime}: give w <= 0 out of contact (0), w >= 0 in contact")
    if (regime == LOADING and into < 0) or (regime == UNLOADING and into > 0):
        raise InputError(
            f"start moves at {into:g} m/s into the rock in regime {regime}: loading (1) moves in, unloading out"
        )
    return z, regime


def start_at(model: Model, z: np.ndarray, regime: int, effects: tuple[Chosen, ...], order: np.ndarray) -> Start:
    """What to start from to go on from the state vector that :func:`integrate` left."""
    extra = z[OWN : model.tally][_in_order_chosen(effects, order)]
    return Start(
        y=float(z[Y]),
        v1=float(z[V1]),
        v2=float(z[V2]),
        w=float(z[W]),
        regime=int(regime),
        extra=tuple(float(part) for part in extra),
        face=float(z[U]),
    )


def _in_order_chosen(effects: tuple[Chosen, ...], order: np.ndarray) -> np.ndarray:
    """Index of each extra state, in the order chosen, among those of the model."""
    counts = [len(chosen.effect.extras) for chosen in effects]
    place, at = {}, 0
    for i in order:
        place[i] = at
        at += counts[i]
    return np.array([place[i] + j for i in range(len(effects)) for j in range(counts[i])], dtype=np.int64)


def _stored(model: Model, z: np.ndarray) -> float:
    """Energy of the masses and the spring in J."""
    return float(0.5 * (model.m1 * z[V1] ** 2 + model.m2 * z[V2] ** 2 + model.k * z[Y] ** 2))
