"""Wrong constants, drawn anew for each episode: how far they scatter, by which seed, and that nothing else changes."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils import seeding

import drillenv  # noqa: F401
from drillenv.checks import InputError
from drillenv.env.hole.episodes import draw_hole, read_hole
from drillenv.env.hole.task import HoleTask
from drillenv.env.registration import HOLE_IDS, IDS
from drillenv.env.task import Task
from drillenv.training.conditions import CONDITIONS, episodes_of

PAPER = np.array([265.0, 3.0, 68.85e3, 2.45e3, 1.0, 1.0])
STATED = np.array([1.0, 0.01, 2000.0, 75.0, 0.015, 0.02])
"""Masses in kg, stiffness in N/m, damping in N s/m and the gains, with the errors stated for them."""
EXACT = [*IDS[:2], *HOLE_IDS]
"""Those whose constants are right where nobody asks for errors."""


def rig(env):
    return env.unwrapped._batch.plants.rigs[0].copy()


def readings(env, seed, steps=3):
    """The readings of the first steps of an episode, and of the reset of the next."""
    seen = [env.reset(seed=seed)[0]]
    seen += [env.step(np.full(env.action_space.shape, -0.2, dtype=np.float32))[0] for _ in range(steps)]
    return np.stack([*seen, env.reset()[0]])


@pytest.mark.parametrize("identity", EXACT)
def test_no_errors_are_the_environment_as_it_is(identity):
    plain = readings(gym.make(identity), 5)
    for errors in (None, 0, 0.0):
        assert readings(gym.make(identity, errors=errors), 5).tobytes() == plain.tobytes()
    assert readings(gym.make(identity, errors=1.0), 5).tobytes() != plain.tobytes()


def test_hidden_physics_has_one_error_unless_another_number_is_given():
    drawn = {errors: Task("hidden", errors=errors).draw(np.random.default_rng(2)) for errors in (None, 1.0, 2.0)}
    assert np.array_equal(drawn[None].rig, drawn[1.0].rig) and drawn[None].effects == drawn[1.0].effects
    assert drawn[2.0].rig - PAPER == pytest.approx(2 * (drawn[1.0].rig - PAPER))
    assert drawn[2.0].effects == drawn[1.0].effects
    right = Task("hidden", errors=0.0).draw(np.random.default_rng(2))
    assert np.array_equal(right.rig, PAPER) and right.effects


@pytest.mark.slow
@pytest.mark.parametrize("task", [Task("rock", errors=2.0), Task("layers", errors=2.0), HoleTask(errors=2.0)])
def test_constants_scatter_as_stated(task):
    rng = np.random.default_rng(1)
    off = (np.array([task.episode(rng, None).rig for _ in range(4000)]) - PAPER) / STATED
    assert off.mean(axis=0) == pytest.approx(np.zeros(6), abs=0.15)
    assert off.std(axis=0) == pytest.approx(np.full(6, 2.0), rel=0.05)
    assert 5.0 < np.abs(off).max() <= 6.0 + 1e-9
    assert np.abs(np.corrcoef(off.T) - np.eye(6)).max() < 0.08


@pytest.mark.parametrize("identity", EXACT)
def test_the_seed_draws_them_and_every_episode_has_its_own(identity):
    made = []
    for _ in range(2):
        env = gym.make(identity, errors=1.0)
        rigs = []
        for seed in (3, None, None):
            env.reset(seed=seed)
            rigs.append(rig(env))
            assert not any(env.unwrapped._batch.hybrid)  # type: ignore[attr-defined]
        made.append(rigs)
    assert np.array_equal(*made)
    assert len({each.tobytes() for each in made[0]}) == 3
    env.reset(seed=4)
    assert not np.array_equal(rig(env), made[0][0])


def test_the_rocks_of_a_seed_are_the_same_with_and_without():
    for kind in ("rock", "layers"):
        plain, off = (Task(kind, errors=errors).draw(np.random.default_rng(8)) for errors in (0.0, 3.0))
        assert np.array_equal(plain.layers, off.layers)
        assert (plain.lag, plain.blows, plain.phase) == (off.lag, off.blows, off.phase)
    plain, off = (HoleTask(errors=errors).episode(np.random.default_rng(8), None) for errors in (0.0, 3.0))
    assert np.array_equal(plain.layers, off.layers) and np.array_equal(plain.strengths, off.strengths)


def test_they_are_off_as_far_as_those_of_the_league():
    """The frozen condition of three errors holds deviations of three errors of this very draw."""
    frozen = (np.array([each.rig for each in episodes_of(CONDITIONS["constants-3"])]) - PAPER) / STATED
    assert 2.4 < frozen.std() < 3.6 and np.abs(frozen).max() <= 9.0 + 1e-6


def test_a_model_is_what_they_are_drawn_about(tmp_path):
    file = tmp_path / "model.json"
    file.write_text(json.dumps({"format": "drillenv-model/1", "constants": {"damping": 300.0}, "effects": []}))
    rng = np.random.default_rng(0)
    task = Task("rock", model=str(file), errors=1.0)
    assert np.mean([task.draw(rng).rig[3] for _ in range(1000)]) == pytest.approx(300.0, abs=10.0)
    with pytest.raises(InputError, match="errors is 2, with which damping is -150"):
        Task("rock", model=str(file), errors=2.0)


def test_the_drive_gain_of_a_hole_works_beside_the_frame():
    """The frame takes the same share of whatever force the drive has."""
    shares = []
    for errors in (0.0, 3.0):
        env = gym.make("drillenv/DrillBit-v0", errors=errors)
        env.reset(seed=6)
        gain = HoleTask(errors=errors).episode(seeding.np_random(6)[0], None).rig[4]
        assert bool(gain == 1.0) == (errors == 0.0)
        env.step(np.zeros(4, dtype=np.float32))
        shares.append(rig(env)[4] / gain)
    assert shares[1] == pytest.approx(shares[0], rel=1e-12)


def test_holes_with_another_rig_go_through_records():
    hole = HoleTask(errors=2.0).episode(np.random.default_rng(0), None)
    again = read_hole(json.loads(json.dumps(hole.as_record())), "here")
    assert again.rig == pytest.approx(hole.rig, abs=1e-6)
    assert "rig" not in draw_hole(1.0, np.random.default_rng(0)).as_record()
    with pytest.raises(InputError, match="here: rig is 3"):
        read_hole({**hole.as_record(), "rig": 3}, "here")


SAYS = r"^errors is [^\n]* from 0 to 10[^\n]*$"


@pytest.mark.parametrize("bad", [-1, 10.5, "two", True, np.nan, [1.0], np.ones(2)], ids=str)
@pytest.mark.parametrize("identity", ["drillenv/DrillLayers-v0", "drillenv/DrillBit-v0"])
def test_bad_errors(identity, bad):
    for scenario in (None, "test"):
        with pytest.raises(InputError, match=SAYS):
            gym.make(identity, errors=bad, scenario=scenario)
        with pytest.raises(InputError, match=SAYS):
            gym.make_vec(identity, 2, vectorization_mode="vector_entry_point", errors=bad, scenario=scenario)


@pytest.mark.parametrize("identity", ["drillenv/DrillLayers-v0", "drillenv/DrillHidden-v0", "drillenv/DrillBit-v0"])
def test_a_scenario_fixes_the_rigs(identity):
    with pytest.raises(InputError, match=r"errors is 1, but scenario fixes the rigs: leave one of the two out"):
        gym.make(identity, scenario="test", errors=1.0)
    gym.make(identity, scenario="test", errors=0.0)
