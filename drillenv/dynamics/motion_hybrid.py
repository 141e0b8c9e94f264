"""What the rig settles on with effects beyond the paper's model: the search of orbits.py, on the hybrid engine.

As there, the rig runs and is looked at once an excitation period; a near return is polished by Newton's method, and
taken if the orbit is stable and the run closes in on it. The derivative of the return map is that of the variational
equations along one run, with saltation at its events (:mod:`drillenv.dynamics.hybrid.sensitivity`).

A point of the section is y, v1, v2 and w, then the rock's displacement and speed where a mount lets it move, the force
that enclosed air has taken off the cylinder, and the states of terms from outside, each over a scale of its own. What
cannot recur, or follows from these, is left out of it:

- the way in which dry friction lets a mass slide, which follows from its speed;
- counts, which only grow. While the rock compacts no motion recurs. The rig is run until the count has done its work,
  and is then put at the end of it: what is found is the motion on the compacted rock;
- angles that go round at a rate of their own, as that of a turning rock. A motion can close only after so many periods
  as bring them back; where none do, what is found are the means of a motion that does not close.

The pressure of an air spring recurs but comes to rest slowly; it is given the time that it says it needs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.checks import InputError, shown
from drillenv.dynamics.compiled import YES
from drillenv.dynamics.constitutive.places import COMPACTION, PLACES
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.exact import TURN
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING, make_model
from drillenv.dynamics.hybrid.advance import WENT_ON
from drillenv.dynamics.hybrid.events import set_corners
from drillenv.dynamics.hybrid.model import Motion, Start, extra_places, fresh_motion, model_for, motion_at, start_at
from drillenv.dynamics.hybrid.run import RATES, SAMPLE_COLUMNS, integrate, lost_by
from drillenv.dynamics.hybrid.runge_kutta import FLAGS, SPARE_SLOPE, STANDING, make_scratch
from drillenv.dynamics.hybrid.sensitivity import by_state, law_slope, make_variation, run_varied
from drillenv.dynamics.hybrid.vector_field import (
    AIR_RATE,
    BED,
    BED_SPEED,
    BED_SQUARE,
    BENT1,
    BENT2,
    BRISTLES1,
    BRISTLES2,
    CARRY,
    COMPACTION_LENGTH,
    COUNT,
    DRILLED,
    M2,
    MOUNT_SQUARE,
    ORIGIN,
    PEAK,
    REGIME,
    THETA,
    THETA_CARRY,
    TIME,
    TURNS,
    UD,
    V1,
    V2,
    Q,
    U,
    W,
    Y,
    law_depth,
    law_force,
)
from drillenv.dynamics.hybrid.vector_field import KU as UNLOADING_STIFFNESS
from drillenv.dynamics.orbits import KICK, LONGEST_PERIOD
from drillenv.dynamics.survey import LINGERING, MORE_PATIENCE, place_start
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

RTOL = 1e-12
"""Relative error of a step. What is left of it after a period is some 1e-10 of the section's scales."""
CLOSED = 1e-9
"""An orbit is found where it comes back to within this much of the scales,"""
NEARLY_CLOSED = 1e-7
"""or to within this much and no nearer: what rounding leaves over many periods."""
SAME_ORBIT = 1e-6
"""Two points closer than this are of one orbit."""
BACK = 1e-7
"""An angle is back to within this share of a turn."""
NEAR_ONE = 1e-5
"""A multiplier no further above 1 is not told from 1."""
APART = 1e-6
"""How far apart the two runs start, in scales, whose parting gives the exponent."""
EXPONENT_PERIODS = 1000
SETTLED_LENGTHS = 10.0
"""Depth drilled at which a face has compacted, over the length in which it does so to 1/e."""
ENDLESS = PLACES[COMPACTION].high
"""A count at which nothing is left of what it acts on."""
RESTED = 5.0
"""So many times the time in which air comes to rest a start runs, before it is looked at."""
WAITING_RTOL = 1e-7
"""For what a rig runs before it is looked at."""
PEAK_RTOL = 1e-11
"""For runs that are sampled: the samples are then read off a polynomial through each step."""
PEAK_SPACING = 0.02
"""Time between such samples over that in which the indenter turns by 1 rad on the rock while unloading."""

