import math
import pickle
import re

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from drillenv.checks import InputError
from drillenv.dynamics import effects
from drillenv.dynamics.constitutive.places import CODE, SCALARS, Shape
from drillenv.dynamics.effects import ON_SHAKER, Channels, Effect, Extra, Parameter, drawn, make
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.hybrid.model import MEMORY
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.sensors import read
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS, Rock

RIG, SETTING, ROCK = Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4]
EVERY = sorted(effects.REGISTRY)
MOVING = [name for name in EVERY if effects.REGISTRY[name].moves_rig]
SENSORS = [name for name in EVERY if effects.REGISTRY[name].measure]
BODY = [name for name in EVERY if effects.REGISTRY[name].on_body]

# The mechanisms that a report may name, and where each acts.
MECHANISMS = {
    "contact-rate": "contact",
    "contact-power-law": "contact",
    "contact-toe": "contact",
    "rock-compaction": "contact",
    "rock-mount-compliance": "contact",
    "stiffness-hardening": "indenter, body",
    "damping-quadratic": "indenter, body",
    "indenter-friction": "indenter",
    "drive-harmonics": "indenter",
    "drive-droop": "indenter",
    "guide-friction": "shaker",
    "air-spring": "shaker",
    "accelerometer-resonance": "sensor",
    "accelerometer-lowpass": "sensor",
    "load-cell-inertia": "sensor",
    "channel-delay": "sensor",
    "mains-hum": "sensor",
    "sensor-offset": "sensor",
    "force-limit": "indenter, body",
    "viscous-damping": "body",
    "dry-friction": "body",
    "backlash": "indenter, body",
    "rock-rotation": "contact",
    "external-vibration": "shaker, indenter",
    "sensor-highpass": "sensor",
}


def run(*chosen, seconds=0.3, rate=20e3, setting=SETTING, **more):
    return run_hybrid(RIG, setting, ROCK, seconds, rate, effects=chosen, **more)


def strong(name):
    """The effect in the middle of its typical strength."""
    return make(name, **{p.symbol: sum(p.typical) / 2 for p in effects.REGISTRY[name].parameters})


def drawn_place(rng):
    """A random setting of the box and a little beyond, and a rock drawn from its spread."""
    setting = Setting(rng.uniform(45, 130), rng.uniform(0.25, 0.65), rng.uniform(0.5, 2.0))
    return setting, ROCKS[int(rng.integers(1, 7))].drawn(rng)


def test_every_mechanism_of_a_report_is_here():
    assert {name: ", ".join(effects.REGISTRY[name].balances) for name in EVERY} == MECHANISMS
    assert set(MOVING) | set(SENSORS) | set(BODY) == set(EVERY)
    assert not set(SENSORS) & (set(MOVING) | set(BODY))


def same(one, other):
    """Bitwise equality of everything but the extra states and the energies of effects."""
    for field in one._fields:
        if field not in ("extra", "end", "energy"):
            a, b = getattr(one, field), getattr(other, field)
            assert (
                all(np.array_equal(x, y) for x, y in zip(a, b, strict=True)) if isinstance(a, tuple) else np.all(a == b)
            )
    assert one.end[:5] == other.end[:5] and one.end.face == other.end.face
    assert one.energy[:4] == other.energy[:4]


@pytest.mark.parametrize("name", EVERY)
def test_entry_says_everything(name):
    effect = effects.REGISTRY[name]
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", effect.name) and effect.name == name
    assert effect.sentence.endswith(".") and effect.sentence.count(".") == 1
    assert effect.equation
    assert effect.source.startswith("constitutive") or re.search(r"\b(1[789]|20)\d\d\b", effect.source)
    assert set(effect.balances) <= {"contact", "indenter", "shaker", "sensor", "body"} and effect.balances
    assert set(effect.regimes) <= set(effects.EVERYWHERE) and effect.regimes
    assert effect.energy in ("loses", "stores", "moves", "none")
    assert effect.parameters
    for part in effect.parameters:
        assert part.unit and part.meaning and part.symbol.isidentifier()
        assert part.low <= part.neutral <= part.high and part.low < part.high
        assert part.low <= part.typical[0] <= part.typical[1] <= part.high
    assert not strong(name).is_neutral
    for extra in effect.extras:
        assert extra.unit and extra.meaning and extra.size > 0
        assert extra.kept in MEMORY, "no effect of this package needs a term with states of its own"
    assert set(effect.laws) <= set(CODE) and effect.term is None
    assert effect.scalars is None or set(effect.scalars(strong(name).values)) <= set(SCALARS)
    assert effect.moves_rig == (name in MOVING) == bool(effect.laws or effect.scalars)
    assert bool(effect.measure) == ("sensor" in effect.balances) and bool(effect.on_body) == ("body" in effect.balances)
    assert pickle.loads(pickle.dumps(effect)) == effect


