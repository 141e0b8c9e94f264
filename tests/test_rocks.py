"""Table 2.2, typed in again in the units and by the phases in which it is printed, and rocks of one's own."""

import dataclasses
import math
import pickle
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drillenv.checks import InputError, shown
from drillenv.rocks import ROCKS, Rock, rock

# kN/mm: case -> k_l or k_u -> impact, compression, stable, printed mean and spread of the stable phase.
TABLE_2_2 = {
    1: {
        "k_l": ([8.17], [11.32, 11.29, 11.62, 11.34], [11.98, 11.77, 11.73, 12.43, 12.45], 12.07, 0.35),
        "k_u": ([13.26], [13.52, 13.42, 13.39, 13.71], [13.89, 13.82, 14.06, 13.60, 13.12], 13.70, 0.37),
    },
    2: {
        "k_l": ([6.70], [12.03, 11.68, 11.68, 11.92], [12.10, 11.71, 11.38, 11.98, 11.99], 11.82, 0.25),
        "k_u": ([14.28], [14.27, 13.68, 14.00, 13.99], [14.17, 13.98, 13.80, 13.83, 13.51], 13.90, 0.21),
    },
    3: {
        "k_l": ([6.47], [11.01, 11.26, 11.42, 12.15], [11.55, 12.11, 11.45, 11.67, 11.69], 11.72, 0.30),
        "k_u": ([13.23], [13.43, 13.11, 12.90, 13.43], [13.70, 13.23, 13.03, 13.95, 13.66], 13.41, 0.38),
    },
    4: {
        "k_l": ([5.42], [17.14, 15.95, 18.04, 19.07], [18.44, 21.37, 22.03, 20.67, 21.55], 21.40, 0.56),
        "k_u": ([21.57], [21.75, 23.55, 22.37, 25.65], [23.95, 24.24, 24.25, 26.35, 25.36], 25.05, 1.01),
    },
    5: {
        "k_l": ([3.03], [16.81, 26.18, 29.14, 30.77], [30.96, 31.69, 34.11, 32.98, 35.88], 32.73, 2.00),
        "k_u": ([37.88], [37.80, 39.66, 38.10, 40.61], [40.00, 43.97, 37.78, 40.25, 41.23], 40.64, 2.01),
    },
    6: {
        "k_l": ([5.16], [19.12, 19.67, 18.79, 21.59], [21.95, 22.32, 21.94, 22.80, 21.58], 22.03, 0.47),
        "k_u": ([25.87], [22.96, 31.98, 28.92, 26.16], [27.38, 28.78, 29.67, 24.77, 26.08], 27.14, 1.84),
    },
}
ANGLES = {1: 30, 2: 45, 3: 60, 4: 30, 5: 45, 6: 60}
CASES = sorted(TABLE_2_2)
GOOD_ROCK = {"loading_stiffness": 2e7, "unloading_stiffness": 3e7}
NO_NUMBERS = [None, True, "21.4", [2e7], 2e7j, np.array(2e7), np.ones((9, 9)), {}]
BAD_NUMBERS = [math.nan, math.inf, -math.inf, 0, -0.0, -2e7, 5e-324, 1e300, 10**400]
UNKNOWN_ROCKS = [
    0,
    7,
    -1,
    10**400,
    10**5000,
    4.0,
    math.nan,
    4j,
    True,
    None,
    [4],
    (4,),
    {},
    np.array(4),
    np.ones((9, 9)),
]
UNKNOWN_ROCKS += ["", "7", "case 4", "1" * 5000, "granite\n", b"4", Rock]
stiffnesses = st.floats(1e5, 1e9)


def refusal(call, *arguments, **values):
    """The message of the InputError that ``call`` raises, which must be one line."""
    with pytest.raises(InputError) as caught:
        call(*arguments, **values)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def in_kilonewton_per_millimetre(values):
    return [round(value / 1e6, 6) for value in values]


# --- Table 2.2


def test_there_are_six_cases():
    assert list(ROCKS) == CASES


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("position", "phase"), [(0, "impact"), (1, "compression"), (2, "stable")])
def test_every_indentation_is_that_of_table_2_2(case, position, phase):
    loading, unloading = ROCKS[case].indentations.phase(phase)
    assert in_kilonewton_per_millimetre(loading) == TABLE_2_2[case]["k_l"][position]
    assert in_kilonewton_per_millimetre(unloading) == TABLE_2_2[case]["k_u"][position]


@pytest.mark.parametrize("case", CASES)
def test_the_phases_are_the_ten_indentations_in_order(case):
    measured = ROCKS[case].indentations
    phases = [measured.phase(phase) for phase in ("impact", "compression", "stable")]
    assert sum((loading for loading, _ in phases), ()) == measured.loading
    assert sum((unloading for _, unloading in phases), ()) == measured.unloading
    assert len(measured.loading) == len(measured.unloading) == 10


@pytest.mark.parametrize("case", CASES)
def test_stiffness_and_spread_are_the_printed_ones(case):
    pair = ROCKS[case]
    found = (pair.loading_stiffness, pair.loading_spread, pair.unloading_stiffness, pair.unloading_spread)
    assert in_kilonewton_per_millimetre(found) == [*TABLE_2_2[case]["k_l"][3:], *TABLE_2_2[case]["k_u"][3:]]


