"""Laws that were measured, where no textbook equation follows them: one effect for each place in which one may act."""

import math

from drillenv.dynamics.curves import FLAT, row_of, row_of_period, row_of_rock, time_to_knot, value_of
from drillenv.dynamics.effects import (
    EVERYWHERE,
    IN_CONTACT,
    ON_INDENTER,
    ON_ROCK,
    ON_SHAKER,
    Axes,
    Effect,
    Extra,
)

TURN = 2.0 * math.pi


# --- The rock


def _loading_shape(depth, regime, stiffness, ratio, own, p):
    return value_of(p, stiffness * depth) / stiffness if regime == 1 and p[FLAT] == 0.0 else depth


def _loading_corner(now, a1, a2, p):
    return time_to_knot(p, now.kl * now.depth, now.kl * now.into, now.kl * a2) if now.regime == 1 else math.inf


def _unloading_shape(depth, regime, stiffness, ratio, own, p):
    return value_of(p, stiffness * depth) / stiffness if regime == 2 and p[FLAT] == 0.0 else depth


def _unloading_corner(now, a1, a2, p):
    return time_to_knot(p, now.ku * now.depth, now.ku * now.into, now.ku * a2) if now.regime == 2 else math.inf


def _rate_factor_term(now, own, p, push, rates):
    push[ON_ROCK] += now.rock * value_of(p, now.into)


def _rate_force_term(now, own, p, push, rates):
    push[ON_ROCK] += value_of(p, now.into)


def _rate_corner(now, a1, a2, p):
    return time_to_knot(p, now.into, a2, 0.0) if now.regime != 0 else math.inf


def _compaction_shape(depth, regime, stiffness, ratio, own, p):
    return depth * (1.0 + value_of(p, own[1]))


def _compaction_switched(before, after, own, p):
    if before == 1 and after == 2:
        own[0] += 1.0
    elif before == 0:
        # the stiffness may change only here, where there is no force that would jump
        own[1] = own[0]


def _compaction_counted(p):
    # the last knot, behind the three numbers of the head
    return p[2 + int(p[1])]


# --- The coupling


def _spring_term(now, own, p, push, rates):
    force = value_of(p, now.y)
    push[ON_SHAKER] -= force
    push[ON_INDENTER] += force


def _spring_corner(now, a1, a2, p):
    return time_to_knot(p, now.y, now.closing, a1 - a2)


def _spring_from_rest_term(now, own, p, push, rates):
    force = value_of(p, now.y - now.static / now.k)
    push[ON_SHAKER] -= force
    push[ON_INDENTER] += force


def _spring_from_rest_corner(now, a1, a2, p):
    return time_to_knot(p, now.y - now.static / now.k, now.closing, a1 - a2)


def _damper_term(now, own, p, push, rates):
    force = value_of(p, now.closing)
    push[ON_SHAKER] -= force
    push[ON_INDENTER] += force


def _damper_corner(now, a1, a2, p):
    return time_to_knot(p, now.closing, a1 - a2, 0.0)


# --- What holds a mass back


def _guide_term(now, own, p, push, rates):
    push[ON_SHAKER] -= value_of(p, now.v1)


def _guide_corner(now, a1, a2, p):
    return time_to_knot(p, now.v1, a1, 0.0)


def _indenter_term(now, own, p, push, rates):
    push[ON_INDENTER] -= value_of(p, now.v2)


def _indenter_corner(now, a1, a2, p):
    return time_to_knot(p, now.v2, a2, 0.0)


# --- The drive


def _waveform_term(now, own, p, push, rates):
    phase = now.theta - TURN * math.floor((now.theta - p[3]) / TURN)
    push[ON_INDENTER] += now.drive * value_of(p, phase)


def _waveform_corner(now, a1, a2, p):
    phase = now.theta - TURN * math.floor((now.theta - p[3]) / TURN)
    return time_to_knot(p, phase, now.omega, 0.0)


def _drive_curve_term(now, own, p, push, rates):
    push[ON_INDENTER] += value_of(p, now.drive * math.sin(now.theta))


def _drive_curve_corner(now, a1, a2, p):
    asked = now.drive * math.sin(now.theta)
    return time_to_knot(p, asked, now.drive * now.omega * math.cos(now.theta), -now.omega * now.omega * asked)


# --- What a curve may be


def _row_of_tangent(curve):
    if curve.x[0] < 0.0:
        raise ValueError("its forces begin below 0, and the rock never pulls")
    return _row_held(curve, row_of_rock)


def _row_of_impacts(curve):
    if curve.x[0] < 0.0:
        raise ValueError("its impacts begin below 0")
    return _row_held(curve, row_of)


def _row_held(curve, row):
    if curve.beyond != "held":
        raise ValueError("going on straight it would leave a rock without stiffness, so it has to be held")
    return row(curve)


def _row_of_phase(curve):
    if curve.beyond != "held":
        raise ValueError("a curve that repeats has nothing beyond it, so leave beyond out")
    return row_of_period(curve, TURN)


SOURCE = (
    "constitutive, as measured; between its knots F. N. Fritsch and R. E. Carlson, Monotone piecewise cubic "
    "interpolation, SIAM Journal on Numerical Analysis 17 (1980) 238-246, doi:10.1137/0717021"
)
FORCE, SPEED = ("N", "m/s")


