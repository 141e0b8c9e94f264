"""Writing a campaign folder, whole or not at all."""

from __future__ import annotations

import csv
import json
import os
import re
import secrets
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, choice, shown
from drillenv.recordings.campaign import LEAST_SAMPLES, MOST_SAMPLES, Recording
from drillenv.recordings.document import DOCUMENT, FORMAT, Nominal, parse_document
from drillenv.recordings.units import CHANNEL_UNITS, unit_of

Columns = Mapping[str, NDArray[np.float64]]

FILE_FORMATS = {"csv": ".csv", "mat": ".mat", "mat73": ".mat", "h5": ".h5", "tdms": ".tdms"}
"""Formats and the endings of their files."""
GROUP = "rig"
"""Of the channels of a .tdms file whose column names none."""


def write_campaign(
    folder: str | os.PathLike[str],
    title: str,
    rig: str,
    nominal: Mapping[str, Nominal],
    recordings: Sequence[Recording],
    file_format: str = "csv",
    source: str | None = None,
) -> Path:
    """Write a campaign folder that :func:`drillenv.recordings.read_campaign` reads back.

    Each recording becomes one file, named after it, its channels in their units. Numbers keep every digit. A column
    keeps its name where the format can hold it, and is named after its channel where it cannot.

    Args:
        folder: To be made; must not exist.
        title: Of the campaign, on one line.
        rig: "percussive-drill" or "one-body".
        nominal: What is believed of the rig, in SI.
        recordings: With samples in SI; ``file``, ``clock`` and ``findings`` are not written.
        file_format: "csv", "mat" (version 5), "mat73" (version 7.3), "h5" or "tdms".
        source: Where the recordings come from, if that should be said.

    Returns:
        The folder, absolute.

    Raises:
        InputError: the folder exists or cannot be made, or the campaign is none that could be read back.
    """
    ending = FILE_FORMATS[choice("file_format", file_format, tuple(FILE_FORMATS))]
    if not isinstance(recordings, Sequence) or not all(isinstance(each, Recording) for each in recordings):
        raise InputError(f"recordings is {shown(recordings)}: give a list of Recording")
    files = _file_names(recordings, ending)
    names = [_column_names(recording, file_format) for recording in recordings]
    document = {
        "format": FORMAT,
        "title": title,
        **({} if source is None else {"source": source}),
        "rig": rig,
        "nominal": _nominal_entries(nominal),
        "recordings": [
            _recording_entry(recording, file, columns)
            for recording, file, columns in zip(recordings, files, names, strict=True)
        ],
    }
    parse_document(document)  # what the reader would refuse is not written
    tables = [_table(recording, columns) for recording, columns in zip(recordings, names, strict=True)]
    target = _target(folder)
    temporary = target.with_name(f".{secrets.token_hex(4)}.{target.name}")
    write = _writer(file_format)
    try:
        temporary.mkdir()
        for recording, file, table in zip(recordings, files, tables, strict=True):
            write(temporary / file, table, recording.sample_rate)
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
        (temporary / DOCUMENT).write_text(text + "\n", encoding="utf-8")
        os.rename(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"cannot write {shown(str(folder))}: {reason}; give a new folder where you can write"
        ) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return target


# --------------------------------------------------------------------------------------------------------------------
# campaign.json


def _nominal_entries(nominal: Mapping[str, Nominal]) -> dict[str, dict[str, object]]:
    if not isinstance(nominal, Mapping) or not all(isinstance(each, Nominal) for each in nominal.values()):
        raise InputError(f"nominal is {shown(nominal)}: give a mapping from names to Nominal(value, std, unit)")
    return {
        name: {
            "value": each.value,
            **({} if each.std is None else {"std": each.std}),
            "unit": each.unit,
        }
        for name, each in nominal.items()
    }


def _recording_entry(recording: Recording, file: str, columns: Mapping[str, str]) -> dict[str, object]:
    setting = recording.setting
    return {
        "name": recording.name,
        "file": file,
        "sample_rate": recording.sample_rate,
        **({} if recording.starts is None else {"starts": recording.starts}),
        **({} if recording.use == "fit" else {"use": recording.use}),
        **(
            {}
            if setting is None
            else {
                "setting": {
                    "frequency": setting.frequency,
                    "amplitude": setting.amplitude,
                    "pressure": setting.pressure,
                }
            }
        ),
        "channels": {
            name: {"column": columns[name], "unit": channel.unit} for name, channel in recording.channels.items()
        },
    }


def _file_names(recordings: Sequence[Recording], ending: str) -> list[str]:
    """After the recordings where their names are plain, else numbered."""
    plain = [isinstance(each.name, str) and re.fullmatch(r"\w[\w.-]{0,60}", each.name, re.ASCII) for each in recordings]
    unlike = {str(each.name).lower() for each in recordings}
    if all(plain) and len(unlike) == len(recordings):
        return [f"{each.name}{ending}" for each in recordings]
    return [f"r{i:02d}{ending}" for i in range(1, len(recordings) + 1)]


