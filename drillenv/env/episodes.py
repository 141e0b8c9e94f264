"""An episode before it runs: the rocks in their order, the rig, and how both are drawn at random."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drillenv.checks import InputError, count, number, shown
from drillenv.env.plant import LAYER_SIZE, MOST_LAYERS, RIG_SIZE
from drillenv.rig import TOLERANCES, Rig, Setting
from drillenv.rocks import ROCKS, STIFFNESS_LIMITS, Rock

START = Setting(frequency=85.0, amplitude=0.45, pressure=0.6)
"""The setting at which every episode begins, for one interval."""
LAG_RANGE = (0.3, 1.0)
"""Time constants in s with which a cylinder of the rig's size fills."""
BLOWS_RANGE = (1, 10)
"""Impacts that do to a face what one indentation of Table 2.2 did: those went to 3 kN, the strongest blows measured."""
THICKNESS_RANGE = (5e-3, 20e-3)
"""Thickness of a layer in m: 3 to 10 s of drilling."""
DRILLED_AT_MOST = 0.3
"""Depth in m that no rig reaches in the 60 s of an episode (at 5 mm/s)."""
MOST_ERRORS = 10.0
"""Stated errors that a rig may be off by: beyond, its damping could come to nothing."""
FARTHEST = 3.0
"""Standard deviations at which a draw of a constant is cut off."""
KEYS = ("layers", "lag", "blows", "phase", "rig", "effects")


@dataclass(frozen=True, slots=True)
class Episode:
    """What an episode is made of. Nothing in it is random any more, but for the noise of the sensors.

    Args:
        layers: (m, 4) stable loading and unloading stiffness in N/m, depth of the lower end in m (inf for the last),
            and the case of Table 2.2 after which a fresh face stiffens (0: it does not).
        lag: Time constant of the pressure in s.
        blows: Impacts that an indentation of Table 2.2 lasts.
        phase: Of the excitation at the start, in rad.
        rig: (6,) m1, m2, k, c, drive and pressure gain.
        effects: Names of effects beyond the paper's model, with the values of their parameters by symbol.
    """

    layers: np.ndarray
    lag: float
    blows: int
    phase: float
    rig: np.ndarray
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def as_record(self) -> dict[str, Any]:
        """The episode as JSON takes it: stiffnesses in MN/m, thicknesses in mm."""
        tops = np.concatenate([[0.0], self.layers[:-1, 2]])
        thickness = (self.layers[:, 2] - tops) * 1e3
        return {
            "layers": [
                [round(kl / 1e6, 4), round(ku / 1e6, 4), round(mm, 4) if math.isfinite(mm) else None, int(case)]
                for (kl, ku, _end, case), mm in zip(self.layers.tolist(), thickness.tolist(), strict=True)
            ],
            "lag": round(self.lag, 4),
            "blows": self.blows,
            "phase": round(self.phase, 4),
            "rig": rig_record(self.rig),
            "effects": {name: dict(values) for name, values in self.effects.items()},
        }


def rig_array(rig: Rig) -> np.ndarray:
    """(RIG_SIZE,) the constants of a rig, in the order of TOLERANCES."""
    return np.array([getattr(rig, name) for name in TOLERANCES])


def rig_record(rig: np.ndarray) -> dict[str, float]:
    """The constants (6,) of a rig as JSON takes them."""
    return {name: round(value, 6) for name, value in zip(TOLERANCES, rig.tolist(), strict=True)}


def read_rig(record: object, where: str) -> np.ndarray:
    """(6,) the constants of a record as :func:`rig_record` makes it; ``where`` names it in messages.

    Raises:
        InputError: a constant is missing or unknown, of the wrong kind or out of range.
    """
    if not isinstance(record, Mapping) or set(record) != set(TOLERANCES):
        raise InputError(f"{where}: rig is {shown(record)}: give a record with {', '.join(TOLERANCES)}")
    return rig_array(Rig(**record))


