"""The atlas of P-1-I-1: where in (frequency, amplitude, pressure) the motion with the strongest impacts exists.

The paper leaves "the boundary of P-1-I-1 in (f, A, p)" to the future. Here it is followed, not looked for by chance:
wherever any start settles on P-1-I-1 the orbit is continued by Newton's method on the stroboscopic map to all
neighbouring settings, from there to theirs, and so on. Where that ends the boundary is located on the edge between two
grid points.

With the linear rock law (n_l = n_u = 1) lengths and forces scale together, so that at a given frequency the motion
depends on F_b / F_a alone: the boundary is a fan of straight lines p = A g(f). The atlas does not use it but shows it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drillenv.atlas.p11_kernels import (
    ANOTHER_LABEL,
    DRAWS,
    IS_P11,
    PATIENCE,
    follow_edges,
    settle_points,
)
from drillenv.atlas.tiles import Mapper, tile_workers
from drillenv.checks import InputError, count, shown
from drillenv.dynamics.flow import make_model
from drillenv.dynamics.orbits import ADVANCE, M_FORCE, M_SPEED, MOTION_SIZE
from drillenv.files import check_writable, whole
from drillenv.rig import AMPLITUDE_RANGE, FREQUENCY_RANGE, PRESSURE_RANGE, Rig, Setting
from drillenv.rocks import ROCKS, Rock
from drillenv.rocks import rock as rock_of

if TYPE_CHECKING:
    import xarray

FORMAT = "drillenv-p11-atlas"
FORMAT_VERSION = 1

FREQUENCIES = np.linspace(*FREQUENCY_RANGE, 36)  # Hz
AMPLITUDES = np.linspace(*AMPLITUDE_RANGE, 13)  # V
PRESSURES = np.linspace(*PRESSURE_RANGE, 13)  # bar
"""The default grid: the box of Table 2.1 in steps of 2 Hz, 0.025 V and 0.1 bar."""

AXES = ("frequency", "amplitude", "pressure")
GRID = ("rock", *AXES)

PERIOD_DOUBLING, FOLD, GRAZING, NEIMARK_SACKER = range(4)
KINDS = ("period doubling", "fold", "another impact or contact", "Neimark-Sacker")
"""How P-1-I-1 ends: a multiplier leaves the unit circle at -1, at +1, as a complex pair; or another impact or contact
appears (or the contact is never left any more) while the orbit goes on."""

PRECISION = 1e-6
"""Boundaries are located to this share of the frequency, amplitude or pressure."""

MOST_POINTS, MOST_STARTS = 10_000_000, 10_000

TILE_POINTS, TILE_EDGES = 48, 256
"""Grid points and edges in a tile. What comes out does not depend on them."""

UNITS = {"frequency": "Hz", "amplitude": "V", "pressure": "bar"}

# name: dimensions, unit, what it is
VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "exists": (GRID, "1", "a stable P-1-I-1 orbit exists"),
    "only": (GRID, "1", "P-1-I-1 exists and every start tried settles on it"),
    "share": (GRID, "1", "share of the starts tried (fresh and random) that settle on P-1-I-1"),
    "penetration_rate": (GRID, "m/s", "penetration rate on P-1-I-1"),
    "peak_force": (GRID, "N", "largest contact force on P-1-I-1"),
    "impact_speed": (GRID, "m/s", "speed of the indenter at contact on P-1-I-1"),
    "largest_multiplier": (GRID, "1", "largest modulus of the Floquet multipliers of P-1-I-1"),
    "label_fresh": (
        (*GRID, "label"),
        "1",
        "period and impacts of the motion from a fresh start; 0, 0 where it is not periodic",
    ),
    "boundary_rock": (("boundary_point",), "1", "position on the rock axis"),
    "boundary_frequency": (("boundary_point",), "Hz", "frequency on the boundary"),
    "boundary_amplitude": (("boundary_point",), "V", "amplitude on the boundary"),
    "boundary_pressure": (("boundary_point",), "bar", "pressure on the boundary"),
    "boundary_axis": (("boundary_point",), "1", "axis of the edge: 0 frequency, 1 amplitude, 2 pressure"),
    "boundary_side": (("boundary_point",), "1", "where P-1-I-1 is: -1 below, +1 above the boundary on that axis"),
    "boundary_kind": (("boundary_point",), "1", "; ".join(f"{number} {kind}" for number, kind in enumerate(KINDS))),
    "boundary_impacts": (("boundary_point",), "1", "impacts of the orbit just beyond, 0 where it does not go on"),
    "boundary_contacts": (("boundary_point",), "1", "contacts of the orbit just beyond"),
    "boundary_multiplier_real": (("boundary_point",), "1", "real part of the multiplier nearest the unit circle"),
    "boundary_multiplier_imaginary": (("boundary_point",), "1", "its imaginary part, not negative"),
}


class Grid(NamedTuple):
    """The settings of an atlas, and the rig on its rocks. Points are numbered pressure first, rock last."""

    rocks: tuple[Rock, ...]
    axes: tuple[np.ndarray, np.ndarray, np.ndarray]
    plants: np.ndarray
    """(rocks, *MODEL_SHAPE)"""
    drives: np.ndarray
    """(settings, 3) omega in rad/s, F_a and F_b in N, the same for each rock."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along rock, frequency, amplitude and pressure."""
        return (len(self.rocks), *(axis.size for axis in self.axes))


