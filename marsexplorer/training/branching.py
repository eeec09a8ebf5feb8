"""What another move would have cost: episodes are branched, and every branch is played to its end.

An episode is played greedily. At some of its moments another move is made instead, and the policy goes on from there on the
same terrain: the difference of the two episodes' moves is a sample of what that move costs given what is known there, since
the terrain is a draw from those that look like this so far. (The vine of Schulman et al. 2015, "Trust region policy
optimization", section 5.2; here with the whole episode as its length.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.training.envs import refuse_evaluation_seeds
from marsexplorer.training.rollouts import Decided, Judge, Players, Saved

MOST = 20
"""Costs are cut off at so many moves either way: beyond that chance speaks."""
PATIENCE = 30
"""A branch that has made so many moves more than its episode is played no further."""
USUAL = 0.17
"""Moves a cell of the grid that an episode usually takes."""
SLOTS = 256
"""Branches played together."""
LONGEST = 0.57
"""Episodes are followed for so many moves a cell of the grid."""
BUSY = 0.8
"""A stack in which a smaller share of the worlds still plays is made smaller."""
SHARE = 0.25
"""Share of an episode's moments whose looks are kept."""
ANY = 0.1
"""Weight of a move that the network is sure about, beside 1 of one about which it is in two minds."""


@dataclass(frozen=True)
class Pairs:
    """Two moves at the same moment: the network's own, and another.

    planes, moves  what the network is shown there, see `policies.perception`
    own, other     int64[num], actions
    cost           float32[num], moves that the episode takes more with the other, -MOST..MOST
    steps          int64[episodes], moves of the episodes
    """

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    own: NDArray[np.int64]
    other: NDArray[np.int64]
    cost: NDArray[np.float32]
    steps: NDArray[np.int64]


@dataclass(frozen=True)
class Looks:
    """What the network was shown at some moments: planes, moves; steps int64[episodes], moves of the episodes."""

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    steps: NDArray[np.int64]


@dataclass(frozen=True)
class Moment:
    """A moment of episodes that are played together: the number of each one's episode, and what was decided."""

    players: Players
    which: NDArray[np.intp]
    decided: Decided


def branch(config: EnvConfig, net: Judge, first_seed: int, episodes: int, each: int) -> Pairs:
    """Return about `each` pairs an episode, of the terrains first_seed, first_seed + 1, ...; the same for the same network."""
    rng = np.random.default_rng(first_seed)
    steps, rate = np.zeros(episodes, np.int64), each / (USUAL * config.n)
    found: list[tuple[Saved, Saved]] = []
    for moment in play(config, net, first_seed, steps):
        players, its = moment.players, moment.decided
        weights = doubts(its, players.memory["headings"])
        total = weights.sum(1)
        ready = players.running & ~its.guarded & (total > 0)
        if not ready.any():
            continue
        at = np.flatnonzero(ready & (rng.random(players.num) < rate * total / total[ready].mean()))
        drawn = rng.random(len(at))[:, None] * total[at, None]
        others = (np.cumsum(weights[at], axis=1) <= drawn).sum(1)
        pair = {"planes": its.planes[at], "moves": its.moves[at], "own": its.actions[at], "other": others}
        found.append((players.take(at), {"episode": moment.which[at], **pair}))
    worlds, pairs = joined([saved for saved, _ in found]), joined([pair for _, pair in found])
    cost = play_on(config, net, worlds, pairs["other"], steps[pairs.pop("episode")])
    return Pairs(**pairs, cost=np.clip(cost, -MOST, MOST).astype(np.float32), steps=steps)


def walk(config: EnvConfig, net: Judge, first_seed: int, episodes: int) -> Looks:
    """Return what the network is shown in SHARE of the moments of its episodes on the terrains first_seed and on."""
    rng = np.random.default_rng(first_seed)
    steps, planes, moves = np.zeros(episodes, np.int64), [], []
    for moment in play(config, net, first_seed, steps):
        some = moment.players.running & (rng.random(moment.players.num) < SHARE)
        planes.append(moment.decided.planes[some])
        moves.append(moment.decided.moves[some])
    return Looks(np.concatenate(planes), np.concatenate(moves), steps)


def play(config: EnvConfig, net: Judge, first_seed: int, steps: NDArray[np.int64]) -> Iterator[Moment]:
    """Play the terrains first_seed, first_seed + 1, ... to their ends, yielding every moment; write the moves made to `steps`.

    Episodes are followed for LONGEST moves a cell at most. What a moment holds changes with the next.
    """
    seeds = np.arange(first_seed, first_seed + len(steps))
    refuse_evaluation_seeds(seeds)
    longest = int(LONGEST * config.n)
    players, which = Players(config, len(seeds)), np.arange(len(seeds))
    players.worlds.start(seeds)
    steps[:] = longest
    for count in range(1, longest + 1):
        running = players.running
        if running.sum() < BUSY * players.num:
            keep = np.flatnonzero(running)
            if not len(keep):
                return
            players, which = players.only(keep), which[keep]
        decided = players.decide(net)
        yield Moment(players, which, decided)
        running = players.running
        players.step(decided.actions)
        steps[which[running & ~players.running]] = count


def doubts(its: Decided, headings: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return float64[num, 4], how much each move is worth trying: the less sure the network is that its own is the better.

    Ways back are tried half as often; the network's own move and invalid ones never.
    """
    rows = np.arange(len(its.actions))
    against = np.clip(its.logits - its.logits[rows, its.actions][:, None], -50.0, 0.0).astype(np.float64)
    share = 1 / (1 + np.exp(-against))
    weights = np.where(its.moves[:, :, 0] > 0, ANY + 4 * share * (1 - share), 0.0)
    weights[rows, headings ^ 2] *= 0.5
    weights[rows, its.actions] = 0.0
    return weights


def play_on(
    config: EnvConfig, net: Judge, worlds: Saved, actions: NDArray[np.int64], steps: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Make `actions` in worlds that were taken and play on; return how many moves more than `steps` the episodes came to."""
    num = len(actions)
    cost, following = np.full(num, PATIENCE), min(SLOTS, num)
    players, which = Players(config, following), np.arange(following)
    players.put(which, {name: array[which] for name, array in worlds.items()})
    chosen = actions[which]
    while True:
        players.step(chosen)
        over = players.memory["made"] - steps[which]
        done = (which >= 0) & (~players.running | (over >= PATIENCE))
        cost[which[done]] = over[done]
        which[done] = -1
        if following == num and (which >= 0).sum() < BUSY * players.num:
            keep = np.flatnonzero(which >= 0)
            if not len(keep):
                return cost
            players, which = players.only(keep), which[keep]
        chosen = players.decide(net).actions
        free = np.flatnonzero(which < 0)[: num - following]
        fresh = np.arange(following, following + len(free))
        players.put(free, {name: array[fresh] for name, array in worlds.items()})
        which[free], chosen[free] = fresh, actions[fresh]
        following += len(free)


def joined(parts: list[Saved]) -> Saved:
    """Return arrays of the same names one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
