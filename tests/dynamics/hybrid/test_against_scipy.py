"""The hybrid engine beside SciPy: every effect that moves the rig, from rest, by its equation written out anew.

The peer (:mod:`tests.dynamics.hybrid.peer`) shares no code with the engine. Twenty periods are compared: states four
times a period, and impacts, each over the largest value of its kind in the run. That the peer itself is good to some
1e-12 is seen from the first case, which changes its tolerance.
"""

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from drillenv.dynamics.effects import LIBRARY, TABULATED, make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.env.hybrid_plant import RTOL
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS
from tests.dynamics.hybrid.peer import (
    LOADING,
    UNLOADING,
    Bent,
    Bristles,
    Peer,
    Ramped,
    Straight,
    Tangent,
    Wave,
    clipped,
    measured,
)

PERIODS, PARTS = 20, 4
AT_60, AT_95, AT_110 = (Setting(60.0, 0.45, 1.0), 4), (Setting(95.0, 0.5, 1.3), 2), (Setting(110.0, 0.4, 1.7), 6)
"""Settings and rocks. None is chaotic: errors do not grow over the twenty periods."""
STATES = ("x1", "x2", "v1", "v2", "force", "penetration")
IMPACTS = ("time", "force", "speed", "depth", "contact_time")


class Case(NamedTuple):
    effect: str
    values: dict
    alter: Callable
    """Writes the effect's equation into a peer."""
    where: tuple = AT_60
    name: str = ""

    @property
    def id(self):
        return self.name or self.effect


# --- Equations


def air_spring(peer, k_a, tau):
    peer.air = lambda lost, v1: k_a * v1 - lost / tau


def enclosed_gas(peer, g_a, tau):
    """Boyle's law, by the stroke x that the supply has not refilled: (F_b - lost) (l + x) = F_b l."""
    length, f_b = 1.0 / g_a, peer.f_b

    def rate(lost, v1):
        x = length * lost / (f_b - lost)
        return f_b * length / (length + x) ** 2 * (v1 - x / tau)

    peer.air = rate


def backlash(peer, g, y0, rg=0.0):
    """Three straight lines: stiffness k, over the play rg k, and k again."""
    k, f_b = peer.k, peer.f_b
    begins = f_b / k + y0
    lines = [
        lambda y: k * y,
        lambda y: f_b + k * y0 + rg * k * (y - begins),
        lambda y: k * (y - (1.0 - rg) * g),
    ]
    peer.spring = Bent([begins, begins + g], lines)


def rounded_backlash(peer, g, y0, wg):
    """The slope of the spring falls over wg at one end of the play and rises again over wg at the other."""
    k, f_b = peer.k, peer.f_b

    def force(y):
        a, b = y - f_b / k - y0, y - f_b / k - y0 - g
        return k * y - 0.5 * k * (g + math.hypot(a, wg) - math.hypot(b, wg))

    peer.spring = force


def power_law(peer, n):
    def shape(depth):
        return 1e-4 * (depth / 1e-4) ** n

    def inverse(goal):
        return 1e-4 * (goal / 1e-4) ** (1.0 / n)

    peer.contacts = {LOADING: Straight(peer.kl, shape, inverse), UNLOADING: Straight(peer.ku, shape, inverse)}


def contact_rate(peer, chi):
    peer.growth = lambda speed: chi * speed


def contact_damping(peer, c_d, p_d=0.0):
    peer.resists = lambda depth, speed: c_d * (depth / 1e-4) ** p_d * speed


def contact_toe(peer, h, r, e):
    def layer(thickness):
        return lambda depth: depth + (1.0 - r) * thickness * math.expm1(-depth / thickness)

    back = e * h * peer.kl / peer.ku
    peer.contacts = {LOADING: Straight(peer.kl, layer(h)), UNLOADING: Straight(peer.ku, layer(back))}


def damping_quadratic(peer, c2, nc=2.0):
    c = peer.c
    peer.damper = Bent([0.0], [lambda v: c * v - c2 * abs(v) ** nc, lambda v: c * v + c2 * abs(v) ** nc])


