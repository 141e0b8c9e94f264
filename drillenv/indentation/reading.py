"""Reading the csv of a quasi-static indentation test.

    time (s),displacement (mm),force (kN)
    0.0,0.0000,0.001

Columns are known by their names, in any order and among others: displacement (or extension, penetration, depth,
position), force (or load), and where there are such, time and the number of the indentation (indentation, cycle or
test). Each but the number has its unit in its name, "force (kN)", "force [kN]" or "force_kN", or in a line of units
below.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.read_csv import HEADER_WITHIN, cells_of, read_csv
from drillenv.recordings.table import library
from drillenv.recordings.text import lines_of
from drillenv.recordings.units import CHANNEL_UNITS, unit_of

MOST_SAMPLES = 5_000_000
FEWEST_SAMPLES = 60
"""Of a whole curve; each branch has a limit of its own."""
NAMES: dict[str, tuple[str, ...]] = {
    "displacement": ("displacement", "extension", "penetration", "depth", "position"),
    "force": ("force", "load"),
    "time": ("time",),
    "number": ("indentation", "cycle", "test", "number"),
}
UNITS = {
    "displacement": CHANNEL_UNITS["position"],
    "force": CHANNEL_UNITS["force"],
    "time": {**CHANNEL_UNITS["time"], "min": 60.0},
}
_NAME = re.compile(r"\s*(?P<name>[A-Za-z ]*[A-Za-z])\s*(?:[(\[](?P<enclosed>[^)\]]*)[)\]]|[_/,]\s*(?P<behind>\S+))?\s*")


@dataclass(frozen=True, slots=True)
class Curve:
    """Force over displacement, in SI."""

    time: NDArray[np.float64]
    """(samples,) s; the number of the sample where the file gives no time."""
    displacement: NDArray[np.float64]
    """(samples,) m, growing into the rock."""
    force: NDArray[np.float64]
    """(samples,) N, growing with the load."""
    number: NDArray[np.float64] | None = None
    """(samples,) the number of the indentation, where the file gives one."""
    timed: bool = True
    """Whether the file gives the time."""
    name: str = "curve"
    sha256: str = ""
    """Of the file."""
    units: tuple[str, str] = ("m", "N")
    """Of displacement and force in the file."""
    notes: tuple[str, ...] = ()
    """What a person should know about how the file was read."""


class _Column(NamedTuple):
    kind: str
    header: str
    unit: str


def read_curve(path: str | Path) -> Curve:
    """Read the csv of an indentation test, as the head of this module describes it.

    Raises:
        InputError: no such file, a column or its unit is missing, a value is no number, or the time does not grow.
    """
    if not str(path).strip() or "\0" in str(path):
        raise InputError(f"curve is {shown(str(path))}: give the path of a csv file")
    file = Path(path)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise InputError(f"curve {shown(str(file))} cannot be read ({error.strerror}): give a csv file") from None
    with library(file, "text of comma-separated numbers"):
        columns = _columns(file, lines_of(file)[0])
    table = read_csv(file, [column.header for column in columns.values()], MOST_SAMPLES)
    values = {
        kind: table.columns[column.header] * (UNITS[kind][column.unit] if kind in UNITS else 1.0)
        for kind, column in columns.items()
    }
    return _checked(file, values, hashlib.sha256(content).hexdigest(), columns, table.notes)


def _columns(file: Path, lines: list[str]) -> dict[str, _Column]:
    """The columns by their kind."""
    for i, line in enumerate(lines[:HEADER_WITHIN]):
        bare = line.lstrip("#% \t") if line.lstrip().startswith(("#", "%")) else line
        for delimiter in ",;\t":
            headers = cells_of(bare, delimiter)
            kinds = [_kind(header) for header in headers]
            if "displacement" in kinds and "force" in kinds:
                following = cells_of(lines[i + 1], delimiter) if i + 1 < len(lines) else []
                return _with_units(file, headers, kinds, following)
    raise InputError(
        f"{shown(file.name)} has no header line with a displacement and a force: name the columns such as "
        "'displacement (mm)' and 'force (kN)'"
    )


def _kind(header: str) -> str | None:
    match = _NAME.fullmatch(header)
    words = match["name"].lower().split() if match else []
    unit = (match["enclosed"] or match["behind"]) if match else None
    for kind, names in NAMES.items():
        if any(name in words for name in names):
            if kind != "number" or unit in (None, "number", "no"):
                return kind
            return "displacement" if unit in UNITS["displacement"] else None
    return None


def _with_units(file: Path, headers: list[str], kinds: list[str | None], following: list[str]) -> dict[str, _Column]:
    """The columns with their units, which stand in their names or in the line below."""
    found: dict[str, _Column] = {}
    for i, (header, kind) in enumerate(zip(headers, kinds, strict=True)):
        if kind is None:
            continue
        if kind in found:
            raise InputError(
                f"{shown(file.name)} has two columns of {kind}, {shown(found[kind].header)} and {shown(header)}: "
                "rename one of them"
            )
        match = _NAME.fullmatch(header)
        given = (match["enclosed"] or match["behind"]) if match else None
        if kind in UNITS and given is None:
            cell = following[i].strip("()[] ") if i < len(following) else ""
            if not cell or cell[0].isdigit() or cell[0] in "+-.":
                raise InputError(
                    f"column {shown(header)} of {shown(file.name)} has no unit: write it behind the name, such as "
                    f"'{kind} ({next(iter(UNITS[kind]))})', one of {', '.join(UNITS[kind])}"
                )
            given = cell
        unit = unit_of(f"the unit of column {shown(header)}", given, UNITS[kind]) if kind in UNITS else ""
        found[kind] = _Column(kind, header, unit)
    return found


def _checked(
    file: Path, values: dict[str, NDArray], sha256: str, columns: dict[str, _Column], notes: tuple[str, ...]
) -> Curve:
    """The curve, without samples that lack a value, and turned so that both quantities grow with the load."""
    listed = list(notes)
    whole = np.all([~np.isnan(each) for each in values.values()], axis=0)
    if not whole.all():
        listed.append(f"{np.count_nonzero(~whole)} samples lack a value and are left out")
        values = {kind: each[whole] for kind, each in values.items()}
    for kind, each in values.items():
        if not np.all(np.isfinite(each)):
            raise InputError(f"column {shown(columns[kind].header)} of {shown(file.name)} holds an infinite value")
    force, displacement = values["force"], values["displacement"]
    if force.size < FEWEST_SAMPLES:
        raise InputError(
            f"{shown(file.name)} has {force.size} samples: give the whole test, of at least {FEWEST_SAMPLES}"
        )
    if np.ptp(force) == 0 or np.ptp(displacement) == 0:
        still = "force" if np.ptp(force) == 0 else "displacement"
        raise InputError(f"the {still} in {shown(file.name)} never changes: give a test with a load")
    if -force.min() > 2.0 * max(force.max(), 0.0):
        force = -force
        listed.append("the force falls under load, so its sign was turned")
    if np.corrcoef(force, displacement)[0, 1] < 0:
        displacement = -displacement
        listed.append("the displacement falls under load, so its sign was turned")
    time = values.get("time", np.arange(force.size, dtype=float))
    number = values.get("number")
    _check_time(file, time, number)
    units = (columns["displacement"].unit, columns["force"].unit)
    return Curve(time, displacement, force, number, "time" in values, file.name, sha256, units, tuple(listed))


def _check_time(file: Path, time: NDArray, number: NDArray | None) -> None:
    """Refuse a time that does not grow; each numbered indentation may begin anew."""
    backwards = np.diff(time) <= 0
    if number is not None:
        backwards &= np.diff(number) == 0
    if backwards.any():
        at = int(np.argmax(backwards)) + 1
        raise InputError(
            f"the time in {shown(file.name)} does not grow at sample {at + 1} "
            f"({time[at - 1]:g} s, then {time[at]:g} s): give the samples in the order they were taken, "
            "or leave the column of time out"
        )
