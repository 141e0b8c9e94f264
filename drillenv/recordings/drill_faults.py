"""Faults that only physics shows: the channels of the drilling rig held against each other and against its setting.

What is used, none of which needs the motion to be simulated: the excitation is a tone of the setting's frequency and
amplitude; over many periods the mean rock force is the static force of Eq. 3.6 and the mean acceleration is zero; the
rock only pushes; and the measured force and the drive of Eq. 3.5, put through the structure, give the acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.balance import Balance
from drillenv.recordings.document import Nominal
from drillenv.recordings.excitation import TONE, excitation_findings, tone_share
from drillenv.recordings.findings import (
    EXCLUDE_CHANNEL,
    EXCLUDE_RECORDING,
    NOTE,
    QualityFinding,
    off_by_a_unit,
    throughout,
)
from drillenv.recordings.structure import contact_frequency
from drillenv.recordings.units import NEAR, slip_of
from drillenv.rig import Setting

if TYPE_CHECKING:
    from drillenv.recordings.campaign import Recording

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

NEEDED = ("excitation", "force", "acceleration")

LEAST_PERIODS = 6
"""Excitation periods before the channels are held against each other."""
SAMPLES_A_CONTACT = (2.0, 5.0)
"""Samples an impact (half a period of the indenter on the rock): useless below the first, coarse below the second."""
OTHER_TIME_SCALE = 0.05
"""Beyond this error of the frequency nothing else can be judged by the clock."""
PRESSURE_TOLERANCE = 0.2


def check_drill(recording: Recording, nominal: Mapping[str, Nominal], bad: Mapping[str, Mask]) -> list[QualityFinding]:
    """Findings on one recording of the drilling rig.

    Args:
        recording: The recording.
        nominal: The constants of its campaign.
        bad: For each channel the samples already found faulty, which are not looked at again.
    """
    found = [
        throughout(
            recording,
            name,
            "missing-channel" if name != "excitation" else "missing-excitation",
            f"there is no channel {name}: without it this recording says nothing of the rig's balances",
            EXCLUDE_RECORDING,
        )
        for name in NEEDED
        if name not in recording.channels
    ]
    found += _coarse(recording, nominal)
    if recording.setting is None:
        return found
    found += _pressure(recording, recording.setting)
    periods = recording.seconds * recording.setting.frequency
    if periods < LEAST_PERIODS:
        text = (
            f"it lasts {periods:.3g} excitation periods: record at least {LEAST_PERIODS} to have its channels checked"
        )
        return [*found, throughout(recording, None, "short", text, NOTE)]
    filled = {
        name: _filled(recording.channels[name].samples, bad[name])
        for name in NEEDED
        if name in recording.channels and np.count_nonzero(bad[name]) < 0.5 * recording.size
    }
    swapped = _swapped(recording, recording.setting, filled)
    if swapped:
        return found + swapped
    excitation, frequency, off = excitation_findings(recording, recording.setting, filled, bad)
    bad = {**bad, "excitation": off}
    found += excitation
    if abs(frequency / recording.setting.frequency - 1.0) > OTHER_TIME_SCALE:
        return found
    if {"force", "acceleration"} <= filled.keys() and not _is_hopeless(recording, recording.setting, nominal):
        found += Balance(recording, recording.setting, nominal, filled, bad, frequency).findings()
    return found


# --------------------------------------------------------------------------------------------------------------------
# the setting


def _is_hopeless(recording: Recording, setting: Setting, nominal: Mapping[str, Nominal]) -> bool:
    """Whether the samples are too few to follow an impact or the excitation."""
    rate = recording.sample_rate
    return rate < 4.0 * setting.frequency or rate < 2.0 * SAMPLES_A_CONTACT[0] * contact_frequency(nominal)


def _coarse(recording: Recording, nominal: Mapping[str, Nominal]) -> list[QualityFinding]:
    """A sample rate too low for the excitation or the impacts."""
    rate, contact = recording.sample_rate, contact_frequency(nominal)
    if recording.setting is not None and rate < 4.0 * recording.setting.frequency:
        text = (
            f"{rate:g} samples a second do not resolve an excitation of {recording.setting.frequency:g} Hz: "
            "sample at least 20 times a period"
        )
        return [throughout(recording, None, "sample-rate", text, EXCLUDE_RECORDING)]
    in_contact = rate / (2.0 * contact)
    if in_contact >= SAMPLES_A_CONTACT[1]:
        return []
    text = (
        f"{rate:g} samples a second leave {in_contact:.2g} in an impact (half a period at {contact:.0f} Hz): "
        f"sample at {20 * contact:.2g} Hz or more"
    )
    return [
        throughout(
            recording,
            None,
            "sample-rate",
            text,
            EXCLUDE_RECORDING if in_contact < SAMPLES_A_CONTACT[0] else NOTE,
        )
    ]


def _pressure(recording: Recording, setting: Setting) -> list[QualityFinding]:
    """A pressure channel that differs from the setting."""
    if "pressure" not in recording.channels:
        return []
    samples = recording.channels["pressure"].samples
    samples = samples[np.isfinite(samples)]
    if not samples.size:
        return []
    measured = float(np.median(samples)) / 1e5
    if abs(measured / setting.pressure - 1.0) <= PRESSURE_TOLERANCE:
        return []
    slip = slip_of(measured / setting.pressure, NEAR) if measured > 0.0 else 0.0
    if slip:
        unit, why = recording.channels["pressure"].unit, "its median against the setting"
        return [off_by_a_unit(recording, "pressure", unit, slip, why, [], EXCLUDE_CHANNEL)]
    text = f"its median is {measured:.3g} bar, the setting says {setting.pressure:g} bar: correct one of them"
    return [throughout(recording, "pressure", "pressure", text, NOTE)]


# --------------------------------------------------------------------------------------------------------------------
# swapped channels


def _swapped(recording: Recording, setting: Setting, filled: Mapping[str, Floats]) -> list[QualityFinding]:
    """Channels that hold each other's samples, known by their shape whatever their scale and sign."""
    moving = {name: samples for name, samples in filled.items() if np.ptp(samples) > 0.0}
    if set(moving) != set(NEEDED):
        return []
    held = {name: name for name in NEEDED}
    # What is not in the tone: hardly anything of an excitation, the harmonics of what answers it.
    rest = {name: 1.0 - tone_share(moving[name], recording.sample_rate, setting.frequency) for name in NEEDED}
    best = min(rest, key=lambda name: rest[name])
    if rest["excitation"] > 0.01 and rest[best] < min(0.02, 0.1 * rest["excitation"]):
        held["excitation"], held[best] = best, "excitation"
    elif rest["excitation"] > 1.0 - TONE:
        return []
    # Of the remaining two, the rock force has a mean and the acceleration has none.
    leans = {name: abs(float(moving[held[name]].mean())) / float(moving[held[name]].std()) for name in NEEDED[1:]}
    if leans["force"] < 0.1 and leans["acceleration"] > 0.2:
        held["force"], held["acceleration"] = held["acceleration"], held["force"]
    if all(name == source for name, source in held.items()):
        return []
    wrong = [name for name in NEEDED if held[name] != name]
    looks = "; ".join(f"{source} holds what looks like the {name}" for name, source in held.items() if source != name)
    text = f"{looks}: give each channel its own column"
    return [throughout(recording, ", ".join(wrong), "swapped", text, EXCLUDE_RECORDING)]


def _filled(samples: Floats, bad: Mask) -> Floats:
    """A copy with straight lines over the bad samples, for looking at only."""
    if not bad.any():
        return samples
    good = np.flatnonzero(~bad)
    if not good.size:
        return np.zeros(samples.size)
    return np.interp(np.arange(samples.size), good, samples[good])
