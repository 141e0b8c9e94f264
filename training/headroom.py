"""Is the task worth controlling? Random actions, the best fixed setting, rules and an oracle on frozen episodes.

    python -m drillenv.training.headroom [--environment DrillLayers] [--scenario test] [--json FILE]

The best fixed setting is searched on the very episodes it is then judged by, which flatters it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from tqdm import tqdm

from drillenv import controllers
from drillenv.checks import InputError, choice
from drillenv.cli_options import Parser
from drillenv.controllers import Controller
from drillenv.env.registration import KINDS
from drillenv.env.scenarios import read_scenario
from drillenv.env.task import RANGES
from drillenv.env.truth import T_EXCESS, T_RATE, T_STRONG
from drillenv.files import check_writable, whole
from drillenv.training.rollout import Rollout, rollout


def _evenly(control: int) -> np.ndarray:
    """Seven values over the range of a control."""
    return np.linspace(RANGES[control, 0], RANGES[control, 1], 7)


COARSE = (np.array([80.0, 100.0, 110.0, 120.0]), _evenly(1), _evenly(2))
"""Hz, V and bar of the first grid of fixed settings."""
COARSE_EPISODES = 20
FINALISTS = 5
SHRINK = 0.5
ROUNDS = 3
"""Each round tries the neighbours of the finalists at half the last spacing, on all episodes."""
RESAMPLES = 10_000


def best_fixed(environment: str, scenario: str) -> tuple[float, float, float]:
    """The fixed setting in Hz, V and bar with the highest mean reward on a scenario."""

    def score(setting: tuple[float, ...], episodes: int | None) -> float:
        made = rollout(lambda: controllers.make("fixed", **named(setting)), environment, scenario, episodes)
        return float(made.scores.mean())

    grid = list(product(*COARSE))
    coarse = {
        setting: score(setting, COARSE_EPISODES) for setting in tqdm(grid, desc="fixed settings", mininterval=5.0)
    }
    leaders = sorted(coarse, key=lambda each: coarse[each])[-FINALISTS:]
    known = {setting: score(setting, None) for setting in leaders}
    spacing = np.array([10.0, np.diff(COARSE[1])[0], np.diff(COARSE[2])[0]])
    for _ in tqdm(range(ROUNDS), desc="refining", mininterval=5.0):
        spacing *= SHRINK
        leader = np.array(max(known, key=lambda each: known[each]))
        for step in product((-1.0, 0.0, 1.0), repeat=3):
            setting = tuple(np.clip(leader + spacing * np.array(step), RANGES[:, 0], RANGES[:, 1]).round(4).tolist())
            if setting not in known:
                known[setting] = score(setting, None)
    best = max(known, key=lambda each: known[each])
    return best[0], best[1], best[2]


def named(setting: tuple[float, ...]) -> dict[str, float]:
    """A setting as the arguments of the fixed controller."""
    return dict(zip(("frequency", "amplitude", "pressure"), (float(each) for each in setting), strict=True))


def interval(scores: np.ndarray, oracle: np.ndarray, seed: int = 0) -> dict[str, list[float] | float]:
    """Mean score and its share of the oracle's, with 95 % bootstrap intervals over episodes (drawn in pairs)."""
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, scores.size, (RESAMPLES, scores.size))
    means = scores[drawn].mean(axis=1)
    shares = means / oracle[drawn].mean(axis=1)
    return {
        "score": float(scores.mean()),
        "score_interval": np.percentile(means, [2.5, 97.5]).tolist(),
        "share": float(scores.mean() / oracle.mean()),
        "share_interval": np.percentile(shares, [2.5, 97.5]).tolist(),
    }


def headroom(environment: str, scenario: str) -> dict[str, Any]:
    """The table as a record."""
    setting = best_fixed(environment, scenario)
    entries: dict[str, Callable[[], Controller]] = {
        "random": lambda: controllers.make("random"),
        "best fixed": lambda: controllers.make("fixed", **named(setting)),
        "rules": lambda: controllers.make("rules"),
        "steady-oracle": lambda: controllers.make("steady-oracle"),
    }
    made: dict[str, Rollout] = {name: rollout(entry, environment, scenario) for name, entry in entries.items()}
    oracle = made["steady-oracle"].scores
    rows = {
        name: interval(each.scores, oracle)
        | {
            "penetration_rate": float(each.truths[..., T_RATE].mean()),
            "strong_share": float(each.truths[..., T_STRONG].mean()),
            "force_excess": float(each.truths[..., T_EXCESS].mean()),
        }
        for name, each in made.items()
    }
    episodes = len(oracle)
    return {
        "environment": environment,
        "scenario": scenario,
        "episodes": episodes,
        "best_fixed": named(setting),
        "rows": rows,
    }


def table(record: dict[str, Any]) -> str:
    """The record as a Markdown table."""
    lines = [
        "| controller | score, mm/s | share of the oracle | penetration, mm/s | strong P-1-I-1 | force excess, N |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in record["rows"].items():
        low, high = row["score_interval"]
        least, most = row["share_interval"]
        lines.append(
            f"| {name} | {row['score']:.2f} ({low:.2f} to {high:.2f}) | {row['share']:.3f} ({least:.3f} to {most:.3f}) "
            f"| {row['penetration_rate']:.2f} | {row['strong_share']:.2f} | {row['force_excess']:.0f} |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input."""
    parser = Parser(prog="python -m drillenv.training.headroom", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--environment", default="DrillLayers", help=f"one of {', '.join(KINDS)}")
    parser.add_argument("--scenario", default="test", help="a frozen set, or a file of one")
    parser.add_argument("--json", help="write the record to this file")
    try:
        given = parser.parse_args(arguments)
        choice("environment", given.environment, tuple(KINDS))
        read_scenario(given.scenario)
        if given.json is not None:
            check_writable(given.json)
        record = headroom(given.environment, given.scenario)
        if given.json is not None:
            with whole(given.json) as part:
                part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    setting = record["best_fixed"]
    print(f"{record['environment']}, {record['episodes']} episodes of {record['scenario']}; best fixed setting:")
    print(f"{setting['frequency']:g} Hz, {setting['amplitude']:g} V, {setting['pressure']:g} bar")
    print(table(record))
    return 0


if __name__ == "__main__":
    sys.exit(main())
