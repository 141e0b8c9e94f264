"""What can be known of a hole by remembering what was seen: wear of the bit, the rock, and the frame's resonance.

A reading says little of these by itself; how readings change says more. A blunt bit meets a stiffer rock and drills
less, but so does a bit in another layer; wear can be reckoned from blows and forces, but for the abrasivity of the
layer. A recurrent network (a gated recurrent unit, Cho et al., EMNLP 2014) weighs all this. It was trained on holes
whose truth is known (:mod:`drillenv.training.hole_belief`) and runs with numpy alone. Where the frame resonates is told
by a Bayesian filter on what the plant's physics foretell (:mod:`drillenv.controllers.hole.frame`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from drillenv.controllers.hole.frame import RESONANCES, FrameFilter
from drillenv.controllers.hole.rules import reckoned_wear, single_blows
from drillenv.env.hole.bit import CHATTER
from drillenv.env.hole.readings import AT, READINGS
from drillenv.files import read_arrays

FILE = Path(__file__).parents[1] / "plant_models" / "hole_belief.npz"
UNITS = 64
"""Of the recurrent network."""

SCALES = {
    "mean_peak_force": (1.0, 2.0),
    "largest_peak_force": (1.0, 2.0),
    "peak_force_spread": (0.1, 0.5),
    "impacts_per_cycle": (1.0, 3.0),
    "period_two": (0.05, 0.3),
    "contact_share": (0.2, 0.3),
    "half_harmonic": (2.0, 10.0),
    "first_harmonic": (5.0, 10.0),
    "second_harmonic": (3.0, 10.0),
    "third_harmonic": (2.0, 10.0),
    "penetration_rate": (1.0, 3.0),
    "frequency": (90.0, 30.0),
    "amplitude": (0.42, 0.15),
    "valve_pressure": (0.9, 0.6),
    "pressure": (0.9, 0.6),
    "coil_rise": (60.0, 50.0),
    "hole_depth": (2.0, 2.0),
    "depth_left": (2.0, 2.0),
    "bit_depth": (0.7, 1.0),
    "bit_blows": (0.15, 0.2),
}
"""Centre and width of each reading in its unit: about the middle and the spread of what is met."""
CENTRE = np.array([SCALES[reading.name][0] for reading in READINGS], dtype=np.float32)
WIDTH = np.array([SCALES[reading.name][1] for reading in READINGS], dtype=np.float32)
USUAL = (-4.5, -6.2, 1.4)
"""Logarithms of progress per blow in mm/s per Hz and kN, of the time of contact in s, and of the largest peak over the
amplitude in kN/V, that are usual."""
RECKONED = 2
"""Parts of the wear that are reckoned: abrasion as on rock of abrasivity 1, and fatigue."""
FEATURES = CENTRE.size + len(USUAL) + 2 * RECKONED
"""Numbers that the network is given: readings; logarithms, see USUAL; and both parts of the wear, of the bit so far and
of the last step."""
NAMES = ("wear", "log_abrasivity", "log_stiffness", "log_hardening")
"""What is estimated with a standard deviation: wear of the bit, abrasivity of the layer, its loading stiffness under
the bit in units of STIFFNESS, and the unloading stiffness over it."""
STIFFNESS = 3e7
"""N/m."""
ESTIMATES = 2 * len(NAMES)
"""Numbers that the network gives: means, and logarithms of standard deviations."""
SHOWN = CENTRE.size + len(USUAL)
"""Numbers of the features that are a part of a belief: readings, and logarithms of what they come to."""
WEAR = SHOWN
"""Where the mean of the wear stands in a belief."""
PROBABILITIES = WEAR + ESTIMATES
"""Where the probabilities of the frame's resonances stand, see RESONANCES."""
SIZE = PROBABILITIES + RESONANCES.size
"""Numbers of a belief."""
LOG_DEVIATIONS = (-5.0, 2.0)
"""Ends of the logarithm of a standard deviation."""


class Weights(NamedTuple):
    """Of the network, float32: a layer with tanh, a gated recurrent unit as torch.nn.GRUCell, and a linear layer."""

    input_weight: np.ndarray
    input_bias: np.ndarray
    weight_ih: np.ndarray
    weight_hh: np.ndarray
    bias_ih: np.ndarray
    bias_hh: np.ndarray
    output_weight: np.ndarray
    output_bias: np.ndarray


SHAPES: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {
        "input_weight": (UNITS, FEATURES),
        "input_bias": (UNITS,),
        "weight_ih": (3 * UNITS, UNITS),
        "weight_hh": (3 * UNITS, UNITS),
        "bias_ih": (3 * UNITS,),
        "bias_hh": (3 * UNITS,),
        "output_weight": (ESTIMATES, UNITS),
        "output_bias": (ESTIMATES,),
    }
)


@cache
def read_weights() -> Weights:
    """The weights as they were trained.

    Raises:
        InputError: the file is missing or is another one.
    """
    arrays = read_arrays(FILE, "network", SHAPES, "drillenv.training.hole_belief")
    return Weights(**{name: each.astype(np.float32) for name, each in arrays.items()})


