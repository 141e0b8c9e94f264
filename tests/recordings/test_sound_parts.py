"""Faults take as little of a campaign as they must, and of long recordings the stretch is used that varies most."""

from dataclasses import replace

import numpy as np
import pytest

from drillenv.recordings import Channel, check_quality
from drillenv.recordings.excerpt import ENOUGH, LEAST, excerpts
from drillenv.recordings.sound_parts import sound_parts


def spoiled(campaign, name, change, **more):
    """The samples of every channel of a recording, changed; ``more`` are other fields of it."""
    recordings = []
    for each in campaign.recordings:
        if each.name == name:
            channels = {
                key: replace(channel, samples=change(key, channel.samples.copy()))
                for key, channel in each.channels.items()
            }
            each = replace(each, channels=channels, **more)
        recordings.append(each)
    return replace(campaign, recordings=tuple(recordings))


def recording(campaign, name):
    return next(each for each in campaign.recordings if each.name == name)


def used(campaign):
    """What is left after the checks: (names, starts, samples) and the sentences."""
    left, said = sound_parts(campaign, check_quality(campaign))
    return [(each.name, each.starts, each.size) for each in left.recordings], said


def test_a_sound_campaign_stays(drill):
    left, said = sound_parts(drill, check_quality(drill))
    assert left.recordings == drill.recordings and said == []


def test_lost_samples_make_two_parts(drill):
    """37 samples are missing: both parts are used, the second as one of a running rig."""
    size, at = recording(drill, "r02").size, recording(drill, "r02").size // 2
    lost = spoiled(drill, "r02", lambda _name, samples: np.delete(samples, slice(at, at + 37)))
    found, (sentence,) = used(lost)
    (first, begun, before), (second, goes_on, after) = [each for each in found if each[0].startswith("r02")]
    assert (first, begun) == ("r02", recording(drill, "r02").starts) and goes_on == "running"
    assert second.startswith("r02 from ")
    assert abs(before - at) <= 3 and size - 37 - 6 <= before + after < size - 37
    assert "time-gap" in sentence and "r02" in sentence
    assert len(found) == len(drill.recordings) + 1


def test_pre_trigger_is_left_out(drill):
    """50 ms before the excitation sets in; a recording from rest is still one."""
    fresh = next(each for each in drill.recordings if each.starts == "fresh")
    wait = round(0.05 * fresh.sample_rate)
    rng = np.random.default_rng(1)

    def before(name, samples):
        still = {"excitation": 0.0, "force": samples[0], "acceleration": 0.0}[name]
        noise = {"excitation": 1e-3, "force": 2.0, "acceleration": 1.0}[name]
        return np.concatenate([still + noise * rng.standard_normal(wait), samples])

    found, (sentence,) = used(spoiled(drill, fresh.name, before))
    ((_name, starts, size),) = [each for each in found if each[0] == fresh.name]
    assert starts == "fresh" and abs(size - fresh.size) <= 8
    assert "dropout" in sentence


def test_a_dead_channel_that_nobody_needs_is_left_out(drill):
    first = drill.recordings[0]
    channels = {**first.channels, "position": Channel(np.zeros(first.size), "m", "position")}
    dead = replace(drill, recordings=(replace(first, channels=channels), *drill.recordings[1:]))
    left, (sentence,) = sound_parts(dead, check_quality(dead))
    assert "position" not in left.recordings[0].channels and left.recordings[0].size == first.size
    assert first.name in sentence and "position" in sentence


@pytest.mark.parametrize("channel", ["excitation", "force", "acceleration"])
def test_a_dead_channel_that_is_needed_takes_the_recording(drill, channel):
    dead = spoiled(drill, "r03", lambda name, samples: 0.0 * samples if name == channel else samples)
    found, (sentence,) = used(dead)
    assert [name for name, *_ in found] == [each.name for each in drill.recordings if each.name != "r03"]
    assert sentence.startswith("r03 is left out")


def test_what_is_between_faults_must_be_long_enough(drill):
    """A dropout leaves two periods before it: too few to be used."""
    setting, rate = recording(drill, "r03").setting, recording(drill, "r03").sample_rate
    first = round(2.0 * rate / setting.frequency)

    def hole(name, samples):
        if name == "force":
            samples[first : first + 40] = np.nan
        return samples

    found, _said = used(spoiled(drill, "r03", hole))
    ((name, starts, size),) = [each for each in found if each[0].startswith("r03")]
    assert (name, starts, size) == ("r03", "running", recording(drill, "r03").size - first - 40)


def test_of_long_recordings_the_stretch_that_varies_is_used(drill):
    """Repeated ten times over, with one place where the blows change: that one is found."""
    each = recording(drill, "r02")
    period = round(each.sample_rate / each.setting.frequency)
    many = 10 * max(LEAST, ENOUGH // len(drill.recordings))
    blow = np.tile(np.concatenate([np.zeros(period // 2), np.ones(period - period // 2)]), many)
    rng = np.random.default_rng(2)
    at = 7 * many // 10 * period
    sizes = np.ones(blow.size)
    sizes[at : at + 40 * period] = np.repeat(rng.uniform(0.5, 1.5, 40), period)
    samples = {"excitation": blow, "force": 100.0 * blow * sizes, "acceleration": blow}
    long = spoiled(drill, "r02", lambda name, _samples: samples[name])
    left, (sentence,) = excerpts(long)
    one = recording(left, "r02")
    assert one.size == pytest.approx(max(LEAST, ENOUGH // len(drill.recordings)) * period, abs=period)
    # all that vary are in it
    assert np.unique(one.channels["force"].samples).size == np.unique(samples["force"]).size == 42
    assert "r02" in sentence
    fresh = spoiled(drill, "r02", lambda name, _samples: samples[name], starts="fresh")
    begun = recording(excerpts(fresh)[0], "r02")
    assert begun.starts == "fresh"
    assert np.array_equal(begun.channels["force"].samples, samples["force"][: begun.size])


def test_short_recordings_stay(drill):
    left, said = excerpts(drill)
    assert [each.size for each in left.recordings] == [each.size for each in drill.recordings] and said == []
