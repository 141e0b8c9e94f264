"""Sweeps against single motions, hysteresis, peaks against a dense run, and the files they write."""

import csv

import numpy as np
import pytest

from drillenv.atlas import Sweep, sweep
from drillenv.atlas.sweep import MOST_PEAKS
from drillenv.checks import InputError
from drillenv.dynamics.effects import make
from drillenv.dynamics.exact import (
    REGIME,
    STATE_SIZE,
    TALLY_SIZE,
    W,
    acceleration,
    advance,
    fresh_state,
    make_scratch,
)
from drillenv.dynamics.flow import FREE, LOADING, STIFFNESS, make_model
from drillenv.dynamics.motion import motion
from drillenv.rig import Rig, Setting
from drillenv.rocks import rock

CENTRE = Setting(60.0, 0.45, 1.0)


@pytest.fixture(scope="module")
def across() -> Sweep:
    """The range of Fig. 3.2."""
    return sweep(CENTRE, "frequency", 50.0, 120.0, 0.5)


def runs(names: np.ndarray) -> list[str]:
    """Labels in the order in which they are met."""
    return [str(name) for i, name in enumerate(names) if i == 0 or name != names[i - 1]]


def test_order_of_figure_3_2(across):
    met = runs(across.labels("up"))
    published = ["P-1-I-4", "P-1-I-3", "P-1-I-2", "P-2-I-4", "P-2-I-3", "chaotic", "P-1-I-1"]
    assert sorted(published, key=met.index) == published
    assert (met[0], met[-1]) == ("P-1-I-4", "P-1-I-1")
    assert met.index("P-4-I-7") == met.index("P-2-I-3") + 1


def test_values(across):
    assert across.values[0] == 50.0
    assert across.values[-1] == 120.0
    assert len(across.values) == 141
    assert across.directions == ("up", "down")
    np.testing.assert_array_equal(across.points("up")["value"], across.values)
    np.testing.assert_array_equal(across.points("down")["value"], across.values)
    assert sweep(CENTRE, "pressure", 0.6, 1.0, 0.3, direction="up").values.tolist() == [0.6, 0.9]


def test_same_as_single_runs_where_one_motion_exists(across):
    for i in (0, 20, 45, 80, 100, 125, 140):
        setting = Setting(float(across.values[i]), 0.45, 1.0)
        single = motion(setting)
        for way in across.directions:
            found = across.motion(i, way)
            assert found.setting == setting
            assert found.label == single.label
            assert found.penetration_rate == pytest.approx(single.penetration_rate, rel=1e-9)
            assert found.peak_force == pytest.approx(single.peak_force, rel=1e-9)


def test_drive_force_follows_the_frequency(across):
    # Eq. 3.5 at each value, not at the setting handed in
    assert motion(Setting(120, 0.45, 1.0)).peak_force == pytest.approx(across.motion(140, "up").peak_force, rel=1e-9)


def test_hysteresis():
    found = sweep(CENTRE, "frequency", 108.0, 112.0, 0.1)
    i = int(np.argmin(np.abs(found.values - 109.6)))
    assert found.labels("up")[i] == "P-2-I-4"
    assert found.labels("down")[i] == "P-1-I-1"


