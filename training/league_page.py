"""The whole league: every condition, its record and tables, and the figure of how controllers lose.

    python -m drillenv.training.league_page --out docs/league --policies DIR DIR DIR DIR DIR
    python -m drillenv.training.league_page --out docs/league --controllers rules shipped

Writes test.json, beyond.json and so on into the folder, the tables into their places in its README.md, and
degradation.png. Rows that the records hold already stay, unless they are asked for; with ``--controllers none`` tables
and figure are made anew from the records.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drillenv.checks import InputError, choice, count
from drillenv.cli_options import Parser
from drillenv.files import check_writable
from drillenv.training.conditions import CONDITIONS
from drillenv.training.evaluate import ALL, entries, evaluate, read_record, write_record
from drillenv.training.league_figure import draw
from drillenv.training.league_table import write_table


def parser() -> Parser:
    """The options."""
    made = Parser(prog="python -m drillenv.training.league_page", description=(__doc__ or "").split("\n")[0])
    made.add_argument("--out", required=True, help="folder of the league, with its README.md")
    made.add_argument(
        "--controllers", nargs="+", default=["all"], help=f"none, or as drillenv league: {', '.join(ALL)}, ..."
    )
    made.add_argument(
        "--policies", nargs="+", default=[], metavar="DIR", help="policies, for the rows of their algorithms"
    )
    made.add_argument("--trust-pickle", action="store_true", help="as drillenv league")
    made.add_argument("--conditions", nargs="+", default=list(CONDITIONS), help=f"of {', '.join(CONDITIONS)}")
    made.add_argument("--threads", type=int, help="threads of the rigs (default all cores)")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input, 130 when interrupted."""
    try:
        given = parser().parse_args(arguments)
        conditions = [choice("condition", name, tuple(CONDITIONS)) for name in given.conditions]
        asked = given.controllers
        wanted = {} if asked == ["none"] else entries(asked, given.policies, given.trust_pickle)
        threads = None if given.threads is None else count("threads", given.threads, 1, 1024)
        folder = Path(given.out)
        page, picture = folder / "README.md", folder / "degradation.png"
        if not page.is_file():
            raise InputError(f"--out is {given.out}, which has no README.md: give the folder of the league")
        check_writable(picture)
        for name in conditions:
            file = folder / f"{name}.json"
            kept = read_record(file) if file.is_file() else None

            def save(record: dict[str, Any], file: Path = file) -> None:
                write_record(file, record)

            record = evaluate(wanted, name, CONDITIONS[name], kept=kept, threads=threads, save=save)
            save(record)
            write_table(page, record)
        files = [folder / f"{name}.json" for name in CONDITIONS]
        draw({file.stem: read_record(file) for file in files if file.is_file()}, picture)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: rows that were done are in the folder, the others can be asked for again", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
