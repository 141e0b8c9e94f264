"""Dry friction: one equation for that of the shaker body, of the indenter and of a single body.

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
from numba import njit

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


def along_path(position: Floats, velocity: Floats, p: tuple[float, ...]) -> Floats:
    """(..., n) N of friction against a motion of n samples, whose position in m and velocity in m/s (..., n) are known.

    Bristles are bent by the way that has been gone, and begin as a motion that has gone on for long has them; from one
    sample to the next their equation is solved exactly, for the speed halfway.
    """
    fc, vs, ds, sd, rs, vr = p
    if ds == 0.0:
        g = fc * (1.0 + rs * np.exp(-((velocity / vr) ** 2))) if rs > 0.0 else fc
        return g * (np.tanh(velocity / vs) if vs > 0.0 else np.sign(velocity))
    shape = np.broadcast_shapes(position.shape, velocity.shape)
    made = np.empty(shape)
    x, v = (np.ascontiguousarray(np.broadcast_to(each, shape)).reshape(-1, shape[-1]) for each in (position, velocity))
    _bend(x, v, fc, ds, sd, rs, vr, made.reshape(x.shape))
    return made


@njit(cache=True, nogil=True)
def _bend(position, velocity, fc, ds, sd, rs, vr, made):
    """Fill rows (m, n) with the friction of bristles."""
    for i in range(position.shape[0]):
        bent, before = 0.0, position[i, 0]
        for k in range(position.shape[1]):
            v, way = velocity[i, k], position[i, k] - before
            before, halfway = position[i, k], 0.5 * (velocity[i, max(k - 1, 0)] + v)
            # as shares of fc
            level = 1.0 + rs * np.exp(-((halfway / vr) ** 2))
            sliding = level * np.sign(way if k > 0 else v)
            bent = sliding + (bent - sliding) * np.exp(-abs(way) / (ds * level)) if k > 0 else sliding
            give = v - abs(v) * bent / (1.0 + rs * np.exp(-((v / vr) ** 2)))
            made[i, k] = fc * bent + sd * give


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
