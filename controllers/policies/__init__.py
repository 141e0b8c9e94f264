"""Trained policies as data: two files in a folder, read without running anything that is in them.

    policy.safetensors   the weights, float32
    policy.json          what they are the weights of

    {"format": "drillenv-policy/1", "environment": "drillenv/DrillLayers-v0",
     "network": {"activation": "tanh", "lstm": 0, "layers": [64, 64]},
     "observation": {"names": [...], "centre": [...], "width": [...], "stack": 4},
     "action": {"names": ["frequency", "amplitude", "ratio"], "low": [50, 0.3, 1.3], "high": [120, 0.6, 3.3]},
     "weights": {"sha256": "..."}, "provenance": {"seed": 0, ...}}

Each reading of an observation is scaled to (reading - centre) / width; the last ``stack`` observations, the newest last
and zeros before the first, go through an LSTM of ``lstm`` units (where that is not 0), then through ``layers``, then
through a linear layer to three numbers, from -1 for the low end to 1 for the high one: Hz, V and bar/V, see
:func:`actions_of`.

A policy whose numbers are the actions of the environment themselves has the format drillenv-policy/2, with "pressure"
in the place of "ratio", from 0.6 to 1.8 bar, and says under "squash" what brings them between -1 and 1: "clip" or
"tanh".

A model that Stable-Baselines3 saved is read too, see :mod:`drillenv.controllers.policies.stable_baselines`.
"""

from __future__ import annotations

import hashlib
import json
import math
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
import safetensors
from safetensors.numpy import save

from drillenv.checks import InputError, choice, count, number, shown
from drillenv.env.observation import READINGS
from drillenv.env.registration import IDS
from drillenv.env.task import RANGES
from drillenv.files import made_folder, whole

FORMAT, DIRECT_FORMAT = "drillenv-policy/1", "drillenv-policy/2"
WEIGHTS, DESCRIPTION = "policy.safetensors", "policy.json"
LARGEST_WEIGHTS, LARGEST_DESCRIPTION = 16_000_000, 64_000
"""Bytes of the two files; those of two layers of 64 units have some 40 000 and 3 000."""
ACTIVATIONS = ("tanh", "relu")
MOST_LAYERS, MOST_UNITS, MOST_STACKED = 8, 1024, 64
ACTIONS = ("frequency", "amplitude", "ratio")
ACTION_RANGES = np.array([RANGES[0], RANGES[1], [1.3, 3.3]])
"""Hz, V and bar/V. The policy says how much pressure there is to be over the amplitude and not how much, because that
decides on the motion (see drillenv.controllers.rules): what a rock bears is then one number at any amplitude."""
DIRECT = ("frequency", "amplitude", "pressure")
"""The numbers of a policy that gives the actions of the environment."""
OUTPUTS: Mapping[tuple[str, ...], np.ndarray] = MappingProxyType({ACTIONS: ACTION_RANGES, DIRECT: RANGES})
"""What a policy's numbers may be, and the ranges that -1 to 1 stand for."""
SQUASHES = ("clip", "tanh")
NAMES = tuple(reading.name for reading in READINGS)
MOST_PROVENANCE = 64
SHIPPED = Path(__file__).parent / "ppo-layers"
"""The policy that is used where none is named."""


@dataclass(frozen=True, slots=True)
class Policy:
    """A policy network, its inputs and where it comes from.

    Args:
        weights: By name, float32: for layer i of ``layers`` "layer<i>.weight" (units, inputs) and "layer<i>.bias"
            (units,), "action.weight" (3, inputs) and "action.bias" (3,); with an LSTM of h units also
            "lstm.weight_input" (4 h, inputs), "lstm.weight_hidden" (4 h, h) and "lstm.bias" (4 h,), in the order
            input, forget, cell and output gate.
        centre, width: (15,) float32, to scale the readings by; (20,) of a model of Stable-Baselines3 that drills holes.
        layers: Units of each layer.
        lstm: Units of the LSTM before them, 0 for none.
        activation: "tanh" or "relu", after each layer.
        stack: How many of the last observations are seen at once.
        environment: The id that it was trained on.
        provenance: Texts and numbers for the reader: seed, steps, score and so on.
        outputs: What the three numbers are: ACTIONS or DIRECT.
        squash: How they come between -1 and 1: "clip" or, where they are DIRECT, "tanh".
    """

    weights: Mapping[str, np.ndarray]
    centre: np.ndarray
    width: np.ndarray
    layers: tuple[int, ...]
    lstm: int
    activation: str
    stack: int
    environment: str
    provenance: Mapping[str, str | float] = field(default_factory=dict)
    outputs: tuple[str, ...] = ACTIONS
    squash: str = "clip"

    def actions(self, numbers: np.ndarray) -> np.ndarray:
        """Actions (..., 3) float32 of the environments for what the last layer gives, (..., 3)."""
        if self.outputs == ACTIONS:
            return actions_of(numbers)
        squashed = np.tanh(numbers) if self.squash == "tanh" else np.clip(numbers, -1.0, 1.0)
        return squashed.astype(np.float32)

    def as_record(self) -> dict[str, Any]:
        """What ``policy.json`` says, apart from the sum of the weights."""
        direct = self.outputs == DIRECT
        return {
            "format": DIRECT_FORMAT if direct else FORMAT,
            "environment": self.environment,
            "network": {"activation": self.activation, "lstm": self.lstm, "layers": list(self.layers)},
            "observation": {
                "names": list(NAMES),
                "centre": [float(each) for each in self.centre],
                "width": [float(each) for each in self.width],
                "stack": self.stack,
            },
            "action": {
                "names": list(self.outputs),
                "low": OUTPUTS[self.outputs][:, 0].tolist(),
                "high": OUTPUTS[self.outputs][:, 1].tolist(),
                **({"squash": self.squash} if direct else {}),
            },
            "provenance": dict(self.provenance),
        }