@pytest.mark.parametrize("name", MOVING)
def test_neutral_values_change_nothing(name):
    effect = effects.REGISTRY[name]
    same(run(), run(make(name)))
    if effect.energy != "none":
        assert run(make(name)).energy.effects[0] == 0.0


def test_neutral_values_of_all_change_nothing():
    same(run(), run(*(make(name) for name in MOVING)))
    # those that scale a term by zero do so whatever the rest is set to
    same(run(), run(make("drive-harmonics", phi2=1.0, phi3=-2.0), make("air-spring", tau=0.02)))
    same(run(), run(make("rock-mount-compliance", m_r=3.0, zeta_r=0.7)))
    same(run(), run(make("contact-toe", r=0.5, e=0.3), make("rock-compaction", soft_n=30.0), make("backlash", y0=1e-3)))
    same(run(), run(make("rock-rotation", Omega=9.0, psi=1.0), make("external-vibration", f=33.0, psi=2.0)))


@pytest.mark.parametrize("name", MOVING)
def test_energy_has_the_right_sign(name):
    rng = np.random.default_rng(5)
    for seconds in (0.003, 0.05, 0.3):
        chosen = [strong(name)]
        check_energy(run(*chosen, seconds=seconds, rate=0), chosen)
    for _ in range(5):
        setting, rock = drawn_place(rng)
        chosen = [drawn(name, rng)]
        check_energy(run_hybrid(RIG, setting, rock, 0.4, 0.0, effects=chosen), chosen)


def check_energy(result, every):
    """The balance closes, and what can only take has taken."""
    energy = result.energy
    assert abs(energy.error) < 1e-9 * (abs(energy.drive) + energy.stored_before)
    assert energy.damper > 0
    for chosen, given in zip(every, energy.effects, strict=True):
        assert chosen.effect.energy != "loses" or given < 0.0
        assert chosen.effect.energy != "none" or given == 0.0
    assert energy.rock >= 0.0


@pytest.mark.parametrize("name", MOVING)
def test_effect_changes_the_motion(name):
    plain, changed = run(), run(strong(name))
    assert np.max(np.abs(plain.v2 - changed.v2)) > 1e-3
    assert np.all(np.isfinite(changed.extra)) and changed.extra.shape == (6001, len(effects.REGISTRY[name].extras))


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVING)
def test_typical_strengths_can_be_followed(name):
    """3 s at random settings on random rocks, alone and with one other effect."""
    rng = np.random.default_rng(MOVING.index(name))
    for _ in range(12):
        setting, rock = drawn_place(rng)
        chosen = [drawn(name, rng)]
        check_energy(run_hybrid(RIG, setting, rock, 3.0, 0.0, effects=chosen), chosen)
    for other in rng.choice([other for other in MOVING if other != name], 6, replace=False):
        setting, rock = drawn_place(rng)
        chosen = [drawn(name, rng), drawn(str(other), rng)]
        check_energy(run_hybrid(RIG, setting, rock, 1.0, 0.0, effects=chosen), chosen)


def test_all_effects_at_once_can_be_followed():
    rng = np.random.default_rng(3)
    for _ in range(3):
        setting, rock = drawn_place(rng)
        chosen = [drawn(name, rng) for name in MOVING]
        check_energy(run_hybrid(RIG, setting, rock, 0.5, 0.0, effects=chosen), chosen)


