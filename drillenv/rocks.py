"""The six rock-indenter pairs of Table 2.2, and rocks of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from drillenv.checks import InputError, number, shown
from drillenv.checks import choice as one_of

STIFFNESS_LIMITS = (1e5, 1e9)  # N/m
YOUNG_MODULUS_LIMITS = (1e8, 1e12)  # Pa
# A spread below this share of its stiffness is no measurement; it is the spread in another unit than N/m.
SMALLEST_SPREAD = 1e-4
_SLIPS = [(1e6, "kN/mm"), (1e3, "N/mm or kN/m"), (1e9, "MN/mm")]


@dataclass(frozen=True, slots=True)
class Indentations:
    """The quasi-static indentations of one rock-indenter pair, in order, in N/m; of Table 2.2 there are ten.

    The first is the phase *impact*, the others of the ``early`` ones are *compression*, the rest *stable*.
    """

    loading: tuple[float, ...]
    unloading: tuple[float, ...]
    early: int = 5
    """How many come before the stable ones."""

    def phase(self, name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Loading and unloading stiffness of phase ``impact``, ``compression`` or ``stable``.

        Raises:
            InputError: no such phase.
        """
        first = min(self.early, 1)
        parts = {
            "impact": slice(0, first),
            "compression": slice(first, self.early),
            "stable": slice(self.early, None),
        }
        part = parts[one_of("phase", name, tuple(parts))]
        return self.loading[part], self.unloading[part]


@dataclass(frozen=True, slots=True)
class Rock:
    """A rock under an indenter: force k_l (X2 - Xp) while loading, k_u (X2 - Xf) while unloading.

    Args:
        loading_stiffness: k_l in N/m.
        unloading_stiffness: k_u in N/m, not below k_l (a softer way back would give energy away).
        name: For people, on one line.
        loading_spread, unloading_spread: Standard deviations in N/m, 0 where unknown, else at least 1e-4 of the
            stiffness.
        young_modulus: Of the rock in Pa, where known.
        indentations: The measurements behind the means, where known.

    Raises:
        InputError: a stiffness is no finite number, outside 1e5 to 1e9 N/m, or k_u < k_l; another value is of the
            wrong kind or outside its limits.
    """

    loading_stiffness: float
    unloading_stiffness: float
    name: str = "custom"
    loading_spread: float = 0.0
    unloading_spread: float = 0.0
    young_modulus: float | None = None
    indentations: Indentations | None = None

    def __post_init__(self) -> None:
        for field in ("loading_stiffness", "unloading_stiffness"):
            value = number(field, getattr(self, field), *STIFFNESS_LIMITS, "N/m", _SLIPS)
            object.__setattr__(self, field, value)
        if self.unloading_stiffness < self.loading_stiffness:
            raise InputError(
                f"unloading_stiffness is {shown(self.unloading_stiffness)} N/m, below loading_stiffness "
                f"{shown(self.loading_stiffness)} N/m: such a rock would give energy away; give k_u >= k_l"
            )
        for field, stiffness in (
            ("loading_spread", self.loading_stiffness),
            ("unloading_spread", self.unloading_stiffness),
        ):
            object.__setattr__(self, field, _spread(field, getattr(self, field), stiffness))
        if self.young_modulus is not None:
            slips = [(1e9, "GPa"), (1e6, "MPa")]
            modulus = number("young_modulus", self.young_modulus, *YOUNG_MODULUS_LIMITS, "Pa", slips)
            object.__setattr__(self, "young_modulus", modulus)
        _check_kind(self.name, self.indentations)

    def drawn(self, rng: np.random.Generator) -> Rock:
        """A rock of this kind with both stiffnesses drawn from their measured spread.

        Normal, independent, and drawn again (both) while a value leaves the allowed range or k_u < k_l.
        """
        low, high = STIFFNESS_LIMITS
        while True:
            loading = rng.normal(self.loading_stiffness, self.loading_spread)
            unloading = rng.normal(self.unloading_stiffness, self.unloading_spread)
            if low <= loading <= unloading <= high:
                break
        return Rock(float(loading), float(unloading), f"{self.name}, drawn", young_modulus=self.young_modulus)


def _spread(field: str, value: object, stiffness: float) -> float:
    """A standard deviation of ``stiffness`` in N/m: 0 where unknown, else a believable share of it."""
    if number(field, value, 0.0, stiffness, "N/m") == 0:
        return 0.0
    try:
        return number(field, value, SMALLEST_SPREAD * stiffness, stiffness, "N/m", _SLIPS)
    except InputError as error:
        raise InputError(f"{error}, or 0 where unknown") from None


