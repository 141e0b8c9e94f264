"""Completion of commands and options in a shell, by shtab."""

from __future__ import annotations

import argparse
import contextlib
from typing import Any

from drillenv.checks import InputError
from drillenv.cli_options import Parser, commands_below

SHELLS = ("bash", "zsh", "tcsh")


class PrintCompletion(argparse.Action):
    """The option that prints a completion script for a shell, and ends."""

    def __init__(self, option_strings: Any, dest: str, help: str | None = None) -> None:
        super().__init__(option_strings, dest, choices=SHELLS, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Print the script."""
        print(script(parser, values))
        parser.exit()


def script(parser: Parser, shell: str) -> str:
    """The completion script of a parser and of all below it, for one of SHELLS.

    Commands whose options need an extra that is not installed are completed by their names only. The parser must not be
    used to parse afterwards.
    """
    import shtab

    for each in (parser, *commands_below(parser)):
        with contextlib.suppress(InputError):
            each.add_rest()
        for action in each._actions:
            if isinstance(action.metavar, str) and action.choices is None:
                _say_what_completes(action, action.metavar)
    return shtab.complete(parser, shell=shell)


def _say_what_completes(action: Any, placeholder: str) -> None:
    """Tell shtab what completes an option: the values that its placeholder lists, or files or folders."""
    import shtab

    if placeholder.startswith("{"):
        action.choices = placeholder.strip("{}").split(",")
    elif placeholder in ("DIR", "FOLDER", "CAMPAIGN"):
        action.complete = shtab.DIRECTORY
    elif placeholder in ("FILE", "REPORT") or "." in placeholder:
        action.complete = shtab.FILE
