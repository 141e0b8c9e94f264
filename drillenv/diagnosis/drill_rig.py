"""The drilling rig as the diagnosis knows it: see :mod:`drillenv.diagnosis.adapter`."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from drillenv.diagnosis.adapter import Adapter
from drillenv.diagnosis.drill_identification import law_of, mechanisms_of, rivals, taken_up
from drillenv.diagnosis.drill_noise import left_by, noise_left
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import (
    CURVED,
    MOUNT_LAW,
    STRAIGHT,
    Curve,
    Family,
    axes_visited,
    families,
    kind_of_contact,
    kinds_of_spring,
    reparametrise_to_nominal,
    same_force,
)
from drillenv.diagnosis.resonance import Resonator, sharp_resonance, spectra
from drillenv.diagnosis.score_tests import most_promising
from drillenv.diagnosis.sensing import (
    ACCELEROMETER,
    Added,
    Sensor,
    broad_parts,
    contains,
    kind_of_response,
    sensor_families,
)
from drillenv.diagnosis.sinusoids import KINDS, frequencies, sinusoid
from drillenv.diagnosis.sinusoids import family as at_frequency
from drillenv.diagnosis.tables import Axes
from drillenv.dynamics.constitutive.places import LOADING, SPRING
from drillenv.dynamics.effects import mechanism_of_law
from drillenv.dynamics.hybrid import vector_field as V


class DrillRig(Adapter):
    """The adapter of the drilling rig."""

    noise_left: Any = staticmethod(noise_left)
    rivals: Any = staticmethod(rivals)
    taken_up: Any = staticmethod(taken_up)
    mechanisms_of: Any = staticmethod(mechanisms_of)
    reparametrise_to_nominal: Any = staticmethod(reparametrise_to_nominal)
    same_force: Any = staticmethod(same_force)
    contains: Any = staticmethod(contains)

    def axes_at(self, fitted: Fitted) -> Axes:
        """Axes over the ranges that a fit's motions visit."""
        models = [fitted.structure.model(fitted.values, each.point) for each in fitted.blocks]
        paths = fitted.each(lambda block, own, model: block.path(model, own), models)
        return axes_visited(paths, models)

    def candidates(self, fitted: Fitted) -> list[Family]:
        """Every family of the motion and of the sensors."""
        blocks = fitted.blocks
        mounted = fitted.structure.model(fitted.values, blocks[0].point).s[V.MOUNT_GAIN] > 0.0
        moving = self.laws(fitted, fitted.structure.axes, 1)
        moving = [each for each in moving if mounted or each.name != MOUNT_LAW]
        hums = {term.frequency for term in fitted.structure.terms if isinstance(term, Added) and term.orders}
        rate = min(block.data.rate for block in blocks)
        names = [block.name for block in blocks]
        return moving + sensor_families(names, rate, sorted(hums), sharp_resonances(fitted))

    def laws(self, fitted: Fitted, axes: Axes, detail: int) -> list[Family]:
        """Families with free laws on these axes."""
        return families(axes, [block.point.frequency for block in fitted.blocks], detail)

    def at_own_frequency(self, fitted: Fitted, there: Collection[str]) -> list[Family]:
        """Vibrations and a turning rock."""
        recordings = [block.name for block in fitted.blocks]
        seconds = max(block.data.force.size / block.data.rate for block in fitted.blocks)
        found = []
        for kind in KINDS:
            tried = np.zeros(0) if kind.name in there else frequencies(kind, seconds)
            if tried.size:
                # of several channels, the first shows the frequency
                first = kind.channels[:1]
                terms = [sinusoid(kind, float(each), recordings, 0.0, first) for each in tried]
                at, _gain = most_promising(fitted, terms)
                found.append(at_frequency(kind, float(tried[at]), recordings, tried))
        return found

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


def sharp_resonances(fitted: Fitted) -> tuple[Resonator | None, Resonator | None]:
    """Of force and acceleration, as a fit's residuals show them."""
    residuals = fitted.each(lambda block, own: left_by(fitted, block, own))
    pairs = zip(fitted.blocks, residuals, strict=True)
    predicted = [block.measured[:, block.evaluation] - each for block, each in pairs]
    rates = [block.data.rate for block in fitted.blocks]
    broad = broad_parts(min(block.point.rate for block in fitted.blocks))
    first, second = (
        sharp_resonance(spectra([each[i] for each in predicted], [each[i] for each in residuals], rates), broad)
        for i in range(2)
    )
    return first, second


DRILL = DrillRig()
