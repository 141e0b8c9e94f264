"""What is written is read back, in every format, and nothing is written by halves."""

import json
import os
from dataclasses import replace
from types import MappingProxyType

import h5py
import numpy as np
import pytest
import scipy.io

from drillenv.checks import InputError
from drillenv.recordings import Channel, Nominal, check_quality, read_campaign, write, write_campaign

FORMATS = ["csv", "mat", "mat73", "h5", "tdms"]


def same(first, second) -> None:
    """The two campaigns say the same, to the rounding of a change of units."""
    assert (first.title, first.rig, first.source) == (second.title, second.rig, second.source)
    assert dict(first.nominal) == dict(second.nominal)
    for one, other in zip(first.recordings, second.recordings, strict=True):
        for field in ("name", "sample_rate", "starts", "setting", "use"):
            assert getattr(one, field) == getattr(other, field)
        assert list(one.channels) == list(other.channels)
        for name, channel in one.channels.items():
            assert channel.unit == other.channels[name].unit
            np.testing.assert_allclose(channel.samples, other.channels[name].samples, rtol=4e-16, atol=0)


@pytest.mark.parametrize("file_format", FORMATS)
@pytest.mark.parametrize("which", ["drill", "body"])
def test_round_trip(file_format, which, request, tmp_path):
    campaign = request.getfixturevalue(which)
    held_out = replace(campaign.recordings[-1], use="held-out")
    recordings = (*campaign.recordings[:-1], held_out)
    parts = (campaign.title, campaign.rig, campaign.nominal, recordings)
    folder = write_campaign(tmp_path / "new", *parts, file_format=file_format, source="a simulation")
    assert folder == tmp_path / "new"
    assert os.listdir(tmp_path) == ["new"]
    read = read_campaign(folder)
    same(read, replace(campaign, recordings=recordings, source="a simulation"))
    again = write_campaign(
        tmp_path / "again", read.title, read.rig, read.nominal, read.recordings, file_format, read.source
    )
    same(read_campaign(again), read)
    assert check_quality(read) == ()


@pytest.mark.parametrize("file_format", FORMATS)
def test_what_is_no_number_survives(file_format, drill, spoil, samples_of, tmp_path):
    force = samples_of(drill, "r01")["force"].copy()
    force[[3, 5, 7]] = np.nan, np.inf, -np.inf
    spoiled = spoil(drill, "r01", force=force)
    folder = write_campaign(tmp_path / "new", "t", drill.rig, drill.nominal, spoiled.recordings, file_format)
    np.testing.assert_allclose(samples_of(read_campaign(folder), "r01")["force"], force, rtol=4e-16, atol=0)


@pytest.mark.parametrize("file_format", FORMATS)
@pytest.mark.parametrize(
    "column", ["x", "a b", "group/x", "a/b/c", "force, measured", '"', "", "1st", ".", "é", "x" * 80, "#x"]
)
def test_any_column_name_is_held_or_replaced(file_format, column, drill, tmp_path):
    recording = drill.recordings[0]
    channels = {**recording.channels, "force": replace(recording.channels["force"], column=column)}
    recording = replace(recording, channels=MappingProxyType(channels))
    folder = write_campaign(tmp_path / "new", "t", drill.rig, drill.nominal, [recording], file_format)
    read = read_campaign(folder).recordings[0]
    np.testing.assert_allclose(read.channels["force"].samples, channels["force"].samples, rtol=4e-16, atol=0)
    if column == "x":
        assert read.channels["force"].column == {"tdms": "rig/x"}.get(file_format, "x")


