"""A recording as a block of the solver: its derivatives where the coupling has a law of its own."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drillenv import Rig
from drillenv.diagnosis import drill
from drillenv.diagnosis.adapter import RecordingProblem
from drillenv.diagnosis.condition import condition
from drillenv.diagnosis.coupling import (
    ADDED,
    closing_speed,
    damper_force,
    is_invertible,
    shortening,
    spring_coordinate,
)
from drillenv.diagnosis.drill_states import better_from_steady_motion, with_other_states_going_on
from drillenv.diagnosis.drill_unknowns import MASSES, first_states, resized, states_under
from drillenv.diagnosis.fitting import RELAXED, TIGHT
from drillenv.diagnosis.laws import Curve, axes_of, equations, families, on_axes, reparametrise_to_nominal, wider
from drillenv.diagnosis.sensing import sensor_families
from drillenv.diagnosis.sinusoids import KINDS
from drillenv.diagnosis.sinusoids import family as at_frequency
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.dynamics.constitutive.places import DAMPER, DRIVE, SPRING, SPRING_FROM_REST
from drillenv.dynamics.hybrid.vector_field import F_A, F_B, OWN, K, Y
from tests.diagnosis.test_diagnose import campaign_with, nominal_block

FREQUENCIES = (60.0, 90.0, 120.0)


@pytest.fixture(scope="module")
def plain():
    """A recording with the paper's model, joined, and where its windows begin."""
    campaign = campaign_with()
    block = replace(nominal_block(campaign, condition(campaign.recordings[0], Rig())), slack=1.0)
    shared = np.array([each.value / each.scale for each in block.structure.unknowns])
    return block, shared, block.estimate_states(shared, block.rollout(shared, first_states(block.data)))


def test_states_stay_what_they_are_beside_many_lines(plain):
    """As many amplitudes of lines as states of as many windows again."""
    block, shared, _own = plain
    data = block.data.first(3)
    noise = tuple(replace(each, lines=(150.0, 210.0, 330.0, 510.0)) for each in block.noise)
    problem = replace(block, data=data, noise=noise)
    own = resized(first_states(data), 3, MASSES, MASSES, len(problem.lines))
    own[-len(problem.lines) :] = np.arange(len(problem.lines))
    assert len(problem.lines) >= 5 * problem.windows
    other, kept = problem.under(problem.structure, own)
    assert np.array_equal(kept, own)
    assert other.cost(shared, kept) == problem.cost(shared, own)


def test_a_rig_that_runs_begins_as_it_goes_on(plain):
    """Though it was begun with a coupling that is deflected by 150 N too much, and a pressure to hold that."""
    block, shared, own = plain
    states, pressure = block.states_of(own).copy(), block.windows * block.state_count(own)
    states[0, Y] += 150.0
    astray = np.append(states.ravel(), own[pressure:])
    astray[pressure] += 20.0
    astray = block.rollout(shared, astray)
    cost = block.cost(shared, astray)
    assert cost > 100.0 * block.cost(shared, own)
    found = better_from_steady_motion(block, shared, astray, cost)
    assert block.cost(shared, found) == pytest.approx(block.cost(shared, own), rel=0.01)
    # what is better as it is stays
    assert better_from_steady_motion(block, shared, own, block.cost(shared, own)) is own


def test_states_that_continuity_ties_are_no_free_unknowns(plain):
    """Of a motion those of its first window are free, of windows that are nearly free all of the masses."""
    block, _shared, own = plain
    assert block.free_unknowns(own) == MASSES + block.locals
    loose = replace(block, slack=RELAXED)
    assert loose.free_unknowns(own) == own.size


