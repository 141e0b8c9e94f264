"""Frozen sets of episodes, so that everybody drills the same rock: train, validation, test and beyond.

    {"format": "drillenv-scenario/1", "name": "test", "version": 1,
     "episodes": {"rock": [...], "layers": [...], "hidden": [...]}}

An episode is what :func:`drillenv.env.episodes.read_episode` reads. ``python -m drillenv.env.scenarios`` draws them
anew, each set from a seed of its own; a set that has been published is never changed, a new version is added instead.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from drillenv.checks import InputError, shown
from drillenv.env.episodes import Episode, read_episode

FORMAT = "drillenv-scenario/1"
SETS = ("train", "validation", "test", "beyond")
LARGEST_FILE = 100_000_000
KINDS = ("rock", "layers", "hidden")


@dataclass(frozen=True, slots=True)
class Scenario:
    """A named set of episodes, by the kind of task."""

    name: str
    version: int
    episodes: Mapping[str, tuple[Episode, ...]]


def read_scenario(which: str | Path) -> Scenario:
    """A frozen set by its name, or one of one's own from a file.

    Raises:
        InputError: no such set or file, or its content is not what the head of this module describes.
    """
    if not isinstance(which, str | Path):
        raise InputError(f"scenario is {shown(which)}: give one of {', '.join(SETS)}, or the path of a file")
    if str(which) in SETS:
        return _frozen(str(which))
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
    episodes: dict[str, tuple[Episode, ...]] = {}
    for kind, records in record["episodes"].items():
        if kind not in KINDS or not isinstance(records, list):
            raise InputError(f"scenario {file} has the kind {shown(kind)}: give lists for {', '.join(KINDS)}")
        episodes[kind] = tuple(
            read_episode(each, f"scenario {file.name}, {kind} {i}") for i, each in enumerate(records)
        )
    return Scenario(record["name"], record["version"], {kind: episodes.get(kind, ()) for kind in KINDS})
