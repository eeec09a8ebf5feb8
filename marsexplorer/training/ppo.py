"""PPO, told top to bottom: play, judge the moves, improve, again.

1. The network plays on all boards for `horizon` moves, drawing each move from its probabilities (`collect`).
2. Generalised advantage estimation says how much better each move was than expected (`advantages`).
3. The clipped objective moves the probabilities towards the better ones (`update`); the weight of the entropy in it is steered
   so that the policy stays as curious as the recipe wants, less and less.

It begins from nothing: no teacher, no demonstrations. Schulman et al. 2017, "Proximal policy optimization algorithms". The same
recipe, levels, sizes, seed and steps give the same weights on one CPU, also when the run was interrupted and resumed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from marsexplorer.config import EnvConfig
from marsexplorer.training.config import Recipe, stacks
from marsexplorer.training.envs import Boards, Inputs, Stacks, Step, in_moves

STEER = 1.05
"""Factor by which the weight of the entropy is steered after an update."""
MOST_ENTROPY = 0.5
NEVER_LOG = -100.0
"""Log-probabilities are taken to be no lower where entropies and divergences are summed: invalid moves have -1e9."""


@dataclass
class Rollout:
    """`horizon` moves of every board; tensors [horizon, boards, ...], kept on the CPU.

    logs   float32[horizon, boards, 4], log-probabilities of all moves; rewards in the recipe's unit
    """

    inputs: list[Tensor]
    actions: Tensor
    logs: Tensor
    values: Tensor
    rewards: Tensor
    ended: Tensor

    @classmethod
    def room(cls, recipe: Recipe, sample: Inputs) -> Rollout:
        """Return an empty rollout; `sample` shows what the inputs of all boards look like."""
        shape = (recipe.horizon, recipe.boards)
        inputs = [torch.zeros((recipe.horizon, *each.shape), dtype=each.dtype) for each in sample]
        return cls(
            inputs, torch.zeros(shape, dtype=torch.long), torch.zeros((*shape, 4)), *(torch.zeros(shape) for _ in range(3))
        )


@dataclass
class Run:
    """A run under way: what `save` keeps and `load` brings back, whole updates at a time.

    updates         of the run in all; done: made so far
    entropy_share   weight of the entropy in the loss as steered; kl_share: of the divergence
    device          where the network computes: "cpu" or "cuda"
    """

    recipe: Recipe
    configs: list[EnvConfig]
    seed: int
    updates: int
    boards: Stacks
    net: nn.Module
    optimiser: torch.optim.Optimizer
    device: str = "cpu"
    done: int = 0
    entropy_share: float = 0.05
    kl_share: float = 0.0

    @classmethod
    def begin(cls, recipe: Recipe, configs: list[EnvConfig], steps: int, seed: int, device: str = "cpu") -> Run:
        """Return a run at its beginning; its length is `steps` moves, rounded up to whole updates."""
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        net = recipe.network(configs).to(device)
        optimiser = torch.optim.Adam(net.parameters(), lr=recipe.rate, eps=1e-8)
        updates = -(-steps // (recipe.boards * recipe.horizon))
        run = cls(recipe, configs, seed, updates, stacks(recipe, configs, seed), net, optimiser, device)
        run.kl_share = recipe.kl_share
        return run

    @property
    def moves(self) -> int:
        """Moves played so far."""
        return self.done * self.recipe.boards * self.recipe.horizon

    @property
    def identity(self) -> dict[str, Any]:
        """What must agree for a checkpoint to go on in this run."""
        configs = [config.hash for config in self.configs]
        return {"recipe": self.recipe.to_dict(), "configs": configs, "seed": self.seed, "updates": self.updates}

    def save(self) -> dict[str, Any]:
        """Return everything that changes, as tensors, numbers and lists."""
        return {
            "done": self.done,
            "shares": [self.entropy_share, self.kl_share],
            "net": self.net.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "boards": [part.state() for part in self.boards.parts],
            "random": torch.get_rng_state(),
        }

    def load(self, kept: dict[str, Any]) -> None:
        """Return with the run as it was saved."""
        self.done = kept["done"]
        self.entropy_share, self.kl_share = kept["shares"]
        self.net.load_state_dict(kept["net"])
        self.optimiser.load_state_dict(kept["optimiser"])
        for part, state in zip(self.boards.parts, kept["boards"], strict=True):
            part.restore(state)
        torch.set_rng_state(kept["random"])


@dataclass(frozen=True)
class Report:
    """How an update went, and the episodes that ended lately (level and size of the first boards): means, NaN before the first.

    moves      played so far
    steps      moves an episode; explored: share of them, 0..1; score: return of eq. 8
    entropy    of the moves, nats; moved: mean change of their probability ratio; explained: share of the targets' variance that
               the values explain
    """

    moves: int
    steps: float
    explored: float
    returned: float
    entropy: float
    moved: float
    explained: float


def train(run: Run, tell: Callable[[Report], None]) -> nn.Module:
    """Return the network after the rest of the run's updates; `tell` hears of each and may stop the run by raising."""
    rollout = Rollout.room(run.recipe, run.boards.look())
    while run.done < run.updates:
        gone = run.done / run.updates
        recipe = run.recipe
        run.optimiser.param_groups[0]["lr"] = recipe.rate + (recipe.final_rate - recipe.rate) * gone
        after = collect(run, rollout)
        report = update(run, rollout, after)
        run.done += 1
        if recipe.curiosity is not None and run.done > recipe.value_updates:
            wanted = recipe.curiosity[0] + (recipe.curiosity[1] - recipe.curiosity[0]) * gone
            run.entropy_share = min(MOST_ENTROPY, run.entropy_share * (STEER if report["entropy"] < wanted else 1 / STEER))
        tell(told(run, report))
    return run.net.eval()


