"""The paper's figures from the model: bifurcation diagrams with time series and phase portraits beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from drillenv.atlas.sweep import Sweep, sweep
from drillenv.dynamics.motion import motion
from drillenv.dynamics.simulate import Run, simulate
from drillenv.paper.published import SETTING_4_4
from drillenv.rig import Setting
from drillenv.rocks import ROCKS

UP, DOWN, LINE = "#1f4e79", "#d1762a", "#202020"
PERIODS = 6
"""Excitation periods shown of a time series."""


def _steady(setting: Setting, rock: int) -> Run:
    """A steady run of PERIODS excitation periods, finely sampled."""
    return simulate(setting, rock, seconds=PERIODS / setting.frequency, sample_rate=200_000.0, start="steady")


def _series(panel: Any, setting: Setting, rock: int, note: str = "") -> Run:
    """Draw the indenter's acceleration over time."""
    run = _steady(setting, rock)
    panel.plot(1e3 * run.time, run.acceleration, color=LINE, lw=0.8)
    panel.set_xlim(0, 1e3 * run.time[-1])
    panel.set_title(f"{note}{motion(setting, rock).label}", fontsize=9, loc="left")
    panel.set_ylabel("X2'' [m/s²]", fontsize=8)
    panel.tick_params(labelsize=8)
    return run


def _portrait(panel: Any, run: Run) -> None:
    """Draw speed over the place relative to Xf, where unloading ends."""
    panel.plot(1e3 * (run.indenter_position - run.penetration), run.indenter_speed, color=LINE, lw=0.8)
    panel.axvline(0, color="0.8", lw=0.6, zorder=0)
    panel.set_ylabel("V2 [m/s]", fontsize=8)
    panel.tick_params(labelsize=8)
    panel.locator_params(axis="x", nbins=5)


def _diagram(panel: Any, result: Sweep, label: str, lower: float = -np.inf, upper: float = np.inf) -> None:
    """Draw the largest deceleration of each impact over the swept value, both ways."""
    for direction, colour, size in (("down", DOWN, 5.0), ("up", UP, 1.2)):
        points = result.points(direction)
        points = points[(points["value"] >= lower) & (points["value"] <= upper)]
        counts = points["peaks"]
        values = np.repeat(points["value"], counts)
        peaks = np.concatenate([point["peak_accelerations"][:n] for point, n in zip(points, counts, strict=True)])
        panel.scatter(values, peaks, s=size, color=colour, lw=0, label=f"sweep {direction}", rasterized=True)
    panel.set_xlabel(label, fontsize=9)
    panel.set_ylabel("peak |X2''| of each impact [m/s²]", fontsize=9)
    panel.tick_params(labelsize=8)


