"""The outcome of a blind trial as one page for a browser, which needs nothing but itself: no script, no network.

The words stand in ``trial.html``; tables are prepared and figures are drawn here, as SVG. The waveforms are those that
each report's own page holds. Whatever comes from a campaign or a report is text to the page, and is escaped.
"""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from drillenv.blind import curves, drawing
from drillenv.blind.detection import NOISE, UNITS
from drillenv.blind.marking import HELD_OUT, beside_true_constant, wilson
from drillenv.files import filled

Floats = NDArray[np.float64]
Mark = Mapping[str, Any]

CASES = 16
"""Campaigns that are shown with their waveforms; one of each group comes first."""
PERIODS = 3.0
"""Of the excitation, in the panels of a case."""
FATES = ("named", "in a class", "unexplained", "something else", "not seen", "no answer")
ABSENT = "named though absent"
UNREADABLE = (ArithmeticError, AttributeError, IndexError, KeyError, OSError, TypeError, ValueError)
"""What a file that is missing, or is not as expected, leads to: the page then does without it."""
PREFIXED = ("m", "s", "N", "Hz", "V")
PREFIXES = {-6: "\u00b5", -3: "m", 0: "", 3: "k"}
NONE = "\u2013"


def page(record: Mapping[str, Any], place: Path) -> str:
    """One self-contained HTML document.

    Args:
        record: As ``trial.json``.
        place: Folder of the trial. Waveforms and laws come from its ``reports``, ``campaigns`` and ``answers.json``;
            what is missing there is missing on the page.
    """
    marks, summary = record["marks"], record["summary"]
    answers = _by_campaign(_json(place / "answers.json"))
    return filled(
        "drillenv.blind",
        "trial.html",
        style=Markup((files("drillenv.blind") / "trial.css").read_text(encoding="utf-8")),
        record=record,
        rig=record.get("rig", "percussive-drill"),
        campaigns=len(marks),
        concealing=sum(bool(each["truth"] or each["wrong"]) for each in marks),
        command=_command(record),
        headline=list(_headline(marks, summary)),
        cost=_cost(summary),
        groups=[_group(name, each) for name, each in summary["groups"].items()],
        conditions=_conditions(summary["conditions"]),
        detection=_detection(record.get("curves") or {}),
        fates=FATES,
        absent=ABSENT,
        confusion=_confusion(summary["confusion"]),
        held=_held_out(marks),
        errors=_errors(marks),
        cases=[_case(mark, answers.get(mark["campaign"]), place) for mark in _chosen(marks)],
        periods=_three(PERIODS, trim=True),
        rows=[_row(mark) for mark in marks],
    )


# --- Words and numbers


