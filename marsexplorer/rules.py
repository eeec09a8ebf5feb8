"""The rules, once, compiled: start and move worlds that stand in one array of words.

Koutras et al. 2021, section 2. A rover starts at (0, 0) and scans. Each move goes one cell north (row - 1), east (col + 1),
south (row + 1) or west (col - 1). A move off the grid or into an obstacle leaves the rover where it was, has the reward
-r_invalid and terminates. Any other move has the newly discovered cells - 0.5 as its reward, plus r_bonus, with termination,
once discovered / n >= beta (eq. 8). After `max_steps` moves the episode is truncated. The scan at the start gives no reward.

Worlds are records of uint64 words, one after the other:

    [0 : HEAD]       scalars, see POSITION..OUTCOME
    obstacles        (rows + 2 radius) x words, rows of bits with margins (terrain.py)
    known            the same shape; the margins count as known
    visited          the same shape; cells scanned from, which need no second scan

What a rover knows is also kept as codes, uint8[num * rows * cols], and only the cells that change are written. `rules` is
the int64 array of `rules_of`, `sight` a copy of `lidar.sight_table`, `masks` the array of `terrain.row_masks`, `base` and
`cbase` the places of a world's first word and first code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, lowest
from marsexplorer.config import COLLIDED, EXPLORED, FREE, OUT_OF_BOUNDS, ROVER, RUNNING, TIMED_OUT, EnvConfig
from marsexplorer.lidar import HEADER, ONE, find_visible, window_row
from marsexplorer.terrain import COLS, RADIUS, ROWS, SHAPE, TARGET, WORDS, draw_solvable, next_state, shape_of

POSITION, STEPS, DISCOVERED, AT_START, SEED, OUTCOME, HEAD = range(7)
"""Scalars of a world: row << 32 | col, moves made, cells discovered, cells the first scan gave, seed (NO_SEED for a given
terrain), outcome code of `config.OUTCOMES`."""

NO_SEED = 2**64 - 1
LIMIT, BONUS = SHAPE, SHAPE + 1
"""Places in the rules array, after those of terrain.shape_of: max_steps and r_bonus (= r_invalid)."""

R_MOVE = 0.5
"""r_move, section 2.4."""


def rules_of(config: EnvConfig) -> NDArray[np.int64]:
    """Return the numbers that a configuration gives the kernels: terrain.shape_of, then max_steps and r_bonus."""
    return np.concatenate([shape_of(config)[:SHAPE], [config.limit, config.r_bonus]]).astype(np.int64)


@inlined
def scan(state, base, codes, cbase, sight, rules, row, col):
    """Make every cell the lidar sees from (row, col) known and return how many were new (eq. 4 and 5)."""
    radius, words, cols = rules[RADIUS], rules[WORDS], rules[COLS]
    side = 2 * radius + 1
    lane, masks = np.int64(sight[0]), np.int64(sight[1])

    # 1. Find the cells that are seen and were unknown. With margins of `radius` all round, the window's first row and
    #    column in the padded map have the rover's own numbers. The map holds what is known, hence the flip.
    size = (rules[ROWS] + 2 * radius) * words
    obstacles = base + HEAD + row * words
    known = obstacles + size
    visible = HEADER + masks
    new = find_visible(
        state, known, ~np.uint64(0), state, obstacles, words, col, radius, sight, sight, visible,
    )  # fmt: skip

    # 2. Take them row by row of the window: a word of it holds 64 / lane rows.
    per_word = 64 // lane
    lane_mask = (ONE << np.uint64(lane)) - ONE if lane < 64 else ~np.uint64(0)
    for k in range(masks if new > 0 else 0):
        seen = sight[visible + k]
        while seen != np.uint64(0):
            j = np.int64(lowest(seen)) // lane
            bits = (seen >> np.uint64(j * lane)) & lane_mask
            seen &= ~(lane_mask << np.uint64(j * lane))
            i = k * per_word + j

            # 3. Mark the row's cells as known. The window may straddle two words of the map.
            at = known + i * words + (col >> 6)
            shift = np.uint64(col & 63)
            state[at] |= bits << shift
            if (col & 63) + side > 64:
                state[at + 1] |= bits >> (np.uint64(64) - shift)

            # 4. Write the codes of the new cells alone: 1 where the terrain is free, 1 + 2 where it is blocked.
            blocked = window_row(state, np.uint64(obstacles + i * words), np.uint64(col), np.uint64(side))
            cell = cbase + (row + i - radius) * cols + col - radius
            while bits != np.uint64(0):
                c = lowest(bits)
                bits &= bits - ONE
                codes[cell + np.int64(c)] = np.uint8(FREE) + (np.uint8((blocked >> c) & ONE) << np.uint8(1))
    return new


@inlined
def bit_at(row, col, rules):
    """Return the word (from the first of its rows of bits) and the mask of a cell."""
    bit = col + rules[RADIUS]
    return (row + rules[RADIUS]) * rules[WORDS] + (bit >> 6), ONE << np.uint64(bit & 63)


@kernel
def begin(state, base, codes, cbase, sight, rules, masks, row, col):
    """Start the world whose obstacles stand in its record: forget, place the rover, scan (section 2.3)."""
    size = (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]
    words, radius = rules[WORDS], rules[RADIUS]
    known, visited = base + HEAD + size, base + HEAD + 2 * size

    # 1. Forget: everything is known, which the margins stay, and then the grid's own cells are not.
    for at in range(size):
        state[known + at] = ~np.uint64(0)
        state[visited + at] = np.uint64(0)
    for r in range(radius * words, (radius + rules[ROWS]) * words, words):
        for word in range(words):
            state[known + r + word] = ~masks[word]
    for at in range(rules[ROWS] * rules[COLS]):
        codes[cbase + at] = np.uint8(0)

    # 2. Place the rover.
    at, mask = bit_at(row, col, rules)
    state[visited + at] |= mask
    state[base + POSITION] = np.uint64(row) << np.uint64(32) | np.uint64(col)

    # 3. Scan. The cells found now are no reward of any move, so their number is kept by itself.
    new = scan(state, base, codes, cbase, sight, rules, row, col)
    codes[cbase + row * rules[COLS] + col] = np.uint8(ROVER)
    state[base + STEPS] = np.uint64(0)
    state[base + DISCOVERED] = np.uint64(new)
    state[base + AT_START] = np.uint64(new)
    state[base + OUTCOME] = np.uint64(RUNNING)


@inlined
def start_seed(state, base, codes, cbase, sight, rules, masks, seed):
    """Start a world on the terrain of a seed; return the draws it took, 0 when none of them can be solved.

    The terrain is drawn into the record itself; the rows of `known` are the scratch of the test whether it can be solved.
    """
    size = (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]
    draws = draw_solvable(state, base + HEAD, state, size, rules, masks, seed)
    if draws:
        begin(state, base, codes, cbase, sight, rules, masks, 0, 0)
        state[base + SEED] = seed
    return draws


@kernel
def move(state, base, codes, cbase, sight, rules, action):
    """Make one move in a running world and return its reward (eq. 8); the outcome stands in the record."""
    rows, cols = rules[ROWS], rules[COLS]
    where = state[base + POSITION]
    row, col = np.int64(where >> np.uint64(32)), np.int64(where & np.uint64(0xFFFFFFFF))
    to_row = row + np.int64(action == 2) - np.int64(action == 0)
    to_col = col + np.int64(action == 1) - np.int64(action == 3)
    steps = state[base + STEPS] + ONE
    state[base + STEPS] = steps

    # 1. An invalid move ends the episode where it stands: off the grid first, for there is no cell to look up.
    if to_row < 0 or to_row >= rows or to_col < 0 or to_col >= cols:
        state[base + OUTCOME] = np.uint64(OUT_OF_BOUNDS)
        return -float(rules[BONUS])
    at, mask = bit_at(to_row, to_col, rules)
    if state[base + HEAD + at] & mask:
        state[base + OUTCOME] = np.uint64(COLLIDED)
        return -float(rules[BONUS])

    # 2. Move. A cell that was scanned from before shows nothing new, so it is not scanned again.
    codes[cbase + row * cols + col] = np.uint8(FREE)
    state[base + POSITION] = np.uint64(to_row) << np.uint64(32) | np.uint64(to_col)
    new = 0
    visited = base + HEAD + 2 * (rows + 2 * rules[RADIUS]) * rules[WORDS] + at
    if not state[visited] & mask:
        state[visited] |= mask
        new = scan(state, base, codes, cbase, sight, rules, to_row, to_col)
    codes[cbase + to_row * cols + to_col] = np.uint8(ROVER)

    # 3. Reward: the new cells less the cost of a move, and the bonus for exploring enough. Success on the last move allowed
    #    is success, so it is tested before the limit.
    discovered = np.int64(state[base + DISCOVERED]) + new
    state[base + DISCOVERED] = np.uint64(discovered)
    reward = float(new) - R_MOVE
    if discovered >= rules[TARGET]:
        state[base + OUTCOME] = np.uint64(EXPLORED)
        return reward + float(rules[BONUS])
    if np.int64(steps) >= rules[LIMIT]:
        state[base + OUTCOME] = np.uint64(TIMED_OUT)
    return reward


@kernel
def start_all(state, record, codes, sight, rules, masks, seeds):
    """Start every world on its seed; return 0, or 1 + the index of the first whose seed has no solvable draw."""
    cells = rules[ROWS] * rules[COLS]
    for i in range(seeds.shape[0]):
        if not start_seed(state, i * record, codes, i * cells, sight, rules, masks, seeds[i]):
            return i + 1
    return 0


@kernel
def start_given(state, base, codes, cbase, sight, rules, masks, row, col):
    """Start one world on the obstacles that stand in its record."""
    begin(state, base, codes, cbase, sight, rules, masks, row, col)
    state[base + SEED] = np.uint64(NO_SEED)


@kernel
def step_all(state, record, codes, sight, rules, masks, actions, rewards, outcomes):
    """Make one move in every world that is running; an ended one stays as it is and has reward 0."""
    cells = rules[ROWS] * rules[COLS]
    for i in range(actions.shape[0]):
        base = i * record
        reward = 0.0
        if state[base + OUTCOME] == np.uint64(RUNNING):
            reward = move(state, base, codes, i * cells, sight, rules, actions[i])
        rewards[i] = reward
        outcomes[i] = np.uint8(state[base + OUTCOME])


@kernel
def step_autoreset(state, record, codes, sight, rules, masks, actions, rewards, outcomes, last, last_codes):
    """Do `step_all`, and start each world that ended on the seed that follows its own.

    last, last_codes  uint64[num * HEAD] and uint8[num * rows * cols], written: the scalars and codes of each ended world

    Return 0, or 1 + the index of a world whose next seed has no solvable draw. No world is ended before the step, since each
    begins anew at once.
    """
    cells = rules[ROWS] * rules[COLS]
    for i in range(actions.shape[0]):
        base, cbase = i * record, i * cells
        rewards[i] = move(state, base, codes, cbase, sight, rules, actions[i])
        outcome = state[base + OUTCOME]
        outcomes[i] = np.uint8(outcome)
        if outcome != np.uint64(RUNNING):
            for at in range(HEAD):
                last[i * HEAD + at] = state[base + at]
            for at in range(cells):
                last_codes[cbase + at] = codes[cbase + at]
            seed = next_state(state[base + SEED])
            if not start_seed(state, base, codes, cbase, sight, rules, masks, seed):
                return i + 1
    return 0
