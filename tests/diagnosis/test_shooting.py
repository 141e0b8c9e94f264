"""The states that windows begin with, and how they are fitted."""

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.fit import Hypothesis, Stage, Workers, _Search, fit, plain_cost
from drillenv.diagnosis.shooting import (
    JOIN,
    Physics,
    move,
    predict,
    quadratic,
    settle_states,
    shortening,
    sized,
    state_size,
    state_slopes,
    window_costs,
)
from drillenv.diagnosis.starts import placed_at
from drillenv.dynamics.effects import make
from tests.diagnosis.truth import by_frequency, concealed_as, rig_of, rock_of


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
    # of many recordings the states are left, either way, where a round gains less than is worth it, further apart
    made = plain_campaign(np.random.default_rng(4), 4, concealed_as(*effects), recordings=3, seconds=0.2)
    data = condition(made.campaign.recordings[0], rig_of(made)).thinned(4)
    physics = Physics(rig_of(made), rock_of(made), effects)
    off = Physics(rig_of(made), rock_of(made), (make("damping-quadratic", c2=700.0),))
    slopes = state_slopes(data, data.states, off, predict(data, data.states, off))
    ends = []
    for known in (None, slopes):
        states, moved = settle_states(data, data.states, physics, 12, known)
        ends.append(window_costs(data, states, moved))
    begun = window_costs(data, data.states, predict(data, data.states, physics))
    assert begun.sum() > 2.0 * ends[0].sum()
    # less than a hundredth of the noise apart, in any window
    np.testing.assert_allclose(ends[1], ends[0], atol=0.01 * np.diff(data.starts).min())


def test_what_is_not_judged_says_nothing_of_a_parameter():
    """A model is not held to what it said of the first window of a running rig, where nothing is compared with it."""
    made = plain_campaign(np.random.default_rng(3), 4, recordings=3, seconds=0.2)
    data = next(each for each in (condition(one, rig_of(made)) for one in made.campaign.recordings) if not each.fresh)
    physics = Physics(rig_of(made), rock_of(made))
    base = predict(data, data.states, physics)
    slopes = state_slopes(data, data.states, physics, base)
    columns = np.random.default_rng(1).standard_normal((2, 2, data.force.size))
    ends = np.zeros((2, *data.states.shape))
    one = quadratic(data, data.states, base, slopes, columns, ends)
    assert data.judged.start >= data.starts[1]
    columns[:, :, : data.judged.start] *= 1e3
    columns[:, :, data.judged.stop :] = 7.0
    other = quadratic(data, data.states, base, slopes, columns, ends)
    np.testing.assert_array_equal(one.curvature, other.curvature)
    np.testing.assert_array_equal(one.gradient, other.gradient)


@pytest.mark.parametrize("extra", [(), (make("accelerometer-resonance", f_a=3000.0, zeta_a=0.03),)])
def test_windows_asked_for_are_what_they_are_among_all(extra):
    effects = (make("damping-quadratic", c2=400.0), *extra)
    made = plain_campaign(np.random.default_rng(3), 4, concealed_as(*effects), recordings=3, seconds=0.2)
    # the slowest, whose windows last long enough for a sensor to stop ringing
    data = condition(by_frequency(made)[0], rig_of(made)).thinned(4)
    physics = Physics(rig_of(made), rock_of(made), effects[:1], extra)
    asked = np.arange(len(data.states)) % 3 == 1
    inside = np.zeros(data.force.size, dtype=bool)
    inside[data.starts[0] : data.starts[-1]] = np.repeat(asked, np.diff(data.starts))
    whole, part = (move(data, data.states, physics, 1, only=each) for each in (None, asked))
    np.testing.assert_array_equal(part.force[inside], whole.force[inside])
    np.testing.assert_array_equal(part.ends[asked], whole.ends[asked])
    base = predict(data, data.states, physics)
    all_slopes, some = (state_slopes(data, data.states, physics, base, each).channels for each in (None, asked))
    # of what rings through a whole window there is nothing left but a trace
    for one, other in zip(some, all_slopes, strict=True):
        np.testing.assert_allclose(one[:, inside], other[:, inside], rtol=0.0, atol=1e-6 * np.abs(other).max())


MOUNT = make("rock-mount-compliance", s_r=3e-8, m_r=30.0, zeta_r=0.05)


@pytest.fixture(scope="module")
def on_a_mount():
    """A recording of a rig that has been running, on a mount that swings, and its states settled at the truth."""
    made = plain_campaign(np.random.default_rng(5), 4, concealed_as(MOUNT), recordings=3, seconds=0.2)
    data = condition(made.campaign.recordings[0], rig_of(made)).thinned(4)
    physics = Physics(rig_of(made), rock_of(made), (MOUNT,))
    return data, physics, settle_states(data, sized(data, data.states, 6), physics, 12)[0]


def test_windows_that_do_not_know_how_the_mount_was_swinging_come_to_leave_noise(on_a_mount):
    data, physics, states = on_a_mount
    known = window_costs(data, states, predict(data, states, physics))
    guessed, made = settle_states(data, data.states, physics, 12)
    assert not data.fresh
    assert known.sum() < 1.1 * (data.judged.stop - data.judged.start)
    # with the face at rest as the recording begins, and no state of its own in any window; the first is not judged
    assert window_costs(data, guessed, made)[1] > 2.0 * known[1]


