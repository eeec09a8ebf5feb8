"""What pictures draw of an episode, and what sentences call it and its driver."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor

import numpy as np
from numpy.typing import NDArray

from humanplay.task import beat_text, counted
from marsexplorer.config import EnvConfig

NEVER = -1
"""The move at which a cell became known that never did."""
PLAIN_POLICIES = {
    "ppo": "Expert", "frontier-cost": "Nearest", "frontier-utility": "Greedy", "frontier-priced": "Tidy",
    "lookahead": "Expert that knows how terrains are made", "random": "Random",
}  # fmt: skip
"""Names of policies as pages and pictures say them; `static/task/mars/words.js` has the same."""
PLAIN_LEVELS = {
    "1-1-1": "Open", "random": "Scattered", "3-2-1": "Boulders", "building": "Building", "cave": "Cave"
}  # fmt: skip
"""Those of levels; any other has the paper's code."""


@dataclass(frozen=True)
class DrawnEpisode:
    """What is drawn of an episode; index k of each sequence is after k moves.

    name        who drove
    config      of the episode
    actions     codes of config.ACTIONS, one a move
    path        (row, col) of the rover, one more than actions
    discovered  cells known, one more than actions
    cells       that coverage refers to: all, or those that can be discovered
    codes       uint8[rows, cols], what was known at the end, the rover's cell as FREE
    known_since int32[rows, cols], after how many moves each cell was known; NEVER for one that was not
    outcome     in words
    score       normalized, at the end
    """

    name: str
    config: EnvConfig
    actions: bytes
    path: tuple[tuple[int, int], ...]
    discovered: tuple[int, ...]
    cells: int
    codes: NDArray[np.uint8]
    known_since: NDArray[np.int32]
    outcome: str
    score: float

    @property
    def moves(self) -> int:
        """Moves in all."""
        return len(self.actions)

    def coverage(self, step: int) -> float:
        """Return the share of known cells after some moves, 0..1; constant after the end."""
        return self.discovered[min(step, self.moves)] / self.cells

    @property
    def headline(self) -> str:
        """Who did what: `A person mapped 99 % of the ground in 75 moves`."""
        return f"{self.plain_name} {sentence(self)}"

    @property
    def challenge(self) -> str:
        """What is to be beaten: `85 moves. Beat it.`"""
        return beat_text(self.moves, self.outcome == "explored")

    @property
    def plain_name(self) -> str:
        """Who drove, a policy by its plain name."""
        return PLAIN_POLICIES.get(self.name, self.name)


def sentence(course: DrawnEpisode) -> str:
    """Return the outcome, after the name: `mapped 99 % of the ground in 75 moves`."""
    share, moves = f"{floor(1000 * course.coverage(course.moves) + 1e-6) / 10:.1f} %", course.moves
    count = counted(moves, "move")
    return {
        "explored": f"mapped {share} of the ground in {count}",
        "collided": f"crashed into a rock at {share} after {count}",
        "out_of_bounds": f"drove off the map at {share} after {count}",
        "timed_out": f"ran out of moves at {share} after {count}",
    }.get(course.outcome, f"left at {share} after {count}")
