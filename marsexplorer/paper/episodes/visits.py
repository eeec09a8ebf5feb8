"""Where a policy goes and which obstacles it finds: the measures of figure 6 (section 3.4).

The maps of a result are lists of rows * cols counts, row by row, over the episodes:

    visits        moves that ended on the cell; the start counts once an episode
    drawn         episodes in which the terrain has an obstacle there
    discoverable  of these, the ones that some free cell can see: an obstacle that only obstacles surround is hidden for ever
    found         of these, the ones that were known when the episode ended

`courses` has the quadrants of each episode's path, as `QuadrantCourse.code` writes them.

Claim: "the arrangement of discovered obstacles matches the drawn distribution, implying that the learned policy does not have
any blind spots". An episode ends with 99 % of the cells, so some obstacles are always missed. Here a cell is a **blind spot**
when obstacles could be discovered there in at least BLIND_EPISODES episodes and fewer than half of them were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import Result
from marsexplorer.evaluation.plots import heat_maps
from marsexplorer.paper.episodes.play import Line, Play
from marsexplorer.paper.episodes.quadrants import QuadrantCourse, Rate, quadrant_course, rate_of
from marsexplorer.terrain import generate

MAPS = ("visits", "drawn", "discoverable", "found")
"""The maps of a result."""

BLIND_EPISODES = 5
"""Fewest obstacles on a cell for it to be called a blind spot."""

BLIND_SHARE = 0.5
"""A blind spot is a cell where a smaller share of the obstacles was found, 0..1."""

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Visits(Play):
    """The episodes of one policy on one level, for figure 6."""

    figure: ClassVar[int] = 6
    kind: ClassVar[str] = "visits"

    def measure(self, results: Sequence[Result]) -> Line:
        """Return the maps and the courses, JSON-ready."""
        config = self.config
        visits, found = heat_maps(results, config)
        drawn, discoverable = obstacle_maps(config, [result.seed for result in results])
        maps = dict(zip(MAPS, (visits, drawn, discoverable, found), strict=True))
        courses = [course_of(result).code for result in results]
        return {
            **{name: counts.reshape(-1).tolist() for name, counts in maps.items()},
            "courses": courses,
        }


@dataclass(frozen=True)
class Obstacles:
    """How the obstacles that were found match those that were drawn.

    found_share      found over discoverable, all cells together, 0..1
    distance         total variation distance between the distributions of drawn and of found obstacles over the cells, 0..1:
                     the share of the obstacles found that would have to be moved to make them alike
    correlation      of drawn and found over the cells, -1..1
    quadrant_shares  found_share in each quadrant, north-west, north-east, south-east, south-west
    blind_spots      cells that are blind spots, flat
    """

    found_share: float
    distance: float
    correlation: float
    quadrant_shares: tuple[float, float, float, float]
    blind_spots: tuple[int, ...]


def course_of(result: Result) -> QuadrantCourse:
    """Return the quadrants of an episode's path; the result must have its trace."""
    assert result.trace is not None
    return quadrant_course(result.trace.path, result.rows, result.cols)


def obstacle_maps(config: EnvConfig, seeds: Sequence[int]) -> tuple[Counts, Counts]:
    """Return (drawn, discoverable) over the terrains of some seeds, int64[rows, cols] each."""
    drawn = np.zeros((config.rows, config.cols), np.int64)
    discoverable = np.zeros_like(drawn)
    for seed in seeds:
        terrain = generate(config, seed)
        drawn += terrain
        discoverable += terrain & has_free_neighbour(terrain, config.sensor_radius > 1)
    return drawn, discoverable


def has_free_neighbour(terrain: NDArray[np.bool_], with_corners: bool) -> NDArray[np.bool_]:
    """Return bool[rows, cols]: whether a free cell shares an edge or, `with_corners`, a corner with the cell.

    An obstacle can be discovered exactly when that holds (corners count for radii above 1), see `marsexplorer.terrain`.
    """
    rows, cols = terrain.shape
    free = np.pad(~terrain, 1)
    found = np.zeros_like(terrain)
    for down in (0, 1, 2):
        for right in (0, 1, 2):
            if (down == 1) != (right == 1) or (with_corners and down != 1 and right != 1):
                found |= free[down : down + rows, right : right + cols]
    return found


def map_of(line: Line, name: str) -> Counts:
    """Return a map of a result, int64[rows, cols]; `name` is one of MAPS."""
    return np.array(line[name], np.int64).reshape(line["rows"], line["cols"])


def obstacles_of(line: Line, quadrants: NDArray[Any]) -> Obstacles:
    """Return how the obstacles found match those drawn, from a result and `quadrant_map` of its size."""
    drawn, discoverable, found = (map_of(line, name) for name in MAPS[1:])
    shares = [
        found[quadrants == code].sum() / max(1, discoverable[quadrants == code].sum())
        for code in range(4)
    ]
    blind = (discoverable >= BLIND_EPISODES) & (found < BLIND_SHARE * discoverable)
    return Obstacles(
        found_share=float(found.sum() / max(1, discoverable.sum())),
        distance=float(abs(drawn / max(1, drawn.sum()) - found / max(1, found.sum())).sum() / 2),
        correlation=float(np.corrcoef(drawn.reshape(-1), found.reshape(-1))[0, 1])
        if found.std() and drawn.std()
        else 0.0,
        quadrant_shares=(float(shares[0]), float(shares[1]), float(shares[2]), float(shares[3])),
        blind_spots=tuple(np.flatnonzero(blind).tolist()),
    )


def course_rates(line: Line) -> tuple[Rate, Rate]:
    """Return the rates of episodes that make a U, and that never go back; from a result of a policy or of a null."""
    courses = [QuadrantCourse.of_code(code) for code in line["courses"]]
    is_complete = line.get("is_complete", False)
    makes_u = rate_of((course.makes_u for course in courses), is_complete)
    return makes_u, rate_of((course.never_goes_back for course in courses), is_complete)
