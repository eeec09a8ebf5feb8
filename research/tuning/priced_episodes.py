"""Episodes of the priced rule, many at once, for the moves that they take.

They are played again and again on the same terrains.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.config import RUNNING, EnvConfig
from marsexplorer.lidar import row_words, sight_table
from marsexplorer.observation import EAST
from marsexplorer.policies.kernels.prices import NO_CODE, SQUARES, price_scratch, update_board
from marsexplorer.policies.kernels.visibility import bitboard_words
from marsexplorer.policies.priced import RuleTables, SizedRule, toward_most_priced
from marsexplorer.rules import STEPS
from marsexplorer.world import Worlds, positions


@kernel
def decide_all(
    codes, cells, outcomes, visited, headings, boards, lidar, tables, search, rule, changed_columns
):
    """Write the rule's action of every running world to headings, int64[num].

    They hold the last actions before.

    codes    uint8[num, rows, cols]; cells int64[num], row * cols + col of each rover; outcomes
             uint8[num]
    visited  uint8[num, rows, cols], the rover's cell is added; boards: known_codes, counts, unknown
             and blocked of each board
    lidar    (sight, visible, stride, radius) of a `visibility` view; rule: its (highest, limits,
             weights), and goal; the rest as in `toward_most_priced`
    """
    known_codes, counts, unknown, blocked = boards
    sight, visible, stride, radius = lidar
    for i in range(codes.shape[0]):
        if outcomes[i] != RUNNING:
            continue
        row = cells[i] // codes.shape[2]
        col = cells[i] - row * codes.shape[2]
        visited[i, row, col] = 1
        board = (
            known_codes[i],
            counts[i],
            (unknown[i], blocked[i], sight, visible, stride, radius),
        )
        update_board(codes[i], board, tables[0], changed_columns)
        headings[i] = toward_most_priced(
            codes[i], visited[i], row, col, headings[i], board, tables, search, *rule
        )


class PricedEpisodes:
    """The terrains of some seeds, on which the priced rule is played.

    Not for two threads at once.

    ValueError when a seed has no solvable terrain.
    """

    def __init__(self, config: EnvConfig, seeds: Sequence[int]) -> None:
        num, cells, radius = len(seeds), config.n, config.sensor_radius
        self.config, self._worlds, self._all = config, Worlds(config, num), np.arange(num)
        self._worlds.start(np.asarray(seeds))
        self._begun = self._worlds.take(self._all)
        words, sight = bitboard_words(config.rows, config.cols, radius), sight_table(radius)
        boards = np.zeros((2, num, words), np.uint64)
        prices = np.full((num, cells), NO_CODE, np.uint8), np.zeros((num, SQUARES, cells), np.int16)
        self._boards = (*prices, *boards)
        visible = np.zeros(int(sight[1]), np.uint64)
        self._lidar = (sight, visible, row_words(config.cols, radius), radius)
        distance, queue = np.zeros((2, cells), np.int32)
        self._search = (price_scratch(cells), distance, np.zeros(cells, np.uint8), queue)
        self._changed_columns = np.zeros((config.rows, 2), np.int64)
        self._goal = np.zeros(1, np.int64)

    def play(self, rule: SizedRule) -> NDArray[np.int64]:
        """The moves that the rule takes to 99 % on each terrain, int64[num].

        The limit where it does not get there.
        """
        worlds, config, radius = self._worlds, self.config, self.config.sensor_radius
        shape = config.rows, config.cols
        tables = RuleTables([rule.of(*shape, radius)], shape, radius)
        worlds.put(self._all, self._begun)
        visited, headings = np.zeros_like(worlds.codes), np.full(worlds.num, EAST)
        weighed = (tables.highest, tables.limits, tables.weights, self._goal)
        arrays = (
            self._boards,
            self._lidar,
            tables.prices,
            self._search,
            weighed,
            self._changed_columns,
        )
        while (worlds.outcomes == RUNNING).any():
            rovers = positions(worlds.scalars)
            cells = rovers[:, 0] * config.cols + rovers[:, 1]
            decide_all(worlds.codes, cells, worlds.outcomes, visited, headings, *arrays)
            worlds.step(headings)
        return worlds.scalars[:, STEPS].astype(np.int64)
