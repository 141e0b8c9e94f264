"""The report on the design of the scheduled controller: a page, its figures and the numbers behind them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.controllers.chart import RATIOS, read_chart
from drillenv.controllers.identify import HARDENING
from drillenv.env.plant import INTERVAL
from drillenv.files import whole

LOOPS = ("valve", "amplitude", "force")
COLOURS = {"valve": "#0072B2", "amplitude": "#D55E00", "force": "#009E73"}
LINE, PALE = "#202020", "#b8c4ce"


def write_report(record: dict[str, Any], folder: Path) -> None:
    """Write design.json, design.md and the figures into a folder."""
    import matplotlib as mpl

    folder.mkdir(parents=True, exist_ok=True)
    with whole(folder / "design.json") as part:
        part.write_text(json.dumps(record) + "\n", encoding="utf-8")
    with whole(folder / "design.md") as part:
        part.write_text(page(record), encoding="utf-8")
    with mpl.rc_context({"font.size": 9, "axes.titlesize": 9, "axes.titlelocation": "left", "savefig.dpi": 130}):
        for name, draw in FIGURES.items():
            with whole(folder / f"{name}.png") as part:
                draw(record).savefig(part, bbox_inches="tight")


def page(record: dict[str, Any]) -> str:
    """The page, with the numbers of the record."""
    models = record["models"]
    used = max({row["share"] for row in models})
    identified = [
        f"| {row['loading'] / 1e6:.0f} | {row['amplitude']:.3f} | {row['pressure']:.3f} | {row['force']:.2f} "
        f"| {row['force_pressure']:.2f} | {row['force_amplitude']:.2f} | {row['euler']:.3f} "
        f"| {1e3 * row['residual']:.1f} | {row['memory']:.2f} |"
        for row in models
        if row["share"] == used
    ]
    least = {case: worst(record, case) for case in ("as designed", "next softer", "next harder", "slower")}
    margins = [
        f"| {name} | {values['gain']:.1f} | {values['phase']:.0f} | {values['disk']:.2f} | {values['together']:.2f} "
        f"| {values['slowest']:.2f} |"
        for name, values in least.items()
    ]
    slowest = least["as designed"]["slowest"]
    return PAGE.format(
        identified="\n".join(identified),
        euler=max(abs(row["euler"] - 1.0) for row in models),
        noise=1e3 * max(row["residual"] for row in models),
        margins="\n".join(margins),
        settling=-INTERVAL / np.log(slowest),
        share=used,
        step_lag=record["lag_of_steps"],
    )


def worst(record: dict[str, Any], case: str) -> dict[str, float]:
    """The least margins of a case over all rocks, lags and loops."""
    rows = [row for row in record["margins"] if row["case"] == case]
    loops = [row[name] for row in rows for name in LOOPS]
    least = {key: min(loop[key] for loop in loops if loop[key] is not None) for key in ("gain", "phase", "disk")}
    least["together"] = min(row["together"] for row in rows)
    least["slowest"] = max(row["slowest"] for row in rows)
    return least


def _figure(**kwargs: Any):
    """A figure that no window system knows of."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained", **kwargs)
    FigureCanvasAgg(figure)
    return figure


def _models_figure(record: dict[str, Any]):
    """Identified gains over stiffness, beside the slopes of the chart."""
    figure = _figure(figsize=(8, 3))
    panels = figure.subplots(1, 2)
    chart = read_chart()
    for share, marker in zip(sorted({row["share"] for row in record["models"]}), "so", strict=True):
        rows = [row for row in record["models"] if row["share"] == share]
        loading = np.array([row["loading"] for row in rows])
        slopes = []
        for row in rows:
            rock = np.array([row["loading"]]), np.array([HARDENING])
            peaks = 1e-3 * chart.features_of(*rock)[1, :, 0]
            ratio = row["pressure"] / row["amplitude"]
            slope = float(np.interp(ratio, 0.5 * (RATIOS[1:] + RATIOS[:-1]), np.diff(peaks) / np.diff(RATIOS)))
            slopes.append((slope, float(np.interp(ratio, RATIOS, peaks)) - ratio * slope))
        for panel, key, column in zip(panels, ("force_pressure", "force_amplitude"), np.transpose(slopes), strict=True):
            panel.plot(loading / 1e6, column, color=PALE, lw=2, label="slope of the chart" if share < 0.8 else None)
            panel.plot(
                loading / 1e6, [row[key] for row in rows], marker, color=LINE, ms=4, label=f"{share:.0%} of the end"
            )
    for panel, title in zip(panels, ("force over pressure, kN/bar", "force over amplitude, kN/V"), strict=True):
        panel.set(title=title, xlabel="loading stiffness, MN/m", ylim=(0, None))
    panels[0].legend(frameon=False)
    return figure


