"""PPO, told top to bottom: imitate the planner, then improve by playing.

1. The planner labels states that it and a little randomness lead to.
2. The network learns to take the planner's move, its boards turned and mirrored in the eight ways that leave the task the same.
3. Proximal policy optimisation (Schulman et al. 2017) on the rewards of the task, beginning with updates of the value alone.

No training terrain has a seed in EVALUATION_SEEDS: a run that drew one would stop. The same seed, steps and thread count give
the same weights on one CPU.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from marsexplorer.config import EnvConfig
from marsexplorer.policies.common import Memory
from marsexplorer.policies.network import NEVER, Net
from marsexplorer.policies.perception import NUMBERS, PLANES, SIDE, Perception
from marsexplorer.policies.planner import Planner
from marsexplorer.vector import MarsExplorerVector

EVALUATION_SEEDS = range(10**9, 10**9 + 10**6)
"""Seeds that are for evaluation: training refuses them."""

FLIPS = (
    (False, False, False), (False, False, True), (False, True, False), (False, True, True),
    (True, False, False), (True, False, True), (True, True, False), (True, True, True),
)  # fmt: skip
"""The eight symmetries of the grid: transposed, upside down, left to right."""


@dataclass(frozen=True)
class Recipe:
    """What a run is made of; the card of the policy lists it.

    labels, mistakes, clone_passes   states labelled by the planner; share of random moves on the way; passes over them
    boards, horizon                  environments stepped together; moves of each between updates
    epochs, minibatch, clip          of PPO's updates
    rate, final_rate                 Adam's learning rate, falling linearly
    entropy, final_entropy           weight of the entropy in the loss, falling linearly: curious first, decided at the end
    value_share                      weight of the value's error
    gamma, lam                       discount and GAE's lambda (Schulman et al. 2016)
    value_updates                    updates of the value alone before the policy moves
    reward_scale                     rewards are divided by it
    """

    labels: int = 60_000
    mistakes: float = 0.12
    clone_passes: int = 8
    boards: int = 256
    horizon: int = 64
    epochs: int = 3
    minibatch: int = 2048
    clip: float = 0.2
    rate: float = 5e-4
    final_rate: float = 2e-5
    entropy: float = 0.03
    final_entropy: float = 0.002
    value_share: float = 0.25
    gamma: float = 0.995
    lam: float = 0.95
    value_updates: int = 6
    reward_scale: float = 100.0
    max_grad: float = 1.0


@dataclass
class Progress:
    """How a run stands: the last episodes finished in training, with sampled moves."""

    stage: str = "label"
    done: int = 0
    total: int = 0
    note: str = ""
    lengths: deque[int] = field(default_factory=lambda: deque(maxlen=1000))
    explored: deque[bool] = field(default_factory=lambda: deque(maxlen=1000))


Tell = Callable[[Progress], None]
Labels = tuple[Tensor, Tensor, Tensor]
"""planes, moves and the actions wanted, [labels, ...]."""


@dataclass(frozen=True)
class Step:
    """What a move brought: rewards float64[num]; ended, truncated bool[num]; final: what truncated boards last looked like."""

    rewards: NDArray[np.float64]
    ended: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    final: tuple[Tensor, Tensor] | None


class Boards:
    """A stack of environments with what the network needs of each: cells stood on, headings, perception."""

    def __init__(self, config: EnvConfig, num: int, seed: int) -> None:
        options: dict[str, Any] = {"level": config.level, "size": (config.rows, config.cols), "observation": "uint8"}
        options |= {"sensor_radius": config.sensor_radius, "max_steps": config.max_steps}
        env = gymnasium.make_vec("MarsExplorer-v0", num_envs=num, vectorization_mode="vector_entry_point", **options)
        assert isinstance(env, MarsExplorerVector)
        self.env, self.num, self.config = env, num, config
        self.eyes = Perception(num, config.rows, config.cols, config.sensor_radius)
        self.codes, info = env.reset(seed=seed)
        refuse_evaluation_seeds(info["terrain_seed"])
        self.visited: NDArray[np.uint8] = np.zeros((num, config.n), np.uint8)
        self.headings: NDArray[np.int64] = np.ones(num, np.int64)
        self.steps: NDArray[np.int64] = np.zeros(num, np.int64)
        self._stand(info["position"])

    def _stand(self, positions: NDArray[np.int64]) -> None:
        self.places = positions[:, 0] * self.config.cols + positions[:, 1]
        self.visited[np.arange(self.num), self.places] = 1

    def look(self) -> tuple[Tensor, Tensor]:
        """Return (planes, moves) of all boards; the arrays change with the next look."""
        planes, moves = self.eyes(self.codes, self.places, self.visited, self.headings)
        return torch.from_numpy(planes), torch.from_numpy(moves)

    def step(self, actions: NDArray[np.int64], progress: Progress) -> Step:
        """Make one move on every board; what ended begins anew."""
        self.codes, rewards, terminated, truncated, info = self.env.step(actions)
        self.headings, self.steps = actions, self.steps + 1
        ended = terminated | truncated
        final = None
        if ended.any():
            for i in np.flatnonzero(ended):
                progress.lengths.append(int(self.steps[i]))
                progress.explored.append(info["final_info"]["outcome"][i] == "explored")
            if truncated.any():
                final = self._look_back(np.flatnonzero(truncated), info)
            refuse_evaluation_seeds(info["terrain_seed"])
            self.visited[ended], self.steps[ended] = 0, 0
            self.headings = np.where(ended, 1, actions)
        self._stand(info["position"])
        return Step(rewards, ended, truncated, final)

    def _look_back(self, which: NDArray[np.intp], info: dict[str, Any]) -> tuple[Tensor, Tensor]:
        """Return (planes, moves) of the last observations of boards that ran out of time."""
        positions = info["final_info"]["position"][which]
        places = positions[:, 0] * self.config.cols + positions[:, 1]
        visited = self.visited[which]
        visited[np.arange(len(which)), places] = 1
        codes = np.stack([info["final_obs"][i] for i in which])
        eyes = Perception(len(which), self.config.rows, self.config.cols, self.config.sensor_radius)
        planes, moves = eyes(codes, places, visited, self.headings[which])
        return torch.from_numpy(planes), torch.from_numpy(moves)


def refuse_evaluation_seeds(seeds: NDArray[np.int64]) -> None:
    """Raise ValueError when a training terrain is one of those kept for evaluation."""
    kept = (seeds >= EVALUATION_SEEDS.start) & (seeds < EVALUATION_SEEDS.stop)
    if kept.any():
        raise ValueError(f"training met seed {int(seeds[kept][0])}, which is kept for evaluation; train with another seed")


def turned(planes: Tensor, moves: Tensor, actions: Tensor, which: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return a batch as seen on a turned or mirrored board; which 0..7 of FLIPS."""
    transpose, down, right = FLIPS[which]
    order = [0, 1, 2, 3]
    if transpose:
        planes, order = planes.transpose(2, 3), [order[3], order[2], order[1], order[0]]
    if down:
        planes, order = planes.flip(2), [order[2], order[1], order[0], order[3]]
    if right:
        planes, order = planes.flip(3), [order[0], order[3], order[2], order[1]]
    where = torch.tensor([order.index(action) for action in range(4)])
    return planes, moves[:, order], where[actions]


