"""The training environments as tianshou's algorithms need them: rewards of the variant, and what follows each move.

Environments reset themselves, so what follows the last move of an episode is not what they show next. Where an episode was
truncated the last observation of it is returned: a time limit is no terminal state, and its value counts. Where it terminated
nothing follows, and the first observation of the next episode stands in its place, which no algorithm looks at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.observation_bytes import ObservationBytes
from marsexplorer.training.envs import StepResult, TrainingEnvs, rewards_in_moves


@dataclass(frozen=True)
class Rewards:
    """What a move is paid.

    reward_per_cell  rewards in units of moves, a new cell being worth so many; 0: eq. 8 as it is
    has_bonus        whether +-n is paid where an episode ends, on the levels that have it
    """

    reward_per_cell: float = 0.0
    has_bonus: bool = True

    def of(self, config: EnvConfig, step: StepResult) -> NDArray[np.float64]:
        """Return the rewards float64[num_envs] of a step."""
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
    """One move of every environment: arrays [num_envs, ...], `next_obs` and `obs` as bytes."""

    obs: NDArray[np.uint8]
    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    next_obs: NDArray[np.uint8]


class Environments:
    """Environments of one configuration; `obs` uint8[num_envs, width] is what they show now."""

    def __init__(
        self, config: EnvConfig, num_envs: int, seed: int, form: ObservationBytes, rewards: Rewards
    ) -> None:
        self.form, self._rewards = form, rewards
        self.envs = TrainingEnvs(config, num_envs, 10**12 * (seed + 1), form.make_encoder)
        self.obs = form.pack(self.envs.observe())

    def step(self, actions: NDArray[np.int64]) -> Transitions:
        """Make the moves int64[num_envs]; return what came of them."""
        obs, step = self.obs, self.envs.step(actions)
        self.obs = next_obs = self.form.pack(self.envs.observe())
        truncated = np.zeros(len(actions), np.bool_)
        if step.final_obs is not None:
            truncated[step.truncated] = True
            next_obs = next_obs.copy()
            next_obs[step.truncated] = self.form.pack(step.final_obs)
        rewards = self._rewards.of(self.envs.config, step)
        return Transitions(obs, actions, rewards, step.dones & ~truncated, truncated, next_obs)

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes."""
        return self.envs.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        self.envs.load_state_dict(state)
        self.obs = self.form.pack(self.envs.observe())
