"""A campaign is read as its format says, or refused in one line that says what to do."""

import copy
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

import drillenv
from drillenv.checks import InputError
from drillenv.recordings import Nominal, read_campaign

# The example of the format, its numbers typed in again below in SI.
EXAMPLE = {
    "format": "drillenv-campaign/1",
    "title": "sandstone-2, indenter-30, first shift",
    "rig": "percussive-drill",
    "nominal": {
        "shaker_mass": {"value": 265.0, "std": 1.0, "unit": "kg"},
        "indenter_mass": {"value": 3.0, "std": 0.01, "unit": "kg"},
        "stiffness": {"value": 68850.0, "std": 2000.0, "unit": "N/m"},
        "damping": {"value": 2450.0, "std": 75.0, "unit": "N*s/m"},
        "drive_gain": {"value": 1.0, "std": 0.015, "unit": "1"},
        "pressure_gain": {"value": 1.0, "std": 0.02, "unit": "1"},
        "loading_stiffness": {"value": 21.4e6, "std": 0.56e6, "unit": "N/m"},
        "unloading_stiffness": {"value": 25.05e6, "std": 1.0e6, "unit": "N/m"},
    },
    "recordings": [
        {
            "name": "r01",
            "file": "r01.csv",
            "sample_rate": 25600.0,
            "starts": "running",
            "setting": {"frequency": 60.0, "amplitude": 0.45, "pressure": 1.0},
            "channels": {
                "excitation": {"column": "excitation_V", "unit": "V"},
                "force": {"column": "force_kN", "unit": "kN"},
                "acceleration": {"column": "acceleration_g", "unit": "g"},
            },
        }
    ],
}
ROWS = "excitation_V,force_kN,acceleration_g\n0.1,2,10\n-0.2,0,-20\n0.3,0.5,0\n"


@pytest.fixture
def folder(tmp_path):
    """The example, on disk."""
    place = tmp_path / "campaign"
    place.mkdir()
    (place / "r01.csv").write_text(ROWS)
    (place / "campaign.json").write_text(json.dumps(EXAMPLE))
    return place


def rewritten(folder, change) -> Path:
    document = copy.deepcopy(EXAMPLE)
    document = change(document) or document
    (folder / "campaign.json").write_text(json.dumps(document))
    return folder


def refusal(folder) -> str:
    with pytest.raises(InputError) as caught:
        read_campaign(folder)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 600
    return message


def test_the_example_of_the_format(folder):
    campaign = read_campaign(folder)
    assert (campaign.title, campaign.rig) == ("sandstone-2, indenter-30, first shift", "percussive-drill")
    assert campaign.folder == folder
    assert campaign.source is None
    assert campaign.nominal["unloading_stiffness"] == Nominal(25.05e6, 1.0e6, "N/m")
    assert len(campaign.nominal) == 8
    (recording,) = campaign.recordings
    assert (recording.name, recording.file, recording.sample_rate) == ("r01", "r01.csv", 25600.0)
    assert (recording.starts, recording.use) == ("running", "fit")
    assert recording.setting == drillenv.Setting(60.0, 0.45, 1.0)
    assert recording.findings == ()
    assert recording.size == 3
    assert recording.seconds == pytest.approx(3 / 25600)
    np.testing.assert_allclose(recording.time, [0.0, 3.90625e-5, 7.8125e-5])
    force = recording.channels["force"]
    assert (force.unit, force.column) == ("kN", "force_kN")
    np.testing.assert_allclose(force.samples, [2000.0, 0.0, 500.0])
    np.testing.assert_allclose(recording.channels["acceleration"].samples, [98.0665, -196.133, 0.0])
    np.testing.assert_allclose(recording.channels["excitation"].samples, [0.1, -0.2, 0.3])


COLUMNS = {"u": [100.0, -200.0, 300.0], "f": [2.0, 0.0, 0.5], "a": [1.0, -2.0, 0.25]}
UNITS = {"excitation": "mV", "force": "N", "acceleration": "m/s^2"}


def write_csv(path):
    path.write_text(
        "u,f,a\n" + "\n".join(",".join(map(str, row)) for row in zip(*COLUMNS.values(), strict=True)) + "\n"
    )


def write_mat(path):
    scipy.io.savemat(path, {name: np.array([values]).T for name, values in COLUMNS.items()})


