"""Table 2.1, Eq. 3.4 to 3.6, and what a Setting and a Rig refuse."""

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drillenv.checks import InputError, shown
from drillenv.rig import Rig, Setting, groups
from drillenv.rocks import ROCKS, Rock

# The setting for which the caption of Fig. 3.2 prints the groups: the forces are those at 50 Hz.
FIGURE_3_2 = Setting(50.0, 0.45, 1.0)
GOOD_SETTING = {"frequency": 90.0, "amplitude": 0.45, "pressure": 1.0}
ALLOWED_SETTING = {"frequency": "10 to 250 Hz", "amplitude": "0.05 to 2 V", "pressure": "0.2 to 5 bar"}
RIG_FIELDS = [field.name for field in dataclasses.fields(Rig)]
NO_NUMBERS = [None, True, "90", [90.0], 90j, np.array(0.5), np.ones((9, 9)), {}]
NOT_POSITIVE = [0, 0.0, -0.0, -1, -90.0, -1e300, 5e-324]
NOT_FINITE = [math.nan, math.inf, -math.inf]


def refusal(kind, **values):
    """The message with which ``kind`` refuses ``values``, which must be one line."""
    with pytest.raises(InputError) as caught:
        kind(**values)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def one_rounding(value, digits):
    """Within half a unit of the last of ``digits`` printed decimals."""
    return pytest.approx(value, abs=0.5000001 * 10.0**-digits, rel=0)


# --- The numbers of the paper


def test_rig_is_table_2_1():
    rig = Rig()
    assert (rig.stiffness / 1e3, rig.damping / 1e3) == (68.85, 2.45)  # kN/m, kN s/m
    assert (rig.shaker_mass, rig.indenter_mass) == (265.0, 3.0)  # kg
    assert (rig.drive_gain, rig.pressure_gain) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("frequency", "amplitude", "newton"),
    [(50, 0.45, 448.2855), (100, 0.30, 334.857), (120, 0.60, 698.514), (150, 0.50, 618.095)],
)
def test_drive_force_is_eq_3_5(frequency, amplitude, newton):
    assert Rig().drive_force(Setting(frequency, amplitude, 1.0)) == pytest.approx(newton, rel=1e-12)


@pytest.mark.parametrize(("pressure", "newton"), [(0.6, 117.81), (1.0, 196.35), (1.8, 353.43)])
def test_static_force_is_eq_3_6(pressure, newton):
    assert Rig().static_force(Setting(90.0, 0.45, pressure)) == pytest.approx(newton, rel=1e-12)


def test_gains_scale_the_forces():
    rig = Rig(drive_gain=1.1, pressure_gain=0.9)
    assert rig.drive_force(FIGURE_3_2) == pytest.approx(1.1 * Rig().drive_force(FIGURE_3_2))
    assert rig.static_force(FIGURE_3_2) == pytest.approx(0.9 * Rig().static_force(FIGURE_3_2))


def test_groups_are_those_printed_under_figure_3_2():
    found = groups(Rig(), FIGURE_3_2, ROCKS[4])
    assert found.alpha == one_rounding(0.0113, 4)
    assert found.beta == one_rounding(0.0032, 4)
    assert found.kappa == one_rounding(1.1706, 4)
    assert found.a == one_rounding(0.0209, 4)
    assert found.b == one_rounding(0.0092, 4)
    assert found.omega == one_rounding(0.1176, 4)
    assert groups(Rig(), Setting(120.0, 0.45, 1.0), ROCKS[4]).omega == one_rounding(0.2823, 4)


def test_printed_xi_follows_from_the_damping_within_its_printed_digits():
    """c = 2.45 kN s/m gives 0.1529; the printed 0.1531 needs c = 2.4534, which Table 2.1 would print the same."""
    assert groups(Rig(), FIGURE_3_2, ROCKS[4]).xi == one_rounding(0.1529, 4)
    assert (
        groups(Rig(damping=2445.0), FIGURE_3_2, ROCKS[4]).xi
        < 0.1531
        < groups(Rig(damping=2455.0), FIGURE_3_2, ROCKS[4]).xi
    )


def test_scales_turn_the_groups_back_into_si():
    rig, rock = Rig(), ROCKS[2]
    found = groups(rig, FIGURE_3_2, rock, reference_length=2e-4)
    force = rig.indenter_mass * found.length_scale / found.time_scale**2
    assert found.length_scale == 2e-4
    assert found.omega / found.time_scale == pytest.approx(2 * math.pi * 50.0)
    assert found.a * force == pytest.approx(rig.drive_force(FIGURE_3_2))
    assert found.b * force == pytest.approx(rig.static_force(FIGURE_3_2))
    assert found.xi * 2 * rig.indenter_mass / found.time_scale == pytest.approx(rig.damping)
    assert found.beta * rock.loading_stiffness == pytest.approx(rig.stiffness)
    assert found.alpha * rig.shaker_mass == pytest.approx(rig.indenter_mass)


def test_only_the_forces_depend_on_the_reference_length():
    small, large = (groups(Rig(), FIGURE_3_2, ROCKS[4], mu) for mu in (1e-4, 1e-3))
    assert small._replace(a=0, b=0, length_scale=0) == large._replace(a=0, b=0, length_scale=0)
    assert small.a == pytest.approx(10 * large.a)
    assert small.b == pytest.approx(10 * large.b)


# --- What is accepted


