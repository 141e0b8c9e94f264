"""Comma-separated text, as written by hand, by numpy, by a spreadsheet or by LabVIEW.

NumPy's C reader does the numbers: as exact as pandas', and no second library to import for it.

The header is the first line that holds every column asked for, so anything may stand above it. Columns are parted by
commas, semicolons or tabs, whichever parts the header. A comma is a decimal comma only where it does not part columns.
A line of units may stand below the header.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import CLOCK, clock_from, time_names
from drillenv.recordings.table import Table, as_floats, library, missing
from drillenv.recordings.text import NUMBER, lines_of, number_in
from drillenv.recordings.units import known_unit

HEADER_WITHIN = 200
"""Lines."""


class _Header(NamedTuple):
    line: int
    """Counted from 0."""
    delimiter: str
    names: list[str]
    units: dict[str, str]
    """By column, from the line below the names; empty where there is none."""
    below: int
    """The first line that may hold numbers."""


def read_csv(path: Path, columns: Sequence[str], most: int) -> Table:
    """Read columns of a .csv. Empty cells become NaN; any other text where a number belongs is refused.

    Args:
        path: The file.
        columns: Names of the columns, as the header has them.
        most: Samples allowed.

    Raises:
        InputError: it is no such text, has no such columns, or a line is broken.
    """
    with library(path, "text of comma-separated numbers"):
        lines, notes = lines_of(path)
        header = _header(path, lines, columns)
        rows = _rows(path, lines, header)
        if len(rows) > most:
            raise InputError(f"{shown(path.name)} has {len(rows)} samples: give at most {most}")
        clocks = _clock_columns(header, rows, columns)
        wanted = [*columns, *clocks]
        places = [header.names.index(name) for name in wanted]
        commas: tuple[str, ...] = ()
        plain = rows
        if header.delimiter != "," and any("," in row for row in rows):
            if not any("." in row for row in rows):
                plain = [row.replace(",", ".") for row in rows]
                commas = ("the numbers were read with decimal commas",)
            else:
                plain = None
        values = _parsed(plain, header.delimiter, places)
        if values is None:
            values, commas = _parsed_cell_by_cell(path, lines, header, wanted, places, len(columns))
        notes = (*notes, *commas)
        if lines[-1].strip():
            notes = (*notes, "its last line has no end, so it may be cut off there")
        found = {name: as_floats(values[:, i]) for i, name in enumerate(wanted)}
    clock = clock_from({name: found.pop(name) for name in clocks}, len(rows), header.units)
    return Table(found, clock, notes, header.units)


def _clock_columns(header: _Header, rows: Sequence[str], columns: Sequence[str]) -> list[str]:
    """The columns that may hold the time: by their names, and by what their first cell holds."""
    found = []
    first = rows[0].split(header.delimiter) if rows else []
    for name in time_names(header.names, columns):
        place = header.names.index(name)
        cell = first[place].strip().strip('"').strip().replace(",", ".", 1) if place < len(first) else ""
        if header.names.count(name) == 1 and (name == CLOCK or number_in(cell) is not None):
            found.append(name)
    return found


def _header(path: Path, lines: Sequence[str], columns: Sequence[str]) -> _Header:
    """The first line that names all columns, under the delimiter that parts it into most cells."""
    best: _Header | None = None
    for i, line in enumerate(lines[:HEADER_WITHIN]):
        bare = line.lstrip("#% \t") if line.lstrip().startswith(("#", "%")) else line
        for delimiter in ",;\t":
            names = cells_of(bare, delimiter)
            if all(column in names for column in columns) and (best is None or len(names) > len(best.names)):
                best = _Header(i, delimiter, names, {}, i + 1)
        if best is not None:
            break
    if best is None:
        _no_header(path, lines, columns)
    for column in columns:
        if best.names.count(column) > 1:
            raise InputError(f"{shown(path.name)} has the column {shown(column)} twice: give each its own name")
    return _with_units(lines, best, columns)


def _with_units(lines: Sequence[str], header: _Header, columns: Sequence[str]) -> _Header:
    """The header, and the units in the first line below it that holds anything, if these are units."""
    for i, line in enumerate(lines[header.line + 1 : header.line + 4], header.line + 1):
        if not line.strip():
            continue
        cells = cells_of(line.lstrip("#% ") if line.lstrip().startswith(("#", "%")) else line, header.delimiter)
        if len(cells) not in (len(header.names), len(header.names) + 1):
            break
        stated = dict(zip(header.names, cells, strict=False))
        units = {name: unit for name, cell in stated.items() if (unit := known_unit(cell)) is not None}
        asked = [stated[column] for column in columns if column not in units]
        if units and any(column in units for column in columns) and all(cell in ("", "-") for cell in asked):
            return header._replace(units=units, below=i + 1)
        break
    return header


def listed_columns(path: Path) -> dict[str, str | None]:
    """The columns of a .csv with numbers in them, each with its unit in the line below the names, if there is one.

    The header is the line above the first two lines of numbers, or above the line of units there.

    Raises:
        InputError: it is no text, or has no such header.
    """
    lines, _ = lines_of(path)
    best: tuple[list[str], list[str], list[str]] | None = None
    filled = [line for line in lines[: HEADER_WITHIN + 4] if line.strip()]
    for i, line in enumerate(filled[:-1]):
        for delimiter in ",;\t":
            names = cells_of(line.lstrip("#% ") if line.lstrip().startswith(("#", "%")) else line, delimiter)
            for skipped in (1, 2):
                below = [cells_of(each, delimiter) for each in filled[i + skipped : i + skipped + 2]]
                units = cells_of(filled[i + 1].lstrip("#% "), delimiter) if skipped == 2 else []
                if _is_header(names, units, below) and (best is None or len(names) > len(best[0])):
                    best = names, units, below[0]
        if best is not None:
            break
    if best is None:
        raise InputError(f"{shown(path.name)} has no line of names above its numbers: name its columns in line 1")
    names, units, first = best
    found = {}
    for place, name in enumerate(names):
        if name and names.count(name) == 1 and place < len(first) and _is_number(first[place]):
            found[name] = known_unit(units[place]) if place < len(units) else None
    return found


def _is_header(names: Sequence[str], units: Sequence[str], below: Sequence[Sequence[str]]) -> bool:
    """Whether names stand above lines of numbers of as many cells, with units, if any, that are units."""
    if not below or not any(names) or any(_is_number(name) for name in names):
        return False
    if units and (len(units) < len(names) - 1 or not any(known_unit(unit) for unit in units)):
        return False
    return all(
        abs(len(cells) - len(names)) <= 1 and any(_is_number(cell) and cell for cell in cells) for cells in below
    )


def _is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a decimal comma or a point."""
    return bool(cell) and number_in(cell.replace(",", ".", 1)) is not None


