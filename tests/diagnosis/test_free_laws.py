"""Free laws and the effects that claim them: the diagnosis itself knows no mechanism's name."""

import ast
from pathlib import Path

import numpy as np
import pytest

import drillenv.diagnosis
from drillenv.checks import InputError
from drillenv.diagnosis.body import Autoregression
from drillenv.diagnosis.body_rig import BodyRig, Scale
from drillenv.diagnosis.laws import HARDENING, SATURATING, SOFT_LAYER, Family, families
from drillenv.diagnosis.sensing import RESPONSES, sensor_families
from drillenv.diagnosis.sinusoids import KINDS
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.dynamics import effects
from drillenv.dynamics.effects import EVERYWHERE, LIBRARY, REGISTRY, Effect, Parameter, mechanism_of_law
from drillenv.dynamics.free_laws import FREE_LAWS

MODULES = sorted(Path(drillenv.diagnosis.__path__[0]).glob("*.py"))
FLAT = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))
UNCLAIMED = {"creep", "crosstalk", "position damping", "drift", "tone"}


def literals(source: str) -> list[str]:
    """String constants of a module, but for docstrings and strings under an assignment."""
    tree = ast.parse(source)
    said = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    constants = (each for each in ast.walk(tree) if isinstance(each, ast.Constant) and id(each) not in said)
    return [each.value for each in constants if isinstance(each.value, str)]


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.stem)
def test_no_mechanism_is_named(module):
    named = [(text, name) for text in literals(module.read_text("utf-8")) for name in REGISTRY if name in text]
    assert named == []


def test_names_are_seen_where_there_are_any():
    assert literals('"""contact-rate"""\nx = "contact-rate"\n"""backlash"""\ny = f"{x} backlash"\n') == [
        "contact-rate",
        " backlash",
    ]


def test_each_free_law_is_claimed_once():
    claims = [law for effect in LIBRARY.values() for law in effect.free_laws]
    assert len(claims) == len(set(claims))
    assert set(claims) == set(FREE_LAWS) - UNCLAIMED


def test_free_laws_are_those_that_the_diagnosis_fits():
    rig = BodyRig([], Autoregression(np.zeros(1), 1.0), Scale(1.0, 1.0, 1.0), FLAT, (), None)
    drill = [*families(FLAT, [60.0, 110.0]), *sensor_families(["r01"], 12e3)]
    groups = {each.group for each in (*drill, *rig.outside()) if not each.known_as}
    kinds = {each.name for each in KINDS}
    of_body = {"friction", "unstated damping", "tone"}
    assert groups | kinds | of_body | {HARDENING, SATURATING, SOFT_LAYER, *RESPONSES} == set(FREE_LAWS)


def effect(name: str, *laws: str) -> Effect:
    size = Parameter("s", "share of the force", "1", 0.0, 1.0, 0.0, (0.01, 0.1))
    words = "The channels are coupled.", "a_read = a + s R / m2", "constitutive"
    return Effect(name, *words, (size,), ("sensor",), EVERYWHERE, "none", free_laws=laws)


@pytest.fixture
def joined(monkeypatch):
    """Effects of another distribution beside those of the library."""

    def join(*others):
        every = {**REGISTRY, **{each.name: each for each in others}}
        monkeypatch.setattr(effects, "_registry", lambda: every)
        effects._claims.cache_clear()

    yield join
    monkeypatch.undo()
    effects._claims.cache_clear()


def test_an_effect_from_elsewhere_claims_what_no_other_does(joined):
    family = Family("crosstalk", "crosstalk", (), sentence="The channels are coupled.")
    assert (family.mechanism, family.outside) == ("crosstalk", "The channels are coupled.")
    joined(effect("lab-crosstalk", "crosstalk"))
    assert mechanism_of_law("crosstalk") == family.mechanism == "lab-crosstalk"
    assert family.outside == ""
    assert mechanism_of_law("damper") == "damping-quadratic"


def test_two_that_claim_the_same_law_are_refused(joined):
    joined(effect("lab-damper", "damper"))
    with pytest.raises(InputError, match="damping-quadratic and lab-damper both claim the free law 'damper': leave"):
        mechanism_of_law("guide")


def test_a_law_that_there_is_not_is_refused(joined):
    joined(effect("lab-damper", "dampr"))
    with pytest.raises(InputError, match="effect lab-damper claims the free law 'dampr', which is none: give damper"):
        mechanism_of_law("guide")
