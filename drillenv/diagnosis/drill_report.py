"""What a diagnosis of the drilling rig found, as the record of a report and as a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from drillenv.corrected import Corrected
from drillenv.diagnosis.constants import NAMES, MisreadExcitations
from drillenv.diagnosis.drill_diagnosis import Outcome, wrong_constants
from drillenv.diagnosis.drill_identification import law_of
from drillenv.diagnosis.drill_prediction import StateEstimate, estimates_of
from drillenv.diagnosis.evidence import AGREED, cell, surplus
from drillenv.diagnosis.findings import cited, deviations, equivalents, form_of, parameters_of, rejected
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import LOGARITHMS, PLACE_NAMES, Curve, Equation, axes_visited
from drillenv.diagnosis.measured import (
    Visited,
    frequencies_shown,
    hum_amplitudes,
    hum_spectrum,
    measured_law,
    measured_response,
    quantity,
    response_record,
)
from drillenv.diagnosis.page import Trace, Wave
from drillenv.diagnosis.sensing import CHANNELS, Added, OwnDelays, Sensor
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.steps import Step
from drillenv.diagnosis.tables import LARGEST_LOG
from drillenv.diagnosis.terms import Term
from drillenv.diagnosis.thresholds import SEVERAL, SILENT, STRUCK_DRILL
from drillenv.dynamics.constitutive.places import MOUNT_DAMPER, MOUNT_SPRING, WAVEFORM
from drillenv.dynamics.effects import REGISTRY, Chosen, Effect, make
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.recordings import Campaign
from drillenv.rig import FREQUENCY_RANGE, PRESSURE_RANGE, Rig
from drillenv.rocks import Rock

OF_ROCK, OF_SHAKER = {"loading_stiffness", "unloading_stiffness"}, {"shaker_mass", "pressure_gain"}
"""Constants of the contact, and of the force balance of the shaker; others are of both masses or of the indenter."""
CELLS = ("no contact", "loading", "unloading")
FOLLOWS_NONE = "The model follows none of the recordings."
KNOTS = 40
"""Of a measured law in a model."""


def constants_found(outcome: Outcome) -> dict[str, Any]:
    """Every constant of the rig, as it was fitted beside what was found, and as the lab states it."""
    final = outcome.final
    found = zip(outcome.plain.structure.unknowns[: len(NAMES)], final.values, deviations(final), strict=False)
    return {
        each.name: {
            **quantity(float(value), std, each.unit),
            "nominal": float(each.value),
            "nominal_std": each.std if math.isfinite(each.std) else None,
        }
        for each, value, std in found
    }


def parameters(outcome: Outcome) -> dict[str, Any]:
    """Constants that are off by several of their tolerances."""
    every, names = constants_found(outcome), [each.name for each in outcome.final.structure.unknowns]
    off = [names[i] for i in wrong_constants(outcome.final)]
    return {name: {key: every[name][key] for key in ("value", "std", "unit", "nominal")} for name in off}


def findings(outcome: Outcome) -> list[dict[str, Any]]:
    """One entry for each mechanism."""
    if not outcome.mechanisms:
        return []
    ranges = visited(outcome.every)
    return [finding(outcome, step, ranges) for step in outcome.mechanisms]


def finding(outcome: Outcome, step: Step, ranges: Visited) -> dict[str, Any]:
    """A mechanism with its form, its parameters where it follows an equation, and its measured law."""
    final, named = outcome.final, step.named
    effect = REGISTRY[named.mechanism]
    entry: dict[str, Any] = {
        "mechanism": named.mechanism,
        "equivalents": equivalents(step),
        "explanation": effect.sentence,
        "form": form_of(step),
        "parameters": {} if named.equation is None else parameters_of(final, named.equation),
        "evidence": {"gain": round(step.gain, 1), "freedom": step.dof, **cited(effect, named.equation is not None)},
    }
    terms = step.terms
    own = dict(sorted(of_recordings(outcome.every, terms[0]).items()))
    if own:
        entry["recordings"] = own
        entry["parameters"] = means(final, terms[0], own, effect)
        if isinstance(terms[0], OwnDelays):
            entry["law"] = level(final, entry["parameters"]["delay_a"])
    elif isinstance(terms[0], Added):
        entry["parameters"] = entry["parameters"] or parameters_of(final, terms[0])
        hums = [each for each in terms if isinstance(each, Added) and each.orders]
        if hums:
            entry["law"] = hum_spectrum(final, hums)
        if len(hums) > 1:
            # what corrects an equation is a part of the amplitude
            for channel, (symbol, (_name, unit)) in enumerate(zip(("b_f", "b_a"), CHANNELS, strict=True)):
                size, std = map(float, hum_amplitudes(final, hums, channel)[0])
                entry["parameters"][symbol] = quantity(size, std, unit)
    elif isinstance(terms[0], Sensor):
        if named.equation is None:
            entry["parameters"] = summed_up(final, terms[0])
        entry["law"] = measured_response(final, [each for each in terms if isinstance(each, Sensor)], named.mechanism)
    else:
        nearest = named.tried[0] if named.tried and named.equation is None else None
        entry["law"] = measured_law(final, step.family, terms, ranges, nearest)
    return entry


def of_recordings(estimates: Sequence[StateEstimate], term: Term) -> dict[str, dict[str, float]]:
    """What is each recording's own of a delay or an offset, those held out included; {} where it is none of these."""
    if isinstance(term, OwnDelays):
        return {each.block.name: {"delay_a": float(own_values(each, term)[0])} for each in estimates}
    if isinstance(term, Added) and term.names and not term.orders:
        # of recordings held out a constant is a line of the noise
        added = {each.block.name: each.block.constant_added(each.own) + term_mean(each, term) for each in estimates}
        return {name: {"o_f": float(both[0]), "o_a": float(both[1])} for name, both in added.items()}
    return {}


