"""The general engine: any contact law and any effects, by an explicit Runge-Kutta pair of order 8, event-accurate.

State of the rig, in SI: ``y = X1 - X2``, the speeds ``v1`` and ``v2``, ``w``, the indenter's place behind its moving
origin ``O``, and ``u``, the displacement of the rock's face where a mount lets it move: ``X2 = O + w + u``. As in
:mod:`drillenv.dynamics.flow` the origin is Xf out of contact and while unloading, and Xp while loading, so nothing in
the state drifts. Behind these five stand the extra states of the chosen effects and then the energies moved: by the
drive, the static force, the damper, the rock law and each effect. All are integrated alike.

    y'  = v1 - v2
    v1' = (F_b - k y - c y' + forces of effects) / m1
    v2' = (F_a sin(theta) + k y + c y' - R + forces of effects) / m2,    theta' = 2 pi f
    w'  = v2 - u'

A step is tried without regard to switches, then searched for the first one: the quintic through place, speed and
acceleration at both ends says where the switch surface is reached or nearly reached inside. Whether it is, and when, is
decided on the solution itself: the step is taken again from its start, shorter, until it ends on the switch. So the
state at a switch has the full order, and a contact that begins and ends inside one step is not missed. Samples are
taken the same way, so the motion does not depend on the sample rate.
"""

# Numba hands an intrinsic its first argument itself, which type checkers do not know.
# pyright: reportCallIssue=false

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import cfunc, njit, types
from numba.extending import intrinsic

from drillenv.checks import InputError, number
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.effects import ON_INDENTER, ON_ROCK, ON_SHAKER, Chosen, Moment
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

# Where things stand in a state.
Y, V1, V2, W, U, OWN = range(6)
"""y, v1, v2, w, u, and the first extra state of an effect."""
BY_DRIVE, BY_STATIC, IN_DAMPER, IN_ROCK, BY_EFFECTS = range(5)
"""Energies, counted from ``Model.tally``."""

# How a run of the kernel ends.
DONE, STEPS_TOO_SHORT, SWITCHES_TOO_DENSE = range(3)

