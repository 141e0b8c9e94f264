"""The explicit Runge-Kutta pair of order 8 by Dormand and Prince, with dense output.

It serves tight tolerances and loose ones alike: at a relative error of 1e-6 a pair of order 5 takes 50 steps of six
stages a period, this one 16 of twelve. A step leaves all of its slopes in working memory. What lies inside it is read
off its polynomial: events are found on it, samples are taken from it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from drillenv.dynamics.hybrid.compiled import INLINED, INNER, apart, constants
from drillenv.dynamics.hybrid.vector_field import (
    CORNERS,
    EFFECTS,
    LAW_MEMORY,
    MOVING,
    ON_ROCKS,
    SIZES_AT,
    TALLY,
    Model,
    rates,
)

# Dormand-Prince 8(5,3), from E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I,
# Springer 1993, Sec. II.5, II.6 and II.10.

# fmt: off
A = (
        (0.05260015195876773,),
        (0.0197250569845379, 0.0591751709536137),
        (0.02958758547680685, 0.08876275643042054),
        (0.2413651341592667, -0.8845494793282861, 0.924834003261792),
        (0.037037037037037035, 0.17082860872947386, 0.12546768756682242),
        (0.037109375, 0.17025221101954405, 0.06021653898045596, -0.017578125),
        (0.03709200011850479, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023),
        (0.6241109587160757, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894,
     -43.48988418106996),
        (0.47766253643826434, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423,
     -33.28821096898486, -0.020331201708508627),
        (-0.9371424300859873, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696,
     22.739487099350505, 2.4936055526796523, -3.0467644718982196),
        (2.273310147516538, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996,
     -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636),
        (0.054293734116568765, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199,
     -0.1521609496625161, 0.20136540080403034, 0.04471061572777259),
)
"""Weights of the slopes that stages 1 to 11 and the result are made of; which slopes, :func:`step` says."""
# of three stages more, after the slope at the end, for the states inside a step; rows 13 to 15 of the slopes
B = (
    (0.056167502283047954, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637, 0.15329179827876568,
     0.00820105229563469, 0.007567897660545699, -0.008298),
    (0.03183464816350214, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099, -0.00010834732869724932,
     0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325),
    (-0.42889630158379194, -4.697621415361164, 7.683421196062599, 4.06898981839711, 0.3567271874552811,
     -0.0013990241651590145, 2.9475147891527724, -9.15095847217987),
)
# and of the highest powers of the polynomial: slopes 0 and 5 to 15
C = (
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
# of the errors of order 3 and 5: slopes 0 and 5 to 11
E3 = (
    -0.18980075407240762, 4.450312892752409, 1.8915178993145003, -5.801203960010585, -0.4226823213237919,
    -0.1521609496625161, 0.20136540080403034, 0.02265179219836082,
)
E5 = (
    0.01312004499419488, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864, -0.35032884874997366,
    0.3341791187130175, 0.08192320648511571, -0.022355307863886294,
)
NODES = np.array((
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25,
    0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0,
))
EXTRA_NODES = np.array((0.1, 0.2, 0.7777777777777778))

# fmt: on


FIRST_SLOPE, STAGES = constants(0, 12)
"""The rows of the slopes at the beginning and the end of a step."""

# Working memory of the kernels, so that their loops allocate nothing: one array, since every array that a call hands on
# costs time. Its rows, each as long as a state: up to sixteen slopes inside the step last taken,
INNER_STATE, END = constants(16, 17)
"""a state inside a step, and that at the end of the step last taken;"""
BEGIN, BEGIN_D, BEGIN_SLOPE = constants(18, 19, 20)
"""the state and the discrete state at the beginning of the step, and the slope where the motion stands;"""
PUSH = 21
"""what the vector field leaves behind: see vector_field.PUSHED;"""
WAY = 22
"""up to seven polynomials' coefficients, that say where the trial step was inside;"""
SPARE, SPARE_SLOPE = constants(29, 30)
"""a state to look at, and its slope;"""
FLAGS, READY, LENGTH, STANDING, TOLERANCE = 31, 0, 1, 2, 3
"""whether the polynomials are ready, the length of their step in s, how many events there have been at one
time, and the relative error tolerated."""
ROWS = 32


def make_scratch(m: Model) -> np.ndarray:
    """Fresh working memory for a model."""
    return np.zeros((ROWS, max(m.tally + 4 + m.effects, ON_ROCKS + m.effects, CORNERS + LAW_MEMORY * len(m.laws))))


@njit(**INNER)
def copy(source: np.ndarray, target: np.ndarray):
    """Copy what both have room for. Numba takes seconds to compile the same in slices."""
    for i in range(min(source.size, target.size)):
        target[i] = source[i]