class Orbits(NamedTuple):
    """What is known of P-1-I-1 at each of n grid points."""

    exists: np.ndarray
    """(n,) bool"""
    points: np.ndarray
    """(n, 4) on the section"""
    tangents: np.ndarray
    """(n, 4, 4) monodromy matrices"""
    motions: np.ndarray
    """(n, MOTION_SIZE)"""


class Edges(NamedTuple):
    """Edges of the grid along which P-1-I-1 was followed, each from ``here`` towards ``there``."""

    here: np.ndarray
    there: np.ndarray
    axis: np.ndarray
    ends: np.ndarray
    """(n, 5) as follow returns them, shares and steps in terms of the edge"""
    tangents: np.ndarray
    """(n, 4, 4) monodromy matrices of the last orbit on the way"""


def atlas(
    rocks: Any = "all",
    frequency: float | Iterable[float] = FREQUENCIES,
    amplitude: float | Iterable[float] = AMPLITUDES,
    pressure: float | Iterable[float] = PRESSURES,
    starts: int = 12,
    seed: int = 0,
    rig: Rig | None = None,
    progress: bool = False,
    cluster: str | None = None,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
) -> xarray.Dataset:
    """Where P-1-I-1 exists, where it is the only motion, what it does there, and where and how it ends.

    Existence does not hang on lucky starts: from each grid point where one settles on P-1-I-1 the orbit is followed to
    all neighbouring points, step by step, until there are no more. A region in which no start at any grid point finds
    it, or that lies between grid points, is not seen.

    Args:
        rocks: "all", or one or a list of what :func:`drillenv.rocks.rock` takes.
        frequency, amplitude, pressure: Increasing values, or one, in Hz, V and bar; by default the box of Table 2.1.
        starts: Random starts at each point, beside the fresh one (1 to 10,000). They are drawn as
            :func:`drillenv.atlas.p11_kernels.random_start` says.
        seed: Of the random starts, 0 or larger. What a point draws depends on the seed and the point's place alone.
        rig: The rig of the paper where not given.
        progress: Show a bar on stderr.
        cluster: Address of a Ray cluster to work on, or "local"; threads on this machine where not given.
        out: NetCDF file to write, whole or not at all.
        workers: Threads, one a core where not given. The result is the same for any number.

    Returns:
        Dataset on (rock, frequency, amplitude, pressure) of exists, only, share, penetration_rate in m/s, peak_force in
        N, impact_speed in m/s, largest_multiplier (modulus; these four NaN where there is no P-1-I-1), label_fresh
        (period and impacts); and on boundary_point, boundary_rock (position on the rock axis), boundary_frequency,
        boundary_amplitude, boundary_pressure, boundary_kind (0 period doubling, 1 fold, 2 another impact or contact,
        3 Neimark-Sacker), the multiplier nearest the unit circle, impacts and contacts of the orbit just beyond (0
        where it does not go on), and the axis along which the boundary was located, to 1e-6.

    Raises:
        InputError: a value is of the wrong kind or outside its limits, Ray or its cluster is missing, or ``out``
            cannot be written; before any work is done.
    """
    grid = _grid(rocks, (frequency, amplitude, pressure), Rig() if rig is None else rig)
    starts, seed = count("starts", starts, 1, MOST_STARTS), count("seed", seed, 0, 2**53)
    if out is not None:
        check_writable(out)
    with tile_workers(cluster, workers) as mapper:
        labels, hits, orbits = _settle(grid, starts, seed, mapper, progress)
        edges = _spread(grid, orbits, mapper, progress)
    dataset = _dataset(grid, labels, hits / (1.0 + starts), orbits, edges)
    dataset.attrs |= _origin(grid, Rig() if rig is None else rig, starts, seed)
    if out is not None:
        with whole(out) as file:
            packed = {"zlib": True, "complevel": 5, "shuffle": True}
            # nothing packs an empty array
            encoding = {name: packed for name, column in dataset.data_vars.items() if column.size}
            dataset.to_netcdf(file, engine="h5netcdf", encoding=encoding)
    return dataset


