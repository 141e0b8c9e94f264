"""What the rig settles on: a periodic orbit P-n-I-m with its multipliers, or chaos with its largest exponent."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from drillenv.checks import InputError, count, number, shown
from drillenv.dynamics import motion_hybrid
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.exact import STATE_SIZE, fresh_state
from drillenv.dynamics.flow import FREE, LOADING, STIFFNESS, UNLOADING, make_model
from drillenv.dynamics.hybrid.model import Start
from drillenv.dynamics.orbits import MOTION_SIZE, map_point, put_on_section, section_distance
from drillenv.dynamics.survey import PATIENCE, WAIT, as_survey, label, random_starts, settle_on, survey
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock
from drillenv.rocks import rock as rock_meant

SAME_ORBIT = 1e-6
"""Two points closer than this, in length scales, are of the same orbit: Newton's method leaves some 1e-11."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion that the rig settles on at a setting.

    The label is P-n-I-m for an orbit that closes after n excitation periods with m impacts in it, n up to 32. What
    does not close is "chaotic" where its largest Lyapunov exponent is above zero. The rest is "aperiodic": no orbit
    was found although neighbours do not part, as with an orbit longer than 32 periods, a quasi-periodic motion, or a
    transient that outlasts the patience given. The exponent of such a motion is a mean over 1000 excitation periods,
    so one within about 0.5 1/s of zero does not tell the two apart.
    """

    label: str
    period: int
    """In excitation periods; 0 where there is none."""
    impacts: float
    """Force peaks (turns from loading to unloading) a motion; without a period, in the mean of an excitation period."""
    contacts: float
    """Contacts begun, counted likewise; 0 where the indenter never leaves the rock."""
    penetration_rate: float
    """In m/s."""
    peak_force: float
    """The largest rock force in N."""
    impact_speed: float
    """The largest speed in m/s at which a contact begins; 0 where none does."""
    multipliers: np.ndarray
    """(4,) complex Floquet multipliers, the largest modulus first; NaN without a period. One more for each state that
    effects add and that can recur."""
    stable: bool
    """Whether all multipliers lie inside the unit circle."""
    exponent: float
    """The largest Lyapunov exponent in 1/s; with a period, the logarithm of the largest multiplier over its time."""
    point: np.ndarray
    """(4,) y = X1 - X2 in m, V1 and V2 in m/s, w in m, where the motion crosses the phase 0 of the excitation: w is the
    indenter's place from Xp while loading and from Xf otherwise."""
    regime: int
    """The regime there: 0 no contact, 1 loading, 2 unloading."""
    setting: Setting
    rock: Rock
    rig: Rig
    share: float = 1.0
    """The share of starts that settled on this motion, where many were tried."""
    effects: tuple[Chosen, ...] = ()
    """Those beyond the paper's model."""
    state: Start | None = None
    """With effects all of the state at ``point``, what they add included; w as ``regime`` counts it."""


def motion(
    setting: Setting,
    rock: int | str | Rock = 4,
    rig: Rig | None = None,
    start: Motion | np.ndarray | None = None,
    *,
    effects: Iterable[Chosen] = (),
    wait: int = WAIT,
    patience: int = PATIENCE,
) -> Motion:
    """The motion that the rig settles on.

    The rig runs for ``wait`` excitation periods; the orbit it comes near is then found by Newton's method on the
    stroboscopic map, and taken if it is stable and the run closes in on it. Otherwise the rig runs on, twice as long
    each time. The multipliers are the eigenvalues of the map's derivative, which is the product of the closed-form
    flows between switches: the rock force is continuous at each switch, so a switch adds at most the change of
    coordinate from Xp to Xf.

    With effects the same is done on the hybrid engine, some tens of times slower: the map's derivative is then that of
    the variational equations with saltation, and the exponent of what has no period comes from two runs side by side.
    Where the rock compacts, the motion is that on the compacted rock. An air spring is
    given five times its ``tau`` to come to rest, but no longer than eight times the patience: with a ``tau`` of
    minutes, what is found may be a motion on the way.

    Args:
        setting: Frequency, amplitude and pressure.
        rock: Case of Table 2.2, name, or Rock.
        rig: By default that of Table 2.1.
        start: Where to start: None for the rig at rest against untouched rock; a Motion, to go on from where it
            crosses the phase 0; or (4,) y in m, V1 and V2 in m/s, and the indenter's place in m from Xf, at phase 0.
            The states that effects add go on from a Motion with the same effects, and start from 0 otherwise.
        effects: From :func:`drillenv.dynamics.effects.make`. Without any, the engine is the exact one.
        wait: Excitation periods to run before the first look, 1 to 1e6.
        patience: Excitation periods after which what has no orbit yet counts as not periodic, 1 to 1e8; eight times
            as many where the exponent is then too weak to tell.

    Raises:
        InputError: an argument of the wrong kind or outside its limits, a rig and rock that the exact engine cannot
            take, or effects that do not act on the motion, are given twice, or let it grow without bound.
    """
    setting, chosen, rig = checked_place(setting, rock, rig)
    beyond = motion_hybrid.effects_meant(effects)
    wait, patience = count("wait", wait, 1, 1_000_000), count("patience", patience, 1, 100_000_000)
    if beyond:
        section = motion_hybrid.Section(setting, chosen, rig, beyond)
        return _settled_motion(section, motion_hybrid.settle_on(section, _place(section, start), wait, patience))
    model = make_model(rig, chosen, setting)
    state = np.zeros(STATE_SIZE)
    if start is None:
        fresh_state(model, 0.0, state)
    else:
        put_on_section(*_start_point(start), state)
    out, tangent = np.zeros((1, MOTION_SIZE)), np.zeros((1, 4, 4))
    settle_on(model, state, wait, patience, out[0], tangent[0])
    return motion_of(as_survey(out, tangent, np.array([2 * math.pi * setting.frequency]))[0], setting, chosen, rig)


