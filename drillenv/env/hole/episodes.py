"""A hole before it is drilled: its layers, the rig's frame, the strengths of the bits, and how they are drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drillenv.checks import InputError, number, shown
from drillenv.env.episodes import draw_rocks, read_layers, read_rig, rig_array, rig_record
from drillenv.env.hole.bit import ABRASIVITY_RANGE, draw_strengths
from drillenv.env.hole.shaker import RESONANCE_RANGE
from drillenv.env.plant import MOST_LAYERS
from drillenv.rig import Rig
from drillenv.rocks import ROCKS

DEPTH = 4.0
"""Depth of a hole in m."""
DEEPEST = 100.0
THICKNESS_RANGE = (0.3, 1.2)
"""Thickness of a layer in m."""
LEAST_HARDENING = 1.05
"""Unloading over loading stiffness: a rock with less gives nearly all of a blow back, and nothing drills it. Drawn with
the spread of Table 2.2, one to three in a hundred have less."""
MOST_BITS = 64
"""Strengths that an episode keeps; the bits after these begin with the first again."""
KEYS = ("depth", "layers", "resonance", "strengths", "phase")
"""What a record has; it may have a "rig" too, where that is not the paper's."""
LAYER_KL, LAYER_KU, LAYER_END, LAYER_ABRASIVITY = range(4)


@dataclass(frozen=True, slots=True)
class Hole:
    """What an episode is made of. Nothing in it is random any more, but for the noise of the sensors.

    Args:
        depth: To be reached, in m.
        layers: (m, 4) loading and unloading stiffness under a sharp bit in N/m, depth of the lower end in m (inf for
            the last), and abrasivity.
        resonance: Of the frame, in Hz.
        strengths: (MOST_BITS,) wear at which each bit breaks.
        phase: Of the excitation at the start, in rad.
        rig: (6,) m1, m2, k, c, drive and pressure gain.
    """

    depth: float
    layers: np.ndarray
    resonance: float
    strengths: np.ndarray
    phase: float
    rig: np.ndarray = field(default_factory=lambda: rig_array(Rig()))

    def as_record(self) -> dict[str, Any]:
        """The hole as JSON takes it: stiffnesses in MN/m, thicknesses in m."""
        tops = np.concatenate([[0.0], self.layers[:-1, LAYER_END]])
        thickness = self.layers[:, LAYER_END] - tops
        record = {
            "depth": round(self.depth, 4),
            "layers": [
                [round(kl / 1e6, 4), round(ku / 1e6, 4), round(m, 4) if math.isfinite(m) else None, round(abrasive, 4)]
                for (kl, ku, _end, abrasive), m in zip(self.layers.tolist(), thickness.tolist(), strict=True)
            ],
            "resonance": round(self.resonance, 3),
            "strengths": [round(each, 4) for each in self.strengths.tolist()],
            "phase": round(self.phase, 4),
        }
        return record if np.array_equal(self.rig, rig_array(Rig())) else {**record, "rig": rig_record(self.rig)}


def draw_hole(depth: float, rng: np.random.Generator) -> Hole:
    """A hole of a depth in m: neighbouring layers are of different cases of Table 2.2, with its measured spread."""
    ends = np.cumsum(rng.uniform(*THICKNESS_RANGE, MOST_LAYERS))
    m = min(int(np.searchsorted(ends, depth)) + 1, MOST_LAYERS)
    ends = ends[:m]
    ends[-1] = math.inf
    cases = (rng.integers(0, len(ROCKS)) + np.cumsum(rng.integers(1, len(ROCKS), m))) % len(ROCKS) + 1
    abrasivity = np.exp(rng.uniform(math.log(ABRASIVITY_RANGE[0]), math.log(ABRASIVITY_RANGE[1]), m))
    return Hole(
        depth=depth,
        layers=np.column_stack([_drillable(cases, rng), ends, abrasivity]),
        resonance=float(rng.uniform(*RESONANCE_RANGE)),
        strengths=draw_strengths(MOST_BITS, rng),
        phase=float(rng.uniform(0.0, 2 * math.pi)),
    )


def _drillable(cases: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(m, 2) stiffnesses of rocks of these cases, drawn again where they harden too little."""
    rocks = draw_rocks(cases, rng)
    while (soft := rocks[:, 1] < LEAST_HARDENING * rocks[:, 0]).any():
        rocks[soft] = draw_rocks(cases[soft], rng)
    return rocks


def read_hole(record: object, where: str) -> Hole:
    """The hole of a record as :meth:`Hole.as_record` makes it; ``where`` names it in messages.

    Raises:
        InputError: a key is missing or unknown, or a value is of the wrong kind or out of range.
    """
    if not isinstance(record, Mapping) or set(record) - {"rig"} != set(KEYS):
        raise InputError(
            f"{where} is {shown(record)}: give a record with {', '.join(KEYS)}, and rig where it is another"
        )
    strengths = record["strengths"]
    if not isinstance(strengths, list) or len(strengths) != MOST_BITS:
        raise InputError(f"{where}: strengths is {shown(strengths)}: give a list of {MOST_BITS} numbers")
    return Hole(
        depth=number(f"{where} depth", record["depth"], 0.05, DEEPEST, "m"),
        layers=read_layers(
            record["layers"],
            where,
            "thickness in m, abrasivity",
            lambda name, given: number(f"{name} thickness", given, 1e-3, 1e3, "m"),
            lambda name, given: number(f"{name} abrasivity", given, 0.0, 100.0),
        ),
        resonance=number(f"{where} resonance", record["resonance"], 1.0, 1e3, "Hz"),
        strengths=np.array([number(f"{where} strength", each, 1e-3, 1e3) for each in strengths]),
        phase=number(f"{where} phase", record["phase"], 0.0, 2 * math.pi, "rad") % (2 * math.pi),
        rig=read_rig(record["rig"], where) if "rig" in record else rig_array(Rig()),
    )
