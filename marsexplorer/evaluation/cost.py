"""Cost of each move: how much longer the episode gets, if Expert plays on.

    V(t)     length of the whole episode if Expert plays on after t moves, on the true terrain; the
             configuration's limit if Expert does not get there
    cost(t)  V(t + 1) - V(t), of move t, counted from 0; below 0 if the move gained

V(0) is Expert's own episode. After the last move V is what the episode counts: its moves if it was
explored, else the limit. So costs add up to what the episode counts more than Expert's. An episode
that ended without a move, such as one given up, has one more cost after its last move.

Expert watches the episode as if it had played it: its loop guard and the cells it remembers are as
the path left them. Expert is deterministic, so V does not change at a move that Expert would have
made, and its cost is 0.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Record, steps_to_target
from marsexplorer.evaluation.episodes import play_terrain
from marsexplorer.evaluation.missed import MissedCells, find_missed
from marsexplorer.evaluation.mistakes import Mistake, MistakeKind, find_mistakes
from marsexplorer.evaluation.rollouts import (
    Decisions,
    GreedyRollouts,
    Snapshot,
    concatenate,
    play_branches,
)
from marsexplorer.files import write_whole
from marsexplorer.policies.files.model import refuse
from marsexplorer.policies.loading import find_file, load
from marsexplorer.policies.network.batch import ActionScorer

COST_VERSION = "1"
"""Rises whenever the same episode and policy would have another cost."""
MAX_CELLS = 42 * 42
"""Moves on larger boards are not judged: that would take too long."""
MOVES_PER_BLOCK = 128
"""Moves that Expert judges together."""


@dataclass(frozen=True, eq=False)
class Advice:
    """Expert's choice before each move of an episode, and after the last move.

    After the last one only if the episode goes on.

    shares   float32[states, 4], how probable the network finds each action
    actions  int64[states], Expert's actions, with its loop guard
    """

    shares: NDArray[np.float32]
    actions: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class EpisodeCosts:
    """The costs of an episode's moves.

    actions   int64[moves], made
    advice    what Expert would have done
    lengths   int64[moves + 1], V after 0, 1, ... moves
    counts    moves that the episode counts: its own if explored, else the limit
    coverage  float64[moves], before each move, 0..1
    mistakes  in the order of their moves
    """

    actions: NDArray[np.int64]
    advice: Advice
    lengths: NDArray[np.int64]
    counts: int
    coverage: NDArray[np.float64]
    mistakes: tuple[Mistake, ...]

    @cached_property
    def costs(self) -> NDArray[np.int64]:
        """The cost of each move, int64[moves], below 0 if a move gained."""
        return np.diff(self.lengths)

    @property
    def expert_moves(self) -> int:
        """Moves of Expert's own episode; the limit if it does not get there."""
        return int(self.lengths[0])

    @property
    def total(self) -> int:
        """Moves that the episode counts more than Expert's."""
        return self.counts - self.expert_moves

    @property
    def without_move(self) -> int:
        """Cost of an end without a move; 0 if a move ended the episode."""
        return self.counts - int(self.lengths[-1])

    @property
    def gained(self) -> int:
        """Cost of the moves outside all mistakes, at most 0."""
        return int(self.costs.sum()) - sum(mistake.cost for mistake in self.mistakes)

    @cached_property
    def kinds(self) -> tuple[MistakeKind | None, ...]:
        """The kind of the mistake that each move is part of, None outside all mistakes."""
        kinds: list[MistakeKind | None] = [None] * len(self.actions)
        for mistake in self.mistakes:
            for step in range(mistake.first, mistake.last + 1):
                kinds[step] = mistake.kind
        return tuple(kinds)

    def biggest(self, count: int = 3) -> list[Mistake]:
        """The costliest mistakes, the greatest first; of equal ones the earlier first."""
        return sorted(self.mistakes, key=lambda mistake: -mistake.cost)[:count]

    def by_kind(self) -> dict[str, int]:
        """The cost of the mistakes of each kind; an end without a move is `ended early`."""
        costs: dict[str, int] = dict.fromkeys(MistakeKind, 0)
        for mistake in self.mistakes:
            costs[mistake.kind] += mistake.cost
        costs[MistakeKind.ENDED_EARLY] += self.without_move
        return costs

    def by_tenth(self) -> NDArray[np.int64]:
        """The cost of the moves made while 0-10 %, 10-20 %, ... was known: int64[10]."""
        tenth = np.minimum((self.coverage * 10).astype(np.int64), 9)
        return np.bincount(tenth, weights=self.costs, minlength=10).astype(np.int64)


