"""Boundaries against runs on either side, finite differences, and the laws of their kinds."""

import itertools
import math

import numpy as np
import pytest

from drillenv.atlas import boundaries, boundary, sweep
from drillenv.checks import InputError
from drillenv.dynamics.effects import make
from drillenv.dynamics.exact import STATE_SIZE, TALLY_SIZE, advance_period, make_scratch
from drillenv.dynamics.flow import UNLOADING, make_model
from drillenv.dynamics.motion import motion, point_from_xf
from drillenv.dynamics.orbits import find_orbit, length_scale, on_section, put_on_section
from drillenv.rig import Rig, Setting
from drillenv.rocks import rock

CENTRE = Setting(60.0, 0.45, 1.0)


def at(frequency: float) -> Setting:
    return Setting(frequency, 0.45, 1.0)


def difference_multipliers(model: np.ndarray, point: np.ndarray, period: int) -> np.ndarray:
    """Eigenvalues of the map's derivative by central differences of the plain engine."""
    omega = model[0, 4]
    scales = length_scale(model) * np.array([1.0, omega, omega, 1.0])

    def mapped(start: np.ndarray) -> np.ndarray:
        state, image = np.zeros(STATE_SIZE), np.zeros(4)
        put_on_section(start, UNLOADING, state)
        for _ in range(period):
            advance_period(model, state, np.zeros(TALLY_SIZE), make_scratch())
        on_section(model, state, UNLOADING, image)
        return image

    columns = []
    for j in range(4):
        step = 1e-6 * scales * (np.arange(4) == j)
        columns.append((mapped(point + step) - mapped(point - step)) / scales / 2e-6)
    return np.linalg.eigvals(np.column_stack(columns))


def orbit_at(setting: Setting, near, case: int = 4):
    """The model at a setting and the orbit of a motion's period there, stable or not; None where there is none."""
    model = make_model(Rig(), rock(case), setting)
    point, tangent = point_from_xf(near), np.empty((4, 4))
    return (model, point) if find_orbit(model, point, UNLOADING, near.period, tangent) else None


def walked_down(frequency: float):
    """P-1-I-1 at a frequency near its fold, by runs that come ever closer to it."""
    found = motion(at(112.0))
    for distance in np.geomspace(112.0 - frequency, 1e-5, 24):
        found = motion(at(frequency + distance - 1e-5), start=found)
    return found


def half_apart(frequency: float) -> float:
    """How far apart, in m/s, the speeds of the indenter are at the two crossings of a period-two orbit."""
    found = motion(at(frequency), start=motion(at(98.1)), wait=2000)
    model = make_model(Rig(), rock(4), found.setting)
    state = np.zeros(STATE_SIZE)
    put_on_section(point_from_xf(found), UNLOADING, state)
    advance_period(model, state, np.zeros(TALLY_SIZE), make_scratch())
    assert found.period == 2
    return abs(state[2] - found.point[2])


def test_period_doubling():
    found = boundary(CENTRE, "frequency", 90.0, 105.0)
    assert (found.kind, found.label, found.beyond) == ("period doubling", "P-1-I-2", "P-2-I-4")
    assert found.error < 1e-8 * found.value
    assert found.direction == "up"
    # the orbit there, found afresh and differenced: one multiplier is -1
    model, point = orbit_at(found.setting, motion(at(97.5)))
    assert np.abs(difference_multipliers(model, point, 1) + 1.0).min() < 1e-5
    assert found.multipliers[0] == pytest.approx(-1.0, abs=1e-8)
    # what plain runs settle on, on either side
    assert motion(at(found.value * (1 - 2e-4)), wait=2000).label == "P-1-I-2"
    assert motion(at(found.value * (1 + 2e-4)), wait=2000).label == "P-2-I-4"
    # beyond, the two halves of the doubled orbit part as the square root of the distance
    parts = [half_apart(found.value + distance) for distance in (1e-4, 4e-4)]
    assert parts[1] / parts[0] == pytest.approx(2.0, rel=0.05)


def test_period_doubling_from_the_doubled_side():
    forth = boundary(CENTRE, "frequency", 95.0, 98.5)
    back = boundary(CENTRE, "frequency", 98.5, 95.0)
    assert (back.kind, back.label, back.beyond) == ("period doubling", "P-2-I-4", "P-1-I-2")
    assert back.value == pytest.approx(forth.value, rel=1e-10)
    assert back.multipliers[0] == pytest.approx(-1.0, abs=1e-8)


