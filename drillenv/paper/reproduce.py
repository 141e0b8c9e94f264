"""Every published motion computed, and the paper's figures drawn from the model."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from drillenv.atlas.boundary import boundaries, boundary
from drillenv.atlas.sweep import Sweep, sweep
from drillenv.dynamics.motion import Motion, motion, motions
from drillenv.files import made_folder, whole
from drillenv.paper.published import (
    BOUNDARIES,
    FORCE_2_4,
    MOTIONS,
    ORDER_3_2,
    ORDER_4_4,
    SETTING_4_4,
    SWEEP_3_2,
    BoundaryRow,
    MotionRow,
)
from drillenv.rocks import ROCKS

STARTS = 64
"""Random starts tried for motions that coexist with the one from rest."""

Row = dict[str, Any]


def reproduce(out: str | os.PathLike[str], progress: bool = False) -> list[Row]:
    """Compute every row of the published motions and draw a figure for each of 2.5, 3.2 and 4.1 to 4.4.

    Writes ``published.json`` and ``figure-N.N.png`` into the folder ``out``, made if it is not there. No constant is
    moved to remove a difference.

    Args:
        out: The folder.
        progress: Whether to show a progress bar on stderr.

    Returns:
        The rows, each with figure, setting, published, computed, agrees and what else belongs to its kind.

    Raises:
        InputError: the folder cannot be made or written.
    """
    from tqdm import tqdm

    from drillenv.paper.figures import FIGURES

    folder = made_folder(out)
    frequency = sweep(SWEEP_3_2, "frequency", 50.0, 120.0, 0.1, rock=4)
    # the published order has motions that live on a hundredth of a hertz
    fine = sweep(SWEEP_3_2, "frequency", 50.0, 120.0, 0.01, rock=4, direction="up")
    with tqdm(total=len(MOTIONS) + len(BOUNDARIES) + len(FIGURES), disable=not progress, desc="paper") as bar:
        rows: list[Row] = []
        for published in MOTIONS:
            rows.append(motion_row(published))
            bar.update()
        rows += [force_row(), order_row(fine)]
        for line in BOUNDARIES:
            rows.append(boundary_row(line))
            bar.update()
        rows.append(rocks_row())
        for number, draw in FIGURES.items():
            figure = draw(frequency)
            with whole(folder / f"figure-{number}.png") as temporary:
                figure.savefig(temporary, format="png", dpi=150)
            bar.update()
    rows.sort(key=lambda row: row["figure"])
    with whole(folder / "published.json") as temporary:
        temporary.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return rows


def matches(found: Motion, published: str) -> bool:
    """Whether a motion is what the paper calls it."""
    if published == "period two":
        return found.period == 2
    if published == "multiple impacts":
        return found.period > 0 and found.impacts >= 3 * found.period
    return found.label == published


def motion_row(published: MotionRow) -> Row:
    """A published motion beside the one that the rig settles on from rest, and those that coexist with it."""
    found = motion(published.setting, published.rock)
    others = motions(published.setting, published.rock, starts=STARTS, seed=0)
    return {
        "figure": published.figure,
        "kind": "motion",
        "rock": published.rock,
        "setting": asdict(published.setting),
        "published": published.published,
        "source": published.source,
        "computed": found.label,
        "agrees": matches(found, published.published),
        "coexisting": [{"label": other.label, "share": other.share} for other in others],
        "peak_force": found.peak_force,
        "penetration_rate": found.penetration_rate,
        "largest_multiplier": float(abs(found.multipliers[0])) if found.period else None,
    }


def boundary_row(line: BoundaryRow) -> Row:
    """A published boundary beside the value at which the followed orbit ends."""
    begin = getattr(line.inside, line.over)
    if line.swept:
        swept = sweep(line.inside, line.over, begin, line.outside, _last_digit(line), rock=line.rock, direction="up")
        found = next(end for end in boundaries(swept) if end.beyond == line.after)
    else:
        found = boundary(line.inside, line.over, begin, line.outside, rock=line.rock)
    return {
        "figure": line.figure,
        "kind": "boundary",
        "rock": line.rock,
        "setting": {name: value for name, value in asdict(line.inside).items() if name != line.over},
        "over": line.over,
        "published": line.published,
        "between": [line.before, line.after],
        "computed": found.value,
        "difference": found.value - line.published,
        "bifurcation": found.kind,
        "followed": found.label,
        "beyond": found.beyond,
        # the printed digits are all that can be asked for
        "agrees": abs(found.value - line.published) <= _last_digit(line),
    }


def _last_digit(line: BoundaryRow) -> float:
    """The step of the published sweep: 0.1 Hz, 1 mV, 0.01 bar."""
    return {"frequency": 0.1, "amplitude": 0.001, "pressure": 0.01}[line.over]


def order_row(frequency: Sweep) -> Row:
    """The order of motions along Fig. 3.2, on the way up."""
    labels = _runs(frequency.labels("up"))
    return {
        "figure": "3.2",
        "kind": "order",
        "rock": 4,
        "setting": {"amplitude": SWEEP_3_2.amplitude, "pressure": SWEEP_3_2.pressure},
        "over": "frequency",
        "published": list(ORDER_3_2),
        "computed": labels,
        "agrees": _in_order(ORDER_3_2, labels),
    }


def rocks_row() -> Row:
    """The order of periods over the six rocks of Fig. 4.4."""
    order = sorted(ROCKS, key=lambda case: ROCKS[case].loading_stiffness)
    found = {case: motion(SETTING_4_4, case) for case in order}
    return {
        "figure": "4.4",
        "kind": "order",
        "setting": asdict(SETTING_4_4),
        "over": "rock, by loading stiffness",
        "published": list(ORDER_4_4),
        "computed": [{"rock": case, "label": found[case].label} for case in order],
        "agrees": tuple(_runs([found[case].period for case in order])) == ORDER_4_4,
    }


def force_row() -> Row:
    """The largest contact force of Fig. 2.4, which is of a measurement and read off as about 3.0 kN."""
    setting, published = FORCE_2_4
    found = motion(setting, 4)
    return {
        "figure": "2.4",
        "kind": "force",
        "rock": 4,
        "setting": asdict(setting),
        "published": published,
        "source": "measured",
        "computed": found.peak_force,
        "difference": found.peak_force - published,
        "agrees": abs(found.peak_force - published) <= 50.0,
    }


def _runs(values: Iterable[Any]) -> list[Any]:
    """Values with immediate repeats left out."""
    kept: list[Any] = []
    for value in values:
        value = value.item() if hasattr(value, "item") else value
        if not kept or kept[-1] != value:
            kept.append(value)
    return kept


def _in_order(wanted: Iterable[str], labels: Iterable[str]) -> bool:
    """Whether ``wanted`` appear among ``labels`` in this order, others in between allowed."""
    rest = iter(labels)
    return all(label in rest for label in wanted)
