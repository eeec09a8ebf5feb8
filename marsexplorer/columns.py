"""What `info` says of each environment of a stack, written while the rules step: rovers' cells, coverage and score.

Steps cost tens of nanoseconds, so that columns made afterwards in NumPy would cost as much as the rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import COLLIDED, EXPLORED, OUT_OF_BOUNDS, RUNNING, TIMED_OUT
from marsexplorer.rules import (
    AT_START,
    BONUS,
    CELLS,
    DISCOVERED,
    OUTCOME,
    POSITION,
    R_MOVE,
    STEPS,
    begin_next,
    move_all,
    settle,
)


@inlined
def describe_one(state, base, rules, positions, shares, at):
    """Write what stands in one world's scalars to positions[at : at + 2] (row, col) and shares[at : at + 2]."""
    where, outcome = state[base + POSITION], state[base + OUTCOME]
    positions[at], positions[at + 1] = np.int64(where >> np.uint64(32)), np.int64(where & np.uint64(0xFFFFFFFF))
    cells, bonus = float(state[base + CELLS]), float(rules[BONUS])

    # The return so far (eq. 8 summed): cells found by moves, less the cost of valid moves, with bonus or penalty at the end.
    discovered, moves = float(state[base + DISCOVERED]), float(state[base + STEPS])
    total = discovered - float(state[base + AT_START])
    if outcome == np.uint64(COLLIDED) or outcome == np.uint64(OUT_OF_BOUNDS):
        total -= R_MOVE * (moves - 1.0) + bonus
    else:
        total -= R_MOVE * moves
        if outcome == np.uint64(EXPLORED):
            total += bonus
    shares[at] = discovered / cells
    shares[at + 1] = (total + bonus) / (bonus + bonus + cells)


@kernel
def describe(state, record, rules, positions, shares):
    """Write the columns of every world.

    positions  int64[2 num], (row, col) of each rover
    shares     float64[2 num], coverage and score (`score.score`) of each world
    """
    for i in range(shares.shape[0] >> 1):
        describe_one(state, i * record, rules, positions, shares, 2 * i)


@kernel
def step_described(
    actions, state, record, codes, sight, rules, masks, rewards, outcomes, listed, last, last_codes,
    positions, shares, last_positions, last_shares,
):  # fmt: skip
    """Do `rules.step_autoreset` and `describe`, and write the last columns of the worlds that ended to those called last."""
    move_all(actions, state, record, codes, sight, rules, rewards, listed)
    for i in range(actions.shape[0]):
        outcomes[i] = np.uint8(settle(state, np.uint64(i) * np.uint64(record), rules, rewards, i))
        if outcomes[i] != RUNNING:
            describe_one(state, i * record, rules, last_positions, last_shares, 2 * i)
            if not begin_next(state, record, codes, sight, rules, masks, last, last_codes, i):
                return i + 1
        describe_one(state, i * record, rules, positions, shares, 2 * i)
    return 0


@kernel
def are_actions(actions: NDArray[np.int64]) -> bool:
    """Return whether every number of int64[:] is an action code."""
    is_fine = True
    for i in range(actions.shape[0]):
        is_fine &= 0 <= actions[i] < 4
    return is_fine


@kernel
def list_endings(
    outcomes: NDArray[np.uint8],
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    ended: NDArray[np.bool_],
    which: NDArray[np.intp],
) -> int:
    """Write from outcomes, uint8[num], how each episode went on, bool[num] thrice; list which ended and return how many."""
    count = 0
    for i in range(outcomes.shape[0]):
        outcome = outcomes[i]
        truncated[i] = outcome == TIMED_OUT
        ended[i] = outcome != RUNNING
        terminated[i] = ended[i] and not truncated[i]
        which[count] = i
        count += ended[i]
    return count


@dataclass(frozen=True)
class Columns:
    """Memory for the columns of `num` worlds as they are, or as they were when they last ended.

    positions  int64[num, 2], (row, col) of each rover
    coverage   float64[num], cells discovered over all that count
    scores     float64[num], see `score.score`
    """

    num: int

    @cached_property
    def arrays(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """positions and shares as `describe` takes them."""
        return np.zeros(2 * self.num, np.int64), np.zeros(2 * self.num)

    @property
    def positions(self) -> NDArray[np.int64]:
        """(row, col) of each rover."""
        return self.arrays[0].reshape(self.num, 2)

    @property
    def coverage(self) -> NDArray[np.float64]:
        """Cells discovered over all that count."""
        return self.arrays[1][0::2]

    @property
    def scores(self) -> NDArray[np.float64]:
        """Normalized scores."""
        return self.arrays[1][1::2]
