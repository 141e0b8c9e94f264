"""The rates of the rig with laws at any place, for one regime of the contact, of each grip and of each law's pieces.

Dynamic states, in SI: the shortening ``y = X1 - X2``, the speeds ``v1`` and ``v2``, the contact's coordinate ``w``, the
deflection ``u`` and speed ``u'`` of the rock's mount, the force ``q`` that the cylinder has lost, the forces ``b1`` and
``b2`` of bristles that are bent where dry friction gives before it slides, the deflection and speed of the bed under
the mount; then the states of terms from outside, and the energies moved. ``w`` is the indenter's place behind an origin
O, ``X2 = O + w + u``: Xf out of contact and while unloading, Xp while loading. So w is the depth, nothing drifts, and a
power law is as smooth as a linear one. The balances stand in :mod:`drillenv.dynamics.constitutive.places`.

What does not change between two events stands in a second array, the discrete state: regimes, phases, counts, the
origin, and for each law with corners the number of those below its argument.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.dynamics.compiled import INLINED, INNER, apart, constants
from drillenv.dynamics.constitutive.places import (
    COMPACTION,
    DAMPER,
    DRIVE,
    GUIDE,
    INDENTER,
    MOST_IMPACTS,
    MOUNT_DAMPER,
    MOUNT_SPRING,
    RATE_FACTOR,
    RATE_FORCE,
    REFERENCE_DEPTH,
    SCALARS,
    SPRING,
    SPRING_FROM_REST,
    UNLOADING,
    WAVEFORM,
)
from drillenv.dynamics.constitutive.tables import DEGREE
from drillenv.dynamics.effects import ON_INDENTER, ON_ROCK, ON_SHAKER, Moment
from drillenv.dynamics.flow import FREE, sine_cosine
from drillenv.dynamics.flow import LOADING as ON_LOADING
from drillenv.dynamics.fused import fma
from drillenv.dynamics.hybrid.outside_terms import call_term

TURN = 2.0 * math.pi

# Dynamic states; behind OWN those of terms from outside, and then, from Model.tally on, the energies.
Y, V1, V2, W, U, UD, Q, BENT1, BENT2, BED, BED_SPEED, OWN = range(12)
BY_DRIVE, BY_STATIC, IN_DAMPER, IN_ROCK, BY_EFFECTS = range(5)
"""Energies in J, counted from ``Model.tally``; one for each effect from ``BY_EFFECTS`` on."""

# The discrete state
(
    REGIME,
    THETA,
    THETA_CARRY,
    TURNS,
    TIME,
    ORIGIN,
    CARRY,
    SLIDE1,
    SLIDE2,
    COUNT,
    COUNT_CONTACT,
    DRILLED,
    DRILLED_CONTACT,
    ROTATION,
    ROTATION_CONTACT,
    VIBRATION,
    FACTOR,
    PEAK,
    IMPACT_DEPTH,
    CUT,
    SLEWING,
    DRIVEN,
    SLEWING_LEFT,
    TRUST,
) = range(24)
CORNERS = TRUST + 3
LAW_MEMORY, BELOW, LOWEST, HIGHEST = 3, 0, 1, 2
"""0 no contact, 1 loading, 2 unloading; phase in [0, 2 pi) with the rounding it owes, and whole turns of the
excitation; time since the start in s; the origin in m and the rounding it owes; ways in which masses slide (1, -1, or 0
while dry friction grips them); impacts on this face, and those before the present contact; m drilled on it, likewise;
angles in rad of what turns, now and where the present contact began, and of the vibration; factor on the rock's
stiffness; largest force of the present loading so far in N, and its depth in m at the last turn; 1 where the rock would
pull, and does not; way in which a drive of limited slew rate ramps (1, -1, or 0 while it follows), its force in N,
and s until that changes; length in s of the next step in each regime. Behind them, for each law, how many of its
corners lie below its argument, and the first piece of the part between corners that it is in and that of the next."""

# Scalars of the model, in front of those that effects set
M1, M2, K, C, F_A, F_B, KL, KU, OMEGA = range(9)
(
    MOUNT_GAIN,
    MOUNT_SQUARE,
    MOUNT_DAMPING,
    AIR_STIFFNESS,
    AIR_PER_LENGTH,
    AIR_RATE,
    DRIVE_LAG,
    SHAKER_VIBRATION,
    INDENTER_VIBRATION,
    VIBRATION_RATE,
    VIBRATION_PHASE,
    VIBRATION_DETUNING,
    VIBRATION_LEAD,
    ROTATION_SHARE,
    ROTATION_RATE,
    ROTATION_PHASE,
    GRIP1,
    GRIP2,
    BRISTLES1,
    BRISTLES2,
    SLIDING1,
    SLIDING2,
    BRISTLE_DAMPING1,
    BRISTLE_DAMPING2,
    CONTACT_DAMPING,
    CONTACT_DAMPING_POWER,
    BED_SHARE,
    BED_SQUARE,
    BED_DAMPING,
    COMPACTION_LENGTH,
    SLEW_RATE,
    SLEW_SHARE,
    DRIVE_DELAY,
) = range(OMEGA + 1, OMEGA + 1 + len(SCALARS))
SCALAR_AT = dict(zip(SCALARS, range(OMEGA + 1, OMEGA + 1 + len(SCALARS)), strict=True))
"""Places of the scalars that effects set, by their names."""
LONGEST = DRIVE_DELAY + 1
"""Longest step in s."""
# behind them how many laws and terms there are, and where their tables begin; which effect is answerable for what
# scalars do, -1 for none; and the dynamic states, how many of them move, the effects, whether the force of the rock may
# peak before a turn, whether it would pull, and whether forces act beyond those of the plain rig, in flight and on rock
LAWS, CORNERS_AT, TERMS, TERMS_AT, PARAMETERS_AT, SIZES_AT = range(LONGEST + 1, LONGEST + 7)
(
    BY_MOUNT,
    BY_AIR,
    BY_LAG,
    BY_VIBRATION,
    BY_SLOPE,
    BY_GRIP1,
    BY_GRIP2,
    BY_BRISTLES1,
    BY_BRISTLES2,
    BY_CONTACT_DAMPING,
) = range(SIZES_AT + 1, SIZES_AT + 11)
TALLY, MOVING, EFFECTS, RATED, PULLS, BUSY, BUSY_ON_ROCK = range(BY_CONTACT_DAMPING + 1, BY_CONTACT_DAMPING + 8)
SIZE = BUSY_ON_ROCK + 1
LEAST_AIR = 0.01
"""Of the cylinder's force: where a supply is turned down, gas may have lost more than that by then."""
MOST_LAWS = 64
"""Room for laws; their table begins at SIZE, that of their pieces behind it."""

