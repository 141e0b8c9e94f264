"""The share of a mismatch that is explained, and the verdict that follows from it."""

import math

import numpy as np
import pytest

from drillenv.diagnosis.evidence import Explained, classify, explained
from drillenv.diagnosis.thresholds import WELL_EXPLAINED

HALF, MOST = Explained(0.5, 0.4, 0.6, "rows"), Explained(0.95, 0.9, 0.99, "rows")
NARROWLY = Explained(0.85, WELL_EXPLAINED - 0.05, 0.9, "rows")


def test_the_interval_of_a_share_covers_it():
    """Of made parts, each with a mismatch of its own and noise of its own: 95 % of intervals hold the true share."""
    rng, true, inside = np.random.default_rng(3), 0.9, 0
    for _ in range(300):
        size = rng.gamma(4.0, 25.0, 60)
        before, after = size + rng.normal(0.0, 5.0, 60), (1.0 - true) * size + rng.normal(0.0, 5.0, 60)
        found = explained(before, after, "parts")
        inside += found.low <= true <= found.high
        assert found.low <= found.share <= found.high
    assert 0.90 * 300 <= inside <= 0.99 * 300


def test_a_share_is_never_above_one():
    found = explained(np.array([10.0, 12.0, 9.0]), np.array([-1.0, -0.5, -2.0]), "parts")
    assert found.share == found.high == 1.0 and found.record["interval"] == [1.0, 1.0]


def test_nothing_is_explained_of_no_mismatch():
    found = explained(np.array([-1.0, 0.5, -2.0]), np.array([-1.0, 0.5, -2.0]), "parts")
    assert found.share == 0.0 and math.isfinite(found.low) and math.isfinite(found.high)


def test_where_no_mismatch_is_seen_nothing_is_proved():
    """However little the corrected model leaves."""
    found = explained(np.array([-1.0, -0.5, -2.0]), np.array([-3.0, -2.5, -4.0]), "parts")
    assert found.share == found.low == found.high == 0.0
    assert found.sentence == "The mismatch does not stand out of the noise on parts."
    assert classify(True, False, False, True, found) == "unexplained"
    before, after = np.full(20, 4.0), np.full(20, 8.0)
    assert explained(before, after, "parts", 10_000).share == 0.0
    assert explained(before, after, "parts", 1_000).share == -1.0


def test_of_parts_that_a_model_cannot_follow_nothing_is_explained():
    before = np.array([10.0, 12.0, 9.0, 11.0])
    found = explained(before, np.array([0.0, 0.0, math.inf, 0.0]), "parts")
    assert found.share == pytest.approx(33.0 / 42.0)
    assert explained(before * math.inf, before, "parts").share == 0.0


def test_the_same_parts_give_the_same_interval():
    before, after = np.arange(1.0, 21.0), np.full(20, 0.5)
    assert explained(before, after, "a") == explained(before, after, "a")
    assert "on a" in explained(before, after, "a").sentence


@pytest.mark.parametrize(
    ("found", "outside", "off", "left", "gone", "verdict"),
    [
        (False, False, False, False, HALF, "agrees"),
        (False, False, True, False, HALF, "parameters"),
        (False, False, False, True, HALF, "unexplained"),
        (False, False, True, True, MOST, "parameters"),
        (True, False, False, False, HALF, "missing-physics"),
        (True, False, True, True, MOST, "missing-physics"),
        (True, False, False, True, HALF, "unexplained"),
        (True, False, False, True, NARROWLY, "unexplained"),
        (True, True, False, False, MOST, "unexplained"),
    ],
)
def test_the_verdict(found, outside, off, left, gone, verdict):
    """A mechanism that holds is said as long as what is left is noise, or little of the mismatch for certain."""
    assert classify(found, outside, off, left, gone) == verdict
