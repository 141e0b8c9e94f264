"""Diagnoses of campaigns that the hybrid engine makes: what was put in comes out, and nothing else."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drillenv import Rig, Setting, rock
from drillenv.checks import InputError
from drillenv.corrected import read_model
from drillenv.diagnosis.condition import condition, white_noise
from drillenv.diagnosis.constants import constants
from drillenv.diagnosis.drill import ShootingProblem
from drillenv.diagnosis.drill_diagnosis import held_out
from drillenv.diagnosis.drill_noise import noise_of
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.drill_unknowns import PRESSURE_LABEL, STATE_WIDTHS, first_states
from drillenv.diagnosis.fitting import RELAXED
from drillenv.diagnosis.report import diagnose
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.diagnosis.terms import ModelStructure
from drillenv.dynamics.effects import make
from drillenv.dynamics.sensors import PerChannel, record
from drillenv.recordings import Campaign, Nominal, Recording
from drillenv.recordings.campaign import Channel
from drillenv.rig import TOLERANCES

SETTINGS = ((118.0, 0.42, 0.95), (76.0, 0.55, 0.8), (95.0, 0.38, 1.3), (62.0, 0.45, 1.2), (108.0, 0.5, 1.0))
STATED = {**TOLERANCES, "loading_stiffness": 0.56e6, "unloading_stiffness": 1.0e6}
NOISE = PerChannel(0.002, 5.0, 2.0)


def campaign_with(rig=None, effects=(), sensors=(), seed=0, seconds=0.25):
    """A small campaign of case 4, recorded on a rig that need not be the one believed in."""
    rng = np.random.default_rng(seed)
    believed, pair = Rig(), rock(4)
    recordings = []
    for i, setting in enumerate(SETTINGS):
        fresh = i == 1
        made = record(
            rig or believed,
            Setting(*setting),
            pair,
            seconds,
            effects=effects,
            sensors=sensors,
            phase=float(rng.uniform(0, 6)),
            lead=0.0 if fresh else 1.2,
            noise=NOISE,
            rng=rng,
        ).channels
        channels = {
            "excitation": Channel(made.excitation, "V", "e"),
            "force": Channel(made.force, "N", "f"),
            "acceleration": Channel(made.acceleration, "m/s^2", "a"),
        }
        starts = "fresh" if fresh else "running"
        recordings.append(Recording(f"r{i}", f"r{i}.csv", 25600.0, channels, starts, Setting(*setting)))
    values = {name: getattr(believed, name) for name in list(STATED)[:6]}
    values |= {name: getattr(pair, name) for name in list(STATED)[6:]}
    nominal = {name: Nominal(values[name], std, "SI") for name, std in STATED.items()}
    return Campaign("made up", "percussive-drill", nominal, tuple(recordings), Path("."))


def nominal_block(campaign, data):
    """A recording with the paper's model at what the campaign states, its windows nearly free."""
    flat = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))
    return ShootingProblem(data, ModelStructure((constants(campaign.nominal),), flat, DRILL), RELAXED, noise_of(data))


@pytest.fixture(scope="module")
def followed():
    """A recording under its true model: the block, its shared parameters, and its own unknowns at their best."""
    campaign = campaign_with()
    data = condition(campaign.recordings[0], Rig())
    block = nominal_block(campaign, data)
    shared = np.array([each.value / each.scale for each in block.structure.unknowns])
    return block, shared, block.estimate_states(shared, first_states(data))


def test_noise_is_told_from_the_signal():
    rng = np.random.default_rng(1)
    signal = 500 * np.sin(np.arange(10_000) * 0.02) + rng.normal(0, 3.0, 10_000)
    assert white_noise(signal) == pytest.approx(3.0, rel=0.05)


def test_states_read_from_the_measurements_start_the_model_near_them(followed):
    block, shared, _ = followed
    values = shared * block.scales
    model = block.structure.model(values, block.point)
    said = block.integrate(model, first_states(block.data)).signals
    left = (block.measured - block.read(values, said))[0, block.evaluation]
    # the peaks are of 1.5 kN; without any fit the model follows them within a tenth of their rms
    assert np.std(left) < 0.1 * np.sqrt(np.mean(block.measured[0, block.evaluation] ** 2))


def test_a_window_that_begins_elsewhere_finds_back(followed):
    block, shared, best = followed
    for window in (0, 3):
        elsewhere = best.copy()
        # so far off the rock that it comes down after the blow
        elsewhere[4 * window + 3] = -5e-4 / STATE_WIDTHS[3]
        found = block.estimate_states(shared, block.reinitialise_outliers(shared, elsewhere, False))
        assert block.cost(shared, found) == pytest.approx(block.cost(shared, best), abs=2.0)