# Columns of the table of laws: its place; its pieces, from FIRST on; its corners, from FIRST_CORNER on; its effect;
# what the shape of a contact is over (see places.OVER); and the piece that was looked at last.
PLACE, FIRST, PIECES, FIRST_CORNER, CORNER_COUNT, EFFECT, OVER_KIND, LAST_PIECE = constants(*range(8))
LAW_COLUMNS = 8
PIECES_AT = SIZE + MOST_LAWS * LAW_COLUMNS
LEFT, SCALE, COEFFICIENTS = 0, 1, 2
"""Columns of a piece: where it begins, one over half of its width, and its coefficients."""
PIECE_COLUMNS = COEFFICIENTS + DEGREE + 1
WHERE, PIECE, CORNER_COLUMNS = constants(*range(3))
"""Columns of a corner: where, and the piece that begins there."""
# Columns of the table of terms from outside: address, first of its states, first of its parameters, its effect
ADDRESS, STATE, PARAMETER, TERM_EFFECT, TERM_COLUMNS = constants(*range(5))

LEAST_SLIDING = 1e-9
"""N. Bristles that slide at no force would have no state to go to."""
PUSHED, WHOLE, ON_ROCKS = 3, 5, 6
"""Where the forces on both masses without dry friction stand in ``push``, behind those of a term, the force of the rock
if it could pull, and what each term adds to it."""


class Model(NamedTuple):
    """A rig on a rock at a setting, with what effects add, made ready for the kernels.

    They take ``flat`` alone, in their arguments ``m``: one array, since every array that a call hands on costs time.
    """

    flat: np.ndarray
    s: np.ndarray
    """(SIZE,) scalars: its beginning, not a copy."""
    laws: np.ndarray
    """(laws, LAW_COLUMNS)"""
    tally: int
    """Dynamic states."""
    effects: int


@njit(**INLINED)
def law_at(m: np.ndarray, law: int, column: int) -> int:
    """A number of the table of laws."""
    return int(m[SIZE + law * LAW_COLUMNS + column])


