"""Dry friction in the hybrid engine: against closed forms, against SciPy, and against its own definition."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from drillenv.checks import InputError
from drillenv.dynamics.effects import EVERYWHERE, Chosen, Effect, Parameter, make
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.hybrid.model import Start
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

SLIDE1, SLIDE2 = 0, 2
"""Columns of extra states; beside them are the forces of bristles."""
HELD = make("guide-friction", fc1=1e5)
"""So strong that the shaker body never moves: what is left is one mass on a spring."""


def _no_damper(now, own, p, push, rates):
    push[1] -= now.c * now.closing


def _no_drive(now, own, p, push, rates):
    push[1] -= now.drive * math.sin(now.theta)


def bare(name, term):
    """An effect that takes a force of the rig away, to leave a textbook case."""
    parameter = Parameter("a", "for form's sake", "1", 0.0, 1.0, 0.0, (0.0, 1.0))
    about = (name, "Takes a force away.", "-", "constitutive", (parameter,))
    return Chosen(Effect(*about, ("indenter",), EVERYWHERE, "moves", term=term), (1.0,))


NO_DAMPER, NO_DRIVE = bare("no-damper", _no_damper), bare("no-drive", _no_drive)
FAR = -0.5  # m from the rock


# --- Closed forms


@pytest.mark.parametrize("stretch", [0.0203, -0.0155, 0.0011])
def test_free_decay_loses_four_times_friction_over_stiffness_a_cycle(stretch):
    """Each half swing ends 2 F_c / k nearer to the middle, and the mass stays where it stops within F_c / k of it."""
    rig, limit = Rig(stiffness=40e3), 50.0
    reach, half = limit / rig.stiffness, math.pi * math.sqrt(rig.indenter_mass / rig.stiffness)
    swings = math.ceil((abs(stretch) - reach) / (2 * reach))
    seconds = max(swings + 2, 3) * half
    run = run_hybrid(
        rig, Setting(50.0, 0.45, 1.0), ROCKS[4], seconds, 8 / half, start=Start(stretch, 0.0, 0.0, FAR, FREE),
        effects=[HELD, make("indenter-friction", fc2=limit), NO_DAMPER, NO_DRIVE],
    )  # fmt: skip
    y = run.x1 - run.x2
    for n in range(swings + 1):
        turned = math.copysign(abs(stretch) - 2 * n * reach, stretch) * (-1) ** n
        assert abs(y[8 * n] - turned) < 1e-12
    # within the swings the mass moves as a cosine about the place where friction and spring balance
    for n in range(swings):
        sign = math.copysign(1.0, stretch) * (-1) ** n
        amplitude = abs(stretch) - (2 * n + 1) * reach
        phase = np.arange(9) / 8 * math.pi
        assert np.allclose(y[8 * n : 8 * n + 9], sign * (reach + amplitude * np.cos(phase)), rtol=0, atol=1e-12)
    resting = run.time > (swings + 1e-9) * half
    assert np.ptp(y[resting]) == 0.0 and np.all(run.extra[resting, SLIDE2] == 0.0) and np.all(run.v2[resting] == 0.0)
    assert np.all(run.acceleration[resting] == 0.0)
    assert np.all(run.v1 == 0.0) and run.energy.effects[0] == 0.0
    travelled = swings * (abs(stretch) - swings * reach) * 2
    assert math.isclose(run.energy.effects[1], -limit * travelled, rel_tol=1e-11, abs_tol=1e-12)


def test_free_decay_with_a_damper_too():
    """Each half swing about the balanced place shrinks by exp(-pi zeta / sqrt(1 - zeta^2))."""
    rig, limit, stretch = Rig(stiffness=40e3, damping=60.0), 30.0, 0.02
    natural = math.sqrt(rig.stiffness / rig.indenter_mass)
    zeta = rig.damping / (2 * rig.indenter_mass * natural)
    damped = natural * math.sqrt(1 - zeta**2)
    shrink, reach = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), limit / rig.stiffness
    turns = [stretch]
    while abs(turns[-1]) > reach:
        turns.append(-math.copysign(1.0, turns[-1]) * ((abs(turns[-1]) - reach) * shrink - reach))
    assert len(turns) > 4
    run = run_hybrid(
        rig, Setting(50.0, 0.45, 1.0), ROCKS[4], (len(turns) + 1) * math.pi / damped, damped / math.pi,
        start=Start(stretch, 0.0, 0.0, FAR, FREE), effects=[HELD, make("indenter-friction", fc2=limit), NO_DRIVE],
    )  # fmt: skip
    expected = np.array([*turns, turns[-1], turns[-1]])
    assert np.allclose((run.x1 - run.x2)[: expected.size], expected, rtol=0, atol=1e-12)


class DenHartog:
    """The forced Coulomb oscillator without stops, x'' + x = P cos(q t + phi) +- F (stiffness and mass 1).

    J. P. Den Hartog, Forced vibrations with combined viscous and Coulomb damping, Philosophical Magazine 9 (1930) 801.
    """

    def __init__(self, q, share):
        self.q, self.share = q, share  # share: F / P, with P = 1
        self.response = 1 / (1 - q**2)
        self.lag = math.sin(math.pi / q) / (q * (1 + math.cos(math.pi / q)))
        self.amplitude = math.sqrt(max(self.response**2 - (share * self.lag) ** 2, 0.0))

    def speed(self, t):
        """Of the half cycle from +amplitude down, from the general solution with these ends."""
        q, f, x0 = self.q, self.share, self.amplitude
        # x = f + a cos t + b sin t + response cos(q t + phi); x' = 0 at both ends and x = x0 at the first
        cos_phi = x0 / self.response
        sin_phi = -f * self.lag / self.response
        a = x0 - f - self.response * cos_phi
        b = q * self.response * sin_phi
        forced = -q * self.response * (np.sin(q * t) * cos_phi + np.cos(q * t) * sin_phi)
        return -a * np.sin(t) + b * np.cos(t) + forced

    def stops(self):
        """How far above zero the speed rises on the way down, by which the motion would have to stop."""
        return float(np.max(self.speed(np.linspace(0, math.pi / self.q, 20001)[1:-1])))


def forced(q, share, periods, rate_per_period=64):
    """The same on the rig: the shaker held, no damper. Returns the run of the last periods and P / k."""
    setting, gain = Setting(100.0, 0.5, 1.0), 1.0
    mass = Rig().indenter_mass
    rig = Rig(stiffness=mass * (2 * math.pi * setting.frequency / q) ** 2, drive_gain=gain)
    push = rig.drive_force(setting)
    effects = [HELD, make("indenter-friction", fc2=share * push), NO_DAMPER]
    lead = run_hybrid(
        rig, setting, ROCKS[4], periods / 100, 0.0, start=Start(push / rig.stiffness, 0.0, 0.0, FAR, FREE),
        effects=effects,
    )  # fmt: skip
    run = run_hybrid(
        rig, setting, ROCKS[4], 2 / 100, rate_per_period * 100.0, lead.end_phase, lead.end._replace(w=FAR), effects
    )
    return run, push / rig.stiffness


@pytest.mark.parametrize(("q", "share"), [(0.7, 0.4), (0.8, 0.6), (1.3, 0.3), (1.6, 0.5), (2.5, 0.2)])
def test_forced_amplitude_is_den_hartogs(q, share):
    textbook = DenHartog(q, share)
    assert textbook.stops() <= 1e-12
    run, length = forced(q, share, 1500)
    turns = (run.x1 - run.x2)[:-1]
    # the largest of 64 samples a period lies below the turn by at most its curvature
    fine, _ = forced(q, share, 1500, 4096)
    y = fine.x1 - fine.x2
    assert np.ptp(turns) < 2.1 * textbook.amplitude * length
    assert math.isclose(np.ptp(y) / 2 / length, textbook.amplitude, rel_tol=2e-6)
    assert not np.any(run.extra[:, SLIDE2] == 0.0)


@pytest.mark.parametrize("q", [0.7, 0.85, 1.3])
def test_stops_begin_at_den_hartogs_boundary(q):
    """Where the no-stop solution ceases to move one way in each half cycle, the engine's motion begins to stick."""
    boundary = brentq(lambda share: DenHartog(q, share).stops() - 1e-9, 0.05, 0.95, xtol=1e-9)
    assert 0.1 < boundary < 0.95
    for share, sticks in ((0.98 * boundary, False), (1.02 * boundary, True)):
        run, _ = forced(q, share, 600, 4096)
        assert np.any(run.extra[:, SLIDE2] == 0.0) == sticks


