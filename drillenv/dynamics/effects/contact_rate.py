"""The rock resists fast impacts more."""

from drillenv.dynamics.effects import IN_CONTACT, Effect, Parameter
from drillenv.dynamics.forms import Form


def _law(speed, p, stiffness):
    return p[0] * speed


def _scalars(p):
    return {"contact_damping": p[1], "contact_damping_power": p[2] if p[1] != 0.0 else 0.0}


# In proportion to the force of the rock, or to a power of the depth: none for a plain damper (Kelvin and Voigt), 1/4 in
# Tsuji's contacts, 1/2 in those of Kuwabara and Kono.
EFFECT = Effect(
    name="contact-rate",
    sentence="The rock resists a fast impact more than a slow one, and helps less on the way back.",
    equation=(
        "R = R_law (1 + chi V) + c_d (x / d0)^p_d V, V the speed into the rock, x the depth, d0 = 0.1 mm, "
        "R never below 0"
    ),
    source=(
        "K. H. Hunt and F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, "
        "Journal of Applied Mechanics 42 (1975) 440-445, doi:10.1115/1.3423596; Y. Tsuji, T. Tanaka, T. Ishida, "
        "Lagrangian numerical simulation of plug flow of cohesionless particles in a horizontal pipe, Powder "
        "Technology 71 (1992) 239-250, doi:10.1016/0032-5910(92)88030-L; G. Kuwabara, K. Kono, Restitution coefficient "
        "in a collision between two spheres, Japanese Journal of Applied Physics 26 (1987) 1230-1233, "
        "doi:10.1143/JJAP.26.1230"
    ),
    parameters=(
        Parameter("chi", "growth of the contact force with speed", "s/m", 0.0, 20.0, 0.0, (0.2, 1.5)),
        Parameter("c_d", "damping at a depth of 0.1 mm", "N s/m", 0.0, 1e4, 0.0, (0.0, 0.0)),
        Parameter("p_d", "power of the depth by which that grows", "1", 0.0, 2.0, 0.0, (0.0, 0.0)),
    ),
    balances=("contact",),
    regimes=IN_CONTACT,
    energy="loses",
    laws={"rate-factor": _law},
    scalars=_scalars,
    forms=(
        Form("hunt-crossley", ("chi",), ((0.3,), (1.0,))),
        Form("kelvin-voigt", ("c_d",), ((300.0,),)),
        Form("power of the depth", ("c_d", "p_d"), ((300.0, 0.25), (300.0, 0.75))),
    ),
    free_laws=("contact speed",),
)
