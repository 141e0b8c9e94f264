import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from drillenv.checks import InputError
from drillenv.dynamics import effects
from drillenv.dynamics.constitutive.places import CODE
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.hybrid.advance import WENT_ON
from drillenv.dynamics.hybrid.model import Start, model_for, motion_at, tables_of
from drillenv.dynamics.hybrid.run import SAMPLE_COLUMNS, extras_table, integrate, run_hybrid
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.vector_field import CARRY, ORIGIN, THETA
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS, Rock

CHAOS = Setting(120.0, 0.45, 1.0)


class Peer:
    """SciPy's DOP853 in absolute coordinates with Xp and Xf spelled out; steps short enough to miss no contact."""

    def __init__(self, rig, setting, rock, n_l=1.0, n_u=1.0, d0=1e-4, max_step=1.5e-4):
        self.rig, self.rock, self.setting, self.max_step = rig, rock, setting, max_step
        self.law = {
            LOADING: lambda d: rock.loading_stiffness * d0 * np.sign(d) * (abs(d) / d0) ** n_l,
            UNLOADING: lambda d: rock.unloading_stiffness * d0 * np.sign(d) * (abs(d) / d0) ** n_u,
        }
        self.depth = {
            LOADING: lambda r: d0 * (r / (rock.loading_stiffness * d0)) ** (1 / n_l),
            UNLOADING: lambda r: d0 * (r / (rock.unloading_stiffness * d0)) ** (1 / n_u),
        }

    def run(self, seconds):
        rig = self.rig
        f_a, f_b = rig.drive_force(self.setting), rig.static_force(self.setting)
        omega = 2 * math.pi * self.setting.frequency
        m1, m2, k, c = rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping
        t, z, regime, impacts, switches = 0.0, np.array([f_b / k, 0.0, 0.0, 0.0]), LOADING, [], []
        xp = xf = 0.0

        while True:
            law, foot = self.law.get(regime), xp if regime == LOADING else xf

            def flow(t, z, law=law, foot=foot):
                pair = k * (z[0] - z[1]) + c * (z[2] - z[3])
                r = law(z[1] - foot) if law else 0.0
                return [z[2], z[3], (f_b - pair) / m1, (f_a * math.sin(omega * t) + pair - r) / m2]

            def reach(t, z, xf=xf):
                return z[1] - xf

            def stop(t, z):
                return z[3]

            reach.terminal = stop.terminal = True
            reach.direction = 1.0 if regime == FREE else -1.0
            stop.direction = -1.0 if regime == LOADING else 1.0
            events = {FREE: [reach], LOADING: [stop], UNLOADING: [stop, reach]}[regime]
            # the first steps off a switch are short, so that the event just handled is left behind
            part = solve_ivp(
                flow, (t, seconds), z, "DOP853", events=events, rtol=1e-12, atol=1e-15, max_step=self.max_step,
                first_step=min(1e-7, 0.5 * (seconds - t)),
            )  # fmt: skip
            t, z = part.t[-1], part.y[:, -1].copy()
            if part.status == 0:
                return z, xf, np.array(impacts), switches
            hit = [len(found) > 0 for found in part.t_events]
            if regime == FREE:
                regime, xp, z[1] = LOADING, xf, xf
            elif regime == LOADING:
                force = self.law[LOADING](z[1] - xp)
                impacts.append((t, force, z[1] - xp))
                regime, xf, z[3] = UNLOADING, z[1] - self.depth[UNLOADING](force), 0.0
            elif hit[0]:
                force = self.law[UNLOADING](z[1] - xf)
                regime, xp, z[3] = LOADING, z[1] - self.depth[LOADING](force), 0.0
            else:
                regime, z[1] = FREE, xf
            switches.append((t, regime))