def load_atlas(path: str | os.PathLike[str]) -> xarray.Dataset:
    """Read an atlas that :func:`atlas` has written.

    Raises:
        InputError: there is no such file, it is no atlas, of another version, or something is missing in it.
    """
    import xarray

    name = shown(os.fspath(path))
    if not Path(path).is_file():
        raise InputError(f"there is no file {name}: give the path of an atlas, written by drillenv atlas")
    try:
        dataset = xarray.load_dataset(path, engine="h5netcdf")
    except Exception as error:  # what a broken file raises depends on where it is broken
        reason = shown(str(error).partition("\n")[0])
        raise InputError(
            f"{name} cannot be read as NetCDF ({reason}): give an atlas written by drillenv atlas"
        ) from None
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(f"{name} is no P-1-I-1 atlas: give a file written by drillenv atlas")
    found = dataset.attrs.get("format_version")
    if found != FORMAT_VERSION:
        raise InputError(f"{name} is an atlas of version {found}, this drillenv reads {FORMAT_VERSION}: make it again")
    missing = [name for name in (*GRID, "rock_name") if name not in dataset.coords]
    missing += [name for name, (dims, *_) in VARIABLES.items() if name not in dataset or dataset[name].dims != dims]
    if missing:
        raise InputError(f"{name} lacks {', '.join(missing)}: make the atlas again")
    return dataset


def _grid(rocks: Any, axes: Sequence[Any], rig: Rig) -> Grid:
    """The grid that the user asks for."""
    if not isinstance(rig, Rig):
        raise InputError(f"rig is {shown(rig)}: give a drillenv Rig, or leave it out")
    chosen = _rocks(rocks)
    values = tuple(_axis(name, axis) for name, axis in zip(AXES, axes, strict=True))
    shape = (len(chosen), *(axis.size for axis in values))
    if np.prod(shape, dtype=float) > MOST_POINTS:
        raise InputError(f"the grid has {' x '.join(map(str, shape))} points, more than {MOST_POINTS}: make it coarser")
    settings = [Setting(f, a, p) for f in values[0] for a in values[1] for p in values[2]]
    plants = np.stack([make_model(rig, rock, settings[0]) for rock in chosen])
    drives = np.array([(2 * np.pi * s.frequency, rig.drive_force(s), rig.static_force(s)) for s in settings])
    return Grid(chosen, (values[0], values[1], values[2]), plants, drives)


def _rocks(rocks: Any) -> tuple[Rock, ...]:
    """The rocks meant."""
    if isinstance(rocks, str) and rocks.strip().lower() == "all":
        return tuple(ROCKS.values())
    listed = list(rocks) if isinstance(rocks, list | tuple | np.ndarray) else [rocks]
    chosen = tuple(rock_of(one) for one in listed)
    if not chosen or len(set(chosen)) < len(chosen):
        raise InputError(f'rocks is {shown(rocks)}: give at least one rock, each once, or "all"')
    return chosen


