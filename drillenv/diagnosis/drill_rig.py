"""The drilling rig as the diagnosis knows it: see :mod:`drillenv.diagnosis.adapter`."""

from __future__ import annotations

import math
from collections.abc import Collection
from concurrent.futures import Executor

import numpy as np

from drillenv.diagnosis.adapter import Rival
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.drill import ShootingProblem, resized, states_per_window
from drillenv.diagnosis.drill_identification import law_of, mechanisms_of, rivals, taken_up
from drillenv.diagnosis.drill_noise import Noise, noise_left, noise_of
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import (
    CURVED,
    MOUNT_LAW,
    STRAIGHT,
    Curve,
    Equivalent,
    Family,
    axes_of,
    families,
    kind_of_contact,
    kinds_of_spring,
    reparametrise_to_nominal,
)
from drillenv.diagnosis.noise import nuisance
from drillenv.diagnosis.score_tests import best_frequency
from drillenv.diagnosis.sensing import ACCELEROMETER, Added, Sensor, kind_of_response, sensor_families
from drillenv.diagnosis.sinusoids import KINDS, frequencies, sinusoid
from drillenv.diagnosis.sinusoids import family as at_frequency
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes
from drillenv.diagnosis.terms import ModelStructure
from drillenv.dynamics.constitutive.places import LOADING, SPRING
from drillenv.dynamics.effects import mechanism_of_law
from drillenv.dynamics.hybrid import vector_field as V


class DrillRig:
    """The adapter of the drilling rig."""

    def block(self, data: Conditioned, structure: ModelStructure, weight: float, noise: Noise) -> ShootingProblem:
        """A recording by multiple shooting."""
        return ShootingProblem(data, structure, weight, noise)

    def first_noise(self, data: Conditioned) -> Noise:
        """White noise as conditioning has found it."""
        return noise_of(data)

    def own_for(self, own: Floats, data: Conditioned, structure: ModelStructure, noise: Noise) -> Floats:
        """States of windows, and amplitudes of the noise model's lines."""
        windows = len(data.starts) - 1
        size = V.OWN if any(term.has_states for term in structure.terms) else 4
        lines = sum(len(nuisance(each, 2)[1]) for each in noise)
        return resized(own, windows, size, states_per_window(own, windows), lines)

    def noise_left(self, fitted: Fitted, pool: Executor | None) -> list[Noise]:
        """Noise of each recording as a fit's residuals show it."""
        return noise_left(fitted, pool)

    def axes_at(self, fitted: Fitted, pool: Executor) -> Axes:
        """Axes over the ranges that a fit's motions visit."""
        paths, models = motions(fitted, pool)
        drive = max(float(each.s[V.F_A]) for each in models)
        rest = [float(each.s[V.F_B] / each.s[V.K]) for each in models]
        return axes_of(paths, drive, rest)

    def reparametrise_to_nominal(
        self, structure: ModelStructure, values: Floats, places: Collection[int]
    ) -> Equivalent:
        """The same motion with constants as stated that a law at one of the places can take up."""
        return reparametrise_to_nominal(structure, values, places)

    def candidates(self, fitted: Fitted) -> list[Family]:
        """Every family of the motion and of the sensors."""
        blocks = fitted.blocks
        mounted = fitted.structure.model(fitted.values, blocks[0].point).s[V.MOUNT_GAIN] > 0.0
        moving = self.laws(fitted, fitted.structure.axes, 1)
        moving = [each for each in moving if mounted or each.name != MOUNT_LAW]
        hums = {term.frequency for term in fitted.structure.terms if isinstance(term, Added) and term.orders}
        rate = min(block.data.rate for block in blocks)
        return moving + sensor_families([block.name for block in blocks], rate, lines=sorted(hums))

    def laws(self, fitted: Fitted, axes: Axes, detail: int) -> list[Family]:
        """Families with free laws on these axes."""
        return families(axes, [block.point.frequency for block in fitted.blocks], detail)

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

    def mechanisms_by_law(self, fitted: Fitted, family: Family, nearest: str) -> tuple[str, ...]:
        """The mechanism of a law that no equation follows, the likeliest first; ``nearest`` explains most of it."""
        term = family.terms[0]
        if isinstance(term, Sensor) and family.group == ACCELEROMETER:
            rate = min(block.data.rate for block in fitted.blocks)
            return (mechanism_of_law(kind_of_response(term, fitted.values_of(term.name), rate)),)
        if family.group == CURVED:
            model = law_of(fitted, family.terms, fitted.blocks[0].point)
            stated = next(each.value for each in fitted.structure.unknowns if each.name == STRAIGHT[LOADING])
            return (mechanism_of_law(kind_of_contact(model.curve(LOADING) + math.log(model.s[V.KL] / stated))),)
        if nearest or not (isinstance(term, Curve) and term.place == SPRING):
            return (nearest or family.mechanism,)
        values, precision = fitted.values_of(term.name), fitted.precision_of(term)
        stiffness = float(law_of(fitted, family.terms, fitted.blocks[0].point).s[V.K])
        kinds = kinds_of_spring(term, values, precision, fitted.structure.axes.points(SPRING), stiffness)
        return tuple(map(mechanism_of_law, kinds))


DRILL = DrillRig()


def motions(fitted: Fitted, pool: Executor) -> tuple[list[Floats], list]:
    """Path (OWN, n) and model of each recording, where the fit stands."""
    values = fitted.values
    models = [fitted.structure.model(values, each.point) for each in fitted.blocks]

    return list(pool.map(ShootingProblem.path, fitted.blocks, models, fitted.fit.own)), models
