"""Free laws: their smoothness, and the axes that they are over."""

import math

import numpy as np
import pytest

from drillenv.diagnosis.constants import NAMES, constants
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.laws import (
    CURVED,
    SOFT_LAYER,
    Curve,
    axes_of,
    families,
    kind_of_contact,
    moved_to,
    on_axes,
    wider,
)
from drillenv.diagnosis.resolution import most_likely_prior
from drillenv.diagnosis.tables import GRID, MARGIN, interpolate
from drillenv.diagnosis.terms import ModelStructure
from drillenv.dynamics.constitutive.places import MOUNT_SPRING, WAVEFORM
from drillenv.dynamics.hybrid.vector_field import OWN, U, Y
from drillenv.recordings import Nominal
from drillenv.rig import Rig

VALUES = (*(getattr(Rig(), name) for name in NAMES[:6]), 2e7, 3e7)
NOMINAL = {name: Nominal(value, 0.02 * value, "SI") for name, value in zip(NAMES, VALUES, strict=True)}


def made_axes():
    """Over ranges such as a rig visits."""
    rng = np.random.default_rng(0)
    path = rng.uniform(-1.0, 1.0, (OWN, 4000)) * np.array([1e-3, 0.3, 0.3, 1e-4, *[0.0] * (OWN - 4)])[:, None]
    path[Y] += 2e-3
    return axes_of([path], 400.0, [2e-3])


AXES = made_axes()


def test_a_motion_that_never_touches_the_rock_has_axes():
    """As is left of one that could not be followed."""
    axes = axes_of([np.zeros((OWN, 100))], 1.0, [0.0])
    assert np.isfinite(axes.low).all() and (axes.step > 0.0).all()


def test_a_mounts_law_is_drawn_over_the_deflections_that_it_takes():
    """Blows press it in by far more than it swings back: out there a law would be drawn by nothing, and may fall."""
    path = np.zeros((OWN, 1001))
    path[U] = np.linspace(-1e-5, 4e-5, 1001)
    ends = axes_of([path], 400.0, [0.0]).points(MOUNT_SPRING)[[0, -1]]
    assert ends == pytest.approx([-1e-5, 4e-5], abs=2e-7)


def curve(group, axes=AXES, **more) -> Curve:
    """The first curve of a family."""
    term = next(each for each in families(axes, [60.0, 80.0, 100.0], **more) if each.group == group).terms[0]
    assert isinstance(term, Curve)
    return term


@pytest.mark.parametrize("group", ["spring", "damper", "contact law", "drive", "guide"])
def test_functions_of_a_law_are_orthogonal_and_rise_in_roughness(group):
    term = curve(group)
    products = term.basis @ term.basis.T / GRID
    assert np.allclose(products, np.eye(len(term.basis)), atol=1e-6)
    assert np.all(np.diff(term.roughness) > -1e-12)


def test_noise_alone_is_smoothed_away_and_a_smooth_law_is_kept():
    rng, term = np.random.default_rng(3), curve("spring", detail=2)
    covariance = 4.0 * np.eye(len(term.basis))
    prior = most_likely_prior(rng.normal(0.0, 2.0, len(term.basis)), covariance, term.roughness)
    # all but the smoothest, which is nearly straight
    assert np.all(prior[1:] < 0.1 * 2.0)
    # a cubic, whose coefficients are as smooth as can be
    x = np.linspace(-1.0, 1.0, GRID)
    true = np.linalg.lstsq(term.basis.T, 20.0 * x**3)[0]
    errors = []
    for _ in range(50):
        found = true + rng.normal(0.0, 2.0, true.size)
        prior = most_likely_prior(found, covariance, term.roughness)
        smooth = found * prior**2 / (prior**2 + 4.0)
        errors.append((np.sum((found - true) ** 2), np.sum((smooth - true) ** 2)))
    plain, penalised = np.mean(errors, axis=0)
    assert penalised < 0.6 * plain


@pytest.mark.parametrize("group", ["spring", "damper", "contact law", "drive"])
def test_a_law_is_the_same_on_other_axes_and_straight_beyond(group):
    term = curve(group)
    own = np.random.default_rng(1).normal(0.0, 5.0, len(term.unknowns))
    before = ModelStructure((constants(NOMINAL), term), AXES, DRILL)
    after = on_axes(before, wider(AXES))
    x = AXES.points(term.place)
    law = own @ term.basis
    again = interpolate(own @ after.terms[1].basis, after.axes, term.place, x)
    assert np.max(np.abs(again - law)) < 5e-3 * np.ptp(law)
    # beyond the last point, as it rises there: against the position on the axis
    end = after.axes.points(term.place)[-1]
    assert end > x[-1] + 0.4 * np.ptp(x)
    position = (np.arcsinh(end / AXES.scale[term.place]) - AXES.low[term.place]) / AXES.step[term.place]
    expected = law[-1] + (min(position, GRID - 1 + MARGIN) - (GRID - 1)) * (law[-1] - law[-2])
    assert (own @ after.terms[1].basis)[-1] == pytest.approx(expected, abs=1e-6 * np.ptp(law))


def test_the_same_law_is_found_among_finer_functions():
    term, finer = curve("spring"), curve("spring", detail=2)
    own = np.random.default_rng(1).normal(0.0, 5.0, len(term.unknowns))
    left = moved_to(term, finer, own) @ finer.basis - own @ term.basis
    # but for a level, of which recordings say nothing
    assert np.ptp(left) < 0.02 * np.ptp(own @ term.basis)


