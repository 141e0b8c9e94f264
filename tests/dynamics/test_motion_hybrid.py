"""Motions with effects: against the exact engine where effects are neutral, and against plain long runs where not."""

import numpy as np
import pytest

from drillenv.checks import InputError
from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, ON_SHAKER, Chosen, Effect, Extra, Parameter, make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.motion import Motion, motion, motions
from drillenv.dynamics.motion_hybrid import Section
from drillenv.rig import Rig, Setting
from drillenv.rocks import rock

NEUTRAL = (make("contact-rate"),)
CENTRE = Setting(120.0, 0.45, 1.0)
# the labels of the exact engine, written out so that the list keeps what it is meant to hold
AGREEING = [
    (4, (120, 0.45, 1.0), "P-1-I-1"),
    (4, (50, 0.45, 1.0), "P-1-I-4"),
    (4, (70, 0.45, 1.0), "P-1-I-3"),
    (4, (90, 0.45, 1.0), "P-1-I-2"),
    (4, (98, 0.45, 1.0), "P-2-I-4"),
    (4, (100, 0.45, 1.0), "P-2-I-3"),
    (4, (90, 0.45, 1.8), "P-1-I-3"),
    (2, (120, 0.31, 1.0), "P-1-I-2"),
    (2, (68.36, 0.31, 1.46), "P-1-I-2"),  # loading where it crosses the section
    (5, (51.58, 0.34, 1.49), "P-1-I-5"),  # unloading there
    (6, (119, 0.55, 1.7), "P-1-I-2"),
    (4, (150, 0.50, 1.0), "P-1-I-1"),
]
ACTING = [
    ((make("contact-rate", chi=0.5),), "P-1-I-2"),
    ((make("air-spring", k_a=5e4, tau=0.3),), "P-4-I-7"),  # just past a doubling: the odd returns come near too
    ((make("rock-mount-compliance", s_r=2e-8, m_r=50.0, zeta_r=0.05),), "P-1-I-2"),
    ((make("contact-power-law", n=1.4), make("indenter-friction", fc2=30.0)), "P-1-I-2"),
]


def named(given) -> str:
    return given if isinstance(given, str) else " and ".join(chosen.effect.name for chosen in given)


@pytest.mark.parametrize(("case", "setting", "label"), AGREEING)
def test_neutral_effects_change_nothing(case, setting, label):
    exact = motion(Setting(*setting), case)
    general = motion(Setting(*setting), case, effects=NEUTRAL)
    assert exact.label == general.label == label
    assert (exact.impacts, exact.contacts, exact.stable) == (general.impacts, general.contacts, general.stable)
    for name in ("penetration_rate", "peak_force", "impact_speed"):
        assert getattr(general, name) == pytest.approx(getattr(exact, name), rel=1e-9), name
    np.testing.assert_allclose(np.abs(general.multipliers), np.abs(exact.multipliers), atol=1e-5)
    assert general.exponent == pytest.approx(exact.exponent, abs=1e-4)


@pytest.mark.slow
def test_chaos_with_neutral_effects():
    exact, general = (motion(Setting(105.0, 0.45, 1.0), effects=effects) for effects in ((), NEUTRAL))
    assert general.label == exact.label == "chaotic"
    # means of two different stretches of 1000 periods
    assert general.exponent == pytest.approx(exact.exponent, abs=3.0)
    assert general.impacts == pytest.approx(exact.impacts, abs=0.05)
    assert general.penetration_rate == pytest.approx(exact.penetration_rate, rel=1e-3)
    assert np.isnan(general.multipliers).all()
    assert not general.stable


