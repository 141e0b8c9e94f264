"""Rigs with effects: with an effect that does nothing they are those of the exact kernel, which shares no step."""

import copy
import math
import pickle

import gymnasium as gym
import numpy as np
import pytest

from drillenv import Setting
from drillenv.checks import InputError
from drillenv.dynamics.effects import REGISTRY, drawn, make
from drillenv.dynamics.exact import STATE_SIZE, THETA, TURN, TURNS, make_scratch
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.hybrid.vector_field import COUNT, PEAK
from drillenv.env import plant
from drillenv.env.episodes import draw_layers, one_rock
from drillenv.env.hybrid_plant import HybridPlant
from drillenv.env.plant import (
    FACE_IMPACTS,
    INTERVAL,
    LAYER,
    PEAKS,
    PRESSURE,
    S_CONTACTS,
    S_IMPACTS,
    S_KEPT,
    S_PENETRATION,
    S_ROCK,
    SUMS_SIZE,
    TRACE,
    Plants,
    drill,
    make_plants,
)
from drillenv.env.truth import MOST_CYCLES, TRUTH, TRUTH_SIZE, summarise
from drillenv.rig import Rig
from drillenv.rocks import ROCKS, Rock

LOW, HIGH = np.array([50.0, 0.3, 0.6]), np.array([120.0, 0.6, 1.8])
NEUTRAL = {"contact-rate": {}}
ACTING = [name for name, effect in REGISTRY.items() if effect.moves_rig]


def rig_on(layers, blows=3, lag=0.5, phase=1.0, pressure=0.6):
    """A batch of one rig at rest."""
    plants = make_plants(1)
    plants.rigs[0] = 265.0, 3.0, 68.85e3, 2.45e3, 1.0, 1.0
    plants.layers[0, : len(layers)], plants.layers[0, len(layers) :] = layers, layers[-1]
    memory = plants.memories[0]
    memory[plant.FREQUENCY], memory[plant.VOLTAGE] = 85.0, 0.45
    memory[PRESSURE] = memory[plant.VALVE] = pressure
    memory[plant.LAG], memory[plant.BLOWS], memory[plant.LAST_TURNS] = lag, blows, -1e6
    plant.place(plants, 0, phase)
    return plants


def thin(thickness, m=12):
    """Layers of cases 4, 1, 5, ... in turn, each this thick in m."""
    cases = [(4, 1, 5)[j % 3] for j in range(m)]
    rows = [
        [ROCKS[c].loading_stiffness, ROCKS[c].unloading_stiffness, (j + 1) * thickness, c] for j, c in enumerate(cases)
    ]
    rows[-1][2] = math.inf
    return np.array(rows)


def interval(plants, engine, setting, samples=0):
    """Sums, peaks, window and truth of one interval; ``engine`` None for the exact kernel."""
    sums, peaks, window = np.empty(SUMS_SIZE), np.empty((PEAKS, 2)), np.zeros((samples, len(TRACE)))
    turns = plants.states[0, TURNS] + plants.states[0, THETA] / TURN
    setting = np.asarray(setting, dtype=float)
    if engine is None:
        drill(plants, 0, setting, sums, peaks, window, make_scratch())
    else:
        engine.drill(setting, sums, peaks, window)
    truth = np.empty(TRUTH_SIZE)
    kept = peaks[: int(sums[S_KEPT])].copy()
    summarise(sums, peaks, turns, 2000.0, np.empty((MOST_CYCLES, 3)), plants.layers[0], plants.memories[0], truth)
    return sums, kept, window, truth


def assert_same(one, other, tolerance):
    """Every number of two intervals, relative to the largest of its kind."""
    names = ("sums", "peaks", "window", "truth")
    for name, a, b in zip(names, one, other, strict=True):
        assert a.shape == b.shape, name
        if name == "sums":
            a, b = np.split(a, [plant.S_WAVES]), np.split(b, [plant.S_WAVES])
            # harmonics beside the largest harmonic, the rest each beside itself
            np.testing.assert_allclose(b[0], a[0], rtol=tolerance, atol=1e-12, err_msg=name)
            np.testing.assert_allclose(b[1], a[1], rtol=0, atol=tolerance * np.abs(a[1]).max(), err_msg=name)
        elif name == "truth":
            np.testing.assert_allclose(b, a, rtol=1e2 * tolerance, atol=1e-8, err_msg=str(TRUTH))
        elif a.size:
            wrong = np.abs(a - b).max(axis=0) / np.abs(a).max(axis=0)
            assert wrong.max() < tolerance, (name, wrong)


