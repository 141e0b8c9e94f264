"""What the paper publishes of the rig's motions, as data: single settings, boundaries, orders and one force.

Labels count impacts as force peaks. "period two" is any P-2-I-m; "multiple impacts" stands for Fig. 4.3 at 1.8 bar,
where the paper gives no number.
"""

from __future__ import annotations

from typing import NamedTuple

from drillenv.rig import Setting


class MotionRow(NamedTuple):
    """A motion published for one setting."""

    figure: str
    rock: int
    setting: Setting
    published: str
    source: str
    """Whether the paper simulated it, measured it, or both."""


class BoundaryRow(NamedTuple):
    """A change of motion published along a sweep, with the motion to follow to it."""

    figure: str
    rock: int
    over: str
    published: float
    before: str
    after: str
    inside: Setting
    """Where the motion that is followed is at home."""
    outside: float
    """The value to follow it towards."""
    swept: bool = False
    """Whether the motion is met on the sweep from ``inside`` to ``outside`` only, since a start from rest near the
    boundary leads elsewhere: then the boundary is that at which the sweep comes to the motion ``after``."""


BOTH, MEASURED, SIMULATED = "simulated and measured", "measured", "simulated"

MOTIONS = (
    MotionRow("2.5", 4, Setting(50, 0.50, 1.0), "P-1-I-4", MEASURED),
    MotionRow("2.5", 4, Setting(100, 0.50, 1.0), "P-2-I-2", MEASURED),
    MotionRow("2.5", 4, Setting(150, 0.50, 1.0), "P-1-I-1", MEASURED),
    MotionRow("4.1", 4, Setting(50, 0.45, 1.0), "P-1-I-4", BOTH),
    MotionRow("4.1", 4, Setting(70, 0.45, 1.0), "P-1-I-3", BOTH),
    MotionRow("4.1", 4, Setting(100, 0.45, 1.0), "period two", BOTH),
    MotionRow("4.1", 4, Setting(120, 0.45, 1.0), "P-1-I-1", BOTH),
    MotionRow("4.2", 2, Setting(120, 0.30, 1.0), "P-1-I-2", BOTH),
    MotionRow("4.2", 2, Setting(120, 0.40, 1.0), "P-1-I-1", BOTH),
    MotionRow("4.2", 2, Setting(120, 0.50, 1.0), "P-1-I-1", BOTH),
    MotionRow("4.2", 2, Setting(120, 0.60, 1.0), "P-1-I-1", BOTH),
    MotionRow("4.3", 4, Setting(90, 0.45, 0.70), "period two", BOTH),
    MotionRow("4.3", 4, Setting(90, 0.45, 1.0), "P-1-I-2", BOTH),
    MotionRow("4.3", 4, Setting(90, 0.45, 1.4), "P-1-I-3", BOTH),
    MotionRow("4.3", 4, Setting(90, 0.45, 1.8), "multiple impacts", BOTH),
)

BOUNDARIES = (
    BoundaryRow("3.2", 4, "frequency", 94.7, "P-1-I-2", "P-2-I-4", Setting(90, 0.45, 1.0), 100.0),
    BoundaryRow("3.2", 4, "frequency", 98.6, "P-2-I-4", "P-2-I-3", Setting(100, 0.45, 1.0), 96.0),
    BoundaryRow("3.2", 4, "frequency", 102.0, "P-2-I-3", "P-4-I-6", Setting(100, 0.45, 1.0), 105.0),
    BoundaryRow("3.2", 4, "frequency", 109.8, "chaotic", "P-1-I-1", Setting(108.5, 0.45, 1.0), 110.5, swept=True),
    BoundaryRow("4.2", 2, "amplitude", 0.3955, "P-1-I-2", "P-1-I-1", Setting(120, 0.45, 1.0), 0.30),
    BoundaryRow("4.3", 4, "pressure", 0.63, "P-1-I-1", "period two", Setting(90, 0.45, 0.6), 1.0),
    BoundaryRow("4.3", 4, "pressure", 0.72, "period two", "P-1-I-2", Setting(90, 0.45, 1.0), 0.6),
)

ORDER_3_2 = ("P-1-I-4", "P-1-I-3", "P-1-I-2", "P-2-I-4", "P-2-I-3", "P-4-I-6", "chaotic", "P-1-I-1")
SWEEP_3_2 = Setting(50, 0.45, 1.0)

ORDER_4_4 = (1, 2, 1)
"""Periods of the six rocks in order of their loading stiffness, repeats left out."""
SETTING_4_4 = Setting(100, 0.45, 1.0)

FORCE_2_4 = (Setting(100, 0.50, 1.0), 3000.0)
"""The largest contact force measured in Fig. 2.4, in N."""
