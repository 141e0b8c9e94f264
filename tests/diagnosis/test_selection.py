"""What a family has to gain beside laws that are not exact."""

from types import SimpleNamespace as Fake
from typing import Any

import numpy as np
import pytest

from drillenv.diagnosis import resolution, selection
from drillenv.diagnosis.fitting import Fitted, penalty
from drillenv.diagnosis.laws import Curve
from drillenv.diagnosis.resolution import refined
from drillenv.diagnosis.score_tests import ScoreTests
from drillenv.diagnosis.selection import forward, least_gain, strength_shows
from drillenv.diagnosis.thresholds import LAW_LEFT

SAMPLES = 20_000


def fit(per_freedom: float, resolved: float = 0.0) -> Any:
    return Fake(per_freedom=per_freedom, samples=SAMPLES, resolved=resolved, noise=[])


def score(group: str, gain: float, freedom: int = 8, constant: str = "") -> Any:
    return Fake(family=Fake(group=group, constant=constant), gain=gain, freedom=freedom)


def step(group: str, gain: float, equation: object) -> Any:
    return Fake(
        family=Fake(name=group, group=group, constant="", terms=(group,)),
        named=Fake(equation=equation),
        pending=False,
        gain_in=lambda fitted: gain,
    )


def test_beside_nothing_chance_alone_is_to_be_exceeded():
    assert least_gain(score("damper", 50.0), fit(1.5), [], []) == 0.0


def test_what_sensors_do_not_resolve_is_no_mechanism():
    """A constant is the lab's to state, and is not held to it."""
    assert least_gain(score("damper", 50.0), fit(1.5, 80.0), [], []) == 80.0
    assert least_gain(score("mass", 50.0, constant="mass"), fit(1.5, 80.0), [], []) == 0.0


def test_what_a_law_leaves_is_held_against_other_mechanisms():
    there = [step("contact law", 1e5, None)]
    assert least_gain(score("damper", 50.0), fit(1.5), there, []) == pytest.approx(LAW_LEFT**2 * 1e5)


def test_a_correction_of_an_equation_is_spared_in_close_models_only():
    """However much an equation explains, what it leaves in a model that is not close is not to be put up with."""
    there = [step("mount", 1e6, "one mass")]
    correction = score("mount", 5e3)
    close, far = (least_gain(correction, fit(chi_square), there, [correction]) for chi_square in (1.2, 3.0))
    assert close == pytest.approx(LAW_LEFT**2 * 1e6)
    assert far == pytest.approx(penalty(correction.freedom, fit(3.0)))


def test_what_an_equation_leaves_is_what_its_own_correction_gains():
    there = [step("mount", 1e6, "one mass")]
    scores = [score("mount", 400.0), score("damper", 300.0)]
    assert least_gain(scores[1], fit(1.5), there, scores) == pytest.approx(400.0)


def test_an_equation_whose_correction_was_dismissed_leaves_nothing():
    there, other = [step("hum", 1e4, "library")], score("air", 60.0)
    assert least_gain(other, fit(1.5), there, [other]) == pytest.approx(LAW_LEFT**2 * 1e4)
    assert least_gain(other, fit(1.5), there, [other], {"hum"}) == pytest.approx(penalty(other.freedom, fit(1.5)))
    free = [step("hum", 1e4, None)]
    assert least_gain(other, fit(1.5), free, [other], {"hum"}) == pytest.approx(LAW_LEFT**2 * 1e4)


@pytest.mark.parametrize(("strength", "shows"), [(2.5, True), (0.5, False), (-2.5, True)])
def test_states_of_its_own_are_no_evidence_of_a_mechanism(strength, shows):
    """Air without stiffness fits whatever fades away; its strength is the first parameter of its own term."""
    unknown = Fake(value=0.0, width=1e4)
    others, air = Fake(name="constants", unknowns=[unknown] * 2), Fake(name="air", unknowns=[unknown, unknown])
    structure: Any = Fake(terms=[others, air])
    fit: Any = Fake(shared=np.array([9.0, 9.0, strength, 9.0]))
    fitted = Fitted(structure, [], fit, Any)  # type: ignore[arg-type]
    # as computed from a fit, which this one has not
    vars(fitted)["covariance"] = np.diag([1e-6, 1e-6, 0.5**2, 1e-6])
    family: Any = Fake(terms=[air])
    assert strength_shows(family, fitted) == shows


