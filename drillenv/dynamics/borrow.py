"""Arrays without reference counting, for the inside of a kernel."""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np.arrayobj import make_array


def _borrow(typingctx, array):
    """The same array as one that nobody counts references to.

    Numba raises and lowers an array's count (atomically) around every function that takes it, inlined or not: half the
    cost of a kernel made of small functions. A kernel that borrows its arguments first has none of it. The array must
    outlive the borrowed one, as an argument of the kernel does.
    """
    if not isinstance(array, types.Array):
        raise TypingError(f"only an array can be borrowed, not {array}")

    def codegen(context, builder, signature, args):
        view = make_array(signature.args[0])(context, builder, args[0])
        pointer = view.meminfo.type
        view.meminfo = ir.Constant(pointer, None)
        return view._getvalue()

    return array(array), codegen


borrowed: Callable[[Any], Any] = intrinsic(_borrow)  # pyright: ignore[reportAssignmentType]
"""borrowed(array): see _borrow."""