def read_episode(record: object, where: str) -> Episode:
    """The episode of a record as :meth:`Episode.as_record` makes it; ``where`` names it in messages.

    Raises:
        InputError: a key is missing or unknown, or a value is of the wrong kind or out of range.
    """
    if not isinstance(record, Mapping) or set(record) != set(KEYS):
        raise InputError(f"{where} is {shown(record)}: give a record with {', '.join(KEYS)}")
    layers = read_layers(
        record["layers"],
        where,
        "thickness in mm, case or 0",
        lambda name, given: number(f"{name} thickness", given, 0.1, 1e6, "mm") * 1e-3,
        lambda name, given: count(f"{name} case", given, 0, len(ROCKS)),
    )
    return Episode(
        layers=layers,
        lag=number(f"{where} lag", record["lag"], 1e-3, 100.0, "s"),
        blows=count(f"{where} blows", record["blows"], 1, 1_000_000),
        phase=number(f"{where} phase", record["phase"], 0.0, 2 * math.pi, "rad") % (2 * math.pi),
        rig=read_rig(record["rig"], where),
        effects=read_effects(record["effects"], where),
    )


def read_layers(
    rows: object,
    where: str,
    form: str,
    thickness: Callable[[str, object], float],
    fourth: Callable[[str, object], float],
) -> np.ndarray:
    """(m, LAYER_SIZE) the layers of a record: stiffnesses in N/m, depth of the lower end in m, and a fourth number.

    Args:
        rows: As JSON has them.
        where: Names the record in messages.
        form: What the third and the fourth number of a row are, for messages.
        thickness: Reads the third in m, given the name of the layer.
        fourth: Reads the fourth.

    Raises:
        InputError: not such rows, or a value of the wrong kind or out of range.
    """
    if not isinstance(rows, list) or not 1 <= len(rows) <= MOST_LAYERS:
        raise InputError(f"{where}: layers is {shown(rows)}: give a list of 1 to {MOST_LAYERS} layers")
    layers, end = np.empty((len(rows), LAYER_SIZE)), 0.0
    low, high = STIFFNESS_LIMITS
    for j, row in enumerate(rows):
        name = f"{where}, layer {j}"
        if not isinstance(row, list) or len(row) != LAYER_SIZE:
            raise InputError(f"{name} is {shown(row)}: give [k_l in MN/m, k_u in MN/m, {form}]")
        kl = number(f"{name} k_l", row[0], low / 1e6, high / 1e6, "MN/m") * 1e6
        ku = number(f"{name} k_u", row[1], kl / 1e6, high / 1e6, "MN/m") * 1e6
        if j == len(rows) - 1:
            if row[2] is not None:
                raise InputError(f"{name} has a thickness of {shown(row[2])}: the last layer has none, give null")
            end = math.inf
        else:
            end += thickness(name, row[2])
        layers[j] = kl, ku, end, fourth(name, row[3])
    return layers


def read_effects(record: object, where: str) -> dict[str, dict[str, Any]]:
    """Effects by name with their parameters, checked against the registry.

    Raises:
        InputError: not such a record, or an effect or parameter that the registry does not have or allow.
    """
    if not isinstance(record, Mapping):
        raise InputError(f"{where}: effects is {shown(record)}: give a record of effects and their parameters")
    if not record:
        return {}
    from drillenv.dynamics.effects import make

    for name, values in record.items():
        if not isinstance(values, Mapping) or not isinstance(name, str):
            raise InputError(f"{where}: effect {shown(name)} is {shown(values)}: give a record of its parameters")
        try:
            make(name, **values)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
    return {name: dict(values) for name, values in record.items()}


