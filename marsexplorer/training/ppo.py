"""Proximal policy optimization, in reading order.

Schulman et al. 2017, "Proximal policy optimization algorithms":

1. `collect_rollout`: the network plays `num_steps` steps in all environments and samples every
   action from its policy.
2. `compute_advantages`: generalised advantage estimation tells how much better each action was than
   expected.
3. `update`: minibatch gradient steps on the clipped objective raise the probabilities of the better
   actions. The coefficient of the entropy is adapted so that the policy's entropy follows the
   target of the configuration, which falls.

A run begins from a freshly initialised network, without a teacher or demonstrations. The same
configuration, levels, sizes, seed and steps give the same weights on one CPU, also when the run was
interrupted and resumed.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.config import EnvConfig
from marsexplorer.training.config import TrainConfig
from marsexplorer.training.envs import (
    MixedEnvs,
    Observation,
    StepResult,
    TrainingEnvs,
    make_envs,
    rewards_in_moves,
)
from marsexplorer.training.network import mixed_precision
from marsexplorer.training.prior import rule_probabilities

ENT_COEF_FACTOR = 1.05
"""Factor by which the entropy's coefficient is adapted after an update."""
MAX_ENT_COEF = 0.5
MIN_LOG_PROB = -100.0
"""The lowest log-probability in sums of entropies and divergences: invalid actions have -1e9."""


@dataclass
class RolloutBuffer:
    """`num_steps` steps of all environments, on the CPU.

    Tensors [num_steps, num_envs, ...]:

    obs        the parts of the observation
    actions    int64[num_steps, num_envs]
    log_probs  float32[num_steps, num_envs, 4], of all actions under the policy that played
    values     float32[num_steps, num_envs], the network's estimates
    rewards    float32[num_steps, num_envs], in the unit of the configuration
    dones      float32[num_steps, num_envs], 1 where the episode ended with the step
    """

    obs: list[Tensor]
    actions: Tensor
    log_probs: Tensor
    values: Tensor
    rewards: Tensor
    dones: Tensor

    @classmethod
    def empty(cls, config: TrainConfig, sample: Observation) -> RolloutBuffer:
        """A buffer of zeros; `sample` is an observation of all environments."""
        shape = (config.num_steps, config.num_envs)
        return cls(
            obs=[torch.zeros((config.num_steps, *part.shape), dtype=part.dtype) for part in sample],
            actions=torch.zeros(shape, dtype=torch.long),
            log_probs=torch.zeros((*shape, 4)),
            values=torch.zeros(shape),
            rewards=torch.zeros(shape),
            dones=torch.zeros(shape),
        )