def drive_droop(peer, s):
    share = 1.0 / math.sqrt(1.0 + (s * peer.omega / (2.0 * math.pi)) ** 2)
    peer.drive = lambda asked: share * asked


def drive_harmonics(peer, h2, phi2, h3, phi3):
    f_a, omega = peer.f_a, peer.omega
    peer.on_indenter = lambda t: f_a * (h2 * math.sin(2.0 * omega * t + phi2) + h3 * math.sin(3.0 * omega * t + phi3))


def external_vibration(peer, F1, F2, f, psi):
    peer.on_shaker = lambda t: F1 * math.sin(2.0 * math.pi * f * t + psi)
    peer.on_indenter = lambda t: F2 * math.sin(2.0 * math.pi * f * t + psi)


def slew_rate_limit(peer, S_max, tau_f=0.0):
    peer.wave = Ramped(peer.f_a, peer.omega, S_max, tau_f, PERIODS * peer.period)


def gradual_spring(peer, F_g):
    peer.spring = lambda y: peer.k * y * F_g / math.hypot(F_g, peer.k * y)


def gradual_drive(peer, F_h):
    peer.drive = lambda asked: asked * F_h / math.hypot(F_h, asked)


def force_limit(peer, F_max=None, F_s=None):
    if F_max is not None:
        peer.drive = clipped(-F_max, F_max)
    if F_s is not None:
        peer.spring = clipped(-F_s / peer.k, F_s / peer.k, peer.k)


def stribeck(fc, rs, vr):
    return lambda v: fc * (1.0 + rs * math.exp(-((v / vr) ** 2)))


def guide_friction(peer, fc1, vs1=0.0, ds1=0.0, sd1=0.0, rs1=0.0, vr1=1e-3):
    if ds1 > 0.0:
        peer.bristles[0] = Bristles(fc1 / ds1, stribeck(fc1, rs1, vr1), sd1)
    elif vs1 == 0.0:
        peer.grips = (fc1, 0.0)
    else:
        peer.guide = lambda v: stribeck(fc1, rs1, vr1)(v) * math.tanh(v / vs1)


def indenter_friction(peer, fc2, vs2=0.0, ds2=0.0, sd2=0.0, rs2=0.0, vr2=0.05):
    if ds2 > 0.0:
        peer.bristles[1] = Bristles(fc2 / ds2, stribeck(fc2, rs2, vr2), sd2)
    elif vs2 == 0.0:
        peer.grips = (0.0, fc2)
    else:
        peer.indenter = lambda v: stribeck(fc2, rs2, vr2)(v) * math.tanh(v / vs2)


def rock_compaction(peer, soft, soft_n):
    peer.factor_at = lambda t, impacts, drilled: 1.0 - soft * math.exp(-impacts / soft_n)


def compaction_by_depth(peer, soft, soft_l):
    peer.factor_at = lambda t, impacts, drilled: 1.0 - soft * math.exp(-drilled / soft_l)


def rock_mount(peer, s_r, m_r, zeta_r, e_r=0.0):
    peer.mount = (s_r, m_r, zeta_r, lambda u: (u + e_r**2 * u**3) / s_r)


def rock_rotation(peer, eps, Omega, psi):
    peer.factor_at = lambda t, impacts, drilled: 1.0 + eps * math.cos(Omega * t + psi)


def hardening(peer, k3):
    k = peer.k
    peer.spring = lambda y: k * y + k3 * y**3


