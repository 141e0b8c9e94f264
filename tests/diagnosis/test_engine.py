"""Models on the engine: against the concealed rig's motion, and derivatives by laws against differences."""

import math
from itertools import pairwise

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.blind.rig import Constants, Controls, Motion, Physics, move
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.engine import Column, assembled, columns_of, equation_change, equation_tables
from drillenv.diagnosis.equations import Around, curve_at
from drillenv.diagnosis.tables import GRID, PLACES, Axes, table_of
from drillenv.diagnosis.terms import Law, Model
from drillenv.dynamics.constitutive.places import (
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    LOADING,
    MOUNT_DAMPER,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    WAVEFORM,
)
from drillenv.dynamics.constitutive.tables import NotSmoothError
from drillenv.dynamics.effects import REGISTRY
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.dynamics.hybrid.model import fresh_motion
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.sensitivity import LAW, make_variation
from drillenv.dynamics.hybrid.shooting import UNCHAINED, Shot, Windows, shoot
from tests.diagnosis.truth import rig_of, rock_of

LAWS = {
    LOADING: 0.2, UNLOADING: 0.2, RATE_FACTOR: 0.1, RATE_FORCE: 40.0, COMPACTION: -0.2, SPRING: 15.0,
    SPRING_FROM_REST: 15.0, DAMPER: 15.0, GUIDE: 15.0, INDENTER: 15.0, WAVEFORM: 0.1, DRIVE: 20.0,
    MOUNT_SPRING: 8.0, MOUNT_DAMPER: 8.0,
}  # fmt: skip
"""A strength of each place's law."""
REACH = {
    LOADING: 1e-4, UNLOADING: 1e-4, RATE_FACTOR: 0.4, RATE_FORCE: 0.4, COMPACTION: 100.0, SPRING: 5e-3,
    SPRING_FROM_REST: 2e-3, DAMPER: 0.4, GUIDE: 5e-3, INDENTER: 0.4, WAVEFORM: 7.0, DRIVE: 600.0,
    MOUNT_SPRING: 5e-5, MOUNT_DAMPER: 0.05,
}  # fmt: skip
"""The largest argument at each place."""


class Bench:
    """One recording with next to no noise, and its true model."""

    def __init__(self):
        made = plain_campaign(np.random.default_rng(5), noise=(1e-6, 1e-4, 1e-4), recordings=2, seconds=0.2)
        rig, rock, recording = rig_of(made), rock_of(made), made.campaign.recordings[0]
        self.data = condition(recording, rig)
        assert recording.setting is not None
        self.model = Model()
        s = self.model.s
        s[[V.M1, V.M2, V.K, V.C]] = rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping
        s[V.F_A], s[V.F_B] = rig.drive_force(recording.setting), rig.static_force(recording.setting)
        s[V.KL], s[V.KU] = rock.loading_stiffness, rock.unloading_stiffness
        first = [0.0 if place in (LOADING, UNLOADING) else -0.1 for place in range(PLACES)]
        self.axes = Axes(
            np.array([10.0 * REACH[place] for place in range(PLACES)]),
            np.arcsinh(first),
            (np.arcsinh(0.1) - np.arcsinh(first)) / (GRID - 1),
        )
        force, damper, v2, w = self.data.states.T
        self.begin = np.zeros((len(self.data.starts) - 1, V.OWN))
        self.begin[:, :4] = np.column_stack([force / rig.stiffness, v2 + damper / rig.damping, v2, w])

    def run(self, model, columns=(), rtol=1e-10):
        """What the engine says: force and acceleration, and their derivatives."""
        data = self.data
        made = assembled(model, self.axes, data.omega, [each.place for each in columns if each.change is not None])
        varied = np.zeros((len(self.begin), len(columns), V.OWN))
        windows = Windows(data.starts, self.begin.copy(), varied, data.rate, data.phase, 0.0, 0.0, UNCHAINED, 1, 0.0)
        return shot(made, windows, columns_of(columns, model, self.axes, made, 0), rtol)


def shot(made, windows, columns, rtol):
    n, count, size = len(windows.starts) - 1, columns.kind.size, int(windows.starts[-1])
    found = Shot(
        np.zeros((V.OWN, size)),
        np.zeros((2, size)),
        np.zeros((count, 2, size)),
        np.zeros((n, V.OWN)),
        np.zeros((n, count, V.OWN)),
    )
    work, scratch = make_variation(made.model, count), make_scratch(made.model)
    status, _made = shoot(made.model, fresh_motion(made.model).d, rtol, windows, columns, found, work, scratch)
    assert status == 0
    return found


