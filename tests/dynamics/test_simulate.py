"""Runs of the rig: the laws of physics hold on any of them, and SciPy on Eq. 3.1 of the paper gives the same motion."""

import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st

from drillenv.checks import InputError
from drillenv.dynamics import simulate as module
from drillenv.dynamics.effects import make
from drillenv.dynamics.flow import make_model
from drillenv.dynamics.simulate import Run, simulate, strobe
from drillenv.rig import Rig, Setting, groups
from drillenv.rocks import ROCKS, Rock

FIGURE_3_2 = Setting(120.0, 0.45, 1.0)
SAMPLES = (
    "excitation",
    "force",
    "acceleration",
    "shaker_position",
    "indenter_position",
    "shaker_speed",
    "indenter_speed",
    "penetration",
)

any_setting = st.builds(Setting, st.floats(30, 160), st.floats(0.2, 0.8), st.floats(0.4, 2.5))
any_rock = st.one_of(
    st.sampled_from([1, 2, 3, 4, 5, 6]),
    st.builds(lambda exponent, ratio: Rock(10**exponent, 10**exponent * ratio), st.floats(6.3, 7.9), st.floats(1, 3)),
)
any_phase = st.floats(-7.0, 7.0)
any_start = st.sampled_from(["fresh", "steady"])


# --- Physics


@settings(max_examples=60)
@given(setting=any_setting, rock=any_rock, phase=any_phase, start=any_start, seconds=st.floats(0.01, 1.0))
def test_energy_balances(setting, rock, phase, start, seconds):
    run = simulate(setting, rock, seconds=seconds, sample_rate=100.0, phase=phase, start=start)
    assert run.balance_error < 1e-9
    assert run.lost_in_damper > 0.0
    assert run.lost_in_rock >= 0.0
    assert run.work_in == run.work_by_drive + run.work_by_static


@pytest.mark.parametrize(("frequency", "start"), [(50.0, "fresh"), (105.0, "steady"), (120.0, "fresh")])
def test_energies_are_those_of_the_samples(frequency, start):
    setting, rig, rock = Setting(frequency, 0.45, 1.0), Rig(), ROCKS[4]
    run = simulate(setting, 4, seconds=0.2, sample_rate=1e6, start=start)
    drive = rig.drive_force(setting) * run.excitation / setting.amplitude
    closing = run.shaker_speed - run.indenter_speed
    near = {"rel": 1e-5, "abs": 1e-8}  # what the trapezoidal rule leaves
    assert run.work_by_drive == pytest.approx(np.trapezoid(drive * run.indenter_speed, run.time), **near)
    static = rig.static_force(setting) * np.trapezoid(run.shaker_speed, run.time)
    assert run.work_by_static == pytest.approx(static, **near)
    assert run.lost_in_damper == pytest.approx(np.trapezoid(rig.damping * closing**2, run.time), **near)
    held = 0.5 * run.force[[0, -1]] ** 2 / rock.unloading_stiffness
    on_rock = np.trapezoid(run.force * run.indenter_speed, run.time)
    assert run.lost_in_rock == pytest.approx(on_rock - (held[1] - held[0]), **near)
    spring = run.shaker_position - run.indenter_position
    stored = 0.5 * (
        rig.shaker_mass * run.shaker_speed**2
        + rig.indenter_mass * run.indenter_speed**2
        + rig.stiffness * spring**2
        + run.force**2 / rock.unloading_stiffness
    )
    assert run.stored_change == pytest.approx(stored[-1] - stored[0], rel=1e-9, abs=1e-12)


