"""Searches that are restricted or interrupted say so, and claim nothing of what they did not look for."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import jsonschema
import numpy as np
import pytest

from drillenv import cli, diagnose
from drillenv.checks import InputError
from drillenv.diagnosis import drill_diagnosis
from drillenv.diagnosis.drill_diagnosis import Outcome, Proof
from drillenv.diagnosis.drill_identification import mechanisms_of
from drillenv.diagnosis.drill_report import where
from drillenv.diagnosis.evidence import cell
from drillenv.diagnosis.laws import families
from drillenv.diagnosis.page import sentence
from drillenv.diagnosis.progress import EXTENDING, FITTING, PROVING, SEARCHING, Known, OutOfTime, Progress, Timed, span
from drillenv.diagnosis.scope import bounded, limits_of, scope_of
from drillenv.diagnosis.sensing import ACCELEROMETER, sensor_families
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.recordings.document import DRILL

EXAMPLE = "docs/recordings/example"
AXES = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))
EVERY = [*families(AXES, [60.0, 80.0, 110.0]), *sensor_families(["r01"], 12e3)]


@pytest.mark.parametrize(
    ("only", "groups"),
    [
        ("contact", {"contact law", "contact speed", "compaction", "mount"}),
        ("contact-toe", {"contact law"}),
        ("shaker", {"guide", "air"}),
        ("damper", {"damper"}),
        ("accelerometer-lowpass", {ACCELEROMETER}),
        ("force-limit", {"drive", "slew rate", "spring"}),  # the drive's, and a spring's that saturates
    ],
)
def test_families_of_a_scope(only, groups):
    scope = scope_of([only], DRILL)
    assert {each.group for each in EVERY if scope.has(each, mechanisms_of(each))} == groups


def test_sensors_are_a_scope():
    scope = scope_of(["sensor"], DRILL)
    searched = {each.name for each in EVERY if scope.has(each, mechanisms_of(each))}
    assert searched == {each.name for each in sensor_families(["r01"], 12e3)}


def test_a_name_that_is_none_is_refused():
    assert scope_of([], DRILL) is None
    with pytest.raises(InputError, match="only names 'contact-to', which is none of the rig: did you mean contact-toe"):
        scope_of(["contact-to"], DRILL)
    with pytest.raises(InputError, match="only names 'viscous-damping'"):
        scope_of(["viscous-damping"], DRILL)
    assert scope_of(["viscous-damping"], "one-body") is not None


def test_what_is_said_of_a_restricted_search():
    record = {"verdict": "agrees", "where": {"summary": "Nothing is left."}, "parameters": {}, "remarks": []}
    assert bounded(record, [], "") == record
    assert limits_of(record) == ""
    said = bounded(record, ["contact", "sensor"], "fitting")
    assert said["where"]["summary"].startswith("Nothing but contact and sensor was looked for: what else may be")
    assert limits_of(said) == "only contact and sensor looked for, unfinished"
    assert sentence(said).startswith("Only contact and sensor looked for, unfinished. As far as that goes: ")


def test_stages_say_how_long_they_may_take():
    now, said = iter([0.0, 10.0]), []
    progress = Progress(said.append, clock=lambda: next(now))
    progress.stage(FITTING)
    progress.stage(SEARCHING)
    progress.stage(EXTENDING)
    assert said[0] == "stage 1 of 5: fitting the paper's model"
    assert said[1].startswith("stage 2 of 5: looking for what is missing; about ")
    assert f"{10.0 * EXTENDING.most / 60.0:.1g} min to go" in said[2]
    assert [span(0.0, 1.0), span(2.0, 50.0), span(5.0, 90.0), span(170.0, 2410.0)] == [
        "about 1 to 2 s", "about 2 to 50 s", "about 0.1 to 2 min", "about 3 to 40 min",
    ]  # fmt: skip


@pytest.mark.slow
def test_nothing_else_is_looked_for(schema):
    """The example's rock resists fast blows: springs do not explain that, and that is not said to be all."""
    report = diagnose(EXAMPLE, only=["stiffness-hardening"])
    assert report.verdict == "unexplained"
    assert report.record["only"] == ["stiffness-hardening"]
    assert "only stiffness-hardening looked for" in report.text()
    assert {each["mechanism"] for each in report.record["rejected"] if "another" not in each["mechanism"]} <= {
        "stiffness-hardening",
        "force-limit",
    }
    jsonschema.validate(report.record, schema)


def test_what_does_worse_than_nothing_is_refuted(monkeypatch):
    """On recordings that were not fitted, as of a search that ended before its time; of one not followed nothing is."""
    chi_squares: Any = {"before": 8.1, "near": 1.3, "worse": 58.8, "lost": math.inf}
    monkeypatch.setattr(drill_diagnosis, "chi_square", lambda estimates: chi_squares[estimates])
    refuted = {name: Proof("before", name, "recordings held out").is_refuted for name in chi_squares}  # type: ignore[arg-type]
    assert refuted == {"before": False, "near": False, "worse": True, "lost": False}
    assert not Proof([], [], "the one recording").is_refuted


def test_what_was_refuted_is_said():
    explained: Any = SimpleNamespace(of="recordings held out")
    outcome = Outcome("unexplained", [], *[None] * 2, [], *[None] * 2, explained, [], refuted=["air-spring"])  # type: ignore[arg-type]
    text = where(outcome, [cell("r01", "force", "loading", np.full(40, 9.0))])["summary"]
    assert text == (
        "Most of what is left is in the force, loading. What was found, air-spring, makes recordings held out worse "
        "than they are without, and is left out."
    )


