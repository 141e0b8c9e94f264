"""The learned controller, and what it does with files that are damaged or meant to harm."""

import hashlib
import json
import os
import pickle
import shutil
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import load, save

from drillenv import controllers
from drillenv.checks import InputError
from drillenv.controllers.learned import Learned
from drillenv.controllers.policies import DESCRIPTION, WEIGHTS, Policy, read_policy, shapes, write_policy
from drillenv.env.observation import HIGH, LOW


def policy(layers=(8, 5), lstm=0, activation="tanh", stack=2, seed=0):
    rng = np.random.default_rng(seed)
    weights = {name: rng.normal(0, 0.3, shape).astype("f4") for name, shape in shapes(layers, lstm, stack).items()}
    centre, width = rng.normal(size=15).astype("f4"), rng.uniform(0.5, 2.0, 15).astype("f4")
    return Policy(weights, centre, width, layers, lstm, activation, stack, "drillenv/DrillLayers-v0", {"seed": seed})


def observations(n, seed=1):
    return np.random.default_rng(seed).uniform(LOW, HIGH, (n, 15)).astype(np.float32)


@pytest.fixture
def folder(tmp_path):
    write_policy(tmp_path / "policy", policy())
    return tmp_path / "policy"


def described(folder, **changes):
    """Change the description of a policy; the keys are paths such as network.layers."""
    file = folder / DESCRIPTION
    record = json.loads(file.read_text())
    for path, value in changes.items():
        *parents, last = path.split(".")
        inner = record
        for each in parents:
            inner = inner[each]
        inner[last] = value
    file.write_text(json.dumps(record))


def weighed(folder, data):
    """Put other weights in place and make the description agree with them, as a forger would."""
    (folder / WEIGHTS).write_bytes(data)
    described(folder, **{"weights.sha256": hashlib.sha256(data).hexdigest()})


def refused(folder):
    """The message of the refusal."""
    with pytest.raises(InputError) as raised:
        controllers.make("learned", policy=folder)
    message = str(raised.value)
    assert "\n" not in message and len(message) < 400
    return message


@pytest.mark.parametrize(("lstm", "activation", "stack"), [(0, "tanh", 1), (0, "relu", 3), (4, "tanh", 2)])
def test_written_and_read_is_the_same(tmp_path, lstm, activation, stack):
    made = policy(lstm=lstm, activation=activation, stack=stack)
    write_policy(tmp_path, made)
    back = read_policy(tmp_path)
    assert back.as_record() == made.as_record()
    assert {name: value.tobytes() for name, value in back.weights.items()} == {
        name: value.tobytes() for name, value in made.weights.items()
    }


def test_a_layer_by_hand():
    """One unit, two observations side by side: every number worked out in the open."""
    made = policy(layers=(1,), stack=2)
    weights = {name: np.zeros(shape, "f4") for name, shape in shapes((1,), 0, 2).items()}
    weights["layer0.weight"][0, 0] = 2.0  # the first reading of the observation before
    weights["layer0.weight"][0, 15 + 14] = -1.0  # the last reading of the present one
    weights["layer0.bias"][0] = 0.25
    weights["action.weight"][:, 0] = 0.5, -0.5, 4.0
    weights["action.bias"][:] = 0.1, 0.2, 0.3
    driver = Learned(Policy(weights, made.centre, made.width, (1,), 0, "tanh", 2, made.environment))
    first, second = observations(2)
    for now, before in ((first, None), (second, first)):
        old = 0.0 if before is None else (before[0] - made.centre[0]) / made.width[0]
        new = (now[14] - made.centre[14]) / made.width[14]
        unit = np.tanh(2.0 * old - new + 0.25)
        asked = np.clip([0.1 + 0.5 * unit, 0.2 - 0.5 * unit, 0.3 + 4 * unit], -1, 1)
        amplitude = 0.45 + 0.15 * asked[1]
        pressure = amplitude * (2.3 + asked[2])  # of 0.6 to 1.8 bar
        expected = [asked[0], asked[1], np.clip((pressure - 1.2) / 0.6, -1, 1)]
        np.testing.assert_allclose(driver.act(now, {}), expected, atol=1e-6)


