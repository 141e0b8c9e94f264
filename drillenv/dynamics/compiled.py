"""How kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

KERNEL: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
"""A kernel that Python calls. Multiply-adds are fused only where the source says so (``fused.fma``): left to the
compiler ("contract"), a kernel fresh from it and the same one out of the cache round differently, and chaotic motions
part."""
INLINE: dict[str, Any] = {**KERNEL, "forceinline": True}
"""The same for what kernels are made of: Numba counts references at each call that stays one."""
INNER: dict[str, Any] = {
    **KERNEL,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "_nrt": False,  # else it counts references to every array and row that it is handed
    "forceinline": False,  # else it is handed down from the function that happened to call first
}
"""A kernel that only other kernels call: what would let Python call it takes longer to compile than the kernel. Do not
call one from Python: there is nothing there to call, and the process ends."""
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


def _apart(typingctx):
    """Keep the function that calls this from being inlined; what calls it then compiles in a fraction of the time."""

    def codegen(context, builder, signature, values):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen


# Numba hands an intrinsic its first argument itself, which type checkers do not know.
apart: Callable[..., Any] = intrinsic(_apart)  # pyright: ignore[reportAssignmentType]


@njit(**INNER)
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy what both have room for, (n,) to (m,). Numba takes seconds to compile the same in slices."""
    for i in range(min(source.size, target.size)):
        target[i] = source[i]