def on_indenter(result, setting=SETTING):
    """What the known forces leave of the indenter's balance, in N."""
    theta = 2 * math.pi * setting.frequency * result.time
    drive = RIG.drive_force(setting) * np.sin(theta)
    pair = RIG.stiffness * (result.x1 - result.x2) + RIG.damping * (result.v1 - result.v2)
    return RIG.indenter_mass * result.acceleration - drive - pair + result.force, theta


def test_plain_balance_leaves_nothing():
    assert np.max(np.abs(on_indenter(run())[0])) < 1e-9


def test_damping_quadratic_is_its_equation():
    result = run(make("damping-quadratic", c2=700.0))
    closing = result.v1 - result.v2
    assert np.allclose(on_indenter(result)[0], 700 * np.abs(closing) * closing, rtol=0, atol=1e-8)


def test_stiffness_hardening_is_its_equation_and_stores():
    result = run(make("stiffness-hardening", k3=2e9))
    y = result.x1 - result.x2
    assert np.allclose(on_indenter(result)[0], 2e9 * y**3, rtol=0, atol=1e-8)
    assert math.isclose(result.energy.effects[0], -2e9 / 4 * (y[-1] ** 4 - y[0] ** 4), rel_tol=1e-9)


def test_drive_harmonics_is_its_equation():
    result = run(make("drive-harmonics", h2=0.2, phi2=0.5, h3=0.1, phi3=-1.0))
    left, theta = on_indenter(result)
    added = RIG.drive_force(SETTING) * (0.2 * np.sin(2 * theta + 0.5) + 0.1 * np.sin(3 * theta - 1.0))
    assert np.allclose(left, added, rtol=0, atol=1e-7)


def test_drive_droop_is_a_smaller_drive():
    droop = run(make("drive-droop", s=1 / 150), rate=2e3)
    weak = Rig(drive_gain=1 / math.sqrt(1 + (90 / 150) ** 2))
    plain = run_hybrid(weak, SETTING, ROCK, 0.3, 2e3)
    assert np.allclose(droop.v2, plain.v2, rtol=0, atol=1e-9)
    assert math.isclose(droop.energy.drive + droop.energy.effects[0], plain.energy.drive, rel_tol=1e-9)


def test_air_spring_follows_its_state_equation():
    result = run(make("air-spring", k_a=5e3, tau=0.05), rate=200e3, seconds=0.1)
    s = result.extra[:, 0]
    # piecewise smooth only, so Simpson's rule is good to the kinks
    rebuilt = cumulative_simpson(5e3 * result.v1 - s / 0.05, x=result.time, initial=0.0)
    assert np.max(np.abs(s)) > 0.1
    assert np.allclose(s, rebuilt, rtol=0, atol=1e-7)
    static = RIG.static_force(SETTING)
    given = cumulative_simpson(-s * result.v1, x=result.time, initial=0.0)[-1]
    assert math.isclose(result.energy.effects[0], given, rel_tol=1e-6)
    assert math.isclose(result.energy.static, static * (result.x1[-1] - result.x1[0]), rel_tol=1e-9)


def place_in_rock(result):
    """Depths that the rock law sees in loading (from the turns logged) and unloading, for rows in each regime."""
    loading, unloading = result.regime == LOADING, result.regime == UNLOADING
    return loading, unloading, result.x2 - result.penetration


@pytest.mark.parametrize(("chi", "volts"), [(0.6, 0.45), (20.0, 2.0)])
def test_contact_rate_is_its_equation(chi, volts):
    """The second is so strong that the contact would pull on the way back."""
    result = run(make("contact-rate", chi=chi), rate=200e3, setting=Setting(90.0, volts, 1.0))
    loading, unloading, depth = place_in_rock(result)
    law = ROCK.unloading_stiffness * depth
    for rows in (loading, unloading):
        # Xf follows in loading so that k_u (X2 - Xf) is the force of the law there too
        expected = np.maximum(0.0, law * (1 + chi * result.v2))[rows]
        assert np.allclose(result.force[rows], expected, rtol=0, atol=1e-7)
    assert np.min(result.force) == 0.0
    assert (np.min(1 + chi * result.v2[unloading]) < 0) == (chi > 10)
    assert abs(result.energy.error) < 1e-9 * result.energy.drive


