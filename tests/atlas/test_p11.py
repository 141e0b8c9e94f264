"""The P-1-I-1 atlas against plain simulation, and its file."""

import sys

import numpy as np
import pytest
import xarray

from drillenv.atlas import p11
from drillenv.atlas.p11 import atlas, load_atlas
from drillenv.atlas.p11_figures import plot_atlas
from drillenv.checks import InputError
from drillenv.dynamics.exact import (
    CONTACTS,
    IMPACTS,
    ORIGIN,
    PEAK_FORCE,
    PEAK_SPEED,
    STATE_SIZE,
    TALLY_SIZE,
    advance_period,
    fresh_state,
    make_scratch,
)
from drillenv.dynamics.flow import make_model
from drillenv.dynamics.orbits import M_IMPACTS, MOTION_SIZE, PERIOD, find_motion
from drillenv.rig import Rig, Setting
from drillenv.rocks import rock as rock_of

pytestmark = pytest.mark.slow  # most need an atlas
# around the fold of case 4 and the second contact of case 1
AXES = {"frequency": [86.0, 110.0, 120.0], "amplitude": [0.36, 0.45, 0.6], "pressure": [0.8, 1.0, 1.25]}
CASES = [1, 4]


@pytest.fixture(scope="module")
def small():
    return atlas(CASES, **AXES, starts=3, seed=5)


def model_at(case, frequency, amplitude, pressure):
    return make_model(Rig(), rock_of(case), Setting(float(frequency), float(amplitude), float(pressure)))


def run(model, state, periods):
    tally, scratch = np.zeros(TALLY_SIZE), make_scratch()
    for _ in range(periods):
        advance_period(model, state, tally, scratch)
    return tally


def fresh(model):
    state = np.zeros(STATE_SIZE)
    fresh_state(model, 0.0, state)
    return state


def points_of(dataset):
    for r, case in enumerate(dataset["rock"].values):
        for index in np.ndindex(*(dataset.sizes[axis] for axis in p11.AXES)):
            setting = [float(dataset[axis][i]) for axis, i in zip(p11.AXES, index, strict=True)]
            yield int(case), setting, dataset.isel(rock=r, **dict(zip(p11.AXES, index, strict=True)))


def test_the_grid_has_both_sides(small):
    assert 0.2 < float(small["exists"].mean()) < 0.8
    assert {p11.FOLD, p11.GRAZING} <= set(small["boundary_kind"].values.tolist())


def test_plain_simulation_from_a_fresh_start_shows_what_the_atlas_says(small):
    """4000 periods waited, 100 watched, nothing solved for."""
    compared = 0
    for case, (frequency, amplitude, pressure), point in points_of(small):
        model = model_at(case, frequency, amplitude, pressure)
        state = fresh(model)
        run(model, state, 4000)
        before, origin = state[:4].copy(), state[ORIGIN]
        tally = run(model, state, 1)
        once = np.abs(state[:4] - before).max() < 1e-9
        single = once and tally[IMPACTS] == 1 and tally[CONTACTS] == 1
        if single:
            assert point["exists"]
            assert point["penetration_rate"] == pytest.approx((state[ORIGIN] - origin) * frequency, rel=1e-7)
            assert point["peak_force"] == pytest.approx(tally[PEAK_FORCE], rel=1e-8)
            assert point["impact_speed"] == pytest.approx(tally[PEAK_SPEED], rel=1e-8)
            compared += 1
        else:
            assert not point["only"]
        assert (point["label_fresh"].values.tolist() == [1, 1]) == single
    assert compared > 10


def test_fresh_labels_are_those_of_find_motion(small):
    for case, setting, point in points_of(small):
        model, out = model_at(case, *setting), np.zeros(MOTION_SIZE)
        find_motion(model, fresh(model), 200, 4000, out, np.zeros((4, 4)))
        expected = [int(out[PERIOD]), int(out[M_IMPACTS])] if out[PERIOD] else [0, 0]
        assert point["label_fresh"].values.tolist() == expected


