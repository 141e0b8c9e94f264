"""A cubic term in the coupling spring."""

from drillenv.dynamics.effects import EVERYWHERE, ON_INDENTER, ON_SHAKER, Effect, Parameter
from drillenv.dynamics.forms import Form


def _term(now, own, p, push, rates):
    force = p[0] * now.y * now.y * now.y
    push[ON_SHAKER] -= force
    push[ON_INDENTER] += force


def _on_body(position, velocity, applied, stiffness, p):
    return -p[0] * position**3


def _law(x, p, around):
    return p[0] * x**3


EFFECT = Effect(
    name="stiffness-hardening",
    sentence="The spring between shaker and indenter stiffens as it is deflected.",
    equation="coupling force + k3 (X1 - X2)^3; on a body law + k3 position^3",
    source=(
        "G. Duffing, Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz und ihre technische Bedeutung, "
        "Vieweg, Braunschweig, 1918"
    ),
    parameters=(
        Parameter(
            "k3",
            "cubic stiffness of the coupling",
            "N/m^3",
            0.0,
            1e13,
            0.0,
            (2e9, 1e10),
        ),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="stores",
    term=_term,
    on_body=_on_body,
    forms=(Form("cubic", ("k3",), ((3e9,),), {"spring": _law}),),
)
