"""What a laboratory would do in place of a diagnosis: it must not be held back by faults of ours."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pysindy")
pytest.importorskip("sklearn")

from benchmarks.alternatives import __main__ as command
from benchmarks.alternatives import comparing, unnamed
from benchmarks.alternatives.candidates import candidates, forces_of, of_motion
from benchmarks.alternatives.comparing import CONSTANTS, DIAGNOSIS, METHODS, PROCESS, SPARSE, Answer, unit_of
from benchmarks.alternatives.following import Motion, fitted_constants, followed, prepared
from benchmarks.alternatives.sparse import PATHS, Settings, parts_of, select, sparse_regression
from benchmarks.alternatives.tables import by_group, by_method, false_alarms, mechanisms_named, table, within_noise
from drillenv.blind.campaigns import physics_of, plain_campaign
from drillenv.blind.mechanisms import of_library
from drillenv.blind.rig import DRIVE_AT_ZERO, DRIVE_PER_HERTZ, PUSH_PER_BAR, Constants, Controls, move
from drillenv.checks import InputError
from drillenv.dynamics.effects import LIBRARY, make
from drillenv.recordings import write_campaign

RATE = 12800.0
FINE = 8
"""Steps of the concealed rig between samples."""
NOISE = np.array([3.0, 1.2])
SETTINGS = ((60.0, 0.35, 0.8), (75.0, 0.5, 1.2), (90.0, 0.4, 1.0), (105.0, 0.55, 0.7), (118.0, 0.45, 1.3))
STRONG = {
    "contact-rate": {"chi": 1.2},
    "contact-power-law": {"n": 1.4},
    "contact-toe": {"h": 3e-5, "r": 0.1, "e": 0.5},
    "rock-compaction": {"soft": 0.4, "soft_n": 30.0},
    "stiffness-hardening": {"k3": 9e9},
    "damping-quadratic": {"c2": 1200.0},
    "guide-friction": {"fc1": 60.0},
    "indenter-friction": {"fc2": 60.0},
    "drive-harmonics": {"h2": 0.15, "phi2": 0.7, "h3": 0.1, "phi3": -1.0},
    "drive-droop": {"s": 1.0 / 150.0},
    "force-limit": {"F_max": 200.0},
    "air-spring": {"k_a": 1e5, "tau": 0.2},
    "backlash": {"g": 5e-4, "y0": -1e-4},
}


@dataclass
class Known:
    """A recording whose states are the true ones."""

    motion: Motion
    left: np.ndarray
    noise: np.ndarray
    lost_speed: tuple
    added: Any


def true_states(hidden, setting, rng):
    """A run of the concealed rig, with what the paper's model leaves at its true states."""
    constants, controls = Constants(), Controls(*setting)
    run = move(constants, controls, physics_of(hidden, constants, controls, rng), 0.5, 1.0 / RATE / FINE, lead=0.6)
    run = run._replace(**{name: getattr(run, name)[::FINE] for name in run._fields})
    k, c = constants.stiffness, constants.damping
    m1, m2 = constants.shaker_mass, constants.indenter_mass
    loading, unloading = run.regime == 1, run.regime == 2
    rock = run.depth * (constants.loading_stiffness * loading + constants.unloading_stiffness * unloading)
    rock = np.maximum(rock, 0.0)
    drive = constants.drive_gain * (DRIVE_PER_HERTZ * controls.frequency + DRIVE_AT_ZERO) * controls.amplitude
    static = constants.pressure_gain * PUSH_PER_BAR * controls.pressure
    v1 = run.v2 + run.closing
    motion = Motion(
        RATE, controls.frequency, run.shortening, v1, run.v2, rock, loading, run.theta, run.impacts, drive, static,
        (m1, m2), k, c, constants.loading_stiffness, constants.unloading_stiffness,
    )  # fmt: skip
    coupling = k * run.shortening + c * run.closing
    left = np.stack([run.rock - rock, run.acceleration - (drive * np.sin(run.theta) + coupling - rock) / m2])
    at = np.arange(0, run.time.size, round(RATE / controls.frequency))
    impulse = m1 * (v1 - v1[0]) - np.cumsum(static - coupling) / RATE
    speed = impulse[at] / m1 + 1e-4 * rng.standard_normal(at.size)
    left = left + NOISE[:, None] * rng.standard_normal(left.shape)
    return Known(motion, left, NOISE, (at, speed), run)


@pytest.mark.parametrize("name", STRONG)
def test_candidates_are_the_forces_of_the_concealed_rig(name):
    hidden = (of_library(name, **STRONG[name]),)
    known = true_states(hidden, (90.0, 0.5, 0.9), np.random.default_rng(0))
    p = tuple(STRONG[name].get(each.symbol, each.neutral) for each in LIBRARY[name].parameters)
    ours, run = forces_of(name, p, known.motion), known.added
    expected = {
        "rock": run.contact_added,
        "indenter": run.indenter_added + run.coupling_added,
        "shaker": run.shaker_added - run.coupling_added,
    }
    size = max(np.std(each) + abs(np.mean(each)) for each in expected.values())
    assert size > 0.5  # N: it acts at all
    # what the cylinder had lost before the first sample is not known, and is restored
    restored = np.exp(-run.time / STRONG["air-spring"]["tau"]) * (name == "air-spring")
    for balance, force in expected.items():
        off = getattr(ours, balance) - force
        off = off - off[0] * restored
        assert np.sqrt(np.mean(off**2)) < 0.1 * size, balance


