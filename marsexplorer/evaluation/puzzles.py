"""Puzzles: positions in which one first move is clearly better than each other.

The moves are compared over terrains that agree with what is seen.

A rule drives over terrains of SEEDS. At its positions each move to a known free cell is tried on
many terrains that agree with what is known (`kernels.posterior`), and the priced rule drives on to
99 %. A position is taken only if its best first move saves LEAST_SAVED moves on average against
each other move, and more than two standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from marsexplorer import policies
from marsexplorer.config import ACTIONS, OBSTACLE, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.observation import DISPLACEMENTS, decode
from marsexplorer.policies.base import Memory
from marsexplorer.policies.kernels.grid import completion_target, neighbour
from marsexplorer.policies.kernels.posterior import move_chains
from marsexplorer.policies.kernels.prices import update_board
from marsexplorer.policies.kernels.rollouts import BLOCK, MOST_MOVES, compare, fill_truths
from marsexplorer.policies.kernels.visibility import word_and_bit
from marsexplorer.policies.lookahead import LookaheadArrays

SEEDS = range(6 * 10**12, 6 * 10**12 + 10**6)
"""The seeds of the terrains; of seeds drawn elsewhere about one in nine thousand million is here."""
CONFIG = EnvConfig.of("random", 21)
DRIVER = "frontier-cost"
"""The rule that drives to the positions."""
KNOWN = (0.2, 0.95)
"""Share of the cells that is known in a position."""
TERRAINS = 96
"""Terrains that are drawn for a position."""
FEWEST_TERRAINS = 32
"""Of them those that count, at least."""
SCREENED = 16
"""Of them those on which a position must look promising before all are tried."""
LEAST_SAVED = 6.0
"""Moves that the best first move saves on average against each other one."""
SWEEPS = 4
"""Gibbs steps of each rectangle before a position is judged."""
RULE = "frontier-priced"
"""The rule that drives on after a first move."""
SHOWN_MOVES = 8
"""Moves, the first one among them, whose new cells show what a first move is good for."""


@dataclass(frozen=True)
class Puzzle:
    """A position and its answer.

    codes    uint8[rows, cols], what is known
    trail    the cells that the rover has stood on, from the start
    heading  of the last move
    means    moves from here to 99 % on average, by the first move
    saves    of the best first move against the next best, on average over `terrains`, with its
             standard error
    here     the same on the terrain itself
    shows    the cells that are new there within SHOWN_MOVES, by the first move
    """

    codes: NDArray[np.uint8]
    trail: tuple[tuple[int, int], ...]
    heading: str
    means: dict[str, float]
    answer: str
    saves: float
    error: float
    terrains: int
    here: int
    shows: dict[str, list[tuple[int, int]]]


@dataclass(frozen=True)
class Verdict:
    """What a position's first moves come to, see `Puzzle`."""

    means: dict[str, float]
    answer: str
    saves: float
    error: float
    terrains: int
    here: int


