"""An episode as it runs, its record, and the replay of a record.

A record is the cause of an episode: configuration, terrain, start and actions. The rest follows by
replay; a record's totals and trajectory hash are there to check the replay against.
"""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import ABANDONED, ACTIONS, CORE_VERSION, OUTCOMES, RUNNING, EnvConfig
from marsexplorer.observation import STATE_VALUES
from marsexplorer.rules import CELLS, DISCOVERED, NO_SEED, POSITION, SEED, STEPS
from marsexplorer.world import Worlds, cells_that_count, check_action


def score(config: EnvConfig, episode_return: float, cells: int | None = None) -> float:
    """The normalized score: 0 for an invalid first move, 1 the maximum; never clipped.

    (return + r_invalid) / (r_invalid + r_bonus + cells), Koutras et al. 2021, section 3.2, where
    cells is n.

    Args:
        config: The configuration of the episode.
        episode_return: The sum of its rewards.
        cells: Cells that count on the terrain (`world.cells_that_count`); None: all n.
    """
    counted = config.n if cells is None else cells
    return (episode_return + config.r_invalid) / (config.r_invalid + config.r_bonus + counted)


def steps_to_target(config: EnvConfig, outcome: str, steps: int) -> int:
    """Moves of an explored episode; any other finished episode counts `max_steps`."""
    return steps if outcome == "explored" else config.limit


@dataclass(frozen=True)
class Record:
    """The cause of an episode, and its totals.

    terrain          bool[rows, cols] packed by numpy.packbits, row-major
    actions          one byte a move, codes 0..3
    outcome          a name of `config.OUTCOMES`, `running` for an unfinished episode
    total            the return
    trajectory_hash  SHA-256 (hex) of the configuration, terrain, start, and of each step's
                     position, discovered cells and reward
    """

    config: EnvConfig
    seed: int | None
    terrain: bytes
    start: tuple[int, int]
    actions: bytes
    outcome: str
    total: float
    steps: int
    discovered: int
    trajectory_hash: str
    core_version: str = CORE_VERSION

    @property
    def cells(self) -> int:
        """Cells that beta, coverage and the score refer to.

        Counted from the terrain: all cells, or those that can be discovered.
        """
        if not self.config.discoverable_only:
            return self.config.n
        return cells_that_count(self.config, self.terrain_map(), self.start)

    @property
    def score(self) -> float:
        """The normalized score (section 3.2)."""
        return score(self.config, self.total, self.cells)

    def terrain_map(self) -> NDArray[np.bool_]:
        """The true map: bool[rows, cols], True where blocked."""
        return unpack_terrain(self.terrain, self.config)


def unpack_terrain(packed: bytes, config: EnvConfig) -> NDArray[np.bool_]:
    """Unpack a terrain's bits to bool[rows, cols]; ValueError if they do not fit."""
    if len(packed) != (config.n + 7) // 8:
        raise ValueError(
            f"a terrain of {config.rows}x{config.cols} takes {(config.n + 7) // 8} bytes, got {len(packed)}"
        )
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), count=config.n)
    return bits.reshape(config.rows, config.cols).astype(np.bool_)