def _margins_figure(record: dict[str, Any]):
    """Nyquist curves of one design, and the disk margins of all."""
    figure = _figure(figsize=(8, 3.4))
    curves, disks = figure.subplots(1, 2, width_ratios=(1, 1.5))
    angle = np.linspace(0, 2 * np.pi, 200)
    curves.plot(np.cos(angle), np.sin(angle), color=PALE, lw=0.8)
    for name in LOOPS:
        loop = record["nyquist"]["loops"][name]
        curves.plot(loop["real"], loop["imaginary"], color=COLOURS[name], label=f"{name} loop")
    curves.plot(-1, 0, "+", color=LINE)
    curves.set(xlim=(-1.6, 1.1), ylim=(-2.2, 0.5), aspect="equal", xlabel="real", ylabel="imaginary")
    curves.set_title(f"{record['nyquist']['loading'] / 1e6:.0f} MN/m, lag {record['nyquist']['lag']:g} s")
    curves.legend(frameon=False, fontsize=8)
    for name in LOOPS:
        for case, style in (("as designed", "o"), ("other", "x")):
            rows = [row for row in record["margins"] if (row["case"] == "as designed") == (case == "as designed")]
            disks.plot(
                [row["loading"] / 1e6 for row in rows],
                [row[name]["disk"] for row in rows],
                style,
                color=COLOURS[name],
                ms=4,
                mfc="none",
                label=f"{name} loop" if style == "o" else None,
            )
    disks.set(
        title="disk margin: o as designed, x with rock or lag off",
        xlabel="loading stiffness designed for, MN/m",
        ylim=(0, 2),
    )
    disks.legend(frameon=False, fontsize=8, ncols=3, loc="lower center")
    return figure


def _steps_figure(record: dict[str, Any]):
    """Answers to a step of the target, linear and on the plant."""
    figure = _figure(figsize=(8, 3))
    panels = figure.subplots(1, 3, sharex=True)
    for step, colour in zip(record["steps"], ("#009E73", "#0072B2", "#D55E00"), strict=True):
        time = INTERVAL * np.arange(len(step["target"]))
        plant, linear = np.array(step["plant"]), np.array(step["linear"])
        panels[0].plot(time, 1e3 * linear[:, 0], color=colour, lw=1)
        panels[0].plot(
            time[1:], 1e3 * plant[:-1, 0], "o", color=colour, ms=3, label=f"{step['loading'] / 1e6:.0f} MN/m"
        )
        panels[1].plot(time, plant[:, 2], color=colour)
        panels[2].plot(time, plant[:, 1], color=colour)
        panels[2].plot(time, plant[:, 3], color=colour, lw=0.6)
    panels[0].set(title="peak force from its target, N", xlabel="s")
    panels[0].legend(frameon=False, fontsize=8)
    panels[1].set(title="amplitude, V", xlabel="s")
    panels[2].set(title="pressure, and valve (thin), bar", xlabel="s")
    return figure


def _episode_figure(record: dict[str, Any]):
    """An episode with changes of rock."""
    figure = _figure(figsize=(8, 5.5))
    panels = figure.subplots(4, 1, sharex=True)
    course = {name: np.array(values) for name, values in record["episode"]["course"].items()}
    time = INTERVAL * (1 + np.arange(course["force"].size))
    panels[0].plot(time, course["true"] / 1e6, color=PALE, lw=3, label="true")
    panels[0].plot(time, course["thought"] / 1e6, color=LINE, lw=1, label="estimated")
    panels[0].set(ylabel="k_l, MN/m")
    panels[0].legend(frameon=False, fontsize=8, ncols=2)
    panels[1].plot(time, course["force"], color=COLOURS["force"])
    panels[1].axhline(2.0, color=LINE, lw=0.6, ls="--")
    panels[1].set(ylabel="largest peak, kN")
    panels[2].plot(time, course["amplitude"], color=COLOURS["amplitude"])
    panels[2].set(ylabel="amplitude, V")
    panels[3].plot(time, course["pressure"], color=COLOURS["valve"])
    panels[3].plot(time, course["valve"], color=COLOURS["valve"], lw=0.6)
    panels[3].set(ylabel="pressure, valve, bar", xlabel="s")
    return figure


