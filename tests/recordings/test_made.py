"""``drillenv simulate --campaign``: made recordings, against the exact engine and against what was asked for."""

import json

import numpy as np
import pytest

import drillenv
from drillenv import cli
from drillenv.recordings import check_quality, read_campaign


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A function that makes a campaign by the command line, once for each set of options."""
    found = {}

    def make(*options):
        if options not in found:
            folder = tmp_path_factory.mktemp("made") / "c"
            arguments = ["simulate", "--campaign", str(folder), "--recordings", "3", "--seconds", "0.2", *options]
            assert cli.main(arguments) == 0
            found[options] = read_campaign(folder)
        return found[options]

    return make


def force_of(campaign):
    return [each.channels["force"].samples for each in campaign.recordings]


def test_it_is_read_and_sound(made):
    campaign = made()
    assert [(each.name, each.starts, each.size) for each in campaign.recordings] == [
        ("r01", "running", 5121),
        ("r02", "running", 5121),
        ("r03", "fresh", 5121),
    ]
    assert [str(each) for each in check_quality(campaign)] == []
    assert campaign.nominal["loading_stiffness"].value == 21.4e6
    for each in campaign.recordings:
        assert 50 <= each.setting.frequency <= 120 and 0.3 <= each.setting.amplitude <= 0.6
        assert 0.6 <= each.setting.pressure <= 1.8


def test_the_fresh_start_is_the_exact_engines(made):
    recording = made().recordings[2]
    run = drillenv.simulate(recording.setting, 4, seconds=0.2, start="fresh")
    early = slice(0, 2000)  # before the two could drift apart on a chaotic motion
    for name, noise in (("excitation", 0.002), ("force", 5.0), ("acceleration", 2.5)):
        left = recording.channels[name].samples[early] - getattr(run, name)[early]
        assert np.std(left) == pytest.approx(noise, rel=0.1)
        assert abs(np.mean(left)) < 0.1 * noise


def test_the_seed_decides(made):
    for first, again in zip(force_of(made()), force_of(made("--seed", "0")), strict=True):
        np.testing.assert_array_equal(first, again)
    assert made("--seed", "1").recordings[0].setting != made().recordings[0].setting


def test_an_effect_on_the_motion(made):
    # Hunt-Crossley: the first fast blow of the fresh start meets k_l (1 + chi v)
    without, with_it = made(), made("--effect", "contact-rate", "chi=0.45")
    assert [each.setting for each in without.recordings] == [each.setting for each in with_it.recordings]
    assert np.max(np.abs(force_of(with_it)[2] - force_of(without)[2])) > 50.0  # ten times the noise


def test_an_effect_on_a_sensor(made):
    without, with_it = made(), made("--effect", "sensor-offset", "o_f=40")
    for plain, shifted in zip(force_of(without), force_of(with_it), strict=True):
        np.testing.assert_allclose(shifted - plain, 40.0, atol=0.11)  # a decimal is written


@pytest.mark.parametrize("file_format", ["mat", "h5", "tdms"])
def test_formats(made, file_format):
    campaign = made("--file-format", file_format)
    np.testing.assert_allclose(force_of(campaign)[0], force_of(made())[0], atol=1e-9)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--campaign", "c", "--frequency", "60"], "--campaign and --frequency are both given"),
        (["--campaign", "c", "--recordings", "2"], "recordings is 2, outside 3 to 200"),
        (["--campaign", "c", "--effect", "contact-rate", "chi"], "give SYMBOL=VALUE"),
        (["--campaign", "c", "--effect", "contact-rate", "x=1"], "no parameter 'x'"),
        (["--campaign", "c", "--effect", "contact"], "effect is 'contact'"),
        (["--campaign", "c", "--effect", "viscous-damping"], "one of a one-body rig"),
        (["--campaign", "c", "--file-format", "xls"], "file_format is 'xls'"),
        (["--campaign", "."], "exists already"),
        (["--frequency", "60"], "--amplitude and --pressure of the run are missing"),
        (["--frequency", "60", "--amplitude", "0.4", "--pressure", "1", "--seed", "1"], "--seed without --campaign"),
    ],
)
def test_refusals(options, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["simulate", *options]) == 2
    complaint = capsys.readouterr().err
    assert says in complaint and complaint.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_run_takes_effects_too(capsys):
    place = ["--frequency", "120", "--amplitude", "0.45", "--pressure", "1", "--seconds", "0.2", "--json"]
    assert cli.main(["simulate", *place]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert cli.main(["simulate", *place, "--effect", "contact-rate", "chi=0.45"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["effects"] == [{"name": "contact-rate", "parameters": {"chi": 0.45, "c_d": 0.0, "p_d": 0.0}}]
    assert record["peak_force"] != plain["peak_force"]