def test_weak_drive_never_moves_a_mass():
    """Below the limit nothing moves at all, and nothing is lost."""
    rig, setting = Rig(), Setting(60.0, 0.3, 1.0)
    enough = 1.01 * (rig.drive_force(setting) + rig.static_force(setting))
    run = run_hybrid(rig, setting, ROCKS[4], 1.0, 1e3, effects=[HELD, make("indenter-friction", fc2=enough)])
    assert np.all(run.x2 == 0.0) and np.all(run.v2 == 0.0) and np.all(run.v1 == 0.0)
    assert np.all(run.force == 0.0) and len(run.switches.time) == 0 and np.all(run.energy.effects == 0.0)
    less = 0.99 * (rig.drive_force(setting) + rig.static_force(setting))
    moved = run_hybrid(rig, setting, ROCKS[4], 1.0, 1e3, effects=[HELD, make("indenter-friction", fc2=less)])
    # it gives way once, into the rock, and is held there
    assert np.any(moved.v2 > 0.0) and len(moved.switches.time) == 1 and moved.end.v2 == 0.0
    assert moved.end.w > 0.0 and moved.end.regime == LOADING
    # it first gives way where the drive has risen to what the spring leaves of the limit
    breaks = math.asin((less - rig.static_force(setting)) / rig.drive_force(setting)) / (2 * math.pi * 60)
    first = moved.switches.time[0]
    assert abs(first - breaks) < 1e-9


