"""What the three trainers share: their environments, tianshou's algorithm, and the state of a checkpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import torch
from tianshou.algorithm import Algorithm

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.generators import (
    generators_state,
    load_generators_state,
    seed_generators,
)
from marsexplorer.paper.trainers.observation_bytes import ObservationBytes
from marsexplorer.paper.trainers.tianshou_envs import Environments, Rewards
from marsexplorer.paper.trainers.tianshou_kernels import cache_kernels
from marsexplorer.paper.trainers.tianshou_settings import Common
from marsexplorer.policies.network.paper_network import PaperNetwork
from marsexplorer.policies.network.paper_policy import save_paper_network

MOVES = gymnasium.spaces.Discrete(4)
"""What tianshou asks of the actions."""


class TianshouTrainer:
    """Half a `trainer.Trainer`: what is left is to build the networks in `__init__`, and `advance`.

    algorithm  tianshou's, always in training mode
    """

    algorithm: Algorithm[Any, Any]
    net: PaperNetwork

    def __init__(
        self, settings: dict[str, Any], common: Common, config: EnvConfig, seed: int
    ) -> None:
        cache_kernels()
        torch.set_num_threads(1)
        seed_generators(seed)
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

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes."""
        return {
            "moves": self.moves,
            "generators": generators_state(),
            "environments": self.environments.state_dict(),
            "algorithm": dict(self.algorithm.state_dict()),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        self.moves = state["moves"]
        self.environments.load_state_dict(state["environments"])
        self.algorithm.load_state_dict(
            dict(state["algorithm"])
        )  # tianshou takes the optimisers out of it
        load_generators_state(state["generators"])

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the policy with a card."""
        save_paper_network(self.net, self.net.shape, path, card)


def adam(learning_rate: float) -> Any:
    """Return what makes tianshou's optimisers: Adam, all tensors in one call."""
    from tianshou.algorithm.optim import TorchOptimizerFactory

    return TorchOptimizerFactory(torch.optim.Adam, lr=learning_rate, fused=True)
