"""The settings of the four algorithms, and their variants, without tianshou.

The paper's appendix is taken by the letter; what it leaves open is RLlib 1.0.1's default, unless a
field has another.

    paper             the settings of the paper
    works             with the smallest set of changes that completes terrains
    works-no-CHANGE   the same without one of them
    tuned             with the changes too that let it need fewer moves
    tuned-no-CHANGE   the same without one of them
    paper+CHANGE      the paper's with one change, or with several: paper+reward+mask

PPO has besides

    appendix             RLlib's 30 passes in minibatches of 128
    rllib                the same with a network of RLlib's default sizes. The shipped `ppo-paper`
                         is of an earlier training by the letter: so, but for 240,000 moves on level
                         random, and with an older clip of the value (`vf_clip`)
    paper-no-bonus       eq. 8 without +-n at the end of an episode, as on the levels t-m-2
    paper-no-value-clip  the values' change since the rollout is not clipped
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from marsexplorer.config import EnvConfig
from marsexplorer.policies.network.features import ACTION_FEATURES, FeatureExtractor
from marsexplorer.training.config import RECIPES, TrainConfig
from marsexplorer.training.envs import Encoder, EncoderFactory, Observation
from research.paper.networks import NetworkShape, PolicyNetwork
from research.paper.onnx_agents import save_agent


@dataclass(frozen=True)
class Variants:
    """The changes of an algorithm.

    algorithm     its name in words, for errors
    changes       name of a change -> the settings in which it differs from the paper's
    works, tuned  the changes of these variants; () takes all
    alone         variant -> the settings in which it differs, for those that are no set of changes
    """

    algorithm: str
    changes: Mapping[str, Mapping[str, Any]]
    works: tuple[str, ...] = ("mask", "features")
    tuned: tuple[str, ...] = ()
    alone: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def sets(self) -> dict[str, tuple[str, ...]]:
        """Variant -> its changes; besides, paper+CHANGE stands for any set of changes."""
        sets: dict[str, tuple[str, ...]] = {"paper": ()}
        for name, changes in (("works", self.works), ("tuned", self.tuned or (*self.changes,))):
            sets[name] = changes
            for one in changes:
                sets[f"{name}-no-{one}"] = tuple(change for change in changes if change != one)
        return sets

    def settings_for(self, variant: str) -> dict[str, Any]:
        """The settings in which a variant differs from the paper's.

        ValueError if there is none of that name.
        """
        if variant in self.alone:
            return dict(self.alone[variant])
        sets, (start, *added) = self.sets, variant.split("+")
        if start == "paper" and added and set(added) <= set(self.changes):
            sets[variant] = tuple(added)
        if variant not in sets:
            names = ", ".join([*self.alone, *sets, *(f"paper+{change}" for change in self.changes)])
            raise ValueError(f"{self.algorithm} has no variant {variant!r}; choose one of: {names}")
        return {
            name: setting
            for change in sets[variant]
            for name, setting in self.changes[change].items()
        }


def feature_encoder(config: EnvConfig, num_envs: int) -> Encoder:
    """The encoder of the pictures and of each move's numbers that need no prices."""
    radius = config.sensor_radius
    extractor = FeatureExtractor(num_envs, config.rows, config.cols, radius, rules=())

    def encode(*arrays: Any) -> Observation:
        planes, moves = extractor(*arrays)
        return torch.from_numpy(planes), torch.from_numpy(moves[:, :, :ACTION_FEATURES].copy())

    return encode


def state_matrix_encoder(config: EnvConfig, num_envs: int) -> Encoder:
    """The encoder for networks that take only the codes of the state matrix (eq. 6)."""
    del config, num_envs
    return lambda codes, cells, visited, headings: (torch.from_numpy(codes),)