@pytest.mark.parametrize(("effects", "label"), ACTING, ids=named)
def test_as_a_plain_run_ends(effects, label):
    """Period, counts, rate and peaks over 12 periods, which those of these motions divide, after 1500."""
    setting = Setting(100.0, 0.45, 1.0)
    found = motion(setting, effects=effects)
    assert found.label == label
    settled = run_hybrid(Rig(), setting, rock(4), 15.0, 0.0, effects=effects)
    run = run_hybrid(Rig(), setting, rock(4), 0.12, 100.0, 0.0, settled.end, effects)
    back = [np.abs(run.v2[n:] - run.v2[: run.v2.size - n]).max() < 1e-7 for n in range(1, found.period + 1)]
    assert back.index(True) + 1 == found.period
    assert run.impacts.time.size == found.impacts * 12 / found.period
    landings = (run.switches.before == 0) & (run.switches.after == 1)
    assert landings.sum() == found.contacts * 12 / found.period
    assert found.peak_force == pytest.approx(run.impacts.force.max(), rel=1e-6)
    assert found.impact_speed == pytest.approx(run.impacts.speed.max(), rel=1e-6)
    assert found.penetration_rate == pytest.approx((run.penetration[-1] - run.penetration[0]) / 0.12, rel=1e-6)


def test_largest_multiplier_is_how_a_push_dies_out():
    """With an air spring it is real and the slowest by far: after 60 periods nothing else is left of a push."""
    effects = (make("air-spring", k_a=5e4, tau=0.3),)
    found = motion(CENTRE, effects=effects)
    assert found.multipliers.shape == (5,)
    assert found.state is not None
    pushed = found.state._replace(extra=(found.state.extra[0] + 0.01,))
    left = []
    for periods in (200, 240):
        ends = [
            run_hybrid(Rig(), CENTRE, rock(4), periods / 120, 0.0, 0.0, start, effects).end
            for start in (found.state, pushed)
        ]
        left.append(ends[1].extra[0] - ends[0].extra[0])
    assert found.multipliers[0].imag == 0.0
    assert (left[1] / left[0]) ** (1 / 40) == pytest.approx(found.multipliers[0].real, abs=1e-4)


def test_compacting_rock_ends_as_the_compacted_one():
    """What it settles on is the plain model's motion, for the stiffnesses are those of compacted rock."""
    plain = motion(CENTRE)
    found = motion(CENTRE, effects=[make("rock-compaction", soft=0.5, soft_n=20.0)])
    assert found.label == plain.label
    assert found.penetration_rate == pytest.approx(plain.penetration_rate, rel=1e-9)
    assert found.multipliers.shape == (4,)


def test_a_rig_held_by_friction_makes_no_impact():
    found = motion(CENTRE, effects=[make("guide-friction", fc1=3000.0), make("indenter-friction", fc2=3000.0)])
    assert (found.impacts, found.contacts, found.penetration_rate) == (0, 0, 0.0)


def test_goes_on_from_a_motion():
    effects = (make("air-spring", k_a=5e4, tau=0.3),)
    found = motion(CENTRE, effects=effects)
    again = motion(CENTRE, start=found, effects=effects, wait=1)
    assert (again.label, again.effects) == (found.label, effects)
    assert again.penetration_rate == pytest.approx(found.penetration_rate, rel=1e-9)
    np.testing.assert_allclose(again.point, found.point, rtol=1e-6, atol=1e-9)
    # from the motion without effects, and from its point
    plain = motion(CENTRE)
    for start in (plain, plain.point):
        assert motion(CENTRE, start=start, effects=effects).label == found.label


def test_deep_start_moving_in_is_counted_from_xf():
    """A start in contact is given from Xf; moving in it loads, with the same force at the same place."""
    point = np.array([3e-3, 0.0, 0.05, 4e-5])
    exact, general = (motion(Setting(90.0, 0.45, 1.0), start=point, effects=each) for each in ((), NEUTRAL))
    assert general.label == exact.label
    assert general.peak_force == pytest.approx(exact.peak_force, rel=1e-9)


@pytest.mark.slow
def test_motions_that_coexist_with_an_effect():
    setting = Setting(110.0, 0.45, 1.0)
    found = motions(setting, effects=[make("contact-rate", chi=0.1)], starts=12, seed=1)
    assert {"P-1-I-1", "P-2-I-4"} <= {each.label for each in found}
    assert sum(each.share for each in found) == pytest.approx(1.0)
    assert [each.share for each in found] == sorted((each.share for each in found), reverse=True)
    assert all(isinstance(each, Motion) and each.effects for each in found)


