import math
import pickle
import re

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from drillenv.checks import InputError
from drillenv.dynamics import effects
from drillenv.dynamics.effects import Effect, Extra, Parameter, make
from drillenv.dynamics.general import FREE, LOADING, UNLOADING, run_general
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

RIG, SETTING, ROCK = Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4]
EVERY = sorted(effects.REGISTRY)


def run(*chosen, seconds=0.3, rate=20e3, setting=SETTING, **more):
    return run_general(RIG, setting, ROCK, seconds, rate, effects=chosen, **more)


def strong(name):
    """The effect with every parameter moved off its neutral value, a little way to the far bound."""
    effect = effects.REGISTRY[name]
    return make(name, **{p.symbol: p.neutral + 0.02 * (p.high - p.neutral) for p in effect.parameters})


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
    assert re.fullmatch(r"[a-z]+(-[a-z]+)+", effect.name) and effect.name == name
    assert effect.sentence.endswith(".") and effect.sentence.count(".") == 1
    assert effect.equation
    assert effect.source == "constitutive" or re.search(r"\b(1[89]|20)\d\d\b", effect.source)
    assert set(effect.balances) <= {"contact", "indenter", "shaker", "sensor", "body"} and effect.balances
    assert set(effect.regimes) <= set(effects.EVERYWHERE) and effect.regimes
    assert effect.energy in ("loses", "stores", "moves", "none")
    assert effect.parameters
    for part in effect.parameters:
        assert part.unit and part.meaning and part.symbol.isidentifier()
        assert part.low <= part.neutral <= part.high and part.low < part.high
    for extra in effect.extras:
        assert extra.unit and extra.meaning and extra.size > 0
    assert not effect.moves_face or effect.extras[0].unit == "m/s"
    assert pickle.loads(pickle.dumps(effect)) == effect


@pytest.mark.parametrize("name", EVERY)
def test_neutral_values_change_nothing(name):
    effect = effects.REGISTRY[name]
    same(run(), run(make(name)))
    if effect.energy != "none":
        assert run(make(name)).energy.effects[0] == 0.0


def test_neutral_values_of_all_change_nothing():
    same(run(), run(*(make(name) for name in EVERY)))
    # those that scale a term by zero do so whatever the rest is set to
    same(run(), run(make("drive-harmonics", phi2=1.0, phi3=-2.0), make("air-spring", tau=0.02)))
    same(run(), run(make("rock-mount-compliance", m_r=3.0, zeta_r=0.7)))


@pytest.mark.parametrize("name", EVERY)
def test_energy_has_the_right_sign(name):
    effect = effects.REGISTRY[name]
    for seconds in (0.003, 0.05, 0.3):
        energy = run(strong(name), seconds=seconds, rate=0).energy
        assert abs(energy.error) < 1e-9 * (abs(energy.drive) + energy.stored_before)
        assert energy.damper > 0
        if effect.energy == "loses":
            assert energy.effects[0] < 0
        if effect.energy == "none":
            assert energy.effects[0] == 0


@pytest.mark.parametrize("name", EVERY)
def test_effect_changes_the_motion(name):
    plain, changed = run(), run(strong(name))
    assert np.max(np.abs(plain.v2 - changed.v2)) > 1e-4
    assert np.all(np.isfinite(changed.extra)) and changed.extra.shape == (6001, len(effects.REGISTRY[name].extras))


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
    plain = run_general(weak, SETTING, ROCK, 0.3, 2e3)
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
    result = run(make("contact-power-law", n_l=n, n_u=n))
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
    plain = run_general(RIG, SETTING, softer, 0.02, 20e3)
    assert np.max(np.abs(mounted.force - plain.force)) < 0.1 * np.max(plain.force)
    assert np.max(np.abs(run(seconds=0.02).force - plain.force)) > 0.1 * np.max(plain.force)


def _harder_rock(depth, regime, own, p):
    return depth * (1.0 - p[0] * math.exp(-own[0])) if regime == 1 else depth


def _count_release(before, after, own, p):
    if after == 0:
        own[0] += 1.0


def test_effect_of_ones_own_may_act_at_switches():
    effect = Effect(
        "rock-hardening", "The rock hardens with each blow.", "k_l (1 - a exp(-N))", "constitutive",
        (Parameter("a", "share missing at first", "1", 0.0, 0.9, 0.0),), ("contact",), ("loading",), "none",
        (Extra("N", "contacts so far", "1", 1.0),), shape=_harder_rock, switched=_count_release,
    )  # fmt: skip
    result = run(effects.Chosen(effect, (0.5,)))
    assert result.end.extra[0] == np.sum(result.switches.after == FREE) > 5
    stiffness = result.impacts.force / result.impacts.depth / ROCK.loading_stiffness
    releases = [np.sum(result.switches.after[result.switches.time < t] == FREE) for t in result.impacts.time]
    assert np.allclose(stiffness, 1 - 0.5 * np.exp(-np.array(releases, dtype=float)), rtol=1e-10)
    assert abs(result.energy.error) < 1e-9 * result.energy.drive


def test_bad_choice_is_said_in_one_line():
    for message, call in (
        ("give one of", lambda: make("contact-rat")),
        ("its parameters are chi", lambda: make("contact-rate", xi=1.0)),
        ("outside 0 to 20", lambda: make("contact-rate", chi=-1.0)),
        ("not a number", lambda: make("contact-rate", chi="1")),
    ):
        with pytest.raises(InputError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
    sensor = Effect("mains-hum", "Hum.", "-", "constitutive", (), ("sensor",), effects.EVERYWHERE, "none")
    with pytest.raises(InputError, match="does not act on the motion"):
        run(effects.Chosen(sensor, ()))
