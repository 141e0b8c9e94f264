"""The rig over windows: its motion against the concealed rig's, its sensitivities against differences."""

from itertools import pairwise

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.blind.rig import Constants, Controls, Motion, Physics, move
from drillenv.diagnosis import predict as P
from drillenv.diagnosis.condition import condition
from drillenv.dynamics.effects import make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS
from tests.diagnosis.truth import rig_of, rock_of

CURVES = {
    P.LOADING: 0.2, P.UNLOADING: 0.2, P.RATE_FACTOR: 0.1, P.RATE_FORCE: 40.0, P.COMPACTION: -0.2, P.SPRING: 15.0,
    P.SPRING_FROM_REST: 15.0, P.DAMPER: 15.0, P.GUIDE: 15.0, P.INDENTER: 15.0, P.WAVEFORM: 0.1, P.DRIVE: 20.0,
    P.MOUNT_SPRING: 8.0, P.MOUNT_DAMPER: 8.0,
}  # fmt: skip
"""A strength of each place's curve."""
REACH = {
    P.LOADING: 1e-4, P.UNLOADING: 1e-4, P.RATE_FACTOR: 0.4, P.RATE_FORCE: 0.4, P.COMPACTION: 100.0, P.SPRING: 5e-3,
    P.SPRING_FROM_REST: 2e-3, P.DAMPER: 0.4, P.GUIDE: 5e-3, P.INDENTER: 0.4, P.WAVEFORM: 7.0, P.DRIVE: 600.0,
    P.MOUNT_SPRING: 5e-5, P.MOUNT_DAMPER: 0.05,
}  # fmt: skip
"""The largest argument at each place."""


class Bench:
    """One recording with next to no noise, and its true model."""

    def __init__(self):
        made = plain_campaign(np.random.default_rng(5), noise=(1e-6, 1e-4, 1e-4), recordings=2, seconds=0.2)
        rig, rock, recording = rig_of(made), rock_of(made), made.campaign.recordings[0]
        self.data = condition(recording, rig)
        assert recording.setting is not None
        self.s = np.zeros(P.SCALARS)
        self.s[[P.M1, P.M2, P.K, P.C]] = rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping
        self.s[P.F_A], self.s[P.F_B] = rig.drive_force(recording.setting), rig.static_force(recording.setting)
        self.s[P.K_L] = rock.loading_stiffness
        self.s[P.RATIO] = rock.unloading_stiffness / rock.loading_stiffness
        self.axes = P.Axes(
            np.array([10.0 * REACH[place] for place in range(P.PLACES)]),
            np.arcsinh(np.full(P.PLACES, -0.1)),
            np.full(P.PLACES, 2.0 * np.arcsinh(0.1) / (P.GRID - 1)),
        )
        force, damper, v2, w = self.data.states.T
        self.begin = np.zeros((len(self.data.starts) - 1, P.STATES))
        self.begin[:, :4] = np.column_stack([force / rig.stiffness, v2 + damper / rig.damping, v2, w])

    def run(self, s=None, tables=None, columns=None, states=0, begin=None, size=4, over=1, stride=1):
        """What the integrator says: force and acceleration, their derivatives, and the windows' ends with theirs.

        On a grid ``over`` times as fine as the recording, in steps of ``stride`` of its samples.
        """
        data = self.data
        tables = np.zeros((P.PLACES, P.GRID)) if tables is None else tables
        columns = self.columns() if columns is None else columns
        n, count, windows = data.force.size * over, columns.kind.size, len(data.starts) - 1
        wanted = np.zeros(P.PLACES, dtype=bool)
        wanted[columns.place[columns.kind == P.CURVE]] = True
        arrays = (np.zeros((2, n)), np.zeros((2, states, n)), np.zeros((2, count, n)), np.zeros((windows, 7)),
                  np.zeros((windows, states, 7)), np.zeros((windows, count, 7)))  # fmt: skip
        wave = P.Wave(np.zeros(3), np.zeros(3), np.zeros(3))
        begin = (self.begin if begin is None else begin).copy()
        end = P.run(data.starts * over, begin, False, data.rate * over, stride, data.omega, data.phase, 0.0,
                    self.s if s is None else s, tables, self.axes, np.any(tables != 0.0, axis=1), wanted, wave, columns,
                    states, size, np.zeros((7, 0)), *arrays)  # fmt: skip
        return (end, *arrays)

    @staticmethod
    def columns(kinds=(), places=(), tables=()):
        """Columns for scalars, and for curves of these shapes."""
        kind = np.array([*kinds, *[P.CURVE] * len(places)], dtype=np.int64)
        place = np.array([*[0] * len(kinds), *places], dtype=np.int64)
        table = np.zeros((kind.size, P.GRID))
        table[len(kinds) :] = np.array(tables).reshape(len(places), P.GRID)
        return P.Columns(kind, place, np.zeros(kind.size), np.zeros(kind.size, dtype=np.int64), table)


