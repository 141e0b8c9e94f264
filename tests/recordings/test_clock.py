"""The file's own time under any usual name, held against the stated sample rate."""

import json

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from drillenv.recordings import check_quality, read_campaign

RATE = 25600.0
SAMPLES = 5120
FORCE = np.random.default_rng(1).normal(size=SAMPLES)
NAMES = [
    ("Time", 1.0),
    ("t", 1.0),
    ("t [s]", 1.0),
    ("Time (ms)", 1e-3),
    ("X_Value", 1.0),
    ("Zeit", 1.0),
    ("Zeit/s", 1.0),
    ("time_ms", 1e-3),
    ("Elapsed Time", 1.0),
    ("elapsed", 1e-3),
    ("time_s", 1.0),
]


def clock_findings(folder, file):
    """What reading and checking say of the time of a recording of a force alone."""
    document = {
        "format": "drillenv-campaign/1",
        "title": "clocks",
        "rig": "one-body",
        "nominal": {"mass": {"value": 1.0, "unit": "kg"}},
        "recordings": [
            {
                "name": "r",
                "file": file,
                "sample_rate": RATE,
                "channels": {"force": {"column": "F" if not file.endswith(".tdms") else "g/F", "unit": "N"}},
            }
        ],
    }
    (folder / "campaign.json").write_text(json.dumps(document))
    campaign = read_campaign(folder)
    found = [each for each in check_quality(campaign) if each.kind in ("sample-rate", "time-gap")]
    return campaign.recordings[0], found


def write_csv(path, name, time, digits=9):
    rows = [f"{t:.{digits}f},{f:.6f}" for t, f in zip(time.tolist(), FORCE.tolist(), strict=True)]
    path.write_text(f"{name},F\n" + "\n".join(rows) + "\n")


@pytest.mark.parametrize(("name", "unit"), NAMES)
def test_a_sound_clock_and_one_of_one_percent_off(tmp_path, name, unit):
    time = 3.0 + np.arange(SAMPLES) / RATE
    write_csv(tmp_path / "r.csv", name, time / unit)
    recording, found = clock_findings(tmp_path, "r.csv")
    np.testing.assert_allclose(recording.clock, time, rtol=1e-8)
    assert found == []
    write_csv(tmp_path / "r.csv", name, 1.01 * time / unit)
    _, found = clock_findings(tmp_path, "r.csv")
    assert [(each.kind, each.severity) for each in found] == [("sample-rate", "exclude recording")]
    assert "25347" in found[0].sentence  # 25600 / 1.01


def test_a_clock_written_with_four_digits(tmp_path):
    write_csv(tmp_path / "r.csv", "Time", np.arange(SAMPLES) / RATE, digits=4)
    recording, found = clock_findings(tmp_path, "r.csv")
    assert recording.clock is not None
    assert found == []
    write_csv(tmp_path / "r.csv", "Time", 1.01 * np.arange(SAMPLES) / RATE, digits=4)
    assert [each.kind for each in clock_findings(tmp_path, "r.csv")[1]] == ["sample-rate"]


def test_missing_time_is_found(tmp_path):
    time = np.arange(SAMPLES) / RATE
    time[3000:] += 0.004
    write_csv(tmp_path / "r.csv", "Zeit", time)
    found = clock_findings(tmp_path, "r.csv")[1]
    assert [each.kind for each in found] == ["time-gap"]
    assert found[0].start == pytest.approx(3000 / RATE, abs=2 / RATE)


@pytest.mark.parametrize(
    "samples",
    [
        20.0 + 0.1 * np.sin(np.arange(SAMPLES) / 500),  # a temperature
        np.zeros(SAMPLES),
        np.sqrt(np.arange(SAMPLES)),
        -np.arange(SAMPLES) / RATE,
        np.random.default_rng(2).uniform(size=SAMPLES),
    ],
)
def test_what_is_no_time_is_not_taken_for_one(tmp_path, samples):
    write_csv(tmp_path / "r.csv", "t", samples)
    recording, found = clock_findings(tmp_path, "r.csv")
    assert recording.clock is None
    assert found == []


def test_a_unit_that_cannot_be_told_is_said(tmp_path):
    write_csv(tmp_path / "r.csv", "Time", 45000.0 + np.arange(SAMPLES) / RATE / 86400.0, digits=12)  # days
    recording, found = clock_findings(tmp_path, "r.csv")
    assert recording.clock is None
    assert found == []
    assert ["'Time' does not say its unit" in str(each) for each in recording.findings] == [True]


def test_times_of_day_as_text_do_no_harm(tmp_path):
    rows = [f"12:00:{i / RATE:09.6f},{f:.6f}" for i, f in enumerate(FORCE.tolist())]
    (tmp_path / "r.csv").write_text("Time,F\n" + "\n".join(rows) + "\n")
    recording, found = clock_findings(tmp_path, "r.csv")
    assert recording.clock is None
    assert found == []
    np.testing.assert_allclose(recording.channels["force"].samples, FORCE, atol=1e-6)


def test_a_line_of_units_gives_the_unit_of_the_time(tmp_path):
    rows = [f"{1e3 * i / RATE:.6f},{f:.6f}" for i, f in enumerate(FORCE.tolist())]
    (tmp_path / "r.csv").write_text("Time,F\nms,kN\n" + "\n".join(rows) + "\n")
    recording, found = clock_findings(tmp_path, "r.csv")
    np.testing.assert_allclose(recording.clock, np.arange(SAMPLES) / RATE, atol=1e-8)
    assert found == []
    assert ["gives 'F' in kN" in str(each) for each in recording.findings] == [True]  # campaign.json says N


@pytest.mark.parametrize("off", [1.0, 1.01])
@pytest.mark.parametrize("ending", [".mat", ".h5", ".tdms"])
def test_other_formats(tmp_path, ending, off):
    path, time = tmp_path / f"r{ending}", off * np.arange(SAMPLES) / RATE
    if ending == ".mat":
        savemat(path, {"F": FORCE, "t": time})
    elif ending == ".h5":
        with h5py.File(path, "w") as file:
            file["F"], file["Time"] = FORCE, 1e3 * time
            file["Time"].attrs["units"] = "ms"
    else:
        with TdmsWriter(path) as writer:
            writer.write_segment([ChannelObject("g", "Zeit", time), ChannelObject("g", "F", FORCE)])
    recording, found = clock_findings(tmp_path, path.name)
    np.testing.assert_allclose(recording.clock, time, rtol=1e-12)
    assert [each.kind for each in found] == ([] if off == 1.0 else ["sample-rate"])
