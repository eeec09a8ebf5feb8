"""Where moves are lost: the kinds of loss, by simple definitions that look at the true terrain.

A loss is a move with a regret above zero (see `regret`). The first definition that fits is its kind:

    ended early    the move was invalid and ended the episode
    last cells     at least LAST_CELLS of all cells were known before it
    hidden pocket  a pocket, a group of at most POCKET_CELLS unknown cells with a free one among them, lay within the sensor's
                   radius; the best action leads nearer to it and the move made does not
    early detour   everything else
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy
from numpy.typing import NDArray

from marsexplorer.config import UNKNOWN
from marsexplorer.episode import Record, moves_of
from marsexplorer.observation import DISPLACEMENTS

LAST_CELLS = 0.95
"""Share of the cells known from which on a loss is one of the last cells."""
POCKET_CELLS = 12
"""Unknown cells of a pocket, at most."""


class LossKind(StrEnum):
    """Kinds of loss, in the order in which they are shown."""

    HIDDEN_POCKET = "hidden pocket"
    EARLY_DETOUR = "early detour"
    LAST_CELLS = "last cells"
    ENDED_EARLY = "ended early"


@dataclass(frozen=True)
class Loss:
    """A move and what it cost.

    step         its number, 0 for the first move
    action       made; best_action: one of the best
    regret       moves lost, at least 0
    coverage     before it, 0..1
    kind         None where nothing was lost
    """

    step: int
    action: int
    best_action: int
    regret: int
    coverage: float
    kind: LossKind | None


def classify_losses(
    record: Record, lengths: NDArray[np.int64]
) -> tuple[NDArray[np.float64], tuple[LossKind | None, ...]]:
    """Return the coverage before each move, float64[moves], and the kind of each move's loss.

    lengths  int64[moves, 4], of `regret.branch_lengths`
    """
    terrain = record.terrain_map()
    coverage, kinds = np.zeros(len(record.actions)), list[LossKind | None]()
    for step, (episode, action) in enumerate(moves_of(record)):
        coverage[step] = episode.coverage
        best, kind = int(lengths[step].argmin()), None
        if lengths[step, action] > lengths[step, best]:
            towards = [moved(episode.position, each) for each in (action, best)]
            if is_blocked(terrain, towards[0]):
                kind = LossKind.ENDED_EARLY
            elif coverage[step] >= LAST_CELLS:
                kind = LossKind.LAST_CELLS
            else:
                position, radius = episode.position, record.config.sensor_radius
                leaves = leaves_pocket(episode.codes, terrain, position, towards, radius)
                kind = LossKind.HIDDEN_POCKET if leaves else LossKind.EARLY_DETOUR
        kinds.append(kind)
    return coverage, tuple(kinds)


def leaves_pocket(
    codes: NDArray[np.uint8],
    terrain: NDArray[np.bool_],
    position: tuple[int, int],
    towards: list[tuple[int, int]],
    radius: int,
) -> bool:
    """Return whether a pocket within `radius` of the rover is left by the first of two moves and approached by the second.

    codes     uint8[rows, cols], known; terrain bool[rows, cols], True where blocked
    towards   the cells (row, col) that the two moves lead to; distances are row and column steps, obstacles ignored
    """
    groups, count = scipy.ndimage.label(codes == UNKNOWN)
    for number in range(1, count + 1):
        cells = np.argwhere(groups == number)
        if len(cells) > POCKET_CELLS or not (~terrain[tuple(cells.T)]).any():
            continue
        places = (np.array(cell) for cell in (position, *towards))
        before, made, best = (int(np.abs(cells - place).sum(1).min()) for place in places)
        if int(np.abs(cells - np.array(position)).max(1).min()) <= radius and best < before <= made:
            return True
    return False


def moved(position: tuple[int, int], action: int) -> tuple[int, int]:
    """Return the cell that an action leads to, perhaps off the grid."""
    down, right = DISPLACEMENTS[action]
    return position[0] + down, position[1] + right


def is_blocked(terrain: NDArray[np.bool_], cell: tuple[int, int]) -> bool:
    """Return whether a cell is an obstacle or off the grid."""
    row, col = cell
    is_on_grid = 0 <= row < terrain.shape[0] and 0 <= col < terrain.shape[1]
    return not is_on_grid or bool(terrain[row, col])
