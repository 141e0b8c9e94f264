"""A belief about the rock: a crowd of nominal plants, each on its own rock (a particle filter on the plant itself).

All of the crowd go through the settings that the real rig goes through. Those whose sensors would have read what the
real ones did are kept and multiplied, the others dropped. Where none of them explains an interval, the rock must have
changed in it: then many plants are tried that met a new, fresh rock somewhere in that interval. As a fresh face gives
way in its own manner, one such interval mostly tells which rock it was.
"""

from __future__ import annotations

import math

import numpy as np

from drillenv.controllers.estimate import AMPLITUDE, AT, GAUGE, NOISE, VALVE, Cylinder, inside
from drillenv.dynamics.exact import ORIGIN
from drillenv.env import plant
from drillenv.env.batch import Batch, Snapshot
from drillenv.env.episodes import BLOWS_RANGE, START, Episode, draw_rocks, rig_array
from drillenv.env.observation import READINGS, SIZE
from drillenv.env.task import Task, action_for
from drillenv.env.truth import T_RATE, T_SINGLE
from drillenv.rig import Rig
from drillenv.rocks import ROCKS

COMPARED = np.arange(AT)
"""The readings that tell rocks apart: all but the setting and the pressure."""
_TRUTHS = np.array([READINGS[i].truth for i in COMPARED])
_SCALES = np.array([1.0 / READINGS[i].scale for i in COMPARED])
ERROR, ROUGH = 0.01, 0.15
"""Relative error of a nominal plant where its blows are single, and more of it where they are not: such motions are
sensitive to what nobody knows."""
ABSOLUTE = 0.3
"""Further error of each reading, in multiples of FLOOR."""
FLOOR = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.002, 0.1, 0.1, 0.1, 0.1, 0.01])
"""In the units of the readings compared."""
HAZARD = 0.04
"""Probability of another rock in an interval: a layer lasts 3 to 10 s."""
ODD = -16.0
"""Logarithm of the mean likelihood below which a change is looked for; where the rock stays it falls below this in one
interval of fifty, where it changes nearly always."""
ELSEWHERE = 0.25
"""Share of the new rocks tried that are drawn from anywhere, not from Table 2.2."""
LOADING_ANYWHERE = (4e6, 70e6)
HARDENING_ANYWHERE = (1.03, 1.6)
"""Loading stiffness in N/m, and unloading over loading, of rocks from anywhere."""
OTHER_BLOWS = 0.3
"""Share of the new rocks tried whose faces stiffen at another pace than the last one."""
JITTER = (0.005, 0.7)
"""Relative change of stiffness of a plant that is multiplied: at least, and as a share of the crowd's spread."""