@njit(**INLINED)
def term_at(m: np.ndarray, term: int, column: int) -> int:
    """A number of the table of terms."""
    return int(m[int(m[TERMS_AT]) + term * TERM_COLUMNS + column])


@njit(**INLINED)
def corner_at(m: np.ndarray, corner: int, column: int) -> float:
    """A number of the table of corners."""
    return float(m[int(m[CORNERS_AT]) + corner * CORNER_COLUMNS + column])


@njit(**INLINED)
def below_of(d: np.ndarray, law: int) -> int:
    """How many corners of a law lie below its argument."""
    return int(d[CORNERS + LAW_MEMORY * law + BELOW])


@njit(**INNER)
def set_below(m: np.ndarray, d: np.ndarray, law: int, below: int) -> None:
    """Put a law into the part above so many of its corners."""
    at, first, corner = CORNERS + LAW_MEMORY * law, law_at(m, law, FIRST), law_at(m, law, FIRST_CORNER)
    low, high = first, first + law_at(m, law, PIECES)
    if below > 0:
        low = first + int(corner_at(m, corner + below - 1, PIECE))
    if below < law_at(m, law, CORNER_COUNT):
        high = first + int(corner_at(m, corner + below, PIECE))
    d[at + BELOW], d[at + LOWEST], d[at + HIGHEST] = below, low, high


@njit(**INLINED)
def bisect_pieces(m: np.ndarray, low: int, high: int, x: float) -> int:
    """The last piece from ``low`` to before ``high`` that begins at x or below it; ``low`` where none does."""
    while high - low > 1:
        middle = (low + high) // 2
        if m[PIECES_AT + middle * PIECE_COLUMNS + LEFT] <= x:
            low = middle
        else:
            high = middle
    return low


@njit(**INLINED)
def piece_of(m: np.ndarray, d: np.ndarray, law: int, x: float) -> int:
    """Where the piece of a law begins in m that holds x, or comes nearest to it.

    Of those between the corners that the discrete state says. The piece last found is looked at first.
    """
    low, high = int(d[CORNERS + LAW_MEMORY * law + LOWEST]), int(d[CORNERS + LAW_MEMORY * law + HIGHEST])
    table, last = PIECES_AT, law_at(m, law, LAST_PIECE)
    if low <= last < high:
        if last > low and x < m[table + last * PIECE_COLUMNS + LEFT]:
            high = last
        elif last < high - 1 and x >= m[table + (last + 1) * PIECE_COLUMNS + LEFT]:
            low = last + 1
        else:
            low, high = last, last + 1
    low = bisect_pieces(m, low, high, x)
    m[SIZE + law * LAW_COLUMNS + LAST_PIECE] = low
    return table + low * PIECE_COLUMNS


@njit(**INNER)
def look(m: np.ndarray, d: np.ndarray, law: int, x: float) -> tuple[float, float]:
    """Value and slope of a law at x, in the part between corners that the discrete state says; beyond it straight."""
    apart()
    return read_piece(m, piece_of(m, d, law, x), x)


@njit(**INNER)
def look_anew(m: np.ndarray, law: int, x: float) -> tuple[float, float]:
    """The same at any x, whichever corners lie below it by the discrete state."""
    first = law_at(m, law, FIRST)
    low = bisect_pieces(m, first, first + law_at(m, law, PIECES), x)
    m[SIZE + law * LAW_COLUMNS + LAST_PIECE] = low
    return read_piece(m, PIECES_AT + low * PIECE_COLUMNS, x)


@njit(**INLINED)
def read_piece(m: np.ndarray, at: int, x: float) -> tuple[float, float]:
    """Value and slope at x of the piece that begins at ``at``; beyond its ends straight."""
    scale = m[at + SCALE]
    t = (x - m[at + LEFT]) * scale - 1.0
    inside = min(max(t, -1.0), 1.0)
    value, slope = 0.0, 0.0
    for power in range(at + COEFFICIENTS + DEGREE, at + COEFFICIENTS - 1, -1):
        slope = value + inside * slope
        value = m[power] + inside * value
    return value + (t - inside) * slope, slope * scale


@njit(**INLINED)
def value_at(m: np.ndarray, d: np.ndarray, law: int, x: float) -> float:
    """The value alone."""
    at = piece_of(m, d, law, x)
    t = fma(x - m[at + LEFT], m[at + SCALE], -1.0)
    if abs(t) > 1.0:
        return look(m, d, law, x)[0]
    c, square = at + COEFFICIENTS, t * t
    low = fma(square, fma(t, m[c + 3], m[c + 2]), fma(t, m[c + 1], m[c]))
    high = fma(square, fma(t, m[c + 7], m[c + 6]), fma(t, m[c + 5], m[c + 4]))
    return fma(square * square, high, low)


