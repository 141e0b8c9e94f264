"""Checkpoints: whole or not at all, nothing pickled, everything in them."""

import hashlib
import io
import json
import os
import pickle
import shutil

import numpy as np
import pytest
import torch

from drillenv.checks import InputError
from drillenv.training import checkpoint, train
from drillenv.training.learner import Learner
from drillenv.training.recipe import Recipe

TINY = {"env": "drillenv/Drill-v0", "envs": 2, "stack": 2, "rollout": 8, "batch": 8, "epochs": 1, "layers": (8,)}
RECIPE = Recipe(**TINY, evaluate_every=0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of four updates with all its checkpoints due."""
    out = tmp_path_factory.mktemp("run")
    train.train(RECIPE, 64, out, threads=1, checkpoint_seconds=0.0, quiet=True)
    return out


@pytest.fixture
def folder(run, tmp_path):
    """A copy of its checkpoints."""
    return shutil.copytree(run / "checkpoints", tmp_path / "checkpoints")


def arrays_of(taken):
    parts = {"policy": taken.policy, "optimizer": taken.optimizer, "arrays": taken.arrays, "best": taken.best}
    return {
        f"{part}/{name}": (each.dtype, each.shape, each.tobytes())
        for part, held in parts.items()
        for name, each in held.items()
    }


def continued(learner, steps):
    learner.model.learn(steps, reset_num_timesteps=False)
    return arrays_of(checkpoint.take(learner, {}))


def test_taken_written_read_and_put_goes_on_alike(tmp_path):
    learner = Learner(RECIPE, threads=1)
    learner.model.learn(5 * RECIPE.update)  # 40 steps of each rig, half an episode
    taken = checkpoint.take(learner, {"a": [1, None]}, {"x": np.ones(3, "f4")})
    back = checkpoint.read(checkpoint.write(tmp_path, taken))
    assert arrays_of(back) == arrays_of(taken)
    assert {name: back.record[name] for name in taken.record} == taken.record
    expected = continued(learner, 6 * RECIPE.update)  # past the end of the episode
    # in the same process, where all the shared generators have moved on, and on rigs that have drilled elsewhere
    for start in (0, 3):
        other = Learner(RECIPE, threads=1)
        other.model.learn(start * RECIPE.update)
        checkpoint.put(other, back)
        assert continued(other, 6 * RECIPE.update) == expected


@pytest.mark.slow
def test_rigs_of_the_hybrid_engine_go_on_alike(tmp_path):
    change = {"env": "drillenv/DrillHidden-v0", "rollout": 2, "batch": 4, "ahead": 1}
    recipe = Recipe(**(TINY | change), evaluate_every=0)
    learner = Learner(recipe, threads=1)
    learner.model.learn(2 * recipe.update)
    taken = checkpoint.read(checkpoint.write(tmp_path, checkpoint.take(learner, {})))
    assert any(rig["hybrid"] for rig in taken.record["rigs"])
    expected = continued(learner, 2 * recipe.update)
    other = Learner(recipe, threads=1)
    checkpoint.put(other, taken)
    assert continued(other, 2 * recipe.update) == expected


def test_the_last_two_are_kept(folder):
    assert sorted(each.name for each in folder.iterdir()) == ["000000000048", "000000000064"]
    kept, wrong = checkpoint.latest(folder)
    assert kept is not None and kept.steps == 64 and not wrong


def test_a_checkpoint_that_was_not_completed_does_not_count(folder):
    left = folder / ".0123abcd.part"
    shutil.copytree(folder / "000000000064", left)
    (left / "state.json").unlink()
    kept, wrong = checkpoint.latest(folder)
    assert kept is not None and kept.steps == 64 and not wrong
    checkpoint.write(folder, kept)
    assert not left.exists()


def test_interrupted_while_writing(folder, monkeypatch):
    """Whatever file it fails at, what was there stays, and is what is read."""
    kept, _ = checkpoint.latest(folder)
    assert kept is not None
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    write, left = checkpoint._write, 0

    def failing(file, data):
        nonlocal left
        left -= 1
        write(file, data if left else data[: len(data) // 2])
        if not left:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "_write", failing)
    for number in (1, 2, 3, 4):
        left = number
        with pytest.raises(KeyboardInterrupt):
            checkpoint.write(folder, checkpoint.Checkpoint(**{f: getattr(kept, f) for f in kept.__slots__}))
        assert {file: file.read_bytes() for file in before} == before
        again, wrong = checkpoint.latest(folder)
        assert again is not None and again.steps == 64 and not wrong


@pytest.mark.parametrize("name", ["state.json", "arrays.npz", "policy.safetensors", "optimizer.safetensors"])
@pytest.mark.parametrize("damage", ["gone", "short", "empty", "flipped"])
def test_falls_back_on_the_one_before(folder, name, damage):
    file = folder / "000000000064" / name
    data = file.read_bytes()
    if damage == "gone":
        file.unlink()
    else:
        middle = len(data) // 2
        flipped = data[:middle] + bytes([data[middle] ^ 0x80]) + data[middle + 1 :]
        file.write_bytes({"short": data[:middle], "empty": b"", "flipped": flipped}[damage])
    kept, wrong = checkpoint.latest(folder)
    assert kept is not None and kept.steps == 48
    assert len(wrong) == 1 and "000000000064" in wrong[0] and "\n" not in wrong[0]


def test_a_run_goes_on_from_the_one_before(run, tmp_path, capsys):
    out = shutil.copytree(run, tmp_path / "run")
    (out / "checkpoints" / "000000000064" / "arrays.npz").write_bytes(b"")
    train.train(RECIPE, 64, out, resume=True, threads=1, quiet=True)
    assert "warning: checkpoint" in capsys.readouterr().err
    whole = checkpoint.read(run / "checkpoints" / "000000000064")
    assert arrays_of(checkpoint.read(out / "checkpoints" / "000000000064")) == arrays_of(whole)


class Harm:
    def __reduce__(self):
        return os.mkdir, ("harm-was-done",)


def forged(folder, name, data):
    """Put other content in place, and make the sums agree."""
    (folder / name).write_bytes(data)
    state = json.loads((folder / "state.json").read_text())
    state["files"][name] = hashlib.sha256(data).hexdigest()
    (folder / "state.json").write_text(json.dumps(state))


def test_nothing_is_unpickled(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    last = folder / "000000000064"
    objects = io.BytesIO()
    np.savez(objects, stacked=np.array([Harm()], dtype=object))
    torch_file = io.BytesIO()
    torch.save(Harm(), torch_file)
    for name, data in (
        ("arrays.npz", objects.getvalue()),
        ("arrays.npz", pickle.dumps(Harm())),
        ("policy.safetensors", pickle.dumps(Harm())),
        ("policy.safetensors", torch_file.getvalue()),
        ("optimizer.safetensors", pickle.dumps(Harm(), protocol=0)),
    ):
        whole = (last / name).read_bytes()
        forged(last, name, data)
        with pytest.raises(InputError, match="damaged"):
            checkpoint.read(last)
        forged(last, name, whole)
        checkpoint.read(last)
    assert not (tmp_path / "harm-was-done").exists()


@pytest.mark.parametrize("change", [{"envs": 4}, {"stack": 3}, {"layers": (9,)}, {"layers": (8, 8)}])
def test_a_checkpoint_of_another_recipe(run, change):
    kept, _ = checkpoint.latest(run / "checkpoints")
    assert kept is not None
    learner = Learner(Recipe(**(TINY | change), evaluate_every=0), threads=1)
    with pytest.raises(InputError, match="go on with the") as raised:
        checkpoint.put(learner, kept)
    assert "\n" not in str(raised.value)


def test_other_arrays_and_records_are_refused(run):
    kept, _ = checkpoint.latest(run / "checkpoints")
    assert kept is not None
    for arrays, record in (
        ({"stacked": np.zeros((2, 30), "f8")}, {}),
        ({"plants_memories": np.zeros((2, 3))}, {}),
        ({"truths": np.zeros((1, 1))}, {}),
        ({"torch_generator": np.zeros(3, np.uint8)}, {}),
        ({}, {"rigs": []}),
        ({}, {"rigs": [{"generator": {}, "hybrid": None}] * 2}),
        ({}, {"positions": None}),
    ):
        changed = checkpoint.Checkpoint(kept.policy, kept.optimizer, {**kept.arrays, **arrays}, kept.record | record)
        with pytest.raises(InputError, match="go on with the"):
            checkpoint.put(Learner(RECIPE, threads=1), changed)


def test_a_folder_that_cannot_be_written_to():
    learner = Learner(RECIPE, threads=1)
    learner.model.learn(RECIPE.update)
    with pytest.raises(InputError, match="cannot write"):
        checkpoint.write(train.Path("/dev/null/checkpoints"), checkpoint.take(learner, {}))
