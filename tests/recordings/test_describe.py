"""``drillenv campaign init`` on folders laid out as laboratories lay them out."""

import io
import json

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter
from scipy.io import savemat

from drillenv import cli
from drillenv.recordings import check_quality, read_campaign
from drillenv.recordings.units import named_unit, without_unit

G = 9.80665
RATE = 25600.0
SETTINGS = [(118.0, 0.55, 0.8), (61.3, 0.45, 1.2), (93.0, 0.36, 1.5)]  # the first recordings of the fixture drill


class Terminal(io.StringIO):
    """Answers typed by a person."""

    def isatty(self):
        return True


@pytest.fixture
def init(capsys, monkeypatch):
    """Runs the command; returns its exit code, what it prints and what it asks or complains of."""

    def run(folder, *options, answers=None):
        monkeypatch.setattr("sys.stdin", io.StringIO("4\n1.0\n") if answers is None else Terminal(answers))
        code = cli.main(["campaign", "init", str(folder), *options])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


@pytest.fixture
def signals(drill):
    """(excitation V, force N, acceleration m/s^2) of three recordings."""
    return [
        [each.channels[name].samples for name in ("excitation", "force", "acceleration")]
        for each in drill.recordings[:3]
    ]


def tdms_in_german(folder, signals):
    for (u, f, a), (hz, _, bar) in zip(signals, SETTINGS, strict=True):
        name = f"Versuch_{hz:g}Hz_{bar:g}bar.tdms".replace(".", ",", bar != 1)
        step = {"wf_increment": 1.0 / RATE}
        with TdmsWriter(folder / name) as writer:
            writer.write_segment(
                [
                    RootObject({"Pruefer": "M. Muster"}),
                    ChannelObject("Messung", "Anregung", u, {**step, "unit_string": "V"}),
                    ChannelObject("Messung", "Kraft", f / 1e3, {**step, "unit_string": "kN"}),
                    ChannelObject("Messung", "Beschleunigung", a / G, {**step, "unit_string": "g"}),
                ]
            )


def tdms_of_a_daq(folder, signals):
    for i, (u, f, a) in enumerate(signals, 1):
        time = np.arange(u.size) / RATE
        with TdmsWriter(folder / f"log{i}.tdms") as writer:
            writer.write_segment(
                [
                    ChannelObject("Untitled", "Time", time, {"unit_string": "s"}),
                    ChannelObject("Untitled", "cDAQ1Mod1/ai0", f, {"unit_string": "Newtons"}),
                    ChannelObject("Untitled", "cDAQ1Mod1/ai1", a, {"unit_string": "m/s^2"}),
                    ChannelObject("Untitled", "cDAQ1Mod2/ai0", u, {"unit_string": "Volts"}),
                ]
            )


def csv_of_a_spreadsheet(folder, signals):
    for i, (u, f, a) in enumerate(signals, 1):
        lines = ["Messung Sandstein \u00b5m", "", "Zeit;Anregung;Kraft;Beschl.;Temperatur", "ms;V;kN;m/s\u00b2;\u00b0C"]
        for t, *values in zip(
            (1e3 * np.arange(u.size) / RATE).tolist(), u.tolist(), (f / 1e3).tolist(), a.tolist(), strict=True
        ):
            lines.append(";".join(f"{x:.7g}" for x in (t, *values, 21.5)).replace(".", ","))
        (folder / f"r{i}.csv").write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))


def matlab(folder, signals):
    for i, (u, f, a) in enumerate(signals, 1):
        savemat(folder / f"run{i}.mat", {"fs": RATE, "u": u, "F": f, "acc": a / G, "note": "on Monday"})


def hdf5(folder, signals):
    for i, ((u, f, a), (_, _, bar)) in enumerate(zip(signals, SETTINGS, strict=True), 1):
        with h5py.File(folder / f"run{i}.h5", "w") as file:
            file.attrs["sample_rate"] = RATE
            group = file.create_group("data")
            noise = 0.01 * np.random.default_rng(i).normal(size=u.size)
            for name, samples, unit in (
                ("drive", 1e3 * u, "mV"),
                ("load cell", f, "N"),
                ("acceleration", a, "m/s2"),
                ("pressure", 100.0 * (bar + noise), "kPa"),
            ):
                group[name] = samples
                group[name].attrs["units"] = unit