# Columns of switches, impacts and samples of hybrid/run.py.
_TIME, _BEFORE, _AFTER = 0, 1, 2
_FORCE, _SPEED = 1, 2
_ACCELERATION, _PENETRATION = 4, 6


NO_EXTRAS = np.zeros((0, 3), dtype=np.int64)
"""What to sample beside the rig's own motion."""

Place = Motion
"""The rig at phase 0 of the excitation."""


@njit(cache=True, nogil=True, error_model="numpy")
def depth_counted(
    m: np.ndarray, d: np.ndarray, z: np.ndarray, regime: int, wanted: int, scratch: np.ndarray
) -> tuple[float, float]:
    """Depth in m at which a regime of contact resists as the present one does: w counted from Xp instead of Xf.

    And its derivative by the present depth. What ``d`` counts of the contact's corners is lost.
    """
    set_corners(m, d, z, scratch[SPARE_SLOPE], YES)
    depth = law_depth(m, d, wanted, law_force(m, d, regime, z[W]))
    return depth, law_slope(m, d, regime, z[W]) / law_slope(m, d, wanted, depth)


def regime_of(place: Place) -> int:
    """The regime of the contact: 0 no contact, 1 loading, 2 unloading."""
    return int(place.d[REGIME])


class Settled(NamedTuple):
    """What the rig settled on; the fields mean what they do in :class:`drillenv.dynamics.motion.Motion`."""

    period: int
    impacts: float
    contacts: float
    penetration_rate: float
    peak_force: float
    impact_speed: float
    exponent: float
    multipliers: np.ndarray
    """(4 + further states,) complex, the largest modulus first; NaN without a period."""
    place: Place

    @property
    def point(self) -> np.ndarray:
        """(4,) y, v1, v2 and w at the section."""
        return self.place.z[:4].copy()

    @property
    def regime(self) -> int:
        """The regime of the contact there."""
        return regime_of(self.place)

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return self.period > 0 and bool(np.abs(self.multipliers).max() < 1.0)


class Passage(NamedTuple):
    """What happens in so many excitation periods, whichever phase they are counted from."""

    impacts: int
    contacts: int
    peak_force: float
    impact_speed: float


STILL_WITHOUT = {BENT1: BRISTLES1, BENT2: BRISTLES2, BED: BED_SQUARE, BED_SPEED: BED_SQUARE}
"""Extra states that stand still where a scalar of the model is 0."""


