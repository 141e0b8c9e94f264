"""Comma-separated text, as written by hand, by numpy, by a spreadsheet or by LabVIEW.

NumPy's C reader does the numbers: as exact as pandas', and no second library to import for it.

The header is the first line that holds every column asked for, so anything may stand above it. Columns are parted by
commas, semicolons or tabs, whichever parts the header. A comma is a decimal comma only where it does not part columns.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.table import CLOCK, Table, as_floats, library, missing

HEADER_WITHIN = 200
"""Lines."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NO_NUMBER = {"", "nan", "na", "n/a", "#n/a", "null", "none"}
_INFINITE = {"inf", "+inf", "-inf", "infinity", "+infinity", "-infinity"}


class _Header(NamedTuple):
    line: int
    """Counted from 0."""
    delimiter: str
    names: list[str]


def read_csv(path: Path, columns: Sequence[str], most: int, below: int = 0) -> Table:
    """Read columns of a .csv. Empty cells become NaN; any other text where a number belongs is refused.

    Args:
        path: The file.
        columns: Names of the columns, as the header has them.
        most: Samples allowed.
        below: Lines to pass over below the header, such as a line of units.

    Raises:
        InputError: it is no such text, has no such columns, or a line is broken.
    """
    with library(path, "text of comma-separated numbers"):
        lines = text_lines(path)
        header = _header(path, lines, columns)
        header = header._replace(line=header.line + below)
        rows = _rows(path, lines, header)
        if len(rows) > most:
            raise InputError(f"{shown(path.name)} has {len(rows)} samples: give at most {most}")
        wanted = list(columns)
        if CLOCK not in wanted and header.names.count(CLOCK) == 1:
            wanted.append(CLOCK)
        places = [header.names.index(name) for name in wanted]
        notes: tuple[str, ...] = ()
        plain = rows
        if header.delimiter != "," and any("," in row for row in rows):
            if not any("." in row for row in rows):
                plain = [row.replace(",", ".") for row in rows]
                notes = ("the numbers were read with decimal commas",)
            else:
                plain = None
        values = _parsed(plain, header.delimiter, places)
        if values is None:
            values, notes = _parsed_cell_by_cell(path, lines, header, wanted, places)
        if lines[-1].strip():
            notes = (*notes, "its last line has no end, so it may be cut off there")
        found = {name: as_floats(values[:, i]) for i, name in enumerate(wanted)}
    clock = found.pop(CLOCK) if CLOCK not in columns and CLOCK in found else None
    return Table(found, clock, notes)


def text_lines(path: Path) -> list[str]:
    """The lines of a text in UTF-8 or UTF-16, whatever ends them.

    Raises:
        InputError: it is no text.
    """
    data = path.read_bytes()
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(f"{shown(path.name)} is no text (byte {error.start}): save it as UTF-8") from None
    if "\0" in text:
        raise InputError(
            f"{shown(path.name)} is no text (it holds a zero byte): export it again as comma-separated text"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _header(path: Path, lines: Sequence[str], columns: Sequence[str]) -> _Header:
    """The first line that names all columns, under the delimiter that parts it into most cells."""
    best: _Header | None = None
    for i, line in enumerate(lines[:HEADER_WITHIN]):
        bare = line.lstrip("#% \t") if line.lstrip().startswith(("#", "%")) else line
        for delimiter in ",;\t":
            names = cells_of(bare, delimiter)
            if all(column in names for column in columns) and (best is None or len(names) > len(best.names)):
                best = _Header(i, delimiter, names)
        if best is not None:
            break
    if best is None:
        _no_header(path, lines, columns)
    for column in columns:
        if best.names.count(column) > 1:
            raise InputError(f"{shown(path.name)} has the column {shown(column)} twice: give each its own name")
    return best


def _no_header(path: Path, lines: Sequence[str], columns: Sequence[str]) -> NoReturn:
    """Say which column is missing from the line that names most of them, or else from the first."""
    parted = [
        cells_of(line, delimiter) for line in lines[:HEADER_WITHIN] if line.strip() for delimiter in (",", ";", "\t")
    ]
    if not parted:
        raise InputError(f"{shown(path.name)} is empty: give a header line and numbers below it")
    closest = max(parted, key=lambda names: (sum(column in names for column in columns), len(names)))
    lacking = next(column for column in columns if column not in closest)
    if any(_NUMBER.fullmatch(name) for name in closest):
        raise InputError(
            f"{shown(path.name)} has no header line with {', '.join(map(shown, columns))}: name its columns in line 1"
        )
    missing(path, lacking, closest, "column")


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line of a .csv, without what quotes them."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return []


def _rows(path: Path, lines: Sequence[str], header: _Header) -> list[str]:
    """The lines of numbers, if each has as many cells as the header."""
    width = len(header.names) - 1
    rows = [line for line in lines[header.line + 1 :] if line.strip()]
    counts = {row.count(header.delimiter) for row in rows}
    if counts == {width + 1} and all(row.rstrip(" ").endswith(header.delimiter) for row in rows):
        return [row.rstrip(" ")[:-1] for row in rows]
    if counts - {width}:
        for i, line in enumerate(lines[header.line + 1 :], header.line + 2):
            if line.strip() and line.count(header.delimiter) != width:
                raise InputError(
                    f"line {i} of {shown(path.name)} has {line.count(header.delimiter) + 1} cells where its header has "
                    f"{width + 1} ({shown(line.strip())}): export it whole, a number a cell"
                )
    return rows


def _parsed(rows: Sequence[str] | None, delimiter: str, places: Sequence[int]) -> NDArray[np.float64] | None:
    """(rows, columns), or None where a cell is no plain number."""
    if rows is None:
        return None
    if not rows:
        return np.empty((0, len(places)))
    try:
        return np.loadtxt(rows, delimiter=delimiter, usecols=places, comments=None, ndmin=2)
    except ValueError:
        return None


def _parsed_cell_by_cell(
    path: Path, lines: Sequence[str], header: _Header, wanted: Sequence[str], places: Sequence[int]
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """(rows, columns) of a file with empty cells, quoted numbers or text beside them, and what to note about it."""
    table, points, commas = [], 0, 0
    for i, line in enumerate(lines[header.line + 1 :], header.line + 2):
        if not line.strip():
            continue
        cells = line.split(header.delimiter)
        row = []
        for name, place in zip(wanted, places, strict=True):
            text = cells[place].strip().strip('"').strip()
            if header.delimiter != ",":
                points, commas = points + ("." in text), commas + ("," in text)
                text = text.replace(",", ".", 1) if "." not in text else text
            row.append(_number(path, i, name, text))
        table.append(row)
    if points and commas:
        raise InputError(f"{shown(path.name)} has numbers with . and numbers with ,: write all with one of them")
    notes = ("the numbers were read with decimal commas",) if commas else ()
    return np.array(table, dtype=float).reshape(len(table), len(wanted)), notes


def _number(path: Path, line: int, column: str, text: str) -> float:
    lowered = text.lower()
    if _NUMBER.fullmatch(text) or lowered in _INFINITE:
        return float(text)
    if lowered in _NO_NUMBER:
        return float("nan")
    raise InputError(
        f"line {line} of {shown(path.name)}, column {shown(column)}, holds {shown(text)}: give a number or nothing"
    )
