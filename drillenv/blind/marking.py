"""The marks of a trial, by the rules of docs/trial/rules.md: the first ones, and those revised since."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drillenv.blind import curves
from drillenv.blind.mechanisms import MECHANISMS, MENDED_GAPS, NAMED_BY_FORMAT, OUTSIDE

LARGEST_CLASS = 3
"""Mechanisms that a finding and its equivalents may be, at most, to count as named."""
HELD_OUT = 1.1
"""Times the noise that may be left on recordings held out."""
INSIDE = 1.96
"""Standard deviations either way that make a 95 % interval."""
CONSTANT_SHARE, CONSTANT_STD = 0.02, 3.0
"""A stated constant is right within this share of its true value, or so many of its standard deviations."""

UNREADABLE = (ArithmeticError, ValueError, KeyError, TypeError)
"""What a report raises that cannot be read as a curve: it has none."""
CONDITIONS = ("colour", "anti_alias", "bad_labels", "bits", "rate")
"""What of a recording's conditions the marks are broken down by."""


def wilson(hits: int, total: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's score interval for a share (E. B. Wilson, Journal of the American Statistical Association 22, 1927)."""
    if total == 0:
        return 0.0, 1.0
    share, over = hits / total, 1.0 + z * z / total
    middle = (share + z * z / (2.0 * total)) / over
    half = z * math.sqrt(share * (1.0 - share) / total + z * z / (4.0 * total * total)) / over
    return max(0.0, middle - half), min(1.0, middle + half)


def mark(answer: Mapping[str, Any], outcome: Mapping[str, Any], report: Mapping[str, Any] | None) -> dict[str, Any]:
    """Mark one campaign.

    Args:
        answer: What is true, as sealed.
        outcome: How the diagnosis ended: ``status`` "answered", or why there is no answer.
        report: Its report.json, where it answered.
    """
    names = [each["mechanism"] for each in answer["mechanisms"]]
    made: dict[str, Any] = {
        "group": answer["group"],
        "share": answer.get("share"),
        "truth": [f"{each['mechanism']} ({each['equation']})" for each in answer["mechanisms"]],
        "wrong": dict(answer["wrong"]),
        "missing": answer["missing"],
        "conditions": {name: answer["conditions"][name] for name in CONDITIONS if name in answer["conditions"]},
        "status": outcome["status"],
        "seconds": outcome["seconds"],
        "memory_mib": outcome["memory_mib"],
        "verdict": None,
        "findings": [],
        "right": False,
        "right_by_first_rules": False,
        "named": False,
    }
    if report is None:
        return made | {
            "mechanisms": dict.fromkeys(names, "no answer"),
            "false": [],
            "laws": {},
            "laws_beside": {},
            "intervals": [],
        }
    findings = report["findings"] if report["verdict"] == "missing-physics" else []
    matched = {name: _finding_of(name, findings) for name in names}
    used = [id(each) for each in matched.values() if each is not None]
    false = [each["mechanism"] for each in findings if id(each) not in used]
    laws = _laws(answer, matched)
    revised = _laws_revised(answer, matched, report)
    made |= {
        "verdict": report["verdict"],
        "findings": [each["mechanism"] for each in findings],
        "mechanisms": {name: _fate(name, matched[name], report, false) for name in names},
        "false": false,
        "laws": laws,
        "laws_beside": revised,
        "intervals": _intervals(answer, matched) if not false and report["verdict"] == "missing-physics" else [],
        "fit": report.get("fit"),
        "where": report.get("where", {}).get("summary"),
        "constants": {name: entry["value"] for name, entry in report.get("parameters", {}).items()},
        "constants_right": _constants_right(answer, report),
    }
    made["named"] = _named(answer, made)
    made["right"] = made["named"] and _agree(answer, made, laws | revised)
    made["right_by_first_rules"] = made["named"] and _agree(answer, made, laws)
    return made


def _finding_of(name: str, findings: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """The finding that names a mechanism, itself or in an equivalence class of at most three."""
    also = {name, *_also(name)}
    for each in findings:
        if each["mechanism"] in also:
            return each
    for each in findings:
        members = {each["mechanism"], *each.get("equivalents", ())}
        if members & also and len(members) <= LARGEST_CLASS:
            return each
    return None


def _also(name: str) -> tuple[str, ...]:
    for each in (*MECHANISMS.values(), *OUTSIDE.values()):
        if each.name == name:
            return each.also
    return ()


def _fate(name: str, finding: Mapping[str, Any] | None, report: Mapping[str, Any], false: Sequence[str]) -> str:
    """What became of a mechanism that was there."""
    if finding is not None:
        return "named" if finding["mechanism"] in (name, *_also(name)) else "in a class"
    if report["verdict"] == "unexplained":
        return "unexplained"
    return "something else" if false else "not seen"


def _named(answer: Mapping[str, Any], made: Mapping[str, Any]) -> bool:
    """Whether the verdict is right, all that is there is named, and nothing that is not."""
    group, verdict = answer["group"], made["verdict"]
    if made["false"]:
        return False
    if group == "null":
        return verdict == "agrees" or (verdict == "parameters" and made["constants_right"])
    if group == "wrong-constant":
        return verdict == "parameters" and set(answer["wrong"]) <= set(made["constants"]) and made["constants_right"]
    found = all(fate in ("named", "in a class") for fate in made["mechanisms"].values())
    if group == "outside":
        if MENDED_GAPS in made["mechanisms"]:
            return verdict != "missing-physics"
        return verdict == "unexplained" or (verdict == "missing-physics" and found)
    return verdict == "missing-physics" and found


def _agree(answer: Mapping[str, Any], made: Mapping[str, Any], laws: Mapping[str, float]) -> bool:
    """Whether, where the equation is not the library's, the force found is the one that was missing."""
    if made["verdict"] != "missing-physics":
        return True
    fit = made["fit"] or {}
    held, floor = (fit.get("held_out") or {}).get("after"), fit.get("noise_floor")
    for each in answer["mechanisms"]:
        if each["of_library"] or each["mechanism"] in NAMED_BY_FORMAT:
            continue
        if each["law"] is None:  # no function of one argument: the recordings held out have to be explained
            if held is None or not floor or held > HELD_OUT * floor:
                return False
        elif not laws.get(each["mechanism"], math.inf) <= curves.LARGEST_ERROR:
            return False
    return True


def _laws(
    answer: Mapping[str, Any], matched: Mapping[str, Mapping[str, Any] | None], which: str = "law"
) -> dict[str, float]:
    """For each mechanism with a curve that was named: the error of the curve found, by itself as by the first rules."""
    where = curves.Reference(**answer["reference"])
    errors = {}
    for each, finding, x, true in _curves(answer, matched, which):
        with suppress(*UNREADABLE):
            found = curves.reported(finding, x, where, tuple(answer["conditions"]["noise"]))
            if found is not None:
                errors[each] = curves.law_error(each, x, true, found)
    return {name: error for name, error in errors.items() if math.isfinite(error)}


def _laws_revised(
    answer: Mapping[str, Any], matched: Mapping[str, Mapping[str, Any] | None], report: Mapping[str, Any]
) -> dict[str, float]:
    """The same by the revised rules: of laws beside a constant of the rig, and of those that differ by recording."""
    errors = _laws(answer, matched, "law_realised")
    for each, finding, x, true in _curves(answer, matched):
        with suppress(*UNREADABLE):
            found = beside_true_constant(answer, report, each, finding, x, true)
            if found is not None:
                errors[each] = curves.law_error_beside(each, x, true, found)
    return {name: error for name, error in errors.items() if math.isfinite(error)}


def _curves(
    answer: Mapping[str, Any], matched: Mapping[str, Mapping[str, Any] | None], which: str = "law"
) -> Iterator[tuple[str, Mapping[str, Any], NDArray[np.float64], NDArray[np.float64]]]:
    """Mechanisms with a curve that were named: the finding, and argument and quantity of the true curve."""
    for each in answer["mechanisms"]:
        # absent where nothing is drawn anew for each recording, of single bodies, and before the second revision
        finding, law = matched[each["mechanism"]], each.get(which)
        if finding is not None and law is not None and finding["mechanism"] == each["mechanism"]:
            yield each["mechanism"], finding, np.asarray(law["x"], dtype=float), np.asarray(law["y"], dtype=float)


def beside_true_constant(
    answer: Mapping[str, Any],
    report: Mapping[str, Any],
    mechanism: str,
    finding: Mapping[str, Any],
    x: NDArray[np.float64],
    true: NDArray[np.float64],
) -> NDArray[np.float64] | None:
    """The law found, beside the rig's constant as it is in truth; None where it stands beside none, or of other rigs.

    Raises:
        UNREADABLE: one of these, where the report cannot be read as a curve.
    """
    whole = curves.SHAPES[mechanism].whole
    if whole is None or "loading_stiffness" not in answer["true"]:
        return None
    constants = answer["true"][whole.constant], float(report["constants"][whole.constant]["value"])
    where, noise = curves.Reference(**answer["reference"]), tuple(answer["conditions"]["noise"])
    return curves.law_beside(mechanism, x, finding, constants, true, where, noise)


def _intervals(answer: Mapping[str, Any], matched: Mapping[str, Mapping[str, Any] | None]) -> list[dict[str, Any]]:
    """For each parameter of the library's own equations that is known on both sides: whether its interval holds it."""
    found = []
    for each in answer["mechanisms"]:
        finding = matched[each["mechanism"]]
        if finding is None or not each["of_library"] or finding["mechanism"] != each["mechanism"]:
            continue
        for symbol, entry in finding.get("parameters", {}).items():
            if symbol in each["parameters"] and entry["std"] is not None:
                off = entry["value"] - each["parameters"][symbol]
                if symbol.startswith(("phi", "psi")):
                    off = math.remainder(off, 2.0 * math.pi)
                found.append(
                    {
                        "parameter": f"{each['mechanism']} {symbol}",
                        "true": each["parameters"][symbol],
                        "found": entry["value"],
                        "std": entry["std"],
                        "inside": abs(off) <= INSIDE * entry["std"],
                    }
                )
    return found


def _constants_right(answer: Mapping[str, Any], report: Mapping[str, Any]) -> bool:
    """Whether all constants that the report states are right, and those that the lab has wrong are among them."""
    stated = report.get("parameters", {})
    for name, entry in stated.items():
        true = answer["true"].get(name)
        if true is None:
            return False
        width = max(CONSTANT_SHARE * abs(true), CONSTANT_STD * (entry.get("std") or 0.0))
        if abs(entry["value"] - true) > width:
            return False
    return set(answer["wrong"]) <= set(stated)


# --- What the marks come to


def _share(marks: Sequence[Mapping[str, Any]], holds: Any) -> dict[str, Any]:
    hits = sum(bool(holds(each)) for each in marks)
    low, high = wilson(hits, len(marks))
    return {"hits": hits, "of": len(marks), "low": low, "high": high}


def _by_first_rules(marks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The share that is right by the first rules, where marks say so: those of earlier trials are by these alone."""
    if not all("right_by_first_rules" in each for each in marks):
        return {}
    return {"right_by_first_rules": _share(marks, lambda each: each["right_by_first_rules"])}


def summary(marks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Counts with Wilson intervals: by group, the confusion table, false alarms, coverage, held-out errors, cost."""
    groups = {}
    for name in dict.fromkeys(each["group"] for each in marks):
        own = [each for each in marks if each["group"] == name]
        groups[name] = {
            "right": _share(own, lambda each: each["right"]),
            "named": _share(own, lambda each: each["named"]),
            **_by_first_rules(own),
            "no_answer": sum(each["status"] != "answered" for each in own),
            "seconds_median": float(np.median([each["seconds"] for each in own])),
            "seconds_most": max(each["seconds"] for each in own),
        }
    confusion: dict[str, dict[str, int]] = {}
    for each in marks:
        for name, fate in each["mechanisms"].items():
            row = confusion.setdefault(name, {})
            row[fate] = row.get(fate, 0) + 1
        for name in each["false"]:
            row = confusion.setdefault(name, {})
            row["named though absent"] = row.get("named though absent", 0) + 1
    null = [each for each in marks if each["group"] in ("null", "wrong-constant")]
    present = [each for each in marks if each["mechanisms"] and each["group"] != "outside"]
    fates = [{"named": fate in ("named", "in a class")} for each in present for fate in each["mechanisms"].values()]
    intervals = [entry for each in marks for entry in each["intervals"]]
    answered = [each for each in marks if each["status"] == "answered"]
    laws = [error for each in marks for error in (each["laws"] | each.get("laws_beside", {})).values()]
    return {
        "groups": groups,
        "conditions": _by_condition(marks),
        "confusion": confusion,
        "false_alarms": _share(null, lambda each: each["verdict"] == "missing-physics"),
        "null_unexplained": _share(null, lambda each: each["verdict"] == "unexplained"),
        "recall": _share(fates, lambda each: each["named"]),
        "false_findings": _share(answered, lambda each: each["false"]),
        "coverage": _share(intervals, lambda each: each["inside"]),
        "laws": {
            "within": _share([{"error": each} for each in laws], lambda each: each["error"] <= curves.LARGEST_ERROR),
            "median": float(np.median(laws)) if laws else None,
        },
        "no_answer": _share(marks, lambda each: each["status"] != "answered"),
        "seconds": _spread([each["seconds"] for each in marks]),
        "memory_mib": _spread([each["memory_mib"] for each in marks]),
    }


def _by_condition(marks: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """For each condition and each of its values: how many campaigns were right."""
    found: dict[str, dict[str, Any]] = {}
    for name in CONDITIONS:
        having = [each for each in marks if name in each["conditions"]]
        for value in sorted({each["conditions"][name] for each in having}):
            own = [each for each in having if each["conditions"][name] == value]
            found.setdefault(name, {})[str(value)] = _share(own, lambda each: each["right"])
    return found


def _spread(values: Sequence[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "most": float(max(values))} if values else {}
