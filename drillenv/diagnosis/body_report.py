"""A finished search of a single body as the records of ``report.json`` and ``model.json``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.stats import t as student

from drillenv.diagnosis.body import NUDGE, ForceBalance, ScaledLaw, Stretch, equation_over
from drillenv.diagnosis.body_channels import Body
from drillenv.diagnosis.body_noise import line
from drillenv.diagnosis.body_rig import UNITS, BodyRig
from drillenv.diagnosis.evidence import AGREED, Explained, Verdict, cell, classify, explained, surplus
from drillenv.diagnosis.findings import cited, deviations, equivalents, form_of, parameters_of, rejected
from drillenv.diagnosis.fitting import TIGHT, Fitted
from drillenv.diagnosis.laws import Curve, Equation
from drillenv.diagnosis.measured import POINTS, law_record, quantity, with_spread
from drillenv.diagnosis.naming import Tried, without
from drillenv.diagnosis.page import Trace, Wave
from drillenv.diagnosis.score_tests import ScoreTests, regular
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.steps import Step
from drillenv.diagnosis.tables import Axes, interpolate
from drillenv.diagnosis.terms import ModelStructure, Term
from drillenv.diagnosis.thresholds import (
    AGAIN,
    LEFT,
    MATERIAL,
    MOST_OF_LAW,
    SEVERAL,
    SLIGHT,
    STRUCK,
    SURELY,
    TINY,
    WELL_EXPLAINED,
)
from drillenv.dynamics.constitutive.places import DAMPER, DRIVE, GUIDE, SPRING
from drillenv.dynamics.effects import REGISTRY, mechanism_of_law
from drillenv.recordings import Campaign, QualityFinding

ARGUMENTS = {
    SPRING: ("position", "m"),
    DAMPER: ("velocity", "m/s"),
    GUIDE: ("velocity", "m/s"),
    DRIVE: ("applied force", "N"),
}


@dataclass(frozen=True, slots=True, eq=False)
class BodyOutcome:
    """What the diagnosis of one body came to."""

    record: dict[str, Any]
    """As ``report.json``; beyond its keys: explained, constants (all of the law), rest (what is left), cells."""
    model: dict[str, Any]
    """As ``model.json``: the constants in SI and the effects; without either where nothing is explained."""
    waves: tuple[Wave, ...]
    """Of each recording, filtered: the measured side of the balance before and after, and the motion."""


class Evidence(NamedTuple):
    """What speaks for a step."""

    share: float
    """Of the mismatch, that the others do not explain without it."""
    left_out: float
    """The same of recordings or parts of them that were left out of the fit."""
    p: float
    """That it gains no more than nothing on those, over recordings."""
    exact: bool
    """Whether it is an equation of the library."""
    force: float
    """Root mean square that it explains, over that of the measured side."""

    @property
    def holds(self) -> bool:
        """Whether it is more than what others' errors leave, in recording after recording."""
        again = self.p < AGAIN
        if self.exact:
            seen = self.force > SLIGHT or (self.force > TINY and again)
            return self.left_out > 0.0 and (self.share > MATERIAL or seen)
        return self.share > MATERIAL and self.force > TINY and (self.share > SURELY or again)


