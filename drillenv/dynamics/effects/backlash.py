"""Play in the coupling before its spring acts."""

import numpy as np

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _lost(beyond, p):
    """Deflection in m over which the spring's force does not grow."""
    width, start, kept, rounding = p
    if rounding == 0.0:
        return (1.0 - kept) * np.clip(beyond - start, 0.0, width)
    after_first, after_last = beyond - start, beyond - start - width
    # the difference of two hyperbolas, without the loss of digits far from the play
    hyperbolas = np.hypot(after_first, rounding) + np.hypot(after_last, rounding)
    return (1.0 - kept) * 0.5 * width * (1.0 + (after_first + after_last) / hyperbolas)


def _on_body(position, velocity, applied, stiffness, p):
    return stiffness * _lost(position, p)


def _law(beyond, p, stiffness):
    return -stiffness * _lost(beyond, p)


# Play about the unloaded spring would be closed for good: the static force holds the spring some 3 mm shortened, and it
# moves by a tenth of that. So the play is counted from where the spring stands under the static force.
EFFECT = Effect(
    name="backlash",
    sentence="The spring between shaker and indenter has play: over a part of its travel its force grows less or not.",
    equation=(
        "spring force F_b + k (d - (1 - rg) (h(d - y0) - h(d - y0 - g))), h(x) = (x + sqrt(x^2 + wg^2)) / 2, "
        "d = X1 - X2 - F_b / k, the deflection beyond that at rest; on a body d is the position and there is no F_b"
    ),
    source=(
        "S. W. Shaw, P. J. Holmes, A periodically forced piecewise linear oscillator, Journal of Sound and Vibration "
        "90 (1983) 129-155, doi:10.1016/0022-460X(83)90407-8; T. C. Kim, T. E. Rook, R. Singh, Effect of smoothening "
        "functions on the frequency response of an oscillator with clearance non-linearity, Journal of Sound and "
        "Vibration 263 (2003) 665-678"
    ),
    parameters=(
        Parameter("g", "play", "m", 0.0, 0.05, 0.0, (2e-4, 1e-3)),
        Parameter("y0", "deflection beyond that at rest where the play begins", "m", -0.05, 0.05, 0.0, (-1e-4, 0.0)),
        Parameter("rg", "share of its stiffness that the spring keeps over the play", "1", 0.0, 1.0, 0.0, (0.0, 0.0)),
        Parameter("wg", "deflection over which the ends of the play are rounded", "m", 0.0, 0.05, 0.0, (0.0, 0.0)),
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
        Form(
            "less stiff over the play",
            ("g", "y0", "rg"),
            tuple((g, y0, 0.4) for g in (2e-4, 5e-4, 1e-3) for y0 in (-3e-4, -1e-4, 0.0)),
        ),
        Form(
            "rounded ends",
            ("g", "y0", "wg"),
            tuple((g, y0, 4e-5) for g in (2e-4, 5e-4, 1e-3) for y0 in (-3e-4, -1e-4, 0.0)),
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