@pytest.mark.parametrize(("frequency", "case"), [(50.0, 4), (100.0, 4), (120.0, 2)])
def test_peaks_against_a_dense_run(frequency, case):
    point = sweep(CENTRE, "frequency", frequency, frequency + 1, 1.0, case, direction="up").points("up")[0]
    model = make_model(Rig(), rock(case), Setting(frequency, 0.45, 1.0))
    state, tally, scratch = np.zeros(STATE_SIZE), np.zeros(TALLY_SIZE), make_scratch()
    fresh_state(model, 0.0, state)
    advance(model, state, 800 / frequency, tally, scratch)
    samples = 40_000
    forces, accelerations, regimes = np.zeros(samples), np.zeros(samples), np.zeros(samples, int)
    for i in range(samples):
        advance(model, state, float(point["period"]) / frequency / samples, tally, scratch)
        regimes[i] = state[REGIME]
        kappa = 0.0 if regimes[i] == FREE else model[regimes[i], STIFFNESS]
        forces[i] = kappa * state[W]
        accelerations[i] = acceleration(model, state, kappa)
    n = int(point["peaks"])
    assert n == point["impacts"]
    inner = (forces > np.roll(forces, 1)) & (forces >= np.roll(forces, -1)) & (forces > 0)
    np.testing.assert_allclose(np.sort(point["peak_forces"][:n]), np.sort(forces[inner]), rtol=1e-4, atol=0.05)
    # an impact begins where a loading does; start the round in front of one
    begins = (regimes == LOADING) & (np.roll(regimes, 1) != LOADING)
    shift = int(np.argmax(begins))
    impact = np.cumsum(np.roll(begins, -shift))
    contact, decelerations = np.roll(regimes, -shift) != FREE, -np.roll(accelerations, -shift)
    dense = [decelerations[contact & (impact == i)].max() for i in range(1, n + 1)]
    np.testing.assert_allclose(np.sort(point["peak_accelerations"][:n]), np.sort(dense), rtol=1e-4, atol=0.1)
    assert point["peak_accelerations"][:n].max() == pytest.approx(-accelerations.min(), rel=1e-4)
    assert np.isnan(point["peak_forces"][n:]).all()


def test_peaks_of_chaos_fill_the_room():
    point = sweep(CENTRE, "frequency", 105.0, 106.0, 1.0, direction="up").points("up")[0]
    assert point["period"] == 0
    assert point["peaks"] == 64
    assert len(np.unique(np.round(point["peak_forces"], 6))) == 64


def test_size_does_not_depend_on_the_periods_run():
    short = sweep(CENTRE, "frequency", 104.0, 106.0, 0.5, wait=32, patience=100)
    long = sweep(CENTRE, "frequency", 104.0, 106.0, 0.5, wait=2000, patience=20_000)
    assert short.points("up").nbytes == long.points("up").nbytes


def test_stiffness_keeps_the_ratio():
    found = sweep(Setting(100, 0.45, 1.0), "stiffness", 12e6, 32e6, 10e6, 4)
    for i, value in enumerate(found.values):
        each = found.motion(i, "up")
        assert each.rock.loading_stiffness == value
        assert each.rock.unloading_stiffness / value == pytest.approx(25.05 / 21.40, rel=1e-12)
    # Fig. 4.4: period one on soft rock, two, and one again
    assert [found.motion(i, "up").period for i in range(3)] == [1, 2, 1]


def test_one_direction_only():
    found = sweep(CENTRE, "amplitude", 0.3, 0.6, 0.1, direction="down")
    assert found.up is None
    assert found.directions == ("down",)
    with pytest.raises(InputError, match="direction is 'up'"):
        found.points("up")


def test_csv(across, tmp_path):
    path = tmp_path / "sweep.csv"
    across.to_csv(path)
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(across.values)
    assert [row["direction"] for row in rows[:: len(across.values)]] == ["up", "down"]
    for row, point in zip(rows[: len(across.values)], across.points("up"), strict=True):
        assert float(row["frequency_Hz"]) == point["value"]
        assert float(row["amplitude_V"]) == 0.45
        assert float(row["penetration_rate_m_s"]) == point["penetration_rate"]
        assert len(row["force_peaks_N"].split()) == point["peaks"]
        assert len(row["acceleration_peaks_m_s2"].split()) == point["peaks"]
    assert {row["label"] for row in rows} == {*across.labels("up"), *across.labels("down")}
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_plots(across, tmp_path):
    for name, peaks, begins in (("a.png", "acceleration", b"\x89PNG"), ("b.pdf", "force", b"%PDF")):
        across.plot(tmp_path / name, peaks)
        assert (tmp_path / name).read_bytes().startswith(begins)
    assert len(list(tmp_path.iterdir())) == 2
    with pytest.raises(InputError, match=r"end it in \.png"):
        across.plot(tmp_path / "c.bmpx")
    with pytest.raises(InputError, match="peaks is"):
        across.plot(tmp_path / "c.png", "speed")