@njit(**INLINED)
def stiffness(m: np.ndarray, d: np.ndarray, regime: int) -> float:
    """Stiffness of the rock in N/m in a regime of contact."""
    return d[FACTOR] * m[KL if regime == ON_LOADING else KU]


@njit(**INLINED)
def shape_scale(m: np.ndarray, d: np.ndarray, law: int, regime: int) -> float:
    """What a depth is multiplied with before the shape of a contact is looked up, and divided by after it."""
    over = law_at(m, law, OVER_KIND)
    if over == 0:
        return 1.0
    return stiffness(m, d, regime) if over == 2 else m[KL if regime == ON_LOADING else KU] / m[KL]


@njit(**INLINED)
def law_force(m: np.ndarray, d: np.ndarray, regime: int, w: float) -> float:
    """Force of the rock law in N at depth ``w``; negative behind the face, where a trial step may end."""
    if regime == FREE:
        return 0.0
    depth = w
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) > UNLOADING:
            break
        if law_at(m, i, PLACE) == regime - ON_LOADING:
            scale = shape_scale(m, d, i, regime)
            depth = value_at(m, d, i, depth * scale) / scale
    return stiffness(m, d, regime) * depth


@njit(**INNER)
def shape_argument(m: np.ndarray, d: np.ndarray, law: int, w: float) -> tuple[float, float]:
    """What the shape of a contact is over at the depth w, behind the shapes before it, and its derivative by w."""
    apart()
    place = law_at(m, law, PLACE)
    depth, rate = w, 1.0
    for i in range(law):
        if law_at(m, i, PLACE) == place:
            scale = shape_scale(m, d, i, place + ON_LOADING)
            value, slope = look(m, d, i, depth * scale)
            depth, rate = value / scale, rate * slope
    scale = shape_scale(m, d, law, place + ON_LOADING)
    return depth * scale, rate * scale


@njit(**INLINED)
def compaction_argument(m: np.ndarray, d: np.ndarray) -> float:
    """Impacts on this face before the contact began, or what was drilled on it over the length that counts as one."""
    # beyond any count of a rig a law does not go on
    if m[COMPACTION_LENGTH] > 0.0:
        return min(max(d[DRILLED_CONTACT], 0.0) / m[COMPACTION_LENGTH], MOST_IMPACTS)
    return min(d[COUNT_CONTACT], MOST_IMPACTS)


@njit(**INLINED)
def argument(m: np.ndarray, d: np.ndarray, law: int, z: np.ndarray, theta: float) -> float:
    """What a law is over, at the state z."""
    place = law_at(m, law, PLACE)
    if place <= UNLOADING:
        return shape_argument(m, d, law, z[W])[0]
    if place in (RATE_FACTOR, RATE_FORCE):
        return z[V2] - z[UD]
    if place == COMPACTION:
        return compaction_argument(m, d)
    if place == SPRING:
        return z[Y]
    if place == SPRING_FROM_REST:
        return z[Y] - m[F_B] / m[K]
    if place == DAMPER:
        return z[V1] - z[V2]
    if place == GUIDE:
        return z[V1] if m[BRISTLES1] == 0.0 else d[SLIDE1] * z[V1]
    if place == INDENTER:
        return z[V2] if m[BRISTLES2] == 0.0 else d[SLIDE2] * z[V2]
    if place == WAVEFORM:
        # counted on from the corner below, since the end of a part may be that of a turn
        below = below_of(d, law)
        low = corner_at(m, law_at(m, law, FIRST_CORNER) + below - 1, WHERE) if below > 0 else 0.0
        return theta - TURN * math.floor((theta - low) / TURN)
    if place == DRIVE:
        return m[F_A] * sine_cosine(theta)[0]
    if place == MOUNT_SPRING:
        return z[U] - z[BED]
    return z[UD] - z[BED_SPEED]


