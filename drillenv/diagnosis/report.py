"""The answer: a record for programs, a model file, and text for people."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from drillenv.checks import InputError, count, shown
from drillenv.compiling import helped
from drillenv.corrected import model_record
from drillenv.diagnosis.body_diagnosis import diagnose_body
from drillenv.diagnosis.condition import without_unusable
from drillenv.diagnosis.drill_diagnosis import CORES, diagnose_drill, nominal_rig
from drillenv.diagnosis.drill_report import corrected, record_of, stated, waves
from drillenv.diagnosis.page import Wave, page
from drillenv.diagnosis.provenance import provenance
from drillenv.diagnosis.scope import bounded, limits_of, scope_of
from drillenv.dynamics.hybrid.shooting import COMPILE_DERIVATIVES
from drillenv.files import made_folder, whole
from drillenv.recordings import Campaign, check_quality, read_campaign
from drillenv.recordings.excerpt import excerpts
from drillenv.recordings.findings import NOTE, QualityFinding
from drillenv.recordings.sound_parts import sound_parts


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
        place = made_folder(folder)
        texts = {
            "report.json": json.dumps(self.record, indent=1, allow_nan=False) + "\n",
            "model.json": json.dumps(self.model, indent=2, allow_nan=False) + "\n",
            "report.html": self.html(),
        }
        for name, text in texts.items():
            with whole(place / name) as part:
                part.write_text(text, encoding="utf-8")


def diagnose(
    campaign: Campaign | str | os.PathLike[str],
    note: Callable[[str], object] | None = None,
    exclude: Sequence[str] = (),
    jobs: int | None = None,
    only: Sequence[str] = (),
    interruptible: bool = False,
    within: float = math.inf,
) -> Report:
    """Find out where and why the recordings of a rig differ from its model.

    Args:
        campaign: A campaign, or the folder of one.
        note: Told what is being done.
        exclude: Names of recordings to leave out.
        jobs: Recordings of the drilling rig that are fitted side by side; None for two.
        only: Parts of the rig (contact, indenter, shaker, sensor, body), places of laws or mechanisms, outside of which
            nothing is looked for; all of it where there are none. Constants are always.
        interruptible: Whether an interruption from the keyboard ends the search on a drilling rig with a report of what
            has been found so far, which says that it is unfinished.
        within: Processor seconds after which the search on a drilling rig ends in the same way; to hold what was found
            against recordings held out takes a little longer.

    Raises:
        InputError: the campaign cannot be read, has no recording of a name to exclude, or holds too little that can be
            used; ``jobs`` is below 1; ``only`` has a name that the rig has not.
        KeyboardInterrupt: interrupted where that is not to end the search, or before anything was found.
    """
    if not isinstance(campaign, Campaign):
        campaign = read_campaign(campaign)
    jobs = CORES if jobs is None else count("jobs", jobs, 1, 1024)
    campaign, scope = without_recordings(campaign, exclude), scope_of(only, campaign.rig)
    faults, origin = check_quality(campaign), provenance(campaign)
    if campaign.rig == "one-body":
        body = diagnose_body(campaign, faults, note, scope)
        return Report(campaign.title, bounded({**origin, **body.record}, only, ""), body.model, body.waves)
    campaign, left_out = sound_parts(campaign, faults)
    if not campaign.recordings:
        raise InputError(f"no recording can be used: give one that is sound ({reasons(faults)})")
    campaign, shortened = excerpts(campaign)
    campaign, unusable = without_unusable(campaign, nominal_rig(campaign))
    with helped(COMPILE_DERIVATIVES):
        outcome = diagnose_drill(campaign, note, jobs, scope, interruptible, within)
    model = stated(campaign) if outcome.verdict == "unexplained" else corrected(outcome)
    record = record_of(outcome, [str(each) for each in faults], [*left_out, *shortened, *unusable])
    record = bounded({**origin, **record}, only, outcome.stopped)
    return Report(campaign.title, record, model_record(model), waves(outcome))


def reasons(faults: Sequence[QualityFinding]) -> str:
    """Why recordings cannot be used: the first fault of each kind, at most three kinds."""
    kinds = {(each.channel, each.kind): each for each in reversed(faults) if each.severity != NOTE}
    first = [each for each in faults if kinds.get((each.channel, each.kind)) is each]
    return "; ".join(str(each) for each in first[:3])


def without_recordings(campaign: Campaign, names: Sequence[str]) -> Campaign:
    """A campaign without the recordings of these names.

    Raises:
        InputError: there is none of a name, or none is left.
    """
    there = [each.name for each in campaign.recordings]
    unknown = [name for name in names if name not in there]
    if unknown:
        raise InputError(f"exclude names {shown(unknown[0])}: give names of recordings ({', '.join(there)})")
    kept = tuple(each for each in campaign.recordings if each.name not in names)
    if not kept:
        raise InputError("exclude names all recordings: leave at least one")
    return replace(campaign, recordings=kept) if names else campaign


def _text(record: Mapping[str, Any]) -> str:
    """The report on a page of text."""
    limits = limits_of(record)
    verdict = f"verdict: {record['verdict']}" + (f" ({limits})" if limits else "")
    lines = [verdict, record["where"]["summary"]]
    for finding in record["findings"]:
        strengths = ", ".join(
            f"{symbol} = {entry['value']:.4g} +- {entry['std']:.2g} {entry['unit']}"
            for symbol, entry in finding["parameters"].items()
        )
        form = finding.get("form", "library")
        form = {"measured": " by a measured law", "library": ""}.get(form, f" as {form}")
        lines.append(f"mechanism: {finding['mechanism']}{form}" + (f" ({strengths})" if strengths else ""))
        if finding["equivalents"]:
            lines.append(f"  these recordings cannot tell it from: {', '.join(finding['equivalents'])}")
    for name, entry in record["parameters"].items():
        found = f"{entry['value']:.6g} +- {entry['std']:.2g} {entry['unit']}"
        believed = entry["nominal"]
        lines.append(f"constant: {name} = {found}" + ("" if believed is None else f", believed {believed:g}"))
    lines += record.get("next", [])
    held = record["fit"]["held_out"]
    if held["recordings"]:
        unit = str(record["fit"]["unit"]).partition(",")[0]
        before, after = (
            "not followed" if each is None else f"{each:.4g} {unit}" for each in (held["before"], held["after"])
        )
        lines.append(f"left on recordings held out ({', '.join(held['recordings'])}): {before} before, {after} after")
    lines += [f"quality: {each}" for each in record["quality"]]
    lines += record.get("remarks", [])
    return "\n".join(lines)
