"""A board's features: pictures centred on the rover, and numbers for each move.

Everything follows from the observation and the cells visited so far, never from the true map. The
pictures are of one size whatever the size of the grid, fine near the rover and coarse far from it,
so one network serves every size. "New" is the number of unknown cells that a scan from a cell is
expected to discover (`kernels.visibility`).

    SCALES   11 x 11 single cells, 11 x 11 blocks of 3 x 3 cells, 9 x 9 blocks of 7 x 7 cells (31
             cells to each side)
    planes   uint8[num, PLANES, PICTURE_CELLS], the pictures row by row, one after the other: share
             of the block that is unknown; share blocked or off the grid; its greatest number of new
             cells (x 5, at most 255); its nearness, 255 exp(-0.12 distance), 0 where there is no
             known path
    moves    float32[num, 4, MOVE_NUMBERS], for north, east, south, west: whether the move is valid;
             the new cells of the cell it leads to; whether that was visited; distance to the
             nearest new cells from there; the best discounted number of new cells from there at
             three rates; whether each of three frontier rules would go there (new / distance^2, new
             / distance, nearest); whether it is straight on or back; the share of cells unknown and
             the logarithm of their number; the logarithm of the cells still to discover to 99 %;
             the logarithm of the number of candidates; and the numbers of `priced_features`
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel, read_only
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.lidar import row_words, sight_table
from marsexplorer.policies.base import Memory
from marsexplorer.policies.kernels.grid import (
    UNREACHABLE,
    completion_target,
    find_open_cells,
    neighbour,
    search_first_actions,
)
from marsexplorer.policies.kernels.prices import NO_CODE, update_board
from marsexplorer.policies.kernels.visibility import bitboard_words, count_visible
from marsexplorer.policies.network.priced_features import (
    PRICED_FEATURES,
    RULES,
    PricedRuleTables,
    value_actions,
    write_priced_features,
)

SCALES = ((11, 1), (11, 3), (9, 7))
"""Blocks a side and cells a block's side, of each picture."""
PICTURE_CELLS = sum(side * side for side, _ in SCALES)
"""Blocks of all the pictures."""
PLANES = 4
ACTION_FEATURES = 16
"""Numbers of a move that come before those of `priced_features`."""
MOVE_NUMBERS = ACTION_FEATURES + PRICED_FEATURES
Codes = NDArray[np.uint8]
Numbers = NDArray[np.int64]
DISCOUNTS = (0.5, 0.75, 0.9)
"""What a new cell is worth a move later, three ways of looking ahead."""
FARTHEST = 127
"""Distances beyond it look the same (nearness 0)."""


@kernel
def update_new_cells(codes, board, half_sides, new_cells, changed_columns):
    """Update one board with codes uint8[rows, cols]; return its unknown cells.

    board, half_sides, changed_columns  see `prices.update_board`
    new_cells        int32[rows * cols], cells that a scan from each known free cell is expected to
                     discover
    """
    view = board[2]
    radius = view[5]
    rows, cols = codes.shape

    # 1. Update the board, and note the changed part of each row.
    left = update_board(codes, board, half_sides, changed_columns)

    # 2. Count again where the count can have changed: within `radius` of a changed cell, for sight
    #    is local.
    for row in range(rows):
        low, high = cols, -1
        for near in range(max(0, row - radius), min(rows, row + radius + 1)):
            low = min(low, changed_columns[near, 0] - radius)
            high = max(high, changed_columns[near, 1] + radius)
        for col in range(max(low, 0), min(high + 1, cols)):
            if codes[row, col] != UNKNOWN and codes[row, col] != OBSTACLE:
                new_cells[row * cols + col] = count_visible(view, row, col)
    return left


@kernel
def draw_pictures(codes, row, col, new_cells, visited, distance, nearness, planes):
    """Fill one board's pictures round the rover at (row, col).

    planes  uint8[PLANES, PICTURE_CELLS], written
    """
    rows, cols = codes.shape
    start = 0
    for side, size in SCALES:
        # 1. Begin as if everything were off the grid: blocked, nothing unknown, nothing new,
        #    nothing near.
        share = 255 // (size * size)
        top, left = row - side * size // 2, col - side * size // 2
        for k in range(side * side):
            first_row, first_col = top + k // side * size, left + k % side * size
            unknown, blocked, newest, nearest = 0, size * size, 0, UNREACHABLE
            # 2. Let every cell of the grid that lies in the block correct that.
            for r in range(max(first_row, 0), min(first_row + size, rows)):
                for c in range(max(first_col, 0), min(first_col + size, cols)):
                    code, cell = codes[r, c], r * cols + c
                    unknown += code == UNKNOWN
                    blocked -= code != OBSTACLE
                    if code != OBSTACLE and code != UNKNOWN and distance[cell] != UNREACHABLE:
                        nearest = min(nearest, distance[cell])
                        if visited[cell] == 0:
                            newest = max(newest, new_cells[cell])
            planes[0, start + k], planes[1, start + k] = unknown * share, blocked * share
            planes[2, start + k] = min(255, newest * 5)
            planes[3, start + k] = 0 if nearest == UNREACHABLE else nearness[min(nearest, FARTHEST)]
        start += side * side


