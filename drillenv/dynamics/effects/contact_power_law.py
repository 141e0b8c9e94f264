"""The contact force grows as a power of the penetration."""

import numpy as np

from drillenv.dynamics.constitutive.places import REFERENCE_DEPTH, Shape
from drillenv.dynamics.effects import IN_CONTACT, Effect, Parameter
from drillenv.dynamics.forms import Form


def _shape(depth, p, stiffness):
    # at d0 the force is that of the linear law, so that k_l and k_u keep the unit N/m
    return REFERENCE_DEPTH * (np.maximum(depth, 0.0) / REFERENCE_DEPTH) ** p[0]


# One exponent for both ways. The paper's own law has two, n_l and n_u, and sets both to 1. With two that differ, the
# way out is somewhere softer than the way in at the same force: at small forces for n_u > n_l, at large ones for
# n_u < n_l. There the rock would give more than it took: a motor in place of a rock.
EFFECT = Effect(
    name="contact-power-law",
    sentence="The rock's force grows as a power of the penetration instead of in proportion to it.",
    equation="R = k_l d0 ((X2 - Xp)/d0)^n loading, R = k_u d0 ((X2 - Xf)/d0)^n unloading, d0 = 0.1 mm",
    source=(
        "the exponents of the paper's own rock law (Section 3), there set to 1; 3/2 is H. Hertz, Ueber die Beruehrung "
        "fester elastischer Koerper, Journal fuer die reine und angewandte Mathematik 92 (1882) 156-171"
    ),
    parameters=(Parameter("n", "exponent of loading and unloading", "1", 0.5, 3.0, 1.0, (1.1, 1.6)),),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="none",
    laws={"loading": Shape(_shape), "unloading": Shape(_shape)},
    forms=(Form("power", ("n",), ((0.9,), (1.1,), (1.4,))),),
    free_laws=("contact law",),
)