def test_largest_multiplier_against_finite_differences(small):
    for case, setting, point in points_of(small):
        if not point["only"]:
            continue
        model = model_at(case, *setting)
        state = fresh(model)
        run(model, state, 4000)
        jacobian = np.zeros((4, 4))
        for column in range(4):
            step = 1e-7 * max(abs(state[column]), 1e-3)
            ends = []
            for sign in (1, -1):
                moved = state.copy()
                moved[column] += sign * step
                run(model, moved, 1)
                ends.append(moved[:4])
            jacobian[:, column] = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(np.linalg.eigvals(jacobian)).max() == pytest.approx(float(point["largest_multiplier"]), rel=1e-4)


def test_nothing_is_said_where_it_does_not_exist(small):
    outside = ~small["exists"].values
    for name in ("penetration_rate", "peak_force", "impact_speed", "largest_multiplier"):
        assert np.isnan(small[name].values[outside]).all()
        assert np.isfinite(small[name].values[~outside]).all()
    assert (small["largest_multiplier"].values[~outside] < 1).all()
    assert not (small["only"] & ~small["exists"]).any()
    assert (small["share"].values[small["only"].values] == 1).all()


def boundary_setting(dataset, i):
    return np.array([float(dataset[f"boundary_{axis}"][i]) for axis in p11.AXES])


def test_boundaries_by_plain_simulation_on_either_side(small):
    """A slow sweep from the grid point to 1e-4 before the boundary keeps P-1-I-1; 1e-4 beyond it is lost."""
    for i in range(small.sizes["boundary_point"]):
        case = int(small["rock"][int(small["boundary_rock"][i])])
        axis, side = int(small["boundary_axis"][i]), int(small["boundary_side"][i])
        there = boundary_setting(small, i)
        values = small[p11.AXES[axis]].values
        start = there.copy()
        start[axis] = values[values < there[axis]].max() if side < 0 else values[values > there[axis]].min()
        state = None
        # ever smaller steps: the basin shrinks with the distance to a fold
        for left in np.geomspace(1, 1e-4 * there[axis] / abs(start[axis] - there[axis]), 30):
            model = model_at(case, *(there + left * (start - there)))
            state = fresh(model) if state is None else state
            run(model, state, 400)
        tally = run(model, state, 200)
        assert (tally[IMPACTS], tally[CONTACTS]) == (200, 200)
        there[axis] *= 1 - side * 1e-4
        model = model_at(case, *there)
        run(model, state, 3000)
        tally = run(model, state, 1000)
        assert tally[IMPACTS] > 1000 or tally[CONTACTS] != 1000
        if small["boundary_kind"][i] == p11.GRAZING:
            assert tally[IMPACTS] == 1000 * int(small["boundary_impacts"][i])
            assert tally[CONTACTS] == 1000 * int(small["boundary_contacts"][i])


def test_one_boundary_has_one_kind(small):
    """Wherever the same crossing is met, along amplitude or pressure, it is the same event."""
    ratio = small["boundary_pressure"].values / small["boundary_amplitude"].values
    rock, frequency, kind = (small[f"boundary_{name}"].values for name in ("rock", "frequency", "kind"))
    for i in range(kind.size):
        same = (rock == rock[i]) & (frequency == frequency[i]) & (np.abs(ratio / ratio[i] - 1) < 1e-5)
        assert np.unique(kind[same]).size == 1


def test_every_edge_between_in_and_out_has_its_boundary_point(small):
    exists = small["exists"].values
    edges = sum(int((np.diff(exists.astype(int), axis=axis) != 0).sum()) for axis in (1, 2, 3))
    assert small.sizes["boundary_point"] == edges > 0


