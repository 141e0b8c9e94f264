"""What a search has found, as records of a report, whatever the rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drillenv.diagnosis.fitting import Fitted
from drillenv.diagnosis.laws import Equation
from drillenv.diagnosis.score_tests import ScoreTests
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.steps import Step
from drillenv.diagnosis.terms import Term
from drillenv.diagnosis.thresholds import EQUAL, MOST_OF_LAW
from drillenv.dynamics.effects import Effect


def deviations(fitted: Fitted) -> Floats:
    """Standard deviations of all parameters, in their units."""
    scales = fitted.structure.scales
    return np.sqrt(np.diag(fitted.covariance)) * scales


def cited(effect: Effect, exact: bool) -> dict[str, str]:
    """The equation of a mechanism, where its law follows it, and where that is published."""
    equation = effect.equation if exact else "none of the library's: see the law"
    return {"equation": equation, "source": effect.source}


def form_of(step: Step) -> str:
    """The equation that the law follows, or ``measured``."""
    equation = step.named.equation
    if equation is None:
        return "measured"
    return equation.form.name if isinstance(equation, Equation) else "library"


def parameters_of(fitted: Fitted, equation: Term) -> dict[str, Any]:
    """Parameters of an equation, or of a law in words of its own, by symbol."""
    inside = fitted.indices_of([equation])
    term = fitted.structure.current([equation])[0]
    return term.stated(fitted.values[inside], deviations(fitted)[inside])


def equivalents(step: Step) -> list[str]:
    """Mechanisms that these recordings cannot tell from the one that is named.

    A law that follows no equation is as well of any other mechanism whose equation explains most of it.
    """
    tried = step.named.tried
    if step.named.equation is None:
        most = MOST_OF_LAW * step.gain
    else:
        most = min((each.worse for each in tried), default=0.0) + EQUAL
    named = {each.equation.effect for each in tried if each.worse < most}
    close = [family for family, worse in step.rivals if worse < EQUAL and not family.constant]
    alike = named | {family.mechanism for family in close}
    # what sensors do by no mechanism of the library has no name
    return sorted((alike | {*step.named.alike}) - {step.named.mechanism, ""})


def rejected(steps: Sequence[Step], tested: ScoreTests) -> list[dict[str, str]]:
    """Families that were passed over, with the reason."""
    said = []
    for step in steps:
        for family, worse in step.rivals:
            said.append({"mechanism": family.mechanism, "why": f"explains less (log-likelihood lower by {worse:.0f})"})
    for score in tested.scores[:8]:
        why = "gains too little" if score.confirmed else "gains nothing on recordings that it was not fitted to"
        why += f" (log-likelihood {score.gain:.1f}, p {score.p:.2g})"
        said.append({"mechanism": score.family.mechanism, "why": why})
    return said