@dataclass(eq=False)
class BodyReport:
    """Puts a finished search into words and numbers."""

    campaign: Campaign
    bodies: list[Body]
    remarks: tuple[str, ...]
    faults: tuple[QualityFinding, ...]
    plain: Fitted
    """The law, all its constants fitted."""
    final: Fitted
    """With all families that were found."""
    every: list[Step]
    tested: ScoreTests
    steps: list[Step] = field(init=False)
    """Mechanisms that hold."""
    minor: list[Step] = field(init=False)
    """Families that explain too little, or not in recording after recording."""
    evidence: dict[int, Evidence] = field(init=False)
    believed: Fitted = field(init=False)
    """The law with the constants that the lab states, the others fitted."""
    size: float = field(init=False)
    """N, standard deviation of the measured side."""

    def __post_init__(self) -> None:
        self.size = float(np.std(np.concatenate([b.data.measured[b.data.keep] for b in self.final.blocks])))
        self.evidence = {id(step): self.weigh(step) for step in self.every if not step.family.constant}
        missing = [step for step in self.every if not step.family.constant]
        self.steps = [step for step in missing if self.evidence[id(step)].holds]
        self.minor = [step for step in missing if not self.evidence[id(step)].holds]
        for step in self.minor:
            # constants are those beside what holds
            rest, start = without(self.final, step.terms)
            self.final = self.refitted(rest, start)
        if self.minor:
            self.evidence |= {id(step): self.weigh(step) for step in self.steps}
        constants = self.plain.structure.terms[0]
        tight = tuple(e._replace(std=1e-4 * e.std) if math.isfinite(e.std) else e for e in constants.unknowns)
        structure = self.plain.structure
        structure = replace(structure, terms=(replace(constants, unknowns=tight), *structure.terms[1:]))
        self.believed = self.refitted(structure, self.plain.fit.shared)

    def refitted(self, structure: ModelStructure, start: Floats) -> Fitted:
        """Another structure on the same rows by the same noise."""
        return self.plain.refit(structure, start, noise=self.final.noise)

    # --- what speaks for it

    def mismatch(self, fitted: Fitted) -> Floats:
        """(stretches,) by how much squares of whitened rows exceed the noise, each by a fit to the others."""
        found = []
        for block, shared in zip(fitted.blocks, left_out_in_turn(fitted), strict=True):
            found.append(float(np.sum(block.residual(shared * block.structure.scales) ** 2)) - block.samples)
        return np.array(found)

    def weigh(self, step: Step) -> Evidence:
        """What the fit loses without a step."""
        rest, start = without(self.final, step.terms)
        other = self.refitted(rest, start)
        total = max(2.0 * self.plain.cost - self.plain.samples, 1e-300)
        gains = self.mismatch(other) - self.mismatch(self.final)
        spread = float(gains.std(ddof=1)) / math.sqrt(gains.size)
        p = float(student.sf(gains.mean() / max(spread, 1e-300), gains.size - 1))
        left_out = float(gains.sum()) / max(float(self.mismatch(self.plain).sum()), 1e-300)
        exact = step.named.equation is not None
        force = math.sqrt(max(rms(other) ** 2 - rms(self.final) ** 2, 0.0)) / self.size
        return Evidence(2.0 * (other.cost - self.final.cost) / total, left_out, p, exact, force)

    @cached_property
    def explained(self) -> Explained:
        """Share of the mismatch that the mechanisms explain, or constants where there are none."""
        before = self.mismatch(self.plain if self.steps else self.believed)
        return explained(before, self.mismatch(self.final), "rows left out of the fit", self.plain.samples)

    # --- the verdict

    def verdict(self) -> Verdict:
        """In one word."""
        outside = any(step.family.outside for step in self.steps)
        left = self.left_share() > LEFT and self.excess_rms() > SLIGHT * self.size
        return classify(bool(self.steps), outside, bool(self.wrong_constants), left, self.explained)

    def left_share(self) -> float:
        """What is left beyond the noise, over it, in squares."""
        return self.final.reduced_chi_square - 1.0

    def excess_rms(self) -> float:
        """N, root mean square of what is left beyond the noise."""
        return rms(self.final) * math.sqrt(max(1.0 - 1.0 / max(self.final.reduced_chi_square, 1e-9), 0.0))

    @cached_property
    def wrong_constants(self) -> list[str]:
        """Stated constants that are off by several of their tolerances."""
        constants = self.plain.structure.terms[0].unknowns
        pairs = zip(constants, self.final.values, strict=False)
        return [each.name for each, value in pairs if abs(value - each.value) > SEVERAL * each.std]

    @cached_property
    def constants(self) -> dict[str, Any]:
        """Every constant of the law, fitted."""
        fitted, entry = self.constants_fit, self.campaign.nominal["mass"]
        spread, found = deviations(fitted), {}
        for each, value, std in zip(self.plain.structure.terms[0].unknowns, fitted.values, spread, strict=False):
            found[each.name] = quantity(float(value), math.hypot(std, self.mass_tolerance * value), UNITS[each.name])
        if entry.value is not None and "mass" not in found:
            found = {"mass": quantity(entry.value, entry.std or 0.0, "kg"), **found}
        return found

    @cached_property
    def constants_fit(self) -> Fitted:
        """The fit by which constants are stated.

        Of one that nobody states, a free law takes as much as it likes: where an equation comes near to the law, that
        says what is the constant's.
        """
        measured = [step for step in self.steps if step.named.equation is None]
        near = next((each for each in map(near_equation, measured) if each is not None), None)
        free = any(math.isinf(each.std) for each in self.plain.structure.terms[0].unknowns)
        return self.near_equation_fit(near) if near is not None and free and len(self.mechanisms) == 1 else self.final

    @cached_property
    def mass_tolerance(self) -> float:
        """Tolerance of the mass over its value, where it scales every force."""
        entry = self.campaign.nominal["mass"]
        return 0.0 if self.bodies[0].force is not None else (entry.std or 0.0) / (entry.value or 1.0)

    def parameters(self) -> dict[str, Any]:
        """Constants that are off, and those that were to be estimated, whose nominal is None."""
        nominal = {name: each.value for name, each in self.campaign.nominal.items()}
        return {
            name: {**entry, "nominal": nominal[name]}
            for name, entry in self.constants.items()
            if name in self.wrong_constants or nominal.get(name) is None
        }

    # --- where, and what is left

    def cells(self) -> list[dict[str, Any]]:
        """Mean square over the noise that the lab's law leaves, by recording, way and speed."""
        found: dict[tuple[str, str], list[Floats]] = {}
        fast = float(np.median(np.abs(np.concatenate([b.data.body.velocity[b.judged] for b in self.plain.blocks]))))
        for block in self.plain.blocks:
            body, values = block.data.body, self.plain.values
            speed, white = body.velocity[block.judged], block.residual(values) ** 2 / block.noise.share
            for way, moving in (("forward", speed > 0.0), ("backward", speed <= 0.0)):
                for pace, quick in (("slow", np.abs(speed) <= fast), ("fast", np.abs(speed) > fast)):
                    there = moving & quick
                    found.setdefault((body.name, f"{way}, {pace}"), []).append(white[there])
        channel = "force" if self.bodies[0].force is not None else "acceleration"
        joined = {at: np.concatenate(parts) for at, parts in found.items()}
        return [cell(name, channel, regime, white) for (name, regime), white in joined.items() if white.size]

    def where(self, verdict: str, cells: list[dict[str, Any]]) -> dict[str, Any]:
        """Balance, regimes and recordings of the mismatch, and a sentence."""
        if verdict == "agrees":
            text = AGREED
            if self.left_share() > LEFT:
                text = f"What is left, {self.excess_rms():.3g} N, is less than {100 * SLIGHT:g} % of the force."
            return {"balance": None, "regimes": [], "recordings": [], "summary": text}
        beyond = surplus(cells, "regime")
        total = max(sum(beyond.values()), 1e-300)
        regimes = [name for (name,), size in sorted(beyond.items(), key=lambda each: -each[1]) if size > 0.2 * total]
        balance = "body"
        if verdict == "missing-physics":
            effects = [REGISTRY[name] for name in self.mechanisms]
            balance = "sensor" if effects[0].balances == ("sensor",) else "body"
            text = " ".join(effect.body_sentence or effect.sentence for effect in effects)
            text += f" {self.explained.sentence}"
            text += f" {self.rest['summary']}" if self.left_share() > LEFT else ""
        elif verdict == "parameters":
            text = "Constants that are off by several of their tolerances explain it."
        else:
            text = f"{self.rest['summary']} It is largest moving {' and '.join(regimes[:2])}."
        recordings = sorted({each["recording"] for each in cells if each["mean_square"] > STRUCK})
        return {"balance": balance, "regimes": regimes, "recordings": recordings, "summary": text}

    @cached_property
    def mechanisms(self) -> list[str]:
        """Names of those that hold, each once."""
        return list(dict.fromkeys(step.named.mechanism for step in self.steps))

    @cached_property
    def rest(self) -> dict[str, Any]:
        """What is left, in words and numbers."""
        outside = [step for step in (*self.steps, *self.minor) if step.family.outside]
        little = [step for step in self.minor if not step.family.outside]
        words = [step.family.outside for step in outside]
        words += [f"a little of it is like {step.named.mechanism}" for step in little]
        excess = self.excess_rms()
        if not words and self.left_share() > LEFT:
            words.append("it is like none of the families that were tried")
        text = f"{excess:.3g} N beyond the noise are left, {100 * excess / self.size:.2g} % of the force"
        shapes = [
            {
                "shape": step.family.outside or step.named.mechanism,
                "gain": self.evidence[id(step)].left_out,
                "share": self.evidence[id(step)].share,
            }
            for step in (*outside, *little)
        ]
        return {
            "summary": text + (f": {'; '.join(words)}." if words else "."),
            "excess": excess,
            "unit": "N",
            "over_noise": self.final.reduced_chi_square,
            "shapes": shapes,
        }

    # --- what was found

    def findings(self) -> list[dict[str, Any]]:
        """One entry for each mechanism; laws of the same mechanism over the same argument are one."""
        return [
            self.finding(name, [step for step in self.steps if step.named.mechanism == name])
            for name in self.mechanisms
        ]

    def finding(self, mechanism: str, steps: Sequence[Step]) -> dict[str, Any]:
        """One entry of the findings."""
        effect, first = REGISTRY[mechanism], steps[0]
        equation = first.named.equation if len(steps) == 1 else None
        weighed = [self.evidence[id(step)] for step in steps]
        evidence: dict[str, Any] = {
            "gain": round(sum(step.gain for step in steps), 1),
            "share": round(max(each.share for each in weighed), 4),
            "share_of_left_out": round(max(each.left_out for each in weighed), 4),
            **cited(effect, equation is not None),
        }
        if "sensor" not in effect.balances and equation is not None:
            evidence["beside_a_free_lag"] = self.beside_lag(equation)
        alike = sorted({name for step in steps for name in equivalents(step)} - {mechanism})
        if alike:
            advice = [REGISTRY[name].body_told_apart for name in (mechanism, *alike) if name in REGISTRY]
            evidence["separate"] = [text for text in dict.fromkeys(advice) if text]
        entry: dict[str, Any] = {
            "mechanism": mechanism,
            "equivalents": alike,
            "explanation": effect.body_sentence or effect.sentence,
            "form": form_of(first) if equation is not None else "measured",
            "parameters": self.nearest(first) if equation is None else self.stated(equation, self.final),
            "evidence": evidence,
        }
        first = next((step for step in steps if any(isinstance(term, Curve) for term in step.terms)), None)
        if first is not None:
            same = [step for step in steps if step.family.group == first.family.group or is_of_speed(step, first)]
            entry["law"] = self.law([term for step in same for term in step.terms])
        elif isinstance(equation, Equation):
            entry["law"] = self.law([equation])
        return entry

    def law(self, terms: Sequence[Term]) -> dict[str, Any]:
        """Laws over the same argument as one, with a 95 % band.

        Of constants that nobody states, what is straight in a law is beyond what they are said to be.
        """
        final, axes = self.final, self.final.structure.axes
        rig, curves = cast("BodyRig", final.structure.rig), [each for each in terms if isinstance(each, Curve)]
        place = curves[0].place if curves else rig.place_of(cast("Equation", terms[0]))
        if place == DAMPER and not curves:
            # whose axis shows a step at rest
            place = GUIDE
        ends = axes.points(place)[[0, -1]]
        x = axes.between(place, float(ends[0]), float(ends[1]), POINTS)
        straight = self.unstated(place, x) if curves else {}
        inside = final.indices_of(terms) + list(straight)
        scales = final.structure.scales[inside]
        stiffness, beyond = final.blocks[0].stiffness(final.values), self.constants_fit.values
        terms = final.structure.current(terms)

        def curve(scaled: Floats) -> Floats:
            total, first = np.zeros(POINTS), 0
            for term in terms:
                own = (scaled * scales)[first : first + len(term.unknowns)]
                total = total + law_at(term, own, place, x, axes, stiffness)
                first += own.size
            for (i, shape), value in zip(straight.items(), (scaled * scales)[first:], strict=True):
                total = total + (value - beyond[i]) * shape
            return total

        return law_record(*ARGUMENTS[place], "N", x, *with_spread(final, inside, curve, NUDGE))

    def unstated(self, place: int, x: Floats) -> dict[int, Floats]:
        """Constants that nobody states, by place among the parameters, with their forces (n,) over an argument."""
        straight = {"offset": np.ones_like(x)}
        straight |= {SPRING: {"stiffness": x}, DAMPER: {"damping": x}, GUIDE: {"damping": x}}.get(place, {})
        constants = self.plain.structure.terms[0].unknowns
        return {i: straight[e.name] for i, e in enumerate(constants) if math.isinf(e.std) and e.name in straight}

    def nearest(self, step: Step) -> dict[str, Any]:
        """Parameters of the equation that comes near to a measured law; none where none explains nearly all of it."""
        near = near_equation(step)
        return {} if near is None else self.stated(near.equation, self.near_equation_fit(near))

    def near_equation_fit(self, near: Tried) -> Fitted:
        """The law with the equation that comes near to a step's law."""
        plain = self.plain
        structure = replace(plain.structure, terms=(*plain.structure.terms, near.equation))
        start = np.concatenate([plain.fit.shared, near.values / near.equation.scales])
        return self.refitted(structure, start)

    def stated(self, equation: Term, fitted: Fitted) -> dict[str, Any]:
        """Parameters of an equation in a fit, with their standard deviations."""
        found = {}
        for symbol, each in parameters_of(fitted, equation).items():
            of_mass = self.mass_tolerance * each["value"] if each["unit"].startswith("N") else 0.0
            found[symbol] = quantity(each["value"], math.hypot(each["std"], of_mass), each["unit"])
        return found

    def beside_lag(self, equation: Term) -> dict[str, Any]:
        """An equation's parameters, were one channel free to lag: a lag and a damper can stand in for each other."""
        loose = self.fit_with_free_lag
        return {"lag": quantity(*self.lag_of(loose), "s"), **self.stated(equation, loose)}

    @cached_property
    def fit_with_free_lag(self) -> Fitted:
        """The final fit with a lag of the left side behind the motion of which nothing is believed."""
        terms = tuple(e.freed("timing") if e.name == "timing" else e for e in self.final.structure.terms)
        return self.refitted(replace(self.final.structure, terms=terms), self.final.fit.shared)

    def lag_of(self, fitted: Fitted) -> tuple[float, float]:
        """s, the lag of a fit, and its standard deviation."""
        i = [each.name for each in fitted.structure.unknowns].index("timing")
        return float(fitted.values[i]), float(deviations(fitted)[i])

    def rejected(self) -> list[dict[str, Any]]:
        """What was considered, and why it is not the answer."""
        there = set(self.mechanisms)
        listed = [each for each in rejected(self.every, self.tested) if each["mechanism"] not in there]
        listed = list({each["mechanism"]: each for each in reversed(listed)}.values())[::-1]
        delay = mechanism_of_law("lag")
        if delay not in there and not any(each["mechanism"] == delay for each in listed):
            listed.append({"mechanism": delay, "why": "no more than sampling does"})
        value, std = self.lag_of(self.fit_with_free_lag)
        side = "force" if self.bodies[0].force is not None else "acceleration"
        way = "behind" if value > 0.0 else "ahead of"
        for each in listed:
            if each["mechanism"] == delay:
                lag = f"the {side} would be {1e3 * abs(value):.3f} +- {1e3 * std:.3f} ms {way} the motion"
                each["why"] += f"; let loose, {lag}"
        return listed

    # --- how well it fits

    def block_of(self, body: Body, fitted: Fitted) -> ForceBalance:
        """A whole recording under a model."""
        data = Stretch(body, body.name, body.keep, self.plain.blocks[0].data.mass)
        return ForceBalance(data, fitted.structure, TIGHT, fitted.noise[0])

    def left_of(self, body: Body, fitted: Fitted) -> Floats:
        """(n,) N, of the rows of a recording."""
        return self.block_of(body, fitted).left(fitted.values)

    def over(self, bodies: Sequence[Body]) -> dict[str, Any]:
        """N, root mean square of what is left in these recordings before and after, and of the force itself."""

        def root(fitted: Fitted) -> float:
            return float(np.sqrt(np.mean(np.concatenate([self.left_of(b, fitted)[b.keep] ** 2 for b in bodies]))))

        sides = np.concatenate([self.block_of(body, self.final).data.measured[body.keep] for body in bodies])
        return {
            "recordings": [body.name for body in bodies],
            "before": root(self.believed),
            "after": root(self.final),
            "force": float(np.std(sides)),
        }

    def fit(self) -> dict[str, Any]:
        """How well it fits."""
        fitted, held = ([body for body in self.bodies if body.held is which] for which in (False, True))
        over = self.over(fitted)
        left_out = {
            **over,
            "before": rms(self.believed, left_out_in_turn(self.believed)),
            "after": rms(self.final, left_out_in_turn(self.final)),
            "how": "each recording, or part of one where there are few, by a fit to the others",
        }
        held_out = left_out
        if held:
            each = {body.name: self.over([body]) for body in held}
            held_out = {**self.over(held), "how": "recordings that took no part in the fit", "each": each}
        return {
            "unit": "N, root mean square of what is left of the force balance",
            "noise_floor": self.final.noise[0].size(),
            "fitted": over,
            "left_out": left_out,
            "held_out": held_out,
        }

    def held_remarks(self) -> list[str]:
        """What recordings held out have that those fitted have not shown: a disturbance with a period of its own."""
        found = []
        for body in self.bodies:
            tone = line(body, self.left_of(body, self.final)) if body.held else None
            if tone is not None:
                found.append(
                    f"{body.name}, held out: a part of what is left there comes {tone[0]:.3g} times a second, "
                    f"{100 * tone[1]:.0f} % of its power in that line: a force that is neither measured nor of the law."
                )
        return found

    def wave(self, body: Body) -> Wave:
        """What a picture needs of a recording."""
        block = self.block_of(body, self.final)
        forced = body.force is not None
        channel, unit, scale = ("force", "N", 1.0) if forced else ("acceleration", "m/s^2", -1.0 / block.data.mass)
        measured = block.data.measured
        lefts = (0.0, self.left_of(body, self.believed), self.left_of(body, self.final))
        sides = [scale * (measured - each) for each in lefts]
        motion = (Trace("velocity", "m/s", body.velocity), Trace("position", "m", body.position))
        return Wave(body.name, body.held, body.time, (Trace(channel, unit, *sides), *motion))

    # --- all of it

    def outcome(self) -> BodyOutcome:
        """The record, the model and the waves."""
        verdict, cells = self.verdict(), self.cells()
        holds = verdict != "unexplained"
        found, constants = self.findings() if holds else [], self.constants
        record = {
            "verdict": verdict,
            "where": self.where(verdict, cells),
            "findings": found,
            "parameters": self.parameters() if holds else {},
            "bookkeeping": [],
            "explained": self.explained.record,
            "fit": self.fit(),
            "rejected": self.rejected(),
            "next": [],
            "quality": [str(each) for each in self.faults],
            "constants": constants,
            "correlations": self.constants_fit.correlations(len(self.plain.structure.terms[0].unknowns)),
            "rest": self.rest,
            "remarks": [*self.remarks, *self.held_remarks()],
            "cells": cells,
        }
        model = {
            "format": "drillenv-model/1",
            "rig": "one-body",
            "constants": {name: each["value"] for name, each in constants.items()} if holds else {},
            "effects": [effect for each in found for effect in effects_of(each)],
        }
        return BodyOutcome(record, model, tuple(self.wave(body) for body in self.bodies))


