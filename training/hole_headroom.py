"""What is there to win in ``DrillBit``? Controllers on frozen holes, and what each action is worth.

    python -m drillenv.training.hole_headroom --json headroom-bit.json --table docs/environment/README.md

Each row is written to the file when it is done, and not run again if it is there. Policies of several seeds are
one row.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from drillenv import controllers
from drillenv.checks import InputError, count, shown
from drillenv.cli import Parser
from drillenv.controllers import Controller, OnPlant, sees_truth
from drillenv.controllers.fixed import Random
from drillenv.controllers.hole.certainty_equivalent import HolePlanner, KnowingPlanner
from drillenv.controllers.hole.learned import HoleLearned
from drillenv.controllers.hole.oracle import Greedy, HoleOracle
from drillenv.controllers.hole.planning import physics_of, settings_grid, solve
from drillenv.controllers.hole.rules import HoleFixed, HoleRules
from drillenv.controllers.policies.stable_baselines import read_model
from drillenv.env.hole.costs import BIT, WELL_DRILLED
from drillenv.env.hole.task import HoleTask
from drillenv.env.registration import HOLE_IDS
from drillenv.files import check_writable, whole
from drillenv.training.headroom import RESAMPLES
from drillenv.training.league_table import put
from drillenv.training.rollout import action_of

FORMAT = "drillenv-hole-headroom/1"
PINNED = ("frequency", "amplitude", "pressure")
PIN_HOLES = 10
"""Holes of "validation" on which the best constant of a pinned action is searched, by the plan alone."""
ORACLE = "oracle"
NOISES = 3
"""Times that a hole is drilled by those who see readings only, each with other noise on them."""


class RandomHole(Random):
    """Any setting, evenly; a new bit every fiftieth step."""

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """A new action each time."""
        change = 1.0 if self._rng.random() < 0.02 else -1.0
        return np.append(super().act(observation, info), np.float32(change))


def pinned(control: int, constant: int) -> np.ndarray:
    """(n, 3) the settings of the grid with the ``constant``-th value of a control."""
    grid = settings_grid()
    return grid[grid[:, control] == np.unique(grid[:, control])[constant]]


def best_pin(control: int) -> np.ndarray:
    """(n, 3) the settings with the best constant of a control, by the plan's cost."""
    task = HoleTask(scenario="validation")
    assert task.scenario is not None
    holes = task.scenario.episodes["hole"][:PIN_HOLES]
    values = np.unique(settings_grid()[:, control]).size
    costs = np.zeros(values)
    for j in tqdm(range(values), desc=PINNED[control], disable=None):
        settings = pinned(control, j)
        for hole in holes:
            ph = physics_of(task, hole)
            costs[j] += (solve(ph, settings, 0, True)[0, 0, 0, 0] + ph.costs[BIT]) / hole.depth / len(holes)
    return pinned(control, int(np.argmin(costs)))


def entries(policies: Sequence[str]) -> dict[str, Callable[[], list[Controller]]]:
    """The rows, each made when it is run.

    Args:
        policies: Folders of policies, or models that Stable-Baselines3 saved, each called ROW-SEED.

    Raises:
        InputError: one is called otherwise.
    """
    rows: dict[str, Callable[[], list[Controller]]] = {
        ORACLE: lambda: [HoleOracle()],
        "random": lambda: [RandomHole()],
        "fixed": lambda: [HoleFixed()],
        "rules": lambda: [HoleRules()],
        "greedy, by the reward": lambda: [Greedy(wear_share=0.0)],
        "greedy, wear at the price of a bit": lambda: [Greedy(wear_share=1.0)],
        "greedy, wear and metres at their prices": lambda: [Greedy(metre=WELL_DRILLED)],
        "planner": lambda: [HolePlanner()],
        "planner, knows all but the strengths": lambda: [KnowingPlanner()],
        "oracle, no change of bits": lambda: [HoleOracle(changes=False)],
    }
    for control, name in enumerate(PINNED):
        rows[f"oracle, {name} pinned"] = lambda control=control: [HoleOracle(settings=best_pin(control))]
    for name, paths in by_row(policies).items():
        many = f"{len(paths)} seed{'s' if len(paths) > 1 else ''}"
        rows[f"{name}, {many}"] = lambda paths=paths: [learned(each) for each in paths]
    return rows


def by_row(policies: Sequence[str]) -> dict[str, list[Path]]:
    """Policies that were trained alike, each from another seed, by the names of their rows.

    Raises:
        InputError: one is not called ROW-SEED.
    """
    found: dict[str, list[Path]] = {}
    for path in map(Path, policies):
        row, _, seed = path.name.removesuffix(".zip").rpartition("-")
        if not row or not seed.isdecimal():
            raise InputError(f"policy {shown(path.name)} says neither row nor seed: call it ROW-SEED, as ppo-0")
        found.setdefault(row, []).append(path)
    return found


def learned(path: Path) -> Controller:
    """The controller of a policy's folder, or of a model that Stable-Baselines3 saved.

    Raises:
        InputError: it is neither, or of another task.
    """
    if path.suffix == ".zip":
        return controllers.make("learned", policy=read_model(path, HOLE_IDS[0]))
    return HoleLearned(path)


def row_of(
    alike: Sequence[Controller], scenario: str, episodes: int, steps: int | None = None
) -> dict[str, list[float]]:
    """What controllers of one kind did in each hole, in the mean over them and over the noise."""
    made = [
        play(each, scenario, episodes, seed, steps)
        for each in alike
        for seed in range(1 if sees_truth(each) else NOISES)
    ]
    return {name: np.mean([each[name] for each in made], axis=0).tolist() for name in made[0]}


