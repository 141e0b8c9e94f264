"""Effects that follow a measured curve, beside the equations that the curve was read off."""

import json
import math
import pickle
import re

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from drillenv.atlas import sweep
from drillenv.checks import InputError
from drillenv.corrected import Corrected, model_record, read_model, write_model
from drillenv.dynamics.constitutive.curves import Curve, pchip_slopes, table_along, table_around, table_of_tangents
from drillenv.dynamics.effects import EVERYWHERE, TABULATED, Chosen, make
from drillenv.dynamics.flow import LOADING, UNLOADING
from drillenv.dynamics.hybrid.run import integrate, run_hybrid
from drillenv.dynamics.motion import motion
from drillenv.dynamics.simulate import simulate
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

RIG, SETTING, ROCK = Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4]
PLACES = sorted(TABULATED)
KNOTS_AT = {
    "loading": np.geomspace(2.0, 4000.0, 64),
    "unloading": np.geomspace(2.0, 4000.0, 64),
    "rate-factor": np.linspace(-1.0, 1.0, 64),
    "rate-force": np.linspace(-1.0, 1.0, 64),
    "compaction": np.linspace(0.0, 120.0, 64),
    "spring": np.linspace(0.0, 0.008, 64),
    "spring-from-rest": np.linspace(-0.01, 0.01, 64),
    "damper": np.linspace(-1.0, 1.0, 64),
    "guide": np.linspace(-0.1, 0.1, 64),
    "indenter": np.linspace(-1.0, 1.0, 64),
    "drive-waveform": np.linspace(0.0, 2.0 * np.pi, 63, endpoint=False),
    "drive-curve": np.linspace(-600.0, 600.0, 64),
}
"""Arguments that the paper's rig visits at this setting, and some more."""


def run(*chosen, seconds=0.3, rate=20e3, **more):
    return run_hybrid(RIG, SETTING, ROCK, seconds, rate, effects=chosen, **more)


def table(place, function, **more):
    """The effect that follows this function."""
    x = KNOTS_AT[place]
    return make(f"tabulated-{place}", x=x, y=[float(function(each)) for each in x], **more)


def neutral(place):
    return table(place, lambda x: TABULATED[f"tabulated-{place}"].axes.neutral)


def wavy(place, rng):
    """A curve of no equation, strong enough to show."""
    axes = TABULATED[f"tabulated-{place}"].axes
    x = KNOTS_AT[place]
    size = {"N": 40.0, "1": 0.2}[axes.unit]
    turns = 2.0 * np.pi * (x - x[0]) / (x[-1] - x[0])
    y = axes.neutral + size * (np.sin(turns + rng.uniform(0, 6)) + 0.3 * np.sin(3 * turns + rng.uniform(0, 6))) / 1.3
    return make(f"tabulated-{place}", x=x, y=y)


# --- Curves


@pytest.mark.parametrize("knots", [2, 3, 4, 7, 64])
def test_curve_is_the_monotone_cubic_of_scipy(knots):
    rng = np.random.default_rng(knots)
    for _ in range(5):
        x, y = np.sort(rng.normal(size=knots)), np.round(rng.normal(size=knots), 1)
        found, at = table_along(Curve(tuple(x), tuple(y)), x[0], x[-1]), np.linspace(x[0], x[-1], 301)
        np.testing.assert_allclose(found(at), PchipInterpolator(x, y)(at), atol=1e-12)


def test_curve_is_held_or_goes_on_straight():
    x, y = (1.0, 2.0, 4.0), (3.0, 5.0, 8.0)
    slopes = pchip_slopes(x, y)
    for reach in (5.0, 50.0):
        # also beyond the range of the table
        held, straight = (table_along(Curve(x, y, beyond), -reach, reach) for beyond in ("held", "straight"))
        for off in (0.5, 30.0):
            at = np.array([1.0 - off, 4.0 + off])
            np.testing.assert_allclose(held(at), [3.0, 8.0], rtol=1e-14)
            np.testing.assert_allclose(straight(at), [3.0 - slopes[0] * off, 8.0 + slopes[-1] * off], rtol=1e-13)
    assert slopes[0] > 0.0 and slopes[-1] > 0.0