def _three(value: Any, trim: bool = False) -> str:
    """Three digits; a dash where there is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return NONE
    if value == 0.0:
        return "0"
    rounded = float(f"{value:.2e}")
    exponent = math.floor(math.log10(abs(rounded)))
    if not -4 <= exponent < 6:
        return f"{value:.2e}"
    text = f"{rounded:,.{max(0, 2 - exponent)}f}"
    return text.rstrip("0").rstrip(".") if trim and "." in text else text


def _unit(unit: str) -> str:
    return {"1": "", "m/s^2": "m/s\u00b2"}.get(unit, unit)


def _listed(texts: Sequence[str], none: str = NONE) -> str:
    return ", ".join(texts) if texts else none


def _command(record: Mapping[str, Any]) -> str:
    """The command that repeats the trial."""
    command = f"drillenv prove --out DIR --seed {record['seed']} --campaigns {record['campaigns']}"
    command += f" --limit {record['limit']:g}"
    if "rig" in record:
        command += f" --rig {record['rig']}"
    return command + "".join(f" --{kind}" for kind in ("curves", "nulls") if record.get(kind))


def _headline(marks: Sequence[Mark], summary: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The numbers that a reader asks for first, each with what it counts."""
    hits = sum(bool(mark["right"]) for mark in marks)
    low, high = wilson(hits, len(marks))
    right = {"hits": hits, "of": len(marks), "low": low, "high": high}
    first = [bool(mark["right_by_first_rules"]) for mark in marks if "right_by_first_rules" in mark]
    also = f" By the first rules, which compare laws by themselves: {sum(first)}." if first else ""
    laws = summary["laws"]
    middle = "" if laws["median"] is None else f" The median error is {_three(100.0 * laws['median'])} %."
    for name, share, ideal, text in (
        ("Right", right, "100 %", f"Campaigns that meet every rule of their group.{also}"),
        (
            "False alarms",
            summary["false_alarms"],
            "0 %",
            "Campaigns with nothing missing (null and wrong-constant) in which physics was said to be missing.",
        ),
        (
            "Unexplained, nothing missing",
            summary["null_unexplained"],
            "0 %",
            "Campaigns of the same two groups with the verdict \u201cunexplained\u201d.",
        ),
        (
            "False findings",
            summary["false_findings"],
            "0 %",
            "Answered campaigns in which at least one finding matches nothing that was concealed.",
        ),
        (
            "Recall",
            summary["recall"],
            "100 %",
            "Concealed mechanisms, group \u201coutside\u201d excepted, that were named, alone or in a class of at most "
            "three.",
        ),
        (
            "Coverage of intervals",
            summary["coverage"],
            "95 %",
            "Stated 95 % intervals of parameters that hold the true value; mechanisms rightly named, by the "
            "library\u2019s own equation.",
        ),
        (
            "Laws within 10 %",
            laws["within"],
            "100 %",
            f"Curves of named mechanisms that differ from the true ones by at most 10 % of their size.{middle}",
        ),
        (
            "No answer",
            summary["no_answer"],
            "0 %",
            "Campaigns whose diagnosis ran out of time, failed or was ended.",
        ),
    ):
        yield {"name": name, "ideal": ideal, "text": text, **_share(share)}


def _share(share: Mapping[str, Any]) -> dict[str, Any]:
    """A share as the page writes it."""
    if not share["of"]:
        return {"count": "0 of 0", "percent": NONE, "interval": "no cases", "bar": Markup("")}
    return {
        "count": f"{share['hits']} of {share['of']}",
        "percent": f"{100.0 * share['hits'] / share['of']:.0f} %",
        "interval": f"{100.0 * share['low']:.0f} to {100.0 * share['high']:.0f} %",
        "bar": drawing.bar(share),
    }


def _cost(summary: Mapping[str, Any]) -> dict[str, str]:
    return {
        f"{name}_{which}": _three(summary[name].get(which)) for name in ("seconds", "memory_mib") for which in SPREAD
    }


SPREAD = ("median", "most")


def _group(name: str, group: Mapping[str, Any]) -> dict[str, Any]:
    """One row of the table by group."""
    of = group["right"]["of"]
    low, high = wilson(group["no_answer"], of)
    none = {"hits": group["no_answer"], "of": of, "low": low, "high": high}
    return {
        "name": name,
        "shares": [_share(each) for each in (group["right"], group["named"], none)],
        "median": _three(group["seconds_median"]),
        "most": _three(group["seconds_most"]),
    }