def own_values(estimate: StateEstimate, term: Term) -> Floats:
    """Parameters of a term in one recording."""
    there = estimate.block.structure.current([term])[0]
    return there.of_recording(estimate.block.name, estimate.values_of(term))[1]


def term_mean(estimate: StateEstimate, term: Added) -> Floats:
    """(2,) mean over a recording of what a term adds to its channels; 0 where its model does not have it."""
    block = estimate.block
    if not block.structure.current([term]):
        return np.zeros(2)
    said = term.add(estimate.values_of(term), block.point._replace(rate=block.data.rate), block.data.force.size)
    return np.zeros(2) if said is None else said.mean(axis=1)


def means(final: Fitted, term: Term, own: Mapping[str, Mapping[str, float]], effect: Effect) -> dict[str, Any]:
    """Means over recordings of what is each one's own, with the standard deviations of the means."""
    symbols, found = list(next(iter(own.values()))), {}
    every = np.array([[values[symbol] for symbol in symbols] for values in own.values()])
    if len(every) > 1:
        stds = every.std(axis=0, ddof=1) / math.sqrt(len(every))
    else:
        # the first parameter of each symbol
        stds = deviations(final)[final.indices_of([term])].reshape(len(symbols), -1)[:, 0]
    for symbol, mean, std in zip(symbols, every.mean(axis=0), stds, strict=True):
        found[symbol] = quantity(float(mean), std, effect.parameter(symbol).unit)
    return found


def level(final: Fitted, mean: Mapping[str, float]) -> dict[str, Any]:
    """A lag that is the same at each frequency, as ``law`` of a report."""
    frequency = frequencies_shown(final)
    return response_record("s", frequency, np.full(frequency.size, mean["value"]), np.full(frequency.size, mean["std"]))


