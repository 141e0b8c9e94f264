"""How fast the exact engine is, against peers, on one core: ``python -m benchmarks.speed`` prints JSON.

500 periods from the fresh start on rock 4 at 0.45 V and 1 bar, at 120 Hz (one impact a period) and at 50 Hz (four).
Every contestant simulates the same numbers; what it compiles or prepares once is left out of its time. The contestants
take turns, round by round. Times are processor times, so that other work on the machine counts little; they and their
ratios are medians over the rounds. Each one's error is the distance of the two masses, at the end of its run, from
heyoka in the best precision that the machine offers.
"""

from __future__ import annotations

import os

os.environ["NUMBA_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import json
import math
import platform
import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.peers import Motion, Problem, rk4_rig, scipy_rig
from benchmarks.peers.heyoka_rig import HeyokaRig
from drillenv.dynamics import exact
from drillenv.dynamics.flow import make_model
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

PERIODS = 500
SCIPY_PERIODS = 25
ROCK = ROCKS[4]
SETTINGS = {"120 Hz": Setting(120.0, 0.45, 1.0), "50 Hz": Setting(50.0, 0.45, 1.0)}
SHORTEST = 0.02
"""One timing repeats a run until this many seconds have passed."""


class Contestant(NamedTuple):
    """Something to race."""

    run: Callable[[], object]
    """What is timed: one whole simulation."""
    place: Callable[[object], tuple[float, float]]
    """X1 and X2 in m at the end, from what ``run`` returned."""
    periods: int


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description="Race the exact engine.")
    parser.add_argument("--rounds", type=int, default=9, help="timings of each contestant (default 9)")
    rounds = max(1, parser.parse_args().rounds)
    print(json.dumps(measure(rounds), indent=2))


def measure(rounds: int) -> dict:
    """Race all contestants at all settings."""
    extended = np.finfo(np.longdouble).nmant == 63
    best, taylor = HeyokaRig(extended=extended), HeyokaRig(1e-15)
    result: dict = {
        "what": f"{PERIODS} periods from the fresh start, {ROCK.name}, 0.45 V, 1 bar, one core",
        "processor": _processor(),
        "rounds": rounds,
        "reference": "heyoka, 80-bit floating point" if extended else "heyoka, double precision",
        "settings": {},
    }
    for name, setting in SETTINGS.items():
        problem = problem_of(setting)
        racers = contestants(setting, problem, taylor)
        reference = best.run(problem, PERIODS)
        result["settings"][name] = _race(racers, reference, rounds)
    return result


def contestants(setting: Setting, problem: Problem, taylor: HeyokaRig) -> dict[str, Contestant]:
    """All there are, warmed up."""
    racers = {
        "exact engine": exact_engine(setting),
        "heyoka, tolerance 1e-15": Contestant(lambda: taylor.run(problem, PERIODS, every=PERIODS), _end, PERIODS),
        "numba RK4, 1000 steps a period": Contestant(lambda: rk4_rig.simulate(problem, PERIODS), _end, PERIODS),
        "scipy RK45, rtol 1e-8, events": Contestant(
            lambda: scipy_rig.simulate_plainly(problem, SCIPY_PERIODS), _end, SCIPY_PERIODS
        ),
    }
    for racer in racers.values():
        racer.run()
    return racers


# ---- The one place that knows the exact engine's inside ------------------------------------------------------------
def exact_engine(setting: Setting) -> Contestant:
    """The bare kernel: a fresh state, and ``run_periods`` on it."""
    rig = Rig()
    model = make_model(rig, ROCK, setting)
    state, tally = np.zeros(exact.STATE_SIZE), np.zeros(exact.TALLY_SIZE)

    def run() -> np.ndarray:
        exact.fresh_state(model, 0.0, state)
        tally[:] = 0.0
        exact.run_periods(model, state, PERIODS, tally)
        return state

    def place(end) -> tuple[float, float]:
        x2 = end[exact.ORIGIN] + end[exact.W]
        return x2 + end[exact.Y], x2

    return Contestant(run, place, PERIODS)


# --------------------------------------------------------------------------------------------------------------------


def problem_of(setting: Setting) -> Problem:
    """The same numbers for the peers."""
    rig = Rig()
    return Problem(
        rig.shaker_mass,
        rig.indenter_mass,
        rig.stiffness,
        rig.damping,
        ROCK.loading_stiffness,
        ROCK.unloading_stiffness,
        setting.frequency,
        rig.drive_force(setting),
        rig.static_force(setting),
    )


def _race(racers: dict[str, Contestant], reference: Motion, rounds: int) -> dict:
    times: dict[str, list[float]] = {name: [] for name in racers}
    for _ in range(rounds):
        for name, racer in racers.items():
            times[name].append(_time(racer.run) * PERIODS / racer.periods)
    entries = {}
    medians = {name: statistics.median(values) for name, values in times.items()}
    base = times["exact engine"]
    for name, racer in racers.items():
        x1, x2 = racer.place(racer.run())
        error = math.hypot(x1 - reference.x1[racer.periods], x2 - reference.x2[racer.periods])
        ratio = statistics.median(one / other for one, other in zip(times[name], base, strict=True))
        entry = {
            "ms": round(1e3 * medians[name], 4),
            "us_per_period": round(1e6 * medians[name] / PERIODS, 3),
            "ratio_to_exact": float(f"{ratio:.3g}"),
            "ms_fastest_and_slowest": [round(1e3 * min(times[name]), 4), round(1e3 * max(times[name]), 4)],
            "position_error_m": float(f"{error:.2e}"),
        }
        if racer.periods != PERIODS:
            entry["note"] = (
                f"ran {racer.periods} periods, its time is scaled by {PERIODS / racer.periods:g}; "
                f"its error is that after {racer.periods} periods"
            )
        entries[name] = entry
    return entries


def _time(run: Callable[[], object]) -> float:
    """Seconds of processor time a run: what else the machine does is left out."""
    runs = 0
    start = time.process_time()
    while True:
        run()
        runs += 1
        passed = time.process_time() - start
        if passed >= SHORTEST:
            return passed / runs


def _end(motion) -> tuple[float, float]:
    return float(motion.x1[-1]), float(motion.x2[-1])


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
