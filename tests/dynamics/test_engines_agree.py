"""The exact and the hybrid engine share no step: over 500 periods of a stable motion they give the same run."""

import numpy as np
import pytest

from drillenv import Setting, simulate


@pytest.mark.parametrize(
    ("rock", "controls"),
    [(4, (120.0, 0.45, 1.0)), (4, (50.0, 0.45, 1.0)), (2, (120.0, 0.30, 1.0)), (5, (100.0, 0.45, 1.0))],
)
def test_500_periods(rock, controls):
    setting = Setting(*controls)
    seconds = 500 / setting.frequency
    exact = simulate(setting, rock, seconds=seconds, sample_rate=5000.0)
    hybrid = simulate(setting, rock, seconds=seconds, sample_rate=5000.0, engine="hybrid")
    for name in ("indenter_position", "shaker_position", "indenter_speed", "force", "penetration"):
        one, other = getattr(exact, name), getattr(hybrid, name)
        assert np.abs(one - other).max() < 1e-9 * np.abs(one).max(), name
    assert exact.impacts.time.size == hybrid.impacts.time.size
    np.testing.assert_allclose(exact.impacts.time, hybrid.impacts.time, rtol=0, atol=1e-11)
    np.testing.assert_allclose(exact.impacts.force, hybrid.impacts.force, rtol=1e-9)