def actions_of(outputs: np.ndarray) -> np.ndarray:
    """Actions (..., 3) float32 of the environments for outputs (..., 3) of the network."""
    low, high = ACTION_RANGES.T
    frequency, amplitude, ratio = np.moveaxis(low + 0.5 * (high - low) * (np.clip(outputs, -1.0, 1.0) + 1.0), -1, 0)
    settings = np.stack([frequency, amplitude, amplitude * ratio], axis=-1)
    low, high = RANGES.T
    return np.clip(2.0 * (settings - low) / (high - low) - 1.0, -1.0, 1.0).astype(np.float32)


def outputs_for(frequency: float, amplitude: float, pressure: float) -> np.ndarray:
    """(3,) the outputs that ask for a setting in Hz, V and bar."""
    low, high = ACTION_RANGES.T
    return 2.0 * (np.array([frequency, amplitude, pressure / amplitude]) - low) / (high - low) - 1.0


def shapes(layers: tuple[int, ...], lstm: int, stack: int) -> dict[str, tuple[int, ...]]:
    """The weights of a network by name, and the shape of each."""
    inputs = stack * len(READINGS)
    found: dict[str, tuple[int, ...]] = {}
    if lstm:
        found["lstm.weight_input"] = (4 * lstm, inputs)
        found["lstm.weight_hidden"] = (4 * lstm, lstm)
        found["lstm.bias"] = (4 * lstm,)
        inputs = lstm
    for i, units in enumerate(layers):
        found[f"layer{i}.weight"], found[f"layer{i}.bias"] = (units, inputs), (units,)
        inputs = units
    return found | {"action.weight": (len(ACTIONS), inputs), "action.bias": (len(ACTIONS),)}


def write_policy(folder: str | Path, policy: Policy) -> None:
    """Write the two files of a policy, each whole or not at all.

    Raises:
        InputError: the folder cannot be written to.
    """
    data = save({name: np.ascontiguousarray(values, np.float32) for name, values in policy.weights.items()})
    record = policy.as_record() | {"weights": {"sha256": hashlib.sha256(data).hexdigest()}}
    target = made_folder(folder)
    with whole(target / WEIGHTS) as part:
        part.write_bytes(data)
    with whole(target / DESCRIPTION) as part:
        part.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_policy(folder: str | Path) -> Policy:
    """Read a policy from its folder, or from a model that Stable-Baselines3 saved, a file that ends in .zip.

    Raises:
        InputError: the files are not there, too large, cut off, of another version, or not what the head of this
            module describes. Nothing in them is run, and no other file is opened.
    """
    if not isinstance(folder, str | Path) or "\0" in str(folder) or not str(folder).strip():
        raise InputError(f"policy is {shown(folder)}: give the folder of a policy")
    source = Path(folder)
    if source.suffix.lower() == ".zip":
        from drillenv.controllers.policies.stable_baselines import read_model

        return read_model(source)
    record = _parsed(_content(source / DESCRIPTION, LARGEST_DESCRIPTION), source / DESCRIPTION)
    data = _content(source / WEIGHTS, LARGEST_WEIGHTS)
    try:
        return _policy(record, data)
    except InputError as error:
        raise InputError(f"policy {source}: {error}") from None


def _content(file: Path, largest: int) -> bytes:
    """The bytes of a regular file of limited size."""
    try:
        # asked before it is opened: opening a pipe would wait for ever
        if not stat.S_ISREG(file.stat().st_mode):
            raise InputError(f"policy file {file} is no regular file: give the folder of a policy")
        with file.open("rb") as stream:
            data = stream.read(largest + 1)
    except OSError as error:
        raise InputError(
            f"policy file {file} cannot be read ({error.strerror}): give a folder with {WEIGHTS} and {DESCRIPTION}"
        ) from None
    if len(data) > largest:
        raise InputError(f"policy file {file} has more than {largest} bytes: give a policy that was exported")
    return data


