"""Bad input, said in one line: what was given, what is allowed, what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from typing import TypeVar

Option = TypeVar("Option")


class InputError(ValueError):
    """What the user handed in cannot be used. The message is one line, meant to be shown as it is."""


def shown(value: object) -> str:
    """``value`` as a message shows it: on one line, and cut where it is long."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python refuses to write out an integer of more than 4300 digits
        text = f"a very large {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."


def _plain(value: float) -> str:
    """Every digit given, so that a value just outside its range does not look as if it were inside."""
    return repr(value).removesuffix(".0")


def number(
    name: str,
    value: object,
    low: float,
    high: float,
    unit: str = "",
    slips: Sequence[tuple[float, str]] = (),
) -> float:
    """Return ``value`` as a float if it lies in ``[low, high]``.

    Args:
        name: What the number is called where the user typed it.
        value: What the user gave.
        low, high: The allowed range, both ends included, in ``unit``.
        unit: The unit expected, for the message.
        slips: Pairs ``(factor, unit)`` of units people mix up: the message proposes each ``value * factor`` that
            is allowed.

    Raises:
        InputError: not a real number, not finite, or outside the range.
    """
    suffix = f" {unit}" if unit else ""
    allowed = f"{low:g} to {high:g}{suffix}"
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name} is {shown(value)}, which is not a number: give a number from {allowed}")
    try:
        result = float(value)
    except OverflowError:
        raise InputError(f"{name} is {shown(value)}: give a number from {allowed}") from None
    if not math.isfinite(result):
        raise InputError(f"{name} is {result}: give a finite number from {allowed}")
    if low <= result <= high:
        return result
    meant = [f"in {slip}? then write {result * factor:g}" for factor, slip in slips if low <= result * factor <= high]
    advice = f" (was it {'; '.join(meant)})" if meant else ""
    raise InputError(f"{name} is {_plain(result)}{suffix}, outside {allowed}: give a value from {allowed}{advice}")


def count(name: str, value: object, low: int, high: int) -> int:
    """Return ``value`` as an int if it is a whole number in ``[low, high]``.

    Raises:
        InputError: not a whole number, or outside the range.
    """
    result = number(name, value, low, high)
    if result != int(result):
        raise InputError(f"{name} is {_plain(result)}: give a whole number from {low} to {high}")
    return int(result)


def choice(name: str, value: object, allowed: Sequence[Option]) -> Option:
    """Return the one of ``allowed`` that ``value`` is: equal and of its type, so that True is not 1.

    Raises:
        InputError: it is none of them.
    """
    for option in allowed:
        if type(value) is type(option) and value == option:
            return option
    listed = ", ".join(str(option) for option in allowed)
    raise InputError(f"{name} is {shown(value)}: give one of {listed}")
