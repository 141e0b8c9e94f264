"""What the commands share: parsing options, and printing JSON."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

from drillenv.checks import InputError, shown


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are InputErrors."""

    fill: Callable[[Parser], None] | None = None
    """Adds options when the parser is first used: of commands that have to import much to know them."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Add the options that are still to be added, and parse."""
        fill, self.fill = self.fill, None
        if fill is not None:
            fill(self)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Complain in one line."""
        raise InputError(f"{message} (see {self.prog} --help)")


def plain_number(text: str) -> float:
    """A number, as an option gives it; its limits are checked where it is used."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{shown(text)} is not a number: give one such as 0.45") from None


def whole_number(text: str) -> int:
    """A whole number, as an option gives it."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{shown(text)} is not a whole number: give one such as 4") from None


def print_json(value: object) -> None:
    """Print a value as JSON, arrays as lists, and null where there is no finite number."""
    print(json.dumps(_as_json(value), indent=2, allow_nan=False))


def _as_json(value: Any) -> Any:
    """``value`` as JSON knows it: no arrays, and null where there is no finite number."""
    if isinstance(value, Mapping):
        return {str(key): _as_json(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(part) for part in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    convert: Callable[[], Any] | None = getattr(value, "tolist", None)
    return value if convert is None else _as_json(convert())


def add_json(parser: Parser) -> None:
    """The option --json."""
    parser.add_argument("--json", action="store_true", help="print JSON")