def test_the_boundary_depends_on_frequency_and_pressure_over_amplitude_alone(small):
    """With the linear rock law lengths and forces scale together: found along A and along p it is the same ratio."""
    ratio = small["boundary_pressure"].values / small["boundary_amplitude"].values
    compared = 0
    for r in range(len(CASES)):
        for frequency in AXES["frequency"]:
            here = (small["boundary_rock"].values == r) & (small["boundary_frequency"].values == frequency)
            for kind in (p11.FOLD, p11.GRAZING):
                alike = ratio[here & (small["boundary_kind"].values == kind)]
                if alike.size > 1:
                    assert np.ptp(alike) < 3e-6 * alike.mean()
                    compared += 1
    assert compared >= 3


def test_existence_does_not_hang_on_starts():
    """Following from one grid point alone finds the whole region and the same orbits."""
    grid = p11._grid(4, (AXES["frequency"], AXES["amplitude"], AXES["pressure"]), Rig())
    with p11.tile_workers() as mapper:
        _, _, everywhere = p11._settle(grid, 2, 1, mapper, False)
        alone = p11.Orbits(*(column.copy() for column in everywhere))
        alone.exists[:] = False
        alone.exists[np.flatnonzero(everywhere.exists)[0]] = True
        for column in alone[1:]:
            column[~alone.exists] = 0.0
        p11._spread(grid, everywhere, mapper, False)
        p11._spread(grid, alone, mapper, False)
    assert (alone.exists == everywhere.exists).all()
    np.testing.assert_allclose(alone.points, everywhere.points, rtol=1e-8, atol=1e-12)


def test_tiles_workers_and_other_rocks_change_nothing(small, monkeypatch):
    monkeypatch.setattr(p11, "TILE_POINTS", 5)
    monkeypatch.setattr(p11, "TILE_EDGES", 3)
    xarray.testing.assert_identical(atlas(CASES, **AXES, starts=3, seed=5, workers=3), small)
    alone = atlas(4, **AXES, starts=3, seed=5, workers=1)
    for name in p11.VARIABLES:
        if not name.startswith("boundary"):
            np.testing.assert_array_equal(alone[name].values[0], small[name].values[1])


def test_the_seed_moves_the_starts_only(small):
    other = atlas(CASES, **AXES, starts=3, seed=6)
    for name in ("exists", "label_fresh"):
        np.testing.assert_array_equal(other[name], small[name])
    grid = p11._grid(4, ([100.0], [0.45], [1.0]), Rig())
    first, second, again = (p11.settle_tile(grid.plants[0], grid.drives, 50, seed, 0)[1:3] for seed in (1, 2, 1))
    np.testing.assert_array_equal(first[1], again[1])
    assert first[0] == again[0] and second[0] >= 0


def test_a_single_setting_and_no_p11_anywhere():
    dataset = atlas(4, 70.0, 0.45, 1.0, starts=1)
    assert not dataset["exists"].any()
    assert dataset["label_fresh"].values.ravel().tolist() == [1, 3]
    assert dataset.sizes["boundary_point"] == 0


def test_file_round_trip(small, tmp_path):
    path = tmp_path / "atlas.nc"
    made = atlas(CASES, **AXES, starts=3, seed=5, out=path)
    xarray.testing.assert_identical(made, small)
    read = load_atlas(path)
    xarray.testing.assert_equal(read, made)
    assert read["exists"].dtype == bool
    for name, (_, unit, meaning) in p11.VARIABLES.items():
        assert (read[name].attrs["units"], read[name].attrs["long_name"]) == (unit, meaning)
    assert read["frequency"].attrs["units"] == "Hz"
    assert (
        read.attrs["seed"] == 5 and read.attrs["format"] == p11.FORMAT and read.attrs["rig_stiffness_N_per_m"] == 68850
    )
    assert [p.name for p in tmp_path.iterdir()] == ["atlas.nc"]


def test_an_atlas_without_boundary_can_be_written(tmp_path):
    atlas(4, 70.0, 0.45, 1.0, starts=1, out=tmp_path / "one.nc")
    assert load_atlas(tmp_path / "one.nc").sizes["boundary_point"] == 0


