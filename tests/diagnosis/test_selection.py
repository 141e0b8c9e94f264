"""What a family has to gain beside laws that are not exact."""

from dataclasses import dataclass, replace
from types import SimpleNamespace as Fake
from typing import Any

import numpy as np
import pytest

from drillenv.diagnosis import naming, resolution, selection, sinusoids, steps
from drillenv.diagnosis.adapter import Adapter, Rival
from drillenv.diagnosis.drill_identification import NUMBERS_OF_GROUP
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.fitting import LOOSE, SHORT, TIGHT, Fitted, penalty
from drillenv.diagnosis.laws import Curve, Equation, Family, equations, families, same_force
from drillenv.diagnosis.naming import Named, Tried, does_as_well, name_law
from drillenv.diagnosis.resolution import refined
from drillenv.diagnosis.score_tests import Score, ScoreTests
from drillenv.diagnosis.selection import forward, least_gain, shortlist, strength_shows, with_families_reconsidered
from drillenv.diagnosis.sensing import sensor_families
from drillenv.diagnosis.steps import accept
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.diagnosis.terms import ModelStructure, Term, Unknown
from drillenv.diagnosis.thresholds import LAW_LEFT
from drillenv.dynamics.constitutive.places import INDENTER, MOUNT_SPRING, SPRING_FROM_REST

SAMPLES = 20_000
FLAT = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))


class OfTheContact(Adapter):
    """A rig of which laws with "contact" in their names are of one force, and any response has a lag."""

    def same_force(self, family, other):
        """By the names of their groups."""
        return "contact" in family.group and "contact" in other.group

    def contains(self, family, other):
        """By the names of their groups."""
        return (family.group, other.group) == ("response", "lag")


def fit(reduced_chi_square: float, resolved: float = 0.0) -> Any:
    structure = Fake(rig=OfTheContact())
    return Fake(
        reduced_chi_square=reduced_chi_square, samples=SAMPLES, resolved=resolved, noise=[], structure=structure
    )


def score(group: str, gain: float, dof: int = 8, constant: str = "") -> Any:
    return Fake(family=Fake(group=group, constant=constant), gain=gain, dof=dof)


