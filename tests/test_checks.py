"""Bad input is refused in one line that says what was given, what is allowed and what to do."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drillenv.checks import InputError, choice, count, number, shown

NO_NUMBERS = [None, True, False, "", "90", "1e2\n3", b"90", [90.0], (90.0,), {"f": 90}, {90}, 90j, object(), math.sin]
NO_NUMBERS += [np.array(90.0), np.array([90.0]), np.ones((40, 40)), np.bool_(True), np.complex128(90)]
anything = st.one_of(st.none(), st.booleans(), st.text(), st.binary(), st.complex_numbers(), st.lists(st.floats()))


def refusal(call, *arguments, **options):
    """The message of the InputError that ``call`` raises, which must be one readable line."""
    with pytest.raises(InputError) as caught:
        call(*arguments, **options)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert len(message) < 400
    return message


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: type(value).__name__)
def test_what_is_no_number_is_shown_and_refused(value):
    message = refusal(number, "frequency", value, 10.0, 250.0, "Hz")
    assert message.startswith(f"frequency is {shown(value)}, which is not a number")
    assert "10 to 250 Hz" in message


@given(anything)
def test_no_odd_object_slips_through(value):
    assert "10 to 250 Hz" in refusal(number, "frequency", value, 10.0, 250.0, "Hz")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, np.float64("nan"), np.float32("inf")])
def test_numbers_that_are_not_finite_are_refused(value):
    assert f"is {float(value)}: give a finite number from 10 to 250 Hz" in refusal(
        number, "f", value, 10.0, 250.0, "Hz"
    )


@pytest.mark.parametrize("value", [10**400, -(10**400), 10**5000, Fraction(10**400, 3)], ids=shown)
def test_numbers_too_large_for_a_float_are_refused(value):
    assert "give a number from 10 to 250 Hz" in refusal(number, "f", value, 10.0, 250.0, "Hz")


@given(st.floats(10.0, 250.0))
def test_every_number_in_the_range_is_kept_to_the_last_bit(value):
    assert number("f", value, 10.0, 250.0) == value


@pytest.mark.parametrize("value", [50, np.int32(50), np.float32(50), np.float64(50), Fraction(50)])
def test_every_real_type_becomes_a_float(value):
    result = number("f", value, 10.0, 250.0)
    assert type(result) is float
    assert result == 50.0


@given(st.floats(allow_nan=False, allow_infinity=False).filter(lambda value: not 10.0 <= value <= 250.0))
def test_a_refused_number_is_shown_with_every_digit(value):
    message = refusal(number, "f", value, 10.0, 250.0, "Hz")
    assert float(message.removeprefix("f is ").split(" ")[0]) == value
    assert "outside 10 to 250 Hz" in message


def test_a_number_without_a_unit_leaves_no_gap():
    assert refusal(number, "gain", 30, 0.05, 20.0) == "gain is 30, outside 0.05 to 20: give a value from 0.05 to 20"


def test_every_unit_that_may_have_been_meant_is_proposed():
    message = refusal(number, "p", 22, 0.2, 5.0, "bar", [(1e-2, "kPa"), (10.0, "MPa"), (0.0689476, "psi")])
    assert message.endswith("(was it in kPa? then write 0.22; in psi? then write 1.51685)")


@pytest.mark.parametrize("value", [3, 3.0, np.int64(3), np.float64(3)])
def test_whole_numbers_of_any_type_are_counts(value):
    result = count("impacts", value, 1, 10)
    assert type(result) is int
    assert result == 3


@pytest.mark.parametrize("value", [0, 11, -3, 2.5, 1 + 1e-15, math.nan, math.inf, 10**400, "3", None, True, [3]])
def test_what_is_no_count_is_refused(value):
    message = refusal(count, "impacts", value, 1, 10)
    assert message.startswith("impacts is ")
    assert "1 to 10" in message


def test_a_choice_is_returned():
    assert choice("mode", "human", ("human", "rgb_array")) == "human"
    assert choice("mode", None, (None, "human")) is None


@pytest.mark.parametrize("value", ["Human", "a\nb", None, 1.0, True, ["human"], np.zeros(3), 10**5000, {}], ids=shown)
def test_another_choice_is_refused(value):
    message = refusal(choice, "mode", value, ("human", 1))
    assert message == f"mode is {shown(value)}: give one of human, 1"


@given(st.one_of(anything, st.integers(), st.floats()))
def test_anything_is_shown_on_one_short_line(value):
    assert len(shown(value).splitlines()) <= 1
    assert len(shown(value)) <= 80


def test_an_input_error_is_a_value_error():
    assert issubclass(InputError, ValueError)
