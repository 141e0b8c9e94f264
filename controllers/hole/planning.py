"""Dynamic programming over a whole hole, for one that knows all of it: layers, frame, and strengths of the bits.

The state is the depth, the number of the bit, its wear, and the rise of the coil; the motion is taken as settled
(:mod:`drillenv.controllers.hole.settled`), which separates it from the slow states. With all of an episode known
nothing is random, so that Bellman's equation is solved backwards once, from the bottom of the hole, over a grid:

    V(z, k, w, T) = min( change: bit + rate * change_time + V(z, k + 1, 0, 0),
                         drill:  min over settings of the cost of DZ + V(z + DZ, k, w', T') )

Settings that break the bit or trip the coil are left out: to change the bit, or to drill with less, is cheaper. Where
bits may not be changed, they are drilled with until they break, which takes the place of a change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.controllers.hole.settled import (
    BLOWS,
    EIGHTH,
    FEATURES,
    FORCE,
    PEAK,
    RATE,
    SINGLE,
    SQUARES,
    look_up,
    read_settled,
)
from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.env.hole import shaker
from drillenv.env.hole.bit import CHATTER, EDGE_POWER, FATIGUE, FATIGUE_EXPONENT, LIFE, stiffening
from drillenv.env.hole.costs import BIT as BIT_PRICE
from drillenv.env.hole.costs import CHANGE_TIME, COMPRESSOR, ENERGY, FISHING_TIME, METRE, RIG_RATE
from drillenv.env.hole.episodes import LAYER_ABRASIVITY, LAYER_END, LAYER_KL, LAYER_KU, MOST_BITS, Hole
from drillenv.env.hole.task import HoleTask
from drillenv.env.task import RANGES

DEPTHS = 200
"""Steps of the grid over the depth."""
WEARS = np.arange(0.0, 1.651, 0.05)
RISES = np.arange(0.0, 100.1, 10.0)
BITS = 16
"""Bits that a plan may use from the present one on."""
NEVER = 1e6
"""Cost in EUR of a hole that no bit is left for."""
SAME = 0.005
"""Settings that are no better than another by this share are left out of a plan."""
SLOWEST = 0.05
"""mm/s below which a setting is left out."""
D_TIME, D_WEAR, D_RISE, D_COST = range(4)


def settings_grid(frequencies: int = 15, amplitudes: int = 13, pressures: int = 13) -> np.ndarray:
    """(n, 3) settings in Hz, V and bar, evenly over the ranges of Table 2.1."""
    sizes = (frequencies, amplitudes, pressures)
    axes = [np.linspace(low, high, n) for (low, high), n in zip(RANGES.tolist(), sizes, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


class Physics(NamedTuple):
    """What of an episode and its task decides on the slow states, for the kernels."""

    values: np.ndarray
    """See :class:`drillenv.controllers.hole.settled.Settled`."""
    costs: np.ndarray
    layers: np.ndarray
    strengths: np.ndarray
    depth: float
    resonance: float
    frame: float
    wears: float
    blunts: float
    heats: float
    amplifier: float
    rating: float


def physics_of(task: HoleTask, hole: Hole) -> Physics:
    """The physics of a hole of a task."""
    without = task.without
    return Physics(
        read_settled().values,
        task.costs.as_array(),
        hole.layers,
        hole.strengths,
        hole.depth,
        hole.resonance,
        task.frame_depth(),
        0.0 if "wear" in without else 1.0,
        0.0 if "blunting" in without else 1.0,
        0.0 if "heat" in without else 1.0,
        task.amplifier_force(),
        task.reward.rating,
    )


@njit(**KERNEL)
def drilled(ph: Physics, layer: int, wear: float, setting: np.ndarray, room: np.ndarray):
    """What a setting (3,) does in the settled motion on a layer with a bit of this wear.

    Returns:
        Progress in m/s, wear a second, the coil's final rise in K, cost in EUR a second, and peak force in N.
    """
    frequency = setting[0]
    amplitude = min(setting[1], shaker.largest_amplitude(frequency, ph.amplifier))
    at_armature = amplitude * shaker.share_transmitted(frequency, ph.resonance, ph.frame)
    stiffer = stiffening(ph.blunts * wear)
    loading, unloading = ph.layers[layer, LAYER_KL], ph.layers[layer, LAYER_KU]
    look_up(ph.values, loading * stiffer, unloading / loading, frequency, setting[2] / at_armature, room)
    u = at_armature / (1e-3 * ph.rating)
    heat = room[SQUARES] * u * u / EDGE_POWER
    abrasive = 0.5 * ph.layers[layer, LAYER_ABRASIVITY] * (room[BLOWS] + u * room[FORCE]) * (1.0 + heat * heat)
    worn = abrasive + FATIGUE * (u * room[EIGHTH]) ** FATIGUE_EXPONENT
    worn *= ph.wears * (1.0 + CHATTER * (1.0 - room[SINGLE])) / LIFE
    rise = ph.heats * shaker.final_rise(frequency, amplitude)
    power = ph.costs[COMPRESSOR] + shaker.COIL_POWER * rise / shaker.LIMIT
    cost = ph.costs[RIG_RATE] + ph.costs[ENERGY] * power
    return 1e-3 * at_armature * room[RATE], worn, rise, cost, at_armature * room[PEAK]


@njit(**KERNEL)
def choices(ph: Physics, layer: int, wear: float, settings: np.ndarray, out: np.ndarray) -> int:
    """Fill rows of ``out`` (n, 4) with time, wear, rise and cost a metre of the settings worth having; their number.

    A setting is not worth having where another one costs, wears and heats no more.
    """
    room, n = np.empty(FEATURES), 0
    all_of = np.empty((settings.shape[0], 4))
    for i in range(settings.shape[0]):
        rate, worn, rise, cost, _peak = drilled(ph, layer, wear, settings[i], room)
        if rate * 1e3 > SLOWEST:
            all_of[n, D_TIME], all_of[n, D_WEAR] = 1.0 / rate, worn / rate
            all_of[n, D_RISE], all_of[n, D_COST] = rise, cost / rate
            n += 1
    kept = 0
    for i in np.argsort(all_of[:n, D_COST]):
        better = False
        for j in range(kept):
            if out[j, D_WEAR] <= all_of[i, D_WEAR] * (1.0 + SAME) and out[j, D_RISE] <= all_of[i, D_RISE] + 1.0:
                better = True
                break
        if not better:
            out[kept] = all_of[i]
            kept += 1
    return kept


@njit(**INLINE)
def _between(value: np.ndarray, wear: float, rise: float) -> float:
    """A grid (wears, rises) at a wear and a rise in K."""
    x = min(max(wear / (WEARS[1] - WEARS[0]), 0.0), WEARS.size - 1.000001)
    y = min(max(rise / (RISES[1] - RISES[0]), 0.0), RISES.size - 1.000001)
    i, j = int(x), int(y)
    u, v = x - i, y - j
    low = value[i, j] * (1.0 - u) + value[i + 1, j] * u
    return low * (1.0 - v) + (value[i, j + 1] * (1.0 - u) + value[i + 1, j + 1] * u) * v


@njit(**KERNEL)
def solve(ph: Physics, settings: np.ndarray, first_bit: int, changes: bool) -> np.ndarray:
    """The least cost in EUR from every state to the bottom, without the present bit's price.

    Args:
        ph: The physics of the hole.
        settings: (n, 3) those to choose from.
        first_bit: Number of the present bit.
        changes: Whether bits may be changed; else each is drilled with until it breaks.

    Returns:
        (BITS + 1, DEPTHS + 1, wears, rises), bits counted from ``first_bit``; the last row of bits is NEVER.
    """
    nw, nt = WEARS.size, RISES.size
    value = np.zeros((BITS + 1, DEPTHS + 1, nw, nt))
    value[BITS] = NEVER
    dz = ph.depth / DEPTHS
    options, counts = np.empty((nw, settings.shape[0], 4)), np.zeros(nw, dtype=np.int64)
    layer = -1
    for z in range(DEPTHS - 1, -1, -1):
        here = 0
        while (z + 0.5) * dz >= ph.layers[here, LAYER_END]:
            here += 1
        if here != layer:
            layer = here
            for iw in range(nw):
                counts[iw] = choices(ph, layer, WEARS[iw], settings, options[iw])
        for k in range(BITS - 1, -1, -1):
            strength = ph.strengths[(first_bit + k) % MOST_BITS]
            taken = ph.costs[CHANGE_TIME] if changes else ph.costs[FISHING_TIME]
            change = ph.costs[BIT_PRICE] + ph.costs[RIG_RATE] * taken + value[k + 1, z, 0, 0]
            for iw in range(nw):
                for it in range(nt):
                    best = change
                    for a in range(counts[iw] if WEARS[iw] < strength else 0):
                        row = options[iw, a]
                        wear = WEARS[iw] + row[D_WEAR] * dz
                        rise = shaker.rise_after(RISES[it], row[D_RISE], row[D_TIME] * dz)
                        if wear < strength and rise <= shaker.LIMIT:
                            best = min(best, row[D_COST] * dz + _between(value[k, z + 1], wear, rise))
                    value[k, z, iw, it] = best
    return value


@njit(**INLINE)
def cost_to_go(ph: Physics, value: np.ndarray, k: int, depth: float, wear: float, rise: float) -> float:
    """The value at a state between the points of the grid, 0 at the bottom."""
    x = min(depth / ph.depth * DEPTHS, DEPTHS - 1e-9)
    z = int(x)
    u = x - z
    return (1.0 - u) * _between(value[k, z], wear, rise) + u * _between(value[k, z + 1], wear, rise)


@njit(**KERNEL)
def rate_settings(ph: Physics, value, settings, k: int, bit: int, depth, wear, rise, step, wear_price):
    """What each setting costs, held for one step of ``step`` s, and then as ``value`` says.

    With ``value`` of no rows the step alone counts: its cost less what it earns, breakage and trips included, and each
    unit of wear at ``wear_price`` in EUR.

    Returns:
        (n,) in EUR, inf for settings that make no progress.
    """
    room, costs = np.empty(FEATURES), np.full(settings.shape[0], np.inf)
    layer = 0
    while depth >= ph.layers[layer, LAYER_END]:
        layer += 1
    for i in range(settings.shape[0]):
        rate, worn, final, cost, _peak = drilled(ph, layer, wear, settings[i], room)
        if rate * 1e3 <= SLOWEST:
            continue
        duration = min(step, (ph.depth - depth) / rate)
        spent, then = cost * duration, depth + rate * duration
        worn_then, rise_then, bit_then = wear + worn * duration, shaker.rise_after(rise, final, duration), k
        if rise_then > shaker.LIMIT:
            spent += ph.costs[RIG_RATE] * shaker.TRIP_TIME
            rise_then = shaker.rise_after(rise_then, 0.0, shaker.TRIP_TIME)
        if worn_then >= ph.strengths[bit % MOST_BITS]:
            spent += ph.costs[RIG_RATE] * ph.costs[FISHING_TIME] + ph.costs[BIT_PRICE]
            worn_then, rise_then, bit_then = 0.0, 0.0, k + 1
        if value.shape[0] == 0:
            spent += wear_price * worn * duration - ph.costs[METRE] * rate * duration
        elif then < ph.depth * (1.0 - 1e-12):
            spent += cost_to_go(ph, value, bit_then, then, worn_then, rise_then)
        costs[i] = spent
    return costs
