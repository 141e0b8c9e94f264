"""Candidate functions of a sparse regression: what each mechanism of the library adds to the balances of a motion.

The equations are the library's own, each at several values of what it is not linear in.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from benchmarks.alternatives.following import Followed, Motion
from drillenv.diagnosis.equations import Around, acts_at, curve_at, scalars_of
from drillenv.diagnosis.solver import Floats
from drillenv.dynamics.constitutive.places import (
    CODE,
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    LOADING,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    WAVEFORM,
    Shape,
)
from drillenv.dynamics.effects import LIBRARY, Channels
from drillenv.dynamics.sensors_signals import filtered

Values = Mapping[str, float]
"""Parameters by symbol; those left out are neutral."""

QUARTER = math.pi / 2.0
CHOSEN: dict[str, tuple[Values, ...]] = {
    "contact-power-law": tuple({"n": n} for n in (0.8, 0.9, 1.1, 1.25, 1.4, 1.6)),
    "contact-toe": tuple(
        {"h": h, "r": r, "e": e} for h in (7e-6, 1.5e-5, 3e-5) for r, e in ((0.1, 0.1), (0.1, 0.9), (0.3, 0.5))
    ),
    "rock-compaction": tuple({"soft": 0.3, "soft_n": n} for n in (5.0, 12.0, 30.0, 70.0)),
    "force-limit": tuple({"F_max": force} for force in (150.0, 200.0, 250.0, 300.0, 350.0, 400.0))
    + tuple({"F_s": force} for force in (150.0, 190.0, 230.0)),
    "drive-droop": ({"s": 2e-3}, {"s": 4e-3}, {"s": 8e-3}),
    "drive-harmonics": ({"h2": 0.1}, {"h2": 0.1, "phi2": QUARTER}, {"h3": 0.1}, {"h3": 0.1, "phi3": QUARTER}),
    "guide-friction": ({"fc1": 30.0}, {"fc1": 30.0, "vs1": 1e-3}),
    "indenter-friction": ({"fc2": 30.0}, {"fc2": 30.0, "vs2": 5e-3}, {"fc2": 30.0, "vs2": 0.03}),
    "channel-delay": tuple({"delay_f": delay} for delay in (1e-4, 3e-4))
    + tuple({"delay_a": delay} for delay in (5e-5, 1e-4, 2e-4, 3e-4, 4e-4)),
    "accelerometer-lowpass": tuple({"f_b": f} for f in (400.0, 600.0, 900.0, 1400.0, 2200.0, 3500.0)),
    "accelerometer-resonance": tuple({"f_a": f, "zeta_a": 0.03} for f in (2500.0, 3200.0, 4000.0, 5000.0, 6300.0)),
    "load-cell-inertia": ({"m_c": 0.1},),
    "sensor-offset": ({"o_f": 10.0}, {"o_a": 5.0}),
    "sensor-highpass": ({"corner_f": 0.8}, {"corner_a": 0.8}),
}
"""Values at which equations are tried; of the other effects those from which a diagnosis tries them."""
MAINS = (50.0, 60.0)
"""Hz."""
LEFT_OUT = ("external-vibration", "rock-rotation")
"""Of which frequency and phase are each recording's own: physics that no mechanism of the trial's library covers."""


class Forces(NamedTuple):
    """What an equation adds to a motion, (n,) N."""

    rock: Floats
    """To the force of the rock."""
    indenter: Floats
    """On the indenter, positive toward the rock; that of the rock aside."""
    shaker: Floats
    """On the shaker body, likewise."""


class Column(NamedTuple):
    """A candidate function."""

    mechanism: str
    """Empty where it is what constants of the paper's model are off."""
    name: str
    readings: Floats
    """(2, n) by what it changes the force in N and the acceleration in m/s^2."""
    shaker: Floats
    """(n,) N on the shaker body."""

    @property
    def function(self) -> str:
        """What it has in common with the same function at other values of its parameters."""
        return re.sub(r"=[^,]*|\d+ Hz", "", self.name)