def _parsed(data: bytes, file: Path) -> dict[str, Any]:
    """The record in ``policy.json``."""
    try:
        record = json.loads(data.decode("utf-8"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise InputError(f"policy file {file} is not JSON ({shown(str(error))}): export the policy again") from None
    if not isinstance(record, dict) or record.get("format") not in (FORMAT, DIRECT_FORMAT):
        given = shown(record.get("format")) if isinstance(record, dict) else shown(record)
        raise InputError(
            f"policy file {file} has the format {given}: give one of the format {FORMAT!r} or {DIRECT_FORMAT!r}"
        )
    return record


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def _policy(record: dict[str, Any], data: bytes) -> Policy:
    """The policy of a record and the bytes of its weights, everything checked."""
    _keys("policy", record, ("format", "environment", "network", "observation", "action", "weights", "provenance"))
    network = _keys("network", record["network"], ("activation", "lstm", "layers"))
    seen = _keys("observation", record["observation"], ("names", "centre", "width", "stack"))
    direct = record["format"] == DIRECT_FORMAT
    action = _keys("action", record["action"], ("names", "low", "high", *(("squash",) if direct else ())))
    weights = _keys("weights", record["weights"], ("sha256",))
    if seen["names"] != list(NAMES):
        raise InputError(f"observation names are {shown(seen['names'])}: give a policy of these readings")
    outputs = DIRECT if direct else ACTIONS
    low, high = OUTPUTS[outputs].T.tolist()
    if action["names"] != list(outputs) or action["low"] != low or action["high"] != high:
        raise InputError(f"action is {shown(action)}: give a policy of {', '.join(outputs)} from {low} to {high}")
    if weights["sha256"] != hashlib.sha256(data).hexdigest():
        raise InputError(f"{WEIGHTS} is not the file that {DESCRIPTION} was written with: export the policy again")
    layers = network["layers"]
    if not isinstance(layers, list) or len(layers) > MOST_LAYERS:
        raise InputError(f"layers is {shown(layers)}: give a list of at most {MOST_LAYERS} numbers of units")
    layers = tuple(count("units of a layer", units, 1, MOST_UNITS) for units in layers)
    lstm = count("units of the lstm", network["lstm"], 0, MOST_UNITS)
    stack = count("stack", seen["stack"], 1, MOST_STACKED)
    return Policy(
        weights=_tensors(data, shapes(layers, lstm, stack)),
        centre=_row("centre", seen["centre"], -1e6, 1e6),
        width=_row("width", seen["width"], 1e-6, 1e6),
        layers=layers,
        lstm=lstm,
        activation=choice("activation", network["activation"], ACTIVATIONS),
        stack=stack,
        environment=choice("environment", record["environment"], IDS),
        provenance=_provenance(record["provenance"]),
        outputs=outputs,
        squash=choice("squash", action["squash"], SQUASHES) if direct else "clip",
    )


def _keys(name: str, record: object, allowed: tuple[str, ...]) -> dict[str, Any]:
    """The record, if it has exactly these keys."""
    if not isinstance(record, dict) or set(record) != set(allowed):
        given = sorted(record) if isinstance(record, dict) else record
        raise InputError(f"{name} is {shown(given)}: give a record with {', '.join(allowed)}")
    return record


def _row(name: str, values: object, low: float, high: float) -> np.ndarray:
    """(15,) float32, a number for each reading."""
    if not isinstance(values, list) or len(values) != len(NAMES):
        raise InputError(f"{name} is {shown(values)}: give a list of {len(NAMES)} numbers")
    return np.array([number(f"{name} of a reading", value, low, high) for value in values], dtype=np.float32)


def _provenance(record: object) -> dict[str, str | float]:
    """Texts and numbers by name."""
    if not isinstance(record, dict) or len(record) > MOST_PROVENANCE:
        raise InputError(f"provenance is {shown(record)}: give a record of texts and numbers")
    for name, value in record.items():
        if not isinstance(value, str | int | float) or (isinstance(value, float) and not math.isfinite(value)):
            raise InputError(f"provenance {shown(name)} is {shown(value)}: give a text or a finite number")
    return record


def _tensors(data: bytes, wanted: dict[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """The weights, if they have exactly these names and shapes, and are finite numbers."""
    try:
        found = dict(safetensors.deserialize(data))
    except safetensors.SafetensorError as error:
        raise InputError(f"{WEIGHTS} cannot be read ({shown(str(error))}): export the policy again") from None
    if set(found) != set(wanted):
        raise InputError(f"{WEIGHTS} holds {shown(sorted(found))}: this network needs {', '.join(wanted)}")
    weights = {}
    for name, shape in wanted.items():
        given = found[name]
        if given["dtype"] != "F32" or tuple(given["shape"]) != shape:
            kind = f"{given['dtype']} {tuple(given['shape'])}"
            raise InputError(f"{WEIGHTS}: {name} is {kind}: this network needs F32 {shape}")
        values = np.frombuffer(given["data"], dtype="<f4").reshape(shape).astype(np.float32)
        if not np.isfinite(values).all():
            raise InputError(f"{WEIGHTS}: {name} has values that are no finite numbers: train the policy again")
        weights[name] = values
    return weights
