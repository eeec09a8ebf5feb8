"""The rules, once: start and step over stacked worlds (one world is a stack of one).

Koutras et al. 2021, section 2. A rover starts at (0, 0) and scans. Each move goes one cell north (row - 1), east (col + 1),
south (row + 1) or west (col - 1). A move off the grid or into an obstacle leaves the rover where it was, pays -r_invalid
alone and terminates. Any other move pays the newly discovered cells - 0.5, plus r_bonus and termination once
discovered / n >= beta (eq. 8). After `max_steps` moves the episode is truncated. The scan at the start pays nothing.

Worlds are records of uint64 words, one after the other:

    [0 : HEAD]       scalars, see POSITION..SEED
    obstacles        (rows + 2 radius) x words, rows of bits with margins (terrain.py)
    known            the same shape; the margins count as known
    visited          the same shape; cells scanned from, which need no second scan

What a rover knows is kept as codes, uint8[num, rows, cols], and only the cells that change are written.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from marsexplorer import terrain as terrains
from marsexplorer.compiled import inlined, kernel, lowest, popcount
from marsexplorer.config import ACTIONS, FREE, ROVER, EnvConfig, check_seed
from marsexplorer.lidar import HEADER, sight_table, window_row
from marsexplorer.terrain import COLS, RADIUS, ROWS, SHAPE, TARGET, WORDS, grow, next_state

POSITION, STEPS, DISCOVERED, AT_START, SEED, OUTCOME, HEAD = range(7)
"""Scalars of a world: row << 32 | col, moves made, cells discovered, cells the first scan gave, seed (NO_SEED for a given
terrain), outcome code of `config.OUTCOMES`."""

NO_SEED = 2**64 - 1
RUNNING, EXPLORED, COLLIDED, OUT_OF_BOUNDS, TIMED_OUT = range(5)
LIMIT, BONUS = SHAPE, SHAPE + 1
"""Places in the rules array, after those of terrain.shape_of: max_steps and r_bonus (= r_invalid)."""

R_MOVE = 0.5
"""r_move, section 2.4."""

ONE = np.uint64(1)


@inlined
def scan(state, base, codes, cbase, sight, rules, row, col):
    """Make every cell the lidar sees from (row, col) known and return how many were new (eq. 4 and 5)."""
    radius, words, cols = rules[RADIUS], rules[WORDS], rules[COLS]
    side = 2 * radius + 1
    size = (rules[ROWS] + 2 * radius) * words
    lane, masks = np.int64(sight[0]), np.int64(sight[1])
    per_word = 64 // lane
    row_mask = (ONE << np.uint64(side)) - ONE
    obstacles = base + HEAD + row * words
    known = obstacles + size
    at_col, width = np.uint64(col), np.uint64(side)

    unknown, hidden = HEADER + masks, HEADER + 2 * masks
    anything = np.uint64(0)
    i = 0
    for k in range(masks):
        packed = np.uint64(0)
        for j in range(min(per_word, side - i)):
            found = ~window_row(state, np.uint64(known + (i + j) * words), at_col, width) & row_mask
            packed |= found << np.uint64(j * lane)
        i += per_word
        packed &= sight[HEADER + k]
        sight[unknown + k] = packed
        sight[hidden + k] = np.uint64(0)
        anything |= packed
    if anything == np.uint64(0):
        return 0

    shadows = HEADER + 3 * masks
    for i in range(side):
        found = window_row(state, np.uint64(obstacles + i * words), at_col, width) & row_mask
        while found != np.uint64(0):
            c = lowest(found)
            found &= found - ONE
            shadow = shadows + (i * side + np.int64(c)) * masks
            for k in range(masks):
                sight[hidden + k] |= sight[shadow + k]

    new = 0
    lane_mask = (ONE << np.uint64(lane)) - ONE if lane < 64 else ~np.uint64(0)
    for k in range(masks):
        seen = sight[unknown + k] & ~sight[hidden + k]
        new += np.int64(popcount(seen))
        while seen != np.uint64(0):
            j = np.int64(lowest(seen)) // lane
            bits = (seen >> np.uint64(j * lane)) & lane_mask
            seen &= ~(lane_mask << np.uint64(j * lane))
            i = k * per_word + j
            at = known + i * words + (col >> 6)
            shift = np.uint64(col & 63)
            state[at] |= bits << shift
            if (col & 63) + side > 64:
                state[at + 1] |= bits >> (np.uint64(64) - shift)
            blocked = window_row(state, np.uint64(obstacles + i * words), at_col, width)
            cell = cbase + (row + i - radius) * cols + col - radius
            while bits != np.uint64(0):
                c = lowest(bits)
                bits &= bits - ONE
                codes[cell + np.int64(c)] = np.uint8(FREE) + (np.uint8((blocked >> c) & ONE) << np.uint8(1))
    return new


@inlined
def bit_at(row, col, rules):
    """Word (from the first of its rows of bits) and mask of a cell."""
    bit = col + rules[RADIUS]
    return (row + rules[RADIUS]) * rules[WORDS] + (bit >> 6), ONE << np.uint64(bit & 63)


@inlined
def begin(state, base, codes, cbase, sight, rules, masks, row, col):
    """Start the world whose obstacles stand in its record: forget, place the rover, scan."""
    size = (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]
    words, radius = rules[WORDS], rules[RADIUS]
    known, visited = base + HEAD + size, base + HEAD + 2 * size
    for at in range(size):
        state[known + at] = ~np.uint64(0)
        state[visited + at] = np.uint64(0)
    for r in range(radius * words, (radius + rules[ROWS]) * words, words):
        for word in range(words):
            state[known + r + word] = ~masks[word]
    for at in range(rules[ROWS] * rules[COLS]):
        codes[cbase + at] = np.uint8(0)
    at, mask = bit_at(row, col, rules)
    state[visited + at] |= mask
    state[base + POSITION] = np.uint64(row) << np.uint64(32) | np.uint64(col)
    new = scan(state, base, codes, cbase, sight, rules, row, col)
    codes[cbase + row * rules[COLS] + col] = np.uint8(ROVER)
    state[base + STEPS] = np.uint64(0)
    state[base + DISCOVERED] = np.uint64(new)
    state[base + AT_START] = np.uint64(new)
    state[base + OUTCOME] = np.uint64(RUNNING)


@inlined
def start_seed(state, base, codes, cbase, sight, rules, masks, seed):
    """Start a world on the terrain of a seed; return the draws it took, 0 when none of them can be solved."""
    size = (rules[ROWS] + 2 * rules[RADIUS]) * rules[WORDS]
    draws = grow(state, base + HEAD, state, size, rules, masks, seed)
    if draws:
        begin(state, base, codes, cbase, sight, rules, masks, 0, 0)
        state[base + SEED] = seed
    return draws


@inlined
def move(state, base, codes, cbase, sight, rules, action):
    """Make one move in a running world and return its reward (eq. 8); the outcome stands in the record."""
    rows, cols = rules[ROWS], rules[COLS]
    where = state[base + POSITION]
    row, col = np.int64(where >> np.uint64(32)), np.int64(where & np.uint64(0xFFFFFFFF))
    to_row = row + np.int64(action == 2) - np.int64(action == 0)
    to_col = col + np.int64(action == 1) - np.int64(action == 3)
    steps = state[base + STEPS] + ONE
    state[base + STEPS] = steps
    if to_row < 0 or to_row >= rows or to_col < 0 or to_col >= cols:
        state[base + OUTCOME] = np.uint64(OUT_OF_BOUNDS)
        return -float(rules[BONUS])
    at, mask = bit_at(to_row, to_col, rules)
    if state[base + HEAD + at] & mask:
        state[base + OUTCOME] = np.uint64(COLLIDED)
        return -float(rules[BONUS])
    codes[cbase + row * cols + col] = np.uint8(FREE)
    state[base + POSITION] = np.uint64(to_row) << np.uint64(32) | np.uint64(to_col)
    new = 0
    visited = base + HEAD + 2 * (rows + 2 * rules[RADIUS]) * rules[WORDS] + at
    if not state[visited] & mask:
        state[visited] |= mask
        new = scan(state, base, codes, cbase, sight, rules, to_row, to_col)
    codes[cbase + to_row * cols + to_col] = np.uint8(ROVER)
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
    """Make one move in every world that is running; an ended one stays as it is and pays 0."""
    cells = rules[ROWS] * rules[COLS]
    for i in range(actions.shape[0]):
        base = i * record
        reward = 0.0
        if state[base + OUTCOME] == np.uint64(RUNNING):
            reward = move(state, base, codes, i * cells, sight, rules, actions[i])
        rewards[i] = reward
        outcomes[i] = np.uint8(state[base + OUTCOME])


@kernel
def step_on(state, record, codes, sight, rules, masks, actions, rewards, outcomes, last, last_codes):
    """`step_all`, then keep the scalars and codes of each ended world in `last` and `last_codes`, and start it on the seed
    that follows its own; return 0, or 1 + the index of a world whose next seed has no solvable draw."""
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


class Worlds:
    """A stack of `num` worlds of one configuration.

    codes     uint8[num, rows, cols], the occupancy grids as known: 0 unknown, 1 free, 2 rover, 3 obstacle
    rewards   float64[num], of the last step
    outcomes  uint8[num], codes of `config.OUTCOMES` after the last step

    The arrays are the same objects for the life of the stack: copy what must outlast a step. Not for two threads at once.
    """

    def __init__(self, config: EnvConfig, num: int = 1) -> None:
        self.config = config
        self.num = num
        words = terrains.row_words(config)
        self._size = (config.rows + 2 * config.sensor_radius) * words
        self._record = HEAD + 3 * self._size
        self._state = np.zeros(num * self._record, np.uint64)
        self.codes: NDArray[np.uint8] = np.zeros((num, config.rows, config.cols), np.uint8)
        self._codes = self.codes.reshape(-1)
        rules = np.concatenate([terrains.shape_of(config)[:SHAPE], [config.limit, config.r_bonus]]).astype(np.int64)
        self._tables = (sight_table(config.sensor_radius).copy(), rules, terrains.row_masks(config))
        self.rewards: NDArray[np.float64] = np.zeros(num)
        self.outcomes: NDArray[np.uint8] = np.zeros(num, np.uint8)
        self._scalars = self._state.reshape(num, self._record)[:, :HEAD]
        self._last = np.zeros(num * HEAD, np.uint64)
        self._last_codes: NDArray[np.uint8] | None = None

    def start(self, seeds: ArrayLike) -> None:
        """Start every world on its seed (int[num], 0..2^53-1); ValueError when a seed has no solvable terrain."""
        given = np.ascontiguousarray(seeds, np.uint64)
        failed = start_all(self._state, self._record, self._codes, *self._tables, given)
        if failed:
            raise terrains.unsolvable(self.config, int(given[failed - 1]))
        self.outcomes[:] = RUNNING

    def start_one(self, index: int, seed: int) -> None:
        """Start one world of the stack on a seed."""
        base, cells = index * self._record, self.config.n
        state, codes = self._state[base : base + self._record], self._codes[index * cells : (index + 1) * cells]
        seeds = np.array([check_seed(seed)], np.uint64)
        if start_all(state, self._record, codes, *self._tables, seeds):
            raise terrains.unsolvable(self.config, seed)
        self.outcomes[index] = RUNNING

    def start_on(self, index: int, terrain: ArrayLike, start: tuple[int, int] = (0, 0)) -> None:
        """Start one world on a given terrain, which need not be solvable.

        terrain  bool[rows, cols], True where blocked
        start    (row, col) of a free cell
        """
        cells = check_terrain(self.config, terrain, start)
        base = index * self._record
        self._state[base + HEAD : base + HEAD + self._size] = terrains.pack(cells, self.config)
        start_given(self._state, base, self._codes, index * self.config.n, *self._tables, start[0], start[1])
        self.outcomes[index] = RUNNING

    def step(self, actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Make one move in every running world and return the rewards. actions: int64[num], 0..3."""
        step_all(self._state, self._record, self._codes, *self._tables, actions, self.rewards, self.outcomes)
        return self.rewards

    def step_on(self, actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """`step`, and each world that ended begins at once on the seed that follows its own.

        `outcomes` tells which ended; `last_scalars` and `last_codes` hold how those stood. ValueError when a world's next
        seed has no solvable terrain.
        """
        last = self.last_codes.reshape(-1)
        failed = step_on(
            self._state,
            self._record,
            self._codes,
            *self._tables,
            actions,
            self.rewards,
            self.outcomes,
            self._last,
            last,
        )
        if failed:
            raise terrains.unsolvable(self.config, terrains.next_seed(int(self._last[(failed - 1) * HEAD + SEED])))
        return self.rewards

    @property
    def last_codes(self) -> NDArray[np.uint8]:
        """uint8[num, rows, cols]: the final grid of each world that ended in the last `step_on`."""
        if self._last_codes is None:
            self._last_codes = np.zeros_like(self.codes)
        return self._last_codes

    @property
    def scalars(self) -> NDArray[np.uint64]:
        """uint64[num, HEAD]: POSITION, STEPS, DISCOVERED, AT_START, SEED and OUTCOME of each world; read-only by custom."""
        return self._scalars

    def head(self, index: int) -> memoryview:
        """Return the scalars of one world as a live view of plain ints, in the order of POSITION..OUTCOME."""
        return memoryview(self._scalars[index])

    @property
    def last_scalars(self) -> NDArray[np.uint64]:
        """uint64[num, HEAD]: the same of each world that ended in the last `step_on`."""
        return self._last.reshape(self.num, HEAD)

    def terrain(self, index: int) -> NDArray[np.bool_]:
        """Return the true map of a world: bool[rows, cols], True where blocked."""
        base = index * self._record + HEAD
        return terrains.unpack(self._state[base : base + self._size], self.config)


def positions(scalars: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return int64[num, 2], (row, col) of each world, from its scalars."""
    packed = scalars[:, POSITION]
    return np.stack([packed >> np.uint64(32), packed & np.uint64(0xFFFFFFFF)], axis=1).astype(np.int64)


def totals(config: EnvConfig, scalars: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Return float64[num], the return of each world so far, from its scalars (eq. 8 summed)."""
    counts = scalars.astype(np.float64)
    outcome = scalars[:, OUTCOME]
    invalid = (outcome == COLLIDED) | (outcome == OUT_OF_BOUNDS)
    moves = counts[:, STEPS] - invalid
    paid = np.where(invalid, -config.r_invalid, np.where(outcome == EXPLORED, config.r_bonus, 0))
    return np.asarray(counts[:, DISCOVERED] - counts[:, AT_START] - R_MOVE * moves + paid)


def check_terrain(config: EnvConfig, terrain: ArrayLike, start: tuple[int, int]) -> NDArray[np.bool_]:
    """Return a given terrain as bool[rows, cols] when its type, shape and start are right; TypeError or ValueError else."""
    cells = np.asarray(terrain)
    if cells.dtype != np.bool_:
        raise TypeError(f"terrain must be an array of bool, True where blocked, got dtype {cells.dtype}")
    if cells.shape != (config.rows, config.cols):
        raise ValueError(f"terrain must have shape ({config.rows}, {config.cols}), got {cells.shape}")
    row, col = start
    if not (0 <= row < config.rows and 0 <= col < config.cols):
        raise ValueError(f"start must lie on the {config.rows}x{config.cols} grid, got {tuple(start)}")
    if cells[row, col]:
        raise ValueError(f"start must be a free cell, but {tuple(start)} is an obstacle")
    return cells


def check_action(action: Any) -> int:
    """Return an action code when it is one of 0..3; ValueError otherwise."""
    try:
        code = int(action)
    except (TypeError, ValueError):
        code = -1
    if not 0 <= code < len(ACTIONS) or code != action:
        raise ValueError(f"action must be 0 (north), 1 (east), 2 (south) or 3 (west), got {action!r}")
    return code
