"""Pictures of the P-1-I-1 atlas."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drillenv.atlas.p11 import AXES, FOLD, GRAZING, NEIMARK_SACKER, PERIOD_DOUBLING
from drillenv.checks import InputError, shown
from drillenv.files import check_writable, whole

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

FORMATS = (".png", ".pdf", ".svg")
SLICES = 4
"""Pressures shown for each rock."""

RATE_STEP = 0.1
"""Between contours of the penetration rate, in mm/s."""
COEXISTENCE: dict[str, Any] = {"facecolor": "none", "edgecolor": "red", "hatch": "//////", "linewidth": 0.3}

# How P-1-I-1 ends, as the pictures tell it apart: name, colour (told apart by any eye), marker.
ENDS = {
    "period doubling": ("#CC79A7", "D"),
    "fold": ("#D55E00", "o"),
    "Neimark-Sacker": ("#F0E442", "P"),
    "a second contact": ("#000000", "s"),
    "a second force peak in the contact": ("#0072B2", "^"),
    "the contact is never left": ("#009E73", "v"),
}


def plot_atlas(dataset: xarray.Dataset, path: str | os.PathLike[str]) -> list[Path]:
    """Draw an atlas: slices at ``path``, and beside it NAME_surface, the boundary in space, and NAME_ratio, over p / A.

    Args:
        dataset: What :func:`drillenv.atlas.p11.atlas` returns.
        path: File to write, ending in .png, .pdf or .svg.

    Returns:
        The files written.

    Raises:
        InputError: the path has another ending or cannot be written; before anything is drawn.
    """
    import matplotlib as mpl

    check_writable(path)
    target = Path(path)
    if target.suffix not in FORMATS:
        raise InputError(f"path is {shown(str(target))}: give a file name that ends in {', '.join(FORMATS)}")
    written = []
    with mpl.rc_context(
        {"font.size": 9, "axes.titlesize": 9, "figure.dpi": 100, "savefig.dpi": 160, "hatch.linewidth": 0.6}
    ):
        for addition, draw in (("", _slices), ("_surface", _surface), ("_ratio", _ratio)):
            file = target.with_name(f"{target.stem}{addition}{target.suffix}")
            with whole(file) as name:
                draw(dataset).savefig(name, bbox_inches="tight")
            written.append(file)
    return written


def _figure(**kwargs: Any) -> Figure:
    """A figure that no window system knows of."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**kwargs)
    FigureCanvasAgg(figure)
    return figure


def _ends(dataset: xarray.Dataset) -> np.ndarray:
    """(boundary points,) keys of ENDS."""
    kind, contacts = dataset["boundary_kind"].values, dataset["boundary_contacts"].values
    names = np.full(kind.size, "a second contact", dtype=object)
    names[kind == PERIOD_DOUBLING] = "period doubling"
    names[kind == FOLD] = "fold"
    names[kind == NEIMARK_SACKER] = "Neimark-Sacker"
    names[(kind == GRAZING) & (contacts == 1)] = "a second force peak in the contact"
    names[(kind == GRAZING) & (contacts == 0)] = "the contact is never left"
    return names


def _legend(figure: Figure, names: np.ndarray, size: float, *more: Any, **place: Any) -> None:
    """What the markers of the boundary mean, those that occur, and ``more``."""
    from matplotlib.lines import Line2D

    handles: list[Any] = [
        Line2D([], [], linestyle="", marker=marker, color=colour, markersize=size, label=name)
        for name, (colour, marker) in ENDS.items()
        if name in names
    ]
    handles += more
    if handles:
        figure.legend(handles=handles, title="P-1-I-1 ends at", ncols=len(handles), frameon=False, **place)


def _title(dataset: xarray.Dataset, rock: int) -> str:
    """Case and name of a rock."""
    case, name = int(dataset["rock"].values[rock]), str(dataset["rock_name"].values[rock])
    return f"{case}  {name}" if case else name


def _cells(values: np.ndarray) -> np.ndarray:
    """Edges of cells around increasing values."""
    if values.size == 1:
        return values[0] * np.array([0.99, 1.01])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def _slices(dataset: xarray.Dataset) -> Figure:
    """A row for each rock, a column for each of a few pressures: penetration rate over frequency and amplitude."""
    from matplotlib.patches import Patch, Rectangle

    frequency, amplitude, pressure = (dataset[axis].values for axis in AXES)
    columns = np.unique(np.linspace(0, pressure.size - 1, SLICES).round().astype(int))
    rows = dataset.sizes["rock"]
    figure = _figure(figsize=(2.6 * columns.size + 1.4, 1.9 * rows + 1.2), layout="constrained")
    grid = figure.subplots(rows, columns.size, sharex=True, sharey=True, squeeze=False)
    rate = 1e3 * dataset["penetration_rate"].values
    top = np.nanmax(rate) if np.isfinite(rate).any() else 1.0
    levels = np.arange(RATE_STEP, top, RATE_STEP)
    names, mesh = _ends(dataset), None
    x, y = _cells(frequency).tolist(), _cells(amplitude).tolist()
    for row in range(rows):
        for column, k in enumerate(columns):
            axes = grid[row, column]
            values = np.ma.masked_invalid(rate[row, :, :, k].T)
            mesh = axes.pcolormesh(x, y, values, vmin=0.0, vmax=top, cmap="viridis")
            if min(values.shape) > 1 and values.count():
                lines = axes.contour(frequency, amplitude, values, levels=levels, colors="white", linewidths=0.6)
                axes.clabel(lines, fmt="%.1f", fontsize=6)
            shared = (dataset["exists"].values & ~dataset["only"].values)[row, :, :, k].T
            for i, j in np.argwhere(shared).tolist():
                axes.add_patch(Rectangle((x[j], y[i]), x[j + 1] - x[j], y[i + 1] - y[i], **COEXISTENCE))
            here = (dataset["boundary_rock"].values == row) & (dataset["boundary_axis"].values != 2)
            here &= np.isclose(dataset["boundary_pressure"].values, pressure[k], rtol=1e-12)
            for name, (colour, marker) in ENDS.items():
                which = here & (names == name)
                along, across = dataset["boundary_frequency"].values[which], dataset["boundary_amplitude"].values[which]
                axes.plot(along, across, marker, color=colour, markersize=2.6, markeredgewidth=0.0)
            axes.set_xlim(frequency[0] - 1e-9, frequency[-1] + 1e-9)
            axes.set_ylim(amplitude[0] - 1e-9, amplitude[-1] + 1e-9)
            if row == 0:
                axes.set_title(f"{pressure[k]:.2f} bar")
        grid[row, 0].set_ylabel(f"{_title(dataset, row)}\namplitude [V]", fontsize=8)
    for axes in grid[-1]:
        axes.set_xlabel("frequency [Hz]")
    if mesh is not None:
        figure.colorbar(mesh, ax=grid, label="penetration rate on P-1-I-1 [mm/s]", shrink=0.7, aspect=40)
    _legend(figure, names, 5, Patch(label="(hatched) other motions too", **COEXISTENCE), loc="outside lower center")
    figure.suptitle("Where P-1-I-1 exists, and how fast it drills")
    return figure