# --------------------------------------------------------------------------------------------------------------------
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
)
_WEIGHTS = (
    0.054293734116568765, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199,
    -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
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
    0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0,
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
LAST_USES = np.array([0, 5, 6, 7, 8, 9, 10, 11])
"""The stages that enter the result and the two error estimates."""
LAST_WEIGHTS, ERROR_3, ERROR_5 = np.array(_WEIGHTS), np.array(_ERROR_3), np.array(_ERROR_5)


# --------------------------------------------------------------------------------------------------------------------
# Calling the functions of effects. Each is compiled on its own to a C function; the kernel gets addresses. So the
# kernel is compiled once, and not again for every set of effects.

MOMENT = types.NamedTuple([types.int64 if name == "regime" else types.float64 for name in Moment._fields], Moment)
_NUMBERS = types.CPointer(types.float64)
TERM = types.void(MOMENT, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)
SHAPE = types.float64(types.float64, types.int64, _NUMBERS, _NUMBERS)
SWITCHED = types.void(types.int64, types.int64, _NUMBERS, _NUMBERS)


@functools.cache
def _compiled(function: Callable, signature):
    """A function of an effect as a C function, kept alive for as long as the process."""
    try:
        return cfunc(signature, cache=True, error_model="numpy")(function)
    except RuntimeError:
        # a function typed at a prompt has no file to be cached beside
        return cfunc(signature, error_model="numpy")(function)


def address_of(function: Callable | None, signature) -> int:
    """The address to call a function of an effect at; 0 where there is none."""
    return 0 if function is None else int(_compiled(function, signature).address or 0)


def _call(context, builder, signature, address, arguments):
    """Call the C function of this signature at this address."""
    kinds = [context.get_value_type(kind) for kind in signature.args]
    result = ir.VoidType() if signature.return_type == types.void else context.get_value_type(signature.return_type)
    pointer = builder.inttoptr(address, ir.FunctionType(result, kinds).as_pointer())
    return builder.call(pointer, arguments)


def _place(context, builder, kind, array, offset):
    """Pointer to the element ``offset`` of an array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [offset])


@intrinsic
def call_term(typingctx, address, now, state, rates, first, parameters, at, push):
    """Call ``term(now, state[first:], parameters[at:], push, rates[first:])``."""

    def codegen(context, builder, signature, values):
        address, now, state, rates, first, parameters, at, push = values
        _, _, state_kind, rates_kind, _, parameters_kind, _, push_kind = signature.args
        zero = context.get_constant(types.intp, 0)
        own = _place(context, builder, state_kind, state, first)
        p = _place(context, builder, parameters_kind, parameters, at)
        force = _place(context, builder, push_kind, push, zero)
        own_rates = _place(context, builder, rates_kind, rates, first)
        _call(context, builder, TERM, address, [now, own, p, force, own_rates])
        return context.get_dummy_value()

    return types.void(address, MOMENT, state, rates, first, parameters, at, push), codegen


@intrinsic
def call_shape(typingctx, address, depth, regime, state, first, parameters, at):
    """Call ``shape(depth, regime, state[first:], parameters[at:])``."""

    def codegen(context, builder, signature, values):
        address, depth, regime, state, first, parameters, at = values
        own = _place(context, builder, signature.args[3], state, first)
        p = _place(context, builder, signature.args[5], parameters, at)
        return _call(context, builder, SHAPE, address, [depth, regime, own, p])

    return types.float64(address, types.float64, types.int64, state, first, parameters, at), codegen


@intrinsic
def call_switched(typingctx, address, before, after, state, first, parameters, at):
    """Call ``switched(before, after, state[first:], parameters[at:])``."""

    def codegen(context, builder, signature, values):
        address, before, after, state, first, parameters, at = values
        own = _place(context, builder, signature.args[3], state, first)
        p = _place(context, builder, signature.args[5], parameters, at)
        _call(context, builder, SWITCHED, address, [before, after, own, p])
        return context.get_dummy_value()

    return types.void(address, types.int64, types.int64, state, first, parameters, at), codegen


# --------------------------------------------------------------------------------------------------------------------
# The equations.


# Columns of the table of effects: addresses of its three functions (0 for none), 1 where its term needs the whole force
# of the rock, the indices of its first extra state and first parameter, 1 where the former is the speed of the face.
TERM_AT, SHAPE_AT, SWITCHED_AT, LAST, FIRST, AT, FACE = range(7)


class Model(NamedTuple):
    """A rig on a rock at a setting with effects, made ready for the kernels."""

    m1: float
    m2: float
    k: float
    c: float
    kl: float
    ku: float
    omega: float
    drive: float
    """F_a in N."""
    static: float
    """F_b in N."""
    effects: np.ndarray
    """(effects, 7), see the columns below; those that need the whole force of the rock stand at the end."""
    parameters: np.ndarray
    sizes: np.ndarray
    """(dynamic states,) absolute tolerance over relative tolerance."""
    tally: int
    """Index of the first energy in the state."""
    bent: bool
    """Whether an effect bends the rock law."""
    rated: bool
    """Whether the force of the rock may peak before the turn."""
    longest: float
    """Longest step in s."""


@njit(cache=True, nogil=True, error_model="numpy")
def bend(model: Model, regime: int, depth: float, z: np.ndarray) -> float:
    """The depth in m as effects bend it: the force of the rock law over its stiffness."""
    if model.bent:
        table = model.effects
        for i in range(table.shape[0]):
            if table[i, SHAPE_AT] != 0:
                first, at = table[i, FIRST], table[i, AT]
                depth = call_shape(table[i, SHAPE_AT], depth, regime, z, first, model.parameters, at)
    return depth


@njit(cache=True, nogil=True, error_model="numpy")
def law_force(model: Model, regime: int, w: float, z: np.ndarray) -> float:
    """Force of the rock law in N at depth ``w``; negative behind the face, where a trial step may end."""
    if regime == FREE:
        return 0.0
    return (model.kl if regime == LOADING else model.ku) * bend(model, regime, w, z)


@njit(cache=True, nogil=True, error_model="numpy")
def law_depth(model: Model, regime: int, force: float, z: np.ndarray) -> float:
    """Depth in m at which the rock law of a regime has this force."""
    goal = force / (model.kl if regime == LOADING else model.ku)
    if not model.bent or goal <= 0.0:
        return goal
    low, under, high = 0.0, -goal, goal
    over = bend(model, regime, high, z) - goal
    while over < 0.0:
        low, under, high = high, over, 2.0 * high
        over = bend(model, regime, high, z) - goal
    # regula falsi with the Illinois rule, and a bisection now and then in case it creeps
    for turn in range(200):
        guess = 0.5 * (low + high)
        if turn % 4 < 3 and over > under:
            guess = (low * over - high * under) / (over - under)
        if not low < guess < high:
            break
        value = bend(model, regime, guess, z) - goal
        if value == 0.0:
            return guess
        if value > 0.0:
            high, over, under = guess, value, 0.5 * under
        else:
            low, under, over = guess, value, 0.5 * over
    return low if abs(bend(model, regime, low, z) - goal) < abs(bend(model, regime, high, z) - goal) else high


@njit(cache=True, nogil=True, error_model="numpy")
def face_speed(model: Model, z: np.ndarray) -> float:
    """Speed of the rock's face in m/s."""
    speed = 0.0
    table = model.effects
    for i in range(table.shape[0]):
        if table[i, FACE] == 1:
            speed += z[int(table[i, FIRST])]
    return speed


@njit(cache=True, nogil=True, error_model="numpy")
def slope(model: Model, time: float, theta: float, regime: int, z: np.ndarray, dz: np.ndarray, push: np.ndarray):
    """Write the time derivative of the state to ``dz``; return the force of the rock in N."""
    y, v1, v2, w = z[Y], z[V1], z[V2], z[W]
    face = face_speed(model, z)
    closing, into = v1 - v2, v2 - face
    drive = model.drive * math.sin(theta)
    spring, damper = model.k * y, model.c * closing
    law = law_force(model, regime, w, z)
    on_shaker, on_indenter, on_rock = 0.0, 0.0, 0.0
    rock, tally = law, model.tally
    settled = False
    table = model.effects
    for i in range(table.shape[0]):
        if table[i, LAST] == 1 and not settled:
            rock = whole_force(law, on_rock)
            settled = True
        push[0], push[1], push[2] = 0.0, 0.0, 0.0
        if table[i, TERM_AT] != 0:
            now = Moment(
                time, theta, model.omega, y, closing, v1, v2, w, into, z[U], rock, regime, model.drive, model.static,
                model.m1, model.m2, model.k, model.c, model.kl, model.ku,
            )  # fmt: skip
            first, at = table[i, FIRST], table[i, AT]
            call_term(table[i, TERM_AT], now, z, dz, first, model.parameters, at, push)
        if regime == FREE:
            push[ON_ROCK] = 0.0
        on_shaker += push[ON_SHAKER]
        on_indenter += push[ON_INDENTER]
        on_rock += push[ON_ROCK]
        dz[tally + BY_EFFECTS + i] = push[ON_SHAKER] * v1 + push[ON_INDENTER] * v2
        push[3 + i] = push[ON_ROCK]
    rock = whole_force(law, on_rock)
    # where the contact would pull, the effects on the rock move only what brings its force down to zero
    share = (rock - law) / on_rock if on_rock != 0.0 else 0.0
    for i in range(table.shape[0]):
        dz[tally + BY_EFFECTS + i] -= share * push[3 + i] * into
        if table[i, FACE] == 1:
            dz[tally + BY_EFFECTS + i] -= rock * z[table[i, FIRST]]
    dz[Y] = closing
    dz[V1] = (model.static - spring - damper + on_shaker) / model.m1
    dz[V2] = (drive + spring + damper - rock + on_indenter) / model.m2
    dz[W] = into
    dz[U] = face
    dz[tally + BY_DRIVE] = drive * v2
    dz[tally + BY_STATIC] = model.static * v1
    dz[tally + IN_DAMPER] = damper * closing
    dz[tally + IN_ROCK] = law * into
    return rock


@njit(cache=True, nogil=True, error_model="numpy")
def whole_force(law: float, added: float) -> float:
    """The contact never pulls. Behind the face (law below 0) a trial step goes on smoothly instead."""
    whole = law + added
    return 0.0 if law > 0.0 and whole < 0.0 else whole


# --------------------------------------------------------------------------------------------------------------------
# One step.


class Scratch(NamedTuple):
    """Working memory of the kernels, so that their loops allocate nothing."""

    stages: np.ndarray
    """(13, states): the last row is the slope at the end of the step last taken."""
    inner: np.ndarray
    """(states,) inside a step."""
    end: np.ndarray
    """(states,) at the end of the step last taken."""
    trial: np.ndarray
    """(states,) at the end of the trial step."""
    trial_slope: np.ndarray
    start_slope: np.ndarray
    push: np.ndarray
    """(3 + effects,) forces of one effect, then what each adds to the rock."""


@njit(cache=True, nogil=True)
def make_scratch(states: int, effects: int) -> Scratch:
    """Fresh working memory."""
    return Scratch(
        np.zeros((13, states)),
        np.zeros(states),
        np.zeros(states),
        np.zeros(states),
        np.zeros(states),
        np.zeros(states),
        np.zeros(3 + effects),
    )


@njit(cache=True, nogil=True)
def copy(source: np.ndarray, target: np.ndarray):
    """Copy a state. Numba takes seconds to compile the same in slices."""
    for i in range(source.size):
        target[i] = source[i]


@njit(cache=True, nogil=True, error_model="numpy")
def step(model: Model, time: float, theta: float, regime: int, z: np.ndarray, h: float, scratch: Scratch):
    """Step from ``z``, whose slope is ``stages[0]``, over ``h``: the state to ``end``, its slope to ``stages[12]``.

    Returns the force of the rock at the end of the step in N.
    """
    stages, inner, end = scratch.stages, scratch.inner, scratch.end
    dynamic = model.tally
    for stage in range(1, 12):
        for i in range(dynamic):
            total = 0.0
            for use in range(STAGE_START[stage - 1], STAGE_START[stage]):
                total += STAGE_WEIGHTS[use] * stages[STAGE_USES[use], i]
            inner[i] = z[i] + h * total
        shift = h * NODES[stage]
        slope(model, time + shift, theta + model.omega * shift, regime, inner, stages[stage], scratch.push)
    for i in range(z.size):
        total = 0.0
        for use in range(LAST_USES.size):
            total += LAST_WEIGHTS[use] * stages[LAST_USES[use], i]
        end[i] = z[i] + h * total
    return slope(model, time + h, theta + model.omega * h, regime, end, stages[12], scratch.push)


@njit(cache=True, nogil=True, error_model="numpy")
def step_error(model: Model, z: np.ndarray, h: float, rtol: float, scratch: Scratch) -> float:
    """Error of the step last taken over what is tolerated; at most 1 is good.

    Largest over the states and not their mean, so that states at rest do not count.
    """
    stages, end = scratch.stages, scratch.end
    third, fifth = 0.0, 0.0
    for i in range(model.tally):
        low, high = 0.0, 0.0
        for use in range(LAST_USES.size):
            low += ERROR_3[use] * stages[LAST_USES[use], i]
            high += ERROR_5[use] * stages[LAST_USES[use], i]
        scale = rtol * (model.sizes[i] + max(abs(z[i]), abs(end[i])))
        if not (abs(low) < math.inf and abs(high) < math.inf):
            return math.inf
        third, fifth = max(third, abs(low) / scale), max(fifth, abs(high) / scale)
    if third == 0.0 and fifth == 0.0:
        return 0.0
    return h * fifth * fifth / math.sqrt(fifth * fifth + 0.01 * third * third)


@njit(cache=True, nogil=True)
def borrow_scratch(scratch: Scratch) -> Scratch:
    """The same working memory, its references not counted."""
    return Scratch(
        borrowed(scratch.stages),
        borrowed(scratch.inner),
        borrowed(scratch.end),
        borrowed(scratch.trial),
        borrowed(scratch.trial_slope),
        borrowed(scratch.start_slope),
        borrowed(scratch.push),
    )


@njit(cache=True, nogil=True)
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
        model.rated,
        model.longest,
    )


