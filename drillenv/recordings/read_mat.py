"""MATLAB files: version 5 through SciPy, version 7.3, which is HDF5, through h5py.

SciPy's reader of version 5 takes type codes and sizes on trust, and a damaged one can end the whole program
(https://github.com/scipy/scipy/pull/25829). So the file is walked here first, element by element as MATLAB documents
them ("MAT-File Format", The MathWorks), and SciPy is handed only arrays of numbers whose parts all fit.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import CLOCK, clock_from, is_time_name
from drillenv.recordings.table import Table, as_floats, library, missing, series

HEADER = 128
"""Bytes before the first element."""
MATRIX, COMPRESSED = 14, 15
"""Type codes of the elements of a file."""
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Bytes of a number, by type code."""
NUMBERS = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""MATLAB's classes of numbers, by code, as types of that size."""
OTHERS = {
    1: "a cell",
    2: "a struct",
    3: "an object",
    4: "text",
    5: "a sparse matrix",
    16: "a function",
    17: "an object",
}
"""Its other classes. They stay shut."""
OPAQUE = 17
"""The class that has no dimensions: what MATLAB keeps of its newer objects, such as strings and tables."""
COMPLEX, LOGICAL = 0x800, 0x200
"""Flags of an array."""
MOST_HEAD = 4096
"""Bytes in which flags, dimensions and name of an array must stand."""


class _Array(NamedTuple):
    """What an element of the file says of itself."""

    name: str
    flags: int
    shape: tuple[int, ...]
    data_at: int
    """Where in the element its numbers begin."""


def read_mat(path: Path, columns: Sequence[str], most: int) -> Table:
    """Read variables of a MATLAB file. Nothing but arrays of real numbers is ever loaded.

    Raises:
        InputError: it is no such file, is damaged, or has no such variables of numbers.
    """
    with open(path, "rb") as file:
        head = file.read(HEADER)
    # HDF5 behind MATLAB's 512 bytes, or from the start, as other programs write it
    if b"MATLAB 7.3" in head or head.startswith(b"\x89HDF"):
        from drillenv.recordings.read_h5 import read_h5

        return read_h5(path, columns, most)
    order = _byte_order(path, head)
    with library(path, "MATLAB file"):
        return _read_version_5(path, order, columns, most)


def _byte_order(path: Path, head: bytes) -> str:
    order = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}.get(head[124:])
    if order is None:
        raise InputError(f"{shown(path.name)} is no MATLAB file of version 5 or 7.3: save it with -v7 or -v7.3")
    return order


def _read_version_5(path: Path, order: str, columns: Sequence[str], most: int) -> Table:
    from scipy.io import loadmat

    data = path.read_bytes()
    there, parts = [], {}
    for element, is_packed in _elements(path, data, order):
        array = _described(path, _unpacked(path, element, order, MOST_HEAD) if is_packed else element, order)
        there.append(array.name)
        if array.name in columns or (is_time_name(array.name) and _may_be_time(array, most)):
            _check(path, array, most)
            room = 8 * most + MOST_HEAD
            parts[array.name] = _unpacked(path, element, order, room) if is_packed else element
            _check_numbers(path, array, parts[array.name], order)
    for column in columns:
        if column not in parts:
            missing(path, column, there, "variable")
    sound = b"".join(struct.pack(f"{order}II", MATRIX, len(part)) + part for part in parts.values())
    loaded = loadmat(io.BytesIO(data[:HEADER] + sound))
    found = {name: as_floats(loaded[name]) for name in parts}
    channels = {column: found.pop(column) for column in columns}
    clocks = {name: found[name] for name in sorted(found, key=lambda name: name != CLOCK)}
    return Table(channels, clock_from(clocks, channels[columns[0]].size))


def rows_of_numbers(path: Path) -> dict[str, int]:
    """Of each variable of a version 5 file that is a row or column of real numbers, how many there are.

    Raises:
        InputError: it is no such file, or is damaged.
    """
    with open(path, "rb") as file:
        order = _byte_order(path, file.read(HEADER))
    with library(path, "MATLAB file"):
        found = {}
        for element, is_packed in _elements(path, path.read_bytes(), order):
            array = _described(path, _unpacked(path, element, order, MOST_HEAD) if is_packed else element, order)
            size = int(np.prod(array.shape, dtype=object))
            plain = array.flags & 0xFF in NUMBERS and not array.flags & (LOGICAL | COMPLEX)
            if plain and size and size == max(array.shape, default=0):
                found[array.name] = size
    return found