# --- SciPy


class Peer:
    """SciPy's DOP853 in absolute coordinates: contact as in the paper, each mass sliding or held as the forces say."""

    def __init__(self, rig, setting, rock, limits, max_step=1e-4):
        self.rig, self.setting, self.limits, self.max_step = rig, setting, limits, max_step
        self.k = {FREE: 0.0, LOADING: rock.loading_stiffness, UNLOADING: rock.unloading_stiffness}

    def forces(self, t, z, regime, xp, xf):
        """On both masses, without friction."""
        rig, depth = self.rig, {FREE: 0.0, LOADING: z[1] - xp, UNLOADING: z[1] - xf}[regime]
        pair = rig.stiffness * (z[0] - z[1]) + rig.damping * (z[2] - z[3])
        drive = rig.drive_force(self.setting) * math.sin(2 * math.pi * self.setting.frequency * t)
        return rig.static_force(self.setting) - pair, drive + pair - self.k[regime] * depth

    def run(self, seconds):
        rig, masses = self.rig, (self.rig.shaker_mass, self.rig.indenter_mass)
        t, z, regime, xp, xf = (
            0.0,
            np.array([rig.static_force(self.setting) / rig.stiffness, 0.0, 0.0, 0.0]),
            FREE,
            0,
            0,
        )
        slides, log, holds = [1, 1], [], []
        fresh = [i for i in (0, 1) if i == 1 or self.limits[i] > 0.0]
        while True:
            # masses that have come to rest: held, or pushed on
            for i in fresh:
                force = self.forces(t, z, regime, xp, xf)[i]
                slides[i] = 0 if abs(force) <= self.limits[i] else int(np.sign(force))
                z[2 + i] = 0.0
                holds.append((t, i, slides[i]))
            fresh = []
            if slides[1] and z[3] == 0.0:
                # the contact goes the way the indenter goes
                after = {
                    (FREE, 1): LOADING if z[1] >= xf else FREE, (FREE, -1): FREE, (LOADING, -1): UNLOADING,
                    (UNLOADING, 1): LOADING,
                }.get((regime, slides[1]), regime)  # fmt: skip
                if (regime, after) == (LOADING, UNLOADING):
                    xf = z[1] - self.k[LOADING] * (z[1] - xp) / self.k[UNLOADING]
                if (regime, after) == (UNLOADING, LOADING):
                    xp = z[1] - self.k[UNLOADING] * (z[1] - xf) / self.k[LOADING]
                if after != regime:
                    log.append((t, after))
                    regime = after

            def flow(t, z, regime=regime, xp=xp, xf=xf, s=tuple(slides)):
                force = self.forces(t, z, regime, xp, xf)
                return [z[2], z[3], *((force[i] - s[i] * self.limits[i]) / masses[i] if s[i] else 0.0 for i in (0, 1))]

            events = []
            for i, slide in enumerate(slides):
                if i == 0 and self.limits[i] == 0.0:
                    continue
                if slide:
                    events.append((lambda t, z, i=i, s=slide: s * z[2 + i], -1.0, ("rest", i)))
                else:
                    events.append(
                        (
                            lambda t, z, i=i, r=regime, xp=xp, xf=xf: (
                                abs(self.forces(t, z, r, xp, xf)[i]) - self.limits[i]
                            ),
                            1.0,
                            ("loose", i),
                        )
                    )
            if regime == FREE:
                events.append((lambda t, z, xf=xf: z[1] - xf, 1.0, ("touch", 1)))
            if regime == UNLOADING:
                events.append((lambda t, z, xf=xf: z[1] - xf, -1.0, ("leave", 1)))
            functions = []
            for function, direction, _ in events:

                def event(t, z, function=function):
                    return function(t, z)

                event.terminal, event.direction = True, direction
                functions.append(event)
            part = solve_ivp(
                flow, (t, seconds), z, "DOP853", events=functions, rtol=1e-12, atol=1e-15, max_step=self.max_step,
                first_step=min(1e-7, 0.5 * (seconds - t)),
            )  # fmt: skip
            t, z = part.t[-1], part.y[:, -1].copy()
            if part.status == 0:
                return (
                    z,
                    xf if regime != LOADING else z[1] - self.k[LOADING] * (z[1] - xp) / self.k[UNLOADING],
                    log,
                    holds,
                )
            which = [len(found) > 0 for found in part.t_events].index(True)
            what, i = events[which][2]
            if what == "rest":
                fresh = [i]
            elif what == "loose":
                force = self.forces(t, z, regime, xp, xf)[i]
                slides[i] = int(np.sign(force))
                holds.append((t, i, slides[i]))
            elif what == "touch":
                regime, xp, z[1] = LOADING, xf, xf
                log.append((t, regime))
            else:
                regime, z[1] = FREE, xf
                log.append((t, regime))


