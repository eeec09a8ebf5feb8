"""Threads that share each step of a stack: each takes blocks of worlds, and waits for the next step outside the interpreter.

The worlds are cut into blocks and each thread has a range of them. It takes those of its own range, one after the other, and
then what other ranges have left, so that a thread that wakes late, or is given no processor, delays nobody: in a forked
process, which has no other threads, the caller's own makes every block. A thread without work asks for it for some 50
microseconds and then sleeps on one of Python's locks. All this is one compiled function, `share`, which is compiled where
somebody asks for more than one thread and holds no interpreter lock while it waits, so that a step costs one call of it.

What the threads say to each other stands in one array, `control`, in words that have a cache line each:

    control[DONE]            blocks of this step that are finished
    control[STEP]            a number that rises with each step, and at the end
    control[STOP]            1 when the threads are to end
    control[ACTIONS ..]      addresses of what differs from step to step, valid while blocks are not finished
    control[RANGES + 16 t]   thread t: its next block; then 1 while it sleeps; then the address of its lock, taken
"""

from __future__ import annotations

import ctypes
import os
import threading
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import int64, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from marsexplorer.bitmap import COLS, ROWS
from marsexplorer.columns import are_actions, step_block
from marsexplorer.compiled import inlined, kernel
from marsexplorer.observation import STATE_VALUES
from marsexplorer.rules import BLOCK

LINE = 8
"""Words of a cache line."""

DONE, STEP, STOP, ACTIONS, RANGES = 0, LINE, 2 * LINE, 3 * LINE, 4 * LINE
REWARDS, TERMINATED, TRUNCATED, VALUES = range(ACTIONS + 1, ACTIONS + 5)
RANGE, ASLEEP, LOCK = 2 * LINE, LINE, LINE + 1

ASKS = 5000
"""How often a thread asks for work before it sleeps, 10 to 50 ns each."""

NAP_US = 50
"""How long the caller's thread sleeps where another has been kept from its processor with a block unfinished."""


@intrinsic
def load(typingctx, array, at):
    """Return array[at] of int64 as every thread sees it."""
    del typingctx

    def code(context, builder, signature, args):
        place = builder.gep(
            context.make_array(signature.args[0])(context, builder, args[0]).data, [args[1]]
        )
        return builder.load_atomic(place, "seq_cst", 8)

    return int64(array, int64), code


def _exchange(operation):
    """Return the code that changes array[at] by an operation, in one step for every thread, and returns what was there."""

    def code(context, builder, signature, args):
        place = builder.gep(
            context.make_array(signature.args[0])(context, builder, args[0]).data, [args[1]]
        )
        return builder.atomic_rmw(operation, place, args[2], "seq_cst")

    return code


@intrinsic
def add(typingctx, array, at, number):
    """Add to array[at] of int64, in one step for every thread; return what was there."""
    del typingctx
    return int64(array, int64, int64), _exchange("add")


@intrinsic
def swap(typingctx, array, at, number):
    """Write array[at] of int64, in one step for every thread; return what was there."""
    del typingctx
    return int64(array, int64, int64), _exchange("xchg")


@intrinsic
def pause(typingctx):
    """Leave the processor to its other thread for a moment, where it has an instruction for that."""
    del typingctx

    def code(context, builder, signature, args):
        del signature, args
        if builder.module.triple.startswith(("x86_64", "amd64")):
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(
                cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.sse2.pause"), []
            )
        return context.get_dummy_value()

    return types.void(), code


@intrinsic
def address_of(typingctx, array):
    """Return where an array's numbers stand in memory."""
    del typingctx

    def code(context, builder, signature, args):
        return builder.ptrtoint(
            context.make_array(signature.args[0])(context, builder, args[0]).data, ir.IntType(64)
        )

    return int64(array), code


@intrinsic
def array_at(typingctx, address, like):
    """Return an array of the type and shape of `like` at an address."""
    del typingctx

    def code(context, builder, signature, args):
        array = context.make_array(signature.args[1])(context, builder, args[1])
        array.data = builder.inttoptr(args[0], array.data.type)
        return array._getvalue()

    return like(int64, like), code


@intrinsic
def acquire(typingctx, lock, microseconds):
    """Wait for the lock at an address and take it; not longer than some microseconds unless they are negative."""
    del typingctx

    def code(context, builder, signature, args):
        del context, signature
        number, place = ir.IntType(32), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(number, [place, ir.IntType(64), number])
        function = cgutils.get_or_insert_function(
            builder.module, kind, "PyThread_acquire_lock_timed"
        )
        return builder.sext(
            builder.call(function, [builder.inttoptr(args[0], place), args[1], number(0)]),
            ir.IntType(64),
        )

    return int64(int64, int64), code