def summed_up(final: Fitted, term: Sensor) -> dict[str, Any]:
    """What a sensor's free law comes to, in numbers."""
    inside = final.indices_of([term])
    scales = term.scales
    covariance = final.covariance[np.ix_(inside, inside)] * np.outer(scales, scales)
    return {name: quantity(*each) for name, each in term.summed_up(final.values[inside], covariance).items()}


def visited(estimates: Sequence[StateEstimate]) -> Visited:
    """What recordings visit, by the model that was found."""
    runs = [each.block.integrate(each.model, each.own, path=True) for each in estimates]
    paths = [each.block.inside_path(raw.path) for each, raw in zip(estimates, runs, strict=True)]
    frequencies = [each.block.point.frequency for each in estimates]
    depths = np.concatenate([path[V.W][(path[V.W] > 0.0) & (path[V.V2] > 0.0)] for path in paths])
    depth = float(np.median(depths)) if depths.size else 1e-5
    axes = axes_visited(paths, [each.model for each in estimates])
    per_impact = float(np.mean([each.per_impact for each in runs]))
    return Visited(axes, (min(frequencies), max(frequencies)), depth, per_impact)


def stated(campaign: Campaign) -> Corrected:
    """The model as the lab states it."""
    values = [campaign.nominal[name].value or 0.0 for name in NAMES]
    return Corrected(Rig(*values[:6]), Rock(*values[6:8], name="stated"))


def corrected(outcome: Outcome) -> Corrected:
    """The model with what was found: equations as effects, measured laws as tables."""
    values = dict(zip(NAMES, outcome.final.values, strict=False))
    rig = Rig(*(float(values[name]) for name in NAMES[:6]))
    loading, unloading = (float(values[name]) for name in NAMES[6:])
    # where a law says most of the unloading, its constant may come out below: such a rock would give energy away
    rock = Rock(loading, max(loading, unloading), name="corrected")
    effects: list[Chosen] = []
    for step in outcome.steps:
        equation = step.named.equation
        if equation is not None:
            known = {each.symbol: each for each in REGISTRY[step.named.mechanism].parameters}
            stated = {
                name: each["value"] for name, each in parameters_of(outcome.final, equation).items() if name in known
            }
            # a fit may leave what an effect may be, by less than it is sure of
            found = {name: min(max(value, known[name].low), known[name].high) for name, value in stated.items()}
            effects.append(make(step.named.mechanism, **found))
        else:
            effects += tabulated(outcome.final, step)
    return Corrected(rig, rock, tuple(effects))


def tabulated(final: Fitted, step: Step) -> list[Chosen]:
    """The curves of a measured law as effects."""
    model = law_of(final, step.terms, final.blocks[0].point)
    made = []
    for term in step.terms:
        if isinstance(term, Equation) and term.has_states:
            # of a mount, its equation alone: curves over its own motion are no effects
            own = term.parameters(final.values_of(term.name))
            symbols = [each.symbol for each in REGISTRY[term.effect].parameters]
            made.append(make(term.effect, **dict(zip(symbols, own, strict=True))))
        if not isinstance(term, Curve) or term.place in (MOUNT_SPRING, MOUNT_DAMPER):
            continue
        x = final.structure.axes.points(term.place)
        y = model.curve(term.place)
        pick = np.unique(np.linspace(0, x.size - 1, KNOTS).astype(int))
        x, y = x[pick], y[pick]
        if term.place == WAVEFORM:
            # a turn ends where it began, but for rounding
            y[-1] = y[0]
        if term.place in LOGARITHMS:
            x, y = x * model.s[V.KL], np.exp(np.clip(y, -LARGEST_LOG, LARGEST_LOG))
        made.append(make(f"tabulated-{PLACE_NAMES[term.place]}", x=x.tolist(), y=y.tolist()))
    return made


