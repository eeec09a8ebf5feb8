"""What another action would have cost: episodes are branched, and every branch is played to its end.

An episode is played greedily. At some of its steps another action is taken instead, and the policy goes on from there on the
same terrain. The difference in length of the two episodes is a sample of what that action costs given what is known there, as
the terrain is a draw from those that look like this so far. (The vine of Schulman et al. 2015, "Trust region policy
optimization", section 5.2; here with the whole episode as its length.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.branches import MIN_RUNNING_SHARE, concatenate, play_branches
from marsexplorer.evaluation.rollouts import ActionScorer, Decisions, GreedyRollouts, Snapshot
from marsexplorer.training.envs import refuse_evaluation_seeds

SIDE = 21
"""Side of the grids that costs are stated for, cells."""
MAX_COST = 20
"""Costs at 21x21 are clipped to so many moves either way: beyond that they are mostly chance."""
MAX_EXTRA_MOVES = 30
"""A branch at 21x21 that has made so many moves more than its episode is played no further."""
TYPICAL_MOVES_PER_CELL = 0.17
"""Length of an ordinary episode, in moves for each cell of the grid."""
MAX_MOVES_PER_CELL = 0.57
"""Episodes are followed for so many moves for each cell of the grid."""
OBSERVATION_SHARE = 0.25
"""Share of an episode's steps whose observations are kept."""
BASE_WEIGHT = 0.1
"""Weight of an action where the network is certain, in comparison with 1 where it is undecided between two."""


@dataclass(frozen=True)
class ActionPairs:
    """Two actions for the same observation: the network's own, and another one.

    planes, moves  the observations, see `policies.network.features`
    own, other     int64[num_pairs], actions
    cost           float32[num_pairs], moves that the episode takes more with the other action, at 21x21 -MAX_COST..MAX_COST, in
                   proportion to the side elsewhere
    steps          int64[num_episodes], moves of the episodes
    """

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    own: NDArray[np.int64]
    other: NDArray[np.int64]
    cost: NDArray[np.float32]
    steps: NDArray[np.int64]


@dataclass(frozen=True)
class SampledObservations:
    """Observations (planes, moves) from some steps of episodes; steps int64[num_episodes], moves of the episodes."""

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    steps: NDArray[np.int64]


@dataclass(frozen=True)
class JointStep:
    """One step of episodes that are played together: their worlds, the number of each one's episode, and the decisions."""

    rollouts: GreedyRollouts
    episodes: NDArray[np.intp]
    decisions: Decisions


def branch_episodes(
    config: EnvConfig, net: ActionScorer, first_seed: int, num_episodes: int, pairs_per_episode: int
) -> ActionPairs:
    """Return pairs of actions from the episodes on the terrains first_seed, first_seed + 1, ...; the same for the same network.

    pairs_per_episode  about how many pairs an episode gives in the mean
    """
    rng = np.random.default_rng(first_seed)
    steps, rate = (
        np.zeros(num_episodes, np.int64),
        pairs_per_episode / (TYPICAL_MOVES_PER_CELL * config.n),
    )
    found: list[tuple[Snapshot, Snapshot]] = []
    for joint in play_greedily(config, net, first_seed, steps):
        rollouts, decisions = joint.rollouts, joint.decisions
        weights = alternative_weights(decisions, rollouts.memory["headings"])
        total = weights.sum(1)
        eligible = rollouts.running & ~decisions.guarded & (total > 0)
        if not eligible.any():
            continue
        draws = rng.random(rollouts.num_worlds)
        chosen = np.flatnonzero(eligible & (draws < rate * total / total[eligible].mean()))
        thresholds = rng.random(len(chosen))[:, None] * total[chosen, None]
        pairs = {
            "episode": joint.episodes[chosen],
            "planes": decisions.planes[chosen],
            "moves": decisions.moves[chosen],
            "own": decisions.actions[chosen],
            "other": (np.cumsum(weights[chosen], axis=1) <= thresholds).sum(1),
        }
        found.append((rollouts.snapshot(chosen), pairs))
    worlds, pairs = (
        concatenate([snapshot for snapshot, _ in found]),
        concatenate([pairs for _, pairs in found]),
    )
    cost = extra_moves(config, net, worlds, pairs["other"], steps[pairs.pop("episode")])
    most = MAX_COST * relative_side(config)
    return ActionPairs(**pairs, cost=np.clip(cost, -most, most).astype(np.float32), steps=steps)