class CostEstimator:
    """Computes the costs of moves, and caches them in a folder.

    policy  name or path of the network that is Expert, greedy with the loop guard
    cache   a folder of files named by SHA-256 over policy file, versions of core and cost, and
            trajectory hash; each holds V alone, and the folder may be deleted at any time. None: no
            cache

    PolicyNotFoundError and PolicyFileError as `policies.load` raises them, PolicyFileError also for
    other policies.
    """

    def __init__(self, policy: str | Path = "ppo", cache: Path | None = None) -> None:
        path = find_file(str(policy))
        net = getattr(load(path), "net", None)
        if net is None or net.acts != "greedy with guard":
            raise refuse(path, "a network of ours that is greedy with guard", "another policy")
        self._path, self._net = path, cast(ActionScorer, net)
        self._policy_hash = hashlib.sha256(path.read_bytes()).hexdigest()
        self._cache = cache

    def costs(self, record: Record) -> EpisodeCosts:
        """The costs of an episode's moves; ValueError as `check_judged` raises it."""
        check_judged(record.config)
        advice = expert_advice(record, self._net)
        moves = len(record.actions)
        lengths = self._cached(record, moves + 1, lambda: whole_lengths(record, self._net))
        return episode_costs(record, advice, lengths)

    def all_costs(
        self, records: Iterable[Record], on_progress: Callable[[int], None] = lambda done: None
    ) -> Iterator[EpisodeCosts]:
        """Yield the costs of each episode; `on_progress` is called with how many are done."""
        for done, record in enumerate(records, 1):
            yield self.costs(record)
            on_progress(done)

    def expert_moves(self, record: Record) -> int:
        """Moves of Expert's own episode on a record's terrain, of any size.

        The limit if it does not get there.
        """

        def expert_length() -> NDArray[np.int64]:
            policy = load(self._path, record.config.sensor_radius)
            return np.array([counted_moves(play_terrain(policy, record).record())])

        return int(self._cached(record, 1, expert_length)[0])

    def missed(self, record: Record, mistakes: Sequence[Mistake]) -> list[MissedCells]:
        """What Expert's move would soon have shown, for each of some mistakes."""
        return find_missed(record, mistakes, self._net)

    def _cached(
        self, record: Record, size: int, work_out: Callable[[], NDArray[np.int64]]
    ) -> NDArray[np.int64]:
        """int64[size] from the cache; computed and cached if it is not there."""
        if self._cache is None:
            return work_out()
        cause = f"{COST_VERSION}|{CORE_VERSION}|{self._policy_hash}|{record.trajectory_hash}|{record.outcome}|{size}"
        path = self._cache / f"{hashlib.sha256(cause.encode()).hexdigest()}.npy"
        lengths = _read(path, size)
        if lengths is None:
            lengths = work_out()
            self._cache.mkdir(parents=True, exist_ok=True)
            with write_whole(path) as file:
                np.save(file, lengths.astype(np.int32), allow_pickle=False)
        return lengths


def check_judged(config: EnvConfig) -> None:
    """Raise ValueError if moves are not judged: too large, or not all cells count."""
    if config.discoverable_only:
        raise ValueError(
            f"moves are judged on the levels of the paper, where all cells count; this board is of level {config.level}, "
            "so none of its moves is judged"
        )
    if config.n > MAX_CELLS:
        raise ValueError(
            f"moves are judged on boards of up to {MAX_CELLS} cells, such as 42x42; "
            f"this board has {config.rows}x{config.cols}, so none of its moves is judged"
        )


