"""What a search holds against what."""

from types import SimpleNamespace

import pytest

from drillenv.diagnosis.search import CLOSE, Tried, _like


def _fit(per_sample, loose):
    return SimpleNamespace(per_sample=per_sample, loose=loose)


@pytest.mark.parametrize(
    ("loose_before", "left", "kept_loose"),
    [
        (1e4, 2.0 * CLOSE, True),  # what shows at the joints only was not in the fit before either
        (1e4, 0.9 * CLOSE, False),
        (1.0, 2.0 * CLOSE, False),
    ],
)
def test_a_fit_is_held_against_one_whose_windows_join_as_little(loose_before, left, kept_loose):
    tried = Tried("mains-hum", _fit(1.05, 1e4), _fit(left, 1.0))
    assert _like(_fit(3.0, loose_before), tried) is (tried.loosely if kept_loose else tried.fitted)