@pytest.mark.parametrize("closed", [False, True])
def test_a_curve_that_repeats_is_smooth_where_it_closes(closed):
    turn = 2.0 * np.pi
    x = np.linspace(0.3, 0.3 + turn, 40, endpoint=closed)
    y = np.sin(2.0 * x)
    y[-1] = y[0] if closed else y[-1]
    found = table_around(Curve(tuple(x), tuple(y)), turn)
    at = np.linspace(0.0, turn, 500)
    assert np.max(np.abs(found(at) - np.sin(2.0 * at))) < 0.02
    assert (found.knots[0], found.knots[-1]) == (0.0, turn)
    # value and slope go on where it closes, from a turn to the next as at the knot that it was given
    for near in (1e-6, 1e-5):
        ends = [found(np.array([start, start + near])) for start in (0.0, turn - near)]
        slopes = [(after - before) / near for before, after in ends]
        assert slopes[0] == pytest.approx(slopes[1], abs=20.0 * near) and abs(slopes[0]) > 1.0
    assert found(np.array([0.0]))[0] == pytest.approx(found(np.array([turn]))[0], abs=1e-13)


def test_rock_follows_its_tangent():
    """dR/du = f(R) of the curve, solved by another hand."""
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.uniform(20.0, 200.0, 20))
    curve = Curve(tuple(x), tuple(np.exp(rng.normal(0.0, 0.5, 20))))
    found, factor = table_of_tangents(curve, 1e6), PchipInterpolator(curve.x, curve.y)

    def tangent(_u, force):
        return factor(np.clip(force, x[0], x[-1]))

    u = np.linspace(0.0, 3000.0, 400)
    solved = solve_ivp(tangent, (0.0, u[-1]), [0.0], t_eval=u, rtol=1e-9, atol=1e-6, max_step=5.0).y[0]
    np.testing.assert_allclose(found(u), solved, atol=1e-4 * solved[-1])
    assert np.all(np.diff(found(np.linspace(-100.0, 3000.0, 5000))) > 0.0)
    assert abs(found(np.array([0.0]))[0]) < 1e-18 and found(np.array([-1.0]))[0] == pytest.approx(-curve.y[0])


def test_knots_are_corners():
    """The engine ends its steps where the slope or the curvature jumps, and nowhere else."""
    rng = np.random.default_rng(2)
    x = np.cumsum(rng.uniform(0.5, 1.5, 9))
    found = table_along(Curve(tuple(x), tuple(rng.normal(size=9))), x[0] - 5.0, x[-1] + 5.0)
    assert found.knots[1:-1].tolist() == x.tolist() and found.corners.all()
    straight = table_along(Curve((0.0, 1.0, 2.0), (0.0, 1.0, 2.0), "straight"), -5.0, 5.0)
    assert not straight.corners.any()


# --- Entries


@pytest.mark.parametrize("name", PLACES)
def test_entry_says_everything(name):
    effect = TABULATED[name]
    assert re.fullmatch(r"tabulated(-[a-z]+)+", effect.name) and effect.name == name
    assert effect.sentence.endswith(".") and effect.sentence.count(".") == 1
    assert effect.equation and "1980" in effect.source
    assert not effect.parameters and effect.neutral == ()
    assert len(effect.balances) == 1 and set(effect.regimes) <= set(EVERYWHERE)
    assert effect.moves_rig and effect.measure is None and effect.on_body is None
    axes = effect.axes
    assert axes.argument and axes.argument_unit and axes.quantity and axes.unit
    assert axes.low <= axes.neutral <= axes.high
    assert pickle.loads(pickle.dumps(effect)) == effect


