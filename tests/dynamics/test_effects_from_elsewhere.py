"""Effects that another distribution brings by the entry point group ``drillenv.effects``."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import drillenv

ROOT = Path(drillenv.__file__).parent.parent

MODULE = """
from drillenv.dynamics.effects import IN_CONTACT, ON_ROCK, Effect, Parameter

def _term(now, own, p, push, rates):
    push[ON_ROCK] += p[0] * now.into

def kelvin(name):
    damping = Parameter("c_r", "damping of the rock", "N s/m", 0.0, 1e5, 0.0, (100.0, 800.0))
    return Effect(name, "The rock damps the blows.", "R = R_law + c_r V", "constitutive", (damping,), ("contact",),
                  IN_CONTACT, "loses", term=_term)

ONE = kelvin("lab-kelvin")
TWO = [kelvin("lab-voigt"), kelvin("lab-maxwell")]
KNOWN = kelvin("contact-rate")

# as a law, in NumPy
import numpy as np

def _law(speed, p, stiffness):
    return p[0] * speed

LAW = Effect(
    "lab-newton", "The rock damps the blows.", "R = R_law + c_r V", "constitutive",
    (Parameter("c_r", "damping of the rock", "N s/m", 0.0, 1e5, 0.0, (100.0, 800.0)),), ("contact",), IN_CONTACT,
    "loses", laws={"rate-force": _law},
)

# in ten lines of NumPy, for the diagnosis too
from drillenv.dynamics.effects import EVERYWHERE
from drillenv.dynamics.forms import Form

CUBIC = Effect(
    "lab-cubic", "The coupling's damping grows with the cube of the speed.", "coupling force + c3 (X1' - X2')^3",
    "constitutive", (Parameter("c3", "cubic damping", "N s^3/m^3", 0.0, 1e6, 0.0, (1e3, 5e3)),), ("indenter",),
    EVERYWHERE, "loses", laws={"damper": lambda speed, p, stiffness: p[0] * speed**3},
    forms=(Form("cubic", ("c3",), ((2000.0,),)),),
)

# compiled, with a state of its own
from drillenv.dynamics.effects import ON_SHAKER, Extra

def _leak(now, own, p, push, rates):
    push[ON_SHAKER] -= own[0]
    rates[0] = p[0] * now.v1 - own[0] / p[1]

STATE = Effect(
    "lab-air", "The cylinder leaks.", "s' = k_a X1' - s / tau", "constitutive",
    (Parameter("k_a", "stiffness", "N/m", 0.0, 1e6, 0.0, (2e4, 1.5e5)),
     Parameter("tau", "time", "s", 1e-3, 100.0, 1.0, (0.1, 0.5))),
    ("shaker",), EVERYWHERE, "moves", extras=(Extra("s", "force lost", "N", 10.0),), term=_leak,
)
# laws that were measured are reported as these
import dataclasses

CLAIMS = dataclasses.replace(ONE, free_laws=("crosstalk",))
CLAIMS_ANOTHERS = dataclasses.replace(ONE, free_laws=("damper",))
NUMBER = 5
MIXED = [ONE, "lab-burgers"]
"""


@pytest.fixture
def install(tmp_path):
    """Put a distribution with these entry points beside drillenv, and run code in an interpreter that sees both."""

    def installed(name, *values):
        info = tmp_path / f"{name.replace('-', '_')}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        points = "".join(f"point{i} = {value}\n" for i, value in enumerate(values))
        (info / "entry_points.txt").write_text(f"[drillenv.effects]\n{points}")
        (tmp_path / "lab_effects.py").write_text(MODULE)

        def run(code):
            paths = os.pathsep.join([str(ROOT), str(tmp_path)])
            done = subprocess.run(
                [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True,
                env={**os.environ, "PYTHONPATH": paths},
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            return json.loads(done.stdout)

        return run

    return installed


JOINED = """
import json, sys
import drillenv
loaded = "lab_effects" in sys.modules
from drillenv.corrected import model_from_record
from drillenv.dynamics.effects import LIBRARY, REGISTRY, make
names = [name for name in REGISTRY if name not in LIBRARY]
record = {"format": "drillenv-model/1", "effects": [{"name": "lab-voigt", "parameters": {"c_r": 400.0}}]}
runs = [
    drillenv.simulate(drillenv.Setting(90.0, 0.45, 1.0), seconds=0.1, effects=effects).force.max()
    for effects in (model_from_record(record).effects, [make("tabulated-rate-force", x=[-1, 1], y=[-400, 400])], [])
]
print(json.dumps([loaded, names, runs]))
"""


@pytest.mark.slow
def test_effects_join_the_registry_and_are_simulated(install):
    run = install("lab-rocks", "lab_effects:ONE", "lab_effects:TWO")
    loaded, names, (ours, tabulated, plain) = run(JOINED)
    assert not loaded, "import drillenv loads nobody's effects"
    assert names == ["lab-kelvin", "lab-voigt", "lab-maxwell"]
    assert ours == pytest.approx(tabulated, rel=1e-9) and abs(ours - plain) > 1.0


CLAIMED = """
import json
from drillenv.checks import InputError
from drillenv.dynamics.effects import mechanism_of_law
try:
    print(json.dumps([mechanism_of_law("crosstalk"), mechanism_of_law("damper")]))
except InputError as error:
    print(json.dumps(str(error)))
