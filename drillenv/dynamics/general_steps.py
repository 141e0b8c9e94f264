"""One step of the general engine: an explicit Runge-Kutta pair of order 8."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numba import njit

from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.general_calls import INNER, MERGED, apart
from drillenv.dynamics.general_equations import Model, inlined_slope

# Dormand-Prince 8(5,3), from E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I,
# Springer 1993, Sec. II.5 and II.10. For each stage the earlier stages it uses, with their weights.

# fmt: off
_STAGES: tuple[tuple[tuple[int, float], ...], ...] = (
    ((0, 0.05260015195876773),),
    ((0, 0.0197250569845379), (1, 0.0591751709536137),),
    ((0, 0.02958758547680685), (2, 0.08876275643042054),),
    ((0, 0.2413651341592667), (2, -0.8845494793282861), (3, 0.924834003261792),),
    ((0, 0.037037037037037035), (3, 0.17082860872947386), (4, 0.12546768756682242),),
    ((0, 0.037109375), (3, 0.17025221101954405), (4, 0.06021653898045596), (5, -0.017578125),),
    ((0, 0.03709200011850479), (3, 0.17038392571223998), (4, 0.10726203044637328), (5, -0.015319437748624402),
     (6, 0.008273789163814023),),
    ((0, 0.6241109587160757), (3, -3.3608926294469414), (4, -0.868219346841726), (5, 27.59209969944671),
     (6, 20.154067550477894), (7, -43.48988418106996),),
    ((0, 0.47766253643826434), (3, -2.4881146199716677), (4, -0.590290826836843), (5, 21.230051448181193),
     (6, 15.279233632882423), (7, -33.28821096898486), (8, -0.020331201708508627),),
    ((0, -0.9371424300859873), (3, 5.186372428844064), (4, 1.0914373489967295), (5, -8.149787010746927),
     (6, -18.52006565999696), (7, 22.739487099350505), (8, 2.4936055526796523), (9, -3.0467644718982196),),
    ((0, 2.273310147516538), (3, -10.53449546673725), (4, -2.0008720582248625), (5, -17.9589318631188),
     (6, 27.94888452941996), (7, -2.8589982771350235), (8, -8.87285693353063), (9, 12.360567175794303),
     (10, 0.6433927460157636),),
    # and the result
    ((0, 0.054293734116568765), (5, 4.450312892752409), (6, 1.8915178993145003), (7, -5.801203960010585),
     (8, 0.3111643669578199), (9, -0.1521609496625161), (10, 0.20136540080403034), (11, 0.04471061572777259),),
)
# three stages more, after the slope at the end, for the states inside a step; rows 13 to 15 of the slopes
_EXTRA: tuple[tuple[tuple[int, float], ...], ...] = (
    ((0, 0.056167502283047954), (6, 0.25350021021662483), (7, -0.2462390374708025), (8, -0.12419142326381637),
     (9, 0.15329179827876568), (10, 0.00820105229563469), (11, 0.007567897660545699), (12, -0.008298),),
    ((0, 0.03183464816350214), (5, 0.028300909672366776), (6, 0.053541988307438566), (7, -0.05492374857139099),
     (10, -0.00010834732869724932), (11, 0.0003825710908356584), (12, -0.00034046500868740456),
     (13, 0.1413124436746325),),
    ((0, -0.42889630158379194), (5, -4.697621415361164), (6, 7.683421196062599), (7, 4.06898981839711),
     (8, 0.3567271874552811), (12, -0.0013990241651590145), (13, 2.9475147891527724), (14, -9.15095847217987),),
)
_INSIDE = (
    (-8.428938276109013, 0.5667149535193777, -3.0689499459498917, 2.38466765651207, 2.117034582445028,
     -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331, 18.148505520854727,
     -9.194632392478356, -4.436036387594894),
    (10.427508642579134, 242.28349177525817, 165.20045171727028, -374.5467547226902, -22.113666853125306,
     7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845, -31.139403219565178,
     -9.35292435884448, 35.81684148639408),
    (19.985053242002433, -387.0373087493518, -189.17813819516758, 527.8081592054236, -11.57390253995963,
     6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508, -60.19669523126412,
     84.32040550667716, 11.99229113618279),
    (-25.69393346270375, -154.18974869023643, -231.5293791760455, 357.6391179106141, 93.40532418362432,
     -37.45832313645163, 104.0996495089623, 29.8402934265605, -43.53345659001114, 96.32455395918828,
     -39.17726167561544, -149.72683625798564),
)
_ERROR_3 = (
    -0.18980075407240762, 4.450312892752409, 1.8915178993145003, -5.801203960010585, -0.4226823213237919,
    -0.1521609496625161, 0.20136540080403034, 0.02265179219836082,
)
_ERROR_5 = (
    0.01312004499419488, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864, -0.35032884874997366,
    0.3341791187130175, 0.08192320648511571, -0.022355307863886294,
)
NODES = np.array((
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25,
    0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0,
))
# fmt: on


def _table(rows: Iterable[Iterable[tuple[int, float]]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of (stage, weight) as (start of each row, stages, weights)."""
    flat = [list(row) for row in rows]
    start = np.cumsum([0] + [len(row) for row in flat])
    return (
        start,
        np.array([stage for row in flat for stage, _ in row]),
        np.array([weight for row in flat for _, weight in row]),
    )


STAGE_START, STAGE_USES, STAGE_WEIGHTS = _table(_STAGES)
EXTRA_START, EXTRA_USES, EXTRA_WEIGHTS = _table(_EXTRA)
EXTRA_NODES = np.array((0.1, 0.2, 0.7777777777777778))
INSIDE = np.array(_INSIDE)
INSIDE_USES = np.array([0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15])
LAST_USES = np.array([0, 5, 6, 7, 8, 9, 10, 11])
"""The stages that enter the result and the two error estimates."""
ERROR_3, ERROR_5 = np.array(_ERROR_3), np.array(_ERROR_5)