@given(st.floats(50.0, 120.0), st.floats(0.3, 0.6), st.floats(0.6, 1.8))
def test_every_setting_of_the_papers_box_is_kept_as_given(frequency, amplitude, pressure):
    setting = Setting(frequency, amplitude, pressure)
    assert dataclasses.astuple(setting) == (frequency, amplitude, pressure)
    assert setting.period == 1 / frequency
    assert pickle.loads(pickle.dumps(setting)) == copy.deepcopy(setting) == setting
    assert hash(copy.copy(setting)) == hash(setting)


@pytest.mark.parametrize(
    "values", [(10, 0.05, 0.2), (250, 2, 5), (150, 0.5, 1), (np.float32(90), np.float64(0.45), np.int64(1))]
)
def test_limits_figure_2_5_and_numpy_numbers_are_accepted(values):
    setting = Setting(*values)
    assert dataclasses.astuple(setting) == values
    assert all(type(value) is float for value in dataclasses.astuple(setting))


@pytest.mark.parametrize("thing", [FIGURE_3_2, Rig()])
def test_settings_and_rigs_do_not_change(thing):
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(thing, dataclasses.fields(thing)[0].name, 60.0)


# --- What is refused


@pytest.mark.parametrize("name", GOOD_SETTING)
@pytest.mark.parametrize("value", NO_NUMBERS, ids=shown)
def test_setting_refuses_what_is_no_number(name, value):
    message = refusal(Setting, **{**GOOD_SETTING, name: value})
    assert message.startswith(f"{name} is {shown(value)}, which is not a number")
    assert ALLOWED_SETTING[name] in message


@pytest.mark.parametrize("name", GOOD_SETTING)
@pytest.mark.parametrize("value", NOT_FINITE + NOT_POSITIVE, ids=shown)
def test_setting_refuses_numbers_that_are_not_finite_or_not_positive(name, value):
    message = refusal(Setting, **{**GOOD_SETTING, name: value})
    shown_value = message.removeprefix(f"{name} is ").split(" ")[0].split(":")[0]
    assert float(shown_value) == value or math.isnan(value)
    assert ALLOWED_SETTING[name] in message


@pytest.mark.parametrize("name", RIG_FIELDS)
@pytest.mark.parametrize("value", NO_NUMBERS + NOT_FINITE + NOT_POSITIVE, ids=shown)
def test_rig_refuses(name, value):
    message = refusal(Rig, **{name: value})
    assert message.startswith(f"{name} is ")
    assert ": give a" in message


@pytest.mark.parametrize("value", [None, "1 mm", math.nan, 0.0, -1e-3, 2.0])
def test_groups_refuse_a_reference_length(value):
    with pytest.raises(InputError, match=r"^reference_length is .*1e-09 to 1 m"):
        groups(Rig(), FIGURE_3_2, ROCKS[4], value)


@given(st.sampled_from(sorted(GOOD_SETTING)), st.floats(allow_nan=False, allow_infinity=False))
def test_setting_refuses_every_number_outside_its_limits_and_no_other(name, value):
    low, high = {"frequency": (10, 250), "amplitude": (0.05, 2), "pressure": (0.2, 5)}[name]
    values = {**GOOD_SETTING, name: value}
    if low <= value <= high:
        assert getattr(Setting(**values), name) == value
    else:
        assert f"{name} is {repr(value).removesuffix('.0')} " in refusal(Setting, **values)


# --- Slips of unit: (what was given in the other unit, per unit of the rig)

PER_UNIT = [
    ("frequency", "rad/s", 2 * math.pi, 50.0, 120.0),
    ("frequency", "rpm", 60.0, 50.0, 120.0),
    ("frequency", "kHz", 1e-3, 50.0, 120.0),
    ("amplitude", "mV", 1e3, 0.3, 0.6),
    ("pressure", "kPa", 100.0, 0.6, 1.8),
    ("pressure", "MPa", 0.1, 0.6, 1.8),
    ("pressure", "Pa", 1e5, 0.6, 1.8),
    ("pressure", "mbar", 1e3, 0.6, 1.8),
    ("pressure", "psi", 14.5037738, 0.6, 1.8),
]


@pytest.mark.parametrize(("name", "unit", "per_unit", "low", "high"), PER_UNIT, ids=lambda value: str(value))
@given(share=st.floats(0.0, 1.0))
def test_a_setting_in_another_unit_is_refused_and_converted(name, unit, per_unit, low, high, share):
    meant = low + share * (high - low)
    message = refusal(Setting, **{**GOOD_SETTING, name: meant * per_unit})
    proposed = message.split(f"in {unit}? then write ")[1].split(";")[0].rstrip(")")
    assert float(proposed) == pytest.approx(meant, rel=1e-5)
    assert ALLOWED_SETTING[name] in message


@pytest.mark.parametrize(
    ("name", "value", "advice"),
    [
        ("stiffness", 68.85, "was it in kN/m or N/mm? then write 68850"),
        ("damping", 2.45, "was it in kN s/m? then write 2450"),
        ("shaker_mass", 265e3, "was it in g? then write 265"),
        ("indenter_mass", 3000, "was it in g? then write 3"),
    ],
)
def test_a_rig_in_the_units_of_table_2_1_is_refused_and_converted(name, value, advice):
    message = refusal(Rig, **{name: value})
    assert f"{name} is {value:g} " in message
    assert advice in message


def test_groups_take_a_rock_of_ones_own():
    assert groups(Rig(), FIGURE_3_2, Rock(2e7, 3e7)).kappa == pytest.approx(1.5)