# --------------------------------------------------------------------------------------------------------------------
# Finding the switch inside a step. The motion toward a switch is watched as a function that rises through zero: the
# place w in free flight (level 0), the speed -w' while loading and w' while unloading (level 1).


@njit(cache=True, nogil=True, error_model="numpy")
def watched(model: Model, z: np.ndarray, dz: np.ndarray, level: int) -> float:
    """w, w' or w'' by level 0, 1 or 2."""
    if level == 0:
        return z[W]
    if level == 1:
        return dz[W]
    second = dz[V2]
    table = model.effects
    for i in range(table.shape[0]):
        if table[i, FACE] == 1:
            second -= dz[table[i, FIRST]]
    return second


@njit(cache=True, nogil=True, error_model="numpy")
def root(model, time, theta, regime, z, scratch, level, sign, deflate, low, high, guess, h) -> float:
    """Duration of the step whose end has ``sign * watched`` rising through zero (falling for a negative slope).

    Newton's method on the solution itself, kept inside [low, high] by bisection; at ``high`` the function is above
    zero and at ``low`` below, or the other way round as ``sign`` says. ``deflate`` divides by the duration, which takes
    out the zero at the step's start. The state at the root is left in ``scratch.end``.
    """
    s = guess if low < guess < high else 0.5 * (low + high)
    last_s, last_value = -1.0, 0.0
    for _ in range(100):
        step(model, time, theta, regime, z, s, scratch)
        value = sign * watched(model, scratch.end, scratch.stages[12], level)
        if value == 0.0:
            return s
        if level < 2:
            rate = sign * watched(model, scratch.end, scratch.stages[12], level + 1)
        elif last_s >= 0.0:
            rate = (value - last_value) / (s - last_s)
        else:
            rate = 0.0
        last_s, last_value = s, value
        if deflate:
            value, rate = value / s, (rate - value / s) / s
        if value < 0.0:
            low = s
        else:
            high = s
        new = s - value / rate
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) <= 1e-15 * h:
            return s
        s = new
    return s


