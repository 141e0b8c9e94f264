"""One body: the terms of its force balance. Constants of the law, and what each mechanism would add.

    force = mass * acceleration + damping * velocity + stiffness * position + coulomb * sign(velocity) + offset + ...

A term is a column of numbers, one a row of a recording, times a strength. Where no force is measured, the measured
acceleration times the stated mass stands on the left with its sign turned, and no mass on the right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drillenv.diagnosis.one_body.channels import Body
from drillenv.recordings import Campaign

UNITS = {"mass": "kg", "damping": "N*s/m", "stiffness": "N/m", "coulomb": "N", "offset": "N"}
UNSTATED = 0.02
"""Tolerance of a constant that is stated without one, over its value."""
APART = 1.0
"""Samples that two channels may be apart: a force is held from one to the next, a reading may be old."""
HALF = 0.5
"""Of a sample, by which holding makes a force lag."""
SCALE = 1e-3
"""s, of a lag."""
MAINS = (50.0, 60.0)
RIPPLES = 40
"""Periods over the range of the position that a force periodic in it may have."""

Column = Callable[[Body], np.ndarray]


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A term of the balance."""

    name: str
    column: Column
    """(n,) of a recording."""
    value: float | None = None
    """What is believed of its strength, if anything."""
    std: float | None = None
    """Standard deviation of that belief."""
    local: bool = False
    """Whether its strength holds for one recording only."""


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One way in which a mechanism may be there: its terms at given numbers of its shape."""

    mechanism: str
    terms: tuple[Term, ...]
    shape: tuple[float, ...] = ()
    symbols: tuple[str, ...] = ()
    """Parameters that the numbers of its shape are, where they are parameters."""
    reshaped: Callable[[Sequence[float]], Variant] | None = None
    """The same at other numbers."""
    sensible: Callable[[np.ndarray, dict[str, float]], str] = lambda _strengths, _constants: ""
    """Of its strengths and the constants: why they cannot be, or nothing."""
    named: Callable[[np.ndarray], dict[str, float]] = lambda _strengths: {}
    """Its parameters by symbol."""
    text: str = ""
    """Outside the library: its shape in words, to be completed by the numbers."""


def sign(body: Body) -> np.ndarray:
    """(samples,) which way it moves; 0 where that is not known."""
    return np.where(np.abs(body.smooth_velocity) < body.slow, 0.0, np.sign(body.smooth_velocity))


def target(body: Body, mass: float) -> np.ndarray:
    """(n,) N, the left side of the balance."""
    return body.force if body.force is not None else -mass * body.acceleration


def law_terms(campaign: Campaign, bodies: Sequence[Body], mass: float) -> tuple[Term, ...]:
    """The terms that the lab believes in."""
    columns: dict[str, Column] = {
        "mass": lambda body: body.acceleration,
        "damping": lambda body: body.velocity,
        "stiffness": lambda body: body.position,
        "coulomb": lambda body: body.rows(sign(body)),
        "offset": lambda body: np.ones(body.velocity.size),
    }
    terms = []
    for name, column in columns.items():
        entry = campaign.nominal.get(name)
        if entry is None or (name == "mass" and bodies[0].force is None):
            continue
        std = entry.std
        if std is None and entry.value is not None:
            std = max(UNSTATED * abs(entry.value), 1e-12)
        terms.append(Term(name, column, entry.value, std))
    return tuple(terms)


def timing(mass: float, lag: float | None = None) -> Term:
    """Of a lag in s of the left side behind the motion, held there, or to be fitted."""
    return Term("timing", lambda body: lag_column(body, mass), lag, None if lag is None else 1e-6 * SCALE)


def lag_column(body: Body, mass: float) -> np.ndarray:
    """What the left side lacks for each second that it lags: -force'."""
    return -body.lag_force if body.lag_force is not None else mass * body.lag_acceleration


def _positive(what: str) -> Callable[[np.ndarray, dict[str, float]], str]:
    def sensible(strengths: np.ndarray, _constants: dict[str, float]) -> str:
        return "" if strengths[0] > 0.0 else f"{what} would have to be negative"

    return sensible


def library(campaign: Campaign, bodies: Sequence[Body], mass: float) -> list[Variant]:
    """Every mechanism of the library that one body may have and that the lab's law leaves out."""
    nominal, forced = campaign.nominal, bodies[0].force is not None
    found = []
    if "damping" not in nominal:
        found.append(_simple("viscous-damping", "d", lambda body: body.velocity, "damping"))
    if "coulomb" not in nominal:
        found.append(_simple("dry-friction", "fc", lambda body: body.rows(sign(body)), "friction"))
    if "offset" not in nominal:
        symbol = "o_f" if forced else "o_a"
        turn = 1.0 if forced else -1.0 / mass
        ones = Term("offset", lambda body: np.ones(body.velocity.size))
        found.append(Variant("sensor-offset", (ones,), named=lambda q: {symbol: turn * float(q[0])}))
    found.append(
        _simple(
            "damping-quadratic",
            "c2",
            lambda body: body.rows(np.abs(body.smooth_velocity) * body.smooth_velocity),
            "damping",
        )
    )
    found.append(_simple("stiffness-hardening", "k3", lambda body: body.rows(body.smooth_position**3), "hardening"))
    found += _delays(bodies, mass)
    if forced:
        found += _limits(bodies)
    if "stiffness" in nominal:
        found += _plays(bodies)
    found += [_hum((frequency,), bodies, mass) for frequency in _mains(bodies)]
    return found