@settings(max_examples=60)
@given(setting=any_setting, rock=any_rock, phase=any_phase, start=any_start)
def test_contact_follows_the_rock_law(setting, rock, phase, start):
    run = simulate(setting, rock, seconds=0.2, phase=phase, start=start)
    # behind Xf there is no force at all; in front of it R = k_u (X2 - Xf), while loading as well
    ahead = run.indenter_position - run.penetration
    assert np.all(run.force >= 0.0)
    assert np.all(run.force[ahead < -1e-15] == 0.0)
    np.testing.assert_allclose(run.force, run.rock.unloading_stiffness * np.maximum(ahead, 0.0), rtol=1e-9, atol=1e-7)
    # Xf moves only forward, and only in contact
    step = np.diff(run.penetration)
    assert run.penetration[0] == pytest.approx(0.0, abs=1e-18)
    assert step.min() >= -4e-18
    apart = (run.force[:-1] == 0.0) & (run.force[1:] == 0.0)
    touched = np.searchsorted(run.time, run.impacts.time) - 1
    apart[touched[touched < apart.size]] = False
    assert np.all(step[apart] == 0.0)


@settings(max_examples=40)
@given(setting=any_setting, rock=any_rock, phase=any_phase, start=any_start)
def test_samples_obey_newton(setting, rock, phase, start):
    rate, rig = 1e6, Rig()
    run = simulate(setting, rock, seconds=0.02, sample_rate=rate, phase=phase, start=start)
    angle = 2 * np.pi * setting.frequency * run.time + phase
    np.testing.assert_allclose(run.excitation, setting.amplitude * np.sin(angle), atol=1e-12)
    coupling = rig.stiffness * (run.shaker_position - run.indenter_position)
    coupling += rig.damping * (run.shaker_speed - run.indenter_speed)
    push = rig.drive_force(setting) * np.sin(angle) + coupling - run.force
    np.testing.assert_allclose(run.acceleration, push / rig.indenter_mass, rtol=1e-9, atol=1e-7)
    for speed, acceleration, mass in (
        (run.indenter_speed, run.acceleration, rig.indenter_mass),
        (run.shaker_speed, (rig.static_force(setting) - coupling) / rig.shaker_mass, rig.shaker_mass),
    ):
        # Simpson's rule over two steps: sharp but where the rock's force has a kink between them
        mean = (acceleration[:-2] + 4 * acceleration[1:-1] + acceleration[2:])[::2] / 6
        off = np.abs(np.diff(speed[::2]) - mean * 2 / rate)
        kink = run.rock.unloading_stiffness * np.abs(run.indenter_speed).max() / mass
        assert np.quantile(off, 0.95) < 1e-13
        assert off.max() < kink / rate**2


@settings(max_examples=40)
@given(setting=any_setting, rock=any_rock, phase=any_phase, start=any_start, rate=st.floats(1000, 30000))
def test_motion_does_not_depend_on_the_sample_rate(setting, rock, phase, start, rate):
    coarse = simulate(setting, rock, seconds=0.1, sample_rate=rate, phase=phase, start=start)
    fine = simulate(setting, rock, seconds=0.1, sample_rate=2 * rate, phase=phase, start=start)
    for name in SAMPLES:
        np.testing.assert_array_equal(getattr(coarse, name), getattr(fine, name)[::2][: coarse.time.size], name)
    for one, other in zip(coarse.impacts, fine.impacts, strict=True):
        np.testing.assert_array_equal(one, other)
    assert coarse.work_in == fine.work_in


@settings(max_examples=40)
@given(setting=any_setting, rock=any_rock, phase=any_phase, scale=st.floats(0.2, 5.0))
def test_motion_scales_with_its_forces(setting, rock, phase, scale):
    """Eq. 3.4: mu is any length, so larger forces give the same motion, larger."""
    run = simulate(setting, rock, seconds=0.1, phase=phase)
    rig = Rig(drive_gain=scale, pressure_gain=scale)
    large = simulate(setting, rock, rig, seconds=0.1, phase=phase)
    for name in SAMPLES:
        small, wanted = getattr(run, name), 1.0 if name == "excitation" else scale
        # a rock with k_u = k_l keeps nothing: what it has of penetration is rounding of X2
        near = 1e-9 * np.abs(small).max() + 1e-18
        np.testing.assert_allclose(getattr(large, name) / wanted, small, rtol=0, atol=near, err_msg=name)
    assert large.work_in == pytest.approx(scale**2 * run.work_in, rel=1e-9)


# --- Eq. 3.1, as printed, in the groups of Eq. 3.4, solved by SciPy

