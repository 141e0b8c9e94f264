"""Labels of single recordings that their samples contradict are found, and nothing else is taken for one."""

from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.blind.mechanisms import MECHANISMS, Site, concealed
from drillenv.checks import InputError
from drillenv.diagnosis import drill_diagnosis
from drillenv.diagnosis.bookkeeping import Label, mislabelled_pressures, with_labels_corrected
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.drill_diagnosis import Outcome, nominal_rig
from drillenv.diagnosis.report import diagnose

pytestmark = pytest.mark.slow  # its campaigns take most of the time
SITE = Site(drive=600.0, frequency=110.0)
CONCEALED = ("contact-rate", "contact-toe", "damping-quadratic", "drive-droop", "rock-compaction", "sensor-offset")


def made_with(name, seed, recordings=8, seconds=0.3):
    """A campaign that conceals a mechanism, or none."""
    rng, chosen = np.random.default_rng([41, seed]), ()
    if name is not None:
        (equation,) = (each for each in MECHANISMS[name].equations if each.of_library)
        chosen = (concealed(name, equation, rng, 1.0, SITE),)
    return plain_campaign(rng, 4, chosen, recordings=recordings, seconds=seconds).campaign


@pytest.fixture(scope="module")
def campaigns():
    return [made_with(name, i) for i, name in enumerate((None, *CONCEALED))]


def relabelled(campaign, i, **changes):
    """Another label for recording i: of its setting, or how it starts."""
    recordings = list(campaign.recordings)
    if "starts" in changes:
        recordings[i] = replace(recordings[i], **changes)
    else:
        recordings[i] = replace(recordings[i], setting=replace(recordings[i].setting, **changes))
    return replace(campaign, recordings=tuple(recordings))


def running(campaign):
    return [i for i, each in enumerate(campaign.recordings) if each.starts == "running"]


def test_sound_labels_stay(campaigns):
    for campaign in campaigns:
        same, labels = with_labels_corrected(campaign)
        assert labels == []
        assert [each.setting for each in same.recordings] == [each.setting for each in campaign.recordings]


@pytest.mark.parametrize("factor", [0.7, 0.88, 1.12, 1.36])
def test_another_pressure_is_found(campaigns, factor):
    """Whatever physics the rig has besides; of the eight recordings another one each time."""
    for turn, campaign in enumerate(campaigns):
        i = turn % len(campaign.recordings)
        true = campaign.recordings[i].setting.pressure
        right, (label,) = with_labels_corrected(relabelled(campaign, i, pressure=factor * true))
        assert (label.recording, label.field) == (campaign.recordings[i].name, "pressure")
        assert label.stated == factor * true
        assert abs(label.seems - true) < 3.0 * label.std
        assert right.recordings[i].setting.pressure == label.seems
        assert label.recording in label.sentence


def test_another_amplitude_is_found(campaigns):
    campaign = campaigns[1]
    true = campaign.recordings[2].setting.amplitude
    right, (label,) = with_labels_corrected(relabelled(campaign, 2, amplitude=0.75 * true))
    assert (label.recording, label.field) == (campaign.recordings[2].name, "amplitude")
    assert label.seems == pytest.approx(true, rel=0.015)
    assert right.recordings[2].setting.amplitude == label.seems


def test_recordings_that_were_running_are_found(campaigns):
    """Each that is said to start from rest and does not."""
    missed, tried = 0, 0
    for campaign in campaigns:
        for i in running(campaign):
            _, labels = with_labels_corrected(relabelled(campaign, i, starts="fresh"))
            tried += 1
            missed += [asdict(label) for label in labels] != [
                {
                    "recording": campaign.recordings[i].name,
                    "field": "starts",
                    "stated": "fresh",
                    "seems": "running",
                    "std": None,
                }
            ]
    # one that begins with the indenter just above the face and nearly at rest looks like a start
    assert missed <= 0.05 * tried


