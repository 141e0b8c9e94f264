"""LabVIEW's measurement files, text with the ending .lvm.

The format is National Instruments' "Specification for the LabVIEW Measurement File (.lvm)". A file has a header of
tags, which names the separator, the decimal separator (since version 2) and which x-values were saved: a column of them
for all channels (One), one before each channel (Multi), or none (No), where the first column stays empty. Below it come
segments, one for each call of the block that wrote it: with a header of their own if Multi_Headings is Yes, a line of
names, and numbers up to an empty line.

A channel is named as in the line of names. Of a file with several segments it is the segments one after the other;
``2/name`` is the channel of the second segment alone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import Clock, increases_evenly
from drillenv.recordings.table import Table, as_floats, library, missing
from drillenv.recordings.text import lines_of, number_in
from drillenv.recordings.units import TIME_UNITS, known_unit

FIRST = "LabVIEW Measurement"
END_OF_HEADER = "***End_of_Header***"
START_SPECIAL, END_SPECIAL = "***Start_Special***", "***End_Special***"
X_NAME, COMMENT = "X_Value", "Comment"
SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
UNSTATED = 1.0
"""s, the increment that LabVIEW writes where none was given."""

COARSE = 0.004
"""Of an increment: one whose last digit is worth more is too roughly written to check a sample rate by."""

Floats = NDArray[np.float64]


class _Style(NamedTuple):
    """How a file is written."""

    separator: str
    decimal: str
    x_columns: str
    """One, Multi or No."""


@dataclass(slots=True)
class Segment:
    """What one call wrote."""

    tags: dict[str, list[str]]
    """Of its header: a cell for each column to the right of the tag."""
    names: list[str]
    """Of its columns, from the first; the x-values are X_Value."""
    first_line: int
    """Of its numbers, counted from 1."""
    rows: list[str] = field(default_factory=list)

    @property
    def channels(self) -> dict[str, int]:
        """Names of the channels and the columns that they stand in."""
        last = len(self.names) - (1 if self.names and self.names[-1] == COMMENT else 0)
        return {name: i for i, name in enumerate(self.names[:last]) if name not in (X_NAME, "")}

    def said(self, tag: str, column: int) -> str:
        """What its header says of a column; nothing where it does not."""
        cells = self.tags.get(tag, [])
        return cells[column - 1].strip() if 0 < column <= len(cells) else ""


def read_lvm(path: Path, columns: Sequence[str], most: int) -> Table:
    """Read channels of a .lvm file. Cells left empty become NaN, those after the last number of a channel are cut.

    Raises:
        InputError: it is no such file, has no such channels, or a line is broken.
    """
    with library(path, "LabVIEW measurement file"):
        style, segments, notes = segments_of(path)
        found: dict[str, Floats] = {}
        clock, units = None, {}
        for column in columns:
            used = _segments_of_column(path, segments, column)
            name = used[0][1]
            parts = [_numbers(path, segment, name, style, most) for segment, name in used]
            found[column] = as_floats(np.concatenate(parts))
            if clock is None:
                clock = _clock([segment for segment, _ in used], name, [part.size for part in parts], style, path)
            unit = used[0][0].said("Y_Unit_Label", used[0][0].channels[name])
            if unit:
                units[column] = unit
        if max(samples.size for samples in found.values()) > most:
            raise InputError(f"{shown(path.name)} has more samples than {most}: give at most {most}")
        if any(len(_segments_of_column(path, segments, column)) > 1 for column in columns):
            notes = (*notes, f"its {len(segments)} segments were put one after the other")
        if style.decimal == ",":
            notes = (*notes, "the numbers were read with decimal commas")
    return Table(found, clock, notes, units)


def segments_of(path: Path) -> tuple[_Style, list[Segment], tuple[str, ...]]:
    """How a file is written, its segments with their rows still text, and what to note of its encoding.

    Raises:
        InputError: it is no LabVIEW measurement file, or has no line of names.
    """
    lines, notes = lines_of(path)
    if not lines[0].startswith(FIRST):
        raise InputError(
            f"{shown(path.name)} does not begin with {FIRST}: give a file that LabVIEW wrote with a header, or a .csv"
        )
    tags, at = _file_header(path, lines)
    style = _style(lines, tags)
    segments: list[Segment] = []
    while at < len(lines):
        segment, at = _segment(lines, at, style, segments[-1] if segments else None)
        if segment is not None:
            segments.append(segment)
    segments = [segment for segment in segments if segment.rows]
    if not segments:
        raise InputError(f"{shown(path.name)} has no numbers below a line that names them: write it with headers")
    return style, segments, notes


# --------------------------------------------------------------------------------------------------------------------
# the text


def _file_header(path: Path, lines: Sequence[str]) -> tuple[dict[str, str], int]:
    """The tags of the file, and the line after its header."""
    tags: dict[str, str] = {}
    for i, line in enumerate(lines):
        if line.startswith(END_OF_HEADER):
            return tags, i + 1
        tag, _, value = _tagged(line)
        tags.setdefault(tag, value)
    raise InputError(f"{shown(path.name)} is cut off in its header: copy or export it again, whole")


def _tagged(line: str) -> tuple[str, str, str]:
    """(tag, separator, what follows) of a line of a header, whose separator need not be known yet."""
    match = re.match(r"([A-Za-z_]+(?:/N)?)([\t,;])(.*)$", line)
    if match is None:
        return line.strip(), "", ""
    tag, separator, value = match.groups()
    return tag, separator, value.strip() if value.strip() in SEPARATORS.values() else value.rstrip("\t,; ")


def _style(lines: Sequence[str], tags: Mapping[str, str]) -> _Style:
    stated = tags.get("Separator", "").strip()
    first = lines[0][len(FIRST) : len(FIRST) + 1] or _tagged(lines[1])[1]
    separator = SEPARATORS.get(stated.lower(), stated if stated in SEPARATORS.values() else first or "\t")
    # The tag's value is itself a comma where that is what it says, so it is looked for in the line.
    decimal = next((line[18:19] for line in lines[:50] if line.startswith("Decimal_Separator")), "")
    if decimal not in (".", ","):
        # Before version 2 the tag did not exist and numbers were written as the computer had it.
        written = next((line for line in lines if line.startswith("Delta_X")), "")
        decimal = "," if separator != "," and "," in written else "."
    return _Style(separator, decimal if separator != decimal else ".", tags.get("X_Columns", "One").strip().title())


def _segment(lines: Sequence[str], at: int, style: _Style, before: Segment | None) -> tuple[Segment | None, int]:
    """The segment that begins at a line, None where nothing does, and the line after it."""
    while at < len(lines) and _is_blank(lines[at], style):
        at += 1
    if at == len(lines):
        return None, at
    tags, at = _segment_header(lines, at, style)
    cells = _cells(lines[at], style) if at < len(lines) else []
    if X_NAME in cells:
        names, at = cells, at + 1
    elif before is not None:
        names = before.names  # one header for all
        tags = tags or before.tags
    else:
        return None, at + 1
    segment = Segment(tags, names, at + 1)
    while at < len(lines) and not _is_blank(lines[at], style) and not re.match(r"[A-Za-z*]", lines[at]):
        segment.rows.append(lines[at])
        at += 1
    return segment, at if segment.rows else at + 1


def _segment_header(lines: Sequence[str], at: int, style: _Style) -> tuple[dict[str, list[str]], int]:
    """The tags that begin at a line, and the line after their end; no tags where none begin."""
    tags: dict[str, list[str]] = {}
    begin, special = at, False
    while at < len(lines):
        line = lines[at]
        if line.startswith(START_SPECIAL):
            special = True
        elif line.startswith(END_SPECIAL):
            special = False
        elif line.startswith(END_OF_HEADER) and not special:
            return tags, _after_special(lines, at + 1)
        elif not special:
            cells = line.split(style.separator)
            if X_NAME in (cell.strip() for cell in cells) or not re.match(r"[A-Z]", line):
                break
            tags.setdefault(cells[0].strip(), cells[1:])
        at += 1
    return {}, begin


def _after_special(lines: Sequence[str], at: int) -> int:
    """The line after a special block, if one begins here."""
    if at < len(lines) and lines[at].startswith(START_SPECIAL):
        while at < len(lines) and not lines[at].startswith(END_SPECIAL):
            at += 1
        return at + 1
    return at


def _cells(line: str, style: _Style) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.split(style.separator)]


def _is_blank(line: str, style: _Style) -> bool:
    return not line.replace(style.separator, "").strip()


# --------------------------------------------------------------------------------------------------------------------
# the numbers


def _segments_of_column(path: Path, segments: Sequence[Segment], column: str) -> list[tuple[Segment, str]]:
    """The segments that a column is read from, and its name there."""
    used = [(segment, column) for segment in segments if column in segment.channels]
    match = re.fullmatch(r"(\d+)/(.+)", column)
    if not used and match and 1 <= int(match[1]) <= len(segments) and match[2] in segments[int(match[1]) - 1].channels:
        used = [(segments[int(match[1]) - 1], match[2])]
    if not used:
        missing(path, column, dict.fromkeys(name for each in segments for name in each.channels), "channel")
    for segment, name in used:
        if segment.names.count(name) > 1:
            raise InputError(f"{shown(path.name)} has the channel {shown(name)} twice: give each its own name")
    return used


def _numbers(path: Path, segment: Segment, name: str, style: _Style, most: int) -> Floats:
    """(samples,) of one column of one segment."""
    if len(segment.rows) > most:
        raise InputError(f"{shown(path.name)} has {len(segment.rows)} samples: give at most {most}")
    return _column(path, segment, segment.channels[name], name, style)


def _column(path: Path, segment: Segment, place: int, name: str, style: _Style) -> Floats:
    rows = segment.rows
    plain = rows if style.decimal == "." else [row.replace(",", ".") for row in rows]
    try:
        return np.loadtxt(plain, delimiter=style.separator, usecols=[place], comments=None, ndmin=1)
    except ValueError:
        pass
    found = np.full(len(rows), np.nan)
    last = 0
    for i, row in enumerate(plain):
        cells = row.split(style.separator)
        text = cells[place].strip() if place < len(cells) else ""
        value = number_in(text)
        if value is None:
            raise InputError(
                f"line {segment.first_line + i} of {shown(path.name)}, channel {shown(name)}, holds {shown(text)}: "
                "give a number or nothing"
            )
        found[i] = value
        last = i + 1 if text else last
    return found[:last]


# --------------------------------------------------------------------------------------------------------------------
# the time


def _clock(used: Sequence[Segment], name: str, sizes: Sequence[int], style: _Style, path: Path) -> Clock | None:
    """The time of a channel over its segments: by x-values or the increment, each segment from its own start."""
    parts, begun = [], [_begun(segment, segment.channels[name], style) for segment in used]
    for segment, size, start in zip(used, sizes, begun, strict=True):
        part = _times(segment, segment.channels[name], size, style, path)
        if part is None:
            return None
        if parts and part[0] <= parts[-1][-1]:  # its x-values begin anew
            if start is None or begun[0] is None:
                return None
            part = part - part[0] + (start - begun[0]) + parts[0][0]
        parts.append(part)
    return Clock(np.concatenate(parts), X_NAME)


def _times(segment: Segment, place: int, size: int, style: _Style, path: Path) -> Floats | None:
    """(size,) s of one channel of one segment; None where it does not say."""
    dimension, label = segment.said("X_Dimension", place), known_unit(segment.said("X_Unit_Label", place))
    unit = TIME_UNITS.get(label or "s")
    if dimension not in ("", "Time") or unit is None:
        return None
    x_place = {"One": 0, "Multi": place - 1}.get(style.x_columns)
    if x_place is not None and segment.names[x_place] == X_NAME:
        x = _column(path, segment, x_place, X_NAME, style)
        if x.size >= size and increases_evenly(x[:size]):
            return x[:size] * unit
    written = segment.said("Delta_X", place).replace(style.decimal, ".")
    step = number_in(written)
    start = number_in(segment.said("X0", place).replace(style.decimal, ".")) or 0.0
    if step is None or not 0.0 < step < 1e6 or step == UNSTATED or _last_digit(written) > COARSE * step:
        return None
    return as_floats((start + step * np.arange(size)) * unit)


def _last_digit(written: str) -> float:
    """What one more in the last digit of a number is worth."""
    mantissa, _, exponent = written.lower().partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def _begun(segment: Segment, place: int, style: _Style) -> float | None:
    """s of the clock on the wall at the first sample of a channel; None where the segment does not say."""
    date, time = segment.said("Date", place), segment.said("Time", place).replace(style.decimal, ".")
    whole, _, fraction = time.partition(".")
    try:
        second = datetime.strptime(f"{date} {whole}", "%Y/%m/%d %H:%M:%S").timestamp()
        return second + float(f"0.{fraction or 0}")
    except ValueError:
        return None
