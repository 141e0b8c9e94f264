"""A campaign: the recordings of a rig, what the lab believes of it, and reading both from a folder."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, shown
from drillenv.recordings.clock import seconds_of
from drillenv.recordings.document import DOCUMENT, DeclaredRecording, Nominal, read_document
from drillenv.recordings.findings import NOTE, QualityFinding
from drillenv.recordings.table import Table
from drillenv.recordings.units import known_unit
from drillenv.rig import Setting

MOST_BYTES = 2 * 2**30
"""Of one data file."""
MOST_SAMPLES, LEAST_SAMPLES = 20_000_000, 2
"""Of one channel."""

FileTime = NDArray[np.float64] | None


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """The samples of one sensor."""

    samples: NDArray[np.float64]
    """(samples,) in SI: V, N, m/s^2, m, m/s, Pa or s. What the file does not hold as a number is NaN."""
    unit: str
    """The unit the file is written in, such as kN."""
    column: str
    """The column, variable, dataset or group/channel of the file."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One recording: channels sampled together.

    Signs: x, velocity and acceleration are positive toward the rock, the contact force in compression.
    """

    name: str
    file: str
    """Relative to the campaign folder."""
    sample_rate: float
    """Hz, as stated."""
    channels: Mapping[str, Channel]
    """By name: excitation, force, acceleration, position, velocity, pressure, time; those that were recorded."""
    starts: str | None = None
    """"running" (for at least a second), "fresh" (from rest, on rock never hit), or None where not stated."""
    setting: Setting | None = None
    """Of the drilling rig; None for one body."""
    use: str = "fit"
    """"fit", or "held-out": for showing the fit, never for making it."""
    clock: NDArray[np.float64] | None = None
    """(samples,) s, the time that the file itself gives each sample (the channel time; a column named as times usually
    are that goes up evenly; the increment of a .tdms or .lvm channel); None where it gives none. Quality checks hold
    ``sample_rate`` against it."""
    findings: tuple[QualityFinding, ...] = ()
    """What reading the file had to say."""

    @property
    def size(self) -> int:
        """Samples of each channel."""
        return next(iter(self.channels.values())).samples.size

    @property
    def seconds(self) -> float:
        """Duration in s: samples over the stated sample rate."""
        return self.size / self.sample_rate

    @property
    def time(self) -> NDArray[np.float64]:
        """(samples,) s from the first sample, by the stated sample rate."""
        return np.arange(self.size) / self.sample_rate


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """What a lab hands over."""

    title: str
    rig: str
    """"percussive-drill", or "one-body": mass * acceleration = force - law(position, velocity)."""
    nominal: Mapping[str, Nominal]
    """What the lab believes, by name, in SI."""
    recordings: tuple[Recording, ...]
    folder: Path
    source: str | None = None
    """Where the recordings come from, where stated."""


def read_campaign(folder: str | os.PathLike[str]) -> Campaign:
    """Read a campaign folder: campaign.json and the data files it names.

    Samples are converted to SI and otherwise left as they are; :func:`drillenv.recordings.check_quality` says what is
    wrong with them. Data files are .csv, .mat (v5 and v7.3), .h5, .tdms and .lvm.

    Args:
        folder: The folder that holds campaign.json.

    Raises:
        InputError: no such folder; a key that is unknown, missing, given twice or of the wrong kind; a unit, a version
            or a rig that the format does not have; a data file that is missing, outside the folder, too large,
            damaged, or without a column that campaign.json names; channels of unequal length.
    """
    place = _folder(folder)
    try:
        document = read_document(_inside(place, DOCUMENT))
        recordings = tuple(_read_recording(place, declared) for declared in document.recordings)
    except InputError as error:
        raise InputError(f"campaign {shown(place.name)}: {error}") from None
    return Campaign(document.title, document.rig, document.nominal, recordings, place, document.source)


def _read_recording(folder: Path, declared: DeclaredRecording) -> Recording:
    try:
        table = reader_of(declared.file)(_inside(folder, declared.file), _columns(declared))
        _check_sizes(table)
    except InputError as error:
        raise InputError(f"recording {shown(declared.name)}: {error}") from None
    channels = {}
    for name, channel in declared.channels.items():
        with np.errstate(all="ignore"):  # an absurd value becomes an infinity, which the quality check reports
            samples = table.columns[channel.column] * channel.factor
        channels[name] = Channel(samples, channel.unit, channel.column)
    clock, more = _clock(table, declared.sample_rate)
    notes = (*table.notes, *more, *_other_units(declared, table))
    return Recording(
        name=declared.name,
        file=declared.file,
        sample_rate=declared.sample_rate,
        channels=MappingProxyType(channels),
        starts=declared.starts,
        setting=declared.setting,
        use=declared.use,
        clock=channels["time"].samples if "time" in channels else clock,
        findings=tuple(_note(declared, text, table) for text in notes),
    )


def _clock(table: Table, sample_rate: float) -> tuple[FileTime, tuple[str, ...]]:
    """(samples,) s, the file's own time, and what to note about it."""
    if table.clock is None:
        return None, ()
    seconds = seconds_of(table.clock, sample_rate)
    if seconds is None:
        column = shown(table.clock.column)
        return None, (f"its time {column} does not say its unit and was left aside: write it as {column[:-1]} [s]'",)
    return seconds, ()


