"""The answer as one page for a browser, which needs nothing but itself: no server, no network.

The words and tables are written here and in ``page.html``; ``page.js`` draws laws and waveforms with Plotly, whose
library goes into the page once. Whatever comes from a campaign is text to the page: Jinja escapes it, the curves travel
as data, and the page tells the browser by their hashes which scripts are its own, so that it runs no other.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import groupby
from typing import Any, TypeGuard

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.diagnosis.scope import limits_of
from drillenv.diagnosis.thresholds import SEVERAL
from drillenv.dynamics.effects import REGISTRY
from drillenv.files import filled

VALUES = 210_000
"""Of all waveforms together: a page of about 6 MB, of which Plotly takes most."""
MOST_SAMPLES = 10_000
"""Samples of one waveform: more than a screen shows, and few enough to zoom without a wait."""
FEWEST = 500
"""However many recordings there are."""
RESIDUAL_POINTS = 240
"""Of the curve that says how the residual goes along a recording."""
WIDTH = 20
"""Parts of a recording, over each of which that curve is a mean: some periods, or it would show every blow."""
SURE = 1.96
"""Standard deviations to either end of an interval of 95 %."""
VERDICTS = {
    "agrees": "The recordings agree with the model, within the sensors' noise and the stated tolerances.",
    "unexplained": "The recordings differ from the model, and no mechanism of the library accounts for it.",
}
BALANCES = {
    "contact": "contact (the law of the rock)",
    "indenter": "indenter (forces on m2)",
    "shaker": "shaker (forces on m1)",
    "sensor": "sensor (no force: a channel misreports)",
    "body": "body (forces on the mass)",
}
NUMERALS = ("no", "one", "two", "three", "four", "five", "six")
INKS = ((247, 249, 251), (201, 220, 238), (127, 178, 217), (47, 119, 180), (11, 58, 111))
"""Of the map, from nothing but noise to the worst cell: one hue, ever darker, for every kind of sight and for print."""
DARK = 0.6
"""Share of the way through ``INKS`` from which writing is white."""
KNOWN = ("gain", "equation", "source", "separate", "beside_a_free_lag", "share_of_left_out")
"""What the page says of the evidence in words of its own; any other number is listed."""


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One channel of a recording. Arrays have shape (n,), in ``unit``; NaN leaves a gap."""

    channel: str
    unit: str
    measured: np.ndarray
    before: np.ndarray | None = None
    """As the lab believed it. None for a channel that is shown beside the others and not simulated."""
    after: np.ndarray | None = None
    """With the constants and mechanisms found. None where nothing was found."""


@dataclass(frozen=True, slots=True, eq=False)
class Wave:
    """What the page shows of one recording."""

    name: str
    held: bool
    """Whether it took no part in the fit."""
    time: np.ndarray
    """(n,) s, ascending."""
    traces: tuple[Trace, ...]


def page(title: str, record: Mapping[str, Any], waves: Sequence[Wave]) -> str:
    """One self-contained HTML document.

    Args:
        title: Of the campaign.
        record: As the schema of ``report.json`` has it.
        waves: Of each recording that is to be seen. Long ones are shown in part: the stretch where the mismatch is
            largest, every sample of it, so that no peak is lost.

    Raises:
        InputError: the arrays of a recording differ in length, or are empty.
    """
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    for wave in waves:
        _check(wave)
    own = {name: (files("drillenv.diagnosis") / name).read_text(encoding="utf-8") for name in ("page.css", "page.js")}
    data = {"waves": _drawn(waves), "laws": [_law(each) for each in record["findings"]]}
    scripts = [get_plotlyjs(), own["page.js"]] if waves or any(data["laws"]) else []
    return filled(
        "drillenv.diagnosis",
        "page.html",
        title=title,
        style=Markup(own["page.css"]),
        # the hashes are of the very text between the tags
        scripts=[Markup(script) for script in scripts],
        hashes=[_hash(script) for script in scripts],
        data=Markup(_inert(data)),
        waves=waves,
        first=_worst(waves),
        record=record,
        sentence=sentence(record),
        facts=list(_facts(record)),
        chart=_map(record["cells"], [wave.name for wave in waves if wave.held]),
        fit=_fit(record["fit"]),
        findings=[_finding(each) for each in record["findings"]],
        constants=_constants(record),
        ahead=_ahead(record),
    )