def test_an_interruption_of_a_second_search_keeps_the_first(monkeypatch):
    """The one without a recording that disagrees with all others, before anything is known of it."""
    first: Any = Outcome("unexplained", [], *[None] * 6, [])  # type: ignore[arg-type]
    searches = iter([first])

    def search(*_, **__):
        for each in searches:
            return each
        raise KeyboardInterrupt

    monkeypatch.setattr(drill_diagnosis, "search", search)
    monkeypatch.setattr(drill_diagnosis, "outlying_recording", lambda _outcome: "r03")
    monkeypatch.setattr(drill_diagnosis, "with_labels_corrected", lambda campaign: (campaign, []))
    campaign: Any = Made(())
    ended = drill_diagnosis.diagnose_drill(campaign, interruptible=True)
    assert ended.verdict == "unexplained" and ended.stopped == "looking once more without r03"
    searches = iter([first])
    with pytest.raises(KeyboardInterrupt):
        drill_diagnosis.diagnose_drill(campaign)


@pytest.mark.parametrize("more", [False, True])
def test_an_interruption_keeps_what_whole_recordings_have_told(monkeypatch, more):
    """What the search on stretches has found is held to whole recordings, and what is found there is not lost."""
    begun, whole, final = Model(1.03), Model(1.07), Model(1.01)
    steps: Any = ["step"]
    searches = []

    def forward(fitted, _say, before=(), _earlier=None, keep=lambda *_: None):
        searches.append(fitted)
        if fitted is whole:
            if more:
                keep(final, steps, None)
            raise OutOfTime
        return fitted, list(before), None

    monkeypatch.setattr(drill_diagnosis, "plain_fit", lambda *_: begun)
    monkeypatch.setattr(drill_diagnosis, "extended", lambda *_: whole)
    monkeypatch.setattr(drill_diagnosis, "forward", forward)
    progress, campaign = Progress(lambda _text: None), cast("Any", Made())
    with ThreadPoolExecutor(1) as pool, pytest.raises(OutOfTime):
        drill_diagnosis.selected(campaign, [], pool, progress)
    assert searches == [begun, whole]
    assert progress.known == Known(whole, *((final, steps) if more else (whole, [])), None)  # type: ignore[arg-type]


@dataclass
class Made:
    """As much of a campaign, or of a model's structure, as is looked at."""

    recordings: tuple = ()
    scope: Any = None


@dataclass
class Model:
    """As much of a fit as is looked at."""

    reduced_chi_square: float
    structure: Any = field(default_factory=Made)


def test_a_search_ends_in_time_once_something_is_known():
    said, now = [], [0.0]
    progress = Progress(said.append, 5.0, processor=lambda: now[0])
    progress.stage(FITTING)
    now[0] = 6.0
    progress.say("nothing is known yet")
    progress.known = cast("Known", object())
    with pytest.raises(OutOfTime):
        progress.say("a step further")
    progress.stage(PROVING)
    progress.say("what was found is held against recordings held out")
    assert len(said) == 5


def test_a_fit_ends_between_two_evaluations_once_time_is_up():
    now = [0.0]
    progress = Progress(lambda text: None, 5.0, processor=lambda: now[0])
    with ThreadPoolExecutor(1) as pool:
        timed = Timed(pool, progress)
        progress.stage(SEARCHING)
        progress.known = cast("Known", object())
        assert list(timed.map(abs, [-1, 2])) == [1, 2]
        now[0] = 6.0
        with pytest.raises(OutOfTime):
            list(timed.map(abs, [-1]))
        now[0] = 0.0
        evaluated = timed.map(lambda at: now.__setitem__(0, at), [6.0, 7.0])
        with pytest.raises(OutOfTime):
            list(evaluated)
        assert now[0] == 6.0
        progress.stage(PROVING)
        assert list(timed.map(abs, [-1])) == [1]


@pytest.mark.slow
def test_what_was_found_in_time_is_reported(tmp_path, capsys, monkeypatch, schema):
    """Held against stretches of recordings held out that are no longer than those that were fitted."""
    proved, lengths = drill_diagnosis.proved, []

    def noted(fitted, held, *more):
        lengths.extend([{len(each.starts) - 1 for each in data} for data in (fitted, held)])
        return proved(fitted, held, *more)

    monkeypatch.setattr(drill_diagnosis, "proved", noted)
    assert cli.main(["diagnose", EXAMPLE, "--within", "0", "--out", str(tmp_path)]) == 0
    assert "the report is unfinished" in capsys.readouterr().err
    record = json.loads((tmp_path / "report.json").read_text())
    jsonschema.validate(record, schema)
    assert record["unfinished"] == "looking for what is missing"
    assert record["verdict"] == "unexplained"
    assert lengths == [{drill_diagnosis.STRETCH}] * 2


@pytest.mark.slow
def test_an_interruption_keeps_what_is_known(tmp_path, capsys, monkeypatch, schema):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(drill_diagnosis, "extended", interrupted)
    assert cli.main(["diagnose", EXAMPLE, "--only", "contact", "--out", str(tmp_path)]) == 130
    printed = capsys.readouterr()
    lines = printed.err.splitlines()
    assert [each[:7] for each in lines[:-1]] == ["stage 1", "stage 2", "stage 3", "stage 5"]
    assert lines[-1] == "drillenv: ended while fitting whole recordings: the report is unfinished"
    record = json.loads((tmp_path / "report.json").read_text())
    jsonschema.validate(record, schema)
    assert record["unfinished"] == "fitting whole recordings"
    assert [each["mechanism"] for each in record["findings"]] == ["contact-rate"]
    assert "unfinished" in printed.out.splitlines()[0]
    with pytest.raises(KeyboardInterrupt):
        diagnose(EXAMPLE, only=["contact"])


@pytest.fixture
def schema():
    """Of report.json."""
    from importlib.resources import files

    return json.loads((files("drillenv.diagnosis") / "report.schema.json").read_text())