def test_peak_force_is_the_largest_on_the_way():
    result = run(make("contact-rate", chi=2.0), rate=500e3, seconds=0.15)
    for time, begun, force in zip(result.impacts.time, result.impacts.contact_time, result.impacts.force, strict=True):
        turns = result.switches.time[result.switches.after == LOADING]
        begun = max(begun, np.max(turns[turns < time]))
        seen = np.max(result.force[(result.time >= begun) & (result.time <= time)], initial=0.0)
        assert seen <= force * (1 + 1e-9) and force - seen < 1e-4 * force + 1e-2


@pytest.mark.parametrize("n", [0.8, 1.5, 2.0])
def test_power_law_is_its_equation(n):
    result = run(make("contact-power-law", n=n))
    loading, unloading, depth = place_in_rock(result)
    law = ROCK.unloading_stiffness * 1e-4 * (np.maximum(depth, 0.0) / 1e-4) ** n
    for rows in (loading, unloading):
        assert np.allclose(result.force[rows], law[rows], rtol=1e-9, atol=1e-6)
    at_turn = ROCK.loading_stiffness * 1e-4 * (result.impacts.depth / 1e-4) ** n
    assert np.allclose(result.impacts.force, at_turn, rtol=1e-12)
    assert result.energy.rock > 0 and np.all(np.diff(result.penetration[result.regime == FREE]) >= 0)


def test_mount_holds_what_it_took():
    compliance, mass = 3e-8, 15.0
    result = run(make("rock-mount-compliance", s_r=compliance, m_r=mass, zeta_r=0.0))
    speed, face = result.end.extra[0], result.end.face
    assert abs(face) > 1e-9
    held = 0.5 * mass * speed**2 + 0.5 * face**2 / compliance
    assert math.isclose(result.energy.effects[0], -held, rel_tol=1e-6, abs_tol=1e-9)
    # a block too heavy to move is as good as a rigid mount
    heavy = run(make("rock-mount-compliance", s_r=1e-5, m_r=1e4), seconds=0.05)
    assert np.max(np.abs(heavy.v2 - run(seconds=0.05).v2)) < 0.03


def test_light_stiff_mount_is_a_softer_rock():
    """Without inertia to speak of, springs in a row: 1/k_l + s_r and 1/k_u + s_r."""
    compliance = 1e-8
    mounted = run(make("rock-mount-compliance", s_r=compliance, m_r=0.1, zeta_r=1.0), seconds=0.02)
    softer = type(ROCK)(1 / (1 / ROCK.loading_stiffness + compliance), 1 / (1 / ROCK.unloading_stiffness + compliance))
    plain = run_hybrid(RIG, SETTING, softer, 0.02, 20e3)
    assert np.max(np.abs(mounted.force - plain.force)) < 0.1 * np.max(plain.force)
    assert np.max(np.abs(run(seconds=0.02).force - plain.force)) > 0.1 * np.max(plain.force)


def toe(depth, h, r):
    """Force over stiffness of a soft layer: the integral of its stiffness, r at first and 1 when it is squeezed."""
    return depth - (1 - r) * h * (1 - np.exp(-depth / h))