def labview(folder, signals):
    for i, (u, f, a) in enumerate(signals, 1):
        head = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tNo\n"
        head += "X_Columns\tOne\nTime_Pref\tRelative\n***End_of_Header***\t\n\t\nChannels\t3\t\t\t\n"
        head += "Y_Unit_Label\tVolts\tNewtons\tg\t\nX_Dimension\tTime\tTime\tTime\t\nX0\t0.0\t0.0\t0.0\t\n"
        head += "Delta_X\t3.906250E-5\t3.906250E-5\t3.906250E-5\t\n***End_of_Header***\t\t\t\t\n"
        head += "X_Value\tVoltage\tForce (N)\tAcceleration\tComment\n"
        rows = zip((np.arange(u.size) / RATE).tolist(), u.tolist(), f.tolist(), (a / G).tolist(), strict=True)
        text = "".join("\t".join(f"{x:.6f}" for x in row) + "\n" for row in rows)
        (folder / f"test_{i}.lvm").write_text(head + text)


FOLDERS = {
    # what writes the folder, options, answers, and whether pressures are known file by file
    "tdms-german": (tdms_in_german, ["--rock", "4"], None, True),
    "tdms-daq": (tdms_of_a_daq, [], "4\n1.2\n", False),
    "csv": (
        csv_of_a_spreadsheet,
        ["--rock", "4", "--pressure", "r1=0.8", "--pressure", "r2=1.2", "--pressure", "1.5"],
        None,
        True,
    ),
    "matlab": (matlab, ["--pressure", "1.2"], "4\n", False),
    "hdf5": (hdf5, ["--rock", "sandstone2-indenter30"], None, True),
    "lvm": (labview, ["--rock", "4", "--pressure", "1.2"], None, False),
}
CHANNELS = {
    "tdms-german": {
        "excitation": ("Messung/Anregung", "V"),
        "force": ("Messung/Kraft", "kN"),
        "acceleration": ("Messung/Beschleunigung", "g"),
    },
    "tdms-daq": {
        "excitation": ("Untitled/cDAQ1Mod2/ai0", "V"),
        "force": ("Untitled/cDAQ1Mod1/ai0", "N"),
        "acceleration": ("Untitled/cDAQ1Mod1/ai1", "m/s^2"),
    },
    "csv": {"excitation": ("Anregung", "V"), "force": ("Kraft", "kN"), "acceleration": ("Beschl.", "m/s^2")},
    "matlab": {"excitation": ("u", "V"), "force": ("F", "N"), "acceleration": ("acc", "g")},  # by the balance
    "hdf5": {
        "excitation": ("data/drive", "mV"),
        "force": ("data/load cell", "N"),
        "acceleration": ("data/acceleration", "m/s^2"),
        "pressure": ("data/pressure", "kPa"),
    },
    "lvm": {"excitation": ("Voltage", "V"), "force": ("Force (N)", "N"), "acceleration": ("Acceleration", "g")},
}