def with_law(plain, group):
    """The same with a law of the coupling, its own unknowns on the way to their best."""
    block, shared, own = plain
    model = block.structure.model(shared * block.scales, block.point)
    path = block.integrate(model, own, path=True).path[:, : block.inside.stop // block.stride]
    path = path[:, block.inside.start // block.stride :].copy()
    # room for what a law does to the shortening
    path[Y] += 3.0 * (path[Y] - path[Y].mean())
    axes = axes_of([path], model.s[F_A], [model.s[F_B] / model.s[K]])
    law = next(each for each in families(axes, FREQUENCIES) if each.group == group)
    block = replace(block, structure=replace(block.structure, terms=(*block.structure.terms, *law.terms), axes=axes))
    shared = np.concatenate([shared, [1.0, -0.5], np.zeros(law.size - 2)])
    return block, shared, block.estimate_states(shared, own, 4)


@pytest.mark.parametrize("group", ["spring", "play", "damper"])
def test_a_law_on_wider_axes_moves_the_same(plain, group):
    block, shared, own = with_law(plain, group)
    other = replace(block, structure=on_axes(block.structure, wider(block.structure.axes)))
    one, two = (
        each.integrate(each.structure.model(shared * each.scales, each.point), own).signals for each in (block, other)
    )
    assert np.sqrt(np.mean((one - two) ** 2)) < 2e-4 * np.sqrt(np.mean(one**2))


@pytest.mark.parametrize(
    ("group", "wrong"),
    [("spring", (2,)), ("damper", (3,)), ("drive", (4,)), ("contact law", (6,)), ("contact law", (6, 7))],
)
def test_a_law_takes_up_what_constants_are_off(plain, group, wrong):
    """Constants that are a few hundredths off, and what they are off in the law instead."""
    block, shared, own = with_law(plain, group)
    shared[list(wrong)] *= 1.03
    values = shared * block.scales
    places = [each.place for each in block.structure.terms if isinstance(each, Curve)]
    same = reparametrise_to_nominal(block.structure, values, places)
    stated = np.array([each.value for each in block.structure.terms[0].unknowns])
    assert np.allclose(same.values[:8], stated)
    structure = replace(block.structure, axes=same.axes)
    model, other = (
        block.structure.model(values, block.point),
        structure.model(same.values, block.point),
    )
    for place, more in same.more.items():
        other.free[place] += more
    one = block.integrate(model, own).signals
    two = replace(block, structure=structure).integrate(other, own).signals
    assert np.sqrt(np.mean((one - two) ** 2)) < 1e-3 * np.sqrt(np.mean(one**2))


@pytest.mark.parametrize("group", ["spring", "play", "damper"])
def test_derivatives_beside_a_law_of_the_coupling(plain, group, monkeypatch):
    # the steps of the engine adapt: a difference of costs has their error in it
    monkeypatch.setattr(drill, "TOLERANCE", 1e-10)
    check_derivatives(*with_law(plain, group))


@pytest.mark.parametrize(
    ("place", "name", "values"),
    [
        (DRIVE, "force-limit: clipped", (280.0,)),
        (SPRING, "force-limit: clipped spring", (150.0,)),
        (SPRING, "stiffness-hardening: cubic", (3e9,)),
        (SPRING, "force-limit: gradual spring", (400.0,)),
        (SPRING_FROM_REST, "backlash: rounded ends", (3e-4, -1e-4, 4e-5)),
        (SPRING_FROM_REST, "backlash: less stiff over the play", (3e-4, -1e-4, 0.4)),
        (DAMPER, "damping-quadratic: quadratic", (400.0,)),
        (DAMPER, "damping-quadratic: power", (300.0, 1.5)),
    ],
)
def test_derivatives_beside_an_equation_with_corners_or_of_the_coupling(plain, place, name, values, monkeypatch):
    monkeypatch.setattr(drill, "TOLERANCE", 1e-10)
    block, shared, own = with_law(plain, "spring")
    (equation,) = (each for each in equations([place], []) if each.name == name)
    terms = (*block.structure.terms[:-1], equation)
    block = replace(block, structure=replace(block.structure, terms=terms, axes=wider(block.structure.axes)))
    shared = np.append(plain[1], np.array(values) / equation.scales)
    own = block.estimate_states(shared, own, 4)
    # where windows begin at their best, what the law makes of their coordinates changes nothing
    own[: block.windows * block.state_count(own)] += 0.1 * np.random.default_rng(0).normal(size=block.windows * MASSES)
    # a pressure that is off its label
    own[block.windows * block.state_count(own)] = 10.0
    found = block.quadratic(shared, own)
    for i in (2, 3, 5, *range(shared.size - len(values), shared.size)):
        step = np.zeros(shared.size)
        step[i] = 1e-4
        difference = (block.cost(shared + step, own) - block.cost(shared - step, own)) / 2e-4
        assert found.by_shared[i] == pytest.approx(difference, rel=0.02, abs=5.0), block.structure.unknowns[i].name


def test_derivatives_beside_a_mass_that_moves_in_contact_only(plain, monkeypatch):
    monkeypatch.setattr(drill, "TOLERANCE", 1e-10)
    block, shared, own = plain
    every = sensor_families([block.name], block.data.rate)
    (law,) = (each for each in every if each.name == "load cell in contact only")
    block = replace(block, structure=replace(block.structure, terms=(*block.structure.terms, *law.terms)))
    shared = np.append(shared, 5.0)
    check_derivatives(block, shared, block.estimate_states(shared, own, 4))


def check_derivatives(block, shared, own):
    """The gradient by shared parameters and by some of its own unknowns is that of differences of costs."""
    found = block.quadratic(shared, own)

    def close(gradient, curvature, difference):
        # a gradient is a column times the residuals; columns are right to a hundredth
        return abs(gradient - difference) < 0.01 * math.sqrt(curvature * 2.0 * found.cost)

    for i in range(shared.size):
        step = np.zeros(shared.size)
        step[i] = 1e-4
        difference = (block.cost(shared + step, own) - block.cost(shared - step, own)) / 2e-4
        assert close(found.by_shared[i], found.shared[i, i], difference), block.structure.unknowns[i].name
    label = block.windows * block.state_count(own)
    for i in (0, 1, 4, 5, label):
        step = np.zeros(own.size)
        step[i] = 1e-4
        difference = (block.cost(shared, own + step) - block.cost(shared, own - step)) / 2e-4
        assert close(found.by_own[i], found.own[i, i], difference), i


def test_the_shortening_is_found_where_the_coupling_has_play(plain):
    """Stiffness, and nothing at all within the play: Newton's method alone goes to and fro."""
    block, shared, _ = plain
    model = block.structure.model(shared * block.scales, block.point)
    scale = np.full(PLACES, 1.0)
    axes = Axes(scale, np.full(PLACES, np.arcsinh(-3e-3)), np.full(PLACES, 2.0 * np.arcsinh(3e-3) / (GRID - 1)))
    x = axes.points(SPRING_FROM_REST)
    model.free[SPRING_FROM_REST] = -model.s[K] * np.clip(x, -4e-4, 4e-4)
    y = np.linspace(-1e-3, 5e-3, 400)
    found = shortening(spring_coordinate(y, model, axes), model, axes)
    assert np.max(np.abs(found - y)) < 1e-9


@pytest.mark.parametrize("group", ["spring", "damper"])
def test_forces_of_the_coupling_are_inverted(plain, group):
    block, shared, _ = with_law(plain, group)
    model, axes = block.structure.model(shared * block.scales, block.point), block.structure.axes
    x = np.linspace(-1.5, 1.5, 301)
    assert shortening(spring_coordinate(4e-3 * x, model, axes), model, axes) == pytest.approx(4e-3 * x, abs=1e-11)
    assert closing_speed(damper_force(x, model, axes), model, axes) == pytest.approx(x, abs=1e-9)


def test_what_comes_beside_the_masses_goes_on_where_windows_are_free(plain):
    """Else a mount or the air could begin in each window where it explains most, without any strength."""
    block, _, _ = plain
    tight, loose = (replace(block, slack=slack).continuity(OWN) for slack in (TIGHT, RELAXED))
    assert np.all(tight[MASSES:] == loose[MASSES:])
    assert loose[Y] == RELAXED * tight[Y]


def test_a_mount_is_pressed_in_where_windows_are_first_guessed(plain):
    """A first guess says nothing of it, and at rest in each window it does not go on to the next."""
    block, shared, _ = plain
    mount = next(each for each in families(block.structure.axes, FREQUENCIES) if each.name.startswith("mount 266"))
    begins = np.array([each.value / each.scale for each in mount.unknowns])
    begins[0] = 3e-9 / mount.unknowns[0].scale
    structure = replace(block.structure, terms=(*block.structure.terms, *mount.terms))
    mounted, shared = replace(block, structure=structure, slack=RELAXED), np.append(shared, begins)
    guess = resized(first_states(mounted.data), mounted.windows, states_under(structure), MASSES, len(mounted.lines))

    begun = with_other_states_going_on(mounted, shared, guess)

    kept = mounted.state_count(guess)
    assert np.array_equal(mounted.states_of(begun)[:, :MASSES], mounted.states_of(guess)[:, :MASSES])
    # its states are always tied, those of the masses are free here
    assert mounted.free_unknowns(begun) == MASSES * (mounted.windows - 1) + kept + mounted.locals
    model = structure.model(shared * mounted.scales, mounted.point)
    jumps = [np.abs(mounted.defects(mounted.integrate(model, own), kept)[:, MASSES:]).max() for own in (guess, begun)]
    # the masses, of which the guess is as it was, drive it a little otherwise than when they went on as well
    assert jumps[1] < 0.2 * jumps[0]


def extended(block, families_):
    """The structures that have the terms of a family more, each."""
    return [replace(block.structure, terms=(*block.structure.terms, *each.terms)) for each in families_]


def deviations(block, shared, own, structure):
    """By how much gradient and Hessian by more terms differ from those with all derivatives taken at once.

    In units of the square roots of what the Hessian has of each parameter.
    """
    (gradient, hessian), (whole_gradient, whole) = (
        kind.reduced_under(block, shared, own, [structure])[0] for kind in (drill.ShootingProblem, RecordingProblem)
    )
    size = np.sqrt(np.maximum(np.diag(whole), 1e-12 * np.max(np.diag(whole))))
    return np.abs((gradient - whole_gradient) / size).max(), np.abs((hessian - whole) / np.outer(size, size)).max()


def test_derivatives_by_more_terms_are_those_of_all_at_once(plain):
    """Laws, gains, waves and sensors, beside a law of the coupling that is there already."""
    block, shared, own = with_law(plain, "spring")
    moving = [each for each in families(block.structure.axes, FREQUENCIES) if not each.has_states]
    waves = [at_frequency(kind, 23.0, [block.name], np.array([23.0, 31.0])) for kind in KINDS]
    every = [
        each for each in (*moving, *waves, *sensor_families([block.name], block.data.rate)) if each.group != "spring"
    ]
    assert len(every) > 20
    for each, structure in zip(every, extended(block, every), strict=True):
        of_gradient, of_hessian = deviations(block, shared, own, structure)
        assert of_gradient < 1e-4, each.name
        assert of_hessian < 1e-6, each.name


def test_states_that_come_with_a_term_go_on(plain):
    """From window to window exactly, where continuity constraints let them go on almost exactly."""
    block, shared, own = with_law(plain, "spring")
    every = [each for each in families(block.structure.axes, FREQUENCIES) if each.has_states]
    assert len(every) > 20
    for each, structure in zip(every, extended(block, every), strict=True):
        assert deviations(block, shared, own, structure)[1] < 0.15, each.name


@pytest.mark.parametrize(("steepest", "possible"), [(-0.8, True), (-2.0, False)])
def test_a_spring_that_gives_way_has_no_shortening_to_its_force(plain, steepest, possible):
    """Windows could begin at any of several; the spring that is added to tell play apart carries it so far."""
    block, shared, own = with_law(plain, "spring")
    model = block.structure.model(shared * block.scales, block.point)
    x = block.structure.axes.points(SPRING)
    middle, width = x[GRID // 2], 0.05 * (x[-1] - x[0])
    model.free[SPRING] = steepest * (model.s[K] + ADDED) * width * np.tanh((x - middle) / width)
    assert is_invertible(model, block.structure.axes) == possible
    assert block.integrate(model, own).completed == possible
