"""The algorithms that learn from a replay buffer, by samples of what they played.

DQN-Rainbow (Hessel et al. 2018) with all of its six parts:

    1. double Q                 the network chooses the move whose value the target network gives
                                (`_target_dist` of tianshou)
    2. dueling network          a stream for the board and one for the moves (`CategoricalNetwork`)
    3. prioritized replay       by the loss of a move (`make_replay`)
    4. n-step returns           `n_step`
    5. distribution of returns  `num_atoms` over `support` (C51)
    6. noisy network            in place of epsilon; its noise is new for every gradient step and
                                for every move too

The paper's appendix names 1, 2, 3 and 6, and lets an epsilon fall besides. RLlib 1.0.1 has one step
and one atom by default, which is DQN without the parts 4 and 5; a Rainbow has them, so these are
Hessel's: three steps and 51 atoms.

Discrete soft actor-critic is Haarnoja et al. 2018's, for discrete actions Christodoulou 2019's,
with two critics.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.algorithm import DiscreteSAC, RainbowDQN
from tianshou.algorithm.modelfree.c51 import C51Policy
from tianshou.algorithm.modelfree.discrete_sac import DiscreteSACPolicy
from tianshou.algorithm.modelfree.reinforce import LossSequenceTrainingStats
from tianshou.algorithm.modelfree.sac import AutoAlpha
from tianshou.data import Batch, ReplayBuffer
from torch import Tensor

from marsexplorer.config import EnvConfig
from marsexplorer.training.ppo import GraphedFunction
from research.paper.networks import (
    CategoricalNetwork,
    PolicyNetwork,
    QNetwork,
    invalid_moves,
    make_network,
    sample_noise,
)
from research.paper.trainers.environments import add, make_replay
from research.paper.trainers.settings import (
    VARIANTS,
    OffPolicy,
    RainbowSettings,
    SACSettings,
)
from research.paper.trainers.tianshou_trainer import (
    MOVES,
    Actor,
    Reads,
    TianshouTrainer,
    adam,
)

STEPS_OF_ROUND = 16
"""Moves of each environment in a round."""


class OffPolicyTrainer(TianshouTrainer, ABC):
    """The trainer of an algorithm with a replay buffer.

    A round is some moves of every environment.
    """

    def __init__(
        self, settings: dict[str, Any], options: OffPolicy, config: EnvConfig, seed: int, moves: int
    ) -> None:
        super().__init__(settings, options, config, seed)
        self._off_policy = options
        capacity = min(
            options.buffer_size, -(-moves // options.num_envs) * options.num_envs
        )  # a longer one would never be full
        self._buffer = make_replay(
            capacity,
            options.num_envs,
            self.form.width,
            options.priority_alpha,
            options.priority_beta,
        )
        self._actions: list[NDArray[np.int64]] = []

    @abstractmethod
    def act(self) -> NDArray[np.int64]:
        """The moves int64[num_envs] that are tried now."""

    @abstractmethod
    def numbers(self, stats: Any) -> dict[str, float]:
        """The logged metrics of a gradient step."""

    def advance(self) -> dict[str, float]:
        """Play and learn for a round; return the means of its gradient steps' metrics."""
        options, steps = self._off_policy, []
        for _ in range(STEPS_OF_ROUND):
            self._play(self.act())
            before, self.moves = self.moves, self.moves + options.num_envs
            if self.moves > options.learning_starts:
                for _ in range(
                    self.moves // options.moves_per_update - before // options.moves_per_update
                ):
                    steps.append(
                        self.numbers(
                            self.algorithm.update(self._buffer, sample_size=options.batch_size)
                        )
                    )
        names = steps[0] if steps else {}
        return {name: float(np.mean([step[name] for step in steps])) for name in names}

    def _play(self, actions: NDArray[np.int64]) -> None:
        self._actions.append(actions)
        add(self._buffer, self.environments.step(actions))

    def state_dict(self) -> dict[str, Any]:
        """The state with its priorities, and all actions, which make the buffer again."""
        buffer = self._buffer
        return super().state_dict() | {
            "actions": torch.from_numpy(np.array(self._actions, np.uint8)),
            "priorities": torch.from_numpy(np.asarray(buffer.weight[np.arange(buffer.maxsize)])),
            "priority_range": [float(buffer._max_prio), float(buffer._min_prio)],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Fill the buffer by playing the actions, and restore the rest.

        The trainer must be at its beginning.
        """
        for actions in state["actions"].numpy().astype(np.int64):
            self._play(actions)
        buffer = self._buffer
        buffer.weight[np.arange(buffer.maxsize)] = state["priorities"].numpy()
        highest, lowest = state["priority_range"]
        buffer._max_prio, buffer._min_prio = np.float32(highest), np.float32(lowest)
        super().load_state_dict(state)


class RainbowTrainer(OffPolicyTrainer):
    """Train by Rainbow, on a CUDA device if there is one."""

    net: CategoricalNetwork

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        options = RainbowSettings(**VARIANTS["rainbow"].settings_for(variant))
        support = options.support or (-config.n - 20.0, config.n + 20.0)
        super().__init__(
            {**asdict(options), "support": list(support)}, options, config, seed, moves
        )
        self._options = options
        shape = options.shape(config, "categorical", atoms=options.num_atoms, support=support)
        net = make_network(shape, options.noisy_sigma)
        assert isinstance(net, CategoricalNetwork)
        self._is_on_cuda = torch.cuda.is_available()
        device = "cuda" if self._is_on_cuda else "cpu"
        policy = C51Policy(
            model=Actor(net, self.form),
            action_space=MOVES,
            num_atoms=options.num_atoms,
            v_min=support[0],
            v_max=support[1],
        ).to(device)
        self.begin(NStepRainbow(policy, options), net)
        self._choose = graphed(self._best_moves, device)

    def _best_moves(self, obs: Tensor) -> Tensor:
        sample_noise(self.net)
        with torch.no_grad():
            expected: Tensor = self.net.expected(*self.form.unpack(obs))
        return expected.argmax(1)

    def act(self) -> NDArray[np.int64]:
        """The best moves by the network with new noise, and some at random."""
        first, last = self._options.epsilon
        policy, obs = self.algorithm.policy, torch.from_numpy(self.environments.obs)
        policy.set_eps_training(
            first + (last - first) * min(1.0, self.moves / self._options.epsilon_moves)
        )
        actions = self._choose(obs).cpu().numpy()
        is_valid = (
            ~invalid_moves(self.form.unpack(obs)).numpy()
            if self._options.mask
            else np.ones((len(obs), 4))
        )
        tried: NDArray[np.int64] = policy.add_exploration_noise(
            actions, Batch(obs=Batch(mask=is_valid))
        )
        return tried

    def numbers(self, stats: Any) -> dict[str, float]:
        return {"loss": stats.loss}

    def state_dict(self) -> dict[str, Any]:
        """The state, the CUDA device's generator, and the number of gradient steps.

        The target network is copied by that number.
        """
        state = super().state_dict() | {"gradient_steps": self.algorithm._iter}
        return state | ({"cuda": torch.cuda.get_rng_state()} if self._is_on_cuda else {})

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the state; one of another device goes on with other noise."""
        super().load_state_dict(state)
        self.algorithm._iter = state["gradient_steps"]
        if self._is_on_cuda and "cuda" in state:
            torch.cuda.set_rng_state(state["cuda"])


class NStepRainbow(RainbowDQN):
    """tianshou's Rainbow with our noisy layers, a clipped gradient, and two changes.

    tianshou 2.0.1 adds n rewards but takes the distribution of the observation after one move,
    where it belongs after n; and its gradient step cannot be a graph.
    """

    def __init__(self, policy: C51Policy, options: RainbowSettings) -> None:
        self._max_grad_norm = options.max_grad_norm
        device = policy.support.device.type
        super().__init__(
            policy=policy,
            optim=adam(options.learning_rate, device),
            gamma=options.gamma,
            n_step_return_horizon=options.n_step,
            target_update_freq=max(1, options.target_update_freq // options.moves_per_update),
        )
        self._graphed_step = graphed(self.gradient_step, device)

    def _create_policy_optimizer(self, optim: Any) -> Any:
        return self._create_optimizer(self.policy, optim, max_grad_norm=self._max_grad_norm)

    def _preprocess_batch(
        self, batch: Any, buffer: ReplayBuffer, indices: NDArray[np.int64]
    ) -> Any:
        batch = super()._preprocess_batch(batch, buffer, indices)
        last = indices
        for _ in range(self.n_step - 1):
            last = buffer.next(last)
        batch.obs_next = buffer.get(last, "obs_next")
        return batch

    def _update_with_batch(self, batch: Any) -> LossSequenceTrainingStats:
        """Make a gradient step as tianshou does; the batch's weights become priorities."""
        self._periodically_update_lagged_network_weights()
        names = ("obs", "obs_next", "act", "returns", "weight")
        inputs = [torch.as_tensor(batch[name]) for name in names]
        batch.weight = self._graphed_step(*inputs).cpu()
        return LossSequenceTrainingStats(loss=float((batch.weight * inputs[-1].cpu()).mean()))

    def gradient_step(
        self, obs: Tensor, obs_next: Tensor, act: Tensor, returns: Tensor, weight: Tensor
    ) -> Tensor:
        """Make a gradient step with new noise; return the cross-entropies float32[b].

        returns  float32[b, atoms], what each return of the support becomes n moves earlier
        weight   float32[b], of the moves in the loss
        """
        for model in (self.policy.model, self.model_old):
            sample_noise(model)
        with torch.no_grad():
            target = self.target_distribution(obs_next, returns)
        distributions, _ = self.policy.model(obs)
        errors = -(target * torch.log(of_moves(distributions, act) + 1e-8)).sum(1)
        self.optim.step((errors * weight).mean())
        return errors.detach()

    def target_distribution(self, obs_next: Tensor, returns: Tensor) -> Tensor:
        """The target network's distribution of the best moves, moved to the returns.

        float32[b, atoms]; the network chooses the best moves.
        """
        model, policy = self.policy.model, self.policy
        best = model.net.expected(*model.form.unpack(obs_next)).argmax(1)
        distributions, _ = self.model_old(obs_next)
        places = returns.clamp(policy.v_min, policy.v_max)[:, None, :]
        distances = (places - policy.support[None, :, None]).abs() / self.delta_z
        shares = (1 - distances).clamp(0, 1)
        target: Tensor = (shares * of_moves(distributions, best)[:, None, :]).sum(2)
        return target


def of_moves(distributions: Tensor, moves: Tensor) -> Tensor:
    """The distributions [b, atoms] of the moves int64[b], of all moves' [b, 4, atoms]."""
    indices = moves[:, None, None].expand(-1, 1, distributions.shape[2])
    return distributions.gather(1, indices).squeeze(1)


def graphed(function: Callable[..., Tensor], device: str) -> Callable[..., Tensor]:
    """The function, on a CUDA device as one graph."""
    return GraphedFunction(function) if device == "cuda" else function


class SACTrainer(OffPolicyTrainer):
    """Train by discrete SAC."""

    net: PolicyNetwork

    def __init__(self, variant: str, config: EnvConfig, seed: int, moves: int) -> None:
        options = SACSettings(**VARIANTS["sac"].settings_for(variant))
        super().__init__(asdict(options), options, config, seed, moves)
        net = PolicyNetwork(options.shape(config, "policy", hidden=options.policy_hidden))
        critics = [
            Reads(QNetwork(options.shape(config, "q", hidden=options.q_hidden)), self.form)
            for _ in range(2)
        ]
        self._alpha = AutoAlpha(
            options.target_entropy * float(np.log(4)),
            float(np.log(options.initial_alpha)),
            adam(options.learning_rate),
        )
        optimizer = adam(options.learning_rate)
        algorithm = DiscreteSAC(
            policy=DiscreteSACPolicy(actor=Actor(net, self.form, "logits"), action_space=MOVES),
            policy_optim=optimizer,
            critic=critics[0],
            critic_optim=optimizer,
            critic2=critics[1],
            critic2_optim=optimizer,
            tau=options.tau,
            gamma=options.gamma,
            alpha=self._alpha,
            n_step_return_horizon=options.n_step,
        )
        self.begin(algorithm, net)

    def act(self) -> NDArray[np.int64]:
        """Moves drawn from the policy."""
        with torch.no_grad():
            actions: NDArray[np.int64] = self.algorithm.policy(
                Batch(obs=self.environments.obs, info=Batch())
            ).act.numpy()
        return actions

    def numbers(self, stats: Any) -> dict[str, float]:
        return {
            "policy_loss": stats.actor_loss,
            "value_loss": stats.critic1_loss,
            "alpha": stats.alpha,
        }

    def state_dict(self) -> dict[str, Any]:
        """The state with the optimiser of the entropy's weight, which tianshou leaves out."""
        return super().state_dict() | {"alpha": self._alpha._optim.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        super().load_state_dict(state)
        self._alpha._optim.load_state_dict(state["alpha"])
