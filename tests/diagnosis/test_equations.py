"""What the diagnosis' integrator takes of effects, against what the simulator makes of the same effects."""

import math

import numpy as np
import pytest

from drillenv.diagnosis.equations import Around, acts_at, curve_at, parameters_of, scalars_of
from drillenv.diagnosis.laws import NUMBERS
from drillenv.diagnosis.terms import drilled_by
from drillenv.dynamics.constitutive.places import CODE, PLACES, SCALARS
from drillenv.dynamics.effects import REGISTRY, make
from drillenv.dynamics.simulate import simulate
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS
from tests.dynamics.test_tabulated import KNOTS_AT

RIG, SETTING, ROCK = Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4]
AROUND = Around(RIG.stiffness, ROCK.loading_stiffness, ROCK.unloading_stiffness)
FORMS = [(name, form) for name, effect in REGISTRY.items() for form in effect.forms]
GIVEN = {
    "contact-rate": {"chi": 0.5},
    "contact-power-law": {"n": 1.2},
    "contact-toe": {"h": 2e-5, "r": 0.3, "e": 0.5},
    "rock-compaction": {"soft": 0.4, "soft_n": 20.0},
    "stiffness-hardening": {"k3": 5e9},
    "damping-quadratic": {"c2": 800.0},
    "guide-friction": {"fc1": 30.0, "vs1": 2e-3},
    "indenter-friction": {"fc2": 30.0, "vs2": 5e-2},
    "drive-harmonics": {"h2": 0.1, "phi2": 0.5, "h3": 0.05, "phi3": -0.3},
    "force-limit": {"F_max": 300.0},
    "backlash": {"g": 3e-4, "y0": -1e-4},
}
"""A strength of each effect with curves."""


def values_of(name):
    """All parameters of an effect at its strength."""
    return tuple(GIVEN.get(name, {}).get(each.symbol, each.neutral) for each in REGISTRY[name].parameters)


@pytest.mark.parametrize(("name", "form"), FORMS, ids=[f"{name} {form.name}" for name, form in FORMS])
def test_a_form_names_parameters_and_starts_within_their_bounds(name, form):
    assert set(form.symbols) <= {each.symbol for each in REGISTRY[name].parameters}
    places, numbers = acts_at(name, form)
    assert places or numbers
    assert numbers <= {*NUMBERS, "drive_lag"} <= set(SCALARS)
    for start in form.starts:
        make(name, **dict(zip(form.symbols, start, strict=True)))
        p = parameters_of(name, form, start)
        assert set(scalars_of(name, p)) >= numbers
        for place in places:
            x = KNOTS_AT.get(PLACES[place].name, np.linspace(-1e-4, 1e-4, 64))
            assert curve_at(name, p, place, x, AROUND).shape == x.shape


@pytest.mark.parametrize(("unloading", "drilled"), [(2e7, 1e-4), (5e6, 0.0)])
def test_a_fit_that_unloads_more_softly_than_it_loads_drills_nothing(unloading, drilled):
    """Compaction over the depth that impacts drill would grow out of all bounds over a depth that they give back."""
    assert drilled_by(2000.0, 1e7, unloading) == pytest.approx(drilled)


def test_a_contact_is_a_factor_on_the_stiffness_over_the_force():
    """R = k d0 (x / d0)^n and the layer, by hand: dR/dx / k where R = k_l w."""
    w, ratio, d0, n = np.geomspace(1e-7, 4e-4, 50), AROUND.kl / AROUND.ku, 1e-4, 1.3
    for place, x in (("loading", w), ("unloading", w * ratio)):
        found = curve_at("contact-power-law", (n,), CODE[place], w, AROUND)
        np.testing.assert_allclose(found, n * (x / d0) ** (1.0 - 1.0 / n), rtol=1e-6)
    h, r, e = 2e-5, 0.1, 0.4
    for place, k, thick in (("loading", AROUND.kl, h), ("unloading", AROUND.ku, e * h * ratio)):
        depth = np.linspace(1e-7, 2e-4, 40)
        force = k * (depth - (1.0 - r) * thick * (1.0 - np.exp(-depth / thick)))
        found = curve_at("contact-toe", (h, r, e), CODE[place], force / AROUND.kl, AROUND)
        np.testing.assert_allclose(found, 1.0 - (1.0 - r) * np.exp(-depth / thick), rtol=1e-6)


@pytest.mark.parametrize(("name", "place"), [("guide-friction", "guide"), ("indenter-friction", "indenter")])
def test_friction_that_grips_or_gives_is_rounded(name, place):
    """What gives before it slides has the force at which it slides."""
    v = np.array([-0.1, 0.0, 0.1])
    for p in ((30.0, 0.0, 0.0, 0.0, 0.0, 1e-3), (30.0, 0.0, 1e-6, 0.0, 0.0, 1e-3)):
        np.testing.assert_allclose(curve_at(name, p, CODE[place], v, AROUND), [-30.0, 0.0, 30.0])
    slow = 30.0 * (1.0 + 0.4 * math.exp(-1.0))
    found = curve_at(name, (30.0, 0.0, 1e-6, 0.0, 0.4, 0.1), CODE[place], v, AROUND)
    np.testing.assert_allclose(found, [-slow, 0.0, slow])


@pytest.mark.parametrize("name", GIVEN)
def test_the_curve_moves_the_rig_as_the_equation_does(name):
    values, tabulated = values_of(name), []
    for place in acts_at(name, REGISTRY[name].forms[0])[0]:
        where = PLACES[place].name
        x = KNOTS_AT[where]
        contact = where in ("loading", "unloading")
        y = curve_at(name, values, place, x / AROUND.kl if contact else x, AROUND)
        tabulated.append(make(f"tabulated-{where}", x=x, y=y))
    seconds = 0.05
    plain, equation, curve = (
        simulate(SETTING, ROCK, RIG, seconds, effects=effects)
        for effects in ((), (make(name, **GIVEN[name]),), tuple(tabulated))
    )
    effect = np.sqrt(np.mean((equation.force - plain.force) ** 2))
    assert np.sqrt(np.mean((equation.force - curve.force) ** 2)) < 0.1 * effect