def motions(
    setting: Setting,
    rock: int | str | Rock = 4,
    rig: Rig | None = None,
    starts: int = 64,
    seed: int = 0,
    *,
    effects: Iterable[Chosen] = (),
    wait: int = WAIT,
    patience: int = PATIENCE,
) -> list[Motion]:
    """The motions that coexist at a setting, each with its share of the starts, the largest share first.

    The first start is the rig at rest; the others are random, half of them free and half in contact, over the section
    box of :func:`drillenv.dynamics.survey.place_start`. Periodic motions are the same where their orbits are; chaotic
    ones count as one, and so do aperiodic ones.

    Args:
        setting, rock, rig, effects, wait, patience: As for :func:`motion`. What effects add starts from 0.
        starts: Number of starts, 1 to 10000.
        seed: Of the random starts.

    Raises:
        InputError: as for :func:`motion`; a rig and rock that the exact engine cannot take also with effects.
    """
    setting, chosen, rig = checked_place(setting, rock, rig)
    beyond = motion_hybrid.effects_meant(effects)
    if beyond:
        return _motions_with(motion_hybrid.Section(setting, chosen, rig, beyond), starts, seed, wait, patience)
    place = [[setting.frequency, setting.amplitude, setting.pressure]]
    found = survey(place, chosen, rig, starts, seed=seed, wait=wait, patience=patience)[0]
    model = make_model(rig, chosen, setting)
    kinds: list[Motion] = []
    members: list[int] = []
    for row in found:
        each = motion_of(row, setting, chosen, rig)
        same = next((i for i, other in enumerate(kinds) if same_motion(model, each, other)), None)
        if same is None:
            kinds.append(each)
            members.append(1)
        else:
            members[same] += 1
    return _by_share(kinds, members)


def _motions_with(section: motion_hybrid.Section, starts: int, seed: int, wait: int, patience: int) -> list[Motion]:
    """As :func:`motions`, with effects."""
    units = random_starts(count("starts", starts, 1, 10_000), count("seed", seed, 0, 2**63))
    wait, patience = count("wait", wait, 1, 1_000_000), count("patience", patience, 1, 100_000_000)
    kinds: list[motion_hybrid.Settled] = []
    members: list[int] = []
    for number_of_start, unit in enumerate(units):
        place = section.random(unit) if number_of_start else section.fresh()
        each = motion_hybrid.settle_on(section, place, wait, patience)
        same = next((i for i, other in enumerate(kinds) if _same_settled(section, each, other)), None)
        if same is None:
            kinds.append(each)
            members.append(1)
        else:
            members[same] += 1
    return _by_share([_settled_motion(section, kind) for kind in kinds], members)


def _same_settled(section: motion_hybrid.Section, first: motion_hybrid.Settled, second: motion_hybrid.Settled) -> bool:
    """As :func:`same_motion`, with effects."""
    names = [label(each.period, each.impacts, each.exponent) for each in (first, second)]
    if names[0] != names[1] or not first.period:
        return names[0] == names[1]
    return motion_hybrid.same_orbit(section, first, second)


