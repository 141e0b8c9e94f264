"""The numbers behind the page to play with: ``python -m drillenv.playground docs/play`` writes its data files.

``constants.js`` holds the rig, the rocks, the box of the controls and the boundary of P-1-I-1 from an atlas;
``mechanisms.js`` what the rig's force and acceleration are with and without each effect of the library. Everything else
on the page is computed by ``engine.js`` in the browser.
"""

from __future__ import annotations

import argparse
import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray

from drillenv.atlas import load_atlas
from drillenv.dynamics.effects import LIBRARY, Channels, Chosen, Effect, make
from drillenv.dynamics.motion import motion
from drillenv.dynamics.sensors import record
from drillenv.files import whole
from drillenv.rig import (
    AMPLITUDE_RANGE,
    DRIVE_BASE,
    DRIVE_SLOPE,
    FREQUENCY_RANGE,
    PRESSURE_RANGE,
    PUSH,
    Rig,
    Setting,
)
from drillenv.rocks import ROCKS

ATLAS = Path("docs/atlas/atlas.nc")
PRESSURE_AXIS = 2
WEAK_FROM = 4.0
"""bar/V: P-1-I-1 above this ratio of pressure to amplitude is the weak kind, taps at a fraction of the force."""

PERIODS, SAMPLES = 3, 200
"""Excitation periods shown of each mechanism, and samples in each."""
LEAD = 6.0
"""s for which the rig runs before what is shown, so that it has settled."""
SENSING = 2.0
"""s for which a sensor is followed before what is shown: a high-pass forgets slowly."""
STRENGTHS = ("weak", "middle", "strong")


class Example(NamedTuple):
    """A setting at which mechanisms are shown."""

    rock: int
    setting: Setting


EXAMPLES = (
    Example(4, Setting(120.0, 0.45, 1.0)),
    Example(1, Setting(80.0, 0.50, 0.8)),
    Example(4, Setting(90.0, 0.45, 1.0)),
)
"""One strong blow a period on the hard and on the soft sandstone, and two blows a period."""


# --- Constants


def constants(atlas: xarray.Dataset) -> dict[str, Any]:
    """The rig, the rocks, the box and the boundaries of P-1-I-1 for ``constants.js``. SI, and Hz, V, bar."""
    rig = Rig()
    return {
        "rig": {
            "m1": rig.shaker_mass,
            "m2": rig.indenter_mass,
            "k": rig.stiffness,
            "c": rig.damping,
            "driveSlope": rig.drive_gain * DRIVE_SLOPE,
            "driveBase": rig.drive_gain * DRIVE_BASE,
            "push": rig.pressure_gain * PUSH,
        },
        "rocks": {
            case: {"name": pair.name, "kl": pair.loading_stiffness, "ku": pair.unloading_stiffness}
            for case, pair in ROCKS.items()
        },
        "box": {"frequency": FREQUENCY_RANGE, "amplitude": AMPLITUDE_RANGE, "pressure": PRESSURE_RANGE},
        "boundary": {case: _boundary(atlas, case) for case in ROCKS},
    }


def _boundary(atlas: xarray.Dataset, case: int) -> dict[str, list[list[float]]]:
    """Curves of (frequency in Hz, p / A in bar/V): ``strong`` P-1-I-1 lies below the one, ``weak`` above the other."""
    place = int(np.flatnonzero(atlas["rock"].values == case)[0])
    columns = (
        atlas[f"boundary_{name}"].values for name in ("rock", "axis", "side", "frequency", "pressure", "amplitude")
    )
    rock, axis, side, frequency, pressure, amplitude = columns
    ratio = pressure / amplitude
    here = (rock == place) & (axis == PRESSURE_AXIS)
    return {
        "strong": _curve(frequency, ratio, here & (side == -1) & (ratio < WEAK_FROM)),
        "weak": _curve(frequency, ratio, here & (side == 1) & (ratio > WEAK_FROM)),
        "weakEnd": _curve(frequency, ratio, here & (side == -1) & (ratio > WEAK_FROM)),
    }


def _curve(frequency: np.ndarray, ratio: np.ndarray, which: np.ndarray) -> list[list[float]]:
    """A point for each frequency: the boundary settings at one frequency differ in their ratio by rounding only."""
    return [
        [float(each), round(float(np.median(ratio[which & (frequency == each)])), 4)]
        for each in np.unique(frequency[which])
    ]


# --- Mechanisms


def shown_effects() -> tuple[Effect, ...]:
    """The effects of the library that act on the drilling rig or on its sensors."""
    return tuple(effect for effect in LIBRARY.values() if effect.moves_rig or effect.measure is not None)