@pytest.mark.parametrize("lstm", [0, 4])
def test_reset_forgets_and_seeds_change_nothing(lstm):
    driver = Learned(policy(lstm=lstm))
    seen = observations(5)
    driver.reset(seed=1)
    first = [driver.act(each, {}) for each in seen]
    assert [each.tobytes() for each in (driver.act(each, {}) for each in seen)] != [each.tobytes() for each in first]
    driver.reset(seed=2)
    for each, before in zip(seen, first, strict=True):
        action = driver.act(each, {})
        assert action.shape == (3,) and action.dtype == np.float32 and np.abs(action).max() <= 1.0
        assert action.tobytes() == before.tobytes()


def test_drivers_of_one_policy_do_not_share_what_they_saw():
    shared = policy(lstm=4)
    alone, one, other = Learned(shared), Learned(shared), Learned(shared)
    for seen, elsewhere in zip(observations(4), observations(4, seed=9), strict=True):
        expected = alone.act(seen, {})
        other.act(elsewhere, {})
        assert one.act(seen, {}).tobytes() == expected.tobytes()


def test_truncated(folder):
    for name in (WEIGHTS, DESCRIPTION):
        whole = (folder / name).read_bytes().rstrip(b"\n")
        for length in (0, 1, 7, 9, len(whole) // 2, len(whole) - 1):
            (folder / name).write_bytes(whole[:length])
            assert "policy" in refused(folder)
        (folder / name).write_bytes(whole)
    controllers.make("learned", policy=folder)
    whole = (folder / WEIGHTS).read_bytes()
    for length in (0, 7, 9, len(whole) - 1):
        weighed(folder, whole[:length])  # the sum agrees
        assert "cannot be read" in refused(folder)


def test_a_flipped_bit(folder):
    data = bytearray((folder / WEIGHTS).read_bytes())
    data[-3] ^= 1
    (folder / WEIGHTS).write_bytes(data)
    assert "not the file" in refused(folder)


@pytest.mark.parametrize("version", ["drillenv-policy/3", "drillenv-policy/0", None, 1, ["drillenv-policy/1"]])
def test_another_version(folder, version):
    described(folder, format=version)
    assert "'drillenv-policy/1'" in refused(folder)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("network.layers", [8]),
        ("network.layers", [8, 6]),
        ("network.layers", [2**40]),
        ("network.layers", [1] * 100),
        ("network.layers", "os.system"),
        ("network.lstm", 3),
        ("network.lstm", -1),
        ("network.activation", "__import__('os').system('true')"),
        ("observation.stack", 3),
        ("observation.stack", 10**9),
        ("observation.stack", True),
        ("observation.width", [0.0] * 15),
        ("observation.width", [1.0] * 14),
        ("observation.centre", ["1"] * 15),
        ("observation.names", ["a"] * 15),
        ("action.high", [2, 2, 2]),
        ("action.low", [50, 0.3, "1.3"]),
        ("action.low", [50, 0.3, 1.2]),
        ("action.names", ["frequency", "amplitude", "pressure"]),
        ("environment", "CartPole-v1"),
        ("weights.sha256", "0" * 64),
        ("weights.file", "../../../../etc/passwd"),
        ("weights", "/etc/passwd"),
        ("network", None),
        ("code", "print(1)"),
        ("provenance", {"a": [1]}),
        ("provenance", {str(i): i for i in range(1000)}),
    ],
)
def test_a_description_that_does_not_fit(folder, path, value):
    described(folder, **{path: value})
    refused(folder)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 200_000,
        '{"a":' * 5_000 + "1" + "}" * 5_000,
        '{"format": "drillenv-policy/1", "environment": ' + "9" * 20_000 + "}",
        '{"format": "drillenv-policy/1", "environment": NaN}',
        '{"format": "drillenv-policy/1", "provenance": 1e999}',
        "null",
        "\ufeff{}",
        "\0",
        '"' + "x" * 10_000_000 + '"',
    ],
    ids=["deep", "deep-records", "long-number", "nan", "infinite", "null", "byte-order-mark", "zero", "large"],
)
def test_json_bombs(folder, text):
    (folder / DESCRIPTION).write_text(text, encoding="utf-8")
    refused(folder)


def test_numbers_that_are_not_finite(folder):
    text = (folder / DESCRIPTION).read_text()
    record = json.loads(text)
    number = str(record["observation"]["centre"][0])
    for bad in ("NaN", "Infinity", "1e999", "-1e999"):
        (folder / DESCRIPTION).write_text(text.replace(number, bad, 1))
        refused(folder)
    (folder / DESCRIPTION).write_text(text)
    for bad in (np.nan, np.inf):
        weights = load((folder / WEIGHTS).read_bytes())
        weights["layer0.weight"][1, 2] = bad
        weighed(folder, save(weights))
        assert "finite" in refused(folder)


