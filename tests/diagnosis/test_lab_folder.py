"""What a lab hands over, messy as it is, and what the diagnosis makes of it: one row of docs/diagnosis each."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.blind.mechanisms import MECHANISMS, Site, concealed
from drillenv.checks import InputError
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.drill_diagnosis import STRETCH, nominal_rig, plain_fit
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.fitting import CONVERGED
from drillenv.diagnosis.naming import name_law
from drillenv.diagnosis.report import diagnose
from drillenv.diagnosis.selection import with_family
from drillenv.dynamics.effects import make
from drillenv.dynamics.sensors import PerChannel
from drillenv.recordings import Channel, read_campaign
from drillenv.recordings.findings import NOTE, QualityFinding
from drillenv.recordings.made import make_campaign
from drillenv.rocks import rock


@pytest.fixture(scope="module")
def campaign():
    """One whose rock resists fast impacts more, on the concealed rig."""
    rng = np.random.default_rng([41, 3])
    (equation,) = (each for each in MECHANISMS["contact-rate"].equations if each.of_library)
    chosen = concealed("contact-rate", equation, rng, 1.0, Site(drive=600.0, frequency=110.0))
    return plain_campaign(rng, 4, (chosen,), recordings=8, seconds=0.2).campaign


def changed(campaign, name, change):
    """The samples of every channel of a recording, changed."""
    recordings = []
    for each in campaign.recordings:
        if each.name == name:
            channels = {key: replace(one, samples=change(key, one.samples)) for key, one in each.channels.items()}
            each = replace(each, channels=channels)
        recordings.append(each)
    return replace(campaign, recordings=tuple(recordings))


def named(report):
    return [each["mechanism"] for each in report.record["findings"]]


def running(campaign, count):
    """The first so many recordings of a running rig."""
    kept = [each for each in campaign.recordings if each.starts == "running"]
    return replace(campaign, recordings=tuple(kept[:count]))


@pytest.mark.slow
def test_lost_samples_a_pre_trigger_a_dead_channel_and_a_recording_too_short(campaign):
    rng = np.random.default_rng(1)

    def with_pre_trigger(name, samples):
        still = {"excitation": 0.0, "force": samples[0], "acceleration": 0.0}[name]
        noise = {"excitation": 1e-3, "force": 2.0, "acceleration": 1.0}[name]
        return np.concatenate([still + noise * rng.standard_normal(1280), samples])

    messy = changed(campaign, "r03", lambda _name, samples: np.delete(samples, slice(3000, 3037)))
    messy = changed(messy, "r02", with_pre_trigger)
    messy = changed(messy, "r04", lambda _name, samples: samples[:600])
    first = messy.recordings[0]
    dead = {**first.channels, "position": Channel(np.zeros(first.size), "m", "position")}
    messy = replace(messy, recordings=(replace(first, channels=dead), *messy.recordings[1:]))
    report = diagnose(messy)
    assert named(report) == ["contact-rate"]
    said = " ".join(report.record["remarks"])
    assert "r03: used are" in said and "r02: used are 0.049" in said and "r01: its position is left out" in said
    assert any(each.startswith("r04: ") and each.endswith("it is left out.") for each in report.record["remarks"])
    assert report.record["bookkeeping"] == []


@pytest.mark.slow
def test_a_coarse_converter_sets_the_noise(campaign):
    """Steps of 24 N."""
    coarse = campaign
    for each in campaign.recordings:
        coarse = changed(coarse, each.name, lambda name, x: 24.0 * np.round(x / 24.0) if name == "force" else x)
    report = diagnose(coarse)
    assert named(report) == ["contact-rate"]
    assert report.record["fit"]["held_out"]["after"] < 1.1
    assert any("6.93 N" in each for each in report.record["remarks"])


@pytest.mark.thorough
@pytest.mark.slow
def test_a_dead_band_sets_the_noise(campaign):
    """What is below 20 N reads 0: no law of the rock is to be seen in that."""
    dead = campaign
    for each in campaign.recordings:
        dead = changed(dead, each.name, lambda name, x: np.where(abs(x) < 20.0, 0.0, x) if name == "force" else x)
    report = diagnose(dead)
    assert named(report) == ["contact-rate"]
    assert any("dead band" in each for each in report.record["remarks"])


@pytest.mark.slow
def test_recordings_without_any_noise(monkeypatch, tmp_path):
    made = "drillenv.recordings.made"
    monkeypatch.setattr(f"{made}.NOISE", PerChannel(0.0, 0.0, 0.0))
    monkeypatch.setattr(f"{made}.DIGITS", PerChannel(12, 9, 9))
    folder = make_campaign(tmp_path / "made", rock(4), recordings=5, seconds=0.2, seed=5)
    report = diagnose(read_campaign(folder))
    assert report.verdict == "agrees"
    assert any("No noise is seen on the force of 5 of 5 recordings" in each for each in report.record["remarks"])


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.thorough), 4])
def test_few_recordings_say_what_they_cannot_prove(campaign, count):
    report = diagnose(running(campaign, count))
    assert named(report) == ["contact-rate"]
    held = report.record["fit"]["held_out"]
    if count == 1:
        assert held["recordings"] == [] and held["after"] is None
        assert "no other says whether it holds" in report.record["explained"]["of"]
    else:
        # each by a fit to the others
        assert held["recordings"] == report.record["fit"]["fitted"]["recordings"]
        assert held["after"] < 1.05 < held["before"]


@pytest.mark.slow
def test_few_recordings_are_reported_where_time_is_up(campaign):
    """Each is held against a fit to as much of the others as the search has come to."""
    report = diagnose(running(campaign, 3), within=0.0)
    assert report.record["unfinished"] == "looking for what is missing"
    assert len(report.record["fit"]["held_out"]["recordings"]) == 3


@pytest.mark.slow
def test_long_recordings_are_shortened(tmp_path, monkeypatch):
    """Of 3 s each, the stretches that vary most, by what the folder holds."""
    monkeypatch.setattr("drillenv.recordings.excerpt.ENOUGH", 384)
    folder = make_campaign(
        tmp_path / "made", rock(4), effects=[make("contact-rate", chi=0.45)], recordings=4, seconds=3.0, seed=5
    )
    report = diagnose(folder, only=["contact"])
    assert named(report) == ["contact-rate"]
    assert sum("of 3 s" in each for each in report.record["remarks"]) == 4
    assert set(report.record["inputs"]) == {"campaign.json", "r01.csv", "r02.csv", "r03.csv", "r04.csv"}


@pytest.mark.slow
def test_where_nothing_can_be_used_the_faults_are_said(campaign):
    dead = campaign
    for each in campaign.recordings:
        dead = changed(dead, each.name, lambda name, x: 0.0 * x if name == "force" else x)
    noted = QualityFinding("r01", None, "reading", 0.0, 0.3, "its text was read as UTF-16", NOTE)
    first = replace(dead.recordings[0], findings=(noted,))
    with pytest.raises(InputError, match=r"no recording can be used.*\(r01, force[^;]*never moves") as caught:
        diagnose(replace(dead, recordings=(first, *dead.recordings[1:])))
    assert "UTF-16" not in str(caught.value) and str(caught.value).count("never moves") == 1


@pytest.mark.slow
def test_coupled_channels_are_named(tmp_path):
    """Force by 0.5 Hz, acceleration by 1 Hz, as of every IEPE and piezoelectric sensor; the charge is each start's."""
    effect = make("sensor-highpass", corner_f=0.5, corner_a=1.0)
    folder = make_campaign(tmp_path / "made", rock(4), effects=[effect], recordings=6, seconds=0.3, seed=5)
    record = diagnose(folder).record
    (finding,) = record["findings"]
    assert finding["mechanism"] == "sensor-highpass"
    assert finding["parameters"]["corner_f"]["value"] == pytest.approx(0.5, abs=0.03)
    assert finding["parameters"]["corner_a"]["value"] == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_charges_of_a_coupling_without_a_corner_are_offsets(tmp_path):
    """A load cell and an accelerometer that were zeroed anew before each recording, fitted as a free high-pass."""
    made = read_campaign(make_campaign(tmp_path / "made", rock(4), recordings=4, seconds=0.3, seed=6))
    zeros = {each.name: np.random.default_rng(i).normal(size=2) * (20.0, 8.0) for i, each in enumerate(made.recordings)}
    for name, (force, acceleration) in zeros.items():
        off = {"excitation": 0.0, "force": force, "acceleration": acceleration}
        made = changed(made, name, lambda channel, x, off=off: x + off[channel])
    data = [condition(each, nominal_rig(made)).first(STRETCH) for each in made.recordings]
    with ThreadPoolExecutor(2) as pool:
        plain = plain_fit(made, data, pool)
        family = next(each for each in DRILL.candidates(plain) if each.group == "high-pass")
        fitted = with_family(plain, family, CONVERGED)
        found, other = name_law(fitted, family, plain.cost - fitted.cost)
    assert found.mechanism == "sensor-offset" and found.equation is not None
    values = other.values_of(found.equation.name).reshape(-1, 2)
    np.testing.assert_allclose(values, [*zeros.values()], atol=0.4)


def test_where_all_are_too_short_each_says_why(campaign):
    short = campaign
    for each in campaign.recordings:
        short = changed(short, each.name, lambda _name, samples: samples[:200])
    with pytest.raises(InputError, match=r"no recording can be used: r0\d.*: .*; r0\d"):
        diagnose(short)
