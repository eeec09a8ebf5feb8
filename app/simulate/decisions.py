"""The compiled decisions of synthetic players: `frontier-cost` that slips and crashes, for one board or for thousands.

The same kernel drives a player at a server, from frames, and the thousands of episodes from which a population's true
level is computed. What it draws depends on (stream, move) alone, so an episode taken up again after a lost connection goes
on exactly as it would have.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.observation import EAST, is_valid
from marsexplorer.policies.frontier import toward_nearest
from marsexplorer.policies.kernels.grid import GridScratch
from marsexplorer.policies.kernels.visibility import VisibilityMap
from marsexplorer.random_numbers import GAMMA, below, uniform

DRAWS_PER_MOVE = 4
"""The numbers of the stream that are reserved for a move."""


@kernel
def random_move(codes, row, col, wants_valid, state):
    """Return one of the valid (or of the invalid) moves from a cell, each as likely; -1 when there is none."""
    chosen, found = -1, 0
    kind = np.int64(wants_valid)
    for count in range(2):
        wanted = below(state, found) if count and found else 0
        seen = 0
        for action in range(4):
            if np.int64(is_valid(codes, row, col, action)) == kind:
                if count and seen == wanted:
                    chosen = action
                seen += 1
        found = seen
    return chosen


@kernel
def decide(
    codes, visited, position, heading, is_running, slip, crash, stream, moves, state, actions, view, scratch, goal,
):  # fmt: skip
    """Write the next action of every running board, and bring `visited` and `heading` up to date.

    codes uint8[num, rows, cols] · visited uint8[num, rows, cols] · position int64[num, 2] · heading, actions int64[num] ·
    slip, crash float64[num] · stream uint64[num] · moves int64[num], made so far ·
    view (`visibility`), scratch (`grid`) and goal (`toward_nearest`) for one board
    """
    for i in range(codes.shape[0]):
        if not is_running[i]:
            continue
        row, col = position[i, 0], position[i, 1]
        visited[i, row, col] = 1
        state[0] = stream[i] + np.uint64(moves[i] * DRAWS_PER_MOVE) * GAMMA
        luck = uniform(state)
        action = -1
        if luck < crash[i]:
            action = random_move(codes[i], row, col, False, state)
        elif luck < crash[i] + slip[i]:
            action = random_move(codes[i], row, col, True, state)
        if action < 0:
            action = toward_nearest(codes[i], visited[i], row, col, heading[i], view, scratch, goal)
        if action < 0:
            action = max(np.int64(0), random_move(codes[i], row, col, True, state))
        heading[i] = action
        actions[i] = action


class DecisionKernel:
    """The decisions for a stack of boards of one shape, and the memory that they need.

    visited   uint8[num, rows, cols], 1 where a rover has stood
    heading   int64[num], the last action; east before the first
    """

    def __init__(self, shape: tuple[int, int], radius: int, num: int = 1) -> None:
        self.visited = np.zeros((num, *shape), np.uint8)
        self.heading = np.full(num, EAST)
        self._actions = np.zeros(num, np.int64)
        self._state = np.zeros(1, np.uint64)
        self._scratch = VisibilityMap(shape, radius).view, GridScratch(shape).arrays, np.full(1, -1)

    def decide(
        self,
        codes: NDArray[np.uint8],
        position: NDArray[np.int64],
        is_running: NDArray[np.bool_],
        style: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint64]],
        moves: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the actions, int64[num]: the same array each time.

        codes     uint8[num, rows, cols], the occupancy grids as known
        position  int64[num, 2], (row, col)
        style     (slip, crash, stream) of each board's episode: two probabilities per move, and the seed of its random stream
        moves     int64[num], made so far
        """
        decide(
            codes, self.visited, position, self.heading, is_running, *style, moves, self._state, self._actions, *self._scratch
        )  # fmt: skip
        return self._actions
