"""A chart of the settled motion: what the sensors read on a rock of known stiffness, by pressure over amplitude.

With the linear rock law forces and lengths grow with the drive, so that at a frequency only the ratio of pressure to
amplitude decides on the motion, and the forces at 1 V stand for those at any amplitude. The chart is computed once, on
the plant without noise, at the one frequency that the controllers drill at:

    python -m drillenv.controllers.chart

writes ``controllers/plant_models/chart.npz`` anew (two minutes on two cores).
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from drillenv.files import read_arrays

FREQUENCY = 120.0
"""Hz. Below it the same force makes less progress, on every rock."""
FILE = Path(__file__).parent / "plant_models" / "chart.npz"
LOADING = np.geomspace(3.5e6, 75e6, 36)
"""Loading stiffnesses in N/m: those of Table 2.2, and a factor of three beyond on both sides."""
HARDENING = np.array([1.02, 1.08, 1.15, 1.25, 1.4, 1.6])
"""Unloading over loading stiffness."""
RATIOS = np.concatenate([np.linspace(1.0, 1.9, 16), np.linspace(1.94, 3.46, 39), np.linspace(3.6, 6.0, 13)])
"""Pressure over amplitude in bar/V, as far as the ranges of Table 2.1 reach."""
SETTLE, KEEP = 8, 4
"""Intervals to settle at each ratio, and to average over."""
TOP = 3.4
"""bar/V. On rocks so soft that P-1-I-1 goes on above it, the blows only weaken there."""
FEATURES = ("mean_peak", "largest_peak", "impacts", "contact_share", "single_share")
"""In N at 1 V, N at 1 V, 1, 1 and 1."""


class Chart(NamedTuple):
    """Readings of the settled motion over (RATIOS, LOADING, HARDENING), and how far up P-1-I-1 reaches."""

    features: np.ndarray
    """(len(FEATURES), ratios, loadings, hardenings)."""
    boundary: np.ndarray
    """(loadings, hardenings) in bar/V: P-1-I-1 is reached from either side below this ratio."""

    def features_of(self, loading: np.ndarray, hardening: np.ndarray) -> np.ndarray:
        """(len(FEATURES), ratios, n) for n rocks, interpolated."""
        spread = np.moveaxis(self.features, (2, 3), (0, 1))
        return np.moveaxis(_between(spread, loading, hardening), 0, -1)

    def boundary_of(self, loading: np.ndarray, hardening: np.ndarray) -> np.ndarray:
        """(n,) bar/V for n rocks, interpolated."""
        return _between(self.boundary, loading, hardening)


def _between(table: np.ndarray, loading: np.ndarray, hardening: np.ndarray) -> np.ndarray:
    """A table over (LOADING, HARDENING, ...) at n rocks, those beyond it at its edge."""
    x = np.log(np.clip(loading, LOADING[0], LOADING[-1]))
    y = np.clip(hardening, HARDENING[0], HARDENING[-1])
    return RegularGridInterpolator((np.log(LOADING), HARDENING), table)(np.column_stack([x, y]))


@cache
def read_chart() -> Chart:
    """The chart as it was computed.

    Raises:
        InputError: the file is missing or is another one.
    """
    shape = (len(FEATURES), RATIOS.size, LOADING.size, HARDENING.size)
    shapes = {"features": shape, "boundary": shape[2:]}
    return Chart(**read_arrays(FILE, "chart", shapes, "drillenv.controllers.chart"))


def compute_chart() -> Chart:
    """Every rock of the chart, taken up and down through the ratios on the plant itself."""
    from drillenv.dynamics.survey import allowed_cores
    from drillenv.env.batch import Batch
    from drillenv.env.episodes import Episode, rig_array
    from drillenv.env.observation import SIZE
    from drillenv.env.task import Task, action_for
    from drillenv.env.truth import TRUTH
    from drillenv.rig import Rig

    rocks = [(kl, kl * share) for kl in LOADING for share in HARDENING]
    batch = Batch(Task(kind="rock"), len(rocks), 0, allowed_cores())
    for i, (loading, unloading) in enumerate(rocks):
        # a cylinder that fills at once, and a face that does not stiffen
        batch.load(i, Episode(np.array([[loading, unloading, math.inf, 0.0]]), 1e-3, 1, 0.0, rig_array(Rig())))
    everywhere, silence = np.ones(len(rocks), dtype=bool), np.zeros((len(rocks), SIZE))
    names = ("mean_peak_force", "largest_peak_force", "impacts_per_cycle", "contact_share", "single_share")
    columns = [TRUTH.index(name) for name in names]

    def settled(ratio: float) -> np.ndarray:
        amplitude = min(0.6, 1.8 / ratio)
        action = np.tile(action_for(FREQUENCY, amplitude, ratio * amplitude), (len(rocks), 1))
        seen = np.zeros((len(rocks), len(FEATURES)))
        for interval in range(SETTLE + KEEP):
            batch.step(everywhere, action, False, silence)
            if interval >= SETTLE:
                seen += batch.truths[:, columns] / KEEP
        seen[:, :2] /= amplitude
        return seen

    for _ in range(SETTLE):
        settled(RATIOS[0])
    shape = (RATIOS.size, LOADING.size, HARDENING.size, len(FEATURES))
    upward = np.array([settled(ratio) for ratio in RATIOS]).reshape(shape)
    downward = np.array([settled(ratio) for ratio in RATIOS[::-1]])[::-1].reshape(shape)
    alone = np.minimum(upward[..., -1], downward[..., -1]) > 0.95
    ends = np.where(alone.all(axis=0), RATIOS.size - 1, np.argmin(alone, axis=0))
    batch.close()
    return Chart(np.moveaxis(upward, -1, 0), np.minimum(TOP, 0.5 * (RATIOS[ends - 1] + RATIOS[ends])))


def main() -> None:
    """Compute the chart and write it."""
    from drillenv.files import whole

    chart = compute_chart()
    with whole(FILE) as part:
        np.savez_compressed(part, features=chart.features.astype(np.float32), boundary=chart.boundary)


if __name__ == "__main__":
    main()