def _other_units(declared: DeclaredRecording, table: Table) -> tuple[str, ...]:
    """Notes on channels whose unit in the file is not the one in campaign.json."""
    notes = []
    for name, channel in declared.channels.items():
        stated = table.units.get(channel.column, "")
        unit = known_unit(stated)
        if unit is not None and unit != channel.unit:
            notes.append(
                f"it gives {shown(channel.column)} in {unit}, {DOCUMENT} the channel {name} in {channel.unit}, which "
                "was followed: correct one of them"
            )
    return tuple(notes)


def _note(declared: DeclaredRecording, text: str, table: Table) -> QualityFinding:
    seconds = next(iter(table.columns.values())).size / declared.sample_rate
    return QualityFinding(declared.name, None, "reading", 0.0, seconds, f"{declared.file}: {text}", NOTE)


def _columns(declared: DeclaredRecording) -> list[str]:
    return [channel.column for channel in declared.channels.values()]


def _check_sizes(table: Table) -> None:
    sizes = {column: samples.size for column, samples in table.columns.items()}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{shown(column)} {size}" for column, size in sizes.items())
        raise InputError(f"its channels differ in length ({listed} samples): give channels sampled together")
    size = next(iter(sizes.values()))
    if table.clock is not None and table.clock.samples.size != size:
        own = table.clock.samples.size
        raise InputError(f"its own time has {own} samples, its channels {size}: give one time a sample")
    if not LEAST_SAMPLES <= size <= MOST_SAMPLES:
        raise InputError(f"it has {size} samples: give {LEAST_SAMPLES} to {MOST_SAMPLES}")


def reader_of(file: str) -> Callable[[Path, Sequence[str]], Table]:
    """The function that reads such a file. Each format's library is imported when a file needs it."""
    ending = PurePosixPath(file).suffix.lower()
    if ending == ".csv":
        from drillenv.recordings.read_csv import read_csv as read
    elif ending == ".mat":
        from drillenv.recordings.read_mat import read_mat as read
    elif ending == ".h5":
        from drillenv.recordings.read_h5 import read_h5 as read
    elif ending == ".lvm":
        from drillenv.recordings.read_lvm import read_lvm as read
    else:
        from drillenv.recordings.read_tdms import read_tdms as read
    return partial(read, most=MOST_SAMPLES)


def _folder(given: str | os.PathLike[str]) -> Path:
    try:
        text = os.fspath(given)
        if not isinstance(text, str) or not text.strip() or "\0" in text:
            raise TypeError
        place = Path(text).resolve()
    except (TypeError, OSError, RuntimeError):
        raise InputError(f"campaign is {shown(given)}: give the folder that holds {DOCUMENT}") from None
    try:
        is_folder = place.is_dir()
    except OSError as error:
        raise InputError(f"cannot read {shown(text)}: {error.strerror or error}; give a readable folder") from None
    if not is_folder:
        what = "is no folder" if place.exists() else "does not exist"
        raise InputError(f"campaign {shown(text)} {what}: give the folder that holds {DOCUMENT}")
    return place


def _inside(folder: Path, file: str) -> Path:
    """The file, its links followed, if it is a regular file that lies in the folder."""
    try:
        path = (folder / file).resolve()
        if not path.is_relative_to(folder):
            raise InputError(f"{shown(file)} is a link out of the campaign folder: put the file itself there")
        status = path.stat()
    except FileNotFoundError:
        raise InputError(f"{shown(file)} is not in the campaign folder: put it there") from None
    except (OSError, RuntimeError) as error:  # RuntimeError: links that lead in a circle
        reason = getattr(error, "strerror", None) or "its links lead in a circle"
        raise InputError(f"cannot read {shown(file)}: {reason}; give a readable file") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{shown(file)} is no file: give a regular file")
    if status.st_size > MOST_BYTES:
        raise InputError(f"{shown(file)} is larger than {MOST_BYTES // 2**30} GiB: cut it into several recordings")
    return path