@pytest.mark.parametrize("layout", FOLDERS)
def test_a_folder_becomes_a_campaign(init, signals, tmp_path, layout):
    write, options, answers, knows_pressures = FOLDERS[layout]
    write(tmp_path, signals)
    (tmp_path / "notes.txt").write_text("of no interest")
    code, printed, said = init(tmp_path, *options, answers=answers)
    assert (code, said.count("?")) == (0, 0 if answers is None else answers.count("\n")), said
    campaign = read_campaign(tmp_path)
    recordings = sorted(
        campaign.recordings, key=lambda each: [hz for hz, _, _ in SETTINGS].index(each.setting.frequency)
    )
    for recording, (hz, volt, bar), sampled in zip(recordings, SETTINGS, signals, strict=True):
        assert recording.sample_rate == RATE
        assert recording.setting.frequency == hz
        assert recording.setting.amplitude == pytest.approx(volt, rel=2e-3)
        assert recording.setting.pressure == pytest.approx(bar if knows_pressures else 1.2, rel=2e-3)
        assert {name: (each.column, each.unit) for name, each in recording.channels.items()} == CHANNELS[layout]
        for name, samples in zip(("excitation", "force", "acceleration"), sampled, strict=True):
            np.testing.assert_allclose(recording.channels[name].samples, samples, rtol=1e-5, atol=1e-3)
        assert recording.file in printed
    nominal = json.loads((tmp_path / "campaign.json").read_text())["nominal"]
    assert nominal["loading_stiffness"] == {"value": 21.4e6, "std": 0.56e6, "unit": "N/m"}
    assert nominal["damping"] == {"value": 2450.0, "std": 75.0, "unit": "N*s/m"}
    if knows_pressures:
        assert [each for each in check_quality(campaign) if each.severity != "note"] == []


@pytest.fixture
def single(tmp_path, signals):
    """A folder of one .mat file that does not say its pressure."""
    matlab(tmp_path, signals[:1])
    return tmp_path


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--pressure", "1"], "give --rock CASE"),
        (["--rock", "4"], "give --pressure BAR, or --pressure run1=BAR for each"),
        (["--rock", "7", "--pressure", "1"], "rock is '7'"),
        (["--rock", "4", "--pressure", "run2=1"], "'run2', which is none of the files: give run1"),
        (["--rock", "4", "--pressure", "high"], "--pressure is 'high'"),
        (["--rock", "4", "--pressure", "120"], "pressure is 120 bar, outside"),
        (["--rig", "one-body"], "no column is known as position"),
        (["--rig", "drill"], "--rig is 'drill': give one of percussive-drill, one-body"),
        (["--mass", "1", "--rock", "4", "--pressure", "1"], "--mass is no constant of the rig percussive-drill"),
        (["--channel", "force", "--rock", "4"], "--channel is 'force'"),
        (["--channel", "force=F:bar", "--rock", "4"], "give N or kN"),
        (["--loading-stiffness", "2e7", "--pressure", "1"], "--unloading-stiffness is missing"),
        (["--starts", "cold", "--rock", "4"], "--starts is 'cold'"),
    ],
)
def test_without_a_terminal_one_line_names_the_option(init, single, options, says):
    code, printed, said = init(single, *options)
    assert (code, printed, said.count("\n")) == (2, "", 1)
    assert says in said
    assert not (single / "campaign.json").exists()


def test_a_campaign_is_not_overwritten(init, single):
    options = ["--rock", "4", "--pressure", "1"]
    assert init(single, *options)[0] == 0
    before = (single / "campaign.json").read_bytes()
    code, _, said = init(single, *options, "--title", "anew")
    assert code == 2 and "give --force" in said
    assert (single / "campaign.json").read_bytes() == before
    assert init(single, *options, "--title", "anew", "--force")[0] == 0
    assert read_campaign(single).title == "anew"


def test_constants_of_another_rig(init, single):
    options = [
        "--rock",
        "2",
        "--pressure",
        "1",
        "--indenter-mass",
        "4+-0.02",
        "--damping",
        "3000",
        "--amplitude",
        "0.5",
    ]
    code, printed, _ = init(single, *options)
    campaign = read_campaign(single)
    assert code == 0
    assert (campaign.nominal["indenter_mass"].value, campaign.nominal["indenter_mass"].std) == (4.0, 0.02)
    assert (campaign.nominal["damping"].value, campaign.nominal["damping"].std) == (3000.0, 90.0)
    assert "assumed: damping is taken to be known to 3 %" in printed
    assert (campaign.nominal["shaker_mass"].value, campaign.nominal["shaker_mass"].std) == (265.0, 1.0)
    assert campaign.nominal["unloading_stiffness"].value == 13.90e6
    assert campaign.recordings[0].setting.amplitude == 0.5


