"""Extremum seeking: it climbs, and stays out of chatter."""

import math

import numpy as np
import pytest

from drillenv.controllers.estimate import AMPLITUDE, GAUGE, IMPACTS, LARGEST_PEAK, MEAN_PEAK, RATE
from drillenv.controllers.seeking import BOUNDS, Seeking
from drillenv.env.task import RANGES


def on_a_map(best, start, intervals=240, lag=0.6, noise=0.0, seed=0):
    """Ratios of pressure to amplitude while it drills a map whose progress is largest at ``best`` bar/V.

    Nothing of the drilling rig is in it: the blows have the rating at any setting, and the pressure lags.
    """
    rng = np.random.default_rng(seed)
    controller = Seeking()
    controller.reset(0)
    controller._centre = math.log(start)
    amplitude, pressure, ratios = 0.5, 0.5 * start, []
    for _ in range(intervals):
        ratio = pressure / amplitude
        seen = np.zeros(15)
        seen[IMPACTS], seen[MEAN_PEAK], seen[LARGEST_PEAK] = 1.0, 1.97, 1.97
        seen[AMPLITUDE], seen[GAUGE] = amplitude, pressure
        seen[RATE] = 2.0 * (1.0 - 2.0 * math.log(ratio / best) ** 2) + noise * rng.standard_normal()
        action = controller.act(seen, {})
        _, amplitude, valve = RANGES.mean(axis=1) + 0.5 * action * (RANGES[:, 1] - RANGES[:, 0])
        pressure = valve + (pressure - valve) * math.exp(-0.25 / lag)
        ratios.append(ratio)
    return np.array(ratios)


@pytest.mark.parametrize(("best", "start"), [(2.4, 1.7), (1.8, 2.5), (2.1, 2.1)])
@pytest.mark.parametrize("lag", [0.3, 1.0])
def test_it_climbs_a_known_map_from_either_side_and_stays_on_top(best, start, lag):
    ratios = on_a_map(best, start, lag=lag)
    assert ratios[-48:].mean() == pytest.approx(best, rel=0.03)


def test_it_climbs_through_noise():
    # of half the standard deviation of the sensor; beyond that a minute does not suffice
    found = [on_a_map(2.4, 1.7, noise=0.025, seed=seed)[-48:].mean() for seed in range(6)]
    assert np.mean(found) == pytest.approx(2.4, rel=0.08)


def test_a_map_without_a_top_leads_to_the_end_of_the_range():
    assert on_a_map(3.9, 2.4)[-12:].mean() > 0.95 * BOUNDS[1]


def test_double_blows_move_it_down_at_once():
    controller = Seeking()
    controller.reset(0)
    seen = np.zeros(15)
    seen[IMPACTS], seen[MEAN_PEAK], seen[LARGEST_PEAK], seen[RATE] = 2.0, 0.8, 1.5, 1.5
    seen[AMPLITUDE], seen[GAUGE] = 0.5, 1.2
    centres = []
    for _ in range(3):
        controller.act(seen, {})
        centres.append(controller._centre)
    assert np.all(np.diff(centres) < -0.04)


@pytest.mark.parametrize("case", range(1, 7))
def test_the_barrier_keeps_blows_at_the_rating_and_single(case, drill):
    done = drill(Seeking(), 120, kind="rock", rock=case)
    assert done["single_share"][60:].mean() > 0.95
    assert done["force_excess"][60:].mean() < 25.0
    assert done["mean_peak_force"][60:].mean() > 1700.0
