"""What is known of a hole: the network on numpy is that of torch, and it knows more than can be reckoned."""

import json

import numpy as np
import pytest
import torch

from drillenv.checks import InputError
from drillenv.controllers.hole import belief
from drillenv.controllers.hole.belief import (
    ESTIMATES,
    FEATURES,
    NAMES,
    PROBABILITIES,
    SHOWN,
    SIZE,
    UNITS,
    WEAR,
    Belief,
    Features,
)
from drillenv.controllers.hole.frame import RESONANCES, FrameFilter
from drillenv.env.hole.envs import DrillBitVectorEnv
from drillenv.env.hole.readings import HIGH, LOW, READINGS
from drillenv.env.task import action_for
from drillenv.training import hole_belief


def readings(steps, rigs, seed=0):
    rng = np.random.default_rng(seed)
    seen = rng.uniform(LOW, np.minimum(HIGH, 5 * LOW + 10), (steps, rigs, len(READINGS))).astype(np.float32)
    seen[..., -1] = np.cumsum(rng.uniform(0.0, 0.002, (steps, rigs)), axis=0)  # blows, in millions
    return seen


def test_the_network_on_numpy_is_that_of_torch():
    """torch.nn.GRUCell shares no code with it."""
    torch.manual_seed(3)
    network = hole_belief.Network()
    seen = readings(9, 4)
    features, known = Features(4), Belief(4, network.weights())
    given = torch.from_numpy(np.stack([features.of(each) for each in seen]))
    begins = torch.zeros(9, 4, dtype=torch.bool)
    begins[6, 1] = True
    with torch.no_grad():
        outputs, _ = network(given, begins, torch.zeros(4, UNITS))
    n = len(NAMES)
    for step, each in enumerate(seen):
        if step == 6:
            known._hidden[1] = 0.0
        row = known.of(each)
        assert row.shape == (4, SIZE) and row.dtype == np.float32
        assert row[:, :SHOWN] == pytest.approx(given[step, :, :SHOWN].numpy())
        assert row[:, WEAR : WEAR + n] == pytest.approx(outputs[step, :, :n].numpy(), abs=1e-5)
        deviations = outputs[step, :, n:].clamp(*belief.LOG_DEVIATIONS).exp()
        assert row[:, WEAR + n : PROBABILITIES] == pytest.approx(deviations.numpy(), abs=1e-5)
        assert row[:, PROBABILITIES:].sum(axis=1) == pytest.approx(1.0, abs=1e-5)


def test_each_hole_is_remembered_by_itself_and_forgotten_whole():
    seen = readings(8, 3)
    together, alone, begun = Belief(3), [Belief(1) for _ in range(3)], Belief(1)
    for step, each in enumerate(seen):
        if step == 4:
            together.forget(np.array([1]))
            alone[1] = begun
        rows = together.of(each[:2], np.array([0, 1]))
        for i in range(2):
            assert rows[i] == pytest.approx(alone[i].of(each[i : i + 1])[0], abs=1e-5)
    assert together.of(seen[0][2:], np.array([2]))[0] == pytest.approx(alone[2].of(seen[0][2:])[0], abs=1e-5)


def test_wear_is_reckoned_as_the_plant_makes_it():
    """On rock of abrasivity 1, in steps of single blows, whose forces are those of the quarter second that is seen."""
    holes = 8
    envs = DrillBitVectorEnv(holes, None, scenario="validation", noise=0.0, without=["breakage", "abrasivity"])
    seen, info = envs.reset(seed=0, options={"episode": list(range(holes))})
    features, worn = Features(holes), np.zeros(holes)
    action = np.tile(np.array([0.9, 0.1, -0.8, -1.0], dtype=np.float32), (holes, 1))
    made, true = [], []
    for _ in range(15):
        before = features.of(seen)[:, SHOWN : SHOWN + belief.RECKONED].sum(axis=1)
        seen, *_, info = envs.step(action)
        after = features.of(seen)[:, SHOWN : SHOWN + belief.RECKONED].sum(axis=1)
        single = info["single_share"] > 0.99
        made.extend((after - before)[single])
        true.extend((info["bit_wear"] - worn)[single])
        worn = info["bit_wear"]
    envs.close()
    assert len(made) > 30
    assert made == pytest.approx(true, rel=0.05)


