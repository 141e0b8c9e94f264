"""Every fault is found when it is put into sound recordings of one body, and what a body may do is no fault."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from drillenv.recordings import Channel, Nominal, check_quality, read_campaign

NAMES = ["r01", "r02", "r03"]
CHANNELS = ["force", "position", "velocity", "acceleration"]


@pytest.fixture
def without(body):
    """A function that hands back the campaign with these channels only, and other nominal constants."""

    def kept(*channels, **nominal):
        recordings = tuple(
            replace(each, channels=MappingProxyType({name: each.channels[name] for name in channels}))
            for each in body.recordings
        )
        return replace(body, recordings=recordings, nominal={**body.nominal, **nominal})

    return kept


def found_in(campaign, name) -> set[tuple[str, str | None]]:
    findings = check_quality(campaign)
    for finding in findings:
        assert str(finding).isprintable()
        assert 0.0 <= finding.start < finding.stop
    assert {finding.recording for finding in findings} <= {name}
    return {(finding.kind, finding.channel) for finding in findings}


SETS = [CHANNELS, ["force", "position"], ["force", "position", "velocity"], ["force", "position", "acceleration"]]


@pytest.mark.parametrize("channels", SETS)
@pytest.mark.parametrize("mass", [2.0, None])
def test_a_sound_campaign_has_no_findings(channels, mass, without):
    known = Nominal(mass, None if mass is None else 0.01, "kg")
    assert check_quality(without(*channels, mass=known)) == ()


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("name", NAMES)
def test_turned_signs(channel, name, body, spoil, samples_of):
    turned = spoil(body, name, **{channel: -samples_of(body, name)[channel]})
    assert found_in(turned, name) == {("sign", channel)}


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("factor", [1000.0, 1e-3, 9.80665, 1 / 9.80665])
def test_units(channel, factor, body, spoil, samples_of):
    campaign = spoil(body, "r02", **{channel: factor * samples_of(body, "r02")[channel]})
    assert found_in(campaign, "r02") == {("unit", channel)}
    (finding,) = check_quality(campaign)
    assert f"reads {max(factor, 1 / factor):.4g} times too {'large' if factor > 1 else 'small'}" in finding.sentence


@pytest.mark.parametrize("channel", ["force", "position"])
@pytest.mark.parametrize("factor", [-1.0, 1000.0, 1 / 9.80665])
@pytest.mark.parametrize("mass", [2.0, None])
def test_where_two_channels_cannot_be_told_apart_both_are_named(channel, factor, mass, without, spoil, samples_of):
    """With no mass stated, a unit shows against the other recordings."""
    campaign = without("force", "position", mass=Nominal(mass, None, "kg"))
    spoiled = spoil(campaign, "r02", **{channel: factor * samples_of(campaign, "r02")[channel]})
    assert found_in(spoiled, "r02") == {("sign" if factor < 0 else "unit", "force, position")}


PAIRS = [(first, second) for i, first in enumerate(CHANNELS) for second in CHANNELS[i + 1 :]]


@pytest.mark.parametrize(("first", "second"), PAIRS)
@pytest.mark.parametrize("name", NAMES)
def test_swapped_channels(first, second, name, body, spoil, samples_of):
    samples = samples_of(body, name)
    swapped = spoil(body, name, **{first: samples[second], second: samples[first]})
    assert found_in(swapped, name) == {("swapped", f"{first}, {second}")}


def test_force_and_position_swapped_with_nothing_beside_them(without, spoil, samples_of):
    campaign = without("force", "position")
    samples = samples_of(campaign, "r01")
    swapped = spoil(campaign, "r01", force=samples["position"], position=samples["force"])
    assert found_in(swapped, "r01") == {("swapped", "force, position")}


def test_a_missing_position(without):
    findings = check_quality(without("force", "velocity"))
    assert [(each.recording, each.kind, each.channel) for each in findings] == [
        (name, "missing-channel", "position") for name in NAMES
    ]


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("value", [0.0, "held"])
@pytest.mark.parametrize("at", [850, 1300, 1650])
def test_dropouts(channel, value, at, body, spoil, samples_of):
    samples = samples_of(body, "r03")[channel].copy()
    samples[at : at + 150] = samples[at - 1] if value == "held" else value
    campaign = spoil(body, "r03", **{channel: samples})
    assert found_in(campaign, "r03") == {("dropout", channel)}
    (finding,) = check_quality(campaign)
    assert finding.start == pytest.approx(at / 1000.0, abs=0.002)
    assert finding.stop == pytest.approx((at + 150) / 1000.0, abs=0.002)


@pytest.mark.parametrize("channel", CHANNELS)
def test_clipping(channel, body, spoil, samples_of):
    samples = samples_of(body, "r03")[channel]
    clipped = np.minimum(samples, 0.6 * samples.max())
    assert ("clipping", channel) in found_in(spoil(body, "r03", **{channel: clipped}), "r03")


@pytest.mark.parametrize("channel", CHANNELS)
def test_what_is_no_number(channel, body, spoil, samples_of):
    samples = samples_of(body, "r01")[channel].copy()
    samples[100:130] = np.nan
    assert found_in(spoil(body, "r01", **{channel: samples}), "r01") == {("not-a-number", channel)}


# --------------------------------------------------------------------------------------------------------------------
# what a body may do


def test_a_commanded_force_may_stay(without, spoil, samples_of):
    """A noiseless command: silence, a step, a ramp, silence."""
    campaign = without("force", "position")
    command = np.zeros(3000)
    command[500:1500], command[1500:2000] = 5.0, np.linspace(5.0, -5.0, 500)
    recording = campaign.recordings[0]
    position = np.cumsum(np.cumsum(command)) * 1e-6  # a free mass of 1 kg
    channels = {"force": Channel(command, "N", "f"), "position": Channel(position, "mm", "x")}
    nominal = {"mass": Nominal(1.0, 0.1, "kg")}
    campaign = replace(campaign, recordings=(replace(recording, channels=channels),), nominal=nominal)
    assert [finding for finding in check_quality(campaign) if finding.severity != "note"] == []


def test_a_body_may_rest(without, spoil, samples_of):
    """It slides to a stop, and a coarse encoder shows no more noise."""
    campaign = without("position", "velocity")
    time = np.arange(3000) / 1000.0
    speed = np.maximum(0.5 - 0.4 * time, 0.0)
    position = np.round((np.cumsum(speed) / 1000.0) / 1e-5) * 1e-5
    spoiled = spoil(campaign, "r01", position=position, velocity=speed)
    assert [finding for finding in check_quality(spoiled) if finding.severity != "note"] == []


def test_the_blow_of_a_hammer_is_no_spike(without, spoil, samples_of):
    campaign = without("force", "position")
    force = np.random.default_rng(0).normal(0.0, 0.05, 3000)
    force[100:106] += 400.0 * np.sin(np.pi * (np.arange(6) + 0.5) / 6)
    ring = 1e-3 * np.exp(-2.0 * np.arange(3000) / 1000.0) * np.sin(20.0 * np.arange(3000) / 1000.0)
    spoiled = spoil(campaign, "r01", force=force, position=np.concatenate((np.zeros(103), ring[:-103])))
    assert all(finding.kind not in ("spike", "dropout") for finding in check_quality(spoiled))


# --------------------------------------------------------------------------------------------------------------------
# the measured campaigns


@pytest.mark.parametrize("channel", ["force", "position"])
@pytest.mark.parametrize("factor", [-1.0, 1000.0])
def test_faults_in_the_measured_axis(channel, factor, shared, spoil, samples_of):
    """Two recordings and no mass stated: a unit shows, and not in which of the two; a sign shows in its recording."""
    campaign = read_campaign(shared / "real" / "emps")
    spoiled = spoil(campaign, "r01", **{channel: factor * samples_of(campaign, "r01")[channel]})
    found = {(finding.recording, finding.kind, finding.channel) for finding in check_quality(spoiled)}
    if factor < 0:
        assert found == {("r01", "sign", "force, position")}
    else:
        assert found == {("r01", "unit", "force, position"), ("r02", "unit", "force, position")}


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["position", "velocity", "acceleration"])
def test_faults_in_the_measured_impactor(channel, shared, spoil, samples_of):
    campaign = read_campaign(shared / "real" / "cyberdiver-a")
    samples = samples_of(campaign, "r12")
    assert found_in(spoil(campaign, "r12", **{channel: -samples[channel]}), "r12") == {("sign", channel)}
    assert found_in(spoil(campaign, "r12", **{channel: samples[channel] / 1e3}), "r12") == {("unit", channel)}
    other = {"position": "velocity", "velocity": "acceleration", "acceleration": "position"}[channel]
    swapped = spoil(campaign, "r12", **{channel: samples[other], other: samples[channel]})
    ((kind, which),) = found_in(swapped, "r12")
    assert kind == "swapped"
    assert set(which.split(", ")) == {channel, other}
    held = samples[channel].copy()
    held[300:340] = 0.0
    assert found_in(spoil(campaign, "r12", **{channel: held}), "r12") == {("dropout", channel)}
