"""Stacks of worlds: the compiled rules behind a few verbs.

One world is a stack of one.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from marsexplorer import terrain as terrains
from marsexplorer.bitmap import pack, row_masks, unpack
from marsexplorer.buffers import write_values
from marsexplorer.columns import describe, step_described
from marsexplorer.config import (
    ACTIONS,
    COLLIDED,
    EXPLORED,
    OUT_OF_BOUNDS,
    RUNNING,
    TIMED_OUT,
    EnvConfig,
    check_seed,
    fewest_cells,
)
from marsexplorer.lidar import row_words
from marsexplorer.observation import STATE_VALUES
from marsexplorer.rules import (
    AT_START,
    CELLS,
    DISCOVERED,
    HEAD,
    NO_SEED,
    OUTCOME,
    POSITION,
    R_MOVE,
    SEED,
    STEPS,
    count_discoverable,
    rules_of,
    start_all,
    start_given,
    step_all,
    step_autoreset,
    step_through,
)
from marsexplorer.scan import sight_of


@lru_cache(maxsize=64)
def constants_of(config: EnvConfig) -> tuple[NDArray[np.int64], NDArray[np.uint64]]:
    """What kernels read of a configuration and never write: rules and row masks."""
    return rules_of(config), row_masks(config)


class Worlds:
    """A stack of `num` worlds of one configuration.

    codes        uint8[num, rows, cols], the occupancy grids as known: 0 unknown, 1 free, 2 rover,
                 3 obstacle
    rewards      float64[num], of the last step
    outcomes     uint8[num], codes of `config.OUTCOMES` after the last step
    shares       float64[2 num], coverage and score of each world: see `step_described`
    last_shares  the same of each world that ended

    The arrays are the same objects for the life of the stack: copy what must outlast a step. Do not
    step one stack from two threads at once; several stacks may step in as many threads, as the
    rules release the interpreter's lock. `codes` may be given: uint8[num, rows, cols],
    C-contiguous, to be written to.

    A step raises RuntimeError, and moves nothing, while some world stands on no terrain: one that
    was never started, or whose start failed. The rules look up cells beyond the grid without a
    test, in margins that a start writes.
    """

    def __init__(
        self, config: EnvConfig, num: int = 1, codes: NDArray[np.uint8] | None = None
    ) -> None:
        self.config = config
        self.num = num
        words = row_words(config.cols, config.sensor_radius)
        self._size = (config.rows + 2 * config.sensor_radius) * words
        self._record = HEAD + 3 * self._size
        self._state = np.zeros(num * self._record, np.uint64)
        codes = np.zeros((num, config.rows, config.cols), np.uint8) if codes is None else codes
        self.codes = codes
        self._codes = self.codes.reshape(-1)
        self._tables = (sight_of(config.sensor_radius), *constants_of(config))
        self.rewards: NDArray[np.float64] = np.zeros(num)
        self.outcomes: NDArray[np.uint8] = np.zeros(num, np.uint8)
        self._listed = np.zeros(num, np.int64)
        self._scalars = self._state.reshape(num, self._record)[:, :HEAD]
        self._last = np.zeros(num * HEAD, np.uint64)
        self.last_scalars[:, CELLS] = config.n
        self._last_codes: NDArray[np.uint8] | None = None
        self.shares, self.last_shares = np.zeros(2 * num), np.zeros(2 * num)
        self.ended = np.zeros(num, np.bool_)
        self._which = np.zeros(num, np.int64)
        self._without_terrain = set(range(num))

    def __getstate__(self) -> tuple[Any, ...]:
        changing = [array.tobytes() for array in self._changing()]
        last_codes = None if self._last_codes is None else self._last_codes.tobytes()
        return (self.config, self.num, frozenset(self._without_terrain), changing, last_codes)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        config, num, without_terrain, changing, last_codes = state
        Worlds.__init__(self, config, num)
        for array, content in zip(self._changing(), changing, strict=True):
            array.reshape(-1)[:] = np.frombuffer(content, array.dtype)
        if last_codes is not None:
            self.last_codes.reshape(-1)[:] = np.frombuffer(last_codes, np.uint8)
        self._without_terrain = set(without_terrain)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        twin = self.__class__.__new__(self.__class__)
        memo[id(self)] = twin
        twin.__setstate__(self.__getstate__())
        return twin

    def _changing(self) -> tuple[NDArray[Any], ...]:
        """The arrays that change with a step or a start, less `last_codes`."""
        described = (self.shares, self.last_shares, self.ended)
        return (self._state, self.codes, self.rewards, self.outcomes, self._last, *described)

    def start(self, seeds: Iterable[int]) -> None:
        """Start every world on its seed (0..2^53-1).

        ValueError if a number is not a seed, or has no solvable terrain.
        """
        checked = [check_seed(seed) for seed in seeds]
        self._without_terrain.update(range(self.num))
        numbers = self._scalars[:, SEED] = np.array(checked, np.uint64)
        if self.config.discoverable_only:
            for index, seed in enumerate(checked):
                self.start_one(index, seed)
            return
        failed = start_all(self._state, self._record, self._codes, *self._tables, numbers)
        if failed:
            raise terrains.unsolvable(self.config, checked[failed - 1])
        self.outcomes[:] = RUNNING
        self._without_terrain.clear()

    def start_one(self, index: int, seed: int) -> None:
        """Start one world of the stack on a seed, as `start` does."""
        seed = check_seed(seed)
        self._without_terrain.add(index)
        self._scalars[index, SEED] = seed
        if self.config.discoverable_only:
            self._start_on_bits(index, terrains.draw_bits(self.config, seed), (0, 0), seed)
            return
        base, cells = index * self._record, self.config.n
        state = self._state[base : base + self._record]
        codes = self._codes[index * cells : (index + 1) * cells]
        seeds = np.array([seed], np.uint64)
        if start_all(state, self._record, codes, *self._tables, seeds):
            raise terrains.unsolvable(self.config, seed)
        self.outcomes[index] = RUNNING
        self._without_terrain.discard(index)

    def start_on(self, index: int, terrain: ArrayLike, start: tuple[int, int] = (0, 0)) -> None:
        """Start one world on a given terrain, which need not be solvable.

        terrain  bool[rows, cols], True where blocked
        start    (row, col) of a free cell
        """
        bits = pack(check_terrain(self.config, terrain, start), self.config)
        self._start_on_bits(index, bits, start, NO_SEED)

    def _start_on_bits(
        self, index: int, bits: NDArray[np.uint64], start: tuple[int, int], seed: int
    ) -> None:
        """Start one world on rows of bits, counting what is discoverable if need be."""
        base, cells, enough = index * self._record, self.config.n, self.config.target
        self._state[base + HEAD : base + HEAD + self._size] = bits
        place = (self._state, base, self._codes, index * cells, *self._tables, start[0], start[1])
        if self.config.discoverable_only:
            cells = int(count_discoverable(*place))
            enough = fewest_cells(cells, self.config.beta)
        start_given(*place, cells, enough, np.uint64(seed))
        self.outcomes[index] = RUNNING
        self._without_terrain.discard(index)

    def _check_terrains(self) -> None:
        if self._without_terrain:
            raise RuntimeError("no episode is running: call reset() first")

    def step(self, actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Make one move in every running world and return the rewards.

        actions  int64[num], 0..3
        """
        self._check_terrains()
        step_all(
            actions,
            self._state,
            self._record,
            self._codes,
            *self._tables,
            self.rewards,
            self.outcomes,
            self._listed,
        )
        return self.rewards

    def step_through(
        self, moves: bytes
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
        """Make moves, codes 0..3, in the only world of the stack until it ends.

        Returns:
            After each move that was made: the rover's cell, row * cols + col; the cells discovered;
            the reward.
        """
        self._check_terrains()
        codes = np.frombuffer(moves, np.uint8)
        cells, discovered = np.zeros((2, len(moves)), np.int32)
        rewards = np.zeros(len(moves))
        moves_made = step_through(
            codes,
            cells,
            discovered,
            rewards,
            self._which,
            self._state,
            self._record,
            self._codes,
            *self._tables,
            self.rewards,
            self.outcomes,
            self._listed,
        )
        return cells[:moves_made], discovered[:moves_made], rewards[:moves_made]

    def step_autoreset(self, actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Do `step`, and start each world that ended on the seed that follows its own.

        `outcomes` shows which ended; `last_scalars` and `last_codes` hold their final states.
        ValueError if a world's next seed has no solvable terrain.
        """
        self._check_terrains()
        if self.config.discoverable_only:
            self._step_and_start(actions)
        else:
            self._listed_after(step_autoreset(actions, *self._arrays), actions)
        return self.rewards

    def step_described(
        self,
        actions: NDArray[np.int64],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        values: NDArray[np.float32] | None = None,
    ) -> NDArray[np.int64]:
        """Do `step_autoreset` and describe the worlds; return those that ended, int64[:].

        `shares` and `ended` are written, and `last_shares` of the worlds that ended.

        rewards                float64[num], written
        terminated, truncated  bool[num], written: how each episode went on
        values                 float32[num * rows * cols], written: eq. 6 of the codes

        ValueError if some number is not an action, with nothing moved.
        """
        self._check_terrains()
        if self.config.discoverable_only:
            if actions.min() < 0 or actions.max() >= len(ACTIONS):
                raise not_actions(self.num, actions)
            self._step_and_start(actions)
            self.describe()
            describe(self._last, HEAD, self._tables[1], self.last_shares)
            self.ended[:] = self.outcomes != RUNNING
            truncated[:] = self.outcomes == TIMED_OUT
            rewards[:] = self.rewards
            terminated[:] = self.ended & ~truncated
            which = np.flatnonzero(self.outcomes)
        else:
            count = step_described(actions, rewards, terminated, truncated, *self._described_arrays)
            which = self._listed_after(count, actions)
        if values is not None:
            write_values(self._codes, STATE_VALUES, values)
        return which

    def _listed_after(self, count: int, actions: NDArray[np.int64]) -> NDArray[np.int64]:
        """The worlds that ended, from what a compiled step returned; ValueError if < 0."""
        if count >= 0:
            return self._which[:count]
        failed = -1 - count
        if failed == self.num:
            raise not_actions(self.num, actions)
        seed = terrains.next_seed(int(self._last[failed * HEAD + SEED]))
        self._without_terrain.update(range(self.num))  # the worlds behind it have not moved
        self._scalars[failed, SEED] = seed
        raise terrains.unsolvable(self.config, seed)

    def _step_and_start(self, actions: NDArray[np.int64]) -> None:
        """`step_autoreset` where each start counts what can be discovered, which is slow."""
        self.step(actions)
        for index in np.flatnonzero(self.outcomes != RUNNING):
            self.last_scalars[index] = self._scalars[index]
            self.last_codes[index] = self.codes[index]
            outcome = self.outcomes[index]
            self.start_one(int(index), terrains.next_seed(int(self._scalars[index, SEED])))
            self.outcomes[index] = outcome

    def describe(self) -> None:
        """Write `shares` of the worlds in their present state."""
        describe(self._state, self._record, self._tables[1], self.shares)

    @cached_property
    def _arrays(self) -> tuple[Any, ...]:
        """The arguments of the compiled `step_autoreset` after the actions."""
        last_codes = self.last_codes.reshape(-1)
        outputs = (self.rewards, self.outcomes, self._listed, self._last, last_codes)
        return (self._state, self._record, self._codes, *self._tables, *outputs)

    @cached_property
    def _described_arrays(self) -> tuple[Any, ...]:
        """The arguments of the compiled `step_described` after those of the caller."""
        *worlds, _, outcomes, listed, last, last_codes = self._arrays
        ends = (self.shares, self.last_shares, self.ended, self._which)
        return (*worlds, outcomes, listed, last, last_codes, *ends)

    def take(self, which: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """Copies of the worlds of these indices, with all that changes in a step.

        `put` takes them, on any stack of the same configuration.
        """
        self._check_terrains()
        records, codes = self._state.reshape(self.num, -1), self.codes
        return {"records": records[which], "codes": codes[which], "outcomes": self.outcomes[which]}

    def put(self, which: NDArray[np.intp], taken: dict[str, NDArray[Any]]) -> None:
        """Put the worlds that `take` returned in the places of these indices."""
        self._state.reshape(self.num, -1)[which] = taken["records"]
        self.codes[which], self.outcomes[which] = taken["codes"], taken["outcomes"]
        self._without_terrain.difference_update(which.tolist())

    @property
    def last_codes(self) -> NDArray[np.uint8]:
        """The final grids of the worlds that ended last: uint8[num, rows, cols]."""
        if self._last_codes is None:
            self._last_codes = np.zeros_like(self.codes)
        return self._last_codes

    @property
    def scalars(self) -> NDArray[np.uint64]:
        """The scalars of each world, POSITION..ENOUGH of `rules`: uint64[num, HEAD].

        Read-only by custom.
        """
        return self._scalars

    def head(self, index: int) -> memoryview:
        """The scalars of one world as a live view of ints, in the order POSITION..ENOUGH."""
        return memoryview(self._scalars[index])

    @property
    def last_scalars(self) -> NDArray[np.uint64]:
        """The scalars of each world that ended in the last step: uint64[num, HEAD]."""
        return self._last.reshape(self.num, HEAD)

    def terrain(self, index: int) -> NDArray[np.bool_]:
        """The true map of a world: bool[rows, cols], True where blocked."""
        base = index * self._record + HEAD
        return unpack(self._state[base : base + self._size], self.config)


def live_positions(scalars: NDArray[np.uint64]) -> NDArray[np.int32]:
    """(row, col) of each world as a view of its scalars: int32[num, 2]."""
    return scalars.view(np.int32)[:, 2 * POSITION : 2 * POSITION + 2][:, ::-1]


def positions(scalars: NDArray[np.uint64]) -> NDArray[np.int64]:
    """(row, col) of each world from its scalars: int64[num, 2]."""
    return live_positions(scalars).astype(np.int64, "C")


def totals(config: EnvConfig, scalars: NDArray[np.uint64]) -> NDArray[np.float64]:
    """The return of each world so far from its scalars (eq. 8 summed): float64[num]."""
    counts = scalars.astype(np.float64)
    outcome = scalars[:, OUTCOME]
    invalid = (outcome == COLLIDED) | (outcome == OUT_OF_BOUNDS)
    moves = counts[:, STEPS] - invalid
    bonuses = np.where(invalid, -config.r_invalid, np.where(outcome == EXPLORED, config.r_bonus, 0))
    return np.asarray(counts[:, DISCOVERED] - counts[:, AT_START] - R_MOVE * moves + bonuses)


def cells_that_count(config: EnvConfig, terrain: ArrayLike, start: tuple[int, int] = (0, 0)) -> int:
    """How many cells of a terrain beta, coverage and the score refer to.

    These are all cells, or those that can be discovered: that the lidar shows (eq. 4) from some
    cell that moves north, east, south and west lead to.

    Args:
        config: The configuration of the episode.
        terrain: bool[rows, cols], True where blocked.
        start: (row, col) of a free cell.
    """
    if not config.discoverable_only:
        return config.n
    worlds = Worlds(config)
    worlds.start_on(0, terrain, start)
    return int(worlds.scalars[0, CELLS])


def not_actions(num: int, actions: Any) -> ValueError:
    """The error for numbers that are not actions of `num` worlds."""
    return ValueError(f"actions must be {num} numbers in 0..3, got {actions!r}")


def check_terrain(
    config: EnvConfig, terrain: ArrayLike, start: tuple[int, int]
) -> NDArray[np.bool_]:
    """A given terrain as bool[rows, cols]; TypeError or ValueError if it does not fit."""
    cells = np.asarray(terrain)
    if cells.dtype != np.bool_:
        raise TypeError(
            f"terrain must be an array of bool, True where blocked, got dtype {cells.dtype}"
        )
    if cells.shape != (config.rows, config.cols):
        raise ValueError(
            f"terrain must have shape ({config.rows}, {config.cols}), got {cells.shape}"
        )
    row, col = start
    if not (0 <= row < config.rows and 0 <= col < config.cols):
        raise ValueError(
            f"start must lie on the {config.rows}x{config.cols} grid, got {tuple(start)}"
        )
    if cells[row, col]:
        raise ValueError(f"start must be a free cell, but {tuple(start)} is an obstacle")
    return cells


def check_action(action: Any) -> int:
    """Convert an action to its code, one of 0..3; ValueError otherwise."""
    try:
        code = int(action)
    except (TypeError, ValueError):
        code = -1
    if not 0 <= code < len(ACTIONS) or code != action:
        raise ValueError(
            f"action must be 0 (north), 1 (east), 2 (south) or 3 (west), got {action!r}"
        )
    return code