@cache
def fingerprint() -> str:
    """SHA-256 of the weights: a policy is worth something with the network only that it was trained with."""
    return hashlib.sha256(b"".join(each.tobytes() for each in read_weights())).hexdigest()


class Features:
    """What the network is given, for n rigs, each by itself: readings, and what can be reckoned from them.

    Args:
        n: Number of rigs.
    """

    def __init__(self, n: int):
        self._blows, self._worn = np.zeros(n), np.zeros((n, RECKONED))

    def forget(self, rigs: np.ndarray) -> None:
        """Begin anew with these of the rigs."""
        for each in vars(self).values():
            each[rigs] = 0.0

    def of(self, readings: np.ndarray, rigs: np.ndarray | None = None) -> np.ndarray:
        """(m, FEATURES) float32 for these readings (m, 20) of these of the rigs, of all where None."""
        at = np.arange(len(self._blows)) if rigs is None else rigs
        seen = readings.astype(float)
        blows = 1e6 * seen[:, AT["bit_blows"]]
        fresh = blows < self._blows[at]
        self._worn[at[fresh]] = 0.0
        made = np.where(fresh, blows, blows - self._blows[at])
        self._blows[at] = blows
        step = _chatter(seen)[:, None] * reckoned_wear(made, seen[:, AT["mean_peak_force"]])
        self._worn[at] += step
        scaled = np.clip((seen - CENTRE) / WIDTH, -5.0, 5.0)
        signs = np.log(np.maximum(_signs(seen), 1e-4)) - USUAL
        # a bit lasts some hundred steps; all that the network is given is of the order of 1
        return np.column_stack([scaled, signs, self._worn[at], 20.0 * step]).astype(np.float32)


def _signs(seen: np.ndarray) -> np.ndarray:
    """(m, 3) progress per blow, time of contact, and peak over amplitude, see :data:`USUAL`."""
    frequency, peak = np.maximum(seen[:, AT["frequency"]], 1.0), np.maximum(seen[:, AT["largest_peak_force"]], 0.05)
    per_blow = seen[:, AT["penetration_rate"]] / (frequency * peak)
    contact = np.maximum(seen[:, AT["contact_share"]], 0.02) / frequency
    return np.column_stack([per_blow, contact, peak / np.maximum(seen[:, AT["amplitude"]], 0.1)])


def _chatter(seen: np.ndarray) -> np.ndarray:
    """(m,) by which blows wear more where they do not come singly and alike, see :mod:`drillenv.env.hole.bit`."""
    return np.where(single_blows(seen), 1.0, 1.0 + CHATTER)


class Belief:
    """Remembers for n rigs, each by itself.

    Args:
        n: Number of rigs.
        weights: Of the network; those that were trained where left out.

    Raises:
        InputError: there are no weights.
    """

    def __init__(self, n: int, weights: Weights | None = None):
        self._weights = weights or read_weights()
        self._features, self._frame = Features(n), FrameFilter(n)
        self._hidden = np.zeros((n, UNITS), dtype=np.float32)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """All that is remembered, to be kept and put back."""
        return {**vars(self._features), "_hidden": self._hidden, "_frame": self._frame.log_posterior}

    def forget(self, rigs: np.ndarray) -> None:
        """Begin anew with these of the rigs."""
        self._features.forget(rigs)
        self._frame.forget(rigs)
        self._hidden[rigs] = 0.0

    def of(self, readings: np.ndarray, rigs: np.ndarray | None = None) -> np.ndarray:
        """What is known with these readings (m, 20) of these of the rigs, of all where None: (m, SIZE) float32."""
        at = np.arange(len(self._hidden)) if rigs is None else rigs
        features, w = self._features.of(readings, rigs), self._weights
        before = self._hidden[at]
        given = np.tanh(features @ w.input_weight.T + w.input_bias) @ w.weight_ih.T + w.bias_ih
        kept = before @ w.weight_hh.T + w.bias_hh
        reset, update = (
            1.0 / (1.0 + np.exp(-(given[:, part] + kept[:, part]))) for part in (slice(UNITS), slice(UNITS, 2 * UNITS))
        )
        new = np.tanh(given[:, 2 * UNITS :] + reset * kept[:, 2 * UNITS :])
        self._hidden[at] = hidden = (1.0 - update) * new + update * before
        means, deviations = estimates(hidden @ w.output_weight.T + w.output_bias)
        probabilities = self._frame.of(readings.astype(float), STIFFNESS * np.exp(means[:, 2]), np.exp(means[:, 3]), at)
        return np.column_stack([features[:, :SHOWN], means, deviations, probabilities]).astype(np.float32)


def estimates(outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, len(NAMES)) means and standard deviations for what the network gives, (m, ESTIMATES)."""
    n = len(NAMES)
    return outputs[:, :n], np.exp(np.clip(outputs[:, n:], *LOG_DEVIATIONS))