@njit(cache=True, nogil=True)
def quintic(start: float, speed: float, bend: float, end: float, end_speed: float, end_bend: float):
    """Coefficients of the quintic on [0, 1] with these values, slopes and second derivatives at its ends."""
    c2 = 0.5 * bend
    d0 = end - start - speed - c2
    d1 = end_speed - speed - bend
    d2 = 0.5 * (end_bend - bend)
    return start, speed, c2, 10 * d0 - 4 * d1 + d2, -15 * d0 + 7 * d1 - 2 * d2, 6 * d0 - 3 * d1 + d2


@njit(cache=True, nogil=True)
def quintic_at(c, s: float, level: int) -> float:
    """The quintic or its first or second derivative."""
    if level == 0:
        return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5]))))
    if level == 1:
        return c[1] + s * (2 * c[2] + s * (3 * c[3] + s * (4 * c[4] + s * 5 * c[5])))
    return 2 * c[2] + s * (6 * c[3] + s * (12 * c[4] + s * 20 * c[5]))


@njit(cache=True, nogil=True)
def quintic_root(c, level: int, low: float, high: float) -> float:
    """A zero of the quintic or a derivative between two places where its signs differ, good enough to start from."""
    below = quintic_at(c, low, level) < 0.0
    for _ in range(24):
        middle = 0.5 * (low + high)
        if (quintic_at(c, middle, level) < 0.0) == below:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


PARTS = 12
"""Into how many parts a step is cut when it is searched for a switch."""
DOUBT = 1e-3
"""How near a maximum of the quintic must come to the switch, over its own size, for the solution to be asked."""


@njit(cache=True, nogil=True, error_model="numpy")
def first_rise(model, time, theta, regime, z, h, scratch) -> float:
    """Duration after which the watched function first rises through zero within the trial step; -1 if it does not.

    The state there is left in ``scratch.end``.
    """
    level = 0 if regime == FREE else 1
    sign = -1.0 if regime == LOADING else 1.0
    start_slope, trial, trial_slope = scratch.start_slope, scratch.trial, scratch.trial_slope
    c = quintic(
        z[W],
        h * watched(model, z, start_slope, 1),
        h * h * watched(model, z, start_slope, 2),
        trial[W],
        h * watched(model, trial, trial_slope, 1),
        h * h * watched(model, trial, trial_slope, 2),
    )
    deflate = watched(model, z, start_slope, level) == 0.0
    size = max(abs(quintic_at(c, 0.0, level)), abs(quintic_at(c, 0.5, level)), abs(quintic_at(c, 1.0, level)))
    right, right_slope = sign * quintic_at(c, 0.0, level), sign * quintic_at(c, 0.0, level + 1)
    for part in range(1, PARTS + 1):
        a, b = (part - 1) / PARTS, part / PARTS
        left, left_slope = right, right_slope
        right, right_slope = sign * quintic_at(c, b, level), sign * quintic_at(c, b, level + 1)
        if part == PARTS:
            right = sign * watched(model, trial, trial_slope, level)
        reached = -1.0
        if left_slope > 0.0 and right_slope < 0.0:
            top = quintic_root(c, level + 1, a, b)
            if sign * quintic_at(c, top, level) > -DOUBT * size:
                # the maximum of the watched function: its slope falls through zero, so the sign is turned round
                reached = root(
                    model, time, theta, regime, z, scratch, level + 1, -sign, False, a * h, b * h, top * h, h
                )
                if sign * watched(model, scratch.end, scratch.stages[12], level) <= 0.0:
                    reached = -1.0
        if reached < 0.0 and right > 0.0:
            reached = b * h
            if part < PARTS:
                step(model, time, theta, regime, z, reached, scratch)
                if sign * watched(model, scratch.end, scratch.stages[12], level) <= 0.0:
                    reached = -1.0
        if reached >= 0.0:
            top = min(b, reached / h)
            guess = top
            if sign * quintic_at(c, top, level) > 0.0 and left < 0.0:
                guess = quintic_root(c, level, a, top)
            return root(model, time, theta, regime, z, scratch, level, sign, deflate, 0.0, reached, guess * h, h)
    return -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def find_switch(model, time, theta, regime, z, h, scratch):
    """The first switch within the trial step: (duration, next regime), or (h, regime) where there is none.

    The state there is left in ``scratch.end``.
    """
    s = first_rise(model, time, theta, regime, z, h, scratch)
    if regime == FREE:
        if s >= 0.0:
            return s, LOADING
    elif regime == LOADING:
        if s >= 0.0:
            return s, UNLOADING
    else:
        place = scratch.end[W] if s >= 0.0 else scratch.trial[W]
        if place <= 0.0:
            # released on the way there; unloading moves outward only, so there is one crossing
            high = s if s >= 0.0 else h
            guess = high - place / z[W] * high if z[W] == 0.0 else high * z[W] / (z[W] - place)
            s = root(model, time, theta, regime, z, scratch, 0, -1.0, z[W] == 0.0, 0.0, high, guess, h)
            return s, FREE
        if s >= 0.0:
            return s, LOADING
    copy(scratch.trial, scratch.end)
    return h, regime