P1P2 = {"no contact": (0, 0, 0), "loading": (1, 1, 1), "unloading": (1, 0, 1)}
"""P1, P2 and P3 of Eq. 3.2 in each of the paper's three modes."""


def equation_3_1(g, mode):
    """Right-hand side of Eq. 3.1 for n_l = n_u = 1 in (p, v1, q, v2, r, m, s)."""
    p1, p2, p3 = P1P2[mode]

    def rates(_tau, state):
        p, v1, q, v2, _r, m, s = state
        moving = p1 * p2 * (1 - 1 / g.kappa) * v2
        back = p1 * (1 - p2) * p3
        return [
            v1 - moving,
            g.alpha * g.b - g.alpha * g.beta * (p - q) - 2 * g.alpha * g.xi * (v1 - v2),
            v2 - moving,
            g.a * math.sin(s) - g.beta * (q - p) - 2 * g.xi * (v2 - v1) - p1 * p2 * (q - m) - back * g.kappa * q,
            p1 * p2 * v2 - moving + back * v2,
            -moving + back * (1 - g.kappa) * v2,
            g.omega,
        ]

    return rates


def switch(index, direction):
    def crossing(_tau, state):
        return state[index]

    crossing.terminal, crossing.direction = True, direction
    return crossing


SWITCHES = {
    "no contact": {"loading": switch(2, 1)},
    "loading": {"unloading": switch(3, -1)},
    "unloading": {"loading": switch(3, 1), "no contact": switch(2, -1)},
}


def solve_equation_3_1(g, phase, times):
    """(p, v1, q, v2, r, m, s) at dimensionless ``times``, from the fresh start, and the number of force peaks."""
    state = np.array([g.b / g.beta, 0, 0, 0, 0, 0, phase])
    mode = "loading" if g.b + g.a * math.sin(phase) > 0 else "no contact"
    result, begin, peaks = np.empty((7, times.size)), 0.0, 0
    while begin < times[-1]:
        rates, exits = equation_3_1(g, mode), SWITCHES[mode]
        limit = 0.02 * 2 * math.pi / g.omega
        # off the switch that the mode began with, whose event would end it at once
        nudge = 1e-3 * limit
        first = scipy.integrate.solve_ivp(rates, (begin, begin + nudge), state, "DOP853", rtol=1e-12, atol=1e-15)
        rest = scipy.integrate.solve_ivp(
            rates,
            (begin + nudge, times[-1] + 2 * limit),
            first.y[:, -1],
            "DOP853",
            rtol=1e-12,
            atol=1e-15,
            max_step=limit,
            events=list(exits.values()),
            dense_output=True,
        )
        inside = (times >= begin + nudge) & (times <= rest.t[-1])
        result[:, inside] = rest.sol(times[inside])
        early = (times >= begin) & (times < begin + nudge)
        result[:, early] = state[:, None]  # too soon after a switch to have moved
        begin, state = rest.t[-1], rest.y[:, -1].copy()
        following = next((name for name, hit in zip(exits, rest.t_events, strict=True) if hit.size), mode)
        peaks += (mode, following) == ("loading", "unloading") and begin < times[-1]
        mode = following
        if mode == "no contact":
            state[5] = 0.0
    return result, peaks


@pytest.mark.parametrize(
    ("rock", "setting", "phase"),
    [
        (4, Setting(50.0, 0.45, 1.0), 0.0),
        (2, Setting(120.0, 0.35, 1.0), 4.5),
        (5, Setting(90.0, 0.45, 1.6), 2.0),
    ],
)
def test_equation_3_1_gives_the_same_motion(rock, setting, phase):
    rig, periods = Rig(), 5
    g = groups(rig, setting, ROCKS[rock])
    run = simulate(setting, rock, seconds=periods / setting.frequency, sample_rate=20e3, phase=phase)
    theirs, peaks = solve_equation_3_1(g, phase, run.time / g.time_scale)
    mu, speed = g.length_scale, g.length_scale / g.time_scale
    p, v1, q, v2, r, m = theirs[:6]
    xf = run.penetration
    np.testing.assert_allclose(run.shaker_position - xf, mu * p, atol=1e-11)
    np.testing.assert_allclose(run.indenter_position - xf, mu * q, atol=1e-11)
    np.testing.assert_allclose(run.shaker_speed, speed * v1, atol=1e-8)
    np.testing.assert_allclose(run.indenter_speed, speed * v2, atol=1e-8)
    loading = (run.force > 0) & (v2 > 0)
    np.testing.assert_allclose(run.force[loading], ROCKS[rock].loading_stiffness * mu * (q - m)[loading], atol=1e-3)
    np.testing.assert_allclose(np.where(run.force > 0, r, 0.0), np.where(run.force > 0, q, 0.0), atol=1e-8)
    assert run.impacts.time.size == peaks > periods


