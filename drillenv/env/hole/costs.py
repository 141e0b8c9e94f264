"""What drilling costs and earns, in euros."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

import numpy as np

from drillenv.checks import InputError, number, shown

WELL_DRILLED = 120.0
"""EUR/m that a hole costs where it is drilled well, about."""


@dataclass(frozen=True, slots=True)
class Costs:
    """Prices and durations.

    Drillers compare bits and settings by the cost per metre of a hole,

        (rig_rate (time drilling + time changing, fishing, standing) + bits + energy) / depth

    (Bourgoyne et al., Applied Drilling Engineering, SPE 1986, chapter 1).

    Args:
        rig_rate: Of rig and crew, in EUR/h: a small rig with two people.
        bit: A new bit, in EUR.
        change_time: To pull, change and run in again, in s.
        fishing_time: To get a broken bit out of the hole and go on, in s.
        energy: In EUR/kWh, from a generator.
        compressor: Power in W of the compressor and the rest of the rig while it drills.
        metre: What a metre of hole is paid with, in EUR.

    Raises:
        InputError: a number is not finite or out of its range.
    """

    rig_rate: float = 180.0
    bit: float = 80.0
    change_time: float = 300.0
    fishing_time: float = 1800.0
    energy: float = 0.3
    compressor: float = 4000.0
    metre: float = 600.0

    def __post_init__(self) -> None:
        limits = {
            "rig_rate": (0.0, 1e5, "EUR/h"),
            "bit": (0.0, 1e6, "EUR"),
            "change_time": (0.0, 1e5, "s"),
            "fishing_time": (0.0, 1e6, "s"),
            "energy": (0.0, 100.0, "EUR/kWh"),
            "compressor": (0.0, 1e6, "W"),
            "metre": (0.0, 1e6, "EUR"),
        }
        for name, (low, high, unit) in limits.items():
            object.__setattr__(self, name, number(f"costs {name}", getattr(self, name), low, high, unit))

    @property
    def of_change(self) -> float:
        """A new bit and the time to change it, in EUR."""
        return self.bit + self.rig_rate / 3600.0 * self.change_time

    @property
    def of_breakage(self) -> float:
        """A new bit and the time to fish the broken one, in EUR."""
        return self.bit + self.rig_rate / 3600.0 * self.fishing_time

    def as_record(self) -> dict[str, float]:
        """The costs as JSON takes them; :func:`read_costs` reads them back."""
        return asdict(self)

    def as_array(self) -> np.ndarray:
        """(7,) for the kernels, in the order of the arguments; rates a second and a joule."""
        values = np.array([getattr(self, field.name) for field in fields(self)])
        values[RIG_RATE] /= 3600.0
        values[ENERGY] /= 3.6e6
        return values


RIG_RATE, BIT, CHANGE_TIME, FISHING_TIME, ENERGY, COMPRESSOR, METRE = range(7)
"""Where each stands in ``as_array``."""


def read_costs(record: Costs | Mapping[str, float] | None) -> Costs:
    """The costs of a record such as ``{"bit": 120.0}``; what it leaves out keeps its default.

    Raises:
        InputError: not a record, an unknown name, or a number out of range.
    """
    if record is None:
        return Costs()
    if isinstance(record, Costs):
        return record
    names = [field.name for field in fields(Costs)]
    if not isinstance(record, Mapping):
        raise InputError(f"costs is {shown(record)}: give a record of costs ({', '.join(names)})")
    for name in record:
        if name not in names:
            raise InputError(f"costs has no {shown(name)}: its names are {', '.join(names)}")
    return Costs(**record)