def draw_rocks(cases: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(m, 2) loading and unloading stiffness in N/m of rocks of these cases of Table 2.2, with its measured spread.

    As :meth:`drillenv.Rock.drawn`, many at a time.
    """
    table = np.array(
        [(r.loading_stiffness, r.unloading_stiffness, r.loading_spread, r.unloading_spread) for r in ROCKS.values()]
    )[cases - 1]
    drawn = np.empty((len(cases), 2))
    wrong = np.ones(len(cases), dtype=bool)
    low, high = STIFFNESS_LIMITS
    while wrong.any():
        drawn[wrong] = rng.normal(table[wrong, :2], table[wrong, 2:])
        wrong = ~((low <= drawn[:, 0]) & (drawn[:, 0] <= drawn[:, 1]) & (drawn[:, 1] <= high))
    return drawn


def one_rock(rock: Rock, case: int) -> np.ndarray:
    """(1, 4) a single layer without end."""
    return np.array([[rock.loading_stiffness, rock.unloading_stiffness, math.inf, float(case)]])


def draw_layers(rng: np.random.Generator, beyond: bool = False) -> np.ndarray:
    """(m, 4) layers of random thickness; neighbours are of different cases.

    ``beyond``: rocks outside Table 2.2 instead, softer than case 2 or harder than case 5.
    """
    low, high = THICKNESS_RANGE
    ends = np.cumsum(rng.uniform(low, high, MOST_LAYERS))
    m = int(np.searchsorted(ends, DRILLED_AT_MOST)) + 1
    ends = ends[:m]
    ends[-1] = math.inf
    steps = rng.integers(1, len(ROCKS), m)
    cases = (rng.integers(0, len(ROCKS)) + np.cumsum(steps)) % len(ROCKS) + 1
    rocks = _rocks_beyond(m, rng) if beyond else draw_rocks(cases, rng)
    return np.column_stack([rocks, ends, cases])


def _rocks_beyond(m: int, rng: np.random.Generator) -> np.ndarray:
    """(m, 2) stiffnesses of rocks outside Table 2.2: k_l of 4 to 9 or 42 to 70 MN/m, k_u 1.05 to 1.6 times that."""
    kl = np.where(rng.random(m) < 0.5, rng.uniform(4e6, 9e6, m), rng.uniform(42e6, 70e6, m))
    return np.column_stack([kl, kl * rng.uniform(1.05, 1.6, m)])


def read_errors(given: float | None, usual: float, rig: np.ndarray, frozen: bool) -> float:
    """How many stated errors the constants of ``rig`` (6,) are to be off by, ``usual`` where None is given.

    Raises:
        InputError: not a number from 0 to MOST_ERRORS, so many that a constant could come to what no rig has, or any
            where a scenario has ``frozen`` the rigs.
    """
    errors = usual if given is None else number("errors", given, 0.0, MOST_ERRORS)
    if frozen and given is not None and errors:
        raise InputError(f"errors is {errors:g}, but scenario fixes the rigs: leave one of the two out")
    least = rig - FARTHEST * errors * _spread()
    try:
        Rig(**dict(zip(TOLERANCES, least.tolist(), strict=True)))
    except InputError as error:
        said = str(error).partition(":")[0]
        raise InputError(f"errors is {errors:g}, with which {said}: give fewer errors, 0 for none") from None
    return errors


def draw_rig(rig: np.ndarray, rng: np.random.Generator, errors: float = 1.0) -> np.ndarray:
    """(6,) constants drawn about those of ``rig`` with ``errors`` times the error that a lab has on them."""
    return rig + errors * _spread() * np.clip(rng.standard_normal(RIG_SIZE), -FARTHEST, FARTHEST)


def _spread() -> np.ndarray:
    """(6,) the error that a lab has on each constant of a rig."""
    return np.array(list(TOLERANCES.values()))


def draw_effect(rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """One effect of this package that acts on the drilling rig's motion, at a strength that a lab might meet.

    Effects of other distributions are left out, so that a seed draws the same wherever it is drawn.
    """
    from drillenv.dynamics.effects import LIBRARY, drawn

    acting = [name for name, effect in LIBRARY.items() if effect.moves_rig]
    chosen = drawn(acting[int(rng.integers(len(acting)))], rng)
    return {chosen.effect.name: chosen.given}