def at_strength(effect: Effect, strength: str) -> Chosen:
    """The effect at one end or in the middle of its typical range; the weak end is the one nearer to no effect."""
    share = STRENGTHS.index(strength) / (len(STRENGTHS) - 1)
    values = {}
    for each in effect.parameters:
        weak, strong = sorted(each.typical, key=lambda value: abs(value - each.neutral))
        if weak == -strong:  # a phase, for which neither end is the weak one
            values[each.symbol] = 0.0
        elif weak > 0.0 and max(weak, strong) > 5.0 * min(weak, strong):
            values[each.symbol] = float(weak * (strong / weak) ** share)
        else:
            values[each.symbol] = weak + share * (strong - weak)
    return make(effect.name, **values)


def recorded(example: Example, chosen: Chosen | None, from_rest: bool) -> Channels:
    """What the sensors give over PERIODS excitation periods: settled, or the first ones from rest."""
    setting = example.setting
    moving = (chosen,) if chosen is not None and chosen.effect.moves_rig else ()
    sensing = (chosen,) if chosen is not None and chosen.effect.measure is not None else ()
    before = round(SENSING * setting.frequency) if sensing else 0
    rate = SAMPLES * setting.frequency
    channels = record(
        Rig(),
        setting,
        ROCKS[example.rock],
        (before + PERIODS) / setting.frequency,
        rate,
        effects=moving,
        sensors=sensing,
        lead=0.0 if from_rest else round(LEAD * setting.frequency) / setting.frequency,
    ).channels
    part = slice(before * SAMPLES, (before + PERIODS) * SAMPLES)
    return channels._replace(force=channels.force[part], acceleration=channels.acceleration[part])


def mechanism(effect: Effect, example: Example, strength: str) -> dict[str, Any]:
    """One effect at one setting: what it is set to, the motion with it, and packed force and acceleration."""
    chosen = at_strength(effect, strength)
    channels = recorded(example, chosen, effect.counted is not None)
    moving = (chosen,) if effect.moves_rig else ()
    return {
        "values": [float(f"{value:.4g}") for value in chosen.values],
        "motion": motion(example.setting, example.rock, effects=moving).label,
        **_packed(channels),
    }


def mechanisms() -> dict[str, Any]:
    """Everything on ``mechanisms.js``."""
    shown = shown_effects()
    return {
        "periods": PERIODS,
        "samples": SAMPLES,
        "strengths": STRENGTHS,
        "examples": [_example(example) for example in EXAMPLES],
        "effects": [_described(effect) for effect in shown],
        "runs": [
            [[mechanism(effect, example, strength) for strength in STRENGTHS] for example in EXAMPLES]
            for effect in shown
        ],
    }


def _example(example: Example) -> dict[str, Any]:
    """A setting with what the paper's model does there, settled and from rest."""
    setting = example.setting
    return {
        "rock": example.rock,
        "frequency": setting.frequency,
        "amplitude": setting.amplitude,
        "pressure": setting.pressure,
        "motion": motion(setting, example.rock).label,
        "settled": _packed(recorded(example, None, False)),
        "rest": _packed(recorded(example, None, True)),
    }


def _described(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "sentence": effect.sentence,
        "equation": effect.equation,
        "sensor": not effect.moves_rig,
        "rest": effect.counted is not None,
        "parameters": [
            {"symbol": each.symbol, "meaning": each.meaning, "unit": each.unit} for each in effect.parameters
        ],
    }


def _packed(channels: Channels) -> dict[str, Any]:
    """Force in N and acceleration in m/s^2 as 16-bit integers, little end first, in base64, and what one is worth."""
    packed = {}
    for name in ("force", "acceleration"):
        signal = getattr(channels, name)
        digit = float(f"{max(float(np.abs(signal).max()), 1e-9) / 32000.0:.6g}")
        integers = np.round(signal / digit).astype("<i2")
        packed[name] = {"digit": digit, "data": base64.b64encode(integers.tobytes()).decode("ascii")}
    return packed


# --- Files


def as_script(name: str, record: dict[str, Any]) -> str:
    """A classic script that defines one constant: a page opened from a file may load it, but not fetch JSON."""
    lines = (f"{json.dumps(key)}: {json.dumps(value, separators=(',', ':'))}" for key, value in record.items())
    text = ",\n  ".join(lines)
    return f'"use strict";\n// written by: python -m drillenv.playground docs/play\nconst {name} = {{\n  {text}\n}};\n'


def constants_script(atlas: Path = ATLAS) -> str:
    """The text of ``constants.js``."""
    script = as_script("CONSTANTS", constants(load_atlas(atlas)))
    return script + 'if (typeof module !== "undefined") module.exports = CONSTANTS;\n'


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the data files of the page into a folder."""
    parser = argparse.ArgumentParser(prog="python -m drillenv.playground", description=main.__doc__)
    parser.add_argument("folder", type=Path, help="such as docs/play")
    parser.add_argument(
        "--atlas", type=Path, default=ATLAS, help="NetCDF file of drillenv atlas (default: %(default)s)"
    )
    given = parser.parse_args(arguments)
    files = {"constants.js": constants_script(given.atlas), "mechanisms.js": as_script("MECHANISMS", mechanisms())}
    for name, text in files.items():
        with whole(given.folder / name) as path:
            path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
