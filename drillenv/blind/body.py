"""A single body that conceals physics: mass * acceleration = force - law(position, velocity).

It is shaken, follows a path on an axis, or is pulled aside and let go. As :mod:`drillenv.blind.rig` it shares nothing
with the package's engines. The classical Runge-Kutta method takes steps of 50 us; friction is rounded, so that nothing
has to be located.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drillenv.blind import curves, laws
from drillenv.blind.body_mechanisms import (
    BODY_MECHANISMS,
    FORCE,
    ON_AXIS,
    SATURATING_SPRING,
    TRAVEL,
    Scale,
    acts_over,
    scaled,
)
from drillenv.blind.campaigns import Card, Made, Planned, deal, schedule
from drillenv.blind.laws import BACKLASH, DAMPER, DRY, LIMIT, SPRING, VISCOUS
from drillenv.blind.mechanisms import ANYWHERE, Concealed
from drillenv.recordings import Campaign, Channel, Nominal, Recording

Floats = NDArray[np.float64]

STEP = 5e-5
RATE = 1000.0
SECONDS = 4.0
UNITS = {"mass": "kg", "stiffness": "N/m", "damping": "N*s/m", "offset": "N"}
UNITS_READ = {"force": "N", "position": "m", "acceleration": "m/s^2"}
"""Of the channels."""
TOLERANCES = {"mass": 0.01, "stiffness": 0.02, "damping": 0.03}
"""Standard deviations of what a lab states, as shares."""
WRONG = (6.0, 10.0)
"""Tolerances by which a wrong constant is off."""

BODY_GROUPS = {
    "null": 4,
    "wrong-constant": 3,
    "library-equation": 6,
    "other-equation": 12,
    "weak-third": 5,
    "two": 6,
    "no-force": 6,
    "beside-wrong-constant": 3,
    "noisy": 3,
}
"""Groups of campaigns of single bodies, and how many of each 48 are of each."""

DECKS = {"library-equation": "library", "other-equation": "other", "no-force": "no-force"}
"""From which a group's mechanism is dealt, where not from all."""


class Body(NamedTuple):
    """Constants in SI. A body on an axis has no spring."""

    mass: float
    stiffness: float
    damping: float
    offset: float
    """N, of the law."""


class BodyMotion(NamedTuple):
    """A run; arrays have shape (steps,), SI."""

    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    force: Floats
    """Asked of the actuator, which is what is recorded."""
    added: Floats
    """Of the concealed physics."""


# --- Motion


@njit(cache=True)
def _asked(tones, t, x, v, mass, pace):
    """Force asked of the actuator at a time: tones, or, on an axis, a controller that follows them."""
    wave, slope = 0.0, 0.0
    for i in range(tones.shape[0]):
        w = 2.0 * math.pi * tones[i, 1]
        wave += tones[i, 0] * math.sin(w * t + tones[i, 2])
        slope += tones[i, 0] * w * math.cos(w * t + tones[i, 2])
    return wave if pace == 0.0 else mass * (pace * pace * (wave - x) + 1.4 * pace * (slope - v))


@njit(cache=True)
def _rates(body, codes, p, tones, pace, t, x, v, bent):
    """Acceleration, rate of the bristles, the force asked for and that of the concealed physics."""
    mass, k, c, offset = body
    asked = _asked(tones, t, x, v, mass, pace)
    added, bends = 0.0, 0.0
    if codes[LIMIT] == SATURATING_SPRING:
        added -= laws.spring_saturation(codes[LIMIT], p[LIMIT], x)
    else:
        added += laws.limited(codes[LIMIT], p[LIMIT], asked) - asked
    added -= laws.spring_force(codes[SPRING], p[SPRING], x) + laws.backlash_force(codes[BACKLASH], p[BACKLASH], x, k)
    added -= laws.damper_force(codes[DAMPER], p[DAMPER], v) + laws.viscous_force(codes[VISCOUS], p[VISCOUS], v)
    if codes[DRY] >= 4:
        friction, bends = laws.bristle_force(codes[DRY], p[DRY], v, bent)
        added -= friction
    else:
        added -= laws.sliding_force(codes[DRY], p[DRY], v)
    return (asked + added - k * x - c * v - offset) / mass, bends, asked, added


@njit(cache=True)
def _integrate(body, codes, p, tones, pace, x, v, h, table):
    bent = 0.0
    for n in range(table.shape[0]):
        t = n * h
        a1, b1, asked, added = _rates(body, codes, p, tones, pace, t, x, v, bent)
        table[n, 0], table[n, 1], table[n, 2], table[n, 3], table[n, 4], table[n, 5] = t, x, v, a1, asked, added
        v2 = v + 0.5 * h * a1
        a2, b2, _, _ = _rates(body, codes, p, tones, pace, t + 0.5 * h, x + 0.5 * h * v, v2, bent + 0.5 * h * b1)
        v3 = v + 0.5 * h * a2
        a3, b3, _, _ = _rates(body, codes, p, tones, pace, t + 0.5 * h, x + 0.5 * h * v2, v3, bent + 0.5 * h * b2)
        v4 = v + h * a3
        a4, b4, _, _ = _rates(body, codes, p, tones, pace, t + h, x + h * v3, v4, bent + h * b3)
        x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        bent += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)