# --- Impacts


@settings(max_examples=40)
@given(setting=any_setting, rock=any_rock, start=any_start)
def test_impacts_are_the_force_peaks_of_the_samples(setting, rock, start):
    run = simulate(setting, rock, seconds=0.2, sample_rate=200e3, start=start)
    impacts = run.impacts
    assert np.all(np.diff(impacts.time) > 0)
    assert np.all(impacts.contact_time < impacts.time)
    assert np.all(impacts.speed >= 0.0)
    np.testing.assert_allclose(impacts.depth, impacts.force / run.rock.loading_stiffness, rtol=1e-12)
    # just before the peak loading, just after it unloading, the samples lower but near
    after = np.searchsorted(run.time, impacts.time)
    inside = (after > 0) & (after < run.time.size)
    beside = np.maximum(run.force[after[inside] - 1], run.force[after[inside]])
    peak = impacts.force[inside]
    assert np.all(beside <= peak * (1 + 1e-12))
    largest_drop = 0.5 * run.rock.unloading_stiffness * np.abs(run.acceleration).max() * (1 / 200e3) ** 2
    assert np.all(peak - beside <= 2 * largest_drop)
    # every local maximum of the samples is one of them
    force = run.force
    tops = np.flatnonzero((force[1:-1] > force[:-2]) & (force[1:-1] >= force[2:])) + 1
    assert tops.size <= impacts.time.size
    if tops.size:
        gaps = np.abs(run.time[tops][:, None] - impacts.time[None]).min(axis=1)
        assert gaps.max() <= 1.01 / 200e3


def test_contact_going_on_at_a_steady_start_is_known_from_its_beginning():
    whole = simulate(FIGURE_3_2, start="steady", seconds=0.05)
    landing, peak = whole.impacts.contact_time[1], whole.impacts.time[1]
    phase = 2 * math.pi * FIGURE_3_2.frequency * (0.5 * (landing + peak))
    run = simulate(FIGURE_3_2, start="steady", phase=phase, seconds=0.05)
    assert run.force[0] > 0.0
    assert run.impacts.contact_time[0] == pytest.approx(-0.5 * (peak - landing), rel=1e-9)
    np.testing.assert_allclose(run.impacts.speed, whole.impacts.speed[0], rtol=1e-9)


# --- Starts


def test_fresh_start_is_at_rest_with_the_spring_carrying_the_static_force():
    run = simulate(FIGURE_3_2, 4, phase=1.0, seconds=0.1)
    assert run.shaker_position[0] == pytest.approx(196.35 / 68.85e3, rel=1e-14)
    for name in ("indenter_position", "shaker_speed", "indenter_speed", "penetration", "force"):
        assert getattr(run, name)[0] == 0.0
    assert run.excitation[0] == pytest.approx(0.45 * math.sin(1.0), rel=1e-14)


