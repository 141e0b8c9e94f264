"""Laws that a diagnosis fits freely, as curves or responses, before it asks which equation they follow.

Where none does, a law is reported as the mechanism that claims it, by ``free_laws`` of an effect. The law of a sensor
is shown by the unit of that effect's first parameter: as a lag (s), as a force over acceleration (kg), else as a gain.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

FREE_LAWS: Mapping[str, str] = MappingProxyType(
    {
        # forces of the rock
        "contact law": "stiffness of the rock over its force, on the way in and on the way out",
        "soft layer": "the same, softer only at first: it ends straight, in the stiffness that the lab states",
        "contact speed": "force of the rock over the speed into it",
        "compaction": "stiffness of the rock over the impacts on a fresh face",
        "mount": "displacement of the rock's face under its force: one mode",
        "rotation": "stiffness of the rock at a frequency of its own",
        # of the coupling, or of one body over its position and its velocity
        "hardening spring": "force of the spring over its shortening that is no softer at its ends than in its middle",
        "saturating spring": "the same, softer at its ends",
        "play": "force of the coupling over its shortening beyond that at rest",
        "damper": "force over the speed, beyond the damping that the lab states",
        "unstated damping": "force on one body over its velocity, where the lab states no damping",
        "friction": "force on one body over its velocity, with a step at rest",
        # of guides, drive and cylinder
        "guide": "force on the shaker body over its speed",
        "indenter": "force on the indenter over its speed",
        "vibration": "forces on shaker body and indenter at a frequency of their own",
        "waveform": "force of the drive over the phase of the excitation",
        "drive": "force of the drive over the force asked of it",
        "slew rate": "force of the drive that changes no faster than by a slope, whatever is asked of it",
        "drive gain": "gain and phase of the drive over the frequency of the excitation",
        "air": "force of the cylinder that falls as the piston advances, and recovers",
        # of sensors
        "rising response": "gain of the accelerometer over frequency that rises above 1",
        "falling response": "the same, falling below 1",
        "level response": "the same at 1, with a lag",
        "lag": "time by which one channel comes later than the other",
        "load cell": "force that the load cell reads in proportion to the acceleration",
        "offset": "constant that a channel reads too much",
        "hum": "oscillation of a channel at the frequency of the mains",
        "high-pass": "slow part of a channel that is lost",
        # which no effect of this package claims
        "creep": "share of the force that the load cell reads late",
        "crosstalk": "force that the acceleration's channel reads",
        "position damping": "force on one body over its velocity that goes with the position",
        "drift": "force on one body that grows with the time in a recording",
        "tone": "force on one body that is periodic in time",
    }
)
"""By name, what the law is. Force, stiffness and gain are each beyond what the rig's model has already."""