def effects_of(finding: dict[str, Any]) -> list[dict[str, Any]]:
    """A finding as effects of a model file: by its equation, or by its curve."""
    if finding["form"] != "measured":
        values = {symbol: part["value"] for symbol, part in finding["parameters"].items()}
        return [{"name": finding["mechanism"], "parameters": values}]
    law = finding.get("law")
    if law is None:
        return []
    curve = {"argument_unit": law["argument_unit"], "unit": law["unit"], "x": law["x"], "y": law["y"]}
    return [{"name": f"tabulated-{law['argument'].replace(' ', '-')}", "parameters": curve}]


def near_equation(step: Step) -> Tried | None:
    """The equation that explains nearly all that a measured law does.

    The one of fewest parameters, unless the best takes most of what that leaves.
    """
    near = [each for each in step.named.tried if each.worse < (1.0 - WELL_EXPLAINED) * step.gain]
    least = max(min((each.worse for each in near), default=0.0), 0.0)
    simple = [each for each in near if MOST_OF_LAW * each.worse <= least]
    return min(simple, key=lambda each: len(each.equation.unknowns), default=None)


def is_of_speed(*steps: Step) -> bool:
    """Whether the laws of steps are all over the speed."""
    return all(step.family.group in ("friction", "damper") for step in steps)


