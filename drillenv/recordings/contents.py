"""What a data file holds, before anybody has said what it means: columns, units, and how fast it was sampled."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drillenv.checks import InputError, shown
from drillenv.recordings.campaign import LEAST_SAMPLES, MOST_SAMPLES, reader_of
from drillenv.recordings.clock import is_time_name
from drillenv.recordings.read_csv import listed_columns
from drillenv.recordings.signal_faults import rate_of
from drillenv.recordings.table import Table, library
from drillenv.recordings.units import TIME_UNITS, known_unit, named_unit

PLAUSIBLE_RATES = (100.0, 1e7)
"""Hz: a time without a unit is taken to be in the first of s, ms and us that brings its rate in here."""
_RATE_NAMES = re.compile(r"(fs|f_s|srate|(sample|sampling|scan)[ _]?(rate|freq|frequency)|abtastrate|wf_samplingrate)")
_STEP_NAMES = re.compile(r"(dt|delta_?t|ts|(sample|sampling)[ _]?(interval|period|time)|wf_increment)")
NEAT = 5e-5
"""Of a sample rate: what its rounding to few digits may change."""


@dataclass(frozen=True, slots=True)
class Contents:
    """Columns of a file that may be channels."""

    file: str
    units: Mapping[str, str | None]
    """Of each column its unit as a campaign would write it; None where neither the file nor its name says."""
    table: Table
    """Its samples, in the file's units."""
    sample_rate: float | None
    """Hz; None where the file does not say."""
    rate_from: str
    """What the sample rate was read from."""
    notes: tuple[str, ...] = field(default=())


def contents_of(path: Path) -> Contents:
    """Look into a data file.

    Raises:
        InputError: it cannot be read, or holds no rows of numbers.
    """
    units, scalars = _listed(path)
    names = [name for name in units if not is_time_name(name)]
    if not names:
        raise InputError(f"{shown(path.name)} holds no columns of numbers beside a time: give one with a force")
    read = reader_of(path.name)
    table = read(path, names)
    size = max(samples.size for samples in table.columns.values())
    whole = {name: samples for name, samples in table.columns.items() if samples.size == size}
    if not LEAST_SAMPLES <= size <= MOST_SAMPLES:
        raise InputError(f"{shown(path.name)} has {size} samples: give {LEAST_SAMPLES} to {MOST_SAMPLES}")
    if len(whole) < len(names):
        table = read(path, list(whole))
    stated = {name: known_unit(table.units.get(name, "")) or units[name] or named_unit(name) for name in whole}
    rate, source = _sample_rate(table, scalars)
    return Contents(path.name, stated, table, rate, source, table.notes)


def _sample_rate(table: Table, scalars: Mapping[str, float]) -> tuple[float | None, str]:
    """Hz and what says so: the file's own time before a number that is named like one."""
    if table.clock is not None:
        for unit in table.clock.units:
            rate = rate_of(table.clock.samples * unit)
            if PLAUSIBLE_RATES[0] <= rate <= PLAUSIBLE_RATES[1] or len(table.clock.units) == 1:
                guess = "" if len(table.clock.units) == 1 or unit == 1.0 else f", taken to be in {_unit_name(unit)}"
                return (_neat(rate), f"its time {shown(table.clock.column)}{guess}") if rate > 0.0 else (None, "")
    for name, value in scalars.items():
        bare = name.rpartition("/")[2].lower()
        for pattern, rate in ((_RATE_NAMES, value), (_STEP_NAMES, 1.0 / value if value else 0.0)):
            if pattern.fullmatch(bare) and PLAUSIBLE_RATES[0] <= rate <= PLAUSIBLE_RATES[1]:
                return _neat(rate), f"its number {shown(name)}"
    return None, ""


def _unit_name(seconds: float) -> str:
    return next(name for name, factor in TIME_UNITS.items() if factor == seconds)


def _neat(rate: float) -> float:
    """With as few digits as say the same."""
    for digits in range(2, 9):
        short = float(f"{rate:.{digits}g}")
        if abs(short / rate - 1.0) < NEAT:
            return short
    return rate


# --------------------------------------------------------------------------------------------------------------------
# each format


def _listed(path: Path) -> tuple[dict[str, str | None], dict[str, float]]:
    """Columns of numbers with the units beside their names, and single numbers by name."""
    ending = path.suffix.lower()
    if ending == ".csv":
        return listed_columns(path), {}
    if ending == ".lvm":
        return _listed_lvm(path), {}
    if ending == ".tdms":
        return _listed_tdms(path), {}
    with open(path, "rb") as file:
        head = file.read(128)
    if ending == ".h5" or b"MATLAB 7.3" in head or head.startswith(b"\x89HDF"):
        return _listed_h5(path)
    return _listed_mat(path)


def _listed_lvm(path: Path) -> dict[str, str | None]:
    from drillenv.recordings.read_lvm import segments_of

    with library(path, "LabVIEW measurement file"):
        _, segments, _ = segments_of(path)
    first = segments[0]
    shared = [name for name in first.channels if all(name in each.channels for each in segments)]
    return {name: known_unit(first.said("Y_Unit_Label", first.channels[name])) for name in shared}


def _listed_tdms(path: Path) -> dict[str, str | None]:
    from drillenv.recordings.read_tdms import quiet

    with library(path, "TDMS file"), quiet():
        from nptdms import TdmsFile

        with open(path, "rb") as stream, TdmsFile.open(stream) as file:
            return {
                f"{group.name}/{channel.name}": known_unit(str(channel.properties.get("unit_string", "")))
                for group in file.groups()
                for channel in group.channels()
                if channel.dtype.kind in "iuf" and len(channel) >= LEAST_SAMPLES
            }


def _listed_h5(path: Path) -> tuple[dict[str, str | None], dict[str, float]]:
    from drillenv.recordings.read_h5 import MATLAB_NUMBERS, datasets_in

    columns: dict[str, str | None] = {}
    scalars: dict[str, float] = {}
    with library(path, "HDF5 file"):
        import h5py

        with h5py.File(path, "r") as file:
            _take_scalars(scalars, file.attrs)
            for name in datasets_in(file):
                dataset: Any = file[name]
                numbers = dataset.attrs.get("MATLAB_class", b"double") in MATLAB_NUMBERS
                if not numbers or dataset.dtype.kind not in "iuf" or dataset.shape is None or name.startswith("#"):
                    continue
                if dataset.size == 1:
                    scalars[name] = float(dataset[()].reshape(-1)[0])
                elif dataset.size == max(dataset.shape) and dataset.size <= MOST_SAMPLES:
                    columns[name] = None
                    _take_scalars(scalars, dataset.attrs)
    return columns, scalars


def _take_scalars(scalars: dict[str, float], attributes: Mapping[str, object]) -> None:
    for name, value in attributes.items():
        size, kind = getattr(value, "size", 1), getattr(getattr(value, "dtype", None), "kind", "f")
        if isinstance(value, int | float) or (size == 1 and kind in "iuf" and not isinstance(value, str | bytes)):
            scalars.setdefault(name, float(value))  # pyright: ignore[reportArgumentType]


def _listed_mat(path: Path) -> tuple[dict[str, str | None], dict[str, float]]:
    from drillenv.recordings.read_mat import rows_of_numbers

    rows = rows_of_numbers(path)
    read = reader_of(path.name)
    single = [name for name, size in rows.items() if size == 1]
    numbers = read(path, single).columns if single else {}
    scalars = {name: float(samples[0]) for name, samples in numbers.items()}
    return {name: None for name, size in rows.items() if LEAST_SAMPLES <= size <= MOST_SAMPLES}, scalars