@pytest.fixture(scope="module")
def bench():
    return Bench()


def apart(bench, one, other):
    """Median over windows of how far two signals are apart, over the second's size."""
    starts = bench.data.starts
    found = []
    for first, last in pairwise(starts):
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
    begin = np.zeros((1, P.STATES))
    v2 = kept.v2[first]
    begin[0, :4] = kept.shortening[first], v2 + kept.closing[first], v2, kept.depth[first]
    s = bench.s.copy()
    s[[P.M1, P.M2, P.K, P.C]] = true.shaker_mass, true.indenter_mass, true.stiffness, true.damping
    s[P.F_A] = (2.40 * controls.frequency + 876.19) * controls.amplitude
    s[P.F_B] = 196.35 * controls.pressure
    s[P.K_L], s[P.RATIO] = true.loading_stiffness, true.unloading_stiffness / true.loading_stiffness
    said = np.zeros((2, kept.time.size))
    none = bench.columns()
    flat, off = np.zeros((P.PLACES, P.GRID)), np.zeros(P.PLACES, dtype=bool)
    wave = P.Wave(np.zeros(3), np.zeros(3), np.zeros(3))
    P.run(starts, begin, False, 25600.0, 1, 2.0 * np.pi * controls.frequency, 0.3, 0.0, s, flat, bench.axes, off, off,
          wave, none, 0, 4, np.zeros((7, 0)), said, np.zeros((2, 0, 0)), np.zeros((2, 0, 0)), np.zeros((1, 7)),
          np.zeros((1, 0, 7)), np.zeros((1, 0, 7)))  # fmt: skip
    inside = slice(*starts)
    for simulated, measured in zip(said, (kept.rock, kept.acceleration), strict=True):
        assert np.max(np.abs(simulated[inside] - measured[inside])) < 1e-3 * np.max(np.abs(measured[inside]))


@pytest.mark.parametrize("kind", [P.M1, P.M2, P.K, P.C, P.F_A, P.F_B, P.K_L, P.RATIO, P.PHASE])
def test_derivatives_by_scalars(bench, kind):
    _, _, _, by_column, *_ = bench.run(columns=bench.columns([kind]))
    step = max(1e-6 * abs(bench.s[kind]), 1e-8)
    ahead, behind = bench.s.copy(), bench.s.copy()
    ahead[kind] += step
    behind[kind] -= step
    difference = (bench.run(s=ahead)[1] - bench.run(s=behind)[1]) / (2.0 * step)
    assert apart(bench, by_column[:, 0], difference) < 0.01


@pytest.mark.parametrize("state", [P.Y, P.V1, P.V2, P.W])
def test_derivatives_by_states(bench, state):
    _, _, by_state, _, _, by_end, _ = bench.run(states=4)
    step = (1e-8, 1e-7, 1e-7, 1e-10)[state]
    ahead, behind = bench.begin.copy(), bench.begin.copy()
    ahead[:, state] += step
    behind[:, state] -= step
    one, two = bench.run(begin=ahead), bench.run(begin=behind)
    assert apart(bench, by_state[:, state], (one[1] - two[1]) / (2.0 * step)) < 0.01
    difference = (one[4] - two[4]) / (2.0 * step)
    assert np.linalg.norm(by_end[:, state] - difference) < 0.02 * np.linalg.norm(difference)


@pytest.mark.parametrize("place", sorted(CURVES))
def test_derivatives_by_curves(bench, place):
    """About a curve that is there; a force over speed jumps at each contact, where the sensitivities do too."""
    x = bench.axes.points(place) / REACH[place]
    shape = CURVES[place] * (x + 0.5 * x**2)
    tables, s, size = np.zeros((P.PLACES, P.GRID)), bench.s.copy(), 4
    tables[place] = shape
    if place in (P.MOUNT_SPRING, P.MOUNT_DAMPER):
        s[[P.MOUNT_GAIN, P.MOUNT_SQUARE, P.MOUNT_DAMPING]] = 0.02, (2.0 * np.pi * 150.0) ** 2, 200.0
        size = 7
    by_column = bench.run(s=s, size=size, tables=tables, columns=bench.columns((), [place], [shape]))[3]
    step = 1e-5
    one, two = (tables * (1.0 + sign * step) for sign in (1.0, -1.0))
    difference = bench.run(s=s, size=size, tables=one)[1] - bench.run(s=s, size=size, tables=two)[1]
    difference /= 2.0 * step
    assert apart(bench, by_column[:, 0], difference) < 0.02


