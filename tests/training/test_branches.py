"""Advantages measured on copies of the rigs: against single rigs, and what they leave alone."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from drillenv.controllers.hole.belief import SIZE
from drillenv.controllers.hole.learned import actions_of as hole_actions
from drillenv.controllers.policies import actions_of, outputs_for
from drillenv.training.believing import METRE, WORTH
from drillenv.training.branches import Branches
from drillenv.training.learner import Learner
from drillenv.training.recipe import START, Recipe

SMALL = {"env": "drillenv/DrillLayers-v0", "envs": 3, "stack": 2, "rollout": 8, "batch": 8, "layers": (8,), "seed": 5}


def begun(ahead, **change):
    """A learner whose rigs have drilled for a while, and what measures its actions."""
    learner = Learner(Recipe(**(SMALL | change), ahead=ahead), threads=1)
    learner.model.learn(2 * learner.recipe.update)
    branches = learner.model.env
    assert isinstance(branches, Branches)
    return learner, branches


@pytest.mark.parametrize("ahead", [1, 3])
def test_an_advantage_is_the_difference_of_two_futures(ahead):
    """The same two futures on single environments, for a policy that asks for the same whatever it sees."""
    learner, branches = begun(ahead)
    with torch.no_grad():
        learner.model.policy.action_net.weight.zero_()
        learner.model.policy.action_net.bias.copy_(torch.from_numpy(outputs_for(*START)))
    mean = outputs_for(*START).astype(np.float32)
    outputs = mean + np.array([[-0.3, 0.1, 0.2], [0.0, 0.3, 0.5], [0.0, 0.0, 0.0]], dtype=np.float32)
    branches.step_async(outputs)
    found = branches.measured[-1]
    env = gym.make(SMALL["env"]).unwrapped
    env.reset(seed=0)
    for i in range(3):
        earned = []
        for first in (outputs[i], 2.0 * mean - outputs[i]):
            env.set_state(learner.rigs.rigs.get_state(i))
            rewards = [float(env.step(actions_of(each))[1]) for each in [first] + [mean] * (ahead - 1)]
            earned.append(sum(rewards))
        assert found[i] == pytest.approx(0.5 * (earned[0] - earned[1]), abs=1e-12)
    assert found[2] == 0.0 and np.abs(found[:2]).min() > 1e-4


def test_an_advantage_on_a_hole_is_the_difference_of_two_discounted_futures_and_what_they_are_worth():
    """The same on single environments, for a policy that asks for the same and never changes a bit."""
    learner, branches = begun(3, env="drillenv/DrillBit-v0", stack=1, algo="ppo-vine", gamma=0.9)
    policy, mean = learner.model.policy, np.array([0.3, -0.2, -0.4, -1.0], dtype=np.float32)
    with torch.no_grad():
        policy.action_net.weight.zero_()
        policy.action_net.bias.copy_(torch.from_numpy(mean))
    before = {name: value.copy() for name, value in learner.believing.belief.arrays.items()}
    away = np.array([[-0.3, 0.1, 0.2, 0.0], [0.2, 0.3, 0.1, 0.0], [0.0, 0.0, 0.0, 0.0]], dtype=np.float32)
    seen, value = [], branches._value
    branches._value = lambda known: seen.append(known) or value(known)
    outputs = mean + away
    branches.step_async(outputs)
    found, worth = branches.measured[-1], value(seen[0]).astype(float)
    for name, remembered in learner.believing.belief.arrays.items():
        np.testing.assert_array_equal(remembered, before[name])
    env = gym.make("drillenv/DrillBit-v0", costs={"metre": METRE}).unwrapped
    env.reset(seed=0)
    for i in range(3):
        earned = []
        for side, first in enumerate((outputs[i], 2.0 * mean - outputs[i])):
            env.set_state(learner.rigs.rigs.get_state(i))
            rewards = [float(env.step(hole_actions(each, np.zeros(SIZE)))[1]) for each in (first, mean, mean)]
            discounted = sum(WORTH * 0.9**k * reward for k, reward in enumerate(rewards))
            earned.append(discounted + 0.9**3 * worth[i + 3 * side])
        assert found[i] == pytest.approx(0.5 * (earned[0] - earned[1]), abs=1e-6)
    # the rows of a product of matrices may be rounded otherwise
    assert abs(found[2]) < 1e-6 and np.abs(found[:2]).min() > 1e-4 and np.ptp(worth) > 0.0


def test_a_copy_of_a_hole_that_is_done_earns_no_more():
    _, branches = begun(2, env="drillenv/DrillBit-v0", stack=1, algo="ppo-vine", env_kwargs={"depth": 0.5})
    copies = branches._copies
    copies.begin()
    outputs, noise = np.tile(np.float32([0.4, 0.2, -0.2, -1.0]), (6, 1)), np.zeros((6, copies.noise_size))
    ended = np.zeros(6, dtype=bool)
    for _ in range(600):
        copies.step(outputs, noise)
        assert not copies.rewards[ended].any()
        ended = ~copies.running
        if ended.all():
            break
    assert ended.all()


def test_both_futures_see_the_same_and_go_on_as_the_policy_would():
    """For a policy that answers to what it sees, the mean action is worth nothing more than itself, noise or not."""
    learner, branches = begun(4)
    seen = torch.from_numpy(learner.stacked.stacked_obs.stacked_obs)
    with torch.no_grad():
        branches.model.policy.action_net.weight.mul_(10.0)
        mean = branches.model.policy.get_distribution(seen).mode().numpy()
    branches.step_async(mean)
    np.testing.assert_allclose(branches.measured[-1], 0.0, atol=1e-6)
    branches.step_async(mean - np.array([0.0, 0.2, 0.2], dtype=np.float32))
    assert np.abs(branches.measured[-1]).min() > 1e-4


def test_the_rigs_do_not_notice():
    learner, branches = begun(3)
    rigs = learner.rigs.rigs
    before = [rigs.get_state(i) for i in range(3)]
    branches.step_async(np.full((3, 3), 0.3, dtype=np.float32))
    for i in range(3):
        now = rigs.get_state(i)
        assert now.noise == before[i].noise and now.rig.reward == before[i].rig.reward
        for one, other in zip(now.rig.arrays, before[i].rig.arrays, strict=True):
            np.testing.assert_array_equal(one, other)


def test_an_update_goes_by_what_was_measured():
    learner, branches = begun(2)
    measured = np.array(branches.measured).T.ravel()  # rig by rig, as the buffer has them after an update
    np.testing.assert_array_equal(learner.model.rollout_buffer.advantages.ravel(), measured.astype(np.float32))
    assert np.abs(measured).min() > 0.0


def test_what_is_lost_on_either_side_alike_counts_nothing():
    """Opposite outputs have opposite advantages, however curved the reward is between them."""
    _, branches = begun(3)
    branches.model.policy.action_net.weight.requires_grad_(False).zero_()
    mean = np.tile(branches.model.policy.action_net.bias.detach().numpy(), (3, 1))
    there = np.array([0.0, 0.3, -0.3], dtype=np.float32)
    found = [branches._measure(mean + sign * there) for sign in (1.0, -1.0)]
    np.testing.assert_allclose(found[0], -found[1], rtol=1e-5)
    assert np.abs(found[0]).min() > 1e-4
