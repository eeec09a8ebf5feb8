"""Connected regions of a grid: cells that share edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def label_regions(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Number the regions of free cells.

    Args:
        free: bool[rows, cols].

    Returns:
        int32[rows, cols]: 0 where not free, else the number of the region, from 1 on.
    """
    rows, cols = free.shape
    padded = np.zeros((rows, cols + 1), np.int8)  # no run goes on in the next row
    padded[:, :cols] = free
    edges = np.diff(padded.reshape(-1), prepend=np.int8(0))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    first = np.searchsorted(ends, begins + cols + 1, side="right")
    behind = np.searchsorted(begins, ends + cols + 1, side="left")
    counts = np.maximum(behind - first, 0)
    above = np.repeat(np.arange(len(begins)), counts)
    below = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts - first, counts)
    _, numbers = np.unique(_join(len(begins), above, below), return_inverse=True)
    steps = np.zeros(padded.size + 1, np.int32)
    steps[begins] = numbers + 1
    steps[ends] -= (numbers + 1).astype(np.int32)
    labels: NDArray[np.int32] = np.cumsum(steps[:-1], dtype=np.int32).reshape(rows, cols + 1)
    return labels[:, :cols]


def _join(num: int, left: NDArray[np.intp], right: NDArray[np.intp]) -> NDArray[np.intp]:
    """The smallest member of every member's set; (left, right) are of one set."""
    roots = np.arange(num)
    while True:
        low, high = np.minimum(roots[left], roots[right]), np.maximum(roots[left], roots[right])
        apart = low < high
        if not apart.any():
            return roots
        np.minimum.at(roots, high[apart], low[apart])
        while (roots != roots[roots]).any():
            roots = roots[roots]
