"""How kernels are compiled, and how they call a compiled term that comes from outside."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import cfunc, types
from numba.extending import intrinsic

from drillenv.dynamics.effects import Moment

INNER: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "_nrt": False,  # else it counts references to every array and row that it is handed
    "forceinline": False,  # else it is handed down from the function that happened to call first
}
"""How a kernel that only other kernels call is compiled: what would let Python call it takes longer than the kernel. Do
not call one from Python: there is nothing there to call, and the process ends."""
ALLOCATING: dict[str, Any] = {**INNER, "_nrt": True}
"""The same for one that makes arrays."""
INLINED: dict[str, Any] = {**INNER, "forceinline": True}
"""The same for what a kernel calls all the time."""
MERGED: dict[str, Any] = {**INNER, "inline": "always"}
"""The same for what is called in one place: merged into its caller, it is not compiled and linked by itself."""


def constants(*values: int) -> Any:
    """Constants to hand to kernels: for each Python literal that Numba is handed it compiles a kernel anew."""
    return tuple(np.int64(value) for value in values)


NO: Any = np.bool_(False)
YES: Any = np.bool_(True)
"""The same of what is true or not."""


MOMENT: Any = types.NamedTuple([types.int64 if name == "regime" else types.float64 for name in Moment._fields], Moment)
_NUMBERS = types.CPointer(types.float64)
TERM: Any = types.void(MOMENT, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)


@functools.cache
def _compiled(function: Callable):
    """A term as a C function, kept alive for as long as the process."""
    try:
        return cfunc(TERM, cache=True, error_model="numpy")(function)
    except RuntimeError:
        # a function typed at a prompt has no file to be cached beside
        return cfunc(TERM, error_model="numpy")(function)


def address_of(function: Callable) -> int:
    """The address to call a term at."""
    return int(_compiled(function).address or 0)


def _call_term(typingctx, address, now, state, rates, first, parameters, at, push):
    """Call ``term(now, state[first:], parameters[at:], push, rates[first:])``."""

    def codegen(context, builder, signature, values):
        address, now, state, rates, first, parameters, at, push = values
        _, _, state_kind, rates_kind, _, parameters_kind, _, push_kind = signature.args
        kinds = [context.get_value_type(kind) for kind in TERM.args]
        pointer = builder.inttoptr(address, ir.FunctionType(ir.VoidType(), kinds).as_pointer())
        arguments = [now]
        for kind, array, offset in (
            (state_kind, state, first),
            (parameters_kind, parameters, at),
            (push_kind, push, context.get_constant(types.intp, 0)),
            (rates_kind, rates, first),
        ):
            arguments.append(builder.gep(context.make_array(kind)(context, builder, array).data, [offset]))
        builder.call(pointer, arguments)
        return context.get_dummy_value()

    return types.void(address, MOMENT, state, rates, first, parameters, at, push), codegen


def _apart(typingctx):
    """Keep the function that calls this from being inlined; what calls it then compiles in a fraction of the time."""

    def codegen(context, builder, signature, values):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen


# Numba hands an intrinsic its first argument itself, which type checkers do not know.
call_term: Callable[..., Any] = intrinsic(_call_term)  # pyright: ignore[reportAssignmentType]
apart: Callable[..., Any] = intrinsic(_apart)  # pyright: ignore[reportAssignmentType]