@njit(cache=True, nogil=True, error_model="numpy")
def force_rate(model, time, theta, regime, z, dz, rock, h, scratch) -> float:
    """Rate of the rock's force along the motion in N/s, by a short difference."""
    delta = 1e-6 * h
    inner, work = scratch.inner, scratch.stages[11]
    for i in range(z.size):
        inner[i] = z[i] + delta * dz[i]
    ahead = slope(model, time + delta, theta + model.omega * delta, regime, inner, work, scratch.push)
    return (ahead - rock) / delta


@njit(cache=True, nogil=True, error_model="numpy")
def inner_peak(model, time, theta, regime, z, h, scratch) -> float:
    """Largest force of the rock inside a step of duration ``h`` in N; 0 where it rises or falls throughout.

    ``scratch.end`` is used up.
    """
    stages = scratch.stages
    rock = slope(model, time, theta, regime, z, stages[0], scratch.push)
    if force_rate(model, time, theta, regime, z, stages[0], rock, h, scratch) <= 0.0:
        return 0.0
    low, high, best = 0.0, h, 0.0
    for turn in range(30):
        s = h if turn == 0 else 0.5 * (low + high)
        rock = step(model, time, theta, regime, z, s, scratch)
        best = rock if turn == 0 else max(best, rock)
        rate = force_rate(model, time + s, theta + model.omega * s, regime, scratch.end, stages[12], rock, h, scratch)
        if turn == 0 and rate >= 0.0:
            return 0.0
        if rate > 0.0:
            low = s
        else:
            high = s
    return best


# --------------------------------------------------------------------------------------------------------------------
# The run.


@njit(cache=True, nogil=True)
def longer(table: np.ndarray) -> np.ndarray:
    """The same rows in twice the room."""
    result = np.zeros((2 * table.shape[0], table.shape[1]))
    for i in range(table.shape[0]):
        copy(table[i], result[i])
    return result


@njit(cache=True, nogil=True)
def add_exactly(total: float, carry: float, part: float):
    """Add to a sum kept as total and carry (Neumaier)."""
    new = total + part
    carry += (total - new) + part if abs(total) >= abs(part) else (part - new) + total
    return new, carry


SAMPLE_COLUMNS = 8
"""x1, x2, v1, v2, acceleration, force, penetration, regime; the extra states follow."""
IMPACT_COLUMNS = 5
"""Time, peak force, speed at contact, depth, time of contact."""
SWITCH_COLUMNS = 3
"""Time, regime before, regime after."""


@njit(cache=True, nogil=True, error_model="numpy")
def write_sample(model, regime, origin, carry, z, dz, rock, row):
    """One row of the samples."""
    x2 = origin + (carry + (z[W] + z[U]))
    front = z[W] - law_depth(model, UNLOADING, law_force(model, LOADING, z[W], z), z) if regime == LOADING else 0.0
    row[0], row[1], row[2], row[3] = x2 + z[Y], x2, z[V1], z[V2]
    row[4], row[5], row[6], row[7] = dz[V2], max(rock, 0.0), origin + (carry + front), regime
    for i in range(OWN, model.tally):
        row[SAMPLE_COLUMNS + i - OWN] = z[i]


@njit(cache=True, nogil=True, error_model="numpy")
def standing_switch(model: Model, regime: int, z: np.ndarray, dz: np.ndarray) -> int:
    """The regime that the state calls for: another one where it stands on a switch and is leaving its own."""
    into, turning = watched(model, z, dz, 1), watched(model, z, dz, 2)
    if regime == FREE and z[W] >= 0.0 and (into > 0.0 or (into == 0.0 and turning > 0.0)):
        return LOADING
    if regime == LOADING and into <= 0.0 and turning < 0.0:
        return UNLOADING
    if regime == UNLOADING and into >= 0.0 and turning > 0.0:
        return LOADING
    return regime


