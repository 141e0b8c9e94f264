"""Whether planned settings name more mechanisms than settings spread evenly: campaigns of the concealed rig.

    python -m benchmarks.plan --out plan.json --seed 20261823
    python -m benchmarks.plan --out plan.json --shares 1 --motion
    python -m benchmarks.plan --out plan.json --show

Each mechanism of the catalogue is concealed alone at a strength that shows, at a third and at a tenth of it, in a
campaign with planned settings and one with settings spread by a Latin hypercube over the same box. Strengths, constants
and the noise's generator are the same in both; the plan is made of the nominal rig, which is not quite the one that is
recorded. The file is written after each diagnosis, and gone on with, and with its plan, where it holds some already.
"""

from __future__ import annotations

import argparse
import json
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drillenv.blind.campaigns import BOX, FRESH, NOISE, Conditions, draw_settings, record_campaign
from drillenv.blind.marking import mark
from drillenv.blind.mechanisms import MECHANISMS, Concealed, Site, concealed
from drillenv.blind.rig import DRIVE_AT_ZERO, DRIVE_PER_HERTZ
from drillenv.blind.sensors import Logger
from drillenv.diagnosis.report import diagnose
from drillenv.files import whole
from drillenv.planning.plan import plan_campaign
from drillenv.rig import Setting
from drillenv.rocks import rock

SHARES = (1.0 / 3.0, 1.0, 0.1)
"""Of the strength that shows, in the order in which they are tried."""
CASE, SECONDS, RATE = 4, 0.4, 25600.0
MANY = 8
PATIENCE = 300
"""Processor seconds for a diagnosis, after which it has given no answer, as in the blind trial."""


class Design(NamedTuple):
    """Settings, and which of them start from rest."""

    settings: list[Setting]
    fresh: tuple[int, ...]

    @property
    def drive(self) -> float:
        """N, the largest amplitude of the drive's force."""
        return max((DRIVE_PER_HERTZ * each.frequency + DRIVE_AT_ZERO) * each.amplitude for each in self.settings)


def planned() -> Design:
    """As a plan has them, over the box of the blind trial."""
    plan = plan_campaign(rock(CASE), settings=MANY, seconds=SECONDS, box=(BOX[0], BOX[1], BOX[2]))
    fresh = tuple(i for i, each in enumerate(plan.recordings) if each.starts == "fresh")
    return Design([each.setting for each in plan.recordings], fresh)


def spread(rng: np.random.Generator) -> Design:
    """As the blind trial has them."""
    return Design(draw_settings(rng, MANY), FRESH)


def cases(
    seed: int, plan: Design, shares: Sequence[float] = SHARES, motion: bool = False
) -> Iterator[tuple[dict[str, Any], Design, Concealed]]:
    """What to diagnose: a key, the settings, and what is concealed. All randomness is of the seed and the key.

    Args:
        seed: Of the benchmark.
        plan: Settings that were planned.
        shares: Of the strength that shows.
        motion: Whether to leave out what acts on sensors alone.
    """
    for share in shares:
        for number, (name, mechanism) in enumerate(MECHANISMS.items()):
            if motion and all(each.place is None for each in mechanism.equations):
                continue
            even = spread(np.random.default_rng((seed, number, 0)))
            # what is drawn in proportion to the site is the same in both
            site = Site(min(plan.drive, even.drive), max(each.frequency for each in even.settings))
            equation = next(each for each in mechanism.equations if each.of_library)
            hidden = concealed(name, equation, np.random.default_rng((seed, number, 1)), share, site)
            for kind, design in (("planned", plan), ("spread", even)):
                yield {"mechanism": name, "share": round(share, 4), "settings": kind, "number": number}, design, hidden


