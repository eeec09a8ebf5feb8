"""What every policy shares: protocol, errors, decoding of observations, memory of an episode, a small generator."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import OBSTACLE, ROVER

Codes = NDArray[np.uint8]
"""uint8[rows, cols]: 0 unknown, 1 free, 2 rover, 3 obstacle."""

EAST = 1
MOVES = ((-1, 0), (0, 1), (1, 0), (0, -1))
"""(row, col) displacement of actions 0..3: north, east, south, west."""

MASK64 = 2**64 - 1


@runtime_checkable
class Policy(Protocol):
    """Decides from observations alone; one object per board, told of each episode's start.

    observation  float32[rows, cols] of eq. 6 (0 unknown, 0.3 free, 0.6 rover, 1 obstacle) or uint8 codes, any size.
    A policy may remember the episode: after `reset(seed)`, the same observations give the same actions.
    """

    name: str

    def reset(self, seed: int) -> None:
        """Forget the last episode; `seed` fixes whatever the policy draws in the next."""

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3 (north, east, south, west)."""


class PolicyNotFoundError(LookupError):
    """No policy goes by this name and no file lies at this path."""


class PolicyFileError(ValueError):
    """The file is there but is no policy of ours."""


def decode(observation: NDArray[Any]) -> Codes:
    """Return the observation as uint8 codes [rows, cols], contiguous; codes pass through without a copy.

    Koutras et al. 2021, eq. 6: 0 unknown, 0.3 free, 0.6 rover, 1 obstacle.
    """
    if observation.ndim != 2:
        raise ValueError(f"an observation must have 2 dimensions (rows, cols), got shape {observation.shape}")
    if observation.dtype == np.uint8:
        return np.ascontiguousarray(observation)
    if observation.dtype.kind != "f":
        raise TypeError(f"an observation must be float32 (eq. 6) or uint8 codes, got {observation.dtype}")
    codes = (observation > 0.15).astype(np.uint8)
    codes += observation > 0.45
    codes += observation > 0.8
    return codes


def rover_position(codes: Codes) -> tuple[int, int]:
    """Return the rover's (row, col); ValueError when no cell, or more than one, holds code 2."""
    cells = np.flatnonzero(codes == ROVER)
    if len(cells) != 1:
        raise ValueError(f"an observation must hold exactly one rover cell (0.6, or code {ROVER}), got {len(cells)}")
    row, col = divmod(int(cells[0]), codes.shape[1])
    return row, col


def valid_moves(codes: Codes, row: int, col: int) -> list[int]:
    """Return the actions that lead to a cell of the grid not known to be an obstacle.

    Neighbours across an edge are always known (radius >= 1, and nothing lies between), so on real observations these are
    exactly the moves that do not end the episode.
    """
    rows, cols = codes.shape
    moves = []
    for action, (down, right) in enumerate(MOVES):
        r, c = row + down, col + right
        if 0 <= r < rows and 0 <= c < cols and codes[r, c] != OBSTACLE:
            moves.append(action)
    return moves


class Memory:
    """What an episode's observations tell beyond the last one: the cells stood on and the way the rover came.

    codes       uint8[rows, cols], the newest observation
    position    (row, col) of the rover
    visited     uint8[rows, cols], 1 where the rover has stood (those cells have nothing more to show: they were scanned)
    heading     the last displacement as an action; east before the first, as `Episode.heading`
    steps       observations taken in since `forget`, less one
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start over: the next observation is an episode's first."""
        self.codes: Codes = np.zeros((0, 0), np.uint8)
        self.visited: Codes = np.zeros((0, 0), np.uint8)
        self.position = (0, 0)
        self.heading = EAST
        self.steps = -1

    def take(self, observation: NDArray[Any]) -> None:
        """Take in an observation; one of another shape than the last starts a new memory."""
        codes = decode(observation)
        position = rover_position(codes)
        if codes.shape != self.codes.shape:
            self.forget()
            self.visited = np.zeros(codes.shape, np.uint8)
        elif self.steps >= 0:
            moved = (position[0] - self.position[0], position[1] - self.position[1])
            if moved in MOVES:
                self.heading = MOVES.index(moved)
        self.codes, self.position = codes, position
        self.visited[position] = 1
        self.steps += 1


def mix(value: int) -> int:
    """Return splitmix64's output for the 64-bit state `value`: a counter in, well-mixed 64 bits out.

    Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators". Written out so that no library version
    can change what a seed means.
    """
    z = (value + 0x9E3779B97F4A7C15) & MASK64
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK64
    return z ^ (z >> 31)


def draw(seed: int, counter: int, below: int) -> int:
    """Return the counter-th whole number in 0..below-1 of the stream that `seed` names."""
    return (mix(mix(seed & MASK64) ^ (counter & MASK64)) * below) >> 64
