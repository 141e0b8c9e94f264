"""Design of the scheduled controller: LQI on the identified models, its margins, and how it answers a step.

The model (see :mod:`drillenv.controllers.identify`), for one interval k of length T, with the pressure p at its start:

    p(k+1) = fall p(k) + (1 - fall) v(k)                  fall = exp(-T / lag)
    F(k)   = g_p (c p(k) + (1 - c) v(k)) + g_A A(k)       c = (1 - fall) lag / T

Two things are to be held: the force F at its target, and the pressure at ``ratio`` times the amplitude, just below
where P-1-I-1 ends. Both get an integrator by designing for the increments of valve and amplitude. With the state

    z(k) = [p(k) - p(k-1),  F(k-1) - target,  p(k) - ratio A(k-1)]      u(k) = [v(k) - v(k-1), A(k) - A(k-1)]

the discrete Riccati equation gives u = -K z (``control.dlqr``). The valve and the amplitude that were really set are
the only memory, so that nothing winds up while they are at an end of their range.

    python -m drillenv.controllers.design

writes the gains to ``controllers/plant_models/scheduled.json`` and the report to ``docs/controllers/``.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import control as python_control
import numpy as np
from control import StateSpace

from drillenv.controllers import identify
from drillenv.controllers.chart import FREQUENCY, read_chart
from drillenv.controllers.scheduled import FILE, SHARE, TARGET, Scheduled
from drillenv.env.batch import Batch
from drillenv.env.episodes import Episode, one_rock, rig_array
from drillenv.env.observation import SIZE
from drillenv.env.plant import INTERVAL
from drillenv.env.task import RANGES, Task, action_for
from drillenv.env.truth import T_MEAN, T_PRESSURE
from drillenv.env.vector import DrillVectorEnv
from drillenv.files import whole
from drillenv.rig import Rig
from drillenv.rocks import Rock

control = cast(Any, python_control)
"""Its annotations know neither arrays nor what its functions return."""
DOCS = Path(__file__).resolve().parents[1] / "docs" / "controllers"
LAGS = np.array([0.25, 0.4, 0.6, 0.8, 1.1])
"""Lags of the cylinder in s for which gains are computed."""
SLIP = {"force": 0.08, "ratio": 0.2}
"""Errors in kN and bar that cost as much as the increments of STEP do."""
STEP = {"valve": 0.06, "amplitude": 0.03}
"""bar and V an interval."""
STEP_ROCKS, STEP_LAG = (9e6, 16e6, 30e6), 0.6
"""N/m and s of the step responses in the report."""
SHOWN, SHOWN_STEPS = 2, 140
"""The episode of the validation set in the report, and how many of its steps."""
SETTLE = 24
"""Intervals that the plant settles before a step."""
FREQUENCIES = np.geomspace(0.03, math.pi / INTERVAL, 400)
"""rad/s, up to Nyquist's."""


def ss(A: Any, B: Any, C: Any, D: Any) -> StateSpace:
    """A system that takes a step each interval."""
    return control.ss(A, B, C, D, INTERVAL)


@dataclass(frozen=True, slots=True)
class Model:
    """The identified model at a rock and a lag."""

    loading: float
    """N/m."""
    ratio: float
    """bar/V to hold."""
    force_pressure: float
    """kN/bar."""
    force_amplitude: float
    """kN/V."""
    lag: float
    """s."""

    @property
    def fall(self) -> float:
        """What is left of a difference of pressure after an interval."""
        return math.exp(-INTERVAL / self.lag)

    @property
    def early(self) -> float:
        """Weight of the pressure at its start in the mean pressure of an interval."""
        return (1.0 - self.fall) * self.lag / INTERVAL

    def increments(self) -> tuple[np.ndarray, np.ndarray]:
        """A (3, 3) and B (3, 2) of z."""
        fall, early, gain, drive = self.fall, self.early, self.force_pressure, self.force_amplitude
        A = np.array([[fall, 0.0, 0.0], [gain * early, 1.0, 0.0], [fall, 0.0, 1.0]])
        B = np.array([[1.0 - fall, 0.0], [gain * (1.0 - early), drive], [1.0 - fall, -self.ratio]])
        return A, B

    def plant(self) -> StateSpace:
        """From valve and amplitude to what is measured after the interval: force and pressure."""
        A = np.array([[self.fall, 0.0], [self.force_pressure * self.early, 0.0]])
        B = np.array(
            [[1.0 - self.fall, 0.0], [self.force_pressure * (1.0 - self.early), self.force_amplitude]],
        )
        return ss(A, B, [[0.0, 1.0], [1.0, 0.0]], np.zeros((2, 2)))


def models(lag: float) -> list[Model]:
    """The identified models nearest to where the controller works, softest rock first."""
    record = json.loads(identify.FILE.read_text(encoding="utf-8"))
    chosen = min({row["share"] for row in record["models"]}, key=lambda share: abs(share - SHARE))
    rows = [row for row in record["models"] if row["share"] == chosen]
    loading = np.array([row["loading"] for row in rows])
    ends = read_chart().boundary_of(loading, np.full(loading.size, record["hardening"]))
    return [
        Model(row["loading"], SHARE * float(end), row["force_pressure"], row["force_amplitude"], lag)
        for row, end in zip(rows, ends, strict=True)
    ]


