"""Plans of campaigns: what is said to be resolved is what recordings lose, and the settings chosen resolve most."""

import csv
import io
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.plan import counts
from drillenv import Setting, cli
from drillenv.checks import InputError
from drillenv.corrected import Corrected, model_record
from drillenv.diagnosis.constants import constants
from drillenv.diagnosis.drill import point_of
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.equations import Around
from drillenv.diagnosis.fitting import priors_of
from drillenv.diagnosis.terms import ModelStructure
from drillenv.dynamics.effects import LIBRARY, make
from drillenv.dynamics.sensors import record
from drillenv.planning import information as plan_information
from drillenv.planning.choice import Judge, chosen_from, places_held_out
from drillenv.planning.information import FLAT, Site, axes_over, candidate, grid, settle, signatures_of, survey
from drillenv.planning.plan import plan_campaign, slow_remarks
from drillenv.planning.signatures import parameters_at, planned_for, signatures, size_of
from drillenv.recordings.made import believed
from drillenv.rig import Rig
from drillenv.rocks import rock

SITE = Site(Rig(), rock(4), seconds=0.25)
SETTINGS = grid(((55.0, 115.0), (0.3, 0.6), (0.6, 1.2)), (3, 2, 2), (1, 2, 2))


def quiet(_text):
    """Says nothing."""


@pytest.fixture(scope="module")
def found():
    """A survey of a dozen settings, some of them from rest too."""
    wanted = [(each, "running") for each in SETTINGS] + [(each, "fresh") for each in SETTINGS[::4]]
    return survey(SITE, wanted, 0, quiet)


# a mount of more mass that is as much less compliant has the same frequency, as a strength of its has
WEAK_MOUNT = {"s_r": 2.75e-10, "m_r": 5500.0, "zeta_r": 0.11}


@pytest.mark.parametrize(
    ("name", "share", "weak"),
    [
        ("contact-rate", 0.01, {"chi": 0.0085}),
        ("damping-quadratic", 0.01, {"c2": 9.0}),
        ("indenter-friction", 0.005, {"fc2": 0.2375}),
        ("rock-mount-compliance", 0.01, WEAK_MOUNT),
        ("load-cell-inertia", 0.02, {"m_c": 0.0032}),
    ],
)
def test_information_is_what_a_recording_loses(name, share, weak, monkeypatch):
    """Half the square of a small strength times the information is what the model without it leaves."""
    setting = Setting(85.0, 0.45, 1.0)
    base = ModelStructure((constants(believed(SITE.rig, SITE.rock)),), FLAT, DRILL)
    plain = settle(SITE, setting, "running", base)
    with ThreadPoolExecutor(1) as pool:
        axes = axes_over([plain], base, pool)
    around = Around(SITE.rig.stiffness, SITE.rock.loading_stiffness, SITE.rock.unloading_stiffness)
    signature = signatures(LIBRARY[name], axes, around, np.random.default_rng(0))[0]
    whole = ModelStructure((*base.terms, *signature.terms), axes, DRILL)
    information = candidate(plain, whole, len(base.unknowns), [signature]).information[-1, -1]

    there = {"sensors" if LIBRARY[name].measure is not None else "effects": [make(name, **weak)]}

    def recorded(rig, at, on, seconds, rate, effects, lead):
        return record(rig, at, on, seconds, rate, lead=lead, **there)

    monkeypatch.setattr(plan_information, "record", recorded)
    monkeypatch.setattr(plan_information, "LEFT_OVER", np.inf)
    with_it = settle(SITE, setting, "running", base)
    left = with_it.block.cost(priors_of(base).centre, with_it.own)
    assert left == pytest.approx(0.5 * share**2 * information, rel=0.1)


@pytest.mark.slow
def test_judged_sets_grow_better(found):
    judge = Judge(found)
    running = [i for i, each in enumerate(found.candidates) if not each.fresh]
    few, more = judge.resolution(running[:3]), judge.resolution(running)
    # what is needed grows with the recordings where sensors limit it; the information always does
    assert np.all(few.alone / np.sqrt(judge.needed(running[:3])) >= more.alone / np.sqrt(judge.needed(running)) - 1e-12)
    assert np.all(more.hardest >= more.alone * (1.0 - 1e-9))
    assert len(judge.mechanisms) == sum(planned_for(each) for each in LIBRARY.values())


def test_chosen_are_better_than_any_drawn(found):
    judge, rng = Judge(found), np.random.default_rng(1)
    order = chosen_from(found, judge, 5, quiet)
    assert len({found.candidates[i].setting for i in order}) == 5
    assert sum(found.candidates[i].fresh for i in order) == 1
    for _ in range(100):
        drawn = rng.choice(len(found.candidates), 5, replace=False)
        kinds = [found.candidates[i].fresh for i in drawn]
        if sum(kinds) == 1 and len({found.candidates[i].setting for i in drawn}) == 5:
            assert judge.value(drawn) <= judge.value(order) + 1e-9


def test_those_held_out_are_the_ones_least_needed(found):
    judge = Judge(found)
    order = chosen_from(found, judge, 5, quiet)
    held = places_held_out(found, order)
    kept = judge.value([i for place, i in enumerate(order) if place not in held])
    frequencies = [found.candidates[i].setting.frequency for i in order]
    running = [place for place, i in enumerate(order) if not found.candidates[i].fresh]
    inside = [place for place in running if min(frequencies) < frequencies[place] < max(frequencies)]
    assert len(held) == 1
    possible = inside or running
    assert kept == pytest.approx(max(judge.value([i for p, i in enumerate(order) if p != place]) for place in possible))