def test_every_place_is_here():
    assert {name.removeprefix("tabulated-") for name in PLACES} == set(KNOTS_AT)


# --- What they do


def same(one, other):
    """Bitwise equality of the motion, of its impacts and switches, and of what the rig itself gave and took."""
    for field in ("time", "x1", "x2", "v1", "v2", "acceleration", "force", "penetration", "regime", "steps"):
        assert np.array_equal(getattr(one, field), getattr(other, field)), field
    for a, b in zip((*one.impacts, *one.switches), (*other.impacts, *other.switches), strict=True):
        assert np.array_equal(a, b)
    assert one.end[:5] == other.end[:5] and one.energy[:4] == other.energy[:4]


@pytest.mark.parametrize("place", KNOTS_AT)
def test_neutral_curves_change_nothing_bitwise(place):
    chosen = neutral(place)
    assert chosen.is_neutral
    result = run(chosen)
    same(run(), result)
    assert result.energy.effects[0] == 0.0


def test_all_neutral_curves_change_nothing_bitwise():
    same(run(), run(*(neutral(place) for place in KNOTS_AT)))


EQUATIONS = [
    ("spring", lambda y: 5e9 * y**3, make("stiffness-hardening", k3=5e9), 1e-4),
    ("rate-factor", lambda v: 0.6 * v, make("contact-rate", chi=0.6), 1e-9),
    ("damper", lambda v: 700.0 * abs(v) * v, make("damping-quadratic", c2=700.0), 5e-3),
    ("guide", lambda v: 30.0 * math.tanh(v / 0.02), make("guide-friction", fc1=30.0, vs1=0.02), 5e-3),
    ("indenter", lambda v: 30.0 * math.tanh(v / 0.2), make("indenter-friction", fc2=30.0, vs2=0.2), 5e-3),
    ("drive-waveform", lambda t: 0.2 * math.sin(2 * t + 0.5), make("drive-harmonics", h2=0.2, phi2=0.5), 5e-3),
    ("drive-curve", lambda f: min(max(f, -300.0), 300.0) - f, make("force-limit", F_max=300.0), 5e-3),
    (
        "spring-from-rest",
        lambda y: -RIG.stiffness * min(max(y + 5e-5, 0.0), 4e-4),
        make("backlash", g=4e-4, y0=-5e-5),
        0.1,
    ),
    ("compaction", lambda n: -0.4 * math.exp(-n / 12.0), make("rock-compaction", soft=0.4, soft_n=12.0), 5e-3),
]


@pytest.mark.parametrize(("place", "function", "equation", "share"), EQUATIONS, ids=[each[0] for each in EQUATIONS])
def test_is_the_equation_it_was_read_off(place, function, equation, share):
    """To the share of what the equation does that 64 knots leave; backlash has corners between the knots."""
    plain, ours, theirs = run(), run(table(place, function)), run(equation)
    done = np.max(np.abs(theirs.x2 - plain.x2))
    assert done > 5e-6
    assert np.max(np.abs(ours.x2 - theirs.x2)) < share * done
    assert abs(ours.energy.error) < 1e-9 * ours.energy.drive


def test_a_straight_curve_is_hunt_and_crossley_with_two_knots():
    ours = run(make("tabulated-rate-factor", x=[-0.1, 0.1], y=[-0.06, 0.06], beyond="straight"))
    assert np.max(np.abs(ours.x2 - run(make("contact-rate", chi=0.6)).x2)) < 1e-14


def test_a_force_over_speed_is_kelvin_and_voigt():
    ours = run(make("tabulated-rate-force", x=[-1.0, 1.0], y=[-400.0, 400.0]), rate=200e3)
    depth = ours.x2 - ours.penetration
    touching = (ours.regime == LOADING) | (ours.regime == UNLOADING)
    law = ROCK.unloading_stiffness * depth + 400.0 * ours.v2
    # in loading Xf follows the force of the law alone
    assert np.allclose(ours.force[touching], np.maximum(law, 0.0)[touching], rtol=0, atol=1e-6)
    assert ours.energy.effects[0] < 0.0


