"""Frozen sets of episodes, so that everybody drills the same rock: train, validation, test and beyond.

    {"format": "drillenv-scenario/1", "name": "test", "version": 1,
     "episodes": {"rock": [...], "layers": [...], "hidden": [...]}}

An episode is what :func:`drillenv.env.episodes.read_episode` reads; those of the kind "hole", in files of their own,
are what :func:`drillenv.env.hole.episodes.read_hole` reads. ``python -m drillenv.env.scenarios`` draws them
anew, each set from a seed of its own; a set that has been published is never changed, a new version is added instead.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from drillenv.checks import InputError, shown
from drillenv.env.episodes import read_episode
from drillenv.env.hole.episodes import read_hole

FORMAT = "drillenv-scenario/1"
SETS = ("train", "validation", "test", "beyond")
LARGEST_FILE = 100_000_000
KINDS = ("rock", "layers", "hidden")
"""The kinds of a frozen set; the kind "hole" has sets of its own."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A named set of episodes, by the kind of task."""

    name: str
    version: int
    episodes: Mapping[str, tuple[Any, ...]]
    """An Episode each, or a Hole of the kind "hole"."""


def read_scenario(which: str | Path, kind: str | None = None) -> Scenario:
    """A frozen set by its name, or one of one's own from a file.

    Args:
        which: The name or the file.
        kind: Of the episodes that are needed; left out, any but holes.

    Raises:
        InputError: no such set or file, its content is not what the head of this module describes, or it has no
            episodes of the kind.
    """
    scenario = _scenario(which, "-hole" if kind == "hole" else "")
    if kind is not None and not scenario.episodes[kind]:
        raise InputError(f"scenario {shown(str(which))} has no episodes of the kind {kind}: take another")
    return scenario


def _scenario(which: str | Path, suffix: str) -> Scenario:
    if not isinstance(which, str | Path):
        raise InputError(f"scenario is {shown(which)}: give one of {', '.join(SETS)}, or the path of a file")
    if str(which) in SETS and (not suffix or str(which) != "beyond"):
        return _frozen(f"{which}{suffix}")
    file = Path(which)
    if not file.is_file():
        raise InputError(f"scenario is {shown(str(which))}: give one of {', '.join(SETS)}, or the path of a file")
    return _read(file)


@cache
def _frozen(name: str) -> Scenario:
    return _read(Path(__file__).parent / f"{name}.json")


def _read(file: Path) -> Scenario:
    """Read and check a file."""
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise InputError(f"scenario {file} is larger than {LARGEST_FILE} bytes: give a set of episodes")
        record = json.loads(file.read_text(encoding="utf-8"))
    except InputError:
        raise  # a ValueError too
    except OSError as error:
        raise InputError(f"scenario {file} cannot be read ({error.strerror}): give a readable file") from None
    except (ValueError, RecursionError):
        raise InputError(f"scenario {file} is not JSON: give a file of the format {FORMAT}") from None
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"scenario {file} is not of the format {FORMAT}: give a file that is")
    if set(record) != {"format", "name", "version", "episodes"} or not isinstance(record["episodes"], dict):
        raise InputError(f"scenario {file} has the keys {shown(sorted(record))}: give format, name, version, episodes")
    if not isinstance(record["name"], str) or type(record["version"]) is not int:
        raise InputError(f"scenario {file}: name is a text and version a whole number, give them so")
    episodes: dict[str, tuple[Any, ...]] = {}
    for kind, records in record["episodes"].items():
        if kind not in (*KINDS, "hole") or not isinstance(records, list):
            raise InputError(f"scenario {file} has the kind {shown(kind)}: give lists for {', '.join(KINDS)} or hole")
        read = read_hole if kind == "hole" else read_episode
        episodes[kind] = tuple(read(each, f"scenario {file.name}, {kind} {i}") for i, each in enumerate(records))
    return Scenario(record["name"], record["version"], {kind: episodes.get(kind, ()) for kind in (*KINDS, "hole")})