def compare(run, peer, tolerance):
    z, xf, impacts, switches = peer
    assert [regime for _, regime in switches] == list(run.switches.after[1:])  # the first: touching to loading
    assert np.max(np.abs(run.switches.time[1:] - [t for t, _ in switches])) < tolerance * 1e-3
    assert np.max(np.abs(run.impacts.time - impacts[:, 0])) < tolerance * 1e-3
    assert np.max(np.abs(run.impacts.force - impacts[:, 1])) < tolerance * 1e3
    assert np.max(np.abs(run.impacts.depth - impacts[:, 2])) < tolerance * 1e-4
    ours = [run.x1[-1], run.x2[-1], run.v1[-1], run.v2[-1], run.penetration[-1]]
    assert np.max(np.abs(np.array(ours) - [*z, xf])) < tolerance


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "case", "periods"),
    [(Setting(50.0, 0.45, 1.0), 4, 50), (Setting(120.0, 0.40, 1.0), 2, 50), (Setting(90.0, 0.45, 1.4), 4, 50)],
)
def test_linear_law_agrees_with_scipy(setting, case, periods):
    seconds = periods * setting.period
    run = run_hybrid(Rig(), setting, ROCKS[case], seconds, 1 / seconds)
    assert len(run.impacts.time) > 40
    compare(run, Peer(Rig(), setting, ROCKS[case]).run(seconds), 1e-10)


def test_power_law_agrees_with_scipy():
    setting, seconds = Setting(60.0, 0.45, 1.0), 12 / 60.0
    chosen = [effects.make("contact-power-law", n=1.5)]
    run = run_hybrid(Rig(), setting, ROCKS[4], seconds, 1 / seconds, effects=chosen)
    assert len(run.impacts.time) > 10
    compare(run, Peer(Rig(), setting, ROCKS[4], 1.5, 1.5).run(seconds), 1e-10)


def test_energy_balance_closes():
    every = [
        effects.make("contact-rate", chi=0.5),
        effects.make("contact-power-law", n=1.2),
        effects.make("damping-quadratic", c2=500.0),
        effects.make("stiffness-hardening", k3=1e9),
        effects.make("drive-harmonics", h2=0.1, phi2=0.3, h3=0.05, phi3=-1.0),
        effects.make("drive-droop", s=1 / 200),
        effects.make("air-spring", k_a=2e3, tau=0.5),
        effects.make("rock-mount-compliance", s_r=2e-8, m_r=20.0, zeta_r=0.1),
    ]
    for chosen in ([], every):
        energy = run_hybrid(Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4], 1.0, 0.0, effects=chosen).energy
        assert abs(energy.error) < 1e-9 * energy.drive
        assert energy.damper > 0 and energy.rock > 0 and energy.static > 0


def test_no_contact_is_missed():
    """Off the rock means off the rock, in and out have their signs, and forces do not pull: at 200 kHz, 500 periods."""
    run = run_hybrid(Rig(), CHAOS, ROCKS[4], 500 / 120, 200e3)
    gap = run.x2 - run.penetration
    assert np.max(gap[run.regime == FREE]) < 1e-15
    assert np.min(gap[run.regime != FREE]) > -1e-15
    assert np.min(run.v2[run.regime == LOADING]) > -1e-15
    assert np.max(run.v2[run.regime == UNLOADING]) < 1e-15
    assert np.min(run.force) == 0.0
    assert np.all(run.force[run.regime == FREE] == 0.0)
    # no switch leads anywhere else than where the one before ended
    assert np.array_equal(run.switches.before[1:], run.switches.after[:-1])
    # regimes sampled are the regimes logged
    at = np.searchsorted(run.switches.time, run.time, side="left")
    logged = np.concatenate([[FREE], run.switches.after])[at]
    assert np.mean(logged != run.regime) < 1e-5


