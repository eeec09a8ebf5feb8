"""Cells that Expert's move would soon have shown, and when the player saw them.

It puts a cost into a picture. Like the cost it uses the true terrain of a finished episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import UNKNOWN
from marsexplorer.episode import Episode, Record
from marsexplorer.evaluation.mistakes import Mistake
from marsexplorer.evaluation.rollouts import GreedyRollouts
from marsexplorer.policies.network.batch import ActionScorer

SOON = 6
"""Moves, Expert's among them, in which a cell is seen soon."""


@dataclass(frozen=True, eq=False)
class MissedCells:
    """A mistake as it looked to the player, and what Expert's move would have shown.

    codes     uint8[rows, cols], known before the move; discovered: their number
    position  (row, col) of the rover before the move
    cells     int64[num, 2], (row, col): seen within SOON moves after Expert's action, Expert going
              on, and neither known before the move nor seen by the player within as many moves
    seen_at   moves that the player had made when the last of the cells was seen; None if some never
              was, or if there are none
    """

    codes: NDArray[np.uint8]
    discovered: int
    position: tuple[int, int]
    cells: NDArray[np.int64]
    seen_at: int | None


def find_missed(
    record: Record, mistakes: Sequence[Mistake], net: ActionScorer
) -> list[MissedCells]:
    """What was missed by each of some mistakes of an episode, in their order."""
    first_seen = _first_seen(record)
    config = record.config
    player = GreedyRollouts(config, 1, net.rules_that_count(config.rows, config.cols))
    player.worlds.start_on(0, record.terrain_map(), record.start)
    wanted = {mistake.step: mistake for mistake in mistakes}
    missed: dict[int, MissedCells] = {}
    for step, action in enumerate(record.actions):
        rover = player.watch()
        if step in wanted:
            codes = player.worlds.codes[0].copy()
            shown = _seen_soon(player, wanted[step].expert_action, net) & (codes == UNKNOWN)
            late = np.argwhere(shown & (first_seen > step + SOON))
            last = int(first_seen[tuple(late.T)].max(initial=0))
            row, col = divmod(int(rover[0]), config.cols)
            seen_at = last if len(late) and last <= len(record.actions) else None
            missed[step] = MissedCells(
                codes, int(np.count_nonzero(codes)), (row, col), late, seen_at
            )
        player.step(np.array([action]))
    return [missed[mistake.step] for mistake in mistakes]


def _first_seen(record: Record) -> NDArray[np.int64]:
    """The moves made when each cell was seen, int64[rows, cols]; above all if never."""
    episode = Episode.again(record)
    seen = np.where(episode.codes == UNKNOWN, len(record.actions) + SOON + 1, 0)
    for step, action in enumerate(record.actions, 1):
        episode.step(action)
        seen[(episode.codes != UNKNOWN) & (seen > step)] = step
    return seen


def _seen_soon(player: GreedyRollouts, action: int, net: ActionScorer) -> NDArray[np.bool_]:
    """The cells known SOON moves after `action`, Expert going on: bool[rows, cols]."""
    branch = player.subset(np.zeros(1, np.intp))
    branch.step(np.array([action]))
    for _ in range(SOON - 1):
        if branch.running[0]:
            branch.step(branch.decide(net).actions)
    is_known: NDArray[np.bool_] = branch.worlds.codes[0] != UNKNOWN
    return is_known
