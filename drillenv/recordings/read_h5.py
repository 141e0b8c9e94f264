"""HDF5, through h5py."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import CLOCK, clock_from, time_names
from drillenv.recordings.table import Table, as_floats, library, missing, series

MATLAB_NUMBERS = [f"{sign}int{bits}".encode() for sign in ("", "u") for bits in (8, 16, 32, 64)] + [
    b"double",
    b"single",
]
"""Classes that a MATLAB file of version 7.3 may write beside a dataset; text, too, is stored as numbers there."""
MOST_CHUNK_BYTES = 2**28
MOST_LINKS = 16
"""Followed from one name."""


def read_h5(path: Path, columns: Sequence[str], most: int) -> Table:
    """Read datasets of an HDF5 file. Data that the file only points to in other files are refused.

    Raises:
        InputError: it is no such file, is damaged, or has no such datasets of numbers.
    """
    with library(path, "HDF5 file"):
        import h5py

        with h5py.File(path, "r") as file:
            found = {column: _samples(file, path, column, most) for column in columns}
            beside = columns[0].rpartition("/")[0].strip("/")  # the group of the channels, and the file itself
            there = [f"{beside}/{name}" for name in _names(file, beside)] if beside else []
            names = time_names([*there, *_names(file, "")], columns)
            size = found[columns[0]].size
            clocks = {name: _samples(file, path, name, most) for name in names if _is_row(file, name, size)}
            units = {name: unit for name in [*columns, *clocks] if (unit := _stated_unit(file[name]))}
    return Table(found, clock_from(clocks, size, units), units=units)


def _names(file, group: str) -> list[str]:
    """Of what lies in a group of the file itself."""
    import h5py

    place = file.get(group) if group else file
    return list(place)[:1000] if isinstance(place, h5py.Group) else []


def _stated_unit(dataset) -> str:
    """What an attribute says of the unit; nothing where there is none."""
    for name in ("units", "unit", "Unit", "Units"):
        text = dataset.attrs.get(name)
        text = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
        if isinstance(text, str) and text.strip():
            return text.strip()
    return ""


def _samples(file, path: Path, column: str, most: int) -> NDArray[np.float64]:
    """One dataset, wholly inside this file."""
    import h5py

    dataset = _followed(file, path, column)
    if not isinstance(dataset, h5py.Dataset):
        missing(path, column, datasets_in(file), "dataset")
    if dataset.is_virtual or dataset.external:
        raise InputError(
            f"dataset {shown(column)} of {shown(path.name)} lies in another file: put its numbers in this one"
        )
    if dataset.shape is None or "MATLAB_empty" in dataset.attrs:
        raise InputError(f"dataset {shown(column)} of {shown(path.name)} is empty: give samples")
    matlab = dataset.attrs.get("MATLAB_class", b"double")
    if matlab not in MATLAB_NUMBERS:
        raise InputError(f"{shown(column)} of {shown(path.name)} is a MATLAB {shown(matlab)}: give an array of numbers")
    series(path, column, dataset.dtype, dataset.shape, most)
    if dataset.chunks and int(np.prod(dataset.chunks, dtype=object)) * dataset.dtype.itemsize > MOST_CHUNK_BYTES:
        raise InputError(
            f"dataset {shown(column)} of {shown(path.name)} is stored in too large pieces: export it again"
        )
    return as_floats(dataset[()])


def _followed(file, path: Path, column: str):
    """The object of this name; None where there is none. A link to another file is refused, not followed."""
    import h5py

    place, steps, followed = file, [step for step in column.split("/") if step], 0
    while steps:
        if not isinstance(place, h5py.Group):
            return None
        link = place.get(steps[0], getlink=True)
        if link is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise InputError(
                f"dataset {shown(column)} of {shown(path.name)} links to another file: put its numbers here"
            )
        if isinstance(link, h5py.SoftLink):
            followed += 1
            if followed > MOST_LINKS:
                raise InputError(f"dataset {shown(column)} of {shown(path.name)} links in a circle: link to the data")
            place = file if link.path.startswith("/") else place
            steps = [step for step in link.path.split("/") if step] + steps[1:]
        else:
            place = place[steps.pop(0)]
    return place


def _is_row(file, name: str, size: int) -> bool:
    """Whether the file itself has a row of so many numbers of this name."""
    import h5py

    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        return False
    there = file[name]
    if not isinstance(there, h5py.Dataset) or there.dtype.kind not in "iuf" or there.shape is None:
        return False
    return (name == CLOCK or there.size == size) and max(there.shape, default=1) == there.size


def datasets_in(group, prefix: str = "", depth: int = 3) -> Iterator[str]:
    """Names of the datasets of the file itself, of the first hundred of each group."""
    import h5py

    for name in list(group)[:100]:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        if isinstance(group[name], h5py.Dataset):
            yield prefix + name
        elif depth:
            yield from datasets_in(group[name], f"{prefix}{name}/", depth - 1)