def test_the_resonance_is_found_where_it_was_driven_past():
    """On the rock as it is, by a sweep: the likeliest frequency is near the true one in nearly all holes."""
    holes = 30
    envs = DrillBitVectorEnv(holes, None, scenario="validation", without=["wear"])
    seen, info = envs.reset(seed=0, options={"episode": list(range(holes))})
    found, action = FrameFilter(holes), np.full((holes, 4), -1.0, dtype=np.float32)
    for frequency in np.linspace(118.0, 80.0, 20):
        action[:, :3] = action_for(frequency, 0.45, 0.8 * (frequency / 120.0) ** 1.5)
        seen, *_, info = envs.step(action)
        rock = info["loading_stiffness"], info["unloading_stiffness"] / info["loading_stiffness"]
        probabilities = found.of(seen.astype(float), *rock, np.arange(holes))
    envs.close()
    assert probabilities.sum(axis=1) == pytest.approx(1.0)
    away = np.abs(RESONANCES[probabilities.argmax(axis=1)] - info["resonance"])
    assert np.mean(away < 3.0) > 0.8
    found.forget(np.array([4]))
    assert np.ptp(found.log_posterior[4]) == 0.0 and np.ptp(found.log_posterior[5]) > 0.0


@pytest.mark.slow
def test_what_ships_knows_more_of_a_bit_than_can_be_reckoned():
    network = hole_belief.Network()
    names = {"input": network.input, "output": network.output}
    weights = belief.read_weights()
    with torch.no_grad():
        for name, layer in names.items():
            layer.weight.copy_(torch.from_numpy(getattr(weights, f"{name}_weight")))
            layer.bias.copy_(torch.from_numpy(getattr(weights, f"{name}_bias")))
        for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"):
            getattr(network.cell, name).copy_(torch.from_numpy(getattr(weights, name)))
    errors = hole_belief.errors_of(network, hole_belief.drill(150, seed=987))
    assert errors["wear"] < 0.6 * errors["reckoned_wear"]
    assert errors["log_stiffness"] < 0.1


@pytest.mark.slow
def test_training_writes_weights_that_are_read_and_the_same_again(tmp_path, monkeypatch, capsys):
    files = [tmp_path / "a.npz", tmp_path / "b.npz"]
    for file in files:
        assert hole_belief.main(["--steps", "70", "--epochs", "1", "--seed", "5", "--out", str(file)]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert set(said) == {*NAMES, "reckoned_wear"}
    before = belief.fingerprint()
    monkeypatch.setattr(belief, "FILE", files[0])
    for cached in (belief.read_weights, belief.fingerprint):
        cached.cache_clear()
    assert Belief(2).of(readings(1, 2)[0]).shape == (2, SIZE) and belief.fingerprint() != before
    monkeypatch.undo()
    for cached in (belief.read_weights, belief.fingerprint):
        cached.cache_clear()
    assert belief.fingerprint() == before


@pytest.mark.parametrize("harm", ["missing", "text", "shape"])
def test_weights_that_cannot_be_used(harm, tmp_path, monkeypatch):
    file = tmp_path / "weights.npz"
    if harm == "text":
        file.write_text("no weights")
    if harm == "shape":
        weights = {name: np.zeros((2, FEATURES + ESTIMATES)) for name in belief.Weights._fields}
        np.savez(file, allow_pickle=False, **weights)
    monkeypatch.setattr(belief, "FILE", file)
    belief.read_weights.cache_clear()
    with pytest.raises(InputError, match=r"python -m drillenv\.training\.hole_belief") as caught:
        belief.read_weights()
    assert "\n" not in str(caught.value)
    monkeypatch.undo()
    belief.read_weights.cache_clear()


def test_bad_arguments_are_one_line(capsys):
    assert hole_belief.main(["--steps", "1"]) == 2
    assert "steps is 1" in capsys.readouterr().err