def move_body(
    body: Body,
    hidden: Sequence[Concealed],
    tones: Floats,
    pace: float,
    start: tuple[float, float],
    seconds: float = SECONDS,
) -> BodyMotion:
    """Run a single body.

    Args:
        body: Its constants.
        hidden: What it conceals, parameters in SI.
        tones: (tones, 3) amplitude, frequency in Hz and phase in rad of the force, or on an axis of the path in m.
        pace: rad/s of the controller of an axis; 0 where there is none.
        start: Position and velocity.
        seconds: Duration.

    Raises:
        ArithmeticError: the motion left all bounds.
    """
    codes, p = np.zeros(laws.PLACES, dtype=np.int64), np.zeros((laws.PLACES, laws.PARAMETERS))
    for each in hidden:
        assert each.equation.place is not None
        codes[each.equation.place] = each.equation.code
        p[each.equation.place, : len(each.parameters)] = list(each.parameters.values())
    table = np.empty((round(seconds / STEP), len(BodyMotion._fields)))
    _integrate(tuple(map(float, body)), codes, p, tones, pace, start[0], start[1], STEP, table)
    if not np.max(np.abs(table[:, 1])) < 100.0 * TRAVEL:
        raise ArithmeticError("the concealed body left all bounds: its spring softens too much")
    return BodyMotion(*np.ascontiguousarray(table.T))


# --- Campaigns


def plan_bodies(seed: int, campaigns: int) -> list[Planned]:
    """For each campaign its group and the mechanisms that it conceals, dealt from shuffled decks."""
    rng = np.random.default_rng((seed, 0))
    decks: dict[str, list[Card]] = {}
    cards = [(name, i) for name, each in BODY_MECHANISMS.items() for i in range(len(each.equations))]
    chosen = {
        "library": [card for card in cards if BODY_MECHANISMS[card[0]].equations[card[1]].of_library],
        "other": [card for card in cards if not BODY_MECHANISMS[card[0]].equations[card[1]].of_library],
        "no-force": [card for card in cards if acts_over(*card) != FORCE],
        "any": cards,
    }

    def dealt_from(deck: str) -> Card:
        return deal(rng, decks, deck, chosen[deck])

    def two() -> list[Card]:
        """One by the library's equation, and another one; by another equation it is over another argument."""
        second = "other" if rng.random() < 0.5 else "library"
        while True:
            first, other = dealt_from("library"), dealt_from(second)
            if first[0] != other[0] and (second == "library" or acts_over(*first) != acts_over(*other)):
                return [first, other]

    planned = []
    for group in schedule(campaigns, BODY_GROUPS):
        if group in ("null", "wrong-constant"):
            dealt: list[Card] = []
        elif group == "two":
            dealt = two()
        else:
            dealt = [dealt_from(DECKS.get(group, "any"))]
        planned.append(Planned(group, dealt))
    return planned


def make_body_campaign(seed: int, index: int, planned: Planned) -> Made:
    """Draw and record one campaign of a single body; seed and index give all randomness."""
    rng = np.random.default_rng((seed, 2, index))
    group, cards, _ = planned
    share = 1 / 3 if group == "weak-third" else 1.0
    forced = group != "no-force"
    axis = forced and (all(name in ON_AXIS for name, _ in cards) if cards else bool(rng.random() < 0.5))
    body, scale = _drawn_body(rng, axis)
    hidden = []
    for name, i in cards:
        equation = BODY_MECHANISMS[name].equations[i]
        drawn = Concealed(name, equation, MappingProxyType(equation.draw(rng, share, ANYWHERE)))
        hidden.append(scaled(drawn, share, scale, body.mass))
    if any(each.mechanism == "viscous-damping" for each in hidden):
        body = body._replace(damping=0.0)
    wrong = {}
    if group in ("wrong-constant", "beside-wrong-constant"):
        names = ["mass"] + (["damping"] if body.damping > 0.0 and axis else []) + ([] if axis else ["stiffness"])
        wrong = {str(rng.choice(names)): float(rng.choice([-1.0, 1.0])) * float(rng.uniform(*WRONG))}
    noise = (5.0 if group == "noisy" else 1.0) * float(np.exp(rng.uniform(-0.4, 0.4)))
    runs = [
        _run(rng, body, hidden, scale, axis, i) if forced else _let_go(rng, body, hidden, scale, i) for i in range(6)
    ]
    sizes = (0.004 * scale.force * noise, 1e-5 * TRAVEL * noise, 0.004 * scale.force / body.mass * noise)
    channels = ["position", *(["force"] if forced else []), *([] if axis else ["acceleration"])]
    recordings = tuple(_recording(rng, run, channels, sizes, f"r{i + 1:02d}") for i, run in enumerate(runs))
    nominal = _stated(rng, body, wrong, scale)
    campaign = Campaign(f"campaign {index + 1}", "one-body", nominal, recordings, Path("."))
    return Made(campaign, _answer(group, hidden, body, wrong, scale, runs, sizes), body, tuple(hidden))


