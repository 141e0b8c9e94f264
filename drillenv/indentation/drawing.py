"""The picture of an indentation test: force over depth with its laws, and the stiffness of each indentation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drillenv.checks import choice
from drillenv.files import whole
from drillenv.indentation.parts import smoothed

if TYPE_CHECKING:
    from drillenv.indentation.fitting import IndentationTest

ENDINGS = (".png", ".pdf", ".svg")
PHASES = {"impact": "#b3202c", "compression": "#2f7d3b", "stable": "#1f4e79"}
LINE = "#202020"
MOST_DOTS = 600
"""For each indentation."""


def draw(test: IndentationTest, path: str | Path) -> None:
    """Draw a test to a .png, .pdf or .svg.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    ending = choice("the ending of the picture", Path(path).suffix.lower(), ENDINGS)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2.1, 1))
    _curve(left, test)
    _stiffnesses(right, test)
    figure.suptitle(f"{test.curve.name}: force over depth, and the stiffness it gives", fontsize=11)
    with whole(path) as part:
        figure.savefig(part, dpi=150, format=ending[1:])


def _curve(panel: Any, test: IndentationTest) -> None:
    """Dots measured, lines fitted; the straight lines are what the drilling model takes."""
    zero = 1e3 * test.measured[0].loading.law.origin
    named: set[str] = set()
    for one in test.measured:
        begin, _, end = one.place
        step = max(1, (end - begin) // MOST_DOTS)
        depth, force = 1e3 * test.depth[begin:end:step] - zero, 1e-3 * test.force[begin:end:step]
        label = None if one.phase in named else one.phase
        named.add(one.phase)
        panel.plot(depth, force, ".", color=PHASES[one.phase], ms=2.5, alpha=0.5, label=label)
        for branch, part in ((one.loading, one.window.loading), (one.unloading, one.window.unloading)):
            load = test.force[part]
            ends = smoothed(test.depth[part], max(1, load.size // 30))[[0, -1]]
            at = np.linspace(ends.min(), ends.max(), 60)
            panel.plot(1e3 * at - zero, 1e-3 * branch.law.at(at), color=LINE, lw=0.8)
    last = test.measured[-1]
    for branch, style in ((last.loading, "--"), (last.unloading, ":")):
        _line(panel, branch, last.peak_force, zero, style)
    panel.set_xlabel("depth since the first contact [mm]", fontsize=9)
    panel.set_ylabel("force [kN]", fontsize=9)
    panel.set_title("dots: measured, black: power laws, dashed and dotted: lines k_l and k_u of the last", fontsize=8)
    panel.legend(fontsize=8, frameon=False, markerscale=4)
    panel.tick_params(labelsize=8)


def _line(panel: Any, branch: Any, peak: float, zero: float, style: str) -> None:
    """The straight line nearest to a law between 20 and 100 % of its peak, down to where it comes to zero."""
    low, high = (branch.law.depth(share * peak) for share in (0.2, 1.0))
    depth = np.linspace(low, high, 200)
    middle, load = float(depth.mean()), float(branch.law.at(depth).mean())
    start = middle - load / branch.stiffness.value
    ends = np.array([start, high])
    panel.plot(1e3 * ends - zero, 1e-3 * branch.stiffness.value * (ends - start), style, color="#d1762a", lw=1.4)


def _stiffnesses(panel: Any, test: IndentationTest) -> None:
    """Both stiffnesses over the number of the indentation, with 95 % intervals, and the stable means."""
    numbers = np.arange(1, len(test.measured) + 1)
    for symbol, name, marker in (("k_l", "loading", "o"), ("k_u", "unloading", "s")):
        for i, one in zip(numbers, test.measured, strict=True):
            stiffness = getattr(one, name).stiffness
            reach = [[1e-6 * (stiffness.value - stiffness.low)], [1e-6 * (stiffness.high - stiffness.value)]]
            style = {"color": PHASES[one.phase], "ms": 5, "capsize": 2, "lw": 1}
            label = {"label": f"{symbol}, {name}"} if i == len(numbers) else {}
            panel.errorbar([i], [1e-6 * stiffness.value], yerr=reach, fmt=marker, **style, **label)
        mean = test.stable[symbol].mean
        ends = [test.phases.early + 0.6, len(numbers) + 0.4]
        panel.fill_between(ends, 1e-6 * mean.low, 1e-6 * mean.high, color=PHASES["stable"], alpha=0.15, lw=0)
        panel.plot(ends, [1e-6 * mean.value] * 2, color=PHASES["stable"], lw=1)
    panel.set_ylim(bottom=0)
    panel.set_xticks(numbers if numbers.size <= 12 else numbers[:: -(-numbers.size // 12)])
    panel.set_xlabel("indentation", fontsize=9)
    panel.set_ylabel("stiffness [kN/mm]", fontsize=9)
    panel.set_title("band: mean of the stable ones, 95 %", fontsize=8)
    panel.legend(fontsize=8, frameon=False, loc="lower right")
    panel.tick_params(labelsize=8)