def sample_observations(
    config: EnvConfig, net: ActionScorer, first_seed: int, num_episodes: int
) -> SampledObservations:
    """Return the observations at OBSERVATION_SHARE of the steps of the episodes on the terrains first_seed and following."""
    rng = np.random.default_rng(first_seed)
    steps, planes, moves = np.zeros(num_episodes, np.int64), [], []
    for joint in play_greedily(config, net, first_seed, steps):
        chosen = joint.rollouts.running & (
            rng.random(joint.rollouts.num_worlds) < OBSERVATION_SHARE
        )
        planes.append(joint.decisions.planes[chosen])
        moves.append(joint.decisions.moves[chosen])
    return SampledObservations(np.concatenate(planes), np.concatenate(moves), steps)


def play_greedily(
    config: EnvConfig, net: ActionScorer, first_seed: int, steps: NDArray[np.int64]
) -> Iterator[JointStep]:
    """Play the terrains first_seed, first_seed + 1, ... to their ends and yield every step.

    steps  int64[num_episodes], becomes the moves of each episode

    Episodes are followed for MAX_MOVES_PER_CELL moves a cell at most. What was yielded changes with the next step.
    """
    seeds = np.arange(first_seed, first_seed + len(steps))
    refuse_evaluation_seeds(seeds)
    max_moves = int(MAX_MOVES_PER_CELL * config.n)
    rollouts, episodes = GreedyRollouts(config, len(seeds)), np.arange(len(seeds))
    rollouts.worlds.start(seeds)
    steps[:] = max_moves
    for count in range(1, max_moves + 1):
        running = rollouts.running
        if running.sum() < MIN_RUNNING_SHARE * rollouts.num_worlds:
            kept = np.flatnonzero(running)
            if not len(kept):
                return
            rollouts, episodes = rollouts.subset(kept), episodes[kept]
        decisions = rollouts.decide(net)
        yield JointStep(rollouts, episodes, decisions)
        running = rollouts.running
        rollouts.step(decisions.actions)
        steps[episodes[running & ~rollouts.running]] = count


def alternative_weights(decisions: Decisions, headings: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return float64[num_worlds, 4], how much each other action is worth trying: more where the network is less certain.

    Turning back is tried half as often; the network's own action and invalid ones never.
    """
    rows = np.arange(len(decisions.actions))
    margins = np.clip(
        decisions.logits - decisions.logits[rows, decisions.actions][:, None], -50.0, 0.0
    ).astype(np.float64)
    probability = 1 / (1 + np.exp(-margins))
    weights = np.where(
        decisions.moves[:, :, 0] > 0, BASE_WEIGHT + 4 * probability * (1 - probability), 0.0
    )
    weights[rows, headings ^ 2] *= 0.5
    weights[rows, decisions.actions] = 0.0
    return weights


def extra_moves(
    config: EnvConfig,
    net: ActionScorer,
    worlds: Snapshot,
    actions: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return how many moves more than `steps` the episodes take when `actions` are taken in the worlds of a snapshot.

    actions, steps  int64[num_branches]; so is the result, at 21x21 at most MAX_EXTRA_MOVES
    """
    return (
        play_branches(
            config, net, worlds, actions, steps + round(MAX_EXTRA_MOVES * relative_side(config))
        )
        - steps
    )


def relative_side(config: EnvConfig) -> float:
    """Return the side of a grid over that of 21x21, by which costs grow: chance adds up over longer episodes."""
    return float((config.n / SIDE**2) ** 0.5)