@pytest.mark.parametrize(
    ("rock", "setting", "period", "impacts"),
    [
        (4, (50.0, 0.45, 1.0), 1, 4),
        (4, (70.0, 0.45, 1.0), 1, 3),
        (4, (120.0, 0.45, 1.0), 1, 1),
        (4, (100.0, 0.45, 1.0), 2, 3),
    ],
)
def test_steady_start_repeats_from_any_phase(rock, setting, period, impacts):
    frequency, per_period = setting[0], 300
    span = period * per_period
    run = simulate(setting, rock, seconds=4 * period / frequency, sample_rate=per_period * frequency, start="steady")
    for name in ("excitation", "force", "acceleration", "shaker_speed", "indenter_speed"):
        track = getattr(run, name)
        np.testing.assert_allclose(track[span:], track[:-span], atol=1e-8 * np.abs(track).max(), err_msg=name)
    assert run.impacts.time.size == 4 * impacts
    assert run.penetration[span] * frequency / period == pytest.approx(run.penetration_rate, rel=1e-9)
    shift = 77
    later = simulate(
        setting,
        rock,
        seconds=2 * period / frequency,
        sample_rate=per_period * frequency,
        start="steady",
        phase=2 * math.pi * shift / per_period,
    )
    # a motion of two periods passes the phase twice
    starts = [shift + turn * per_period for turn in range(period)]
    gaps = [np.abs(later.force - run.force[at : at + later.time.size]).max() for at in starts]
    assert min(gaps) < 1e-6 * run.force.max()
    best = starts[int(np.argmin(gaps))]
    moved = run.indenter_position[best : best + later.time.size] - run.penetration[best]
    np.testing.assert_allclose(later.indenter_position, moved, atol=1e-12)


def test_chaos_has_a_steady_rate_over_whole_periods():
    run = simulate((105.0, 0.45, 1.0), start="steady", seconds=1.0, sample_rate=105.0 * 64)
    assert run.penetration_rate == pytest.approx(run.penetration[-1] / 1.0, rel=1e-9)
    longer = simulate((105.0, 0.45, 1.0), start="steady", seconds=20.0, sample_rate=100.0)
    assert longer.penetration_rate == pytest.approx(run.penetration_rate, rel=0.01)


def test_strobe_is_the_run_at_the_ends_of_periods():
    frequency, phase = 90.0, 0.7
    run = simulate((frequency, 0.45, 1.4), 5, seconds=40 / frequency, sample_rate=16 * frequency, phase=phase)
    ends = strobe((frequency, 0.45, 1.4), 5, periods=40, phase=phase)
    for name, track in (
        ("x1", run.shaker_position),
        ("x2", run.indenter_position),
        ("v1", run.shaker_speed),
        ("v2", run.indenter_speed),
        ("penetration", run.penetration),
    ):
        np.testing.assert_allclose(getattr(ends, name), track[::16], atol=1e-13, err_msg=name)
    np.testing.assert_array_equal(ends.impact_times, run.impacts.time)
    assert set(run.impacts.contact_time) <= set(ends.contact_times)


# --- Engines


@pytest.mark.parametrize("start", ["fresh", "steady"])
@pytest.mark.parametrize("setting", [(50.0, 0.45, 1.0), (120.0, 0.45, 1.0)])
def test_engines_agree(setting, start):
    exact = simulate(setting, seconds=0.4, start=start, phase=1.0)
    hybrid = simulate(setting, seconds=0.4, start=start, phase=1.0, engine="hybrid")
    for name in SAMPLES:
        one, other = getattr(exact, name), getattr(hybrid, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(one).max(), err_msg=name)
    np.testing.assert_allclose(hybrid.impacts.time, exact.impacts.time, atol=1e-11)
    for name in ("force", "depth"):
        np.testing.assert_allclose(getattr(hybrid.impacts, name), getattr(exact.impacts, name), rtol=1e-9)
    for name in ("work_by_drive", "work_by_static", "lost_in_damper", "lost_in_rock", "stored_change"):
        assert getattr(hybrid, name) == pytest.approx(getattr(exact, name), rel=1e-9, abs=1e-9), name
    assert hybrid.penetration_rate == pytest.approx(exact.penetration_rate, rel=1e-3)
    assert hybrid.balance_error < 1e-9


def test_effects_take_the_hybrid_engine():
    effect = make("damping-quadratic", c2=500.0)
    run, plain = (simulate(FIGURE_3_2, seconds=0.2, effects=chosen, sample_rate=1000.0) for chosen in ([effect], []))
    assert run.work_by_effects < 0.0 == plain.work_by_effects
    assert run.balance_error < 1e-9
    assert np.abs(run.indenter_position - plain.indenter_position).max() > 1e-6


