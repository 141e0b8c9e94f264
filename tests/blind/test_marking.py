"""Each rule of docs/trial/rules.md, on answers and reports made by hand."""

import json
import math

import numpy as np
import pytest

from drillenv.blind import curves, detection, marking
from drillenv.blind.campaigns import GROUPS, Planned, make_campaign, plan, plan_curves, plan_nulls, schedule
from drillenv.blind.mechanisms import MECHANISMS, Concealed, Site, of_library

OUTCOME = {"status": "answered", "seconds": 10.0, "memory_mib": 300.0}
MISSING = dict.fromkeys(detection.UNITS, 0.0)
CONSTANTS = {"damping": 2450.0, "stiffness": 68850.0}
RANGES = {
    "into": (0.001, 0.3),
    "depth": (0.0, 1e-4),
    "shortening": (2e-3, 4e-3),
    "closing": (-0.2, 0.2),
    "v1": (-3e-3, 5e-3),
    "signal": (50.0, 4000.0),
    "drive": (-600.0, 600.0),
    "channels": (0.0, 1.0),
}
WHERE = curves.Reference(21.4e6, 68850.0, 5e-5, 200.0, 2e-5, RANGES)
NOISE = (0.002, 5.0, 2.0)


def answer(group, *concealed, wrong=None):
    entries = [
        {
            "mechanism": each.mechanism,
            "equation": each.equation.name,
            "of_library": each.equation.of_library,
            "parameters": dict(each.parameters),
            "law": curves.law_of(each, WHERE, NOISE),
        }
        for each in concealed
    ]
    verdicts = {"null": "agrees", "wrong-constant": "parameters", "outside": "unexplained"}
    return {
        "group": group,
        "verdict": verdicts.get(group, "missing-physics"),
        "mechanisms": entries,
        "wrong": wrong or {},
        "true": CONSTANTS | (wrong or {}),
        "missing": MISSING,
        "reference": WHERE._asdict(),
        "conditions": {"noise": NOISE},
    }


def report(verdict, *findings, parameters=None, held_out=1.0):
    return {
        "verdict": verdict,
        "where": {"summary": "Somewhere."},
        "findings": list(findings),
        "parameters": parameters or {},
        "fit": {"noise_floor": 1.0, "held_out": {"before": 3.0, "after": held_out}},
    }


def finding(name, equivalents=(), law=None, **values):
    made = {
        "mechanism": name,
        "equivalents": list(equivalents),
        "parameters": {
            symbol: {"value": value, "std": 0.05 * abs(value), "unit": "1"} for symbol, value in values.items()
        },
    }
    return made | ({"law": law} if law else {})


def mark(answer, report):
    made = marking.mark(json.loads(json.dumps(answer)), OUTCOME, report)
    json.dumps(made, allow_nan=False)
    return made


HUNT_CROSSLEY = of_library("contact-rate", chi=0.5)
KELVIN_VOIGT = Concealed("contact-rate", MECHANISMS["contact-rate"].equations[1], {"c_r": 400.0})


def test_no_answer_is_not_right():
    made = marking.mark(answer("null"), OUTCOME | {"status": "out of time"}, None)
    assert not made["right"] and made["verdict"] is None


@pytest.mark.parametrize(
    ("verdict", "right"), [("agrees", True), ("unexplained", False), ("missing-physics", False), ("parameters", True)]
)
def test_nothing_missing(verdict, right):
    findings = [finding("mains-hum", b_f=3.0)] if verdict == "missing-physics" else []
    made = mark(answer("null"), report(verdict, *findings))
    assert made["right"] == right
    summed = marking.summary([made])
    assert summed["false_alarms"]["hits"] == (verdict == "missing-physics")


@pytest.mark.parametrize(("value", "std", "right"), [(3000.0, 1.0, True), (3100.0, 1.0, False), (3100.0, 40.0, True)])
def test_a_constant_has_to_be_right(value, std, right):
    stated = {"damping": {"value": value, "std": std, "unit": "N*s/m"}}
    made = mark(answer("wrong-constant", wrong={"damping": 3000.0}), report("parameters", parameters=stated))
    assert made["right"] == right


def test_the_wrong_constant_has_to_be_among_those_stated():
    stated = {"stiffness": {"value": 68850.0, "std": 1.0, "unit": "N/m"}}
    assert not mark(answer("wrong-constant", wrong={"damping": 3000.0}), report("parameters", parameters=stated))[
        "right"
    ]


