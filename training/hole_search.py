"""Search the numbers of the rules and the fixed setting of ``DrillBit`` on the frozen set "train".

    python -m drillenv.training.hole_search rules --candidates 400 --json OUT.json
    python -m drillenv.training.hole_search fixed --candidates 300 --json OUT.json

Random candidates first, then changes of the best one. The file is written after each better one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from tqdm import tqdm

from drillenv.controllers import Controller
from drillenv.controllers.hole.rules import HoleFixed, HoleRules, Numbers
from drillenv.env.hole.envs import DrillBitVectorEnv
from drillenv.env.registration import HOLE_STEPS
from drillenv.files import whole

RULES = {
    "highest": (100.0, 120.0),
    "lowest": (60.0, 100.0),
    "scanned": (1.0, 7.0),
    "favour": (-1.0, 2.0),
    "force": (0.4, 1.3),
    "ratio": (1.2, 3.2),
    "slope": (0.0, 3.0),
    "back_off": (0.8, 1.0),
    "come_back": (0.0, 0.1),
    "held": (40.0, 100.0),
    "worn": (0.2, 2.0),
    "loss": (0.2, 0.9),
    "last": (0.0, 0.6),
}
FIXED = {"frequency": (60.0, 120.0), "amplitude": (0.3, 0.6), "pressure": (0.6, 1.8), "bit_depth": (0.2, 4.0)}
EXPLORE = 0.4
"""Share of the candidates that are drawn anywhere."""
NEAR = 0.12
"""Standard deviation of the changes of the best one, as a share of each range."""


def costs_per_metre(
    controller: Any,
    scenario: str | None,
    episodes: int,
    threads: int | None = None,
    arguments: Mapping[str, Any] = MappingProxyType({}),
    steps: int | None = None,
    first_seed: int = 0,
) -> np.ndarray:
    """(episodes,) the cost per metre in EUR/m of a controller that takes many observations at once.

    Args:
        controller: What drills all holes.
        scenario: A frozen set or a file of one; None lets the seeds draw the holes.
        episodes: The first so many.
        threads: Of the environment; all cores where left out.
        arguments: Others of the environment.
        steps: After which a hole is left as it is; those of the registration where left out.
        first_seed: Of the first hole.
    """
    steps = HOLE_STEPS["DrillBit"] if steps is None else steps
    envs = DrillBitVectorEnv(episodes, None, autoreset_mode="SameStep", threads=threads, scenario=scenario, **arguments)
    chosen = {} if scenario is None else {"episode": list(range(episodes))}
    observations, _ = envs.reset(seed=first_seed, options=chosen)
    controller.reset(0)
    costs, left = np.full(episodes, np.nan), np.ones(episodes, dtype=bool)
    for step in range(steps):
        observations, _rewards, ended, _truncated, infos = envs.step(controller.act(observations, {}))
        now = left & ended
        if now.any():
            costs[now] = infos["final_info"]["cost_per_metre"][now]
            left &= ~ended
        if step == steps - 1:
            costs[left] = infos["cost_per_metre"][left]
        if not left.any():
            break
    envs.close()
    return costs


def rules_of(numbers: dict[str, float]) -> HoleRules:
    """The rules with these numbers."""
    kinds = {field.name: field.type for field in fields(Numbers)}
    return HoleRules(Numbers(**{n: round(v) if kinds[n] == "int" else v for n, v in numbers.items()}))  # type: ignore


def search(
    make: Callable[[dict[str, float]], Controller],
    ranges: dict[str, tuple[float, float]],
    first: dict[str, float],
    candidates: int,
    episodes: int,
    seed: int,
    save: Callable[[dict[str, Any]], None],
) -> dict[str, Any]:
    """The best of ``candidates``, by the mean cost per metre over the first episodes of "train"."""
    rng = np.random.default_rng(seed)
    low, high = np.array(list(ranges.values())).T
    best = {"numbers": first, "cost": float(costs_per_metre(make(first), "train", episodes).mean())}
    for i in tqdm(range(candidates), disable=None):
        if i < EXPLORE * candidates:
            drawn = rng.uniform(low, high)
        else:
            near = np.array([best["numbers"][name] for name in ranges])
            changed = rng.random(low.size) < 0.4
            drawn = np.clip(near + changed * NEAR * (high - low) * rng.standard_normal(low.size), low, high)
        numbers = dict(zip(ranges, drawn.tolist(), strict=True))
        cost = float(costs_per_metre(make(numbers), "train", episodes).mean())
        if cost < best["cost"]:
            best = {"numbers": numbers, "cost": cost, "candidate": i}
            save(best)
    return best


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m drillenv.training.hole_search", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("what", choices=("rules", "fixed"))
    parser.add_argument("--candidates", type=int, default=400)
    parser.add_argument("--episodes", type=int, default=40, help="of the set train")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, required=True)
    given = parser.parse_args(arguments)

    def save(best: dict[str, Any]) -> None:
        with whole(given.json) as part:
            part.write_text(json.dumps(best) + "\n", encoding="utf-8")

    if given.what == "rules":
        first = {name: float(value) for name, value in asdict(Numbers()).items()}
        best = search(rules_of, RULES, first, given.candidates, given.episodes, given.seed, save)
    else:
        first = {"frequency": 100.0, "amplitude": 0.4, "pressure": 0.7, "bit_depth": 1.5}
        make = lambda numbers: HoleFixed(**numbers)  # noqa: E731
        best = search(make, FIXED, first, given.candidates, given.episodes, given.seed, save)
    save(best)
    print(json.dumps(best))
    return 0


if __name__ == "__main__":
    sys.exit(main())
