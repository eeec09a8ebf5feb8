"""Training configurations: `best`, which explores best from the observation, and `paper`, what the paper did."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from torch import nn

from marsexplorer.config import EnvConfig
from marsexplorer.policies.files.formats import NETWORK_FORMAT, PAPER_FORMAT
from marsexplorer.policies.network import model, paper_model
from marsexplorer.training.envs import EncoderFactory, feature_encoder, state_matrix_encoder

FAMILIES = ("random", "1-1-1", "1-2-1", "2-1-1", "2-2-1", "3-1-1", "3-2-1")
"""The levels that `--level all` stands for: t-m-2 has the terrains of t-m-1 and differs in its rewards alone."""
LIMITS = {
    "best": "Deterministic; a guard follows the nearest frontier for 8 moves where it would go in circles.",
    "paper": "Draws its moves; may drive into an obstacle; plays the size it was trained on alone.",
}
"""What the cards say of the policies' limits."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that fixes a run besides its terrains, its length and its seed; the card of the policy lists it.

    name                                what `--recipe` calls it; "paper" has the paper's network, any other name ours
    reward_per_cell                     rewards in units of moves, a new cell being worth so many; 0: eq. 8 as it is
    num_envs, num_steps                 environments stepped together; steps of each between updates
    update_epochs, minibatch_size       passes over a rollout; steps in a gradient step
    clip_coef                           clip of the ratio (Schulman et al. 2017, eq. 7)
    learning_rate, final_learning_rate  Adam's, annealed linearly from the one to the other
    target_entropy                      entropy of the policy wanted at the beginning and at the end, nats; its coefficient in
                                        the loss is adapted to it. None: no entropy in the loss
    kl_coef, kl_target                  coefficient of the divergence from the policy that played, at first, and the
                                        divergence that it is adapted to (Schulman et al. 2017, section 4); 0: no such term
    vf_coef, vf_clip                    coefficient of the value loss; the largest squared error that counts
    gamma, gae_lambda                   discount and lambda of generalised advantage estimation (Schulman et al. 2016)
    value_warmup_updates                updates of the value alone before the policy changes
    max_grad_norm                       gradients are clipped to this norm
    """

    name: str = "best"
    reward_per_cell: float = 0.18
    num_envs: int = 256
    num_steps: int = 64
    update_epochs: int = 3
    minibatch_size: int = 2048
    clip_coef: float = 0.2
    learning_rate: float = 5e-4
    final_learning_rate: float = 2e-5
    target_entropy: tuple[float, float] | None = (0.4, 0.04)
    kl_coef: float = 0.0
    kl_target: float = 0.01
    vf_coef: float = 0.0125
    vf_clip: float = float("inf")
    gamma: float = 0.997
    gae_lambda: float = 0.95
    value_warmup_updates: int = 6
    max_grad_norm: float = 1.0

    @property
    def batch_size(self) -> int:
        """Steps between two updates: num_envs * num_steps."""
        return self.num_envs * self.num_steps

    @property
    def policy_format(self) -> str:
        """The format of the policy files that it makes."""
        return PAPER_FORMAT if self.name == "paper" else NETWORK_FORMAT

    @property
    def make_encoder(self) -> EncoderFactory:
        """What makes the network's observation of an environment."""
        return state_matrix_encoder if self.name == "paper" else feature_encoder

    def make_network(self, env_configs: Iterable[EnvConfig]) -> nn.Module:
        """Return a freshly initialised network; ValueError when it cannot serve all the environments."""
        if self.name != "paper":
            return model.Net()
        shapes = {(config.rows, config.cols) for config in env_configs}
        if len(shapes) != 1:
            raise ValueError(f"the paper's network sees one size of grid; choose one --size, got {len(shapes)}")
        return paper_model.PaperNet(*shapes.pop())

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON-ready values (None for no bound)."""
        fields = asdict(self)
        return {name: None if value == float("inf") else value for name, value in fields.items()}


RECIPES = {
    "best": TrainConfig(),
    # The appendix gives gamma, the learning rate, lambda, the KL coefficient and the clip; the rest is RLlib's default for PPO:
    # train_batch_size 4000, sgd_minibatch_size 128, num_sgd_iter 30, kl_target 0.01, vf_loss_coeff 1, vf_clip_param 10, no
    # entropy, no clipping of gradients, a value network of its own.
    "paper": TrainConfig(
        name="paper",
        reward_per_cell=0.0,
        num_envs=20,
        num_steps=200,
        update_epochs=30,
        minibatch_size=128,
        clip_coef=0.3,
        learning_rate=5e-5,
        final_learning_rate=5e-5,
        target_entropy=None,
        kl_coef=0.2,
        vf_coef=1.0,
        vf_clip=10.0,
        gamma=0.95,
        value_warmup_updates=0,
        max_grad_norm=float("inf"),
    ),
}
"""Name, as `--recipe` takes it -> configuration."""