@njit(**INNER)
def argument_rate(m: np.ndarray, d: np.ndarray, law: int, z: np.ndarray, dz: np.ndarray, theta: float) -> float:
    """Its time derivative."""
    place = law_at(m, law, PLACE)
    if place <= UNLOADING:
        return (z[V2] - z[UD]) * shape_argument(m, d, law, z[W])[1]
    if place in (RATE_FACTOR, RATE_FORCE):
        return dz[V2] - dz[UD]
    if place in (SPRING, SPRING_FROM_REST):
        return z[V1] - z[V2]
    if place == DAMPER:
        return dz[V1] - dz[V2]
    if place == GUIDE:
        return dz[V1] if m[BRISTLES1] == 0.0 else d[SLIDE1] * dz[V1]
    if place == INDENTER:
        return dz[V2] if m[BRISTLES2] == 0.0 else d[SLIDE2] * dz[V2]
    if place == WAVEFORM:
        return m[OMEGA]
    if place == DRIVE:
        return m[F_A] * m[OMEGA] * math.cos(theta)
    if place == MOUNT_SPRING:
        return z[UD] - z[BED_SPEED]
    return dz[UD] - dz[BED_SPEED] if place == MOUNT_DAMPER else 0.0


@njit(**INNER)
def argument_size(m: np.ndarray, d: np.ndarray, law: int) -> float:
    """What counts as large for it."""
    place, sizes = law_at(m, law, PLACE), int(m[SIZES_AT])
    if place <= UNLOADING:
        return m[sizes + W] * shape_scale(m, d, law, place + ON_LOADING)
    if place in (SPRING, SPRING_FROM_REST):
        return m[sizes + Y]
    if place == DRIVE:
        return m[F_A]
    return m[sizes + U] if place == MOUNT_SPRING else m[sizes + V2]


@njit(**INNER)
def drive_asked(m: np.ndarray, theta: float) -> tuple[float, float]:
    """Force in N that is asked of a drive at a phase, whatever its slope, and its derivative by the phase."""
    apart()
    ratio = m[DRIVE_LAG] * m[OMEGA] / TURN
    size = m[F_A] / math.sqrt(1.0 + ratio * ratio)
    sine, cosine = sine_cosine(theta)
    force, rate = size * sine, size * cosine
    for i in range(int(m[LAWS])):
        place = law_at(m, i, PLACE)
        if place == WAVEFORM:
            value, slope = look_anew(m, i, theta - TURN * math.floor(theta / TURN))
            force += m[F_A] * value
            rate += m[F_A] * slope
        elif place == DRIVE:
            value, slope = look_anew(m, i, m[F_A] * sine)
            force += value
            rate += slope * m[F_A] * cosine
    return force, rate


@njit(**INLINED)
def drive_lost(m: np.ndarray, d: np.ndarray, shift: float, theta: float) -> float:
    """Force in N that a drive of limited slew rate, which is late, has beyond what is asked at the phase ``theta``."""
    asked = drive_asked(m, theta)[0]
    if d[SLEWING] != 0.0:
        return d[DRIVEN] + d[SLEWING] * m[SLEW_RATE] * shift - asked
    return drive_asked(m, theta - m[OMEGA] * m[DRIVE_DELAY])[0] - asked


@njit(**INLINED)
def is_of_bristles(m: np.ndarray, place: int) -> bool:
    """Whether a law at a place is a force that bristles slide at, and acts through them."""
    return (place == GUIDE and m[BRISTLES1] > 0.0) or (place == INDENTER and m[BRISTLES2] > 0.0)


@njit(**INLINED)
def damping_share(m: np.ndarray, w: float) -> float:
    """What the rock's damping at the depth ``w`` is over that at the reference depth; none behind the face."""
    power = m[CONTACT_DAMPING_POWER]
    if power == 0.0:
        return 1.0
    return (w / REFERENCE_DEPTH) ** power if w > 0.0 else 0.0


@njit(**INLINED)
def damping_slope(m: np.ndarray, w: float) -> float:
    """By what the rock's damping in N s/m rises with the depth ``w`` in m; none behind the face and at it."""
    return m[CONTACT_DAMPING_POWER] * m[CONTACT_DAMPING] * damping_share(m, w) / w if w > 0.0 else 0.0


