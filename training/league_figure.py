"""How controllers lose when rocks, constants or physics are not those they were made for, as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.checks import InputError
from drillenv.files import whole

SHOWN = {
    "rules": "#b8860b",
    "scheduled": "#0072b2",
    "seeking": "#009e73",
    "mpc": "#7a5195",
    "ppo-vine-hidden": "#e6ab02",
    "ppo-vine-randomised": "#d55e00",
    "ppo-vine": "#f4a582",
    "ppo": "#cc79a7",
    "ppo-lagrangian": "#332288",
    "recurrent-ppo": "#8c2d04",
    "sac": "#56b4e9",
    "td3": "#999999",
}
"""The rows in the figure and their colours; the shipped policy stands in where there are no rows of its algorithm."""
STAND_IN, STAND_IN_FOR = "shipped", "ppo-vine-randomised"
LEFT_OUT = ("random", "fixed", "steady-oracle", "oracle", STAND_IN)
"""Rows that the figure has no room for; those that are not of this package have one of OTHERS each."""
OTHERS = ("#1b7837", "#c51b7d", "#01665e", "#bf812d", "#4d4d4d")
LABELS = {
    "test": "test",
    "constants": "constants off\nby a lab's error",
    "constants-3": "constants off\nby three of them",
    "beyond": "rocks beyond\nTable 2.2",
    "hidden": "hidden\nphysics",
}
PANELS = (
    ("share", "share of the oracle's score\n(cut off at 1.4)", 1.0),
    ("single_share", "time in strong P-1-I-1, %", 100.0),
    ("worst_excess", "force above the rating\nin the worst 5 % of the intervals, N", 1.0),
)
MOST = 1.4
"""Highest share shown: where the oracle scores little, in an episode of hidden physics, shares of it say little."""
WIDTH = 0.62
"""Of the group of points of a condition."""


def draw(records: Mapping[str, Mapping[str, Any]], file: str | Path) -> None:
    """Draw the records by their conditions.

    Raises:
        InputError: no record of a known condition, or the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    conditions = [name for name in LABELS if name in records]
    if not conditions:
        raise InputError(f"no record is of one of {', '.join(LABELS)}: make them with drillenv league --json")
    rows = _colours(records)
    figure = Figure(figsize=(9.5, 8.2), layout="constrained")
    FigureCanvasAgg(figure)
    for panel, (key, title, scale) in zip(figure.subplots(len(PANELS), 1, sharex=True), PANELS, strict=True):
        _panel(panel, records, conditions, rows, key, scale)
        panel.set_ylabel(title)
        panel.grid(axis="y", color="#e3e3e3", lw=0.7)
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
        if key == "share":
            panel.set_ylim(top=MOST)
            panel.axhline(1.0, color="#404040", lw=0.8, ls="--")
            panel.legend(ncols=min(len(rows), 5), frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        panel.set_xticks(np.arange(len(conditions)), [LABELS[name] for name in conditions])
        panel.tick_params(axis="x", length=0)
    with whole(file) as part:
        figure.savefig(part, dpi=130)


def _panel(panel: Any, records: Mapping[str, Any], conditions: list[str], rows: dict[str, str], key: str, scale: float):
    """One measure of all rows over the conditions."""
    places = np.linspace(-0.5 * WIDTH, 0.5 * WIDTH, len(rows))
    for place, (name, colour) in zip(places, rows.items(), strict=True):
        x, values = [], []
        for i, each in enumerate(conditions):
            row = records[each]["summary"]["rows"].get(name)
            if row is not None:
                x.append(i + place)
                values.append(scale * np.array(row[key], dtype=float))
        value, low, high = np.array(values).T
        panel.errorbar(x, value, [value - low, high - value], fmt="o", ms=4.5, lw=1.4, color=colour, label=name)
    for i in range(1, len(conditions)):
        panel.axvline(i - 0.5, color="#e3e3e3", lw=0.7)


def _colours(records: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """The rows to show and their colours."""
    rows = {name: colour for name, colour in SHOWN.items() if _in_any(records, name)}
    if STAND_IN_FOR not in rows and _in_any(records, STAND_IN):
        rows[STAND_IN] = SHOWN[STAND_IN_FOR]
    others = dict.fromkeys(name for record in records.values() for name in record["summary"]["rows"])
    left = [name for name in others if name not in SHOWN and name not in LEFT_OUT]
    return rows | {name: OTHERS[i % len(OTHERS)] for i, name in enumerate(left)}


def _in_any(records: Mapping[str, Mapping[str, Any]], name: str) -> bool:
    return any(name in record["summary"]["rows"] for record in records.values())
