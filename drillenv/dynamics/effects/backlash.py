"""Play in the coupling before its spring acts."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _on_body(position, velocity, applied, stiffness, p):
    return stiffness * np.clip(position - p[1], 0.0, p[0])


def _law(beyond, p, stiffness):
    return -stiffness * np.clip(beyond - p[1], 0.0, p[0])


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
    laws={"spring-from-rest": _law},
    on_body=_on_body,
    body_told_apart="record travels of several sizes about the same middle",
    body_sentence="The spring on the body has play: over a part of its travel its force does not grow.",
    forms=(
        Form(
            "no force over the play",
            ("g", "y0"),
            tuple((g, y0) for g in (2e-4, 5e-4, 1e-3) for y0 in (-3e-4, -1e-4, 0.0)),
        ),
    ),
    body_forms=(
        Form(
            "no force over the play",
            ("g", "y0"),
            tuple((g, y0) for g in (0.06, 0.2, 0.5) for y0 in (-0.6, -0.3, -0.1, 0.1, 0.4)),
        ),
    ),
    free_laws=("play",),
)
