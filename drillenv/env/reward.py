"""The reward: penetration, worth most when strong single blows make it, less what wears the tool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

import numpy as np
from numba import njit

from drillenv.checks import InputError, number, shown
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import KERNEL
from drillenv.env.truth import T_DRIVE, T_EXCESS, T_RATE, T_STRONG


@dataclass(frozen=True, slots=True)
class Reward:
    """The weights of the reward.

    In mm/s it is

        penetration * rate * (other_motions + (1 - other_motions) * strong_share) - force * excess - energy * power

    with the penetration ``rate`` in mm/s, ``strong_share``, the share of the excitation periods with one blow like the
    one before (P-1-I-1), each counted by its peak force over the rating, at most 1, ``excess``, the force above the
    rating summed over the impacts of a period in kN, and the mean ``power`` of the drive in W.

    Args:
        penetration: Worth of the penetration rate, in mm/s for 1 mm/s.
        other_motions: What penetration is worth when it is not made by strong P-1-I-1, 0 to 1: multiple blows and
            chatter wear indenter and rig at the same progress.
        force: Worth of 1 kN above the rating in every period, in mm/s: tool wear.
        energy: Worth of 1 W of drive power, in mm/s.
        rating: Contact force in N above which the tool wears; also what ``info["cost"]`` counts from.

    Raises:
        InputError: a weight is no finite number or out of its range.
    """

    penetration: float = 1.0
    other_motions: float = 0.25
    force: float = 5.0
    energy: float = 0.002
    rating: float = 2000.0

    def __post_init__(self) -> None:
        limits = {
            "penetration": (0.0, 1e3, ""),
            "other_motions": (0.0, 1.0, ""),
            "force": (0.0, 1e3, "mm/s per kN"),
            "energy": (0.0, 1e3, "mm/s per W"),
            "rating": (100.0, 1e5, "N"),
        }
        for name, (low, high, unit) in limits.items():
            object.__setattr__(self, name, number(f"reward {name}", getattr(self, name), low, high, unit))

    def as_record(self) -> dict[str, float]:
        """The weights as JSON takes them; :func:`read_reward` reads them back."""
        return asdict(self)

    def as_array(self) -> np.ndarray:
        """(5,) for the kernels, in the order of the arguments."""
        return np.array([getattr(self, field.name) for field in fields(self)])


def read_reward(record: Reward | Mapping[str, float] | None) -> Reward:
    """The weights of a record such as ``{"force": 10.0}``; what it leaves out keeps its default.

    Raises:
        InputError: not a record, an unknown weight, or one out of range.
    """
    if record is None:
        return Reward()
    if isinstance(record, Reward):
        return record
    names = [field.name for field in fields(Reward)]
    if not isinstance(record, Mapping):
        raise InputError(f"reward is {shown(record)}: give a record of weights ({', '.join(names)})")
    for name in record:
        if name not in names:
            raise InputError(f"reward has no weight {shown(name)}: its weights are {', '.join(names)}")
    return Reward(**record)


@njit(**KERNEL)
def score(truth: np.ndarray, weights: np.ndarray) -> float:
    """The reward in mm/s of a row of truth; ``weights`` from :meth:`Reward.as_array`."""
    truth, weights = borrowed(truth), borrowed(weights)
    worth = weights[1] + (1.0 - weights[1]) * truth[T_STRONG]
    return weights[0] * truth[T_RATE] * worth - weights[2] * 1e-3 * truth[T_EXCESS] - weights[3] * truth[T_DRIVE]