def test_fold():
    found = boundary(CENTRE, "frequency", 120.0, 100.0)
    assert (found.kind, found.label, found.direction) == ("fold", "P-1-I-1", "down")
    assert found.multipliers[0] == pytest.approx(1.0, abs=1e-5)
    # below there is no orbit to find, and plain runs leave for another motion
    last = walked_down(found.value + 1e-4)
    assert last.label == "P-1-I-1"
    assert orbit_at(at(found.value - 1e-3), last) is None
    assert motion(at(found.value - 1e-3), start=last).label != "P-1-I-1"
    # the law of a fold: the multiplier comes to 1 as the square root of the distance
    gaps = []
    for distance in (1e-5, 4e-5):
        near = walked_down(found.value + distance)
        model = make_model(Rig(), rock(4), near.setting)
        gaps.append(1.0 - np.abs(difference_multipliers(model, point_from_xf(near), 1)).max())
    assert gaps[1] / gaps[0] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize(
    ("over", "setting", "case", "inside", "outside", "labels"),
    [
        ("frequency", CENTRE, 4, 90.0, 60.0, ("P-1-I-2", "P-1-I-3")),
        ("frequency", CENTRE, 4, 60.0, 52.0, ("P-1-I-3", "P-1-I-4")),
        ("amplitude", Setting(120.0, 0.45, 1.0), 2, 0.5, 0.3, ("P-1-I-1", "P-1-I-2")),
        ("pressure", Setting(90.0, 0.45, 1.0), 4, 1.0, 1.8, ("P-1-I-2", "P-1-I-3")),
        ("stiffness", Setting(100.0, 0.45, 1.0), 4, 10e6, 14.2e6, ("P-1-I-1", "P-1-I-2")),
    ],
)
def test_grazing(over, setting, case, inside, outside, labels):
    found = boundary(setting, over, inside, outside, case)
    assert (found.kind, found.label, found.beyond) == ("grazing", *labels)
    assert found.error < 1e-8 * found.value
    # a sweep as narrow as 1e-6 of the value sees the label change at its middle
    narrow = 1e-6 * found.value
    around = sweep(setting, over, found.value - narrow, found.value + narrow, 2 * narrow, case, direction="up")
    before, after = around.labels("up")[:: 1 if outside > inside else -1]
    assert (before, after) == labels


def test_boundary_of_a_coexisting_motion():
    upper = motion(at(109.6), start=motion(at(112.0)))
    assert boundary(CENTRE, "frequency", 109.6, 112.0, start=motion(at(108.9), start=motion(at(100.0)))).value < 110.0
    found = boundary(CENTRE, "frequency", 109.6, 105.0, start=upper)
    assert found.kind == "fold"
    assert found.value == pytest.approx(109.2701627, abs=1e-6)


@pytest.mark.slow
def test_every_change_along_a_sweep():
    swept = sweep(CENTRE, "frequency", 96.0, 112.0, 0.2)
    found = boundaries(swept)
    for way in ("up", "down"):
        names = swept.labels(way)[:: 1 if way == "up" else -1]
        changes = [(str(a), str(b)) for a, b in itertools.pairwise(names) if a != b]
        mine = [each for each in found if each.direction == way]
        assert [(each.label, each.beyond) for each in mine] == changes
        # each lies within the step in which the label changed
        values = swept.values[:: 1 if way == "up" else -1]
        steps = [sorted(values[i : i + 2]) for i in range(len(names) - 1) if names[i] != names[i + 1]]
        for each, (low, high) in zip(mine, steps, strict=True):
            assert low <= each.value <= high
            assert each.error < 1e-5 * each.value
    # hysteresis: P-1-I-1 comes later on the way up than it goes on the way down
    comes = next(each for each in found if each.direction == "up" and each.beyond == "P-1-I-1")
    goes = next(each for each in found if each.direction == "down" and each.label == "P-1-I-1")
    assert comes.kind == goes.kind == "fold"
    assert comes.value - goes.value == pytest.approx(0.6175, abs=1e-3)
    assert boundaries(swept, "down")[0].value == goes.value


def test_chaos_ending_in_a_jump():
    swept = sweep(Setting(90.0, 0.45, 1.0), "pressure", 0.8035, 0.8065, 0.001, direction="up")
    for each in boundaries(swept):
        assert each.kind in ("jump", "fold", "period doubling", "grazing")
        assert 0.8035 <= each.value <= 0.8065
        if each.kind == "jump":
            assert each.followed == "none"
            assert np.isnan(each.multipliers).all()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"over": "speed"}, "over is 'speed'"),
        ({"inside": 106.0}, "chaotic: only a periodic"),
        ({"inside": 112.0, "outside": 118.0}, "P-1-I-1 lives on"),
        ({"inside": 100.0, "outside": 100.0}, "two values"),
        ({"inside": 6000.0}, "inside is 6000 Hz"),
        ({"outside": math.inf}, "outside is inf"),
        ({"setting": None}, "give Setting"),
        ({"rock": "granite"}, "rock is 'granite'"),
    ],
)
def test_bad_input_is_said_in_one_line(arguments, says):
    given = {"setting": CENTRE, "over": "frequency", "inside": 90.0, "outside": 105.0} | arguments
    with pytest.raises(InputError, match=says) as error:
        boundary(**given)
    assert "\n" not in str(error.value)


def test_boundaries_wants_a_sweep():
    with pytest.raises(InputError, match="give a Sweep"):
        boundaries(CENTRE)


def test_boundaries_refuse_a_sweep_with_effects():
    """Orbits are followed by the exact engine, which knows no effects."""
    swept = sweep(CENTRE, "frequency", 89.0, 90.0, 1.0, direction="up", effects=[make("contact-rate", chi=0.1)])
    with pytest.raises(InputError, match=r"has effects \(contact-rate\): give a sweep of the paper's model"):
        boundaries(swept)