@pytest.mark.parametrize("kind", [P.MOUNT_GAIN, P.MOUNT_SQUARE, P.MOUNT_DAMPING, P.AIR_STIFFNESS, P.AIR_RATE])
def test_derivatives_by_mount_and_air(bench, kind):
    s = bench.s.copy()
    s[[P.MOUNT_GAIN, P.MOUNT_SQUARE, P.MOUNT_DAMPING]] = 0.02, (2.0 * np.pi * 150.0) ** 2, 200.0
    s[[P.AIR_STIFFNESS, P.AIR_RATE]] = 5e4, 5.0
    begin = bench.begin.copy()
    begin[:, P.Q] = 2.0
    by_column = bench.run(s=s, begin=begin, columns=bench.columns([kind]), size=7)[3]
    step = 1e-6 * s[kind]
    one, two = s.copy(), s.copy()
    one[kind] += step
    two[kind] -= step
    difference = (bench.run(s=one, begin=begin, size=7)[1] - bench.run(s=two, begin=begin, size=7)[1]) / (2.0 * step)
    assert apart(bench, by_column[:, 0], difference) < 0.01


def test_samples_within_a_step_are_interpolated(bench):
    """Against steps of one sample: signals to 1e-4 of the largest value, derivatives to about a hundredth."""
    columns = bench.columns([P.K_L, P.C, P.F_A])
    _, said, by_state, by_column, *_ = bench.run(columns=columns, states=4, over=4, stride=4)
    _, fine, fine_by_state, fine_by_column, *_ = bench.run(columns=columns, states=4, over=4, stride=1)
    for one, other in zip(said, fine, strict=True):
        assert np.max(np.abs(one - other)) < 1e-4 * np.max(np.abs(other))
    for one, other in ((by_state, fine_by_state), (by_column, fine_by_column)):
        assert np.linalg.norm(one - other) < 0.02 * np.linalg.norm(other)


def test_a_motion_that_leaves_all_bounds_says_so(bench):
    s = bench.s.copy()
    s[P.C] = -1e5
    assert bench.run(s=s)[0] < 0.0


@pytest.mark.parametrize("kind", [P.K, P.F_B])
def test_with_the_shortening_at_rest_its_curve_moves(bench, kind):
    tables = np.zeros((P.PLACES, P.GRID))
    tables[P.SPRING_FROM_REST] = 40.0 * np.sin(np.linspace(-3.0, 3.0, P.GRID))
    _, _, _, by_column, *_ = bench.run(tables=tables, columns=bench.columns([kind]))
    step = 1e-6 * abs(bench.s[kind])
    ahead, behind = bench.s.copy(), bench.s.copy()
    ahead[kind] += step
    behind[kind] -= step
    difference = (bench.run(s=ahead, tables=tables)[1] - bench.run(s=behind, tables=tables)[1]) / (2.0 * step)
    assert apart(bench, by_column[:, 0], difference) < 0.01


def test_a_contact_that_is_left_at_next_to_no_speed_says_little(bench):
    """A window that begins pressed, whose indenter leaves the rock just as it stops: met in a campaign."""
    s = np.zeros(P.SCALARS)
    s[: P.RATIO + 1] = [265.364698, 2.98878161, 75301.497, 2545.65039, 452.349791, 157.641541, 12074311.8, 1.0823512]
    begin = np.zeros((1, P.STATES))
    begin[0, :4] = 2.10750419e-03, -1.07984894e-04, -6.36024386e-03, 4.19875301e-07
    n, none = 656, bench.columns()
    by_state, ends = np.zeros((2, 4, n)), np.zeros((1, 4, 7))
    active = np.zeros(P.PLACES, dtype=bool)
    wave = P.Wave(np.zeros(3), np.zeros(3), np.zeros(3))
    P.run(np.array([0, n]), begin, False, 51200.0, 4, 500.771053, -0.0612026489, 0.0, s, np.zeros((P.PLACES, P.GRID)),
          bench.axes, active, active, wave, none, 4, 4, np.zeros((7, 0)), np.zeros((2, n)), by_state,
          np.zeros((2, 0, n)), np.zeros((1, 7)), ends, np.zeros((1, 0, 7)))  # fmt: skip
    # a force by a depth is a stiffness, and little more after one blow
    assert np.abs(by_state).max() < 1e3 * s[P.K_L]
    assert np.abs(ends).max() < 1e6


