"""What the network is shown of a board: three pictures centred on the rover and a few numbers for each action. Compiled.

Everything follows from the observation and the cells stood on so far, never from the true map. The pictures are of one size
whatever the size of the grid, fine near the rover and coarse far from it, so one network serves every size:

    RINGS    11 x 11 single cells, 11 x 11 blocks of 3 x 3 cells, 9 x 9 blocks of 7 x 7 cells (31 cells to each side)
    planes   uint8[num, PLANES, CELLS], the pictures row by row, one after the other: share of the block that is unknown; share
             blocked or off the grid; its greatest expected gain (x 5, at most 255); its nearness, 255 exp(-0.12 distance), 0
             where there is no known way
    moves    float32[num, 4, NUMBERS], for north, east, south, west: whether the move is valid; the expected gain of its cell;
             whether it was stood on; distance to the nearest gain from there; the best discounted gain from there at three
             rates; whether each of three frontier rules would go there (gain / distance^2, gain / distance, nearest); whether
             it is straight on or back; the share of cells unknown and the logarithm of their number; the logarithm of the
             cells still to discover to 99 %; the logarithm of the number of cells with any gain
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.lidar import sight_table
from marsexplorer.policies.kernels.grid import FAR, enough, first_moves, neighbour, open_cells, spread
from marsexplorer.policies.kernels.visibility import ONE, U, board_shape, look

RINGS = ((11, 1), (11, 3), (9, 7))
"""Blocks a side and cells a block's side, of each picture."""
CELLS = sum(side * side for side, _ in RINGS)
PLANES = 4
NUMBERS = 16
RATES = (0.5, 0.75, 0.9)
"""What a gain is worth a move later, three ways of looking ahead."""
FARTHEST = 127
"""Distances beyond it look the same (nearness 0)."""
NOTHING = 255
"""No code: what is kept of a cell before the first board."""


@kernel
def notice(codes, radius, sight, seen, known, unknown, blocked, gains, edges):
    """Bring what is kept of one board up to date with codes uint8[rows, cols]; return how many cells are unknown.

    Only cells near those that were discovered since can have another gain: sight is local.

    known             uint8[rows * cols], the codes as they were kept
    unknown, blocked  its bit boards (see gain.py); gains int64[rows * cols], of the known free cells
    edges             int64[rows, 2], room: the first and the last changed column of each row
    """
    rows, cols = codes.shape
    left, changed = 0, False
    for row in range(rows):
        edges[row, 0], edges[row, 1] = cols, -1
        for col in range(cols):
            code, cell = codes[row, col], row * cols + col
            left += code == UNKNOWN
            if known[cell] == code:
                continue
            known[cell] = code
            word, bit = (col + radius) >> 6, ONE << U((col + radius) & 63)
            was = (unknown[row + radius, word] & bit, blocked[row + radius, word] & bit)
            now = (bit if code == UNKNOWN else U(0), bit if code == OBSTACLE else U(0))
            if was != now:
                unknown[row + radius, word] ^= was[0] ^ now[0]
                blocked[row + radius, word] ^= was[1] ^ now[1]
                edges[row, 0], edges[row, 1], changed = min(edges[row, 0], col), col, True
    if not changed:
        return left
    for row in range(rows):
        low, high = cols, -1
        for near in range(max(0, row - radius), min(rows, row + radius + 1)):
            low, high = min(low, edges[near, 0] - radius), max(high, edges[near, 1] + radius)
        for col in range(max(low, 0), min(high + 1, cols)):
            if codes[row, col] != UNKNOWN and codes[row, col] != OBSTACLE:
                gains[row * cols + col] = look(unknown, blocked, row, col, radius, sight, seen)
    return left


@kernel
def see(codes, row, col, gains, visited, distance, nearness, planes):
    """Fill one board's pictures: planes uint8[PLANES, CELLS]."""
    rows, cols = codes.shape
    start = 0
    for side, size in RINGS:
        share = 255 // (size * size)
        top, left = row - side * size // 2, col - side * size // 2
        for k in range(start, start + side * side):
            planes[0, k] = planes[2, k] = planes[3, k] = 0
            planes[1, k] = share * size * size
        for r in range(max(top, 0), min(top + side * size, rows)):
            across = start + (r - top) // size * side
            for c in range(max(left, 0), min(left + side * size, cols)):
                k, code, cell = across + (c - left) // size, codes[r, c], r * cols + c
                if code == OBSTACLE:
                    continue
                planes[1, k] -= share
                if code == UNKNOWN:
                    planes[0, k] += share
                elif distance[cell] != FAR:
                    if visited[cell] == 0:
                        planes[2, k] = max(planes[2, k], min(255, gains[cell] * 5))
                    planes[3, k] = max(planes[3, k], nearness[min(distance[cell], FARTHEST)])
        start += side * side


@kernel
def goals(spots, count, distance, gains, found):
    """Write the cells that the three rules would go for into found[3]: gain / distance^2, gain / distance, nearest; -1 none.

    spots  int32, its first `count` are the reachable cells with a gain, nearest first
    """
    best_square, best_plain = 0.0, 0.0
    found[0] = found[1] = found[2] = -1
    for k in range(count):
        cell = spots[k]
        gain, way = float(gains[cell]), float(distance[cell])
        if way == 0.0:
            continue
        if found[2] < 0:
            found[2] = cell
        if gain / (way * way) > best_square + 1e-9:
            best_square = gain / (way * way)
            found[0] = cell
        if gain / way > best_plain + 1e-9:
            best_plain = gain / way
            found[1] = cell