def test_weights_that_do_not_fit(folder):
    whole = load((folder / WEIGHTS).read_bytes())
    one = whole["layer0.weight"]
    for changed in (
        whole | {"layer0.weight": one.T.copy()},
        whole | {"layer0.weight": one[:-1].copy()},
        whole | {"layer0.weight": np.zeros((0, 30), "f4")},
        whole | {"layer0.weight": one.astype("f8")},
        whole | {"layer0.weight": one.astype("f2")},
        whole | {"extra": one},
        {name: value for name, value in whole.items() if name != "action.bias"},
        {},
    ):
        weighed(folder, save(changed))
        assert "policy.safetensors" in refused(folder)


def test_a_header_that_lies(folder):
    def forged(header: str, data: bytes = b"") -> bytes:
        return len(header).to_bytes(8, "little") + header.encode() + data

    for data in (
        forged('{"layer0.weight": {"dtype": "F32", "shape": [1048576, 1048576], "data_offsets": [0, 4398046511104]}}'),
        forged('{"layer0.weight": {"dtype": "F32", "shape": [8, 30], "data_offsets": [0, 960]}}'),
        forged('{"a": {"dtype": "F32", "shape": [18446744073709551615, 2], "data_offsets": [0, 8]}}', b"\0" * 8),
        forged("{" * 10_000),
        (2**63).to_bytes(8, "little") + b"{}",
    ):
        weighed(folder, data)
        refused(folder)


class Harm:
    def __reduce__(self):
        return os.mkdir, ("harm-was-done",)


def test_a_pickle_in_disguise(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for data in (pickle.dumps(Harm()), pickle.dumps({"layer0.weight": Harm()}, protocol=0)):
        weighed(folder, data)
        assert "cannot be read" in refused(folder)
        whole = (folder / DESCRIPTION).read_bytes()
        (folder / DESCRIPTION).write_bytes(data)
        refused(folder)
        (folder / DESCRIPTION).write_bytes(whole)
    assert not (tmp_path / "harm-was-done").exists()


def test_files_that_are_too_large_are_not_read(folder):
    for name in (WEIGHTS, DESCRIPTION):
        whole = (folder / name).read_bytes()
        with (folder / name).open("r+b") as stream:
            stream.truncate(2**40)  # sparse: takes no room, and would fill the memory if it were read
        assert "bytes" in refused(folder)
        (folder / name).write_bytes(whole)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this platform")
def test_what_is_no_regular_file(folder):
    for name in (WEIGHTS, DESCRIPTION):
        whole = (folder / name).read_bytes()
        (folder / name).unlink()
        os.mkfifo(folder / name)  # to open it would wait for ever
        assert "regular" in refused(folder)
        (folder / name).unlink()
        (folder / name).mkdir()
        assert "regular" in refused(folder)
        (folder / name).rmdir()
        assert "cannot be read" in refused(folder)
        (folder / name).write_bytes(whole)


@pytest.mark.parametrize("given", ["", "no-such", "../policies/no-such", 3, None, "a\0b", b"x", ["x"]])
def test_no_policy_there(given):
    refused(given)


def test_the_shipped_one_is_that_of_the_package(folder, tmp_path, monkeypatch):
    """Whatever lies in the present folder."""
    expected = controllers.make("learned").policy.as_record()
    monkeypatch.chdir(tmp_path)
    shutil.copytree(folder, tmp_path / "ppo-layers")
    shutil.copytree(folder, tmp_path / "controllers" / "policies" / "ppo-layers")
    assert controllers.make("learned").policy.as_record() == expected != policy().as_record()


def test_needs_no_torch():
    code = (
        "import sys, numpy as np\nfrom drillenv import controllers\n"
        "driver = controllers.make('learned')\n"
        "driver.act(np.ones(15, np.float32), {})\n"
        "assert not {'torch', 'stable_baselines3', 'drillenv.training'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


@pytest.mark.slow
def test_the_shipped_policy_is_better_than_the_rules():
    from drillenv.training.rollout import rollout

    shipped = rollout(lambda: controllers.make("learned"), "DrillLayers", "validation", 8)
    rules = rollout(lambda: controllers.make("rules"), "DrillLayers", "validation", 8)
    assert (shipped.scores - rules.scores).mean() > 0.03  # mm/s of some 1.7; the oracle is 0.1 above the rules
    assert (shipped.scores > rules.scores).mean() >= 0.75
