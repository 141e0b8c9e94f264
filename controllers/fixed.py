"""One setting for everything, and none at all: what any controller has to beat."""

from __future__ import annotations

from typing import Any

import numpy as np

from drillenv.env.task import action_for

BEST = (120.0, 0.4188, 1.0)
"""The best fixed setting in Hz, V and bar, by `python -m drillenv.training.headroom`."""


class Fixed:
    """One setting for every rock.

    Args:
        frequency, amplitude, pressure: In Hz, V and bar; by default the best one found.
    """

    sees_truth = False

    def __init__(self, frequency: float = BEST[0], amplitude: float = BEST[1], pressure: float = BEST[2]):
        self._action = action_for(frequency, amplitude, pressure)

    def reset(self, seed: int | None = None) -> None:
        """Nothing to do."""

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The same action always."""
        return self._action


class Random:
    """Any action, evenly."""

    sees_truth = False

    def reset(self, seed: int | None = None) -> None:
        """Start the actions of a seed."""
        self._rng = np.random.default_rng(seed)

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """A new action each time."""
        return self._rng.uniform(-1.0, 1.0, 3).astype(np.float32)
