"""Where a policy goes, and which obstacles it finds: figure 6 (section 3.4).

**Quadrants**: "the first order of the Hilbert curve" (section 3.4) in numbers.

The first-order Hilbert curve joins the four quadrants of a square by a U: it begins in the quadrant
of a corner, goes on to one that shares an edge with it, then to the opposite one, and ends in the
last. There are two such orders for each corner, which mirror each other. A path without jumps that
visits all four quadrants and enters none of them twice is always one of the two, unless it passes
from a quadrant to the opposite one through the middle cell. So a U by itself proves little; that is
why `walks` has paths that nobody has trained, to compare with.

**Maps** of a result are lists of rows * cols counts, row by row, over the episodes:

    visits        moves that ended on the cell; the start counts once an episode
    drawn         episodes in which the terrain has an obstacle there
    discoverable  of these, the ones that some free cell can see: an obstacle that only obstacles
                  surround is hidden for ever
    found         of these, the ones that were known when the episode ended

`courses` has the quadrants of each episode's path, as `QuadrantCourse.code` writes them.

Claim: "the arrangement of discovered obstacles matches the drawn distribution, implying that the
learned policy does not have any blind spots". An episode ends with 99 % of the cells, so some
obstacles are always missed. Here a cell is a **blind spot** when obstacles could be discovered
there in at least BLIND_EPISODES episodes and fewer than half of them were.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import Result
from marsexplorer.evaluation.plots import heat_maps
from marsexplorer.intervals import wilson_interval
from marsexplorer.terrain import generate
from research.paper.episodes.play import Play
from research.paper.jobs import Line
from research.paper.tables import Estimate

MAPS = ("visits", "drawn", "discoverable", "found")
"""The maps of a result."""

BLIND_EPISODES = 5
"""Fewest obstacles on a cell for it to be called a blind spot."""

BLIND_SHARE = 0.5
"""A blind spot is a cell where a smaller share of the obstacles was found, 0..1."""

Counts = NDArray[np.int64]


QUADRANTS = ("north-west", "north-east", "south-east", "south-west")
"""Quadrant codes 0..3 in words, clockwise: codes that differ by 1 or 3 share an edge, by 2 are
opposite.
"""

NO_QUADRANT = -1
"""The code of the middle row's or column's cells of an odd side: they are in no quadrant."""

CHANGES_OF_A_U = 3
"""Changes of quadrant of a path that visits all four and goes back to none."""


@dataclass(frozen=True)
class QuadrantCourse:
    """The quadrants of one path.

    entered  quadrant codes in the order of first entry, 1 to 4 of them
    changes  how often the path entered another quadrant than its last; cells of no quadrant do not
             count
    """

    entered: tuple[int, ...]
    changes: int

    @property
    def makes_u(self) -> bool:
        """Whether the first entries make a U: all four, the third opposite the first."""
        return len(self.entered) == len(QUADRANTS) and self.entered[2] == (
            self.entered[0] + 2
        ) % len(QUADRANTS)

    @property
    def never_goes_back(self) -> bool:
        """Whether it makes a U and enters each quadrant once, by exactly 3 changes."""
        return self.makes_u and self.changes == CHANGES_OF_A_U

    @property
    def code(self) -> str:
        """The course as text: the codes entered, a colon, the changes.

        "0321:3" is a U that goes south first.
        """
        return f"{''.join(map(str, self.entered))}:{self.changes}"

    @classmethod
    def of_code(cls, code: str) -> QuadrantCourse:
        """Read a course from its code; ValueError if it is not one."""
        if not re.fullmatch(r"(?:([0-3])(?!.*\1.*:))+:\d+", code):
            raise ValueError(f'expected the code of a course like "0321:3", got {code!r}')
        entered, changes = code.split(":")
        return cls(tuple(map(int, entered)), int(changes))


@dataclass(frozen=True)
class Rate(Estimate):
    """A share of episodes, `count` of `total`, with its 95 % Wilson interval.

    If all cases were counted, it has no interval.
    """

    count: int
    total: int


def rate_of(claims: Iterable[bool], is_complete: bool = False) -> Rate:
    """The rate of true claims; ValueError if there are none.

    is_complete  whether these are all cases that there are, and not a sample: then low and high are
                 the share itself
    """
    held = list(claims)
    count, total = sum(held), len(held)
    if not total:
        raise ValueError("a rate is of at least one episode, got none")
    low, high = (count / total,) * 2 if is_complete else wilson_interval(count, total)
    return Rate(count / total, low, high, count, total)


def quadrant_map(rows: int, cols: int) -> NDArray[np.int8]:
    """The quadrant code of each cell, NO_QUADRANT in the middle: int8[rows, cols]."""
    south, east = np.sign(2 * np.arange(rows) - rows + 1), np.sign(2 * np.arange(cols) - cols + 1)
    codes = np.full((rows, cols), NO_QUADRANT, np.int8)
    for code, (down, right) in enumerate(((-1, -1), (-1, 1), (1, 1), (1, -1))):
        codes[np.ix_(south == down, east == right)] = code
    return codes


def quadrant_course(path: Sequence[int], rows: int, cols: int) -> QuadrantCourse:
    """The quadrants of a path; ValueError if it never is in any.

    path  the cells in order, flat as row * cols + col
    """
    codes = quadrant_map(rows, cols).reshape(-1)[np.asarray(path, np.int64)]
    codes = codes[codes != NO_QUADRANT]
    if not len(codes):
        raise ValueError(f"the path has no cell in a quadrant of the {rows}x{cols} grid")
    changes = int(np.count_nonzero(np.diff(codes)))
    return QuadrantCourse(tuple(dict.fromkeys(codes.tolist())), changes)


@dataclass(frozen=True)
class Visits(Play):
    """The episodes of one policy on one level, for figure 6."""

    figure: ClassVar[int] = 6
    kind: ClassVar[str] = "visits"

    def measure(self, results: Sequence[Result]) -> Line:
        """The maps and the courses, JSON-ready."""
        config = self.config
        visits, discovered = heat_maps(results, config)
        drawn, discoverable = obstacle_maps(config, [result.seed for result in results])
        maps = dict(zip(MAPS, (visits, drawn, discoverable, discovered), strict=True))
        courses = [course_of(result).code for result in results]
        return {
            **{name: counts.reshape(-1).tolist() for name, counts in maps.items()},
            "courses": courses,
        }


@dataclass(frozen=True)
class Obstacles:
    """How the obstacles that were found match those that were drawn.

    found_share      found over discoverable, all cells together, 0..1
    distance         total variation distance between the distributions of drawn and of found
                     obstacles over the cells, 0..1: the share of the obstacles found that would
                     have to be moved to make them alike
    correlation      of drawn and found over the cells, -1..1
    blind_spots      cells that are blind spots, flat
    """

    found_share: float
    distance: float
    correlation: float
    blind_spots: tuple[int, ...]


def course_of(result: Result) -> QuadrantCourse:
    """The quadrants of an episode's path; the result must have its trace."""
    assert result.trace is not None
    return quadrant_course(result.trace.path, result.rows, result.cols)