@kernel
def find_rule_goals(candidates, count, distance, new_cells, goals):
    """Write the goals of the three rules, -1 for none, to goals[3].

    The rules are new / distance^2, new / distance, and nearest.

    candidates  int32, its first `count` are the reachable cells with something new, nearest first
    """
    best_square, best_plain = 0.0, 0.0
    goals[0] = goals[1] = goals[2] = -1
    for k in range(count):
        cell = candidates[k]
        new, moves = float(new_cells[cell]), float(distance[cell])
        if moves == 0.0:
            continue
        if goals[2] < 0:
            goals[2] = cell
        if new / (moves * moves) > best_square + 1e-9:
            best_square = new / (moves * moves)
            goals[0] = cell
        if new / moves > best_plain + 1e-9:
            best_plain = new / moves
            goals[1] = cell


@kernel
def look_ahead(candidates, count, distance, first_actions, action, new_cells, discounts, features):
    """Write how much is new near the cell that a move leads to.

    That is the distance to the nearest new cells, and the best discounted number of them.

    distance, first_actions  from the rover, see `grid.search_first_actions`: a candidate is one
                             move nearer from there when the action begins a shortest path to it,
                             else one farther
    discounts                float64[3, n + 1], what a new cell is worth by distance, at the three
                             rates of DISCOUNTS
    """
    nearest, short, middle, long = 60.0, 0.0, 0.0, 0.0
    for k in range(count):
        cell = candidates[k]
        new = float(new_cells[cell])
        moves = distance[cell] + (-1 if first_actions[cell] >> action & 1 else 1)
        nearest = min(nearest, float(moves))
        short = max(short, new * discounts[0, moves])
        middle = max(middle, new * discounts[1, moves])
        long = max(long, new * discounts[2, moves])
    features[3] = nearest * 0.05
    features[4] = short * 0.1
    features[5] = middle * 0.1
    features[6] = long * 0.05


@kernel
def extract_features(
    codes, cells, visited, headings, lidar, boards, scratch, priced, planes, moves
):
    """Fill planes and moves for a stack of boards.

    codes     uint8[num, rows, cols]; cells int64[num], row * cols + col of each rover
    visited   uint8[num, rows * cols], 1 where the rover has stood; headings int64[num], the last
              action
    lidar     (sight, stride, radius) of a `visibility` view
    boards    from call to call: known_codes, unknown, blocked, new_cells (see `update_new_cells`),
              and the counts of the squares of `prices`
    scratch   visible, changed_columns, is_open, distance, first_actions, queue, candidates, goals,
              rule_actions; and the tables nearness and discounts
    priced    half_sides of the squares that are counted, none where nothing is priced; rules,
              values and columns of its tables
    """
    rows, cols = codes.shape[1], codes.shape[2]
    sight, stride, radius = lidar
    all_known, all_unknown, all_blocked, all_new_cells, all_counts = boards
    half_sides, rules, values, columns = priced
    visible, changed_columns, is_open, distance, first_actions, queue, candidates = scratch[:7]
    goals, rule_actions, nearness, discounts = scratch[7:]
    slack = rows * cols - completion_target(rows * cols)
    for i in range(codes.shape[0]):
        board, cell, new_cells = codes[i], cells[i], all_new_cells[i]

        # 1. What would a scan discover, from every cell? Only what changed since the last board is
        #    counted again.
        view = (all_unknown[i], all_blocked[i], sight, visible, stride, radius)
        board_tuple = (all_known[i], all_counts[i], view)
        left = update_new_cells(board, board_tuple, half_sides, new_cells, changed_columns)

        # 2. How far is every cell, and which moves begin a shortest path to it? One search from the
        #    rover answers both.
        find_open_cells(board, is_open)
        reached = search_first_actions(is_open, rows, cols, cell, distance, first_actions, queue)
        # a literal would have what it is handed on to compiled for itself as well
        count = np.int64(0)
        for k in range(reached):
            there = queue[k]
            candidates[count] = there
            count += np.int64((visited[i, there] == 0) & (new_cells[there] > 0))

        # 3. The pictures, and where the three rules would go.
        row, col = cell // cols, cell % cols
        draw_pictures(board, row, col, new_cells, visited[i], distance, nearness, planes[i])
        find_rule_goals(candidates, count, distance, new_cells, goals)

        # 4. The numbers of each valid move; those of an invalid one are all 0.
        moves[i], rule_actions[:] = 0.0, -1
        for action in range(4):
            near = neighbour(cell, action, rows, cols)
            if near < 0 or is_open[near] == 0:
                continue
            features = moves[i, action]
            features[0] = 1.0
            features[1] = 0.0 if visited[i, near] else new_cells[near] * 0.1
            features[2] = visited[i, near]
            look_ahead(
                candidates, count, distance, first_actions, action, new_cells, discounts, features
            )
            for rule in range(3):
                goal = goals[rule]
                begins_path = goal >= 0 and first_actions[goal] >> action & 1
                if begins_path and (rule_actions[rule] < 0 or action == headings[i]):
                    rule_actions[rule] = action
            features[10] = action == headings[i]
            features[11] = (action ^ headings[i]) == 2
            features[12] = left / (rows * cols)
            features[13] = np.log(1.0 + left) * 0.2
            features[14] = np.log(1.0 + max(0, left - slack)) * 0.3
            features[15] = np.log(1.0 + count) * 0.2
        for rule in range(3):
            if rule_actions[rule] >= 0:
                moves[i, rule_actions[rule], 7 + rule] = 1.0

        # 5. What the prices of unknown cells say of them.
        size = (rows, cols)
        if half_sides.shape[0] > 0:
            value_actions(
                candidates,
                count,
                distance,
                first_actions,
                new_cells,
                size,
                board_tuple,
                rules,
                values,
            )
        write_priced_features(size, values, columns, moves[i])