def _by_share(kinds: list[Motion], members: list[int]) -> list[Motion]:
    """Motions with their share of the starts, the largest first."""
    total = sum(members)
    shared = [replace(kind, share=n / total) for kind, n in zip(kinds, members, strict=True)]
    return sorted(shared, key=lambda kind: -kind.share)


def motion_of(row: np.void, setting: Setting, rock: Rock, rig: Rig) -> Motion:
    """One entry of a survey as a Motion."""
    period = int(row["period"])
    return Motion(
        label=label(period, float(row["impacts"]), float(row["exponent"])),
        period=period,
        impacts=round(row["impacts"]) if period else float(row["impacts"]),
        contacts=round(row["contacts"]) if period else float(row["contacts"]),
        penetration_rate=float(row["penetration_rate"]),
        peak_force=float(row["peak_force"]),
        impact_speed=float(row["impact_speed"]),
        multipliers=row["multipliers"].copy(),
        stable=bool(row["stable"]),
        exponent=float(row["exponent"]),
        point=row["point"].copy(),
        regime=int(row["regime"]),
        setting=setting,
        rock=rock,
        rig=rig,
    )


def _settled_motion(section: motion_hybrid.Section, found: motion_hybrid.Settled) -> Motion:
    """What was found with effects as a Motion."""
    return Motion(
        label=label(found.period, found.impacts, found.exponent),
        period=found.period,
        impacts=found.impacts,
        contacts=found.contacts,
        penetration_rate=found.penetration_rate,
        peak_force=found.peak_force,
        impact_speed=found.impact_speed,
        multipliers=found.multipliers,
        stable=found.stable,
        exponent=found.exponent,
        point=found.point,
        regime=found.regime,
        setting=section.setting,
        rock=section.rock,
        rig=section.rig,
        effects=section.effects,
        state=section.start(found.place),
    )


def _place(section: motion_hybrid.Section, start: Motion | np.ndarray | None) -> motion_hybrid.Place:
    """Where a start stands on a section with effects."""
    if start is None:
        return section.fresh()
    if isinstance(start, Motion):
        if start.state is not None and start.effects == section.effects:
            return section.going_on(start.state)
        return section.at(*point_from_xf(start).tolist())
    return section.at(*_start_point(start)[0].tolist())


def same_motion(model: np.ndarray, first: Motion, second: Motion) -> bool:
    """Whether two motions at the setting of ``model`` are one: their orbits meet, whichever crossing each shows."""
    if first.label != second.label or not first.period:
        return first.label == second.label
    target, image = point_from_xf(first, model), np.empty(4)
    place, tangent = point_from_xf(second, model), np.empty((4, 4))
    for _ in range(first.period):
        if section_distance(model, place, target) < SAME_ORBIT:
            return True
        map_point(model, place, UNLOADING, 1, image, tangent)
        place[:] = image
    return False


def point_from_xf(crossing: Motion, model: np.ndarray | None = None) -> np.ndarray:
    """(4,) the point of a motion with w measured from Xf in every regime, a coordinate in which orbits are smooth."""
    if model is None:
        model = make_model(crossing.rig, crossing.rock, crossing.setting)
    point = crossing.point.copy()
    if crossing.regime == LOADING:
        point[3] *= model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS]
    return point


def checked_place(setting: Setting, rock: int | str | Rock, rig: Rig | None) -> tuple[Setting, Rock, Rig]:
    """The setting, rock and rig meant.

    Raises:
        InputError: one of them is none.
    """
    if not isinstance(setting, Setting):
        raise InputError(f"setting is {shown(setting)}: give Setting(frequency, amplitude, pressure) in Hz, V and bar")
    if not isinstance(rig, Rig | None):
        raise InputError(f"rig is {shown(rig)}: give a Rig, or None for that of Table 2.1")
    return setting, rock_meant(rock), Rig() if rig is None else rig


def _start_point(start: Motion | np.ndarray) -> tuple[np.ndarray, int]:
    """A point of the section and the regime that counts its w."""
    if isinstance(start, Motion):
        return start.point, start.regime
    try:
        point = np.array(start, dtype=float)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (4,):
        raise InputError(f"start is {shown(start)}: give a Motion, or y in m, V1 and V2 in m/s and X2 - Xf in m")
    names = ("y of start", "V1 of start", "V2 of start", "w of start")
    length, speed = (1.0, "m", "mm"), (100.0, "m/s", "mm/s")
    for name, value, (most, unit, slip) in zip(names, point.tolist(), (length, speed, speed, length), strict=True):
        number(name, value, -most, most, unit, [(1e-3, slip)])
    return point, UNLOADING if point[3] > 0 else FREE
