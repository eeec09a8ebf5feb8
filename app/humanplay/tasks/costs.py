"""What the moves of an episode cost, in any reproducible environment.

A policy of the environment, the expert, plays on from each of them:

    V(t)     length of the episode if the expert plays on after t moves; the limit if it does not succeed
    cost(t)  V(t + 1) - V(t), of the move number t from 0

The expert watches the moves before as if it had made them. Costs add up to what the episode counts more than the expert's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from humanplay.task import Configuration, Environment, Policy, Record, Run, counted

LOSS, ENDED_EARLY = "longer way", "ended early"
"""Kinds of mistakes: moves that cost some, and an end before the limit without success."""
MOST_STEPS = 1_000_000
"""Moves with which the expert may try every action after every move of an episode."""
MOST_NAMED = 5
"""Mistakes that are named, at most."""
LEAST_COST = 2
"""Moves that a mistake costs to be named, at least."""


@dataclass(frozen=True, eq=False)
class Advice:
    """The expert's action before each move, and after the last if the episode ran on.

    actions  int64[states]
    lengths  of the episode in all if an action follows and the expert plays on, by state and action; None without success
    """

    actions: NDArray[np.int64]
    lengths: tuple[tuple[int | None, ...], ...]


@dataclass(frozen=True, eq=False)
class MoveCosts:
    """What each move of an episode cost (`humanplay.task.EpisodeCosts`).

    actions  int64[moves], made
    lengths  int64[moves + 1], V after 0, 1, ... moves
    counts   moves that the episode counts: its own if it succeeded, else the limit
    limit    moves of an episode, at most
    """

    actions: NDArray[np.int64]
    advice: Advice
    lengths: NDArray[np.int64]
    counts: int
    limit: int

    @cached_property
    def costs(self) -> NDArray[np.int64]:
        """int64[moves], below 0 where a move gained."""
        return np.diff(self.lengths)

    @property
    def kinds(self) -> tuple[str | None, ...]:
        """The kind of mistake that each move is, None for one that cost nothing."""
        moves = len(self.actions)
        # an episode that was left has advice after its last move too
        is_ended_by_move = len(self.advice.lengths) == moves
        ends_early = is_ended_by_move and self.counts == self.limit and moves < self.limit
        return tuple(
            None if cost <= 0 else ENDED_EARLY if ends_early and step == moves - 1 else LOSS
            for step, cost in enumerate(self.costs)
        )

    @property
    def expert_moves(self) -> int:
        """Moves of the expert's own episode; the limit without success."""
        return int(self.lengths[0])

    @property
    def total(self) -> int:
        """Moves that the episode counts more than the expert's."""
        return self.counts - self.expert_moves

    @property
    def without_move(self) -> int:
        """Cost of an end without a move."""
        return self.counts - int(self.lengths[-1])

    @property
    def gained(self) -> int:
        """Cost of the moves that made the episode shorter, at most 0."""
        return int(np.minimum(self.costs, 0).sum())

    def by_kind(self) -> Mapping[str, int]:
        """The cost of the mistakes of each kind."""
        sums = {LOSS: 0, ENDED_EARLY: self.without_move}
        for kind, cost in zip(self.kinds, self.costs, strict=True):
            if kind is not None:
                sums[kind] += int(cost)
        return sums

    def by_tenth(self) -> NDArray[np.int64]:
        """int64[10]: the cost of the first, second, ... tenth of the episode's moves."""
        tenths = 10 * np.arange(len(self.costs)) // max(1, len(self.costs))
        return np.bincount(tenths, weights=self.costs, minlength=10).astype(np.int64)