@pytest.mark.parametrize(("h", "r", "e"), [(2e-5, 0.1, 1.0), (4e-5, 0.0, 0.5), (1e-5, 0.3, 0.0)])
def test_toe_is_its_equation(h, r, e):
    result = run(make("contact-toe", h=h, r=r, e=e), seconds=0.3)
    ratio = ROCK.loading_stiffness / ROCK.unloading_stiffness
    out = toe if e > 0 else lambda depth, h, r: depth
    loading, unloading, depth = place_in_rock(result)
    # in loading Xf follows so that the law of unloading has the force of loading there
    for rows in (loading, unloading):
        expected = ROCK.unloading_stiffness * out(depth[rows], e * h * ratio, r)
        assert np.allclose(result.force[rows], expected, rtol=1e-9, atol=1e-5)
    assert np.allclose(result.impacts.force, ROCK.loading_stiffness * toe(result.impacts.depth, h, r), rtol=1e-12)
    assert result.energy.rock > 0 and np.all(np.diff(result.penetration[result.regime == FREE]) >= 0)


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("n", [1.0, 1.4])
def test_toe_and_power_law_give_nothing_away(e, n):
    """No tap, however small, and no turn on the way gives back more than it took, on a nearly elastic rock."""
    rng = np.random.default_rng(7)
    for _ in range(6):
        setting, rock = drawn_place(rng)
        elastic = Rock(rock.loading_stiffness, 1.001 * rock.loading_stiffness)
        chosen = [make("contact-toe", h=rng.uniform(1e-6, 5e-5), r=rng.uniform(0, 1), e=e)]
        chosen += [make("contact-power-law", n=n)]
        result = run_hybrid(RIG, setting, elastic, 0.3, 100e3, effects=chosen)
        gap = result.x2 - result.penetration
        assert np.max(gap[result.regime == FREE]) < 1e-14
        # Xf where each contact ends: never behind where the one before ended
        left = np.searchsorted(result.time, result.switches.time[result.switches.after == FREE])
        assert np.all(np.diff(result.penetration[left[left < result.time.size]]) > -1e-15)
        assert result.energy.rock >= 0.0


def test_compaction_counts_impacts_and_never_lets_the_force_jump():
    soft, soft_n = 0.4, 12.0
    result = run(make("rock-compaction", soft=soft, soft_n=soft_n), seconds=0.5, rate=400e3)
    assert result.end.extra[0] == len(result.impacts.time) > 40
    assert math.isclose(result.extra[-1, 0], len(result.impacts.time))
    # impacts before each contact began
    before = np.searchsorted(result.impacts.time, result.impacts.contact_time)
    expected = ROCK.loading_stiffness * (1 - soft * np.exp(-before / soft_n))
    assert np.allclose(result.impacts.force / result.impacts.depth, expected, rtol=1e-10)
    assert np.min(expected) < 0.62 * ROCK.loading_stiffness < 0.95 * ROCK.loading_stiffness < np.max(expected)
    _, unloading, depth = place_in_rock(result)
    count = np.searchsorted(result.impacts.time, result.time[unloading]) - 1
    started = np.searchsorted(result.impacts.time, result.impacts.contact_time[count])
    law = ROCK.unloading_stiffness * (1 - soft * np.exp(-started / soft_n)) * depth[unloading]
    assert np.allclose(result.force[unloading], law, rtol=1e-9, atol=1e-6)
    # k v dt is the most that the force changes from one sample to the next
    assert np.max(np.abs(np.diff(result.force))) < 1.01 * ROCK.unloading_stiffness * np.max(np.abs(result.v2)) / 400e3


def test_compaction_by_the_depth_goes_on_where_it_ended():
    chosen, setting = make("rock-compaction", soft=0.4, soft_l=2e-4), Setting(60.0, 0.45, 1.0)
    whole = run(chosen, seconds=0.4, rate=0, setting=setting)
    first = run(chosen, seconds=0.15, rate=0, setting=setting)
    second = run(chosen, seconds=0.25, rate=0, setting=setting, phase=first.end_phase, start=first.end)
    assert np.allclose(second.end.extra, whole.end.extra, rtol=1e-12, atol=0)
    drilled, stiffness = whole.end.extra[2], whole.impacts.force / whole.impacts.depth / ROCK.loading_stiffness
    assert drilled == pytest.approx(whole.end_origin, rel=1e-12) and drilled > 1e-4
    assert stiffness[0] == pytest.approx(0.6, rel=1e-9)
    at_contact = whole.end.extra[3]
    assert stiffness[-1] == pytest.approx(1.0 - 0.4 * math.exp(-at_contact / 2e-4), rel=1e-9)


def test_a_drive_of_limited_slope_goes_on_where_it_ended():
    chosen, setting = make("force-limit", S_max=1.2e5, tau_f=1e-4), Setting(60.0, 0.45, 1.0)
    whole = run(chosen, seconds=0.4, rate=0, setting=setting)
    first = run(chosen, seconds=0.1512, rate=0, setting=setting)
    second = run(chosen, seconds=0.2488, rate=0, setting=setting, phase=first.end_phase, start=first.end)
    assert first.end.extra[0] != 0.0
    assert np.allclose(second.end.extra, whole.end.extra, rtol=1e-9, atol=0)
    assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-9)