def test_a_failing_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "atlas.nc"
    path.write_text("old")

    def fail(self, file, **_):
        with open(file, "w") as half:
            half.write("half")
        raise OSError("disk full")

    monkeypatch.setattr(xarray.Dataset, "to_netcdf", fail)
    with pytest.raises(InputError, match="disk full"):
        atlas(4, 70.0, 0.45, 1.0, starts=1, out=path)
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def one_line(caught):
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_foreign_files(small, tmp_path):
    path = tmp_path / "file.nc"
    with pytest.raises(InputError, match="no file") as caught:
        load_atlas(path)
    one_line(caught)
    path.write_text("not NetCDF\nat all")
    with pytest.raises(InputError, match="cannot be read") as caught:
        load_atlas(path)
    one_line(caught)
    xarray.Dataset({"a": ("x", [1.0])}).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match="no P-1-I-1 atlas"):
        load_atlas(path)
    small.drop_vars("share").to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match="lacks share"):
        load_atlas(path)
    small.assign_attrs(format_version=99).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match="version 99"):
        load_atlas(path)
    small.to_netcdf(path, engine="h5netcdf")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="cannot be read") as caught:
        load_atlas(path)
    one_line(caught)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"frequency": []}, "frequency"),
        ({"amplitude": "x"}, "amplitude"),
        ({"pressure": None}, "pressure"),
        ({"frequency": [50.0, 5000.0]}, "5000 Hz"),
        ({"amplitude": [450.0]}, "mV"),
        ({"pressure": [1.0, np.nan]}, "finite"),
        ({"frequency": [100.0, 90.0]}, "increasing"),
        ({"frequency": [100.0, 100.0]}, "increasing"),
        ({"rocks": 7}, "rock is 7"),
        ({"rocks": []}, "at least one rock"),
        ({"rocks": [4, "4"]}, "each once"),
        ({"rocks": "granite"}, "granite"),
        ({"starts": 0}, "starts"),
        ({"starts": 2.5}, "starts"),
        ({"seed": -1}, "seed"),
        ({"seed": None}, "seed"),
        ({"rig": 3}, "rig"),
        ({"out": "/no/such/folder/atlas.nc"}, "/no/such/folder/atlas.nc"),
        ({"out": "."}, "folder"),
        ({"out": 5}, "5"),
        ({"workers": 0}, "workers"),
        ({"cluster": 7}, "cluster"),
    ],
)
def test_bad_input_is_refused_before_any_work(given, said, monkeypatch):
    def work(*_):
        raise AssertionError("work was begun")

    monkeypatch.setattr(p11, "_settle", work)
    with pytest.raises(InputError) as caught:
        atlas(**{"rocks": 4, **AXES, **given})
    assert said in one_line(caught)


def test_ray_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"drillenv\[cluster\]") as caught:
        atlas(4, **AXES, cluster="local")
    one_line(caught)


def test_ray_gives_the_same(small):
    pytest.importorskip("ray")
    xarray.testing.assert_identical(atlas(CASES, **AXES, starts=3, seed=5, cluster="local"), small)


@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "127.0.0.1:x", "127.0.0.1:99999", "nonsense"])
def test_no_ray_cluster_at_the_address(address):
    pytest.importorskip("ray")
    with pytest.raises(InputError, match="no Ray cluster answers") as caught:
        atlas(4, **AXES, cluster=address)
    one_line(caught)


def test_pictures(small, tmp_path):
    files = plot_atlas(small, tmp_path / "atlas.png")
    assert [file.name for file in files] == ["atlas.png", "atlas_surface.png", "atlas_ratio.png"]
    assert all(file.read_bytes().startswith(b"\x89PNG") and file.stat().st_size > 10_000 for file in files)
    assert len(list(tmp_path.iterdir())) == 3
    for bad in ("atlas.xyz", "none/atlas.png"):
        with pytest.raises(InputError):
            plot_atlas(small, tmp_path / bad)


def test_pictures_of_a_single_setting(tmp_path):
    assert len(plot_atlas(atlas(4, 70.0, 0.45, 1.0, starts=1), tmp_path / "one.png")) == 3
