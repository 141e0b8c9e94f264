"""The states that windows begin with."""

import numpy as np
import pytest

from drillenv.diagnosis.shooting import shortening


@pytest.mark.parametrize("k3", [0.0, 1e3, 1e8, 7e9, 1e13])
def test_shortening_carries_the_force(k3):
    force = np.array([-3000.0, -1.0, 0.0, 1e-3, 200.0, 3000.0])
    y = shortening(force, 7e4, k3)
    np.testing.assert_allclose(7e4 * y + k3 * y**3, force, rtol=1e-9, atol=1e-12)


def test_a_little_hardening_changes_a_little():
    force = np.linspace(-500.0, 500.0, 11)
    np.testing.assert_allclose(shortening(force, 7e4, 1.0), force / 7e4, rtol=1e-6)
