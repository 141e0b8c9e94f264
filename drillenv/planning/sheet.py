"""The sheet of a plan: what to record, and what that is expected to show."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drillenv.planning.plan import Plan, PlannedRecording, Resolvable

STARTS = {
    "running": "running: let the rig run for a second or more, then record",
    "fresh": "fresh: from rest on rock never hit, the excitation switched on at the first sample",
}
SENSORS = (
    "Record the force on the rock, the acceleration of the indenter and the excitation voltage, all sampled together.",
    "Position and velocity do not pay: a diagnosis of the drill reads neither. Pressure does where no gauge is read: "
    "campaign init labels recordings by it.",
)
CHANNELS = "excitation force acceleration"


def markdown(plan: Plan) -> str:
    """The sheet, tables in Markdown."""
    recordings = [
        ("", "frequency Hz", "amplitude V", "pressure bar", "starts", "seconds", "samples a second", "what it is for"),
        *(row(each) for each in plan.recordings),
    ]
    mechanisms = [
        ("mechanism", "found alone from", "told from all others from", "that is", "told last from"),
        *(strengths(each) for each in plan.mechanisms),
    ]
    how = [STARTS[each] for each in dict.fromkeys(one.starts for one in plan.recordings)]
    parts = [
        f"# Recordings to make of {plan.rock}",
        table(recordings),
        *(f"- {each}" for each in (*how, *SENSORS)),
        "",
        "## Smallest strengths expected to be found",
        table(mechanisms),
        "Shares are of the middle of what is typical. " + chosen_among(plan),
        *plan.remarks,
    ]
    return "\n".join(parts) + "\n"


def chosen_among(plan: Plan) -> str:
    """Among how many the recordings were chosen."""
    aside = (
        f"; {plan.irregular} were left aside, whose motion is irregular or stays on the rock" if plan.irregular else ""
    )
    return f"The recordings were chosen among {plan.candidates}{aside}."


def row(each: PlannedRecording) -> tuple[str, ...]:
    """A recording as cells."""
    setting = each.setting
    return (
        each.name,
        f"{setting.frequency:g}",
        f"{setting.amplitude:g}",
        f"{setting.pressure:g}",
        each.starts,
        f"{each.seconds:g}",
        f"{each.sample_rate:g}",
        each.purpose,
    )


def strengths(each: Resolvable) -> tuple[str, ...]:
    """A mechanism as cells."""
    said = ", ".join(
        f"{symbol} = {value:.3g} {each.units[symbol]}".removesuffix(" 1") for symbol, value in each.parameters.items()
    )
    said = said or ("any" if math.isfinite(each.told) else "not found")
    return each.mechanism, percent(each.share), percent(each.told), said, each.rival


def percent(share: float) -> str:
    """A share of a typical strength."""
    if not math.isfinite(share):
        return "not found"
    return f"{100.0 * share:.0f} %" if share >= 1.0 else f"{100.0 * share:.2g} %"


def table(rows: list[tuple[str, ...]]) -> str:
    """A table in Markdown, columns aligned for a terminal."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, cells, widths)) + " |" for cells in rows]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines) + "\n"


def comma_separated(plan: Plan) -> str:
    """The recordings, one a line, with a line of names."""
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\n")
    writer.writerow(("name", "frequency_Hz", "amplitude_V", "pressure_bar", "starts", "seconds", "sample_rate_Hz",
                     "channels", "purpose"))  # fmt: skip
    for each in plan.recordings:
        cells = row(each)
        writer.writerow((*cells[:-1], CHANNELS, cells[-1]))
    return written.getvalue()
