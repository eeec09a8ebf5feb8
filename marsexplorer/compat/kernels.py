"""One move of a batch, compiled: the lidar by rays, the reward, the end.

Maps are uint8[num, cells], row after row. `known_codes` are codes: 0 unknown, 1 free, 2 where the
rover is or was unseen since, 3 obstacle. The cells of a full ray are listed once for each rover's
cell, in `rays`, and shared by the batch; a ray that an obstacle shortens is drawn again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel

POINTS = 200
"""Of a ray's line."""
FREE, ROVER, OBSTACLE = 1, 2, 3
RUNNING, EXPLORED, COLLIDED, OUT_OF_BOUNDS, TIMED_OUT = range(5)
X, Y, STEPS, DISCOVERED, OUTCOME = range(5)
"""Columns of `scalars`, int64[num, 5]."""
LENGTH, IS_CUT, COST, BONUS, COLLISION, LEAVING, LIMIT, TARGET = range(8)
"""Places in `numbers`, float64[8]: range of the lidar, whether fractions of distances are cut
off, rewards, ends.
"""
SHIFTS: NDArray[np.int64] = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], np.int64)
"""What the authors' actions add to (x, y)."""


@kernel
def draw_ray(
    x: int, y: int, cos: float, sin: float, length: float, rows: int, cols: int, cells: Any
) -> int:
    """Write the different cells of a line, int32[POINTS], in order; return how many."""
    count = 0
    end_x, end_y = x + length * cos, y + length * sin
    step_x, step_y = (end_x - x) / (POINTS - 1), (end_y - y) / (POINTS - 1)
    for point in range(POINTS):
        is_end = point == POINTS - 1
        exact_x = end_x if is_end else x + point * step_x
        exact_y = end_y if is_end else y + point * step_y
        row = min(max(int(np.rint(exact_x)), 0), rows - 1)
        col = min(max(int(np.rint(exact_y)), 0), cols - 1)
        cell = row * cols + col
        if count == 0 or cells[count - 1] != cell:
            cells[count] = cell
            count += 1
    return count


@kernel
def ray_range(x: int, y: int, ray: Any, terrain: Any, numbers: Any, rows: int, cols: int) -> float:
    """Return the distance to the nearest blocked cell of a ray, which ends with -1."""
    side, nearest = min(rows, cols), -1.0
    for cell in ray:
        if cell < 0:
            break
        row, col = min(cell // cols, side), min(cell % cols, side)
        if terrain[row * cols + col]:
            distance = np.sqrt(float((row - x) ** 2 + (col - y) ** 2))
            if nearest < 0.0 or distance < nearest:
                nearest = distance
    if nearest < 0.0:
        return float(numbers[LENGTH])
    return np.floor(nearest) if numbers[IS_CUT] else nearest


@kernel
def show(known_codes: Any, terrain: Any, cell: int) -> int:
    """Write one cell as the lidar shows it; return 1 if it was unknown."""
    is_new = known_codes[cell] == 0
    known_codes[cell] = OBSTACLE if terrain[cell] else FREE
    return 1 if is_new else 0


@kernel
def scan(
    scalars: Any,
    terrain: Any,
    known_codes: Any,
    shared: Any,
) -> None:
    """Scan from the rover's cell and mark it; `shared` is of `worlds.CodeWorlds`."""
    rays, is_listed, directions, numbers, rows, cols, line = shared
    x, y = scalars[X], scalars[Y]
    here = x * cols + y
    length = numbers[LENGTH]
    ray_cells = rays[here]
    if not is_listed[here]:
        for k in range(len(directions)):
            count = draw_ray(x, y, directions[k, 0], directions[k, 1], length, rows, cols, line)
            for i in range(count):
                ray_cells[k, i] = line[i]
        is_listed[here] = 1
    new = 0
    for k in range(len(directions)):
        reach = ray_range(x, y, ray_cells[k], terrain, numbers, rows, cols)
        shown = min(reach + 0.5, length)
        if shown == length:
            for cell in ray_cells[k]:
                if cell < 0:
                    break
                new += show(known_codes, terrain, cell)
        else:
            count = draw_ray(x, y, directions[k, 0], directions[k, 1], shown, rows, cols, line)
            for i in range(count):
                new += show(known_codes, terrain, line[i])
    if known_codes[here] == 0:
        new += 1
    known_codes[here] = ROVER
    scalars[DISCOVERED] += new


@kernel
def step(
    actions: Any,
    shifts: Any,
    rewards: Any,
    scalars: Any,
    terrain: Any,
    known_codes: Any,
    shared: Any,
) -> None:
    """Make one move of every episode; write rewards, and outcomes into `scalars`."""
    rows, cols, numbers = shared[4], shared[5], shared[3]
    for i in range(len(actions)):
        state = scalars[i]
        x, y = state[X] + shifts[actions[i], 0], state[Y] + shifts[actions[i], 1]
        is_out = x < 0 or y < 0 or x >= rows or y >= cols
        is_blocked = not is_out and terrain[i, x * cols + y] != 0
        if not is_out and not is_blocked:
            state[X], state[Y] = x, y
        before = state[DISCOVERED]
        scan(state, terrain[i], known_codes[i], shared)
        state[STEPS] += 1
        rewards[i] = state[DISCOVERED] - before - numbers[COST]
        if state[STEPS] > numbers[LIMIT]:
            state[OUTCOME] = TIMED_OUT
        elif state[DISCOVERED] > numbers[TARGET]:
            state[OUTCOME], rewards[i] = EXPLORED, numbers[BONUS]
        elif is_blocked:
            state[OUTCOME], rewards[i] = COLLIDED, numbers[COLLISION]
        elif is_out:
            state[OUTCOME], rewards[i] = OUT_OF_BOUNDS, numbers[LEAVING]
