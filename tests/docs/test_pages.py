"""The lines of Python in the documentation run, and its tables are those that were measured."""

import json
import os
import re
from pathlib import Path
from unittest.mock import patch

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from drillenv.dynamics.effects import LIBRARY

mpl.use("Agg")

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_in_the_pages_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    if any("import minari" in block for block in blocks):
        pytest.importorskip("minari")
    with patch.dict(os.environ):
        for block in blocks:
            exec(compile(block, str(page), "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_each_effect_has_its_figure(name, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "physics")
    from effect_figure import draw

    monkeypatch.setattr(plt, "show", lambda: None)
    draw(name)
    panels = plt.gcf().axes
    assert panels
    assert all(any(np.ptp(line.get_ydata()) > 0.0 for line in panel.lines) for panel in panels)
    plt.close("all")


def test_headroom_in_the_page_is_what_was_measured():
    from drillenv.training.headroom import table

    page = (ROOT / "docs" / "environment" / "README.md").read_text(encoding="utf-8")
    for name in ("headroom", "headroom-drill"):
        record = json.loads((ROOT / "docs" / "environment" / f"{name}.json").read_text(encoding="utf-8"))
        assert table(record) in page
        assert record["rows"]["best fixed"]["share"] <= 0.75
        assert record["rows"]["random"]["share"] < 0.5 * record["rows"]["best fixed"]["share"]


def test_counts_of_the_verdicts_page_are_those_of_the_newest_trial():
    from drillenv.blind.marking import wilson

    record = json.loads((ROOT / "docs" / "trial" / "trial.json").read_text(encoding="utf-8"))["summary"]
    page = (ROOT / "docs" / "diagnosis" / "verdicts.md").read_text(encoding="utf-8")

    def counts(*groups):
        shares = [(record["groups"][name]["right"], record["groups"][name]["named"]) for name in groups]
        return sum(r["hits"] for r, _ in shares), sum(r["of"] for r, _ in shares), sum(n["hits"] for _, n in shares)

    right, of, _ = counts("null", "wrong-constant")
    assert f"| nothing, or a constant only | {right} of {of}" in page
    right, of, _ = counts("library-equation")
    assert f"| one mechanism by the library's equation | {right} of {of} |" in page
    for words, groups in (("by another equation", ["other-equation"]), ("strength", ["weak-third", "weak-tenth"])):
        right, of, named = counts(*groups)
        assert re.search(rf"\| one mechanism .*{words} \| {right} of {of}; {named} of {of} named \|", page)
    (two, twos, _), (three, threes, _) = counts("two"), counts("three")
    assert f"| two mechanisms; three | {two} of {twos}; {three} of {threes} |" in page
    for words, groups in (
        (
            "a wrong constant beside a mechanism; constants fitted to it beforehand",
            ("beside-wrong-constant", "absorbed"),
        ),
        ("five times the noise; slow sampling", ("noisy", "slow")),
    ):
        (one, ones, _), (other, others, _) = map(counts, groups)
        assert f"| {words} | {one} of {ones}; {other} of {others} |" in page
    hits, of = record["coverage"]["hits"], record["coverage"]["of"]
    assert f"those of 95 % held the true value in {hits} of {of} cases" in page
    right, of, _ = counts("outside")
    assert f"| what no mechanism of the library covers | {right} of {of} |" in page
    right, of, named = counts(*record["groups"])
    low, high = wilson(right, of)
    assert f"| {right} right (95 % interval {100 * low:.0f} to {100 * high:.0f} %), {named} named |" in page
    door = (ROOT / "docs" / "start" / "my-simulation-does-not-match.md").read_text(encoding="utf-8")
    assert f"it was right in {right} of {of} campaigns" in door