def test_the_librarys_equation():
    made = mark(answer("library-equation", HUNT_CROSSLEY), report("missing-physics", finding("contact-rate", chi=0.51)))
    assert made["right"] and made["mechanisms"] == {"contact-rate": "named"}
    assert made["laws"]["contact-rate"] == pytest.approx(0.02)
    assert [each["inside"] for each in made["intervals"]] == [True]


@pytest.mark.parametrize(("others", "right"), [(2, True), (3, False)])
def test_an_equivalence_class_has_at_most_three_members(others, right):
    names = ["contact-rate", "mains-hum", "air-spring"][:others]
    made = mark(
        answer("library-equation", HUNT_CROSSLEY), report("missing-physics", finding("contact-toe", names, h=1e-5))
    )
    assert made["named"] == right
    assert made["mechanisms"]["contact-rate"] == ("in a class" if right else "something else")


def test_a_second_mechanism_that_is_not_there_is_false():
    found = [finding("contact-rate", chi=0.5), finding("mains-hum", b_f=9.0)]
    made = mark(answer("library-equation", HUNT_CROSSLEY), report("missing-physics", *found))
    assert made["false"] == ["mains-hum"] and not made["named"] and made["intervals"] == []


@pytest.mark.parametrize(("factor", "right"), [(1.0, True), (1.08, True), (1.2, False)])
def test_another_equation_has_to_agree_as_a_force(factor, right):
    truth = answer("other-equation", KELVIN_VOIGT)
    x = np.asarray(truth["mechanisms"][0]["law"]["x"])
    law = {"argument": "speed", "x": x.tolist(), "y": (factor * 400.0 * x).tolist()}
    made = mark(truth, report("missing-physics", finding("contact-rate", law=law)))
    assert made["named"] and made["right"] == right
    assert made["laws"]["contact-rate"] == pytest.approx(factor - 1.0, abs=1e-9)


def test_a_curve_over_half_the_range_is_none():
    truth = answer("other-equation", KELVIN_VOIGT)
    law = {"argument": "speed", "x": [0.0, 0.15], "y": [0.0, 60.0]}
    assert not mark(truth, report("missing-physics", finding("contact-rate", law=law)))["right"]


def test_what_a_constant_takes_up_is_no_part_of_a_curve():
    x = np.linspace(-0.2, 0.2, 61)
    true = 900.0 * np.abs(x) * x
    assert curves.law_error("damping-quadratic", x, true, true + 170.0 * x) == pytest.approx(0.0, abs=1e-12)
    assert curves.law_error("damping-quadratic", x, true, 1.1 * true) == pytest.approx(0.1)
    assert curves.law_error("indenter-friction", x, true, true + 170.0 * x) > 1.0


TRUE = {"damping": 2450.0, "stiffness": 68850.0, "loading_stiffness": 21.4e6, "drive_gain": 1.0}


def marked_beside(concealed, found, **constants):
    """Marks of a law of the drilling rig that stands beside these constants, as a function of its argument."""
    truth = answer("other-equation", concealed) | {"true": TRUE}
    x = np.asarray(truth["mechanisms"][0]["law"]["x"])
    wide = np.linspace(x[0] - 0.5 * np.ptp(x), x[-1] + 0.5 * np.ptp(x), 2001)
    law = {"argument": "", "x": wide.tolist(), "y": found(wide).tolist()}
    said = report("missing-physics", finding(concealed.mechanism, law=law))
    return mark(truth, said | {"constants": {name: {"value": value} for name, value in (TRUE | constants).items()}})


TWO_LINES = Concealed(
    "stiffness-hardening",
    next(each for each in MECHANISMS["stiffness-hardening"].equations if each.name == "two lines"),
    {"k_b": 76e3, "s_b": 3e-3},
)


def spring(x):
    """Its force beside the true stiffness."""
    return 68850.0 * x + 76e3 * np.maximum(x - 3e-3, 0.0)


