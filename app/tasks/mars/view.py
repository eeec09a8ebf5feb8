"""What may be seen of an episode after some of its moves."""

from __future__ import annotations

from marsexplorer.config import ACTIONS, OUTCOMES, RUNNING
from marsexplorer.episode import Episode
from marsexplorer.score import score


class View:
    """An episode as it stands now, which stays as it is while the episode goes on; the terrain is not in it.

    codes  uint8[rows, cols], what is known: UNKNOWN 0, FREE 1, ROVER 2, OBSTACLE 3
    The other attributes are those of `marsexplorer.episode.Episode`.
    """

    def __init__(self, episode: Episode) -> None:
        self._episode = episode
        self.config = episode.config
        self.codes = episode.codes.copy()
        self.position, self.discovered, self.cells = (
            episode.position,
            episode.discovered,
            episode.cells,
        )
        self.steps, self.outcome = episode.steps, episode.outcome
        self.reward, self.total = episode.reward, episode.total

    def is_of_same_run(self, other: View) -> bool:
        """Return whether the other view is one of the same episode, as it was or as it went on."""
        return self._episode is other._episode

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome != OUTCOMES[RUNNING]

    @property
    def coverage(self) -> float:
        """Discovered cells over the cells that count, 0..1."""
        return self.discovered / self.cells

    @property
    def score(self) -> float:
        """The normalized score so far (section 3.2)."""
        return score(self.config, self.total, self.cells)

    @property
    def heading(self) -> str:
        """Direction of the last move in words, `east` before the first."""
        return ACTIONS[self._episode.actions[self.steps - 1]] if self.steps else "east"

    @property
    def actions(self) -> bytes:
        """The moves so far, a byte each, codes 0..3."""
        return bytes(self._episode.actions[: self.steps])

    @property
    def path(self) -> list[tuple[int, int]]:
        """(row, col) of the rover after 0, 1, 2, ... moves: a new list."""
        return self._episode.path[: self.steps + 1]

    @property
    def discoveries(self) -> list[int]:
        """Cells discovered after 0, 1, 2, ... moves: a new list."""
        return list(self._episode.discoveries[: self.steps + 1])