@pytest.fixture(scope="module")
def bench():
    return Bench()


def apart(bench, one, other):
    """Median over windows of how far two signals are apart, over the second's size."""
    found = []
    for first, last in pairwise(bench.data.starts):
        a, b = one[..., first:last], other[..., first:last]
        if np.any(b):
            found.append(float(np.linalg.norm(a - b) / np.linalg.norm(b)))
    return float(np.median(found))


def test_the_motion_is_that_of_the_concealed_rig(bench):
    """From one state in flight on, over a tenth of a second of a rig that shares no code with this one."""
    true, controls = Constants(), Controls(80.0, 0.45, 1.0)
    motion = move(true, controls, Physics.none(), 0.15, 1.0 / 204800.0, 0.3, 1.2)
    kept = Motion(*(each[::8] for each in motion))
    first = int(np.flatnonzero(kept.regime[:640] == 0)[0])
    starts = np.array([first, first + 2560])
    begin = np.zeros((1, V.OWN))
    v2 = kept.v2[first]
    begin[0, :4] = kept.shortening[first], v2 + kept.closing[first], v2, kept.depth[first]
    model = Model()
    s = model.s
    s[[V.M1, V.M2, V.K, V.C]] = true.shaker_mass, true.indenter_mass, true.stiffness, true.damping
    s[V.F_A] = (2.40 * controls.frequency + 876.19) * controls.amplitude
    s[V.F_B] = 196.35 * controls.pressure
    s[V.KL], s[V.KU] = true.loading_stiffness, true.unloading_stiffness
    made = assembled(model, bench.axes, 2.0 * math.pi * controls.frequency)
    windows = Windows(starts, begin, np.zeros((1, 0, V.OWN)), 25600.0, 0.3, 0.0, 0.0, UNCHAINED, 1, 0.0)
    found = shot(made, windows, columns_of((), model, bench.axes, made, 0), 1e-9)
    inside = slice(*starts)
    for simulated, measured in zip(found.signals, (kept.rock, kept.acceleration), strict=True):
        assert np.max(np.abs(simulated[inside] - measured[inside])) < 1e-3 * np.max(np.abs(measured[inside]))
    # on the rock, w is the force of the rock law over k_l in both of its ways
    on = kept.regime[inside] != 0
    w = found.path[V.W, inside][on] * true.loading_stiffness
    assert np.max(np.abs(w - kept.rock[inside][on])) < 1e-3 * np.max(kept.rock)


@pytest.mark.parametrize("place", sorted(LAWS))
def test_derivatives_by_free_laws(bench, place):
    """About a law that is there, by its size."""
    x = bench.axes.points(place) / REACH[place]
    law = LAWS[place] * (x + 0.5 * x**2)

    def with_share(share):
        model = Model(bench.model.s.copy())
        if place in (MOUNT_SPRING, MOUNT_DAMPER):
            model.s[[V.MOUNT_GAIN, V.MOUNT_SQUARE, V.MOUNT_DAMPING]] = 0.02, (2.0 * np.pi * 150.0) ** 2, 200.0
        model.free[place] = share * law
        return model

    found = bench.run(with_share(1.0), [Column(int(LAW), place=place, change=law)])
    step = 1e-4
    difference = bench.run(with_share(1.0 + step)).signals - bench.run(with_share(1.0 - step)).signals
    assert apart(bench, found.by_column[0], difference / (2.0 * step)) < 2e-3


@pytest.mark.parametrize("place", [LOADING, UNLOADING])
def test_a_factor_over_w_is_a_shape_over_the_depth(bench, place):
    """dw/dx = 1 + a w / d, solved by hand: w = (d / a) (exp(a x / d) - 1)."""
    a, d = 0.7, 1e-4
    values = np.log(1.0 + a * bench.axes.points(place) / d)
    table = table_of(values, bench.axes, place)
    x = np.linspace(0.0, 0.9 * table.knots[-1], 300)
    np.testing.assert_allclose(table(x), d / a * np.expm1(a * x / d), rtol=1e-6, atol=1e-16)