def _axis(name: str, values: Any) -> np.ndarray:
    """The values of one axis, each allowed as a Setting, increasing."""
    try:
        listed = [values] if np.ndim(values) == 0 else list(values)
    except (TypeError, ValueError):
        listed = []
    if not listed:
        raise InputError(f"{name} is {shown(values)}: give at least one value in {UNITS[name]}, in increasing order")
    usual = {"frequency": 100.0, "amplitude": 0.45, "pressure": 1.0}
    axis = np.array([getattr(Setting(**{**usual, name: value}), name) for value in listed])
    if np.any(np.diff(axis) <= 0):
        raise InputError(f"{name} is {shown(listed)}: give values in {UNITS[name]} in increasing order, each once")
    return axis


def _settle(grid: Grid, starts: int, seed: int, mapper: Mapper, progress: bool):
    """Try the starts everywhere: (n, 2) labels of the fresh one, (n,) hits, and the orbits they settle on."""
    tiles = []
    for rock in range(len(grid.rocks)):
        for first in range(0, len(grid.drives), TILE_POINTS):
            drives = grid.drives[first : first + TILE_POINTS]
            tiles.append((grid.plants[rock], drives, starts, seed, first))
    points = len(grid.rocks) * len(grid.drives)
    with _bar(progress, points, "starts", "point") as step:
        results = []
        for result in mapper(settle_tile, tiles):
            results.append(result)
            step(len(result[0]))
    labels, hits, *orbits = (np.concatenate(column) for column in zip(*results, strict=True))
    return labels, hits, Orbits(hits > 0, *orbits)


def settle_tile(plant: np.ndarray, drives: np.ndarray, starts: int, seed: int, first: int):
    """Draw and try the starts at the settings ``drives``, numbered from ``first`` on; see settle_points."""
    n = len(drives)
    draws = np.empty((n, starts, DRAWS))
    for i in range(n):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(first + i,)))
        draws[i] = rng.random((starts, DRAWS))
    labels, hits = np.zeros((n, 2), dtype=np.int32), np.zeros(n, dtype=np.int64)
    points, tangents, motions = np.zeros((n, 4)), np.zeros((n, 4, 4)), np.zeros((n, MOTION_SIZE))
    # copies: what comes out of Ray's store cannot be written to, and the kernel is compiled for arrays that can
    settle_points(plant.copy(), drives.copy(), draws, labels, hits, points, tangents, motions)
    return labels, hits, points, tangents, motions


def _spread(grid: Grid, orbits: Orbits, mapper: Mapper, progress: bool) -> Edges:
    """Follow P-1-I-1 from each point that has it to its neighbours, wave by wave; the points reached enter ``orbits``.

    Within a wave nothing depends on the order, so that the result does not depend on who works on what.

    Returns:
        The edges on which P-1-I-1 ends: it exists here, and not there.
    """
    here, there, axis = _directed_edges(grid.shape)
    precision = _edge_precision(grid, here, there, axis)
    tried = np.zeros(here.size, dtype=bool)
    kept: list[Edges] = []
    with _bar(progress, None, "following", "edge") as step:
        while True:
            wave = np.flatnonzero(orbits.exists[here] & ~orbits.exists[there] & ~tried)
            if wave.size == 0:
                break
            tried[wave] = True
            ends, points, tangents, motions = _follow(grid, orbits, here[wave], there[wave], precision[wave], mapper)
            arrived = ends[:, 2] == IS_P11
            # of several ways to a point the first in the order of the edges counts
            reached, winner = np.unique(there[wave[arrived]], return_index=True)
            for known, new in zip(orbits[1:], (points, tangents, motions), strict=True):
                known[reached] = new[arrived][winner]
            orbits.exists[reached] = True
            lost = wave[~arrived]
            kept.append(Edges(here[lost], there[lost], axis[lost], ends[~arrived], tangents[~arrived]))
            step(wave.size)
    if not kept:
        return Edges(here[:0], there[:0], axis[:0], np.zeros((0, 5)), np.zeros((0, 4, 4)))
    edges = Edges(*(np.concatenate(column) for column in zip(*kept, strict=True)))
    # a point that one way does not reach may be reached another way
    order = np.lexsort((edges.there, edges.here))
    order = order[~orbits.exists[edges.there[order]]]
    return Edges(*(column[order] for column in edges))


