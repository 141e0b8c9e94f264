"""campaign.json: what it may say, checked strictly, each fault in one line."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Any, NoReturn

from drillenv.checks import InputError, choice, number, shown
from drillenv.recordings.units import CHANNEL_UNITS, DAMPING, FORCE, GAIN, MASS, STIFFNESS, unit_of
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

FORMAT = "drillenv-campaign/1"
DOCUMENT = "campaign.json"
DRILL, ONE_BODY = "percussive-drill", "one-body"
FILE_ENDINGS = (".csv", ".mat", ".h5", ".tdms", ".lvm")

DRILL_CHANNELS = ("excitation", "force", "acceleration", "position", "velocity", "pressure", "time")
BODY_CHANNELS = ("force", "position", "velocity", "acceleration", "time")

MOST_BYTES = 4 * 2**20
"""Of campaign.json."""
MOST_RECORDINGS = 1000
LONGEST_NAME, LONGEST_TEXT = 100, 500
SAMPLE_RATE_LIMITS = {DRILL: (100.0, 1e7), ONE_BODY: (0.1, 1e7)}  # Hz


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the lab believes of one constant."""

    value: float | None
    """In SI; None where it is to be estimated."""
    std: float | None
    """One standard deviation in SI; None where none is stated."""
    unit: str
    """The SI unit of both: kg, N/m, N*s/m, N or 1."""


@dataclass(frozen=True, slots=True)
class DeclaredChannel:
    """Where the samples of a channel stand, and in which unit."""

    column: str
    unit: str
    factor: float
    """From the unit to SI."""


@dataclass(frozen=True, slots=True)
class DeclaredRecording:
    """A recording as campaign.json describes it."""

    name: str
    file: str
    sample_rate: float
    starts: str | None
    setting: Setting | None
    use: str
    channels: Mapping[str, DeclaredChannel]


@dataclass(frozen=True, slots=True)
class Document:
    """A whole campaign.json."""

    title: str
    source: str | None
    rig: str
    nominal: Mapping[str, Nominal]
    recordings: tuple[DeclaredRecording, ...]


# Of each constant: its units with their factors, and the range allowed, in SI.
_DRILL_NOMINAL: dict[str, Mapping[str, float]] = {
    "shaker_mass": MASS,
    "indenter_mass": MASS,
    "stiffness": STIFFNESS,
    "damping": DAMPING,
    "drive_gain": GAIN,
    "pressure_gain": GAIN,
    "loading_stiffness": STIFFNESS,
    "unloading_stiffness": STIFFNESS,
}
_BODY_NOMINAL: dict[str, tuple[Mapping[str, float], float, float]] = {
    "mass": (MASS, 1e-6, 1e9),
    "stiffness": (STIFFNESS, 0.0, 1e12),
    "damping": (DAMPING, 0.0, 1e12),
    "coulomb": (FORCE, 0.0, 1e12),
    "offset": (FORCE, -1e12, 1e12),
}
BODY_CONSTANTS = tuple(_BODY_NOMINAL)
"""Of one body, by name."""