@njit(**INLINED)
def extra_forces(
    m, d, regime: int, shift: float, theta: float, law: float, drive: float, z, dz, push
) -> tuple[float, float, float, float]:
    """The rock's force in N, and what acts on shaker, indenter and mount beyond the plain rig; energies to dz."""
    v1, v2, given = z[V1], z[V2], int(m[TALLY]) + BY_EFFECTS
    closing, into = v1 - v2, v2 - z[UD]
    on_shaker, on_indenter, added, on_mount = 0.0, 0.0, 0.0, 0.0
    for i in range(int(m[LAWS])):
        place = law_at(m, i, PLACE)
        if place <= UNLOADING or place == COMPACTION or (regime == FREE and place <= RATE_FORCE):
            continue
        if is_of_bristles(m, place):
            continue
        value = value_at(m, d, i, drive if place == DRIVE else argument(m, d, i, z, theta))
        power = given + law_at(m, i, EFFECT)
        if place <= RATE_FORCE:
            value *= law if place == RATE_FACTOR else 1.0
            added += value
            dz[power] -= value * into
        elif place <= DAMPER:
            on_shaker -= value
            on_indenter += value
            dz[power] -= value * closing
        elif place == GUIDE:
            on_shaker -= value
            dz[power] -= value * v1
        elif place <= DRIVE:
            value *= -1.0 if place == INDENTER else (m[F_A] if place == WAVEFORM else 1.0)
            on_indenter += value
            dz[power] += value * v2
        else:
            on_mount += value
    if int(m[TERMS]) > 0:
        for i in range(int(m[TERMS])):
            push[0], push[1], push[2] = 0.0, 0.0, 0.0
            now = Moment(
                d[TIME] + shift, theta, m[OMEGA], z[Y], closing, v1, v2, z[W], into, z[U], law, regime, m[F_A], m[F_B],
                m[M1], m[M2], m[K], m[C], m[KL], m[KU],
            )  # fmt: skip
            call_term(
                term_at(m, i, ADDRESS),
                now,
                z,
                dz,
                term_at(m, i, STATE),
                m,
                int(m[PARAMETERS_AT]) + term_at(m, i, PARAMETER),
                push,
            )
            on_shaker += push[ON_SHAKER]
            on_indenter += push[ON_INDENTER]
            power = given + term_at(m, i, TERM_EFFECT)
            dz[power] += push[ON_SHAKER] * v1 + push[ON_INDENTER] * v2
            push[ON_ROCKS + i] = 0.0 if regime == FREE else push[ON_ROCK]
            added += push[ON_ROCKS + i]
            dz[power] -= push[ON_ROCKS + i] * into
    damped = 0.0
    if regime != FREE and m[CONTACT_DAMPING] != 0.0:
        damped = m[CONTACT_DAMPING] * damping_share(m, z[W]) * into
        added += damped
    push[WHOLE] = law + added
    # the contact never pulls; within a step it is one or the other throughout
    rock = law + added if d[CUT] == 0.0 else 0.0
    if d[CUT] != 0.0 and added != 0.0:
        share = -law / added
        for i in range(int(m[LAWS])):
            if law_at(m, i, PLACE) == RATE_FACTOR or law_at(m, i, PLACE) == RATE_FORCE:
                dz[given + law_at(m, i, EFFECT)] *= share
        for i in range(int(m[TERMS])):
            dz[given + term_at(m, i, TERM_EFFECT)] += (1.0 - share) * push[ON_ROCKS + i] * into
        damped *= share
    if damped != 0.0:
        dz[given + int(m[BY_CONTACT_DAMPING])] -= damped * into
    if int(m[BY_LAG]) >= 0:
        ratio = m[DRIVE_LAG] * m[OMEGA] / TURN
        lost = drive * (1.0 / math.sqrt(1.0 + ratio * ratio) - 1.0)
        on_indenter += lost
        dz[given + int(m[BY_LAG])] += lost * v2
    if int(m[BY_SLOPE]) >= 0 and (d[SLEWING] != 0.0 or m[DRIVE_DELAY] != 0.0):
        lost = m[SLEW_SHARE] * drive_lost(m, d, shift, theta)
        on_indenter += lost
        dz[given + int(m[BY_SLOPE])] += lost * v2
    if int(m[BY_VIBRATION]) >= 0:
        turned = d[VIBRATION] + m[VIBRATION_RATE] * shift + m[VIBRATION_PHASE]
        push1 = m[SHAKER_VIBRATION] * sine_cosine(turned)[0]
        turned += m[VIBRATION_DETUNING] * (d[TIME] + shift) + m[VIBRATION_LEAD]
        push2 = m[INDENTER_VIBRATION] * sine_cosine(turned)[0]
        on_shaker += push1
        on_indenter += push2
        dz[given + int(m[BY_VIBRATION])] += push1 * v1 + push2 * v2
    if int(m[BY_AIR]) >= 0:
        on_shaker -= z[Q]
        dz[given + int(m[BY_AIR])] -= z[Q] * v1
    if int(m[BY_MOUNT]) >= 0:
        dz[given + int(m[BY_MOUNT])] -= rock * z[UD]
    return rock, on_shaker, on_indenter, on_mount


