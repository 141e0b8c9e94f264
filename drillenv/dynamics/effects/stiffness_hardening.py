"""A cubic term in the coupling spring."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter
from drillenv.dynamics.forms import Form


def _on_body(position, velocity, applied, stiffness, p):
    return -p[0] * position**3


def _law(shortening, p, stiffness):
    return p[0] * shortening**3


EFFECT = Effect(
    name="stiffness-hardening",
    sentence="The stiffness of the spring between shaker and indenter changes with its deflection.",
    equation="coupling force + k3 (X1 - X2)^3; on a body law + k3 position^3",
    source=(
        "G. Duffing, Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz und ihre technische Bedeutung, "
        "Vieweg, Braunschweig, 1918"
    ),
    parameters=(
        Parameter(
            "k3",
            "cubic stiffness of the coupling, negative of a spring that softens",
            "N/m^3",
            -1e13,
            1e13,
            0.0,
            (2e9, 1e10),
        ),
    ),
    balances=("indenter", "body"),
    regimes=EVERYWHERE,
    energy="stores",
    laws={"spring": _law},
    on_body=_on_body,
    body_told_apart="record travels of several sizes about the same middle",
    body_sentence="The spring on the body does not follow a straight line: its stiffness changes with the deflection.",
    forms=(Form("cubic", ("k3",), ((3e9,), (-2e8,))),),
    body_forms=(Form("cubic", ("k3",), ((0.1,),)),),
    free_laws=("hardening spring",),
)
