"""Synthetic players, many in memory at once, and their populations.

A player follows `frontier-cost` and slips now and then into a random valid move. Players differ in
how often (skill), and one player's episodes differ among themselves (luck). On top of that a move
that could end in an obstacle or off the grid does so with a small probability of the player's own,
spread unevenly: a few people make most of the collisions. What a player draws depends on (stream,
move) alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.observation import EAST, is_valid
from marsexplorer.policies.frontier import toward_nearest
from marsexplorer.policies.kernels.grid import grid_scratch
from marsexplorer.policies.kernels.visibility import VisibilityMap
from marsexplorer.random_numbers import GAMMA, below, uniform

DRAWS_PER_MOVE = 4
"""The numbers of the stream that are reserved for a move."""


@dataclass(frozen=True)
class SimulatedPopulation:
    """A distribution from which players are drawn.

    slip          share of moves that slip for the median player, in (0, 1)
    skill_sd      SD between players of the slip, in logits
    luck_sd       SD between one player's episodes of the slip, in logits
    crash         probability of a crash per move next to something to crash into, for the median
                  player, in [0, 1)
    crash_sd      SD between players of the logarithm of that probability
    """

    name: str
    slip: float
    skill_sd: float
    luck_sd: float
    crash: float = 0.0
    crash_sd: float = 0.0


@dataclass(frozen=True)
class Skills:
    """Players drawn from a population: slip in logits, and probability of a crash."""

    slip_logit: NDArray[np.float64]
    crash: NDArray[np.float64]
    luck_sd: float

    def draw_episodes(
        self, players: NDArray[np.int64], rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw one episode for each entry of `players` and return its (slip, crash)."""
        logit = self.slip_logit[players] + self.luck_sd * rng.standard_normal(len(players))
        return 1.0 / (1.0 + np.exp(-logit)), self.crash[players]


SIMULATED_POPULATIONS = {
    each.name: each
    for each in (
        SimulatedPopulation("skilled", slip=0.05, skill_sd=0.5, luck_sd=0.4),
        SimulatedPopulation(
            "mixed", slip=0.15, skill_sd=1.0, luck_sd=0.5, crash=0.0001, crash_sd=1.0
        ),
        SimulatedPopulation(
            "clumsy", slip=0.25, skill_sd=0.9, luck_sd=0.5, crash=0.002, crash_sd=1.2
        ),
    )
}
"""By name: hardly any slips; people as different as people are; slips everywhere, and collisions
by a few.
"""

RANDOM_MOVES = SimulatedPopulation("random", slip=1.0 - 1e-12, skill_sd=0.0, luck_sd=0.0)
"""Players whose every move is a random valid one."""


def draw_players(population: SimulatedPopulation, players: int, rng: np.random.Generator) -> Skills:
    """Draw `players` players."""
    logit = np.log(population.slip / (1.0 - population.slip))
    slip = logit + population.skill_sd * rng.standard_normal(players)
    spread = np.exp(population.crash_sd * rng.standard_normal(players))
    return Skills(slip, np.minimum(population.crash * spread, 1.0), population.luck_sd)


@kernel
def random_move(codes, row, col, wants_valid, state):
    """One of the valid (or of the invalid) moves from a cell, or -1."""
    chosen, candidates = -1, 0
    kind = np.int64(wants_valid)
    for count in range(2):
        wanted = below(state, candidates) if count and candidates else 0
        seen = 0
        for action in range(4):
            if np.int64(is_valid(codes, row, col, action)) == kind:
                if count and seen == wanted:
                    chosen = action
                seen += 1
        candidates = seen
    return chosen


@kernel
def decide(
    codes,
    visited,
    position,
    heading,
    is_running,
    slip,
    crash,
    stream,
    moves,
    state,
    actions,
    view,
    scratch,
    goal,
):
    """Write the next action of every running board; update `visited` and `heading`.

    codes uint8[num, rows, cols] · visited uint8[num, rows, cols] · position int64[num, 2] ·
    heading, actions int64[num] · slip, crash float64[num] · stream uint64[num] · moves int64[num],
    made so far · view (`visibility`), scratch (`grid`) and goal (`toward_nearest`) for one board
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
        self._scratch = VisibilityMap(shape, radius).view, grid_scratch(shape), np.full(1, -1)

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
        style     (slip, crash, stream) of each board's episode: two probabilities per move, and the
                  seed of its random stream
        moves     int64[num], made so far
        """
        decide(
            codes,
            self.visited,
            position,
            self.heading,
            is_running,
            *style,
            moves,
            self._state,
            self._actions,
            *self._scratch,
        )
        return self._actions