def copied(plants):
    return Plants(*(part.copy() for part in plants))


def random_settings(seed, n):
    return np.random.default_rng(seed).uniform(LOW, HIGH, (n, 3))


@pytest.fixture
def tight(monkeypatch):
    """Steps so good that what is left is how intervals are put together."""
    monkeypatch.setattr("drillenv.env.hybrid_plant.RTOL", 1e-9)


# --- Beside a run whose steps are far better


@pytest.mark.parametrize("name", ACTING)
def test_an_interval_is_good_to_a_hundred_thousandth(name, monkeypatch):
    """Some twenty periods of steady drilling under each effect, beside the same at a tolerance of 1e-11.

    Over the window's force, acceleration and place; at three settings where the motion is regular, each after a second
    of drilling.
    """
    values = {part.symbol: sum(part.typical) / 2.0 for part in REGISTRY[name].parameters}
    for setting in ([80.0, 0.5, 0.8], [95.0, 0.45, 1.0], [110.0, 0.55, 0.8]):
        plants = rig_on(one_rock(ROCKS[4], 4), lag=0.01)
        engine = HybridPlant(plants, 0, {name: values})
        for _ in range(4):
            interval(plants, engine, setting)
        other = copied(plants)
        again = HybridPlant.restored(other, 0, engine.snapshot())
        sums, _, window, _ = interval(plants, engine, setting, 400)
        with monkeypatch.context() as patch:
            patch.setattr("drillenv.env.hybrid_plant.RTOL", 1e-11)
            true, _, reference, _ = interval(other, again, setting, 400)
        columns = [TRACE.index(channel) for channel in ("force", "acceleration", "x2")]
        off = np.sqrt(
            np.mean((window - reference)[:, columns] ** 2, axis=0) / np.mean(reference[:, columns] ** 2, axis=0)
        )
        assert off.max() < 1e-5, (setting, off)
        assert off.max() > 1e-12, "both ran at the same tolerance"
        waves = np.abs(sums - true)[plant.S_WAVES :] / np.abs(true[plant.S_WAVES :]).max()
        assert waves.max() < 1e-5, (setting, waves)


# --- Beside the exact kernel


@pytest.mark.parametrize("seed", range(3))
def test_neutral_is_exact_over_one_interval(seed, tight):
    """At any settings, from wherever the exact kernel has come: on young and old faces, and into new layers."""
    plants = rig_on(thin(1.5e-3), blows=2 + seed, lag=0.3 + 0.3 * seed)
    layers = set()
    for setting in random_settings(seed, 24):
        other = copied(plants)
        one = interval(plants, None, setting, 50)
        assert_same(one, interval(other, HybridPlant(other, 0, NEUTRAL), setting, 50), 1e-6)
        assert_same_row(plants, other, 1e-6)
        layers.add(int(plants.memories[0, LAYER]))
    assert len(layers) > 3


@pytest.mark.parametrize("thickness", [0.4e-3, 1.5e-3])
@pytest.mark.parametrize("moving", [False, True], ids=["settled pressure", "lagging pressure"])
def test_neutral_is_exact_over_many_intervals(thickness, moving, tight):
    """P-1-I-1 drilling forgets, so the two stay together through layers, fresh faces and pressures."""
    plants = rig_on(thin(thickness, 40), blows=3)
    other = copied(plants)
    engine = HybridPlant(other, 0, NEUTRAL)
    for step in range(24):
        setting = [118.0 + step % 3, 0.55, 0.6 + 0.1 * (step % 2) * moving]
        assert_same(interval(plants, None, setting), interval(other, engine, setting), 1e-6)
        assert_same_row(plants, other, 1e-6)
    assert plants.memories[0, LAYER] > 3