def label(config: EnvConfig, recipe: Recipe, seed: int, tell: Tell, progress: Progress) -> Labels:
    """Return (planes, moves, actions) of states with the planner's move in each."""
    num = 64
    boards, rng = Boards(config, num, seed), np.random.default_rng(seed)
    planners = [Planner(config.sensor_radius) for _ in range(num)]
    for number, planner in enumerate(planners):
        planner.reset(seed * num + number)
    memories = [Memory() for _ in range(num)]
    rounds = recipe.labels // num
    planes = torch.zeros((rounds, num, PLANES, SIDE, SIDE), dtype=torch.uint8)
    moves, actions = torch.zeros((rounds, num, 4, NUMBERS)), torch.zeros((rounds, num), dtype=torch.long)
    progress.stage, progress.total = "label", rounds * num
    for k in range(rounds):
        planes[k], moves[k] = boards.look()
        wanted = np.zeros(num, np.int64)
        for i, memory in enumerate(memories):
            memory.take(boards.codes[i].copy())
            wanted[i] = planners[i].decide(memory)
        actions[k] = torch.from_numpy(wanted)
        chance = moves[k, :, :, 0].numpy() * rng.random((num, 4))
        made: NDArray[np.int64] = np.where(rng.random(num) < recipe.mistakes, chance.argmax(1), wanted)
        for ended in np.flatnonzero(boards.step(made, progress).ended):
            memories[ended].forget()
        progress.done = (k + 1) * num
        tell(progress)
    return planes.flatten(0, 1), moves.flatten(0, 1), actions.flatten()


