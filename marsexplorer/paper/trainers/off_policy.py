"""What Rainbow and discrete SAC share: they play, keep what came of it, and learn from samples of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.replay import add, load_replay_state, make_replay, replay_state
from marsexplorer.paper.trainers.tianshou_settings import OffPolicy
from marsexplorer.paper.trainers.tianshou_trainer import TianshouTrainer

STEPS_OF_ROUND = 16
"""Moves of each environment in a round."""


class OffPolicyTrainer(TianshouTrainer, ABC):
    """The trainer of an algorithm that learns from a replay buffer; a round is some moves of every environment."""

    def __init__(
        self, settings: dict[str, Any], own: OffPolicy, config: EnvConfig, seed: int, moves: int
    ) -> None:
        super().__init__(settings, own, config, seed)
        self._off_policy = own
        capacity = min(
            own.buffer_size, -(-moves // own.num_envs) * own.num_envs
        )  # a longer one would never be full
        self._buffer = make_replay(
            capacity, own.num_envs, self.form.width, own.priority_alpha, own.priority_beta
        )

    @abstractmethod
    def act(self) -> NDArray[np.int64]:
        """Return the moves int64[num_envs] that are tried now."""

    @abstractmethod
    def numbers(self, stats: Any) -> dict[str, float]:
        """Return what is logged of a gradient step."""

    def advance(self) -> dict[str, float]:
        """Play and learn for a round; return the means of its gradient steps' numbers."""
        own, steps = self._off_policy, []
        for _ in range(STEPS_OF_ROUND):
            add(self._buffer, self.environments.step(self.act()))
            before, self.moves = self.moves, self.moves + own.num_envs
            if self.moves > own.learning_starts:
                for _ in range(self.moves // own.moves_per_update - before // own.moves_per_update):
                    steps.append(
                        self.numbers(
                            self.algorithm.update(self._buffer, sample_size=own.batch_size)
                        )
                    )
        names = steps[0] if steps else {}
        return {name: float(np.mean([step[name] for step in steps])) for name in names}

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes, the buffer with its priorities included."""
        return {**super().state_dict(), "replay": replay_state(self._buffer)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        super().load_state_dict(state)
        load_replay_state(self._buffer, state["replay"])