class Belief:
    """The crowd.

    Args:
        size: Plants that are led along.
        tried: Plants tried where a change is looked for.
    """

    def __init__(self, size: int = 32, tried: int = 192):
        task = Task(kind="layers")
        self._crowd, self._trial = Batch(task, size, 0, threads=1), Batch(task, tried, 0, threads=1)
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Believe in any rock."""
        self._rng = rng
        self.cylinder: Cylinder = Cylinder()
        self._begun = False

    def update(self, observation: np.ndarray) -> None:
        """Take in an interval; the first one of an episode is taken to start at rest on fresh rock."""
        observation = inside(observation)
        start = self.cylinder.pressure
        self.cylinder.update(float(observation[VALVE]), float(observation[GAUGE]))
        crowd, trial = self._crowd, self._trial
        if not self._begun:
            self._begun = True
            self._place_trial()
            self._draw(self._fits(trial, START.pressure, observation), np.full(crowd.n, -np.inf))
            return
        before = [part.copy() for part in crowd.plants]
        fits = self._fits(crowd, start, observation)
        new = np.full(trial.n, -np.inf)
        if _log_mean(fits) < ODD:
            self._change_trial(before)
            new = self._fits(trial, start, observation) + math.log(HAZARD / trial.n)
        self._draw(new, fits + math.log((1.0 - HAZARD) / crowd.n))

    @property
    def rocks(self) -> np.ndarray:
        """(size, 2) loading and unloading stiffness in N/m of the crowd."""
        layers, memories = self._crowd.plants.layers, self._crowd.plants.memories
        each, own = np.arange(self._crowd.n), memories[:, plant.LAYER].astype(int)
        # a change that waits for the next contact counts as done
        own = own + np.isneginf(layers[each, own, plant.LAYER_END])
        return layers[each, own, :2].copy()

    def central(self) -> tuple[Snapshot, tuple[float, float]]:
        """The plant whose rock is nearest the crowd's mean, at the estimated pressure and lag, and its rock."""
        logs = np.log(self.rocks)
        middle = int(np.argmin(((logs - logs.mean(axis=0)) ** 2).sum(axis=1)))
        memory = self._crowd.plants.memories[middle]
        memory[plant.PRESSURE], memory[plant.LAG] = self.cylinder.pressure, self.cylinder.lag
        loading, unloading = np.exp(logs[middle]).tolist()
        return self._crowd.snapshot(middle), (loading, unloading)

    def _place_trial(self) -> None:
        """Put the trial plants at rest on fresh rocks of all kinds."""
        rocks, cases = self._any_rocks()
        blows = self._rng.integers(BLOWS_RANGE[0], BLOWS_RANGE[1] + 1, self._trial.n)
        rig = rig_array(Rig())
        for j in range(self._trial.n):
            layers = np.array([[*rocks[j], math.inf, float(cases[j])]])
            self._trial.load(j, Episode(layers, self.cylinder.lag, int(blows[j]), 0.0, rig))

    def _any_rocks(self) -> tuple[np.ndarray, np.ndarray]:
        """(tried, 2) stiffnesses in N/m and (tried,) the cases of Table 2.2 after which their faces stiffen."""
        rng, n = self._rng, self._trial.n
        cases = rng.integers(1, len(ROCKS) + 1, n)
        rocks = draw_rocks(cases, rng)
        low, high = LOADING_ANYWHERE
        loading = np.exp(rng.uniform(math.log(low), math.log(high), n))
        anywhere = np.column_stack([loading, loading * rng.uniform(*HARDENING_ANYWHERE, n)])
        return np.where(rng.random(n)[:, None] < ELSEWHERE, anywhere, rocks), cases

    def _change_trial(self, before: list[np.ndarray]) -> None:
        """Let the trial plants go on from the crowd's last states, and meet a new rock within the interval."""
        rng, trial, n = self._rng, self._trial.plants, self._trial.n
        parents = rng.integers(self._crowd.n, size=n)
        for part, kept in zip(trial, before, strict=True):
            part[:] = kept[parents]
        memories, layers = trial.memories, trial.layers
        own = memories[:, plant.LAYER].astype(int)
        rocks, cases = self._any_rocks()
        made = 1e-3 * plant.INTERVAL * np.maximum(self._crowd.truths[parents, T_RATE], 0.01)
        layers[:, 0] = layers[np.arange(n), own]
        layers[:, 0, plant.LAYER_END] = trial.states[:, ORIGIN] + rng.random(n) * made
        layers[:, 0, plant.LAYER_FACE] = 0.0
        layers[:, 1:, plant.LAYER_KL], layers[:, 1:, plant.LAYER_KU] = rocks[:, :1], rocks[:, 1:]
        layers[:, 1:, plant.LAYER_END], layers[:, 1:, plant.LAYER_FACE] = math.inf, cases[:, None]
        memories[:, plant.LAYER] = 0.0
        blows = rng.integers(BLOWS_RANGE[0], BLOWS_RANGE[1] + 1, n)
        memories[:, plant.BLOWS] = np.where(rng.random(n) < OTHER_BLOWS, blows, memories[:, plant.BLOWS])

    def _fits(self, batch: Batch, pressure: float, observation: np.ndarray) -> np.ndarray:
        """Take a batch through the interval, from a pressure in bar.

        Returns (n,) the logarithm of the likelihood of what was read, 0 for a perfect match without error.
        """
        memories = batch.plants.memories
        memories[:, plant.PRESSURE], memories[:, plant.LAG] = pressure, self.cylinder.lag
        action = action_for(*(float(observation[i]) for i in (AT, AMPLITUDE, VALVE)))
        actions, everywhere = np.tile(action, (batch.n, 1)), np.ones(batch.n, dtype=bool)
        batch.step(everywhere, actions, False, np.zeros((batch.n, SIZE)))
        model = batch.truths[:, _TRUTHS] * _SCALES
        error = (ERROR + ROUGH * (1.0 - batch.truths[:, T_SINGLE, None])) * model
        noise = NOISE[COMPARED] ** 2
        variance = noise + (ABSOLUTE * FLOOR) ** 2 + error**2
        misses = (observation[COMPARED] - model) ** 2 / variance
        # Student's density with four degrees of freedom: in its tails one odd reading does not decide
        return (-2.5 * np.log1p(misses / 4.0) - 0.5 * np.log(variance / noise)).sum(axis=1)

    def _draw(self, trial: np.ndarray, crowd: np.ndarray) -> None:
        """Go on with those of both batches that are believed in, by the logarithms of their weights."""
        logs = np.concatenate([trial, crowd])
        size = self._crowd.n
        weights = np.exp(logs - logs.max())
        places = (np.arange(size) + self._rng.random()) / size * weights.sum()
        chosen = np.minimum(np.searchsorted(np.cumsum(weights), places), weights.size - 1)
        for own, other in zip(self._crowd.plants, self._trial.plants, strict=True):
            own[:] = np.concatenate([other, own])[chosen]
        self._crowd.truths[:] = np.concatenate([self._trial.truths, self._crowd.truths])[chosen]
        again = np.ones(size, dtype=bool)
        again[np.unique(chosen, return_index=True)[1]] = False
        self._vary(again)

    def _vary(self, which: np.ndarray) -> None:
        """Change the rock of the plants marked a little."""
        layers, memories = self._crowd.plants.layers, self._crowd.plants.memories
        own = memories[:, plant.LAYER].astype(int)
        present = layers[np.arange(self._crowd.n), own].copy()
        logs = np.log(present[:, :2])
        spread = np.maximum(JITTER[0], JITTER[1] * logs.std(axis=0))
        varied = np.exp(logs + spread * self._rng.standard_normal(logs.shape))
        varied[:, 1] = np.maximum(varied[:, 1], 1.001 * varied[:, 0])
        fresh = memories[:, plant.FACE_IMPACTS] <= plant.FACES.shape[1] * memories[:, plant.BLOWS]
        fresh &= present[:, plant.LAYER_FACE] > 0.0
        for j in np.flatnonzero(which):
            if fresh[j]:  # it takes its stiffness anew at every contact
                layers[j, own[j], :2] = varied[j]
            else:
                layers[j, 0] = *present[j, :2], -math.inf, 0.0
                layers[j, 1:] = *varied[j], math.inf, 0.0
                memories[j, plant.LAYER] = 0.0


def _log_mean(logs: np.ndarray) -> float:
    """The logarithm of the mean of what these are the logarithms of."""
    top = float(logs.max())
    return top + math.log(np.exp(logs - top).mean())
