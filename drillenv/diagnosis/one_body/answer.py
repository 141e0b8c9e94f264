"""One body: a finished search in words and numbers, as report.json and model.json hold them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drillenv.diagnosis.one_body.channels import Body
from drillenv.diagnosis.one_body.decide import ABOVE, Rest, Search, Step, line
from drillenv.diagnosis.one_body.fit import Fitted, fit, shape_spread
from drillenv.diagnosis.one_body.terms import HALF, UNITS, target
from drillenv.diagnosis.page import Trace, Wave
from drillenv.dynamics.effects import REGISTRY
from drillenv.recordings import Campaign, QualityFinding

SEVERAL = 3.3
"""Standard deviations away from nominal at which a constant is wrong: five of them, and a chance of 0.5 % in all."""
SLIGHT = 0.01
"""Of the force: what is left below that is not a mismatch that anybody asks about."""
EXPLAINED = 0.9
"""Share of what position and speed have to do with, in squares, from which the mechanisms named account for it."""
UNRELATED = 0.25
"""Share of the whole mismatch, in squares, that may stay if position and speed have nothing to do with it."""
SURE = 1.96
"""Standard deviations to either end of an interval of 95 %."""
WORDS = {
    "stiffness-hardening": "The spring on the body stiffens as it is deflected.",
    "damping-quadratic": "The damping of the body grows with its speed.",
    "backlash": "The spring on the body has play: over a part of its travel its force does not grow.",
    "force-limit": "The force on the body saturates: beyond a certain size less arrives than is applied.",
}
"""For one body, where the library speaks of the drilling rig."""
TWO_SPEEDS = "record at two speeds that differ by a factor of three or more"
SEPARATE = {
    frozenset(("dry-friction", "viscous-damping")): TWO_SPEEDS,
    frozenset(("dry-friction", "damping-quadratic")): TWO_SPEEDS,
    frozenset(("viscous-damping", "damping-quadratic")): TWO_SPEEDS,
    frozenset(("channel-delay", "viscous-damping")): "record faster motions, where a lag and a damper part ways",
    frozenset(("stiffness-hardening", "backlash")): "record travels of several sizes about the same middle",
    frozenset(
        ("dry-friction", "backlash")
    ): "record slow travels both ways: friction changes with the way, play does not",
}
"""What tells two mechanisms apart."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyOutcome:
    """What the diagnosis of one body came to."""

    record: dict[str, Any]
    """As ``report.json``; beyond its keys: quality, constants (all of the law), rest (what is left), remarks, cells."""
    model: dict[str, Any]
    """As ``model.json``: the constants in SI and the effects; without either where nothing is explained."""
    waves: tuple[Wave, ...]
    """Of each recording, filtered: the measured side of the balance before and after, and the motion."""

    @property
    def verdict(self) -> str:
        """agrees, parameters, missing-physics or unexplained."""
        return self.record["verdict"]


