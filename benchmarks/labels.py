"""How often a wrong label of one recording is found by its samples, and how often one is found that is right.

    python -m benchmarks.labels --seed 20261904 --campaigns 120 --json labels.json

Campaigns are those of the blind trial: a concealed rig with what it conceals, recorded as labs do. Each is looked at
as it is, and with the label of one recording changed: its pressure by a tenth to a half, its amplitude likewise, or
"fresh" on one that was running. No diagnosis is run: it is the look at labels that comes before one.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from drillenv.blind.campaigns import make_campaign, plan
from drillenv.diagnosis.bookkeeping import with_labels_corrected
from drillenv.files import whole
from drillenv.recordings import Campaign

FIELDS = ("pressure", "amplitude", "starts")
CHANGES = (0.1, 0.5)
"""Least and largest change of a pressure or an amplitude, as a share."""


def with_wrong_label(campaign: Campaign, field: str, rng: np.random.Generator) -> tuple[Campaign, str, float]:
    """The campaign with one label changed, the recording, and the change as a share (1 for starts)."""
    recordings = list(campaign.recordings)
    if field == "starts":
        i = int(rng.choice([j for j, each in enumerate(recordings) if each.starts != "fresh"]))
        recordings[i] = replace(recordings[i], starts="fresh")
        return replace(campaign, recordings=tuple(recordings)), recordings[i].name, 1.0
    i = int(rng.integers(len(recordings)))
    setting = recordings[i].setting
    assert setting is not None
    share = float(rng.uniform(*CHANGES)) * (1.0 if rng.random() < 0.5 else -1.0)
    recordings[i] = replace(recordings[i], setting=replace(setting, **{field: getattr(setting, field) * (1.0 + share)}))
    return replace(campaign, recordings=tuple(recordings)), recordings[i].name, share


def looked_at(seed: int, campaigns: int) -> list[dict[str, Any]]:
    """A row for each campaign: what is found as it is, and with the label of one recording changed."""
    rows = []
    for index, planned in enumerate(tqdm(plan(seed, campaigns), disable=None)):
        campaign = make_campaign(seed, index, planned).campaign
        rng = np.random.default_rng((seed, index, 7))
        field = FIELDS[index % len(FIELDS)]
        wrong, name, share = with_wrong_label(campaign, field, rng)
        as_it_is = [asdict(label) for label in with_labels_corrected(campaign)[1]]
        found = [asdict(label) for label in with_labels_corrected(wrong)[1]]
        rows.append(
            {
                "index": index,
                "group": planned.group,
                "field": field,
                "recording": name,
                "share": share,
                "found": any(each["recording"] == name and each["field"] == field for each in found),
                "others": [each for each in found if each["recording"] != name],
                "as_it_is": as_it_is,
            }
        )
    return rows


def main() -> None:
    """Look, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=20261904)
    parser.add_argument("--campaigns", type=int, default=120)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    given = parser.parse_args()
    rows = looked_at(given.seed, given.campaigns)
    if given.json is not None:
        with whole(given.json) as part:
            part.write_text(json.dumps({"seed": given.seed, "rows": rows}, indent=1) + "\n", encoding="utf-8")
    tried, found = Counter(row["field"] for row in rows), Counter(row["field"] for row in rows if row["found"])
    for field in FIELDS:
        print(f"{field}: {found[field]} of {tried[field]} wrong labels found")
    print(f"a label doubted where all are right: {sum(bool(row['as_it_is']) for row in rows)} of {len(rows)} campaigns")
    print(f"another label doubted beside the wrong one: {sum(bool(row['others']) for row in rows)}")


if __name__ == "__main__":
    main()