@dataclass(frozen=True)
class PPOSettings(TrainConfig):
    """The settings of our own PPO with the paper's networks.

    network  "authors": the state matrix by the network of the authors' repository; "rllib": by
             RLlib's; "features": our features
    mask     whether invalid moves have no probability
    """

    network: str = "authors"
    mask: bool = False

    @property
    def is_deterministic(self) -> bool:
        """Whether its policies take the best move, with the loop guard.

        Others draw their moves.
        """
        return self.network == "features" and self.mask

    @property
    def make_encoder(self) -> EncoderFactory:
        return feature_encoder if self.network == "features" else state_matrix_encoder

    @property
    def has_critic(self) -> bool:
        return self.network != "features"

    def make_network(self, env_configs: Iterable[EnvConfig]) -> nn.Module:
        """A freshly initialised network for environments of one size."""
        ((rows, cols),) = {(config.rows, config.cols) for config in env_configs}
        if self.network != "features":
            return PolicyNetwork(
                NetworkShape(self.network, "policy", rows, cols, "separate", mask=self.mask)
            )
        scale = 5.0 if self.mask else 1.0  # as our own network has it
        return PolicyNetwork(
            NetworkShape("features", "policy", None, None, "shared", scale, mask=self.mask)
        )

    def save_policy(self, net: nn.Module, path: Path, card: dict[str, Any]) -> None:
        """Write the ONNX file of a network that `make_network` returned.

        Its limits go on the card.
        """
        assert isinstance(net, PolicyNetwork)
        limits = "Deterministic; a guard follows the nearest frontier where it would go in circles."
        if not self.is_deterministic:
            crashes = "" if self.mask else "may drive into an obstacle; "
            of_size = "any size" if net.shape.size is None else "the size it was trained on alone"
            limits = f"Draws its moves; {crashes}plays {of_size}."
        acts = "greedy with guard" if self.is_deterministic else "samples"
        save_agent(net, path, {"limits": limits, "acts": acts, **card})


PPO = PPOSettings(
    name="paper",
    reward_per_cell=0.0,
    num_envs=20,
    num_steps=200,
    update_epochs=6,
    minibatch_size=500,
    clip_coef=0.3,
    learning_rate=5e-5,
    final_learning_rate=5e-5,
    target_entropy=None,
    kl_coef=0.2,
    kl_of_last_epoch=True,
    vf_coef=1.0,
    vf_change_clip=10.0,
    gamma=0.95,
    value_warmup_updates=0,
    max_grad_norm=float("inf"),
)
"""PPO by the letter: the appendix gives gamma, the learning rate, lambda, the KL coefficient and
the clip.

The rest is RLlib 1.0.1's default for PPO: train_batch_size 4000, kl_target 0.01, vf_loss_coeff 1,
vf_clip_param 10, no entropy, no clipping of gradients, a value network of its own. Its 30 passes in
minibatches of 128 are APPENDIX_PASSES: 960 gradient steps an update and an eighth of the speed,
where these have 48.
"""
APPENDIX_PASSES: dict[str, Any] = {"update_epochs": 30, "minibatch_size": 128}
"""RLlib's defaults (num_sgd_iter, sgd_minibatch_size)."""
BEST = RECIPES["best"]
SHARED: dict[str, dict[str, Any]] = {
    "reward": {"reward_per_cell": BEST.reward_per_cell, "has_bonus": False},
    "mask": {"mask": True},
    "discount": {"gamma": 0.99},
    "features": {"network": "features"},
}
"""Name of a change -> the settings that it changes, for every algorithm.

reward    units of moves, nothing at the end
mask      invalid moves have no probability
discount  0.99 for 0.95; PPO has the 0.997 of the recipe `best`
features  our network and its features for the state matrix
batch     the optimiser's: larger batches, fewer updates; PPO has a falling learning rate and an
          entropy target besides
"""
OTHERS = {"name", "gamma", *SHARED["reward"]}
CHANGES: dict[str, dict[str, Any]] = SHARED | {
    "discount": {"gamma": BEST.gamma},
    "batch": {
        setting.name: getattr(BEST, setting.name)
        for setting in fields(BEST)
        if setting.name not in OTHERS
    },
    "rate": {"learning_rate": 3e-4, "final_learning_rate": 3e-4},
}
"""PPO's; all but "rate", which makes up for the fewer gradient steps of the 6 passes, are those
of the recipe `best`.
"""
TUNED = ("reward", "mask", "discount", "features", "batch")
ALONE: dict[str, dict[str, Any]] = {
    "appendix": APPENDIX_PASSES,
    "rllib": {**APPENDIX_PASSES, "network": "rllib"},
    "paper-no-bonus": {"has_bonus": False},
    "paper-no-value-clip": {"vf_change_clip": float("inf")},
}


def ppo_settings(variant: str) -> PPOSettings:
    """The settings of a variant of PPO; ValueError if there is none of that name."""
    return replace(PPO, **VARIANTS["ppo"].settings_for(variant))