def test_starts_of_one_orbit_count_as_one():
    (found,) = motions(Setting(100.0, 0.45, 1.0), effects=NEUTRAL, starts=4, seed=2)
    assert (found.label, found.share) == ("P-2-I-3", 1.0)


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        (5, "effects is 5"),
        (["contact-rate"], "contact-rate"),
        ([make("sensor-offset")], "sensor-offset does not act"),
        ([make("dry-friction")], "dry-friction does not act"),
        ([make("contact-rate")] * 2, "given twice"),
    ],
)
def test_what_are_no_effects_on_the_motion(effects, said):
    with pytest.raises(InputError, match=said):
        motion(CENTRE, effects=effects)
    with pytest.raises(InputError, match=said):
        motions(CENTRE, effects=effects, starts=2)


@pytest.mark.parametrize(
    ("effect", "periods"),
    [
        (make("external-vibration", F1=100.0, F2=2.0, f=40.0), 3),
        (make("external-vibration", F1=100.0, F2=2.0, f=240.0), 1),
        (make("rock-rotation", eps=0.1, Omega=2 * np.pi * 30.0), 4),
        (make("external-vibration", f=33.3), 1),
        (make("rock-rotation", Omega=11.0), 1),
    ],
    ids=["a third", "twice", "a quarter", "no force", "even rock"],
)
def test_what_turns_at_a_rate_of_its_own_sets_the_period(effect, periods):
    """Of 120 Hz; without it the motion is P-1-I-1."""
    found = motion(CENTRE, effects=[effect])
    assert found.period == periods and found.stable
    assert found.multipliers.shape == (4,)
    settled = run_hybrid(Rig(), CENTRE, rock(4), 10.0, 0.0, effects=(effect,))
    run = run_hybrid(Rig(), CENTRE, rock(4), 0.1, 120.0, 0.0, settled.end, (effect,))
    assert np.abs(run.v2[periods:] - run.v2[:-periods]).max() < 1e-7
    assert found.peak_force == pytest.approx(run.impacts.force.max(), rel=1e-6)
    assert found.penetration_rate == pytest.approx(12 * (run.penetration[-1] - run.penetration[0]) / 1.2, rel=1e-6)


def test_a_vibration_of_a_frequency_without_ratio_lets_nothing_close():
    effect = make("external-vibration", F1=100.0, F2=2.0, f=40.0 * 2**0.5)
    found = motion(CENTRE, effects=[effect], patience=500)
    assert found.period == 0 and found.exponent < 0.0 and not found.stable
    plain = motion(CENTRE)
    assert found.impacts == pytest.approx(plain.impacts, abs=0.1)
    assert found.penetration_rate == pytest.approx(plain.penetration_rate, rel=0.1)


# --- Effects of one's own


def _air(now, own, p, push, rates):
    push[ON_SHAKER] -= own[0]
    rates[0] = p[0] * now.v1 - own[0] / p[1]


def _floor(now, own, p, push, rates):
    push[ON_SHAKER] += p[0] * np.sin(own[0])
    push[ON_INDENTER] += 0.02 * p[0] * np.sin(own[0])
    rates[0] = 2.0 * np.pi * p[1]


def own_term(term, extra, *values):
    parts = tuple(Parameter(f"p{i}", "a strength", "1", 0.0, 1e6, 0.0, (1.0, 2.0)) for i in range(len(values)))
    effect = Effect("own-term", "Somebody's own.", "-", "constitutive", parts, ("shaker",), EVERYWHERE, "moves",
                    (extra,), term=term)  # fmt: skip
    return Chosen(effect, values)


