"""What a reader hands back, and how a library's complaint becomes one line."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import Clock


class Table(NamedTuple):
    """The columns asked for."""

    columns: dict[str, NDArray[np.float64]]
    """(samples,) each, in the file's units."""
    clock: Clock | None = None
    """The file's own time, where it gives one."""
    notes: tuple[str, ...] = ()
    """What a person should know about how the file was read."""
    units: Mapping[str, str] = MappingProxyType({})
    """The units that the file itself states, by column, where it does so beside the names."""


@contextmanager
def library(path: Path, kind: str) -> Iterator[None]:
    """Whatever a library raises or warns about a file becomes one line: damaged files make them raise anything."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except ImportError as error:
        raise InputError(
            f"{shown(path.name)} needs {error.name}: install the readers with pip install 'drillenv[formats]'"
        ) from None
    except MemoryError:
        raise InputError(f"{shown(path.name)} does not fit into memory: cut it into several recordings") from None
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        reason = reason if len(reason) <= 120 else f"{reason[:117]}..."
        raise InputError(
            f"{shown(path.name)} is no readable {kind}, or is damaged ({reason}): export it again"
        ) from None


def missing(path: Path, column: str, there: Iterable[str], what: str) -> NoReturn:
    """Refuse a file that lacks a column, and say what it has."""
    listed = [shown(name) for name in there]
    few = ", ".join(listed[:12]) + (", ..." if len(listed) > 12 else "") if listed else "none"
    raise InputError(f"{shown(path.name)} has no {what} {shown(column)}: give one of those it has, {few}")


def series(path: Path, column: str, dtype: np.dtype, shape: Sequence[int], most: int) -> None:
    """Refuse what is no row of real numbers, or is too long, before it is read."""
    if np.dtype(dtype).kind not in "iuf":
        raise InputError(f"{shown(column)} of {shown(path.name)} holds no real numbers ({dtype}): give plain numbers")
    length = max(shape, default=1)
    if int(np.prod([int(side) for side in shape], dtype=object)) != length:
        sides = " x ".join(str(side) for side in shape)
        raise InputError(f"{shown(column)} of {shown(path.name)} is {sides}: give one row or column of samples")
    if length > most:
        raise InputError(f"{shown(column)} of {shown(path.name)} has {length} samples: give at most {most}")


def as_floats(values: object) -> NDArray[np.float64]:
    """(samples,) of float64, whatever the file's type of number."""
    return np.ascontiguousarray(np.asarray(values).reshape(-1), dtype=np.float64)