def _figure(title: str, width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(title, fontsize=11)
    return figure


def _sweep_figure(title: str, result: Sweep, label: str, settings: Sequence[Setting], rock: int) -> Any:
    """A bifurcation diagram above, and below it a time series and a phase portrait for each setting."""
    figure = _figure(title, 9, 3.2 + 1.75 * len(settings))
    top, below = figure.subfigures(2, 1, height_ratios=(3.2, 1.75 * len(settings)))
    panel = top.subplots()
    _diagram(panel, result, label)
    panel.legend(fontsize=8, markerscale=3, frameon=False)
    panels = below.subplots(len(settings), 2, width_ratios=(2.2, 1), squeeze=False)
    for (left, right), setting in zip(panels, settings, strict=True):
        value = getattr(setting, result.over)
        panel.axvline(value, color="0.75", lw=0.7, zorder=0)
        run = _series(left, setting, rock, f"{value:g} {label.split('[')[-1].rstrip(']')}: ")
        _portrait(right, run)
    panels[-1, 0].set_xlabel("time [ms]", fontsize=8)
    panels[-1, 1].set_xlabel("X2 - Xf [mm]", fontsize=8)
    return figure


def figure_2_5(_frequency: Sweep) -> Any:
    """Time series at 50, 100 and 150 Hz, 0.5 V, 1 bar, rock 4: what the paper measured."""
    settings = [Setting(frequency, 0.50, 1.0) for frequency in (50, 100, 150)]
    figure = _figure("Figure 2.5 from the model: sandstone2-indenter30, 0.50 V, 1.0 bar", 9, 6)
    panels = figure.subplots(3, 2, width_ratios=(1, 1))
    for (left, right), setting in zip(panels, settings, strict=True):
        run = _series(left, setting, 4, f"{setting.frequency:g} Hz: ")
        right.plot(1e3 * run.time, 1e-3 * run.force, color=UP, lw=0.8)
        right.set_xlim(0, 1e3 * run.time[-1])
        right.set_ylabel("contact force [kN]", fontsize=8)
        right.tick_params(labelsize=8)
    for panel in panels[-1]:
        panel.set_xlabel("time [ms]", fontsize=8)
    return figure


def figure_3_2(frequency: Sweep) -> Any:
    """The frequency sweep of rock 4 at 0.45 V and 1 bar, its blow-up, and phase portraits of its eight motions."""
    figure = _figure("Figure 3.2 from the model: sandstone2-indenter30, 0.45 V, 1.0 bar", 10, 9)
    top, below = figure.subfigures(2, 1, height_ratios=(1, 1))
    whole, near = top.subplots(1, 2)
    _diagram(whole, frequency, "frequency [Hz]")
    whole.legend(fontsize=8, markerscale=3, frameon=False)
    _diagram(near, frequency, "frequency [Hz]", 90, 110)
    near.set_ylabel("")
    shown = (50, 70, 85, 98.4, 100, 103.31, 106, 115)
    for panel, value in zip(below.subplots(2, 4).flat, shown, strict=True):
        setting = Setting(value, 0.45, 1.0)
        found = motion(setting, 4)
        periods = found.period or 60
        run = simulate(setting, 4, seconds=periods / value, sample_rate=100_000.0, start="steady")
        _portrait(panel, run)
        panel.set_title(f"{value:g} Hz: {found.label}", fontsize=9, loc="left")
        panel.set_xlabel("X2 - Xf [mm]", fontsize=8)
    return figure


def figure_4_1(frequency: Sweep) -> Any:
    """The frequency sweep with time series at 50, 70, 100 and 120 Hz."""
    settings = [Setting(value, 0.45, 1.0) for value in (50, 70, 100, 120)]
    title = "Figure 4.1 from the model: sandstone2-indenter30, 0.45 V, 1.0 bar"
    return _sweep_figure(title, frequency, "frequency [Hz]", settings, 4)


def figure_4_2(_frequency: Sweep) -> Any:
    """The amplitude sweep of rock 2 at 120 Hz and 1 bar."""
    result = sweep(Setting(120, 0.30, 1.0), "amplitude", 0.30, 0.60, 0.001, rock=2)
    settings = [Setting(120, value, 1.0) for value in (0.30, 0.40, 0.50, 0.60)]
    title = "Figure 4.2 from the model: sandstone1-indenter45, 120 Hz, 1.0 bar"
    return _sweep_figure(title, result, "amplitude [V]", settings, 2)


def figure_4_3(_frequency: Sweep) -> Any:
    """The pressure sweep of rock 4 at 90 Hz and 0.45 V."""
    result = sweep(Setting(90, 0.45, 0.6), "pressure", 0.60, 1.80, 0.002, rock=4)
    settings = [Setting(90, 0.45, value) for value in (0.70, 1.0, 1.4, 1.8)]
    title = "Figure 4.3 from the model: sandstone2-indenter30, 90 Hz, 0.45 V"
    return _sweep_figure(title, result, "pressure [bar]", settings, 4)


def figure_4_4(_frequency: Sweep) -> Any:
    """The six rocks at 100 Hz, 0.45 V and 1 bar: peaks over stiffness, time series and phase portraits."""
    figure = _figure("Figure 4.4 from the model: six rock-indenter pairs, 100 Hz, 0.45 V, 1.0 bar", 9, 12)
    top, below = figure.subfigures(2, 1, height_ratios=(3, 9))
    panel = top.subplots()
    path = sweep(SETTING_4_4, "stiffness", 10e6, 35e6, 0.1e6, rock=4)
    _diagram(panel, path, "loading stiffness k_l [N/m], k_u/k_l as in case 4; squares: the six rocks")
    order = sorted(ROCKS, key=lambda case: ROCKS[case].loading_stiffness)
    panels = below.subplots(6, 2, width_ratios=(2.2, 1))
    for (left, right), case in zip(panels, order, strict=True):
        rock = ROCKS[case]
        run = _series(left, SETTING_4_4, case, f"case {case}, {rock.name}: ")
        _portrait(right, run)
        here = rock.loading_stiffness
        one = sweep(SETTING_4_4, "stiffness", here, here + 1.0, 1.0, rock, direction="up")
        point = one.points("up")[0]
        peaks = point["peak_accelerations"][: point["peaks"]]
        panel.scatter(np.full(peaks.size, here), peaks, s=22, marker="s", color="#a01c2c", zorder=3)
        panel.annotate(str(case), (here, peaks.max()), (0, 6), textcoords="offset points", fontsize=8)
    panels[-1, 0].set_xlabel("time [ms]", fontsize=8)
    panels[-1, 1].set_xlabel("X2 - Xf [mm]", fontsize=8)
    return figure


FIGURES: dict[str, Callable[[Sweep], Any]] = {
    "2.5": figure_2_5,
    "3.2": figure_3_2,
    "4.1": figure_4_1,
    "4.2": figure_4_2,
    "4.3": figure_4_3,
    "4.4": figure_4_4,
}
"""The figures by number; each is drawn from the frequency sweep of Fig. 3.2 and whatever it computes itself."""
