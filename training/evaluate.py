"""The league: controllers through the same episodes, what each is worth, and how surely.

    python -m drillenv.training.evaluate --controllers all --scenario test --json OUT.json --table OUT.md
    python -m drillenv.training.evaluate --controllers rules seeking --scenario validation --episodes 10

``--scenario`` is a condition of :mod:`drillenv.training.conditions` (test, beyond, constants, constants-3, hidden) or
any other scenario. Runs that the file of ``--json`` holds already stay in it, unless their controller is asked for
again; the yardstick is run where it is missing. The table is made of the JSON alone.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from drillenv import controllers
from drillenv.checks import InputError, choice, count, shown
from drillenv.cli import Parser
from drillenv.controllers import Controller
from drillenv.controllers.policies import SHIPPED, WEIGHTS, read_policy
from drillenv.env.registration import STEPS
from drillenv.env.reward import Reward
from drillenv.files import check_writable, whole
from drillenv.training.conditions import Condition, condition, episodes_of, scenario_of, strata
from drillenv.training.league import FORMAT, YARDSTICK, summary
from drillenv.training.league_table import league_table, write_table
from drillenv.training.measures import MEASURES, measures
from drillenv.training.rollout import rollout

ALL = (*(name for name in controllers.NAMES if name != "learned"), "shipped", "learned", "learned-recurrent")
"""Rows of the league: the controllers by their names, the shipped policy, and the policies of several training seeds,
those with a memory apart."""


class Run(NamedTuple):
    """One controller, or one training seed of one."""

    make: Callable[[], Controller]
    seed: float | None
    """Training seed."""
    policy: str | None
    """SHA-256 of the weights."""


def entries(names: Sequence[str], policies: Sequence[str]) -> dict[str, list[Run]]:
    """The runs of each row that is asked for.

    Args:
        names: Of ALL, or "all": every row that there are policies for.
        policies: Folders of the policies of the rows "learned" and "learned-recurrent".

    Raises:
        InputError: no such row, a policy that cannot be read, or none for a row that needs some.
    """
    wanted = list(ALL) if "all" in names else [choice("controller", name, ALL) for name in names]
    trained = {"learned": [], "learned-recurrent": []}
    for folder in policies:
        trained["learned-recurrent" if read_policy(folder).lstm else "learned"].append(_policy_run(Path(folder)))
    found: dict[str, list[Run]] = {}
    for name in dict.fromkeys(wanted):
        if name == "shipped":
            found[name] = [_policy_run(SHIPPED)]
        elif name not in trained:
            found[name] = [Run(lambda name=name: controllers.make(name), None, None)]
        elif trained[name]:
            found[name] = trained[name]
        elif "all" not in names:
            raise InputError(f"controller {name} needs trained policies: give their folders after --policies")
    return found


def _policy_run(folder: Path) -> Run:
    policy = read_policy(folder)
    seed = policy.provenance.get("seed")
    digest = hashlib.sha256((folder / WEIGHTS).read_bytes()).hexdigest()
    number = None if isinstance(seed, str) else seed
    return Run(lambda: controllers.make("learned", policy=policy), number, digest)


def run_record(run: Run, chosen: Condition, episodes: int, steps: int, threads: int | None) -> dict[str, Any]:
    """What a run did in each episode, as JSON takes it."""
    with scenario_of(chosen) as scenario:
        made = rollout(run.make, chosen.environment, scenario, episodes, steps, threads)
    found = measures(made, Reward().rating)
    values = {
        name: [None if math.isnan(value) else value for value in found[name].astype(float).tolist()]
        for name in MEASURES
    }
    return {"seed": run.seed, "policy": run.policy, "episodes": values}


def evaluate(
    wanted: dict[str, list[Run]],
    name: str,
    chosen: Condition,
    episodes: int | None = None,
    steps: int | None = None,
    kept: dict[str, Any] | None = None,
    threads: int | None = None,
    save: Callable[[dict[str, Any]], None] = lambda record: None,
) -> dict[str, Any]:
    """The league's record of a condition.

    Args:
        wanted: Runs of each row, see :func:`entries`.
        name: Of the condition.
        chosen: The condition.
        episodes: The first so many; all where left out.
        steps: Of each episode; those of the registration where left out.
        kept: A record of this condition made before, whose other rows stay.
        threads: Of the rigs.
        save: Is handed the record after each row, so that a long evaluation may be stopped and gone on with.

    Raises:
        InputError: ``kept`` is of another condition, or a number is out of range.
    """
    available = episodes_of(chosen)
    n = len(available) if episodes is None else count("episodes", episodes, 1, len(available))
    length = STEPS[chosen.environment] if steps is None else count("steps", steps, 1, 100_000)
    head = {
        "format": FORMAT,
        "condition": name,
        "environment": chosen.environment,
        "scenario": chosen.scenario,
        "errors": chosen.errors,
        "episodes": n,
        "steps": length,
        "strata": strata(available[:n]).tolist(),
    }
    runs: dict[str, Any] = {}
    if kept is not None:
        for key, value in head.items():
            if kept.get(key) != value:
                was = shown(kept.get(key))
                raise InputError(f"the file of --json has {key} {was}, not {shown(value)}: give another file")
        runs = dict(kept["runs"])
    if YARDSTICK in wanted or YARDSTICK not in runs:
        # the first, so that the others can be compared with it
        wanted = {**entries([YARDSTICK], ()), **wanted}
    total = sum(len(each) for each in wanted.values())
    with tqdm(total=total, unit="run", mininterval=1.0, disable=None) as bar:
        for row, each in wanted.items():
            bar.set_postfix_str(row)
            made = []
            for run in each:
                made.append(run_record(run, chosen, n, length, threads))
                bar.update()
            runs[row] = made
            save(_complete(head, runs))
    return _complete(head, runs)


def _complete(head: dict[str, Any], runs: dict[str, Any]) -> dict[str, Any]:
    """The record, its rows in the order of ALL."""
    ordered = {row: runs[row] for row in ALL if row in runs}
    return {**head, "runs": ordered, "summary": summary(ordered, np.array(head["strata"]))}


def read_record(file: str | Path) -> dict[str, Any]:
    """A record that was written before.

    Raises:
        InputError: it cannot be read or is of another format.
    """
    try:
        record = json.loads(Path(file).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {shown(str(file))}: {error.strerror}; give a file of the league") from None
    except (ValueError, RecursionError):
        raise InputError(f"{shown(str(file))} is not JSON: give a file of the league, or another name") from None
    if not isinstance(record, dict) or record.get("format") != FORMAT or not isinstance(record.get("runs"), dict):
        raise InputError(f"{shown(str(file))} is not of the format {FORMAT}: give a file of the league")
    return record


def write_record(file: str | Path, record: dict[str, Any]) -> None:
    """Write a record."""
    with whole(file) as part:
        part.write_text(json.dumps(record, allow_nan=False) + "\n", encoding="utf-8")


def parser() -> Parser:
    """The options."""
    made = Parser(prog="python -m drillenv.training.evaluate", description=(__doc__ or "").split("\n")[0])
    made.add_argument("--controllers", nargs="+", default=["all"], metavar="NAME", help=f"all, or {', '.join(ALL)}")
    made.add_argument("--policies", nargs="+", default=[], metavar="DIR", help="policies of the rows learned*")
    made.add_argument("--scenario", default="test", help="a condition, a frozen set, or a file of one (default test)")
    made.add_argument("--environment", help="of a scenario that is no condition (default DrillLayers)")
    made.add_argument("--episodes", type=int, help="the first so many (default all)")
    made.add_argument("--steps", type=int, help="of each episode (default as registered)")
    made.add_argument("--threads", type=int, help="threads of the rigs (default all cores)")
    made.add_argument("--json", help="write the record to this file, after each row; other rows in it stay")
    made.add_argument("--table", help="write the table to this file, or into its place in a page")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input, 130 when interrupted."""
    try:
        given = parser().parse_args(arguments)
        chosen = condition(given.scenario, given.environment)
        wanted = entries(given.controllers, given.policies)
        threads = None if given.threads is None else count("threads", given.threads, 1, 1024)
        kept = None
        for file in (given.json, given.table):
            if file is not None:
                check_writable(file)
        if given.json is not None and Path(given.json).is_file():
            kept = read_record(given.json)

        def save(record: dict[str, Any]) -> None:
            if given.json is not None:
                write_record(given.json, record)

        record = evaluate(wanted, given.scenario, chosen, given.episodes, given.steps, kept, threads, save)
        save(record)
        if given.table is not None:
            write_table(given.table, record)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: rows that were done are in the file of --json", file=sys.stderr)
        return 130
    print(league_table(record))
    return 0


if __name__ == "__main__":
    sys.exit(main())