def cells_of(outcome: Outcome) -> list[dict[str, Any]]:
    """Where the paper's model with fitted constants fails: reduced chi-square by recording, channel and regime.

    Of recordings that it follows.
    """
    cells = []
    for estimate in filter(is_followed, estimates_of(outcome.plain)):
        block = estimate.block
        _reading, left, force = predicted(estimate)
        force = force[block.evaluation]
        rising = np.gradient(force) > 0.0
        for regime, mask in zip(CELLS, (force <= 0.0, (force > 0.0) & rising, (force > 0.0) & ~rising), strict=True):
            for channel, signal in zip(("force", "acceleration"), left, strict=True):
                if mask.any():
                    cells.append(cell(block.point.name, channel, regime, signal[mask] ** 2))
    return cells


def where(outcome: Outcome, cells: list[dict[str, Any]]) -> dict[str, Any]:
    """Balance, regimes and recordings of the mismatch, and a sentence."""
    if outcome.verdict == "agrees":
        return {"balance": None, "regimes": [], "recordings": [], "summary": AGREED}
    if outcome.verdict == "parameters":
        names = {outcome.final.structure.unknowns[i].name for i in wrong_constants(outcome.final)}
        return {
            "balance": "contact" if names & OF_ROCK else "shaker" if names <= OF_SHAKER else "indenter",
            "regimes": list(CELLS),
            "recordings": [each.name for each in outcome.fit_data],
            "summary": "Constants that are off by several of their tolerances explain all of it.",
        }
    struck = sorted({each["recording"] for each in cells if each["mean_square"] > STRUCK_DRILL})
    if outcome.mechanisms and outcome.verdict == "missing-physics":
        effects = [REGISTRY[step.named.mechanism] for step in outcome.mechanisms]
        return {
            "balance": effects[0].balances[0],
            "regimes": list(effects[0].regimes),
            "recordings": struck,
            "summary": " ".join([*(effect.sentence for effect in effects), outcome.explained.sentence]),
        }
    known = [step.family.outside for step in outcome.mechanisms if step.family.outside]
    if known:
        return {"balance": "sensor", "regimes": list(CELLS), "recordings": struck, "summary": " ".join(known)}
    if not cells:
        names = [each.name for each in outcome.fit_data]
        return {"balance": None, "regimes": [], "recordings": names, "summary": FOLLOWS_NONE}
    channel, regime = most_left(cells)
    text = f"Most of what is left is in the {channel}, {regime}."
    if outcome.mechanisms:
        nearest = " and ".join(step.named.mechanism for step in outcome.mechanisms)
        share = 100.0 * max(outcome.explained.share, 0.0)
        text += f" {nearest} comes nearest, with {share:.2g} % of it on {outcome.explained.of}."
    if outcome.refuted:
        found = " and ".join(outcome.refuted)
        text += f" What was found, {found}, makes {outcome.explained.of} worse than they are without, and is left out."
    return {
        "balance": "contact" if channel == "force" and regime != "no contact" else "indenter",
        "regimes": [regime],
        "recordings": struck,
        "summary": text,
    }


def quality_of_fit(outcome: Outcome) -> dict[str, Any]:
    """How well it fits, in standard deviations of the sensors' noise."""
    held = outcome.proof.chi_squares

    def root(chi_square: float | None) -> float | None:
        return None if chi_square is None or not math.isfinite(chi_square) else round(math.sqrt(chi_square), 4)

    return {
        "unit": "standard deviations of the sensors' noise, root mean square over force and acceleration",
        "noise_floor": 1.0,
        "fitted": {
            "recordings": [each.name for each in outcome.fit_data],
            "before": root(outcome.plain.reduced_chi_square),
            "after": root(outcome.final.reduced_chi_square),
        },
        "held_out": {
            "recordings": outcome.proof.names,
            "before": root(held[0] if held else None),
            "after": root(held[1] if held else None),
        },
    }


