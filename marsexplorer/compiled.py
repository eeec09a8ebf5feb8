"""How the kernels are compiled: numba without reference counting, cached on disk, releasing the interpreter's lock.

Kernels take whole numpy arrays and plain numbers; what each stands for is said where the kernel is called from. Counting
references to array views cost more than half of the time of a step, hence `_nrt=False`: a kernel allocates nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from llvmlite import ir
from numba import njit, uint64
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Return the function compiled, to be called from Python."""
    compiled: F = njit(cache=True, nogil=True, _nrt=False)(function)  # type: ignore[call-overload]
    return compiled


def inlined(function: F) -> F:
    """Return the function for use inside kernels, its body compiled into theirs."""
    compiled: F = njit(inline="always", _nrt=False)(function)  # type: ignore[call-overload]
    return compiled


@intrinsic
def popcount(typingctx, word):  # type: ignore[no-untyped-def]  # numba's calling convention for intrinsics
    """Number of set bits in a uint64."""
    del typingctx, word

    def code(context, builder, signature, args):  # type: ignore[no-untyped-def]
        del context, signature
        return builder.ctpop(args[0])

    return uint64(uint64), code


@intrinsic
def lowest(typingctx, word):  # type: ignore[no-untyped-def]  # numba's calling convention for intrinsics
    """Index of the lowest set bit in a nonzero uint64."""
    del typingctx, word

    def code(context, builder, signature, args):  # type: ignore[no-untyped-def]
        del context, signature
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return uint64(uint64), code
