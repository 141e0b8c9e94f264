"""Calling the functions of effects from the general engine.

Each is compiled on its own to a C function; the kernel gets addresses. So the kernel is compiled once, and not again
for every set of effects.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import cfunc, types
from numba.extending import intrinsic

from drillenv.dynamics.effects import Moment

INNER = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "forceinline": False,  # else it is handed down from the function that happened to call first
}
"""How a kernel that only other kernels call is compiled: what would let Python call it takes longer than the kernel. Do
not call one from Python: there is nothing there to call, and the process ends."""
INLINED = {**INNER, "forceinline": True}
"""The same for what a kernel calls all the time."""
MERGED = {**INNER, "inline": "always"}
"""The same for what is called in one place: merged into its caller, it is not compiled and linked by itself."""

MOMENT = types.NamedTuple([types.int64 if name == "regime" else types.float64 for name in Moment._fields], Moment)
_NUMBERS = types.CPointer(types.float64)
TERM = types.void(MOMENT, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)
SHAPE = types.float64(types.float64, types.int64, types.float64, types.float64, _NUMBERS, _NUMBERS)
SWITCHED = types.void(types.int64, types.int64, _NUMBERS, _NUMBERS)
CORNER = types.float64(MOMENT, types.float64, types.float64, _NUMBERS)


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


def _call_term(typingctx, address, now, state, rates, first, parameters, at, push):
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


def _call_shape(typingctx, address, depth, regime, stiffness, ratio, state, first, parameters, at):
    """Call ``shape(depth, regime, stiffness, ratio, state[first:], parameters[at:])``."""

    def codegen(context, builder, signature, values):
        address, depth, regime, stiffness, ratio, state, first, parameters, at = values
        own = _place(context, builder, signature.args[5], state, first)
        p = _place(context, builder, signature.args[7], parameters, at)
        return _call(context, builder, SHAPE, address, [depth, regime, stiffness, ratio, own, p])

    kinds = (types.float64, types.int64, types.float64, types.float64)
    return types.float64(address, *kinds, state, first, parameters, at), codegen


def _call_switched(typingctx, address, before, after, state, first, parameters, at):
    """Call ``switched(before, after, state[first:], parameters[at:])``."""

    def codegen(context, builder, signature, values):
        address, before, after, state, first, parameters, at = values
        own = _place(context, builder, signature.args[3], state, first)
        p = _place(context, builder, signature.args[5], parameters, at)
        _call(context, builder, SWITCHED, address, [before, after, own, p])
        return context.get_dummy_value()

    return types.void(address, types.int64, types.int64, state, first, parameters, at), codegen


def _call_corner(typingctx, address, now, a1, a2, parameters, at):
    """Call ``corner(now, a1, a2, parameters[at:])``."""

    def codegen(context, builder, signature, values):
        address, now, a1, a2, parameters, at = values
        p = _place(context, builder, signature.args[4], parameters, at)
        return _call(context, builder, CORNER, address, [now, a1, a2, p])

    return types.float64(address, MOMENT, types.float64, types.float64, parameters, at), codegen


def _apart(typingctx):
    """Keep the function that calls this from being inlined; what calls it then compiles in a fraction of the time."""

    def codegen(context, builder, signature, values):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen


# Numba hands an intrinsic its first argument itself, which type checkers do not know.
call_term: Callable[..., Any] = intrinsic(_call_term)  # pyright: ignore[reportAssignmentType]
call_shape: Callable[..., Any] = intrinsic(_call_shape)  # pyright: ignore[reportAssignmentType]
call_switched: Callable[..., Any] = intrinsic(_call_switched)  # pyright: ignore[reportAssignmentType]
call_corner: Callable[..., Any] = intrinsic(_call_corner)  # pyright: ignore[reportAssignmentType]
apart: Callable[..., Any] = intrinsic(_apart)  # pyright: ignore[reportAssignmentType]
