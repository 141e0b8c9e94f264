"""Detection curves: the share of campaigns in which a mechanism is named, against its strength."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from drillenv.blind.marking import wilson

UNITS = {
    "contact": "N",
    "coupling": "N",
    "indenter": "N",
    "shaker": "N",
    "excitation_reading": "V",
    "force_reading": "N",
    "acceleration_reading": "m/s^2",
}
"""Of what is missing, by where it acts."""
NOISE = {"excitation_reading": 0.002, "acceleration_reading": 2.0}
"""What a reading is divided by to find the channel that shows most; forces are divided by 5 N."""
STEEPEST = 8.0
"""Of a curve, as the exponent of the strength."""


def strength(mark: Mapping[str, Any]) -> tuple[str, float]:
    """Where the missing physics of a campaign shows most, and its root mean square there."""
    missing = mark["missing"]
    place = max(UNITS, key=lambda name: missing[name] / NOISE.get(name, 5.0))
    return place, float(missing[place])


def half_found(strengths: Sequence[float], named: Sequence[bool]) -> float | None:
    """The strength at which half of the campaigns are named: a logistic curve over the logarithm of the strength.

    Maximum likelihood, with a weak normal prior on the slope; None where all or none are named.
    """
    x, y = np.log(np.asarray(strengths)), np.asarray(named, dtype=float)
    if y.all() or not y.any():
        return None

    def cost(p: np.ndarray) -> float:
        slope = min(math.exp(p[1]), STEEPEST)
        z = slope * (x - p[0])
        return float(np.sum(np.logaddexp(0.0, z) - y * z) + 0.5 * (p[1] - math.log(2.0)) ** 2)

    found = minimize(cost, [float(np.mean(x)), math.log(2.0)], method="Nelder-Mead")
    return math.exp(float(found.x[0]))


def detection_curves(marks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """For each mechanism of the curve campaigns: the share named at each strength, and the strength half found.

    Args:
        marks: Of a trial; those whose group is not ``curve`` are left out.
    """
    by_name: dict[str, list[Mapping[str, Any]]] = {}
    for mark in marks:
        if mark["group"] == "curve":
            by_name.setdefault(next(iter(mark["mechanisms"])), []).append(mark)
    found = {}
    for name, own in by_name.items():
        places = [strength(mark)[0] for mark in own]
        place = max(set(places), key=lambda each: (places.count(each), each))
        points = []
        for share in sorted({mark["share"] for mark in own}, reverse=True):
            at = [mark for mark in own if mark["share"] == share]
            hits = sum(bool(mark["named"]) for mark in at)
            low, high = wilson(hits, len(at))
            size = float(np.median([mark["missing"][place] for mark in at]))
            points.append({"share": share, "strength": size, "hits": hits, "of": len(at), "low": low, "high": high})
        sizes = [max(mark["missing"][place], 1e-12) for mark in own]
        found[name] = {
            "where": place,
            "unit": UNITS[place],
            "points": points,
            "half_found": half_found(sizes, [bool(mark["named"]) for mark in own]),
        }
    return found


def table(curves: Mapping[str, Mapping[str, Any]]) -> str:
    """Detection curves as a Markdown table, the mechanisms that are seen earliest first.

    Args:
        curves: Of :func:`detection_curves`.
    """
    shares = sorted({point["share"] for each in curves.values() for point in each["points"]}, reverse=True)
    heads = ["mechanism", "shows most on", "half found at", *(f"{share:.3g}" for share in shares)]
    rows = [heads, ["---"] * len(heads)]

    def ease(each: Mapping[str, Any]) -> float:
        whole = max(point["strength"] for point in each["points"])
        seen = any(point["hits"] for point in each["points"])
        return (0.0 if seen else math.inf) if each["half_found"] is None else each["half_found"] / whole

    for name, each in sorted(curves.items(), key=lambda pair: (ease(pair[1]), pair[0])):
        points = {point["share"]: point for point in each["points"]}
        named = [f"{points[share]['hits']} of {points[share]['of']}" if share in points else "" for share in shares]
        rows.append([name, each["where"].replace("_", " "), _half(each), *named])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _half(each: Mapping[str, Any]) -> str:
    """The strength at which a mechanism is found half of the time, or what is known of it where that is not seen."""
    strengths = [point["strength"] for point in each["points"]]
    if each["half_found"] is not None:
        return f"{each['half_found']:.2g} {each['unit']}"
    seen = any(point["hits"] for point in each["points"])
    return f"below {min(strengths):.2g} {each['unit']}" if seen else f"above {max(strengths):.2g} {each['unit']}"
