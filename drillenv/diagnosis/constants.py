"""The paper's model as a term: the rig's and the rock's constants with their priors, and the logger's common filter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from drillenv.diagnosis import predict
from drillenv.diagnosis.predict import Axes
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import REACH, Model, Scene, Term, Unknown
from drillenv.recordings import Nominal
from drillenv.rig import Rig, Setting

NAMES = (
    "shaker_mass",
    "indenter_mass",
    "stiffness",
    "damping",
    "drive_gain",
    "pressure_gain",
    "loading_stiffness",
    "unloading_stiffness",
)
CORNER = 0.415
"""Share of the sample rate at which anti-alias filters have their corner: between 0.38 and 0.45 as a rule."""


@dataclass(frozen=True)
class Constants(Term):
    """Masses, coupling, gains and rock of the paper's model."""

    def contribute(self, values: Floats, model: Model, scene: Scene, axes: Axes) -> None:
        """Set the numbers of the paper's model."""
        m1, m2, k, c, drive, push, loading, unloading = values
        rig = Rig()
        setting = Setting(scene.frequency, scene.amplitude, scene.pressure)
        s = model.s
        s[predict.M1], s[predict.M2], s[predict.K], s[predict.C] = m1, m2, k, c
        s[predict.F_A] += drive * rig.drive_force(setting)
        s[predict.F_B] += push * rig.static_force(setting)
        s[predict.K_L], s[predict.RATIO] = loading, unloading / loading

    def freed(self, name: str) -> Constants:
        """The same with one that need not be near to what is stated."""
        return replace(self, unknowns=tuple(e._replace(std=math.inf) if e.name == name else e for e in self.unknowns))

    def held(self, name: str) -> Constants:
        """The same with one that is believed as stated."""
        return replace(self, unknowns=tuple(e._replace(std=e.width) if e.name == name else e for e in self.unknowns))


def constants(nominal: Mapping[str, Nominal]) -> Constants:
    """From what a campaign states; the unit of each is its stated standard deviation."""
    unknowns = []
    for name in NAMES:
        value, std = float(nominal[name].value or 0.0), float(nominal[name].std or 0.0)
        low, high = 0.3 * value, 3.0 * value
        unknowns.append(Unknown(name, value, std, std, low, high, nominal[name].unit))
    return Constants("constants", tuple(unknowns))


@lru_cache(maxsize=16)
def anti_alias(over: int) -> Floats:
    """(4, 2 REACH over + 1) by what filters that loggers have on all channels alike change an impulse.

    On a grid ``over`` times as fine as the samples: a Butterworth filter of sixth order, its constant delay taken off,
    which does not show, and one of linear phase; each followed by its derivative by the logarithm of its corner.
    """
    size = 4096 * over
    f = np.fft.rfftfreq(size, 1.0 / over)  # in sample rates

    def butterworth(corner: float) -> NDArray[np.complex128]:
        poles = np.exp(0.5j * np.pi * (1.0 + (2.0 * np.arange(6) + 1.0) / 6.0))
        response = np.prod(1.0 / (1j * f[:, None] / corner - poles), axis=1)
        return response * np.exp(1j * f / corner * np.sum(-1.0 / poles).real)

    def linear(corner: float) -> NDArray[np.complex128]:
        return 0.5 * erfc((f - corner) / 0.03).astype(complex)

    def kernel(response: NDArray[np.complex128]) -> Floats:
        whole = np.fft.irfft(response, size)
        return np.concatenate([whole[-REACH * over :], whole[: REACH * over + 1]])

    rows = []
    for design in (butterworth, linear):
        rows.append(kernel(design(CORNER) - 1.0))
        rows.append(kernel((design(1.01 * CORNER) - design(CORNER / 1.01)) / (2.0 * np.log(1.01))))
    return np.array(rows)


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
    """With shares of two filters and what their corners are off, 0 where there is none."""
    widths = (0.3, 0.05, 0.3, 0.05)
    stds = (1.0, 0.15, 1.0, 0.15)
    pairs = zip(widths, stds, strict=True)
    return Logger("logger", tuple(Unknown(f"logger {i}", 0.0, width, std) for i, (width, std) in enumerate(pairs)))
