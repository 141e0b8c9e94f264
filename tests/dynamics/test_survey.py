"""Surveys against single motions, whatever the order, the threads and the chunks."""

import numpy as np
import pytest

from drillenv.checks import InputError
from drillenv.dynamics.exact import STATE_SIZE, V2, W, Y
from drillenv.dynamics.flow import AMPLITUDE, OMEGA, STATIC, K, make_model
from drillenv.dynamics.motion import motion
from drillenv.dynamics.orbits import length_scale
from drillenv.dynamics.survey import label, labels, multipliers_of, place_start, random_starts, survey
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock, rock


def random_settings(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform([50, 0.3, 0.6], [120, 0.6, 1.8], (n, 3))


def test_same_as_single_motions_for_settings_and_rocks():
    settings = random_settings(60)
    cases = np.random.default_rng(1).integers(1, 7, 60).tolist()
    found = survey(settings, cases)
    for row, name, setting, case in zip(found, labels(found), settings.tolist(), cases, strict=True):
        single = motion(Setting(*setting), case)
        assert name == single.label
        for field in ("period", "impacts", "contacts", "penetration_rate", "peak_force", "impact_speed", "exponent"):
            assert row[field] == getattr(single, field), field
        np.testing.assert_array_equal(row["multipliers"], single.multipliers)
        np.testing.assert_array_equal(row["point"], single.point)


def test_another_rig_and_a_rock_of_ones_own():
    rig, own = Rig(damping=3e3, drive_gain=1.1), Rock(9e6, 12e6)
    found = survey([[110, 0.45, 1.0]], own, rig)
    single = motion(Setting(110, 0.45, 1.0), own, rig)
    assert found["penetration_rate"][0] == single.penetration_rate


def test_threads_and_order_change_nothing():
    settings = random_settings(100)
    one, two = survey(settings, threads=1), survey(settings, threads=3)
    assert one.tobytes() == two.tobytes()
    shuffle = np.random.default_rng(2).permutation(100)
    assert survey(settings[shuffle]).tobytes() == one[shuffle].tobytes()


def test_many_starts():
    settings = random_settings(7)
    found = survey(settings, starts=5, seed=3)
    assert found.shape == (7, 5)
    assert found[:, 0].tobytes() == survey(settings).tobytes()
    assert found.tobytes() == survey(settings, starts=5, seed=3).tobytes()
    assert found[:, 1:].tobytes() != survey(settings, starts=5, seed=4)[:, 1:].tobytes()


def test_starts_fill_the_section_box():
    model = make_model(Rig(), rock(4), Setting(100, 0.45, 1.0))
    length = length_scale(model)
    states = np.zeros((400, STATE_SIZE))
    starts = random_starts(400, 0)
    assert (starts[0] < 0).all()
    for start, state in zip(starts[1:], states[1:], strict=True):
        place_start(model, start, state)
    spring, speed, place = states[1:, Y], states[1:, V2], states[1:, W]
    free = place < 0
    assert 0.4 < free.mean() < 0.6
    assert place.min() == pytest.approx(-3 * length, rel=0.05)
    assert place.max() * 25.05e6 == pytest.approx(6 * model[0, AMPLITUDE], rel=0.05)
    assert np.abs(spring - model[0, STATIC] / model[0, K]).max() == pytest.approx(2 * length, rel=0.05)
    assert np.abs(speed).max() == pytest.approx(1.5 * length * model[0, OMEGA], rel=0.05)


def test_progress_counts_every_motion():
    done = []
    survey(random_settings(50), starts=3, progress=done.append)
    assert sum(done) == 150


def test_labels():
    assert label(2, 3.0, -1.0) == "P-2-I-3"
    assert label(0, 1.7, 3.0) == "chaotic"
    assert label(0, 1.7, -0.1) == "aperiodic"
    found = survey([[105, 0.45, 1.0], [50, 0.45, 1.0], [120, 0.45, 1.0]])
    assert labels(found).tolist() == ["chaotic", "P-1-I-4", "P-1-I-1"]
    assert labels(found[:, None]).shape == (3, 1)


def test_multipliers_are_sorted_by_modulus():
    matrices = np.random.default_rng(0).normal(size=(50, 4, 4))
    values = multipliers_of(matrices)
    assert np.all(np.diff(np.abs(values), axis=1) < 1e-9)
    for matrix, row in zip(matrices, values, strict=True):
        assert np.prod(row) == pytest.approx(np.linalg.det(matrix), rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"settings": [[120, 0.45]]}, r"shape \(1, 2\)"),
        ({"settings": []}, "shape"),
        ({"settings": "all"}, "settings is"),
        ({"settings": [[120, 0.45, 1.0], [120, 450, 1.0]]}, "row 1: amplitude is 450.*mV"),
        ({"settings": [[120, 0.45, np.nan]]}, "row 0: pressure is nan"),
        ({"rocks": [4, 5]}, "2 rocks for 1 settings"),
        ({"rocks": 9}, "rock is 9"),
        ({"rig": 3}, "give a Rig"),
        ({"starts": "steady"}, "give 'fresh' or a number"),
        ({"starts": 0}, "starts is 0"),
        ({"threads": 0}, "threads is 0"),
    ],
)
def test_bad_input_is_said_in_one_line(arguments, says):
    given = {"settings": [[120, 0.45, 1.0]]} | arguments
    with pytest.raises(InputError, match=says) as error:
        survey(**given)
    assert "\n" not in str(error.value)