@njit(**INNER)
def rates(m: np.ndarray, d: np.ndarray, shift: float, z: np.ndarray, dz: np.ndarray, push: np.ndarray) -> float:
    """Write the time derivative of the state z, ``shift`` s after the discrete state d, to dz; return the rock's force.

    The forces on both masses without dry friction, which it must hold where they stick, are left in ``push``.
    """
    apart()
    return field(m, d, shift, z, dz, push)


@njit(**INLINED)
def field(m: np.ndarray, d: np.ndarray, shift: float, z: np.ndarray, dz: np.ndarray, push: np.ndarray) -> float:
    """What :func:`rates` does, inlined."""
    tally, regime = int(m[TALLY]), int(d[REGIME])
    v1, v2, ud = z[V1], z[V2], z[UD]
    closing, into, theta = v1 - v2, v2 - ud, d[THETA] + m[OMEGA] * shift
    for i in range(int(m[EFFECTS])):
        dz[tally + BY_EFFECTS + i] = 0.0
    law = law_force(m, d, regime, z[W])
    drive, damper = m[F_A] * sine_cosine(theta)[0], m[C] * closing
    inner = fma(m[K], z[Y], damper)
    rock, on_shaker, on_indenter, on_mount, push[WHOLE] = law, 0.0, 0.0, 0.0, law
    if m[BUSY if regime == FREE else BUSY_ON_ROCK] > 0.0:
        rock, on_shaker, on_indenter, on_mount = extra_forces(m, d, regime, shift, theta, law, drive, z, dz, push)
    # in the order in which the numbers come, and by products in place of quotients: there is always one to wait for
    one, two = (m[F_B] + on_shaker) - inner, ((drive + on_indenter) - rock) + inner
    push[PUSHED], push[PUSHED + 1] = one, two
    dz[Y], dz[W], dz[U], dz[UD], dz[Q] = closing, into, ud, 0.0, 0.0
    dz[V1], dz[V2] = one * (1.0 / m[M1]), two * (1.0 / m[M2])
    dz[BED], dz[BED_SPEED] = z[BED_SPEED], 0.0
    if m[MOVING] > U:
        deflection, rate = z[U] - z[BED], ud - z[BED_SPEED]
        dz[UD] = m[MOUNT_GAIN] * rock - m[MOUNT_SQUARE] * deflection - m[MOUNT_DAMPING] * rate - on_mount
        if m[BED_SQUARE] > 0.0:
            held = m[MOUNT_SQUARE] * deflection + m[MOUNT_DAMPING] * rate + on_mount
            dz[BED_SPEED] = m[BED_SHARE] * held - m[BED_SQUARE] * z[BED] - m[BED_DAMPING] * z[BED_SPEED]
        left = air_left(m, z[Q])
        dz[Q] = air_stiffness(m) * left * left * v1 - m[AIR_RATE] * left * z[Q]
    dz[BENT1], dz[BENT2] = 0.0, 0.0
    rub(m, d, z, dz)
    dz[tally + BY_DRIVE], dz[tally + BY_STATIC] = drive * v2, m[F_B] * v1
    dz[tally + IN_DAMPER], dz[tally + IN_ROCK] = damper * closing, law * into
    return rock


@njit(**INLINED)
def air_stiffness(m: np.ndarray) -> float:
    """Stiffness in N/m of the enclosed air while it has lost no force."""
    return m[AIR_STIFFNESS] + max(m[F_B], 0.0) * m[AIR_PER_LENGTH]


@njit(**INLINED)
def air_left(m: np.ndarray, lost: float) -> float:
    """Share of the cylinder's force that is left where gas has lost a force in N; 1 where its law is straight.

    By Boyle's law the force is F_b l / (l + x), and x' = v1 - x / tau. With q = F_b x / (l + x) in the place of the
    stroke x that the supply has not refilled, q' = F_b / l (1 - q / F_b)^2 v1 - q (1 - q / F_b) / tau.
    """
    if m[AIR_PER_LENGTH] == 0.0 or m[F_B] <= 0.0:
        return 1.0
    return max(1.0 - lost / m[F_B], LEAST_AIR)


