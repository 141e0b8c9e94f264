"""How kernels call a compiled term that comes from outside."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import cfunc, types
from numba.extending import intrinsic

from drillenv.dynamics.effects import Moment

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


# Numba hands an intrinsic its first argument itself, which type checkers do not know.
call_term: Callable[..., Any] = intrinsic(_call_term)  # pyright: ignore[reportAssignmentType]
