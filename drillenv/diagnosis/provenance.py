"""Where a report comes from: the tool with its version, and the files that were read with their hashes."""

from __future__ import annotations

import hashlib
from typing import Any

import drillenv
from drillenv.recordings import Campaign
from drillenv.recordings.document import DOCUMENT

FORMAT = "drillenv-report/1"


def provenance(campaign: Campaign) -> dict[str, Any]:
    """``format``, ``tool`` and ``inputs`` of a report: SHA-256 by file of the campaign's folder.

    A campaign that was not read from files has no inputs.
    """
    names = [DOCUMENT, *dict.fromkeys(each.file for each in campaign.recordings)]
    inputs = {}
    for name in names:
        file = campaign.folder / name
        if file.is_file():
            with file.open("rb") as stream:
                inputs[name] = hashlib.file_digest(stream, "sha256").hexdigest()
    return {"format": FORMAT, "tool": {"name": "drillenv", "version": drillenv.__version__}, "inputs": inputs}