@dataclass
class TrainingRun:
    """A run under way, which can be saved and restored between two updates.

    num_updates     updates of the whole run; updates_done: made so far
    net             the network that learns, on `device`; player: the one that plays, on the CPU,
                    the same object if the device is the CPU
    ent_coef        coefficient of the entropy in the loss as adapted; kl_coef: of the divergence
    device          where the gradient steps are computed: "cpu" or "cuda"
    is_between_updates  whether the state is whole; it is not while an update is being made
    """

    config: TrainConfig
    env_configs: list[EnvConfig]
    seed: int
    num_updates: int
    envs: MixedEnvs
    net: nn.Module
    player: nn.Module
    optimizer: torch.optim.Optimizer
    device: str = "cpu"
    updates_done: int = 0
    ent_coef: float = 0.05
    kl_coef: float = 0.0
    is_between_updates: bool = True
    graphs: GraphedSteps | None = field(default=None, init=False, repr=False)

    @classmethod
    def begin(
        cls,
        config: TrainConfig,
        env_configs: list[EnvConfig],
        total_timesteps: int,
        seed: int,
        device: str = "cpu",
    ) -> TrainingRun:
        """A run at its beginning, of `total_timesteps` rounded up to whole updates."""
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        player = config.make_network(env_configs)
        net, adam = player, dict[str, Any](lr=config.learning_rate)
        if device == "cuda":
            net = deepcopy(player).to(device)
            rate = torch.tensor(config.learning_rate, device=device)
            adam = {"lr": rate, "capturable": True}  # which graphs need
            torch.backends.cudnn.allow_tf32 = False  # the network that plays is to say the same
        return cls(
            config=config,
            env_configs=env_configs,
            seed=seed,
            num_updates=-(-total_timesteps // config.batch_size),
            envs=make_envs(env_configs, config.num_envs, seed, config.make_encoder),
            net=net,
            player=player,
            optimizer=torch.optim.Adam(net.parameters(), eps=1e-8, fused=True, **adam),
            device=device,
            kl_coef=config.kl_coef,
        )

    @property
    def global_step(self) -> int:
        """Steps played so far, over all environments."""
        return self.updates_done * self.config.batch_size

    @property
    def identity(self) -> dict[str, Any]:
        """What a checkpoint must share with this run to go on in it."""
        hashes = [config.hash for config in self.env_configs]
        cause = {"config": self.config.to_dict(), "env_configs": hashes, "seed": self.seed}
        return {**cause, "num_updates": self.num_updates}

    def state_dict(self) -> dict[str, Any]:
        """Everything that changes, as tensors, numbers and lists."""
        return {
            "updates_done": self.updates_done,
            "ent_coef": self.ent_coef,
            "kl_coef": self.kl_coef,
            "net": self.net.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "envs": [part.state_dict() for part in self.envs.parts],
            "rng_state": torch.get_rng_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` returned, with the state of torch's random numbers."""
        self.updates_done = state["updates_done"]
        self.ent_coef, self.kl_coef = state["ent_coef"], state["kl_coef"]
        self.net.load_state_dict(state["net"])
        self.player.load_state_dict(state["net"])
        stored, param_groups = state["optimizer"], self.optimizer.param_groups
        here = [
            {name: group[name] for name in ("lr", "fused", "capturable")} for group in param_groups
        ]
        groups = [old | new for old, new in zip(stored["param_groups"], here, strict=True)]
        self.optimizer.load_state_dict({**stored, "param_groups": groups})
        self.graphs = None  # those that there were have the optimiser's numbers before
        for part, part_state in zip(self.envs.parts, state["envs"], strict=True):
            part.load_state_dict(part_state)
        torch.set_rng_state(state["rng_state"])


@dataclass(frozen=True)
class UpdateMetrics:
    """The metrics of an update, and means over the last episodes.

    The episodes are those of the first environments; NaN before the first has ended.

    global_step         steps played so far
    episode_steps       moves of an episode
    explored            share of the episodes that discovered the target, 0..1
    episode_return      return of eq. 8
    entropy             of the policy, nats
    ratio_change        mean absolute change of the probability ratio
    explained_variance  share of the returns' variance that the values explain, at most 1
    """

    global_step: int
    episode_steps: float
    explored: float
    episode_return: float
    entropy: float
    ratio_change: float
    explained_variance: float


def train(run: TrainingRun, on_update: Callable[[UpdateMetrics], None]) -> nn.Module:
    """Make the rest of the run's updates and return the network.

    `on_update` is called after each update and may raise to stop. KeyboardInterrupt comes between
    two updates; only a second Ctrl-C leaves the run in the middle of one.
    """
    buffer = RolloutBuffer.empty(run.config, run.envs.observe())
    while run.updates_done < run.num_updates:
        with postponed_interrupt():
            metrics = make_update(run, buffer)
            on_update(UpdateMetrics(run.global_step, **episode_means(run), **metrics))
    return run.player.eval()


@contextmanager
def postponed_interrupt() -> Iterator[None]:
    """Let a Ctrl-C in the block wait for its end and raise KeyboardInterrupt there.

    A second one does not wait. SIGTERM does the same if it is handled like Ctrl-C. If neither is,
    and outside of the main thread, where they never arrive, the block runs as it is.
    """
    both = (signal.SIGINT, signal.SIGTERM)
    ours = [number for number in both if signal.getsignal(number) is signal.default_int_handler]
    if not ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []

    def wait(number: int, frame: FrameType | None) -> None:
        if waiting:
            signal.default_int_handler(number, frame)
        waiting.append(number)

    for number in ours:
        signal.signal(number, wait)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.default_int_handler)
    if waiting:
        raise KeyboardInterrupt


def make_update(run: TrainingRun, buffer: RolloutBuffer) -> dict[str, float]:
    """Play one rollout into the buffer and learn from it; return the metrics.

    entropy, ratio_change and explained_variance
    """
    config = run.config
    run.is_between_updates = False
    progress = run.updates_done / run.num_updates
    rate = between(config.learning_rate, config.final_learning_rate, progress)
    (group,) = run.optimizer.param_groups
    if isinstance(group["lr"], Tensor):
        group["lr"].fill_(rate)  # graphs read it where it is
    else:
        group["lr"] = rate
    next_values = collect_rollout(run, buffer)
    advantages = compute_advantages(buffer, next_values, config.gamma, config.gae_lambda)
    metrics = update(run, buffer, advantages)
    run.updates_done += 1
    if config.target_entropy is not None and run.updates_done > config.value_warmup_updates:
        is_low = metrics["entropy"] < between(*config.target_entropy, progress)
        factor = ENT_COEF_FACTOR if is_low else 1 / ENT_COEF_FACTOR
        run.ent_coef = min(MAX_ENT_COEF, run.ent_coef * factor)
    run.is_between_updates = True
    return metrics


def between(first: float, last: float, share: float) -> float:
    """The number `share` (0..1) of the way from the first to the last."""
    return first + (last - first) * share


def forward(run: TrainingRun, obs: Observation) -> tuple[Tensor, Tensor]:
    """(logits float32[num_envs, 4], values float32[num_envs]) of the playing network."""
    with mixed_precision(run.device):
        logits, values = run.player(*obs)
    return logits.float(), values.float()


@torch.inference_mode()
def collect_rollout(run: TrainingRun, buffer: RolloutBuffer) -> Tensor:
    """Fill the buffer with sampled steps; return the values of the next observation.

    float32[num_envs]
    """
    has_critic = run.config.has_critic
    player: Any = run.player
    for t in range(run.config.num_steps):
        obs = run.envs.observe()
        for stored, part in zip(buffer.obs, obs, strict=True):
            stored[t] = part
        if has_critic:
            with mixed_precision(run.device):
                logits = player.logits(*obs).float()
        else:
            logits, buffer.values[t] = forward(run, obs)
        log_probs = buffer.log_probs[t] = logits.log_softmax(1)
        buffer.actions[t] = torch.multinomial(log_probs.exp(), 1).squeeze(1)
        steps = run.envs.step(buffer.actions[t].numpy())
        parts = zip(run.envs.parts, steps, strict=True)
        rewards = [compute_rewards(run, envs, step) for envs, step in parts]
        buffer.rewards[t] = torch.from_numpy(np.concatenate(rewards))
        dones = np.concatenate([step.dones for step in steps]).astype(np.float32)
        buffer.dones[t] = torch.from_numpy(dones)
    last = run.envs.observe()
    if not has_critic:
        return forward(run, last)[1]
    learner: Any = run.net
    every = [torch.cat([*steps, part]) for steps, part in zip(buffer.obs, last, strict=True)]
    with mixed_precision(run.device):
        values: Tensor = learner.value(*(part.to(run.device) for part in every)).float().cpu()
    buffer.values[:] = values[: -run.envs.num_envs].view_as(buffer.values)
    return values[-run.envs.num_envs :]


def compute_rewards(run: TrainingRun, envs: TrainingEnvs, step: StepResult) -> NDArray[np.float32]:
    """Rewards float32[num_envs] in the unit of the configuration.

    Without the bonus they are those of the levels t-m-2: nothing is paid where an episode ends, by
    success or by failure. Where an episode was truncated, the discounted value of its last
    observation is added: a time limit is no terminal state.
    """
    config = run.config
    if config.reward_per_cell:
        rewards = rewards_in_moves(envs.config, step, config.reward_per_cell)
        if not config.has_bonus:
            rewards[step.failed] = -1.0
    else:
        rewards = step.rewards.copy()
        if not config.has_bonus:
            rewards[step.explored] -= envs.config.r_bonus
            rewards[step.failed] = 0.0
    if step.final_obs is not None:
        rewards[step.truncated] += run.config.gamma * forward(run, step.final_obs)[1].numpy()
    return rewards.astype(np.float32)


def compute_advantages(
    buffer: RolloutBuffer, next_values: Tensor, gamma: float, gae_lambda: float
) -> Tensor:
    """Generalised advantage estimates, float32[num_steps, num_envs].

    Schulman et al. 2016, eq. 16

    next_values   float32[num_envs], of the observation after the last step
    """
    advantages = torch.zeros_like(buffer.values)
    last_advantage = torch.zeros_like(next_values)
    for t in reversed(range(len(advantages))):
        next_nonterminal = 1 - buffer.dones[t]
        delta = buffer.rewards[t] + gamma * next_values * next_nonterminal - buffer.values[t]
        last_advantage = delta + gamma * gae_lambda * next_nonterminal * last_advantage
        advantages[t], next_values = last_advantage, buffer.values[t]
    return advantages


@dataclass(frozen=True)
class Minibatch:
    """Some steps of a rollout: tensors [batch, ...].

    log_probs  float32[batch, 4], under the policy that played
    """

    obs: Observation
    actions: Tensor
    log_probs: Tensor
    values: Tensor
    advantages: Tensor
    returns: Tensor

    @property
    def tensors(self) -> list[Tensor]:
        """All tensors, those of the observation first."""
        obs, *columns = vars(self).values()
        return [*obs, *columns]

    def map(self, change: Callable[[Tensor], Tensor]) -> Minibatch:
        """The minibatch with `change` applied to each tensor."""
        changed = [change(tensor) for tensor in self.tensors]
        count = len(self.obs)
        return Minibatch(tuple(changed[:count]), *changed[count:])


def update(run: TrainingRun, buffer: RolloutBuffer, advantages: Tensor) -> dict[str, float]:
    """Improve the network on a rollout; return the metrics.

    entropy, ratio_change and explained_variance
    """
    config = run.config
    advantages, values = advantages.flatten(), buffer.values.flatten()
    returns = advantages + values
    explained_variance = 1 - float((returns - values).var() / returns.var().clamp(min=1e-8))
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    obs = tuple(part.flatten(0, 1) for part in buffer.obs)
    actions, log_probs = buffer.actions.flatten(), buffer.log_probs.flatten(0, 1)
    rollout = Minibatch(obs, actions, log_probs, values, advantages, returns)

    def step(indices: Tensor) -> Tensor:
        minibatch = rollout.map(lambda column: column[indices])
        return gradient_step(run, minibatch, run.ent_coef, run.kl_coef)

    if run.device != "cpu":
        run.graphs = run.graphs or GraphedSteps(run, rollout)
        run.graphs.load(rollout)
        step = run.graphs.step
    orders = (torch.randperm(len(actions)).to(run.device) for _ in range(config.update_epochs))
    step_metrics = [
        step(indices) for order in orders for indices in torch.split(order, config.minibatch_size)
    ]
    if run.player is not run.net:
        run.player.load_state_dict(run.net.state_dict())
    passes = torch.stack(step_metrics).double().cpu().numpy()
    entropy, ratio_change, kl = np.mean(passes, axis=0)
    if config.kl_coef:
        if config.kl_of_last_epoch:
            kl = np.mean(passes[-(len(passes) // config.update_epochs) :], axis=0)[2]
        if kl > 2 * config.kl_target:
            run.kl_coef *= 1.5
        elif kl < config.kl_target / 2:
            run.kl_coef *= 0.5
    means = {"entropy": float(entropy), "ratio_change": float(ratio_change)}
    return means | {"explained_variance": explained_variance}


def gradient_step(
    run: TrainingRun, minibatch: Minibatch, ent_coef: float | Tensor, kl_coef: float | Tensor
) -> Tensor:
    """Make one gradient step on a minibatch, in bfloat16 where that is fast.

    Returns:
        float32[3]: its entropy, mean absolute change of the ratio and divergence.
    """
    config, advantages, old_log_probs = run.config, minibatch.advantages, minibatch.log_probs
    with mixed_precision(run.device):
        logits, values = run.net(*minibatch.obs)
    log_probs, values = logits.float().log_softmax(1), values.float()
    ratio = (log_probs - old_log_probs).gather(1, minibatch.actions[:, None]).squeeze(1).exp()
    clipped_ratio = ratio.clamp(1 - config.clip_coef, 1 + config.clip_coef)
    policy_objective = torch.min(ratio * advantages, clipped_ratio * advantages).mean()
    value_loss = value_errors(config, values, minibatch).mean()
    entropy = -(log_probs.exp() * log_probs.clamp(min=MIN_LOG_PROB)).sum(1).mean()
    fallen = old_log_probs.clamp(min=MIN_LOG_PROB) - log_probs.clamp(min=MIN_LOG_PROB)
    kl = (old_log_probs.exp() * fallen).sum(1).mean()
    loss = config.vf_coef * value_loss
    if run.updates_done >= config.value_warmup_updates:
        loss = loss - policy_objective
        if config.target_entropy is not None:
            loss = loss - ent_coef * entropy
        if config.kl_coef:
            loss = loss + kl_coef * kl
        if any(config.rule_coef):
            loss = loss + rule_divergence(config, minibatch.obs[1], log_probs)
    run.optimizer.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    if config.max_grad_norm < float("inf"):
        torch.nn.utils.clip_grad_norm_(run.net.parameters(), config.max_grad_norm)
    run.optimizer.step()
    return torch.stack([entropy, (ratio - 1).abs().mean(), kl]).detach()


UNGRAPHED_STEPS = 3
"""Calls before one is made a graph: libraries prepare in them what a graph cannot hold."""


class GraphedFunction:
    """A function of tensors on a CUDA device, which repeats its work as one graph.

    A gradient step is some hundred kernels of a few microseconds each, and to start them one by one
    takes far longer than they run. If the function draws random numbers, each call draws new ones.

    function  of tensors of the same shapes in each call; all else that it reads or writes stays in
              its place on the device
    """

    def __init__(self, function: Callable[..., Tensor]) -> None:
        if torch.cuda.current_stream() == torch.cuda.default_stream():  # which cannot be captured
            torch.cuda.synchronize()
            torch.cuda.set_stream(torch.cuda.Stream())  # type: ignore[no-untyped-call]
        self._function, self._calls = function, 0
        self._graph: tuple[torch.cuda.CUDAGraph, list[Tensor], Tensor] | None = None

    def __call__(self, *inputs: Tensor) -> Tensor:
        """Apply the function to these tensors, which may be on the CPU."""
        if self._graph is None:
            places = [tensor.to("cuda", copy=True) for tensor in inputs]
            self._calls += 1
            if self._calls <= UNGRAPHED_STEPS:
                return self._function(*places)
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph, stream=torch.cuda.current_stream()):
                output = self._function(*places)
            self._graph = graph, places, output
        graph, places, output = self._graph
        for place, tensor in zip(places, inputs, strict=True):
            place.copy_(tensor)
        graph.replay()
        return output.clone()


class GraphedSteps:
    """Gradient steps of a run on a CUDA device, a graph for each kind of them.

    With `rule_coef` their kernels are started one by one, since the CPU computes the rules.
    """

    def __init__(self, run: TrainingRun, rollout: Minibatch) -> None:
        self._run, self._rollout = run, rollout.map(lambda column: column.to(run.device))
        self._coefs = torch.zeros(2, device=run.device)
        self._graphs: dict[tuple[int, bool], GraphedFunction] = {}

    def load(self, rollout: Minibatch) -> None:
        """Copy a rollout and the coefficients to where the graphs read them."""
        for place, part in zip(self._rollout.tensors, rollout.tensors, strict=True):
            place.copy_(part)
        self._coefs.copy_(torch.tensor([self._run.ent_coef, self._run.kl_coef]))

    def step(self, indices: Tensor) -> Tensor:
        """Make the gradient step of `gradient_step` on the moves of these indices."""
        config = self._run.config
        if any(config.rule_coef):
            return self._step(indices)
        kind = (len(indices), self._run.updates_done >= config.value_warmup_updates)
        if kind not in self._graphs:
            self._graphs[kind] = GraphedFunction(self._step)
        return self._graphs[kind](indices)

    def _step(self, indices: Tensor) -> Tensor:
        return gradient_step(
            self._run, self._rollout.map(lambda column: column[indices]), *self._coefs
        )


def rule_divergence(config: TrainConfig, moves: Tensor, log_probs: Tensor) -> Tensor:
    """The policy's mean cross-entropy to its initial rules, weighted by grid size.

    moves, log_probs  float32[batch, 4, numbers of a move], float32[batch, 4] of a minibatch
    """
    rules, nearness = rule_probabilities(moves, config.prior_scale)
    coef = (nearness * torch.tensor(config.rule_coef, device=moves.device)).sum(1)
    return -(coef * (rules * log_probs.clamp(min=MIN_LOG_PROB)).sum(1)).mean()


def value_errors(config: TrainConfig, values: Tensor, minibatch: Minibatch) -> Tensor:
    """The squared errors of values as the loss counts them, both float32[batch].

    With `vf_change_clip` they are those of RLlib 1.0.1 (ppo_tf_policy.py, PPOLoss): a value that
    has moved too far since the rollout has no gradient, unless it has moved away from the return.
    """
    errors = (values - minibatch.returns).square()
    if config.vf_change_clip < float("inf"):
        change = (values - minibatch.values).clamp(-config.vf_change_clip, config.vf_change_clip)
        errors = torch.max(errors, (minibatch.values + change - minibatch.returns).square())
    return errors.clamp(max=config.vf_clip)


def episode_means(run: TrainingRun) -> dict[str, float]:
    """Means over the last episodes of the first environments, NaN if there are none."""
    recent = run.envs.parts[0].recent
    columns = (recent.steps, recent.explored, recent.returns)
    means = (float(np.mean(column)) if column else float("nan") for column in columns)
    return dict(zip(("episode_steps", "explored", "episode_return"), means, strict=True))
