"""The units that a campaign may be written in, and their factors to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from drillenv.checks import InputError, shown

STANDARD_GRAVITY = 9.80665
"""m/s^2, one g by definition."""

_VOLTAGE = {"V": 1.0, "mV": 1e-3}
_FORCE = {"N": 1.0, "kN": 1e3}
_ACCELERATION = {"m/s^2": 1.0, "g": STANDARD_GRAVITY}
_LENGTH = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_SPEED = {"m/s": 1.0, "mm/s": 1e-3}
_PRESSURE = {"bar": 1e5, "kPa": 1e3}
_TIME = {"s": 1.0, "ms": 1e-3}

CHANNEL_UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "excitation": _VOLTAGE,
        "force": _FORCE,
        "acceleration": _ACCELERATION,
        "position": _LENGTH,
        "velocity": _SPEED,
        "pressure": _PRESSURE,
        "time": _TIME,
    }
)
"""Of each channel the units it may have, as the format lists them, with their factors to SI (V, N, m, s, Pa)."""

MASS = {"kg": 1.0, "g": 1e-3, "t": 1e3}
STIFFNESS = {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3, "kN/mm": 1e6, "MN/m": 1e6}
DAMPING = {"N*s/m": 1.0, "kN*s/m": 1e3, "N*s/mm": 1e3, "kg/s": 1.0}
GAIN = {"1": 1.0}
FORCE = _FORCE

# Other ways to spell the same unit. None of them can mean anything else.
_SPELLINGS = {
    "m/s2": "m/s^2",
    "m/s**2": "m/s^2",
    "m/s\N{SUPERSCRIPT TWO}": "m/s^2",
    "\N{MICRO SIGN}m": "um",
    "\N{GREEK SMALL LETTER MU}m": "um",
    "": "1",
    "-": "1",
    "N s/m": "N*s/m",
    "Ns/m": "N*s/m",
    "N\N{MIDDLE DOT}s/m": "N*s/m",
    "N.s/m": "N*s/m",
    "kN s/m": "kN*s/m",
    "kNs/m": "kN*s/m",
    "N s/mm": "N*s/mm",
    "Ns/mm": "N*s/mm",
}


TIME_UNITS: Mapping[str, float] = MappingProxyType({**_TIME, "us": 1e-6})
"""Of a file's own time, which may be finer than a channel's."""

_WORDS = {
    "newton": "N",
    "newtons": "N",
    "kilonewton": "kN",
    "kilonewtons": "kN",
    "volt": "V",
    "volts": "V",
    "millivolt": "mV",
    "millivolts": "mV",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "sek": "s",
    "sekunden": "s",
    "msec": "ms",
    "milliseconds": "ms",
    "\N{MICRO SIGN}s": "us",
    "\N{GREEK SMALL LETTER MU}s": "us",
    "m/s/s": "m/s^2",
    "ms-2": "m/s^2",
    "ms^-2": "m/s^2",
    "g_n": "g",
    "gn": "g",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "micron": "um",
    "microns": "um",
}
"""Other ways in which files, but not campaign.json, may spell a unit; looked up in small letters."""
_FOREIGN = {"Pa", "hPa", "MPa", "mbar", "psi", "kgf", "lbf", "cm", "in", "ft", "Hz", "%", "A", "mA", "C", "K"} | {
    f"\N{DEGREE SIGN}{letter}" for letter in "CFK"
}
"""Units that a file may name, and a campaign not have."""
_BRACKETED = re.compile(r"^(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_AFTER_SLASH = re.compile(r"^(.*?)\s*(?:/|\bin)\s+(\S+)$|^([^/\s]+)/(\S+)$")
_AFTER_UNDERSCORE = re.compile(r"^(.+)_([^_]+)$")


def known_unit(text: str) -> str | None:
    """The unit that a cell or a label of a file spells, with or without brackets; None where it is none."""
    bare = text.strip().strip("[]()").strip()
    spelled = _SPELLINGS.get(bare, bare) if bare not in ("", "-") else ""
    spelled = _WORDS.get(bare.lower(), spelled)
    every = {unit for units in CHANNEL_UNITS.values() for unit in units} | set(TIME_UNITS) | _FOREIGN
    if spelled in every:
        return spelled
    lowered = {unit.lower(): unit for unit in ("kN", "V", "N", "bar", "kPa", "mm/s", "m/s")}
    return lowered.get(spelled.lower())


def _parted(name: str) -> tuple[str, str | None]:
    """A column's name without its unit, and the unit: ``force [kN]``, ``t (s)``, ``Zeit/s``, ``force_kN``."""
    match = re.match(r"^(.+)_m_s(2?)$", name.strip())
    if match:
        return match[1], "m/s^2" if match[2] else "m/s"
    for pattern in (_BRACKETED, _AFTER_SLASH, _AFTER_UNDERSCORE):
        match = pattern.match(name.strip())
        if match:
            bare, text = (part for part in match.groups() if part is not None)
            for spelled in (text, text.replace("_", "/"), text.replace("s2", "s^2")):
                unit = known_unit(spelled)
                if unit is not None:
                    return bare, unit
    return name, None


def named_unit(name: str) -> str | None:
    """The unit that a column's name gives; the whole name where it is one."""
    return known_unit(name) or _parted(name)[1]


def without_unit(name: str) -> str:
    """A column's name without the unit that it gives."""
    return _parted(name)[0]


def unit_of(where: str, given: object, allowed: Mapping[str, float]) -> str:
    """The unit of ``allowed`` that ``given`` spells.

    Raises:
        InputError: it is none of them.
    """
    spelled = _SPELLINGS.get(given, given) if isinstance(given, str) else given
    if isinstance(spelled, str) and spelled in allowed:
        return spelled
    raise InputError(f"{where} is {shown(given)}: give {' or '.join(allowed)}")


# --------------------------------------------------------------------------------------------------------------------
# mistaken units

_FACTORS = (STANDARD_GRAVITY, 1000.0 / STANDARD_GRAVITY, 1e3, 1e3 * STANDARD_GRAVITY, 1e6)
SLIPS = (0.0, *(sign * math.log(factor) for factor in _FACTORS for sign in (1.0, -1.0)))
"""Logarithms of the factors that mistaken units make: g for m/s^2, kN for N, kgf for N, both at once; 0 for none."""
SLIP_MARGIN = math.log(2.2)
"""How far from such a factor a balance may lie that physics outside the model moves, by tens of percent. The factors
are 9.8 or more apart."""
NEAR = math.log(1.3)
"""The same where nothing but noise may move it, as with an amplitude held against its setting."""


def slip_of(ratio: float, margin: float = SLIP_MARGIN) -> float:
    """The logarithm of the unit factor that a ratio, above 0, is near; 0 where it is near none."""
    if not 0.0 < ratio < math.inf:
        return 0.0
    size = math.log(ratio)
    nearest = min(SLIPS, key=lambda slip: abs(slip - size))
    return nearest if abs(nearest - size) < margin else 0.0


def how_much(slip: float) -> str:
    """How far off a channel reads, for a message."""
    return f"{math.exp(abs(slip)):.4g} times too {'large' if slip > 0 else 'small'}"