def read_document(path: Path) -> Document:
    """Read and check the campaign.json at ``path``.

    Raises:
        InputError: it cannot be read, is no JSON, or says something the format does not allow.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{DOCUMENT} is larger than {MOST_BYTES // 2**20} MiB: give a list of files, not the data")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{DOCUMENT} is not UTF-8 text (byte {error.start}): save it as UTF-8") from None
    except OSError as error:
        raise InputError(f"cannot read {DOCUMENT}: {error.strerror or error}; give a readable file") from None
    return parse_document(load_strictly(text))


def load_strictly(text: str) -> object:
    """JSON text as Python objects; keys given twice and numbers that JSON does not have are refused.

    Raises:
        InputError: the text is not such JSON.
    """
    try:
        return json.loads(text, object_pairs_hook=_no_key_twice, parse_constant=_no_constant)
    except InputError:
        raise
    except json.JSONDecodeError as error:
        advice = "mend the JSON there"
        raise InputError(
            f"{DOCUMENT} is no JSON at line {error.lineno}, column {error.colno} ({_lower(error.msg)}): {advice}"
        ) from None
    except RecursionError:
        raise InputError(f"{DOCUMENT} is nested too deeply: give the keys of {FORMAT} only") from None
    except ValueError:  # an integer of more than 4300 digits
        raise InputError(f"{DOCUMENT} holds a number with too many digits: give at most 17") from None


def parse_document(given: object) -> Document:
    """The document that JSON objects describe.

    Raises:
        InputError: they say something the format does not allow.
    """
    # The version first: everything else may be otherwise in another one.
    if isinstance(given, Mapping) and "format" in given and given["format"] != FORMAT:
        raise InputError(f"{DOCUMENT}: format is {shown(given['format'])}: give {shown(FORMAT)}")
    whole = _keys(DOCUMENT, given, ("format", "title", "rig", "nominal", "recordings"), ("source",))
    where = f"{DOCUMENT}: "
    rig = choice(f"{where}rig", whole["rig"], (DRILL, ONE_BODY))
    source = whole.get("source")
    nominal = _drill_nominal(whole["nominal"]) if rig == DRILL else _body_nominal(whole["nominal"])
    return Document(
        title=_text(f"{where}title", whole["title"], LONGEST_TEXT),
        source=None if source is None else _text(f"{where}source", source, LONGEST_TEXT),
        rig=rig,
        nominal=MappingProxyType(nominal),
        recordings=_recordings(rig, whole["recordings"]),
    )


# --------------------------------------------------------------------------------------------------------------------
# nominal


def _drill_nominal(given: object) -> dict[str, Nominal]:
    """The eight constants of the drilling rig, each with a value and a standard deviation."""
    where = f"{DOCUMENT}: nominal"
    stated = _keys(where, given, tuple(_DRILL_NOMINAL))
    found = {name: _constant(f"{where}.{name}", stated[name], units) for name, units in _DRILL_NOMINAL.items()}
    values: dict[str, float] = {}
    for name, constant in found.items():
        if constant.value is None or constant.std is None:
            what = "value" if constant.value is None else "std"
            raise InputError(f"{where}.{name} has no {what}: give what the lab believes, with one standard deviation")
        values[name] = constant.value
    loading, unloading = values.pop("loading_stiffness"), values.pop("unloading_stiffness")
    try:
        Rig(**values)
        Rock(loading, unloading)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return found


def _body_nominal(given: object) -> dict[str, Nominal]:
    """The constants of a single force balance: the mass, and those of the law that are in the model."""
    where = f"{DOCUMENT}: nominal"
    stated = _keys(where, given, ("mass",), tuple(name for name in _BODY_NOMINAL if name != "mass"))
    found = {}
    for name, entry in stated.items():
        units, low, high = _BODY_NOMINAL[name]
        found[name] = _constant(f"{where}.{name}", entry, units)
        value = found[name].value
        if value is not None:
            number(f"{where}.{name}.value", value, low, high, found[name].unit)
    return found


def _constant(where: str, given: object, units: Mapping[str, float]) -> Nominal:
    """One constant in SI. ``value`` may be null, and then has no standard deviation."""
    stated = _keys(where, given, ("value", "unit"), ("std",))
    unit = unit_of(f"{where}.unit", stated["unit"], units)
    factor, si = units[unit], next(iter(units))
    value, std = stated["value"], stated.get("std")
    if value is None:
        if std is not None:
            raise InputError(f"{where} has a std but no value: give both, or neither to have it estimated")
        return Nominal(None, None, si)
    value = number(f"{where}.value", value, -1e15, 1e15, unit) * factor
    if std is not None:
        std = number(f"{where}.std", std, 0.0, 1e15, unit) * factor
        if std == 0.0:
            raise InputError(f"{where}.std is 0: give a standard deviation above 0; none is known exactly")
    return Nominal(value, std, si)


# --------------------------------------------------------------------------------------------------------------------
# recordings


def _recordings(rig: str, given: object) -> tuple[DeclaredRecording, ...]:
    where = f"{DOCUMENT}: recordings"
    if not isinstance(given, Sequence) or isinstance(given, str) or not given:
        raise InputError(f"{where} is {shown(given)}: give a list of at least one recording")
    if len(given) > MOST_RECORDINGS:
        raise InputError(f"{where} lists {len(given)}: give at most {MOST_RECORDINGS}")
    found = tuple(_recording(rig, f"{where}[{i}]", entry) for i, entry in enumerate(given))
    names, contents = set(), {}
    for recording in found:
        if recording.name in names:
            raise InputError(f"{where} has the name {shown(recording.name)} twice: give each its own")
        names.add(recording.name)
        content = (recording.file, *sorted(channel.column for channel in recording.channels.values()))
        if content in contents:
            raise InputError(
                f"{where}: {shown(contents[content])} and {shown(recording.name)} both read "
                f"{shown(recording.file)}, the same columns: give each its own file"
            )
        contents[content] = recording.name
    return found


def _recording(rig: str, where: str, given: object) -> DeclaredRecording:
    must, may = ("name", "file", "sample_rate", "channels"), ("use",)
    if rig == DRILL:
        must = (*must, "starts", "setting")
    else:
        may = (*may, "starts", "setting")
    if isinstance(given, Mapping) and isinstance(given.get("name"), str):
        where = f"{where} {shown(given['name'])}"
    entry = _keys(where, given, must, may)
    starts, setting = entry.get("starts"), entry.get("setting")
    if rig == DRILL or starts is not None:
        starts = choice(f"{where}: starts", starts, ("running", "fresh"))
    if rig == DRILL or setting is not None:
        setting = _setting(f"{where}: setting", setting)
    low, high = SAMPLE_RATE_LIMITS[rig]
    return DeclaredRecording(
        name=_text(f"{where}: name", entry["name"], LONGEST_NAME),
        file=_file(f"{where}: file", entry["file"]),
        sample_rate=number(f"{where}: sample_rate", entry["sample_rate"], low, high, "Hz", [(1e3, "kHz")]),
        starts=starts,
        setting=setting,
        use=choice(f"{where}: use", entry.get("use", "fit"), ("fit", "held-out")),
        channels=MappingProxyType(_channels(rig, f"{where}: channels", entry["channels"])),
    )


def _setting(where: str, given: object) -> Setting:
    stated = _keys(where, given, ("frequency", "amplitude", "pressure"))
    try:
        return Setting(**stated)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _channels(rig: str, where: str, given: object) -> dict[str, DeclaredChannel]:
    known = DRILL_CHANNELS if rig == DRILL else BODY_CHANNELS
    stated = _keys(where, given, (), known)
    if not stated:
        raise InputError(f"{where} is empty: give at least one of {', '.join(known)}")
    found: dict[str, DeclaredChannel] = {}
    for name, entry in stated.items():
        here = f"{where}.{name}"
        parts = _keys(here, entry, ("column", "unit"))
        units = CHANNEL_UNITS[name]
        unit = unit_of(f"{here}.unit", parts["unit"], units)
        found[name] = DeclaredChannel(_text(f"{here}.column", parts["column"], LONGEST_TEXT), unit, units[unit])
    columns = [channel.column for channel in found.values()]
    for column in columns:
        if columns.count(column) > 1:
            raise InputError(f"{where} names the column {shown(column)} twice: give each channel its own")
    return found


def _file(where: str, given: object) -> str:
    """A path that stays in the folder, as far as its text tells; links are looked at when it is opened."""
    text = _text(where, given, LONGEST_TEXT)
    windows = PureWindowsPath(text)
    if text.startswith(("/", "~")) or windows.drive or windows.root or "\\" in text:
        _refuse_path(where, text)
    if ".." in PurePosixPath(text).parts:
        _refuse_path(where, text)
    ending = PurePosixPath(text).suffix.lower()
    if ending not in FILE_ENDINGS:
        raise InputError(f"{where} is {shown(text)}: give a file that ends in {', '.join(FILE_ENDINGS)}")
    return text


def _refuse_path(where: str, text: str) -> NoReturn:
    raise InputError(f"{where} is {shown(text)}: give a file inside the campaign folder, relative to it, with /")


# --------------------------------------------------------------------------------------------------------------------
# parts of any document


def _keys(where: str, given: object, must: Sequence[str], may: Sequence[str] = ()) -> dict[str, Any]:
    """``given`` as a mapping that has all keys of ``must`` and none but those and ``may``."""
    known = (*must, *may)
    if not isinstance(given, Mapping):
        raise InputError(f"{where} is {shown(given)}: give an object with {', '.join(known)}")
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, 1)
            meant = f" (did you mean {near[0]}?)" if near else ""
            raise InputError(f"{where} has the unknown key {shown(key)}: give {', '.join(known)}{meant}")
    for key in must:
        if key not in given:
            raise InputError(f"{where} has no {shown(key)}: give {', '.join(must)}")
    return dict(given)


def _text(where: str, given: object, longest: int) -> str:
    if not isinstance(given, str) or not given.strip() or not given.isprintable():
        raise InputError(f"{where} is {shown(given)}: give text on one line")
    if len(given) > longest:
        raise InputError(f"{where} is {len(given)} characters long: give at most {longest}")
    return given


def _no_key_twice(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"{DOCUMENT} gives the key {shown(key)} twice in one object: give it once")
        found[key] = value
    return found


def _no_constant(name: str) -> NoReturn:
    raise InputError(f"{DOCUMENT} holds {name}, which JSON does not have: give a finite number, or null")


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]
