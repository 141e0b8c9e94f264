"""Many rigs stepped together: the one place that runs the plant, for scalar and vector environments alike.

A scalar environment is a batch of one and runs the same compiled kernel, so that both give the same numbers to the
last bit.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from drillenv.compiling import announce, helped
from drillenv.dynamics.compiled import KERNEL
from drillenv.dynamics.exact import THETA, TURN, TURNS, make_scratch
from drillenv.env import plant
from drillenv.env.core import info_of, infos_of
from drillenv.env.episodes import START, Episode
from drillenv.env.observation import SIZE, observe
from drillenv.env.plant import (
    FREQUENCY,
    PEAKS,
    PRESSURE,
    SUMS_SIZE,
    TRACE,
    VALVE,
    VOLTAGE,
    Plants,
    drill,
    make_plants,
    place,
)
from drillenv.env.reward import score
from drillenv.env.task import INCREMENTS, RANGES, Task
from drillenv.env.truth import MOST_CYCLES, TRUTH_SIZE, summarise

CHUNK = 16
"""Rigs that a thread takes at a time."""
_LOW, _HIGH = RANGES[:, 0].copy(), RANGES[:, 1].copy()
_RATING = 4
"""Where the rating stands among the weights of the reward."""


@njit(**KERNEL)
def set_from_action(action: np.ndarray, increment: bool, memory: np.ndarray, setting: np.ndarray) -> None:
    """The setting (3,) in Hz, V and bar that an action (3,) float32 asks for, inside the ranges of Table 2.1."""
    for j in range(3):
        push = float(min(max(action[j], np.float32(-1.0)), np.float32(1.0)))
        if increment:
            before = memory[FREQUENCY] if j == 0 else (memory[VOLTAGE] if j == 1 else memory[VALVE])
            value = before + push * INCREMENTS[j]
        else:
            value = 0.5 * (_LOW[j] + _HIGH[j]) + 0.5 * push * (_HIGH[j] - _LOW[j])
        setting[j] = min(max(value, _LOW[j]), _HIGH[j])


@njit(**KERNEL)
def finish(
    plants: Plants, i: int, turns: float, sums, peaks, cycles, weights, noise, strength, truths, seen, rewards
) -> None:
    """From what happened to rig i in an interval to its row of truth, its readings and its reward."""
    summarise(sums, peaks, turns, weights[_RATING], cycles, plants.layers[i], plants.memories[i], truths[i])
    observe(truths[i], noise[i], strength, seen[i])
    rewards[i] = score(truths[i], weights)


@njit(**KERNEL)
def step_rigs(
    plants: Plants, first, last, which, actions, increment, weights, noise, strength, truths, seen, rewards, windows
) -> None:
    """One interval of the rigs ``first`` to ``last`` of those marked in ``which``."""
    sums, peaks, cycles = np.empty(SUMS_SIZE), np.empty((PEAKS, 2)), np.empty((MOST_CYCLES, 3))
    setting, scratch = np.empty(3), make_scratch()
    for i in range(first, last):
        if not which[i]:
            continue
        set_from_action(actions[i], increment, plants.memories[i], setting)
        turns = plants.states[i, TURNS] + plants.states[i, THETA] / TURN
        drill(plants, i, setting, sums, peaks, windows[i], scratch)
        finish(plants, i, turns, sums, peaks, cycles, weights, noise, strength, truths, seen, rewards)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All of one rig that changes while it drills, and what it last reported."""

    arrays: tuple[np.ndarray, ...]
    truth: np.ndarray
    seen: np.ndarray
    reward: float
    hybrid: Any = None
    """The state of the hybrid engine, where the episode needs it."""