def tried() -> Iterator[tuple[str, Values]]:
    """Mechanisms of the library, each with values of its parameters."""
    for name, effect in LIBRARY.items():
        if name in CHOSEN:
            yield from ((name, values) for values in CHOSEN[name])
        elif (effect.moves_rig or effect.measure is not None) and name not in (*LEFT_OUT, "mains-hum"):
            # of a mount that stiffens the face is that of one that does not: a column would be there twice
            for form in (each for each in effect.forms if MOUNT_SPRING not in acts_at(name, each)[0]):
                yield from ((name, dict(zip(form.symbols, start, strict=True))) for start in form.starts)


def candidates(recording: Followed) -> list[Column]:
    """All columns of a recording, constants of the paper's model first; the same ones for all recordings."""
    found, nothing = of_motion(recording.motion), np.zeros_like(recording.motion.y)
    for name, values in tried():
        if LIBRARY[name].measure is not None:
            readings = misread(recording, name, _parameters(name, values))
            found.append(Column(name, label(name, values), readings, nothing))
    return found + hums(recording)


def of_motion(motion: Motion) -> list[Column]:
    """The columns that are forces, constants of the paper's model first."""
    found = [("", name, forces) for name, forces in constants_off(motion)]
    for name, values in tried():
        if LIBRARY[name].measure is None:
            found.append((name, label(name, values), forces_of(name, _parameters(name, values), motion)))
    second = motion.masses[1]
    return [
        Column(name, words, np.stack([forces.rock, (forces.indenter - forces.rock) / second]), forces.shaker)
        for name, words, forces in found
    ]


def _parameters(name: str, values: Values) -> tuple[float, ...]:
    return tuple(values.get(each.symbol, each.neutral) for each in LIBRARY[name].parameters)


def label(name: str, values: Values) -> str:
    """What a candidate is called."""
    return f"{name} {', '.join(f'{symbol}={value:.3g}' for symbol, value in values.items())}"


def constants_off(motion: Motion) -> list[tuple[str, Forces]]:
    """What the constants of the paper's model add where they are off."""
    zero, closing = np.zeros_like(motion.y), motion.v1 - motion.v2
    drive = motion.drive * np.sin(motion.theta)
    return [
        ("stiffness", Forces(zero, motion.k * motion.y, -motion.k * motion.y)),
        ("damping", Forces(zero, motion.c * closing, -motion.c * closing)),
        ("drive", Forces(zero, drive, zero)),
        ("pressure", Forces(zero, zero, np.full_like(zero, motion.static))),
        ("loading", Forces(motion.rock * motion.loading, zero, zero)),
        ("unloading", Forces(motion.rock * ~motion.loading, zero, zero)),
    ]


def forces_of(name: str, p: tuple[float, ...], motion: Motion) -> Forces:
    """What an effect adds to the balances of :mod:`drillenv.dynamics.constitutive.places` at a motion."""
    rock, indenter, shaker = (np.zeros_like(motion.y) for _ in range(3))
    around, closing = Around(motion.k, motion.kl, motion.ku), motion.v1 - motion.v2
    asked = motion.drive * np.sin(motion.theta)
    arguments = {
        RATE_FACTOR: motion.v2,
        RATE_FORCE: motion.v2,
        COMPACTION: motion.impacts,
        SPRING: motion.y,
        SPRING_FROM_REST: motion.y - motion.static / motion.k,
        DAMPER: closing,
        GUIDE: motion.v1,
        INDENTER: motion.v2,
        WAVEFORM: np.mod(motion.theta, 2.0 * math.pi),
        DRIVE: asked,
    }
    for place in (CODE[each] for each in LIBRARY[name].laws):
        if place <= UNLOADING:
            rock = rock + _bent(name, p, place, motion)
            continue
        if place == MOUNT_SPRING:
            # the rock's face goes by a linear filter: see _by_numbers
            continue
        law = curve_at(name, p, place, arguments[place], around)
        if place in (RATE_FACTOR, COMPACTION):
            rock = rock + law * motion.rock
        elif place == RATE_FORCE:
            rock = rock + law * (motion.rock > 0.0)
        elif place <= DAMPER:
            indenter, shaker = indenter + law, shaker - law
        elif place == GUIDE:
            shaker = shaker - law
        else:
            indenter = indenter + {INDENTER: -1.0, WAVEFORM: motion.drive, DRIVE: 1.0}[place] * law
    more = _by_numbers(name, p, motion, asked)
    return Forces(rock + more.rock, indenter + more.indenter, shaker + more.shaker)


