"""Coverage, score and which worlds ended, written while the rules step.

A step costs tens of nanoseconds a world: computing these columns in NumPy afterwards would cost as
much as the rules.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.bitmap import COLS, ROWS
from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import COLLIDED, EXPLORED, OUT_OF_BOUNDS, RUNNING, TIMED_OUT
from marsexplorer.lidar import ONE
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
    """Write one world's coverage and score to shares[at : at + 2]."""
    outcome, cells, bonus = state[base + OUTCOME], float(state[base + CELLS]), float(rules[BONUS])

    # The return so far (eq. 8 summed): cells found by moves, less the cost of valid moves, with
    # bonus or penalty at the end.
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
    """Write coverage and score (`score.score`) of every world to shares.

    shares  float64[2 num]
    """
    for i in range(shares.shape[0] >> 1):
        describe_one(state, i * record, rules, shares, 2 * i)


@inlined
def step_block(
    actions,
    rewards,
    terminated,
    truncated,
    state,
    record,
    codes,
    sight,
    rules,
    masks,
    outcomes,
    listed,
    last,
    last_codes,
    shares,
    last_shares,
    ended,
    which,
    count,
    first,
    end,
):
    """Do `step_described` for the worlds first..end - 1; list those that ended.

    The list is written from which[count] on. Return where it ends, or -1 - the index of a world
    whose next seed has no solvable draw.
    """
    # 1. Move. A world that ended begins anew, on a terrain all of whose cells count, so that all of
    #    them run now: hence `describe_one` without its cases, and with both divisions in one
    #    instruction.
    move_block(actions, state, record, codes, sight, rules, rewards, listed, first, end)
    bonus, cells = float(rules[BONUS]), float(rules[ROWS] * rules[COLS])
    whole = bonus + bonus + cells
    for i in range(first, end):
        base, at = np.uint64(i) * np.uint64(record), np.uint64(2 * i)
        outcomes[i] = np.uint8(settle(state, base, rules, rewards, i))
        if outcomes[i] != RUNNING:
            describe_one(state, i * record, rules, last_shares, 2 * i)
            which[count] = i
            count += 1
            if not begin_next(state, record, codes, sight, rules, masks, last, last_codes, i):
                return np.int64(-1) - i
        discovered = float(np.int64(state[base + np.uint64(DISCOVERED)]))
        moves = float(np.int64(state[base + np.uint64(STEPS)]))
        total = discovered - float(np.int64(state[base + np.uint64(AT_START)])) - R_MOVE * moves
        shares[at] = np.true_divide(discovered, cells)
        shares[at + ONE] = np.true_divide(total + bonus, whole)

    # 2. The flags by themselves, with places that cannot be negative, so that many worlds take one
    #    instruction.
    for i in range(first, end):
        at, outcome = np.uint64(i), outcomes[np.uint64(i)]
        ended[at], truncated[at] = outcome != RUNNING, outcome == TIMED_OUT
        terminated[at] = (outcome != RUNNING) & (outcome != TIMED_OUT)
    return count


@inlined
def are_actions(actions):
    """Whether every number of int64[:] is an action code, 0..3."""
    # an action code has no bit above the lowest two, and neither has their union
    bits = np.uint64(0)
    for i in range(actions.shape[0]):
        bits |= np.uint64(actions[i])
    return bits < np.uint64(4)


@kernel
def step_described(
    actions,
    rewards,
    terminated,
    truncated,
    state,
    record,
    codes,
    sight,
    rules,
    masks,
    outcomes,
    listed,
    last,
    last_codes,
    shares,
    last_shares,
    ended,
    which,
):
    """Do `rules.step_autoreset` and `describe`, and list the worlds that ended.

    rewards                       float64[num], written
    terminated, truncated, ended  bool[num], written: how each episode went on
    last_shares                   float64[2 num], written where a world ended: its last coverage and
                                  score
    which                         int64[num], written from the front: the worlds that ended

    Return how many ended, or -1 - the index of a world whose next seed has no solvable draw, or -1
    - num if some number is not an action; nothing has moved then.
    """
    num = actions.shape[0]
    if not are_actions(actions):
        return np.int64(-1) - num
    count = np.int64(0)
    for first in range(0, num, BLOCK):
        count = step_block(
            actions,
            rewards,
            terminated,
            truncated,
            state,
            record,
            codes,
            sight,
            rules,
            masks,
            outcomes,
            listed,
            last,
            last_codes,
            shares,
            last_shares,
            ended,
            which,
            count,
            first,
            min(first + BLOCK, num),
        )
        if count < 0:
            return count
    return count