EQUATIONS = [
    Case("air-spring", {"k_a": 8.5e4, "tau": 0.3}, air_spring),
    Case("air-spring", {"g_a": 300.0, "tau": 0.2}, enclosed_gas, name="air-spring-gas"),
    Case("backlash", {"g": 6e-4, "y0": -5e-5}, backlash, AT_95),
    Case("backlash", {"g": 5e-4, "y0": -5e-5, "rg": 0.45}, backlash, AT_95, "backlash-less-stiff"),
    Case("backlash", {"g": 5e-4, "y0": -5e-5, "wg": 4e-5}, rounded_backlash, AT_95, "backlash-rounded"),
    Case("contact-power-law", {"n": 1.35}, power_law),
    Case("contact-power-law", {"n": 1.35}, power_law, AT_110, "contact-power-law-at-110"),
    Case("contact-power-law", {"n": 0.8}, power_law, AT_110, "contact-power-law-below-1"),
    Case("contact-rate", {"chi": 0.85}, contact_rate),
    Case("contact-rate", {"c_d": 350.0}, contact_damping, AT_110, "contact-rate-kelvin-voigt"),
    Case("contact-rate", {"c_d": 350.0, "p_d": 0.25}, contact_damping, AT_95, "contact-rate-tsuji"),
    Case("contact-rate", {"c_d": 350.0, "p_d": 0.5}, contact_damping, AT_110, "contact-rate-kuwabara-kono"),
    Case("contact-toe", {"h": 2.2e-5, "r": 0.16, "e": 0.5}, contact_toe),
    Case("damping-quadratic", {"c2": 900.0}, damping_quadratic, AT_110),
    Case("damping-quadratic", {"c2": 450.0, "nc": 1.5}, damping_quadratic, AT_110, "damping-by-power-1.5"),
    Case("damping-quadratic", {"c2": 2500.0, "nc": 3.0}, damping_quadratic, AT_95, "damping-cubic"),
    Case("drive-droop", {"s": 0.0054}, drive_droop),
    Case("drive-harmonics", {"h2": 0.115, "phi2": 0.7, "h3": 0.085, "phi3": -1.1}, drive_harmonics, AT_95),
    Case("external-vibration", {"F1": 155.0, "F2": 2.25, "f": 32.5, "psi": 0.4}, external_vibration),
    Case("force-limit", {"F_max": 275.0}, force_limit),
    Case("force-limit", {"F_s": 230.0}, force_limit, name="force-limit-of-the-spring"),
    Case("force-limit", {"F_g": 500.0}, gradual_spring, AT_95, "force-limit-of-the-spring-gradual"),
    Case("force-limit", {"F_h": 400.0}, gradual_drive, AT_110, "force-limit-gradual"),
    Case("force-limit", {"S_max": 1.3e5, "tau_f": 5e-5}, slew_rate_limit, name="force-limit-of-the-slope"),
    Case("force-limit", {"S_max": 1.5e5}, slew_rate_limit, AT_95, "force-limit-ramps-alone"),
    Case("guide-friction", {"fc1": 47.5}, guide_friction),
    Case("guide-friction", {"fc1": 30.0, "vs1": 3e-4}, guide_friction, AT_110, "guide-friction-rounded"),
    Case("indenter-friction", {"fc2": 47.5}, indenter_friction),
    Case("guide-friction", {"fc1": 40.0, "ds1": 5e-7}, guide_friction, AT_95, "guide-friction-dahl"),
    Case(
        "guide-friction",
        {"fc1": 40.0, "ds1": 1e-6, "sd1": 7e3, "rs1": 0.4, "vr1": 1e-3},
        guide_friction,
        name="guide-friction-lugre",
    ),
    Case(
        "guide-friction",
        {"fc1": 40.0, "vs1": 3e-4, "rs1": 0.4, "vr1": 1e-3},
        guide_friction,
        AT_110,
        "guide-friction-stribeck",
    ),
    Case("indenter-friction", {"fc2": 30.0, "vs2": 5e-3}, indenter_friction, name="indenter-friction-rounded"),
    Case("indenter-friction", {"fc2": 40.0, "ds2": 1e-5}, indenter_friction, AT_110, "indenter-friction-dahl"),
    Case(
        "indenter-friction",
        {"fc2": 40.0, "ds2": 8e-6, "sd2": 200.0, "rs2": 0.5, "vr2": 0.05},
        indenter_friction,
        AT_95,
        "indenter-friction-lugre",
    ),
    Case("rock-compaction", {"soft": 0.375, "soft_n": 42.0}, rock_compaction, AT_95),
    Case("rock-compaction", {"soft": 0.375, "soft_l": 3e-4}, compaction_by_depth, name="rock-compaction-by-depth"),
    Case("rock-mount-compliance", {"s_r": 2.75e-8, "m_r": 55.0, "zeta_r": 0.11}, rock_mount),
    Case(
        "rock-mount-compliance",
        {"s_r": 5e-8, "m_r": 55.0, "zeta_r": 0.11, "e_r": 2e4},
        rock_mount,
        AT_95,
        "rock-mount-compliance-stiffening",
    ),
    Case("rock-rotation", {"eps": 0.155, "Omega": 10.0, "psi": 0.5}, rock_rotation),
    Case("stiffness-hardening", {"k3": 6e9}, hardening, AT_95),
]