def test_two_wrong_pressures_of_eight_are_found(campaigns):
    campaign = relabelled(campaigns[0], 1, pressure=1.3 * campaigns[0].recordings[1].setting.pressure)
    campaign = relabelled(campaign, 6, pressure=0.7 * campaigns[0].recordings[6].setting.pressure)
    assert {each.recording for each in mislabelled_pressures(campaign.recordings)} == {
        campaign.recordings[1].name,
        campaign.recordings[6].name,
    }


def test_of_few_recordings_no_pressure_is_doubted(campaigns):
    few = relabelled(campaigns[0], 0, pressure=1.3 * campaigns[0].recordings[0].setting.pressure).recordings[:4]
    assert mislabelled_pressures(few) == []


def test_a_start_says_nothing_of_the_pressure():
    """Of 0.2 s from rest the mean force is that of the transient: once taken for the pressure, 8 % too low."""
    campaign = made_with(None, 0, recordings=6, seconds=0.2)
    assert {each.starts for each in campaign.recordings} == {"running", "fresh"}
    assert with_labels_corrected(campaign)[1] == []


def test_a_wrong_pressure_does_not_make_a_verdict(campaigns):
    """Small errors are told by the fit, large ones by the mean force."""
    campaign = campaigns[0]
    for i, factor in ((2, 1.36), (3, 1.045)):
        true = campaign.recordings[i].setting.pressure
        record = diagnose(relabelled(campaign, i, pressure=factor * true)).record
        assert record["verdict"] == "agrees"
        (entry,) = record["bookkeeping"]
        assert (entry["recording"], entry["field"]) == (campaign.recordings[i].name, "pressure")
        assert entry["seems"] == pytest.approx(true, rel=0.015)
        assert any(entry["recording"] in remark for remark in record["remarks"])


def test_a_recording_that_alone_disagrees_is_set_aside():
    """One whose accelerometer was turned up by a tenth and a half, which no label says."""
    campaign = made_with(None, 0, recordings=6, seconds=0.2)
    recordings = list(campaign.recordings)
    channels = dict(recordings[2].channels)
    channels["acceleration"] = replace(channels["acceleration"], samples=1.15 * channels["acceleration"].samples)
    recordings[2] = replace(recordings[2], channels=channels)
    record = diagnose(replace(campaign, recordings=tuple(recordings))).record
    assert record["verdict"] == "agrees"
    assert record["bookkeeping"] == [
        {"recording": recordings[2].name, "field": "use", "stated": "fit", "seems": "set aside", "std": None}
    ]


def is_usable(recording, rig):
    try:
        condition(recording, rig)
    except InputError:
        return False
    return True


