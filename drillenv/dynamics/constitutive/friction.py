"""Dry friction of a guide: one equation for that of the shaker body and that of the indenter.

Parameters p are the friction force fc in N, the speed vs in m/s at which a lubricated guide begins to slide freely, the
displacement ds in m by which it gives before it slides, the damping sd in N s/m of what gives, the share rs by which
friction is larger at low speeds, and the speed vr in m/s at which that has faded. The force of steady sliding at the
speed v is, after Stribeck,

    g(v) = fc (1 + rs exp(-(v / vr)^2))

With ds the guide has bristles of the stiffness fc / ds, which slide at that force (Dahl; LuGre with sd and rs). Else
with vs the force is g(v) tanh(v / vs), and without either the mass sticks until it is pushed by more than fc.
"""

from __future__ import annotations

import numpy as np

from drillenv.dynamics.constitutive.places import Floats

SOURCE = (
    "C. A. Coulomb, Theorie des machines simples (1785); J. P. Den Hartog, Forced vibrations with combined viscous "
    "and Coulomb damping, Philosophical Magazine, series 7, 9 (1930) 801-817; P. R. Dahl, A solid friction model, The "
    "Aerospace Corporation, TOR-0158 (1968); C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, A new model "
    "for control of systems with friction, IEEE Transactions on Automatic Control 40 (1995) 419-425; S. Andersson, "
    "A. Soderberg, S. Bjorklund, Friction models for sliding dry, boundary and mixed lubricated contacts, Tribology "
    "International 40 (2007) 580-587"
)


def equation(mass: str, fc: str, vs: str, ds: str, sd: str, rs: str, vr: str, place: str) -> str:
    """The equation in words, by the names of the mass, its parameters and its place."""
    return (
        f"friction g = {fc} (1 + {rs} exp(-({place}' / {vr})^2)) against the motion of the {mass}: force -b - {sd} s, "
        f"b' = {fc} / {ds} s, s = {place}' - |{place}'| b / g; for {ds} = 0 force -g tanh({place}' / {vs}); for {ds} = "
        f"{vs} = 0 -{fc} sign({place}'), and at rest whatever holds it there, up to {fc}"
    )


def law(speed: Floats, p: tuple[float, ...], stiffness: float) -> Floats:
    """(n,) N over the speed (n,) in m/s: what is beyond the scalars' constant force."""
    fc, vs, ds, _sd, rs, vr = p
    more = fc * rs * np.exp(-((speed / vr) ** 2)) if rs > 0.0 else np.zeros_like(speed)
    if ds > 0.0:
        return more
    # without either it would jump where a mass begins to slide, which no law at a place may: the engine says so
    return (fc + more) * np.tanh(speed / vs) if vs > 0.0 else more * np.sign(speed)


def scalars(mass: str, p: tuple[float, ...]) -> dict[str, float]:
    """What the friction of ``shaker`` or ``indenter`` sets of the model, by its parameters."""
    fc, vs, ds, sd, _rs, _vr = p
    bristles = fc / ds if ds > 0.0 else 0.0
    return {
        f"{mass}_grip": fc if vs == 0.0 and ds == 0.0 else 0.0,
        f"{mass}_bristles": bristles,
        f"{mass}_sliding": fc if bristles > 0.0 else 0.0,
        f"{mass}_bristle_damping": sd if bristles > 0.0 else 0.0,
    }