def test_compaction_goes_on_where_it_ended_and_begins_anew_on_a_fresh_face():
    chosen = make("rock-compaction", soft=0.4, soft_n=12.0)
    setting = Setting(60.0, 0.45, 1.0)
    whole = run(chosen, seconds=0.4, rate=0, setting=setting)
    first = run(chosen, seconds=0.15, rate=0, setting=setting)
    second = run(chosen, seconds=0.25, rate=0, setting=setting, phase=first.end_phase, start=first.end)
    assert (
        np.allclose(second.end.extra, whole.end.extra, rtol=1e-12, atol=0)
        and first.end.extra[0] == len(first.impacts.time) > 5
    )
    assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-9)
    fresh = run(
        chosen, seconds=0.25, setting=setting, phase=first.end_phase, start=first.end._replace(extra=(0.0,) * 4)
    )
    stiffness = fresh.impacts.force / fresh.impacts.depth / ROCK.loading_stiffness
    assert math.isclose(stiffness[0], 0.6, rel_tol=1e-9) and stiffness[-1] > 0.75


def test_force_limit_is_its_equation():
    result = run(make("force-limit", F_max=300.0))
    left, theta = on_indenter(result)
    drive = RIG.drive_force(SETTING) * np.sin(theta)
    assert np.max(drive) > 450
    assert np.allclose(left, np.clip(drive, -300, 300) - drive, rtol=0, atol=1e-7)


def test_limited_spring_is_its_equation():
    result = run(make("force-limit", F_s=200.0))
    left, _theta = on_indenter(result)
    spring = RIG.stiffness * (result.x1 - result.x2)
    assert np.max(spring) > 205
    assert np.allclose(left, np.clip(spring, -200, 200) - spring, rtol=0, atol=1e-7)
    assert abs(result.energy.error) < 1e-9 * result.energy.drive


def test_rotation_turns_the_stiffness_from_contact_to_contact():
    eps, speed, psi = 0.3, 25.0, 0.7
    result = run(make("rock-rotation", eps=eps, Omega=speed, psi=psi), seconds=0.5)
    assert np.allclose(result.extra[:, 0], speed * result.time, rtol=1e-12, atol=1e-12)
    factor = 1 + eps * np.cos(speed * result.impacts.contact_time + psi)
    assert np.ptp(factor) > 0.5
    assert np.allclose(result.impacts.force / result.impacts.depth / ROCK.loading_stiffness, factor, rtol=1e-9)


def test_external_vibration_is_its_equation():
    one, two, f, psi = 80.0, 3.0, 31.0, -0.4
    result = run(make("external-vibration", F1=one, F2=two, f=f, psi=psi))
    wave = np.sin(2 * math.pi * f * result.time + psi)
    assert np.allclose(on_indenter(result)[0], two * wave, rtol=0, atol=1e-8)
    # the shaker by its momentum
    static = RIG.static_force(SETTING)
    force = static + one * wave - RIG.stiffness * (result.x1 - result.x2) - RIG.damping * (result.v1 - result.v2)
    moved = cumulative_simpson(force / RIG.shaker_mass, x=result.time, initial=0.0)
    assert np.allclose(result.v1, moved, rtol=0, atol=2e-6) and np.max(np.abs(result.v1)) > 3e-3


@pytest.mark.parametrize("name", ["rock-rotation", "external-vibration"])
def test_what_turns_goes_on_where_it_ended(name):
    whole, first = run(strong(name), seconds=0.4, rate=0), run(strong(name), seconds=0.15, rate=0)
    second = run(strong(name), seconds=0.25, rate=0, phase=first.end_phase, start=first.end)
    assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-9)
    assert second.end.extra == pytest.approx(whole.end.extra, rel=1e-12)