def test_a_failed_write_leaves_the_old_file(across, tmp_path, monkeypatch):
    path = tmp_path / "sweep.csv"
    path.write_text("old")
    monkeypatch.setattr(Sweep, "_csv_row", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        across.to_csv(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_progress_bar(capsys):
    sweep(CENTRE, "amplitude", 0.3, 0.6, 0.01, progress=True)
    assert "62/62" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"over": "speed"}, "over is 'speed'"),
        ({"start": 120.0, "stop": 50.0}, "give start below stop"),
        ({"start": 5.0}, "start is 5 Hz"),
        ({"step": 0.0}, "step is 0 Hz"),
        ({"step": 500.0}, "step is 500 Hz"),
        ({"step": float("nan")}, "step is nan"),
        ({"direction": "left"}, "direction is 'left'"),
        ({"setting": 4}, "give Setting"),
        ({"over": "stiffness", "start": 10.0, "stop": 30.0}, "start is 10 N/m.*kN/mm"),
        ({"over": "amplitude", "start": 300.0, "stop": 600.0, "step": 1.0}, "start is 300 V.*mV"),
        ({"wait": -1}, "wait is -1"),
    ],
)
def test_bad_input_is_said_in_one_line(arguments, says):
    given = {"setting": CENTRE, "over": "frequency", "start": 50.0, "stop": 60.0, "step": 1.0} | arguments
    with pytest.raises(InputError, match=says) as error:
        sweep(**given)
    assert "\n" not in str(error.value)


# --- With effects


def test_neutral_effects_sweep_the_same():
    """Labels, numbers and peaks of both engines over a change from two impacts to one."""
    setting = Setting(120.0, 0.35, 1.0)
    exact, general = (
        sweep(setting, "amplitude", 0.30, 0.36, 0.02, 2, effects=effects) for effects in ((), [make("contact-rate")])
    )
    assert set(exact.labels("up")) == {"P-1-I-1", "P-1-I-2"}
    for direction in ("up", "down"):
        one, other = exact.points(direction), general.points(direction)
        assert exact.labels(direction).tolist() == general.labels(direction).tolist()
        for name in ("penetration_rate", "peak_force", "impact_speed", "peak_forces"):
            np.testing.assert_allclose(other[name], one[name], rtol=1e-8, err_msg=name)
        for name in ("value", "period", "impacts", "contacts", "stable", "peaks"):
            np.testing.assert_array_equal(other[name], one[name], err_msg=name)
        # samples and a parabola against the closed form
        np.testing.assert_allclose(other["peak_accelerations"], one["peak_accelerations"], rtol=1e-5)
        np.testing.assert_allclose(np.abs(other["multipliers"]), np.abs(one["multipliers"]), atol=1e-5)


def test_sweep_with_an_effect_follows_single_motions(tmp_path):
    effects = (make("air-spring", k_a=5e4, tau=0.2),)
    result = sweep(Setting(120.0, 0.45, 1.0), "pressure", 0.9, 1.1, 0.1, direction="down", effects=effects)
    assert result.effects == effects
    for i, pressure in enumerate(result.values):
        single = motion(Setting(120.0, 0.45, float(pressure)), effects=effects)
        found = result.motion(i, "down")
        assert (found.label, found.effects) == (single.label, effects)
        assert found.peak_force == pytest.approx(single.peak_force, rel=1e-8)
        assert found.multipliers.shape == (4,)
    result.to_csv(tmp_path / "sweep.csv")
    result.plot(tmp_path / "sweep.png")
    with open(tmp_path / "sweep.csv", encoding="utf-8") as file:
        assert [row["label"] for row in csv.DictReader(file)] == result.labels("down").tolist()


@pytest.mark.slow
def test_chaos_with_an_effect_keeps_its_peaks():
    result = sweep(Setting(100.0, 0.45, 1.0), "frequency", 105.0, 105.5, 0.5, effects=[make("contact-rate")])
    point = result.points("up")[0]
    assert str(result.labels("up")[0]) == "chaotic"
    assert point["peaks"] == MOST_PEAKS
    assert point["peak_forces"].max() <= point["peak_force"] * 1.01
    assert (point["peak_accelerations"] > 0.0).all()


def test_sweep_refuses_what_is_no_effect():
    for effects in ([make("sensor-offset")], ["contact-rate"], 3):
        with pytest.raises(InputError, match="effect"):
            sweep(CENTRE, "frequency", 50.0, 51.0, 0.5, effects=effects)