@pytest.mark.parametrize("place", [LOADING, UNLOADING])
def test_a_law_of_the_contact_that_changes_too_fast_is_refused(bench, place):
    """A search may come to one; its integral in between points is not the law's, and may fall."""
    values = np.where(np.arange(GRID) // 2 % 2 == 0, 5.0, -5.0)
    with pytest.raises(NotSmoothError, match="too fast"):
        table_of(values, bench.axes, place)


@pytest.mark.parametrize(
    ("name", "p", "j", "share"),
    [
        ("contact-power-law", (1.3,), 0, 1e-5),
        ("contact-toe", (2e-5, 0.2, 0.5), 0, 1e-5),
        ("force-limit", (250.0, 300.0, 1e9, 0.0, 1e6, 1e6), 0, 1e-5),
        ("backlash", (4e-4, -1e-4, 0.0, 0.0), 0, 1e-5),
        ("damping-quadratic", (600.0, 2.0), 0, 1e-5),
        ("damping-quadratic", (300.0, 1.5), 1, 1e-5),
        ("rock-compaction", (0.3, 20.0, 0.0), 1, 1e-5),
    ],
)
def test_derivatives_by_parameters_of_equations(bench, name, p, j, share):
    form = next(each for each in REGISTRY[name].forms)

    def law(values):
        return Law(name, form, values, bench.axes)

    def at(values):
        model = Model(bench.model.s.copy())
        model.laws.append(law(values))
        return model

    step = share * p[j]
    ahead, behind = (tuple(v + (way * step if i == j else 0.0) for i, v in enumerate(p)) for way in (1.0, -1.0))
    k = float(bench.model.s[V.K])
    changes = equation_change(law(p), law(ahead), k, k)
    columns = [Column(int(LAW), law=i, pieces=each.pieces / step) for i, each in enumerate(changes)]
    found = bench.run(at(p), columns).by_column.sum(axis=0)
    difference = (bench.run(at(ahead)).signals - bench.run(at(behind)).signals) / (2.0 * step)
    assert apart(bench, found, difference) < 5e-3


@pytest.mark.parametrize("name", ["contact-power-law", "contact-toe"])
def test_an_equation_of_the_contact_is_the_same_as_a_factor(bench, name):
    """The shape over the depth that the engine takes, and the factor over w that the diagnosis shows."""
    p = tuple(sum(each.typical) / 2 for each in REGISTRY[name].parameters)
    form = REGISTRY[name].forms[0]
    s = bench.model.s
    around = Around(float(s[V.K]), float(s[V.KL]), float(s[V.KU]))
    tables = {place: (over, table) for place, over, table in equation_tables(name, form, p, around.k)}
    for place, stiff in ((LOADING, around.kl), (UNLOADING, around.ku)):
        over, table = tables[place]
        scale = {0: 1.0, 1: stiff / around.kl, 2: stiff}[over]
        depth = np.linspace(1e-6, 1e-4, 50)
        w = stiff / around.kl * table(depth * scale) / scale
        ahead, behind = (stiff / around.kl * table(depth * (1 + e) * scale) / scale for e in (1e-4, -1e-4))
        factor = (ahead - behind) / (2e-4 * depth) * around.kl / stiff
        np.testing.assert_allclose(curve_at(name, p, place, w, around), factor, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("contact-rate", RATE_FACTOR),
        ("rock-compaction", COMPACTION),
        ("stiffness-hardening", SPRING),
        ("damping-quadratic", DAMPER),
        ("drive-harmonics", WAVEFORM),
    ],
)
def test_an_equation_with_a_free_correction_is_the_curve_that_is_shown(bench, name, place):
    """The engine has them as two laws, and the curve of both as one."""
    p = tuple(sum(each.typical) / 2 for each in REGISTRY[name].parameters)
    x = bench.axes.points(place) / REACH[place]
    both, one = Model(bench.model.s.copy()), Model(bench.model.s.copy())
    both.laws.append(Law(name, REGISTRY[name].forms[0], p, bench.axes))
    both.free[place] = LAWS[place] * (x + 0.5 * x**2) + (0.3 if place == COMPACTION else 0.0)
    one.free[place] = both.curve(place)
    alone = Model(bench.model.s.copy(), both.free.copy())
    expected = bench.run(both).signals
    assert apart(bench, bench.run(one).signals, expected) < 1e-3 < apart(bench, bench.run(alone).signals, expected)
