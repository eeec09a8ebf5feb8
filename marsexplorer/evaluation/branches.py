"""Branches of episodes: worlds that go on from a step with an action given, each played to its end by a network's policy.

Branches from many steps of many episodes are played together, so that the network is asked for all of them at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.rollouts import ActionScorer, GreedyRollouts, Snapshot

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
    """Return the moves of whole episodes in which `actions` are taken in the worlds of a snapshot and the policy goes on.

    actions, limits  int64[num_branches]; so is the result: where an episode still runs after its limit, that limit
    """
    num_branches = len(actions)
    lengths, started = limits.copy(), min(PARALLEL_BRANCHES, num_branches)
    if not num_branches:
        return lengths
    rollouts, branches = (
        GreedyRollouts(config, started, net.rules_that_count(config.rows, config.cols)),
        np.arange(started),
    )
    rollouts.restore(branches, {name: array[branches] for name, array in worlds.items()})
    next_actions = actions[branches]
    while True:
        rollouts.step(next_actions)
        steps = rollouts.memory["steps"]
        finished = (branches >= 0) & (~rollouts.running | (steps >= limits[branches]))
        lengths[branches[finished]] = steps[finished]
        branches[finished] = -1
        if (
            started == num_branches
            and (branches >= 0).sum() < MIN_RUNNING_SHARE * rollouts.num_worlds
        ):
            kept = np.flatnonzero(branches >= 0)
            if not len(kept):
                return lengths
            rollouts, branches = rollouts.subset(kept), branches[kept]
        next_actions = rollouts.decide(net).actions
        free = np.flatnonzero(branches < 0)[: num_branches - started]
        fresh = np.arange(started, started + len(free))
        rollouts.restore(free, {name: array[fresh] for name, array in worlds.items()})
        branches[free], next_actions[free] = fresh, actions[fresh]
        started += len(free)


def concatenate(parts: list[Snapshot]) -> Snapshot:
    """Return the arrays of each name one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
