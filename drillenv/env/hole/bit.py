"""Wear, blunting and breakage of a bit.

A blow of the peak force F wears the bit by

    dw = (1 + chatter (1 - s)) (a (1 + u) / 2 (1 + (P / P_0)^2) + b u^8) / life,    u = F / rating

of what it can bear, with the abrasivity ``a`` of the layer, the share ``s`` of single blows and P the sum of u^2 a
second. The parts:

- **Abrasion**: half of it by sliding while the bit is turned between blows, which needs no force, half in proportion to
  the force (Archard, J. Appl. Phys. 24, 1953, 981). Sandstones differ by a factor of ten: their CERCHAR index goes
  from 0.3 to 4 (Plinninger et al., Int. J. Rock Mech. Min. Sci. 40, 2003, 259).
- **Heat of the edge**: the work of the blows is spent at the edge, which softens as it warms (Beste & Jacobson, Wear
  264, 2008, 1129, on buttons of rock drills). P_0 is the power that doubles abrasion, in blows at the rating a second.
- **Fatigue**: a power of the force (Basquin, Proc. ASTM 10, 1910, 625); hardened steel has exponents of 8 to 12. At the
  rating it is the share ``b`` of abrasion on rock of abrasivity 1; above it, it is the part that grows more than in
  proportion.
- **Chatter**: blows that do not come singly, and the same as the one before, meet chips and a bit that rebounds.

``life`` is chosen so that a bit drills 0.5 to 3 m, and a hole of 4 m takes two to six bits, as holes on a bench in
abrasive rock do. A steel indenter is meant; carbide lasts a hundred times as long.

A worn bit is blunt: between the 30 and the 45 degree indenter of Table 2.2 both stiffnesses of sandstone-2 grow by a
factor of 1.53 and 1.62, that is the contact of a bit with w = 1, for both branches alike (:data:`BLUNTING`).

A bit breaks when its wear reaches its strength. Strengths scatter by a Weibull distribution (Weibull, J. Appl. Mech.
18, 1951, 293) of the shape 8, that is by 15 %, as brittle steel does.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import INLINE
from drillenv.env.plant import INTERVAL
from drillenv.env.truth import SEEN

LIFE = 300_000.0
"""Blows, were each to wear the bit by what a blow at the rating does on rock of abrasivity 1, cold."""
FATIGUE, FATIGUE_EXPONENT = 0.3, 8
EDGE_POWER = 100.0
"""P_0 in blows at the rating a second."""
CHATTER = 4.0
BLUNTING = 0.53
BLUNTEST = 1.5
"""Wear at which a bit gets no blunter: the flat then covers it."""
STRENGTH, STRENGTH_SHAPE = 1.1, 8.0
"""Scale and shape of the Weibull distribution of strengths."""
ABRASIVITY_RANGE = (0.3, 3.0)


@njit(**INLINE)
def stiffening(wear: float) -> float:
    """The factor by which a bit of this wear is stiffer on the same rock than a sharp one."""
    return 1.0 + BLUNTING * min(wear, BLUNTEST)


@njit(**INLINE)
def wear_of(peaks: np.ndarray, kept: int, single: float, abrasivity: float, rating: float) -> tuple[float, float]:
    """What the blows of an interval do to the bit.

    Args:
        peaks: (m, 2) turns and peak force in N of each impact, of which ``kept`` are filled.
        kept: How many.
        single: Share of single blows, 0 to 1.
        abrasivity: Of the layer.
        rating: Force in N.

    Returns:
        Wear a second, as a share of a life, and blows a second that the load cell sees.
    """
    peaks = borrowed(peaks)
    blows, force, squares, fatigue = 0.0, 0.0, 0.0, 0.0
    for j in range(kept):
        if peaks[j, 1] < SEEN:
            continue
        u = peaks[j, 1] / rating
        blows += 1.0
        force += u
        squares += u * u
        fatigue += (u * u) ** (FATIGUE_EXPONENT // 2)
    heat = squares / INTERVAL / EDGE_POWER
    worn = abrasivity * 0.5 * (blows + force) * (1.0 + heat * heat) + FATIGUE * fatigue
    return worn * (1.0 + CHATTER * (1.0 - single)) / (LIFE * INTERVAL), blows / INTERVAL


def draw_strengths(n: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) the wear at which each of n bits breaks."""
    return STRENGTH * rng.weibull(STRENGTH_SHAPE, n)
