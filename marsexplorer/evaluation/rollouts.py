"""Worlds played together and greedily by a network, as its policy plays.

It plays with the loop guard, from the observation alone.

Worlds can be copied with all that is remembered of them and put back, also among other worlds, so
an episode can be continued from any of its steps more than once: branches from many steps of many
episodes are played together, so that the network is asked for all of them at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import read_only
from marsexplorer.config import RUNNING, UNKNOWN, EnvConfig
from marsexplorer.observation import EAST
from marsexplorer.policies.base import Memory
from marsexplorer.policies.frontier import FrontierCost
from marsexplorer.policies.guard import update_guard
from marsexplorer.policies.network.batch import ActionScorer
from marsexplorer.policies.network.features import FeatureExtractor
from marsexplorer.world import Worlds, positions

Snapshot = dict[str, NDArray[Any]]
"""Copies of worlds and of what is remembered of them: arrays [num_worlds, ...] by name."""


@dataclass(frozen=True)
class Decisions:
    """What the network is shown of each world, and the actions that follow from it.

    planes, moves  the observation, see `policies.network.features`
    logits         float32[num_worlds, 4], the network's
    actions        int64[num_worlds], what is done
    guarded        bool[num_worlds], where the loop guard chose the action
    """

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    logits: NDArray[np.float32]
    actions: NDArray[np.int64]
    guarded: NDArray[np.bool_]


class GreedyRollouts:
    """`num_worlds` worlds of one configuration, and the `memory` of each.

    visited    uint8[num_worlds, cells], 1 where the rover has been
    headings   int64[num_worlds], the last action
    steps      int64[num_worlds], moves made
    known_at   int64[num_worlds, cells], cells known when the rover was last there: the same number
               again starts the guard
    remaining  int64[num_worlds], moves that the guard still makes
    stuck_at   int64[num_worlds], the cells known when the guard started

    rules  the rules whose numbers it needs, see `FeatureExtractor`; None: all
    """

    def __init__(
        self, config: EnvConfig, num_worlds: int, rules: Sequence[int] | None = None
    ) -> None:
        self.config, self.num_worlds, self._rules = config, num_worlds, rules
        self.worlds = Worlds(config, num_worlds)
        shape = (num_worlds, config.rows, config.cols)
        self._extractor = FeatureExtractor(*shape, config.sensor_radius, rules)
        self._frontier = FrontierCost(config.sensor_radius)
        self._indices = np.arange(num_worlds)
        self.memory: Snapshot = {
            "visited": np.zeros((num_worlds, config.n), np.uint8),
            "headings": np.full(num_worlds, EAST, np.int64),
            "steps": np.zeros(num_worlds, np.int64),
            "known_at": np.full((num_worlds, config.n), -1, np.int64),
            "remaining": np.zeros(num_worlds, np.int64),
            "stuck_at": np.full(num_worlds, -1),
        }

    @property
    def running(self) -> NDArray[np.bool_]:
        """bool[num_worlds]: whether the episode goes on."""
        return np.equal(self.worlds.outcomes, RUNNING)

    def decide(self, net: ActionScorer) -> Decisions:
        """The decisions for what the worlds show now.

        Call it once for each step, because the guard remembers it.
        """
        memory, rovers, cells = self.memory, positions(self.worlds.scalars), self.mark_visited()
        remembered = (memory["visited"], memory["headings"])
        planes, moves = self._extractor(self.worlds.codes, cells, *remembered)
        logits, _ = net.infer(planes, moves)
        actions = logits.argmax(1)
        guarded = self._update_guards(cells)
        for world in np.flatnonzero(guarded):
            actions[world] = self._guard_action(world, rovers[world])
        return Decisions(planes, moves, logits, actions, guarded)

    def watch(self) -> NDArray[np.int64]:
        """Remember what the worlds show as `decide` does, where another player decides.

        Returns:
            The rovers' cells, int64[num_worlds], row * cols + col.
        """
        cells = self.mark_visited()
        self._update_guards(cells)
        return cells

    def mark_visited(self) -> NDArray[np.int64]:
        """Mark the rovers' cells as visited and return them, int64[num_worlds].

        A cell is row * cols + col.
        """
        rovers = positions(self.worlds.scalars)
        cells: NDArray[np.int64] = rovers[:, 0] * self.config.cols + rovers[:, 1]
        self.memory["visited"][self._indices, cells] = 1
        return cells

    def _update_guards(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Where the guard decides, bool[num_worlds]: `LoopGuard.overrule` of all worlds."""
        memory, guarded = self.memory, np.zeros(self.num_worlds, np.bool_)
        known_cells = np.count_nonzero(
            self.worlds.codes.reshape(self.num_worlds, -1) != UNKNOWN, axis=1
        )
        counters = (memory["known_at"], memory["remaining"], memory["stuck_at"])
        update_guard(cells, known_cells, *counters, guarded)
        return guarded

    def _guard_action(self, world: np.intp, rover: NDArray[np.int64]) -> int:
        """Return the guard's action in one world: that of the frontier rule."""
        remembered = Memory()
        remembered.codes = read_only(self.worlds.codes[world])
        remembered.visited = self.memory["visited"][world].reshape(remembered.codes.shape)
        remembered.position = int(rover[0]), int(rover[1])
        remembered.heading = int(self.memory["headings"][world])
        return self._frontier.decide(remembered)

    def step(self, actions: NDArray[np.int64]) -> None:
        """Make one move in every running world. actions: int64[num_worlds]."""
        self.memory["steps"][self.running] += 1
        self.worlds.step(actions)
        self.memory["headings"] = actions.copy()

    def snapshot(self, indices: NDArray[np.intp]) -> Snapshot:
        """Return copies of the worlds of these indices and of what is remembered of them."""
        memory = {name: array[indices] for name, array in self.memory.items()}
        return self.worlds.take(indices) | memory

    def restore(self, indices: NDArray[np.intp], snapshot: Snapshot) -> None:
        """Put the worlds of a snapshot in the places of these indices."""
        self.worlds.put(indices, snapshot)
        for name, array in self.memory.items():
            array[indices] = snapshot[name]

    def subset(self, indices: NDArray[np.intp]) -> GreedyRollouts:
        """Return copies of some of the worlds, to be played on without the others."""
        fewer = GreedyRollouts(self.config, len(indices), self._rules)
        fewer.restore(np.arange(len(indices)), self.snapshot(indices))
        return fewer


