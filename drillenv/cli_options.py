"""What the commands share: parsing options, and printing JSON."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NoReturn

from drillenv.checks import InputError, shown


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are InputErrors."""

    fill: Callable[[Parser], None] | None = None
    """Adds options when the parser is first used: of commands that have to import much to know them."""
    example: str = ""
    """A command line that works, shown below the help."""

    def add_rest(self) -> None:
        """Add the options that are still to be added.

        Raises:
            InputError: what knows them is not installed.
        """
        fill, self.fill = self.fill, None
        if fill is not None:
            fill(self)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Add the options that are still to be added, and parse."""
        self.add_rest()
        return super().parse_known_args(args, namespace)

    def format_help(self) -> str:
        """The help, with the example as one line that can be copied."""
        text = super().format_help()
        return f"{text}\nexample:\n  {self.example}\n" if self.example else text

    def error(self, message: str) -> NoReturn:
        """Complain in one line."""
        raise InputError(f"{message} (see {self.prog} --help)")


def add_commands(parser: Parser, dest: str, commands: Iterable[tuple[str, Callable[[Parser], None], str, str]]) -> None:
    """Commands below ``parser``: the name of each, what adds its options, what it does, and an example's options."""
    below = parser.add_subparsers(metavar="COMMAND", required=True, dest=dest)
    for name, add, line, example in commands:
        command = below.add_parser(name, help=line, description=f"{line[0].upper()}{line[1:]}.", allow_abbrev=False)
        command.example = f"{command.prog} {example}"
        add(command)


def commands_below(parser: argparse.ArgumentParser) -> Iterator[Parser]:
    """The parsers of all commands below one, and of those below them."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield command
                yield from commands_below(command)


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