@pytest.mark.parametrize(("moved", "factor", "right"), [(2e-4, 1.0, True), (-3e-4, 1.0, True), (2e-4, 0.85, False)])
def test_a_spring_with_another_stiffness_is_the_same_force_further_along(moved, factor, right):
    """Where the shortening is zero, no channel tells: of the law by itself a third is off then."""

    def law(x):
        bent = factor * (spring(x + moved) - 68850.0 * (x + moved))
        return bent + 68850.0 * (x + moved) + 15.0 - 75e3 * x

    made = marked_beside(TWO_LINES, law, stiffness=75e3)
    assert made["right"] == right and not made["right_by_first_rules"]
    # what counts is over the law less its straight part, so that 15 % of the whole law are more of it
    low, high = (0.0, 0.01) if right else (0.15, 0.25)
    assert low <= made["laws_beside"]["stiffness-hardening"] < high


def test_a_law_is_nowhere_where_it_is_moved_too_far():
    made = marked_beside(TWO_LINES, lambda x: spring(x + 2e-3) - 68850.0 * x)
    assert not made["right"]


def test_a_limit_over_the_voltage_is_the_same_with_another_gain():
    clipped = next(each for each in MECHANISMS["force-limit"].equations if each.of_library)
    limit = Concealed("force-limit", clipped._replace(of_library=False), {"F_max": 400.0})

    def law(x):
        return np.clip(x / 0.95, -400.0, 400.0) - x

    made = marked_beside(limit, law, drive_gain=0.95)
    assert made["laws_beside"]["force-limit"] < 0.01 < made["laws"]["force-limit"]


@pytest.mark.parametrize(("factor", "right"), [(1.0, True), (1.2, False)])
def test_a_damper_is_compared_with_its_constant(factor, right):
    square = next(each for each in MECHANISMS["damping-quadratic"].equations if each.of_library)
    hidden = Concealed("damping-quadratic", square._replace(of_library=False), {"c_2": 5000.0})
    made = marked_beside(hidden, lambda x: factor * 5000.0 * np.abs(x) * x + 150.0 * x, damping=2300.0)
    assert made["right"] == right == made["right_by_first_rules"]
    # the straight part is the force's as well
    off = marked_beside(hidden, lambda x: 5000.0 * np.abs(x) * x + 150.0 * x)
    assert off["right_by_first_rules"] and not off["right"]


@pytest.mark.parametrize(("read", "right"), [(0.7, True), (0.95, False)])
def test_offsets_that_differ_are_compared_with_their_mean(read, right):
    """Drawn about 20 N, eight offsets have a mean of 14 N by chance."""
    apart = next(each for each in MECHANISMS["sensor-offset"].equations if each.name == "another in each recording")
    drawn = Concealed("sensor-offset", apart, {"o_e": 0.01, "o_f": 20.0, "o_a": 3.0, "spread": 0.7})
    realised = drawn._replace(parameters={name: 0.7 * value for name, value in drawn.parameters.items()})
    truth = answer("other-equation", drawn)
    truth["mechanisms"][0]["law_realised"] = curves.law_of(realised, WHERE, NOISE)
    stated = finding("sensor-offset", **{name: read * drawn.parameters[name] for name in ("o_e", "o_f", "o_a")})
    made = mark(truth, report("missing-physics", stated))
    assert made["right"] == right == (not made["right_by_first_rules"])


def test_a_report_without_constants_has_no_law_beside_them():
    made = mark(answer("other-equation", TWO_LINES) | {"true": TRUE}, report("missing-physics", finding("backlash")))
    assert made["laws_beside"] == {}


@pytest.mark.parametrize(
    ("verdict", "name", "right"),
    [("unexplained", None, True), ("agrees", None, False), ("missing-physics", "external-vibration", True),
     ("missing-physics", "air-spring", False)],
)  # fmt: skip
def test_outside_the_library(verdict, name, right):
    truth = answer("outside")
    truth["mechanisms"] = [
        {"mechanism": "external-vibration", "equation": "floor", "of_library": False, "parameters": {}, "law": None}
    ]
    assert mark(truth, report(verdict, *([finding(name)] if name else [])))["right"] == right


def test_what_is_no_function_of_one_argument_has_to_explain_the_recordings_held_out():
    slew = MECHANISMS["force-limit"].equations[3]
    truth = answer("other-equation", Concealed("force-limit", slew, {"slope": 1e5}))
    assert truth["mechanisms"][0]["law"] is None
    for held_out, right in ((1.05, True), (1.2, False)):
        made = mark(truth, report("missing-physics", finding("force-limit", F_max=200.0), held_out=held_out))
        assert made["right"] == right