def assert_same_row(plants, other, tolerance):
    """The rows that the batch reads, and the model that the next contact meets."""
    np.testing.assert_array_equal(other.memories[0, [LAYER, FACE_IMPACTS]], plants.memories[0, [LAYER, FACE_IMPACTS]])
    np.testing.assert_allclose(other.memories[0], plants.memories[0], rtol=1e-6)
    np.testing.assert_allclose(other.models[0], plants.models[0], rtol=1e-12, atol=1e-300)
    scale = np.ones(STATE_SIZE)
    scale[:5] = 1e-3, 0.1, 0.1, 1e-4, 1e-3
    np.testing.assert_allclose(other.states[0] / scale, plants.states[0] / scale, rtol=0, atol=tolerance)


def test_the_window_changes_nothing():
    plants = rig_on(thin(1e-3))
    other = copied(plants)
    one, two = (HybridPlant(each, 0, {"contact-rate": {"chi": 1.0}}) for each in (plants, other))
    for setting in random_settings(4, 4):
        a, b = interval(plants, one, setting), interval(other, two, setting, 333)
        for part in (0, 1, 3):
            assert a[part].tobytes() == b[part].tobytes()
        assert np.all(np.isfinite(b[2])) and np.ptp(b[2][:, 1]) > 100.0


def test_a_step_is_near_at_the_tolerance_of_episodes():
    """As the tolerance is stated: peaks of a motion that forgets to 1e-5."""
    plants = rig_on(one_rock(Rock(21.4e6, 25.05e6), 0))
    other = copied(plants)
    engine = HybridPlant(other, 0, NEUTRAL)
    for _ in range(4):
        one, two = interval(plants, None, [118.0, 0.55, 0.6]), interval(other, engine, [118.0, 0.55, 0.6])
        assert len(one[1]) == len(two[1]) > 20
        np.testing.assert_allclose(two[1], one[1], rtol=1e-5)


# --- Beside one unbroken run


def unbroken(effects, setting, seconds, rock, phase):
    """The hybrid engine left alone: no intervals, no substeps, no sampling."""
    chosen = tuple(make(name, **values) for name, values in effects.items())
    return run_hybrid(Rig(), Setting(*setting), rock, seconds, 0.0, phase, effects=chosen)


