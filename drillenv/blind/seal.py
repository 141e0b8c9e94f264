"""The answers of a trial, written once and sealed by their SHA-256."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drillenv.checks import InputError, shown
from drillenv.files import whole

ANSWERS, SEAL = "answers.json", "seal.json"


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def digest_of_folder(folder: Path) -> str:
    """SHA-256 over the names and contents of a folder's files, in the order of their names."""
    made = hashlib.sha256()
    for path in sorted(each for each in folder.rglob("*") if each.is_file()):
        made.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return made.hexdigest()


def _written(answers: Sequence[dict[str, Any]]) -> bytes:
    return (json.dumps(list(answers), indent=1, allow_nan=False) + "\n").encode()


def answers_digest(answers: Sequence[dict[str, Any]]) -> str:
    """The SHA-256 under which such answers would be sealed."""
    return digest(_written(answers))


def seal(folder: Path, answers: Sequence[dict[str, Any]]) -> str:
    """Write the answers into a trial's folder, readable only by its owner, and return their SHA-256."""
    data = _written(answers)
    with whole(folder / ANSWERS) as part:
        part.write_bytes(data)
    os.chmod(folder / ANSWERS, 0o400)
    found = digest(data)
    with whole(folder / SEAL) as part:
        part.write_text(json.dumps({"sha256": found}) + "\n", encoding="utf-8")
    return found


def sealed(folder: Path) -> str | None:
    """The SHA-256 under which the answers of a trial were sealed; None where they have not been."""
    path = folder / SEAL
    return json.loads(path.read_text(encoding="utf-8"))["sha256"] if path.exists() else None


def unseal(folder: Path, expected: str) -> list[dict[str, Any]]:
    """The answers of a trial.

    Raises:
        InputError: they are not those that were sealed.
    """
    path = folder / ANSWERS
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {shown(str(path))}: {error.strerror}; start the trial in a new folder") from None
    found = digest(data)
    if found != expected:
        raise InputError(
            f"{shown(str(path))} has SHA-256 {found}, but {expected} was sealed: the answers were changed after the "
            "trial began; start it in a new folder"
        )
    return json.loads(data)
