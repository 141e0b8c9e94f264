"""What a policy knows of a hole: each rig by itself, and what a new bit shows held against what it shows later."""

import numpy as np
import pytest

from drillenv.controllers.hole.belief import BANDS, CENTRE, NEW, SIGNS, SIZE, WIDTH, Belief
from drillenv.controllers.hole.rules import reckoned_wear
from drillenv.env.hole.readings import LOW, READINGS

AT = {reading.name: j for j, reading in enumerate(READINGS)}
WEAR = CENTRE.size
USUAL, FROM_NEW = WEAR + 1, WEAR + 1 + SIGNS
FORCE = WEAR + 1 + 4 * SIGNS
KNOWN, LAST = FORCE + BANDS.size, FORCE + 2 * BANDS.size


def reading(**values):
    """(1, 20) of a rig that drills, but for these."""
    seen = np.array(LOW, dtype=np.float32)
    usual = {"mean_peak_force": 2.0, "largest_peak_force": 2.2, "contact_share": 0.2, "penetration_rate": 1.5,
             "frequency": 100.0, "amplitude": 0.5}  # fmt: skip
    for name, value in (usual | values).items():
        seen[AT[name]] = value
    return seen[None]


def drawn(n, steps):
    rng = np.random.default_rng(3)
    seen = np.concatenate([np.repeat(reading(), n, axis=0)[None]] * steps)
    seen *= rng.uniform(0.8, 1.2, seen.shape).astype(np.float32)
    seen[:, :, AT["bit_blows"]] = 1e-3 * np.arange(steps)[:, None] % 7e-3
    return seen


def test_each_rig_is_remembered_by_itself():
    seen = drawn(3, 20)
    together, alone, some = Belief(3), [Belief(1) for _ in range(3)], Belief(3)
    for now in seen:
        known = together.of(now)
        assert known.shape == (3, SIZE) and known.dtype == np.float32 and np.isfinite(known).all()
        for i in range(3):
            assert np.array_equal(alone[i].of(now[i : i + 1])[0], known[i])
        rows = np.array([0, 2])
        assert np.array_equal(some.of(now[rows], rows), known[rows])


def test_a_rig_is_forgotten_by_itself():
    seen = drawn(2, 9)
    belief = Belief(2)
    for now in seen[:8]:
        belief.of(now)
    belief.forget(np.array([1]))
    known = belief.of(seen[8])
    assert np.array_equal(known[1], Belief(1).of(seen[8, 1:])[0])
    assert not np.array_equal(known[0], Belief(1).of(seen[8, :1])[0])


def test_readings_come_first():
    seen = reading()
    assert Belief(1).of(seen)[0, :WEAR] == pytest.approx(((seen - CENTRE) / WIDTH)[0])


def test_wear_is_reckoned_for_each_bit():
    belief, wear = Belief(1), 0.0
    for step in range(10):
        known = belief.of(reading(bit_blows=0.0015 * step, mean_peak_force=2.5))[0]
        wear += float(reckoned_wear(np.array([1500.0]), np.array([2.5]))[0]) if step else 0.0
        assert known[WEAR] == pytest.approx(wear, rel=1e-5)
        assert list(known[LAST : LAST + 2]) == [0.0, 0.0]
    known = belief.of(reading(bit_blows=0.0))[0]
    assert known[WEAR] == 0.0 and known[LAST : LAST + 2] == pytest.approx([wear, 1.0])


def test_a_bit_is_held_against_itself_when_it_was_new():
    belief = Belief(1)
    for step in range(NEW + 5):
        known = belief.of(reading(bit_blows=0.0015 * step))[0]
        assert known[FROM_NEW : FROM_NEW + SIGNS] == pytest.approx(0.0, abs=1e-6)
    blunt = belief.of(reading(bit_blows=0.02, penetration_rate=0.75, contact_share=0.16))[0]
    assert blunt[FROM_NEW : FROM_NEW + SIGNS] == pytest.approx(2.0 * np.log([0.5, 0.8]), abs=1e-5)
    new = belief.of(reading(bit_blows=0.0, penetration_rate=0.75, contact_share=0.16))[0]
    assert new[FROM_NEW : FROM_NEW + SIGNS] == pytest.approx(0.0, abs=1e-6)


def test_the_force_of_a_volt_is_kept_for_each_band():
    belief = Belief(1)
    belief.of(reading(frequency=87.0, largest_peak_force=1.0))
    known = belief.of(reading(frequency=104.0, largest_peak_force=2.0))[0]
    low, high = (int(np.abs(BANDS - each).argmin()) for each in (87.0, 104.0))
    assert known[KNOWN : KNOWN + BANDS.size].nonzero()[0].tolist() == sorted([low, high])
    assert known[FORCE + high] - known[FORCE + low] == pytest.approx(np.log(2.0), abs=1e-6)
