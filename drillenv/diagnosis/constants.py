"""The paper's model as terms: the rig's and the rock's constants with their priors, and what the logger makes of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from drillenv.corrected import RIG_CONSTANTS, ROCK_CONSTANTS
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import Axes
from drillenv.diagnosis.terms import DRIVE_PHASE, REACH, Model, OperatingPoint, Term, Unknown
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.recordings import Nominal
from drillenv.rig import Rig, Setting

NAMES = RIG_CONSTANTS + ROCK_CONSTANTS
TRANSITION = 0.07
"""Share of the sample rate over which filters of linear phase fall from 76 % to 8 %: short ones need more, and steep
ones act above what is fitted."""
MISREAD = 0.01
"""Of the excitation, standard deviation of a hum that may be on its channel: cables of a lab pick up some mV."""
CORNER = 0.415
"""Share of the sample rate at which anti-alias filters have their corner: between 0.38 and 0.45 as a rule."""


@lru_cache(maxsize=256)
def stated_forces(frequency: float, amplitude: float, pressure: float) -> tuple[float, float]:
    """Amplitude of the drive and static force in N of the paper's rig at Hz, V and bar."""
    rig, setting = Rig(), Setting(frequency, amplitude, pressure)
    return rig.drive_force(setting), rig.static_force(setting)


@dataclass(frozen=True)
class Constants(Term):
    """Masses, coupling, gains and rock of the paper's model."""

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Set the numbers of the paper's model."""
        m1, m2, k, c, drive, push, loading, unloading = values
        drive_force, static_force = stated_forces(point.frequency, point.amplitude, point.pressure)
        s = model.s
        s[V.M1], s[V.M2], s[V.K], s[V.C] = m1, m2, k, c
        s[V.F_A] += drive * drive_force
        s[V.F_B] += push * static_force
        s[V.KL], s[V.KU] = loading, unloading


def constants(nominal: Mapping[str, Nominal]) -> Constants:
    """From what a campaign states; the unit of each is its stated standard deviation."""
    unknowns = []
    for name in NAMES:
        value, std = float(nominal[name].value or 0.0), float(nominal[name].std or 0.0)
        low, high = 0.3 * value, 3.0 * value
        unknowns.append(Unknown(name, value, std, std, low, high, nominal[name].unit))
    return Constants("constants", tuple(unknowns))


@dataclass(frozen=True)
class MisreadExcitations(Term):
    """By what the drive is off the excitation that was read, in recordings where a hum is not told from that.

    The share by which its force is larger and the rad by which it is ahead, of each.
    """

    names: tuple[str, ...] = ()
    """Recordings in a fit."""
    near: tuple[str, ...] = ()
    """All such recordings, those that are held out included."""
    common = 0

    def contribute(self, values: Floats, model: Model, point: OperatingPoint, axes: Axes) -> None:
        """Correct the drive of a recording."""
        if point.name in self.names:
            share, ahead = values.reshape(-1, 2)[self.names.index(point.name)]
            model.s[V.F_A] *= 1.0 + share
            model.s[DRIVE_PHASE] += ahead

    def of_recording(self, name: str, values: Floats) -> tuple[MisreadExcitations, Floats]:
        """The same with what one recording is off; without any where it is not near to the mains."""
        own = np.zeros(2)
        if name in self.names:
            own = values.reshape(-1, 2)[self.names.index(name)]
        names = (name,) if name in self.near else ()
        return misread_excitations(names, self.near), own[: 2 * len(names)]


def misread_excitations(names: Iterable[str], near: Iterable[str]) -> MisreadExcitations:
    """Of these recordings, of which all that are ``near`` to the mains have an excitation that may hum."""
    names = tuple(names)
    parts = (("share", "1"), ("phase", "rad"))
    unknowns = (Unknown(f"excitation of {name}, {part}", 0.0, MISREAD, MISREAD, unit=unit)
                for name in names for part, unit in parts)  # fmt: skip
    return MisreadExcitations("excitation", tuple(unknowns), names, tuple(near))


@lru_cache(maxsize=16)
def anti_alias(over: int) -> Floats:
    """(5, 2 REACH over + 1) by what filters that loggers have on all channels alike change an impulse.

    On a grid ``over`` times as fine as the samples: a Butterworth filter of sixth order, its constant delay taken off,
    which does not show, and its derivative by the logarithm of its corner; one of linear phase, and its derivatives by
    the logarithms of its corner and of its transition's width. All linear: filters themselves have several optima.
    """
    size = 4096 * over
    f = np.fft.rfftfreq(size, 1.0 / over)  # in sample rates

    def butterworth(corner: float) -> Floats:
        poles = np.exp(0.5j * np.pi * (1.0 + (2.0 * np.arange(6) + 1.0) / 6.0))
        response = np.prod(1.0 / (1j * f[:, None] / corner - poles), axis=1)
        return kernel(response * np.exp(1j * f / corner * np.sum(-1.0 / poles).real) - 1.0)

    def linear_phase(corner: float, width: float = TRANSITION) -> Floats:
        return kernel(0.5 * erfc((f - corner) / width) - 1.0)

    def kernel(response: NDArray) -> Floats:
        whole = np.fft.irfft(response, size)
        return np.concatenate([whole[-REACH * over :], whole[: REACH * over + 1]])

    higher, lower, step = 1.01, 1.0 / 1.01, 2.0 * math.log(1.01)
    return np.array(
        [
            butterworth(CORNER),
            (butterworth(higher * CORNER) - butterworth(lower * CORNER)) / step,
            linear_phase(CORNER),
            (linear_phase(higher * CORNER) - linear_phase(lower * CORNER)) / step,
            (linear_phase(CORNER, higher * TRANSITION) - linear_phase(CORNER, lower * TRANSITION)) / step,
        ]
    )


@dataclass(frozen=True)
class Logger(Term):
    """An anti-alias filter on all channels alike, of which a lab seldom says anything."""

    def kernel(self, values: Floats, over: int) -> Floats | None:
        """Of the filter on the fine grid; None where there is none."""
        if not np.any(values):
            return None
        made = values @ anti_alias(over)
        made[REACH * over] += 1.0
        return made


def logger() -> Logger:
    """With shares of two filters, 0 where there is none, and those times what corners and a width are off."""
    parts = (
        ("logger, share of Butterworth", 0.3, 1.0),
        ("logger, corner of Butterworth", 0.05, 0.15),
        ("logger, share of linear phase", 0.3, 1.0),
        ("logger, corner of linear phase", 0.05, 0.15),
        ("logger, width of linear phase", 0.2, 0.5),
    )
    return Logger("logger", tuple(Unknown(name, 0.0, scale, std) for name, scale, std in parts))
