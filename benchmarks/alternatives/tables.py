"""What the answers of all methods come to, as Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.alternatives.comparing import CONSTANTS, DIAGNOSIS, METHODS, NAMING, PROCESS, SPARSE
from drillenv.blind.marking import HELD_OUT

Row = Mapping[str, Any]
"""Of a campaign, as :func:`~benchmarks.alternatives.comparing.compared` makes it."""
NOTHING_MISSING = ("null", "wrong-constant")
"""Groups in which a finding is a false alarm."""
SHOWN = (DIAGNOSIS, CONSTANTS, SPARSE, PROCESS)
"""Methods whose errors are given by group."""


def mechanisms_named(rows: Iterable[Row], method: str) -> tuple[int, int]:
    """Mechanisms that a method named, of those concealed; what is outside of the library is not counted."""
    fates = [
        fate for row in rows if row["group"] != "outside" for fate in row["answers"][method]["mechanisms"].values()
    ]
    return sum(fate in ("named", "in a class") for fate in fates), len(fates)


def campaigns_named(rows: Iterable[Row], method: str) -> tuple[int, int]:
    """Campaigns that are right by naming."""
    own = [row["answers"][method]["named"] for row in rows]
    return sum(own), len(own)


def false_alarms(rows: Iterable[Row], method: str) -> tuple[int, int]:
    """Campaigns with nothing missing in which something was found."""
    own = [bool(row["answers"][method]["findings"]) for row in rows if row["group"] in NOTHING_MISSING]
    return sum(own), len(own)


def false_findings(rows: Iterable[Row], method: str) -> tuple[int, int]:
    """Campaigns with a finding of what is not there."""
    own = [bool(row["answers"][method]["false"]) for row in rows]
    return sum(own), len(own)


def errors(rows: Iterable[Row], method: str) -> list[float]:
    """Errors of a method on recordings held out, of campaigns in which every method has one."""
    return [
        row["answers"][method]["error"]
        for row in rows
        if all(each["error"] is not None for each in row["answers"].values())
    ]


def within_noise(rows: Iterable[Row], method: str, missing: bool = False) -> tuple[int, int]:
    """Campaigns whose recordings held out are explained to within the noise; ``missing`` counts those with physics
    missing alone."""
    own = errors([row for row in rows if not missing or row["group"] not in NOTHING_MISSING], method)
    return sum(each <= HELD_OUT for each in own), len(own)


def table(record: Mapping[str, Any]) -> str:
    """The methods beside each other, and the groups of the trial, as two Markdown tables."""
    rows = record["rows"]
    return "\n".join([*by_method(rows), "", *by_group(rows)]) + "\n"


def by_method(rows: Sequence[Row]) -> list[str]:
    """Lines of a table with a row for each method."""
    lines = [
        "| method | mechanisms named | campaigns right by naming | false alarms | campaigns with a false finding "
        f"| error held out, median | campaigns within {HELD_OUT:g} times the noise | of these with physics missing "
        "| seconds, median |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for method in METHODS:
        counts = (mechanisms_named, campaigns_named, false_alarms, false_findings)
        cells = [_of(*count(rows, method)) if method in NAMING else "" for count in counts]
        cells += [_median(errors(rows, method)), _of(*within_noise(rows, method))]
        cells += [str(within_noise(rows, method, missing=True)[0])]
        cells += [f"{np.median([row['answers'][method]['seconds'] for row in rows]):.0f}"]
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return lines


def by_group(rows: Sequence[Row]) -> list[str]:
    """Lines of a table with a row for each group: counts of the methods that name, and all errors."""
    lines = [
        f"| group | campaigns | mechanisms named: {', '.join(NAMING)} | right by naming: {', '.join(NAMING)} "
        f"| a false finding: {', '.join(NAMING)} | error held out, median: {', '.join(SHOWN)} |",
        "|---|---|---|---|---|---|",
    ]
    for group in dict.fromkeys(row["group"] for row in rows):
        own = [row for row in rows if row["group"] == group]
        named = [mechanisms_named(own, each) for each in NAMING]
        cells = [
            ", ".join(str(hits) for hits, _ in named) + f" of {named[0][1]}" if named[0][1] else "",
            ", ".join(str(campaigns_named(own, each)[0]) for each in NAMING),
            ", ".join(str(false_findings(own, each)[0]) for each in NAMING),
            ", ".join(_median(errors(own, each)) for each in SHOWN),
        ]
        lines.append(f"| {group} | {len(own)} | {' | '.join(cells)} |")
    return lines


def _of(hits: int, total: int) -> str:
    return f"{hits} of {total}"


def _median(values: Sequence[float]) -> str:
    return f"{np.median(values):.2f}" if len(values) else "none"
