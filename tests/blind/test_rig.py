"""The concealed rig against the package's own engines, with which it shares no code."""

import numpy as np
import pytest

import drillenv
from drillenv.blind import rig
from drillenv.blind.campaigns import physics_of
from drillenv.blind.mechanisms import MECHANISMS, Concealed, of_library
from drillenv.blind.rig import Constants, Controls, Physics, move
from drillenv.dynamics.effects import make
from drillenv.dynamics.hybrid.run import run_hybrid

STEP = 1.0 / 204800.0

LIBRARY = {
    "contact-rate": {"chi": 0.6},
    "contact-power-law": {"n": 1.3},
    "contact-toe": {"h": 2e-5, "r": 0.1, "e": 0.6},
    "rock-compaction": {"soft": 0.4, "soft_n": 12.0},
    "rock-mount-compliance": {"s_r": 2e-8, "m_r": 40.0, "zeta_r": 0.1},
    "stiffness-hardening": {"k3": 6e9},
    "damping-quadratic": {"c2": 900.0},
    "guide-friction": {"fc1": 40.0},
    "indenter-friction": {"fc2": 40.0},
    "drive-harmonics": {"h2": 0.1, "phi2": 0.7, "h3": 0.05, "phi3": -1.0},
    "drive-droop": {"s": 1.0 / 200.0},
    "force-limit": {"F_max": 300.0},
    "air-spring": {"k_a": 8e4, "tau": 0.2},
    "backlash": {"g": 5e-4, "y0": -5e-5},
}


LATER = {
    "Kelvin-Voigt": ("contact-rate", {"c_r": 400.0}, {"c_d": 400.0}),
    "Tsuji": ("contact-rate", {"c_t": 400.0}, {"c_d": 400.0, "p_d": 0.25}),
    "two masses": (
        "rock-mount-compliance", {"s_r": 2e-8, "m_r": 25.0, "zeta_r": 0.1, "m_b": 90.0, "s_b": 1.5e-8},
        {"s_r": 2e-8, "m_r": 25.0, "zeta_r": 0.1, "m_b": 90.0, "s_b": 1.5e-8, "zeta_b": 0.1},
    ),
    "isothermal": ("air-spring", {"l": 4e-3, "tau": 0.2}, {"g_a": 250.0, "tau": 0.2}),
    "Stribeck": (
        "indenter-friction", {"f_c": 40.0, "f_s": 56.0, "v_s": 0.05, "v_0": 2e-3},
        {"fc2": 40.0, "rs2": 0.4, "vr2": 0.05, "vs2": 2e-3},
    ),
    "LuGre": (
        "indenter-friction", {"f_c": 40.0, "f_s": 56.0, "v_s": 0.05, "sigma": 4e6, "sigma_1": 150.0},
        {"fc2": 40.0, "ds2": 1e-5, "sd2": 150.0, "rs2": 0.4, "vr2": 0.05},
    ),
}  # fmt: skip
"""Equations that the library has learned since the first trial: mechanism, parameters, and those of the library."""


def largest(found, expected):
    size = min(found.size, expected.size)
    return np.max(np.abs(found[:size] - expected[:size])) / np.max(np.abs(expected))


@pytest.mark.parametrize(("frequency", "case"), [(120.0, 4), (50.0, 4), (100.0, 2)])
def test_agrees_with_the_exact_engine_where_nothing_is_concealed(frequency, case):
    pair = drillenv.ROCKS[case]
    constants = Constants(loading_stiffness=pair.loading_stiffness, unloading_stiffness=pair.unloading_stiffness)
    seconds = 50.0 / frequency
    mine = move(constants, Controls(frequency, 0.45, 1.0), Physics.none(), seconds, STEP)
    run = drillenv.simulate(
        drillenv.Setting(frequency, 0.45, 1.0), rock=case, seconds=float(mine.time[-1]), sample_rate=1.0 / STEP
    )
    assert abs(mine.time.size - run.time.size) <= 1
    assert largest(mine.x2, run.indenter_position) < 1e-6
    assert largest(mine.x2 + mine.shortening, run.shaker_position) < 1e-6
    assert largest(mine.rock, run.force) < 1e-6
    assert largest(mine.acceleration, run.acceleration) < 1e-6


