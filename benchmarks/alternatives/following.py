"""The paper's model with fitted constants along the recordings of a campaign: states, and what it leaves.

All alternatives begin from here: the recordings are prepared, their labels corrected and their states estimated by the
same multiple shooting as in a diagnosis. That is more than a user of a regression package would have by hand.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drillenv.diagnosis.bookkeeping import with_labels_corrected
from drillenv.diagnosis.condition import Conditioned, conditioned, without_unusable
from drillenv.diagnosis.drill_diagnosis import STRETCH, held_out, nominal_rig, plain_fit
from drillenv.diagnosis.drill_prediction import StateEstimate, chi_square, estimate_recordings
from drillenv.diagnosis.fitting import RELAXED, Fitted
from drillenv.diagnosis.solver import Floats, Limits
from drillenv.diagnosis.terms import RUNNING, ModelStructure
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.recordings import Campaign, check_quality, read_campaign
from drillenv.recordings.excerpt import excerpts
from drillenv.recordings.sound_parts import sound_parts


class Split(NamedTuple):
    """A campaign, and its recordings ready to be fitted."""

    campaign: Campaign
    fitted: list[Conditioned]
    held: list[Conditioned]


@dataclass(frozen=True)
class Motion:
    """The paper's model along a recording, at its samples (n,) of which both channels are judged. SI throughout."""

    rate: float
    frequency: float
    y: Floats
    """Shortening of the coupling."""
    v1: Floats
    v2: Floats
    rock: Floats
    """N, force of the rock."""
    loading: np.ndarray
    theta: np.ndarray
    """Phase of the excitation."""
    impacts: Floats
    """On this face, before the contact at or before each sample."""
    drive: float
    """N, amplitude."""
    static: float
    """N."""
    masses: tuple[float, float]
    k: float
    c: float
    kl: float
    ku: float


