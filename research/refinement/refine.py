"""Refine a trained network: it learns where another action takes fewer moves.

A round branches episodes (`branch_episodes`), in as many processes as there are cores, and then
makes gradient steps on the pairs of actions found so far. The loss of a pair is the logistic one of
the two actions' logits, weighted by the cost: whatever chance says of single pairs, in the mean it
is lowest where the better action has the higher logit (cost-sensitive classification; Lagoudakis
and Parr 2003, "Reinforcement learning as classification").

Episodes are branched on grids of the sizes asked for. On grids of other sizes the network is
anchored to what it was: there its probabilities are fitted to those that it began with, and so are
its values everywhere. The same network, rounds and seed give the same weights, whatever the number
of processes.

An episode is played greedily. At some of its steps another action is taken instead, and the policy
goes on from there on the same terrain. The difference in length of the two episodes is a sample of
what that action costs given what is known there, as the terrain is a draw from those that look like
this so far. (The vine of Schulman et al. 2015, "Trust region policy optimization", section 5.2;
here with the whole episode as its length.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from copy import deepcopy
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.rollouts import (
    MIN_RUNNING_SHARE,
    Decisions,
    GreedyRollouts,
    Snapshot,
    concatenate,
    play_branches,
)
from marsexplorer.policies.network.batch import ActionScorer
from marsexplorer.policies.network.policy import rules_that_count
from marsexplorer.training.envs import refuse_evaluation_seeds
from marsexplorer.training.network import TRANSPOSED, Net, mixed_precision
from marsexplorer.training.ppo import MIN_LOG_PROB, between

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
"""Weight of an action where the network is certain, in comparison with 1 where it is undecided
between two.
"""


@dataclass(frozen=True)
class RefineConfig:
    """All settings of a run but its network, rounds and seed; the card lists them.

    sizes                     sides of the grids whose episodes are branched, cells
    tasks_per_level           tasks of a round on each family of terrains, large obstacles having
                              the most to learn from; on larger grids fewer in proportion to the
                              side, as a move takes longer there
    episodes_per_task         terrains of such a task at 21x21; on larger grids fewer, so that as
                              many moves are made
    pairs_per_episode         pairs of actions branched off each episode, about
    anchor_sizes              sides of the other grids, and episodes of a task there; none where
                              episodes are branched, but on the first where they are branched on all
    anchor_levels             levels of the other grids
    first_round_tasks         tasks of the first round, as a multiple of a later one's
    first_round_steps         gradient steps of the first round, as a multiple of a later one's
    gradient_steps            of a round
    batch_size, newest_pairs  pairs in a gradient step, half of them of the newest `newest_pairs`
    max_pairs                 pairs kept besides those of the first round
    max_observations          observations kept from the other grids
    anchor_batch_size         observations of those in a gradient step
    learning_rate             of AdamW; first_round_learning_rate: at the beginning of the first
                              round, annealed linearly
    weight_decay              of AdamW, for all weights but the prior's
    ema_decay                 the network that plays and is kept is an exponential moving average of
                              the one that learns
    logit_scale               factor of the logits that it began with: PPO ends almost certain of
                              every action
    vf_coef                   coefficient of the value loss
    cost_scale                typical cost at 21x21, moves; costs are in proportion to the side of
                              the grid
    max_grad_norm             gradients are clipped to this norm
    """

    sizes: tuple[int, ...] = (SIDE,)
    tasks_per_level: tuple[tuple[str, int], ...] = (
        ("random", 12),
        ("1-2-1", 4),
        ("2-2-1", 4),
        ("3-2-1", 4),
        ("1-1-1", 1),
        ("2-1-1", 1),
        ("3-1-1", 1),
    )
    episodes_per_task: int = 64
    pairs_per_episode: int = 16
    anchor_sizes: tuple[tuple[int, int], ...] = ((84, 3), (42, 16), (42, 16), (21, 48), (21, 48))
    anchor_levels: tuple[str, ...] = ("random",)
    first_round_tasks: int = 18
    first_round_steps: int = 14
    gradient_steps: int = 200
    batch_size: int = 2048
    newest_pairs: int = 200_000
    max_pairs: int = 500_000
    max_observations: int = 120_000
    anchor_batch_size: int = 512
    learning_rate: float = 5e-4
    first_round_learning_rate: float = 1e-3
    weight_decay: float = 0.1
    ema_decay: float = 0.998
    logit_scale: float = 0.25
    vf_coef: float = 0.02
    cost_scale: float = 3.0
    max_grad_norm: float = 1.0


DEFAULT_CONFIG = RefineConfig()
"""What `config_for` changes."""


def config_for(rounds: int, sizes: tuple[int, ...], was_refined: bool) -> RefineConfig:
    """The configuration of a run of so many rounds, of which the first is longest.

    was_refined  whether the network has been refined before: then it is no longer almost certain of
                 every move
    """
    return replace(
        DEFAULT_CONFIG,
        sizes=tuple(dict.fromkeys(sizes)),
        first_round_tasks=max(1, round(0.6 * rounds)),
        first_round_steps=max(1, round(0.45 * rounds)),
        logit_scale=1.0 if was_refined else DEFAULT_CONFIG.logit_scale,
    )


@dataclass(frozen=True)
class EpisodeTask:
    """Episodes to play in one process.

    pairs_per_episode 0 asks for sampled observations instead of pairs.
    """

    level: str
    size: int
    first_seed: int
    num_episodes: int
    pairs_per_episode: int


@dataclass(frozen=True)
class RoundMetrics:
    """The metrics of a round.

    round          its number, 1 for the first
    num_pairs      pairs found so far
    better_share   share of this round's pairs in which the other action was the better, 0..1
    loss           mean of the gradient steps
    episode_steps  mean moves of this round's episodes on level random, by size of the grid
    """

    round: int
    num_pairs: int
    better_share: float
    loss: float
    episode_steps: dict[str, float]


class SampleBuffer:
    """Rows of several tensors: permanent ones, then the newest `capacity` others."""

    def __init__(self, capacity: int) -> None:
        self._capacity, self._num_permanent = capacity, 0
        self.columns: list[Tensor] = []

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def append(self, rows: list[NDArray[Any]], permanent: bool = False) -> None:
        """Append rows, the same number to each column; the oldest others are dropped."""
        new = [
            torch.from_numpy(column if permanent else column[-self._capacity :]) for column in rows
        ]
        permanent_rows = self._num_permanent
        excess = (
            0 if permanent else max(0, len(self) - permanent_rows + len(new[0]) - self._capacity)
        )
        both = zip(self.columns or [column[:0] for column in new], new, strict=True)
        self.columns = [
            torch.cat([old[:permanent_rows], old[permanent_rows + excess :], added])
            for old, added in both
        ]
        if permanent:
            self._num_permanent = len(self)

    def sample(self, count: int, newest: int | None = None) -> list[Tensor]:
        """Draw `count` rows with replacement, from the `newest` rows if that is given."""
        low = max(0, len(self) - newest) if newest else 0
        indices = torch.randint(low, len(self), (count,))
        return [column[indices] for column in self.columns]

    def state_dict(self) -> dict[str, Any]:
        """Return the rows."""
        return {"columns": self.columns, "num_permanent": self._num_permanent}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Hold the rows that `state_dict` returned."""
        self.columns, self._num_permanent = state["columns"], state["num_permanent"]


