"""Where a motion ends: its orbit followed along a control or the stiffness up to the value, found on the orbit itself.

An orbit of period n and the swept value p are the zeros of ``F(x, p) = M^n(x, p) - x``, with the stroboscopic map M.
They form a curve, which is followed by its arclength: a step along the tangent, then Newton's method at right angles to
it (Keller's pseudo-arclength continuation), so that the curve is passed smoothly where it turns back at a fold. x holds
w measured from Xf in every regime; with it the map is differentiable wherever the orbit crosses the section, also in a
turn. On the way are watched: the number of impacts, the multipliers, the sign of dp/ds, and ``M^(n/2)(x) - x``, which
vanishes where a motion of twice the period closes on one of half its length. The step on which one of them changes is
halved until the value is known to rounding.
"""

from __future__ import annotations

import copy
import itertools
import math
from dataclasses import dataclass

import numpy as np

from drillenv.atlas.sweep import CONTROLS, DIRECTIONS, SLIPS, Sweep, place_at, value_of
from drillenv.checks import InputError, choice, number, shown
from drillenv.dynamics.flow import OMEGA, UNLOADING, make_model
from drillenv.dynamics.motion import Motion, checked_place, motion, motion_of, point_from_xf
from drillenv.dynamics.orbits import M_CONTACTS, M_IMPACTS, MOTION_SIZE, STABLE, describe, length_scale, map_point
from drillenv.dynamics.survey import as_survey, multipliers_of
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

KINDS = ("period doubling", "fold", "grazing", "Neimark-Sacker", "jump")

LONGEST_STEP, FIRST_STEP, SHORTEST_STEP = 0.02, 2e-3, 1e-9
ARRIVED = 1e-10
"""Steps along the curve, and how near its end it is left; the swept range and the length scale of the motion are 1."""
MOST_STEPS = 5000
CLOSED = 1e-11
"""An orbit has been found when it comes back to within this many length scales."""
HALVED, NEARLY_HALVED = 1e-7, 1e-3
"""A second half closer to the first than this many length scales is the same: the orbit is one of half the period. One
that ends this near to it, and this near in the swept range to where that one changes its stability, closes on it."""
ON_CIRCLE = 0.99
"""A multiplier that is not this large on the last orbit did not end it: then the multipliers jumped, in a grazing."""
JUMP_TOLERANCE = 1e-6
"""Share of the value to which a jump is located by runs."""


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """Where a motion ends, by :func:`boundary` or :func:`boundaries`."""

    kind: str
    """What ends it. "period doubling": a multiplier passes -1, or a motion of twice the period closes on the one of
    half its length. "fold": a multiplier reaches +1, where the orbit turns back together with an unstable one.
    "grazing": an impact comes or goes, either a turn within a contact or a contact of its own that begins and ends as a
    touch. At a touch the derivative of the map jumps, since one, however light, moves Xf by its depth times
    1 - k_l / k_u; so the orbit goes on with other multipliers, or is unstable or turns back at once. "Neimark-Sacker":
    a pair of multipliers leaves the unit circle. "jump": the rig went over to another motion although no orbit ended
    there, or from one that has no orbit; then the value comes from runs."""
    over: str
    """What was swept: frequency (Hz), amplitude (V), pressure (bar) or stiffness (k_l in N/m)."""
    value: float
    """Where."""
    error: float
    """Width of the bracket in which the value lies."""
    label: str
    """The motion that ends."""
    beyond: str
    """The motion after it. From ``boundary``: of a grazing, the orbit's new label; else where the rig settles from the
    orbit's end, a little way on."""
    multipliers: np.ndarray
    """(4,) complex, the largest modulus first, of the orbit at the boundary; where a motion of period 2n closes on
    one of period n, those of the latter. NaN for a jump."""
    contacts: tuple[int, int]
    """Contacts a motion on the orbit's two sides of the boundary; (0, 0) for a jump."""
    setting: Setting
    """The setting at the boundary."""
    rock: Rock
    rig: Rig
    direction: str
    """"up" or "down": which way the value went when the motion ended."""
    followed: str
    """"forward" where the orbit that ends was followed to its end; "backward" where the motion after it was, since the
    one that ends has no orbit; "none" for a jump."""