@pytest.mark.parametrize(
    ("setting", "case", "fc1", "fc2", "periods"),
    [
        (Setting(60.0, 0.45, 1.0), 4, 0.0, 30.0, 8),
        (Setting(60.0, 0.45, 1.0), 4, 45.0, 0.0, 8),
        (Setting(60.0, 0.45, 1.0), 4, 45.0, 60.0, 8),
        (Setting(90.0, 0.40, 1.4), 2, 150.0, 160.0, 10),
        (Setting(50.0, 0.35, 1.6), 5, 260.0, 260.0, 8),
    ],
)
def test_friction_and_contact_agree_with_scipy(setting, case, fc1, fc2, periods):
    chosen = [make("guide-friction", fc1=fc1), make("indenter-friction", fc2=fc2)]
    seconds = periods * setting.period
    run = run_hybrid(Rig(), setting, ROCKS[case], seconds, 200e3, effects=chosen)
    z, xf, log, holds = Peer(Rig(), setting, ROCKS[case], (fc1, fc2)).run(seconds)
    assert len(log) >= 12
    assert [regime for _, regime in log] == list(run.switches.after)
    assert np.max(np.abs(run.switches.time - [t for t, _ in log])) < 1e-9
    ours = [run.end.y, run.end.v1, run.end.v2, run.penetration[-1]]
    assert np.allclose(ours, [z[0] - z[1], z[2], z[3], xf], rtol=0, atol=1e-9)
    # who sticks when: between two changes the peer and the samples say the same
    for mass, limit in enumerate((fc1, fc2)):
        if limit > 0.0:
            changes = [(t, slide) for t, i, slide in holds if i == mass] + [(seconds, 0)]
            for (t, slide), (until, _) in pairwise(changes):
                inside = (run.time > t + 1e-8) & (run.time < until - 1e-8)
                assert np.all(run.extra[inside, (SLIDE1, SLIDE2)[mass]] == slide)
            assert any(slide == 0 for t, slide in changes[:-1])


