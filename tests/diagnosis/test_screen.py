"""What the luckiest of all candidates gains by chance."""

import itertools

import numpy as np
import pytest
from scipy.stats import chi2

from drillenv.diagnosis.screen import FALSE_ALARMS, luck


def curvature_of(columns):
    return columns.T @ columns


def slots_of(known, *counts):
    ends = known + np.cumsum([0, *counts])
    return [np.arange(low, high) for low, high in itertools.pairwise(ends.tolist())]


def test_of_independent_candidates_each_has_its_share():
    columns = np.linalg.qr(np.random.default_rng(0).standard_normal((200, 3 + 20)))[0]
    chance = luck(curvature_of(columns), 3, slots_of(3, *[1] * 20), np.random.default_rng(1), draws=40000)
    assert chance == pytest.approx(1.0 - (1.0 - FALSE_ALARMS) ** (1 / 20), rel=0.15)


def test_candidates_that_are_the_same_count_once():
    rng = np.random.default_rng(0)
    one = rng.standard_normal((200, 1))
    columns = np.hstack([rng.standard_normal((200, 3)), *[one * k for k in range(1, 21)]])
    curvature = curvature_of(columns)
    curvature[np.diag_indices(23)] *= 1 + 1e-12
    chance = luck(curvature, 3, slots_of(3, *[1] * 20), np.random.default_rng(1), draws=40000)
    assert chance == pytest.approx(FALSE_ALARMS, rel=0.15)


def test_noise_drawn_for_the_columns_themselves_gains_as_seldom():
    """Columns that overlap with each other and with the constants, of several strengths, and data of noise alone."""
    rng = np.random.default_rng(2)
    counts = (1, 4, 1, 2, 8, 1, 1)
    columns = rng.standard_normal((400, 5 + sum(counts))) @ rng.standard_normal((5 + sum(counts), 5 + sum(counts)))
    slots = slots_of(5, *counts)
    chance = luck(curvature_of(columns), 5, slots, np.random.default_rng(3), draws=20000)
    alarms = 0
    for _ in range(3000):
        noise = rng.standard_normal(400)
        plain = noise - columns[:, :5] @ np.linalg.lstsq(columns[:, :5], noise)[0]
        for slot in slots:
            both = np.concatenate([np.arange(5), slot])
            left = noise - columns[:, both] @ np.linalg.lstsq(columns[:, both], noise)[0]
            if chi2.sf(plain @ plain - left @ left, slot.size) < chance:
                alarms += 1
                break
    # 30 are expected, with a standard deviation of 5.4
    assert 14 <= alarms <= 48