def _no_header(path: Path, lines: Sequence[str], columns: Sequence[str]) -> NoReturn:
    """Say which column is missing from the line that names most of them, or else from the first."""
    parted = [
        cells_of(line, delimiter) for line in lines[:HEADER_WITHIN] if line.strip() for delimiter in (",", ";", "\t")
    ]
    if not parted:
        raise InputError(f"{shown(path.name)} is empty: give a header line and numbers below it")
    closest = max(parted, key=lambda names: (sum(column in names for column in columns), len(names)))
    lacking = next(column for column in columns if column not in closest)
    if any(NUMBER.fullmatch(name) for name in closest):
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
    rows = [line for line in lines[header.below :] if line.strip()]
    counts = {row.count(header.delimiter) for row in rows}
    if counts == {width + 1} and all(row.rstrip(" ").endswith(header.delimiter) for row in rows):
        return [row.rstrip(" ")[:-1] for row in rows]
    if counts - {width}:
        for i, line in enumerate(lines[header.below :], header.below + 1):
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
    path: Path, lines: Sequence[str], header: _Header, wanted: Sequence[str], places: Sequence[int], asked: int
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """(rows, columns) of a file with empty cells, quoted numbers or text beside them, and what to note about it.

    The first ``asked`` columns, and the file's own time_s, must hold numbers; where the others do not, they are NaN.
    """
    must = [i < asked or name == CLOCK for i, name in enumerate(wanted)]
    table, points, commas = [], 0, 0
    for i, line in enumerate(lines[header.below :], header.below + 1):
        if not line.strip():
            continue
        cells = line.split(header.delimiter)
        row = []
        for name, place, needed in zip(wanted, places, must, strict=True):
            text = cells[place].strip().strip('"').strip()
            if header.delimiter != ",":
                if needed:
                    points, commas = points + ("." in text), commas + ("," in text)
                text = text.replace(",", ".", 1) if "." not in text else text
            row.append(_number(path, i, name, text, needed))
        table.append(row)
    if points and commas:
        raise InputError(f"{shown(path.name)} has numbers with . and numbers with ,: write all with one of them")
    notes = ("the numbers were read with decimal commas",) if commas else ()
    return np.array(table, dtype=float).reshape(len(table), len(wanted)), notes


def _number(path: Path, line: int, column: str, text: str, needed: bool) -> float:
    value = number_in(text)
    if value is not None:
        return value
    if not needed:
        return float("nan")
    raise InputError(
        f"line {line} of {shown(path.name)}, column {shown(column)}, holds {shown(text)}: give a number or nothing"
    )