class Section:
    """The rig with effects at a setting, looked at once an excitation period.

    Args:
        setting, rock, rig: As for :func:`drillenv.dynamics.motion.motion`.
        effects: What acts on the motion.

    Raises:
        InputError: an effect that does not act on the motion or is given twice.
    """

    setting: Setting
    rock: Rock
    rig: Rig
    effects: tuple[Chosen, ...]
    columns: np.ndarray
    scales: np.ndarray

    def __init__(self, setting: Setting, rock: Rock, rig: Rig, effects: tuple[Chosen, ...]) -> None:
        self.setting, self.rock, self.rig, self.effects = setting, rock, rig, effects
        self.model = model_for(rig, setting, rock, effects)
        self.duration: float = setting.period
        length = rig.drive_force(setting) / (rig.indenter_mass * (TURN * setting.frequency) ** 2)
        speed = length * TURN * setting.frequency
        columns, scales = [Y, V1, V2, W], [length, speed, speed, length]
        if self.model.s[MOUNT_SQUARE] > 0.0:
            columns += [U, UD]
            scales += [length, speed]
        self.goal = 0.0
        """How far the count of impacts has to come."""
        self.angles: list[int] = []
        """Where angles stand in the state that terms from outside turn at rates of their own."""
        self.closing = np.ones(LONGEST_PERIOD + 1, dtype=bool)
        """Whether a motion can close after so many periods."""
        self.rest = 0.0
        """Time in s that enclosed air needs to come to rest."""
        extras = [(chosen, extra) for chosen in effects for extra in chosen.effect.extras]
        for (chosen, extra), (discrete, at) in zip(extras, extra_places(effects), strict=True):
            if extra.turns:
                if not discrete:
                    self.angles.append(at)
                elif at in RATES:
                    self._close_after(self.model.s[RATES[at]] * self.duration)
            elif not _acts(chosen):
                # without strength an extra state stands still or fades unseen, and would only look like a multiplier
                continue
            elif not discrete and at in STILL_WITHOUT and self.model.s[STILL_WITHOUT[at]] == 0.0:
                continue
            elif not discrete and at != UD:
                columns.append(at)
                scales.append(extra.size)
            elif discrete and at == COUNT and chosen.effect.counted is not None:
                self.goal: float = max(self.goal, chosen.effect.counted(chosen.values))
        if Q in columns:
            self.rest: float = RESTED / self.model.s[AIR_RATE]
        self.columns, self.scales = np.array(columns), np.array(scales)
        self.scratch: np.ndarray = make_scratch(self.model)

    def _close_after(self, turn: float | np.ndarray) -> None:
        """Leave the periods after which angles are back that go on by ``turn`` rad in one."""
        off = np.outer(np.arange(LONGEST_PERIOD + 1), turn) / TURN
        self.closing &= np.all(np.abs(off - np.round(off)) < BACK, axis=1)

    # --- Places

    def fresh(self) -> Place:
        """The rig at rest against untouched rock."""
        return self._begun(fresh_motion(self.model))

    def at(self, y: float, v1: float, v2: float, w: float) -> Place:
        """The rig at a point of the section, w from Xf; what effects add stands at 0."""
        place = fresh_motion(self.model)
        place.z[[Y, V1, V2, W]] = y, v1, v2, w
        return self._entered(place, UNLOADING)

    def going_on(self, start: Start) -> Place:
        """The rig where another run ended at phase 0.

        Raises:
            InputError: a start that does not fit its regime or these effects.
        """
        return self._begun(motion_at(self.model, self.effects, start))

    def start(self, place: Place) -> Start:
        """What to go on from elsewhere."""
        return start_at(place, self.effects)

    def random(self, unit: np.ndarray) -> Place:
        """A start of :func:`drillenv.dynamics.survey.place_start`, effects at rest.

        Raises:
            InputError: a rig and rock that the exact engine cannot take.
        """
        state = np.zeros(11)
        place_start(make_model(self.rig, self.rock, self.setting), unit, state)
        return self.at(*state[:4].tolist())

    def _begun(self, place: Place) -> Place:
        """The same place, in which a motion begins."""
        place.d[PEAK] = 0.0
        self._integrate(place, True, 0.0, 1.0, self.samples(0), RTOL, True)
        return place

    def _entered(self, place: Place, counted: int) -> Place:
        """The regime that a state calls for, whose w, if above 0, is as ``counted`` counts it."""
        d, z = place
        d[REGIME] = FREE
        if z[W] > 0.0:
            into = z[V2] - z[UD]
            counted = UNLOADING if counted == FREE else counted
            d[REGIME] = wanted = counted if into == 0.0 else (LOADING if into > 0.0 else UNLOADING)
            if wanted != counted:
                z[W], _rate = depth_counted(self.model.flat, d, z, counted, wanted, self.scratch)
        return self._begun(place)

    def point(self, place: Place, counted: int) -> np.ndarray:
        """(d,) a place over the scales, w as the regime ``counted`` counts it where both are in contact."""
        values = place.z[self.columns]
        values[3] = self._recounted(place, regime_of(place), counted)[0]
        return values / self.scales

    def _recounted(self, place: Place, regime: int, counted: int) -> tuple[float, float]:
        """The depth w, counted by ``regime``, as another regime counts it where both are in contact; its derivative."""
        if place.z[W] <= 0.0 or counted in (regime, FREE) or regime == FREE:
            return float(place.z[W]), 1.0
        return depth_counted(self.model.flat, place.d.copy(), place.z, regime, counted, self.scratch)

    def moved(self, place: Place, point: np.ndarray) -> Place:
        """The place at another point, which counts w as this place's regime does."""
        other = place.copy()
        other.z[self.columns] = point * self.scales
        return self._entered(other, regime_of(place))

    # --- Runs

    def run(self, place: Place, seconds: float, rate: float, samples: np.ndarray, rtol=RTOL, exact: bool = True):
        """Run from a place, which stays as it is. Returns the place reached, impacts and switches."""
        reached = place.copy()
        reached.z[self.model.tally :] = 0.0
        impacts, switches = self._integrate(reached, False, seconds, rate, samples, rtol, exact)
        # drift and rounding would take digits from phase and place
        reached.d[[THETA, THETA_CARRY, TURNS, TIME, ORIGIN, CARRY]] = 0.0
        return reached, impacts, switches

    def _integrate(self, place: Place, begins: bool, seconds: float, rate: float, samples, rtol: float, exact: bool):
        """Go on from a place, which becomes that reached, or begin a motion there. Returns impacts and switches."""
        d, z = place
        self.scratch[FLAGS, STANDING] = 0.0
        status, now, impacts, switches, _steps = integrate(
            exact, self.model, d, z, begins, seconds, rate, samples, NO_EXTRAS, rtol, self.scratch
        )
        self._check(status, now)
        return impacts, switches

    @staticmethod
    def _check(status: int, now: float) -> None:
        if status != WENT_ON:
            raise InputError(f"the motion {lost_by(status)} at {now:g} s: make the effects weaker")

    def samples(self, count: int) -> np.ndarray:
        """Room for so many samples."""
        return np.zeros((count, SAMPLE_COLUMNS))

    def after(self, place: Place, periods: int) -> Place:
        """The place so many excitation periods on."""
        return self.run(place, periods * self.duration, 1.0, self.samples(0))[0]

    def waited(self, place: Place, periods: int) -> Place:
        """The same to a looser tolerance, where what comes next forgets."""
        return self.run(place, periods * self.duration, 1.0, self.samples(0), WAITING_RTOL, False)[0]

    def follow_angles(self, place: Place) -> None:
        """Find out after how many periods all angles come back that terms from outside turn."""
        self._close_after((self.after(place, 1).z - place.z)[self.angles])

    def counted_out(self, place: Place, patience: int) -> Place:
        """Run until what is counted has done its work, at most ``patience`` periods, and let the count be endless."""
        length = self.model.s[COMPACTION_LENGTH]
        goal = np.array([self.goal, SETTLED_LENGTHS * length])
        if np.all(place.d[[COUNT, DRILLED]] >= goal):
            return place
        done, step = 0, min(LONGEST_PERIOD, patience)
        while done < patience and np.any(place.d[[COUNT, DRILLED]] < goal):
            place = self.waited(place, step)
            done += step
        # the contact going on keeps the count that it began with, so the force does not jump
        place.d[[COUNT, DRILLED]] = ENDLESS, ENDLESS * length
        return self.after(place, LONGEST_PERIOD)

    def returned(self, place: Place, point: np.ndarray, periods: int) -> np.ndarray:
        """The image of a point, both counted as at ``place``."""
        return self.point(self.after(self.moved(place, point), periods), regime_of(place))

    def tangent(self, place: Place, point: np.ndarray, periods: int) -> np.ndarray:
        """(d, d) derivative of the return map, by the variational equations along one run."""
        begin = self.moved(place, point)
        counted, columns = regime_of(place), by_state(point.size)
        scales = self.scales.copy()
        # w counts as this place's regime does, which need not be that of the point
        other = place.copy()
        other.z[W] = point[3] * self.scales[3]
        scales[3] *= self._recounted(other, counted, regime_of(begin))[1]
        d, z = begin
        work = make_variation(self.model, point.size)
        work.v[0, self.columns, np.arange(point.size)] = scales
        status, now = run_varied(self.model, d, z, periods * self.duration, RTOL, columns, work, self.scratch)
        self._check(status, now)
        varied = work.v[0][self.columns]
        varied[3] *= self._recounted(begin, regime_of(begin), counted)[1]
        return varied / self.scales[:, None]