def test_the_face_of_a_mounted_rock_goes_back_as_that_of_the_concealed_rig():
    values = {"s_r": 2e-8, "m_r": 40.0, "zeta_r": 0.1}
    known = true_states((of_library("rock-mount-compliance", **values),), (90.0, 0.5, 0.9), np.random.default_rng(0))
    motion, face = known.motion, known.added.face
    touching = motion.rock > 0.0
    began = np.maximum.accumulate(np.where(touching & ~np.roll(touching, 1), np.arange(touching.size), 0))
    expected = -(face - face[began]) * np.where(motion.loading, motion.kl, motion.ku) * touching
    ours = forces_of("rock-mount-compliance", make("rock-mount-compliance", **values).values, motion).rock
    assert np.std(ours - expected) < 0.1 * np.std(expected)


def _selected(hidden, seed, settings):
    rng = np.random.default_rng(seed)
    recordings = [true_states(hidden, setting, rng) for setting in SETTINGS]
    columns = [of_motion(each.motion) for each in recordings]
    parts = [part for i, each in enumerate(recordings) for part in parts_of(i, each, columns[i])]
    return select(parts, columns[0], settings, rng)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["contact-rate", "damping-quadratic", "indenter-friction", "guide-friction"])
def test_a_strong_mechanism_is_named_where_the_states_are_true(name):
    assert _selected((of_library(name, **STRONG[name]),), 1, Settings()).named == [name]


@pytest.mark.slow
@pytest.mark.parametrize("optimiser", PATHS)
def test_every_optimiser_finds_a_force_limit(optimiser):
    settings = Settings(optimiser=optimiser, one_shape=True, draws=5)
    assert "force-limit" in _selected((of_library("force-limit", F_max=200.0),), 2, settings).named


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_missing():
    assert _selected((), 3, Settings()).named == []


def _on_recordings(folder, hidden, seed):
    made = plain_campaign(np.random.default_rng(seed), hidden=hidden, recordings=6, seconds=0.3, rate=12800.0)
    campaign = made.campaign
    write_campaign(folder, campaign.title, campaign.rig, campaign.nominal, campaign.recordings)
    return made


@pytest.mark.slow
def test_on_recordings_a_strong_damper_is_named_and_both_corrections_help(tmp_path):
    _on_recordings(tmp_path / "campaign", (of_library("damping-quadratic", c2=1500.0),), 11)
    rng = np.random.default_rng(0)
    split = prepared(tmp_path / "campaign")
    with ThreadPoolExecutor(1) as pool:
        fitted = fitted_constants(split, pool)
        known, held = followed(split.fitted, fitted, pool, known=True), followed(split.held, fitted, pool)
    begun = comparing.Begun(fitted, known, held)
    found, error = comparing.by_sparse_regression(begun, rng)
    plain = comparing.corrected(held, [np.zeros_like(each.left) for each in held])
    assert plain > 1.03
    assert "damping-quadratic" in found.named
    assert error < plain
    model = unnamed.learned(known, "gaussian process", rng)
    assert comparing.corrected(held, [unnamed.correction(model, each) for each in held]) < plain
    again = sparse_regression(known, [candidates(each) for each in known], Settings(), np.random.default_rng(0))
    assert again.named == found.named


@pytest.mark.slow
def test_the_alternatives_of_a_campaign_are_marked_by_the_rules_of_the_trial(tmp_path):
    made = _on_recordings(tmp_path / "campaign", (), 12)
    answer = dict(made.answer, group="null")
    mark = _mark("c0001", "null", {}, [], [], True, 1.0) | {"fit": None}
    row = comparing.compared(tmp_path / "campaign", mark, answer, 0)
    assert row["refused"] is None
    assert row["scale"] == 1.0
    assert row["answers"][SPARSE]["named"]
    assert row["answers"][SPARSE]["findings"] == []
    assert all(0.9 < row["answers"][name]["error"] < 1.15 for name in METHODS if name != DIAGNOSIS)
    missing = comparing.compared(tmp_path / "nowhere", mark, answer, 0)
    assert missing["refused"]
    assert missing["answers"][CONSTANTS]["error"] is None


def test_errors_are_in_the_unit_of_the_report():
    assert unit_of(2.0, 1.6) == pytest.approx(1.25)
    assert unit_of(None, 1.6) == 1.0
    assert unit_of(2.0, math.inf) == 1.0


# --- Tables and the command


def _mark(campaign, group, fates, findings, false, named, error):
    return {
        "campaign": campaign,
        "group": group,
        "truth": list(fates),
        "mechanisms": fates,
        "findings": findings,
        "false": false,
        "named": named,
        "seconds": 20.0,
        "fit": {"held_out": {"recordings": ["r03"], "before": error, "after": error}},
    }


