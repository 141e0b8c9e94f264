"""The noise of force and acceleration as fits of the drilling rig leave it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.drill import ShootingProblem
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.noise import NoiseModel, estimate, fitted_lines, lone_lines
from drillenv.diagnosis.solver import Floats

LOWEST_LINE = 130.0
"""Hz from which lines are of the noise. Below, floors shake and mains hum, with two orders: families of their own."""

Noise = tuple[NoiseModel, NoiseModel]
"""Of force and acceleration."""


def noise_of(data: Conditioned) -> Noise:
    """White noise as conditioning has found it."""
    return NoiseModel(data.noise_force, 0.0, (), data.rate), NoiseModel(data.noise_acceleration, 0.0, (), data.rate)


def noise_left(fitted: Fitted) -> list[Noise]:
    """Noise of each recording as a fit's residuals show it."""

    def estimated(block: ShootingProblem, own: Floats) -> Noise:
        left, quanta = left_by(fitted, block, own), block.data.quanta
        return level(left[0], quanta[0], block), level(left[1], quanta[1], block)

    def level(row: Floats, converter_lsb: float, block: ShootingProblem) -> NoiseModel:
        rate, tone = block.data.rate, float(block.point.frequency)
        found = lines_of_noise(estimate(row, rate, tone, converter_lsb))
        lone = lone_lines(row, rate, tone, found)
        alone = lines_of_noise(replace(found, lines=tuple(sorted((*found.lines, *lone)))))
        if alone.lines == found.lines:
            return found
        # with them gone the level is another
        again = lines_of_noise(estimate(row - fitted_lines(row, alone.lines, rate), rate, tone, converter_lsb))
        return replace(again, lines=tuple(sorted({*alone.lines, *again.lines})))

    return fitted.each(estimated)


def left_by(fitted: Fitted, block: ShootingProblem, own: Floats) -> Floats:
    """(2, n) residuals of a recording; lines that are known already are left in."""
    values = fitted.values
    raw = block.integrate(fitted.structure.model(values, block.point), own)
    return (block.measured - block.read(values, raw.signals))[:, block.evaluation]


def lines_of_noise(level: NoiseModel) -> NoiseModel:
    """The same without lines at frequencies at which something else may be seen."""
    return replace(level, lines=tuple(each for each in level.lines if each >= LOWEST_LINE))


def with_lines_left(fitted: Fitted) -> list[Noise]:
    """The noise that a fit was weighed by, with lines as its residuals show them off the harmonics of the excitation.

    What a model misses of a motion that repeats itself lies on harmonics: these lines are seen however far it is off.
    """

    def known(block: ShootingProblem, own: Floats) -> Noise:
        rate, tone = block.data.rate, float(block.point.frequency)
        first, second = (
            replace(level, lines=lines_of_noise(estimate(row, rate, tone)).lines)
            for row, level in zip(left_by(fitted, block, own), block.noise, strict=True)
        )
        return first, second

    return fitted.each(known)


def quietest(noise: Sequence[Noise], data: Sequence[Conditioned], lines: bool = False) -> list[Noise]:
    """One noise for all recordings: that of the recording in which a channel has the least power.

    Sensors are the same in all of them, and where a model is far off its residuals are their noise and more. ``lines``
    keeps each recording's, in the order of the noise.
    """

    def power(level: NoiseModel) -> float:
        # from a hertz to the Nyquist frequency, over the rate
        return level.std**2 / level.rate * (1.0 + 2.0 * level.corner / level.rate * math.log(level.rate / 2.0))

    least = [min((each[i] for each in noise), key=power) for i in range(2)]

    def at(rate: float, own: Noise | None) -> Noise:
        first, second = (
            replace(level, std=level.std * math.sqrt(rate / level.rate), lines=own[i].lines if own else (), rate=rate)
            for i, level in enumerate(least)
        )
        return first, second

    return [at(each.rate, noise[i] if lines else None) for i, each in enumerate(data)]
