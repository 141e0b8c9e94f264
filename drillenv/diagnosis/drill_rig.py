"""The drilling rig as the diagnosis knows it: see :mod:`drillenv.diagnosis.adapter`."""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import Executor

import numpy as np

from drillenv.diagnosis.adapter import Rival
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.drill import Recorded, kept_of, resized
from drillenv.diagnosis.drill_identification import law_of, mechanisms_of, rivals, taken_up
from drillenv.diagnosis.drill_noise import Noise, noise_left, noise_of
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import MOUNT_LAW, Equivalent, Family, as_stated, axes_of, families, kind_of_spring
from drillenv.diagnosis.noise import nuisance
from drillenv.diagnosis.selection import best_frequency
from drillenv.diagnosis.sensing import ACCELEROMETER, Sensor, kind_of_response, sensor_families
from drillenv.diagnosis.sinusoids import KINDS, frequencies, sinusoid
from drillenv.diagnosis.sinusoids import family as at_frequency
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes
from drillenv.diagnosis.terms import Hypothesis
from drillenv.dynamics.constitutive.places import SPRING
from drillenv.dynamics.effects import mechanism_of_law
from drillenv.dynamics.hybrid import vector_field as V


class DrillRig:
    """The adapter of the drilling rig."""

    def block(self, data: Conditioned, hypothesis: Hypothesis, weight: float, noise: Noise) -> Recorded:
        """A recording by multiple shooting."""
        return Recorded(data, hypothesis, weight, noise)

    def first_noise(self, data: Conditioned) -> Noise:
        """White noise as conditioning has found it."""
        return noise_of(data)

    def own_for(self, own: Floats, data: Conditioned, hypothesis: Hypothesis, noise: Noise) -> Floats:
        """States of windows, and amplitudes of the noise model's lines."""
        windows = len(data.starts) - 1
        size = V.OWN if any(term.remembers for term in hypothesis.terms) else 4
        lines = sum(len(nuisance(each, 2)[1]) for each in noise)
        return resized(own, windows, size, kept_of(own, windows), lines)

    def noise_left(self, fitted: Fitted, pool: Executor | None) -> list[Noise]:
        """Noise of each recording as a fit's residuals show it."""
        return noise_left(fitted, pool)

    def axes_at(self, fitted: Fitted, pool: Executor) -> Axes:
        """Axes over the ranges that a fit's motions visit."""
        paths, models = motions(fitted, pool)
        drive = max(float(each.s[V.F_A]) for each in models)
        rest = [float(each.s[V.F_B] / each.s[V.K]) for each in models]
        return axes_of(paths, drive, rest)

    def as_stated(self, hypothesis: Hypothesis, values: Floats, places: Collection[int]) -> Equivalent:
        """The same motion with constants as stated that a law at one of the places can take up."""
        return as_stated(hypothesis, values, places)

    def candidates(self, fitted: Fitted) -> list[Family]:
        """Every family of the motion and of the sensors."""
        blocks = fitted.blocks
        mounted = fitted.hypothesis.model(fitted.values, blocks[0].scene).s[V.MOUNT_GAIN] > 0.0
        moving = self.laws(fitted, fitted.hypothesis.axes, 1)
        moving = [each for each in moving if mounted or each.name != MOUNT_LAW]
        reading = sensor_families([block.name for block in blocks], min(block.data.rate for block in blocks))
        return moving + reading

    def laws(self, fitted: Fitted, axes: Axes, detail: int) -> list[Family]:
        """Families with free laws on these axes."""
        return families(axes, [block.scene.frequency for block in fitted.blocks], detail)

    def at_own_frequency(self, fitted: Fitted, there: Collection[str], pool: Executor) -> list[Family]:
        """Vibrations and a turning rock."""
        recordings = [block.name for block in fitted.blocks]
        seconds = max(block.data.force.size / block.data.rate for block in fitted.blocks)
        found = []
        for kind in KINDS:
            tried = np.zeros(0) if kind.name in there else frequencies(kind, seconds)
            if tried.size:
                # of several channels, the first shows the frequency
                first = kind.channels[:1]
                at = best_frequency(fitted, tried, lambda f, k=kind, c=first: sinusoid(k, f, recordings, 0.0, c), pool)
                found.append(at_frequency(kind, float(tried[at]), recordings, tried))
        return found

    def rivals(self, fitted: Fitted, family: Family) -> list[Rival]:
        """The library's equations that could stand for a family's law, the nearest first."""
        return rivals(fitted, family)

    def taken_up(self, equation) -> list[str]:
        """Constants that can take up what is straight in an equation's law."""
        return taken_up(equation)

    def mechanisms_of(self, family: Family) -> set[str]:
        """The library's mechanisms that a family may turn out to be."""
        return mechanisms_of(family)

    def mechanism_of(self, fitted: Fitted, family: Family, nearest: str) -> str:
        """The mechanism of a law that no equation follows; the ``nearest`` is one that explains most of it."""
        if isinstance(family.terms[0], Sensor) and family.group == ACCELEROMETER:
            rate = min(block.data.rate for block in fitted.blocks)
            return mechanism_of_law(kind_of_response(family.terms[0], fitted.values_of(family.terms[0].name), rate))
        if nearest:
            return nearest
        if family.group != "spring":
            return family.mechanism
        law = law_of(fitted, family.terms, fitted.blocks[0].scene).curve(SPRING)
        return mechanism_of_law(kind_of_spring(fitted.hypothesis.axes.points(SPRING), law))


DRILL = DrillRig()


def motions(fitted: Fitted, pool: Executor) -> tuple[list[Floats], list]:
    """Path (OWN, n) and model of each recording, where the fit stands."""
    values = fitted.values
    models = [fitted.hypothesis.model(values, each.scene) for each in fitted.blocks]

    return list(pool.map(Recorded.path, fitted.blocks, models, fitted.fit.own)), models
