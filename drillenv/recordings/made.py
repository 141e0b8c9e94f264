"""Made campaigns: the rig simulated with effects of one's choice, and recorded by sensors with noise."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from drillenv.checks import InputError, choice, count, number, shown
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.motion_hybrid import effects_meant
from drillenv.dynamics.sensors import PerChannel, record
from drillenv.recordings.campaign import Channel, Recording
from drillenv.recordings.document import DRILL, SAMPLE_RATE_LIMITS, Nominal
from drillenv.recordings.write import FILE_FORMATS, check_new, write_campaign
from drillenv.rig import AMPLITUDE_RANGE, FREQUENCY_RANGE, PRESSURE_RANGE, TOLERANCES, Rig, Setting
from drillenv.rocks import Rock

NOISE = PerChannel(0.002, 5.0, 2.5)
"""V, N, m/s^2: standard deviations of white noise, as of a good load cell and accelerometer on such a rig."""
DIGITS = PerChannel(4, 1, 2)
"""Decimals that are written, far below the noise."""
UNITS = {"excitation": "V", "force": "N", "acceleration": "m/s^2"}
STEPS = {"frequency": 0.1, "amplitude": 0.01, "pressure": 0.01}
"""To which settings are made, in Hz, V and bar."""
LEAD = 1.0
"""s that the rig runs before a recording that starts running."""
SECONDS_LIMITS = (0.1, 60.0)
RECORDINGS_LIMITS = (3, 200)
ROCK_STD = 0.03
"""Of a stiffness whose spread was not measured, as a share."""


def make_campaign(
    folder: str | os.PathLike[str],
    rock: Rock,
    rig: Rig | None = None,
    effects: Iterable[Chosen] = (),
    recordings: int = 6,
    seconds: float = 0.4,
    sample_rate: float = 25600.0,
    seed: int = 0,
    file_format: str = "csv",
) -> Path:
    """Simulate a campaign and write it.

    Settings spread over the box that the paper explores. The last recording is of a fresh start, the others of a rig
    that had been running. What campaign.json gives as believed are the constants of ``rig`` and ``rock`` themselves,
    with the standard deviations of the paper's; the effects it does not tell.

    Args:
        folder: To be made; must not exist.
        rock: Under the indenter.
        rig: By default that of Table 2.1.
        effects: From :func:`drillenv.dynamics.effects.make`, on the motion or on sensors.
        recordings: How many, 3 to 200.
        seconds: Of each, 0.1 to 60.
        sample_rate: Samples a second.
        seed: All randomness comes from it: settings, phases, noise.
        file_format: "csv", "mat", "mat73", "h5" or "tdms".

    Returns:
        The folder, absolute.

    Raises:
        InputError: an argument of the wrong kind or outside its limits, an effect that the drilling rig does not have,
            or a folder that exists or cannot be made.
    """
    rig = rig or Rig()
    chosen = effects_meant(effects)
    sensors = tuple(each for each in chosen if each.effect.measure is not None)
    forces = tuple(each for each in chosen if each.effect.measure is None)
    for each in forces:
        if not each.effect.moves_rig:
            raise InputError(f"effect {each.effect.name} is one of a one-body rig: give one of the drilling rig")
    choice("file_format", file_format, tuple(FILE_FORMATS))
    many = count("recordings", recordings, *RECORDINGS_LIMITS)
    seconds = number("seconds", seconds, *SECONDS_LIMITS, "s")
    rate = number("sample_rate", sample_rate, *SAMPLE_RATE_LIMITS[DRILL], "Hz")
    rng = np.random.default_rng(count("seed", seed, 0, 2**53))
    check_new(folder)
    made = []
    for i, setting in enumerate(spread_settings(many, rng), 1):
        starts = "fresh" if i == many else "running"
        channels = _recorded(rig, rock, setting, starts, seconds, rate, forces, sensors, rng)
        made.append(Recording(f"r{i:02d}", f"r{i:02d}", rate, channels, starts, setting))
    title = f"made: {rock.name}, seed {seed}"
    return write_campaign(folder, title, DRILL, believed(rig, rock), made, file_format, "simulated by drillenv")


def _recorded(
    rig: Rig,
    rock: Rock,
    setting: Setting,
    starts: str,
    seconds: float,
    sample_rate: float,
    effects: Iterable[Chosen],
    sensors: Iterable[Chosen],
    rng: np.random.Generator,
) -> Mapping[str, Channel]:
    """The channels of one recording."""
    fresh = starts == "fresh"
    read = record(
        rig,
        setting,
        rock,
        seconds,
        sample_rate,
        effects=effects,
        sensors=sensors,
        # a fresh start begins where the generator was switched on; any other somewhere
        phase=0.0 if fresh else float(rng.uniform(0.0, 2 * np.pi)),
        lead=0.0 if fresh else LEAD,
        noise=NOISE,
        rng=rng,
    ).channels
    return MappingProxyType(
        {
            name: Channel(np.round(getattr(read, name), getattr(DIGITS, name)) + 0.0, unit, name)  # no -0.0
            for name, unit in UNITS.items()
        }
    )


def spread_settings(many: int, rng: np.random.Generator) -> list[Setting]:
    """Settings that cover each control's range evenly: one in each of ``many`` equal parts, in random order."""
    ranges = {"frequency": FREQUENCY_RANGE, "amplitude": AMPLITUDE_RANGE, "pressure": PRESSURE_RANGE}
    columns = {}
    for name, (low, high) in ranges.items():
        places = (rng.permutation(many) + rng.uniform(size=many)) / many
        steps = np.round((low + (high - low) * places) / STEPS[name])
        decimals = 1 if name == "frequency" else 2
        columns[name] = [round(float(step) * STEPS[name], decimals) for step in steps]
    return [Setting(*values) for values in zip(*columns.values(), strict=True)]


def believed(rig: Rig, rock: Rock) -> Mapping[str, Nominal]:
    """Constants as campaign.json has them, with standard deviations."""
    units = {"shaker_mass": "kg", "indenter_mass": "kg", "stiffness": "N/m", "damping": "N*s/m"}
    found = {}
    for name, std in TOLERANCES.items():
        value, paper = float(getattr(rig, name)), float(getattr(Rig(), name))
        found[name] = Nominal(value, std * value / paper, units.get(name, "1"))
    for name, spread in (("loading", rock.loading_spread), ("unloading", rock.unloading_spread)):
        value = float(getattr(rock, f"{name}_stiffness"))
        found[f"{name}_stiffness"] = Nominal(value, spread or ROCK_STD * value, "N/m")
    return found


def effect_from_words(words: Iterable[str]) -> Chosen:
    """An effect as one types it: its name, then parameters, such as ``contact-rate chi=0.45``.

    Raises:
        InputError: no such effect or parameter, or what is no number.
    """
    from drillenv.dynamics.effects import make

    name, *parts = words
    values = {}
    for part in parts:
        symbol, equals, text = part.partition("=")
        try:
            values[symbol] = float(text)
        except ValueError:
            equals = ""
        if not equals or not symbol:
            raise InputError(f"--effect {name} has {shown(part)}: give SYMBOL=VALUE, such as chi=0.45")
    return make(name, **values)
