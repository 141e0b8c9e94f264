"""Textbook equations as curves: what an effect says of its law to a diagnosis, which fits curves to recordings.

An effect acts at one or more places of the rig. At each it is a curve over one argument, or it changes numbers of the
model. Arguments and quantities of places are those of the ``tabulated`` effects, but for two: ``loading`` and
``unloading`` are factors on the stiffness over w = R / k_l in m, R the force of the rock law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Around(NamedTuple):
    """The rig that a law acts in, SI."""

    k: float
    kl: float
    ku: float
    frequency: float
    """Hz, of the excitation."""


Law = Callable[[Floats, tuple[float, ...], Around], Floats]
"""From arguments (n,), the effect's parameters and the rig to values (n,)."""


class Form(NamedTuple):
    """An equation that an effect may follow at given places."""

    name: str
    """As reports call it."""
    symbols: tuple[str, ...]
    """The parameters that it has; others of the effect stay neutral."""
    starts: tuple[tuple[float, ...], ...]
    """Values of these from which a fit is tried, side by side."""
    laws: Mapping[str, Law] = {}
    """By place."""
    numbers: Callable[[tuple[float, ...], Around], Mapping[str, float]] | None = None
    """What it adds to numbers of the model, by name: drive (factor less 1), mount_gain (1/kg), mount_square (1/s^2),
    mount_damping (1/s), air_stiffness (N/m), air_rate (1/s)."""
