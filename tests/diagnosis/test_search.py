"""What a search holds against what."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.search import CLOSE, FLOOR, Place, Tried, _settled_cost, _settled_cost_at_best_gain
from drillenv.diagnosis.shooting import Physics
from tests.diagnosis.truth import rig_of, rock_of


def _fit(per_sample: float, loose: float) -> Any:
    return SimpleNamespace(per_sample=per_sample, loose=loose)


def _place(now: Any, loosely: Any) -> Place:
    nothing: Any = None
    return Place([], now, loosely, now, nothing, nothing)


@pytest.mark.parametrize(
    ("loose_before", "left", "kept_loose"),
    [
        (1e4, 2.0 * CLOSE, True),  # what shows at the joints only was not in the fit before either
        (1e4, 0.9 * CLOSE, False),
        (1.0, 2.0 * CLOSE, False),
    ],
)
def test_a_fit_is_held_against_one_whose_windows_join_as_little(loose_before, left, kept_loose):
    tried = Tried("mains-hum", _fit(1.05, 1e4), _fit(left, 1.0))
    now = _fit(3.0, loose_before)
    assert _place(now, now).without_and_with(tried) == (now, tried.loosely if kept_loose else tried.fitted)


@pytest.mark.parametrize(
    ("inside_before", "inside", "kept_loose"),
    [
        (1.15, 0.95, True),  # the joints speak of something else, which they bend one fit more for than the other
        (1.15, 1.10, False),
        (0.98, 0.95, False),
    ],
)
def test_a_mechanism_that_leaves_nothing_inside_the_windows_is_judged_there(inside_before, inside, kept_loose):
    assert 0.95 < FLOOR < 1.10
    now, loosely = _fit(4.0, 1.0), _fit(inside_before, 1e4)
    tried = Tried("drive-droop", _fit(inside, 1e4), _fit(8.0, 1.0))
    found = _place(now, loosely).without_and_with(tried)
    assert found == ((loosely, tried.loosely) if kept_loose else (now, tried.fitted))


def test_a_scan_for_mounts_does_not_mind_another_gain_of_the_drive():
    rng = np.random.default_rng(5)
    made = plain_campaign(rng, 4, recordings=3, seconds=0.2)
    rig, rock = rig_of(made), rock_of(made)
    weaker = replace(rig, drive_gain=0.95 * rig.drive_gain)
    data = condition(made.campaign.recordings[0], rig).thinned(4)
    nominal, true = Physics(rig, rock), Physics(weaker, rock)
    noise = data.judged.stop - data.judged.start
    assert _settled_cost(data, data.states, nominal) < 1.1 * noise
    assert _settled_cost(data, data.states, true) > 1.5 * noise
    assert _settled_cost_at_best_gain(data, data.states, true) < 1.1 * noise