def test_backlash_is_its_equation_and_stores():
    play, beyond = 4e-4, -5e-5
    result = run(make("backlash", g=play, y0=beyond))
    begins = RIG.static_force(SETTING) / RIG.stiffness + beyond
    y = result.x1 - result.x2
    assert np.min(y) < begins < begins + play < np.max(y)
    lost = RIG.stiffness * np.clip(y - begins, 0, play)
    assert np.allclose(on_indenter(result)[0], -lost, rtol=0, atol=1e-8)

    def held(y):
        inside = min(max(y - begins, 0.0), play)
        return RIG.stiffness * (inside**2 / 2 + play * max(y - begins - play, 0.0))

    assert math.isclose(result.energy.effects[0], held(y[-1]) - held(y[0]), rel_tol=1e-8, abs_tol=1e-12)


def test_effects_on_a_body_are_their_equations():
    rng = np.random.default_rng(0)
    x, v, applied, k = rng.normal(0, 1e-2, 50), rng.normal(0, 0.1, 50), rng.normal(0, 100, 50), 5e3
    expected = {
        "stiffness-hardening": -3e8 * x**3,
        "force-limit": np.where(np.abs(applied) > 80, np.sign(applied) * 80, applied) - applied,
        "viscous-damping": -20 * v,
        "dry-friction": -7 * np.sign(v),
        "damping-quadratic": -40 * np.where(v > 0, v * v, -v * v),
        "backlash": np.where(x < -2e-3, 0.0, np.where(x > 3e-3, k * 5e-3, k * (x + 2e-3))),
    }
    spring = make("force-limit", F_s=30.0)
    assert np.allclose(
        spring.effect.on_body(x, v, applied, k, spring.values), k * x - np.clip(k * x, -30, 30), rtol=1e-12, atol=1e-12
    )
    gradual = make("force-limit", F_g=30.0)
    lost = k * x - 30 * np.sin(np.arctan(k * x / 30))
    assert np.allclose(gradual.effect.on_body(x, v, applied, k, gradual.values), lost, rtol=1e-12, atol=1e-12)
    worn = make("backlash", g=5e-3, y0=-2e-3, rg=0.3)
    lost = 0.7 * expected["backlash"]
    assert np.allclose(worn.effect.on_body(x, v, applied, k, worn.values), lost, rtol=1e-12, atol=1e-12)
    cubic = make("damping-quadratic", c2=40.0, nc=3.0)
    assert np.allclose(cubic.effect.on_body(x, v, applied, k, cubic.values), -40 * v**3, rtol=1e-12, atol=1e-12)
    values = {
        "stiffness-hardening": {"k3": 3e8},
        "force-limit": {"F_max": 80.0},
        "viscous-damping": {"d": 20.0},
        "dry-friction": {"fc": 7.0},
        "damping-quadratic": {"c2": 40.0},
        "backlash": {"g": 5e-3, "y0": -2e-3},
    }
    assert set(expected) == set(BODY)
    for name in BODY:
        chosen, neutral = make(name, **values[name]), make(name)
        force = chosen.effect.on_body(x, v, applied, k, chosen.values)
        assert np.allclose(force, expected[name], rtol=1e-12, atol=1e-12)
        assert np.all(neutral.effect.on_body(x, v, applied, k, neutral.values) == 0.0)
        if chosen.effect.energy == "loses":
            assert np.all(force * v <= 0.0)


@pytest.mark.parametrize("name", SENSORS)
def test_neutral_sensors_change_nothing(name):
    rng = np.random.default_rng(1)
    true = Channels(25600.0, 0.0, *rng.normal(0, 100, (3, 500)))
    neutral = read(true, [make(name)])
    for one, other in zip(true[2:5], neutral[2:5], strict=True):
        assert np.array_equal(one, other)
    changed = read(true, [strong(name)])
    assert any(not np.array_equal(one, other) for one, other in zip(true[2:5], changed[2:5], strict=True))


@pytest.mark.parametrize("name", EVERY)
def test_drawn_strengths_are_typical_and_reproduce(name):
    one, other, next_one = (drawn(name, rng) for rng in [np.random.default_rng(4)] * 2 + [np.random.default_rng(4)])
    assert one == next_one and one != other
    for part, value in zip(one.effect.parameters, one.values, strict=True):
        assert part.typical[0] <= value <= part.typical[1]