def test_a_state_of_an_effect_of_ones_own_recurs():
    """It is one more coordinate of the section, with a multiplier of its own; without strength it is none."""
    ours, theirs = own_term(_air, Extra("s", "force", "N", 10.0), 5e4, 0.3), make("air-spring", k_a=5e4, tau=0.3)
    # from where the air has come to rest: an effect of one's own does not say how slow it is
    settled = motion(CENTRE, effects=[theirs])
    mine = motion(CENTRE, effects=[ours], wait=4000)
    assert (mine.label, mine.multipliers.shape) == (settled.label, (5,))
    np.testing.assert_allclose(np.sort(np.abs(mine.multipliers)), np.sort(np.abs(settled.multipliers)), atol=1e-4)
    assert mine.penetration_rate == pytest.approx(settled.penetration_rate, rel=1e-9)
    assert mine.state is not None and settled.state is not None
    assert mine.state.extra == pytest.approx(settled.state.extra, abs=1e-6)
    weak = motion(CENTRE, effects=[own_term(_air, Extra("s", "force", "N", 10.0), 0.0, 0.3)])
    assert weak.multipliers.shape == (4,)


def test_an_angle_of_an_effect_of_ones_own_sets_the_period():
    angle = Extra("a", "angle", "rad", 1.0, turns=True)
    mine = motion(CENTRE, effects=[own_term(_floor, angle, 100.0, 40.0)])
    theirs = motion(CENTRE, effects=[make("external-vibration", F1=100.0, F2=2.0, f=40.0)])
    assert mine.period == theirs.period == 3 and mine.multipliers.shape == (4,)
    assert mine.penetration_rate == pytest.approx(theirs.penetration_rate, rel=1e-8)


# --- Places


EVERY_KIND = (
    make("contact-toe", h=2e-5, r=0.1, e=0.5),
    make("backlash", g=4e-4, y0=-5e-5),
    make("indenter-friction", fc2=40.0),
    make("rock-mount-compliance", s_r=2e-8, m_r=20.0),
    make("rock-rotation", eps=0.1, Omega=9.0),
    make("rock-compaction", soft=0.3, soft_n=20.0),
    make("drive-harmonics", h2=0.1),
    make("air-spring", k_a=5e4, tau=0.2),
)


def test_a_place_copied_goes_on_bit_for_bit():
    """Corners, slides, counts and angles included; runs elsewhere in between leave nothing behind."""
    section = Section(Setting(60.0, 0.45, 1.0), rock(4), Rig(), EVERY_KIND)
    place = section.after(section.fresh(), 7)
    kept = place.copy()
    one = section.after(place.copy(), 3)
    section.after(section.moved(place, section.point(place, 2) * 1.01), 2)
    other = section.after(kept, 3)
    for a, b in ((place, kept), (one, other)):
        assert np.array_equal(a.d, b.d) and np.array_equal(a.z, b.z)
    # moved to where it is, it is there
    there = section.moved(place, section.point(place, int(place.d[0])))
    np.testing.assert_allclose(section.after(there, 3).z, one.z, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(("w", "v2"), [(-3e-5, 0.1), (4e-5, 0.1), (4e-5, -0.1), (4e-5, 0.0)])
def test_a_point_is_counted_from_xf_and_xp_alike(w, v2):
    """Depths while loading and unloading say the same force, whatever bends the rock law."""
    section = Section(Setting(60.0, 0.45, 1.0), rock(4), Rig(), EVERY_KIND)
    place = section.at(3e-3, 0.0, v2, w)
    regime = int(place.d[0])
    assert regime == (0 if w < 0 else 1 if v2 > 0 else 2)
    from_xf = section.point(place, 2)
    assert from_xf[3] * section.scales[3] == pytest.approx(w, rel=1e-9)
    if regime == 1:
        assert place.z[3] > 1.02 * w
    again = section.moved(place, section.point(place, regime))
    # over its scale and back a number may lose its last bit
    np.testing.assert_allclose(again.z, place.z, rtol=4e-16)
    assert np.array_equal(again.d, place.d)


def test_a_failed_run_leaves_nothing_behind():
    """The search goes on after a run that could not be followed."""
    section = Section(CENTRE, rock(4), Rig(), NEUTRAL)
    place = section.after(section.fresh(), 20)
    wanted = section.after(place, 1)
    wild = section.at(1.0, 0.0, 0.0, -1e-3)
    wild.z[1] = np.inf
    with pytest.raises(InputError, match="make the effects weaker"):
        section.after(wild, 1)
    assert np.array_equal(section.after(place, 1).z, wanted.z)