def _acts(chosen: Chosen) -> bool:
    """Whether an effect has any strength: by its first parameter, which is that of every effect with extra states."""
    if chosen.effect.axes is not None:
        return not chosen.is_neutral
    return chosen.values[0] != chosen.effect.parameters[0].neutral


def settle_on(section: Section, place: Place, wait: int, patience: int) -> Settled:
    """What the rig settles on from a place, as :func:`drillenv.dynamics.survey.settle_on` finds it without effects.

    Raises:
        InputError: effects under which the motion cannot be followed.
    """
    longest = MORE_PATIENCE * patience
    place = section.counted_out(place, patience)
    place = section.waited(place, min(math.ceil(section.rest / section.duration), longest))
    if section.angles:
        section.follow_angles(place)
    found = _find(section, place, wait, patience)
    if found.period == 0 and found.exponent * section.duration < LINGERING and section.closing[1:].any():
        found = _find(section, found.place, wait, longest)
    return found


def _find(section: Section, place: Place, wait: int, patience: int) -> Settled:
    """As ``find_motion`` of orbits.py, among the periods after which a motion can close."""
    done, target = 0, wait
    while done < patience:
        first = section.waited(place, target)
        place, track = first, [section.point(first, regime_of(first))]
        for _ in range(LONGEST_PERIOD):
            place = section.after(place, 1)
            track.append(section.point(place, regime_of(first)))
        done += target + LONGEST_PERIOD
        found, kick = _closed(section, first, track)
        if found is not None:
            return found
        if kick:
            place.z[Y] += KICK * section.scales[0]
        target = done
    return _without_period(section, place)


