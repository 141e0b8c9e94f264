"""The league on holes: controllers through the same frozen holes, what a metre costs with each, and how surely.

A record holds what each row did in every hole, in the mean over its runs and over the noise on the readings, as
:mod:`drillenv.training.hole_headroom` measures it, and a summary. Rows that a record holds already stay in it, unless
they are asked for again; the oracle is run where it is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from drillenv import controllers
from drillenv.checks import InputError, count, shown
from drillenv.controllers import Controller
from drillenv.controllers.hole.certainty_equivalent import HolePlanner
from drillenv.controllers.hole.learned import DESCRIPTION, HoleLearned, read_policy
from drillenv.controllers.hole.oracle import Greedy, HoleOracle
from drillenv.controllers.hole.rules import HoleFixed, HoleRules
from drillenv.controllers.policies.stable_baselines import read_model
from drillenv.env.registration import HOLE_IDS, HOLE_STEPS
from drillenv.env.scenarios import read_scenario
from drillenv.training.evaluate import Run, check_head, digest, named, policy_run
from drillenv.training.hole_headroom import ORACLE, RandomHole, row_of, summary, table

FORMAT = "drillenv-hole-league/1"
ENVIRONMENT = "DrillBit"
ROWS: Mapping[str, Callable[[], Controller]] = MappingProxyType(
    {
        "random": RandomHole,
        "fixed": HoleFixed,
        "rules": HoleRules,
        "planner": HolePlanner,
        "greedy": Greedy,
        ORACLE: HoleOracle,
    }
)
"""The rows that this package has. ``greedy`` and the oracle know the hole."""
LEARNED = "ppo"
"""The row of policies: all that drillenv train makes on holes."""


def entries(names: Sequence[str], policies: Sequence[str] = ()) -> dict[str, list[Run]]:
    """The runs of each row that is asked for.

    Args:
        names: Each is "all" (ROWS, and LEARNED where there are policies), a row of ROWS, the folder of a policy, or a
            controller from elsewhere as :func:`drillenv.controllers.make` takes it, or a model that Stable-Baselines3
            saved (a file that ends in .zip). All but "all" may be given as ROW=NAME, to name the row; several of one
            row are its runs, such as training seeds.
        policies: Folders of policies, each a run of the row LEARNED.

    Raises:
        InputError: no such row, a controller that cannot be imported or made or drills no hole, a policy that cannot be
            read, or none for the row LEARNED.
    """
    trained = {LEARNED: [_policy_run(folder) for folder in policies]} if policies else {}
    found: dict[str, list[Run]] = {}
    for given in dict.fromkeys(names):
        if given == "all":
            found |= {row: [Run(make)] for row, make in ROWS.items()} | trained
        elif given == LEARNED:
            if not trained:
                raise InputError(f"controller {given} needs trained policies: give their folders after --policies")
            found |= trained
        else:
            row, name = named(given, tuple(ROWS))
            found.setdefault(row, []).append(_run(name))
    return found


def _run(name: str) -> Run:
    """One run of a controller; made once, so that what is wrong with it is said before any work."""
    if name in ROWS:
        return Run(ROWS[name])
    if (Path(name) / DESCRIPTION).is_file():
        return _policy_run(name)
    if name.lower().endswith(".zip"):
        return policy_run(read_model(name, HOLE_IDS[0]), Path(name), name)
    if name in controllers.NAMES:
        known = ", ".join(ROWS)
        raise InputError(
            f"controller is {shown(name)}, which drills no hole: give one of {known}, a policy's folder or a model "
            "that was trained on DrillBit, or package.module:Class"
        )
    controllers.make(name)
    return Run(lambda: controllers.make(name), source=name)


def _policy_run(folder: str) -> Run:
    policy = read_policy(folder)
    seed = policy.provenance.get("seed")
    return Run(lambda: HoleLearned(policy), seed, digest(Path(folder)), folder)


def evaluate(
    wanted: Mapping[str, list[Run]],
    scenario: str = "test",
    episodes: int | None = None,
    steps: int | None = None,
    kept: Mapping[str, Any] | None = None,
    save: Callable[[dict[str, Any]], None] = lambda record: None,
) -> dict[str, Any]:
    """The league's record of a frozen set of holes.

    Args:
        wanted: Runs of each row, see :func:`entries`.
        scenario: A frozen set of holes, or a file of one.
        episodes: The first so many; all where left out.
        steps: After which a hole is left as it is, of 15 s of drilling each; those of the registration where left out.
        kept: A record of the same holes made before, whose other rows stay.
        save: Is handed the record after each row.

    Raises:
        InputError: no such scenario, ``kept`` is of other holes, a number is out of range, or an action is none.
    """
    available = len(read_scenario(scenario, "hole").episodes["hole"])
    n = available if episodes is None else count("episodes", episodes, 1, available)
    length = HOLE_STEPS[ENVIRONMENT] if steps is None else count("steps", steps, 1, 100_000)
    head = {"format": FORMAT, "environment": ENVIRONMENT, "scenario": scenario, "episodes": n, "steps": length}
    rows: dict[str, Any] = {}
    about: dict[str, Any] = {}
    if kept is not None:
        check_head(kept, head)
        rows, about = dict(kept["rows"]), dict(kept["about"])
    if ORACLE in wanted or ORACLE not in rows:
        # the first, so that the others can be compared with it
        wanted = {ORACLE: [Run(ROWS[ORACLE])], **wanted}
    for row, runs in wanted.items():
        alike = [run.make() for run in runs]
        about[row] = [_said(run, each) for run, each in zip(runs, alike, strict=True)]
        rows[row] = row_of(alike, scenario, n, length)
        save(_complete(head, rows, about))
    return _complete(head, rows, about)


def _said(run: Run, made: Controller) -> dict[str, Any]:
    """Where a run comes from, as JSON takes it."""
    sees = controllers.sees_truth(made)
    return {"seed": run.seed, "policy": run.policy, "source": run.source, "sees_truth": sees}


def _complete(head: Mapping[str, Any], rows: Mapping[str, Any], about: Mapping[str, Any]) -> dict[str, Any]:
    """The record, its rows in the order of ROWS, and then those that are not of this package."""
    ordered = {row: rows[row] for row in (*ROWS, *rows) if row in rows}
    record = {**head, "rows": ordered, "about": {row: about[row] for row in ordered}}
    return {**record, "summary": summary(record)}


def league_table(record: Mapping[str, Any]) -> str:
    """The rows, the cheapest first, as a Markdown table."""
    labels = {}
    for row, runs in record["about"].items():
        seeds = f" ({len(runs)} seeds)" if len(runs) > 1 else ""
        sees = " (sees the hole)" if row not in ROWS and runs[0]["sees_truth"] else ""
        labels[row] = f"{row}{seeds}{sees}"
    return table(dict(record), labels)


def page_part(record: Mapping[str, Any]) -> str:
    """Everything that a page says of a record."""
    return f"{record['episodes']} holes of {record['scenario']}.\n\n{league_table(record)}"
