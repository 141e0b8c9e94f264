"""Pictures of an interval: the rig in the strata, force and acceleration, phase portrait, and the map of P-1-I-1.

One figure is built and drawn once as a background; a frame restores that background and draws only what moves. Nothing
of pyplot is touched but for the window of ``human``.

The map is exact and made while drilling. With the linear rock law lengths and forces scale together, so that at a given
frequency and rock the orbit P-1-I-1 depends on the ratio p / A alone, and its peak force is A times a function of it.
One branch of orbits, followed by Newton's method in a few milliseconds, gives the whole plane of amplitude and
pressure. It holds for the paper's physics with the episode's constants on a stable face; effects beyond it are not in
the map.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm, to_rgba
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Text

from drillenv.atlas.p11_kernels import IS_P11, p11_at
from drillenv.checks import InputError, choice, shown
from drillenv.dynamics.flow import OMEGA, STATIC, K, make_model, set_drive
from drillenv.dynamics.orbits import M_FORCE, MOTION_SIZE, length_scale
from drillenv.env.core import motion_name
from drillenv.env.plant import LAYER_END, LAYER_KL, RIG_DRIVE, RIG_M1, RIG_PRESSURE, TRACE
from drillenv.env.truth import (
    SEEN,
    T_AMPLITUDE,
    T_DEPTH,
    T_FREQUENCY,
    T_KL,
    T_KU,
    T_LABEL,
    T_LARGEST,
    T_MEAN,
    T_PERIOD,
    T_PRESSURE,
    T_RATE,
    T_VALVE,
)
from drillenv.files import check_writable, whole
from drillenv.rig import AMPLITUDE_RANGE, DRIVE_BASE, DRIVE_SLOPE, FREQUENCY_RANGE, PRESSURE_RANGE, PUSH, Rig, Setting
from drillenv.rocks import Rock

MODES = ("human", "rgb_array")
WIDTH, HEIGHT = 1280, 720
"""Size of a frame in pixels."""
_DPI = 100
MINUS, DASH, TIMES = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{MULTIPLICATION SIGN}"
_STYLE: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "hatch.linewidth": 0.7,
    "axes.unicode_minus": True,
    "path.simplify": True,
    "text.usetex": False,
}
"""What of a user's settings of matplotlib would show in a frame."""

GROUND, PANEL, FRAME, GRID = "#0f151c", "#151d26", "#2f3c4a", "#222d39"
INK, MUTED = "#e8edf2", "#93a1b0"
FREE, CONTACT, ABOVE, STRONG_BLOW = "#6db3e8", "#f6b756", "#ff7062", "#4fd0b0"
STEEL, DARK_STEEL = "#b9c4cf", "#71808f"
"""Colours: no contact, contact, force above the rating, strong P-1-I-1."""
ROCK_COLOURS: LinearSegmentedColormap = LinearSegmentedColormap.from_list(
    "rock", ["#e9d5a0", "#cd9a62", "#a06a5c", "#6b5d7e", "#4a5678"]
)
ROCK_SCALE: LogNorm = LogNorm(4.0, 70.0, clip=True)
"""Loading stiffness in kN/mm, from the softest to the hardest rock of the scenarios."""

TRAIL = 24
"""Settings that the map remembers."""
CALM = 8
"""Intervals over which the largest value decides the scale of an axis, so that scales do not flicker."""
AGREES = 1e-6
"""Depths in mm that differ by less are the same."""
STRONG = 0.5
"""A blow is shown as strong from this share of the rating on."""
LEVELS = (0.0, STRONG, 0.75, 1.0, math.inf)
"""Peak forces over the rating between which the map changes its colour."""

(_EXCITATION, _FORCE, _ACCELERATION, _PRESSURE, _X1, _X2, _V2, _FACE) = range(len(TRACE))
_GRAVITY = 9.80665


# --- P-1-I-1 at a frequency on a rock -------------------------------------------------------------------------

RATIO_RANGE = (PRESSURE_RANGE[0] / AMPLITUDE_RANGE[1], PRESSURE_RANGE[1] / AMPLITUDE_RANGE[0])
"""p / A in bar/V over the settings of Table 2.1."""
RATIO_MARGIN = 0.12
"""The map reaches a little beyond those."""
RATIO_STEP, RATIO_PRECISION = 0.05, 1e-3
SEED_RATIOS = (0.012, 0.010, 0.014)
"""p / A over the frequency, in bar/V/Hz, well inside the strong P-1-I-1 of rocks from 4 to 70 kN/mm at 50 to 120 Hz."""
SEED_POINT = np.array([0.5, 0.0, -0.15, -1.0])
"""Near the orbit there: the spring's shortening beyond the static one, v1, v2 and w, in length scales and omega times
them. Newton's method comes in from half of a box of twice this size."""


class Branch(NamedTuple):
    """The strong P-1-I-1 at a frequency on a rock, from the smallest p / A shown to where it ends."""

    ratio: np.ndarray
    """(n,) p / A in bar/V, increasing; n is 0 where there is none in the range of Table 2.1."""
    force: np.ndarray
    """(n,) peak force over the amplitude, in N/V."""


@lru_cache(maxsize=512)
def strong_branch(
    frequency: float, loading_stiffness: float, unloading_stiffness: float, rig: tuple[float, ...]
) -> Branch:
    """Follow strong P-1-I-1 up to the p / A at which it ends.

    Args:
        frequency: In Hz.
        loading_stiffness, unloading_stiffness: In N/m.
        rig: m1, m2, k, c, drive and pressure gain, as :class:`drillenv.Rig` takes them.
    """
    nothing = Branch(np.zeros(0), np.zeros(0))
    unit = Setting(frequency, 1.0, 1.0)
    try:
        model = make_model(Rig(*rig), Rock(loading_stiffness, unloading_stiffness), unit)
    except InputError:  # a model of one's own that the exact engine cannot take
        return nothing
    drive, push = Rig(*rig).drive_force(unit), Rig(*rig).static_force(unit)
    tangent, motion = np.zeros((4, 4)), np.zeros(MOTION_SIZE)

    def orbit(ratio: float, guess: np.ndarray) -> tuple[float, float, np.ndarray] | None:
        """p / A, peak force and point of the orbit near a guess, if it is a stable P-1-I-1."""
        point = guess.copy()
        set_drive(model[0, OMEGA], drive, push * ratio, model)
        if p11_at(model, point, tangent, motion) != IS_P11:
            return None
        return ratio, float(motion[M_FORCE]), point

    def walk(first: tuple[float, float, np.ndarray], towards: float) -> Iterator[tuple[float, float, np.ndarray]]:
        """The orbits from one on, to a p / A or to the end of the branch."""
        here, step = first, math.copysign(RATIO_STEP, towards - first[0])
        while abs(towards - here[0]) > 1e-12 and abs(step) > RATIO_PRECISION:
            step = math.copysign(min(abs(step), abs(towards - here[0])), step)
            there = orbit(here[0] + step, here[2])
            if there is None:
                step *= 0.5
                continue
            here = there
            yield here

    first = None
    for share in SEED_RATIOS:
        ratio = share * frequency
        set_drive(model[0, OMEGA], drive, push * ratio, model)
        length, speed = length_scale(model), length_scale(model) * model[0, OMEGA]
        guess = SEED_POINT * (length, speed, speed, length)
        guess[0] += model[0, STATIC] / model[0, K]
        first = orbit(ratio, guess)
        if first is not None:
            break
    if first is None:
        return nothing
    low, high = RATIO_RANGE[0] - RATIO_MARGIN, RATIO_RANGE[1]
    below = list(walk(first, low))[::-1] if first[0] > low else []
    branch = [one for one in (*below, first, *walk(first, high)) if one[0] >= low - RATIO_STEP]
    if branch[-1][0] <= RATIO_RANGE[0]:
        return nothing
    return Branch(np.array([one[0] for one in branch]), np.array([one[1] for one in branch]))


