"""The settings of A2C, Rainbow and discrete SAC, and their variants; nothing here needs tianshou.

What the paper's appendix says is taken by the letter; what it leaves open is RLlib 1.0.1's default, unless a field says else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.variants import Variants
from marsexplorer.policies.network.shape import NetworkShape


@dataclass(frozen=True)
class Common:
    """Settings of every algorithm here.

    gamma            discount
    network          "authors": the state matrix by the network of the authors' repository; "features": ours
    mask             whether invalid moves are never taken and have no probability
    reward_per_cell  rewards in units of moves, a new cell being worth so many; 0: eq. 8 as it is
    has_bonus        whether +-n is paid where an episode ends, on the levels that have it
    num_envs         environments stepped together
    light            whether the network computes in bfloat16
    """

    gamma: float = 0.95
    network: str = "authors"
    mask: bool = False
    reward_per_cell: float = 0.0
    has_bonus: bool = True
    num_envs: int = 16
    light: bool = False

    def shape(self, config: EnvConfig, head: str, **rest: Any) -> NetworkShape:
        """Return the shape of a network for the boards of a configuration."""
        rows, cols = (None, None) if self.network == "features" else (config.rows, config.cols)
        return NetworkShape(self.network, head, rows=rows, cols=cols, mask=self.mask, **rest)


@dataclass(frozen=True)
class OffPolicy(Common):
    """Settings of both.

    buffer_size       moves kept
    batch_size        moves of a gradient step
    moves_per_update  moves between two gradient steps
    learning_starts   moves before the first gradient step
    n_step            moves after which the value of what follows is counted
    priority_alpha    exponent of the priorities (Schaul et al. 2016)
    priority_beta     exponent of the weights that correct for them
    """

    buffer_size: int = 50_000
    batch_size: int = 32
    moves_per_update: int = 4
    learning_starts: int = 1000
    n_step: int = 1
    prioritized_replay: bool = True
    priority_alpha: float = 0.6
    priority_beta: float = 0.4


@dataclass(frozen=True)
class A2CSettings(Common):
    """The appendix's table 5, and RLlib 1.0.1's defaults where it says nothing (rllib/agents/a3c).

    num_steps      moves of each environment between updates; A3C's rollout_fragment_length is 10, and 20 environments make
                   the 200 moves of A2C's train_batch_size
    vf_coef        coefficient of half the squared error of the value: RLlib's loss has the half
    max_grad_norm  of the gradient of the sum over the moves, as RLlib has it; the mean's is clipped at a share of it
    """

    num_envs: int = 20
    num_steps: int = 10
    learning_rate: float = 1e-4
    gae_lambda: float = 0.99
    vf_coef: float = 0.5
    ent_coef: float = 0.01
    max_grad_norm: float = 40.0

    @property
    def batch_size(self) -> int:
        """Moves between two updates."""
        return self.num_envs * self.num_steps


A2C_VARIANTS = Variants(
    "A2C",
    {
        "reward": {"reward_per_cell": 0.18, "has_bonus": False},
        "mask": {"mask": True},
        "discount": {"gamma": 0.99, "gae_lambda": 0.95},
        "features": {"network": "features"},
        "batch": {"num_envs": 64, "num_steps": 16, "learning_rate": 1e-3, "max_grad_norm": 1024.0},
    },
    works=("mask", "features"),
    tuned=("reward", "mask", "discount", "features", "batch"),
)


@dataclass(frozen=True)
class RainbowSettings(OffPolicy):
    """The appendix's table 3, and RLlib 1.0.1's defaults where it says nothing (rllib/agents/dqn).

    support             lowest and highest return of the distribution; None: +-(n + 20), which holds the +-n of eq. 8 (RLlib
                        has +-10, the authors' repository +-400 where the ends are paid +-400)
    epsilon             at first, and after `epsilon_moves` moves
    target_update_freq  moves between two copies to the target network
    max_grad_norm       of the gradient
    """

    learning_rate: float = 5e-4
    n_step: int = 3
    num_atoms: int = 51
    support: tuple[float, float] | None = None
    noisy: bool = True
    noisy_sigma: float = 0.5
    dueling: bool = True
    double_q: bool = True
    epsilon: tuple[float, float] = (1.0, 0.02)
    epsilon_moves: int = 10_000
    target_update_freq: int = 500
    max_grad_norm: float = 40.0


RAINBOW_VARIANTS = Variants(
    "Rainbow",
    {
        "reward": {"reward_per_cell": 0.18, "has_bonus": False, "support": (-60.0, 40.0)},
        "mask": {"mask": True},
        "discount": {"gamma": 0.99},
        "features": {"network": "features"},
        "batch": {"batch_size": 128, "moves_per_update": 16, "target_update_freq": 2000},
    },
    works=("mask", "features"),
    tuned=("reward", "mask", "discount", "features", "batch"),
)


@dataclass(frozen=True)
class SACSettings(OffPolicy):
    """The appendix's table 4, and RLlib 1.0.1's defaults where it says nothing (rllib/agents/sac).

    moves_per_update  RLlib makes a gradient step for each move of every worker; the authors' runner has 8 workers
    tau               share of the critics that their targets take over at a gradient step
    initial_alpha     weight of the entropy at first; it is adapted to `target_entropy`
    target_entropy    share of the entropy of equal probabilities, log 4 (RLlib's "auto" is 0.98 of it)
    q_hidden, policy_hidden  units of the layers between the network of the state matrix and its heads
    """

    buffer_size: int = 1_000_000
    batch_size: int = 256
    moves_per_update: int = 8
    learning_starts: int = 1500
    learning_rate: float = 3e-4
    tau: float = 5e-3
    twin_q: bool = True
    q_hidden: tuple[int, ...] = (256, 256)
    policy_hidden: tuple[int, ...] = (256, 256)
    initial_alpha: float = 1.0
    target_entropy: float = 0.98


SAC_VARIANTS = Variants(
    "SAC",
    {
        "reward": {"reward_per_cell": 0.18, "has_bonus": False},
        "mask": {"mask": True},
        "discount": {"gamma": 0.99},
        "features": {"network": "features", "q_hidden": (), "policy_hidden": ()},
        "entropy": {"target_entropy": 0.1, "initial_alpha": 0.2},
        "batch": {"batch_size": 128, "moves_per_update": 16, "buffer_size": 100_000},
    },
    works=("mask", "features", "entropy"),
    tuned=("reward", "mask", "discount", "features", "entropy", "batch"),
)

VARIANTS = {"a2c": A2C_VARIANTS, "rainbow": RAINBOW_VARIANTS, "sac": SAC_VARIANTS}
"""Algorithm -> its variants."""
