"""Models that Stable-Baselines3 saved (``model.save("model.zip")``), as policies that run with numpy alone.

Such a file holds the parameters as tensors and the rest as JSON in which some values are pickled. Read are the tensors,
by a loader that makes tensors only, and what the JSON says in plain text: nothing in the file is run. That is enough
for the MlpPolicy of PPO, A2C, SAC and TD3 and the MlpLstmPolicy of sb3-contrib's RecurrentPPO, on the readings of the
environments (15, of a hole 20), or several of them side by side as VecFrameStack puts them, with absolute actions. What
a VecNormalize kept is in another file, pickled, and is not read.

:class:`Unpickled` is for all else, where one asks for it: it lets Stable-Baselines3 load the file, which runs what is
pickled in it.
"""

from __future__ import annotations

import io
import json
import re
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.controllers.policies import DIRECT, MOST_LAYERS, MOST_STACKED, MOST_UNITS, NAMES, Policy
from drillenv.env.hole.readings import READINGS as HOLE_READINGS
from drillenv.env.registration import HOLE_IDS

DATA, TENSORS = "data", "policy.pth"
LARGEST_DATA, LARGEST_TENSORS = 64_000_000, 64_000_000
"""Bytes of the two parts of the file."""
HOLE_CONTROLS = 4
"""Numbers of an action on a hole: those of the other environments, and the change of the bit."""
PER_LAYER = 2
"""Stable-Baselines3 numbers its modules: a linear one and its activation for each layer."""
LSTM_PARTS = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
"""PyTorch's names of what an LSTM consists of."""
SUPPORTED = "an MlpPolicy of PPO, A2C, SAC or TD3, or an MlpLstmPolicy of RecurrentPPO"
ACTIVATIONS = {"torch.nn.modules.activation.Tanh": "tanh", "torch.nn.modules.activation.ReLU": "relu"}
HARMLESS = {
    "activation_fn", "clip_mean", "full_std", "log_std_init", "n_critics", "net_arch", "normalize_images",
    "optimizer_class", "optimizer_kwargs", "ortho_init", "share_features_extractor", "use_expln", "use_sde",
}  # fmt: skip
"""Keys of policy_kwargs that do not change what the layers are given or give."""
OF_LSTM = {"enable_critic_lstm", "lstm_hidden_size", "n_lstm_layers", "shared_lstm"}
"""The same of a policy with an LSTM, whose tensors show the rest."""


def read_model(file: str | Path, environment: str = "drillenv/DrillLayers-v0") -> Policy:
    """The policy of a model that Stable-Baselines3 saved.

    Args:
        file: The zip file.
        environment: The id that it was trained on, which the file does not say.

    Raises:
        InputError: it cannot be read, is no such file, or holds another kind of policy.
    """
    source = Path(file)
    data, content = _parts(source)
    tensors = _tensors(source, content)
    try:
        return policy_of(data, tensors, environment)
    except InputError as error:
        raise InputError(f"model {source}: {error}") from None


