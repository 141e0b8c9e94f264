"""How the survey of motions uses two threads, and how long a map of 100 x 100 settings takes: prints JSON.

Rock 4 at 1 bar over the box of frequency and amplitude, in shuffled order. One and two threads take turns; the ratio is
the median over the rounds.
"""

from __future__ import annotations

import json
import statistics
import time

import numpy as np

from drillenv.dynamics.survey import survey
from drillenv.rig import AMPLITUDE_RANGE, FREQUENCY_RANGE

ROUNDS = 3


def main() -> None:
    """Measure and print."""
    frequency, amplitude = np.meshgrid(np.linspace(*FREQUENCY_RANGE, 100), np.linspace(*AMPLITUDE_RANGE, 100))
    settings = np.column_stack([frequency.ravel(), amplitude.ravel(), np.ones(frequency.size)])
    np.random.default_rng(0).shuffle(settings)
    survey(settings[:50], 4)
    seconds: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(ROUNDS):
        for threads, taken in seconds.items():
            start = time.perf_counter()
            survey(settings, 4, threads=threads)
            taken.append(time.perf_counter() - start)
    ratios = [one / two for one, two in zip(seconds[1], seconds[2], strict=True)]
    report = {
        "settings": len(settings),
        "seconds_one_thread": round(statistics.median(seconds[1]), 2),
        "seconds_two_threads": round(statistics.median(seconds[2]), 2),
        "speed_up": round(statistics.median(ratios), 2),
    }
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