# --- Its own definition


def drawn_case(rng):
    """A random setting, rock and pair of limits, from a hardly felt friction to one that holds all."""
    setting = Setting(rng.uniform(40, 150), rng.uniform(0.2, 0.8), rng.uniform(0.4, 2.5))
    limits = 10 ** rng.uniform(0.0, 3.0, 2) * (rng.random(2) > 0.2)
    return setting, ROCKS[int(rng.integers(1, 7))], float(limits[0]), float(limits[1])


def check_definition(rig, setting, run, fc1, fc2):
    """|friction| below the limit at rest, and the limit against the motion otherwise."""
    theta = 2 * math.pi * setting.frequency * run.time
    y, closing = run.x1 - run.x2, run.v1 - run.v2
    pair = rig.stiffness * y + rig.damping * closing
    on_shaker = rig.static_force(setting) - pair
    on_indenter = rig.drive_force(setting) * np.sin(theta) + pair - run.force
    for speed, force, slide, limit in (
        (run.v1, on_shaker, run.extra[:, SLIDE1], fc1),
        (run.v2, on_indenter, run.extra[:, SLIDE2], fc2),
    ):
        if limit == 0.0:
            continue
        held = slide == 0.0
        assert np.all(speed[held] == 0.0)
        assert np.all(np.abs(force[held]) <= limit * (1 + 1e-8) + 1e-6)
        assert np.all(slide[~held] * speed[~held] >= -1e-15)
    friction = rig.indenter_mass * run.acceleration - on_indenter
    assert np.allclose(friction[run.v2 > 1e-9], -fc2, rtol=0, atol=1e-6)
    assert np.allclose(friction[run.v2 < -1e-9], fc2, rtol=0, atol=1e-6)
    assert np.max(np.abs(friction)) <= fc2 + 1e-6
    energy = run.energy
    assert abs(energy.error) < 1e-9 * (abs(energy.drive) + energy.stored_before)
    assert np.all(energy.effects <= 0.0) and energy.rock >= -1e-12
    gap = run.x2 - run.penetration
    assert (
        np.max(gap[run.regime == FREE], initial=-1.0) < 1e-14 and np.min(gap[run.regime != FREE], initial=1.0) > -1e-14
    )


def test_friction_does_what_it_says_at_random_settings():
    rng = np.random.default_rng(0)
    for _ in range(12):
        setting, rock, fc1, fc2 = drawn_case(rng)
        chosen = [make("guide-friction", fc1=fc1), make("indenter-friction", fc2=fc2)]
        run = run_hybrid(Rig(), setting, rock, 0.5, 20e3, effects=chosen)
        check_definition(Rig(), setting, run, fc1, fc2)


@pytest.mark.slow
def test_friction_does_what_it_says_at_many_settings():
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(150):
        setting, rock, fc1, fc2 = drawn_case(rng)
        rig = Rig(shaker_mass=10 ** rng.uniform(1.0, 2.6), damping=10 ** rng.uniform(2.0, 3.7))
        chosen = [make("guide-friction", fc1=fc1), make("indenter-friction", fc2=fc2)]
        run = run_hybrid(rig, setting, rock, 1.0, 10e3, effects=chosen)
        check_definition(rig, setting, run, fc1, fc2)
        held += np.any(run.extra[:, [SLIDE1, SLIDE2]] == 0.0)
    assert held > 100


def test_mass_may_be_held_while_the_rock_swings():
    """The indenter sticks, the rock on its mount goes on: contact turns round and ends though the indenter rests."""
    setting = Setting(60.0, 0.3, 0.6)
    soft = make("rock-mount-compliance", s_r=2e-6, m_r=2.0, zeta_r=0.01)
    start = Start(0.0, 0.0, 0.5, 0.0, LOADING, (0.0,) * 7)
    run = run_hybrid(
        Rig(), setting, ROCKS[4], 0.2, 50e3, start=start, effects=[HELD, make("indenter-friction", fc2=900.0), soft]
    )
    held = run.extra[:, SLIDE2] == 0.0
    assert np.any(held & (run.regime == LOADING)) and np.any(held & (run.regime == UNLOADING))
    assert np.any(held & (run.regime == FREE))
    assert abs(run.energy.error) < 1e-10
    assert np.all(run.energy.effects[:2] <= 0.0) and run.energy.effects[1] < 0.0