@pytest.mark.parametrize(
    "effects",
    [
        {"contact-rate": {"chi": 1.5}},
        {"contact-power-law": {"n": 1.4}},
        {"rock-mount-compliance": {"s_r": 2e-8}},
        {"rock-compaction": {"soft": 0.5, "soft_n": 20.0}},
        {"rock-compaction": {"soft": 0.5, "soft_l": 3e-4}},
        {"force-limit": {"S_max": 2.5e5, "tau_f": 5e-5}},
        {"air-spring": {"k_a": 2e3, "tau": 0.3}, "contact-toe": {"h": 2e-5}},
        {"external-vibration": {"F1": 100.0, "F2": 2.0, "f": 33.0}, "rock-rotation": {"eps": 0.2, "Omega": 11.0}},
        {"tabulated-spring": {"x": [0.0, 0.004, 0.008], "y": [0.0, 200.0, 900.0]}},
        {"tabulated-compaction": {"x": [0.0, 10.0, 60.0], "y": [-0.4, -0.1, 0.0]}},
    ],
    ids=lambda effects: "+".join(effects),
)
def test_intervals_leave_no_trace(effects, tight):
    """Each impact is that of an unbroken run, also where a border cuts a loading behind its largest force."""
    rock, setting, n = Rock(21.4e6, 25.05e6), (118.3, 0.55, 0.6), 12
    plants = rig_on(one_rock(rock, 0), lag=1e6)
    engine = HybridPlant(plants, 0, effects)
    peaks, depth, contacts = [], 0.0, 0.0
    for step in range(n):
        # a valve so near and a cylinder so slow that the pressure stays, but does not count as settled
        sums, kept, _window, _truth = interval(plants, engine, [*setting[:2], setting[2] + 1e-5])
        peaks.append(kept + np.array([step * INTERVAL * setting[0], 0.0]))
        depth += sums[S_PENETRATION]
        contacts += sums[S_CONTACTS]
    run = unbroken(effects, setting, n * INTERVAL, rock, 1.0)
    found = np.concatenate(peaks)
    assert len(found) == run.impacts.time.size > 200
    np.testing.assert_allclose(found[:, 0], run.impacts.time * setting[0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[:, 1], run.impacts.force, rtol=1e-5)
    assert contacts == np.sum(run.switches.before == 0)
    assert plants.states[0, plant.ORIGIN] == pytest.approx(run.end_origin, rel=1e-6)
    assert depth == pytest.approx(plants.states[0, plant.ORIGIN], rel=0.01)


def test_the_rock_keeps_what_it_does_not_give_back(tight):
    """A bent law: the energy kept is what went in, less what F d / (n + 1) says that the rock still holds."""
    rock, n, setting, held = Rock(21.4e6, 25.05e6), 1.5, (87.1, 0.55, 0.6), 0
    plants = rig_on(one_rock(rock, 0))
    effects = {"contact-power-law": {"n": n}}
    engine = HybridPlant(plants, 0, effects)
    kept = 0.0
    for step in range(8):
        kept += interval(plants, engine, setting)[0][S_ROCK]
        run = unbroken(effects, setting, (step + 1) * INTERVAL, rock, 1.0)
        stiffness = {0: 0.0, 1: rock.loading_stiffness, 2: rock.unloading_stiffness}[run.end.regime]
        force = stiffness * 1e-4 * (max(run.end.w, 0.0) / 1e-4) ** n
        sprung = 1e-4 * (force / rock.unloading_stiffness / 1e-4) ** (1 / n)
        held += run.end.regime != 0
        assert kept == pytest.approx(run.energy.rock - force * sprung / (n + 1), rel=1e-6)
    assert held


def test_a_new_layer_is_fresh_to_compaction_too():
    plants = rig_on(thin(1.5e-3))
    engine = HybridPlant(plants, 0, {"rock-compaction": {"soft": 0.4, "soft_n": 30.0}, "contact-rate": {"chi": 0.5}})
    layers = set()
    for setting in random_settings(3, 12):
        interval(plants, engine, setting)
        layers.add(int(plants.memories[0, LAYER]))
        # Table 2.2 and the effect count the impacts on the same face
        assert engine.motion.d[COUNT] == plants.memories[0, FACE_IMPACTS]
    assert len(layers) > 2


# --- Points of an episode

STATEFUL = {
    "contact-rate": {"chi": 1.0},
    "air-spring": {"k_a": 3e3, "tau": 0.3},
    "rock-compaction": {"soft": 0.4},
    "force-limit": {"S_max": 2.5e5},
}


def run_on(plants, engine, settings):
    return [tuple(part.tobytes() for part in interval(plants, engine, setting, 7)) for setting in settings]


@pytest.mark.parametrize("way", ["snapshot", "pickled snapshot", "copy", "pickle"])
def test_goes_on_from_a_snapshot(way):
    plants = rig_on(thin(1.5e-3))
    engine = HybridPlant(plants, 0, STATEFUL)
    settings, cut = random_settings(7, 24), 0
    for k, setting in enumerate(settings[:-3]):
        interval(plants, engine, setting)
        row, snapshot = copied(plants), engine.snapshot()
        if way == "copy":
            row, other = copy.deepcopy((plants, engine))
        elif way == "pickle":
            row, other = pickle.loads(pickle.dumps((plants, engine)))
        else:
            if way == "pickled snapshot":
                snapshot = pickle.loads(pickle.dumps(snapshot))
            other = HybridPlant.restored(row, 0, snapshot)
        assert other.plants.states is row.states
        # a loading that the border cuts has had its largest force before it, perhaps
        assert other.motion.d[PEAK] == engine.motion.d[PEAK]
        cut += engine.motion.d[PEAK] > 0.0
        if k < 3:
            assert run_on(row, other, settings[k + 1 : k + 7]) == run_on(
                *copy.deepcopy((plants, engine)), settings[k + 1 : k + 7]
            )
    assert cut
    assert run_on(row, other, settings[-3:]) == run_on(plants, engine, settings[-3:])
    assert run_on(row, other, settings[-3:]) != run_on(*copy.deepcopy((plants, engine)), settings[-2:] + 0.01)


def test_two_runs_agree_to_the_last_bit():
    runs = []
    for _ in range(2):
        plants = rig_on(draw_layers(np.random.default_rng(1)))
        runs.append(run_on(plants, HybridPlant(plants, 0, STATEFUL), random_settings(8, 8)))
    assert runs[0] == runs[1]


def test_in_the_environment(scenario):
    """An episode with an effect, its trace, and the effect's mark on the blows."""
    layers = [[21.4, 25.05, None, 0]]
    file = scenario(
        "hidden", {"layers": layers, "effects": {"drive-droop": {"s": 1 / 120}}}, {"layers": layers, "effects": {}}
    )
    env = gym.make("drillenv/DrillHidden-v0", scenario=file, noise=0.0, render_mode="rgb_array").unwrapped
    largest = []
    for episode in range(2):
        env.reset(seed=0, options={"episode": episode})
        for _ in range(4):
            _observation, _reward, _terminated, _truncated, info = env.step(np.array([1.0, 0.5, -1.0]))
        trace = env.trace(4000)
        assert trace[:, 1].max() == pytest.approx(info["largest_peak_force"], rel=5e-3)
        assert trace[-1, 7] == pytest.approx(1e-3 * info["depth"], abs=1e-9)
        largest.append(info["largest_peak_force"])
    assert largest[0] < 0.95 * largest[1]


# --- Every effect


@pytest.mark.slow
@pytest.mark.parametrize("name", ACTING)
def test_every_effect_drills(name):
    """5 s of random settings, at a strength of its own, on layers."""
    rng = np.random.default_rng(12)
    for _ in range(2):
        chosen = drawn(name, rng)
        values = {part.symbol: value for part, value in zip(chosen.effect.parameters, chosen.values, strict=True)}
        plants = rig_on(draw_layers(rng), blows=int(rng.integers(1, 11)), phase=float(rng.uniform(0, TURN)))
        engine = HybridPlant(plants, 0, {name: values})
        impacts = 0.0
        for setting in rng.uniform(LOW, HIGH, (20, 3)):
            sums, kept, window, truth = interval(plants, engine, setting, 20)
            impacts += sums[S_IMPACTS]
            for part in (sums, kept, window, truth, plants.states, plants.models, plants.memories):
                assert np.all(np.isfinite(part))
            assert plants.states[0, THETA] < TURN and sums[S_KEPT] == sums[S_IMPACTS]
        assert impacts > 100
        assert 1e-3 < plants.memories[0, plant.DEPTH] < 0.05


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"contact-rat": {}}, "effect is 'contact-rat'"),
        ({"contact-rate": {"xi": 1.0}}, "no parameter 'xi'"),
        ({"sensor-offset": {"o_f": 20.0}}, "does not act on the motion"),
    ],
)
def test_effects_that_cannot_be(effects, message):
    with pytest.raises(InputError, match=message):
        HybridPlant(rig_on(one_rock(Rock(20e6, 24e6), 0)), 0, effects)


def test_a_motion_that_cannot_be_followed(monkeypatch):
    """One line that names effects and setting, not a crash and not numbers made up."""
    engine = HybridPlant(rig_on(one_rock(Rock(20e6, 24e6), 0)), 0, {"contact-rate": {"chi": 1.0}})
    monkeypatch.setattr("drillenv.env.hybrid_plant.RTOL", 1e-40)
    with pytest.raises(InputError, match=r"grew without bound .*'chi': 1.0.* at Setting\(frequency=100.0.*weaker$"):
        interval(engine.plants, engine, [100.0, 0.45, 1.0])