@intrinsic
def release(typingctx, lock):
    """Give the lock at an address back, from any thread."""
    del typingctx

    def code(context, builder, signature, args):
        del signature
        place = ir.IntType(8).as_pointer()
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.VoidType(), [place]), "PyThread_release_lock"
        )
        builder.call(function, [builder.inttoptr(args[0], place)])
        return context.get_dummy_value()

    return types.void(int64), code


@inlined
def wake(control, threads):
    """Wake the threads that sleep, all but the caller's own."""
    for t in range(1, threads):
        place = RANGES + RANGE * t
        if load(control, place + ASLEEP) and swap(control, place + ASLEEP, 0):
            release(control[place + LOCK])


@inlined
def wait_for_step(control, own, seen, asks):
    """Wait until control[STEP] is another than `seen`."""
    # 1. Ask for a while: in a loop of steps the next one comes before a sleeping thread could wake.
    for _ in range(asks):
        if load(control, STEP) != seen:
            return
        pause()

    # 2. Say that this thread sleeps, and look once more: who begins a step raises its number and then looks who sleeps, so
    #    that one of the two sees the other. Who turns ASLEEP from 1 to 0 decides: the one who began has given the lock then.
    swap(control, own + ASLEEP, 1)
    if load(control, STEP) == seen or not swap(control, own + ASLEEP, 0):
        acquire(control[own + LOCK], -1)


@kernel
def share(
    thread, sight, listed, actions, rewards, terminated, truncated, values_out, threads, block, asks, control, values, counts,
    state, record, codes, rules, masks, outcomes, last, last_codes, shares, last_shares, ended, which,
):  # fmt: skip
    """Thread 0: do `columns.step_described` with the others and return what it does. Another: do so until told to stop.

    sight, listed         the thread's own: a table, and int64[block], scratch
    actions..values_out   thread 0: of this step. Another: of the same types
    values_out, values    float32[num * rows * cols], written: values[code] of each code, where it is not empty
    threads, block, asks  threads of the stack, worlds in a block, how often to ask for work before sleeping
    counts                int64[blocks], scratch: the worlds that ended in each

    Thread -1: tell the others to stop.
    """
    num = outcomes.shape[0]
    blocks = (num + block - 1) // block
    cells = rules[ROWS] * rules[COLS]
    own, seen = RANGES + RANGE * thread, np.int64(0)

    if thread < 0:
        swap(control, STOP, 1)
        add(control, STEP, 1)
        wake(control, threads)
        return np.int64(0)

    # 1. The caller says what is to be done, and then opens the ranges. All blocks of the step before are finished, so no
    #    other thread reads this before it has taken a block of this step.
    if thread == 0:
        if not are_actions(actions):
            return np.int64(-1) - num
        control[ACTIONS], control[REWARDS] = address_of(actions), address_of(rewards)
        control[TERMINATED], control[TRUNCATED] = address_of(terminated), address_of(truncated)
        control[VALUES] = address_of(values_out) if values_out.shape[0] else np.int64(0)
        swap(control, DONE, 0)
        for t in range(threads):
            swap(control, RANGES + RANGE * t, blocks * t // threads)
        add(control, STEP, 1)
        wake(control, threads)

    while True:
        # 2. Take blocks: of one's own range, then of the next ones.
        for k in range(threads):
            t = (thread + k) % threads
            place, end = RANGES + RANGE * t, blocks * (t + 1) // threads
            while load(control, place) < end:
                at = add(control, place, 1)
                if at >= end:
                    break
                first, beyond = at * block, min(num, (at + 1) * block)
                counts[at] = step_block(
                    array_at(control[ACTIONS], actions), array_at(control[REWARDS], rewards),
                    array_at(control[TERMINATED], terminated), array_at(control[TRUNCATED], truncated),
                    state, record, codes, sight, rules, masks, outcomes, listed, last, last_codes,
                    shares, last_shares, ended, which, first, first, beyond,
                ) - first  # fmt: skip
                if control[VALUES]:
                    out = array_at(control[VALUES], values_out)
                    for cell in range(first * cells, beyond * cells):
                        out[np.uint64(cell)] = values[codes[np.uint64(cell)]]
                add(control, DONE, 1)

        # 3. The caller waits for the blocks that others have taken and then puts the lists of their ended worlds together.
        if thread == 0:
            asked = 0
            while load(control, DONE) < blocks:
                asked += 1
                if asked < asks:
                    pause()
                else:
                    acquire(control[own + LOCK], NAP_US)
            count = np.int64(0)
            for at in range(blocks):
                first = at * block
                if counts[at] + first < 0:
                    return counts[at] + first
                for i in range(first, first + counts[at]):
                    which[count] = which[i]
                    count += 1
            return count

        # 4. The others wait for the next step.
        if load(control, STEP) == seen:
            wait_for_step(control, own, seen, asks)
        seen = load(control, STEP)
        if load(control, STOP):
            return np.int64(0)


ALLOCATE = ctypes.PYFUNCTYPE(ctypes.c_void_p)(("PyThread_allocate_lock", ctypes.pythonapi))
ACQUIRE = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int)(
    ("PyThread_acquire_lock", ctypes.pythonapi)
)
FREE = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(("PyThread_free_lock", ctypes.pythonapi))
"""Python's locks by their addresses, for compiled code."""