def own_effect(name, parameters, balances, energy, extras=(), **acts):
    """An effect that stands in no registry."""
    return Effect(name, "Somebody's own.", "-", "constitutive", parameters, balances, effects.EVERYWHERE, energy,
                  tuple(extras), **acts)  # fmt: skip


def _stiffer_in_steps(depth, p, stiffness):
    """Two straight parts, the second 1 + p[0] times as stiff as the first."""
    return depth + p[0] * np.maximum(depth - 3e-5, 0.0)


def test_law_of_ones_own_has_a_corner():
    """A contact law in a line of NumPy, whose corner the engine finds."""
    share = Parameter("a", "share by which it stiffens", "1", 0.0, 2.0, 0.0, (0.1, 1.0))
    shape = {way: Shape(_stiffer_in_steps, "loading depth") for way in ("loading", "unloading")}
    stepped = own_effect("stepped-rock", (share,), ("contact",), "none", laws=shape)
    result = run(effects.Chosen(stepped, (0.8,)), rate=100e3)
    depth = result.impacts.depth
    assert np.min(depth) < 3e-5 < np.max(depth)
    expected = ROCK.loading_stiffness * _stiffer_in_steps(depth, (0.8,), 0.0)
    assert np.allclose(result.impacts.force, expected, rtol=1e-12)
    _, unloading, depth = place_in_rock(result)
    ratio = ROCK.unloading_stiffness / ROCK.loading_stiffness
    law = ROCK.loading_stiffness * _stiffer_in_steps(depth[unloading] * ratio, (0.8,), 0.0)
    assert np.allclose(result.force[unloading], law, rtol=1e-9, atol=1e-6)
    check_energy(result, [effects.Chosen(stepped, (0.8,))])
    same(run(), run(effects.Chosen(stepped, (0.0,))))


def _leaking_air(now, own, p, push, rates):
    push[ON_SHAKER] -= own[0]
    rates[0] = p[0] * now.v1 - own[0] / p[1]


def test_term_of_ones_own_may_have_a_state():
    """Enclosed air once more, as a compiled term, beside another effect with a state and one without."""
    parts = (
        Parameter("k", "stiffness", "N/m", 0.0, 1e6, 0.0, (2e4, 1e5)),
        Parameter("tau", "time", "s", 1e-3, 1e2, 1.0, (0.1, 0.5)),
    )
    own = own_effect("own-air", parts, ("shaker",), "moves", (Extra("s", "force", "N", 10.0),), term=_leaking_air)
    ours = effects.Chosen(own, (5e4, 0.2))
    others = make("contact-rate", chi=0.4), make("rock-mount-compliance", s_r=2e-8)
    one, other = run(others[0], ours, others[1]), run(others[0], make("air-spring", k_a=5e4, tau=0.2), others[1])
    assert np.max(np.abs(one.x2 - other.x2)) < 1e-12 and np.max(np.abs(one.extra - other.extra)) < 1e-9
    assert np.max(np.abs(one.extra[:, 0])) > 1.0
    assert one.energy.effects == pytest.approx(other.energy.effects, rel=1e-9)
    assert abs(one.energy.error) < 1e-9 * one.energy.drive
    # it goes on where it ended, and without strength it changes nothing
    first = run(ours, seconds=0.1, rate=0)
    second = run(ours, seconds=0.2, rate=0, phase=first.end_phase, start=first.end)
    assert np.allclose(second.end[:4], run(ours, rate=0).end[:4], rtol=0, atol=1e-9)
    same(run(), run(effects.Chosen(own, (0.0, 1.0))))


def test_bad_choice_is_said_in_one_line():
    for message, call in (
        ("give one of", lambda: make("contact-rat")),
        ("its parameters are chi", lambda: make("contact-rate", xi=1.0)),
        ("outside 0 to 20", lambda: make("contact-rate", chi=-1.0)),
        ("no parameter 'n_u'", lambda: make("contact-power-law", n_u=1.5)),
        ("not a number", lambda: make("contact-rate", chi="1")),
    ):
        with pytest.raises(InputError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
    for name in [*SENSORS, "viscous-damping", "dry-friction"]:
        with pytest.raises(InputError, match="does not act on the motion"):
            run(make(name))
