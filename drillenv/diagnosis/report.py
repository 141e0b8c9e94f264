"""The answer: a record for programs, a model file, and text for people."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.corrected import Corrected, model_record
from drillenv.diagnosis.decide import Outcome, diagnose_drill
from drillenv.diagnosis.fit import UNITS, Fit
from drillenv.diagnosis.one_body import diagnose_body
from drillenv.diagnosis.page import Trace, Wave, page
from drillenv.diagnosis.search import SEVERAL
from drillenv.diagnosis.separate import separation
from drillenv.diagnosis.shape import described
from drillenv.diagnosis.shooting import residual
from drillenv.dynamics.effects import REGISTRY
from drillenv.dynamics.sensors import PerChannel
from drillenv.files import whole
from drillenv.recordings import Campaign, QualityFinding, check_quality, read_campaign

SILENT = 0.7
"""Share of a constant's stated standard deviation that is left of it where the recordings say nothing."""
CELLS = ("no contact", "loading", "unloading")


@dataclass(frozen=True, slots=True)
class Report:
    """What a diagnosis says."""

    title: str
    """Of the campaign."""
    record: Mapping[str, Any]
    """As ``report.json``: verdict, where, findings, parameters, fit, rejected, quality and more."""
    model: Mapping[str, Any]
    """The corrected model, as ``model.json``."""
    waves: tuple[Wave, ...]
    """Measured and simulated channels, for ``report.html``."""

    @property
    def verdict(self) -> str:
        """agrees, parameters, missing-physics or unexplained."""
        return self.record["verdict"]

    def text(self) -> str:
        """For a terminal."""
        return _text(self.record)

    def html(self) -> str:
        """For a browser: one page that needs nothing else."""
        return page(self.title, self.record, self.waves)

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write report.json, report.html and model.json into a folder, which is made where there is none.

        Raises:
            InputError: it cannot be written.
        """
        place = Path(folder)
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the folder {shown(str(folder))}: {error.strerror}; give another") from None
        texts = {
            "report.json": json.dumps(self.record, indent=1, allow_nan=False) + "\n",
            "model.json": json.dumps(self.model, indent=2, allow_nan=False) + "\n",
            "report.html": self.html(),
        }
        for name, text in texts.items():
            with whole(place / name) as part:
                part.write_text(text, encoding="utf-8")


def diagnose(campaign: Campaign | str | os.PathLike[str], note: Callable[[str], object] | None = None) -> Report:
    """Find out where and why the recordings of a rig differ from its model.

    Args:
        campaign: A campaign, or the folder of one.
        note: Told what is being done.

    Raises:
        InputError: the campaign cannot be read, or holds too little that can be used.
    """
    if not isinstance(campaign, Campaign):
        campaign = read_campaign(campaign)
    faults = check_quality(campaign)
    if campaign.rig == "one-body":
        body = diagnose_body(campaign, faults, note)
        return Report(campaign.title, body.record, body.model, body.waves)
    bad = {each.recording for each in faults if each.severity in ("exclude recording", "exclude channel")}
    kept = tuple(each for each in campaign.recordings if each.name not in bad)
    if len(kept) < 3:
        reasons = "; ".join(str(each) for each in faults[:3])
        raise InputError(f"{len(kept)} recordings can be used, give at least three sound ones ({reasons})")
    if len(kept) < len(campaign.recordings):
        campaign = replace(campaign, recordings=kept)
    outcome = diagnose_drill(campaign, note)
    return _report(campaign.title, outcome, faults)


def _report(title: str, outcome: Outcome, faults: tuple[QualityFinding, ...]) -> Report:
    final = outcome.final
    physics = final.physics()
    explained = outcome.verdict != "unexplained"
    cells = excess(outcome)
    record: dict[str, Any] = {
        "verdict": outcome.verdict,
        "where": _where(outcome, cells),
        "findings": _findings(outcome) if explained else [],
        "parameters": _parameters(final) if explained else {},
        "fit": _fit(outcome),
        "rejected": [
            {"mechanism": mechanism, "why": f"{why} ({gain:.0f} of half a sum of squares)"}
            for mechanism, gain, why in outcome.rejected
        ],
        "next": _next(outcome),
        "quality": [str(each) for each in faults],
        "remarks": _remarks(outcome),
        "cells": cells,
    }
    model = Corrected(physics.rig, physics.rock, (*physics.motion, *physics.sensors)) if explained else Corrected()
    return Report(title, record, model_record(model), _waves(outcome))


def _waves(outcome: Outcome) -> tuple[Wave, ...]:
    """Force and acceleration of every recording, with what was believed and what was found."""
    made = []
    recordings = (*outcome.fit_data, *outcome.held_data)
    for i, (data, (before, after)) in enumerate(zip(recordings, outcome.pairs, strict=True)):
        inside = data.judged
        time = np.arange(data.force.size)[inside] / data.rate
        traces = tuple(
            Trace(channel, unit, *(getattr(each, channel)[inside] for each in (data, before, after)))
            for channel, unit in (("force", "N"), ("acceleration", "m/s^2"))
        )
        made.append(Wave(data.name, i >= len(outcome.fit_data), time, traces))
    return tuple(made)


def _next(outcome: Outcome) -> list[str]:
    """What to record to tell apart what these recordings cannot."""
    first = outcome.fit_data[0]
    noise = PerChannel(first.noise_excitation, first.noise_force, first.noise_acceleration)
    said = []
    for step in outcome.steps:
        for name, rival in step.rivals.items():
            one, other = (each.physics() for each in (step.fitted, rival))
            found = separation(one, other, noise)
            if found is not None:
                f, a, p = found.setting.frequency, found.setting.amplitude, found.setting.pressure
                said.append(
                    f"To tell {step.mechanism} from {name}, start the rig on fresh rock at {f:g} Hz, {a:g} V and {p:g} "
                    f"bar: there their {found.channel} differs by {found.apart:.1f} times the noise."
                )
    return said


def _remarks(outcome: Outcome) -> list[str]:
    """What the recordings say so little of that something wrong would pass."""
    final, said = outcome.final, []
    if outcome.wider_as_well:
        said.append("The recordings touch one end of the play only: what is given is how wide it is at least.")
    silent = [
        each.name.replace("_", " ")
        for each, std in zip(final.hypothesis.constants, final.spread, strict=False)
        if std > SILENT * each.width
    ]
    if silent:
        named = " and the ".join(silent)
        said.append(f"The recordings say next to nothing of the {named}: what the lab states stands unchecked.")
    return said


def excess(outcome: Outcome) -> list[dict[str, Any]]:
    """Where the paper's model, its constants fitted, fails: mean square over the noise's by recording, channel, regime.

    1 where nothing but the noise is left.
    """
    fitted = outcome.plain
    cells = []
    thin = [each.thinned(4) for each in outcome.fit_data]
    for data, made in zip(thin, fitted.predictions, strict=True):
        left = residual(data, made)
        inside = np.zeros(data.force.size, dtype=bool)
        inside[data.judged] = True
        touching = made.force > 0.0
        rising = np.gradient(made.force) > 0.0
        for regime, mask in zip(CELLS, (~touching, touching & rising, touching & ~rising), strict=True):
            mask = mask & inside
            for channel, signal in zip(("force", "acceleration"), left, strict=True):
                if mask.any():
                    cells.append(
                        {
                            "recording": data.name,
                            "channel": channel,
                            "regime": regime,
                            "samples": int(mask.sum()),
                            "mean_square": float(np.mean(signal[mask] ** 2)),
                        }
                    )
    return cells


def _where(outcome: Outcome, cells: list[dict[str, Any]]) -> dict[str, Any]:
    """Balance, regimes and recordings of the mismatch, and a sentence."""
    if outcome.verdict == "agrees":
        text = "What is left is noise within the stated tolerances of the constants."
        return {"balance": None, "regimes": [], "recordings": [], "summary": text}
    if outcome.verdict == "parameters":
        return {
            "balance": "contact" if any("loading" in name for name in _parameters(outcome.final)) else "indenter",
            "regimes": list(CELLS),
            "recordings": [each.name for each in outcome.fit_data],
            "summary": "Constants that are off by several of their tolerances explain all of it.",
        }
    if outcome.steps and outcome.verdict == "missing-physics":
        effects = [REGISTRY[step.mechanism] for step in outcome.steps]
        return {
            "balance": effects[0].balances[0],
            "regimes": list(effects[0].regimes),
            "recordings": sorted({each["recording"] for each in cells if each["mean_square"] > 1.1}),
            "summary": " ".join(effect.sentence for effect in effects),
        }
    surplus = {
        key: sum((each["mean_square"] - 1.0) * each["samples"] for each in cells if _cell(each) == key)
        for key in {_cell(each) for each in cells}
    }
    channel, regime = max(surplus, key=lambda key: surplus[key])
    text = [f"Most of what is left is in the {channel}, {regime}.", *described(outcome.fit_data, outcome.final)]
    return {
        "balance": "contact" if channel == "force" and regime != "no contact" else "indenter",
        "regimes": [regime],
        "recordings": sorted({each["recording"] for each in cells if each["mean_square"] > 1.1}),
        "summary": " ".join(text),
    }


def _cell(cell: Mapping[str, Any]) -> tuple[str, str]:
    return cell["channel"], cell["regime"]


def _findings(outcome: Outcome) -> list[dict[str, Any]]:
    """One entry for each mechanism."""
    final = outcome.final
    spread = final.spread
    strengths = {
        each.name: (value, std)
        for each, value, std in zip(final.hypothesis.parameters, final.values, spread, strict=True)
    }
    findings = []
    for step in outcome.steps:
        effect = REGISTRY[step.mechanism]
        parameters = {}
        for entry in effect.parameters:
            known = strengths.get(f"{step.mechanism} {entry.symbol}")
            if known is not None:
                value, std = known
                if entry.unit == "rad":
                    # a fit may have gone round
                    value = math.remainder(value, 2.0 * math.pi)
                parameters[entry.symbol] = {"value": float(value), "std": float(std), "unit": entry.unit}
        findings.append(
            {
                "mechanism": step.mechanism,
                "equivalents": sorted(step.rivals),
                "explanation": effect.sentence,
                "parameters": parameters,
                "evidence": {
                    "gain": round(step.gain, 1),
                    "gain_needed": round(step.threshold, 1),
                    "equation": effect.equation,
                    "source": effect.source,
                },
            }
        )
    return findings


def _parameters(final: Fit) -> dict[str, Any]:
    """Constants that are off by several of their tolerances."""
    spread = final.spread
    return {
        each.name: {
            "value": float(value),
            "std": float(std),
            "unit": UNITS[each.name],
            "nominal": float(each.value),
        }
        for each, value, std in zip(final.hypothesis.constants, final.values, spread, strict=False)
        if abs(value - each.value) > SEVERAL * each.width
    }


def _fit(outcome: Outcome) -> dict[str, Any]:
    """How well it fits, in standard deviations of the sensors' noise."""

    def root(mean_square: float | None) -> float | None:
        return None if mean_square is None else round(math.sqrt(mean_square), 4)

    return {
        "unit": "standard deviations of the sensors' noise, root mean square over force and acceleration",
        "noise_floor": 1.0,
        "fitted": {
            "recordings": [each.name for each in outcome.fit_data],
            "before": root(outcome.before[0]),
            "after": root(outcome.left),
        },
        "held_out": {
            "recordings": [each.name for each in outcome.held_data],
            "before": root(outcome.before[1]),
            "after": root(outcome.after),
        },
    }


def _text(record: Mapping[str, Any]) -> str:
    """The report on a page of text."""
    lines = [f"verdict: {record['verdict']}", record["where"]["summary"]]
    for finding in record["findings"]:
        strengths = ", ".join(
            f"{symbol} = {entry['value']:.4g} +- {entry['std']:.2g} {entry['unit']}"
            for symbol, entry in finding["parameters"].items()
        )
        lines.append(f"mechanism: {finding['mechanism']} ({strengths})")
        if finding["equivalents"]:
            lines.append(f"  these recordings cannot tell it from: {', '.join(finding['equivalents'])}")
    for name, entry in record["parameters"].items():
        found = f"{entry['value']:.6g} +- {entry['std']:.2g} {entry['unit']}"
        believed = entry["nominal"]
        lines.append(f"constant: {name} = {found}" + ("" if believed is None else f", believed {believed:g}"))
    lines += record.get("next", [])
    held = record["fit"]["held_out"]
    if held["recordings"]:
        lines.append(
            f"held out ({', '.join(held['recordings'])}): "
            f"{held['before']} times the noise before, {held['after']} after"
        )
    lines += [f"quality: {each}" for each in record["quality"]]
    lines += record.get("remarks", [])
    return "\n".join(lines)