def rest(outcome: Outcome) -> dict[str, Any]:
    """What is left beyond the noise, of recordings held out where there are any."""
    channels, words = {}, []
    every = [each for each in outcome.proof.after or estimates_of(outcome.final) if is_followed(each)]
    if not every:
        return {"summary": FOLLOWS_NONE, "channels": {}, "shapes": []}
    found = [predicted(each) for each in every]
    left = [
        (each.block.measured - one.reading)[:, each.block.evaluation] for each, one in zip(every, found, strict=True)
    ]
    whole = np.concatenate([each.block.measured[:, each.block.evaluation] for each in every], axis=1)
    white = np.concatenate([one.residual for one in found], axis=1)
    for j, (channel, unit) in enumerate(CHANNELS):
        over = float(np.mean(white[j] ** 2))
        root = float(np.sqrt(np.mean(np.concatenate([each[j] for each in left]) ** 2)))
        excess, size = root * math.sqrt(max(1.0 - 1.0 / over, 0.0)), float(np.std(whole[j]))
        channels[channel] = {"excess": excess, "unit": unit, "of_signal": excess / size, "over_noise": over}
        words.append(f"{excess:.2g} {unit} ({100.0 * excess / size:.2g} % of the {channel})")
    text = f"{' and '.join(words)} beyond the noise are left on {outcome.explained.of}."
    return {"summary": text, "channels": channels, "shapes": []}


class Predicted(NamedTuple):
    """What a model says of a recording."""

    reading: Floats
    """(2, n) of the force cell in N and of the accelerometer in m/s^2."""
    residual: Floats
    """(2, steady) whitened, where both channels are judged."""
    force: Floats
    """(n,) N of the rock."""


def is_followed(estimate: StateEstimate) -> bool:
    """Whether states of a recording were found with which the model gets through it."""
    return math.isfinite(estimate.block.cost(estimate.shared, estimate.own))


def predicted(estimate: StateEstimate) -> Predicted:
    """What a model says of a recording."""
    block, own, shared = estimate
    values = shared * block.scales
    raw = block.integrate(estimate.model, own)
    residual = block.residual(values, raw.signals, own)[:, block.warm_up :]
    return Predicted(block.read(values, raw.signals) + block.disturbance(own), residual, raw.signals[0, :: block.over])


def what_to_record(outcome: Outcome, cells: Sequence[Mapping[str, Any]]) -> list[str]:
    """What would tell most of what is left unexplained, by where it is left and what the recordings span."""
    said = []
    channel, regime = most_left(cells) if cells else ("", "")
    if regime == "no contact":
        said.append(
            f"Record the rig with the indenter clear of the rock, at these settings: what the {channel} shows then is "
            "of the drive, the spring, the guides or the sensor, and not of the rock."
        )
    else:
        said.append(
            "Record a slow indentation of this rock, unloading included (drillenv indentation), and blows from rest at "
            "two amplitudes: they say the rock's law apart from the motion of the rig."
        )
    settings = [block.point for block, _own, _shared in outcome.every]
    for name, span, unit in (("frequency", FREQUENCY_RANGE, "Hz"), ("pressure", PRESSURE_RANGE, "bar")):
        values = [float(getattr(each, name)) for each in settings]
        if max(values) - min(values) < 0.5 * (span[1] - span[0]):
            said.append(
                f"Record at another {name}: these span {min(values):.4g} to {max(values):.4g} {unit} of "
                f"{span[0]:g} to {span[1]:g} {unit}, by which laws of speed and depth are told apart."
            )
    return said