FIGURES = {
    "models": _models_figure,
    "margins": _margins_figure,
    "steps": _steps_figure,
    "episode": _episode_figure,
}

PAGE = """# Design of the scheduled controller

This page, its figures and [design.json](design.json) are written by `python -m drillenv.controllers.design`, from the
models in `controllers/plant_models/linear.json`, which `python -m drillenv.controllers.identify` makes by
experiments on the plant.

## The plant, as identified

On eight rocks, at two ratios of pressure to amplitude each, amplitude and valve were switched at random between two
levels on 24 rigs with noisy sensors, and force fitted to the mean pressure of the interval and to the amplitude. At
{share:.0%} of the ratio at which P-1-I-1 ends:

| k_l, MN/m | V | bar | peak force, kN | kN/bar | kN/V | Euler | residual, N | memory |
|---|---|---|---|---|---|---|---|---|
{identified}

![Identified gains over stiffness](models.png)

- Within an interval the blows have settled: the force of the interval before explains a few hundredths (column
  memory). All that remains of dynamics is the lag of the cylinder and the delay of one interval until a blow is seen.
- With the linear rock law force grows with the drive, so that (kN/bar) bar + (kN/V) V = kN. The experiments do not
  assume it and agree with it to {euler:.1%} (column Euler).
- What the linear model leaves is {noise:.0f} N at the most; the noise of the force reading alone is 10 N.
- On hard rock the pressure decides on the force, and it is slow; the amplitude is fast and moves it little. On soft
  rock near the end of P-1-I-1 it is the other way round.

## The design

Two outputs are held, the force at its target and the pressure at a fixed ratio to the amplitude below the end of
P-1-I-1, with two inputs, valve and amplitude. The design is for the increments of both, so that each output has an
integrator:

    z(k) = [p(k) - p(k-1),  F(k-1) - target,  p(k) - ratio A(k-1)]
    [v(k) - v(k-1), A(k) - A(k-1)] = -K z(k)

K is the discrete linear-quadratic one (`control.dlqr`), computed for eight rocks and five lags of the cylinder and
interpolated over both. **Anti-windup** comes with the form: the increments are added to the valve and the amplitude
that were really set, so that there is no integrator to wind up while one of them is at the end of its range.

## Margins

The least over all rocks and lags, of the loops through valve, amplitude and force sensor, each opened with everything
else closed. "Next softer" and "next harder" put the gains on the neighbouring rock, a fifth to three eighths off
in stiffness; "slower" on a cylinder whose lag is 30 % longer than estimated. "Together" is a lower bound of the disk
margin for valve and amplitude changing at once, "slowest" the modulus of the slowest closed-loop pole.

| plant | gain factor | phase, degrees | disk margin | together | slowest |
|---|---|---|---|---|---|
{margins}

![Nyquist curves and disk margins](margins.png)

The slowest mode as designed decays with a time constant of {settling:.1f} s. It carries only what the trim leaves: a
new rock is answered by a new trim at once.

## Steps

The target of the force is lowered by 100 N on three rocks, with a cylinder of {step_lag:g} s. Lines are the linear
model, dots the plant itself, without noise.

![Answers to a step](steps.png)

## Rock changes

35 s of an episode of the `validation` set, with the noise of the sensors.

![An episode](episode.png)

The stiffness is estimated from peak forces, impacts, time in contact and penetration of each interval by a bank of
models (`controllers/estimate.py`), with the chart of settled motions that `python -m drillenv.controllers.chart`
computes. In the interval in which the rock changes, both rocks and a fresh, soft face are mixed; the estimate needs one
or two intervals more. On a change from soft to hard rock the blows are too strong, or double, until the cylinder has
emptied.
"""