@pytest.mark.parametrize("name", [name for name in MECHANISMS if curves.SHAPES[name].visited in RANGES])
def test_a_report_with_the_true_parameters_has_the_true_curve(name):
    """The library's equation with the parameters that a report would state, by the library's symbols."""
    mechanism = MECHANISMS[name]
    equation = next(each for each in mechanism.equations if each.of_library)
    true = Concealed(name, equation, equation.draw(np.random.default_rng(4), 1.0, Site(500.0, 100.0)))
    x = curves.arguments(name, WHERE)
    y = curves.curve(name, equation, true.parameters, x, WHERE, NOISE)
    found = curves.reported(finding(name, **true.parameters), x, WHERE, NOISE)
    assert curves.law_error(name, x, y, found) < 1e-12


def test_wilson_interval_of_the_textbook():
    """E. B. Wilson's interval for 1 of 29, as in R. G. Newcombe, Statistics in Medicine 17 (1998) 857-872, Table I."""
    low, high = marking.wilson(1, 29)
    assert (round(low, 4), round(high, 4)) == (0.0061, 0.1718)


def test_half_found_is_where_half_are_found():
    rng = np.random.default_rng(5)
    strengths = np.exp(rng.uniform(math.log(0.5), math.log(200.0), 400))
    named = rng.uniform(size=400) < 1.0 / (1.0 + (10.0 / strengths) ** 2.5)
    assert detection.half_found(strengths, named) == pytest.approx(10.0, rel=0.2)
    assert detection.half_found([1.0, 2.0], [True, True]) is None


def test_detection_curves_as_a_table():
    """A mechanism that is always found, one that is found half of the time, and one that never is."""
    marks = [
        {
            "group": "curve",
            "mechanisms": {name: "named" if strength > least else "missed"},
            "named": strength > least,
            "missing": {**MISSING, "contact": strength},
            "share": share,
        }
        for name, least in (("never", math.inf), ("half", 3.0), ("always", 0.0))
        for share, strength in ((1.0, 20.0), (0.1, 2.0))
    ]
    heads, _, *rows = detection.table(detection.detection_curves(marks)).splitlines()
    assert heads == "| mechanism | shows most on | half found at | 1 | 0.1 |"
    assert rows[0] == "| always | contact | below 2 N | 1 of 1 | 1 of 1 |"
    assert rows[1].startswith("| half | contact | ") and rows[1].endswith(" N | 1 of 1 | 0 of 1 |")
    assert rows[2] == "| never | contact | above 20 N | 0 of 1 | 0 of 1 |"


@pytest.mark.slow
def test_nothing_is_missing_in_a_trial_of_false_alarms():
    listed = plan_nulls(1, 5)
    assert [each.group for each in listed] == ["null", "wrong-constant", "null", "wrong-constant", "null"]
    answers = [make_campaign(1, i, each).answer for i, each in enumerate(listed[:2])]
    assert not any(each["mechanisms"] for each in answers)
    assert not answers[0]["wrong"] and len(answers[1]["wrong"]) == 1


def test_every_group_is_there_and_decks_are_dealt_to_their_ends():
    assert schedule(60) == [name for name, count in GROUPS.items() for _ in range(count)]
    assert set(schedule(13)) == set(GROUPS)
    planned = plan(1, 120)
    other = [cards[0] for group, cards, _ in planned if group == "other-equation"]
    assert len(set(other)) == len(other)
    assert plan(1, 120) == planned != plan(2, 120)
    listed = plan_curves(1, 2)
    assert {cards[0][0] for _, cards, _ in listed} == set(MECHANISMS)


@pytest.mark.slow
def test_a_campaign_depends_on_its_seed_and_number_alone():
    planned = Planned("other-equation", [("contact-rate", 1)])
    first, second, third = make_campaign(7, 3, planned), make_campaign(7, 3, planned), make_campaign(7, 4, planned)
    samples = [each.campaign.recordings[2].channels["force"].samples for each in (first, second, third)]
    assert np.array_equal(samples[0], samples[1])
    assert first.answer == second.answer
    assert not np.array_equal(samples[0][:1000], samples[2][:1000])
    # the lab is told nothing of it
    assert "contact" not in first.campaign.title
