"""One setting for everything, and none at all."""

import json
from pathlib import Path

import numpy as np
import pytest

from drillenv import controllers

HEADROOM = Path(__file__).parents[2] / "docs" / "environment" / "headroom.json"


def test_the_setting_is_held(drill):
    done = drill(controllers.make("fixed", frequency=100.0, amplitude=0.5, pressure=0.9), 20, kind="rock", rock=4)
    assert done["frequency"] == pytest.approx(100.0, abs=1e-4)
    assert done["amplitude"] == pytest.approx(0.5, abs=1e-6)
    assert done["valve_pressure"] == pytest.approx(0.9, abs=1e-6)


def test_the_default_is_the_best_that_was_found(drill):
    best = json.loads(HEADROOM.read_text(encoding="utf-8"))["best_fixed"]
    done = drill(controllers.make("fixed"), 2, kind="rock", rock=4)
    for name, column in (("frequency", "frequency"), ("amplitude", "amplitude"), ("pressure", "valve_pressure")):
        assert done[column][-1] == pytest.approx(best[name], rel=1e-4)


def test_random_fills_the_box_evenly():
    controller = controllers.make("random")
    controller.reset(0)
    actions = np.array([controller.act(np.zeros(15), {}) for _ in range(3000)])
    assert np.abs(actions).max() <= 1.0
    counts = [np.histogram(column, 5, (-1, 1))[0] for column in actions.T]
    assert np.min(counts) > 500 and np.max(counts) < 700
