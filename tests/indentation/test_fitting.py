"""Made curves give back their laws, drifts, compliance and creep."""

import numpy as np
import pytest

from drillenv import fit_indentation
from drillenv.indentation import Curve
from tests.indentation.made import Made, drawn


@pytest.mark.thorough
@pytest.mark.slow
def test_true_laws_lie_in_their_intervals():
    hits = {symbol: [] for symbol in ("k_l", "k_u", "n_l", "n_u")}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        made = drawn(rng, most=2)
        time, displacement, force, _ = made.make(rng)
        test = fit_indentation(Curve(time, displacement, force), made.compliance)
        assert len(test.measured) == len(made.loading)
        for j, one in enumerate(test.measured):
            truth = made.truth(j)
            for way, branch in zip("lu", (one.loading, one.unloading), strict=True):
                for symbol, found in (("k", branch.stiffness), ("n", branch.exponent)):
                    hits[f"{symbol}_{way}"].append(found.low <= truth[f"{symbol}_{way}"] <= found.high)
    for symbol, inside in hits.items():
        assert 0.85 <= np.mean(inside) <= 1.0, symbol


def test_drift_compliance_and_creep_are_told():
    made = Made(
        [20e6], [25e6], hold=40.0, creep=4e-6, compliance=1e-8, force_drift=0.02, zero=30.0, displacement_drift=1e-8
    )
    time, displacement, force, _ = made.make(np.random.default_rng(1))
    test = fit_indentation(Curve(time, displacement, force), 1e-8)
    (one,) = test.measured
    assert one.hold == pytest.approx(40.0, abs=1.5)
    assert one.creep.low <= 4e-6 <= one.creep.high
    assert one.creep.std < 1.5e-6
    assert test.zeros[0].rate == pytest.approx(0.02, abs=0.005)
    assert test.drift.rate == pytest.approx(1e-8, abs=4 * test.drift.std)
    in_series = fit_indentation(Curve(time, displacement, force))
    assert in_series.measured[0].loading.stiffness.value == pytest.approx(1 / (1 / 20e6 + 1e-8), rel=0.01)
    assert any("in series" in warning for warning in in_series.warnings)


def test_creep_in_a_soft_first_indentation_is_not_taken_for_unloading():
    """The unloading of an impact is many times as stiff as its loading, and over on a small share of the way."""
    made = Made([3.03e6, 32e6], [37.88e6, 40e6], hold=40.0, creep=3e-6, rate=5.0, standing=60.0)
    time, displacement, force, _ = made.make(np.random.default_rng(5))
    for one in fit_indentation(Curve(time, displacement, force), 0.0).measured:
        assert one.creep.low <= 3e-6 <= one.creep.high
        assert one.creep.std < 0.5e-6
        assert force[one.window.unloading].max() > 0.95 * made.peak


def test_a_force_that_relaxes_is_no_creep():
    made = Made([20e6], [25e6], hold=40.0, relaxation=0.06, rate=5.0, standing=60.0)
    time, displacement, force, _ = made.make(np.random.default_rng(5))
    (one,) = fit_indentation(Curve(time, displacement, force), 0.0).measured
    assert one.hold == pytest.approx(40.0, abs=1.5)
    assert one.creep.low <= 0.0 <= one.creep.high
    assert one.unloading.stiffness.low <= 25e6 <= one.unloading.stiffness.high


def test_numbered_indentations(tmp_path):
    made = Made([20e6, 21e6], [25e6, 26e6], rate=4.0)
    time, displacement, force, number = made.make(np.random.default_rng(3))
    test = fit_indentation(Curve(time, displacement, force, number), 0.0)
    assert [one.phase for one in test.measured] == ["stable", "stable"]
    assert test.measured[1].loading.stiffness.value == pytest.approx(21e6, rel=0.02)