# Working memory of the kernels, so that their loops allocate nothing: one array, since every array that a call hands on
# costs time. Its rows, each as long as a state: twelve slopes inside the step last taken, that at its end, and three
# more for the states inside,
END_SLOPE = 12
INNER_STATE, END = 16, 17
"""a state inside a step, and that at the end of the step last taken;"""
TRIAL, TRIAL_SLOPE, START_SLOPE = 18, 19, 20
"""the state at the end of the trial step with its slope, and the slope at its start;"""
PUSH = 21
"""(5 + effects,) forces of one effect, what each adds to the rock, and the forces that friction has to hold;"""
WAY = 22
"""seven polynomials' coefficients, that say where the trial step was inside."""
ROWS = 29


@njit(cache=True, nogil=True)
def make_scratch(states: int, effects: int) -> np.ndarray:
    """Fresh working memory for a state vector of this length."""
    return np.zeros((ROWS, max(states, 5 + effects)))


@njit(**INNER)
def copy(source: np.ndarray, target: np.ndarray):
    """Copy a state. Numba takes seconds to compile the same in slices."""
    for i in range(source.size):
        target[i] = source[i]


@njit(**INNER)
def step(model: Model, time: float, theta: float, regime: int, z: np.ndarray, h: float, scratch: np.ndarray):
    """Step from ``z``, whose slope is row 0, over ``h``: the state to row ``END``, its slope to ``END_SLOPE``.

    Returns the force of the rock at the end of the step in N.
    """
    apart()
    rock = 0.0
    for stage in range(1, 13):
        # energies enter nothing, so they are counted only in the end
        row, count = (INNER_STATE, model.tally) if stage < 12 else (END, z.size)
        for i in range(count):
            total = 0.0
            for use in range(STAGE_START[stage - 1], STAGE_START[stage]):
                total += STAGE_WEIGHTS[use] * scratch[STAGE_USES[use], i]
            scratch[row, i] = z[i] + h * total
        shift = h * NODES[stage]
        at = theta + model.omega * shift
        rock = inlined_slope(model, time + shift, at, regime, scratch[row], scratch[stage], scratch[PUSH])
    return rock


@njit(**INNER)
def follow(model: Model, time: float, theta: float, regime: int, z: np.ndarray, h: float, scratch: np.ndarray):
    """Prepare :func:`inside` for the step just taken from ``z`` over ``h`` (Hairer, Norsett, Wanner, Sec. II.6)."""
    apart()
    for stage in range(3):
        for i in range(model.tally):
            total = 0.0
            for use in range(EXTRA_START[stage], EXTRA_START[stage + 1]):
                total += EXTRA_WEIGHTS[use] * scratch[EXTRA_USES[use], i]
            scratch[INNER_STATE, i] = z[i] + h * total
        shift = h * EXTRA_NODES[stage]
        at = theta + model.omega * shift
        inlined_slope(model, time + shift, at, regime, scratch[INNER_STATE], scratch[13 + stage], scratch[PUSH])
    for i in range(model.tally):
        change = scratch[END, i] - z[i]
        scratch[WAY, i] = change
        scratch[WAY + 1, i] = h * scratch[0, i] - change
        scratch[WAY + 2, i] = 2.0 * change - h * (scratch[END_SLOPE, i] + scratch[0, i])
        for row in range(4):
            total = 0.0
            for use in range(INSIDE_USES.size):
                total += INSIDE[row, use] * scratch[INSIDE_USES[use], i]
            scratch[WAY + 3 + row, i] = h * total


@njit(**INNER)
def inside(model: Model, z: np.ndarray, share: float, scratch: np.ndarray):
    """The state at a share of the step that was prepared by :func:`follow`, to row ``END``; of order 7."""
    for i in range(model.tally):
        total = 0.0
        for row in range(6, -1, -1):
            total = (total + scratch[WAY + row, i]) * (share if row % 2 == 0 else 1.0 - share)
        scratch[END, i] = z[i] + total


@njit(**MERGED)
def step_error(model: Model, z: np.ndarray, h: float, rtol: float, scratch: np.ndarray) -> float:
    """Error of the step last taken over what is tolerated; at most 1 is good.

    Largest over the states and not their mean, so that states at rest do not count.
    """
    third, fifth = 0.0, 0.0
    for i in range(model.tally):
        low, high = 0.0, 0.0
        for use in range(LAST_USES.size):
            low += ERROR_3[use] * scratch[LAST_USES[use], i]
            high += ERROR_5[use] * scratch[LAST_USES[use], i]
        scale = rtol * (model.sizes[i] + max(abs(z[i]), abs(scratch[END, i])))
        if not (abs(low) < math.inf and abs(high) < math.inf):
            return math.inf
        third, fifth = max(third, abs(low) / scale), max(fifth, abs(high) / scale)
    if third == 0.0 and fifth == 0.0:
        return 0.0
    return h * fifth * fifth / math.sqrt(fifth * fifth + 0.01 * third * third)


@njit(**INNER)
def borrow_model(model: Model) -> Model:
    """The same model, references to its arrays not counted."""
    return Model(
        model.m1,
        model.m2,
        model.k,
        model.c,
        model.kl,
        model.ku,
        model.omega,
        model.drive,
        model.static,
        borrowed(model.effects),
        borrowed(model.parameters),
        borrowed(model.sizes),
        model.tally,
        model.bent,
        model.cornered,
        model.rated,
        model.gripped,
        model.grip1,
        model.grip2,
        model.longest,
    )
