"""The noise of a single body's force balance: what the richest model leaves, lines aside."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.ndimage import median_filter

from drillenv.diagnosis.body import Autoregression, Nonlinear, Stretch, autoregression, columns_of
from drillenv.diagnosis.body_channels import Body
from drillenv.diagnosis.body_rig import BodyRig
from drillenv.diagnosis.noise import line_columns, peak_offset
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.terms import Term
from drillenv.diagnosis.thresholds import REPORTED_LINE

ROUNDS = 4
"""Of the estimate of the noise and the richest model's fit."""
RICHEST = (4, 2, 1)
"""Resolutions of free laws that the richest model may have."""
PER_PARAMETER = 4.0
"""Independent rows for each parameter of the richest model, at least."""
ENOUGH = 2.0
"""The same of those that are judged by the noise of the round before."""
MOST_LINES = 4
SHORTEST, MOVES = 128, 0.05
"""Rows of a recording in which a frequency is looked for, and the share of the power of the speed from which it is the
motion's own."""


def noise_of_richest(rig: BodyRig, law: Sequence[Term]) -> Autoregression:
    """What a model with every family leaves, and the fit that is weighed by it, by turns.

    D. Cochrane and G. H. Orcutt, Journal of the American Statistical Association 44 (1949) 32-61. Its laws are as fine
    as there are rows enough for; lines that stand out of what is left are no noise.
    """
    stretches = rig.stretches
    rows = rig.band * sum(int(each.keep.sum()) for each in stretches)
    for detail in RICHEST:
        families = [*rig.laws(None, rig.axes, detail), *rig.sensors(), *rig.outside()]
        terms = [*law, *(term for each in families for term in each.terms if not isinstance(term, Nonlinear))]
        if rows > PER_PARAMETER * sum(len(each.unknowns) for each in terms):
            break
    else:
        terms = list(law)
    made = [np.concatenate([columns_of(term, each.body, rig.axes) for term in terms]) for each in stretches]
    noise = Autoregression(np.zeros(0), 1.0)
    lines: list[list[float]] = [[] for _ in stretches]
    for turn in range(ROUNDS):
        own = [waves_of(each.body, frequencies) for each, frequencies in zip(stretches, lines, strict=True)]
        judged = [noise.judged(each.keep) for each in stretches]
        parameters = len(made[0]) + sum(map(len, own))
        if turn > 0 and noise.share * sum(int(keep.sum()) for keep in judged) < ENOUGH * parameters:
            # rows that are judged tell the model no more: those before them that the noise asks for are not kept
            break
        shared = [noise.whiten(rows)[:, keep] for rows, keep in zip(made, judged, strict=True)]
        alone = [noise.whiten(rows)[:, keep] for rows, keep in zip(own, judged, strict=True)]
        pairs = zip(stretches, judged, strict=True)
        measured = np.concatenate([noise.whiten(each.measured)[keep] for each, keep in pairs])
        # each stretch has amplitudes of its own
        table = np.vstack([np.hstack(shared), np.asarray(block_diag(*alone))]).T
        sizes = np.linalg.norm(table, axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        found = np.linalg.lstsq(table / sizes, measured, rcond=1e-8)[0] / sizes
        common, *amplitudes = np.split(found, len(made[0]) + np.cumsum([0] + [len(rows) for rows in own[:-1]]))
        parts = zip(stretches, made, own, amplitudes, strict=True)
        left = [each.measured - common @ rows - amplitude @ waves for each, rows, waves, amplitude in parts]
        noise = autoregression(left, [each.keep for each in stretches], rig.band)
        independent = noise.share * sum(int(noise.judged(each.keep).sum()) for each in stretches)
        noise = noise._replace(std=noise.std / math.sqrt(max(1.0 - table.shape[1] / independent, 0.5)))
        if turn == 0:
            lines = [lines_in(each, rows) for each, rows in zip(stretches, left, strict=True)]
    return noise


def waves_of(body: Body, frequencies: Sequence[float]) -> Floats:
    """(2 frequencies, n) sine and cosine of each in Hz."""
    return line_columns(frequencies, body.rate / body.every, body.time.size)


def lines_in(data: Stretch, left: Floats) -> list[float]:
    """Hz of lines that stand far out of what is left of a stretch."""
    signal, found = np.where(data.keep, left, 0.0), []
    per_row = data.body.rate / data.body.every
    for _ in range(MOST_LINES):
        tone = strongest_line(signal, per_row)
        if tone is None:
            break
        found.append(tone[0])
        waves = waves_of(data.body, found)[:, data.keep]
        signal[data.keep] = left[data.keep] - np.linalg.lstsq(waves.T, left[data.keep])[0] @ waves
    return found


def strongest_line(signal: Floats, rate: float) -> tuple[float, float, int] | None:
    """Hz, share of the power and the place of the largest line of a signal (n,), where it stands far out."""
    if signal.size < SHORTEST:
        return None
    power = np.abs(np.fft.rfft(signal * np.hanning(signal.size))) ** 2
    stands = power > math.log(power.size / 1e-4) / math.log(2.0) * median_filter(power, 41, mode="nearest")
    stands[:3] = stands[-3:] = False
    top = int(np.argmax(np.where(stands, power, 0.0)))
    if not stands[top]:
        return None
    share = float(power[top - 2 : top + 3].sum() / power[1:].sum())
    place = top + peak_offset(*np.log(power[top - 1 : top + 2] + 1e-300))
    return place * rate / signal.size, share, top


def line(body: Body, left: Floats) -> tuple[float, float] | None:
    """Hz and share of the power of a frequency that stands far out of what is left of a recording, if one does.

    One at which the body mostly moves is not meant: whatever depends on the motion has it.
    """
    signal = np.where(body.keep, left, 0.0)
    tone = strongest_line(signal, body.rate / body.every)
    if tone is None or tone[1] < REPORTED_LINE:
        return None
    for motion in (body.velocity, np.abs(body.velocity) - np.abs(body.velocity).mean()):
        power = np.abs(np.fft.rfft(motion * np.hanning(motion.size))) ** 2
        if power[tone[2] - 1 : tone[2] + 2].sum() > MOVES * power[1:].sum():
            return None
    return tone[:2]