def obstacle_maps(config: EnvConfig, seeds: Sequence[int]) -> tuple[Counts, Counts]:
    """(drawn, discoverable) over the terrains of some seeds, int64[rows, cols] each."""
    drawn = np.zeros((config.rows, config.cols), np.int64)
    discoverable = np.zeros_like(drawn)
    for seed in seeds:
        terrain = generate(config, seed)
        drawn += terrain
        discoverable += terrain & has_free_neighbour(terrain, config.sensor_radius > 1)
    return drawn, discoverable


def has_free_neighbour(terrain: NDArray[np.bool_], with_corners: bool) -> NDArray[np.bool_]:
    """Whether a free cell shares an edge or a corner with each cell: bool[rows, cols].

    Corners count only `with_corners`. An obstacle can be discovered exactly if this holds (corners
    count for radii above 1), see `marsexplorer.terrain`.
    """
    rows, cols = terrain.shape
    free = np.pad(~terrain, 1)
    has_free = np.zeros_like(terrain)
    for down in (0, 1, 2):
        for right in (0, 1, 2):
            if (down == 1) != (right == 1) or (with_corners and down != 1 and right != 1):
                has_free |= free[down : down + rows, right : right + cols]
    return has_free


def map_of(line: Line, name: str) -> Counts:
    """A map of a result, int64[rows, cols]; `name` is one of MAPS."""
    return np.array(line[name], np.int64).reshape(line["rows"], line["cols"])


def obstacles_of(line: Line) -> Obstacles:
    """How the obstacles found match those drawn, from a result."""
    drawn, discoverable, discovered = (map_of(line, name) for name in MAPS[1:])
    blind = (discoverable >= BLIND_EPISODES) & (discovered < BLIND_SHARE * discoverable)
    return Obstacles(
        found_share=float(discovered.sum() / max(1, discoverable.sum())),
        distance=float(
            abs(drawn / max(1, drawn.sum()) - discovered / max(1, discovered.sum())).sum() / 2
        ),
        correlation=float(np.corrcoef(drawn.reshape(-1), discovered.reshape(-1))[0, 1])
        if discovered.std() and drawn.std()
        else 0.0,
        blind_spots=tuple(np.flatnonzero(blind).tolist()),
    )


def course_rates(line: Line) -> tuple[Rate, Rate]:
    """The rates of episodes that make a U, and that never go back.

    line  a result of a policy or of a null
    """
    courses = [QuadrantCourse.of_code(code) for code in line["courses"]]
    is_complete = line.get("is_complete", False)
    makes_u = rate_of((course.makes_u for course in courses), is_complete)
    return makes_u, rate_of((course.never_goes_back for course in courses), is_complete)