@pytest.mark.parametrize("phase", np.linspace(0.2, 6.2, 7))
def test_grazing_is_decided_to_the_last_digits(phase):
    """A flight is shifted so that its highest point just reaches, or just misses, the rock."""
    far = Start(0.003, 0.0, -0.05, -0.5, FREE)
    flight = run_hybrid(Rig(), Setting(60.0, 0.45, 1.0), ROCKS[4], 0.02, 1e6, phase, far)
    assert len(flight.switches.time) == 0
    inside = np.flatnonzero((flight.x2[1:-1] > flight.x2[:-2]) & (flight.x2[1:-1] > flight.x2[2:])) + 1
    assert inside.size, "this flight has no highest point"
    top = inside[0]
    a, _, c = flight.x2[top - 1 : top + 2] - flight.x2[top]
    height = flight.x2[top] - (a - c) ** 2 / (8 * (a + c))
    earlier = flight.time[top] + 1e-6
    assert np.all(flight.x2[: top - 1] < height)
    for shift, contacts in ((1e-13, 1), (-1e-13, 0)):
        start = far._replace(w=-(height + 0.5) - 0.5 + 0.5 + shift)
        run = run_hybrid(Rig(), Setting(60.0, 0.45, 1.0), ROCKS[4], earlier + 1e-5, 0.0, phase, start)
        assert np.sum(run.switches.after == LOADING) == contacts


def test_sample_rate_leaves_the_motion_alone():
    bare, fine = (run_hybrid(Rig(), CHAOS, ROCKS[4], 0.5, rate) for rate in (0.0, 30e3))
    assert bare.end == fine.end and bare.steps == fine.steps
    assert np.array_equal(bare.impacts.force, fine.impacts.force)
    assert bare.time.size == 0 and fine.time.size == 15001 and fine.x1.shape == (15001,)


def test_samples_are_the_motion():
    """Every sample is what a run of just that length ends in."""
    setting = Setting(60.0, 0.45, 1.0)
    whole = run_hybrid(Rig(), setting, ROCKS[4], 0.1, 1e3)
    for i in range(0, 101, 7):
        part = run_hybrid(Rig(), setting, ROCKS[4], whole.time[i], 0.0)
        assert abs(part.end.v2 - whole.v2[i]) < 1e-11
        assert abs(part.end_origin + part.end.w - whole.x2[i]) < 1e-14


CORNERED = {
    "force-limit": (
        {"F_max": 180.0, "F_s": 190.0},
        {"drive-curve": (-180.0, 180.0), "spring": (-190 / 7e4, 190 / 7e4)},
    ),
    "backlash": ({"g": 4e-4, "y0": -5e-5}, {"spring-from-rest": (-5e-5, 3.5e-4)}),
    "damping-quadratic": ({"c2": 500.0}, {"damper": (0.0,)}),
}
"""Effects with corners, and where these lie at a stiffness of the coupling of 7e4 N/m."""


@pytest.mark.parametrize("name", CORNERED)
def test_corners_are_found_in_the_law(name):
    values, wanted = CORNERED[name]
    found = {place: table for place, _over, table in tables_of(effects.make(name, **values), 7e4)}
    assert set(found) == {CODE[place] for place in wanted}
    for place, corners in wanted.items():
        table = found[CODE[place]]
        at = table.knots[1:-1][table.corners]
        assert np.allclose(at, corners, rtol=1e-9, atol=1e-12), place


@pytest.mark.parametrize(
    "chosen",
    [
        effects.make("force-limit", F_max=180.0),
        effects.make("force-limit", F_s=200.0),
        effects.make("backlash", g=4e-4, y0=-5e-5),
    ],
    ids=lambda chosen: chosen.effect.name,
)
def test_steps_end_on_corners(chosen):
    """A step across a corner is of low order: a coarse run would be off by far more, or a fine one far longer."""
    setting = Setting(60.0, 0.45, 1.0)
    fine, coarse = (run_hybrid(Rig(), setting, ROCKS[4], 0.1, 1e3, effects=[chosen], rtol=r) for r in (1e-12, 1e-9))
    plain = run_hybrid(Rig(), setting, ROCKS[4], 0.1, 1e3, rtol=1e-12)
    assert fine.steps < 2 * plain.steps and coarse.steps < 0.7 * fine.steps
    assert np.allclose(fine.x2, coarse.x2, rtol=0.0, atol=1e-10) and np.ptp(fine.x2) > 1e-5


