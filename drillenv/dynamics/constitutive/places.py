"""Where a law may act on the rig: its argument, what it gives, and how the balances take it up.

    m1 v1' = F_b - S - coupling - guide + shaker's vibration
    m2 v2' = drive + coupling - R - indenter + indenter's vibration
    coupling = k y + c y' + f(y) + f(y - F_b / k) + f(y')
    drive    = F_a (sin(theta) / sqrt(1 + (n s)^2) + f(theta)) + f(F_a sin(theta))
    R        = max(R_law (1 + f(V)) + f(V) + c_d (x / d_0)^p V, 0) in contact
    R_law    = k N(x), k = k_l or k_u times every factor
    u''      = g R - h, h = q (u - b) + d (u' - b') + f(u - b) + f(u' - b')
    b''      = g_b h - q_b b - d_b b'

with f the laws at their places and N the shape of the contact over the depth x; y = X1 - X2; V = v2 - u' the speed into
the rock, u the displacement of a rock on a mount, b that of the bed under the mount, 0 where there is none; d_0 = 0.1
mm; S' = k_a v1 - r S what the cylinder has lost; n the frequency of the excitation in Hz. A law depends on its
argument, on its own parameters and on the coupling's stiffness k; never on k_l, k_u or the excitation, which change
while a rig drills.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Law = Callable[[Floats, tuple[float, ...], float], Floats]
"""From arguments (n,), an effect's parameters and the coupling's stiffness k in N/m to values (n,). Continuous; corners
are found by :func:`drillenv.dynamics.constitutive.tables.tabulate`."""

Over = Literal["depth", "loading depth", "force"]
"""What a contact's shape is over, in a regime of stiffness k: the depth x, k x / k_l, or the force k x in N."""
OVER: tuple[Over, ...] = ("depth", "loading depth", "force")


class Shape(NamedTuple):
    """A contact law: from a depth to the depth at which the linear rock law has the same force. Rising, 0 at 0.

    Where ``over`` is the force, it goes from and to k times that.
    """

    law: Law
    over: Over = "depth"


def shape_of(given: Law | Shape) -> Shape:
    """What an effect states at a place, a plain law as one over the place's argument."""
    return given if isinstance(given, Shape) else Shape(given)


@dataclass(frozen=True, slots=True)
class Place:
    """A place for a law."""

    name: str
    argument: str
    argument_unit: str
    quantity: str
    """What a law gives there, with the sign that it counts by."""
    unit: str
    low: float
    high: float
    """Range over which a law is tabulated; beyond it goes on straight. Far beyond what the rig reaches."""


MOST_IMPACTS = 1e8
"""On a face."""
REFERENCE_DEPTH = 1e-4
"""d_0 in m: at this depth a power of it is 1."""
_STIFFER = "depth at which the linear rock law has the same force"
_COUPLING = "force of the coupling beyond k, c"
_SHORTENING = "shortening of the coupling"

(
    LOADING,
    UNLOADING,
    RATE_FACTOR,
    RATE_FORCE,
    COMPACTION,
    SPRING,
    SPRING_FROM_REST,
    DAMPER,
    GUIDE,
    INDENTER,
    WAVEFORM,
    DRIVE,
    MOUNT_SPRING,
    MOUNT_DAMPER,
) = range(14)