def zone(branch: Branch, low: float, high: float) -> np.ndarray:
    """(m, 2) the outline, in V and bar, of the settings on a branch whose peak force lies from ``low`` to ``high`` N.

    ``high`` may be infinite; the outline then goes far beyond the range of amplitudes.
    """
    inner = low / branch.force
    outer = np.minimum(high / branch.force, 10.0)
    amplitude = np.concatenate([inner, outer[::-1]])
    ratio = np.concatenate([branch.ratio, branch.ratio[::-1]])
    return np.column_stack([amplitude, amplitude * ratio])


# --- what a frame shows ---------------------------------------------------------------------------------------


class View(NamedTuple):
    """One interval, as the panels take it."""

    time: np.ndarray
    """(samples,) in ms since the start of the interval."""
    force: np.ndarray
    """(samples,) in kN."""
    acceleration: np.ndarray
    """(samples,) in g."""
    gap: np.ndarray
    """(samples,) x2 relative to the face, in mm."""
    shaker: np.ndarray
    """(samples,) x1 relative to the face, in mm."""
    speed: np.ndarray
    """(samples,) v2 in m/s."""
    drive: float
    """Drive force at the last instant, in N."""
    period: int
    """Samples in an excitation period."""
    peaks: np.ndarray
    """(impacts,) the samples of the force peaks."""
    truth: np.ndarray
    layers: np.ndarray
    """(m, 4) see :mod:`drillenv.env.plant`; the stiffness in N/m, ends in m."""
    rig: np.ndarray
    rating: float
    """In kN."""
    reward: float


def view_of(
    trace: np.ndarray,
    truth: np.ndarray,
    layers: np.ndarray,
    rig: np.ndarray,
    rating: float,
    interval: float,
    reward: float,
) -> View:
    """An interval in the units of the picture; arguments as of :meth:`Renderer.draw`."""
    samples = len(trace)
    drive = rig[RIG_DRIVE] * (DRIVE_SLOPE * truth[T_FREQUENCY] + DRIVE_BASE) * trace[-1, _EXCITATION]
    return View(
        time=1e3 * interval * np.arange(1, samples + 1) / samples,
        force=1e-3 * trace[:, _FORCE],
        acceleration=trace[:, _ACCELERATION] / _GRAVITY,
        gap=1e3 * (trace[:, _X2] - trace[:, _FACE]),
        shaker=1e3 * (trace[:, _X1] - trace[:, _FACE]),
        speed=trace[:, _V2],
        drive=float(drive),
        period=max(2, min(samples, round(samples / (interval * truth[T_FREQUENCY])))),
        peaks=peaks_of(trace[:, _FORCE]),
        truth=truth.copy(),
        layers=_distinct(layers),
        rig=rig,
        rating=1e-3 * rating,
        reward=reward,
    )


def peaks_of(force: np.ndarray) -> np.ndarray:
    """The samples (impacts,) at which a force (samples,) in N peaks, above what the load cell tells from noise."""
    middle = force[1:-1]
    return 1 + np.flatnonzero((middle > force[:-2]) & (middle >= force[2:]) & (middle >= SEEN))


def _distinct(layers: np.ndarray) -> np.ndarray:
    """(m, 4) the layers without the copies of the last one that fill the array up."""
    endless = np.flatnonzero(np.isinf(layers[:, LAYER_END]))
    return layers[: endless[0] + 1 if endless.size else len(layers)].copy()


def step_above(value: float, steps: Sequence[float]) -> float:
    """The smallest of increasing ``steps`` that is not below ``value``, going on by doubling the last."""
    for step in steps:
        if value <= step:
            return step
    return steps[-1] * 2.0 ** math.ceil(math.log2(value / steps[-1])) if math.isfinite(value) else steps[-1]


class Scale:
    """The range of an axis: one of a few steps, the smallest that holds what the last intervals needed."""

    def __init__(self, *steps: float):
        self._steps = steps
        self.clear()

    def clear(self) -> None:
        """Forget the intervals seen."""
        self._needs: deque[float] = deque(maxlen=CALM)

    def over(self, need: float) -> float:
        """The range for an interval that needs so much."""
        self._needs.append(need)
        return step_above(max(self._needs), self._steps)


# --- drawing --------------------------------------------------------------------------------------------------


