"""What the pages say of the published trials is what they came to."""

import json
import re
from pathlib import Path

import pytest

from drillenv.blind import marking
from drillenv.blind.campaigns import make_campaign, plan
from drillenv.blind.detection import detection_curves, table
from drillenv.blind.seal import digest

ROOT = Path(__file__).parents[2]
TRIAL = ROOT / "docs" / "trial"
EARLIER = sorted((TRIAL / "earlier").iterdir())


@pytest.fixture(scope="module")
def record():
    return json.loads((TRIAL / "trial.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def answers():
    return json.loads((TRIAL / "answers.json").read_text(encoding="utf-8"))


def test_the_answers_are_those_that_were_sealed(record):
    assert digest((TRIAL / "answers.json").read_bytes()) == record["answers_sha256"]
    for page in (TRIAL / "README.md", TRIAL / "trial.html"):
        assert record["answers_sha256"] in page.read_text(encoding="utf-8")


def test_the_marks_are_summed_up_rightly(record):
    assert json.loads(json.dumps(marking.summary(record["marks"]))) == record["summary"]


def test_the_tables_say_what_was_counted(record):
    page, groups = (TRIAL / "README.md").read_text(encoding="utf-8"), record["summary"]["groups"]
    for name, group in groups.items():
        right, named = group["right"], group["named"]
        assert f"| {name} | {right['of']} | {right['hits']} | {named['hits']} | {group['seconds_median']:.0f} |" in page
    right = sum(group["right"]["hits"] for group in groups.values())
    low, high = marking.wilson(right, len(record["marks"]))
    claim = f"{right} of {len(record['marks'])} ({100 * low:.0f} to {100 * high:.0f} %)"
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert claim in readme
    alarms = record["summary"]["false_alarms"]
    assert f"{alarms['hits']} of {alarms['of']} ({100 * alarms['low']:.0f} to {100 * alarms['high']:.0f} %)" in readme
    for name, words in (("library-equation", "own equation"), ("other-equation", "by another")):
        assert f"{words} {groups[name]['right']['hits']} of {groups[name]['right']['of']}" in readme


@pytest.mark.parametrize("folder", EARLIER, ids=lambda each: each.name)
def test_earlier_trials_are_told_as_they_were(folder):
    record = json.loads((folder / "trial.json").read_text(encoding="utf-8"))
    assert str(record["seed"]) == folder.name
    assert digest((folder / "answers.json").read_bytes()) == record["answers_sha256"]
    total = marking.summary(record["marks"])
    right = sum(group["right"]["hits"] for group in total["groups"].values())
    assert total["groups"] == record["summary"]["groups"]
    row = next(
        each for each in (TRIAL / "README.md").read_text("utf-8").splitlines() if each.startswith(f"| {folder.name} |")
    )
    assert f"| {right} of {len(record['marks'])} |" in row
    assert f"| {total['no_answer']['hits']} |" in row


@pytest.mark.parametrize("folder", sorted((TRIAL / "nulls").iterdir()), ids=lambda each: each.name)
def test_false_alarms_are_told_as_they_were(folder):
    record = json.loads((folder / "trial.json").read_text(encoding="utf-8"))
    alarms = record["summary"]["false_alarms"]
    claim = f"{alarms['hits']} of {alarms['of']}"
    assert f"False alarms in {claim}" in (TRIAL / "README.md").read_text(encoding="utf-8")
    assert f"{claim} in [another]" in (ROOT / "README.md").read_text(encoding="utf-8")
    # the bound on one side: none in n, by a rate that gives as little once in twenty
    assert alarms["hits"] == 0 and 1.0 - 0.05 ** (1.0 / alarms["of"]) < 0.01


@pytest.mark.parametrize(
    "folder",
    [*sorted((TRIAL / "one-body").iterdir()), *sorted((TRIAL / "nulls").iterdir())],
    ids=lambda each: f"{each.parent.name} {each.name}",
)
def test_trials_of_single_bodies_and_of_nulls_are_told_as_they_were(folder):
    record = json.loads((folder / "trial.json").read_text(encoding="utf-8"))
    page = (TRIAL / "README.md").read_text(encoding="utf-8")
    single = folder.parent.name == "one-body"
    assert (record.get("rig") == "one-body") == single
    assert str(record["seed"]) == folder.name and f"{'Seed' if single else '--seed'} {folder.name}" in page
    assert (
        digest((folder / "answers.json").read_bytes()) == record["answers_sha256"] and record["answers_sha256"] in page
    )
    total = json.loads(json.dumps(marking.summary(record["marks"])))
    assert total == record["summary"]
    for name, group in total["groups"].items():
        right, named = group["right"], group["named"]
        assert f"| {name} | {right['of']} | {right['hits']} | {named['hits']} | {group['seconds_median']:.0f} |" in page


def test_detection_curves_are_told_as_they_were():
    page, marks = (TRIAL / "README.md").read_text(encoding="utf-8"), []
    for folder in sorted((TRIAL / "curves").iterdir()):
        record = json.loads((folder / "trial.json").read_text(encoding="utf-8"))
        assert str(record["seed"]) == folder.name and f"--curves --seed {folder.name}" in page
        assert digest((folder / "answers.json").read_bytes()) == record["answers_sha256"]
        assert record["answers_sha256"] in page
        assert json.loads(json.dumps(detection_curves(record["marks"]))) == record["curves"]
        marks += record["marks"]
    assert table(detection_curves(marks)) in page
    falsely = sum(bool(mark["false"]) for mark in marks)
    assert f"In {falsely} of {len(marks)} campaigns" in page


@pytest.mark.slow
def test_the_seed_gives_these_campaigns(record, answers):
    """Another processor may round the last digit otherwise, so samples are compared by what is missing in them."""
    planned = plan(record["seed"], record["campaigns"])
    assert [each.group for each in planned] == [each["group"] for each in answers]
    for i in (0, 21, 44):
        made = make_campaign(record["seed"], i, planned[i]).answer
        assert made["missing"] == pytest.approx(answers[i]["missing"], rel=1e-6)
        assert made["true"] == pytest.approx(answers[i]["true"], rel=1e-12)
        for mine, published in zip(made["mechanisms"], answers[i]["mechanisms"], strict=True):
            assert mine["equation"] == published["equation"]
            assert mine["parameters"] == pytest.approx(published["parameters"], rel=1e-12)


def test_the_alternatives_are_told_as_they_were():
    pytest.importorskip("pysindy")
    from benchmarks.alternatives import tables

    page = (TRIAL / "README.md").read_text(encoding="utf-8")
    told = re.search(r"On the trial of seed (\d+) \(\[rows\]\((.*alternatives.json)\)\)", page)
    assert told is not None
    compared = json.loads((TRIAL / told[2]).read_text(encoding="utf-8"))
    trial = json.loads((TRIAL / told[2]).with_name("trial.json").read_text(encoding="utf-8"))
    assert str(trial["seed"]) == told[1]
    assert compared["trial"]["answers_sha256"] == trial["answers_sha256"]
    for line in tables.table(compared).splitlines():
        assert line in page
