"""What the settled motion does, by rock and setting: progress, force and blows, for planners of a whole hole.

With the linear rock law forces and lengths grow with the drive, so that at a frequency only pressure over amplitude
decides on the motion, and what it does at 1 V stands for any amplitude. Computed once on the plant without noise:

    python -m drillenv.controllers.hole.settled

writes ``controllers/plant_models/settled.npz`` anew (a minute and a half on two cores).
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.dynamics.exact import THETA, TURN, TURNS, make_scratch
from drillenv.env.episodes import rig_array
from drillenv.env.hole.batch import ARRIVED
from drillenv.env.plant import BLOWS as MEMORY_BLOWS
from drillenv.env.plant import (
    FREQUENCY,
    INTERVAL,
    LAG,
    LAST_TURNS,
    PEAKS,
    PRESSURE,
    S_KEPT,
    SUMS_SIZE,
    TRACE,
    VALVE,
    VOLTAGE,
    drill,
    make_plants,
    place,
)
from drillenv.env.truth import MOST_CYCLES, SEEN, T_LARGEST, T_RATE, T_SINGLE, TRUTH_SIZE, summarise
from drillenv.files import read_arrays
from drillenv.rig import Rig

FILE = Path(__file__).parents[1] / "plant_models" / "settled.npz"
LOADING = np.geomspace(8e6, 90e6, 13)
"""Loading stiffnesses in N/m: those of Table 2.2 under bits from sharp to blunt."""
HARDENING = np.array([1.05, 1.1, 1.15, 1.25, 1.4])
"""Unloading over loading stiffness."""
FREQUENCIES = np.arange(50.0, 121.0, 5.0)
RATIOS = np.arange(0.8, 4.41, 0.1)
"""Pressure over amplitude at the armature in bar/V; beyond their ends the motion at the end is taken."""
SETTLE, KEEP = 10, 4
"""Intervals to settle at each ratio, and to average over."""
RATE, PEAK, SINGLE, BLOWS, FORCE, SQUARES, EIGHTH = range(7)
FEATURES = 7
"""Progress in mm/s at 1 V; largest peak in N at 1 V; share of single blows; blows a second; sums a second of their
forces in kN at 1 V, of the squares, and of the eighth powers, as the eighth root."""
_LOG_FIRST, _LOG_STEP = math.log(LOADING[0]), math.log(LOADING[1] / LOADING[0])
_F_FIRST, _F_STEP = FREQUENCIES[0], FREQUENCIES[1] - FREQUENCIES[0]
_R_FIRST, _R_STEP = RATIOS[0], RATIOS[1] - RATIOS[0]


class Settled(NamedTuple):
    """The table, for the kernels."""

    values: np.ndarray
    """(loadings, hardenings, frequencies, ratios, FEATURES)."""


@njit(**INLINE)
def _place(x: float, n: int):
    """The index below x among n and the share of the next, at the ends where x is beyond."""
    held = min(max(x, 0.0), n - 1.0)
    below = min(int(held), n - 2)
    return below, held - below


@njit(**KERNEL)
def look_up(
    values: np.ndarray, loading: float, hardening: float, frequency: float, ratio: float, out: np.ndarray
) -> None:
    """Fill ``out`` (FEATURES,) with what the settled motion does, interpolated."""
    a, u = _place((math.log(loading) - _LOG_FIRST) / _LOG_STEP, values.shape[0])
    b = 0
    while b < values.shape[1] - 2 and hardening > HARDENING[b + 1]:
        b += 1
    v = min(max((hardening - HARDENING[b]) / (HARDENING[b + 1] - HARDENING[b]), 0.0), 1.0)
    c, s = _place((frequency - _F_FIRST) / _F_STEP, values.shape[2])
    d, t = _place((ratio - _R_FIRST) / _R_STEP, values.shape[3])
    out[:] = 0.0
    for i in range(16):
        weight = u if i & 1 else 1.0 - u
        weight *= v if i & 2 else 1.0 - v
        weight *= s if i & 4 else 1.0 - s
        weight *= t if i & 8 else 1.0 - t
        if weight > 0.0:
            cell = values[a + (i & 1), b + (i >> 1 & 1), c + (i >> 2 & 1), d + (i >> 3 & 1)]
            for j in range(FEATURES):
                out[j] += weight * cell[j]


@cache
def read_settled() -> Settled:
    """The table as it was computed.

    Raises:
        InputError: the file is missing or is another one.
    """
    shape = (LOADING.size, HARDENING.size, FREQUENCIES.size, RATIOS.size, FEATURES)
    return Settled(**read_arrays(FILE, "table", {"values": shape}, "drillenv.controllers.hole.settled"))


@njit(**KERNEL)
def _settle(plants, setting, sums, peaks, windows, features):
    """Run every rig at its setting (n, 3) until it has settled; fill features (n, FEATURES), at 1 V."""
    scratch = make_scratch()
    cycles, truth = np.empty((MOST_CYCLES, 3)), np.empty(TRUTH_SIZE)
    for i in range(setting.shape[0]):
        features[i] = 0.0
        volts = setting[i, 1]
        for interval in range(SETTLE + KEEP):
            turns = plants.states[i, TURNS] + plants.states[i, THETA] / TURN
            drill(plants, i, setting[i], sums, peaks, windows, scratch)
            summarise(sums, peaks, turns, 2000.0, cycles, plants.layers[i], plants.memories[i], truth)
            if interval < SETTLE:
                continue
            features[i, RATE] += truth[T_RATE] / volts / KEEP
            features[i, PEAK] = max(features[i, PEAK], truth[T_LARGEST] / volts)
            features[i, SINGLE] += truth[T_SINGLE] / KEEP
            for j in range(int(sums[S_KEPT])):
                if peaks[j, 1] < SEEN:
                    continue
                force = 1e-3 * peaks[j, 1] / volts
                features[i, BLOWS] += 1.0
                features[i, FORCE] += force
                features[i, SQUARES] += force * force
                features[i, EIGHTH] += force**8
        features[i, BLOWS:] /= INTERVAL * KEEP
        features[i, EIGHTH] = features[i, EIGHTH] ** 0.125


def compute_settled() -> Settled:
    """Every rock and frequency, taken up through the ratios on the plant itself."""
    rocks = [(kl, kl * share, f) for kl in LOADING for share in HARDENING for f in FREQUENCIES]
    plants, rig = make_plants(len(rocks)), rig_array(Rig())
    for i, (loading, unloading, frequency) in enumerate(rocks):
        plants.rigs[i] = rig
        plants.layers[i] = loading, unloading, math.inf, 0.0
        memory = plants.memories[i]
        memory[:] = 0.0
        memory[[PRESSURE, VALVE, FREQUENCY, VOLTAGE]] = 0.6, 0.6, frequency, 0.6
        memory[LAG], memory[MEMORY_BLOWS], memory[LAST_TURNS] = ARRIVED, 1.0, -1e6
        place(plants, i, 0.0)
    sums, peaks, windows = np.empty(SUMS_SIZE), np.empty((PEAKS, 2)), np.empty((0, len(TRACE)))
    values = np.zeros((RATIOS.size, len(rocks), FEATURES))
    setting = np.zeros((len(rocks), 3))
    setting[:, 0], setting[:, 1] = [rock[2] for rock in rocks], 0.5
    for k, ratio in enumerate(RATIOS):
        setting[:, 2] = ratio * setting[:, 1]
        _settle(plants, setting, sums, peaks, windows, values[k])
    shape = (RATIOS.size, LOADING.size, HARDENING.size, FREQUENCIES.size, FEATURES)
    return Settled(np.moveaxis(values.reshape(shape), 0, 3))


def main() -> None:
    """Compute the table and write it."""
    from drillenv.files import whole

    with whole(FILE) as part:
        np.savez_compressed(part, values=compute_settled().values.astype(np.float32))


if __name__ == "__main__":
    main()
