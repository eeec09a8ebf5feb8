"""Compile the kernels: numba without reference counting, cached on disk, releasing the interpreter's lock.

Kernels take whole numpy arrays and plain numbers; what each stands for is said where the kernel is called from. Counting
references to array views cost more than half of the time of a step, hence `_nrt=False`: a kernel allocates nothing.

The first run on a machine compiles for some seconds, and one line on stderr says so. Later runs read numba's cache.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from numpy.typing import NDArray

try:
    import fcntl
except (
    ModuleNotFoundError
):  # Windows: two processes that compile at once may lose what one of them saves
    fcntl = None  # type: ignore[assignment]

try:
    from llvmlite import ir
    from numba import int64, njit, types, uint64
    from numba.core import event
    from numba.core.caching import FunctionCache
    from numba.extending import intrinsic
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "MarsExplorer's rules are compiled by numba: pip install 'humanplay[mars]'",
        name=error.name,
    ) from error

F = TypeVar("F", bound=Callable[..., Any])

NOTICE = "marsexplorer: compiling the rules for this machine, some seconds; the next start reads them from a cache"


class KernelCall(NamedTuple):
    """A kernel as it is called: what to compile.

    types  of the arguments, numba's
    """

    module: str
    name: str
    types: tuple[Any, ...]

    def compile(self) -> None:
        """Compile the kernel for these types, unless the cache has it."""
        getattr(import_module(self.module), self.name).compile(self.types)


class Compiling:
    """Compiling in this process: it is said once, and done while no other process compiles.

    instead  called with a kernel that the cache lacks, in place of compiling it; it raises. None: this process compiles
    """

    def __init__(self) -> None:
        self.instead: Callable[[KernelCall], object] | None = None
        self._is_said = multiprocessing.parent_process() is not None
        self._depth = self._depth_at_lock = 0
        self._lock: int | None = None

    @property
    def is_locked(self) -> bool:
        """Whether no other process compiles until this one has."""
        return self._lock is not None

    def lock(self) -> None:
        """Wait until no other process compiles: numba's index of a kernel loses what two processes write at once."""
        path = Path(FunctionCache(kernel).cache_path) / "compiling.lock"
        self._lock = os.open(path, os.O_RDONLY | os.O_CREAT, 0o644)
        if fcntl is not None:
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        self._depth_at_lock = self._depth

    def unlock(self) -> None:
        """Let other processes compile, once the outermost of nested kernels is compiled."""
        if self._lock is not None and self._depth == self._depth_at_lock:
            os.close(self._lock)
            self._lock = None

    def began(self) -> None:
        """Note that numba compiles a function, and say so the first time."""
        self._depth += 1
        if not self._is_said:
            self._is_said = True
            print(NOTICE, file=sys.stderr, flush=True)

    def ended(self, is_failed: bool) -> None:
        """Note that a function is compiled, or could not be."""
        self._depth -= 1
        if is_failed:
            self.unlock()


compiling = Compiling()


class _Listener(event.Listener):
    """numba calls it on a cache miss alone, and holds its compiler lock then."""

    def on_start(self, event: Any) -> None:
        compiling.began()

    def on_end(self, event: Any) -> None:
        compiling.ended(event.is_failed)


event.register("numba:compile", _Listener())


class KernelCache(FunctionCache):
    """What was compiled of a kernel, on disk."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what the cache has for these types of arguments; None: numba compiles it next, and saves it."""
        overload = super().load_overload(sig, target_context)
        if overload is not None or compiling.is_locked:
            return overload
        if compiling.instead is not None:
            function = self._py_func
            compiling.instead(KernelCall(function.__module__, function.__name__, sig))
        compiling.lock()
        # another process may have compiled it
        overload = super().load_overload(sig, target_context)
        if overload is not None:
            compiling.unlock()
        return overload

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save what was compiled."""
        try:
            super().save_overload(sig, data)
        finally:
            compiling.unlock()


def kernel(function: F) -> F:
    """Return the function compiled, to be called from Python and from other kernels.

    What several kernels share is a kernel as well when it is long: compiled once for all of them instead of into each.
    """
    compiled: Any = njit(nogil=True, _nrt=False, no_cfunc_wrapper=True)(function)  # type: ignore[call-overload]
    compiled._cache = KernelCache(function)  # as `cache=True` does with a FunctionCache
    find = compiled.get_call_template

    def find_for_any_number(args: Any, kws: Any) -> Any:
        # numba would compile a kernel again for each constant that other kernels give it
        return find(tuple(types.unliteral(kind) for kind in args), kws)

    compiled.get_call_template = find_for_any_number
    return compiled  # type: ignore[no-any-return]


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array, as a read-only view where it may be written.

    A kernel is compiled for arrays that may be written and again for those that may not; where both come, it is given these.
    """
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def inlined(function: F) -> F:
    """Return the function for use inside kernels, its body compiled into theirs: for what is short or used once.

    Python calls it as it is written: compiled by itself it would be in no cache.
    """
    compiled: Any = njit(inline="always", _nrt=False)(function)  # type: ignore[call-overload]
    compiled._compile_for_args = lambda *args: function
    return compiled  # type: ignore[no-any-return]


def merged(function: F) -> F:
    """Return the function for use inside kernels, put into theirs by LLVM: for what is long and used once.

    `inlined` copies what numba knows of a function once for each of its blocks, which takes a second for the longest.
    """
    compiled: F = njit(
        forceinline=True, _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True
    )(function)  # type: ignore[call-overload]
    return compiled


@intrinsic
def popcount(typingctx, word):  # numba's calling convention for intrinsics
    """Return the number of set bits in a uint64."""
    del typingctx, word

    def code(context, builder, signature, args):
        del context, signature
        return builder.ctpop(args[0])

    return uint64(uint64), code


@intrinsic
def lowest(typingctx, word):  # numba's calling convention for intrinsics
    """Return the index of the lowest set bit in a nonzero uint64."""
    del typingctx, word

    def code(context, builder, signature, args):
        del context, signature
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return uint64(uint64), code


@intrinsic
def prefetch(typingctx, array, index):  # numba's calling convention for intrinsics
    """Ask for the cache line of array[index], which need not exist, and go on without it."""
    del typingctx, index

    def code(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        place = builder.bitcast(builder.gep(data, [args[1]]), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", (place.type,), kind)
        builder.call(function, [place, *map(number, (0, 3, 1))])  # to read, into every level, data
        return context.get_dummy_value()

    return types.void(array, int64), code
