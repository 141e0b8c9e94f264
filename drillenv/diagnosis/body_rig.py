"""The single body as the diagnosis knows it: its law, the families that may be missing, and the library's equations."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from drillenv.diagnosis.adapter import Adapter, Rival
from drillenv.diagnosis.body import (
    Autoregression,
    ForceBalance,
    Forces,
    Nonlinear,
    ScaledLaw,
    Stretch,
    autoregression,
    columns_of,
    equation_force,
    equation_over,
    sliding,
)
from drillenv.diagnosis.body_channels import Body
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import (
    HARDENING,
    SLOW,
    Curve,
    Equation,
    Family,
    FreeLaws,
    bsplines,
    coefficients,
    kinds_of_spring,
    lower_bound,
    normalised,
    odd_with_step,
)
from drillenv.diagnosis.noise import peak_offset
from drillenv.diagnosis.score_tests import most_promising
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.diagnosis.terms import Term, Unknown, mean_amplitude
from drillenv.dynamics.constitutive.places import DAMPER, DRIVE, GUIDE, SPRING
from drillenv.dynamics.effects import REGISTRY, mechanism_of_law
from drillenv.dynamics.forms import Form
from drillenv.recordings import Campaign

UNITS = {"mass": "kg", "damping": "N*s/m", "stiffness": "N/m", "coulomb": "N", "offset": "N"}
UNSTATED = 0.02
"""Tolerance of a constant that is stated without one, over its value."""
SAMPLING = 0.5
"""Samples, standard deviation of what sampling parts two channels by: a force is held, a reading may be old."""
LATE = 3.0
"""Samples, standard deviation of what a channel may come too late by."""
MAINS = (50.0, 60.0)
MAINS_OFF = 0.1
"""Hz that mains may be off."""
RIPPLES = np.arange(1.5, 40.0, 0.5)
"""Periods over the range of the position that a force periodic in it may have."""
FEWEST_CYCLES = 4.0
"""In a recording at least, of a force that goes on by itself."""
STARTS = 2
"""Starts of an equation that are followed to their end."""
SLIDING = 0.3
"""Share of the highest speed from which dry friction changes no more."""
SEEN = 3000
"""Rows at which an equation is compared with a law."""
QUIETER = 0.9
"""Reduced chi-square below which a model leaves less than the richest one."""
SOFT = 0.02
"""Of the typical force: the unit of a law's coefficients."""


class Scale(NamedTuple):
    """What is typical of a body, in SI: most force, travel and speed."""

    force: float
    travel: float
    speed: float

    def of(self, unit: str) -> float:
        """The typical size of a parameter, from its unit: N is the force, m the travel, s the travel over the speed."""
        mass = self.force * self.travel / self.speed**2
        bases = {"N": self.force, "m": self.travel, "s": self.travel / self.speed, "kg": mass, "1": 1.0}
        size, sign = 1.0, 1.0
        for part in unit.replace("*", " ").replace("/", " / ").split():
            if part == "/":
                sign = -1.0
                continue
            base, _, power = part.partition("^")
            size *= bases[base] ** (sign * float(power or 1))
        return size


