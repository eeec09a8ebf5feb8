"""A maze of which players see what lies beside the cells they have stood on.

A world of one's own in two modules.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

from humanplay.task import About, Metric, Texts, Words
from humanplay.tasks.base import ExactLock
from humanplay.tasks.text import Cell, TextConfig, TextEnvironment, TextRun

MOVES = {"up": (-1, 0), "right": (0, 1), "down": (1, 0), "left": (0, -1)}
WORDS = Words(
    score="score",
    steps="moves to the goal",
    reached="reached the goal",
    short="short of the goal",
    definition="An episode that ends short of the goal counts max_steps. The score is 1 minus the share of max_steps that the "
    "goal took, and 0 without it.",
    abandoned="at the lowest score, 0",
)


@dataclass(frozen=True)
class MazeConfig(TextConfig):
    """The side of the maze in cells, an odd number, and the most moves."""

    side: int = 9
    limit: int = 120
    level = "maze"

    @property
    def size(self) -> Cell:
        """(rows, cols)."""
        return self.side, self.side

    def __post_init__(self) -> None:
        if not (self.side % 2 and 5 <= self.side <= 41 and 1 <= self.limit <= 10_000):
            raise ValueError(
                f"expected an odd side from 5 to 41 and a limit from 1 to 10,000, got {self}"
            )


@lru_cache(maxsize=256)
def drawn(side: int, seed: int) -> frozenset[Cell]:
    """The free cells of a maze: each two are joined by one way (depth-first search)."""
    dice = random.Random(seed)
    free = {(0, 0)}
    way = [(0, 0)]
    while way:
        row, col = way[-1]
        ahead = [(row + 2 * down, col + 2 * right) for down, right in MOVES.values()]
        ahead = [cell for cell in ahead if cell not in free and 0 <= min(cell) <= max(cell) < side]
        if not ahead:
            way.pop()
            continue
        following = dice.choice(ahead)
        free |= {following, ((row + following[0]) // 2, (col + following[1]) // 2)}
        way.append(following)
    return frozenset(free)


class MazeRun(TextRun):
    """A running episode."""

    names, version = tuple(MOVES), "maze 1"
    config: MazeConfig

    def begin(self) -> None:
        """Stand in the upper left corner."""
        self._free = drawn(self.config.side, self.seed)
        self._seen: set[Cell] = set()
        self._look()

    def _look(self) -> None:
        row, col = self.cell
        self._seen |= {(row + down, col + right) for down in (-1, 0, 1) for right in (-1, 0, 1)}
        self.discovered = len(self._seen & self._free)

    def move(self, action: int) -> float:
        """Go to the next cell, if it is free."""
        down, right = MOVES[self.names[action]]
        ahead = self.cell[0] + down, self.cell[1] + right
        if ahead in self._free:
            self.cell = ahead
        self._look()
        if self.cell != (self.config.side - 1, self.config.side - 1):
            return 0.0
        self.outcome = "succeeded"
        self.score = 1 - len(self.actions) / self.config.limit
        return self.score

    def observation(self) -> str:
        """What is seen: `@` the player, `.` free, `#` a wall, `?` not seen yet."""
        side = range(self.config.side)
        return "\n".join("".join(self._shown((row, col)) for col in side) for row in side)

    def _shown(self, cell: Cell) -> str:
        if cell == self.cell:
            return "@"
        if cell not in self._seen:
            return "?"
        return "." if cell in self._free else "#"


class FarWall:
    """Goes where it has been least, right and down first."""

    name = "far-wall"

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._visits: dict[Cell, int] = {}

    def act(self, observation: str) -> int:
        """The free neighbour that was visited least."""
        rows = observation.split("\n")
        row = next(number for number, text in enumerate(rows) if "@" in text)
        col = rows[row].index("@")
        self._visits[row, col] = self._visits.get((row, col), 0) + 1
        neighbours = {
            code: (row + down, col + right) for code, (down, right) in enumerate(MOVES.values())
        }
        free = {
            code: cell
            for code, cell in neighbours.items()
            if 0 <= min(cell) <= max(cell) < len(rows) and rows[cell[0]][cell[1]] == "."
        }
        return min(free, key=lambda code: (self._visits.get(free[code], 0), code not in (1, 2)))


class MazeEnvironment(TextEnvironment):
    """The maze."""

    name = assets = "maze"
    about = About("Maze", WORDS, "Find the way from the upper left to the lower right corner.")
    lock = ExactLock(MazeRun.version)
    keys = MappingProxyType({name: (f"Arrow{name.capitalize()}",) for name in MOVES})
    metrics = (Metric("score", "", 0.0, 1.0, "higher"),)
    run_of = MazeRun
    policy_classes = (FarWall,)

    def configuration(self, values: Mapping[str, int]) -> MazeConfig:
        """A configuration of some settings; ValueError for others."""
        try:
            return MazeConfig(**values)
        except TypeError as error:
            raise ValueError(f"expected whole numbers side and limit, got {values}") from error

    def texts(self, config: MazeConfig) -> Texts:
        """What pages and studies say of a configuration."""
        cells = f"{config.side} x {config.side}"
        goal = f"A maze of {cells} cells, at most {config.limit} moves."
        return Texts(
            setting=f"a maze of {cells} cells",
            observations="People and policies are given the same: the cells that were seen.",
            briefing=f"{self.about.instructions} {goal}",
            design=goal,
            minutes=0.5,
            study_title="How well do people find their way? ({name})",
            opening="You are invited to take part in a study of how people find their way in mazes.",
            things="mazes",
        )


def environment(variant: str) -> MazeEnvironment:
    """The rules; ValueError if a variant is named, since there is none."""
    if variant:
        raise ValueError(f"the maze has no variants, got {variant!r}")
    return MazeEnvironment()