def _may_be_time(array: _Array, most: int) -> bool:
    """Whether it is a row of real numbers, which a time must be; one by the name time_s is refused if it is none."""
    if array.flags & 0xFF not in NUMBERS:
        return False
    size = int(np.prod(array.shape, dtype=object))
    plain = not array.flags & (LOGICAL | COMPLEX) and size == max(array.shape, default=1) and size <= most
    return array.name == CLOCK or plain


def _elements(path: Path, data: bytes, order: str) -> Iterator[tuple[bytes, bool]]:
    """The content of each array of the file, and whether it is packed."""
    at = HEADER
    while at < len(data):
        code, size = _tag(path, data, at, order)
        if code not in (MATRIX, COMPRESSED):
            _damaged(path, f"type {code} where a variable begins")
        if at + 8 + size > len(data):
            raise InputError(f"{shown(path.name)} is cut off: copy or export it again, whole")
        yield data[at + 8 : at + 8 + size], code == COMPRESSED
        at += 8 + size


def _unpacked(path: Path, element: bytes, order: str, most: int) -> bytes:
    """The content of the array in a packed element: its first ``most`` bytes if there are more."""
    unpacker = zlib.decompressobj()
    content = unpacker.decompress(element, most + 8)
    code, size = _tag(path, content, 0, order)
    if code != MATRIX:
        _damaged(path, f"type {code} in a packed variable")
    if not unpacker.eof and len(content) < 8 + min(size, most):
        _damaged(path, "a packed variable ends early")
    if unpacker.eof and len(content) != 8 + size:  # the end is reached only if the checksum is right
        _damaged(path, "a packed variable of another size than it says")
    return content[8:]


def _described(path: Path, element: bytes, order: str) -> _Array:
    """Flags, dimensions and name of an array."""
    at = 0

    def part(allowed: tuple[int, ...]) -> bytes:
        nonlocal at
        code, size, begins, at = _part(path, element, at, order)
        if code not in allowed or begins + size > len(element):
            _damaged(path, f"type {code} in the description of a variable")
        return element[begins : begins + size]

    flags = int.from_bytes(part((6,))[:4], "little" if order == "<" else "big")
    dimensions = b"" if flags & 0xFF == OPAQUE else part((5, 6))
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions[: len(dimensions) // 4 * 4])
    if min(shape, default=0) < 0:
        _damaged(path, "a dimension below zero")
    return _Array(part((1, 16)).decode("utf-8", "replace"), flags, shape, at)


def _check(path: Path, array: _Array, most: int) -> None:
    """Refuse what is no row of real numbers."""
    kind = array.flags & 0xFF
    if kind not in NUMBERS or array.flags & LOGICAL:
        what = OTHERS.get(kind, "a logical array" if kind in NUMBERS else f"of class {kind}")
        raise InputError(f"{shown(array.name)} of {shown(path.name)} is {what}: give an array of numbers")
    dtype = np.dtype("c16" if array.flags & COMPLEX else NUMBERS[kind])
    series(path, array.name, dtype, array.shape, most)


def _check_numbers(path: Path, array: _Array, element: bytes, order: str) -> None:
    """Refuse an array whose numbers are not as many as its dimensions say, or of no known type."""
    code, size, begins, _ = _part(path, element, array.data_at, order)
    count = int(np.prod(array.shape, dtype=object))
    if code not in SIZES or size != count * SIZES[code] or begins + size > len(element):
        _damaged(path, f"the numbers of {shown(array.name)} do not fit its dimensions")


def _part(path: Path, element: bytes, at: int, order: str) -> tuple[int, int, int, int]:
    """(type code, bytes, where they begin, where the next part begins) of the part of an element at ``at``."""
    code, size = _tag(path, element, at, order)
    if code >> 16:  # a short part, its bytes in place of its size
        size, code = code >> 16, code & 0xFFFF
        if size > 4:
            _damaged(path, "a short part of more than four bytes")
        return code, size, at + 4, at + 8
    return code, size, at + 8, at + 8 + (size + 7) // 8 * 8


def _tag(path: Path, data: bytes, at: int, order: str) -> tuple[int, int]:
    """The two numbers that every part begins with."""
    if at + 8 > len(data):
        _damaged(path, "it ends inside a variable")
    return struct.unpack_from(f"{order}II", data, at)


def _damaged(path: Path, how: str) -> NoReturn:
    raise InputError(f"{shown(path.name)} is no readable MATLAB file, or is damaged ({how}): export it again")
