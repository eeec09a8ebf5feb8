"""The compiled rules: start and move worlds that stand in one array of words.

Koutras et al. 2021, section 2. A rover starts at (0, 0) and scans. Each move goes one cell north
(row - 1), east (col + 1), south (row + 1) or west (col - 1). A move off the grid or into an
obstacle leaves the rover where it was, has the reward -r_invalid and terminates. Any other move has
the newly discovered cells - 0.5 as its reward, plus r_bonus, with termination, once discovered / n
>= beta (eq. 8). After `max_steps` moves the episode is truncated. The scan at the start gives no
reward. Where only what can be discovered counts (`EnvConfig.discoverable_only`), the number of
those cells stands for n in that test.

Worlds are records of uint64 words, one after the other:

    [0 : HEAD]       scalars, see POSITION..ENOUGH
    obstacles        (rows + 2 radius) x words, rows of bits with margins (bitmap.py)
    known            the same shape; the margins count as known
    visited          the same shape; cells scanned from, which need no second scan

What a rover knows is also kept as codes, uint8[num * rows * cols], and only the cells that change
are written. `rules` is the int64 array of `rules_of`, `sight` a copy of `lidar.sight_table`,
`masks` the array of `bitmap.row_masks`, `base` and `cbase` the places of a world's first word and
first code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.bitmap import COLS, RADIUS, ROWS, SHAPE, TARGET, WORDS, flood, shape_of
from marsexplorer.compiled import inlined, kernel, prefetch
from marsexplorer.config import (
    COLLIDED,
    EXPLORED,
    FREE,
    OUT_OF_BOUNDS,
    ROVER,
    RUNNING,
    TIMED_OUT,
    EnvConfig,
)
from marsexplorer.lidar import ONE
from marsexplorer.scan import scan
from marsexplorer.terrain import draw_solvable, following

POSITION, STEPS, DISCOVERED, AT_START, SEED, OUTCOME, CELLS, ENOUGH, HEAD = range(9)
"""Scalars of a world: row << 32 | col, moves made, cells discovered, cells the first scan gave,
seed (NO_SEED for a given terrain), outcome code of `config.OUTCOMES`, cells that count (all, or
those that can be discovered), how many are enough.
"""

NO_SEED = 2**64 - 1
LIMIT, BONUS = SHAPE, SHAPE + 1
"""Places in the rules array, after those of bitmap.shape_of: max_steps and r_bonus (=
r_invalid).
"""

R_MOVE = 0.5
"""r_move, section 2.4."""

AHEAD, LINE = 4, 8
"""How many scans ahead the memory is asked for, and the words of a cache line."""

BLOCK, HEADS_AHEAD = 256, 16
"""Worlds that move together, so that what a step touches of them stays in the nearer caches; how
many worlds ahead the memory of the scalars is asked for.
"""


def rules_of(config: EnvConfig) -> NDArray[np.int64]:
    """The numbers that the kernels take: bitmap.shape_of, then max_steps and r_bonus."""
    return np.concatenate([shape_of(config), [config.limit, config.r_bonus]]).astype(np.int64)


@inlined
def bit_at(row, col, rules):
    """The word (from the first of its rows of bits) and the mask of a cell."""
    bit = col + rules[RADIUS]
    return (row + rules[RADIUS]) * rules[WORDS] + (bit >> 6), ONE << np.uint64(bit & 63)


@inlined
def forget(state, base, codes, cbase, rules, masks):
    """Make every cell unknown and unvisited."""
    words, radius = rules[WORDS], rules[RADIUS]
    size = (rules[ROWS] + 2 * radius) * words
    # everything becomes known first, which the margins stay; then the grid becomes unknown
    known_rows, visited = base + HEAD + size, base + HEAD + 2 * size
    for at in range(size):
        state[known_rows + at] = ~np.uint64(0)
        state[visited + at] = np.uint64(0)
    for r in range(radius * words, (radius + rules[ROWS]) * words, words):
        for word in range(words):
            state[known_rows + r + word] = ~masks[word]
    for at in range(rules[ROWS] * rules[COLS]):
        codes[cbase + at] = np.uint8(0)


@kernel
def begin(state, base, codes, cbase, sight, rules, masks, row, col, cells, enough):
    """Start the world whose obstacles stand in its record (section 2.3).

    cells, enough  the cells that count, and how many of them end the episode
    """
    visited = base + HEAD + 2 * (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]

    # 1. Place the rover on a map of which nothing is known.
    forget(state, base, codes, cbase, rules, masks)
    at, mask = bit_at(row, col, rules)
    state[visited + at] |= mask
    state[base + POSITION] = np.uint64(row) << np.uint64(32) | np.uint64(col)

    # 2. Scan. The cells found now are no reward of any move, so their number is kept by itself.
    new = scan(state, base + HEAD, codes, cbase, sight, rules, row, col)
    codes[cbase + row * rules[COLS] + col] = np.uint8(ROVER)
    state[base + STEPS] = np.uint64(0)
    state[base + DISCOVERED] = np.uint64(new)
    state[base + AT_START] = np.uint64(new)
    state[base + OUTCOME] = np.uint64(RUNNING)
    state[base + CELLS] = np.uint64(cells)
    state[base + ENOUGH] = np.uint64(enough)


@inlined
def start_seed(state, base, codes, cbase, sight, rules, masks, seed):
    """Start a world on the terrain of a seed; return its draws, 0 if none is solvable.

    The terrain is drawn into the record itself; the rows of `known` are the scratch of the test
    whether it can be solved.
    """
    size = (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]
    draws = draw_solvable(state, base + HEAD, state, size, rules, masks, seed)
    if draws:
        cells, enough = rules[ROWS] * rules[COLS], rules[TARGET]
        begin(state, base, codes, cbase, sight, rules, masks, 0, 0, cells, enough)
        state[base + SEED] = seed
    return draws


@inlined
def advance(state, record, codes, rules, actions, rewards, listed, first, end):
    """Move the running worlds first..end - 1; return how many must scan.

    These are listed. A world that ended stays as it is. Rewards are those of the moves, without
    what scans find and without the bonus.
    """
    rows, cols, radius, words = rules[ROWS], rules[COLS], rules[RADIUS], rules[WORDS]
    cells, count = np.uint64(rows * cols), 0
    visited = np.uint64(2 * (rows + 2 * radius) * words)
    for i in range(first, end):
        base, cbase = np.uint64(i) * np.uint64(record), np.uint64(i) * cells
        rewards[i] = 0.0
        prefetch(state, (i + HEADS_AHEAD) * record)
        if state[base + np.uint64(OUTCOME)] != np.uint64(RUNNING):
            continue
        position, action = state[base + np.uint64(POSITION)], actions[i]
        row, col = np.int64(position >> np.uint64(32)), np.int64(position & np.uint64(0xFFFFFFFF))
        to_row = row + np.int64(action == 2) - np.int64(action == 0)
        to_col = col + np.int64(action == 1) - np.int64(action == 3)
        state[base + np.uint64(STEPS)] += ONE

        # 1. An invalid move ends the episode where it stands. The margins are wide enough to look
        #    up any cell one move away.
        bit = np.uint64(to_col + radius)
        at = base + np.uint64(HEAD) + np.uint64((to_row + radius) * words) + (bit >> np.uint64(6))
        mask = ONE << (bit & np.uint64(63))
        is_off = to_row < 0 or to_row >= rows or to_col < 0 or to_col >= cols
        if is_off or state[at] & mask:
            state[base + np.uint64(OUTCOME)] = np.uint64(OUT_OF_BOUNDS if is_off else COLLIDED)
            rewards[i] = -float(rules[BONUS])
            continue

        # 2. Move. A cell that was scanned from before shows nothing new, so only a world on a new
        #    one is listed: its number is written always and counted then, for nothing foretells
        #    which move leads to a new cell.
        codes[cbase + np.uint64(row * cols + col)] = np.uint8(FREE)
        codes[cbase + np.uint64(to_row * cols + to_col)] = np.uint8(ROVER)
        state[base + np.uint64(POSITION)] = np.uint64(to_row) << np.uint64(32) | np.uint64(to_col)
        rewards[i] = -R_MOVE
        listed[count] = i
        count += np.int64(state[at + visited] & mask == np.uint64(0))
        state[at + visited] |= mask
    return count


@inlined
def scan_listed(state, record, codes, sight, rules, rewards, listed, count):
    """Scan from the new cells of the listed worlds; count and reward discoveries."""
    cells, words = rules[ROWS] * rules[COLS], rules[WORDS]
    known_rows = (rules[ROWS] + 2 * rules[RADIUS]) * words
    for k in range(count):
        # 1. The rows of a later world's window are on their way while this one is scanned.
        if k + AHEAD < count:
            base = listed[k + AHEAD] * record
            position = state[base + POSITION]
            first = base + HEAD + np.int64(position >> np.uint64(32)) * words
            first += np.int64(position & np.uint64(0xFFFFFFFF)) >> 6
            for line in range(0, 16 * words, LINE):
                prefetch(state, first + line)
                prefetch(state, first + known_rows + line)

        # 2. Scan. The arguments have the types that they have in `begin`, so that `scan` is
        #    compiled once.
        i = listed[k]
        base = i * record
        position = state[base + POSITION]
        row, col = np.int64(position >> np.uint64(32)), np.int64(position & np.uint64(0xFFFFFFFF))
        new = scan(state, base + HEAD, codes, i * cells, sight, rules, row, col)
        state[base + DISCOVERED] += np.uint64(new)
        rewards[i] += float(new)


@kernel
def move_block(actions, state, record, codes, sight, rules, rewards, listed, first, end):
    """Move the running worlds first..end - 1, with their scans; `settle` must follow.

    actions, rewards  int64[num], 0..3, and float64[num], written
    listed            int64[num], scratch
    """
    count = advance(state, record, codes, rules, actions, rewards, listed, first, end)
    scan_listed(state, record, codes, sight, rules, rewards, listed, count)


@inlined
def settle(state, base, rules, rewards, i):
    """The outcome of a world that moved: explored, timed out, or running (eq. 8).

    The bonus is added to its reward. Success on the last move allowed is success, so it is
    tested before the limit.
    """
    outcome = state[base + np.uint64(OUTCOME)]
    if outcome == np.uint64(RUNNING):
        if np.int64(state[base + np.uint64(DISCOVERED)]) >= np.int64(
            state[base + np.uint64(ENOUGH)]
        ):
            outcome = np.uint64(EXPLORED)
            rewards[i] += float(rules[BONUS])
        elif np.int64(state[base + np.uint64(STEPS)]) >= rules[LIMIT]:
            outcome = np.uint64(TIMED_OUT)
        state[base + np.uint64(OUTCOME)] = outcome
    return outcome


@inlined
def begin_next(state, record, codes, sight, rules, masks, last, last_codes, i):
    """Start a world that ended on its next seed; return whether that is solvable.

    Its last scalars and codes are copied to `last` and `last_codes` first.
    """
    cells = rules[ROWS] * rules[COLS]
    base, cbase = i * record, i * cells
    for at in range(HEAD):
        last[i * HEAD + at] = state[base + at]
    for at in range(cbase, cbase + cells):
        last_codes[at] = codes[at]
    seed = following(state[base + SEED])
    return start_seed(state, base, codes, cbase, sight, rules, masks, seed) > 0


@kernel
def start_all(state, record, codes, sight, rules, masks, seeds):
    """Start every world on its seed; return 0, or 1 + the first index that fails.

    A start fails if its seed has no solvable draw.
    """
    cells = rules[ROWS] * rules[COLS]
    for i in range(seeds.shape[0]):
        if not start_seed(state, i * record, codes, i * cells, sight, rules, masks, seeds[i]):
            return i + 1
    return 0


@kernel
def start_given(state, base, codes, cbase, sight, rules, masks, row, col, cells, enough, seed):
    """Start one world on the obstacles that stand in its record; see `begin`."""
    begin(state, base, codes, cbase, sight, rules, masks, row, col, cells, enough)
    state[base + SEED] = np.uint64(seed)


@kernel
def count_discoverable(state, base, codes, cbase, sight, rules, masks, row, col):
    """How many cells the lidar shows from the cells within reach of (row, col).

    Those cells are written to `codes`, and the rows of `visited` hold what is within reach. The
    world must be begun afterwards.
    """
    size = (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]
    forget(state, base, codes, cbase, rules, masks)
    flood(state, base + HEAD, state, 2 * size, rules, masks, row, col)
    count = np.int64(0)
    for r in range(rules[ROWS]):
        for c in range(rules[COLS]):
            at, mask = bit_at(r, c, rules)
            if state[base + HEAD + 2 * size + at] & mask:
                count += scan(state, base + HEAD, codes, cbase, sight, rules, r, c)
    return count


@kernel
def step_all(actions, state, record, codes, sight, rules, masks, rewards, outcomes, listed):
    """Make one move in every running world; one that ended stays and has reward 0.

    rewards, outcomes  float64[num] and uint8[num], written
    listed             int64[num], scratch
    """
    for first in range(0, actions.shape[0], BLOCK):
        end = min(first + BLOCK, actions.shape[0])
        move_block(actions, state, record, codes, sight, rules, rewards, listed, first, end)
        for i in range(first, end):
            outcomes[i] = np.uint8(
                settle(state, np.uint64(i) * np.uint64(record), rules, rewards, i)
            )


@kernel
def step_through(
    moves,
    cells,
    discovered,
    gained,
    action,
    state,
    record,
    codes,
    sight,
    rules,
    masks,
    rewards,
    outcomes,
    listed,
):
    """Make moves in the first world until it ends; return how many were made.

    moves                      uint8[moves], 0..3
    cells, discovered, gained  int32[moves], int32[moves] and float64[moves], written: the rover's
                               cell, the cells discovered and the reward after each move
    action                     int64[1], scratch; the others are those of `step_all`
    """
    for i in range(moves.shape[0]):
        if state[OUTCOME] != np.uint64(RUNNING):
            return i
        action[0] = moves[i]
        step_all(action, state, record, codes, sight, rules, masks, rewards, outcomes, listed)
        position = state[POSITION]
        row, col = np.int64(position >> np.uint64(32)), np.int64(position & np.uint64(0xFFFFFFFF))
        cells[i] = row * rules[COLS] + col
        discovered[i] = np.int64(state[DISCOVERED])
        gained[i] = rewards[0]
    return moves.shape[0]


@kernel
def step_autoreset(
    actions, state, record, codes, sight, rules, masks, rewards, outcomes, listed, last, last_codes
):
    """Do `step_all`, and start each world that ended on the seed that follows its own.

    last, last_codes  uint64[num * HEAD] and uint8[num * rows * cols], written: the scalars and
                      codes of each world that ended

    Return 0, or -1 - the index of a world whose next seed has no solvable draw. All worlds run
    before the step, since each that ends is started again at once.
    """
    for first in range(0, actions.shape[0], BLOCK):
        end = min(first + BLOCK, actions.shape[0])
        move_block(actions, state, record, codes, sight, rules, rewards, listed, first, end)
        for i in range(first, end):
            outcomes[i] = np.uint8(
                settle(state, np.uint64(i) * np.uint64(record), rules, rewards, i)
            )
            if outcomes[i] != RUNNING and not begin_next(
                state, record, codes, sight, rules, masks, last, last_codes, i
            ):
                return -1 - i
    return 0