def _effect(place, sentence, equation, balance, energy, axes, term=None, shape=None, corner=None, **more):
    return Effect(
        name=f"tabulated-{place}",
        sentence=sentence,
        equation=equation,
        source=SOURCE,
        parameters=(),
        balances=(balance,),
        regimes=IN_CONTACT if balance == "contact" else EVERYWHERE,
        energy=energy,
        term=term,
        shape=shape,
        corner=corner,
        axes=axes,
        **more,
    )


_STIFFER = "factor on the rock's stiffness at that force"

EFFECTS = (
    _effect(
        "loading",
        "The rock's stiffness goes with the force on the way in, as measured.",
        "dR/d(X2 - Xp) = k_l f(R), loading",
        "contact",
        "none",
        Axes("force of the rock", FORCE, _STIFFER, "1", _row_of_tangent, 1.0, 1e-3, 1e3),
        shape=_loading_shape,
        corner=_loading_corner,
    ),
    _effect(
        "unloading",
        "The rock's stiffness goes with the force on the way out, as measured.",
        "dR/d(X2 - Xf) = k_u f(R), unloading",
        "contact",
        "none",
        Axes("force of the rock", FORCE, _STIFFER, "1", _row_of_tangent, 1.0, 1e-3, 1e3),
        shape=_unloading_shape,
        corner=_unloading_corner,
    ),
    _effect(
        "rate-factor",
        "The rock's force goes with the speed of the impact, in proportion to the force, as measured.",
        "R = R_law (1 + f(V)), V the speed into the rock, R never below 0",
        "contact",
        "moves",
        Axes("speed into the rock", SPEED, "what the rock's force grows by, over that of the rock law", "1", row_of),
        _rate_factor_term,
        corner=_rate_corner,
    ),
    _effect(
        "rate-force",
        "The rock's force goes with the speed of the impact, as measured.",
        "R = R_law + f(V), V the speed into the rock, R never below 0",
        "contact",
        "moves",
        Axes("speed into the rock", SPEED, "force of the rock beyond that of the rock law", FORCE, row_of),
        _rate_force_term,
        corner=_rate_corner,
    ),
    _effect(
        "compaction",
        "The rock's stiffness changes over the first impacts on a fresh face, as measured.",
        "k_l and k_u times 1 + f(N), N the impacts on this face before the contact began",
        "contact",
        "none",
        Axes("impacts on a fresh face", "1", "factor on k_l and k_u, less 1", "1", _row_of_impacts, 0.0, -0.99, 1e3),
        shape=_compaction_shape,
        switched=_compaction_switched,
        counted=_compaction_counted,
        extras=(
            Extra("N", "impacts since the face was fresh", "1", 1.0),
            Extra("N_contact", "N where the latest contact began", "1", 1.0),
        ),
    ),
    _effect(
        "spring",
        "The spring between shaker and indenter has a force beyond the straight one, as measured.",
        "coupling force + f(X1 - X2)",
        "indenter",
        "stores",
        Axes("shortening of the coupling, X1 - X2", "m", "force of the coupling beyond k, c", FORCE, row_of),
        _spring_term,
        corner=_spring_corner,
    ),
    _effect(
        "spring-from-rest",
        "The spring between shaker and indenter has a force beyond the straight one, counted from rest, as measured.",
        "coupling force + f(X1 - X2 - F_b / k)",
        "indenter",
        "stores",
        Axes("shortening of the coupling beyond that at rest", "m", "force of the coupling beyond k, c", FORCE, row_of),
        _spring_from_rest_term,
        corner=_spring_from_rest_corner,
    ),
    _effect(
        "damper",
        "The damper between shaker and indenter has a force beyond the straight one, as measured.",
        "coupling force + f(X1' - X2')",
        "indenter",
        "moves",
        Axes("closing speed of the coupling, X1' - X2'", SPEED, "force of the coupling beyond k, c", FORCE, row_of),
        _damper_term,
        corner=_damper_corner,
    ),
    _effect(
        "guide",
        "The guides hold the shaker body back by a force that goes with its speed, as measured.",
        "force -f(X1') on the shaker body",
        "shaker",
        "moves",
        Axes("speed of the shaker body", SPEED, "force against the motion of the shaker body", FORCE, row_of),
        _guide_term,
        corner=_guide_corner,
    ),
    _effect(
        "indenter",
        "The indenter is held back by a force that goes with its speed, as measured.",
        "force -f(X2') on the indenter",
        "indenter",
        "moves",
        Axes("speed of the indenter", SPEED, "force against the motion of the indenter", FORCE, row_of),
        _indenter_term,
        corner=_indenter_corner,
    ),
    _effect(
        "drive-waveform",
        "The drive's force over a turn of the excitation is no sine, as measured.",
        "drive force + F_a f(theta), of period 2 pi",
        "indenter",
        "moves",
        Axes("phase of the excitation", "rad", "force of the drive beyond its sine, over F_a", "1", _row_of_phase),
        _waveform_term,
        corner=_waveform_corner,
    ),
    _effect(
        "drive-curve",
        "The drive gives another force than is asked of it, as measured.",
        "drive force + f(F_a sin(theta))",
        "indenter",
        "moves",
        Axes("force asked of the drive, F_a sin(theta)", FORCE, "force of the drive beyond that", FORCE, row_of),
        _drive_curve_term,
        corner=_drive_curve_corner,
    ),
)
