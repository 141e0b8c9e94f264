"""Play in the coupling before its spring acts."""

import math

import numpy as np

from drillenv.dynamics.corners import time_to
from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, ON_SHAKER, Effect, Parameter
from drillenv.dynamics.forms import Form


def _term(now, own, p, push, rates):
    beyond = now.y - now.static / now.k
    force = -now.k * min(max(beyond - p[1], 0.0), p[0])
    push[ON_SHAKER] -= force
    push[ON_INDENTER] += force


def _corner(now, a1, a2, p):
    if p[0] == 0.0:
        return math.inf
    first, change = math.inf, a1 - a2
    for corner in (p[1], p[1] + p[0]):
        off = now.y - now.static / now.k - corner
        # a nanometre beside it is on it
        if abs(off) >= 1e-9:
            first = min(first, time_to(off, now.closing, change))
    return first


def _on_body(position, velocity, applied, stiffness, p):
    return stiffness * np.clip(position - p[1], 0.0, p[0])


def _law(x, p, around):
    return -around.k * np.clip(x - p[1], 0.0, p[0])


# Play about the unloaded spring would be closed for good: the static force holds the spring some 3 mm shortened, and it
# moves by a tenth of that. So the play is counted from where the spring stands under the static force.
EFFECT = Effect(
    name="backlash",
    sentence="The spring between shaker and indenter has play: over a part of its travel its force does not grow.",
    equation=(
        "spring force F_b + k (d - clip(d - y0, 0, g)), d = X1 - X2 - F_b / k, the deflection beyond that at rest; "
        "on a body d is the position and there is no F_b"
    ),
    source="constitutive",
    parameters=(
        Parameter("g", "play", "m", 0.0, 0.05, 0.0, (2e-4, 1e-3)),
        Parameter("y0", "deflection beyond that at rest where the play begins", "m", -0.05, 0.05, 0.0, (-1e-4, 0.0)),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="stores",
    term=_term,
    corner=_corner,
    on_body=_on_body,
    forms=(
        Form(
            "no force over the play",
            ("g", "y0"),
            tuple((g, y0) for g in (2e-4, 5e-4, 1e-3) for y0 in (-3e-4, -1e-4, 0.0)),
            {"spring-from-rest": _law},
        ),
    ),
)
