"""The diagnosis of one body: mass * acceleration = force - law(position, velocity), and what that leaves out.

Nothing is simulated. The loop is cut at the sensors: the measured motion goes into the law, and what the law makes of
it is held against the measured force (or, where none is measured, against the measured acceleration). So neither a
controller nor an unstable motion matters. The steps are those of the drilling rig: make the channels comparable
(``channels``), say what may be there (``terms``), fit and tell chance from more (``fit``), choose (``decide``), and put
the result into words (``answer``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from drillenv.checks import InputError, shown
from drillenv.diagnosis.one_body.answer import Answer, BodyOutcome
from drillenv.diagnosis.one_body.channels import prepare
from drillenv.diagnosis.one_body.decide import Search, named
from drillenv.diagnosis.one_body.fit import Rows, floor
from drillenv.diagnosis.one_body.terms import law_terms, widened
from drillenv.recordings import Campaign, QualityFinding

__all__ = ["BodyOutcome", "diagnose_body"]

SEED = 20_190_419
"""Of the made-up campaigns that say what chance explains: the same campaign gets the same answer."""

NOISY = 0.5
"""Noise over signal from which there is nothing to diagnose."""


def diagnose_body(
    campaign: Campaign,
    faults: Sequence[QualityFinding] = (),
    note: Callable[[str], object] | None = None,
) -> BodyOutcome:
    """The verdict on a campaign of one body.

    Args:
        campaign: Of the rig one-body.
        faults: Of the quality check; recordings, channels and stretches that they take out are not used.
        note: Told what is being done.

    Returns:
        The record of ``report.json``, that of ``model.json``, and what a picture of each recording needs.

    Raises:
        InputError: the campaign is of another rig, no recording can be used, or nothing says how large the mass is.
    """
    if campaign.rig != "one-body":
        raise InputError(f"campaign {shown(campaign.title)} is of the rig {campaign.rig}: give one of one-body")
    say = note or (lambda _text: None)
    say("making the channels comparable")
    bodies, remarks = prepare(campaign, faults)
    entry = campaign.nominal["mass"]
    forced = bodies[0].force is not None
    side = "force" if forced else "acceleration"
    if not forced and entry.value is None:
        raise InputError(
            f"campaign {shown(campaign.title)}: no force is measured and the mass is not stated: give one of the two, "
            "or the law is known to a factor only"
        )
    mass = entry.value or 1.0
    loose = 0.0 if forced else (entry.std or 0.0) / mass
    law = widened(law_terms(campaign, bodies, mass), loose)
    rows = Rows([body for body in bodies if not body.held], mass)
    say("telling the noise from the rest")
    if not np.ptp(rows.y) > 0.0:
        raise InputError(
            f"campaign {shown(campaign.title)}: the {side} never changes: see that its sensor was connected"
        )
    search = Search(rows, law, campaign, np.random.default_rng(SEED), say)
    if floor(rows, search.fitted().constants()) > NOISY * np.std(rows.y):
        raise InputError(
            f"campaign {shown(campaign.title)}: the {side} hardly stands out of its noise: "
            "see that its sensor was connected, or record larger motions"
        )
    say("looking for what is missing")
    steps = named(search)
    say("looking at what is left")
    return Answer(campaign, bodies, search, steps, loose, tuple(remarks), tuple(faults)).outcome()
