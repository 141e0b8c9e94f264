"""Writing campaign.json for a folder of data files: what they say, what is guessed, and what must be told."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.checks import InputError, choice, shown
from drillenv.files import whole
from drillenv.recordings.contents import Contents, contents_of
from drillenv.recordings.document import (
    BODY_CHANNELS,
    BODY_CONSTANTS,
    DOCUMENT,
    DRILL,
    FILE_ENDINGS,
    FORMAT,
    LONGEST_NAME,
    ONE_BODY,
    parse_document,
)
from drillenv.recordings.roles import Role, find_roles, settled_units
from drillenv.recordings.tone_setting import drive_of, neat_number
from drillenv.recordings.units import CHANNEL_UNITS
from drillenv.rig import TOLERANCES, Rig
from drillenv.rocks import ROCKS, Rock, rock

MOST_QUESTIONS = 2
NEEDED: dict[str, tuple[str, ...]] = {DRILL: ("force", "acceleration"), ONE_BODY: ("position",)}
"""Channels without which a file is of no use, by rig."""
RIG_STD, ROCK_STD, BODY_STD = 0.03, 0.05, 0.01
"""Standard deviations, as a share, of a constant that is not the paper's and comes without one."""
SI_UNITS = {"shaker_mass": "kg", "indenter_mass": "kg", "stiffness": "N/m", "damping": "N*s/m", "drive_gain": "1"} | {
    "pressure_gain": "1",
    "loading_stiffness": "N/m",
    "unloading_stiffness": "N/m",
    "mass": "kg",
    "coulomb": "N",
    "offset": "N",
}
ESTIMATE = "estimate"
"""In place of a constant of one body that is to be estimated."""

Ask = Callable[[str], str]
Constant = tuple[float | None, float | None]
"""Value and standard deviation in SI."""


