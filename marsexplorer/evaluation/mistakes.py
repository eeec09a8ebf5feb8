"""Mistakes: stretches of moves that are not Expert's and together cost something.

Expert's own moves cost nothing, so an episode's costs lie in such stretches. One wrong turn may
cost at several moves, and the next move may take a cost back; so a stretch is one mistake. It
begins and ends with a move whose cost is not 0. The first definition that fits its costliest move
is its kind:

    ended early    the move was invalid and ended the episode
    last cells     at least LAST_CELLS of all cells were known before it
    hidden pocket  a pocket, a group of at most POCKET_CELLS unknown cells with a free one among
                   them, lay within the sensor's radius; Expert's action leads nearer to it and the
                   move made does not
    early detour   everything else

Like the costs they depend on the true terrain of a finished episode.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import UNKNOWN
from marsexplorer.episode import Episode, Record, moves_of
from marsexplorer.observation import DISPLACEMENTS

LAST_CELLS = 0.95
"""Share of the cells known from which on a mistake is one of the last cells."""
POCKET_CELLS = 12
"""Unknown cells of a pocket, at most."""


class MistakeKind(StrEnum):
    """Kinds of mistake, in the order in which they are shown."""

    HIDDEN_POCKET = "hidden pocket"
    EARLY_DETOUR = "early detour"
    LAST_CELLS = "last cells"
    ENDED_EARLY = "ended early"


@dataclass(frozen=True)
class Mistake:
    """A stretch of moves that cost something.

    first, last    its moves, 0 for the first of the episode
    step           its costliest move, the earliest of equal ones
    action         made there
    expert_action  of Expert there
    cost           of all its moves, above 0
    kind           see above
    """

    first: int
    last: int
    step: int
    action: int
    expert_action: int
    cost: int
    kind: MistakeKind


def find_mistakes(
    record: Record, expert_actions: NDArray[np.int64], costs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], list[Mistake]]:
    """The coverage before each move, float64[moves], and the mistakes in their order.

    Args:
        record: The episode.
        expert_actions: int64[moves or more].
        costs: int64[moves].
    """
    stretches = {
        first + int(costs[first : last + 1].argmax()): (first, last)
        for first, last in _stretches(record.actions, expert_actions, costs)
        if costs[first : last + 1].sum() > 0
    }
    terrain, coverage = record.terrain_map(), np.zeros(len(record.actions))
    mistakes = []
    for step, (episode, action) in enumerate(moves_of(record)):
        coverage[step] = episode.coverage
        if step in stretches:
            first, last = stretches[step]
            expert, cost = int(expert_actions[step]), int(costs[first : last + 1].sum())
            kind = _kind_of(episode, terrain, action, expert)
            mistakes.append(Mistake(first, last, step, action, expert, cost, kind))
    return coverage, mistakes


def _stretches(
    actions: bytes, expert_actions: NDArray[np.int64], costs: NDArray[np.int64]
) -> Iterator[tuple[int, int]]:
    """Yield the first and the last costly move of each stretch without Expert's moves."""
    is_other = np.frombuffer(actions, np.uint8) != expert_actions[: len(actions)]
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_other, [False]))))
    for begin, end in edges.reshape(-1, 2).tolist():
        costly = begin + np.flatnonzero(costs[begin:end])
        if len(costly):
            yield int(costly[0]), int(costly[-1])


def _kind_of(
    episode: Episode, terrain: NDArray[np.bool_], action: int, expert_action: int
) -> MistakeKind:
    """The kind of a costly move, from the episode before it."""
    position, radius = episode.position, episode.config.sensor_radius
    towards = [moved(position, action), moved(position, expert_action)]
    if is_blocked(terrain, towards[0]):
        return MistakeKind.ENDED_EARLY
    if episode.coverage >= LAST_CELLS:
        return MistakeKind.LAST_CELLS
    if leaves_pocket(episode.codes, terrain, position, towards, radius):
        return MistakeKind.HIDDEN_POCKET
    return MistakeKind.EARLY_DETOUR


def leaves_pocket(
    codes: NDArray[np.uint8],
    terrain: NDArray[np.bool_],
    position: tuple[int, int],
    towards: list[tuple[int, int]],
    radius: int,
) -> bool:
    """Whether the first of two moves leaves a pocket that the second approaches.

    Args:
        codes: uint8[rows, cols], as known.
        terrain: bool[rows, cols], True where blocked.
        position: (row, col) of the rover.
        towards: The cells (row, col) that the two moves lead to; distances are row and column
            steps, obstacles ignored.
        radius: Only pockets within it count, cells.
    """
    for pocket in _pockets(codes != UNKNOWN, position, radius):
        cells = np.array(pocket)
        if terrain[tuple(cells.T)].all():
            continue
        places = (np.array(cell) for cell in (position, *towards))
        before, after, better = (int(np.abs(cells - place).sum(1).min()) for place in places)
        if better < before <= after:
            return True
    return False


def _pockets(
    is_known: NDArray[np.bool_], position: tuple[int, int], radius: int
) -> Iterator[list[tuple[int, int]]]:
    """Yield the groups of at most POCKET_CELLS unknown cells within `radius`."""
    top, left = (max(0, side - radius) for side in position)
    near = ~is_known[top : position[0] + radius + 1, left : position[1] + radius + 1]
    seen = set[tuple[int, int]]()
    for row, col in np.argwhere(near).tolist():
        cell = (top + row, left + col)
        if cell in seen:
            continue
        group = [cell]
        seen.add(cell)
        for place in group:  # it grows while it is walked, until it is too large for a pocket
            around = [moved(place, action) for action in range(len(DISPLACEMENTS))]
            joined = [one for one in around if one not in group and not is_blocked(is_known, one)]
            group += joined
            seen.update(joined)
            if len(group) > POCKET_CELLS:
                break
        else:
            yield group


def moved(position: tuple[int, int], action: int) -> tuple[int, int]:
    """The cell that an action leads to, perhaps off the grid."""
    down, right = DISPLACEMENTS[action]
    return position[0] + down, position[1] + right


def is_blocked(terrain: NDArray[np.bool_], cell: tuple[int, int]) -> bool:
    """Whether a cell is an obstacle or off the grid."""
    row, col = cell
    is_on_grid = 0 <= row < terrain.shape[0] and 0 <= col < terrain.shape[1]
    return not is_on_grid or bool(terrain[row, col])
