"""What share of a mismatch is explained on recordings that were left out of the fit, and what verdict follows.

A mismatch is by how much squares of whitened residuals exceed their expectation under the noise. Its parts (recordings,
stretches of them) are drawn with replacement for an interval (B. Efron, Annals of Statistics 7 (1979) 1-26).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.thresholds import NOISE_KNOWN, WELL_EXPLAINED

Verdict = Literal["agrees", "parameters", "missing-physics", "unexplained"]
DRAWS = 2000
SEED = 20_190_419
AGREED = "What is left is noise within the stated tolerances of the constants."


class Explained(NamedTuple):
    """Share of a mismatch that is explained, with a 95 % interval."""

    share: float
    low: float
    high: float
    of: str
    """Where, in words."""

    @property
    def record(self) -> dict[str, Any]:
        """As a report gives it."""
        return {"share": self.share, "interval": [self.low, self.high], "of": self.of}

    @property
    def sentence(self) -> str:
        """For a person."""
        if self.share == 0.0:  # exactly so only of a mismatch that is not seen
            return f"The mismatch does not stand out of the noise on {self.of}."
        low, high = 100.0 * self.low, 100.0 * self.high
        share = f"{100.0 * self.share:.3g} % of the mismatch on {self.of}"
        return f"This accounts for {share} (95 % interval {low:.3g} to {high:.3g} %)."


def explained(before: Floats, after: Floats, of: str, samples: int = 0) -> Explained:
    """How much of a mismatch is gone: (parts,) of it before and after; ``of`` says in words what the parts are of.

    A mismatch is seen where it is more than the noise of so many ``samples`` is known to. Of a part that the second
    model cannot follow nothing is explained; one that the first cannot counts as the worst of the others.
    """
    followed = np.isfinite(before) & np.isfinite(after)
    if not followed.any():
        return Explained(0.0, 0.0, 0.0, of)
    largest = float(np.max(before[followed]))
    before = np.where(np.isfinite(before), before, largest)
    after = np.where(np.isfinite(after), after, before)
    if before.sum() <= NOISE_KNOWN * samples:
        return Explained(0.0, 0.0, 0.0, of)
    drawn = np.random.default_rng(SEED).integers(before.size, size=(DRAWS, before.size))
    totals = before[drawn].sum(axis=1)
    left = after[drawn].sum(axis=1)
    # of a mismatch that is not seen nothing is explained
    shares = np.where(totals > 0.0, 1.0 - left / np.where(totals > 0.0, totals, 1.0), 0.0)
    low, high = np.percentile(shares, [2.5, 97.5])
    share = 1.0 - float(after.sum()) / float(before.sum())
    return Explained(min(share, 1.0), min(float(low), 1.0), min(float(high), 1.0), of)


def classify(found: bool, outside: bool, off: bool, left: bool, share: Explained) -> Verdict:
    """The verdict.

    Args:
        found: Whether mechanisms hold.
        outside: Whether one of them is none of the library's.
        off: Whether constants are off by several of their tolerances.
        left: Whether more is left than the noise and what nobody would ask about.
        share: What is explained of the mismatch.
    """
    if outside or (left and (share.low if found else share.share) < WELL_EXPLAINED):
        return "unexplained"
    if found:
        return "missing-physics"
    return "parameters" if off else "agrees"


def cell(recording: str, channel: str, regime: str, squares: Floats) -> dict[str, Any]:
    """A cell of a report's map, from squares (n,) of whitened residuals."""
    n, mean = squares.size, float(squares.mean())
    return {"recording": recording, "channel": channel, "regime": regime, "samples": n, "mean_square": mean}


def surplus(cells: Sequence[Mapping[str, Any]], *keys: str) -> dict[tuple[str, ...], float]:
    """By how much squares exceed the noise in cells of a report, summed over those that are alike by ``keys``."""
    found: dict[tuple[str, ...], float] = {}
    for each in cells:
        alike = tuple(each[key] for key in keys)
        found[alike] = found.get(alike, 0.0) + (each["mean_square"] - 1.0) * each["samples"]
    return found