@njit(cache=True, nogil=True, error_model="numpy")
def change_regime(model: Model, before: int, after: int, z: np.ndarray) -> float:
    """Put the state, which stands on the switch, into its next regime. Returns by how much the origin moves, in m."""
    shift = 0.0
    if before == FREE or after == FREE:
        z[W] = 0.0
    else:
        # at rest on the face; the force goes on, so the depth is counted anew
        z[V2] = face_speed(model, z)
        depth = law_depth(model, after, law_force(model, before, z[W], z), z)
        shift = z[W] - depth
        z[W] = depth
    for i in range(model.effects.shape[0]):
        first, at = model.effects[i, FIRST], model.effects[i, AT]
        if model.effects[i, SWITCHED_AT] != 0:
            call_switched(model.effects[i, SWITCHED_AT], before, after, z, first, model.parameters, at)
    return shift


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(
    model: Model,
    phase: float,
    z: np.ndarray,
    regime: int,
    seconds: float,
    rate: float,
    samples: np.ndarray,
    rtol: float,
    scratch: Scratch,
) -> tuple:
    """Run for ``seconds`` from ``z``, which is left at the end.

    Fills ``samples`` (rows at 1 / rate from time 0 on). Returns (status, time reached, regime, origin, carry, phase
    reached, impacts, switches, counts of steps tried and rejected).
    """
    model, z, samples, scratch = borrow_model(model), borrowed(z), borrowed(samples), borrow_scratch(scratch)
    stages = scratch.stages
    impacts, switches = np.zeros((64, IMPACT_COLUMNS)), np.zeros((256, SWITCH_COLUMNS))
    impact_count, switch_count, sampled, tried, rejected, standing = 0, 0, 0, 0, 0, 0
    origin, carry = 0.0, 0.0
    speed, since, peak = 0.0, 0.0, 0.0
    # time is counted in whole periods and a rest, so that the phase keeps its digits
    period = 2.0 * math.pi / model.omega
    periods, rest = 0.0, 0.0
    trust = np.full(3, min(model.longest, 0.05 * math.sqrt(model.m2 / model.kl)))
    status = DONE

    rock = slope(model, 0.0, phase, regime, z, scratch.start_slope, scratch.push)
    while True:
        time, theta = periods * period + rest, phase + model.omega * rest
        left = (seconds - periods * period) - rest
        if sampled == 0 and samples.shape[0] > 0:
            write_sample(model, regime, origin, carry, z, scratch.start_slope, rock, samples[0])
            sampled = 1
        after = standing_switch(model, regime, z, scratch.start_slope)
        s = 0.0
        if after == regime:
            if left <= 1e-15 * seconds:
                break
            # try a step
            h = min(trust[regime], left)
            copy(scratch.start_slope, stages[0])
            step(model, time, theta, regime, z, h, scratch)
            tried += 1
            error = step_error(model, z, h, rtol, scratch)
            factor = 0.2 if not error < 1e10 else min(6.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.125))
            if error > 1.0 or not error < math.inf:
                rejected += 1
                trust[regime] = h * min(factor, 0.9)
                if trust[regime] < 1e-12 * period:
                    status = STEPS_TOO_SHORT
                    break
                continue
            if h == trust[regime] or factor < 1.0:
                trust[regime] = min(h * factor, model.longest)
            copy(scratch.end, scratch.trial)
            copy(stages[12], scratch.trial_slope)
            s, after = find_switch(model, time, theta, regime, z, h, scratch)
            # samples on the way
            while sampled < samples.shape[0]:
                ahead = (sampled / rate - periods * period) - rest
                if ahead > s:
                    break
                copy(scratch.end, scratch.trial)
                rock = step(model, time, theta, regime, z, ahead, scratch)
                write_sample(model, regime, origin, carry, scratch.end, stages[12], rock, samples[sampled])
                copy(scratch.trial, scratch.end)
                sampled += 1
            copy(scratch.end, scratch.trial)
            if model.rated and regime == LOADING:
                peak = max(peak, inner_peak(model, time, theta, regime, z, s, scratch))
            copy(scratch.trial, z)
            rest += s
            while rest >= period:
                rest -= period
                periods += 1.0
            time, theta = periods * period + rest, phase + model.omega * rest

        if after != regime:
            standing = standing + 1 if s == 0.0 else 0
            if standing > 8:
                status = SWITCHES_TOO_DENSE
                break
            before, regime = regime, after
            if before == FREE:
                speed, since = z[V2] - face_speed(model, z), time
            if after == UNLOADING:
                z[V2] = face_speed(model, z)
                peak = max(peak, slope(model, time, theta, before, z, scratch.start_slope, scratch.push))
                if impact_count == impacts.shape[0]:
                    impacts = longer(impacts)
                impact = impacts[impact_count]
                impact[0], impact[1], impact[2], impact[3], impact[4] = time, peak, speed, z[W], since
                impact_count += 1
            peak = 0.0
            origin, carry = add_exactly(origin, carry, change_regime(model, before, after, z))
            if switch_count == switches.shape[0]:
                switches = longer(switches)
            switches[switch_count, 0], switches[switch_count, 1], switches[switch_count, 2] = time, before, after
            switch_count += 1
        rock = slope(model, time, theta, regime, z, scratch.start_slope, scratch.push)

    while status == DONE and sampled < samples.shape[0]:
        # the last sample, where rounding puts it just behind the end
        write_sample(model, regime, origin, carry, z, scratch.start_slope, rock, samples[sampled])
        sampled += 1
    return (
        status,
        periods * period + rest,
        regime,
        origin,
        carry,
        phase + model.omega * rest,
        impacts[:impact_count],
        switches[:switch_count],
        tried,
        rejected,
    )


# --------------------------------------------------------------------------------------------------------------------
# What the user calls.


class Start(NamedTuple):
    """A state to start from, or one that a run ended in. SI."""

    y: float
    """X1 - X2 in m."""
    v1: float
    v2: float
    w: float
    """Behind Xf (out of contact, below 0; unloading, above 0) or Xp (loading, above 0), in m."""
    regime: int
    """0 no contact, 1 loading, 2 unloading."""
    extra: tuple[float, ...] = ()
    """The extra states of the chosen effects, in the order chosen; left out, they are 0."""
    face: float = 0.0
    """Displacement of the rock's face in m."""