def both(concealed, chosen, monkeypatch, step=STEP):
    """Motions of the concealed rig, in steps of so many s, and of the hybrid engine with the same physics."""
    # the hybrid engine starts where the straight spring alone would rest
    monkeypatch.setattr(rig, "resting_shortening", lambda constants, static, physics: static / constants.stiffness)
    controls, constants = Controls(90.0, 0.5, 0.8), Constants()
    physics = physics_of([concealed], constants, controls, np.random.default_rng(0))
    mine = move(constants, controls, physics, 12.0 / controls.frequency, step)
    setting, seconds = drillenv.Setting(*controls), float(mine.time[-1])
    return mine, run_hybrid(drillenv.Rig(), setting, drillenv.ROCKS[4], seconds, 1.0 / step, effects=(chosen,))


@pytest.mark.slow
@pytest.mark.parametrize("name", LIBRARY)
def test_the_librarys_equations_are_the_librarys(name, monkeypatch):
    """Where both have an equation, two formulations, integrators and contacts give the same motion."""
    mine, run = both(of_library(name, **LIBRARY[name]), make(name, **LIBRARY[name]), monkeypatch)
    # corners of a force are stepped across; the acceleration's jump at each grip may fall on either side of a sample
    loose = name in ("guide-friction", "indenter-friction", "force-limit", "backlash")
    assert largest(mine.x2, run.x2) < 1e-6
    assert largest(mine.rock, run.force) < (1e-4 if loose else 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", LATER)
def test_equations_that_the_library_has_learned_are_the_same(name, monkeypatch):
    mechanism, parameters, values = LATER[name]
    (equation,) = (each for each in MECHANISMS[mechanism].equations if each.name == name)
    # a force that jumps at the face, or grows there with a root of the depth, takes Runge and Kutta's method its order
    mine, run = both(Concealed(mechanism, equation, parameters), make(mechanism, **values), monkeypatch, STEP / 8.0)
    assert largest(mine.x2, run.x2) < 1e-6
    assert largest(mine.rock, run.force) < 1e-5


def test_what_the_catalogue_calls_the_librarys_is_all_that_the_library_has():
    """At least three equations each, of which one is the library's."""
    for mechanism in MECHANISMS.values():
        assert len(mechanism.equations) >= 3
        assert sum(each.of_library for each in mechanism.equations) == 1
    from drillenv.dynamics.effects import REGISTRY

    # concealed as what no row of the library has, from before the library had them
    late = {"external-vibration", "rock-rotation", "sensor-highpass"}
    assert set(MECHANISMS) | late == {name for name, effect in REGISTRY.items() if effect.balances != ("body",)}


def test_nothing_concealed_adds_no_force():
    motion = move(Constants(), Controls(90.0, 0.5, 1.2), Physics.none(), 0.05, STEP, phase=1.0, lead=0.05)
    for added in (motion.contact_added, motion.coupling_added, motion.indenter_added, motion.shaker_added):
        assert np.all(np.abs(added) < 1e-9)


def test_half_the_step_gives_the_same_motion():
    """With gripping friction on both masses, whose switches cut steps in the middle."""
    controls, hidden = Controls(75.0, 0.4, 1.0), [of_library("indenter-friction", fc2=60.0)]
    hidden.append(of_library("guide-friction", fc1=50.0))
    physics = physics_of(hidden, Constants(), controls, np.random.default_rng(0))
    coarse = move(Constants(), controls, physics, 0.15, STEP)
    fine = move(Constants(), controls, physics, 0.15, STEP / 2.0)
    assert largest(coarse.x2, fine.x2[::2]) < 1e-6