# fmt: off
@njit(**INNER)
def add_up(stage: int, h: float, first: int, last: int, row: int, y: np.ndarray):
    """States from ``first`` to ``last`` where a stage takes its slope, or those at the step's end, to a row."""
    apart()
    if stage == 1:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[0][0] * y[0, i])
    elif stage == 2:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[1][0] * y[0, i] + A[1][1] * y[1, i])
    elif stage == 3:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[2][0] * y[0, i] + A[2][1] * y[2, i])
    elif stage == 4:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[3][0] * y[0, i] + A[3][1] * y[2, i] + A[3][2] * y[3, i])
    elif stage == 5:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[4][0] * y[0, i] + A[4][1] * y[3, i] + A[4][2] * y[4, i])
    elif stage == 6:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[5][0] * y[0, i] + A[5][1] * y[3, i] + A[5][2] * y[4, i]
                + A[5][3] * y[5, i])
    elif stage == 7:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[6][0] * y[0, i] + A[6][1] * y[3, i] + A[6][2] * y[4, i]
                + A[6][3] * y[5, i] + A[6][4] * y[6, i])
    elif stage == 8:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[7][0] * y[0, i] + A[7][1] * y[3, i] + A[7][2] * y[4, i]
                + A[7][3] * y[5, i] + A[7][4] * y[6, i] + A[7][5] * y[7, i])
    elif stage == 9:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[8][0] * y[0, i] + A[8][1] * y[3, i] + A[8][2] * y[4, i]
                + A[8][3] * y[5, i] + A[8][4] * y[6, i] + A[8][5] * y[7, i] + A[8][6] * y[8, i])
    elif stage == 10:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[9][0] * y[0, i] + A[9][1] * y[3, i] + A[9][2] * y[4, i]
                + A[9][3] * y[5, i] + A[9][4] * y[6, i] + A[9][5] * y[7, i] + A[9][6] * y[8, i] + A[9][7] * y[9, i])
    elif stage == 11:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[10][0] * y[0, i] + A[10][1] * y[3, i] + A[10][2] * y[4, i]
                + A[10][3] * y[5, i] + A[10][4] * y[6, i] + A[10][5] * y[7, i] + A[10][6] * y[8, i]
                + A[10][7] * y[9, i] + A[10][8] * y[10, i])
    else:
        for i in range(first, last):
            y[row, i] = y[BEGIN, i] + h * (A[11][0] * y[0, i] + A[11][1] * y[5, i] + A[11][2] * y[6, i]
                + A[11][3] * y[7, i] + A[11][4] * y[8, i] + A[11][5] * y[9, i] + A[11][6] * y[10, i]
                + A[11][7] * y[11, i])
# fmt: on


@njit(**INNER)
def step(m: np.ndarray, d: np.ndarray, h: float, scratch: np.ndarray) -> float:
    """Step over ``h`` from row ``BEGIN``, whose slope is row 0: the state to ``END``, its slope behind the stages.

    Returns the force of the rock at the end of the step in N.
    """
    apart()
    rock, tally, moving = 0.0, int(m[TALLY]), int(m[MOVING])
    whole = tally + 4 + int(m[EFFECTS])
    for i in range(moving, tally):
        scratch[INNER_STATE, i] = scratch[END, i] = scratch[BEGIN, i]
    for stage in range(1, STAGES + 1):
        # energies enter nothing, so they are counted only in the end
        row = INNER_STATE if stage < STAGES else END
        add_up(stage, h, FIRST_SLOPE, moving, row, scratch)
        if stage == STAGES:
            add_up(stage, h, tally, whole, row, scratch)
        rock = rates(m, d, h * NODES[stage], scratch[row], scratch[stage], scratch[PUSH])
    return rock


# fmt: off
@njit(**INNER)
def step_error(m: np.ndarray, h: float, rtol: float, scratch: np.ndarray) -> float:
    """Error of the step last taken over what is tolerated; at most 1 is good.

    Largest over the states and not their mean, so that states at rest do not count.
    """
    y, sizes, one, two = scratch, int(m[SIZES_AT]), 0.0, 0.0
    for i in range(int(m[MOVING])):
        fifth = (E5[0] * y[0, i] + E5[1] * y[5, i] + E5[2] * y[6, i] + E5[3] * y[7, i] + E5[4] * y[8, i]
            + E5[5] * y[9, i] + E5[6] * y[10, i] + E5[7] * y[11, i])
        third = (E3[0] * y[0, i] + E3[1] * y[5, i] + E3[2] * y[6, i] + E3[3] * y[7, i] + E3[4] * y[8, i]
            + E3[5] * y[9, i] + E3[6] * y[10, i] + E3[7] * y[11, i])
        scale = rtol * (m[sizes + i] + max(abs(y[BEGIN, i]), abs(y[END, i])))
        if not (abs(fifth) < math.inf and abs(third) < math.inf):
            return math.inf
        one, two = max(one, abs(fifth) / scale), max(two, abs(third) / scale)
    return 0.0 if one == 0.0 else h * one * one / math.sqrt(one * one + 0.01 * two * two)