class Batch:
    """n rigs of a task.

    Attributes:
        truths: (n, TRUTH_SIZE) what truly happened in each rig's last interval.
        readings: (n, SIZE) float32, what its sensors say of it.
        rewards: (n,) in mm/s.
        windows: (n, samples, channels of plant.TRACE) where the task asks for windows, else (n, 0, channels).
        terminated: (n,) bool, whether the task of each rig has ended.
    """

    def __init__(self, task: Task, n: int, samples: int, threads: int):
        announce()
        self.task = task
        self.n = n
        self.plants: Plants = make_plants(n)
        self.truths: np.ndarray = np.zeros((n, TRUTH_SIZE))
        self.readings: np.ndarray = np.zeros((n, SIZE), dtype=np.float32)
        self.rewards: np.ndarray = np.zeros(n)
        self.windows: np.ndarray = np.zeros((n, samples, len(TRACE)))
        self.terminated: np.ndarray = np.zeros(n, dtype=bool)
        self.weights: np.ndarray = task.reward.as_array()
        self.hybrid: list[Any] = [None] * n
        self.threads: int = min(threads, -(-n // CHUNK))
        self.hybrid_threads: int = min(threads, n)
        """Threads for rigs on the hybrid engine, which take so long that each is a task of its own."""
        self._took = np.zeros(n)
        """Seconds that the last interval of each rig on the hybrid engine took: the longest begins, so that threads end
        together."""
        self._pool: ThreadPoolExecutor | None = None
        self._pool_of = 0
        """The process that the threads belong to."""

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """The arrays that change while the rigs drill, rig by rig along the first axis."""
        return self.plants

    def load(self, i: int, episode: Episode) -> None:
        """Put rig i at the start of an episode, at rest on fresh rock."""
        self.terminated[i] = False
        plants = self.plants
        plants.rigs[i] = episode.rig
        plants.layers[i, : len(episode.layers)] = episode.layers
        plants.layers[i, len(episode.layers) :] = episode.layers[-1]
        memory = plants.memories[i]
        memory[:] = 0.0
        memory[PRESSURE] = memory[VALVE] = START.pressure
        memory[FREQUENCY], memory[VOLTAGE] = START.frequency, START.amplitude
        memory[plant.LAG], memory[plant.BLOWS] = episode.lag, episode.blows
        # long ago, so that no impact takes the first one for its repetition
        memory[plant.LAST_TURNS] = -1e6
        self.hybrid[i] = None
        if not episode.effects:
            place(plants, i, episode.phase)
            return
        from drillenv.env.hybrid_plant import COMPILE_DRILL, HybridPlant

        with helped(COMPILE_DRILL) as wait:
            place(plants, i, episode.phase)
            self.hybrid[i] = HybridPlant(plants, i, episode.effects)
            wait()

    def step(self, which: np.ndarray, actions: np.ndarray, increment: bool, noise: np.ndarray) -> None:
        """One interval of the rigs marked in ``which`` (n,), at what ``actions`` (n, 3) float32 ask for.

        ``noise`` (n, SIZE) are standard normal numbers for the readings.
        """
        if any(self.hybrid):
            which = self._step_hybrid(which, actions, increment, noise)
            if not which.any():
                return
        if self.threads <= 1:
            self._step_rigs(0, self.n, which, actions, increment, noise)
            return
        pool = self._threads()
        work = [
            pool.submit(self._step_rigs, first, min(first + CHUNK, self.n), which, actions, increment, noise)
            for first in range(0, self.n, CHUNK)
        ]
        for part in work:
            part.result()

    def _step_rigs(self, first: int, last: int, which, actions, increment: bool, noise) -> None:
        """One interval of the rigs ``first`` to ``last`` of those marked."""
        results = (self.truths, self.readings, self.rewards, self.windows)
        weights, strength = self.weights, self.task.noise
        step_rigs(self.plants, first, last, which, actions, increment, weights, noise, strength, *results)

    def info(self, i: int) -> dict[str, Any]:
        """The truth about the last interval of rig i."""
        return info_of(self.truths[i], self.rewards[i], self.weights)

    def infos(self, which: np.ndarray) -> dict[str, Any]:
        """As ``info`` for the rigs marked in ``which`` (n,), in Gymnasium's form."""
        return infos_of(self.truths, self.rewards, self.weights, which)

    def _threads(self) -> ThreadPoolExecutor:
        if self._pool is None or self._pool_of != os.getpid():
            # a process that was forked has the pool but not its threads
            self._pool = ThreadPoolExecutor(max(self.threads, self.hybrid_threads), thread_name_prefix="drillenv")
            self._pool_of = os.getpid()
        return self._pool

    def _step_hybrid(self, which, actions, increment: bool, noise) -> np.ndarray:
        """Step the rigs that need the hybrid engine. Returns the marks of those that do not."""
        mine = [i for i in np.flatnonzero(which).tolist() if self.hybrid[i] is not None]
        rest = which.copy()
        rest[mine] = False
        if self.hybrid_threads <= 1 or len(mine) <= 1:
            for i in mine:
                self._step_one(i, actions, increment, noise)
            return rest
        mine.sort(key=lambda i: -self._took[i])
        pool = self._threads()
        for done in wait([pool.submit(self._step_one, i, actions, increment, noise) for i in mine]).done:
            done.result()
        return rest

    def _step_one(self, i: int, actions, increment: bool, noise) -> None:
        """One interval of a rig on the hybrid engine."""
        sums, peaks, cycles = np.empty(SUMS_SIZE), np.empty((PEAKS, 2)), np.empty((MOST_CYCLES, 3))
        plants, setting = self.plants, np.empty(3)
        set_from_action(actions[i], increment, plants.memories[i], setting)
        turns = plants.states[i, TURNS] + plants.states[i, THETA] / TURN
        begun = time.perf_counter()
        self.hybrid[i].drill(setting, sums, peaks, self.windows[i])
        self._took[i] = time.perf_counter() - begun
        results = (self.truths, self.readings, self.rewards)
        finish(plants, i, turns, sums, peaks, cycles, self.weights, noise, self.task.noise, *results)

    def snapshot(self, i: int) -> Snapshot:
        """Everything needed to go on exactly from here."""
        engine = self.hybrid[i]
        return Snapshot(
            tuple(part[i].copy() for part in self.parts),
            self.truths[i].copy(),
            self.readings[i].copy(),
            float(self.rewards[i]),
            None if engine is None else engine.snapshot(),
        )

    def restore(self, i: int, snapshot: Snapshot) -> None:
        """Put rig i where the snapshot was taken."""
        for part, kept in zip(self.parts, snapshot.arrays, strict=True):
            part[i] = kept
        self.truths[i], self.readings[i] = snapshot.truth, snapshot.seen
        self.rewards[i] = snapshot.reward
        self.hybrid[i] = None
        if snapshot.hybrid is not None:
            from drillenv.env.hybrid_plant import HybridPlant

            self.hybrid[i] = HybridPlant.restored(self.plants, i, snapshot.hybrid)

    def close(self) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pool": None}


def trace_of(before: Snapshot, setting: np.ndarray, samples: int) -> np.ndarray:
    """(samples, channels of plant.TRACE) the interval that began at ``before``, run again at a setting (3,)."""
    window = np.zeros((samples, len(TRACE)))
    sums, peaks = np.empty(SUMS_SIZE), np.empty((PEAKS, 2))
    plants = Plants(*(part[None].copy() for part in before.arrays))
    if before.hybrid is not None:
        from drillenv.env.hybrid_plant import HybridPlant

        HybridPlant.restored(plants, 0, before.hybrid).drill(setting, sums, peaks, window)
    else:
        drill(plants, 0, setting, sums, peaks, window, make_scratch())
    return window