def test_run_goes_on_where_it_ended():
    setting = Setting(60.0, 0.45, 1.0)
    chosen = [effects.make("rock-mount-compliance", s_r=2e-8), effects.make("air-spring", k_a=2e3, tau=0.5)]
    whole = run_hybrid(Rig(), setting, ROCKS[4], 0.25, 0.0, effects=chosen)
    first = run_hybrid(Rig(), setting, ROCKS[4], 0.1, 0.0, effects=chosen)
    second = run_hybrid(Rig(), setting, ROCKS[4], 0.15, 0.0, first.end_phase, first.end, chosen)
    assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-11)
    assert np.allclose(second.end.extra, whole.end.extra, rtol=0, atol=1e-9)
    assert second.end.regime == whole.end.regime
    assert abs(first.end_origin + second.end_origin - whole.end_origin) < 1e-13
    count = len(first.impacts.time)
    assert np.allclose(second.impacts.time + 0.1, whole.impacts.time[count:], rtol=0, atol=1e-12)


def every_effect():
    """Every effect that acts on the motion, in the middle of its typical strength."""
    moving = [effect for effect in effects.REGISTRY.values() if effect.moves_rig]
    middle = {e.name: {p.symbol: sum(p.typical) / 2 for p in e.parameters} for e in moving}
    return tuple(effects.make(name, **values) for name, values in middle.items())


def test_one_second_is_two_halves_with_every_effect():
    """Slides, counts of impacts, pressures and the mount are carried over."""
    setting, chosen = Setting(60.0, 0.45, 1.0), every_effect()
    whole = run_hybrid(Rig(), setting, ROCKS[4], 1.0, 0.0, effects=chosen)
    first = run_hybrid(Rig(), setting, ROCKS[4], 0.5, 0.0, effects=chosen)
    second = run_hybrid(Rig(), setting, ROCKS[4], 0.5, 0.0, first.end_phase, first.end, chosen)
    assert len(whole.impacts.time) > 50
    assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-9)
    assert np.allclose(second.end.extra, whole.end.extra, rtol=1e-9, atol=1e-9)
    assert abs(second.end.face - whole.end.face) < 1e-9 and second.end.regime == whole.end.regime
    assert abs(first.end_origin + second.end_origin - whole.end_origin) < 1e-9


def test_intervals_by_the_kernel_are_the_run():
    """What drives the engine interval by interval, the setting changed in between: one motion, copied on the way."""
    chosen, settings = every_effect(), [Setting(60.0, 0.45, 1.0), Setting(75.0, 0.5, 1.2), Setting(60.0, 0.4, 0.8)]
    start, phase, place, motion = None, 0.3, 0.0, None
    for setting in settings:
        run = run_hybrid(Rig(), setting, ROCKS[4], 0.1, 0.0, phase, start, chosen)
        start, phase, place = run.end, run.end_phase, place + run.end_origin

        model = model_for(Rig(), setting, ROCKS[4], chosen)
        begins = motion is None
        motion = motion_at(model, chosen, None, 0.3) if motion is None else motion.copy()
        ends = []
        for d, z in (motion.copy(), motion):
            samples = np.zeros((0, SAMPLE_COLUMNS))
            ended = integrate(
                True, model, d, z, begins, 0.1, 0.0, samples, extras_table(()), 1e-12, make_scratch(model)
            )
            assert ended[0] == WENT_ON
            ends.append((d, z))
        # copied, it goes on bit for bit
        assert all(np.array_equal(one, other) for one, other in zip(*ends, strict=True))
    assert motion is not None and start is not None
    d, z = motion
    # a run from a start chooses its first steps anew
    assert np.allclose(z[:4], start[:4], rtol=0.0, atol=1e-9) and d[0] == start.regime
    assert math.isclose(d[THETA], phase, abs_tol=1e-12)
    assert math.isclose(d[ORIGIN] + d[CARRY], place, abs_tol=1e-9)


