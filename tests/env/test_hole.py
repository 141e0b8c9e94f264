"""DrillBit: a hole is drilled by the physics that its modules state, and paid for as they say."""

import json
import math
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.integrate import solve_ivp

from drillenv.checks import InputError
from drillenv.dynamics.exact import REGIME, W, make_scratch
from drillenv.dynamics.flow import STIFFNESS
from drillenv.env.hole import shaker
from drillenv.env.hole.batch import meet_rock
from drillenv.env.hole.bit import draw_strengths, wear_of
from drillenv.env.hole.costs import Costs
from drillenv.env.hole.envs import DrillBitEnv
from drillenv.env.hole.episodes import MOST_BITS, draw_hole, read_hole
from drillenv.env.hole.readings import READINGS, WEAR
from drillenv.env.hole.task import TERMS
from drillenv.env.plant import PEAKS, S_KEPT, SUMS_SIZE, Plants, drill
from drillenv.env.registration import HOLE_IDS, HOLE_STEPS
from drillenv.env.scalar import DrillEnv
from drillenv.env.task import action_for

each_id = pytest.mark.parametrize("identity", HOLE_IDS)
SILENT = [term for term in TERMS if term != "layers"]
"""All that can be left out but the layers."""


def holes(tmp_path, *records):
    """A file of holes: what a record leaves out is as here."""
    plain = {
        "depth": 1.0,
        "layers": [[20.0, 24.0, None, 1.0]],
        "resonance": 100.0,
        "strengths": [1.0] * MOST_BITS,
        "phase": 0.0,
    }
    file = tmp_path / "holes.json"
    made = [plain | record for record in records]
    file.write_text(
        json.dumps({"format": "drillenv-scenario/1", "name": "own", "version": 1, "episodes": {"hole": made}})
    )
    return str(file)


def begun(tmp_path, record=None, **arguments):
    """An environment without noise over one hole, reset."""
    env = DrillBitEnv(scenario=holes(tmp_path, record or {}), noise=0.0, **arguments)
    env.reset(seed=0, options={"episode": 0})
    return env


def action(frequency, amplitude, pressure, change=False):
    return np.append(action_for(frequency, amplitude, pressure), np.float32(1.0 if change else -1.0))


@each_id
def test_gymnasiums_checker(identity):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(identity).unwrapped, skip_render_check=True)


@each_id
def test_a_whole_episode_under_the_passive_checker(identity):
    env = gym.make(identity)
    env.action_space.seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        seen, info = env.reset(seed=0)
        for _ in range(HOLE_STEPS[identity.split("/")[1].split("-")[0]]):
            assert seen in env.observation_space
            json.dumps(info, allow_nan=False)
            seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
            assert type(reward) is float and math.isfinite(reward)
            if terminated or truncated:
                break
        assert terminated or truncated


def test_what_is_not_asked_for_changes_nothing(tmp_path):
    """With every term left out the motion is that of DrillEnv on the same rock, to the last bit."""
    env = begun(tmp_path, without=SILENT)
    own = {"episodes": {"rock": [{"layers": [[20.0, 24.0, None, 0]], "lag": 0.001, "blows": 1, "phase": 0.0}]}}
    rig = {"shaker_mass": 265.0, "indenter_mass": 3.0, "stiffness": 68850.0, "damping": 2450.0}
    own["episodes"]["rock"][0] |= {"effects": {}, "rig": rig | {"drive_gain": 1.0, "pressure_gain": 1.0}}
    file = tmp_path / "rock.json"
    file.write_text(json.dumps({"format": "drillenv-scenario/1", "name": "own", "version": 1} | own))
    plain = DrillEnv(kind="rock", scenario=str(file), noise=0.0)
    plain.reset(seed=0, options={"episode": 0})
    rng = np.random.default_rng(0)
    for _ in range(20):
        asked = rng.uniform(-1, 1, 3).astype(np.float32)
        *_, truth = env.step(np.append(asked, np.float32(-1)))
        *_, other = plain.step(asked)
        same = set(truth) & set(other) - {"depth", "layer"}
        assert len(same) > 25
        assert {name: truth[name] for name in same} == {name: other[name] for name in same}


def test_wear_is_what_the_equation_says():
    rng = np.random.default_rng(0)
    peaks = np.column_stack([np.arange(30.0), rng.uniform(10, 3000, 30)])
    u = peaks[peaks[:, 1] >= 50, 1] / 2000
    blow = 1.7 * (1 + u) / 2 * (1 + (np.sum(u**2) / 0.25 / 100) ** 2) + 0.3 * u**8
    worn, blows = wear_of(peaks, 30, 0.6, 1.7, 2000.0)
    assert worn == pytest.approx((1 + 4 * 0.4) * blow.sum() / 300_000 / 0.25, rel=1e-12)
    assert blows == u.size / 0.25


