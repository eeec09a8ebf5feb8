"""Stacks of worlds played greedily by a network, as its policy plays: with the loop guard, from the observation alone.

Worlds can be taken out with all that is remembered of them and put back, also into another stack: so an episode can be played
on from any of its moments more than once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import UNKNOWN, EnvConfig
from marsexplorer.policies.base import Memory
from marsexplorer.policies.frontier import FrontierCost
from marsexplorer.policies.guard import MOVES
from marsexplorer.policies.network.features import Perception
from marsexplorer.rules import RUNNING
from marsexplorer.world import Worlds, positions

Saved = dict[str, NDArray[Any]]
"""Worlds taken out of a stack: arrays [worlds, ...]."""


class Judge(Protocol):
    """What scores the moves: `policies.network.Net`, or its like."""

    def decide(self, planes: NDArray[np.uint8], moves: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits float32[num, 4], values float32[num]) of what `Perception` gives."""


@dataclass(frozen=True)
class Decided:
    """What the network is shown of each world (planes, moves) and what follows from it.

    logits   float32[num, 4], the network's; actions int64[num], what is done; guarded bool[num], where the guard decided
    """

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    logits: NDArray[np.float32]
    actions: NDArray[np.int64]
    guarded: NDArray[np.bool_]


class Players:
    """`num` worlds of one configuration and what is remembered of each.

    visited   uint8[num, cells], 1 where the rover has stood; headings int64[num], the last action; made int64[num], moves
    met       int64[num, cells], how many cells were known when the rover was last there: a second time sets the guard off
    left      int64[num], moves the guard still makes; stuck int64[num], the cells known when it was set off
    """

    def __init__(self, config: EnvConfig, num: int) -> None:
        self.config, self.num = config, num
        self.worlds = Worlds(config, num)
        self._eyes = Perception(num, config.rows, config.cols, config.sensor_radius)
        self._frontier = FrontierCost(config.sensor_radius)
        self._rows = np.arange(num)
        self.memory: Saved = {
            "visited": np.zeros((num, config.n), np.uint8),
            "headings": np.ones(num, np.int64),
            "made": np.zeros(num, np.int64),
            "met": np.full((num, config.n), -1, np.int64),
            "left": np.zeros(num, np.int64),
            "stuck": np.full(num, -1),
        }

    @property
    def running(self) -> NDArray[np.bool_]:
        """bool[num]: whose episode goes on."""
        return np.equal(self.worlds.outcomes, RUNNING)

    def decide(self, net: Judge) -> Decided:
        """Look at every world and decide; once for every move, as the guard remembers it."""
        memory, at = self.memory, positions(self.worlds.scalars)
        places = at[:, 0] * self.config.cols + at[:, 1]
        memory["visited"][self._rows, places] = 1
        planes, moves = self._eyes(self.worlds.codes, places, memory["visited"], memory["headings"])
        logits, _ = net.decide(planes, moves)
        actions = logits.argmax(1)
        guarded = self._guarded(places)
        for world in np.flatnonzero(guarded):
            actions[world] = self._way_out(world, at[world])
        return Decided(planes, moves, logits, actions, guarded)

    def _guarded(self, places: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return where the guard decides: `LoopGuard.overrule` over the stack."""
        memory = self.memory
        left, stuck, met = memory["left"], memory["stuck"], memory["met"]
        known = np.count_nonzero(self.worlds.codes.reshape(self.num, -1) != UNKNOWN, axis=1)
        again = (met[self._rows, places] == known) & (left == 0)
        left[again], stuck[again] = MOVES, known[again]
        met[self._rows, places] = known
        guarded = left > 0
        left[guarded & ((left > 1) | (known != stuck))] -= 1
        return guarded

    def _way_out(self, world: np.intp, at: NDArray[np.int64]) -> int:
        """Return the guard's move: that of the frontier rule."""
        remembered = Memory()
        remembered.codes = self.worlds.codes[world]
        remembered.visited = self.memory["visited"][world].reshape(remembered.codes.shape)
        remembered.position = int(at[0]), int(at[1])
        remembered.heading = int(self.memory["headings"][world])
        return self._frontier.decide(remembered)

    def step(self, actions: NDArray[np.int64]) -> None:
        """Make one move in every running world. actions: int64[num]."""
        self.memory["made"][self.running] += 1
        self.worlds.step(actions)
        self.memory["headings"] = actions.copy()

    def take(self, which: NDArray[np.intp]) -> Saved:
        """Return copies of some worlds and of what is remembered of them."""
        return {**self.worlds.take(which), **{name: array[which] for name, array in self.memory.items()}}

    def put(self, which: NDArray[np.intp], saved: Saved) -> None:
        """Put worlds that were taken in the places of some."""
        self.worlds.put(which, saved)
        for name, array in self.memory.items():
            array[which] = saved[name]

    def only(self, which: NDArray[np.intp]) -> Players:
        """Return a stack of some of the worlds."""
        fewer = Players(self.config, len(which))
        fewer.put(np.arange(len(which)), self.take(which))
        return fewer
