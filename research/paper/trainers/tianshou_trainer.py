"""What is trained through tianshou: its environments and networks, and A2C.

A2C stands in the place of A3C: the same loss from the same moves, but all environments step together and no gradient is stale.
A3C's workers compute their gradients with weights that others have changed meanwhile (Mnih et al. 2016). A2C waits for all and
makes one step with the mean, so a run is reproducible, and what it learns does not depend on how busy the machine is.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.algorithm import A2C, Algorithm, algorithm_base
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import TorchOptimizerFactory
from tianshou.data import Batch, VectorReplayBuffer
from tianshou.data.buffer import manager
from tianshou.data.utils import segtree
from torch import Tensor, nn
from torch.distributions import Categorical

from marsexplorer.config import EnvConfig
from research.paper.networks import CategoricalNetwork, PaperNetwork, PolicyNetwork, QNetwork
from research.paper.onnx_agents import save_agent
from research.paper.trainers.environments import Environments, ObservationBytes, Rewards, add
from research.paper.trainers.settings import A2C_VARIANTS, A2CSettings, Common

FUNCTIONS = (
    algorithm_base._gae,
    algorithm_base._nstep_return,
    manager._prev_index,
    manager._next_index,
    segtree._setitem,
    segtree._reduce,
    segtree._get_prefix_sum_idx,
)


def cache_kernels() -> None:
    """Have numba keep what it compiles of tianshou's functions; call it before the first of them runs."""
    for function in FUNCTIONS:
        if not function.signatures:
            function.enable_caching()


class _Reads(nn.Module):
    """A network and how its observations are read."""

    def __init__(self, net: nn.Module, form: ObservationBytes) -> None:
        super().__init__()
        self.net, self._form = net, form

    def _ask(self, function: Any, obs: NDArray[np.uint8]) -> Tensor:
        found: Tensor = function(*self._form.unpack(obs))
        return found


class Actor(_Reads):
    """The logits float32[num, 4] of a network."""

    net: PolicyNetwork

    def forward(
        self, obs: NDArray[np.uint8], state: Any = None, info: Any = None
    ) -> tuple[Tensor, Any]:
        return self._ask(self.net.logits, obs), state


class ValueCritic(_Reads):
    """The value float32[num] of a network."""

    net: PolicyNetwork

    def forward(self, obs: NDArray[np.uint8], state: Any = None, info: Any = None) -> Tensor:
        return self._ask(self.net.value, obs)


class QCritic(_Reads):
    """The values float32[num, 4] of the moves."""

    net: QNetwork

    def forward(self, obs: NDArray[np.uint8], state: Any = None, info: Any = None) -> Tensor:
        return self._ask(self.net, obs)


class Distributions(_Reads):
    """The distributions float32[num, 4, atoms] of the moves' returns."""

    net: CategoricalNetwork

    def forward(
        self, obs: NDArray[np.uint8], state: Any = None, info: Any = None
    ) -> tuple[Tensor, Any]:
        return self._ask(self.net, obs), state

    def best(self, obs: NDArray[np.uint8], distributions: Tensor) -> NDArray[np.int64]:
        """Return the move of the highest expected return of each, int64[num], never an invalid one where the network masks."""
        expected = (distributions * self.net.support).sum(2)
        best: NDArray[np.int64] = (
            self.net.fill_invalid(expected, self._form.unpack(obs)).argmax(1).numpy()
        )
        return best


MOVES = gymnasium.spaces.Discrete(4)
"""What tianshou asks of the actions."""


class TianshouTrainer:
    """Half an `algorithms.Trainer`: what is left is to build the networks in `__init__`, and `advance`.

    algorithm  tianshou's, always in training mode
    """

    algorithm: Algorithm[Any, Any]
    net: PaperNetwork

    def __init__(
        self, settings: dict[str, Any], common: Common, config: EnvConfig, seed: int
    ) -> None:
        cache_kernels()
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        np.random.seed(seed)  # tianshou draws from both global generators
        self.settings, self.moves = settings, 0
        self.form = ObservationBytes.of(config, common.network == "features")
        rewards = Rewards(common.reward_per_cell, common.has_bonus)
        self.environments = Environments(config, common.num_envs, seed, self.form, rewards)
        self.envs = self.environments.envs

    def begin(self, algorithm: Algorithm[Any, Any], net: PaperNetwork) -> None:
        """Take the algorithm, and the network that the policy file has."""
        self.algorithm, self.net = algorithm, net
        algorithm.train()
        vars(algorithm)["train"] = lambda mode=True: (
            algorithm
        )  # tianshou would visit every module twice a gradient step
        algorithm.policy.is_within_training_step = True

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the policy with a card."""
        save_agent(self.net, path, card)


def adam(learning_rate: float) -> Any:
    """Return what makes tianshou's optimisers: Adam, all tensors in one call."""
    return TorchOptimizerFactory(torch.optim.Adam, lr=learning_rate, fused=True)


ROUND = 2000
"""Moves of a round, at least."""


class A2CTrainer(TianshouTrainer):
    """Train by A2C; a round is some updates, of `num_steps` moves of every environment each."""

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        del moves
        own = A2CSettings(**A2C_VARIANTS.settings_for(variant))
        super().__init__({**asdict(own), "batch_size": own.batch_size}, own, config, seed)
        self._own = own
        net = PolicyNetwork(own.shape(config, "policy", critic="shared"))
        actor = Actor(net, self.form)
        policy = ProbabilisticActorPolicy(
            actor=actor,
            dist_fn=categorical,
            action_space=MOVES,
            deterministic_eval=False,
            action_scaling=False,
        )
        algorithm = A2C(
            policy=policy,
            critic=ValueCritic(net, self.form),
            optim=adam(own.learning_rate),
            vf_coef=own.vf_coef / 2,
            ent_coef=own.ent_coef,
            max_grad_norm=own.max_grad_norm / own.batch_size,
            gae_lambda=own.gae_lambda,
            max_batchsize=own.batch_size,
            gamma=own.gamma,
        )
        self.begin(algorithm, net)
        self._buffer = VectorReplayBuffer(own.batch_size, own.num_envs)

    def advance(self) -> dict[str, float]:
        """Make some updates; return the means of their losses and of the entropy."""
        numbers: list[tuple[float, float, float]] = []
        end = self.moves + ROUND
        while self.moves < end:
            self._collect()
            stats = self.algorithm.update(self._buffer, batch_size=None, repeat=1)
            numbers.append((stats.actor_loss.mean, stats.vf_loss.mean, stats.ent_loss.mean))
            self.moves += self._own.batch_size
        means = np.mean(numbers, axis=0)
        return dict(zip(("policy_loss", "value_loss", "entropy"), map(float, means), strict=True))

    def _collect(self) -> None:
        """Fill the buffer with new moves; it is emptied first."""
        self._buffer.reset()
        for _ in range(self._own.num_steps):
            with torch.no_grad():
                actions = self.algorithm.policy(
                    Batch(obs=self.environments.obs, info=Batch())
                ).act.numpy()
            add(self._buffer, self.environments.step(actions))


def categorical(logits: Tensor) -> Categorical:
    """Return the distribution over the moves with these logits."""
    return Categorical(logits=logits, validate_args=False)
