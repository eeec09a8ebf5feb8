"""Regret of each move: how many moves sooner 99 % would have been discovered after the best action instead of the one made.

Before every move of an episode each valid action is tried on the true terrain, and the shipped policy goes on from there to the
end (the vine of Schulman et al. 2015, "Trust region policy optimization", section 5.2, over whole episodes). Then

    length(t, a)  moves of the whole episode when action a is made at move t and the policy plays on; the configuration's limit
                  where the target is not reached, and for an invalid action, which ends the episode
    regret(t)     length(t, action made) - min over a of length(t, a), at least 0; actions of the least length are equally good

The policy is deterministic and sees what the rover sees, while the comparison is made with the terrain known. So a regret is
relative to that policy and wise after the event: a move can have been right given what was known and still cost some. The
policy's own episodes have a regret above zero too, which is what a mean should be compared with. Giving up is no move; what it
cost is `given_up`. The loop guard begins anew with each branch, and the cells visited before it count as visited.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Record
from marsexplorer.evaluation.losses import Loss, LossKind, classify_losses, is_blocked, moved
from marsexplorer.evaluation.missed import Missed, find_missed
from marsexplorer.evaluation.rollouts import GreedyRollouts, Snapshot, concatenate, play_branches
from marsexplorer.files import write_whole
from marsexplorer.policies.files.card import refuse
from marsexplorer.policies.loading import find_file, load
from marsexplorer.policies.network.batch import ActionScorer

REGRET_VERSION = "1"
"""Rises whenever the same episode and policy would have another regret."""
MAX_CELLS = 42 * 42
"""Larger boards take minutes an episode and are refused."""
MOVES_PER_BLOCK = 128
"""Moves whose branches are played together."""


@dataclass(frozen=True, eq=False)
class EpisodeRegret:
    """The regret of every move of an episode.

    actions   int64[moves], made
    lengths   int64[moves, 4], see above; `limit` for an invalid action
    coverage  float64[moves], before each move, 0..1
    kinds     of each loss, None where the regret is 0
    given_up  moves that giving up cost: the limit less the length of the episode had the policy gone on; 0 otherwise
    """

    actions: NDArray[np.int64]
    lengths: NDArray[np.int64]
    coverage: NDArray[np.float64]
    kinds: tuple[LossKind | None, ...]
    given_up: int

    @cached_property
    def regret(self) -> NDArray[np.int64]:
        """int64[moves]."""
        made = self.lengths[np.arange(len(self.actions)), self.actions]
        return np.asarray(made - self.lengths.min(1, initial=2**31))

    @cached_property
    def best_actions(self) -> NDArray[np.int64]:
        """int64[moves]: the action made where none is better, else the first best one in the order of the codes."""
        return np.where(self.regret > 0, self.lengths.argmin(1), self.actions)

    @property
    def total(self) -> int:
        """Regret of all moves, and what giving up cost."""
        return int(self.regret.sum()) + self.given_up

    def biggest(self, count: int = 3) -> list[Loss]:
        """Return the moves of the greatest regret, the greatest first; of equal ones the earlier first."""
        order = np.argsort(-self.regret, kind="stable")[:count]
        return [self.loss(int(step)) for step in order if self.regret[step] > 0]

    def loss(self, step: int) -> Loss:
        """Return what is known of the move number `step`, from 0."""
        action, best = int(self.actions[step]), int(self.best_actions[step])
        regret, coverage = int(self.regret[step]), float(self.coverage[step])
        return Loss(step, action, best, regret, coverage, self.kinds[step])

    def by_kind(self) -> dict[LossKind, int]:
        """Return the regret of each kind of loss; giving up counts as `ended early`."""
        found = dict.fromkeys(LossKind, 0)
        for kind, regret in zip(self.kinds, self.regret.tolist(), strict=True):
            if kind is not None:
                found[kind] += regret
        found[LossKind.ENDED_EARLY] += self.given_up
        return found

    def by_tenth(self) -> NDArray[np.int64]:
        """Return int64[10], the regret of the moves made while 0-10 %, 10-20 %, ... of the cells were known."""
        tenth = np.minimum((self.coverage * 10).astype(np.int64), 9)
        return np.bincount(tenth, weights=self.regret, minlength=10).astype(np.int64)


class RegretEstimator:
    """Works out regrets with one policy that goes on, and keeps what it has worked out in a folder.

    policy  name or path of a network of ours, greedy with the loop guard
    cache   a folder of files named by SHA-256 over policy file, versions of core and regret, and trajectory hash; each holds
            the lengths alone, and the folder may be deleted at any time. None keeps nothing

    PolicyNotFoundError and PolicyFileError as `policies.load` raises them, PolicyFileError also for other policies.
    """

    def __init__(self, policy: str | Path = "ppo", cache: Path | None = None) -> None:
        path = find_file(str(policy))
        net = getattr(load(path), "net", None)
        if net is None or net.acts != "greedy with guard":
            raise refuse(path, "a network of ours that is greedy with guard", "another policy")
        self._net: ActionScorer = net
        self._policy_hash = hashlib.sha256(path.read_bytes()).hexdigest()
        self._cache = cache

    def regret(self, record: Record) -> EpisodeRegret:
        """Return the regret of every move of an episode; ValueError for a board of more than MAX_CELLS cells."""
        check_size(record.config)
        return episode_regret(record, self._lengths(record))

    def regrets(
        self, records: Iterable[Record], on_progress: Callable[[int], None] = lambda done: None
    ) -> Iterator[EpisodeRegret]:
        """Yield the regret of each episode; `on_progress` is called with how many are done."""
        for done, record in enumerate(records, 1):
            yield self.regret(record)
            on_progress(done)

    def missed(self, record: Record, losses: Sequence[Loss]) -> list[Missed]:
        """Return what the better move would soon have shown, for each of some losses of the episode."""
        return find_missed(record, losses, self._net)

    def shares(self, record: Record) -> NDArray[np.float32]:
        """Return how probable the policy finds each action before each move, float32[moves, 4]."""
        return policy_shares(record, self._net)

    def _lengths(self, record: Record) -> NDArray[np.int64]:
        if self._cache is None:
            return branch_lengths(record, self._net)
        cause = f"{REGRET_VERSION}|{CORE_VERSION}|{self._policy_hash}|{record.trajectory_hash}"
        path = self._cache / f"{hashlib.sha256(cause.encode()).hexdigest()}.npy"
        kept = _read(path, len(record.actions))
        if kept is None:
            kept = branch_lengths(record, self._net)
            self._cache.mkdir(parents=True, exist_ok=True)
            with write_whole(path) as file:
                np.save(file, kept.astype(np.int32), allow_pickle=False)
        return kept


def check_size(config: EnvConfig) -> None:
    """Raise ValueError when the board is too large for regrets, or not all of its cells count."""
    if config.discoverable_only:
        raise ValueError(
            f"moves are judged on the levels of the paper, where all cells count; this board is of level {config.level}"
        )
    if config.n > MAX_CELLS:
        raise ValueError(
            f"moves are judged on boards of up to {MAX_CELLS} cells, such as 42x42; "
            f"this board has {config.rows}x{config.cols}, which would take minutes"
        )


def _read(path: Path, moves: int) -> NDArray[np.int64] | None:
    """Return the lengths in a file of the cache; None where there are none that fit, which are then worked out again."""
    try:
        found = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return found.astype(np.int64) if found.shape == (moves, 4) and found.dtype == np.int32 else None


def branch_lengths(record: Record, net: ActionScorer) -> NDArray[np.int64]:
    """Return int64[moves, 4]: moves of the whole episode for each action at each move, `limit` for an invalid one."""
    config, terrain = record.config, record.terrain_map()
    lengths = np.full((len(record.actions), 4), config.limit, np.int64)
    for first, worlds, cells in _before_moves(record, net):
        branches: list[tuple[int, int]] = []
        for at, cell in enumerate(cells):
            branches += [(at, free) for free in free_actions(terrain, *divmod(cell, config.cols))]
        places, actions = np.array(branches, np.int64).reshape(-1, 2).T
        chosen = {name: array[places] for name, array in worlds.items()}
        limits = np.full(len(places), config.limit)
        lengths[first + places, actions] = play_branches(config, net, chosen, actions, limits)
    return lengths


def policy_shares(record: Record, net: ActionScorer) -> NDArray[np.float32]:
    """Return float32[moves, 4]: how probable the policy finds each action before each move; its own is the most probable.

    The loop guard has nothing to say there: it begins anew with each branch.
    """
    shares = np.zeros((len(record.actions), 4), np.float32)
    for first, worlds, cells in _before_moves(record, net):
        rollouts = _rollouts(record, net, len(cells))
        rollouts.restore(np.arange(len(cells)), worlds)
        logits = rollouts.decide(net).logits
        weights = np.exp(logits - logits.max(1, keepdims=True))
        shares[first : first + len(cells)] = weights / weights.sum(1, keepdims=True)
    return shares


def _rollouts(record: Record, net: ActionScorer, count: int) -> GreedyRollouts:
    config = record.config
    return GreedyRollouts(config, count, net.rules_that_count(config.rows, config.cols))


def _before_moves(record: Record, net: ActionScorer) -> Iterator[tuple[int, Snapshot, list[int]]]:
    """Yield the worlds before each of up to MOVES_PER_BLOCK moves: the first move's number, and the rover's cells."""
    rollouts, only = _rollouts(record, net, 1), np.zeros(1, np.intp)
    rollouts.worlds.start_on(0, record.terrain_map(), record.start)
    states: list[Snapshot] = []
    cells: list[int] = []
    for step, action in enumerate(record.actions):
        cells.append(int(rollouts.mark_visited()[0]))
        states.append(rollouts.snapshot(only))
        rollouts.step(np.array([action]))
        if len(states) == MOVES_PER_BLOCK or step == len(record.actions) - 1:
            yield step + 1 - len(states), concatenate(states), cells
            states, cells = [], []


def free_actions(terrain: NDArray[np.bool_], row: int, col: int) -> list[int]:
    """Return the actions that lead from a cell to a free one."""
    return [action for action in range(4) if not is_blocked(terrain, moved((row, col), action))]


def episode_regret(record: Record, lengths: NDArray[np.int64]) -> EpisodeRegret:
    """Return the regret of an episode from its `branch_lengths`."""
    config, actions = record.config, np.frombuffer(record.actions, np.uint8).astype(np.int64)
    made = lengths[np.arange(len(actions)), actions]
    coverage, kinds = classify_losses(record, lengths)
    # Where nothing was moved before giving up, the whole episode was: its length is not known, and nothing is charged.
    given_up = int(config.limit - made[-1]) if record.outcome == "abandoned" and len(made) else 0
    return EpisodeRegret(actions, lengths, coverage, kinds, given_up)