def _check_kind(name: object, indentations: object) -> None:
    """Refuse a name that a report could not print on one line, and measurements that are none."""
    if not isinstance(name, str) or not name.isprintable() or not name.strip():
        raise InputError(f"name is {shown(name)}: give a name on one line")
    if not isinstance(indentations, Indentations | None):
        raise InputError(f"indentations is {shown(indentations)}: give Indentations(loading, unloading) or None")


def _row(
    sandstone: int, angle: int, loading: str, unloading: str, mean: tuple[float, float], spread: tuple[float, float]
) -> Rock:
    """One case of Table 2.2, whose stiffnesses are printed in kN/mm."""
    kilo = 1e6
    return Rock(
        round(mean[0] * kilo, 3),
        round(mean[1] * kilo, 3),
        f"sandstone{sandstone}-indenter{angle}",
        round(spread[0] * kilo, 3),
        round(spread[1] * kilo, 3),
        {1: 4.80e9, 2: 28.51e9}[sandstone],
        Indentations(
            tuple(round(float(x) * kilo, 3) for x in loading.split()),
            tuple(round(float(x) * kilo, 3) for x in unloading.split()),
        ),
    )


# Table 2.2. The printed means are kept even where they do not follow from the five measurements printed as stable
# (case 4 gives 20.81 kN/mm, the paper prints 21.40): they are those of the last 5, 7, 7, 4, 6 and 6 indentations.
ROCKS = MappingProxyType(
    {
        1: _row(
            1,
            30,
            "8.17 11.32 11.29 11.62 11.34 11.98 11.77 11.73 12.43 12.45",
            "13.26 13.52 13.42 13.39 13.71 13.89 13.82 14.06 13.60 13.12",
            (12.07, 13.70),
            (0.35, 0.37),
        ),
        2: _row(
            1,
            45,
            "6.70 12.03 11.68 11.68 11.92 12.10 11.71 11.38 11.98 11.99",
            "14.28 14.27 13.68 14.00 13.99 14.17 13.98 13.80 13.83 13.51",
            (11.82, 13.90),
            (0.25, 0.21),
        ),
        3: _row(
            1,
            60,
            "6.47 11.01 11.26 11.42 12.15 11.55 12.11 11.45 11.67 11.69",
            "13.23 13.43 13.11 12.90 13.43 13.70 13.23 13.03 13.95 13.66",
            (11.72, 13.41),
            (0.30, 0.38),
        ),
        4: _row(
            2,
            30,
            "5.42 17.14 15.95 18.04 19.07 18.44 21.37 22.03 20.67 21.55",
            "21.57 21.75 23.55 22.37 25.65 23.95 24.24 24.25 26.35 25.36",
            (21.40, 25.05),
            (0.56, 1.01),
        ),
        5: _row(
            2,
            45,
            "3.03 16.81 26.18 29.14 30.77 30.96 31.69 34.11 32.98 35.88",
            "37.88 37.80 39.66 38.10 40.61 40.00 43.97 37.78 40.25 41.23",
            (32.73, 40.64),
            (2.00, 2.01),
        ),
        6: _row(
            2,
            60,
            "5.16 19.12 19.67 18.79 21.59 21.95 22.32 21.94 22.80 21.58",
            "25.87 22.96 31.98 28.92 26.16 27.38 28.78 29.67 24.77 26.08",
            (22.03, 27.14),
            (0.47, 1.84),
        ),
    }
)


def rock(choice: int | str | Path | Rock) -> Rock:
    """The rock meant by a case number of Table 2.2 (1 to 6, also as text), its name, a rock file, or a Rock itself.

    A rock file is a path that ends in .json.

    Raises:
        InputError: no such rock.
    """
    if isinstance(choice, Rock):
        return choice
    if isinstance(choice, str | Path) and str(choice).strip().lower().endswith(".json"):
        from drillenv.rock_file import read_rock

        return read_rock(choice)
    names = {pair.name: pair for pair in ROCKS.values()}
    if isinstance(choice, str):
        text = choice.strip().lower().replace(" ", "")
        known = names | {str(case): pair for case, pair in ROCKS.items()}
        if text in known:
            return known[text]
    # Callers without a type checker hand in floats and arrays too.
    if isinstance(choice, int | np.integer) and not isinstance(choice, bool) and int(choice) in ROCKS:
        return ROCKS[int(choice)]
    raise InputError(
        f"rock is {shown(choice)}: give a case of Table 2.2 (1 to 6), its name ({', '.join(names)}), "
        "a rock file (.json), or Rock(loading_stiffness, unloading_stiffness) in N/m"
    )
