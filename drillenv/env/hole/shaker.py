"""What an electrodynamic shaker and its frame allow: heat of the coil, power of the amplifier, a resonance.

Makers of shakers state a force that may be held for ever, one that may be reached, and a stroke. The current follows
the force on the armature, so all are stated in its amplitude F_a (Eq. 3.5).

- **Heat.** The coil's rise over the air follows

      tau dT/dt = T_end - T,    T_end = T_limit (F_a / F_hold)^2 (1 + (f / f_e)^2) / (1 + (120 Hz / f_e)^2)

  with the losses of the current in copper and, with the square of the frequency, of eddy currents in the pole pieces
  (f_e is where both are equal). F_hold may be held for ever at 120 Hz. T_limit is that of class F insulation (155
  degrees C, IEC 60085) over air of 40, less 15 for the hottest place. Above it the interlock trips: the rig stands
  for :data:`TRIP_TIME`.
- **Power.** The voltage over the coil grows with its reactance, and with it the apparent power; the amplifier clips
  the force at F_max sqrt(1 + (120 Hz / f_l)^2) / sqrt(1 + (f / f_l)^2), f_l being where reactance and resistance are
  equal. What is asked for beyond is not given.
- **Frame.** A mode of the rig's frame in the range of frequencies takes force from the drive: the share
  1 - d / (1 + ((f - f_0) / b)^2) reaches the armature. A lab knows that there is one, not where: it differs from rig to
  rig and is seen only by driving there.
- **Stroke and acceleration** need no term: at any setting of Table 2.1 the armature moves less than 1 mm against the
  body (a shaker of this size has 25 mm), and what accelerates it is the blow, which the rating limits.
"""

from __future__ import annotations

import math

from numba import njit

from drillenv.dynamics.compiled import INLINE
from drillenv.rig import DRIVE_BASE, DRIVE_SLOPE

TOP = 120.0
"""Hz, the frequency that F_hold and F_max are stated for: the top of Table 2.1."""
HELD_FORCE = 450.0
"""F_hold in N."""
EDDY_FREQUENCY = 60.0
"""f_e in Hz."""
LIMIT = 100.0
"""T_limit in K over the air."""
TIME_CONSTANT = 60.0
"""tau in s."""
TRIP_TIME = 300.0
"""s until the interlock lets the rig start again; the coil cools meanwhile."""
AMPLIFIER_FORCE = 600.0
"""F_max in N at 120 Hz."""
INDUCTANCE_FREQUENCY = 100.0
"""f_l in Hz."""
COIL_POWER = 1500.0
"""W that the coil takes from the mains at T_limit: its losses and those of the amplifier."""
RESONANCE_RANGE = (85.0, 125.0)
"""f_0 in Hz, as rigs differ."""
RESONANCE_WIDTH = 6.0
"""b in Hz: a mode near 100 Hz with a damping ratio of 6 %, as bolted frames have."""
RESONANCE_DEPTH = 0.6
"""d."""


@njit(**INLINE)
def force_asked(frequency: float, amplitude: float) -> float:
    """F_a in N by Eq. 3.5 for a voltage amplitude in V."""
    return (DRIVE_SLOPE * frequency + DRIVE_BASE) * amplitude


@njit(**INLINE)
def largest_amplitude(frequency: float, force: float) -> float:
    """The voltage amplitude in V at which the amplifier clips, for its F_max in N."""
    most = force * math.sqrt(1.0 + (TOP / INDUCTANCE_FREQUENCY) ** 2)
    return most / math.sqrt(1.0 + (frequency / INDUCTANCE_FREQUENCY) ** 2) / (DRIVE_SLOPE * frequency + DRIVE_BASE)


@njit(**INLINE)
def share_transmitted(frequency: float, resonance: float, depth: float) -> float:
    """The share of the force that the frame lets through at a frequency in Hz, for its f_0 in Hz and d."""
    return 1.0 - depth / (1.0 + ((frequency - resonance) / RESONANCE_WIDTH) ** 2)


@njit(**INLINE)
def final_rise(frequency: float, amplitude: float) -> float:
    """T_end in K for a setting in Hz and V that is held."""
    share = force_asked(frequency, amplitude) / HELD_FORCE
    eddies = (1.0 + (frequency / EDDY_FREQUENCY) ** 2) / (1.0 + (TOP / EDDY_FREQUENCY) ** 2)
    return LIMIT * share * share * eddies


@njit(**INLINE)
def rise_after(rise: float, final: float, duration: float) -> float:
    """The coil's rise in K a ``duration`` in s later, on its way to ``final``."""
    return final + (rise - final) * math.exp(-duration / TIME_CONSTANT)
