"""From where measured laws of the coupling's spring are counted, and what a hum consists of."""

import numpy as np
import pytest

from drillenv.diagnosis.constants import NAMES, Constants
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.laws import DRIVE_LAG, equations, families
from drillenv.diagnosis.measured import POINTS, Shown, _contact_law, _coupling, curve_of, depth_at, near, unloaded
from drillenv.diagnosis.sensing import added
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.diagnosis.terms import Law, Model, ModelStructure, OperatingPoint, Unknown
from drillenv.dynamics.constitutive.places import INDENTER, LOADING, SPRING, SPRING_FROM_REST
from drillenv.dynamics.effects import REGISTRY
from drillenv.dynamics.hybrid import vector_field as V

STIFFNESS, ENDS = 68850.0, (0.9e-3, 2.2e-3)
AXES = Axes(np.full(PLACES, 1e3), np.full(PLACES, -4e-6), np.full(PLACES, 8e-6 / (GRID - 1)))
"""Nearly even, from -4 to 4 mm."""
POINT = OperatingPoint("r01", 90.0, 0.4, 1.0, 25600.0, False)


def model_of(place, law, shift):
    """A model whose spring has ``law`` beyond its stiffness, all shortenings counted ``shift`` m too short."""
    model = Model()
    model.s[V.K] = STIFFNESS
    x = AXES.points(place)
    model.free[place] = law(x + shift) + STIFFNESS * shift
    return model


@pytest.mark.parametrize("power, size", [(3, 6e9), (3, -3e9), (5, 7e14), (2, 2e6)])
@pytest.mark.parametrize("shift", [-2e-4, 0.0, 4e-4])
def test_a_spring_is_counted_from_where_it_has_no_force(power, size, shift):
    model = model_of(SPRING, lambda u: size * np.maximum(u, 0.0) ** power, shift)
    assert unloaded(model, AXES, ENDS) == pytest.approx(-shift, abs=2e-6)


def test_a_spring_that_is_unloaded_shows_where_it_has_no_force():
    model = model_of(SPRING, lambda u: 6e9 * u**3, 3e-4)
    assert unloaded(model, AXES, (-1e-3, 1.2e-3)) == pytest.approx(-3e-4, abs=2e-6)


def test_play_is_counted_from_where_the_spring_is_as_stated():
    def law(beyond):
        return -STIFFNESS * np.clip(beyond, 0.0, 3e-4)

    shift = 1e-4
    model = model_of(SPRING_FROM_REST, law, shift)
    shown = _coupling(model, AXES, "play", (-4e-4, 4e-4))
    assert shown.x.size == POINTS
    np.testing.assert_allclose(shown.y(model), law(shown.x), atol=0.02 * STIFFNESS * 3e-4)


@pytest.mark.parametrize("factor", [0.6, 1.7])
def test_a_contact_is_shown_as_deep_as_blows_go(factor):
    """Rock softer or stiffer than stated is hit deeper or less deep than w, the force over the stated stiffness."""
    model, top = Model(), 1e-4
    model.s[V.KL], model.free[LOADING] = 21.4e6, np.full(GRID, np.log(factor))
    shown = _contact_law(AXES, top, model)
    assert shown.x[-1] == pytest.approx(top / factor)
    np.testing.assert_allclose(shown.y(model), (factor - 1.0) * 21.4e6 * shown.x, atol=1e-6 * 21.4e6 * top)


@pytest.mark.parametrize(
    ("effect", "p", "law"),
    [
        # which has no stiffness at the face
        ("contact-power-law", (1.57,), lambda x: 1e-4 * (x / 1e-4) ** 1.57),
        ("contact-power-law", (0.8,), lambda x: 1e-4 * (x / 1e-4) ** 0.8),
        ("contact-toe", (2e-5, 0.1, 0.5), lambda x: x - 0.9 * 2e-5 * -np.expm1(-x / 2e-5)),
    ],
)
def test_an_equation_of_the_contact_is_shown_as_it_is(effect, p, law):
    model, top = Model(), 1.5e-4
    model.s[V.KL], model.s[V.KU] = 21.4e6, 25e6
    model.laws.append(Law(effect, REGISTRY[effect].forms[0], p, AXES))
    shown = _contact_law(AXES, top, model)
    assert law(shown.x[-1]) == pytest.approx(top, rel=1e-4)
    assert shown.y is not None
    np.testing.assert_allclose(shown.y(model), 21.4e6 * (law(shown.x) - shown.x), rtol=1e-9, atol=1e-9)
    w = np.array([0.0, 1e-6, 3e-5, 1.4e-4])
    np.testing.assert_allclose(law(depth_at(model, AXES, w)), w, rtol=1e-3, atol=1e-12)


def test_a_gain_of_the_drive_is_shown_over_the_frequency():
    """Of an equation as of a free law: by how much less than stated the drive gives."""
    (droop,) = (each for each in equations([], [DRIVE_LAG]) if len(each.unknowns) == 1)
    constants = Constants("constants", tuple(Unknown(name, 1.0, 1.0) for name in NAMES))
    structure = ModelStructure((constants, droop), AXES, DRILL)
    display = Shown("frequency", "Hz", "1", np.array([50.0, 90.0, 120.0]), None)
    values = np.append(np.full(len(NAMES), 2.0), 3e-3)
    shown = curve_of(display, structure, values, POINT)
    np.testing.assert_allclose(shown, 1.0 / np.hypot(1.0, 3e-3 * display.x) - 1.0, rtol=1e-12)
    assert np.all(curve_of(display, structure, values, POINT, ()) == 0.0)


def test_presliding_friction_begins_at_next_to_nothing_with_one_parameter():
    found = {each.name: each for each in families(AXES, [60.0, 90.0, 120.0])}
    family = found["presliding indenter"]
    assert family.group == found["indenter"].group and family.size == 1 and family.has_states
    model = Model()
    family.terms[0].contribute(np.array([30.0]), model, POINT, AXES)
    simplest = min((e for e in equations([INDENTER], []) if e.has_states), key=lambda each: len(each.unknowns))
    assert model.s[V.SLIDING2] == 30.0
    assert model.s[V.BRISTLES2] == pytest.approx(30.0 / simplest.form.starts[0][1])


def test_a_line_near_an_order_is_the_hum():
    lines = [(149.8, np.array([3.0, 4.0])), (150.2, np.array([1.0, 0.0])), (260.0, np.array([9.0, 9.0]))]
    assert near(lines, 150.1).tolist() == [1.0, 0.0]
    assert near(lines, 200.0).tolist() == [0.0, 0.0]


def test_a_hum_says_its_waves_and_its_frequency():
    free = added(("r01", "r02"), 50.0, (1, 2))
    values = np.arange(len(free.unknowns), dtype=float)
    assert free.frequency_of(values) == 50.0
    assert free.waves(values).shape == (2, 2, 4)
    read = free.add(values, POINT._replace(name="r02"), 4)
    turned = 2.0 * np.pi * 50.0 / POINT.rate * np.arange(4)
    expected = sum(
        size * wave(order * turned)
        for size, (order, wave) in zip(values[8:12], ((1, np.sin), (1, np.cos), (2, np.sin), (2, np.cos)), strict=True)
    )
    np.testing.assert_allclose(read[0], expected)