def _column_names(recording: Recording, file_format: str) -> dict[str, str]:
    """Of each channel, its column's name, if the format can hold it."""
    found: dict[str, str] = {}
    for name, channel in recording.channels.items():
        column = channel.column if isinstance(channel.column, str) else ""
        fits = {
            "csv": bool(re.fullmatch(r"[^\s\"',;#%]([^\"',;\t]*[^\s\"',;])?", column)),
            "mat": bool(re.fullmatch(r"[A-Za-z]\w{0,30}", column, re.ASCII)),
            "mat73": bool(re.fullmatch(r"[A-Za-z]\w{0,62}", column, re.ASCII)),
            "h5": bool(re.fullmatch(r"[^./]+", column)),
            "tdms": bool(re.fullmatch(r"[^/']+/[^/']+", column)),
        }[file_format]
        if file_format == "tdms" and not fits:
            column = f"{GROUP}/{column}" if re.fullmatch(r"[^/']+", column) else f"{GROUP}/{name}"
        elif not fits:
            column = name
        found[name] = column
    # HDF5, MATLAB and LabVIEW would write one over the other
    return found if len(set(found.values())) == len(found) else {name: name for name in found}


# --------------------------------------------------------------------------------------------------------------------
# data files


def _table(recording: Recording, columns: Mapping[str, str]) -> dict[str, NDArray[np.float64]]:
    """The samples under their columns' names, in their units."""
    found: dict[str, NDArray[np.float64]] = {}
    for name, channel in recording.channels.items():
        where = f"channel {name} of {shown(recording.name)}"
        samples = np.asarray(channel.samples)
        if samples.ndim != 1 or samples.dtype.kind not in "iuf":
            raise InputError(f"{where} is {samples.dtype} of shape {samples.shape}: give one row of real numbers")
        if not LEAST_SAMPLES <= samples.size <= MOST_SAMPLES:
            raise InputError(f"{where} has {samples.size} samples: give {LEAST_SAMPLES} to {MOST_SAMPLES}")
        units = CHANNEL_UNITS[name]
        found[columns[name]] = samples.astype(np.float64) / units[unit_of(f"unit of {where}", channel.unit, units)]
    if len({samples.size for samples in found.values()}) > 1:
        raise InputError(f"the channels of {shown(recording.name)} differ in length: give channels sampled together")
    return found


def _writer(file_format: str) -> Callable[[Path, Columns, float], None]:
    return {"csv": _write_csv, "mat": _write_mat, "mat73": _write_mat73, "h5": _write_h5, "tdms": _write_tdms}[
        file_format
    ]


def _write_csv(path: Path, table: Columns, sample_rate: float) -> None:
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*(samples.tolist() for samples in table.values()), strict=True))


def _write_mat(path: Path, table: Columns, sample_rate: float) -> None:
    from scipy.io import savemat

    savemat(path, dict(table), do_compression=True, oned_as="column")


def _write_mat73(path: Path, table: Columns, sample_rate: float) -> None:
    """HDF5 behind the 512 bytes by which MATLAB knows its own, each array with its class."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for column, samples in table.items():
            dataset = file.create_dataset(column, data=samples.reshape(1, -1))
            dataset.attrs.create("MATLAB_class", np.bytes_("double"))
    text = b"MATLAB 7.3 MAT-file, Platform: drillenv, HDF5 schema 1.00 ."
    with open(path, "r+b") as file:
        file.write(text.ljust(116) + bytes(8) + b"\x00\x02IM")


def _write_h5(path: Path, table: Columns, sample_rate: float) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for column, samples in table.items():
            file.create_dataset(column, data=samples, compression="gzip", shuffle=True)


def _write_tdms(path: Path, table: Columns, sample_rate: float) -> None:
    from nptdms import ChannelObject, TdmsWriter

    every = {"wf_increment": 1.0 / sample_rate}
    channels = []
    for column, samples in table.items():
        group, _, name = column.partition("/")
        channels.append(ChannelObject(group, name, samples, properties=every))
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)


def check_new(folder: str | os.PathLike[str]) -> None:
    """Find out before long work whether a folder can be made of that name.

    Raises:
        InputError: there is something of that name, or it is no name.
    """
    _target(folder)


def _target(folder: str | os.PathLike[str]) -> Path:
    try:
        text = os.fspath(folder)
        if not isinstance(text, str) or not text.strip() or "\0" in text:
            raise TypeError
        target = Path(text).resolve()
    except (TypeError, OSError, RuntimeError):
        raise InputError(f"folder is {shown(folder)}: give the name of a new folder") from None
    if os.path.lexists(text) or not target.name:
        raise InputError(f"{shown(text)} exists already: give the name of a new folder")
    return target
