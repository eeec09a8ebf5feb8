"""DQN-Rainbow (Hessel et al. 2018) with all of its six parts.

    1. double Q                 the network chooses the move whose value the target network gives (`_target_dist` of tianshou)
    2. dueling network          a stream for the board and one for the moves (`CategoricalNetwork`)
    3. prioritized replay       by the loss of a move (`replay`)
    4. n-step returns           `n_step`
    5. distribution of returns  `num_atoms` over `support` (C51)
    6. noisy network            in place of epsilon; its noise is drawn anew for every gradient step and for every move too

The paper's appendix names 1, 2, 3 and 6, and lets an epsilon fall besides. RLlib 1.0.1 has one step and one atom by default,
which is DQN without the parts 4 and 5; a Rainbow has them, so these are Hessel's: three steps and 51 atoms.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.algorithm import RainbowDQN
from tianshou.algorithm.modelfree.c51 import C51Policy
from tianshou.data import Batch, ReplayBuffer
from torch import nn

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.off_policy import OffPolicyTrainer
from marsexplorer.paper.trainers.tianshou_networks import Distributions
from marsexplorer.paper.trainers.tianshou_settings import RAINBOW_VARIANTS, RainbowSettings
from marsexplorer.paper.trainers.tianshou_trainer import MOVES, adam
from marsexplorer.policies.network.noisy import sample_noise
from marsexplorer.policies.network.paper_network import CategoricalNetwork, make_network
from marsexplorer.policies.network.trunks import invalid_moves


class RainbowTrainer(OffPolicyTrainer):
    """Train by Rainbow."""

    net: CategoricalNetwork

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        own = RainbowSettings(**RAINBOW_VARIANTS.settings_for(variant))
        support = own.support or (-config.n - 20.0, config.n + 20.0)
        super().__init__({**asdict(own), "support": list(support)}, own, config, seed, moves)
        self._own = own
        shape = own.shape(config, "categorical", atoms=own.num_atoms, support=support)
        net = make_network(shape, own.noisy_sigma)
        assert isinstance(net, CategoricalNetwork)
        policy = BestOfDistributions(
            model=Distributions(net, self.form, own.light),
            action_space=MOVES,
            num_atoms=own.num_atoms,
            v_min=support[0],
            v_max=support[1],
        )
        self.begin(NStepRainbow(policy, own), net)

    def act(self) -> NDArray[np.int64]:
        """Return the best moves by the network with new noise, and some at random."""
        first, last = self._own.epsilon
        policy, obs = self.algorithm.policy, self.environments.obs
        policy.set_eps_training(
            first + (last - first) * min(1.0, self.moves / self._own.epsilon_moves)
        )
        sample_noise(self.net)
        with torch.no_grad():
            actions = policy(Batch(obs=obs)).act
            is_valid = (
                ~invalid_moves(self.form.unpack(obs)).numpy()
                if self._own.mask
                else np.ones((len(obs), 4))
            )
        tried: NDArray[np.int64] = policy.add_exploration_noise(
            actions, Batch(obs=Batch(mask=is_valid))
        )
        return tried

    def numbers(self, stats: Any) -> dict[str, float]:
        """Return the loss of a gradient step."""
        return {"loss": stats.loss}

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes, the gradient steps that tianshou counts for its target network included."""
        return {**super().state_dict(), "gradient_steps": self.algorithm._iter}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        super().load_state_dict(state)
        self.algorithm._iter = state["gradient_steps"]


class BestOfDistributions(C51Policy):
    """tianshou's policy of C51 without its detours, and with the network's own mask."""

    def forward(self, batch: Batch, state: Any = None, model: nn.Module | None = None) -> Batch:
        """Return `logits`, the distributions, as tianshou calls them, and `act`, the best moves."""
        asked: Any = self.model if model is None else model
        distributions, _ = asked(batch.obs)
        found = Batch()
        found.__dict__.update(
            logits=distributions, act=asked.best(batch.obs, distributions), state=None
        )
        return found


class NStepRainbow(RainbowDQN):
    """tianshou's Rainbow with our noisy layers, a clipped gradient, and one thing mended.

    tianshou 2.0.1 adds n rewards but takes the distribution of the observation after one move, where it belongs after n.
    """

    def __init__(self, policy: BestOfDistributions, own: RainbowSettings) -> None:
        self._max_grad_norm = own.max_grad_norm
        super().__init__(
            policy=policy,
            optim=adam(own.learning_rate),
            gamma=own.gamma,
            n_step_return_horizon=own.n_step,
            target_update_freq=max(1, own.target_update_freq // own.moves_per_update),
        )

    def _create_policy_optimizer(self, optim: Any) -> Any:
        return self._create_optimizer(self.policy, optim, max_grad_norm=self._max_grad_norm)

    @staticmethod
    def _sample_noise(model: nn.Module) -> bool:
        return sample_noise(model)

    def _preprocess_batch(
        self, batch: Any, buffer: ReplayBuffer, indices: NDArray[np.int64]
    ) -> Any:
        batch = super()._preprocess_batch(batch, buffer, indices)
        last = indices
        for _ in range(self.n_step - 1):
            last = buffer.next(last)
        batch.obs_next = buffer.get(last, "obs_next")
        return batch