class OrbitLostError(InputError):
    """An orbit could not be followed any further, and did not end either."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A point of the curve of orbits."""

    at: np.ndarray
    """(5,) the orbit's point and the swept value, scaled."""
    tangent: np.ndarray
    """(5,) unit vector along the curve, the way it is followed."""
    monodromy: np.ndarray
    """(4, 4) derivative of the map around the orbit, scaled like the point."""
    swing: np.ndarray
    """(4,) from the point to the one half a period on; zero where the period is odd."""
    impacts: int
    contacts: int
    effort: int
    """Newton steps it took."""

    @property
    def multipliers(self) -> np.ndarray:
        """(4,) the largest modulus first."""
        return multipliers_of(self.monodromy)

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return bool(abs(self.multipliers[0]) < 1.0)


class Curve:
    """The orbits of one period along a swept value."""

    setting: Setting
    rock: Rock
    rig: Rig
    over: str
    period: int
    impacts: int
    label: str

    def __init__(self, begin: Motion, over: str, towards: float) -> None:
        self.setting, self.rock, self.rig, self.over = begin.setting, begin.rock, begin.rig, over
        self.period, self.impacts, self.label = begin.period, round(begin.impacts), begin.label
        model = make_model(self.rig, self.rock, self.setting)
        length = length_scale(model)
        speed = length * model[0, OMEGA]
        self.inside: float = value_of(self.setting, self.rock, over)
        self.outside = towards
        self.scales: np.ndarray = np.array([length, speed, speed, length, abs(towards - self.inside)])
        self.first: np.ndarray = np.append(point_from_xf(begin, model), self.inside) / self.scales

    def value(self, at: np.ndarray) -> float:
        """The swept value at a point of the curve."""
        return float(at[4] * self.scales[4])

    def model(self, value: float) -> np.ndarray:
        """The rig on the rock at a swept value."""
        setting, rock = place_at(self.setting, self.rock, self.over, value)
        return make_model(self.rig, rock, setting)

    def miss(self, at: np.ndarray, period: int) -> tuple[np.ndarray, np.ndarray]:
        """(4,) from a point to its image ``period`` on, and (4, 4) the derivative of the map, both scaled."""
        image, tangent = np.empty(4), np.empty((4, 4))
        scales = self.scales[:4]
        map_point(self.model(self.value(at)), at[:4] * scales, UNLOADING, period, image, tangent)
        return image / scales - at[:4], tangent * scales / scales[:, None]

    def gradient(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F, its (4, 5) derivative by the point and the value, and the derivative of the map."""
        miss, monodromy = self.miss(at, self.period)
        # the value's column needs few digits: it steers Newton's method, which ends on F = 0 whatever its accuracy
        step = np.zeros(5)
        step[4] = math.copysign(1e-7, self.inside - self.value(at)) * max(1.0, abs(at[4]) * 1e-2)
        by_value = (self.miss(at + step, self.period)[0] - miss) / step[4]
        return miss, np.column_stack([monodromy - np.eye(4), by_value]), monodromy

    def correct(self, guess: np.ndarray, normal: np.ndarray) -> Place | None:
        """The point of the curve on the plane through ``guess`` across ``normal``; None where Newton finds none."""
        at = guess.copy()
        previous = math.inf
        for effort in range(1, 16):
            try:
                miss, gradient, monodromy = self.gradient(at)
            except InputError:  # beyond what a setting may be
                return None
            size = float(np.abs(miss).max())
            if not size < 1e3:
                return None
            bordered = np.vstack([gradient, normal])
            if size < CLOSED and size >= 0.5 * previous:
                return self.place(at, bordered, monodromy, effort)
            previous = size
            try:
                at = at - np.linalg.solve(bordered, np.append(miss, normal @ (at - guess)))
            except np.linalg.LinAlgError:
                return None
        return None

    def place(self, at: np.ndarray, bordered: np.ndarray, monodromy: np.ndarray, effort: int) -> Place | None:
        """A point of the curve with all that is watched on it."""
        try:
            tangent = np.linalg.solve(bordered, np.array([0.0, 0.0, 0.0, 0.0, 1.0]))
        except np.linalg.LinAlgError:
            return None
        out = np.empty(MOTION_SIZE)
        describe(self.model(self.value(at)), at[:4] * self.scales[:4], UNLOADING, self.period, out)
        swing = np.zeros(4) if self.period % 2 else self.miss(at, self.period // 2)[0]
        impacts, contacts = round(out[M_IMPACTS]), round(out[M_CONTACTS])
        return Place(at, tangent / np.linalg.norm(tangent), monodromy, swing, impacts, contacts, effort)

    def begin(self) -> Place:
        """The motion itself, facing the way to be followed."""
        heading = np.array([0.0, 0.0, 0.0, 0.0, math.copysign(1.0, self.outside - self.inside)])
        start = self.correct(self.first, heading)
        if start is None:
            raise OrbitLostError(
                f"the orbit {self.label} at {self.over} {self.inside:g} cannot be followed: start elsewhere"
            )
        return start

    def halves(self, before: Place, after: Place) -> bool:
        """Whether the orbit has become one of half the period, or passed through it: then the halves change places."""
        if self.period % 2:
            return False
        return bool(before.swing @ after.swing <= 0.0 or np.abs(after.swing).max() < HALVED)

    def goes_on(self, before: Place, after: Place) -> bool:
        """Whether the motion keeps its label and its stability from one point to the next, and the curve its way."""
        onward = after.tangent[4] * before.tangent[4] > 0.0
        return after.impacts == self.impacts and after.stable and onward and not self.halves(before, after)

    def step(self, before: Place, length: float) -> Place | None:
        """The point of the curve about ``length`` on; None where it is not surely on the same curve."""
        guess = before.at + length * before.tangent
        after = self.correct(guess, before.tangent)
        if after is None or np.linalg.norm(after.at - guess) > 0.5 * length:
            return None
        return after

    def follow(self) -> tuple[Place, Place] | None:
        """The last point of the motion and the first past it, or None if the motion reaches the outside value."""
        here, length = self.begin(), FIRST_STEP
        for _ in range(MOST_STEPS):
            left = self.outside / self.scales[4] - here.at[4]
            if left * (self.outside - self.inside) < 0.0 or abs(left) < ARRIVED:
                return None
            there = self.step(here, min(length, left / here.tangent[4]))
            sharp = there is None or there.tangent @ here.tangent < 0.9
            if sharp and length > SHORTEST_STEP:
                length *= 0.5
                continue
            if there is None:
                break
            if not self.goes_on(here, there):
                return self.bisect(here, there)
            quick = there.effort <= 5 and there.tangent @ here.tangent > 0.99
            here, length = there, min(LONGEST_STEP, length * (1.5 if quick else 1.0))
        raise OrbitLostError(
            f"the orbit {self.label} is lost at {self.over} {self.value(here.at):.9g}, where it neither ends nor can "
            "be followed: give an outside value closer to the inside"
        )

    def bisect(self, last: Place, past: Place) -> tuple[Place, Place]:
        """The end of the motion between two points, from ever closer to it and with half the step each time."""
        length = float(np.linalg.norm(past.at - last.at))
        while length > 1e-15 * (1.0 + abs(last.at[4])):
            length *= 0.5
            trial = self.step(last, length)
            if trial is None:
                continue
            if self.goes_on(last, trial):
                last = trial
            else:
                past = trial
        return last, past

    def halved(self, last: Place) -> tuple[float, np.ndarray] | None:
        """Where the orbit of half the period has the multiplier -1, near the end of this one, and its derivative there.

        By the secant method on the orbit of half the period, which goes through that value smoothly.
        """
        half = copy.copy(self)
        half.period = self.period // 2
        fixed = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
        guess = last.at + np.append(0.5 * last.swing, 0.0)
        earlier: tuple[float, float] | None = None
        for _ in range(30):
            place = half.correct(guess, fixed)
            if place is None:
                return None
            here = float(place.at[4])
            multipliers = place.multipliers
            real = np.real(multipliers[np.abs(np.imag(multipliers)) < 1e-9])
            above = float(real[np.argmin(np.abs(real + 1.0))]) + 1.0 if real.size else math.nan
            if abs(above) < 1e-10:  # rounding of a long orbit
                return half.value(place.at), place.monodromy
            change = 1e-5 if earlier is None else -above * (here - earlier[0]) / (above - earlier[1])
            if not abs(change) < LONGEST_STEP:
                return None
            earlier = here, above
            guess = place.at + change * fixed
            if guess[4] == here:
                return half.value(place.at), place.monodromy
        return None

    def motion(self, place: Place) -> Motion:
        """A point of the curve as a motion."""
        setting, rock = place_at(self.setting, self.rock, self.over, self.value(place.at))
        model = make_model(self.rig, rock, setting)
        out = np.zeros((1, MOTION_SIZE))
        scales = self.scales[:4]
        describe(model, place.at[:4] * scales, UNLOADING, self.period, out[0])
        out[0, STABLE] = place.stable
        row = as_survey(out, (place.monodromy * scales[:, None] / scales)[None], model[0, OMEGA : OMEGA + 1])[0]
        return motion_of(row, setting, rock, self.rig)


def boundary(
    setting: Setting,
    over: str,
    inside: float,
    outside: float,
    rock: int | str | Rock = 4,
    rig: Rig | None = None,
    start: Motion | None = None,
) -> Boundary:
    """The value at which the motion found at ``inside`` ends on the way to ``outside``.

    Args:
        setting: The controls; the one of ``over`` is replaced.
        over: "frequency" (Hz), "amplitude" (V), "pressure" (bar) or "stiffness" (k_l in N/m; k_u / k_l stays).
        inside: Where the motion is; it must have a period there.
        outside: Where it is sought no further.
        rock: Case of Table 2.2, name, or Rock.
        rig: By default that of Table 2.1.
        start: A motion to start from at ``inside``, where several coexist; by default the rig starts at rest.

    Raises:
        InputError: an argument of the wrong kind or outside its limits, a motion without period at ``inside``, or one
            that lives on up to ``outside``.
    """
    setting, chosen, rig = checked_place(setting, rock, rig)
    over = choice("over", over, tuple(CONTROLS))
    low, high, unit = CONTROLS[over]
    inside = number("inside", inside, low, high, unit, SLIPS[over])
    outside = number("outside", outside, low, high, unit, SLIPS[over])
    if inside == outside:
        raise InputError(f"inside and outside are both {inside:g} {unit}: give two values")
    here, pair = place_at(setting, chosen, over, inside)
    begin = motion(here, pair, rig, start)
    if not begin.period:
        raise InputError(
            f"the motion at {over} {inside:g} {unit} is {begin.label}: only a periodic one can be followed"
        )
    curve = Curve(begin, over, outside)
    end = curve.follow()
    if end is None:
        raise InputError(
            f"{begin.label} lives on from {over} {inside:g} to {outside:g} {unit}: no boundary there; give a value "
            "farther outside"
        )
    return _boundary(curve, *end)


def boundaries(swept: Sweep, direction: str = "both") -> list[Boundary]:
    """Every change of label along a sweep, each refined to a value and a kind.

    Of two neighbouring points with different labels the orbit of the first is followed to its end. Where it has none,
    or does not end there, the orbit of the second is followed back to where it begins; where that does not begin there
    either, the rig jumped, and runs say at which value. Two changes within one step of the sweep come out as the first.

    Args:
        swept: By :func:`drillenv.atlas.sweep.sweep`.
        direction: "up", "down" or "both": which way of the sweep.

    Returns:
        In the order in which the rig met them, the way up first.

    Raises:
        InputError: not a sweep, a direction that it does not have, or a sweep with effects, whose orbits cannot be
            followed.
    """
    if not isinstance(swept, Sweep):
        raise InputError(f"swept is {shown(swept)}: give a Sweep, from sweep(setting, over, start, stop, step)")
    if swept.effects:
        names = ", ".join(each.effect.name for each in swept.effects)
        raise InputError(f"swept has effects ({names}): give a sweep of the paper's model, or sweep in smaller steps")
    wanted = swept.directions if choice("direction", direction, (*DIRECTIONS, "both")) == "both" else (direction,)
    found = []
    for way in wanted:
        names = swept.labels(way)
        order = np.arange(len(names))[:: 1 if way == "up" else -1]
        for i, j in itertools.pairwise(order):
            if names[i] != names[j]:
                found.append(_change(swept, way, int(i), int(j)))
    return found


def _change(swept: Sweep, way: str, i: int, j: int) -> Boundary:
    """What happened between the neighbouring points ``i`` and then ``j`` of a sweep."""
    first, second = swept.motion(i, way), swept.motion(j, way)
    for begin, towards, followed in ((first, swept.values[j], "forward"), (second, swept.values[i], "backward")):
        if not begin.period:
            continue
        curve = Curve(begin, swept.over, float(towards))
        try:
            end = curve.follow()
        except OrbitLostError:
            continue
        if end is not None:
            return _boundary(curve, *end, named=(first.label, second.label, way, followed))
    return _jump(swept.over, way, first, second)


def _boundary(curve: Curve, last: Place, past: Place, named: tuple[str, str, str, str] | None = None) -> Boundary:
    """The end of a motion between the last point of it and the first one past it."""
    kind, value, monodromy = _kind(curve, last, past)
    setting, rock = place_at(curve.setting, curve.rock, curve.over, value)
    if named is None:
        way = "up" if curve.outside > curve.inside else "down"
        named = (curve.label, _beyond(curve, kind, last, past), way, "forward")
    return Boundary(
        kind=kind,
        over=curve.over,
        value=value,
        error=max(abs(curve.value(past.at) - value), abs(curve.value(last.at) - value)),
        label=named[0],
        beyond=named[1],
        multipliers=multipliers_of(monodromy),
        contacts=(last.contacts, past.contacts),
        setting=setting,
        rock=rock,
        rig=curve.rig,
        direction=named[2],
        followed=named[3],
    )


def _kind(curve: Curve, last: Place, past: Place) -> tuple[str, float, np.ndarray]:
    """What ends the motion, the value, and the derivative of the map whose multipliers show it."""
    value = curve.value(last.at)
    if np.abs(last.swing).max() < NEARLY_HALVED and curve.period % 2 == 0:
        half = curve.halved(last)
        if half is not None and abs(half[0] - value) < NEARLY_HALVED * curve.scales[4]:
            return "period doubling", *half
    largest = last.multipliers[0]
    turned = past.tangent[4] * last.tangent[4] <= 0.0
    if abs(largest) < ON_CIRCLE or (past.stable and not turned):
        return "grazing", value, last.monodromy
    if abs(largest.imag) > 1e-9:
        return "Neimark-Sacker", value, last.monodromy
    return ("fold" if largest.real > 0.0 else "period doubling"), value, last.monodromy


def _beyond(curve: Curve, kind: str, last: Place, past: Place) -> str:
    """Where the rig settles past the boundary, from the orbit's end."""
    if kind == "grazing":
        return f"P-{curve.period}-I-{past.impacts}"
    low, high, _unit = CONTROLS[curve.over]
    onward = curve.value(last.at) * (1.0 + math.copysign(2e-4, curve.outside - curve.inside))
    setting, rock = place_at(curve.setting, curve.rock, curve.over, min(max(onward, low), high))
    return motion(
        setting,
        rock,
        curve.rig,
        curve.motion(last),
    ).label


def _jump(over: str, way: str, first: Motion, second: Motion) -> Boundary:
    """Where the rig, started from its first motion, settles on another, by runs at values halved in between."""
    near, far = value_of(first.setting, first.rock, over), value_of(second.setting, second.rock, over)
    while abs(far - near) > JUMP_TOLERANCE * abs(near):
        middle = 0.5 * (near + far)
        if _keeps(first, over, middle):
            near = middle
        else:
            far = middle
    setting, rock = place_at(first.setting, first.rock, over, near)
    return Boundary(
        kind="jump",
        over=over,
        value=near,
        error=abs(far - near),
        label=first.label,
        beyond=second.label,
        multipliers=np.full(4, np.nan + 0j),
        contacts=(0, 0),
        setting=setting,
        rock=rock,
        rig=first.rig,
        direction=way,
        followed="none",
    )


def _keeps(first: Motion, over: str, value: float) -> bool:
    """Whether the rig keeps its motion, in label, when taken to a value."""
    setting, rock = place_at(first.setting, first.rock, over, value)
    return motion(setting, rock, first.rig, first).label == first.label