def clone(net: Net, data: Labels, recipe: Recipe, rng: np.random.Generator, tell: Tell, progress: Progress) -> None:
    """Teach the network the labelled moves."""
    planes, moves, actions = data
    batch = 1024
    total = recipe.clone_passes * len(actions) // batch
    optimiser = torch.optim.Adam(net.parameters(), lr=1.5e-3, eps=1e-5)
    progress.stage, progress.total = "clone", total
    hits = 0.0
    for k in range(total):
        optimiser.param_groups[0]["lr"] = 1.5e-3 * (1 - 0.95 * k / total)
        chosen = torch.from_numpy(rng.integers(0, len(actions), batch))
        seen = turned(planes[chosen], moves[chosen], actions[chosen], int(rng.integers(8)))
        with torch.autocast("cpu", torch.bfloat16):
            logits, _ = net(seen[0], seen[1])
        loss = functional.cross_entropy(logits, seen[2])
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        hits = 0.98 * hits + 0.02 * float((logits.argmax(1) == seen[2]).float().mean())
        progress.done, progress.note = k + 1, f"agrees with the planner in {hits / (1 - 0.98 ** (k + 1)):.1%}"
        tell(progress)


@dataclass
class Rollout:
    """`horizon` moves of every board; tensors [horizon, boards, ...]."""

    planes: Tensor
    moves: Tensor
    actions: Tensor
    logs: Tensor
    values: Tensor
    rewards: Tensor
    ended: Tensor

    @classmethod
    def room(cls, recipe: Recipe) -> Rollout:
        shape = (recipe.horizon, recipe.boards)
        return cls(
            torch.zeros((*shape, PLANES, SIDE, SIDE), dtype=torch.uint8),
            torch.zeros((*shape, 4, NUMBERS)),
            torch.zeros(shape, dtype=torch.long),
            *(torch.zeros(shape) for _ in range(4)),
        )


def collect(net: Net, boards: Boards, into: Rollout, recipe: Recipe, progress: Progress) -> Tensor:
    """Fill a rollout with sampled moves; return the values float32[boards] of where the boards stand afterwards."""
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        for t in range(recipe.horizon):
            planes, moves = boards.look()
            into.planes[t], into.moves[t] = planes, moves
            logits, values = net(planes, moves)
            logs = logits.log_softmax(1)
            actions = torch.multinomial(logs.exp(), 1).squeeze(1)
            into.actions[t], into.values[t] = actions, values
            into.logs[t] = logs.gather(1, actions[:, None]).squeeze(1)
            step = boards.step(actions.numpy(), progress)
            into.rewards[t] = torch.from_numpy(step.rewards / recipe.reward_scale)
            if step.final is not None:  # a time limit is no end of the task: bootstrap from the last observation
                into.rewards[t, torch.from_numpy(step.truncated)] += recipe.gamma * net(*step.final)[1]
            into.ended[t] = torch.from_numpy(step.ended.astype(np.float32))
        return torch.as_tensor(net(*boards.look())[1])


def advantages(rollout: Rollout, after: Tensor, recipe: Recipe) -> Tensor:
    """Return generalised advantage estimates, float32[horizon, boards] (Schulman et al. 2016, eq. 16)."""
    found, running, following = torch.zeros_like(rollout.values), torch.zeros_like(after), after
    for t in reversed(range(len(found))):
        goes_on = 1 - rollout.ended[t]
        surprise = rollout.rewards[t] + recipe.gamma * following * goes_on - rollout.values[t]
        running = surprise + recipe.gamma * recipe.lam * goes_on * running
        found[t], following = running, rollout.values[t]
    return found