def _simple(mechanism: str, symbol: str, column: Column, what: str) -> Variant:
    return Variant(
        mechanism,
        (Term(symbol, column),),
        sensible=_positive(what),
        named=lambda q: {symbol: float(q[0])},
    )


def _delays(bodies: Sequence[Body], mass: float) -> list[Variant]:
    """The left side later than the motion, or earlier, beyond what sampling alone may do."""
    clock = APART / bodies[0].rate
    behind, ahead = ("delay_f", "delay_x") if bodies[0].force is not None else ("delay_a", "delay_x")

    def at(shape: Sequence[float]) -> Variant:
        lag = float(shape[0]) or clock

        def column(body: Body) -> np.ndarray:
            # a difference over the lag itself: its strength is the lag, however long that is
            side = body.smooth_force if body.smooth_force is not None else -mass * body.smooth_acceleration
            places = np.arange(side.size)
            return body.rows(side - np.interp(places + lag * body.rate, places, side)) / lag

        return Variant("channel-delay", (Term("delay", column),), (lag,), (), at, sensible, named)

    def sensible(q: np.ndarray, constants: dict[str, float]) -> str:
        whole = abs(q[0] + constants.get("timing", 0.0))
        return "" if whole > clock else f"{1e6 * whole:.3g} us is less than a sample"

    def named(q: np.ndarray) -> dict[str, float]:
        return {behind if q[0] > 0.0 else ahead: abs(float(q[0]))}

    return [at((clock,)), at((-clock,))]


def _limits(bodies: Sequence[Body]) -> list[Variant]:
    """The applied force clipped: nothing beyond a level reaches the body."""
    every = np.concatenate([np.abs(body.smooth_force) for body in bodies if not body.held])  # type: ignore[arg-type]
    top, usual = float(every.max()), float(np.median(every))

    def at(shape: Sequence[float]) -> Variant:
        level = float(shape[0])

        def column(body: Body) -> np.ndarray:
            assert body.smooth_force is not None
            return body.rows(body.smooth_force - np.clip(body.smooth_force, -level, level))

        return Variant(
            "force-limit",
            (Term("beyond", column, 1.0, 0.1),),
            (level,),
            ("F_max",),
            at,
            lambda q, _constants: "" if 0.6 < q[0] < 1.4 and usual < level < top else "the rest is not like clipping",
            lambda _q: {"F_max": level},
        )

    levels = np.unique(np.quantile(every, (0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.998)))
    return [at((level,)) for level in levels.tolist() if max(usual, 0.2 * top) < level < 0.98 * top]


def _plays(bodies: Sequence[Body]) -> list[Variant]:
    """The spring has no force over a part of its travel."""
    every = np.concatenate([body.position for body in bodies if not body.held])
    low, high = float(every.min()), float(every.max())

    def at(shape: Sequence[float]) -> Variant:
        start, width = (float(each) for each in shape)

        def column(body: Body) -> np.ndarray:
            return -body.rows(np.clip(body.smooth_position - start, 0.0, width))

        def sensible(q: np.ndarray, constants: dict[str, float]) -> str:
            if not (low < start and start + width < high and width > 0.0):
                return "the play would lie beyond the travel"
            share = q[0] / constants.get("stiffness", math.nan)
            return "" if 0.7 < share < 1.3 else f"the spring would lose {share:.2g} of its stiffness, not all of it"

        return Variant(
            "backlash",
            (Term("play", column),),
            (start, width),
            ("y0", "g"),
            at,
            sensible,
            lambda _q: {"g": width, "y0": start},
        )

    span = high - low
    if span <= 0.0:
        return []
    return [
        at((low + start * span, width * span))
        for width in (0.03, 0.1, 0.2, 0.35)
        for start in np.arange(0.05, 0.96 - width, 0.08)
    ]


def _mains(bodies: Sequence[Body]) -> list[float]:
    """Frequencies of the mains to try: nominal, and off by what their regulation allows."""
    longest = max(body.time[-1] for body in bodies)
    step = min(0.05, 0.3 / longest)
    around = np.arange(-0.1, 0.1 + step / 2, step) if step < 0.05 else np.array([0.0])
    return [mains + float(off) for mains in MAINS for off in around if mains < 0.9 * bodies[0].edge]


