"""Motions against the paper, plain runs, finite differences and a pair of trajectories."""

import math

import numpy as np
import pytest

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
from drillenv.dynamics.flow import FREE, LOADING, OMEGA, STIFFNESS, UNLOADING, make_model
from drillenv.dynamics.motion import Motion, motion, motions, point_from_xf
from drillenv.dynamics.orbits import length_scale, on_section, put_on_section
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock
from drillenv.rocks import rock as rock_meant

STABLE_ORBITS = [
    (4, Setting(50, 0.45, 1.0)),  # P-1-I-4, with turns inside a contact
    (4, Setting(70, 0.45, 1.0)),
    (4, Setting(100, 0.45, 1.0)),  # period two
    (2, Setting(120, 0.31, 1.0)),
    (6, Setting(119, 0.55, 1.7)),
    (2, Setting(68.36, 0.31, 1.46)),  # loading where it crosses the section
    (5, Setting(51.58, 0.34, 1.49)),  # unloading there
]


def model_of(found: Motion) -> np.ndarray:
    return make_model(found.rig, found.rock, found.setting)


def mapped(model: np.ndarray, point: np.ndarray, periods: int) -> np.ndarray:
    """The stroboscopic map by the plain engine, w from Xf on both sides."""
    state, image = np.zeros(STATE_SIZE), np.zeros(4)
    put_on_section(point, UNLOADING, state)
    for _ in range(periods):
        advance_period(model, state, np.zeros(TALLY_SIZE), make_scratch())
    on_section(model, state, UNLOADING, image)
    return image


def section_scales(model: np.ndarray) -> np.ndarray:
    """What the coordinates of the section are measured by."""
    return length_scale(model) * np.array([1.0, model[0, OMEGA], model[0, OMEGA], 1.0])


# Single settings of Fig. 2.5, 3.2, 4.1, 4.2 and 4.3; of period two only the period is published.
@pytest.mark.parametrize(
    ("case", "setting", "published"),
    [
        (4, (50, 0.45, 1.0), "P-1-I-4"),
        (4, (70, 0.45, 1.0), "P-1-I-3"),
        (4, (90, 0.45, 1.0), "P-1-I-2"),
        (4, (100, 0.45, 1.0), "P-2"),
        (4, (120, 0.45, 1.0), "P-1-I-1"),
        (4, (50, 0.50, 1.0), "P-1-I-4"),
        (4, (150, 0.50, 1.0), "P-1-I-1"),
        (2, (120, 0.30, 1.0), "P-1-I-2"),
        (2, (120, 0.60, 1.0), "P-1-I-1"),
        (4, (90, 0.45, 1.4), "P-1-I-3"),
    ],
)
def test_published_labels(case, setting, published):
    found = motion(Setting(*setting), case)
    assert found.label.startswith(published)
    assert found.stable
    assert found.label == f"P-{found.period}-I-{found.impacts}"


def test_impacts_are_force_peaks_and_not_contacts():
    found = motion(Setting(50, 0.45, 1.0))
    assert (found.impacts, found.contacts) == (4, 2)


@pytest.mark.parametrize(("case", "setting"), STABLE_ORBITS)
def test_orbit_is_where_a_long_run_ends(case, setting):
    found = motion(setting, case)
    model = model_of(found)
    state, tally, scratch = np.zeros(STATE_SIZE), np.zeros(TALLY_SIZE), make_scratch()
    fresh_state(model, 0.0, state)
    for _ in range(4000):
        advance_period(model, state, tally, scratch)
    place, crossing = np.zeros(4), point_from_xf(found)
    origin = state[ORIGIN]
    on_section(model, state, UNLOADING, place)
    scales = section_scales(model)
    crossings = [mapped(model, crossing, n) for n in range(found.period)]
    assert min(np.abs((each - place) / scales).max() for each in crossings) < 1e-9
    tally[:] = 0.0
    for _ in range(60 * found.period):
        advance_period(model, state, tally, scratch)
    seconds = 60 * found.period / setting.frequency
    assert found.penetration_rate == pytest.approx((state[ORIGIN] - origin) / seconds, rel=1e-9)
    assert found.impacts == tally[IMPACTS] / 60
    assert found.contacts == tally[CONTACTS] / 60
    assert found.peak_force == pytest.approx(tally[PEAK_FORCE], rel=1e-9)
    assert found.impact_speed == pytest.approx(tally[PEAK_SPEED], rel=1e-9)


@pytest.mark.parametrize(("case", "setting"), STABLE_ORBITS)
def test_multipliers_are_those_of_central_differences(case, setting):
    found = motion(setting, case)
    model, point = model_of(found), point_from_xf(found)
    scales = section_scales(model)
    derivative = np.empty((4, 4))
    for j in range(4):
        step = np.zeros(4)
        step[j] = 1e-6 * scales[j]
        change = mapped(model, point + step, found.period) - mapped(model, point - step, found.period)
        derivative[:, j] = change / scales / 2e-6
    expected = np.linalg.eigvals(derivative)
    for multiplier in found.multipliers:
        assert np.abs(expected - multiplier).min() < 1e-6
    assert np.all(np.diff(np.abs(found.multipliers)) <= 1e-12)


@pytest.mark.parametrize(
    ("case", "setting", "regime"),
    [
        (4, Setting(120, 0.45, 1.0), FREE),
        (2, Setting(68.36, 0.31, 1.46), LOADING),
        (5, Setting(51.58, 0.34, 1.49), UNLOADING),
    ],
)
def test_a_start_in_every_regime_stays_on_its_orbit(case, setting, regime):
    found = motion(setting, case)
    assert found.regime == regime
    for start in (found, point_from_xf(found)):
        again = motion(setting, case, start=start)
        assert again.label == found.label
        np.testing.assert_allclose(again.point, found.point, rtol=1e-9, atol=1e-13)