def test_json_says_what_was_guessed(init, single):
    code, printed, said = init(single, "--rock", "4", "--json", answers="0.8\n")
    record = json.loads(printed)
    assert code == 0 and "pressure" in said
    assert record["campaign"] == json.loads((single / "campaign.json").read_text())
    assert record["from"]["run1"]["sample_rate"] == "its number 'fs'"
    assert set(record["guessed"]["run1"]) == {"force", "acceleration", "excitation", "starts"}


def test_files_of_another_kind_are_left_out(init, single):
    (single / "temperature.csv").write_text("time,temperature\n0,20\n1,21\n2,21\n")
    (single / "broken.tdms").write_bytes(b"none")
    code, printed, _ = init(single, "--rock", "4", "--pressure", "1")
    assert code == 0
    assert "left out: temperature.csv: no column is known as force" in printed
    assert "left out: broken.tdms: 'broken.tdms' is no readable TDMS file" in printed
    assert [each.name for each in read_campaign(single).recordings] == ["run1"]


def test_an_empty_folder(init, tmp_path):
    code, _, said = init(tmp_path)
    assert code == 2 and "has no file that can be used (none ends in .csv" in said
    code, _, said = init(tmp_path / "none")
    assert code == 2 and "cannot read" in said


def test_one_body(init, body, tmp_path):
    for recording in body.recordings:
        samples = {name: each.samples for name, each in recording.channels.items()}
        table = np.column_stack((recording.time, samples["force"], 1e3 * samples["position"], samples["velocity"]))
        np.savetxt(
            tmp_path / recording.file,
            table,
            delimiter=",",
            header="t,Force [N],Displacement [mm],speed (m/s)",
            comments="",
        )
    code, _, said = init(tmp_path, "--rig", "one-body", "--stiffness", "estimate", answers="2.0\n")
    assert (code, said.count("?")) == (0, 1)
    campaign = read_campaign(tmp_path)
    assert (campaign.nominal["mass"].value, campaign.nominal["stiffness"].value) == (2.0, None)
    assert [each.sample_rate for each in campaign.recordings] == [1000.0] * 3
    assert list(campaign.recordings[0].channels) == ["force", "position", "velocity"]
    np.testing.assert_allclose(
        campaign.recordings[1].channels["position"].samples, body.recordings[1].channels["position"].samples
    )


@pytest.mark.parametrize(
    ("name", "bare", "unit"),
    [
        ("Force [kN]", "Force", "kN"),
        ("Acceleration [m/s^2]", "Acceleration", "m/s^2"),
        ("rig/Acceleration (m/s\u00b2)", "rig/Acceleration", "m/s^2"),
        ("rig/acceleration_m_s2", "rig/acceleration", "m/s^2"),
        ("velocity_m_s", "velocity", "m/s"),
        ("force_kN", "force", "kN"),
        ("Kraft in kN", "Kraft", "kN"),
        ("Zeit/s", "Zeit", "s"),
        ("cDAQ1Mod1/ai0", "cDAQ1Mod1/ai0", None),
        ("Response (Trigger)", "Response (Trigger)", None),
        ("load_cell", "load_cell", None),
        ("x", "x", None),
    ],
)
def test_names_with_units(name, bare, unit):
    assert (without_unit(name), named_unit(name)) == (bare, unit)


@pytest.mark.parametrize("layout", FOLDERS)
def test_a_damaged_file_is_described_or_said(init, signals, tmp_path, layout):
    rng = np.random.default_rng(7)
    FOLDERS[layout][0](tmp_path, [[each[:1500] for each in channels] for channels in signals])
    path = min(each for each in tmp_path.iterdir())
    sound = path.read_bytes()
    for _ in range(6):
        data = bytearray(sound)
        for at in rng.integers(min(len(data), int(rng.choice([600, 3000, 10**7]))), size=int(rng.choice([1, 10, 100]))):
            data[at] = rng.integers(256)
        path.write_bytes(data[: int(rng.integers(len(data))) if rng.random() < 0.2 else len(data)])
        code, _, said = init(tmp_path, "--rock", "4", "--pressure", "1", "--force")
        assert code in (0, 2)
        assert said.count("\n") == (code == 2)
