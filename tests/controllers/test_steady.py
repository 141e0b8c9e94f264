"""The steady state of a rock, and the oracle that acts on it."""

import numpy as np
import pytest

from drillenv import Rock, Setting, controllers, motion
from drillenv.controllers.steady import RATIOS, best_setting, response
from drillenv.env.reward import Reward


def test_the_response_is_that_of_the_orbit():
    # Newton's method on the stroboscopic map, which the response does not use
    known = response(21.40e6, 25.05e6, 120.0)
    for i in np.flatnonzero(known.single)[::8].tolist():
        found = motion(Setting(120.0, 0.45, 0.45 * RATIOS[i]), Rock(21.40e6, 25.05e6))
        assert found.label == "P-1-I-1"
        assert 0.45 * known.force[i] == pytest.approx(found.peak_force, rel=1e-4)
        assert 0.45 * known.rate[i] == pytest.approx(1e3 * found.penetration_rate, rel=1e-4)


@pytest.mark.parametrize("rock", [(11.82e6, 13.90e6), (21.40e6, 25.05e6), (32.73e6, 40.64e6)])
def test_the_best_setting_earns_more_than_those_about_it(rock, drill):
    task = {"kind": "rock", "rock": dict(zip(("loading_stiffness", "unloading_stiffness"), rock, strict=True))}

    def earned(frequency, amplitude, pressure):
        fixed = controllers.make("fixed", frequency=frequency, amplitude=amplitude, pressure=pressure)
        return drill(fixed, 60, **task).rewards[40:].mean()

    best = np.array(best_setting(*rock, Reward()))
    most = earned(*best)
    for step in ([-10, 0, 0], [0, 0.02, 0], [0, -0.02, 0], [0, 0, 0.08], [0, 0, -0.08]):
        near = np.clip(best + step, (50, 0.3, 0.6), (120, 0.6, 1.8))
        assert np.array_equal(near, best) or earned(*near) < most