class Impacts(NamedTuple):
    """One entry an impact: a turn from loading to unloading."""

    time: np.ndarray
    """s, of the turn."""
    force: np.ndarray
    """N, the largest force of the rock on the way to this turn."""
    speed: np.ndarray
    """m/s into the rock, where the contact began; 0 for a contact begun before the run."""
    depth: np.ndarray
    """m, X2 - Xp at the turn."""
    contact_time: np.ndarray
    """s, when the contact began."""


class Switches(NamedTuple):
    """One entry a switch of regime."""

    time: np.ndarray
    """s."""
    before: np.ndarray
    """0 no contact, 1 loading, 2 unloading."""
    after: np.ndarray


class Energy(NamedTuple):
    """Energies of a whole run in J. ``stored`` are those of the masses and the spring k."""

    drive: float
    """Work of the drive force F_a sin(theta)."""
    static: float
    """Work of the static force F_b."""
    damper: float
    """Lost in the damper c."""
    rock: float
    """Lost in the rock by the rock law (as bent by effects)."""
    effects: np.ndarray
    """(effects,) given to the rig by each effect, in the order chosen; negative where it takes."""
    stored_before: float
    stored_after: float

    @property
    def error(self) -> float:
        """What the balance fails to close by, in J."""
        given = self.drive + self.static - self.damper - self.rock + float(np.sum(self.effects))
        return self.stored_after - self.stored_before - given


class GeneralRun(NamedTuple):
    """What :func:`run_general` returns. SI; arrays of samples have shape (samples,)."""

    time: np.ndarray
    """s, 0 at the start."""
    x1: np.ndarray
    """m. X2 = 0 where Xf was at the start (Xp for a start while loading), the rock's face not displaced."""
    x2: np.ndarray
    v1: np.ndarray
    v2: np.ndarray
    acceleration: np.ndarray
    """m/s^2, of the indenter."""
    force: np.ndarray
    """N, of the rock, positive in compression."""
    penetration: np.ndarray
    """m, Xf."""
    regime: np.ndarray
    """0 no contact, 1 loading, 2 unloading."""
    extra: np.ndarray
    """(samples, extra states) of the chosen effects, in the order chosen."""
    impacts: Impacts
    switches: Switches
    energy: Energy
    end: Start
    """The state at the end, to start another run from, with ``end_phase``."""
    end_phase: float
    """rad."""
    end_origin: float
    """m. The place that ``end.w`` is counted from."""
    steps: int
    """Steps tried."""
    rejected: int
    """Steps tried in vain."""


def run_general(
    rig: Rig,
    setting: Setting,
    rock: Rock,
    seconds: float,
    sample_rate: float,
    phase: float = 0.0,
    start: Start | None = None,
    effects: Iterable[Chosen] = (),
    rtol: float = 1e-12,
) -> GeneralRun:
    """Run the rig with any effects.

    Args:
        rig: The rig.
        setting: Frequency, amplitude and pressure.
        rock: The rock.
        seconds: Duration in s.
        sample_rate: Samples a second, the first at time 0; 0 for none.
        phase: Phase of the excitation at time 0 in rad.
        start: State at time 0. Left out, the rig starts fresh: at rest, the cylinder leaning on the spring, the
            indenter touching rock never hit before.
        effects: From :func:`drillenv.dynamics.effects.make`, each effect at most once.
        rtol: Relative error tolerated a step.

    Raises:
        InputError: a value out of range, a start that does not fit its regime, an effect that does not act on the
            motion or is given twice, or effects under which the motion cannot be followed.
    """
    seconds = number("seconds", seconds, 0.0, 1e6, "s")
    sample_rate = number("sample_rate", sample_rate, 0.0, 1e8, "Hz")
    phase = number("phase", phase, -1e6, 1e6, "rad") % (2 * math.pi)
    rtol = number("rtol", rtol, 1e-14, 1e-3)
    effects = tuple(effects)
    model, order = model_for(rig, setting, rock, effects)
    z, regime = _first_state(model, start, effects, order)
    stored_before = _stored(model, z)
    count = math.floor(seconds * sample_rate * (1 + 1e-12)) + 1 if sample_rate > 0 else 0
    samples = np.zeros((count, SAMPLE_COLUMNS + model.tally - OWN))
    status, reached, regime, origin, carry, end_phase, impacts, switches, tried, rejected = integrate(
        model, phase, z, regime, seconds, sample_rate, samples, rtol, make_scratch(z.size, len(effects))
    )
    if status != DONE:
        why = "grew without bound" if status == STEPS_TOO_SHORT else "switched without end"
        raise InputError(f"the motion {why} at {reached:g} s: make the effects weaker, or rtol larger")
    extra = _in_order_chosen(effects, order)
    energies = z[model.tally :]
    given = np.empty(len(effects))
    given[order] = energies[BY_EFFECTS:]
    columns = np.ascontiguousarray(samples.T)
    return GeneralRun(
        time=np.arange(count) / sample_rate if count else np.zeros(0),
        x1=columns[0],
        x2=columns[1],
        v1=columns[2],
        v2=columns[3],
        acceleration=columns[4],
        force=columns[5],
        penetration=columns[6],
        regime=columns[7].astype(np.int8),
        extra=samples[:, SAMPLE_COLUMNS:][:, extra],
        impacts=Impacts(*np.ascontiguousarray(impacts.T)),
        switches=Switches(switches[:, 0].copy(), switches[:, 1].astype(np.int8), switches[:, 2].astype(np.int8)),
        energy=Energy(
            drive=float(energies[BY_DRIVE]),
            static=float(energies[BY_STATIC]),
            damper=float(energies[IN_DAMPER]),
            rock=float(energies[IN_ROCK]),
            effects=given,
            stored_before=stored_before,
            stored_after=_stored(model, z),
        ),
        end=Start(
            y=float(z[Y]),
            v1=float(z[V1]),
            v2=float(z[V2]),
            w=float(z[W]),
            regime=int(regime),
            extra=tuple(float(part) for part in z[OWN : model.tally][extra]),
            face=float(z[U]),
        ),
        end_phase=end_phase % (2 * math.pi),
        end_origin=origin + carry,
        steps=tried,
        rejected=rejected,
    )