def test_a_contact_that_a_damper_ends_is_followed_to_the_tolerance():
    """On the way out the damper would pull at the face; a trial step that ends there must not see its force jump."""
    chosen = make("tabulated-rate-force", x=[-1.0, 1.0], y=[-400.0, 400.0])
    ends = [run(chosen, seconds=0.1, rtol=rtol) for rtol in (1e-9, 1e-12, 1e-13)]
    for one, off in zip(ends, (1e-7, 1e-9), strict=False):
        assert np.max(np.abs(one.impacts.force / ends[2].impacts.force - 1.0)) < off


@pytest.mark.parametrize("n", [1.3, 1.6])
def test_both_tangents_are_the_power_law(n):
    """Below the first knot, at 2 N, the tangent is held; n (R / k d0)^(1 - 1/n) goes to zero there."""

    def tangent(k):
        return lambda force: n * (force / (k * 1e-4)) ** (1.0 - 1.0 / n)

    ours = run(table("loading", tangent(ROCK.loading_stiffness)), table("unloading", tangent(ROCK.unloading_stiffness)))
    theirs, plain = run(make("contact-power-law", n=n)), run()
    assert np.max(np.abs(ours.x2 - theirs.x2)) < 0.05 * np.max(np.abs(theirs.x2 - plain.x2))
    assert ours.impacts.force.max() == pytest.approx(theirs.impacts.force.max(), rel=1e-3)
    assert ours.energy.rock > 0.0 and ours.energy.effects[0] == 0.0


def test_one_way_leaves_the_other_alone():
    """A tangent twice as stiff above 100 N, on the way in only: seen in the force over the depth of both ways."""
    chosen = make("tabulated-loading", x=[100.0, 101.0], y=[1.0, 1.2])
    result = run(chosen, rate=400e3)
    unloading = result.regime == UNLOADING
    depth = result.x2 - result.penetration
    assert np.allclose(result.force[unloading], ROCK.unloading_stiffness * depth[unloading], rtol=0, atol=1e-6)
    k, strong = ROCK.loading_stiffness, result.impacts.force > 200.0
    expected = 100.0 + 1.2 * (k * result.impacts.depth - 100.0)
    assert np.any(strong) and np.allclose(result.impacts.force[strong], expected[strong], rtol=1e-3)


@pytest.mark.parametrize("place", KNOTS_AT)
def test_a_measured_curve_is_followed(place):
    result = run(wavy(place, np.random.default_rng(4)))
    assert result.steps < 30000
    assert np.max(np.abs(result.x2 - run().x2)) > 1e-7
    assert abs(result.energy.error) < 1e-9 * (abs(result.energy.drive) + result.energy.stored_before)


def test_all_places_at_once():
    rng = np.random.default_rng(5)
    chosen = [wavy(place, rng) for place in KNOTS_AT]
    whole, first = run(*chosen, seconds=0.2, rate=0.0), run(*chosen, seconds=0.1, rate=0.0)
    second = run(*chosen, seconds=0.1, rate=0.0, phase=first.end_phase, start=first.end)
    assert np.allclose(second.end[:4], whole.end[:4], rtol=0, atol=1e-8)
    assert second.end.extra == whole.end.extra


def test_another_curve_compiles_nothing():
    from drillenv.dynamics.hybrid.outside_terms import _compiled

    rng = np.random.default_rng(6)
    run(wavy("spring", rng))
    before = _compiled.cache_info().misses, len(integrate.signatures)
    run(make("tabulated-spring", x=[0.0, 0.003, 0.004], y=[0.0, 10.0, -20.0]))
    run(wavy("spring", rng))
    assert (_compiled.cache_info().misses, len(integrate.signatures)) == before


