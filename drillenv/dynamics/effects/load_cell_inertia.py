"""A mass in front of the load cell."""

from drillenv.dynamics.effects import EVERYWHERE, Effect, Parameter


def _measure(true, read, p):
    return read._replace(force=read.force + (p[0] + p[1] * (true.force > 0.0)) * true.acceleration)


EFFECT = Effect(
    name="load-cell-inertia",
    sentence="A mass in front of the load cell is shaken with the indenter and adds its inertia to the force read.",
    equation="force_read = R + m_c X2'' + m_t X2'' while R > 0",
    source="constitutive",
    parameters=(
        Parameter("m_c", "mass in front of the load cell", "kg", 0.0, 10.0, 0.0, (0.02, 0.3)),
        # as of a rock that stands on the load cell
        Parameter("m_t", "mass that moves with the indenter while they touch", "kg", 0.0, 10.0, 0.0, (0.0, 0.0)),
    ),
    balances=("sensor",),
    regimes=EVERYWHERE,
    energy="none",
    measure=_measure,
    free_laws=("load cell",),
)