@njit(**INNER)
def follow(m: np.ndarray, d: np.ndarray, h: float, scratch: np.ndarray):
    """Prepare :func:`inside` for the step just taken over ``h``."""
    apart()
    y, tally, moving = scratch, int(m[TALLY]), int(m[MOVING])
    for stage in range(3):
        for i in range(moving):
            if stage == 0:
                more = (B[0][0] * y[0, i] + B[0][1] * y[6, i] + B[0][2] * y[7, i] + B[0][3] * y[8, i]
                    + B[0][4] * y[9, i] + B[0][5] * y[10, i] + B[0][6] * y[11, i] + B[0][7] * y[12, i])
            elif stage == 1:
                more = (B[1][0] * y[0, i] + B[1][1] * y[5, i] + B[1][2] * y[6, i] + B[1][3] * y[7, i]
                    + B[1][4] * y[10, i] + B[1][5] * y[11, i] + B[1][6] * y[12, i] + B[1][7] * y[13, i])
            else:
                more = (B[2][0] * y[0, i] + B[2][1] * y[5, i] + B[2][2] * y[6, i] + B[2][3] * y[7, i]
                    + B[2][4] * y[8, i] + B[2][5] * y[12, i] + B[2][6] * y[13, i] + B[2][7] * y[14, i])
            y[INNER_STATE, i] = y[BEGIN, i] + h * more
        rates(m, d, h * EXTRA_NODES[stage], y[INNER_STATE], y[STAGES + 1 + stage], y[PUSH])
    for j in range(moving + 4 + int(m[EFFECTS])):
        i = j if j < moving else j - moving + tally
        change = y[END, i] - y[BEGIN, i]
        y[WAY, i] = change
        y[WAY + 1, i] = h * y[0, i] - change
        y[WAY + 2, i] = 2.0 * change - h * (y[STAGES, i] + y[0, i])
        y[WAY + 3, i] = h * (C[0][0] * y[0, i] + C[0][1] * y[5, i] + C[0][2] * y[6, i] + C[0][3] * y[7, i]
            + C[0][4] * y[8, i] + C[0][5] * y[9, i] + C[0][6] * y[10, i] + C[0][7] * y[11, i] + C[0][8] * y[12, i]
            + C[0][9] * y[13, i] + C[0][10] * y[14, i] + C[0][11] * y[15, i])
        y[WAY + 4, i] = h * (C[1][0] * y[0, i] + C[1][1] * y[5, i] + C[1][2] * y[6, i] + C[1][3] * y[7, i]
            + C[1][4] * y[8, i] + C[1][5] * y[9, i] + C[1][6] * y[10, i] + C[1][7] * y[11, i] + C[1][8] * y[12, i]
            + C[1][9] * y[13, i] + C[1][10] * y[14, i] + C[1][11] * y[15, i])
        y[WAY + 5, i] = h * (C[2][0] * y[0, i] + C[2][1] * y[5, i] + C[2][2] * y[6, i] + C[2][3] * y[7, i]
            + C[2][4] * y[8, i] + C[2][5] * y[9, i] + C[2][6] * y[10, i] + C[2][7] * y[11, i] + C[2][8] * y[12, i]
            + C[2][9] * y[13, i] + C[2][10] * y[14, i] + C[2][11] * y[15, i])
        y[WAY + 6, i] = h * (C[3][0] * y[0, i] + C[3][1] * y[5, i] + C[3][2] * y[6, i] + C[3][3] * y[7, i]
            + C[3][4] * y[8, i] + C[3][5] * y[9, i] + C[3][6] * y[10, i] + C[3][7] * y[11, i] + C[3][8] * y[12, i]
            + C[3][9] * y[13, i] + C[3][10] * y[14, i] + C[3][11] * y[15, i])
# fmt: on


@njit(**INNER)
def inside(count: int, share: float, scratch: np.ndarray, row: int):
    """The first ``count`` states at a share of the step that was prepared by :func:`follow`, to a row."""
    for i in range(count):
        scratch[row, i] = inside_one(i, share, scratch)


@njit(**INLINED)
def inside_one(i: int, share: float, scratch: np.ndarray) -> float:
    """One state at a share of the step that was prepared by :func:`follow`."""
    rest = 1.0 - share
    total = (scratch[WAY + 6, i] * share + scratch[WAY + 5, i]) * rest
    total = ((total + scratch[WAY + 4, i]) * share + scratch[WAY + 3, i]) * rest
    total = ((total + scratch[WAY + 2, i]) * share + scratch[WAY + 1, i]) * rest
    return scratch[BEGIN, i] + (total + scratch[WAY, i]) * share
