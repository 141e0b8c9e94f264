"""MATLAB files: version 5 through SciPy, version 7.3, which is HDF5, through h5py."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.recordings.table import CLOCK, Table, as_floats, library, missing, series

_HEADER = 128
_NUMERIC = {
    "double": "f8",
    "single": "f4",
    **{f"{sign}int{bits}": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
"""MATLAB's classes of numbers, as types of that size. All others (cells, structs, objects, functions) stay shut."""


def read_mat(path: Path, columns: Sequence[str], most: int) -> Table:
    """Read variables of a MATLAB file. Nothing but arrays of real numbers is ever loaded.

    Raises:
        InputError: it is no such file, is damaged, or has no such variables of numbers.
    """
    with open(path, "rb") as file:
        head = file.read(_HEADER)
    # HDF5 behind MATLAB's 512 bytes, or from the start, as other programs write it
    if b"MATLAB 7.3" in head or head.startswith(b"\x89HDF"):
        from drillenv.recordings.read_h5 import read_h5

        return read_h5(path, columns, most)
    version = head[124:128]
    if version not in (b"\x00\x01IM", b"\x01\x00MI"):
        raise InputError(f"{shown(path.name)} is no MATLAB file of version 5 or 7.3: save it with -v7 or -v7.3")
    return _read_version_5(path, columns, most)


def _read_version_5(path: Path, columns: Sequence[str], most: int) -> Table:
    with library(path, "MATLAB file"):
        from scipy.io import loadmat, whosmat

        there = {name: (shape, kind) for name, shape, kind in whosmat(str(path))}
        wanted = list(columns)
        for column in columns:
            if column not in there:
                missing(path, column, there, "variable")
            shape, kind = there[column]
            if kind not in _NUMERIC:
                raise InputError(f"{shown(column)} of {shown(path.name)} is a {kind}: give an array of numbers")
            series(path, column, np.dtype(_NUMERIC[kind]), shape, most)
        if CLOCK not in wanted and there.get(CLOCK, ((), ""))[1] in _NUMERIC:
            series(path, CLOCK, np.dtype(_NUMERIC[there[CLOCK][1]]), there[CLOCK][0], most)
            wanted.append(CLOCK)
        loaded = loadmat(str(path), variable_names=wanted)
        found = {}
        for column in wanted:
            values = loaded[column]
            series(path, column, values.dtype, values.shape, most)
            found[column] = as_floats(values)
    clock = found.pop(CLOCK) if CLOCK not in columns and CLOCK in found else None
    return Table(found, clock)
