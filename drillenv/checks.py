"""Bad input, said in one line: what was given, what is allowed, what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real


class InputError(ValueError):
    """What the user handed in cannot be used. The message is one line, meant to be shown as it is."""


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
        slips: Pairs ``(factor, unit)`` of units people mix up: if ``value * factor`` is allowed, the message
            proposes it.

    Raises:
        InputError: not a real number, not finite, or outside the range.
    """
    suffix = f" {unit}" if unit else ""
    allowed = f"{low:g} to {high:g}{suffix}"
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name} is {value!r}, which is not a number: give a number from {allowed}")
    result = float(value)
    if not math.isfinite(result):
        raise InputError(f"{name} is {result}: give a finite number from {allowed}")
    if low <= result <= high:
        return result
    advice = f"give a value from {allowed}"
    for factor, slip in slips:
        if low <= result * factor <= high:
            advice += f" (was it in {slip}? then write {result * factor:g})"
            break
    raise InputError(f"{name} is {result:g}{suffix}, outside {allowed}: {advice}")


def count(name: str, value: object, low: int, high: int) -> int:
    """Return ``value`` as an int if it is a whole number in ``[low, high]``.

    Raises:
        InputError: not a whole number, or outside the range.
    """
    result = number(name, value, low, high)
    if result != int(result):
        raise InputError(f"{name} is {result:g}: give a whole number from {low} to {high}")
    return int(result)


def choice(name: str, value: object, allowed: Sequence[object]) -> object:
    """Return ``value`` if it is one of ``allowed``.

    Raises:
        InputError: it is not.
    """
    if value not in allowed:
        listed = ", ".join(str(option) for option in allowed)
        raise InputError(f"{name} is {value!r}: give one of {listed}")
    return value
