"""Run the alternatives on the campaigns of a finished trial: see :mod:`benchmarks.alternatives`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pysindy
import sklearn
from tqdm import tqdm

import drillenv
from benchmarks import alternatives
from benchmarks.alternatives.candidates import label, tried
from benchmarks.alternatives.comparing import compared
from benchmarks.alternatives.sparse import Settings
from benchmarks.alternatives.tables import table
from drillenv.blind.seal import unseal
from drillenv.blind.trial import DRILL, mark_trial
from drillenv.checks import InputError, shown
from drillenv.files import whole

FORMAT = "drillenv-alternatives/1"


def run(trial: Path, out: Path) -> dict[str, Any]:
    """All rows of a trial's campaigns; those that ``out`` holds already are kept, and it is written after each.

    Raises:
        InputError: the trial is not finished or of another rig, or ``out`` is of another trial or other settings.
    """
    if not (trial / "plan.json").exists():
        raise InputError(f"{shown(str(trial))} holds no trial: give a folder that drillenv prove made")
    marks = mark_trial(trial)
    if marks.get("rig", DRILL) != DRILL:
        raise InputError(f"the trial is of the rig {marks['rig']}: give one of the {DRILL}")
    answers = {each["campaign"]: each for each in unseal(trial, marks["answers_sha256"])}
    record = begun(out, marks)
    done = {row["campaign"] for row in record["rows"]}
    for mark in tqdm(marks["marks"], disable=None, unit="campaign"):
        name = mark["campaign"]
        if name not in done:
            seed = int(name.lstrip("c"))
            record["rows"].append(compared(trial / "campaigns" / name, mark, answers[name], seed))
            write(out, record)
    return record


def begun(out: Path, marks: Mapping[str, Any]) -> dict[str, Any]:
    """The record so far."""
    heading = {
        "format": FORMAT,
        "trial": {name: marks[name] for name in ("seed", "campaigns", "limit", "version", "answers_sha256")},
        "version": drillenv.__version__,
        "peers": {"pysindy": pysindy.__version__, "scikit-learn": sklearn.__version__},
        "settings": asdict(Settings()),
        "candidates": [label(*each) for each in tried()],
    }
    if not out.exists():
        return heading | {"rows": []}
    try:
        found = json.loads(out.read_text(encoding="utf-8"))
        rows = found.pop("rows")
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        raise InputError(f"{shown(str(out))} holds no record of alternatives: give another file") from None
    if found != heading:
        raise InputError(f"{shown(str(out))} is of another trial, version or settings: give another file")
    return heading | {"rows": rows}


def write(out: Path, record: Mapping[str, Any]) -> None:
    """The record, whole or not at all."""
    with whole(out) as part:
        part.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def main() -> None:
    """Run, and print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.alternatives",
        description=alternatives.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--trial", type=Path, required=True, help="a folder that drillenv prove made")
    parser.add_argument("--json", type=Path, required=True, help="file of the rows; a run that was stopped goes on")
    given = parser.parse_args()
    try:
        print(table(run(given.trial.resolve(), given.json)), end="")
    except InputError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