# --- Measured curves


def waves(low, high, knots, size):
    """Knots unevenly apart, none at 0, and values of no equation."""
    x = low + (high - low) * (np.arange(knots) + np.random.default_rng(5).uniform(-0.3, 0.3, knots)) / (knots - 1)
    turns = 2.0 * math.pi * (x - x[0]) / (x[-1] - x[0])
    y = size * (np.sin(turns + 1.0) + 0.3 * np.sin(3.0 * turns + 2.0)) / 1.3
    return {"x": x.tolist(), "y": y.tolist()}


def loading(peer, x, y):
    peer.contacts[LOADING] = Tangent(peer.kl, x, y)


def unloading(peer, x, y):
    peer.contacts[UNLOADING] = Tangent(peer.ku, x, y)


def rate_factor(peer, x, y):
    peer.growth = measured(x, y)


def rate_force(peer, x, y):
    peer.added = measured(x, y)


def compaction(peer, x, y):
    factor = PchipInterpolator(x, y)
    peer.factor_at = lambda t, impacts, drilled: 1.0 + float(factor(min(max(impacts, x[0]), x[-1])))


def spring(peer, x, y):
    peer.spring = measured(x, y, plus=lambda y: peer.k * y)


def spring_from_rest(peer, x, y):
    peer.spring = measured([peer.f_b / peer.k + each for each in x], y, plus=lambda y: peer.k * y)


def damper(peer, x, y, beyond):
    peer.damper = measured(x, y, beyond, lambda v: peer.c * v)


def guide(peer, x, y):
    peer.guide = measured(x, y)


def indenter(peer, x, y):
    peer.indenter = measured(x, y)


def waveform(peer, x, y):
    peer.wave = Wave(x, y, peer.omega)


def drive_curve(peer, x, y):
    peer.drive = measured(x, y, plus=lambda asked: asked)


# The engine joins the forces at 64 knots or more by cubics, so a contact whose tangent is no constant cannot be that of
# the peer: it is off by some 3e-9 for knots three times as far apart at large forces, and with these by less than 1e-9.
# Where the curve is straight, the cubics are good to 1e-11.
TANGENT = {"x": [100.0, 500.0, 900.0, 1300.0], "y": [0.9, 1.0, 1.08, 1.12]}
STRAIGHT_TANGENT = {"x": [200.0, 1000.0], "y": [0.9, 1.1]}
SPEEDS = waves(-0.5, 0.5, 10, 30.0)
STRAIGHT_TANGENTS = [
    Case("tabulated-loading", STRAIGHT_TANGENT, loading, name="tabulated-loading-straight"),
    Case("tabulated-unloading", STRAIGHT_TANGENT, unloading, name="tabulated-unloading-straight"),
]
CURVES = [
    Case("tabulated-loading", TANGENT, loading, AT_95),
    Case("tabulated-unloading", TANGENT, unloading),
    Case("tabulated-rate-factor", waves(-0.4, 0.4, 8, 0.3), rate_factor, AT_110),
    Case("tabulated-rate-force", SPEEDS, rate_force, AT_110),
    Case("tabulated-compaction", waves(0.0, 40.0, 7, 0.2), compaction),
    Case("tabulated-spring", waves(0.0015, 0.0045, 8, 40.0), spring, AT_95),
    Case("tabulated-spring-from-rest", waves(-1e-3, 1e-3, 8, 40.0), spring_from_rest),
    Case("tabulated-damper", SPEEDS | {"beyond": "straight"}, damper, AT_110),
    Case("tabulated-guide", waves(-0.01, 0.01, 8, 30.0), guide, AT_110),
    Case("tabulated-indenter", SPEEDS, indenter, AT_110),
    Case("tabulated-drive-waveform", waves(0.3, 6.1, 9, 0.2), waveform, AT_95),
    Case("tabulated-drive-curve", waves(-500.0, 500.0, 8, 40.0), drive_curve, AT_95),
]
CASES = EQUATIONS + CURVES
QUICK = ("air-spring", "contact-rate", "guide-friction", "rock-compaction", "tabulated-spring")


