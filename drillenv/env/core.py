"""What the scalar and the vector environment share besides the batch: info, windows and checks of actions."""

from __future__ import annotations

from typing import Any

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.env import observation as table
from drillenv.env.truth import T_DRIVE, T_EXCESS, T_LABEL, T_PERIOD, TRUTH

TERMS = ("penetration_reward", "force_reward", "energy_reward")
"""The terms of the reward in mm/s, as they add up."""
_NAMES: dict[tuple[float, float], str] = {}


def motion_name(period: float, impacts: float) -> str:
    """P-n-I-m, or "none" where the motion did not repeat within the interval."""
    name = _NAMES.get((period, impacts))
    if name is None:
        name = _NAMES[period, impacts] = f"P-{int(period)}-I-{int(impacts)}" if period else "none"
    return name


def info_of(truth: np.ndarray, reward: float, weights: np.ndarray) -> dict[str, Any]:
    """The truth about one interval: the numbers named in TRUTH, the label, the terms of the reward and the cost."""
    values = truth.tolist()
    info: dict[str, Any] = dict(zip(TRUTH, values, strict=True))
    info["motion"] = motion_name(values[T_PERIOD], values[T_LABEL])
    force, energy = -1e-3 * weights[2] * values[T_EXCESS], -weights[3] * values[T_DRIVE]
    info["penetration_reward"] = float(reward - force - energy)
    info["force_reward"], info["energy_reward"] = float(force), float(energy)
    info["cost"] = values[T_EXCESS]
    return info


def infos_of(truths: np.ndarray, rewards: np.ndarray, weights: np.ndarray, which: np.ndarray) -> dict[str, Any]:
    """As ``info_of`` for the environments marked in ``which`` (n,), in Gymnasium's form: an array and a mask a key."""
    rows = np.where(which[:, None], truths, 0.0)
    infos: dict[str, Any] = {name: rows[:, j].copy() for j, name in enumerate(TRUTH)}
    labels = rows[:, (T_PERIOD, T_LABEL)].tolist()
    infos["motion"] = np.array([motion_name(*label) for label in labels], dtype=object)
    infos["motion"][~which] = None
    force, energy = -1e-3 * weights[2] * rows[:, T_EXCESS], -weights[3] * rows[:, T_DRIVE]
    infos["penetration_reward"] = np.where(which, rewards, 0.0) - force - energy
    infos["force_reward"], infos["energy_reward"] = force, energy
    infos["cost"] = infos["force_excess"].copy()
    return infos | {f"_{key}": which.copy() for key in infos}


def checked_actions(given: Any, shape: tuple[int, ...]) -> np.ndarray:
    """``given`` as float32 of this shape.

    Raises:
        InputError: another shape, not numbers, not finite, or outside [-1, 1] by more than float32's rounding.
    """
    try:
        actions = np.asarray(given)
    except (TypeError, ValueError):
        actions = np.empty(0, dtype=object)
    if actions.dtype.kind not in "fiu":
        raise InputError(f"action is {shown(given)}: give an array {shape} of numbers from -1 to 1")
    if actions.shape != shape:
        raise InputError(f"action has the shape {actions.shape}: give an array {shape} of numbers from -1 to 1")
    # one comparison catches what is too large and what is not a number; the smallest whole number has no absolute value
    if not np.abs(actions if actions.dtype.kind == "f" else actions.astype(float)).max() <= 1.00001:
        raise InputError(
            f"action is {shown(actions.tolist())}: give finite numbers from -1 to 1 "
            "(gymnasium.wrappers.ClipAction clips what a policy proposes)"
        )
    # contiguous and writable, or the kernel would be compiled anew for arrays that are not
    return np.array(actions, dtype=np.float32, order="C")


def window_observation(window: np.ndarray, noise: np.ndarray, strength: float) -> np.ndarray:
    """What the recorder has of an interval, (4, samples) float32: a trace (samples, 8) and standard normal noise."""
    signal = window[:, : len(table.CHANNELS)].T * table.CHANNEL_SCALES[:, None]
    signal = signal + strength * table.CHANNEL_NOISE[:, None] * noise
    return np.clip(signal.astype(np.float32), table.CHANNEL_LOW[:, None], table.CHANNEL_HIGH[:, None])
