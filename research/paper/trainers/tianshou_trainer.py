"""Training through tianshou: its environments and networks, and A2C.

A2C stands in the place of A3C: the same loss from the same moves, but all environments step
together and no gradient is stale. A3C's workers compute their gradients with weights that others
have changed meanwhile (Mnih et al. 2016). A2C waits for all and makes one step with the mean, so a
run is reproducible, and what it learns does not depend on how busy the machine is.
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
from research.paper.networks import PaperNetwork, PolicyNetwork
from research.paper.onnx_agents import save_agent
from research.paper.trainers.environments import Environments, ObservationBytes, Rewards, add
from research.paper.trainers.settings import VARIANTS, A2CSettings, Common

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
    """Have numba cache tianshou's compiled functions; call it before they run."""
    for function in FUNCTIONS:
        if not function.signatures:
            function.enable_caching()


class Reads(nn.Module):
    """A method of a network that reads rows of bytes; tianshou's critics.

    net     its method `method` is called with the observations
    form    unpacks these
    """

    def __init__(self, net: PaperNetwork, form: ObservationBytes, method: str = "forward") -> None:
        super().__init__()
        self.net, self.form, self._method = net, form, method

    def forward(self, obs: NDArray[np.uint8], state: Any = None, info: Any = None) -> Any:
        """The network's output, float32[num, ...]."""
        return getattr(self.net, self._method)(*self.form.unpack(obs))


class Actor(Reads):
    """The same for tianshou's policies, which want the policy's state beside it.

    Ours has none.
    """

    def forward(self, obs: NDArray[np.uint8], state: Any = None, info: Any = None) -> Any:
        """(the network's output, state)."""
        return super().forward(obs), state


MOVES = gymnasium.spaces.Discrete(4)
"""The action space, for tianshou."""


class TianshouTrainer:
    """Half an `algorithms.Trainer`: a subclass builds its networks and has `advance`.

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
        """Take the algorithm, and the network of the policy file."""
        self.algorithm, self.net = algorithm, net
        algorithm.train()
        vars(algorithm)["train"] = lambda mode=True: (
            algorithm
        )  # tianshou would visit every module twice a gradient step
        algorithm.policy.is_within_training_step = True

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        save_agent(self.net, path, card)

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimisers, environments and both global generators."""
        _, keys, *place = np.random.get_state(legacy=True)
        return {
            "moves": self.moves,
            "algorithm": dict(self.algorithm.state_dict()),
            "envs": self.envs.state_dict(),
            "torch": torch.get_rng_state(),
            "numpy": [torch.from_numpy(np.asarray(keys, np.int64)), *place],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.moves = state["moves"]
        optimizers = [wrapper._optim for wrapper in self.algorithm._optimizers]
        here = [group["capturable"] for optimizer in optimizers for group in optimizer.param_groups]
        self.algorithm.load_state_dict(state["algorithm"])
        for group in (group for optimizer in optimizers for group in optimizer.param_groups):
            group["capturable"] = here.pop(0)
        self.envs.load_state_dict(state["envs"])
        self.environments.obs = self.form.pack(self.envs.observe())
        keys, *place = state["numpy"]
        np.random.set_state(("MT19937", keys.numpy().astype(np.uint32), *place))
        torch.set_rng_state(state["torch"])


def adam(learning_rate: float, device: str = "cpu") -> Any:
    """A factory of tianshou's optimisers: Adam, all tensors in one call.

    On a CUDA device it can be part of a graph.
    """
    capturable = device == "cuda"
    return TorchOptimizerFactory(
        torch.optim.Adam, lr=learning_rate, fused=True, capturable=capturable
    )


ROUND = 2000
"""Moves of a round, at least."""


class A2CTrainer(TianshouTrainer):
    """Train by A2C; a round is some updates.

    An update is of `num_steps` moves of every environment.
    """

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        del moves
        options = A2CSettings(**VARIANTS["a2c"].settings_for(variant))
        super().__init__(
            {**asdict(options), "batch_size": options.batch_size}, options, config, seed
        )
        self._options = options
        net = PolicyNetwork(options.shape(config, "policy", critic="shared"))
        policy = ProbabilisticActorPolicy(
            actor=Actor(net, self.form, "logits"),
            dist_fn=categorical,
            action_space=MOVES,
            deterministic_eval=False,
            action_scaling=False,
        )
        algorithm = A2C(
            policy=policy,
            critic=Reads(net, self.form, "value"),
            optim=adam(options.learning_rate),
            vf_coef=options.vf_coef / 2,
            ent_coef=options.ent_coef,
            max_grad_norm=options.max_grad_norm / options.batch_size,
            gae_lambda=options.gae_lambda,
            max_batchsize=options.batch_size,
            gamma=options.gamma,
        )
        self.begin(algorithm, net)
        self._buffer = VectorReplayBuffer(options.batch_size, options.num_envs)

    def advance(self) -> dict[str, float]:
        """Make some updates; return the means of their losses and of the entropy."""
        numbers: list[tuple[float, float, float]] = []
        end = self.moves + ROUND
        while self.moves < end:
            self._collect()
            stats = self.algorithm.update(self._buffer, batch_size=None, repeat=1)
            numbers.append((stats.actor_loss.mean, stats.vf_loss.mean, stats.ent_loss.mean))
            self.moves += self._options.batch_size
        means = np.mean(numbers, axis=0)
        return dict(zip(("policy_loss", "value_loss", "entropy"), map(float, means), strict=True))

    def _collect(self) -> None:
        """Empty the buffer and fill it with new moves."""
        self._buffer.reset()
        for _ in range(self._options.num_steps):
            with torch.no_grad():
                actions = self.algorithm.policy(
                    Batch(obs=self.environments.obs, info=Batch())
                ).act.numpy()
            add(self._buffer, self.environments.step(actions))


def categorical(logits: Tensor) -> Categorical:
    """The distribution over the moves with these logits."""
    return Categorical(logits=logits, validate_args=False)