class RefineRun:
    """A run under way, which can be saved and restored between two rounds.

    net          the network as it plays
    rounds_done  rounds made so far
    num_pairs    pairs found so far
    """

    def __init__(self, net: Net, seed: int, config: RefineConfig | None = None) -> None:
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        self.config = config or RefineConfig()
        self.seed, self.rounds_done, self.num_pairs = seed, 0, 0
        self._original = deepcopy(net).eval().requires_grad_(False)
        self._learner = deepcopy(net).train()
        with torch.no_grad():
            for weights in [*self._learner.policy_head[-1].parameters(), self._learner.prior]:
                weights.mul_(self.config.logit_scale)
        self.net = deepcopy(self._learner).eval().requires_grad_(False)
        others = [weights for name, weights in self._learner.named_parameters() if name != "prior"]
        groups: list[dict[str, Any]] = [
            {"params": others, "weight_decay": self.config.weight_decay},
            {"params": [self._learner.prior], "weight_decay": 0.0},
        ]
        self._optimizer = torch.optim.AdamW(groups, lr=self.config.learning_rate)
        self._pairs = SampleBuffer(self.config.max_pairs)
        self._observations = SampleBuffer(self.config.max_observations)
        self._next_seed = 2 * 10**15 + 10**12 * seed

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes."""
        return {
            "rounds_done": self.rounds_done,
            "num_pairs": self.num_pairs,
            "next_seed": self._next_seed,
            "net": self.net.state_dict(),
            "learner": self._learner.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "rng_state": torch.get_rng_state(),
            "pairs": self._pairs.state_dict(),
            "observations": self._observations.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` returned, with the state of torch's random numbers."""
        self.rounds_done, self.num_pairs = state["rounds_done"], state["num_pairs"]
        self._next_seed = state["next_seed"]
        self.net.load_state_dict(state["net"])
        self._learner.load_state_dict(state["learner"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._pairs.load_state_dict(state["pairs"])
        self._observations.load_state_dict(state["observations"])
        torch.set_rng_state(state["rng_state"])

    def make_tasks(self) -> list[EpisodeTask]:
        """The tasks of the next round; larger grids first, as they take longest."""
        config, tasks = self.config, list[EpisodeTask]()

        def add(level: str, size: int, episodes: int, pairs: int) -> None:
            tasks.append(EpisodeTask(level, size, self._next_seed, episodes, pairs))
            self._next_seed += episodes

        anchors = [anchor for anchor in config.anchor_sizes if anchor[0] not in config.sizes]
        for size, episodes in anchors or config.anchor_sizes[:1]:
            for level in config.anchor_levels:
                add(level, size, episodes, 0)
        factor = config.first_round_tasks if self.rounds_done == 0 else 1
        for size in sorted(config.sizes, reverse=True):
            episodes = max(1, config.episodes_per_task * SIDE**2 // size**2)
            for level, count in config.tasks_per_level:
                for _ in range(max(1, count * SIDE // size) * factor):
                    add(level, size, episodes, config.pairs_per_episode)
        return tasks

    def train_round(
        self, pool: Executor, on_progress: Callable[[float], None] = lambda done: None
    ) -> RoundMetrics:
        """Make a round; `on_progress` is called with its share that is done, 0..1."""
        tasks, results = self.make_tasks(), list[ActionPairs | SampledObservations]()
        weights = {name: tensor.numpy() for name, tensor in self.net.state_dict().items()}
        for result in pool.map(play_task, [(weights, task) for task in tasks]):
            results.append(result)
            on_progress(len(results) / len(tasks) / 2)
        pairs = [result for result in results if isinstance(result, ActionPairs)]
        sampled = [result for result in results if isinstance(result, SampledObservations)]
        self._store(pairs, sampled)
        loss = self._optimize(lambda done: on_progress((1 + done) / 2))
        self.rounds_done += 1
        cost = np.concatenate([batch.cost for batch in pairs])
        self.num_pairs += len(cost)
        steps: dict[str, list[int]] = {}
        for task, result in zip(tasks, results, strict=True):
            if task.level == "random":
                steps.setdefault(f"{task.size}x{task.size}", []).extend(result.steps.tolist())
        means = {size: fmean(moves) for size, moves in steps.items()}
        better = float((cost < 0).mean())
        return RoundMetrics(self.rounds_done, self.num_pairs, better, loss, means)

    def _store(self, pairs: list[ActionPairs], observations: list[SampledObservations]) -> None:
        """Append a round's pairs and observations to the buffers.

        The pairs of the first round stay.
        """
        names = ("planes", "moves", "own", "other", "cost")
        columns = [np.concatenate([getattr(one, name) for one in pairs]) for name in names]
        self._pairs.append(columns, permanent=self.rounds_done == 0)
        if observations:
            planes = np.concatenate([one.planes for one in observations])
            moves = np.concatenate([one.moves for one in observations])
            self._observations.append([planes, moves])

    def _optimize(self, on_progress: Callable[[float], None]) -> float:
        """Make the gradient steps of a round and return their mean loss."""
        config, is_first = self.config, self.rounds_done == 0
        count, total = config.gradient_steps * (config.first_round_steps if is_first else 1), 0.0
        for step in range(count):
            done, rate = step / count, config.learning_rate
            if is_first:
                rate = between(config.first_round_learning_rate, rate, done)
            for group in self._optimizer.param_groups:
                group["lr"] = rate
            total += self._gradient_step(transposed=step % 2 == 1)
            on_progress(done)
        return total / count

    def _gradient_step(self, transposed: bool) -> float:
        """Make one gradient step, perhaps on exchanged rows and columns; return the loss."""
        config = self.config
        num_pairs = self.config.batch_size
        num_anchors = self.config.anchor_batch_size
        # 1. Draw pairs, half of them from the newest, and observations of larger grids to anchor
        #    the network to.
        any_pairs = self._pairs.sample(num_pairs // 2)
        newest = self._pairs.sample(num_pairs // 2, config.newest_pairs)
        both = zip(any_pairs, newest, strict=True)
        planes, moves, own_actions, other, cost = (torch.cat(columns) for columns in both)
        anchors = self._observations.sample(num_anchors)
        planes, moves = (
            torch.cat(columns) for columns in zip((planes, moves), anchors, strict=True)
        )
        if transposed:
            planes, moves, own_actions, other = (
                planes[:, :, TRANSPOSED],
                moves.flip(1),
                3 - own_actions,
                3 - other,
            )
        with mixed_precision():
            logits, values = self._learner(planes, moves)
        # 2. Cost-weighted logistic loss of the pairs.
        margin = (
            logits.gather(1, other[:, None]) - logits.gather(1, own_actions[:, None])
        ).squeeze(1)
        loss = (cost.abs() * functional.softplus(cost.sign() * margin)).mean() / config.cost_scale
        # 3. Cross-entropy to the original policy on the anchors; squared error to its values there
        #    and on as many pairs.
        anchored = slice(num_pairs - num_anchors, None)
        with torch.no_grad():
            original_logits, original_values = self._original(planes[anchored], moves[anchored])
        probabilities = (config.logit_scale * original_logits[num_anchors:]).softmax(1)
        log_probs = logits[num_pairs:].log_softmax(1).clamp(min=MIN_LOG_PROB)
        loss = loss - (probabilities * log_probs).sum(1).mean()
        loss = loss + config.vf_coef * (values[anchored] - original_values).square().mean()
        # 4. Step the learner, and move the network that plays towards it.
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self._learner.parameters(), config.max_grad_norm)
        self._optimizer.step()
        with torch.no_grad():
            averages = zip(self.net.parameters(), self._learner.parameters(), strict=True)
            for average, learned in averages:
                average.lerp_(learned, 1 - config.ema_decay)
        return float(loss.detach())


@dataclass(frozen=True)
class ActionPairs:
    """Two actions for the same observation: the network's own, and another one.

    planes, moves  the observations, see `policies.network.features`
    own, other     int64[num_pairs], actions
    cost           float32[num_pairs], moves that the episode takes more with the other action, at
                   21x21 -MAX_COST..MAX_COST, in proportion to the side elsewhere
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
    """Observations (planes, moves) from some steps of episodes.

    steps  int64[num_episodes], moves of the episodes
    """

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    steps: NDArray[np.int64]


@dataclass(frozen=True)
class JointStep:
    """One step of episodes played together: worlds, episode numbers, decisions."""

    rollouts: GreedyRollouts
    episodes: NDArray[np.intp]
    decisions: Decisions


def branch_episodes(
    config: EnvConfig, net: ActionScorer, first_seed: int, num_episodes: int, pairs_per_episode: int
) -> ActionPairs:
    """Pairs of actions from the episodes on the terrains from first_seed on.

    The same network gives the same pairs.

    pairs_per_episode  about how many pairs an episode gives in the mean
    """
    rng = np.random.default_rng(first_seed)
    steps = np.zeros(num_episodes, np.int64)
    rate = pairs_per_episode / (TYPICAL_MOVES_PER_CELL * config.n)
    branches: list[tuple[Snapshot, Snapshot]] = []
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
        branches.append((rollouts.snapshot(chosen), pairs))
    worlds = concatenate([snapshot for snapshot, _ in branches])
    pairs = concatenate([pairs for _, pairs in branches])
    cost = extra_moves(config, net, worlds, pairs["other"], steps[pairs.pop("episode")])
    most = MAX_COST * relative_side(config)
    return ActionPairs(**pairs, cost=np.clip(cost, -most, most).astype(np.float32), steps=steps)


def sample_observations(
    config: EnvConfig, net: ActionScorer, first_seed: int, num_episodes: int
) -> SampledObservations:
    """The observations at OBSERVATION_SHARE of the steps of some episodes.

    On the terrains first_seed and following.
    """
    rng = np.random.default_rng(first_seed)
    steps, planes, moves = np.zeros(num_episodes, np.int64), [], []
    for joint in play_greedily(config, net, first_seed, steps):
        is_drawn = rng.random(joint.rollouts.num_worlds) < OBSERVATION_SHARE
        chosen = joint.rollouts.running & is_drawn
        planes.append(joint.decisions.planes[chosen])
        moves.append(joint.decisions.moves[chosen])
    return SampledObservations(np.concatenate(planes), np.concatenate(moves), steps)


def play_greedily(
    config: EnvConfig, net: ActionScorer, first_seed: int, steps: NDArray[np.int64]
) -> Iterator[JointStep]:
    """Play the terrains from first_seed on to their ends and yield every step.

    steps  int64[num_episodes], becomes the moves of each episode

    Episodes are followed for MAX_MOVES_PER_CELL moves a cell at most. What was yielded changes with
    the next step.
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
            still_running = np.flatnonzero(running)
            if not len(still_running):
                return
            rollouts, episodes = rollouts.subset(still_running), episodes[still_running]
        decisions = rollouts.decide(net)
        yield JointStep(rollouts, episodes, decisions)
        running = rollouts.running
        rollouts.step(decisions.actions)
        steps[episodes[running & ~rollouts.running]] = count


def alternative_weights(decisions: Decisions, headings: NDArray[np.int64]) -> NDArray[np.float64]:
    """How much each other action is worth trying: float64[num_worlds, 4].

    More where the network is less certain.

    Turning back is tried half as often; the network's own action and invalid ones never.
    """
    rows = np.arange(len(decisions.actions))
    margins = decisions.logits - decisions.logits[rows, decisions.actions][:, None]
    probability = 1 / (1 + np.exp(-np.clip(margins, -50.0, 0.0).astype(np.float64)))
    doubts = BASE_WEIGHT + 4 * probability * (1 - probability)
    weights = np.where(decisions.moves[:, :, 0] > 0, doubts, 0.0)
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
    """The moves more than `steps` if `actions` are taken in the worlds of a snapshot.

    actions, steps  int64[num_branches]; so is the result, at 21x21 at most MAX_EXTRA_MOVES
    """
    limits = steps + round(MAX_EXTRA_MOVES * relative_side(config))
    return play_branches(config, net, worlds, actions, limits) - steps


def relative_side(config: EnvConfig) -> float:
    """The side of a grid over that of 21x21, by which costs grow.

    Chance adds up over longer episodes.
    """
    return float((config.n / SIDE**2) ** 0.5)


def play_task(
    job: tuple[dict[str, NDArray[np.float32]], EpisodeTask],
) -> ActionPairs | SampledObservations:
    """Play a task with a network; `job` is (weights by name, task)."""
    weights, task = job
    torch.set_num_threads(1)
    net = _FastNet().eval()
    net.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    config, terrains = EnvConfig.of(task.level, task.size), (task.first_seed, task.num_episodes)
    if task.pairs_per_episode:
        pairs = branch_episodes(config, net, *terrains, task.pairs_per_episode)
        return replace(pairs, cost=(pairs.cost / relative_side(config)).astype(np.float32))
    return sample_observations(config, net, *terrains)


class _FastNet(Net):
    """The network, in bfloat16 where that is fast: its best action is nearly the same."""

    def rules_that_count(self, rows: int, cols: int) -> tuple[int, ...] | None:
        weights = {name: tensor.numpy() for name, tensor in self.state_dict().items()}
        return rules_that_count(weights, rows, cols)

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        with torch.inference_mode(), mixed_precision():
            logits, values = self(torch.from_numpy(planes), torch.from_numpy(moves))
        return logits.float().numpy(), values.float().numpy()
