"""Refining a trained network: it learns at which moments another move would have taken fewer moves.

A round branches episodes (`branches.branch`), in as many processes as there are cores, and then makes gradient steps on the
pairs of moves found so far. The loss of a pair is the logistic one of the two moves' scores, weighted by the cost: whatever
chance says of single pairs, in the mean it is lowest where the better move has the higher score (cost-sensitive
classification; Lagoudakis and Parr 2003, "Reinforcement learning as classification").

What the network does on larger grids is held: there its probabilities are fitted to those that it began with, and so are its
values everywhere. The same network, rounds and seed give the same weights, whatever the number of processes.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from copy import deepcopy
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from marsexplorer.config import EnvConfig
from marsexplorer.policies.network.features import RINGS
from marsexplorer.policies.network.model import Net
from marsexplorer.training.branching import Looks, Pairs, branch, walk
from marsexplorer.training.ppo import NEVER_LOG


@dataclass(frozen=True)
class Plan:
    """Everything that fixes a run besides its network, rounds and seed; the card of the policy lists it.

    levels               tasks of a round on each family of terrains at 21x21: large obstacles have the most to learn from
    episodes, each       of such a task: terrains, and pairs branched off each episode
    held                 sizes of the larger grids, and episodes of a task there
    opening, first       tasks and gradient steps of the first round, as multiples of a later one's
    steps, batch         gradient steps a round; pairs in one, half of them of the newest `newest`
    window               pairs kept besides those of the first round
    looks, held_batch    moments kept from the larger grids, and in a gradient step
    rate, opening_rate   Adam's learning rates; decay: of the weights (AdamW)
    average              the network that plays and is kept moves towards the one that learns by 1 - average a step
    softer               the scores it began with are taken by so much: PPO ends almost certain of every move
    hold_values          weight of the values' squared error
    scale                typical cost, moves; max_grad: largest norm of a gradient
    """

    levels: tuple[tuple[str, int], ...] = (
        ("random", 12), ("1-2-1", 4), ("2-2-1", 4), ("3-2-1", 4), ("1-1-1", 1), ("2-1-1", 1), ("3-1-1", 1),
    )  # fmt: skip
    episodes: int = 64
    each: int = 16
    held: tuple[tuple[int, int], ...] = ((84, 3), (42, 16), (42, 16))
    opening: int = 18
    first: int = 14
    steps: int = 200
    batch: int = 2048
    newest: int = 200_000
    window: int = 500_000
    looks: int = 120_000
    held_batch: int = 512
    rate: float = 5e-4
    opening_rate: float = 1e-3
    decay: float = 0.1
    average: float = 0.998
    softer: float = 0.25
    hold_values: float = 0.02
    scale: float = 3.0
    max_grad: float = 1.0


@dataclass(frozen=True)
class Task:
    """Something to play in a process of its own; `pairs` an episode, 0 for looks alone."""

    level: str
    size: int
    first_seed: int
    episodes: int
    pairs: int


@dataclass(frozen=True)
class Report:
    """How a round went.

    pairs   found so far; better: share of this round's in which the other move was the better; loss: mean of the gradient steps
    steps   mean moves of this round's episodes on level random, by size of the grid
    """

    round: int
    pairs: int
    better: float
    loss: float
    steps: dict[str, float]


class Heap:
    """Rows of several tensors: the first ones for good, then the newest `room` of those that follow."""

    def __init__(self, room: int) -> None:
        self._room, self._first = room, 0
        self.columns: list[Tensor] = []

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def add(self, rows: list[NDArray[Any]], for_good: bool = False) -> None:
        """Add rows, the same number to each column; the oldest make way."""
        fresh = [torch.from_numpy(each) for each in rows]
        over = max(0, len(self) - self._first + len(fresh[0]) - self._room) if not for_good else 0
        parts = self.columns or [each[:0] for each in fresh]
        self.columns = [
            torch.cat([old[: self._first], old[self._first + over :], new]) for old, new in zip(parts, fresh, strict=True)
        ]
        if for_good:
            self._first = len(self)

    def draw(self, count: int, newest: int | None = None) -> list[Tensor]:
        """Return `count` rows drawn at random, of the newest ones alone if so asked."""
        low = max(0, len(self) - newest) if newest else 0
        which = torch.randint(low, len(self), (count,))
        return [each[which] for each in self.columns]


class Refining:
    """A run under way: `round` makes one; `net` is the network as it plays, `done` counts rounds and `found` pairs."""

    def __init__(self, net: Net, seed: int, plan: Plan | None = None) -> None:
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        self.plan = plan or Plan()
        self.seed, self.done, self.found = seed, 0, 0
        self._origin = deepcopy(net).eval().requires_grad_(False)
        self._learner = deepcopy(net).train()
        with torch.no_grad():
            for weights in self._learner.judge[-1].parameters():
                weights.mul_(self.plan.softer)
        self.net = deepcopy(self._learner).eval().requires_grad_(False)
        self._optimiser = torch.optim.AdamW(self._learner.parameters(), lr=self.plan.rate, weight_decay=self.plan.decay)
        self._pairs, self._looks = Heap(self.plan.window), Heap(self.plan.looks)
        self._next_seed = 2 * 10**15 + 10**12 * seed

    def tasks(self) -> list[Task]:
        """Return what the next round plays; larger grids first, as they take longest."""
        plan, tasks = self.plan, []
        kinds = [("random", size, episodes, 0) for size, episodes in plan.held]
        times = plan.opening if self.done == 0 else 1
        kinds += [(level, 21, plan.episodes, plan.each) for level, count in plan.levels for _ in range(count * times)]
        for level, size, episodes, pairs in kinds:
            tasks.append(Task(level, size, self._next_seed, episodes, pairs))
            self._next_seed += episodes
        return tasks

    def round(self, pool: Executor, tell: Callable[[float], None] = lambda gone: None) -> Report:
        """Make a round; `tell` hears which share of it is done, 0..1."""
        tasks, found = self.tasks(), list[Pairs | Looks]()
        weights = {name: tensor.numpy() for name, tensor in self.net.state_dict().items()}
        for result in pool.map(work, [(weights, task) for task in tasks]):
            found.append(result)
            tell(len(found) / len(tasks) / 2)
        pairs = [one for one in found if isinstance(one, Pairs)]
        looks = [one for one in found if isinstance(one, Looks)]
        names = ("planes", "moves", "own", "other", "cost")
        self._pairs.add([np.concatenate([getattr(one, name) for one in pairs]) for name in names], self.done == 0)
        self._looks.add([np.concatenate([getattr(one, name) for one in looks]) for name in names[:2]])
        loss = self._learn(lambda gone: tell((1 + gone) / 2))
        self.done += 1
        cost = np.concatenate([one.cost for one in pairs])
        self.found += len(cost)
        steps: dict[str, list[int]] = {}
        for task, one in zip(tasks, found, strict=True):
            if task.level == "random":
                steps.setdefault(f"{task.size}x{task.size}", []).extend(one.steps.tolist())
        return Report(
            self.done, self.found, float((cost < 0).mean()), loss, {size: fmean(each) for size, each in steps.items()}
        )

    def _learn(self, tell: Callable[[float], None]) -> float:
        """Make the gradient steps of a round and return their mean loss."""
        plan, opening = self.plan, self.done == 0
        count, total = plan.steps * (plan.first if opening else 1), 0.0
        for step in range(count):
            gone = step / count
            rate = plan.opening_rate + (plan.rate - plan.opening_rate) * gone if opening else plan.rate
            self._optimiser.param_groups[0]["lr"] = rate
            total += self._improve(turned=step % 2 == 1)
            tell(gone)
        return total / count

    def _improve(self, turned: bool) -> float:
        """Make one gradient step, on the boards as they were or as in a mirror; return its loss."""
        plan, num = self.plan, self.plan.batch
        halves = self._pairs.draw(num // 2), self._pairs.draw(num // 2, plan.newest)
        planes, moves, own, other, cost = (torch.cat(each) for each in zip(*halves, strict=True))
        planes, moves = (torch.cat(each) for each in zip((planes, moves), self._looks.draw(plan.held_batch), strict=True))
        if turned:
            planes, moves, own, other = planes[:, :, MIRROR], moves.flip(1), 3 - own, 3 - other
        with torch.autocast("cpu", torch.bfloat16):
            scores, values = self._learner(planes, moves)
        apart = (scores.gather(1, other[:, None]) - scores.gather(1, own[:, None])).squeeze(1)
        loss = (cost.abs() * functional.softplus(cost.sign() * apart)).mean() / plan.scale
        some = slice(num - plan.held_batch, None)  # as many pairs as looks
        with torch.no_grad():
            before, worth = self._origin(planes[some], moves[some])
        wanted = (plan.softer * before[plan.held_batch :]).softmax(1)
        loss = loss - (wanted * scores[num:].log_softmax(1).clamp(min=NEVER_LOG)).sum(1).mean()
        loss = loss + plan.hold_values * (values[some] - worth).square().mean()
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self._learner.parameters(), plan.max_grad)
        self._optimiser.step()
        with torch.no_grad():
            for mean, newest in zip(self.net.parameters(), self._learner.parameters(), strict=True):
                mean.lerp_(newest, 1 - plan.average)
        return float(loss.detach())


def work(job: tuple[dict[str, NDArray[np.float32]], Task]) -> Pairs | Looks:
    """Play a task with the network of these weights."""
    weights, task = job
    torch.set_num_threads(1)
    net = _Quick().eval()
    net.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    config = EnvConfig.of(task.level, task.size)
    if task.pairs:
        return branch(config, net, task.first_seed, task.episodes, task.pairs)
    return walk(config, net, task.first_seed, task.episodes)


class _Quick(Net):
    """The network in bfloat16: twice as fast, and hardly ever of another mind."""

    def decide(self, planes: NDArray[np.uint8], moves: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16):
            logits, values = self(torch.from_numpy(planes), torch.from_numpy(moves))
        return logits.float().numpy(), values.float().numpy()


def mirror() -> Tensor:
    """Return where the cells of the pictures lie once rows and columns are exchanged: int64[CELLS]."""
    parts, start = [], 0
    for side, _ in RINGS:
        parts.append(torch.arange(start, start + side * side).view(side, side).T.flatten())
        start += side * side
    return torch.cat(parts)


MIRROR = mirror()
