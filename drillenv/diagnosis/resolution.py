"""How finely a measured law is drawn: as finely as the recordings call for, and as smooth as they allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drillenv.diagnosis.fitting import SHORT, Fitted, penalty
from drillenv.diagnosis.laws import Curve, Equivalent, Family, Gain, coefficients, moved_to, on_axes
from drillenv.diagnosis.score_tests import most_promising
from drillenv.diagnosis.solver import Floats
from drillenv.diagnosis.tables import GRID
from drillenv.diagnosis.terms import ModelStructure

DETAILS = (2, 4, 8)
"""Resolutions of a free law that are tried."""
CORNERS = 4
"""Of a law, at most."""
PLACES_TRIED = 40
"""On the axis of a law, where its corner may be."""


def refined(fitted: Fitted, family: Family) -> Fitted:
    """The same family over what motions visit now, of a higher resolution as long as that is seen."""
    if not any(isinstance(each, Curve | Gain) for each in family.terms):
        return fitted
    rig, axes, coarser = fitted.structure.rig, fitted.structure.axes, family.size - 1
    fitted = with_corners(fitted, family)
    for detail in (1, *DETAILS):
        size = next(each.size for each in rig.laws(fitted, axes, detail) if each.name == family.name)
        if size <= coarser:
            # the law is as fine already
            continue
        coarser = size
        finer = with_detail(fitted, family, detail)
        more = finer.fit.shared.size - fitted.fit.shared.size
        if finer.cost < fitted.cost - penalty(more, fitted):
            fitted = with_corners(finer, family)
        elif more > 0:
            break
    return smoothed(fitted, family)


def with_corners(fitted: Fitted, family: Family) -> Fitted:
    """The same with corners in the family's laws where they are seen, each where its score test gains most.

    A law that is smooth but for a corner would else need as fine a resolution everywhere as there. A corner has to gain
    what two parameters have to, its size and its place.
    """
    places = np.linspace(0.0, GRID - 1.0, PLACES_TRIED + 2)[1:-1]
    around = (places[1] - places[0]) * np.linspace(-1.0, 1.0, PLACES_TRIED)
    for _ in range(CORNERS):
        curves = [each for each in fitted.structure.current(family.terms) if isinstance(each, Curve)]
        found = best_corner(fitted, [(each, at) for each in curves for at in places])
        found = found and best_corner(fitted, [(found[0], at) for at in found[1] + around])
        other = found and with_corner(fitted, *found)
        if other is None or other.cost > fitted.cost - penalty(2, fitted):
            return fitted
        fitted = other
    return fitted


def best_corner(fitted: Fitted, tried: Sequence[tuple[Curve, float]]) -> tuple[Curve, float] | None:
    """Of corners of curves at positions on their axes the one that promises most; None where none is seen."""
    terms, seen = [], []
    for i, (curve, at) in enumerate(tried):
        corner = corner_at(fitted, curve, at)
        if corner.any():
            single = coefficients(f"corner {i}", 1, curve.unknowns[0].scale)
            terms.append(Curve(f"corner {i}", single, curve.place, corner[None, :]))
            seen.append((curve, at))
    if not terms:
        return None
    best, gain = most_promising(fitted, terms)
    return seen[best] if gain > penalty(2, fitted) else None


def corner_at(fitted: Fitted, curve: Curve, at: float) -> Floats:
    """(GRID,) a corner at a position on the curve's axis."""
    x = fitted.structure.axes.points(curve.place)
    return curve.corner(x, float(np.interp(at, np.arange(GRID), x)))


def with_corner(fitted: Fitted, curve: Curve, at: float) -> Fitted:
    """The fit with a corner of a curve at a position on its axis."""
    terms, start = [], []
    for term, own in zip(fitted.structure.terms, fitted.structure.split(fitted.fit.shared), strict=True):
        with_it = term.name == curve.name
        terms.append(curve.with_corner(corner_at(fitted, curve, at)) if with_it else term)
        start.append(np.append(own, 0.0) if with_it else own)
    return fitted.refit(replace(fitted.structure, terms=tuple(terms)), np.concatenate(start), SHORT)