def each_of(cases):
    """The cases as parameters; all but a handful are slow."""
    slow = {True: (), False: (pytest.mark.slow,)}
    return pytest.mark.parametrize("case", [pytest.param(e, id=e.id, marks=slow[e.id in QUICK]) for e in cases])


# --- Comparison


@functools.cache
def _peer(name):
    return solved({case.id: case for case in CASES + STRAIGHT_TANGENTS}[name])


@functools.cache
def _run(name, rtol):
    case = {case.id: case for case in CASES + STRAIGHT_TANGENTS}[name]
    setting, rock = case.where
    chosen = make(case.effect, **case.values)
    seconds, rate = PERIODS * setting.period, PARTS * setting.frequency
    return run_hybrid(Rig(), setting, ROCKS[rock], seconds, rate, effects=[chosen], rtol=rtol)


def solved(case, **more):
    setting, rock = case.where
    peer = Peer(Rig(), setting, ROCKS[rock], **more)
    case.alter(peer, **case.values)
    return peer.run(PERIODS, PARTS)


def check_alike(run, peer, tolerance):
    assert list(run.switches.after) == [regime for _, regime in peer.switches]
    states, impacts = np.array(peer.samples).T, np.array(peer.impacts).T
    largest = [*peer.largest[:4], *np.abs(states[4:]).max(axis=1)]
    largest[4] = max(largest[4], impacts[1].max())
    apart = {f"state {name}": np.max(np.abs(getattr(run, name) - theirs)) / size
             for name, theirs, size in zip(STATES, states, largest, strict=True)}  # fmt: skip
    for name, theirs in zip(IMPACTS, impacts, strict=True):
        size = max(np.max(np.abs(theirs)), 1e-9)
        apart[f"impact {name}"] = np.max(np.abs(getattr(run.impacts, name) - theirs)) / size
    assert {name: off for name, off in apart.items() if not off < tolerance} == {}


def test_every_effect_that_moves_the_rig_is_here():
    wanted = {name for name, effect in LIBRARY.items() if effect.moves_rig} | set(TABULATED)
    assert {case.effect for case in CASES} == wanted


@pytest.mark.slow
def test_peer_has_converged():
    case = CASES[0]
    rough, fine = _peer(case.id), solved(case, rtol=1e-13, max_step=5e-5)
    for ours, theirs in ((rough.samples, fine.samples), (rough.impacts, fine.impacts)):
        assert np.all(np.abs(np.subtract(ours, theirs)) < 1e-11 * np.abs(theirs).max(axis=0))


@each_of(CASES)
def test_reference_is_that_of_scipy(case):
    run = _run(case.id, 1e-12)
    assert len(run.impacts.time) >= PERIODS
    check_alike(run, _peer(case.id), 1e-9)


@each_of(STRAIGHT_TANGENTS)
def test_straight_tangent_is_that_of_scipy(case):
    check_alike(_run(case.id, 1e-12), _peer(case.id), 1e-10)


@each_of(CASES)
def test_the_tolerance_of_environments_is_near(case):
    check_alike(_run(case.id, RTOL), _peer(case.id), 1e-5)


@each_of(CASES + STRAIGHT_TANGENTS)
def test_energies_balance(case):
    energy = _run(case.id, 1e-12).energy
    assert energy.drive > 0.0
    assert abs(energy.error) < 1e-9 * energy.drive
