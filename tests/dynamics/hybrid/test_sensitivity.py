"""Variational equations and saltation against differences of runs: the flow after a while, by each state
and by what the model is made of."""

import functools

import numpy as np
import pytest

from drillenv.dynamics.constitutive.tables import DEGREE
from drillenv.dynamics.effects import EVERYWHERE, LIBRARY, Chosen, Effect, Extra, Parameter, make
from drillenv.dynamics.hybrid.model import model_for, motion_at
from drillenv.dynamics.hybrid.run import SAMPLE_COLUMNS, extras_table, integrate
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.sensitivity import LAW, Columns, by_state, make_variation, run_varied
from drillenv.dynamics.hybrid.vector_field import (
    AIR_PER_LENGTH,
    AIR_RATE,
    AIR_STIFFNESS,
    BED,
    BED_DAMPING,
    BED_SHARE,
    BED_SPEED,
    BED_SQUARE,
    BENT1,
    BENT2,
    BRISTLE_DAMPING1,
    BRISTLE_DAMPING2,
    BRISTLES1,
    BRISTLES2,
    COEFFICIENTS,
    COMPACTION_LENGTH,
    CONTACT_DAMPING,
    CONTACT_DAMPING_POWER,
    DRIVE_DELAY,
    DRIVE_LAG,
    DRIVEN,
    F_A,
    F_B,
    FIRST,
    GRIP1,
    GRIP2,
    KL,
    KU,
    M1,
    M2,
    MOUNT_DAMPING,
    MOUNT_GAIN,
    MOUNT_SQUARE,
    OMEGA,
    OWN,
    PIECE_COLUMNS,
    PIECES,
    PIECES_AT,
    REGIME,
    ROTATION,
    ROTATION_PHASE,
    ROTATION_RATE,
    ROTATION_SHARE,
    SIZES_AT,
    SLEW_RATE,
    SLEW_SHARE,
    SLEWING,
    SLIDING1,
    SLIDING2,
    THETA,
    TIME,
    UD,
    V1,
    V2,
    C,
    K,
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
    "compaction over the depth": ("rock-compaction", {"soft": 0.4, "soft_l": 1e-4}),
    "a drive of limited slew rate": ("force-limit", {"S_max": 1.3e5, "tau_f": 5e-5}),
    "a drive that ramps": ("force-limit", {"S_max": 8e4}),
    "rounded guide": ("guide-friction", {"fc1": 30.0, "vs1": 3e-3}),
    "rounded indenter": ("indenter-friction", {"fc2": 30.0, "vs2": 5e-2}),
    "bristles of the guide": ("guide-friction", {"fc1": 40.0, "ds1": 1e-6, "sd1": 7e3, "rs1": 0.4, "vr1": 1e-3}),
    "bristles of the indenter": (
        "indenter-friction",
        {"fc2": 40.0, "ds2": 1e-5, "sd2": 150.0, "rs2": 0.4, "vr2": 0.05},
    ),
    "enclosed gas": ("air-spring", {"g_a": 300.0, "tau": 0.2}),
    "a force that pulls": ("tabulated-rate-force", {"x": [-1.0, 1.0], "y": [-400.0, 400.0]}),
    "a damper of the rock": ("contact-rate", {"c_d": 300.0}),
    "damping by the root of the depth": ("contact-rate", {"c_d": 300.0, "p_d": 0.5}),
    "damping by the fourth root of the depth": ("contact-rate", {"chi": 0.2, "c_d": 300.0, "p_d": 0.25}),
    "a bed under the mount": (
        "rock-mount-compliance",
        {"s_r": 2e-8, "m_r": 25.0, "zeta_r": 0.1, "m_b": 90.0, "s_b": 1.5e-8, "zeta_b": 0.07},
    ),
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
        self.moving += [Q] if self.model.s[AIR_STIFFNESS] or self.model.s[AIR_PER_LENGTH] else []
        self.moving += [BENT1] if self.model.s[BRISTLES1] else []
        self.moving += [BENT2] if self.model.s[BRISTLES2] else []
        self.moving += [BED, BED_SPEED] if self.model.s[BED_SQUARE] else []
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
    # how far bristles are bent is a place, as exact as the others, and their force that times their stiffness
    size = np.ones(plain.z.size)
    size[[BENT1, BENT2]] = np.maximum(rig.model.s[[BRISTLES1, BRISTLES2]], 1.0)
    assert np.max(np.abs(plain.z - motion.z) / size) <= 1e-13 and plain.d[REGIME] == motion.d[REGIME]
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
        by_equations, columns = section.tangent(place, point, 1), []
        for step in 1e-5 * np.eye(point.size):
            ahead, behind = (section.returned(place, point + way * step, 1) for way in (1.0, -1.0))
            columns.append((ahead - behind) / 2e-5)
        by_differences = np.stack(columns, axis=1)
        assert np.max(np.abs(by_equations - by_differences)) < 1e-5 * np.max(np.abs(by_differences))


SCALARS = [M1, M2, K, C, F_A, F_B, KL, KU, MOUNT_GAIN, MOUNT_SQUARE, MOUNT_DAMPING, AIR_STIFFNESS, AIR_PER_LENGTH,
           AIR_RATE, DRIVE_LAG, ROTATION_SHARE, ROTATION_RATE, ROTATION_PHASE, GRIP1, GRIP2, BRISTLES1, BRISTLES2,
           SLIDING1, SLIDING2, BRISTLE_DAMPING1, BRISTLE_DAMPING2, CONTACT_DAMPING, CONTACT_DAMPING_POWER, BED_SHARE,
           BED_SQUARE, BED_DAMPING, SLEW_RATE, SLEW_SHARE, DRIVE_DELAY,
           COMPACTION_LENGTH]  # fmt: skip
"""By which a column may be."""


def pieces_of(model, law):
    """(pieces, DEGREE + 1) the coefficients of a law, not a copy."""
    first, count = int(model.laws[law, FIRST]), int(model.laws[law, PIECES])
    return model.flat[PIECES_AT:][: (first + count) * PIECE_COLUMNS].reshape(-1, PIECE_COLUMNS)[first:, COEFFICIENTS:]


@pytest.mark.parametrize("name", [*MOVING, *MORE])
def test_sensitivities_by_scalars_and_laws_are_those_of_differences(name):
    """Of each scalar that is there, and of the size of each law; in a contact that has begun, its factor stays."""
    rig, periods = bench(name), 2.1
    scalars = [at for at in SCALARS if rig.model.s[at] != 0.0]
    laws = range(len(rig.model.laws))
    pieces = [pieces_of(rig.model, law) for law in laws]
    count, rows = len(scalars) + len(laws), np.cumsum([0, *map(len, pieces)])
    columns = Columns(
        np.array([*scalars, *[LAW] * len(laws)], dtype=np.int64),
        np.array([*[0] * len(scalars), *laws], dtype=np.int64),
        np.array([*[0] * len(scalars), *rows[:-1]], dtype=np.int64),
        np.zeros(count),
        np.concatenate([np.zeros((0, DEGREE + 1)), *pieces]),
    )
    work, motion = make_variation(rig.model, count), rig.begin.copy()
    status, _now = run_varied(rig.model, *motion, periods / SETTING.frequency, RTOL, columns, work, rig.scratch)
    assert status == 0

    def ends(column, change):
        other = rig.model._replace(flat=rig.model.flat.copy())
        if column < len(scalars):
            other.flat[scalars[column]] += change
        else:
            pieces_of(other, laws[column - len(scalars)])[...] *= 1.0 + change
        motion, rows = rig.begin.copy(), np.zeros((0, SAMPLE_COLUMNS + len(rig.extras)))
        if column < len(scalars) and scalars[column] == ROTATION_RATE:
            # it has turned like this since time 0
            motion.d[ROTATION] += change * motion.d[TIME]
        if motion.d[SLEWING] == 0.0:
            # and a drive that follows has followed this
            m = other.flat
            motion.d[DRIVEN] = m[F_A] * np.sin(motion.d[THETA] - m[OMEGA] * m[DRIVE_DELAY])
        status, *_rest = integrate(
            True, other, *motion, False, periods / SETTING.frequency, 1.0, rows, rig.extras, RTOL, rig.scratch
        )
        assert status == 0
        return motion.z[: other.tally]

    for column in range(count):
        step = 3e-5 * (abs(rig.model.s[scalars[column]]) if column < len(scalars) else 1.0)
        one, two = ((ends(column, h) - ends(column, -h)) / (2.0 * h) for h in (step, 0.5 * step))
        ours, theirs = work.v[0, :, column] / rig.sizes, (4.0 * two - one) / 3.0 / rig.sizes
        assert np.max(np.abs(ours - theirs)) < 1e-6 * np.max(np.abs(theirs)) + 1e-12, column