def step(group: str, gain: float, equation: object) -> Any:
    return Fake(
        family=Fake(name=group, group=group, constant="", terms=(group,)),
        gain=gain,
        named=Fake(equation=equation),
        pending=False,
        corrects=False,
        provisional=False,
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


def test_what_may_correct_a_measured_law_of_the_same_force_is_let_in():
    """A contact's friction that depends on depth and speed at once is no sum of laws of each."""
    measured, equation = step("contact speed", 1e5, None), step("contact speed", 1e5, "hunt-crossley")
    other = score("contact law", 500.0)
    assert least_gain(other, fit(1.5), [measured], [other]) == pytest.approx(penalty(other.dof, fit(1.5)))
    assert least_gain(other, fit(1.5), [equation], [other]) == pytest.approx(LAW_LEFT**2 * 1e5)
    # what it corrects is held against all others, and the correction itself against none
    correction = step("contact law", 500.0, None)
    correction.corrects = True
    damper = score("damper", 50.0)
    assert least_gain(damper, fit(1.5), [measured, correction], []) == pytest.approx(LAW_LEFT**2 * 1e5)
    assert least_gain(damper, fit(1.5), [correction], []) == pytest.approx(penalty(damper.dof, fit(1.5)))


@pytest.mark.parametrize(
    ("gain", "equation", "lacks", "pending", "corrects"),
    [
        (5e3, None, 4e3, False, True),
        (5e3, None, 4e3, True, False),
        (5e3, None, 1e3, False, False),
        (5e3, "power", 0.0, False, False),
        (500.0, "power", 0.0, False, True),
        (2e5, None, 1.9e5, False, False),
    ],
)
def test_a_law_beside_a_measured_one_of_the_same_force(monkeypatch, gain, equation, lacks, pending, corrects):
    """It is a mechanism where it explains more than the other's errors and an equation follows it, or most of it."""
    monkeypatch.setattr(steps, "tighten_continuity", lambda fitted, *_: fitted)

    def identified(fitted, found, say):
        return replace(
            found, named=Named("contact-power-law", equation, (Tried(equation, np.zeros(1), lacks),)), pending=pending
        )

    monkeypatch.setattr(steps, "identify_equation", identified)
    before, after = fit(1.1), fit(1.05)
    before.cost, after.cost, after.slack = gain, 0.0, 1.0
    family: Any = Fake(name="contact law", group="contact law", constant="", mechanism="contact-power-law", terms=())
    found = accept(before, family, after, 8, lambda _: None, [step("contact speed", 1e5, None)])
    assert found.corrects == corrects


def after_exchange(
    monkeypatch,
    worse: float,
    by_equation: float | None,
    rivalled: float,
    follows: object = None,
    beside: tuple[steps.Step, ...] = (),
    same_force: bool = False,
):
    """Steps beside whose first a rival came so much ``rivalled`` after it, and the fit with the rival's law, or None.

    With the rival's law in its place the fit is ``worse``, with an equation for that ``by_equation``.
    """
    size, others = 5, 10
    equation: Any = Fake(name="quadratic", effect="damping-quadratic", unknowns=(0,))
    rival: Any = Fake(name="damper", group="damper", constant="", mechanism="damping-quadratic", size=size)

    def of(cost, parameters):
        return replace(fitted, fit=Ended(np.zeros(parameters), cost))

    @dataclass
    class Ended:
        shared: np.ndarray
        cost: float

    @dataclass
    class Costs:
        fit: Ended
        structure: Any
        samples: int = SAMPLES
        reduced_chi_square: float = 1.02
        noise: tuple[str, ...] = ("as the model left it",)

        @property
        def cost(self):
            # what is weighed by another noise costs something else
            return self.fit.cost + (0.0 if self.noise == fitted.noise else 500.0)

        def refit(self, *_, noise=None, **__):
            return of(1000.0 + worse, others + size) if noise is None else replace(self, noise=noise)

    def accepted(base, family, other, dof, say):
        named = Named("damping-quadratic", equation if by_equation is not None else None)
        after = of(1000.0 + (worse if by_equation is None else by_equation),
                   others + (size if by_equation is None else 1))  # fmt: skip
        after = replace(after, noise=("as another law leaves it",))
        return Fake(after=after, named=named, terms=(), pending=False, provisional=False)

    own_size = size if follows is None else 2
    structure = Fake(rig=Fake(same_force=lambda *_: same_force))
    fitted: Any = Costs(Ended(np.zeros(others + own_size), 1000.0), structure)
    monkeypatch.setattr(steps, "without", lambda *_: (Fake(), np.zeros(others)))
    monkeypatch.setattr(steps, "with_more", lambda *_: (Fake(), np.zeros(others + size)))
    monkeypatch.setattr(steps, "refined", lambda other, family: other)
    monkeypatch.setattr(steps, "accept", accepted)
    own: Any = Fake(name="indenter", group="indenter", constant="", mechanism="indenter-friction")
    named: Any = Named("indenter-friction", follows)  # type: ignore[arg-type]
    there = [steps.Step(own, 300.0, size, SAMPLES, fitted, named, (), [(rival, rivalled)]), *beside]
    return there, named, steps.exchanged(fitted, there, lambda _: None)


@pytest.mark.parametrize(
    ("worse", "by_equation", "taken", "alike"),
    [
        (-30.0, None, True, True),  # explains more by its own law
        (0.3, 0.5, True, True),  # as much by its law, with one parameter by an equation
        (0.3, None, False, True),  # as much, and follows none either
        (15.0, 15.2, True, False),  # a little less, which fewer parameters are worth
        (60.0, 60.1, False, False),
    ],
)
def test_a_rival_takes_the_place_of_a_measured_law_where_its_equation_does_as_well(
    monkeypatch, worse, by_equation, taken, alike
):
    (there,), named, found = after_exchange(monkeypatch, worse, by_equation, 0.0)
    assert (found is not None) == taken
    assert (there.named.mechanism == "damping-quadratic") == taken
    assert ("damping-quadratic" in named.alike) == alike


@pytest.mark.parametrize(
    ("rivalled", "by_equation", "taken"),
    [
        (-45.0, -22.0, True),  # explained more by more parameters, and still does by one
        (-45.0, 30.0, False),  # the more was what its many parameters take up
        (-3.0, -22.0, False),  # not told apart at that step: what follows an equation to the noise stays
    ],
)
def test_a_rival_that_explained_more_takes_the_place_of_an_equation(monkeypatch, rivalled, by_equation, taken):
    (there,), _named, found = after_exchange(monkeypatch, -45.0, by_equation, rivalled, follows="delay")
    assert (found is not None) == taken
    assert there.named.mechanism == ("damping-quadratic" if taken else "indenter-friction")


@pytest.mark.parametrize("corrects", [True, False])
def test_a_rival_that_is_there_as_a_correction_is_tried_alone(monkeypatch, corrects):
    """One that is there as a mechanism of its own stays, as does what was found beside it."""
    damper, other = step("damper", 40.0, None), step("toe", 90.0, None)
    damper.corrects, beside = corrects, (damper, other)
    for each in beside:
        each.terms, each.rivals = (), []
    there, _named, found = after_exchange(monkeypatch, -30.0, None, 0.0, beside=beside)
    assert (found is not None) == corrects
    assert there[1:] == ([other] if corrects else list(beside))


@pytest.mark.parametrize(("follows", "same_force", "taken"),
                         [(None, True, True), (None, False, False), ("cubic", True, False)])  # fmt: skip
def test_a_law_of_the_same_force_is_tried_alone_in_a_measured_ones_place(monkeypatch, follows, same_force, taken):
    """However much worse it was then, and though it is there as a mechanism of its own: play beside a spring."""
    damper = step("damper", 40.0, "quadratic")
    damper.terms, damper.rivals = (), []
    there, _named, found = after_exchange(
        monkeypatch, -30.0, None, 250.0, follows=follows, beside=(damper,), same_force=same_force
    )
    assert (found is not None) == taken
    assert there[1:] == ([] if taken else [damper])


@pytest.mark.parametrize(("gain", "equation", "corrects"), [(5e3, None, True), (2e5, None, False), (5e3, "one", False)])
def test_a_part_of_a_measured_law_is_no_mechanism_beside_it(monkeypatch, gain, equation, corrects):
    """A channel's response has its delay: where one was measured, what a delay gains corrects it, unless it is more."""
    monkeypatch.setattr(steps, "tighten_continuity", lambda fitted, *_: fitted)
    by_delay = Named("channel-delay", "delay", ())
    monkeypatch.setattr(steps, "identify_equation", lambda _, found, say: replace(found, named=by_delay))
    before, after = fit(1.1), fit(1.05)
    before.cost, after.cost, after.slack = gain, 0.0, 1.0
    family: Any = Fake(name="lag", group="lag", constant="", mechanism="channel-delay", terms=())
    assert accept(before, family, after, 1, lambda _: None, [step("response", 1e5, equation)]).corrects == corrects


@pytest.mark.parametrize(
    ("part", "containing"),
    [
        ("lag", ["accelerometer response", "load cell with a response of its own"]),
        ("offset", ["high-pass"]),
        ("offset that drifts", ["high-pass"]),
        ("load cell", []),
    ],
)
def test_what_a_free_law_of_sensors_contains(part, containing):
    families = {each.name: each for each in sensor_families(["r01"], 25600.0)}
    assert [name for name, each in families.items() if DRILL.contains(each, families[part])] == containing
    assert not any(DRILL.contains(families[part], each) for each in families.values())


@pytest.mark.parametrize(("delays", "material"), [((1e-6, -1.5e-6), False), ((1e-6, -3e-6), True)])
def test_a_delay_that_filters_of_channels_have_anyway_is_no_mechanism(delays, material):
    """Where a family says from what size on its largest parameter counts."""
    family = next(each for each in sensor_families(["r01", "r02"], 25600.0) if each.name == "lag of each recording")
    term = family.terms[0]
    structure = ModelStructure((term,), FLAT, DRILL)
    fitted = Fitted(structure, [], Fake(shared=np.array(delays) / term.scales))  # type: ignore[arg-type]
    assert selection.is_material(family, fitted) == material
    offset = next(each for each in sensor_families(["r01"], 25600.0) if each.name == "offset")
    assert selection.is_material(offset, fitted)


@pytest.mark.parametrize(("left", "worse", "as_well"), [(1.5, 500.0, False), (3.6, 500.0, True), (3.6, 5e3, False)])
def test_in_a_far_model_a_law_takes_up_a_part_of_what_else_is_missing(left, worse, as_well):
    law: Any = Fake(reduced_chi_square=left, samples=SAMPLES, cost=0.5 * left * SAMPLES, residual_dof=SAMPLES)
    assert does_as_well(worse, 1e6, 20, law) is as_well


def test_an_equation_does_not_come_near_to_a_simpler_one_that_is_singular():
    """Dry friction rounded over no speed, whose derivative no motion has."""
    forms = {each.form.name: each for each in equations([INDENTER], ["indenter_bristles", "indenter_grip"])}
    low = {each.name: each.low for each in forms["stribeck"].unknowns}
    assert low["vs2"] == pytest.approx(2e-4)
    assert low["fc2"] == 0.0


@pytest.mark.parametrize(("costs", "chosen"), [((90.0, 200.0), "coulomb"), ((115.0, 200.0), "stribeck")])
def test_an_equation_that_was_chosen_in_a_far_model_is_provisional(monkeypatch, costs, chosen):
    """Beside what else was missing then, one with more parameters may have done better than the true one."""
    unknown = Fake(value=0.0, scale=1.0)
    stribeck, coulomb, rounded = (
        Equation(name, (unknown,) * size, effect="indenter-friction")  # type: ignore[arg-type]
        for name, size in (("stribeck", 3), ("coulomb", 1), ("rounded", 2))
    )
    made = dict(zip(("coulomb", "rounded"), costs, strict=True))

    class Close:
        samples, cost, reduced_chi_square = SAMPLES, 100.0, 1.1

        def __init__(self, structure, size, cost):
            self.structure, self.fit, self.cost = structure, Fake(shared=np.zeros(size)), cost

        def refit(self, structure=None, start=None, *_, **__):
            return self if structure is None else Close(structure, start.size, made[structure.terms[-1].name])

    monkeypatch.setattr(steps, "without", lambda fitted, terms: (rest, np.zeros(8)))
    monkeypatch.setattr(steps, "replace", lambda each, **new: Fake(**{**vars(each), **new}))
    rest = Fake(terms=())
    worse = ((stribeck, -50.0), (coulomb, 0.0), (rounded, -30.0), (stribeck, 900.0))
    tried = tuple(Tried(each, np.zeros(len(each.unknowns)), by) for each, by in worse)
    named = Fake(equation=stribeck, tried=tried, mechanism="indenter-friction")
    there = Fake(named=named, terms=(stribeck,))
    close: Any = Close(Fake(terms=(stribeck,)), 11, 100.0)
    found: Any = steps.reconsidered(close, there, 60.0, lambda _: None)  # type: ignore[arg-type]
    assert found.named.equation.name == chosen and not found.provisional
    assert found.after.cost == (costs[0] if chosen == "coulomb" else 100.0)
    # what has been found since is too little to make up for that
    found = steps.reconsidered(close, there, 40.0, lambda _: None)  # type: ignore[arg-type]
    assert found.named.equation.name == "stribeck"


def test_laws_of_one_force():
    laws = {each.group: each for each in families(FLAT, [60.0, 90.0, 110.0])}
    for one, other, same in (
        ("contact law", "contact speed", True), ("contact law", "compaction", True), ("spring", "damper", True),
        ("waveform", "drive gain", True), ("spring", "contact law", False), ("guide", "indenter", False),
    ):  # fmt: skip
        assert same_force(laws[one], laws[other]) == same_force(laws[other], laws[one]) == same, (one, other)


def test_the_gain_of_a_law_by_the_quadratic_of_the_likelihood():
    """Wald's: by all coefficients of a curve, and by the strength of an equation, wherever a fit of it begins."""
    unknown = Unknown("coefficient", 0.0, 2.0)
    equation = next(each for each in equations([INDENTER], []) if len(each.unknowns) == 2)
    strength, scale = equation.unknowns[0].value, equation.scales[0]
    assert strength != 0.0
    terms = Term("constants", (unknown,)), Curve("curve", (unknown,) * 2), equation
    fitted = Fitted(
        ModelStructure(terms, FLAT, DRILL), [],
        Fake(shared=np.array([9.0, 1.0, 2.0, strength / scale, 9.0])),  # type: ignore[arg-type]
    )  # fmt: skip
    vars(fitted)["covariance"] = np.diag([1.0, 0.5, 0.25, 4.0, 1.0])
    by_curve, by_equation, by_constant = (Fake(terms=each) for each in (terms[1:2], terms[2:], ()))
    assert selection.wald_gain(fitted, by_curve) == pytest.approx(0.5 * (1.0 / 0.5 + 4.0 / 0.25))  # type: ignore
    assert selection.wald_gain(fitted, by_equation) == pytest.approx(0.5 * (strength / scale) ** 2 / 4.0)  # type: ignore
    assert selection.wald_gain(fitted, by_constant) == 0.0  # type: ignore[arg-type]


def test_a_correction_of_an_equation_is_spared_in_close_models_only():
    """However much an equation explains, what it leaves in a model that is not close is not to be put up with."""
    there = [step("mount", 1e6, "one mass")]
    correction = score("mount", 5e3)
    close, far = (least_gain(correction, fit(chi_square), there, [correction]) for chi_square in (1.2, 3.0))
    assert close == pytest.approx(LAW_LEFT**2 * 1e6)
    assert far == pytest.approx(penalty(correction.dof, fit(3.0)))


def test_what_an_equation_leaves_is_what_its_own_correction_gains():
    there = [step("mount", 1e6, "one mass")]
    scores = [score("mount", 400.0), score("damper", 300.0)]
    assert least_gain(scores[1], fit(1.5), there, scores) == pytest.approx(400.0)


def test_an_equation_whose_correction_was_dismissed_leaves_nothing():
    there, other = [step("hum", 1e4, "library")], score("air", 60.0)
    assert least_gain(other, fit(1.5), there, [other]) == pytest.approx(LAW_LEFT**2 * 1e4)
    assert least_gain(other, fit(1.5), there, [other], {"hum"}) == pytest.approx(penalty(other.dof, fit(1.5)))
    free = [step("hum", 1e4, None)]
    assert least_gain(other, fit(1.5), free, [other], {"hum"}) == pytest.approx(LAW_LEFT**2 * 1e4)


@pytest.mark.parametrize(("strength", "shows"), [(2.5, True), (0.5, False), (-2.5, True)])
def test_states_of_its_own_are_no_evidence_of_a_mechanism(strength, shows):
    """Air without stiffness fits whatever fades away; its strength is the first parameter of its own term."""
    unknown = Unknown("stiffness", 0.0, 1e4)
    others, air = Term("constants", (unknown,) * 2), Term("air", (unknown,) * 2)
    structure = ModelStructure((others, air), FLAT, DRILL)
    fit: Any = Fake(shared=np.array([9.0, 9.0, strength, 9.0]))
    fitted = Fitted(structure, [], fit)
    # as computed from a fit, which this one has not
    vars(fitted)["covariance"] = np.diag([1e-6, 1e-6, 0.5**2, 1e-6])
    family: Any = Fake(terms=[air])
    assert strength_shows(family, fitted) == shows


@pytest.mark.parametrize(
    ("others", "shown", "gain", "kept"),
    [
        ((), False, 200.0, True),
        ((), False, 2.0, False),
        ((80.0,), False, 200.0, False),
        ((80.0,), True, 0.0, True),
        # by as little as its parameters are fewer
        ((88.0,), False, 200.0, True),
    ],
)
def test_a_strength_that_does_not_show_is_put_to_the_likelihood_ratio_where_it_would_come_first(
    monkeypatch, others, shown, gain, kept
):
    monkeypatch.setattr(selection, "strength_shows", lambda *_: shown)
    monkeypatch.setattr(selection, "gain_of_strength", lambda *_: gain)
    found: Any = [(Fake(family=Fake(name="mount 40 Hz"), size=3), Fake(cost=90.0))]
    there: Any = [(Fake(family=Fake(name="damper"), size=6), Fake(cost=cost)) for cost in others]
    fitted: Any = Fake(samples=100)
    assert list(selection.of_some_strength(found, there, fitted, lambda _: None)) == (found if kept else [])


@pytest.mark.parametrize(
    ("stiffness", "std", "left", "again"),
    [
        (140.0, 10.0, 0.5, True),  # strained, and half is left
        (140.0, 10.0, 0.05, False),  # next to nothing is left
        (130.0, 10.0, 0.5, False),  # within what labs misjudge
        (140.0, np.inf, 0.5, False),  # of which nothing is believed
    ],
)
def test_a_family_is_begun_from_stated_constants_too_where_they_are_strained(monkeypatch, stiffness, std, left, again):
    """What a family explains constants may have taken up, and states with them."""
    structure = ModelStructure((Term("constants", (Unknown("stiffness", 100.0, 10.0, std),)),), FLAT, DRILL)
    block: Any = Fake(slack=TIGHT, samples=1001, free_unknowns=lambda _: 0)
    own = [np.zeros(0)]
    before = Fitted(structure, [block], Fake(shared=np.array([stiffness / 10.0]), own=own, cost=600.0))  # type: ignore

    def with_family(fitted, _family, _limits, from_nominal=False):
        cost = 500.0 + (100.0 * left if not from_nominal else 0.0)
        return replace(fitted, fit=Fake(shared=fitted.fit.shared, own=own, cost=cost, from_nominal=from_nominal))

    monkeypatch.setattr(selection, "with_family", with_family)
    found: Any = selection.short_fit(before, Fake(constant=""))  # type: ignore[arg-type]
    assert found.fit.from_nominal == again


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


@pytest.mark.parametrize(("left", "fitted_too"), [(300.0, False), (900.0, True)])
def test_what_has_states_is_fitted_where_no_score_promises_most_of_what_is_left(left, fitted_too):
    """By the quadratic about no air the guide's friction gains more; how much air gains, that says least of."""

    def of(name: str, gain: float, has_states: bool) -> Any:
        return Fake(
            family=Fake(name=name, group=name, constant="", has_states=has_states), gain=gain, p=0.0, confirmed=True
        )

    scores = [of("guide", 200.0, False), of("air", 8.0, True)]
    there: Any = Fake(reduced_chi_square=1.3, cost=0.5 * SAMPLES + left, residual_dof=SAMPLES)
    found = shortlist(scores, 0.01, [0.0, 0.0], there)
    assert [each.family.name for each in found] == (["guide", "air"] if fitted_too else ["guide"])


@pytest.mark.parametrize(("chi_square", "equation"), [(1.3, None), (1.02, None), (1.3, "coulomb")])
def test_a_measured_law_that_leaves_something_is_held_against_other_families(monkeypatch, chi_square, equation):
    """Those that would be candidates without it, until it leaves nothing or none does better."""
    spring, air, own = (Fake(name=name, group=group) for name, group in
                        [("spring", "spring"), ("air", "air"), ("presliding guide", "guide")])  # fmt: skip
    there = step("guide", 90.0, equation)
    there.terms, there.rivals, there.named.mechanism = (), [(spring, 40.0)], "guide-friction"
    asked = []

    def exchanged(fitted, steps, say):
        asked.append([each.name for each, _ in steps[0].rivals])
        return better if len(asked) == 1 else None

    before, better = fit(chi_square), fit(1.2)
    before.refit = better.refit = lambda *_, **__: fit(3.0)
    monkeypatch.setattr(selection, "without", lambda *_: ())
    monkeypatch.setattr(selection, "still_possible", lambda *_: [])
    monkeypatch.setattr(selection, "score_tests", lambda *_: ScoreTests([], 0.01))
    monkeypatch.setattr(selection, "shortlist", lambda *_: [Fake(family=each) for each in (own, spring, air)])
    monkeypatch.setattr(selection, "exchanged", exchanged)
    found = with_families_reconsidered(before, [there], lambda _: None)
    if chi_square < 1.06:
        assert found is before and not asked
    elif equation is None:
        assert found is better and asked == [["spring", "air"]] * 2
    else:
        assert asked[0] == ["spring"]


def test_equations_that_stretches_did_not_tell_apart_are_reconsidered_once(monkeypatch):
    """By what another family would gain in as many samples as they were chosen on; a measured law has none."""
    named = Named("guide-friction", "coulomb")  # type: ignore[arg-type]
    family: Any = Fake(name="guide", group="guide", constant="")
    before, after = fit(1.03), fit(1.02)
    chosen: Any = steps.Step(family, 150.0, 1, SAMPLES // 4, before, named, (), [])
    there = [chosen, replace(chosen, named=Named("backlash", None))]
    asked = []

    def reconsidered(fitted, step, beside, say):
        asked.append(beside)
        return replace(step, after=after)

    monkeypatch.setattr(steps, "reconsidered", reconsidered)
    assert steps.with_equations_reconsidered(before, there, 80.0, lambda _: None) is after
    assert steps.with_equations_reconsidered(after, there, 80.0, lambda _: None) is after
    assert asked == [20.0]
    assert (there[0].gain, there[0].samples) == (600.0, SAMPLES)


def test_the_search_goes_on_without_what_was_left_out(monkeypatch):
    """Beside what is needless after all, another family looked like chance; what was left out is not tried again."""
    there = [step("guide", 90.0, None), step("mass", 60.0, None)]
    mass, air = there[1].family, Fake(name="air", group="air")
    tried = []

    def score_tests(fitted, families):
        tried.append([each.name for each in families])
        return ScoreTests([], 0.01)

    monkeypatch.setattr(selection, "tighten_continuity", lambda fitted, *_: fitted)
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
    _, kept, _ = forward(fit(1.5), before=there, earlier=earlier)  # type: ignore[arg-type]
    assert [each.family.name for each in kept] == ["guide"]
    assert tried == [["mass"], ["air"]]


@pytest.mark.parametrize(
    ("left", "predicted", "worse"), [(1.2, 0.0, [-50.0, 180.0]), (1.02, 0.0, [180.0]), (1.02, 201.0, [])]
)
def test_an_equation_is_tried_from_the_model_without_the_law_too(monkeypatch, left, predicted, worse):
    """Where a free law came to a poor minimum, the equation that is nearest to it there leads nowhere.

    A law that leaves nothing is at none, and an equation that lacks more than the law gains is not tried.
    """
    (coulomb,) = (each for each in equations([INDENTER], []) if len(each.unknowns) == 1)
    rivals = [Rival(coulomb, [(np.zeros(1), np.array([900.0]))], predicted)]
    rig = Fake(rivals=lambda *_: rivals, taken_up=lambda _: [], mechanisms_by_law=lambda *_: ("of the law",))

    @dataclass
    class Valleys:
        """A fit that stays in the valley where it begins: at the equation's own start, and far off."""

        structure: Any
        start: Any
        cost: float
        samples, reduced_chi_square, slack = SAMPLES, left, 2.0

        def refit(self, structure=None, start=None, *_, **__):
            if structure is None:
                return self
            if structure.terms[-1] is not coulomb:
                return Valleys(structure, start, 300.0)
            return Valleys(structure, start, 50.0 if start[-1] * coulomb.scales[0] < 100.0 else 280.0)

        @property
        def fit(self):
            return Fake(shared=self.start)

        def values_of(self, _name):
            return self.start[-1:] * coulomb.scales

    rest = ModelStructure((Term("constants", (Unknown("stiffness", 0.0, 1.0),)),), FLAT, DRILL)
    monkeypatch.setattr(naming, "without", lambda *_: (rest, np.zeros(1)))
    monkeypatch.setattr(naming, "on_axes", lambda structure, _axes: structure)
    law: Any = Fake(textbook=False, terms=(), size=8, has_states=False, mechanism="law")
    free: Any = Valleys(Fake(rig=rig), np.zeros(9), 100.0)
    named, found = name_law(free, law, 200.0)
    if len(worse) == 2:
        assert named.equation is coulomb and found.cost == 50.0
    else:
        assert named.equation is None and found is free
    assert [each.worse for each in named.tried] == worse


@pytest.mark.parametrize(("left", "limits"), [(1.02, LOOSE), (1.3, SHORT)])
def test_beside_a_family_that_leaves_nothing_others_are_not_followed_while_they_creep(monkeypatch, left, limits):
    given = []

    def fitted_with(_fitted, family, limits):
        given.append(limits)
        found = fit(left if family.name == "first" else 2.0)
        found.cost = 100.0 if family.name == "first" else 5000.0
        found.refit = lambda: found
        return found

    monkeypatch.setattr(selection, "short_fit", fitted_with)
    before = fit(3.0)
    before.cost, before.residual_dof, before.slack = 10_000.0, SAMPLES, TIGHT
    tried: Any = [
        Fake(family=Fake(name=name, starting_strength=0.0, has_states=False), gain=gain, size=3)
        for name, gain in (("first", 9000.0), ("second", 6000.0))
    ]
    found = selection.refine_candidates(before, tried, lambda _: None, 9000.0)
    assert given == [SHORT, limits]
    assert [each.family.name for each, _ in found] == ["first", "second"]


def test_an_equation_that_ends_worse_than_a_special_case_of_it_is_begun_from_that(monkeypatch):
    """Rounded friction is Stribeck's with nothing that fades: where that ends higher, that is no minimum."""
    rounded, stribeck, coulomb, dahl = (
        next(each for each in equations([INDENTER], []) if each.form.name == name)
        for name in ("rounded", "stribeck", "coulomb", "dahl")
    )
    begun = []

    @dataclass
    class Ended:
        equation: Any
        cost: float
        reduced_chi_square = 1.01

        def values_of(self, _name):
            return np.array([60.0, 1e-3])

        def refit(self, structure=None, start=None, *_, **__):
            if structure is None:
                return self
            begun.append((structure.terms[-1], start))
            return Ended(structure.terms[-1], 70.0)

    base = ModelStructure((Term("constants", (Unknown("stiffness", 0.0, 1.0),)),), FLAT, DRILL)
    monkeypatch.setattr(naming, "without", lambda *_: (base, np.array([5.0])))
    tried = [(each, Ended(each, cost)) for each, cost in
             ((rounded, 80.0), (stribeck, 120.0), (stribeck, 110.0), (coulomb, 95.0), (dahl, 90.0))]  # fmt: skip
    found = naming.from_special_cases(tried, 8, 0.0, lambda _: None)  # type: ignore[arg-type]
    # Dahl's has ended lower than Coulomb's, which it contains as well
    assert [each for each, _ in found] == [stribeck] and found[0][1].cost == 70.0
    ((equation, start),) = begun
    assert equation is stribeck and start[0] == 5.0
    share, speed = (stribeck.form.starts[0][i] for i in (2, 3))
    assert np.allclose(start[1:] * stribeck.scales, [60.0, 1e-3, share, speed])


@dataclass
class Ended:
    """A fit that ends at a cost with these values; what is refitted ends at another, and its start is noted."""

    cost: float
    values: np.ndarray
    refitted: float
    begun: list[np.ndarray]
    reduced_chi_square: float

    def values_of(self, _name):
        return self.values

    def refit(self, structure=None, start=None, *_, **__):
        if structure is not None:
            self.begun.append(start[1:] * structure.terms[-1].scales)
        return replace(self, cost=self.refitted)


def ended_fits(monkeypatch, values, refitted, reduced_chi_square):
    """A maker of such fits, over one constant; and where fits that go on from them begin."""
    begun: list[np.ndarray] = []
    base = ModelStructure((Term("constants", (Unknown("stiffness", 0.0, 1.0),)),), FLAT, DRILL)
    monkeypatch.setattr(naming, "without", lambda *_: (base, np.array([5.0])))

    def made(cost, left=reduced_chi_square):
        return Ended(cost, np.array(values), refitted, begun, left)

    return made, begun


def test_a_simpler_equation_is_begun_from_the_one_that_found_a_deeper_minimum(monkeypatch):
    """Play with ends that are hardly rounded is play: where the latter has ended elsewhere, it begins from there."""
    sharp, rounded = (
        next(each for each in equations([SPRING_FROM_REST], []) if each.form.name == name)
        for name in ("no force over the play", "rounded ends")
    )
    ended, begun = ended_fits(monkeypatch, [1e-3, -8e-5, 4e-6], 80.5, 1.02)
    tried = [(sharp, ended(300.0)), (rounded, ended(80.0))]
    ((equation, other),) = naming.from_general_case(tried, lambda _: None)  # type: ignore[arg-type]
    assert equation is sharp and other.cost == 80.5
    assert np.allclose(begun, [[1e-3, -8e-5]])
    # one that has ended as well is left alone
    assert not naming.from_general_case([(sharp, ended(82.0)), (rounded, ended(80.0))], lambda _: None)  # type: ignore[arg-type]


def test_an_equation_of_more_parameters_than_the_law_is_begun_from_its_special_case(monkeypatch):
    """A mount of one mass says nothing of where the second one's fit begins: it is begun at each of its starts."""
    one, two = (
        next(each for each in equations([MOUNT_SPRING], NUMBERS_OF_GROUP["mount"]) if each.form.name == name)
        for name in ("one mass", "two masses")
    )
    ended, begun = ended_fits(monkeypatch, [2e-8, 25.0, 0.2], 50.0, 1.3)
    tried = [(one, ended(90.0)), (two, ended(80.0))]
    size = len(one.unknowns)
    ((equation, other),) = naming.from_special_cases(tried, size, 100.0, lambda _: None)  # type: ignore[arg-type]
    assert equation is two and other.cost == 50.0
    beds = {start[3:] for start in two.form.starts}
    assert {tuple(np.round(each[3:], 12)) for each in begun} == beds and len(begun) == len(beds) > 1
    assert all(np.allclose(each[:3], [2e-8, 25.0, 0.2]) for each in begun)
    assert not naming.from_special_cases(tried, len(two.unknowns), 100.0, lambda _: None)  # type: ignore[arg-type]
    # one that leaves nothing calls for no second mass, and of one that explains little nothing is to be had
    nothing_left = [(one, ended(90.0, 1.01)), (two, ended(80.0, 1.01))]
    assert not naming.from_special_cases(nothing_left, size, 100.0, lambda _: None)  # type: ignore[arg-type]
    assert not naming.from_special_cases(tried, size, 85.0, lambda _: None)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("by_corners", "by_detail", "left"),
    [(1.4, 1.2, 1.4), (4.0, 1.3, 1.3), (4.0, 3.5, 5.0)],  # corners do; detail does; neither takes most
)
def test_a_coarse_law_of_a_far_model_is_drawn_sharper_where_that_takes_most(monkeypatch, by_corners, by_detail, left):
    term, drawn = Curve("waveform", ()), Curve("waveform", ("finer",))  # type: ignore[arg-type]

    def made(reduced_chi_square: float) -> Any:
        return Fake(reduced_chi_square=reduced_chi_square, structure=Fake(current=lambda _terms: (drawn,)))

    monkeypatch.setattr(steps, "with_corners", lambda *_: made(by_corners))
    monkeypatch.setattr(steps, "with_detail", lambda *_: made(by_detail))
    family: Any = families(FLAT, [60.0, 90.0])[0]
    begun = steps.Step(replace(family, terms=(term,)), 1e6, 8, SAMPLES, made(5.0), Named("", None), (term,), [])
    found = steps.drawn_sharper(begun, lambda _: None)
    assert found.after.reduced_chi_square == left
    assert found.terms == found.family.terms == ((drawn,) if left < 5.0 else (term,))
    assert found.detail == (resolution.DETAILS[0] if left == by_detail else begun.detail)


@pytest.mark.parametrize(
    ("chi_square", "gain", "at_last", "with_corners", "coarse"),
    [
        (1.5, 2e6, False, 1.3, True),  # what is left is less than a tenth of the law is worth
        (1.5, 2e6, False, 1.2, False),  # but corners take most of it
        (1.5, 2e5, False, 1.3, False),
        (1.5, 2e6, True, 1.3, False),
        (1.03, 2e6, False, 1.03, False),  # nothing is left that others could explain
    ],
)
def test_a_law_that_errs_by_little_is_not_drawn_finer_before_others_are_looked_for(
    monkeypatch, chi_square, gain, at_last, with_corners, coarse
):
    curve, drawn = Curve("spring", ()), []  # type: ignore[arg-type]
    structure: Any = Fake(rig=Fake(noise_left=lambda _: (), axes_at=lambda _: None), current=lambda terms: terms)

    def fit(chi_square: float) -> Any:
        return Fake(
            reduced_chi_square=chi_square, cost=chi_square * SAMPLES / 2, residual_dof=SAMPLES, samples=SAMPLES,
            noise=(), structure=structure, fit=Fake(shared=np.zeros(3)), refit=lambda *_, **__: found,
        )  # fmt: skip

    found, sharper = fit(chi_square), fit(with_corners)
    tried = Tried(Term("equation", ()), np.zeros(0), 0.4 * gain)
    monkeypatch.setattr(steps, "name_law", lambda *_: (Named("spring", None, (tried,)), found))
    monkeypatch.setattr(steps, "named_by_law", lambda named, *_: named)
    monkeypatch.setattr(steps, "refined", lambda fitted, _family: drawn.append(fitted) or fitted)
    monkeypatch.setattr(steps, "corrected_equation", lambda *_: (found, (curve,)))
    monkeypatch.setattr(steps, "on_axes", lambda structure, axes: structure)
    monkeypatch.setattr(steps, "with_corners", lambda *_: sharper)
    monkeypatch.setattr(steps, "with_detail", lambda *_: found)
    family: Any = replace(families(FLAT, [60.0, 90.0])[0], terms=(curve,))
    begun = steps.Step(family, gain, 8, SAMPLES, found, Named("spring", None), (curve,), [], pending=True)
    ended = steps.identify_equation(found, begun, lambda _: None, at_last)
    assert ended.coarse == coarse and bool(drawn) != coarse
    assert ended.terms == (curve,) and not ended.pending


@pytest.mark.parametrize(("chi_square", "drawn"), [(1.5, True), (11.0, False)])
def test_in_a_far_model_an_equation_is_not_held_against_a_finer_law(monkeypatch, chi_square, drawn):
    """A clipped drive beside friction with bristles: a finer law took up a quarter of what friction leaves."""
    structure: Any = Fake(rig=Fake(noise_left=lambda _: (), axes_at=lambda _: None), current=lambda terms: terms)
    finer: list[Any] = []

    def fit(chi_square: float) -> Any:
        return Fake(
            reduced_chi_square=chi_square, cost=chi_square * SAMPLES / 2, residual_dof=SAMPLES, samples=SAMPLES,
            noise=(), structure=structure, fit=Fake(shared=np.zeros(3)), refit=lambda *_, **__: by_equation,
        )  # fmt: skip

    def refined(fitted, _family):
        finer.append(fitted)
        return fit(0.75 * chi_square)

    found, by_equation = fit(chi_square), fit(1.01 * chi_square)
    equation: Any = Fake(name="clipped")
    named = Named("force-limit", equation, (Tried(equation, np.zeros(1), 0.01),))
    monkeypatch.setattr(steps, "name_law", lambda *_: (named, by_equation))
    monkeypatch.setattr(steps, "named_by_law", lambda named, *_: named)
    monkeypatch.setattr(steps, "refined", refined)
    monkeypatch.setattr(steps, "corrected_equation", lambda *_: (found, ()))
    monkeypatch.setattr(steps, "on_axes", lambda structure, axes: structure)
    monkeypatch.setattr(steps, "tighten_continuity", lambda fitted: fitted)
    family: Any = replace(families(FLAT, [60.0, 90.0])[0], terms=(Curve("drive", ()),))  # type: ignore[arg-type]
    begun = steps.Step(family, 1e5, 8, SAMPLES, found, Named("force-limit", None), family.terms, [], pending=True)
    ended = steps.identify_equation(found, begun, lambda _: None)
    assert bool(finer) == drawn
    assert (ended.named.equation is equation) != drawn


@pytest.mark.parametrize(
    ("chi_square", "ahead", "first"),
    [
        (18.0, 9e3, "offset"),  # next to what else is missing that is little
        (18.0, 9e4, "high-pass"),
        (1.5, 9e3, "high-pass"),  # the noise tells them apart
    ],
)
def test_in_a_far_model_the_simplest_family_of_those_near_comes_first(chi_square, ahead, first):
    def pair(name: str, size: int, cost: float) -> Any:
        other = Fake(cost=cost, reduced_chi_square=chi_square, residual_dof=SAMPLES, samples=SAMPLES)
        return Fake(family=Fake(name=name), size=size), other

    least = 0.5 * chi_square * SAMPLES
    fits = [pair("high-pass", 14, least), pair("offset", 2, least + ahead), pair("drive gain", 1, 10.0 * least)]
    found = selection.simplest_first(fits, fits[0][1])
    assert found[0][0].family.name == first and len(found) == 3


@pytest.mark.parametrize(("finer", "taken"), [(90.0, True), (101.0, False)])
def test_a_law_that_was_left_coarse_is_drawn_finer_in_the_end(monkeypatch, finer, taken):
    structure = Fake(current=lambda terms: terms)
    fitted: Any = Fake(cost=100.0, samples=SAMPLES, structure=structure, fit=Fake(shared=np.zeros(3)), noise=(1,))
    after: Any = Fake(cost=finer, fit=Fake(shared=np.zeros(3)), noise=(1,))
    family: Any = replace(families(FLAT, [60.0, 90.0])[0], terms=())
    begun = steps.Step(family, 1e4, 8, SAMPLES, fitted, Named("spring", None), (), [], coarse=True)

    def identified(_, step, say, at_last):
        assert at_last and not step.coarse
        return replace(step, after=after)

    monkeypatch.setattr(steps, "identify_equation", identified)
    found = [begun]
    assert steps.with_coarse_law_refined(fitted, found, lambda _: None) is (after if taken else None)
    assert found[0].after is (after if taken else fitted) and not found[0].coarse
    # once is enough
    assert steps.with_coarse_law_refined(fitted, found, lambda _: None) is None


@pytest.mark.parametrize(("gain", "left", "freed"), [(60.0, 1.001, True), (40.0, 1.001, False), (40.0, 1.5, True)])
def test_friction_from_above_is_not_followed_beside_what_explains_all(monkeypatch, gain, left, freed):
    fitted: Any = Fake(cost=1000.0, slack=TIGHT, reduced_chi_square=2.0)
    best: Any = Fake(cost=900.0, reduced_chi_square=left)
    found, other = Fake(cost=1000.0 - gain), Fake(cost=1000.0, slack=TIGHT)
    tried: list[object] = []
    monkeypatch.setattr(selection, "with_family", lambda *_: found)
    monkeypatch.setattr(selection, "start_with", lambda *_: (None, None))
    monkeypatch.setattr(selection, "with_continuity_relaxed", lambda *_, **__: tried.append(other) or other)
    assert selection.from_above(fitted, Fake(starting_strength=1.0), SHORT, best) is found  # type: ignore[arg-type]
    assert bool(tried) == freed


@pytest.mark.parametrize(("moved", "stayed", "ends"), [(1.05, 1.3, 1.05), (3250.0, 1.2, 1.2)])
def test_a_fit_over_other_ranges_that_ends_worse_is_not_kept(monkeypatch, moved, stayed, ends):
    class Ends:
        reduced_chi_square, noise = 1.04, ()
        structure: Any = Fake(rig=Fake(noise_left=lambda _: (), axes_at=lambda _: None))
        fit = Fake(shared=np.zeros(3))

        def refit(self, structure=None, **_):
            return Fake(reduced_chi_square=stayed if structure is None else moved)

    monkeypatch.setattr(steps, "on_axes", lambda structure, axes: structure)
    family: Any = Fake(terms=(), constant="another mass")
    begun = steps.Step(family, 1e3, 1, SAMPLES, None, Named("mass", None), (), [])  # type: ignore[arg-type]
    found = steps.identify_equation(Ends(), begun, lambda _: None)  # type: ignore[arg-type]
    assert found.after.reduced_chi_square == ends


def test_what_stands_beside_each_recordings_own_has_to_gain_where_it_was_not_fitted():
    found = {each.name: each for each in sensor_families(["r01", "r02"], 25600.0)}
    assert {name for name, each in found.items() if each.partly_own} == {"high-pass"}
    score = Score(found["high-pass"], 100.0, 18, 0.0, 1.0)
    assert not score.confirmed and score._replace(cross_validated=10.0).confirmed
    # a wave of no amplitude, where it is tested, shows nothing of the frequency that recordings have in common
    found["vibration"] = sinusoids.family(sinusoids.KINDS[0], 34.0, ["r01", "r02"], np.array([33.5, 34.0]))
    for name in ("offset", "lag of each recording", "load cell", "vibration"):
        assert score._replace(family=found[name]).confirmed
        assert not score._replace(family=found[name], cross_validated=-10.0).confirmed


@pytest.mark.parametrize(
    ("costs", "worse", "first"),
    [
        ((900.0, 905.0), (300.0, 1.0), "damper"),  # alike as free laws, and one of them is the library's
        ((900.0, 905.0), (300.0, 300.0), "indenter"),  # neither is
        ((900.0, 905.0), (0.0, 1.0), "indenter"),  # both are
        ((900.0, 990.0), (300.0, 1.0), "indenter"),  # what fewer parameters are worth is less than one is ahead
    ],
)
def test_of_laws_that_explain_alike_the_one_nearer_to_an_equation_comes_first(costs, worse, first):
    unknown = Unknown("size", 0.0, 1.0)
    laws = {"indenter": worse[0], "damper": worse[1]}
    rig = Fake(rivals=lambda _fitted, family: [Rival(Term("equation", (unknown,)), [], laws[family.name])])
    fits: Any = [
        (
            Score(Fake(name=name, terms=(Curve(name, ()),), has_states=False), 1e4, 8, 0.0, 1e4),  # type: ignore[arg-type]
            Fake(cost=cost, samples=SAMPLES, structure=Fake(rig=rig)),
        )
        for name, cost in zip(laws, costs, strict=True)
    ]
    found = selection.by_nearest_equations(fits, fit(2.0))
    assert [score.family.name for score, _ in found] == sorted(laws, key=lambda name: name != first)


def test_a_measured_law_is_tried_again_beside_another_model(monkeypatch):
    """Not while the same terms stand beside it, but once one of them is another law."""
    tried: list[object] = []
    curve, other = Term("spring", ()), Term("damper", ())
    fitted: Any = Fake(samples=SAMPLES, structure=Fake(current=lambda terms: terms))
    family = Family("spring", "spring", (curve,))

    def measured(family: Family, gain: float) -> steps.Step:
        return steps.Step(family, gain, 8, SAMPLES, fitted, Named(family.mechanism, None), family.terms, [])

    spring, damper = measured(family, 500.0), measured(Family("damper", "damper", (other,)), 1e4)
    damper.corrects = True
    monkeypatch.setattr(steps, "name_law", lambda *_: tried.append(1) or (Named("spring", None), fitted))
    for _ in range(2):
        assert steps.with_equations(fitted, [spring, damper], lambda _: None) is None
    assert len(tried) == 1
    damper.terms = (Term("damping-quadratic: quadratic", ()),)
    assert steps.with_equations(fitted, [spring, damper], lambda _: None) is None
    assert len(tried) == 2