class Judge:
    """Tries first moves of an episode's positions; `look` is called at each in turn."""

    def __init__(self, seed: int, terrain: NDArray[np.bool_]) -> None:
        self._arrays = LookaheadArrays((CONFIG.rows, CONFIG.cols), CONFIG.sensor_radius, TERRAINS)
        self._state = np.array([seed], np.uint64)
        self._true_terrain = self._bits(terrain)

    def _bits(self, terrain: NDArray[np.bool_]) -> NDArray[np.uint64]:
        stride, radius = self._arrays.board.board[2][4:]
        bits = np.zeros((1, self._arrays.truths.shape[1]), np.uint64)
        for row, col in np.argwhere(terrain):
            word, bit = word_and_bit(int(row), int(col), stride, radius)
            bits[0, word] |= bit
        return bits

    def look(self, memory: Memory) -> Verdict | None:
        """Update the terrains and judge the moves here; None if this is no puzzle."""
        codes, visited, (row, col) = memory.codes, memory.visited, memory.position
        arrays, (rows, cols) = self._arrays, codes.shape
        cell = row * cols + col
        board, target = arrays.board, int(completion_target(rows * cols))
        left = update_board(codes, board.board, arrays.half_sides, board.changed_columns)
        known_cells = rows * cols - int(left)
        is_judged = KNOWN[0] <= known_cells / (rows * cols) < KNOWN[1]
        sweeps = SWEEPS if is_judged else 1
        count = move_chains(
            arrays.chains, board.board[0], rows, cols, target, sweeps, is_judged, self._state
        )
        moves = _free_moves(codes.reshape(-1), cell, rows, cols)
        if not is_judged or count < FEWEST_TERRAINS or len(moves) < 2:
            return None
        stride, radius = board.board[2][4:]
        fill_truths(arrays.chains, rows, cols, stride, radius, arrays.truths)
        most = MOST_MOVES * rows * cols
        rover = cell, known_cells
        costs = self._tried(list(moves.values()), arrays.truths, SCREENED, rover, visited)
        if np.sort(costs.mean(1))[1] - costs.mean(1).min() < LEAST_SAVED / 2:
            return None
        costs = self._tried(list(moves.values()), arrays.truths, count, rover, visited)
        costs = costs[:, (costs < most).all(0)]  # without terrains on which the rule gets stuck
        if costs.shape[1] < FEWEST_TERRAINS:
            return None
        best = int(costs.mean(1).argmin())
        others = [k for k in range(len(moves)) if k != best]
        saved = costs[others] - costs[best]
        means, errors = saved.mean(1), saved.std(1, ddof=1) / np.sqrt(saved.shape[1])
        if (means < LEAST_SAVED).any() or (means <= 2 * errors).any():
            return None
        here = self._tried(list(moves.values()), self._true_terrain, 1, rover, visited)[:, 0]
        if here.max() >= most:
            return None
        nearest = int(means.argmin())
        return Verdict(
            dict(zip(moves, costs.mean(1).tolist(), strict=True)),
            list(moves)[best],
            float(means[nearest]),
            float(errors[nearest]),
            costs.shape[1],
            int(here[others].min() - here[best]),
        )

    def _tried(
        self,
        cells: list[int],
        truths: NDArray[np.uint64],
        count: int,
        rover: tuple[int, int],
        visited: NDArray[np.uint8],
    ) -> NDArray[np.float64]:
        """Moves to the end, float64[moves, terrains], by the cell of the first move."""
        arrays = self._arrays
        for k, cell in enumerate(cells):
            arrays.ways[k, 0], arrays.lengths[k] = cell, 1
        arrays.rover[:] = *rover, 0
        arrays.done[:] = visited
        real = (arrays.board.board, arrays.done, arrays.rover)
        target = int(completion_target(visited.size))
        costs = np.zeros((len(cells), count))
        # of more terrains at a time `compare` would drop the moves that fall behind
        for first in range(0, count, BLOCK):
            block = truths[first : first + BLOCK]
            used = min(BLOCK, count - first)
            compare(
                real,
                arrays.trial,
                block,
                used,
                np.inf,
                arrays.rule,
                target,
                len(cells),
                arrays.ways,
                arrays.lengths,
                arrays.costs,
                arrays.alive,
            )
            costs[:, first : first + used] = arrays.costs[: len(cells), :used]
        return costs


def _free_moves(codes: NDArray[np.uint8], cell: int, rows: int, cols: int) -> dict[str, int]:
    """The cell of each move to a known free one."""
    cells = {name: int(neighbour(cell, k, rows, cols)) for k, name in enumerate(ACTIONS)}
    not_free = (UNKNOWN, OBSTACLE)
    return {name: near for name, near in cells.items() if near >= 0 and codes[near] not in not_free}


def cells_shown(seed: int, trail: Sequence[tuple[int, int]], first: str) -> list[tuple[int, int]]:
    """The cells that a first move and the rule's next ones uncover on the terrain.

    Args:
        seed: Of the terrain.
        trail: The cells of the way to the position, from the start.
        first: The first move's name.
    """
    episode, policy = Episode.begin(CONFIG, seed=seed), policies.load(RULE)
    policy.reset(0)
    steps = [(after[0] - cell[0], after[1] - cell[1]) for cell, after in pairwise(trail)]
    for step in steps:
        policy.act(episode.observation())  # it remembers where the rover has been
        episode.step(DISPLACEMENTS.index(step))
    before = decode(episode.observation()) != UNKNOWN
    policy.act(episode.observation())
    episode.step(ACTIONS.index(first))
    for _ in range(SHOWN_MOVES - 1):
        if episode.ended:
            break
        episode.step(policy.act(episode.observation()))
    new = (decode(episode.observation()) != UNKNOWN) & ~before
    return [(int(row), int(col)) for row, col in np.argwhere(new)]


def puzzle_on(seed: int) -> Puzzle | None:
    """The position of a terrain whose answer saves most; None if there is none."""
    episode, policy, memory = Episode.begin(CONFIG, seed=seed), policies.load(DRIVER), Memory()
    judge = Judge(seed, episode.terrain)
    policy.reset(0)
    best: Verdict | None = None
    codes, trail, heading = memory.codes, tuple(episode.path), episode.heading
    while not episode.ended:
        memory.observe(episode.observation())
        verdict = judge.look(memory)
        if verdict is not None and (best is None or verdict.saves > best.saves):
            best, codes = verdict, memory.codes.copy()
            trail, heading = tuple(episode.path), episode.heading
        episode.step(policy.act(episode.observation()))
    if best is None:
        return None
    shows = {move: cells_shown(seed, trail, move) for move in best.means}
    return Puzzle(codes, trail, heading, shows=shows, **vars(best))