def test_waveform_takes_any_phase():
    """Over turn after turn, from whatever phase, the drive is the curve at the phase of the excitation."""
    chosen = table("drive-waveform", lambda t: math.sin(3.0 * t))
    curve = table_around(chosen.curve, 2.0 * math.pi)
    runs = [run(chosen, phase=phase) for phase in (1.0, 1.0 - 2.0 * math.pi, 1.0 + 40.0 * math.pi)]
    for result in runs:
        theta = 1.0 + 2.0 * math.pi * SETTING.frequency * result.time
        pair = RIG.stiffness * (result.x1 - result.x2) + RIG.damping * (result.v1 - result.v2)
        drive = RIG.indenter_mass * result.acceleration - pair + result.force
        wanted = RIG.drive_force(SETTING) * (np.sin(theta) + curve(theta % (2.0 * math.pi)))
        np.testing.assert_allclose(drive, wanted, atol=1e-7)
        np.testing.assert_allclose(result.x2, runs[0].x2, atol=1e-12)


# --- Wherever an effect may be given

SPRING = {"x": np.linspace(0.0, 0.008, 9).tolist(), "y": (5e9 * np.linspace(0.0, 0.008, 9) ** 3).tolist()}
COMPACTING = {"x": [0.0, 5.0, 20.0, 60.0], "y": [-0.4, -0.2, -0.05, 0.0]}


def test_model_file_round_trip(tmp_path):
    rng = np.random.default_rng(8)
    model = Corrected(effects=(*(wavy(place, rng) for place in KNOTS_AT), make("contact-rate", chi=0.2)))
    write_model(tmp_path / "model.json", model)
    again = read_model(tmp_path / "model.json")
    assert again == model and hash(again.effects[0]) == hash(model.effects[0])
    assert again.on_motion == model.effects and again.on_sensors == ()
    (record,) = [each for each in model_record(model)["effects"] if each["name"] == "tabulated-spring"]
    assert list(record["parameters"]) == ["argument_unit", "unit", "x", "y", "beyond"]
    assert (record["parameters"]["argument_unit"], record["parameters"]["unit"]) == ("m", "N")


def test_model_file_by_hand(tmp_path):
    """As a person writes it, the units and what is beyond left out."""
    entry = {"name": "tabulated-spring", "parameters": SPRING}
    (tmp_path / "model.json").write_text(json.dumps({"format": "drillenv-model/1", "effects": [entry]}))
    (chosen,) = read_model(tmp_path / "model.json").effects
    assert chosen == make("tabulated-spring", **SPRING, beyond="held", argument_unit="m", unit="N")


def test_simulate_motion_and_sweep_take_it():
    chosen, equation = make("tabulated-spring", **SPRING), make("stiffness-hardening", k3=5e9)
    setting = Setting(120.0, 0.45, 1.0)
    runs = [simulate(setting, seconds=0.2, effects=[each], start="steady") for each in (chosen, equation)]
    assert runs[0].penetration_rate == pytest.approx(runs[1].penetration_rate, rel=0.02)
    found = [motion(setting, effects=[each]) for each in (chosen, equation)]
    assert found[0].label == found[1].label and found[0].stable
    assert found[0].peak_force == pytest.approx(found[1].peak_force, rel=0.01)
    swept = sweep(setting, "frequency", 118.0, 120.0, 2.0, effects=[chosen], direction="up")
    assert swept.effects == (chosen,)
    assert swept.motion(1, "up").peak_force == pytest.approx(found[0].peak_force, rel=1e-6)


def test_motion_on_rock_that_compacts_along_a_curve():
    """It settles on the motion of the compacted rock, whose stiffnesses the model states."""
    setting = Setting(120.0, 0.45, 1.0)
    found = motion(setting, effects=[make("tabulated-compaction", **COMPACTING)])
    plain = motion(setting)
    assert found.label == plain.label
    assert found.penetration_rate == pytest.approx(plain.penetration_rate, rel=1e-9)


