"""What controllers are compared on: the frozen scenarios, and rigs whose constants are not those of Table 2.1."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from drillenv.checks import choice
from drillenv.env.episodes import Episode, rig_array
from drillenv.env.registration import KINDS
from drillenv.env.scenarios import FORMAT, read_scenario
from drillenv.rig import Rig


class Condition(NamedTuple):
    """Episodes by a name."""

    environment: str
    scenario: str
    errors: float
    """The rig's constants are off by this many times what a lab does not know of them."""
    meaning: str


CONDITIONS = {
    "test": Condition("DrillLayers", "test", 0.0, "the rocks of Table 2.2"),
    "beyond": Condition("DrillLayers", "beyond", 0.0, "rocks softer or harder than Table 2.2"),
    "constants": Condition("DrillLayers", "test", 1.0, "`test` on rigs whose constants are off by the error of a lab"),
    "constants-3": Condition("DrillLayers", "test", 3.0, "`test` on rigs whose constants are off by three such errors"),
    "hidden": Condition("DrillHidden", "test", 0.0, "constants off and one effect that the paper leaves out"),
}
"""The conditions that have a name. Any other scenario is one of DrillLayers."""
DEPTH = 0.12
"""Depth in m that is drilled in an episode of 60 s, about."""
STRATA = 3


def condition(name: str, environment: str | None = None) -> Condition:
    """A condition by its name, or the scenario ``name`` of an environment.

    Raises:
        InputError: no such scenario or environment.
    """
    if environment is None and name in CONDITIONS:
        return CONDITIONS[name]
    kind = choice("environment", environment or "DrillLayers", tuple(KINDS))
    return Condition(kind, name, 0.0, f"the scenario {read_scenario(name).name} in {kind}")


def episodes_of(chosen: Condition) -> tuple[Episode, ...]:
    """The episodes of a condition.

    Those with errors are the episodes of the scenario in which the constants of the rig are moved away from Table 2.1
    by a multiple of the error in the episode of DrillHidden with the same number.
    """
    scenario = read_scenario(chosen.scenario)
    episodes = scenario.episodes[KINDS[chosen.environment]]
    if not chosen.errors:
        return episodes
    exact = rig_array(Rig())
    return tuple(
        replace(episode, rig=exact + chosen.errors * (other.rig - exact))
        for episode, other in zip(episodes, scenario.episodes["hidden"], strict=True)
    )


@contextmanager
def scenario_of(chosen: Condition) -> Iterator[str]:
    """The scenario that an environment takes for a condition: a name, or a file for as long as the block lasts."""
    if not chosen.errors:
        yield chosen.scenario
        return
    records = [episode.as_record() for episode in episodes_of(chosen)]
    kind = KINDS[chosen.environment]
    record = {"format": FORMAT, "name": chosen.scenario, "version": 1, "episodes": {kind: records}}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.json"
        file.write_text(json.dumps(record), encoding="utf-8")
        yield str(file)


def strata(episodes: tuple[Episode, ...]) -> np.ndarray:
    """(episodes,) from 0 to STRATA - 1: thirds of the episodes by the mean stiffness of what is drilled in them."""
    stiffness = np.array([_mean_stiffness(episode.layers) for episode in episodes])
    ranks = np.argsort(np.argsort(stiffness, kind="stable"), kind="stable")
    return ranks * STRATA // len(episodes)


def _mean_stiffness(layers: np.ndarray) -> float:
    """Logarithm of the loading stiffness, over the first DEPTH of rock."""
    ends = np.minimum(layers[:, 2], DEPTH)
    thickness = np.diff(ends, prepend=0.0)
    return float(thickness @ np.log(layers[:, 0]) / DEPTH)
