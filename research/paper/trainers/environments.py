"""The training environments for tianshou's algorithms.

They have the rewards of the variant and give observations as bytes, with what follows a move.

Environments reset themselves, so what follows the last move of an episode is not what they show
next. If an episode was truncated its last observation is returned: a time limit is no terminal
state, and its value counts. If it terminated nothing follows, and the first observation of the next
episode stands in its place, which no algorithm looks at.

Observations are rows of bytes, since tianshou's buffers keep one array, whatever a network is
given:

    state matrix  the codes, rows * cols bytes
    features      the pictures, then the bytes of the numbers of each move
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.data import Batch, PrioritizedVectorReplayBuffer
from torch import Tensor

from marsexplorer.config import EnvConfig
from marsexplorer.policies.network.features import ACTION_FEATURES, PICTURE_CELLS, PLANES
from marsexplorer.training.envs import EncoderFactory, StepResult, TrainingEnvs, rewards_in_moves
from research.paper.trainers.settings import feature_encoder, state_matrix_encoder

PICTURE_BYTES = PLANES * PICTURE_CELLS
MOVES_BYTES = 4 * ACTION_FEATURES * 4


@dataclass(frozen=True)
class ObservationBytes:
    """How observations of rows x cols become bytes and are read again.

    Features are of one size for all boards.
    """

    features: bool
    rows: int
    cols: int

    @classmethod
    def of(cls, config: EnvConfig, features: bool) -> ObservationBytes:
        """The form for the boards of a configuration."""
        return cls(features, config.rows, config.cols)

    @property
    def width(self) -> int:
        """Bytes of an observation."""
        return PICTURE_BYTES + MOVES_BYTES if self.features else self.rows * self.cols

    @property
    def make_encoder(self) -> EncoderFactory:
        """Makes the encoder of the environments' observations."""
        return feature_encoder if self.features else state_matrix_encoder

    def pack(self, observation: tuple[Tensor, ...]) -> NDArray[np.uint8]:
        """Pack an encoder's observations: uint8[num, width], a new array."""
        parts = [part.numpy().reshape(len(part), -1).view(np.uint8) for part in observation]
        return np.concatenate(parts, axis=1)

    def unpack(self, packed: NDArray[np.uint8] | Tensor) -> tuple[Tensor, ...]:
        """Unpack to a network's input: codes uint8[num, rows, cols], or planes and moves."""
        tensor = torch.as_tensor(packed)
        if not self.features:
            return (tensor.view(-1, self.rows, self.cols),)
        moves = tensor[:, PICTURE_BYTES:].contiguous().view(torch.float32)
        return tensor[:, :PICTURE_BYTES].reshape(-1, PLANES, PICTURE_CELLS), moves.view(
            -1, 4, ACTION_FEATURES
        )


@dataclass(frozen=True)
class Rewards:
    """The payment of a move.

    reward_per_cell  rewards in units of moves, a new cell being worth so many; 0: eq. 8 as it is
    has_bonus        whether +-n is paid where an episode ends, on the levels that have it
    """

    reward_per_cell: float = 0.0
    has_bonus: bool = True

    def of(self, config: EnvConfig, step: StepResult) -> NDArray[np.float64]:
        """The rewards float64[num_envs] of a step."""
        if self.reward_per_cell:
            rewards = rewards_in_moves(config, step, self.reward_per_cell)
            if self.has_bonus:
                return rewards
            return np.where(step.failed, -1.0, rewards)
        if self.has_bonus:
            return step.rewards
        return np.where(step.failed, 0.0, step.rewards - config.r_bonus * step.explored)


@dataclass(frozen=True)
class Transitions:
    """One move of every environment: arrays [num_envs, ...].

    `next_obs` and `obs` are bytes.
    """

    obs: NDArray[np.uint8]
    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    next_obs: NDArray[np.uint8]


class Environments:
    """Environments of one configuration.

    obs  uint8[num_envs, width], what they show now
    """

    def __init__(
        self, config: EnvConfig, num_envs: int, seed: int, form: ObservationBytes, rewards: Rewards
    ) -> None:
        self.form, self._rewards = form, rewards
        self.envs = TrainingEnvs(config, num_envs, 10**12 * (seed + 1), form.make_encoder)
        self.obs = form.pack(self.envs.observe())

    def step(self, actions: NDArray[np.int64]) -> Transitions:
        """Make the moves int64[num_envs]; return the transitions."""
        obs, step = self.obs, self.envs.step(actions)
        self.obs = next_obs = self.form.pack(self.envs.observe())
        truncated = np.zeros(len(actions), np.bool_)
        if step.final_obs is not None:
            truncated[step.truncated] = True
            next_obs = next_obs.copy()
            next_obs[step.truncated] = self.form.pack(step.final_obs)
        rewards = self._rewards.of(self.envs.config, step)
        return Transitions(obs, actions, rewards, step.dones & ~truncated, truncated, next_obs)


def make_replay(
    capacity: int, num_envs: int, width: int, alpha: float = 0.6, beta: float = 0.4
) -> PrioritizedVectorReplayBuffer:
    """An empty tianshou buffer of `capacity` moves, with priorities.

    It has equal parts for the environments.

    The observation that follows a move is stored with it. tianshou can look it up in the next row
    instead (`ignore_obs_next`), but then what follows a truncated episode, and the newest move of
    each environment, is taken to be the observation before it.

    width        bytes of an observation
    alpha, beta  exponents of the priorities and of the weights that correct for them (Schaul et al.
                 2016)
    """
    buffer = PrioritizedVectorReplayBuffer(capacity, num_envs, alpha=alpha, beta=beta)
    rows = buffer.maxsize
    columns: dict[str, NDArray[Any]] = {
        "obs": np.zeros((rows, width), np.uint8),
        "obs_next": np.zeros((rows, width), np.uint8),
        "act": np.zeros(rows, np.int64),
        "rew": np.zeros(rows),
        **{name: np.zeros(rows, np.bool_) for name in ("terminated", "truncated", "done")},
    }
    buffer.set_batch(Batch(columns))
    return buffer


def add(buffer: PrioritizedVectorReplayBuffer, moves: Transitions) -> None:
    """Add one move of every environment to a buffer."""
    batch = Batch()
    batch.__dict__.update(  # tianshou's constructor would copy and inspect every array
        obs=moves.obs,
        act=moves.actions,
        rew=moves.rewards,
        terminated=moves.terminated,
        truncated=moves.truncated,
        obs_next=moves.next_obs,
    )
    buffer.add(batch)
