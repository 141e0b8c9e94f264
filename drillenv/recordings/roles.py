"""Which column of a file is which channel, by usual names and by units."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.recordings.campaign import Campaign, Channel, Recording
from drillenv.recordings.contents import Contents
from drillenv.recordings.document import BODY_CHANNELS, DRILL, DRILL_CHANNELS, Nominal
from drillenv.recordings.excitation import strongest_tone
from drillenv.recordings.quality import check_quality
from drillenv.recordings.signal_faults import ABSURD
from drillenv.recordings.units import CHANNEL_UNITS, unit_of, without_unit
from drillenv.rig import Setting

_WORDS = {
    "excitation": r"excit|anreg|\bdriv|generator|command|soll|\bsignal|volt|spannung|\binput\b|\bsine?\b|\bsinus",
    "force": r"force|kraft|\bload|fuerza|\bf ?[zn]?\d*\b|\blc\d*\b|dms",
    "acceleration": r"acc|beschl|\ba ?[xyz]?\d*\b",
    "position": r"disp|posit|\bpos\b|\bweg|lvdt|laser|\bx\d*\b|auslenk",
    "velocity": r"veloc|speed|geschw|\bvel\b|\bv\d*\b",
    "pressure": r"press|druck|\bp\d*\b",
}
PURE = 0.95
"""The share of its variance in one tone, from which a column that nothing names is taken for the excitation."""
TRIED = 65536
"""Samples by which a unit is settled."""


@dataclass(frozen=True, slots=True)
class Role:
    """The column of a channel."""

    column: str
    unit: str
    source: str
    """What says so."""
    guessed: bool = False
    unit_guessed: bool = False


def find_roles(contents: Contents, rig: str, told: Mapping[str, Sequence[str]]) -> dict[str, Role]:
    """The columns of a file that are channels, in the order in which the format lists channels.

    Args:
        contents: Of the file.
        rig: Which channels there may be.
        told: Of a channel, its column and, if need be, its unit.

    Raises:
        InputError: ``told`` names no channel of this rig, or a unit that the channel may not have.
    """
    known = [name for name in (DRILL_CHANNELS if rig == DRILL else BODY_CHANNELS) if name != "time"]
    found: dict[str, Role] = {}
    for name, (column, *rest) in told.items():
        if name not in known:
            raise InputError(f"--channel {name} is no channel of the rig {rig}: give {', '.join(known)}")
        if column in contents.units:
            unit, guessed = _unit(contents, name, column, rest[0] if rest else None, rig)
            found[name] = Role(column, unit, "--channel", unit_guessed=guessed)
    taken = {role.column for role in found.values()}
    scored = sorted(
        (
            (-_score(name, column, contents.units[column]), known.index(name), place, name, column)
            for name in known
            for place, column in enumerate(contents.units)
        ),
    )
    for score, _, _, name, column in scored:
        if score == 0 or name in found or column in taken:
            continue
        if score == -1 and name == "excitation" and not _is_tone(contents, column):
            continue
        unit, guessed = _unit(contents, name, column, None, rig)
        by = {-3: "its name and unit", -2: "its name", -1: "its unit"}[score]
        found[name] = Role(column, unit, by, score == -1 or guessed, guessed)
        taken.add(column)
    if rig == DRILL and "excitation" not in found:
        _add_tone(contents, found, taken, rig)
    return {name: found[name] for name in known if name in found}


def _score(channel: str, column: str, unit: str | None) -> int:
    """3 where name and unit fit, 2 where the name does, 1 where the unit does and the name says nothing else."""
    if unit is not None and unit not in CHANNEL_UNITS[channel]:
        return 0
    named = _named(column)
    if channel in named:
        return 3 if unit is not None else 2
    return 1 if unit is not None and not named else 0


def _named(column: str) -> set[str]:
    """The channels that a column's name may mean."""
    last = without_unit(column).rpartition("/")[2]  # the group before it says little
    bare = re.sub(r"[_\W]+", " ", last).strip().lower()
    return {name for name, words in _WORDS.items() if re.search(words, bare)}


def _unit(contents: Contents, channel: str, column: str, stated: str | None, rig: str) -> tuple[str, bool]:
    """The unit of a column, and whether it is a guess by the size of its values."""
    units = CHANNEL_UNITS[channel]
    if stated is not None:
        return unit_of(f"--channel {channel}: unit of {shown(column)}", stated, units), False
    unit = contents.units[column]
    if unit is not None and unit in units:
        return unit, False
    peak = float(np.nanmax(np.abs(contents.table.columns[column]), initial=0.0))
    if channel == "excitation":
        return ("V" if peak < 10.0 else "mV"), True
    if channel == "force":
        return ("kN" if peak < 20.0 and rig == DRILL else "N"), True
    if channel == "pressure":
        return ("bar" if peak < 20.0 else "kPa"), True
    if channel == "position":
        return ("mm" if peak > 0.5 else "m"), True
    return ("m/s^2" if channel == "acceleration" else "m/s"), True


def _is_tone(contents: Contents, column: str) -> bool:
    samples = contents.table.columns[column][:TRIED]
    if not (np.abs(samples) < ABSURD).all() or np.ptp(samples) == 0.0:
        return False
    return strongest_tone(samples, contents.sample_rate or 1.0).purity > PURE


def _add_tone(contents: Contents, found: dict[str, Role], taken: set[str], rig: str) -> None:
    """A column that nothing names, in volts or without a unit, is the excitation if it alone is a pure tone."""
    free = [
        column
        for column, unit in contents.units.items()
        if column not in taken and unit in (None, "V", "mV") and not _named(column)
    ]
    pure = [column for column in free if _is_tone(contents, column)]
    if len(pure) == 1:
        unit, _ = _unit(contents, "excitation", pure[0], None, rig)
        found["excitation"] = Role(pure[0], unit, "its pure tone", True)


def settled_units(
    contents: Contents,
    roles: Mapping[str, Role],
    entry: Mapping[str, Any],
    nominal: Mapping[str, Mapping[str, Any]],
    channels: Sequence[str],
) -> dict[str, str]:
    """Units of ``channels`` under which the quality check finds no channel off by a unit; none where none does."""
    constants = {name: Nominal(each["value"], each.get("std"), each["unit"]) for name, each in nominal.items()}
    setting = Setting(**entry["setting"])
    options = [tuple(CHANNEL_UNITS[name]) for name in channels]
    guesses = tuple(roles[name].unit for name in channels)
    # the guess first, then what differs from it least
    tries = itertools.product(*options)
    for units in sorted(tries, key=lambda units: sum(a != b for a, b in zip(units, guesses, strict=True))):
        chosen = {name: roles[name].unit for name in roles} | dict(zip(channels, units, strict=True))
        samples = {
            name: Channel(
                contents.table.columns[role.column][:TRIED] * CHANNEL_UNITS[name][chosen[name]],
                chosen[name],
                role.column,
            )
            for name, role in roles.items()
        }
        recording = Recording(
            "r", contents.file, entry["sample_rate"], MappingProxyType(samples), entry["starts"], setting
        )
        campaign = Campaign("units", DRILL, MappingProxyType(constants), (recording,), Path("."))
        if not any(each.kind == "unit" for each in check_quality(campaign)):
            return {name: unit for name, unit in zip(channels, units, strict=True) if roles[name].unit_guessed}
    return {}
