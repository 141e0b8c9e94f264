"""The filter that stands for the structure, against the simulated rig and against a state-space integration."""

import numpy as np
import pytest
import scipy.linalg

import drillenv
from drillenv.recordings.structure import acceleration_from, contact_frequency, response_at, settling_time


@pytest.mark.parametrize("place", [(118.0, 0.55, 0.8), (57.0, 0.4, 1.5), (88.0, 0.6, 0.7)])
def test_force_and_drive_give_the_acceleration_of_the_simulated_rig(place, rig_nominal):
    rate = 102400.0
    run = drillenv.simulate(place, seconds=1.0, sample_rate=rate)
    frequency, amplitude, pressure = place
    drive = (2.40 * frequency + 876.19) * amplitude * np.sin(2 * np.pi * frequency * run.time)
    predicted = acceleration_from(drive - run.force + 196.35 * pressure, rate, rig_nominal)
    late = run.time > 5 * settling_time(rig_nominal)
    left = (predicted - run.acceleration)[late]
    # the static force balances the mean of the rock's; what is left is the step of the filter
    assert left.std() < 2e-3 * run.acceleration[late].std()


def test_the_response_is_that_of_the_equations_of_motion(rig_nominal):
    """m1 X1'' = -k (X1 - X2) - c (X1' - X2'), m2 X2'' = F + k (X1 - X2) + c (X1' - X2'), solved as a linear system."""
    m1, m2, k, c = 265.0, 3.0, 68850.0, 2450.0
    inertia, damping, stiffness = np.diag([m1, m2]), c * np.array([[1, -1], [-1, 1]]), k * np.array([[1, -1], [-1, 1]])
    for frequency in (0.5, 17.0, 60.0, 120.0, 900.0):
        w = 2 * np.pi * frequency
        moved = scipy.linalg.solve(-(w**2) * inertia + 1j * w * damping + stiffness, np.array([0.0, 1.0]))
        assert response_at(frequency, rig_nominal) == pytest.approx(-(w**2) * moved[1], rel=1e-9)


def test_times_and_frequencies(rig_nominal):
    assert contact_frequency(rig_nominal) == pytest.approx(459.9, abs=0.1)  # sqrt(25.05e6 / 3) / 2 pi
    # the slow root of s^2 + (c s + k) (1/m1 + 1/m2), near k / c = 28.1 1/s
    assert 1 / settling_time(rig_nominal) == pytest.approx(29.2, abs=0.2)
