"""Labels of single recordings of the drilling rig that their samples contradict: amplitude, pressure, how they start.

None of it needs a law of the rock. The excitation's channel has its amplitude. Over whole periods the mean force of the
rock is the static force, but for what friction and offsets take of it: a straight line over the stated pressures, on
which a recording with another pressure does not lie. A rig at rest against fresh rock is pressed against it from the
first sample on, and stands still at the first peak of the force if it stood still before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import siegelslopes

from drillenv.diagnosis.condition import TOUCH, fit_excitation, what_is_needed, white_noise
from drillenv.diagnosis.thresholds import (
    AMPLITUDE_OFF,
    AT_REST_FORCE,
    AT_REST_SPEED,
    MOST_WRONG,
    PRESSURE_SCATTER,
    STANDS_OUT,
)
from drillenv.recordings import Campaign, Recording
from drillenv.rig import AMPLITUDE_LIMITS, PRESSURE_LIMITS

SETTLING, STEADY = 0.1, 0.19
"""Seconds after which the masses' relative motion at a start is over, and over which the force has to be averaged:
the shaker's speed at both ends stands beside the static force with 1 % of it over these, and with more over less."""
MAD_TO_STD = 1.4826
"""Standard deviation of a normal distribution, in median absolute deviations."""
FEWEST_FOR_A_LINE = 4
"""Recordings by which a line is known well enough to say that another is off it."""
AT_REST_SECONDS = 1e-3
"""Seconds within which an indenter at rest against the rock is pressed on."""


@dataclass(frozen=True, slots=True)
class Label:
    """A label that the samples contradict, and what it is taken for."""

    recording: str
    field: str
    """amplitude (V), pressure (bar), starts, or use where it disagrees and no label says why."""
    stated: float | str
    seems: float | str
    std: float | None
    """Standard deviation of what it seems to be, None of a word."""

    @property
    def sentence(self) -> str:
        """For a person."""
        if self.field == "use":
            return f"{self.recording}: it alone disagrees with what explains the others, and is set aside."
        stated, seems = str(self.stated), str(self.seems)
        if self.std is not None:
            unit = {"amplitude": "V", "pressure": "bar"}[self.field]
            stated, seems = f"{self.stated:.4g} {unit}", f"{self.seems:.4g} +- {self.std:.2g} {unit}"
        return f"{self.recording}: its {self.field} is stated as {stated} and seems to be {seems}; it is taken so."


def with_labels_corrected(campaign: Campaign) -> tuple[Campaign, list[Label]]:
    """A campaign of the drilling rig with labels corrected where its samples contradict them, and those labels.

    Raises:
        InputError: a recording lacks a setting or a channel.
    """
    found = [*mislabelled_amplitudes(campaign.recordings), *mislabelled_starts(campaign.recordings)]
    found += mislabelled_pressures(campaign.recordings)
    recordings = {each.name: each for each in campaign.recordings}
    for label in found:
        recordings[label.recording] = relabelled(recordings[label.recording], label)
    return replace(campaign, recordings=tuple(recordings.values())), found


def relabelled(recording: Recording, label: Label) -> Recording:
    """The recording with the label that it seems to have."""
    if label.field == "starts":
        return replace(recording, starts=str(label.seems))
    return replace(recording, setting=replace(what_is_needed(recording)[0], **{label.field: label.seems}))


def mislabelled_amplitudes(recordings: Sequence[Recording]) -> list[Label]:
    """Those whose excitation has another amplitude than stated."""
    found = []
    for each in recordings:
        setting, (excitation, _force, _acceleration) = what_is_needed(each)
        measured = fit_excitation(excitation, each.sample_rate, setting.frequency)[2]
        off = abs(measured / setting.amplitude - 1.0) > AMPLITUDE_OFF
        if off and AMPLITUDE_LIMITS[0] <= measured <= AMPLITUDE_LIMITS[1]:
            found.append(Label(each.name, "amplitude", setting.amplitude, measured, AMPLITUDE_OFF * measured / 3.0))
    return found


