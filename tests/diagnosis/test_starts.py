"""Where the fit of one mechanism more begins."""

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.decide import nominal_hypothesis
from drillenv.diagnosis.fit import Fit, Hypothesis, Parameter
from drillenv.diagnosis.shooting import Physics, Quadratic, predict
from drillenv.diagnosis.starts import carried, from_nothing, leaving_out, opened, placed_at, slight
from drillenv.dynamics.effects import make
from drillenv.rig import Rig
from tests.diagnosis.truth import rig_of, rock_of


@pytest.fixture(scope="module")
def made():
    """A recording, its rig, and states off the truth."""
    made = plain_campaign(np.random.default_rng(3), 4, recordings=3, seconds=0.2)
    data = condition(made.campaign.recordings[1], rig_of(made)).thinned(4)
    return data, Physics(rig_of(made), rock_of(made))


def test_a_spring_that_has_play_carries_the_force_that_it_carried_without(made):
    data, physics = made
    k, rest = physics.rig.stiffness, physics.rig.static_force(data.setting)
    gap, begin = 3e-4, -1e-4
    states = np.zeros((7, 4))
    states[:, 0] = rest + k * np.array([-4e-4, -2e-4, -1.01e-4, -0.99e-4, 0.0, 1e-4, 5e-4])
    put = opened(states, physics, data, {"g": gap, "y0": begin})
    # what the equation of the effect makes of the deflection
    beyond = (put[:, 0] - rest) / k
    assert rest + k * (beyond - np.clip(beyond - begin, 0.0, gap)) == pytest.approx(states[:, 0], rel=1e-12)
    assert np.array_equal(put[:, 1:], states[:, 1:])


def test_windows_go_on_where_those_before_them_end(made):
    data, physics = made
    held = physics._replace(motion=(make("guide-friction", fc1=60.0, vs1=2e-3),))
    begun = data.states + np.array([5.0, 1e-3, 0.0, 0.0])
    gone_on = carried(begun, held, data)
    ends = predict(data, gone_on, held).ends
    assert np.array_equal(ends[:-1, :2], gone_on[1:, :2])
    assert np.array_equal(gone_on[:, 2:], begun[:, 2:])
    assert not np.array_equal(ends[:-1, :2], begun[1:, :2])


def test_a_mechanism_left_out_takes_its_unknowns_with_it():
    campaign = plain_campaign(np.random.default_rng(3), 4, recordings=3, seconds=0.2).campaign
    data = [condition(each, Rig()) for each in campaign.recordings]
    plain = nominal_hypothesis(campaign)
    one, _values = placed_at(plain, "air-spring", {"k_a": 5e4, "tau": 0.2}, data)
    both, values = placed_at(one, "contact-rate", {"chi": 0.3}, data)
    alone, kept = leaving_out(both, "air-spring")
    assert alone.mechanisms == ("contact-rate",)
    assert [each.name for each in alone.parameters] == [*(each.name for each in plain.parameters), "contact-rate chi"]
    assert np.array_equal(values[kept], [each.value for each in alone.parameters])


def test_friction_that_is_a_damper_is_something_however_strong_it_may_be():
    """Only fc1 / vs1 is known of it: fc1 might be anything, but vs1 held it is far from nothing."""
    strengths = (("fc1", 400.0, 20.0), ("vs1", 8e-3, 1e-3))
    own = tuple(Parameter(f"guide-friction {name}", value, width, 0.0) for name, value, width in strengths)
    quotient = np.array([1.0, -1.0]) * 1e3
    curvature = np.outer(quotient, quotient) + np.eye(2)
    nothing = np.zeros(0)
    part = Quadratic(0.0, np.zeros(2), curvature, 1000, nothing, nothing)
    hypothesis = Hypothesis((), (("guide-friction", (), own),))
    fitted = Fit(
        hypothesis, np.array([400.0, 8e-3]), [], [], [part], [], [], [np.arange(2)], cost=500.0, rounds=1, loose=1.0
    )  # fmt: skip
    assert fitted.spread[0] == pytest.approx(20.0 / np.sqrt(2.0), rel=1e-3)
    assert from_nothing(fitted, "guide-friction") == pytest.approx([20.0 * np.sqrt(1e6 + 1.0)], rel=1e-3)
    assert from_nothing(fitted, "air-spring") == []


@pytest.mark.parametrize(("n", "is_slight"), [(1.009, True), (0.99, True), (1.05, False)])
def test_a_strength_far_below_the_usual_is_slight(n, is_slight):
    own = (Parameter("contact-power-law n", n, 0.3, 0.0),)
    fitted = Fit(
        Hypothesis((), (("contact-power-law", (), own),)), np.array([n]), [], [], [], [], [], [], 500.0, 1, loose=1.0
    )  # fmt: skip
    assert slight(fitted, "contact-power-law") is is_slight
