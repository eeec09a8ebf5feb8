"""Compile the kernels with numba, cached on disk and releasing Python's lock.

Kernels take whole NumPy arrays and plain numbers; their callers document what these mean. Counting
references to array views took more than half of a step's time, hence `_nrt=False`: kernels do not
allocate.

The first run on a machine compiles for some seconds and prints one line to stderr. Later runs read
numba's cache.
"""

from __future__ import annotations

import gc
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

NO_FOLDER = (
    "MarsExplorer's compiled rules have no folder that may be written to: "
    "set the variable NUMBA_CACHE_DIR to one"
)
NOTICE = "marsexplorer: compiling the rules for this machine, some seconds; the next start reads them from a cache"


class KernelCall(NamedTuple):
    """A kernel and the types of its arguments: one thing to compile.

    types  numba types of the arguments
    """

    module: str
    name: str
    types: tuple[object, ...]

    def compile(self) -> None:
        """Compile the kernel for these types, unless the cache has it."""
        getattr(import_module(self.module), self.name).compile(self.types)


class Compiling:
    """Compiling in this process: announced once, and only while no other compiles.

    instead  called, in place of compiling, with a kernel that the cache lacks; it raises. None:
             this process compiles
    """

    def __init__(self) -> None:
        self.instead: Callable[[KernelCall], object] | None = None
        self._is_said = multiprocessing.parent_process() is not None
        self._depth = self._depth_at_lock = 0
        self._lock: int | None = None
        self._is_collecting = False

    @property
    def is_locked(self) -> bool:
        """Whether other processes wait until this one has compiled."""
        return self._lock is not None

    def lock(self) -> None:
        """Wait until no other process compiles.

        numba's index of a kernel loses what two processes write at once.
        """
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
        """Count a compilation that begins; print the notice before the first."""
        if self._depth == 0:
            # Looking for garbage among all that numba allocates takes a tenth of the time.
            self._is_collecting = gc.isenabled()
            gc.disable()
        self._depth += 1
        if not self._is_said:
            self._is_said = True
            print(NOTICE, file=sys.stderr, flush=True)

    def ended(self, is_failed: bool) -> None:
        """Count a compilation that ended, and unlock if it failed."""
        self._depth -= 1
        if self._depth == 0 and self._is_collecting:
            gc.enable()
        if is_failed:
            self.unlock()


compiling = Compiling()


class _Listener(event.Listener):
    """numba calls it only on a cache miss, while it holds its compiler lock."""

    def on_start(self, event: Any) -> None:
        compiling.began()

    def on_end(self, event: Any) -> None:
        compiling.ended(event.is_failed)


event.register("numba:compile", _Listener())


class KernelCache(FunctionCache):
    """The compiled versions of one kernel, on disk.

    Raises:
        ImportError: No folder can be written to, so that nothing could be kept.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        try:
            super().__init__(function)
        except RuntimeError as error:
            raise ImportError(NO_FOLDER, name=__name__) from error

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the version for these argument types; None makes numba compile and save it."""
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

    def save_overload(self, sig: Any, data: Any) -> None:  # numba's own parameter names
        try:
            super().save_overload(sig, data)
        finally:
            compiling.unlock()


def kernel(function: F) -> F:
    """Compile a function to be called from Python and from other kernels.

    A long function that several kernels share is a kernel too: it is compiled once for all of them.
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
    """An array as a read-only view, unless it is read-only already.

    A kernel is compiled separately for writable and for read-only arrays. Where both occur, callers
    pass it read-only ones only.
    """
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def inlined(function: F) -> F:
    """Compile a short function's body into every kernel that calls it.

    Python calls it uncompiled: compiled by itself it would be in no cache.
    """
    compiled: Any = njit(inline="always", _nrt=False)(function)  # type: ignore[call-overload]
    compiled._compile_for_args = lambda *args: function
    return compiled  # type: ignore[no-any-return]


def merged(function: F) -> F:
    """Let LLVM merge a long function into the one kernel that calls it.

    `inlined` copies numba's type information once for each block, which takes a second for the
    longest.
    """
    compiled: F = njit(
        forceinline=True, _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True
    )(function)  # type: ignore[call-overload]
    return compiled


@intrinsic
def popcount(typingctx, word):  # numba's calling convention for intrinsics
    """The number of set bits in a uint64."""
    del typingctx, word

    def code(context, builder, signature, args):
        del context, signature
        return builder.ctpop(args[0])

    return uint64(uint64), code


@intrinsic
def lowest(typingctx, word):  # numba's calling convention for intrinsics
    """The index of the lowest set bit in a nonzero uint64."""
    del typingctx, word

    def code(context, builder, signature, args):
        del context, signature
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return uint64(uint64), code


@intrinsic
def prefetch(typingctx, array, index):  # numba's calling convention for intrinsics
    """Fetch the cache line of array[index], which need not exist, without waiting."""
    del typingctx, index

    def code(context, builder, signature, args):
        elements = context.make_array(signature.args[0])(context, builder, args[0]).data
        place = builder.bitcast(builder.gep(elements, [args[1]]), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", (place.type,), kind)
        builder.call(function, [place, *map(number, (0, 3, 1))])  # to read, into every level, data
        return context.get_dummy_value()

    return types.void(array, int64), code
