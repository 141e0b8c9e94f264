"""The explicit Runge-Kutta pair of order 8 by Dormand and Prince, with dense output.

It serves tight tolerances and loose ones alike: at a relative error of 1e-6 a pair of order 5 takes 50 steps of six
stages a period, this one 16 of twelve. A step leaves all of its slopes in working memory. What lies inside it is read
off its polynomial: events are found on it, samples are taken from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from scipy.integrate import DOP853

from drillenv.dynamics.compiled import INLINED, INNER, apart, constants
from drillenv.dynamics.hybrid.vector_field import (
    CORNERS,
    EFFECTS,
    LAW_MEMORY,
    MOVING,
    ON_ROCKS,
    SIZES_AT,
    TALLY,
    Model,
    field,
)

# E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, Springer 1993, Sec. II.5, II.6 and
# II.10. Rows of the tableau say what slopes weigh: stages 1 to 11, the result, and three stages more for states inside
# the step; from HIGHER on the four highest powers of the polynomial; the errors of order 5 and 3.
_TABLEAU = np.zeros((22, 16))
_TABLEAU[:12, :12], _TABLEAU[12, :12], _TABLEAU[13:16] = DOP853.A, DOP853.B, DOP853.A_EXTRA
_TABLEAU[16:20], _TABLEAU[20, :13], _TABLEAU[21, :13] = DOP853.D, DOP853.E5, DOP853.E3
HIGHER, ERROR_5, ERROR_3 = constants(16, 20, 21)
NODES = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])

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
(NONE,) = constants(32)
"""zeros."""
ROWS = 33


def make_scratch(m: Model) -> np.ndarray:
    """Fresh working memory for a model."""
    # states are added up by fours
    return np.zeros((ROWS, max(m.tally + 7 + m.effects, ON_ROCKS + m.effects, CORNERS + LAW_MEMORY * len(m.laws))))


def _weigh(typingctx, which, h, base, row, first, y):
    """Four states, the first and those behind it: ``y[row] = y[base] + h * sum of weight * y[slope]``.

    The weights are constants of the code, and the four numbers one vector: left to the compiler, the same loops take
    twice the time, since it cannot know that rows do not overlap.
    """

    def codegen(context, builder, signature, args):
        which, h, base, row, first, y = args
        array, four = make_array(signature.args[5])(context, builder, y), ir.VectorType(ir.DoubleType(), 4)
        stride, index = builder.extract_value(array.strides, 0), which.type
        start = builder.ptrtoint(builder.gep(array.data, [first]), index)
        fma = get_or_insert_function(builder.module, ir.FunctionType(four, [four] * 3), "llvm.fma.v4f64")
        scale = ir.Constant(four, ir.Undefined)
        for k in range(4):
            scale = builder.insert_element(scale, h, ir.IntType(32)(k))

        def place(at):
            return builder.inttoptr(builder.add(start, builder.mul(at, stride)), four.as_pointer())

        end = builder.append_basic_block()
        switch = builder.switch(which, end)
        for code, weights in enumerate(_TABLEAU):
            block = builder.append_basic_block()
            switch.add_case(index(code), block)
            builder.position_at_end(block)
            total = four([0.0] * 4)
            for slope in np.flatnonzero(weights).tolist():
                slopes = builder.load(place(index(slope)), align=8)
                total = builder.call(fma, (four([float(weights[slope])] * 4), slopes, total))
            total = builder.call(fma, (scale, total, builder.load(place(base), align=8)))
            builder.store(total, place(row), align=8)
            builder.branch(end)
        builder.position_at_end(end)
        return context.get_dummy_value()

    return types.void(which, h, base, row, first, y), codegen


weigh: Callable[..., Any] = intrinsic(_weigh)  # pyright: ignore[reportAssignmentType]


@njit(**INNER)
def take_stages(m: np.ndarray, d: np.ndarray, h: float, first: int, last: int, scratch: np.ndarray) -> float:
    """Slopes from ``first`` to ``last`` of a step over ``h``; returns the force of the rock in N at the last."""
    apart()
    y, rock, tally, moving = scratch, 0.0, int(m[TALLY]), int(m[MOVING])
    for stage in range(first, last):
        # energies enter nothing, so they are counted only in the end
        row, count = (END, tally + 4 + int(m[EFFECTS])) if stage == STAGES else (INNER_STATE, moving)
        for i in range(0, count, 4):
            weigh(stage, h, BEGIN, row, i, y)
        rock = field(m, d, h * NODES[stage], y[row], y[stage], y[PUSH])
    return rock


@njit(**INNER)
def step(m: np.ndarray, d: np.ndarray, h: float, scratch: np.ndarray) -> float:
    """Step over ``h`` from row ``BEGIN``, whose slope is row 0: the state to ``END``, its slope behind the stages.

    Returns the force of the rock at the end of the step in N.
    """
    apart()
    for i in range(int(m[MOVING]), int(m[TALLY])):
        scratch[INNER_STATE, i] = scratch[BEGIN, i]
    return take_stages(m, d, h, FIRST_SLOPE + 1, STAGES + 1, scratch)


@njit(**INNER)
def step_error(m: np.ndarray, h: float, rtol: float, scratch: np.ndarray) -> float:
    """Error of the step last taken over what is tolerated; at most 1 is good.

    Largest over the states and not their mean, so that states at rest do not count.
    """
    y, sizes, one, two = scratch, int(m[SIZES_AT]), 0.0, 0.0
    for i in range(0, int(m[MOVING]), 4):
        weigh(ERROR_5, 1.0, NONE, SPARE, i, y)
        weigh(ERROR_3, 1.0, NONE, SPARE_SLOPE, i, y)
        for k in range(i, min(i + 4, int(m[MOVING]))):
            fifth, third = abs(y[SPARE, k]), abs(y[SPARE_SLOPE, k])
            scale = rtol * (m[sizes + k] + max(abs(y[BEGIN, k]), abs(y[END, k])))
            if not (fifth < math.inf and third < math.inf):
                return math.inf
            one, two = max(one, fifth / scale), max(two, third / scale)
    return 0.0 if one == 0.0 else h * one * one / math.sqrt(one * one + 0.01 * two * two)


@njit(**INNER)
def follow(m: np.ndarray, d: np.ndarray, h: float, scratch: np.ndarray) -> None:
    """Prepare :func:`inside` for the step just taken over ``h``."""
    apart()
    y, count = scratch, int(m[TALLY]) + 4 + int(m[EFFECTS])
    take_stages(m, d, h, STAGES + 1, STAGES + 4, scratch)
    for i in range(0, count, 4):
        for j in range(i, i + 4):
            change = y[END, j] - y[BEGIN, j]
            y[WAY, j] = change
            y[WAY + 1, j] = h * y[0, j] - change
            y[WAY + 2, j] = 2.0 * change - h * (y[STAGES, j] + y[0, j])
        for power in range(4):
            weigh(HIGHER + power, h, NONE, WAY + 3 + power, i, y)


@njit(**INNER)
def inside(count: int, share: float, scratch: np.ndarray, row: int) -> None:
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


@njit(**INLINED)
def inside_with_rate(i: int, share: float, h: float, scratch: np.ndarray) -> tuple[float, float]:
    """One state and its time derivative at a share of the step over ``h`` that was prepared by :func:`follow`."""
    total, slope, rest = 0.0, 0.0, 1.0 - share
    for power in range(6, -1, -1):
        total += scratch[WAY + power, i]
        if power % 2 == 0:
            slope, total = slope * share + total, total * share
        else:
            slope, total = slope * rest - total, total * rest
    return scratch[BEGIN, i] + total, slope / h
