"""The league on holes: rows of this package, of policies and of others, on few steps of few holes."""

import json
from pathlib import Path

import numpy as np
import pytest

from drillenv import cli
from drillenv.controllers.hole.belief import SIZE
from drillenv.controllers.hole.learned import HolePolicy, read_policy, write_policy
from drillenv.controllers.hole.rules import HoleRules
from drillenv.controllers.policies.stable_baselines import read_model
from drillenv.training.evaluate import Run, read_record
from drillenv.training.hole_headroom import MEASURES, row_of, summary, table
from drillenv.training.hole_league import FORMAT, entries, evaluate, league_table, page_part

MINE = """
import numpy as np
class Mine:
    def reset(self, seed=None): self.rng = np.random.default_rng(seed)
    def act(self, observation, info):
        assert info == {} and observation.shape == (20,)
        return [0.4, float(self.rng.uniform(-0.1, 0.1)), -0.6, -1.0]
class Seeing(Mine):
    sees_truth = True
    def act(self, observation, info): return [0.4, 0.0, -0.6, 1.0 if info["bit_wear"] > 0.8 else -1.0]
class Three(Mine):
    def act(self, observation, info): return [0.4, 0.0, -0.6]
"""
PUBLISHED = Path(__file__).parents[2] / "docs" / "environment"
SHORT = ["--environment", "DrillBit", "--scenario", "validation", "--episodes", "2", "--steps", "6"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The present folder, with controllers of one's own and a policy."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_holes.py").write_text(MINE, encoding="utf-8")
    rng = np.random.default_rng(0)
    for seed in (0, 1):
        sizes = {"layer0": (8, SIZE), "action": (4, 8)}
        weights = {f"{name}.weight": 0.1 * rng.standard_normal(size) for name, size in sizes.items()}
        weights |= {f"{name}.bias": np.zeros(size[0]) for name, size in sizes.items()}
        write_policy(tmp_path / f"policy-{seed}", HolePolicy(weights, {"algorithm": "ppo", "seed": seed}))
    return tmp_path


@pytest.mark.slow
def test_everybody_gets_a_row(folder, capsys):
    wanted = ["all", "my_holes:Mine", "mine=my_holes:Mine", "own=my_holes:Seeing", "one=policy-0"]
    files = ["--json", "record.json", "--table", "table.md"]
    given = ["league", "--controllers", *wanted, "--policies", "policy-0", "policy-1", *SHORT, *files]
    assert cli.main(given) == 0
    printed = capsys.readouterr().out
    record = read_record(folder / "record.json", FORMAT, "rows")
    assert list(record["rows"]) == [
        "random", "fixed", "rules", "planner", "greedy", "oracle", "ppo", "my_holes:Mine", "mine", "own", "one",
    ]  # fmt: skip
    for row, measured in record["rows"].items():
        assert set(MEASURES) <= set(measured) and len(measured["cost_per_metre"]) == 2
        cost, share = record["summary"][row]["cost"], record["summary"][row]["share"]
        assert cost[1] <= cost[0] <= cost[2] and share[1] <= share[0] <= share[2]
    assert record["summary"]["oracle"]["share"] == [1.0, 1.0, 1.0]
    assert record["rows"]["mine"] == record["rows"]["my_holes:Mine"]
    assert [run["seed"] for run in record["about"]["ppo"]] == [0, 1]
    assert record["about"]["one"][0]["policy"] == record["about"]["ppo"][0]["policy"]
    assert record["about"]["mine"] == [{"seed": None, "policy": None, "source": "my_holes:Mine", "sees_truth": False}]
    for said in ("| ppo (2 seeds) |", "| own (sees the hole) |", "| oracle |", "| cost, EUR/m | share of the oracle |"):
        assert said in printed
    text = (folder / "table.md").read_text(encoding="utf-8")
    assert text == page_part(record) + "\n" and text.startswith("2 holes of validation.\n")


def test_a_row_is_what_the_headroom_measures_and_the_others_stay(folder, capsys):
    saved = []
    scripted = {"rules": entries(["rules"])["rules"], "oracle": entries(["rules"])["rules"]}
    first = evaluate(scripted, "validation", 1, 5, save=saved.append)
    assert first["rows"]["rules"] == row_of([HoleRules()], "validation", 1, 5)
    assert [list(each["rows"]) for each in saved] == [["oracle"], ["rules", "oracle"]]
    second = evaluate(entries(["fixed"]), "validation", 1, 5, kept=first)
    assert list(second["rows"]) == ["fixed", "rules", "oracle"]
    assert second["rows"]["rules"] == first["rows"]["rules"] and second["about"]["rules"] == first["about"]["rules"]
    assert second["summary"] == summary(second)
    file = folder / "record.json"
    file.write_text(json.dumps(second), encoding="utf-8")
    assert cli.main(["league", "--controllers", "rules", *SHORT, "--json", str(file)]) == 2
    assert "has episodes 1, not 2: give another file" in capsys.readouterr().err


def test_a_page_has_a_place_for_the_rows(folder):
    record = folder / "record.json"
    (folder / "page.md").write_text("# Mine\n<!-- league-rows DrillBit -->\n<!-- end league-rows DrillBit -->\nend\n")
    rules = {"rules": [Run(HoleRules)], "oracle": [Run(HoleRules)]}
    made = evaluate(rules, "validation", 2, 6)
    made["rows"]["oracle"]["plan"] = [90.0, 110.0]
    record.write_text(json.dumps(made), encoding="utf-8")
    assert cli.main(["league", "--controllers", "rules", *SHORT, "--json", str(record), "--table", "page.md"]) == 0
    page = (folder / "page.md").read_text(encoding="utf-8")
    assert "which the oracle carries out, costs 100.0 EUR/m." in page
    assert league_table(made) in page and page.startswith("# Mine\n") and page.endswith("-->\nend\n")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--controllers", "mpc"], "controller is 'mpc', which drills no hole: give one of random, fixed, rules"),
        (["--controllers", "sac=model.zip"], "model model.zip cannot be read"),
        (["--controllers", "nobody"], "controller is 'nobody': give one of"),
        (["--controllers", "rules=my_holes:Mine"], "rules is a row of the league already"),
        (["--controllers", "ppo"], "controller ppo needs trained policies"),
        (["--controllers", "my_holes:Nobody"], "controller my_holes:Nobody cannot be imported"),
        (["--controllers", "rules", "--policies", "nowhere"], "policy 'nowhere' cannot be read"),
        (["--controllers", "rules", "--threads", "1"], "--threads has no use with DrillBit"),
        (["--controllers", "rules", "--trust-pickle"], "--trust-pickle has no use with DrillBit"),
        (["--controllers", "rules", "--scenario", "beyond"], "scenario is 'beyond'"),
        (
            ["--controllers", "rules", "--environment", "DrillHole"],
            "give one of Drill, DrillLayers, DrillHidden, DrillB",
        ),
        (["--controllers", "rules", "--episodes", "31"], "episodes is 31"),
        (["--controllers", "oracle=my_holes:Mine"], "oracle is a row of the league already"),
    ],
)
def test_bad_input_gets_one_line(folder, given, says, capsys):
    assert cli.main(["league", *SHORT, *given]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


def test_an_action_that_is_none_is_refused(folder, monkeypatch):
    monkeypatch.syspath_prepend(str(folder))
    three = entries(["my_holes:Three"])["my_holes:Three"]
    with pytest.raises(ValueError, match=r"act of Three gave .*: let it give 4 numbers, each from -1 to 1"):
        evaluate({"oracle": three}, "validation", 1, 2)


@pytest.mark.slow
def test_the_published_table_is_that_of_its_record_and_its_cheap_rows_are_current():
    record = json.loads((PUBLISHED / "headroom-bit.json").read_text(encoding="utf-8"))
    assert table(record) in (PUBLISHED / "README.md").read_text(encoding="utf-8")
    shipped = sorted((PUBLISHED / "policies").glob("ppo-[0-9]"))
    assert f"ppo, {len(shipped)} seeds" in record["rows"]
    assert [read_policy(each).provenance["seed"] for each in shipped] == list(range(len(shipped)))
    plain = sorted((PUBLISHED / "policies").glob("plain-ppo-*.zip"))
    assert f"plain-ppo, {len(plain)} seeds" in record["rows"]
    assert [read_model(each, "drillenv/DrillBit-v0").provenance["seed"] for each in plain] == list(range(len(plain)))
    for row in ("fixed", "rules"):
        made = row_of([run.make() for run in entries([row])[row]], record["scenario"], 2)
        assert made["cost_per_metre"] == pytest.approx(record["rows"][row]["cost_per_metre"][:2], rel=1e-9)