@pytest.mark.parametrize("case", CASES)
def test_young_modulus_and_name_are_those_of_the_pair(case):
    sandstone, gigapascal = (1, 4.80) if case <= 3 else (2, 28.51)
    assert ROCKS[case].young_modulus == gigapascal * 1e9
    assert ROCKS[case].name == f"sandstone{sandstone}-indenter{ANGLES[case]}"


def test_printed_means_are_kept_where_the_printed_measurements_give_others():
    """Mean of the five stable indentations less the printed mean, in kN/mm: case 4 gives 20.81, not 21.40."""
    differences = {}
    for case, row in TABLE_2_2.items():
        for symbol, (_, _, stable, printed, _) in row.items():
            difference = round(statistics.fmean(stable) - printed, 2)
            if abs(difference) > 0.01:
                differences[case, symbol] = difference
    assert differences == {
        (2, "k_u"): -0.04,
        (3, "k_l"): -0.03,
        (3, "k_u"): 0.10,
        (4, "k_l"): -0.59,
        (4, "k_u"): -0.22,
        (5, "k_l"): 0.39,
        (6, "k_l"): 0.09,
        (6, "k_u"): 0.20,
    }


@pytest.mark.parametrize(("case", "last"), [(1, 5), (2, 7), (3, 7), (4, 4), (5, 6), (6, 6)])
def test_printed_means_and_spreads_are_those_of_the_last_indentations(case, last):
    """What is averaged is not the five printed as stable but the last 4 to 7; then all twelve pairs follow."""
    for impact, compression, stable, mean, spread in TABLE_2_2[case].values():
        averaged = (impact + compression + stable)[-last:]
        assert statistics.fmean(averaged) == pytest.approx(mean, abs=0.006)
        assert statistics.stdev(averaged) == pytest.approx(spread, abs=0.008)


@pytest.mark.parametrize("case", CASES)
def test_every_rock_and_indentation_gives_no_energy_away(case):
    pair = ROCKS[case]
    assert pair.loading_stiffness < pair.unloading_stiffness
    assert all(k_l < k_u for k_l, k_u in zip(pair.indentations.loading, pair.indentations.unloading, strict=True))


@pytest.mark.parametrize("phase", ["Stable", "", None, 0, ["stable"], {"stable"}])
def test_an_unknown_phase_is_refused(phase):
    message = refusal(ROCKS[4].indentations.phase, phase)
    assert message == f"phase is {shown(phase)}: give one of impact, compression, stable"


def test_the_table_cannot_be_changed():
    with pytest.raises(TypeError):
        ROCKS[4] = ROCKS[1]
    with pytest.raises(dataclasses.FrozenInstanceError):
        ROCKS[4].loading_stiffness = 1e6


# --- Choosing a rock


@pytest.mark.parametrize("case", CASES)
def test_a_rock_is_chosen_by_case_name_or_itself(case):
    pair = ROCKS[case]
    for choice in (case, np.int64(case), str(case), f" {case} ", pair.name, pair.name.upper(), pair):
        assert rock(choice) is pair


@pytest.mark.parametrize(
    "choice",
    UNKNOWN_ROCKS,
    ids=shown,
)
def test_an_unknown_rock_is_refused(choice):
    message = refusal(rock, choice)
    assert message.startswith(f"rock is {shown(choice)}: give a case of Table 2.2 (1 to 6)")
    assert "sandstone2-indenter30" in message
    assert "Rock(loading_stiffness, unloading_stiffness) in N/m" in message


# --- Rocks of one's own


@given(stiffnesses, stiffnesses)
def test_every_rock_that_gives_no_energy_away_is_accepted(one, other):
    own = Rock(min(one, other), max(one, other))
    assert (own.loading_stiffness, own.unloading_stiffness) == (min(one, other), max(one, other))
    assert pickle.loads(pickle.dumps(own)) == own
    assert hash(own) == hash(dataclasses.replace(own))
    assert rock(own) is own


@given(st.floats(3.03e6, 35.88e6), st.floats(0.0, 13.0e6))
def test_every_rock_of_the_papers_range_is_accepted(loading, more):
    assert Rock(loading, loading + more).loading_stiffness == loading


@given(stiffnesses, stiffnesses)
def test_a_rock_softer_on_the_way_back_is_refused(one, other):
    low, high = sorted((one, other))
    if low < high:
        message = refusal(Rock, high, low)
        assert message.startswith(f"unloading_stiffness is {low!r} N/m, below loading_stiffness {high!r} N/m")
        assert message.endswith("give k_u >= k_l")


@pytest.mark.parametrize("field", GOOD_ROCK)
@pytest.mark.parametrize("value", NO_NUMBERS + BAD_NUMBERS, ids=shown)
def test_a_bad_stiffness_is_refused(field, value):
    message = refusal(Rock, **{**GOOD_ROCK, field: value})
    assert message.startswith(f"{field} is ")
    assert "100000 to 1e+09 N/m" in message