def update(
    net: Net,
    optimiser: torch.optim.Optimizer,
    rollout: Rollout,
    after: Tensor,
    recipe: Recipe,
    entropy_share: float,
    value_only: bool,
) -> float:
    """Improve the network by the clipped objective (Schulman et al. 2017, eq. 7); return how far the ratio moved from 1."""
    gains = advantages(rollout, after, recipe)
    targets = (gains + rollout.values).flatten()
    planes, moves = rollout.planes.flatten(0, 1), rollout.moves.flatten(0, 1)
    actions, logs, gains = rollout.actions.flatten(), rollout.logs.flatten(), gains.flatten()
    moved, count = 0.0, 0
    for _ in range(recipe.epochs):
        for chosen in torch.split(torch.randperm(len(actions)), recipe.minibatch):
            with torch.autocast("cpu", torch.bfloat16):
                logits, values = net(planes[chosen], moves[chosen])
            all_logs = logits.log_softmax(1)
            ratio = (all_logs.gather(1, actions[chosen, None]).squeeze(1) - logs[chosen]).exp()
            gain = gains[chosen]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            clipped = ratio.clamp(1 - recipe.clip, 1 + recipe.clip)
            policy_loss = -torch.min(ratio * gain, clipped * gain).mean()
            value_loss = 0.5 * (values - targets[chosen]).square().mean()
            entropy = -(all_logs.exp() * all_logs.clamp(min=NEVER / 1e7)).sum(1).mean()
            loss = 0.5 * value_loss if value_only else policy_loss + recipe.value_share * value_loss - entropy_share * entropy
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), recipe.max_grad)
            optimiser.step()
            moved, count = moved + float((ratio.detach() - 1).abs().mean()), count + 1
    return moved / count


def train(
    config: EnvConfig, steps: int, seed: int, recipe: Recipe, tell: Tell, checkpoint: Callable[[Net, dict[str, Any]], None]
) -> Net:
    """Return a network trained for `steps` moves of PPO after the warm start.

    tell        called with the progress every now and then
    checkpoint  called with the network and its numbers every 25 updates and at the end
    """
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    rng, progress, began = np.random.default_rng(seed), Progress(), time.monotonic()
    net = Net()
    if recipe.labels:
        clone(net, label(config, recipe, 1_000_000 * (seed + 1), tell, progress), recipe, rng, tell, progress)
        progress.lengths.clear()
        progress.explored.clear()
    boards, rollout = Boards(config, recipe.boards, 10_000_000 * (seed + 1)), Rollout.room(recipe)
    optimiser = torch.optim.Adam(net.parameters(), lr=recipe.rate, eps=1e-8)
    updates = max(1, steps // (recipe.boards * recipe.horizon))
    progress.stage, progress.total = "ppo", updates
    for k in range(updates):
        gone = k / updates
        optimiser.param_groups[0]["lr"] = recipe.rate + (recipe.final_rate - recipe.rate) * gone
        curious = recipe.entropy + (recipe.final_entropy - recipe.entropy) * gone
        after = collect(net, boards, rollout, recipe, progress)
        moved = update(
            net, optimiser, rollout, after, recipe, curious, value_only=bool(recipe.labels) and k < recipe.value_updates
        )
        spent = time.monotonic() - began
        progress.done = k + 1
        length, share = np.mean(progress.lengths or [0]), np.mean(progress.explored or [0])
        progress.note = f"{length:.1f} moves, {share:.1%} explored, ratio moved {moved:.3f}"
        tell(progress)
        if (k + 1) % 25 == 0 or k + 1 == updates:
            numbers = {"updates": k + 1, "moves": (k + 1) * recipe.boards * recipe.horizon, "seconds": round(spent)}
            checkpoint(net, {**numbers, "recipe": asdict(recipe), "seed": seed})
    return net.eval()


def checkpoint_to(path: Path, card: dict[str, Any]) -> Callable[[Net, dict[str, Any]], None]:
    """Return a `checkpoint` that writes a policy file with this card and the run's numbers."""
    from marsexplorer.policies.network import save_network

    return lambda net, numbers: save_network(net, path, {**card, "training": numbers})