@kernel
def discounted(spots, count, distance, ways, action, gains, shares, numbers):
    """Write distance to the nearest gain and the best discounted gains, from the cell that a move leads to.

    distance, ways  from the rover, see `grid.first_moves`
    shares          float64[3, farthest + 1], what a gain is worth by distance, at three rates
    """
    nearest, short, middle, long = 60.0, 0.0, 0.0, 0.0
    for k in range(count):
        cell = spots[k]
        gain, way = float(gains[cell]), distance[cell] + (-1 if ways[cell] >> action & 1 else 1)
        nearest = min(nearest, float(way))
        short, middle, long = (
            max(short, gain * shares[0, way]),
            max(middle, gain * shares[1, way]),
            max(long, gain * shares[2, way]),
        )
    numbers[3] = nearest * 0.05
    numbers[4] = short * 0.1
    numbers[5] = middle * 0.1
    numbers[6] = long * 0.05


@kernel
def perceive(codes, places, visited, headings, radius, sight, kept, room, planes, moves):
    """Fill planes and moves for a stack of boards.

    codes     uint8[num, rows, cols]; places int64[num], row * cols + col of each rover
    visited   uint8[num, rows * cols], 1 where the rover has stood; headings int64[num], the last action
    kept      of each board, from call to call: known, unknown, blocked, gains (see `notice`)
    room      to work in: seen, edges, is_open, distance, ways, queue, spots, found, rules; and the tables nearness, shares
    """
    rows, cols = codes.shape[1], codes.shape[2]
    known, unknown, blocked, all_gains = kept
    seen, edges, is_open, distance, ways, queue, spots, found, rules, nearness, shares = room
    slack = rows * cols - enough(rows * cols)
    for i in range(codes.shape[0]):
        board, place, gains = codes[i], places[i], all_gains[i]
        left = notice(board, radius, sight, seen, known[i], unknown[i], blocked[i], gains, edges)
        open_cells(board, False, is_open)
        queue[0] = place
        reached, count = spread(is_open, rows, cols, distance, queue, 1), 0
        for k in range(reached):
            cell = queue[k]
            if visited[i, cell] == 0 and gains[cell] > 0:
                spots[count] = cell
                count += 1
        first_moves(distance, queue, reached, rows, cols, ways)
        see(board, place // cols, place % cols, gains, visited[i], distance, nearness, planes[i])
        goals(spots, count, distance, gains, found)
        moves[i], rules[:] = 0.0, -1
        for action in range(4):
            near = neighbour(place, action, rows, cols)
            if near < 0 or is_open[near] == 0:
                continue
            numbers = moves[i, action]
            numbers[0] = 1.0
            numbers[1] = 0.0 if visited[i, near] else gains[near] * 0.1
            numbers[2] = visited[i, near]
            discounted(spots, count, distance, ways, action, gains, shares, numbers)
            for rule in range(3):
                goal = found[rule]
                if goal >= 0 and ways[goal] >> action & 1 and (rules[rule] < 0 or action == headings[i]):
                    rules[rule] = action
            numbers[10] = action == headings[i]
            numbers[11] = (action ^ headings[i]) == 2
            numbers[12] = left / (rows * cols)
            numbers[13] = np.log(1.0 + left) * 0.2
            numbers[14] = np.log(1.0 + max(0, left - slack)) * 0.3
            numbers[15] = np.log(1.0 + count) * 0.2
        for rule in range(3):
            if rules[rule] >= 0:
                moves[i, rules[rule], 7 + rule] = 1.0


class Perception:
    """Perceives `num` boards of one size; the arrays `planes` and `moves` are the same from call to call.

    What it keeps of each board only saves time: boards may be given in any order, and others than before.
    """

    def __init__(self, num: int, rows: int, cols: int, radius: int) -> None:
        self.size = (rows, cols)
        self.planes: NDArray[np.uint8] = np.zeros((num, PLANES, CELLS), np.uint8)
        self.moves: NDArray[np.float32] = np.zeros((num, 4, NUMBERS), np.float32)
        table, cells = sight_table(radius), rows * cols
        boards = (num, *board_shape(rows, cols, radius))
        self._lidar = radius, table
        self._kept = (
            np.full((num, cells), NOTHING, np.uint8),
            np.zeros(boards, np.uint64),
            np.zeros(boards, np.uint64),
            np.zeros((num, cells), np.int64),
        )
        self._room = (
            np.zeros(int(table[1]), np.uint64),
            np.zeros((rows, 2), np.int64),
            np.zeros(cells, np.uint8),
            np.zeros(cells, np.int32),
            np.zeros(cells, np.uint8),
            np.zeros(cells + 1, np.int32),
            np.zeros(cells, np.int32),
            np.zeros(3, np.int64),
            np.zeros(3, np.int64),
            (255 * np.exp(-0.12 * np.arange(FARTHEST + 1))).astype(np.uint8),
            np.cumprod([[1.0] + [rate] * cells for rate in RATES], axis=1),
        )

    def __call__(
        self, codes: NDArray[np.uint8], places: NDArray[np.int64], visited: NDArray[np.uint8], headings: NDArray[np.int64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return (planes, moves) of a stack of boards; see `perceive` for what they take."""
        num = len(codes)
        perceive(codes, places, visited, headings, *self._lidar, self._kept, self._room, self.planes[:num], self.moves[:num])
        return self.planes[:num], self.moves[:num]
