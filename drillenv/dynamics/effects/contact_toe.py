"""A soft layer of debris before the rock takes load."""

import math

import numpy as np

from drillenv.dynamics.effects import IN_CONTACT, Effect, Parameter
from drillenv.dynamics.forms import Form


def _shape(depth, regime, stiffness, ratio, own, p):
    thickness = p[0] if regime == 1 else p[0] * p[2] * ratio
    if thickness == 0.0:
        return depth
    missing = thickness * (1.0 - p[1]) * (1.0 - math.exp(-abs(depth) / thickness))
    return depth - missing if depth >= 0.0 else depth + missing


def _law(x, thickness, loose):
    """Factor on the stiffness over the force, as a depth x in m of the rock without its layer."""
    if thickness <= 0.0:
        return np.ones_like(x)
    depth = np.concatenate([[0.0], np.geomspace(1e-3 * thickness, float(np.max(x)) + 2.0 * thickness, 400)])
    gone = np.exp(-depth / thickness)
    return np.interp(x, depth - (1.0 - loose) * thickness * (1.0 - gone), 1.0 - (1.0 - loose) * gone)


def _loading_law(x, p, around):
    return _law(x, p[0], p[1])


def _unloading_law(x, p, around):
    ratio = around.kl / around.ku
    return _law(x * ratio, p[0] * p[2] * ratio, p[1])


EFFECT = Effect(
    name="contact-toe",
    sentence="A soft layer of debris is squeezed together before the rock takes load.",
    equation=(
        "R = k_l S(X2 - Xp, h) loading, R = k_u S(X2 - Xf, e h k_l / k_u) unloading, "
        "S(d, h) = d - (1 - r) h (1 - exp(-d / h)): stiffness r k at first, k once the layer is squeezed together"
    ),
    source="constitutive",
    parameters=(
        Parameter("h", "thickness that the layer loses when squeezed together", "m", 0.0, 1e-2, 0.0, (4e-6, 4e-5)),
        Parameter("r", "stiffness of the loose layer over that of the rock", "1", 0.0, 1.0, 0.1, (0.02, 0.3)),
        Parameter("e", "share of the layer that springs back on the way out", "1", 0.0, 1.0, 1.0, (0.0, 1.0)),
    ),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="none",
    shape=_shape,
    forms=(
        Form(
            "exponential",
            ("h", "r", "e"),
            ((1e-5, 0.15, 0.5), (3e-5, 0.1, 0.1), (3e-5, 0.1, 0.9)),
            {"loading": _loading_law, "unloading": _unloading_law},
        ),
    ),
)