def told(run: Run, report: dict[str, float]) -> Report:
    """Return the report of an update just made."""
    recent = run.boards.parts[0].recent
    steps, explored, returned = (
        float(np.mean(each)) if each else np.nan for each in (recent.steps, recent.explored, recent.returns)
    )
    return Report(run.moves, steps, explored, returned, **report)


def think(run: Run, inputs: Inputs) -> tuple[Tensor, Tensor]:
    """Return (logits float32[boards, 4], values float32[boards]), computed in bfloat16."""
    with torch.autocast(run.device, torch.bfloat16):
        logits, values = run.net(*(each.to(run.device) for each in inputs))
    return logits.float(), values.float()


@torch.no_grad()
def collect(run: Run, into: Rollout) -> Tensor:
    """Fill a rollout with sampled moves; return the values float32[boards] of where the boards stand afterwards."""
    recipe = run.recipe
    for t in range(recipe.horizon):
        inputs = run.boards.look()
        for kept, each in zip(into.inputs, inputs, strict=True):
            kept[t] = each
        logits, values = think(run, inputs)
        logs = logits.log_softmax(1).cpu()
        into.logs[t], into.values[t] = logs, values.cpu()
        into.actions[t] = torch.multinomial(logs.exp(), 1).squeeze(1)
        steps = run.boards.step(into.actions[t].numpy())
        into.rewards[t] = torch.from_numpy(
            np.concatenate([paid(run, part, step) for part, step in zip(run.boards.parts, steps, strict=True)])
        )
        into.ended[t] = torch.from_numpy(np.concatenate([step.ended for step in steps]).astype(np.float32))
    return think(run, run.boards.look())[1].cpu()


def paid(run: Run, boards: Boards, step: Step) -> np.ndarray[Any, Any]:
    """Return rewards float32[boards] in the recipe's unit; after a time limit with what would have followed: it is no end."""
    rewards = in_moves(boards.config, step, run.recipe.pace) if run.recipe.pace else step.rewards.copy()
    if step.late is not None:
        which, inputs = step.late
        rewards[which] += run.recipe.gamma * think(run, inputs)[1].cpu().numpy()
    return rewards.astype(np.float32)


def advantages(rollout: Rollout, after: Tensor, gamma: float, lam: float) -> Tensor:
    """Return generalised advantage estimates, float32[horizon, boards] (Schulman et al. 2016, eq. 16)."""
    found, running, following = torch.zeros_like(rollout.values), torch.zeros_like(after), after
    for t in reversed(range(len(found))):
        goes_on = 1 - rollout.ended[t]
        surprise = rollout.rewards[t] + gamma * following * goes_on - rollout.values[t]
        running = surprise + gamma * lam * goes_on * running
        found[t], following = running, rollout.values[t]
    return found


def update(run: Run, rollout: Rollout, after: Tensor) -> dict[str, float]:
    """Improve the network on a rollout; return entropy, moved and explained."""
    recipe = run.recipe
    gains = advantages(rollout, after, recipe.gamma, recipe.lam).flatten()
    values = rollout.values.flatten()
    targets = gains + values
    explained = 1 - float((targets - values).var() / targets.var().clamp(min=1e-8))
    gains = (gains - gains.mean()) / (gains.std() + 1e-8)
    inputs = [each.flatten(0, 1) for each in rollout.inputs]
    actions, logs = rollout.actions.flatten(), rollout.logs.flatten(0, 1)
    sums, batches = np.zeros(3), 0
    for _ in range(recipe.epochs):
        for chosen in torch.split(torch.randperm(len(actions)), recipe.minibatch):
            batch = (tuple(each[chosen] for each in inputs), actions[chosen], logs[chosen], gains[chosen], targets[chosen])
            sums += improve(run, *batch)
            batches += 1
    entropy, moved, divergence = sums / batches
    if recipe.kl_share:
        run.kl_share *= 1.5 if divergence > 2 * recipe.kl_target else 0.5 if divergence < recipe.kl_target / 2 else 1.0
    return {"entropy": float(entropy), "moved": float(moved), "explained": explained}


def improve(
    run: Run, inputs: Inputs, actions: Tensor, before: Tensor, gains: Tensor, targets: Tensor
) -> tuple[float, float, float]:
    """Make one gradient step on a minibatch; return its entropy, mean change of the ratio and divergence.

    before   float32[batch, 4], log-probabilities of the policy that played
    """
    recipe = run.recipe
    actions, before, gains, targets = (each.to(run.device) for each in (actions, before, gains, targets))
    logits, values = think(run, inputs)
    logs = logits.log_softmax(1)
    ratio = (logs - before).gather(1, actions[:, None]).squeeze(1).exp()
    objective = torch.min(ratio * gains, ratio.clamp(1 - recipe.clip, 1 + recipe.clip) * gains).mean()
    error = (values - targets).square().clamp(max=recipe.value_clip).mean()
    entropy = -(logs.exp() * logs.clamp(min=NEVER_LOG)).sum(1).mean()
    divergence = (before.exp() * (before.clamp(min=NEVER_LOG) - logs.clamp(min=NEVER_LOG))).sum(1).mean()
    loss = recipe.value_share * error
    if run.done >= recipe.value_updates:
        loss = loss - objective
        if recipe.curiosity is not None:
            loss = loss - run.entropy_share * entropy
        if recipe.kl_share:
            loss = loss + run.kl_share * divergence
    run.optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    torch.nn.utils.clip_grad_norm_(run.net.parameters(), recipe.max_grad)
    run.optimiser.step()
    return float(entropy.detach()), float((ratio.detach() - 1).abs().mean()), float(divergence.detach())
