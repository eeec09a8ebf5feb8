"""The compiled decisions of synthetic players: `frontier-cost` that slips and crashes, for one board or for thousands.

The same kernel drives a player at a server, from frames, and the thousands of episodes from which a population's true
level is computed. What it draws depends on (stream, move) alone, so an episode taken up again after a lost connection goes
on exactly as it would have.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.config import OBSTACLE
from marsexplorer.policies.base import EAST
from marsexplorer.policies.frontier import toward_nearest
from marsexplorer.policies.kernels.grid import Ground
from marsexplorer.policies.kernels.visibility import Outlook
from marsexplorer.policies.planner import below, uniform

DRAWS_PER_MOVE = 4
"""The numbers of the stream that are reserved for a move."""
STREAM_STEP = 0x9E3779B97F4A7C15
"""What SplitMix64 adds to its state for each number (2**64 divided by the golden ratio)."""


@kernel
def random_move(codes, row, col, wants_valid, state):
    """Return one of the valid (or of the invalid) moves from a cell, each as likely; -1 when there is none."""
    rows, cols = codes.shape
    chosen, found = -1, 0
    kind = np.int64(wants_valid)
    for count in range(2):
        wanted = below(state, found) if count and found else 0
        seen = 0
        for action in range(4):
            r = row + np.int64(action == 2) - np.int64(action == 0)
            c = col + np.int64(action == 1) - np.int64(action == 3)
            is_valid = 0 <= r < rows and 0 <= c < cols and codes[r, c] != OBSTACLE
            if np.int64(is_valid) == kind:
                if count and seen == wanted:
                    chosen = action
                seen += 1
        found = seen
    return chosen


@kernel
def decide(
    codes, visited, position, heading, is_running, slip, crash, stream, moves, state, actions,
    radius, unknown, blocked, sight, seen, is_open, distance, queue,
):  # fmt: skip
    """Write the next action of every running board, and bring `visited` and `heading` up to date.

    codes uint8[num, rows, cols] · visited uint8[num, rows, cols] · position int64[num, 2] · heading, actions int64[num] ·
    slip, crash float64[num] · stream uint64[num] · moves int64[num], made so far · the rest is scratch for one board
    """
    for i in range(codes.shape[0]):
        if not is_running[i]:
            continue
        row, col = position[i, 0], position[i, 1]
        visited[i, row, col] = 1
        state[0] = stream[i] + np.uint64(moves[i] * DRAWS_PER_MOVE) * np.uint64(STREAM_STEP)
        luck = uniform(state)
        action = -1
        if luck < crash[i]:
            action = random_move(codes[i], row, col, False, state)
        elif luck < crash[i] + slip[i]:
            action = random_move(codes[i], row, col, True, state)
        if action < 0:
            action = toward_nearest(
                codes[i], visited[i], row, col, heading[i], radius, unknown, blocked, sight, seen, is_open, distance, queue
            )
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
        outlook, ground = Outlook(shape, radius), Ground(shape)
        self._scratch = (
            radius, outlook.unknown, outlook.blocked, outlook.sight, outlook.seen,
            ground.is_open, ground.distance, ground.queue,
        )  # fmt: skip

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