def from_rest(setting, rock, mount, samples, stride=1):
    """21 periods of the paper's rig from rest, of so many samples each, on a mount (kg, m/N, damping ratio).

    In steps of ``stride`` samples at most. Returns what the integrator returns, and the rock's force.
    """
    rig, n, (mass, compliance, ratio) = Rig(), 21 * samples, mount
    rate, turn = samples * setting.frequency, 1.0 / np.sqrt(mass * compliance)
    s = np.zeros(P.SCALARS)
    s[[P.M1, P.M2, P.K, P.C]] = rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping
    s[P.F_A], s[P.F_B] = rig.drive_force(setting), rig.static_force(setting)
    s[P.K_L], s[P.RATIO] = rock.loading_stiffness, rock.unloading_stiffness / rock.loading_stiffness
    s[[P.MOUNT_GAIN, P.MOUNT_SQUARE, P.MOUNT_DAMPING]] = 1.0 / mass, turn**2, 2.0 * ratio * turn
    begin = np.zeros((1, P.STATES))
    begin[0, P.Y] = s[P.F_B] / s[P.K]
    axes = P.Axes(np.ones(P.PLACES), np.full(P.PLACES, -1.0), np.full(P.PLACES, 2.0 / (P.GRID - 1)))
    flat, off, said = np.zeros((P.PLACES, P.GRID)), np.zeros(P.PLACES, dtype=bool), np.zeros((2, n))
    wave = P.Wave(np.zeros(3), np.zeros(3), np.zeros(3))
    end = P.run(np.array([0, n]), begin, False, rate, stride, 2.0 * np.pi * setting.frequency, 0.0, 0.0, s, flat, axes,
                off, off, wave, Bench.columns(), 0, P.STATES, np.zeros((P.STATES, 0)), said, np.zeros((2, 0, n)),
                np.zeros((2, 0, n)), np.zeros((1, 7)), np.zeros((1, 0, 7)), np.zeros((1, 0, 7)))  # fmt: skip
    return end, said[0]


@pytest.mark.parametrize("samples", [191, 195, 203])
def test_a_flight_shorter_than_a_step_is_followed(samples):
    """The departure once passed for the landing: the contact chattered, and the rest of the step was lost."""
    setting, rock, mount = Setting(58.69982935, 0.50118732, 1.37662741), ROCKS[4], (40.0, 2e-8, 0.08)
    impacts, force = from_rest(setting, rock, mount, samples)
    mounted = make("rock-mount-compliance", m_r=mount[0], s_r=mount[1], zeta_r=mount[2])
    rate = samples * setting.frequency
    true = run_hybrid(Rig(), setting, rock, 21.0 / setting.frequency, rate, effects=[mounted], rtol=1e-9)
    assert impacts == true.impacts.time.size
    assert np.mean(force) == pytest.approx(np.mean(true.force[:-1]), rel=1e-5)


def test_no_random_run_sticks():
    """Of 400 runs like these, three lost a part of a step in silence."""
    rng = np.random.default_rng(1)
    for _ in range(400):
        setting = Setting(rng.uniform(50.0, 120.0), rng.uniform(0.3, 0.6), rng.uniform(0.6, 1.8))
        mount = rng.uniform(10.0, 100.0), rng.uniform(5e-9, 5e-8), rng.uniform(0.02, 0.2)
        rock = ROCKS[int(rng.integers(1, 7))]
        assert from_rest(setting, rock, mount, int(1.0 / (84e-6 * setting.frequency)))[0] > 0.0


def test_a_motion_that_needs_too_many_parts_of_a_step_says_so():
    """A light and stiff mount, in steps of 1.7 ms: the rest of such a step was lost."""
    setting, mount = Setting(80.0, 0.5, 1.2), (0.1, 5e-9, 0.08)
    assert from_rest(setting, ROCKS[4], mount, 148, stride=20)[0] == P.STUCK
    assert from_rest(setting, ROCKS[4], mount, 148, stride=5)[0] > 0.0