def separation_rate(model: np.ndarray, point: np.ndarray, frequency: float, skip: int, periods: int) -> float:
    """Mean rate in 1/s at which a second trajectory parts from the first, put back to 1e-8 m away each period."""
    scales = np.array([1.0, 2 * math.pi * frequency, 2 * math.pi * frequency, 1.0])
    first, second, scratch = np.zeros(STATE_SIZE), np.zeros(STATE_SIZE), make_scratch()
    put_on_section(point, UNLOADING, first)
    offset, apart = 1e-9 * scales * np.array([0.5, 0.5, 0.5, 0.5]), np.zeros(4)
    here, there = point.copy(), np.zeros(4)
    rates = []
    for _ in range(periods):
        put_on_section(here + offset, UNLOADING, second)
        put_on_section(here, UNLOADING, first)
        advance_period(model, first, np.zeros(TALLY_SIZE), scratch)
        advance_period(model, second, np.zeros(TALLY_SIZE), scratch)
        on_section(model, first, UNLOADING, here)
        on_section(model, second, UNLOADING, there)
        apart = (there - here) / scales
        size = np.linalg.norm(apart)
        rates.append(math.log(size / 1e-9))
        offset = 1e-9 * apart / size * scales
    return frequency * float(np.mean(rates[skip:]))


def test_chaos_has_the_exponent_of_two_trajectories():
    found = motion(Setting(105.0, 0.45, 1.0))
    assert found.label == "chaotic"
    assert found.period == 0
    assert not found.stable
    assert np.isnan(found.multipliers).all()
    rate = separation_rate(model_of(found), point_from_xf(found), 105.0, 50, 3000)
    assert found.exponent == pytest.approx(rate, rel=0.2)
    assert found.exponent > 5.0
    # means of a period
    assert 1.0 < found.impacts < 2.0


def test_exponent_of_an_orbit_is_that_of_two_trajectories():
    found = motion(Setting(120.0, 0.45, 1.0))
    rate = separation_rate(model_of(found), point_from_xf(found), 120.0, 200, 6000)
    assert found.exponent == pytest.approx(rate, rel=0.02)
    assert found.exponent == pytest.approx(math.log(abs(found.multipliers[0])) * 120.0, rel=1e-12)


def test_coexisting_motions():
    setting = Setting(109.6, 0.45, 1.0)
    found = motions(setting, starts=96)
    assert {each.label for each in found} == {"P-1-I-1", "P-2-I-4"}
    assert sum(each.share for each in found) == pytest.approx(1.0)
    assert found[0].share > found[1].share > 0.0
    for each in found:
        again = motion(setting, start=each)
        assert again.label == each.label
        assert again.peak_force == pytest.approx(each.peak_force, rel=1e-10)
    assert [each.share for each in motions(setting, starts=96)] == [each.share for each in found]
    other = motions(setting, starts=96, seed=1)
    assert {each.label for each in other} == {each.label for each in found}


def test_an_orbit_is_counted_once_wherever_starts_land_on_it():
    found = motions(Setting(100.0, 0.50, 1.0), starts=64)  # period eight, crossed at eight points
    assert [each.label for each in found] == ["P-8-I-14"]
    assert found[0].share == 1.0


def test_neither_periodic_nor_chaotic_is_aperiodic():
    found = motion(Setting(90.0, 0.45, 0.806))  # an orbit of more than 32 periods
    assert found.label == "aperiodic"
    assert found.exponent < 0.0
    assert not found.stable


def test_start_decides_between_coexisting_motions():
    first, second = motions(Setting(109.6, 0.45, 1.0))
    setting = Setting(109.75, 0.45, 1.0)
    assert motion(setting, start=first).label == "P-1-I-1"
    assert motion(setting, start=second).label == "P-1-I-2"


def test_another_rig_and_a_rock_of_ones_own():
    rig, rock = Rig(shaker_mass=300.0), Rock(15e6, 20e6)
    found = motion(Setting(110.0, 0.45, 1.0), rock, rig)
    assert found.rig is rig
    assert found.rock is rock
    assert found.label != "chaotic"
    model = model_of(found)
    assert model[LOADING, STIFFNESS] == 15e6
    assert motion(Setting(110.0, 0.45, 1.0), rock_meant(4)).penetration_rate != found.penetration_rate


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"setting": (120, 0.45, 1.0)}, "give Setting"),
        ({"rock": 7}, "rock is 7"),
        ({"rig": "mine"}, "give a Rig"),
        ({"start": [1.0, 2.0]}, "start is"),
        ({"start": "fresh"}, "start is"),
        ({"start": [3.0, 0.0, 0.0, 0.0]}, "y of start is 3 m.*in mm"),
        ({"start": [0.0, 0.0, 0.0, math.nan]}, "w of start"),
        ({"wait": 0}, "wait is 0"),
        ({"patience": 2.5}, "patience is 2.5"),
    ],
)
def test_bad_input_is_said_in_one_line(arguments, says):
    given = {"setting": Setting(120, 0.45, 1.0)} | arguments
    with pytest.raises(InputError, match=says) as error:
        motion(**given)
    assert "\n" not in str(error.value)


def test_bad_numbers_of_starts():
    for starts in (0, 1.5, "many", True):
        with pytest.raises(InputError, match="starts"):
            motions(Setting(120, 0.45, 1.0), starts=starts)
