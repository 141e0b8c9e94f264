"""Each mechanism of the library, put into small campaigns of the concealed rig, is found again."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drillenv.blind.campaigns import NOISE, plain_campaign
from drillenv.blind.mechanisms import MECHANISMS, OUTSIDE, Site, concealed, of_library
from drillenv.diagnosis.drill_identification import places_of
from drillenv.diagnosis.laws import equations, families
from drillenv.diagnosis.report import diagnose
from drillenv.diagnosis.sensing import textbook_sensors
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.dynamics.effects import REGISTRY

FLAT = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))
FOUND = sorted(
    {each.effect for family in families(FLAT, [60.0, 110.0]) for each in equations(*places_of(family))}
    | {each.effect for each in textbook_sensors(["r"], 25600.0)}
)
SEED = 7
QUICK = ("accelerometer-lowpass", "contact-toe")
"""Of a sensor and of the rock: a trial has the others as well."""
SITE = Site(drive=600.0, frequency=110.0)
"""N and Hz: about the most that these campaigns ask of the drive, for strengths that are drawn in proportion."""
SURE = 3.0
"""Standard deviations within which strengths are asked to lie; 1.96 would fail one in twenty."""


def test_every_mechanism_of_the_drilling_rig_is_looked_for():
    acting = {name for name, effect in REGISTRY.items() if effect.balances != ("body",)}
    # these have no curve, and are tried as sinusoids
    assert set(FOUND) == acting - {"external-vibration", "rock-rotation"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [each if each in QUICK else pytest.param(each, marks=pytest.mark.thorough) for each in FOUND if each in MECHANISMS],
)
def test_mechanism_is_found(name):
    rng = np.random.default_rng([SEED, *name.encode()])
    (equation,) = (each for each in MECHANISMS[name].equations if each.of_library)
    chosen = concealed(name, equation, rng, 1.0, SITE)
    report = diagnose(plain_campaign(rng, 4, (chosen,), recordings=5, seconds=0.2).campaign)
    assert report.verdict == "missing-physics"
    (finding,) = report.record["findings"]
    assert finding["mechanism"] == name
    assert report.record["fit"]["fitted"]["after"] < 1.03
    # not the speed at which friction sets in, which is dry here, nor the phases of a hum, another in each recording
    both = finding["parameters"].keys() & chosen.parameters.keys()
    assert both
    for symbol in both:
        found = finding["parameters"][symbol]
        off = found["value"] - chosen.parameters[symbol]
        if symbol.startswith("phi"):
            assert abs(found["value"]) <= math.pi
            off = math.remainder(off, 2.0 * math.pi)
        assert abs(off) < SURE * found["std"], symbol


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize(
    ("mechanism", "equation", "stated", "true"),
    [
        ("force-limit", "slope limited", "S_max", "slope"),
        ("rock-compaction", "exponential in depth", "soft_l", "x_0"),
    ],
)
def test_an_equation_over_another_argument_than_time_or_impacts_is_found(mechanism, equation, stated, true):
    """A drive that ramps, whose force depends on what was asked of it before; a face that compacts as it is drilled."""
    rng = np.random.default_rng([SEED, *equation.encode()])
    (form,) = (each for each in MECHANISMS[mechanism].equations if each.name == equation)
    chosen = concealed(mechanism, form, rng, 1.0, SITE)
    report = diagnose(plain_campaign(rng, 4, (chosen,), recordings=5, seconds=0.2).campaign)
    (finding,) = report.record["findings"]
    assert finding["mechanism"] == mechanism
    # the concealed amplifier follows with a lag of the first order, and not with a delay
    assert finding["parameters"][stated]["value"] == pytest.approx(chosen.parameters[true], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("channel-delay", marks=pytest.mark.thorough), "sensor-offset"])
def test_what_is_another_in_each_recording_is_said_of_each(name):
    """Those that were held out as well: of a few recordings their mean would be another."""
    rng = np.random.default_rng([SEED, *name.encode()])
    (equation,) = (each for each in MECHANISMS[name].equations if each.name == "another in each recording")
    made = plain_campaign(rng, 4, (concealed(name, equation, rng, 1.0, SITE),), recordings=5, seconds=0.2)
    (finding,) = diagnose(made.campaign).record["findings"]
    assert finding["mechanism"] == name
    assert finding["recordings"].keys() == {each.name for each in made.campaign.recordings}
    (mechanism,) = made.answer["mechanisms"]
    parameters = {symbol: entry["value"] for symbol, entry in finding["parameters"].items()}
    found = parameters["delay_a"] if name == "channel-delay" else parameters["o_f"] / NOISE[1]
    assert found == pytest.approx(mechanism["law_realised"]["y"][0], rel=0.03)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.xfail(
    reason="the plain model is 450 times the noise off: no straight look from there tells what is missing"
)
def test_a_drive_limited_to_half_of_what_it_asks_for_is_no_weak_drive():
    chosen = of_library("force-limit", F_max=170.0)
    campaign = plain_campaign(np.random.default_rng(12), 4, (chosen,), recordings=5, seconds=0.2).campaign
    report = diagnose(campaign)
    assert [each["mechanism"] for each in report.record["findings"]] == ["force-limit"]
    found = report.record["findings"][0]["parameters"]["F_max"]
    assert abs(found["value"] - 170.0) < SURE * found["std"]
    assert "drive_gain" not in report.record["parameters"]


@pytest.mark.thorough
@pytest.mark.slow
def test_what_acts_on_the_shaker_is_seen_beside_what_shows_everywhere():
    """No window on its own says anything of such a damper; a fit whose windows are joined by force names it."""
    chosen = (of_library("damping-quadratic", c2=1350.0), of_library("load-cell-inertia", m_c=0.1))
    campaign = plain_campaign(np.random.default_rng(SEED), 4, chosen, recordings=5, seconds=0.2).campaign
    report = diagnose(campaign)
    found = {each["mechanism"]: each["parameters"] for each in report.record["findings"]}
    assert set(found) == {"damping-quadratic", "load-cell-inertia"}
    assert abs(found["damping-quadratic"]["c2"]["value"] - 1350.0) < SURE * found["damping-quadratic"]["c2"]["std"]
    assert abs(found["load-cell-inertia"]["m_c"]["value"] - 0.1) < SURE * found["load-cell-inertia"]["m_c"]["std"]


@pytest.mark.slow
@pytest.mark.thorough
def test_air_that_is_soon_supplied_is_no_friction_of_the_guides():
    """Friction that sets in slowly explains nearly as much, and first looks point there."""
    chosen = of_library("air-spring", k_a=5e4, tau=0.15)
    campaign = plain_campaign(np.random.default_rng(SEED), 2, (chosen,), recordings=6, seconds=0.3).campaign
    (finding,) = diagnose(campaign).record["findings"]
    assert finding["mechanism"] == "air-spring"
    for symbol, true in (("k_a", 5e4), ("tau", 0.15)):
        found = finding["parameters"][symbol]
        assert abs(found["value"] - true) < SURE * found["std"]


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.xfail(reason="named, but the fit ends before it is at the noise")
def test_a_light_mount_that_rings_long_is_found():
    """What it was doing as a recording begins is not known, and no one strength says what another would do."""
    mount = {"s_r": 4e-8, "m_r": 20.0, "zeta_r": 0.05}
    chosen = of_library("rock-mount-compliance", MECHANISMS, **mount)
    campaign = plain_campaign(np.random.default_rng(8), 5, (chosen,), recordings=5, seconds=0.2).campaign
    report = diagnose(campaign)
    (finding,) = report.record["findings"]
    assert finding["mechanism"] == "rock-mount-compliance"
    for symbol, true in mount.items():
        found = finding["parameters"][symbol]
        assert abs(found["value"] - true) < SURE * found["std"], symbol
    assert report.record["fit"]["fitted"]["after"] < 1.03


@pytest.mark.thorough
@pytest.mark.slow
def test_dry_friction_of_the_indenter_is_found_to_a_hundredth():
    """The model rounds what sticks, over millimetres a second at most."""
    chosen = of_library("indenter-friction", fc2=15.0, vs2=0.0)
    campaign = plain_campaign(np.random.default_rng(SEED), 4, (chosen,), recordings=5, seconds=0.2).campaign
    (finding,) = diagnose(campaign).record["findings"]
    assert finding["parameters"]["fc2"]["value"] == pytest.approx(15.0, rel=0.01)
    assert finding["parameters"].get("vs2", {"value": 0.0})["value"] < 5e-3


@pytest.mark.slow
def test_a_sharp_corner_of_a_law_is_not_taken_for_more_physics():
    """Rock that is 1.6 times as stiff beyond a depth: coarsely drawn its law leaves twelve times the noise."""
    (equation,) = (each for each in MECHANISMS["contact-power-law"].equations if each.name == "stiffer beyond a depth")
    drawn = concealed("contact-power-law", equation, np.random.default_rng(SEED), 1.0, SITE)
    chosen = drawn._replace(parameters={**drawn.parameters, "ratio": 1.6, "d_b": 5e-5})
    report = diagnose(plain_campaign(np.random.default_rng(SEED), 3, (chosen,), recordings=5, seconds=0.2).campaign)
    (finding,) = report.record["findings"]
    assert (finding["mechanism"], finding["form"]) == ("contact-power-law", "measured")
    assert report.record["fit"]["fitted"]["after"] < 1.03


@pytest.mark.slow
@pytest.mark.thorough
def test_a_gain_that_drifts_is_no_hardening_spring():
    """A hardening spring of no strength at all would let a fresh rig begin elsewhere, and so gain something."""
    rng = np.random.default_rng(SEED)
    (equation,) = OUTSIDE["gain-drift, load cell"].equations
    chosen = concealed("gain-drift", equation, rng, 1.0, SITE)
    record = diagnose(plain_campaign(rng, 5, (chosen,), seconds=0.4).campaign).record
    assert record["verdict"] == "unexplained"
    assert record["findings"] == []


@pytest.mark.slow
@pytest.mark.thorough
def test_play_of_which_one_end_is_touched_is_a_law_of_the_spring():
    """A spring that stiffens and play that closes are one law where only one end is ever touched."""
    chosen = of_library("backlash", g=9e-4, y0=-6e-5)
    campaign = plain_campaign(np.random.default_rng(10), 1, (chosen,), recordings=5, seconds=0.2).campaign
    running = [each for each in campaign.recordings if each.starts != "fresh"]
    report = diagnose(replace(campaign, recordings=running))
    named = {each["mechanism"] for each in report.record["findings"]}
    assert named & {"backlash", "stiffness-hardening"}
