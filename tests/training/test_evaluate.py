"""The league: its statistics, its measures, its conditions, and that its table is current."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drillenv import cli, controllers
from drillenv.checks import InputError
from drillenv.controllers.policies import SHIPPED, read_policy
from drillenv.env.episodes import rig_array
from drillenv.env.scenarios import read_scenario
from drillenv.env.truth import TRUTH, TRUTH_SIZE
from drillenv.rig import Rig
from drillenv.training import evaluate as league_command
from drillenv.training.conditions import CONDITIONS, condition, episodes_of, scenario_of, strata
from drillenv.training.evaluate import entries, evaluate, read_record, row_of, run_record, write_record
from drillenv.training.league import NEITHER, REPEATED, summary
from drillenv.training.league_figure import _colours
from drillenv.training.league_page import main as make_page
from drillenv.training.league_table import best_first, league_table, page_part, statement_text, write_table
from drillenv.training.measures import MEASURES, measures, recoveries
from drillenv.training.rollout import Rollout, rollout
from drillenv.training.statistics import chance, draws, interval, iqm, resampled

DOCS = Path(__file__).parents[2] / "docs" / "league"
TABLES = sorted(DOCS.glob("*.json"))
POLICIES = sorted(str(folder) for folder in (DOCS / "policies").glob("*"))


def runs_of(*scores):
    """Runs of a row with these scores (runs, episodes) and nothing else of interest."""
    return [
        {
            "seed": i,
            "policy": None,
            "episodes": {key: list(each) for key in MEASURES} | {"score": list(each)},
        }
        for i, each in enumerate(scores)
    ]


# --- Statistics


def test_the_interquartile_mean_is_that_of_the_middle_half():
    assert iqm(np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 1000.0]])) == 4.5
    # runs and episodes count alike
    assert iqm(np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 1000.0]])) == 4.5


def test_every_resample_has_each_stratum_as_often_as_the_episodes_have():
    levels = np.array([0, 0, 0, 1, 2, 2, 2, 2])
    drawn = draws(levels, 1, resamples=300)
    for row in levels[drawn.episodes]:
        np.testing.assert_array_equal(np.bincount(row), [3, 1, 4])
    # within a stratum all members come alike
    assert np.bincount(drawn.episodes[:, 4:].ravel(), minlength=8)[4:].min() > 240


def test_the_interval_covers_the_truth_as_often_as_it_says():
    # 1000 experiments of 60 episodes whose mean is 0; within the strata they differ by 1
    rng = np.random.default_rng(0)
    levels = np.arange(60) * 3 // 60
    covered = 0
    for _ in range(1000):
        scores = rng.standard_normal((1, 60)) + np.array([-3.0, 0.0, 3.0])[levels]
        found = resampled(scores, draws(levels, 1, resamples=300, seed=int(rng.integers(1e9))), mean=True)
        low, high = interval(0.0, found)[1:]
        covered += low <= 0.0 <= high
    # 95 %, less a little for strata of only 20 episodes; the standard deviation of the count is 0.7 %
    assert 0.915 < covered / 1000 < 0.97


def test_strata_take_what_differs_between_them_out_of_the_interval():
    rng = np.random.default_rng(1)
    levels = np.arange(60) * 3 // 60
    scores = rng.standard_normal((1, 60)) + np.array([-30.0, 0.0, 30.0])[levels]
    within = resampled(scores, draws(levels, 1, resamples=500), mean=True).std()
    without = resampled(scores, draws(np.zeros(60, dtype=int), 1, resamples=500), mean=True).std()
    assert within == pytest.approx(1.0 / math.sqrt(60), rel=0.25)
    assert without > 10.0 * within


def test_training_seeds_are_what_is_repeated():
    # five seeds that differ by far more than the episodes of each
    rng = np.random.default_rng(2)
    levels = np.array([0.6, 0.8, 1.0, 1.2, 1.4])
    scores = levels[:, None] + 1e-3 * rng.standard_normal((5, 40))
    spread = resampled(scores, draws(np.zeros(40, dtype=int), 5), mean=True).std()
    assert spread == pytest.approx(levels.std() / math.sqrt(5), rel=0.1)


def test_differences_are_of_pairs():
    # the same scores but for a constant: where resamples are of pairs, the difference has no spread
    rng = np.random.default_rng(3)
    one = rng.standard_normal((1, 30)) * 5.0
    drawn = draws(np.zeros(30, dtype=int), 1)
    np.testing.assert_allclose(resampled(one + 0.25, drawn) - resampled(one, drawn), 0.25, atol=1e-9)


def test_the_chance_of_being_better_counts_pairs_in_the_same_episode():
    one, other = np.array([[1.0, 5.0], [3.0, 2.0]]), np.array([[2.0, 2.0]])
    # run 0: loses, wins; run 1: wins, ties
    assert chance(one, other) == (0.0 + 1.0 + 1.0 + 0.5) / 4
    assert chance(other, one) == 1.0 - chance(one, other)


# --- Measures


def drilled(steps=20, **columns):
    """A rollout of one episode with these columns of the truth, the rest 0."""
    truths = np.zeros((1, steps, TRUTH_SIZE))
    for name, values in columns.items():
        truths[0, :, TRUTH.index(name)] = values
    return Rollout(np.ones((1, steps)), truths, np.zeros((1, steps, 3)), np.zeros((1, steps + 1, 15)))


def test_the_measures_are_what_they_say():
    excess = np.zeros(20)
    excess[[3, 7]] = 100.0, 10.0
    made = drilled(
        penetration_rate=2.0, drive_power=50.0, force_excess=excess, single_share=0.8, mean_peak_force=1500.0
    )
    found = {name: float(values[0]) for name, values in measures(made, 2000.0).items()}
    assert found["score"] == 1.0 and found["penetration_rate"] == 2.0
    assert found["energy"] == pytest.approx(25.0)  # 50 W over 2 mm/s
    assert found["violations"] == 1 / 20  # 10 N are in the noise of the load cell
    assert found["worst_excess"] == 100.0  # the worst of 20
    assert found["single_share"] == pytest.approx(0.8)
    assert math.isnan(found["recovery"])  # the rock never changed


def test_the_weak_single_blows_of_high_pressure_do_not_count():
    made = drilled(single_share=1.0, mean_peak_force=700.0)
    assert measures(made, 2000.0)["single_share"][0] == 0.0


def test_recovery_is_counted_from_the_change_to_the_first_of_two_good_intervals():
    #                  change at 3                        change at 8, not made good
    layers = np.array([0, 0, 0, 1, 1, 1, 1, 1, 2, 2, 2])
    single = np.array([1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0], dtype=float)
    taken, back = recoveries(single, layers)
    np.testing.assert_allclose(taken, [0.25 * 3, 0.25 * 3])
    np.testing.assert_array_equal(back, [True, False])


# --- Conditions


def test_wrong_constants_leave_the_rocks_and_move_the_rig():
    plain, once, thrice = (episodes_of(CONDITIONS[name]) for name in ("test", "constants", "constants-3"))
    exact = rig_array(Rig())
    for a, b, c in zip(plain, once, thrice, strict=True):
        np.testing.assert_array_equal(a.layers, b.layers)
        assert a.lag == b.lag == c.lag
        np.testing.assert_allclose(c.rig - exact, 3.0 * (b.rig - exact), rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(a.rig, exact)
        assert np.all(b.rig != exact)
    with scenario_of(CONDITIONS["constants"]) as file:
        read = read_scenario(file).episodes["layers"]
    for a, b in zip(read, once, strict=True):
        np.testing.assert_allclose(a.rig, b.rig, rtol=1e-5)
        np.testing.assert_allclose(a.layers[:, :3], b.layers[:, :3], rtol=1e-4)


def test_strata_are_thirds_by_stiffness():
    episodes = read_scenario("test").episodes["layers"]
    levels = strata(episodes)
    np.testing.assert_array_equal(np.bincount(levels), [20, 20, 20])

    def softness(episode):
        depth, below, total = 0.0, 0.0, 0.0
        for kl, _, end, _ in episode.layers:
            below, depth = depth, min(end, 0.12)
            total += (depth - below) * math.log(kl)
        return total

    values = np.array([softness(episode) for episode in episodes])
    assert values[levels == 0].max() <= values[levels == 1].min()
    assert values[levels == 1].max() <= values[levels == 2].min()


def test_an_episode_is_the_same_however_many_are_run():
    # common random numbers: noise and controller of episode i have the seed i
    few = rollout(lambda: controllers.make("seeking"), "DrillLayers", "validation", 2, 30, threads=1)
    more = rollout(lambda: controllers.make("seeking"), "DrillLayers", "validation", 4, 30, threads=1)
    np.testing.assert_array_equal(few.rewards, more.rewards[:2])


# --- The record


@pytest.fixture(scope="module")
def record():
    """Three cheap rows and the oracle, on two short episodes."""
    return evaluate(entries(["rules", "fixed"]), "validation", condition("validation"), 2, 12, threads=1)


def test_a_record_holds_what_each_controller_did(record):
    assert list(record["runs"]) == ["fixed", "rules", "oracle"]
    made = rollout(lambda: controllers.make("rules"), "DrillLayers", "validation", 2, 12, threads=1)
    assert record["runs"]["rules"][0]["episodes"]["score"] == made.scores.tolist()
    rows = record["summary"]["rows"]
    assert rows["oracle"]["share"] == [1.0, 1.0, 1.0]
    oracle = np.array(record["runs"]["oracle"][0]["episodes"]["score"])
    assert rows["rules"]["share"][0] == pytest.approx((made.scores / oracle).mean())
    assert record["summary"]["statement"] == {}


def test_rows_made_before_stay_and_another_condition_is_refused(record):
    more = evaluate(entries(["seeking"]), "validation", condition("validation"), 2, 12, kept=record, threads=1)
    assert list(more["runs"]) == ["fixed", "rules", "seeking", "oracle"]
    assert more["runs"]["rules"] == record["runs"]["rules"]
    with pytest.raises(InputError, match=r"the file of --json has episodes 2, not 1: give another file"):
        evaluate({}, "validation", condition("validation"), 1, 12, kept=record)


def test_the_record_is_saved_after_each_row():
    saved = []
    evaluate(entries(["fixed"]), "validation", condition("validation"), 1, 3, threads=1, save=saved.append)
    assert [list(each["runs"]) for each in saved] == [["oracle"], ["fixed", "oracle"]]


def test_the_table_goes_to_its_place_in_a_page_and_nothing_else_changes(record, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "before\n<!-- league validation -->\nold\n<!-- end league validation -->\nafter\n", encoding="utf-8"
    )
    write_table(page, record)
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n<!-- league validation -->\n2 episodes of 12 steps.")
    assert text.endswith("<!-- end league validation -->\nafter\n") and "old" not in text
    assert league_table(record) in text
    write_table(page, record)
    assert page.read_text(encoding="utf-8") == text
    other = tmp_path / "other.md"
    other.write_text("no place here\n", encoding="utf-8")
    with pytest.raises(InputError, match="has no line <!-- league validation -->"):
        write_table(other, record)
    assert other.read_text(encoding="utf-8") == "no place here\n"


def test_a_record_can_be_written_and_read(record, tmp_path):
    write_record(tmp_path / "record.json", record)
    assert read_record(tmp_path / "record.json") == json.loads(json.dumps(record))


def test_the_statement_needs_five_seeds_and_an_interval_above_zero():
    rng = np.random.default_rng(0)
    oracle = rng.uniform(1.5, 2.0, 40)
    rules = oracle * rng.normal(0.93, 0.01, 40)
    levels = np.zeros(40, dtype=int)

    def stated(level, seeds):
        learned = [oracle * rng.normal(level, 0.01, 40) for _ in range(seeds)]
        made = summary({"rules": runs_of(rules), "oracle": runs_of(oracle), "ppo-vine": runs_of(*learned)}, levels)
        return made["statement"]["ppo-vine"]

    good = stated(0.97, 5)
    assert good["beats"] == ["rules"] and good["loses_to"] == [] and good["reaches_enough"]
    value, low, high = good["differences"]["rules"]
    assert value == pytest.approx(0.04, abs=0.005) and low < value < high
    few = stated(0.97, 3)
    assert few["beats"] == [] and not few["reaches_enough"]
    level = stated(0.931, 5)
    assert level["beats"] == [] and level["loses_to"] == [] and not level["reaches_enough"]
    assert stated(0.90, 5)["loses_to"] == ["rules"]


def test_where_the_yardstick_does_not_know_the_plant_scores_are_compared():
    """It does badly in one episode, which is no merit of those who do not."""
    rng = np.random.default_rng(0)
    oracle = rng.uniform(1.5, 2.0, 40)
    oracle[:20] *= 0.1
    rules = np.full(40, 1.5) + rng.normal(0.0, 0.01, 40)
    learned = [rules + np.where(oracle < 0.5, -0.02, 0.1) + rng.normal(0.0, 0.01, 40) for _ in range(5)]
    runs = {"oracle": runs_of(oracle), "rules": runs_of(rules), "ppo-vine": runs_of(*learned)}
    by_score = summary(runs, np.zeros(40, dtype=int), "score")
    found = by_score["statement"]["ppo-vine"]
    assert found["beats"] == ["rules"] and found["differences"]["rules"][0] == pytest.approx(0.04, abs=0.005)
    assert best_first({"summary": by_score})[0] == "ppo-vine"
    text = statement_text({"summary": by_score})
    assert "of the oracle" not in text and "5 training seeds, scores 1.5" in text
    assert "it beats `rules` (+0.0" in text and text.endswith(
        "differences of the mean scores in mm/s, with 95 % intervals."
    )


@pytest.mark.parametrize(
    ("provenance", "row"),
    [
        ({"algorithm": "ppo", "ahead": 4}, "ppo-vine"),
        ({"algorithm": "ppo"}, "ppo"),
        ({"algorithm": "ppo-vine", "ahead": 4, "rig_errors": 3.0}, "ppo-vine-randomised"),
        ({"algorithm": "recurrent-ppo", "rig_errors": 1.0}, "recurrent-ppo-randomised"),
        ({"algorithm": "my own", "rig_errors": 3.0}, "my own-randomised"),
        ({"algorithm": "sac"}, "sac"),
        ({"algorithm": "behaviour cloning of mpc"}, "behaviour cloning of mpc"),
        ({}, "learned"),
        ({"algorithm": "rules"}, "learned"),
        ({"algorithm": "a|b"}, "learned"),
        ({"algorithm": "all\n"}, "learned"),
    ],
)
def test_the_row_of_a_policy_is_its_algorithm(provenance, row):
    policy = replace(read_policy(SHIPPED), environment="drillenv/DrillLayers-v0", provenance=provenance)
    assert row_of(policy) == row


def test_policies_of_hidden_rigs_have_a_row_of_their_own():
    said = {"algorithm": "ppo-vine", "ahead": 4, "rig_errors": 3.0}
    policy = replace(read_policy(SHIPPED), environment="drillenv/DrillHidden-v0", provenance=said)
    assert row_of(policy) == "ppo-vine-hidden"


def test_the_rows_that_neither_learn_nor_see_the_rock():
    blind = {name for name in controllers.NAMES if not controllers.sees_truth(controllers.make(name))}
    assert set(NEITHER) == blind - {"learned"}


def test_five_runs_of_a_row_of_ones_own_get_a_statement_too():
    rng = np.random.default_rng(0)
    oracle = rng.uniform(1.5, 2.0, 40)
    runs = {"oracle": runs_of(oracle), "rules": runs_of(0.9 * oracle), "mine": runs_of(*[0.95 * oracle] * 5)}
    made = summary({**runs, "one": runs_of(0.99 * oracle)}, np.zeros(40, dtype=int))
    assert set(made["statement"]) == {"mine"} and set(made["statement"]["mine"]["differences"]) == {"rules"}
    assert set(made["rows"]) == {"oracle", "rules", "mine", "one"}


def test_the_statement_in_words():
    differences = {"mpc": [-0.012, -0.016, -0.009], "rules": [0.001, -0.002, 0.004], "fixed": [0.3, 0.2, 0.4]}
    found = {
        "seeds": 5,
        "share": [0.97, 0.967, 0.974],
        "reaches_enough": True,
        "differences": differences,
        "beats": ["fixed"],
        "loses_to": ["mpc"],
    }
    assert statement_text({"summary": {"statement": {"ppo-vine": found}}}) == (
        "- `ppo-vine`, 5 training seeds, reaches 95 % of the oracle: 0.970 (0.967 to 0.974). Of those that neither "
        "learn nor see the rock it loses to `mpc` (-0.012, -0.016 to -0.009); it is not surely different from `rules` "
        "(+0.001, -0.002 to +0.004); it beats `fixed` (+0.300, +0.200 to +0.400): differences of the shares, with 95 % "
        "intervals."
    )


# --- The command


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--controllers", "ruels"], "controller is 'ruels': give one of random, fixed, rules"),
        (
            ["--controllers", "ppo-vine"],
            "controller ppo-vine needs trained policies: give their folders after --policies",
        ),
        (["--controllers", "rules", "--policies", "nowhere"], "policy file nowhere"),
        (["--controllers", "rules", "--scenario", "nowhere"], "scenario is 'nowhere': give one of train"),
        (
            ["--controllers", "rules", "--scenario", "test", "--environment", "Dril"],
            "environment is 'Dril': give one of",
        ),
        (["--controllers", "rules", "--episodes", "1000"], "episodes is 1000, outside 1 to 60"),
        (["--controllers", "rules", "--episodes", "many"], "argument --episodes: 'many' is not a whole number"),
        (["--controllers", "rules", "--steps", "0"], "steps is 0, outside 1 to 100000"),
        (["--controllers", "rules", "--threads", "0"], "threads is 0, outside 1 to 1024"),
        (["--controllers", "rules", "--json", "/nowhere/at/all.json"], "cannot write '/nowhere/at/all.json'"),
        (["--controllers", "rules", "--json", "BROKEN"], "is not JSON: give a file of the league, or another name"),
        (["--controllers", "rules", "--json", "OTHER"], "is not of the format drillenv-league/1"),
        (["--nonsense"], "unrecognized arguments: --nonsense"),
    ],
)
def test_bad_input_gets_one_line(arguments, said, tmp_path, capsys):
    files = {"BROKEN": "{", "OTHER": '{"format": "another"}'}
    for name, content in files.items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    given = [str(tmp_path / each) if each in files else each for each in arguments]
    assert cli.main(["league", *given]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("drillenv: ") and err.count("\n") == 1
    assert said in err


def test_the_command_writes_record_and_table(tmp_path, capsys):
    files = ["--json", str(tmp_path / "a.json"), "--table", str(tmp_path / "a.md")]
    few = ["--episodes", "1", "--steps", "3", "--threads", "1"]
    assert cli.main(["league", "--controllers", "fixed", "--scenario", "constants", *few, *files]) == 0
    record = read_record(tmp_path / "a.json")
    assert record["condition"] == "constants" and record["errors"] == 1.0
    assert (tmp_path / "a.md").read_text(encoding="utf-8") == page_part(record) + "\n"
    assert league_table(record) in capsys.readouterr().out


@pytest.mark.slow
def test_the_page_and_its_figure_are_made_by_one_command(tmp_path, capsys, monkeypatch):
    names = ("test", "constants")
    places = "".join(f"<!-- league {name} -->\n<!-- end league {name} -->\n" for name in names)
    (tmp_path / "README.md").write_text(places, encoding="utf-8")
    monkeypatch.setattr(league_command, "episodes_of", lambda chosen: episodes_of(chosen)[:1])
    monkeypatch.setitem(league_command.STEPS, "DrillLayers", 3)
    asked = ["--out", str(tmp_path), "--conditions", *names, "--threads", "1"]
    assert make_page([*asked, "--controllers", "rules", "seeking"]) == 0
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    for name in names:
        record = read_record(tmp_path / f"{name}.json")
        assert list(record["runs"]) == ["rules", "seeking", "oracle"] and page_part(record) in page
    assert (tmp_path / "degradation.png").stat().st_size > 10_000
    assert list(_colours({"test": {"summary": {"rows": dict.fromkeys(("fixed", "mine", "rules", "oracle"))}}})) == [
        "rules",
        "mine",
    ]
    # made anew from the records alone
    (tmp_path / "README.md").write_text(places, encoding="utf-8")
    assert make_page([*asked, "--controllers", "none"]) == 0
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == page
    assert make_page(["--out", str(tmp_path / "nowhere")]) == 2
    assert make_page([*asked, "--conditions", "nowhere"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and all(line.startswith("error: ") for line in said)


# --- The tables in the documentation


def test_all_conditions_are_in_the_documentation():
    assert {file.stem for file in TABLES} == set(CONDITIONS)


@pytest.mark.parametrize("file", TABLES, ids=lambda file: file.stem)
def test_the_page_says_what_the_record_holds(file):
    record = read_record(file)
    assert page_part(record) in (DOCS / "README.md").read_text(encoding="utf-8")
    compared = "score" if file.stem == "hidden" else "share"
    again = json.loads(json.dumps(summary(record["runs"], np.array(record["strata"]), compared)))
    assert record["summary"]["compared"] == compared and again["statement"] == record["summary"]["statement"]
    for name, row in record["summary"]["rows"].items():
        assert again["rows"][name]["share"] == pytest.approx(row["share"], rel=1e-9), name


def test_the_policies_of_the_learned_rows_are_kept():
    for file in TABLES:
        kept = read_record(file)["runs"]
        learned = ["ppo-vine-randomised", "ppo-vine-hidden", "ppo-vine", "ppo", "ppo-lagrangian", "recurrent-ppo"]
        for name, runs in entries(learned, POLICIES).items():
            assert [run.policy for run in runs] == [run["policy"] for run in kept[name]]
            assert len({run.seed for run in runs}) == len(runs)
        assert len(kept["ppo-vine"]) == len(kept["ppo-vine-randomised"]) == 5
        # the one that ships is among them
        assert kept["shipped"][0]["policy"] in [run["policy"] for run in kept["ppo-vine-randomised"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["random", "fixed", "rules", "scheduled", "seeking", "shipped", "ppo-vine", "ppo-vine-hidden", "ppo"]
)
@pytest.mark.parametrize("where", ["test", "beyond", "constants"])
def test_the_cheap_rows_are_current(name, where):
    record = read_record(DOCS / f"{where}.json")
    run = entries([name], POLICIES if name in REPEATED else ())[name][0]
    kept = record["runs"][name][0]
    assert run.policy == kept["policy"], "the policy is another one: run drillenv.training.league_page again"
    made = run_record(run, CONDITIONS[where], 3, record["steps"], threads=1)
    for measure in ("score", "penetration_rate", "single_share"):
        assert made["episodes"][measure] == pytest.approx(kept["episodes"][measure][:3], abs=1e-6), measure