class MoveJudge:
    """Lets a policy play on after each move (`humanplay.task.CostEstimator`)."""

    def __init__(self, environment: Environment, source: str) -> None:
        self._environment, self._source = environment, source

    def costs(self, record: Record) -> MoveCosts:
        """What every move of an episode cost; ValueError if none can be judged."""
        check_judged(self._environment, record.config)
        moves, limit = record.actions, record.config.limit
        # an episode that was left has one more state to judge, after its last move
        states = len(moves) + (not self._environment.replay(record, moves).ended)
        chosen, lengths = [], []
        for step in range(states):
            action, after = self._judge(record, moves[:step])
            chosen.append(action)
            lengths.append(after)
        counts = record.steps if record.outcome in self._environment.successes else limit
        whole = [lengths[0][chosen[0]] if lengths else counts]
        whole += [after[action] for after, action in zip(lengths, moves, strict=False)]
        return MoveCosts(
            np.frombuffer(moves, np.uint8).astype(np.int64),
            Advice(np.array(chosen, np.int64), tuple(lengths)),
            np.array([limit if length is None else length for length in whole], np.int64),
            counts,
            limit,
        )

    def _judge(self, record: Record, moves: bytes) -> tuple[int, tuple[int | None, ...]]:
        """The expert's action after some moves, and the length after each action."""
        policies = self._environment.policies
        lengths: list[int | None] = []
        chosen = 0
        for action in range(len(self._environment.actions)):
            run, policy = self._watched(record, moves)
            chosen = policies.act(policy, run.observation())
            run.step(action)
            while not run.ended:
                run.step(policies.act(policy, run.observation()))
            end = run.record()
            lengths.append(end.steps if end.outcome in self._environment.successes else None)
        return chosen, tuple(lengths)

    def _watched(self, record: Record, moves: bytes) -> tuple[Run, Policy]:
        """An episode after some moves, and the expert that has watched them."""
        policies = self._environment.policies
        policy = policies.load(self._source, record.config)
        policies.reset(policy, record.config, 0)
        run = self._environment.replay(record)
        for action in moves:
            policies.act(policy, run.observation())
            run.step(action)
        return run, policy


def check_judged(environment: Environment, config: Configuration) -> None:
    """Raise ValueError, saying why, if no move of a configuration is judged."""
    if environment.expert is None:
        raise ValueError(f"{environment.about.title} has no policy by which its moves are judged")
    steps = config.limit**2 * len(environment.actions)
    if steps > MOST_STEPS:
        raise ValueError(
            f"moves are judged if the expert needs at most {MOST_STEPS:,} moves to try all actions; "
            f"episodes of {counted(config.limit, 'move')} and {counted(len(environment.actions), 'action')} need {steps:,}"
        )


def explained(environment: Environment, costs: MoveCosts) -> dict[str, object]:
    """What a page shows of an episode's costs (`humanplay.task.Courses.explain`)."""
    names, kinds = environment.actions, costs.kinds
    worst = sorted(range(len(kinds)), key=lambda step: -costs.costs[step])[:MOST_NAMED]
    return {
        "reason": None,
        "counts": costs.counts,
        "expert_moves": costs.expert_moves,
        "total": costs.total,
        "given_up": costs.without_move,
        "gained": costs.gained,
        "by_kind": costs.by_kind(),
        "mistakes": [
            {
                "first": step,
                "last": step,
                "step": step,
                "cost": int(costs.costs[step]),
                "action": names[costs.actions[step]],
                "expert_action": names[costs.advice.actions[step]],
                "kind": kinds[step],
                "previous": names[costs.actions[step - 1]] if step else None,
            }
            for step in worst
            if costs.costs[step] >= LEAST_COST
        ],
        "expert": [
            {
                "shares": None,
                "action": names[action],
                "needs": _further(after[action], step),
                "after": [_further(length, step + 1) for length in after],
                "cost": int(costs.costs[step]),
            }
            for step, (action, after) in enumerate(
                zip(costs.advice.actions, costs.advice.lengths, strict=True)
            )
            if step < len(costs.actions)
        ],
    }


def explained_without_costs(
    environment: Environment, record: Record, reason: str
) -> dict[str, object]:
    """What a page shows of an episode of which no move is judged, for this reason."""
    succeeded = record.outcome in environment.successes
    return {
        "reason": reason,
        "counts": record.steps if succeeded else record.config.limit,
        "expert_moves": None,
        "total": None,
        "given_up": None,
        "gained": None,
        "by_kind": {},
        "mistakes": [],
        "expert": [],
    }


def _further(length: int | None, step: int) -> int | None:
    return None if length is None else length - step