def _row(campaign, group, diagnosis, sparse, constants):
    """A row with the fates, findings, false ones and errors of the methods that name."""
    answers = {name: vars(Answer(10.0, constants)) for name in METHODS}
    for name, (fates, findings, false, error) in {DIAGNOSIS: diagnosis, SPARSE: sparse}.items():
        right = not false and all(fate == "named" for fate in fates.values())
        answers[name] = vars(Answer(20.0, error, right, fates, findings, false))
    return {"campaign": campaign, "group": group, "truth": [], "refused": None, "scale": 1.0, "answers": answers}


ROWS = [
    _row("c0001", "null", ({}, [], [], 1.0), ({}, ["backlash"], ["backlash"], 1.02), 1.01),
    _row("c0002", "two", ({"a": "named", "b": "named"}, ["a", "b"], [], 1.0),
         ({"a": "named", "b": "something else"}, ["a", "c"], ["c"], 1.5), 1.05),
    _row("c0003", "two", ({"a": "named", "b": "not seen"}, ["a"], [], 1.2),
         ({"a": "in a class", "b": "something else"}, ["a", "c"], ["c"], 2.5), 4.0),
    _row("c0004", "outside", ({"o": "unexplained"}, [], [], None), ({"o": "something else"}, ["c"], ["c"], 3.0), 5.0),
]  # fmt: skip


def test_counts_of_a_record_made_by_hand():
    assert mechanisms_named(ROWS, DIAGNOSIS) == (3, 4)
    assert mechanisms_named(ROWS, SPARSE) == (2, 4)
    assert false_alarms(ROWS, DIAGNOSIS) == (0, 1)
    assert false_alarms(ROWS, SPARSE) == (1, 1)
    # the campaign of which the diagnosis predicts nothing is no campaign to compare errors on
    assert within_noise(ROWS, CONSTANTS) == (2, 3)
    assert within_noise(ROWS, CONSTANTS, missing=True) == (1, 2)
    lines = by_method(ROWS)
    assert lines[2] == f"| {DIAGNOSIS} | 3 of 4 | 2 of 4 | 0 of 1 | 0 of 4 | 1.00 | 2 of 3 | 1 | 20 |"
    assert lines[5] == f"| {SPARSE} | 2 of 4 | 0 of 4 | 1 of 1 | 4 of 4 | 1.50 | 1 of 3 | 0 | 20 |"
    assert lines[6].startswith(f"| {PROCESS} |  |  |  |  | 1.05 |")
    assert by_group(ROWS)[3] == "| two | 2 | 3, 2 of 4 | 1, 0 | 0, 2 | 1.10, 2.52, 2.00, 2.52 |"
    assert table({"rows": ROWS}).count("\n") == 2 + 5 + 1 + 2 + 3


@pytest.fixture
def trial(monkeypatch, tmp_path):
    """A finished trial of two campaigns, with the command's look at it, and the campaigns compared so far."""
    marks = [_mark(name, "null", {}, [], [], True, 1.0) for name in ("c0001", "c0002")]
    record = {"seed": 1, "campaigns": 2, "limit": 300.0, "version": "1", "answers_sha256": "abc", "marks": marks}
    done = []

    def compare(folder, mark, answer, seed):
        if len(done) == 1 and done != ["interrupt"]:
            done[:] = ["interrupt"]
            raise KeyboardInterrupt
        done.append(folder.name)
        return _row(mark["campaign"], mark["group"], ({}, [], [], 1.0), ({}, [], [], 1.0), 1.0)

    (tmp_path / "plan.json").touch()
    monkeypatch.setattr(command, "mark_trial", lambda place: record)
    monkeypatch.setattr(command, "unseal", lambda place, sha: [{"campaign": each["campaign"]} for each in marks])
    monkeypatch.setattr(command, "compared", compare)
    return SimpleNamespace(place=tmp_path, out=tmp_path / "out.json", record=record, done=done)


def test_a_run_that_was_stopped_goes_on(trial):
    with pytest.raises(KeyboardInterrupt):
        command.run(trial.place, trial.out)
    assert [row["campaign"] for row in json.loads(trial.out.read_text())["rows"]] == ["c0001"]
    record = command.run(trial.place, trial.out)
    assert trial.done == ["interrupt", "c0002"]  # the first is not made again
    assert [row["campaign"] for row in record["rows"]] == ["c0001", "c0002"]
    assert json.loads(trial.out.read_text()) == json.loads(json.dumps(record))


def test_a_record_of_something_else_is_refused(trial):
    trial.out.write_text('{"rows": []}')
    with pytest.raises(InputError, match="another trial"):
        command.run(trial.place, trial.out)
    trial.out.write_text("[]")
    with pytest.raises(InputError, match="no record of alternatives"):
        command.run(trial.place, trial.out)
    with pytest.raises(InputError, match="holds no trial"):
        command.run(trial.place / "nowhere", trial.out)
    trial.record["rig"] = "one-body"
    with pytest.raises(InputError, match="percussive-drill"):
        command.run(trial.place, trial.out)
