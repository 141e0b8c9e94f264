"""Text files of laboratories: their encoding, and their numbers."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from drillenv.checks import InputError, shown

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
NO_NUMBER = {"", "nan", "na", "n/a", "#n/a", "null", "none"}
INFINITE = {"inf", "+inf", "-inf", "infinity", "+infinity", "-infinity"}
_CONTROLS = re.compile(r"[\x01-\x08\x0e-\x1f\x7f]")


def lines_of(path: Path) -> tuple[list[str], tuple[str, ...]]:
    """The lines of a text file without their ends, and what to note about its encoding.

    Text is UTF-8, or UTF-16 where it begins with a byte order mark; what is neither is taken for Windows-1252 or, where
    that has no such byte, Latin-1, which differ in quotation marks and the like only.

    Raises:
        InputError: it is no text.
    """
    data = path.read_bytes()
    text, notes = _decoded(path, data)
    if "\0" in text:
        raise InputError(
            f"{shown(path.name)} is no text (it holds a zero byte): export it again as comma-separated text"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), notes


def _decoded(path: Path, data: bytes) -> tuple[str, tuple[str, ...]]:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            return data.decode("utf-16"), ("its text was read as UTF-16",)
        except UnicodeDecodeError as error:
            raise InputError(f"{shown(path.name)} is no text (byte {error.start}): save it as UTF-8") from None
    try:
        return data.decode("utf-8-sig"), ()
    except UnicodeDecodeError as error:
        at = error.start
    encoding, name = ("cp1252", "Windows-1252")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text, name = data.decode("latin-1"), "Latin-1"
    if _CONTROLS.search(text):
        raise InputError(f"{shown(path.name)} is no text (byte {at}): save it as UTF-8")
    return text, (f"its text is no UTF-8 (byte {at}) and was read as {name}",)


def number_in(text: str) -> float | None:
    """The number that a cell holds, NaN where it is empty or says that there is none; None for any other text."""
    lowered = text.lower()
    if NUMBER.fullmatch(text) or lowered in INFINITE:
        return float(text)
    return float("nan") if lowered in NO_NUMBER else None
