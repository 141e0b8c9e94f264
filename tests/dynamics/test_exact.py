"""The exact engine misses nothing: a matrix exponential that shares no code with it scans its segments."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from drillenv.dynamics.exact import (
    LOG_SIZE,
    STATE_SIZE,
    TURN,
    advance_logged,
    fresh_state,
    make_scratch,
)
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING, make_model
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

POINTS = 64
"""Points of the scan in each segment: a thousand a period and more."""


def random_case(rng: np.random.Generator) -> tuple[Rig, Rock, Setting]:
    """Any rock from softer than Table 2.2 to harder, anywhere in the box and somewhat beyond."""
    loading = 10 ** rng.uniform(6.5, 7.8)
    rock = Rock(loading, loading * rng.uniform(1.0, 2.0))
    setting = Setting(rng.uniform(30, 160), rng.uniform(0.2, 0.8), rng.uniform(0.4, 2.5))
    rig = Rig(damping=2450 * 10 ** rng.uniform(-1, 0.5)) if rng.random() < 0.3 else Rig()
    return rig, rock, setting


def logged(rig: Rig, rock: Rock, setting: Setting, periods: int) -> tuple[np.ndarray, float]:
    """Segments of a run from the fresh start, and the excitation in rad/s."""
    model = make_model(rig, rock, setting)
    state = np.zeros(STATE_SIZE)
    fresh_state(model, 0.0, state)
    log = np.zeros((periods * 60, LOG_SIZE))
    rows, left = advance_logged(model, state, periods / setting.frequency, log, make_scratch())
    assert left <= 0.0
    return log[:rows], TURN * setting.frequency


def dense_scan(rig: Rig, rock: Rock, setting: Setting, log: np.ndarray) -> dict[int, np.ndarray]:
    """(y, v1, v2, w) at POINTS places along every segment, by the exponential of the system with its forcing."""
    omega = TURN * setting.frequency
    # differences first: whole turns added up would cost the last digits of a short segment
    spans = (np.diff(log[:, 0]) * TURN + np.diff(log[:, 7])) / omega
    scans = {}
    for regime, kappa in ((FREE, 0.0), (LOADING, rock.loading_stiffness), (UNLOADING, rock.unloading_stiffness)):
        system = _flight(rig, setting)
        system[2, 3] = -kappa / rig.indenter_mass
        mine = np.flatnonzero(log[:-1, 1] == regime)
        point = np.column_stack([log[mine, 2:6], np.sin(log[mine, 7]), np.cos(log[mine, 7]), np.ones(mine.size)])
        # a balanced exponential for each segment's own step
        scale = np.diag([1e-4, 1e-1, 1e-1, 1e-4, 1, 1, 1])
        balanced = np.linalg.solve(scale, system @ scale)
        steps = scipy.linalg.expm(balanced[None] * (spans[mine] / POINTS)[:, None, None])
        point = point @ np.linalg.inv(scale)
        track = [point @ scale]
        for _ in range(POINTS):
            point = np.einsum("sij,sj->si", steps, point)
            track.append(point @ scale)
        scans[regime] = np.stack(track, axis=1)[:, :, :4]
    return scans


def check(rig: Rig, rock: Rock, setting: Setting, periods: int) -> int:
    log, _omega = logged(rig, rock, setting, periods)
    scans = dense_scan(rig, rock, setting, log)
    # inside a flight there is a gap; a touch shallower than a thousandth of a nanometre is rounding
    assert scans[FREE][:, 1:-1, 3].max(initial=-1.0) < 1e-12
    # while loading the indenter goes in, while unloading it comes back and the force stays
    assert scans[LOADING][:, 1:-1, 2].min(initial=1.0) > -1e-9
    assert scans[UNLOADING][:, 1:-1, 2].max(initial=-1.0) < 1e-9
    assert scans[UNLOADING][:, 1:-1, 3].min(initial=1.0) > -1e-12
    # and every segment ends where the next begins, with w counted in the new regime
    ends = np.full((log.shape[0] - 1, 4), np.nan)
    for regime, scan in scans.items():
        ends[log[:-1, 1] == regime] = scan[:, -1]
    stiffness = np.array([0.0, rock.loading_stiffness, rock.unloading_stiffness])
    before, after = log[:-1, 1].astype(int), log[1:, 1].astype(int)
    turn = (before != after) & (before != FREE) & (after != FREE)
    ends[turn, 3] *= stiffness[before[turn]] / stiffness[after[turn]]
    np.testing.assert_allclose(ends[:, [0, 3]], log[1:, [2, 5]], rtol=0, atol=2e-14)
    np.testing.assert_allclose(ends[:, [1, 2]], log[1:, [3, 4]], rtol=0, atol=2e-11)
    return periods


@pytest.mark.parametrize("seed", range(4))
def test_no_switch_is_missed(seed):
    rng = np.random.default_rng(seed)
    for _ in range(15):
        check(*random_case(rng), periods=200)


@pytest.mark.slow
@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.thorough) for part in range(1, 8))])
def test_no_switch_is_missed_in_a_million_periods(part):
    rng = np.random.default_rng((2026, part))
    assert sum(check(*random_case(rng), periods=1000) for _ in range(125)) == 1_000_000 / 8


def test_a_contact_that_just_grazes_is_decided_by_its_depth():
    """Thrown at the surface while the drive pulls back, the indenter turns just before it, or just after."""
    rig, rock, setting = Rig(), Rock(21.4e6, 25.05e6), Setting(100.0, 0.6, 0.4)
    model = make_model(rig, rock, setting)
    start = np.zeros((1, 7))
    start[0] = rig.static_force(setting) / rig.stiffness, 0.0, 0.05, 0.0, 0.0, -1.0, 1.0
    duration = 0.4 / setting.frequency

    def rise(time: float) -> float:
        return (scipy.linalg.expm(_flight(rig, setting) * time) @ start[0])[3]

    top = scipy.optimize.minimize_scalar(lambda t: -rise(t), bounds=(0, duration), options={"xatol": 1e-12})
    assert 0.05 * duration < top.x < 0.95 * duration
    for depth in (1e-6, 1e-9, 1e-12, -1e-12, -1e-9, -1e-6):
        state = np.zeros(STATE_SIZE)
        fresh_state(model, np.pi, state)
        state[2], state[3] = 0.05, depth - rise(top.x)
        log = np.zeros((50, LOG_SIZE))
        rows, _left = advance_logged(model, state, duration, log, make_scratch())
        assert (log[:rows, 1] != FREE).any() == (depth > 0), depth


def _flight(rig: Rig, setting: Setting) -> np.ndarray:
    """The linear system of y, v1, v2, w, sin, cos, 1 in free flight."""
    omega = TURN * setting.frequency
    m1, m2, k, c = rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping
    system = np.zeros((7, 7))
    system[0, 1:3] = 1, -1
    system[1, [0, 1, 2, 6]] = -k / m1, -c / m1, c / m1, rig.static_force(setting) / m1
    system[2, [0, 1, 2, 4]] = k / m2, c / m2, -c / m2, rig.drive_force(setting) / m2
    system[3, 2] = 1
    system[4, 5], system[5, 4] = omega, -omega
    return system