def test_a_motion_that_goes_on_is_the_run():
    """In two parts by the kernel, without a start in between: steps, slides and counts go on."""
    setting, chosen = Setting(60.0, 0.45, 1.0), every_effect()
    whole = run_hybrid(Rig(), setting, ROCKS[4], 0.3, 5000.0, effects=chosen)
    model, extras = model_for(Rig(), setting, ROCKS[4], chosen), extras_table(chosen)
    d, z = motion_at(model, chosen, None)
    parts, impacts, scratch = [], [], make_scratch(model)
    for begins, seconds, count in ((True, 0.1, 500), (False, 0.2, 1001)):
        samples = np.zeros((count, SAMPLE_COLUMNS + len(extras)))
        status, _now, hits, _switches, _steps = integrate(
            True, model, d, z, begins, seconds, 5000.0, samples, extras, 1e-12, scratch
        )
        assert status == WENT_ON
        parts.append(samples)
        impacts.append(hits[:, 1])
    sampled = np.concatenate(parts)
    assert np.allclose(sampled[:, 1], whole.x2, rtol=0.0, atol=1e-12)
    assert np.allclose(sampled[:, 5], whole.force, rtol=0.0, atol=1e-6)
    assert np.allclose(sampled[:, SAMPLE_COLUMNS:], whole.extra, rtol=1e-9, atol=1e-9)
    assert np.allclose(np.concatenate(impacts), whole.impacts.force, rtol=1e-8)


def test_drift_costs_no_digits():
    """A period-one motion still repeats itself to rounding after 30 s, far from where it began."""
    setting, soft = Setting(120.0, 0.45, 1.0), Rock(1e6, 4e6)
    run = run_hybrid(Rig(), setting, soft, 30.0, 120.0)
    late = slice(-600, None)
    assert run.penetration[-1] > 0.5
    assert np.ptp(run.v2[late]) < 1e-9
    assert np.ptp(np.diff(run.penetration[late])) < 1e-11


def test_tolerance_is_kept():
    """Runs with other tolerances part only as fast as chaos makes them."""
    runs = [run_hybrid(Rig(), CHAOS, ROCKS[4], 0.25, 120.0, rtol=rtol) for rtol in (1e-12, 1e-13, 1e-10)]
    assert np.allclose(runs[0].v2, runs[1].v2, rtol=0, atol=1e-8)
    assert np.allclose(runs[0].v2, runs[2].v2, rtol=0, atol=1e-6)


def test_bad_input_is_said_in_one_line():
    setting = Setting(60.0, 0.45, 1.0)
    rate = effects.make("contact-rate", chi=0.5)
    for message, given in (
        ("seconds is -1 s", {"seconds": -1.0}),
        ("sample_rate", {"sample_rate": math.nan}),
        ("w <= 0 out of contact", {"start": Start(0.0, 0.0, 0.0, 1e-3, FREE)}),
        ("loading \\(1\\) moves in", {"start": Start(0.0, 0.0, -1.0, 1e-3, LOADING)}),
        ("start regime", {"start": Start(0.0, 0.0, -1.0, 1e-3, 3)}),
        ("extra states", {"start": Start(0.0, 0.0, 0.0, 0.0, FREE, (1.0,))}),
        ("given twice", {"effects": [rate, rate]}),
        ("effects.make", {"effects": ["contact-rate"]}),
    ):
        with pytest.raises(InputError, match=message) as caught:
            run_hybrid(
                **{"rig": Rig(), "setting": setting, "rock": ROCKS[4], "seconds": 0.1, "sample_rate": 0.0} | given
            )
        assert "\n" not in str(caught.value)


def test_results_pickle():
    run = run_hybrid(Rig(), Setting(60.0, 0.45, 1.0), ROCKS[4], 0.05, 1e3)
    again = pickle.loads(pickle.dumps(run))
    assert np.array_equal(again.x2, run.x2) and again.end == run.end


