"""Two reports side by side, and recordings that are left out by name."""

import json
from copy import deepcopy

import numpy as np
import pytest

from drillenv import cli
from drillenv.blind.campaigns import plain_campaign
from drillenv.checks import InputError
from drillenv.diagnosis.compare import compare, compared_text, read_report
from drillenv.diagnosis.report import diagnose


def number(value, std, unit="s/m"):
    return {"value": value, "std": std, "unit": unit, "interval": [value - 1.96 * std, value + 1.96 * std]}


BEFORE = {
    "format": "drillenv-report/1",
    "verdict": "missing-physics",
    "findings": [
        {"mechanism": "contact-rate", "parameters": {"chi": number(0.5, 0.01)}},
        {"mechanism": "backlash", "parameters": {}},
    ],
    "constants": {"damping": number(2450.0, 20.0, "N*s/m"), "stiffness": number(70e3, 100.0, "N/m")},
    "fit": {"unit": "N, root mean square", "held_out": {"recordings": ["r03"], "before": 4.0, "after": 1.01}},
}


def after_repair():
    after = deepcopy(BEFORE)
    after["findings"] = [{"mechanism": "contact-rate", "parameters": {"chi": number(0.51, 0.01)}}]
    after["constants"]["damping"] = number(2600.0, 20.0, "N*s/m")
    return after


def test_what_went_and_what_moved():
    found = compare(BEFORE, after_repair())
    assert found["mechanisms"] == {"went": ["backlash"], "came": [], "stayed": ["contact-rate"]}
    assert found["parameters"]["contact-rate"]["chi"]["sigmas"] == pytest.approx(0.01 / (0.01 * 2**0.5))
    damping = found["constants"]["damping"]
    assert damping["difference"] == pytest.approx(150.0) and damping["sigmas"] == pytest.approx(150.0 / 800.0**0.5)
    text = compared_text(found)
    assert "went: backlash" in text and "damping: 2450 to 2600" in text and "2 more numbers stayed" in text
    assert "left on recordings that were not fitted: 1.01, then 1.01 N" in text


def test_a_number_without_an_interval_stays_where_it_is_the_same():
    before = deepcopy(BEFORE)
    before["constants"]["mass"] = number(0.5, 0.0, "kg")
    after = deepcopy(before)
    assert "constant mass" not in compared_text(compare(before, after))
    after["constants"]["mass"] = number(0.6, 0.0, "kg")
    assert "constant mass: 0.5 to 0.6 kg" in compared_text(compare(before, after))


def test_nothing_differs_from_itself():
    found = compare(BEFORE, BEFORE)
    assert all(each["difference"] == 0.0 for each in found["constants"].values())
    assert found["mechanisms"]["went"] == found["mechanisms"]["came"] == []


def test_command(tmp_path, capsys):
    files = []
    for name, record in (("a", BEFORE), ("b", after_repair())):
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps(record))
        files.append(str(file))
    assert cli.main(["compare", *files]) == 0
    assert "went: backlash" in capsys.readouterr().out
    assert cli.main(["compare", *files, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == ["missing-physics", "missing-physics"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is not JSON"),
        ("[]", "give a report.json"),
        ('{"format": "drillenv-model/1"}', "'drillenv-model/1'"),
        ('{"format": "drillenv-report/1"}', "it lacks verdict"),
    ],
)
def test_what_is_no_report_is_refused(text, said, tmp_path):
    file = tmp_path / "report.json"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        read_report(file)


def test_recordings_to_exclude_must_be_there():
    drill = plain_campaign(np.random.default_rng(1), 4, (), recordings=3, seconds=0.1).campaign
    with pytest.raises(InputError, match="exclude names 'r99': give names of recordings"):
        diagnose(drill, exclude=["r99"])
    with pytest.raises(InputError, match="leave at least one"):
        diagnose(drill, exclude=[each.name for each in drill.recordings])
    with pytest.raises(InputError, match="jobs"):
        diagnose(drill, jobs=0)
