"""Free laws: their smoothness, and what is straight in them."""

import numpy as np
import pytest

from drillenv.diagnosis import predict
from drillenv.diagnosis.constants import NAMES, constants
from drillenv.diagnosis.laws import Curve, as_stated, axes_of, families, moved_to
from drillenv.diagnosis.selection import most_likely_prior
from drillenv.diagnosis.terms import Hypothesis
from drillenv.recordings import Nominal
from drillenv.rig import Rig

VALUES = (*(getattr(Rig(), name) for name in NAMES[:6]), 2e7, 3e7)
NOMINAL = {name: Nominal(value, 0.02 * value, "SI") for name, value in zip(NAMES, VALUES, strict=True)}


def made_axes():
    """Over ranges such as a rig visits."""
    rng = np.random.default_rng(0)
    path = rng.uniform(-1.0, 1.0, (predict.STATES, 4000)) * np.array([1e-3, 0.3, 0.3, 1e-4, 0.0, 0.0, 0.0])[:, None]
    path[predict.Y] += 2e-3
    return axes_of([path], 400.0, [2e-3])


AXES = made_axes()


def curve(group, axes=AXES, **more) -> Curve:
    """The first curve of a family."""
    term = next(each for each in families(axes, [60.0, 80.0, 100.0], **more) if each.group == group).terms[0]
    assert isinstance(term, Curve)
    return term


@pytest.mark.parametrize("group", ["spring", "damper", "contact-law", "force-limit", "guide-friction"])
@pytest.mark.parametrize("projected", [True, False])
def test_functions_of_a_law_are_orthogonal_and_rise_in_roughness(group, projected):
    term = curve(group, projected=projected)
    products = term.basis @ term.basis.T / predict.GRID
    assert np.allclose(products, np.eye(len(term.basis)), atol=1e-6)
    assert np.all(np.diff(term.roughness) > -1e-12)


def test_noise_alone_is_smoothed_away_and_a_smooth_law_is_kept():
    rng, term = np.random.default_rng(3), curve("spring", projected=False, detail=2)
    covariance = 4.0 * np.eye(len(term.basis))
    prior = most_likely_prior(rng.normal(0.0, 2.0, len(term.basis)), covariance, term.roughness)
    # all but the smoothest, which is nearly straight
    assert np.all(prior[1:] < 0.1 * 2.0)
    # a cubic, whose coefficients are as smooth as can be
    x = np.linspace(-1.0, 1.0, predict.GRID)
    true = np.linalg.lstsq(term.basis.T, 20.0 * x**3)[0]
    errors = []
    for _ in range(50):
        found = true + rng.normal(0.0, 2.0, true.size)
        prior = most_likely_prior(found, covariance, term.roughness)
        smooth = found * prior**2 / (prior**2 + 4.0)
        errors.append((np.sum((found - true) ** 2), np.sum((smooth - true) ** 2)))
    plain, penalised = np.mean(errors, axis=0)
    assert penalised < 0.6 * plain


@pytest.mark.parametrize(("group", "constant"), [("spring", 2), ("backlash", 2), ("damper", 3)])
def test_a_constant_and_what_is_straight_in_its_law_are_the_same(group, constant):
    """Bent in the law's place, a constant comes back, and the sum of both is what it was but for a level."""
    term = curve(group)
    hypothesis = Hypothesis((constants(NOMINAL), term), AXES)
    own = np.random.default_rng(1).normal(0.0, 5.0, len(term.unknowns))
    values = np.append(VALUES, own)
    values[constant] *= 1.1
    same = as_stated(hypothesis, values, [term])
    assert same.values[constant] == VALUES[constant]
    other = curve(group, same.axes, projected=False)
    moved = moved_to(term, other, own, same.more[term.name])
    before = values[constant] * AXES.points(term.place) + own @ term.basis
    after = VALUES[constant] * same.axes.points(term.place) + moved @ other.basis
    left = before - after
    if group != "damper":
        # where the spring is at rest has moved, so that there is no level left
        assert abs(np.mean(left)) < 1e-6 * np.abs(before).max()
    left = left - left.mean()
    # splines of one basis and of the other are nearly the same
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean((before - before.mean()) ** 2))