def smoothed(fitted: Fitted, family: Family) -> Fitted:
    """The same with laws that are as smooth as makes their coefficients most likely.

    The roughness penalty of P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89-121, as a prior, whose
    scale has the largest marginal likelihood (S. N. Wood, Journal of the Royal Statistical Society B 73 (2011) 3-36)
    by the quadratic of the log-likelihood about the fit.
    """
    names, terms = {each.name for each in family.terms}, []
    covariance = fitted.fit.covariance * max(1.0, fitted.reduced_chi_square)
    for term, inside in zip(fitted.structure.terms, fitted.structure.parts, strict=True):
        if isinstance(term, Curve) and term.name in names:
            smooth = slice(inside.start, inside.stop - term.corners)
            stds = most_likely_prior(fitted.fit.shared[smooth], covariance[smooth, smooth], term.roughness)
            unknowns = zip(term.unknowns, stds, strict=False)
            as_smooth = tuple(each._replace(std=each.scale * std) for each, std in unknowns)
            term = replace(term, unknowns=as_smooth + term.unknowns[len(as_smooth) :])
        terms.append(term)
    return fitted.refit(replace(fitted.structure, terms=tuple(terms)))


def most_likely_prior(found: Floats, covariance: Floats, roughness: Floats) -> Floats:
    """Standard deviations (m,) of a law's coefficients, in inverse proportion to the root of their roughness.

    ``found`` (m,) are the coefficients as fitted, with their ``covariance`` (m, m).
    """
    shape = 1.0 / np.sqrt(np.maximum(roughness / roughness.max(), 1e-8))

    def surprise(scale: float) -> float:
        whole = covariance + np.diag((scale * shape) ** 2)
        factor = np.linalg.cholesky(whole)
        return float(np.log(np.diag(factor)).sum() + 0.5 * np.sum(np.linalg.solve(factor, found) ** 2))

    size = float(np.sqrt(np.mean(found**2))) + 1e-12
    return shape * min(size * np.geomspace(1e-4, 1e2, 61), key=surprise)


def with_detail(fitted: Fitted, family: Family, detail: int) -> Fitted:
    """The same family over what motions visit now, of so many times the resolution.

    From constants as stated, what is straight in them being the law's, or where that does not lead back to as good a
    fit, from constants as they are.
    """
    rig = fitted.structure.rig
    known = on_axes(fitted.structure, rig.axes_at(fitted))
    places = [each.place for each in family.terms if isinstance(each, Curve)]
    found = _on_finer(fitted, known, rig.reparametrise_to_nominal(known, fitted.values, places), family, detail)
    if found.cost > fitted.cost:
        as_they_are = Equivalent(known.axes, fitted.values, {})
        found = min(found, _on_finer(fitted, known, as_they_are, family, detail), key=lambda each: each.cost)
    return found


def _on_finer(fitted: Fitted, known: ModelStructure, same: Equivalent, family: Family, detail: int) -> Fitted:
    """The fit of a family's law at a resolution, from parameters that are the ``same`` motion as a fit's."""
    finer = next(each for each in known.rig.laws(fitted, same.axes, detail) if each.name == family.name)
    terms, start = [], []
    for term, own in zip(known.terms, known.split(same.values), strict=True):
        other = next((each for each in finer.terms if each.name == term.name), term)
        if isinstance(term, Curve) and isinstance(other, Curve) and other is not term:
            for corner in term.basis[len(term.basis) - term.corners :]:
                other = other.with_corner(corner)
        more = same.more.get(term.place, 0.0) if isinstance(term, Curve) and other is not term else 0.0
        terms.append(other)
        start.append(moved_to(term, other, own, more) / other.scales)
    structure, begun = replace(known, terms=tuple(terms), axes=same.axes), np.concatenate(start)
    return fitted.refit(structure, begun, states_first=True)
