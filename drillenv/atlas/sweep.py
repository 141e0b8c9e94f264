"""Sweeps of one control or of the rock's stiffness, along which the rig keeps moving: bifurcation diagrams.

Each point starts from the motion on which the rig settled at the point before, so that a sweep up and a sweep down
may show different motions where several coexist. Only a motion's numbers and its peaks are kept of a point, however
long the rig had to run there.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from drillenv.checks import InputError, choice, count, number
from drillenv.dynamics import motion_hybrid
from drillenv.dynamics.compiled import INLINE, KERNEL
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.exact import (
    COSINE,
    LOG_SIZE,
    SINE,
    STATE_SIZE,
    TURN,
    TURNS,
    Scratch,
    acceleration,
    advance_logged,
    fresh_state,
    make_scratch,
    set_phase,
)
from drillenv.dynamics.flow import (
    LOADING,
    MODEL_SHAPE,
    OMEGA,
    STIFFNESS,
    UNLOADING,
    contact_coefficients,
    contact_state,
    make_model,
    set_drive,
    set_plant,
)
from drillenv.dynamics.motion import Motion, checked_place, motion_of
from drillenv.dynamics.orbits import MOTION_SIZE, PERIOD, SECTION, SECTION_REGIME, put_on_section
from drillenv.dynamics.survey import PATIENCE, SURVEY, WAIT, as_survey, labels, settle_on
from drillenv.files import whole
from drillenv.rig import AMPLITUDE_LIMITS, FREQUENCY_LIMITS, PRESSURE_LIMITS, Rig, Setting
from drillenv.rocks import STIFFNESS_LIMITS, Rock

CONTROLS = {
    "frequency": (*FREQUENCY_LIMITS, "Hz"),
    "amplitude": (*AMPLITUDE_LIMITS, "V"),
    "pressure": (*PRESSURE_LIMITS, "bar"),
    "stiffness": (*STIFFNESS_LIMITS, "N/m"),
}
"""What can be swept, with its limits and unit. The stiffness is k_l; k_u keeps its ratio to it."""
SLIPS = {
    "frequency": [(1e3, "kHz")],
    "amplitude": [(1e-3, "mV")],
    "pressure": [(1e-2, "kPa")],
    "stiffness": [(1e6, "kN/mm"), (1e3, "N/mm or kN/m")],
}
"""Units taken by mistake for those of CONTROLS, with their factors."""
DIRECTIONS = ("up", "down")
MOST_POINTS = 1_000_000
ROUNDING = 1e-9
"""A step that overshoots the range by no more than this share of it still reaches the end."""
MOST_PEAKS = 64
"""Peaks kept of a motion; of one that does not close, its next so many."""
CHUNK = 32
"""Points between two moves of the progress bar."""

SWEEP_POINT = np.dtype(
    [
        ("value", "f8"),
        *((name, SURVEY[name]) for name in SURVEY.names or ()),
        ("peaks", "i4"),
        ("peak_forces", "f8", (MOST_PEAKS,)),
        ("peak_accelerations", "f8", (MOST_PEAKS,)),
    ]
)
"""One point of a sweep: a motion as in SURVEY, its number of peaks, and for each peak the force in N and the largest
deceleration -X2'' in m/s^2 from the beginning of the loading to the end of the unloading around it; NaN beyond the
number of peaks."""

# Columns of a log row (see exact.LOG_SIZE) used here.
_TURNS, _REGIME, _FIRST, _PHASE = 0, 1, 2, 7


@njit(**INLINE)
def deceleration(model: np.ndarray, regime: int, scratch: Scratch, phase: float, state: np.ndarray, t: float) -> float:
    """-X2'' in m/s^2 a time ``t`` into the contact of ``scratch.work``."""
    set_phase(phase + model[0, OMEGA] * t, state)
    contact_state(model, regime, scratch.work, state[SINE], state[COSINE], t, state)
    return -acceleration(model, state, model[regime, STIFFNESS])


@njit(**KERNEL)
def largest_deceleration(
    model: np.ndarray, row: np.ndarray, duration: float, state: np.ndarray, scratch: Scratch
) -> float:
    """The largest -X2'' in m/s^2 during the contact regime that begins with a log row and lasts ``duration`` s."""
    regime = int(row[_REGIME])
    set_phase(row[_PHASE], state)
    contact_coefficients(model, regime, row[_FIRST : _FIRST + 4], state[SINE], state[COSINE], scratch.work)
    samples = 16
    best, place = -np.inf, 0
    for i in range(samples + 1):
        value = deceleration(model, regime, scratch, row[_PHASE], state, duration * i / samples)
        if value > best:
            best, place = value, i
    # golden sections around the best sample
    low, high = duration * max(place - 1, 0) / samples, duration * min(place + 1, samples) / samples
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    left, right = high - golden * (high - low), low + golden * (high - low)
    at_left = deceleration(model, regime, scratch, row[_PHASE], state, left)
    at_right = deceleration(model, regime, scratch, row[_PHASE], state, right)
    for _ in range(24):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - golden * (high - low)
            at_left = deceleration(model, regime, scratch, row[_PHASE], state, left)
        else:
            low, left, at_left = left, right, at_right
            right = low + golden * (high - low)
            at_right = deceleration(model, regime, scratch, row[_PHASE], state, right)
    return max(best, at_left, at_right)


@njit(**INLINE)
def log_phase(row: np.ndarray) -> float:
    """Phase of the excitation at the start of a segment, in rad, whole turns counted in."""
    return row[_TURNS] * TURN + row[_PHASE]


@njit(**KERNEL)
def find_peaks(
    model: np.ndarray,
    state: np.ndarray,
    periods: int,
    log: np.ndarray,
    scratch: Scratch,
    forces: np.ndarray,
    accelerations: np.ndarray,
) -> int:
    """The force peaks of ``periods`` excitation periods, the second on from ``state``; returns how many were written.

    A period more is run on either side, so that an impact under way at the section is seen from beginning to end.
    """
    omega = model[0, OMEGA]
    begin = state[TURNS] * TURN
    rows = advance_logged(model, state, (periods + 2) * TURN / omega, log, scratch)[0]
    found = 0
    for i in range(1, rows - 1):
        turn = log[i, _REGIME] == UNLOADING and log[i - 1, _REGIME] == LOADING
        first, top, last = log_phase(log[i - 1]), log_phase(log[i]), log_phase(log[i + 1])
        if turn and TURN < top - begin <= (periods + 1) * TURN and found < forces.size:
            forces[found] = model[UNLOADING, STIFFNESS] * log[i, _FIRST + 3]
            loading = largest_deceleration(model, log[i - 1], (top - first) / omega, state, scratch)
            unloading = largest_deceleration(model, log[i], (last - top) / omega, state, scratch)
            accelerations[found] = max(loading, unloading)
            found += 1
    return found


@njit(**KERNEL)
def follow(
    plant: np.ndarray,
    stiffnesses: np.ndarray,
    drives: np.ndarray,
    state: np.ndarray,
    wait: int,
    patience: int,
    out: np.ndarray,
    tangents: np.ndarray,
    peaks: np.ndarray,
) -> int:
    """The motions along a line of settings, each from where the one before crosses the section.

    ``plant`` (4,) is m1, m2, k, c; ``stiffnesses`` (n, 2) k_l and k_u; ``drives`` (n, 3) omega, F_a and F_b. ``state``
    is where to start and becomes where it ends. ``peaks`` (n, 2, m) gets forces and accelerations. Returns the number
    of points that the exact engine could take, counted up to the first one that it could not.
    """
    model, scratch = np.zeros(MODEL_SHAPE), make_scratch()
    log, run = np.empty((8 * MOST_PEAKS, LOG_SIZE)), np.empty(STATE_SIZE)
    for i in range(drives.shape[0]):
        ok = set_plant(plant[0], plant[1], plant[2], plant[3], stiffnesses[i, 0], stiffnesses[i, 1], model)
        if not ok:
            return i
        set_drive(drives[i, 0], drives[i, 1], drives[i, 2], model)
        settle_on(model, state, wait, patience, out[i], tangents[i])
        period = int(out[i, PERIOD])
        if period > 0:
            put_on_section(out[i, SECTION : SECTION + 4], int(out[i, SECTION_REGIME]), state)
        run[:] = state
        peaks[i] = np.nan
        find_peaks(model, run, period if period > 0 else MOST_PEAKS, log, scratch, peaks[i, 0], peaks[i, 1])
    return drives.shape[0]


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """The motions along a sweep, by :func:`sweep`."""

    over: str
    """What was swept: frequency (Hz), amplitude (V), pressure (bar) or stiffness (k_l in N/m)."""
    values: np.ndarray
    """(n,) its values, rising."""
    up: np.ndarray | None
    """(n,) of dtype SWEEP_POINT, in the order of ``values``: the motions on the way up; None where not asked for."""
    down: np.ndarray | None
    """The same on the way down, also in the order of ``values``."""
    setting: Setting
    rock: Rock
    rig: Rig
    effects: tuple[Chosen, ...] = ()
    """Those beyond the paper's model."""

    def points(self, direction: str) -> np.ndarray:
        """(n,) the points of the sweep "up" or "down".

        Raises:
            InputError: no such direction, or one that was not swept.
        """
        points = self.up if choice("direction", direction, DIRECTIONS) == "up" else self.down
        if points is None:
            raise InputError(
                f"direction is {direction!r}, which this sweep does not have: give direction='both' to sweep"
            )
        return points

    def labels(self, direction: str) -> np.ndarray:
        """(n,) labels of the motions "up" or "down"."""
        return labels(self.points(direction))

    def motion(self, index: int, direction: str) -> Motion:
        """The motion at ``values[index]``; with effects, its four largest multipliers, and no ``state``."""
        setting, rock = place_at(self.setting, self.rock, self.over, float(self.values[index]))
        found = motion_of(self.points(direction)[index], setting, rock, self.rig)
        return replace(found, effects=self.effects)

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions that were swept."""
        return tuple(name for name in DIRECTIONS if getattr(self, name) is not None)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a row for each point and direction; peaks stand in one cell each, parted by spaces.

        Raises:
            InputError: the file cannot be written. There is then no new file, and an old one stands as it was.
        """
        with whole(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(_CSV_COLUMNS)
            for direction in self.directions:
                for name, point in zip(self.labels(direction), self.points(direction), strict=True):
                    writer.writerow(self._csv_row(direction, str(name), point))

    def _csv_row(self, direction: str, name: str, point: np.void) -> list[object]:
        setting, rock = place_at(self.setting, self.rock, self.over, float(point["value"]))
        n = int(point["peaks"])
        return [
            direction,
            setting.frequency,
            setting.amplitude,
            setting.pressure,
            rock.loading_stiffness,
            rock.unloading_stiffness,
            name,
            *(point[field].item() for field in _CSV_FIELDS),
            abs(point["multipliers"][0]).item(),
            *(" ".join(f"{peak:.9g}" for peak in point[field][:n]) for field in ("peak_forces", "peak_accelerations")),
        ]

    def plot(self, path: str | os.PathLike[str], peaks: str = "acceleration") -> None:
        """Draw the bifurcation diagram to a file of any kind that Matplotlib writes (png, pdf, svg).

        Above, the motions as a strip for each direction; then the peaks of every motion, and its penetration rate, dots
        on the way up and rings on the way down. Colours tell the labels.

        Args:
            path: The file; its ending gives the kind.
            peaks: "acceleration" for the largest -X2'' of each impact, "force" for the rock force's peaks.

        Raises:
            InputError: another name of peaks, an ending that Matplotlib does not know, or no way to write it.
        """
        kind = choice("peaks", peaks, ("acceleration", "force"))
        figure = _diagram(self, kind)
        ending = Path(path).suffix.lstrip(".").lower()
        if ending not in figure.canvas.get_supported_filetypes():
            raise InputError(f"path is {os.fspath(path)!r}: end it in .png, .pdf or .svg")
        with whole(path) as temporary:
            figure.savefig(temporary, format=ending, dpi=200)


def sweep(
    setting: Setting,
    over: str,
    start: float,
    stop: float,
    step: float,
    rock: int | str | Rock = 4,
    rig: Rig | None = None,
    direction: str = "both",
    progress: bool = False,
    *,
    effects: Iterable[Chosen] = (),
    wait: int = WAIT,
    patience: int = PATIENCE,
) -> Sweep:
    """Sweep one control, or the rock's stiffness, and follow the motion.

    The rig starts at rest at the first value of each direction, settles, and is taken from value to value without a
    stop. Up and down are two such experiments, run side by side.

    Args:
        setting: The controls; the swept one is replaced.
        over: "frequency" (Hz), "amplitude" (V), "pressure" (bar) or "stiffness": k_l in N/m, with k_u / k_l as the rock
            has it.
        start, stop, step: The values start, start + step, ... up to stop, which is among them where step divides the
            range; at most a million.
        rock: Case of Table 2.2, name, or Rock.
        rig: By default that of Table 2.1.
        direction: "up", "down" or "both".
        progress: Whether to show a progress bar.
        effects, wait, patience: As for :func:`drillenv.dynamics.motion.motion`, at each value. With effects a point
            takes about 0.1 s, and one without a period some 3 s. A rock that compacts does so at the first value.

    Raises:
        InputError: an argument of the wrong kind or outside its limits, a rig and rock that the exact engine cannot
            take, or effects that do not act on the motion, are given twice, or let it grow without bound.
    """
    setting, chosen, rig = checked_place(setting, rock, rig)
    beyond = motion_hybrid.effects_meant(effects)
    over = choice("over", over, tuple(CONTROLS))
    values = _values(over, start, stop, step)
    wait, patience = count("wait", wait, 1, 1_000_000), count("patience", patience, 1, 100_000_000)
    wanted = DIRECTIONS if choice("direction", direction, (*DIRECTIONS, "both")) == "both" else (direction,)
    with _bar(progress, len(values) * len(wanted)) as move, ThreadPoolExecutor(len(wanted)) as pool:
        tasks = {}
        for name in wanted:
            ordered = values[:: 1 if name == "up" else -1]
            tasks[name] = (
                pool.submit(_run_with, setting, chosen, rig, beyond, over, ordered, wait, patience, move)
                if beyond
                else pool.submit(_run, setting, chosen, rig, over, ordered, wait, patience, move)
            )
        found = {name: task.result() for name, task in tasks.items()}
    down = found.get("down")
    return Sweep(over, values, found.get("up"), None if down is None else down[::-1], setting, chosen, rig, beyond)


def place_at(setting: Setting, rock: Rock, over: str, value: float) -> tuple[Setting, Rock]:
    """The setting and the rock with one of them moved to ``value``.

    Raises:
        InputError: the value is outside the limits.
    """
    if over != "stiffness":
        return replace(setting, **{over: value}), rock
    if value == rock.loading_stiffness:
        return setting, rock
    return setting, Rock(
        value, value * rock.unloading_stiffness / rock.loading_stiffness, f"{rock.name}, stiffness moved"
    )


def value_of(setting: Setting, rock: Rock, over: str) -> float:
    """Where a setting and a rock stand on the axis ``over``."""
    return rock.loading_stiffness if over == "stiffness" else getattr(setting, over)


def _values(over: str, start: object, stop: object, step: object) -> np.ndarray:
    low, high, unit = CONTROLS[over]
    first = number("start", start, low, high, unit, SLIPS[over])
    last = number("stop", stop, low, high, unit, SLIPS[over])
    if first >= last:
        raise InputError(
            f"start is {first:g} {unit} and stop {last:g} {unit}: give start below stop; direction='down' turns"
        )
    reach = last - first
    pace = number("step", step, reach / MOST_POINTS, reach * (1 + ROUNDING), unit)
    points = math.floor(reach / pace * (1 + ROUNDING)) + 1
    return np.minimum(np.round(first + pace * np.arange(points), 12), last)


def _run(
    setting: Setting,
    rock: Rock,
    rig: Rig,
    over: str,
    values: np.ndarray,
    wait: int,
    patience: int,
    move: Callable[[int], object],
) -> np.ndarray:
    """The points of a sweep over ``values``, in their order."""
    # settings along a line: drive and static force are those of Eq. 3.5 and 3.6 at each
    places = [place_at(setting, rock, over, value) for value in values.tolist()]
    stiffnesses = np.array([(pair.loading_stiffness, pair.unloading_stiffness) for _, pair in places])
    drives = np.array([(2 * math.pi * s.frequency, rig.drive_force(s), rig.static_force(s)) for s, _ in places])
    plant = np.array([rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping])
    n = len(values)
    out, tangents = np.empty((n, MOTION_SIZE)), np.empty((n, 4, 4))
    peaks = np.empty((n, 2, MOST_PEAKS))
    state = np.zeros(STATE_SIZE)
    fresh_state(make_model(rig, places[0][1], places[0][0]), 0.0, state)
    for first in range(0, n, CHUNK):
        part = slice(first, min(first + CHUNK, n))
        done = first + follow(
            plant, stiffnesses[part], drives[part], state, wait, patience, out[part], tangents[part], peaks[part]
        )
        if done < part.stop:
            make_model(rig, places[done][1], places[done][0])  # says what is wrong with this rig and rock
        move(part.stop - part.start)
    points = np.zeros(n, SWEEP_POINT)
    points["value"] = values
    found = as_survey(out, tangents, drives[:, 0])
    for name in SURVEY.names or ():
        points[name] = found[name]
    points["peaks"] = np.isfinite(peaks[:, 0]).sum(axis=1)
    points["peak_forces"], points["peak_accelerations"] = peaks[:, 0], peaks[:, 1]
    return points


def _run_with(
    setting: Setting,
    rock: Rock,
    rig: Rig,
    effects: tuple[Chosen, ...],
    over: str,
    values: np.ndarray,
    wait: int,
    patience: int,
    move: Callable[[int], object],
) -> np.ndarray:
    """As :func:`_run`, with effects."""
    points = np.zeros(len(values), SWEEP_POINT)
    place = None
    for point, value in zip(points, values.tolist(), strict=True):
        section = motion_hybrid.Section(*place_at(setting, rock, over, value), rig, effects)
        found = motion_hybrid.settle_on(section, place or section.fresh(), wait, patience)
        place = found.place
        point["value"] = value
        for name in SURVEY.names or ():
            point[name] = _field(found, name)
        forces, decelerations = motion_hybrid.peaks(section, found, MOST_PEAKS)
        point["peaks"] = forces.size
        point["peak_forces"], point["peak_accelerations"] = _padded(forces), _padded(decelerations)
        move(1)
    return points


def _field(found: motion_hybrid.Settled, name: str) -> Any:
    """What SURVEY calls so."""
    return found.multipliers[:4] if name == "multipliers" else getattr(found, name)


def _padded(values: np.ndarray) -> np.ndarray:
    """(MOST_PEAKS,) values, NaN behind them."""
    return np.concatenate([values, np.full(MOST_PEAKS - values.size, np.nan)])


@contextmanager
def _bar(shown: bool, total: int):
    """Something to call with the number of points done."""
    if not shown:
        yield lambda _points: None
        return
    from tqdm import tqdm

    with tqdm(total=total, unit="point") as bar:
        yield bar.update


_CSV_FIELDS = (
    "period",
    "impacts",
    "contacts",
    "penetration_rate",
    "peak_force",
    "impact_speed",
    "stable",
    "exponent",
)
_CSV_COLUMNS = (
    "direction",
    "frequency_Hz",
    "amplitude_V",
    "pressure_bar",
    "loading_stiffness_N_m",
    "unloading_stiffness_N_m",
    "label",
    "period",
    "impacts",
    "contacts",
    "penetration_rate_m_s",
    "peak_force_N",
    "impact_speed_m_s",
    "stable",
    "exponent_1_s",
    "largest_multiplier",
    "force_peaks_N",
    "acceleration_peaks_m_s2",
)

# Okabe and Ito's colours, told apart by everyone, for the labels met most; the rest is grey, chaos black.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7F3C8D", "#A5AA00")
_OTHER, _CHAOTIC = "#9A9A9A", "#000000"


def _colours(result: Sweep) -> dict[str, str]:
    """A colour for each label met often, in the order in which they are met; "chaotic" and "other" where needed."""
    met = np.concatenate([result.labels(direction) for direction in result.directions])
    names, first, times = np.unique(met, return_index=True, return_counts=True)
    orbits = [i for i in np.argsort(-times, kind="stable") if names[i] not in ("chaotic", "aperiodic")]
    chosen = sorted(orbits[: len(_COLOURS)], key=lambda i: first[i])
    colours = {str(names[i]): colour for i, colour in zip(chosen, _COLOURS, strict=False)}
    if len(chosen) < len(names) - ("chaotic" in names):
        colours["other"] = _OTHER
    if "chaotic" in names:
        colours["chaotic"] = _CHAOTIC
    return colours


def _diagram(result: Sweep, kind: str) -> Any:
    """The figure of ``Sweep.plot``."""
    from matplotlib.figure import Figure

    colours = _colours(result)
    scale, unit, word = (1e-3, "km/s²", "|acceleration|") if kind == "acceleration" else (1e-3, "kN", "force")
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    strip, above, below = figure.subplots(
        3, 1, sharex=True, height_ratios=[0.14 * len(result.directions), 3.0, 1.4], gridspec_kw={"hspace": 0.04}
    )
    axis = result.values * (1e-6 if result.over == "stiffness" else 1.0)
    # rings first, so that dots lie in them
    for direction in reversed(result.directions):
        points = result.points(direction)
        shades = np.array([colours.get(str(name), _OTHER) for name in result.labels(direction)])
        _strip_row(strip, axis, shades, result.directions.index(direction))
        peaks = points[f"peak_{kind}s"] * scale
        rows, columns = np.nonzero(np.isfinite(peaks))
        _marks(above, axis[rows], peaks[rows, columns], shades[rows], direction)
        _marks(below, axis, 1e3 * points["penetration_rate"], shades, direction)
    strip.set_ylim(len(result.directions) - 0.5, -0.5)
    strip.set_yticks(range(len(result.directions)), [{"up": "up →", "down": "down ←"}[d] for d in result.directions])
    strip.tick_params(length=0)
    strip.spines[:].set_visible(False)
    above.set_ylabel(f"impact peaks of {word} [{unit}]")
    below.set_ylabel("penetration [mm/s]")
    below.set_xlabel(f"{result.over} [{'kN/mm' if result.over == 'stiffness' else CONTROLS[result.over][2]}]")
    below.set_xlim(axis[0], axis[-1])
    for panel in (above, below):
        panel.set_ylim(bottom=0.0)
        panel.grid(alpha=0.25, linewidth=0.5)
    _legend(figure, result, colours)
    figure.suptitle(_title(result), fontsize=10)
    return figure


def _strip_row(panel: Any, axis: np.ndarray, shades: np.ndarray, row: int) -> None:
    """The motions of one direction as a bar of colours."""
    edges = np.concatenate([[axis[0]], 0.5 * (axis[1:] + axis[:-1]), [axis[-1]]])
    changes = np.flatnonzero(shades[1:] != shades[:-1]) + 1
    firsts = np.concatenate([[0], changes])
    lasts = np.concatenate([changes, [len(axis)]])
    panel.barh(
        np.full(len(firsts), row), edges[lasts] - edges[firsts], left=edges[firsts], height=0.8, color=shades[firsts]
    )


def _marks(panel: Any, x: np.ndarray, y: np.ndarray, shades: np.ndarray, direction: str) -> None:
    """Dots for the way up, rings for the way down."""
    if direction == "up":
        panel.scatter(x, y, s=2.5, c=shades, linewidths=0, rasterized=True)
    else:
        panel.scatter(x, y, s=11, facecolors="none", edgecolors=shades, linewidths=0.45, alpha=0.6, rasterized=True)


def _legend(figure: Any, result: Sweep, colours: dict[str, str]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], linestyle="", marker="s", color=shade, label=name) for name, shade in colours.items()]
    looks = {
        "up": {"markersize": 3, "color": "0.3"},
        "down": {"markersize": 5, "color": "0.3", "markerfacecolor": "none"},
    }
    for direction in result.directions:
        handles.append(Line2D([], [], linestyle="", marker="o", label=f"on the way {direction}", **looks[direction]))
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=8)


def _title(result: Sweep) -> str:
    controls = {
        "frequency": f"{result.setting.frequency:g} Hz",
        "amplitude": f"{result.setting.amplitude:g} V",
        "pressure": f"{result.setting.pressure:g} bar",
    }
    controls.pop(result.over, None)
    return ", ".join([result.rock.name, *controls.values(), *(f"with {each.effect.name}" for each in result.effects)])
