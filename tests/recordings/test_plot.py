"""Pictures of recordings: the model lies in phase with what was recorded, and the file needs nothing else."""

import re
import struct
from dataclasses import replace

import numpy as np
import pytest

import drillenv
from drillenv import cli
from drillenv.recordings import read_campaign, write_campaign
from drillenv.recordings.plot import believed, modelled, part_shown, phase_at


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.7, 5.5])
def test_the_model_is_in_phase(record, rig_nominal, drill, phase):
    # 118 Hz, one impact a period, and 76 Hz, some
    for place in ((118.0, 0.55, 0.8), (61.3, 0.45, 1.2)):
        recording = record("r", place, start="steady", phase=phase, noise=0.1, seconds=0.41)
        campaign = replace(drill, recordings=(recording,))
        part = part_shown(recording, campaign.rig)
        assert part.stop - part.start == pytest.approx(3 * 25600 / place[0] + 1, abs=1)
        model = modelled(campaign, recording, part)
        force = recording.channels["force"].samples[part]
        shift = np.sqrt(np.mean((force - model.samples["force"]) ** 2))
        assert shift < 0.03 * force.max()  # off by a period or by a tenth of one it is far more
        assert model.motion == drillenv.motion(drillenv.Setting(*place), 4).label


def test_a_fresh_start_is_shown_from_its_first_sample(drill):
    recording = drill.recordings[3]
    part = part_shown(recording, drill.rig)
    assert part.start == 0
    model = modelled(drill, recording, part)
    force = recording.channels["force"].samples[part]
    assert np.sqrt(np.mean((force - model.samples["force"]) ** 2)) < 0.03 * force.max()


def test_without_an_excitation_the_force_tells_the_phase(spoil, drill):
    campaign = spoil(drill, "r01", excitation=None)
    recording = campaign.recordings[0]
    part = part_shown(recording, drill.rig)
    assert phase_at(recording, part) is None
    force = recording.channels["force"].samples[part]
    model = modelled(campaign, recording, part)
    assert np.sqrt(np.mean((force - model.samples["force"]) ** 2)) < 0.1 * force.max()


def test_the_constants_are_the_campaigns(rig_nominal):
    rig, rock = believed(rig_nominal)
    assert (rig.shaker_mass, rig.damping) == (265.0, 2450.0)
    assert (rock.loading_stiffness, rock.unloading_stiffness) == (21.4e6, 25.05e6)


@pytest.fixture
def folder(drill, tmp_path):
    force = drill.recordings[0].channels["force"].samples.copy()
    force[2000:2010] = np.nan
    channels = dict(drill.recordings[0].channels)
    channels["force"] = replace(channels["force"], samples=force)
    recordings = [replace(drill.recordings[0], channels=channels), drill.recordings[3]]
    return write_campaign(tmp_path / "c", "<b>made & drawn</b>", drill.rig, drill.nominal, recordings)


@pytest.mark.slow
def test_one_page_that_needs_nothing_else(folder, tmp_path, capsys):
    assert cli.main(["campaign", "plot", str(folder), "--out", str(tmp_path / "p.html")]) == 0
    page = (tmp_path / "p.html").read_text()
    assert page.count("<img ") == 2
    assert re.findall(r"(?:src|href)=\"(?!data:image/png;base64,)", page) == []
    assert "http" not in page
    assert "&lt;b&gt;made &amp; drawn" in page and "<b>made" not in page
    assert "10 samples are no numbers" in page


@pytest.mark.slow
def test_one_picture(folder, tmp_path, capsys):
    assert cli.main(["campaign", "plot", str(folder), "--out", str(tmp_path / "p.png")]) == 0
    data = (tmp_path / "p.png").read_bytes()
    width, height = struct.unpack(">II", data[16:24])
    assert (width, height) == (1320, 2 * 660)


@pytest.mark.slow
def test_one_body_is_drawn_without_a_model(body, tmp_path, capsys):
    folder = write_campaign(tmp_path / "c", body.title, body.rig, body.nominal, body.recordings)
    assert modelled(read_campaign(folder), body.recordings[0], slice(0, 10)) is None
    assert cli.main(["campaign", "plot", str(folder), "--out", str(tmp_path / "p.html")]) == 0


def test_bad_ends(folder, tmp_path, capsys):
    assert cli.main(["campaign", "plot", str(folder), "--out", str(tmp_path / "p.gif")]) == 2
    assert "give one of .html, .png" in capsys.readouterr().err
