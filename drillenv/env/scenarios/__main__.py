"""Draw sets anew: ``python -m drillenv.env.scenarios FOLDER``.

Of the frozen ones it gives those of rocks, layers and holes. Hidden rigs are drawn from the library of effects, which
has grown since those of version 1 were frozen.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np

from drillenv.env.episodes import (
    BLOWS_RANGE,
    LAG_RANGE,
    Episode,
    draw_effect,
    draw_layers,
    draw_rig,
    draw_rocks,
    rig_array,
)
from drillenv.env.hole.episodes import DEPTH, draw_hole
from drillenv.env.scenarios import FORMAT, KINDS, SETS
from drillenv.files import whole
from drillenv.rig import Rig
from drillenv.rocks import ROCKS

VERSION = 1
SIZES = {"train": 200, "validation": 30, "test": 60, "beyond": 60}
SEEDS = {"train": 20_260_101, "validation": 20_260_202, "test": 20_260_303, "beyond": 20_260_404}
HOLE_SEEDS = {"train": 20_261_101, "validation": 20_261_202, "test": 20_261_303}


def draw_set(name: str) -> dict[str, object]:
    """The record of one set. Test and validation hold every case of Table 2.2 equally often as single rock."""
    rng = np.random.default_rng(SEEDS[name])
    beyond = name == "beyond"
    episodes: dict[str, list[dict[str, object]]] = {}
    for kind in KINDS:
        episodes[kind] = []
        for i in range(SIZES[name]):
            layers = draw_layers(rng, beyond)
            if kind == "rock":
                case = 1 + i % len(ROCKS)
                kl, ku = layers[0, :2] if beyond else draw_rocks(np.array([case]), rng)[0]
                layers = np.array([[kl, ku, math.inf, float(case)]])
            hidden = kind == "hidden"
            rig = rig_array(Rig())
            episode = Episode(
                layers=layers,
                lag=float(rng.uniform(*LAG_RANGE)),
                blows=int(rng.integers(BLOWS_RANGE[0], BLOWS_RANGE[1] + 1)),
                phase=float(rng.uniform(0.0, 2 * math.pi)),
                rig=draw_rig(rig, rng) if hidden else rig,
                effects=draw_effect(rng) if hidden else {},
            )
            episodes[kind].append(episode.as_record())
    return {"format": FORMAT, "name": name, "version": VERSION, "episodes": episodes}


def draw_holes(name: str) -> dict[str, object]:
    """The record of one set of holes."""
    rng = np.random.default_rng(HOLE_SEEDS[name])
    holes = [draw_hole(DEPTH, rng).as_record() for _ in range(SIZES[name])]
    return {"format": FORMAT, "name": name, "version": VERSION, "episodes": {"hole": holes}}


def text_of(record: dict[str, object]) -> str:
    """JSON with one episode a line."""
    episodes = record["episodes"]
    assert isinstance(episodes, dict)
    head = {key: value for key, value in record.items() if key != "episodes"}
    kinds = [
        f'  "{kind}": [\n' + ",\n".join("   " + json.dumps(each) for each in rows) + "\n  ]"
        for kind, rows in episodes.items()
    ]
    return json.dumps(head)[:-1] + ',\n "episodes": {\n' + ",\n".join(kinds) + "\n }\n}\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name in SETS:
        with whole(folder / f"{name}.json") as part:
            part.write_text(text_of(draw_set(name)), encoding="utf-8")
        sys.stdout.write(f"{folder / name}.json\n")
    for name in HOLE_SEEDS:
        with whole(folder / f"{name}-hole.json") as part:
            part.write_text(text_of(draw_holes(name)), encoding="utf-8")
        sys.stdout.write(f"{folder / name}-hole.json\n")