def test_ends_and_slopes_of_a_moving_face(on_a_mount):
    data, physics, states = on_a_mount
    base = predict(data, states, physics)
    slopes = state_slopes(data, states, physics, base)
    assert base.ends.shape == states.shape
    assert slopes.ends.shape == (6, *states.shape)
    # the face's place and speed as a window ends are linear in those as it begins, as long as the rock is not touched
    step = np.array([0.0, 0.0, 0.0, 0.0, 1e-7, 3e-5])
    moved = predict(data, states + step, physics).ends - base.ends
    said = np.einsum("j,jkl->kl", step, slopes.ends)
    usual = np.median(np.abs(moved - said), axis=0) / np.maximum(np.median(np.abs(moved), axis=0), 1e-15)
    assert (usual[[0, 1, 4, 5]] < 0.02).all()


def test_a_window_that_is_not_judged_holds_no_other_in_place(on_a_mount):
    data, physics, states = on_a_mount
    other = states.copy()
    other[0] += [20.0, 2e-3, 0.0, 0.0, 1e-6, 1e-3]
    costs = [plain_cost(data, each, predict(data, each, physics), JOIN) for each in (states, other)]
    # but for the weak belief in its first guess
    assert abs(costs[1] - costs[0]) < 0.1
    other[1] = other[0]
    assert plain_cost(data, other, predict(data, other, physics), JOIN) > costs[0] + 10.0


def test_half_the_sum_of_squares_is_the_quadratic_of_six_states(on_a_mount):
    data, physics, states = on_a_mount
    off = states + np.array([1.0, 1e-4, 1e-4, -1e-7, 1e-7, 1e-4])
    off[:, 3] = np.minimum(off[:, 3], 0.0)
    made = predict(data, off, physics)
    slopes = state_slopes(data, off, physics, made)
    nothing = np.zeros((0, 2, data.force.size)), np.zeros((0, *states.shape))
    part = quadratic(data, off, made, slopes, *nothing)
    before = plain_cost(data, off, made, JOIN)
    better = off + part.moves.reshape(off.shape)
    better[:, 3] = np.minimum(better[:, 3], 0.0)
    after = plain_cost(data, better, predict(data, better, physics), JOIN)
    assert before > 2.0 * part.value
    assert after == pytest.approx(part.value, rel=0.02)


def test_what_a_cylinder_has_lost_is_a_state_of_each_window():
    """It fades in the supply's time; what it does to the shaker in one window is next to nothing."""
    tau = 0.2
    air = make("air-spring", k_a=8e4, tau=tau)
    made = plain_campaign(np.random.default_rng(4), 4, concealed_as(air), recordings=3, seconds=0.3)
    # the fastest, since what it does to the shaker goes by the square of a window's duration
    data = condition(by_frequency(made)[-1], rig_of(made)).thinned(4)
    assert not data.fresh
    physics = Physics(rig_of(made), rock_of(made), (air,))
    size = state_size(["air-spring"])
    assert state_size(["air-spring", "rock-mount-compliance"]) == state_size(["rock-mount-compliance"]) + 1
    states = settle_states(data, sized(data, data.states, size), physics, 12)[0]
    base = predict(data, states, physics)
    slopes = state_slopes(data, states, physics, base)
    lasts = np.diff(data.starts) / data.rate
    assert np.abs(slopes.ends[4, :, 4] - np.exp(-lasts / tau)).max() < 0.03
    # no window answers to what was lost in another
    moved = states + np.array([0.0, 0.0, 0.0, 0.0, 5.0]) * (np.arange(len(states)) == 3)[:, None]
    ends = predict(data, moved, physics).ends - base.ends
    assert np.flatnonzero(np.abs(ends).max(axis=1)).tolist() == [3]
    # the same windows without it, and with it as nothing is known of it
    assert np.array_equal(sized(data, states, 4), states[:, :4])
    assert (sized(data, states[:, :4], size)[:, 4] == data.lost).all()


def test_states_give_way_where_air_is_less_stiff_and_sooner_supplied(monkeypatch):
    """k_a, tau and what was lost go into the model as products, and miss the joints as the first two are moved."""
    air = make("air-spring", k_a=8e4, tau=0.2)
    # of many recordings a fit finds the way without it too; of this one it does not
    made = plain_campaign(np.random.default_rng(39), 4, concealed_as(air), recordings=3, seconds=0.3)
    data = condition(made.campaign.recordings[0], rig_of(made)).thinned(4)
    plain, there = Hypothesis((), (), Physics(rig_of(made), rock_of(made))), {"k_a": 3e4, "tau": 0.1}
    hypothesis, _values = placed_at(plain, "air-spring", there, [data])
    workers, stages = Workers(), (Stage(1.0, 0, 8),)
    try:
        corrected = fit([data], hypothesis, workers, stages=stages)
        monkeypatch.setattr(_Search, "_corrected", lambda _self, _point, placed, said, _stage: (placed, said))
        cut_short = fit([data], hypothesis, workers, stages=stages)
    finally:
        workers.close()
    assert corrected.per_sample < 1.0 < 1.05 < cut_short.per_sample
