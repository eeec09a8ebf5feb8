"""What a stack says of its worlds beside codes and rewards, written while the rules step: coverage, score, who ended.

Steps cost tens of nanoseconds, so that columns made afterwards in NumPy would cost as much as the rules.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import COLLIDED, EXPLORED, OUT_OF_BOUNDS, RUNNING, TIMED_OUT
from marsexplorer.rules import (
    AT_START,
    BLOCK,
    BONUS,
    CELLS,
    DISCOVERED,
    OUTCOME,
    R_MOVE,
    STEPS,
    begin_next,
    move_block,
    settle,
)


@inlined
def describe_one(state, base, rules, shares, at):
    """Write what stands in one world's scalars, coverage and score, to shares[at : at + 2]."""
    outcome, cells, bonus = state[base + OUTCOME], float(state[base + CELLS]), float(rules[BONUS])

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
def describe(state, record, rules, shares):
    """Write coverage and score (`score.score`) of every world to shares, float64[2 num]."""
    for i in range(shares.shape[0] >> 1):
        describe_one(state, i * record, rules, shares, 2 * i)


@kernel
def step_described(
    actions, state, record, codes, sight, rules, masks, rewards, outcomes, listed, last, last_codes,
    shares, last_shares, ended, terminated, truncated, which,
):  # fmt: skip
    """Do `rules.step_autoreset` and `describe`, write the last shares of the worlds that ended, and list those.

    ended, terminated, truncated  bool[num], written: how each episode went on
    which                         int64[num], written from the front: the worlds that ended

    Return how many ended, or -1 - the index of a world whose next seed has no solvable draw.
    """
    count = 0
    for first in range(0, actions.shape[0], BLOCK):
        end = min(first + BLOCK, actions.shape[0])
        move_block(actions, state, record, codes, sight, rules, rewards, listed, first, end)
        for i in range(first, end):
            outcomes[i] = np.uint8(settle(state, np.uint64(i) * np.uint64(record), rules, rewards, i))
            if outcomes[i] != RUNNING:
                describe_one(state, i * record, rules, last_shares, 2 * i)
                which[count] = i
                count += 1
                if not begin_next(state, record, codes, sight, rules, masks, last, last_codes, i):
                    return -1 - i
            describe_one(state, i * record, rules, shares, 2 * i)

    # By itself, so that many worlds take one instruction.
    for i in range(outcomes.shape[0]):
        outcome = outcomes[i]
        ended[i], truncated[i] = outcome != RUNNING, outcome == TIMED_OUT
        terminated[i] = (outcome != RUNNING) & (outcome != TIMED_OUT)
    return count


@kernel
def are_actions(actions: NDArray[np.int64]) -> bool:
    """Return whether every number of int64[:] is an action code, 0..3: whether none has a higher bit."""
    bits = np.uint64(0)
    for i in range(actions.shape[0]):
        bits |= np.uint64(actions[i])
    return bool(bits < np.uint64(4))
