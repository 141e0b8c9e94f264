"""Two diagnoses side by side: before and after a repair, or of two rigs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drillenv.checks import InputError, shown
from drillenv.diagnosis.provenance import FORMAT
from drillenv.files import read_record

LARGEST_FILE = 64 * 2**20


def read_report(path: str | Path) -> dict[str, Any]:
    """The record of a report.json.

    Raises:
        InputError: no such file, not JSON, or no report of this format.
    """
    return read_record(path, "report", FORMAT, LARGEST_FILE, _checked)


def _checked(record: object) -> dict[str, Any]:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        given = record.get("format") if isinstance(record, dict) else record
        raise InputError(f"its format is {shown(given)}: give a report.json of the format {FORMAT}")
    missing = [name for name in ("verdict", "findings", "constants", "fit") if name not in record]
    if missing:
        raise InputError(f"it lacks {', '.join(missing)}: give a whole report.json")
    return record


def compare(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """What differs between the records of two reports.

    Returns:
        ``verdict`` (two words), ``mechanisms`` that ``went``, ``came`` and ``stayed``, for what stayed ``parameters``
        and for all ``constants`` the value of each side, the difference and how many standard deviations of both it is,
        and ``left`` on recordings that were not fitted, in ``unit``.
    """
    first, second = ({each["mechanism"]: each for each in record["findings"]} for record in (before, after))
    stayed = [name for name in first if name in second]
    return {
        "verdict": [before["verdict"], after["verdict"]],
        "mechanisms": {
            "went": [name for name in first if name not in second],
            "came": [name for name in second if name not in first],
            "stayed": stayed,
        },
        "parameters": {name: _differences(first[name]["parameters"], second[name]["parameters"]) for name in stayed},
        "constants": _differences(before["constants"], after["constants"]),
        "left": [record["fit"]["held_out"]["after"] for record in (before, after)],
        "unit": str(after["fit"]["unit"]).partition(",")[0],
    }


def _differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Of quantities that both have, by name."""
    found = {}
    for name, one in before.items():
        other = after.get(name)
        if other is None:
            continue
        difference = other["value"] - one["value"]
        spread = math.hypot(one["std"], other["std"])
        found[name] = {
            "before": one["value"],
            "after": other["value"],
            "unit": one["unit"],
            "difference": difference,
            "sigmas": abs(difference) / spread if spread > 0.0 else None,
        }
    return found


def compared_text(found: Mapping[str, Any]) -> str:
    """For a terminal: what went and came, and what moved by three standard deviations or more."""
    lines = [f"verdict: {found['verdict'][0]}, then {found['verdict'][1]}"]
    for what in ("went", "came", "stayed"):
        if found["mechanisms"][what]:
            lines.append(f"{what}: {', '.join(found['mechanisms'][what])}")
    moved = [(name, symbol, each) for name, own in found["parameters"].items() for symbol, each in own.items()]
    moved += [("constant", name, each) for name, each in found["constants"].items()]
    still = 0
    for name, symbol, each in moved:
        if each["difference"] == 0.0 or (each["sigmas"] is not None and each["sigmas"] < 3.0):
            still += 1
            continue
        by = "" if each["sigmas"] is None else f", {each['sigmas']:.3g} standard deviations"
        lines.append(f"{name} {symbol}: {each['before']:.5g} to {each['after']:.5g} {each['unit']}{by}")
    if still:
        lines.append(f"{still} more numbers stayed within three standard deviations")
    first, second = found["left"]
    if first is not None and second is not None:
        lines.append(f"left on recordings that were not fitted: {first:.4g}, then {second:.4g} {found['unit']}")
    return "\n".join(lines)