def test_run_with_friction_goes_on_where_it_ended():
    setting = Setting(60.0, 0.45, 1.0)
    chosen = [make("guide-friction", fc1=150.0), make("indenter-friction", fc2=160.0)]
    whole = run_hybrid(Rig(), setting, ROCKS[4], 1.0, 1e4, effects=chosen)
    held = [
        float(whole.time[(whole.extra[:, (SLIDE1, SLIDE2)[mass]] == 0.0) & (whole.time > 0.3)][0]) for mass in (0, 1)
    ]
    for at in (0.5, *held):
        first = run_hybrid(Rig(), setting, ROCKS[4], at, 0.0, effects=chosen)
        second = run_hybrid(Rig(), setting, ROCKS[4], 1.0 - at, 0.0, first.end_phase, first.end, chosen)
        assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-9)
        assert second.end.regime == whole.end.regime and second.end.extra == whole.end.extra
        assert abs(first.end_origin + second.end_origin - whole.end_origin) < 1e-9
        # what slides or sticks follows from the speeds and the forces, so a start need not say it
        silent = first.end._replace(extra=())
        again = run_hybrid(Rig(), setting, ROCKS[4], 1.0 - at, 0.0, first.end_phase, silent, chosen)
        assert again.end == second.end
        assert at == 0.5 or 0.0 in first.end.extra[::2]


def test_samples_leave_friction_alone():
    chosen = [make("guide-friction", fc1=45.0), make("indenter-friction", fc2=60.0)]
    none, fine = (run_hybrid(Rig(), Setting(60.0, 0.45, 1.0), ROCKS[4], 0.3, rate, effects=chosen) for rate in (0, 3e4))
    assert none.end == fine.end and none.steps == fine.steps
    assert np.array_equal(none.impacts.force, fine.impacts.force)


def test_one_friction_a_mass():
    other = Chosen(make("guide-friction").effect.__class__(**{
        **{name: getattr(HELD.effect, name) for name in HELD.effect.__slots__}, "name": "more-friction",
    }), (3.0, *HELD.values[1:]))  # fmt: skip
    with pytest.raises(InputError, match="guide-friction and more-friction both set the shaker grip") as caught:
        run_hybrid(Rig(), Setting(60.0, 0.45, 1.0), ROCKS[4], 0.1, 0.0, effects=[HELD, other])
    assert "\n" not in str(caught.value)


def test_smooth_friction_agrees_with_scipy():
    """One flight of both masses, in which the shaker turns back several times within the transition speed."""
    rig, setting, (fc1, vs1, fc2, vs2) = Rig(), Setting(60.0, 0.45, 0.2), (45.0, 2e-3, 30.0, 2e-2)
    start = Start(0.0, 1e-3, -0.4, -0.05, FREE)
    chosen = [make("guide-friction", fc1=fc1, vs1=vs1), make("indenter-friction", fc2=fc2, vs2=vs2)]
    run = run_hybrid(rig, setting, ROCKS[1], 0.02, 5e3, start=start, effects=chosen)
    assert not run.force.any() and (np.diff(np.sign(run.v1)) != 0).any()

    def slope(t, x):
        y, v1, v2, _place = x
        spring = rig.stiffness * y + rig.damping * (v1 - v2)
        push = rig.drive_force(setting) * np.sin(2 * np.pi * setting.frequency * t)
        return (
            v1 - v2,
            (rig.static_force(setting) - spring - fc1 * np.tanh(v1 / vs1)) / rig.shaker_mass,
            (push + spring - fc2 * np.tanh(v2 / vs2)) / rig.indenter_mass,
            v2,
        )

    own = slice(0, 4)
    found = solve_ivp(slope, (0.0, 0.02), start[own], t_eval=run.time, rtol=1e-11, atol=1e-14, method="DOP853").y
    np.testing.assert_allclose(run.v1, found[1], atol=1e-9)
    np.testing.assert_allclose(run.v2, found[2], atol=1e-8)


