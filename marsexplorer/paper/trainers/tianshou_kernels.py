"""Keep tianshou's compiled functions in numba's cache, so that a training does not begin with 15 seconds of compiling.

tianshou compiles them anew in every process. The cache is numba's own, beside tianshou's files or where NUMBA_CACHE_DIR says.
"""

from __future__ import annotations

from tianshou.algorithm import algorithm_base
from tianshou.data.buffer import manager
from tianshou.data.utils import segtree

FUNCTIONS = (
    algorithm_base._gae,
    algorithm_base._nstep_return,
    manager._prev_index,
    manager._next_index,
    segtree._setitem,
    segtree._reduce,
    segtree._get_prefix_sum_idx,
)


def cache_kernels() -> None:
    """Have numba keep what it compiles of tianshou's functions; call it before the first of them runs."""
    for function in FUNCTIONS:
        if not function.signatures:
            function.enable_caching()
