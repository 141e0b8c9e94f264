"""What the concealed rig records: every equation of the catalogue acts, and nothing tells of it but the samples."""

import json

import numpy as np
import pytest

from drillenv.blind.campaigns import (
    GROUPS,
    Planned,
    draw_constants,
    make_campaign,
    plain_campaign,
)
from drillenv.blind.mechanisms import MECHANISMS, OUTSIDE, Site, concealed, of_library
from drillenv.recordings import check_quality, read_campaign, write_campaign

CARDS = [
    (name, i)
    for catalogue in (MECHANISMS, OUTSIDE)
    for name in catalogue
    for i in range(len(catalogue[name].equations))
]


def short_campaign(hidden=()):
    return plain_campaign(np.random.default_rng(9), 4, hidden, recordings=2, seconds=0.2).campaign


@pytest.fixture(scope="module")
def nothing_concealed():
    return short_campaign()


@pytest.mark.slow
@pytest.mark.parametrize("card", CARDS, ids=lambda card: f"{card[0]} {card[1]}")
def test_every_equation_acts(card, nothing_concealed):
    """The recordings differ from those of the rig that conceals nothing, by more than chance explains."""
    name, index = card
    mechanism = {**MECHANISMS, **OUTSIDE}[name]
    site = Site(500.0, 110.0)
    hidden = [concealed(mechanism.name, mechanism.equations[index], np.random.default_rng(8), 1.0, site)]
    gain = 0.0
    for a, b in zip(short_campaign(hidden).recordings, nothing_concealed.recordings, strict=True):
        for channel, noise in (("force", 5.0), ("acceleration", 2.0)):
            one, other = a.channels[channel].samples, b.channels[channel].samples
            assert np.all(np.isfinite(one))
            assert np.max(np.abs(one)) < 20e3
            # log-likelihood ratio of two campaigns with the same noise
            gain += 0.5 * float(np.sum((one - other) ** 2)) / noise**2
    assert gain > 100.0


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_every_group_makes_a_campaign_that_can_be_read(group, tmp_path):
    cards = {
        "null": [],
        "wrong-constant": [],
        "outside": [("mended gaps", 0)],
        "two": [("contact-toe", 0), ("drive-droop", 2)],
    }
    planned = Planned(group, cards.get(group, [("damping-quadratic", 1)]))
    made = make_campaign(3, 5, planned)
    json.dumps(made.answer, allow_nan=False)
    campaign = made.campaign
    write_campaign(tmp_path / "c", campaign.title, campaign.rig, campaign.nominal, campaign.recordings)
    read = read_campaign(tmp_path / "c")
    assert len(read.recordings) == 8
    assert not [each for each in check_quality(read) if each.severity == "exclude recording"]
    assert bool(made.answer["wrong"]) == (group in ("wrong-constant", "beside-wrong-constant"))
    text = (tmp_path / "c" / "campaign.json").read_text()
    assert not [word for word in (*MECHANISMS, *OUTSIDE, "seed", group) if word in text]


def test_constants_are_drawn_unclipped_and_tolerances_misjudged():
    off, stated = [], []
    for seed in range(400):
        nominal, true = draw_constants(np.random.default_rng(seed), 4, {})
        off.append((true.damping - 2450.0) / 75.0)
        stated.append(nominal["damping"].std / 75.0)
    assert np.std(off) == pytest.approx(1.0, abs=0.1)
    assert np.max(np.abs(off)) > 2.5
    assert 1.0 / 1.5 - 1e-9 <= min(stated) < 0.7
    assert 1.5 + 1e-9 >= max(stated) > 1.45


@pytest.mark.slow
def test_absorbed_constants_explain_most_of_what_is_missing():
    """Of a damping that grows with speed a lab that fits its damping finds a larger one."""
    made = make_campaign(6, 2, Planned("absorbed", [("damping-quadratic", 0)]))
    true, stated = made.answer["true"]["damping"], made.campaign.nominal["damping"].value
    grown = made.hidden[0].parameters["c2"]
    assert 0.3 * grown * 0.1 < stated - true < 2.0 * grown * 0.2


def test_a_wrong_constant_is_off_by_its_tolerances():
    made = plain_campaign(np.random.default_rng(1), 4, (), {"stiffness": 8.0}, recordings=3, seconds=0.05)
    assert made.true.stiffness == pytest.approx(68850.0 + 8.0 * 2000.0, abs=4.0 * 2000.0)
    assert made.answer["wrong"] == {"stiffness": made.true.stiffness}


def test_a_parameter_that_does_not_exist_is_refused():
    with pytest.raises(KeyError, match="contact-rate has no parameter xi: it has chi"):
        of_library("contact-rate", xi=1.0)