def test_a_recording_that_is_too_short_once_its_label_is_right_is_left_out(monkeypatch, campaigns):
    """One said to be fresh begins with a window of its own, which one that was running has not."""
    campaign = campaigns[0]
    rig, i = nominal_rig(campaign), running(campaign)[0]
    whole = campaign.recordings[i]

    def part(first, last):
        channels = {name: replace(each, samples=each.samples[first:last]) for name, each in whole.channels.items()}
        return replace(whole, channels=channels, starts="fresh")

    period = round(whole.sample_rate / whole.setting.frequency)
    sizes, firsts = range(2 * period, 5 * period, period // 4), range(0, period, period // 12)
    parts = (part(first, first + size) for first in firsts for size in sizes)
    short = next(each for each in parts if is_usable(each, rig) and not is_usable(replace(each, starts="running"), rig))
    recordings = [short if each is whole else each for each in campaign.recordings]
    searched = []

    def search(given, *_, **__):
        searched.extend(each.name for each in given.recordings)
        return Outcome("agrees", [], *[None] * 6, [], stopped="here")  # type: ignore[arg-type]

    monkeypatch.setattr(drill_diagnosis, "search", search)
    outcome = drill_diagnosis.diagnose_drill(replace(campaign, recordings=tuple(recordings)))
    assert searched == [each.name for each in campaign.recordings if each is not whole]
    assert len(outcome.unusable) == 1 and whole.name in outcome.unusable[0]


@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize(("fitted", "back"), [(0.99, True), (1.12, False)])
def test_a_pressure_that_the_fit_puts_back_is_searched_as_stated(monkeypatch, campaigns, fitted, back, fits):
    """What is missing, as friction of the indenter, had taken its recording off the line of the others.

    Where that recording took no part in the fit, what was found stands, and is held against it alone.
    """
    campaign = campaigns[0]
    name, true = campaign.recordings[2].name, campaign.recordings[2].setting.pressure
    corrected = Label(name, "pressure", true, 1.1 * true, 0.01)
    by_fit = [Label(name, "pressure", 1.1 * true, fitted * true, 0.01)]
    monkeypatch.setattr(drill_diagnosis, "mislabelled_pressures_by_fit", lambda _every: by_fit)
    fit_data = [SimpleNamespace(name=each.name) for each in campaign.recordings if fits or each.name != name]
    outcome: Any = SimpleNamespace(verdict="missing-physics", fit_data=fit_data, every=[], known="what was found")
    other = drill_diagnosis.second_look(relabelled(campaign, 2, pressure=1.1 * true), [corrected], outcome)
    if back:
        assert other.labels == [] and other.campaign.recordings[2].setting.pressure == true
        assert other.known == (None if fits else "what was found")
    else:
        assert other is None


@pytest.mark.parametrize(("left", "fitted", "ends"), [(1.02, 0.99, True), (1.3, 0.99, False), (1.02, 1.12, False)])
def test_a_search_does_not_go_on_from_a_wrong_correction(monkeypatch, campaigns, left, fitted, ends):
    """Once a model leaves nothing, families that are still called for would serve the label alone."""
    campaign, kept = campaigns[0], []
    name, true = campaign.recordings[2].name, campaign.recordings[2].setting.pressure
    corrected = Label(name, "pressure", true, 1.1 * true, 0.01)
    by_fit = [Label(name, "pressure", 1.1 * true, fitted * true, 0.01)]
    monkeypatch.setattr(drill_diagnosis, "mislabelled_pressures_by_fit", lambda _every: by_fit)
    monkeypatch.setattr(drill_diagnosis, "estimates_of", lambda _fitted: [])
    fit: Any = SimpleNamespace(reduced_chi_square=left)
    nothing: Any = None

    def tell():
        drill_diagnosis.keep_unless_contradicted([corrected], lambda *found: kept.append(found), fit, [], nothing)

    if ends:
        with pytest.raises(drill_diagnosis.CorrectionContradicted) as contradicted:
            tell()
        wrong = relabelled(campaign, 2, pressure=1.1 * true)
        other = drill_diagnosis.with_label_put_back(wrong, [corrected], contradicted.value.label)
        assert other.labels == [] and other.campaign.recordings[2].setting.pressure == true
    else:
        tell()
    assert kept == [(fit, [], nothing)]


def test_the_search_begins_again_with_a_label_that_was_put_back(monkeypatch, campaigns):
    campaign, searched = campaigns[0], []
    name, true = campaign.recordings[2].name, campaign.recordings[2].setting.pressure
    corrected = Label(name, "pressure", true, 1.1 * true, 0.01)
    wrong = relabelled(campaign, 2, pressure=1.1 * true)
    monkeypatch.setattr(drill_diagnosis, "with_labels_corrected", lambda _campaign: (wrong, [corrected]))

    def search(given, *_, labels, **__):
        searched.append((given.recordings[2].setting.pressure, list(labels)))
        if labels:
            raise drill_diagnosis.CorrectionContradicted(labels[0])
        return Outcome("agrees", [], *[None] * 6, [], stopped="here")  # type: ignore[arg-type]

    monkeypatch.setattr(drill_diagnosis, "search", search)
    outcome = drill_diagnosis.diagnose_drill(campaign)
    assert searched == [(pytest.approx(1.1 * true), [corrected]), (true, [])]
    assert outcome.labels == []
