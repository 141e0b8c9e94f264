"""What a policy is given of a hole beside estimates: readings first, and the wear that is reckoned for each bit."""

import numpy as np
import pytest

from drillenv.controllers.hole.belief import CENTRE, RECKONED, SHOWN, WIDTH, Belief, Features
from drillenv.controllers.hole.rules import reckoned_wear
from drillenv.env.hole.bit import CHATTER
from drillenv.env.hole.readings import LOW, READINGS

AT = {reading.name: j for j, reading in enumerate(READINGS)}
WORN = slice(SHOWN, SHOWN + RECKONED)


def reading(**values):
    """(1, 20) of a rig that drills by single blows, but for these."""
    seen = np.array(LOW, dtype=np.float32)
    usual = {"mean_peak_force": 2.0, "largest_peak_force": 2.2, "impacts_per_cycle": 1.0, "contact_share": 0.2,
             "penetration_rate": 1.5, "frequency": 100.0, "amplitude": 0.5}  # fmt: skip
    for name, value in (usual | values).items():
        seen[AT[name]] = value
    return seen[None]


def test_readings_come_first():
    seen = reading()
    assert Belief(1).of(seen)[0, : CENTRE.size] == pytest.approx(((seen - CENTRE) / WIDTH)[0])


def test_wear_is_reckoned_for_each_bit():
    features, wear = Features(1), np.zeros(2)
    for step in range(10):
        given = features.of(reading(bit_blows=0.0015 * step, mean_peak_force=2.5))[0]
        wear += reckoned_wear(np.array([1500.0]), np.array([2.5]))[0] if step else 0.0
        assert given[WORN] == pytest.approx(wear, rel=1e-4)
    new = features.of(reading(bit_blows=0.0005, mean_peak_force=2.5))[0]
    assert new[WORN] == pytest.approx(reckoned_wear(np.array([500.0]), np.array([2.5]))[0], rel=1e-4)


@pytest.mark.parametrize("readings", [{"impacts_per_cycle": 2.0}, {"period_two": 0.5}])
def test_chatter_wears_more(readings):
    single, chatter = Features(1), Features(1)
    for blows in (0.0, 0.001):
        one, other = single.of(reading(bit_blows=blows))[0], chatter.of(reading(bit_blows=blows, **readings))[0]
    assert other[WORN] == pytest.approx((1.0 + CHATTER) * one[WORN], rel=1e-5)