def _conditions(conditions: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the table by the conditions of the recordings."""
    words = {
        "colour": "noise",
        "anti_alias": "anti-alias filter",
        "bad_labels": "labels up to 1 % off",
        "bits": "converter, bits",
        "rate": "samples a second",
    }
    values_in_words = {"True": "yes", "False": "no"}
    return [
        {"name": words[name], "value": values_in_words.get(value, value.removesuffix(".0")), **_share(share)}
        for name, values in conditions.items()
        for value, share in sorted(values.items(), key=lambda each: (len(each[0]), each[0]))
    ]


def _detection(curves_of: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the table of detection curves: named at each strength, and the strength half found."""
    return [
        {
            "name": name,
            "where": each["where"].replace("_", " "),
            "unit": _unit(each["unit"]),
            "half_found": _three(each["half_found"]),
            "points": [
                {"strength": _three(point["strength"]), "share": f"{100.0 * point['share']:g} %", **_share(point)}
                for point in each["points"]
            ],
        }
        for name, each in curves_of.items()
    ]


def _confusion(confusion: Mapping[str, Mapping[str, int]]) -> dict[str, Any]:
    """Rows by the names of the mechanisms: what became of each, their sum, and how often it was named though absent."""
    rows = []
    for name in sorted(confusion):
        counts = [confusion[name].get(fate, 0) for fate in FATES]
        rows.append((name, counts, sum(counts), confusion[name].get(ABSENT, 0)))
    columns = [sum(row[1][i] for row in rows) for i in range(len(FATES))]
    return {"rows": rows, "total": (columns, sum(row[2] for row in rows), sum(row[3] for row in rows))}


def _concealed(mark: Mark) -> str:
    """What a campaign conceals, with equations."""
    return _listed(
        [*mark["truth"], *(f"wrong constant: {name.replace('_', ' ')}" for name in mark["wrong"])], "nothing"
    )


def _strength(mark: Mark) -> str:
    """The largest entries of what is missing: root mean squares, beside the noise of their channels."""
    sizes = {name: value / NOISE.get(name, 5.0) for name, value in mark["missing"].items()}
    largest = sorted((name for name in sizes if sizes[name] > 0.0), key=lambda name: -sizes[name])[:2]
    shown = [name for name in largest if sizes[name] >= 0.1 * sizes[largest[0]]]
    return _listed(
        [f"{name.replace('_', ' ')} {_three(mark['missing'][name])} {_unit(UNITS.get(name, 'N'))}" for name in shown]
    )


def _named(mark: Mark) -> str:
    """The findings; those that match nothing concealed are marked."""
    return _listed([f"{name} (absent)" if name in mark["false"] else name for name in mark["findings"]])


def _residual(mark: Mark, which: str) -> float | None:
    """Residual on the recordings held out over the noise floor; None where the report does not state both."""
    fit = mark.get("fit") or {}
    value, floor = (fit.get("held_out") or {}).get(which), fit.get("noise_floor")
    if not isinstance(value, int | float) or not isinstance(floor, int | float):
        return None
    return value / floor if 0.0 < value < math.inf and 0.0 < floor < math.inf else None


def _errors(marks: Sequence[Mark]) -> list[tuple[str, int, list[dict[str, str]]]]:
    """Campaigns that are not right, by group: the name, how many campaigns the group has, and the rows."""
    found = []
    for group in dict.fromkeys(mark["group"] for mark in marks):
        own = [mark for mark in marks if mark["group"] == group]
        rows = [_error(mark) for mark in own if not mark["right"]]
        if rows:
            found.append((group, len(own), rows))
    return found


def _error(mark: Mark) -> dict[str, str]:
    laws = [(name, f"{_three(100.0 * error)} %") for name, error in _law_errors(mark).items()]
    return {
        "campaign": mark["campaign"],
        "concealed": _concealed(mark),
        "strength": _strength(mark),
        "verdict": mark["verdict"] or NONE,
        "named": _named(mark),
        "law": laws[0][1] if len(laws) == 1 else _listed([f"{name} {error}" for name, error in laws]),
        "after": _three(_residual(mark, "after")),
        "status": mark["status"],
        "seconds": _three(mark["seconds"]),
    }


def _law_errors(mark: Mark) -> dict[str, float]:
    """Errors of laws by the rules that decide; trials before these were revised have the first ones alone."""
    return {**mark["laws"], **mark.get("laws_beside", {})}


def _row(mark: Mark) -> dict[str, Any]:
    """One row of the table of all campaigns."""
    return {
        "campaign": mark["campaign"],
        "group": mark["group"],
        "concealed": _concealed(mark),
        "verdict": mark["verdict"] or mark["status"],
        "named": _named(mark),
        "right": bool(mark["right"]),
        "seconds": _three(mark["seconds"]),
    }


# --- Recordings held out


def _held_out(marks: Sequence[Mark]) -> dict[str, Any]:
    """Residuals before and after on recordings held out, over the noise floor: figure and counts."""
    pairs = [(mark, _residual(mark, "before"), _residual(mark, "after")) for mark in marks]
    known = [(mark, before, after) for mark, before, after in pairs if before is not None and after is not None]
    explained = [bool(mark["right"]) for mark, _, after in known if after <= HELD_OUT]
    others = [bool(mark["right"]) for mark, _, after in known if after > HELD_OUT]
    return {
        "figure": _scatter(known) if known else None,
        "known": len(known),
        "left_out": len(marks) - len(known),
        "limit": HELD_OUT,
        "before": sum(before <= HELD_OUT for _, before, _ in known),
        "after": len(explained),
        "after_right": sum(explained),
        "others": len(others),
        "others_right": sum(others),
        "worse": sum(after > before for _, before, after in known),
    }


def _scatter(known: Sequence[tuple[Mark, float, float]]) -> Markup:
    """After against before, both logarithmic, with lines at the noise floor and at what counts as explained."""
    before, after = (np.array([each[i] for each in known], dtype=float) for i in (1, 2))
    x = drawing.Axis(
        min(0.9, 0.9 * before.min()), max(2.0, 1.15 * before.max()), 520.0, "before, over the noise floor", True
    )
    y = drawing.Axis(
        min(0.9, 0.9 * after.min()), max(2.0, 1.15 * after.max()), 320.0, "after, over the noise floor", True, True
    )
    floor, limit = float(y.at(1.0)), float(y.at(HELD_OUT))
    ends = np.array([min(x.low, y.low), max(x.high, y.high)])
    inside = [
        drawing.line(0, floor, x.length, floor, "floor"),
        drawing.line(0, limit, x.length, limit, "limit"),
        drawing.path(x, y, ends, ends, "equal"),
    ]
    for mark, one, other in known:
        left, top = float(x.at(one)), float(y.at(other))
        said = drawing.tag("title", f"{mark['campaign']}, {mark['group']}: {_three(one)} before, {_three(other)} after")
        inside.append(_point(left, top, bool(mark["right"]), said))
    over = [
        drawing.text(x.length - 4, limit - 4, f"{HELD_OUT:g} times the noise floor", "end", class_="halo"),
        drawing.text(x.length - 4, floor + 12, "noise floor", "end", class_="halo"),
    ]
    return drawing.chart(x, y, inside, "Residual on recordings held out, after against before", over)


def _point(left: float, top: float, right: bool, said: Markup | str = "") -> Markup:
    """A disc where a campaign is right, a cross where it is not: told apart without colour."""
    if right:
        return drawing.tag("circle", said, cx=f"{left:.1f}", cy=f"{top:.1f}", r=4, class_="right")
    d = f"M{left - 4:.1f} {top - 4:.1f}l8 8m0 -8l-8 8"
    return drawing.tag("path", said, d=d, class_="wrong")


# --- Cases


def _chosen(marks: Sequence[Mark]) -> list[Mark]:
    """The first campaign of each group, then of each the first that was marked otherwise, then the rest in turn."""
    queues = []
    for group in dict.fromkeys(mark["group"] for mark in marks):
        first, *others = [mark for mark in marks if mark["group"] == group]
        queues.append([first, *sorted(others, key=lambda mark: mark["right"] == first["right"])])
    turns = [mark for turn in zip_longest(*queues) for mark in turn if mark is not None]
    order = {mark["campaign"]: i for i, mark in enumerate(marks)}
    return sorted(turns[: max(CASES, len(queues))], key=lambda mark: order[mark["campaign"]])


def _case(mark: Mark, answer: Mapping[str, Any] | None, place: Path) -> dict[str, Any]:
    """What the page says and draws of one campaign."""
    folder = place / "reports" / mark["campaign"]
    panels, caption = _panels(_waves(folder / "report.html"), _frequencies(place / "campaigns" / mark["campaign"]))
    laws = list(_laws(mark, answer, _json(folder / "report.json"))) if answer else []
    return {
        "campaign": mark["campaign"],
        "group": mark["group"],
        "right": bool(mark["right"]),
        "concealed": _concealed(mark),
        "strength": _strength(mark),
        "verdict": mark["verdict"] or f"none ({mark['status']})",
        "named": _named(mark),
        "where": mark.get("where") or "",
        "before": _three(_residual(mark, "before")),
        "after": _three(_residual(mark, "after")),
        "panels": panels,
        "caption": caption,
        "laws": laws,
    }


def _json(path: Path) -> Any:
    """What a file holds; None where it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _by_campaign(answers: Any) -> dict[str, Mapping[str, Any]]:
    listed = answers if isinstance(answers, list) else []
    return {each["campaign"]: each for each in listed if isinstance(each, dict) and "campaign" in each}


def _waves(path: Path) -> list[Mapping[str, Any]]:
    """The waveforms that a report's page holds as JSON; none where it has none."""
    try:
        text = path.read_text(encoding="utf-8")
        found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
        waves = json.loads(found[1])["waves"] if found else []
        return [dict(wave) for wave in waves]
    except UNREADABLE:
        return []


def _frequencies(folder: Path) -> dict[str, float]:
    """Hz of the excitation, by the names of the recordings; those without a setting are left out."""
    try:
        recordings = _json(folder / "campaign.json")["recordings"]
        return {each["name"]: float(each["setting"]["frequency"]) for each in recordings if each.get("setting")}
    except UNREADABLE:
        return {}


class _Line(NamedTuple):
    """Of a panel: what it shows, and the values over the panel's times."""

    kind: str
    values: Floats


def _panels(waves: Sequence[Mapping[str, Any]], frequencies: Mapping[str, float]) -> tuple[list[Markup], str]:
    """Force and acceleration of the first recording held out, and what is to be said of them."""
    try:
        wave = next((each for each in waves if each["held"]), waves[0])
        frequency = frequencies.get(html.unescape(wave["name"]))
        time = wave["begin"] + _samples(wave["time"])
        begin, end = wave["view"]
        if frequency:
            # the view begins where the mismatch is largest; near the end of the samples it has to begin earlier
            begin = max(min(begin, float(time[-1]) - PERIODS / frequency), float(time[0]))
            end = begin + PERIODS / frequency
        shown = (time >= begin) & (time <= end)
        traces = sorted(wave["traces"], key=lambda trace: trace["channel"] not in ("force", "acceleration"))[:2]
        panels = [_panel(1e3 * time[shown], trace, shown) for trace in traces]
        held = "held out of the fit" if wave["held"] else "fitted; none was held out"
        excitation = f", excitation {_three(frequency, trim=True)} Hz" if frequency else ""
        return panels, f"Recording {html.unescape(wave['name'])}, {held}{excitation}."
    except UNREADABLE:
        return [], "The report holds no waveforms."


def _samples(text: str) -> Floats:
    """Samples in single precision, as a report's page packs them."""
    return np.frombuffer(base64.b64decode(text), dtype="<f4").astype(np.float64)


def _panel(time: Floats, trace: Mapping[str, Any], shown: NDArray[np.bool_]) -> Markup:
    """One channel, measured and simulated, over a time in ms."""
    lines = [
        _Line(kind, _samples(trace[kind])[shown]) for kind in ("measured", "before", "after") if trace[kind] is not None
    ]
    measured = next(each.values for each in lines if each.kind == "measured")
    # a simulation that is far off is cut off, so that the measured signal stays readable
    low, high = drawing.limits(measured, room=0.6)
    least, most = drawing.limits(*(each.values for each in lines))
    name, unit = html.unescape(trace["channel"]), html.unescape(trace["unit"])
    x = drawing.Axis(float(time[0]), float(time[-1]), 340.0, "time, ms")
    y = drawing.Axis(max(low, least), min(high, most), 150.0, f"{name}, {unit}", downwards=True)
    drawn = [drawing.path(x, y, *drawing.thinned(time, each.values), each.kind) for each in lines]
    return drawing.chart(x, y, drawn, f"{name}, {', '.join(each.kind for each in lines)}")


# --- Laws


def _laws(mark: Mark, answer: Mapping[str, Any], report: Any) -> Iterator[tuple[Markup, str]]:
    """For each named mechanism with a law: the true curve and the one found, and what is to be said of them."""
    for each in answer.get("mechanisms", ()):
        name = each.get("mechanism")
        try:
            if each["law"] is None or mark["mechanisms"][name] != "named":
                continue
            finding = next(one for one in report["findings"] if one["mechanism"] == name)
            law = each.get("law_realised") or each["law"]
            x, true = (np.asarray(law[key], dtype=float) for key in ("x", "y"))
            where = curves.Reference(**answer["reference"])
            found = curves.reported(finding, x, where, tuple(answer["conditions"]["noise"]))
            if found is None:
                continue
            error = _law_errors(mark).get(name)
            said = f"{name}: " + ("no error stated" if error is None else f"error {_three(100.0 * error)} %")
            compared = beside_true_constant(answer, report, name, finding, x, true) if "laws_beside" in mark else None
            if compared is None:
                compared = _compared(name, x, true, found)
            yield _law(law, x, true, found, compared), said
        except (*UNREADABLE, StopIteration):
            continue


def _compared(name: str, x: Floats, true: Floats, found: Floats) -> Floats | None:
    """The curve found, with what the rig's constants can take up chosen so that it is nearest to the true one.

    The marks compare these two. None where the constants can take up nothing.
    """
    free = curves.SHAPES[name].free
    return curves.nearest(found, true, x, free) if free and np.isfinite(found).any() else None


def _law(law: Mapping[str, Any], x: Floats, true: Floats, found: Floats, compared: Floats | None) -> Markup:
    """The true law, the one found, and the one found as it is compared."""
    series = {"true": true, "stated": found} | ({} if compared is None else {"compared": compared})
    across, x_unit = _scaled(x, law["argument_unit"])
    _, y_unit = _scaled(true, law["unit"])
    factor = _factor(true, law["unit"])
    low, high = drawing.limits(*(factor * each for each in series.values()))
    begin, end = drawing.limits(across, room=0.0 if x.size > 3 else 0.15)
    if not begin < end:
        begin, end = begin - 1.0, end + 1.0
    axis = drawing.Axis(begin, end, 340.0, law["argument"] + (f", {x_unit}" if x_unit else ""))
    up = drawing.Axis(low, high, 150.0, y_unit or "relative", downwards=True)
    drawn = []
    for kind, values in series.items():
        if x.size > 3:
            drawn.append(drawing.path(axis, up, across, factor * values, kind))
            continue
        for left, top in zip(axis.at(across), up.at(factor * values), strict=True):
            if math.isfinite(top):
                drawn.append(drawing.tag("circle", cx=f"{left:.1f}", cy=f"{top:.1f}", r=4, class_=f"{kind} dot"))
    return drawing.chart(axis, up, drawn, f"True law and the one found, against {law['argument']}")


def _factor(values: Floats, unit: str) -> float:
    """What brings values to a unit with a handy prefix."""
    largest = float(np.max(np.abs(values))) if values.size else 0.0
    if unit not in PREFIXED or largest <= 0.0:
        return 1.0
    return 10.0 ** -min(max(3 * math.floor(math.log10(2.0 * largest) / 3.0), -6), 3)


def _scaled(values: Floats, unit: str) -> tuple[Floats, str]:
    """Values in a unit with a handy prefix, and that unit."""
    factor = _factor(values, unit)
    return factor * values, PREFIXES[-round(math.log10(factor))] + _unit(unit)
