"""Campaigns whose truth is known, as a lab would record them, to see what a diagnosis makes of them.

The general engine makes the motion, and sensors with noise record it. The rig that is recorded is not quite the one
that is believed in: each constant is off by its stated tolerance, drawn at random.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drillenv.checks import InputError, count, number
from drillenv.diagnosis.fit import UNITS
from drillenv.diagnosis.starts import GROWING
from drillenv.dynamics.effects import REGISTRY, Chosen, make
from drillenv.dynamics.sensors import PerChannel, record
from drillenv.recordings import Campaign, Nominal, Recording
from drillenv.recordings.campaign import Channel
from drillenv.rig import TOLERANCES, Rig, Setting
from drillenv.rocks import Rock, rock

ROCK_TOLERANCE = 0.03, 0.04
"""Standard deviations of k_l and k_u, as shares of them."""
MOST_OFF = 1.5
"""Standard deviations by which a constant is off at most, where it is not wrong on purpose."""
NOISE = PerChannel(0.002, 5.0, 2.0)
RANGES = ((52.0, 120.0), (0.3, 0.6), (0.6, 1.4))
"""Frequencies in Hz, amplitudes in V and pressures in bar between which the settings of a campaign lie."""
LEAD = (1.0, 2.5)
"""Seconds for which a rig had been running before its recording."""
FRESH = (1, 4)
"""Which recordings are of rock never hit before."""


class Rehearsal(NamedTuple):
    """A campaign and what is true of it."""

    campaign: Campaign
    rig: Rig
    rock: Rock
    effects: tuple[Chosen, ...]


def rehearse(
    rng: np.random.Generator,
    case: int = 4,
    effects: Sequence[Chosen] = (),
    wrong: Mapping[str, float] | None = None,
    recordings: int = 8,
    seconds: float = 0.5,
    sample_rate: float = 25600.0,
    noise: PerChannel = NOISE,
) -> Rehearsal:
    """Record a campaign of the drilling rig.

    Args:
        rng: Settings, constants, phases and noise come from it.
        case: Rock and indenter, 1 to 6 of Table 2.2.
        effects: What the rig or its sensors have beside the paper's model. The phases of mains-hum are drawn anew for
            each recording, as nobody starts a recording in step with the mains.
        wrong: Factors on constants that the lab has wrong.
        recordings: At least 3; the second and the fifth are of fresh rock.
        seconds: Duration of each.
        sample_rate: Samples a second.
        noise: Standard deviations of the channels' white noise.

    Raises:
        InputError: a value out of range, a constant that does not exist, or a motion that cannot be followed.
    """
    recordings, wrong = count("recordings", recordings, 3, 100), dict(wrong or {})
    seconds = number("seconds", seconds, 0.05, 60.0, "s")
    nominal = believed_constants(case)
    unknown = sorted(set(wrong) - set(nominal))
    if unknown:
        raise InputError(f"wrong names {', '.join(unknown)}: give constants, which are {', '.join(nominal)}")
    true = {}
    for name, each in nominal.items():
        assert each.value is not None and each.std is not None
        true[name] = wrong.get(name, 1.0) * each.value + each.std * float(np.clip(rng.normal(), -MOST_OFF, MOST_OFF))
    true["unloading_stiffness"] = max(true["unloading_stiffness"], 1.01 * true["loading_stiffness"])
    rig = Rig(**{name: true[name] for name in TOLERANCES})
    pair = Rock(true["loading_stiffness"], true["unloading_stiffness"])
    recorded = []
    for i, setting in enumerate(draw_settings(rng, recordings)):
        fresh = i in FRESH
        chosen = [_in_phase(each, rng) for each in effects]
        made = record(
            rig,
            setting,
            pair,
            seconds,
            sample_rate,
            effects=[each for each in chosen if each.effect.measure is None],
            sensors=[each for each in chosen if each.effect.measure is not None],
            phase=0.0 if fresh else float(rng.uniform(0.0, 2 * math.pi)),
            lead=0.0 if fresh else float(rng.uniform(*LEAD)),
            noise=noise,
            rng=rng,
        ).channels
        channels = {
            "excitation": Channel(made.excitation, "V", "excitation"),
            "force": Channel(made.force, "N", "force"),
            "acceleration": Channel(made.acceleration, "m/s^2", "acceleration"),
        }
        name, starts = f"r{i + 1:02d}", "fresh" if fresh else "running"
        recorded.append(Recording(name, f"{name}.csv", sample_rate, channels, starts, setting))
    title = f"rehearsal on case {case}"
    campaign = Campaign(title, "percussive-drill", nominal, tuple(recorded), Path("."))
    return Rehearsal(campaign, rig, pair, tuple(effects))


def believed_constants(case: int) -> dict[str, Nominal]:
    """What a lab believes of the rig and of a pair of Table 2.2, with the standard deviations."""
    pair = rock(case)
    stated = {name: Nominal(getattr(Rig(), name), width, UNITS[name]) for name, width in TOLERANCES.items()}
    for name, share in zip(("loading_stiffness", "unloading_stiffness"), ROCK_TOLERANCE, strict=True):
        stated[name] = Nominal(getattr(pair, name), share * getattr(pair, name), UNITS[name])
    return stated


def draw_settings(rng: np.random.Generator, number_of: int) -> list[Setting]:
    """Settings spread over RANGES: a Latin hypercube."""
    columns = []
    for low, high in RANGES:
        places = (rng.permutation(number_of) + rng.uniform(0.0, 1.0, number_of)) / number_of
        columns.append(low + (high - low) * places)
    return [
        Setting(round(float(f), 1), round(float(a), 3), round(float(p), 2)) for f, a, p in zip(*columns, strict=True)
    ]


def drawn_effect(name: str, rng: np.random.Generator, share: float = 1.0) -> Chosen:
    """An effect at a strength drawn from its typical range, its growing parameters times ``share``.

    Raises:
        InputError: no such effect.
    """
    if name not in REGISTRY:
        raise InputError(f"effect is {name!r}: give one of {', '.join(sorted(REGISTRY))}")
    values = {}
    for entry in REGISTRY[name].parameters:
        value = float(rng.uniform(*entry.typical))
        if entry.symbol in SMOOTHED and rng.random() < 0.5:
            value = float(rng.uniform(*SMOOTHED[entry.symbol]))
        if entry.symbol in GROWING:
            value = entry.neutral + share * (value - entry.neutral)
        elif entry.symbol in SHRINKING:
            value /= share ** SHRINKING[entry.symbol]
        values[entry.symbol] = value
    return make(name, **values)


SMOOTHED = {"vs1": (1e-3, 4e-3), "vs2": (1e-3, 4e-2)}
"""Speeds in m/s over which every other friction sets in."""
SHRINKING = {"f_a": 0.5, "f_b": 1.0, "F_max": 1.0}
"""Symbols that say how strong it is by being small, with the power of the strength that they go by: below its resonance
an accelerometer is wrong by the square of the frequency over f_a."""


def _in_phase(chosen: Chosen, rng: np.random.Generator) -> Chosen:
    """A hum at a phase of its own."""
    if chosen.effect.name != "mains-hum":
        return chosen
    values = {each.symbol: value for each, value in zip(chosen.effect.parameters, chosen.values, strict=True)}
    for symbol in values:
        if symbol.startswith("psi_"):
            values[symbol] = float(rng.uniform(-math.pi, math.pi))
    return make("mains-hum", **values)
