"""A2C in the place of A3C: the same loss from the same moves, but all environments step together and no gradient is stale.

A3C's workers compute their gradients with weights that others have changed meanwhile (Mnih et al. 2016). A2C waits for all and
makes one step with the mean, so a run is reproducible, and what it learns does not depend on how busy the machine is.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import torch
from tianshou.algorithm import A2C
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.data import Batch, VectorReplayBuffer
from torch import Tensor
from torch.distributions import Categorical

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.replay import add
from marsexplorer.paper.trainers.tianshou_networks import Actor, ValueCritic
from marsexplorer.paper.trainers.tianshou_settings import A2C_VARIANTS, A2CSettings
from marsexplorer.paper.trainers.tianshou_trainer import MOVES, TianshouTrainer, adam
from marsexplorer.policies.network.paper_network import PolicyNetwork

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
        actor = Actor(net, self.form, own.light)
        policy = ProbabilisticActorPolicy(
            actor=actor,
            dist_fn=categorical,
            action_space=MOVES,
            deterministic_eval=False,
            action_scaling=False,
        )
        algorithm = A2C(
            policy=policy,
            critic=ValueCritic(net, self.form, own.light),
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
