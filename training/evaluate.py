"""The league: controllers through the same episodes, what each is worth, and how surely.

A record holds what every run did in every episode of a condition of :mod:`drillenv.training.conditions` (test, beyond,
constants, constants-3, hidden) or of any other scenario, and a summary of it. Runs that a record holds already stay in
it, unless their row is asked for again; the yardstick is run where it is missing. Tables are made of the record alone.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from drillenv import controllers
from drillenv.checks import InputError, count, shown
from drillenv.controllers import Controller
from drillenv.controllers.policies import DESCRIPTION, SHIPPED, WEIGHTS, Policy, read_policy
from drillenv.controllers.policies.stable_baselines import Unpickled
from drillenv.env.registration import HIDDEN_RIGS, KINDS, STEPS
from drillenv.env.reward import Reward
from drillenv.files import whole
from drillenv.training.conditions import Condition, episodes_of, scenario_of, strata
from drillenv.training.league import FORMAT, HIDDEN, RANDOMISED, REPEATED, YARDSTICK, summary
from drillenv.training.measures import MEASURES, measures
from drillenv.training.rollout import rollout

ALL = (*(name for name in controllers.NAMES if name != "learned"), "shipped", *REPEATED)
"""Rows of the league that this package has: the controllers by their names, the shipped policy, and the policies of
several training seeds by their algorithms."""


class Run(NamedTuple):
    """One controller, or one training seed of one."""

    make: Callable[[], Controller]
    seed: float | None = None
    """Training seed."""
    policy: str | None = None
    """SHA-256 of the weights."""
    source: str | None = None
    """What was asked for, where it is not of this package."""


def entries(names: Sequence[str], policies: Sequence[str] = (), trust_pickle: bool = False) -> dict[str, list[Run]]:
    """The runs of each row that is asked for.

    Args:
        names: Each is "all" (every row that this package and what is installed beside it can fill), a row of ALL, a
            controller as :func:`drillenv.controllers.make` takes it, the folder of a policy, or a model that
            Stable-Baselines3 saved (a file that ends in .zip). All but "all" may be given as ROW=NAME, to name the
            row; several of one row are its runs, such as training seeds.
        policies: Folders or files of policies, each a run of the row of its algorithm.
        trust_pickle: Let Stable-Baselines3 load the models among ``names``, which runs what is pickled in them.

    Raises:
        InputError: no such row, a controller that cannot be imported or made, a policy that cannot be read, or none
            for a row that needs some.
    """
    trained: dict[str, list[Run]] = {}
    for folder in policies:
        policy = read_policy(folder)
        trained.setdefault(row_of(policy), []).append(policy_run(policy, Path(folder)))
    found: dict[str, list[Run]] = {}
    for given in dict.fromkeys(names):
        if given == "all":
            for row in (*ALL, *_installed()):
                if row not in REPEATED:
                    found.setdefault(row, [_run(row)])
            found |= trained
        elif given in REPEATED or given in trained:
            if given not in trained:
                raise InputError(f"controller {given} needs trained policies: give their folders after --policies")
            found[given] = trained[given]
        else:
            row, name = named(given, ALL, REPEATED)
            found.setdefault(row, []).append(_run(name, trust_pickle))
    return found


def _installed() -> list[str]:
    """The names of the controllers that other distributions bring."""
    names = list(controllers.installed())
    for name in names:
        if name in ALL:
            raise InputError(f"an installed distribution brings a controller {name}, a row of the league: uninstall it")
    return names


def row_of(policy: Policy) -> str:
    """The row of a policy: its algorithm, by the names of drillenv train, or "learned" where it has no fit name.

    Policies that were trained on rigs that differ have rows of their own (RANDOMISED, HIDDEN): they do otherwise than
    those that have seen the rig of Table 2.1 only, on it and on others.
    """
    said = policy.provenance
    algorithm = str(said.get("algorithm", ""))
    if algorithm not in REPEATED and (algorithm in ALL or not re.fullmatch(r"[\w.+-][\w .+-]{0,39}", algorithm)):
        return "learned"
    # before measured advantages had a name of their own, only how far copies of the rigs look ahead told them
    algorithm = "ppo-vine" if algorithm == "ppo" and said.get("ahead") else algorithm
    if policy.environment == HIDDEN_RIGS:
        return algorithm + HIDDEN
    return algorithm + RANDOMISED if said.get("rig_errors") else algorithm


def named(given: str, taken: Sequence[str], free: Sequence[str] = ()) -> tuple[str, str]:
    """The row and the controller of an argument; ``taken`` are names that a row cannot have, but for the ``free``.

    Raises:
        InputError: it is neither a controller nor ROW=CONTROLLER, or the row cannot have this name.
    """
    row, equals, name = given.partition("=")
    if not equals:
        row = name = given
    elif not row.strip() or not name.strip():
        raise InputError(f"controller is {shown(given)}: give a controller, or ROW=CONTROLLER")
    elif row == "all" or (row in taken and row not in free):
        raise InputError(f"controller is {shown(given)}: {row} is a row of the league already; give it another name")
    if any(each in row for each in "|\n`<>"):
        raise InputError(f"controller is {shown(given)}: give ROW=CONTROLLER, with a name that a table can hold")
    return row, name


def _run(name: str, trust_pickle: bool = False) -> Run:
    """One run of a controller, whatever it is; made once, so that what is wrong with it is said before any work."""
    if name == "shipped":
        return policy_run(read_policy(SHIPPED), SHIPPED)
    if name in controllers.NAMES:
        if name == "learned":
            raise InputError("controller is 'learned': give shipped, or the folder of a policy")
        return Run(lambda: controllers.make(name))
    if name.lower().endswith(".zip"):
        if trust_pickle:
            model = Unpickled(name).model
            return Run(lambda: Unpickled(model), None, digest(Path(name)), name)
        return policy_run(read_policy(name), Path(name), name)
    if (Path(name) / DESCRIPTION).is_file():
        return policy_run(read_policy(name), Path(name), name)
    controllers.make(name)
    return Run(lambda: controllers.make(name), source=name)


def policy_run(policy: Policy, path: Path, source: str | None = None) -> Run:
    """A run of a policy that was read from a path."""
    seed = policy.provenance.get("seed")
    number = None if isinstance(seed, str) else seed
    return Run(lambda: controllers.make("learned", policy=policy), number, digest(path), source)


def digest(path: Path) -> str:
    """SHA-256 of the weights of a policy, or of a model."""
    return hashlib.sha256((path / WEIGHTS if path.is_dir() else path).read_bytes()).hexdigest()


def run_record(run: Run, chosen: Condition, episodes: int, steps: int, threads: int | None) -> dict[str, Any]:
    """What a run did in each episode, as JSON takes it."""
    with scenario_of(chosen) as scenario:
        made = rollout(run.make, chosen.environment, scenario, episodes, steps, threads)
    found = measures(made, Reward().rating)
    values = {
        name: [None if math.isnan(value) else value for value in found[name].astype(float).tolist()]
        for name in MEASURES
    }
    record = {"seed": run.seed, "policy": run.policy, "episodes": values}
    if run.source is not None:
        record |= {"source": run.source, "sees_truth": controllers.sees_truth(run.make())}
    return record


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
        check_head(kept, head)
        runs = dict(kept["runs"])
    if YARDSTICK in wanted or YARDSTICK not in runs:
        # the first, so that the others can be compared with it
        wanted = {**entries([YARDSTICK]), **wanted}
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


def check_head(kept: Mapping[str, Any], head: Mapping[str, Any]) -> None:
    """See that a record made before is of the same condition.

    Raises:
        InputError: it is not.
    """
    for key, value in head.items():
        if kept.get(key) != value:
            was = shown(kept.get(key))
            raise InputError(f"the file of --json has {key} {was}, not {shown(value)}: give another file")


def _complete(head: dict[str, Any], runs: dict[str, Any]) -> dict[str, Any]:
    """The record, its rows in the order of ALL, and then those that are not of this package."""
    ordered = {row: runs[row] for row in (*ALL, *runs) if row in runs}
    # the yardstick plans without the effect of a hidden rig
    compared = "score" if KINDS[head["environment"]] == "hidden" else "share"
    return {**head, "runs": ordered, "summary": summary(ordered, np.array(head["strata"]), compared)}


def read_record(file: str | Path, form: str = FORMAT, rows: str = "runs") -> dict[str, Any]:
    """A record that was written before, of a format, with a record of its rows under the key ``rows``.

    Raises:
        InputError: it cannot be read or is of another format.
    """
    try:
        record = json.loads(Path(file).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {shown(str(file))}: {error.strerror}; give a file of the league") from None
    except (ValueError, RecursionError):
        raise InputError(f"{shown(str(file))} is not JSON: give a file of the league, or another name") from None
    if not isinstance(record, dict) or record.get("format") != form or not isinstance(record.get(rows), dict):
        raise InputError(f"{shown(str(file))} is not of the format {form}: give a file of the league")
    return record


def write_record(file: str | Path, record: dict[str, Any]) -> None:
    """Write a record."""
    with whole(file) as part:
        part.write_text(json.dumps(record, allow_nan=False) + "\n", encoding="utf-8")
