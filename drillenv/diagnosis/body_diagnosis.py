"""A campaign of a single body, from its recordings to what was found: conditioning, noise, search, report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import combinations
from typing import cast

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.diagnosis.body import Autoregression, ForceBalance, Stretch
from drillenv.diagnosis.body_channels import Body, prepare
from drillenv.diagnosis.body_noise import noise_of_richest
from drillenv.diagnosis.body_report import BodyOutcome, BodyReport, is_of_speed
from drillenv.diagnosis.body_rig import BodyRig, Scale, axes_of_bodies, gain_of_law, law_of_body, sampling
from drillenv.diagnosis.fitting import TIGHT, Fitted, fit_to
from drillenv.diagnosis.laws import Curve, Equation
from drillenv.diagnosis.naming import Named, Tried, does_as_well, without
from drillenv.diagnosis.scope import Scope
from drillenv.diagnosis.selection import forward
from drillenv.diagnosis.solver import Limits
from drillenv.diagnosis.steps import Step
from drillenv.diagnosis.terms import ModelStructure
from drillenv.diagnosis.thresholds import NOISY
from drillenv.recordings import Campaign, QualityFinding

FEWEST, PARTS = 3, 6
"""Recordings below which each is judged in so many parts."""


def diagnose_body(
    campaign: Campaign,
    faults: Sequence[QualityFinding] = (),
    note: Callable[[str], object] | None = None,
    scope: Scope | None = None,
) -> BodyOutcome:
    """The verdict on a campaign of one body.

    Args:
        campaign: Of the rig one-body.
        faults: Of the quality check; recordings, channels and stretches that they take out are not used.
        note: Told what is being done.
        scope: What is searched; everything where None.

    Raises:
        InputError: the campaign is of another rig, no recording can be used, or nothing says how large the mass is.
    """
    if campaign.rig != "one-body":
        raise InputError(f"campaign {shown(campaign.title)} is of the rig {campaign.rig}: give one of one-body")
    say = note or (lambda _text: None)
    say("making the channels comparable")
    bodies, remarks = prepare(campaign, faults)
    entry, forced = campaign.nominal["mass"], bodies[0].force is not None
    if not forced and entry.value is None:
        raise InputError(
            f"campaign {shown(campaign.title)}: no force is measured and the mass is not stated: give one of the two, "
            "or the law is known to a factor only"
        )
    mass = entry.value or 1.0
    stretches = stretches_of([body for body in bodies if not body.held], mass)
    measured = np.concatenate([each.measured[each.keep] for each in stretches])
    side = "force" if forced else "acceleration"
    if not np.ptp(measured) > 0.0:
        raise InputError(
            f"campaign {shown(campaign.title)}: the {side} never changes: see that its sensor was connected"
        )
    begun = replace(begin(campaign, stretches, mass), scope=scope)
    if white_floor(stretches, begun) > NOISY * float(np.std(measured)):
        raise InputError(
            f"campaign {shown(campaign.title)}: the {side} hardly stands out of its noise: "
            "see that its sensor was connected, or record larger motions"
        )
    with ThreadPoolExecutor(1) as pool:
        blocks = [ForceBalance(each, begun, TIGHT, cast("BodyRig", begun.rig).noise) for each in stretches]
        plain = fit_to(blocks, [np.zeros(0)] * len(blocks), begun, None, pool)
        say(f"reduced chi-square {plain.reduced_chi_square:.3f}")
        final, steps, tested = forward(plain, say)
        final, steps = as_sums(final.refit(limits=Limits(30, 1e-3)), as_one(steps), say)
        # both by one yardstick
        plain = plain.refit(noise=final.noise)
        return BodyReport(campaign, bodies, tuple(remarks), tuple(faults), plain, final, steps, tested).outcome()


def stretches_of(bodies: Sequence[Body], mass: float) -> list[Stretch]:
    """Recordings, or parts of them where they are few."""
    if len(bodies) >= FEWEST:
        return [Stretch(body, body.name, body.keep, mass) for body in bodies]
    found = []
    for body in bodies:
        part = np.arange(body.keep.size) * PARTS // body.keep.size
        found += [Stretch(body, f"{body.name}, part {i + 1}", body.keep & (part == i), mass) for i in range(PARTS)]
    return found


def begin(campaign: Campaign, stretches: Sequence[Stretch], mass: float) -> ModelStructure:
    """The law that the lab believes in, of a rig with the noise that its richest model leaves."""
    bodies = list({id(each.body): each.body for each in stretches}.values())

    def most(name: str) -> float:
        return max(float(np.percentile(np.abs(getattr(body, name)), 99.8)) for body in bodies)

    force = float(np.percentile(np.abs(np.concatenate([each.measured[each.keep] for each in stretches])), 99.8))
    scale = Scale(force, most("smooth_position"), most("smooth_velocity"))
    law, stated = law_of_body(campaign, bodies[0].force is not None, mass, scale)
    timing, axes = sampling(bodies[0].rate, mass), axes_of_bodies(bodies)
    rig = BodyRig(stretches, Autoregression(np.zeros(0), 1.0), scale, axes, stated, gain_of_law(law))
    noise = noise_of_richest(rig, (law, timing))
    return ModelStructure((law, timing), axes, replace(rig, noise=noise))


def white_floor(stretches: Sequence[Stretch], begun: ModelStructure) -> float:
    """N, root mean square that the white noise of the channels alone leaves of the balance as it is stated."""
    constants = {each.name: each.value for each in begun.terms[0].unknowns}
    total, rows = 0.0, 0
    for each in stretches:
        parts = {"velocity": constants.get("damping", 0.0), "position": constants.get("stiffness", 0.0)}
        if each.body.force is None:
            parts["acceleration"] = each.mass
        else:
            parts |= {"force": 1.0, "acceleration": constants.get("mass", 0.0)}
        count = int(each.keep.sum())
        total += count * sum((size * each.body.noise[name]) ** 2 for name, size in parts.items())
        rows += count
    return math.sqrt(total / rows)


def as_one(steps: Sequence[Step]) -> list[Step]:
    """Measured laws over the speed as one, under the name of that which explains most, and equations with them."""
    speed = [step for step in steps if is_of_speed(step)]
    if len(speed) < 2 or all(step.named.equation is not None for step in speed):
        return list(steps)
    most = max(speed, key=lambda step: step.gain)
    terms = tuple(term for step in speed for term in step.terms)
    named = replace(most.named, equation=None)
    return [replace(most, terms=terms, named=named) if step is most else step
            for step in steps if step is most or step not in speed]  # fmt: skip


def as_sums(fitted: Fitted, steps: Sequence[Step], say: Callable[[str], object]) -> tuple[Fitted, list[Step]]:
    """A fit and its steps, measured laws that two of the library's equations together say as well in two."""
    rig, found = cast("BodyRig", fitted.structure.rig), []
    for step in steps:
        places = {term.place for term in step.terms if isinstance(term, Curve)}
        curved = bool(places) and step.named.equation is None
        size = sum(len(term.unknowns) for term in step.terms)
        rest, start = without(fitted, step.terms) if curved else (fitted.structure, fitted.fit.shared)
        best: tuple[Fitted, tuple[Equation, ...]] | None = None
        for pair in combinations(rig.equations(places) if curved else (), 2):
            if pair[0].effect == pair[1].effect or {each.name for each in pair} & {e.name for e in rest.terms}:
                continue
            begun = np.concatenate([start, *(np.array(e.form.starts[0]) / e.scales for e in pair)])
            both = fitted.refit(replace(rest, terms=(*rest.terms, *pair)), begun)
            fewer = size - sum(len(each.unknowns) for each in pair)
            as_well = does_as_well(both.cost - fitted.cost, 0.0, fewer, fitted)
            if as_well and (best is None or both.cost < best[0].cost):
                best = both, pair
        if best is None:
            found.append(step)
            continue
        fitted = best[0]
        say(f"  {best[1][0].name} and {best[1][1].name} do as well: chi-square {fitted.reduced_chi_square:.4f}")
        for each in best[1]:
            values, others = fitted.values_of(each.name), without(fitted, (each,))
            named = Named(each.effect, each, (Tried(each, values, 0.0),))
            gain = fitted.refit(*others).cost - fitted.cost
            found.append(replace(step, named=named, terms=(each,), rivals=[], after=fitted, gain=gain))
    return fitted, found