def write_mat73(path):
    """As MATLAB saves with -v7.3: 512 bytes of its own, then HDF5 with the dimensions turned round."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file[name] = np.array([values])
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_h5(path):
    with h5py.File(path, "w") as file:
        for name, values in COLUMNS.items():
            file.create_dataset(name, data=np.array(values, dtype="f4"), compression="gzip")


def write_tdms(path):
    with TdmsWriter(path) as writer:
        for name, values in COLUMNS.items():
            writer.write_segment([ChannelObject("rig", name, np.array(values))])


@pytest.mark.parametrize(
    ("write", "ending", "prefix"),
    [
        (write_csv, "csv", ""),
        (write_mat, "mat", ""),
        (write_mat73, "mat", ""),
        (write_h5, "h5", ""),
        (write_tdms, "tdms", "rig/"),
    ],
)
def test_every_format_and_units(folder, write, ending, prefix):
    write(folder / f"data.{ending}")

    def change(document):
        recording = document["recordings"][0]
        recording["file"] = f"data.{ending}"
        for (channel, unit), column in zip(UNITS.items(), COLUMNS, strict=True):
            recording["channels"][channel] = {"column": prefix + column, "unit": unit}

    channels = read_campaign(rewritten(folder, change)).recordings[0].channels
    np.testing.assert_allclose(channels["excitation"].samples, [0.1, -0.2, 0.3], rtol=1e-15)
    np.testing.assert_array_equal(channels["force"].samples, [2.0, 0.0, 0.5])
    np.testing.assert_array_equal(channels["acceleration"].samples, [1.0, -2.0, 0.25])
    assert all(channel.samples.dtype == np.float64 for channel in channels.values())


def test_one_body(tmp_path):
    document = {
        "format": "drillenv-campaign/1",
        "title": "an axis",
        "source": "somewhere",
        "rig": "one-body",
        "nominal": {
            "mass": {"value": 500.0, "std": 5.0, "unit": "g"},
            "damping": {"value": None, "unit": "N*s/m"},
            "stiffness": {"value": 15.0, "std": 1.0, "unit": "N/mm"},
        },
        "recordings": [
            {
                "name": "a",
                "file": "data/a.csv",
                "sample_rate": 1000.0,
                "use": "held-out",
                "channels": {"position": {"column": "x", "unit": "um"}, "velocity": {"column": "v", "unit": "mm/s"}},
            }
        ],
    }
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.csv").write_text("x,v\n1000,2\n-500,3\n")
    (tmp_path / "campaign.json").write_text(json.dumps(document))
    campaign = read_campaign(str(tmp_path))
    assert campaign.source == "somewhere"
    assert campaign.nominal["mass"] == Nominal(0.5, 0.005, "kg")
    assert campaign.nominal["damping"] == Nominal(None, None, "N*s/m")
    assert campaign.nominal["stiffness"] == Nominal(15000.0, 1000.0, "N/m")
    (recording,) = campaign.recordings
    assert (recording.use, recording.starts, recording.setting) == ("held-out", None, None)
    np.testing.assert_allclose(recording.channels["position"].samples, [1e-3, -5e-4])
    np.testing.assert_allclose(recording.channels["velocity"].samples, [2e-3, 3e-3])


def put(path, value):
    """A change that puts a value at a path of keys; without the last key where the value is ``drop``."""

    def change(document):
        place = document
        for key in path[:-1]:
            place = place[key]
        if value is drop:
            del place[path[-1]]
        else:
            place[path[-1]] = value

    return change


def drop():
    """Stands for taking a key away."""


R = ("recordings", 0)
REFUSED = [
    (("format",), "drillenv-campaign/2", "'drillenv-campaign/1'"),
    (("format",), drop, "'format'"),
    (("titel",), "x", "unknown key 'titel'", "did you mean title"),
    (("title",), drop, "'title'"),
    (("title",), "two\nlines", "title", "one line"),
    (("title",), 3, "title"),
    (("rig",), "rotary-drill", "percussive-drill, one-body"),
    (("nominal",), [], "nominal"),
    (("nominal", "mass"), {"value": 1.0, "std": 1.0, "unit": "kg"}, "unknown key 'mass'"),
    (("nominal", "damping"), drop, "'damping'"),
    (("nominal", "damping"), 2450.0, "nominal.damping"),
    (("nominal", "damping", "std"), drop, "no std"),
    (("nominal", "damping", "std"), 0, "above 0"),
    (("nominal", "damping", "std"), -1.0, "nominal.damping.std"),
    (("nominal", "damping", "value"), None, "std but no value"),
    (("nominal", "damping", "value"), "2450", "not a number"),
    (("nominal", "damping", "value"), True, "not a number"),
    (("nominal", "damping", "value"), 2.45, "damping", "kN s/m"),
    (("nominal", "damping", "unit"), "N*m/s", "N*s/m"),
    (("nominal", "damping", "unit"), None, "N*s/m"),
    (("nominal", "damping", "sigma"), 1.0, "unknown key 'sigma'"),
    (("nominal", "unloading_stiffness", "value"), 1e7, "give energy away"),
    (("recordings",), [], "at least one recording"),
    (("recordings",), {}, "at least one recording"),
    (("recordings",), "r01", "at least one recording"),
    ((*R,), 7, "recordings[0]"),
    ((*R, "name"), "", "name"),
    ((*R, "name"), "a\x07b", "name"),
    ((*R, "name"), "n" * 200, "at most 100"),
    ((*R, "note"), "x", "unknown key 'note'"),
    ((*R, "sample_rate"), 25.6, "was it in kHz? then write 25600"),
    ((*R, "sample_rate"), 0, "sample_rate"),
    ((*R, "sample_rate"), 10**400, "sample_rate"),
    ((*R, "starts"), "warm", "running, fresh"),
    ((*R, "starts"), drop, "'starts'"),
    ((*R, "use"), "test", "fit, held-out"),
    ((*R, "setting"), drop, "'setting'"),
    ((*R, "setting", "frequency"), drop, "'frequency'"),
    ((*R, "setting", "frequency"), 6000, "rpm"),
    ((*R, "setting", "pressure"), 100.0, "kPa"),
    ((*R, "setting", "phase"), 0.0, "unknown key 'phase'"),
    ((*R, "channels"), {}, "channels is empty"),
    ((*R, "channels", "torque"), {"column": "x", "unit": "V"}, "unknown key 'torque'"),
    ((*R, "channels", "force"), "force_kN", "channels.force"),
    ((*R, "channels", "force", "unit"), "lbf", "N or kN"),
    ((*R, "channels", "force", "unit"), "g", "N or kN"),
    ((*R, "channels", "force", "unit"), ["N"], "N or kN"),
    ((*R, "channels", "force", "unit"), drop, "'unit'"),
    ((*R, "channels", "force", "column"), "force_N", "no column 'force_N'", "'force_kN'"),
    ((*R, "channels", "force", "column"), "excitation_V", "twice"),
    ((*R, "channels", "force", "column"), 3, "column"),
    ((*R, "file"), "r02.csv", "'r02.csv' is not in the campaign folder"),
    ((*R, "file"), "r01.xlsx", ".csv, .mat, .h5, .tdms"),
    ((*R, "file"), "../campaign/r01.csv", "inside the campaign folder"),
    ((*R, "file"), "data/../r01.csv", "inside the campaign folder"),
    ((*R, "file"), "/etc/passwd.csv", "inside the campaign folder"),
    ((*R, "file"), "~/r01.csv", "inside the campaign folder"),
    ((*R, "file"), "C:r01.csv", "inside the campaign folder"),
    ((*R, "file"), "C:\\r01.csv", "inside the campaign folder"),
    ((*R, "file"), "..\\r01.csv", "inside the campaign folder"),
    ((*R, "file"), "\\\\host\\r01.csv", "inside the campaign folder"),
    ((*R, "file"), "r01.csv\0", "file"),
    ((*R, "file"), None, "file"),
    ((*R, "file"), "x" * 300 + ".csv", "name too long"),
]


@pytest.mark.parametrize(("path", "value", "says"), [(case[0], case[1], case[2:]) for case in REFUSED])
def test_a_campaign_that_says_something_else_is_refused(folder, path, value, says):
    message = refusal(rewritten(folder, put(path, value)))
    for part in says:
        assert part.lower() in message.lower()
    assert "campaign" in message


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no JSON at line 1"),
        ('{"format": ', "no JSON at line 1"),
        ("[]", "give an object"),
        ("null", "give an object"),
        ('{"format": "drillenv-campaign/1", "format": "drillenv-campaign/1"}', "'format' twice"),
        (json.dumps(EXAMPLE).replace("2450.0", "NaN"), "NaN"),
        (json.dumps(EXAMPLE).replace("2450.0", "-Infinity"), "-Infinity"),
        (json.dumps(EXAMPLE).replace("2450.0", "1e999"), "finite"),
        (json.dumps(EXAMPLE).replace("2450.0", "9" * 5000), "too many digits"),
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        (json.dumps(EXAMPLE) + " " * 5_000_000, "larger than 4 MiB"),
        (json.dumps(EXAMPLE).replace("first shift", "\\ud800"), "title"),
    ],
)
def test_what_is_no_such_json_is_refused(folder, text, says):
    (folder / "campaign.json").write_text(text)
    assert says in refusal(folder)


def test_json_must_be_utf8_and_may_begin_with_a_mark(folder):
    (folder / "campaign.json").write_bytes(json.dumps(EXAMPLE, ensure_ascii=False).encode("utf-8-sig"))
    assert read_campaign(folder).title == EXAMPLE["title"]
    (folder / "campaign.json").write_bytes(b'{"title": "\xff"}')
    assert "UTF-8" in refusal(folder)


@pytest.mark.parametrize("given", [None, 3, "", " ", "a\0b", b"x", "missing", "r01.csv"])
def test_what_is_no_folder_is_refused(folder, given, monkeypatch):
    monkeypatch.chdir(folder)
    with pytest.raises(InputError, match="give the folder") as caught:
        read_campaign(given)
    assert str(caught.value).isprintable()


def test_a_folder_without_a_document(tmp_path):
    assert "'campaign.json' is not in the campaign folder" in refusal(tmp_path)


def test_two_recordings_need_two_names_and_two_files(folder):
    def twice(document, **changed):
        document["recordings"].append({**copy.deepcopy(document["recordings"][0]), **changed})

    assert "'r01' twice" in refusal(rewritten(folder, twice))
    assert "both read 'r01.csv'" in refusal(rewritten(folder, lambda document: twice(document, name="r02")))
    shutil.copy(folder / "r01.csv", folder / "r02.csv")
    campaign = read_campaign(rewritten(folder, lambda document: twice(document, name="r02", file="r02.csv")))
    assert [recording.name for recording in campaign.recordings] == ["r01", "r02"]


def test_links_may_not_lead_out_of_the_folder(folder, tmp_path):
    outside = tmp_path / "outside.csv"
    shutil.move(folder / "r01.csv", outside)
    (folder / "r01.csv").symlink_to(outside)
    assert "link out of the campaign folder" in refusal(folder)
    (folder / "r01.csv").unlink()
    (folder / "data").symlink_to(tmp_path)
    rewritten(folder, put((*R, "file"), "data/outside.csv"))
    assert "link out of the campaign folder" in refusal(folder)
    (folder / "r01.csv").symlink_to("r01.csv")
    rewritten(folder, lambda document: None)
    assert "cannot read 'r01.csv'" in refusal(folder)
    (folder / "r01.csv").unlink()
    shutil.move(outside, folder / "inside.csv")
    (folder / "r01.csv").symlink_to("inside.csv")
    assert read_campaign(folder).recordings[0].size == 3
    # the folder itself, and campaign.json, go by the same rule
    (tmp_path / "link").symlink_to(folder)
    assert read_campaign(tmp_path / "link").folder == folder
    shutil.move(folder / "campaign.json", tmp_path / "campaign.json")
    (folder / "campaign.json").symlink_to(tmp_path / "campaign.json")
    assert "link out of the campaign folder" in refusal(folder)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_only_regular_files_are_opened(folder):
    (folder / "r01.csv").unlink()
    os.mkfifo(folder / "r01.csv")  # to open it would wait for ever
    assert "is no file" in refusal(folder)
    (folder / "r01.csv").unlink()
    (folder / "r01.csv").mkdir()
    assert "is no file" in refusal(folder)


def test_too_large_a_file_is_refused_unread(folder):
    with open(folder / "r01.csv", "ab") as file:
        file.truncate(3 * 2**30)  # sparse
    assert "larger than 2 GiB" in refusal(folder)


def test_files_swapped_between_formats_are_refused(folder):
    write_h5(folder / "data.h5")
    for ending in ("csv", "mat", "tdms"):
        shutil.copy(folder / "data.h5", folder / f"data.{ending}")
        refusal(rewritten(folder, put((*R, "file"), f"data.{ending}")))
    shutil.copy(folder / "r01.csv", folder / "data.h5")
    assert "no readable HDF5 file" in refusal(rewritten(folder, put((*R, "file"), "data.h5")))


def test_reading_imports_no_more_than_it_needs(folder):
    code = (
        "import sys\n"
        "from drillenv.recordings import read_campaign\n"
        f"read_campaign({str(folder)!r})\n"
        "heavy = ('numba', 'pandas', 'scipy', 'h5py', 'nptdms', 'matplotlib')\n"
        "print(*(name for name in heavy if name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("\n", "")


def test_public_names():
    import drillenv.recordings as room

    for name in room.__all__:
        assert getattr(room, name).__name__ == name
        assert name in dir(room)
    with pytest.raises(AttributeError):
        room.nothing  # noqa: B018


@pytest.mark.parametrize("name", [f"practice/p{i:02d}" for i in range(1, 13)] + ["real/emps", "real/cyberdiver-a"])
def test_shared_campaigns(shared, name):
    campaign = read_campaign(shared / name)
    document = json.loads((shared / name / "campaign.json").read_text())
    assert [recording.name for recording in campaign.recordings] == [entry["name"] for entry in document["recordings"]]
    size = {"practice": 12800, "real/emps": 24841, "real/cyberdiver-a": 900}[name.split("/p")[0]]
    for recording in campaign.recordings:
        assert recording.size == size
        assert recording.findings == ()
        for channel in recording.channels.values():
            assert np.isfinite(channel.samples).all()