def _hum(shape: Sequence[float], bodies: Sequence[Body], mass: float) -> Variant:
    frequency = float(shape[0])
    symbol, turn = ("b_f", 1.0) if bodies[0].force is not None else ("b_a", 1.0 / mass)

    def wave(part: Callable[[np.ndarray], np.ndarray], name: str) -> Column:
        def column(body: Body) -> np.ndarray:
            return part(2 * math.pi * frequency * body.time) if body.name == name else np.zeros(body.velocity.size)

        return column

    terms = tuple(
        Term(f"{label} {body.name}", wave(part, body.name), local=True)
        for body in bodies
        if not body.held
        for label, part in (("sine", np.sin), ("cosine", np.cos))
    )

    def named(q: np.ndarray) -> dict[str, float]:
        return {"f_m": frequency, symbol: turn * float(np.sqrt(np.mean(q[0::2] ** 2 + q[1::2] ** 2)))}

    def sensible(q: np.ndarray, _constants: dict[str, float]) -> str:
        sizes = np.hypot(q[0::2], q[1::2])
        return "" if sizes.max() < 3.0 * np.median(sizes) else "its size differs from recording to recording"

    def at(other: Sequence[float]) -> Variant:
        return _hum(other, bodies, mass)

    return Variant("mains-hum", terms, (frequency,), ("f_m",), at, sensible, named)


def outside(bodies: Sequence[Body]) -> list[Variant]:
    """Shapes that no mechanism of the library has, to describe what it cannot explain."""
    every = np.concatenate([body.position[body.keep] for body in bodies if not body.held])
    speeds = np.concatenate([np.abs(body.velocity[body.keep]) for body in bodies if not body.held])
    span = float(np.ptp(every))
    found = [
        Variant(
            "asymmetric",
            (
                Term("speed", lambda body: body.rows(np.abs(body.smooth_velocity))),
                Term("square", lambda body: body.rows(body.smooth_velocity**2)),
            ),
            text="it depends on the way the body moves",
        ),
        Variant(
            "drift",
            (
                Term("time", lambda body: body.time - body.time.mean()),
                Term("friction", lambda body: body.rows(sign(body)) * (body.time / body.time[-1] - 0.5)),
                Term("speed", lambda body: body.velocity * (body.time / body.time[-1] - 0.5)),
            ),
            text="it grows with the time in the recording",
        ),
        Variant(
            "softening",
            (
                Term("square", lambda body: body.rows(body.smooth_position**2)),
                Term("cube", lambda body: body.rows(body.smooth_position**3)),
            ),
            text="it is a curved function of the position",
        ),
        Variant(
            "position damping",
            (
                Term("x v", lambda body: body.rows(body.smooth_position * body.smooth_velocity)),
                Term("x x v", lambda body: body.rows(body.smooth_position**2 * body.smooth_velocity)),
            ),
            text="it brakes more in some positions than in others",
        ),
    ]
    found += [_stribeck(float(scale)) for scale in np.quantile(speeds, (0.1, 0.3, 0.6))]
    if span > 0.0:
        found += [_ripple(span / count) for count in np.arange(1.5, RIPPLES, 0.5)]
    return found


def _stribeck(scale: float) -> Variant:
    def column(body: Body) -> np.ndarray:
        return body.rows(sign(body) * np.exp(-np.abs(body.smooth_velocity) / scale))

    text = f"a friction of its own at low speed, gone above some {2 * scale:.2g} m/s"
    return Variant("friction at low speed", (Term("low", column),), text=text)


def _ripple(length: float) -> Variant:
    def wave(part: Callable[[np.ndarray], np.ndarray]) -> Column:
        return lambda body: body.rows(part(2 * math.pi * body.smooth_position / length))

    text = f"it is periodic in the position, once every {1e3 * length:.3g} mm"
    return Variant("ripple", (Term("sine", wave(np.sin)), Term("cosine", wave(np.cos))), text=text)


def hats(bodies: Sequence[Body], count: int) -> list[Term]:
    """A flexible function of position, speed and both: piecewise linear, ``count`` corners in each."""
    fitted = [body for body in bodies if not body.held]
    terms = []
    for name in ("smooth_position", "smooth_velocity"):
        every = np.concatenate([getattr(body, name) for body in fitted])
        knots = np.unique(np.quantile(every, np.linspace(0.0, 1.0, count)))
        for i in range(knots.size):
            peak = np.eye(knots.size)[i]

            def along(body: Body, name=name, knots=knots, peak=peak) -> np.ndarray:
                return np.interp(getattr(body, name), knots, peak)

            terms.append(Term(f"{name} {i}", lambda body, along=along: body.rows(along(body))))
            if name == "smooth_position" and i % 2 == 0:
                terms.append(Term(f"way {i}", lambda body, along=along: body.rows(along(body) * sign(body))))
                terms.append(
                    Term(f"brake {i}", lambda body, along=along: body.rows(along(body) * body.smooth_velocity))
                )
    return terms


def renamed(term: Term, mechanism: str) -> Term:
    """A term of a mechanism under a name that is its own."""
    return replace(term, name=f"{mechanism} {term.name}")


def widened(terms: Sequence[Term], loose: float) -> tuple[Term, ...]:
    """Beliefs that also bear the tolerance of the mass, where the left side is made with it."""
    return tuple(
        term
        if term.std is None or term.value is None or term.name == "timing"
        else replace(term, std=math.hypot(term.std, loose * term.value))
        for term in terms
    )
