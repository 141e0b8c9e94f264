"""Random rigs, rocks, settings and effects: nothing sticks, no contact is lost, energy balances.

With settings at 1.8 bar, where contacts chatter and flights are short, and up to three effects at a time.
"""

import os

import numpy as np
import pytest

from drillenv.dynamics.effects import LIBRARY, drawn, make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

MOVING = sorted(name for name, effect in LIBRARY.items() if effect.moves_rig)
RUNS = 10_000 if os.environ.get("DRILLENV_THOROUGH") else 400
BLOCKS = 8
PERIODS = 20


def case(rng):
    """A setting, a rock, a phase and effects."""
    pressure = 1.8 if rng.random() < 0.5 else rng.uniform(0.5, 2.0)
    setting = Setting(rng.uniform(45.0, 130.0), rng.uniform(0.25, 0.65), pressure)
    names = rng.choice(MOVING, int(rng.integers(0, 4)), replace=False)
    effects = tuple((drawn if rng.random() < 0.5 else by_a_form)(str(name), rng) for name in names)
    return setting, ROCKS[int(rng.integers(1, 7))].drawn(rng), float(rng.uniform(0.0, 6.28)), effects


def by_a_form(name, rng):
    """An effect by one of the equations that a diagnosis tries, such as friction that gives, at up to twice a start."""
    effect = LIBRARY[name]
    if not effect.forms:
        return drawn(name, rng)
    form = effect.forms[int(rng.integers(len(effect.forms)))]
    start = form.starts[int(rng.integers(len(form.starts)))]
    bounds = [effect.parameter(symbol) for symbol in form.symbols]
    values = [
        float(np.clip(value * rng.uniform(0.5, 2.0), p.low, p.high)) for value, p in zip(start, bounds, strict=True)
    ]
    return make(name, **dict(zip(form.symbols, values, strict=True)))


def check(run, effects):
    """The energy balances; off the rock means off the rock, in and out have their signs, and forces do not pull."""
    energy = run.energy
    moved = abs(energy.drive) + abs(energy.static) + energy.damper + energy.rock + np.sum(np.abs(energy.effects))
    assert abs(energy.error) < 1e-9 * (moved + energy.stored_before)
    assert np.array_equal(run.switches.before[1:], run.switches.after[:-1])
    assert np.min(run.force) == 0.0 and np.all(run.force[run.regime == 0] == 0.0)
    if all(each.effect.name != "rock-mount-compliance" for each in effects):
        gap = run.x2 - run.penetration
        assert np.max(gap[run.regime == 0], initial=0.0) < 1e-14
        assert np.min(gap[run.regime != 0], initial=0.0) > -1e-14
        assert np.min(run.v2[run.regime == 1], initial=0.0) > -1e-12
        assert np.max(run.v2[run.regime == 2], initial=0.0) < 1e-12


@pytest.mark.parametrize("block", range(BLOCKS))
def test_random_runs(block):
    rng = np.random.default_rng(20261124 + block)
    contacts = 0
    for _ in range(RUNS // BLOCKS):
        setting, rock, phase, effects = case(rng)
        seconds = PERIODS / setting.frequency
        run = run_hybrid(Rig(), setting, rock, seconds, 3e3, phase, effects=effects)
        check(run, effects)
        loose = run_hybrid(Rig(), setting, rock, seconds, 0.0, phase, effects=effects, rtol=1e-7)
        assert loose.impacts.time.size > 0
        contacts += run.impacts.time.size
    assert contacts > 20 * RUNS // BLOCKS
