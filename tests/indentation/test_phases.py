"""Impact, compression and stable: the six rocks of Table 2.2 as made curves, and no growth where there is none."""

import numpy as np
import pytest

from drillenv import fit_indentation
from drillenv.indentation import Curve
from drillenv.indentation.phases import combine, find_phases
from tests.indentation.made import Made

# Table 2.2 in kN/mm, typed in again: k_l and k_u of ten indentations.
TABLE = {
    1: (
        "8.17 11.32 11.29 11.62 11.34 11.98 11.77 11.73 12.43 12.45",
        "13.26 13.52 13.42 13.39 13.71 13.89 13.82 14.06 13.60 13.12",
    ),
    2: (
        "6.70 12.03 11.68 11.68 11.92 12.10 11.71 11.38 11.98 11.99",
        "14.28 14.27 13.68 14.00 13.99 14.17 13.98 13.80 13.83 13.51",
    ),
    3: (
        "6.47 11.01 11.26 11.42 12.15 11.55 12.11 11.45 11.67 11.69",
        "13.23 13.43 13.11 12.90 13.43 13.70 13.23 13.03 13.95 13.66",
    ),
    4: (
        "5.42 17.14 15.95 18.04 19.07 18.44 21.37 22.03 20.67 21.55",
        "21.57 21.75 23.55 22.37 25.65 23.95 24.24 24.25 26.35 25.36",
    ),
    5: (
        "3.03 16.81 26.18 29.14 30.77 30.96 31.69 34.11 32.98 35.88",
        "37.88 37.80 39.66 38.10 40.61 40.00 43.97 37.78 40.25 41.23",
    ),
    6: (
        "5.16 19.12 19.67 18.79 21.59 21.95 22.32 21.94 22.80 21.58",
        "25.87 22.96 31.98 28.92 26.16 27.38 28.78 29.67 24.77 26.08",
    ),
}


@pytest.fixture(scope="module")
def six():
    """Of each case the stiffnesses it was made with, and the test that was fitted to it."""
    found = {}
    for case, rows in TABLE.items():
        k_l, k_u = ([1e6 * float(each) for each in row.split()] for row in rows)
        made = Made(k_l, k_u, rate=2.0, standing=60.0, force_noise=(3.0, 0, 0), displacement_noise=(0.05e-6, 0, 0))
        time, displacement, force, _ = made.make(np.random.default_rng(case))
        found[case] = {"loading": k_l, "unloading": k_u}, fit_indentation(Curve(time, displacement, force), 0.0)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("case", sorted(TABLE))
def test_the_six_rocks_come_back(six, case):
    truth, test = six[case]
    early = test.phases.early
    assert 1 <= early <= 8
    assert test.measured[0].phase == "impact"
    for symbol, way in (("k_l", "loading"), ("k_u", "unloading")):
        stable = test.stable[symbol].mean
        assert stable.low <= np.mean(truth[way][early:]) <= stable.high


@pytest.mark.slow
def test_each_indentation_and_factor_of_the_six_rocks_comes_back(six):
    """Together, since the indentations of a curve share the error of its drift."""
    stiffness, factors = [], []
    for truth, test in six.values():
        early = test.phases.early
        for way in ("loading", "unloading"):
            mean = np.mean(truth[way][early:])
            for j, (one, true) in enumerate(zip(test.measured, truth[way], strict=True)):
                found, factor = getattr(one, way).stiffness, getattr(one, f"{way}_factor")
                stiffness.append(found.low <= true <= found.high)
                if j < early:
                    factors.append(factor.low <= true / mean <= factor.high)
    assert np.mean(stiffness) >= 0.85
    assert np.mean(factors) >= 0.85


@pytest.mark.slow
def test_no_growth_is_found_where_there_is_none():
    rng = np.random.default_rng(11)
    found = [find_phases(20e6 + 0.5e6 * rng.standard_normal(10), np.full(10, 1e5)).early for _ in range(100)]
    assert np.count_nonzero(found) <= 12  # 5 expected


def test_a_growth_is_found_where_it_ends():
    rng = np.random.default_rng(11)
    for early in (1, 3, 5):
        values = 20e6 + 0.3e6 * rng.standard_normal(10)
        values[:early] -= 5e6
        phases = find_phases(values, np.full(10, 1e5))
        assert phases.early == early
        assert phases.p_values[0] < 0.01


def test_too_few_are_not_tested():
    phases = find_phases([5e6, 20e6, 20e6], [1e5] * 3)
    assert (phases.early, phases.tested) == (0, False)


def test_mean_and_scatter_of_alike_values_are_those_of_a_textbook():
    """With equal errors the mean is the plain one and the variance between is the sample's less that of measurement."""
    values = np.array([19.0, 21.0, 20.0, 22.0, 18.0])
    common = combine(values, [0.5] * 5, np.zeros((5, 1)))
    assert common.mean.value == pytest.approx(20.0)
    assert common.scatter**2 == pytest.approx(2.5 - 0.25, rel=1e-6)
    assert common.mean.high - 20.0 == pytest.approx(2.776445 * np.sqrt(2.5 / 5), rel=1e-5)  # t of 4 degrees of freedom
