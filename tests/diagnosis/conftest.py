"""Every report that a test makes here keeps to the schemas that ship."""

import json
from importlib.resources import files

import pytest
from jsonschema import Draft202012Validator

from drillenv.diagnosis import report


def schema(package, name):
    found = json.loads((files(package) / name).read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(found)
    return Draft202012Validator(found)


REPORT, MODEL = schema("drillenv.diagnosis", "report.schema.json"), schema("drillenv", "model.schema.json")


@pytest.fixture(autouse=True)
def reports_conform(monkeypatch):
    made = report.Report

    def conforming(title, record, model, waves):
        REPORT.validate(json.loads(json.dumps(record, allow_nan=False)))
        MODEL.validate(json.loads(json.dumps(model, allow_nan=False)))
        return made(title, record, model, waves)

    monkeypatch.setattr(report, "Report", conforming)