@pytest.mark.parametrize("name", ["none", "contact-rate", "rock-mount-compliance", "guide-friction"])
def test_samples_read_off_a_step_are_the_motion(name):
    """At a loose tolerance samples come from a polynomial through the step; at a tight one each is its own step."""
    values = {
        "contact-rate": {"chi": 0.5},
        "rock-mount-compliance": {"s_r": 4e-9, "m_r": 40.0, "zeta_r": 0.05},
        "guide-friction": {"fc1": 60.0},
    }
    chosen = [effects.make(name, **values[name])] if name != "none" else []
    given = (Rig(), Setting(60.0, 0.45, 1.0), Rock(21.4e6, 25.05e6), 0.06, 25600.0)
    tight, loose = (run_hybrid(*given, effects=chosen, rtol=rtol) for rtol in (1e-12, 1e-8))
    peak = tight.force.max()
    assert peak > 500.0
    np.testing.assert_allclose(loose.force, tight.force, atol=1e-6 * peak)
    np.testing.assert_allclose(loose.acceleration, tight.acceleration, atol=1e-6 * np.abs(tight.acceleration).max())


def test_a_loose_tolerance_is_kept_too():
    """From 1e-9 on events and samples are read off polynomials."""
    chosen = [effects.make("contact-rate", chi=0.5)]
    given = (Rig(), Setting(60.0, 0.45, 1.0), ROCKS[4], 0.1, 1e3)
    tight, *loose = (run_hybrid(*given, effects=chosen, rtol=rtol) for rtol in (1e-12, 1e-7, 1e-5))
    off = [np.abs(run.x2 - tight.x2).max() / np.ptp(tight.x2) for run in loose]
    assert off[0] < 1e-5 and off[1] < 1e-3
    assert loose[1].steps < loose[0].steps < 0.5 * tight.steps


# --- Laws that cannot be


def law_of(function, place="damper"):
    """An effect with one law."""
    parts = (
        effects.Parameter("a", "strength", "1", 0.0, 1.0, 0.0, (0.5, 1.0)),
        effects.Parameter("b", "teeth over 1 m/s", "s/m", 0.0, 100.0, 0.0, (5.0, 50.0)),
    )
    return effects.Effect(
        "own-law", "A law of one's own.", "f", "constitutive", parts, ("indenter",), effects.EVERYWHERE, "moves",
        laws={place: function},
    )  # fmt: skip


def _saw(x, p, stiffness):
    return p[0] * np.abs((p[1] * x) % 1.0 - 0.5)


def _few_teeth(x, p, stiffness):
    return p[0] * np.abs((p[1] * np.clip(x, -0.5, 0.5)) % 1.0 - 0.5)


def _nowhere_finite(x, p, stiffness):
    return np.where(x > 1.0, np.nan, p[0] * x)


def test_corners_up_to_a_limit():
    """Some forty of them are followed; more than 64 are refused, and so is what is not finite."""
    setting = Setting(60.0, 0.45, 1.0)
    few = Chosen(law_of(_few_teeth), (1.0, 20.0))
    (found,) = tables_of(few, 7e4)
    assert np.allclose(found[2].knots[1:-1][found[2].corners], np.arange(-20, 21) / 40, atol=1e-10)
    assert run_hybrid(Rig(), setting, ROCKS[4], 0.02, 0.0, effects=[few]).steps > 0
    for law, teeth, why in (
        (_saw, 10.0, "it has more than 64 corners"),
        (_saw, 50.0, "it has more than 64 corners"),
        (_nowhere_finite, 0.0, "it has values that are not finite"),
    ):
        with pytest.raises(InputError, match=f"the law of own-law at damper cannot be followed: .*{why}") as caught:
            run_hybrid(Rig(), setting, ROCKS[4], 0.02, 0.0, effects=[Chosen(law_of(law), (1.0, teeth))])
        assert "\n" not in str(caught.value)