@pytest.mark.parametrize(
    ("size", "gains", "expected"),
    [
        (6, {6: 0.0, 12: 500.0, 24: 200.0, 48: 1.0}, 24),
        (12, {12: 0.0, 24: 500.0, 48: 300.0}, 48),
        (12, {12: 0.0, 24: 5.0, 48: 300.0}, 12),
    ],
)
def test_a_law_gets_finer_from_where_it_stands_as_long_as_that_is_seen(monkeypatch, size, gains, expected):
    """``gains`` in log-likelihood by the number of coefficients; coarser laws than its own are not tried again."""

    def family(count: int) -> Any:
        return Fake(name="drive", size=count, terms=(Curve("drive", ()),))

    rig = Fake(laws=lambda fitted, axes, detail: [family(6 * detail)])
    structure = Fake(rig=rig, axes=None)

    def at(count: int, cost: float) -> Any:
        return Fake(structure=structure, fit=Fake(shared=np.zeros(count)), cost=cost, samples=SAMPLES)

    def with_detail(fitted, family, detail):
        return at(6 * detail, fitted.cost - gains[6 * detail])

    monkeypatch.setattr(resolution, "with_detail", with_detail)
    monkeypatch.setattr(resolution, "with_corners", lambda fitted, family: fitted)
    monkeypatch.setattr(resolution, "smoothed", lambda fitted, family: fitted)
    found = refined(at(size, 1e4), family(size))  # type: ignore[arg-type]
    assert found.fit.shared.size == expected


def test_what_a_free_law_leaves_is_at_most_half_of_what_is_left():
    """What its equation's own correction gains says more: it holds whatever is left."""
    left = 0.5 * 0.02 * SAMPLES
    free, equation = step("mount", 1e6, None), step("mount", 1e6, "one mass")
    scores = [score("mount", 0.9 * left), score("damper", 0.7 * left)]
    assert least_gain(scores[1], fit(1.02), [free], scores) == pytest.approx(0.5 * left)
    assert least_gain(scores[1], fit(1.02), [equation], scores) == pytest.approx(0.9 * left)


def test_the_search_goes_on_without_what_was_left_out(monkeypatch):
    """Beside what is needless after all, another family looked like chance; what was left out is not tried again."""
    steps = [step("guide", 90.0, None), step("mass", 60.0, None)]
    mass, air = steps[1].family, Fake(name="air", group="air")
    tried = []

    def score_tests(fitted, families):
        tried.append([each.name for each in families])
        return ScoreTests([], 0.01)

    monkeypatch.setattr(selection, "joined", lambda fitted, *_: fitted)
    monkeypatch.setattr(
        selection,
        "still_possible",
        lambda fitted, steps, possible, *_: [each for each in (mass, air) if possible is None or each.name in possible],
    )
    monkeypatch.setattr(selection, "score_tests", score_tests)
    monkeypatch.setattr(selection, "with_laws_changed", lambda *_: None)
    monkeypatch.setattr(
        selection,
        "backward",
        lambda fitted, steps, *_, **__: (fitted, [each for each in steps if each.family is not mass]),
    )
    monkeypatch.setattr(selection, "copied", list)
    earlier: Any = Fake(scores=[Fake(family=mass, p=0.01), Fake(family=air, p=0.5)], level=0.01)
    _, kept, _ = forward(fit(1.5), before=steps, earlier=earlier)  # type: ignore[arg-type]
    assert [each.family.name for each in kept] == ["guide"]
    assert tried == [["mass"], ["air"]]
