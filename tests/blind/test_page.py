"""trial.html: one page that needs nothing else, for any trial."""

import json
import re

import pytest

from drillenv.blind import marking
from drillenv.blind.detection import UNITS
from drillenv.blind.page import page

NASTY = "<script>alert('x')</script>\ud800"


def mark(i, group, **changes):
    made = {
        "campaign": f"c{i:04d}",
        "group": group,
        "truth": ["contact-rate (Tsuji)"],
        "wrong": {},
        "missing": dict.fromkeys(UNITS, 0.0) | {"contact": 12.0},
        "conditions": {"colour": "white", "bad_labels": False, "rate": 25600.0},
        "status": "answered",
        "seconds": 10.0,
        "memory_mib": 300.0,
        "verdict": "missing-physics",
        "findings": ["contact-rate"],
        "mechanisms": {"contact-rate": "named"},
        "false": [],
        "laws": {"contact-rate": 0.04},
        "intervals": [{"inside": True}],
        "fit": {"noise_floor": 1.0, "held_out": {"before": 4.0, "after": 1.01}},
        "where": "In the contact.",
        "right": True,
        "named": True,
    }
    return made | changes


NO_ANSWER = {
    "status": "out of time",
    "verdict": None,
    "findings": [],
    "mechanisms": {"contact-rate": "no answer"},
    "laws": {},
    "intervals": [],
    "fit": None,
    "where": None,
    "right": False,
    "named": False,
}


def record(marks, **more):
    return {
        "format": "drillenv-trial/1",
        "seed": 7,
        "campaigns": len(marks),
        "limit": 300.0,
        "version": "0.1.0",
        "python": "3.12",
        "answers_sha256": "ab" * 32,
        "summary": json.loads(json.dumps(marking.summary(marks))),
        "marks": marks,
    } | more


@pytest.mark.parametrize("most", [1, 2, 30])
def test_one_page_that_needs_nothing_else(most, tmp_path):
    groups = ("null", "two", "outside")
    marks = [mark(i, groups[i % 3], **(NO_ANSWER if i % 4 == 1 else {})) for i in range(most)]
    text = page(record(marks), tmp_path)
    assert "ab" * 32 in text
    assert "drillenv prove --out DIR --seed 7" in text
    for each in {mark["group"] for mark in marks}:
        assert each in text
    assert not re.search(r"<(script|link|img|iframe)\b", text)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert text.count("<svg") == text.count("</svg>")


def test_a_trial_without_an_answer(tmp_path):
    text = page(record([mark(0, "null", **NO_ANSWER)]), tmp_path)
    assert "out of time" in text


def test_whatever_a_report_says_is_text(tmp_path):
    text = page(record([mark(0, "two", where=NASTY, findings=[NASTY], truth=[NASTY])]), tmp_path)
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
    text.encode("utf-8")


def test_detection_curves_are_shown(tmp_path):
    point = {"share": 0.5, "strength": 20.0, "hits": 3, "of": 4, "low": 0.3, "high": 0.95}
    curves = {"air-spring": {"where": "shaker", "unit": "N", "points": [point], "half_found": 14.2}}
    text = page(record([mark(0, "curve", share=0.5)], curves=curves), tmp_path)
    assert "half found at 14.2 N" in text


def test_files_that_are_damaged_leave_gaps_and_no_error(tmp_path):
    folder = tmp_path / "reports" / "c0000"
    folder.mkdir(parents=True)
    (folder / "report.html").write_text('<script type="application/json" id="data">{"waves": [1, 2]</script>')
    (folder / "report.json").write_text("{")
    (tmp_path / "answers.json").write_text('[{"campaign": "c0000", "mechanisms": [{"mechanism": "contact-rate"}]}]')
    assert "The report holds no waveforms." in page(record([mark(0, "two")]), tmp_path)