def model_for(rig: Rig, setting: Setting, rock: Rock, effects: tuple[Chosen, ...]) -> tuple[Model, np.ndarray]:
    """The model, and the order in which it calls the effects.

    Raises:
        InputError: an effect that does not act on the motion, or is given twice.
    """
    seen: set[str] = set()
    for chosen in effects:
        if not isinstance(chosen, Chosen):
            raise InputError(f"effects holds {chosen!r}: give effects from drillenv.dynamics.effects.make(name, ...)")
        name = chosen.effect.name
        if name in seen:
            raise InputError(f"effect {name} is given twice: give it once")
        if not (chosen.effect.term or chosen.effect.shape):
            raise InputError(f"effect {name} does not act on the motion of the drilling rig: leave it out here")
        seen.add(name)
    order = np.array(sorted(range(len(effects)), key=lambda i: effects[i].effect.comes_last), dtype=np.int64)
    ordered = [effects[i] for i in order]
    extras = [len(chosen.effect.extras) for chosen in ordered]
    first = OWN + np.cumsum([0, *extras])
    at = np.cumsum([0, *(len(chosen.values) for chosen in ordered)])
    force = rig.drive_force(setting) + rig.static_force(setting)
    depth = force / rock.loading_stiffness
    natural = math.sqrt(rock.loading_stiffness / rig.indenter_mass)
    speed = depth * natural
    sizes = [force / rig.stiffness, speed, speed, depth, depth]
    sizes += [extra.size for chosen in ordered for extra in chosen.effect.extras]

    table = np.zeros((len(ordered), 7), dtype=np.int64)
    for row, chosen, own, p in zip(table, ordered, first[:-1], at[:-1], strict=True):
        effect = chosen.effect
        row[TERM_AT] = address_of(effect.term, TERM)
        row[SHAPE_AT] = address_of(effect.shape, SHAPE)
        row[SWITCHED_AT] = address_of(effect.switched, SWITCHED)
        row[LAST], row[FIRST], row[AT], row[FACE] = effect.comes_last, own, p, effect.moves_face
    model = Model(
        rig.shaker_mass,
        rig.indenter_mass,
        rig.stiffness,
        rig.damping,
        rock.loading_stiffness,
        rock.unloading_stiffness,
        2 * math.pi * setting.frequency,
        rig.drive_force(setting),
        rig.static_force(setting),
        table,
        np.array([value for chosen in ordered for value in chosen.values] + [0.0]),
        np.array(sizes),
        int(first[-1]),
        any(chosen.effect.shape is not None for chosen in ordered),
        any(c.effect.term is not None and "contact" in c.effect.balances and not c.is_neutral for c in ordered),
        0.1 / setting.frequency,
    )
    return model, order


def _first_state(model: Model, start: Start | None, effects: tuple[Chosen, ...], order: np.ndarray):
    """The full state vector at time 0, and the regime."""
    z = np.zeros(model.tally + BY_EFFECTS + len(effects))
    if start is None:
        z[Y] = model.static / model.k
        return z, FREE
    for index, name in enumerate(("y", "v1", "v2", "w")):
        z[index] = number(f"start {name}", getattr(start, name), -1e3, 1e3, "m" if name in ("y", "w") else "m/s")
    z[U] = number("start face", start.face, -1e3, 1e3, "m")
    regime = int(number("start regime", start.regime, 0, 2))
    room = model.tally - OWN
    if start.extra:
        if len(start.extra) != room:
            raise InputError(
                f"start has {len(start.extra)} extra states: these effects have {room}, give as many or none"
            )
        values = [number("start extra", value, -1e12, 1e12) for value in start.extra]
        z[OWN : model.tally][_in_order_chosen(effects, order)] = values
    into = z[V2] - face_speed(model, z)
    if (regime == FREE and z[W] > 0) or (regime != FREE and z[W] < 0):
        raise InputError(f"start w is {z[W]:g} m in regime {regime}: give w <= 0 out of contact (0), w >= 0 in contact")
    if (regime == LOADING and into < 0) or (regime == UNLOADING and into > 0):
        raise InputError(
            f"start moves at {into:g} m/s into the rock in regime {regime}: loading (1) moves in, unloading out"
        )
    return z, regime


def _in_order_chosen(effects: tuple[Chosen, ...], order: np.ndarray) -> np.ndarray:
    """Index of each extra state, in the order chosen, among those of the model."""
    counts = [len(chosen.effect.extras) for chosen in effects]
    place, at = {}, 0
    for i in order:
        place[i] = at
        at += counts[i]
    return np.array([place[i] + j for i in range(len(effects)) for j in range(counts[i])], dtype=np.int64)


def _stored(model: Model, z: np.ndarray) -> float:
    """Energy of the masses and the spring in J."""
    return float(0.5 * (model.m1 * z[V1] ** 2 + model.m2 * z[V2] ** 2 + model.k * z[Y] ** 2))
