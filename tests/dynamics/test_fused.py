"""Kernels round alike in every run: fresh from the compiler or out of the cache, with others around them or alone."""

import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from drillenv.dynamics.fused import fma


@njit
def fused(a, b, c):
    return fma(a, b, c)


def test_one_rounding():
    rng = np.random.default_rng(0)
    for a, b in rng.normal(size=(200, 2)):
        c = -a * b  # what is left of the product after its own rounding
        assert fused(a, b, c) == float(Fraction(a) * Fraction(b) + Fraction(c))
    assert fused(3, 0.5, 2) == 3.5, "whole numbers are taken as they are"


CHAOS = """
import hashlib, gymnasium, numpy, drillenv
env = gymnasium.make("drillenv/Drill-v0")
env.reset(seed=3)
env.action_space.seed(1)
seen = hashlib.sha256()
for _ in range(200):
    observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    seen.update(observation.tobytes() + numpy.float64(reward).tobytes())
    if terminated or truncated:
        env.reset()
print(seen.hexdigest())
"""


@pytest.mark.thorough
@pytest.mark.slow
def test_fresh_from_the_compiler_as_out_of_the_cache(tmp_path):
    """Two seconds after the rounding of one kernel differs, random settings on a chaotic rig show it."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    fresh, cached = (
        subprocess.run(
            [sys.executable, "-c", CHAOS], env=environment, capture_output=True, text=True, check=True, timeout=300
        ).stdout
        for _ in range(2)
    )
    assert fresh == cached
