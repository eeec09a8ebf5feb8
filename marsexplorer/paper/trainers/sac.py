"""Discrete soft actor-critic (Haarnoja et al. 2018; for discrete actions Christodoulou 2019), with two critics."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.algorithm import DiscreteSAC
from tianshou.algorithm.modelfree.discrete_sac import DiscreteSACPolicy
from tianshou.algorithm.modelfree.sac import AutoAlpha
from tianshou.data import Batch

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.off_policy import OffPolicyTrainer
from marsexplorer.paper.trainers.tianshou_networks import Actor, QCritic
from marsexplorer.paper.trainers.tianshou_settings import SAC_VARIANTS, SACSettings
from marsexplorer.paper.trainers.tianshou_trainer import MOVES, adam
from marsexplorer.policies.network.paper_network import PolicyNetwork, QNetwork


class SACTrainer(OffPolicyTrainer):
    """Train by discrete SAC."""

    net: PolicyNetwork

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        own = SACSettings(**SAC_VARIANTS.settings_for(variant))
        super().__init__(asdict(own), own, config, seed, moves)
        net = PolicyNetwork(own.shape(config, "policy", hidden=own.policy_hidden))
        critics = [
            QCritic(QNetwork(own.shape(config, "q", hidden=own.q_hidden)), self.form, own.light)
            for _ in range(2)
        ]
        self._alpha = AutoAlpha(
            own.target_entropy * float(np.log(4)),
            float(np.log(own.initial_alpha)),
            adam(own.learning_rate),
        )
        optimizer = adam(own.learning_rate)
        algorithm = DiscreteSAC(
            policy=DiscreteSACPolicy(actor=Actor(net, self.form, own.light), action_space=MOVES),
            policy_optim=optimizer,
            critic=critics[0],
            critic_optim=optimizer,
            critic2=critics[1],
            critic2_optim=optimizer,
            tau=own.tau,
            gamma=own.gamma,
            alpha=self._alpha,
            n_step_return_horizon=own.n_step,
        )
        self.begin(algorithm, net)

    def act(self) -> NDArray[np.int64]:
        """Return moves drawn from the policy."""
        with torch.no_grad():
            actions: NDArray[np.int64] = self.algorithm.policy(
                Batch(obs=self.environments.obs, info=Batch())
            ).act.numpy()
        return actions

    def numbers(self, stats: Any) -> dict[str, float]:
        """Return losses and the weight of the entropy after a gradient step."""
        return {
            "policy_loss": stats.actor_loss,
            "value_loss": stats.critic1_loss,
            "alpha": stats.alpha,
        }

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes, the optimiser of the entropy's weight included, which tianshou leaves out."""
        return {**super().state_dict(), "alpha_optimizer": self._alpha._optim.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        super().load_state_dict(state)
        self._alpha._optim.load_state_dict(state["alpha_optimizer"])