def _read(path: Path, size: int) -> NDArray[np.int64] | None:
    """The lengths in a cache file; None if there are none that fit."""
    try:
        lengths = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    is_whole = lengths.shape == (size,) and lengths.dtype == np.int32
    return lengths.astype(np.int64) if is_whole else None


def whole_lengths(record: Record, net: ActionScorer) -> NDArray[np.int64]:
    """V after 0, 1, ... moves: int64[moves + 1]."""
    moves = np.frombuffer(record.actions, np.uint8)
    expected = np.zeros(len(moves) + 1, np.int64)
    lengths = np.full(len(moves) + 1, counted_moves(record))
    for first, rollouts, decisions in _judge(record, net):
        # 1. Where the move before was Expert's own, V is what it was; else Expert plays on from
        #    here.
        steps = first + np.arange(rollouts.num_worlds)
        expected[steps] = decisions.actions
        is_left = np.append(True, expected[:-1] != moves)[steps]
        left = np.flatnonzero(is_left)
        limits = np.full(len(left), record.config.limit)
        worlds, actions = rollouts.snapshot(left), decisions.actions[left]
        lengths[steps[left]] = play_branches(record.config, net, worlds, actions, limits)
        for step in steps[~is_left]:
            lengths[step] = lengths[step - 1]
    return lengths


def counted_moves(record: Record) -> int:
    """The moves that an episode counts: its own if explored, else the limit."""
    return steps_to_target(record.config, record.outcome, record.steps)


def expert_advice(record: Record, net: ActionScorer) -> Advice:
    """Expert's choice at each state of an episode, as if it had watched it."""
    decisions = [decisions for _, _, decisions in _judge(record, net)]
    logits = np.concatenate([block.logits for block in decisions])
    weights = np.exp(logits - logits.max(1, keepdims=True))
    shares = weights / weights.sum(1, keepdims=True)
    return Advice(shares, np.concatenate([block.actions for block in decisions]))


def _rollouts(record: Record, net: ActionScorer, count: int) -> GreedyRollouts:
    config = record.config
    return GreedyRollouts(config, count, net.rules_that_count(config.rows, config.cols))


def _judge(record: Record, net: ActionScorer) -> Iterator[tuple[int, GreedyRollouts, Decisions]]:
    """Yield blocks of an episode's states: the first one's number, worlds, decisions."""
    for first, worlds in _states(record, net):
        rollouts = _rollouts(record, net, len(worlds["steps"]))
        rollouts.restore(np.arange(rollouts.num_worlds), worlds)
        yield first, rollouts, rollouts.decide(net)


def _states(record: Record, net: ActionScorer) -> Iterator[tuple[int, Snapshot]]:
    """Yield the worlds after each move in blocks, as long as the episode runs.

    Each block comes with the number of moves before its first state.
    """
    rollouts, only = _rollouts(record, net, 1), np.zeros(1, np.intp)
    rollouts.worlds.start_on(0, record.terrain_map(), record.start)
    states: list[Snapshot] = []
    for step in range(len(record.actions) + 1):
        states.append(rollouts.snapshot(only))
        if step < len(record.actions):
            rollouts.watch()
            rollouts.step(np.array([record.actions[step]]))
        is_last = step == len(record.actions) or not rollouts.running[0]
        if is_last or len(states) == MOVES_PER_BLOCK:
            yield step + 1 - len(states), concatenate(states)
            states = []
        if is_last:
            return


def episode_costs(record: Record, advice: Advice, lengths: NDArray[np.int64]) -> EpisodeCosts:
    """The costs of an episode's moves, from its `whole_lengths`."""
    actions = np.frombuffer(record.actions, np.uint8).astype(np.int64)
    coverage, mistakes = find_mistakes(record, advice.actions, np.diff(lengths))
    counts = counted_moves(record)
    return EpisodeCosts(actions, advice, lengths, counts, coverage, tuple(mistakes))
