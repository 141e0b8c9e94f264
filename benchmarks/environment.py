"""How many steps a second the environment makes, beside peers and its own kernel: ``python -m benchmarks.environment``.

Everything in one run: the contestants take turns, round by round, and figures are medians over the rounds. A step of
the drilling rig is 0.25 s of its exact motion, 12 to 30 blows; it costs what its kernel costs, and the question is what
the environment adds. The kernel is timed from compiled code, on the same rigs, rocks and actions as the environment,
without any Python in between. Times of one thread are processor times, so that other work on the machine counts
little. What two threads do is seen on the clock, and wants an idle machine; beside it stands what the processor times
come to on one: those of the calling thread, which nothing can share, and half of all others.

Peers: Gymnasium's Pendulum-v1 (vectorised by SyncVectorEnv, since it has no vector environment of its own) and, where
it is installed, gym-electric-motor's torque control of a permanent-magnet motor.
"""

from __future__ import annotations

import os

os.environ["NUMBA_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import statistics
import time
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numba import njit

import drillenv  # noqa: F401  registers the environments
from drillenv.dynamics.compiled import KERNEL
from drillenv.env.batch import Batch, step_rigs
from drillenv.env.observation import SIZE
from drillenv.env.vector import DrillVectorEnv

ID = "drillenv/DrillLayers-v0"
STEPS = 200
"""Steps of a scalar environment in a round."""
RIGS = 1024
VECTOR_STEPS = 2
"""Steps of a batch in a round."""
RESETS = 20
SEED = 3
BIT = "drillenv/DrillBit-v0"
HIDDEN, HIDDEN_RIGS, HIDDEN_STEPS = "drillenv/DrillHidden-v0", 16, 20
"""The rigs with effects beyond the paper's model, which the hybrid engine runs; each round draws others."""
ALLOWANCE, OVERHEAD, TWO_CORES, RESET_STEPS, HIDDEN_RATE, BIT_RATE = 1.25, 15.0, 1.7, 10.0, 3000.0, 0.8
"""Targets: a scalar step costs at most so many times the kernel and so many microseconds; two cores give so many times
the rate of one core's kernel; a reset takes no longer than so many steps; steps/s of rigs with effects on two cores;
rate of DrillBit over that of DrillLayers."""


class Contestant(NamedTuple):
    """Something to race."""

    prepare: Callable[[], object]
    """Done before each timing, and not timed."""
    run: Callable[[], object]
    steps: int
    """Steps (or resets) of one environment that ``run`` makes."""


class Times(NamedTuple):
    """Of one contestant, an entry a round: microseconds a step."""

    clock: list[float]
    processor: list[float]
    caller: list[float]
    """Of the processor, in the calling thread alone."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.environment", description="Race the environment.")
    parser.add_argument("--rounds", type=int, default=9, help="timings of each contestant (default 9)")
    rounds = max(1, parser.parse_args().rounds)
    racers = contestants()
    for racer in racers.values():
        racer.prepare()
        racer.run()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"{os.cpu_count()} cores, load {load:.1f} before the race, {rounds} rounds\n")
    report(race(racers, rounds))


def race(racers: dict[str, Contestant], rounds: int) -> dict[str, Times]:
    """Time all of them, in turns."""
    times = {name: Times([], [], []) for name in racers}
    for _ in range(rounds):
        for name, racer in racers.items():
            racer.prepare()
            before = time.perf_counter(), time.process_time(), time.thread_time()
            racer.run()
            after = time.perf_counter(), time.process_time(), time.thread_time()
            for kind, start, end in zip(times[name], before, after, strict=True):
                kind.append(1e6 * (end - start) / racer.steps)
    return times


# --- The contestants


def contestants() -> dict[str, Contestant]:
    """All there are; those of a group do the same work."""
    scalar, wrapped = gym.make(ID).unwrapped, gym.make(ID)
    actions = np.random.default_rng(SEED).uniform(-1, 1, (STEPS, 3)).astype(np.float32)
    many = np.random.default_rng(SEED).uniform(-1, 1, (VECTOR_STEPS, RIGS, 3)).astype(np.float32)
    one, two = (vector(threads) for threads in (1, 2))
    policy = Policy()
    pendulums = gym.make_vec("Pendulum-v1", RIGS, vectorization_mode="sync")
    return {
        "Pendulum-v1": stepped(gym.make("Pendulum-v1"), np.zeros((STEPS, 1), dtype=np.float32)),
        f"Pendulum-v1, {RIGS} in SyncVectorEnv": stepped(
            pendulums, np.zeros((VECTOR_STEPS, RIGS, 1), dtype=np.float32), RIGS
        ),
        **electric_motor(),
        "kernel alone, 1 rig": kernel(1, actions[:, None]),
        "DrillLayers, unwrapped": stepped(scalar, actions),
        "DrillLayers, gym.make": stepped(wrapped, actions),
        "DrillLayers, unwrapped, with a policy": steered(scalar, policy, STEPS, 1),
        f"kernel alone, {RIGS} rigs, 1 thread": kernel(RIGS, many),
        f"DrillLayers, {RIGS} rigs, 1 thread": stepped(one, many, RIGS),
        f"DrillLayers, {RIGS} rigs, 2 threads": stepped(two, many, RIGS),
        f"DrillLayers, {RIGS} rigs, 2 threads, with a policy": steered(two, policy, VECTOR_STEPS, RIGS),
        "DrillBit, unwrapped": stepped(gym.make(BIT).unwrapped, with_bit(actions)),
        f"DrillBit, {RIGS} rigs, 2 threads": stepped(
            gym.make_vec(BIT, RIGS, vectorization_mode="vector_entry_point", threads=2), with_bit(many), RIGS
        ),
        f"DrillHidden, {HIDDEN_RIGS} rigs, 2 threads": hidden(),
        "reset of DrillLayers": resets(scalar, RESETS, 1),
        f"reset of DrillLayers, {RIGS} rigs, 1 thread": resets(one, 1, RIGS),
    }


def with_bit(actions: np.ndarray) -> np.ndarray:
    """These actions for an environment whose bit may be changed, which they do not ask for."""
    return np.concatenate([actions, np.full((*actions.shape[:-1], 1), -1.0, dtype=np.float32)], axis=-1)


def vector(threads: int) -> DrillVectorEnv:
    made = gym.make_vec(ID, RIGS, vectorization_mode="vector_entry_point", threads=threads)
    assert isinstance(made, DrillVectorEnv)
    return made


def hidden() -> Contestant:
    """Rigs with effects, drawn anew before each round."""
    env = gym.make_vec(HIDDEN, HIDDEN_RIGS, vectorization_mode="vector_entry_point", threads=2)
    env.reset(seed=SEED)
    actions = np.random.default_rng(SEED).uniform(-1, 1, (HIDDEN_STEPS, HIDDEN_RIGS, 3)).astype(np.float32)
    return stepped(env, actions, HIDDEN_RIGS)._replace(prepare=env.reset)


def stepped(env: Any, actions: np.ndarray, n: int = 1) -> Contestant:
    """Steps with these actions from a fresh episode."""

    def run() -> None:
        for action in actions:
            env.step(action)

    return Contestant(lambda: env.reset(seed=SEED), run, len(actions) * n)


def steered(env: Any, policy: Policy, steps: int, n: int) -> Contestant:
    """Steps with a policy in the loop."""
    seen = env.reset(seed=SEED)[0]

    def run() -> None:
        observation = seen
        for _ in range(steps):
            observation = env.step(policy(observation))[0]

    return Contestant(lambda: env.reset(seed=SEED), run, steps * n)


def resets(env: Any, times: int, n: int) -> Contestant:
    """New episodes, drawn each time."""

    def run() -> None:
        for _ in range(times):
            env.reset()

    return Contestant(lambda: env.reset(seed=SEED), run, times * n)


class Policy:
    """A small network, 15-64-64-3 with tanh, in NumPy."""

    def __init__(self) -> None:
        rng = np.random.default_rng(SEED)
        sizes = (SIZE, 64, 64, 3)
        self.layers = [
            (
                rng.normal(0.0, 1.0 / np.sqrt(inward), (inward, outward)).astype(np.float32),
                np.zeros(outward, np.float32),
            )
            for inward, outward in pairwise(sizes)
        ]
        self.scale = np.float32(0.1)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Actions for one observation or for many."""
        values = observation * self.scale
        for weights, bias in self.layers:
            values = np.tanh(values @ weights + bias)
        return values


def electric_motor() -> dict[str, Contestant]:
    """gym-electric-motor, where it is installed; with its resets, since random voltages end its episodes."""
    try:
        import gym_electric_motor  # pyright: ignore[reportMissingImports]
    except ImportError:
        print("gym-electric-motor is not installed and left out: pip install gym-electric-motor\n")
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motor = gym_electric_motor.make("Cont-TC-PMSM-v0").unwrapped
    actions = np.random.default_rng(SEED).uniform(-1, 1, (STEPS, 3))

    def run() -> None:
        for action in actions:
            _seen, _reward, terminated, truncated, _info = motor.step(action)
            if terminated or truncated:
                motor.reset()

    return {"gym-electric-motor, Cont-TC-PMSM-v0": Contestant(lambda: motor.reset(seed=SEED), run, STEPS)}


# --- The one place that knows the inside: the kernel without the environment


@njit(**KERNEL)
def run_kernel(plants, which, actions, weights, noise, truths, seen, rewards, windows):
    """Steps of all rigs, with nothing between them."""
    for step in range(actions.shape[0]):
        step_rigs(
            plants, 0, which.size, which, actions[step], False, weights, noise, 1.0, truths, seen, rewards, windows
        )


def kernel(n: int, actions: np.ndarray) -> Contestant:
    """The rigs of an environment that was just reset, stepped by compiled code."""
    envs = gym.make_vec(ID, n, vectorization_mode="vector_entry_point")
    assert isinstance(envs, DrillVectorEnv)
    envs.reset(seed=SEED)
    batch: Batch = envs._batch
    kept = [part.copy() for part in batch.plants]
    which, noise = np.ones(n, dtype=bool), np.random.default_rng(SEED).standard_normal((n, SIZE))

    def prepare() -> None:
        for part, before in zip(batch.plants, kept, strict=True):
            part[:] = before

    def run() -> None:
        run_kernel(
            batch.plants,
            which,
            actions,
            batch.weights,
            noise,
            batch.truths,
            batch.readings,
            batch.rewards,
            batch.windows,
        )

    return Contestant(prepare, run, len(actions) * n)


# --- The report


def report(times: dict[str, Times]) -> None:
    """Print the table and the targets."""
    width = max(len(name) for name in times)
    print(f"{'':{width}}  steps/s     us a step (clock)   us a step (processor)")
    for name, (clock, processor, _caller) in times.items():
        middle = statistics.median(clock)
        print(f"{name:{width}}  {1e6 / middle:9,.0f}   {middle:9.2f}           {statistics.median(processor):9.2f}")
    base = statistics.median(times["kernel alone, 1 rig"].processor)
    step = statistics.median(times["DrillLayers, unwrapped"].processor)
    allowed = ALLOWANCE * base + OVERHEAD
    print(
        f"\nscalar step: {step:.1f} us; target {ALLOWANCE} x {base:.1f} + {OVERHEAD:.0f} = {allowed:.1f} us: ", end=""
    )
    print(said(step <= allowed))
    alone = times[f"kernel alone, {RIGS} rigs, 1 thread"]
    for name in (f"DrillLayers, {RIGS} rigs, 2 threads", f"DrillLayers, {RIGS} rigs, 2 threads, with a policy"):
        seen = ratios(alone.clock, times[name].clock)
        shared = [own + (all_of_it - own) / 2 for all_of_it, own in zip(*times[name][1:], strict=True)]
        print(
            f"{name}: {statistics.median(seen):.2f} times the kernel's rate on one thread"
            f" ({min(seen):.2f} to {max(seen):.2f}); by processor times"
            f" {statistics.median(ratios(alone.processor, shared)):.2f}; target {TWO_CORES}:"
            f" {said(statistics.median(seen) >= TWO_CORES)}"
        )
    name = f"DrillHidden, {HIDDEN_RIGS} rigs, 2 threads"
    clock = statistics.median(times[name].clock)
    shared = statistics.median(own + (all_of_it - own) / 2 for all_of_it, own in zip(*times[name][1:], strict=True))
    print(
        f"{name}: {1e6 / clock:,.0f} steps/s; by processor times {1e6 / shared:,.0f}; target {HIDDEN_RATE:,.0f}:"
        f" {said(1e6 / clock >= HIDDEN_RATE)}"
    )
    for form in ("unwrapped", f"{RIGS} rigs, 2 threads"):
        rate = statistics.median(ratios(times[f"DrillLayers, {form}"].processor, times[f"DrillBit, {form}"].processor))
        print(
            f"DrillBit, {form}: {rate:.2f} times the rate of DrillLayers; target {BIT_RATE}: {said(rate >= BIT_RATE)}"
        )
    for name, beside in (
        ("reset of DrillLayers", "DrillLayers, unwrapped"),
        (f"reset of DrillLayers, {RIGS} rigs, 1 thread", f"DrillLayers, {RIGS} rigs, 1 thread"),
    ):
        ratio = statistics.median(ratios(times[name].processor, times[beside].processor))
        print(f"{name}: {ratio:.2f} steps; target at most {RESET_STEPS:.0f}: {said(ratio <= RESET_STEPS)}")


def ratios(first: list[float], second: list[float]) -> list[float]:
    """Round by round."""
    return [one / other for one, other in zip(first, second, strict=True)]


def said(met: bool) -> str:
    return "met" if met else "not met"


if __name__ == "__main__":
    main()
