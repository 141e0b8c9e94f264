"""A trial goes on where it was ended, and what was changed in between is caught."""

import json
import os
import shutil
import subprocess
import sys
import time

import pytest

from drillenv.blind import trial
from drillenv.blind.seal import digest
from drillenv.checks import InputError

pytestmark = pytest.mark.slow  # each makes campaigns

REPORT = {
    "verdict": "agrees",
    "where": {"summary": "Nothing."},
    "findings": [],
    "parameters": {},
    "fit": {"noise_floor": 1.0, "fitted": {"before": 1.0, "after": 1.0}, "held_out": {"before": 1.0, "after": 1.0}},
}


def pretended(calls):
    """In place of a diagnosis: always the same report."""

    def diagnose(name, files, folder, limit):
        calls.append(name)
        report = json.dumps(REPORT).encode()
        outcome = {"status": "answered", "seconds": 1.0, "clock_seconds": 1.0, "memory_mib": 1.0}
        outcome |= {"sha256": digest(report), "said": ""}
        return name, {"report.json": report, "outcome.json": json.dumps(outcome).encode()}

    return diagnose


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A trial of two campaigns with pretended diagnoses, and what it returned."""
    place, calls = tmp_path_factory.mktemp("trial") / "t", []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trial, "diagnose_files", pretended(calls))
        record = trial.prove(place, seed=5, campaigns=2, jobs=1)
    assert sorted(calls) == ["c0001", "c0002"]
    return place, record


@pytest.fixture
def copied(finished, tmp_path):
    place = tmp_path / "t"
    shutil.copytree(finished[0], place)
    os.chmod(place / "answers.json", 0o600)
    return place


def test_answers_are_sealed_before_the_first_diagnosis(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(trial, "diagnose_files", pretended(said))
    trial.prove(tmp_path / "t", seed=3, campaigns=1, jobs=1, note=said.append)
    hashed = next(i for i, text in enumerate(said) if text.startswith("answers sealed: SHA-256"))
    assert hashed < said.index("c0001")
    assert said[hashed].split()[-1] == digest((tmp_path / "t" / "answers.json").read_bytes())


def test_the_same_seed_gives_the_same_campaigns_and_marks(finished, copied, monkeypatch):
    monkeypatch.setattr(trial, "diagnose_files", pretended([]))
    trial.check_trial(copied, again=1, jobs=1)
    assert json.loads((copied / "trial.json").read_text())["answers_sha256"] == finished[1]["answers_sha256"]


def test_goes_on_where_it_was_ended(copied, monkeypatch):
    calls = []
    monkeypatch.setattr(trial, "diagnose_files", pretended(calls))
    # a diagnosis that was killed has left files, but not its outcome, which is written last
    (copied / "reports" / "c0002" / "outcome.json").unlink()
    trial.prove(copied, seed=5, campaigns=2, jobs=1)
    assert calls == ["c0002"]


def test_another_trial_does_not_mix_with_it(copied):
    with pytest.raises(InputError, match="holds a trial with seed 5"):
        trial.prove(copied, seed=6, campaigns=2)


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="exists and holds no trial"):
        trial.prove(tmp_path, seed=6, campaigns=2)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_changed_answers_are_caught(copied):
    path = copied / "answers.json"
    changed = path.read_text().replace('"indenter_mass": 3.', '"indenter_mass": 4.', 1).replace("2.9", "2.8", 1)
    path.write_text(changed)
    with pytest.raises(InputError, match="answers were changed"):
        trial.mark_trial(copied)


def test_answers_that_were_sealed_anew_are_caught(copied):
    path = copied / "answers.json"
    answers = json.loads(path.read_text())
    answers[0]["verdict"] = "unexplained"
    data = (json.dumps(answers, indent=1) + "\n").encode()
    path.write_bytes(data)
    (copied / "seal.json").write_text(json.dumps({"sha256": digest(data)}))
    (copied / "trial.json").write_text(json.dumps(trial.mark_trial(copied)))
    with pytest.raises(InputError, match="not those of seed 5"):
        trial.check_trial(copied, jobs=1)


def test_a_changed_campaign_is_caught(copied):
    path = copied / "campaigns" / "c0001" / "campaign.json"
    path.write_text(path.read_text().replace("265.0", "266.0"))
    with pytest.raises(InputError, match="campaign c0001 was changed"):
        trial.mark_trial(copied)


def test_a_forged_verdict_is_caught(copied):
    path = copied / "reports" / "c0001" / "report.json"
    path.write_text(path.read_text().replace("agrees", "unexplained"))
    with pytest.raises(InputError, match="was changed after the diagnosis"):
        trial.mark_trial(copied)


def test_a_forged_verdict_with_a_forged_digest_is_caught(copied, monkeypatch):
    path = copied / "reports" / "c0001" / "report.json"
    path.write_text(path.read_text().replace("agrees", "unexplained"))
    outcome = copied / "reports" / "c0001" / "outcome.json"
    outcome.write_text(json.dumps(json.loads(outcome.read_text()) | {"sha256": digest(path.read_bytes())}))
    (copied / "trial.json").write_text(json.dumps(trial.mark_trial(copied)))
    monkeypatch.setattr(trial, "diagnose_files", pretended([]))
    with pytest.raises(InputError, match="the diagnosis of c0001 now says something else"):
        trial.check_trial(copied, again=1, jobs=1)


def test_a_forged_mark_is_caught(copied):
    path = copied / "trial.json"
    record = json.loads(path.read_text())
    record["marks"][0]["right"] = not record["marks"][0]["right"]
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match="does not say what the reports come to"):
        trial.check_trial(copied, jobs=1)


def campaign_files(finished):
    return {path.name: path.read_bytes() for path in (finished[0] / "campaigns" / "c0001").iterdir()}


def test_a_diagnosis_that_peeks_has_given_no_answer(finished, monkeypatch, tmp_path):
    """The very process of a trial, with the trial's folder where the numerical libraries are."""
    site = os.path.dirname(os.path.dirname(sys.modules["numpy"].__file__))
    _, files = trial.diagnose_files("c0001", campaign_files(finished), site, 100.0)
    outcome = json.loads(files["outcome.json"])
    assert outcome["status"] == "peeked"
    assert outcome["sha256"] is None


