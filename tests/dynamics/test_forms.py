"""What effects say of their equations as curves, against what the engine makes of the equations."""

import numpy as np
import pytest

from drillenv.dynamics.effects import REGISTRY, make
from drillenv.dynamics.forms import Around
from drillenv.dynamics.simulate import simulate
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS
from tests.dynamics.test_tabulated import KNOTS_AT

RIG, SETTING, ROCK = Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4]
AROUND = Around(RIG.stiffness, ROCK.loading_stiffness, ROCK.unloading_stiffness, 90.0)
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
    assert bool(form.laws) != (form.numbers is not None)
    for start in form.starts:
        make(name, **dict(zip(form.symbols, start, strict=True)))
    for place, law in form.laws.items():
        assert law(KNOTS_AT[place], values_of(name), AROUND).shape == KNOTS_AT[place].shape


@pytest.mark.parametrize("name", GIVEN)
def test_the_curve_moves_the_rig_as_the_equation_does(name):
    form, values = REGISTRY[name].forms[0], values_of(name)
    tabulated = []
    for place, law in form.laws.items():
        x = KNOTS_AT[place]
        contact = place in ("loading", "unloading")
        tabulated.append(make(f"tabulated-{place}", x=x, y=law(x / AROUND.kl if contact else x, values, AROUND)))
    seconds = 0.05
    plain, equation, curve = (
        simulate(SETTING, ROCK, RIG, seconds, effects=effects)
        for effects in ((), (make(name, **GIVEN[name]),), tuple(tabulated))
    )
    effect = np.sqrt(np.mean((equation.force - plain.force) ** 2))
    assert np.sqrt(np.mean((equation.force - curve.force) ** 2)) < 0.1 * effect
