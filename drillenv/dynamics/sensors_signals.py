"""What a slow, ringing or late channel makes of a signal, between its samples too.

A signal is known by evenly spaced samples and taken to be straight between them; what is left of the error is of the
order of the square of the sample interval, and of the interval itself next to a jump.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np


def filtered(
    signal: np.ndarray, before: float, rate: float, numerator: Sequence[float], denominator: Sequence[float]
) -> np.ndarray:
    """The output of a linear filter, exact for a signal that is straight between its samples.

    Args:
        signal: (samples,) at ``rate`` samples a second.
        before: What the signal stood at before the first sample, so long that the filter had settled.
        rate: In Hz.
        numerator, denominator: Of the transfer function in s, highest power first, in SI.
    """
    from scipy.signal import lfilter

    if not signal.size:
        return signal
    feedforward, feedback, settled = _sampled(tuple(numerator), tuple(denominator), rate)
    return np.asarray(lfilter(feedforward, feedback, signal, zi=settled * before)[0])


@functools.lru_cache(256)
def _sampled(numerator: tuple[float, ...], denominator: tuple[float, ...], rate: float):
    """The filter from sample to sample, and its state where the signal has long been 1."""
    from scipy.signal import cont2discrete, lfilter_zi

    discrete: Any = cont2discrete((numerator, denominator), 1.0 / rate, method="foh")
    feedforward, feedback = np.atleast_1d(np.squeeze(discrete[0])), discrete[1]
    return feedforward, feedback, lfilter_zi(feedforward, feedback)


def delayed(signal: np.ndarray, before: float, rate: float, delay: float) -> np.ndarray:
    """The signal ``delay`` seconds later, by cubic interpolation between the four nearest samples.

    ``before`` is what it stood at before the first sample. Exact for a whole number of samples.
    """
    if delay == 0.0 or not signal.size:
        return signal
    whole = math.floor(delay * rate + 1e-9)
    part = max(delay * rate - whole, 0.0)
    reach = whole + 2
    held = np.concatenate([np.full(reach, before), signal, np.full(1, signal[-1])])
    # sample i of the result lies between held[i + 1] and held[i + 2], a share `part` before the latter
    s = 1.0 - part
    weights = (
        -s * (s - 1.0) * (s - 2.0) / 6.0,
        (s + 1.0) * (s - 1.0) * (s - 2.0) / 2.0,
        -(s + 1.0) * s * (s - 2.0) / 2.0,
        (s + 1.0) * s * (s - 1.0) / 6.0,
    )
    count = signal.size
    return sum(weight * held[i : i + count] for i, weight in enumerate(weights))  # pyright: ignore[reportReturnType]