def _bent(name: str, p: tuple[float, ...], place: int, motion: Motion) -> Floats:
    """(n,) N by what the shape of a contact bends its straight line."""
    shape = LIBRARY[name].laws["loading" if place == LOADING else "unloading"]
    assert isinstance(shape, Shape)
    stiff = motion.kl if place == LOADING else motion.ku
    scale = {"depth": 1.0, "loading depth": stiff / motion.kl, "force": stiff}[shape.over]
    there = motion.loading if place == LOADING else ~motion.loading
    depth = motion.rock / stiff * scale
    return stiff / scale * (shape.law(depth, p, motion.k) - depth) * (there & (motion.rock > 0.0))


def _by_numbers(name: str, p: tuple[float, ...], motion: Motion, asked: Floats) -> Forces:
    """What an effect adds by numbers of the model: a mount, the air of the cylinder, a drive that lags."""
    zero = np.zeros_like(motion.y)
    s = scalars_of(name, p)
    if "drive_lag" in s:
        return Forces(zero, asked * (1.0 / math.hypot(1.0, motion.frequency * s["drive_lag"]) - 1.0), zero)
    if "air_stiffness" in s:
        lost = filtered(motion.v1, float(motion.v1.mean()), motion.rate, (s["air_stiffness"],), (1.0, s["air_rate"]))
        return Forces(zero, zero, -lost)
    if "mount_gain" in s:
        over = (1.0, s["mount_damping"], s["mount_square"])
        u = filtered(motion.rock, float(motion.rock.mean()), motion.rate, (s["mount_gain"],), over)
        # the depth is less by what the face has moved since the contact began
        begins = (motion.rock > 0.0) & (np.roll(motion.rock, 1) <= 0.0)
        since = np.maximum.accumulate(np.where(begins, np.arange(u.size), 0))
        given = (u - u[since]) * np.where(motion.loading, motion.kl, motion.ku)
        return Forces(-given * (motion.rock > 0.0), zero, zero)
    return Forces(zero, zero, zero)


def misread(recording: Followed, name: str, p: tuple[float, ...]) -> Floats:
    """(2, n) by what a sensor misreads the model's force and acceleration."""
    effect, block = LIBRARY[name], recording.estimate.block
    assert effect.measure is not None
    inside = block.inside
    force, acceleration = recording.signals[:, inside]
    true = Channels(block.point.rate, 0.0, np.zeros_like(force), force, acceleration, block.point.fresh)
    read = effect.measure(true, true, p)
    change = np.zeros_like(recording.signals)
    change[:, inside] = np.stack([read.force - force, read.acceleration - acceleration])
    return recording.sampled(change)


def hums(recording: Followed) -> list[Column]:
    """Lines of the mains on each channel. Phases in a half of the recording are read off the other half."""
    found, left = [], recording.left
    time, middle = np.arange(left.shape[1]) / recording.motion.rate, left.shape[1] // 2
    halves = (slice(0, middle), slice(middle, None))
    for frequency in MAINS:
        turned = 2.0 * math.pi * frequency * time
        waves = np.column_stack([np.sin(turned), np.cos(turned), np.ones_like(turned)])
        for i, channel in enumerate(("force", "acceleration")):
            readings = np.zeros_like(left)
            for here, other in (halves, halves[::-1]):
                size = np.linalg.lstsq(waves[other], left[i, other], rcond=None)[0][:2]
                readings[i, here] = waves[here, :2] @ size
            found.append(
                Column("mains-hum", f"mains-hum {frequency:g} Hz, {channel}", readings, np.zeros(left.shape[1]))
            )
    return found
