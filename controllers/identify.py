"""Experiments on the rig that give the linear model behind the scheduled controller.

On each of a row of rocks, at settings that give single blows at the rating, amplitude and valve are switched between
two levels at random, independently (a pseudo-random binary sequence each), on two dozen rigs with noisy sensors. What
the sensors read is all that is used. Fitted by least squares:

    pressure:  p(k+1) = fall p(k) + (1 - fall) valve(k),        fall = exp(-interval / lag), for each rig
    force:     F(k) = force_pressure P(k) + force_amplitude A(k) + constant
    rate:      R(k) = rate_pressure P(k) + rate_amplitude A(k) + constant

with P the mean pressure of the interval. Within an interval the blows have settled: a first-order term in F is tried
and reported as ``memory``, and comes out small. With the linear rock law forces grow with the drive, so that

    force_pressure p + force_amplitude A = F

(Euler's theorem for a homogeneous function); the experiments do not assume it, so it checks them.

    python -m drillenv.controllers.identify

writes ``controllers/plant_models/linear.json`` anew (half a minute on two cores).
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.controllers.chart import FREQUENCY, RATIOS, read_chart
from drillenv.controllers.estimate import AMPLITUDE, GAUGE, MEAN_PEAK, RATE, VALVE, Cylinder
from drillenv.env.task import action_for
from drillenv.env.vector import DrillVectorEnv
from drillenv.files import whole
from drillenv.rig import AMPLITUDE_RANGE

FILE = Path(__file__).parent / "plant_models" / "linear.json"
LOADING = np.array([7e6, 9e6, 12e6, 16e6, 22e6, 30e6, 36e6, 44e6])
"""Loading stiffnesses in N/m."""
HARDENING = 1.17
"""Unloading over loading stiffness: the middle of Table 2.2."""
SHARES = (0.70, 0.84)
"""Pressure over amplitude at which experiments are made, as shares of where P-1-I-1 ends."""
RATING = 2.0
"""Force in kN at which they are made."""
RIGS, SETTLE, INTERVALS = 24, 24, 120
SWING = {"amplitude": (0.03, 3), "valve": (0.06, 5)}
"""Relative size of the switching, and the intervals between its chances to switch."""


def operating_point(loading: float, share: float) -> tuple[float, float]:
    """Amplitude in V and pressure in bar with single blows of RATING, at a share of the boundary of P-1-I-1."""
    chart = read_chart()
    rock = np.array([loading]), np.array([HARDENING])
    ratio = share * float(chart.boundary_of(*rock)[0])
    peak = 1e-3 * float(np.interp(ratio, RATIOS, chart.features_of(*rock)[1, :, 0]))
    # room on both sides for the switching
    room = 1.0 + 1.01 * SWING["amplitude"][0]
    amplitude = float(np.clip(RATING / peak, AMPLITUDE_RANGE[0] * room, AMPLITUDE_RANGE[1] / room))
    return amplitude, ratio * amplitude


def switching(rng: np.random.Generator, middle: float, size: float, every: int) -> np.ndarray:
    """(SETTLE + INTERVALS, RIGS) a binary sequence about ``middle``, which it has while the rig settles."""
    signs = rng.choice((-1.0, 1.0), (-(-INTERVALS // every), RIGS))
    course = np.repeat(signs, every, axis=0)[:INTERVALS]
    return middle * (1.0 + size * np.vstack([np.zeros((SETTLE, RIGS)), course]))


def experiment(loading: float, amplitude: float, pressure: float, seed: int) -> np.ndarray:
    """(SETTLE + INTERVALS, RIGS, readings) what the sensors read while amplitude and valve are switched."""
    rng = np.random.default_rng(seed)
    rock = {"loading_stiffness": loading, "unloading_stiffness": HARDENING * loading}
    envs = DrillVectorEnv(RIGS, kind="rock", rock=rock)
    envs.reset(seed=seed)
    amplitudes = switching(rng, amplitude, *SWING["amplitude"])
    valves = switching(rng, pressure, *SWING["valve"])
    seen = []
    for row, other in zip(amplitudes, valves, strict=True):
        actions = np.stack([action_for(FREQUENCY, *pair) for pair in zip(row, other, strict=True)])
        seen.append(envs.step(actions)[0])
    envs.close()
    return np.array(seen, dtype=float)


def fit(seen: np.ndarray) -> dict[str, Any]:
    """The linear model of one experiment, and how well it holds on the half of it that it was not fitted to."""
    means, lags = mean_pressures(seen)
    force, rate, amplitude = (seen[SETTLE:, :, i] for i in (MEAN_PEAK, RATE, AMPLITUDE))
    pressure = means[SETTLE:]
    half = RIGS // 2
    columns = np.stack([pressure, amplitude, np.ones_like(pressure)], axis=-1)

    def solved(target: np.ndarray, table: np.ndarray, rigs: slice) -> np.ndarray:
        rows = table[:, rigs].reshape(-1, table.shape[-1])
        return np.linalg.lstsq(rows, target[:, rigs].reshape(-1), rcond=None)[0]

    trial = solved(force, columns, slice(half))
    left = force[:, half:] - columns[:, half:] @ trial
    later = np.concatenate([columns[1:], force[:-1, :, None]], axis=-1)
    on_force, on_rate = solved(force, columns, slice(None)), solved(rate, columns, slice(None))
    point = [float(x.mean()) for x in (amplitude, pressure, force, rate)]
    return {
        "amplitude": point[0],
        "pressure": point[1],
        "force": point[2],
        "rate": point[3],
        "force_pressure": float(on_force[0]),
        "force_amplitude": float(on_force[1]),
        "rate_pressure": float(on_rate[0]),
        "rate_amplitude": float(on_rate[1]),
        "memory": float(solved(force[1:], later, slice(None))[3]),
        "euler": float((on_force[0] * point[1] + on_force[1] * point[0]) / point[2]),
        "residual": float(left.std()),
        "fit": float(1.0 - left.std() / force[:, half:].std()),
        "lags": [round(lag, 3) for lag in lags],
    }


def mean_pressures(seen: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """The mean pressure of every interval, as ``seen`` without its last axis, and the lag of every rig in s."""
    means, lags = np.empty(seen.shape[:2]), []
    for i in range(seen.shape[1]):
        cylinder = Cylinder()
        for k in range(seen.shape[0]):
            cylinder.update(seen[k, i, VALVE], seen[k, i, GAUGE])
            means[k, i] = cylinder.mean
        lags.append(cylinder.lag)
    return means, lags


def main() -> None:
    """Make the experiments and write the models."""
    rows = []
    for number, loading in enumerate(LOADING):
        for share in SHARES:
            amplitude, pressure = operating_point(float(loading), share)
            found = fit(experiment(float(loading), amplitude, pressure, seed=number))
            rows.append({"loading": float(loading), "share": share} | rounded(found))
    with whole(FILE) as part:
        part.write_text(json.dumps({"hardening": HARDENING, "models": rows}, indent=1) + "\n", encoding="utf-8")


def rounded(record: dict[str, Any]) -> dict[str, Any]:
    """Numbers with six figures, so that the file does not change with the last bit."""
    return {
        key: value if isinstance(value, list) or value == 0 or not math.isfinite(value) else float(f"{value:.6g}")
        for key, value in record.items()
    }


if __name__ == "__main__":
    main()
