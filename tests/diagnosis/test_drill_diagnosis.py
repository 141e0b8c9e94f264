"""The second design from a campaign of the concealed rig to its verdict."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.blind.mechanisms import MECHANISMS, Concealed
from drillenv.corrected import model_from_record, model_record
from drillenv.diagnosis import drill_report
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.constants import misread_excitations
from drillenv.diagnosis.drill_diagnosis import (
    STRETCH,
    diagnose_drill,
    extended,
    nominal_rig,
    outlying_recording,
    plain_fit,
    reestimate_states,
)
from drillenv.diagnosis.drill_prediction import StateEstimate, own_lines
from drillenv.diagnosis.drill_report import corrected, record_of, waves
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.fitting import SHORT, TIGHT
from drillenv.diagnosis.naming import name_law
from drillenv.diagnosis.score_tests import PEAKS, Batch, at_peaks, information, score_tests
from drillenv.diagnosis.selection import from_above, from_strengths, short_fit
from drillenv.diagnosis.thresholds import LEFT

pytestmark = pytest.mark.slow


def concealing(name: str, equation: int, **parameters: float) -> tuple[Concealed, ...]:
    """A mechanism of the catalogue under one of its equations."""
    return (Concealed(name, MECHANISMS[name].equations[equation], parameters),)


def diagnosed(seed: int, hidden=(), wrong=None, recordings=4, seconds=0.25):
    """Diagnose a few short recordings; also what was true."""
    made = plain_campaign(np.random.default_rng(seed), 4, hidden, wrong, recordings=recordings, seconds=seconds)
    return made, diagnose_drill(made.campaign)


def test_nothing_missing_agrees():
    made, outcome = diagnosed(21)
    assert outcome.verdict in ("agrees", "parameters")
    assert not outcome.steps
    assert outcome.final.reduced_chi_square == pytest.approx(1.0, abs=0.02)
    spread = np.sqrt(np.diag(outcome.final.fit.covariance))
    for i, unknown in enumerate(outcome.final.structure.unknowns[:8]):
        off = outcome.final.values[i] - made.true._asdict()[unknown.name]
        assert abs(off) < 4.5 * spread[i] * unknown.scale, unknown.name


def test_a_wrong_constant_is_named_and_right(monkeypatch):
    made, outcome = diagnosed(22, wrong={"damping": 9.0})
    record = record_of(outcome, [])
    assert outcome.verdict == "parameters"
    assert record["parameters"]["damping"]["value"] == pytest.approx(made.true._asdict()["damping"], rel=0.01)
    # of a recording that a model does not get through nothing is simulated, and nothing shown
    lost, *others = [each.name for each in outcome.fit_data]
    monkeypatch.setattr(drill_report, "is_followed", lambda each: each.block.name != lost)
    assert {each["recording"] for each in record_of(outcome, [])["cells"]} == set(others)
    drawn = {
        wave.name: [(trace.before is None, trace.after is None) for trace in wave.traces] for wave in waves(outcome)
    }
    assert drawn == {lost: 2 * [(True, True)], **{name: 2 * [(False, False)] for name in others}}
    monkeypatch.setattr(drill_report, "is_followed", lambda _: False)
    record = record_of(replace(outcome, verdict="unexplained"), [])
    assert record["where"]["summary"] == record["rest"]["summary"] == drill_report.FOLLOWS_NONE
    assert record["cells"] == []


def test_a_wrong_mass_of_the_shaker_shows_in_how_its_windows_go_on():
    """It is 3 % off, of which a few periods say nothing: it is the motion over a whole recording that tells."""
    made, outcome = diagnosed(22, wrong={"shaker_mass": 8.0}, recordings=6, seconds=0.5)
    assert outcome.verdict == "parameters"
    assert outcome.final.values[0] == pytest.approx(made.true._asdict()["shaker_mass"], rel=0.01)


@pytest.mark.parametrize(
    ("seed", "equation", "hidden", "form", "parameters", "error"),
    [
        (23, 0, {"chi": 0.6}, "hunt-crossley", {"chi": 0.6}, 0.03),
        pytest.param(
            24, 3, {"c_t": 450.0}, "power of the depth", {"c_d": 450.0, "p_d": 0.25}, 0.05, marks=pytest.mark.thorough
        ),
    ],
)
def test_the_librarys_equation_gives_the_form_and_its_parameters(seed, equation, hidden, form, parameters, error):
    _, outcome = diagnosed(seed, concealing("contact-rate", equation, **hidden))
    (finding,) = record_of(outcome, [])["findings"]
    assert (outcome.verdict, finding["mechanism"], finding["form"]) == ("missing-physics", "contact-rate", form)
    values = {name: each["value"] for name, each in finding["parameters"].items()}
    assert values == pytest.approx(parameters, rel=error)
    model = corrected(outcome)
    assert model_from_record(model_record(model)).effects == model.effects


@pytest.mark.thorough
def test_a_mount_on_a_bed_that_gives_is_told_from_one_that_stands():
    hidden = concealing("rock-mount-compliance", 1, s_r=2e-8, m_r=25.0, zeta_r=0.1, m_b=90.0, s_b=1.5e-8)
    campaign = plain_campaign(np.random.default_rng(25), 4, hidden, recordings=5, seconds=0.25).campaign
    data = [condition(each, nominal_rig(campaign)).first(STRETCH) for each in campaign.recordings]
    with ThreadPoolExecutor(2) as pool:
        plain = plain_fit(campaign, data, pool)
        tried = [each for each in DRILL.candidates(plain) if each.group == "mount"]
        (first, _known), *_ = at_peaks(tried, information(plain, [Batch(each.terms) for each in tried]))
        ((score,), _level) = score_tests(plain, [first])
        found = from_strengths(plain, score, SHORT)
        named, fitted = name_law(found, first, plain.cost - found.cost)
    assert named.equation is not None and named.equation.form.name == "two masses"  # type: ignore[attr-defined]
    true = [2e-8, 25.0, 0.1, 90.0, 1.5e-8, 0.1]
    assert fitted.values_of(named.equation.name) == pytest.approx(true, rel=0.1)


def test_a_mount_is_looked_for_where_it_resonates():
    """Far off, between the frequencies that were once tried: from 60 and 150 Hz fits came to other minima."""
    hidden = concealing("rock-mount-compliance", 0, s_r=3.4e-8, m_r=67.0, zeta_r=0.065)
    campaign = plain_campaign(np.random.default_rng(25), 4, hidden, recordings=5, seconds=0.25).campaign
    data = [condition(each, nominal_rig(campaign)).first(STRETCH) for each in campaign.recordings]
    with ThreadPoolExecutor(2) as pool:
        plain = plain_fit(campaign, data, pool)
        tried = [each for each in DRILL.candidates(plain) if each.group == "mount"]
        (first, _known), *others = at_peaks(tried, information(plain, [Batch(each.terms) for each in tried]))
        assert plain.reduced_chi_square > 5.0 and len(others) < PEAKS
        assert first.look_elsewhere == len(tried)
        ((score,), _level) = score_tests(plain, [first])
        found = from_strengths(plain, score, SHORT)
        gain, frequency, ratio = found.values_of("mount")
        assert score.strength == pytest.approx(1.0 / 67.0, rel=0.5)
        assert gain == pytest.approx(1.0 / 67.0, rel=0.05)
        assert math.exp(frequency) == pytest.approx(1.0 / (2.0 * math.pi * math.sqrt(3.4e-8 * 67.0)), rel=0.01)
        assert ratio == pytest.approx(0.065, rel=0.1)


@pytest.mark.thorough
def test_dry_friction_is_fitted_from_above():
    """From below its fit ends at a minimum of its own, where the mass slides on."""
    hidden = concealing("guide-friction", 2, f_c=45.0, f_s=45.0, v_s=1.0, sigma=9e7, sigma_1=0.0)
    campaign = plain_campaign(np.random.default_rng(26), 4, hidden, recordings=5, seconds=0.25).campaign
    data = [condition(each, nominal_rig(campaign)).first(STRETCH) for each in campaign.recordings]
    with ThreadPoolExecutor(2) as pool:
        plain = plain_fit(campaign, data, pool)
        (family,) = (each for each in DRILL.candidates(plain) if each.name == "presliding guide")
        below, above = short_fit(plain, family), from_above(plain, family, SHORT, None)
    assert above.slack == TIGHT and above.cost < below.cost - 10.0
    assert above.values_of(family.terms[0].name)[0] == pytest.approx(45.0, rel=0.1)


def test_an_excitation_that_is_misread_near_the_mains_is_corrected_in_its_recording():
    """By a hum that is not told from it, of a hundredth and a hundredth of a radian: the drive is the true one."""
    campaign = plain_campaign(np.random.default_rng(27), 4, recordings=4, seconds=0.25).campaign
    data = [condition(each, nominal_rig(campaign)).first(STRETCH) for each in campaign.recordings]
    name = data[2].name
    data[2] = replace(data[2], amplitude=1.01 * data[2].amplitude, phase=data[2].phase + 0.01)
    with ThreadPoolExecutor(2) as pool:
        blind = plain_fit(campaign, data, pool)
        found = plain_fit(campaign, data, pool, [name, "held out"])
    share, ahead = found.values_of("excitation")
    assert blind.cost - found.cost > 100.0
    assert found.reduced_chi_square == pytest.approx(1.0, abs=0.03)
    assert share == pytest.approx(1.0 / 1.01 - 1.0, abs=2e-3)
    assert ahead == pytest.approx(-0.01, abs=2e-3)
    (sentence,) = drill_report.misread_remarks(found)
    assert f"The excitation of {name} is so near to the mains" in sentence and "-1 % and -0.5" in sentence
    assert drill_report.misread_remarks(blind) == []


def test_a_fit_to_stretches_with_two_misread_recordings_is_held_against_all_of_them():
    campaign = plain_campaign(np.random.default_rng(27), 4, recordings=4, seconds=0.25).campaign
    data = [condition(each, nominal_rig(campaign)) for each in campaign.recordings]
    names = [each.name for each in data[:2]]
    with ThreadPoolExecutor(2) as pool:
        short = plain_fit(campaign, [each.first(12) for each in data], pool, names)
        best = extended(data, short, pool)
        found = reestimate_states(short, best, pool)
    assert found.fit.shared.tolist() == short.fit.shared.tolist()
    assert found.samples == best.samples > short.samples
    assert best.cost < found.cost
    assert found.reduced_chi_square == pytest.approx(1.0, abs=0.05)


def test_what_is_misread_of_one_recording_is_its_own():
    term = misread_excitations(("a", "b"), ("a", "b", "c"))
    values = np.array([0.01, 0.02, 0.03, 0.04])
    alone, own = term.of_recording("b", values)
    assert alone.names == ("b",) and own.tolist() == [0.03, 0.04] and len(alone.unknowns) == 2
    held, own = term.of_recording("c", values)
    assert held.names == ("c",) and own.tolist() == [0.0, 0.0]
    other, own = term.of_recording("d", values)
    assert other.names == other.unknowns == () and own.size == 0


@pytest.mark.thorough
def test_an_equation_is_named_with_its_law():
    _, outcome = diagnosed(24, concealing("contact-rate", 1, c_r=500.0))
    (finding,) = record_of(outcome, [])["findings"]
    assert (outcome.verdict, finding["mechanism"]) == ("missing-physics", "contact-rate")
    assert finding["form"] == "kelvin-voigt"
    law = finding["law"]
    x, y = np.array(law["x"]), np.array(law["y"])
    inside = x > 0.02
    assert np.sqrt(np.mean((y - 500.0 * x)[inside] ** 2)) < 0.1 * np.sqrt(np.mean((500.0 * x[inside]) ** 2))
    assert np.all(np.array(law["low"]) <= y)
    assert np.all(y <= np.array(law["high"]))


@pytest.mark.thorough
def test_a_measured_law_is_named_and_is_a_model():
    _, outcome = diagnosed(24, concealing("contact-rate", 2, a=0.4))
    (finding,) = record_of(outcome, [])["findings"]
    assert (outcome.verdict, finding["mechanism"]) == ("missing-physics", "contact-rate")
    law = finding["law"]
    x, y = np.array(law["x"]), np.array(law["y"])
    inside = x > 0.02
    root = np.sqrt(x[inside])
    left = y[inside] - root * (root @ y[inside]) / (root @ root)
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(y[inside] ** 2))
    assert np.all(np.array(law["low"]) <= y)
    assert np.all(y <= np.array(law["high"]))
    # it goes into the file and comes back
    model = corrected(outcome)
    assert [each.effect.name for each in model.effects] == ["tabulated-rate-factor", "tabulated-rate-force"]
    assert model_from_record(model_record(model)).effects == model.effects


def test_a_measured_law_is_told_with_the_constant_beside_it():
    """A spring of two lines whose first stiffness the lab has wrong: the force is right, wherever its zero is."""
    at = [each.name for each in MECHANISMS["stiffness-hardening"].equations].index("two lines")
    made, outcome = diagnosed(28, concealing("stiffness-hardening", at, k_b=7e4, s_b=2.5e-3), wrong={"stiffness": 7.0})
    record = record_of(outcome, [])
    (finding,) = record["findings"]
    assert (outcome.verdict, finding["mechanism"]) == ("missing-physics", "stiffness-hardening")
    law, true = finding["law"], made.true.stiffness
    assert law["beside"]["constant"] == "stiffness" and law["beside"]["unit"] == "N/m"
    assert law["beside"]["value"] == record["constants"]["stiffness"]["value"]
    # what a law may have a part of is not said to be wrong by itself
    assert "stiffness" not in record["parameters"]
    x = np.array(law["x"])
    force = law["beside"]["value"] * x + np.array(law["y"])
    errors = []
    for moved in np.linspace(-1e-3, 1e-3, 401):
        whole = true * (x + moved) + 7e4 * np.maximum(x + moved - 2.5e-3, 0.0)
        off = force - whole
        errors.append(np.std(off))
    assert min(errors) < 0.02 * np.std(force)
    assert record["where"]["summary"]


@pytest.mark.thorough
def test_a_hum_that_swells_is_followed():
    """By eight tenths of it, twice a second, in each of four recordings otherwise."""
    at = [each.name for each in MECHANISMS["mains-hum"].equations].index("swelling")
    hum = concealing("mains-hum", at, f_m=50.03, b_e=0.0, b_f=20.0, b_a=10.0, swell=0.8, f_swell=2.0)
    _, outcome = diagnosed(25, hum)
    assert [each.named.mechanism for each in outcome.steps] == ["mains-hum"]
    assert outcome.final.reduced_chi_square < 1.0 + LEFT
    # recordings held out have it as lines beside each other
    lines = own_lines(outcome.final)
    assert len(lines) >= 3 and all(abs(line - 50.0) < 2.0 for line in lines)
    # its amplitude is that of the equation and of what corrects it together, and it has no overtones
    (finding,) = record_of(outcome, [])["findings"]
    assert finding["law"]["x"] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert finding["law"]["y"][0] == pytest.approx(20.0, rel=0.5) and max(finding["law"]["y"][1:]) < 0.5
    assert finding["parameters"]["b_f"]["value"] == pytest.approx(finding["law"]["y"][0])
    assert finding["parameters"]["b_a"]["value"] == pytest.approx(0.5 * finding["law"]["y"][0], rel=0.05)


def test_a_recording_that_no_motion_follows_is_the_outlier():
    """Its excess is infinite: more than that of all the others together."""

    class Block:
        windows, samples = 8, 800

        def __init__(self, name, cost):
            self.name, self.point, self.cost = name, SimpleNamespace(name=name), cost

        def free_unknowns(self, _own):
            return 4

        def costs(self, _shared, _own):
            return self.cost, np.full(self.windows, self.cost / self.windows)

    costs = {"r1": 420.0, "r2": 430.0, "r3": math.inf, "r4": 425.0, "r5": 440.0}
    every = [StateEstimate(Block(*each), np.zeros(32), np.zeros(1)) for each in costs.items()]  # type: ignore[arg-type]
    assert outlying_recording(SimpleNamespace(every=every)) == "r3"  # type: ignore[arg-type]
    two = [each._replace(block=Block(each.block.name, math.inf)) for each in every[:2]]  # type: ignore[arg-type]
    assert outlying_recording(SimpleNamespace(every=[*two, *every[2:]])) is None  # type: ignore[arg-type]
