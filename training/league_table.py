"""The league's record as Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drillenv.checks import InputError
from drillenv.files import whole
from drillenv.training.league import SEEDS


def league_table(record: Mapping[str, Any]) -> str:
    """The rows, best first, as a Markdown table; records of before, which say no mean cost, have no column of it."""
    rows = record["summary"]["rows"]
    costs = {name: row.get("cost", [None])[0] for name, row in rows.items()}
    told = any(cost is not None for cost in costs.values())
    lines = [
        "| controller | share of the oracle | score, mm/s | penetration, mm/s | strong P-1-I-1 | violations "
        f"{'| cost, N ' if told else ''}| worst 5 %, N | J/mm | recovery, s |",
        "|" + "---|" * (9 + told),
    ]
    for name in best_first(record):
        row = rows[name]
        value, low, high = row["share"]
        seeds = f" ({row['runs']} seeds)" if row["runs"] > 1 else ""
        oracle = " (sees the rock)" if record["runs"][name][0].get("sees_truth") else ""
        cells = [
            f"{name}{seeds}{oracle}",
            f"{value:.3f} ({low:.3f} to {high:.3f})",
            _number(row["score"], 3),
            _number(row["penetration_rate"], 2),
            _percent(row["single_share"]),
            _percent(row["violations"]),
            *([_number([costs[name]], 1)] if told else []),
            _number(row["worst_excess"], 0),
            _number(row["energy"], 1),
            _number(row["recovery"], 2),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def best_first(record: Mapping[str, Any]) -> list[str]:
    """The rows, by what they are compared by; records of before, which do not say it, by their shares."""
    rows, compared = record["summary"]["rows"], record["summary"].get("compared", "share")
    return sorted(rows, key=lambda each: -rows[each][compared][0])


def beats_table(record: Mapping[str, Any]) -> str:
    """The probabilities that the row's controller scores more than the column's, as a Markdown table."""
    names, beats = best_first(record), record["summary"]["beats"]
    lines = ["| | " + " | ".join(names) + " |", "|" + "---|" * (len(names) + 1)]
    for name in names:
        cells = ["" if other == name else f"{beats[name][other]:.2f}" for other in names]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def statement_text(record: Mapping[str, Any]) -> str:
    """The statement about learning in words, a line for each row of SEEDS seeds or more."""
    lines, of_score = [], record["summary"].get("compared") == "score"
    what = "mean scores in mm/s" if of_score else "shares"
    for name, found in record["summary"]["statement"].items():
        if found["seeds"] < SEEDS:
            continue
        if of_score:  # there the oracle is no yardstick
            reached = "scores {:.3f} mm/s ({:.3f} to {:.3f})".format(*record["summary"]["rows"][name]["score"])
        else:
            surely = "reaches" if found["reaches_enough"] else "does not surely reach"
            reached = "{} 95 % of the oracle: {:.3f} ({:.3f} to {:.3f})".format(surely, *found["share"])
        unsure = [other for other in found["differences"] if other not in (*found["beats"], *found["loses_to"])]
        said = [
            f"{words} {', '.join(f'`{other}` ({_difference(found, other)})' for other in others)}"
            for words, others in (
                ("loses to", found["loses_to"]),
                ("is not surely different from", unsure),
                ("beats", found["beats"]),
            )
            if others
        ]
        lines.append(
            f"- `{name}`, {found['seeds']} training seeds, {reached}. Of those that neither learn nor see the rock it "
            f"{'; it '.join(said)}: differences of the {what}, with 95 % intervals."
        )
    return "\n".join(lines)


def _difference(found: Mapping[str, Any], other: str) -> str:
    value, low, high = found["differences"][other]
    return f"{value:+.3f}, {low:+.3f} to {high:+.3f}"


def page_part(record: Mapping[str, Any]) -> str:
    """Everything that a page says of a record."""
    parts = [
        f"{record['episodes']} episodes of {record['steps']} steps.",
        league_table(record),
        statement_text(record),
        "<details><summary>Probability that the row scores more than the column in an episode</summary>",
        beats_table(record),
        "</details>",
    ]
    return "\n\n".join(part for part in parts if part)


def write_table(file: str | Path, record: Mapping[str, Any]) -> None:
    """Write the tables to a file of their own, or into their places in a page, see :func:`put`.

    Between ``<!-- league NAME -->`` and its end is everything that a page says of the condition, between
    ``<!-- league-rows NAME -->`` and its end the rows only.

    Raises:
        InputError: the file cannot be read or written, or is a page without a place for this condition.
    """
    name = record["condition"]
    put(file, {f"league {name}": page_part(record), f"league-rows {name}": league_table(record)})


def put(file: str | Path, parts: Mapping[str, str]) -> None:
    """Write the first of the parts to a file of its own, or each into its place in a page, where it has one.

    The place of a part lies between the lines ``<!-- NAME -->`` and ``<!-- end NAME -->``.

    Raises:
        InputError: the file cannot be read or written, or is a page without a place for any.
    """
    target, first = Path(file), next(iter(parts))
    text = parts[first] + "\n"
    if target.is_file() and target.stat().st_size:
        text, found = target.read_text(encoding="utf-8"), False
        for name, content in parts.items():
            begin, end = f"<!-- {name} -->\n", f"<!-- end {name} -->"
            if begin in text and end in text.split(begin, 1)[1]:
                before, rest = text.split(begin, 1)
                text = before + begin + content + "\n" + end + rest.split(end, 1)[1]
                found = True
        if not found:
            raise InputError(f"{target} has no line <!-- {first} --> to put the table after: give another file")
    with whole(target) as part:
        part.write_text(text, encoding="utf-8")


def _number(found: list[float | None], digits: int) -> str:
    return "" if found[0] is None else f"{found[0]:.{digits}f}"


def _percent(found: list[float | None]) -> str:
    return "" if found[0] is None else f"{found[0]:.1%}".replace("%", " %")
