"""The order in which a path visits the quadrants of a grid: "the first order of the Hilbert curve" (section 3.4) in numbers.

The first-order Hilbert curve joins the four quadrants of a square by a U: it begins in the quadrant of a corner, goes on to one
that shares an edge with it, then to the opposite one, and ends in the last. There are two such orders for each corner, which
mirror each other. A path without jumps that visits all four quadrants and enters none of them twice is always one of
the two, unless it passes from a quadrant to the opposite one through the middle cell. So a U by itself says little; that is why
`sweeps` has paths that nobody has trained, to compare with.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.evaluation.intervals import wilson_interval

QUADRANTS = ("north-west", "north-east", "south-east", "south-west")
"""Quadrant codes 0..3 in words, clockwise: codes that differ by 1 or 3 share an edge, by 2 are opposite."""

NO_QUADRANT = -1
"""What cells of the middle row or column of an odd side have: they belong to no quadrant."""

CHANGES_OF_A_U = 3
"""Changes of quadrant of a path that visits all four and goes back to none."""


@dataclass(frozen=True)
class QuadrantCourse:
    """The quadrants of one path.

    entered  quadrant codes in the order of first entry, 1 to 4 of them
    changes  how often the path came into another quadrant than the one that it was in last; cells of no quadrant do not count
    """

    entered: tuple[int, ...]
    changes: int

    @property
    def makes_u(self) -> bool:
        """Whether the first entries are those of a U from the path's first quadrant: all four, the third opposite the first."""
        return len(self.entered) == len(QUADRANTS) and self.entered[2] == (
            self.entered[0] + 2
        ) % len(QUADRANTS)

    @property
    def never_goes_back(self) -> bool:
        """Whether it makes a U with exactly 3 changes of quadrant: it enters each of the four once."""
        return self.makes_u and self.changes == CHANGES_OF_A_U

    @property
    def code(self) -> str:
        """The course as text: the codes entered, a colon, the changes; "0321:3" is a U that goes south first."""
        return f"{''.join(map(str, self.entered))}:{self.changes}"

    @classmethod
    def of_code(cls, code: str) -> QuadrantCourse:
        """Return the course that a code stands for; ValueError for text that is none."""
        entered, colon, changes = code.partition(":")
        if (
            not colon
            or not changes.isdigit()
            or not set(entered) <= set("0123")
            or len(set(entered)) != len(entered)
        ):
            raise ValueError(f'expected the code of a course like "0321:3", got {code!r}')
        return cls(tuple(int(each) for each in entered), int(changes))


@dataclass(frozen=True)
class Rate:
    """A share of episodes, `count` of `total`, with its 95 % Wilson interval; where all cases were counted, no interval."""

    count: int
    total: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """`count` of `total`, 0..1."""
        return self.count / self.total


def rate_of(claims: Iterable[bool], is_complete: bool = False) -> Rate:
    """Return the rate of what is true; ValueError for no claims.

    is_complete  whether these are all cases that there are, and not a sample: then low and high are the share itself
    """
    held = list(claims)
    count, total = sum(held), len(held)
    if not total:
        raise ValueError("a rate is of at least one episode, got none")
    low, high = (count / total,) * 2 if is_complete else wilson_interval(count, total)
    return Rate(count, total, low, high)


def quadrant_map(rows: int, cols: int) -> NDArray[np.int8]:
    """Return int8[rows, cols]: the quadrant code of each cell, NO_QUADRANT in the middle row or column of an odd side."""
    south, east = np.sign(2 * np.arange(rows) - rows + 1), np.sign(2 * np.arange(cols) - cols + 1)
    codes = np.full((rows, cols), NO_QUADRANT, np.int8)
    for code, (down, right) in enumerate(((-1, -1), (-1, 1), (1, 1), (1, -1))):
        codes[np.ix_(south == down, east == right)] = code
    return codes


def quadrant_course(path: Sequence[int], rows: int, cols: int) -> QuadrantCourse:
    """Return the quadrants of a path; ValueError when it never is in any.

    path  the cells in order, flat as row * cols + col
    """
    codes = quadrant_map(rows, cols).reshape(-1)[np.asarray(path, np.int64)]
    codes = codes[codes != NO_QUADRANT]
    if not len(codes):
        raise ValueError(f"the path has no cell in a quadrant of the {rows}x{cols} grid")
    changes = int(np.count_nonzero(np.diff(codes)))
    return QuadrantCourse(tuple(dict.fromkeys(codes.tolist())), changes)