@pytest.mark.parametrize("field", ["loading_spread", "unloading_spread"])
@pytest.mark.parametrize("value", [*NO_NUMBERS, math.nan, math.inf, -math.inf, -1.0, 5e-324, 1e9, 10**400], ids=shown)
def test_a_bad_spread_is_refused(field, value):
    assert refusal(Rock, **GOOD_ROCK, **{field: value}).startswith(f"{field} is ")


@pytest.mark.parametrize("value", [*NO_NUMBERS[1:], *BAD_NUMBERS], ids=shown)
def test_a_bad_young_modulus_is_refused(value):
    message = refusal(Rock, **GOOD_ROCK, young_modulus=value)
    assert message.startswith("young_modulus is ")
    assert "1e+08 to 1e+12 Pa" in message


@pytest.mark.parametrize("value", [None, 4, "", "  ", "two\nlines", ["granite"]], ids=shown)
def test_a_name_that_fits_no_line_is_refused(value):
    assert refusal(Rock, **GOOD_ROCK, name=value) == f"name is {shown(value)}: give a name on one line"


@pytest.mark.parametrize("value", [(1.0, 2.0), "ten", 0, [21.4]], ids=shown)
def test_indentations_of_another_kind_are_refused(value):
    assert refusal(Rock, **GOOD_ROCK, indentations=value).startswith(f"indentations is {shown(value)}: give")


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("unit", "newton_per_metre"), [("kN/mm", 1e6), ("N/mm or kN/m", 1e3), ("MN/mm", 1e9)])
def test_stiffness_and_spread_in_another_unit_are_refused_and_converted(case, unit, newton_per_metre):
    pair = ROCKS[case]
    for field in ("loading_stiffness", "unloading_stiffness", "loading_spread", "unloading_spread"):
        meant = getattr(pair, field)
        message = refusal(dataclasses.replace, pair, **{field: meant / newton_per_metre})
        assert f"{field} is {repr(meant / newton_per_metre).removesuffix('.0')} N/m" in message
        assert f"(was it in {unit}? then write {meant:g})" in message


@pytest.mark.parametrize("gigapascal", [4.80, 28.51])
@pytest.mark.parametrize(("unit", "factor"), [("GPa", 1.0), ("MPa", 1e3)])
def test_a_young_modulus_in_another_unit_is_refused_and_converted(gigapascal, unit, factor):
    message = refusal(Rock, **GOOD_ROCK, young_modulus=gigapascal * factor)
    assert f"(was it in {unit}? then write {gigapascal * 1e9:g})" in message


# --- Rocks drawn at random


def test_drawn_rocks_have_the_printed_mean_and_spread():
    generator = np.random.default_rng(2026)
    for case in (2, 4, 5):  # those whose k_l and k_u lie furthest apart: there hardly a draw is refused
        drawn = [ROCKS[case].drawn(generator) for _ in range(4000)]
        for symbol, field in (("k_l", "loading_stiffness"), ("k_u", "unloading_stiffness")):
            *_, mean, spread = TABLE_2_2[case][symbol]
            values = np.array([getattr(one, field) for one in drawn]) / 1e6
            assert values.mean() == pytest.approx(mean, abs=5 * spread / math.sqrt(4000))
            assert values.std() == pytest.approx(spread, rel=0.07)


def test_both_stiffnesses_are_drawn_independently():
    generator = np.random.default_rng(7)
    drawn = [ROCKS[4].drawn(generator) for _ in range(4000)]
    pairs = np.array([(one.loading_stiffness, one.unloading_stiffness) for one in drawn])
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 5 / math.sqrt(4000)


@given(st.integers(0, 2**32 - 1), st.sampled_from(CASES))
def test_the_same_seed_draws_the_same_rock(seed, case):
    first, second = (ROCKS[case].drawn(np.random.default_rng(seed)) for _ in range(2))
    assert first == second
    assert first != ROCKS[case].drawn(np.random.default_rng(seed + 1))


@given(st.integers(0, 2**32 - 1), stiffnesses, st.floats(1.0, 3.0), st.floats(1e-3, 1.0))
def test_a_drawn_rock_is_always_allowed(seed, loading, ratio, share):
    unloading = min(loading * ratio, 1e9)
    own = Rock(loading, unloading, "own", share * loading, share * unloading, 5e9)
    drawn = own.drawn(np.random.default_rng(seed))
    assert 1e5 <= drawn.loading_stiffness <= drawn.unloading_stiffness <= 1e9
    assert drawn.name == "own, drawn"
    assert drawn.young_modulus == 5e9


def test_a_rock_without_spread_is_drawn_as_it_is():
    drawn = Rock(2e7, 2e7).drawn(np.random.default_rng(0))
    assert (drawn.loading_stiffness, drawn.unloading_stiffness) == (2e7, 2e7)


def test_drawing_leaves_the_global_random_state_alone():
    before = np.random.get_state()[1].copy()  # noqa: NPY002  (it is what must not move)
    ROCKS[4].drawn(np.random.default_rng(0))
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002