"""


@pytest.mark.slow
def test_a_measured_law_is_reported_as_the_one_effect_that_claims_it(install):
    assert install("lab-rocks", "lab_effects:CLAIMS")(CLAIMED) == ["lab-kelvin", "damping-quadratic"]


def test_two_effects_that_claim_a_law_are_named_in_a_line(install):
    assert install("lab-rocks", "lab_effects:CLAIMS_ANOTHERS")(CLAIMED) == (
        "effects damping-quadratic and lab-kelvin both claim the free law 'damper': "
        "leave it out of free_laws of one of them"
    )


KINDS = """
import json
import numpy as np
from drillenv import Rig, Setting
from drillenv.dynamics.effects import make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.motion import motion
from drillenv.rocks import ROCKS
pairs = [
    (make("lab-newton", c_r=400.0), make("lab-kelvin", c_r=400.0)),
    (make("lab-air", k_a=5e4, tau=0.2), make("air-spring", k_a=5e4, tau=0.2)),
]
runs = [[run_hybrid(Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4], 0.2, 1e4, effects=[each]) for each in pair]
        for pair in pairs]
found = [motion(Setting(90.0, 0.45, 1.0), effects=[pair[0]], wait=1000) for pair in pairs]
print(json.dumps({
    "apart": [float(np.abs(one.x2 - other.x2).max()) for one, other in runs],
    "energy": [[run.energy.effects[0] for run in pair] + [run.energy.error for run in pair] for pair in runs],
    "states": [run[0].extra.shape[1] for run in runs],
    "stored": float(np.abs(runs[1][0].extra - runs[1][1].extra).max()),
    "multipliers": [len(each.multipliers) for each in found],
}))
"""


@pytest.mark.slow
def test_a_law_and_a_term_with_a_state_are_followed(install):
    """A law in NumPy beside the same as a compiled term; a term with a state beside the effect of this package."""
    told = install("lab-rocks", "lab_effects:ONE", "lab_effects:LAW", "lab_effects:STATE")(KINDS)
    assert max(told["apart"]) < 1e-12 and told["stored"] < 1e-9
    for one, other, *errors in told["energy"]:
        assert one == pytest.approx(other, rel=1e-8) and abs(one) > 1e-4 and max(map(abs, errors)) < 1e-8
    assert told["states"] == [0, 1] and told["multipliers"] == [4, 5]


EVERYWHERE_ELSE = """
import json
import gymnasium as gym
import numpy as np
import drillenv
from drillenv.corrected import Corrected, write_model
from drillenv.diagnosis.report import diagnose
from drillenv.dynamics.effects import make
from tests.diagnosis.test_diagnose import campaign_with
effect = make("lab-cubic", c3=3000.0)
write_model("lab.json", Corrected(effects=(effect,)))
peaks = []
for model in ({"model": "lab.json"}, {}):
    env = gym.make("drillenv/Drill-v0", rock=4, noise=0.0, **model)
    env.reset(seed=1)
    peaks.append(env.step(np.array([0.5, 0.5, -0.5], dtype=np.float32))[4]["largest_peak_force"])
report = diagnose(campaign_with(effects=[effect], seed=6))
print(json.dumps([peaks, report.verdict, report.record["findings"]]))
"""


@pytest.mark.slow
def test_a_mechanism_from_outside_is_simulated_drilled_and_found(install):
    """Stated once, in ten lines of NumPy: the environments run it, and the diagnosis finds it under its name."""
    (ours, plain), verdict, findings = install("lab-rocks", "lab_effects:CUBIC")(EVERYWHERE_ELSE)
    assert abs(ours - plain) > 1e-3 * plain
    assert verdict == "missing-physics"
    assert [each["mechanism"] for each in findings] == ["lab-cubic"]
    value = findings[0]["parameters"]["c3"]
    assert value["value"] == pytest.approx(3000.0, abs=4.0 * value["std"])


def test_their_module_may_come_first(install):
    """It imports the package whose registry it is to join."""
    run = install("lab-rocks", "lab_effects:ONE")
    code = "import json, lab_effects\nfrom drillenv.dynamics.effects import REGISTRY\n"
    assert run(code + "print(json.dumps(REGISTRY['lab-kelvin'] is lab_effects.ONE))")


@pytest.mark.slow
def test_none_is_drawn_at_random(install):
    run = install("lab-rocks", "lab_effects:ONE", "lab_effects:TWO")
    code = """
import json
import numpy as np
from drillenv.env.episodes import draw_effect
print(json.dumps(sorted({name for seed in range(300) for name in draw_effect(np.random.default_rng(seed))})))
"""
    drawn = run(code)
    assert "rock-rotation" in drawn and not any(name.startswith(("lab", "tabulated")) for name in drawn)


FAILS = """
import json
from drillenv.checks import InputError
from drillenv.dynamics.effects import make
try:
    make("contact-rate")
except InputError as error:
    print(json.dumps(str(error)))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "said"),
    [
        (("lab_effects:KNOWN",), "lab-rocks brings an effect contact-rate, which drillenv has: rename"),
        (("lab_effects:ONE", "lab_effects:ONE"), "lab-rocks brings an effect lab-kelvin, which lab-rocks has"),
        (("lab_effects:NUMBER",), "lab-rocks names lab_effects:NUMBER as its entry point point0 of drillenv.effects"),
        (("lab_effects:MIXED",), "let it be an Effect, or a list of them"),
        (("lab_effects:THREE",), "cannot be loaded (AttributeError"),
        (("lab_sensors:ONE",), "lab-rocks names lab_sensors:ONE"),
    ],
)
def test_what_cannot_join_is_one_error_that_names_the_distribution(install, values, said):
    message = install("lab-rocks", *values)(FAILS)
    assert said in message and "lab-rocks" in message and "\n" not in message and len(message) < 500