def test_a_step_wears_by_the_blows_of_its_interval(tmp_path):
    """The interval run once more from the same state gives the blows; 15 s of them are the wear of the step."""
    env = begun(tmp_path, without=["resonance"])
    for _ in range(3):
        env.step(action(110, 0.45, 0.9))
    rig = env.get_state().rig.arrays
    wear = rig[-4][WEAR]
    *_, info = env.step(action(110, 0.45, 0.9))
    plants = Plants(*(part[None].copy() for part in rig[:5]))
    peaks, sums = np.empty((PEAKS, 2)), np.empty(SUMS_SIZE)
    # the bit is a little blunter than when the interval before was run: the model is set as the kernel sets it
    plants.layers[0, :, :2] = np.array([20e6, 24e6]) * (1 + 0.53 * wear)
    again = np.array([110.0, 0.45, 0.9])
    drill(plants, 0, again, sums, peaks, np.empty((0, 8)), make_scratch())
    worn, _ = wear_of(peaks, int(sums[S_KEPT]), info["single_share"], 1.0, 2000.0)
    assert info["bit_wear"] - wear == pytest.approx(15 * worn, rel=2e-2)


def test_a_stiffness_that_changes_in_contact_lets_the_force_go_on(tmp_path):
    env = begun(tmp_path)
    batch, met = env._batch, 0
    for _ in range(40):
        env.step(action(70, 0.5, 1.6))
        state, model = batch.plants.states[0], batch.plants.models[0]
        regime = int(state[REGIME])
        force = state[W] * model[regime, STIFFNESS]
        batch.holes.states[0, WEAR] += 0.1
        meet_rock(batch.plants, 0, batch.holes.states[0], batch.holes.layers[0], batch._limits)
        if regime:
            met += 1
            assert state[W] * model[regime, STIFFNESS] == pytest.approx(force, rel=1e-12)
        batch.holes.states[0, WEAR] -= 0.1
    assert met > 10


def test_a_blunt_bit_meets_a_stiffer_rock_and_makes_less_progress(tmp_path):
    env = begun(tmp_path, {"depth": 50.0}, without=["breakage"])
    before = env.step(action(120, 0.45, 0.9))[-1]
    for _ in range(150):
        *_, after = env.step(action(120, 0.45, 0.9))
    assert after["loading_stiffness"] == pytest.approx(20e6 * (1 + 0.53 * min(after["bit_wear"], 1.5)), rel=2e-2)
    assert after["penetration_rate"] < before["penetration_rate"]
    assert after["unloading_stiffness"] / after["loading_stiffness"] == pytest.approx(1.2)


def test_the_coil_heats_as_its_equation_is_integrated(tmp_path):
    env = begun(tmp_path, without=["wear"])
    force = (2.4 * 90 + 876.19) * 0.42
    final = 100 * (force / 450) ** 2 * (1 + (90 / 60) ** 2) / (1 + 2**2)
    solution = solve_ivp(lambda _t, rise: (final - rise) / 60, (0, 150), [0.0], rtol=1e-10, atol=1e-10)
    for _ in range(10):
        *_, info = env.step(action(90, 0.42, 0.7))
    assert info["coil_rise"] == pytest.approx(solution.y[0, -1], rel=1e-7)


def test_a_coil_that_is_too_hot_trips_and_cools(tmp_path):
    env = begun(tmp_path, without=["wear"])
    for _ in range(30):
        *_, info = env.step(action(120, 0.6, 1.0))
        if info["trips"]:
            break
    assert info["duration"] == 15 + 300
    assert info["coil_rise"] < 2.0
    assert info["spent"] == pytest.approx(0.05 * 315, abs=0.2)


def test_the_amplifier_clips_at_the_top_only(tmp_path):
    env = begun(tmp_path)
    top = 600 / (2.4 * 120 + 876.19)
    assert env.step(action(120, 0.6, 1.0))[-1]["amplitude"] == pytest.approx(top)
    assert env.step(action(120, 0.5, 1.0))[-1]["amplitude"] == pytest.approx(0.5)
    assert env.step(action(95, 0.6, 1.0))[-1]["amplitude"] == pytest.approx(0.6)


def test_the_frame_takes_its_share(tmp_path):
    """Driving in the resonance is driving with less, to the last digits."""
    frame, less = begun(tmp_path, without=["wear"]), begun(tmp_path, without=["wear", "resonance"])
    share = 1 - 0.6 / (1 + ((104 - 100) / 6) ** 2)
    for _ in range(3):
        *_, with_frame = frame.step(action(104, 0.6, 0.7))
        less._batch.plants.rigs[0, 4] = 1.0
        *_, plain = less.step(action(104, 0.6, 0.7))
    assert with_frame["largest_peak_force"] < plain["largest_peak_force"]
    assert shaker.share_transmitted(104.0, 100.0, 0.6) == pytest.approx(share)
    assert frame._batch.plants.rigs[0, 4] == pytest.approx(share)


