"""The rock file: a measured rock, as an indentation test gives it and every --rock takes it.

    {
      "format": "drillenv-rock/1",
      "name": "granite-indenter45",
      "loading_stiffness": 21.4e6, "loading_stiffness_std": 0.2e6, "loading_spread": 0.5e6,
      "unloading_stiffness": 25.0e6, "unloading_stiffness_std": 0.3e6, "unloading_spread": 0.9e6,
      "loading_exponent": 1.02, "loading_exponent_std": 0.01,
      "unloading_exponent": 1.05, "unloading_exponent_std": 0.01,
      "indentations": {"loading": [5.4e6, 21.3e6], "unloading": [21.6e6, 25.1e6], "early": 1,
                       "loading_factors": [0.25], "unloading_factors": [0.86]},
      "source": {"file": "granite.csv", "sha256": "9f86..."}
    }

Stiffnesses are in N/m. Those named _std are errors of the means, the spreads the standard deviation from one
indentation to another, which ``Rock.drawn`` draws from. ``early`` counts the indentations before the stable ones, and
the factors are theirs. Format and both stiffnesses are needed, the rest may be left out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drillenv.checks import InputError, count, number, shown
from drillenv.files import read_record, whole
from drillenv.rocks import STIFFNESS_LIMITS, Indentations, Rock

if TYPE_CHECKING:
    from drillenv.indentation.branches import Estimate

FORMAT = "drillenv-rock/1"
LARGEST_FILE = 1_000_000
"""Bytes; a rock file has a thousand."""
MEANS = ("loading_stiffness", "unloading_stiffness", "loading_exponent", "unloading_exponent")
_NEEDED = ("loading_stiffness", "unloading_stiffness")
_KEYS = (
    "format",
    "name",
    *(key for mean in MEANS for key in (mean, f"{mean}_std")),
    "loading_spread",
    "unloading_spread",
    "indentations",
    "source",
)
_INDENTATION_KEYS = ("loading", "unloading", "early", "loading_factors", "unloading_factors")
MOST_INDENTATIONS = 10_000


def read_rock(path: str | Path) -> Rock:
    """Read a rock file.

    Raises:
        InputError: no such file, not JSON, or not what the head of this module describes.
    """
    if not isinstance(path, str | Path) or not str(path).strip() or "\0" in str(path):
        raise InputError(f"rock file is {shown(path)}: give the path of a rock file")
    return read_record(path, "rock", FORMAT, LARGEST_FILE, rock_from_record)


def rock_from_record(record: object) -> Rock:
    """The rock of a parsed rock file.

    Raises:
        InputError: not what the head of this module describes.
    """
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        given = shown(record.get("format")) if isinstance(record, dict) else shown(record)
        raise InputError(f"format is {given}: give a record whose format is {FORMAT!r}")
    for key in record:
        if key not in _KEYS:
            raise InputError(f"unknown key {shown(key)}: a rock file has {', '.join(_KEYS)}")
    for key in _NEEDED:
        if key not in record:
            raise InputError(f"{key} is missing: give both stiffnesses in N/m")
    for key in _KEYS:
        if key in record and (key.endswith("_std") or key.endswith("_exponent")):
            number(key, record[key], 0.0, 1e9)
    return Rock(
        record["loading_stiffness"],
        record["unloading_stiffness"],
        record.get("name", "measured"),
        record.get("loading_spread", 0.0),
        record.get("unloading_spread", 0.0),
        indentations=_indentations(record["indentations"]) if "indentations" in record else None,
    )


def _indentations(record: object) -> Indentations:
    if not isinstance(record, dict) or not {"loading", "unloading", "early"} <= set(record) <= set(_INDENTATION_KEYS):
        raise InputError(f"indentations is {shown(record)}: give a record with {', '.join(_INDENTATION_KEYS)}")
    sides = []
    for key in ("loading", "unloading"):
        values = record[key]
        if not isinstance(values, list) or not 1 <= len(values) <= MOST_INDENTATIONS:
            raise InputError(f"{key} of indentations is {shown(values)}: give a list of stiffnesses in N/m")
        sides.append(tuple(number(f"{key} of indentations", each, *STIFFNESS_LIMITS, "N/m") for each in values))
    if len(sides[0]) != len(sides[1]):
        raise InputError(
            f"indentations has {len(sides[0])} stiffnesses of loading and {len(sides[1])} of unloading: "
            "give both of each indentation"
        )
    return Indentations(sides[0], sides[1], count("early of indentations", record["early"], 0, len(sides[0])))


def rock_record(rock: Rock, means: Mapping[str, Estimate], file: str, sha256: str) -> dict[str, Any]:
    """What :func:`rock_from_record` reads back.

    Args:
        rock: The rock.
        means: By the names of ``MEANS``, with their standard deviations.
        file, sha256: Name and hash of the curve behind it.
    """
    record: dict[str, Any] = {"format": FORMAT, "name": rock.name}
    for name in MEANS:
        record |= {name: means[name].value, f"{name}_std": means[name].std}
    record |= {"loading_spread": rock.loading_spread, "unloading_spread": rock.unloading_spread}
    if rock.indentations is not None:
        each = rock.indentations
        record["indentations"] = {
            "loading": list(each.loading),
            "unloading": list(each.unloading),
            "early": each.early,
            "loading_factors": [value / rock.loading_stiffness for value in each.loading[: each.early]],
            "unloading_factors": [value / rock.unloading_stiffness for value in each.unloading[: each.early]],
        }
    return record | {"source": {"file": file, "sha256": sha256}}


def write_rock(path: str | Path, rock: Rock, means: Mapping[str, Estimate], file: str, sha256: str) -> None:
    """Write a rock file, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    with whole(path) as part:
        text = json.dumps(rock_record(rock, means, file, sha256), indent=2, allow_nan=False)
        part.write_text(text + "\n", encoding="utf-8")
