"""A policy that was trained on ``DrillBit``, run with numpy alone.

Two files in a folder, read without running anything that is in them: ``policy.safetensors`` has the weights, float32,
of a multilayer perceptron, ``policy.json`` what they are weights of. What is known of the hole
(:class:`~drillenv.controllers.hole.belief.Belief`) gives four numbers: frequency, amplitude, pressure over amplitude,
and whether to change the bit, see :func:`actions_of`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load, save

from drillenv.checks import InputError, shown
from drillenv.controllers.hole.belief import SIZE, WEAR, Belief, fingerprint
from drillenv.env.task import RANGES
from drillenv.files import made_folder, whole

FORMAT = "drillenv-hole-policy/3"
WEIGHTS, DESCRIPTION = "policy.safetensors", "policy.json"
LARGEST = 16_000_000
"""Bytes of the weights."""
RATIO, HALF_RATIO, SLOPE = 2.0, 1.2, 1.5
"""Pressure over amplitude at 120 Hz in bar/V that an output of 0 stands for, what an output of 1 adds, and the power of
the frequency with which both fall below: the boundary of P-1-I-1 goes so."""
CHANGE_AT, SOONER = 0.8, 0.7
"""Estimated wear at which an output of 0 changes the bit, and by how much less an output of 1 does."""


def actions_of(outputs: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Actions (..., 4) float32 for what a policy gives, (..., 4), where so much is known of the hole, (..., SIZE).

    Outputs say at which frequency, amplitude and ratio to drill, see :func:`settings_of`, and by how much sooner or
    later than at the estimated wear :data:`CHANGE_AT` to change the bit.
    """
    settings = settings_of(outputs[..., :3])
    sooner = SOONER * np.clip(outputs[..., 3].astype(float), -1.0, 1.0)
    change = np.sign(known[..., WEAR] - CHANGE_AT + sooner)
    return np.concatenate([settings, change[..., None]], axis=-1).astype(np.float32)


def settings_of(outputs: np.ndarray) -> np.ndarray:
    """(..., 3) frequency, amplitude and pressure as actions for outputs (..., 3), the last of them of the ratio."""
    held = np.clip(outputs.astype(float), -1.0, 1.0)
    middle, half = RANGES.mean(axis=1), 0.5 * (RANGES[:, 1] - RANGES[:, 0])
    frequency, amplitude = middle[0] + half[0] * held[..., 0], middle[1] + half[1] * held[..., 1]
    ratio = (RATIO + HALF_RATIO * held[..., 2]) * (frequency / RANGES[0, 1]) ** SLOPE
    pressure = np.clip((ratio * amplitude - middle[2]) / half[2], -1.0, 1.0)
    return np.stack([held[..., 0], held[..., 1], pressure], axis=-1)


@dataclass(frozen=True, slots=True)
class HolePolicy:
    """A policy network and where it comes from.

    Args:
        weights: By name ("layer0.weight" ... "action.bias"), float32, as Linear of torch has them.
        provenance: Texts and numbers for the reader: seed, steps, score and so on.
    """

    weights: Mapping[str, np.ndarray]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def layers(self) -> int:
        """Number of layers before the last."""
        return sum(name.startswith("layer") and name.endswith("weight") for name in self.weights)


class HoleLearned:
    """Acts as the policy it is given, by the mean of the distribution it was trained with.

    Args:
        policy: The folder of a policy, or one that was read.

    Raises:
        InputError: the folder holds no policy that can be used.
    """

    sees_truth = False

    def __init__(self, policy: str | Path | HolePolicy):
        self.policy: HolePolicy = policy if isinstance(policy, HolePolicy) else read_policy(policy)
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the hole so far."""
        self._belief: Belief | None = None

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The mean action, (4,) or (n, 4) as the observation is (20,) or (n, 20)."""
        readings = np.atleast_2d(observation)
        if self._belief is None:
            self._belief = Belief(len(readings))
        hidden = known = self._belief.of(readings)
        weights = self.policy.weights
        for i in range(self.policy.layers):
            hidden = np.tanh(hidden @ weights[f"layer{i}.weight"].T + weights[f"layer{i}.bias"])
        outputs = hidden @ weights["action.weight"].T + weights["action.bias"]
        actions = actions_of(outputs, known)
        return actions[0] if observation.ndim == 1 else actions


def write_policy(folder: str | Path, policy: HolePolicy) -> None:
    """Write the two files of a policy, each whole or not at all.

    Raises:
        InputError: the folder cannot be written to.
    """
    place = made_folder(folder)
    record = {
        "format": FORMAT,
        "layers": policy.layers,
        "belief": fingerprint(),
        "provenance": dict(policy.provenance),
    }
    weights = {name: np.ascontiguousarray(value, np.float32) for name, value in policy.weights.items()}
    with whole(place / WEIGHTS) as part:
        part.write_bytes(save(weights))
    with whole(place / DESCRIPTION) as part:
        part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def read_policy(folder: str | Path) -> HolePolicy:
    """Read a policy from its folder.

    Raises:
        InputError: a file is missing, too large, or not what it should be.
    """
    place = Path(folder)
    try:
        record = json.loads((place / DESCRIPTION).read_text(encoding="utf-8"))
        if (place / WEIGHTS).stat().st_size > LARGEST:
            raise InputError(f"{place / WEIGHTS} is larger than {LARGEST} bytes: give a policy of drillenv")
        weights = load((place / WEIGHTS).read_bytes())
    except InputError:
        raise
    except Exception as error:
        why = getattr(error, "strerror", None) or "its files are damaged"
        raise InputError(f"policy {shown(str(folder))} cannot be read ({why}): give a folder with a policy") from None
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"policy {shown(str(folder))} is not of the format {FORMAT}: give one that is")
    if record.get("belief") != fingerprint():
        raise InputError(f"policy {shown(str(folder))} was trained with another belief of holes: train it again")
    inputs, layers, provenance = SIZE, record.get("layers"), record.get("provenance")
    if type(layers) is not int or not isinstance(provenance, dict):
        raise InputError(f"policy {shown(str(folder))} does not say its layers and provenance: give another")
    for i in range(layers):
        shape = weights[f"layer{i}.weight"].shape if f"layer{i}.weight" in weights else ()
        bias = weights.get(f"layer{i}.bias", np.empty(0))
        if len(shape) != 2 or shape[1] != inputs or bias.shape != shape[:1]:
            raise InputError(f"policy {shown(str(folder))} has other weights than it says: give another")
        inputs = shape[0]
    last = [weights.get(f"action.{part}", np.empty(0)).shape for part in ("weight", "bias")]
    if last != [(4, inputs), (4,)]:
        raise InputError(f"policy {shown(str(folder))} has other weights than it says: give another")
    return HolePolicy({name: weights[name] for name in _names(layers)}, provenance)


def _names(layers: int) -> list[str]:
    """The names of the weights of so many layers and the last."""
    linear = [*(f"layer{i}" for i in range(layers)), "action"]
    return [f"{name}.{part}" for name in linear for part in ("weight", "bias")]