@dataclass(frozen=True, slots=True)
class Told:
    """What the person who writes the campaign knows. ``per file`` means by recording or file name, None for all."""

    rig: str = DRILL
    title: str | None = None
    rock: str | None = None
    constants: Mapping[str, Constant] = field(default_factory=dict)
    """By name as campaign.json has it; those left out are the paper's for its rig."""
    frequency: Mapping[str | None, float] = field(default_factory=dict)
    """Hz, per file."""
    amplitude: Mapping[str | None, float] = field(default_factory=dict)
    """V, per file."""
    pressure: Mapping[str | None, float] = field(default_factory=dict)
    """bar, per file."""
    sample_rate: Mapping[str | None, float] = field(default_factory=dict)
    """Hz, per file."""
    starts: Mapping[str | None, str] = field(default_factory=dict)
    """running or fresh, per file."""
    channels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Of a channel, its column, and its unit where the file does not say it."""


@dataclass(frozen=True, slots=True)
class Row:
    """What is known of one recording, and from what."""

    file: str
    entry: Mapping[str, Any]
    """As in campaign.json."""
    sources: Mapping[str, str]
    """Of sample_rate, frequency, amplitude, pressure, starts and each channel, what it was taken from."""
    guessed: tuple[str, ...]
    """Those of them that were guessed."""


@dataclass(frozen=True, slots=True)
class Description:
    """A campaign.json to be, and how it came about."""

    document: Mapping[str, Any]
    rows: tuple[Row, ...]
    remarks: tuple[str, ...]
    """What was guessed for the campaign as a whole."""
    left_out: tuple[tuple[str, str], ...]
    """Files and why."""

    def write(self, folder: str | os.PathLike[str], force: bool = False) -> Path:
        """Write campaign.json, whole.

        Raises:
            InputError: there is one, and ``force`` is not set; or it cannot be written.
        """
        path = Path(folder) / DOCUMENT
        refuse_to_overwrite(folder, force)
        with whole(path) as part:
            part.write_text(json.dumps(self.document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        return path


def refuse_to_overwrite(folder: str | os.PathLike[str], force: bool) -> None:
    """Complain of a campaign.json that is there.

    Raises:
        InputError: there is one, and ``force`` is not set.
    """
    if not force and os.path.lexists(Path(folder) / DOCUMENT):
        raise InputError(f"{shown(str(folder))} has a {DOCUMENT}: give --force to write it anew")


def describe(folder: str | os.PathLike[str], told: Told, ask: Ask | None = None) -> Description:
    """Look at the data files of a folder and describe them.

    Args:
        folder: With .csv, .mat, .h5, .tdms and .lvm files; those below it are not looked at.
        told: What is known.
        ask: Asks a person a question and returns the answer; at most two are asked. None where nobody is there.

    Raises:
        InputError: no such folder, no file that can be used, or something that neither the files nor ``told`` say.
    """
    choice("--rig", told.rig, (DRILL, ONE_BODY))
    with np.errstate(all="ignore"):  # absurd values of a damaged file become infinities, which the check reports
        return _described(folder, told, ask)


def _described(folder: str | os.PathLike[str], told: Told, ask: Ask | None) -> Description:
    questions = _Questions(ask)
    contents, left_out = _contents(Path(folder))
    used: list[tuple[Contents, dict[str, Role]]] = []
    for each in contents:
        roles = find_roles(each, told.rig, told.channels)
        lacking = [name for name in NEEDED[told.rig] if name not in roles]
        if lacking:
            has = ", ".join(map(shown, each.units))
            left_out.append((each.file, f"no column is known as {lacking[0]}; it has {has} (--channel tells)"))
        else:
            used.append((each, roles))
    if not used:
        why = "; ".join(f"{file}: {reason}" for file, reason in left_out[:3]) or f"none ends in {_listed(FILE_ENDINGS)}"
        raise InputError(f"{shown(str(folder))} has no file that can be used ({why})")
    _check_names(told, [each.file for each, _ in used])
    nominal, remarks = _nominal(told, questions)
    stems = [Path(each.file).stem for each, _ in used]
    rows = [_row(each, roles, told, questions, stems) for each, roles in used]
    if told.rig == DRILL:
        rows = _with_settled_units(rows, used, nominal)
    document = {
        "format": FORMAT,
        "title": told.title or Path(folder).resolve().name or "campaign",
        "rig": told.rig,
        "nominal": nominal,
        "recordings": [dict(row.entry) for row in rows],
    }
    parse_document(document)
    return Description(document, tuple(rows), tuple(remarks), tuple(left_out))


class _Questions:
    """Asks a person, twice at most."""

    def __init__(self, ask: Ask | None) -> None:
        self.ask, self.left = ask, MOST_QUESTIONS
        self.pressure: float | None = None
        """bar, once it was answered."""

    def answer(self, question: str, otherwise: str) -> str:
        """The answer to a question.

        Raises:
            InputError: nobody can be asked; the message is ``otherwise``.
        """
        if self.ask is None or self.left == 0:
            raise InputError(otherwise)
        self.left -= 1
        text = self.ask(question).strip()
        if not text:
            raise InputError(otherwise)
        return text


def _contents(folder: Path) -> tuple[list[Contents], list[tuple[str, str]]]:
    """What the files hold, in the order of their names, numbers in these by size; and those that cannot be read."""
    try:
        files = [each for each in folder.iterdir() if each.suffix.lower() in FILE_ENDINGS and each.is_file()]
    except OSError as error:
        raise InputError(
            f"cannot read {shown(str(folder))}: {error.strerror or error}; give a folder of data files"
        ) from None
    found, left_out = [], []
    for path in sorted(files, key=lambda path: [int(x) if x.isdigit() else x for x in re.split(r"(\d+)", path.name)]):
        if path.name.startswith("."):
            continue
        try:
            found.append(contents_of(path))
        except InputError as error:
            left_out.append((path.name, str(error)))
    return found, left_out


def _listed(endings: Sequence[str]) -> str:
    return ", ".join(endings)


def _check_names(told: Told, files: Sequence[str]) -> None:
    """Complain of a value for a file that is not there."""
    known = {name for file in files for name in (file, Path(file).stem)}
    for option in ("frequency", "amplitude", "pressure", "sample_rate", "starts"):
        for name in getattr(told, option):
            if name is not None and name not in known:
                listed = ", ".join(Path(file).stem for file in files[:6])
                typed = option.replace("_", "-")
                raise InputError(f"--{typed} is given for {shown(name)}, which is none of the files: give {listed}")


# --------------------------------------------------------------------------------------------------------------------
# the rig


def _nominal(told: Told, questions: _Questions) -> tuple[dict[str, Any], list[str]]:
    """What the lab believes, and what was assumed for it."""
    known = [each.name for each in fields(Rig)] + ["loading_stiffness", "unloading_stiffness"]
    known = known if told.rig == DRILL else list(BODY_CONSTANTS)
    for name in told.constants:
        if name not in known:
            raise InputError(f"--{name.replace('_', '-')} is no constant of the rig {told.rig}: give {_listed(known)}")
    found, remarks = _drill_constants(told, questions) if told.rig == DRILL else _body_constants(told, questions)
    nominal = {}
    for name, (value, std) in found.items():
        entry: dict[str, Any] = {"value": value}
        if std is not None:
            entry["std"] = std
        nominal[name] = {**entry, "unit": SI_UNITS[name]}
    return nominal, remarks


def _drill_constants(told: Told, questions: _Questions) -> tuple[dict[str, Constant], list[str]]:
    found: dict[str, Constant] = {}
    remarks, assumed = [], []
    for each in fields(Rig):
        paper = float(each.default)  # pyright: ignore[reportArgumentType]
        value, std = told.constants.get(each.name, (paper, None))
        if value is None:
            raise InputError(f"--{each.name.replace('_', '-')} is to be estimated: give a value, the rig needs one")
        if each.name not in told.constants:
            assumed.append(each.name)
        if std is None:
            std = TOLERANCES[each.name] if value == paper else neat_number(RIG_STD * value)
            if value != paper:
                remarks.append(f"{each.name} is taken to be known to {100 * RIG_STD:g} % (give VALUE+-STD)")
        found[each.name] = (value, std)
    if assumed:
        remarks.insert(0, f"{', '.join(assumed)}: those of the paper's rig (Table 2.1)")
    stated = {
        name: told.constants[name] for name in ("loading_stiffness", "unloading_stiffness") if name in told.constants
    }
    if len(stated) == 1:
        raise InputError("one of --loading-stiffness and --unloading-stiffness is missing: give both, in N/m")
    if stated:
        for name, (value, std) in stated.items():
            if value is None:
                raise InputError(f"--{name.replace('_', '-')} is to be estimated: give a value in N/m")
            found[name] = (value, neat_number(ROCK_STD * value) if std is None else std)
            if std is None:
                remarks.append(f"{name} is taken to be known to {100 * ROCK_STD:g} % (give VALUE+-STD)")
        return found, remarks
    case = _rock(told, questions)
    source = "Table 2.2" if case in ROCKS.values() else "the rock file"
    remarks.append(f"stiffnesses of the rock: those of {case.name} ({source})")
    found["loading_stiffness"] = (case.loading_stiffness, case.loading_spread)
    found["unloading_stiffness"] = (case.unloading_stiffness, case.unloading_spread)
    return found, remarks


def _rock(told: Told, questions: _Questions) -> Rock:
    text = told.rock
    if text is None:
        text = questions.answer(
            "Which rock and indenter, case 1 to 6 of Table 2.2? ",
            "the rock is not known: give --rock CASE (1 to 6 of Table 2.2) or --rock FILE, or --loading-stiffness and "
            "--unloading-stiffness in N/m",
        )
    return rock(text)


def _body_constants(told: Told, questions: _Questions) -> tuple[dict[str, Constant], list[str]]:
    constants = dict(told.constants)
    if "mass" not in constants:
        text = questions.answer("The mass of the body in kg? ", "the mass of the body is not known: give --mass KG")
        constants["mass"] = (_number(text, "--mass"), None)
    remarks = []
    for name, (value, std) in constants.items():
        if value and std is None:
            constants[name] = (value, neat_number(BODY_STD * abs(value)))
            remarks.append(f"{name} is taken to be known to {100 * BODY_STD:g} % (give VALUE+-STD)")
    return constants, remarks


def _number(text: str, option: str) -> float:
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{option} is {shown(text)}: give a number such as 1.2")
    return value


# --------------------------------------------------------------------------------------------------------------------
# a recording


@dataclass(slots=True)
class _Finding:
    """Values of one recording as they are found."""

    file: str
    told: Told
    sources: dict[str, str] = field(default_factory=dict)
    guessed: list[str] = field(default_factory=list)

    def stated(self, name: str) -> Any:
        """What was told of this file, or of all; None where nothing was."""
        values: Mapping[str | None, Any] = getattr(self.told, name)
        for key in (Path(self.file).stem, self.file, None):
            if key in values:
                self.sources[name] = f"--{name.replace('_', '-')}"
                return values[key]
        return None

    def guess(self, name: str, value: Any, source: str) -> Any:
        """Note where a value is from that nobody has stated."""
        self.sources[name] = source
        self.guessed.append(name)
        return value


def _row(contents: Contents, roles: Mapping[str, Role], told: Told, questions: _Questions, stems: Sequence[str]) -> Row:
    stem = Path(contents.file).stem
    finding = _Finding(contents.file, told)
    for name, role in roles.items():
        finding.sources[name] = role.source
        if role.guessed:
            finding.guessed.append(name)
    rate = finding.stated("sample_rate")
    if rate is None:
        rate = contents.sample_rate
        finding.sources["sample_rate"] = contents.rate_from
        if "taken to be" in contents.rate_from:
            finding.guessed.append("sample_rate")
    if rate is None:
        raise InputError(f"{shown(contents.file)} does not say its sample rate: give --sample-rate HZ")
    entry: dict[str, Any] = {
        "name": (stem if stems.count(stem) == 1 else contents.file)[:LONGEST_NAME],
        "file": contents.file,
        "sample_rate": rate,
    }
    if told.rig == DRILL:
        entry["starts"] = _starts(finding)
        entry["setting"] = _setting(contents, roles, rate, finding, questions)
    known = BODY_CHANNELS if told.rig == ONE_BODY else tuple(roles)
    entry["channels"] = {
        name: {"column": role.column, "unit": role.unit} for name, role in roles.items() if name in known
    }
    return Row(contents.file, entry, finding.sources, tuple(finding.guessed))


def _starts(finding: _Finding) -> str:
    stated = finding.stated("starts")
    if stated is not None:
        return choice("--starts", stated, ("running", "fresh"))
    if re.search(r"fresh|start|frisch", Path(finding.file).stem, re.IGNORECASE):
        return finding.guess("starts", "fresh", "the name of the file")
    return finding.guess("starts", "running", "nothing that says fresh")


def _setting(
    contents: Contents, roles: Mapping[str, Role], rate: float, finding: _Finding, questions: _Questions
) -> dict[str, float]:
    """Frequency in Hz, amplitude in V and pressure in bar."""
    frequency, amplitude = finding.stated("frequency"), finding.stated("amplitude")
    if (frequency is None or amplitude is None) and "excitation" in roles:
        drive = drive_of(_si(contents, roles, "excitation"), rate)
        if drive is not None:
            if frequency is None:
                frequency = drive.frequency
                finding.sources["frequency"] = "the tone of the excitation"
            if amplitude is None:
                amplitude = drive.amplitude
                finding.sources["amplitude"] = "the tone of the excitation"
    for name, value, unit in (("frequency", frequency, "Hz"), ("amplitude", amplitude, "V")):
        if value is None and (named := _in_name(contents.file, unit)) is not None:
            value = finding.guess(name, named, "the name of the file")
            frequency, amplitude = (value, amplitude) if name == "frequency" else (frequency, value)
        if value is None:
            raise InputError(f"{shown(contents.file)} does not say its {name}: give --{name} in {unit}")
    assert frequency is not None and amplitude is not None  # or it was complained of
    return {"frequency": frequency, "amplitude": amplitude, "pressure": _pressure(contents, roles, finding, questions)}


def _pressure(contents: Contents, roles: Mapping[str, Role], finding: _Finding, questions: _Questions) -> float:
    """In bar: what was told, the channel's, what the name of the file says, or what a person answers."""
    pressure = finding.stated("pressure")
    if pressure is None and "pressure" in roles:
        samples = sorted(value for value in _si(contents, roles, "pressure").tolist() if math.isfinite(value))
        pressure = neat_number(samples[len(samples) // 2] / 1e5) if samples else None
        finding.sources["pressure"] = "the channel pressure"
    if pressure is None:
        pressure = _in_name(contents.file, "bar")
        if pressure is not None:
            finding.guess("pressure", pressure, "the name of the file")
    if pressure is None:
        said = _answered_pressure(finding, questions)
        finding.sources["pressure"] = "the answer"
        return said
    return pressure


def _answered_pressure(finding: _Finding, questions: _Questions) -> float:
    """One answer for all files that do not say it."""
    if questions.pressure is None:
        stem = Path(finding.file).stem
        text = questions.answer(
            "The pneumatic pressure in bar, of every recording that does not say it? ",
            f"{shown(finding.file)} does not say its pressure: give --pressure BAR, or --pressure {stem}=BAR for each",
        )
        questions.pressure = _number(text, "--pressure")
    return questions.pressure


def _in_name(file: str, unit: str) -> float | None:
    """A number before a unit in the name of a file: ``60Hz``, ``0,45 V``, ``1p2bar``."""
    match = re.search(rf"(?<![A-Za-z\d.,])(\d+(?:[.,p]\d+)?)[ _]?{unit}(?![A-Za-z])", Path(file).stem, re.IGNORECASE)
    return float(re.sub("[,pP]", ".", match[1])) if match else None


def _si(contents: Contents, roles: Mapping[str, Role], name: str) -> Any:
    """(samples,) of a channel in SI."""
    role = roles[name]
    return contents.table.columns[role.column] * CHANNEL_UNITS[name][role.unit]


def _with_settled_units(
    rows: Sequence[Row], used: Sequence[tuple[Contents, dict[str, Role]]], nominal: Mapping[str, Any]
) -> list[Row]:
    """Units that nobody stated are those under which force and acceleration obey the balance of the rig."""
    open_ones = sorted({name for _, roles in used for name, role in roles.items() if role.unit_guessed})
    open_ones = [name for name in open_ones if name in ("force", "acceleration")]
    if not open_ones:
        return list(rows)
    found = []
    for row, (contents, roles) in zip(rows, used, strict=True):
        units = settled_units(contents, roles, row.entry, nominal, open_ones)
        channels = {
            name: {**channel, "unit": units.get(name, channel["unit"])}
            for name, channel in row.entry["channels"].items()
        }
        sources = {**row.sources, **{name: f"{row.sources[name]}, unit by the balance of the rig" for name in units}}
        found.append(Row(row.file, {**row.entry, "channels": channels}, sources, row.guessed))
    return found
