"""The own unknowns of a recording of the drilling rig: their layout, their units, and what is believed of them.

The states at the beginning of each window come first, then the share by which the pressure is off its label, the share
by which the impacts before the recording are off what is taken, and the sizes of disturbing lines.
"""

from __future__ import annotations

import numpy as np

from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import Model, ModelStructure
from drillenv.dynamics.hybrid.vector_field import (
    AIR_RATE,
    BED,
    BED_SPEED,
    BED_SQUARE,
    BENT1,
    BENT2,
    BRISTLES1,
    BRISTLES2,
    MOUNT_SQUARE,
    OWN,
    UD,
    Q,
    U,
)

CONTINUITY = np.array([2e-8, 2e-6, 1e-4, 1e-7, 1e-8, 1e-5, 0.015, 0.015, 0.015, 1e-8, 1e-5])
"""Standard deviations with which a window goes on where the one before ends, by state. A force on the shaker body hides
in what they leave open: in a period 1 N changes its speed by 5e-5 m/s."""
MASSES = 4
"""States of the two masses, which come first."""
PRESSURE_LABEL = 0.006
"""Standard deviation of a pressure about its label, as a share: gauges are read to 1 %."""
STATE_WIDTHS = np.array([1.0, 1.0, 1e-3, 1e-6, 1e-6, 1e-3, 1.0, 1.0, 1.0, 1e-6, 1e-3])
"""Units of a window's own unknowns: force of the coupling's spring and of its damper in N, then the states from v2 on.
Forces, for what the data say of a window does not change with the spring that is taken to have made them."""
FIRST_STATE = np.array([500.0, 500.0, 1.0, 3e-4])
"""Standard deviations of the first window's states about their first guess, in N, N, m/s and m: as large as they are,
for the samples say little of them where sensors remember the time before."""
BENT = 50.0
"""N, standard deviation of the force of bristles where a recording begins: friction that a lab would not miss."""
AIR_AT_START = 2.0
"""N, prior standard deviation of the air's force where a recording begins: about its ripple in a period."""
COUNT_LABEL = 0.4
"""Standard deviation of the impacts before a running recording, as a share."""


def first_states(data: Conditioned) -> Floats:
    """Own unknowns of a recording as conditioning guesses them."""
    return np.append((data.states / STATE_WIDTHS[:4]).ravel(), [0.0, 0.0])


def states_under(structure: ModelStructure) -> int:
    """States that a window has under a model structure: of the masses, or of a mount, the air and bristles too, or all.

    All where there is a bed under the mount, which few models have.
    """
    if any(term.has_bed for term in structure.terms):
        return OWN
    return BED if any(term.has_states for term in structure.terms) else MASSES


def resized(own: Floats, windows: int, size: int, kept: int, lines: int) -> Floats:
    """The same with so many states a window, where it had ``kept``, and so many amplitudes of lines."""
    states = np.zeros((windows, size))
    take = min(kept, size)
    states[:, :take] = own[: windows * kept].reshape(windows, kept)[:, :take]
    behind = np.zeros(2 + lines)
    behind[:2] = own[windows * kept : windows * kept + 2]
    if own.size == windows * kept + 2 + lines:
        behind = own[windows * kept :]
    return np.concatenate([states.ravel(), behind])


def absent(model: Model) -> list[int]:
    """States that the model has not: of a mount, of the air, of bristles, of a bed."""
    with_them = {U: MOUNT_SQUARE, UD: MOUNT_SQUARE, Q: AIR_RATE, BENT1: BRISTLES1, BENT2: BRISTLES2}
    with_them |= {BED: BED_SQUARE, BED_SPEED: BED_SQUARE}
    return [state for state, scalar in with_them.items() if not model.s[scalar] > 0.0]
