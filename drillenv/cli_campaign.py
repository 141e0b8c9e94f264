"""The commands on recordings: ``drillenv campaign plan``, ``init``, ``check`` and ``plot``."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drillenv.checks import InputError, choice, shown
from drillenv.cli_options import Parser, add_commands, add_json, plain_number, print_json, whole_number
from drillenv.files import check_writable, whole
from drillenv.rig import AMPLITUDE_RANGE, FREQUENCY_RANGE, PRESSURE_RANGE

if TYPE_CHECKING:
    from drillenv.dynamics.effects import Chosen
    from drillenv.recordings import Campaign, QualityFinding
    from drillenv.recordings.describe import Description, Told
    from drillenv.rig import Rig
    from drillenv.rocks import Rock

FOUND = 1
"""Exit code of a check that found what must be left out."""


def add_campaign(parser: Parser) -> None:
    """The commands below ``drillenv campaign``."""
    line = "propose the settings to record that tell most mechanisms apart"
    plan = ("plan", _add_plan, line, "--rock 4 --settings 8")
    line = "write campaign.json for a folder of data files"
    init = ("init", _add_init, line, "CAMPAIGN --rock 4 --pressure 1.0")
    line = "look for faults of sensors, wiring, units and sample rate"
    check = ("check", _add_check, line, "CAMPAIGN")
    line = "draw every recording beside what the nominal model says of it"
    plot = ("plot", _add_plot, line, "CAMPAIGN --out recordings.html")
    add_commands(parser, "campaign_command", (plan, init, check, plot))


# --- plan


RANGES = {
    "frequency": ("HZ", FREQUENCY_RANGE),
    "amplitude": ("V", AMPLITUDE_RANGE),
    "pressure": ("BAR", PRESSURE_RANGE),
}
SHEETS = (".md", ".csv")


def _add_plan(parser: Parser) -> None:
    note = "case of Table 2.2, 1 to 6, or its name, or a rock file of an indentation test (default 4)"
    parser.add_argument("--rock", metavar="ROCK", help=note)
    note = "a model.json of a diagnosis, for constants, rock and effects that are known already"
    parser.add_argument("--model", metavar="FILE", help=note)
    note = "how many recordings, 3 to 24 (default 8)"
    parser.add_argument("--settings", type=whole_number, default=8, metavar="N", help=note)
    note = "of each recording in s, 0.1 to 10 (default: the shortest that does)"
    parser.add_argument("--seconds", type=plain_number, metavar="S", help=note)
    note = "samples a second (default 25600)"
    parser.add_argument("--sample-rate", type=plain_number, default=25600.0, metavar="HZ", help=note)
    note = "standard deviations of the noise of force and acceleration (default 5 N and 2.5 m/s^2)"
    parser.add_argument("--noise", type=plain_number, nargs=2, metavar=("N", "M/S^2"), help=note)
    group = parser.add_argument_group("ranges", "What the lab can set, from the lowest to the highest.")
    for name, (unit, span) in RANGES.items():
        note = f"{name} in {unit.replace('HZ', 'Hz').replace('BAR', 'bar')} (default {span[0]:g} {span[1]:g})"
        group.add_argument(f"--{name}", type=plain_number, nargs=2, metavar=("LOW", "HIGH"), help=note)
    parser.add_argument("--out", metavar="SHEET.md", help="write the sheet: .md, or .csv for the recordings alone")
    add_json(parser)
    parser.set_defaults(run=_plan)


def _plan(given: argparse.Namespace) -> None:
    if given.out is not None:
        choice("the ending of --out", Path(given.out).suffix.lower(), SHEETS)
        check_writable(given.out)
    from drillenv.planning.plan import plan_campaign
    from drillenv.recordings.made import NOISE

    rock, rig, effects = _planned_rig(given)
    box = [getattr(given, name) or span for name, (_unit, span) in RANGES.items()]
    noise = NOISE if given.noise is None else NOISE._replace(force=given.noise[0], acceleration=given.noise[1])
    plan = plan_campaign(
        rock, rig, effects, given.settings, given.seconds, given.sample_rate, box, noise=noise, note=_watched()
    )
    if given.out is not None:
        with whole(given.out) as part:
            part.write_text(plan.csv() if given.out.lower().endswith(".csv") else plan.text(), encoding="utf-8")
    if given.json:
        print_json(plan.record())
    else:
        print(plan.text() if given.out is None else f"wrote {given.out}", end="" if given.out is None else "\n")


def _planned_rig(given: argparse.Namespace) -> tuple[Rock, Rig | None, tuple[Chosen, ...]]:
    """Rock, rig and effects, of the options or of a model."""
    from drillenv.corrected import read_model
    from drillenv.rocks import rock

    if given.model is None:
        return rock(given.rock or "4"), None, ()
    model = read_model(given.model)
    if model.rock is not None and given.rock is not None:
        raise InputError("--rock and --model both say which rock: leave one out")
    return model.rock or rock(given.rock or "4"), model.rig, model.on_motion


def _watched() -> Callable[[str], object] | None:
    """Tells what is being done where somebody watches."""
    watched = sys.stderr is not None and sys.stderr.isatty()
    return (lambda text: print(text, file=sys.stderr, flush=True)) if watched else None


# --- init


PER_FILE = {
    "frequency": ("HZ", "excitation frequency in Hz; by default the tone of the excitation"),
    "amplitude": ("V", "excitation voltage amplitude in V; by default that of the excitation"),
    "pressure": ("BAR", "pneumatic pressure in bar; by default that of a channel, or of the name of the file"),
    "sample-rate": ("HZ", "samples a second; by default what the file says"),
}
CONSTANTS = {
    "shaker-mass": "m1 in kg",
    "indenter-mass": "m2 in kg",
    "stiffness": "k in N/m",
    "damping": "c in N s/m",
    "drive-gain": "factor on Eq. 3.5",
    "pressure-gain": "factor on Eq. 3.6",
    "loading-stiffness": "k_l of the rock in N/m, in place of --rock",
    "unloading-stiffness": "k_u of the rock in N/m, in place of --rock",
    "mass": "of one body, in kg",
    "coulomb": "dry friction of one body in N",
    "offset": "constant force on one body in N",
}


def _add_init(parser: Parser) -> None:
    parser.add_argument("folder", metavar="FOLDER", help="folder of .csv, .mat, .h5, .tdms and .lvm files")
    note = "percussive-drill (default), or one-body"
    parser.add_argument("--rig", default="percussive-drill", metavar="{percussive-drill,one-body}", help=note)
    parser.add_argument("--rock", metavar="ROCK", help="case of Table 2.2, its name, or a file of drillenv indentation")
    parser.add_argument("--title", metavar="TEXT", help="by default the name of the folder")
    group = parser.add_argument_group("recordings", "Each for all files, or as NAME=VALUE for one; repeatable.")
    for name, (metavar, note) in PER_FILE.items():
        group.add_argument(f"--{name}", action="append", default=[], metavar=f"[NAME=]{metavar}", help=note)
    note = "running, for at least a second before (default), or fresh, from rest on rock never hit"
    group.add_argument("--starts", action="append", default=[], metavar="[NAME=]HOW", help=note)
    note = "the column of a channel, such as force=ai1 or force=ai1:kN, where names and units do not tell"
    group.add_argument("--channel", action="append", default=[], metavar="CHANNEL=COLUMN[:UNIT]", help=note)
    group = parser.add_argument_group(
        "constants", "What you believe, as VALUE or VALUE+-STD; by default the paper's rig. One body: or estimate."
    )
    for name, note in CONSTANTS.items():
        group.add_argument(f"--{name}", metavar="X[+-STD]", help=note)
    parser.add_argument("--force", action="store_true", help="write campaign.json anew where there is one")
    add_json(parser)
    parser.set_defaults(run=_init, compiles=False)


def _init(given: argparse.Namespace) -> None:
    from drillenv.recordings.describe import describe, refuse_to_overwrite

    told = _told(given)
    refuse_to_overwrite(given.folder, given.force)
    description = describe(given.folder, told, _ask if sys.stdin is not None and sys.stdin.isatty() else None)
    path = description.write(given.folder, given.force)
    if given.json:
        print_json(_init_record(description))
        return
    _print_table(description)
    print(f"wrote {path}; next: drillenv campaign check {given.folder}")


def _ask(question: str) -> str:
    """Ask at the terminal; on stderr, since stdout may be kept."""
    sys.stderr.write(question)
    sys.stderr.flush()
    return sys.stdin.readline()


def _told(given: argparse.Namespace) -> Told:
    from drillenv.recordings.describe import Told

    per_file = {
        name.replace("-", "_"): _per_file(f"--{name}", getattr(given, name.replace("-", "_")), _value)
        for name in PER_FILE
    }
    constants = {}
    for name in CONSTANTS:
        text = getattr(given, name.replace("-", "_"))
        if text is not None:
            constants[name.replace("-", "_")] = _constant(f"--{name}", text)
    return Told(
        rig=given.rig,
        title=given.title,
        rock=given.rock,
        constants=constants,
        **per_file,
        starts=_per_file("--starts", given.starts, lambda option, text: text),
        channels=dict(_channel(text) for text in given.channel),
    )


def _per_file(option: str, given: Sequence[str], read: Callable[[str, str], Any]) -> dict[str | None, Any]:
    """Values by the file that they are for; None for all."""
    found: dict[str | None, Any] = {}
    for text in given:
        name, equals, value = text.rpartition("=")
        if equals and not name.strip():
            raise InputError(f"{option} is {shown(text)}: give VALUE, or NAME=VALUE for one file")
        found[name.strip() if equals else None] = read(option, value)
    return found


def _value(option: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{option} is {shown(text)}: give a number such as 1.2, or NAME=1.2 for one file")
    return value


def _constant(option: str, text: str) -> tuple[float | None, float | None]:
    from drillenv.recordings.describe import ESTIMATE

    if text == ESTIMATE:
        return None, None
    value, sign, std = text.partition("+-")
    return _value(option, value), _value(option, std) if sign else None


def _channel(text: str) -> tuple[str, list[str]]:
    name, equals, rest = text.partition("=")
    if not equals or not name or not rest:
        raise InputError(f"--channel is {shown(text)}: give CHANNEL=COLUMN, such as force=ai1 or force=ai1:kN")
    column, colon, unit = rest.rpartition(":")
    return name, [column, unit] if colon else [rest]


def _init_record(description: Description) -> dict[str, Any]:
    return {
        "campaign": description.document,
        "from": {row.entry["name"]: dict(row.sources) for row in description.rows},
        "guessed": {row.entry["name"]: list(row.guessed) for row in description.rows if row.guessed},
        "assumed": list(description.remarks),
        "left_out": [{"file": file, "why": why} for file, why in description.left_out],
    }


def _print_table(description: Description) -> None:
    """What was found of each recording, what was guessed, and from what."""
    head = ["file", "rate Hz", "channels", "f Hz", "A V", "p bar", "starts"]
    lines = [head if "setting" in description.rows[0].entry else head[:3]]
    for row in description.rows:
        entry = row.entry
        channels = ", ".join(f"{name} {each['column']} {each['unit']}" for name, each in entry["channels"].items())
        cells = [row.file, f"{entry['sample_rate']:g}", channels]
        if "setting" in entry:
            cells += [f"{value:g}" for value in entry["setting"].values()] + [entry["starts"]]
        lines.append(cells)
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for cells in lines:
        print("  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip())
    by_source: dict[tuple[str, str, bool], list[str]] = {}
    for row in description.rows:
        for name, source in row.sources.items():
            by_source.setdefault((name, source, name in row.guessed), []).append(row.entry["name"])
    for guessed in (False, True):
        for (name, source, is_guess), recordings in by_source.items():
            if is_guess == guessed:
                which = "all" if len(recordings) == len(description.rows) else ", ".join(recordings)
                print(f"{'guessed' if guessed else 'found'}: {name} from {source} ({which})")
    for remark in description.remarks:
        print(f"assumed: {remark}")
    for file, why in description.left_out:
        print(f"left out: {file}: {why}")


# --- check


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


# --- plot


def _add_plot(parser: Parser) -> None:
    parser.add_argument("folder", metavar="FOLDER", help="folder that holds campaign.json")
    parser.add_argument("--out", required=True, metavar="FILE.html", help="where the pictures go: .html or .png")
    parser.set_defaults(run=_plot)


def _plot(given: argparse.Namespace) -> None:
    from drillenv.recordings import check_quality, read_campaign
    from drillenv.recordings.plot import ENDINGS, plot_campaign

    choice("the ending of --out", Path(given.out).suffix.lower(), ENDINGS)
    check_writable(given.out)
    campaign = read_campaign(given.folder)
    plot_campaign(campaign, given.out, check_quality(campaign), _watched())
    print(f"wrote {given.out}")