def test_the_files_are_what_other_programs_expect(drill, tmp_path):
    recording = drill.recordings[0]
    force = recording.channels["force"].samples / 1e3
    parts = ("t", drill.rig, drill.nominal, [recording])
    mat = scipy.io.loadmat(write_campaign(tmp_path / "mat", *parts, file_format="mat") / "r01.mat")
    np.testing.assert_array_equal(mat["force_kN"][:, 0], force)
    path = write_campaign(tmp_path / "mat73", *parts, file_format="mat73") / "r01.mat"
    head = path.read_bytes()[:128]
    assert head.startswith(b"MATLAB 7.3 MAT-file")
    assert head[124:] == b"\x00\x02IM"
    with h5py.File(path) as file:
        assert file["force_kN"].attrs["MATLAB_class"] == b"double"
        assert file["force_kN"].shape == (1, force.size)
    with h5py.File(write_campaign(tmp_path / "h5", *parts, file_format="h5") / "r01.h5") as file:
        np.testing.assert_array_equal(file["force_kN"], force)
    folder = write_campaign(tmp_path / "csv", *parts)
    table = np.loadtxt(folder / "r01.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 1], force)
    document = json.loads((folder / "campaign.json").read_text())
    assert document["recordings"][0]["channels"]["force"] == {"column": "force_kN", "unit": "kN"}


def test_recordings_without_plain_names_get_numbered_files(drill, tmp_path):
    recordings = [replace(drill.recordings[0], name="first / shift"), replace(drill.recordings[1], name="R\u00e9")]
    folder = write_campaign(tmp_path / "new", "t", drill.rig, drill.nominal, recordings)
    assert sorted(os.listdir(folder)) == ["campaign.json", "r01.csv", "r02.csv"]
    assert [each.name for each in read_campaign(folder).recordings] == ["first / shift", "R\u00e9"]


def test_nothing_is_written_by_halves(drill, tmp_path, monkeypatch):
    written = []

    def breaks(path, table, sample_rate):
        if written:
            raise OSError(28, "No space left on device")
        written.append(path)
        path.write_text("x")

    monkeypatch.setattr(write, "_writer", lambda file_format: breaks)
    with pytest.raises(InputError, match="No space left on device"):
        write_campaign(tmp_path / "new", "t", drill.rig, drill.nominal, drill.recordings)
    assert len(written) == 1
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("there", ["folder", "file", "link"])
def test_what_exists_is_left_alone(there, drill, tmp_path):
    target = tmp_path / "new"
    {"folder": target.mkdir, "file": target.touch, "link": lambda: target.symlink_to("nowhere")}[there]()
    with pytest.raises(InputError, match="exists already"):
        write_campaign(target, "t", drill.rig, drill.nominal, drill.recordings)
    assert os.listdir(tmp_path) == ["new"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"folder": ""}, "new folder"),
        ({"folder": 3}, "new folder"),
        ({"folder": "missing/new"}, "No such file or directory"),
        ({"title": "a\nb"}, "title"),
        ({"rig": "lathe"}, "percussive-drill, one-body"),
        ({"file_format": "xlsx"}, "csv, mat, mat73, h5, tdms"),
        ({"nominal": {}}, "shaker_mass"),
        ({"nominal": {"shaker_mass": 265.0}}, "Nominal(value, std, unit)"),
        ({"nominal": 3}, "Nominal(value, std, unit)"),
        ({"recordings": []}, "at least one recording"),
        ({"recordings": ["r01"]}, "list of Recording"),
        ({"recordings": None}, "list of Recording"),
        ({"source": ""}, "source"),
    ],
)
def test_what_could_not_be_read_back_is_not_written(change, says, drill, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = {"folder": "new", "title": "t", "rig": drill.rig, "nominal": drill.nominal, "recordings": drill.recordings}
    with pytest.raises(InputError) as caught:
        write_campaign(**{**given, **change})
    assert says in str(caught.value)
    assert str(caught.value).isprintable()
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("channel", "says"),
    [
        (Channel(np.zeros((2, 3)), "N", "x"), "one row of real numbers"),
        (Channel(np.zeros(4) * 1j, "N", "x"), "one row of real numbers"),
        (Channel(np.zeros(1), "N", "x"), "has 1 samples"),
        (Channel(np.zeros(5), "N", "x"), "differ in length"),
        (Channel(np.zeros(4), "lbf", "x"), "N or kN"),
    ],
)
def test_samples_that_could_not_be_read_back_are_not_written(channel, says, drill, tmp_path):
    recording = replace(
        drill.recordings[0], channels={"acceleration": Channel(np.zeros(4), "g", "a"), "force": channel}
    )
    with pytest.raises(InputError) as caught:
        write_campaign(tmp_path / "new", "t", drill.rig, drill.nominal, [recording])
    assert says in str(caught.value)
    assert os.listdir(tmp_path) == []


def test_a_constant_to_be_estimated_stays_one(body, tmp_path):
    nominal = {"mass": Nominal(None, None, "kg"), "offset": Nominal(-3.0, None, "N")}
    folder = write_campaign(tmp_path / "new", "t", body.rig, nominal, body.recordings)
    assert dict(read_campaign(folder).nominal) == nominal
