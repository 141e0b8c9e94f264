"""The commands on recordings: ``drillenv campaign check``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from drillenv.cli_options import Parser, add_json, print_json

if TYPE_CHECKING:
    from drillenv.recordings import Campaign, QualityFinding

FOUND = 1
"""Exit code of a check that found what must be left out."""


def add_campaign(parser: Parser) -> None:
    """The commands below ``drillenv campaign``."""
    commands = parser.add_subparsers(metavar="COMMAND", required=True, dest="campaign_command")
    for name, add, line in (("check", _add_check, "look for faults of sensors, wiring, units and sample rate"),):
        command = commands.add_parser(name, help=line, description=f"{line[0].upper()}{line[1:]}.", allow_abbrev=False)
        add(command)


def _add_check(parser: Parser) -> None:
    parser.add_argument("folder", metavar="FOLDER", help="folder that holds campaign.json")
    add_json(parser)
    parser.set_defaults(run=_check, compiles=False)


def _check(given: argparse.Namespace) -> int:
    from drillenv.recordings import check_quality, read_campaign

    campaign = read_campaign(given.folder)
    findings = check_quality(campaign)
    left_out = [each for each in findings if each.severity != "note"]
    if given.json:
        print_json(_check_record(campaign, findings))
    else:
        for each in findings:
            print(f"quality: {each}")
        print(_check_summary(campaign, findings))
    return FOUND if left_out else 0


def _check_record(campaign: Campaign, findings: tuple[QualityFinding, ...]) -> dict[str, Any]:
    names = ("recording", "channel", "kind", "severity", "start", "stop", "spans", "sentence")
    return {
        "title": campaign.title,
        "rig": campaign.rig,
        "recordings": [
            {
                "name": each.name,
                "file": each.file,
                "seconds": each.seconds,
                "sample_rate": each.sample_rate,
                "channels": list(each.channels),
            }
            for each in campaign.recordings
        ],
        "sound": all(each.severity == "note" for each in findings),
        "findings": [{name: getattr(each, name) for name in names} for each in findings],
    }


def _check_summary(campaign: Campaign, findings: tuple[QualityFinding, ...]) -> str:
    """How many recordings are whole, and how many are not."""
    total = len(campaign.recordings)
    out = {each.recording for each in findings if each.severity in ("exclude recording", "exclude channel")}
    cut = {each.recording for each in findings if each.severity == "exclude stretch"} - out
    recordings = "1 recording" if total == 1 else f"{total} recordings"
    parts = [f"{len(out)} with a channel or all of it to leave out"] if out else []
    parts += [f"{len(cut)} with stretches to leave out"] if cut else []
    return f"{recordings}: {', '.join(parts) or 'nothing to leave out'}"