def test_a_diagnosis_past_its_time_has_given_no_answer(finished):
    begin = time.monotonic()
    _, files = trial.diagnose_files("c0001", campaign_files(finished), str(finished[0]), 1.0)
    assert json.loads(files["outcome.json"])["status"] == "out of time"
    assert time.monotonic() - begin < 60.0


def test_a_campaign_that_cannot_be_read_is_refused_and_kept(finished):
    _, files = trial.diagnose_files("c0001", {"campaign.json": b"{}"}, str(finished[0]), 100.0)
    outcome = json.loads(files["outcome.json"])
    assert outcome["status"] == "refused"
    assert "drillenv:" in outcome["said"]


@pytest.mark.slow
def test_the_command(tmp_path):
    """A whole trial of one campaign by the command, and the check of it."""
    command = [sys.executable, "-m", "drillenv.cli", "prove", "--out", str(tmp_path / "t")]
    # one in which nothing is missing is diagnosed soonest
    given = ["--seed", "6", "--campaigns", "1", "--nulls"]
    subprocess.run([*command, *given], check=True, capture_output=True, cwd=tmp_path)
    record = json.loads((tmp_path / "t" / "trial.json").read_text())
    assert [each["status"] for each in record["marks"]] == ["answered"]
    assert record["answers_sha256"] in (tmp_path / "t" / "trial.html").read_text()
    done = subprocess.run([*command, "--check", "1"], check=True, capture_output=True, text=True, cwd=tmp_path)
    assert "is what its seed and the diagnosis give" in done.stdout


def test_kinds_of_trials(tmp_path):
    for given, message in (({"kind": "all"}, "kind"), ({"kind": "nulls", "rig": "one-body"}, "leave out one of rig")):
        with pytest.raises(InputError, match=message) as caught:
            trial.prove(tmp_path / "t", seed=5, campaigns=2, **given)
        assert "\n" not in str(caught.value)