def _check(wave: Wave) -> None:
    for trace in wave.traces:
        for series in _series(trace):
            if series.shape != wave.time.shape or series.ndim != 1 or not series.size:
                raise InputError(
                    f"recording {shown(wave.name)}: {trace.channel} has the shape {series.shape} and its times "
                    f"{wave.time.shape}: give as many samples as times"
                )


def _hash(script: str) -> str:
    """As a content security policy names a script."""
    return base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")


def _inert(data: object) -> str:
    """JSON that nothing inside can end: it holds no angle bracket."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c").replace(">", "\\u003e")


# the waveforms


def _series(trace: Trace) -> list[np.ndarray]:
    return [series for series in (trace.measured, trace.before, trace.after) if series is not None]


def _drawn(waves: Sequence[Wave]) -> list[dict[str, Any]]:
    """What page.js needs of each recording."""
    count = sum(1 + len(_series(trace)) for wave in waves for trace in wave.traces)
    least = max(FEWEST, min(MOST_SAMPLES, VALUES // max(count, 1)))
    return [_wave(wave, least) for wave in waves]


def _wave(wave: Wave, count: int) -> dict[str, Any]:
    size = wave.time.size
    part = _stretch(wave, slice(0, size), count)
    whole = part == slice(0, size)
    view = part if whole else _stretch(wave, part, count // 4)
    begin = float(wave.time[part.start])
    return {
        "name": wave.name,
        "held": wave.held,
        "whole": whole,
        "span": _ends(wave, slice(0, size)),
        "part": _ends(wave, part),
        "view": _ends(wave, view),
        "begin": begin,
        "time": _packed(wave.time[part] - begin),
        "traces": [
            {
                # Plotly reads a little HTML in its labels
                "channel": _plain(trace.channel),
                "unit": _plain(_unit(trace.unit)),
                "measured": _packed(trace.measured[part]),
                "before": None if trace.before is None else _packed(trace.before[part]),
                "after": None if trace.after is None else _packed(trace.after[part]),
                "along": None if whole or trace.before is None else _along(wave.time, trace),
            }
            for trace in wave.traces
        ],
    }


def _ends(wave: Wave, part: slice) -> list[float]:
    return [float(wave.time[part.start]), float(wave.time[part.stop - 1])]


def _packed(samples: np.ndarray) -> str:
    """Single precision, as a browser reads it."""
    return base64.b64encode(np.ascontiguousarray(samples, dtype="<f4").tobytes()).decode("ascii")


def _plain(text: str) -> str:
    return html.escape(text, quote=False)


def _left(trace: Trace) -> np.ndarray:
    """(n,) squares of what was left before, 0 where there is nothing to compare."""
    if trace.before is None:
        return np.zeros(trace.measured.size)
    return np.nan_to_num(trace.measured - trace.before, posinf=0.0, neginf=0.0) ** 2


def _stretch(wave: Wave, part: slice, count: int) -> slice:
    """So many samples, where the mismatch is largest over all channels."""
    if part.stop - part.start <= count:
        return part
    badness = np.zeros(part.stop - part.start)
    for trace in wave.traces:
        squares = _left(trace)[part]
        badness += squares / max(float(squares.mean()), 1e-300)
    sums = np.concatenate([[0.0], np.cumsum(badness)])
    start = part.start + int(np.argmax(sums[count:] - sums[:-count]))
    return slice(start, start + count)


def _along(time: np.ndarray, trace: Trace) -> dict[str, Any]:
    """Root mean square of the residual over a window that moves along the whole recording."""
    count = max(1, time.size // WIDTH)
    first = np.linspace(0, time.size - count, min(RESIDUAL_POINTS, time.size)).astype(int)

    def roots(series: np.ndarray | None) -> str | None:
        if series is None:
            return None
        squares = (trace.measured - series) ** 2
        known = np.isfinite(squares)
        sums, counts = (
            np.concatenate([[0.0], np.cumsum(each)])[[first, first + count]]
            for each in (np.where(known, squares, 0.0), known)
        )
        # a difference of sums may fall below zero by a rounding error
        mean = np.maximum(sums[1] - sums[0], 0.0) / np.maximum(counts[1] - counts[0], 1.0)
        return _packed(np.sqrt(np.where(counts[1] > counts[0], mean, np.nan)))

    middles = 0.5 * (time[first] + time[first + count - 1])
    return {"time": _packed(middles), "before": roots(trace.before), "after": roots(trace.after)}


def _worst(waves: Sequence[Wave]) -> int:
    """The recording to begin with: where the mismatch is largest beside the signal."""

    def mismatch(wave: Wave) -> float:
        shares = [
            float(_left(trace).mean()) / max(float(np.nanvar(trace.measured)), 1e-300)
            for trace in wave.traces
            if np.isfinite(trace.measured).any()
        ]
        return max(shares, default=0.0)

    return max(range(len(waves)), key=lambda i: mismatch(waves[i]), default=0)


# the words


def sentence(record: Mapping[str, Any]) -> str:
    """The verdict in one plain sentence."""
    limits = limits_of(record)
    if limits:
        return f"{limits[0].upper()}{limits[1:]}. As far as that goes: {_sentence(record)}"
    return _sentence(record)


def _sentence(record: Mapping[str, Any]) -> str:
    """The same of a whole search."""
    verdict = record["verdict"]
    wrong = [name for name, entry in record["parameters"].items() if entry["nominal"] is not None]
    if verdict == "missing-physics":
        names = [each["mechanism"] for each in record["findings"]]
        beside = f"; besides, {_off(wrong)}" if wrong else ""
        return f"The model leaves out {_count(len(names), 'mechanism')}: {_listed(names)}{beside}."
    if verdict == "parameters":
        return f"No physics is missing; {_off(wrong)}."
    return VERDICTS[verdict]


def _off(names: Sequence[str]) -> str:
    if not names:
        return "constants are off"
    return f"{_count(len(names), 'constant')} {'is' if len(names) == 1 else 'are'} off: {_listed(map(_words, names))}"


def _count(count: int, what: str) -> str:
    numeral = NUMERALS[count] if count < len(NUMERALS) else str(count)
    return f"{numeral} {what}{'' if count == 1 else 's'}"


def _listed(names: Iterable[str]) -> str:
    *most, last = list(names) or [""]
    return f"{', '.join(most)} and {last}" if most else last


def _words(name: str) -> str:
    """loading_stiffness, as one says it."""
    return name.replace("_", " ")


def _facts(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    where, fit = record["where"], record["fit"]
    if where["balance"]:
        yield "Where it acts", BALANCES[where["balance"]]
    if where["regimes"]:
        yield "When", "; ".join(where["regimes"])
    if where["recordings"]:
        yield "Recordings that differ", ", ".join(where["recordings"])
    held = fit["held_out"]
    if held["after"] is not None:
        sides = held["before"], held["after"], fit["noise_floor"]
        before, after, least = (number(each, 3, trim=False) for each in sides)
        unit = fit["unit"].partition(",")[0]
        yield "Residual, held out", f"{before} before, {after} after, noise floor {least} ({unit})"


# the map


def _map(cells: Sequence[Mapping[str, Any]], held: Sequence[str]) -> dict[str, Any] | None:
    """A table of recordings by channels and regimes, each cell with its ink."""
    if not cells:
        return None
    by_place = {(each["recording"], each["channel"], each["regime"]): each for each in cells}
    rows = dict.fromkeys(name for name, _channel, _regime in by_place)
    channels = dict.fromkeys(channel for _name, channel, _regime in by_place)
    columns = [
        (channel, regime)
        for channel in channels
        for regime in dict.fromkeys(each[2] for each in by_place if each[1] == channel)
    ]
    top = max(10.0, *(each["mean_square"] for each in cells))
    return {
        "channels": [(name, len(list(group))) for name, group in groupby(channel for channel, _regime in columns)],
        "regimes": [regime for _channel, regime in columns],
        "rows": [(name, [_cell(by_place.get((name, *column)), top) for column in columns]) for name in rows],
        "absent": ", ".join(name for name in held if name not in rows),
        "top": number(top, 3),
        "ramp": ", ".join(f"rgb{ink}" for ink in INKS),
    }


def _cell(cell: Mapping[str, Any] | None, top: float) -> dict[str, str]:
    if cell is None:
        return {"text": "", "ink": "none", "title": "no samples", "tone": "empty"}
    value = cell["mean_square"]
    share = math.log(max(value, 1.0)) / math.log(top)
    return {
        "text": f"{value:.{2 if value < 9.995 else 1 if value < 99.95 else 0}f}",
        "ink": _ink(share),
        "title": f"{number(value)} times the noise's mean square, {cell['samples']} samples",
        "tone": "dark" if share > DARK else "light",
    }


def _ink(share: float) -> str:
    place = share * (len(INKS) - 1)
    i = min(int(place), len(INKS) - 2)
    mixed = [round(low + (place - i) * (high - low)) for low, high in zip(INKS[i], INKS[i + 1], strict=True)]
    return f"rgb({mixed[0]}, {mixed[1]}, {mixed[2]})"


# the fit


def _fit(fit: Mapping[str, Any]) -> dict[str, Any] | None:
    """Figures before and after beside the floor, each with its place on a common scale."""
    floor = fit["noise_floor"]
    entries = []
    for key, label in (("fitted", "fitted"), ("left_out", "left out in turn"), ("held_out", "held out")):
        entry = fit.get(key)
        if entry is None or (entry["before"] is None and entry["after"] is None):
            continue
        if key == "held_out" and entry == fit.get("left_out"):
            continue  # where none is held out, the same figures stand in both places
        entries.append((label, entry))
        each = entry.get("each", {})
        if len(each) > 1:
            entries += [(name, {**figures, "recordings": []}) for name, figures in each.items()]
    if not entries:
        return None
    known = [each[key] for _label, each in entries for key in ("before", "after") if each[key] is not None]
    scale = _Scale.over([*known, floor])
    return {
        "unit": fit["unit"],
        "floor": number(floor, 3, trim=False),
        "floor_at": scale.place(floor),
        "ticks": scale.ticks(),
        "forced": any(each.get("force") for _label, each in entries),
        "rows": [_fit_row(label, each, floor, scale) for label, each in entries],
    }


def _fit_row(label: str, entry: Mapping[str, Any], floor: float, scale: _Scale) -> dict[str, Any]:
    before, after, force = entry["before"], entry["after"], entry.get("force")
    return {
        "label": label,
        "recordings": ", ".join(entry["recordings"]),
        "how": entry.get("how", ""),
        "before": number(before, 3, trim=False),
        "after": number(after, 3, trim=False),
        "share": f"{100 * before / force:.2g} % to {100 * after / force:.2g} %" if force else "",
        "over": "" if after is None else f"{after / floor:.2f}",
        "before_at": scale.place(before),
        "after_at": scale.place(after),
    }


@dataclass(frozen=True, slots=True)
class _Scale:
    """A logarithmic scale, as per cent of its length."""

    low: float
    high: float

    @classmethod
    def over(cls, values: Sequence[float]) -> _Scale:
        positive = [value for value in values if value > 0]
        low, high = min(positive), max(positive)
        # a factor of two at the least, or a scale of nothing but noise would make much of it
        return cls(low / 1.25, max(high, 2.0 * low) * 1.25)

    def place(self, value: float | None) -> float | None:
        if not value:
            return None
        return round(100.0 * math.log(value / self.low) / math.log(self.high / self.low), 2)

    def ticks(self) -> list[tuple[str, float | None]]:
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        steps = (1, 2, 5) if self.high / self.low < 200 else (1,)
        values = [step * 10.0**power for power in range(first, last + 1) for step in steps]
        return [(number(value, 2), self.place(value)) for value in values if self.low <= value <= self.high]


# mechanisms and constants


def _law(finding: Mapping[str, Any]) -> dict[str, Any] | None:
    """What page.js needs to draw the law of a finding."""
    law = finding.get("law")
    if not law:
        return None
    form = finding["form"] if finding["form"] == "measured" else f"as {finding['form']}"
    nearest = law.get("nearest")
    return {
        **{key: law[key] for key in ("x", "y", "low", "high")},
        "seen": law.get("partial_residuals"),
        "nearest": None if nearest is None else {"form": _plain(nearest["form"]), "y": nearest["y"]},
        "form": _plain(form),
        "argument": _plain(f"{law['argument']}, {_unit(law['argument_unit'])}"),
        "value": _plain(f"missing, {_unit(law['unit'])}"),
    }


def _finding(finding: Mapping[str, Any]) -> dict[str, Any]:
    mechanism, evidence = finding["mechanism"], finding["evidence"]
    share = evidence.get("share_of_left_out")
    more = {key: each for key, each in evidence.items() if key not in KNOWN and _finite(each)}
    return {
        "mechanism": mechanism,
        "explanation": finding["explanation"],
        "equation": evidence["equation"],
        "source": list(_linked(evidence["source"])),
        "strengths": [_strength(mechanism, *each) for each in finding["parameters"].items()],
        "recordings": _by_recording(finding),
        "law": "law" in finding,
        "beside": _beside(finding.get("law", {})),
        "equivalents": _listed(finding["equivalents"]),
        "gain": number(evidence["gain"]),
        "share": "" if share is None else f"{100 * share:.3g} %",
        "lag": [_strength(mechanism, *each) for each in evidence.get("beside_a_free_lag", {}).items()],
        "more": [(_words(key), number(each)) for key, each in more.items()],
    }


def _by_recording(finding: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names of recordings, and what parameters that differ between recordings are in each; nothing where none does."""
    units = {symbol: _unit(entry["unit"]) for symbol, entry in finding["parameters"].items()}
    every = finding.get("recordings", {}).items()
    return [
        (name, ", ".join(f"{symbol} {number(value)} {units[symbol]}" for symbol, value in own.items()))
        for name, own in every
    ]