def _drawn_body(rng: np.random.Generator, axis: bool) -> tuple[Body, Scale]:
    mass = float(np.exp(rng.uniform(math.log(0.5), math.log(50.0))))
    hertz = 1.2 if axis else float(rng.uniform(3.0, 6.0))
    speed = TRAVEL * 2.0 * math.pi * hertz
    stiffness = 0.0 if axis else mass * (2.0 * math.pi * hertz) ** 2
    damping = mass * float(rng.uniform(2.0, 5.0)) if axis else 0.1 * mass * 2.0 * math.pi * hertz
    force = mass * speed * 2.0 * math.pi * 1.5 if axis else stiffness * TRAVEL
    body = Body(mass, stiffness, damping, 0.03 * force * float(rng.normal()))
    return body, Scale(force, speed, stiffness, 0.9 * force)


def _run(rng, body: Body, hidden, scale: Scale, axis: bool, number: int) -> BodyMotion:
    """One recording's motion: a path followed, or the body shaken by tones below, near and above its own frequency."""
    phases, size = rng.uniform(0.0, 2.0 * math.pi, 3), 0.6 + 0.12 * number
    if axis:
        tones = np.column_stack([TRAVEL * size * rng.uniform(0.2, 0.5, 3), (0.5, 1.1, 2.3), phases])
        place = float(tones[:, 0] @ np.sin(phases))
        start = place, float((tones[:, 0] * 2.0 * math.pi * tones[:, 1]) @ np.cos(phases))
        return move_body(body, hidden, tones, 2.0 * math.pi * 6.0, start)
    hertz = math.sqrt(body.stiffness / body.mass) / (2.0 * math.pi)
    tones = np.column_stack([0.25 * scale.force * size * np.ones(3), hertz * np.array([0.4, 0.9, 1.6]), phases])
    return move_body(body, hidden, tones, 0.0, (0.0, 0.0))


def _let_go(rng, body: Body, hidden, scale: Scale, number: int) -> BodyMotion:
    """One recording's motion where nothing pushes: the body is pulled to one side and the other, and let go."""
    start = (-1.0) ** number * TRAVEL * (0.6 + 0.12 * number), scale.speed * float(rng.uniform(-0.3, 0.3))
    return move_body(body, hidden, np.zeros((1, 3)), 0.0, start)


def _recording(rng, run: BodyMotion, channels: Sequence[str], sizes, name: str) -> Recording:
    every, noise = round(1.0 / (RATE * STEP)), dict(zip(UNITS_READ, sizes, strict=True))

    def read(channel: str) -> Channel:
        kept = getattr(run, channel)[::every]
        return Channel(kept + rng.normal(0.0, noise[channel], kept.size), UNITS_READ[channel], channel)

    return Recording(name, f"{name}.csv", RATE, {channel: read(channel) for channel in channels})


def _stated(rng, body: Body, wrong, scale: Scale) -> dict[str, Nominal]:
    """What the lab states: unclipped; constants that are 0 are not in its law."""
    found = {}
    for name, value in body._asdict().items():
        if value == 0.0:
            continue
        std = TOLERANCES[name] * abs(value) if name in TOLERANCES else 0.01 * scale.force
        found[name] = Nominal(value - std * (float(rng.normal()) + wrong.get(name, 0.0)), std, UNITS[name])
    return found


def _answer(group, hidden, body: Body, wrong, scale: Scale, runs, sizes) -> dict[str, Any]:
    def span(values: Sequence[Floats]) -> tuple[float, float]:
        low, high = np.percentile(np.concatenate(values), [1.0, 99.0])
        return float(low), float(high)

    position, velocity = span([run.position for run in runs]), span([run.velocity for run in runs])
    ranges = {"shortening": position, "beyond": position, "closing": velocity, "drive": span([r.force for r in runs])}
    where = curves.Reference(0.0, body.stiffness, 0.0, 0.0, 0.0, ranges)
    added = float(np.sqrt(np.mean([np.mean(run.added**2) for run in runs])))
    verdict = {"null": "agrees", "wrong-constant": "parameters"}.get(group, "missing-physics")
    return {
        "group": group,
        "verdict": verdict,
        "mechanisms": [
            {
                "mechanism": each.mechanism,
                "equation": each.equation.name,
                "of_library": each.equation.of_library,
                "parameters": dict(each.parameters),
                "law": curves.law_of(each, where, (1.0, 1.0, 1.0)),
            }
            for each in hidden
        ],
        "wrong": {name: getattr(body, name) for name in wrong},
        "true": body._asdict(),
        "missing": {"body": added},
        "reference": where._asdict(),
        "conditions": {"noise": [1.0, sizes[0], sizes[2]], "rate": RATE},
    }
