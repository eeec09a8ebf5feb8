"""What a training run is made of: `best`, which explores best from the observation, and `paper`, what the paper did."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

from torch import nn

from marsexplorer.config import EnvConfig
from marsexplorer.policies.network import model, paper_model
from marsexplorer.training.envs import Boards, Stacks, View, matrix, pictures

FAMILIES = ("random", "1-1-1", "1-2-1", "2-1-1", "2-2-1", "3-1-1", "3-2-1")
"""What `--level all` stands for: t-m-2 has the terrains of t-m-1 and differs in what it pays alone."""
LIMITS = {
    "best": "Deterministic; a guard follows the nearest frontier for 8 moves where it would go in circles.",
    "paper": "Draws its moves; may drive into an obstacle; plays the size it was trained on alone.",
}
"""What the cards say of the policies' limits."""


@dataclass(frozen=True)
class Recipe:
    """Everything that fixes a run besides its terrains, its length and its seed; the card of the policy lists it.

    pace                     rewards are told in moves, a new cell being worth so many; 0: eq. 8 as it is
    boards, horizon          environments stepped together; moves of each between updates
    epochs, minibatch        passes over a rollout; moves in a gradient step
    clip                     of the ratio (Schulman et al. 2017, eq. 7)
    rate, final_rate         Adam's learning rate, falling linearly
    curiosity                entropy of the moves wanted at the beginning and at the end, nats; its weight in the loss follows.
                             None: no entropy in the loss
    kl_share, kl_target      weight of the divergence from the policy that played, at first, and where it is steered to
                             (Schulman et al. 2017, section 4); 0: none
    value_share, value_clip  weight of the value's squared error, and the most a squared error may come to
    gamma, lam               discount and GAE's lambda (Schulman et al. 2016)
    value_updates            updates of the value alone before the policy moves
    max_grad                 largest norm of a gradient
    """

    name: str = "best"
    pace: float = 0.18
    boards: int = 256
    horizon: int = 64
    epochs: int = 3
    minibatch: int = 2048
    clip: float = 0.2
    rate: float = 5e-4
    final_rate: float = 2e-5
    curiosity: tuple[float, float] | None = (0.4, 0.04)
    kl_share: float = 0.0
    kl_target: float = 0.01
    value_share: float = 0.0125
    value_clip: float = float("inf")
    gamma: float = 0.997
    lam: float = 0.95
    value_updates: int = 6
    max_grad: float = 1.0

    @property
    def format(self) -> str:
        """The format of the policy files it makes."""
        return paper_model.FORMAT if self.name == "paper" else model.FORMAT

    @property
    def view(self) -> Callable[[EnvConfig, int], View]:
        """How the network is shown a board."""
        return matrix if self.name == "paper" else pictures

    def network(self, configs: Iterable[EnvConfig]) -> nn.Module:
        """Return a network to begin with; ValueError when it cannot serve all the configurations."""
        if self.name != "paper":
            return model.Net()
        shapes = {(config.rows, config.cols) for config in configs}
        if len(shapes) != 1:
            raise ValueError(f"the paper's network sees one size of grid; choose one --size, got {len(shapes)}")
        return paper_model.PaperNet(*shapes.pop())

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON-ready values (None for no bound)."""
        fields = asdict(self)
        return {name: None if value == float("inf") else value for name, value in fields.items()}


RECIPES = {
    "best": Recipe(),
    # The appendix gives gamma, the learning rate, lambda, the KL coefficient and the clip; the rest is RLlib's default for PPO:
    # train_batch_size 4000, sgd_minibatch_size 128, num_sgd_iter 30, kl_target 0.01, vf_loss_coeff 1, vf_clip_param 10, no
    # entropy, no clipping of gradients, a value network of its own.
    "paper": Recipe(
        name="paper", pace=0.0, boards=20, horizon=200, epochs=30, minibatch=128, clip=0.3, rate=5e-5, final_rate=5e-5,
        curiosity=None, kl_share=0.2, value_share=1.0, value_clip=10.0, gamma=0.95, value_updates=0, max_grad=float("inf"),
    ),
}  # fmt: skip


def stacks(recipe: Recipe, configs: list[EnvConfig], seed: int) -> Stacks:
    """Return the boards of a run: all levels and sizes have some, the first level half, larger grids fewer."""
    levels = {config.level for config in configs}
    first = max(1, len(levels) - 1)
    shares = [(first if config.level == configs[0].level else 1) / config.n for config in configs]
    counts = [max(1, int(recipe.boards * share / sum(shares))) for share in shares]
    counts[0] += recipe.boards - sum(counts)
    if counts[0] < 1:
        raise ValueError(f"{len(configs)} levels and sizes are too many for {recipe.boards} boards; choose fewer")
    starts = [10**12 * (seed + 1) + 10**7 * k for k in range(len(configs))]
    return Stacks([Boards(*each, recipe.view) for each in zip(configs, counts, starts, strict=True)])
