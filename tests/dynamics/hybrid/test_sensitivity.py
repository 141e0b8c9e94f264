"""Variational equations and saltation against differences of runs: the flow after a while, by each state."""

import functools

import numpy as np
import pytest

from drillenv.dynamics.effects import EVERYWHERE, LIBRARY, Chosen, Effect, Extra, Parameter, make
from drillenv.dynamics.hybrid.model import model_for, motion_at
from drillenv.dynamics.hybrid.run import SAMPLE_COLUMNS, extras_table, integrate
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.sensitivity import by_state, make_variation, run_varied
from drillenv.dynamics.hybrid.vector_field import (
    AIR_STIFFNESS,
    MOUNT_SQUARE,
    OWN,
    REGIME,
    SIZES_AT,
    UD,
    V1,
    V2,
    Q,
    U,
    W,
    Y,
)
from drillenv.dynamics.motion_hybrid import Section, regime_of
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

SETTING, ROCK, RTOL = Setting(60.0, 0.45, 1.0), ROCKS[4], 1e-13
MOVING = sorted(name for name, effect in LIBRARY.items() if effect.moves_rig)
MORE = {
    "clipped spring": ("force-limit", {"F_s": 190.0}),
    "rounded guide": ("guide-friction", {"fc1": 30.0, "vs1": 3e-3}),
    "rounded indenter": ("indenter-friction", {"fc2": 30.0, "vs2": 5e-2}),
    "a force that pulls": ("tabulated-rate-force", {"x": [-1.0, 1.0], "y": [-400.0, 400.0]}),
    "a tangent": ("tabulated-loading", {"x": [0.0, 300.0, 800.0, 2000.0], "y": [0.4, 0.8, 1.0, 1.1]}),
}


def _lagging(now, own, p, push, rates):
    rates[0] = (now.closing - own[0]) / 2e-3
    push[0] -= p[0] * own[0]
    push[1] += p[0] * own[0]


DAMPING = Parameter("c", "damping", "N s/m", 0.0, 1e4, 0.0, (0.0, 1e3))
LAG = Effect(
    "own-lag", "A damper that lags.", "-", "constitutive", (DAMPING,), ("indenter",), EVERYWHERE, "moves",
    extras=(Extra("s", "speed", "m/s", 0.01),), term=_lagging,
)  # fmt: skip


def effects_of(name):
    if name == "a term with a state":
        return (Chosen(LAG, (600.0,)),)
    if name in MORE:
        effect, values = MORE[name]
        return (make(effect, **values),)
    return (make(name, **{p.symbol: sum(p.typical) / 2 for p in LIBRARY[name].parameters}),)


class Bench:
    """The rig with effects after ten periods and a part, from where it is run on."""

    def __init__(self, effects):
        self.model = model_for(Rig(), SETTING, ROCK, effects)
        self.extras, self.scratch = extras_table(effects), make_scratch(self.model)
        self.begin = motion_at(self.model, effects, None)
        self.run(self.begin, 10.37, True)
        self.moving = [Y, V1, V2, W]
        self.moving += [U, UD] if self.model.s[MOUNT_SQUARE] else []
        self.moving += [Q] if self.model.s[AIR_STIFFNESS] else []
        self.moving += range(OWN, self.model.tally)
        self.sizes = self.model.flat[int(self.model.s[SIZES_AT]) :][: self.model.tally]

    def run(self, motion, periods, begins=False):
        """Run a motion on in place."""
        rows = np.zeros((0, SAMPLE_COLUMNS + len(self.extras)))
        status, *_rest = integrate(
            True, self.model, *motion, begins, periods / SETTING.frequency, 1.0, rows, self.extras, RTOL, self.scratch
        )
        assert status == 0

    def varied(self, periods):
        """(n, n) by the variational equations, and the state reached."""
        n, motion = self.model.tally, self.begin.copy()
        columns, work = by_state(n), make_variation(self.model, n)
        work.v[0] = np.eye(n)
        status, now = run_varied(self.model, *motion, periods / SETTING.frequency, RTOL, columns, work, self.scratch)
        assert status == 0 and now == periods / SETTING.frequency
        return work.v[0], motion

    def differences(self, periods, state):
        """(n,) by central differences of two lengths, extrapolated."""
        found = []
        for step in (3e-5 * self.sizes[state], 1.5e-5 * self.sizes[state]):
            ends = []
            for way in (1.0, -1.0):
                motion = self.begin.copy()
                motion.z[state] += way * step
                self.run(motion, periods)
                ends.append(motion.z[: self.model.tally].copy())
            found.append((ends[0] - ends[1]) / (2.0 * step))
        return (4.0 * found[1] - found[0]) / 3.0


@functools.cache
def bench(name):
    return Bench(effects_of(name))


@pytest.mark.parametrize("periods", [0.93, 2.1])
@pytest.mark.parametrize("name", [*MOVING, *MORE, "a term with a state"])
def test_sensitivities_are_those_of_differences(name, periods):
    """Through landings, turns, releases, stops, breakaways and corners; states over their sizes, beside the largest."""
    rig = bench(name)
    by_equations, motion = rig.varied(periods)
    plain = rig.begin.copy()
    rig.run(plain, periods)
    assert np.allclose(plain.z, motion.z, rtol=0.0, atol=1e-13) and plain.d[REGIME] == motion.d[REGIME]
    by_differences = np.stack([rig.differences(periods, state) for state in rig.moving], axis=1)
    size = rig.sizes[rig.moving]
    ours = by_equations[np.ix_(rig.moving, rig.moving)] * size / size[:, None]
    theirs = by_differences[rig.moving] * size / size[:, None]
    assert np.max(np.abs(ours - theirs)) < 1e-6 * np.max(np.abs(theirs))


@pytest.mark.parametrize("name", ["contact-toe", "rock-mount-compliance", "indenter-friction", "force-limit"])
def test_tangent_of_the_return_map(name):
    """In flight and in contact, whichever regime counts the depth."""
    section = Section(SETTING, ROCK, Rig(), effects_of(name))
    flying = section.after(section.fresh(), 20)
    y, v1 = flying.z[[Y, V1]]
    places = [flying, section.at(y, v1, 0.1, 4e-5), section.at(y, v1, -0.1, 4e-5)]
    assert [regime_of(place) for place in places] == [0, 1, 2]
    for place in places:
        point = section.point(place, regime_of(place))
        by_equations, by_differences = section.tangent(place, point, 1), section.tangent_by_differences(place, point, 1)
        assert np.max(np.abs(by_equations - by_differences)) < 1e-5 * np.max(np.abs(by_differences))
