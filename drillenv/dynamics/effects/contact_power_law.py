"""The contact force grows as a power of the penetration."""

from drillenv.dynamics.effects import IN_CONTACT, Effect, Parameter

REFERENCE_DEPTH = 1e-4
"""d0 in m: at this depth the force is that of the linear law, so that k_l and k_u keep the unit N/m."""


def _shape(depth, regime, own, p):
    exponent = p[0] if regime == 1 else p[1]
    if exponent == 1.0:
        return depth
    bent = REFERENCE_DEPTH * (abs(depth) / REFERENCE_DEPTH) ** exponent
    return bent if depth >= 0.0 else -bent


EFFECT = Effect(
    name="contact-power-law",
    sentence="The rock's force grows as a power of the penetration instead of in proportion to it.",
    equation=(
        "R = k_l d0 ((X2 - Xp)/d0)^n_l loading, R = k_u d0 ((X2 - Xf)/d0)^n_u unloading, d0 = 0.1 mm; "
        "with n_u below n_l the rock can give energy away"
    ),
    source=(
        "the exponents of the paper's own rock law (Section 3), there set to 1; 3/2 is H. Hertz, Ueber die Beruehrung "
        "fester elastischer Koerper, Journal fuer die reine und angewandte Mathematik 92 (1882) 156-171"
    ),
    parameters=(
        Parameter("n_l", "exponent of loading", "1", 0.5, 3.0, 1.0),
        Parameter("n_u", "exponent of unloading", "1", 0.5, 3.0, 1.0),
    ),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="none",
    shape=_shape,
)