def play(
    controller: Controller, scenario: str, episodes: int, seed: int, steps: int | None = None
) -> dict[str, list[float]]:
    """What a controller did in each hole, of which ``steps`` are the most, those of the registration where left out.

    Raises:
        InputError: what the controller gives is no action.
    """
    env = gym.make("drillenv/DrillBit-v0", scenario=scenario, max_episode_steps=steps)
    kept: dict[str, list[float]] = {name: [] for name in (*MEASURES, "plan")}
    for episode in tqdm(range(episodes), disable=None):
        observation, info = env.reset(seed=seed, options={"episode": episode})
        if isinstance(controller, OnPlant):
            controller.attach(env.unwrapped.get_state)  # type: ignore[attr-defined]
        controller.reset(seed)
        single, done, ended = 0.0, 0, False
        while not ended:
            action = action_of(controller, observation, info if sees_truth(controller) else {}, 4)
            observation, _reward, terminated, truncated, info = env.step(action)
            single, done, ended = single + info["strong_share"], done + 1, terminated or truncated
        for name in MEASURES:
            kept[name].append(single / done if name == "strong_share" else float(info[name]))
        if type(controller) is HoleOracle:
            kept["plan"].append(controller.bound())
    return kept


DIGITS = {"cost": 1, "share": 3}
"""Decimals of what a summary holds, in a table."""
MEASURES = ("cost_per_metre", "hole_depth", "time", "bits_changed", "bits_broken", "trips", "strong_share")


def summary(record: dict[str, Any]) -> dict[str, dict[str, list[float]]]:
    """What each row is worth, with 95 % bootstrap intervals over holes, which all rows share.

    Returns:
        Of each row ``cost``, its mean cost per metre in EUR/m, and ``share``, the oracle's over it; each with the ends
        of its interval.
    """
    oracle = np.array(record["rows"][ORACLE]["cost_per_metre"])
    drawn = np.random.default_rng(0).integers(0, oracle.size, (RESAMPLES, oracle.size))
    best, found = oracle[drawn].mean(axis=1), {}
    for name, row in record["rows"].items():
        costs = np.array(row["cost_per_metre"])
        means = costs[drawn].mean(axis=1)
        found[name] = {
            "cost": [float(costs.mean()), *np.percentile(means, [2.5, 97.5]).tolist()],
            "share": [float(oracle.mean() / costs.mean()), *np.percentile(best / means, [2.5, 97.5]).tolist()],
        }
    return found


def table(record: dict[str, Any], labels: Mapping[str, str] = MappingProxyType({})) -> str:
    """The record as a Markdown table. ``labels`` are what rows are called, where that is not their name."""
    lines = [
        "| controller | cost, EUR/m | share of the oracle | m/h | bits changed | broken | trips | strong P-1-I-1 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    found = summary(record)
    for name, row in sorted(record["rows"].items(), key=lambda item: np.mean(item[1]["cost_per_metre"])):
        means = {measure: float(np.mean(row[measure])) for measure in MEASURES}
        cost, share = ("{:.{d}f} ({:.{d}f} to {:.{d}f})".format(*found[name][key], d=d) for key, d in DIGITS.items())
        speed = 3600 * np.sum(row["hole_depth"]) / np.sum(row["time"])
        lines.append(
            f"| {labels.get(name, name)} | {cost} | {share} | {speed:.2f} "
            f"| {means['bits_changed']:.1f} | {means['bits_broken']:.1f} | {means['trips']:.1f} "
            f"| {means['strong_share']:.2f} |"
        )
    plan = np.mean(record["rows"][ORACLE]["plan"])
    lines.append(f"\nThe plan of the settled motion, which the oracle carries out, costs {plan:.1f} EUR/m.")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input."""
    parser = Parser(prog="python -m drillenv.training.hole_headroom", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--scenario", default="test", help="a frozen set of holes (default test)")
    parser.add_argument("--episodes", type=int, default=60, help="the first so many (default 60)")
    parser.add_argument("--json", type=Path, required=True, help="the record, which is gone on with where it exists")
    parser.add_argument("--table", type=Path, help="write the table into its place in this page")
    note = "policies of drillenv train on DrillBit or models of Stable-Baselines3 (zip), each called ROW-SEED"
    parser.add_argument("--policies", nargs="+", default=[], metavar="PATH", help=note)
    try:
        given = parser.parse_args(arguments)
        episodes = count("episodes", given.episodes, 1, 1000)
        check_writable(given.json)
        record = begun(given.json, given.scenario, episodes)
        for name, make in entries(given.policies).items():
            if name not in record["rows"]:
                record["rows"][name] = row_of(make(), given.scenario, episodes)
                with whole(given.json) as part:
                    part.write_text(json.dumps(record) + "\n", encoding="utf-8")
        if given.table is not None:
            put(given.table, {"hole-headroom": table(record)})
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(table(record))
    return 0


def begun(file: Path, scenario: str, episodes: int) -> dict[str, Any]:
    """The record of an earlier call, or a new one.

    Raises:
        InputError: the file is of something else.
    """
    head = {"format": FORMAT, "scenario": scenario, "episodes": episodes}
    if not file.is_file():
        return {**head, "rows": {}}
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        same = {key: record[key] for key in head} == head and isinstance(record["rows"], dict)
    except (ValueError, KeyError, TypeError):
        same = False
    if not same:
        raise InputError(f"{file} is not a record of {episodes} holes of {scenario}: give another name")
    return record


if __name__ == "__main__":
    sys.exit(main())