class Episode:
    """One running episode: begin it, step through it, record it.

    actions      one byte a move, codes 0..3
    discoveries  cells discovered after 0, 1, 2, ... moves
    rewards      of each move

    The moves are arrays of numbers, which Python's garbage collector does not look through.
    """

    def __init__(self, worlds: Worlds, start: tuple[int, int]) -> None:
        self._worlds = worlds
        self._scalars = worlds.head(0)
        self._action = np.zeros(1, np.int64)
        self.config = worlds.config
        self.start = start
        seed = self._scalars[SEED]
        self.seed = None if seed == NO_SEED else seed
        self.terrain: NDArray[np.bool_] = worlds.terrain(0)
        self.actions = bytearray()
        self._cells = array("i", [start[0] * self.config.cols + start[1]])
        self.discoveries = array("i", [self._scalars[DISCOVERED]])
        self.rewards = array("d")
        self.reward = 0.0
        self.total = 0.0
        self.outcome = OUTCOMES[RUNNING]
        self._packed = np.packbits(self.terrain).tobytes()
        cause = f"{self.config.hash}|{start[0]},{start[1]}|{self.discoveries[0]}|".encode()
        self._hash = hashlib.sha256(cause + self._packed)

    @classmethod
    def begin(
        cls,
        config: EnvConfig,
        seed: int | None = None,
        terrain: NDArray[np.bool_] | None = None,
        start: tuple[int, int] = (0, 0),
    ) -> Episode:
        """Begin an episode on the terrain of a seed, or on a given terrain.

        Exactly one of seed and terrain must be given; ValueError otherwise.
        """
        if (seed is None) == (terrain is None):
            raise ValueError("an episode begins on a seed or on a terrain; give exactly one")
        worlds = Worlds(config)
        if seed is not None:
            worlds.start_one(0, seed)
            return cls(worlds, (0, 0))
        assert terrain is not None
        worlds.start_on(0, terrain, start)
        return cls(worlds, (int(start[0]), int(start[1])))

    @classmethod
    def again(cls, record: Record) -> Episode:
        """Begin the episode of a record once more, on its terrain."""
        return cls.begin(record.config, terrain=record.terrain_map(), start=record.start)

    def step(self, action: int) -> float:
        """Make one move and return its reward.

        Raises:
            RuntimeError: If the episode has ended.
            ValueError: If `action` is not one of 0..3.
        """
        if self.ended:
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        self._action[0] = check_action(action)
        self.reward = float(self._worlds.step(self._action)[0])
        self.total += self.reward
        self.outcome = OUTCOMES[self._worlds.outcomes[0]]
        self.actions.append(int(action))
        self.rewards.append(self.reward)
        row, col = self.position
        self._cells.append(row * self.config.cols + col)
        self.discoveries.append(self.discovered)
        self._hash.update(f"{row},{col},{self.discoveries[-1]},{self.reward!r}|".encode())
        return self.reward

    def play(self, actions: bytes) -> None:
        """Make many moves at once, which is faster than step by step.

        Raises:
            ValueError: If a code is not an action, or if moves follow the end of the episode.
        """
        for code in set(actions):
            check_action(code)
        before = self.steps
        cells, discovered, rewards = self._worlds.step_through(actions)
        moves_made = len(rewards)
        self.outcome = OUTCOMES[self._worlds.outcomes[0]]
        if moves_made < len(actions):
            raise ValueError(
                f"the record goes on after its end: {before + len(actions)} actions, {self.outcome} after {before + moves_made}"
            )
        self.actions += actions
        self._cells.frombytes(cells.tobytes())
        self.discoveries.frombytes(discovered.tobytes())
        self.rewards.frombytes(rewards.tobytes())
        lines = []
        for cell, newly, reward in zip(
            cells.tolist(), discovered.tolist(), rewards.tolist(), strict=True
        ):
            self.total += reward
            row, col = divmod(cell, self.config.cols)
            lines.append(f"{row},{col},{newly},{reward!r}|")
        self._hash.update("".join(lines).encode())
        if moves_made:
            self.reward = self.rewards[-1]

    def abandon(self) -> None:
        """Give up: the episode ends, and its return so far falls by r_invalid."""
        if self.ended:
            raise RuntimeError(
                f"the episode has ended ({self.outcome}); there is nothing to abandon"
            )
        self.reward = -float(self.config.r_invalid)
        self.total += self.reward
        self.outcome = OUTCOMES[ABANDONED]

    @property
    def codes(self) -> NDArray[np.uint8]:
        """The occupancy grid as known: uint8[rows, cols], a read-only view.

        It may change with the next step.
        """
        view: NDArray[np.uint8] = self._worlds.codes[0].view()
        view.flags.writeable = False
        return view

    def observation(self) -> NDArray[np.float32]:
        """The state matrix of eq. 6: float32[rows, cols].

        0 unknown, 0.3 free, 0.6 rover, 1 obstacle.
        """
        observation: NDArray[np.float32] = STATE_VALUES[self._worlds.codes[0]]
        return observation

    @property
    def position(self) -> tuple[int, int]:
        """(row, col) of the rover."""
        packed: int = self._scalars[POSITION]
        return packed >> 32, packed & 0xFFFFFFFF

    @property
    def path(self) -> list[tuple[int, int]]:
        """(row, col) of the rover after 0, 1, 2, ... moves: a new list."""
        return [divmod(cell, self.config.cols) for cell in self._cells]

    def place(self, step: int) -> tuple[int, int]:
        """(row, col) of the rover after so many moves."""
        return divmod(self._cells[step], self.config.cols)

    @property
    def discovered(self) -> int:
        """Cells discovered so far."""
        return self._scalars[DISCOVERED]

    @property
    def coverage(self) -> float:
        """Discovered cells over the cells that count, 0..1."""
        return self.discovered / self.cells

    @property
    def cells(self) -> int:
        """Cells that beta, coverage and the score refer to (`EnvConfig`)."""
        return self._scalars[CELLS]

    @property
    def steps(self) -> int:
        """Moves made so far, an invalid one included."""
        return self._scalars[STEPS]

    @property
    def score(self) -> float:
        """The normalized score so far (section 3.2)."""
        return score(self.config, self.total, self.cells)

    @property
    def heading(self) -> str:
        """Direction of the last move in words, `east` before the first."""
        return ACTIONS[self.actions[-1]] if self.actions else "east"

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome != OUTCOMES[RUNNING]

    def record(self) -> Record:
        """The episode's cause and its totals so far."""
        cause = (self.config, self.seed, self._packed, self.start, bytes(self.actions))
        totals = (self.outcome, self.total, self.steps, self.discovered)
        return Record(*cause, *totals, self._hash.hexdigest())


def moves_of(record: Record) -> Iterator[tuple[Episode, int]]:
    """Yield the same episode before each move of a record, with the move."""
    episode = Episode.again(record)
    for action in record.actions:
        yield episode, action
        episode.step(action)


def replay(record: Record) -> Episode:
    """Play a record's actions on its terrain; the caller compares the totals.

    The terrain is taken as recorded and never drawn again.

    Raises:
        ValueError: If actions follow the end of the episode, or another core version made the
            record.
    """
    if record.core_version != CORE_VERSION:
        raise ValueError(
            f"the record was made by core version {record.core_version}, this is version {CORE_VERSION}; "
            "install the release that made it to replay it"
        )
    episode = Episode.again(record)
    episode.seed = record.seed
    episode.play(record.actions)
    if record.outcome == OUTCOMES[ABANDONED] and not episode.ended:
        episode.abandon()
    return episode