class FeatureExtractor:
    """Extracts the features of `num` boards of one size.

    The arrays `planes` and `moves` are the same from call to call. What it remembers of each board
    only saves time: boards may be given in any order, and others than before.

    rules  the rules of `priced_features` whose numbers are written; those of the others stay 0.
           None: all
    """

    def __init__(
        self, num: int, rows: int, cols: int, radius: int, rules: Sequence[int] | None = None
    ) -> None:
        self.size = (rows, cols)
        tables = PricedRuleTables(rows, cols, radius, ACTION_FEATURES, rules or range(len(RULES)))
        are_some_priced = rules is None or len(rules) > 0
        half_sides = tables.half_sides if are_some_priced else tables.half_sides[:0]
        priced = (half_sides, tables.arrays, tables.values, tables.columns)
        self.planes: NDArray[np.uint8] = np.zeros((num, PLANES, PICTURE_CELLS), np.uint8)
        self.moves: NDArray[np.float32] = np.zeros((num, 4, MOVE_NUMBERS), np.float32)
        sight, cells, words = sight_table(radius), rows * cols, bitboard_words(rows, cols, radius)
        lidar = sight, row_words(cols, radius), radius
        boards = (
            np.full((num, cells), NO_CODE, np.uint8),
            np.zeros((num, words), np.uint64),
            np.zeros((num, words), np.uint64),
            np.zeros((num, cells), np.int32),
            np.zeros((num, len(half_sides), cells), np.int16),
        )
        scratch = (
            np.zeros(int(sight[1]), np.uint64),
            np.zeros((rows, 2), np.int64),
            np.zeros(cells, np.uint8),
            np.zeros(cells, np.int32),
            np.zeros(cells, np.uint8),
            np.zeros(cells + 1, np.int32),
            np.zeros(cells, np.int32),
            np.zeros(3, np.int64),
            np.zeros(3, np.int64),
            (255 * np.exp(-0.12 * np.arange(FARTHEST + 1))).astype(np.uint8),
            np.cumprod([[1.0] + [rate] * cells for rate in DISCOUNTS], axis=1),
        )
        self._arrays = (lidar, boards, scratch, priced)

    def __call__(
        self, codes: Codes, cells: Numbers, visited: Codes, headings: Numbers
    ) -> tuple[Codes, NDArray[np.float32]]:
        """(planes, moves) of a stack of boards, from the arrays of `extract_features`."""
        num = len(codes)
        planes, moves = self.planes[:num], self.moves[:num]
        codes, cells = read_only(codes), np.asarray(cells, np.int64)
        extract_features(codes, cells, visited, headings, *self._arrays, planes, moves)
        return planes, moves


class RememberedFeatures:
    """The features of one board from the memory of its episode.

    find_rules  (rows, cols) -> `rules` of `FeatureExtractor` for boards of that size; by default
                all
    """

    def __init__(
        self,
        sensor_radius: int,
        find_rules: Callable[[int, int], Sequence[int] | None] = lambda rows, cols: None,
    ) -> None:
        self._radius, self._find_rules = sensor_radius, find_rules
        self._extractor: FeatureExtractor | None = None

    def __call__(self, memory: Memory) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """(planes, moves) of the newest observation, [1, ...]; the next call changes them."""
        rows, cols = memory.codes.shape
        if self._extractor is None or self._extractor.size != (rows, cols):
            rules = self._find_rules(rows, cols)
            self._extractor = FeatureExtractor(1, rows, cols, self._radius, rules)
        cell = np.array([memory.position[0] * cols + memory.position[1]])
        visited, heading = memory.visited.reshape(1, -1), np.array([memory.heading])
        return self._extractor(memory.codes[None], cell, visited, heading)