@dataclass(frozen=True)
class Followed:
    """A recording with its states estimated by the paper's model."""

    estimate: StateEstimate

    @cached_property
    def signals(self) -> Floats:
        """(2, fine samples) force in N and acceleration in m/s^2 of the model, before the logger."""
        block, own, shared = self.estimate
        return block.integrate(block.structure.model(shared * block.scales, block.point), own).signals

    @cached_property
    def left(self) -> Floats:
        """(2, n) measured less read, N and m/s^2, where both channels are judged."""
        block, own, shared = self.estimate
        read = block.read(shared * block.scales, self.signals) + block.disturbance(own)
        return (block.measured - read)[:, block.evaluation]

    @property
    def noise(self) -> Floats:
        """(2,) standard deviations of white noise that the recording shows whatever its model, N and m/s^2."""
        data = self.estimate.block.data
        return np.array([data.noise_force, data.noise_acceleration])

    def sampled(self, signals: Floats) -> Floats:
        """(2, n) fine signals as the logger writes them, where both channels are judged."""
        block, _own, shared = self.estimate
        return block.sampled(shared * block.scales, signals)[:, block.evaluation]

    @cached_property
    def motion(self) -> Motion:
        """States along the recording."""
        block, own, shared = self.estimate
        unlabelled = block.structure.model(shared * block.scales, block.point)
        s, data = block.labelled(own, unlabelled).s, block.data
        path = block.integrate(unlabelled, own, path=True).path
        path = path[:, :: block.over // block.stride][:, block.evaluation]
        first = RUNNING * block.point.frequency if not block.point.fresh else 0.0
        touching = path[V.W] > 0.0
        began = np.concatenate([[0], np.cumsum(touching[1:] & ~touching[:-1])])
        at = np.arange(data.force.size)[block.evaluation]
        return Motion(
            data.rate,
            block.point.frequency,
            path[V.Y],
            path[V.V1],
            path[V.V2],
            float(s[V.KL]) * np.maximum(path[V.W], 0.0),
            touching & (path[V.V2] > 0.0),
            data.phase + data.omega / data.rate * at,
            first + np.maximum(began - 1.0, 0.0),
            float(s[V.F_A]),
            float(s[V.F_B]),
            (float(s[V.M1]), float(s[V.M2])),
            *(float(s[i]) for i in (V.K, V.C, V.KL, V.KU)),
        )

    @cached_property
    def lost_speed(self) -> tuple[np.ndarray, Floats]:
        """Samples (windows,) of ``steady`` at which windows begin, and (windows,) m/s of the shaker beyond the model.

        With windows that are nearly free each says by itself how fast the shaker body is where it begins. What a model
        loses from one to the next, summed up, is an impulse that is missing over the shaker's mass.
        """
        block, own, shared = self.estimate
        free = replace(block, slack=RELAXED)
        own = free.estimate_states(shared, own)
        model = free.structure.model(shared * free.scales, free.point)
        begin, ends = free.begun(own, model)[:, V.V1], free.integrate(model, own).ends[:, V.V1]
        lost = np.concatenate([[0.0], np.cumsum(begin[1:] - ends[:-1])])
        at = block.data.starts[:-1] - block.evaluation.start
        inside = (at >= 0) & (at < self.left.shape[1])
        return at[inside].astype(int), lost[inside]

    def error(self, correction: Floats | float = 0.0) -> tuple[float, int]:
        """Sum of squares of what is left, in standard deviations of the noise, and its degrees of freedom.

        ``correction`` (2, n) is added to what the model reads, where both channels are judged.
        """
        block, own, _shared = self.estimate
        whole = np.zeros_like(block.measured)
        whole[:, block.evaluation] = self.left - correction
        # as a diagnosis weighs it: see Recorded.residual
        white = block.weighed(whole[:, block.evaluation])
        return float((white**2).sum()), white.size - own.size


def prepared(folder: Path, names: Collection[str] | None = None) -> Split:
    """Recordings of a campaign prepared as a diagnosis prepares them.

    ``names`` are those held out; where there are none, those that a diagnosis would hold out. Where it predicted each
    of a few by a fit to the others, the last.
    """
    campaign = read_campaign(folder)
    campaign, _left_out = sound_parts(campaign, check_quality(campaign))
    campaign, _shortened = excerpts(campaign)
    rig = nominal_rig(campaign)
    campaign, _unusable = without_unusable(campaign, rig)
    campaign, _labels = with_labels_corrected(campaign)
    data = conditioned(campaign.recordings, rig)
    held = {i for i, each in enumerate(data) if each.name in names} if names else held_out(data)
    held = held if len(held) < len(data) else {len(data) - 1}
    return Split(
        campaign,
        [each for i, each in enumerate(data) if i not in held],
        [each for i, each in enumerate(data) if i in held],
    )


def fitted_constants(split: Split, pool: Executor) -> Fitted:
    """The paper's model with its constants fitted to stretches of the recordings, priors as the lab states them."""
    return plain_fit(split.campaign, [each.first(STRETCH) for each in split.fitted], pool)


def fitted_freely(fitted: Fitted) -> Fitted:
    """The same without the tolerances that the lab states: nothing but the recordings says what the constants are.

    Masses are kept: what all forces of a motion scale with, the motion does not tell.
    """
    term = fitted.structure.terms[0]
    for unknown in term.unknowns:
        if not unknown.name.endswith("mass"):
            term = term.freed(unknown.name)
    structure: ModelStructure = replace(fitted.structure, terms=(term, *fitted.structure.terms[1:]))
    return fitted.refit(structure, limits=Limits(15, 0.1, 1e-4))


def followed(data: Sequence[Conditioned], fitted: Fitted, pool: Executor, known: bool = False) -> list[Followed]:
    """Recordings with only what is their own fitted; of those that are ``known`` the fit has the beginning."""
    return [Followed(each) for each in estimate_recordings(data, fitted, pool, known=known)]


def error_left(recordings: Sequence[Followed]) -> float:
    """Root of the reduced chi-square that the model leaves, as a report of a diagnosis states it."""
    return float(np.sqrt(chi_square([each.estimate for each in recordings])))
