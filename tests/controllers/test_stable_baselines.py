"""Models that Stable-Baselines3 saved: they act as there, and nothing in their files is run."""

import base64
import io
import json
import os
import pickle
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.vec_env import VecFrameStack

from drillenv import cli, controllers
from drillenv.checks import InputError
from drillenv.controllers.policies import read_policy, write_policy
from drillenv.controllers.policies.stable_baselines import Unpickled, read_model
from drillenv.training.evaluate import read_record
from drillenv.training.sb3 import DrillVecEnv

KINDS = {
    "ppo": (PPO, {"n_steps": 16, "batch_size": 16}),
    "a2c": (A2C, {"policy_kwargs": {"net_arch": [16]}}),
    "sac": (SAC, {"buffer_size": 100, "policy_kwargs": {"net_arch": [32, 16], "activation_fn": torch.nn.Tanh}}),
    "td3": (TD3, {"buffer_size": 100, "policy_kwargs": {"net_arch": {"pi": [24], "qf": [8]}}}),
}


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A model of each kind, and its file."""
    folder = tmp_path_factory.mktemp("models")
    env = gym.make("drillenv/Drill-v0")
    made = {name: kind("MlpPolicy", env, seed=3, device="cpu", **own) for name, (kind, own) in KINDS.items()}
    for name, model in made.items():
        with torch.no_grad():  # far from what they were drawn as, so that actions reach their bounds
            for part, parameter in model.policy.named_parameters():
                if part.startswith(("action_net", "actor.mu")):
                    parameter.mul_(300.0 if part.startswith("action_net") else 6.0)
        model.save(folder / name)
    return {name: (model, folder / f"{name}.zip") for name, model in made.items()}


@pytest.mark.parametrize("name", KINDS)
def test_acts_as_the_original(saved, name, tmp_path):
    model, file = saved[name]
    read = read_model(file)
    assert read.provenance["algorithm"] == name
    write_policy(tmp_path / "policy", read)
    drivers = [controllers.make("learned", policy=each) for each in (file, tmp_path / "policy")]
    drivers.append(Unpickled(file))
    space = gym.make("drillenv/Drill-v0").observation_space
    space.seed(0)
    at_bounds = 0
    for _ in range(100):
        seen = space.sample()
        expected = model.predict(seen, deterministic=True)[0]
        for driver in drivers:
            np.testing.assert_allclose(driver.act(seen, {}), expected, rtol=0, atol=1e-4)
        at_bounds += int((np.abs(expected) > 0.99).any())
    assert at_bounds > 0
    assert read_policy(tmp_path / "policy").as_record() == read.as_record()


def recurrent_model(policy):
    """Of sb3-contrib, untrained, for one rock an episode."""
    env = gym.make("drillenv/Drill-v0")
    return RecurrentPPO("MlpLstmPolicy", env, n_steps=8, batch_size=8, seed=3, device="cpu", policy_kwargs=policy)


@pytest.mark.parametrize("shared", [False, True])
def test_a_recurrent_model_remembers_as_the_original(shared, tmp_path):
    model = recurrent_model({"lstm_hidden_size": 24, "shared_lstm": shared, "enable_critic_lstm": not shared})
    with torch.no_grad():
        model.policy.action_net.weight.mul_(30.0)
    model.save(tmp_path / "model.zip")
    read = read_model(tmp_path / "model.zip")
    assert (read.provenance["algorithm"], read.lstm) == ("recurrent-ppo", 24)
    write_policy(tmp_path / "policy", read)
    drivers = [controllers.make("learned", policy=tmp_path / name) for name in ("model.zip", "policy")]
    drivers.append(Unpickled(tmp_path / "model.zip"))
    space = gym.make("drillenv/Drill-v0").observation_space
    space.seed(0)
    for _episode in range(2):
        memory, begins = None, np.ones(1, dtype=bool)
        for driver in drivers:
            driver.reset()
        for _ in range(20):
            seen = space.sample()
            expected, memory = model.predict(seen, memory, begins, deterministic=True)
            begins[:] = False
            for driver in drivers:
                np.testing.assert_allclose(driver.act(seen, {}), expected, rtol=0, atol=1e-4)
    one = drivers[0].act(seen, {})
    assert not np.allclose(drivers[0].act(seen, {}), one, atol=1e-6)


def test_observations_side_by_side(tmp_path):
    envs = VecFrameStack(DrillVecEnv("drillenv/Drill-v0", 1, threads=1), 3)
    model = PPO("MlpPolicy", envs, n_steps=16, batch_size=16, device="cpu", seed=1)
    model.save(tmp_path / "model.zip")
    driver = controllers.make("learned", policy=tmp_path / "model.zip")
    envs.seed(4)
    seen = envs.reset()
    for _ in range(6):
        expected = model.predict(seen, deterministic=True)[0]
        action = driver.act(envs.venv.rigs._observations[0], {})
        np.testing.assert_allclose(action, expected[0], atol=1e-5)
        seen = envs.step(expected)[0]


def changed(file, target, data=None, **parts):
    """A copy of a model with another part, or other values in what it says of itself."""
    with zipfile.ZipFile(file) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    if data is not None:
        content["data"] = json.dumps({**json.loads(content["data"]), **data}).encode()
    content |= {name.replace("_pth", ".pth"): value for name, value in parts.items()}
    with zipfile.ZipFile(target, "w") as archive:
        for name, value in content.items():
            if value is not None:
                archive.writestr(name, value)
    return target


def refused(file):
    with pytest.raises(InputError) as raised:
        read_model(file)
    message = str(raised.value)
    assert "\n" not in message and len(message) < 500
    return message


class Harm:
    def __reduce__(self):
        return os.mkdir, ("harm-was-done",)


def test_nothing_that_is_pickled_is_run(saved, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = saved["ppo"][1]
    buffer = io.BytesIO()
    torch.save({"action_net.bias": Harm()}, buffer)
    assert "holds no plain tensors" in refused(changed(file, "bad.zip", policy_pth=buffer.getvalue()))
    # what is pickled in its JSON is not even looked at
    spoilt = {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(Harm())).decode()}
    read_model(changed(file, "odd.zip", data={"lr_schedule": spoilt, "policy_kwargs": spoilt}))
    for name in ("bad.zip", "odd.zip"):
        arguments = ["league", "--controllers", name, "--episodes", "1", "--steps", "1", "--threads", "1"]
        assert cli.main(arguments) == (2 if name == "bad.zip" else 0)
    assert not (tmp_path / "harm-was-done").exists()
    # but where one asks for it
    with pytest.raises(InputError):
        Unpickled("odd.zip")
    assert (tmp_path / "harm-was-done").exists()


def test_what_is_not_supported(saved, tmp_path):
    file, odd = saved["ppo"][1], tmp_path / "odd.zip"
    kwargs = {":type:": "<class 'dict'>", "activation_fn": "<class 'torch.nn.modules.activation.ELU'>"}
    box = {"_shape": [3], "low": "[-2. -1. -1.]", "high": "[1. 1. 1.]"}
    for data, said in (
        ({"policy_class": {"__module__": "my.policies"}}, "its policy is of 'my.policies': give an MlpPolicy of PPO"),
        ({"policy_class": None}, "its policy is of None"),
        ({"use_sde": True}, "trained with use_sde"),
        ({"policy_kwargs": kwargs}, "its activation is"),
        ({"policy_kwargs": {"features_extractor_class": "x"}}, "its policy_kwargs have features_extractor_class"),
        ({"action_space": box}, "3 actions from -1 to 1"),
        ({"action_space": {"_shape": [4], "low": "[-1]", "high": "[1]"}}, "3 actions from -1 to 1"),
        ({"observation_space": {"_shape": [17]}}, "give the 15 readings or a stack"),
        ({"observation_space": {"_shape": [4, 512]}}, "give the 15 readings or a stack"),
        ({"observation_space": {"_shape": [30]}}, "does not follow on 30 numbers"),
    ):
        assert said in refused(changed(file, odd, data=data))
    recurrent_model({"lstm_hidden_size": 8, "n_lstm_layers": 2}).save(tmp_path / "two.zip")
    assert "not exactly one layer of LSTM" in refused(tmp_path / "two.zip")
    recurrent_model({"lstm_hidden_size": 8, "lstm_kwargs": {"bias": False}}).save(tmp_path / "other.zip")
    assert "its policy_kwargs have lstm_kwargs" in refused(tmp_path / "other.zip")


def test_damaged_files(saved, tmp_path):
    file, odd = saved["sac"][1], tmp_path / "odd.zip"
    whole = file.read_bytes()
    for length in (0, 10, len(whole) // 2, len(whole) - 1):
        odd.write_bytes(whole[:length])
        refused(odd)
    assert "has no part policy.pth" in refused(changed(file, odd, policy_pth=None))
    refused(changed(file, odd, policy_pth=b"nothing"))
    refused(changed(file, odd, data={"policy_class": 3}))
    with zipfile.ZipFile(odd, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", b"0" * 70_000_000)
        archive.writestr("policy.pth", b"")
    assert "has more than 64000000 bytes" in refused(odd)
    refused(tmp_path / "nothing.zip")
    refused(tmp_path)


def test_numbers_that_are_not_finite(saved, tmp_path):
    with zipfile.ZipFile(saved["td3"][1]) as archive:
        tensors = torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
    tensors["actor.mu.0.weight"][0, 0] = float("nan")
    buffer = io.BytesIO()
    torch.save(tensors, buffer)
    assert "not finite" in refused(changed(saved["td3"][1], tmp_path / "odd.zip", policy_pth=buffer.getvalue()))


def test_in_the_league_and_exported(saved, tmp_path, capsys):
    files = {name: str(file) for name, (_, file) in saved.items()}
    export = ["export", "--model", files["sac"], "--out", str(tmp_path / "sac"), "--env", "drillenv/Drill-v0"]
    assert cli.main(export) == 0
    assert read_policy(tmp_path / "sac").environment == "drillenv/Drill-v0"
    short = ["--scenario", "validation", "--episodes", "1", "--steps", "4", "--threads", "1"]
    rows = [files["sac"], f"as-exported={tmp_path / 'sac'}", f"both={files['ppo']}", f"both={files['a2c']}"]
    record = ["--json", str(tmp_path / "record.json")]
    assert cli.main(["league", "--controllers", *rows, "--policies", files["td3"], "ppo-vine", *short, *record]) == 2
    assert cli.main(["league", "--controllers", *rows, "td3", "--policies", files["td3"], *short, *record]) == 0
    runs = read_record(tmp_path / "record.json")["runs"]
    assert list(runs) == ["oracle", "td3", files["sac"], "as-exported", "both"] and len(runs["both"]) == 2
    assert runs[files["sac"]][0]["episodes"] == runs["as-exported"][0]["episodes"]
    assert cli.main(["league", "--controllers", f"sac={files['sac']}", *short, *record]) == 0
    assert read_record(tmp_path / "record.json")["runs"]["sac"][0]["source"] == files["sac"]
    trusted = ["league", "--trust-pickle", "--controllers", f"unpickled={files['sac']}", *short, *record]
    assert cli.main(trusted) == 0
    runs = read_record(tmp_path / "record.json")["runs"]
    assert runs["unpickled"][0]["episodes"]["score"] == pytest.approx(
        runs["as-exported"][0]["episodes"]["score"], abs=0.1
    )
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "give one of --run and --model"),
        (["--run", "a", "--model", "b.zip"], "give one of --run and --model"),
        (["--model", "b.zip", "--which", "last"], "--which goes with --run only"),
        (["--run", "a", "--env", "drillenv/Drill-v0"], "--env goes with --model only"),
        (["--model", "b.zip"], "model b.zip cannot be read"),
    ],
)
def test_bad_export(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", "--out", "policy", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("drillenv: ") and err.count("\n") == 1 and said in err
    assert not list(tmp_path.iterdir())
