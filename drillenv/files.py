"""Files written whole or not at all, and JSON records and shipped arrays read."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drillenv.checks import InputError, shown

T = TypeVar("T")


def read_record(path: str | os.PathLike[str], what: str, form: str, largest: int, parse: Callable[[object], T]) -> T:
    """What ``parse`` makes of the JSON record in a file.

    Args:
        path: The file.
        what: What it is, for messages, such as ``model``.
        form: The format that its record names, likewise.
        largest: Bytes that it may have.
        parse: From the parsed JSON.

    Raises:
        InputError: no such file, too large, no JSON, or what ``parse`` raises, with the name of the file.
    """
    file = Path(path)
    try:
        if file.stat().st_size > largest:
            raise InputError(f"{what} {file} has {file.stat().st_size} bytes: give a {what} file, at most {largest}")
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{what} {file} cannot be read ({error.strerror}): give the path of a {what} file") from None
    except UnicodeDecodeError:
        raise InputError(f"{what} {file} is not text: give a JSON file of the format {form}") from None
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{what} {file} is not JSON ({shown(str(error))}): give a file of the format {form}") from None
    try:
        return parse(record)
    except InputError as error:
        raise InputError(f"{what} {file}: {error}") from None


def read_arrays(file: Path, what: str, shapes: Mapping[str, tuple[int, ...]], maker: str) -> dict[str, np.ndarray]:
    """The arrays of an npz file that ships with the package, float64.

    Args:
        file: Where it lies.
        what: It is called in messages.
        shapes: Of each array, by name.
        maker: The module that makes the file.

    Raises:
        InputError: the file is missing, or an array is, or has another shape.
    """
    try:
        with np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name].astype(float) for name in shapes}
    except (OSError, ValueError, KeyError):
        raise InputError(f"{what} {file} cannot be read: make it with python -m {maker}") from None
    if any(arrays[name].shape != shape for name, shape in shapes.items()):
        raise InputError(f"{what} {file} is of another version: make it anew with python -m {maker}")
    return arrays


def filled(package: str, template: str, **given: Any) -> str:
    """A page from a Jinja template that lies in a package; what is given is escaped, and all of it has to be there."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, ".")
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    # a name may hold half of a surrogate pair, which no encoding can write
    return made.get_template(template).render(given).encode("utf-8", "replace").decode("utf-8")


def made_folder(path: str | os.PathLike[str]) -> Path:
    """A folder to write into, which is made, with those above it, where there is none.

    Raises:
        InputError: ``path`` is no path, or the folder cannot be made.
    """
    try:
        folder = Path(path)
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, TypeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot make the folder {shown(str(path))}: {reason}; give another") from None
    return folder


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A name to write to, which becomes ``path`` when the block ends well and is removed when it does not.

    The name lies in the folder of ``path`` and ends alike, for writers that go by the ending. What is no regular file,
    such as /dev/stdout, is written to directly.

    Raises:
        InputError: ``path`` is no path or cannot be written.
    """
    target = _resolved(path)
    with _said(path):
        if target.exists() and not target.is_file():
            if target.is_dir():
                raise InputError(f"cannot write {shown(str(path))}: it is a folder; give the name of a file")
            yield target
            return
        temporary = target.with_name(f".{secrets.token_hex(4)}.{target.name}")
        try:
            temporary.touch(exist_ok=False)
            yield temporary
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Find out before long work whether ``path`` can be written; leaves nothing behind and changes nothing.

    Raises:
        InputError: it cannot.
    """
    target = _resolved(path)
    with _said(path):
        if target.is_file() and not os.access(target, os.W_OK):
            raise InputError(f"cannot write {shown(str(path))}: it is read-only; give another name")
    with suppress(_Enough), whole(path):
        raise _Enough


class _Enough(Exception):  # noqa: N818
    """Ends a trial before its file takes its name."""


def _resolved(path: str | os.PathLike[str]) -> Path:
    """What ``path`` leads to, through links, so that a link stays one."""
    try:
        given = os.fspath(path)
        if not isinstance(given, str) or not given.strip() or "\0" in given:
            raise TypeError
        return Path(given).resolve()
    except (TypeError, OSError, RuntimeError):
        raise InputError(f"path is {shown(path)}: give the name of a file") from None


@contextmanager
def _said(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say what the system says in one line."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"cannot write {shown(str(path))}: {reason}; give a file in a folder you can write to"
        ) from None
