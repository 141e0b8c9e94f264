"""What the instruments tell of a step: the readings of the other environments, and five of the hole and the coil."""

from __future__ import annotations

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINE
from drillenv.env import observation as motion
from drillenv.env.observation import Reading

# The state of a hole: a row of Holes.states. What an info shows of it is named in SHOWN.
(
    DEPTH,
    TARGET,
    WEAR,
    RISE,
    BIT,
    TIME,
    SPENT,
    BIT_FROM,
    BLOWS,
    LAYER,
    ABRASIVITY,
    RESONANCE,
    STEP_DEPTH,
    STEP_SPENT,
    STEP_TIME,
    CHANGED,
    BROKEN,
    TRIPPED,
    BEGUN,
    OWED,
    GAIN,
) = range(21)
HOLE_SIZE = 21
"""Depth and depth to be reached in m; wear of the bit; rise of the coil in K; number of the bit, from 0; time in s and
money in EUR since the start; depth in m at which the bit was fitted, and the blows it has made; layer, its abrasivity;
the frame's resonance in Hz; what the last step drilled in m, spent in EUR and took in s; how often, so far, the bit was
changed, broke, and the coil tripped; whether drilling has begun; what is owed for the first bit in EUR; drive gain of
the rig without its frame."""
SHOWN = {
    "hole_depth": DEPTH,
    "target_depth": TARGET,
    "bit_wear": WEAR,
    "coil_rise": RISE,
    "time": TIME,
    "total_spent": SPENT,
    "hole_layer": LAYER,
    "abrasivity": ABRASIVITY,
    "resonance": RESONANCE,
    "drilled": STEP_DEPTH,
    "spent": STEP_SPENT,
    "duration": STEP_TIME,
    "bits_changed": CHANGED,
    "bits_broken": BROKEN,
    "trips": TRIPPED,
}
"""The names of an info and the columns they stand for."""

READINGS = (
    *motion.READINGS,
    Reading("coil_rise", "K", 0, 200, 1.0, "rise of the coil over the air, by its thermometer", RISE, 1),
    Reading("hole_depth", "m", 0, 100, 0, "depth of the hole", DEPTH, 1),
    Reading("depth_left", "m", 0, 100, 0, "depth left to drill", TARGET, 1),
    Reading("bit_depth", "m", 0, 100, 0, "drilled with the present bit", BIT_FROM, 1),
    Reading("bit_blows", "1e6", 0, 10, 0, "blows that the present bit has made", BLOWS, 1e6),
)
"""The observation, in order. ``truth`` is a column of the hole's state for the last five."""
AT = {reading.name: j for j, reading in enumerate(READINGS)}
"""Where each stands in an observation, by name."""
SIZE = len(READINGS)
LOW = np.array([reading.low for reading in READINGS], dtype=np.float32)
HIGH = np.array([reading.high for reading in READINGS], dtype=np.float32)
_RISE_NOISE = READINGS[motion.SIZE].noise
_MILLION = READINGS[SIZE - 1].scale


@njit(**INLINE)
def observe_hole(hole: np.ndarray, noise: np.ndarray, strength: float, seen: np.ndarray) -> None:
    """Fill the last five of the readings ``seen`` (SIZE,) float32 from the state of a hole."""
    hole, noise, seen = borrowed(hole), borrowed(noise), borrowed(seen)
    at = motion.SIZE
    values = (
        hole[RISE] + strength * _RISE_NOISE * noise[at],
        hole[DEPTH],
        hole[TARGET] - hole[DEPTH],
        hole[DEPTH] - hole[BIT_FROM],
        hole[BLOWS] / _MILLION,
    )
    for j in range(5):
        seen[at + j] = min(max(np.float32(values[j]), LOW[at + j]), HIGH[at + j])