def gain(model: Model) -> np.ndarray:
    """(2, 3) K of u = -K z."""
    Q = np.diag([0.0, 1.0 / SLIP["force"] ** 2, 1.0 / SLIP["ratio"] ** 2])
    R = np.diag([1.0 / STEP["valve"] ** 2, 1.0 / STEP["amplitude"] ** 2])
    K, _, _ = control.dlqr(*model.increments(), Q, R)
    return np.asarray(K)


def controller(K: np.ndarray, ratio: float) -> StateSpace:
    """From force less its target and pressure, as measured, to valve and amplitude."""
    # memory: valve, amplitude, last pressure; z = from_memory memory + from_measured measured
    from_memory = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, -ratio, 0.0]])
    from_measured = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    C = np.hstack([np.eye(2), np.zeros((2, 1))]) - K @ from_memory
    D = -K @ from_measured
    A = np.vstack([C, np.zeros((1, 3))])
    B = np.vstack([D, [[0.0, 1.0]]])
    return ss(A, B, C, D)


def one_loop(loops: StateSpace, i: int) -> StateSpace:
    """The loop through channel i of (2, 2) loops, the other one closed; from positive feedback to negative."""
    j = 1 - i
    inner = control.feedback(ss([], [], [], [[1.0]]), loops[j, j], sign=1)
    return -(loops[i, i] + loops[i, j] * inner * loops[j, i])


def loops_of(plant: StateSpace, law: StateSpace) -> tuple[StateSpace, StateSpace, StateSpace]:
    """The loops through valve, amplitude and force sensor, each with everything else closed."""
    at_input, at_output = law * plant, plant * law
    return one_loop(at_input, 0), one_loop(at_input, 1), one_loop(at_output, 0)


def margins(model: Model, K: np.ndarray, ratio: float) -> dict[str, Any]:
    """Margins of the loops through valve, amplitude and force sensor, each with everything else closed.

    ``ratio`` is what the controller holds; the plant may be another than it was designed for. ``together`` is a lower
    bound of the disk margin for valve and amplitude changing at once, from the largest singular value; ``slowest`` the
    modulus of the slowest closed-loop pole.
    """
    plant, law = model.plant(), controller(K, ratio)
    loops = zip(("valve", "amplitude", "force"), loops_of(plant, law), strict=True)
    found: dict[str, Any] = {name: loop_margins(loop) for name, loop in loops}
    response = -control.frequency_response(law * plant, FREQUENCIES).frdata
    middle = 0.5 * np.eye(2)
    worst = max(np.linalg.norm(np.linalg.inv(np.eye(2) + each) - middle, 2) for each in np.moveaxis(response, -1, 0))
    found["together"] = float(1.0 / worst)
    found["slowest"] = float(np.abs(control.feedback(plant, law, sign=1).poles()).max())
    return found


def loop_margins(loop: StateSpace) -> dict[str, float | None]:
    """Gain margin as a factor, phase margin in degrees, crossover in rad/s and disk margin of a loop.

    From its frequency response: the loops have poles and zeros that cancel at 1, where polynomials lose their digits.
    The phase may reach -180 degrees at Nyquist's frequency only. None is a margin without end.
    """
    response = control.frequency_response(loop, FREQUENCIES)
    gain_margin, phase_margin, _, _, crossover, _ = control.stability_margins(response)
    at_end = float(response.frdata[0, 0, -1].real)
    if at_end < 0.0:
        gain_margin = min(float(gain_margin), -1.0 / at_end)
    disk, _, _ = control.disk_margins(loop, FREQUENCIES)
    found = {"gain": gain_margin, "phase": phase_margin, "crossover": crossover, "disk": disk}
    return {name: float(value) if np.isfinite(value) else None for name, value in found.items()}