def policy_of(data: Mapping[str, Any], tensors: Mapping[str, np.ndarray], environment: str) -> Policy:
    """The policy in the parameters of a model.

    Args:
        data: What the file says of the model in JSON.
        tensors: All parameters by name.
        environment: The id that it was trained on.

    Raises:
        InputError: it is not of a kind that is supported.
    """
    readings, controls = (len(HOLE_READINGS), HOLE_CONTROLS) if environment in HOLE_IDS else (len(NAMES), len(DIRECT))
    algorithm, layers, head, squash = _kind(data)
    recurrent = algorithm == "recurrent-ppo"
    _check_plain(data, controls, HARMLESS | OF_LSTM if recurrent else HARMLESS)
    stack = _stack(data, readings)
    memory = _lstm(tensors, stack * readings) if recurrent else {}
    lstm = memory["lstm.weight_hidden"].shape[1] if recurrent else 0
    network = _layers(tensors, layers, head, lstm or stack * readings, controls)
    units = tuple(len(network[f"layer{i}.bias"]) for i in range(len(network) // 2 - 1))
    provenance: dict[str, str | float] = {"algorithm": algorithm, "library": "stable-baselines3"}
    for name, key in (("seed", "seed"), ("steps", "num_timesteps")):
        if isinstance(data.get(key), int):
            provenance[name] = data[key]
    return Policy(
        weights=memory | network,
        centre=np.zeros(readings, dtype=np.float32),
        width=np.ones(readings, dtype=np.float32),
        layers=units,
        lstm=lstm,
        activation=_activation(data, "relu" if algorithm in ("sac", "td3") else "tanh"),
        stack=stack,
        environment=environment,
        provenance=provenance,
        outputs=DIRECT,
        squash=squash,
    )


def _parts(source: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the tensors of a file, as they are in it."""
    try:
        if not stat.S_ISREG(source.stat().st_mode):
            raise InputError(f"model {source} is no regular file: give a file that model.save wrote")
        with zipfile.ZipFile(source) as archive:
            data = _member(archive, source, DATA, LARGEST_DATA)
            content = _member(archive, source, TENSORS, LARGEST_TENSORS)
        record = json.loads(data.decode("utf-8"))
    except OSError as error:
        raise InputError(f"model {source} cannot be read ({error.strerror or error}): give another file") from None
    except InputError:
        raise
    except (zipfile.BadZipFile, ValueError, RecursionError, NotImplementedError, RuntimeError, EOFError) as error:
        raise InputError(f"model {source} is damaged ({shown(str(error))}): save the model again") from None
    if not isinstance(record, dict):
        raise InputError(f"model {source} says nothing of itself: give a file that model.save wrote")
    return record, content


def _member(archive: zipfile.ZipFile, source: Path, name: str, largest: int) -> bytes:
    """The bytes of a part of limited size."""
    try:
        with archive.open(name) as stream:
            data = stream.read(largest + 1)
    except KeyError:
        raise InputError(f"model {source} has no part {name}: give a file that model.save wrote") from None
    if len(data) > largest:
        raise InputError(f"model {source}: its part {name} has more than {largest} bytes: give a smaller model")
    return data


def _tensors(source: Path, content: bytes) -> dict[str, np.ndarray]:
    """All parameters by name, read by a loader that makes nothing but tensors."""
    try:
        import torch
    except ModuleNotFoundError:
        raise InputError(
            f"model {source} needs torch to be read: pip install drillenv[train], or give an exported policy"
        ) from None
    try:
        found = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
        return {str(name): np.array(value.detach().numpy(), dtype=np.float32) for name, value in found.items()}
    except Exception as error:  # the loader raises what it likes on bytes that are no tensors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"model {source} holds no plain tensors ({shown(reason)}): save the model again") from None


def _kind(data: Mapping[str, Any]) -> tuple[str, str, str, str]:
    """The algorithm, where its layers and its last layer are, and how what they give is brought between -1 and 1."""
    described = data.get("policy_class")
    module = described.get("__module__") if isinstance(described, Mapping) else None
    if module == "stable_baselines3.common.policies":
        algorithm = "ppo" if "clip_range" in data else "a2c"
        return algorithm, "mlp_extractor.policy_net", "action_net", "clip"
    if module == "sb3_contrib.common.recurrent.policies":
        return "recurrent-ppo", "mlp_extractor.policy_net", "action_net", "clip"
    if module == "stable_baselines3.sac.policies":
        return "sac", "actor.latent_pi", "actor.mu", "tanh"
    if module == "stable_baselines3.td3.policies":
        return "td3", "actor.mu", "", "tanh"
    raise InputError(f"its policy is of {shown(module)}: give {SUPPORTED}")


def _check_plain(data: Mapping[str, Any], controls: int, harmless: set[str]) -> None:
    """See that nothing stands between readings, layers and actions that the file does not state in plain text."""
    if data.get("use_sde"):
        raise InputError("it was trained with use_sde: give a model without it")
    given = data.get("policy_kwargs")
    keys = set(given) - {":type:", ":serialized:"} if isinstance(given, Mapping) else {shown(given)}
    if keys - harmless:
        raise InputError(f"its policy_kwargs have {', '.join(sorted(keys - harmless))}: give {SUPPORTED}")
    actions = data.get("action_space")
    if not isinstance(actions, Mapping) or actions.get("_shape") != [controls] or _ends(actions) != ({-1.0}, {1.0}):
        raise InputError(
            f"its actions are not those of the environment: give a model of {controls} actions from -1 to 1"
        )


def _ends(space: Mapping[str, Any]) -> tuple[set[float], set[float]]:
    """The numbers in the texts of the low and high ends of a space."""
    low, high = (
        {float(text) for text in re.findall(r"-?\d+\.?\d*", str(space.get(end)))[:MOST_UNITS]}
        for end in ("low", "high")
    )
    return low, high


def _stack(data: Mapping[str, Any], readings: int) -> int:
    """How many observations of so many readings the policy sees side by side."""
    seen = data.get("observation_space")
    shape = seen.get("_shape") if isinstance(seen, Mapping) else None
    size = shape[0] if isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int) else 0
    if size < 1 or size % readings or size // readings > MOST_STACKED:
        raise InputError(
            f"it sees observations of the shape {shown(shape)}: give the {readings} readings or a stack of them"
        )
    return size // readings


def _activation(data: Mapping[str, Any], usual: str) -> str:
    """What follows each layer."""
    said = data["policy_kwargs"].get("activation_fn")
    if said is None:
        return usual
    match = re.fullmatch(r"<class '([\w.]+)'>", str(said))
    found = ACTIVATIONS.get(match[1]) if match else None
    if found is None:
        raise InputError(f"its activation is {shown(said)}: give a model with {', '.join(ACTIVATIONS)}")
    return found


def _lstm(tensors: Mapping[str, np.ndarray], inputs: int) -> dict[str, np.ndarray]:
    """The weights of the LSTM before the layers of the policy, by the names that a Policy has for them."""
    found = [tensors.get(f"lstm_actor.{part}_l0") for part in LSTM_PARTS]
    if "lstm_actor.weight_ih_l1" in tensors or any(each is None for each in found):
        raise InputError("it has not exactly one layer of LSTM: give one of n_lstm_layers=1")
    into, hidden, *biases = (np.asarray(each) for each in found)
    units = hidden.shape[-1]
    shapes = [(4 * units, inputs), (4 * units, units), (4 * units,), (4 * units,)]
    if [each.shape for each in (into, hidden, *biases)] != shapes or not 1 <= units <= MOST_UNITS:
        raise InputError(f"its LSTM does not follow on {inputs} numbers, or has over {MOST_UNITS} units: train another")
    if not all(np.isfinite(each).all() for each in (into, hidden, *biases)):
        raise InputError("its LSTM has numbers that are not finite: train it again")
    return lstm_of(tensors)


def lstm_of(tensors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The weights of the first layer of a policy's LSTM by the names that a Policy has for them."""
    into, hidden, *biases = (tensors[f"lstm_actor.{part}_l0"] for part in LSTM_PARTS)
    return {"lstm.weight_input": into, "lstm.weight_hidden": hidden, "lstm.bias": biases[0] + biases[1]}


def _layers(
    tensors: Mapping[str, np.ndarray], layers: str, head: str, inputs: int, outputs: int
) -> dict[str, np.ndarray]:
    """The weights by the names that a Policy has for them, if they make a network of these inputs and outputs."""
    linear = []
    while f"{layers}.{PER_LAYER * len(linear)}.weight" in tensors and len(linear) <= MOST_LAYERS + 1:
        linear.append(f"{layers}.{PER_LAYER * len(linear)}")
    if head:
        linear.append(head)
    if not linear or len(linear) > MOST_LAYERS + 1:
        raise InputError(f"it has {len(linear)} layers: give {SUPPORTED} of 1 to {MOST_LAYERS}")
    found: dict[str, np.ndarray] = {}
    for i, name in enumerate(linear):
        mine = "action" if i == len(linear) - 1 else f"layer{i}"
        weight, bias = (tensors.get(f"{name}.{part}") for part in ("weight", "bias"))
        if weight is None or bias is None or weight.ndim != 2 or weight.shape != (bias.size, inputs):
            raise InputError(f"its layer {name} does not follow on {inputs} numbers: give {SUPPORTED}")
        if bias.size > MOST_UNITS or not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise InputError(f"its layer {name} has too many units or numbers that are not finite: train it again")
        found[f"{mine}.weight"], found[f"{mine}.bias"] = weight, bias
        inputs = bias.size
    if inputs != outputs:
        raise InputError(f"it gives {inputs} numbers: give a model of {outputs} actions")
    return found


class Unpickled:
    """A model of Stable-Baselines3 of any kind, loaded by that library. THE FILE CAN RUN ANY CODE as it is loaded.

    Args:
        file: The zip file, or a model that was loaded already.

    Raises:
        InputError: it cannot be read or loaded.
    """

    sees_truth = False

    def __init__(self, file: str | Path | Any):
        self.model = _load(Path(file)) if isinstance(file, str | Path) else file
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the episode so far."""
        self._state: Any = None
        self._start = np.ones(1, dtype=bool)

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The action without chance."""
        action, self._state = self.model.predict(observation, self._state, self._start, deterministic=True)
        self._start[:] = False
        return np.asarray(action, dtype=np.float32)


def _load(source: Path) -> Any:
    """The model, with whatever is pickled in its file."""
    data, _ = _parts(source)
    try:
        import sb3_contrib
        import stable_baselines3

        if "target_entropy" in data:
            kind: Any = stable_baselines3.SAC
        elif "policy_delay" in data:
            kind = stable_baselines3.TD3
        elif "clip_range" in data:
            kind = sb3_contrib.RecurrentPPO if "_last_lstm_states" in data else stable_baselines3.PPO
        else:
            kind = stable_baselines3.A2C
        return kind.load(source, device="cpu")
    except ModuleNotFoundError as error:
        raise InputError(f"model {source} needs {error.name} to be loaded: pip install drillenv[train]") from None
    except Exception as error:  # whatever the file makes the library raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"model {source} cannot be loaded ({shown(reason)}): give another file") from None