@njit(**INLINED)
def rub(m: np.ndarray, d: np.ndarray, z: np.ndarray, dz: np.ndarray) -> None:
    """Add dry friction that grips: full while a mass slides; whatever holds it while it sticks."""
    for mass in range(2):
        limit = m[GRIP1 + mass]
        if limit > 0.0:
            slide = d[SLIDE1 + mass]
            dz[V1 + mass] = 0.0 if slide == 0.0 else dz[V1 + mass] - slide * limit / m[M1 + mass]
            dz[int(m[TALLY]) + BY_EFFECTS + int(m[BY_GRIP1 + mass])] -= slide * limit * z[V1 + mass]
        elif m[BRISTLES1 + mass] > 0.0:
            bend(m, d, mass, z, dz)


@njit(**INNER)
def bend(m: np.ndarray, d: np.ndarray, mass: int, z: np.ndarray, dz: np.ndarray) -> None:
    """Add the force of bristles on a mass, and how it changes (P. R. Dahl, The Aerospace Corporation, TOR-0158, 1968).

    With a sliding force that goes with the speed it is the model of C. Canudas de Wit and others, IEEE Transactions on
    Automatic Control 40 (1995) 419-425.
    """
    apart()
    v, force = z[V1 + mass], z[BENT1 + mass]
    giving = v - d[SLIDE1 + mass] * v * force / sliding_force(m, d, mass, v)
    dz[BENT1 + mass] = m[BRISTLES1 + mass] * giving
    force += m[BRISTLE_DAMPING1 + mass] * giving
    dz[V1 + mass] -= force / m[M1 + mass]
    dz[int(m[TALLY]) + BY_EFFECTS + int(m[BY_BRISTLES1 + mass])] -= force * v


@njit(**INNER)
def sliding_force(m: np.ndarray, d: np.ndarray, mass: int, v: float) -> float:
    """Force in N at which the bristles of a mass slide at the speed ``v`` in m/s; more than nothing."""
    total = m[SLIDING1 + mass]
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == GUIDE + mass:
            total += look(m, d, i, d[SLIDE1 + mass] * v)[0]
    return max(total, LEAST_SLIDING)


@njit(**INNER)
def law_depth(m: np.ndarray, d: np.ndarray, regime: int, force: float) -> float:
    """Depth in m at which the rock law of a regime has this force."""
    apart()
    goal = force / stiffness(m, d, regime)
    bent = False
    for i in range(int(m[LAWS])):
        bent = bent or law_at(m, i, PLACE) == regime - ON_LOADING
    if not bent or goal <= 0.0:
        return goal
    low, under, high = 0.0, -force, goal
    over = law_anew(m, d, regime, high) - force
    while over < 0.0:
        low, under, high = high, over, 2.0 * high
        over = law_anew(m, d, regime, high) - force
    # regula falsi with the Illinois rule, and a bisection now and then in case it creeps
    for turn in range(200):
        guess = 0.5 * (low + high)
        if turn % 4 < 3 and over > under:
            guess = (low * over - high * under) / (over - under)
        if not low < guess < high:
            break
        value = law_anew(m, d, regime, guess) - force
        if value == 0.0:
            return guess
        if value > 0.0:
            high, over, under = guess, value, 0.5 * under
        else:
            low, under, over = guess, value, 0.5 * over
    return low if abs(law_anew(m, d, regime, low) - force) < abs(law_anew(m, d, regime, high) - force) else high


@njit(**INNER)
def law_anew(m: np.ndarray, d: np.ndarray, regime: int, w: float) -> float:
    """The force of the rock law in N at any depth, whichever corners lie below it."""
    apart()
    depth = w
    for i in range(int(m[LAWS])):
        if law_at(m, i, PLACE) == regime - ON_LOADING:
            scale = shape_scale(m, d, i, regime)
            set_below(m, d, i, corners_below(m, i, depth * scale, 1.0))
            depth = value_at(m, d, i, depth * scale) / scale
    return stiffness(m, d, regime) * depth


@njit(**INNER)
def corners_below(m: np.ndarray, law: int, x: float, rate: float) -> int:
    """How many corners of a law lie below an argument; one at which it stands counts if it rises."""
    first, below = law_at(m, law, FIRST_CORNER), 0
    for i in range(law_at(m, law, CORNER_COUNT)):
        at = corner_at(m, first + i, WHERE)
        if at < x or (at == x and rate > 0.0):
            below += 1
    return below
