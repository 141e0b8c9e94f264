"""The rock resists fast impacts more."""

from drillenv.dynamics.effects import IN_CONTACT, Effect, Parameter
from drillenv.dynamics.forms import Form


def _law(speed, p, stiffness):
    return p[0] * speed


EFFECT = Effect(
    name="contact-rate",
    sentence="The rock resists a fast impact more than a slow one, and helps less on the way back.",
    equation="R = R_law (1 + chi V), V the speed into the rock, R never below 0",
    source=(
        "K. H. Hunt and F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, "
        "Journal of Applied Mechanics 42 (1975) 440-445, doi:10.1115/1.3423596"
    ),
    parameters=(Parameter("chi", "growth of the contact force with speed", "s/m", 0.0, 20.0, 0.0, (0.2, 1.5)),),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="loses",
    laws={"rate-factor": _law},
    forms=(Form("hunt-crossley", ("chi",), ((0.3,), (1.0,))),),
    free_laws=("contact speed",),
)