class _Panel:
    """A part of the frame: what stays is drawn into the background, what moves is in ``moving``, back to front."""

    outer: tuple[slice, slice] | None = None
    """The pixels, tick labels included, of a panel whose axes change their scale; no other panel draws there."""

    def __init__(self, figure: Figure, left: int, top: int, width: int, height: int):
        # in pixels from the top left corner, as layouts are thought of
        box = (left / WIDTH, 1.0 - (top + height) / HEIGHT, width / WIDTH, height / HEIGHT)
        self.axes: Axes = figure.add_axes(box, facecolor=PANEL)
        self.moving: list[Any] = []
        self.left, self.top, self.width, self.height = left, top, width, height

    def as_page(self) -> None:
        """Count in pixels from the panel's top left corner, without an axis."""
        self.axes.set_axis_off()
        self.axes.set_xlim(0, self.width)
        self.axes.set_ylim(self.height, 0)

    def as_chart(self) -> None:
        """Quiet axes with a grid."""
        axes = self.axes
        axes.grid(True, color=GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(colors=MUTED, labelsize=9, length=3, width=0.8, color=FRAME, pad=4)
        for spine in axes.spines.values():
            spine.set_color(FRAME)
            spine.set_linewidth(0.8)

    def reach(self, left: int, right: int, above: int, below: int) -> None:
        """Count so many pixels around the axes as this panel's own."""
        rows = slice(self.top - above, self.top + self.height + below)
        self.outer = rows, slice(self.left - left, self.left + self.width + right)

    def move(self, artist: Any) -> Any:
        """Let an artist be drawn in every frame."""
        artist.set_animated(True)
        self.moving.append(artist)
        return artist

    def line(self, colour: str, width: float = 1.0, **more: Any) -> Line2D:
        """A line that moves."""
        return self.move(self.axes.add_line(Line2D([], [], color=colour, linewidth=width, **more)))

    def text(self, x: float, y: float, content: str = "", size: float = 9.0, colour: str = MUTED, **more: Any) -> Text:
        """A text in the panel's coordinates, on the base line unless told otherwise."""
        return self.axes.text(x, y, content, fontsize=size, color=colour, **more)

    def heading(self, page: _Panel, title: str, note: str = "") -> Text:
        """The panel's title, and at the right, in grey, its unit or a note."""
        y = self.top - 11
        page.text(self.left + self.width, y, note, 9.0, ha="right")
        return page.text(self.left, y, title, 11.0, INK)

    def update(self, view: View) -> bool:
        """Take an interval. Returns whether something that stays has changed."""
        raise NotImplementedError

    def clear(self) -> None:
        """Forget what came before: another episode."""


def _between(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


class _Header(_Panel):
    """The motion and the numbers."""

    CELLS = (
        (322, "penetration, mm/s"),
        (470, "peak force, kN"),
        (590, "reward, mm/s"),
        (722, "frequency, Hz"),
        (834, "amplitude, V"),
        (942, "pressure, bar"),
        (1086, "depth, mm"),
        (1186, "time, s"),
    )
    PRESSURE = 5
    DIVIDERS = (298, 702, 1062)

    def __init__(self, figure: Figure):
        super().__init__(figure, 0, 0, WIDTH, 92)
        self.as_page()
        self.axes.add_patch(Rectangle((0, 0), WIDTH, 92, color=PANEL, linewidth=0))
        self.label = self.move(self.text(28, 50, size=25, colour=INK, weight="bold"))
        self.caption = self.move(self.text(29, 75, size=9.5))
        self.values = [self.move(self.text(x, 50, size=18, colour=INK)) for x, _ in self.CELLS]
        names = [self.text(x, 75, name, 9.0) for x, name in self.CELLS]
        self.pressure = self.move(names[self.PRESSURE])
        for x in self.DIVIDERS:
            self.axes.plot([x, x], [24, 78], color=FRAME, linewidth=1.0)
        self.clock: float | None = None

    def clear(self) -> None:
        self.clock = None

    def update(self, view: View) -> bool:
        truth = view.truth
        name, caption, colour = motion_in_words(truth, view.rating)
        self.label.set(text=name, color=colour)
        self.caption.set_text(caption)
        numbers = (
            f"{truth[T_RATE]:.2f}",
            f"{1e-3 * truth[T_LARGEST]:.2f}",
            f"{view.reward:.2f}",
            f"{truth[T_FREQUENCY]:.1f}",
            f"{truth[T_AMPLITUDE]:.3f}",
            f"{truth[T_PRESSURE]:.2f}",
            f"{truth[T_DEPTH]:.1f}",
            DASH if self.clock is None else f"{self.clock:.2f}",
        )
        for value, number in zip(self.values, numbers, strict=True):
            value.set_text(number.replace("-", MINUS))
        self.values[1].set_color(ABOVE if 1e-3 * truth[T_LARGEST] > view.rating else INK)
        self.values[2].set_color(ABOVE if view.reward < 0 else INK)
        valve = truth[T_VALVE]
        arriving = abs(valve - truth[T_PRESSURE]) >= 0.005
        self.pressure.set_text(f"bar, valve {valve:.2f}" if arriving else self.CELLS[self.PRESSURE][1])
        return False


def motion_in_words(truth: np.ndarray, rating: float) -> tuple[str, str, str]:
    """The motion's name, what it is, and the colour it is written in; ``rating`` in kN."""
    n, m = int(truth[T_PERIOD]), int(truth[T_LABEL])
    if not n:
        return "no period", "nothing repeated in this interval", MUTED
    name = motion_name(n, m)
    if (n, m) == (1, 1):
        share = 1e-3 * truth[T_MEAN] / rating
        if share > 1.0:
            return name, "one blow a period, above the rating", ABOVE
        return (
            name,
            f"one blow a period, {100 * share:.0f} % of the rating",
            STRONG_BLOW if share >= STRONG else CONTACT,
        )
    blows = f"{m} blow{'s' * (m > 1)}"
    return name, f"{blows} a period" if n == 1 else f"{blows} in {n} periods", CONTACT


class _Strata(_Panel):
    """The layers over depth, by their stiffness: what has been drilled in full colour, the rest hatched."""

    DEPTHS = (25.0, 50.0, 100.0, 200.0, 400.0)
    HEIGHT = 474

    def __init__(self, figure: Figure, page: _Panel):
        super().__init__(figure, 62, 146, 62, self.HEIGHT)
        self.as_chart()
        self.reach(46, 2, 8, 8)
        self.axes.grid(False)
        self.axes.set_xlim(0, 1)
        self.axes.set_xticks([])
        page.text(28, self.top - 11, "Strata", 11.0, INK)
        page.text(self.left + self.width, self.top - 11, "mm", 9.0, ha="right")
        self.layers = np.zeros((0, 4))
        self.deepest = 0.0
        self.rock = PolyCollection([], linewidth=0.8, edgecolor=GROUND)
        self.axes.add_collection(self.rock, autolim=False)
        self.ahead = self.move(
            self.axes.add_patch(
                Rectangle((0, 0), 1, 1, facecolor=to_rgba(PANEL, 0.62), edgecolor=to_rgba(INK, 0.3), hatch="////", lw=0)
            )
        )
        self.level = self.line(INK, 1.6, solid_capstyle="butt")
        self.marker = self.move(
            self.axes.add_line(Line2D([], [], color=INK, marker="<", markersize=7, linestyle="", clip_on=False))
        )
        self._key(figure, page)

    def _key(self, figure: Figure, page: _Panel) -> None:
        """The colour scale."""
        key = _Panel(figure, 62, 668, 338, 9)
        key.as_chart()
        key.axes.grid(False)
        low, high = ROCK_SCALE.vmin, ROCK_SCALE.vmax
        assert low is not None and high is not None
        edges = np.geomspace(low, high, 257)
        key.axes.pcolormesh(edges, [0, 1], np.sqrt(edges[1:] * edges[:-1])[None], cmap=ROCK_COLOURS, norm=ROCK_SCALE)
        key.axes.set_xscale("log")
        key.axes.set_xlim(low, high)
        key.axes.set_xticks([5, 10, 20, 40, 70], ["5", "10", "20", "40", "70"])
        key.axes.minorticks_off()
        key.axes.set_yticks([])
        page.text(62, 659, "loading stiffness; hatched: not drilled yet", 9.0)
        page.text(400, 659, "kN/mm", 9.0, ha="right")

    @classmethod
    def deepest_shown(cls, view: View) -> float:
        """The lower end of the panel in mm."""
        return step_above(view.truth[T_DEPTH] / 0.94, cls.DEPTHS)

    @classmethod
    def scale(cls, view: View) -> float:
        """Pixels a mm."""
        return cls.HEIGHT / cls.deepest_shown(view)

    def update(self, view: View) -> bool:
        depth = view.truth[T_DEPTH]
        deepest = self.deepest_shown(view)
        changed = deepest != self.deepest or not np.array_equal(self.layers, view.layers)
        if changed:
            self.deepest, self.layers = deepest, view.layers
            self.axes.set_ylim(deepest, 0)
            bands = rock_bands(view.layers, 0.0, deepest)
            self.rock.set_verts([[(0, top), (1, top), (1, end), (0, end)] for top, end, _ in bands])
            self.rock.set_facecolor([rock_colour(stiffness) for *_, stiffness in bands])
        self.ahead.set_y(max(depth, 0.0))
        self.ahead.set_height(max(deepest - depth, 0.0))
        self.level.set_data([0, 1], [depth, depth])
        self.marker.set_data([1.16], [depth])
        return changed


def rock_colour(stiffness: float) -> tuple[float, float, float, float]:
    """The colour of a rock, by its loading stiffness in N/m."""
    return ROCK_COLOURS(float(ROCK_SCALE(1e-6 * stiffness)))


def rock_bands(layers: np.ndarray, top: float, bottom: float) -> list[tuple[float, float, float]]:
    """Upper and lower end in mm and loading stiffness in N/m of the layers that show between two depths in mm."""
    bands, begin = [], 0.0
    for stiffness, end in zip(layers[:, LAYER_KL].tolist(), (1e3 * layers[:, LAYER_END]).tolist(), strict=True):
        upper, lower = max(begin, top), min(end, bottom)
        if upper < lower:
            bands.append((upper, lower, stiffness))
        begin = end
    return bands


class _Close(_Panel):
    """The rig on the face: positions at the last instant, to scale about the face, and over the last period."""

    FACE = 384.0
    """Where the face is, in pixels from the top."""
    LIFTS = (0.6, 1.2, 2.4, 5.0, 10.0)
    """Heights in mm that may fill the room above the face."""
    ROOM, ABOVE = 80.0, 110.0
    """Pixels above the face that the tip moves in, and that rock is drawn in."""
    PRESSED = 0.4
    """Room below the face for the tip in contact, over that above."""
    SHAKER_SCALE = 12.8
    """Pixels a mm for the shaker: it rides on the spring's static shortening, many times the motion."""
    MIDDLE, HOLE, ROD, CONE = 122.0, 31.0, 20.0, 19.0
    GHOSTS = 12
    GRAINS, GRAIN_SPAN = 260, 12.0
    """Grains in the rock, and the depth in mm after which they come again."""

    def __init__(self, figure: Figure, page: _Panel):
        super().__init__(figure, 166, 146, 252, 474)
        self.as_page()
        self.heading(page, "Rig", "last instant, bodies not to scale")
        axes = self.axes
        axes.add_patch(Rectangle((0, 0), self.width, self.height, color=PANEL, linewidth=0))
        self.lifts = Scale(*self.LIFTS)
        self.rock: PolyCollection = self.move(axes.add_collection(PolyCollection([], linewidth=0), autolim=False))
        grains = np.random.default_rng(7).random((self.GRAINS, 3))
        self.grain_x = self.width * grains[:, 0]
        self.grain_depth = self.GRAIN_SPAN * grains[:, 1]
        shades = np.where(grains[:, 2] < 0.6, 0.0, 1.0)
        self.grains: PathCollection = self.move(
            axes.scatter(self.grain_x, self.grain_x, s=2.0 + 7.0 * grains[:, 2] ** 2, linewidths=0)
        )
        self.grains.set_facecolor([(s, s, s, 0.28) for s in shades])
        self.ahead = self._polygon(to_rgba(PANEL, 0.5), edgecolor=to_rgba(INK, 0.22), hatch="////", linewidth=0)
        self.hole = self._polygon(GROUND, linewidth=0)
        self.floor = self.line(INK, 1.2, alpha=0.8)
        self.fade = self._fade()
        self.spring = self.line(STEEL, 1.8, solid_joinstyle="round")
        self.damper = self.line(STEEL, 1.8)
        self.indenter = self._polygon(STEEL, edgecolor=INK, linewidth=0.8)
        self.tip = self._polygon(CONTACT, linewidth=0)
        self.ghosts: LineCollection = self.move(axes.add_collection(LineCollection([], linewidths=1.3), autolim=False))
        self.body = self._polygon("#3a4857", edgecolor=STEEL, linewidth=1.0)
        self.push = self._arrow(STRONG_BLOW)
        self.drive = self._arrow(FREE)
        self.body_name = self.move(self.text(self.MIDDLE, 0, size=10.0, colour=INK, ha="center", va="center"))
        self.plate_name = self.move(
            self.text(self.MIDDLE, 0, "indenter", size=9.0, colour=GROUND, ha="center", va="center")
        )
        self.push_name = self.move(self.text(self.MIDDLE + 16, 0, size=9.0, colour=STRONG_BLOW, va="center"))
        self.drive_name = self.move(self.text(0, 0, size=9.0, colour=FREE, va="center"))
        self.rock_name = self.move(self.text(self.width - 8, self.height - 10, size=9.0, colour=INK, ha="right"))
        self.bar = self.line(INK, 1.4)
        self.bar_name = self.move(self.text(0, 0, size=9.0, colour=INK, va="center"))

    def _polygon(self, colour: Any, **more: Any) -> Polygon:
        return self.move(self.axes.add_patch(Polygon(np.zeros((3, 2)), closed=True, facecolor=colour, **more)))

    def _arrow(self, colour: str) -> Polygon:
        return self._polygon(colour, linewidth=0)

    def _fade(self) -> Any:
        """The rock fades out upwards: beyond, it is left out."""
        shade = np.tile(to_rgba(PANEL), (64, 1, 1))
        shade[:, 0, 3] = np.linspace(1.0, 0.0, 64) ** 0.7
        image = self.axes.imshow(
            shade, extent=(0, self.width, self.FACE - 45, self.FACE - self.ABOVE - 1), aspect="auto"
        )
        self.as_page()
        return self.move(image)

    def clear(self) -> None:
        self.lifts.clear()

    def update(self, view: View) -> bool:
        scale = self.ROOM / self.lifts.over(max(-float(view.gap.min()), float(view.gap.max()) / self.PRESSED))
        self._draw_rock(view, scale)
        self._draw_rig(view, scale)
        self._draw_ghosts(view, scale)
        mm = next(mm for mm in (0.5, 1.0, 2.0, 5.0, 10.0, math.inf) if mm * scale > 45)
        x, y = 16.0, self.height - 28.0
        high = y - mm * scale
        self.bar.set_data([x - 4, x + 4, x, x, x - 4, x + 4], [y, y, y, high, high, high])
        self.bar_name.set(
            text=f"{mm:g} mm\n{scale / _Strata.scale(view):.0f} {TIMES} the strata", position=(x + 9, 0.5 * (y + high))
        )
        return False

    def _draw_rock(self, view: View, scale: float) -> None:
        depth = view.truth[T_DEPTH]
        above, below = self.ABOVE / scale, (self.height - self.FACE) / scale
        bands = rock_bands(view.layers, max(depth - above, 0.0), depth + below)
        width = self.width

        def y(mm: float) -> float:
            return self.FACE + scale * (mm - depth)

        self.rock.set_verts([[(0, y(a)), (width, y(a)), (width, y(b)), (0, y(b))] for a, b, _ in bands])
        self.rock.set_facecolor([rock_colour(stiffness) for *_, stiffness in bands])
        mm = depth - above + (self.grain_depth - (depth - above)) % self.GRAIN_SPAN
        # grains above the first rock's face are in the air
        self.grains.set_offsets(
            np.column_stack([np.where(mm > 0, self.grain_x, -99.0), self.FACE + scale * (mm - depth)])
        )
        surface, pressed = y(0.0), max(self._tip(float(view.gap[-1]), scale), self.FACE)
        # the cone's hole ends where it reaches the bore hole, or the surface of the first rock
        shoulder = max(pressed - self.CONE * self.HOLE / self.ROD, surface)
        half = (pressed - shoulder) * self.ROD / self.CONE
        left, right = self.MIDDLE - half, self.MIDDLE + half
        notch = [(left, shoulder), (self.MIDDLE, pressed), (right, shoulder)]
        top = min(max(self.FACE - self.ABOVE, surface), shoulder)
        self.hole.set_xy([(left, top), *notch, (right, top)])
        self.ahead.set_xy([(0, shoulder), *notch, (width, shoulder), (width, self.height), (0, self.height)])
        self.floor.set_data(*np.transpose(notch))
        digits = [f"{mega:.{0 if mega >= 100 else 1}f}" for mega in (view.truth[[T_KL, T_KU]] * 1e-6).tolist()]
        self.rock_name.set_text(f"loading {digits[0]}, unloading {digits[1]} kN/mm")

    def _draw_rig(self, view: View, scale: float) -> None:
        middle = self.MIDDLE
        tip = self._tip(float(view.gap[-1]), scale)
        left, right, edge = middle - self.ROD, middle + self.ROD, tip - self.CONE
        plate, wide = tip - 128.0, 50.0
        top = plate - 20.0
        stem = [(right, plate), (right, edge), (middle, tip), (left, edge), (left, plate)]
        flange = [(middle - wide, plate), (middle - wide, top), (middle + wide, top), (middle + wide, plate)]
        self.indenter.set_xy([*stem, *flange])
        self.tip.set_xy([(left, edge), (middle, tip), (right, edge)])
        self.tip.set_facecolor(CONTACT if view.force[-1] > 0 else DARK_STEEL)
        bottom = _between(70.0 + self.SHAKER_SCALE * float(view.shaker[-1]), 84.0, top - 36.0)
        roof = bottom - 56.0
        self.body.set_xy([(middle - 84, roof), (middle + 84, roof), (middle + 84, bottom), (middle - 84, bottom)])
        self.body_name.set(position=(middle, bottom - 29), text=f"shaker  {view.rig[RIG_M1]:.0f} kg")
        self.plate_name.set_position((middle, plate - 11))
        self.spring.set_data(*spring_path(middle - 34, bottom, top))
        self.damper.set_data(*damper_path(middle + 34, bottom, top))
        push = view.rig[RIG_PRESSURE] * PUSH * view.truth[T_PRESSURE]
        self.push.set_xy(arrow_outline(middle, 3.0, roof - 2))
        self.push_name.set(position=(middle + 14, 0.5 * roof), text=f"push {push:.0f} N")
        length = 34.0 * view.drive / MOST_DRIVE
        self.drive.set_xy(arrow_outline(middle + wide + 14, plate - 10 - length, plate - 10 + length))
        self.drive_name.set(
            position=(middle + wide + 27, plate - 10), text=f"drive\n{view.drive:.0f} N".replace("-", MINUS)
        )

    def _tip(self, gap: float, scale: float) -> float:
        """The height in the picture of a tip so many mm beyond the face."""
        return self.FACE + _between(scale * gap, -self.ROOM, self.PRESSED * self.ROOM)

    def _draw_ghosts(self, view: View, scale: float) -> None:
        """The edge of the cone at instants of the last period."""
        places = len(view.gap) - 1 - np.linspace(view.period - 1, 1, self.GHOSTS).astype(int)
        edges, colours = [], []
        for age, place in enumerate(places.tolist()):
            tip = self._tip(float(view.gap[place]), scale)
            left, right = self.MIDDLE - self.ROD, self.MIDDLE + self.ROD
            edges.append([(left, tip - self.CONE), (self.MIDDLE, tip), (right, tip - self.CONE)])
            colours.append(to_rgba(CONTACT if view.force[place] > 0 else FREE, 0.25 + 0.6 * age / self.GHOSTS))
        self.ghosts.set_segments(edges)
        self.ghosts.set_color(colours)


MOST_DRIVE = (DRIVE_SLOPE * FREQUENCY_RANGE[1] + DRIVE_BASE) * AMPLITUDE_RANGE[1]
"""In N, over the settings of Table 2.1."""


def spring_path(
    x: float, top: float, bottom: float, turns: int = 6, half: float = 11.0
) -> tuple[np.ndarray, np.ndarray]:
    """A zigzag between two heights."""
    ends = 7.0
    y = np.concatenate([[top], np.linspace(top + ends, bottom - ends, 2 * turns + 1), [bottom]])
    sway = half * np.array([0.0, 0.0, *((1.0, -1.0) * turns)[: 2 * turns - 1], 0.0, 0.0])
    return x + sway, y


def damper_path(x: float, top: float, bottom: float, half: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
    """A pot below and a piston on a rod above, between two heights."""
    middle, floor, rim = 0.5 * (top + bottom), bottom - 8.0, 0.5 * (top + bottom) - 9.0
    gap = np.nan
    xs = [x, x, gap, x - half + 3, x + half - 3, gap, x - half, x - half, x + half, x + half, gap, x, x]
    ys = [top, middle, gap, middle, middle, gap, rim, floor, floor, rim, gap, floor, bottom]
    return np.array(xs), np.array(ys)


def arrow_outline(x: float, start: float, end: float, half: float = 2.0, head: float = 6.0) -> np.ndarray:
    """(7, 2) an upright arrow from one height to another."""
    way = math.copysign(1.0, end - start)
    neck = end - way * min(9.0, abs(end - start))
    points = [(-half, start), (-half, neck), (-head, neck), (0, end), (head, neck), (half, neck), (half, start)]
    return np.array([(x + dx, y) for dx, y in points])


class _Force(_Panel):
    """The contact force over the interval, with the rating."""

    def __init__(self, figure: Figure, page: _Panel):
        super().__init__(figure, 468, 146, 408, 246)
        self.as_chart()
        self.reach(46, 16, 8, 6)
        self.heading(page, "Contact force", "kN")
        self.axes.tick_params(labelbottom=False)
        self.range = Scale(1.2, 2.5, 4.0, 6.0, 10.0)
        self.top, self.end = 0.0, 0.0
        self.fill = self.move(
            self.axes.add_patch(Polygon(np.zeros((3, 2)), closed=True, facecolor=to_rgba(CONTACT, 0.28), linewidth=0))
        )
        self.curve = self.line(CONTACT, 1.1)
        self.rating = self.line(ABOVE, 1.2, linestyle=(0, (5, 3)))
        self.rating_name = page.move(page.text(876 - 28, 135, size=9.0, colour=ABOVE, ha="right"))
        self.over = self.line(ABOVE, 0.0, marker="o", markersize=4.5, markeredgewidth=0)

    def clear(self) -> None:
        self.range.clear()

    def update(self, view: View) -> bool:
        need = 1.06 * float(view.force.max())
        # a rating far above the forces, that is none, would press them flat
        if view.rating < 4.0:
            need = max(need, 1.15 * view.rating)
        top, end = self.range.over(need), float(view.time[-1])
        changed = (top, end) != (self.top, self.end)
        if changed:
            self.top, self.end = top, end
            self.axes.set_ylim(0, top)
            self.axes.set_xlim(0, end)
        self.curve.set_data(view.time, view.force)
        self.fill.set_xy(np.column_stack([[*view.time, end, view.time[0]], [*view.force, 0.0, 0.0]]))
        self.rating.set_data([0, end], [view.rating, view.rating])
        self.rating_name.set_text(f"rating {view.rating:.1f}")
        high = view.peaks[view.force[view.peaks] > view.rating]
        self.over.set_data(view.time[high], view.force[high])
        return changed


class _Acceleration(_Panel):
    """The indenter's acceleration over the interval."""

    def __init__(self, figure: Figure, page: _Panel):
        super().__init__(figure, 468, 440, 408, 212)
        self.as_chart()
        self.reach(46, 16, 8, 26)
        self.heading(page, "Acceleration of the indenter", "g")
        page.text(468 + 408, 694, "time in the interval, ms", 9.0, ha="right")
        self.range = Scale(5.0, 10.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0)
        self.most, self.end = 0.0, 0.0
        self.axes.axhline(0.0, color=FRAME, linewidth=1.0, zorder=1)
        self.curve = self.line(FREE, 1.0)

    def clear(self) -> None:
        self.range.clear()

    def update(self, view: View) -> bool:
        need = max(-float(view.acceleration.min()), float(view.acceleration.max()) / 0.6)
        most, end = self.range.over(1.04 * need), float(view.time[-1])
        changed = (most, end) != (self.most, self.end)
        if changed:
            self.most, self.end = most, end
            self.axes.set_ylim(-most, 0.6 * most)
            self.axes.set_xlim(0, end)
        self.curve.set_data(view.time, view.acceleration)
        return changed


class _Portrait(_Panel):
    """Speed over position: the whole interval faintly, its last periods clearly."""

    CLEAR = 4
    """Excitation periods drawn clearly."""

    def __init__(self, figure: Figure, page: _Panel):
        super().__init__(figure, 936, 146, 316, 208)
        self.as_chart()
        self.reach(54, 24, 8, 24)
        self.heading(page, "Phase portrait", "speed, m/s")
        page.text(936 + 316, 392, "indenter above the face, mm", 9.0, ha="right")
        self.lifts, self.speeds = Scale(0.075, 0.15, 0.3, 0.6, 1.2, 2.4, 5.0), Scale(0.04, 0.08, 0.16, 0.32, 0.64)
        self.lift, self.speed = 0.0, 0.0
        self.axes.axvline(0.0, color=FRAME, linewidth=1.0, zorder=1)
        self.axes.axhline(0.0, color=FRAME, linewidth=1.0, zorder=1)
        self.parts = [
            (self.line(FREE, 0.8, alpha=0.25), self.line(CONTACT, 0.8, alpha=0.25)),
            (self.line(FREE, 1.5), self.line(CONTACT, 1.5)),
        ]
        self.impacts = self.line(INK, 0.0, marker="o", markersize=5.0, markeredgewidth=0.6, markeredgecolor=GROUND)

    def clear(self) -> None:
        self.lifts.clear()
        self.speeds.clear()

    def update(self, view: View) -> bool:
        height = -view.gap
        lift = self.lifts.over(1.03 * max(float(height.max()), -6.0 * float(height.min())))
        speed = self.speeds.over(1.05 * float(np.abs(view.speed).max()))
        changed = (lift, speed) != (self.lift, self.speed)
        if changed:
            self.lift, self.speed = lift, speed
            # the face to the right, as the indenter comes down on it
            self.axes.set_xlim(lift, -lift / 5)
            self.axes.set_ylim(-speed, speed)
        recent = max(len(height) - self.CLEAR * view.period, 0)
        touching = view.force > 0
        # each part reaches over to the next, so that no gap shows between them
        near = touching.copy()
        near[1:] |= touching[:-1]
        near[:-1] |= touching[1:]
        for (free, contact), part in zip(self.parts, (slice(0, recent), slice(recent, None)), strict=True):
            free.set_data(np.where(touching[part], np.nan, height[part]), view.speed[part])
            contact.set_data(np.where(near[part], height[part], np.nan), view.speed[part])
        self.impacts.set_data(height[view.peaks], view.speed[view.peaks])
        return changed


class _Map(_Panel):
    """The plane of amplitude and pressure at the present frequency and rock: where strong P-1-I-1 lives."""

    SHADES = (*(to_rgba(STRONG_BLOW, alpha) for alpha in (0.12, 0.28, 0.5)), to_rgba(ABOVE, 0.3))
    """Of the settings between two LEVELS."""

    def __init__(self, figure: Figure, page: _Panel):
        super().__init__(figure, 936, 440, 316, 174)
        self.as_chart()
        self.title = page.move(self.heading(page, "", "bar"))
        page.text(936 + 316, 650, "amplitude, V", 9.0, ha="right")
        self.axes.set_xlim(AMPLITUDE_RANGE[0] - 0.01, AMPLITUDE_RANGE[1] + 0.01)
        self.axes.set_ylim(PRESSURE_RANGE[0] - 0.05, PRESSURE_RANGE[1] + 0.05)
        self.axes.set_xticks([0.3, 0.4, 0.5, 0.6])
        self.axes.set_yticks([0.6, 1.0, 1.4, 1.8])
        self.zones = [
            self.move(self.axes.add_patch(Polygon(np.zeros((3, 2)), closed=True, facecolor=colour, linewidth=0)))
            for colour in self.SHADES
        ]
        self.end = self.line(STRONG_BLOW, 1.8)
        self.limit = self.line(ABOVE, 1.4, linestyle=(0, (5, 3)))
        self.nothing = self.move(
            self.axes.text(
                0.5,
                0.5,
                "none at this frequency",
                transform=self.axes.transAxes,
                fontsize=9.5,
                color=MUTED,
                ha="center",
                va="center",
            )
        )
        self.past: deque[tuple[float, float]] = deque(maxlen=TRAIL)
        self.trail: LineCollection = self.move(
            self.axes.add_collection(LineCollection([], linewidths=1.4), autolim=False)
        )
        self.valve = self.line(INK, 0.9, linestyle=(0, (2, 2)), marker="_", markersize=9, markevery=[1])
        self.dot = self.line(
            INK, 0.0, marker="o", markersize=8.5, markeredgecolor=GROUND, markeredgewidth=1.5, clip_on=False
        )
        self._legend(page)

    def _legend(self, page: _Panel) -> None:
        """Which colour stands for which peak force."""
        x, y, width = 936.0, 674.0, 44.0
        page.text(x, y + 9, "peak force / rating", 9.0)
        x = 936 + 316 - 4 * width
        for level, shade in zip(LEVELS, self.SHADES, strict=False):
            page.axes.add_patch(Rectangle((x, y), width, 9, facecolor=shade, edgecolor=FRAME, linewidth=0.8))
            if level:
                page.text(x, y + 24, f"{100 * level:.0f} %", 9.0, ha="center")
            x += width

    def clear(self) -> None:
        self.past.clear()

    def update(self, view: View) -> bool:
        truth = view.truth
        here = float(truth[T_AMPLITUDE]), float(truth[T_PRESSURE])
        branch = branch_at(truth, view.rig)
        self.title.set_text(f"Strong P-1-I-1 at {truth[T_FREQUENCY]:.0f} Hz")
        some = bool(branch.ratio.size)
        for artist in (*self.zones, self.end, self.limit):
            artist.set_visible(some)
        self.nothing.set_visible(not some)
        if some:
            rating = 1e3 * view.rating
            for patch, low, high in zip(self.zones, LEVELS, LEVELS[1:], strict=False):
                patch.set_xy(zone(branch, low * rating, high * rating))
            self.end.set_data([0.0, 1.0], [0.0, branch.ratio[-1]])
            self.limit.set_data(rating / branch.force, branch.ratio * rating / branch.force)
        self.past.append(here)
        places = np.array(self.past)
        self.trail.set_segments(list(np.stack([places[:-1], places[1:]], axis=1)))
        ages = np.arange(1, len(places)) / TRAIL + 1.0 - len(places) / TRAIL
        self.trail.set_color([to_rgba(INK, 0.05 + 0.75 * age) for age in ages.tolist()])
        self.dot.set_data([here[0]], [here[1]])
        self.valve.set_data([here[0], here[0]], [here[1], truth[T_VALVE]])
        return False


def branch_at(truth: np.ndarray, rig: np.ndarray) -> Branch:
    """The branch for the frequency and the rock of a row of truth, both rounded so that it is seldom made anew."""
    frequency = round(2.0 * float(truth[T_FREQUENCY])) / 2.0
    loading, unloading = (float(f"{stiffness:.3g}") for stiffness in truth[[T_KL, T_KU]].tolist())
    return strong_branch(frequency, loading, max(loading, unloading), tuple(rig.tolist()))


class _Page(_Panel):
    """The whole frame in pixels: titles and captions."""

    def __init__(self, figure: Figure):
        super().__init__(figure, 0, 0, WIDTH, HEIGHT)
        self.as_page()
        self.axes.patch.set_alpha(0.0)

    def update(self, view: View) -> bool:
        return False


class Renderer:
    """Draws intervals, one after the other.

    It remembers the last settings and forces for the trail and the scales, and forgets them where an interval does not
    go on from the one drawn before: another episode, a state set, or intervals that were not drawn.

    Args:
        mode: "rgb_array" for arrays, "human" for a window.

    Raises:
        InputError: another mode, or no window can be opened.
    """

    def __init__(self, mode: str = "rgb_array"):
        self.mode = choice("render_mode", mode, MODES)
        self._window = Window() if self.mode == "human" else None
        with style.context(["default", _STYLE]):
            self.figure = Figure(figsize=(WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, facecolor=GROUND)
            self._canvas = FigureCanvasAgg(self.figure)
            page = _Page(self.figure)
            self._header = _Header(self.figure)
            self._panels = [
                self._header,
                page,
                _Strata(self.figure, page),
                _Close(self.figure, page),
                _Force(self.figure, page),
                _Acceleration(self.figure, page),
                _Portrait(self.figure, page),
                _Map(self.figure, page),
            ]
        self._blank: np.ndarray | None = None
        self._background = np.zeros((HEIGHT, WIDTH, 4), dtype=np.uint8)
        self._last: np.ndarray | None = None

    def draw(
        self,
        trace: np.ndarray,
        truth: np.ndarray,
        layers: np.ndarray,
        rig: np.ndarray,
        rating: float,
        interval: float,
        reward: float,
    ) -> np.ndarray | None:
        """A picture of an interval.

        Args:
            trace: (samples, 8) the interval in detail, columns as in :data:`drillenv.env.plant.TRACE`.
            truth: (TRUTH_SIZE,) what happened in it, see :data:`drillenv.env.truth.TRUTH`.
            layers: (m, 4) the rock, see :mod:`drillenv.env.plant`.
            rig: (6,) m1, m2, k, c, drive and pressure gain.
            rating: Contact force in N above which the tool wears.
            interval: Its length in s.
            reward: Of the interval, in mm/s.

        Returns:
            (HEIGHT, WIDTH, 3) uint8 for "rgb_array"; None for "human", which shows it.
        """
        view = view_of(trace, truth, layers, rig, rating, interval, reward)
        if self._last is None or not np.array_equal(truth, self._last):
            self._follow(truth, interval)
            with mpl.rc_context(_STYLE):
                self._update(view)
            self._last = truth.copy()
        frame = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
        pixels = np.asarray(self._canvas.buffer_rgba())
        for channel in range(3):  # several times as fast as all at once
            frame[..., channel] = pixels[..., channel]
        if self._window is None:
            return frame
        self._window.show(frame, interval)
        return None

    def _follow(self, truth: np.ndarray, interval: float) -> None:
        """Keep the clock, and forget the past where this interval does not go on from the last one drawn."""
        before = truth[T_DEPTH] - truth[T_RATE] * interval
        goes_on = self._last is not None and abs(before - self._last[T_DEPTH]) < AGREES
        clock = self._header.clock
        if not goes_on:
            for panel in self._panels:
                panel.clear()
            # an episode begins at no depth at all; in its midst nobody has counted
            clock = 0.0 if abs(before) < AGREES else None
        self._header.clock = None if clock is None else clock + interval

    def _update(self, view: View) -> None:
        """Bring the canvas up to date."""
        if self._blank is None:
            self._blank = self._draw_blank()
            self._background = self._blank.copy()
        pixels = np.asarray(self._canvas.buffer_rgba())
        changed = [panel for panel in self._panels if panel.update(view)]
        for panel in changed:
            pixels[panel.outer] = self._blank[panel.outer]
            panel.axes.draw(self._canvas.get_renderer())
            self._background[panel.outer] = pixels[panel.outer]
        pixels[:] = self._background
        for panel in self._panels:
            for artist in panel.moving:
                panel.axes.draw_artist(artist)

    def _draw_blank(self) -> np.ndarray:
        """(HEIGHT, WIDTH, 4) what never changes: all but the panels with scales of their own."""
        for panel in self._panels:
            panel.axes.set_visible(panel.outer is None)
        self._canvas.draw()
        for panel in self._panels:
            panel.axes.set_visible(True)
        return np.asarray(self._canvas.buffer_rgba()).copy()

    def close(self) -> None:
        """Close the window, if there is one. May be called twice."""
        if self._window is not None:
            self._window.close()


class Window:
    """A window that shows frames, no faster than they happen.

    Raises:
        InputError: matplotlib has nothing here to open a window with.
    """

    def __init__(self) -> None:
        from matplotlib import pyplot

        advice = "give render_mode='rgb_array', which needs no screen"
        try:
            with mpl.rc_context({"toolbar": "None"}):
                self._figure = pyplot.figure(figsize=(WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, facecolor=GROUND)
        except Exception as error:  # each toolkit has its own
            reason = shown(str(error).partition("\n")[0])
            raise InputError(f"render_mode is 'human', but no window can be opened ({reason}): {advice}") from None
        manager = self._figure.canvas.manager
        if self._figure.canvas.required_interactive_framework is None or manager is None:
            pyplot.close(self._figure)
            raise InputError(
                f"render_mode is 'human', but matplotlib's backend {pyplot.get_backend()} opens no window: choose "
                f"another where there is a screen (MPLBACKEND=tkagg), else {advice}"
            )
        axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        self._image = axes.imshow(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8), aspect="equal")
        self._figure.canvas.mpl_connect("close_event", self._closed)
        self._open = True
        self._due = -math.inf
        manager.set_window_title("drillenv")
        manager.show()

    def _closed(self, _event: Any) -> None:
        self._open = False

    def show(self, frame: np.ndarray, interval: float) -> None:
        """Show a frame (HEIGHT, WIDTH, 3), ``interval`` s after the last one; nothing once the user has closed it."""
        if not self._open:
            return
        wait = self._due - time.monotonic()
        if wait > 0.0:
            self._figure.canvas.start_event_loop(wait)
            if not self._open:
                return
        self._due = max(self._due, time.monotonic()) + interval
        self._image.set_data(frame)
        self._figure.canvas.draw()
        self._figure.canvas.flush_events()

    def close(self) -> None:
        """Close it. May be called twice."""
        from matplotlib import pyplot

        self._open = False
        pyplot.close(self._figure)


PICTURE_STEPS = 92
"""Of the episode whose last frame is the picture of the documentation."""


def write_picture(path: str | os.PathLike[str]) -> None:
    """Write the last frame of a short episode through layers as PNG: the picture of the documentation.

    Raises:
        InputError: the file cannot be written.
    """
    from drillenv.env.scalar import DrillEnv

    check_writable(path)
    env = DrillEnv("layers", scenario="test", render_mode="rgb_array")
    try:
        env.reset(seed=0, options={"episode": 0})
        frame = env.render()
        for step in range(PICTURE_STEPS):
            turn = 0.16 * step
            # slowly around settings that suit most rocks
            action = (0.8, 0.05 - 0.3 * math.cos(turn), -0.45 - 0.2 * math.cos(turn - 0.9))
            env.step(np.array(action, dtype=np.float32))
            frame = env.render()
    finally:
        env.close()
    assert frame is not None  # the mode is rgb_array
    with whole(path) as name:
        imsave(name, frame, format="png")


if __name__ == "__main__":
    write_picture(sys.argv[1])
