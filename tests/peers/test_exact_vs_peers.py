"""The exact engine against simulators that share no code with it."""

import numpy as np
import pytest

from benchmarks.peers import Problem, scipy_rig
from drillenv.dynamics.simulate import strobe
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

# rock of Table 2.2, Hz, V, bar, phase in rad
STABLE = [
    (1, 50.0, 0.45, 1.0, 0.0),
    (1, 90.0, 0.45, 0.7, 0.0),
    (2, 60.0, 0.30, 0.8, 0.0),
    (2, 120.0, 0.38, 1.0, 0.0),
    (2, 120.0, 0.50, 1.0, 0.0),
    (3, 80.0, 0.50, 1.4, 0.0),
    (3, 110.0, 0.35, 0.6, 4.5),
    (4, 50.0, 0.45, 1.0, 0.0),
    (4, 70.0, 0.45, 1.0, 0.0),
    (4, 90.0, 0.45, 1.8, 0.0),
    (4, 100.0, 0.45, 1.0, 1.0),
    (4, 120.0, 0.45, 1.0, 0.0),
    (5, 50.0, 0.45, 1.0, 0.0),
    (5, 90.0, 0.45, 1.8, 0.0),
    (5, 105.0, 0.45, 1.0, 0.0),
    (6, 70.0, 0.60, 1.8, 0.0),
    (6, 80.0, 0.50, 1.4, 0.0),
    (6, 100.0, 0.45, 1.0, 2.0),
]
CHAOTIC = [
    (4, 105.0, 0.45, 1.0, 0.0),
    (4, 120.0, 0.38, 1.0, 0.0),
]
PERIODS = 500


def arguments(case):
    """What ``strobe`` and what a peer is called with; the very same numbers."""
    number, f, volts, bar, phase = case
    rig, rock, setting = Rig(), ROCKS[number], Setting(f, volts, bar)
    problem = Problem(
        rig.shaker_mass,
        rig.indenter_mass,
        rig.stiffness,
        rig.damping,
        rock.loading_stiffness,
        rock.unloading_stiffness,
        setting.frequency,
        rig.drive_force(setting),
        rig.static_force(setting),
        phase,
    )
    return {"setting": setting, "rock": rock, "rig": rig, "phase": phase}, problem


@pytest.fixture(scope="module")
def reference():
    """The most accurate heyoka that this machine offers."""
    pytest.importorskip("heyoka")
    from benchmarks.peers.heyoka_rig import HeyokaRig

    return HeyokaRig(extended=np.finfo(np.longdouble).nmant == 63)


def gap(one, other):
    """The larger difference in place of the two masses, at each period's end."""
    return np.maximum(np.abs(one.x1 - other.x1), np.abs(one.x2 - other.x2))


def head(motion, periods):
    """The first so many periods of a peer's motion, without its times."""
    return motion._replace(x1=motion.x1[: periods + 1], x2=motion.x2[: periods + 1])


def first_apart(one, other):
    """The first period at whose end two motions are more than 1e-10 m apart; the last one where none is."""
    apart = gap(one, other) > 1e-10
    return int(np.argmax(apart)) if apart.any() else len(apart) - 1


def landings(motion):
    """Contact times without a start in contact, which the peers do not count."""
    times = np.asarray(motion.contact_times)
    return times[times > 0.0]


def assert_same(exact, peer):
    assert gap(exact, peer).max() < 1e-12
    assert np.abs(exact.penetration - peer.penetration).max() < 1e-12
    for name in ("v1", "v2"):
        assert np.abs(getattr(exact, name) - getattr(peer, name)).max() < 1e-10, name
    assert len(exact.impact_times) == len(peer.impact_times)
    assert np.abs(exact.impact_times - peer.impact_times).max() < 1e-11
    assert len(landings(exact)) == len(landings(peer))
    assert np.abs(landings(exact) - landings(peer)).max() < 1e-11


@pytest.mark.parametrize("case", STABLE)
def test_exact_engine_agrees_with_heyoka_after_500_periods(reference, case):
    call, problem = arguments(case)
    assert_same(strobe(**call, periods=PERIODS), reference.run(problem, PERIODS))


WITH_SCIPY = [*STABLE[::2], STABLE[1], STABLE[7], STABLE[11]]


@pytest.mark.slow
@pytest.mark.thorough  # with heyoka they all agree, and heyoka with SciPy
@pytest.mark.parametrize("case", WITH_SCIPY)
def test_exact_engine_agrees_with_scipy_after_500_periods(case):
    call, problem = arguments(case)
    assert_same(strobe(**call, periods=PERIODS), scipy_rig.simulate(problem, PERIODS))


@pytest.mark.slow
@pytest.mark.parametrize("case", [STABLE[3], STABLE[6], STABLE[12]])
def test_exact_engine_agrees_with_scipy_after_20_periods(case):
    call, problem = arguments(case)
    assert_same(strobe(**call, periods=20), scipy_rig.simulate(problem, 20))


@pytest.mark.slow
@pytest.mark.parametrize("case", CHAOTIC)
def test_exact_engine_agrees_on_chaos_up_to_the_horizon(reference, case):
    call, problem = arguments(case)
    best = reference.run(problem, PERIODS)
    # the horizon: where a peer in double precision, be it heyoka or SciPy, first parts from it by 1e-10 m. Roundings
    # grow alike in all of them, but are not equally large to begin with, so that the engine is given a factor of ten
    horizon = first_apart(type(reference)(1e-15).run(problem, PERIODS), best)
    horizon = first_apart(scipy_rig.simulate(problem, horizon), head(best, horizon))
    assert 50 < horizon < 200
    exact = strobe(**call, periods=PERIODS)
    assert gap(exact, best)[:horizon].max() < 1e-9
    # in the first half of it even rounding has not grown far
    early = horizon // 2
    assert gap(exact, best)[:early].max() < 1e-12
    until = early / problem.f
    mine, theirs = exact.impact_times[exact.impact_times < until], best.impact_times[best.impact_times < until]
    assert len(mine) == len(theirs)
    assert np.abs(mine - theirs).max() < 1e-9
