"""Rock that stiffens over the first impacts on a fresh face."""

import numpy as np

from drillenv.dynamics.effects import IN_CONTACT, Effect, Extra, Parameter
from drillenv.dynamics.forms import Form


def _law(impacts, p, stiffness):
    # with a length, what was drilled over that takes the place of impacts
    return -p[0] * np.exp(-impacts / (p[1] if p[2] == 0.0 else 1.0))


def _scalars(p):
    return {"compaction_length": p[2]} if p[0] != 0.0 else {}


def _counted(p):
    # ten times leave less than 5e-5 of what the face lacked
    return 10.0 * p[1]


EFFECT = Effect(
    name="rock-compaction",
    sentence="Each of the first impacts on a fresh face leaves the rock stiffer.",
    equation=(
        "k_l and k_u times 1 - soft exp(-N / soft_n), N the impacts on this face before the contact began, or, where "
        "soft_l is not 0, 1 - soft exp(-D / soft_l), D the depth drilled on it before "
        "(k_l and k_u are those of the compacted rock)"
    ),
    source=(
        "constitutive; that stiffness rises over the first of ten indentations is Table 2.2 of the paper, "
        "phases impact, compression and stable"
    ),
    parameters=(
        Parameter("soft", "share of the stiffness that a fresh face lacks", "1", 0.0, 0.9, 0.0, (0.15, 0.6)),
        Parameter("soft_n", "impacts over which the lack falls to 1/e", "1", 0.1, 1e5, 1.0, (5.0, 80.0)),
        Parameter("soft_l", "depth drilled over which it does, if not 0", "m", 0.0, 1.0, 0.0, (0.0, 0.0)),
    ),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="none",
    extras=(
        Extra("N", "impacts since the face was fresh", "1", 1.0, kept="N"),
        Extra("N_contact", "N where the latest contact began", "1", 1.0, kept="N_contact"),
        Extra("D", "depth drilled since the face was fresh", "m", 1e-4, kept="drilled"),
        Extra("D_contact", "D where the latest contact began", "m", 1e-4, kept="drilled_contact"),
    ),
    scalars=_scalars,
    laws={"compaction": _law},
    counted=_counted,
    forms=(
        Form("exponential", ("soft", "soft_n"), ((0.3, 10.0), (0.3, 40.0))),
        Form("exponential over the depth", ("soft", "soft_l"), ((0.3, 1.5e-4), (0.3, 6e-4))),
    ),
    free_laws=("compaction",),
)