NO_VALUES: NDArray[np.float32] = np.zeros(0, np.float32)


class ThreadPool:
    """The threads of a stack, not for two callers at once.

    num_threads  threads, the caller's among them; the others begin with the first step
    num          worlds of the stack
    arrays       what `columns.step_described` takes from `state` on, the same for the life of the stack
    """

    def __init__(self, num_threads: int, num: int, arrays: tuple[Any, ...]) -> None:
        block = min(BLOCK, -(-num // (4 * num_threads)))
        cores = (
            len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else os.cpu_count() or 1
        )
        self._num_threads, self._block = num_threads, block
        self._control = np.zeros(RANGES + RANGE * num_threads, np.int64)
        state, record, codes, self._sight, rules, masks, outcomes, _, *others = arrays
        counts = np.zeros(-(-num // block), np.int64)
        numbers = (num_threads, block, ASKS if num_threads <= cores else 0)
        worlds = (state, record, codes, rules, masks, outcomes, *others)
        self._arrays = (*numbers, self._control, STATE_VALUES, counts, *worlds)
        self._own = self._own_arrays()
        self._end: weakref.finalize[..., Any] | None = None
        self._is_closed = False

    def step(
        self,
        actions: NDArray[np.int64],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        values: NDArray[np.float32] | None = None,
    ) -> int:
        """Do `columns.step_described` on all threads and return what it returns; RuntimeError after `close`.

        values  float32[num * rows * cols], written: eq. 6 of the codes
        """
        if self._is_closed:
            raise RuntimeError(
                "a stack makes no steps after the shutdown of its threads by close(): make another stack"
            )
        out = NO_VALUES if values is None else values
        count = int(
            share(0, *self._own, actions, rewards, terminated, truncated, out, *self._arrays)
        )
        if (
            self._end is None
        ):  # `share` is compiled now, so that no thread compiles while the process ends
            self._begin()
        return count

    def close(self) -> None:
        """End the threads."""
        self._is_closed = True
        if self._end is not None:
            self._end()

    def _own_arrays(self) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
        """Return what each thread has for itself: a table of sight with its scratch, and a list of worlds."""
        return self._sight.copy(), np.zeros(self._block, np.int64)

    def _begin(self) -> None:
        """Start the threads. They hold arrays and not this object, which ends them when it is gone."""
        same_types = (
            np.zeros(0, np.int64),
            np.zeros(0),
            np.zeros(0, np.bool_),
            np.zeros(0, np.bool_),
            NO_VALUES,
        )
        locks = [ALLOCATE() for _ in range(self._num_threads)]
        for number, lock in enumerate(locks):
            ACQUIRE(lock, 1)
            self._control[RANGES + RANGE * number + LOCK] = lock
        threads = [
            threading.Thread(
                target=share,
                args=(number, *self._own_arrays(), *same_types, *self._arrays),
                name="marsexplorer",
                daemon=True,
            )
            for number in range(1, self._num_threads)
        ]
        stop = partial(share, -1, *self._own, *same_types, *self._arrays)
        self._end = weakref.finalize(self, _end, stop, threads, locks)
        for thread in threads:
            thread.start()


def _end(stop: Callable[[], Any], threads: list[threading.Thread], locks: list[int]) -> None:
    """Tell the threads to stop, and free their locks when they have."""
    stop()
    for thread in threads:
        thread.join()
    for lock in locks:
        FREE(lock)