def _closed(section: Section, first: Place, track: list[np.ndarray]) -> tuple[Settled | None, bool]:
    """The orbit that a track closes in on, if any, and whether it lingers on one that is not stable."""
    nearest, tried, lingers = np.inf, 0, False
    for n in range(1, LONGEST_PERIOD + 1):
        if not section.closing[n]:
            continue
        near = _apart(track[n], track[0])
        # a return worth trying: near, and clearly nearer than any shorter one
        if not near < 0.1 or not near < 0.2 * nearest or tried == 4:
            continue
        nearest, tried = near, tried + 1
        orbit = _orbit(section, first, track[0], n)
        if orbit is None:
            continue
        off = _apart(orbit, track[0])
        values = np.linalg.eigvals(section.tangent(first, orbit, n))
        largest = np.abs(values).max()
        later = LONGEST_PERIOD - LONGEST_PERIOD % n
        # a multiplier of 1 is that of a mass that dry friction, or play, lets rest anywhere
        if largest < 1.0 + NEAR_ONE and off < NEARLY_CLOSED:
            return _described(section, first, orbit, n, values), False
        if largest < 1.0:
            if off < 0.2 and _apart(orbit, track[later]) < off:
                return _described(section, first, orbit, n, values), False
        elif off < KICK:
            # the run lingers on an orbit that has lost its stability, as on a sweep past a period doubling
            lingers = True
    return None, lingers


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max())


