"""Discrete soft actor-critic (Haarnoja et al. 2018; for discrete actions Christodoulou 2019), with two critics."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.algorithm import DiscreteSAC
from tianshou.algorithm.modelfree.discrete_sac import DiscreteSACPolicy
from tianshou.algorithm.modelfree.sac import AutoAlpha
from tianshou.data import Batch

from marsexplorer.config import EnvConfig
from marsexplorer.paper.off_policy import OffPolicy, OffPolicyTrainer
from marsexplorer.paper.tianshou_networks import Actor, QCritic
from marsexplorer.paper.tianshou_trainer import MOVES, adam
from marsexplorer.paper.variants import Variants
from marsexplorer.policies.network.paper_network import PolicyNetwork, QNetwork


@dataclass(frozen=True)
class SACSettings(OffPolicy):
    """The appendix's table 4, and RLlib 1.0.1's defaults where it says nothing (rllib/agents/sac).

    moves_per_update  RLlib makes a gradient step for each move of every worker; the authors' runner has 8 workers
    tau               share of the critics that their targets take over at a gradient step
    initial_alpha     weight of the entropy at first; it is adapted to `target_entropy`
    target_entropy    share of the entropy of equal probabilities, log 4 (RLlib's "auto" is 0.98 of it)
    """

    buffer_size: int = 1_000_000
    batch_size: int = 256
    moves_per_update: int = 8
    learning_starts: int = 1500
    learning_rate: float = 3e-4
    tau: float = 5e-3
    twin_q: bool = True
    initial_alpha: float = 1.0
    target_entropy: float = 0.98


VARIANTS = Variants(
    "SAC",
    {
        "reward": {"reward_per_cell": 0.18, "has_bonus": False},
        "mask": {"mask": True},
        "discount": {"gamma": 0.99},
        "features": {"network": "features"},
        "entropy": {"target_entropy": 0.1, "initial_alpha": 0.2},
        "batch": {"batch_size": 128, "moves_per_update": 16, "buffer_size": 100_000},
    },
    works=("reward", "mask", "discount", "features", "entropy", "batch"),
)


class SACTrainer(OffPolicyTrainer):
    """Train by discrete SAC."""

    net: PolicyNetwork

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        own = SACSettings(**VARIANTS.settings_for(variant))
        super().__init__(asdict(own), own, config, seed, moves)
        net = PolicyNetwork(own.shape(config, "policy"))
        critics = [QCritic(QNetwork(own.shape(config, "q")), self.form, own.light) for _ in range(2)]
        self._alpha = AutoAlpha(
            own.target_entropy * float(np.log(4)), float(np.log(own.initial_alpha)), adam(own.learning_rate)
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
            actions: NDArray[np.int64] = self.algorithm.policy(Batch(obs=self.environments.obs, info=Batch())).act.numpy()
        return actions

    def numbers(self, stats: Any) -> dict[str, float]:
        """Return losses and the weight of the entropy after a gradient step."""
        return {"policy_loss": stats.actor_loss, "value_loss": stats.critic1_loss, "alpha": stats.alpha}

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes, the optimiser of the entropy's weight included, which tianshou leaves out."""
        return {**super().state_dict(), "alpha_optimizer": self._alpha._optim.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        super().load_state_dict(state)
        self._alpha._optim.load_state_dict(state["alpha_optimizer"])
