"""The states that windows begin with, and how they are fitted."""

import numpy as np
import pytest

from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.rehearsal import rehearse
from drillenv.diagnosis.shooting import Physics, predict, settle_states, shortening, state_slopes, window_costs
from drillenv.dynamics.effects import make


@pytest.mark.parametrize("k3", [0.0, 1e3, 1e8, 7e9, 1e13])
def test_shortening_carries_the_force(k3):
    force = np.array([-3000.0, -1.0, 0.0, 1e-3, 200.0, 3000.0])
    y = shortening(force, 7e4, k3)
    np.testing.assert_allclose(7e4 * y + k3 * y**3, force, rtol=1e-9, atol=1e-12)


def test_a_little_hardening_changes_a_little():
    force = np.linspace(-500.0, 500.0, 11)
    np.testing.assert_allclose(shortening(force, 7e4, 1.0), force / 7e4, rtol=1e-6)


@pytest.mark.parametrize("effects", [(), (make("damping-quadratic", c2=400.0),)])
def test_slopes_of_a_place_nearby_lead_to_the_same_states(effects):
    play = rehearse(np.random.default_rng(3), 4, effects, recordings=3, seconds=0.2)
    data = condition(play.campaign.recordings[0], play.rig).thinned(4)
    physics = Physics(play.rig, play.rock, effects)
    off = Physics(play.rig, play.rock, (make("damping-quadratic", c2=700.0),))
    slopes = state_slopes(data, data.states, off, predict(data, data.states, off))
    ends = []
    for known in (None, slopes):
        states, made = settle_states(data, data.states, physics, 12, known)
        ends.append(window_costs(data, states, made))
    begun = window_costs(data, data.states, predict(data, data.states, physics))
    assert begun.sum() > 2.0 * ends[0].sum()
    # less than a hundredth of the noise apart, in any window
    np.testing.assert_allclose(ends[1], ends[0], atol=0.01 * np.diff(data.starts).min())