def test_a_recording_is_begun_anew_where_others_are_followed_by_far_more_closely(followed):
    block, shared, best = followed
    # every window off the rock as it begins, and half as much pressure again
    elsewhere = best.copy()
    elsewhere[: 4 * block.windows].reshape(-1, 4)[:, 3] = -5e-4 / STATE_WIDTHS[3]
    elsewhere[4 * block.windows] = 0.5 / PRESSURE_LABEL
    found = block.estimate_states(shared, block.reinitialise_outliers(shared, elsewhere, True))
    assert block.cost(shared, found) == pytest.approx(block.cost(shared, best), abs=2.0)
    assert block.reinitialise_outliers(shared, elsewhere, False) is elsewhere


def test_a_recording_that_a_far_model_cannot_follow_is_left_as_it_is(followed):
    block, shared, best = followed
    far = shared.copy()
    far[[each.name for each in block.structure.unknowns].index("loading_stiffness")] *= 0.6
    settled = block.estimate_states(far, best)
    assert block.per_sample(far, settled) > 10.0
    assert block.reinitialise_outliers(far, settled, True) is settled


def test_a_recording_without_contact_is_refused():
    campaign = campaign_with(seconds=0.1)
    still = campaign.recordings[0]
    channels = dict(still.channels) | {"force": Channel(np.zeros(still.size), "N", "f")}
    with pytest.raises(InputError, match="contacts"):
        condition(Recording(still.name, still.file, still.sample_rate, channels, "running", still.setting), Rig())


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_missing(tmp_path):
    report = diagnose(campaign_with(seed=2))
    assert report.verdict == "agrees"
    assert report.record["findings"] == []
    report.write(tmp_path)
    assert json.loads((tmp_path / "report.json").read_text())["verdict"] == "agrees"
    assert read_model(tmp_path / "model.json").effects == ()


@pytest.mark.slow
def test_a_wrong_constant_is_a_wrong_constant():
    report = diagnose(campaign_with(rig=Rig(damping=2940.0), seed=3))
    assert report.verdict == "parameters"
    found = report.record["parameters"]
    assert list(found) == ["damping"]
    assert found["damping"]["value"] == pytest.approx(2940.0, abs=4 * found["damping"]["std"])


@pytest.mark.slow
def test_a_rate_dependent_rock_is_named(tmp_path):
    report = diagnose(campaign_with(effects=[make("contact-rate", chi=0.2)], seed=4))
    assert report.verdict == "missing-physics"
    (finding,) = report.record["findings"]
    assert finding["mechanism"] == "contact-rate"
    chi = finding["parameters"]["chi"]
    assert chi["value"] == pytest.approx(0.2, abs=4 * chi["std"])
    assert report.record["where"]["balance"] == "contact"
    held = report.record["fit"]["held_out"]
    assert held["after"] < 1.15 < held["before"]
    report.write(tmp_path)
    assert [each.effect.name for each in read_model(tmp_path / "model.json").effects] == ["contact-rate"]


def made_at(frequencies, fresh=()):
    """Recordings at frequencies in Hz, those numbered ``fresh`` from rest."""
    return [
        SimpleNamespace(fresh=i in fresh, setting=Setting(float(each), 0.45, 1.0)) for i, each in enumerate(frequencies)
    ]


def test_recordings_held_out_lie_within_the_frequencies_of_the_others():
    for seed in range(20):
        frequencies = np.random.default_rng(seed).permutation([60, 68, 76, 81, 88, 97, 111, 117])
        held = held_out(made_at(frequencies, fresh=(1, 4)))
        assert len(held) == 2
        assert not held & {1, 4}
        assert all(60 < frequencies[i] < 117 for i in held)


def test_recordings_at_two_frequencies_are_held_out_all_the_same():
    assert len(held_out(made_at([60, 60, 60, 60, 120, 120, 120, 120]))) == 2
    assert held_out(made_at([60, 80, 100, 120])) == set()


@pytest.mark.slow
def test_a_rig_that_was_running_and_is_called_fresh_spoils_nothing():
    """Its first window begins anywhere but at rest: no constant is to be bent for that."""
    campaign = campaign_with(effects=[make("contact-rate", chi=0.2)], seed=4)
    recordings = tuple(replace(each, starts="fresh") if each.name == "r3" else each for each in campaign.recordings)
    report = diagnose(replace(campaign, recordings=recordings))
    assert report.verdict == "missing-physics"
    (finding,) = report.record["findings"]
    assert finding["mechanism"] == "contact-rate"
    assert finding["parameters"]["chi"]["value"] == pytest.approx(0.2, abs=4 * finding["parameters"]["chi"]["std"])