def marked(seed: int, key: Mapping[str, Any], design: Design, hidden: Concealed) -> dict[str, Any]:
    """Record a campaign, diagnose it, and mark the answer by the rules of the blind trial."""
    logger = Logger(RATE, 0.0, "none", 0.4, 24, NOISE, "white")
    conditions = Conditions(CASE, SECONDS, logger, False, False)
    rng = np.random.default_rng((seed, key["number"], 2))
    title = f"{key['mechanism']}, {key['settings']}"
    made = record_campaign(
        rng, conditions, [hidden], design.settings, {}, title, "library-equation", fresh=design.fresh
    )
    begun = time.process_time()
    status, report = "answered", None
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        report = diagnose(made.campaign, jobs=1)
    except (TimeoutError, ValueError, ArithmeticError) as error:
        status = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    seconds = time.process_time() - begun
    outcome = {"status": status, "seconds": seconds, "memory_mib": 0.0}
    made_of = mark(made.answer, outcome, None if report is None else dict(report.record))
    kept = ("verdict", "findings", "named", "right", "mechanisms", "status")
    return dict(key) | {name: made_of[name] for name in kept} | {
        "parameters": dict(hidden.parameters),
        "seconds": round(seconds, 1),
    }  # fmt: skip


def out_of_time(_number: int, _frame: object) -> None:
    """Ends a diagnosis."""
    raise TimeoutError(f"no answer within {PATIENCE} processor seconds")


def counts(done: Sequence[Mapping[str, Any]]) -> list[tuple[float, int, int, int]]:
    """Of each share: mechanisms tried with both kinds of settings, and how many were named with each."""
    found = []
    for share in sorted({each["share"] for each in done}, reverse=True):
        by_kind = {
            kind: {
                each["mechanism"]: each["named"] for each in done if each["share"] == share and each["settings"] == kind
            }
            for kind in ("planned", "spread")
        }
        both = set(by_kind["planned"]) & set(by_kind["spread"])
        found.append((share, len(both), *(sum(by_kind[kind][name] for name in both) for kind in by_kind)))
    return found


def show(done: Sequence[Mapping[str, Any]]) -> None:
    """Print a table."""
    print("share of the strength  mechanisms  named, planned  named, spread")
    for share, tried, by_plan, by_spread in counts(done):
        print(f"{share:>21.3f}  {tried:>10}  {by_plan:>14}  {by_spread:>13}")
    for name in dict.fromkeys(each["mechanism"] for each in done):
        cells = []
        for each in done:
            if each["mechanism"] == name:
                said = "named" if each["named"] else f"{each['verdict']} {','.join(each['findings'])}".strip()
                cells.append(f"{each['settings']} {each['share']:.2g}: {said}")
        print(f"{name:<24} " + "; ".join(cells))


def main() -> None:
    """Diagnose what is not in the file yet, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, help="JSON, gone on with where it is there")
    parser.add_argument("--seed", type=int, default=20261823)
    parser.add_argument("--shares", type=float, nargs="+", default=SHARES, help="of the strength that shows")
    parser.add_argument("--motion", action="store_true", help="only mechanisms that act on the motion")
    parser.add_argument("--show", action="store_true", help="only print what the file has")
    given = parser.parse_args()
    path = Path(given.out)
    record = json.loads(path.read_text()) if path.exists() else {"seed": given.seed, "plan": None, "done": []}
    if not given.show:
        if record["seed"] != given.seed:
            raise SystemExit(f"{path} is of seed {record['seed']}: give another --out")
        signal.signal(signal.SIGPROF, out_of_time)
        if record["plan"] is None:
            plan = planned()
            settings = [[each.frequency, each.amplitude, each.pressure] for each in plan.settings]
            record["plan"] = {"settings": settings, "fresh": list(plan.fresh)}
        plan = Design([Setting(*each) for each in record["plan"]["settings"]], tuple(record["plan"]["fresh"]))
        there = {(each["mechanism"], each["share"], each["settings"]) for each in record["done"]}
        for key, design, hidden in cases(given.seed, plan, given.shares, given.motion):
            if (key["mechanism"], key["share"], key["settings"]) in there:
                continue
            record["done"].append(marked(given.seed, key, design, hidden))
            with whole(path) as part:
                part.write_text(json.dumps(record, indent=1) + "\n")
            last = record["done"][-1]
            print(
                key["mechanism"],
                key["share"],
                key["settings"],
                last["named"],
                last["findings"],
                last["seconds"],
                flush=True,
            )
    show(record["done"])


if __name__ == "__main__":
    main()