def _directed_edges(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every pair of neighbours along the three axes of the settings, both ways: (n,) here, (n,) there, (n,) axis."""
    number = np.arange(np.prod(shape)).reshape(shape)
    here, there, along = [], [], []
    for axis in range(3):
        lower = np.take(number, range(shape[axis + 1] - 1), axis=axis + 1).ravel()
        upper = np.take(number, range(1, shape[axis + 1]), axis=axis + 1).ravel()
        here += [lower, upper]
        there += [upper, lower]
        along.append(np.full(2 * lower.size, axis))
    return np.concatenate(here), np.concatenate(there), np.concatenate(along)


def _coordinates(grid: Grid, points: np.ndarray) -> np.ndarray:
    """(n, 3) frequency, amplitude and pressure of grid points."""
    places = np.unravel_index(points, grid.shape)[1:]
    return np.stack([axis[place] for axis, place in zip(grid.axes, places, strict=True)], axis=1)


def _edge_precision(grid: Grid, here: np.ndarray, there: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(n,) PRECISION as a share of each edge."""
    row = np.arange(here.size)
    first, last = _coordinates(grid, here)[row, axis], _coordinates(grid, there)[row, axis]
    return np.minimum(PRECISION * np.minimum(first, last) / np.abs(last - first), 0.5)


def _follow(grid: Grid, orbits: Orbits, here: np.ndarray, there: np.ndarray, precision: np.ndarray, mapper: Mapper):
    """Follow the orbit along edges: (n, 5) ends, (n, 4) points, (n, 4, 4) tangents, (n, MOTION_SIZE) motions."""
    settings = len(grid.drives)
    tiles = []
    for first in range(0, here.size, TILE_EDGES):
        a, b = here[first : first + TILE_EDGES], there[first : first + TILE_EDGES]
        drives = grid.drives[a % settings], grid.drives[b % settings]
        tiles.append((grid.plants, a // settings, *drives, precision[first : first + TILE_EDGES], orbits.points[a]))
    results = list(mapper(follow_tile, tiles))
    return tuple(np.concatenate(column) for column in zip(*results, strict=True))


def follow_tile(
    plants: np.ndarray,
    rocks: np.ndarray,
    here: np.ndarray,
    there: np.ndarray,
    precision: np.ndarray,
    points: np.ndarray,
):
    """Follow the orbits ``points`` along edges; see follow_edges."""
    n = rocks.size
    ends, points = np.zeros((n, 5)), points.copy()
    tangents, motions = np.zeros((n, 4, 4)), np.zeros((n, MOTION_SIZE))
    arrays = (plants.copy(), rocks.copy(), here.copy(), there.copy(), precision.copy())
    follow_edges(*arrays, points, tangents, motions, ends)
    return ends, points, tangents, motions


def _kinds(edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """How P-1-I-1 ends on each edge, and the multiplier nearest the unit circle, from its upper half plane."""
    multipliers = np.linalg.eigvals(edges.tangents).astype(complex)
    nearest = np.argmin(np.abs(np.abs(multipliers) - 1.0), axis=1) if len(multipliers) else np.zeros(0, dtype=int)
    critical = multipliers[np.arange(len(multipliers)), nearest]
    critical = np.real(critical) + 1j * np.abs(np.imag(critical))
    kinds = np.where(np.real(critical) < 0, PERIOD_DOUBLING, FOLD)
    kinds[np.imag(critical) > 0] = NEIMARK_SACKER
    # an orbit that goes on, with another label, has not reached the unit circle
    kinds[edges.ends[:, 2] == ANOTHER_LABEL] = GRAZING
    return kinds, critical


def _dataset(grid: Grid, labels: np.ndarray, share: np.ndarray, orbits: Orbits, edges: Edges) -> xarray.Dataset:
    """Everything as a Dataset."""
    import xarray

    exists = orbits.exists
    largest = np.full(exists.size, np.nan)
    largest[exists] = np.abs(np.linalg.eigvals(orbits.tangents[exists])).max(axis=1) if exists.any() else np.nan
    frequency = _coordinates(grid, np.arange(exists.size))[:, 0]
    kinds, critical = _kinds(edges)
    where = _boundary_settings(grid, edges)
    columns = {
        "exists": exists,
        "only": exists & (share == 1.0),
        "share": share,
        "penetration_rate": np.where(exists, orbits.motions[:, ADVANCE] * frequency, np.nan),
        "peak_force": np.where(exists, orbits.motions[:, M_FORCE], np.nan),
        "impact_speed": np.where(exists, orbits.motions[:, M_SPEED], np.nan),
        "largest_multiplier": largest,
        "label_fresh": labels,
        "boundary_rock": (edges.here // len(grid.drives)).astype(np.int32),
        "boundary_frequency": where[:, 0],
        "boundary_amplitude": where[:, 1],
        "boundary_pressure": where[:, 2],
        "boundary_axis": edges.axis.astype(np.int32),
        "boundary_side": np.where(edges.here < edges.there, -1, 1).astype(np.int32),
        "boundary_kind": kinds.astype(np.int32),
        "boundary_impacts": edges.ends[:, 3].astype(np.int32),
        "boundary_contacts": edges.ends[:, 4].astype(np.int32),
        "boundary_multiplier_real": np.real(critical),
        "boundary_multiplier_imaginary": np.imag(critical),
    }
    data = {}
    for name, (dims, unit, meaning) in VARIABLES.items():
        shape = (*grid.shape, *columns[name].shape[1:]) if dims[0] == "rock" else columns[name].shape
        data[name] = (dims, columns[name].reshape(shape), {"units": unit, "long_name": meaning})
    cases = {rock: case for case, rock in ROCKS.items()}
    axes = zip(AXES, grid.axes, strict=True)
    coordinates: dict[str, Any] = {name: (name, axis, {"units": UNITS[name]}) for name, axis in axes}
    coordinates["rock"] = ("rock", [cases.get(rock, 0) for rock in grid.rocks], {"long_name": "case of Table 2.2"})
    coordinates["rock_name"] = ("rock", [rock.name for rock in grid.rocks], {})
    for name in ("loading_stiffness", "unloading_stiffness"):
        coordinates[name] = ("rock", [getattr(rock, name) for rock in grid.rocks], {"units": "N/m"})
    coordinates["label"] = ("label", ["period", "impacts"], {})
    return xarray.Dataset(data, coordinates)


def _boundary_settings(grid: Grid, edges: Edges) -> np.ndarray:
    """(n, 3) the settings in the middle of the last step, the one that fails."""
    here, there = _coordinates(grid, edges.here), _coordinates(grid, edges.there)
    share = edges.ends[:, 0] + 0.5 * edges.ends[:, 1]
    return here + share[:, None] * (there - here)


def _origin(grid: Grid, rig: Rig, starts: int, seed: int) -> dict[str, Any]:
    """What the atlas is and how it was made."""
    return {
        "title": "P-1-I-1 of the percussive-drilling rig over frequency, amplitude and pressure",
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "drillenv_version": _version(),
        "seed": seed,
        "starts": starts,
        "boundary_precision": PRECISION,
        "rig_shaker_mass_kg": rig.shaker_mass,
        "rig_indenter_mass_kg": rig.indenter_mass,
        "rig_stiffness_N_per_m": rig.stiffness,
        "rig_damping_Ns_per_m": rig.damping,
        "rig_drive_gain": rig.drive_gain,
        "rig_pressure_gain": rig.pressure_gain,
        "method": (
            f"Exact piecewise-linear flow. On {' x '.join(map(str, grid.shape))} points a fresh and {starts} random "
            f"starts, each run until its orbit is found (at most {PATIENCE} periods); P-1-I-1 continued from each "
            "point where one settles on it by Newton's method on the stroboscopic map; boundaries located on the edges."
        ),
    }


def _version() -> str:
    """The version installed."""
    try:
        return version("drillenv")
    except PackageNotFoundError:
        return "unknown, run from its sources"


@contextmanager
def _bar(shown: bool, total: int | None, what: str, unit: str) -> Iterator[Callable[[int], Any]]:
    """A progress bar on stderr, or nothing; calling what it opens moves it on."""
    from tqdm import tqdm

    with tqdm(total=total, desc=what, unit=unit, disable=not shown) as bar:
        yield bar.update