@pytest.mark.parametrize("detail", [1, 2, 8])
def test_a_law_of_compaction_reaches_to_the_last_impact_and_ends_in_nothing(detail):
    basis = curve("compaction", detail=detail).basis
    assert np.all(np.any(np.abs(basis[:, :-1]) > 1e-12, axis=0))
    assert np.allclose(basis[:, -1], 0.0)


def test_a_waveform_of_the_lowest_resolution_holds_crossover_distortion():
    """No force while the drive changes its sign: a coarser waveform would lose to a curve over force."""
    theta = AXES.points(WAVEFORM)
    drive = np.sin(theta)
    lost = np.clip(drive, -0.15, 0.15)
    # what is of the first order, and constant, is of constants
    own = np.column_stack([drive, np.cos(theta), np.ones_like(theta)])
    lost = lost - own @ np.linalg.lstsq(own, lost)[0]
    basis = curve("waveform").basis.T
    left = lost - basis @ np.linalg.lstsq(basis, lost)[0]
    assert np.sqrt(np.mean(left**2)) < 0.2 * np.sqrt(np.mean(lost**2))


@pytest.mark.parametrize(
    ("group", "share", "true"),
    [
        ("drive", 0.8, lambda x, at: -np.maximum(x - at, 0.0)),  # clipped on the push
        ("spring", 0.3, lambda x, at: np.maximum(x - at, 0.0)),
        ("contact law", 0.4, lambda x, at: np.where(x <= at, -1.4, 0.0)),  # a toe of two lines
        ("guide", 0.9, lambda x, at: np.sign(x) * np.minimum(np.abs(x), at)),
        ("compaction", 0.9, lambda x, at: -0.4 * np.maximum(1.0 - x / at, 0.0)),  # a ramp
    ],
)
def test_a_law_with_a_corner_is_drawn_by_one_function_more(group, share, true):
    term = curve(group)
    x = AXES.points(term.place)
    at = float(x[round(share * (GRID - 1))])
    law = true(x, at)
    cornered = term.with_corner(term.corner(x, at))
    assert (cornered.corners, len(cornered.unknowns)) == (1, len(term.unknowns) + 1)
    assert np.array_equal(cornered.roughness, term.roughness)

    def left(columns) -> float:
        # where a spring is at rest, no recording says
        level = np.ones((1, GRID)) if group == "spring" else np.zeros((0, GRID))
        columns = np.vstack([columns, level]).T
        return float(np.sqrt(np.mean((law - columns @ np.linalg.lstsq(columns, law)[0]) ** 2)))

    assert left(cornered.basis) < 0.2 * left(term.basis)
    zeros = [i for i in (0, (GRID - 1) // 2, GRID - 1) if np.all(np.abs(term.basis[:, i]) < 1e-9)]
    assert np.all(np.abs(cornered.basis[-1, zeros]) < 1e-9)


def test_a_waveform_with_corners_is_drawn_by_a_function_for_each():
    """A drive without force where little is asked; what of that is a sine, or a constant, the rig's constants say."""
    term = curve("waveform")
    x = AXES.points(WAVEFORM)
    asked, dead = np.sin(x), 0.2
    law = -np.clip(asked, -dead, dead)
    cornered = term
    for at in (math.asin(dead), math.pi - math.asin(dead), math.pi + math.asin(dead), 2.0 * math.pi - math.asin(dead)):
        corner = cornered.corner(x, at)
        assert corner.any() and corner[0] == pytest.approx(corner[-1], abs=1e-9)
        cornered = cornered.with_corner(corner)

    def left(columns) -> float:
        columns = np.vstack([columns, np.ones(GRID), np.sin(x), np.cos(x)]).T
        return float(np.sqrt(np.mean((law - columns @ np.linalg.lstsq(columns, law)[0]) ** 2)))

    assert left(cornered.basis) < 0.1 * left(term.basis)


SOFTEST = 0.02
FORCE = np.linspace(0.0, 1.0, GRID)
"""Of the rock, over the largest."""


@pytest.mark.parametrize(
    ("stiffness", "kind"),
    [
        (np.where(FORCE < 0.1, 0.2, 1.0), SOFT_LAYER),  # two lines
        (np.minimum(0.2 + 4.0 * np.sqrt(FORCE), 1.0), SOFT_LAYER),  # a parabola, then straight
        (1.0 - 0.9 * np.exp(-FORCE / 0.05), SOFT_LAYER),
        (1.2 * (1.0 - 0.9 * np.exp(-FORCE / 0.05)), SOFT_LAYER),  # the stated stiffness is a fifth off
        (np.where(FORCE < 0.02, 1.6, np.where(FORCE < 0.6, 0.24, 1.0)), SOFT_LAYER),  # hardly seen at first
        (np.where(FORCE < 0.4, 1.0, 1.5), CURVED),  # stiffer than the rock is stated to be, beyond a depth
        (1.3 * np.maximum(FORCE, SOFTEST) ** (1.0 / 3.0), CURVED),  # a power of the depth of 3/2
        (0.9 * np.maximum(FORCE, SOFTEST) ** (-0.25), CURVED),  # of 4/5
        (np.linspace(1.2, 0.8, GRID), CURVED),
    ],
)
def test_a_soft_layer_ends_in_the_stiffness_of_the_rock(stiffness, kind):
    assert kind_of_contact(np.log(stiffness)) == kind