@dataclass(frozen=True)
class Common:
    """Settings of every algorithm here.

    gamma            discount
    network          "authors": the state matrix by the network of the authors' repository;
                     "features": ours
    mask             whether invalid moves are never taken and have no probability
    reward_per_cell  rewards in units of moves, a new cell being worth so many; 0: eq. 8 as it is
    has_bonus        whether +-n is paid where an episode ends, on the levels that have it
    num_envs         environments stepped together
    """

    gamma: float = 0.95
    network: str = "authors"
    mask: bool = False
    reward_per_cell: float = 0.0
    has_bonus: bool = True
    num_envs: int = 16

    def shape(self, config: EnvConfig, head: str, **rest: Any) -> NetworkShape:
        """The shape of a network for the boards of a configuration."""
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
    priority_alpha: float = 0.6
    priority_beta: float = 0.4


@dataclass(frozen=True)
class A2CSettings(Common):
    """The appendix's table 5, else RLlib 1.0.1's defaults (rllib/agents/a3c).

    num_steps      moves of each environment between updates; A3C's rollout_fragment_length is 10,
                   and 20 environments make the 200 moves of A2C's train_batch_size
    vf_coef        coefficient of half the squared error of the value: RLlib's loss has the half
    max_grad_norm  of the gradient of the sum over the moves, as RLlib has it; the mean's is clipped
                   at a share of it
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


A2C_BATCH = {"num_envs": 64, "num_steps": 16, "learning_rate": 1e-3, "max_grad_norm": 1024.0}
A2C_CHANGES = {"discount": {"gamma": 0.99, "gae_lambda": 0.95}, "batch": A2C_BATCH}


@dataclass(frozen=True)
class RainbowSettings(OffPolicy):
    """The appendix's table 3, else RLlib 1.0.1's defaults (rllib/agents/dqn).

    support             lowest and highest return of the distribution; None: +-(n + 20), which holds
                        the +-n of eq. 8 (RLlib has +-10, the authors' repository +-400 where the
                        ends are paid +-400)
    noisy_sigma         of the noise in the dense layers at first
    epsilon             at first, and after `epsilon_moves` moves
    target_update_freq  moves between two copies to the target network
    max_grad_norm       of the gradient
    """

    learning_rate: float = 5e-4
    n_step: int = 3
    num_atoms: int = 51
    support: tuple[float, float] | None = None
    noisy_sigma: float = 0.5
    epsilon: tuple[float, float] = (1.0, 0.02)
    epsilon_moves: int = 10_000
    target_update_freq: int = 500
    max_grad_norm: float = 40.0


RAINBOW_CHANGES: dict[str, dict[str, Any]] = {
    "reward": {**SHARED["reward"], "support": (-60.0, 40.0)},
    "batch": {"batch_size": 128, "moves_per_update": 16, "target_update_freq": 2000},
}


@dataclass(frozen=True)
class SACSettings(OffPolicy):
    """The appendix's table 4, else RLlib 1.0.1's defaults (rllib/agents/sac).

    moves_per_update  RLlib makes a gradient step for each move of every worker; the authors' runner
                      has 8 workers
    tau               share of the critics that their targets take over at a gradient step
    initial_alpha     weight of the entropy at first; it is adapted to `target_entropy`
    target_entropy    share of the entropy of equal probabilities, log 4 (RLlib's "auto" is 0.98 of
                      it)
    q_hidden, policy_hidden  units of the layers between the network of the state matrix and its
                             heads
    """

    buffer_size: int = 1_000_000
    batch_size: int = 256
    moves_per_update: int = 8
    learning_starts: int = 1500
    learning_rate: float = 3e-4
    tau: float = 5e-3
    q_hidden: tuple[int, ...] = (256, 256)
    policy_hidden: tuple[int, ...] = (256, 256)
    initial_alpha: float = 1.0
    target_entropy: float = 0.98


SAC_CHANGES: dict[str, dict[str, Any]] = {
    "features": {"network": "features", "q_hidden": (), "policy_hidden": ()},
    "entropy": {"target_entropy": 0.1, "initial_alpha": 0.2},
    "batch": {"batch_size": 128, "moves_per_update": 16, "buffer_size": 100_000},
}
VARIANTS = {
    "ppo": Variants("PPO", CHANGES, tuned=TUNED, alone=ALONE),
    "a2c": Variants("A2C", SHARED | A2C_CHANGES),
    "rainbow": Variants("Rainbow", SHARED | RAINBOW_CHANGES),
    "sac": Variants("SAC", SHARED | SAC_CHANGES, works=("mask", "features", "entropy")),
}
"""Algorithm -> its variants."""
