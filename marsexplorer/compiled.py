"""Compile the kernels: numba without reference counting, cached on disk, releasing the interpreter's lock.

Kernels take whole numpy arrays and plain numbers; what each stands for is said where the kernel is called from. Counting
references to array views cost more than half of the time of a step, hence `_nrt=False`: a kernel allocates nothing.

The first run on a machine compiles for some seconds; one line on stderr says so, once a process. Later runs read the cache.
"""

from __future__ import annotations

import multiprocessing
import sys
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from numpy.typing import NDArray

try:
    from llvmlite import ir
    from numba import int64, njit, types, uint64
    from numba.core import event
    from numba.extending import intrinsic
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "MarsExplorer's rules are compiled by numba: pip install 'humanplay[mars]'",
        name=error.name,
    ) from error

F = TypeVar("F", bound=Callable[..., Any])

NOTICE_AFTER_S = 0.5
"""Compiling that takes longer is explained on stderr."""

NOTICE = "marsexplorer: compiling the rules for this machine, some seconds; the next start reads them from a cache"


class CompilationNotice(event.Listener):
    """Prints one line when compiling takes longer than NOTICE_AFTER_S; once a process, and never in a worker process."""

    def __init__(self) -> None:
        self._depth, self._is_printed = 0, multiprocessing.parent_process() is not None
        self._timer: threading.Timer | None = None

    def on_start(self, event: Any) -> None:
        """Start the timer at the outermost of nested compilations; numba holds its compiler lock here."""
        self._depth += 1
        if self._depth == 1 and not self._is_printed:
            self._timer = threading.Timer(NOTICE_AFTER_S, self._print)
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: Any) -> None:
        """Stop the timer."""
        self._depth -= 1
        if self._depth == 0 and self._timer is not None:
            self._timer.cancel()

    def _print(self) -> None:
        if not self._is_printed:
            self._is_printed = True
            print(NOTICE, file=sys.stderr, flush=True)


event.register("numba:compile", CompilationNotice())  # type: ignore[no-untyped-call]


def kernel(function: F) -> F:
    """Return the function compiled, to be called from Python and from other kernels.

    What several kernels share is a kernel as well when it is long: compiled once for all of them instead of into each.
    """
    compiled: F = njit(cache=True, nogil=True, _nrt=False)(function)  # type: ignore[call-overload]
    return compiled


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array, as a read-only view where it may be written.

    A kernel is compiled for arrays that may be written and again for those that may not; where both come, it is given these.
    """
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def inlined(function: F) -> F:
    """Return the function for use inside kernels, its body compiled into theirs: for what is short or used once."""
    compiled: F = njit(inline="always", _nrt=False)(function)  # type: ignore[call-overload]
    return compiled


def merged(function: F) -> F:
    """Return the function for use inside kernels, put into theirs by LLVM: for what is long and used once.

    `inlined` copies what numba knows of a function once for each of its blocks, which takes a second for the longest.
    """
    compiled: F = njit(forceinline=True, _nrt=False)(function)  # type: ignore[call-overload]
    return compiled


@intrinsic
def popcount(typingctx, word):  # type: ignore[no-untyped-def]  # numba's calling convention for intrinsics
    """Return the number of set bits in a uint64."""
    del typingctx, word

    def code(context, builder, signature, args):  # type: ignore[no-untyped-def]
        del context, signature
        return builder.ctpop(args[0])

    return uint64(uint64), code


@intrinsic
def lowest(typingctx, word):  # type: ignore[no-untyped-def]  # numba's calling convention for intrinsics
    """Return the index of the lowest set bit in a nonzero uint64."""
    del typingctx, word

    def code(context, builder, signature, args):  # type: ignore[no-untyped-def]
        del context, signature
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return uint64(uint64), code


@intrinsic
def prefetch(typingctx, array, index):  # type: ignore[no-untyped-def]  # numba's calling convention for intrinsics
    """Ask for the cache line of array[index], which need not exist, and go on without it."""
    del typingctx, index

    def code(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        place = builder.bitcast(builder.gep(data, [args[1]]), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", (place.type,), kind)
        builder.call(function, [place, *map(number, (0, 3, 1))])  # to read, into every level, data
        return context.get_dummy_value()

    return types.void(array, int64), code