def test_a_change_of_the_bit(tmp_path):
    env = begun(tmp_path)
    for _ in range(20):
        *_, worn = env.step(action(110, 0.42, 0.8))
    seen, reward, *_, info = env.step(action(110, 0.42, 0.8, change=True))
    one_step = worn["bit_wear"] / 20
    assert 0 < info["bit_wear"] < 2 * one_step
    assert info["bits_changed"] == 1 and info["duration"] == 315
    assert info["spent"] == pytest.approx(80 + 0.05 * 315, abs=0.2)
    assert info["coil_rise"] < worn["coil_rise"]
    assert reward == pytest.approx(600 * info["drilled"] - info["spent"])
    named = {reading.name: value for reading, value in zip(READINGS, seen, strict=True)}
    assert named["bit_depth"] == pytest.approx(info["drilled"], rel=1e-5)


def test_a_worn_bit_breaks_at_its_strength_and_the_next_has_its_own(tmp_path):
    env = begun(tmp_path, {"strengths": [0.2, 0.4, *[1e3] * (MOST_BITS - 2)], "depth": 50.0})
    broke, last = [], 0.0
    for _ in range(400):
        *_, info = env.step(action(110, 0.42, 0.8))
        if info["bits_broken"] > len(broke):
            broke.append(last)
            assert info["bit_wear"] == 0 and info["duration"] == 1815
        last = info["bit_wear"]
    assert len(broke) == 2
    assert broke == pytest.approx([0.2, 0.4], abs=0.03)


@pytest.mark.parametrize("ends", [True, False])
def test_a_bit_that_breaks_ends_the_short_variant(tmp_path, ends):
    env = begun(tmp_path, {"strengths": [0.05] * MOST_BITS, "depth": 50.0}, lost_bit_ends=ends)
    for _ in range(100):
        _, _, terminated, _, info = env.step(action(110, 0.42, 0.8))
        if info["bits_broken"]:
            break
    assert terminated is ends
    if ends:
        with pytest.raises(gym.error.ResetNeeded):
            env.step(action(110, 0.42, 0.8))


def test_layers_are_met_at_their_depth(tmp_path):
    layers = [[12.0, 14.0, 0.2, 0.5], [33.0, 40.0, 0.3, 2.0], [20.0, 24.0, None, 1.0]]
    env = begun(tmp_path, {"layers": layers}, without=["wear"])
    met = []
    terminated = False
    while not terminated:
        *_, terminated, _, info = env.step(action(110, 0.4, 0.7))
        top = info["hole_depth"] - info["drilled"]
        met.append((info["loading_stiffness"] / 1e6, info["abrasivity"], top, info["hole_depth"]))
    for stiffness, _, top, _ in met:
        assert stiffness == pytest.approx(12 if top < 0.2 else 33 if top < 0.5 else 20)
    for _, abrasivity, _, bottom in met:
        assert abrasivity == (0.5 if bottom < 0.2 else 2.0 if bottom < 0.5 else 1.0)


def test_the_hole_ends_at_its_depth_and_its_cost_is_the_sum(tmp_path):
    env = begun(tmp_path, {"depth": 0.31})
    total, spent, time, terminated = 0.0, 0.0, 0.0, False
    while not terminated:
        _, reward, terminated, _, info = env.step(action(115, 0.42, 0.8))
        total, spent, time = total + reward, spent + info["spent"], time + info["duration"]
    assert info["hole_depth"] == 0.31
    assert info["duration"] < 15
    assert total == pytest.approx(600 * 0.31 - spent)
    assert info["total_spent"] == pytest.approx(spent) and info["time"] == pytest.approx(time)
    assert info["cost_per_metre"] == pytest.approx(spent / 0.31)
    assert spent > 80 + 0.05 * time


def test_what_is_not_drilled_counts_with_what_it_would_have_earned(tmp_path):
    env = begun(tmp_path)
    *_, info = env.step(action(115, 0.42, 0.8))
    left = 1.0 - info["hole_depth"]
    assert info["cost_per_metre"] == pytest.approx(info["total_spent"] + 600 * left)


