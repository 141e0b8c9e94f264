"""What a diagnosis says of a mismatch that it cannot name: each shape put into what a good fit leaves."""

from dataclasses import replace

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.decide import nominal_hypothesis
from drillenv.diagnosis.fit import Workers, fit
from drillenv.diagnosis.shape import common_line, described, lines_left, repeated
from drillenv.rig import Rig


@pytest.fixture(scope="module")
def fitted():
    """Recordings of the paper's model, and the fit that leaves their noise."""
    made = plain_campaign(np.random.default_rng(9), 4, recordings=6, seconds=0.4)
    data = [condition(each, Rig()).thinned(4) for each in made.campaign.recordings]
    workers = Workers()
    try:
        return data, fit(data, nominal_hypothesis(made.campaign), workers)
    finally:
        workers.close()


def with_more(fitted, what):
    """The fit, with something added to what it leaves of the acceleration, in its noise's standard deviations."""
    data, found = fitted
    predictions = []
    for each, made in zip(data, found.predictions, strict=True):
        extra = each.noise_acceleration * what(each, np.arange(each.force.size) / each.rate)
        predictions.append(made._replace(acceleration=made.acceleration - extra))
    return data, replace(found, predictions=predictions)


def test_noise_has_no_shape(fitted):
    assert lines_left(*fitted) == []
    assert not repeated(*fitted).sure
    assert common_line(*fitted) is None


def test_a_frequency_that_all_recordings_share(fitted):
    shaken = with_more(fitted, lambda data, time: 0.8 * np.sin(2 * np.pi * 37.3 * time + int(data.name[1:])))
    line = common_line(*shaken)
    assert line is not None
    assert line.channel == "acceleration"
    assert line.frequency == pytest.approx(37.3, abs=0.3)
    noise = np.median([each.noise_acceleration for each in shaken[0]])
    assert line.amplitude == pytest.approx(0.8 * noise, rel=0.25)
    assert "periodic at 37." in described(*shaken)[0]
    assert "unrelated to the excitation" in described(*shaken)[0]


def test_what_repeats_itself_is_no_noise(fitted):
    # this adds 1 % to the sum of squares of one channel
    steady = repeated(*with_more(fitted, lambda data, time: 0.15 * np.sin(3 * data.omega * time + data.phase)))
    assert steady.sure
    assert steady.steady > 10.0 * abs(steady.changing)
    drifts = with_more(fitted, lambda data, time: (time - time.mean()) / time.max() * np.sin(data.omega * time))
    found = repeated(*drifts)
    assert found.sure
    assert found.changing > 3.0 * abs(found.steady)
    assert any("changing steadily" in each for each in described(*drifts))


def test_what_does_not_keep_step_does_not_repeat_itself(fitted):
    shaken = with_more(fitted, lambda data, time: 0.15 * np.sin(2.3 * data.omega * time))
    assert not repeated(*shaken).sure


def test_multiples_of_the_excitation_are_not_called_foreign(fitted):
    shaken = with_more(fitted, lambda data, time: 2.0 * np.sin(3 * data.omega * time))
    assert common_line(*shaken) is None
    assert lines_left(*shaken) == []


def test_growth(fitted):
    rng = np.random.default_rng(0)
    grown = with_more(fitted, lambda data, time: 6.0 * time / time[-1] * rng.standard_normal(time.size))
    assert "It grows in the course of a recording." in described(*grown)
    faded = with_more(fitted, lambda data, time: 6.0 * (1.0 - time / time[-1]) * rng.standard_normal(time.size))
    assert "It fades in the course of a recording." in described(*faded)


def test_single_impacts(fitted):
    rng = np.random.default_rng(0)

    def struck(data, time):
        hit = np.zeros(time.size)
        for start in rng.choice(data.starts[1:-2], 3, replace=False).tolist():
            hit[start + 5 : start + 25] = 12.0
        return hit

    (said,) = [each for each in described(*with_more(fitted, struck)) if "impacts have" in each]
    few, of = int(said.split()[0]), int(said.split()[2])
    assert few <= 18 < of


def test_a_phase(fitted):
    shaken = with_more(
        fitted, lambda data, time: 5.0 * (np.abs(np.mod(data.phase + data.omega * time, 2 * np.pi) - 2.36) < 0.3)
    )
    assert any("of it is where the excitation's phase is 90 to 180 degrees" in each for each in described(*shaken))


def test_a_setting(fitted):
    shaken = with_more(fitted, lambda data, time: data.setting.frequency / 40.0 * np.cos(0.5e4 * time))
    assert "There is more of it at high frequency." in described(*shaken)
