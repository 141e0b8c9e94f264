"""LabVIEW's TDMS, through npTDMS."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import Clock, clock_from, time_names
from drillenv.recordings.table import Table, as_floats, library, missing, series

UNSTATED = 1.0
"""s, the increment that LabVIEW writes where none was given."""


def read_tdms(path: Path, columns: Sequence[str], most: int) -> Table:
    """Read channels, named group/channel, of a .tdms file. LabVIEW's own scaling is applied.

    Raises:
        InputError: it is no such file, is cut off or damaged, or has no such channels of numbers.
    """
    with library(path, "TDMS file"), quiet():
        from nptdms import TdmsFile

        with open(path, "rb") as stream, TdmsFile.open(stream) as file:
            if file.file_status.incomplete_final_segment:
                raise InputError(f"{shown(path.name)} is cut off: copy or export it again, whole")
            there = {f"{group.name}/{channel.name}": channel for group in file.groups() for channel in group.channels()}
            found, clock, units = {}, None, {}
            for column in columns:
                if column not in there:
                    missing(path, column, there, "channel")
                channel = there[column]
                series(path, column, channel.dtype, (len(channel),), most)
                found[column] = as_floats(channel[:])
                increment = channel.properties.get("wf_increment")
                if clock is None and isinstance(increment, float) and 0.0 < increment < 1e6 and increment != UNSTATED:
                    clock = Clock(np.arange(found[column].size) * increment, "wf_increment")
                unit = channel.properties.get("unit_string")
                if isinstance(unit, str) and unit.strip():
                    units[column] = unit.strip()
            if clock is None:
                clock = _time_channel(there, columns, found[columns[0]].size)
    return Table(found, clock, units=units)


def _time_channel(there: Mapping[str, Any], columns: Sequence[str], size: int) -> Clock | None:
    """A channel of the same group that holds the time."""
    group = there[columns[0]].group_name
    names = time_names([name for name in there if there[name].group_name == group], columns)
    plain = [name for name in names if there[name].dtype.kind in "iuf" and len(there[name]) == size]
    units = {name: str(there[name].properties.get("unit_string", "")) for name in plain}
    return clock_from({name: as_floats(there[name][:]) for name in plain}, size, units)


@contextmanager
def quiet() -> Iterator[None]:
    """No words on the terminal: npTDMS logs what it finds odd, and what is wrong is said here."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
