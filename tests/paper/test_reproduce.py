"""The published motions: which the model gives, which it does not, and by how much its boundaries lie elsewhere."""

import json
from pathlib import Path

import pytest

from drillenv.checks import InputError
from drillenv.dynamics.motion import motion
from drillenv.paper.published import BOUNDARIES, MOTIONS
from drillenv.paper.reproduce import boundary_row, matches, motion_row, order_row, reproduce, rocks_row

# Found with the printed constants, from every one of many starts; see the README. Both are of the paper's measurements
# near the edge of a region: the model's own region of that motion lies elsewhere.
SHOWN = json.loads((Path(__file__).parents[2] / "docs" / "paper" / "published.json").read_text())
"""Rows that the README and the documentation show."""


def shown(kind, published):
    """The row of a published motion or boundary."""
    every = {"motion": MOTIONS, "boundary": BOUNDARIES}[kind]
    order = sorted(every, key=lambda row: row.figure) if kind == "motion" else list(every)
    return [row for row in SHOWN if row["kind"] == kind][order.index(published)]


DIFFERENT = {("2.5", 100.0, 1.0): "P-8-I-14", ("4.3", 90.0, 0.70): "P-1-I-1"}


@pytest.mark.parametrize("published", MOTIONS, ids=lambda row: f"{row.figure}-{row.setting}")
def test_published_motion(published):
    row = motion_row(published)
    key = (published.figure, published.setting.frequency, published.setting.pressure)
    assert row["agrees"] == (key not in DIFFERENT)
    current = shown("motion", published)
    assert (current["figure"], current["computed"]) == (row["figure"], row["computed"])
    if key in DIFFERENT:
        assert row["computed"] == DIFFERENT[key]
        # no other motion coexists there that would agree
        assert [other["label"] for other in row["coexisting"]] == [DIFFERENT[key]]


FOUND = (
    (97.9879, "period doubling"),
    (98.9064, "grazing"),
    (103.3005, "period doubling"),
    (109.8877, "fold"),
    (0.328216, "grazing"),
    (0.783129, "grazing"),
    (0.886653, "period doubling"),
)


@pytest.mark.parametrize(("published", "found"), list(zip(BOUNDARIES, FOUND, strict=True)))
def test_published_boundary(published, found):
    row = boundary_row(published)
    assert row["computed"] == pytest.approx(found[0], rel=1e-5)
    assert row["bifurcation"] == found[1]
    assert shown("boundary", published)["computed"] == pytest.approx(row["computed"])
    if published.swept:
        return
    # a run from rest shows the followed motion on the inner side, and none of it beyond
    step = 2e-3 * abs(getattr(published.inside, published.over) - row["computed"])
    towards = 1 if published.outside > row["computed"] else -1

    def label(value):
        controls = {"frequency": 0, "amplitude": 0, "pressure": 0} | row["setting"] | {published.over: value}
        return motion(type(published.inside)(**controls), published.rock).label

    assert label(row["computed"] - towards * step) == row["followed"]
    assert label(row["computed"] + towards * 20 * step) != row["followed"]


def test_period_over_the_rocks():
    row = rocks_row()
    assert row["agrees"]
    assert [found["label"][:3] for found in row["computed"]] == ["P-1", "P-1", "P-1", "P-2", "P-2", "P-1"]


def test_order_of_a_sweep_is_read_in_order():
    class Labels:
        def __init__(self, *labels):
            self.labels = lambda _direction: labels

    wanted = ["P-1-I-4", "P-1-I-3", "P-1-I-2", "P-2-I-4", "P-2-I-3", "P-4-I-6", "chaotic", "P-1-I-1"]
    assert order_row(Labels(*wanted, "P-1-I-1"))["agrees"]
    assert not order_row(Labels(*wanted[::-1]))["agrees"]
    assert not order_row(Labels(*wanted[:-1]))["agrees"]


def test_names_of_the_paper():
    found = motion(MOTIONS[5].setting, 4)
    assert matches(found, "period two")
    assert not matches(found, "P-1-I-1")
    assert not matches(found, "multiple impacts")


@pytest.mark.slow
def test_reproduce_writes_rows_and_figures(tmp_path):
    rows = reproduce(tmp_path / "paper")
    assert json.loads((tmp_path / "paper" / "published.json").read_text()) == json.loads(json.dumps(rows))
    for row in rows:
        assert {"figure", "published", "computed", "agrees"} <= set(row)
    order = next(row for row in rows if row["kind"] == "order" and row["figure"] == "3.2")
    assert order["agrees"]
    names = sorted(path.name for path in (tmp_path / "paper").iterdir())
    assert names == [f"figure-{n}.png" for n in ("2.5", "3.2", "4.1", "4.2", "4.3", "4.4")] + ["published.json"]
    for path in (tmp_path / "paper").glob("*.png"):
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 30_000


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="give another"):
        reproduce(tmp_path / "file" / "paper")


def test_the_readme_shows_every_motion_and_boundary():
    kinds = [row["kind"] for row in SHOWN]
    assert (kinds.count("motion"), kinds.count("boundary")) == (len(MOTIONS), len(BOUNDARIES))
    assert sum(row["agrees"] for row in SHOWN) == 16
