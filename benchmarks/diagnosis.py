"""How often the diagnosis is right, on campaigns whose truth is known: ``python -m benchmarks.diagnosis``.

    python -m benchmarks.diagnosis run nulls 100 --out docs/diagnosis/trials.jsonl
    python -m benchmarks.diagnosis run effects 2 --share 0.33 --out docs/diagnosis/trials.jsonl
    python -m benchmarks.diagnosis table docs/diagnosis/trials.jsonl

Each campaign has eight recordings of half a second (``--seconds``), of another rock, rig and settings, all drawn from
its seed. A run goes on where the file ends. Families:

``nulls``     nothing is missing, and each constant is off by its tolerance: any finding is a false alarm
``effects``   each mechanism of the library in turn, at a typical strength times ``--share``
``pairs``     two mechanisms drawn at random
``wrong``     one constant is off by several of its tolerances
``outside``   something that the library does not hold
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from drillenv.diagnosis.candidates import variants
from drillenv.diagnosis.rehearsal import Rehearsal, believed_constants, drawn_effect, rehearse
from drillenv.diagnosis.report import diagnose
from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, ON_SHAKER, Chosen, Effect, Parameter
from drillenv.dynamics.sensors_signals import filtered

MECHANISMS = tuple(dict.fromkeys(each.mechanism for each in variants()))


class Trial(NamedTuple):
    """A campaign and the answer to it."""

    made: Rehearsal
    verdict: str
    mechanisms: tuple[str, ...]


# --- Outside the library


def _floor(now, own, p, push, rates):
    sway = p[0] * math.sin(2.0 * math.pi * p[1] * now.time)
    push[ON_SHAKER] += now.m1 * sway
    push[ON_INDENTER] += now.m2 * sway


def _lift(now, own, p, push, rates):
    push[ON_SHAKER] -= p[0] * (1.0 + math.sin(2.0 * math.pi * p[1] * now.time))


def _gain_drifts(true, read, p):
    return read._replace(force=read.force * (1.0 + p[0] * true.time))


def _crosstalk(true, read, p):
    return read._replace(acceleration=read.acceleration + p[0] * true.force)


def _cell_creeps(true, read, p):
    """A load cell of which a share of the reading comes late."""
    late = filtered(read.force, 0.0, read.rate, (1.0,), (p[1], 1.0))
    return read._replace(force=(1.0 - p[0]) * read.force + p[0] * late)


def _outsider(name: str, symbols: dict[str, tuple[float, float]], **does: Any) -> Effect:
    parameters = tuple(Parameter(s, s, "1", -1e9, 1e9, 0.0, typical) for s, typical in symbols.items())
    return Effect(
        name, "Not of the library.", "-", "constitutive", parameters, ("indenter",), EVERYWHERE, "moves", **does
    )


OUTSIDERS = (
    _outsider("floor-vibration", {"a": (2.0, 8.0), "f": (20.0, 45.0)}, term=_floor),
    _outsider("hose-surge", {"a": (10.0, 40.0), "f": (3.0, 9.0)}, term=_lift),
    _outsider("gain-drift", {"a": (0.02, 0.08)}, measure=_gain_drifts),
    _outsider("crosstalk", {"a": (0.005, 0.02)}, measure=_crosstalk),
    _outsider("cell-creep", {"a": (0.03, 0.1), "tau": (2e-3, 8e-3)}, measure=_cell_creeps),
)


# --- Families


def _rng(*words: int) -> np.random.Generator:
    return np.random.default_rng(words)


def _case(rng: np.random.Generator) -> int:
    return int(rng.integers(1, 7))


def _null(seed: int, share: float, seconds: float) -> Trial:
    rng = _rng(1, seed)
    return Trial(rehearse(rng, _case(rng), seconds=seconds), "agrees", ())


def _missing(made: Rehearsal, chosen: Sequence[Chosen]) -> Trial:
    """What is to be found: not a limit of the drive that no recording ever asks it for."""
    most = max(made.rig.drive_force(each.setting) for each in made.campaign.recordings if each.setting)
    names = [each.effect.name for each in chosen if each.effect.name != "force-limit" or each.values[0] < most]
    return Trial(made, "missing-physics" if names else "agrees", tuple(names))


def _effect(seed: int, share: float, seconds: float) -> Trial:
    name, rng = MECHANISMS[seed % len(MECHANISMS)], _rng(2, seed)
    chosen = drawn_effect(name, rng, share)
    return _missing(rehearse(rng, _case(rng), (chosen,), seconds=seconds), (chosen,))


def _pair(seed: int, share: float, seconds: float) -> Trial:
    rng = _rng(3, seed)
    names = sorted(rng.choice(len(MECHANISMS), 2, replace=False).tolist())
    chosen = [drawn_effect(MECHANISMS[i], rng, share) for i in names]
    return _missing(rehearse(rng, _case(rng), chosen, seconds=seconds), chosen)


def _wrong(seed: int, share: float, seconds: float) -> Trial:
    rng = _rng(4, seed)
    case = _case(rng)
    stated = believed_constants(case)
    name = tuple(stated)[seed % len(stated)]
    believed, width = stated[name].value or 1.0, stated[name].std or 0.0
    # a rock that is softer on the way out than on the way in would give energy away
    sign = {"unloading_stiffness": 1.0, "loading_stiffness": -1.0}.get(name, 1.0 if rng.random() < 0.5 else -1.0)
    away = sign * share * float(rng.uniform(6.0, 10.0)) * width
    return Trial(rehearse(rng, case, wrong={name: 1.0 + away / believed}, seconds=seconds), "parameters", (name,))


def _outside(seed: int, share: float, seconds: float) -> Trial:
    rng = _rng(5, seed)
    effect = OUTSIDERS[seed % len(OUTSIDERS)]
    values = tuple(share * float(rng.uniform(*part.typical)) if i == 0 else float(rng.uniform(*part.typical))
                   for i, part in enumerate(effect.parameters))  # fmt: skip
    return Trial(rehearse(rng, _case(rng), (Chosen(effect, values),), seconds=seconds), "unexplained", (effect.name,))


FAMILIES: dict[str, Callable[[int, float, float], Trial]] = {
    "nulls": _null,
    "effects": _effect,
    "pairs": _pair,
    "wrong": _wrong,
    "outside": _outside,
}


def judged(family: str, seed: int, share: float, seconds: float) -> dict[str, Any]:
    """One campaign, what is true of it, and what the diagnosis said."""
    trial = FAMILIES[family](seed, share, seconds)
    start, work = time.perf_counter(), time.process_time()
    record = diagnose(trial.made.campaign).record
    truth = {
        each.effect.name: {part.symbol: value for part, value in zip(each.effect.parameters, each.values, strict=True)}
        for each in trial.made.effects
    }
    return {
        "family": family,
        "seed": seed,
        "share": share,
        "recorded": seconds,
        "title": trial.made.campaign.title,
        "truth": {"verdict": trial.verdict, "names": trial.mechanisms, "effects": truth},
        "verdict": record["verdict"],
        "findings": [
            {key: each[key] for key in ("mechanism", "equivalents", "parameters", "evidence")}
            for each in record["findings"]
        ],
        "wrong": sorted(record["parameters"]),
        "fit": record["fit"],
        "rejected": record["rejected"][:5],
        "where": record["where"]["summary"],
        "seconds": round(time.perf_counter() - start, 1),
        "processor_seconds": round(time.process_time() - work, 1),
    }


def right(entry: dict[str, Any]) -> bool:
    """Whether verdict and names are those of the truth."""
    if entry["verdict"] != entry["truth"]["verdict"]:
        return False
    if entry["verdict"] == "missing-physics":
        return {each["mechanism"] for each in entry["findings"]} == set(entry["truth"]["names"])
    return entry["verdict"] != "parameters" or entry["wrong"] == sorted(entry["truth"]["names"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="make campaigns and have them diagnosed")
    run.add_argument("family", choices=FAMILIES)
    run.add_argument("count", type=int, help="campaigns; of `effects`, for each mechanism")
    run.add_argument("--share", type=float, default=1.0, help="of the typical strength")
    run.add_argument("--seconds", type=float, default=0.5, help="of each recording")
    run.add_argument("--first", type=int, default=0, help="seed of the first campaign")
    run.add_argument("--out", type=Path, required=True, help="file of JSON lines that results are added to")
    table = commands.add_parser("table", help="what the trials come to")
    table.add_argument("trials", type=Path)
    args = parser.parse_args()
    if args.command == "table":
        print(summary([json.loads(line) for line in args.trials.read_text().splitlines()]))
        return
    done = set()
    if args.out.exists():
        entries = (json.loads(line) for line in args.out.read_text().splitlines())
        done = {(each["family"], each["seed"], each["share"], each["recorded"]) for each in entries}
    count = args.count * (len(MECHANISMS) if args.family == "effects" else 1)
    for seed in tqdm(range(args.first, args.first + count), desc=args.family, mininterval=5.0):
        if (args.family, seed, args.share, args.seconds) in done:
            continue
        entry = judged(args.family, seed, args.share, args.seconds)
        with args.out.open("a") as file:
            file.write(json.dumps(entry) + "\n")


def summary(entries: list[dict[str, Any]]) -> str:
    """A table of verdicts, and how often the intervals hold the truth."""
    lines = ["| family | strength | campaigns | right | wrong ones |", "|---|---|---|---|---|"]
    groups = sorted({(each["family"], each["share"]) for each in entries})
    for family, share in groups:
        own = [each for each in entries if (each["family"], each["share"]) == (family, share)]
        bad = [
            f"{'+'.join(each['truth']['names']) or 'nothing'} -> "
            f"{each['verdict']} {'+'.join(f['mechanism'] for f in each['findings'])}".strip()
            for each in own
            if not right(each)
        ]
        shown = "; ".join(sorted(set(bad)))
        lines.append(f"| {family} | {share:g} | {len(own)} | {len(own) - len(bad)} | {shown} |")
    hits, total = inside(entries)
    held = [
        each["fit"]["held_out"]["after"] for each in entries if each["verdict"] == "missing-physics" and right(each)
    ]
    good = sum(value is not None and value <= 1.15 for value in held)
    lines += [
        "",
        f"Strengths inside their 95 % interval: {hits} of {total}.",
        f"Held-out error within 1.15 of the noise where rightly explained: {good} of {len(held)}.",
    ]
    return "\n".join(lines)


def inside(entries: list[dict[str, Any]]) -> tuple[int, int]:
    """How many strengths of rightly named mechanisms lie in their interval, of how many."""
    hits = total = 0
    for entry in entries:
        if not (entry["verdict"] == "missing-physics" and right(entry)):
            continue
        for finding in entry["findings"]:
            true = entry["truth"]["effects"][finding["mechanism"]]
            for symbol, found in finding["parameters"].items():
                total += 1
                hits += abs(found["value"] - true[symbol]) <= 1.96 * found["std"]
    return hits, total


if __name__ == "__main__":
    main()
