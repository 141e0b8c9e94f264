"""Single bodies that conceal physics, against SciPy with the equations typed in again."""

import math
from types import MappingProxyType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from drillenv.blind.body import BODY_GROUPS, Body, make_body_campaign, move_body, plan_bodies
from drillenv.blind.body_mechanisms import BODY_MECHANISMS, acts_over
from drillenv.blind.campaigns import Planned
from drillenv.blind.mechanisms import Concealed

BODY = Body(mass=4.0, stiffness=4000.0, damping=12.0, offset=1.5)
TONES = np.array([[14.0, 2.1, 0.3], [10.0, 4.6, 1.1], [12.0, 7.9, -0.7]])


def coth(x):
    return 1.0 / math.tanh(x)


# what each equation adds to the force on the body, of position x, velocity v and the force asked for
ADDED = {
    ("viscous-damping", 0): ({"d": 9.0}, lambda x, v, f: -9.0 * v),
    ("viscous-damping", 2): ({"d": 9.0, "v_e": 0.05}, lambda x, v, f: -0.45 * math.asinh(20.0 * v)),
    ("dry-friction", 0): ({"fc": 2.0, "v_0": 0.01}, lambda x, v, f: -2.0 * math.tanh(v / 0.01)),
    ("stiffness-hardening", 0): ({"k3": 5e6}, lambda x, v, f: -5e6 * x**3),
    ("stiffness-hardening", 1): ({"k_5": 5e10}, lambda x, v, f: -5e10 * x**5),
    ("force-limit", 1): ({"F_s": 25.0}, lambda x, v, f: 25.0 * math.tanh(f / 25.0) - f),
    ("force-limit", 2): (
        {"s_0": 0.0, "w": 0.008, "k": 4000.0},
        lambda x, v, f: -4000.0 * (0.008 * math.tanh(x / 0.008) - x),
    ),
    ("damping-quadratic", 0): ({"c2": 40.0}, lambda x, v, f: -40.0 * abs(v) * v),
    ("damping-quadratic", 2): ({"c_in": 10.0}, lambda x, v, f: -10.0 * max(v, 0.0)),
    ("backlash", 2): (
        {"g": 2e-3, "y0": -1e-3, "r": 0.4},
        lambda x, v, f: 4000.0 * 0.6 * min(max(x + 1e-3, 0.0), 2e-3),
    ),
}


@pytest.mark.parametrize("card", ADDED, ids=str)
def test_a_body_moves_as_scipy_says(card):
    name, index = card
    parameters, added = ADDED[card]
    hidden = [Concealed(name, BODY_MECHANISMS[name].equations[index], MappingProxyType(parameters))]
    mine = move_body(BODY, hidden, TONES, 0.0, (0.0, 0.0), seconds=1.0)

    def rates(t, y):
        asked = float(np.sum(TONES[:, 0] * np.sin(2.0 * math.pi * TONES[:, 1] * t + TONES[:, 2])))
        law = BODY.stiffness * y[0] + BODY.damping * y[1] + BODY.offset
        return y[1], (asked + added(y[0], y[1], asked) - law) / BODY.mass

    made = solve_ivp(rates, (0.0, mine.time[-1]), (0.0, 0.0), "DOP853", t_eval=mine.time[::40], rtol=1e-9, atol=1e-12)
    assert np.max(np.abs(mine.position[::40] - made.y[0])) < 1e-5 * np.max(np.abs(made.y[0]))
    assert np.max(np.abs(mine.velocity[::40] - made.y[1])) < 1e-5 * np.max(np.abs(made.y[1]))


@pytest.mark.slow
@pytest.mark.parametrize("name", BODY_MECHANISMS)
def test_every_equation_acts_and_the_answer_has_its_curve(name):
    equations = BODY_MECHANISMS[name].equations
    assert len(equations) >= 3
    assert sum(each.of_library for each in equations) == 1
    for i in range(len(equations)):
        made = make_body_campaign(2, i, Planned("other-equation", [(name, i)]))
        assert made.answer["missing"]["body"] > 0.0
        curve = made.answer["mechanisms"][0]["law"]
        if equations[i].name == "saturating spring":  # a function of the position, not of the force that is asked for
            assert curve is None
        else:
            assert np.all(np.isfinite(curve["y"]))
            assert np.ptp(curve["y"]) > 0.0
        samples = [each.samples for r in made.campaign.recordings for each in r.channels.values()]
        assert all(np.all(np.isfinite(each)) for each in samples)


def test_each_group_is_recorded_as_the_rules_say():
    planned = plan_bodies(9, 48)
    assert len({each.group for each in planned}) == len(BODY_GROUPS) and len(planned) == 48
    for group, cards, _ in planned:
        over = [acts_over(*card) for card in cards]
        library = [BODY_MECHANISMS[name].equations[i].of_library for name, i in cards]
        if group == "two":
            assert len({name for name, _ in cards}) == 2 and library[0]
            assert library[1] or over[0] != over[1]
        if group == "no-force":
            assert over[0] != "force"
    i = next(i for i, each in enumerate(planned) if each.group == "no-force")
    made = make_body_campaign(9, i, planned[i])
    assert all(set(each.channels) == {"position", "acceleration"} for each in made.campaign.recordings)
    first, second = (each.channels["position"].samples[0] for each in made.campaign.recordings[:2])
    assert first * second < 0.0 < made.answer["missing"]["body"]
    i = next(i for i, each in enumerate(planned) if each.group == "two")
    made = make_body_campaign(9, i, planned[i])
    assert "force" in made.campaign.recordings[0].channels and len(made.answer["mechanisms"]) == 2


def test_a_campaign_depends_on_its_seed_and_number_alone():
    planned = plan_bodies(5, 20)
    assert planned == plan_bodies(5, 20)
    first, second = make_body_campaign(5, 7, planned[7]), make_body_campaign(5, 7, planned[7])
    assert first.answer == second.answer
    assert np.array_equal(
        first.campaign.recordings[1].channels["force"].samples, second.campaign.recordings[1].channels["force"].samples
    )
