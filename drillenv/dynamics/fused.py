"""Fused multiply-add, where the source asks for it and nowhere else."""

from collections.abc import Callable

from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic


def _fma(typingctx, a, b, c):
    """a * b + c, rounded once (IEEE 754 fusedMultiplyAdd), for numbers; the processor's instruction where it has one.

    What the compiler fuses on its own depends on what it has inlined, so on whether a kernel came out of the cache.
    """
    if not all(isinstance(x, types.Number) for x in (a, b, c)):
        raise TypingError(f"fma takes three numbers, not {a}, {b}, {c}")

    def codegen(context, builder, signature, args):
        wide = [
            context.cast(builder, value, given, types.float64)
            for value, given in zip(args, signature.args, strict=True)
        ]
        return builder.fma(*wide)

    return types.float64(a, b, c), codegen


fma: Callable[[float, float, float], float] = intrinsic(_fma)  # pyright: ignore[reportAssignmentType]
"""fma(a, b, c): see _fma."""