@dataclass(slots=True, eq=False)
class Answer:
    """Puts a finished search into words and numbers."""

    campaign: Campaign
    bodies: list[Body]
    search: Search
    steps: list[Step]
    loose: float
    """Tolerance of the mass over its value, where it scales every constant."""
    remarks: tuple[str, ...]
    faults: tuple[QualityFinding, ...]
    plain: Fitted = field(init=False)
    """The law, all its constants fitted."""
    final: Fitted = field(init=False)
    """With the mechanisms."""
    believed: Fitted = field(init=False)
    """The law with the constants that the lab states, the others fitted."""
    rest: Rest = field(init=False)
    size: float = field(init=False)
    """N, standard deviation of the measured side."""

    def __post_init__(self):
        search = self.search
        self.plain, self.final = search.fitted(), search.fitted(self.steps)
        held = [
            term if term.std is None or term.name == "timing" else replace(term, std=1e-4 * term.std)
            for term in search.law
        ]
        self.believed = fit(search.rows, held, search.noise)
        self.rest = search.rest(self.steps)
        self.size = float(np.std(search.rows.y))

    def outcome(self) -> BodyOutcome:
        """The record, the model and the waves."""
        verdict = self.verdict()
        explained = verdict != "unexplained"
        findings = [self.finding(step) for step in self.steps] if explained else []
        constants = self.constants()
        record = {
            "verdict": verdict,
            "where": self.where(verdict),
            "findings": findings,
            "parameters": self.parameters() if explained else {},
            "fit": self.fit(),
            "rejected": self.rejected(explained),
            "quality": [str(each) for each in self.faults],
            "constants": constants,
            "rest": self.described(),
            "remarks": [*self.remarks, *self.held_remarks()],
            "cells": self.cells(),
        }
        model = {
            "format": "drillenv-model/1",
            "rig": "one-body",
            "constants": {name: each["value"] for name, each in constants.items()} if explained else {},
            "effects": [
                {
                    "name": each["mechanism"],
                    "parameters": {symbol: part["value"] for symbol, part in each["parameters"].items()},
                }
                for each in findings
            ],
        }
        return BodyOutcome(record, model, tuple(self.wave(body) for body in self.bodies))

    # the verdict

    def verdict(self) -> str:
        """In one word."""
        off = self.off()
        left = self.rest.structured and self.rest.excess > SLIGHT * self.size
        if not self.steps and not off:
            return "unexplained" if left else "agrees"
        # a mechanism that fits only with stated constants bent, and even then not quite, is another's makeshift
        if self.steps and off and self.rest.structured:
            return "unexplained"
        least = self.search.floor(self.final) ** 2
        start = (self.plain if self.steps else self.believed).mean_square
        gained = start - self.final.mean_square
        of_state = max((share for _text, _gain, share in self.rest.shapes), default=0.0) * self.final.mean_square
        if left and (gained < EXPLAINED * (gained + of_state) or self.rest.excess**2 > UNRELATED * (start - least)):
            return "unexplained"
        return "missing-physics" if self.steps else "parameters"

    def off(self) -> list[str]:
        """Stated constants that are off by several of their tolerances."""
        return [
            term.name
            for term, value in zip(self.search.law, self.final.values, strict=False)
            if term.name != "timing" and term.value is not None and abs(value - term.value) > SEVERAL * _std(term.std)
        ]

    def parameters(self) -> dict[str, Any]:
        """Constants that are off, and those that were to be estimated, whose nominal is None."""
        nominal = {
            name: self.campaign.nominal[name].value for name in self.constants() if name in self.campaign.nominal
        }
        return {
            name: {**entry, "nominal": nominal[name]}
            for name, entry in self.constants().items()
            if name in self.off() or nominal[name] is None
        }

    def constants(self) -> dict[str, Any]:
        """Every constant of the law, fitted."""
        spreads = self.final.spreads()
        found = {
            name: _entry(value, math.hypot(spreads[name], self.loose * value), UNITS[name])
            for name, value in self.final.constants().items()
            if name in UNITS
        }
        mass = self.campaign.nominal["mass"]
        if mass.value is not None and "mass" not in found:
            found = {"mass": _entry(mass.value, mass.std or 0.0, "kg"), **found}
        return found

    # where

    def cells(self) -> list[dict[str, Any]]:
        """Mean square over the sensors' noise that the lab's law leaves, by recording, way and speed."""
        left, rows = self.plain.left, self.search.rows
        least = self.search.floor(self.final) ** 2
        found = []
        speed = np.concatenate([body.velocity[body.keep] for body in rows.bodies])
        fast = np.abs(speed) > np.median(np.abs(speed))
        for i, body in enumerate(rows.bodies):
            for way, moving in (("forward", speed > 0.0), ("backward", speed <= 0.0)):
                for pace, quick in (("slow", ~fast), ("fast", fast)):
                    there = (rows.owner == i) & moving & quick
                    if there.any():
                        found.append(
                            {
                                "recording": body.name,
                                "channel": "force" if body.force is not None else "acceleration",
                                "regime": f"{way}, {pace}",
                                "samples": int(there.sum()),
                                "mean_square": float(np.mean(left[there] ** 2) / least),
                                "mean": float(np.mean(left[there])),
                            }
                        )
        return found

    def where(self, verdict: str) -> dict[str, Any]:
        """Balance, regimes and recordings of the mismatch, and a sentence."""
        slight = self.rest.excess <= SLIGHT * self.size
        if verdict == "agrees":
            text = "What is left is noise within the stated tolerances of the constants."
            if self.rest.structured:
                text = f"What is left, {self.rest.excess:.3g} N, is less than {100 * SLIGHT:g} % of the force."
            return {"balance": None, "regimes": [], "recordings": [], "summary": text}
        cells = self.cells()
        surplus: dict[str, float] = {}
        for each in cells:
            grown = (each["mean_square"] - 1.0) * each["samples"]
            surplus[each["regime"]] = surplus.get(each["regime"], 0.0) + grown
        total = max(sum(surplus.values()), 1e-300)
        regimes = sorted((name for name in surplus if surplus[name] > 0.2 * total), key=lambda name: -surplus[name])
        balance = "body"
        if verdict == "missing-physics":
            balance = "sensor" if REGISTRY[self.steps[0].variant.mechanism].balances == ("sensor",) else "body"
            text = " ".join(_sentence(step.variant.mechanism) for step in self.steps)
            text += "" if slight or not self.rest.structured else f" {self.described()['summary']}"
        elif verdict == "parameters":
            text = "Constants that are off by several of their tolerances explain it."
        else:
            text = f"{self.described()['summary']} It is largest moving {' and '.join(regimes[:2])}."
        recordings = sorted({each["recording"] for each in cells if each["mean_square"] > ABOVE})
        return {"balance": balance, "regimes": regimes, "recordings": recordings, "summary": text}

    def described(self) -> dict[str, Any]:
        """What is left, in words and numbers."""
        words = [text for text, _gain, _share in self.rest.shapes[:3]]
        if self.rest.lines:
            rates = list(dict.fromkeys(f"{hertz:.3g} Hz" for _name, hertz, _share in self.rest.lines))[:4]
            words.append(f"it is periodic in time, at {', '.join(rates)}, in {len(self.rest.lines)} recordings")
        if _bursts(self.final.left):
            words.append("it comes in short bursts")
        if not words and self.rest.structured:
            words.append("it has to do neither with position nor with speed")
        text = f"{self.rest.excess:.3g} N beyond the sensors' noise are left, "
        text += f"{100 * self.rest.excess / self.size:.2g} % of the force"
        return {
            "summary": text + (f": {'; '.join(words)}." if words else "."),
            "excess": self.rest.excess,
            "unit": "N",
            "over_noise": self.rest.ratio,
            "shapes": [{"shape": t, "gain": g, "share": s} for t, g, s in self.rest.shapes],
            "lines": [{"recording": n, "frequency": f, "share": s} for n, f, s in self.rest.lines],
        }

    def held_remarks(self) -> list[str]:
        """What recordings held out have that those fitted have not shown: a disturbance with a period of its own."""
        found = []
        for body in self.bodies:
            tone = line(body, self.left_of(body, self.final)[body.keep]) if body.held else None
            if tone is not None and body.name not in {name for name, _hertz, _share in self.rest.lines}:
                found.append(
                    f"{body.name}, held out: a part of what is left there comes {tone[0]:.3g} times a second, "
                    f"{100 * tone[1]:.0f} % of its power in that line: a force that is neither measured nor of the law."
                )
        return found

    # what was found

    def finding(self, step: Step) -> dict[str, Any]:
        """One entry of the findings."""
        mechanism = step.variant.mechanism
        effect = REGISTRY[mechanism]
        evidence: dict[str, Any] = {
            "gain": round(step.gain, 1),
            "gain_needed": round(step.needed, 1),
            "share_of_left_out": round(step.share, 4),
            "equation": effect.equation,
            "source": effect.source,
        }
        if step.equivalents:
            evidence["separate"] = [
                SEPARATE.get(frozenset((mechanism, other)), "record other amplitudes and speeds")
                for other in step.equivalents
            ]
        if "sensor" not in effect.balances:
            evidence["beside_a_free_lag"] = self.beside_lag(step)
        return {
            "mechanism": mechanism,
            "equivalents": list(step.equivalents),
            "explanation": _sentence(mechanism),
            "parameters": self.strengths(step, self.final),
            "evidence": evidence,
        }

    def beside_lag(self, step: Step) -> dict[str, Any]:
        """What the strengths would be, were one channel free to lag: a lag and a damper can stand in for each other."""
        loose = self.search.lagging(self.final.terms)
        return {"lag": _entry(*_lag(loose), "s"), **self.strengths(step, loose)}

    def strengths(self, step: Step, made: Fitted) -> dict[str, Any]:
        """Parameters of a mechanism with their standard deviations."""
        variant, names = step.variant, [term.name for term in made.terms]
        places = [names.index(term.name) for term in step.terms]
        values, covariance = made.values[places], made.covariance[np.ix_(places, places)]
        parameters = variant.named(values)
        if variant.mechanism == "channel-delay":
            symbol = next(iter(parameters))
            parameters[symbol] += made.constants()["timing"] * math.copysign(1.0, float(values[0]))
            # a controller that holds its force from one sample to the next makes half a sample of lag
            covariance = covariance + (HALF / self.bodies[0].rate) ** 2
        shapes = shape_spread(variant, values, self.search.rows, made.terms, self.search.noise.counted)
        units = {each.symbol: each.unit for each in REGISTRY[variant.mechanism].parameters}
        found = {}
        for symbol, value in parameters.items():
            moves = 1e-4 * np.sqrt(np.diag(covariance))
            slopes = np.array(
                [
                    (variant.named(values + move)[symbol] - variant.named(values)[symbol]) / max(move.sum(), 1e-300)
                    for move in np.diag(moves)
                ]
            )
            std = shapes.get(symbol, float(np.sqrt(slopes @ covariance @ slopes)))
            unit = units.get(symbol, "s")
            if unit.startswith("N"):
                std = math.hypot(std, self.loose * value)
            found[symbol] = _entry(float(value), std, unit)
        return found

    def rejected(self, explained: bool) -> list[dict[str, Any]]:
        """What was considered, and why it is not the answer."""
        there = {step.variant.mechanism for step in self.steps} if explained else set()
        listed = [
            {"mechanism": name, "why": f"{why} (gain {gain:.1f})"}
            for name, (gain, why) in sorted(self.search.rejected.items(), key=lambda each: -each[1][0])
            if name not in there
        ]
        for step in () if explained else self.steps:
            share = f"{100 * step.share:.0f} % of what was left"
            why = f"explains {share}, and too much stays or constants are bent (gain {step.gain:.1f})"
            listed.append({"mechanism": step.variant.mechanism, "why": why})
        for each in listed:
            if each["mechanism"] == "channel-delay":
                each["why"] += f"; {self.lag()}"
        return listed

    def lag(self) -> str:
        """What the recordings say of a lag of one side behind the other, whether or not it counts."""
        value, std = _lag(self.search.lagging(self.final.terms))
        side = "force" if self.bodies[0].force is not None else "acceleration"
        way = "behind" if value > 0 else "ahead of"
        return f"let loose, the {side} would be {1e3 * abs(value):.3f} +- {1e3 * std:.3f} ms {way} the motion"

    # how well it fits

    def left_of(self, body: Body, made: Fitted) -> np.ndarray:
        """(n,) N, of the rows of a recording."""
        left = target(body, self.search.rows.mass)
        for term, value in zip(made.terms, made.values, strict=True):
            left = left - value * term.column(body)
        for step in self.steps if body.held and made is self.final else ():
            if step.variant.mechanism == "mains-hum":
                # the phase of a hum in a recording held out is its own
                turned = 2 * math.pi * step.variant.shape[0] * body.time
                table = np.column_stack([np.sin(turned), np.cos(turned)])
                left = left - table @ np.linalg.lstsq(table, left, rcond=None)[0]
        return left

    def over(self, bodies: Sequence[Body]) -> dict[str, Any]:
        """N, root mean square of what is left in these recordings before and after, and of the force itself."""

        def root(made: Fitted) -> float:
            return float(np.sqrt(np.mean(np.concatenate([self.left_of(b, made)[b.keep] ** 2 for b in bodies]))))

        sides = np.concatenate([target(body, self.search.rows.mass)[body.keep] for body in bodies])
        return {
            "recordings": [body.name for body in bodies],
            "before": root(self.believed),
            "after": root(self.final),
            "force": float(np.std(sides)),
        }

    def fit(self) -> dict[str, Any]:
        """How well it fits."""
        fitted, held = ([body for body in self.bodies if body.held is which] for which in (False, True))
        left_out = {
            **self.over(fitted),
            "before": math.sqrt(self.believed.mean_square),
            "after": math.sqrt(self.final.mean_square),
            "how": "each recording, or stretch where there are few, by a fit to the others",
        }
        held_out = left_out
        if held:
            each = {body.name: self.over([body]) for body in held}
            held_out = {**self.over(held), "how": "recordings that took no part in the fit", "each": each}
        return {
            "unit": "N, root mean square of what is left of the force balance",
            "noise_floor": self.search.floor(self.final),
            "fitted": self.over(fitted),
            "left_out": left_out,
            "held_out": held_out,
        }

    def wave(self, body: Body) -> Wave:
        """What a picture needs of a recording."""
        mass = self.search.rows.mass
        channel, unit, scale = ("force", "N", 1.0) if body.force is not None else ("acceleration", "m/s^2", -1.0 / mass)
        measured = target(body, mass)
        sides = [
            scale * (measured - each) for each in (0.0, *(self.left_of(body, m) for m in (self.believed, self.final)))
        ]
        motion = (Trace("velocity", "m/s", body.velocity), Trace("position", "m", body.position))
        return Wave(body.name, body.held, body.time, (Trace(channel, unit, *sides), *motion))


def _std(std: float | None) -> float:
    return math.inf if std is None else std


def _entry(value: float, std: float, unit: str) -> dict[str, Any]:
    """A number as a report gives it."""
    return {"value": value, "std": std, "unit": unit, "interval": [value - SURE * std, value + SURE * std]}


def _lag(made: Fitted) -> tuple[float, float]:
    """s, the lag of a fit in which it is free, and its standard deviation."""
    return made.constants()["timing"], made.spreads()["timing"]


def _sentence(mechanism: str) -> str:
    return WORDS.get(mechanism, REGISTRY[mechanism].sentence)


def _bursts(left: np.ndarray) -> bool:
    """Whether a twentieth of the rows holds more than half of what is left."""
    squares = np.sort(left**2)[::-1]
    return float(squares[: max(1, squares.size // 20)].sum()) > 0.5 * float(squares.sum())