def test_sharp_transition_comes_to_dry_friction():
    setting = Setting(60.0, 0.45, 1.0)
    runs = [
        run_hybrid(Rig(), setting, ROCKS[4], 0.03, 5e3, effects=[make("guide-friction", fc1=60.0, vs1=vs1)])
        for vs1 in (0.0, 1e-5, 1e-4)
    ]
    dry, sharp, less = (run.v1 for run in runs)
    assert np.abs(sharp - dry).max() < 0.3 * np.abs(less - dry).max() < 1e-4


# --- Along a motion that is known


def _path(rate):
    """Time, position and velocity of a body that turns round at several speeds."""
    time, turn = np.arange(0.0, 2.0, 1.0 / rate), 2.0 * math.pi * np.array([1.2, 3.1])
    sizes = np.array([0.01, 0.003])
    return time, np.sin(np.outer(time, turn)) @ sizes, np.cos(np.outer(time, turn)) @ (sizes * turn)


@pytest.mark.parametrize(("sd", "rs"), [(0.0, 0.0), (3.0, 0.0), (3.0, 0.5)], ids=["dahl", "damped", "lugre"])
@pytest.mark.parametrize(("rate", "most"), [(1000.0, 2e-3), (10_000.0, 2e-5)])
def test_bristles_along_a_path_are_those_of_scipy(sd, rs, rate, most):
    fc, ds, vr = 5.0, 2e-5, 0.02
    time, x, v = _path(rate)
    dense, _, speeds = _path(1e5)

    def sliding(speed):
        return fc * (1.0 + rs * np.exp(-((speed / vr) ** 2)))

    def bends(t, b):
        speed = np.interp(t, dense, speeds)
        return fc / ds * (speed - abs(speed) * b / sliding(speed))

    run = solve_ivp(bends, (0.0, time[-1]), [sliding(v[0])], "LSODA", time, rtol=1e-9, atol=1e-9, max_step=1e-4)
    give = v - np.abs(v) * run.y[0] / sliding(v)
    chosen = make("dry-friction", fc=fc, ds=ds, sd=sd, rs=rs, vr=vr)
    force = chosen.effect.on_body(x, v, 0.0 * x, 0.0, chosen.values)
    assert np.sqrt(np.mean((force + run.y[0] + sd * give) ** 2)) < most * fc
    # each row of several motions is a motion of its own
    two = chosen.effect.on_body(np.stack([x, -x]), np.stack([v, -v]), np.zeros((2, x.size)), 0.0, chosen.values)
    assert np.array_equal(two, np.stack([force, -force]))


@pytest.mark.parametrize(
    "values", [{}, {"vs": 1e-3}, {"rs": 0.6, "vr": 0.02}, {"vs": 1e-3, "rs": 0.6, "vr": 0.02}], ids=str
)
def test_friction_without_bristles_has_no_memory(values):
    _, x, v = _path(1000.0)
    chosen = make("dry-friction", fc=5.0, **values)
    force = chosen.effect.on_body(x, v, 0.0 * x, 0.0, chosen.values)
    level = 5.0 * (1.0 + values.get("rs", 0.0) * np.exp(-((v / values.get("vr", 1.0)) ** 2)))
    way = np.tanh(v / values["vs"]) if "vs" in values else np.sign(v)
    assert np.allclose(force, -level * way, rtol=1e-12, atol=1e-12)


def test_bristles_that_hardly_give_are_dry_friction():
    _, x, v = _path(1000.0)
    stiff, dry = make("dry-friction", fc=5.0, ds=1e-12), make("dry-friction", fc=5.0)
    forces = [each.effect.on_body(x, v, 0.0 * x, 0.0, each.values) for each in (stiff, dry)]
    # they turn round with the body, which has its way from one sample to the next
    differ = np.abs(forces[0] - forces[1]) > 1e-9
    assert np.count_nonzero(differ) <= np.count_nonzero(np.diff(np.sign(v)))