def _orbit(section: Section, place: Place, point: np.ndarray, n: int) -> np.ndarray | None:
    """Newton's method on the n-fold return map; None where it finds nothing."""
    previous = np.inf
    try:
        for _ in range(20):
            image = section.returned(place, point, n)
            miss = _apart(image, point)
            if miss < CLOSED or (miss < NEARLY_CLOSED and miss >= 0.5 * previous):
                return point
            if not miss < 1e3:
                return None
            previous = miss
            step = np.linalg.solve(np.eye(point.size) - section.tangent(place, point, n), image - point)
            # a step far beyond the motion's own size says that there is no orbit near
            point = point + step * min(1.0, 1.0 / float(np.abs(step).max()))
    except (InputError, np.linalg.LinAlgError):
        pass  # it went where the rig cannot be followed, or nowhere
    return None


def _described(section: Section, first: Place, orbit: np.ndarray, n: int, values: np.ndarray) -> Settled:
    """Go around an orbit that closes after n periods, or already after a part of them."""
    for shorter in range(1, n):
        if n % shorter or not section.closing[shorter]:
            continue
        if _apart(section.returned(first, orbit, shorter), orbit) < SAME_ORBIT:
            n, values = shorter, np.linalg.eigvals(section.tangent(first, orbit, shorter))
            break
    place = section.moved(first, orbit)
    passage, advance = _around(section, place, n)
    order = np.lexsort((-np.imag(values), -np.round(np.abs(values), 12)))
    duration = n * section.duration
    with np.errstate(divide="ignore"):
        exponent = float(np.log(np.abs(values[order[0]]))) / duration
    multipliers = values[order].astype(complex)
    return Settled(n, *passage[:2], advance / duration, *passage[2:], exponent, multipliers, place)


def _around(section: Section, place: Place, n: int) -> tuple[Passage, float]:
    """What happens on an orbit of n periods, and the penetration in m."""
    # a round first, then a round and a period, in which to find a time far from all switches to count from
    rows = section.samples(3)
    seconds = (2 * n + 1) * section.duration
    _end, impacts, switches = section.run(place, seconds, 1.0 / (n * section.duration), rows)
    begin = _quiet(switches[:, _TIME], n * section.duration, section.duration)
    passage = _passage(impacts, switches, begin, begin + n * section.duration)
    return passage, float(rows[2, _PENETRATION] - rows[1, _PENETRATION])


def _quiet(times: np.ndarray, begin: float, duration: float) -> float:
    """The middle of the longest stretch without a switch in ``duration`` s from ``begin``, which repeats."""
    inside = times[(times >= begin) & (times < begin + duration)]
    if not inside.size:
        return begin + 0.5 * duration
    edges = np.concatenate([inside, [inside[0] + duration]])
    longest = int(np.argmax(np.diff(edges)))
    middle = 0.5 * (edges[longest] + edges[longest + 1])
    return float(middle if middle < begin + duration else middle - duration)


def _passage(impacts: np.ndarray, switches: np.ndarray, begin: float, end: float) -> Passage:
    """What happens between two times in s."""
    hits = impacts[(impacts[:, _TIME] > begin) & (impacts[:, _TIME] <= end)]
    landings = switches[(switches[:, _BEFORE] == FREE) & (switches[:, _TIME] > begin) & (switches[:, _TIME] <= end)]
    # an impact has the speed of its contact; one that began before the run counts with 0
    return Passage(len(hits), len(landings), *(float(hits[:, at].max(initial=0.0)) for at in (_FORCE, _SPEED)))


def _without_period(section: Section, place: Place) -> Settled:
    """Means, extremes and the exponent of a motion that does not close."""
    seconds, rows = EXPONENT_PERIODS * section.duration, section.samples(2)
    _end, impacts, switches = section.run(place, seconds, 1.0 / seconds, rows)
    passage = _passage(impacts, switches, 0.0, seconds)
    exponent, end = _exponent(section, place)
    multipliers = np.full(section.scales.size, np.nan + 0j)
    advance = float(rows[1, _PENETRATION] - rows[0, _PENETRATION])
    means = (passage.impacts / EXPONENT_PERIODS, passage.contacts / EXPONENT_PERIODS)
    return Settled(0, *means, advance / seconds, *passage[2:], exponent, multipliers, end)


