"""A soft layer of debris before the rock takes load."""

import numpy as np

from drillenv.dynamics.constitutive.places import Shape
from drillenv.dynamics.effects import IN_CONTACT, Effect, Parameter
from drillenv.dynamics.forms import Form


def _squeezed(depth, thickness, loose):
    return depth if thickness == 0.0 else depth + (1.0 - loose) * thickness * np.expm1(-depth / thickness)


def _loading_shape(depth, p, stiffness):
    return _squeezed(depth, p[0], p[1])


def _unloading_shape(depth, p, stiffness):
    return _squeezed(depth, p[0] * p[2], p[1])


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
    laws={"loading": Shape(_loading_shape), "unloading": Shape(_unloading_shape, "loading depth")},
    free_laws=("soft layer",),
    forms=(
        Form(
            "exponential",
            ("h", "r", "e"),
            ((1e-5, 0.15, 0.5), (3e-5, 0.1, 0.1), (3e-5, 0.1, 0.9)),
        ),
    ),
)