PLACES = (
    Place("loading", "depth while loading", "m", _STIFFER, "m", 0.0, 1e-2),
    Place("unloading", "depth while unloading", "m", _STIFFER, "m", 0.0, 1e-2),
    Place("rate-factor", "speed into the rock", "m/s",
          "what the rock's force grows by, over that of the rock law", "1", -4.0, 4.0),
    Place("rate-force", "speed into the rock", "m/s", "force of the rock beyond that of the rock law", "N", -4.0, 4.0),
    Place("compaction", "impacts on a fresh face", "1", "factor on k_l and k_u, less 1", "1", 0.0, MOST_IMPACTS),
    Place("spring", f"{_SHORTENING}, X1 - X2", "m", _COUPLING, "N", -0.05, 0.05),
    Place("spring-from-rest", f"{_SHORTENING} beyond that at rest", "m", _COUPLING, "N", -0.05, 0.05),
    Place("damper", "closing speed of the coupling, X1' - X2'", "m/s", _COUPLING, "N", -4.0, 4.0),
    Place("guide", "speed of the shaker body", "m/s", "force against the motion of the shaker body", "N", -4.0, 4.0),
    Place("indenter", "speed of the indenter", "m/s", "force against the motion of the indenter", "N", -4.0, 4.0),
    Place("drive-waveform", "phase of the excitation", "rad", "force of the drive beyond its sine, over F_a", "1",
          0.0, 2.0 * np.pi),
    Place("drive-curve", "force asked of the drive, F_a sin(theta)", "N", "force of the drive beyond that", "N",
          -2e3, 2e3),
    Place("mount-spring", "deflection of the rock's mount", "m", "force of the mount over the rock's mass", "m/s^2",
          -1e-2, 1e-2),
    Place("mount-damper", "speed of the rock's mount", "m/s", "force of the mount over its mass", "m/s^2", -4.0, 4.0),
)  # fmt: skip
"""In the order of the codes."""
CODE: Mapping[str, int] = {place.name: code for code, place in enumerate(PLACES)}

SCALARS: Mapping[str, str] = {
    "mount_gain": "1/kg, g of the mount: one over its mass",
    "mount_square": "1/s^2, q: its natural frequency, squared",
    "mount_damping": "1/s, d",
    "air_stiffness": "N/m, k_a of the enclosed air",
    "air_per_length": "1/m, one over the length of air that the cylinder encloses, which follows Boyle's law",
    "air_rate": "1/s, r: one over the time the supply takes to restore the pressure",
    "drive_lag": "s, one over the corner frequency of the drive",
    "shaker_vibration": "N, amplitude of a vibration from outside on the shaker body",
    "indenter_vibration": "N, the same on the indenter",
    "vibration_rate": "rad/s",
    "vibration_phase": "rad, at the start",
    "vibration_detuning": "rad/s, by which that on the indenter is faster",
    "vibration_lead": "rad, by which it is ahead at the start",
    "rotation_share": "1, by which the rock's stiffness goes with the cosine of the angle at which a contact begins",
    "rotation_rate": "rad/s",
    "rotation_phase": "rad, at the start",
    "shaker_grip": "N, dry friction that holds the shaker body fast",
    "indenter_grip": "N, the same of the indenter",
    "shaker_bristles": "N/m, stiffness with which dry friction on the shaker body gives before it slides",
    "indenter_bristles": "N/m, the same on the indenter",
    "shaker_sliding": "N, force at which it then slides; a law at guide adds to that, over the speed either way",
    "indenter_sliding": "N, the same on the indenter, with a law at indenter",
    "shaker_bristle_damping": "N s/m, force over the speed at which bristles give",
    "indenter_bristle_damping": "N s/m, the same on the indenter",
    "contact_damping": "N s/m, c_d: the rock's damping at the depth d_0",
    "contact_damping_power": "1, p: the power of the depth by which it grows",
    "bed_share": "1, g_b of the bed under the mount: the rock's mass over its own",
    "bed_square": "1/s^2, q_b: its natural frequency, squared",
    "bed_damping": "1/s, d_b",
    "compaction_length": "m drilled on a face that count as one impact on it; where 0, impacts are counted",
    "slew_rate": "N/s, slew rate of the drive: largest slope of its force",
    "slew_share": "1, share of the drive's force that it limits",
    "drive_delay": "s, by which that share is late",
}
"""What an effect may set that is no curve, with its unit; 0 where no effect sets it."""
STATE_SCALARS = frozenset({"mount_square", "air_rate", "shaker_bristles", "indenter_bristles", "slew_rate"})
"""Those that give a model states of its own where they are set."""
