"""What all policies share: protocol, errors, memory of an episode; random moves."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from marsexplorer.observation import (
    DISPLACEMENTS,
    EAST,
    Codes,
    decode,
    rover_position,
    valid_actions,
)
from marsexplorer.random_numbers import draw_below, mix

INVALID_LOGIT = -1e9
"""The logit of a move that is not valid."""


@runtime_checkable
class Policy(Protocol):
    """Decide from observations alone; one object for each board.


    observation  float32[rows, cols] of eq. 6 (0 unknown, 0.3 free, 0.6 rover, 1 obstacle) or uint8
                 codes, any size

    A policy may remember the episode: after `reset(seed)`, the same observations give the same
    actions.
    """

    name: str

    def reset(self, seed: int) -> None:
        """Forget the last episode; `seed` fixes whatever the policy draws in the next."""

    def act(self, observation: NDArray[Any]) -> int:
        """Choose an action 0..3 (north, east, south, west)."""


def begin(policy: Policy, level: str, seed: int) -> None:
    """Reset a policy for an episode, and pass the level to a policy that uses it."""
    if (set_level := getattr(policy, "set_level", None)) is not None:
        set_level(level)
    policy.reset(seed)


def begin_draws(seed: int) -> np.random.Generator:
    """The generator that a policy draws an episode's moves from."""
    return np.random.Generator(np.random.PCG64(mix(seed)))


def draw_action(probabilities: NDArray[np.float32], generator: np.random.Generator) -> int:
    """Draw an action 0..3 with the probabilities float32[4]."""
    cumulative = np.cumsum(probabilities, dtype=np.float64)
    drawn = generator.random() * cumulative[3]
    return int(np.searchsorted(cumulative[:3], drawn, side="right"))


def goal_of(policy: Policy) -> tuple[int, int] | None:
    """The free cell (row, col) that a policy's last action leads towards, or None.

    Rules have one as long as there is something to see. A network chooses moves and has none,
    unless its loop guard chose.
    """
    find_goal = getattr(policy, "goal", None)
    goal: tuple[int, int] | None = find_goal() if find_goal is not None else None
    return goal


def cell_at(flat: int, cols: int) -> tuple[int, int] | None:
    """(row, col) of a cell row * cols + col, None for a negative number."""
    return divmod(flat, cols) if flat >= 0 else None


class PolicyNotFoundError(LookupError):
    """No policy has this name, and no file is at this path."""


class PolicyFileError(ValueError):
    """The file exists but is not a policy that can be played."""


def check_onnxruntime() -> None:
    """Import the package that plays policy files; PolicyFileError if it is missing."""
    try:
        import_module("onnxruntime")
    except ModuleNotFoundError as error:
        raise PolicyFileError(
            "policy files need the package onnxruntime, which is not installed; "
            "pip install 'humanplay[play]'"
        ) from error


class Memory:
    """An episode as remembered from its observations, with the cells visited.

    codes       uint8[rows, cols], the newest observation
    position    (row, col) of the rover
    visited     uint8[rows, cols], 1 where the rover has stood: it scanned there, so nothing new
                shows
    heading     the last displacement as an action; east before the first, as `Episode.heading`
    steps       observations since `forget`, less one
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

    def observe(self, observation: NDArray[Any]) -> None:
        """Remember an observation; one of another shape than the last starts a new memory."""
        codes = decode(observation)
        position = rover_position(codes)
        if codes.shape != self.codes.shape:
            self.forget()
            self.visited = np.zeros(codes.shape, np.uint8)
        elif self.steps >= 0:
            moved = (position[0] - self.position[0], position[1] - self.position[1])
            if moved in DISPLACEMENTS:
                self.heading = DISPLACEMENTS.index(moved)
        self.codes, self.position = codes, position
        self.visited[position] = 1
        self.steps += 1


class RandomPolicy:
    """The baseline of all policies: a uniform draw from the moves known to be valid.

    It goes north if there is none. The draws depend only on (seed, number of moves made), on
    every platform and library version.
    """

    name = "random"

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start the stream that `seed` names."""
        self._seed, self._steps = seed, 0

    def act(self, observation: NDArray[Any]) -> int:
        codes = decode(observation)
        actions = valid_actions(codes, *rover_position(codes))
        self._steps += 1
        if not actions:
            return 0
        return actions[draw_below(self._seed, self._steps, len(actions))]
