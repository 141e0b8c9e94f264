"""The rock file: written by the command, read back, and taken wherever a rock is."""

import json

import numpy as np
import pytest

from drillenv import cli, fit_indentation, read_rock
from drillenv.rocks import rock
from tests.indentation.made import Made, write

SETTING = ["--frequency", "120", "--amplitude", "0.45", "--pressure", "1.0"]


@pytest.fixture
def simple():
    """Two indentations, made."""
    made = Made([20e6, 20e6], [25e6, 25e6], compliance=5e-9, rate=4.0)
    return made, made.make(np.random.default_rng(3))[:3]


@pytest.mark.slow
def test_rock_file_goes_where_a_rock_goes(tmp_path, monkeypatch, capsys, simple):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "granite.csv", *simple[1])
    for picture in ("fig.png", "fig.svg"):
        given = ["indentation", "granite.csv", "--compliance", "5e-9", "--out", "rock.json", "--plot", picture]
        assert cli.main(given) == 0
        assert (tmp_path / picture).stat().st_size > 5000
    assert "wrote rock.json" in capsys.readouterr().out
    record = json.loads((tmp_path / "rock.json").read_text(encoding="utf-8"))
    found = read_rock("rock.json")
    test = fit_indentation("granite.csv", 5e-9)
    assert found == test.rock() == rock("rock.json")
    assert found.name == "granite"
    assert found.loading_stiffness == record["loading_stiffness"] == pytest.approx(20e6, rel=0.02)
    assert found.indentations.phase("stable")[0] == found.indentations.loading
    assert len(record["source"]["sha256"]) == 64
    for command in (["motion"], ["simulate", "--seconds", "0.05"]):
        assert cli.main([*command, *SETTING, "--rock", "rock.json", "--json"]) == 0
        told = json.loads(capsys.readouterr().out)["rock"]
        assert told["loading_stiffness"] == found.loading_stiffness
        assert told["name"] == "granite"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not JSON"),
        ("[]", "format is []"),
        ('{"format": "drillenv-model/1"}', "format is 'drillenv-model/1'"),
        ('{"format": "drillenv-rock/1"}', "loading_stiffness is missing"),
        ('{"format": "drillenv-rock/1", "loading_stiffness": 21.4, "unloading_stiffness": 25e6}', "was it in kN/mm"),
        ('{"format": "drillenv-rock/1", "loading_stiffness": 3e7, "unloading_stiffness": 2e7}', "give energy away"),
        ('{"format": "drillenv-rock/1", "colour": 1}', "unknown key 'colour'"),
    ],
)
def test_a_bad_rock_file_is_one_line(tmp_path, capsys, text, message):
    path = tmp_path / "rock.json"
    path.write_text(text, encoding="utf-8")
    assert cli.main(["motion", *SETTING, "--rock", str(path)]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert len(printed.splitlines()) == 1
