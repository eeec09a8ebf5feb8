"""Observations: the occupancy grid as codes or state matrix, and its valid moves.

Koutras et al. 2021, section 2.3: the occupancy grid, and eq. 6, the state matrix. Codes are uint8:
0 unknown, 1 free, 2 rover, 3 obstacle. The state matrix is float32 and holds 0, 0.3, 0.6 and 1 for
them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, read_only
from marsexplorer.config import OBSTACLE, ROVER, VALUES

Codes = NDArray[np.uint8]
"""uint8[rows, cols]: 0 unknown, 1 free, 2 rover, 3 obstacle."""

NORTH, EAST, SOUTH, WEST = range(4)
"""Action codes."""

DISPLACEMENTS = ((-1, 0), (0, 1), (1, 0), (0, -1))
"""(row, col) that actions 0..3 add to the position."""

STATE_VALUES: NDArray[np.float32] = np.array(VALUES, np.float32)
"""float32[4], the state matrix's value for each code: `STATE_VALUES[codes]` is eq. 6."""


def decode(observation: NDArray[Any]) -> Codes:
    """Convert an observation to uint8 codes [rows, cols], contiguous and read-only.

    Args:
        observation: float32[rows, cols] of eq. 6, or uint8 codes, which are not copied.

    Raises:
        ValueError: If it does not have two dimensions.
        TypeError: If its numbers are of another kind.
    """
    if observation.ndim != 2:
        raise ValueError(
            f"an observation must have 2 dimensions (rows, cols), got shape {observation.shape}"
        )
    if observation.dtype == np.uint8:
        return read_only(np.ascontiguousarray(observation))
    if observation.dtype.kind != "f":
        raise TypeError(
            f"an observation must be float32 (eq. 6) or uint8 codes, got {observation.dtype}"
        )
    # the thresholds lie half-way between the values of eq. 6: 0, 0.3, 0.6 and 1
    codes = (observation > 0.15).astype(np.uint8)
    codes += observation > 0.45
    codes += observation > 0.8
    return read_only(codes)


def rover_position(codes: Codes) -> tuple[int, int]:
    """The rover's (row, col); ValueError unless exactly one cell holds code 2."""
    cells = np.flatnonzero(codes == ROVER)
    if len(cells) != 1:
        raise ValueError(
            f"an observation must hold exactly one rover cell (0.6, or code {ROVER}), got {len(cells)}"
        )
    row, col = divmod(int(cells[0]), codes.shape[1])
    return row, col


@inlined
def is_valid(codes, row, col, action):
    """Whether a move from (row, col) stays on the grid and off known obstacles.

    codes  uint8[rows, cols]
    """
    to_row = row + np.int64(action == SOUTH) - np.int64(action == NORTH)
    to_col = col + np.int64(action == EAST) - np.int64(action == WEST)
    return (
        0 <= to_row < codes.shape[0]
        and 0 <= to_col < codes.shape[1]
        and codes[to_row, to_col] != OBSTACLE
    )


@kernel
def fill_action_masks(codes, positions, masks):
    """Write which moves are valid to masks.

    codes uint8[num, rows, cols], positions int64[num, 2], masks bool[num, 4]
    """
    for i in range(codes.shape[0]):
        for action in range(4):
            masks[i, action] = is_valid(codes[i], positions[i, 0], positions[i, 1], action)


def action_masks(codes: NDArray[np.uint8], positions: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which moves stay on the grid and off known obstacles: bool[num, 4].

    codes      uint8[num, rows, cols]
    positions  int64[num, 2], (row, col) of each rover

    Neighbours across an edge are always known (the radius is at least 1, and nothing lies between),
    so on real observations these are exactly the moves that do not end the episode.
    """
    masks = np.zeros((len(codes), 4), np.bool_)
    fill_action_masks(read_only(codes), positions, masks)
    return masks


@kernel
def valid_action_bits(codes, row, col):
    """An int whose bit `action` is set if that move from (row, col) is valid.

    codes  uint8[rows, cols]
    """
    bits = 0
    for action in range(4):
        if is_valid(codes, row, col, action):
            bits |= 1 << action
    return bits


def valid_actions(codes: Codes, row: int, col: int) -> list[int]:
    """The valid moves of one rover at (row, col), in the order of their codes."""
    bits = valid_action_bits(read_only(codes), row, col)
    return [action for action in range(4) if bits >> action & 1]