def mislabelled_starts(recordings: Sequence[Recording]) -> list[Label]:
    """Those said to start from rest on fresh rock that were running."""
    found = []
    for each in recordings:
        if each.starts != "fresh":
            continue
        _setting, (_excitation, force, acceleration) = what_is_needed(each)
        if is_running(force, acceleration, each.sample_rate):
            found.append(Label(each.name, "starts", "fresh", "running", None))
    return found


def is_running(force: np.ndarray, acceleration: np.ndarray, rate: float) -> bool:
    """Whether the first samples (n,) in N and m/s^2 are not those of a rig at rest against the rock."""
    level = float(np.percentile(force, 5.0))
    pressed = level + max(AT_REST_FORCE * (float(np.percentile(force, 99.0)) - level), TOUCH * white_noise(force))
    if force[0] > pressed:
        return True
    on = np.flatnonzero(force > pressed)
    if not on.size or on[0] > AT_REST_SECONDS * rate:
        return True
    off = np.flatnonzero(force[on[0] :] < pressed)
    peak = int(on[0] + np.argmax(force[on[0] : on[0] + off[0]])) if off.size else int(np.argmax(force))
    return abs(float(np.trapezoid(acceleration[: peak + 1])) / rate) > AT_REST_SPEED


def mislabelled_pressures(recordings: Sequence[Recording]) -> list[Label]:
    """Those whose mean force does not lie on the line of the others."""
    pressures = np.array([what_is_needed(each)[0].pressure for each in recordings])
    means = np.array([mean_force(each) for each in recordings])
    fresh = np.array([each.starts == "fresh" for each in recordings])
    inside, found = np.isfinite(means), []
    while len(found) < len(recordings) // MOST_WRONG and inside.sum() > FEWEST_FOR_A_LINE:
        residuals = [
            leave_one_out_residual(pressures, means, fresh, i, inside) for i in np.flatnonzero(inside).tolist()
        ]
        worst = int(np.argmax([each[0] for each in residuals]))
        off, seems, std = residuals[worst]
        if off < STANDS_OUT or not PRESSURE_LIMITS[0] <= seems <= PRESSURE_LIMITS[1]:
            break
        i = int(np.flatnonzero(inside)[worst])
        found.append(Label(recordings[i].name, "pressure", float(pressures[i]), seems, std))
        inside[i] = False
    return found


def leave_one_out_residual(
    pressures: np.ndarray, means: np.ndarray, fresh: np.ndarray, i: int, inside: np.ndarray
) -> tuple[float, float, float]:
    """By how many standard deviations the mean force of recording i is off the line of the others.

    And its pressure by that line in bar, with the standard deviation of that. What recordings from rest share is no
    matter of a label: air behind the piston that relaxes, or a coupled load cell that settles.
    """
    others = inside.copy()
    others[i] = False
    # repeated medians, since of the others one may be wrong as well
    line: Any = siegelslopes(means[others], pressures[others])
    slope, level = float(line.slope), float(line.intercept)
    if not slope > 0.0:
        return 0.0, 0.0, 0.0
    left = means[others] - level - slope * pressures[others]
    expected = level + slope * pressures[i]
    # the factor for few points by a line: P. J. Rousseeuw and A. M. Leroy, Robust Regression, 1987, chapter 5
    few = 1.0 + 5.0 / (int(others.sum()) - 2)
    scatter = max(few * MAD_TO_STD * float(np.median(np.abs(left))), PRESSURE_SCATTER * abs(expected))
    off = float(means[i] - expected)
    if fresh[i] and (others & fresh).any():
        shared = expected * float(np.median((left / (means[others] - left))[fresh[others]]))
        off = min(off, off - shared, key=abs)
    return abs(off) / scatter, float((means[i] - level) / slope), float(scatter / slope)


def mean_force(recording: Recording) -> float:
    """N, over whole periods up to the end of a recording, a start left out; NaN where they are too few."""
    setting, (_excitation, force, _acceleration) = what_is_needed(recording)
    seconds = recording.seconds - (SETTLING if recording.starts == "fresh" else 0.0)
    periods = math.floor(seconds * setting.frequency)
    if periods < STEADY * setting.frequency:
        return math.nan
    return float(force[-round(periods / setting.frequency * recording.sample_rate) :].mean())
