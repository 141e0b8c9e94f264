"""The alternatives on one campaign of a trial, marked by its rules."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.alternatives import sparse, unnamed
from benchmarks.alternatives.candidates import candidates
from benchmarks.alternatives.following import (
    Followed,
    error_left,
    fitted_constants,
    fitted_freely,
    followed,
    prepared,
)
from drillenv.blind import marking
from drillenv.checks import InputError
from drillenv.diagnosis.drill_diagnosis import wrong_constants
from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.thresholds import LEFT

DIAGNOSIS, CONSTANTS, FREE = "diagnosis", "constants fitted", "constants fitted freely"
SPARSE, PROCESS = "sparse regression", "Gaussian process"
METHODS = (DIAGNOSIS, CONSTANTS, FREE, SPARSE, PROCESS)
NAMING = (DIAGNOSIS, SPARSE)
"""Methods that name mechanisms."""
LEFT_HELD_OUT = math.sqrt(1.0 + 2.0 * LEFT)
"""Times the noise on recordings held out from which a diagnosis takes something to be left."""


@dataclass(frozen=True)
class Answer:
    """What a method says of a campaign."""

    seconds: float
    """Of processor time, all that it needs from the campaign's folder on."""
    error: float | None
    """Root of the reduced chi-square of the recordings held out; None where it predicts none."""
    named: bool = False
    """Whether the campaign is right by naming."""
    mechanisms: Mapping[str, str] | None = None
    """What became of each mechanism that was concealed; None of a method that names nothing."""
    findings: Sequence[str] = ()
    false: Sequence[str] = ()


class Begun(NamedTuple):
    """What all alternatives begin from."""

    fitted: Fitted
    known: list[Followed]
    held: list[Followed]


def of_diagnosis(mark: Mapping[str, Any]) -> Answer:
    """What the diagnosis of a trial said, by its mark."""
    held = ((mark.get("fit") or {}).get("held_out") or {}).get("after")
    return Answer(
        mark["seconds"], held, mark["named"], dict(mark["mechanisms"]), list(mark["findings"]), list(mark["false"])
    )


def compared(folder: Path, mark: Mapping[str, Any], answer: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """A row: every method's answer to a campaign.

    Args:
        folder: Of the campaign.
        mark: Of the diagnosis in the trial.
        answer: What is true.
        seed: Of what is drawn.
    """
    held_out = (mark.get("fit") or {}).get("held_out") or {}
    row: dict[str, Any] = {
        "campaign": mark["campaign"],
        "group": mark["group"],
        "truth": mark["truth"],
        "refused": None,
        "scale": 1.0,
        "answers": {DIAGNOSIS: asdict(of_diagnosis(mark))},
    }
    with threadpool_limits(1), ThreadPoolExecutor(1) as pool:
        try:
            found, scale = alternatives(folder, held_out, answer, np.random.default_rng(seed), pool)
        except (InputError, ArithmeticError, ValueError) as error:
            # as in the trial, what ends in an error is no answer
            found, scale = {}, 1.0
            row["refused"] = f"{type(error).__name__}: {error}"[:300]
    unanswered = Answer(0.0, None, False, dict.fromkeys(mark["mechanisms"], "no answer"))
    answers = {name: found.get(name, unanswered) for name in METHODS if name != DIAGNOSIS}
    row["answers"] |= {name: asdict(each) for name, each in answers.items()}
    return row | {"scale": scale}


def alternatives(
    folder: Path, held_out: Mapping[str, Any], answer: Mapping[str, Any], rng: np.random.Generator, pool: Executor
) -> tuple[dict[str, Answer], float]:
    """Answers by method, and by how much their errors were scaled to be in the report's unit."""
    clock = time.process_time()
    split = prepared(folder, held_out.get("recordings"))
    fitted = fitted_constants(split, pool)
    held = followed(split.held, fitted, pool)
    plain, by_plain = error_left(held), time.process_time() - clock
    scale = unit_of(held_out.get("before"), plain)
    known = followed(split.fitted, fitted, pool, known=True)
    to_states = time.process_time() - clock
    begun = Begun(fitted, known, held)
    found = {CONSTANTS: Answer(by_plain, scaled(plain, scale))}
    clock = time.process_time()
    freely = error_left(followed(split.held, fitted_freely(fitted), pool))
    found[FREE] = Answer(by_plain + time.process_time() - clock, scaled(freely, scale))
    clock = time.process_time()
    made, error = by_sparse_regression(begun, rng)
    spent = to_states + time.process_time() - clock
    found[SPARSE] = marked(made, scaled(error, scale), spent, begun, answer)
    clock = time.process_time()
    model = unnamed.learned(known, "gaussian process", rng)
    error = corrected(held, [unnamed.correction(model, each) for each in held])
    found[PROCESS] = Answer(to_states + time.process_time() - clock, scaled(error, scale))
    return found, scale


def by_sparse_regression(begun: Begun, rng: np.random.Generator) -> tuple[sparse.Found, float]:
    """What the regression has found, and its error on the recordings held out."""
    columns = [candidates(each) for each in begun.known]
    found = sparse.sparse_regression(begun.known, columns, sparse.Settings(), rng)
    return found, corrected(begun.held, [sparse.correction(found, candidates(each)) for each in begun.held])


def corrected(held: Sequence[Followed], corrections: Sequence[np.ndarray]) -> float:
    """Root of the reduced chi-square of recordings with corrected readings."""
    left = [each.error(correction) for each, correction in zip(held, corrections, strict=True)]
    total, freedom = (sum(each) for each in zip(*left, strict=True)) if left else (math.nan, 1)
    return math.sqrt(total / max(freedom, 1))


def unit_of(reported: float | None, own: float) -> float:
    """By what errors are multiplied to be in the noise of a report.

    The report states what the paper's model leaves of the same recordings, by the noise that the model found leaves;
    ``own`` is the same by the noise that the paper's model leaves.
    """
    return reported / own if reported and math.isfinite(own) and own > 0.0 else 1.0


def scaled(error: float, scale: float) -> float | None:
    """An error in the report's unit."""
    return round(scale * error, 4) if math.isfinite(error) else None


def marked(found: sparse.Found, error: float | None, seconds: float, begun: Begun, answer: Mapping[str, Any]) -> Answer:
    """The regression's answer by the rules of the trial.

    Its verdict is that physics is missing where it names a mechanism, else unexplained where the recordings held out
    show more than the noise, else that of the fitted constants.
    """
    off = wrong_constants(begun.fitted)
    verdict = "parameters" if off else "agrees"
    if error is None or error > LEFT_HELD_OUT:
        verdict = "unexplained"
    if found.named:
        verdict = "missing-physics"
    spread = np.sqrt(np.maximum(np.diag(begun.fitted.fit.covariance), 0.0))
    unknowns = begun.fitted.structure.unknowns
    stated = {
        unknowns[i].name: {"value": float(begun.fitted.values[i]), "std": float(spread[i] * unknowns[i].scale)}
        for i in off
    }
    report = {
        "verdict": verdict,
        "findings": [{"mechanism": name} for name in found.named],
        "parameters": stated if verdict == "parameters" else {},
    }
    mark = marking.mark(answer, {"status": "answered", "seconds": seconds, "memory_mib": 0.0}, report)
    return Answer(seconds, error, mark["named"], dict(mark["mechanisms"]), mark["findings"], mark["false"])
