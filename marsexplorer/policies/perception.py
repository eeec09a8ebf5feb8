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
from marsexplorer.policies.gain import board_shape, fill_boards, look
from marsexplorer.policies.grid import FAR, neighbour, open_cells, spread, step_down

RINGS = ((11, 1), (11, 3), (9, 7))
"""Blocks a side and cells a block's side, of each picture."""
CELLS = sum(side * side for side, _ in RINGS)
PLANES = 4
NUMBERS = 16
FARTHEST = 127
"""Distances beyond it look the same (nearness 0)."""


@kernel
def see(codes, row, col, gains, distance, nearness, planes):
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
                    planes[2, k] = max(planes[2, k], min(255, gains[cell] * 5))
                    planes[3, k] = max(planes[3, k], nearness[min(distance[cell], FARTHEST)])
        start += side * side


@kernel
def goals(reached, queue, distance, gains, found):
    """Write the cells that the three rules would go for into found[3]: gain / distance^2, gain / distance, nearest; -1 none."""
    best_square, best_plain = 0.0, 0.0
    found[0] = found[1] = found[2] = -1
    for k in range(1, reached):
        cell = queue[k]
        gain = float(gains[cell])
        if gain > 0.0:
            way = float(distance[cell])
            if found[2] < 0:
                found[2] = cell
            if gain / (way * way) > best_square + 1e-9:
                best_square = gain / (way * way)
                found[0] = cell
            if gain / way > best_plain + 1e-9:
                best_plain = gain / way
                found[1] = cell


@kernel
def discounted(reached, queue, distance, gains, numbers):
    """Write distance to the nearest gain and the best discounted gains, from the cell that `distance` starts at."""
    nearest, short, middle, long = 60.0, 0.0, 0.0, 0.0
    at, by_half, by_quarter, by_tenth = 0, 1.0, 1.0, 1.0
    for k in range(reached):
        cell = queue[k]
        while at < distance[cell]:
            at += 1
            by_half *= 0.5
            by_quarter *= 0.75
            by_tenth *= 0.9
        gain = float(gains[cell])
        if gain > 0.0:
            if nearest == 60.0:
                nearest = min(float(at), 60.0)
            short, middle, long = max(short, gain * by_half), max(middle, gain * by_quarter), max(long, gain * by_tenth)
    numbers[3] = nearest * 0.05
    numbers[4] = short * 0.1
    numbers[5] = middle * 0.1
    numbers[6] = long * 0.05


@kernel
def perceive(
    codes,
    places,
    visited,
    headings,
    radius,
    sight,
    unknown,
    blocked,
    seen,
    is_open,
    distance,
    other,
    queue,
    gains,
    found,
    nearness,
    planes,
    moves,
):
    """Fill planes and moves for a stack of boards.

    codes     uint8[num, rows, cols]; places int64[num], row * cols + col of each rover
    visited   uint8[num, rows * cols], 1 where the rover has stood; headings int64[num], the last action
    nearness  uint8[FARTHEST + 1] by distance
    The rest up to `found` is room to work in: one board's bit boards, distances, queue and gains.
    """
    rows, cols = codes.shape[1], codes.shape[2]
    for i in range(codes.shape[0]):
        board, place = codes[i], places[i]
        row, col = place // cols, place % cols
        fill_boards(board, radius, unknown, blocked)
        open_cells(board, False, is_open)
        queue[0] = place
        reached = spread(is_open, rows, cols, distance, queue, 1)
        left, places_with_gain = 0, 0
        slack = rows * cols - int(np.ceil(rows * cols * 0.99))
        for cell in range(rows * cols):
            gains[cell] = 0
            left += board[cell // cols, cell % cols] == UNKNOWN
        for k in range(reached):
            cell = queue[k]
            if visited[i, cell] == 0:
                gains[cell] = look(unknown, blocked, cell // cols, cell % cols, radius, sight, seen)
                places_with_gain += gains[cell] > 0
        see(board, row, col, gains, distance, nearness, planes[i])
        goals(reached, queue, distance, gains, found)
        moves[i] = 0.0
        for rule in range(3):
            if found[rule] >= 0:
                queue[0] = found[rule]
                spread(is_open, rows, cols, other, queue, 1)
                action = step_down(other, place, headings[i], rows, cols)
                if action >= 0:
                    moves[i, action, 7 + rule] = 1.0
        for action in range(4):
            near = neighbour(place, action, rows, cols)
            if near < 0 or is_open[near] == 0:
                continue
            numbers = moves[i, action]
            numbers[0] = 1.0
            numbers[1] = gains[near] * 0.1
            numbers[2] = visited[i, near]
            queue[0] = near
            discounted(spread(is_open, rows, cols, other, queue, 1), queue, other, gains, numbers)
            numbers[10] = action == headings[i]
            numbers[11] = (action ^ headings[i]) == 2
            numbers[12] = left / (rows * cols)
            numbers[13] = np.log(1.0 + left) * 0.2
            numbers[14] = np.log(1.0 + max(0, left - slack)) * 0.3
            numbers[15] = np.log(1.0 + places_with_gain) * 0.2


class Perception:
    """Perceives `num` boards of one size; the arrays `planes` and `moves` are the same from call to call."""

    def __init__(self, num: int, rows: int, cols: int, radius: int) -> None:
        self.size = (rows, cols)
        self.planes: NDArray[np.uint8] = np.zeros((num, PLANES, CELLS), np.uint8)
        self.moves: NDArray[np.float32] = np.zeros((num, 4, NUMBERS), np.float32)
        table, cells = sight_table(radius), rows * cols
        self._room = (
            radius,
            table,
            np.zeros(board_shape(rows, cols, radius), np.uint64),
            np.zeros(board_shape(rows, cols, radius), np.uint64),
            np.zeros(int(table[1]), np.uint64),
            np.zeros(cells, np.uint8),
            np.zeros(cells, np.int32),
            np.zeros(cells, np.int32),
            np.zeros(cells + 1, np.int32),
            np.zeros(cells, np.int64),
            np.zeros(3, np.int64),
            (255 * np.exp(-0.12 * np.arange(FARTHEST + 1))).astype(np.uint8),
        )

    def __call__(
        self, codes: NDArray[np.uint8], places: NDArray[np.int64], visited: NDArray[np.uint8], headings: NDArray[np.int64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return (planes, moves) of a stack of boards; see `perceive` for what they take."""
        perceive(codes, places, visited, headings, *self._room, self.planes[: len(codes)], self.moves[: len(codes)])
        return self.planes[: len(codes)], self.moves[: len(codes)]
