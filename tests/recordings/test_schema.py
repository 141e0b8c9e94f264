"""The JSON Schema that ships allows what the reader reads, and refuses what it refuses."""

import json
from copy import deepcopy
from importlib.resources import files
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from drillenv import cli
from drillenv.checks import InputError
from drillenv.recordings import write_campaign
from drillenv.recordings.document import parse_document
from drillenv.recordings.units import CHANNEL_UNITS, unit_of

SCHEMA = json.loads((files("drillenv.recordings") / "campaign.schema.json").read_text(encoding="utf-8"))
EXAMPLE = Path(__file__).parents[2] / "docs" / "recordings" / "example"

VALIDATOR = Draft202012Validator(SCHEMA)


def judged(document):
    """(by the schema, by the reader)."""
    try:
        parse_document(document)
        read = True
    except InputError:
        read = False
    return VALIDATOR.is_valid(document), read


@pytest.fixture(scope="module")
def documents(drill, body, tmp_path_factory):
    """campaign.json of both rigs."""
    place = tmp_path_factory.mktemp("documents")
    found = {}
    for campaign in (drill, body):
        folder = write_campaign(place / campaign.rig, "t", campaign.rig, campaign.nominal, campaign.recordings)
        found[campaign.rig] = json.loads((folder / "campaign.json").read_text())
    return found


def test_what_is_written_conforms(documents):
    for document in documents.values():
        assert judged(document) == (True, True)


def test_what_init_writes_conforms(documents, drill, tmp_path, capsys):
    folder = write_campaign(tmp_path / "c", "t", drill.rig, drill.nominal, drill.recordings)
    (folder / "campaign.json").unlink()
    options = ["--rock", "3", "--pressure", "1", "--sample-rate", "25600", "--damping", "3000"]
    assert cli.main(["campaign", "init", str(folder), *options]) == 0
    assert judged(json.loads((folder / "campaign.json").read_text())) == (True, True)


def test_what_simulate_writes_conforms(tmp_path, capsys):
    folder = tmp_path / "c"
    assert cli.main(["simulate", "--campaign", str(folder), "--recordings", "3", "--seconds", "0.1"]) == 0
    assert judged(json.loads((folder / "campaign.json").read_text())) == (True, True)


def test_the_example_conforms():
    assert judged(json.loads((EXAMPLE / "campaign.json").read_text())) == (True, True)


def put(value, *path):
    """A change to a document: ``value`` at ``path``, or nothing there where it is ``...``."""

    def change(document):
        place = document
        for key in path[:-1]:
            place = place[key]
        if value is ...:
            del place[path[-1]]
        else:
            place[path[-1]] = value

    return change


BROKEN = {
    "another version": put("drillenv-campaign/2", "format"),
    "no title": put(..., "title"),
    "an unknown key": put(1, "author"),
    "an unknown rig": put("hammer", "rig"),
    "no std": put(..., "nominal", "damping", "std"),
    "no certainty": put(0.0, "nominal", "damping", "std"),
    "a constant too few": put(..., "nominal", "stiffness"),
    "a wrong unit": put("lbf", "recordings", 0, "channels", "force", "unit"),
    "a unit of another channel": put("kN", "recordings", 0, "channels", "acceleration", "unit"),
    "no recordings": put([], "recordings"),
    "a text for a rate": put("25600", "recordings", 0, "sample_rate"),
    "a rate too low": put(25.6, "recordings", 0, "sample_rate"),
    "a file outside": put("../r01.csv", "recordings", 0, "file"),
    "a file of Windows": put("C:/r01.csv", "recordings", 0, "file"),
    "a file of another kind": put("r01.xlsx", "recordings", 0, "file"),
    "no pressure": put(..., "recordings", 0, "setting", "pressure"),
    "a pressure in kPa": put(100.0, "recordings", 0, "setting", "pressure"),
    "an unknown channel": put({"column": "x", "unit": "N"}, "recordings", 0, "channels", "torque"),
    "no channels": put({}, "recordings", 0, "channels"),
    "starts warm": put("warm", "recordings", 0, "starts"),
    "true for a number": put(True, "recordings", 0, "setting", "amplitude"),
    "a name of two lines": put("a\nb", "recordings", 0, "name"),
    "an empty name": put("  ", "recordings", 0, "name"),
}


@pytest.mark.parametrize("how", BROKEN)
def test_both_refuse(documents, how):
    document = deepcopy(documents["percussive-drill"])
    BROKEN[how](document)
    assert judged(document) == (False, False)


ALLOWED = {
    "a source": put("a paper", "source"),
    "held out": put("held-out", "recordings", 0, "use"),
    "a file below": put("raw/r01.TDMS", "recordings", 0, "file"),
    "lvm": put("r01.lvm", "recordings", 0, "file"),
    "dots in a name": put("r..01.csv", "recordings", 0, "file"),
    "another spelling": put("m/s2", "recordings", 0, "channels", "acceleration", "unit"),
}


@pytest.mark.parametrize("how", ALLOWED)
def test_both_allow(documents, how):
    document = deepcopy(documents["percussive-drill"])
    ALLOWED[how](document)
    assert judged(document) == (True, True)


def test_one_body(documents):
    document = deepcopy(documents["one-body"])
    for constant, good in (
        ({"value": None, "unit": "N*s/m"}, True),
        ({"value": 3.0, "unit": "Ns/m"}, True),
        ({"value": None, "std": 1.0, "unit": "N*s/m"}, False),
        ({"value": 3.0}, False),
    ):
        document["nominal"]["damping"] = constant
        assert judged(document) == (good, good)
    del document["nominal"]["damping"], document["nominal"]["mass"]
    assert judged(document) == (False, False)


def test_every_unit_is_in_it():
    channels = SCHEMA["$defs"]["drill_recording"]["properties"]["channels"]["properties"]
    assert set(channels) == set(CHANNEL_UNITS)
    for name, units in CHANNEL_UNITS.items():
        listed = channels[name]["properties"]["unit"]["enum"]
        assert set(units) <= set(listed)
        assert {unit_of("unit", each, units) for each in listed} == set(units)


def test_it_is_a_schema():
    Draft202012Validator.check_schema(SCHEMA)