def linear_step(model: Model, K: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(intervals, 2) force in kN and pressure in bar, as deviations, that the linear loop answers a target with."""
    around = model.plant() * controller(K, model.ratio)
    closed = -control.feedback(around, ss([], [], [], np.eye(2)), sign=1)
    inputs = np.vstack([target, np.zeros_like(target)])
    return control.forced_response(closed, inputs=inputs).outputs.T


def plant_step(model: Model, K: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(intervals, 4) force in kN, pressure in bar, amplitude in V and valve in bar on the plant itself, no noise.

    ``target`` are deviations from TARGET of the rating, in kN. The loop runs on the true pressure.
    """
    force = 1e-3 * TARGET * 2000.0
    rock = Rock(model.loading, identify.HARDENING * model.loading)
    episode = Episode(one_rock(rock, 0), model.lag, 1, 0.0, rig_array(Rig()))
    batch = Batch(Task(kind="rock"), 1, 0, threads=1)
    batch.load(0, episode)
    truth, one, silence = batch.truths[0], np.ones(1, dtype=bool), np.zeros((1, SIZE))
    amplitude, pressure = identify.operating_point(model.loading, SHARE)
    valve, course = pressure, []
    for interval in range(-SETTLE, target.size):
        before = truth[T_PRESSURE]
        batch.step(one, action_for(FREQUENCY, amplitude, valve)[None], False, silence)
        wanted = force + (target[interval] if interval >= 0 else 0.0)
        deviation = [
            truth[T_PRESSURE] - before,
            1e-3 * truth[T_MEAN] - wanted,
            truth[T_PRESSURE] - model.ratio * amplitude,
        ]
        course.append([1e-3 * truth[T_MEAN] - force, truth[T_PRESSURE], amplitude, valve])
        steps = -K @ np.array(deviation) if interval > -SETTLE + 8 else np.zeros(2)
        valve = float(np.clip(valve + steps[0], *RANGES[2]))
        amplitude = float(np.clip(amplitude + steps[1], *RANGES[1]))
    batch.close()
    return np.array(course)[SETTLE:]


def gains() -> dict[str, Any]:
    """The record that the controller reads."""
    return {
        "loading": [model.loading for model in models(float(LAGS[0]))],
        "lag": LAGS.tolist(),
        "gain": [[gain(model).round(6).tolist() for model in models(float(lag))] for lag in LAGS],
    }


def report() -> dict[str, Any]:
    """Margins at every rock and lag, with the plant as designed for and as it is where the estimate errs, and steps."""
    rows = []
    for lag in LAGS.tolist():
        known = models(lag)
        for number, model in enumerate(known):
            K = gain(model)
            rows.append({"loading": model.loading, "lag": lag, "case": "as designed"} | margins(model, K, model.ratio))
            for case, other in (("next softer", number - 1), ("next harder", number + 1)):
                if 0 <= other < len(known):
                    found = margins(known[other], K, model.ratio)
                    rows.append({"loading": model.loading, "lag": lag, "case": case} | found)
            slower = replace(model, lag=1.3 * lag)
            rows.append({"loading": model.loading, "lag": lag, "case": "slower"} | margins(slower, K, model.ratio))
    target = np.where(np.arange(32) >= 4, -0.1, 0.0)
    steps = []
    for loading in STEP_ROCKS:
        model = next(model for model in models(STEP_LAG) if model.loading == loading)
        linear, plant = linear_step(model, gain(model), target), plant_step(model, gain(model), target)
        steps.append(
            {"loading": loading, "target": target.tolist(), "linear": linear.tolist(), "plant": plant.tolist()}
        )
    identified = json.loads(identify.FILE.read_text(encoding="utf-8"))
    for row in identified["models"]:
        del row["lags"]
    return rounded(
        {
            "models": identified["models"],
            "margins": rows,
            "lag_of_steps": STEP_LAG,
            "steps": steps,
            "nyquist": nyquist(STEP_ROCKS[1], STEP_LAG),
            "episode": episode(),
        }
    )


def nyquist(loading: float, lag: float) -> dict[str, Any]:
    """The three loops of one design over FREQUENCIES, as real and imaginary parts."""
    model = next(model for model in models(lag) if model.loading == loading)
    plant, law = model.plant(), controller(gain(model), model.ratio)
    loops = {
        "valve": one_loop(law * plant, 0),
        "amplitude": one_loop(law * plant, 1),
        "force": one_loop(plant * law, 0),
    }
    found = {name: control.frequency_response(loop, FREQUENCIES).frdata[0, 0] for name, loop in loops.items()}
    parts = {name: {"real": each.real.tolist(), "imaginary": each.imag.tolist()} for name, each in found.items()}
    return {"loading": loading, "lag": lag, "loops": parts}


def episode() -> dict[str, Any]:
    """What the controller does in an episode of the validation set, noise included, and what it thinks."""
    scheduled = Scheduled()
    envs = DrillVectorEnv(1, kind="layers", scenario="validation", threads=1)
    observations, _ = envs.reset(seed=0, options={"episode": SHOWN})
    scheduled.reset(0)
    course: dict[str, list[float]] = {
        name: [] for name in ("force", "amplitude", "valve", "pressure", "true", "thought")
    }
    for _ in range(SHOWN_STEPS):
        observations, _, _, _, infos = envs.step(scheduled.act(observations[0], {})[None])
        course["force"].append(float(infos["largest_peak_force"][0]) * 1e-3)
        course["amplitude"].append(float(infos["amplitude"][0]))
        course["valve"].append(float(infos["valve_pressure"][0]))
        course["pressure"].append(float(infos["pressure"][0]))
        course["true"].append(float(infos["loading_stiffness"][0]))
        course["thought"].append(scheduled.stiffness)
    envs.close()
    return {"number": SHOWN, "course": course}


def rounded(value: Any) -> Any:
    """Five figures throughout, so that the record does not change with the last bit."""
    if isinstance(value, dict):
        return {key: rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value


def main() -> None:
    """Design, and write the gains and the report."""
    from drillenv.controllers.design_report import write_report

    with whole(FILE) as part:
        part.write_text(json.dumps(gains()) + "\n", encoding="utf-8")
    write_report(report(), DOCS)


if __name__ == "__main__":
    main()