PARALLEL_BRANCHES = 256
"""Branches played together."""
MIN_RUNNING_SHARE = 0.8
"""When a smaller share of the worlds still runs, the others are dropped."""


def play_branches(
    config: EnvConfig,
    net: ActionScorer,
    worlds: Snapshot,
    actions: NDArray[np.int64],
    limits: NDArray[np.int64],
) -> NDArray[np.int64]:
    """The moves of episodes that begin with `actions` and that the policy then plays.

    They begin in the worlds of a snapshot.

    actions, limits  int64[num_branches]; so is the result: where an episode still runs after its
                     limit, that limit
    """
    num_branches = len(actions)
    lengths, started = limits.copy(), min(PARALLEL_BRANCHES, num_branches)
    if not num_branches:
        return lengths
    rollouts = GreedyRollouts(config, started, net.rules_that_count(config.rows, config.cols))
    branches = np.arange(started)
    rollouts.restore(branches, {name: array[branches] for name, array in worlds.items()})
    next_actions = actions[branches]
    while True:
        rollouts.step(next_actions)
        steps = rollouts.memory["steps"]
        finished = (branches >= 0) & (~rollouts.running | (steps >= limits[branches]))
        lengths[branches[finished]] = steps[finished]
        branches[finished] = -1
        are_few = (branches >= 0).sum() < MIN_RUNNING_SHARE * rollouts.num_worlds
        if started == num_branches and are_few:
            running = np.flatnonzero(branches >= 0)
            if not len(running):
                return lengths
            rollouts, branches = rollouts.subset(running), branches[running]
        next_actions = rollouts.decide(net).actions
        free = np.flatnonzero(branches < 0)[: num_branches - started]
        fresh = np.arange(started, started + len(free))
        rollouts.restore(free, {name: array[fresh] for name, array in worlds.items()})
        branches[free], next_actions[free] = fresh, actions[fresh]
        started += len(free)


def concatenate(parts: list[Snapshot]) -> Snapshot:
    """Return the arrays of each name one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
