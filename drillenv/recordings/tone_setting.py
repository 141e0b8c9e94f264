"""Frequency and amplitude at which a rig was driven, read off its excitation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.excitation import TONE, followed_tone, strongest_tone, tone_share, usual_amplitude
from drillenv.recordings.signal_faults import ABSURD

NEAT_FREQUENCY, NEAT_AMPLITUDE = 0.03, 0.002
"""Hz, and a share: settings are made in steps of 0.1 Hz and 0.01 V, and what is this near is taken for one."""
MOST_SAMPLES = 400_000
"""Looked at; the tone of a longer recording is known well enough from its first ones."""


class Drive(NamedTuple):
    """A setting's first two parts."""

    frequency: float
    """Hz, by the sample rate."""
    amplitude: float
    """V."""


def drive_of(samples: NDArray[np.float64], sample_rate: float) -> Drive | None:
    """The drive that an excitation (samples,) in V shows; None where it holds no tone."""
    known = samples[:MOST_SAMPLES]
    sound = np.abs(known) < ABSURD
    known = np.where(sound, known, np.median(known[sound]) if sound.any() else 0.0)
    if known.size < 16 or np.ptp(known) == 0.0:
        return None
    tone = strongest_tone(known, sample_rate)
    if tone.purity < TONE and tone_share(known, sample_rate, tone.frequency) < TONE:
        return None
    amplitude = usual_amplitude(followed_tone(known, sample_rate, tone.frequency))
    frequency, step = round(tone.frequency, 1), round(amplitude, 2)
    return Drive(
        frequency if abs(frequency - tone.frequency) < NEAT_FREQUENCY else round(tone.frequency, 3),
        step if abs(step - amplitude) < NEAT_AMPLITUDE * amplitude else neat_number(amplitude),
    )


def neat_number(value: float) -> float:
    """``value`` to three digits."""
    return float(f"{value:.3g}")