def test_a_state_goes_on_to_the_last_bit(tmp_path):
    env = begun(tmp_path)
    for _ in range(5):
        env.step(action(110, 0.45, 0.9))
    kept = env.get_state()
    futures = []
    for _ in range(2):
        env.set_state(kept)
        futures.append([env.step(action(100, 0.5, 1.0, change=k == 3)) for k in range(6)])
    for one, other in zip(*futures, strict=True):
        assert np.array_equal(one[0], other[0]) and one[1:4] == other[1:4] and one[4] == other[4]


def test_strengths_scatter_as_stated():
    drawn = draw_strengths(200_000, np.random.default_rng(0))
    assert drawn.mean() == pytest.approx(1.1 * math.gamma(1 + 1 / 8), rel=2e-3)
    assert drawn.std() / drawn.mean() == pytest.approx(0.15, abs=0.01)


def test_holes_go_through_records():
    rng = np.random.default_rng(0)
    for _ in range(20):
        hole = draw_hole(4.0, rng)
        again = read_hole(json.loads(json.dumps(hole.as_record())), "here")
        assert again.layers == pytest.approx(hole.layers, rel=1e-3)
        assert again.as_record() == hole.as_record()
        assert np.all(hole.layers[:, 1] >= 1.05 * hole.layers[:, 0])
        assert hole.layers[-1, 2] == np.inf and np.all(hole.layers[:-1, 2] < 4.0)


@pytest.mark.parametrize("name", ["train", "validation", "test"])
def test_frozen_sets(name):
    env = gym.make("drillenv/DrillBit-v0", scenario=name)
    assert len(env.unwrapped.task.scenario.episodes["hole"]) == {"train": 200, "validation": 30, "test": 60}[name]
    _, info = env.reset(seed=0, options={"episode": 3})
    assert info["target_depth"] == 4.0 and info["total_spent"] == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"without": "resonance"}, "without"),
        ({"without": ["heat", "rain"]}, "rain"),
        ({"costs": {"beer": 3.0}}, "beer"),
        ({"costs": {"bit": -1.0}}, "costs bit"),
        ({"costs": 3}, "costs is 3"),
        ({"depth": 0.0}, "depth"),
        ({"depth": 2.0, "scenario": "test"}, "scenario fixes the depth"),
        ({"scenario": "beyond"}, "scenario"),
        ({"lost_bit_ends": 1}, "lost_bit_ends"),
        ({"render_mode": "human"}, "render_mode"),
        ({"actions": "jump"}, "actions"),
    ],
)
def test_bad_arguments(arguments, says):
    with pytest.raises(InputError, match=says) as caught:
        DrillBitEnv(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"depth": "deep"}, "depth"),
        ({"layers": []}, "layers"),
        ({"layers": [[20.0, 24.0, 0.5, 1.0]]}, "last layer"),
        ({"layers": [[20.0, 19.0, None, 1.0]]}, "k_u"),
        ({"layers": [[20.0, 24.0, None, -1.0]]}, "abrasivity"),
        ({"strengths": [1.0]}, "strengths"),
        ({"resonance": 0.0}, "resonance"),
        ({"phase": 7.0}, "phase"),
        ({"colour": 1}, "give a record"),
    ],
)
def test_bad_holes(tmp_path, change, says):
    with pytest.raises(InputError, match=says):
        DrillBitEnv(scenario=holes(tmp_path, change))


def test_costs_have_units():
    array = Costs().as_array()
    assert array[0] == pytest.approx(0.05) and array[4] == pytest.approx(0.3 / 3.6e6)


def test_leaving_out_each_term_changes_its_part_only(tmp_path):
    """Each term is a switch of its own: without it, what it stands for does not happen."""
    hard = {"layers": [[20.0, 24.0, 0.3, 3.0], [33.0, 40.0, None, 0.5]], "resonance": 115.0, "depth": 50.0}

    def run(*without):
        env = begun(tmp_path, hard, without=list(without))
        return [env.step(action(118, 0.55, 1.0))[-1] for _ in range(80)]

    everything = run()
    assert run("wear")[-1]["bit_wear"] == 0 and everything[0]["bit_wear"] > 0
    assert run("blunting")[2]["loading_stiffness"] == 20e6 and everything[2]["loading_stiffness"] > 20e6
    assert run("breakage")[-1]["bits_broken"] == 0 and everything[-1]["bits_broken"] > 0
    assert max(info["coil_rise"] for info in run("heat")) == 0 and everything[-1]["trips"] > 0
    assert run("amplifier")[0]["amplitude"] == pytest.approx(0.55) and everything[0]["amplitude"] < 0.53
    assert run("resonance")[0]["largest_peak_force"] > everything[0]["largest_peak_force"]
    assert run("abrasivity")[0]["abrasivity"] == 1 and everything[0]["abrasivity"] == 3
    assert {info["hole_layer"] for info in run("layers")} == {0} and everything[-1]["hole_layer"] == 1