def _surface(dataset: xarray.Dataset) -> Figure:
    """The boundary in (frequency, amplitude, pressure), one panel for each rock."""
    rows, columns = _panels(dataset.sizes["rock"])
    figure = _figure(figsize=(4.4 * columns, 4.1 * rows + 0.6))
    names = _ends(dataset)
    for rock in range(dataset.sizes["rock"]):
        axes: Any = figure.add_subplot(rows, columns, rock + 1, projection="3d")
        for name, (colour, _marker) in ENDS.items():
            which = (dataset["boundary_rock"].values == rock) & (names == name)
            points = np.stack([dataset[f"boundary_{axis}"].values[which] for axis in AXES])
            axes.scatter(*points, s=2, color=colour, linewidths=0, depthshade=False)
            for ray in _rays(points):
                axes.plot(*ray, color=colour, linewidth=0.8, alpha=0.6)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel("amplitude [V]")
        axes.set_zlabel("pressure [bar]")
        for axis, limit in zip(AXES, (axes.set_xlim, axes.set_ylim, axes.set_zlim), strict=True):
            limit(*_cells(dataset[axis].values)[[0, -1]])
        axes.set_title(_title(dataset, rock), y=0.98)
        axes.view_init(elev=22, azim=-128)
        axes.set_box_aspect((1, 1, 0.85), zoom=1.05)
    figure.subplots_adjust(left=0.02, right=0.96, bottom=0.09, top=0.93, wspace=0.06, hspace=0.06)
    _legend(figure, names, 6, loc="lower center")
    figure.suptitle("The boundary of P-1-I-1")
    return figure


def _rays(points: np.ndarray) -> list[np.ndarray]:
    """Boundary points (3, n) joined into the straight lines p = A g(f) on which they lie, for each frequency and g."""
    frequency, ratio = points[0], points[2] / points[1]
    order = np.lexsort((ratio, frequency))
    breaks = (np.diff(frequency[order]) != 0) | (np.diff(ratio[order]) > 1e-4 * ratio[order][1:])
    groups = np.split(order, np.flatnonzero(breaks) + 1)
    return [points[:, group[np.argsort(points[1, group])]] for group in groups if group.size > 1]


def _ratio(dataset: xarray.Dataset) -> Figure:
    """Grid and boundary over frequency and p / A, on which alone the motion depends with the linear rock law."""
    rows, columns = _panels(dataset.sizes["rock"])
    figure = _figure(figsize=(3.9 * columns, 3.0 * rows + 0.9), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    names = _ends(dataset)
    settings = np.meshgrid(*(dataset[axis].values for axis in AXES), indexing="ij")
    for rock in range(dataset.sizes["rock"]):
        axes = grid.flat[rock]
        inside = dataset["exists"].values[rock]
        axes.plot(
            settings[0][inside],
            (settings[2] / settings[1])[inside],
            ".",
            color="#b0b0b0",
            markersize=2.0,
            markeredgewidth=0,
        )
        for name, (colour, marker) in ENDS.items():
            which = (dataset["boundary_rock"].values == rock) & (names == name)
            frequency = dataset["boundary_frequency"].values[which]
            ratio = (dataset["boundary_pressure"].values / dataset["boundary_amplitude"].values)[which]
            axes.plot(frequency, ratio, marker, color=colour, markersize=3.0, markeredgewidth=0)
        axes.set_title(_title(dataset, rock))
    for axes in grid.flat[dataset.sizes["rock"] :]:
        axes.set_axis_off()
    for axes in grid[-1]:
        axes.set_xlabel("frequency [Hz]")
    for axes in grid[:, 0]:
        axes.set_ylabel("p / A [bar/V]")
    _legend(figure, names, 5, loc="outside lower center")
    figure.suptitle("All settings of the box collapse onto frequency and p / A (grey: P-1-I-1 exists)")
    return figure


def _panels(count: int) -> tuple[int, int]:
    """Rows and columns for so many panels."""
    columns = min(3, count)
    return -(-count // columns), columns