def test_rig_that_the_exact_engine_cannot_take_runs_on_the_hybrid_one():
    rig, rock = Rig(shaker_mass=614.0, indenter_mass=0.4, stiffness=127e3, damping=63.9e3), Rock(23.2e6, 25.5e6)
    with pytest.raises(InputError, match="hybrid"):
        make_model(rig, rock, FIGURE_3_2)
    run = simulate(FIGURE_3_2, rock, rig, seconds=0.05, sample_rate=1000.0)
    assert run.balance_error < 1e-9
    assert run.force.max() > 0.0


# --- What is handed in and out


def test_run_has_what_it_says():
    run = simulate(FIGURE_3_2, "sandstone2-indenter30")
    assert isinstance(run, Run)
    assert run.time.size == 2 * 25600 + 1
    assert (run.time[0], run.time[-1]) == (0.0, 2.0)
    for name in SAMPLES:
        assert getattr(run, name).shape == run.time.shape
        assert getattr(run, name).dtype == np.float64
        assert np.isfinite(getattr(run, name)).all()
    assert (run.setting, run.rock, run.rig) == (FIGURE_3_2, ROCKS[4], Rig())
    assert run.penetration_rate == pytest.approx(run.penetration[-1] / 2.0, rel=1e-12)


def test_csv_keeps_every_digit(tmp_path):
    run = simulate(FIGURE_3_2, seconds=0.1)
    path = tmp_path / "run.csv"
    run.to_csv(path)
    header, *_ = path.read_text().splitlines()
    assert header == (
        "time_s,excitation_V,force_N,acceleration_m_s2,shaker_position_m,indenter_position_m,penetration_m"
    )
    table = np.loadtxt(path, delimiter=",", skiprows=1).T
    names = ("time", "excitation", "force", "acceleration", "shaker_position", "indenter_position", "penetration")
    for column, name in zip(table, names, strict=True):
        np.testing.assert_array_equal(column, getattr(run, name))
    assert list(tmp_path.iterdir()) == [path]


GOOD = {"setting": FIGURE_3_2}


@pytest.mark.parametrize(
    "bad",
    [
        {"setting": None},
        {"setting": 120.0},
        {"setting": (120.0, 0.45)},
        {"setting": "abc"},
        {"setting": (120.0, 450.0, 1.0)},
        {"setting": (120.0, math.nan, 1.0)},
        {"rock": 7},
        {"rock": "granite"},
        {"rig": "mine"},
        {"seconds": 0.0},
        {"seconds": -1.0},
        {"seconds": math.inf},
        {"seconds": 3601.0},
        {"seconds": "2"},
        {"sample_rate": 0.0},
        {"sample_rate": 25.6},
        {"sample_rate": math.nan},
        {"sample_rate": 1e7},
        {"seconds": 3600.0, "sample_rate": 1e6},
        {"start": "cold"},
        {"start": None},
        {"phase": math.nan},
        {"phase": math.inf},
        {"phase": "0"},
        {"engine": "euler"},
        {"effects": "damping-quadratic"},
        {"effects": 3},
        {"effects": [None]},
    ],
)
def test_bad_input_is_refused_in_one_line(bad):
    with pytest.raises(InputError) as caught:
        simulate(**(GOOD | bad))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("bad", [{"periods": 0}, {"periods": 1.5}, {"periods": 10**7}, {"phase": math.nan}])
def test_strobe_refuses_bad_input(bad):
    with pytest.raises(InputError):
        strobe(FIGURE_3_2, **bad)


def test_a_negative_phase_next_to_zero_is_the_phase_zero():
    run = simulate(FIGURE_3_2, phase=-1e-20, seconds=0.01)
    np.testing.assert_array_equal(run.force, simulate(FIGURE_3_2, phase=0.0, seconds=0.01).force)


def test_no_sample_beyond_the_end():
    run = simulate(FIGURE_3_2, seconds=0.0101, sample_rate=1000.0)
    assert run.time[-1] == 0.01
    assert module.MOST_SAMPLES * 8 * 9 < 2e9