def law_at(term: Term, own: Floats, place: int, x: Floats, axes: Axes, stiffness: float) -> Floats:
    """(n,) N that a term says at arguments x (n,) of a place."""
    if isinstance(term, Curve):
        return interpolate(own @ term.basis, axes, term.place, x)
    if isinstance(term, ScaledLaw):
        # forces are those of the law times one and this: of the applied one that is so much less
        return -own[0] / (1.0 + own[0]) * x
    if not isinstance(term, Equation):
        return np.zeros_like(x)
    turn = 1.0 if place == DRIVE else -1.0
    return turn * equation_over(term.effect, term.parameters(own), place, x, stiffness)


def left_out_in_turn(fitted: Fitted) -> list[Floats]:
    """Shared parameters of a fit without each block, by one step of Newton's method.

    The others' gradient is followed by the Hessian of all: of a direction that the one left out alone says much of, the
    others say nothing that could be held against it.
    """
    hessian = regular(fitted.fit.hessian)
    return [fitted.fit.shared + np.linalg.solve(hessian, part.by_shared) for part in fitted.fit.parts]


def rms(fitted: Fitted, shared: Sequence[Floats] | None = None) -> float:
    """N, root mean square of what is left of rows that are judged, by parameters of each block or those of the fit."""
    every = shared or [fitted.fit.shared] * len(fitted.blocks)
    scales = fitted.structure.scales
    left = [block.left(x * scales)[block.data.keep] for block, x in zip(fitted.blocks, every, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