@pytest.mark.parametrize("tabulated", [{"spring": SPRING}, {"compaction": COMPACTING, "spring": SPRING}])
def test_environment_takes_it(tmp_path, tabulated):
    chosen = tuple(make(f"tabulated-{place}", **curve) for place, curve in tabulated.items())
    write_model(tmp_path / "model.json", Corrected(effects=chosen))
    observations = []
    for model in (str(tmp_path / "model.json"), None):
        env = gym.make("drillenv/Drill-v0", rock=4, noise=0.0, **({"model": model} if model else {}))
        env.reset(seed=3)
        for _ in range(3):
            observation, *_ = env.step(np.array([0.5, 0.2, -0.3], dtype=np.float32))
        observations.append(observation)
        assert np.all(np.isfinite(observation))
    assert np.max(np.abs(observations[0] - observations[1])) > 1e-4


# --- What cannot be


@pytest.mark.parametrize(
    ("place", "change", "message"),
    [
        ("spring", {"x": [0.0, 1.0], "y": [0.0]}, "y has 1 numbers: give a list of 2 to 64 numbers"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, 1.0, 2.0]}, "has 2 numbers in x and 3 in y"),
        ("spring", {"x": [0.0], "y": [0.0]}, "x has 1 numbers"),
        ("spring", {"x": list(range(65)), "y": [0.0] * 65}, "x has 65 numbers"),
        ("spring", {"y": [0.0, 1.0]}, "x is None"),
        ("spring", {"x": "01", "y": [0.0, 1.0]}, "x is '01'"),
        ("spring", {"x": [0.0, 0.0], "y": [0.0, 1.0]}, "x goes from 0 to 0: give arguments that rise"),
        ("spring", {"x": [0.0, math.nan], "y": [0.0, 1.0]}, r"x\[1\] is nan"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, math.inf]}, r"y\[1\] is inf"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, "1"]}, r"y\[1\] is '1', which is not a number"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, 1.0], "beyond": "clamped"}, "give one of held, straight"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, 1.0], "argument_unit": "mm"}, "give the curve in 'm'"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, 1.0], "unit": "kN"}, "give the curve in 'N'"),
        ("spring", {"x": [0.0, 1.0], "y": [0.0, 1.0], "k3": 1.0}, "no parameter 'k3'"),
        ("loading", {"x": [0.0, 100.0], "y": [0.0, 1.0]}, "outside 0.001 to 1000"),
        ("loading", {"x": [-1.0, 100.0], "y": [1.0, 1.0]}, "forces begin below 0"),
        ("unloading", {"x": [0.0, 100.0], "y": [1.0, 1.5], "beyond": "straight"}, "it has to be held"),
        ("compaction", {"x": [0.0, 10.0], "y": [-1.0, 0.0]}, "outside -0.99"),
        ("compaction", {"x": [-1.0, 10.0], "y": [-0.1, 0.0]}, "impacts begin below 0"),
        ("drive-waveform", {"x": [0.0, 7.0], "y": [0.1, 0.0]}, "more than a period"),
        ("drive-waveform", {"x": [0.0, 2 * math.pi], "y": [0.1, 0.0]}, "first and last value differ"),
        ("drive-waveform", {"x": [0.0, 3.0], "y": [0.1, 0.0], "beyond": "straight"}, "nothing beyond it"),
        ("coil", {"x": [0.0, 3.0], "y": [0.1, 0.0]}, "effect is 'tabulated-coil'"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(place, change, message):
    with pytest.raises(InputError, match=message) as caught:
        make(f"tabulated-{place}", **change)
    assert "\n" not in str(caught.value)


def test_given_once_each():
    chosen = make("tabulated-spring", **SPRING)
    with pytest.raises(InputError, match="tabulated-spring is given twice"):
        run(chosen, Chosen(chosen.effect, chosen.values, chosen.curve))