@dataclass(frozen=True, eq=False)
class BodyRig(Adapter):
    """The adapter of a single body."""

    stretches: Sequence[Stretch]
    """That are fitted."""
    noise: Autoregression
    scale: Scale
    axes: Axes
    stated: tuple[str, ...]
    """Constants of the law."""
    gain: ScaledLaw | None
    """Of the law as it is stated: what is straight in a law over the applied force; None where not all is stated."""

    @property
    def forced(self) -> bool:
        """Whether a force is measured."""
        return self.stretches[0].body.force is not None

    @property
    def band(self) -> float:
        """Share of the highest frequency that rows may have at which the channels' filter ends."""
        body = self.stretches[0].body
        return min(1.0, 2.0 * body.edge * body.every / body.rate)

    @property
    def recordings(self) -> list[str]:
        """Names of those that are fitted."""
        return list(dict.fromkeys(each.body.name for each in self.stretches))

    @property
    def clock(self) -> float:
        """s from one sample to the next."""
        return 1.0 / self.stretches[0].body.rate

    # --- what the fits ask for

    def noise_left(self, fitted: Fitted) -> list[Autoregression]:
        """As it was, or what a model leaves that is richer than the one by which it was estimated."""
        if fitted.reduced_chi_square >= QUIETER:
            return fitted.noise
        left = [block.left(fitted.values) for block in fitted.blocks]
        return [autoregression(left, [block.data.keep for block in fitted.blocks], self.band)] * len(left)

    def axes_at(self, fitted: Fitted) -> Axes:
        """What is measured is visited, whatever the model."""
        return self.axes

    # --- what may be missing

    def laws(self, fitted: Fitted | None, axes: Axes, detail: int = 1) -> list[Family]:
        """Families with free laws."""
        free, unit = FreeLaws(axes, detail), SOFT * self.scale.force
        x = axes.points(GUIDE)[(GRID - 1) // 2 :]
        # what changes with the speed where that is high is the damper's
        low = np.arcsinh(SLOW * np.minimum(x / x[-1], SLIDING))
        rising = bsplines(3 * detail + 3, low)
        friction = Curve("friction", coefficients("friction", len(rising), unit), GUIDE, odd_with_step(rising))
        spring = free.curve("spring", unit, SPRING, free.splines(10))
        damper = free.curve("damper", unit, DAMPER, free.finer_at_zero(9, DAMPER))
        faster = mechanism_of_law("damper" if "damping" in self.stated else "unstated damping")
        found = [
            Family("spring", "spring", (spring,), mechanism_of_law(HARDENING)),
            Family("friction", "friction", (friction,)),
            Family("damper", "damper", (damper,), faster),
        ]
        if self.forced:
            # what is straight would take the measured force for what explains it
            limit = free.curve("applied force", unit, DRIVE, bent(free.splines(9), axes.points(DRIVE)))
            terms = (limit,) if self.gain is None else (limit, self.gain)
            found.append(Family("drive", "drive", terms))
        return found

    def candidates(self, fitted: Fitted) -> list[Family]:
        """Every family of the motion, of the sensors, and what no mechanism of the library has."""
        free = self.laws(fitted, fitted.structure.axes)
        equations = [each for each in fitted.structure.terms if isinstance(each, Equation)]
        if any(self.place_of(each) == DRIVE for each in equations):
            # a free law beside it bends back what it bends, and is straight
            free = [each for each in free if each.name != "drive"]
        return [*free, *self.textbook(free), *self.sensors(), *self.outside()]

    def textbook(self, free: Sequence[Family]) -> list[Family]:
        """Equations with one parameter by which forces are proportional: their score tests are exact."""
        found = []
        for family in free:
            places = {term.place for term in family.terms if isinstance(term, Curve)}
            for each in self.equations(places):
                alone = len(each.form.symbols) == len(each.form.starts) == 1
                if alone and each.name not in {one.name for one in found}:
                    found.append(Family(each.name, family.group, (as_nothing(each),), each.effect, textbook=True))
        return found

    def sensors(self) -> list[Family]:
        """A lag beyond that of sampling, a zero that is off, and hum."""
        unit, found = SOFT * self.scale.force, []
        far = 60.0 * self.clock
        delay = Unknown("delay", 0.0, self.clock, LATE * self.clock, -far, far, "s")
        lag = Nonlinear("lag", (delay,), self.lagged, says=self.delays)
        found.append(Family("lag", "lag", (lag,), textbook=True))
        if "offset" not in self.stated:
            zero = Forces("zero", coefficients("zero", 1, unit), ones, says=self.zeros)
            found.append(Family("offset", "offset", (zero,), textbook=True))
        edge = min(each.body.edge for each in self.stretches)
        return found + [self.hum(line) for line in MAINS if line < 0.9 * edge]

    def hum(self, line: float) -> Family:
        """Of the mains, at a frequency that is the same in all recordings."""
        names = self.recordings

        def force(values: Floats, body: Body) -> Floats:
            if body.name not in names:
                return np.zeros_like(body.velocity)
            sine, cosine = values[1 + 2 * names.index(body.name) :][:2]
            turned = 2.0 * math.pi * values[0] * body.every_time
            return body.rows(sine * np.sin(turned) + cosine * np.cos(turned))

        unknowns = [Unknown("f_m", line, 0.02, MAINS_OFF, line - 2.0 * MAINS_OFF, line + 2.0 * MAINS_OFF, "Hz")]
        for name in names:
            unknowns += coefficients(f"hum {name}", 2, SOFT * self.scale.force)
        term = Nonlinear(f"hum {line:g} Hz", tuple(unknowns), force, says=self.hums)
        return Family(term.name, "hum", (term,), textbook=True)

    def delays(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """The channel that comes later, and by how much."""
        later = ("delay_f" if self.forced else "delay_a") if values[0] > 0.0 else "delay_x"
        # a controller that holds its force from one sample to the next makes half a sample of lag
        std = math.hypot(float(spread[0]), 0.5 * self.clock)
        return {later: {"value": abs(float(values[0])), "std": std, "unit": "s"}}

    def zeros(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """What the channel reads at rest."""
        return {self.reads("o"): self.as_read(values[0], spread[0])}

    def hums(self, values: Floats, spread: Floats) -> dict[str, dict[str, Any]]:
        """The frequency, and the root mean square over recordings of the amplitude."""
        size, std = mean_amplitude(values[1:].reshape(-1, 2), spread[1:])
        frequency = {"value": float(values[0]), "std": float(spread[0]), "unit": "Hz"}
        return {"f_m": frequency, self.reads("b"): self.as_read(size, std, False)}

    def reads(self, letter: str) -> str:
        """A symbol of the channel that is held against the law."""
        return f"{letter}_{'f' if self.forced else 'a'}"

    def as_read(self, force: float, std: float, signed: bool = True) -> dict[str, Any]:
        """A force in N as that channel reads it."""
        if self.forced:
            return {"value": float(force), "std": float(std), "unit": "N"}
        turn = -1.0 if signed else 1.0
        mass = self.stretches[0].mass
        return {"value": turn * float(force) / mass, "std": float(std) / mass, "unit": "m/s^2"}

    def lagged(self, values: Floats, body: Body) -> Floats:
        """(n,) N that are measured too much where the left side comes later than the motion by values[0] s."""
        mass = self.stretches[0].mass
        side = body.smooth_force if body.smooth_force is not None else -mass * body.smooth_acceleration
        places = np.arange(side.size, dtype=float)
        # a difference over at least a sample: to first order it is the lag's, however short that is
        lag = math.copysign(max(abs(float(values[0])), self.clock), float(values[0]) or 1.0)
        change = body.rows(side - np.interp(places + lag * body.rate, places, side))
        return change * (float(values[0]) / lag)

    def outside(self) -> list[Family]:
        """Forces that no mechanism of the library has."""
        unit, scale = SOFT * self.scale.force, self.scale

        def brakes(body: Body) -> Floats:
            x, v = body.smooth_position / scale.travel, body.smooth_velocity / scale.speed
            return np.array([body.rows(x * v), body.rows(x**2 * v), body.rows(x * np.sign(sliding(body)))])

        def grows(body: Body) -> Floats:
            run = body.time / body.time[-1] - 0.5
            return np.array([run, run * body.rows(np.sign(sliding(body))), run * body.velocity / scale.speed])

        brake = Forces("position damping", coefficients("brake", 3, unit), brakes)
        drift = Forces("drift", coefficients("drift", 3, unit), grows)
        return [
            Family(brake.name, brake.name, (brake,), sentence="it brakes more in some positions than in others"),
            Family(drift.name, drift.name, (drift,), sentence="it grows with the time in the recording"),
        ]

    def at_own_frequency(self, fitted: Fitted, there: Collection[str]) -> list[Family]:
        """A force that is periodic in the position, and one that goes on by itself, where a fit leaves most of it."""
        found = []
        if "spring" not in there and self.scale.travel > 0.0:
            span = float(np.ptp(self.axes.points(SPRING)))
            lengths = span / RIPPLES
            best, _gain = most_promising(fitted, [self.ripple(float(each)).terms[0] for each in lengths])
            found.append(replace(self.ripple(float(lengths[best])), look_elsewhere=RIPPLES.size))
        if "tone" not in there:
            tone = self.tone(fitted)
            found += [] if tone is None else [tone]
        return found

    def ripple(self, length: float) -> Family:
        """A force that repeats itself after so many m."""

        def waves(body: Body) -> Floats:
            turned = 2.0 * math.pi * body.smooth_position / length
            return np.array([body.rows(np.sin(turned)), body.rows(np.cos(turned))])

        term = Forces("ripple", coefficients("ripple", 2, SOFT * self.scale.force), waves)
        text = f"it is periodic in the position, once every {1e3 * length:.3g} mm"
        # as is the spring's law, it is one of the position
        return Family("ripple", "spring", (term,), sentence=text)

    def tone(self, fitted: Fitted) -> Family | None:
        """A force that goes on at a frequency of its own, at that of the largest periodogram of what is left."""
        longest = max(each.keep.size for each in self.stretches)
        per_row = min(each.body.rate / each.body.every for each in self.stretches)
        tried = np.arange(FEWEST_CYCLES * per_row / longest, 0.45 * per_row, 0.25 * per_row / longest)
        # what hums is a mechanism of the library
        tried = tried[np.all(np.abs(tried[:, None] - np.array(MAINS)) > 5.0 * MAINS_OFF, axis=1)]
        if tried.size < 3:
            return None
        power = np.zeros(tried.size)
        for block in fitted.blocks:
            left = np.where(block.judged, block.noise.whiten(block.left(fitted.values)), 0.0)
            whole = np.abs(np.fft.rfft(left, 8 * longest)) ** 2 / max(block.samples, 1)
            body = block.data.body
            power += np.interp(tried, np.fft.rfftfreq(8 * longest, body.every / body.rate), whole)
        top = int(np.clip(np.argmax(power), 1, tried.size - 2))
        frequency = float(tried[top] + peak_offset(*power[top - 1 : top + 2]) * (tried[1] - tried[0]))
        names = self.recordings

        def waves(body: Body) -> Floats:
            made = np.zeros((2 * len(names), body.velocity.size))
            if body.name in names:
                turned = 2.0 * math.pi * frequency * body.time
                made[2 * names.index(body.name) :][:2] = np.sin(turned), np.cos(turned)
            return made

        term = Forces("tone", coefficients("tone", 2 * len(names), SOFT * self.scale.force), waves)
        text = f"it is periodic in time, at {frequency:.3g} Hz"
        return Family("tone", "tone", (term,), sentence=text, look_elsewhere=tried.size)

    # --- the library's equations

    def rivals(self, fitted: Fitted, family: Family) -> list[Rival]:
        """The library's equations over the same argument, the nearest first."""
        places = {term.place for term in family.terms if isinstance(term, Curve)}
        found = [self.near(fitted, family, each) for each in self.equations(places)]
        return sorted(found, key=lambda each: each.worse)

    def mechanisms_of(self, family: Family) -> set[str]:
        """The library's mechanisms that a family may turn out to be."""
        places = {term.place for term in family.terms if isinstance(term, Curve)}
        found = {family.mechanism} | {each.effect for each in self.equations(places)}
        return found & set(REGISTRY)

    def equations(self, places: Collection[int]) -> list[Equation]:
        """Those of effects that act on a body by what these laws are over, and are not stated."""
        over, found = {DAMPER if place == GUIDE else place for place in places}, []
        for name, effect in REGISTRY.items():
            if effect.on_body is None or effect.body_constant in self.stated:
                continue
            for form in effect.body_forms:
                unknowns, starts = [], []
                for i, symbol in enumerate(form.symbols):
                    parameter = effect.parameter(symbol)
                    size = self.scale.of(parameter.unit)
                    values = [start[i] * size for start in form.starts]
                    # a spring may soften; what takes energy cannot give it
                    softens = effect.energy == "stores" and parameter.unit != "m" and parameter.low == 0.0
                    low = -1e3 * size if softens else lower_bound(parameter, values, i)
                    unknowns.append(Unknown(symbol, values[0], 0.2 * max(map(abs, values)), math.inf, low, math.inf,
                                            parameter.unit))  # fmt: skip
                    starts.append(values)
                scaled = Form(form.name, form.symbols, tuple(zip(*starts, strict=True)))
                equation = Equation(f"{name}: {form.name}", tuple(unknowns), name, scaled)
                if self.place_of(equation) in over:
                    found.append(equation)
        return found

    def place_of(self, equation: Equation) -> int:
        """Where a body's equation acts: over the position, the velocity, or the applied force."""
        p = equation.parameters(np.array(equation.form.starts[0]))
        stiffness = self.scale.force / self.scale.travel
        for place, size in ((SPRING, self.scale.travel), (DAMPER, self.scale.speed), (DRIVE, self.scale.force)):
            x = np.linspace(-size, size, 41)
            if np.ptp(equation_over(equation.effect, p, place, x, stiffness)) > 0.0:
                return place
        return SPRING

    def near(self, fitted: Fitted, family: Family, equation: Equation) -> Rival:
        """Where an equation comes nearest to the free law, constants being free to take up what they can."""
        constants = fitted.structure.terms[0]
        count = len(constants.unknowns)
        names = {each.name for each in family.terms}
        scales = equation.scales
        pairs = zip(fitted.structure.terms, fitted.structure.split(fitted.values), strict=True)
        own = [(term, values) for term, values in pairs if term.name in names]
        bases, laws, blocks = [], [], fitted.blocks
        for block in blocks:
            body = block.data.body
            law = sum(
                (values @ columns_of(term, body, self.axes) for term, values in own), np.zeros(body.velocity.size)
            )
            bases.append(self.weighed(block, columns_of(constants, body, self.axes)).T)
            laws.append(self.weighed(block, law))
        every = max(1, sum(len(each) for each in laws) // SEEN)
        base, law = np.concatenate(bases)[::every], np.concatenate(laws)[::every]
        base = base / np.maximum(np.linalg.norm(base, axis=0), 1e-300)
        stiffness = blocks[0].stiffness(fitted.values)

        def left(scaled: Floats) -> Floats:
            p = equation.parameters(scaled * scales)
            forces = [self.weighed(b, equation_force(equation.effect, p, b.data.body, stiffness)) for b in blocks]
            off = np.concatenate(forces)[::every] - law
            return off - base @ np.linalg.lstsq(base, off)[0]

        low, high = (np.array([getattr(each, end) for each in equation.unknowns]) / scales for end in ("low", "high"))
        begun = [np.clip(np.array(start) / scales, low, high) for start in equation.form.starts]
        begun.sort(key=lambda start: float(np.sum(left(start) ** 2)))
        made = []
        for start in begun[: 2 * STARTS]:
            result = least_squares(left, start, bounds=(low - 1e-12, high + 1e-12), max_nfev=30, x_scale=1.0)
            made.append((float(result.cost) * every, result.x))
        made.sort(key=lambda each: each[0])
        own_constants = fitted.fit.shared[:count]
        return Rival(equation, [(own_constants, values) for _, values in made[:STARTS]], made[0][0])

    @staticmethod
    def weighed(block: ForceBalance, rows: Floats) -> Floats:
        """Rows (..., n) as the noise model weighs those that are judged."""
        return block.noise.whiten(rows)[..., block.judged]

    def taken_up(self, equation: Term) -> list[str]:
        """Constants that can take up what is straight in an equation's law."""
        if not isinstance(equation, Equation):
            return []
        return {SPRING: ["stiffness"], DAMPER: ["damping"], DRIVE: ["mass"]}[self.place_of(equation)]

    def mechanisms_by_law(self, fitted: Fitted, family: Family, nearest: str) -> tuple[str, ...]:
        """The mechanism of a law that no equation follows, the likeliest first; ``nearest`` explains most of it."""
        term = family.terms[0]
        if not (isinstance(term, Curve) and term.place == SPRING and nearest in ("", family.mechanism)):
            return (nearest or family.mechanism,)
        values, precision = fitted.values_of(term.name), fitted.precision_of(term)
        known = zip(fitted.structure.unknowns, fitted.values, strict=True)
        stiffness = next((float(value) for each, value in known if each.name == "stiffness"), 0.0)
        kinds = kinds_of_spring(term, values, precision, self.axes.points(SPRING), stiffness)
        return tuple(map(mechanism_of_law, kinds))


def ones(body: Body) -> Floats:
    """(1, n) ones."""
    return np.ones((1, body.velocity.size))


def as_nothing(equation: Equation) -> Equation:
    """An equation that begins where it does nothing."""
    return replace(equation, unknowns=tuple(each._replace(value=0.0) for each in equation.unknowns))


def bent(basis: Floats, x: Floats) -> Floats:
    """Functions (m, GRID) less what is straight in them over x (GRID,)."""
    straight = np.linalg.qr(np.column_stack([np.ones(GRID), x]))[0]
    return normalised(basis - (basis @ straight) @ straight.T)


def law_of_body(campaign: Campaign, forced: bool, mass: float, scale: Scale) -> tuple[Forces, tuple[str, ...]]:
    """The law that the lab believes in, and the names of its constants."""
    parts: dict[str, Callable[[Body], Floats]] = {
        "mass": lambda body: body.acceleration,
        "damping": lambda body: body.velocity,
        "stiffness": lambda body: body.position,
        "coulomb": lambda body: body.rows(np.sign(sliding(body))),
        "offset": lambda body: np.ones(body.velocity.size),
    }
    loose = 0.0 if forced else (campaign.nominal["mass"].std or 0.0) / mass
    unknowns, used = [], []
    for name, part in parts.items():
        entry = campaign.nominal.get(name)
        if entry is None or (name == "mass" and not forced):
            continue
        used.append(part)
        if entry.value is None:
            unknowns.append(Unknown(name, 0.0, 0.1 * scale.of(UNITS[name]), unit=UNITS[name]))
            continue
        std = entry.std if entry.std is not None else max(UNSTATED * abs(entry.value), 1e-12)
        # where the left side is made with the mass, its tolerance is that of every constant
        std = math.hypot(std, loose * entry.value)
        unknowns.append(Unknown(name, entry.value, std, std, unit=UNITS[name]))
    law = Forces("constants", tuple(unknowns), lambda body: np.array([part(body) for part in used]))
    return law, tuple(each.name for each in unknowns)


def gain_of_law(law: Forces) -> ScaledLaw | None:
    """The term that makes all forces of a law as it is stated larger."""
    stated = np.array([each.value for each in law.unknowns])
    if any(math.isinf(each.std) for each in law.unknowns):
        return None
    return ScaledLaw("gain", (Unknown("gain", 0.0, SOFT, 1.0),), lambda body: (stated @ law.columns(body))[None])


def sampling(rate: float, mass: float) -> Forces:
    """What the left side lacks for each second that it lags, by which sampling alone may part the channels."""

    def lacks(body: Body) -> Floats:
        return np.array([-body.lag_force if body.lag_force is not None else mass * body.lag_acceleration])

    std = SAMPLING / rate
    return Forces("timing", (Unknown("timing", 0.0, std, std, unit="s"),), lacks)


def axes_of_bodies(bodies: Sequence[Body]) -> Axes:
    """Axes over what recordings visit."""

    def most(name: str) -> tuple[float, float]:
        every = np.concatenate([getattr(body, name) for body in bodies])
        low, high = np.percentile(every, [0.2, 99.8])
        return float(low), float(high)

    scale, low, high = np.ones(PLACES), -np.sinh(np.ones(PLACES)), np.sinh(np.ones(PLACES))
    ranges = {SPRING: most("smooth_position"), DAMPER: most("smooth_velocity")}
    fast = max(map(abs, ranges[DAMPER]))
    ranges[DAMPER] = -fast, fast
    if bodies[0].smooth_force is not None:
        ranges[DRIVE] = most("smooth_force")
    for place, (least, largest) in ranges.items():
        scale[place], low[place], high[place] = 1e3 * max(abs(least), abs(largest)), least, largest
    # dry friction changes its sign within less than a sample
    scale[GUIDE], low[GUIDE], high[GUIDE] = fast / 300.0, -fast, fast
    return Axes.over(scale, low, high)