def test_parameters_at_a_share_are_as_strong(found):
    point = point_of(found.example[1])
    for signature in {each.effect: each for each in reversed(found.signatures)}.values():
        effect = LIBRARY[signature.effect]
        size = size_of(effect, found.axes, found.around, found.example[0], point)
        whole = dict(zip((each.symbol for each in effect.parameters), signature.parameters, strict=True))
        for share in (1.0, 0.5):
            found_at = parameters_at(signature, share, size)
            p = tuple(found_at.get(each.symbol, whole[each.symbol]) for each in effect.parameters)
            # a filter that takes off the mean does so at any corner
            assert found_at or signature.effect == "sensor-highpass"
            assert not found_at or size(p) == pytest.approx(share * size(signature.parameters), rel=1e-3)


def test_a_range_of_one_value_is_one_value():
    made = grid(((80.0, 80.0), (0.3, 0.32), (0.6, 1.2)), (7, 3, 4), (1, 2, 2))
    assert len(made) == len(set(made)) == 3 * 4
    assert {each.frequency for each in made} == {80.0}


def test_an_effect_that_the_model_has_is_planned_no_more(found):
    site = replace(SITE, effects=(make("contact-rate", chi=0.3),))
    rng = np.random.default_rng(0)
    names = {each.effect for each in signatures_of(site, found.axes, found.around, rng)}
    assert "contact-rate" not in names
    assert "contact-toe" in names


@pytest.mark.slow
def test_with_effects_of_a_model():
    site = replace(SITE, effects=(make("contact-rate", chi=0.3), make("rock-mount-compliance", s_r=1e-8, m_r=40.0)))
    made = survey(site, [(SETTINGS[4], "running"), (SETTINGS[7], "fresh")], 0, quiet)
    assert len(made.candidates) == 2
    assert np.all(np.isfinite(made.candidates[0].information))


@pytest.mark.slow
def test_plan_on_the_command_line(tmp_path, capsys):
    options = ["--settings", "4", "--seconds", "0.2", "--frequency", "60", "110"]
    sheet, model = tmp_path / "sheet.csv", tmp_path / "model.json"
    model.write_text(json.dumps(model_record(Corrected(rock=rock(2)))))
    assert cli.main(["campaign", "plan", "--model", str(model), *options, "--out", str(sheet), "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    rows = list(csv.DictReader(io.StringIO(sheet.read_text())))
    assert (
        [each["name"] for each in rows] == [each["name"] for each in plan["recordings"]] == ["r01", "r02", "r03", "r04"]
    )
    assert {each["starts"] for each in rows} == {"running", "fresh"}
    assert all(60.0 <= float(each["frequency_Hz"]) <= 110.0 and each["purpose"] for each in rows)
    assert {each["mechanism"] for each in plan["mechanisms"]} == {n for n, each in LIBRARY.items() if planned_for(each)}
    # the same once more, in words
    again = plan_campaign(rock(2), settings=4, seconds=0.2, box=((60.0, 110.0), (0.3, 0.6), (0.6, 1.8)))
    assert [each.setting.frequency for each in again.recordings] == [float(each["frequency_Hz"]) for each in rows]
    assert "| contact-toe" in again.text()
    assert [each for each in again.remarks if each.startswith("rock-rotation")] == slow_remarks(
        Site(Rig(), rock(2), seconds=0.2), again.mechanisms
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--settings", "2"], "settings is 2, outside 3 to 24"),
        (["--seconds", "0"], "seconds is 0 s, outside 0.1 to 10 s"),
        (["--frequency", "90", "60"], "frequency goes from 90 to 60: give the lowest first"),
        (["--pressure", "1", "9"], "highest pressure is 9, outside 0.2 to 5"),
        (["--noise", "0", "1"], "noise on the force is 0, outside 1e-09 to 1e+06"),
        (["--out", "sheet.pdf"], "the ending of --out is '.pdf': give one of .md, .csv"),
        (["--rock", "7"], "7"),
    ],
)
def test_bad_input_is_said_in_a_line(arguments, said, capsys):
    assert cli.main(["campaign", "plan", *arguments]) == 2
    complaint = capsys.readouterr().err
    assert said in complaint
    assert len(complaint.splitlines()) == 1


def test_effects_that_are_no_equation_of_the_motion_are_refused():
    curve = make("tabulated-spring", x=[0.0, 0.004], y=[0.0, 3.0])
    with pytest.raises(InputError, match="tabulated-spring of the model follows no equation"):
        plan_campaign(rock(4), effects=[curve])


def test_what_the_documentation_says_of_plans_is_what_came_out():
    """docs/recordings/README.md states the counts of docs/recordings/plan.json."""
    done = json.loads(Path("docs/recordings/plan.json").read_text())["done"]
    text = Path("docs/recordings/README.md").read_text()
    names = {1.0: "full", 0.3333: "a third", 0.1: "a tenth"}
    for share, tried, by_plan, by_spread in counts(done):
        assert f"| {names[share]} | {by_plan} of {tried} | {by_spread} of {tried} |" in text