def most_left(cells: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Channel and regime in which most is left beyond the noise."""
    beyond = surplus(cells, "channel", "regime")
    channel, regime = max(beyond, key=lambda key: beyond[key])
    return channel, regime


def remarks(outcome: Outcome) -> list[str]:
    """What the recordings say so little of that something wrong would pass."""
    final = outcome.final
    spread = deviations(final)
    silent = [
        each.name.replace("_", " ")
        for each, std in zip(final.structure.unknowns[: len(NAMES)], spread, strict=False)
        if std > SILENT * each.scale
    ]
    said = noise_floors(outcome) + misread_remarks(final)
    lost = sorted({each.block.point.name for each in (*outcome.proof.before, *outcome.every) if not is_followed(each)})
    if lost:
        said.append(f"No states were found with which a model follows {', '.join(lost)}: nothing is claimed of them.")
    if silent:
        named = " and the ".join(silent)
        said.append(f"The recordings say next to nothing of the {named}: what the lab states stands unchecked.")
    return said


def misread_remarks(final: Fitted) -> list[str]:
    """Recordings near the mains whose drive is not as their excitation was read."""
    said, spread = [], deviations(final)
    for term, part in zip(final.structure.terms, final.structure.parts, strict=True):
        for i, name in enumerate(term.names if isinstance(term, MisreadExcitations) else ()):
            at = slice(part.start + 2 * i, part.start + 2 * i + 2)
            (share, ahead), std = final.values[at], spread[at]
            if np.any(np.abs(final.values[at]) > SEVERAL * std):
                said.append(
                    f"The excitation of {name} is so near to the mains that a hum on its channel is read with it: "
                    f"the drive is {100.0 * share:+.2g} % and {math.degrees(ahead):+.2g} degrees off what was read."
                )
    return said


def noise_floors(outcome: Outcome) -> list[str]:
    """Channels on which no noise is seen beside the steps of their converter."""
    said = []
    for j, (channel, unit) in enumerate(CHANNELS):
        data = [(each.block.noise[j].std, each.block.data) for each in outcome.every]
        least = [(std, each.quanta[j] / math.sqrt(12.0), math.sqrt(each.thinned)) for std, each in data]
        floors = [floor * thinned for std, floor, thinned in least if std <= 1.001 * floor]
        if floors:
            said.append(
                f"No noise is seen on the {channel} of {len(floors)} of {len(least)} recordings beside the steps, or "
                f"the dead band, of its converter: it is judged by {max(floors):.3g} {unit}."
            )
    return said


def waves(outcome: Outcome) -> tuple[Wave, ...]:
    """Force and acceleration of every recording, with what was believed and what was found where it is followed."""
    made = []
    fitted = list(zip(estimates_of(outcome.plain), estimates_of(outcome.final), strict=True))
    held = list(zip(*outcome.held_out, strict=True))
    for i, (before, after) in enumerate([*fitted, *held]):
        block = after.block
        inside = block.evaluation
        time = np.arange(block.data.force.size)[inside] / block.data.rate
        said = [predicted(each).reading[:, inside] if is_followed(each) else None for each in (before, after)]
        traces = tuple(
            Trace(channel, unit, block.measured[j, inside], *(None if each is None else each[j] for each in said))
            for j, (channel, unit) in enumerate(CHANNELS)
        )
        made.append(Wave(block.point.name, i >= len(fitted), time, traces))
    return tuple(made)


def record_of(outcome: Outcome, faults: list[str], left_out: Sequence[str] = ()) -> dict[str, Any]:
    """The record of ``report.json``: ``faults`` of the recordings, and what of them was ``left_out``."""
    explained = outcome.verdict != "unexplained"
    cells = cells_of(outcome)
    return {
        "verdict": outcome.verdict,
        "where": where(outcome, cells),
        "findings": findings(outcome) if explained else [],
        "parameters": parameters(outcome) if explained else {},
        "bookkeeping": [asdict(each) for each in outcome.labels],
        "explained": outcome.explained.record if outcome.mechanisms else None,
        "rest": rest(outcome),
        "fit": quality_of_fit(outcome),
        "rejected": rejected(outcome.steps, outcome.tested),
        "next": what_to_record(outcome, cells) if outcome.verdict == "unexplained" else [],
        "constants": constants_found(outcome) if explained else {},
        "correlations": outcome.final.correlations(len(NAMES)) if explained else None,
        "quality": faults,
        "remarks": [*left_out, *outcome.unusable, *(each.sentence for each in outcome.labels), *remarks(outcome)],
        "cells": cells,
    }