def _exponent(section: Section, place: Place) -> tuple[float, Place]:
    """Largest Lyapunov exponent in 1/s, and where the run ends.

    From two runs side by side, brought back to the same small distance after each excitation period (G. Benettin et
    al., Meccanica 15 (1980) 9-20).
    """
    away = np.ones(section.scales.size) / np.sqrt(section.scales.size)
    total = 0.0
    for _ in range(EXPONENT_PERIODS):
        point = section.point(place, regime_of(place))
        other = section.after(section.moved(place, point + APART * away), 1)
        place = section.after(place, 1)
        away = section.point(other, regime_of(place)) - section.point(place, regime_of(place))
        size = float(np.linalg.norm(away))
        if size == 0.0:  # dry friction can bring two runs together
            return -np.inf, place
        total += np.log(size / APART)
        away /= size
    return total / (EXPONENT_PERIODS * section.duration), place


def same_orbit(section: Section, first: Settled, second: Settled) -> bool:
    """Whether two orbits of one period meet, whichever crossing each shows."""
    target, place = section.point(first.place, UNLOADING), second.place
    for _ in range(first.period):
        if _apart(section.point(place, UNLOADING), target) < SAME_ORBIT:
            return True
        place = section.after(place, 1)
    return False


def peaks(section: Section, settled: Settled, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Forces in N and largest decelerations -X2'' in m/s^2 of the impacts of a motion, in their order.

    Of an orbit its impacts; of a motion that does not close the next in ``most`` periods; ``most`` at most.
    """
    periods = settled.period or most
    spacing = PEAK_SPACING * float(np.sqrt(section.model.s[M2] / section.model.s[UNLOADING_STIFFNESS]))
    # a period more on either side, so that an impact under way at the section is seen from beginning to end
    begin, end = section.duration, (periods + 1) * section.duration
    rows = section.samples(int((end + section.duration) / spacing) + 1)
    how = (PEAK_RTOL, False) if settled.period else (RTOL, True)
    _end, impacts, switches = section.run(settled.place, end + section.duration, 1.0 / spacing, rows, *how)
    hits = [hit for hit in impacts if begin < hit[_TIME] <= end][:most]
    decelerations = [_deceleration(rows, spacing, *_contact(switches, hit[_TIME])) for hit in hits]
    return np.array([hit[_FORCE] for hit in hits]), np.array(decelerations)


def _contact(switches: np.ndarray, turn: float) -> tuple[float, float]:
    """When the loading before a turn begins and the unloading after it ends, in s."""
    at = int(np.searchsorted(switches[:, _TIME], turn - 1e-12))
    begin = switches[at - 1, _TIME] if at > 0 else 0.0
    return float(begin), float(switches[at + 1, _TIME]) if at + 1 < len(switches) else np.inf


def _deceleration(rows: np.ndarray, spacing: float, begin: float, end: float) -> float:
    """The largest -X2'' in m/s^2 of samples between two times, by a parabola through the three highest."""
    first = int(np.ceil(begin / spacing))
    last = int(min(end // spacing + 1, len(rows)))
    part = -rows[first : max(last, first + 1), _ACCELERATION]
    k = int(np.argmax(part))
    if not 0 < k < part.size - 1:
        return float(part[k])
    left, right = part[k] - part[k - 1], part[k] - part[k + 1]
    bend = left + right
    return float(part[k] + (0.125 * (left - right) ** 2 / bend if bend > 0.0 else 0.0))


def effects_meant(given: Iterable[Chosen]) -> tuple[Chosen, ...]:
    """The effects as a tuple.

    Raises:
        InputError: something else than effects.
    """
    try:
        chosen = tuple(given)
    except TypeError:
        raise InputError(
            f"effects is {shown(given)}: give a list of drillenv.dynamics.effects.make(name, ...)"
        ) from None
    for each in chosen:
        if not isinstance(each, Chosen):
            raise InputError(f"effects holds {shown(each)}: give drillenv.dynamics.effects.make(name, ...)")
    return chosen
