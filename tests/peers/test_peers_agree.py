"""The peers share nothing but their equations, and agree."""

import numpy as np
import pytest

from benchmarks.peers import paper_problem, rk4_rig, scipy_rig

ROCK_2 = (11.82e6, 13.90e6)
ROCK_4 = (21.40e6, 25.05e6)
ROCK_5 = (32.73e6, 40.64e6)

# rock, Hz, V, bar, phase; the last is chaotic, and 40 periods are within its horizon
SETTINGS = [
    (ROCK_4, 120.0, 0.45, 1.0, 0.0),
    (ROCK_4, 50.0, 0.45, 1.0, 0.0),
    (ROCK_4, 70.0, 0.45, 1.0, 0.0),
    (ROCK_5, 50.0, 0.45, 1.0, 2.0),
    (ROCK_2, 120.0, 0.5, 1.0, 4.0),
    (ROCK_4, 105.0, 0.45, 1.0, 0.0),
]
LONG = [SETTINGS[0], SETTINGS[1], SETTINGS[2], (ROCK_2, 120.0, 0.5, 1.0, 0.0)]


@pytest.fixture(scope="module")
def rig():
    pytest.importorskip("heyoka")
    from benchmarks.peers.heyoka_rig import HeyokaRig

    return HeyokaRig(1e-16)


def problem_of(setting):
    (kl, ku), f, volts, bar, phase = setting
    return paper_problem(kl, ku, f, volts, bar, phase)


def assert_close(one, other, position, time):
    for name in ("x1", "x2", "penetration"):
        assert np.abs(getattr(one, name) - getattr(other, name)).max() < position, name
    for name in ("impact_times", "contact_times"):
        assert len(getattr(one, name)) == len(getattr(other, name)), name
        assert np.abs(getattr(one, name) - getattr(other, name)).max() < time, name


@pytest.mark.slow
@pytest.mark.parametrize("setting", SETTINGS)
def test_scipy_agrees_with_heyoka(rig, setting):
    problem = problem_of(setting)
    assert_close(scipy_rig.simulate(problem, 40), rig.run(problem, 40), 1e-14, 1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("setting", [LONG[0], *(pytest.param(each, marks=pytest.mark.thorough) for each in LONG[1:])])
def test_scipy_agrees_with_heyoka_for_500_periods(rig, setting):
    problem = problem_of(setting)
    assert_close(scipy_rig.simulate(problem, 500), rig.run(problem, 500), 1e-14, 1e-12)


@pytest.mark.parametrize("setting", SETTINGS[:3])
def test_looser_heyoka_agrees(rig, setting):
    problem = problem_of(setting)
    assert_close(type(rig)(1e-12).run(problem, 500), rig.run(problem, 500), 1e-11, 1e-10)


@pytest.mark.parametrize("setting", SETTINGS[:3])
def test_plain_scipy_agrees_roughly(rig, setting):
    problem = problem_of(setting)
    assert_close(scipy_rig.simulate_plainly(problem, 20), rig.run(problem, 20), 1e-9, 1e-8)


@pytest.mark.parametrize("setting", SETTINGS[:3])
def test_fixed_steps_agree_roughly_and_better_with_more_of_them(rig, setting):
    problem = problem_of(setting)
    exact = rig.run(problem, 60)
    errors = [np.abs(rk4_rig.simulate(problem, 60, steps).x2 - exact.x2).max() for steps in (1000, 16000)]
    assert errors[0] < 3e-6
    assert errors[1] < 0.2 * errors[0]


def test_heyoka_sees_a_landing_in_the_first_step_of_a_flight(rig):
    # at 50 Hz on rock 4 a flight of 0.5 ms follows a release, shorter than one Taylor step
    motion = rig.run(problem_of(SETTINGS[1]), 30)
    assert len(motion.contact_times) > 50
    assert motion.x2[-1] < motion.penetration[-1] + 1e-3


def test_stopping_less_often_changes_nothing(rig):
    problem = problem_of(SETTINGS[0])
    often, rarely = rig.run(problem, 60), rig.run(problem, 60, every=20)
    assert np.abs(rarely.x2 - often.x2[::20]).max() < 1e-15
    assert np.abs(rarely.impact_times - often.impact_times).max() < 1e-13


def test_a_start_that_pulls_back_begins_in_flight(rig):
    problem = paper_problem(*ROCK_4, 120.0, 0.45, 1.0, phase=4.5)
    for motion in (rig.run(problem, 5), scipy_rig.simulate(problem, 5), rk4_rig.simulate(problem, 5)):
        assert motion.contact_times[0] < motion.impact_times[0]
        assert motion.x1[0] == pytest.approx(problem.static / problem.k, rel=1e-15)