def _beside(law: Mapping[str, Any]) -> str:
    """What a law is added to, and what nobody can tell of it."""
    beside = law.get("beside")
    if not beside:
        return ""
    constant = f"{_words(beside['constant'])} {number(beside['value'])} {_unit(beside['unit'])}".strip()
    said = f"It stands beside the {constant}: only both together are measured."
    if law["argument_unit"] == "m":
        said += " No channel tells where the displacement is zero, so that the curve may lie further along."
    return said


def _linked(source: str) -> Iterator[tuple[str, str]]:
    """Pieces of a source with where each leads, which is nowhere but for a DOI."""
    for piece in re.split(r"(doi:10\.\d{4,9}/[^\s,;]+)", source):
        if piece:
            yield piece, f"https://doi.org/{piece[4:]}" if piece.startswith("doi:10.") else ""


def _strength(mechanism: str, symbol: str, entry: Mapping[str, Any]) -> dict[str, str]:
    effect = REGISTRY.get(mechanism)
    meanings = {each.symbol: each.meaning for each in effect.parameters} if effect else {}
    meaning = "lag of the channel" if symbol == "lag" else meanings.get(symbol, "")
    return {"name": str(symbol), "meaning": meaning, **_quantity(entry)}


def _constants(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Those that are off first, then the rest of the law where the record has it."""
    off = record["parameters"]
    rest = {name: entry for name, entry in record["constants"].items() if name not in off}
    claimed = record["verdict"] != "unexplained"
    return [_constant(name, entry, _change(entry), entry["nominal"] is not None) for name, entry in off.items()] + [
        _constant(name, entry, _as_stated(entry) if claimed else "", False) for name, entry in rest.items()
    ]


def _as_stated(entry: Mapping[str, Any]) -> str:
    """Of a constant that is not said to be wrong: only a measured law beside it may take up what it is off."""
    nominal, std = entry.get("nominal"), entry.get("nominal_std")
    if nominal is not None and std is not None and abs(entry["value"] - nominal) > SEVERAL * std:
        return f"{_change(entry)} together with the law"
    return "within its tolerance"


def _constant(name: str, entry: Mapping[str, Any], change: str, off: bool) -> dict[str, Any]:
    return {"name": _words(name), "off": off, "change": change, **_quantity(entry, entry.get("nominal"))}


def _change(entry: Mapping[str, Any]) -> str:
    nominal = entry.get("nominal")
    if nominal is None:
        return "was to be found"
    return f"{100 * (entry['value'] - nominal) / abs(nominal):+.3g} %".replace("-", "\u2212") if nominal else ""


def _quantity(entry: Mapping[str, Any], believed: float | None = None) -> dict[str, str]:
    """Value, standard deviation and interval to the same digits, and the unit with the power of ten taken out."""
    value, spread = entry["value"], entry["std"]
    size = max(abs(value), spread)
    power = math.floor(math.log10(size)) if size > 0 else 0
    power = 0 if -3 <= power < 5 else 3 * (power // 3)
    factor = 10.0**-power
    finest = (
        math.floor(math.log10(spread * factor))
        if spread * factor > 0
        else math.floor(math.log10(size * factor or 1)) - 2
    )
    digits = min(max(1 - finest, 0), 9)
    low, high = entry.get("interval") or (value - SURE * spread, value + SURE * spread)

    def written(figure: float) -> str:
        return f"{figure * factor:.{digits}f}".replace("-", "\u2212")

    unit = _unit(entry["unit"])
    return {
        "value": written(value),
        "std": written(spread) if spread > 0 else "",
        "interval": f"{written(low)} to {written(high)}" if spread > 0 else "",
        "believed": "" if believed is None else written(believed),
        "unit": f"10{_raised(power)} {unit}".strip() if power else unit,
    }


def _raised(power: int) -> str:
    return str(power).translate(
        str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
    )


def _unit(unit: str) -> str:
    """N*s/m as it is printed; a plain number has none."""
    if unit == "1":
        return ""
    raised = re.sub(r"\^(-?\d+)", lambda found: _raised(int(found[1])), str(unit))
    return raised.replace("*", "\u00b7")


def _ahead(record: Mapping[str, Any]) -> list[str]:
    """What to measure next: as the record says, or else what would tell the equivalents apart."""
    if record["next"]:
        return record["next"]
    found = []
    for finding in record["findings"]:
        ways = finding["evidence"].get("separate")
        if ways:
            others = _listed(finding["equivalents"])
            found.append(f"To tell {finding['mechanism']} from {others}: {'; '.join(ways)}.")
    return found


def _finite(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def number(value: Any, digits: int = 4, trim: bool = True) -> str:
    """A number as it is read, without a trail of zeros unless they are to stay; a dash where there is none."""
    if not _finite(value):
        return "\u2013"
    size = abs(value)
    if size and not 1e-4 <= size < 1e6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{mantissa}\u00b710{_raised(int(power))}".replace("-", "\u2212")
    decimals = max(digits - 1 - (math.floor(math.log10(size)) if size else 0), 0)
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if trim and "." in text else text
    return text.replace("-", "\u2212")
